"""Deformation document: steps, JSON, script, key frames and animation."""

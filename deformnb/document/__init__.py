"""The deformation as a document: steps, JSON, script, key frames and animation."""

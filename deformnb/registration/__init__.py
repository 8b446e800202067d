"""Fitting control points to pictures and outlines."""

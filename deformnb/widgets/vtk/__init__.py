"""Rendering with VTK off screen."""

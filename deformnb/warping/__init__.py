"""Applying a displacement field: to volumes, labels, points, landmarks and meshes; forward and inverse."""

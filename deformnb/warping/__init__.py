"""Warping by a displacement field: volumes, labels, points, landmarks and meshes; forward and inverse."""

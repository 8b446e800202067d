"""Editors of control points on a picture and in space."""

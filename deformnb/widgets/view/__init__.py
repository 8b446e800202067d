"""Views of a volume that follow a deformation."""

"""Warping by a displacement field: volumes, labels, points, landmarks and meshes; forward and inverse."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

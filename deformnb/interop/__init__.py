"""Deformations in the pipelines of other packages: scikit-image, SimpleITK, napari and pyvista."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

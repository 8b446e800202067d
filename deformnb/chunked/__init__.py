"""Deformation of volumes that are larger than memory, in blocks, on this machine or on a cluster of dask."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

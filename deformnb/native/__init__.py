"""Compiled loops over the voxels of a warp: ``native/`` in C, called through ctypes.

Where the library is missing, voxels are read by JAX (:mod:`deformnb.volume.sampling`), with the same results.
"""

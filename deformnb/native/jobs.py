"""Structures that the compiled loops read, as ``native/loops.h`` declares them."""

from __future__ import annotations

import ctypes
from typing import ClassVar

VOXEL_TYPES = ("uint8", "int8", "uint16", "int16", "int32", "float32", "float64")
"""Names of the voxel types in the order of the enumeration in C. Bool voxels are given as uint8."""

INTERPOLATIONS = ("nearest", "linear", "cubic")
"""Names of the interpolation methods in the order of the enumeration in C."""

RADIAL_FUNCTIONS = (
    "wendland_c0",
    "wendland_c2",
    "wendland_c4",
    "gaussian",
    "multiquadric",
    "inverse_multiquadric",
    "inverse_quadratic",
    "linear",
    "thin_plate",
    "cubic",
    "quintic",
)
"""Names of the radial functions in the order of ``native/radial_sums.c``."""

TRANSPOSED_SLICES = 32
"""Slices that are transposed together where they lie apart in memory: parts of the work should have as many."""

_Address = ctypes.c_void_p
_Int = ctypes.c_int64


class Source(ctypes.Structure):
    """The input, and how it is read."""

    _fields_: ClassVar = [
        ("samples", _Address),
        ("shape", _Int * 3),
        ("fill", _Address),
        ("voxel_type", ctypes.c_int32),
        ("method", ctypes.c_int32),
        ("is_far", ctypes.c_int32),
        ("is_straight", ctypes.c_int32),
        ("matrix", ctypes.c_double * 9),
        ("whole", _Address * 3),
        ("part", _Address * 3),
        ("count", _Int * 3),
    ]


class Target(ctypes.Structure):
    """The box of the output that is written."""

    _fields_: ClassVar = [("values", _Address), ("stride", _Int * 2), ("start", _Int * 3), ("stop", _Int * 3)]


class Field(ctypes.Structure):
    """Displacements in space at the voxels of a box, or at nodes."""

    _fields_: ClassVar = [
        ("d", _Address * 3),
        ("stride", _Int * 3),
        ("nodes", _Int * 2),
        ("first", _Address * 3),
        ("weights", _Address * 3),
        ("taps", ctypes.c_int32 * 3),
    ]


class PlaneField(ctypes.Structure):
    """Displacements in a plane, and how they change along its normal."""

    _fields_: ClassVar = [
        ("maps", _Address),
        ("weights", _Address),
        ("terms", _Int),
        ("shape", _Int * 2),
        ("normal", ctypes.c_int32),
        ("first", _Int),
        ("matrix", ctypes.c_double * 4),
    ]


class VoxelList(ctypes.Structure):
    """Single voxels with their displacements."""

    _fields_: ClassVar = [("voxels", _Address), ("d", _Address), ("values", _Address), ("count", _Int)]


class LatticeSum(ctypes.Structure):
    """A sum over centres at the places of a lattice."""

    _fields_: ClassVar = [
        *((name, _Address) for name in ("row", "column", "center", "coefficient", "scale", "linear", "constant")),
        *((name, _Address) for name in ("quadratic", "out")),
        *((name, _Int) for name in ("rows", "columns", "count", "first", "stop")),
        *((name, ctypes.c_int32) for name in ("dim", "kernel", "is_compact", "is_double", "derivatives")),
    ]


class EdgeDistances(ctypes.Structure):
    """Signed distances to an outline on a picture."""

    _fields_: ClassVar = [*((name, _Address) for name in ("edge", "places", "out")), ("edges", _Int), ("count", _Int)]


class Loops(ctypes.Structure):
    """The table of functions of one level of instructions."""

    _fields_: ClassVar = [
        (name, ctypes.CFUNCTYPE(ctypes.c_int, *(_Address,) * count))
        for name, count in (
            *(("general", 3), ("listed", 2), ("slices", 3), ("rows", 3)),
            *(("sum_lattice", 1), ("edge_distances", 1)),
        )
    ]


STRUCTURES = (Source, Target, Field, PlaneField, VoxelList, LatticeSum, EdgeDistances, Loops)
"""All structures, in the order in which the library states their sizes."""

"""Volume and grid: an array of voxels with a place in space.

Arrays are [z, y, x]; points are (x, y, z) in physical LPS coordinates:
``point = origin + direction @ (spacing * index)`` with index (i, j, k) along x, y, z. This is ITK's convention.

Arrays become voxels by a cast table: some are refused by name, and images of other packages are read with their own
metadata. Every rule preserves all values exactly or refuses; nothing is rounded or wrapped silently.
"""

from __future__ import annotations

import hashlib
import math
import mmap
import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import ArrayLike, DTypeLike, NDArray

from deformnb._entrances import CONVERSIONS, DISPLAYS, AbstractCellOutput
from deformnb._typing import Float3, Spacing
from deformnb.checks import (
    LARGEST_COORDINATE,
    check_arguments,
    check_fields,
    finite_array,
    optional_package,
    real_array,
    short_value,
)
from deformnb.errors import DeformError, FileChangedError
from deformnb.volume.array_protocol import (
    KEEPS_PLACE,
    AbstractValues,
    call_on_values,
    call_without_change,
    full_slices,
    volumes_in,
)
from deformnb.volume.units import check_unit, find_unit, ratio
from deformnb.volume.views import ViewName

KEPT = frozenset({"bool", "int8", "uint8", "int16", "uint16", "int32", "float32", "float64"})

# Whole numbers up to 2**53 have an exact float64.
_EXACT_INTEGER = 2**53

# Temporaries of a check over all voxels stay below this, so that a memory-mapped volume is never copied whole.
_SLAB_BYTES = 16 * 2**20

_REFUSED = {
    "c": "complex voxels are not supported; pass the magnitude (abs(array)) or one part (array.real).",
    "O": "object arrays are not supported; convert the array to numbers first, for example array.astype('float32').",
    "V": "structured voxels are not supported; pass one field of the array.",
    "S": "text is not a voxel type; convert the array to numbers first.",
    "U": "text is not a voxel type; convert the array to numbers first.",
    "M": "dates are not a voxel type; convert the array to numbers first.",
    "m": "time differences are not a voxel type; convert the array to numbers first.",
}


def slabs(array: NDArray[Any]) -> list[NDArray[Any]]:
    """The array as a list of views along its first axis, each of about 16 MiB or one slice."""
    rows = max(1, _SLAB_BYTES // max(1, array[:1].nbytes))
    return [array[start : start + rows] for start in range(0, array.shape[0], rows)]


def three_axes(array: NDArray[Any]) -> tuple[NDArray[Any], tuple[str, ...]]:
    """The array with exactly three axes [z, y, x], and a note if one was added.

    Raises
    ------
    DeformError
        If the array has no voxels, or axes that are not z, y or x; the message names the remedy.
    """
    notes: tuple[str, ...] = ()
    if array.ndim == 2:
        array, notes = array[None], ("a 2-D image was taken as a volume of one slice",)
    elif array.ndim != 3:
        raise DeformError(_too_many(array.shape))
    if array.size == 0:
        raise DeformError(f"the array has no voxels: its shape is {array.shape}; every axis needs at least one.")
    if array.dtype == np.uint8 and array.shape[-1] in (3, 4) and min(array.shape[:2]) >= 16:
        # A colour picture looks like a volume three voxels wide: note it instead of refusing either.
        notes += (f"the x axis has {array.shape[-1]} voxels: if these are colours, pass one channel: array[..., 0]",)
    return array, notes


def _too_many(shape: tuple[int, ...]) -> str:
    if len(shape) < 2:
        return f"a volume has three axes [z, y, x] but this array has shape {shape}; reshape it first."
    axes = ", ".join(f"axis {n}: {count}" for n, count in enumerate(shape))
    if shape[-1] in (2, 3, 4) and len(shape) == 4:
        hint = "The last axis looks like colours or components: pick one with array[..., 0]"
    else:
        hint = "Pick one time or channel, for example array[0] for the first of the first axis"
    return f"a volume has three axes [z, y, x] but this array has {len(shape)} ({axes}). {hint}."


def cast(array: NDArray[Any]) -> tuple[NDArray[Any], tuple[str, ...]]:
    """The same values in a native voxel type of :data:`KEPT`, and a note if the type changed.

    The array itself is returned if it can stay: memory-mapped, read-only and Fortran arrays are not copied.

    Raises
    ------
    DeformError
        For types without an order (complex, object, text ...) and for whole numbers that no supported
            type represents exactly.

    Examples
    --------
    >>> cast(np.array([[[1, 2**31]]]))[0].dtype.name
    'float64'
    >>> cast(np.zeros((2, 2, 2), dtype=">i2"))[1]
    ()
    """
    stored = array.dtype
    if stored.kind in _REFUSED:
        raise DeformError(f"voxel type {stored.name}: {_REFUSED[stored.kind]}")
    native = stored.newbyteorder("=")
    if native.name in KEPT:
        return (array if stored.isnative else array.astype(native)), ()
    if native.name == "float16":
        target = np.dtype(np.float32)
    elif stored.kind in "iu":
        target = _integer_target(array)
    else:
        target = _extended_target(array)
    return array.astype(target), (f"voxels of type {native.name} became {target.name}; no value changed",)


def _integer_target(array: NDArray[Any]) -> np.dtype[Any]:
    low, high = int(array.min()), int(array.max())
    limits = np.iinfo(np.int32)
    if limits.min <= low and high <= limits.max:
        return np.dtype(np.int32)
    if max(-low, high) <= _EXACT_INTEGER or all(_exact_in_float64(slab) for slab in slabs(array)):
        return np.dtype(np.float64)
    raise DeformError(
        f"voxel type {array.dtype.name} with values from {low} to {high}: neither int32 nor float64 holds all of them "
        "exactly. Subtract an offset or renumber the labels first."
    )


def _exact_in_float64(slab: NDArray[Any]) -> bool:
    # 2.0**63 and 2.0**64 do not fit back into the integer type; the conversion back would wrap and be wrong.
    real = slab.astype(np.float64)
    below = real < float(2 ** (63 if slab.dtype.kind == "i" else 64))
    return bool(below.all() and (real.astype(slab.dtype) == slab).all())


def _extended_target(array: NDArray[Any]) -> np.dtype[Any]:
    for slab in slabs(array):
        with np.errstate(over="ignore"):
            real = slab.astype(np.float64)
        if not ((real == slab) | (np.isnan(real) & np.isnan(slab))).all():
            raise DeformError(
                f"voxel type {array.dtype.name} holds values that float64 would round; "
                "convert the array yourself with array.astype('float64') if that is meant."
            )
    return np.dtype(np.float64)


NOTHING_TO_SEE = "there is nothing to see in this volume; check how it was made or read, or open another"
"""The last words of the notes on volumes without any contrast."""

_SHOWN_AS = "shown as background"  # the last words of the note on voxels that are not finite

ONE_VALUE = f"every voxel has the value {{n}}: {NOTHING_TO_SEE}"
NO_VALUE = f"no voxel is a finite number: {NOTHING_TO_SEE}"
"""These notes; braces hold the value."""


def value_notes(array: NDArray[Any]) -> tuple[str, ...]:
    """Notes on voxels that are NaN or infinite, and on an array [z, y, x] that holds one value only."""
    return empty_note(array) or _not_finite_note(array)


def empty_note(array: NDArray[Any]) -> tuple[str, ...]:
    """A note on an array [z, y, x] without contrast: of one value, or without a finite number."""
    first = array[0, 0, 0]
    if (array[0] == first).all() and all((slab == first).all() for slab in slabs(array)):
        return (ONE_VALUE.format(n=f"{float(first):g}"),)
    if (
        array.dtype.kind == "f"
        and not np.isfinite(array[0]).any()
        and not any(np.isfinite(slab).any() for slab in slabs(array))
    ):
        return (NO_VALUE,)
    return ()


def _not_finite_note(array: NDArray[Any]) -> tuple[str, ...]:
    if array.dtype.kind != "f":
        return ()
    bad = sum(int(slab.size - np.count_nonzero(np.isfinite(slab))) for slab in slabs(array))
    if not bad:
        return ()
    many = f"{bad:,}".replace(",", " ")
    return (f"{many} voxels are not finite, {_SHOWN_AS}" if bad > 1 else f"1 voxel is not finite, {_SHOWN_AS}",)


# The criterion for labels against amounts: the share of equal neighbours along x, averaged over the values, and among
# the others the share that differs by 1. Measured: atlases of knee and abdomen 0.93 and 0.88, 0.01 and 0.04; phantoms
# of labels from 0.78 on, up to 0.43; CT and MR below 0.08; CT in only 16 grey values up to 0.57, from 0.81 on.
_LEAST_EQUAL, _MOST_UNIT_STEPS = 0.6, 0.6
_MOST_LABELS = 1000
_LIKE_LABELS = "the voxels look like labels"  # the first words of the note
_FEWEST_PAIRS = 1000  # fewer are no evidence
_SAMPLED_VOXELS = 2**18


def label_note(array: NDArray[Any]) -> tuple[str, ...]:
    """A note for an array [z, y, x] of whole numbers that looks like the labels of a segmentation.

    Labels are few and form regions of one value each, whose numbers are unrelated to their neighbours'; amounts vary
    within a region, or step by step from one to the next. Two values alone are no question: between 0 and 1 there is no
    third one to be made up.
    """
    if array.dtype.kind not in "iu" or array.shape[2] < 2:
        return ()
    every = max(1, array.size // _SAMPLED_VOXELS)
    planes = min(every, max(1, array.shape[0] // 8))
    rows = min(max(1, every // planes), max(1, array.shape[1] // 8))
    sample = array[planes // 2 :: planes, rows // 2 :: rows]
    left, right = sample[:, :, :-1], sample[:, :, 1:]
    is_equal, lowest = left == right, sample.min()
    counted = (left != lowest) | (right != lowest)
    pairs = np.count_nonzero(counted)
    if pairs < _FEWEST_PAIRS or 2 * np.count_nonzero(is_equal & counted) < pairs:
        return ()  # nearly all scans end here
    values, index = np.unique(left, return_inverse=True)
    if not 3 <= len(values) <= _MOST_LABELS:
        return ()
    equal = np.bincount(index.ravel(), is_equal.ravel()) / np.bincount(index.ravel())
    steps = np.abs(right[~is_equal].astype(np.float64) - left[~is_equal])
    if equal.mean() < _LEAST_EQUAL or not steps.size or np.mean(steps == 1) > _MOST_UNIT_STEPS:
        return ()
    note = (
        f"{_LIKE_LABELS} ({len(values)} whole numbers in regions of one value each) but are not "
        "declared as such: deforming makes up values between them; set is_labels=True (--labels in a command) to "
        "preserve them, or is_labels=False if they are amounts"
    )
    return (note,)


def refuse_lazy(given: Any) -> None:
    """Refuse an array in chunks (of dask, Zarr or HDF5): it would be loaded whole silently.

    Raises
    ------
    DeformError
        With its size and what to do.
    """
    if getattr(given, "chunks", None) is None or isinstance(given, np.ndarray):
        return
    kind = type(given).__module__.partition(".")[0]
    size = int(np.prod(given.shape, dtype=np.float64)) * np.dtype(given.dtype).itemsize
    load = "array.compute()" if kind in ("dask", "xarray") else "array[...]"
    raise DeformError(
        f"this is an array in chunks ({kind}) of {size / 2**20:.6g} MiB, which would be loaded whole. "
        f"deformnb.chunked.warp deforms it block by block; where it fits into memory, load it: {load}."
    )


def nibabel_unit(image: Any) -> str:
    """The unit of a nibabel image; of a format that states none millimetres, in which nibabel's affines are."""
    stated = getattr(getattr(image, "header", None), "get_xyzt_units", None)
    return "mm" if stated is None else find_unit(stated()[0]) or ""


def pyvista_parts(image: Any, scalars: str | None) -> tuple[NDArray[Any], NDArray[np.float64], str]:
    """Voxels [z, y, x] (shared), the 4 x 4 affine of their indices, and the name of an image's data.

    Data of points are at the points, those of cells at the middles of the cells.

    Raises
    ------
    DeformError
        If it is no regular grid, or has no such data.
    """
    image = _regular_image(image)
    name, is_of_cells = _scalars_of(image, scalars)
    values = np.asarray((image.cell_data if is_of_cells else image.point_data)[name])
    axes = np.asarray(image.direction_matrix) * np.asarray(image.spacing)
    # An extent need not start at 0, and VTK's origin is where index 0 would be.
    affine = np.eye(4)
    affine[:3, :3] = axes
    count = np.asarray(image.dimensions)
    middle = np.where(count > 1, 0.5, 0.0) if is_of_cells else np.zeros(3)
    affine[:3, 3] = np.asarray(image.origin) + axes @ (np.asarray(image.extent[::2]) + middle)
    shape = np.maximum(count - is_of_cells, 1)[::-1].tolist()
    return values.reshape(*shape, *values.shape[1:]), affine, name


def _regular_image(image: Any) -> Any:
    """A ``pyvista.ImageData`` of an image of pyvista or VTK, or of a rectilinear grid whose coordinates are even."""
    pyvista = optional_package("pyvista")
    image = pyvista.wrap(image)
    if isinstance(image, pyvista.ImageData):
        return image
    if not isinstance(image, pyvista.RectilinearGrid):
        raise DeformError(f"from_pyvista takes an ImageData (a regular grid), not {type(image).__name__}.")
    lines = [np.asarray(line, dtype=np.float64) for line in (image.x, image.y, image.z)]
    steps = [float((line[-1] - line[0]) / max(1, len(line) - 1)) for line in lines]
    for name, line, step in zip("xyz", lines, steps, strict=True):
        if len(line) > 1 and not (step > 0 and np.abs(np.diff(line) - step).max() <= EVEN * step):
            raise DeformError(
                f"the coordinates along {name} of the RectilinearGrid are not evenly spaced and rising; "
                "resample it onto an ImageData first: pyvista.ImageData(...).sample(grid)."
            )
    regular = pyvista.ImageData(
        dimensions=image.dimensions, origin=[float(line[0]) for line in lines], spacing=[step or 1.0 for step in steps]
    )
    regular.point_data.update(image.point_data)
    regular.cell_data.update(image.cell_data)
    _, active = image.active_scalars_info
    if active is not None:
        regular.set_active_scalars(active)
    return regular


def _scalars_of(image: Any, scalars: str | None) -> tuple[str, bool]:
    """The name of the data of an image that are its voxels, and whether they are its cells' data."""
    points, cells = list(image.point_data.keys()), list(image.cell_data.keys())
    association, active = image.active_scalars_info
    name = scalars if scalars is not None else active if active is not None else (points or cells or [""])[0]
    if name in cells and (name not in points or (scalars is None and str(association.name).upper() == "CELL")):
        return str(name), True
    if name in points:
        return str(name), False
    raise DeformError(
        f"the image has no data called {short_value(name)} (it has {points} at its points and {cells} at its cells)."
    )


class MappedFile:
    """The file behind an array that is a memory map: touching truncated bytes would end the process (SIGBUS).

    Parameters
    ----------
    memory : the map.
    end : how long the file must be.
    path : its name, None if unknown; the voxels of a map that may be written to change with its own file.
    """

    def __init__(self, memory: mmap.mmap, end: int, path: str | None) -> None:
        self._memory, self._end, self._path = memory, end, path
        self._seen = self._stat()
        self.check()

    @classmethod
    def find(cls, array: NDArray[Any]) -> MappedFile | None:
        """The file behind an array or a view of one; None if it is in memory."""
        part: Any = array
        end, path = 0, None
        while part is not None and not isinstance(part, mmap.mmap):
            if isinstance(part, np.memmap) and part.filename is not None and part.mode in ("r", "c"):
                path = os.fspath(part.filename)
            if isinstance(part, np.memmap) and isinstance(part.base, mmap.mmap):
                end = part.offset - part.offset % mmap.ALLOCATIONGRANULARITY + len(part.base)
            part = part.obj if isinstance(part, memoryview) else getattr(part, "base", None)
        try:
            return None if part is None else cls(part, end or part.size(), path)
        except OSError:  # memory without a file
            return None

    def _stat(self) -> tuple[int, int, int] | None:
        try:
            now = os.stat(self._path) if self._path is not None else None
        except OSError:  # removed or renamed: its voxels stay as long as they are mapped
            return None
        return now and (now.st_dev, now.st_ino, now.st_mtime_ns)

    def check(self) -> None:
        """Raise if the file became shorter, or was written to in place.

        Raises
        ------
        FileChangedError
            With what to do; a file put in its place under the same name leaves the mapped one as it is.
        """
        size, now = self._memory.size(), self._stat()
        if size < self._end:
            what = f"is {size} bytes long but {self._end} are mapped: it was cut short"
        elif now and self._seen and now[:2] == self._seen[:2] and now != self._seen:
            what = "was written to since the volume was made"
        else:
            return
        name = "" if self._path is None else f" {os.path.basename(self._path)!r}"
        raise FileChangedError(
            f"the file{name} that the volume's voxels are mapped from {what}. Load it again, "
            "and copy the voxels (np.array) where the file may change."
        )

    def __reduce__(self) -> tuple[type[None], tuple[()]]:
        return type(None), ()  # a pickled or deep copied array is in memory


# Coordinates are often rounded to float32 or to a few decimals; a step that differs by more than this is another step.
EVEN = 1e-3

Matrix3 = tuple[Float3, Float3, Float3]

IDENTITY: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

DTYPES = ("bool", "uint8", "int8", "uint16", "int16", "int32", "float32", "float64")
"""Voxel types that are stored unchanged. Others are cast where no value changes, or refused by name."""

# How far the direction columns may be from orthonormal. NIfTI and DICOM store float32 cosines (rounding 1e-7) and
# scanners print four to six decimals: four are off by at most 2 sqrt(3) 5e-5. A gantry tilt of 0.01 degrees passes.
ORTHONORMAL_TOLERANCE = 2e-4

SPACING_LIMITS = (1e-12, 1e12)
"""Least and largest distance of voxels: the size of a voxel, a product of three, stays a normal float32 number, as
pictures and other programs compute it. In metres this reaches below an atom, in nanometres to 1000 km."""

# Sizes are Python integers, and NumPy counts voxels in 63 bits; no machine has memory for as many.
_MOST_VOXELS = 2**60

NIFTI_UNITS = {"": 0, "m": 1, "mm": 2, "\u00b5m": 3}
"""Codes of the units of length that NIfTI can state; 0 is "unknown"."""

# From LPS to RAS and back: x and y change sign. NIfTI and nibabel use RAS.
LPS_TO_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Grid(AbstractCellOutput):
    """Grid of the voxels of a volume: shape, spacing, origin and direction.

    Parameters
    ----------
    shape : (nz, ny, nx), the shape of the array.
    spacing : (x, y, z) distance of neighbouring voxel centres, in the unit of the grid, or one number for all axes;
        from 1e-12 to 1e12, so that the size of a voxel is a number that float32 holds.
    origin : (x, y, z) of the centre of voxel [0, 0, 0].
    direction : 3 x 3, columns are the directions of the x, y and z index; orthonormal.
    unit : of spacing and origin, a symbol or a name of :data:`~deformnb.volume.units.UNITS` such as "mm" or
        "micrometer", of which the symbol is stored; "" where it is not known.
    is_anatomical : whether the axes of space are known to be a patient's or an animal's left, back and head; an
        array and files without directions have none, and views then name the axes instead. Grids are equal without it.

    Raises
    ------
    DeformError
        Naming the field that is zero, negative, not finite, beyond its limits, not orthonormal or no unit.

    Examples
    --------
    >>> grid = Grid((4, 5, 6), spacing=(1.0, 1.0, 2.5), origin=(10.0, 0.0, 0.0))
    >>> grid.index_to_point([1, 0, 2]).tolist()
    [11.0, 0.0, 5.0]
    """

    shape: tuple[int, int, int]
    spacing: Float3 = (1.0, 1.0, 1.0)
    origin: Float3 = (0.0, 0.0, 0.0)
    direction: Matrix3 = IDENTITY
    unit: str = ""
    is_anatomical: bool = field(default=True, compare=False, repr=False)

    def __post_init__(self) -> None:
        check_fields(self, "is_anatomical")
        object.__setattr__(self, "shape", check_shape(self.shape))
        object.__setattr__(self, "unit", check_unit(self.unit))
        object.__setattr__(self, "spacing", as_spacing(self.spacing))
        origin = finite_array(self.origin, (3,), "origin must be three finite numbers (x, y, z)")
        object.__setattr__(self, "origin", tuple(origin.tolist()))
        if min(self.spacing) <= 0:
            raise DeformError(
                f"spacing must be positive, got {self.spacing}; a flipped axis belongs into direction "
                "(negate its column), an unknown spacing is 1."
            )
        if min(self.spacing) < SPACING_LIMITS[0] or max(self.spacing) > SPACING_LIMITS[1]:
            raise DeformError(
                f"spacing must be from {SPACING_LIMITS[0]:g} to {SPACING_LIMITS[1]:g}, got {self.spacing}: the size "
                "of a voxel would be no number in float32. Give it in another unit."
            )
        if np.abs(self.origin).max() > LARGEST_COORDINATE:
            raise DeformError(f"the origin is {self.origin}; coordinates must be below {LARGEST_COORDINATE:g}.")
        direction = finite_array(self.direction, (3, 3), "direction must be 3 x 3 finite numbers")
        with np.errstate(over="ignore", invalid="ignore"):
            is_orthonormal = np.allclose(direction.T @ direction, np.eye(3), atol=ORTHONORMAL_TOLERANCE)
            rounded = direction.round(4).tolist()
        if not is_orthonormal:
            raise DeformError(
                "direction must be orthonormal (unit columns at right angles); this one is sheared or scaled: "
                f"{rounded}. Resample the volume onto a straight grid first."
            )
        object.__setattr__(self, "direction", tuple(tuple(float(v) for v in row) for row in direction))

    @property
    def matrix(self) -> NDArray[np.float64]:
        """3 x 3 map from an index (i, j, k) to a vector in space: direction times spacing."""
        return np.asarray(self.direction) * np.asarray(self.spacing)

    @cached_property
    def inverse(self) -> NDArray[np.float64]:
        """3 x 3 map from a vector in space to one in indices (i, j, k)."""
        inverse = np.asarray(np.linalg.inv(self.matrix), np.float64)
        inverse.flags.writeable = False
        return inverse

    def to_unit(self, unit: str) -> Grid:
        """The same places in numbers of another unit; where this grid's own or the other one is not known, itself.

        Examples
        --------
        >>> Grid((4, 5, 6), (0.5, 0.5, 2.0), unit="mm").to_unit("micrometer").spacing
        (500.0, 500.0, 2000.0)
        """
        to = check_unit(unit)
        if to in ("", self.unit) or not self.unit:
            return self
        spacing, origin = (_rescaled(lengths, self.unit, to) for lengths in (self.spacing, self.origin))
        return replace(self, spacing=spacing, origin=origin, unit=to)

    @classmethod
    def from_affine(cls, shape: tuple[int, int, int], affine: ArrayLike, unit: str = "") -> Grid:
        """The grid whose voxel (i, j, k) is at ``affine @ (i, j, k, 1)`` in LPS space; affine is 4 x 4.

        Raises
        ------
        DeformError
            If the affine is not finite, has columns of length zero or linearly dependent, or is sheared.

        Examples
        --------
        >>> Grid.from_affine((4, 5, 6), np.diag([-2.0, 1.0, 3.0, 1.0])).spacing
        (2.0, 1.0, 3.0)
        """
        matrix = finite_array(affine, (4, 4), "the affine must be 4 x 4 finite numbers")
        # Divided by the largest entry first: the square of a length of 1e-200 would vanish.
        largest = np.abs(matrix[:3, :3]).max(axis=0)
        scaled = matrix[:3, :3] / np.where(largest > 0, largest, 1.0)
        lengths = np.linalg.norm(scaled, axis=0)
        if (largest == 0).any() or np.linalg.matrix_rank(scaled / lengths) < 3:
            raise DeformError(f"the affine is singular: the columns of {matrix[:3, :3].tolist()} do not span space.")
        origin, spacing = tuple(matrix[:3, 3].tolist()), tuple((lengths * largest).tolist())
        return cls(shape, spacing, origin, tuple(tuple(row) for row in (scaled / lengths).tolist()), unit)  # type: ignore[arg-type]

    @property
    def affine(self) -> NDArray[np.float64]:
        """4 x 4 map from an index (i, j, k, 1) to a point in LPS space."""
        affine = np.eye(4)
        affine[:3, :3] = self.matrix
        affine[:3, 3] = self.origin
        return affine

    @property
    def orientation(self) -> str:
        """Directions of growing i, j and k, a letter each: Left or Right, Posterior or Anterior, Superior or Inferior.

        Examples
        --------
        >>> Grid((4, 5, 6)).orientation
        'LPS'
        """
        left = np.array(self.direction)
        letters = ["", "", ""]
        for _ in range(3):  # the most certain axis first, so that an oblique grid never gets the same letter twice
            axis, column = (int(n) for n in np.unravel_index(np.nanargmax(np.abs(left)), (3, 3)))
            letters[column] = ("LR", "PA", "SI")[axis][int(left[axis, column] < 0)]
            left[axis, :] = left[:, column] = np.nan
        return "".join(letters)

    @property
    def size(self) -> int:
        """Number of voxels."""
        return self.shape[0] * self.shape[1] * self.shape[2]

    @check_arguments
    def is_like(self, other: Grid) -> bool:
        """True if the voxels of both are at the same places, to the digits of files, for any units."""
        other = other.to_unit(self.unit)
        close = 1e-5 * min(other.spacing)
        return (
            self.shape == other.shape
            and np.allclose(self.matrix, other.matrix, 0, close)
            and np.allclose(self.origin, other.origin, 1e-9, 100 * close)
        )

    def index_to_point(self, index: ArrayLike) -> NDArray[np.float64]:
        """Points (..., 3) in space of (fractional) indices (..., 3) given as (i, j, k) along x, y, z."""
        return _places(index) @ self.matrix.T + np.asarray(self.origin)

    def point_to_index(self, points: ArrayLike) -> NDArray[np.float64]:
        """Fractional indices (i, j, k) along x, y, z of points (..., 3) in space."""
        return (_places(points) - np.asarray(self.origin)) @ self.inverse.T

    def corners(self, *, centres: bool = False) -> NDArray[np.float64]:
        """The 8 corners of the box in space, shape (8, 3); of the corner voxels' centres if ``centres``."""
        n = np.array(self.shape[::-1], dtype=np.float64)
        low, high = (np.zeros(3), n - 1) if centres else (np.full(3, -0.5), n - 0.5)
        bits = np.array([[i, j, k] for k in (0, 1) for j in (0, 1) for i in (0, 1)])
        return self.index_to_point(np.where(bits == 1, high, low))

    @check_arguments
    def overlaps(self, other: Grid) -> bool:
        """Check whether the upright boxes around two grids have places in common."""
        own, others = self.corners(), other.to_unit(self.unit).corners()
        return not ((own.max(axis=0) < others.min(axis=0)).any() or (own.min(axis=0) > others.max(axis=0)).any())

    @property
    def center(self) -> Float3:
        """The middle of the box."""
        c = self.index_to_point((np.array(self.shape[::-1]) - 1) / 2)
        return (float(c[0]), float(c[1]), float(c[2]))

    @property
    def lengths(self) -> Float3:
        """Edge lengths of the box along its own x, y, z axes (number of voxels times spacing)."""
        nz, ny, nx = self.shape
        return (nx * self.spacing[0], ny * self.spacing[1], nz * self.spacing[2])

    @property
    def diagonal(self) -> float:
        """Length of the space diagonal of the box."""
        return float(np.linalg.norm(self.lengths))

    def crop(self, start: tuple[int, int, int], shape: tuple[int, int, int]) -> Grid:
        """The grid of ``shape`` (z, y, x) whose first voxel is ``start`` (z, y, x); may reach outside this one."""
        first = real_array(start)
        if first is None or first.shape != (3,) or not (first == np.floor(first)).all():
            raise DeformError(f"the first voxel is three whole numbers (z, y, x), got {short_value(start)}.")
        origin = self.index_to_point(first[::-1])
        return replace(self, shape=shape, origin=tuple(origin))

    def cover(self, points: ArrayLike) -> Grid:
        """The same lattice with as many more voxels on each side as it takes to contain ``points`` (..., 3)."""
        index = self.point_to_index(points).reshape(-1, 3)
        if not (np.abs(index) < _MOST_VOXELS).all():
            raise DeformError(f"a grid that covers {short_value(points)} would have more voxels than there can be.")
        low = np.floor(np.minimum(index.min(axis=0), 0) + 0.5 - 1e-6).astype(int)
        high = np.ceil(np.maximum(index.max(axis=0), np.array(self.shape[::-1]) - 1) - 0.5 + 1e-6).astype(int)
        count = high - low + 1
        start = (int(low[2]), int(low[1]), int(low[0]))
        return self.crop(start, (int(count[2]), int(count[1]), int(count[0])))

    def resampled(
        self, *, spacing: ArrayLike | None = None, shape: tuple[int, int, int] | None = None, margin: ArrayLike = 0.0
    ) -> Grid:
        """The same box (grown by ``margin`` on each side) with another resolution.

        Parameters
        ----------
        spacing : one length or (x, y, z); default is the present one.
        shape : (nz, ny, nx); decides the spacing if given.
        margin : length or (x, y, z) added on both sides of each axis; negative crops.
        """
        if spacing is not None and shape is not None:
            raise DeformError("give the spacing or the shape of the new grid, not both.")
        lengths = np.asarray(self.lengths) + 2 * _one_or_three(margin, "a margin")
        if not (np.isfinite(lengths).all() and (lengths > 0).all()):
            raise DeformError(f"a margin of {short_value(margin)} leaves nothing of a box of {self.lengths}.")
        if shape is not None:
            counts = np.asarray(check_shape(shape)[::-1], dtype=np.int64)
            new = lengths / counts
        else:
            new = _one_or_three(self.spacing if spacing is None else spacing, "spacing")
            if not (new > 0).all():
                raise DeformError(f"spacing must be positive, got {short_value(spacing)}.")
            if min(new) < SPACING_LIMITS[0] or (lengths / new).prod() >= _MOST_VOXELS:
                raise DeformError(
                    f"a spacing of {short_value(spacing)} makes more voxels of a box of {self.lengths} "
                    "than there can be."
                )
            counts = np.maximum(1, np.round(lengths / new)).astype(np.int64)
        first = np.asarray(self.center) - np.asarray(self.direction) @ (new * (counts - 1) / 2)
        return replace(self, shape=tuple(int(n) for n in counts[::-1]), spacing=tuple(new), origin=tuple(first))  # type: ignore[arg-type]


def _rescaled(lengths: Float3, unit: str, to: str) -> Float3:
    """Lengths in another unit, divided where that is the exact operation: 0.5 µm are 0.0005 mm."""
    more, less = ratio(unit, to), ratio(to, unit)
    x, y, z = (length * more if more >= 1 else length / less for length in lengths)
    return x, y, z


def as_spacing(given: Spacing) -> Float3:
    """Three distances (x, y, z) of three finite numbers, or of one for all axes.

    Raises
    ------
    DeformError
        For anything else.

    Examples
    --------
    >>> as_spacing(0.5), as_spacing([1, 1, 2])
    ((0.5, 0.5, 0.5), (1.0, 1.0, 2.0))
    """
    value = real_array(given)
    if value is not None and value.ndim == 0:
        value = np.full(3, value)
    three = finite_array(
        given if value is None else value, (3,), "spacing must be three finite numbers (x, y, z), or one for all axes"
    )
    x, y, z = three.tolist()
    return x, y, z


def check_shape(shape: object) -> tuple[int, int, int]:
    """(nz, ny, nx) of whole numbers from 1 on; DeformError for anything else."""
    sizes = real_array(shape)
    whole = sizes is not None and sizes.shape == (3,) and bool((sizes == np.floor(sizes)).all())
    if sizes is None or not whole or not min(sizes) >= 1 or math.prod(sizes.tolist()) >= _MOST_VOXELS:
        raise DeformError(
            "a volume needs at least one voxel along each of z, y, x, and below 2**60 in all; its shape "
            f"is {short_value(shape)}."
        )
    nz, ny, nx = (int(n) for n in sizes)
    return nz, ny, nx


def _places(value: ArrayLike) -> NDArray[np.float64]:
    array = real_array(value)
    if array is None or array.ndim < 1 or array.shape[-1] != 3:
        raise DeformError(f"places in space are numbers (x, y, z) on the last axis, got {short_value(value)}.")
    return array


def _one_or_three(value: object, what: str) -> NDArray[np.float64]:
    array = real_array(value)
    if array is None or array.shape not in ((), (1,), (3,)) or not (np.abs(array) <= LARGEST_COORDINATE).all():
        raise DeformError(
            f"{what} must be one number below {LARGEST_COORDINATE:g} or three (x, y, z), got {short_value(value)}."
        )
    return np.broadcast_to(array, (3,))


class _CheckedVoxels:
    """The field ``values`` of a volume: a memory map's file is checked before each use."""

    def __get__(self, volume: Any, owner: type | None = None) -> Any:
        if volume is None:
            return self
        mapped: MappedFile | None = volume.__dict__.get("_mapped")
        if mapped is not None:
            mapped.check()
        return volume.__dict__["values"]

    def __set__(self, volume: Any, values: NDArray[Any]) -> None:
        volume.__dict__.update(values=values, _mapped=MappedFile.find(values))


@dataclass(frozen=True)
class PyramidLevel:
    """Place of a volume in the pyramid of resolutions (OME-Zarr) that it was read from.

    Parameters
    ----------
    path : the folder of the pyramid.
    number : the level that was read, 0 for the finest.
    grids : of all levels, the finest first.
    checksum : makes the checksum of the pyramid, the same for all levels; see
        :func:`deformnb.volume.volume.voxel_checksum`.
    voxels : ``id`` of the array that was read. Where a volume gets other voxels, they are none of the pyramid.
    """

    path: Path
    number: int
    grids: tuple[Grid, ...]
    checksum: Callable[[], str]
    voxels: int

    def __str__(self) -> str:
        return f"level {self.number} (0 finest, {len(self.grids) - 1} coarsest)"


_COMPARED = (bool, int, float, np.number, np.bool_, np.ndarray)  # with each voxel, by volume == 3


def _comparison(ufunc: np.ufunc) -> Any:
    """Operator that compares each voxel with a value or an array; two volumes are equal if they are one object."""

    def compare(volume: Any, other: object) -> Any:
        return ufunc(volume, other) if isinstance(other, _COMPARED) else NotImplemented

    return compare


@dataclass(frozen=True, eq=False)
class Volume(NDArrayOperatorsMixin, AbstractValues, AbstractCellOutput):
    """Scalar voxels on a grid.

    NumPy computes with its voxels, and what has the same shape is a volume on the same grid: ``volume + 1``,
    ``np.sqrt(volume)``, ``volume > 300``, ``volume == 3``. Slices leave a part at its place: ``volume[10:20]``.

    ``==`` of two volumes is whether they are one object, since they are keys of caches and members of lists;
    :meth:`equals` compares two as a whole, and ``np.equal`` each voxel.

    Parameters
    ----------
    values : array [z, y, x] of one of :data:`DTYPES`; never written to. Use :meth:`from_array` for anything else. If it
        is a memory map, its file is checked before each use: FileChangedError if it was cut short or written to.
    grid : its :class:`Grid`; shapes must agree.
    name : shown to people; never used as a path.
    is_labels : voxels are names of things, not amounts: sampled by nearest neighbour so that no new value appears.
    notes : remarks made while loading ("12 voxels are not finite"), for a status line.
    level : of the pyramid that it was read from; None for any other volume, and where its voxels or its grid are not
        those of that level (any more).
    """

    values: NDArray[Any]
    grid: Grid = field(default=None)  # type: ignore[assignment]  # refused in __post_init__
    name: str = ""
    is_labels: bool = False
    notes: tuple[str, ...] = field(default=())
    level: PyramidLevel | None = None

    def __post_init__(self) -> None:
        if self.grid is None:
            raise DeformError(
                "a volume needs the grid of its voxels; Volume.from_array(array, spacing, origin) makes one with it."
            )
        check_fields(self, "grid", "name", "is_labels", "notes", "level")
        if self.level is not None and (self.level.voxels, self.level.grids[self.level.number]) != (
            id(self.values),
            self.grid,
        ):
            object.__setattr__(self, "level", None)
        if not isinstance(self.values, np.ndarray):
            raise DeformError(f"the voxels of a volume are an array, got {short_value(self.values)}.")
        if tuple(self.values.shape) != self.grid.shape:
            raise DeformError(f"the array has shape {self.values.shape} but the grid has {self.grid.shape}.")
        if self.values.dtype.name not in DTYPES or not self.values.dtype.isnative:
            raise DeformError(f"voxel type {self.values.dtype} is not supported; use Volume.from_array to cast it.")

    @property
    def is_undecided(self) -> bool:
        """True where a note states that the voxels may be labels."""
        return any(note.startswith(_LIKE_LABELS) for note in self.notes)

    def mark_labels(self, is_labels: bool) -> Volume:
        """The same voxels as labels or as amounts, without that note.

        Examples
        --------
        >>> bones = np.repeat(np.arange(0, 90, 9, dtype=np.int16), 400).reshape(10, 20, 20)
        >>> Volume.from_array(np.tile(bones, (1, 1, 2))).mark_labels(True).is_labels
        True
        """
        notes = tuple(note for note in self.notes if not note.startswith(_LIKE_LABELS))
        return replace(self, is_labels=is_labels, notes=notes)

    def __repr__(self) -> str:
        (nz, ny, nx), spacing = self.shape, self.grid.spacing
        unit = self.grid.unit and f" {self.grid.unit}"
        kind = f"{self.dtype.name} labels" if self.is_labels and self.dtype != np.bool_ else self.dtype.name
        name = f" {self.name[:60]!r}" if self.name else ""
        return (
            f"<Volume{name}: {nx} x {ny} x {nz} voxels (x, y, z), {kind}, "
            f"spacing {' x '.join(f'{s:.6g}' for s in spacing)}{unit}>"
        )

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: Any) -> Any:
        """A part of the volume by slices [z, y, x], which keeps its place; with numbers or masks an array of voxels.

        Raises
        ------
        DeformError
            For a step below 1, slices that leave nothing, and a mask on another grid.

        Examples
        --------
        >>> volume = Volume.from_array(np.arange(60).reshape(3, 4, 5), spacing=(1, 1, 2))
        >>> part = volume[1:, :, ::2]
        >>> part.shape, part.grid.spacing, part.grid.origin
        ((2, 4, 3), (2.0, 1.0, 2.0), (0.0, 0.0, 2.0))
        >>> volume[1].shape, int(volume[1, 2, 3]), volume[volume > 57].tolist()
        ((4, 5), 33, [58, 59])
        """
        if isinstance(key, Volume):
            _check_same_places(self.grid, key.grid)
            if key.dtype != np.bool_:
                raise DeformError(f"a mask is a volume of bool, got {key.dtype.name}; compare it: volume[labels == 3].")
            return self.values[key.values]
        slices = full_slices(key, self.shape)
        if slices is None:
            if isinstance(key, str):
                raise DeformError(f"a volume has voxels by number and no parts by name, got {short_value(key)}.")
            return self.values[key]
        values, steps = self.values[slices], [part.step for part in reversed(slices)]
        grid = replace(
            self.grid.crop([part.start for part in slices], values.shape),  # type: ignore[arg-type]
            spacing=tuple(s * step for s, step in zip(self.grid.spacing, steps, strict=True)),
        )
        kept = (note for note in self.notes if not note.endswith((NOTHING_TO_SEE, _SHOWN_AS)))
        return replace(self, values=values, grid=grid, notes=(*kept, *value_notes(values)))

    def crop(self, start: Sequence[int], shape: Sequence[int]) -> Volume:
        """The part of ``shape`` (z, y, x) whose first voxel is ``start`` (z, y, x); its voxels are shared.

        Raises
        ------
        DeformError
            If the part reaches outside, where there are no voxels: :meth:`Grid.crop` has the grid of such a part.

        Examples
        --------
        >>> Volume.from_array(np.zeros((4, 5, 6)), spacing=(1, 1, 2)).crop((1, 0, 3), (2, 5, 3)).grid.origin
        (3.0, 0.0, 2.0)
        """
        part = self.grid.crop(start, shape)  # type: ignore[arg-type]  # checks both
        ends = [(int(first), int(first) + size) for first, size in zip(start, part.shape, strict=True)]
        if any(first < 0 or end > size for (first, end), size in zip(ends, self.shape, strict=True)):
            raise DeformError(
                f"the part of {part.shape} voxels from {short_value(tuple(start))} on reaches outside the volume "
                f"of {self.shape} (z, y, x)."
            )
        cropped: Volume = self[tuple(slice(*pair) for pair in ends)]
        return cropped

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> Any:
        """NumPy's functions and operators on the voxels: the result is a volume on the same grid.

        It has the type that NumPy gives it (uint8 wraps: 255 + 1 is 0), or the next that a volume can have. Labels stay
        labels where it is whole numbers. Sums and the like (``np.add.reduce``) are arrays or numbers.

        Raises
        ------
        DeformError
            For volumes on different grids, results of another shape, and for ``volume += 1``.
        """
        volumes = [given for given in inputs if isinstance(given, Volume)]
        for other in volumes[1:]:
            _check_same_places(volumes[0].grid, other.grid)
        found = call_on_values(ufunc, method, inputs, options)
        if method != "__call__" or "out" in options or ufunc.signature is not None:  # np.matmul moves voxels
            return found
        results = tuple(_volume_on_grid(array, volumes or [self]) for array in (found if ufunc.nout > 1 else (found,)))
        return results if ufunc.nout > 1 else results[0]

    def __array_function__(self, func: Callable[..., Any], types: Any, args: Any, options: Any) -> Any:
        """NumPy's other functions: ``np.clip(volume, 0, 255)`` is a volume; what may move voxels leaves an array."""
        volumes = [one for one in volumes_in([*args, *options.values()]) if isinstance(one, Volume)]
        if func in KEEPS_PLACE:
            for other in volumes[1:]:
                _check_same_places(volumes[0].grid, other.grid)
        found = call_without_change(func, args, options)
        keeps = func in KEEPS_PLACE and "out" not in options and np.shape(found) == volumes[0].shape
        return _volume_on_grid(found, volumes) if keeps else found

    __eq__ = _comparison(np.equal)
    __ne__ = _comparison(np.not_equal)

    __hash__ = object.__hash__

    def astype(self, dtype: DTypeLike) -> Volume:
        """The same volume with voxels of another type, as NumPy converts them: fractions are cut off, not rounded.

        Examples
        --------
        >>> (Volume.from_array(np.full((1, 1, 1), 200, np.uint8)).astype(np.int16) + 100).values.tolist()
        [[[300]]]
        """
        try:
            wanted = np.dtype(dtype)
        except TypeError as error:
            raise DeformError(f"{short_value(dtype)} is no type of voxels; there are {', '.join(DTYPES)}.") from error
        return _volume_on_grid(self.values.astype(wanted), [self])

    @classmethod
    def from_array(
        cls,
        array: ArrayLike,
        spacing: Spacing = (1.0, 1.0, 1.0),
        origin: Float3 = (0.0, 0.0, 0.0),
        direction: Matrix3 = IDENTITY,
        name: str = "",
        is_labels: bool | None = None,
        *,
        unit: str = "",
    ) -> Volume:
        """A volume of any array of numbers [z, y, x]; a 2-D image [y, x] becomes one slice.

        The array is not copied where its type can stay (memory-mapped, read-only and Fortran arrays included).
        Big-endian becomes native; int64, uint32 and uint64 become int32 if all values fit, else float64 if that is
        exact; float16 becomes float32.

        Parameters
        ----------
        array : [z, y, x] or [y, x].
        spacing, origin, direction, unit : see :class:`Grid`.
        name : shown to people.
        is_labels : voxels are names, not amounts; by default only bool voxels are, and a note is added where whole
            numbers may be labels.

        Raises
        ------
        DeformError
            For other axes (time, colour), no voxels, complex or object types, values no type holds exactly, masked
            arrays, arrays in chunks (dask, Zarr), and for a spacing, origin or direction that :class:`Grid` refuses.

        Examples
        --------
        >>> Volume.from_array(np.zeros((4, 5, 6), dtype=">i2"), spacing=(1, 1, 2)).dtype.name
        'int16'
        """
        if isinstance(array, np.ma.MaskedArray):
            raise DeformError("masked arrays are not supported; choose what hidden voxels hold: array.filled(value).")
        refuse_lazy(array)
        try:
            given = np.asanyarray(array)
        except ValueError as error:
            raise DeformError(f"the voxels of a volume are an array of numbers, and this is none ({error}).") from None
        values, axis_notes = three_axes(given)
        MappedFile.find(values)  # which refuses a file that was cut short already
        values, cast_notes = cast(values)
        shape = (int(values.shape[0]), int(values.shape[1]), int(values.shape[2]))
        labels = values.dtype == np.bool_ if is_labels is None else is_labels
        notes = axis_notes + cast_notes + value_notes(values) + (label_note(values) if is_labels is None else ())
        is_anatomical = direction is not IDENTITY  # else the array alone was given
        grid = Grid(shape, as_spacing(spacing), origin, direction, unit, is_anatomical)
        return cls(values, grid, name, bool(labels), notes)

    @classmethod
    def from_affine(
        cls, array: ArrayLike, affine: ArrayLike, name: str = "", is_labels: bool | None = None, *, unit: str = ""
    ) -> Volume:
        """A volume of an array [z, y, x] and the 4 x 4 LPS affine of its indices (i, j, k), in a unit of length."""
        plain = cls.from_array(array, name=name, is_labels=is_labels)
        return replace(plain, grid=Grid.from_affine(plain.shape, affine, unit))

    @classmethod
    def from_pyvista(cls, image: Any, scalars: str | None = None, is_labels: bool | None = None) -> Volume:
        """A volume that shares the voxels of an image of pyvista or VTK, or of an even RectilinearGrid.

        Parameters
        ----------
        image : its data of points are at the points, those of cells at the middles of the cells.
        scalars : name of the data; default are the active ones.
        is_labels : as in :meth:`from_array`.

        VTK has no units; its lengths are taken as millimetres, which :meth:`to_pyvista` gives.

        Raises
        ------
        DeformError
            If it is no regular grid, or has no such data of one component.
        """
        values, affine, name = pyvista_parts(image, scalars)
        return cls.from_affine(values, affine, name, is_labels, unit="mm")

    @classmethod
    def from_xarray(cls, array: Any, is_labels: bool | None = None) -> Volume:
        """A volume that shares the voxels of an ``xarray.DataArray``; see :func:`deformnb.volume.from_xarray`."""
        found: Volume = CONVERSIONS["from_xarray"](array, is_labels=is_labels)
        return found

    @classmethod
    def from_sitk(cls, image: Any, name: str = "", is_labels: bool | None = None) -> Volume:
        """A volume of a scalar SimpleITK image of two or three dimensions (its voxels are copied), in millimetres."""
        sitk = optional_package("SimpleITK")
        if image.GetDimension() == 2:
            image = sitk.JoinSeries(image)
        values = sitk.GetArrayFromImage(image)
        if values.ndim != 3:  # more dimensions or several components: named there, with how to pick
            return cls.from_array(values)
        direction = np.reshape(image.GetDirection(), (3, 3)).tolist()
        return cls.from_array(values, image.GetSpacing(), image.GetOrigin(), direction, name, is_labels, unit="mm")

    @classmethod
    def from_nibabel(cls, image: Any, name: str = "", is_labels: bool | None = None) -> Volume:
        """A volume that shares the voxels of a nibabel image; RAS becomes LPS and [x, y, z] becomes [z, y, x]."""
        optional_package("nibabel")
        values = np.asanyarray(image.dataobj)
        if values.ndim > 3 and set(values.shape[3:]) == {1}:  # one moment of one component
            values = values.reshape(values.shape[:3])
        values = values.reshape(*values.shape, *(1,) * (3 - values.ndim)) if values.ndim else values
        affine = LPS_TO_RAS @ np.asarray(image.affine, dtype=np.float64)
        return cls.from_affine(values.T, affine, name, is_labels, unit=nibabel_unit(image))

    def to_unit(self, unit: str) -> Volume:
        """The same voxels (shared) at the same places, in numbers of another unit; see :meth:`Grid.to_unit`.

        Examples
        --------
        >>> Volume.from_array(np.zeros((2, 3, 4)), (0.5, 0.5, 2.0), unit="mm").to_unit("um")
        <Volume: 4 x 3 x 2 voxels (x, y, z), float64, spacing 500 x 500 x 2000 µm>
        """
        grid, level = self.grid.to_unit(unit), self.level
        if grid is self.grid:
            return self
        if level is not None:
            level = replace(level, grids=tuple(one.to_unit(unit) for one in level.grids))
        return replace(self, grid=grid, level=level)

    @property
    def finest_grid(self) -> Grid:
        """The grid on which deformations are stated: of the finest level of a pyramid, or else the volume's own."""
        return self.grid if self.level is None else self.level.grids[0]

    def to_own_resolution(self, box: Grid) -> Grid:
        """A box that is stated in voxels of the finest level, in voxels as large as those of this volume."""
        return _resize_box(box, self.finest_grid, self.grid)

    def to_finest_resolution(self, box: Grid) -> Grid:
        """A box that is stated in voxels of this volume, in voxels as large as those of the finest level."""
        return _resize_box(box, self.grid, self.finest_grid)

    def to_pyvista(self) -> Any:
        """A ``pyvista.ImageData`` that shares these voxels as point data, named like the volume or else "values".

        VTK has no units: lengths are millimetres, or those of the volume where its unit is not known.
        """
        grid, pyvista = self.grid.to_unit("mm"), optional_package("pyvista")
        image = pyvista.ImageData(
            dimensions=self.shape[::-1],
            spacing=grid.spacing,
            origin=grid.origin,
            direction_matrix=np.asarray(grid.direction),
        )
        name = self.name or "values"
        image.point_data.set_array(np.asarray(self.values).reshape(-1), name)
        image.point_data.active_scalars_name = name
        return image

    def to_xarray(self) -> Any:
        """An ``xarray.DataArray`` that shares these voxels; see :func:`deformnb.volume.to_xarray`."""
        return CONVERSIONS["to_xarray"](self)

    def to_sitk(self) -> Any:
        """A ``SimpleITK.Image`` with the same voxels (copied) at the same places, in mm as in ITK; bool becomes uint8.

        Where the unit of the volume is not known its numbers are taken as they are.
        """
        grid = self.grid.to_unit("mm")
        values = self.values.view(np.uint8) if self.dtype == np.bool_ else self.values
        image = optional_package("SimpleITK").GetImageFromArray(np.ascontiguousarray(values))
        image.SetSpacing(grid.spacing)
        image.SetOrigin(grid.origin)
        image.SetDirection(np.ravel(grid.direction).tolist())
        return image

    def to_nibabel(self) -> Any:
        """A ``nibabel.Nifti1Image`` that shares these voxels, with a RAS affine; bool becomes uint8.

        It has the unit of the volume, or millimetres where NIfTI has no code for that one.
        """
        grid = self.grid if self.grid.unit in NIFTI_UNITS else self.grid.to_unit("mm")
        values = self.values.view(np.uint8) if self.dtype == np.bool_ else self.values
        image = optional_package("nibabel").Nifti1Image(values.T, LPS_TO_RAS @ grid.affine)
        image.header.set_xyzt_units(NIFTI_UNITS[grid.unit])
        image.set_qform(image.affine, code=1, update_affine=False)  # else the affine is rounded to float32
        return image

    def plot(self, view: ViewName = "+y", method: str = "mip", *, ax: Any = None, **options: Any) -> Any:
        """Draw a picture of the volume with Matplotlib, in lengths.

        Parameters
        ----------
        view, method, options : as of :func:`deformnb.project`.
        ax : axes of Matplotlib to draw in; default are those of a new figure.

        Returns
        -------
        The axes.

        Examples
        --------
        >>> import matplotlib
        >>> matplotlib.use("agg")
        >>> Volume.from_array(np.eye(3), spacing=(1, 1, 2), unit="mm").plot("+z").get_xlabel()
        'x (mm)'
        """
        return DISPLAYS["plot_volume"](self, view, method, ax=ax, **options)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(nz, ny, nx)."""
        return self.grid.shape

    @cached_property
    def value_range(self) -> tuple[float, float]:
        """Smallest and largest finite value; (0, 0) if there is none."""
        v = self.values
        if v.dtype.kind == "f":
            if not np.isfinite(v).all():
                v = v[np.isfinite(v)]
            if v.size == 0:
                return 0.0, 0.0
        return float(v.min()), float(v.max())

    @property
    def background(self) -> float:
        """Background value outside: the smallest finite value (air in CT, 0 in labels)."""
        return self.value_range[0]

    @property
    def finite_values(self) -> NDArray[Any]:
        """The voxels with NaN and infinity replaced by the background; the same array if all are finite."""
        return self.values if self._finite_values is None else self._finite_values

    @cached_property
    def _finite_values(self) -> NDArray[Any] | None:
        values = self.values
        if values.dtype.kind != "f" or np.isfinite(values).all():
            return None
        return np.where(np.isfinite(values), values, values.dtype.type(self.background))


def _check_same_places(grid: Grid, other: Grid) -> None:
    if not grid.is_like(other):
        raise DeformError(
            f"these volumes are on different grids, of {grid.shape} and {other.shape} voxels (z, y, x) or at different "
            "places; resample one first: Deformation().apply(other, output=volume)."
        )


def _volume_on_grid(array: Any, volumes: Sequence[Volume]) -> Volume:
    """A volume of an array that was computed of volumes, on the grid of the first one."""
    first = volumes[0]
    if np.shape(array) != first.shape:
        raise DeformError(
            f"the result has the shape {np.shape(array)} and the volume {first.shape}, so that it has no place; "
            "compute with arrays: np.asarray(volume)."
        )
    is_labels = array.dtype.kind == "b" or (array.dtype.kind in "iu" and all(volume.is_labels for volume in volumes))
    return replace(Volume.from_array(array, name=first.name, is_labels=is_labels), grid=first.grid)


Volume.values = _CheckedVoxels()  # type: ignore[assignment]  # set here, for in the class it would be a default


VolumeLike: TypeAlias = Volume | ArrayLike | os.PathLike[str] | Any
"""Objects that :func:`as_volume` takes wherever a volume is required: a Volume; an image of SimpleITK, ITK, nibabel,
pyvista or VTK; a DataArray or a Dataset of one variable of xarray; a layer of napari; the path of a file; an array
[z, y, x], which is at the origin with voxels 1 apart. Each is placed as its own package states."""


def _resize_box(box: Grid, old: Grid, new: Grid) -> Grid:
    """The box in voxels that are as many times larger as those of one grid are larger than those of another."""
    if box == old:
        return new
    factors = (np.asarray(new.spacing) / np.asarray(old.spacing))[::-1]
    if (factors == 1).all():
        return box
    nz, ny, nx = (max(1, round(n / f)) for n, f in zip(box.shape, factors.tolist(), strict=True))
    return box.resampled(shape=(nz, ny, nx))


def as_finest_grid(given: Grid | VolumeLike) -> Grid:
    """The grid itself, or the one of a volume on which deformations are stated: :attr:`Volume.finest_grid`."""
    return given.finest_grid if isinstance(given, Volume) else as_grid(given)


def as_grid(given: Grid | VolumeLike) -> Grid:
    """The grid itself, or that of a volume, of an image of another package or of a file, whose header alone is read.

    Raises
    ------
    DeformError
        For anything else. An array has no grid: the distance of its voxels is not known.

    Examples
    --------
    >>> as_grid(Volume.from_array(np.eye(3))).shape
    (1, 3, 3)
    """
    if isinstance(given, Grid | Volume):
        return given if isinstance(given, Grid) else given.grid
    found: Grid = CONVERSIONS["grid_of"](given)
    return found


def has_grid(given: object) -> bool:
    """Check whether an object has a grid: a Grid, a Volume, an image of another package, or a path. No array has one.

    Examples
    --------
    >>> has_grid(Grid((2, 3, 4))), has_grid(np.zeros((2, 3, 4)))
    (True, False)
    """
    if isinstance(given, Grid | Volume | str | os.PathLike) or isinstance(getattr(given, "grid", None), Grid):
        return True
    return bool(CONVERSIONS["states_place"](given))


def as_output(given: Grid | VolumeLike, own: Grid) -> Grid:
    """The grid of a result in the unit of a volume's own grid; one that states no unit is taken to be in that.

    Examples
    --------
    >>> as_output(Grid((2, 2, 2)), Grid((4, 4, 4), unit="mm")).unit
    'mm'
    """
    grid = as_grid(given)
    return grid.to_unit(own.unit) if grid.unit or not own.unit else replace(grid, unit=own.unit)


def as_volume(given: VolumeLike) -> Volume:
    """The volume that any accepted object is: see :data:`VolumeLike`.

    Raises
    ------
    DeformError
        For anything else, and for several channels, which are no single volume.

    Examples
    --------
    >>> as_volume(np.zeros((2, 3, 4), np.uint8)).notes[-1][:31]
    'an array has no place: it is pu'
    """
    if isinstance(given, Volume):
        return given
    found: Volume = CONVERSIONS["one_volume"](given)
    return found


def as_volumes(given: Iterable[VolumeLike]) -> list[Volume]:
    """The volumes that several objects are; a single one, which might be meant, is refused.

    Raises
    ------
    DeformError
        As :func:`as_volume`, and if it is no list of any.
    """
    if isinstance(given, Volume | str | os.PathLike) or not isinstance(given, Iterable):
        raise DeformError(f"a list of volumes is needed, got {short_value(given)}.")
    return [as_volume(one) for one in given]


def voxel_checksum(dtype: np.dtype[Any], shape: tuple[int, int, int], slices: Iterable[NDArray[Any]]) -> str:
    """SHA-256 of a volume's type, shape and voxels, in 64 hexadecimal digits: the same in any storage.

    Parameters
    ----------
    dtype : native type of the voxels.
    shape : (nz, ny, nx).
    slices : the voxels [z, y, x], one or several slices at a time: a mapped or strided array is never copied whole.

    Examples
    --------
    >>> voxels = np.zeros((2, 3, 4), np.uint8)
    >>> voxel_checksum(voxels.dtype, (2, 3, 4), voxels)[:12]
    'c969b47f3d92'
    """
    digest = hashlib.sha256(f"{dtype.name} {shape} ".encode())
    for part in slices:
        digest.update(np.ascontiguousarray(part).data)
    return digest.hexdigest()

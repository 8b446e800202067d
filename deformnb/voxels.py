"""Which arrays become voxels: the cast table, what is refused by name, and where other packages keep theirs.

Every rule keeps all values exactly or refuses; nothing is rounded or wrapped in silence.
"""

from __future__ import annotations

import mmap
import os
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.errors import DeformError, FileChangedError, MissingPackageError

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
    return [array[start:start + rows] for start in range(0, array.shape[0], rows)]


def three_axes(array: NDArray[Any]) -> tuple[NDArray[Any], tuple[str, ...]]:
    """The array with exactly three axes [z, y, x], and a note if one was added.

    Raises
    ------
    DeformError
        If the array has no voxels, or axes that are not z, y or x; the message says how to pick.
    """
    notes: tuple[str, ...] = ()
    if array.ndim == 2:
        array, notes = array[None], ("a 2-D image was taken as a volume of one slice",)
    elif array.ndim != 3:
        raise DeformError(_too_many(array.shape))
    if array.size == 0:
        raise DeformError(f"the array has no voxels: its shape is {array.shape}; every axis needs at least one.")
    if array.dtype == np.uint8 and array.shape[-1] in (3, 4) and min(array.shape[:2]) >= 16:
        # One cannot tell a colour picture from a volume three voxels wide, so say it instead of refusing either.
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

    The array comes back itself if it can stay: memory-mapped, read-only and Fortran arrays are not copied.

    Raises
    ------
    DeformError
        For types without an order (complex, object, text ...) and for whole numbers no kept type holds exactly.

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
        "exactly. Subtract an offset or number the labels anew first."
    )


def _exact_in_float64(slab: NDArray[Any]) -> bool:
    # 2.0**63 and 2.0**64 do not fit back into the integer type; the conversion back would wrap and lie.
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


def value_notes(array: NDArray[Any]) -> tuple[str, ...]:
    """Notes on voxels that are NaN or infinite, and on an array [z, y, x] that holds one value only."""
    first = array[0, 0, 0]
    if (array[0] == first).all() and all((slab == first).all() for slab in slabs(array)):
        return (f"every voxel has the value {float(first):g}: there is nothing to see in this volume",)
    return _not_finite_note(array)


def _not_finite_note(array: NDArray[Any]) -> tuple[str, ...]:
    if array.dtype.kind != "f":
        return ()
    bad = sum(int(slab.size - np.count_nonzero(np.isfinite(slab))) for slab in slabs(array))
    if not bad:
        return ()
    many = f"{bad:,}".replace(",", " ")
    return (f"{many} voxels are not finite, shown as background" if bad > 1
            else "1 voxel is not finite, shown as background",)


# What tells labels from amounts: the share of equal neighbours along x, averaged over the values, and among the others
# the share that differs by 1. Measured: atlases of knee and abdomen 0.93 and 0.88, 0.01 and 0.04; phantoms of labels
# from 0.78 on, up to 0.43; CT and MR below 0.08; CT in only 16 grey values up to 0.57, from 0.81 on.
_LEAST_EQUAL, _MOST_UNIT_STEPS = 0.6, 0.6
_MOST_LABELS = 1000
_FEWEST_PAIRS = 1000  # fewer say nothing
_SAMPLED_VOXELS = 2**18


def label_note(array: NDArray[Any]) -> tuple[str, ...]:
    """A note that asks, if an array [z, y, x] of whole numbers looks like the labels of a segmentation.

    Labels are few and lie in regions of one value each, whose numbers say nothing of their neighbours'; amounts vary
    within a region, or step by step from one to the next. Two values alone are no question: between 0 and 1 there is
    no third one to be made up.
    """
    if array.dtype.kind not in "iu" or array.shape[2] < 2:
        return ()
    every = max(1, array.size // _SAMPLED_VOXELS)
    planes = min(every, max(1, array.shape[0] // 8))
    rows = min(max(1, every // planes), max(1, array.shape[1] // 8))
    sample = array[planes // 2::planes, rows // 2::rows]
    left, right = sample[:, :, :-1], sample[:, :, 1:]
    is_equal, lowest = left == right, sample.min()
    counted = (left != lowest) | (right != lowest)
    pairs = np.count_nonzero(counted)
    if pairs < _FEWEST_PAIRS or 2 * np.count_nonzero(is_equal & counted) < pairs:
        return ()  # nearly all of what is scanned ends here
    values, index = np.unique(left, return_inverse=True)
    if not 3 <= len(values) <= _MOST_LABELS:
        return ()
    equal = np.bincount(index.ravel(), is_equal.ravel()) / np.bincount(index.ravel())
    steps = np.abs(right[~is_equal].astype(np.float64) - left[~is_equal])
    if equal.mean() < _LEAST_EQUAL or not steps.size or np.mean(steps == 1) > _MOST_UNIT_STEPS:
        return ()
    note = (f"the voxels look like labels ({len(values)} whole numbers in regions of one value each) but are not "
            "declared as such: deforming makes up values between them; say is_labels=True (--labels in a command) to "
            "keep each as it is, or is_labels=False if they are amounts")
    return (note,)


def optional_package(package: str) -> Any:
    """An optional package, imported now.

    Raises
    ------
    MissingPackageError
        With its name, if it is not installed.
    """
    try:
        return import_module(package)
    except ImportError as error:
        message = f"this needs the package {package}, which is not installed: pip install {package}"
        raise MissingPackageError(message) from error


def pyvista_parts(image: Any, scalars: str | None) -> tuple[NDArray[Any], NDArray[np.float64], str]:
    """Voxels [z, y, x] (shared), the 4 x 4 affine of their indices, and the name of an image's point data.

    Raises
    ------
    DeformError
        If it is no image, or has no such point data.
    """
    pyvista = optional_package("pyvista")
    image = pyvista.wrap(image)
    if not isinstance(image, pyvista.ImageData):
        raise DeformError(f"from_pyvista takes an ImageData (a regular grid), not {type(image).__name__}.")
    names = list(image.point_data.keys())
    name = scalars if scalars is not None else image.point_data.active_scalars_name or (names or [""])[0]
    if name not in names:
        raise DeformError(f"the image has no point data called {name!r} (it has {names}); for cell data call "
                          "image.cells_to_points() first.")
    values = np.asarray(image.point_data[name])
    axes = np.asarray(image.direction_matrix) * np.asarray(image.spacing)
    # An extent need not start at 0, and VTK's origin is where index 0 would be.
    affine = np.eye(4)
    affine[:3, :3], affine[:3, 3] = axes, np.asarray(image.origin) + axes @ np.asarray(image.extent[::2])
    return values.reshape(*image.dimensions[::-1], *values.shape[1:]), affine, str(name)


class MappedFile:
    """The file behind an array that is a memory map: touching what was cut off would end the process (SIGBUS).

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
    def behind(cls, array: NDArray[Any]) -> MappedFile | None:
        """The file behind an array or a view of one; None if it lies in memory."""
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
        """Raise if the file became shorter, or was written to where it lies.

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
        raise FileChangedError(f"the file{name} that the volume's voxels are mapped from {what}. Load it anew, "
                               "and copy the voxels (np.array) where the file may change.")

    def __reduce__(self) -> tuple[type[None], tuple[()]]:
        return type(None), ()  # a pickled or deep copied array lies in memory

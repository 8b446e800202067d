"""Volumes that are read in parts: Zarr and OME-Zarr, HDF5, TIFF, memory maps, dask arrays.

A source is read by many threads or processes, so what reads it can be sent to another process: files are opened there.
"""

from __future__ import annotations

import hashlib
import math
import os
import threading
from collections import OrderedDict
from concurrent.futures import Future
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from deformnb._entrances import AbstractCellOutput
from deformnb._typing import Progress, Spacing, VoxelSlices
from deformnb.checks import optional_package, short_value
from deformnb.errors import DeformError
from deformnb.io.files.addresses import input_path
from deformnb.io.files.errors import Damage, fail, printable, unpacking
from deformnb.io.files.memory import default_limit
from deformnb.io.files.paths import address_of, regular_file
from deformnb.io.files.zarr_copy import ZarrCopy
from deformnb.io.volumes import ome_zarr, tiff, tiff_pages
from deformnb.io.volumes.formats import describe_file
from deformnb.io.volumes.headers import volume_shape
from deformnb.volume.converters import NO_PLACE, states_place
from deformnb.volume.labelled import LabelledAxes, is_labelled, one_array
from deformnb.volume.volume import DTYPES, Grid, Volume, as_spacing, as_volume, voxel_checksum

# Types whose voxels are converted where no value changes; a value that does not fit is refused when it is read.
_CAST = {"uint32": "int32", "int64": "int32", "uint64": "int32", "float16": "float32"}

# Voxels along each axis that are compared when a job resumes: each unpacks a chunk, some milliseconds.
_SAMPLES = 3

# The part of a source that is read in one call to find its smallest value.
_SLAB_BYTES = 2**25

HDF5 = (".h5", ".hdf5", ".hdf", ".he5")
_TIFF = (".tif", ".tiff", ".btf", ".tf8")


class VoxelReader(Protocol):
    """An array [z, y, x] that is read in parts, in any process."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(nz, ny, nx)."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type as stored."""

    @property
    def chunks(self) -> tuple[int, ...] | None:
        """Voxels (z, y, x) that are stored and unpacked together; None if every part is read as quickly."""

    def read(self, part: VoxelSlices) -> NDArray[Any]:
        """Voxels of a part."""

    def identity(self) -> str:
        """A text that differs for other voxels, as far as can be determined without reading them."""


@dataclass(frozen=True, eq=False)
class _Array:
    """An array in memory, or of dask, or anything that is sliced as those are."""

    array: Any

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(int(n) for n in self.array.shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(self.array.dtype)

    @property
    def chunks(self) -> None:
        return None

    def read(self, part: VoxelSlices) -> NDArray[Any]:
        found = self.array[part]
        if hasattr(found, "compute"):  # of dask; the threads are busy with blocks already
            found = found.compute(scheduler="synchronous")
        return np.asarray(found)

    def identity(self) -> str:
        if isinstance(self.array, np.ndarray):
            shape = (self.array.shape[0], self.array.shape[1], self.array.shape[2])
            return voxel_checksum(self.array.dtype, shape, self.array)
        return str(getattr(self.array, "name", "")) or repr(self.array)


@dataclass(frozen=True, eq=False)
class _Mapped:
    """A memory map of NumPy: only its place in the file is sent to other processes."""

    path: str
    dtype: np.dtype[Any]
    shape: tuple[int, ...]
    offset: int
    order: Any
    chunks: None = None

    def read(self, part: VoxelSlices) -> NDArray[Any]:
        with unpacking(Path(self.path)):
            return np.array(np.memmap(self.path, self.dtype, "r", self.offset, self.shape, self.order)[part])

    def identity(self) -> str:
        return f"{_stamp(self.path)} {self.offset} {self.order}"


@dataclass(frozen=True, eq=False)
class _Zarr:
    """One level of a pyramid, or an array of Zarr."""

    level: ome_zarr.Level

    @property
    def shape(self) -> tuple[int, ...]:
        return self.level.grid.shape

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(self.level.array.dtype)

    @property
    def chunks(self) -> tuple[int, ...]:
        return self.level.chunks

    def read(self, part: VoxelSlices) -> NDArray[Any]:
        return self.level.read(part)

    def identity(self) -> str:
        root = getattr(self.level.array.store, "root", None)  # of a store that is a folder
        return f"{self.level.array.store_path} {'' if root is None else _stamps(Path(root) / self.level.array.path)}"


@dataclass(frozen=True, eq=False)
class _Hdf5:
    """A dataset of an HDF5 file."""

    path: str
    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    chunks: tuple[int, ...] | None

    def read(self, part: VoxelSlices) -> NDArray[Any]:
        h5py = optional_package("h5py")
        with unpacking(Path(self.path)), h5py.File(self.path, "r") as file:
            return np.asarray(file[self.name][part])

    def identity(self) -> str:
        return f"{_stamp(self.path)} {self.name}"


@dataclass(frozen=True, eq=False)
class _Tiff:
    """The pages of a TIFF file, of whose strips and tiles only those in the part are unpacked."""

    path: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    chunks: tuple[int, ...]

    @cached_property
    def _pages(self) -> list[tiff_pages.Page]:
        return tiff.list_pages(Path(self.path))

    def __reduce__(self) -> tuple[Any, ...]:
        return _Tiff, (self.path, self.shape, self.dtype, self.chunks)

    def read(self, part: VoxelSlices) -> NDArray[Any]:
        with unpacking(Path(self.path)), Path(self.path).open("rb") as file:
            found = [page.read(file, *part[1:]) for page in self._pages[part[0]]]
            sizes = [len(range(*one.indices(n))) for one, n in zip(part, self.shape, strict=True)]
            return np.array(found, self.dtype).reshape(sizes)

    def identity(self) -> str:
        return _stamp(self.path)


def _stamp(path: str | Path) -> str:
    about = os.stat(path)
    return f"{Path(path).resolve()} {about.st_size} {about.st_mtime_ns}"


def _stamps(folder: Path) -> str:
    """A checksum of the names, sizes and times of all files in a folder: a chunk that is written again is another."""
    if ZarrCopy.containing(folder):  # of an address: it grows as it is read, and its name has the state of the metadata
        return str(folder)
    digest, waiting = hashlib.sha256(), [str(folder)]
    while waiting:
        with os.scandir(waiting.pop()) as entries:
            for entry in sorted(entries, key=lambda one: one.name):
                about = entry.stat(follow_symlinks=False)
                if entry.is_dir(follow_symlinks=False):
                    waiting.append(entry.path)
                else:
                    digest.update(f"{entry.path} {about.st_size} {about.st_mtime_ns} {about.st_ino}\n".encode())
    return digest.hexdigest()


@dataclass(frozen=True, eq=False)
class LargeVolume(AbstractCellOutput):
    """A volume whose voxels are read in parts; :func:`open_volume` makes it.

    Parameters
    ----------
    reader : reads the voxels.
    grid : of the voxels.
    name : shown to people.
    is_labels : voxels are names of regions.
    notes : remarks.
    levels : the grids of all resolutions of a pyramid, the finest first.
    path : of the file; None for an array.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from deformnb.io import write_volume
    >>> from deformnb.volume.volume import Volume
    >>> file = Path(tempfile.mkdtemp()) / "small.nrrd"
    >>> write_volume(Volume.from_array(np.zeros((2, 3, 4), np.uint8)), file)
    >>> open_volume(file).grid.shape
    (2, 3, 4)
    """

    reader: VoxelReader
    grid: Grid
    name: str = ""
    is_labels: bool = False
    notes: tuple[str, ...] = ()
    levels: tuple[Grid, ...] = ()
    path: Path | None = None

    def __post_init__(self) -> None:
        if tuple(self.reader.shape) != self.grid.shape:
            raise DeformError(f"the array has shape {self.reader.shape} but the grid has {self.grid.shape}.")
        if self.dtype.name not in DTYPES:
            raise DeformError(f"voxels of type {self.reader.dtype} cannot be deformed; use one of {', '.join(DTYPES)}.")

    def __repr__(self) -> str:
        nz, ny, nx = self.shape
        return f"<LargeVolume{f' {self.name[:60]!r}' if self.name else ''}: {nx} x {ny} x {nz} voxels, {self.dtype}>"

    @property
    def shape(self) -> tuple[int, int, int]:
        """(nz, ny, nx)."""
        return self.grid.shape

    @property
    def unit(self) -> str:
        """The unit of lengths, that of the grid; "" if it is not known."""
        return self.grid.unit

    @property
    def finest_grid(self) -> Grid:
        """The grid on which deformations are stated: of the finest level of a pyramid, or else the volume's own."""
        return self.levels[0] if self.grid in self.levels else self.grid

    @property
    def dtype(self) -> np.dtype[Any]:
        """The type of the voxels when they are read."""
        stored = np.dtype(self.reader.dtype).newbyteorder("=")
        return np.dtype(_CAST.get(stored.name, stored))

    @property
    def discrete(self) -> bool:
        """True if no value may be interpolated between two others."""
        return self.is_labels or self.dtype == np.bool_

    def read(self, part: VoxelSlices) -> NDArray[Any]:
        """Voxels of a part, in :attr:`dtype`.

        Raises
        ------
        DeformError
            If the type has to change and a value would.
        """
        found = self.reader.read(part)
        if found.dtype == self.dtype:
            return found
        native = found.astype(self.dtype)
        if found.dtype.kind in "iu" and not (native == found).all():
            raise DeformError(
                f"voxels of type {found.dtype} hold values beyond those of {self.dtype}; cast them: array.astype(...)."
            )
        return native

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        """All voxels, for ``np.asarray``, as :meth:`to_volume` reads them."""
        return np.asarray(self.to_volume().values, dtype=dtype)

    def to_volume(self, *, max_bytes: int | None = None) -> Volume:
        """All voxels as a :class:`Volume`; refused where they take more than 60 % of the free memory."""
        needed, limit = self.grid.size * self.dtype.itemsize, default_limit() if max_bytes is None else max_bytes
        if needed > limit:
            raise DeformError(
                f"this volume takes {needed} bytes of memory and {limit} are allowed; read a coarser "
                "level: read_volume(path, level=...)."
            )
        return Volume(self.read((slice(None),) * 3), self.grid, self.name, self.is_labels, self.notes)

    def smallest(self, progress: Progress | None = None) -> float:
        """The smallest finite value: the background outside a volume. The whole source is read, or until a zero of a
        type without negative values is found.
        """
        depth = max(1, _SLAB_BYTES // (self.shape[1] * self.shape[2] * self.dtype.itemsize))
        rows = self.shape[1] if depth > 1 else max(1, _SLAB_BYTES // (self.shape[2] * self.dtype.itemsize))
        parts = [
            (slice(z, z + depth), slice(y, y + rows), slice(None))
            for z in range(0, self.shape[0], depth)
            for y in range(0, self.shape[1], rows)
        ]
        lowest = np.inf
        for k, part in enumerate(parts):
            values = self.read(part)
            finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values
            lowest = min(lowest, float(finite.min())) if finite.size else lowest
            if lowest == 0 and self.dtype.kind in "bu":
                break
            if progress is not None:
                progress((k + 1) / len(parts))
        return lowest if np.isfinite(lowest) else 0.0

    @cached_property
    def fingerprint(self) -> str:
        """:meth:`current_fingerprint` when it was first requested."""
        return self.current_fingerprint()

    def current_fingerprint(self) -> str:
        """A checksum by which a changed source is known: times and sizes of its files, and samples of its voxels; of an
        array in memory all voxels.
        """
        digest = hashlib.sha256(f"{self.reader.identity()} {self.grid!r} {self.dtype} {self.is_labels}".encode())
        for at in product(*(sorted({int(k) for k in np.linspace(0, n - 1, _SAMPLES)}) for n in self.shape)):
            z, y, x = (slice(k, k + 1) for k in at)
            digest.update(np.ascontiguousarray(self.reader.read((z, y, x))).tobytes())
        return digest.hexdigest()


class ChunkCache:
    """Cache of recently unpacked chunks of a source. Blocks of a result read overlapping regions, so that each chunk
    would be unpacked many times. May be read from several threads; another process begins with an empty one.

    Parameters
    ----------
    source : the volume to read.
    limit : maximum bytes of the cached chunks.

    Examples
    --------
    >>> cache = ChunkCache(open_volume(np.arange(8).reshape(2, 2, 2)), 1000)
    >>> out = np.empty((1, 2, 2), np.int32)
    >>> cache.read_into((slice(1, 2), slice(0, 2), slice(0, 2)), out)
    >>> out.tolist()
    [[[4, 5], [6, 7]]]
    """

    def __init__(self, source: LargeVolume, limit: int) -> None:
        self.source, self.limit = source, limit
        self._kept: OrderedDict[tuple[int, ...], tuple[Future[NDArray[Any]], int]] = OrderedDict()
        self._bytes, self._lock = 0, threading.Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        return ChunkCache, (self.source, self.limit)

    @property
    def bytes(self) -> int:
        """Bytes of the cached chunks."""
        return self._bytes

    def read_into(self, part: VoxelSlices, out: NDArray[Any]) -> None:
        """Copy the voxels of a part into an array of its shape."""
        chunks = self.source.reader.chunks
        if chunks is None:
            out[...] = self.source.read(part)
            return
        numbers = [range(s.start // n, -(-s.stop // n)) for s, n in zip(part, chunks, strict=True)]
        if math.prod(len(some) * n for some, n in zip(numbers, chunks, strict=True)) * out.itemsize > self.limit:
            out[...] = self.source.read(part)
            return
        for number in product(*numbers):
            whole = [
                slice(k * n, min((k + 1) * n, end)) for k, n, end in zip(number, chunks, self.source.shape, strict=True)
            ]
            both = [(max(a.start, b.start), min(a.stop, b.stop)) for a, b in zip(part, whole, strict=True)]
            out[tuple(slice(a - s.start, b - s.start) for (a, b), s in zip(both, part, strict=True))] = self._chunk(
                number, (whole[0], whole[1], whole[2])
            )[tuple(slice(a - s.start, b - s.start) for (a, b), s in zip(both, whole, strict=True))]

    def _chunk(self, number: tuple[int, ...], whole: VoxelSlices) -> NDArray[Any]:
        """A chunk; one thread unpacks it, and others that need it at the same time wait for that."""
        with self._lock:
            found = self._kept.pop(number, None)
            mine, size = found or (Future(), math.prod(s.stop - s.start for s in whole) * self.source.dtype.itemsize)
            self._kept[number] = mine, size  # the one used last is at the end
            if found is None:
                self._bytes += size
                while self._bytes > self.limit:
                    self._bytes -= self._kept.popitem(last=False)[1][1]
        if found is None:
            try:
                mine.set_result(self.source.read(whole))
            except BaseException as error:
                with self._lock:
                    self._bytes -= self._kept.pop(number, (mine, 0))[1]
                mine.set_exception(error)
                raise
        return mine.result()


def open_volume(
    source: Any,
    *,
    grid: Grid | None = None,
    spacing: Spacing | None = None,
    name: str | None = None,
    is_labels: bool | None = None,
    level: int = 0,
    unit: str | None = None,
) -> LargeVolume:
    """A volume that is read in parts.

    Parameters
    ----------
    source : a :class:`Volume`; an array [z, y, x] of NumPy (memory maps included), dask, Zarr or h5py; or a path: a
        folder of Zarr or OME-Zarr, ``.h5``/``.hdf5`` (with "file.h5::dataset" where there are several), ``.tif``,
        ``.npy``, or any file that :func:`deformnb.read_volume` reads, which is then loaded; or the address (https, s3
        and others) of one, of which a folder of Zarr is copied as far as it is read, and another file as a whole.
    grid : of the voxels, instead of the one that the source states; arrays have spacing 1 without it.
    spacing : (x, y, z), instead of the source's.
    name : shown to people.
    is_labels : voxels are names of regions; by default as the source states.
    level : of a pyramid, 0 for the finest.
    unit : of lengths, where the source does not state it; its numbers are not converted.

    Raises
    ------
    DeformError
        If the source is none of these, damaged, or has other axes than z, y, x.

    Examples
    --------
    >>> open_volume(np.zeros((4, 5, 6), np.uint8), spacing=(1, 1, 2)).grid.spacing
    (1.0, 1.0, 2.0)
    """
    found = _open(source, level)
    if grid is not None or spacing is not None:
        found = replace(found, notes=tuple(note for note in found.notes if note != NO_PLACE))
    if grid is not None:
        found = replace(found, grid=grid)
    if spacing is not None:
        found = replace(found, grid=replace(found.grid, spacing=as_spacing(spacing)))
    if unit is not None:
        found = replace(
            found, grid=replace(found.grid, unit=unit), levels=tuple(replace(one, unit=unit) for one in found.levels)
        )
    if is_labels is not None:
        found = replace(found, is_labels=is_labels)
    return found if name is None else replace(found, name=name)


def _open(source: Any, level: int) -> LargeVolume:
    if isinstance(source, LargeVolume):
        return source
    if isinstance(source, str | os.PathLike):
        return _from_path(str(source), level)
    if level != 0:
        raise DeformError(f"an object in memory is no pyramid, so it has no level {short_value(level)}.")
    if is_labelled(source):
        return _from_labelled(source)
    if isinstance(source, Volume) or states_place(source):
        volume = as_volume(source)
        return LargeVolume(_reader_of(volume.values), volume.grid, volume.name, volume.is_labels, notes=volume.notes)
    shape, dtype = getattr(source, "shape", None), getattr(source, "dtype", None)
    if shape is None or dtype is None or len(shape) != 3:
        raise DeformError(f"a source is a volume, an array [z, y, x] or a path, got {short_value(source)}.")
    grid = Grid((int(shape[0]), int(shape[1]), int(shape[2])))
    return LargeVolume(_reader_of(source), grid, is_labels=np.dtype(dtype) == np.bool_, notes=(NO_PLACE,))


def _from_labelled(given: Any) -> LargeVolume:
    """The volume of an array of xarray, which may be chunked."""
    array = one_array(given)
    axes = LabelledAxes.of(array)
    more = [dim for dim in axes.others if array.sizes[dim] > 1]
    if more:
        raise DeformError(
            f"a volume has the dimensions z, y and x and this array has {', '.join(map(str, more))} too; "
            f"pick one: array.isel({more[0]}=0)."
        )
    values = array.transpose(*axes.others, *axes.spatial).data.reshape(axes.grid.shape)
    return LargeVolume(
        _reader_of(values), axes.grid, str(array.name or ""), values.dtype == np.bool_, notes=axes.notes(array)
    )


def _reader_of(array: Any) -> VoxelReader:
    if (
        isinstance(array, np.memmap)
        and array.filename is not None
        and (array.flags.c_contiguous or array.flags.f_contiguous)
        and _is_whole_map(array)
    ):
        return _Mapped(
            os.fspath(array.filename),
            array.dtype,
            array.shape,
            int(array.offset),
            "C" if array.flags.c_contiguous else "F",
        )
    kind = type(array).__module__.partition(".")[0]
    if kind == "zarr":
        grid = Grid((int(array.shape[0]), int(array.shape[1]), int(array.shape[2])))
        return _Zarr(ome_zarr.Level(array, ("z", "y", "x"), grid))
    if kind == "h5py":
        return _Hdf5(array.file.filename, array.name, tuple(array.shape), np.dtype(array.dtype), array.chunks)
    return _Array(array)


def _is_whole_map(array: np.memmap[Any, Any]) -> bool:
    import mmap

    return isinstance(array.base, mmap.mmap)


def is_partly_readable(path: Path) -> bool:
    """Check whether a file or folder is of a kind of which parts can be read; any other is loaded as a whole."""
    return ome_zarr.is_zarr(path) or path.name.lower().endswith((*HDF5, *_TIFF, ".npy"))


def _from_path(text: str, level: int) -> LargeVolume:
    address = address_of(text)
    is_chain = bool(address) and address.partition(":")[0] not in ("http", "https", "file")  # "zip://in.h5::all.zip"
    file, _, dataset = (text, "", "") if is_chain else text.partition("::")
    path = input_path(file)
    lower = path.name.lower()
    if ome_zarr.is_zarr(path):
        return _from_zarr(path, level)
    if level != 0:
        raise fail(path, f"it is no pyramid, so it has no level {level}.")
    with unpacking(path), Damage(path, "name a smaller file"):
        if lower.endswith(HDF5):
            return _from_hdf5(regular_file(path), dataset)
        if lower.endswith(_TIFF):
            return _from_tiff(regular_file(path))
        if lower.endswith(".npy"):
            return _from_npy(regular_file(path))
    from deformnb.io.volumes.formats import read_volume

    volume = read_volume(path)
    return replace(_open(volume, 0), path=path)


def _from_zarr(path: Path, level: int) -> LargeVolume:
    pyramid = ome_zarr.open_pyramid(path)
    if not 0 <= level < len(pyramid.levels):
        raise fail(path, f"it has the levels 0 to {len(pyramid.levels) - 1}, got {short_value(level)}.")
    if not pyramid.layout.is_single:
        raise fail(
            path,
            f"a volume is one channel at one moment, and this pyramid holds {pyramid.layout}; give "
            "deformnb.chunked one of them as a dask array.",
        )
    chosen = pyramid.levels[level]
    _check_chunk(path, chosen.chunk_bytes)
    name = path.name[: -len(ome_zarr.ZARR_SUFFIX)] if path.name.endswith(ome_zarr.ZARR_SUFFIX) else path.name
    labels = chosen.array.dtype == np.bool_ if pyramid.is_labels is None else pyramid.is_labels
    return LargeVolume(
        _Zarr(chosen), chosen.grid, name, bool(labels), pyramid.notes, tuple(one.grid for one in pyramid.levels), path
    )


def _check_chunk(path: Path, size: int) -> None:
    if size > default_limit():
        raise fail(path, f"one of its chunks takes {size} bytes when it is unpacked, more than there is memory for.")


def _from_hdf5(path: Path, name: str) -> LargeVolume:
    h5py = optional_package("h5py")
    with h5py.File(path, "r") as file:
        found: list[str] = []
        file.visititems(
            lambda key, item: (
                found.append(key) if isinstance(item, h5py.Dataset) and len(item.shape or ()) == 3 else None
            )
        )
        if not name and len(found) != 1:
            raise fail(
                path,
                f"it has {len(found)} arrays of three axes ({printable(', '.join(found[:8]))}); name one: "
                f'"{printable(path.name)}::name".',
            )
        item = file.get(name or found[0], getlink=True)
        if not isinstance(item, h5py.HardLink):
            raise fail(path, f"{printable(name)} is a link to elsewhere or is not there.")
        item = file[name or found[0]]
        if not isinstance(item, h5py.Dataset) or len(item.shape or ()) != 3 or item.external or item.is_virtual:
            raise fail(path, f"{printable(name or found[0])} is no array of three axes in this file.")
        if item.dtype.kind not in "biuf":
            raise fail(path, f"voxels of type {item.dtype} are no numbers that can be deformed.")
        shape, _ = volume_shape(path, [int(n) for n in item.shape[::-1]], item.dtype.itemsize)
        _check_chunk(path, math.prod(item.chunks or (1,)) * item.dtype.itemsize)
        grid, notes = _hdf5_grid(path, item, shape)
        return LargeVolume(
            _Hdf5(str(path), item.name, shape, item.dtype, item.chunks), grid, path.stem, notes=notes, path=path
        )


def _hdf5_grid(path: Path, item: Any, shape: tuple[int, int, int]) -> tuple[Grid, tuple[str, ...]]:
    """The grid of a dataset, with the attribute that ImageJ's and ilastik's HDF5 files have: element_size_um."""
    if "element_size_um" not in item.attrs:
        return Grid(shape), ("the file states no element_size_um: spacing 1 was taken along each axis",)
    sizes = np.asarray(item.attrs["element_size_um"])
    if sizes.shape != (3,) or sizes.dtype.kind not in "iuf":
        raise fail(path, f"its element_size_um should be three numbers along z, y and x but is {printable(sizes, 60)}.")
    return Grid(shape, (float(sizes[2]), float(sizes[1]), float(sizes[0])), unit="\u00b5m"), ()


def _from_tiff(path: Path) -> LargeVolume:
    about = describe_file(path)
    header = tiff.read_header(path)
    if not header.layout.is_single:
        raise fail(
            path,
            f"a volume is one channel at one moment, and this file holds {header.layout}; give "
            "deformnb.chunked one of them as a dask array.",
        )
    stored, first = header.dtype.newbyteorder("="), tiff.list_pages(path)[0]
    chunks = (1, *(min(size, n) for size, n in zip(first.part, first.shape, strict=True)))
    _check_chunk(path, first.working_bytes)
    return LargeVolume(
        _Tiff(str(path), about.grid.shape, stored, chunks),
        about.grid,
        path.stem,
        about.is_labels,
        about.notes,
        path=path,
    )


def _from_npy(path: Path) -> LargeVolume:
    about = describe_file(path)
    array: Any = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.shape != about.grid.shape:
        raise fail(path, f"its array has shape {array.shape}, and its header says {about.grid.shape}.")
    return LargeVolume(_reader_of(array), about.grid, path.stem, about.is_labels, about.notes, path=path)

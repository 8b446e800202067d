"""OME-Zarr: a volume as a pyramid of arrays of chunks in a folder, versions 0.4 (Zarr 2) and 0.5 (Zarr 3).

Specification: https://ngff.openmicroscopy.org/0.5/. zarr-python reads and writes the arrays. The metadata of a pyramid
are a page of JSON, which is written and checked here: a job may write its levels block by block, and a reader must know
all sizes before it takes memory.

The format places axes by scale and translation only and knows no directions. Those of a grid whose axes are oblique are
kept in attributes of our own ("deformnb"); other programs then see the volume along its own axes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.errors import DeformError, MissingPackageError
from deformnb.io.atomic import atomic_folder
from deformnb.io.headers import HEADER_BYTES, Header, fail, shown, unpacking, volume_shape
from deformnb.volume.volume import IDENTITY, Grid, Volume, voxel_checksum

if TYPE_CHECKING:
    import zarr

SUFFIX = ".zarr"

VERSIONS = {"0.5": 3, "0.4": 2}
"""Versions of OME-Zarr that are written, the usual one first, and the version of Zarr that each one has."""

# Levels are halved until the longest side is this long: a view of the whole that opens at once.
_SMALLEST = 256
_MOST_LEVELS = 32

# Bytes of the finest level up to which its voxels, and not those of the coarsest level, identify a pyramid.
_MOST_CHECKED = 2**32

# Voxels along each axis of a chunk: 2^20 in all, the block that one call of the warp computes.
CHUNK = (64, 128, 128)

# zarr-python decodes up to this many chunks at once (its setting async.concurrency).
_AT_ONCE = 10

MARKS = ("zarr.json", ".zgroup", ".zarray")
"""Files of which each folder of Zarr has one."""

_META_FILES = ("zarr.json", ".zattrs", ".zgroup", ".zarray", ".zmetadata")


def zarr_package() -> Any:
    """The package zarr, imported now.

    Raises
    ------
    MissingPackageError
        Naming the extra that brings it.
    """
    try:
        import zarr
    except ImportError as error:
        raise MissingPackageError('Zarr needs the package zarr, which is not installed: pip install '
                                  '"deformnb[large]"') from error
    return zarr


def is_zarr(path: Path) -> bool:
    """Check whether a folder is one of Zarr's."""
    return path.is_dir() and any((path / name).is_file() for name in MARKS)


# -- reading ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Level:
    """One resolution of a pyramid: a Zarr array, the index of its three axes z, y, x in it, and their grid."""

    array: Any
    index: tuple[Any, ...]
    grid: Grid

    @property
    def chunk_bytes(self) -> int:
        """Bytes of one chunk when it is unpacked; of one shard where chunks lie in shards."""
        chunk = getattr(self.array, "shards", None) or self.array.chunks
        return math.prod(chunk) * self.array.dtype.itemsize

    def read(self, part: tuple[slice, slice, slice]) -> NDArray[Any]:
        """Voxels of a part [z, y, x]."""
        given = iter(part)
        at = [next(given) if isinstance(one, slice) else one for one in self.index]
        with unpacking(self.path):
            found = np.asarray(self.array[tuple(at)])
        return found if found.ndim == 3 else found[None]

    @property
    def path(self) -> Path:
        """The folder of the array, or its name in a store that is no folder."""
        return Path(getattr(self.array.store, "root", "")) / self.array.path


@dataclass(frozen=True, eq=False)
class Pyramid:
    """A volume in several resolutions, the finest first."""

    levels: tuple[Level, ...]
    is_labels: bool | None
    unit: str
    notes: tuple[str, ...] = ()


def open_pyramid(path: Path) -> Pyramid:
    """The pyramid in a folder, or its one array; only metadata are read.

    Raises
    ------
    VolumeFileError
        If it is none, or its metadata are damaged, too long, or of something else than one volume.
    MissingPackageError
        If zarr is not installed.
    """
    zarr = zarr_package()
    _check_metadata(path)
    try:
        node = zarr.open(store=str(path), mode="r")
        if isinstance(node, zarr.Array):
            return Pyramid((_level(path, node, node.ndim * ["?"], None, None, {}),), None, "",
                           ("a Zarr array without the metadata of OME-Zarr has no spacing: 1 along each axis",))
        return _of_group(path, node)
    except (DeformError, MemoryError):
        raise
    except Exception as error:  # a parser of others: damaged metadata raise anything
        raise fail(path, f"it cannot be read as Zarr: {shown(error)}.") from error


def checksum(path: Path) -> str:
    """The checksum of a pyramid by which documents know it, whichever level they were made on.

    It is that of the voxels of the finest level, as of any other volume; where these take more than 4 GiB, which would
    be read for minutes, that of the coarsest level.

    Raises
    ------
    VolumeFileError
        If it cannot be read (any more).
    """
    levels = open_pyramid(path).levels
    level = levels[0 if levels[0].grid.size * levels[0].array.dtype.itemsize <= _MOST_CHECKED else -1]
    depth = level.array.chunks[-3] if level.array.ndim > 2 else 1
    starts = range(0, level.grid.shape[0], depth)
    return voxel_checksum(level.array.dtype, level.grid.shape, (
        level.read((slice(start, start + depth), slice(None), slice(None))) for start in starts))


def _check_metadata(path: Path) -> None:
    """Refuse metadata that are longer than any real ones, of the group and of what lies directly in it."""
    folders = [path, *(entry for entry in path.iterdir() if entry.is_dir())]
    for file in (folder / name for folder in folders for name in _META_FILES):
        if file.is_file() and file.stat().st_size > HEADER_BYTES:
            raise fail(path, f"its metadata {shown(file.name)} are longer than {HEADER_BYTES} bytes.")


def _of_group(path: Path, group: zarr.Group) -> Pyramid:
    attributes = dict(group.attrs)
    ome = _mapping(path, attributes.get("ome", attributes), "its metadata")
    scales = ome.get("multiscales")
    if not isinstance(scales, list) or not scales:
        raise fail(path, "this Zarr group has no multiscales and so is no OME-Zarr image; name one of its arrays.")
    about = _mapping(path, scales[0], "multiscales[0]")
    axes = about.get("axes", [{"name": name} for name in "tczyx"])
    if not isinstance(axes, list) or not 2 <= len(axes) <= 5:
        raise fail(path, f"its axes should be 2 to 5, got {shown(axes)}.")
    names = [str(axis.get("name")) if isinstance(axis, dict) else str(axis) for axis in axes]
    units = {str(axis["unit"]) for axis in axes if isinstance(axis, dict) and axis.get("type") == "space"
             and isinstance(axis.get("unit"), str)}
    if len(units) > 1:
        raise fail(path, f"its axes have different units ({shown(', '.join(sorted(units)))}).")
    datasets = about.get("datasets")
    if not isinstance(datasets, list) or not 1 <= len(datasets) <= _MOST_LEVELS:
        raise fail(path, f"its datasets should be 1 to {_MOST_LEVELS} arrays.")
    levels = []
    for k, entry in enumerate(datasets):
        dataset = _mapping(path, entry, f"datasets[{k}]")
        array = _array(path, group, dataset.get("path"))
        levels.append(_level(path, array, names, about, dataset, attributes))
    sizes = [level.grid.size for level in levels]
    if sorted(sizes, reverse=True) != sizes or len({level.array.dtype for level in levels}) > 1:
        raise fail(path, "its levels do not go from fine to coarse with voxels of one type.")
    unit = next(iter(units), "")
    notes = () if unit in ("", "millimeter") else (f"lengths are in units of {shown(unit)}",)
    labels: bool | None = "image-label" in ome or "image-label" in attributes
    if not labels and about.get("type") != "mean":  # coarser levels that are means are of amounts
        labels = None
    return Pyramid(tuple(levels), labels, unit, notes)


def _mapping(path: Path, value: Any, what: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise fail(path, f"{what} should be an object of JSON, got {shown(value)}.")
    return value


def _array(path: Path, group: zarr.Group, name: Any) -> zarr.Array[Any]:
    parts = name.split("/") if isinstance(name, str) else [".."]
    if any(part in ("", ".", "..") or "\\" in part or ":" in part for part in parts):
        raise fail(path, f"its dataset {shown(name)} is not in its own folder, so it is not read.")
    try:
        inside = path.joinpath(*parts).resolve().is_relative_to(path.resolve())
    except (OSError, ValueError):
        inside = False
    if not inside:
        raise fail(path, f"its dataset {shown(name)} is a link out of its own folder; it is not read.")
    zarr = zarr_package()
    _check_metadata(path.joinpath(*parts).parent)
    array = group[name]
    if not isinstance(array, zarr.Array):
        raise fail(path, f"its dataset {shown(name)} is no array.")
    return array


def _level(path: Path, array: zarr.Array[Any], names: list[str], about: Mapping[str, Any] | None,
           dataset: Mapping[str, Any] | None, attributes: Mapping[str, Any]) -> Level:
    if array.ndim != len(names):
        raise fail(path, f"its array {shown(array.path)} has {array.ndim} axes and its metadata name {len(names)}.")
    dtype = array.dtype
    if dtype.kind not in "biuf":
        raise fail(path, f"voxels of type {dtype} are no numbers that can be deformed.")
    space = names[-3:] if names[-3:-2] in (["z"], ["?"]) else names[-2:]
    if space not in (["z", "y", "x"], ["y", "x"], ["?", "?", "?"], ["?", "?"]):
        raise fail(path, f"its last axes should be z, y, x; they are {shown(', '.join(names))}.")
    others = array.shape[:array.ndim - len(space)]
    if any(n != 1 for n in others):
        axes = ", ".join(f"{shown(name)}: {n}" for name, n in zip(names, others, strict=False))
        raise fail(path, f"a volume has three axes but this pyramid has more ({axes}); give deformnb.chunked one time "
                         "point or channel as a dask array.")
    shape, _ = volume_shape(path, list(array.shape[::-1][:len(space)]), dtype.itemsize)
    scale, shift = np.ones(len(names)), np.zeros(len(names))
    for part in (dataset, about):
        for one in (part or {}).get("coordinateTransformations") or []:
            scale, shift = _transformed(path, _mapping(path, one, "a transformation"), scale, shift)
    spacing, origin = (np.ones(3), np.zeros(3))
    spacing[3 - len(space):], origin[3 - len(space):] = scale[-len(space):], shift[-len(space):]
    index = (*(0 for _ in others), *(slice(None) for _ in space))
    own = attributes.get("deformnb")
    direction: Any = own.get("direction", IDENTITY) if isinstance(own, Mapping) else IDENTITY
    try:
        frame = Grid((1, 1, 1), direction=direction)
        place = np.asarray(frame.direction) @ origin[::-1]
        grid = Grid(shape, tuple(spacing[::-1]), tuple(place), frame.direction)
    except (DeformError, TypeError, ValueError) as error:
        raise fail(path, f"its coordinates are unusable: {shown(error, 200)}") from error
    return Level(array, index, grid)


def _transformed(path: Path, one: Mapping[str, Any], scale: NDArray[np.float64],
                 shift: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    kind = one.get("type")
    if kind == "identity":
        return scale, shift
    if kind not in ("scale", "translation"):
        raise fail(path, f"its coordinate transformation {shown(kind)} is not supported; scale and translation are.")
    numbers = one.get(kind)
    if not isinstance(numbers, list) or len(numbers) != len(scale) or not all(
            isinstance(n, int | float) and not isinstance(n, bool) and abs(n) < 1e300 for n in numbers):
        raise fail(path, f"its {kind} should be {len(scale)} numbers, got {shown(numbers)}.")
    given = np.array(numbers, dtype=np.float64)
    return (scale * given, shift * given) if kind == "scale" else (scale, shift + given)


def read_header(path: Path) -> Header:
    """The header of the finest level, with those of the coarser ones; see :func:`deformnb.io.formats.read_volume`."""
    pyramid = open_pyramid(path)
    headers = [_header(path, level, pyramid) for level in pyramid.levels]
    return replace(headers[0], levels=tuple(headers))


def _header(path: Path, level: Level, pyramid: Pyramid) -> Header:
    shape, dtype = level.grid.shape, np.dtype(level.array.dtype)
    depth = level.array.chunks[-3] if level.array.ndim > 2 else 1
    depth = max(1, min(depth, shape[0]))
    slab = depth * shape[1] * shape[2] * dtype.itemsize

    def blocks() -> Iterator[NDArray[Any]]:
        for start in range(0, shape[0], depth):
            yield level.read((slice(start, min(start + depth, shape[0])), slice(None), slice(None)))

    return Header(path, shape, dtype, blocks, level.grid.spacing, level.grid.origin, level.grid.direction,
                  is_labels=pyramid.is_labels, notes=pyramid.notes,
                  working_bytes=slab + (_AT_ONCE + 1) * level.chunk_bytes)


# -- writing ---------------------------------------------------------------------------------------------------------


def coarser(grid: Grid) -> Grid:
    """The grid of the next level: cells of 2 x 2 x 2 voxels, from the first voxel on; an axis of one voxel stays.

    Examples
    --------
    >>> coarser(Grid((4, 5, 1), (1.0, 1.0, 3.0))).shape
    (2, 3, 1)
    """
    whole = np.array(grid.shape[::-1]) > 1
    spacing = np.where(whole, 2.0, 1.0) * grid.spacing
    origin = grid.index_to_point(np.where(whole, 0.5, 0.0))
    nz, ny, nx = (-(-n // 2) for n in grid.shape)
    return Grid((nz, ny, nx), tuple(spacing), tuple(origin), grid.direction)


def level_grids(grid: Grid, levels: int | None = None) -> list[Grid]:
    """The grids of a pyramid, the finest first: so many, or until the longest side is at most 256 voxels."""
    found = [grid]
    while len(found) < (levels or _MOST_LEVELS) and max(found[-1].shape) > (1 if levels else _SMALLEST):
        found.append(coarser(found[-1]))
    return found


def halved(values: NDArray[Any], *, discrete: bool) -> NDArray[Any]:
    """Voxels [z, y, x] of the next level: the mean of each cell, whole numbers rounded, halves up; of labels the mode.

    A cell at an odd end has fewer voxels. Of labels that are equally frequent in a cell the first in memory is taken.

    Examples
    --------
    >>> halved(np.array([[[1, 2], [4, 4]]], np.uint8), discrete=False).tolist()
    [[[3]]]
    >>> halved(np.array([[[7, 2], [2, 9]]], np.uint8), discrete=True).tolist()
    [[[2]]]
    """
    padded = np.pad(values, [(0, n % 2 if n > 1 else 0) for n in values.shape], mode="edge")
    cells: list[NDArray[Any]] = [padded]
    for axis, n in enumerate(values.shape):
        if n > 1:
            cells = [cell[(slice(None),) * axis + (slice(k, None, 2),)] for cell in cells for k in (0, 1)]
    if not discrete:
        total = np.zeros(cells[0].shape, np.float64)
        for cell in cells:
            total += cell
        mean = total / len(cells)
        return (np.floor(mean + 0.5) if values.dtype.kind in "iu" else mean).astype(values.dtype)
    best, most = cells[0], np.zeros(cells[0].shape, np.int8)
    for cell in cells:
        count = np.zeros(cells[0].shape, np.int8)
        for other in cells:
            count += cell == other
        best, most = np.where(count > most, cell, best), np.maximum(count, most)
    return best


def create_pyramid(path: Path, grids: list[Grid], dtype: np.dtype[Any], *, name: str = "", is_labels: bool = False,
                   fill: Any = 0, chunks: tuple[int, int, int] = CHUNK, version: str = "0.5",
                   unit: str = "millimeter") -> list[Any]:
    """An empty pyramid in a new folder; returns its Zarr arrays, the finest first.

    Parameters
    ----------
    grids : of the levels; see :func:`level_grids`.
    fill : value of voxels that are never written.
    version : a name of :data:`VERSIONS`.
    """
    zarr = zarr_package()
    if version not in VERSIONS:
        raise DeformError(f"unknown version {shown(version)} of OME-Zarr; choose one of {', '.join(VERSIONS)}.")
    about = _metadata(grids, name, is_labels, unit)
    attributes: dict[str, Any]
    if version == "0.5":
        label = {"image-label": {"version": "0.5"}} if is_labels else {}
        attributes = {"ome": {"version": "0.5", "multiscales": [about], **label}}
    else:
        label = {"image-label": {"version": "0.4"}} if is_labels else {}
        attributes = {"multiscales": [{"version": "0.4", **about}], **label}
    if grids[0].direction != IDENTITY:
        attributes["deformnb"] = {"direction": [list(row) for row in grids[0].direction]}
    group = zarr.create_group(store=str(path), zarr_format=VERSIONS[version], attributes=attributes)
    options: dict[str, Any] = {"chunk_key_encoding": {"name": "v2", "separator": "/"}}
    if version == "0.5":
        options = {"dimension_names": ("z", "y", "x")}
    return [group.create_array(str(k), shape=grid.shape, dtype=dtype, fill_value=fill, chunks=tuple(
        min(c, n) for c, n in zip(chunks, grid.shape, strict=True)), **options) for k, grid in enumerate(grids)]


def _metadata(grids: list[Grid], name: str, is_labels: bool, unit: str) -> dict[str, Any]:
    axes = [{"name": axis, "type": "space", **({"unit": unit} if unit else {})} for axis in "zyx"]
    datasets = []
    for k, grid in enumerate(grids):
        place = np.asarray(grid.direction).T @ np.asarray(grid.origin)  # along the grid's own axes
        datasets.append({"path": str(k), "coordinateTransformations": [
            {"type": "scale", "scale": list(grid.spacing[::-1])},
            {"type": "translation", "translation": place[::-1].tolist()}]})
    return {"name": name, "axes": axes, "datasets": datasets, "type": "mode" if is_labels else "mean"}


def write(volume: Volume, path: Path, overwrite: bool, progress: Progress | None) -> None:
    """Write a volume and its coarser levels."""
    grids, discrete = level_grids(volume.grid), volume.is_labels or volume.dtype == np.bool_
    with atomic_folder(path, overwrite=overwrite, folder_marks=MARKS) as folder:
        arrays = create_pyramid(folder, grids, volume.dtype, name=volume.name, is_labels=volume.is_labels)
        total, done = sum(grid.size for grid in grids), 0
        values = np.asarray(volume.values)
        for array, grid in zip(arrays, grids, strict=True):
            values = values if array is arrays[0] else _halved_in_slabs(values, discrete)
            for corner in product(*(range(0, n, size) for n, size in zip(grid.shape, array.chunks, strict=True))):
                part = tuple(slice(start, start + size) for start, size in zip(corner, array.chunks, strict=True))
                array[part] = values[part]
                done += values[part].size
                if progress is not None:
                    progress(done / total)


def _halved_in_slabs(values: NDArray[Any], discrete: bool) -> NDArray[Any]:
    """:func:`halved` with little memory beside the result."""
    return np.concatenate([halved(values[k:k + 16], discrete=discrete) for k in range(0, len(values), 16)])

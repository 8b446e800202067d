"""OME-Zarr: a volume as a pyramid of arrays of chunks in a folder, versions 0.4 (Zarr 2) and 0.5 (Zarr 3).

Specification: https://ngff.openmicroscopy.org/0.5/. zarr-python reads and writes the arrays. The metadata of a pyramid
are a document of JSON, which is written and checked here: a job may write its levels block by block, and a reader must
know all sizes before it takes memory.

The format places axes by scale and translation only and has no directions. Those of a grid whose axes are oblique are
stored in attributes named "deformnb"; other programs then see the volume along its axes.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb._packages import install_command
from deformnb._typing import Progress
from deformnb.errors import DeformError, MissingPackageError
from deformnb.io.files.atomic import atomic_folder
from deformnb.io.files.errors import fail, printable, unpacking
from deformnb.io.files.zarr_copy import MARKS, ZarrCopy
from deformnb.io.volumes.headers import HEADER_BYTES, SINGLE, Geometry, Header, Layout, check_layout, volume_shape
from deformnb.volume.units import UNITS, common_unit, parse_unit
from deformnb.volume.volume import IDENTITY, Grid, Volume, voxel_checksum

if TYPE_CHECKING:
    import zarr

ZARR_SUFFIX = ".zarr"

OmeZarrVersion: TypeAlias = Literal["0.5", "0.4"]
"""Versions of OME-Zarr that are written."""

VERSIONS = {"0.5": 3, "0.4": 2}
"""Versions of OME-Zarr that are written, the usual one first, and the version of Zarr that each one has."""

# Levels are halved until the longest side is this long: an overview that opens immediately.
_SMALLEST = 256
_MOST_LEVELS = 32

# Bytes of the finest level up to which its voxels, and not those of the coarsest level, identify a pyramid.
_MOST_CHECKED = 2**32

# Voxels along each axis of a chunk: 2^20 in all, the block that one call of the warp computes.
CHUNK_SHAPE = (64, 128, 128)

# zarr-python decodes up to this many chunks concurrently (its setting async.concurrency).
_AT_ONCE = 10

# A volume in more chunks than this, each of fewer numbers than that, would be read for hours.
_MOST_SMALL, _SMALL = 2**20, 2**12

# Chunks up to which those that are missing are counted: looking for a million takes seconds.
_MOST_COUNTED = 2**20

_META_FILES = ("zarr.json", ".zattrs", ".zgroup", ".zarray", ".zmetadata")


def zarr_package() -> Any:
    """The package zarr, imported now.

    Raises
    ------
    MissingPackageError
        Naming the extra that installs it.
    """
    try:
        import zarr
    except ImportError as error:
        raise MissingPackageError(
            f"Zarr needs the package zarr, which is not installed: {install_command('large')}"
        ) from error
    return zarr


def is_zarr(path: Path) -> bool:
    """Check whether a folder is one of Zarr's."""
    return path.is_dir() and any((path / name).is_file() for name in MARKS)


# -- reading ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Level:
    """One resolution of a pyramid: a Zarr array, the kinds of its axes, and the grid of a channel at a moment.

    Parameters
    ----------
    index : for each axis of the array "z", "y" or "x", or the place that is read along it.
    others : the names of the axes that are not z, y and x, in their order.
    """

    array: Any
    index: tuple[str | int, ...]
    grid: Grid
    others: tuple[str, ...] = ()

    @property
    def storage_shape(self) -> tuple[int, ...]:
        """Voxels along each axis of the array that are stored together: of a chunk, or of a shard of chunks."""
        return tuple(getattr(self.array, "shards", None) or self.array.chunks)

    @property
    def chunk_bytes(self) -> int:
        """Bytes of one chunk when it is unpacked; of one shard where chunks are in shards."""
        return math.prod(self.storage_shape) * int(self.array.dtype.itemsize)

    @property
    def chunks(self) -> tuple[int, int, int]:
        """Voxels (z, y, x) of a chunk."""
        of = dict(zip(self.index, self.array.chunks, strict=True))
        return int(of.get("z", 1)), int(of["y"]), int(of["x"])

    def read(self, part: tuple[slice, slice, slice]) -> NDArray[Any]:
        """Voxels of a part [z, y, x]."""
        of: dict[str | int, slice] = dict(zip("zyx", part, strict=True))
        with unpacking(self.path):
            found = np.asarray(self.array[tuple(one if isinstance(one, int) else of[one] for one in self.index)])
        axes = [one for one in self.index if not isinstance(one, int)]
        found = found.transpose([axes.index(axis) for axis in "zyx" if axis in axes])
        return found if found.ndim == 3 else found[None][of["z"]]

    def present(self) -> NDArray[np.bool_] | None:
        """Mask of the stored chunks that exist, along z, y and x; None where they are not counted."""
        grid = [-(-n // size) for n, size in zip(self.array.shape, self.storage_shape, strict=True)]
        counted = [1 if isinstance(one, int) else n for one, n in zip(self.index, grid, strict=True)]
        if math.prod(counted) > _MOST_COUNTED or not self.path.is_dir() or ZarrCopy.containing(self.path):
            return None
        found = np.zeros(counted, np.bool_)
        for at in np.ndindex(*counted):
            key = [
                one // size if isinstance(one, int) else k
                for one, size, k in zip(self.index, self.storage_shape, at, strict=True)
            ]
            found[at] = (self.path / self.array.metadata.encode_chunk_key(tuple(key))).exists()
        axes = [k for axis in "zyx" for k, one in enumerate(self.index) if one == axis]
        others = [k for k, one in enumerate(self.index) if isinstance(one, int)]
        found = found.transpose([*others, *axes]).reshape([counted[k] for k in axes])
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
    notes: tuple[str, ...] = ()
    layout: Layout = SINGLE


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
        node = _node(path)
        if isinstance(node, zarr.Array):
            level, layout = _level(path, node, _plain_axes(path, node), None, None, {})
            note = "a Zarr array without the metadata of OME-Zarr has no spacing: 1 along each axis"
            return Pyramid((level,), None, (note,), layout)
        return _from_group(path, node)
    except (DeformError, MemoryError):
        raise
    except Exception as error:  # a parser of others: damaged metadata raise anything
        raise fail(path, f"it cannot be read as Zarr: {printable(error)}.") from error


def _node(path: Path) -> Any:
    """The array or group of a folder, by its own metadata: consolidated copies of them may be old."""
    zarr, store = zarr_package(), _plain_files(path)
    names = {name for name in MARKS if (path / name).is_file()}
    if "zarr.json" in names:
        kind = json.loads((path / "zarr.json").read_bytes()).get("node_type")
    else:
        kind = "array" if ".zarray" in names else "group"
    return (
        zarr.open_array(store, mode="r")
        if kind == "array"
        else zarr.open_group(store, mode="r", use_consolidated=False)
    )


def _plain_files(path: Path) -> Any:
    from deformnb.io.files.zarr_store import PlainFiles

    return PlainFiles(path, read_only=True)


def _plain_axes(path: Path, array: Any) -> list[str]:
    """The names of the axes of an array without the metadata of OME-Zarr: the last ones are z, y, x."""
    if array.ndim < 2:
        raise fail(path, f"a volume has the axes z, y, x, and this array has {array.ndim}.")
    return [*(f"axis {k}" for k in range(array.ndim - 3)), "z", "y", "x"][-array.ndim :]


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
    depth = level.chunks[0]
    starts = range(0, level.grid.shape[0], depth)
    return voxel_checksum(
        level.array.dtype,
        level.grid.shape,
        (level.read((slice(start, start + depth), slice(None), slice(None))) for start in starts),
    )


def _check_metadata(path: Path) -> None:
    """Refuse metadata that are longer than any real ones, of the group and of its direct members."""
    folders = [path, *(entry for entry in path.iterdir() if entry.is_dir())]
    for file in (folder / name for folder in folders for name in _META_FILES):
        if file.is_file() and file.stat().st_size > HEADER_BYTES:
            raise fail(path, f"its metadata {printable(file.name)} are longer than {HEADER_BYTES} bytes.")


def _from_group(path: Path, group: zarr.Group) -> Pyramid:
    attributes = dict(group.attrs)
    ome = _mapping(path, attributes.get("ome", attributes), "its metadata")
    scales = ome.get("multiscales")
    if not isinstance(scales, list) or not scales:
        return _from_image_set(path, group, ome)
    about = _mapping(path, scales[0], "multiscales[0]")
    notes: tuple[str, ...] = (f"of its {len(scales)} multiscale images the first was read",) if len(scales) > 1 else ()
    axes = _axes(path, about, str(about.get("version", ome.get("version", ""))))
    names = [str(axis["name"]) for axis in axes]
    unit, factors, more = _unit(axes)
    notes += more
    datasets = about.get("datasets")
    if not isinstance(datasets, list) or not 1 <= len(datasets) <= _MOST_LEVELS:
        raise fail(path, f"its datasets should be 1 to {_MOST_LEVELS} arrays.")
    levels, layouts = [], []
    for k, entry in enumerate(datasets):
        dataset = _mapping(path, entry, f"datasets[{k}]")
        array = _array(path, group, dataset.get("path"))
        level, layout = _level(path, array, names, about, dataset, attributes)
        levels.append(replace(level, grid=_to_common_unit(path, level.grid, unit, factors)))
        layouts.append(layout)
    sizes = [level.grid.size for level in levels]
    if sorted(sizes, reverse=True) != sizes or len({level.array.dtype for level in levels}) > 1:
        raise fail(path, "its levels do not go from fine to coarse with voxels of one type.")
    if len({(layout.frames, layout.channels) for layout in layouts}) > 1:
        raise fail(path, "its levels have different numbers of moments or channels.")
    notes += _doubts(levels, about, datasets)
    labels: bool | None = "image-label" in ome or "image-label" in attributes
    if not labels and about.get("type") != "mean":  # coarser levels that are means are of amounts
        labels = None
    return Pyramid(tuple(levels), labels, notes, _named_layout(layouts[0], ome, attributes, axes))


def _from_image_set(path: Path, group: zarr.Group, ome: Mapping[str, Any]) -> Pyramid:
    """The one image of a group of images; of several the names, to choose from."""
    if "plate" in ome or "well" in ome:
        kind = "plate" if "plate" in ome else "well"
        listed = ome[kind].get("wells" if kind == "plate" else "images") if isinstance(ome[kind], Mapping) else None
        entries = listed if isinstance(listed, list) else []
        names = [str(entry.get("path", "?")) for entry in entries if isinstance(entry, Mapping)]
        inner = "/0" if kind == "plate" else ""
        raise fail(
            path,
            f"it is a {kind} of {len(names)} {'wells' if kind == 'plate' else 'images'}, and a volume is "
            f"one image: name it, such as {printable(path.name)}/{printable((names or ['A/1'])[0], 40)}{inner}.",
        )
    if isinstance(ome.get("labels"), list):
        names = [str(name) for name in ome["labels"]]
        raise fail(
            path,
            f"it lists the labels {printable(', '.join(names))}; name one, such as {printable(path.name)}/"
            f"{printable((names or ['cells'])[0], 40)}.",
        )
    if "bioformats2raw.layout" in ome:
        images = sorted((entry.name for entry in path.iterdir() if entry.name.isdecimal() and is_zarr(entry)), key=int)
        if len(images) != 1:
            raise fail(
                path,
                f"it is a set of {len(images)} images ({', '.join(images[:8])}); name one, such as "
                f"{printable(path.name)}/{(images or ['0'])[0]}.",
            )
        found = open_pyramid(path / images[0])
        return replace(found, notes=(*found.notes, f"the image {images[0]} of the set was read"))
    raise fail(path, "this Zarr group has no multiscales and so is no OME-Zarr image; name one of its arrays.")


# Axes of a version without their names.
_OLD_AXES = ("", "0.1", "0.2")


def _axes(path: Path, about: Mapping[str, Any], version: str) -> list[Mapping[str, Any]]:
    """The axes in order, each with a name and, where it is known, a type."""
    axes = about.get("axes")
    if axes is None and version in _OLD_AXES and "coordinateSystems" not in about:
        axes = list("tczyx")
    if not isinstance(axes, list) or not 2 <= len(axes) <= 5:
        raise fail(path, f"its axes should be 2 to 5, got {printable(axes)}.")
    found = [axis if isinstance(axis, Mapping) else {"name": axis} for axis in axes]
    names = [axis.get("name") for axis in found]
    kinds = {"t": "time", "c": "channel", "z": "space", "y": "space", "x": "space"}
    for axis in found:
        name = axis.get("name")
        if (
            not isinstance(name, str)
            or names.count(name) > 1
            or axis.get("type", kinds.get(name)) != kinds.get(name, axis.get("type"))
            or (axis.get("type") == "space" and name not in kinds)
        ):
            raise fail(
                path, f"its axes should be z, y, x in space, t in time and c of channels; one is {printable(axis)}."
            )
    return found


def _named_layout(
    layout: Layout, ome: Mapping[str, Any], attributes: Mapping[str, Any], axes: list[Mapping[str, Any]]
) -> Layout:
    """The layout with the names and colours of its channels, and the time between its moments in seconds."""
    seconds = {"microsecond": 1e-6, "millisecond": 1e-3, "minute": 60.0, "hour": 3600.0}
    unit = next((str(axis.get("unit", "")) for axis in axes if axis["name"] == "t"), "")
    layout = replace(layout, duration=layout.duration * seconds.get(unit, 1.0))
    omero = ome.get("omero", attributes.get("omero"))
    channels = omero.get("channels") if isinstance(omero, Mapping) else None
    known = [one for one in channels if isinstance(one, Mapping)] if isinstance(channels, list) else []
    if len(known) != layout.channels or layout.channels == 1:
        return layout
    names = tuple(printable(one.get("label", "")) for one in known)
    codes = [str(one.get("color", "")) for one in known]
    colours = tuple(
        (int(code[:2], 16) / 255, int(code[2:4], 16) / 255, int(code[4:], 16) / 255)
        for code in codes
        if re.fullmatch(r"[0-9A-Fa-f]{6}", code)
    )
    return replace(
        layout,
        names=names if all(names) and len(set(names)) == len(names) else (),
        colours=colours if len(colours) == layout.channels else (),
    )


def _doubts(levels: list[Level], about: Mapping[str, Any], datasets: list[Any]) -> tuple[str, ...]:
    """Remarks where the metadata state no place, or one that contradicts itself."""
    if not about.get("coordinateTransformations") and not any(one.get("coordinateTransformations") for one in datasets):
        return ("the metadata state no spacing: 1 along each axis was taken",)
    notes: tuple[str, ...] = ()
    whole = levels[0].grid
    for k, level in enumerate(levels[1:], 1):
        grid = level.grid
        ends = [np.asarray(one.spacing) * one.shape[::-1] for one in (whole, grid)]
        # Writers round odd sizes up or down, and some repeat the scale of an axis that they do not halve.
        if (np.abs(ends[0] - ends[1]) > 1.01 * np.asarray(grid.spacing)).any():
            notes += (f"level {k} of the pyramid has another extent than the finest: its scale or its size is wrong",)
    return notes


def _unit(axes: list[Mapping[str, Any]]) -> tuple[str, tuple[float, ...], tuple[str, ...]]:
    """The unit of lengths, by how much the numbers along x, y and z are multiplied to be in it, and notes."""
    given = {str(axis["name"]): axis.get("unit") or "" for axis in axes}
    stated = [parse_unit(given[name]) for name in "xyz" if name in given]
    units = [unit for unit, _ in stated]
    unit, factors, notes = common_unit(units + units[:1] * (3 - len(units)))
    return unit, factors, tuple(dict.fromkeys(note for _, one in stated for note in one)) + notes


def _to_common_unit(path: Path, grid: Grid, unit: str, factors: tuple[float, ...]) -> Grid:
    """The grid with its lengths along x, y and z converted to one unit."""
    lengths = np.asarray(grid.spacing) * factors
    place = np.asarray(grid.direction) @ (np.asarray(grid.direction).T @ np.asarray(grid.origin) * factors)
    try:
        return replace(
            grid, spacing=tuple(lengths), origin=tuple(place) if len(set(factors)) > 1 else grid.origin, unit=unit
        )
    except DeformError as error:
        raise fail(path, f"its coordinates are unusable: {printable(error, 200)}") from error


def _mapping(path: Path, value: Any, what: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise fail(path, f"{what} should be an object of JSON, got {printable(value)}.")
    return value


def _array(path: Path, group: zarr.Group, name: Any) -> zarr.Array[Any]:
    parts = name.split("/") if isinstance(name, str) else [".."]
    if any(part in ("", ".", "..") or "\\" in part or ":" in part for part in parts):
        raise fail(path, f"its dataset {printable(name)} is not in its own folder, so it is not read.")
    try:
        inside = path.joinpath(*parts).resolve().is_relative_to(path.resolve())
    except (OSError, ValueError):
        inside = False
    if not inside:
        raise fail(path, f"its dataset {printable(name)} is a link out of its folder; it is not read.")
    zarr = zarr_package()
    _check_metadata(path.joinpath(*parts).parent)
    array = group[name]
    if not isinstance(array, zarr.Array):
        raise fail(path, f"its dataset {printable(name)} is no array.")
    return array


def _level(
    path: Path,
    array: zarr.Array[Any],
    names: list[str],
    about: Mapping[str, Any] | None,
    dataset: Mapping[str, Any] | None,
    attributes: Mapping[str, Any],
) -> tuple[Level, Layout]:
    """One resolution, and its moments and channels."""
    if array.ndim != len(names):
        raise fail(path, f"its array {printable(array.path)} has {array.ndim} axes and its metadata name {len(names)}.")
    dtype = array.dtype
    if dtype.kind not in "biuf":
        raise fail(path, f"voxels of type {dtype} are no numbers that can be deformed.")
    size = dict(zip(names, array.shape, strict=True))
    others = {name: n for name, n in size.items() if name not in ("t", "c", "z", "y", "x") and n != 1}
    if not {"y", "x"} <= set(names) or others:
        axes = ", ".join(f"{name}: {n}" for name, n in size.items())
        raise fail(path, f"a volume has the axes z, y, x, and this pyramid has {printable(axes)}.")
    shape, _ = volume_shape(path, [size["x"], size["y"], size.get("z", 1)], dtype.itemsize)
    layout = check_layout(path, Layout(size.get("t", 1), size.get("c", 1)))
    _check_chunks(path, array)
    scale, shift = np.ones(len(names)), np.zeros(len(names))
    for part in (dataset, about):
        for one in (part or {}).get("coordinateTransformations") or []:
            scale, shift = _apply_transformation(path, _mapping(path, one, "a transformation"), scale, shift)
    spacing, origin = (
        np.array([dict(zip(names, numbers, strict=True)).get(axis, missing) for axis in "xyz"])
        for numbers, missing in ((scale, 1.0), (shift, 0.0))
    )
    own = attributes.get("deformnb")
    direction: Any = own.get("direction", IDENTITY) if isinstance(own, Mapping) else IDENTITY
    try:
        frame = Grid((1, 1, 1), direction=direction)
        place = np.asarray(frame.direction) @ origin
        grid = Grid(shape, tuple(spacing), tuple(place), frame.direction)
    except (DeformError, TypeError, ValueError) as error:
        raise fail(path, f"its coordinates are unusable: {printable(error, 200)}") from error
    index = tuple(name if name in ("z", "y", "x") else 0 for name in names)
    duration = float(scale[names.index("t")]) if layout.frames > 1 else 0.0
    others_in_order = tuple(name for name in names if name not in ("z", "y", "x"))
    return Level(array, index, grid, others_in_order), replace(layout, duration=max(0.0, duration))


def _check_chunks(path: Path, array: zarr.Array[Any]) -> None:
    """Refuse an array in so many small chunks that it would be read for hours; damaged metadata may claim them."""
    count = math.prod(-(-n // size) for n, size in zip(array.shape, array.chunks, strict=True))
    if count > _MOST_SMALL and math.prod(array.chunks) < _SMALL:
        size = " x ".join(map(str, array.chunks))
        raise fail(
            path,
            f"its array {printable(array.path)} has {count} chunks of {size} numbers, which would be read "
            "for hours; save it in chunks such as 64 x 128 x 128.",
        )


def _apply_transformation(
    path: Path, one: Mapping[str, Any], scale: NDArray[np.float64], shift: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    kind = one.get("type")
    if kind == "identity":
        return scale, shift
    if kind not in ("scale", "translation"):
        raise fail(
            path, f"its coordinate transformation {printable(kind)} is not supported; scale and translation are."
        )
    numbers = one.get(kind)
    if (
        not isinstance(numbers, list)
        or len(numbers) != len(scale)
        or not all(isinstance(n, int | float) and not isinstance(n, bool) and abs(n) < 1e300 for n in numbers)
    ):
        raise fail(path, f"its {kind} should be {len(scale)} numbers, got {printable(numbers)}.")
    given = np.array(numbers, dtype=np.float64)
    return (scale * given, shift * given) if kind == "scale" else (scale, shift + given)


def read_header(path: Path) -> Header:
    """The header of the finest level, with those of the coarser ones; see :func:`deformnb.io.read_volume`."""
    pyramid = open_pyramid(path)
    headers = [_header(path, level, pyramid) for level in pyramid.levels]
    return replace(headers[0], levels=tuple(headers))


def _header(path: Path, level: Level, pyramid: Pyramid) -> Header:
    layout = pyramid.layout
    names = _axis_places(level)
    parts = [
        replace(
            level, index=tuple({names.get("t"): t, names.get("c"): c}.get(k, one) for k, one in enumerate(level.index))
        )
        for t in range(layout.frames)
        for c in range(layout.channels)
    ]
    dtype, depth = np.dtype(level.array.dtype), max(1, min(level.chunks[0], level.grid.shape[0]))
    slab = depth * level.grid.shape[1] * level.grid.shape[2] * dtype.itemsize
    found = [part.present() if len(parts) < _MOST_COUNTED // 64 else None for part in parts]
    counted = [one for one in found if one is not None]
    missing, total = sum(np.count_nonzero(~one) for one in counted), sum(one.size for one in counted)
    notes = pyramid.notes
    if missing:
        fill = level.array.fill_value or 0
        notes += (f"{missing} of {total} chunks are not there: their voxels have the fill value {fill}",)
    return Header(
        path,
        level.grid.shape,
        dtype,
        lambda: _blocks(parts, depth, found),
        Geometry(
            level.grid.spacing,
            level.grid.origin,
            level.grid.direction,
            is_anatomical=level.grid.direction != IDENTITY,
        ),
        is_labels=pyramid.is_labels,
        notes=notes,
        unit=level.grid.unit,
        working_bytes=slab + (_AT_ONCE + 1) * level.chunk_bytes,
        layout=layout,
    )


def _axis_places(level: Level) -> dict[str, int]:
    """Positions of the axes t and c of a level's array: in this order where both are there."""
    dimension = [k for k, one in enumerate(level.index) if isinstance(one, int)]
    return dict(zip(level.others, dimension, strict=True))


def _blocks(parts: list[Level], depth: int, found: list[NDArray[np.bool_] | None]) -> Iterator[NDArray[Any]]:
    """The slabs of each part; one without any chunk is filled and not read."""
    for level, present in zip(parts, found, strict=True):
        nz, ny, nx = level.grid.shape
        stored = dict(zip(level.index, level.storage_shape, strict=True)).get("z", 1)
        for start in range(0, nz, depth):
            end = min(start + depth, nz)
            if present is not None and not present[start // stored : -(-end // stored)].any():
                yield np.full((end - start, ny, nx), level.array.fill_value or 0, level.array.dtype)
            else:
                yield level.read((slice(start, end), slice(None), slice(None)))


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
    return replace(grid, shape=(nz, ny, nx), spacing=tuple(spacing), origin=tuple(origin))


def level_grids(grid: Grid, levels: int | None = None) -> list[Grid]:
    """The grids of a pyramid, the finest first: so many, or until the longest side is at most 256 voxels."""
    found = [grid]
    while len(found) < (levels or _MOST_LEVELS) and max(found[-1].shape) > (1 if levels else _SMALLEST):
        found.append(coarser(found[-1]))
    return found


def halve(values: NDArray[Any], *, discrete: bool) -> NDArray[Any]:
    """Voxels [z, y, x] of the next level: the mean of each cell, whole numbers rounded, halves up; of labels the mode.

    A cell at an odd end has fewer voxels. Of labels that are equally frequent in a cell the first in memory is taken.

    Examples
    --------
    >>> halve(np.array([[[1, 2], [4, 4]]], np.uint8), discrete=False).tolist()
    [[[3]]]
    >>> halve(np.array([[[7, 2], [2, 9]]], np.uint8), discrete=True).tolist()
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


def create_pyramid(
    path: Path,
    grids: list[Grid],
    dtype: np.dtype[Any],
    *,
    name: str = "",
    is_labels: bool = False,
    fill: Any = 0,
    chunks: tuple[int, int, int] = CHUNK_SHAPE,
    version: OmeZarrVersion = "0.5",
) -> list[Any]:
    """An empty pyramid in a new folder; returns its Zarr arrays, the finest first.

    Parameters
    ----------
    grids : of the levels, whose unit is written; see :func:`level_grids`.
    fill : value of voxels that are never written.
    version : a name of :data:`VERSIONS`.
    """
    zarr = zarr_package()
    if version not in VERSIONS:
        raise DeformError(f"unknown version {printable(version)} of OME-Zarr; choose one of {', '.join(VERSIONS)}.")
    about = _metadata(grids, name, is_labels)
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
    options["config"] = {"write_empty_chunks": True}  # so that a chunk that is lost is not taken for background
    return [
        group.create_array(
            str(k),
            shape=grid.shape,
            dtype=dtype,
            fill_value=fill,
            chunks=tuple(min(c, n) for c, n in zip(chunks, grid.shape, strict=True)),
            **options,
        )
        for k, grid in enumerate(grids)
    ]


def _metadata(grids: list[Grid], name: str, is_labels: bool) -> dict[str, Any]:
    unit = {"unit": UNITS[grids[0].unit].name} if grids[0].unit else {}
    axes = [{"name": axis, "type": "space", **unit} for axis in "zyx"]
    datasets = []
    for k, grid in enumerate(grids):
        place = np.asarray(grid.direction).T @ np.asarray(grid.origin)  # along the grid's own axes
        datasets.append(
            {
                "path": str(k),
                "coordinateTransformations": [
                    {"type": "scale", "scale": list(grid.spacing[::-1])},
                    {"type": "translation", "translation": place[::-1].tolist()},
                ],
            }
        )
    return {"name": name, "axes": axes, "datasets": datasets, "type": "mode" if is_labels else "mean"}


def write(volume: Volume, path: Path, overwrite: bool, progress: Progress | None) -> None:
    """Write a volume and its coarser levels."""
    grids, discrete = level_grids(volume.grid), volume.is_labels or volume.dtype == np.bool_
    with atomic_folder(path, overwrite=overwrite, folder_marks=MARKS) as folder:
        arrays = create_pyramid(folder, grids, volume.dtype, name=volume.name, is_labels=volume.is_labels)
        total, done = sum(grid.size for grid in grids), 0
        values = np.asarray(volume.values)
        for array, grid in zip(arrays, grids, strict=True):
            values = values if array is arrays[0] else _halve_in_slabs(values, discrete)
            for corner in product(*(range(0, n, size) for n, size in zip(grid.shape, array.chunks, strict=True))):
                part = tuple(slice(start, start + size) for start, size in zip(corner, array.chunks, strict=True))
                array[part] = values[part]
                done += values[part].size
                if progress is not None:
                    progress(done / total)


def _halve_in_slabs(values: NDArray[Any], discrete: bool) -> NDArray[Any]:
    """:func:`halve` with little memory besides the result."""
    return np.concatenate([halve(values[k : k + 16], discrete=discrete) for k in range(0, len(values), 16)])

"""Transforms of OME-NGFF 0.6: the coordinate transformations of its RFC 5, with displacement arrays in Zarr.

A file is a folder with a Zarr group. Its metadata hold a *scene*: one transformation of the coordinate system LPS to
itself, and below the group ``coordinateTransformations`` a multiscale image of one level for each displacement field.
The i-th component of a field is along the i-th axis of its coordinate system, here z, y, x. A field on a turned grid is
stored along the axes of the grid, between two affine maps, because a scale and a translation are all that an image of
NGFF may have. Source: https://ngff.openmicroscopy.org/0.6 and https://ngff.openmicroscopy.org/rfc/5.

Read are scenes, and images with a transformation next to them, as ngff-zarr writes them, in Zarr 2 and 3.
"""

from __future__ import annotations

import json
import math
import posixpath
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.checks import optional_package
from deformnb.io.files.atomic import atomic_folder
from deformnb.io.files.errors import fail, human_bytes, printable, unpacking
from deformnb.io.files.memory import available_memory
from deformnb.io.transforms.parts import sample_parts
from deformnb.rbf.fields import AbstractField, Affine, DisplacementField, Identity, compose, with_unit
from deformnb.volume.units import UNITS, common_unit, find_unit
from deformnb.volume.volume import IDENTITY, Grid

_VERSION = "0.6"
_SYSTEM = "LPS"
_AXIS_NAMES = ("z", "y", "x")
_FOLDER = "coordinateTransformations"
_CHUNK = 64  # voxels along an axis of a chunk: 3 MiB of float32

_MARKS = ("zarr.json", ".zgroup")  # files of which a folder that is replaced has one
_LONGEST = 1 << 22  # bytes of metadata: a real scene has some tens of kB
_INVERSE_TOLERANCE = 1e-9  # of two maps that are each other's inverse; rounding is a thousandth of it
_DEEPEST_SEQUENCE = 20
_MOST_CHUNKS = 1 << 18  # of a field; 512^3 vectors take 512 of those that are written here
_MOST_PARTS = 1000


# -- writing -----------------------------------------------------------------------------------------------------------


def write_ngff(
    field: AbstractField, path: Path, grid: Grid, remark: str, overwrite: bool, progress: Progress | None
) -> None:
    """Write a scene with one sequence of transformations; the folder takes its place as a whole."""
    zarr = optional_package("zarr")
    direction = remark.partition(":")[0]
    with atomic_folder(path, overwrite=overwrite, folder_marks=_MARKS) as made:
        root = zarr.open_group(str(made), mode="w", zarr_format=3)
        steps = list[dict[str, Any]]()
        for part in sample_parts(field, grid, progress):
            if isinstance(part, Affine):
                steps.append({"type": "affine", "affine": _rows(np.asarray(part.matrix), np.asarray(part.offset))})
            elif isinstance(part, DisplacementField):
                count = sum(step["type"] == "displacements" for step in steps)
                steps += _write_field(root, part, f"{_FOLDER}/{direction}_{count}")
        ends = {"input": {"name": _SYSTEM}, "output": {"name": _SYSTEM}, "name": direction}
        one = steps[0] if steps else {"type": "identity"}
        whole = ends | ({"type": "sequence", "transformations": steps} if len(steps) > 1 else one)
        systems = [{"name": _SYSTEM, "axes": _space(grid.unit)}]
        scene = {"coordinateSystems": systems, "coordinateTransformations": [whole]}
        root.attrs.update({"ome": {"version": _VERSION, "scene": scene}, "deformnb_transform": remark})


def _write_field(root: Any, part: DisplacementField, name: str) -> list[dict[str, Any]]:
    """Write the samples of a field, and return the transformations that it is."""
    grid = part.lattice
    assert isinstance(grid, Grid)
    turned, plain = np.asarray(grid.direction), grid.direction == IDENTITY
    values = np.moveaxis(np.asarray(part.values) @ turned, -1, 0)[::-1]  # components as the axes: z, y, x
    group = root.create_group(name)
    array = group.create_array(
        "0",
        shape=values.shape,
        dtype=values.dtype,
        dimension_names=("c", *_AXIS_NAMES),
        chunks=(3, *(min(_CHUNK, n) for n in grid.shape)),
        config={"write_empty_chunks": True},
    )  # so that a lost one is known from one of zeros
    array[...] = values
    scale = {"type": "scale", "scale": [1.0, *grid.spacing[::-1]]}
    first = {"type": "translation", "translation": [0.0, *(grid.origin[::-1] if plain else (0.0,) * 3)]}
    level = {
        "type": "sequence",
        "transformations": [scale, first],
        "input": {"path": "0"},
        "output": {"name": "displacements"},
    }
    component = {"name": "c", "type": "displacement", "discrete": True}
    group.attrs["ome"] = {
        "version": _VERSION,
        "multiscales": [
            {
                "name": name.rpartition("/")[2],
                "coordinateSystems": [{"name": "displacements", "axes": [component, *_space(grid.unit)]}],
                "datasets": [{"path": "0", "coordinateTransformations": [level]}],
            }
        ],
    }
    step = {"type": "displacements", "path": f"{name}/0", "interpolation": "linear"}
    if plain:
        return [step]
    origin = np.asarray(grid.origin)
    to_axes = {"type": "affine", "affine": _rows(turned.T, -turned.T @ origin)}
    return [to_axes, step, {"type": "affine", "affine": _rows(turned, origin)}]


def _space(unit: str) -> list[dict[str, str]]:
    stated = {"unit": UNITS[unit].name} if unit else {}
    return [{"name": axis, "type": "space", **stated} for axis in _AXIS_NAMES]


def _rows(matrix: NDArray[np.float64], offset: NDArray[np.float64]) -> list[list[float]]:
    """The matrix (3, 4) of an affine map, with its axes in the order z, y, x."""
    return [[*row[::-1], at] for row, at in zip(matrix[::-1].tolist(), offset[::-1].tolist(), strict=True)]


# -- reading -----------------------------------------------------------------------------------------------------------


def read_ngff(path: Path, _grid: Grid | None) -> AbstractField:
    """The one transformation of a scene, or next to an image."""
    if not path.is_dir():
        raise fail(path, "it is no folder with a Zarr group.")
    ome = _attributes(path, path).get("ome")
    owner = None
    if isinstance(ome, dict):
        images = ome.get("multiscales")
        owner = ome.get("scene", images[0] if isinstance(images, list) and images else None)
    if not isinstance(owner, dict):
        raise fail(path, "its metadata hold neither a scene nor an image of OME-NGFF.")
    given = owner.get("coordinateTransformations")
    every = [one for one in given if isinstance(one, dict)] if isinstance(given, list) else []
    if len(every) != 1:
        names = ", ".join(printable(one.get("name", one.get("type")), 30) for one in every[:10])
        raise fail(path, f"one transformation is read, and its metadata hold {len(every)}{': ' * bool(names)}{names}.")
    axes, units = _parse_axes(path, owner, every[0])
    field = _Reader(path, axes).field(every[0])
    unit, factors, _ = common_unit([units[name] for name in "xyz"])
    if len(set(factors)) > 1:  # to the axes' own units and back
        none, scale = np.zeros(3), np.array(factors)
        field = compose(Affine(np.diag(scale), none), field, Affine(np.diag(1 / scale), none))
    return with_unit(field, unit)


def _parse_axes(
    path: Path, owner: dict[str, Any], transformation: dict[str, Any]
) -> tuple[tuple[str, ...], dict[str, str]]:
    """Names and units of the axes of the coordinate system that a transformation is of."""
    ends = [transformation.get(end) for end in ("input", "output")]
    names = [end.get("name") if isinstance(end, dict) else end for end in ends]
    systems = owner.get("coordinateSystems")
    found = [
        [axis if isinstance(axis, dict) else {} for axis in _as_list(system.get("axes"))]
        for name in names
        for system in (systems if isinstance(systems, list) else [])
        if isinstance(system, dict) and system.get("name") == name
    ]
    axes = [tuple(str(axis.get("name")) for axis in system) for system in found]
    if len(axes) != 2 or axes[0] != axes[1] or sorted(axes[0]) != ["x", "y", "z"]:
        raise fail(
            path,
            "its transformation must be of one system of the three axes x, y and z to another with the "
            f"same ones, and is of {printable(names[0], 40)} to {printable(names[1], 40)}.",
        )
    lps = {"x": "right-to-left", "y": "anterior-to-posterior", "z": "inferior-to-superior"}
    for axis in (axis for system in found for axis in system):
        orientation = axis.get("orientation")
        if isinstance(orientation, dict) and orientation.get("value") != lps[str(axis["name"])]:
            raise fail(
                path,
                f"its axis {axis['name']} runs {printable(orientation.get('value'), 40)}; "
                "only systems in LPS are read.",
            )
    return axes[0], {str(axis["name"]): find_unit(axis.get("unit", "")) or "" for axis in found[0]}


def _as_list(given: Any) -> list[Any]:
    return given if isinstance(given, list) else []


class _Reader:
    """Fields of transformations of one coordinate system.

    Parameters
    ----------
    path : the folder.
    axes : names of the axes of the system, in their order.
    """

    def __init__(self, path: Path, axes: tuple[str, ...]) -> None:
        self.path, self.parts = path, 0
        self.order = [axes.index(name) for name in "xyz"]  # position of x, y and z among the axes

    def field(self, given: Any, depth: int = 0) -> AbstractField:
        """The field of a transformation."""
        self.parts += 1
        if not isinstance(given, dict) or depth > _DEEPEST_SEQUENCE or self.parts > _MOST_PARTS:
            raise fail(self.path, "one of its transformations is no object, or they are nested too deep.")
        kind = given.get("type")
        if kind == "sequence":
            inner = given.get("transformations")
            if not isinstance(inner, list) or not inner:
                raise fail(self.path, "a sequence in it has no list of transformations.")
            return compose(*reversed(_split_by_axes([self.field(one, depth + 1) for one in inner])))
        if kind == "bijection":
            return self.field(given.get("forward"), depth + 1)
        if kind in ("displacements", "coordinates"):
            return self._samples(given, absolute=kind == "coordinates")
        return self._linear(given, kind)

    def _linear(self, given: dict[str, Any], kind: Any) -> AbstractField:
        o = self.order
        if kind == "identity":
            return Identity(3)
        if kind == "translation":
            return Affine(np.eye(3), self._numbers(given.get(kind), (3,), kind)[o])
        if kind == "scale":
            return Affine(np.diag(self._numbers(given.get(kind), (3,), kind)[o]), np.zeros(3))
        if kind == "rotation" and "path" not in given:
            return Affine(self._numbers(given.get(kind), (3, 3), kind)[np.ix_(o, o)], np.zeros(3))
        if kind == "affine" and "path" not in given:
            rows = self._numbers(given.get(kind), (3, 4), kind)
            return Affine(rows[np.ix_(o, o)], rows[o, 3])
        raise fail(
            self.path,
            f"its transformation {printable(kind, 30)} is not read; identity, translation, scale, "
            "rotation, affine, sequence, bijection, displacements and coordinates are.",
        )

    def _numbers(self, given: Any, shape: tuple[int, ...], what: str) -> NDArray[np.float64]:
        try:
            array = np.array(given, dtype=np.float64)
        except (TypeError, ValueError):
            array = np.full(1, np.nan)
        if array.shape != shape or not np.isfinite(array).all():
            raise fail(self.path, f"its {what} must be {' x '.join(map(str, shape))} finite numbers.")
        return array

    def _samples(self, given: dict[str, Any], *, absolute: bool) -> DisplacementField:
        if given.get("interpolation", "linear") not in ("linear", None):
            raise fail(
                self.path,
                f"its field requires {printable(given['interpolation'], 20)} interpolation; only linear "
                "interpolation is computed here.",
            )
        array, spacing, first = self._array(given.get("path"))
        o = self.order
        values = np.moveaxis(array, 0, -1)[..., o]  # components x, y, z
        values = np.ascontiguousarray(np.transpose(values, (o[2], o[1], o[0], 3)))
        if not np.isfinite(values).all():
            raise fail(self.path, "it holds displacements that are not finite.")
        x, y, z = first[o].tolist()
        a, b, c = spacing[o].tolist()
        grid = Grid(values.shape[:3], (a, b, c), (x, y, z))
        if absolute:
            values = values - grid.index_to_point(np.moveaxis(np.indices(grid.shape)[::-1], 0, -1))
        return DisplacementField(values, grid)

    def _array(self, name: Any) -> tuple[NDArray[Any], NDArray[np.float64], NDArray[np.float64]]:
        """Samples (3, ...) of a field, and the spacing and the first place of its grid, all in the order of the axes.

        ``name`` is of an array, whose image is the group that lists it, or of an image.
        """
        place = self._path_inside(name)
        group, inside = place, ""
        while _level(group, inside) is None:
            if group == self.path:
                raise fail(self.path, f"no image lists the field {printable(name, 60)}.")
            inside = posixpath.join(group.name, inside) if inside else group.name
            group = group.parent
        level = _level(group, inside)
        assert level is not None
        place = self._path_inside(posixpath.join(group.relative_to(self.path).as_posix(), str(level.get("path"))))
        spacing, first = np.ones(4), np.zeros(4)
        for one in self._levels(level):
            kind = one.get("type")
            if kind == "scale":
                step = self._numbers(one.get("scale"), (4,), "scale")
                spacing, first = step * spacing, step * first
            elif kind == "translation":
                first = first + self._numbers(one.get("translation"), (4,), "translation")
            elif kind != "identity":
                raise fail(self.path, f"a field has a scale and a translation, not {printable(kind, 30)}.")
        if (spacing <= 0).any():
            raise fail(self.path, "the scale of a field must be positive.")
        return self._read(place), spacing[1:], first[1:]

    def _levels(self, level: dict[str, Any]) -> list[dict[str, Any]]:
        given = level.get("coordinateTransformations")
        flat = list[Any]()
        for one in _as_list(given):
            inner = one.get("transformations") if isinstance(one, dict) else None
            flat += inner if isinstance(inner, list) else [one]
        return [one if isinstance(one, dict) else {} for one in flat]

    def _path_inside(self, name: Any) -> Path:
        """A place in the folder; nothing outside it is read."""
        if not isinstance(name, str) or not name or "\0" in name or "\\" in name:
            raise fail(self.path, f"a field has no usable path: {printable(name, 60)}.")
        place = (self.path / name.lstrip("/")).resolve()
        if not place.is_relative_to(self.path.resolve()):
            raise fail(self.path, f"the path {printable(name, 60)} leads out of it and is not read.")
        return self.path / place.relative_to(self.path.resolve())

    def _read(self, place: Path) -> NDArray[Any]:
        zarr = optional_package("zarr")
        _attributes(self.path, place)  # the length of the metadata
        try:
            array = zarr.open_array(str(place), mode="r")
            shape, dtype, chunks = array.shape, array.dtype, array.chunks
        except Exception as error:  # zarr and its codecs raise of every kind
            why = printable(error, 100)
            raise fail(self.path, f"the field {printable(place.name, 40)} is no Zarr array ({why}).") from None
        if len(shape) != 4 or shape[0] != 3 or min(shape) < 1 or dtype.kind not in "fiu":
            raise fail(
                self.path,
                f"a field has three components over three axes, and this array has the shape "
                f"{printable(shape, 60)} of {printable(dtype, 20)}.",
            )
        need = math.prod(shape) * 8 + math.prod(chunks) * dtype.itemsize
        if need > available_memory() // 3:
            raise fail(
                self.path,
                f"its {' x '.join(map(str, shape[:0:-1]))} vectors in chunks of {chunks} take "
                f"{human_bytes(need)}, more than a third of the memory that is free.",
            )
        count = math.prod(-(-n // c) for n, c in zip(shape, chunks, strict=True))
        if count > _MOST_CHUNKS:
            raise fail(
                self.path,
                f"its field {printable(place.name, 40)} has {count} chunks, and at most "
                f"{_MOST_CHUNKS} are read; save it in larger ones.",
            )
        _check_chunks(self.path, place)
        if _attributes(self.path, self.path).get("deformnb_transform") and array.nchunks_initialized < count:
            raise fail(
                self.path,
                f"of the {count} chunks of its field {printable(place.name, 40)}, "
                f"{count - array.nchunks_initialized} are missing; it was not copied as a whole.",
            )
        with unpacking(self.path):
            return np.asarray(array[...])


def _check_chunks(path: Path, place: Path) -> None:
    """Refuse all but files and folders: a pipe would block for ever, a link leads elsewhere."""
    for entry in place.rglob("*"):
        if entry.is_symlink() or not (entry.is_dir() or entry.is_file()):
            raise fail(path, f"{printable(entry.name, 40)} in it is no plain file; it is not read.")


def _split_by_axes(parts: list[AbstractField]) -> list[AbstractField]:
    """The parts, in the order in which places are looked up; fields between maps to the axes of a grid are one part."""
    out = list[AbstractField]()
    for part in parts:
        out.append(part)
        if len(out) < 3:
            continue
        before, field, after = out[-3:]
        if not (isinstance(before, Affine) and isinstance(field, DisplacementField) and isinstance(after, Affine)):
            continue
        turned, origin, grid = np.asarray(after.matrix), np.asarray(after.offset), field.lattice
        size = np.abs(origin).max() + 1.0
        if (
            np.abs(turned @ before.matrix - np.eye(3)).max() < _INVERSE_TOLERANCE
            and np.abs(turned @ before.offset + origin).max() < _INVERSE_TOLERANCE * size
            and np.abs(turned @ turned.T - np.eye(3)).max() < _INVERSE_TOLERANCE
            and isinstance(grid, Grid)
        ):
            a, b, c = (tuple(row) for row in turned.tolist())
            x, y, z = (turned @ np.asarray(grid.origin) + origin).tolist()
            own = Grid(grid.shape, grid.spacing, (x, y, z), (a, b, c))
            out[-3:] = [DisplacementField(np.asarray(field.values) @ turned.T, own)]
    return out


def _level(group: Path, name: str) -> dict[str, Any] | None:
    """The level of the image in a folder whose array has a name, or the finest for no name; None if it has none."""
    try:
        ome = _attributes(group, group).get("ome")
    except OSError:
        return None
    images = ome.get("multiscales") if isinstance(ome, dict) else None
    levels = images[0].get("datasets") if isinstance(images, list) and images and isinstance(images[0], dict) else None
    every = [level for level in levels if isinstance(level, dict)] if isinstance(levels, list) else []
    return next((level for level in every if not name or level.get("path") == name), None)


def _attributes(path: Path, node: Path) -> dict[str, Any]:
    """Attributes of a node of Zarr 3 or 2; none if it has none."""
    for name, inner in (("zarr.json", "attributes"), (".zattrs", None)):
        file = node / name
        if not file.is_file():
            continue
        if file.stat().st_size > _LONGEST:
            raise fail(path, f"its metadata {name} have {human_bytes(file.stat().st_size)}, which is far too long.")
        data = json.loads(file.read_bytes())
        found = data.get(inner) if inner and isinstance(data, dict) else data
        return found if isinstance(found, dict) else {}
    return {}

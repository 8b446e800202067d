"""JSON serialization of a deformation, with a reader that validates everything.

The form has a version "major.minor". A newer major version is refused; fields that a newer minor version added to the
document or to a step are stored and written out again (so a minor version may add them there and nowhere else).

The reader has typed access to the JSON and checks every value: no NaN, no infinity, bounded size and nesting, and every
error names the place in the document. Nothing in a document is ever executed, unpickled, or used as a path.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, NoReturn

import numpy as np

from deformnb.checks import LARGEST_COORDINATE, check_arguments, short_value
from deformnb.document.deformation import Deformation, Keyframe, Step, VolumeReference
from deformnb.document.json_reader import JsonReader, without_surrogates
from deformnb.document.json_regions import cut_to_data, part_to_data, read_cut, read_part
from deformnb.errors import DeformError
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.support import ChosenSupport
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid

DOCUMENT_FORMAT = "deformnb-deformation"
VERSION = (2, 2)
"""1.1: rigid parts, cuts, the mode and an animation; 1.2: stages, locks and own radii of points; 1.3: the grid of the
result; 1.4: the view state (:mod:`deformnb.session.view_state`); 2.0: the support that a step has chosen, pivots of
rigid parts, and the trend "affine" shrinks across thin directions; 2.1: lines whose cut stops inside the body; 2.2: the
direction of a fit, and the unit of all lengths, also of the volume and the grid of the result, which earlier documents
do not state. Each is left out where a document has none."""

LARGEST_OUTPUT = 2**36
"""Voxels of a result that a document may request; what there is no memory for is refused when it is made."""

DEEPEST_JSON = 50
"""Levels of nesting; a document of today has six."""

LONGEST_DOCUMENT = 32 * 2**20
"""Characters; 2000 points of 40 steps fit ten times over."""

# Left out of a document that has them.
_USUAL = {"mode": "compose", "easing": "linear", "loop": "once", "unit": ""}


def _migrate_1(data: dict[str, Any]) -> dict[str, Any]:
    """Migrate from 1.x, which had other defaults: an automatic support was the box's diagonal, "affine" was exact."""

    def steps(given: Any) -> Any:
        if not isinstance(given, list):
            return given
        return [
            step
            | {
                "support": "box_diagonal" if step.get("support") is None else step["support"],
                "trend": "affine_exact" if step.get("trend", "affine") == "affine" else step["trend"],
            }
            if isinstance(step, dict)
            else step
            for step in given
        ]

    data = data | {"steps": steps(data.get("steps"))} if "steps" in data else data
    if isinstance(data.get("keyframes"), list):
        data = data | {
            "keyframes": [
                key | {"steps": steps(key.get("steps"))} if isinstance(key, dict) else key for key in data["keyframes"]
            ]
        }
    return data


MIGRATIONS: dict[int, Callable[[dict[str, Any]], dict[str, Any]]] = {1: _migrate_1}
"""From major version n to n + 1; the tests have a fixture of every released version."""


@check_arguments
def to_json(deformation: Deformation) -> str:
    """The document as text, one control point a line, so that versions differ by the lines that changed.

    Examples
    --------
    >>> '"steps": []' in to_json(Deformation())
    True
    """
    data: dict[str, Any] = {
        "format": DOCUMENT_FORMAT,
        "version": f"{VERSION[0]}.{VERSION[1]}",
        "name": deformation.name,
        "volume": _volume_data(deformation.volume),
        "steps": [_step_data(s) for s in deformation.steps],
    }
    data |= {key: getattr(deformation, key) for key, usual in _USUAL.items() if getattr(deformation, key) != usual}
    if deformation.keyframes:
        data["keyframes"] = [
            {"time": key.time, "steps": [_step_data(s) for s in key.steps]} for key in deformation.keyframes
        ]
    if deformation.output is not None:
        data["output"] = _grid_data(deformation.output)
    text = json.dumps({**deformation.extra, **data}, indent=1, allow_nan=False, ensure_ascii=False, default=_plain)
    return _tidy(without_surrogates(text)) + "\n"


def _plain(value: Any) -> Any:
    """A number of NumPy's, such as a slider or a loop of a notebook passes, as one of Python's."""
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"a document holds no {type(value).__name__}.")


def _tidy(text: str) -> str:
    """Vectors and control points on one line each, where json.dumps gives every number its own.

    Both patterns begin with a line break, which inside a JSON string is always escaped: no name is ever touched.
    """
    text = re.sub(r"\[\n\s*((?:-?[\d.eE+-]+,?\s+)+)\]", lambda m: "[" + " ".join(m[1].split()) + "]", text)
    return re.sub(r'\{\n\s*("id":[^{}]*?)\n\s*\}', lambda m: "{" + re.sub(r"\n\s*", " ", m[1]) + "}", text)


def from_json(text: str | bytes) -> Deformation:
    """The document of a text.

    Raises
    ------
    DeformError
        In one sentence: empty, cut short, not JSON, not UTF-8, of a newer major version, or malformed at a named place.

    Examples
    --------
    >>> from_json(to_json(Deformation())) == Deformation()
    True
    """
    data = _parse(text)
    if data.get("format") != DOCUMENT_FORMAT:
        raise DeformError(
            f"this is not a deformnb document: its format is {data.get('format')!r:.40}, not {DOCUMENT_FORMAT!r}."
        )
    data = _migrate(data)
    r = JsonReader(data, "document")
    steps = [_step(s) for s in r.items("steps", [])]
    volume = None if data.get("volume") is None else _volume(r.part("volume"))
    known = {"format", "version", "name", "volume", "steps", "keyframes", "output", *_USUAL}
    output = None if data.get("output") is None else _output(r.part("output"))
    keys = tuple(
        Keyframe(k.number("time"), tuple(_step(s) for s in k.items("steps"))) for k in r.items("keyframes", [])
    )
    usual: dict[str, Any] = {key: r.text(key, value) for key, value in _USUAL.items()}
    return Deformation(
        tuple(steps),
        r.text("name", ""),
        volume,
        r.rest(known),
        keyframes=keys,
        output=output,
        **usual,
    )


def _parse(text: str | bytes) -> dict[str, Any]:
    if not isinstance(text, (str, bytes)):
        raise DeformError(f"a document is read from text, got {short_value(text)}.")
    if len(text) > LONGEST_DOCUMENT:
        raise DeformError(f"the document is {len(text)} characters long; at most {LONGEST_DOCUMENT} are read.")
    try:
        decoded = text.decode("utf-8") if isinstance(text, bytes) else text
        if not decoded.strip():
            raise DeformError("the document is empty.")
        data = json.loads(decoded, parse_constant=_no_constant, parse_float=_finite_float)
        _check_depth(data)
    except UnicodeDecodeError:
        raise DeformError("the document is not UTF-8 text.") from None
    except RecursionError:
        raise DeformError("the document is nested too deeply.") from None
    except json.JSONDecodeError as error:
        raise DeformError(f"the document is not complete JSON: {error.msg} in line {error.lineno}.") from None
    except DeformError:
        raise
    except ValueError:  # Python reads no integers of more than 4300 digits
        raise DeformError("the document contains a number that is too long.") from None
    if not isinstance(data, dict):
        raise DeformError("the document is not a JSON object.")
    return data


def _no_constant(name: str) -> NoReturn:
    raise DeformError(f"the document contains {name}, which is not a number.")


def _finite_float(text: str) -> float:
    number = float(text)
    if not np.isfinite(number):
        raise DeformError(f"the document contains {text:.20}, which is too large for a number.")
    return number


def _check_depth(data: Any) -> None:
    """Refuse nesting beyond :data:`DEEPEST_JSON`: unknown fields are written again, and writing recurses."""
    level = [data]
    for _ in range(DEEPEST_JSON):
        level = [
            inner
            for value in level
            if isinstance(value, (dict, list))
            for inner in (value.values() if isinstance(value, dict) else value)
        ]
        if not level:
            return
    raise DeformError(f"the document is nested too deeply; at most {DEEPEST_JSON} levels are read.")


def _migrate(data: dict[str, Any]) -> dict[str, Any]:
    match = re.fullmatch(r"(\d{1,4})\.(\d{1,4})", str(data.get("version")))
    if match is None:
        raise DeformError(f"the document's version {data.get('version')!r:.40} is not of the form 1.0.")
    major = int(match[1])
    if major > VERSION[0] or major < 1:
        raise DeformError(
            f"the document has version {match[0]}, this program reads up to {VERSION[0]}.x; update deformnb to open it."
        )
    for version in range(major, VERSION[0]):
        data = MIGRATIONS[version](data)
    return data


def _volume_data(volume: VolumeReference | None) -> dict[str, Any] | None:
    if volume is None:
        return None
    data = {"name": volume.name, "shape": list(volume.shape), "spacing": list(volume.spacing), "sha256": volume.sha256}
    return data if volume.grid is None else data | _grid_data(volume.grid)


def _grid_data(grid: Grid) -> dict[str, Any]:
    return {
        "shape": list(grid.shape),
        "spacing": list(grid.spacing),
        "origin": list(grid.origin),
        "direction": [list(row) for row in grid.direction],
    }


@dataclass(frozen=True)
class _Form:
    """Form of a field of a step that is not plain text, a number or a switch.

    Parameters
    ----------
    read : the value from the step's data, which has the key.
    write : the value as JSON data.
    """

    read: Callable[[JsonReader, str], Any]
    write: Callable[[Any], Any] = lambda value: value


def _step_data(step: Step) -> dict[str, Any]:
    """Data of a step; fields added after 1.0 only where they differ from the default, so that documents stay short."""
    data: dict[str, Any] = dict(step.extra)
    for name in _STEP_KEYS:
        value = getattr(step, name)
        if name in _ALWAYS or value != _STEP_DEFAULTS[name]:
            data[name] = value if value is None or name not in _FORMS else _FORMS[name].write(value)
    return data | _point_attributes(step)


def _point_attributes(step: Step) -> dict[str, Any]:
    """Locks and radii, set by set: next to the points, for a minor version may add fields to a step only."""
    data: dict[str, Any] = {}
    if any(m.locked.any() for m in step.maps):
        data["locked"] = [[i for i, is_locked in zip(m.ids, m.locked, strict=True) if is_locked] for m in step.maps]
    if any(not np.isnan(m.radius).all() for m in step.maps):
        data["radii"] = [
            [[i, float(r)] for i, r in zip(m.ids, m.radius, strict=True) if not np.isnan(r)] for m in step.maps
        ]
    return data


def _points_data(points: ControlPoints) -> dict[str, Any]:
    rows = [
        {"id": i, "name": name, "source": s.tolist(), "target": t.tolist(), "active": bool(a), "weight": float(w)}
        for i, name, s, t, a, w in zip(
            points.ids, points.names, points.source, points.target, points.active, points.weight, strict=True
        )
    ]
    return {"dim": points.dim, "next_id": points.next_id, "points": rows}


def _size(r: JsonReader) -> tuple[tuple[int, int, int], tuple[float, float, float]]:
    z, y, x = r.numbers("shape", 3)
    a, b, c = r.numbers("spacing", 3)
    if not all(n == int(n) and n >= 1 for n in (z, y, x)) or min(a, b, c) <= 0:
        raise DeformError(f"{r.where} must have a shape of whole numbers and a spacing of positive ones.")
    return (int(z), int(y), int(x)), (a, b, c)


def _volume(r: JsonReader) -> VolumeReference:
    shape, spacing = _size(r)
    digest = r.text("sha256")
    if not re.fullmatch(r"[0-9a-f]{64}", digest):
        raise DeformError(f"{r.where}.sha256 must be 64 hexadecimal digits.")
    reference = VolumeReference(r.text("name", ""), shape, spacing, digest)
    if r.data.get("origin") is None or r.data.get("direction") is None:
        return reference
    grid = _read_grid(shape, spacing, r)
    return replace(reference, origin=grid.origin, direction=grid.direction)


def _output(r: JsonReader) -> Grid:
    shape, spacing = _size(r)
    if shape[0] * shape[1] * shape[2] > LARGEST_OUTPUT:
        raise DeformError(f"{r.where} has {shape[2]} x {shape[1]} x {shape[0]} voxels, more than can be made.")
    return _read_grid(shape, spacing, r)


def _read_grid(shape: tuple[int, int, int], spacing: tuple[float, float, float], r: JsonReader) -> Grid:
    rows = r.value("direction", (list,), ...)
    if len(rows) != 3:
        raise DeformError(f"{r.where}.direction must be three rows of three numbers.")
    direction = tuple(
        JsonReader({"row": row}, f"{r.where}.direction[{k}]").numbers("row", 3) for k, row in enumerate(rows)
    )
    x, y, z = r.numbers("origin", 3)
    try:
        return Grid(shape, spacing, (x, y, z), direction)  # type: ignore[arg-type]
    except DeformError as error:
        raise DeformError(f"{error} (in {r.where})") from None


def _step(r: JsonReader) -> Step:
    try:
        given = {name: _field(r, name) for name in _STEP_KEYS if name in r.data or name == "maps"}
        _check_kernel(given.get("kernel"))
        given["maps"] = _with_point_attributes(given["maps"], r)
        return Step(**given, extra=r.rest({*_STEP_KEYS, "locked", "radii"}))
    except DeformError as error:
        raise DeformError(f"{error} (in {r.where})") from None


def _check_kernel(name: str | None) -> None:
    if name is not None and name not in KERNELS:
        raise DeformError(
            f"the document was made with the kernel {name!r:.60}, which is not one of deformnb and not "
            "registered here; ask its author for the function, give it to deformnb.rbf.register_kernel "
            "under this name, and open the document again"
        )


def _field(r: JsonReader, name: str) -> Any:
    """A field of a step, which its data has: of the form of :data:`_FORMS`, or of the type of its default."""
    if name not in _FORMS:
        return _TYPED[type(_STEP_DEFAULTS[name])](r, name)
    return None if r.data.get(name, ...) is None and _STEP_DEFAULTS[name] is None else _FORMS[name].read(r, name)


_TYPED: dict[type, Callable[[JsonReader, str], Any]] = {
    str: JsonReader.text,
    bool: JsonReader.flag,
    int: JsonReader.integer,
    float: JsonReader.number,
}


def _plane(r: JsonReader, key: str) -> Plane:
    return Plane(*(r.part(key).numbers(k, 3) for k in ("origin", "u", "v")))  # type: ignore[arg-type]


def _text_or(read: Callable[[JsonReader, str], Any]) -> Callable[[JsonReader, str], Any]:
    return lambda r, key: r.text(key) if isinstance(r.data[key], str) else read(r, key)


def _read_chosen_support(r: JsonReader, key: str) -> ChosenSupport:
    chosen = r.part(key)
    return ChosenSupport(chosen.number("radius"), chosen.text("kernel"))


def _list_form(read: Callable[[JsonReader], Any], write: Callable[[Any], Any]) -> _Form:
    """The form of a list of objects."""
    return _Form(lambda r, key: tuple(read(item) for item in r.items(key)), lambda given: [write(v) for v in given])


def _with_point_attributes(maps: tuple[ControlPoints, ...], r: JsonReader) -> tuple[ControlPoints, ...]:
    """The sets of points with their locks and radii."""
    for key, field, is_right in (("locked", "locked", _is_id), ("radii", "radius", _is_radius)):
        rows = r.data.get(key)
        if rows is None:
            continue
        if not isinstance(rows, list) or len(rows) != len(maps) or not all(isinstance(row, list) for row in rows):
            raise DeformError(f"{r.where}.{key} must be a list for each of its {len(maps)} sets of points.")
        wrong = next((item for row in rows for item in row if not is_right(item)), None)
        if wrong is not None:
            what = "names points by their ids" if key == "locked" else "gives points, by their ids, lengths below 1e15"
            raise DeformError(f"{r.where}.{key} {what}, got {wrong!r:.40}.")
        for k, row in enumerate(rows):
            for item in row:
                number, value = (item, True) if key == "locked" else (item[0], float(item[1]))
                own: dict[str, Any] = {field: value}
                maps = (*maps[:k], maps[k].edit(number, **own), *maps[k + 1 :])
    return maps


def _is_id(item: Any) -> bool:
    return isinstance(item, int) and not isinstance(item, bool)


def _is_radius(item: Any) -> bool:
    return (
        isinstance(item, list)
        and len(item) == 2
        and _is_id(item[0])
        and isinstance(item[1], int | float)
        and not isinstance(item[1], bool)
        and abs(item[1]) <= LARGEST_COORDINATE
    )


def _points(r: JsonReader) -> ControlPoints:
    dim = r.integer("dim")
    if dim not in (2, 3):
        raise DeformError(f"{r.where}.dim must be 2 or 3, got {dim}.")
    rows = r.items("points")
    return ControlPoints(
        np.array([p.numbers("source", dim) for p in rows], dtype=np.float64).reshape(-1, dim),
        np.array([p.numbers("target", dim) for p in rows], dtype=np.float64).reshape(-1, dim),
        tuple(p.integer("id") for p in rows),
        tuple(p.text("name", "") for p in rows),
        np.array([p.flag("active", True) for p in rows], dtype=bool),
        np.array([p.number("weight", 1.0) for p in rows], dtype=np.float64),
        r.integer("next_id", 0),
    )


_STEP_DEFAULTS = {given.name: given.default for given in fields(Step) if given.name != "extra"}

_ALWAYS = (
    "name",
    "enabled",
    "plane",
    "kernel",
    "support",
    "trend",
    "smoothing",
    "strength",
    "extrusion",
    "curve",
    "knots",
    "maps",
)
"""Keys of 1.0, which every step has, in their order."""

_STEP_KEYS = (*_ALWAYS, *(name for name in _STEP_DEFAULTS if name not in _ALWAYS))
"""All fields of a step in the order of a document; later ones are left out where they have their default."""

_FORMS: dict[str, _Form] = {
    "plane": _Form(_plane, lambda plane: {key: list(getattr(plane, key)) for key in ("origin", "u", "v")}),
    "support": _Form(_text_or(JsonReader.number)),
    "chosen_support": _Form(_read_chosen_support, ChosenSupport._asdict),
    "curve": _Form(_text_or(JsonReader.numbers), lambda curve: curve if isinstance(curve, str) else list(curve)),
    "knots": _Form(JsonReader.numbers, list),
    "maps": _list_form(_points, _points_data),
    "parts": _list_form(read_part, part_to_data),
    "cuts": _list_form(read_cut, cut_to_data),
}
"""Fields of a step that are more than a text, a number or a switch."""

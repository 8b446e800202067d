"""Markups of 3D Slicer deformed as a whole: points, lines, curves, planes and boxes with all that a file states.

:func:`deformnb.read_landmarks` takes the places and names of a file. Here control points move with the tissue, and
labels, locks, visibility, descriptions, colours and kinds of markups stay as they are. The forms are those of Slicer's
markups schema 1.0.3 and of its .fcsv files.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from os import PathLike
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Floats
from deformnb.io.files.addresses import input_path
from deformnb.io.files.atomic import atomic_write
from deformnb.io.files.errors import Damage, fail
from deformnb.io.files.paths import as_path, regular_file
from deformnb.io.files.texts import decode_text
from deformnb.io.landmarks.coordinates import coordinates
from deformnb.io.landmarks.fcsv import format_fcsv, read_fcsv_points
from deformnb.io.landmarks.json_files import SCHEMA, is_ras, markup_unit
from deformnb.rbf.fields import AbstractField, HasField, as_field
from deformnb.volume.units import ratio
from deformnb.volume.volume import Grid, VolumeLike
from deformnb.warping.points import Landmarks, unit_factor, warp_points

MARKUP_SUFFIXES = (".mrk.json", ".fcsv")
"""Suffixes of the files of markups, which are written from each other."""

_TO_LPS = np.diag([-1.0, -1.0, 1.0])
_COMPUTED = ("value", "controlPointValues")  # of measurements, which Slicer computes again

_Move: TypeAlias = Callable[[Floats], tuple[Floats, NDArray[np.bool_]]]


def is_markups(path: str | PathLike[str]) -> bool:
    """Check for the suffix of a file of Slicer's markups.

    Examples
    --------
    >>> is_markups("nose.mrk.json"), is_markups("session.json")
    (True, False)
    """
    return str(path).lower().endswith(MARKUP_SUFFIXES)


def warp_markups(
    source: str | PathLike[str],
    target: str | PathLike[str],
    field: AbstractField | HasField,
    grid: Grid | VolumeLike | None = None,
    *,
    overwrite: bool = False,
) -> tuple[str, ...]:
    """Write the markups of a file moved with the tissue; all else that the file states stays.

    Parameters
    ----------
    source, target : files that end in .mrk.json or .fcsv; an .fcsv has a list of points alone.
    field : backward displacements in space, or a Deformation.
    grid : of the volume that is deformed; needed for a Deformation.
    overwrite : replace a file that is there; else it is refused.

    Returns
    -------
    Notes: points without a place in the result, which stay where they were; planes and boxes, which stay flat and
    straight: their middle moves with the tissue, and they turn with it there.

    Raises
    ------
    VolumeFileError
        If the source is no such file, or the target cannot hold what is in it.

    Examples
    --------
    >>> import tempfile
    >>> from deformnb.io.landmarks.formats import read_landmarks, write_landmarks
    >>> from deformnb.rbf.fields import Identity
    >>> from deformnb.warping.points import Landmarks
    >>> folder = Path(tempfile.mkdtemp())
    >>> write_landmarks(Landmarks([[1, 2, 3]], ("nose",)), folder / "a.mrk.json")
    >>> warp_markups(folder / "a.mrk.json", folder / "b.mrk.json", Identity())
    ()
    >>> read_landmarks(folder / "b.mrk.json").points.tolist()
    [[1.0, 2.0, 3.0]]
    """
    place, end = regular_file(input_path(source)), as_path(target)
    for path in (place, end):
        if not is_markups(path):
            raise fail(path, f"this is no file of Slicer's markups; these end in {' or '.join(MARKUP_SUFFIXES)}.")
    inside = as_field(field, grid)
    with Damage(place, "leave out other markups than those that should move"):
        text, _ = decode_text(place, place.read_bytes())
        data = _from_fcsv(place, text) if place.name.lower().endswith(".fcsv") else _from_json(place, text)
        notes: list[str] = []
        for markup in data["markups"]:
            unit = Landmarks(np.zeros((1, 3)), unit=markup_unit(place, markup))
            notes += _warp_markup(place, markup, inside, unit_factor(unit, inside, grid))
    written = (
        _to_fcsv(end, data) if end.name.lower().endswith(".fcsv") else json.dumps(data, indent=1, ensure_ascii=False)
    )
    with atomic_write(end, overwrite=overwrite) as file:
        file.write((written.rstrip("\n") + "\n").encode("utf-8"))
    return tuple(dict.fromkeys(notes))


def _warp_markup(path: Path, markup: dict[str, Any], field: AbstractField, scale: float) -> list[str]:
    to_lps = _TO_LPS if is_ras(path, markup.get("coordinateSystem", "LPS")) else np.eye(3)
    notes, lost = [], []

    def move(places: Floats) -> tuple[Floats, NDArray[np.bool_]]:
        moved, found = warp_points(places @ to_lps * scale, field)
        return moved / scale @ to_lps, found

    for number, point in enumerate(markup["controlPoints"], 1):
        if point.get("positionStatus", "defined") == "undefined" or not isinstance(point.get("position"), list):
            continue
        position = np.array([coordinates(path, point["position"], f"control point {number}")])
        if position.shape != (1, 3) or not np.isfinite(position).all():
            raise fail(path, f"control point {number} has no position of three numbers.")
        moved, found = move(position)
        if found[0]:
            point["position"] = moved[0].tolist()
        else:
            lost.append(str(point.get("label") or number))
    if lost:
        notes.append(f"these points have no place in the result and stay where they were: {', '.join(lost[:5])}")
    if markup.get("type") in ("Plane", "ROI"):
        notes += _turn_frame(path, markup, field, move, to_lps, scale)
    for measurement in markup.get("measurements", []):
        for name in _COMPUTED:
            measurement.pop(name, None)
    return notes


def _turn_frame(
    path: Path, markup: dict[str, Any], field: AbstractField, move: _Move, to_lps: Floats, scale: float
) -> list[str]:
    """Move the frame of a plane or a box as the tissue at its middle moves and turns."""
    kind = "box" if markup["type"] == "ROI" else "plane"
    center = markup.get("center")
    if not isinstance(center, list):
        return []
    start = np.array([coordinates(path, center, "the center")])
    moved, found = move(start)
    if not found[0]:
        return [f"the middle of a {kind} has no place in the result: it stays where it was"]
    # Forward, the map is the inverse of x + D(x); its rotation is that of the polar decomposition.
    backward = np.eye(3) + field.jacobian(moved @ to_lps * scale)[0]
    left, _, right = np.linalg.svd(np.linalg.inv(backward))
    turn = to_lps @ (left @ np.diag([1, 1, np.linalg.det(left @ right)]) @ right) @ to_lps
    markup["center"] = moved[0].tolist()
    if isinstance(markup.get("normal"), list):
        markup["normal"] = (turn @ np.array(markup["normal"], float)).tolist()
    if isinstance(markup.get("orientation"), list):
        markup["orientation"] = (turn @ np.array(markup["orientation"], float).reshape(3, 3)).ravel().tolist()
    if isinstance(markup.get("baseToNode"), list):
        base = np.array(markup["baseToNode"], float).reshape(4, 4)
        base[:3, 3] = turn @ (base[:3, 3] - start[0]) + moved[0]
        base[:3, :3] = turn @ base[:3, :3]
        markup["baseToNode"] = base.ravel().tolist()
    shape = "straight" if kind == "box" else "flat"
    return [f"a {kind} stays {shape}: its middle moves with the tissue, and it turns there"]


def _from_json(path: Path, text: str) -> dict[str, Any]:
    data = json.loads(text)
    lists = data.get("markups") if isinstance(data, dict) else None
    if not isinstance(lists, list):
        raise fail(path, "this is no file of Slicer's markups: it has no list markups.")
    for markup in lists:
        points = markup.get("controlPoints", []) if isinstance(markup, dict) else None
        if not isinstance(points, list) or not all(isinstance(point, dict) for point in points):
            raise fail(path, "one of its markups has no list controlPoints.")
        markup["controlPoints"] = points
    return data


def _from_fcsv(path: Path, text: str) -> dict[str, Any]:
    """A list of points as the markups that Slicer makes of it."""
    system, points = "RAS", []
    for found, position, ras in read_fcsv_points(path, text):
        system = "RAS" if ras else "LPS"
        points.append(
            {
                "id": found.get("id", ""),
                "label": found.get("label", ""),
                "description": found.get("desc", ""),
                "associatedNodeID": found.get("associatedNodeID", ""),
                "position": position,
                "selected": found.get("sel", "1").strip() != "0",
                "locked": found.get("lock", "0").strip() == "1",
                "visibility": found.get("vis", "1").strip() != "0",
                "positionStatus": "defined" if np.isfinite(position).all() else "undefined",
            }
        )
    markup = {"type": "Fiducial", "coordinateSystem": system, "coordinateUnits": "mm", "controlPoints": points}
    return {"@schema": SCHEMA, "markups": [markup]}


def _to_fcsv(path: Path, data: dict[str, Any]) -> str:
    lists = data["markups"]
    if len(lists) != 1 or lists[0].get("type", "Fiducial") != "Fiducial":
        kinds = ", ".join(str(markup.get("type", "Fiducial")) for markup in lists)
        raise fail(path, f"an .fcsv holds one list of points, and the file has {kinds}; write an .mrk.json.")
    markup = lists[0]
    scale = ratio(markup_unit(path, markup), "mm")
    rows = []
    for number, point in enumerate(markup["controlPoints"], 1):
        if point.get("positionStatus", "defined") == "undefined":
            continue
        flags = [
            int(point.get(name, usual)) for name, usual in (("visibility", True), ("selected", True), ("locked", False))
        ]
        texts = [point.get(name, "") for name in ("label", "description", "associatedNodeID")]
        rows.append((point.get("id") or number, [scale * float(value) for value in point["position"]], flags, texts))
    return format_fcsv(rows, "RAS" if is_ras(path, markup.get("coordinateSystem", "LPS")) else "LPS")

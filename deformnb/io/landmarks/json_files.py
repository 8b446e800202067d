"""Landmarks as JSON: the markups of 3D Slicer, and the landmarks of BigWarp.

Slicer states the axes (LPS or RAS) and the unit. BigWarp's landmarks are a file, or a part of a transform or a project;
a place that is not set yet is infinite. Source: Slicer's markups schema 1.0.3; the table of landmarks of BigWarp 9.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deformnb.errors import VolumeFileError
from deformnb.io.files.errors import fail, printable
from deformnb.io.landmarks.coordinates import coordinates, drop_missing
from deformnb.volume.units import UNITS, find_unit, ratio
from deformnb.warping.points import Landmarks

_RAS = {"RAS": True, "LPS": False, "0": True, "1": False}  # the numbers are those of old versions of Slicer
_TO_LPS = np.array([-1.0, -1.0, 1.0])
_START = 1 << 16  # bytes that contain the names of a file's first keys


def detect_landmarks(path: Path) -> str | None:
    """The kind of landmarks ("markups" or "bigwarp json") that a .json file holds, by its first keys; None for none."""
    try:
        if not path.is_file():  # a pipe would block for ever
            return None
        with path.open("rb") as file:
            start = file.read(_START)
    except (OSError, ValueError):
        return None
    if b'"markups"' in start and b'"controlPoints"' in start:
        return "markups"
    return "bigwarp json" if b'"movingPoints"' in start or b'"BigWarpLandmarks"' in start else None


def read_json(path: Path, text: str) -> Landmarks:
    """Landmarks of Slicer or of BigWarp, whichever the file holds."""
    data = json.loads(text)
    if isinstance(data, dict):
        landmarks = _bigwarp_part(data)
        if landmarks is not None:
            return _read_bigwarp(path, landmarks)
        if isinstance(data.get("markups"), list):
            return _read_markups(path, data["markups"])
    raise fail(
        path,
        "this is no file of Slicer's markups, with a list markups, nor of BigWarp's landmarks, with a "
        "list movingPoints.",
    )


# ---- BigWarp ---------------------------------------------------------------------------------------------------------


def _bigwarp_part(data: dict[str, Any]) -> dict[str, Any] | None:
    for _ in range(3):  # a project has a transform, which has landmarks
        if "movingPoints" in data:
            return data
        inner = data.get("Transform", data.get("landmarks"))
        if not isinstance(inner, dict):
            return None
        data = inner
    return None


def _read_bigwarp(path: Path, data: dict[str, Any]) -> Landmarks:
    lists = [data.get(key) for key in ("movingPoints", "fixedPoints", "names", "active")]
    if not all(isinstance(one, list) for one in lists) or len({len(one or []) for one in lists}) != 1:
        raise fail(path, "its movingPoints, fixedPoints, names and active must be lists of the same length.")
    moving, fixed, names, active = lists
    assert moving is not None
    assert fixed is not None
    assert names is not None
    assert active is not None
    count = next((len(place) for place in moving if isinstance(place, list)), 0)
    if count not in (2, 3):
        raise fail(path, "there is no landmark of two or three coordinates in it.")
    places = np.array(
        [
            [_coordinates(path, place, count, f"landmark {k}, {which}") for k, place in enumerate(every, 1)]
            for which, every in (("moving", moving), ("fixed", fixed))
        ]
    ).reshape(2, -1, count)
    return drop_missing(
        path, places[0], places[1], [str(name) for name in names], [on is True for on in active], has_open=True
    )


def _coordinates(path: Path, place: Any, count: int, which: str) -> list[float]:
    if not isinstance(place, list) or len(place) != count:
        raise fail(path, f"{which}: a place must be a list of {count} numbers.")
    return coordinates(path, place, which)


def write_bigwarp_json(landmarks: Landmarks) -> str:
    """A transform of BigWarp with its landmarks."""
    assert landmarks.active is not None
    fixed = np.full_like(landmarks.points, np.inf) if landmarks.fixed is None else landmarks.fixed
    table = {
        "type": "BigWarpLandmarks",
        "numDimensions": landmarks.points.shape[1],
        "movingPoints": landmarks.points.tolist(),
        "fixedPoints": np.where(np.isfinite(fixed), fixed, np.inf).tolist(),
        "active": landmarks.active.tolist(),
        "names": list(landmarks.names),
    }
    return json.dumps({"type": "Thin Plate Spline", "landmarks": table}, ensure_ascii=False) + "\n"


# ---- 3D Slicer -------------------------------------------------------------------------------------------------------


def is_ras(path: Path, word: Any) -> bool:
    """Check for RAS, not LPS, as Slicer names coordinate systems."""
    if str(word) not in _RAS:
        raise fail(path, f"its coordinate system '{printable(word, 20)}' is neither LPS nor RAS.")
    return _RAS[str(word)]


def from_slicer(
    path: Path, names: list[str], places: list[list[float]], active: list[bool], ras: list[bool], unit: str = "mm"
) -> Landmarks:
    """Landmarks of places each of which is RAS or LPS; Slicer means millimetres where it states no unit."""
    points = np.array(places).reshape(-1, 3) * np.where(np.array(ras, dtype=bool)[:, None], _TO_LPS, 1.0)
    return replace(drop_missing(path, points, names=names, active=active), unit=unit)


def _read_markups(path: Path, lists: list[Any]) -> Landmarks:
    names, places, active, ras = list[str](), list[list[float]](), list[bool](), list[bool]()
    first = ""
    for markup in lists:
        points = markup.get("controlPoints") if isinstance(markup, dict) else None
        if not isinstance(points, list):
            raise fail(path, "one of its markups has no list controlPoints.")
        system, unit = is_ras(path, markup.get("coordinateSystem", "LPS")), markup_unit(path, markup)
        first = first or unit
        scale = ratio(unit, first)
        for point in points:
            which = f"landmark {len(names) + 1}"
            if not isinstance(point, dict):
                raise fail(path, f"{which} is not an object with a position.")
            position = point.get("position")
            if point.get("positionStatus", "defined") != "defined":  # a template's place that was never set
                position = [None] * 3
            if not isinstance(position, list) or len(position) != 3:
                raise fail(path, f"{which} has no position of three numbers.")
            places.append([scale * value for value in coordinates(path, position, which)])
            names.append(str(point.get("label", "")))
            active.append(point.get("selected") is not False)
            ras.append(system)
    return from_slicer(path, names, places, active, ras, first)


def markup_unit(path: Path, markup: dict[str, Any]) -> str:
    """The unit of a markup, which is a text or a code such as ["mm", "UCUM", "millimeter"]."""
    given = markup.get("coordinateUnits", "mm")
    word = given[0] if isinstance(given, list) and given else given
    found = find_unit(word)
    if not found:
        raise _unknown_unit(path, given)
    return found


def _unknown_unit(path: Path, given: Any) -> VolumeFileError:
    return fail(path, f"its unit {printable(given, 40)} is not known; known are {', '.join(UNITS)}.")


SCHEMA = (
    "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
    "markups-schema-v1.0.3.json#"
)
"""Address of the schema of the markups that are written."""

_ORIENTATION = [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0]  # the axes of RAS in LPS, which Morpho's reader needs


def write_markups(landmarks: Landmarks) -> str:
    """One list of points of Slicer, LPS."""
    assert landmarks.active is not None
    points = [
        {
            "id": str(k + 1),
            "label": name,
            "position": place.tolist(),
            "orientation": _ORIENTATION,
            "selected": bool(on),
            "positionStatus": "defined",
        }
        for k, (name, on, place) in enumerate(zip(landmarks.names, landmarks.active, landmarks.points, strict=True))
    ]
    markup = {"type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm", "controlPoints": points}
    return json.dumps({"@schema": SCHEMA, "markups": [markup]}, indent=1, ensure_ascii=False) + "\n"

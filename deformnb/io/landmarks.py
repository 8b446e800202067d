"""Landmark files: BigWarp's CSV, and the markups of 3D Slicer (.fcsv and .mrk.json).

Slicer says whether its places are LPS or RAS; here they are LPS always, and both are read. BigWarp's are physical
lengths of the image, taken as they are; its moving points are the places, its fixed ones what they correspond to.
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from deformnb.io.atomic import atomic_write
from deformnb.io.headers import Damage, as_path, fail, regular_file, shown
from deformnb.landmarks import Landmarks

_LONGEST = 1 << 26  # bytes: some hundred thousand landmarks
_RAS = {"RAS": True, "LPS": False, "0": True, "1": False}  # the numbers are those of old versions of Slicer
_TO_LPS = np.array([-1.0, -1.0, 1.0])
_FCSV_COLUMNS = "id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID"


@dataclass(frozen=True)
class LandmarkFormat:
    """One kind of landmark file.

    Parameters
    ----------
    suffix : end of file names, lower case.
    read : landmarks of a file's text.
    write : text of landmarks.
    description : for people.
    """

    suffix: str
    read: Callable[[Path, str], Landmarks]
    write: Callable[[Landmarks], str]
    description: str


def is_landmarks(path: str | os.PathLike[str]) -> bool:
    """True if the end of a name says that it is a landmark file.

    Examples
    --------
    >>> is_landmarks("mouse.mrk.json"), is_landmarks("session.json")
    (True, False)
    """
    return _row(Path(path)) is not None


def read_landmarks(path: str | os.PathLike[str]) -> Landmarks:
    """Read landmarks, in LPS.

    Parameters
    ----------
    path : a file of one of :data:`LANDMARK_FORMATS`.

    Raises
    ------
    VolumeFileError
        In one sentence, with the line or the landmark that is wrong.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "marks.fcsv"
    >>> write_landmarks(Landmarks([[1, 2, 3]], ("nose",)), file)
    >>> read_landmarks(file).names
    ('nose',)
    """
    place = regular_file(as_path(path))
    row = check_landmark_target(place)
    with Damage(place, "leave out what is no landmark"):
        if place.stat().st_size > _LONGEST:
            raise fail(place, "it is far too large for a file of landmarks.")
        text = place.read_bytes().decode("utf-8-sig").replace("\r\n", "\n")
        text = text.replace("\r", " " if "\n" in text else "\n")  # within a line Slicer leaves some of other programs
        return row.read(place, text)


def describe_landmarks(path: str | os.PathLike[str]) -> dict[str, str]:
    """What is in a landmark file, for people."""
    place, found = Path(path), read_landmarks(path)
    low, high = (", ".join(f"{c:.6g}" for c in end) for end in (found.points.min(axis=0), found.points.max(axis=0)))
    rows = {"file": shown(place.name), "kind": check_landmark_target(place).description,
            "landmarks": str(len(found)), "from": low, "to": high, "pairs": "no" if found.fixed is None else "yes"}
    return {**rows, **{f"note {k + 1}": text for k, text in enumerate(found.notes)}}


def write_landmarks(landmarks: Landmarks, path: str | os.PathLike[str], *, overwrite: bool = True) -> None:
    """Write landmarks, whole or not at all; the end of the name chooses the format.

    Slicer's files hold places in space (LPS is written) without the fixed ones; BigWarp's file holds both.
    """
    place = as_path(path)
    row = check_landmark_target(place)
    if row.suffix != ".csv" and landmarks.points.shape[1] != 3:
        raise fail(place, f"a {row.description} holds places in space, and these landmarks have two coordinates.")
    with atomic_write(place, overwrite=overwrite) as file:
        file.write(row.write(landmarks).encode("utf-8"))


def check_landmark_target(path: Path) -> LandmarkFormat:
    """The format that the end of a name says; VolumeFileError if it is none."""
    row = _row(path)
    if row is None:
        raise fail(path, f"the end of its name says no kind of landmark file; known are {landmark_suffixes()}.")
    return row


def landmark_suffixes() -> str:
    """The suffixes of landmark files, for messages."""
    return ", ".join(row.suffix for row in LANDMARK_FORMATS.values())


def _row(path: Path) -> LandmarkFormat | None:
    return next((row for row in LANDMARK_FORMATS.values() if path.name.lower().endswith(row.suffix)), None)


def _coordinates(path: Path, words: Sequence[Any], which: str) -> list[float]:
    try:
        values = [float(word) for word in words]
    except (TypeError, ValueError, OverflowError):  # a whole number of 400 digits fits into no float
        raise fail(path, f"the coordinates of {which} are no numbers.") from None
    if not all(map(math.isfinite, values)):
        raise fail(path, f"the coordinates of {which} are not finite.")
    return values


# ---- BigWarp ---------------------------------------------------------------------------------------------------------


def _read_bigwarp(path: Path, text: str) -> Landmarks:
    rows = [row for row in csv.reader(io.StringIO(text)) if row]
    names, active = list[str](), list[bool]()
    moving, fixed = list[list[float]](), list[list[float]]()
    for number, row in enumerate(rows, 1):
        half = (len(row) - 2) // 2
        if half not in (2, 3) or len(row) != 2 + 2 * half or len(row) != len(rows[0]):
            raise fail(path, f"row {number} has {len(row)} columns; BigWarp writes a name, true or false, the moving "
                             "and the fixed place.")
        if row[1].strip().lower() not in ("true", "false"):
            raise fail(path, f"row {number} says '{shown(row[1], 20)}' where BigWarp writes true or false.")
        places = _unset_as_nan(path, row[2:], f"row {number}")
        if not np.isfinite(places[:half]).all():  # BigWarp keeps a row for a point that is set on one side only
            continue
        names.append(row[0])
        active.append(row[1].strip().lower() == "true")
        moving.append(places[:half])
        fixed.append(places[half:])
    if not names:
        raise fail(path, "there is no landmark in it that has a moving place.")
    skipped = len(rows) - len(names)
    notes = (f"{skipped} landmarks without a moving place were left out",) if skipped else ()
    return Landmarks(np.array(moving), tuple(names), np.array(fixed), np.array(active), notes)


def _unset_as_nan(path: Path, words: Sequence[str], which: str) -> list[float]:
    try:
        values = [float(word) for word in words]
    except ValueError:
        raise fail(path, f"the coordinates of {which} are no numbers.") from None
    return [value if math.isfinite(value) else math.nan for value in values]


def _write_bigwarp(landmarks: Landmarks) -> str:
    out = io.StringIO()
    fixed = np.full_like(landmarks.points, np.nan) if landmarks.fixed is None else landmarks.fixed
    writer = csv.writer(out, quoting=csv.QUOTE_ALL, lineterminator="\n")
    assert landmarks.active is not None
    for name, on, a, b in zip(landmarks.names, landmarks.active, landmarks.points, fixed, strict=True):
        places = [repr(float(c)) if math.isfinite(c) else "Infinity" for c in (*a, *b)]
        writer.writerow([name, str(bool(on)).lower(), *places])
    return out.getvalue()


# ---- 3D Slicer -------------------------------------------------------------------------------------------------------


def _read_fcsv(path: Path, text: str) -> Landmarks:
    ras, columns = True, _FCSV_COLUMNS.split(",")
    names, places, active = list[str](), list[list[float]](), list[bool]()
    for row in csv.reader(io.StringIO(text)):
        if not row:
            continue
        key, _, value = row[0].lstrip("# ").partition("=")
        if row[0].startswith("#"):
            if key.strip() == "CoordinateSystem":
                ras = _is_ras(path, value.strip())
            elif key.strip() == "columns":
                columns = [value.strip(), *(c.strip() for c in row[1:])]
            continue
        found = dict(zip(columns, row, strict=False))
        which = f"landmark {len(names) + 1}"
        places.append(_coordinates(path, [found.get(axis) for axis in "xyz"], which))
        names.append(found.get("label", ""))
        active.append(found.get("sel", "1").strip() != "0")
    return _from_slicer(path, names, places, active, [ras] * len(names))


def _is_ras(path: Path, word: Any) -> bool:
    if str(word) not in _RAS:
        raise fail(path, f"its coordinate system '{shown(word, 20)}' is neither LPS nor RAS.")
    return _RAS[str(word)]


def _from_slicer(path: Path, names: list[str], places: list[list[float]], active: list[bool],
                 ras: list[bool]) -> Landmarks:
    if not places:
        raise fail(path, "there is no landmark in it.")
    points = np.array(places) * np.where(np.array(ras)[:, None], _TO_LPS, 1.0)
    return Landmarks(points, tuple(names), active=np.array(active))


def _write_fcsv(landmarks: Landmarks) -> str:
    out = io.StringIO()
    out.write(f"# Markups fiducial file version = 5.6\n# CoordinateSystem = LPS\n# columns = {_FCSV_COLUMNS}\n")
    writer = csv.writer(out, lineterminator="\n")
    assert landmarks.active is not None
    for k, (name, on, place) in enumerate(zip(landmarks.names, landmarks.active, landmarks.points, strict=True)):
        writer.writerow([k + 1, *map(repr, place.tolist()), 0, 0, 0, 1, 1, int(on), 0, name, "", ""])
    return out.getvalue()


def _read_markups(path: Path, text: str) -> Landmarks:
    data = json.loads(text)
    lists = data.get("markups") if isinstance(data, dict) else None
    if not isinstance(lists, list):
        raise fail(path, "this is no file of Slicer's markups: it has no list markups.")
    names, places, active, ras = list[str](), list[list[float]](), list[bool](), list[bool]()
    for markup in lists:
        points = markup.get("controlPoints") if isinstance(markup, dict) else None
        if not isinstance(points, list):
            raise fail(path, "one of its markups has no list controlPoints.")
        system = _is_ras(path, markup.get("coordinateSystem", "LPS"))
        for point in points:
            which = f"landmark {len(names) + 1}"
            if not isinstance(point, dict):
                raise fail(path, f"{which} is not an object with a position.")
            if point.get("positionStatus", "defined") != "defined":  # a template's place that was never set
                continue
            position = point.get("position")
            if not isinstance(position, list) or len(position) != 3:
                raise fail(path, f"{which} has no position of three numbers.")
            places.append(_coordinates(path, position, which))
            names.append(str(point.get("label", "")))
            active.append(point.get("selected") is not False)
            ras.append(system)
    return _from_slicer(path, names, places, active, ras)


def _write_markups(landmarks: Landmarks) -> str:
    assert landmarks.active is not None
    points = [{"id": str(k + 1), "label": name, "position": place.tolist(), "selected": bool(on),
               "positionStatus": "defined"}
              for k, (name, on, place) in enumerate(zip(landmarks.names, landmarks.active, landmarks.points,
                                                        strict=True))]
    schema = ("https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/"
              "markups-schema-v1.0.3.json#")
    markup = {"type": "Fiducial", "coordinateSystem": "LPS", "coordinateUnits": "mm", "controlPoints": points}
    return json.dumps({"@schema": schema, "markups": [markup]}, indent=1, ensure_ascii=False) + "\n"


LANDMARK_FORMATS: dict[str, LandmarkFormat] = {
    "markups": LandmarkFormat(".mrk.json", _read_markups, _write_markups, "file of Slicer's markups"),
    "fcsv": LandmarkFormat(".fcsv", _read_fcsv, _write_fcsv, "file of Slicer's fiducials"),
    "bigwarp": LandmarkFormat(".csv", _read_bigwarp, _write_bigwarp, "file of BigWarp's landmarks"),
}
"""All kinds of landmark files by name."""

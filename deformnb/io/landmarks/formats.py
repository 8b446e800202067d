"""Landmark files: their table of formats, reading and writing, and the table of control points.

Places are LPS always; a file that states RAS is converted. Lengths are in the unit that a file states; those of
Slicer, ITK and elastix are millimetres, and of any other file without a unit the numbers are those of its volume. Of
pairs the moving points are the places, the fixed ones their counterparts.

Control points are read from the text that the table of points copies, a spreadsheet passes on, or BigWarp writes.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.io.files.addresses import input_path
from deformnb.io.files.atomic import atomic_write
from deformnb.io.files.errors import Damage, fail, printable
from deformnb.io.files.objects import copied_from_disk, copied_to_disk, is_open_file, name_for
from deformnb.io.files.paths import as_path, named_path, regular_file
from deformnb.io.files.texts import LONGEST_TABLE, decode_text
from deformnb.io.landmarks.fcsv import format_fcsv, read_fcsv_points
from deformnb.io.landmarks.json_files import (
    detect_landmarks,
    from_slicer,
    read_json,
    write_bigwarp_json,
    write_markups,
)
from deformnb.io.landmarks.tables import is_table, read_csv, write_bigwarp, write_table, write_tabs
from deformnb.io.landmarks.text_files import (
    read_nts,
    read_prm,
    read_tps,
    read_txt,
    read_xyz,
    write_morphologika,
    write_nts,
    write_prm,
    write_tps,
    write_txt,
    write_xyz,
)
from deformnb.rbf.points import ControlPoints
from deformnb.warping.points import Landmarks, LandmarksLike, as_landmarks

_LONGEST = 1 << 26  # bytes: some hundred thousand landmarks


@dataclass(frozen=True)
class LandmarkFormat:
    """One kind of landmark file.

    Parameters
    ----------
    suffix : end of file names, lower case.
    read : landmarks of a file's text.
    write : text of landmarks.
    description : for people.
    dimensions : of the places that it can hold; has_names, has_fixed : whether it holds names, and fixed places too.
    has_open : whether a fixed place may be open.
    unit : of lengths, of programs that mean millimetres; "" where they mean that of the volume.
    """

    suffix: str
    read: Callable[[Path, str], Landmarks]
    write: Callable[[Landmarks], str]
    description: str
    dimensions: tuple[int, ...] = (3,)
    has_names: bool = False
    has_fixed: bool = False
    has_open: bool = False
    unit: str = ""


def is_landmarks(path: str | os.PathLike[str]) -> bool:
    """Check for the suffix of a landmark file, or for .json that an existing file holds landmarks.

    Examples
    --------
    >>> is_landmarks("mouse.mrk.json"), is_landmarks("session.json")
    (True, False)
    """
    return _row(named_path(path)) is not None


def read_landmarks(path: str | os.PathLike[str] | BinaryIO, *, suffix: str | None = None) -> Landmarks:
    """Read landmarks, in LPS.

    Parameters
    ----------
    path : a file of one of :data:`LANDMARK_FORMATS`, its address, or an open file of bytes.
    suffix : of an open file, by which its format is known (".fcsv"); by default that of its name.

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
    if is_open_file(path):
        with copied_to_disk(path, name_for(path, suffix)) as copy:
            return read_landmarks(copy)
    place = regular_file(input_path(path))
    row = check_landmark_target(place)
    with Damage(place, "leave out other lines than landmarks"):
        if place.stat().st_size > _LONGEST:
            raise fail(place, "it is far too large for a file of landmarks.")
        text, notes = decode_text(place, place.read_bytes())
        found = row.read(place, text)
        return replace(found, notes=(*found.notes, *notes)) if notes else found


def describe_landmarks(path: str | os.PathLike[str]) -> dict[str, str]:
    """Describe a landmark file for people."""
    place, found = input_path(path), read_landmarks(path)
    low, high = (", ".join(f"{c:.6g}" for c in end) for end in (found.points.min(axis=0), found.points.max(axis=0)))
    rows = {
        "file": printable(place.name),
        "kind": check_landmark_target(place).description,
        "landmarks": str(len(found)),
        "from": low,
        "to": high,
        "pairs": "no" if found.fixed is None else "yes",
    }
    rows |= {"unit": found.unit} if found.unit else {}
    return {**rows, **{f"note {k + 1}": text for k, text in enumerate(found.notes)}}


def write_landmarks(
    landmarks: LandmarksLike,
    path: str | os.PathLike[str] | BinaryIO,
    *,
    overwrite: bool = True,
    suffix: str | None = None,
) -> None:
    """Write landmarks to a file, atomically, or to an open one; the suffix chooses the format.

    Data that a format cannot hold are left out: see :class:`LandmarkFormat`. Slicer's files are written in LPS and in
    millimetres, lists of points of elastix too; in other formats, which state no unit, numbers are not converted.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "marks.mrk.json"
    >>> write_landmarks(Landmarks([[1, 2, 3], [4, 5, 6]], ("nose", "tail")), file)
    >>> read_landmarks(file).points.tolist()
    [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    """
    if is_open_file(path):
        with copied_from_disk(path, name_for(path, suffix)) as copy:
            write_landmarks(landmarks, copy)
        return
    place, landmarks = as_path(path), as_landmarks(landmarks)
    row = check_landmark_target(place)
    if landmarks.points.shape[1] not in row.dimensions:
        raise fail(place, f"a {row.description} holds places in space, and these landmarks have two coordinates.")
    if row.has_fixed and not row.has_open and landmarks.fixed is not None:
        is_open = ~np.isfinite(landmarks.fixed).all(axis=1)
        if is_open.any():
            raise fail(
                place,
                f"landmark {int(np.argmax(is_open)) + 1} has no fixed place, and a {row.description} has "
                "no room for an open one; leave it out, or write a .csv.",
            )
    with atomic_write(place, overwrite=overwrite) as file:
        file.write(row.write(landmarks.to_unit(row.unit)).encode("utf-8"))


def check_landmark_target(path: Path) -> LandmarkFormat:
    """The format of a suffix; VolumeFileError if there is none."""
    row = _row(path)
    if row is None:
        raise fail(path, f"its suffix belongs to no kind of landmark file; known are {landmark_suffixes()}.")
    return row


def landmark_suffixes() -> str:
    """The suffixes of landmark files, for messages."""
    return ", ".join(row.suffix for row in LANDMARK_FORMATS.values())


def _row(path: Path) -> LandmarkFormat | None:
    name = path.name.lower()
    found = next((row for row in LANDMARK_FORMATS.values() if name.endswith(row.suffix)), None)
    if found is None and name.endswith(".json") and (kind := detect_landmarks(path)):
        return LANDMARK_FORMATS[kind]
    return found


def _read_text(path: Path, text: str) -> Landmarks:
    """A table with a line of names, or a format of :func:`read_txt`."""
    return read_csv(path, text) if is_table(text) else read_txt(path, text)


# ---- 3D Slicer -------------------------------------------------------------------------------------------------------


def _read_fcsv(path: Path, text: str) -> Landmarks:
    points = list(read_fcsv_points(path, text))
    names = [found.get("label", "") for found, _, _ in points]
    active = [found.get("sel", "1").strip() != "0" for found, _, _ in points]
    return from_slicer(path, names, [place for _, place, _ in points], active, [ras for _, _, ras in points])


def _write_fcsv(landmarks: Landmarks) -> str:
    assert landmarks.active is not None
    rows = zip(landmarks.names, landmarks.active, landmarks.points.tolist(), strict=True)
    return format_fcsv((k, place, (1, int(on), 0), (name, "", "")) for k, (name, on, place) in enumerate(rows, 1))


LANDMARK_FORMATS: dict[str, LandmarkFormat] = {
    "markups": LandmarkFormat(
        ".mrk.json", read_json, write_markups, "file of Slicer's markups", has_names=True, unit="mm"
    ),
    "bigwarp json": LandmarkFormat(
        ".bigwarp.json",
        read_json,
        write_bigwarp_json,
        "JSON of BigWarp's landmarks",
        (2, 3),
        has_names=True,
        has_fixed=True,
        has_open=True,
    ),
    "fcsv": LandmarkFormat(".fcsv", _read_fcsv, _write_fcsv, "file of Slicer's fiducials", has_names=True, unit="mm"),
    "table": LandmarkFormat(
        ".points.csv",
        read_csv,
        write_table,
        "table with a line of names (OpenSim Creator)",
        (2, 3),
        has_names=True,
        has_fixed=True,
        has_open=True,
    ),
    "bigwarp": LandmarkFormat(
        ".csv",
        read_csv,
        write_bigwarp,
        "file of BigWarp's landmarks, or a table",
        (2, 3),
        has_names=True,
        has_fixed=True,
        has_open=True,
    ),
    "tab table": LandmarkFormat(
        ".tsv",
        read_csv,
        write_tabs,
        "table with tabs between its columns",
        (2, 3),
        has_names=True,
        has_fixed=True,
        has_open=True,
    ),
    "points": LandmarkFormat(".xyz", read_xyz, write_xyz, "list of points of vedo or VTK"),
    "tps": LandmarkFormat(".tps", read_tps, write_tps, "TPS file", (2, 3), has_fixed=True),
    "nts": LandmarkFormat(".nts", read_nts, write_nts, "NTS file", (2, 3), has_fixed=True),
    "morphologika": LandmarkFormat(
        ".morphologika.txt", read_txt, write_morphologika, "Morphologika file", (2, 3), has_fixed=True
    ),
    "elastix": LandmarkFormat(
        ".txt", _read_text, write_txt, "list of points of elastix, Morphologika's, or a table", (2, 3), unit="mm"
    ),
    "pygem": LandmarkFormat(".prm", read_prm, write_prm, "parameter file of PyGeM", has_fixed=True),
}
"""All kinds of landmark files by name."""


_LONGEST_ID = 15  # digits, which every program that reads tables preserves

_AXES = {2: "ab", 3: "xyz"}
_TRUE, _FALSE = ("true", "1", "yes", "on"), ("false", "0", "no", "off")


class ReadPoints(NamedTuple):
    """Points with the rows of a text in them.

    Attributes
    ----------
    points : the set after it.
    changed : ids of points that were there before; added : of those that are new.
    """

    points: ControlPoints
    changed: tuple[int, ...]
    added: tuple[int, ...]


def points_from_csv(text: str, into: ControlPoints) -> ReadPoints:
    r"""A set of points with the rows of a text in it.

    The text has a line of names, of which ``source_a`` and ``source_b`` (in space ``source_x``, ``_y``, ``_z``) must be
    among; ``target_...``, ``id``, ``name``, ``active``, ``locked``, ``weight`` and ``radius`` may be. A row with the id
    of a point changes that point, any other row adds one; empty cells of a row change nothing, or are defaults. Without
    a line of names each row is a place, or a source and a target, or a row of BigWarp (name, true or false, moving,
    fixed). Columns are separated by tabs, semicolons or commas.

    Raises
    ------
    DeformError
        If the text is no such table; it names the row.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0]], names=["tail"])
    >>> read = points_from_csv("id,name,source_a,source_b,target_a,target_b\n0,,1,2,3,4\n,fin,5,6,,\n", points)
    >>> read.points.names, read.points.target.tolist(), read.changed, read.added
    (('tail', 'fin'), [[3.0, 4.0], [5.0, 6.0]], (0,), (1,))
    """
    if not isinstance(text, str):
        raise DeformError(f"points are read from text, got {short_value(text)}.")
    if not isinstance(into, ControlPoints):
        raise DeformError(f"points are read into ControlPoints, got {short_value(into)}.")
    if len(text) > LONGEST_TABLE:
        raise DeformError(f"the text has {len(text)} characters; at most {LONGEST_TABLE} are read.")
    rows = _rows(text)
    if not rows:
        raise DeformError("there are no points in the text: it is empty.")
    names = [cell.lower() for cell in rows[0]]
    if "source_a" in names or "source_x" in names:
        records = [_label_fields(number, names, row, into.dim) for number, row in enumerate(rows[1:], 2)]
    else:
        records = [_nameless(number, row, into.dim) for number, row in enumerate(rows, 1)]
    return _merge(into, records)


def _rows(text: str) -> list[list[str]]:
    first = text.lstrip("\ufeff\r\n ").split("\n", 1)[0]
    delimiter = next((d for d in "\t;" if d in first), ",")
    try:
        table = csv.reader(io.StringIO(text.lstrip("\ufeff")), delimiter=delimiter)
        rows = [[cell.strip() for cell in row] for row in table]
    except csv.Error as error:
        raise DeformError(f"the text is no table: {error}.") from None
    if delimiter != ",":  # where a comma is no column it is a decimal point, in spreadsheets of half the world
        rows = [[_use_decimal_point(cell) for cell in row] for row in rows]
    return [row for row in rows if any(row)]


def _use_decimal_point(cell: str) -> str:
    dotted = cell.replace(",", ".", 1)
    try:
        float(dotted)
    except ValueError:
        return cell
    return dotted


def _label_fields(number: int, names: list[str], row: list[str], dim: int) -> dict[str, Any]:
    if len(row) > len(names):
        raise DeformError(f"row {number} has {len(row)} columns, the line of names {len(names)}.")
    given = {name: cell for name, cell in zip(names, row, strict=False) if cell}
    record: dict[str, Any] = {}
    for which in ("source", "target"):
        cells = [given.get(f"{which}_{axis}") for axis in _AXES[dim]]
        if any(cells):
            record[which] = [parse_number(cell or "", f"the {which} of row {number}") for cell in cells]
    if "source" not in record and "id" not in given:
        raise DeformError(f"row {number} has no source; points of this set need {_expected_columns(dim)}.")
    for key in ("weight", "radius"):
        if key in given:
            record[key] = parse_number(given[key], f"the {key} of row {number}")
    for key in ("active", "locked"):
        if key in given:
            record[key] = _flag(given[key], f"'{key}' of row {number}")
    if "name" in given:
        record["name"] = given["name"]
    if "id" in given:
        if not given["id"].isdecimal() or len(given["id"]) > _LONGEST_ID:
            raise DeformError(f"the id of row {number} is no whole number: {given['id']:.20}.")
        record["id"] = int(given["id"])
    return record


def _nameless(number: int, row: list[str], dim: int) -> dict[str, Any]:
    record: dict[str, Any] = {}
    if len(row) == 2 + 2 * dim and row[1].lower() in ("true", "false"):
        record = {"name": row[0], "active": row[1].lower() == "true"}
        row = row[2:]
    if len(row) not in (dim, 2 * dim):
        raise DeformError(
            f"row {number} has {len(row)} columns; points of this set are {_expected_columns(dim)}, twice as many "
            "with a target, or rows under a line of names such as "
            f"source_{_AXES[dim][0]}."
        )
    places = [parse_number(cell, f"row {number}") for cell in row]
    record["source"] = places[:dim]
    if len(places) > dim:
        record["target"] = places[dim:]
    return record


def _expected_columns(dim: int) -> str:
    return f"{' and '.join(_AXES[dim])} ({dim} numbers)"


def _flag(cell: str, what: str) -> bool:
    if cell.lower() not in (*_TRUE, *_FALSE):
        raise DeformError(f"{what} is neither true nor false: {cell:.20}.")
    return cell.lower() in _TRUE


def parse_number(text: str, what: str) -> float:
    """A finite number that a user wrote.

    >>> parse_number(" 2.5", "the weight")
    2.5
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DeformError(f"{what} must be a number, got {text.strip()[:20] or 'nothing'!r}.")
    return value


def _merge(into: ControlPoints, records: list[dict[str, Any]]) -> ReadPoints:
    columns: dict[str, list[Any]] = {
        name: list(getattr(into, name)) for name in ("source", "target", "active", "weight", "locked", "radius")
    }
    columns["name"] = list(into.names)
    place, ids, changed = {point: k for k, point in enumerate(into.ids)}, list(into.ids), list[int]()
    for record in records:
        k = place.get(record.pop("id", None))
        if k is None:
            if "source" not in record:
                raise DeformError("a row with the id of no point has no source; a new point needs a place.")
            whole = {
                "target": record["source"],
                "active": True,
                "weight": 1.0,
                "locked": False,
                "radius": math.nan,
                "name": "",
                **record,
            }
            ids.append(into.next_id + len(ids) - len(into))
            for name, values in columns.items():
                values.append(whole[name])
        else:
            changed.append(ids[k])
            for name, value in record.items():
                columns[name][k] = value
    names = tuple(columns.pop("name"))
    arrays: dict[str, Any] = {
        name: np.array(values, dtype=getattr(into, name).dtype) for name, values in columns.items()
    }
    for name in ("source", "target"):
        arrays[name] = arrays[name].reshape(-1, into.dim)
    next_id = max([into.next_id, *(i + 1 for i in ids)])
    made = replace(into, ids=tuple(ids), names=names, next_id=next_id, numbers=(), **arrays)
    return ReadPoints(made, tuple(dict.fromkeys(changed)), tuple(ids[len(into) :]))

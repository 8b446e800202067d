"""Landmarks as tables (.csv): BigWarp's, which has no line of names, and those of others, which have one or none.

A line of names may call its columns as OpenSim Creator (name, x, y, z), Slicer (label, r, a, s), napari (axis-0 to
axis-2, along z, y and x) and spreadsheets do, with a unit in brackets. Fixed places have names such as fixed_x,
target_x or x2. OpenSim Creator ignores columns beyond its four, so that a table of pairs opens there as well.
"""

from __future__ import annotations

import csv
import io
import math
import re
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from deformnb.io.files.errors import fail, printable
from deformnb.io.landmarks.coordinates import coordinates, drop_missing, is_comment, is_missing
from deformnb.volume.units import find_unit, ratio
from deformnb.warping.points import Landmarks

TableRows = list[tuple[int, list[str]]]

_AXES = {
    "x": (0, 1.0),
    "y": (1, 1.0),
    "z": (2, 1.0),
    "r": (0, -1.0),
    "a": (1, -1.0),
    "s": (2, 1.0),
    "l": (0, 1.0),
    "p": (1, 1.0),
}  # position among LPS, and the sign
_MOVING = {"moving", "mov", "source", "src", "from", "before", "1"}
_FIXED = {"fixed", "fix", "target", "tgt", "to", "after", "2"}
_PLAIN = {"position", "pos", "coord", "coordinate", "coordinates", "point", "landmark", "centroid", "center", "centre"}
_NAMES = (
    "name",
    "label",
    "landmark",
    "landmarks",
    "point",
    "points",
    "title",
    "description",
    "id",
    "index",
    "number",
    "nr",
    "",
)
_ACTIVE = ("active", "selected", "enabled", "use")
_VOXELS = {"px", "pixel", "pixels", "vx", "voxel", "voxels", "index"}
_FALSE = ("false", "0", "no", "off")
_HEAD_LENGTH = 1 << 12  # characters that contain a line of names and the first rows


def read_csv(path: Path, text: str) -> Landmarks:
    """Landmarks of a table: of BigWarp, with a line of names, or of places with or without a name."""
    rows = _rows(text)
    if not rows:
        raise fail(path, "there is no landmark in it.")
    first = rows[0][1]
    if len(first) in (6, 7, 8, 9) and (
        first[1].lower() in ("true", "false") or (all(map(_is_number, first[-4:])) and not _is_number(first[1]))
    ):
        return _read_bigwarp(path, rows)
    return _read_named(path, rows) if _is_heading(first) else _read_nameless(path, rows)


def _rows(text: str) -> TableRows:
    """The rows that are not empty, with the numbers of their lines; columns end at tabs, semicolons or commas."""
    first = text.lstrip("\n ").split("\n", 1)[0]
    delimiter = next((d for d in "\t;" if d in first), ",")
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, skipinitialspace=True)
    rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader]
    kept = [(number, row) for number, row in rows if any(row) and not is_comment(row[0])]
    if delimiter != ",":  # where a comma is no column it is a decimal point, in spreadsheets of half the world
        has_thousands = any(map(_THOUSANDS.fullmatch, (cell for _, row in kept for cell in row)))
        kept = [(number, [_use_decimal_point(cell, has_thousands) for cell in row]) for number, row in kept]
    return kept


# A dot that parts thousands, where a comma is the decimal point; 1.234 alone is a small number.
_THOUSANDS = re.compile(r"[-+]?\d{1,3}(\.\d{3})+,\d+")
_GROUPED = re.compile(r"[-+]?\d{1,3}(\.\d{3})+(,\d+)?")


def _use_decimal_point(cell: str, has_thousands: bool) -> str:
    """A number with a decimal point instead of a comma; anything else unchanged."""
    if has_thousands and _GROUPED.fullmatch(cell):
        cell = cell.replace(".", "")
    dotted = cell.replace(",", ".")
    return dotted if _is_number(dotted) else cell


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def _is_heading(row: list[str]) -> bool:
    """Check that not even the last two columns are numbers, or missing ones."""
    return not any(_is_number(cell) or (cell and is_missing(cell)) for cell in row[-2:])


# ---- BigWarp ---------------------------------------------------------------------------------------------------------


def _read_bigwarp(path: Path, rows: TableRows) -> Landmarks:
    """Rows of a name, true or false, in new versions a number, the moving and the fixed place."""
    width = len(rows[0][1])
    half = (width - 2) // 2
    names, active, places = list[str](), list[bool](), list[list[float]]()
    for number, row in rows:
        if len(row) != width:
            raise fail(
                path,
                f"line {number} has {len(row)} columns; BigWarp writes a name, true or false, the moving "
                "and the fixed place.",
            )
        if row[1].lower() not in ("true", "false"):
            raise fail(
                path, f"line {number}, column 2: {printable(row[1], 20)!r} is given where BigWarp writes true or false."
            )
        names.append(row[0])
        active.append(row[1].lower() == "true")
        places.append(coordinates(path, row[-2 * half :], f"line {number}", width - 2 * half + 1))
    both = np.array(places)
    return drop_missing(path, both[:, :half], both[:, half:], names, active, has_open=True)


def write_bigwarp(landmarks: Landmarks) -> str:
    """Rows of BigWarp; places that are not set are infinite."""
    out = io.StringIO()
    fixed = np.full_like(landmarks.points, np.nan) if landmarks.fixed is None else landmarks.fixed
    writer = csv.writer(out, quoting=csv.QUOTE_ALL, lineterminator="\n")
    assert landmarks.active is not None
    for name, on, a, b in zip(landmarks.names, landmarks.active, landmarks.points, fixed, strict=True):
        places = [repr(float(c)) if math.isfinite(c) else "Infinity" for c in (*a, *b)]
        writer.writerow([name, str(bool(on)).lower(), *places])
    return out.getvalue()


# ---- tables of others ------------------------------------------------------------------------------------------------


@dataclass
class _Columns:
    """Columns of a table by their meaning.

    Parameters
    ----------
    moving, fixed : by axis the position of its column, and its sign and the ratio of its unit to that of all.
    name, active : positions of columns.
    notes : remarks.
    unit : of the places; "" where no column states one.
    """

    moving: dict[int, tuple[int, float]] = field(default_factory=dict)
    fixed: dict[int, tuple[int, float]] = field(default_factory=dict)
    name: int | None = None
    active: int | None = None
    notes: tuple[str, ...] = ()
    unit: str = ""


def _read_named(path: Path, rows: TableRows) -> Landmarks:
    columns = _columns(path, *rows[0])
    dim = max(columns.moving) + 1
    names, active, moving, fixed = list[str](), list[bool](), list[list[float]](), list[list[float]]()
    for number, row in rows[1:]:
        cells = [*row, *[""] * (len(rows[0][1]) - len(row))]
        both = [
            [
                sign * coordinates(path, [cells[at]], f"line {number}", at + 1)[0]
                for at, sign in (places[axis] for axis in range(dim))
            ]
            if places
            else [math.nan] * dim
            for places in (columns.moving, columns.fixed)
        ]
        moving.append(both[0])
        fixed.append(both[1])
        names.append("" if columns.name is None else cells[columns.name])
        active.append(columns.active is None or cells[columns.active].lower() not in _FALSE)
    found = drop_missing(
        path,
        np.array(moving).reshape(-1, dim),
        np.array(fixed).reshape(-1, dim) if columns.fixed else None,
        names,
        active,
        columns.notes,
        has_open=True,
    )
    return replace(found, unit=columns.unit)


def _columns(path: Path, line: int, heading: list[str]) -> _Columns:
    found, units, napari = _Columns(), dict[int, str](), list[tuple[int, int]]()
    words = [_words(path, line, k, cell, units) for k, cell in enumerate(heading)]
    plain = {word for one in words for word in one}
    for k, one in enumerate(words):
        if len(one) == 2 and one[0] == "axis" and one[1].isdecimal():
            napari.append((int(one[1]), k))
        axes = [word for word in one if word in _AXES]
        rest = set(one) - set(axes[:1])
        if len(axes) != 1 or rest - _MOVING - _FIXED - _PLAIN:
            continue
        if axes[0] not in "xyz" and not ({"r", "a", "s"} <= plain or {"l", "p", "s"} <= plain):
            continue
        axis, sign = _AXES[axes[0]]
        (found.fixed if rest & _FIXED else found.moving).setdefault(axis, (k, sign))
    if napari and not found.moving:
        last = max(number for number, _ in napari)
        found.moving = {last - number: (k, 1.0) for number, k in napari if last - number < 3}
        found.notes = ("the columns of napari are taken as lengths along z, y and x",)
    if sorted(found.moving) not in ([0, 1], [0, 1, 2]) or (found.fixed and sorted(found.fixed) != sorted(found.moving)):
        raise fail(
            path,
            f"line {line} names no columns x, y and z (or x and y), nor as many for fixed places: "
            f"{printable(', '.join(heading), 100)}.",
        )
    taken = {k for k, _ in (*found.moving.values(), *found.fixed.values())}
    joined = ["_".join(one) for one in words]
    found.name = next((k for name in _NAMES for k, one in enumerate(joined) if one == name and k not in taken), None)
    found.active = next((k for name in _ACTIVE for k, one in enumerate(joined) if one == name), None)
    _bring_to_one_unit(found, units)
    return found


def _bring_to_one_unit(found: _Columns, units: dict[int, str]) -> None:
    """Multiply the columns of places so that all are in the unit of x, or of the first that states one."""
    stated = [units.get(k, "") for places in (found.moving, found.fixed) for _, (k, _) in sorted(places.items())]
    found.unit = next((unit for unit in stated if unit), "")
    for places in (found.moving, found.fixed):
        places.update({axis: (k, sign * ratio(units.get(k, ""), found.unit)) for axis, (k, sign) in places.items()})
    if len(set(stated)) > 1:
        found.notes += (f"its columns are measured in different units; all are in {found.unit} now",)


def _words(path: Path, line: int, k: int, cell: str, units: dict[int, str]) -> list[str]:
    """The words of a column's name without its unit, which is noted."""
    plain = cell.lower()
    unit = re.search(r"[(\[]\s*([^)\]]*?)\s*[)\]]\s*$", plain)
    if unit:
        plain = plain[: unit.start()]
    words = [word for word in re.split(r"[^a-z0-9µ\u03bc]+", plain) if word]
    words = [part for word in words for part in (list(word) if re.fullmatch(r"[xyz][12]", word) else [word])]
    last = unit[1] if unit else words[-1] if len(words) > 1 and words[-1] not in _AXES else None
    if last in _VOXELS:
        raise fail(
            path,
            f"line {line}, column {k + 1}: {printable(cell, 30)!r} is in voxels, "
            "which have no place without their volume.",
        )
    known = find_unit(last)
    if known:
        units[k] = known
        words = words if unit else words[:-1]
    return words


def _read_nameless(path: Path, rows: TableRows) -> Landmarks:
    """Rows of a place or two, after a name or none."""
    width = len(rows[0][1])
    named = width in (4, 5, 7) or (width == 3 and not _is_number(rows[0][1][0]))
    count = width - named
    if count not in (2, 3, 4, 6):
        raise fail(
            path,
            f"line {rows[0][0]} has {width} columns; expected are a name, x, y and z, twice as many "
            "coordinates for pairs, or a line of names such as name,x,y,z.",
        )
    names, places = list[str](), list[list[float]]()
    for number, row in rows:
        if len(row) != width:
            raise fail(path, f"line {number} has {len(row)} columns, and line {rows[0][0]} has {width}.")
        names.append(row[0] if named else "")
        places.append(coordinates(path, row[named:], f"line {number}", 1 + named))
    both = np.array(places)
    half = count if count < 4 else count // 2
    return drop_missing(path, both[:, :half], both[:, half:] if count > 3 else None, names, has_open=True)


def write_tabs(landmarks: Landmarks) -> str:
    """Write a table as :func:`write_table`, with tabs between the columns."""
    return write_table(landmarks, "\t")


def write_table(landmarks: Landmarks, delimiter: str = ",") -> str:
    """A line of names and one of each landmark: its name, its place, and its fixed place where there are some."""
    axes = "xyz"[: landmarks.points.shape[1]]
    out = io.StringIO()
    writer = csv.writer(out, delimiter=delimiter, lineterminator="\n")
    writer.writerow(["name", *axes, *([] if landmarks.fixed is None else [f"fixed_{axis}" for axis in axes])])
    for k, (name, place) in enumerate(zip(landmarks.names, landmarks.points.tolist(), strict=True)):
        fixed = [] if landmarks.fixed is None else landmarks.fixed[k].tolist()
        writer.writerow([name, *map(repr, place), *(repr(c) if math.isfinite(c) else "" for c in fixed)])
    return out.getvalue()


def is_table(text: str) -> bool:
    """Check for a text that begins with a line of names of columns, among which are coordinates."""
    rows = _rows(text[:_HEAD_LENGTH].rsplit("\n", 1)[0])
    if not rows or len(rows[0][1]) < 2 or not _is_heading(rows[0][1]):
        return False
    return len({word for cell in rows[0][1] for word in re.split(r"[\s_\-.()\[\]]+", cell.lower())} & set(_AXES)) > 1

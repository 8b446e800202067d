"""Control points from text: what the table of points copies, a spreadsheet hands on, or BigWarp writes."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from deformnb.checks import shown_value
from deformnb.control_points import ControlPoints
from deformnb.errors import DeformError

LONGEST_TEXT = 2**20
"""Characters that are read at most."""

_LONGEST_ID = 15  # digits, which every program that reads tables keeps

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
    of a point changes that point, any other row adds one; what a row leaves empty stays, or is as usual. Without a line
    of names each row is a place, or a source and a target, or a row of BigWarp (name, true or false, moving, fixed).
    Columns are told apart by tabs, semicolons or commas.

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
        raise DeformError(f"points are read from text, got {shown_value(text)}.")
    if len(text) > LONGEST_TEXT:
        raise DeformError(f"the text has {len(text)} characters; at most {LONGEST_TEXT} are read.")
    rows = _rows(text)
    if not rows:
        raise DeformError("there are no points in the text: it is empty.")
    names = [cell.lower() for cell in rows[0]]
    if "source_a" in names or "source_x" in names:
        records = [_named(number, names, row, into.dim) for number, row in enumerate(rows[1:], 2)]
    else:
        records = [_nameless(number, row, into.dim) for number, row in enumerate(rows, 1)]
    return _merged(into, records)


def _rows(text: str) -> list[list[str]]:
    first = text.lstrip("\ufeff\r\n ").split("\n", 1)[0]
    delimiter = next((d for d in "\t;" if d in first), ",")
    try:
        table = csv.reader(io.StringIO(text.lstrip("\ufeff")), delimiter=delimiter)
        rows = [[cell.strip() for cell in row] for row in table]
    except csv.Error as error:
        raise DeformError(f"the text is no table: {error}.") from None
    if delimiter != ",":  # where a comma is no column it is a decimal point, in spreadsheets of half the world
        rows = [[_with_point(cell) for cell in row] for row in rows]
    return [row for row in rows if any(row)]


def _with_point(cell: str) -> str:
    dotted = cell.replace(",", ".", 1)
    try:
        float(dotted)
    except ValueError:
        return cell
    return dotted


def _named(number: int, names: list[str], row: list[str], dim: int) -> dict[str, Any]:
    if len(row) > len(names):
        raise DeformError(f"row {number} has {len(row)} columns, the line of names {len(names)}.")
    given = {name: cell for name, cell in zip(names, row, strict=False) if cell}
    record: dict[str, Any] = {}
    for which in ("source", "target"):
        cells = [given.get(f"{which}_{axis}") for axis in _AXES[dim]]
        if any(cells):
            record[which] = [parsed_number(cell or "", f"the {which} of row {number}") for cell in cells]
    if "source" not in record and "id" not in given:
        raise DeformError(f"row {number} has no source; points of this set need {_wanted(dim)}.")
    for key in ("weight", "radius"):
        if key in given:
            record[key] = parsed_number(given[key], f"the {key} of row {number}")
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
        raise DeformError(f"row {number} has {len(row)} columns; points of this set are {_wanted(dim)}, twice as many "
                          "with a target, or rows under a line of names such as "
                          f"source_{_AXES[dim][0]}.")
    places = [parsed_number(cell, f"row {number}") for cell in row]
    record["source"] = places[:dim]
    if len(places) > dim:
        record["target"] = places[dim:]
    return record


def _wanted(dim: int) -> str:
    return f"{' and '.join(_AXES[dim])} ({dim} numbers)"


def _flag(cell: str, what: str) -> bool:
    if cell.lower() not in (*_TRUE, *_FALSE):
        raise DeformError(f"{what} is neither true nor false: {cell:.20}.")
    return cell.lower() in _TRUE


def parsed_number(text: str, what: str) -> float:
    """A finite number that somebody wrote.

    >>> parsed_number(" 2.5", "the weight")
    2.5
    """
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise DeformError(f"{what} must be a number, got {text.strip()[:20] or 'nothing'!r}.")
    return value


def _merged(into: ControlPoints, records: list[dict[str, Any]]) -> ReadPoints:
    columns: dict[str, list[Any]] = {name: list(getattr(into, name)) for name in
                                     ("source", "target", "active", "weight", "locked", "radius")}
    columns["name"] = list(into.names)
    place, ids, changed = {point: k for k, point in enumerate(into.ids)}, list(into.ids), list[int]()
    for record in records:
        k = place.get(record.pop("id", None))
        if k is None:
            if "source" not in record:
                raise DeformError("a row with the id of no point has no source; a new point needs a place.")
            whole = {"target": record["source"], "active": True, "weight": 1.0, "locked": False, "radius": math.nan,
                     "name": "", **record}
            ids.append(into.next_id + len(ids) - len(into))
            for name, values in columns.items():
                values.append(whole[name])
        else:
            changed.append(ids[k])
            for name, value in record.items():
                columns[name][k] = value
    names = tuple(columns.pop("name"))
    arrays = {name: np.array(values, dtype=getattr(into, name).dtype) for name, values in columns.items()}
    for name in ("source", "target"):
        arrays[name] = arrays[name].reshape(-1, into.dim)
    made = replace(into, ids=tuple(ids), names=names, next_id=max([into.next_id, *(i + 1 for i in ids)]), **arrays)
    return ReadPoints(made, tuple(dict.fromkeys(changed)), tuple(ids[len(into):]))

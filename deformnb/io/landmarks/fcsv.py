"""Lists of points of 3D Slicer in .fcsv files: their lines, which Slicer 4 and 5 write in the same columns."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from deformnb.io.files.errors import fail
from deformnb.io.landmarks.coordinates import coordinates
from deformnb.io.landmarks.json_files import is_ras

_COLUMNS = ("id", "x", "y", "z", "ow", "ox", "oy", "oz", "vis", "sel", "lock", "label", "desc", "associatedNodeID")


def read_fcsv_points(path: Path, text: str) -> Iterator[tuple[dict[str, str], list[float], bool]]:
    """Each point of a file: its fields by the names of their columns, its place (x, y, z), and whether that is RAS.

    Raises
    ------
    VolumeFileError
        If a coordinate is missing or no number, with its line and column.
    """
    ras, columns = True, list(_COLUMNS)
    reader = csv.reader(io.StringIO(text))
    for row in reader:
        if not row:
            continue
        key, _, value = row[0].lstrip("# ").partition("=")
        if row[0].startswith("#"):
            if key.strip() == "CoordinateSystem":
                ras = is_ras(path, value.strip())
            elif key.strip() == "columns":
                columns = [value.strip(), *(one.strip() for one in row[1:])]
            continue
        found = dict(zip(columns, row, strict=False))
        yield found, [_coordinate(path, found, axis, reader.line_num, columns) for axis in "xyz"], ras


def _coordinate(path: Path, found: dict[str, str], axis: str, line: int, columns: list[str]) -> float:
    number = columns.index(axis) + 1 if axis in columns else None
    if axis not in found:
        where = f"line {line}" if number is None else f"line {line}, column {number}"
        raise fail(path, f"{where}: nothing is given where {axis} is expected.")
    return coordinates(path, [found[axis]], f"line {line}", number)[0]


def format_fcsv(
    points: Iterable[tuple[object, Sequence[float], Sequence[int], Sequence[object]]], system: str = "LPS"
) -> str:
    """The text of a file.

    Parameters
    ----------
    points : of each its id, place, whether it is visible, selected and locked (0 or 1), and label, description and id
        of an associated node.
    system : of the places, "LPS" or "RAS".
    """
    out = io.StringIO()
    columns = ",".join(_COLUMNS)
    out.write(f"# Markups fiducial file version = 5.6\n# CoordinateSystem = {system}\n# columns = {columns}\n")
    writer: Any = csv.writer(out, lineterminator="\n")
    for name, place, flags, texts in points:
        writer.writerow([name, *map(repr, place), 0, 0, 0, 1, *flags, *texts])
    return out.getvalue()

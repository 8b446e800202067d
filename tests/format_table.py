"""The table of docs/formats.md: which other program agreed on which format, and by how much at most it differed."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

DOCUMENT = Path(__file__).parents[1] / "docs" / "formats.md"


@dataclass(frozen=True)
class Row:
    """A row: the kind of object, its format, the endings of files, whether it is read and written, and the programs."""

    kind: str
    format: str
    endings: tuple[str, ...]
    is_read: bool
    is_written: bool
    program: str
    difference: float | None


@cache
def table() -> tuple[Row, ...]:
    """All rows of the document."""
    rows, kind = list[Row](), ""
    for line in DOCUMENT.read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            kind = line[3:].strip().lower()
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if not line.startswith("| ") or len(cells) != 6 or cells[0] in ("format", "---"):
            continue
        number = re.match(r"[0-9.e-]+", cells[5])
        rows.append(
            Row(
                kind,
                cells[0],
                tuple(re.findall(r"`([^`]+)`", cells[1])),
                cells[2] == "yes",
                cells[3] == "yes",
                cells[4],
                float(number[0]) if number else None,
            )
        )
    return tuple(rows)


def bound(kind: str, name: str, program: str) -> float:
    """The largest difference that the table states between a format in this package and in another program."""
    [row] = [row for row in table() if (row.kind, row.format, row.program) == (kind, name, program)]
    assert row.difference is not None
    return row.difference

"""The table of formats in docs/formats.md is that of the program, and each figure in it is one that a test holds."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from format_table import DOCUMENT, table

from deformnb.io.landmarks.formats import LANDMARK_FORMATS
from deformnb.io.transforms.formats import TRANSFORM_FORMATS
from deformnb.io.volumes.formats import FORMATS

KINDS = {
    "volumes": {name: (row.suffixes, row.write is not None) for name, row in FORMATS.items()},
    "transforms": {name: (row.suffixes, row.write is not None) for name, row in TRANSFORM_FORMATS.items()},
    "landmarks": {name: ((row.suffix,), True) for name, row in LANDMARK_FORMATS.items()},
}


@pytest.mark.parametrize("kind", KINDS)
def test_the_table_has_every_format_as_it_is(kind: str) -> None:
    rows = [row for row in table() if row.kind == kind]
    assert {row.format for row in rows} == set(KINDS[kind])
    for row in rows:
        suffixes, is_written = KINDS[kind][row.format]
        assert (row.endings, row.is_read, row.is_written) == (suffixes, True, is_written), row


def test_every_row_has_another_program_or_says_that_it_has_none() -> None:
    assert len({(row.kind, row.format, row.program) for row in table()}) == len(table())
    for row in table():
        assert (row.difference is None) == row.program.startswith("none: "), row


def test_a_test_holds_every_figure() -> None:
    """Search the words of tests that request it; a 0 of volumes is held in test files that name the program."""
    sources = "".join(path.read_text(encoding="utf-8") for path in sorted(Path(__file__).parent.rglob("test_*.py")))
    asked = set(re.findall(r'bound\("(\w+)", "([^"]+)", "([^"]+)"\)', sources))
    stated = {
        (row.kind, row.format, row.program)
        for row in table()
        if row.difference is not None and (row.kind != "volumes" or row.difference > 0)
    }
    assert asked == stated
    for row in table():
        if row.kind == "volumes" and row.difference is not None:
            assert row.program.lower().split(",")[0].removeprefix("py") in sources.lower()
    assert DOCUMENT.name in (DOCUMENT.parents[1] / "README.md").read_text(encoding="utf-8")

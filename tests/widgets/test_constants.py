"""The constants of the front end are those of the package."""

from __future__ import annotations

from deformnb.widgets.bundle import SOURCES
from deformnb.widgets.constants import as_typescript


def test_the_front_end_has_the_constants_of_the_package() -> None:
    written = (SOURCES / "maths" / "constants.ts").read_text(encoding="utf-8")
    assert written == as_typescript(), "run: python -m deformnb.widgets.constants > ..."

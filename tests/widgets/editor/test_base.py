"""Pointer settings of the editor: values that a front end may set, and those that code may."""

from __future__ import annotations

from typing import Any

import pytest

from deformnb.errors import DeformError
from deformnb.widgets.editor.base import FRONT_END_TRAITS
from deformnb.widgets.editor.editor import Editor

GOOD = {
    "mirror": {"on": True, "axis": "b", "at": 3.5},
    "snap": 7.5,
    "brush_radius": 12,
    "stop_at_folds": True,
    "front_only": True,
    "window": [-40.0, 250.0],
    "slice": 12,
}


def test_the_page_sets_what_is_right() -> None:
    editor = Editor(slices={"first": -8.0, "spacing": 0.5, "count": 32})
    editor.set_state(GOOD)
    assert {name: getattr(editor, name) for name in GOOD} == GOOD
    assert set(FRONT_END_TRAITS) == set(GOOD)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("mirror", {"on": 1, "axis": "a", "at": 0}),
        ("mirror", {"on": True, "axis": "c", "at": 0}),
        ("mirror", "on"),
        ("mirror", {"on": True, "axis": "a", "at": "3"}),
        ("mirror", {"on": True, "axis": "a"}),
        ("mirror", None),
        ("mirror", {"on": True, "axis": "a", "at": float("inf")}),
        ("mirror", {**GOOD["mirror"], "more": 1}),  # type: ignore[dict-item]
        ("mirror", {"on": True, "axis": ["a"], "at": 0}),
        ("snap", -1),
        ("snap", True),
        ("snap", float("nan")),
        ("snap", "1"),
        ("brush_radius", -0.5),
        ("brush_radius", 1e300),
        ("stop_at_folds", 1),
        ("window", [250.0, -40.0]),
        ("window", [0.0]),
        ("window", "wide"),
        ("slice", "front"),
        ("slice", 1.5),
        ("slice", -1),
    ],
)
def test_what_is_wrong_is_dropped_and_said(name: str, value: Any, caplog: pytest.LogCaptureFixture) -> None:
    editor = Editor()
    before = getattr(editor, name)
    editor.set_state({name: value})
    assert getattr(editor, name) == before
    assert f"the trait '{name}' from the page was dropped" in caplog.text


def test_code_hears_why() -> None:
    editor = Editor()
    with pytest.raises(DeformError, match=r'axis "a" or "b"'):
        editor.mirror = {"on": True, "axis": "x", "at": None}
    with pytest.raises(DeformError, match="0 or a positive length"):
        editor.snap = -2.0
    editor.mirror = {"on": True, "axis": "a", "at": None}
    assert Editor().mirror == {"on": False, "axis": "a", "at": None}

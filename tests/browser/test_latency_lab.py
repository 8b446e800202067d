"""The notebooks of the latency benchmark in JupyterLab, small: each is edited by its hand and all figures come."""

from __future__ import annotations

import importlib.util
from typing import Any

import pytest
from browser.hosts import Lab

from benchmarks.latency_cells import CASES, RIVALS
from benchmarks.latency_page import Seat

pytestmark = [pytest.mark.needs_browser, pytest.mark.needs_gl]


@pytest.mark.nightly
@pytest.mark.parametrize("name", CASES)
def test_a_view_is_edited_and_measured(name: str, browser: Any, lab: Lab) -> None:
    if name in RIVALS and importlib.util.find_spec("trame_pyvista") is None:
        pytest.skip("trame-pyvista is not installed: pip install deformnb[benchmark]")
    seat = Seat(browser, lab, name, 24)
    try:
        assert seat.changes(1.5)
        view, picture = seat.edit(4.0)  # elsewhere than before
        assert view > 0
        assert (picture is not None) == (name not in RIVALS)
        drag = seat.drag(1.0)
        assert drag["view_hz"] > 0 or drag["catch_up_ms"] > 0  # a busy machine may draw the first one after the drag
        assert drag["inputs_hz"] > 0
        if name not in RIVALS:
            assert (drag["picture_hz"] > 0) == (drag["grid_hz"] > 0)
            assert (drag["view_bytes"] == 0) == (name == "Editor + LiveView")
        seat.many(10)
        kernel, page = seat.memory()
        assert min(kernel, page) > 1
    finally:
        seat.close()

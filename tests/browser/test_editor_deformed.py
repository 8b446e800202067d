"""The picture of the deformed volume in the editor: shown at rest for the points that it is of, and for no others."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage, five_points, smooth_picture
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from deformnb.widgets.editor.editor import Editor

pytestmark = pytest.mark.needs_browser


@pytest.fixture
def page(browser: Any) -> Iterator[EditorOnPage]:
    points = five_points().move(4, [80.0, 30.0])
    made = EditorOnPage(browser, Editor(smooth_picture(), points, show_grid=False, overlay="none"))
    yield made
    made.close()


def inner(page: EditorOnPage) -> NDArray[np.int64]:
    """The red of the middle of the picture, away from its points."""
    raster, canvas = page.raster(), page.canvas()
    column = np.abs(raster.columns - 60.0).argmin()
    row = np.abs(raster.rows - 0.0).argmin()
    return canvas[row - 4 : row + 5, column - 4 : column + 5, 0]


def wait_for_deformed(page: EditorOnPage, is_deformed: bool) -> None:
    shown = f"{PAGE}.picture.deformedBy({PAGE}.points.list, {PAGE}.points.shapes) !== null"
    page.wait(shown if is_deformed else f"!({shown})")
    page.wait_settled()


def test_it_is_shown_at_rest_and_not_while_or_after_its_points_move(page: EditorOnPage) -> None:
    picture = smooth_picture()
    warped = inner(page).astype(float)
    other = replace(picture, values=np.full_like(picture.values, 200))
    assert abs(warped.mean() - 200) > 20
    page.editor.deformed_picture = other
    wait_for_deformed(page, True)
    assert_allclose(inner(page), 200, atol=1)
    page.editor.window = [0.0, 400.0]
    page.wait_settled()
    assert_allclose(inner(page), 127.5, atol=1)  # in the window of the picture
    page.editor.window = []
    page.wait_settled()
    page.drag([80.0, 30.0], (6, 0))
    wait_for_deformed(page, False)
    assert abs(inner(page).mean() - 200) > 20
    page.wait_answered()
    page.editor.deformed_picture = other
    wait_for_deformed(page, True)
    assert_allclose(inner(page), 200, atol=1)
    page.editor.deformed_picture = None
    wait_for_deformed(page, False)
    page.editor.points = five_points().move(4, [80.0, 30.0])
    page.wait_answered()
    assert_allclose(inner(page), warped, atol=1)
    assert page.editor.deformed == {}

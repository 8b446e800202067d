"""Tissue dragged out of the editor's picture, in a real browser: drawn as far as the result's box reaches."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from deformnb.imaging.projection import project
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session
from deformnb.volume.plane import Picture
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.studio.editors import make_editor, show_step

pytestmark = pytest.mark.needs_browser


def a_block() -> Volume:
    """Bright, without symmetry, and with a shade that tells its columns apart."""
    values = np.zeros((24, 12, 32), np.uint8)
    values[6:18, 3:9, 8:26] = np.linspace(110, 240, 18).astype(np.uint8)
    values[6:11, 3:9, 8:14] = 0
    return Volume(values, Grid((24, 12, 32), (1.5, 1.5, 1.5), (4.0, 5.0, 6.0)), "block")


def dragged(session: Session, by: tuple[float, float]) -> None:
    """All of it, and the middle a little farther, so that it bends."""
    source = np.concatenate([session.editing.points.source, session.editing.points.source.mean(axis=0, keepdims=True)])
    session.editing.edit_points(
        ControlPoints.from_arrays(source, source + by + np.array([[0.0, 0.0]] * 4 + [[3.0, -2.0]]))
    )


def looked_up(picture: Picture, places: NDArray[np.float64]) -> NDArray[np.float64]:
    """The nearest pixels of a picture; 0 outside."""
    raster = picture.raster
    at = np.round((places - raster.origin) / raster.spacing).astype(int)
    inside = ((at >= 0) & (at < raster.shape[::-1])).all(axis=-1)
    u, v = np.moveaxis(np.where(inside[..., None], at, 0), -1, 0)
    return np.where(inside, 255 * picture.grey()[v, u], 0.0)


def beyond(page: EditorOnPage, picture: Picture) -> NDArray[np.bool_]:
    """The pixels that lie off the picture, by more than one of its own."""
    at, (a0, a1, b0, b1), d = page.raster().points(), picture.raster.box, max(picture.raster.spacing)
    return np.asarray((at[..., 0] < a0 - d) | (at[..., 0] > a1 + d) | (at[..., 1] < b0 - d) | (at[..., 1] > b1 + d))


def test_matter_beyond_the_picture_is_that_of_the_result(open_editor: Any) -> None:
    session = Session(a_block(), view="+y")
    dragged(session, (22.0, -14.0))
    editor = make_editor(session, 420)
    editor.show_grid, editor.overlay = False, "none"
    editor.subject = []  # the whole picture is shown, and what is around it
    page = open_editor(editor)
    assert editor.beyond == []
    assert np.ptp(page.canvas()[..., 0][beyond(page, editor.picture)]) == 0  # nothing but paper
    before = page.js(f"({PAGE}.viewport.view.k)")
    assert session.results.fit_output()
    show_step(editor, session)
    page.wait_settled()
    assert page.js(f"({PAGE}.viewport.view.k)") < before  # all of it is seen
    assert page.js(f"({PAGE}.picture.box)") == pytest.approx(
        editor.picture.raster.box
    )  # and the grid stays where it was
    off = beyond(page, editor.picture)
    shown = page.canvas()[..., 0]
    result = replace(project(session.results.volume(), session.editing.plane), window=editor.picture.window)
    expected = looked_up(result, page.raster().points())
    sheet = page.raster().points()
    a0, a1, b0, b1 = np.add(editor.beyond, (1.5, -1.5, 1.5, -1.5))  # the frame's line lies on its edge
    seen = off & (sheet[..., 0] > a0) & (sheet[..., 0] < a1) & (sheet[..., 1] > b0) & (sheet[..., 1] < b1)
    assert (expected[seen] > 60).sum() > 1000
    # One picture is warped, the other is of a warped volume, at its nearest pixel: what differs lies no farther from an
    # edge than the corner of such a pixel from its middle, and a pixel of the screen. How many differ depends on how
    # long the edges are.
    is_block = expected > 60
    pixel = sheet[0, 1, 0] - sheet[0, 0, 0]
    to_edge = pixel * np.maximum(distance_transform_edt(is_block), distance_transform_edt(~is_block))
    assert to_edge[((shown > 60) != is_block) & seen].max() < np.hypot(*result.raster.spacing) / 2 + pixel
    assert np.median(np.abs(shown - expected)[seen & (expected > 60)]) < 6
    session.editing.output = None
    show_step(editor, session)
    editor.subject = []
    page.wait_settled()
    assert page.js(f"({PAGE}.viewport.view.k)") == pytest.approx(before)
    assert np.ptp(page.canvas()[..., 0][beyond(page, editor.picture)]) == 0  # nothing but paper


def test_who_has_zoomed_keeps_the_view(open_editor: Any) -> None:
    session = Session(a_block(), view="+y")
    editor = make_editor(session, 420)
    page = open_editor(editor)
    page.js(f"{PAGE}.viewport.zoomAt(2, 200, 150)")
    before = page.js(f"({PAGE}.viewport.view.k)")
    session.results.grow(20.0)
    show_step(editor, session)
    page.wait_settled()
    assert page.js(f"({PAGE}.viewport.view.k)") == pytest.approx(before)


def test_points_and_their_drags_stay_where_they_are(open_editor: Any) -> None:
    session = Session(a_block(), view="+y")
    session.results.grow(20.0)
    editor = make_editor(session, 420)
    page = open_editor(editor)
    corner = session.editing.points.target[0]
    k = page.js(f"({PAGE}.viewport.view.k)")
    page.drag(corner, (-30, 12))  # out of the picture
    assert page.points.target[0] - corner == pytest.approx(np.array([-30, 12]) / k, abs=1.5 / k)

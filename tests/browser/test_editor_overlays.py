"""Overlays of the editor in a real browser: red where the core says that the map folds, green where matter grows."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from numpy.typing import NDArray
from PIL import Image

from deformnb.analysis.folds import jacobian_determinant
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor

pytestmark = pytest.mark.needs_browser

OVER = (230, 90)  # pixels that take the middle point past the one on its right
ASIDE = (90, 50)  # and such that fold nothing


def layer(page: EditorOnPage) -> NDArray[np.int_]:
    """The overlay alone, (rows, columns, RGBA)."""
    page.wait_settled()
    data = page.js("document.querySelector('.dnb-ed-overlay').toDataURL('image/png').split(',')[1]")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGBA")).astype(int)


def red(page: EditorOnPage) -> NDArray[np.bool_]:
    r, g, b, a = np.moveaxis(layer(page), -1, 0)
    return (a > 60) & (r > g + 20) & (r > b + 20)


def determinant(page: EditorOnPage) -> NDArray[np.float64]:
    """The core's at the pixels of the canvas."""
    return np.asarray(jacobian_determinant(page.editor.fit(), page.raster().points()))


def picture_mask(page: EditorOnPage, picture: Picture, rim: int = 3) -> NDArray[np.bool_]:
    at, d = page.raster().points(), page.raster().spacing[0] * rim
    a0, a1, b0, b1 = picture.raster.box
    return np.asarray((at[..., 0] > a0 + d) & (at[..., 0] < a1 - d) & (at[..., 1] > b0 + d) & (at[..., 1] < b1 - d))


def near(mask: NDArray[np.bool_], reach: int = 2) -> NDArray[np.bool_]:
    """All that lies so many pixels around."""
    grown = mask.copy()
    for axis in (0, 1):
        grown = np.logical_or.reduce([np.roll(grown, k, axis) for k in range(-reach, reach + 1)])
    return grown


def assert_red_where_it_folds(page: EditorOnPage, picture: Picture) -> None:
    folded, painted, seen = determinant(page) <= 0, red(page), picture_mask(page, picture)
    rim = near(folded) & near(~folded)  # the outline is a line of some width
    assert (folded & seen).sum() > 500
    assert (painted == folded)[seen & ~rim].mean() > 0.999
    assert not painted[~near(folded, 4)].any()


def test_a_point_dragged_over_its_neighbour_paints_the_fold_red(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points, stop_at_folds=False))
    assert not layer(page).any()
    page.drag(points.target[4], OVER)
    assert_red_where_it_folds(page, picture)
    page.page.keyboard.press("Control+z")
    assert not layer(page).any()
    assert page.js("document.querySelector('.dnb-ed-worst').getAttribute('visibility')") == "hidden"


def test_the_fold_is_there_while_the_mouse_moves(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, stop_at_folds=False))
    x, y = page.to_screen(points.target[4])
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    mouse.move(x + OVER[0] / 2, y + OVER[1] / 2, steps=3)
    assert not layer(page).any()
    mouse.move(x + OVER[0], y + OVER[1], steps=3)
    assert red(page).sum() > 500
    page.page.keyboard.press("Escape")
    assert not layer(page).any()
    mouse.up()


def test_a_drag_that_folds_nothing_paints_nothing(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.drag(points.target[4], ASIDE)
    assert determinant(page)[picture_mask(page, picture)].min() > 0
    assert not layer(page).any()


def test_the_fold_stays_with_the_picture_when_zoomed(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, stop_at_folds=False))
    page.drag(points.target[4], OVER)
    page.js(f"{PAGE}.viewport.zoomAt(2.7, 640, 300)")
    assert_red_where_it_folds(page, picture)
    page.js(f"{PAGE}.viewport.panBy(-60, 40)")
    assert_red_where_it_folds(page, picture)


def test_a_fold_smaller_than_a_cell_is_not_missed(open_editor: Any, picture: Picture) -> None:
    source = np.array([[30.0, -10.0], [110.0, -5.0], [100.0, 60.0], [35.0, 55.0], [70.0, 25.0], [71.3, 25.0]])
    target = source.copy()
    target[4:] = source[[5, 4]]  # two neighbours change places
    page = open_editor(Editor(picture, ControlPoints.from_arrays(source, target), kernel="wendland_c4", support=4.0))
    folded, painted = determinant(page) <= 0, red(page)
    assert 20 < folded.sum() < 2000
    assert painted.any()
    assert not painted[~near(folded, 4)].any()
    assert painted[folded].mean() > 0.9


def test_the_ring_is_where_the_determinant_is_least(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, stop_at_folds=False))
    page.drag(points.target[4], OVER)
    det, seen = determinant(page), picture_mask(page, picture)
    row, column = np.unravel_index(np.where(seen, det, np.inf).argmin(), det.shape)
    box = page.page.locator(".dnb-ed-worst-ring").bounding_box()
    stage = page.page.locator(".dnb-ed-stage").bounding_box()
    middle = np.array([box["x"] + box["width"] / 2 - stage["x"], box["y"] + box["height"] / 2 - stage["y"]])
    assert middle == pytest.approx(np.array([column, row]) / page.js(f"{PAGE}.viewport.view.ratio"), abs=3)
    told = page.page.locator(".dnb-ed-folds").get_attribute("title")
    assert f"min det J {det[seen].min():.2f}" in told.replace("\u2212", "-")


def test_folds_in_the_air_around_the_body_are_told_apart(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points, stop_at_folds=False))
    page.drag(points.target[4], OVER)
    assert "\u25b2 folds" in page.page.locator(".dnb-ed-folds").inner_text()
    page.editor.air = float(picture.values.max())  # nothing but air
    page.wait_settled()
    assert page.page.locator(".dnb-ed-folds").inner_text() == "\u2713 no folds in tissue"
    assert not red(page).any()
    assert layer(page).any()  # in grey
    page.editor.air = float(picture.values.min()) - 1  # no air at all
    page.wait_settled()
    assert "\u25b2 folds" in page.page.locator(".dnb-ed-folds").inner_text()


def test_stages_unfold_what_one_fit_folds(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, stop_at_folds=False))
    page.drag(points.target[4], OVER)
    assert red(page).any()
    page.editor.stages = 16
    page.wait_settled()
    assert determinant(page)[picture_mask(page, picture)].min() > 0
    assert not layer(page).any()
    assert "no folds" in page.page.locator(".dnb-ed-folds").inner_text()


# ---- area -----------------------------------------------------------------------------------------------------------


def colours(page: EditorOnPage) -> NDArray[np.float64]:
    """Green less red of the overlay: positive where it says that matter grew."""
    image = layer(page).astype(float)
    return np.asarray(image[..., 1] - image[..., 0])


@pytest.mark.parametrize(("grows", "sign"), [(1.6, 1), (0.6, -1)])
def test_matter_that_grows_is_green_and_matter_that_shrinks_purple(
    open_editor: Any, picture: Picture, points: ControlPoints, grows: float, sign: int
) -> None:
    middle = points.source.mean(axis=0)
    scaled = ControlPoints.from_arrays(points.source, middle + np.sqrt(grows) * (points.source - middle))
    page = open_editor(Editor(picture, scaled, overlay="area", show_grid=False))
    seen = picture_mask(page, picture)
    assert (layer(page)[seen][:, 3] > 100).all()
    told = sign * colours(page)[seen]
    assert told.min() > 20
    assert np.ptp(told) < 8  # the same everywhere


def test_the_colours_follow_the_logarithm_of_the_area(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points, overlay="area", show_grid=False))
    page.drag(points.target[4], ASIDE)
    seen, grown = picture_mask(page, picture, 8), -np.log2(determinant(page))
    told = colours(page)
    assert told[seen & (grown > 0.3)].min() > 0 > told[seen & (grown < -0.3)].max()
    assert np.abs(told[seen & (np.abs(grown) < 0.02)]).max() < 8
    for side in (1, -1):  # purple has another contrast than green
        mask = seen & (side * grown > 0.02) & (side * grown < 0.95)
        assert np.corrcoef(grown[mask], told[mask])[0, 1] > 0.995
    legend = page.page.locator(".dnb-ed-key")
    assert legend.inner_text().split() == ["relative", "area", "1/2", "1", "2×"]


def test_a_fold_is_red_over_the_area_too(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, overlay="area", stop_at_folds=False))
    page.drag(points.target[4], OVER)
    folded = determinant(page) <= 0
    inside = folded & ~near(~folded, 4) & picture_mask(page, picture)
    assert red(page)[inside].mean() > 0.95


# ---- uncertainty, marks, choice -------------------------------------------------------------------------------------


def test_the_uncertainty_overlay_lies_where_python_says(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor = Editor(picture, points, overlay="uncertainty")
    page = open_editor(editor)
    assert "not known yet" in page.page.locator(".dnb-ed-key").inner_text()
    values = np.zeros((10, 12), np.uint8)
    values[:5] = 240  # the upper half
    editor.uncertainty_facts = {"width": 12, "height": 10, "legend": [[120, "1 mm"]]}
    editor.uncertainty = values.tobytes()
    image, seen, at = layer(page), picture_mask(page, picture), page.raster().points()
    _, _, b0, b1 = picture.raster.box
    upper, lower = (seen & (at[..., 1] < b0 + 0.4 * (b1 - b0)), seen & (at[..., 1] > b0 + 0.6 * (b1 - b0)))
    assert (image[upper][:, 3] > 180).all()
    assert np.ptp(image[upper][:, :3], axis=1).max() < 15  # grey
    assert (image[lower][:, 3] == 0).all()
    line = np.abs(at[..., 1] - (b0 + b1) / 2) < 0.02 * (b1 - b0)
    assert image[line & seen][:, 3].max() > 200  # the contour of 1 mm, where the overlay is half as dense
    assert "1 mm" in page.page.locator(".dnb-ed-key").inner_text()
    assert page.page.locator(".dnb-ed-key").get_attribute("aria-label") == "Uncertainty: 1 mm"


def test_marked_points_have_a_dashed_ring_and_say_why(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points, marked=[1, 3]))
    shown = page.js("[...document.querySelectorAll('.dnb-ed-suspect')].map((g) => Number(g.dataset.id))")
    assert shown == [1, 3]
    title = page.js("document.querySelector('[data-id=\"3\"] title').textContent")
    assert title.endswith("; disagrees with its neighbours")
    dashes = "getComputedStyle(document.querySelector('[data-id=\"{}\"] .dnb-ed-doubt')).display"
    assert (page.js(dashes.format(1)), page.js(dashes.format(2))) == ("inline", "none")
    page.editor.marked = []
    page.wait_settled()
    assert page.js("document.querySelectorAll('.dnb-ed-suspect').length") == 0


def test_the_menu_and_its_key_choose_the_overlay(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, stop_at_folds=False))
    page.drag(points.target[4], OVER)
    menu = page.page.get_by_label("Overlay (V)")
    assert (menu.input_value(), red(page).any()) == ("folds", True)
    menu.select_option("none")
    assert not layer(page).any()
    assert page.editor.overlay == "none"
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("v")
    assert red(page).any()
    assert (page.editor.overlay, menu.input_value()) == ("folds", "folds")
    page.page.keyboard.press("v")
    page.wait_settled()
    assert (page.editor.overlay, menu.input_value()) == ("area", "area")
    page.editor.overlay = "uncertainty"
    page.wait_settled()
    assert menu.input_value() == "uncertainty"
    assert "extrapolated" in menu.get_attribute("title")
    assert menu.locator("option").all_inner_texts() == ["Plain", "Folds", "Area", "Strain", "Uncertainty"]


def test_the_legend_lies_where_it_hides_no_point(open_editor: Any, picture: Picture) -> None:
    a0, a1, b0, b1 = picture.raster.box
    low_left, low_right = [a0 + 4, b1 - 4], [a1 - 4, b1 - 4]
    page = open_editor(Editor(picture, overlay="area"), size=(700, 600))
    left_of_middle = """(([k, s]) => k.left + k.right < s.left + s.right)(['.dnb-ed-key', '.dnb-ed-stage'].map(
        (name) => document.querySelector(name).getBoundingClientRect()))"""
    assert page.js(left_of_middle) is True  # where it always was
    hidden = """[...document.querySelectorAll(".dnb-ed-disc")].filter((disc) => {
        const d = disc.getBoundingClientRect(), k = document.querySelector(".dnb-ed-key").getBoundingClientRect();
        return d.left < k.right && d.right > k.left && d.top < k.bottom && d.bottom > k.top; }).length"""
    for places in ([low_left], [low_left, low_right], [low_left, low_right, [a1 - 4, b0 + 4]]):
        page.editor.points = ControlPoints.from_arrays(places)
        page.wait_settled()
        assert page.js(hidden) == 0
    page.editor.points = ControlPoints.from_arrays([low_left, [a1 - 4, b0 + 4], [a0 + 4, b0 + 4], [70, 25]])
    page.wait_settled()
    assert page.js(hidden) == 0
    assert page.js(left_of_middle) is False
    page.page.mouse.move(*page.to_screen([70, 25]))
    page.page.mouse.down()
    page.page.mouse.move(*page.to_screen(low_right), steps=4)  # over the legend: it stays while the hand moves
    page.wait(f"{hidden} === 1")
    page.page.mouse.up()
    page.wait_settled()
    assert page.js(hidden) <= 1  # all corners are taken now


def test_before_has_no_overlay(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, overlay="area", stop_at_folds=False))
    page.drag(points.target[4], OVER)
    page.page.keyboard.press("c")
    assert not layer(page).any()
    assert page.page.locator(".dnb-ed-key").is_hidden()
    page.page.keyboard.press("c")
    assert red(page).any()


def test_beside_a_cut_the_map_that_is_seen_counts(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    editor = Editor(picture, points, trend="translation", stop_at_folds=False)
    editor.cuts = [Cut(Line(((60.0, -40.0), (60.0, 90.0))))]
    page = open_editor(editor)
    page.drag(points.target[4], OVER)
    field = page.editor.fit()
    at = page.raster().points()
    moves, opacity = field.displacement_and_opacity(at)
    assert moves.shape == at.shape
    folded = (determinant(page) <= 0) & (opacity > 0.5)
    painted, seen = red(page), picture_mask(page, picture, 4)
    assert folded[seen].sum() > 500
    assert (painted == folded)[seen & ~(near(folded, 3) & near(~folded, 3))].mean() > 0.99

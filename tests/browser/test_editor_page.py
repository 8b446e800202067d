"""The editor in a real browser: real mouse, real keys, and pixels compared with the core's own warp."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from browser.pane_messages import message_text

from deformnb.document.deformation import Deformation
from deformnb.imaging.projection import project
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import warp_picture
from deformnb.widgets.editor.editor import Editor

pytestmark = pytest.mark.needs_browser


def expected(page: EditorOnPage, picture: Picture) -> np.ndarray:
    """The core's own warp at the canvas's pixels."""
    return warp_picture(picture.values, picture.raster, page.editor.fit(), output=page.raster()).astype(int)


def inside(page: EditorOnPage, picture: Picture, rim: int = 2) -> np.ndarray:
    """Pixels of the canvas that show the picture, without the frame along its edge."""
    at, d = page.raster().points(), page.raster().spacing[0] * rim
    a0, a1, b0, b1 = picture.raster.box
    return (at[..., 0] > a0 + d) & (at[..., 0] < a1 - d) & (at[..., 1] > b0 + d) & (at[..., 1] < b1 - d)


def wrong(page: EditorOnPage, picture: Picture) -> np.ndarray:
    """Differences between canvas and core, in grey levels."""
    assert (page.canvas()[..., 0] == page.canvas()[..., 2])[inside(page, picture)].all()
    return np.abs(page.canvas()[..., 0] - expected(page, picture))[inside(page, picture)]


# One level for rounding a mean of integers, one for the float32 map; a jump at the rim of what the map reaches may
# fall on the other side in one pixel of a thousand.
def assert_matches(page: EditorOnPage, picture: Picture) -> None:
    difference = wrong(page, picture)
    assert np.quantile(difference, 0.999) <= 2
    assert difference.size > 50_000


# ---- the picture ----------------------------------------------------------------------------------------------------


def test_the_picture_at_rest_is_the_picture(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    assert_matches(open_editor(Editor(picture, points, show_grid=False)), picture)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("by", [(60, 0), (-45, 0), (0, 50), (0, -40), (37, 29)])
def test_a_drag_moves_the_point_and_the_picture_as_the_core_does(
    open_editor: Any, picture: Picture, points: ControlPoints, by: tuple[int, int]
) -> None:
    page = open_editor(Editor(picture, points, show_grid=False))
    page.drag(points.target[4], by)
    k = page.js(f"{PAGE}.viewport.view.k")
    assert page.points.target[4] == pytest.approx(points.target[4] + np.array(by) / k, abs=1e-9)
    assert np.array_equal(page.points.source, points.source)
    assert_matches(page, picture)
    assert [m["phase"] for m in page.js("models.editor.sent")] == ["end"]
    assert page.js("models.editor.saved.filter((s) => 'points' in s || 'next_id' in s)") == []  # one way, not two


@pytest.mark.sampled(2)
@pytest.mark.parametrize("view", VIEWS)
def test_what_lies_under_a_point_appears_where_it_is_dropped(open_editor: Any, view: str) -> None:
    values = np.zeros((24, 30, 36), np.uint8)
    values[15:18, 5:9, 24:27] = 255  # a mark, off every middle
    volume = Volume(values, Grid((24, 30, 36), (1.0, 1.5, 1.2), (4.0, 5.0, 6.0)))
    picture = project(volume, view)
    v, u = np.argwhere(picture.values == 255).mean(axis=0)
    mark = np.array(
        [
            picture.raster.columns[0] + u * picture.raster.spacing[0],
            picture.raster.rows[0] + v * picture.raster.spacing[1],
        ]
    )
    page = open_editor(Editor(picture, ControlPoints.from_arrays([mark]), show_grid=False, height=400))
    page.drag(mark, (-31, 42))
    bright = np.argwhere((page.canvas()[..., 0] > 128) & inside(page, picture)).mean(axis=0)
    raster = page.raster()
    found = np.array([raster.columns[0], raster.rows[0]]) + bright[::-1] * raster.spacing
    assert found == pytest.approx(page.points.target[0], abs=0.3)
    moved = project(Deformation((page.editor.step(),)).apply(volume), view)
    v, u = np.average(np.argwhere(moved.values > 60), axis=0, weights=moved.values[moved.values > 60])
    in_volume = np.array([moved.raster.columns[0], moved.raster.rows[0]]) + np.array([u, v]) * moved.raster.spacing
    assert found == pytest.approx(in_volume, abs=0.8)  # half a voxel of the warped volume


def test_undo_brings_every_pixel_back_and_redo_the_edit(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    # Without the grid: Chromium draws lines a shade differently once a canvas was read, on a busy machine only.
    page = open_editor(Editor(picture, points, show_grid=False))
    before = page.canvas()
    page.drag(points.target[4], (50, 30))
    after, moved = page.canvas(), page.points
    assert np.abs(after - before).max() > 50
    page.page.keyboard.press("Control+z")
    assert np.abs(page.canvas() - before).max() == 0
    assert page.points == points
    page.page.keyboard.press("Control+y")
    assert np.array_equal(page.canvas(), after)
    assert page.points == moved


def test_colours_follow_too(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    grey = picture.grey()
    rgba = np.stack([grey, grey**2, 1 - grey, np.ones_like(grey)], axis=-1)
    coloured = Picture(rgba, picture.plane, picture.raster, "composite", (0.0, 1.0))
    page = open_editor(Editor(coloured, points, show_grid=False))
    page.drag(points.target[4], (50, 30))
    oracle = warp_picture(coloured.rgb8(), picture.raster, page.editor.fit(), output=page.raster(), fill=0).astype(int)
    difference = np.abs(page.canvas() - oracle)[inside(page, picture)]
    assert np.quantile(difference, 0.999) <= 2


def test_the_grid_shows_where_features_went(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, density=8))
    page.drag(points.target[4], (60, 40))
    lines = page.js(f"{PAGE}.layers.grid.last.lines.flatMap((l) => l.runs.flatMap((r) => Array.from(r)))")
    at = np.array(lines).reshape(-1, 2)
    a0, a1, b0, b1 = picture.raster.box
    back = (at + page.editor.fit().displacement(at) - [a0, b0]) * 8 / max(a1 - a0, b1 - b0)
    cells = np.array([(a1 - a0), (b1 - b0)]) * 8 / max(a1 - a0, b1 - b0)
    back *= np.round(cells) / cells
    off = np.abs(back - np.round(back)).min(axis=1)  # every place of the grid comes from a line of the grid
    assert off.max() < 0.01
    assert len(at) > 200
    # At rest grid and folds are of the fit itself, and not of the nodes that the picture of a drag is warped with.
    assert page.js(f"{PAGE}.layers.grid.last.key[0] === {PAGE}.map.layered && !{PAGE}.map.folds.isRough")


def test_before_shows_the_picture_as_it_was(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, show_grid=False))
    before = page.canvas()
    page.drag(points.target[4], (60, 40))
    page.page.keyboard.press("c")
    assert np.quantile(np.abs(page.canvas() - before), 0.999) <= 2  # no lattice, no rounding of the map


# ---- editing --------------------------------------------------------------------------------------------------------


def test_a_double_click_takes_hold_without_moving_anything(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    points = points.move(4, [85, 30])
    page = open_editor(Editor(picture, points, show_grid=False))
    before = page.canvas()
    place = [50.0, 20.0]
    page.page.mouse.dblclick(*page.to_screen(place))
    added = page.points
    assert added.ids == (0, 1, 2, 3, 4, 5)
    # Playwright rounds nothing, the browser hands whole CSS pixels of a mouse: less than a pixel of the screen.
    assert added.target[5] == pytest.approx(place, abs=1.01 / page.js(f"{PAGE}.viewport.view.k"))
    seen = added.target[5] + Editor(picture, points).fit().displacement(added.target[5])
    assert added.source[5] == pytest.approx(seen, abs=1e-9)
    assert np.quantile(np.abs(page.canvas() - before), 0.999) <= 1
    assert page.js("document.activeElement.dataset.id") == "5"


def test_a_new_point_next_to_an_old_one_selects_that(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    x, y = page.to_screen(points.target[2])
    page.page.keyboard.press("Tab")
    page.page.locator("[data-command=add]").click()
    page.page.locator(".dnb-ed-stage").click(position={"x": 5, "y": 5})  # away from all: a new point
    assert len(page.points) == 6
    page.page.mouse.click(x + 4, y + 3)
    assert len(page.points) == 6
    page.wait("models.editor.get('selected').join() === '2'")
    assert page.editor.selected == [2]


def test_keys_do_all_of_it(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page, (du, dv) = open_editor(Editor(picture, points)), picture.raster.spacing
    keyboard = page.page.keyboard
    page.page.locator(".dnb-ed-stage").focus()
    keyboard.press("Tab")
    keyboard.press("Control+ArrowRight")
    assert page.js("document.activeElement.dataset.id") == "1"
    keyboard.press("ArrowRight")
    keyboard.press("Shift+ArrowUp")
    assert page.points.target[1] == pytest.approx(points.target[1] + [du, -10 * dv])
    keyboard.press("Alt+ArrowDown")
    assert page.points.source[1] == pytest.approx(points.source[1] + [0, dv])
    keyboard.press("o")
    assert page.points.active.tolist() == [True, False, True, True, True]
    keyboard.press("F2")
    keyboard.type("eye")
    keyboard.press("Enter")
    assert page.points.names[1] == "eye"
    keyboard.press("Home")
    assert np.array_equal(page.points.target[1], page.points.source[1])
    keyboard.press("Delete")
    assert page.points.ids == (0, 2, 3, 4)
    assert page.js("document.activeElement.dataset.id") == "2"
    while page.js(f"{PAGE}.sender.canStep('undo')"):  # six times, or more where presses are slow and not joined
        keyboard.press("Control+z")
    assert page.points.remove() == ControlPoints.from_arrays(points.source, names=points.names)
    keyboard.press("Escape")
    page.page.locator(".dnb-ed-stage").focus()
    keyboard.press("Enter")
    assert len(page.points) == 5  # the middle of the view is next to the point "middle", which is taken


def test_a_double_click_on_a_point_renames_it(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.page.mouse.dblclick(*page.to_screen(points.target[3]))
    page.page.keyboard.type("tail fin")
    page.page.mouse.click(*page.to_screen([20, 20]))
    assert page.points.names[3] == "tail fin"
    assert len(page.points) == 5


def test_tab_leads_to_one_point_and_keys_from_one_to_the_next(open_editor: Any, picture: Picture) -> None:
    at = np.random.default_rng(5).uniform([15, -25], [125, 70], (200, 2))
    page = open_editor(Editor(picture, ControlPoints.from_arrays(at), density=0))
    press, focused = page.page.keyboard.press, "document.activeElement.dataset.id ?? document.activeElement.className"
    page.page.locator(".dnb-ed-stage").focus()
    press("Tab")
    assert page.js(focused) == "0"
    for key in ("Control+ArrowRight", "Control+ArrowDown", "Control+ArrowRight", "Control+ArrowLeft"):
        press(key)
    assert page.js(focused) == "2"
    assert np.array_equal(page.points.target, at)  # the focus has moved, no point
    press("Control+ArrowUp")
    press("Control+ArrowLeft")
    press("Control+ArrowLeft")
    assert page.js(focused) == "199"  # around the end
    press("Tab")
    assert page.js("document.activeElement.closest('.dnb-ed-points') === null")  # one Tab, not two hundred
    press("Shift+Tab")
    assert page.js(focused) == "199"
    press("Delete")
    assert page.js(focused) == "198"
    press("Control+z")
    page.wait_answered()
    assert page.js("document.querySelectorAll('.dnb-ed-target[tabindex=\"0\"]').length") == 1
    press("Enter")
    assert page.js(f"[...{PAGE}.points.selected]") == [198]
    page.page.locator("[data-command=fit]").focus()
    press("Control+ArrowRight")
    assert page.js("document.activeElement.dataset.command") == "fit"  # among buttons it means nothing


def test_a_right_click_deletes(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.page.mouse.click(*page.to_screen(points.target[3]), button="right")
    assert page.points.ids == (0, 1, 2, 4)


def test_no_other_way_to_a_menu_deletes(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    x, y = page.to_screen(points.target[3])
    # A Mac's Ctrl + click with either button, the key for menus, and a finger that rests.
    for event in (
        {"button": 0, "ctrlKey": True},
        {"button": 2, "ctrlKey": True},
        {"button": 0},
        {"button": 2, "pointerType": "touch"},
    ):
        left = page.page.evaluate(
            """(event) => document.querySelector("[data-id='3']").dispatchEvent(new PointerEvent(
            "contextmenu", { bubbles: true, cancelable: true, ...event }))""",
            {**event, "clientX": x, "clientY": y},
        )
        assert left is False  # and the browser's own menu stays away
    assert page.points == points


def test_a_band_selects_and_the_selected_move_together(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    page.drag([15, 40], (70 * page.js(f"{PAGE}.viewport.view.k"), 30 * page.js(f"{PAGE}.viewport.view.k")))
    page.wait("models.editor.get('selected').length")
    assert page.editor.selected == [3]
    x, y = page.to_screen(points.target[2])
    page.page.keyboard.down("Shift")
    page.page.mouse.click(x, y)
    page.page.keyboard.up("Shift")
    page.drag(points.target[3], (20, -15))
    shift = page.points.target - points.target
    k = page.js(f"{PAGE}.viewport.view.k")
    assert shift == pytest.approx(np.array([[0, 0], [0, 0], [20 / k, -15 / k], [20 / k, -15 / k], [0, 0]]), abs=1e-9)


def test_a_ring_moves_the_source_and_alt_both(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    moved = points.move(4, [90, 40])
    page = open_editor(Editor(picture, moved))
    k = page.js(f"{PAGE}.viewport.view.k")
    page.drag(moved.source[4], (-10, 5))
    assert page.points.source[4] == pytest.approx(points.source[4] + np.array([-10, 5]) / k, abs=1e-9)
    assert np.array_equal(page.points.target, moved.target)
    page.page.keyboard.down("Alt")
    page.drag(moved.target[4], (8, 8))
    page.page.keyboard.up("Alt")
    assert page.points.displacement[4] == pytest.approx(moved.displacement[4] + np.array([-10, 5]) / k, abs=1e-9)


def test_escape_ends_a_drag_as_if_it_had_not_begun(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, show_grid=False))  # the grid: see the undo
    before = page.canvas()
    x, y = page.to_screen(points.target[4])
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 50, y + 20, steps=4)
    page.page.keyboard.press("Escape")
    page.page.mouse.up()
    assert np.array_equal(page.canvas()[40:-40, 40:-40], before[40:-40, 40:-40])
    assert page.points == points


def test_points_that_cannot_be_fitted_go_back_and_it_is_said_why(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    page.js(
        f"{PAGE}.tools.points.edit({PAGE}.points.list.map((p) => "
        f"p.id === 3 ? {{ ...p, target: [...{PAGE}.points.list[2].target] }} : p))"
    )
    assert "point 3 and point 4 are at the same place" in message_text(page.page)
    assert page.points == points
    page.editor.kernel = "thin_plate"
    page.editor.trend = "rigid"
    page.wait_settled()
    assert "needs a trend of affine" in message_text(page.page)
    page.editor.trend = "affine"
    page.wait_settled()
    assert "needs" not in message_text(page.page)


def test_remarks_and_folds_are_in_the_status_line(open_editor: Any, picture: Picture) -> None:
    line = np.array([[30.0, 0.0], [60.0, 20.0], [90.0, 40.0]])
    page = open_editor(Editor(picture, ControlPoints.from_arrays(line), stop_at_folds=False))
    page.drag(line[1], (15, 10))
    status = "document.querySelector('.dnb-ed-status').innerText"
    page.wait(f"{status}.includes('the control points lie nearly on one line')")
    page.wait(f"{status}.includes('no folds')")
    page.drag(page.points.target[1], (200, 130))
    page.wait(f"{status}.includes('folds on')")


# ---- view, themes, protocol -----------------------------------------------------------------------------------------


def test_the_wheel_zooms_only_where_someone_works(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, show_grid=False))
    k = page.js(f"{PAGE}.viewport.view.k")
    page.page.mouse.move(*page.to_screen(points.target[4]))
    page.page.evaluate("document.body.style.height = '4000px'")
    page.page.mouse.wheel(0, 300)
    page.wait("window.scrollY > 50")
    page.wait_settled()
    assert page.js(f"{PAGE}.viewport.view.k") == k
    page.page.evaluate("window.scrollTo(0, 0)")
    page.wait("window.scrollY === 0")
    page.page.locator(".dnb-ed-stage").focus()
    held = page.to_screen(points.target[4])
    page.page.mouse.wheel(0, -300)
    page.wait(f"{PAGE}.viewport.view.k > {1.3 * k}")
    assert page.to_screen(points.target[4]) == pytest.approx(held, abs=1)
    assert_matches(page, picture)
    page.page.keyboard.down(" ")
    page.drag([75, 32], (30, 10))
    page.page.keyboard.up(" ")
    assert page.to_screen(points.target[4]) == pytest.approx((held[0] + 30, held[1] + 10), abs=1)
    assert page.points == points
    page.page.keyboard.press("0")
    page.wait_settled()
    assert page.js(f"{PAGE}.viewport.view.k") == pytest.approx(k)


def test_two_fingers_zoom_and_one_drags_a_point(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    k, fingers = page.js(f"{PAGE}.viewport.view.k"), page.page.context.new_cdp_session(page.page)

    def touch(kind: str, *places: Any) -> None:
        fingers.send(
            "Input.dispatchTouchEvent",
            {"type": kind, "touchPoints": [{"x": float(x), "y": float(y), "id": n} for n, (x, y) in enumerate(places)]},
        )

    x, y = page.to_screen([70, 40])
    touch("touchStart", (x - 40, y))
    touch("touchStart", (x - 40, y), (x + 40, y))
    for spread in (50, 60, 80):
        touch("touchMove", (x - spread, y), (x + spread, y))
    touch("touchEnd")
    page.wait_settled()
    assert page.js(f"{PAGE}.viewport.view.k") == pytest.approx(2 * k, rel=0.02)
    x, y = page.to_screen(points.target[4])
    touch("touchStart", (x, y))
    touch("touchMove", (x + 10, y + 10))
    touch("touchMove", (x + 30, y - 20))
    touch("touchEnd")
    page.wait_settled()
    assert page.points.displacement[4] == pytest.approx(
        np.array([-30, 20]) / page.js(f"{PAGE}.viewport.view.k"), abs=1e-6
    )


def test_a_point_beyond_the_view_waits_at_the_rim(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points.move(1, [900, 20])))
    rim = page.page.locator("[data-id='1']")
    assert "dnb-ed-outside" in (rim.get_attribute("class") or "")
    assert rim.locator(".dnb-ed-disc").bounding_box()["x"] < page.page.locator(".dnb-ed-stage").bounding_box()["width"]


def test_a_disc_that_the_border_would_cut_is_drawn_whole(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    stage = page.page.locator(".dnb-ed-stage").bounding_box()
    a, b = page.js(f"{PAGE}.viewport.placeAt([{stage['width'] - 1}, 60])")
    page.editor.points = points.move(1, [a, b])
    page.page.locator("[data-id='1'].dnb-ed-outside").wait_for(state="attached")
    disc = page.page.locator("[data-id='1'] .dnb-ed-disc").bounding_box()
    assert disc["x"] + disc["width"] <= stage["x"] + stage["width"]
    assert page.points.target[1] == pytest.approx([a, b])  # only its disc is moved


def test_edits_on_their_way_are_few_and_the_last_always_arrives(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor, seen = Editor(picture, points), []
    editor.on_edit(lambda p, phase: seen.append((phase, p.target[4].tolist())))
    page = open_editor(editor)
    editor.send = lambda content, buffers=None: None  # type: ignore[method-assign]
    page.drag(points.target[4], (60, 40), steps=30)
    assert [phase for phase, _ in seen] == ["move", "move", "end"]  # no answer came: two in flight, and the end
    assert seen[-1][1] == editor.points.target[4].tolist()


def test_movements_cost_nothing_where_nobody_listens(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.drag(points.target[4], (60, 40), steps=30)
    assert [m["phase"] for m in page.js("models.editor.sent")] == ["end"]


def test_python_moves_points_and_the_hand_goes_first(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, show_grid=False))
    page.editor.points = points.move(0, [40, 0])
    assert_matches(page, picture)
    x, y = page.to_screen(points.target[4])
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 20, y, steps=3)
    page.editor.points = points.reset()
    page.page.mouse.move(x + 40, y, steps=3)
    page.page.mouse.up()
    page.wait_settled()
    assert page.points.target[0].tolist() == [40, 0]
    assert page.points.target[4] == pytest.approx(points.target[4] + [40 / page.js(f"{PAGE}.viewport.view.k"), 0])


def test_the_page_hears_of_every_movement_without_python(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    page.js("""(() => { window.heard = []; models.editor.deformnb.addEventListener("deformnb:points",
        (e) => heard.push([e.detail.phase, e.detail.points[4].target, e.detail.fit.support])) })()""")
    page.drag(points.target[4], (60, 40), steps=10)
    heard = page.js("heard")
    assert heard[0][0] == "move"
    assert heard[-1][0] == "end"
    assert heard[-1][1] == page.points.target[4].tolist()
    assert heard[-1][2] == pytest.approx(page.editor.fit().support)


def test_two_views_of_one_editor_agree(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, height=250, show_grid=False), draws=2)
    page.drag(points.target[4], (30, 20))
    page.wait(
        "[...document.querySelectorAll('.dnb-editor')].every(({ deformnb: { frames } }) => "
        "!frames.isMoving && !frames.request)"
    )
    first, second = page.js("[...document.querySelectorAll('.dnb-ed-canvas')].map((c) => c.toDataURL())")
    assert first == second
    page.page.keyboard.press("Control+z")
    assert page.points == points  # one edit, recorded once
    views = "[...document.querySelectorAll('.dnb-editor')]"
    both = page.js(f"{views}.map((e) => e.deformnb.parts.points.list[4].target[0])")
    assert both == [70, 70]


@pytest.mark.nightly
def test_twenty_runs_of_a_cell_leave_nothing_behind(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    for _ in range(20):
        page.js("models.editor.cleanups.pop()()")
        page.draw("editor")
    assert page.page.locator(".dnb-editor").count() == 1
    page.js("models.editor.cleanups.pop()()")
    assert page.page.locator("#root > *").count() == 0
    assert page.js("models.editor.deformnb.latest") is None
    page.editor.points = points.move(4, [60, 20])  # nobody is left to hear of it, and nothing breaks
    page.page.set_viewport_size({"width": 500, "height": 500})
    page.wait("innerWidth === 500")
    page.frames()


def test_a_broken_picture_is_said_and_the_points_still_work(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor = Editor(picture, points)
    page = open_editor(editor)
    editor.image = b"no picture"
    page.wait("document.querySelector('.dnb-messages').dataset.kind === 'error'")
    assert "could not be shown" in message_text(page.page)
    page.drag(points.target[4], (20, 10))
    assert page.points != points


def test_an_error_in_a_callback_is_seen_in_the_page(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    editor = Editor(picture, points)
    editor.on_edit(lambda p, phase: 1 // 0)
    page = open_editor(editor)
    page.drag(points.target[4], (20, 10))
    page.wait("document.querySelector('.dnb-messages').dataset.kind === 'error'")
    assert "ZeroDivisionError in a callback" in message_text(page.page)


def test_points_that_are_only_shown_stay(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, read_only=True))
    page.drag(points.target[4], (20, 10))
    page.page.keyboard.press("Delete")
    page.page.mouse.dblclick(*page.to_screen([50, 50]))
    assert page.js(f"{PAGE}.points.list.map((p) => p.target)") == points.target.tolist()


def test_everything_has_a_name_and_a_role(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points.move(1, [115, -9]), label="A fish"))
    label = page.page.locator("[data-id='1']").get_attribute("aria-label")
    assert label == "Point 2 top right, at 115, -9, dragged 5 right, 4 up"
    assert page.page.locator("[role=application]").get_attribute("aria-label").startswith("A fish with control points")
    nameless = page.js("""[...document.querySelectorAll("button, input, [tabindex], [role]")].filter((e) =>
        !e.getAttribute("aria-label") && !(e.matches("button") && e.innerText.trim())
        && !["alert", "status", "group"].includes(e.getAttribute("role")))
        .map((e) => e.outerHTML)""")
    assert nameless == []


@pytest.mark.parametrize(
    ("theme", "scheme", "is_dark"),
    [("auto", "light", False), ("auto", "dark", True), ("light", "dark", False), ("dark", "light", True)],
)
def test_light_and_dark_follow_the_page_unless_told(
    browser: Any, picture: Picture, theme: str, scheme: str, is_dark: bool
) -> None:
    page = EditorOnPage(browser, Editor(picture, theme=theme))
    page.page.emulate_media(color_scheme=scheme)
    page.wait(f"document.querySelector('.dnb-dark') {'!==' if is_dark else '==='} null")
    style = "getComputedStyle(document.querySelector('.dnb-editor'))"
    paper, ink = page.js(f"[{style}.backgroundColor, {style}.color]")
    brightness = [sum(int(v) for v in colour[4:-1].split(",")) / 3 for colour in (paper, ink)]
    assert (brightness[0] < 60 and brightness[1] > 180) if is_dark else (brightness[0] > 200 and brightness[1] < 90)
    page.close()


@pytest.mark.parametrize("width", [360, 420, 600, 1280])
def test_nothing_is_clipped(open_editor: Any, picture: Picture, points: ControlPoints, width: int) -> None:
    page = open_editor(Editor(picture, points), size=(width, 800))
    clipped = page.js("""(() => {
        const r = document.querySelector(".dnb-editor").getBoundingClientRect();
        const parts = [...document.querySelectorAll(".dnb-ed-button, .dnb-ed-status > *, .dnb-ed-stage")];
        return parts.filter((e) => {
            const b = e.getBoundingClientRect(), isWide = e.scrollWidth > e.clientWidth + 1 && e.clientWidth > 0;
            return b.left < r.left - 1 || b.right > r.right + 1 || b.bottom > r.bottom + 1 || isWide;
        }).map((e) => e.className);
    })()""")
    assert clipped == []
    assert page.js("document.documentElement.scrollWidth <= innerWidth")
    whole, stage = (page.page.locator(f".dnb-{name}").bounding_box() for name in ("editor", "ed-stage"))
    assert whole["width"] == width
    a0, a1, b0, b1 = picture.raster.box
    height = min(560, 40 + (stage["width"] - 40) * (b1 - b0) / (a1 - a0))
    assert stage["height"] == pytest.approx(height, abs=1)
    left, top = page.to_screen((a0, b0))
    right, bottom = page.to_screen((a1, b1))
    margin = min(19, 0.038 * width)  # narrower on a phone
    assert min(left, top - stage["y"], width - right, stage["y"] + stage["height"] - bottom) >= margin


def test_in_a_row_the_editor_takes_what_its_neighbour_leaves(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points, height=480), size=(1280, 800))
    page.js("""{ const root = document.getElementById("root"), other = document.createElement("div");
        root.style.display = "flex"; other.innerHTML = "<div style='width: 480px; height: 300px'></div>";
        root.append(other); }""")
    page.wait("document.querySelector('.dnb-editor').clientWidth < 810")
    assert page.page.locator(".dnb-editor").bounding_box()["width"] == pytest.approx(800, abs=1)
    assert page.page.locator(".dnb-ed-stage").bounding_box()["height"] == 480
    page.drag(points.target[4], (40, 10))
    assert page.points.displacement[4] == pytest.approx(
        np.array([-40, -10]) / page.js(f"{PAGE}.viewport.view.k"), abs=1e-9
    )
    page.js("{ document.getElementById('root').lastChild.firstChild.style.width = '900px'; }")
    page.wait("document.querySelector('.dnb-editor').clientWidth < 400")
    assert page.page.locator(".dnb-editor").bounding_box()["width"] == pytest.approx(380, abs=1)
    assert page.page.locator(".dnb-ed-stage").bounding_box()["height"] < 400

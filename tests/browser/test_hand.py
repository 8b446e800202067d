"""Turning, scaling, locking, the grid that holds and the stop at folds, with real mouse and keys in a real browser."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from browser.pane_messages import message_script, message_text
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from deformnb.document.json_regions import region_to_data
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Mask
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor

pytestmark = pytest.mark.needs_browser


def turned(places: Any, about: Any, degrees: float, factor: float = 1.0) -> NDArray[np.float64]:
    """Clockwise on the screen, where b runs down."""
    c, s = factor * np.cos(np.radians(degrees)), factor * np.sin(np.radians(degrees))
    return np.asarray(about) + (np.asarray(places) - about) @ np.array([[c, s], [-s, c]])


def knob(page: EditorOnPage) -> tuple[float, float]:
    """Place of the rotation handle in the window."""
    page.wait_settled()
    box = page.page.locator("[data-mark='turn'] .dnb-ed-turn-disc").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def turn_by_hand(page: EditorOnPage, about: Any, degrees: float, *keys: str) -> None:
    start, middle = np.array(knob(page)), np.array(page.to_screen(about))
    mouse = page.page.mouse
    mouse.move(*start)
    mouse.down()
    for key in keys:
        page.page.keyboard.down(key)
    for share in (0.3, 0.7, 1.0):
        mouse.move(*turned(start, middle, share * degrees))
    mouse.up()
    for key in keys:
        page.page.keyboard.up(key)
    page.wait_settled()


def select(page: EditorOnPage, *ids: int) -> None:
    for k, number in enumerate(ids):
        page.page.locator(f"[data-id='{number}'] .dnb-ed-hit").click(modifiers=["Shift"] if k else [])
    page.wait_settled()


# ---- turning --------------------------------------------------------------------------------------------------------


def test_several_points_turn_about_their_middle(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    select(page, 1, 2, 4)
    about = points.target[[1, 2, 4]].mean(axis=0)
    turn_by_hand(page, about, 30)
    after = page.points
    assert after.target[[1, 2, 4]] == pytest.approx(turned(points.target[[1, 2, 4]], about, 30), abs=0.6)
    angle = np.degrees(np.arctan2(*np.flip(after.target[1] - about))) - np.degrees(
        np.arctan2(*np.flip(points.target[1] - about))
    )
    assert (angle + 180) % 360 - 180 == pytest.approx(30, abs=0.6)
    sides = np.linalg.norm(np.diff(after.target[[1, 2, 4, 1]], axis=0), axis=1)
    assert sides == pytest.approx(np.linalg.norm(np.diff(points.target[[1, 2, 4, 1]], axis=0), axis=1), abs=1e-9)
    assert np.array_equal(after.target[[0, 3]], points.target[[0, 3]])
    assert np.array_equal(after.source, points.source)
    page.page.keyboard.press("Control+z")
    assert page.points == points


def test_shift_turns_in_steps_and_keys_by_two_or_fifteen_degrees(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    select(page, 1, 2)
    about = points.target[[1, 2]].mean(axis=0)
    turn_by_hand(page, about, 41, "Shift")
    assert page.points.target[[1, 2]] == pytest.approx(turned(points.target[[1, 2]], about, 45), abs=1e-9)
    page.page.keyboard.press("Control+z")
    for _ in range(3):
        page.page.keyboard.press(".")
    assert page.points.target[[1, 2]] == pytest.approx(turned(points.target[[1, 2]], about, 6), abs=1e-9)
    page.page.keyboard.press("Shift+,")
    assert page.points.target[[1, 2]] == pytest.approx(turned(points.target[[1, 2]], about, -9), abs=1e-9)
    page.page.keyboard.press("Alt+.")
    assert page.points.target[[1, 2]] == pytest.approx(turned(points.target[[1, 2]], about, -9, 1.02), abs=1e-9)
    kinds = [m["kind"] for m in page.js("models.editor.sent") if m["phase"] == "end"]
    assert [kind for kind, before in zip(kinds, [None, *kinds], strict=False) if kind != before] == [
        "turn",
        "undo",
        "turn",
        "scale",
    ]


def test_alt_scales_by_the_handle(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    select(page, 1, 2)
    about = points.target[[1, 2]].mean(axis=0)
    (x, y), (mx, my) = knob(page), page.to_screen(about)
    mouse = page.page.mouse
    mouse.move(x, y)
    mouse.down()
    page.page.keyboard.down("Alt")
    mouse.move(mx + 0.5 * (x - mx), my + 0.5 * (y - my), steps=4)
    mouse.up()
    page.page.keyboard.up("Alt")
    assert page.points.target[[1, 2]] == pytest.approx(turned(points.target[[1, 2]], about, 0, 0.5), abs=0.4)


@pytest.mark.parametrize("degrees", [30, -20])
def test_one_point_gets_a_rim_and_its_neighbourhood_turns(
    open_editor: Any, picture: Picture, points: ControlPoints, degrees: float
) -> None:
    page = open_editor(Editor(picture, points))
    select(page, 4)
    turn_by_hand(page, points.target[4], degrees)
    after = page.points
    assert after.names[5:] == ("middle rim",) * 3
    assert np.array_equal(after.target[:5], points.target)
    # Forward the neighbourhood turns, so the backward gradient at the pin is the rotation back. The rim turns by the
    # angle, its middle by more: whatever interpolates bends there on its way to rest (by 7 % for a cubic spline in this
    # place, by 10 % for the default), so another interpolant of the same points tells the angle.
    gradient = np.eye(2) + page.editor.fit().jacobian(points.target[4])
    forward = np.linalg.inv(gradient)
    angle = np.degrees(np.arctan2(forward[1, 0] - forward[0, 1], forward[0, 0] + forward[1, 1]))
    other = RBFInterpolator(after.target, after.source, kernel="cubic", degree=1)
    beside = other(points.target[4] + 1e-3 * np.concatenate([np.eye(2), -np.eye(2)]))
    turn = np.linalg.inv((beside[:2] - beside[2:]).T / 2e-3)
    assert angle == pytest.approx(np.degrees(np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])), abs=3)
    assert abs(angle) >= abs(degrees)
    assert np.linalg.svd(forward)[1] == pytest.approx([1, 1], abs=0.1)
    away = np.linalg.norm(after.source[5:] - points.target[4], axis=1)
    assert away == pytest.approx(np.full(3, away[0]), abs=1e-9)
    assert after.target[5:] == pytest.approx(turned(after.source[5:], points.target[4], degrees), abs=0.4)
    turn_by_hand(page, points.target[4], -degrees)
    assert len(page.points) == 8  # the same rim
    assert page.points.target[5:] == pytest.approx(after.source[5:], abs=0.5)
    page.page.keyboard.press("Control+z")
    page.page.keyboard.press("Control+z")
    assert page.points.ids == points.ids  # one step each


def test_the_rim_goes_with_its_pin(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    select(page, 4)
    page.page.keyboard.press("Shift+.")
    rim = page.points
    k = page.js(f"{PAGE}.viewport.view.k")
    page.drag(points.target[4], (24, 18))
    assert page.points.target[4:] == pytest.approx(rim.target[4:] + np.array([24, 18]) / k, abs=1e-9)
    page.page.locator("[data-id='4']").focus()
    page.page.keyboard.press("Delete")
    assert page.points.ids == (0, 1, 2, 3)


def test_the_menu_turns_too_and_tells_what_it_cannot(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points), size=(600, 600))
    page.page.locator("[data-command=more]").click()
    menu = page.page.get_by_role("menu")
    assert menu.is_visible()
    right = page.page.get_by_role("menuitem", name="Turn right by 15")
    assert right.get_attribute("aria-disabled") == "true"
    page.page.keyboard.press("Escape")
    assert menu.is_hidden()
    assert page.js("document.activeElement.dataset.command") == "more"
    select(page, 1, 2)
    page.page.locator("[data-command=more]").click()
    right.click()
    about = points.target[[1, 2]].mean(axis=0)
    assert page.points.target[[1, 2]] == pytest.approx(turned(points.target[[1, 2]], about, 15), abs=1e-9)
    assert menu.is_hidden()
    page.page.locator("[data-command=more]").click()
    for _ in range(2):
        page.page.keyboard.press("ArrowDown")
    page.page.keyboard.press("Enter")
    page.wait_answered()
    assert page.editor.snap > 0
    assert menu.is_hidden()
    assert page.page.locator(".dnb-ed-bar").bounding_box()["height"] < 45  # one row, as in the studio


@pytest.mark.parametrize("height", [120, 560])
def test_a_flat_picture_does_not_cut_the_menu_off(
    open_editor: Any, picture: Picture, points: ControlPoints, height: int
) -> None:
    page = open_editor(Editor(picture, points, height=height), size=(545, 700))
    page.js("{ document.body.style.height = '3000px'; document.getElementById('root').style.overflow = 'hidden'; }")
    page.page.locator("[data-command=more]").click()
    reached = page.js("""[...document.querySelectorAll(".dnb-ed-item")].map((item) => {
        const b = item.getBoundingClientRect(), x = b.left + b.width / 2, y = b.top + b.height / 2;
        return document.elementFromPoint(x, y)?.closest(".dnb-ed-item") === item; })""")
    assert len(reached) > 8
    assert all(reached)
    page.page.mouse.move(300, 400)
    page.page.mouse.wheel(0, 200)  # it does not stay where its button was
    page.wait("document.querySelector('.dnb-ed-more').hidden")
    assert page.js("document.activeElement.dataset.command") == "more"
    page.page.locator("[data-command=more]").click()
    page.page.keyboard.press("Tab")
    page.wait("document.querySelector('.dnb-ed-more').hidden")


# ---- locks ----------------------------------------------------------------------------------------------------------


def test_a_locked_point_does_not_move_by_any_hand(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    points = points.move(4, [80, 30])
    editor, kinds = Editor(picture, points), []
    editor.on_edit(lambda edit: kinds.append(edit.kind), details=True)
    page = open_editor(editor)
    select(page, 4)
    page.page.keyboard.press("l")
    assert page.points.locked.tolist() == [False] * 4 + [True]
    assert kinds == ["lock"]
    assert page.page.locator("[data-id='4'] .dnb-ed-lock").is_visible()
    assert page.page.locator("[data-id='3'] .dnb-ed-lock").is_hidden()
    assert page.page.locator("[data-id='4']").get_attribute("aria-label").endswith(", locked")
    locked = page.points
    page.drag(points.target[4], (30, 10))
    page.drag(points.source[4], (30, 10))
    page.page.locator("[data-id='4']").focus()
    for key in ("ArrowRight", "Home", "Delete", ".", "Alt+."):
        page.page.keyboard.press(key)
    page.page.mouse.click(*page.to_screen(points.target[4]), button="right")
    assert page.points == locked
    assert "is locked" in message_text(page.page)
    page.page.keyboard.press("Control+a")
    page.page.keyboard.press("ArrowRight")
    du = picture.raster.spacing[0]
    assert page.points.target == pytest.approx(points.target + np.array([[du, 0]] * 4 + [[0, 0]]), abs=1e-9)
    page.page.keyboard.press("Delete")
    assert page.points.ids == (4,)
    page.page.keyboard.press("Control+z")
    select(page, 4)
    page.page.keyboard.press("l")
    page.drag(points.target[4], (20, 0))
    assert page.points.target[4, 0] > 83


def test_locks_and_radii_come_through_an_edit(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    points = points.edit(0, locked=True).edit(2, radius=90.0)
    page = open_editor(Editor(picture, points))
    page.drag(points.target[4], (20, 5))
    after = page.points
    assert after.locked.tolist() == [True, False, False, False, False]
    assert after.radius[2] == 90
    assert np.isnan(after.radius[[0, 1, 3, 4]]).all()


# ---- the grid that holds, and folds ---------------------------------------------------------------------------------


def nodes(page: EditorOnPage, picture: Picture) -> NDArray[np.float64]:
    """Those of the grid that is drawn."""
    a0, a1, b0, b1 = picture.raster.box
    size = max(a1 - a0, b1 - b0) / page.editor.density
    columns, rows = round((a1 - a0) / size), round((b1 - b0) / size)
    lines = np.linspace(a0, a1, columns + 1), np.linspace(b0, b1, rows + 1)
    return np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)


def test_targets_snap_to_the_nodes_of_the_drawn_grid(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("Shift+N")
    page.wait("models.editor.get('snap') > 0")
    assert page.editor.snap == pytest.approx(120 / 16)
    grid = nodes(page, picture)

    def off(place: Any) -> float:
        return float(np.linalg.norm(grid - place, axis=1).min())

    page.drag(points.target[4], (31, 17))
    assert off(page.points.target[4]) < 1e-9
    page.page.mouse.dblclick(*page.to_screen([47, 3]))
    assert off(page.points.target[5]) < 1e-9
    assert np.linalg.norm(page.points.target[5] - [47, 3]) < 120 / 16
    before = page.points.target[3]
    mouse = page.page.mouse
    x, y = page.to_screen(before)
    mouse.move(x, y)
    mouse.down()
    page.page.keyboard.down("Alt")
    mouse.move(x + 13, y + 9, steps=3)
    mouse.up()
    page.page.keyboard.up("Alt")
    k = page.js(f"{PAGE}.viewport.view.k")
    assert page.points.target[3] == pytest.approx(before + np.array([13, 9]) / k, abs=1e-9)
    page.editor.snap = 10.0  # a step in the picture's unit
    page.drag(page.points.target[2], (21, -13))
    box = np.array([picture.raster.box[0], picture.raster.box[2]])
    steps = (page.points.target[2] - box) / 10
    assert steps == pytest.approx(np.round(steps), abs=1e-9)


def test_points_stop_before_the_picture_folds(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    editor = Editor(picture, points)
    page = open_editor(editor)
    assert page.page.locator("[data-command=stop]").get_attribute("aria-pressed") == "true"  # from the beginning
    far = np.array(page.to_screen([70, 25]))
    page.drag([70, 25], (330, 60), steps=12)
    stopped = page.points.target[4]
    status = message_text(page.page)
    assert status.startswith("Stopped before tissue folds")
    assert 0.04 < page.js(f"{PAGE}.map.folds.least") < 0.12
    way = np.array(page.to_screen(stopped)) - far
    assert np.cross([*way, 0], [330, 60, 0])[2] == pytest.approx(0, abs=1e-6 * 330 * 330)
    assert 0.1 < np.linalg.norm(way) / np.hypot(330, 60) < 0.95
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("t")
    page.wait_answered()
    assert not editor.stop_at_folds
    page.drag(stopped, (330 - way[0], 60 - way[1]), steps=6)
    assert page.js(f"{PAGE}.map.folds.least") < 0
    assert "Stopped" not in message_text(page.page)


def test_arrow_keys_stop_before_the_picture_folds(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.page.locator("[data-id='4']").focus()
    for _ in range(30):
        page.page.keyboard.press("Shift+ArrowRight")
    page.wait_answered()
    stopped = page.points.target[4]
    assert 0.04 < page.js(f"{PAGE}.map.folds.least") < 0.12
    assert message_text(page.page).startswith("Stopped before tissue folds")
    page.page.keyboard.press("ArrowLeft")  # back is free
    page.wait_answered()
    step = page.editor.picture.raster.spacing[0]
    assert page.points.target[4] == pytest.approx(stopped - [step, 0], abs=1e-6)
    assert "Stopped" not in message_text(page.page)
    page.page.keyboard.press("t")
    for _ in range(30):
        page.page.keyboard.press("Shift+ArrowRight")
    page.wait_answered()
    assert page.js(f"{PAGE}.map.folds.least") < 0


@pytest.mark.parametrize("stops", [False, True])
def test_a_drop_keeps_the_fit_of_the_last_move(
    open_editor: Any, picture: Picture, points: ControlPoints, stops: bool
) -> None:
    page = open_editor(Editor(picture, points, stop_at_folds=stops))
    at = page.to_screen(points.target[4])
    page.page.mouse.move(*at)
    page.page.mouse.down()
    page.page.mouse.move(at[0] + 9, at[1] + 5, steps=3)
    page.wait(f"{PAGE}.tools.drag.drag0 && !{PAGE}.frames.isMoving && !{PAGE}.frames.request")
    page.js(f"{{ window.moved = {PAGE}.map.layered; }}")
    page.page.mouse.up()
    assert np.linalg.norm(page.points.target[4] - points.target[4]) > 1
    assert page.js(f"window.moved === {PAGE}.map.layered")


def test_folds_in_air_stop_no_drag(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, stop_at_folds=True, air=float(picture.values.max())))  # nothing but air
    page.drag([70, 25], (330, 60), steps=12)
    assert "Stopped" not in message_text(page.page)
    assert page.js(f"{PAGE}.map.folds.air") > 0
    assert np.array(page.to_screen(page.points.target[4])) - page.to_screen([70, 25]) == pytest.approx([330, 60], abs=1)


def test_what_is_folded_already_can_be_moved_back(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    editor = Editor(picture, points.move(4, [125, 40]), stop_at_folds=True)
    page = open_editor(editor)
    assert page.js(f"{PAGE}.map.folds.least") < 0
    k = page.js(f"{PAGE}.viewport.view.k")
    page.drag([125, 40], (-45 * k, -10 * k), steps=6)
    assert page.points.target[4] == pytest.approx([80, 30], abs=1)


# ---- what gets further than the stop --------------------------------------------------------------------------------


def offers(page: EditorOnPage) -> dict[str, str]:
    """The buttons of the message that says where a drag was stopped, and their words."""
    page.wait(f"!{PAGE}.tools.foldOffers.isTrying && {PAGE}.tools.foldOffers.isShown")
    found = page.page.locator("[data-action]")
    return {found.nth(k).get_attribute("data-action"): found.nth(k).inner_text() for k in range(found.count())}


def assert_same_places(found: ControlPoints, expected: ControlPoints) -> None:
    """The same points; ids that were given since count on."""
    assert found.ids == expected.ids
    assert found.target == pytest.approx(expected.target, abs=1e-9)


def test_each_way_that_is_offered_goes_on_to_the_pointer_as_one_step(open_editor: Any, picture: Picture) -> None:
    corners = [[11, -30], [129, -30], [129, 77], [11, 77]]
    start = ControlPoints.from_arrays([*corners, [45, 20], [70, 20], [70, 45], [45, 45]])
    page = open_editor(Editor(picture, start, support=60.0))
    way = np.array([34.0, 8.0])
    k = page.js(f"{PAGE}.viewport.view.k")
    drag = tuple(k * way)
    page.drag(start.target[5], drag, steps=6)
    stopped = page.points
    share = float(np.linalg.norm(stopped.target[5] - start.target[5]) / np.linalg.norm(way))
    assert 0.05 < share < 0.9
    found = offers(page)
    words = message_text(page.page)
    assert f"Stopped before tissue folds, at {100 * share:.0f} % of the drag" in words
    assert {"stages", "points"} <= set(found)
    for name, text in found.items():
        page.page.locator(f"[data-action={name}]").click()
        page.wait_answered()
        far = float((page.points.target[5] - start.target[5]) @ way / (way @ way))
        assert far > share + 0.04
        assert far == pytest.approx(float(text.split(":")[1].strip(" %")) / 100 if ":" in text else 1.0, abs=0.01)
        assert page.js(f"{PAGE}.map.folds.least") > 0
        assert "Stopped" not in message_text(page.page)
        page.page.locator(".dnb-ed-stage").focus()
        page.page.keyboard.press("Control+z")
        page.wait_answered()
        assert_same_places(page.points, stopped)
        assert (page.editor.settings.stages, page.editor.settings.support) == (1, 60.0)
        assert not page.editor.parts
        page.page.keyboard.press("Control+z")
        page.wait_answered()
        assert_same_places(page.points, start)
        page.drag(start.target[5], drag, steps=6)
        assert_same_places(page.points, stopped)
        assert offers(page) == found


@pytest.mark.parametrize("is_offered", [False, True])
@pytest.mark.parametrize("end", ["Control+z", "t", "support"])
def test_what_is_said_of_a_stopped_drag_goes_with_what_it_is_about(
    open_editor: Any, picture: Picture, points: ControlPoints, end: str, is_offered: bool
) -> None:
    page = open_editor(Editor(picture, points, support=60.0))
    page.drag([70, 25], (330, 60), steps=12)
    if is_offered:
        offers(page)
    assert message_text(page.page).startswith("Stopped before tissue folds")
    if end == "support":
        page.editor.support = 90.0
    else:
        page.page.keyboard.press(end)
    page.wait(f"!{PAGE}.tools.foldOffers.isTrying")
    page.wait_settled()
    assert "Stopped" not in message_text(page.page)
    assert page.page.locator("[data-action]").count() == 0


def test_a_stopped_drag_that_is_given_up_leaves_no_word(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    x, y = page.to_screen([70, 25])
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 330, y + 60, steps=6)
    page.wait(f"{message_script()}.startsWith('Stopped before tissue folds')")
    page.page.keyboard.press("Escape")
    page.wait_settled()
    assert "Stopped" not in message_text(page.page)
    page.page.mouse.up()
    assert page.points == points


def test_only_what_gets_further_is_offered(open_editor: Any, picture: Picture) -> None:
    locked = ControlPoints.from_arrays([[60, 20], [64, 20], [56, 20]])
    locked = locked.edit(1, locked=True).edit(2, locked=True)
    page = open_editor(Editor(picture, locked, stages=64, support=500.0, kernel="wendland_c2"))
    k = page.js(f"{PAGE}.viewport.view.k")
    page.drag([60, 20], (10 * k, 0))  # through a point that is held, in as many stages as there are
    assert offers(page) == {}
    assert "hold fewer points" in message_text(page.page)
    page.page.keyboard.press("Escape")


def test_a_drag_that_is_not_stopped_offers_nothing(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.drag(points.target[4], (9, 5))
    assert "Stopped" not in message_text(page.page)
    assert not page.js(f"{PAGE}.tools.foldOffers.isTrying")


def test_tissue_at_another_depth_stops_a_drag_on_a_slice(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    air = float(picture.values.max())  # the slice shows nothing but air
    behind = Mask(np.ones(picture.raster.shape, bool), picture.raster)
    page = open_editor(Editor(picture, points, air=air, tissue=region_to_data(behind)))
    page.drag([70, 25], (330, 60), steps=12)
    assert message_text(page.page).startswith("Stopped before tissue folds")
    page.page.keyboard.press("Control+z")
    page.editor.tissue = region_to_data(Mask(~behind.values, picture.raster))
    page.wait_settled()
    page.drag([70, 25], (330, 60), steps=12)
    assert np.array(page.to_screen(page.points.target[4])) - page.to_screen([70, 25]) == pytest.approx([330, 60], abs=1)

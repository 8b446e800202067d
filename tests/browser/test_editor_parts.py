"""The motion of a rigid part on the picture: dragged by its inside, turned by its ring, about a pivot."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from browser.pane_messages import message_script, message_text
from browser.test_editor_shapes import assert_as_the_core
from browser.test_editor_touch import Fingers

from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart, without_conflicts
from deformnb.volume.plane import Picture, Raster
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.messages.editors import PointsEdit

pytestmark = pytest.mark.needs_browser

CORNERS = [(62.0, 10.0), (86.0, 10.0), (86.0, 40.0), (62.0, 40.0)]
MIDDLE = (74.0, 25.0)
INSIDE = (67.0, 33.0)  # beside the pivot
BONE = RigidPart(Polygon(CORNERS), name="bone")


def frame() -> ControlPoints:
    """Points at rest in the corners of the picture."""
    return ControlPoints.from_arrays([[15.0, -25], [150, -25], [150, 50], [15, 50]])


def choose(page: EditorOnPage, place: Any = (62.0, 18.0)) -> None:
    """Chooses a part by its line."""
    page.page.mouse.click(*page.to_screen(place))
    page.page.locator(".dnb-ed-motion").wait_for(state="visible")


def handle(page: EditorOnPage, name: str) -> tuple[float, float]:
    """The place of the knob or the cross on the screen."""
    x, y = page.js(
        f"(({{ left, top, width, height }}) => [left + width / 2, top + height / 2])"
        f"(document.querySelector('{name} .dnb-ed-hit').getBoundingClientRect())"
    )
    return x, y


def turn(page: EditorOnPage, degrees: float) -> None:
    """Drags the knob around the pivot by an angle, and leaves the button down."""
    at, about = np.array(handle(page, ".dnb-ed-part-knob")), np.array(handle(page, ".dnb-ed-pivot"))
    mouse = page.page.mouse
    mouse.move(*at)
    mouse.down()
    for share in (0.25, 0.5, 0.75, 1.0):
        mouse.move(*(about + (at - about) @ np.array(RigidMotion.turn(share * degrees, (0, 0)).matrix).T))


def undo(page: EditorOnPage) -> None:
    page.page.locator("[data-command=undo]").click()
    page.wait_answered()


def assert_motion(part: RigidPart, motion: RigidMotion, tolerance: float = 1e-6) -> None:
    assert part.motion is not None
    for place in ((0.0, 0.0), (100.0, 0.0), (0.0, 100.0)):
        np.testing.assert_allclose(part.motion(place), motion(place), atol=tolerance)


# ---- the pointer ----------------------------------------------------------------------------------------------------


def test_a_part_is_moved_by_its_inside_and_what_is_around_it_bends(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, frame(), show_grid=False, theme="light", parts=[BONE]))
    k = page.js(f"{PAGE}.viewport.view.k")
    page.drag(INSIDE, (40, -25))
    page.wait_answered()
    assert page.editor.parts == (BONE,)  # what is not chosen is not moved
    page.page.mouse.click(*page.to_screen(INSIDE))
    page.wait_answered()
    assert page.editor.chosen_shape == {"what": "parts", "index": 0}
    x, y = page.to_screen(INSIDE)
    moves: list[PointsEdit] = []
    page.editor.on_edit(moves.append, details=True)
    page.wait(f"{PAGE}.model.get('live')")
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 40, y - 25, steps=4)
    page.wait(f"{PAGE}.map.layered.fit.rigid[0].back.isStill === false")
    assert message_text(page.page) == f"moved {40 / k:.1f}, {-25 / k:.1f}"
    assert page.editor.parts == (BONE,)  # on its way it is no edit
    page.wait_answered()
    (on_the_way,) = moves[-1].with_part(page.editor.parts)
    page.page.keyboard.press("Escape")
    page.wait_answered()
    assert moves[-1].with_part(page.editor.parts) == (BONE,)  # and one that is given up ends where it began
    page.page.mouse.up()
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 40, y - 25, steps=4)
    page.page.mouse.up()
    page.wait_answered()
    (part,) = page.editor.parts
    assert_motion(on_the_way, part.motion)
    assert part.region == BONE.region
    assert_motion(part, RigidMotion.turn(0, MIDDLE, (40 / k, -25 / k)))
    assert_as_the_core(page, picture, 100_000)
    corner = page.page.locator("[data-corner='0']").bounding_box()
    np.testing.assert_allclose(
        [corner["x"] + corner["width"] / 2, corner["y"] + corner["height"] / 2],
        page.to_screen(part.motion(CORNERS[0])),
        atol=1.5,
    )
    undo(page)
    assert page.editor.parts == (BONE,)


def test_a_ring_turns_a_part_about_its_pivot_which_can_be_dragged(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, frame(), show_grid=False, theme="light", parts=[BONE]))
    choose(page)
    cross, joint = handle(page, ".dnb-ed-pivot"), page.to_screen((86.0, 40.0 - 6))
    np.testing.assert_allclose(cross, page.to_screen(MIDDLE), atol=1)
    page.page.mouse.move(*cross)
    page.page.mouse.down()
    page.page.mouse.move(*joint, steps=3)
    page.page.mouse.up()
    page.wait_answered()
    (part,) = page.editor.parts
    np.testing.assert_allclose(part.pivot, (86, 34), atol=0.3)
    assert part.motion is None
    turn(page, 33)
    page.wait(f"{message_script()}.startsWith('turned 33')")
    page.page.keyboard.down("Shift")
    page.page.mouse.move(*handle(page, ".dnb-ed-part-knob"))
    page.wait(f"{message_script()} === 'turned 30\\u00b0'")
    page.page.mouse.up()
    page.page.keyboard.up("Shift")
    page.wait_answered()
    assert_motion(page.editor.parts[0], RigidMotion.turn(30, part.pivot))
    assert page.editor.parts[0].pivot == part.pivot
    assert_as_the_core(page, picture, 100_000)
    undo(page)
    assert page.editor.parts == (part,)
    undo(page)
    assert page.editor.parts == (BONE,)


def test_the_outline_of_a_moved_part_is_reshaped_where_the_part_is_seen(open_editor: Any, picture: Picture) -> None:
    motion = RigidMotion.turn(90, MIDDLE, (20, 0))
    page = open_editor(Editor(picture, frame(), parts=[RigidPart(Polygon(CORNERS), motion, name="bone")]))
    k = page.js(f"{PAGE}.viewport.view.k")
    at = motion(CORNERS[0])
    choose(page, (motion(CORNERS[0]) * 0.7 + motion(CORNERS[1]) * 0.3))
    page.drag(at, (30, -12))
    page.wait_answered()
    (part,) = page.editor.parts
    assert part.motion == motion
    np.testing.assert_allclose(motion(part.region.vertices[0]), at + np.array([30, -12]) / k, atol=1e-6)
    np.testing.assert_allclose(part.region.vertices[1:], CORNERS[1:])


@pytest.mark.parametrize(
    "region",
    [
        HalfSpace((70.0, 20.0), (0.0, -1.0)),
        Mask(np.pad(np.ones((12, 10), bool), 3), Raster((18, 16), (2.0, 2.0), (50.0, 5.0))),
    ],
)
def test_every_kind_of_region_is_moved_by_its_inside(open_editor: Any, picture: Picture, region: Any) -> None:
    page = open_editor(Editor(picture, ControlPoints.from_arrays([[15.0, -25], [150, -25]]), parts=[RigidPart(region)]))
    k = page.js(f"{PAGE}.viewport.view.k")
    page.page.mouse.click(*page.to_screen((60.0, 30.0)))
    page.drag((60.0, 30.0), (-24, 18))
    page.wait_answered()
    assert_motion(page.editor.parts[0], RigidMotion.turn(0, (0, 0), (-24 / k, 18 / k)))


def test_a_part_alone_says_that_nothing_holds_the_rest(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, ControlPoints.empty(), parts=[BONE]))
    choose(page)
    page.drag(INSIDE, (30, 0))
    assert "nothing holds the tissue around it" in message_text(page.page)


def test_a_drag_of_a_part_stops_before_the_picture_folds(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, frame().add([94.0, 25.0], [94.0, 25.0]), parts=[BONE], stop_at_folds=True))
    choose(page)
    turn(page, 75)
    page.wait(f"{message_script()}.startsWith('Stopped before tissue folds')")
    page.page.mouse.up()
    page.wait_answered()
    (part,) = page.editor.parts
    assert part.motion is not None
    assert 5 < np.degrees(np.arctan2(*part.motion.matrix[1])) < 70
    assert page.js(f"{PAGE}.map.folds.least") > 0


def test_the_inside_of_a_part_takes_points_and_no_right_click(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, frame(), parts=[BONE]))
    choose(page)
    page.page.mouse.click(*page.to_screen(INSIDE), button="right")
    page.page.mouse.dblclick(*page.to_screen(INSIDE))
    page.wait_answered()
    assert (len(page.editor.parts), len(page.editor.points)) == (1, 5)
    page.editor.read_only = True
    page.wait_settled()
    choose_place = page.to_screen((62.0, 18.0))
    page.page.mouse.click(*choose_place)
    page.drag((70.0, 16.0), (30, 0))
    page.wait_answered()
    assert page.editor.parts == (BONE,)
    assert page.page.locator(".dnb-ed-motion").is_hidden()


def test_escape_gives_a_drag_of_a_part_up(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, frame(), parts=[BONE]))
    choose(page)
    turn(page, 40)
    page.page.keyboard.press("Escape")
    page.page.mouse.up()
    page.wait_answered()
    assert page.editor.parts == (BONE,)
    page.wait(f"{PAGE}.points.shapes.parts[0].motion === null && {PAGE}.map.layered.fit.rigid[0].back.isStill")


# ---- keys and fingers -----------------------------------------------------------------------------------------------


def test_keys_move_and_turn_a_part_and_quick_presses_are_one_step(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, frame(), parts=[BONE]))
    du, dv = picture.raster.spacing
    page.page.locator("[data-shape='parts:0']").focus()
    for key in ("ArrowRight", "ArrowRight", "Shift+ArrowUp"):
        page.page.keyboard.press(key)
    page.wait_answered()
    assert_motion(page.editor.parts[0], RigidMotion.turn(0, MIDDLE, (2 * du, -10 * dv)))
    for key in (".", "Shift+.", ","):
        page.page.keyboard.press(key)
    page.wait_answered()
    assert_motion(page.editor.parts[0], RigidMotion.turn(15, MIDDLE, (2 * du, -10 * dv)))
    assert page.page.locator(".dnb-ed-spoken").inner_text() == (f"bone moved {2 * du:g}, {-10 * dv:g}, turned 15\u00b0")
    page.page.locator(".dnb-ed-part-knob").focus()
    page.page.keyboard.press("ArrowLeft")
    page.wait_answered()
    assert page.page.get_by_role("slider", name="Turn of bone").get_attribute("aria-valuenow") == "14"
    page.page.locator(".dnb-ed-pivot").focus()
    page.page.keyboard.press("Shift+ArrowDown")
    page.wait_answered()
    assert page.editor.parts[0].pivot is not None
    page.page.locator("[data-shape='parts:0']").focus()
    page.page.keyboard.press("Home")
    page.wait_answered()
    assert page.editor.parts[0].motion is None
    joined = page.js("models.editor.sent.filter((m) => m.type === 'shapes').map((m) => [m.kind, Boolean(m.joins)])")
    assert joined[0] == ["move bone", True]
    assert joined[-1] == ["put back bone", False]


def test_a_finger_moves_the_chosen_part(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, frame(), parts=[BONE]))
    fingers, k = Fingers(page.page), page.js(f"{PAGE}.viewport.view.k")
    fingers.tap(page.to_screen(INSIDE))
    page.page.locator(".dnb-ed-motion").wait_for(state="visible")
    before = page.js(f"[{PAGE}.viewport.view.x, {PAGE}.viewport.view.y]")
    fingers.drag(page.to_screen(INSIDE), (36, 24))
    page.wait_answered()
    assert_motion(page.editor.parts[0], RigidMotion.turn(0, MIDDLE, (36 / k, 24 / k)), 0.3)
    assert page.js(f"[{PAGE}.viewport.view.x, {PAGE}.viewport.view.y]") == before  # the view stays


# ---- points in a part -----------------------------------------------------------------------------------------------


def test_points_that_a_part_carries_go_with_it(open_editor: Any, picture: Picture) -> None:
    points = frame().add([80.0, 30.0], [80.0, 30.0])
    page = open_editor(Editor(picture, points, parts=[BONE]))
    choose(page)
    turn(page, 25)
    page.page.mouse.up()
    page.wait_answered()
    (part,) = page.editor.parts
    np.testing.assert_allclose(page.editor.points.target[4], part.motion([80.0, 30.0]), atol=1e-6)
    page.editor.fit()
    undo(page)
    assert (page.editor.parts, page.editor.points) == ((BONE,), points)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("how", ["carry", "off", "cancel"])
def test_a_part_laid_over_points_asks_once_what_becomes_of_them(open_editor: Any, picture: Picture, how: str) -> None:
    points = frame().add([104.0, 20.0], [104.0, 20.0]).add([106.0, 30.0], [106.0, 30.0])
    page = open_editor(Editor(picture, points, parts=[BONE], stop_at_folds=False))
    k = page.js(f"{PAGE}.viewport.view.k")
    choose(page)
    page.drag(INSIDE, (26 * k, 0))
    page.wait_answered()
    assert (page.editor.parts, page.editor.points) == ((BONE,), points)  # until there is an answer
    assert message_text(page.page).startswith("2 control points in this rigid part require another movement")
    page.page.locator(f"[data-action={how}]").click()
    page.wait_answered()
    assert "this rigid part" not in message_text(page.page)
    if how == "cancel":
        assert (page.editor.parts, page.editor.points) == ((BONE,), points)
        return
    (part,) = page.editor.parts
    assert_motion(part, RigidMotion.turn(0, MIDDLE, (26, 0)), 1e-3)
    wanted = without_conflicts(points, [part], "carry" if how == "carry" else "switch off")
    np.testing.assert_allclose(page.editor.points.target, wanted.target, atol=1e-6)
    assert page.editor.points.active.tolist() == wanted.active.tolist()
    page.editor.fit()
    undo(page)  # one edit
    assert (page.editor.parts, page.editor.points) == ((BONE,), points)


def test_parts_that_python_proposes_are_asked_about_in_the_same_way(open_editor: Any, picture: Picture) -> None:
    points = frame().add([104.0, 20.0], [104.0, 20.0]).add([80.0, 30.0], [80.0, 30.0])
    page = open_editor(Editor(picture, points, parts=[BONE]))
    moved = RigidPart(BONE.region, RigidMotion.turn(0, (0, 0), (24, 0)), name="bone")
    page.editor.propose([moved], "shift bone")
    page.wait("document.querySelector('[data-action=off]')")
    assert "Point 5 in this rigid part requires another" in message_text(page.page)
    page.page.get_by_role("button", name="Switch it off").click()
    page.wait_answered()
    assert page.editor.parts == (moved,)
    assert page.editor.points.active.tolist() == [True] * 4 + [False, True]
    np.testing.assert_allclose(page.editor.points.target[5], (104, 30))  # carried
    assert page.js("models.editor.sent.at(-1).kind") == "shift bone, switch off its points"


def test_a_small_part_has_room_to_be_dragged(open_editor: Any, picture: Picture) -> None:
    small = RigidPart(Polygon([(70, 20), (74, 20), (74, 24), (70, 24)]), name="stone")
    page = open_editor(Editor(picture, frame(), parts=[small]))
    choose(page, (72, 22))
    page.drag((70, 20), (30, 0))  # where a corner would be
    page.wait_answered()
    assert page.editor.parts[0].region == small.region
    assert page.editor.parts[0].motion is not None

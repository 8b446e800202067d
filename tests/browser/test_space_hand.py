"""Turning, the mirror and the lattice of the editor in space, with the real mouse and keys in a real browser."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from browser.app_tab import wait_until
from browser.live_page import LivePage
from browser.pane_messages import message_script, message_text
from browser.test_hand import assert_same_places
from browser.test_space_editor_page import PAGE, Opened, waves
from numpy.typing import NDArray

from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.volume import Volume
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.editor.space_slices import SpacePictures, slice_folds, tissue_mask

pytestmark = pytest.mark.needs_browser

# The box of the waves: x from -20.5 to 35.5, y from 9.4 to 67, z from 4.25 to 64.25. Its middle across x:
MIDDLE = 7.5
AXIAL, CORONAL, SAGITTAL = range(3)


@pytest.fixture
def pairs() -> ControlPoints:
    """Two pairs beside the middle plane across x, and one on it."""
    return ControlPoints.from_arrays(
        [[-12.5, 25, 24], [27.5, 25, 24], [-2.5, 50, 24], [17.5, 50, 24], [MIDDLE, 38, 24]]
    )


@pytest.fixture
def open_editor(page: LivePage) -> Iterator[Callable[..., Opened]]:
    spaces: list[Opened] = []

    def make(points: ControlPoints, **settings: Any) -> Opened:
        spaces.append(Opened(page, SpaceEditor(waves(), points, cursor=[MIDDLE, 38, 24], **settings)))
        return spaces[-1]

    yield make
    for space in spaces:
        space.editor.close()
    assert page.errors == []


def press(space: Opened, *keys: str) -> None:
    for key in keys:
        space.page.page.keyboard.press(key)
    space.wait_settled()


def select(space: Opened, *ids: int) -> None:
    space.js(f"{PAGE}.parts.points.select({list(ids)})")
    space.page.page.locator(".dnb-sp-stage").first.focus()
    space.wait_settled()


def mirrored(places: Any, axis: int = 0, at: float = MIDDLE) -> NDArray[np.float64]:
    out = np.array(places, dtype=float)
    out[..., axis] = 2 * at - out[..., axis]
    return out


def turned(places: Any, degrees: float, plane: tuple[int, int] = (0, 1)) -> NDArray[np.float64]:
    """Places turned about their middle, from the first of these axes towards the second."""
    out, (a, b), angle = np.array(places, dtype=float), plane, np.radians(degrees)
    x, y = (out[:, k] - out[:, k].mean() for k in plane)
    out[:, a] += x * np.cos(angle) - y * np.sin(angle) - x
    out[:, b] += x * np.sin(angle) + y * np.cos(angle) - y
    return out


# ---- turning --------------------------------------------------------------------------------------------------------


def test_keys_turn_and_scale_what_is_selected_in_the_picture_that_has_the_focus(
    open_editor: Any, pairs: ControlPoints
) -> None:
    space = open_editor(pairs)
    space.page.page.evaluate("window.clock = Date.now; Date.now = () => 0")  # two presses are quick ones
    select(space, 0, 1, 2)
    press(space, ".", ".")  # 2 degrees each, clockwise where x runs right and y down
    target = turned(pairs.target[:3], 4)
    assert space.editor.points.target[:3] == pytest.approx(target, abs=1e-6)
    assert np.array_equal(space.editor.points.target[3:], pairs.target[3:])
    assert np.array_equal(space.editor.points.source, pairs.source)
    press(space, "Control+z")
    assert space.editor.points == pairs  # quick presses are one step
    space.page.page.evaluate("Date.now = window.clock")
    press(space, "Shift+,")
    assert space.editor.points.target[:3] == pytest.approx(turned(pairs.target[:3], -15), abs=1e-6)
    press(space, "Control+z", "Alt+Shift+.")
    middle = pairs.target[:3].mean(axis=0)
    assert space.editor.points.target[:3] == pytest.approx(middle + 1.15 * (pairs.target[:3] - middle), abs=1e-6)
    press(space, "Control+z")
    space.page.page.locator(".dnb-sp-stage").nth(CORONAL).focus()
    press(space, "Shift+.")  # x right, and down there is -z
    assert space.editor.points.target[:3] == pytest.approx(turned(pairs.target[:3], -15, (0, 2)), abs=1e-6)


def test_the_round_arrow_turns_and_one_point_is_refused(open_editor: Any, pairs: ControlPoints) -> None:
    space = open_editor(pairs)
    select(space, 0, 1, 2, 3)
    marks = space.page.page.locator("[data-mark=turn]")
    assert [marks.nth(k).is_visible() for k in range(3)] == [True, True, True]
    box = marks.nth(AXIAL).locator(".dnb-ed-turn-disc").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    about = np.array(space.to_screen(AXIAL, pairs.target[:4].mean(axis=0)))
    arm = np.array([x, y]) - about
    to = about + np.array([-arm[1], arm[0]])  # a quarter
    space.mouse.move(x, y)
    space.mouse.down()
    space.mouse.move(*((np.array([x, y]) + to) / 2), steps=3)
    space.mouse.move(*to, steps=3)
    assert space.editor.points == pairs  # an edit at its end only
    space.mouse.up()
    space.wait_settled()
    assert space.editor.points.target[:4] == pytest.approx(turned(pairs.target[:4], 90), abs=0.6)
    press(space, "Control+z")
    assert space.editor.points == pairs
    select(space, 2)
    assert not marks.first.is_visible()
    press(space, ".")
    assert space.editor.points == pairs
    assert "two points or more" in message_text(space.page.page)


def test_the_menu_has_them_all(open_editor: Any, pairs: ControlPoints) -> None:
    space = open_editor(pairs)
    select(space, 0, 1)
    space.page.page.locator("[data-command=more]").click()
    items = space.page.page.locator(".dnb-ed-item > span:nth-of-type(1)")
    assert items.all_inner_texts() == [
        "Mirror",
        "Mirror in another direction",
        "Snap to a lattice",
        "Turn left by 15\u00b0",
        "Turn right by 15\u00b0",
    ]
    space.page.page.locator("[data-command=turn-right]").click()
    space.wait_settled()
    assert space.editor.points.target[:2] == pytest.approx(turned(pairs.target[:2], 15), abs=1e-6)
    space.page.page.locator("[data-command=more]").click()
    space.page.page.locator("[data-command=mirror]").click()
    space.wait_settled()
    assert space.editor.mirror == {"on": True, "axis": "x", "at": MIDDLE}


# ---- the mirror -----------------------------------------------------------------------------------------------------


def test_a_drag_moves_the_partner_on_the_other_side_of_the_plane(open_editor: Any, pairs: ControlPoints) -> None:
    space = open_editor(pairs)
    press_on = space.page.page.locator(".dnb-sp-stage").first
    press_on.focus()
    press(space, "m")
    assert space.editor.mirror == {"on": True, "axis": "x", "at": MIDDLE}
    lines = space.page.page.locator(".dnb-ed-axis-line")
    shown = space.js("[...document.querySelectorAll('.dnb-ed-axis-line')].map((e) => getComputedStyle(e).visibility)")
    assert shown == ["visible", "visible", "hidden"]  # it faces who looks from the side
    k = space.scale(AXIAL)
    box = lines.nth(AXIAL).bounding_box()
    assert box["x"] + box["width"] / 2 == pytest.approx(space.to_screen(AXIAL, [MIDDLE, 38, 24])[0], abs=1)
    space.drag(AXIAL, pairs.target[0], (-14, 20))
    by = np.array([-14, 20, 0]) / k
    after = space.editor.points
    assert after.target[0] == pytest.approx(pairs.target[0] + by, abs=1e-6)
    assert after.target[1] == pytest.approx(mirrored(after.target[0]), abs=1e-6)
    assert np.array_equal(after.target[2:], pairs.target[2:])
    press(space, "Control+z")
    assert space.editor.points == pairs  # one step for both
    space.drag(AXIAL, pairs.target[4], (18, 9))
    assert space.editor.points.target[4] == pytest.approx([MIDDLE, 38 + 9 / k, 24], abs=1e-6)  # keeps to the plane
    press(space, "Control+z")
    space.page.page.locator("[data-id='2']").first.focus()
    press(space, "Delete")
    assert space.editor.points.ids == (0, 1, 4)
    press(space, "m")
    space.drag(AXIAL, pairs.target[0], (-14, 20))
    assert np.array_equal(space.editor.points.target[1], pairs.target[1])


def test_new_points_come_in_pairs_that_hold_what_is_there(open_editor: Any, pairs: ControlPoints) -> None:
    space = open_editor(pairs)
    space.page.page.locator(".dnb-sp-stage").first.focus()
    press(space, "m")
    space.mouse.dblclick(*space.to_screen(AXIAL, [0, 60, 24]))
    space.wait_settled()
    points = space.editor.points
    assert len(points) == 7
    assert points.target[6] == pytest.approx(mirrored(points.target[5]), abs=1e-6)
    assert points.source == pytest.approx(points.target, abs=1e-6)  # at rest, all of them


def test_the_plane_can_lie_across_another_axis_and_be_dragged(open_editor: Any, pairs: ControlPoints) -> None:
    space = open_editor(pairs)
    space.page.page.locator(".dnb-sp-stage").first.focus()
    press(space, "Shift+M")
    assert space.editor.mirror["axis"] == "y"
    assert space.editor.mirror["at"] == pytest.approx(38.2, abs=1e-9)
    grip = space.page.page.locator("[data-mark='axis'] rect").first.bounding_box()
    x, y = grip["x"] + grip["width"] / 2, grip["y"] + grip["height"] / 2
    space.mouse.move(x, y)
    space.mouse.down()
    space.mouse.move(x, y + 16, steps=3)
    space.mouse.up()
    space.wait_settled()
    at = space.editor.mirror["at"]
    assert at == pytest.approx(38.2 + 16 / space.scale(AXIAL), abs=1.1 / space.scale(AXIAL))
    press(space, "ArrowUp", "Shift+ArrowDown")
    assert space.editor.mirror["at"] == pytest.approx(at + 9 * 1.2, abs=1e-6)  # voxels of 1.2
    space.mouse.move(*space.to_screen(AXIAL, [0, 60, 24]))
    at = space.editor.mirror["at"]
    press(space, "Escape")
    space.drag(AXIAL, pairs.target[4], (10, 0))  # without a partner: gets one
    points = space.editor.points
    assert len(points) == 6
    assert points.source[5] == pytest.approx(mirrored(pairs.source[4], 1, at), abs=1e-6)
    assert points.target[5] == pytest.approx(mirrored(points.target[4], 1, at), abs=1e-6)


# ---- the lattice ----------------------------------------------------------------------------------------------------


def test_targets_keep_to_the_lattice_unless_alt_is_held(open_editor: Any, pairs: ControlPoints) -> None:
    space = open_editor(pairs)
    space.page.page.locator(".dnb-sp-stage").first.focus()
    press(space, "Shift+N")
    assert space.editor.snap == 4.0  # a sixteenth of 60, in voxels of 1
    assert space.page.page.locator(".dnb-sp-nodes").first.get_attribute("d")
    space.drag(AXIAL, pairs.target[0], (17, 23))
    first = np.array([-20.0, 10.0])  # of the voxels
    target = space.editor.points.target[0]
    wanted = first + 4 * np.round((pairs.target[0, :2] + np.array([17, 23]) / space.scale(AXIAL) - first) / 4)
    assert target == pytest.approx([*wanted, 24], abs=1e-6)
    press(space, "Escape")
    space.mouse.dblclick(*space.to_screen(AXIAL, [5, 57, 24]))
    space.wait_settled()
    assert space.editor.points.target[5] == pytest.approx([4, 58, 24], abs=1e-6)
    press(space, "Shift+N")
    assert space.editor.snap == 0
    assert not space.page.page.locator(".dnb-sp-nodes").first.get_attribute("d")


# ---- waiting for pictures -------------------------------------------------------------------------------------------


def test_it_is_said_that_pictures_are_being_made(page: LivePage, monkeypatch: pytest.MonkeyPatch) -> None:
    lets = threading.Event()

    def slowly(made: Any) -> Any:
        def slow(*given: Any, **options: Any) -> Any:
            lets.wait(60)
            return made(*given, **options)

        return slow

    for name in ("slice", "projection"):
        monkeypatch.setattr(SpacePictures, name, slowly(getattr(SpacePictures, name)))
    editor = SpaceEditor(waves())
    page.add(editor, "editor")
    said = "document.querySelector('[role=status]').innerText"
    page.wait(f"{said} === 'Making the pictures'")
    assert not page.page.evaluate("document.querySelector('.dnb-ed-waiting') !== null")  # nothing is locked by it
    lets.set()
    page.wait(f"{PAGE}.parts.requests.shownCount > 0")
    page.wait(f"{said} === ''")
    wait_until(lambda: not editor.sender.worker.is_wanted)  # finer ones may come later
    editor.sender.worker.call(lambda: None).result(60)
    page.wait_answered()
    lets.clear()
    page.page.get_by_label("What the pictures show").select_option("mip")
    page.wait(f"{said} === 'Making the pictures'")
    lets.set()
    page.wait(f"{said} === ''")
    editor.close()


# ---- the stop at folds ----------------------------------------------------------------------------------------------


@pytest.fixture
def caged() -> ControlPoints:
    """The corners of the volume and a point between them, on the slices."""
    low, high = np.array([-20.0, 10.0, 5.0]), np.array([35.0, 66.4, 63.5])
    corners = [np.where(np.array([k & 1, k & 2, k & 4]) > 0, high, low) for k in range(8)]
    return ControlPoints.from_arrays([*corners, [MIDDLE, 38.0, 24.0]])


def least(points: ControlPoints) -> float:
    return slice_folds(FitSettings(support=25.0).fit(points), waves().grid).least


def test_a_drag_stops_before_tissue_folds_until_the_button_lets_it(open_editor: Any, caged: ControlPoints) -> None:
    space = open_editor(caged, support=25.0)
    space.editor.tissue = {}  # everywhere
    space.wait_settled()
    button = space.page.page.locator("[data-command=stop]")
    assert button.get_attribute("aria-pressed") == "true"
    middle = caged.target[8]
    x, y = space.to_screen(AXIAL, middle)
    by = np.array([22.0, 6.0]) * space.scale(AXIAL)
    space.mouse.move(x, y)
    space.mouse.down()
    space.mouse.move(x + by[0], y + by[1], steps=8)
    space.page.wait(f"{message_script()}.startsWith('Stopped before tissue folds')")
    held = space.js(f"{PAGE}.parts.points.withId(8).target")  # while the button is down
    assert 2 < held[0] - middle[0] < 20
    space.mouse.up()
    space.wait_settled()
    stopped = space.editor.points
    assert stopped.target[8] == pytest.approx(held, abs=1e-6)
    way = (stopped.target[8] - middle)[:2] / [22.0, 6.0]
    assert way[0] == pytest.approx(way[1], rel=1e-3)
    assert 0 < least(stopped) < 0.25
    space.page.page.locator(".dnb-sp-stage").first.focus()
    press(space, "t")
    assert button.get_attribute("aria-pressed") == "false"
    assert not space.editor.stop_at_folds
    space.drag(AXIAL, stopped.target[8], tuple(by * (1 - way[0])))
    assert least(space.editor.points) < 0
    assert "Stopped" not in message_text(space.page.page)
    assert "folds" in space.page.page.locator(".dnb-ed-folds").inner_text()


def test_keys_stop_before_tissue_folds(open_editor: Any, caged: ControlPoints) -> None:
    space = open_editor(caged, support=25.0)
    space.editor.tissue = {}  # everywhere
    space.wait_settled()
    space.page.page.locator("[data-id='8']").first.focus()
    press(space, *["Shift+ArrowRight"] * 4)  # forty voxels, in a cage of 55
    moved = space.editor.points.target[8] - caged.target[8]
    assert 2 < moved[0] < 20
    assert 0 < least(space.editor.points) < 0.25
    assert "Stopped before tissue folds" in message_text(space.page.page)
    press(space, "Shift+ArrowLeft")  # back is free
    assert space.editor.points.target[8][0] == pytest.approx(caged.target[8][0] + moved[0] - 10, abs=1e-6)
    assert "Stopped" not in message_text(space.page.page)


def offers(space: Opened) -> dict[str, str]:
    """The buttons of the message that says where a drag was stopped, and their words."""
    offered = f"{PAGE}.parts.foldOffers"
    space.page.wait(f"!{offered}.isTrying && {offered}.isShown")
    found = space.page.page.locator("[data-action]")
    return {found.nth(k).get_attribute("data-action"): found.nth(k).inner_text() for k in range(found.count())}


def test_each_way_that_is_offered_goes_on_to_the_pointer_as_one_step(open_editor: Any, caged: ControlPoints) -> None:
    space = open_editor(caged, support=25.0)
    space.editor.tissue = {}  # everywhere
    space.wait_settled()
    way = np.array([22.0, 6.0])
    by = tuple(way * space.scale(AXIAL))
    space.drag(AXIAL, caged.target[8], by)
    stopped = space.editor.points
    share = float(np.linalg.norm((stopped.target - caged.target)[8]) / np.linalg.norm(way))
    found = offers(space)
    words = message_text(space.page.page)
    assert f"Stopped before tissue folds, at {100 * share:.0f} % of the drag" in words
    assert set(found) == {"support", "stages", "points"}
    for name, text in found.items():
        space.page.page.locator(f"[data-action={name}]").click()
        space.wait_settled()
        after, settings = space.editor.points, space.editor.settings
        far = float((after.target[8] - caged.target[8])[:2] @ way / (way @ way))
        assert far == pytest.approx(float(text.split(":")[1].strip(" %")) / 100 if ":" in text else 1.0, abs=0.01)
        assert far > share + 0.04
        step = space.editor.step()
        assert (step.support, step.stages) == (settings.support, settings.stages)
        assert slice_folds(step.field(waves().grid), waves().grid).least > 0
        assert "Stopped" not in message_text(space.page.page)
        press(space, "Control+z")
        assert_same_places(space.editor.points, stopped)
        assert (space.editor.settings.stages, space.editor.settings.support) == (1, 25.0)
        press(space, "Control+z")
        assert_same_places(space.editor.points, caged)
        space.drag(AXIAL, caged.target[8], by)
        assert_same_places(space.editor.points, stopped)
        assert offers(space) == found
    space.page.page.get_by_label("Close this message").click()
    assert "Stopped" not in message_text(space.page.page)
    press(space, "Control+z")
    space.drag(AXIAL, caged.target[8], by)
    assert offers(space) == found
    press(space, "Control+z")
    assert "Stopped" not in message_text(space.page.page)
    assert_same_places(space.editor.points, caged)


def test_folds_in_air_stop_no_drag(open_editor: Any, caged: ControlPoints) -> None:
    space = open_editor(caged, support=25.0)
    space.editor.tissue = tissue_mask(Volume.from_array(np.zeros((8, 8, 8), np.uint8)))
    space.wait_settled()
    space.drag(AXIAL, caged.target[8], tuple(np.array([22.0, 6.0]) * space.scale(AXIAL)))
    assert least(space.editor.points) < 0
    assert "Stopped" not in message_text(space.page.page)


def test_a_map_of_more_than_the_points_is_left_to_python(open_editor: Any, caged: ControlPoints) -> None:
    part = RigidPart(HalfSpace((-100.0, 0.0, 0.0), (1.0, 0.0, 0.0)))
    space = open_editor(caged, support=25.0, options={"parts": (part,)})
    assert space.editor.tissue is None
    space.drag(AXIAL, caged.target[8], tuple(np.array([22.0, 6.0]) * space.scale(AXIAL)))
    assert space.editor.points.target[8][0] == pytest.approx(caged.target[8][0] + 22, abs=0.1)


# ---- what a page may say --------------------------------------------------------------------------------------------


def test_traits_of_the_hand_are_checked(caplog: pytest.LogCaptureFixture) -> None:
    editor = SpaceEditor(waves())
    for name, value in (
        ("mirror", {"on": True, "axis": "a", "at": 0}),
        ("mirror", 3),
        ("snap", -1),
        ("snap", "1"),
        ("stop_at_folds", 1),
    ):
        editor.set_state({name: value})
        assert f"the trait '{name}' from the page was dropped" in caplog.text
        caplog.clear()
    good = {"on": True, "axis": "z", "at": 7.5}
    editor.set_state({"mirror": good, "snap": 2.5})
    assert (editor.mirror, editor.snap) == (good, 2.5)
    with pytest.raises(Exception, match=r'axis "x" or "y" or "z"'):
        editor.mirror = {"on": True, "axis": "b", "at": None}
    editor.close()


# ---- what a frame draws ---------------------------------------------------------------------------------------------


def test_a_frame_paints_no_picture_and_no_point_that_is_there(open_editor: Any, pairs: ControlPoints) -> None:
    space = open_editor(pairs)
    space.wait_settled()
    drawn = space.js(f"""(() => {{
      const editor = {PAGE}, {{ points, row }} = editor.parts, pane = row.panes[0];
      const {{ handles }} = pane, update = handles.update.bind(handles);
      const context = pane.image.canvas.getContext("2d"), fill = context.fillRect.bind(context), flat = [];
      let painted = 0;
      context.fillRect = (...box) => {{ painted += 1; fill(...box); }};
      handles.update = (points, ...given) => {{ flat.push([...points]); return update(points, ...given); }};
      const counts = [], count = () => {{ editor.frames.drawNow(); counts.push(painted); }};
      count();
      points.list = points.list.map((p) => (p.id ? p : {{ ...p, target: p.target.map((x) => x + 1) }}));
      count();
      pane.viewport.zoomAt(1.5);
      count();
      return [counts, flat[1].filter((p) => flat[0].includes(p)).map((p) => p.id).sort()];
    }})()""")
    assert drawn == [[0, 0, 1], [1, 2, 3, 4]]

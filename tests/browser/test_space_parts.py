"""Rigid parts of a step in space: drawn in the slices, moved, turned and edited with the real mouse and keys."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE, wait_until
from browser.live_page import LivePage
from browser.test_space_editor_page import PAGE, Opened, waves
from browser.test_space_hand import AXIAL, CORONAL, MIDDLE, SAGITTAL, press
from browser.test_space_shapes import READY
from running_app import RunningApp

from deformnb.app.application import Application
from deformnb.datasets import PHANTOMS
from deformnb.document.deformation import Deformation, Step
from deformnb.document.script import as_python
from deformnb.document.step_checks import is_fold_free
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Mask
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.editor.space_slices import PANES, Pane
from deformnb.widgets.studio.step_diagnostics import tissue_of

pytestmark = pytest.mark.needs_browser

CENTER = np.array([MIDDLE, 38.0, 34.0])
RADII = np.array([9.0, 8.0, 10.0])
BONE = RigidPart(Mask.drawn("ellipsoid", CENTER, RADII, np.eye(3)), name="bone")
FRAME = ControlPoints.from_arrays([[x, y, z] for x in (-18, 33) for y in (12, 65) for z in (7, 62)])


@pytest.fixture
def open_editor(page: LivePage) -> Iterator[Callable[..., Opened]]:
    spaces: list[Opened] = []

    def make(*parts: RigidPart, points: ControlPoints = FRAME, **settings: Any) -> Opened:
        options = {"cursor": CENTER.tolist(), "show_grid": False, "options": {"parts": parts}, **settings}
        spaces.append(Opened(page, SpaceEditor(waves(), points, **options)))
        return spaces[-1]

    yield make
    for space in spaces:
        space.editor.close()
    assert page.errors == []


def choose(space: Opened, pane: int = AXIAL) -> None:
    """Choose the part by a click inside of it."""
    space.mouse.click(*space.to_screen(pane, CENTER - 0.4 * RADII))
    space.wait_settled()
    assert space.editor.chosen_shape == {"what": "parts", "index": 0}


def handle(space: Opened, name: str, pane: int) -> tuple[float, float]:
    """The place of a handle in a picture on the screen."""
    box = space.page.page.locator(f".dnb-sp-pane{pane} {name} .dnb-ed-hit").bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def motion_of(space: Opened) -> RigidMotion:
    (part,) = space.editor.parts
    assert part.motion is not None
    return part.motion


def assert_motion(found: RigidMotion, expected: RigidMotion, atol: float = 1e-6) -> None:
    places = CENTER + np.vstack([np.zeros(3), np.diag(RADII)])
    np.testing.assert_allclose(found(places), expected(places), atol=atol)


# ---- drawing ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["ellipsoid", "box"])
def test_a_part_is_dragged_open_in_one_slice_and_fitted_in_another(open_editor: Any, form: str) -> None:
    space = open_editor()
    page = space.page.page
    space.page.page.locator("[data-command=part]").click()
    page.locator("[aria-label='form of the rigid part']").select_option(form)
    x, y = space.to_screen(AXIAL, CENTER - np.array([8, 6, 0]))
    to = space.to_screen(AXIAL, CENTER + np.array([8, 6, 0]))
    space.drag(AXIAL, CENTER - np.array([8, 6, 0]), (to[0] - x, to[1] - y))
    k = space.scale(CORONAL)
    u, v = handle(space, "[data-draft=top]", CORONAL)
    space.mouse.move(u, v)
    space.mouse.down()
    space.mouse.move(u, v - 6 * k, steps=4)
    space.mouse.up()
    space.wait_settled()
    assert space.editor.parts == ()  # not yet
    page.get_by_role("button", name="Make rigid part").click()
    space.wait_settled()
    (part,) = space.editor.parts
    assert page.locator("[data-draft=top]").first.is_hidden()
    assert part.motion is None
    np.testing.assert_allclose(space.editor.chosen_shape["index"], 0)
    ends = [[8, 0, 0], [-8, 0, 0], [0, 6, 0], [0, -6, 0], [0, 0, -7], [0, 0, 13]]
    middle = [CENTER] * 4 + [CENTER] * 2 if form == "box" else [CENTER + np.array([0, 0, 3])] * 4 + [CENTER] * 2
    far = part.region.signed_distance(np.add(middle, ends))
    np.testing.assert_allclose(far, 0, atol=2.0 / space.scale(AXIAL) + 0.5)
    press(space, "Control+z")
    assert space.editor.parts == ()
    press(space, "Control+y")
    assert space.editor.parts == (part,)


def test_escape_puts_a_drawing_away_and_enter_makes_it(open_editor: Any) -> None:
    space = open_editor()
    space.page.page.locator(".dnb-sp-stage").first.focus()
    press(space, "p")
    space.drag(AXIAL, CENTER - np.array([8, 6, 0]), (60, 50))
    space.page.wait("!document.querySelector('[aria-label=\"Make rigid part\"]').disabled")
    press(space, "Escape")
    assert not space.js(f"{PAGE}.parts.shapes.pen.isOn")
    press(space, "p", "Enter")
    assert space.editor.parts == ()  # nothing is drawn
    space.drag(CORONAL, CENTER - np.array([8, 0, -6]), (60, 50))
    press(space, "Enter")
    assert len(space.editor.parts) == 1


# ---- motion ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("pane", [AXIAL, CORONAL, SAGITTAL])
def test_a_chosen_part_is_moved_by_its_inside_in_the_plane_of_the_slice(open_editor: Any, pane: int) -> None:
    space = open_editor(BONE)
    moves: list[Any] = []
    space.editor.on_edit(moves.append, details=True)
    space.drag(pane, CENTER + 0.4 * RADII, (14, -10))
    assert space.editor.parts == (BONE,)  # what is not chosen is not moved
    space.editor.cursor = CENTER.tolist()
    space.page.flush()
    space.wait_settled()
    choose(space, pane)
    space.editor.cursor = CENTER.tolist()
    space.page.flush()
    space.wait_settled()
    k, plane = space.scale(pane), Pane.of(waves().grid, list(PANES)[pane]).plane
    way = (14 * np.asarray(plane.u) - 10 * np.asarray(plane.v)) / k
    space.drag(pane, CENTER + 0.4 * RADII, (14, -10))
    assert_motion(motion_of(space), RigidMotion.turn(0, CENTER, way, (0, 0, 1)))
    assert moves[-1].phase == "move"
    (on_the_way,) = moves[-1].with_part((BONE,))
    share = np.linalg.norm(on_the_way.motion.shift) / np.linalg.norm(way)
    assert 0 < share <= 1 + 1e-9  # of movements that follow each other quickly Python gets the last
    np.testing.assert_allclose(space.editor.field().displacement(CENTER + way), -way, atol=1e-6)
    press(space, "Control+z")
    assert space.editor.parts == (BONE,)


def test_the_ring_turns_a_part_about_its_pivot_in_each_slice(open_editor: Any) -> None:
    space = open_editor(BONE)
    choose(space)
    knob, pivot = (np.array(handle(space, name, CORONAL)) for name in (".dnb-ed-part-knob", ".dnb-ed-pivot"))
    arm = knob - pivot
    space.mouse.move(*knob)
    space.mouse.down()
    space.page.page.keyboard.down("Shift")
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    to = pivot + turn @ arm
    space.mouse.move(*to, steps=5)
    space.mouse.up()
    space.page.page.keyboard.up("Shift")
    space.wait_settled()
    axis = Pane.of(waves().grid, list(PANES)[CORONAL]).plane.normal
    middle = np.argwhere(BONE.region.values).mean(axis=0)[::-1]
    about = BONE.region.lattice.index_to_point(middle)
    assert_motion(motion_of(space), RigidMotion.turn(30, about, axis=axis))  # steps of 15 degrees
    press(space, "Control+z")
    cross = handle(space, ".dnb-ed-pivot", AXIAL)
    k = space.scale(AXIAL)
    space.mouse.move(*cross)
    space.mouse.down()
    space.mouse.move(cross[0] + 20 * k, cross[1], steps=4)
    space.mouse.up()
    space.wait_settled()
    (part,) = space.editor.parts
    assert part.motion is None
    np.testing.assert_allclose(part.pivot, about + np.array([20, 0, 0]), atol=1e-6)
    press(space, ".")  # a joint outside of it: keys turn it there
    assert_motion(motion_of(space), RigidMotion.turn(1, part.pivot, axis=(0, 0, 1)))


def test_keys_move_turn_put_back_switch_off_and_delete_a_part(open_editor: Any) -> None:
    space = open_editor(BONE)
    choose(space)
    space.page.page.locator(".dnb-sp-pane0 [data-shape='parts:0']").focus()
    press(space, "ArrowRight", "Shift+ArrowDown")
    assert_motion(motion_of(space), RigidMotion.turn(0, CENTER, (1.0, 12.0, 0.0), (0, 0, 1)))
    press(space, "Home")
    assert space.editor.parts[0].motion is None
    press(space, "o")
    assert not space.editor.parts[0].enabled
    press(space, "o", "F2")
    space.page.page.keyboard.type("jaw")
    press(space, "Enter")
    assert space.editor.parts[0].name == "jaw"
    space.page.page.locator(".dnb-sp-pane0 [data-shape='parts:0']").focus()
    press(space, "Delete")
    assert space.editor.parts == ()
    press(space, "Control+z")
    assert space.editor.parts[0].name == "jaw"


def test_points_that_a_part_carries_follow_it_and_escape_gives_a_drag_up(open_editor: Any) -> None:
    inside = FRAME.add(CENTER + np.array([2, 1, 0]), CENTER + np.array([2, 1, 0]))
    space = open_editor(BONE, points=inside)
    choose(space)
    start = space.to_screen(AXIAL, CENTER - 0.4 * RADII)
    space.mouse.move(*start)
    space.mouse.down()
    space.mouse.move(start[0] + 20, start[1], steps=4)
    by = [20 / space.scale(AXIAL), 0, 0]
    shown = space.js(f"{PAGE}.parts.points.list.at(-1).target")
    np.testing.assert_allclose(shown, inside.target[-1] + by, atol=1e-6)
    press(space, "Escape")
    space.mouse.up()
    space.wait_settled()
    assert (space.editor.parts, space.editor.points) == ((BONE,), inside)
    space.drag(AXIAL, CENTER - 0.4 * RADII, (20, 0))
    np.testing.assert_allclose(space.editor.points.target[-1], inside.target[-1] + by, atol=1e-6)


def test_a_fixed_side_is_hatched_on_its_side_and_a_slice_without_the_part_shows_nothing(open_editor: Any) -> None:
    ground = RigidPart(HalfSpace((0.0, 0.0, 20.0), (0.0, 0.0, 1.0)), name="ground")
    space = open_editor(BONE, ground)
    shapes = space.page.page.locator(".dnb-sp-pane1 .dnb-ed-part")
    assert [shapes.nth(k).get_attribute("visibility") for k in range(2)] == ["visible", "visible"]
    inside = space.to_screen(CORONAL, [MIDDLE, 38.0, 12.0])
    found = space.page.page.evaluate(
        "([x, y]) => document.elementsFromPoint(x, y).map((e) => e.closest('[data-shape]')?.dataset.shape)", inside
    )
    assert "parts:1" in found
    space.editor.cursor = [MIDDLE, 38.0, 60.0]
    space.page.flush()
    space.wait_settled()
    space.page.wait(
        "document.querySelector(\".dnb-sp-pane0 [data-shape='parts:0']\").getAttribute('visibility') === 'hidden'"
    )


# ---- in the studio ---------------------------------------------------------------------------------------------------


@pytest.fixture
def running() -> Iterator[RunningApp]:
    volume = PHANTOMS["head"].make((32, 32, 32))
    middle, side = np.asarray(volume.grid.center), np.asarray(volume.grid.spacing) * 10
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    region = Mask.drawn("ellipsoid", middle, side / 2, np.eye(3))
    step = Step((ControlPoints.from_arrays(middle + side * signs),), None, trend="none", parts=(RigidPart(region),))
    with RunningApp(Application(volume, Deformation((step,)))) as found:
        yield found


def test_a_part_stops_before_tissue_folds_and_the_document_keeps_it(browser: Any, running: RunningApp) -> None:
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.goto(running.server.url)
    page.wait_for_function(READY, timeout=PATIENCE)
    session, space = running.session, running.application.studio.editor
    large = space.large_slice
    stage = page.locator(".dnb-sp-stage").nth(large)
    box, view = stage.bounding_box(), page.evaluate(f"() => {PAGE}.parts.row.panes[{large}].viewport.view")
    a, b, _ = Pane.of(session.volume.grid, list(PANES)[large]).plane.to_plane(session.volume.grid.center)
    x, y = box["x"] + view["k"] * a + view["x"] + 9, box["y"] + view["k"] * b + view["y"] + 9
    page.mouse.click(x, y)
    wait_until(lambda: space.chosen_shape == {"what": "parts", "index": 0})
    page.wait_for_selector(".dnb-sp-loop-chosen", state="attached", timeout=PATIENCE)  # over the volume too
    (before,) = session.editing.step.parts
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 70, y, steps=6)
    page.mouse.up()
    wait_until(lambda: session.editing.step.parts != (before,))
    (part,) = session.editing.step.parts
    assert part.motion is not None
    assert 0 < np.linalg.norm(part.motion.shift) < 70 / view["k"]  # stopped on the way
    assert is_fold_free(session.editing.step, session.editing.grid, is_tissue=tissue_of(session))
    assert session.editing.history["undo"] == "move rigid part"
    wait_until(lambda: space.parts == (part,))
    page.wait_for_function(
        f"() => Math.abs({PAGE}.parts.shapes.parts[0].motion.shift[1]) < 1e9 && !{PAGE}.sender.isBehind()"
    )
    namespace: dict[str, Any] = {"volume": session.volume}
    exec(as_python(session.editing.deformation, session.editing.grid, volume="volume"), namespace)
    (again,) = namespace["deformation"].steps[0].parts
    assert (again.region, again.motion) == (part.region, part.motion)
    page.get_by_role("button", name="Undo", exact=False).first.click()
    wait_until(lambda: session.editing.step.parts == (before,))
    page.close()


def test_the_panel_and_the_slices_choose_the_same_part(browser: Any, running: RunningApp) -> None:
    session, space = running.session, running.application.studio.editor
    (part,) = session.editing.step.parts
    session.editing.edit_parts(
        [
            replace(part, name="skull"),
            RigidPart(HalfSpace(tuple(session.volume.grid.center), (0.0, 0.0, 1.0)), name="below"),
        ]
    )
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.goto(running.server.url)
    page.wait_for_function(READY, timeout=PATIENCE)
    page.get_by_text("Rigid parts and cuts", exact=True).click()
    page.get_by_text("below", exact=True).first.click()
    wait_until(lambda: space.chosen_shape == {"what": "parts", "index": 1})
    page.close()

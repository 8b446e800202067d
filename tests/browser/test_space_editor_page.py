"""The editor in space on a page, with the real mouse and keyboard; its Python is in this process."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage

from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.transfer import preset
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.editor.space_slices import PANES, Pane, SpacePictures, slice_folds

pytestmark = pytest.mark.needs_browser

PAGE = "document.querySelector('.dnb-space').deformnb"


def waves() -> Volume:
    """Smooth and without symmetry, in voxels that are no cubes."""
    z, y, x = np.mgrid[:40, :48, :56]
    values = 110 + 60 * np.sin(x / 6) + 40 * np.cos(y / 5 + x / 9) + 45 * np.sin(z / 6 + 1)
    return Volume(values.astype(np.float32), Grid((40, 48, 56), (1.0, 1.2, 1.5), (-20.0, 10.0, 5.0)), "waves")


class Opened:
    """An editor in space on a page."""

    def __init__(self, page: LivePage, editor: SpaceEditor) -> None:
        self.page, self.editor = page, editor
        page.add(editor, "editor")
        page.wait(f"{PAGE}.parts.requests.shownCount > 0")
        self.mouse = page.page.mouse

    def js(self, expression: str) -> Any:
        return self.page.page.evaluate(f"() => {expression}")

    def to_screen(self, pane: int, place: Any) -> tuple[float, float]:
        """CSS pixels of the window where a place in space is in one of the pictures."""
        v = self.js(f"{PAGE}.parts.row.panes[{pane}].viewport.view")
        box = self.page.page.locator(".dnb-sp-stage").nth(pane).bounding_box()
        a, b, _ = Pane.of(self.editor.volume.grid, list(PANES)[pane]).plane.to_plane(place)
        return box["x"] + v["k"] * a + v["x"], box["y"] + v["k"] * b + v["y"]

    def drag(self, pane: int, place: Any, by: tuple[float, float], steps: int = 5) -> None:
        x, y = self.to_screen(pane, place)
        self.mouse.move(x, y)
        self.mouse.down()
        self.mouse.move(x + by[0], y + by[1], steps=steps)
        self.mouse.up()
        self.wait_settled()

    def wait_settled(self) -> None:
        self.page.wait(f"!{PAGE}.sender.isBehind() && !{PAGE}.frames.request && !{PAGE}.parts.requests.pending")
        self.page.wait(f"!{PAGE}.frames.request")

    def picture(self, pane: int) -> np.ndarray:
        """Grey values of one of the pictures, as they came from Python."""
        width, *values = self.js(
            f"(() => {{ const c = {PAGE}.parts.row.panes[{pane}].image.picture, "
            "read = new OffscreenCanvas(c.width, c.height).getContext('2d', { willReadFrequently: true }); "
            "read.drawImage(c, 0, 0); "  # Chromium warns of a canvas that is read again and again
            "const all = read.getImageData(0, 0, c.width, c.height).data; "
            "return [c.width, ...all.filter((_, k) => k % 4 === 0)]; })()"
        )
        return np.array(values).reshape(-1, width)

    def shows(self, pane: int, expected: np.ndarray, timeout: float = 30.0) -> bool:
        """Check whether the picture becomes this one within the timeout, to a grey level of rounding."""
        for _ in range(int(timeout / 0.05)):
            self.page.flush()
            seen = self.picture(pane)
            if seen.shape == expected.shape and np.abs(seen - expected).max() <= 1:
                return True
            self.page.page.wait_for_timeout(50)
        return False

    def scale(self, pane: int) -> float:
        return float(self.js(f"{PAGE}.parts.row.panes[{pane}].viewport.view.k"))


@pytest.fixture
def open_editor(page: LivePage) -> Iterator[Callable[..., Opened]]:
    made: list[SpaceEditor] = []

    def make(points: ControlPoints | None = None, **options: Any) -> Opened:
        made.append(SpaceEditor(waves(), points, **options))
        return Opened(page, made[-1])

    yield make
    assert page.errors == []
    for editor in made:
        editor.close()


def four(editor_points: int = 4) -> ControlPoints:
    center = np.asarray(waves().grid.center)
    source = center + np.array([[0, 0, 0], [14, 6, -8], [-12, -10, 9], [5, 14, 14]])[:editor_points]
    return ControlPoints.from_arrays(source, names=["middle", "", "", ""][:editor_points])


@pytest.mark.parametrize("pane", range(3))
def test_a_double_click_adds_a_point_on_the_slice(open_editor: Callable[..., Opened], pane: int) -> None:
    here = open_editor()
    place = np.asarray(waves().grid.center) + np.array([6.0, -5.0, 4.0])
    axis = int(np.abs(Pane.of(waves().grid, list(PANES)[pane]).plane.normal).argmax())
    x, y = here.to_screen(pane, place)
    here.mouse.dblclick(x, y)
    here.wait_settled()
    (target,) = here.editor.points.target
    expected = place.copy()
    expected[axis] = waves().grid.center[axis]
    np.testing.assert_allclose(target, expected, atol=1.01 / here.scale(pane))
    assert target[axis] == pytest.approx(waves().grid.center[axis], abs=1e-9)
    np.testing.assert_array_equal(here.editor.points.source[0], target)
    np.testing.assert_allclose(here.editor.cursor, expected, atol=1.01 / here.scale(pane))  # so the others show it too
    assert here.page.page.locator(".dnb-ed-target").count() == 3


def test_without_points_to_edit_it_is_a_viewer_of_linked_slices(open_editor: Callable[..., Opened]) -> None:
    here = open_editor(read_only=True, before=fit_rbf(four().move(0, [12.0, 40.0, 30.0])))
    assert not here.page.page.locator(".dnb-ed-bar").is_visible()
    center = np.asarray(waves().grid.center)
    here.drag(0, center, (24, -12))
    here.page.flush()
    wanted = center + np.array([24, -12, 0]) / here.scale(0)
    np.testing.assert_allclose(here.editor.cursor, wanted, atol=1.01 / here.scale(0))
    made = SpacePictures(waves(), preset("specimen", waves()))
    assert here.shows(1, made.slice(1, here.editor.before, here.editor.cursor, 512).values)
    assert len(here.editor.points) == 0
    here.editor.fill = True  # as large as the box around it
    here.page.wait("document.querySelector('.dnb-sp-row').style.gridTemplateColumns !== ''")


@pytest.mark.sampled(2)
@pytest.mark.parametrize("pane", range(3))
def test_a_drag_moves_two_coordinates_and_the_other_pictures_follow(
    open_editor: Callable[..., Opened], pane: int
) -> None:
    here = open_editor(four())
    before, plane = here.editor.points, Pane.of(waves().grid, list(PANES)[pane]).plane
    k = here.scale(pane)
    here.drag(pane, before.target[0], (30, -18))
    moved = here.editor.points.target[0]
    expected = before.target[0] + (30 * np.array(plane.u) - 18 * np.array(plane.v)) / k
    np.testing.assert_allclose(moved, expected, atol=1.01 / k)
    axis = int(np.abs(plane.normal).argmax())
    assert moved[axis] == before.target[0][axis]
    np.testing.assert_array_equal(here.editor.points.source, before.source)
    for other in range(3):
        box = here.page.page.locator(f".dnb-sp-pane{other} [data-id='0'] .dnb-ed-hit").bounding_box()
        middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        np.testing.assert_allclose(middle, here.to_screen(other, moved), atol=1.0)


def test_all_pictures_show_what_the_core_makes_of_it(open_editor: Callable[..., Opened]) -> None:
    here = open_editor(four())
    here.drag(0, here.editor.points.target[0], (40, 10))
    made = SpacePictures(waves(), preset("specimen", waves()))
    for pane in range(3):
        still = made.slice(pane, None, here.editor.cursor, 512).values.astype(int)
        moved = made.slice(pane, fit_rbf(here.editor.points), here.editor.cursor, 512).values.astype(int)
        assert np.abs(moved - still).max() > 20
        assert here.shows(pane, moved)


def test_a_line_of_the_cross_hair_drags_one_slice(open_editor: Callable[..., Opened]) -> None:
    here = open_editor(four())
    x0, y0, z0 = here.editor.cursor
    x, y = here.to_screen(0, (x0, y0 - 20, z0))
    here.mouse.move(x, y)
    here.mouse.down()
    here.mouse.move(x + 40, y + 25, steps=5)
    here.mouse.up()
    here.wait_settled()
    np.testing.assert_allclose(here.editor.cursor, [x0 + 40 / here.scale(0), y0, z0], atol=1.01 / here.scale(0))


def test_the_wheel_and_keys_go_through_slices(open_editor: Callable[..., Opened]) -> None:
    here = open_editor(four())
    z0 = here.editor.cursor[2]
    here.page.page.locator(".dnb-sp-stage").nth(0).focus()
    here.page.page.keyboard.press("PageDown")
    here.wait_settled()
    assert here.editor.cursor[2] == pytest.approx(z0 + 1.5, abs=0.76)  # to the middle of the next slice
    z1 = here.editor.cursor[2]
    x, y = here.to_screen(0, here.editor.cursor)
    here.mouse.move(x + 30, y + 30)
    here.mouse.wheel(0, -100)
    here.wait_settled()
    assert here.editor.cursor[2] == pytest.approx(z1 - 1.5)


def test_keys_move_points_and_undo(open_editor: Callable[..., Opened]) -> None:
    here = open_editor(four())
    before = here.editor.points
    here.page.page.evaluate("Date.now = () => 0")  # all that follows is done in quick succession
    here.page.page.locator(".dnb-sp-pane1 [data-id='1']").focus()
    here.page.page.keyboard.press("ArrowRight")  # in the coronal picture: to the left of the patient
    here.page.page.keyboard.press("ArrowUp")
    here.wait_settled()
    np.testing.assert_allclose(here.editor.points.target[1], before.target[1] + [1.0, 0, 1.5], atol=1e-9)
    here.page.page.keyboard.press("Alt+PageDown")
    here.wait_settled()
    np.testing.assert_allclose(here.editor.points.target[1], before.target[1] + [1.0, 1.2, 1.5], atol=1e-9)
    here.page.page.keyboard.press("Control+z")
    here.wait_settled()
    assert here.editor.points == before  # keys in quick succession are one step
    here.page.page.keyboard.press("Delete")
    here.wait_settled()
    assert here.editor.points.ids == (0, 2, 3)


def test_a_point_off_the_slice_is_fainter_and_j_brings_the_slices_to_it(open_editor: Callable[..., Opened]) -> None:
    here = open_editor(four())
    far = here.page.page.locator(".dnb-sp-pane0 [data-id='1']")
    assert "dnb-sp-far" in far.get_attribute("class")
    assert float(far.evaluate("(node) => getComputedStyle(node).opacity")) < 0.9
    assert "\u22128" in far.text_content()  # its distance
    far.focus()
    here.page.page.keyboard.press("j")
    here.wait_settled()
    np.testing.assert_allclose(here.editor.cursor, here.editor.points.target[1])
    assert "dnb-sp-far" not in far.get_attribute("class")


def test_in_a_maximum_projection_a_point_lands_on_the_brightest_voxel(page: LivePage) -> None:
    values = np.zeros((30, 32, 34), np.uint8)
    values[21, 9, 12] = 255
    editor = SpaceEditor(Volume(values, Grid((30, 32, 34), (1.0, 1.2, 1.5))), projection="mip")
    here, place = Opened(page, editor), np.array([12.0, 9 * 1.2, 21 * 1.5])
    here.mouse.dblclick(*here.to_screen(1, place))
    here.wait_settled()
    np.testing.assert_allclose(editor.points.target[0], place, atol=0.6)
    assert page.errors == []
    editor.close()


def test_while_python_is_waiting_nothing_is_edited(open_editor: Callable[..., Opened]) -> None:
    here = open_editor(four())
    before = here.editor.points
    here.editor.waiting = "Warping the volume"
    here.drag(0, before.target[0], (30, 0))
    assert here.editor.points == before
    assert here.page.page.get_by_text("Warping the volume").is_visible()
    here.editor.waiting = ""
    here.drag(0, before.target[0], (30, 0))
    assert here.editor.points != before


def test_escape_gives_a_drag_up(open_editor: Callable[..., Opened]) -> None:
    here = open_editor(four())
    before, phases = here.editor.points, []
    here.editor.on_edit(lambda points, phase: phases.append((phase, points)))
    x, y = here.to_screen(2, before.target[0])
    here.mouse.move(x, y)
    here.mouse.down()
    here.mouse.move(x + 30, y, steps=4)
    here.page.wait(f"{PAGE}.sender.channel.waiting.move.size === 0")
    here.page.page.keyboard.press("Escape")
    here.mouse.up()
    here.wait_settled()
    assert here.editor.points == before
    assert phases[-1] == ("move", before)
    assert {phase for phase, _ in phases} == {"move"}


def test_where_points_overlap_the_one_on_the_slice_is_grabbed(open_editor: Callable[..., Opened]) -> None:
    center = np.asarray(waves().grid.center)
    source = center + np.array([[0, 0, 0], [1.5, 0, 12], [0, 1.5, -12], [-14, 9, 5]])
    here = open_editor(ControlPoints.from_arrays(source))
    here.drag(0, center, (25, 0))
    moved = here.editor.points.displacement
    assert np.flatnonzero(np.abs(moved).max(axis=1)).tolist() == [0]


@pytest.mark.nightly
def test_many_points_off_the_slice_keep_their_distances_to_themselves(open_editor: Callable[..., Opened]) -> None:
    center = np.asarray(waves().grid.center)
    source = center + np.random.default_rng(1).uniform(-15, 15, (16, 3))
    here = open_editor(ControlPoints.from_arrays(source))
    label = here.page.page.locator(".dnb-sp-pane0 .dnb-sp-far[data-id] .dnb-ed-name").first
    assert not label.is_visible()
    here.page.page.locator(".dnb-sp-pane0 .dnb-sp-far[data-id]").first.focus()
    here.page.page.keyboard.press("Enter")
    here.page.wait(f"{PAGE}.parts.points.selected.size === 1 && !{PAGE}.frames.request")
    assert here.page.page.locator(".dnb-sp-pane0 .dnb-ed-selected .dnb-ed-name").is_visible()


def test_a_ring_marks_the_worst_fold_in_all_pictures(open_editor: Callable[..., Opened]) -> None:
    editor = open_editor(four(), trend="translation")
    volume, points = editor.editor.volume, editor.editor.points
    rings = "[...document.querySelectorAll('.dnb-ed-worst')].map((g) => g.getAttribute('visibility'))"
    assert editor.js(rings) == ["hidden"] * 3
    target = points.target.copy()
    target[0] += [18.0, 7.0, -9.0]  # past its neighbour
    editor.editor.points = ControlPoints.from_arrays(points.source, target)
    editor.page.wait(f"({PAGE}.parts.status.facts.folds ?? [1])[0] <= 0")
    editor.wait_settled()
    assert editor.js(rings) == ["visible"] * 3
    found = slice_folds(fit_rbf(editor.editor.points, trend="translation"), volume.grid)
    for pane in range(3):
        box = editor.page.page.locator(".dnb-ed-worst-ring").nth(pane).bounding_box()
        middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        assert middle == pytest.approx(editor.to_screen(pane, found.place), abs=1.0)
    editor.editor.points = points.reset()
    editor.page.wait(f"{PAGE}.parts.status.facts.folds[0] > 0")
    editor.wait_settled()
    assert editor.js(rings) == ["hidden"] * 3


def test_a_title_makes_its_slice_large_and_a_right_drag_changes_the_window(open_editor: Callable[..., Opened]) -> None:
    editor = open_editor()

    def areas() -> list[float]:
        boxes = [editor.page.page.locator(".dnb-sp-stage").nth(k).bounding_box() for k in range(3)]
        return [box["width"] * box["height"] for box in boxes]

    editor.page.page.get_by_role("button", name="coronal").click()
    editor.page.wait(f"{PAGE}.model.get('large_slice') === 1")
    editor.wait_settled()
    assert editor.editor.large_slice == 1
    others = areas()
    assert others.pop(1) > 3 * max(others)
    low, high = editor.js(f"{PAGE}.parts.status.facts.window")
    x, y = editor.to_screen(1, editor.editor.cursor)
    editor.mouse.move(x + 20, y + 20)
    editor.mouse.down(button="right")
    editor.mouse.move(x + 80, y + 20, steps=4)
    editor.mouse.up(button="right")
    editor.page.wait(f"!{PAGE}.parts.requests.pending && {PAGE}.parts.status.facts.window[1] > {high}")
    window = editor.editor.window
    assert window[1] - window[0] == pytest.approx((high - low) * np.exp(60 / 150), rel=0.02)  # as on a picture
    assert sum(window) == pytest.approx(low + high, abs=0.02 * (high - low))
    editor.page.page.keyboard.press("w")
    editor.page.wait(f"Math.abs({PAGE}.parts.status.facts.window[1] - {high}) < 1e-9")
    assert editor.editor.window == []
    editor.page.page.get_by_role("button", name="coronal").click()
    editor.page.wait(f"{PAGE}.model.get('large_slice') === -1")
    editor.wait_settled()
    assert max(areas()) < 1.2 * min(areas())

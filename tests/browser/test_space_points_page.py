"""Points in space over the views, with the real mouse; the Python of all widgets is in this process."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage
from browser.pane_messages import message_script, message_text

from deformnb.imaging.picking import surface_point
from deformnb.imaging.projection import project
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.view.volume_view import VolumeView

pytestmark = pytest.mark.needs_browser

SIZE, CENTER = (360, 300), np.array([30.0, 26.0, 40.0])
CAMERA = "JSON.stringify(document.querySelector('.dnb-view').deformnb.camera.trait)"
POINTS = "document.querySelector('.dnb-view').deformnb.spacePoints"


def ball() -> Volume:
    """A ball of radius 14 away from the middle of the volume, with an edge that is no voxel wide."""
    grid = Grid((44, 50, 56), (1.0, 1.0, 1.5), (2.0, 1.0, 5.0))
    z, y, x = np.indices(grid.shape)
    far = np.linalg.norm(grid.index_to_point(np.stack([x, y, z], axis=-1)) - CENTER, axis=-1)
    return Volume(np.clip(250 - 60 * (far - 14), 0, 250).astype(np.uint8), grid, "ball")


class Shown:
    """A view with the points of an editor that is not drawn."""

    def __init__(self, page: LivePage, points: ControlPoints | None = None) -> None:
        self.page, self.volume = page, ball()
        self.editor = SpaceEditor(self.volume, points, trend="none", support=40.0)
        self.view = LiveView(self.volume, transfer="surface", width=SIZE[0], height=SIZE[1], background="dark")
        self.view.ambient_occlusion = False  # what is lit is measured
        self.view.set_camera((0, 1, 0))
        page.add(self.editor, "editor", draw=False)
        page.add(self.view)
        self.view.edit_points(self.editor)
        page.wait_loaded()
        page.wait(f"{POINTS}.points.isFollowing && {POINTS}.camera")
        self.mouse = page.page.mouse

    def to_screen(self, place: Any) -> tuple[float, float]:
        x, y = self.page.page.evaluate(f"(p) => {POINTS}.camera.see(p).at", [float(v) for v in place])
        box = self.page.page.locator(".dnb-canvas").first.bounding_box()
        return box["x"] + x, box["y"] + y

    def scale(self, place: Any) -> float:
        """A length in space for one pixel."""
        return float(self.page.page.evaluate(f"(p) => {POINTS}.camera.see(p).scale", [float(v) for v in place]))

    def drag(self, place: Any, by: tuple[float, float], key: str = "") -> None:
        x, y = self.to_screen(place)
        self.mouse.move(x, y)
        self.mouse.down()
        self.mouse.move(x + by[0] / 2, y + by[1] / 2, steps=3)
        if key:
            self.page.page.keyboard.press(key)
        self.mouse.move(x + by[0], y + by[1], steps=3)
        self.mouse.up()
        self.wait_settled()

    def wait_settled(self) -> None:
        self.page.wait(f"!{POINTS}.points.edited.sender.isBehind()")


@pytest.fixture
def show_points(page: LivePage) -> Iterator[Any]:
    made: list[Shown] = []

    def show(points: ControlPoints | None = None) -> Shown:
        made.append(Shown(page, points))
        return made[-1]

    yield show
    assert page.errors == []
    for each in made:
        each.view.edit_points(None)
        each.editor.close()


def one() -> ControlPoints:
    return ControlPoints.from_arrays([CENTER])


def lit(image: np.ndarray) -> np.ndarray:
    return np.asarray(image.max(axis=2) > 64)


def middle(image: np.ndarray) -> np.ndarray:
    """Column and row in the middle of what is lit."""
    return np.array([places.mean() for places in np.nonzero(lit(image))[::-1]])


@pytest.mark.sampled(3)
@pytest.mark.parametrize(("direction", "perspective"), [((0, 1, 0), False), ((1, 0.4, -0.3), True), ((0, 0, -1), True)])
def test_a_point_is_drawn_where_the_body_is_seen(
    show_points: Any, page: LivePage, direction: Any, perspective: bool
) -> None:
    here = show_points(one())
    here.view.set_camera(direction, perspective=perspective)
    at = middle(page.pixels())
    np.testing.assert_allclose(at, here.to_screen(CENTER), atol=1.5)
    box = page.page.locator(".dnb-sp-over [data-id='0'] .dnb-ed-disc").bounding_box()
    np.testing.assert_allclose(at, (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2), atol=1.5)


def test_points_are_drawn_once_in_a_frame_and_only_those_that_have_moved(show_points: Any, page: LivePage) -> None:
    here = show_points(ControlPoints.from_arrays([CENTER, CENTER + 8.0]))
    page.wait(f"{POINTS}.marks.handles.byId.size === 2")
    drawn = page.page.evaluate(f"""async () => {{
      const shown = {POINTS}, {{ handles }} = shown.marks, update = handles.update.bind(handles), drawn = [];
      handles.update = (flat, ...given) => {{ drawn.push(flat); return update(flat, ...given); }};
      const frame = () => new Promise((done) => {{ requestAnimationFrame(done); }});
      for (let k = 0; k < 5; k++) shown.view.touch();
      const early = drawn.length;
      await frame();
      const [before] = drawn.splice(0);
      shown.points.list = shown.points.list.map((p) => (p.id ? p : {{ ...p, target: p.target.map((x) => x + 3) }}));
      shown.draw();
      shown.draw();
      await frame();
      return [early, drawn.length, drawn[0].filter((p) => before.includes(p)).map((p) => p.id)];
    }}""")
    assert drawn == [0, 1, [1]]
    here.view.set_camera((1, 0, 0))
    page.wait(f"Math.abs({POINTS}.camera.ahead[0]) === 1")
    page.wait(f"{POINTS}.marks.seen === JSON.stringify({POINTS}.camera)")  # of another camera all are


def test_the_body_follows_a_drag_without_a_field_from_python(show_points: Any, page: LivePage) -> None:
    here = show_points(one())
    view = "document.querySelector('.dnb-view').deformnb"
    page.wait(f"{view}.shownField.spaceLink.given")
    page.wait("models.view.sent.some((m) => m.type === 'follows')")
    page.wait_answered()
    before, messages = middle(page.pixels()), here.view.stats()["messages"]
    x, y = here.to_screen(CENTER)
    here.mouse.move(x, y)
    here.mouse.down()
    here.mouse.move(x + 30, y - 18, steps=3)
    page.wait(f"{view}.shownField.spaceLink.count > 0 && {view}.shownField.spaceLink.awaited === null")
    page.wait_answered()
    assert here.view.stats()["messages"] == messages
    nodes = page.page.evaluate(f"[...{view}.caster.fields.space.shape]")
    assert max(nodes) == 32
    here.mouse.up()
    here.wait_settled()
    page.wait(f"Math.max(...{view}.field.space.shape) === 64")  # Python's, of the same points
    assert (middle(page.pixels()) - before)[0] > 6


def test_a_drag_moves_a_point_parallel_to_the_screen_and_the_body_with_it(show_points: Any, page: LivePage) -> None:
    here = show_points(one())
    before, scale = middle(page.pixels()), here.scale(CENTER)
    phases: list[str] = []
    here.editor.on_edit(lambda points, phase: phases.append(phase))
    here.drag(CENTER, (30, -18))
    target = here.editor.points.target[0]
    np.testing.assert_allclose(target, CENTER + np.array([30, 0, 18]) * scale, atol=1.01 * scale)  # seen along +y
    assert target[1] == pytest.approx(CENTER[1], abs=1e-9)
    assert phases[-1] == "end"
    assert "move" in phases
    page.wait("document.querySelector('.dnb-view').deformnb.field.space?.shape[2] === 64")
    live, still = page.pixels(), here.view.still(SIZE)
    assert (middle(live) - before)[0] > 6  # to the right, and up
    assert (middle(live) - before)[1] < -3
    np.testing.assert_allclose(middle(live), middle(still), atol=1.0)  # as the core draws it
    assert 2 * (lit(live) & lit(still)).sum() / (lit(live).sum() + lit(still).sum()) > 0.965


@pytest.mark.sampled(2)
@pytest.mark.parametrize("key", ["x", "z"])
def test_a_key_locks_an_axis(show_points: Any, key: str) -> None:
    here = show_points(one())
    here.drag(CENTER, (30, -20), key)
    moved = here.editor.points.target[0] - CENTER
    scale, k = here.scale(CENTER), "xyz".index(key)
    np.testing.assert_allclose(moved[k], (30 if key == "x" else 20) * scale, atol=1.01 * scale)
    assert np.abs(np.delete(moved, k)).max() == 0


def test_a_double_click_puts_a_point_on_the_front_of_the_body(show_points: Any, page: LivePage) -> None:
    here = show_points()
    x, y = here.to_screen(CENTER)
    here.mouse.dblclick(x + 8, y - 6)
    here.wait_settled()
    (target,) = here.editor.points.target
    assert np.linalg.norm(target - CENTER) == pytest.approx(15, abs=2.0)  # on the skin of the ball
    assert target[1] < CENTER[1] - 8  # on the side of the viewer
    np.testing.assert_allclose(here.to_screen(target), (x + 8, y - 6), atol=1.0)
    np.testing.assert_array_equal(here.editor.points.source[0], target)
    before, camera = here.editor.points, page.page.evaluate(CAMERA)
    here.mouse.dblclick(12, 12)  # beside the body
    page.wait(message_script())
    assert "Nothing is seen there" in message_text(page.page)
    here.wait_settled()
    assert here.editor.points == before
    assert page.page.evaluate(CAMERA) == camera  # a double click never turns it


@pytest.mark.parametrize("projection", ["shaded", "mip"])
@pytest.mark.parametrize(("direction", "perspective"), [((0, 1, 0), False), ((1, 0.4, -0.3), True)])
def test_the_surface_is_the_one_that_python_finds(
    show_points: Any, page: LivePage, projection: str, direction: Any, perspective: bool
) -> None:
    by = np.array([5.0, 0, 4])
    here = show_points(ControlPoints.from_arrays([CENTER], [CENTER + by]))
    here.view.projection = projection
    here.view.set_clip(x=(0.0, 0.7))
    here.view.set_camera(direction, perspective=perspective)
    page.wait("Math.max(...document.querySelector('.dnb-view').deformnb.field.space.shape) === 64")
    page.wait(f"document.querySelector('.dnb-view').deformnb.caster.projection === '{projection}'")
    page.wait("document.querySelector('.dnb-view').deformnb.caster.clip !== null")
    middle_at = page.page.evaluate(f"(p) => {POINTS}.camera.see(p).at", [float(v) for v in CENTER + by])
    met = 0
    for dx, dy in [(0, 0), (22, -14), (-30, 18), (4, 35), (-160, -120)]:
        ray, found = page.page.evaluate(
            f"""(at) => {{ const shown = {POINTS}, ray = shown.camera.ray(at);
            return [[ray.start, ray.ray], shown.body.surface(ray)]; }}""",
            [middle_at[0] + dx, middle_at[1] + dy],
        )
        wanted = surface_point(
            here.volume,
            ray,
            "surface",
            field=here.editor.field(),
            method=projection,
            clip=here.view.clip,
        )
        assert (found is None) == (wanted is None)
        if wanted is not None:
            met += 1
            np.testing.assert_allclose(found, wanted, atol=0.8)  # a voxel is 1 x 1 x 1.5
    assert met >= 3


def test_points_go_over_the_surface_along_axes_and_along_the_ray(show_points: Any, page: LivePage) -> None:
    here = show_points()
    x, y = here.to_screen(CENTER)
    here.mouse.dblclick(x + 6, y - 6)
    here.wait_settled()
    page.page.get_by_role("button", name="Along surface").click()
    start = here.editor.points.target[0]
    here.drag(start, (24, 18))
    target = here.editor.points.target[0]
    np.testing.assert_allclose(here.to_screen(target), np.add(here.to_screen(start), (24, 18)), atol=1.0)
    assert np.linalg.norm(target - CENTER) == pytest.approx(np.linalg.norm(start - CENTER), abs=1.0)  # on the skin
    arrow = page.page.locator(".dnb-sp-arrows[data-axis=z]")
    assert arrow.get_attribute("visibility") == "visible"
    assert page.page.locator(".dnb-sp-arrows[data-axis=y]").get_attribute("visibility") == "hidden"  # from its end
    left, top = here.to_screen(target)
    here.mouse.move(left, top - 30)
    here.mouse.down()
    here.mouse.move(left + 25, top - 50, steps=4)
    here.mouse.up()
    here.wait_settled()
    moved = here.editor.points.target[0] - target
    np.testing.assert_allclose(moved, [0, 0, 20 * here.scale(target)], atol=1.01 * here.scale(target))
    before = here.editor.points.target[0]
    here.mouse.move(*here.to_screen(before))
    here.mouse.wheel(0, -100)
    page.wait(f"{POINTS}.points.before !== null")
    page.wait(f"{POINTS}.points.before === null")  # an edit, when the wheel rests
    here.wait_settled()
    away = here.editor.points.target[0] - before
    assert away[1] > 0.9  # seen along +y: away from the viewer
    np.testing.assert_allclose(away[[0, 2]], 0, atol=1e-9)
    page.page.keyboard.press("Control+z")
    here.wait_settled()
    np.testing.assert_allclose(here.editor.points.target[0], before)


@pytest.mark.parametrize("view", ["live", "served"])
def test_a_double_click_puts_a_point_of_a_picture_on_the_volume(page: LivePage, view: str) -> None:
    volume = ball()
    picture = project(volume, "+y", "mip")
    editor = Editor(picture, None, trend="none", support=40.0)
    looks = {"width": SIZE[0], "height": SIZE[1], "transfer": "surface"}
    shown = LiveView(volume, **looks) if view == "live" else VolumeView(volume, method="core", **looks)
    shown.set_camera((0.6, 0.8, 0))
    page.add(editor, "editor")
    page.add(shown)
    shown.picture_editor = editor
    page.wait(f"{POINTS}.points.isFollowing && {POINTS}.points.tools")
    if view == "live":
        page.wait_loaded()
    page.wait(f"Math.abs({POINTS}.camera.ahead[0] - 0.6) < 1e-6")
    page.page.locator(".dnb-view").scroll_into_view_if_needed()
    box = page.page.locator(".dnb-view .dnb-canvas").first.bounding_box()
    x, y = page.page.evaluate(f"(p) => {POINTS}.camera.see(p).at", CENTER.tolist())
    page.page.mouse.dblclick(box["x"] + x, box["y"] + y)
    page.wait(f"{POINTS}.points.list.length === 1")
    page.wait_answered()
    met = CENTER - 14.5 * np.array([0.6, 0.8, 0])
    found = page.page.evaluate(f"{POINTS}.points.list[0].target")
    np.testing.assert_allclose(found, met, atol=1.2)
    np.testing.assert_allclose(editor.points.target[0], picture.plane.to_plane([met])[0, :2], atol=1.2)
    before = editor.points.target[0]
    left, top = page.page.evaluate(f"{POINTS}.camera.see({POINTS}.points.list[0].target).at")
    page.page.mouse.move(box["x"] + left, box["y"] + top)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + left, box["y"] + top - 20, steps=4)
    page.page.mouse.up()
    page.wait("!document.querySelector('.dnb-editor').deformnb.sender.isBehind()")
    page.wait_answered()
    scale = page.page.evaluate(f"{POINTS}.camera.see({POINTS}.points.list[0].source).scale")
    start, end = picture.plane.to_plane([CENTER, CENTER + np.array([0, 0, 20 * scale])])[:, :2]
    np.testing.assert_allclose(editor.points.target[0] - before, end - start, atol=1.01 * scale)
    assert page.errors == []


@pytest.mark.nightly
def test_on_a_deformed_body_a_new_point_lies_on_what_is_seen(show_points: Any, page: LivePage) -> None:
    here = show_points(ControlPoints.from_arrays([CENTER], [CENTER + np.array([12, 0, 0])]))
    page.wait("document.querySelector('.dnb-view').deformnb.field?.space")
    x, y = middle(page.pixels())
    here.mouse.dblclick(x - 4, y - 24)
    here.wait_settled()
    target, source = here.editor.points.target[1], here.editor.points.source[1]
    assert np.linalg.norm(source - CENTER) == pytest.approx(15, abs=2.5)  # of the body as it was
    np.testing.assert_allclose(here.to_screen(target), (x - 4, y - 24), atol=1.0)


def test_points_behind_the_body_are_fainter(show_points: Any, page: LivePage) -> None:
    here = show_points(ControlPoints.from_arrays([CENTER + np.array([0, 18, 0]), CENTER - np.array([3, 18, 0])]))
    page.wait("document.querySelector('.dnb-sp-over [data-id=\"0\"]').classList.contains('dnb-sp-hidden')")
    front = page.page.locator(".dnb-sp-over [data-id='1']")
    assert "dnb-sp-hidden" not in front.get_attribute("class")
    drawn = page.page.locator(".dnb-sp-over [data-id]")
    order = drawn.evaluate_all("(nodes) => nodes.map((node) => node.dataset.id)")
    assert order == ["0", "1"]  # the nearer one is drawn last
    here.view.set_camera((0, -1, 0))
    page.wait("document.querySelector('.dnb-sp-over [data-id=\"1\"]').classList.contains('dnb-sp-hidden')")
    assert "dnb-sp-hidden" not in page.page.locator(".dnb-sp-over [data-id='0']").get_attribute("class")


def test_keys_move_and_delete_a_point(show_points: Any, page: LivePage) -> None:
    here = show_points(one())
    page.page.locator(".dnb-sp-over [data-id='0']").focus()
    page.page.keyboard.press("Shift+ArrowUp")
    here.wait_settled()
    np.testing.assert_allclose(here.editor.points.target[0], CENTER + np.array([0, 0, 10.0]), atol=1e-9)
    page.page.keyboard.press("Control+z")
    here.wait_settled()
    np.testing.assert_array_equal(here.editor.points.target[0], CENTER)
    page.page.keyboard.press("Delete")
    here.wait_settled()
    assert len(here.editor.points) == 0


@pytest.mark.nightly
def test_an_editor_and_two_views_of_one_page_move_together(page: LivePage) -> None:
    here = Shown(page, one())
    page.draw("editor")
    other = VolumeView(here.volume, width=200, height=160, method="core")
    page.add(other, "other")
    other.edit_points(here.editor)
    page.wait("document.querySelector('.dnb-volume').deformnb.spacePoints.points.list.length === 1")
    x, y = here.to_screen(CENTER)
    here.mouse.move(x, y)
    here.mouse.down()
    here.mouse.move(x + 25, y, steps=4)
    places = page.page.evaluate(
        "() => [document.querySelector('.dnb-space').deformnb.parts.points.list[0].target, "
        "document.querySelector('.dnb-volume').deformnb.spacePoints.points.list[0].target]"
    )
    assert places[0] == places[1]
    assert places[0][0] == pytest.approx(CENTER[0] + 25 * here.scale(CENTER), abs=0.5)  # before Python has heard of it
    here.mouse.up()
    here.wait_settled()
    np.testing.assert_allclose(here.editor.points.target[0], places[0])
    assert page.errors == []
    other.close()
    here.editor.close()

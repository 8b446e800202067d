"""The live view in a real browser: its pictures are the core's, and it survives what pages do to it."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage
from browser.pane_messages import message_script, message_text
from PIL import Image

from deformnb.analysis.extent import padded
from deformnb.datasets import PHANTOMS
from deformnb.document.deformation import Deformation, Step
from deformnb.imaging.projection import project
from deformnb.imaging.vtk_volume import gl_status
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.camera import BACKGROUNDS
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.vtk.scene import VtkScene

pytestmark = pytest.mark.needs_browser

SIZE = (240, 180)
TURNED = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
GRID = Grid((30, 36, 24), (1.5, 1.0, 2.0), (5.0, -7.0, 30.0), TURNED)
# The core warps voxel by voxel and then looks at the result, which blurs twice; on a finer grid the second time is
# small, and its picture is what the card makes at every sample.
FINE = GRID.resampled(spacing=0.75)
SIDES = ((0, 1, 0), (-0.6, 0.7, 0.4))  # the same for all tests: the core compiles its renderer for each once


def shape_without_symmetry(grid: Grid = GRID) -> Volume:
    """A bent bar with a ball at one end: no turn and no mirror brings it onto itself."""
    k, j, i = (a / n for a, n in zip(np.indices(grid.shape), grid.shape, strict=True))
    bar = np.maximum(np.abs(j - 0.5) / 0.36, np.maximum(np.abs(i - 0.3), np.abs(k - 0.4)) / 0.1)
    arm = np.maximum(np.abs(i - 0.5) / 0.28, np.maximum(np.abs(j - 0.75), np.abs(k - 0.45)) / 0.12)
    head = np.sqrt((k - 0.62) ** 2 + (j - 0.28) ** 2 + (i - 0.42) ** 2) / 0.22
    edge = 1 + 8 * (1 - np.minimum(np.minimum(bar, arm), head))
    return Volume((np.clip(edge, 0, 2) * 100).astype(np.uint8), grid, "shape")


def drags(grid: Grid, plane: Plane, seed: int, size: float) -> ControlPoints:
    rng = np.random.default_rng(seed)
    corners = plane.to_plane(grid.corners())[:, :2]
    source = corners.min(axis=0) + np.ptp(corners, axis=0) * rng.uniform(0.15, 0.85, (5, 2))
    return ControlPoints.from_arrays(source, source + rng.normal(0, size, (5, 2)))


def fields(grid: Grid = GRID) -> dict[str, Deformation]:
    plane, other = Plane.from_view(grid, "+y"), Plane.from_view(grid, "-z")
    oblique = Plane.from_normal(grid.center, (1, 2, -0.7))
    rng = np.random.default_rng(3)
    corners = grid.corners()
    source = corners.min(axis=0) + np.ptp(corners, axis=0) * rng.uniform(0.15, 0.85, (6, 3))
    maps = tuple(drags(grid, plane, seed, 3.0) for seed in (4, 5, 6))
    twice = Deformation.from_picture_points(grid, plane, drags(grid, plane, 7, 2.0))
    return {
        "none": Deformation(),
        "replicate": Deformation.from_picture_points(grid, plane, drags(grid, plane, 1, 4.0)),
        "oblique": Deformation.from_picture_points(grid, oblique, drags(grid, oblique, 2, 4.0)),
        "modulate": Deformation.from_picture_points(
            grid, plane, drags(grid, plane, 3, 6.0), extrusion="modulate", curve="sin(pi*z)"
        ),
        "interpolate": Deformation((Step(maps, plane, extrusion="interpolate", knots=(0.0, 0.3, 1.0)),)),
        "two planes": twice.then(Deformation.from_picture_points(grid, other, drags(grid, other, 8, 2.0)).steps[0]),
        "in space": Deformation.from_space_points(ControlPoints.from_arrays(source, source + rng.normal(0, 3, (6, 3)))),
    }


def silhouette(image: np.ndarray) -> np.ndarray:
    """Mask of the pixels brighter than the backgrounds of the dark view (41 at most) and of the still (29)."""
    return np.asarray(image.max(axis=2) > 64)


def dice(a: np.ndarray, b: np.ndarray) -> float:
    return 2 * float((a & b).sum()) / float(a.sum() + b.sum())


def open_view(page: LivePage, volume: Volume | None = None, **options: Any) -> LiveView:
    options = {
        "transfer": "surface",
        "width": SIZE[0],
        "height": SIZE[1],
        "settle_ms": 60000,
        "background": "dark",
        **options,
    }
    view = LiveView(volume or shape_without_symmetry(), **options)
    page.add(view)
    page.wait_loaded()
    return view


@pytest.mark.nightly
def test_all_six_views_show_the_right_side_up(page: LivePage) -> None:
    view = open_view(page)
    for name in VIEWS:
        plane = Plane.from_view(GRID, name)
        view.set_camera(plane.normal, [-c for c in plane.v])
        live, still = silhouette(page.pixels()), silhouette(view.still(SIZE))
        # A pixel of the edge of a shape some 80 pixels across; 0.97 leaves two thirds of that.
        assert dice(live, still) > 0.97, name
        for wrong in (live[::-1], live[:, ::-1], live[::-1, ::-1]):
            assert dice(wrong, still) < 0.9, name
    assert page.errors == []


# Mean difference in grey levels of 255 and least correlation of brightness, where something is: lit pictures have other
# lamps. Ambient occlusion, which VTK has none of, is off.
LIKE_VTK = {"composite": (3.0, 0.99), "mip": (4.0, 0.99), "shaded": (32.0, 0.85)}
RAYS = """() => {
  const { loop } = document.querySelector('.dnb-view').deformnb, { gl, targets } = loop.caster.gpu;
  loop.drawNow(4);
  const { width, height, buffer } = targets.full0, all = new Float32Array(4 * width * height);
  gl.bindFramebuffer(gl.FRAMEBUFFER, buffer);
  gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, all);
  return Array.from(all);
}"""


@pytest.mark.nightly
def test_pictures_are_like_those_of_vtks_own_renderer(page: LivePage) -> None:
    if not gl_status()[0]:
        pytest.skip(gl_status()[1])
    volume = PHANTOMS["head"].make((96, 96, 96))
    view = LiveView(volume, background="dark", settle_ms=60000, width=320, height=240, ambient_occlusion=False)
    page.add(view)
    page.wait_loaded()
    scene = VtkScene(volume, (320, 240))
    try:
        scene.set_transfer("specimen")
        scene.set_background("dark")
        scene.set_camera(dict(view.camera))
        behind = np.array(BACKGROUNDS["dark"])
        for projection, (most, least) in LIKE_VTK.items():
            view.projection = projection
            scene.set_projection(projection)
            page.flush()
            drawn = np.array(page.page.evaluate(RAYS)).reshape(240, 320, 4)[::-1]
            live = 255 * np.clip(drawn[..., :3] + (1 - drawn[..., 3:]) * behind, 0, 1)
            vtk = scene.render()
            assert vtk is not None
            body = (drawn[..., 3] > 0.02) | (np.abs(vtk - 255 * behind).max(axis=-1) > 6)
            assert body.mean() > 0.1
            assert np.abs(live - vtk)[body].mean() < most, projection
            assert np.corrcoef(live[body].mean(axis=1), vtk[body].mean(axis=1))[0, 1] > least, projection
    finally:
        scene.close()


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", list(fields()))
def test_the_card_deforms_as_the_core_does(page: LivePage, name: str) -> None:
    view = open_view(page)
    view.show_deformation(fields()[name], output=FINE)
    for direction in SIDES:
        view.set_camera(direction)
        assert dice(silhouette(page.pixels()), silhouette(view.still(SIZE))) > 0.965, direction
    view.projection = "mip"
    view.set_camera((0, 1, 0))
    live, still = page.pixels().astype(int), view.still(SIZE).astype(int)
    inside = silhouette(still.astype(np.uint8)) & silhouette(live.astype(np.uint8))
    assert np.abs(live - still)[inside].mean() < 4  # grey levels of 255
    assert page.errors == []


def test_a_field_of_view_shows_what_has_moved_out_of_the_box(page: LivePage) -> None:
    view = open_view(page)
    plane = Plane.from_view(GRID, "+y")
    away = ControlPoints.from_arrays([[20.0, 20.0]], [[45.0, 20.0]])
    moved = Deformation.from_picture_points(GRID, plane, away, trend="translation")
    corners = GRID.corners()
    larger = GRID.cover(np.concatenate([corners, corners + 25 * np.asarray(plane.u)]))
    view.set_camera((0, 1, 0))
    view.show_deformation(moved, output=larger)
    assert dice(silhouette(page.pixels()), silhouette(view.still(SIZE))) > 0.965


@pytest.mark.sampled(6)
@pytest.mark.parametrize("name", ["none", "modulate", "two planes"])
@pytest.mark.parametrize("projection", ["shaded", "mip"])
def test_skipping_what_is_empty_changes_no_pixel(page: LivePage, name: str, projection: str) -> None:
    view = open_view(page, projection=projection)
    view.show_deformation(fields()[name])
    view.set_camera((-0.6, 0.7, 0.4))
    fast = page.pixels().astype(int)
    fast_quick = quick(page)
    page.page.evaluate("() => { document.querySelector('.dnb-view').deformnb.caster.cells.skips = false; }")
    slow = page.pixels().astype(int)
    # Positions of samples are sums of the same steps in float32: a few pixels at edges differ by rounding.
    assert (np.abs(fast - slow).max(axis=2) > 8).mean() < 2e-3
    assert fast_quick.any()
    assert (np.abs(fast_quick - quick(page)).max(axis=2) > 0.04).mean() < 1e-2


def quick(page: LivePage) -> np.ndarray:
    """A quick picture, whose cells are larger: red, green, blue and opacity from 0 to 1."""
    values = page.page.evaluate("""() => {
        const { loop, caster } = document.querySelector('.dnb-view').deformnb, width = 120, height = 90;
        for (const p of loop.screen.pictures(width, height))
          caster.cast("coarse0", width, height, p, { coarseness: 1.6 });
        const found = new Float32Array(4 * width * height);
        caster.gpu.gl.readPixels(0, 0, width, height, caster.gpu.gl.RGBA, caster.gpu.gl.FLOAT, found);
        return Array.from(found); }""")
    return np.reshape(values, (90, 120, 4))


def test_pointer_wheel_keys_and_buttons_move_the_camera(page: LivePage) -> None:
    view = open_view(page)
    view.set_camera((0, 1, 0))
    page.flush()
    mouse, keyboard = page.page.mouse, page.page.keyboard
    mouse.move(120, 90)
    mouse.down()
    mouse.move(160, 90, steps=4)
    mouse.up()
    page.wait("models.view.saved.length > 0")
    # What faces the viewer follows the pointer to the right, so the viewer comes from further left: looks to the right.
    direction = view.camera["direction"]
    assert direction[0] > 0.3
    assert abs(direction[2]) < 1e-6
    keyboard.press("ArrowDown")
    page.wait("models.view.saved.length > 1")
    assert view.camera["direction"][2] < -0.01  # the front goes down: seen from above
    before = view.camera["zoom"]
    keyboard.press("+")
    page.wait("models.view.saved.length > 2")
    assert view.camera["zoom"] == pytest.approx(1.2 * before)
    zoomed = view.camera["zoom"]
    mouse.wheel(0, -200)
    page.wait("models.view.saved.length > 3")
    assert view.camera["zoom"] > 1.2 * zoomed
    page.page.focus(".dnb-button >> text=S")
    keyboard.press("Enter")
    page.wait("models.view.saved.length > 4")
    np.testing.assert_allclose(view.camera["direction"], [0, 0, -1], atol=1e-6)
    assert view.camera["zoom"] == pytest.approx(1.0)
    keyboard.down("Shift")
    mouse.move(120, 90)
    mouse.down()
    mouse.move(150, 90)
    mouse.up()
    keyboard.up("Shift")
    page.wait("models.view.saved.length > 5")
    assert view.camera["pan"][0] < -1
    assert page.page.text_content(".dnb-right") == "R"  # from above with the face up
    mouse.dblclick(120, 90)  # never the camera's
    keyboard.press("0")
    page.wait("models.view.saved.length > 6")
    assert view.camera["pan"] == [0, 0]
    assert page.page.evaluate("models.view.saved.length") == 7
    assert page.errors == []


def test_a_turn_draws_quickly_and_then_in_full(page: LivePage) -> None:
    view = open_view(page, settle_ms=50)
    page.wait("document.querySelector('.dnb-view').deformnb.stats")
    before = view.stats()["frames"]
    page.page.focus(".dnb-canvas")
    for _ in range(5):
        drawn_before = page.page.evaluate(f"{PAGE}.loop.times.frames")
        page.page.keyboard.press("ArrowLeft")
        page.wait(f"{PAGE}.loop.times.frames > {drawn_before}")  # a quick picture of each turn
    page.wait_until(lambda: view.stats()["frames"] > before)  # told at rest
    stats = view.stats()
    assert stats["passes"] >= 1
    assert stats["full_ms"] > 0
    assert 0 < stats["scale"] <= 1
    assert stats["received"] == stats["volume_bytes"]  # no voxel comes twice


# Only the context that a live view needs is missing.
NO_WEBGL = """() => { const found = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
      return kind === "webgl2" ? null : found.call(this, kind, ...rest); }; }"""
DRAWN = "document.querySelector('.dnb-volume')?.deformnb"


def drawn(page: LivePage) -> np.ndarray:
    """The picture that Python has drawn, as it is on the screen."""
    data = page.page.evaluate(f"{DRAWN}.elements.canvas.toDataURL('image/png').split(',')[1]")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))


def test_without_webgl_python_draws_and_says_so(browser: Any) -> None:
    page = LivePage(browser, init=NO_WEBGL)
    view = LiveView(
        shape_without_symmetry(), width=SIZE[0], height=SIZE[1], background="dark", transfer="surface", settle_ms=50
    )
    page.add(view)
    page.wait(f"{DRAWN}?.isFull")
    assert "no WebGL2" in page.page.text_content(".dnb-view-pane:not([hidden]) .dnb-messages-text")
    assert page.page.locator(".dnb-view:visible").count() == 1
    assert dice(silhouette(drawn(page)), silhouette(view.still(SIZE))) > 0.96
    page.page.focus(".dnb-volume .dnb-button >> text=S")
    page.page.keyboard.press("Enter")
    page.wait("models.view.saved.length > 0")
    np.testing.assert_allclose(view.camera["direction"], [0, 0, -1], atol=1e-6)
    page.wait(f"{DRAWN}.count > 2 && {DRAWN}.isFull")
    page.wait_until(lambda: dice(silhouette(drawn(page)), silhouette(view.still(SIZE))) > 0.96)
    view.show_deformation(None, output=padded(GRID, 9.0))
    page.wait(f"{DRAWN}.info.box.high[0] > models.view.get('volume_info').box.high[0] + 8")
    assert page.errors == []
    view.close()
    page.close()


def test_without_webgl_the_volume_follows_while_the_button_is_down(browser: Any) -> None:
    page = LivePage(browser, (900, 900), init=NO_WEBGL)
    plane = Plane.from_view(GRID, "+y")
    still = ControlPoints.from_arrays([[20.0, 20.0]])
    editor = Editor(project(shape_without_symmetry(), plane), still, trend="translation", height=300)
    view = LiveView(shape_without_symmetry(), width=SIZE[0], height=SIZE[1], background="dark", transfer="surface")
    view.set_camera(plane.normal, [-c for c in plane.v])
    page.add(editor, "editor")
    page.add(view)
    view.follow(editor, Deformation.from_picture_points(GRID, plane, still, trend="translation").field(GRID))
    page.wait(f"{DRAWN}?.drawn")
    page.wait_until(lambda: editor.live)
    page.flush()
    start = _middle(drawn(page))
    handle = page.page.locator(".dnb-ed-disc").first.bounding_box()
    x, y = handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 30, y + 20, steps=6)
    page.wait_until(lambda: bool((_middle(drawn(page)) - start > 2).all()))  # right and down, and the button is down
    assert editor.points == still
    page.page.mouse.up()
    page.wait_until(lambda: editor.points != still)
    assert page.errors == []
    view.close()
    page.close()


# The card says that it is out of memory whenever a texture holds more voxels than this.
SCARCE = """(most) => { const gl = WebGL2RenderingContext.prototype, { texStorage3D, getError } = gl;
    gl.texStorage3D = function (target, levels, format, x, y, z) {
      this.tooMuch = x * y * z > most; texStorage3D.call(this, target, levels, format, x, y, z); };
    gl.getError = function () {
      const error = this.tooMuch ? this.OUT_OF_MEMORY : getError.call(this); this.tooMuch = false; return error; }; }"""


def test_a_volume_that_the_card_does_not_hold_is_shown_with_fewer_voxels(browser: Any) -> None:
    size = 96
    volume = shape_without_symmetry(Grid((size, size, size)))
    page = LivePage(browser)
    page.page.evaluate(SCARCE, size**3 // 4)
    view = open_view(page, volume)
    assert int(np.prod(view.volume_info["shape"])) == size**3 // 4
    assert message_text(page.page) == ("shown at 1/2 along x, 1/2 along y, as much as the graphics memory holds")
    view.set_camera((0, 1, 0))
    assert dice(silhouette(page.pixels()), silhouette(view.still(SIZE))) > 0.96
    assert page.page.is_hidden(".dnb-progress")
    assert page.page.get_attribute(".dnb-messages", "data-kind") == "info"
    assert page.errors == []
    page.close()


def test_a_card_that_holds_nothing_says_so(browser: Any) -> None:
    page = LivePage(browser)
    page.page.evaluate(SCARCE, 10)
    page.add(LiveView(Volume(np.zeros((40, 40, 40), np.uint8), Grid((40, 40, 40)))))
    page.wait(f"{message_script()}.includes('graphics memory does not hold')")
    page.close()


def test_a_context_that_is_lost_by_the_volume_comes_back_with_fewer_voxels(browser: Any) -> None:
    page = LivePage(browser)
    size = 64
    page.page.evaluate(
        """(most) => { const gl = WebGL2RenderingContext.prototype, { texSubImage3D } = gl;
        gl.texSubImage3D = function (...all) {
          texSubImage3D.apply(this, all);
          if (all[5] * all[6] * models.view.get("volume_info").shape[2] <= most || window.loss) return;
          window.loss = this.getExtension("WEBGL_lose_context"); window.loss.loseContext();
          setTimeout(() => { window.loss.restoreContext(); }, 300); }; }""",
        size**3 // 2,
    )
    view = open_view(page, shape_without_symmetry(Grid((size, size, size))))
    page.wait(f"models.view.get('volume_info').shape.reduce((a, b) => a * b) === {size**3 // 2}")
    page.wait_loaded()
    view.set_camera((0, 1, 0))
    assert dice(silhouette(page.pixels()), silhouette(view.still(SIZE))) > 0.96
    view.close()
    page.close()


def test_a_lost_context_comes_back_with_the_same_picture(page: LivePage) -> None:
    view = open_view(page)
    view.show_deformation(fields()["replicate"])
    before = page.pixels().astype(int)
    page.page.evaluate("""() => { const { gl } = document.querySelector(".dnb-view").deformnb.caster.gpu;
        window.loss = gl.getExtension("WEBGL_lose_context"); window.loss.loseContext(); }""")
    page.wait(f"{DRAWN}?.drawn")
    assert "lost graphics context" in page.page.text_content(".dnb-view-pane:not([hidden]) .dnb-messages-text")
    page.page.evaluate("() => window.loss.restoreContext()")
    page.wait("document.querySelector('.dnb-view').deformnb.caster?.isReady && !document.querySelector('.dnb-volume')")
    assert np.abs(page.pixels().astype(int) - before).mean() < 0.5  # the same but for the rounding of noise
    assert page.page.is_hidden(".dnb-messages-text")
    assert page.page.is_visible(".dnb-canvas")


@pytest.mark.nightly
def test_twenty_views_one_after_the_other_leak_no_context(page: LivePage) -> None:
    open_view(page, Volume(np.full((8, 8, 8), 200, np.uint8), Grid((8, 8, 8))))
    for _ in range(20):
        page.page.evaluate("() => models.view.cleanups.splice(0).forEach((f) => f())")
        page.draw()
        page.wait_loaded()
    assert page.page.evaluate("document.querySelectorAll('canvas').length") == 1
    assert page.errors == []  # "Too many active WebGL contexts" is a warning of the 17th
    assert page.page.evaluate("document.querySelector('.dnb-view').deformnb.caster.gpu.gl.isContextLost()") is False


_EDITOR = """(state) => { makeModel("editor", state); }"""


def test_an_editor_in_the_page_moves_the_volume_without_a_byte(page: LivePage) -> None:
    plane = Plane.from_view(GRID, "+y")
    still, dragged = drags(GRID, plane, 1, 0.0), drags(GRID, plane, 1, 4.0)
    view = open_view(page)
    wanted = Deformation.from_picture_points(GRID, plane, dragged)
    view.show_deformation(wanted)
    view.set_camera((0, 1, 0))
    expected = page.pixels().astype(int)
    view.show_deformation(Deformation.from_picture_points(GRID, plane, still))
    view.set_camera((0, 1, 0))
    start = page.pixels().astype(int)
    chosen = wanted.steps[0].support_for(dragged)
    page.page.evaluate(
        _EDITOR,
        {
            "uid": "u1",
            "points": _listed(still),
            "lone_support": 10.0,
            "settings": {
                "kernel": "wendland_c2",
                "support": None,
                "chosen_support": chosen,
                "trend": "affine",
                "smoothing": 0.0,
                "strength": 1.0,
                "stages": 1,
            },
        },
    )
    page.page.evaluate("() => { models.view.fromPython('editor', 'IPY_MODEL_editor'); }")
    said = "models.view.sent.filter((m) => m.type !== 'seen').length"  # fields of before are confirmed when drawn
    sent, messages = view.stats()["field_bytes"], page.page.evaluate(said)
    page.page.evaluate("(points) => { models.editor.set('points', points); }", _listed(dragged))
    page.wait("document.querySelector('.dnb-view').deformnb.shownField.link.count > 1")
    moved = page.pixels().astype(int)
    assert np.abs(moved - start).mean() > 2
    assert np.abs(moved - expected).mean() < 0.3  # the browser's fit is the package's
    assert view.stats()["field_bytes"] == sent
    assert page.page.evaluate(said) == messages
    # Points that cannot be fitted leave the last good picture.
    clash = [*_listed(dragged), {**_listed(dragged)[0], "id": 99, "source": [0.0, 0.0]}]
    page.page.evaluate("(points) => { models.editor.set('points', points); }", clash)
    assert np.abs(page.pixels().astype(int) - moved).mean() < 0.3
    assert page.errors == []


def _listed(points: ControlPoints) -> list[dict[str, Any]]:
    return [
        {
            "id": points.ids[k],
            "name": "",
            "source": points.source[k].tolist(),
            "target": points.target[k].tolist(),
            "active": True,
            "weight": 1.0,
        }
        for k in range(len(points))
    ]


def test_what_goes_right_and_down_in_the_editor_does_so_in_space(page: LivePage) -> None:
    view = open_view(page)
    for name in ("+y", "-x", "-z"):
        plane = Plane.from_view(GRID, name)
        still = ControlPoints.from_arrays([[20.0, 20.0]])
        editor = Editor(project(shape_without_symmetry(), plane), still, trend="translation")
        page.add(editor, name)
        view.set_camera(plane.normal, [-c for c in plane.v])
        view.follow(editor, Deformation.from_picture_points(GRID, plane, still, trend="translation").field(GRID))
        start = _middle(page.pixels())
        count = page.page.evaluate(f"{LINK}.count")
        editor.points = still.move(0, [24.0, 23.0])
        page.wait(f"{LINK}.count > {count}")
        right, down = _middle(page.pixels()) - start
        # Four and three lengths of some 2 pixels each; what leaves the box on the right makes the mean a little less.
        assert right > 3, name
        assert down > 2, name
    assert page.errors == []


LINK = "document.querySelector('.dnb-view').deformnb.shownField.link"


def _middle(image: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(silhouette(image))
    return np.array([columns.mean(), rows.mean()])


def test_a_narrow_transfer_function_is_seen_without_bands(page: LivePage) -> None:
    # A block whose value rises evenly from left to right, within a small part of the range of all values.
    values = np.broadcast_to(1000 + 11 * np.arange(24), (24, 24, 24)).astype(np.int16)
    values[:2, -2:] = 0
    values[:2, :2] = 4000
    view = open_view(page, Volume(values, Grid((24, 24, 24))), projection="composite")
    view.set_camera((0, 1, 0))
    view.rest = 3600.0  # pages of tests hear of traits from their own thread only
    view.set_transfer(TransferFunction(((1000, 0.1, 0.1, 0.1), (1250, 1, 1, 1)), ((900, 0), (1000, 0.95))))
    banded = page.pixels()
    whole = page.page.evaluate(f"{PAGE}.info.id")
    view.repack()
    # Until the new voxels are on the card the old ones keep their colours.
    kept = page.page.evaluate(f"[{PAGE}.caster.voxels.volume.loaded, {PAGE}.caster.voxels.table.rgba[0]]")
    assert kept == [True, pytest.approx(0.1)]
    page.wait(f"{PAGE}.info.id !== '{whole}' && {PAGE}.caster.isReady && !{PAGE}.voxels.loader")
    fine = page.pixels()
    assert unevenness(fine) < 0.4 * unevenness(banded)
    assert np.abs(fine[70:110, 70:170].astype(int) - banded[70:110, 70:170]).mean() < 8  # the same picture otherwise
    assert message_text(page.page).startswith("finer greys from ")
    assert page.errors == []


PAGE = "document.querySelector('.dnb-view').deformnb"


def unevenness(image: np.ndarray) -> float:
    """Largest deviation of columns from a steady rise, in grey levels."""
    columns = image[70:110, 70:170, 0].mean(axis=0)
    x = np.arange(len(columns))
    return float(np.std(columns - np.polyval(np.polyfit(x, columns, 2), x)))

"""The page without a kernel in a real browser: from file://, with no network, dragged with a real mouse."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from browser.pane_messages import message_script, message_text
from numpy.typing import NDArray
from PIL import Image

from deformnb.analysis.extent import exceeded_sides, find_foreground, reached_places
from deformnb.document.deformation import Deformation
from deformnb.document.json_format import from_json
from deformnb.imaging.projection import project
from deformnb.rbf.cuts import Cut
from deformnb.rbf.kernels import KERNELS, register_kernel
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.foreground import cut_off_text
from deformnb.warping.warper import warp_picture
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.standalone import write_standalone
from deformnb.widgets.studio.studio import Studio
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

TURNED = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
GRID = Grid((30, 36, 24), (1.5, 1.0, 2.0), (5.0, -7.0, 30.0), TURNED)
# The core warps voxel by voxel and then looks at the result, which blurs twice; on a finer grid the second time is
# small, and its picture is what the card makes at every sample.
FINE = GRID.resampled(spacing=0.75)
PLANE = Plane.from_view(GRID, "+y")

EDITOR = "document.querySelector('.dnb-editor').deformnb.parts"
VIEW = "document.querySelector('.dnb-view').deformnb"
MODELS = "document.body.deformnb"
FAR = (
    f"{MODELS}.editor.update({{ points: {EDITOR}.points.list.map((p) => "
    "({ ...p, target: [p.source[0] + 30, p.source[1] - 25] })) })"
)
SIDES = f"{VIEW}.caster.exceededSides({MODELS}.view.get('tissue_check'))"


def bar_with_a_ball() -> Volume:
    """A bent bar with a ball at one end: no turn and no mirror brings it onto itself."""
    k, j, i = (a / n for a, n in zip(np.indices(GRID.shape), GRID.shape, strict=True))
    bar = np.maximum(np.abs(j - 0.5) / 0.36, np.maximum(np.abs(i - 0.3), np.abs(k - 0.4)) / 0.1)
    arm = np.maximum(np.abs(i - 0.5) / 0.28, np.maximum(np.abs(j - 0.75), np.abs(k - 0.45)) / 0.12)
    head = np.sqrt((k - 0.62) ** 2 + (j - 0.28) ** 2 + (i - 0.42) ** 2) / 0.22
    edge = 1 + 8 * (1 - np.minimum(np.minimum(bar, arm), head))
    return Volume((np.clip(edge, 0, 2) * 100).astype(np.uint8), GRID, "bar with a ball")


def pair() -> tuple[Editor, LiveView]:
    """Five points that move nothing yet, and the volume seen from where the picture is taken."""
    volume = bar_with_a_ball()
    low, high = (f(PLANE.to_plane(GRID.corners())[:, :2], axis=0) for f in (np.min, np.max))
    at = low + (high - low) * np.array([[0.1, 0.1], [0.9, 0.1], [0.9, 0.9], [0.1, 0.9], [0.45, 0.5]])
    editor = Editor(project(volume, PLANE), ControlPoints.from_arrays(at), show_grid=False)
    view = LiveView(volume, transfer="surface", background="dark", settle_ms=60000)
    view.set_camera(PLANE.normal, [-c for c in PLANE.v])
    view.follow(editor, Deformation.from_picture_points(GRID, PLANE, editor.points).field(GRID), output=FINE)
    return editor, view


class Opened:
    """A file in a browser that has no network."""

    def __init__(self, browser: Any, path: Path, size: tuple[int, int], init: str, **options: Any) -> None:
        self.context = browser.new_context(viewport={"width": size[0], "height": size[1]}, offline=True, **options)
        self.page = self.context.new_page()
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._collect_error)
        if init:
            self.page.add_init_script(init)
        self.page.goto(path.as_uri())

    def _collect_error(self, message: Any) -> None:
        if message.type in ("error", "warning") and "GPU stall due to ReadPixels" not in message.text:
            self.errors.append(message.text)  # reading pixels back is what a screenshot is

    def js(self, expression: str) -> Any:
        return self.page.evaluate(f"() => {expression}")

    def wait(self, condition: str, timeout: float = 30.0) -> None:
        """Until an expression holds. Playwright's own waiting needs eval, which the page's policy forbids."""
        for _ in range(int(timeout / 0.05)):
            if self.js(f"Boolean({condition})"):
                return
            self.page.wait_for_timeout(50)
        raise TimeoutError(f"{condition} did not come true in {timeout} s; the page said {self.errors}")

    def wait_settled(self) -> None:
        self.wait(
            f"document.querySelector('.dnb-editor') && {EDITOR}.picture.painter.source && "
            f"!{EDITOR}.frames.isMoving && !{EDITOR}.frames.request"
        )

    def wait_loaded(self) -> None:
        self.wait_settled()
        self.wait("document.querySelector('.dnb-view') && !document.querySelector('.dnb-page-still')")
        self.wait(f"{VIEW}.caster?.isReady && {VIEW}.field")

    def drag(self, place: Any, by: tuple[float, float]) -> None:
        """Drags what is at a place of the picture by pixels of the screen, with the real mouse."""
        v, box = self.js(f"({EDITOR}.viewport.view)"), self.page.locator(".dnb-ed-stage").bounding_box()
        x, y = box["x"] + v["k"] * place[0] + v["x"], box["y"] + v["k"] * place[1] + v["y"]
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x + by[0], y + by[1], steps=5)
        self.page.mouse.up()
        self.wait_settled()

    def points(self) -> ControlPoints:
        """The points as the page holds them."""
        rows = self.js(f"{MODELS}.editor.get('points')")
        return ControlPoints.from_arrays([r["source"] for r in rows], [r["target"] for r in rows])

    def volume(self) -> NDArray[np.int64]:
        """Canvas of the volume, drawn in full now."""
        data = self.js(f"""{{ const view = {VIEW}; view.loop.drawNow(2);
            return view.elements.canvas.toDataURL('image/png').split(',')[1]; }}""")
        return _decoded(data)

    def picture(self) -> NDArray[np.int64]:
        """Canvas of the editor."""
        return _decoded(self.js("document.querySelector('.dnb-ed-canvas').toDataURL('image/png').split(',')[1]"))


def _decoded(text: str) -> NDArray[np.int64]:
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(text))).convert("RGB")).astype(np.int64)


@pytest.fixture
def open_page(browser: Any, tmp_path: Path) -> Iterator[Callable[..., Opened]]:
    pages: list[Opened] = []

    def make(
        editor: Editor,
        view: LiveView | None = None,
        *,
        size: tuple[int, int] = (940, 560),
        init: str = "",
        options: dict[str, Any] | None = None,
        **about: Any,
    ) -> Opened:
        path = tmp_path / f"page {len(pages)}.html"
        write_standalone(path, editor, view, **about)
        pages.append(Opened(browser, path, size, init, **(options or {})))
        return pages[-1]

    yield make
    for page in pages:
        page.context.close()
        assert page.errors == []
        # The file itself, and pictures that it holds or has made; nothing else was even asked for.
        assert [url.split(":")[0] for url in page.requests if not url.startswith(("blob:", "data:"))] == ["file"]


def silhouette(image: NDArray[Any]) -> NDArray[np.bool_]:
    """Mask of the pixels brighter than the backgrounds of the dark view (41 at most) and of the still (29)."""
    return np.asarray(image.max(axis=2) > 64)


def dice(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    return 2 * float((a & b).sum()) / float(a.sum() + b.sum())


def middle(image: NDArray[Any]) -> NDArray[np.float64]:
    rows, columns = np.nonzero(silhouette(image))
    return np.array([columns.mean(), rows.mean()])


def dragged(page: Opened) -> NDArray[np.float64]:
    """Displacement of the middle point, to the right and down."""
    points = page.points()
    return np.asarray(points.target[4] - points.source[4])


def test_a_drag_deforms_picture_and_volume_as_the_core_does(open_page: Callable[..., Opened]) -> None:
    editor, view = pair()
    page = open_page(editor, view)
    page.wait_loaded()
    start, flat = page.volume(), page.picture()
    size = (start.shape[1], start.shape[0])
    assert dice(silhouette(start), silhouette(view.still(size))) > 0.965
    page.drag(editor.points.target[4], (40, 25))
    moved = page.volume()
    wanted = Deformation.from_picture_points(GRID, PLANE, page.points())
    right, down = dragged(page)
    assert right > 1
    assert down > 1
    view.show_deformation(wanted, output=FINE)
    expected = silhouette(view.still(size))
    assert dice(silhouette(moved), expected) > 0.965
    assert dice(silhouette(start), expected) < 0.93  # it would not be enough to stay as it was
    assert (middle(moved) - middle(start) > 3).all()  # pixels to the right and down, as the hand went
    # The picture too, exactly as the core warps it at the canvas's pixels.
    editor.points = page.points()
    v, raster = page.js(f"({EDITOR}.viewport.view)"), editor.picture.raster  # type: ignore[union-attr]
    bent = page.picture()
    d = 1 / (v["k"] * v["ratio"])
    on_canvas = type(raster)(
        bent.shape[:2], (d, d), ((0.5 / v["ratio"] - v["x"]) / v["k"], (0.5 / v["ratio"] - v["y"]) / v["k"])
    )
    core = warp_picture(editor.picture.grey(), raster, editor.fit(), output=on_canvas) * 255  # type: ignore[union-attr]
    a0, a1, b0, b1 = raster.box
    share = (on_canvas.points() - [a0, b0]) / [a1 - a0, b1 - b0]
    inside = ((share > 0.25) & (share < 0.75)).all(axis=-1)  # away from the points' rings and the edge of the picture
    assert np.abs(bent[..., 0] - core)[inside].mean() < 2
    assert np.abs(bent - flat)[inside].mean() > 4
    # Back and forth again.
    page.page.keyboard.press("Control+z")
    page.wait_settled()
    assert not page.points().displacement.any()
    assert np.abs(page.volume() - start).mean() < 0.3
    assert np.abs(page.picture() - flat).mean() < 0.3
    page.page.keyboard.press("Control+y")
    page.wait_settled()
    assert np.abs(page.volume() - moved).mean() < 0.3
    # Far to the right and up tissue leaves the box, beyond the same sides as the core finds.
    assert "leaves" not in message_text(page.page, ".dnb-editor")
    page.js(FAR)
    page.wait_settled()
    far = Deformation.from_picture_points(GRID, PLANE, page.points()).field(GRID)
    names = exceeded_sides(reached_places(find_foreground(bar_with_a_ball()), far), FINE)
    assert len(names) == 2
    # In the order of the picture's sides, or of the box's axes.
    assert message_text(page.page, ".dnb-editor") in {cut_off_text(names), cut_off_text(names[::-1])}
    page.page.keyboard.press("Control+z")
    page.wait(f"!{message_script('.dnb-editor')}.includes('leaves')")


def test_a_map_that_is_not_the_same_at_every_depth_is_checked_by_the_view(open_page: Callable[..., Opened]) -> None:
    editor, view = pair()
    step = editor.step(extrusion="modulate", curve=(1.0, 0.4))
    view.follow(editor, Deformation((step,)).field(GRID), output=FINE)
    page = open_page(editor, view)
    page.wait_settled()
    assert page.js(SIDES) == []
    page.js(FAR)
    page.wait(f"{message_script('.dnb-view-pane')} !== ''")
    step = replace(step, maps=(page.points(),))
    far = Deformation((step,)).field(GRID)
    names = exceeded_sides(reached_places(find_foreground(bar_with_a_ball()), far), FINE)
    assert len(names) == 2
    assert message_text(page.page, ".dnb-view-pane") == cut_off_text(names)
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("Control+z")
    page.wait(f"{message_script('.dnb-view-pane')} === ''")


def test_the_volume_follows_while_the_mouse_is_down(open_page: Callable[..., Opened]) -> None:
    editor, view = pair()
    page = open_page(editor, view)
    page.wait_loaded()
    start = page.volume()
    box, v = page.page.locator(".dnb-ed-stage").bounding_box(), page.js(f"({EDITOR}.viewport.view)")
    x, y = (box[c] + v["k"] * editor.points.target[4][k] + v[c] for k, c in enumerate("xy"))
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 40, y, steps=4)
    page.wait(f"{VIEW}.shownField.link.isMoving")
    assert (middle(page.volume()) - middle(start))[0] > 3
    assert not page.points().displacement.any()  # the points are the model's until the hand lets go
    page.page.mouse.up()
    page.wait_settled()
    assert dragged(page)[0] > 1


@pytest.mark.nightly
def test_points_that_have_moved_already_are_seen_at_once(open_page: Callable[..., Opened]) -> None:
    editor, view = pair()
    editor.points = editor.points.move(4, editor.points.target[4] + [5.0, 4.0])
    page = open_page(editor, view)
    page.wait_loaded()
    image = page.volume()
    view.show_deformation(Deformation.from_picture_points(GRID, PLANE, editor.points), output=FINE)
    assert dice(silhouette(image), silhouette(view.still((image.shape[1], image.shape[0])))) > 0.965


@pytest.mark.nightly
def test_the_controls_do_what_they_say(open_page: Callable[..., Opened], tmp_path: Path) -> None:
    editor, view = pair()
    editor.points = editor.points.move(4, editor.points.target[4] + [5.0, 0.0])
    page = open_page(editor, view)
    page.wait_loaded()
    start = page.volume()
    strength = page.page.locator("input[name=strength]")
    strength.fill("0")
    page.wait_settled()
    assert (middle(start) - middle(page.volume()))[0] > 3
    assert page.page.locator(".dnb-page-value").first.text_content() == "0.00"
    strength.fill("-1")
    page.wait_settled()
    assert (middle(start) - middle(page.volume()))[0] > 6
    menu = page.page.locator("select[name=kernel]")
    assert page.js("[...document.querySelector('select[name=kernel]').options].map((o) => o.value)")[:2] == [
        "wendland_c2",
        "wendland_c0",
    ]
    menu.select_option("thin_plate")
    page.page.locator("input[name=density]").fill("9")
    page.wait_settled()
    assert page.js(f"[{EDITOR}.map.fit.kernel, {EDITOR}.model.get('density')]") == ["thin_plate", 9]
    with page.page.expect_download() as waiting:
        page.page.get_by_role("button", name="Download points").click()
    waiting.value.save_as(tmp_path / "points.json")
    document = from_json((tmp_path / "points.json").read_text(encoding="utf-8"))
    (step,) = document.steps
    assert (step.kernel, step.strength, step.plane) == ("thin_plate", -1.0, PLANE)
    assert step.points == editor.points
    page.page.get_by_role("button", name="Reset", exact=True).click()
    page.wait_settled()
    assert np.abs(page.volume() - start).mean() < 0.3
    assert page.js(f"[{EDITOR}.map.fit.kernel, {EDITOR}.model.get('settings').strength]") == ["wendland_c2", 1]


def test_reset_brings_back_the_points_and_undo_those_from_before(open_page: Callable[..., Opened]) -> None:
    editor, view = pair()
    page = open_page(editor, view)
    page.wait_loaded()
    page.drag(editor.points.target[4], (30, 0))
    moved = page.points()
    page.page.get_by_role("button", name="Reset", exact=True).click()
    page.wait_settled()
    assert not page.points().displacement.any()
    page.page.get_by_role("button", name="Undo").click()
    page.wait_settled()
    assert page.points() == moved


def test_a_kernel_that_the_trend_cannot_carry_is_not_offered(open_page: Callable[..., Opened]) -> None:
    editor, view = pair()
    editor.trend = "none"
    page = open_page(editor, view)
    page.wait_loaded()
    options = "[...document.querySelector('select[name=kernel]').options]"
    off = page.js(f"{options}.filter((o) => o.disabled).map((o) => o.value)")
    assert off == ["thin_plate", "multiquadric", "cubic", "quintic", "linear"]


@pytest.mark.nightly
def test_a_kernel_of_ones_own_works_in_the_page(
    open_page: Callable[..., Opened], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the scripts of the editor and of the view, chosen from the menu, and in the document; beside the same one."""
    monkeypatch.setitem(KERNELS, "bell", KERNELS["gaussian"])  # so that it is gone in the end
    register_kernel(lambda rho: jnp.exp(-4.5 * rho**2), name="bell", title="Bell")
    editor, view = pair()
    editor.change(kernel="bell", support=25.0)
    page = open_page(editor, view)
    page.wait_loaded()
    page.drag(editor.points.target[4], (30, 20))
    seen = {}
    for kernel in ("bell", "gaussian", "wendland_c2", "bell"):
        page.page.locator("select[name=kernel]").select_option(kernel)
        page.wait_settled()
        assert page.js(f"{EDITOR}.map.fit.kernel") == kernel
        seen.setdefault(kernel, []).append((page.picture(), page.volume()))
    for k, least in enumerate((1.0, 0.3)):  # of the picture, and of the volume
        own, again, built_in, other = (shown[k] for name in ("bell", "gaussian", "wendland_c2") for shown in seen[name])
        assert np.abs(own - built_in).mean() < 0.02
        assert (own == again).all()
        assert np.abs(own - other).mean() > least
    (step,) = from_json(page.js(f"JSON.stringify({MODELS}.document())")).steps
    assert (step.kernel, dict(step.extra)) == ("bell", {})


NO_WEBGL = """{ const get = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
        return kind === "webgl2" ? null : get.call(this, kind, ...rest); }; }"""


def test_without_webgl_a_still_picture_is_shown_and_the_editor_works(open_page: Callable[..., Opened]) -> None:
    editor, view = pair()
    page = open_page(editor, view, init=NO_WEBGL)
    page.wait_settled()
    page.wait("document.querySelector('.dnb-still')?.naturalWidth === 640")
    assert page.page.is_visible(".dnb-page-alert")
    assert "no WebGL2" in page.page.text_content(".dnb-page-alert")
    assert page.page.is_disabled("select[name=shows]")
    for part in (".dnb-progress", ".dnb-view-pane .dnb-messages"):  # which a still would cover
        assert page.page.is_hidden(part)
    shown = _decoded(
        page.js("""(() => { const image = document.querySelector('.dnb-still'),
        canvas = Object.assign(document.createElement('canvas'), { width: 640, height: 480 });
        canvas.getContext('2d').drawImage(image, 0, 0);
        return canvas.toDataURL('image/png').split(',')[1]; })()""")
    )
    assert np.abs(shown - view.still((640, 480)).astype(int)).mean() < 0.5
    page.drag(editor.points.target[4], (40, 25))
    assert dragged(page).min() > 1


def test_the_picture_alone_is_a_page_too(open_page: Callable[..., Opened]) -> None:
    editor, _ = pair()
    page = open_page(editor, title="a picture")
    page.wait_settled()
    page.drag(editor.points.target[4], (40, 25))
    assert dragged(page).min() > 1
    assert page.js("document.querySelectorAll('.dnb-view, .dnb-page-still').length") == 0
    assert page.page.title() == "a picture"


def test_text_that_looks_like_a_script_is_text(open_page: Callable[..., Opened]) -> None:
    editor, view = pair()
    evil = "</script><img src=x onerror=\"document.title = 'broken'\"><script>document.title = 'broken'</script>"
    editor.points = editor.points.edit(4, name=evil)
    page = open_page(editor, view, title=evil, about=evil)
    page.wait_loaded()
    assert page.page.title() == evil
    assert page.page.text_content("h1") == evil
    assert page.js("document.querySelectorAll('img[src=x]').length") == 0
    assert page.js("document.querySelectorAll('script').length") == 4


def test_the_policy_stops_what_would_reach_out(open_page: Callable[..., Opened]) -> None:
    editor, _ = pair()
    page = open_page(editor)
    page.wait_settled()
    page.page.evaluate("""() => { window.refused = [];
        document.addEventListener("securitypolicyviolation", (event) => window.refused.push(event.blockedURI));
        const image = new Image(); image.src = "https://example.org/a.png";
        return fetch("https://example.org/").catch(() => null); }""")
    page.wait("window.refused.length >= 2")
    assert sum("Content Security Policy" in text for text in page.errors) >= 2
    page.errors.clear()
    page.requests[:] = [url for url in page.requests if "example.org" not in url]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("size", [(360, 740), (1280, 800), (1920, 1080)])
def test_it_fits_windows_from_a_phone_to_a_desk(open_page: Callable[..., Opened], size: tuple[int, int]) -> None:
    page = open_page(*pair(), size=size, about="A line about it.")
    page.wait_loaded()
    parts = (".dnb-editor", ".dnb-view", ".dnb-page-controls")
    boxes = {name: page.page.locator(name).bounding_box() for name in parts}
    assert page.js("document.documentElement.scrollWidth") <= size[0]
    for box in boxes.values():
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= size[0]
    picture, volume = boxes[".dnb-editor"], boxes[".dnb-view"]
    beside = picture["x"] + picture["width"] <= volume["x"]
    below = picture["y"] + picture["height"] <= volume["y"]
    assert (below, beside) == ((True, False) if size[0] < 860 else (False, True))
    assert volume["width"] > 0.4 * size[0]
    page.page.locator(".dnb-canvas").focus()
    for name in (".dnb-ed-stage", ".dnb-canvas"):  # one finger scrolls
        assert page.js(f"getComputedStyle(document.querySelector('{name}')).touchAction") == "pan-y"


def test_the_downloaded_document_is_plain_json_without_a_plane_of_its_own(open_page: Callable[..., Opened]) -> None:
    page = open_page(Editor(None, ControlPoints.from_arrays([[0, 0], [50, 0], [20, 40]])))
    page.wait(f"document.querySelector('.dnb-editor') && !{EDITOR}.frames.request")
    text = json.loads(page.js(f"JSON.stringify({MODELS}.document())"))
    assert [p["target"] for p in text["points"]] == [[0, 0], [50, 0], [20, 40]]
    assert text["kernel"] == "wendland_c2"


def test_stages_locks_and_radii_come_back_with_the_points(open_page: Callable[..., Opened]) -> None:
    editor, _ = pair()
    editor.points = editor.points.edit(1, locked=True).edit(2, radius=31.5)
    editor.stages = 4
    page = open_page(editor)
    page.wait(f"document.querySelector('.dnb-editor') && !{EDITOR}.frames.request")
    (step,) = from_json(page.js(f"JSON.stringify({MODELS}.document())")).steps
    assert step.points == editor.points
    assert (step.stages, page.js(f"{EDITOR}.map.fit.stages.length")) == (4, 4)


@pytest.mark.nightly
def test_a_cut_opens_without_a_kernel(browser: Any, tmp_path: Path) -> None:
    editor, view = pair()
    low, high = (f(PLANE.to_plane(GRID.corners())[:, :2], axis=0) for f in (np.min, np.max))
    middle = (low + high) / 2
    cut = Cut(Line(((middle[0], high[1] + 5), (middle[0], low[1] - 5))))
    right = np.flatnonzero(editor.points.source[:, 0] > middle[0])
    editor.trend = "translation"
    editor.cuts = [cut]
    view.follow(editor, Deformation((editor.step(),)).field(GRID), output=FINE)
    write_standalone(tmp_path / "page.html", editor, view)
    opened = Opened(browser, tmp_path / "page.html", (1280, 800), "")
    try:
        opened.wait_loaded()
        opened.wait(f"{VIEW}.caster.fields.planar?.cut")
        closed = _lit(opened)
        moved = [
            {"id": int(editor.points.ids[k]), "target": (editor.points.target[k] + [9.0, 0.0]).tolist()} for k in right
        ]
        opened.js(f"""{{ const model = {MODELS}.editor, moved = {json.dumps(moved)};
            model.update({{ points: model.get("points").map((p) => ({{ ...p,
              ...moved.find((m) => m.id === p.id) }})) }}); }}""")
        opened.wait(f"{VIEW}.shownField.link.count > 1")
        opened.wait_settled()
        gap = _lit(opened)
        columns = np.flatnonzero(gap.any(axis=0))
        dark = ~gap[:, columns[0] : columns[-1]].any(axis=0)
        assert dark.sum() > 5  # from top to bottom, which no map without cuts can do
        whole = closed.any(axis=0)
        assert whole[whole.argmax() : len(whole) - whole[::-1].argmax()].all()
        assert opened.errors == []
    finally:
        opened.context.close()


@pytest.mark.nightly
def test_a_cut_that_stops_inside_is_in_the_page_as_the_core_has_warped_it(browser: Any, tmp_path: Path) -> None:
    editor, view = pair()
    plain = view.still((640, 480))
    low, high = (f(PLANE.to_plane(GRID.corners())[:, :2], axis=0) for f in (np.min, np.max))
    a, b = low + (high - low) * np.array([0.35, 0.5])
    reach = 0.25 * (high - low)[1]
    points = editor.points
    for side in (-1.0, 1.0):
        points = points.add([a + side, b], [a + 2.2 * side, b])
    editor.points, editor.cuts = points, [Cut(Line(((a, b - reach), (a, b + reach)), stops=(True, True)))]
    view.follow(editor, Deformation((editor.step(),)).field(GRID), output=FINE)
    write_standalone(tmp_path / "page.html", editor, view)
    opened = Opened(browser, tmp_path / "page.html", (1280, 800), "")
    try:
        opened.wait_loaded()
        opened.wait(f"{VIEW}.caster.fields.planar?.cut")
        image = opened.volume()
        size = (image.shape[1], image.shape[0])
        wanted, closed = (silhouette(still) for still in (view.still(size), np.asarray(plain)))
        assert dice(silhouette(image), wanted) > 0.965
        if closed.shape != wanted.shape:
            closed = np.asarray(Image.fromarray(closed).resize(size, Image.Resampling.NEAREST))
        assert dice(closed, wanted) < 0.95
        assert opened.errors == []
    finally:
        opened.context.close()


def _lit(open_page: Opened) -> NDArray[np.bool_]:
    data = open_page.js(
        f"{{ {VIEW}.loop.drawNow(2); return {VIEW}.elements.canvas.toDataURL('image/png').split(',')[1]; }}"
    )
    image = np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))
    return np.asarray(image.max(axis=2) > 64)


@pytest.mark.nightly
def test_the_page_that_a_studio_writes_shows_its_result_in_its_box(browser: Any, tmp_path: Path) -> None:
    """Matter dragged out of the volume, seen whole because the result has a larger box; the page's own drags too."""
    studio = Studio(bar_with_a_ball(), side="+y", transfer="surface")
    page = None
    try:
        centre = studio.session.editing.points.source.mean(axis=0)
        studio.session.editing.edit_points(studio.session.editing.points.add(centre, centre + np.array([30.0, 0.0])))
        cut_off = studio.session.results.exceeded_sides()
        assert len(cut_off) == 1
        assert studio.session.results.fit_output()
        studio.view.background = "dark"
        studio.view.set_camera(PLANE.normal, [-c for c in PLANE.v])
        shares: list[float] = []
        path = tmp_path / "studio.html"
        studio.export_html(path, title="In its box", progress=shares.append)
        assert shares == sorted(shares)
        assert (shares[0] < 0.1, shares[-1]) == (True, 1.0)
        page = Opened(browser, path, (940, 560), "")
        page.wait_loaded()
        assert page.page.title() == "In its box"
        start = page.volume()
        size = (start.shape[1], start.shape[0])
        whole = silhouette(studio.view.still(size))
        studio.view.show_deformation(studio.session.results.field())  # in the volume's own box
        assert dice(silhouette(start), whole) > 0.95
        assert dice(silhouette(start), silhouette(studio.view.still(size))) < 0.9
        page.drag(studio.session.editing.points.target[4], (0, 30))
        assert (page.points().target[4] - studio.session.editing.points.target[4])[1] > 1
        assert middle_moved(start, page.volume())[1] > 1
        assert page.errors == []
    finally:
        if page is not None:
            page.context.close()
        studio.close()


def middle_moved(before: NDArray[Any], after: NDArray[Any]) -> NDArray[np.float64]:
    """Displacement of the bright pixels, to the right and down."""
    return middle(after) - middle(before)

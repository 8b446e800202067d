"""Editor and view in JupyterLab, Notebook 7 and Voila: a real mouse, the pixels that are seen, and what a kernel keeps.

A label in the page says what the kernel knows, so that the same tests hold for Voila, where no code can be run.
"""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from browser.hosts import Host, Lab, Notebook, Voila, box_at_rest, read_report, start_host, wait_idle
from numpy.typing import NDArray
from PIL import Image

from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Raster
from deformnb.warping.warper import warp_picture

pytestmark = pytest.mark.needs_browser

SETUP = """
import ctypes, gc, json, sys, threading
import numpy as np
from comm import get_comm_manager
from ipywidgets import Label
from deformnb import ControlPoints, Deformation, Grid, Volume
from deformnb.session.pictures import Pictures
from deformnb.widgets import LiveView, Studio
Pictures.subject_box = (-0.5, 59.5, -0.5, 59.5)  # the whole picture is framed
z, y, x = np.indices((60, 40, 60))
ball = (x - 29.5) ** 2 + (y - 19.5) ** 2 + (z - 29.5) ** 2 < 8 ** 2
volume = Volume(np.where(ball, 250, 0).astype(np.uint8), Grid((60, 40, 60)), name="ball")
corners = [[2, 2], [57, 2], [57, 57], [2, 57]]
start = Deformation.from_picture_points(volume.grid, "+y", ControlPoints.from_arrays([*corners, [29.5, 29.5]]))
report = Label().add_class("report")
"""
# The point in the middle of the ball is number 4; an observer that raises when number 0 moves stands for a user's.
SHOW = """
studio = Studio(volume, start, side="+y", transfer="surface", height=600)
studio.editor.density = 0
studio.view.background = "dark"
studio.view.set_camera((0, 1, 0), zoom=0.35)
edits = -1
def tell(change=None):
    global edits
    points, edits = studio.deformation.steps[0].points, edits + 1
    report.value = json.dumps({"targets": points.target.tolist(), "edits": edits})
    if points.target[0].tolist() != corners[0]:
        raise ValueError("no such corner")
studio.observe(tell, "deformation")
tell()
studio
"""
# A second view, which looks as the page does.
PLAIN = 'LiveView(volume, width=120, height=90).add_class("plain")'
EDITOR = "document.querySelector('.dnb-editor')?.deformnb?.parts"
VIEW = "document.querySelector('.dnb-view')?.deformnb"


# All WebGL contexts of a page, also those whose canvas has gone.
CONTEXTS = """
window.contexts = [];
const plain = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...options) {
  const context = plain.call(this, kind, ...options);
  if (context && kind.startsWith("webgl") && !contexts.includes(context)) contexts.push(context);
  return context;
};
"""
# What lies over the two pictures.
OVERLAYS = ".dnb-ed-svg, .dnb-view > :not(canvas), .dnb-studio-start, .dnb-studio-messages { opacity: 0 !important }"


class Shown:
    """The cells above in a page of a host."""

    def __init__(self, host: Any, browser: Any) -> None:
        self.host, self.page = host, browser.new_page(viewport={"width": 1200, "height": 1000})
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.add_init_script(CONTEXTS)
        host.open_notebook(self.page, [SETUP, SHOW, "report", PLAIN])
        self.ready()

    def ready(self) -> None:
        """Until picture and volume are drawn, and nothing moves any more."""
        self.page.wait_for_selector(".report", timeout=60_000)
        self.page.wait_for_function(
            f"{EDITOR}.picture.painter.source && {VIEW}.caster?.isReady && {VIEW}.caster.fields.planar", timeout=60_000
        )
        self.page.locator(".dnb-editor").first.scroll_into_view_if_needed()
        box_at_rest(self.page.locator(".dnb-view").first)

    def read(self, reached: Callable[[dict[str, Any]], bool] = lambda state: True) -> dict[str, Any]:
        """State of the kernel, once it is as wanted, or after a minute."""
        state: dict[str, Any] = read_report(self.page, reached)
        return state

    def handle(self, point: int) -> tuple[float, float]:
        """Place of a point on the screen."""
        box = self.page.locator(f".dnb-editor [data-id='{point}'] .dnb-ed-disc").bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def restore(self) -> None:
        """Puts the points back to where the cells had them."""
        for point, home in ((0, (2.0, 2.0)), (4, (29.5, 29.5))):
            x, y = (home - np.array(self.read()["targets"][point])) * self.scale
            if abs(x) + abs(y) > 0.1:
                edits = self.read()["edits"]
                self.drag(point, (x, y))
                self.read(lambda state, edits=edits: state["edits"] > edits)

    def drag(self, point: int, by: tuple[float, float], steps: int = 8) -> None:
        """With the real mouse."""
        self.page.locator(".dnb-editor").scroll_into_view_if_needed()  # a bar of the host may lie over it
        x, y = self.handle(point)
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x + by[0], y + by[1], steps=steps)
        self.page.mouse.up()

    @property
    def scale(self) -> float:
        """CSS pixels of a millimetre on the picture."""
        return float(self.page.evaluate(f"() => {EDITOR}.viewport.view.k"))

    def pixels(self, part: str) -> NDArray[np.uint8]:
        """Screenshot of an element."""
        self.page.mouse.move(5, 5)
        wait_idle(self.host, self.page)
        png = self.page.locator(part).first.screenshot(animations="disabled", style=OVERLAYS)
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))[16:-16, 16:-16]  # the box has round corners

    def middles(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Middle (x, y) of the ball, in CSS pixels, on the picture and in the volume."""
        # The frame of the picture is grey, and in the volume the ball has a side in the shade.
        return ball_on(self.pixels(".dnb-ed-stage"), 190), ball_on(self.pixels(".dnb-view canvas"), 110)


def ball_on(image: NDArray[np.uint8], level: int) -> NDArray[np.float64]:
    bright = image.min(axis=2) > level
    assert bright.any()
    return np.argwhere(bright).mean(axis=0)[::-1]


def shift_by_the_core(x: float, y: float) -> NDArray[np.float64]:
    """Displacement of the middle of the ball on the picture when its point is dragged by this, all in millimetres."""
    v, u = np.indices((60, 60))
    disc = np.where((u - 29.5) ** 2 + (v - 29.5) ** 2 < 8**2, 250, 0).astype(np.uint8)
    points = ControlPoints.from_arrays([[2, 2], [57, 2], [57, 57], [2, 57], [29.5, 29.5]])
    raster = Raster((60, 60), (1.0, 1.0), (0.0, 0.0))
    after = warp_picture(disc, raster, fit_rbf(points.move(4, [29.5 + x, 29.5 + y])))
    return np.argwhere(after > 190).mean(axis=0)[::-1] - 29.5


@pytest.fixture(
    scope="module",
    ids=lambda host: host.__name__,
    params=[Lab, pytest.param(Notebook, marks=pytest.mark.nightly), pytest.param(Voila, marks=pytest.mark.nightly)],
)
def shared_page(
    request: pytest.FixtureRequest, browser: Any, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Shown]:
    host: type[Host] = request.param
    if host is Lab:
        page = Shown(request.getfixturevalue("lab"), browser)
        yield page
        page.page.close()
        return
    options = ["--theme=dark"] if host is Voila else []
    with start_host(host, tmp_path_factory.mktemp(host.__name__.lower()), *options) as server:
        page = Shown(server, browser)
        yield page
        page.page.close()


@pytest.fixture
def studio_page(shared_page: Shown) -> Iterator[Shown]:
    """The one page of the host, as its cells have made it."""
    yield shared_page
    shared_page.restore()


def test_a_drag_moves_picture_and_volume_alike(studio_page: Shown) -> None:
    picture, volume = studio_page.middles()
    k, edits = studio_page.scale, studio_page.read()["edits"]
    studio_page.drag(4, (52, -34))
    state = studio_page.read(lambda state: state["edits"] == edits + 1)
    assert state["targets"][4] == pytest.approx([29.5 + 52 / k, 29.5 - 34 / k], abs=0.02)
    picture_after, volume_after = studio_page.middles()
    assert picture_after - picture == pytest.approx(k * shift_by_the_core(52 / k, -34 / k), abs=3)
    moved = volume_after - volume  # in the view's own scale, but the same way
    assert moved[0] > 20
    assert moved[0] / moved[1] == pytest.approx(-52 / 34, rel=0.15)
    studio_page.drag(4, (-52, 34))
    assert studio_page.read(lambda state: state["edits"] == edits + 2)["targets"][4] == pytest.approx(
        [29.5, 29.5], abs=0.02
    )
    for before, after in zip((picture, volume), studio_page.middles(), strict=True):
        assert after == pytest.approx(before, abs=2)


def _skip_twin(studio_page: Shown) -> None:
    if isinstance(studio_page.host, Notebook):
        pytest.skip("Notebook 7 is made of the same parts as JupyterLab")


def test_rapid_drags_end_in_the_last(studio_page: Shown) -> None:
    _skip_twin(studio_page)
    picture, volume = studio_page.middles()
    k, edits = studio_page.scale, studio_page.read()["edits"]
    for by in ((30, 0), (0, 30), (-60, 0), (0, -60), (40, 40)):  # in all 10 to the right and 10 down
        studio_page.drag(4, by, steps=2)
    state = studio_page.read(lambda state: state["edits"] == edits + 5)
    assert state["edits"] == edits + 5
    assert state["targets"][4] == pytest.approx([29.5 + 10 / k, 29.5 + 10 / k], abs=0.05)
    picture_after, volume_after = studio_page.middles()
    assert picture_after - picture == pytest.approx(k * shift_by_the_core(10 / k, 10 / k), abs=3)
    assert (volume_after - volume > 3).all()


def test_undo_and_redo_by_keys(studio_page: Shown) -> None:
    picture, volume = studio_page.middles()
    edits = studio_page.read()["edits"]
    studio_page.drag(4, (40, 20))
    dragged = studio_page.read(lambda state: state["edits"] == edits + 1)["targets"][4]
    studio_page.page.keyboard.press("Control+z")
    assert studio_page.read(lambda state: state["edits"] == edits + 2)["targets"][4] == pytest.approx(
        [29.5, 29.5], abs=0.05
    )
    for before, after in zip((picture, volume), studio_page.middles(), strict=True):
        assert after == pytest.approx(before, abs=2)
    studio_page.page.keyboard.press("Control+Shift+z")
    assert studio_page.read(lambda state: state["edits"] == edits + 3)["targets"][4] == dragged
    studio_page.page.keyboard.press("Control+z")
    studio_page.read(lambda state: state["edits"] == edits + 4)


def test_the_exception_of_a_callback_is_seen(studio_page: Shown) -> None:
    edits = studio_page.read()["edits"]
    studio_page.drag(0, (20, 20))
    studio_page.page.wait_for_function("document.querySelector('.dnb-studio').innerText.includes('no such corner')")
    assert studio_page.read(lambda state: state["edits"] == edits + 1)["edits"] == edits + 1
    studio_page.drag(0, (-20, -20))  # and the conversation goes on
    assert studio_page.read(lambda state: state["edits"] == edits + 2)["targets"][0] == pytest.approx([2, 2], abs=0.05)


@pytest.mark.sampled(3)
def test_the_page_can_be_loaded_again(studio_page: Shown) -> None:
    _skip_twin(studio_page)
    edits = studio_page.read()["edits"]
    studio_page.drag(4, (52, 0))
    target = studio_page.read(lambda state: state["edits"] == edits + 1)["targets"][4]
    assert target == pytest.approx([29.5 + 52 / studio_page.scale, 29.5], abs=0.05)
    picture, volume = studio_page.middles()
    studio_page.host.save(studio_page.page)
    studio_page.page.reload(timeout=60_000)
    if isinstance(studio_page.host, Voila):  # a new kernel
        studio_page.ready()
        assert studio_page.read()["targets"][4] == [29.5, 29.5]
        return
    studio_page.host.wait_until_open(studio_page.page)
    studio_page.ready()
    assert studio_page.read()["targets"][4] == target
    for before, after in zip((picture, volume), studio_page.middles(), strict=True):
        assert after == pytest.approx(before, abs=2)
    studio_page.drag(4, (-52, 0))
    assert studio_page.read(lambda state: state["edits"] == edits + 2)["targets"][4] == pytest.approx(
        [29.5, 29.5], abs=0.05
    )


def test_a_view_is_as_dark_as_its_page(studio_page: Shown) -> None:
    for dark in (True,) if isinstance(studio_page.host, Voila) else (True, False):
        if not isinstance(studio_page.host, Voila):  # that one was started in the dark
            studio_page.host.dark(studio_page.page, dark)
        shade = "dark" if dark else "light"
        studio_page.page.wait_for_function(
            f"document.querySelector('.plain .dnb-view').dataset.background === '{shade}'"
        )
        paper = studio_page.page.locator(".dnb-studio").evaluate("(e) => getComputedStyle(e).backgroundColor")
        assert (np.mean([int(part) for part in re.findall(r"\d+", paper)[:3]]) < 110) == dark


# IPython keeps what a cell returned as Out[n]: that is its business, and what is left without it is ours. Memory is
# what is allocated, not what the process has: each thread gets a heap, and malloc returns none of what is free at its
# top.
KEPT = """
studio.wait()  # the first compiles programs for all
get_ipython().run_line_magic("reset", "-f out")
gc.collect()
class Heap(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in ("arena ordblks smblks hblks mapped usmblks fsmblks used fordblks "
                                                     "keepcost").split()]
mallinfo = getattr(ctypes.CDLL(None), "mallinfo2", Heap)  # there is none but in the C library of GNU
mallinfo.restype = Heap
heap = mallinfo()
print(json.dumps({"studios": sum(isinstance(o, Studio) for o in gc.get_objects()), "threads": threading.active_count(),
                  "comms": len(get_comm_manager().comms), "objects": sys.getallocatedblocks(),
                  "megabytes": (heap.used + heap.mapped) / 2**20}))
"""
SEEN = """() => ({ contexts: contexts.filter((c) => !c.isContextLost()).length,
  canvases: document.querySelectorAll("canvas").length, editors: document.querySelectorAll(".dnb-editor").length })"""
AGAIN = """async () => {
  jupyterapp.shell.currentWidget.content.activeCellIndex = 1;
  await jupyterapp.commands.execute("notebook:run-cell");
}"""


@pytest.mark.nightly
def test_twenty_runs_of_the_cell_keep_nothing(studio_page: Shown) -> None:
    if not isinstance(studio_page.host, Lab):
        pytest.skip("Notebook 7 is made of the same parts as JupyterLab, and Voila runs a cell once")
    found = []
    for run in range(23):
        studio_page.page.evaluate(AGAIN)
        if run in (2, 22):  # what is made once for all is there by the third
            studio_page.ready()
            printed = studio_page.host.run(studio_page.page, KEPT)  # IPython says first how much it has thrown away
            found.append((json.loads(printed.splitlines()[-1]), studio_page.page.evaluate(SEEN)))
    (kept_first, seen_first), (kept, seen) = found
    assert seen == seen_first
    assert kept.pop("threads") <= kept_first.pop("threads")  # one may have been made for the first run only
    assert (seen["editors"], seen["contexts"]) == (1, 2)
    assert kept.pop("megabytes") - kept_first.pop("megabytes") < 15  # a studio that stays takes 3
    assert kept.pop("objects") - kept_first.pop("objects") < 50_000  # and 14 000
    assert kept.pop("studios") <= kept_first.pop("studios") + 2  # the last may still be held by a message on its way
    assert kept == kept_first

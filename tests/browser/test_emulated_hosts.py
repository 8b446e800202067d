"""Editor and view where outputs are in frames with a strict policy, and messages are slow and small: a real mouse.

See browser/emulated_notebook.py. What is measured there is in docs/hosts.md, by ``python -m benchmarks hosts``.
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.emulated_notebook import COLAB, VS_CODE, EmulatedNotebook, Rules, emulate, vs_code_theme, wait_in
from browser.hosts import AT_REST, box_at_rest
from browser.test_hosts import OVERLAYS, SETUP, SHOW, ball_on, shift_by_the_core
from numpy.typing import NDArray
from PIL import Image

pytestmark = pytest.mark.needs_browser

EDITOR = "document.querySelector('.dnb-editor')?.deformnb?.parts"
VIEW = "document.querySelector('.dnb-view')?.deformnb"
READY = f"Boolean({EDITOR}?.picture.painter.source && {VIEW}?.caster?.isReady && {VIEW}.caster.fields.planar)"
PLAIN = 'LiveView(volume, width=120, height=90, _dom_classes=("plain",))'
TARGET = "print(json.dumps(studio.deformation.steps[0].points.target[4].tolist()))"


class Outputs:
    """The cells of a studio in an emulated notebook."""

    def __init__(self, notebook: EmulatedNotebook, browser: Any, *cells: str) -> None:
        self.notebook, self.page = notebook, browser.new_page(viewport={"width": 1200, "height": 1000})
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._note)
        notebook.open(self.page)
        notebook.run(self.page, *cells)
        self.frame = notebook.frame(self.page)
        wait_in(self.frame, READY)
        box_at_rest(self.frame.locator(".dnb-editor"))

    def _note(self, message: Any) -> None:
        if message.type == "error":  # what a policy refuses is reported there
            self.errors.append(message.text)

    def rest(self) -> None:
        """Wait until Python has answered, and picture and volume are drawn in full."""
        wait_in(self.frame, "document.querySelector('.dnb-editor').deformnb.sender.isBehind() === false")
        self.notebook.ask(self.page, "")
        wait_in(self.frame, f"({AT_REST})()")

    def middles(self) -> list[NDArray[np.float64]]:
        """Middle (x, y) of the ball, in CSS pixels, on the picture and in the volume."""
        return [self.middle(".dnb-ed-stage", 190), self.middle(".dnb-view canvas", 110)]

    def middle(self, part: str, level: int) -> NDArray[np.float64]:
        png = self.frame.locator(part).first.screenshot(animations="disabled", style=OVERLAYS)
        return ball_on(np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))[16:-16, 16:-16], level)

    def grab(self, by: tuple[float, float]) -> None:
        """Press the point in the middle of the ball, and move it in steps of 16 ms."""
        box = self.frame.locator(".dnb-editor [data-id='4'] .dnb-ed-disc").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        for share in np.linspace(0, 1, 25)[1:]:
            self.page.mouse.move(x + share * by[0], y + share * by[1])
            self.page.wait_for_timeout(16)

    def target(self, reached: Any) -> Any:
        """The place of the point in Python, once it is as wanted, or after a minute."""
        end = time.monotonic() + 60
        while not reached(target := json.loads(self.notebook.ask(self.page, TARGET))) and time.monotonic() < end:
            self.page.wait_for_timeout(50)
        return target


@pytest.fixture(scope="module", params=[VS_CODE, COLAB], ids=["VS Code", "Colab"])
def notebook(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[EmulatedNotebook]:
    rules: Rules = request.param
    with emulate(rules, tmp_path_factory.mktemp("emulated")) as shown:
        yield shown


@pytest.fixture(scope="module")
def outputs(notebook: EmulatedNotebook, browser: Any) -> Iterator[Outputs]:
    shown = Outputs(notebook, browser, SETUP, SHOW, PLAIN)
    yield shown
    shown.page.close()


def test_a_drag_moves_picture_and_volume_while_the_mouse_is_down_and_python_has_it(outputs: Outputs) -> None:
    outputs.rest()
    picture, volume = outputs.middles()
    k = outputs.frame.evaluate(f"{EDITOR}.viewport.view.k")
    outputs.grab((52, -34))
    wait_in(outputs.frame, f"{EDITOR}.points.list[4].target[0] > 30")
    assert outputs.middle(".dnb-ed-stage", 190)[0] - picture[0] > 20
    outputs.page.mouse.up()
    target = outputs.target(lambda target: target[0] > 29.5 + 51 / k)
    assert target == pytest.approx([29.5 + 52 / k, 29.5 - 34 / k], abs=0.05)
    outputs.rest()
    outputs.page.mouse.move(5, 5)
    picture_after, volume_after = outputs.middles()
    assert picture_after - picture == pytest.approx(k * shift_by_the_core(52 / k, -34 / k), abs=3)
    moved = volume_after - volume
    assert moved[0] > 20
    assert moved[0] / moved[1] == pytest.approx(-52 / 34, rel=0.15)
    assert outputs.errors == []
    assert outputs.notebook.refused == []


def test_the_colours_are_those_of_the_host(outputs: Outputs) -> None:
    if outputs.notebook.rules.outputs == "each":
        pytest.skip("Colab names no theme to its frames")
    for kind in ("light", "dark"):
        theme = vs_code_theme(kind)
        given = {"classes": theme.classes, "attributes": theme.attributes, "variables": theme.variables}
        outputs.page.evaluate("(theme) => notebook.setTheme(theme)", given)
        wait_in(outputs.frame, f"document.querySelector('.plain .dnb-view')?.dataset.background === '{kind}'")
        for part in (".dnb-studio", ".dnb-group .widget-label"):
            style = "backgroundColor" if part == ".dnb-studio" else "color"
            colour = outputs.frame.evaluate(f"getComputedStyle(document.querySelector('{part}')).{style}")
            level = np.mean([int(found) for found in re.findall(r"\d+", colour)[:3]])
            assert (level < 110) == ((kind == "dark") == (part == ".dnb-studio")), (kind, part, colour)


SEPARATE = """
from deformnb import project
from deformnb.widgets import Editor
editor = Editor(project(volume, "+y", "mip"), start.steps[0].points, height=300)
editor.density = 0
follower = LiveView(volume, transfer="surface", width=300, height=300, background="dark")
follower.set_camera((0, 1, 0), zoom=0.6)
follower.follow(editor, start.field(volume.grid))
editor
"""


@pytest.mark.nightly
def test_a_view_in_another_frame_follows_by_the_kernel(tmp_path: Path, browser: Any) -> None:
    with emulate(COLAB, tmp_path) as notebook:
        page = browser.new_page(viewport={"width": 1200, "height": 1000})
        notebook.open(page)
        notebook.run(page, SETUP, SEPARATE, "follower")
        editor, view = (notebook.frame(page, number) for number in (0, 1))
        wait_in(editor, f"Boolean({EDITOR}?.picture.painter.source)")
        wait_in(view, f"Boolean({VIEW}?.caster?.isReady)")
        page.wait_for_timeout(500)
        assert (
            editor.evaluate("() => { try { return Boolean(parent.frames[1].document); } catch { return false; } }")
            is False
        )

        def middle() -> NDArray[np.float64]:
            png = view.locator(".dnb-view canvas").first.screenshot(style=OVERLAYS)
            return ball_on(np.asarray(Image.open(io.BytesIO(png)).convert("RGB")), 110)

        before = middle()
        box = editor.locator(".dnb-editor [data-id='4'] .dnb-ed-disc").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 40, y, steps=8)
        page.mouse.up()
        end = time.monotonic() + 30
        while middle()[0] - before[0] < 15 and time.monotonic() < end:
            page.wait_for_timeout(200)
        assert middle()[0] - before[0] > 15
        page.close()


MANY_MAPS = """
import hashlib
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fitting import fit_rbf
from deformnb.widgets.inputs.file_transfer import FileTransfer
step, count = start.steps[0], 40
maps = tuple(fit_rbf(step.points.move(4, [29.5 + k / 8, 29.5])) for k in range(count))
field = Extrusion(step.plane, (0.0, 40.0), maps, np.linspace(0, 1, count), np.eye(count))
transfer, view = FileTransfer(), LiveView(volume, width=300, height=300)
view.show_deformation(field)
content = np.random.default_rng(1).bytes(12_000_000)
print(hashlib.sha256(content).hexdigest())
from ipywidgets import VBox
VBox([transfer, view])
"""


@pytest.mark.nightly
@pytest.mark.parametrize("rules", [VS_CODE, COLAB], ids=["VS Code", "Colab"])
def test_messages_that_are_larger_than_the_host_takes_arrive(rules: Rules, tmp_path: Path, browser: Any) -> None:
    with emulate(rules, tmp_path) as notebook:
        page = browser.new_page()
        notebook.open(page)
        notebook.run(page, SETUP, MANY_MAPS)
        digest = page.evaluate("() => notebook.outputs").split()[-1]
        frame = notebook.frame(page)
        wait_in(frame, f"{VIEW}?.caster?.fields?.planar?.shape[0] === 40")
        assert 2**22 < max(notebook.sizes.values()) < 2**22 + 2**16
        with page.expect_download(timeout=60_000) as download:
            notebook.ask(page, "transfer.download('noise.bin', content)")
        assert hashlib.sha256(Path(download.value.path()).read_bytes()).hexdigest() == digest
        wait_in(frame, "document.body.innerText.includes('Downloaded noise.bin')")
        assert notebook.refused == []
        page.close()

"""An editor on a page without Jupyter, its Python in this process, and a picture to edit."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
from browser.live_page import LivePage
from PIL import Image

from deformnb.imaging.projection import project
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor

PAGE = "document.querySelector('.dnb-editor').deformnb.parts"


class EditorOnPage(LivePage):
    """An editor whose Python is in this process; ``model`` and ``page.view`` are read from here."""

    def __init__(self, browser: Any, editor: Editor, size: tuple[int, int] = (900, 700), *, draws: int = 1) -> None:
        super().__init__(browser, size)
        self.editor = self.widgets["editor"] = editor
        self.held: list[tuple[str, Any]] | None = None
        """The queue of traits' values for the front end, oldest first, while they are held; None sends them at once."""
        editor.send = lambda content, buffers=None: self.outbox.append(("editor", content, list(buffers or [])))
        editor.observe(self._send_trait)
        state = {
            k: pack(v)
            for k, v in editor.get_state().items()
            if not k.startswith("_") and k not in ("layout", "tabbable", "tooltip")
        }
        self.page.evaluate("([n, s]) => { makeModel(n, s); }", ["editor", state])
        for _ in range(draws):
            self.draw("editor")
        self.wait_settled()

    def _send_trait(self, change: Any) -> None:
        if self.editor.trait_metadata(change["name"], "sync") and self._echo != "editor":
            sent = change["name"], pack(self.editor.get_state(change["name"])[change["name"]])
            if self.held is None:
                self._deliver(*sent)
            else:
                self.held.append(sent)

    def _deliver(self, name: str, value: Any) -> None:
        self.page.evaluate("([k, v]) => models.editor.fromPython(k, v)", [name, value])

    def deliver_next(self) -> None:
        """Deliver the oldest held value to the front end, which draws its state then."""
        assert self.held
        self._deliver(*self.held.pop(0))
        self.page.evaluate("() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")

    def wait_settled(self) -> None:
        """Wait until the picture is loaded, and all views of the editor are drawn in full."""
        self.wait(
            f"({PAGE}.picture.painter.source || !{PAGE}.model.get('image').byteLength) && "
            "[...document.querySelectorAll('.dnb-editor')].every(({ deformnb: { frames } }) => "
            "!frames.isMoving && !frames.request)"
        )

    @property
    def points(self) -> ControlPoints:
        """Python's points, after all messages of the front end."""
        self.wait_answered()
        return self.editor.points

    def wait_answered(self) -> None:
        """Wait until Python has received all edits, and the front end its reply."""
        self.wait(f"!{PAGE}.sender.isBehind()")
        self.wait_settled()

    def js(self, expression: str) -> Any:
        return self.page.evaluate(f"() => {expression}")

    def to_screen(self, place: Any) -> tuple[float, float]:
        """CSS pixels of the window at a place of the picture."""
        v, box = self.js(f"({PAGE}.viewport.view)"), self.page.locator(".dnb-ed-stage").first.bounding_box()
        return box["x"] + v["k"] * place[0] + v["x"], box["y"] + v["k"] * place[1] + v["y"]

    def drag(self, place: Any, by: tuple[float, float], *, steps: int = 5) -> None:
        """Drag the object at a place of the picture by pixels of the screen, with the real mouse."""
        x, y = self.to_screen(place)
        mouse = self.page.mouse
        mouse.move(x, y)
        mouse.down()
        mouse.move(x + by[0], y + by[1], steps=steps)
        mouse.up()
        self.wait_settled()

    def canvas(self) -> np.ndarray:
        """The canvas in its own pixels; grid and points are not on it if the grid is off."""
        self.wait_settled()
        self.page.wait_for_function("""() => { const stage = document.querySelector('.dnb-ed-stage');
            const canvas = stage.querySelector('.dnb-ed-canvas'), ratio = Math.min(2, window.devicePixelRatio);
            return Math.abs(canvas.width - ratio * stage.clientWidth) <= 1; }""")  # style sheets may be loaded later
        data = self.js("document.querySelector('.dnb-ed-canvas').toDataURL('image/png').split(',')[1]")
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB")).astype(int)

    def raster(self) -> Raster:
        """The raster of the canvas's pixels on the picture's plane."""
        v = self.js(f"({PAGE}.viewport.view)")
        shape, d = self.canvas().shape[:2], 1 / (v["k"] * v["ratio"])
        return Raster(
            (shape[0], shape[1]), (d, d), ((0.5 / v["ratio"] - v["x"]) / v["k"], (0.5 / v["ratio"] - v["y"]) / v["k"])
        )


def pack(value: Any) -> Any:
    return {"__bytes__": base64.b64encode(bytes(value)).decode()} if isinstance(value, bytes | memoryview) else value


def smooth_picture() -> Picture:
    """Picture, smooth and without symmetry, 60 x 44 pixels that are not square, away from the origin."""
    raster = Raster((44, 60), (2.0, 2.5), (11.0, -30.0))
    at = raster.points()
    a, b = (at[..., 0] - 11) / 120, (at[..., 1] + 30) / 110
    values = 120 + 60 * np.sin(7 * a + 2 * b) * np.cos(5 * b) + 60 * np.exp(-((a - 0.3) ** 2 + (b - 0.7) ** 2) * 90)
    plane = project(Volume(np.zeros((2, 3, 4), np.uint8), Grid((2, 3, 4)))).plane
    return Picture(np.clip(values, 0, 255).astype(np.uint8), plane, raster, "mip", (0.0, 255.0))


def five_points() -> ControlPoints:
    """Points at rest, the last in the middle of the picture."""
    source = np.array([[30.0, -10.0], [110.0, -5.0], [100.0, 60.0], [35.0, 55.0], [70.0, 25.0]])
    return ControlPoints.from_arrays(source, names=["", "top right", "", "", "middle"])

"""A tab of a real browser that shows the application, and what tests ask of it."""

from __future__ import annotations

import base64
import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from running_app import RunningApp

from deformnb.volume import Grid, Volume

PATIENCE = 30_000  # milliseconds, on a busy machine

_FACTS = ".dnb-app-foot"
_DRAWN = """() => {
  const editor = document.querySelector('.dnb-editor')?.deformnb, live = document.querySelector('.dnb-view')?.deformnb;
  return Boolean(editor?.painter.source && live?.caster?.isReady && live.field);
}"""
_VOLUME = """() => {
  const page = document.querySelector('.dnb-view').deformnb;
  page.loop.drawNow(4);
  return page.canvas.toDataURL('image/png').split(',')[1];
}"""
_PICTURE = """() => {
  document.querySelector('.dnb-editor').deformnb.drawNow();
  return document.querySelector('.dnb-ed-canvas').toDataURL('image/png').split(',')[1];
}"""


def cube() -> Volume:
    """A bright cube in a dark box."""
    voxels = np.zeros((28, 24, 32), np.uint8)
    voxels[9:19, 6:18, 11:21] = 255
    return Volume(voxels, Grid(voxels.shape), "cube.nii")


class Tab:
    """A tab of the browser that shows the application; none may complain or ask elsewhere."""

    def __init__(self, browser: Any, app: RunningApp, *, viewer: str = "live", scheme: str = "light",
                 init: str = "", size: tuple[int, int] = (900, 560)) -> None:
        self.app = app  # the window is small, for a processor draws the volume here
        self.context = browser.new_context(viewport={"width": size[0], "height": size[1]}, color_scheme=scheme)
        self.page = self.context.new_page()
        self.errors: list[str] = []
        self.elsewhere: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._heard)
        self.page.on("request", self._asked)
        if init:
            self.page.add_init_script(init)
        self.page.goto(app.server.url)
        if viewer == "live":
            self.drawn()

    def _heard(self, message: Any) -> None:
        if message.type in ("error", "warning") and "GPU stall due to ReadPixels" not in message.text:
            self.errors.append(message.text)

    def _asked(self, request: Any) -> None:
        if not request.url.startswith((f"http://{self.app.name}/", "blob:", "data:")):
            self.elsewhere.append(request.url)

    def drawn(self) -> None:
        """Wait for the picture and the volume."""
        self.page.wait_for_function(_DRAWN, timeout=PATIENCE)

    def says(self, text: str, where: str = _FACTS) -> None:
        """Wait until the page says it."""
        self.page.wait_for_function("([where, text]) => document.querySelector(where)?.innerText.includes(text)",
                                    arg=[where, text], timeout=PATIENCE)

    def _image(self, script: str) -> NDArray[np.float64]:
        from PIL import Image

        data = base64.b64decode(self.page.evaluate(script))
        return np.asarray(Image.open(io.BytesIO(data)).convert("L"), float)

    def volume(self) -> NDArray[np.float64]:
        """What is drawn of the volume."""
        return self._image(_VOLUME)

    def picture(self) -> NDArray[np.float64]:
        """What is drawn of the picture, without its net."""
        return self._image(_PICTURE)

    def point(self, k: int) -> tuple[float, float]:
        """Where a point is in the page."""
        box = self.page.locator(".dnb-ed-target .dnb-ed-disc").nth(k).bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def drag(self, k: int, dx: float, dy: float) -> None:
        """Drag a point with the mouse."""
        x, y = self.point(k)
        mouse = self.page.mouse
        mouse.move(x, y)
        mouse.down()
        mouse.move(x + dx / 2, y + dy / 2, steps=4)
        mouse.move(x + dx, y + dy, steps=4)
        mouse.up()

    def add_in_the_middle(self) -> None:
        box = self.page.locator(".dnb-ed-stage").bounding_box()
        self.page.mouse.dblclick(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        self.says("5 points")
        # Without its net the picture's own pixels can be measured.
        self.page.get_by_label("Net", exact=True).uncheck()
        self.page.wait_for_function("!document.querySelector('.dnb-editor').deformnb.model.get('show_net')")

    def close(self) -> None:
        self.context.close()
        assert self.errors == []
        assert self.elsewhere == []

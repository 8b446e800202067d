"""A tab of a real browser that shows the application, with the queries of tests."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from running_app import RunningApp

from deformnb.app.application import Application
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.view.live_view import LiveView

PATIENCE = 60_000  # milliseconds, on a busy machine

_DRAWN = """() => {
  const editor = document.querySelector('.dnb-editor')?.deformnb, live = document.querySelector('.dnb-view')?.deformnb;
  return Boolean(editor?.parts.picture.painter.source && live?.caster?.isReady && live.field);
}"""
_VOLUME = """() => {
  const page = document.querySelector('.dnb-view').deformnb;
  document.querySelector('.dnb-editor').deformnb.frames.drawNow(); // which says where its points are
  page.loop.drawNow(1);
  return page.elements.canvas.toDataURL('image/png').split(',')[1];
}"""
_PICTURE = """() => {
  document.querySelector('.dnb-editor').deformnb.frames.drawNow();
  return document.querySelector('.dnb-ed-canvas').toDataURL('image/png').split(',')[1];
}"""


def cube() -> Volume:
    """A bright cube in a dark box."""
    voxels = np.zeros((28, 24, 32), np.uint8)
    voxels[9:19, 6:18, 11:21] = 255
    return Volume(voxels, Grid(voxels.shape), "cube.nii")


def app_of_a_cube(folder: Path, **options: Any) -> Application:
    """An application that shows the cube, and saves in this folder."""
    made = Application(cube(), side="+y", folder=folder, **options)
    made.session.pictures.set_trait("transfer", "bone")
    return made


def grey(image: NDArray[Any]) -> NDArray[np.float64]:
    """The grey levels of a picture in colour, as a browser's are here."""
    from PIL import Image

    return np.asarray(Image.fromarray(image).convert("L"), float)


def finer_grid(grid: Grid) -> Grid:
    """The same bounding box, which sets the scale of the view, with voxels a third as long: the edges are sharper."""
    first = grid.index_to_point(np.full(3, -1 / 3))
    return replace(
        grid, shape=tuple(3 * n for n in grid.shape), spacing=tuple(np.asarray(grid.spacing) / 3), origin=tuple(first)
    )


def silhouette(image: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Mask of the cube, on a dark background."""
    found = image > 60
    assert found.sum() > 200
    return found


def dice(a: NDArray[np.bool_], b: NDArray[np.bool_]) -> float:
    """Dice coefficient of two silhouettes of the same size: 1 if they are equal."""
    return float(2 * (a & b).sum() / (a.sum() + b.sum()))


def wait_until(condition: Callable[[], Any]) -> None:
    """Wait until a condition holds."""
    end = time.monotonic() + PATIENCE / 1000
    while not condition():
        assert time.monotonic() < end, "it did not become true"
        time.sleep(0.05)


class Tab:
    """A tab of the browser that shows the application; none may report an error or send requests elsewhere."""

    def __init__(
        self,
        browser: Any,
        app: RunningApp,
        *,
        viewer: str = "live",
        scheme: str = "light",
        init: str = "",
        size: tuple[int, int] = (900, 560),
        **options: Any,
    ) -> None:
        self.app = app  # the window is small, for a processor draws the volume here
        viewport = {"width": size[0], "height": size[1]}
        self.context = browser.new_context(viewport=viewport, color_scheme=scheme, **options)
        self.page = self.context.new_page()
        self.errors: list[str] = []
        self.elsewhere: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", self._collect_error)
        self.page.on("request", self._check_request)
        if init:
            self.page.add_init_script(init)
        self.page.goto(app.server.url)
        if viewer == "live":
            self.wait_drawn()

    def _collect_error(self, message: Any) -> None:
        if message.type in ("error", "warning") and "GPU stall due to ReadPixels" not in message.text:
            self.errors.append(message.text)

    def _check_request(self, request: Any) -> None:
        if not request.url.startswith((f"http://{self.app.name}/", "blob:", "data:")):
            self.elsewhere.append(request.url)

    def wait_drawn(self) -> None:
        """Wait for the picture and the volume."""
        self.page.wait_for_function(_DRAWN, timeout=PATIENCE)

    def wait_for_points(self, points: int, moved: int) -> None:
        """Wait until the session and the front end have so many points, and so many of them moved."""

        def count() -> tuple[int, int]:
            now = self.app.session.editing.points
            return len(now), int(now.displacement.any(axis=1).sum())

        wait_until(lambda: count() == (points, moved))
        self.page.wait_for_function(
            """([count, moved]) => {
          const points = document.querySelector('.dnb-editor')?.deformnb?.parts.points.list ?? [];
          return points.length === count && points.filter(({ source, target }) =>
            Math.hypot(source[0] - target[0], source[1] - target[1]) > 1e-6).length === moved; }""",
            arg=[points, moved],
            timeout=PATIENCE,
        )

    def image(self, script: str) -> NDArray[np.float64]:
        from PIL import Image

        data = base64.b64decode(self.page.evaluate(script))
        return np.asarray(Image.open(io.BytesIO(data)).convert("L"), float)

    def volume(self) -> NDArray[np.float64]:
        """The drawing of the volume."""
        return self.image(_VOLUME)

    @property
    def size(self) -> tuple[int, int]:
        """Size of the full picture of the volume in pixels; a quick one, which the canvas may show, has fewer."""
        return tuple(self.page.evaluate("document.querySelector('.dnb-view').deformnb.caster.size"))

    @property
    def camera(self) -> dict[str, Any]:
        """The view direction of the volume."""
        return dict(self.app.studio.view.camera)

    def core(self) -> NDArray[np.float64]:
        """The expected drawing of the volume: the core's own warp of the session's state, from the same side."""
        session = self.app.session
        view = LiveView(session.volume, transfer=session.pictures.transfer, background="dark")
        view.show_deformation(session.results.field(), output=finer_grid(session.volume.grid))
        view.camera, view.frame = self.camera, self.app.studio.view.frame
        return grey(view.still(self.size))

    def wait_deformed(self, before: NDArray[np.float64]) -> NDArray[np.float64]:
        """Wait until the volume is deformed as by the core and differs from the picture before; returns its picture."""
        self.app.wait_idle()
        wanted = silhouette(self.core())
        assert dice(silhouette(before), wanted) < 0.92  # else a volume that does not change would pass
        end = time.monotonic() + PATIENCE / 1000
        while dice(silhouette(now := self.volume()), wanted) < 0.96:
            assert time.monotonic() < end, "the volume is not as the core deforms it"
        return now

    def picture(self) -> NDArray[np.float64]:
        """The drawing of the picture, without its grid, once nothing moves any more."""
        self.page.wait_for_function("!document.querySelector('.dnb-editor').deformnb.frames.isMoving", timeout=PATIENCE)
        return self.image(_PICTURE)

    def point(self, k: int) -> tuple[float, float]:
        """The place of a point in the front end."""
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
        self.wait_for_points(5, 0)
        self.hide_grid()

    def hide_grid(self) -> None:
        """Hide the grid, so that the picture's own pixels can be measured; there is an edit, so that it is shown."""
        editor = "document.querySelector('.dnb-editor').deformnb"
        self.page.wait_for_function(
            f"!{editor}.parts.layers.grid.isWaiting", timeout=PATIENCE
        )  # else the button shows it
        self.page.locator(".dnb-pane [data-command=grid]").click()
        self.page.wait_for_function(f"!{editor}.model.get('show_grid')", timeout=PATIENCE)

    def close(self) -> None:
        self.context.close()
        assert self.errors == []
        assert self.elsewhere == []

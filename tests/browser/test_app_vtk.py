"""The application where Python draws the volume: pictures follow the hand, and a cube turns them."""

from __future__ import annotations

import base64
import io
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE, Tab, cube, dice, silhouette
from numpy.typing import NDArray
from running_app import RunningApp

from deformnb.session.session import Session

pytestmark = [pytest.mark.needs_browser, pytest.mark.needs_gl]

_BLIND = """const found = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
    return kind === 'webgl2' ? null : found.call(this, kind, ...rest); };"""
_OVER = "document.querySelector('.dnb-app-over')?.deformnb"
_SHOWN = """() => {
  const image = document.querySelector('.dnb-app-remote img'), canvas = document.createElement('canvas');
  if (!image?.naturalWidth) return null;
  Object.assign(canvas, { width: image.naturalWidth, height: image.naturalHeight });
  canvas.getContext('2d').drawImage(image, 0, 0);
  return canvas.toDataURL('image/png').split(',')[1];
}"""


class PictureTab(Tab):
    """A tab that gets pictures."""

    def __init__(self, browser: Any, app: RunningApp, **options: Any) -> None:
        super().__init__(browser, app, viewer="vtk", **options)
        self.page.wait_for_selector(".dnb-ed-target", timeout=PATIENCE)

    def seen(self) -> dict[str, Any]:
        """What Python has said of the newest picture."""
        found: dict[str, Any] = self.page.evaluate(_OVER) or {}
        return found

    def shown(self) -> NDArray[np.float64]:
        """The picture that is seen now, quick or full, as large as the core's."""
        from PIL import Image

        data = self.page.evaluate(_SHOWN)
        if data is None:
            return np.zeros((200, 300))
        image = Image.open(io.BytesIO(base64.b64decode(data))).convert("L")
        return np.asarray(image.resize(self.size), float)

    @property
    def size(self) -> tuple[int, int]:
        """Of a picture of the core."""
        box = self.page.locator(".dnb-app-remote").bounding_box()
        return round(box["width"]), round(box["height"])

    @property
    def camera(self) -> dict[str, Any]:
        assert self.app.application.volumes.remote is not None
        return self.app.application.volumes.remote.camera

    volume = shown


def eventually(condition: Callable[[], Any]) -> None:
    end = time.monotonic() + 2 * PATIENCE / 1000  # shaders are compiled by a processor
    while not condition():
        assert time.monotonic() < end, "it did not come true"
        time.sleep(0.05)


@pytest.fixture(scope="module")
def app() -> Iterator[RunningApp]:
    with RunningApp(Session(cube(), view="+y", transfer="bone"), viewer="vtk") as running:
        yield running


@pytest.fixture
def tab(browser: Any, app: RunningApp) -> Iterator[PictureTab]:
    def begin() -> None:
        app.application.session.deformation = type(app.application.session.deformation)()
        app.application.set("shows", "deformed")
        app.application.set("show_folds", True)
        app.application.act("front")

    app.application.thread.call(begin).result(30)
    opened = PictureTab(browser, app)
    yield opened
    opened.close()


def middle(image: NDArray[np.float64]) -> float:
    """Column of the middle of the cube, as a share of the width."""
    return float(np.nonzero(silhouette(image))[1].mean()) / image.shape[1]


def rest(tab: PictureTab) -> NDArray[np.float64]:
    """The full picture of what the session says, compared with the core's."""
    tab.app.settled()
    wanted = silhouette(tab.core())
    eventually(lambda: tab.seen().get("full") and (tab.shown() > 60).sum() > 200
               and dice(silhouette(tab.shown()), wanted) > 0.955)
    return tab.shown()


def test_pictures_follow_while_the_mouse_is_down_and_undo_brings_them_back(tab: PictureTab) -> None:
    tab.add_in_the_middle()
    before = rest(tab)
    x, y = tab.point(4)
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    places = [middle(before)]
    for k in range(1, 4):
        tab.page.mouse.move(x + 20 * k, y, steps=4)
        eventually(lambda: middle(tab.shown()) > places[-1] + 0.006)  # the hand has not let go
        places.append(middle(tab.shown()))
    assert not tab.app.application.session.points.displacement.any()
    tab.page.mouse.up()
    tab.says("1 moved")
    after = tab.follows(before)
    assert middle(after) > middle(before) + 0.02
    rest(tab)
    tab.page.get_by_role("button", name="Undo: ").click()
    tab.says("0 moved")
    assert abs(middle(rest(tab)) - middle(before)) < 0.004


@pytest.mark.nightly
def test_rapid_drags_end_as_the_last_of_them(tab: PictureTab) -> None:
    tab.add_in_the_middle()
    before = rest(tab)
    x, y = tab.point(4)
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    for k in range(60):
        tab.page.mouse.move(x + 40 * (-1) ** k, y + k / 2)
    tab.page.mouse.move(x + 50, y)
    tab.page.mouse.up()
    tab.says("1 moved")
    assert middle(tab.follows(before)) > middle(before) + 0.02
    rest(tab)


@pytest.mark.nightly
def test_a_hand_on_the_picture_turns_it_and_the_cube_looks_from_a_side(tab: PictureTab) -> None:
    rest(tab)
    first = tab.seen()["camera"]["direction"]
    box = tab.page.locator(".dnb-app-remote").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.page.mouse.move(x, y)
    tab.page.mouse.down()
    tab.page.mouse.move(x + 80, y + 60, steps=4)
    tab.page.mouse.up()
    eventually(lambda: np.dot(tab.seen()["camera"]["direction"], first) < 0.9)
    rest(tab)
    tab.page.locator(".dnb-face[data-view='-x']").dispatch_event("click")
    wanted = tab.app.application.volumes.views["-x"]["direction"]
    eventually(lambda: np.allclose(tab.seen()["camera"]["direction"], wanted))
    rest(tab)
    assert tab.page.locator(".dnb-letter.dnb-top").first.inner_text() == "S"


@pytest.mark.nightly
def test_a_fold_is_red_and_said_over_the_picture(tab: PictureTab) -> None:
    tab.add_in_the_middle()
    low, high = tab.page.evaluate("document.querySelector('.dnb-editor').deformnb.box.slice(0, 2)")
    tab.app.application.thread.call(lambda: tab.app.application.set("support", round(0.4 * (high - low), 1))).result(30)
    tab.drag(4, 90, 20)
    tab.says("folds ")
    badge = tab.page.locator(".dnb-app-over .dnb-badge")
    eventually(lambda: "folds" in badge.inner_text())
    tab.page.get_by_role("tab", name="Diagnostics").click()
    tab.page.get_by_label("Folds in the volume").uncheck()
    eventually(lambda: badge.inner_text() == "")


def test_before_and_after_stand_side_by_side(tab: PictureTab) -> None:
    tab.add_in_the_middle()
    tab.drag(4, 60, 0)
    tab.says("1 moved")
    tab.app.application.thread.call(lambda: tab.app.application.set("shows", "side_by_side")).result(30)
    eventually(lambda: tab.page.locator(".dnb-app-over .dnb-caption:visible").all_inner_texts()
               == ["original", "deformed"])
    eventually(lambda: tab.seen()["full"])

    def apart() -> float:
        both = tab.shown()
        half = both.shape[1] // 2
        return middle(both[:, half : 2 * half]) - middle(both[:, :half])

    eventually(lambda: apart() > 0.02)


@pytest.mark.nightly
def test_a_page_without_webgl2_gets_pictures_by_itself(browser: Any) -> None:
    with RunningApp(Session(cube(), view="+y", transfer="bone")) as app:
        app.application.thread.call(lambda: app.application.act("front")).result(30)
        tab = PictureTab(browser, app, init=_BLIND)
        assert tab.page.locator(".dnb-canvas").count() == 0
        before = rest(tab)
        for k in range(4):
            tab.drag(k, 40, 0)
            tab.says(f"{k + 1} moved")
        assert middle(tab.follows(before)) > middle(before) + 0.02
        tab.close()

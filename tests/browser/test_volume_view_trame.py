"""The volume view's pictures by trame: a frame in the notebook's page, with a way of its own for pictures and mouse."""

from __future__ import annotations

import http.client
import importlib.util
import io
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.foreign_page import blank_pages, request_sockets
from browser.live_page import LivePage
from PIL import Image

from deformnb.document.deformation import Deformation
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.view.volume_view import VolumeView

pytestmark = [
    pytest.mark.needs_browser,
    pytest.mark.needs_gl,
    pytest.mark.skipif(importlib.util.find_spec("trame_rca") is None, reason="trame-rca is not installed"),
]

GRID = Grid((20, 24, 16), (1.5, 1.0, 2.0), (5.0, -7.0, 30.0))


@pytest.fixture(scope="module")
def origin() -> Iterator[str]:
    """A page of this machine, as a notebook's is: browsers let no other look at it in a frame."""
    with blank_pages() as address:
        yield address


class _At:
    """A browser whose pages come from an origin."""

    def __init__(self, browser: Any, origin: str) -> None:
        self._browser, self._origin = browser, origin

    def new_page(self, **options: Any) -> Any:
        page = self._browser.new_page(**options)
        page.goto(f"{self._origin}/")
        return page


@pytest.fixture
def page(browser: Any, origin: str) -> Iterator[LivePage]:
    opened = LivePage(_At(browser, origin))
    yield opened
    for widget in opened.widgets.values():
        widget.close()
    opened.close()


def ball() -> Volume:
    k = np.indices(GRID.shape)[::-1] - np.array([5.0, 8.0, 9.0]).reshape(3, 1, 1, 1)
    return Volume(np.clip(60 * (5.5 - np.sqrt((k**2).sum(axis=0))), 0, 200).astype(np.uint8), GRID, "ball")


def inner(page: LivePage) -> Any:
    return next((frame for frame in page.page.frames if "/index.html" in frame.url), None)


def until(page: LivePage, reached: Any, seconds: float = 90.0) -> None:
    for _ in range(int(seconds / 0.1)):
        page.flush()
        if reached():
            return
        page.page.wait_for_timeout(100)
    raise TimeoutError(f"it did not come; the page said {page.errors}")


def full(page: LivePage, after: int = 0) -> int:
    """The number of the full picture in the frame, later than ``after``."""
    look = "() => { const m = document.querySelector('.dnb-app-over')?.deformnb; return m?.full ? m.n : 0; }"
    number = 0

    def reached() -> bool:
        nonlocal number
        frame = inner(page)
        number = frame.evaluate(look) if frame is not None else 0
        return number > after

    until(page, reached)
    inner(page).evaluate("""async () => { // the area puts the picture on the screen
        for (const _ of [1, 2]) await new Promise(requestAnimationFrame); }""")
    return number


def middle(page: LivePage) -> np.ndarray:
    png = page.page.locator(".dnb-volume").screenshot()
    image = np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)
    rows, columns = np.nonzero(image[..., 0] - image[..., 2] > 40)  # the surface is redder than the rest
    return np.array([columns.mean(), rows.mean()])


def test_pictures_and_the_mouse_go_by_trame(page: LivePage) -> None:
    view = VolumeView(
        ball(), transport="trame", transfer="surface", width=240, height=180, settle_ms=30.0, background="dark"
    )
    view.set_camera((0, 1, 0))
    page.add(view)
    number = full(page)
    before = middle(page)
    away = ControlPoints.from_arrays([[10.0, 10.0]], [[14.0, 13.0]])
    view.show_deformation(Deformation.from_picture_points(GRID, Plane.from_view(GRID, "+y"), away, trend="translation"))
    number = full(page, number)
    until(page, lambda: bool((middle(page) - before > (8, 6)).all()))  # lengths of more than three pixels each
    assert page.page.locator(".dnb-frame:visible, .dnb-compass:visible").count() == 0  # those of the frame are seen
    sent = [content["type"] for content in page.page.evaluate("models.view.sent")]
    assert sent == ["hello"]  # no picture came by the notebook's channel, and none was confirmed there
    mouse = page.page.mouse
    mouse.move(120, 90)
    mouse.down()
    mouse.move(170, 90, steps=4)
    full(page, number)
    mouse.up()
    until(page, lambda: view.camera["direction"][0] > 0.3)
    assert view.stats()["sent"] > 3


def asked(url: str, **headers: str) -> tuple[int, str]:
    """Status and policy of an answer."""
    place = url.removeprefix("http://").partition("/")
    connection = http.client.HTTPConnection(place[0], timeout=30)
    try:
        connection.request("GET", f"/{place[2]}", headers=headers)
        answer = connection.getresponse()
        answer.read()
        return answer.status, answer.getheader("Content-Security-Policy") or ""
    finally:
        connection.close()


def test_only_the_notebooks_origin_may_show_it(page: LivePage, origin: str) -> None:
    view = VolumeView(ball(), transport="trame", width=160, height=120)
    page.add(view)
    until(page, lambda: inner(page) is not None)
    url = inner(page).url.replace("localhost", "127.0.0.1")
    assert f"frame-ancestors {origin}" in asked(url)[1]
    assert asked(url, Origin="http://evil.example")[0] == 403
    assert asked(url, Host="evil.example")[0] == 403
    socket = {
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
        "Sec-WebSocket-Key": "MDEyMzQ1Njc4OWFiY2RlZg==",
    }
    ws = url.partition("/index.html")[0] + "/ws"
    assert asked(ws, **socket)[0] == 403  # no origin: no page of ours
    assert asked(ws, Origin=origin, **socket)[0] == 403  # the notebook's own page speaks to the frame only
    name = url.split("/")[2]
    with blank_pages() as elsewhere:
        assert request_sockets(page.page.context.browser, elsewhere, name) == ["opaque", *["refused"] * 3]
    number = full(page)
    view.set_camera((1, 0, 0))
    full(page, number)  # its own page is still served
    view.close()
    with pytest.raises(ConnectionError):
        asked(url)

"""The volume on its way into a real browser: what the bar says, pieces that get lost or torn, and who asks again."""

from __future__ import annotations

import io
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage
from browser.pane_messages import message_text
from PIL import Image

from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

VIEW = "document.querySelector('.dnb-view').deformnb"
BAR = "document.querySelector('.dnb-progress')"
# Patience is of seconds; here it is of milliseconds.
HASTE = """() => { const later = window.setTimeout;
    window.setTimeout = (call, ms, ...rest) => later(call, ms >= 5000 ? ms / 50 : ms, ...rest); }"""

Way = Callable[[dict[str, Any], list[bytes]], list[bytes] | None]


def volume() -> Volume:
    """Of two pieces."""
    grid = Grid((40, 300, 200))
    return Volume(np.random.default_rng(0).integers(0, 256, grid.shape).astype(np.uint8), grid)


def sent(page: LivePage, way: Way) -> LiveView:
    """A view whose pieces go through ``way``, which gives what arrives of them, or None if nothing does."""
    view = LiveView(width=240, height=180, settle_ms=60000)
    view.show(volume(), window=(0.0, 255.0))
    page.add(view, draw=False)
    send = view.send

    def through(content: Any, buffers: Any = None) -> None:
        arrived = way(content, buffers) if content["type"] == "chunk" else list(buffers or [])
        if arrived is not None:
            send(content, arrived)

    view.send = through
    page.draw()
    return view


def values_differ(page: LivePage, view: LiveView) -> bool:
    shown = view.source.voxels
    assert shown is not None
    got = page.page.evaluate(f"[{VIEW}.values.length, {VIEW}.values.reduce((s, v, i) => (s * 31 + v) % 1000003, 7)]")
    total = 7
    for value in shown.volume.values.ravel().tolist():
        total = (total * 31 + value) % 1000003
    return bool(got != [shown.volume.grid.size, total])


def test_a_lost_and_a_torn_piece_are_asked_for_again(browser: Any) -> None:
    page = LivePage(browser, init=HASTE)
    asked: list[int] = []

    def way(content: dict[str, Any], buffers: list[bytes]) -> list[bytes] | None:
        asked.append(content["index"])
        if asked.count(content["index"]) > 1:
            return buffers
        return None if content["index"] == 0 else [buffers[0][: len(buffers[0]) // 2]]

    view = sent(page, way)
    page.wait_loaded()
    assert min(asked.count(0), asked.count(1)) >= 2  # patience is short here: perhaps more
    assert not values_differ(page, view)
    assert page.page.is_hidden(".dnb-messages-text")
    assert page.page.is_hidden(".dnb-progress")
    assert page.errors == []
    page.close()


def test_the_bar_says_how_far_it_is(browser: Any) -> None:
    page = LivePage(browser)  # with its own patience: nothing is asked for twice
    held: list[tuple[Any, Any]] = []
    view = sent(page, lambda content, buffers: held.append((content, buffers)))
    page.wait(f"{VIEW}.voxels.loader")
    assert page.page.is_visible(".dnb-progress")
    assert page.page.get_attribute(".dnb-progress", "aria-valuenow") == "0"
    page.outbox.append(("view", *held[0]))
    page.wait(f"{BAR}.getAttribute('aria-valuenow') === '40'")  # four fifths of it are the way, the rest is the card
    assert page.page.evaluate(f"getComputedStyle({BAR}).getPropertyValue('--share')") == "0.4"
    page.outbox.append(("view", *held[1]))
    page.wait_loaded()
    assert page.page.is_hidden(".dnb-progress")
    assert not values_differ(page, view)
    page.close()


def test_until_the_volume_comes_the_background_is_the_pages(browser: Any) -> None:
    page = LivePage(browser)
    page.page.emulate_media(color_scheme="light")
    view = sent(page, lambda content, buffers: None)
    view.width = 300
    page.wait(f"{VIEW}.caster.size[0] === 300")
    assert _brightness(page) > 180
    page.page.emulate_media(color_scheme="dark")
    page.wait(f"{VIEW}.elements.root.dataset.background === 'dark'")
    assert _brightness(page) < 60
    page.close()


def _brightness(page: LivePage) -> int:
    """Of a place on the screen that nothing but the background covers."""
    image = Image.open(io.BytesIO(page.page.locator(".dnb-canvas").screenshot())).convert("L")
    return int(np.asarray(image)[image.height // 3, image.width // 2])


def test_where_nothing_comes_the_page_says_so_and_can_be_asked_to_try_again(browser: Any) -> None:
    page = LivePage(browser, init=HASTE)
    is_open: list[bool] = []
    view = sent(page, lambda content, buffers: buffers if is_open else None)
    page.wait("document.querySelector('.dnb-messages-action')")
    assert "Is the kernel running?" in message_text(page.page)
    assert page.page.is_visible(".dnb-progress")
    is_open.append(True)
    page.page.focus(".dnb-messages-action")
    page.page.keyboard.press("Enter")
    page.wait_loaded()
    assert page.page.is_hidden(".dnb-messages-text")
    assert not values_differ(page, view)
    assert page.errors == []
    page.close()


def test_a_displacement_that_was_lost_is_asked_for_when_the_volume_is_there(browser: Any) -> None:
    page = LivePage(browser)
    view = LiveView(volume(), width=240, height=180, settle_ms=60000)
    page.add(view, draw=False)
    send, lost = view.send, []

    def through(content: Any, buffers: Any = None) -> None:
        if content["type"] == "field" and not lost:
            lost.append(content)
        else:
            send(content, buffers)

    view.send = through
    page.draw()
    page.wait_loaded()
    assert len(lost) == 1
    page.close()

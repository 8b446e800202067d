"""Pages of studios in frames of another page: each opens when it is seen, and is dragged there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from deformnb.datasets import PHANTOMS
from deformnb.widgets.studio.studio import Studio

pytestmark = pytest.mark.needs_browser

SITE = "http://pages.test"
BESIDE = f"{SITE}/carp.html"
OPENED = "() => Boolean(document.body.deformnb) && !document.querySelector('.dnb-page-still')"
STATE = "() => document.body.deformnb ? 'opened' : 'closed'"
COUNT = "() => document.body.deformnb.editor.get('points').length"


def wait_for(frame: Any, condition: str, timeout: float = 30.0) -> None:
    """Until a condition holds in a frame; its policy forbids the eval that Playwright's own waiting needs."""
    for _ in range(int(timeout / 0.05)):
        if frame.evaluate(condition):
            return
        frame.page.wait_for_timeout(50)
    raise TimeoutError(f"{condition} did not come true")


def test_frames_open_when_they_are_seen_and_are_dragged(browser: Any, tmp_path: Path) -> None:
    studio = Studio(PHANTOMS["fish"].make((16, 32, 16)), side="-x")
    inline, beside = studio.embed(), studio.embed(tmp_path / "carp.html", overwrite=True)
    studio.close()
    space = '<div style="height: 5000px"></div>'
    host = f"<!doctype html>{space}{inline.markup()}{space}{beside.markup().replace(tmp_path.as_posix(), SITE)}"
    context = browser.new_context(viewport={"width": 1000, "height": 800})
    try:
        page = context.new_page()
        requests: list[str] = []
        errors: list[str] = []
        page.on("request", lambda request: requests.append(request.url))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.route(f"{SITE}/", lambda route: route.fulfill(body=host, content_type="text/html"))
        page.route(BESIDE, lambda route: route.fulfill(body=beside.page, content_type="text/html"))
        page.goto(f"{SITE}/")
        frames = page.locator("iframe")
        assert frames.nth(0).element_handle().content_frame().evaluate(STATE) == "closed"
        assert BESIDE not in requests
        for number in range(frames.count()):
            frames.nth(number).scroll_into_view_if_needed()
            frame = frames.nth(number).element_handle().content_frame()
            wait_for(frame, OPENED)
            before = frame.evaluate(COUNT)
            frame.locator(".dnb-ed-stage").dblclick()
            wait_for(frame, f"{COUNT} === {before + 1}")
        assert BESIDE in requests
        assert errors == []
    finally:
        context.close()

"""The first picture of the README: a studio of the phantom of a carp on Thompson's grid, in a real browser.

From the root of the repository, with the packages of ``sh run setup dev``::

    python docs/studio_picture.py

It writes ``docs/studio.jpg``. NOTICE says of every picture of the documentation what it shows.
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from browser.app_tab import Tab, wait_until  # noqa: E402
from browser.live_page import ARGUMENTS  # noqa: E402
from browser.studio_layout import choose  # noqa: E402
from running_app import RunningApp  # noqa: E402
from scripts import chromium  # noqa: E402

from deformnb.app.application import Application  # noqa: E402
from deformnb.datasets import PHANTOMS  # noqa: E402

SHAPE = (256, 512, 256)
SIZE = (1280, 800)  # of the window, in pixels
NODES = 56  # of Thompson's grid of Antigonia
REST = (SIZE[0] // 2, SIZE[1] - 1)  # of the pointer, over no button
DEFORMED = 0.1  # share of the pixels of the volume that differ when it is deformed


def main() -> None:
    """Open the application, apply the grid, and take the picture when both panes show it."""
    volume = PHANTOMS["fish"].make(SHAPE)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as p:
        browser = p.chromium.launch(executable_path=chromium(), headless=True, args=ARGUMENTS)
        try:
            with RunningApp(Application(volume, side="-x", folder=folder)) as app:
                tab = Tab(browser, app, size=SIZE)
                before = tab.volume()
                choose(tab.page, "Thompson's grids and your own")
                tab.page.get_by_role("button", name="Apply grid").click()
                wait_until(lambda: len(app.session.editing.points) == NODES)
                app.wait_idle()
                wait_until(lambda: (tab.volume() != before).mean() > DEFORMED)
                tab.page.locator(".dnb-pane [data-command=fit]").first.click()
                tab.page.mouse.move(*REST)
                tab.picture()  # when nothing moves any more
                tab.volume()  # at its full resolution
                picture = Image.open(io.BytesIO(tab.page.screenshot())).convert("RGB")
                tab.close()
        finally:
            browser.close()
    picture.save(ROOT / "docs" / "studio.jpg", quality=85, optimize=True, progressive=True)


if __name__ == "__main__":
    main()

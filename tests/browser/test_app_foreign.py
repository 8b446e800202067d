"""The application while another tab of the same browser shows a page of another site that asks for its sockets."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from browser.app_tab import PATIENCE, Tab
from browser.foreign_page import blank_pages, request_sockets
from running_app import RunningApp, terminal_command

pytestmark = pytest.mark.needs_browser

# What the page may learn: that somebody answers, and nothing of what.
_REFUSED = ["opaque", "refused", "refused", "refused"]


def test_a_foreign_page_takes_no_place_from_the_user(browser: Any, app: RunningApp) -> None:
    with blank_pages() as origin:
        assert request_sockets(browser, origin, app.name) == _REFUSED
        assert request_sockets(browser, origin, app.name.replace("127.0.0.1", "localhost")) == _REFUSED
        tab = Tab(browser, app)
        before = tab.volume()
        assert request_sockets(browser, origin, app.name) == _REFUSED
        tab.add_in_the_middle()
        tab.drag(4, 60, -30)
        tab.wait_for_points(5, 1)
        tab.wait_deformed(before)
        tab.close()
    app.application.thread.call(app.session.editing.reset).result(30)


@pytest.mark.nightly
@pytest.mark.skipif(os.name != "posix", reason="signals of another kind")
def test_the_command_ends_at_once_although_a_foreign_page_was_there(browser: Any, tmp_path: Path) -> None:
    command = terminal_command([sys.executable, "-m", "deformnb", "app", "--no-browser"])
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=tmp_path)
    page = browser.new_page()
    try:
        assert process.stdout is not None
        url = process.stdout.readline().strip()
        with blank_pages() as origin:
            assert request_sockets(browser, origin, url.split("/")[2]) == _REFUSED
            page.goto(url)
            page.locator(".dnb-ed-target").first.wait_for(timeout=2 * PATIENCE)  # its own user is let in
            assert request_sockets(browser, origin, url.split("/")[2]) == _REFUSED
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=40.0)
        assert process.returncode == 0
    finally:
        process.kill()
        process.wait(30)
        page.close()

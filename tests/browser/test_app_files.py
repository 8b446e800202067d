"""The application's files in a real browser: what is exported reaches the downloads, what was saved is opened again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE, Tab, cube
from running_app import RunningApp

from deformnb.io import read_volume
from deformnb.session.session import Session

pytestmark = pytest.mark.needs_browser


@pytest.fixture
def tab(browser: Any) -> Iterator[Tab]:
    with RunningApp(Session(cube(), view="+y", transfer="bone")) as app:
        opened = Tab(browser, app)
        yield opened
        opened.close()


@pytest.mark.nightly
def test_the_deformed_volume_goes_to_the_downloads_of_the_page_that_asked(tab: Tab, browser: Any, tmp_path: Path
                                                                          ) -> None:
    other, downloads = Tab(browser, tab.app), []
    other.page.on("download", lambda download: downloads.append(download.url))
    tab.add_in_the_middle()
    tab.drag(4, 40, 0)
    tab.says("1 moved")
    tab.page.get_by_role("button", name="Export").click()
    with tab.page.expect_download(timeout=PATIENCE) as waiting:
        tab.page.get_by_text("Deformed volume (.nii.gz)").click()
    assert waiting.value.suggested_filename == "cube_deformed.nii.gz"
    path = tmp_path / "cube.nii.gz"
    waiting.value.save_as(path)
    session = tab.app.application.session
    np.testing.assert_array_equal(read_volume(path).values, session.result().values)
    assert (read_volume(path).values != session.volume.values).any()
    said = ".dnb-app-file"
    for page in (tab, other):
        page.says("goes to the downloads", said)
    tab.page.get_by_role("button", name="Close").click()
    tab.page.locator(said).wait_for(state="detached")
    assert downloads == []
    other.close()


def test_a_saved_session_is_opened_again(tab: Tab, tmp_path: Path) -> None:
    tab.add_in_the_middle()
    tab.drag(4, 40, 0)
    tab.says("1 moved")
    with tab.page.expect_download() as waiting:
        tab.page.get_by_role("button", name="Save").click()
    path, before = tmp_path / "session.json", tab.app.application.session.points
    waiting.value.save_as(path)
    tab.page.get_by_role("button", name="Undeformed again").click()
    tab.says("0 moved")
    for _ in range(2):  # the same file can be chosen again
        with tab.page.expect_file_chooser() as choosing:
            tab.page.get_by_role("button", name="Open a session file").click()
        choosing.value.set_files(path)
        tab.says("5 points, 1 moved")
        assert tab.app.application.session.points == before
        tab.page.get_by_role("button", name="Undo: ").click()
        tab.says("0 moved")
    long = tmp_path / "long.json"
    long.write_text(" " * 600_000)
    with tab.page.expect_file_chooser() as choosing:
        tab.page.get_by_role("button", name="Open a session file").click()
    choosing.value.set_files(long)
    tab.says("too long", ".dnb-app-error")
    tab.app.settled()
    assert not tab.app.application.session.points.displacement.any()

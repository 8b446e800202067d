"""Fixtures of the browser tests: one Chromium for each module, a fresh page for each test, and JupyterLab."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from browser.app_tab import app_of_a_cube
from browser.editor_page import EditorOnPage, five_points, smooth_picture
from browser.hosts import Lab, start_host
from browser.live_page import ARGUMENTS, LivePage
from browser_start import why_no_browser
from running_app import RunningApp
from scripts import chromium

from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningApp]:
    """An application that shows a cube."""
    with RunningApp(app_of_a_cube(tmp_path_factory.mktemp("app"))) as serving:
        yield serving


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    if why_no_browser():  # requested by a test without the marker
        pytest.skip(why_no_browser())
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        started = p.chromium.launch(executable_path=chromium(), headless=True, args=ARGUMENTS)
        yield started
        started.close()


@pytest.fixture
def page(browser: Any) -> Iterator[LivePage]:
    """A page with models whose messages go to real widgets in this process."""
    opened = LivePage(browser)
    yield opened
    opened.close()


@pytest.fixture
def tab(browser: Any) -> Iterator[Any]:
    """A plain page of the browser, for a separate server."""
    opened = browser.new_page(viewport={"width": 1280, "height": 800})
    yield opened
    opened.close()


@pytest.fixture(scope="session")
def lab_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    """JupyterLab on this machine, started once: it takes longer to start than most tests."""
    with start_host(Lab, tmp_path_factory.mktemp("lab")) as server:
        yield server


@pytest.fixture(scope="module")
def lab(lab_server: Lab, request: pytest.FixtureRequest) -> Iterator[Lab]:
    """JupyterLab with a folder and a workspace for this module, without kernels or files of another."""
    lab_server.place = f"{request.module.__name__.rpartition('.')[2]}/"
    yield lab_server
    lab_server.end_kernels()


@pytest.fixture
def open_editor(browser: Any) -> Iterator[Any]:
    """Function that opens editors, each on a separate page; none of them may report an error."""
    pages: list[EditorOnPage] = []

    def open_page(editor: Editor, **options: Any) -> EditorOnPage:
        pages.append(EditorOnPage(browser, editor, **options))
        return pages[-1]

    yield open_page
    for page in pages:
        assert page.errors == []
        page.close()


@pytest.fixture(scope="module")
def picture() -> Picture:
    return smooth_picture()


@pytest.fixture
def points() -> ControlPoints:
    return five_points()

"""Studio, application, exported page and file page in another language: no English word is left."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from browser.app_tab import Tab
from browser.live_page import LivePage
from browser.test_standalone_page import Opened
from browser.visible_words import (
    COLLECT,
    foreign_words,
    visible_texts,
    walk_editor,
    walk_file_page,
    walk_page,
    walk_studio,
)
from running_app import RunningApp

from deformnb.app.application import Application
from deformnb.datasets import PHANTOMS
from deformnb.io import write_volume
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.file_pages import write_file_page
from deformnb.widgets.studio.studio import Studio
from deformnb.words import word_table

pytestmark = pytest.mark.needs_browser


@pytest.fixture(scope="module")
def carp() -> Volume:
    return PHANTOMS["fish"].make((32, 64, 32))


def _check(page: Any, allowed: Iterable[str]) -> None:
    page.wait_for_timeout(100)
    assert foreign_words(visible_texts(page), word_table("de"), allowed) == []


@pytest.mark.nightly
def test_a_studio_in_german_shows_no_english_word(browser: Any, carp: Volume, tmp_path: Path) -> None:
    write_volume(carp, tmp_path / "other.nii.gz")
    with RunningApp(Application(carp, side="-x", folder=tmp_path, language="de")) as app:
        tab = Tab(browser, app, size=(1280, 800))
        tab.page.evaluate(COLLECT)
        assert tab.page.locator("body").get_attribute("lang") == "de"
        walk_editor(tab.page)
        walk_studio(tab.page)
        _check(tab.page, ["other.nii.gz"])
        tab.close()


@pytest.mark.nightly
def test_an_exported_page_in_german_shows_no_english_word(browser: Any, carp: Volume, tmp_path: Path) -> None:
    studio = Studio(carp, side="-x", language="de")
    studio.export_html(tmp_path / "page.html", title="A carp", about="Drag it.")
    studio.close()
    opened = Opened(browser, tmp_path / "page.html", (1100, 760), f"({COLLECT})()")
    opened.wait_settled()
    assert opened.page.locator("html").get_attribute("lang") == "de"
    assert opened.page.locator("h1").inner_text() == "A carp"
    walk_editor(opened.page)
    walk_page(opened.page)
    _check(opened.page, ["A carp"])
    opened.context.close()


@pytest.mark.nightly
def test_the_page_for_files_in_german_shows_no_english_word(browser: Any, carp: Volume, tmp_path: Path) -> None:
    write_volume(carp, tmp_path / "fish.nii.gz")
    write_file_page(tmp_path / "page.html", language="de")
    opened = Opened(browser, tmp_path / "page.html", (1100, 760), f"({COLLECT})()")
    opened.wait("document.body.opener")
    walk_file_page(opened.page, "fish.nii.gz", base64.b64encode((tmp_path / "fish.nii.gz").read_bytes()).decode())
    opened.wait_settled()
    walk_editor(opened.page)
    walk_page(opened.page)
    _check(opened.page, ["fish"])
    opened.context.close()


def test_an_editor_alone_follows_the_language_and_leaves_names_alone(page: LivePage) -> None:
    points = ControlPoints.from_arrays([[10, 10], [30, 30]], names=["Karl", "corner"])
    page.add(Editor(None, points, language="de", words=word_table("de"), height=300))
    title = "document.querySelector('[data-command=undo]').title"
    page.wait(f"{title}.startsWith('Rückgängig')")
    label, second = (page.page.locator(".dnb-ed-target").nth(k).get_attribute("aria-label") for k in (0, 1))
    assert second.startswith("Punkt 2 Ecke, bei 30, 30")
    assert label.startswith("Punkt 1 Karl, bei 10, 10, nicht gezogen")
    assert page.page.evaluate("document.querySelector('.dnb-editor').parentElement.lang") == "de"

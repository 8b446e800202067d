"""Files that Python hands to the browser's downloads, in a page."""

from __future__ import annotations

import pytest
from browser.live_page import LivePage

from deformnb.widgets.inputs.file_transfer import FileTransfer

pytestmark = pytest.mark.needs_browser


def test_each_widget_of_a_page_hands_over_its_own_file_once(page: LivePage) -> None:
    """As where a notebook has two studios, and one of them is shown twice."""
    widgets = {name: FileTransfer() for name in ("first", "second")}
    for name, widget in widgets.items():
        page.add(widget, name, draw=False)
        page.draw(name)
    page.draw("second")
    page.wait("document.querySelectorAll('.dnb-file-transfer').length === 3")
    saved: list[str] = []
    page.page.on("download", lambda download: saved.append(download.suggested_filename))
    for name, widget in widgets.items():
        with page.page.expect_download() as download:
            widget.download(f"{name}.txt", name.encode())
            page.flush()
        assert download.value.suggested_filename == f"{name}.txt"
    page.wait("document.body.innerText.match(/Downloaded/g).length === 2")
    assert saved == ["first.txt", "second.txt"]

"""Behaviour of Safari, iPhones and browsers that hide pixels, emulated in Chromium: each was a fault once."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE
from browser.live_page import LivePage
from browser.test_file_page import ALERT, FilePage
from PIL import Image

from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.file_pages import write_file_page
from deformnb.widgets.inputs.file_input import FileInput

pytestmark = pytest.mark.needs_browser

# Safari gives no focus to a button that is pressed, but to what can have it around the button.
PRESSES = """() => addEventListener("mousedown", (event) => {
  const button = event.composedPath()[0].closest?.("button");
  if (event.defaultPrevented || !button) return;
  event.preventDefault();
  const taker = button.parentElement?.closest("[tabindex]");
  if (taker) taker.focus({ preventScroll: true });
  else document.activeElement?.blur();
})"""
# An iPhone draws nothing on a canvas of more pixels, and allows full screen for videos alone.
MOST = 2**24
PHONE = f"""{{ const draw = CanvasRenderingContext2D.prototype.drawImage;
  CanvasRenderingContext2D.prototype.drawImage = function (...given) {{
    if (this.canvas.width * this.canvas.height <= {MOST}) draw.apply(this, given); }};
  delete Document.prototype.fullscreenEnabled; delete Element.prototype.requestFullscreen; }}"""


# Firefox that resists fingerprinting, and Tor Browser, give a page stripes in place of the pixels.
STRIPES = """{ const read = CanvasRenderingContext2D.prototype.getImageData;
  CanvasRenderingContext2D.prototype.getImageData = function (...given) {
    const image = read.apply(this, given);
    image.data.forEach((_, k) => { image.data[k] = (37 * k) % 256; });
    return image; }; }"""


@pytest.fixture
def phone(browser: Any, tmp_path: Path) -> Iterator[FilePage]:
    write_file_page(tmp_path / "page.html")
    page = FilePage(browser, tmp_path / "page.html", (390, 844), PHONE, has_touch=True, accept_downloads=True)
    yield page
    page.context.close()
    assert page.errors == []


def test_each_tool_of_the_menu_runs_where_a_press_gives_no_focus(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points), size=(600, 600))
    page.page.evaluate(PRESSES)
    opener, menu = page.page.locator("[data-command=more]"), page.page.get_by_role("menu")
    opener.click()
    opener.click()
    assert menu.is_hidden()
    page.js(f"{PAGE}.points.select([1, 2])")
    page.wait_settled()
    opener.click()
    items = page.page.locator(".dnb-ed-item:not([aria-disabled=true])")
    names = items.evaluate_all("(all) => all.map((item) => item.dataset.command)")[::-1]  # to lock comes last
    assert len(names) > 6
    page.js(f"""{{ window.ran = []; const {{ commands }} = {PAGE}, run = commands.run;
      commands.run = (...given) => {{ ran.push(given[0]); return run.apply(commands, given); }}; }}""")
    menu.press("Escape")
    for name in names:
        page.js(f"{PAGE}.points.select([1, 2])")
        opener.click()
        page.page.locator(f".dnb-ed-item[data-command={name}]").click()
        assert menu.is_hidden()
        page.wait_settled()
    assert [name for name in page.js("ran") if name in names] == names


@pytest.mark.nightly
def test_a_photograph_of_more_pixels_than_a_canvas_holds_is_read(phone: FilePage, tmp_path: Path) -> None:
    colours = np.zeros((4100, 4200, 3), np.uint8)
    colours[:, 2000:2400] = 200, 100, 50  # across the borders of all strips
    assert colours[..., 0].size > MOST
    Image.fromarray(colours).save(tmp_path / "photo.png")
    phone.open(tmp_path / "photo.png")
    saved = Image.open(io.BytesIO(phone.save("Download picture", tmp_path / "after.png").read_bytes())).convert("RGB")
    want = Image.fromarray(colours).reduce(3)
    np.testing.assert_allclose(np.asarray(saved), np.asarray(want)[: saved.height, : saved.width], atol=2)


def test_an_iphone_is_offered_no_whole_screen(phone: FilePage) -> None:
    phone.wait("document.querySelectorAll('.dnb-page-card').length === 3")
    phone.page.locator(".dnb-page-card").first.tap()
    phone.wait_loaded()
    assert phone.page.get_by_role("button", name="Save a picture of the view (PNG)").is_visible()
    assert phone.page.get_by_role("button", name="Full screen").count() == 0


def test_pixels_that_are_hidden_are_named(browser: Any, tmp_path: Path) -> None:
    write_file_page(tmp_path / "page.html")
    page = FilePage(browser, tmp_path / "page.html", (940, 700), STRIPES)
    Image.fromarray(np.zeros((30, 40, 3), np.uint8)).save(tmp_path / "photo.png")
    page.drop(tmp_path / "photo.png")
    page.wait(f"{ALERT}.includes('hides the pixels of pictures')")
    page.context.close()
    assert page.errors == []


def test_the_last_part_of_each_ending_is_accepted_too(page: LivePage) -> None:
    page.add(FileInput(lambda path, progress: None, lambda action: None, accept=".nrrd,.nii.gz,.nii"), "input")
    page.wait("document.querySelector('.dnb-fi-chooser')?.accept")
    assert page.page.locator(".dnb-fi-chooser").get_attribute("accept") == ".nrrd,.nii.gz,.nii,.gz"

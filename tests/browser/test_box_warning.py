"""Tissue dragged out of the box is reported at the end of the drag, on pictures too; in the studio a button helps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.app_tab import Tab, app_of_a_cube, wait_until
from browser.pane_messages import message_script, message_text
from browser.test_file_page import FilePage
from browser.test_standalone_page import EDITOR, MODELS
from numpy.typing import NDArray
from PIL import Image
from running_app import RunningApp

from deformnb.app.application import Application
from deformnb.document.json_regions import region_from_data
from deformnb.io import read_volume
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Mask
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.foreground import LARGER_BOX, cut_off_text, silhouette
from deformnb.widgets.file_pages import write_file_page

pytestmark = pytest.mark.needs_browser

HIGH, WIDE = 150, 240
MIDDLE = (100.0, 75.0)
PAPERS = {"black": (12, 12, 12), "paper": (240, 236, 228)}
INKS = {"black": (200, 120, 60), "paper": (120, 70, 50)}
# Frames from the end of a drag to the warning, counted as the front end draws them.
COUNT_FRAMES = """(() => {
  window.framesToWarning = null;
  window.addEventListener("pointerup", () => {
    const count = (frames) => requestAnimationFrame(() => {
      const text = document.querySelector(".dnb-editor .dnb-messages-text").textContent;
      if (text.startsWith("Tissue leaves")) window.framesToWarning = frames;
      else if (frames < 100) count(frames + 1);
    });
    count(0);
  }, { capture: true, once: true });
})()"""
SOON = 3


def fish(ground: str) -> NDArray[np.uint8]:
    """A photograph of a fish with noise, on that ground."""
    b, a = np.mgrid[:HIGH, :WIDE]
    body = ((a - MIDDLE[0]) / 55) ** 2 + ((b - MIDDLE[1]) / 25) ** 2 < 1
    tail = (a > 140) & (a < 180) & (abs(b - MIDDLE[1]) < (a - 135) / 2)
    noise = np.random.default_rng(0).integers(-8, 9, (HIGH, WIDE, 3))
    image = np.where((body | tail)[..., None], INKS[ground], PAPERS[ground]) + noise
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.fixture
def picture(browser: Any, tmp_path: Path) -> Iterator[FilePage]:
    write_file_page(tmp_path / "page.html")
    page = FilePage(browser, tmp_path / "page.html", (940, 700), "")
    yield page
    page.context.close()
    assert page.errors == []


@pytest.mark.parametrize("ground", list(PAPERS))
def test_a_fish_dragged_out_of_a_picture_is_reported_in_the_next_frames(
    picture: FilePage, tmp_path: Path, ground: str
) -> None:
    path = tmp_path / "fish.png"
    Image.fromarray(fish(ground)).save(path)
    picture.open(path)
    # The tissue of the page is that of the package.
    volume = read_volume(path)
    found = region_from_data(picture.js(f"{MODELS}.editor.get('outline').tissue"))
    wanted = silhouette(volume, Plane.from_view(volume.grid, "+z"))
    assert isinstance(found, Mask)
    assert found.lattice == wanted.lattice
    assert (found.values == wanted.values).mean() > 0.999
    assert 0.1 < wanted.values.mean() < 0.25
    # Dragged out to the left; not yet as long as the button is down.
    picture.js(f"{MODELS}.editor.update({{ stop_at_folds: false }})")
    view, box = picture.js(f"({EDITOR}.viewport.view)"), picture.page.locator(".dnb-ed-stage").bounding_box()
    x, y = box["x"] + view["k"] * MIDDLE[0] + view["x"], box["y"] + view["k"] * MIDDLE[1] + view["y"]
    mouse = picture.page.mouse
    mouse.dblclick(x, y)
    picture.wait(f"{MODELS}.editor.get('points').length === 5")
    assert "leaves" not in message_text(picture.page, ".dnb-editor")
    mouse.move(x, y)
    mouse.down()
    mouse.move(x - 105 * view["k"], y, steps=8)
    picture.wait(f"{EDITOR}.points.list.at(-1).target[0] < 0")
    assert "leaves" not in message_text(picture.page, ".dnb-editor")
    picture.js(COUNT_FRAMES)
    mouse.up()
    picture.wait("window.framesToWarning !== null")
    assert picture.js("window.framesToWarning") <= SOON
    assert message_text(picture.page, ".dnb-editor") == cut_off_text(("left side",))
    assert picture.page.get_by_role("button", name=LARGER_BOX).count() == 0  # the page has one box
    picture.page.keyboard.press("Control+z")
    picture.wait(f"!{message_script('.dnb-editor')}.includes('leaves')")


def a_picture() -> Volume:
    grey = fish("paper").mean(axis=2).astype(np.uint8)[None]
    return Volume(grey, Grid(grey.shape, is_anatomical=False), "fish.png")


def drag_out(tab: Tab, by: float) -> None:
    """Drag the only point of the picture to the side: all goes with it, out of the box, and nothing folds."""
    editing = tab.app.session.editing
    one = ControlPoints.from_arrays([editing.points.source.mean(axis=0)])
    tab.app.application.thread.call(lambda: editing.edit_points(one)).result(30)
    tab.wait_for_points(1, 0)
    tab.page.evaluate(COUNT_FRAMES)
    tab.drag(0, by, 0)


@pytest.mark.parametrize("kind", ["picture", "volume"])
def test_the_studio_reports_it_too_and_a_button_makes_the_box_larger(browser: Any, tmp_path: Path, kind: str) -> None:
    made = Application(a_picture(), side="+z", folder=tmp_path) if kind == "picture" else app_of_a_cube(tmp_path)
    with RunningApp(made) as serving:
        tab = Tab(browser, serving, size=(1280, 720))
        before = serving.session.results.box
        drag_out(tab, -300 if kind == "picture" else 560)
        tab.page.wait_for_function("window.framesToWarning !== null")
        assert tab.page.evaluate("window.framesToWarning") <= SOON
        side = "left side" if kind == "picture" else "left side (L)"
        assert message_text(tab.page, ".dnb-editor") == cut_off_text((side,))
        # What Python finds a moment later is the same.
        tab.page.wait_for_function("document.querySelector('.dnb-editor').deformnb.model.get('cut_off').sides?.length")
        assert serving.session.results.exceeded_sides() == (side,)
        assert message_text(tab.page, ".dnb-editor") == cut_off_text((side,))
        tab.page.locator(".dnb-editor").get_by_role("button", name=LARGER_BOX).click()
        wait_until(lambda: serving.session.results.box != before)
        tab.page.wait_for_function(f"() => !{message_script('.dnb-editor')}.includes('leaves')")
        serving.wait_idle()
        assert serving.session.results.exceeded_sides() == ()
        # The box goes on with the edits, and there is no button where it does not suffice.
        assert not serving.studio.editor.enlarges
        tab.close()

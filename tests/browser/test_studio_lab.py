"""The studio in JupyterLab with a real mouse: a cut is drawn and pulled open, steps are added, switched and moved.

A label in the page says what the kernel knows and what the core makes of it; picture and volume are held against that.
"""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from browser.hosts import Lab, box_at_rest, read_report, wait_idle
from browser.studio_layout import choose
from browser.test_hosts import OVERLAYS
from numpy.typing import NDArray
from PIL import Image

pytestmark = pytest.mark.needs_browser

SETUP = """
import json
import numpy as np
from ipywidgets import Label
from deformnb import Grid, Volume
from deformnb.session.pictures import Pictures
from deformnb.widgets import Studio
Pictures.subject_box = (-0.5, 59.5, -0.5, 59.5)  # the whole picture is framed
z, y, x = np.indices((60, 40, 60))
ball = (x - 29.5) ** 2 + (y - 19.5) ** 2 + (z - 29.5) ** 2 < 12 ** 2
volume = Volume(np.where(ball, 250, 0).astype(np.uint8), Grid((60, 40, 60)), name="ball")
report = Label().add_class("report")
studio = Studio(volume, side="+y", transfer="surface", height=400)
studio.editor.density = 0
studio.view.background = "dark"
def tell(change=None):
    made, steps = studio.result().values, studio.deformation.steps
    report.value = json.dumps({
        "row": (made[29:31].max(axis=(0, 1)) > 125).tolist(),
        "undo": studio.session.editing.history["undo"],
        "u": studio.session.editing.plane.u[0],
        "steps": [{"view": studio.session.steps.view_of(s.plane), "points": len(s.points), "cuts": len(s.cuts),
                   "on": s.enabled, "name": s.name} for s in steps]})
studio.observe(tell, "deformation")
tell()
studio
"""
EDITOR = "document.querySelector('.dnb-editor')?.deformnb?.parts"
VIEW = "document.querySelector('.dnb-view')?.deformnb"
IDLE = "!document.querySelector('.dnb-il-table[aria-busy=true]')"  # a list hears no click before it was answered


class StudioInLab:
    """The cells above in a page of JupyterLab."""

    def __init__(self, host: Any, browser: Any) -> None:
        self.host, self.page = host, browser.new_page(viewport={"width": 1280, "height": 1000})
        self.errors: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        host.open_notebook(self.page, [SETUP, "report"])
        self.page.wait_for_selector(".report", timeout=120_000)
        self.page.wait_for_function(f"{EDITOR}.picture.painter.source && {VIEW}.caster?.isReady", timeout=120_000)
        self.host.run(self.page, "studio.view.set_camera((0, 1, 0), zoom=0.4)")
        self.page.locator(".dnb-studio").scroll_into_view_if_needed()

    def read(self, reached: Callable[[dict[str, Any]], bool] = lambda state: True) -> dict[str, Any]:
        """State of the kernel, once it is as wanted, or after a minute."""
        state: dict[str, Any] = read_report(self.page, reached)
        return state

    def at(self, a: float, b: float) -> tuple[float, float]:
        """Place on the screen of a place of the picture in millimetres."""
        self.page.locator(".dnb-ed-stage").scroll_into_view_if_needed()
        box = box_at_rest(self.page.locator(".dnb-ed-stage"))
        x, y, k = self.page.evaluate(
            f"() => [{EDITOR}.viewport.view.x, {EDITOR}.viewport.view.y, {EDITOR}.viewport.view.k]"
        )
        return box["x"] + x + k * a, box["y"] + y + k * b

    def add(self, a: float, b: float) -> None:
        """A point, by a double-click."""
        count = len(self.points())
        self.page.mouse.dblclick(*self.at(a, b))
        self.page.wait_for_function(f"{EDITOR}.points.list.length === {count + 1}")

    def points(self) -> list[Any]:
        return list(self.page.evaluate(f"() => {EDITOR}.points.list"))

    def drag(self, source: tuple[float, float], target: tuple[float, float]) -> None:
        """With the real mouse."""
        self.page.mouse.move(*self.at(*source))
        self.page.mouse.down()
        self.page.mouse.move(*self.at(*target), steps=8)
        self.page.mouse.up()

    def tab(self, title: str) -> None:
        """Shows a panel."""
        choose(self.page, title)

    def row(self) -> NDArray[np.bool_]:
        """Mask of the ball on the picture, along x through its middle: one value a voxel."""
        image = self.pixels(".dnb-ed-stage")
        x, y, k = self.page.evaluate(
            f"() => [{EDITOR}.viewport.view.x, {EDITOR}.viewport.view.y, {EDITOR}.viewport.view.k]"
        )
        return np.array([image[int(y + k * 29.5), int(x + k * a)].min() > 190 for a in range(60)])

    def pixels(self, part: str) -> NDArray[np.uint8]:
        """Screenshot of an element."""
        self.page.mouse.move(5, 5)
        wait_idle(self.host, self.page)
        png = self.page.locator(part).first.screenshot(animations="disabled", style=OVERLAYS)
        return np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))


def runs(row: Any) -> list[tuple[int, int]]:
    """First and one behind the last of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(row, dtype=int), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a > 1]


@pytest.fixture(scope="module")
def studio_page(browser: Any, lab: Lab) -> Iterator[StudioInLab]:
    opened = StudioInLab(lab, browser)
    yield opened
    opened.page.close()


def test_a_cut_is_drawn_pulled_open_and_undone(studio_page: StudioInLab) -> None:
    page = studio_page.page
    studio_page.tab("Rigid parts and cuts")
    page.get_by_role("button", name="Draw cut").click()
    page.wait_for_function(f"{EDITOR}.tools.pen.isOn")
    page.mouse.click(*studio_page.at(29.5, 52))
    page.mouse.click(*studio_page.at(29.5, 6))
    page.keyboard.press("Enter")
    state = studio_page.read(lambda state: state["steps"][0]["cuts"] == 1)
    assert state["steps"][0]["cuts"] == 1
    assert page.locator(".dnb-studio-panel .dnb-il-choose", has_text="cut").is_visible()
    whole = studio_page.row()
    assert len(runs(whole)) == 1  # a cut that is not pulled open is not seen
    for near, far in ((24.5, 17.5), (34.5, 41.5)):
        studio_page.add(near, 29.5)
        studio_page.drag((near, 29.5), (far, 29.5))
    state = studio_page.read(lambda state: len(runs(state["row"])) == 2 and runs(state["row"])[1][0] > 33)
    (a, b), (c, d) = runs(state["row"])
    assert c - b > 8  # the core's own gap, in voxels
    on_picture = runs(studio_page.row())
    assert np.abs(np.array(on_picture) - [(a, b), (c, d)]).max() <= 1
    volume = studio_page.pixels(".dnb-view canvas")
    bright = volume[volume.shape[0] // 2 - 2 : volume.shape[0] // 2 + 2].max(axis=(0, 2)) > 60
    halves = [run for run in runs(bright) if run[1] - run[0] > 3]
    assert len(halves) == 2
    width = (halves[1][1] - halves[0][0]) / (d - a)  # screen pixels of a voxel
    assert (halves[1][0] - halves[0][1]) / width == pytest.approx(c - b, abs=2)
    studio_page.page.locator(".dnb-ed-stage").focus()
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    state = studio_page.read(lambda state: len(runs(state["row"])) == 1 and state["steps"][0]["points"] == 4)
    assert (state["steps"][0]["points"], state["undo"]) == (4, "add cut")
    assert (studio_page.row() == whole).all()
    page.keyboard.press("Control+z")
    assert studio_page.read(lambda state: state["steps"][0]["cuts"] == 0)["undo"] == ""


@pytest.mark.nightly
def test_steps_from_two_sides_are_switched_and_moved(studio_page: StudioInLab) -> None:
    page = studio_page.page
    studio_page.add(29.5, 29.5)
    studio_page.drag((29.5, 29.5), (40.5, 29.5))
    moved = studio_page.read(lambda state: bool(state["undo"].startswith("move")))["row"]
    ((a, b),) = runs(moved)
    assert (a + b) / 2 > 33
    page.get_by_label("Side", exact=True).select_option(label="from above (-z)")
    state = studio_page.read(lambda state: len(state["steps"]) == 2)
    assert [step["view"] for step in state["steps"]] == ["+y", "-z"]
    page.wait_for_function(f"{EDITOR}.points.list.length === 4 && !{EDITOR}.model.get('waiting')")
    right, left = (40.0, 30.0) if state["u"] > 0 else (19.0, 29.0)  # from above a patient's left is on the other side
    studio_page.add(right, 20.0)
    studio_page.drag((right, 20.0), (left, 20.0))
    state = studio_page.read(lambda state: bool(state["steps"][1]["points"] == 5 and state["undo"].startswith("move")))
    ((a, b),) = runs(state["row"])
    assert (a + b) / 2 < 33  # dragged back
    studio_page.tab("Steps")
    page.locator(".dnb-il-switch:visible").first.click()
    state = studio_page.read(lambda state: not state["steps"][0]["on"])
    ((a, b),) = runs(state["row"])
    assert (a + b) / 2 < 26  # the second alone
    page.wait_for_function(IDLE)
    page.locator("[data-part=down]:visible").first.click()
    state = studio_page.read(lambda state: state["steps"][0]["view"] == "-z")
    assert [(step["view"], step["on"]) for step in state["steps"]] == [("-z", True), ("+y", False)]
    page.wait_for_function(IDLE)
    page.locator("[data-part=rename]:visible").first.click()
    page.keyboard.type("pull back")
    page.keyboard.press("Enter")
    assert studio_page.read(lambda state: state["steps"][0]["name"] != "")["steps"][0]["name"] == "pull back"
    left = [round(page.locator(".dnb-il-switch:visible").nth(k).bounding_box()["x"]) for k in range(2)]
    assert all(one == other for one, other in pairwise(left))
    assert studio_page.errors == []


@pytest.mark.nightly
def test_a_point_in_space_moves_the_volume_and_the_list_leads_back(studio_page: StudioInLab) -> None:
    page = studio_page.page
    studio_page.host.run(page, "studio.session.editing.reset(); studio.session.set_view('+y')")
    studio_page.read(lambda state: [step["view"] for step in state["steps"]] == ["+y"])
    studio_page.tab("Steps")
    page.get_by_role("button", name="Add step in space").click()
    page.wait_for_selector(".dnb-sp-pane0 .dnb-ed-target")
    assert page.locator(".dnb-ed-stage:not(.dnb-sp-stage):visible").count() == 0  # the picture has given its place
    studio_page.host.run(
        page, "studio.session.editing.edit_points(studio.session.editing.points.add(studio.volume.grid.center), 'add')"
    )
    page.wait_for_selector(".dnb-sp-pane1 [data-id='8']")
    pane = page.locator(".dnb-sp-stage").nth(1)  # coronal: x to the right
    pane.scroll_into_view_if_needed()
    before = runs(studio_page.read()["row"])
    box = box_at_rest(page.locator(".dnb-sp-pane1 [data-id='8'] .dnb-ed-hit").first)
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 30, y, steps=6)
    page.mouse.up()
    state = studio_page.read(lambda state: state["undo"].startswith("move"))
    assert state["undo"].startswith("move")
    assert [step["view"] for step in state["steps"]] == ["+y", None]
    after = runs(state["row"])
    assert sum(after[0]) > sum(before[0]) + 4  # to the right, as it was dragged
    page.locator(".dnb-il-choose:visible").first.click()
    page.wait_for_selector(".dnb-ed-stage:not(.dnb-sp-stage):visible")
    assert page.locator(".dnb-sp-stage:visible").count() == 0
    assert studio_page.errors == []

"""The way of a pupil: a lesson in JupyterLab, the carp turned into Antigonia, and its page on a phone, offline."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser.hosts import Lab, box_at_rest
from browser.pane_messages import message_script
from browser.test_editor_touch import Fingers
from browser.test_standalone_page import EDITOR, MODELS, Opened
from waiting import PATIENCE

from deformnb_lessons import GOAL_NODES, LESSONS, FishTask, lesson_carp, write_lesson_page
from deformnb_lessons.command import lesson_notebook

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

MOST_ACTIONS, MOST_SECONDS = 25, 300
PHONE = (390, 844)


class Pupil:
    """A hand that counts what it does: clicks, choices and drags."""

    def __init__(self, page: Any) -> None:
        self.page, self.actions, self.began = page, 0, time.monotonic()
        self.scores: list[int] = []

    def done(self) -> None:
        self.actions += 1

    def click(self, target: Any) -> None:
        target.click()
        self.done()

    def drag(self, start: Any, end: Any) -> None:
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down()
        mouse.move(*((np.asarray(start) + end) / 2), steps=3)
        mouse.move(*end, steps=3)
        mouse.up()
        self.done()

    def read_score(self, before: str) -> str:
        """The words above the studio, once they have followed a drag."""
        words = self.page.locator(".dnb-followed-result [role=status]")
        end = time.monotonic() + PATIENCE
        while (text := words.inner_text()) == before:
            assert time.monotonic() < end, f"after {self.actions} actions it still says {text!r}"
            self.page.wait_for_timeout(50)
        found = re.search(r"(-?\d+) % of the change", text)
        self.scores.append(int(found[1]) if found else 0)
        return text


STUDIO = "[...document.querySelectorAll('.dnb-editor')].find((e) => e.deformnb?.parts.points.list?.length === 12)"


def test_a_carp_becomes_a_boarfish_and_goes_home_on_a_phone(lab: Lab, tab: Any, browser: Any, tmp_path: Path) -> None:
    cells = json.loads(lesson_notebook("fish").read_text("utf-8"))["cells"]
    tab.set_viewport_size({"width": 1366, "height": 768})  # a school's laptop
    lab.open_notebook(tab, ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"], "lesson.ipynb")
    pupil = Pupil(tab)
    pupil.done()  # Run All Cells
    tab.wait_for_function(STUDIO, timeout=180_000)
    lab.run(tab, "")  # behind all cells: until then JupyterLab scrolls to the one that runs
    tab.evaluate(f"{STUDIO}.closest('.jp-OutputArea').scrollIntoView()")
    task = LESSONS["fish"].exercises["antigonia"]
    assert isinstance(task, FishTask)
    goal = task.grids(lesson_carp()).points.take(GOAL_NODES)
    stage, text = tab.locator(".dnb-ed-stage").last, ""
    text = pupil.read_score(text)
    for source, target in zip(goal.source, goal.target, strict=True):
        view, box = tab.evaluate(f"{STUDIO}.deformnb.parts.viewport.view"), box_at_rest(stage)
        corner = np.array([box["x"] + view["x"], box["y"] + view["y"]])
        assert box["y"] > 0, "picture and score are on the screen together"
        pupil.drag(corner + view["k"] * source, corner + view["k"] * target)
        text = pupil.read_score(text)
    assert text.startswith("Right."), text
    assert pupil.scores[-1] >= 75
    assert pupil.scores[0] == 0
    assert sum(after > before for before, after in zip(pupil.scores, pupil.scores[1:], strict=False)) >= 9, pupil.scores
    # The page to take home.
    pupil.click(tab.get_by_role("button", name=re.compile("^Export")).last)
    kinds = tab.locator("select:has(option:text('Web page that deforms (.html)'))").filter(visible=True)
    kinds.select_option(label="Web page that deforms (.html)")
    pupil.done()
    with tab.expect_download(timeout=120_000) as download:
        pupil.click(tab.get_by_role("button", name="Download", exact=True).filter(visible=True))
    page = tmp_path / "fish.html"
    download.value.save_as(page)
    assert pupil.actions <= MOST_ACTIONS
    assert time.monotonic() - pupil.began < MOST_SECONDS
    check_on_phone(browser, page, 12)


@pytest.mark.parametrize("name", LESSONS)
def test_the_page_of_a_lesson_works_on_a_phone(name: str, browser: Any, tmp_path: Path) -> None:
    write_lesson_page(name, tmp_path / "lesson.html")
    count = {"coordinates": 4, "fish": 12, "kernels": 4, "affine": 2, "folding": 1}[name]
    said = "the map folds" if name == "folding" else "Tissue leaves the box"  # a fold is the more dangerous
    check_on_phone(browser, tmp_path / "lesson.html", count, said)


def check_on_phone(browser: Any, path: Path, count: int, said: str = "Tissue leaves the box") -> None:
    """The file opens without a network, fits the screen, follows a finger, and says what is wrong with a long drag."""
    phone = Opened(browser, path, PHONE, "", has_touch=True, is_mobile=True)
    try:
        phone.wait_loaded()
        assert phone.js("document.documentElement.scrollWidth <= innerWidth")
        assert len(phone.points()) == count
        view, box = phone.js(f"({EDITOR}.viewport.view)"), phone.page.locator(".dnb-ed-stage").bounding_box()
        before = phone.points()
        place = before.target[0]
        at = box["x"] + view["k"] * place[0] + view["x"], box["y"] + view["k"] * place[1] + view["y"]
        Fingers(phone.page).drag(at, (30, 20))
        phone.wait_settled()
        way = phone.points().target - before.target
        np.testing.assert_allclose(way[0], np.array([30, 20]) / view["k"], atol=0.5)
        assert not way[1:].any()
        phone.js(
            f"{MODELS}.editor.update({{ points: {EDITOR}.points.list.map((p) => "
            "({ ...p, target: [p.source[0], p.source[1] - 100] })) })"
        )
        phone.wait_settled()
        phone.volume()
        phone.wait(f"({message_script('.dnb-editor')} + {message_script('.dnb-view-pane')}).includes('{said}')")
        assert phone.errors == []
        assert {url.split(":")[0] for url in phone.requests} <= {"file", "blob", "data"}
    finally:
        phone.context.close()

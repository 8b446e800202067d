"""A whole lesson by the keyboard alone, in JupyterLab and in German: no mouse, no pointer, no script does a step."""

from __future__ import annotations

import json
from typing import Any

import pytest
from browser.hosts import Lab

from deformnb_lessons.command import lesson_notebook
from deformnb_lessons.translation import write_translation

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

ANSWERS = {
    "distances-check": '"starr"',
    "turn-check": "[-10, 30]",
    "freedom-check": "[3, 4, 6]",
    "points-check": "3",
    "area-check": "1",
}
IN_STUDIO = "document.activeElement.closest('.dnb-studio') !== null"
ON_STAGE = "document.activeElement.matches('.dnb-ed-stage')"
ON_SHAPE = "document.activeElement.matches('.dnb-tab') && document.activeElement.textContent.includes('Form')"
IS_FOLDED = "document.activeElement.closest('.dnb-studio').querySelector('.dnb-panel-folded') !== null"
ON_TREND = "document.activeElement.matches('select') && document.activeElement.labels?.[0]?.textContent === 'Trend'"
ON_CHECK = "document.querySelector('.jp-Cell.jp-mod-active').textContent.includes('\"turned\", studio')"
LAST = "[...document.querySelectorAll('.dnb-editor')].at(-1).deformnb.parts"


def _press_until(page: Any, key: str, condition: str, most: int = 150) -> None:
    """Press a key until something holds, as somebody does who looks where the focus is."""
    for _ in range(most):
        if page.evaluate(condition):
            return
        page.keyboard.press(key)
    raise AssertionError(f"{condition} was not reached by {key}")


def _move(page: Any, k: int, axis: int, to: float, key: str) -> None:
    """Move the point that has the focus by an arrow key until it has come as far."""
    sign = 1 if key in ("ArrowRight", "ArrowDown") else -1
    place = f"{sign} * {LAST}.points.list[{k}].target[{axis}]"
    _press_until(page, f"Shift+{key}", f"{place} >= {sign * to} - 10")
    _press_until(page, key, f"{place} >= {sign * to} - 2")


def test_a_lesson_is_done_by_the_keyboard_alone(browser: Any, lab: Lab) -> None:
    notebook = lesson_notebook("affine")
    name = f"{lab.place}lesson.ipynb"
    (lab.folder / lab.place).mkdir(exist_ok=True)
    write_translation(notebook, lab.folder / name, "de")
    cells = [cell["id"] for cell in json.loads((lab.folder / name).read_text("utf-8"))["cells"]]
    page = browser.new_page(viewport={"width": 1280, "height": 1000})
    page.goto(lab.url(f"/lab/tree/{name}"))
    lab.wait_until_open(page)
    keys = page.keyboard
    for cell in cells[: cells.index("turned-check")]:
        if cell in ANSWERS:
            keys.press("Enter")
            keys.press("Control+Home")
            keys.press("End")
            for _ in "None":
                keys.press("Backspace")
            keys.insert_text(ANSWERS[cell])
        keys.press("Shift+Enter")
    page.wait_for_function(
        f"document.querySelectorAll('.dnb-editor').length === 2 && {LAST}.picture.painter.source", timeout=120_000
    )
    assert page.locator(".jp-OutputArea-output", has_text="Richtig.").count() == len(ANSWERS)

    keys.press("ArrowUp")  # to the studio's cell, and into it
    _press_until(page, "Tab", ON_STAGE)
    keys.press("Tab")
    page.wait_for_function("document.activeElement.matches('.dnb-ed-target')")
    _move(page, 0, 1, 35, "ArrowUp")
    _move(page, 0, 0, 50, "ArrowRight")
    keys.press("Control+ArrowRight")
    _move(page, 1, 1, 165, "ArrowDown")
    _move(page, 1, 0, 450, "ArrowLeft")
    _press_until(page, "Tab", ON_SHAPE)
    if page.evaluate(IS_FOLDED):  # in a narrow notebook the panel is folded until one of its groups is chosen
        keys.press("Enter")
        page.wait_for_function(f"!({IS_FOLDED})")
    _press_until(page, "Tab", ON_TREND)
    keys.type("Starr")
    count = page.evaluate("jupyterapp.shell.currentWidget.content.widgets.length")
    assert count == len(cells), "letters of a menu are no commands of the notebook"
    _press_until(page, "Tab", f"!({IN_STUDIO})")  # out of it again: nothing keeps the focus
    _press_until(page, "Tab", "document.activeElement.closest('.jp-Cell') !== null")
    keys.press("Escape")
    _press_until(page, "ArrowUp", ON_CHECK, 5)  # from the solution behind it
    keys.press("Shift+Enter")
    page.locator(".jp-OutputArea-output", has_text="Er ist gedreht, und jeder Abstand ist erhalten.").wait_for(
        timeout=60_000
    )
    page.close()

"""German lessons in JupyterLab: whatever a pupil does and sees in their outputs, no English word is left."""

from __future__ import annotations

import json
from typing import Any

import pytest
from browser.hosts import Lab
from browser.visible_words import foreign_words

from deformnb.words import word_table
from deformnb_lessons import LESSONS
from deformnb_lessons.command import lesson_notebook
from deformnb_lessons.translation import LessonWords, translate_notebook

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

SEEN = """() => {
  const names = ["title", "aria-label", "placeholder", "alt", "aria-valuetext"], found = new Set();
  const add = (text) => { if (text && /\\p{L}{2}/u.test(text)) found.add(text.trim()); };
  for (const output of document.querySelectorAll(".jp-OutputArea-output")) {
    const walker = document.createTreeWalker(output, NodeFilter.SHOW_ALL);
    for (let node = walker.currentNode; node; node = walker.nextNode()) {
      const element = node instanceof Element ? node : node.parentElement;
      if (!element || element.closest("[translate=no], script, style, pre, code")) continue;
      if (node.nodeType === Node.TEXT_NODE) add(node.nodeValue);
      else if (node instanceof Element) for (const name of names) add(node.getAttribute(name));
    }
  }
  return [...found];
}"""
"""All texts in the outputs of a notebook, as they are now."""

NAMES = ("Argyropelecus", "Pseudopriacanthus", "Scorpaena", "Orthagoriscus", "Sternoptyx", "Matplotlib Figure")
ERROR = 'lesson.check("no such exercise")'


def _translated(name: str) -> tuple[list[str], LessonWords]:
    notebook = lesson_notebook(name)
    words = LessonWords.read(notebook.parent / "de" / f"{notebook.stem}.md")
    cells = translate_notebook(json.loads(notebook.read_text("utf-8")), words, "de")["cells"]
    return [cell["source"] for cell in cells if cell["cell_type"] == "code"], words


@pytest.mark.parametrize("name", LESSONS)
def test_the_outputs_of_a_german_lesson_have_no_english_word(name: str, lab: Lab, tab: Any) -> None:
    code, words = _translated(name)
    lab.open_notebook(tab, [*code, ERROR], "lektion.ipynb")
    tab.wait_for_function(
        "[...document.querySelectorAll('.jp-OutputArea-output')].some((e) => e.textContent.includes('keine Aufgabe'))",
        timeout=240_000,
    )
    tab.wait_for_function(
        "document.querySelector('.dnb-editor')?.deformnb?.parts.picture.painter.source", timeout=60_000
    )
    seen = set(tab.evaluate(SEEN))
    for button in tab.locator(".dnb-question button").all():
        button.click()
    tab.wait_for_function(
        "[...document.querySelectorAll('.dnb-question')].every((e) => e.querySelector('[role=status]'))"
    )
    seen |= set(tab.evaluate(SEEN))
    for box in tab.locator(".dnb-question input[type=text]").all():
        box.fill("7")
    for button in tab.locator(".dnb-question button").all():
        button.click()
    stage = tab.locator(".dnb-ed-stage").last
    stage.scroll_into_view_if_needed()
    box = stage.bounding_box()
    tab.mouse.dblclick(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    tab.keyboard.press("Shift+ArrowUp")
    tab.wait_for_timeout(500)
    seen |= set(tab.evaluate(SEEN))
    table = {**word_table("de"), **words.words}
    assert len(seen) > 300, "the studio too was looked at"
    assert foreign_words(sorted(seen), table, [*NAMES, "lektion.ipynb"]) == []

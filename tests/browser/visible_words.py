"""Words that a page shows, and a walk through a studio that opens all that can be opened."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from browser.studio_layout import ARE_MADE, GROUPS, HEADING, TAB, tab_titles

from deformnb.words import Translator

COLLECT = """() => {
  const names = ["title", "aria-label", "placeholder", "alt", "label", "aria-valuetext", "aria-description",
    "aria-roledescription"];
  const alone = "[translate=no], script, style, noscript, code, pre, textarea, [contenteditable=true]";
  const seen = (window.seenWords = new Set());
  const add = (text) => { if (text && /\\p{L}/u.test(text)) seen.add(text.trim()); };
  const look = (node) => {
    const element = node instanceof Element ? node : node.parentElement;
    if (!element) return;
    if (node.nodeType === Node.TEXT_NODE && !element.closest(alone)) add(node.nodeValue);
    if (node instanceof Element && !node.closest("[translate=no]")) {
      for (const name of names) add(node.getAttribute(name));
    }
    node.childNodes.forEach(look);
  };
  const lookAgain = ({ type, target, addedNodes }) => {
    for (const node of type === "childList" ? addedNodes : [target]) if (node.isConnected) look(node);
  };
  const records = new MutationObserver((all) => requestAnimationFrame(() => all.forEach(lookAgain)));
  const begin = () => {
    requestAnimationFrame(() => look(document.body));
    records.observe(document.body, { subtree: true, childList: true, characterData: true, attributes: true });
  };
  if (document.body) begin(); else document.addEventListener("DOMContentLoaded", begin);
}"""
"""Script that records every text below the body, and every text of an attribute, as they are when a frame is drawn."""

TOOLS = ("add", "select", "move", "grow", "cut", "part", "fixed", "wand", "window", "mirror", "snap", "stop")


def visible_texts(page: Any) -> list[str]:
    """All texts that a page has shown since :data:`COLLECT` ran in it."""
    return sorted(page.evaluate("[...window.seenWords]"))


def walk_editor(page: Any, root: str = ".dnb-editor") -> None:
    """Use every tool of an editor, its lists, and its overlays."""
    stage = page.locator(f"{root} .dnb-ed-stage").first
    box = stage.bounding_box()
    x, y, w, h = box["x"], box["y"], box["width"], box["height"]
    mouse, keys = page.mouse, page.keyboard
    mouse.dblclick(x + 0.5 * w, y + 0.5 * h)
    mouse.move(x + 0.5 * w, y + 0.5 * h)
    mouse.down()
    mouse.move(x + 0.6 * w, y + 0.55 * h, steps=3)
    mouse.up()
    for key in ("Tab", "l", "l", "s", "Escape", "?", "?"):
        keys.press(key)
    for _ in range(6):
        keys.press("v")
        page.wait_for_timeout(60)
    for command in TOOLS:
        button = page.locator(f"{root} [data-command={command}]").first
        if not button.count():
            continue
        button.evaluate("button => button.click()")
        mouse.move(x + 0.3 * w, y + 0.4 * h)
        if command in ("cut", "part", "fixed"):
            for place in ((0.3, 0.3), (0.35, 0.7), (0.45, 0.5))[: 2 if command == "fixed" else 3]:
                mouse.click(x + place[0] * w, y + place[1] * h)
            if command != "fixed":
                keys.press("Enter")
            page.wait_for_timeout(150)
            mouse.move(x + 0.35 * w, y + 0.69 * h)
        elif command in ("move", "grow"):
            mouse.down()
            mouse.move(x + 0.32 * w, y + 0.42 * h, steps=2)
            mouse.up()
        elif command in ("wand", "window"):
            mouse.click(x + 0.5 * w, y + 0.5 * h)
            page.wait_for_timeout(300)
        else:
            mouse.click(x + 0.2 * w, y + 0.8 * h)
        keys.press("Escape")
        if command in ("mirror", "snap", "stop"):
            button.evaluate("button => button.click()")
    page.wait_for_timeout(200)


def walk_studio(page: Any) -> None:
    """Open every group, section, menu and list of a studio."""
    tab_titles(page)
    for number in range(len(GROUPS)):
        page.locator(TAB).nth(number).click()
        for heading in page.locator(HEADING).filter(visible=True).all():
            if heading.get_attribute("aria-expanded") == "false":
                heading.click()
        page.wait_for_function(ARE_MADE)
        page.wait_for_timeout(200)
    for button in page.locator(".dnb-head-button[aria-haspopup]").all():
        button.click()
        page.wait_for_timeout(200)
        button.click()


def walk_page(page: Any) -> None:
    """Use the controls of an exported page."""
    for menu in page.locator(".dnb-page-controls select").filter(visible=True).all():
        for option in menu.locator("option:enabled").all():
            if option.is_enabled():  # the trend may rule out a kernel
                menu.select_option(option.get_attribute("value"))
            page.wait_for_timeout(80)
    for button in page.locator(".dnb-page-controls button[aria-expanded]").filter(visible=True).all():
        button.click()
    page.wait_for_timeout(200)


def walk_file_page(page: Any, name: str, data: str) -> None:
    """Open a file on a page for files, after one that it cannot read."""
    drop = """([name, text]) => {
      const data = new DataTransfer(), bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
      data.items.add(new File([bytes], name));
      document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
    }"""
    page.evaluate(drop, ["notes.doc", "YWJj"])
    page.locator(".dnb-page-alert").filter(visible=True).wait_for()
    page.evaluate(drop, [name, data])
    page.locator(".dnb-view").wait_for()


NEUTRAL = (
    "carp (phantom)",
    "Argyropelecus",
    "olfersi",
    "Sternoptyx",
    "diaphana",
    "Diodon",
    "Orthagoriscus",
    "Polyprion",
    "Antigonia",
    "capros",
    "Pseudopriacanthus",
    "altus",
    "Scorpaena",  # animals
    "mm",
    "KiB",
    "MB",
    "kB",
    "sin(π z)",
    "smoothstep",
    "MP4",
    "PDF",
    "PNG",
    "SVG",
    "GIF",
    "WebP",
    "deformnb",
    "mm²",
    "mm³",
    ".bigwarp.json",
    ".csv",
    ".fcsv",
    ".morphologika.txt",
    ".mrk.json",
    ".nts",
    ".points.csv",
    ".prm",
    ".tps",
    ".tsv",
    ".txt",
    ".xyz",
    "null",
)
"""Words that are the same in all languages: names, units, kinds of files."""


def foreign_words(texts: Iterable[str], table: Mapping[str, str], allowed: Iterable[str]) -> list[str]:
    """Texts that are not made of what a table translates to, of numbers and of words that are allowed.

    Parameters
    ----------
    table : of a language, by the English words.
    allowed : names of files and of volumes, in addition to :data:`NEUTRAL`.
    """
    known = Translator({translation: key for key, translation in table.items()})
    neutral = re.compile("|".join(map(re.escape, sorted((*NEUTRAL, *allowed), key=len, reverse=True))))
    return [
        text
        for text in texts
        if "JavaScript enabled" not in text  # trame's own, where there is none
        and not known.knows(text)
        and not known.knows(neutral.sub("1", text))
    ]

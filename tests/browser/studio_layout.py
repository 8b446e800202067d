"""Controls of a studio that are clipped, covered or unreachable in a page, by their bounding boxes."""

from __future__ import annotations

from typing import Any

# A control is a widget of ipywidgets that is no box, or the root of one of deformnb's own.
FAULTS = """(may_scroll) => {
  const SLACK = 1.5; // px
  const CONTROL = ".jupyter-widgets:not(.widget-container), [class*='dnb-']:not(.widget-container)";
  const HOLDS_TEXT = "button, .widget-label, .widget-readout, .widget-html-content, select, .dnb-pt-scroller";
  const HOSTS_OWN = ".jp-WindowedPanel-outer, .jp-NotebookPanel-notebook";
  const studio = document.querySelector(".dnb-studio"), found = new Set(), box = (e) => e.getBoundingClientRect();
  const isSeen = (e) => {
    const { width, height } = box(e), { visibility, opacity } = getComputedStyle(e);
    return width > 1.5 && height > 0.5 && visibility === "visible" && Number(opacity) > 0;
  };
  const name = (e) => {
    const words = e.getAttribute("aria-label") || e.querySelector("label")?.textContent || e.title || e.textContent;
    return `${e.className} "${(words || "").trim().replace(/\\s+/g, " ").slice(0, 40)}"`;
  };
  const sides = ({ left, top, right, bottom }) => [left, top, right, bottom].map(Math.round).join(" ");
  const controlsIn = (root) => [...root.querySelectorAll(CONTROL)].filter((e) =>
    isSeen(e) && !e.parentElement.closest(CONTROL));
  const isCut = (e) => e.scrollWidth > e.clientWidth + SLACK && getComputedStyle(e).overflowX !== "visible";

  const page = document.documentElement.clientWidth;
  if (box(studio).right > page + SLACK) found.add(`the studio ends at ${box(studio).right} of ${page}`);
  for (let e = studio; e; e = e.parentElement) {
    if (isCut(e) && !e.matches(HOSTS_OWN)) found.add(`${name(e)} is scrolled sideways`);
  }
  const panel = [...studio.querySelectorAll(".dnb-tabs > .dnb-group")].find(isSeen);
  const around = controlsIn(studio).filter((e) => !panel.contains(e));
  for (const [root, controls] of [[studio, around], [panel, controlsIn(panel)]]) {
    const outer = box(root);
    controls.forEach((e, k) => {
      const b = box(e);
      const isAbove = root !== panel && (b.top < outer.top - SLACK || b.bottom > outer.bottom + SLACK); // panels scroll
      if (b.left < outer.left - SLACK || b.right > outer.right + SLACK || isAbove) {
        found.add(`${name(e)} leaves its box: ${sides(b)} of ${sides(outer)}`);
      }
      for (const other of controls.slice(k + 1)) {
        const o = box(other);
        const wide = Math.min(b.right, o.right) - Math.max(b.left, o.left);
        const tall = Math.min(b.bottom, o.bottom) - Math.max(b.top, o.top);
        if (wide > SLACK && tall > SLACK) found.add(`${name(e)} covers ${name(other)}: ${sides(b)} and ${sides(o)}`);
      }
    });
  }
  for (const e of studio.querySelectorAll(HOLDS_TEXT)) {
    const isFree = may_scroll && e.matches(may_scroll);
    if (isSeen(e) && e.clientWidth > 0 && isCut(e) && !isFree) found.add(`${name(e)} is cut at ${e.clientWidth}`);
  }
  return [...found];
}"""

BOXES = """() => JSON.stringify([...document.querySelectorAll(".dnb-studio, .dnb-studio .dnb-group")].map(
  (e) => e.getBoundingClientRect()))"""


GROUPS = {
    "Shape": [
        "Steps",
        "Interpolation",
        "Points",
        "Rigid parts and cuts",
        "Match to another picture",
        "Thompson's grids and your own",
    ],
    "Depth": [],
    "View": ["Colours and opacity", "Picture", "View plane", "Second volume"],
    "Animate": [],
    "Check": [],
}
"""Sections with a heading, by the title of their group."""

ARE_MADE = "() => ![...document.querySelectorAll('.dnb-studio .dnb-late')].some((place) => place.offsetParent)"
"""Check whether the kernel has made all visible panels."""

HEADING = ".dnb-section-head"
TAB = ".dnb-studio .dnb-tab"


def tab_titles(page: Any) -> list[str]:
    """The titles of the studio's groups, once the last is there."""
    page.locator(TAB).nth(len(GROUPS) - 1).wait_for()
    return [text.strip() for text in page.locator(TAB).all_inner_texts()]


def section_titles(page: Any) -> list[str]:
    """The titles of the sections of the group that is shown."""
    return [text.strip() for text in page.locator(HEADING).filter(visible=True).all_inner_texts()]


def choose(page: Any, title: str) -> None:
    """Show a group, or a section of one, and wait until its box has its final size."""
    group = next(group for group, sections in GROUPS.items() if title in (group, *sections))
    page.locator(TAB).filter(has_text=group).first.click()
    if title != group:
        heading = page.locator(HEADING, has_text=title).filter(visible=True)
        heading.wait_for()
        if heading.get_attribute("aria-expanded") == "false":
            heading.click()
        heading.scroll_into_view_if_needed()
    page.wait_for_function(ARE_MADE)
    before = None
    while before != (before := page.evaluate(BOXES)):
        page.wait_for_timeout(100)


def faults(page: Any, may_scroll: str = "") -> list[str]:
    """Controls that are clipped, covered or scrolled away sideways in the selected tab, and in the rest of the studio.

    Parameters
    ----------
    may_scroll : a selector of elements that may have a scroll bar there.
    """
    return list(page.evaluate(FAULTS, may_scroll))


def has_fault(page: Any, words: str) -> bool:
    """Check whether a fault with these words is found, immediately or when the layout is at rest."""
    for _ in range(10):
        if any(words in fault for fault in faults(page)):
            return True
        page.wait_for_timeout(200)
    return False


def lasting_faults(page: Any, may_scroll: str = "") -> list[str]:
    """The same, without faults that pass while parts of a tab are still loading."""
    for _ in range(10):
        if not (found := faults(page, may_scroll)):
            break
        page.wait_for_timeout(500)
    return found

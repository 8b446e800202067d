"""Targets on a phone are 44 CSS pixels wide and high: whatever can be pressed, on each page and in the application.

Measured is the area in which a press reaches the element, for some of them are larger than they look.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from browser.hosts import box_at_rest
from browser.studio_layout import GROUPS, choose
from browser.test_touch_drags import PAGES, opened

pytestmark = pytest.mark.needs_browser

LEAST = 44
"""CSS pixels: the target size of WCAG 2.2 at level AAA, and of Apple's guidelines."""

SMALL = """(least) => {
  const kinds = ["button", "select", "input", "textarea", "a[href]", "summary", "[role=button]", "[role=slider]",
    "[role=tab]", ".dnb-ed-target > .dnb-ed-hit"];
  const reached = (part, hit) => hit !== null && part.contains(hit);
  const extent = (part, [x, y], [dx, dy]) => {
    let count = 0;
    while (count < 60 && reached(part, document.elementFromPoint(x + dx * count, y + dy * count))) count += 1;
    return count;
  };
  const faults = [];
  let measured = 0;
  for (const part of document.querySelectorAll(kinds)) {
    if (!part.getClientRects().length || getComputedStyle(part).visibility === "hidden") continue;
    // Marks are measured by what takes a press; nodes are as dense as their grid; the bar of views is for keys.
    if (part.closest(".dnb-bar, .dnb-ed-nodes, .dnb-gd-svg")) continue;
    if (part.matches(".dnb-ed-target, .dnb-ed-source")) continue;
    part.scrollIntoView({ block: "center", inline: "center" });
    const own = part.matches("[type=checkbox], [type=radio]") ? (part.closest("label") ?? part) : part,
      box = own.getBoundingClientRect(),
      at = [box.left + box.width / 2, box.top + box.height / 2],
      [left, right, up, down] = [[-1, 0], [1, 0], [0, -1], [0, 1]].map((way) => extent(own, at, way)),
      wide = Math.max(left + right - 1, box.width),
      high = Math.max(up + down - 1, box.height);
    measured += 1;
    const name = part.getAttribute("aria-label") || part.textContent.trim() || part.type,
      kind = part.getAttribute("class") ?? part.tagName;
    if (Math.min(wide, high) < least - 0.5) faults.push(`${kind}, ${name}: ${Math.round(wide)} x ${Math.round(high)}`);
  }
  return [measured, faults];
}"""


def small_targets(phone: Any, fewest: int) -> list[str]:
    measured, faults = phone.page.evaluate(SMALL, LEAST)
    assert measured >= fewest
    return list(faults)


@pytest.mark.parametrize("kind", list(PAGES))
def test_targets_of_a_page_are_large_enough_for_a_finger(kind: str, browser: Any, tmp_path: Path) -> None:
    with opened(kind, browser, tmp_path) as phone:
        assert phone.js("matchMedia('(pointer: coarse)').matches")
        box_at_rest(phone.page.locator(".dnb-editor").first)
        assert small_targets(phone, 30) == []
        assert phone.js("document.documentElement.scrollWidth <= innerWidth")
        # The measure sees a target that is smaller.
        phone.js("{ document.querySelector('.dnb-ed-button').style.cssText = 'min-width: 30px; width: 30px'; }")
        assert len(small_targets(phone, 30)) == 1


def test_targets_of_the_application_are_large_enough_for_a_finger(browser: Any, tmp_path: Path) -> None:
    with opened("application", browser, tmp_path) as phone:
        phone.js("{ document.body.style.padding = ''; }")
        found: dict[str, list[str]] = {}
        for group, sections in GROUPS.items():
            for title in (group, *sections):
                choose(phone.page, title)
            if small := small_targets(phone, 60):
                found[group] = small
        for menu in ("History", "Examples", "Export"):
            phone.page.locator(".dnb-head").get_by_role("button", name=menu).click()
            phone.page.locator(f".dnb-menu-{menu.lower()}.dnb-menu-open").wait_for()
            if small := small_targets(phone, 60):
                found[menu] = small
        assert found == {}, "\n".join(f"{group}: {text}" for group, small in found.items() for text in small)

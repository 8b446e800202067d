"""Targets on a phone are 44 CSS pixels wide and high: whatever can be pressed, on each page and in the application.

Measured is the area in which a press reaches the element, for some of them are larger than they look.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from browser.editor_page import EditorOnPage, five_points, smooth_picture
from browser.hosts import box_at_rest
from browser.live_page import LivePage
from browser.studio_layout import GROUPS, choose
from browser.test_curve_editor_page import TENT, Drawn
from browser.test_editor_touch import Fingers
from browser.test_space_editor_page import Opened as OpenedSpace
from browser.test_space_editor_page import waves
from browser.test_space_points_page import Shown
from browser.test_standalone_page import MODELS
from browser.test_thompson_static import PHONE as THOMPSON_PHONE
from browser.test_thompson_static import ThompsonPage
from browser.test_touch_drags import PAGES, opened

from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line, Polygon
from deformnb.rbf.rigid import RigidPart
from deformnb.widgets import CurveEditor, DepthKeys
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.file_pages import write_thompson_page

pytestmark = pytest.mark.needs_browser

LEAST = 44
"""CSS pixels: the target size of WCAG 2.2 at level AAA, and of Apple's guidelines."""

SMALL = """(least) => {
  const kinds = ["button", "select", "input", "textarea", "a[href]", "summary", "[role=button]", "[role=slider]",
    "[role=tab]", ".dnb-ed-source"];
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
    if (part.closest(".dnb-bar")) continue; // the bar of views is for keys
    // Handles may overlap: a test below presses them.
    const hit = [...part.children].find((e) => e.matches("circle:is(.dnb-ed-hit, .dnb-cv-hit)"));
    if (hit) {
      measured += 1;
      const { width, height } = hit.getBoundingClientRect();
      if (Math.min(width, height) < least - 0.5) faults.push(`${part.getAttribute("class")}: ${width} x ${height}`);
      continue;
    }
    part.scrollIntoView({ block: "center", inline: "center" });
    const own = part.matches("[type=checkbox], [type=radio]") ? (part.closest("label") ?? part) : part,
      box = own.getBoundingClientRect(),
      // The line between two pictures lies over points: its knob is what is large.
      knob = part.matches(".dnb-ed-stage .dnb-wipe") ? [box.left + box.width / 2, box.bottom - 26] : null,
      at = knob ?? [box.left + box.width / 2, box.top + box.height / 2],
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


@contextmanager
def open_thompson(browser: Any, folder: Path, size: tuple[int, int], language: str) -> Iterator[ThompsonPage]:
    write_thompson_page(folder / "thompson.html", language=language)
    page = ThompsonPage(browser, folder / "thompson.html", **{**THOMPSON_PHONE, "size": size})
    yield page
    page.context.close()
    assert page.errors == []


CLIPPED = """[...document.querySelectorAll("button, select, .dnb-th-tab span, .dnb-th-task, .dnb-th-caption")]
  .filter((e) => e.offsetParent && !e.closest(".dnb-bar, .dnb-ed-bar"))
  .filter(({ scrollWidth, clientWidth }) => clientWidth && scrollWidth > clientWidth + 1)
  .map((e) => `${e.textContent}: ${e.scrollWidth} in ${e.clientWidth}`)"""
"""Words that do not fit into their element."""

COVERED = """(() => {
  const parts = [...document.querySelectorAll("button, select, input[type=range], .dnb-th-end")]
    .filter((e) => e.offsetParent && !e.closest(".dnb-view, .dnb-editor"))
    .map((e) => [e.textContent || e.name, e.getBoundingClientRect()]);
  const common = (p, q, low, high) => Math.min(p[high], q[high]) - Math.max(p[low], q[low]);
  const isOver = (p, q) => common(p, q, "left", "right") > 1 && common(p, q, "top", "bottom") > 8;
  return parts.flatMap(([name, p], k) => parts.slice(k + 1).filter(([, q]) => isOver(p, q))
    .map(([other]) => `${name} and ${other}`));
})()"""
"""Controls that are over each other."""


@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("size", [(320, 640), (390, 844), (844, 390)])
def test_targets_of_thompsons_page_are_large_and_its_words_fit(
    size: tuple[int, int], language: str, browser: Any, tmp_path: Path
) -> None:
    with open_thompson(browser, tmp_path, size, language) as phone:
        for step in ("morph", "drag", "carp", "growth", "own"):
            phone.go(step)
            if step == "own":
                for button in phone.page.locator(".dnb-grid-own-bar .dnb-page-button:nth-of-type(2)").all():
                    button.tap()
                phone.wait("document.querySelectorAll('.dnb-gd-svg .dnb-cv-node').length > 90")
                phone.press(".dnb-th-own-step .dnb-th-next")
                phone.wait("document.querySelector('.dnb-th-result-place .dnb-editor')")
                phone.wait_settled()
            assert small_targets(phone, 8) == [], step
            assert phone.js(CLIPPED) == [], step
            assert phone.js(COVERED) == [], step
            assert phone.js("document.documentElement.scrollWidth <= innerWidth")


# ---- handles in drawings --------------------------------------------------------------------------------------------

NEAR = 20
"""CSS pixels from the middle of a handle, at which a finger still grabs it."""

PLACE = """([number, dx, dy]) => {
  const isSeen = (e) => { const { visibility, pointerEvents, display } = getComputedStyle(e);
    return e.getClientRects().length && visibility === "visible" && pointerEvents !== "none" && display !== "none"; };
  window.handles ??= [];
  handles = [...document.querySelectorAll("circle:is(.dnb-ed-hit, .dnb-cv-hit)")].filter(isSeen);
  if (number >= handles.length) return null;
  if (!window.isWatched) addEventListener("pointerdown", ({ target }) => {
    pressed = handles.findIndex((hit) => hit.parentElement.contains(target)); }, { capture: true });
  Object.assign(window, { isWatched: true, pressed: -1 });
  const svg = handles[number].closest("svg");
  svg.scrollIntoView({ block: "center" });
  const middleOf = ({ left, top, width, height }) => [left + width / 2, top + height / 2],
    middles = handles.map((hit) => middleOf(hit.getBoundingClientRect())),
    [x, y] = [middles[number][0] + dx, middles[number][1] + dy],
    away = middles.map(([p, q], k) => handles[k].closest("svg") === svg ? Math.hypot(p - x, q - y) : Infinity),
    [first, second] = [...away].sort((p, q) => p - q);
  // The arrows of a chosen point in space are grabbed too.
  const isReached = document.elementFromPoint(x, y)?.closest("svg") === svg &&
    !document.elementsFromPoint(x, y).some((e) => e.matches(".dnb-sp-arrow-hit"));
  return { at: [x, y], nearest: away.indexOf(first), isClear: isReached && !(second - first < 1) };
}"""


def find_wrong_grabs(page: Any, most: int = 24) -> list[str]:
    """Handles that a finger near them does not grab, though no other one is nearer; each pressed beside its middle."""
    fingers, faults, pressed = Fingers(page), [], 0
    for number in range(most):
        for way in ((NEAR, 0), (0, NEAR), (-0.7 * NEAR, -0.7 * NEAR)):
            found = page.evaluate(PLACE, [number, *way])
            if found is None:
                break
            if not found["isClear"]:
                continue
            fingers.touch("touchStart", found["at"])
            hit = page.evaluate("() => pressed")
            fingers.touch("touchCancel")
            pressed += 1
            if hit != found["nearest"]:
                faults.append(f"handle {number} at {way}: {hit} and not {found['nearest']} was grabbed")
    assert pressed >= 4
    return faults


def open_phone(browser: Any, size: tuple[int, int] = (390, 844)) -> Any:
    """The browser, whose pages are those of a phone."""
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, has_touch=True, is_mobile=True)
    return SimpleNamespace(new_page=lambda viewport: context.new_page(), close=context.close)


def chosen_part(phone: Any) -> Any:
    """A rigid part with its corners, knob and pivot, and the axis of the mirror, among points."""
    part = RigidPart(Polygon([[30.0, 0], [100, 0], [100, 45], [30, 45]]), name="part")
    page = EditorOnPage(phone, Editor(smooth_picture(), five_points(), parts=[part]), (390, 844))
    page.editor.mirror = {"on": True, "axis": "a", "at": 60.0}
    page.js(
        "document.querySelector('.dnb-editor').deformnb.parts.tools.shapes.choice.choose({ what: 'parts', index: 0 })"
    )
    page.wait_settled()
    return page


def chosen_cut(phone: Any) -> Any:
    page = EditorOnPage(
        phone, Editor(smooth_picture(), five_points(), cuts=[Cut(Line([[40.0, 20], [90, 20]]))]), (390, 844)
    )
    page.js(
        "document.querySelector('.dnb-editor').deformnb.parts.tools.shapes.choice.choose({ what: 'cuts', index: 0 })"
    )
    page.wait_settled()
    return page


def dense_nodes(phone: Any) -> Any:
    """Nodes of a grid that is denser than fingers, and selected points with the knob that turns them."""
    page = EditorOnPage(phone, Editor(smooth_picture(), five_points(), drag_grid=True, density=10), (390, 844))
    page.js("document.querySelector('.dnb-editor').deformnb.parts.points.select([0, 1])")
    page.wait_settled()
    return page


def curves(phone: Any) -> Any:
    editor = CurveEditor()
    editor.set_nodes(TENT)
    return Drawn(phone, editor, DepthKeys((0.0, 0.1, 1.0)), width=390)


def space(phone: Any) -> Any:
    points = ControlPoints.from_arrays([[-12.5, 25, 24], [-8.5, 27, 24], [17.5, 50, 24]])
    return OpenedSpace(LivePage(phone, (390, 844)), SpaceEditor(waves(), points, cursor=[7.5, 38, 24])).page


def points_on_a_volume(phone: Any) -> Any:
    return Shown(
        LivePage(phone, (390, 844)), ControlPoints.from_arrays([[40.0, 20, 30], [46, 22, 40], [30, 30, 30]])
    ).page


DRAWINGS: list[Callable[[Any], Any]] = [chosen_part, chosen_cut, dense_nodes, curves, space, points_on_a_volume]


@pytest.mark.parametrize("drawing", DRAWINGS, ids=lambda drawing: drawing.__name__)
def test_a_finger_grabs_the_handle_that_is_nearest(drawing: Callable[[Any], Any], browser: Any) -> None:
    phone = open_phone(browser)
    opened_page = drawing(phone)
    assert find_wrong_grabs(opened_page.page) == []
    assert opened_page.errors == []
    phone.close()


def test_the_measure_sees_handles_that_are_small(browser: Any) -> None:
    phone = open_phone(browser)
    page = chosen_part(phone).page
    page.add_style_tag(content="circle:is(.dnb-ed-hit, .dnb-cv-hit) { r: 9px !important; }")
    assert find_wrong_grabs(page, 8) != []
    phone.close()


def test_a_finger_grabs_the_nearest_node_of_a_grid_on_a_picture(browser: Any, tmp_path: Path) -> None:
    with open_thompson(browser, tmp_path, (390, 844), "en") as phone:
        phone.go("own")
        phone.page.locator(".dnb-grid-own-bar .dnb-page-button:nth-of-type(2)").first.tap()
        phone.wait("document.querySelectorAll('.dnb-gd-svg .dnb-cv-node').length > 20")
        assert find_wrong_grabs(phone.page) == []


@pytest.mark.parametrize("kind", list(PAGES))
def test_a_finger_grabs_the_nearest_point_of_each_page(kind: str, browser: Any, tmp_path: Path) -> None:
    with opened(kind, browser, tmp_path) as phone:
        phone.js("{ document.body.style.padding = ''; }")
        phone.js(f"{{ {MODELS}.editor.update({{ drag_grid: true }}); }}")
        phone.wait_settled()
        assert find_wrong_grabs(phone.page, 8) == []

"""Fingers and pens in the editors: what scrolls the page, what moves the view, and how several points are selected."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from browser.hosts import box_at_rest
from browser.live_page import LivePage
from browser.pane_messages import message_text
from browser.test_space_editor_page import PAGE as SPACE
from browser.test_space_editor_page import Opened, waves

from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.editor.space_editor import SpaceEditor

pytestmark = pytest.mark.needs_browser


class Fingers:
    """Touches of a real page; the browser scrolls by them where nothing keeps it from that."""

    def __init__(self, page: Any) -> None:
        self.page, self._cdp = page, page.context.new_cdp_session(page)

    def touch(self, kind: str, *places: Any) -> None:
        self._cdp.send(
            "Input.dispatchTouchEvent",
            {"type": kind, "touchPoints": [{"x": float(x), "y": float(y), "id": n} for n, (x, y) in enumerate(places)]},
        )

    def tap(self, place: Any) -> None:
        self.touch("touchStart", place)
        self.touch("touchEnd")

    def drag(self, start: Any, by: Any, steps: int = 6) -> None:
        x, y = start
        self.touch("touchStart", (x, y))
        for step in range(1, steps + 1):
            self.touch("touchMove", (x + by[0] * step / steps, y + by[1] * step / steps))
        self.touch("touchEnd")

    def swipe(self, start: Any, by: Any) -> None:
        """A drag at whose end the finger rests, so that what it scrolls does not run on."""
        x, y = start
        self.touch("touchStart", start)
        for step in [*range(1, 7), 6, 6]:
            self.touch("touchMove", (x + by[0] * step / 6, y + by[1] * step / 6))
            self.page.wait_for_timeout(60)
        self.touch("touchEnd")
        box_at_rest(self.page.locator("body"))


def tall(page: Any) -> None:
    """A page with something to scroll, as notebooks are."""
    page.evaluate("() => { document.body.style.height = '4000px'; }")
    box_at_rest(page.locator(".dnb-editor").first)  # a bar beside it may make the editor narrower


def pen(page: EditorOnPage, start: Any, by: Any, *, steps: int = 4) -> None:
    """A stroke of a pen on the glass."""
    cdp, (x, y) = page.page.context.new_cdp_session(page.page), start

    def event(kind: str, share: float, buttons: int) -> None:
        cdp.send(
            "Input.dispatchMouseEvent",
            {
                "type": kind,
                "x": x + by[0] * share,
                "y": y + by[1] * share,
                "button": "left",
                "buttons": buttons,
                "clickCount": 1,
                "pointerType": "pen",
                "force": 0.5,
            },
        )

    event("mousePressed", 0, 1)
    for step in range(1, steps + 1):
        event("mouseMoved", step / steps, 1)
    event("mouseReleased", 1, 0)
    page.wait_settled()


# ---- who owns a finger ----------------------------------------------------------------------------------------------


def test_a_finger_scrolls_the_page_until_someone_works_in_the_editor(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    tall(page.page)
    fingers, place, view = Fingers(page.page), page.to_screen([52, 40]), page.js(f"({{...{PAGE}.viewport.view}})")
    fingers.swipe(place, (0, -150))
    page.wait("scrollY > 100")
    assert page.js(f"({{...{PAGE}.viewport.view}})") == view
    assert page.js("document.activeElement === document.body")
    page.js("scrollTo(0, 0)")
    fingers.drag(place, (60, 0))  # across, which scrolls nothing
    assert page.js(f"({{...{PAGE}.viewport.view}})") == view
    assert message_text(page.page) == "Tap the picture first, then a finger moves it"
    fingers.tap(place)
    page.wait("document.activeElement.className === 'dnb-ed-stage'")
    fingers.swipe(place, (0, -60))
    page.wait(f"{PAGE}.viewport.view.y < {view['y'] - 30}")
    assert page.js("scrollY") == 0
    assert page.js(f"{PAGE}.viewport.view.k") == view["k"]


def test_a_point_is_dragged_at_once_and_nothing_scrolls(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    tall(page.page)
    Fingers(page.page).drag(page.to_screen(points.target[4]), (6, -60))
    page.wait_settled()
    k = page.js(f"{PAGE}.viewport.view.k")
    assert page.points.target[4] == pytest.approx(points.target[4] + np.array([6, -60]) / k, abs=1e-6)
    assert page.js("scrollY") == 0


def test_in_an_application_that_it_fills_a_finger_is_the_editors(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture))
    page.js("document.querySelector('.dnb-editor').parentElement.style.height = '480px'")
    page.js("models.editor.set('fill', true)")
    page.js("document.querySelector('.dnb-editor').deformnb.layout()")
    assert page.js("getComputedStyle(document.querySelector('.dnb-ed-stage')).touchAction") == "none"
    Fingers(page.page).drag(page.to_screen([52, 40]), (40, 0))
    page.wait(f"!{PAGE}.viewport.isFitted")


# ---- several points -------------------------------------------------------------------------------------------------


def test_fingers_select_several_points_by_taps_and_by_a_band(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    fingers, button = Fingers(page.page), page.page.locator("[data-command=select]")
    selected = f"[...{PAGE}.points.selected].sort().join()"
    fingers.tap(page.to_screen(points.target[0]))
    fingers.tap(page.to_screen(points.target[1]))
    assert page.js(selected) == "1"  # without the tool a tap selects one
    fingers.tap((button.bounding_box()["x"] + 8, button.bounding_box()["y"] + 8))
    page.wait(f"{PAGE}.tools.modes.isSelecting")
    page.wait("document.querySelector('[data-command=select]').getAttribute('aria-pressed') === 'true'")
    fingers.tap(page.to_screen(points.target[0]))
    assert page.js(selected) == "0,1"
    low, high = page.to_screen([20, 40]), page.to_screen([115, 65])
    fingers.drag(low, (high[0] - low[0], high[1] - low[1]))
    assert page.js(selected) == "0,1,2,3"
    assert page.js(f"{PAGE}.viewport.isFitted")  # the view stays
    fingers.tap(page.to_screen(points.target[0]))
    fingers.tap(page.to_screen([52, 30]))  # beside all: nothing is lost
    assert page.js(selected) == "1,2,3"
    fingers.drag(page.to_screen(points.target[2]), (12, 20))
    page.wait_settled()
    by = np.array([12, 20]) / page.js(f"{PAGE}.viewport.view.k")
    assert page.points.target[1:4] == pytest.approx(points.target[1:4] + by, abs=1e-6)
    assert np.array_equal(page.points.target[[0, 4]], points.target[[0, 4]])
    page.wait("models.editor.get('selected').length === 3")
    page.page.keyboard.press("Escape")
    assert not page.js(f"{PAGE}.tools.modes.isSelecting")
    assert page.js(selected) == "1,2,3"
    fingers.tap(page.to_screen([52, 30]))
    assert page.js(selected) == ""


def test_two_fingers_end_a_band_and_move_the_view(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    fingers, k = Fingers(page.page), page.js(f"{PAGE}.viewport.view.k")
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("b")
    x, y = page.to_screen([20, 40])
    fingers.touch("touchStart", (x, y))
    fingers.touch("touchMove", page.to_screen([60, 65]))
    assert page.js(f"[...{PAGE}.points.selected]") == [3]
    x, y = page.to_screen([60, 65])
    fingers.touch("touchStart", (x, y), (x + 80, y))
    assert page.js(f"[...{PAGE}.points.selected]") == []
    for gap in (100, 130, 160):
        fingers.touch("touchMove", (x, y), (x + gap, y))
    fingers.touch("touchEnd")
    page.wait_settled()
    assert page.js(f"{PAGE}.viewport.view.k") == pytest.approx(2 * k, rel=0.02)
    assert page.page.locator(".dnb-ed-band").get_attribute("visibility") == "hidden"


def test_one_tool_at_a_time(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    press = page.page.keyboard.press
    page.page.locator(".dnb-ed-stage").focus()
    for key in ("a", "s", "x"):
        press("b")
        assert page.js(
            f"(({{ modes, brush, pen }}) => [modes.isSelecting, modes.isAdding, brush.isOn, pen.isOn])({PAGE}.tools)"
        ) == [
            True,
            False,
            False,
            False,
        ]
        press(key)
        assert not page.js(f"{PAGE}.tools.modes.isSelecting"), key
    page.page.mouse.dblclick(*page.to_screen([52, 30]))
    page.page.keyboard.press("Escape")
    press("b")
    before = page.points
    page.page.mouse.dblclick(*page.to_screen([80, 50]))  # two clicks while one selects add nothing
    assert page.points == before


def test_a_drag_that_begins_on_a_line_draws_a_band_and_a_click_chooses_the_line(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points, cuts=[Cut(Line([(55, -20), (55, 70)]))]))
    k = page.js(f"{PAGE}.viewport.view.k")
    page.drag([55, 15], (30 * k, 20 * k))
    assert page.js(f"[{PAGE}.tools.shapes.choice.chosen, [...{PAGE}.points.selected]]") == [None, [4]]
    page.page.mouse.click(*page.to_screen([55, 15]))
    assert page.js(f"{PAGE}.tools.shapes.choice.chosen") == {"what": "cuts", "index": 0}
    page.drag([55, 5], (4 * k, 0))  # now that it is chosen
    page.wait_answered()
    assert page.editor.cuts[0].region.vertices[0] == pytest.approx([59, -20], abs=0.6)


# ---- pens -----------------------------------------------------------------------------------------------------------


def test_a_pen_drags_points_draws_bands_and_strokes(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.js(
        "(() => { window.kinds = new Set(); document.querySelector('.dnb-ed-svg').addEventListener('pointerdown', "
        "(e) => kinds.add(e.pointerType)); })()"
    )
    k = page.js(f"{PAGE}.viewport.view.k")
    page.page.locator(".dnb-ed-stage").focus()
    pen(page, page.to_screen(points.target[4]), (24, -18))
    assert page.js("[...kinds]") == ["pen"]
    moved = page.points
    assert moved.target[4] == pytest.approx(points.target[4] + np.array([24, -18]) / k, abs=1e-6)
    pen(page, page.to_screen(points.target[3]), (2, 0))  # a hand that trembles: a press, no drag
    assert page.points == moved
    assert page.js(f"[...{PAGE}.points.selected]") == [3]
    pen(page, page.to_screen([90, -20]), (40 * k, 30 * k))
    assert page.js(f"[...{PAGE}.points.selected]") == [1]  # by a band, while a finger would move the view
    assert page.js(f"{PAGE}.viewport.isFitted")
    page.page.keyboard.press("s")
    pen(page, page.to_screen([50, 20]), (0.4 * page.js(f"{PAGE}.tools.brush.radius") * k, 0), steps=6)
    assert len(page.points) > 5  # the brush has set points of its own


# ---- in space -------------------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_in_space_fingers_scroll_tap_and_select(page: LivePage) -> None:
    start = ControlPoints.from_arrays([[-10.0, 25, 20], [10, 45, 20], [25, 40, 20]])
    space = Opened(page, SpaceEditor(waves(), start, cursor=[-10.0, 25, 20]))
    tall(page.page)
    fingers, far = Fingers(page.page), space.to_screen(0, [0, 60, 20])
    fingers.swipe(far, (0, -120))
    page.wait("scrollY > 80")
    assert np.allclose(space.editor.cursor, [-10, 25, 20])
    assert space.js("document.activeElement === document.body")
    space.js("scrollTo(0, 0)")
    fingers.tap(far)
    space.wait_settled()
    page.wait("document.activeElement.classList.contains('dnb-sp-stage')")
    assert space.editor.cursor[:2] == pytest.approx([0, 60], abs=1)
    page.page.keyboard.press("b")
    for k in (0, 2):
        fingers.tap(space.to_screen(0, start.target[k]))
    assert space.js(f"[...{SPACE}.parts.points.selected]") == [0, 2]
    stage = page.page.locator(".dnb-sp-stage").first.bounding_box()
    fingers.drag((stage["x"] + 4, stage["y"] + 4), (stage["width"] - 8, stage["height"] - 8))
    assert sorted(space.js(f"[...{SPACE}.parts.points.selected]")) == [0, 1, 2]
    page.page.keyboard.press("Escape")
    space.wait_settled()
    assert space.js(f"[{SPACE}.parts.modes.isSelecting, {SPACE}.parts.points.selected.size]") == [False, 3]
    space.editor.close()


@pytest.mark.parametrize("width", [390, 820])
def test_the_options_of_a_tool_are_one_line_whose_buttons_fingers_reach(
    browser: Any, picture: Picture, points: ControlPoints, width: int
) -> None:
    context = browser.new_context(viewport={"width": width, "height": 700}, has_touch=True, is_mobile=True)
    phone = SimpleNamespace(new_page=lambda viewport: context.new_page())
    page = EditorOnPage(phone, Editor(picture, points, wand={"region": None, "pieces": 2}))
    try:
        page.js(f"{{ {PAGE}.commands.run('wand', null); }}")
        bar = page.page.locator(".dnb-ed-wand-bar")
        bar.wait_for()
        assert bar.bounding_box()["height"] <= 50
        for part in bar.locator("button, select, label, input[type=range]").all():
            part.scroll_into_view_if_needed()
            box, around = part.bounding_box(), bar.bounding_box()
            assert round(box["height"]) >= 44
            assert round(box["width"]) >= 44
            assert around["x"] <= box["x"] + 1
            assert box["x"] + box["width"] <= around["x"] + around["width"] + 1
        assert page.errors == []
    finally:
        page.close()
        context.close()

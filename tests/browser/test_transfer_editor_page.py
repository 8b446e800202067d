"""Colours, window and zoom of the transfer editor in a page, with a real mouse, real keys and a finger."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import Any

import numpy as np
import oracle
import pytest
from browser.live_page import LivePage
from PIL import Image

from deformnb.datasets import PHANTOMS
from deformnb.volume.transfer import PRESETS, TransferFunction, preset
from deformnb.volume.volume import Volume
from deformnb.widgets import LiveView, TransferEditor

pytestmark = pytest.mark.needs_browser

FUNCTION = TransferFunction(
    ((0, 1, 0, 0), (100, 0, 1, 0), (199, 0, 0, 1)), ((0, 0), (60, 0.01), (120, 0.5), (199, 0.9))
)
STRIP = 34  # CSS pixels from the floor of the plot to the middle of the colours


class Drawn(LivePage):
    """A transfer editor of values from 0 to 199, and what a hand does to it."""

    def __init__(self, browser: Any, widget: TransferEditor, *, width: int = 600, listens: bool = True) -> None:
        super().__init__(browser, (width, 900))
        self.page.emulate_media(color_scheme="light")
        self.heard: list[tuple[Any, str]] = []
        self.widget = widget
        if listens:
            widget.on_edit(lambda value, phase: self.heard.append((value, phase)))
        self.add(widget, "w0")
        self.wait_settled()

    def wait_settled(self) -> None:
        self.wait("document.querySelector('.dnb-curves') && !document.querySelector('.dnb-curves').deformnb.frame")
        self.wait("document.querySelector('.dnb-curves').deformnb.link.waiting.size === 0")
        self.wait("!document.querySelector('.dnb-curves').deformnb.frame")

    def js(self, expression: str) -> Any:
        found = "document.querySelector('.dnb-curves').deformnb"
        return self.page.evaluate(f"() => {{ const w = {found}; return {expression}; }}")

    def at(self, value: float, below: float = 0.0) -> tuple[float, float]:
        """CSS pixels of the window for a value, so far below the floor of the plot."""
        box = self.page.locator(".dnb-cv-svg").bounding_box()
        x, y = self.js(f"w.axes.toPixel([{value}, 0])")
        return box["x"] + x, box["y"] + y + below

    def middle(self, selector: str) -> tuple[float, float]:
        box = self.page.locator(selector).bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def stop(self, k: int) -> tuple[float, float]:
        return self.middle(f"[data-stop='{k}'] .dnb-cv-pin")

    def end(self, part: str) -> tuple[float, float]:
        return self.middle(f"[data-window='{part}'] .dnb-cv-{'span' if part == 'level' else 'end'}")

    def drag(self, start: Any, by: float, *, release: bool = True) -> None:
        self.page.mouse.move(*start)
        self.page.mouse.down()
        self.page.mouse.move(start[0] + by, start[1] + 2, steps=5)
        if release:
            self.page.mouse.up()
        self.wait_settled()

    def per_pixel(self) -> float:
        """Range of values of a pixel."""
        return self.js("(w.axes.ends[0][1] - w.axes.ends[0][0]) / w.axes.box.width")  # type: ignore[no-any-return]

    def chosen(self) -> list[str]:
        """The presets that are marked."""
        return self.page.locator(".dnb-cv-preset[aria-pressed='true']").all_inner_texts()  # type: ignore[no-any-return]

    def key(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)
        self.js("w.settle()")
        self.wait_settled()

    def colour(self, value: float) -> Any:
        """Colour of the strip at a value."""
        seen = np.asarray(Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")).astype(int)
        x, y = self.at(value, STRIP)
        return seen[round(y), round(x)]


@pytest.fixture
def drawn(browser: Any) -> Iterator[Any]:
    pages: list[Drawn] = []

    def draw(transfer: Any = FUNCTION, **options: Any) -> Drawn:
        volume = options.pop("volume", Volume.from_array(np.arange(200, dtype=np.uint8).repeat(8).reshape(40, 5, 8)))
        traits = {k: options.pop(k) for k in ("read_only",) if k in options}
        pages.append(Drawn(browser, TransferEditor(volume, transfer, **traits), **options))
        return pages[-1]

    yield draw
    for page in pages:
        assert page.errors == []
        page.close()


# ---- colours ---------------------------------------------------------------------------------------------------------


def test_a_stop_is_dragged_and_the_strip_follows(drawn: Any) -> None:
    page = drawn()
    page.drag(page.stop(1), 50 / page.per_pixel(), release=False)
    assert page.heard[-1][1] == "move"
    assert page.widget.transfer == FUNCTION
    oracle.assert_close(page.colour(150), (0, 255, 0), atol=12)
    oracle.assert_close(page.colour(75), (127, 127, 0), atol=12)
    page.page.mouse.up()
    page.wait_settled()
    value, *rgb = page.widget.transfer.colors[1]
    assert (value, rgb) == (pytest.approx(150, abs=1), [0, 1, 0])
    assert page.widget.transfer.opacities == FUNCTION.opacities
    assert [c for k, c in enumerate(page.widget.transfer.colors) if k != 1] == [FUNCTION.colors[0], FUNCTION.colors[2]]
    assert page.heard[-1] == (page.widget.transfer, "end")
    assert page.page.locator(".dnb-cv-facts").inner_text() == f"Colour 2 of 3: value {value:g}, colour #00ff00"


def test_a_stop_stays_between_its_neighbours(drawn: Any) -> None:
    page = drawn()
    page.drag(page.stop(0), 400)
    assert [row[0] for row in page.widget.transfer.colors] == [100, 100, 199]


def test_a_double_click_adds_a_stop_that_changes_nothing_and_a_right_click_removes_it(drawn: Any) -> None:
    page = drawn()
    page.page.mouse.dblclick(*page.at(50, STRIP))
    page.wait_settled()
    value, *rgb = page.widget.transfer.colors[1]
    assert len(page.widget.transfer.colors) == 4
    assert value == pytest.approx(50, abs=0.6)
    oracle.assert_close(rgb, [0.5, 0.5, 0], atol=0.01)
    assert len(page.widget.transfer.opacities) == 4  # the double click was for the colours alone
    assert page.js("document.activeElement.getAttribute('aria-label')") == "colour 2 of 4"
    page.page.mouse.click(*page.stop(1), button="right")
    page.wait_settled()
    assert page.widget.transfer.colors == FUNCTION.colors


def test_a_stop_is_recoloured_by_the_browsers_own_input(drawn: Any) -> None:
    page = drawn()
    page.page.locator("[data-stop='1']").focus()
    picker = page.page.locator(".dnb-cv-color")
    page.wait_settled()
    assert picker.input_value() == "#00ff00"
    assert picker.get_attribute("aria-label") == "Colour of stop 2 of 3, at 100"
    picker.evaluate("(e) => { e.value = '#0000ff'; e.dispatchEvent(new Event('input')); }")
    page.wait_settled()
    oracle.assert_close(page.colour(100), (0, 0, 255), atol=12)  # while the colours are still open
    assert [phase for _, phase in page.heard] == ["move"]
    picker.fill("#ff00ff")
    page.wait_settled()
    assert page.widget.transfer.colors[1] == (100, 1, 0, 1)
    assert page.heard[-1][1] == "end"
    oracle.assert_close(page.colour(100), (255, 0, 255), atol=12)
    page.page.locator("[data-stop='2']").focus()
    page.wait_settled()
    assert picker.input_value() == "#0000ff"


def test_stops_are_reached_moved_added_and_removed_by_keys(drawn: Any) -> None:
    page = drawn()
    page.page.locator(".dnb-cv-node").last.focus()
    page.key("Tab", "Tab")
    assert page.js("document.activeElement.getAttribute('aria-label')") == "colour 2 of 3"
    page.key("ArrowRight", "Shift+ArrowRight", "ArrowLeft")
    step = page.per_pixel() * page.js("w.axes.box.width") / 200
    assert page.widget.transfer.colors[1][0] == pytest.approx(100 + 10 * step)
    page.key("a")
    assert len(page.widget.transfer.colors) == 4
    assert page.js("document.activeElement.getAttribute('aria-label')") == "colour 3 of 4"
    page.key("Delete", "Delete")
    assert [row[0] for row in page.widget.transfer.colors] == [0, pytest.approx(100 + 10 * step)]
    page.key("Delete", "Delete")
    assert len(page.widget.transfer.colors) == 1
    assert "One colour stays" in page.page.locator(".dnb-cv-alert").inner_text()
    grip = page.page.locator("[data-stop='0']")
    assert grip.get_attribute("aria-valuetext") == "value 0, colour #ff0000"
    page.key("Enter")
    assert page.js("document.activeElement.className") == "dnb-cv-color"


def test_buttons_work_on_what_was_chosen_last(drawn: Any) -> None:
    page = drawn()
    page.page.mouse.click(*page.stop(0))
    page.page.get_by_label("Add a colour").click()
    page.wait_settled()
    assert [row[0] for row in page.widget.transfer.colors] == [0, 50, 100, 199]
    page.page.get_by_label("Remove the chosen colour").click()
    page.wait_settled()
    assert page.widget.transfer.colors == FUNCTION.colors
    page.page.locator(".dnb-cv-node").nth(1).focus()
    page.page.get_by_label("Add a node").click()
    page.wait_settled()
    assert len(page.widget.transfer.opacities) == 5


def test_a_finger_drags_a_stop_without_scrolling_the_page(drawn: Any) -> None:
    page = drawn()
    page.page.evaluate("document.body.style.height = '4000px'")
    finger, (x, y) = page.page.context.new_cdp_session(page.page), page.stop(1)
    for kind, dx, dy in (("touchStart", 0, 0), ("touchMove", 20, 10), ("touchMove", 60, 60)):
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x + dx, "y": y + dy}]})
    finger.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    page.wait_settled()
    assert page.widget.transfer.colors[1][0] == pytest.approx(100 + 60 * page.per_pixel(), abs=1)
    assert page.page.evaluate("window.scrollY") == 0


# ---- window and level ------------------------------------------------------------------------------------------------


def test_an_end_of_the_window_stretches_nodes_and_colours(drawn: Any) -> None:
    page = drawn()
    page.drag(page.end("low"), 60 / page.per_pixel())
    low, high = page.widget.transfer.window
    assert (low, high) == (pytest.approx(60, abs=1), 199)
    assert page.widget.transfer == FUNCTION.windowed(low, 199)
    page.drag(page.end("high"), -40 / page.per_pixel())
    low, high = page.widget.transfer.window
    assert high == pytest.approx(159, abs=1)
    assert page.js("w.nodes") == [list(node) for node in page.widget.transfer.opacities]
    assert {phase for _, phase in page.heard} == {"move", "end"}
    facts = page.page.locator(".dnb-cv-facts").inner_text()
    assert facts.startswith("Window ")
    assert f"width {round(high - low)}" in facts


def test_the_whole_window_is_moved_by_its_middle_and_by_keys(drawn: Any) -> None:
    page = drawn(FUNCTION.windowed(50, 90))
    page.drag(page.end("level"), 30 / page.per_pixel())
    low, high = page.widget.transfer.window
    assert (low, high - low) == (pytest.approx(80, abs=1), pytest.approx(40))
    page.page.locator("[data-window='level']").focus()
    page.key("ArrowRight", "ArrowRight")
    step = 199 / 200
    assert page.widget.transfer.window == (pytest.approx(low + 2 * step), pytest.approx(high + 2 * step))
    page.page.locator("[data-window='high']").focus()
    page.key("Shift+ArrowLeft")
    assert page.widget.transfer.window == (pytest.approx(low + 2 * step), pytest.approx(high - 8 * step))
    grip = page.page.locator("[data-window='low']")
    assert grip.get_attribute("aria-label") == "window, low end"
    assert float(grip.get_attribute("aria-valuenow")) == pytest.approx(low + 2 * step)
    assert page.page.get_by_role("slider", name="window, level: all values").count() == 1


def test_a_window_keeps_a_width_and_goes_a_little_beyond_the_values(drawn: Any) -> None:
    page = drawn()
    page.drag(page.end("low"), 2000)
    low, high = page.widget.transfer.window
    assert 0 < high - low < 1
    page.drag(page.end("high"), 2000)
    assert page.widget.transfer.window[1] == pytest.approx(399.5, abs=1)  # as far again as there are values


def test_escape_gives_the_preset_back(drawn: Any) -> None:
    page = drawn("bone")
    before = page.widget.transfer
    for start in (page.end("low"), page.stop(1)):
        page.drag(start, 40, release=False)
        assert page.heard[-1][0] != before
        page.key("Escape")
        page.page.mouse.up()
        page.wait_settled()
        assert page.widget.transfer == before
        assert page.heard[-1] == (before, "end")
        assert page.chosen() == ["bone"]


def test_reset_takes_the_last_preset_again(drawn: Any) -> None:
    page = drawn("bone")
    button, note = page.page.get_by_role("button", name="Reset"), page.page.locator(".dnb-cv-note")
    assert button.get_attribute("aria-disabled") == "true"
    page.drag(page.end("low"), 40)
    assert page.chosen() == []
    assert note.inner_text() == "not part of undo; Reset takes bone again"
    button.click()
    page.wait_settled()
    assert page.widget.transfer == preset("bone", page.widget.volume)
    assert page.chosen() == ["bone"]
    assert button.get_attribute("aria-disabled") == "true"


def test_presets_are_pictures_of_this_volume_and_buttons(drawn: Any) -> None:
    page = drawn("specimen", volume=PHANTOMS["fish"].make((24, 48, 24)))
    page.wait("[...document.querySelectorAll('.dnb-cv-thumbnail')].filter((i) => i.naturalWidth > 100).length === 5")
    group = page.page.get_by_role("group", name="Presets")
    assert group.get_by_role("button").all_inner_texts() == list(PRESETS)
    assert page.chosen() == ["specimen"]
    group.get_by_role("button", name="bone").click()
    page.wait_settled()
    assert page.widget.transfer == preset("bone", page.widget.volume)
    assert page.chosen() == ["bone"]
    page.key("Tab", "Enter")
    assert page.widget.transfer == preset("muscle", page.widget.volume)
    sources = page.page.locator(".dnb-cv-thumbnail").evaluate_all("(all) => all.map((i) => i.src)")
    assert len(set(sources)) == 5


# ---- zoom ------------------------------------------------------------------------------------------------------------


def test_the_values_are_zoomed_by_buttons_and_a_node_is_dragged_finely(drawn: Any) -> None:
    page = drawn()
    page.page.locator(".dnb-cv-node").nth(2).focus()
    before = page.at(120)
    for _ in range(3):
        page.page.get_by_label("Zoom into").click()
    page.wait_settled()
    assert page.js("w.axes.ends[0][1] - w.axes.ends[0][0]") == pytest.approx(199 / 8)
    assert page.at(120) == pytest.approx(before, abs=0.01)  # about the chosen node
    assert page.page.locator(".dnb-cv-node:visible").count() == 1
    x, y = page.middle("[data-node='2'] .dnb-cv-dot")
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 20, y, steps=4)
    page.page.mouse.up()
    page.wait_settled()
    assert page.widget.transfer.opacities[2][0] == pytest.approx(120 + 20 * page.per_pixel(), abs=0.05)
    assert page.per_pixel() < 0.06
    page.page.get_by_label("Show all").click()
    page.wait_settled()
    assert page.js("w.axes.ends[0]") == [0, 199]
    assert page.page.locator(".dnb-cv-node:visible").count() == 4


def test_the_wheel_zooms_once_someone_works_here_and_else_scrolls(drawn: Any) -> None:
    page = drawn()
    page.page.evaluate("document.body.style.height = '4000px'")
    page.page.mouse.move(*page.at(150, -40))
    page.page.mouse.wheel(0, 100)
    page.wait("window.scrollY > 50")
    assert page.js("w.axes.zoom") is None
    page.page.evaluate("window.scrollTo(0, 0)")
    page.wait("window.scrollY === 0")
    page.page.locator(".dnb-cv-node").nth(1).focus()
    x, y = page.at(150, -40)
    page.page.mouse.move(x, y)
    page.page.mouse.wheel(0, -400)
    page.wait("document.querySelector('.dnb-curves').deformnb.axes.zoom")
    page.wait_settled()
    assert page.at(150)[0] == pytest.approx(x, abs=1)  # about the pointer
    assert page.page.evaluate("window.scrollY") == 0
    low = page.js("w.axes.ends[0][0]")
    page.page.mouse.down()
    page.page.mouse.move(x + 50, y, steps=3)
    page.page.mouse.up()
    page.wait_settled()
    assert page.js("w.axes.ends[0][0]") == pytest.approx(low - 50 * page.per_pixel(), abs=0.01)  # drawn along
    assert page.heard == []


def test_the_window_fills_the_plot_on_demand_and_keys_go_back(drawn: Any) -> None:
    page = drawn(FUNCTION.windowed(100, 110))
    page.page.mouse.dblclick(*page.end("level"))
    page.wait_settled()
    assert page.js("w.axes.ends[0]") == [pytest.approx(99), pytest.approx(111)]
    assert page.page.locator(".dnb-cv-node:visible").count() == 4
    page.page.locator("[data-stop='1']").focus()
    page.key("0")
    assert page.js("w.axes.zoom") is None
    page.key("+")
    assert page.js("w.axes.ends[0][1] - w.axes.ends[0][0]") == pytest.approx(99.5)
    page.key("-")
    assert page.js("w.axes.zoom") is None
    assert page.widget.transfer == FUNCTION.windowed(100, 110)


def test_bars_that_are_finer_than_a_pixel_are_seen_apart_when_zoomed(browser: Any) -> None:
    values = np.zeros((20, 40, 50), np.int16)
    values[5:15] = np.repeat(np.arange(0, 4000, 2, dtype=np.int16), 10).reshape(10, 40, 50)
    values[7, :20] = 2400  # a peak two values wide
    page = Drawn(browser, TransferEditor(Volume.from_array(values)), listens=False)
    assert len(page.widget.histogram["heights"]) > 900

    def bars() -> int:
        return page.js("w.background.bars.getAttribute('d').split('H').length - 2")  # type: ignore[no-any-return]

    assert bars() < page.js("w.axes.box.width") / 1.5 + 1
    high = page.page.locator(".dnb-cv-bars").bounding_box()["height"]
    page.js("w.axes.zoomTo([2300, 2500])")
    page.wait_settled()
    assert bars() > 900
    ink = np.asarray(Image.open(io.BytesIO(page.page.screenshot())).convert("RGB")).astype(int)

    def pixel_at(value: float) -> Any:
        x, y = page.at(value, -0.6 * high)
        return ink[round(y), round(x)]

    assert (pixel_at(2401) < pixel_at(2450) - 10).all()
    page.close()


def test_what_an_arrow_key_takes_beyond_the_edge_is_seen_again(drawn: Any) -> None:
    page = drawn()
    page.js("w.axes.zoomTo([118, 122])")
    page.wait_settled()
    page.page.locator("[data-node='2']").focus()
    page.key(*["Shift+ArrowRight"] * 12)
    assert page.widget.transfer.opacities[2][0] == pytest.approx(122.4)
    assert page.js("w.axes.ends[0]") == [pytest.approx(118.4), pytest.approx(122.4)]
    assert page.js("document.activeElement.dataset.node") == "2"


# ---- the rest --------------------------------------------------------------------------------------------------------


def test_colours_that_are_only_shown_cannot_be_changed(drawn: Any) -> None:
    page = drawn(read_only=True)
    page.drag(page.stop(1), 40)
    page.drag(page.end("low"), 40)
    page.page.mouse.dblclick(*page.at(50, STRIP))
    page.page.locator("[data-stop='1']").focus()
    page.key("ArrowRight", "a", "Delete", "Enter")
    page.page.locator("[data-window='level']").focus()
    page.key("ArrowRight")
    assert page.page.locator(".dnb-cv-color").is_disabled()
    assert page.page.locator(".dnb-cv-preset:disabled").count() == len(PRESETS)
    assert page.heard == []


def test_nobody_hears_of_movements_who_did_not_ask(drawn: Any) -> None:
    page = drawn(listens=False)
    page.drag(page.stop(1), 40)
    page.drag(page.end("low"), 40)
    assert [m["phase"] for m in page.js("w.model.sent")] == ["end", "end"]


def test_the_volume_is_recoloured_while_the_mouse_is_down(browser: Any) -> None:
    volume = PHANTOMS["bar"].make((16, 16, 24))
    view, editor = LiveView(volume, transfer="surface", width=240, height=160), TransferEditor(volume, "surface")
    page = Drawn(browser, editor)
    page.add(view, "view")
    page.wait_loaded()
    editor.on_edit(lambda transfer, _phase: view.set_transfer(transfer))
    before = page.pixels().astype(int)
    last = len(editor.transfer.colors) - 1
    page.page.locator(f"[data-stop='{last}']").focus()
    for k in range(last + 1):
        page.page.locator(f"[data-stop='{k}']").focus()
        page.page.locator(".dnb-cv-color").fill("#0000ff")
        page.wait_settled()
    blue = page.pixels().astype(int)
    subject = np.abs(blue - before).sum(axis=-1) > 60
    assert subject.sum() > 500
    assert (blue[subject][:, 2] - blue[subject][:, 0] > 20).mean() > 0.9
    page.drag(page.end("low"), 300, release=False)
    page.wait("document.querySelector('.dnb-curves').deformnb.link.waiting.size === 0")
    less = page.pixels().astype(int)
    assert (np.abs(less - blue).sum(axis=-1) > 30).sum() > 500
    page.page.mouse.up()
    assert page.errors == []
    page.close()

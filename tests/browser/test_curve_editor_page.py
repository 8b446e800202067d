"""Curve editor, transfer editor and keys in a page, with a real mouse, real keys and a finger."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import oracle
import pytest
from browser.live_page import LivePage
from PIL import Image

from deformnb.volume.transfer import TransferFunction, preset
from deformnb.volume.volume import Volume
from deformnb.widgets import CurveEditor, DepthKeys, TransferEditor

pytestmark = pytest.mark.needs_browser

TENT = [(0.0, 0.0), (0.25, 1.0), (0.5, 0.5), (1.0, -0.5)]
KINDS = ["curve", "formula", "transfer", "keys"]


class Drawn(LivePage):
    """Widgets drawn one below the other; ``at`` and ``drag`` look at the first of them."""

    def __init__(self, browser: Any, *widgets: Any, width: int = 420, draws: int = 1, dark: bool = False) -> None:
        super().__init__(browser, (width, 900))
        self.page.emulate_media(color_scheme="dark" if dark else "light")
        self.heard: list[tuple[Any, str]] = []
        for k, widget in enumerate(widgets):
            self.add(widget, f"w{k}", draw=False)
            for _ in range(draws):
                self.draw(f"w{k}")
        self.widget = widgets[0] if widgets else None
        self.wait_settled()

    def listen(self) -> None:
        self.widget.on_edit(lambda value, phase: self.heard.append((value, phase)))

    def wait_settled(self) -> None:
        self.wait("[...document.querySelectorAll('.dnb-curves')].every((e) => !e.deformnb.frame)")
        self.wait("true")

    def js(self, expression: str) -> Any:
        """Of an expression in ``w``, the page of the first widget."""
        found = "document.querySelector('.dnb-curves').deformnb"
        return self.page.evaluate(f"() => {{ const w = {found}; return {expression}; }}")

    def at(self, place: Any) -> tuple[float, float]:
        """CSS pixels of the window for a place (x, y) of the plot, or a depth of the bar."""
        box = self.page.locator(".dnb-cv-svg").first.bounding_box()
        x, y = (
            self.js(f"w.axes.toPixel({json.dumps(place)})")
            if isinstance(place, tuple | list)
            else (self.js(f"w.toPixel({place})"), 42)
        )
        return box["x"] + x, box["y"] + y

    def drag(self, start: Any, end: Any, *, steps: int = 6, release: bool = True) -> None:
        self.page.mouse.move(*self.at(start))
        self.page.mouse.down()
        self.page.mouse.move(*self.at(end), steps=steps)
        if release:
            self.page.mouse.up()
        self.wait_settled()

    def key(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(key)
        self.wait_settled()

    def focus(self, index: int) -> None:
        self.page.locator(".dnb-cv-node").nth(index).focus()

    def pixels(self) -> np.ndarray:  # type: ignore[override]
        return np.asarray(Image.open(io.BytesIO(self.page.screenshot())).convert("RGB")).astype(int)

    def sent(self, kind: str) -> list[Any]:
        return [m["phase"] for m in self.js("w.model.sent") if m["type"] == kind]


@pytest.fixture
def drawn(browser: Any) -> Iterator[Any]:
    pages: list[Drawn] = []

    def draw(*widgets: Any, **options: Any) -> Drawn:
        pages.append(Drawn(browser, *widgets, **options))
        return pages[-1]

    yield draw
    for page in pages:
        assert page.errors == []
        page.close()


def tent(**traits: Any) -> CurveEditor:
    editor = CurveEditor(**traits)
    editor.set_nodes(TENT)
    return editor


def volume() -> Volume:
    return Volume.from_array(np.arange(200, dtype=np.uint8).repeat(8).reshape(40, 5, 8))


def transfer() -> TransferEditor:
    function = TransferFunction(((0, 1, 0, 0), (199, 0, 0, 1)), ((0, 0), (60, 0.01), (120, 0.5), (199, 0.9)))
    return TransferEditor(volume(), function)


def make_editor(kind: str, **traits: Any) -> Any:
    if kind == "curve":
        return tent(**traits)
    if kind == "formula":
        return CurveEditor("sin(pi*z)", **traits)
    return TransferEditor(volume(), **traits) if kind == "transfer" else DepthKeys((0.0, 0.5, 1.0), **traits)


# ---- dragging --------------------------------------------------------------------------------------------------------


def test_a_node_is_dragged_to_where_the_mouse_goes(drawn: Any) -> None:
    page = drawn(tent())
    page.listen()
    page.drag((0.5, 0.5), (0.75, -0.25))
    assert page.widget.nodes[2] == (0.75, pytest.approx(-0.25, abs=0.02))
    assert [n for k, n in enumerate(page.widget.nodes) if k != 2] == [TENT[0], TENT[1], TENT[3]]
    phases = [phase for _, phase in page.heard]
    assert phases[-1] == "end"
    assert set(phases[:-1]) == {"move"}
    assert page.heard[-1][0] == page.widget.curve
    assert page.js("w.nodes") == [list(node) for node in page.widget.nodes]


def test_nobody_hears_of_movements_who_did_not_ask(drawn: Any) -> None:
    page = drawn(tent())
    page.drag((0.5, 0.5), (0.6, 0.0))
    assert page.sent("edit") == ["end"]


def test_during_a_drag_python_hears_and_keeps_its_curve(drawn: Any) -> None:
    page = drawn(tent())
    page.listen()
    before = page.widget.curve
    page.drag((0.5, 0.5), (0.6, 0.0), release=False)
    page.wait("document.querySelector('.dnb-curves').deformnb.link.waiting.size === 0")
    assert page.heard[-1][1] == "move"
    assert page.heard[-1][0] != before
    assert page.widget.curve == before
    page.key("Escape")
    page.page.mouse.up()
    page.wait_settled()
    assert page.widget.curve == before
    assert page.heard[-1] == (before, "end")  # whoever followed comes back
    assert page.js("w.nodes") == [list(node) for node in TENT]


def test_outer_nodes_move_up_and_down_only(drawn: Any) -> None:
    page = drawn(tent())
    page.drag((1.0, -0.5), (0.7, 0.75))
    assert page.widget.nodes[3] == (1.0, pytest.approx(0.75, abs=0.02))


def test_a_node_stays_between_its_neighbours_and_in_the_plot(drawn: Any) -> None:
    page = drawn(tent())
    page.drag((0.5, 0.5), (0.1, 9.0))
    assert page.widget.nodes[2] == (0.25 + 1 / 128, 1.5)


def test_nodes_snap_to_nothing_and_to_all(drawn: Any) -> None:
    page = drawn(tent())
    x, y = page.at((0.75, 0.0))
    page.page.mouse.move(*page.at((0.5, 0.5)))
    page.page.mouse.down()
    page.page.mouse.move(x, y + 3, steps=4)
    page.page.mouse.up()
    page.wait_settled()
    assert page.widget.nodes[2][1] == 0.0


def test_a_click_changes_nothing(drawn: Any) -> None:
    page = drawn(CurveEditor("sin(pi*z)"))
    page.page.mouse.click(*page.at((0.5, 1.0)))
    page.wait_settled()
    assert page.widget.curve == "sin(pi*z)"
    assert page.sent("edit") == []
    assert page.js("document.activeElement.getAttribute('aria-label')") == "node 5 of 9"


def test_a_finger_drags_up_without_scrolling_the_page(drawn: Any) -> None:
    page = drawn(tent())
    page.page.evaluate("document.body.style.height = '4000px'")
    finger = page.page.context.new_cdp_session(page.page)

    def touch(kind: str, *places: Any) -> None:
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [{"x": x, "y": y} for x, y in places]})

    touch("touchStart", page.at((0.5, 0.5)))
    for y in (0.3, 0.0, -0.4, -0.75):
        touch("touchMove", page.at((0.5, y)))
    touch("touchEnd")
    page.wait_settled()
    assert page.widget.nodes[2] == (0.5, pytest.approx(-0.75, abs=0.02))
    assert page.page.evaluate("window.scrollY") == 0


# ---- nodes come and go -----------------------------------------------------------------------------------------------


def test_a_double_click_adds_and_a_right_click_removes(drawn: Any) -> None:
    page = drawn(tent())
    page.page.mouse.dblclick(*page.at((0.75, 0.7)))
    page.wait_settled()
    assert len(page.widget.nodes) == 5
    assert page.widget.nodes[3] == (0.75, pytest.approx(0.7, abs=0.02))
    page.page.mouse.click(*page.at(page.widget.nodes[3]), button="right")
    page.wait_settled()
    assert page.widget.nodes == tuple(TENT)


def test_keys_add_move_and_remove(drawn: Any) -> None:
    page = drawn(tent())
    page.focus(1)
    page.key("a")
    assert page.widget.nodes[2] == (0.375, 0.75)
    assert page.js("document.activeElement.dataset.node") == "2"
    page.key("ArrowRight", "Shift+ArrowDown")
    assert page.widget.nodes[2] == (0.375 + 1 / 128, pytest.approx(0.5, abs=1e-3))  # a tenth of the height of 2.5
    page.key("Delete")
    assert page.widget.nodes == tuple(TENT)
    page.focus(0)
    page.key("Delete")
    assert page.widget.nodes == tuple(TENT)
    assert "outer nodes stay" in page.page.locator(".dnb-cv-alert").inner_text()


def test_an_arrow_key_that_is_held_is_one_edit(drawn: Any) -> None:
    page = drawn(tent())
    page.focus(2)
    for _ in range(5):
        page.page.keyboard.down("ArrowRight")
    page.page.keyboard.up("ArrowRight")
    page.wait_settled()
    assert page.widget.nodes[2][0] == 0.5 + 5 / 128
    assert page.sent("edit") == ["end"]


def test_buttons_add_and_remove(drawn: Any) -> None:
    page = drawn(tent())
    page.focus(2)
    page.page.get_by_label("Add a node").click()
    page.wait_settled()
    assert page.widget.nodes[3] == (0.75, pytest.approx(0.0, abs=1e-3))
    page.page.get_by_label("Remove the chosen").click()
    page.wait_settled()
    assert page.widget.nodes == tuple(TENT)


# ---- formulas --------------------------------------------------------------------------------------------------------


def test_a_formula_is_drawn_where_it_runs(drawn: Any) -> None:
    page = drawn(CurveEditor("1-2*z*z"))
    ink = page.pixels()
    is_line = np.abs(ink - [0, 0x72, 0xB2]).sum(axis=-1) < 60
    for z in (0.06, 0.31, 0.44, 0.69, 0.81, 0.94):
        x, y = page.at((z, 1 - 2 * z * z))
        rows = np.flatnonzero(is_line[:, round(x)])
        rows = rows[rows > page.page.locator(".dnb-cv-svg").bounding_box()["y"]]
        assert len(rows)
        assert abs(rows.mean() - y) < 2.5


def test_picking_up_a_node_turns_a_formula_into_nodes(drawn: Any) -> None:
    page = drawn(CurveEditor("sin(pi*z)"))
    assert page.page.locator(".dnb-cv-input").input_value() == "sin(pi*z)"
    assert page.js("w.chooser.value") == "sin(pi*z)"
    page.drag((0.5, 1.0), (0.5, 0.25))
    assert len(page.widget.nodes) == 9
    oracle.assert_close(page.widget.nodes[3], [0.375, np.sin(0.375 * np.pi)], atol=1e-3)
    assert page.widget.nodes[4] == (0.5, pytest.approx(0.25, abs=0.02))
    assert page.page.locator(".dnb-cv-input").input_value() == ""
    assert page.js("w.chooser.value") == ""


def test_a_wrong_formula_is_explained_below_and_can_be_corrected(drawn: Any) -> None:
    page = drawn(CurveEditor("z"))
    field, alert = page.page.locator(".dnb-cv-input"), page.page.locator(".dnb-cv-alert")
    field.fill("sin(q)")
    field.press("Enter")
    field.blur()
    page.wait("!document.querySelector('.dnb-cv-alert').hidden")
    page.wait_settled()
    assert "'q' is something else" in alert.inner_text()
    assert page.sent("edit") == ["end"]  # asked once
    assert alert.bounding_box()["y"] > page.page.locator(".dnb-cv-svg").bounding_box()["y"]
    assert field.input_value() == "sin(q)"
    assert field.get_attribute("aria-invalid") == "true"
    assert (page.widget.curve, page.js("w.samples")[128]) == ("z", 0.5)
    field.fill("z^2")
    field.press("Enter")
    page.wait_settled()
    assert page.widget.curve == "z^2"
    assert not alert.is_visible()
    assert page.js("w.samples")[128] == pytest.approx(0.25)
    field.fill("nonsense")
    field.press("Escape")
    page.wait_settled()
    assert field.input_value() == "z^2"
    page.page.locator(".dnb-cv-node").first.focus()
    page.wait_settled()
    assert page.widget.curve == "z^2"


def test_ready_made_curves(drawn: Any) -> None:
    page = drawn(tent())
    page.page.locator(".dnb-cv-select").select_option("smoothstep")
    page.wait_settled()
    assert page.widget.curve == "z*z*(3-2*z)"
    assert page.page.locator(".dnb-cv-input").input_value() == "z*z*(3-2*z)"
    page.page.locator(".dnb-cv-select").select_option("constant 1")
    page.wait_settled()
    assert page.widget.values(3) == (1.0, 1.0, 1.0)


def test_lines_are_rounded_by_a_button(drawn: Any) -> None:
    page = drawn(tent())
    page.page.get_by_role("button", name="Smooth").click()
    page.wait_settled()
    assert page.widget.smooth
    assert len(page.widget.curve) == 129
    assert page.page.get_by_role("button", name="Smooth").get_attribute("aria-pressed") == "true"


def test_a_curve_beyond_the_range_makes_the_plot_grow(drawn: Any) -> None:
    page = drawn(CurveEditor("4*z"))
    assert page.js("w.axes.ends[1]") == [-1, 4]
    page.widget.range = (-8.0, 2.0)
    page.wait_settled()
    assert page.js("w.axes.ends[1]") == [-8, 4]


# ---- Python and other views ------------------------------------------------------------------------------------------


def test_python_changes_what_is_seen(drawn: Any) -> None:
    page = drawn(tent())
    page.widget.curve = (1.0, 0.0)
    page.wait_settled()
    assert page.js("w.nodes") == [[0, 1], [1, 0]]
    assert page.page.locator(".dnb-cv-node").count() == 2


def test_two_views_show_the_same(drawn: Any) -> None:
    page = drawn(tent(), draws=2)
    page.drag((0.5, 0.5), (0.625, 0.0))
    views = page.page.evaluate("[...document.querySelectorAll('.dnb-curves')].map((e) => e.deformnb.nodes)")
    assert views == [[list(node) for node in page.widget.nodes]] * 2


def test_old_news_do_not_undo_an_edit(drawn: Any) -> None:
    page = drawn(tent())
    page.page.evaluate("window.toPython = () => {}")  # a kernel that is busy
    page.drag((0.5, 0.5), (0.625, 0.0))
    edited = page.js("w.nodes")
    stale = page.widget.shown
    page.widget.shown = {**stale, "nodes": [[0, 1], [1, 1]]}
    page.wait_settled()
    assert page.js("w.nodes") == edited
    page.widget.shown = {**stale, "nodes": [[0, 1], [1, 1]], "seen": {page.js("w.link.id"): 1}}
    page.wait_settled()
    assert page.js("w.nodes") == [[0, 1], [1, 1]]


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_read_only_cannot_be_changed(drawn: Any, kind: str) -> None:
    page = drawn(make_editor(kind, read_only=True))
    node = page.page.locator(".dnb-cv-node").nth(1)
    box = node.bounding_box()
    page.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + 60, box["y"] - 20, steps=3)
    page.page.mouse.up()
    node.focus()
    page.key("ArrowLeft", "Delete", "a", "Enter")
    for button in page.page.locator(".dnb-cv-button").all():
        button.click(force=True)
    page.page.mouse.dblclick(*page.at(0.3 if kind == "keys" else (page.js("w.axes.ends[0][1]") * 0.3, 0.9)))
    page.wait_settled()
    assert page.sent("edit") == []


@pytest.mark.parametrize("kind", KINDS)
def test_it_leaves_nothing_behind(drawn: Any, kind: str) -> None:
    page = drawn(make_editor(kind))
    page.page.evaluate("models.w0.cleanups.forEach((f) => f())")
    assert page.page.locator(".dnb-curves").count() == 0
    page.widget.theme = "dark"
    page.frames()


# ---- transfer functions ----------------------------------------------------------------------------------------------


def test_an_opacity_is_dragged(drawn: Any) -> None:
    page = drawn(transfer())
    page.listen()
    page.drag((120, 0.5), (140, 0.1))
    value, alpha = page.widget.transfer.opacities[2]
    assert value == pytest.approx(140, abs=0.7)
    assert alpha == pytest.approx(0.1, rel=0.1)
    assert {phase for _, phase in page.heard} == {"move", "end"}
    assert page.heard[-1][0] is page.widget.transfer
    assert page.widget.transfer.colors == transfer().transfer.colors


def test_small_opacities_have_room_and_none_leaves_the_plot(drawn: Any) -> None:
    page = drawn(transfer())
    floor, small, half, one = (page.at((60, alpha))[1] for alpha in (0.0, 0.01, 0.5, 1.0))
    assert floor - small > 15
    assert half - one > 15
    page.drag((60, 0.01), (60, -5.0))
    assert page.widget.transfer.opacities[1] == (pytest.approx(60, abs=0.7), 0.0)
    page.page.mouse.move(*page.at((199, 0.9)))
    page.page.mouse.down()
    page.page.mouse.move(600, 0)
    page.page.mouse.up()
    page.wait_settled()
    assert page.widget.transfer.opacities[3] == (199.0, 1.0)


def test_a_preset_is_chosen(drawn: Any) -> None:
    page = drawn(transfer())
    marked = page.page.locator("[aria-pressed='true']")
    assert marked.count() == 0
    page.page.get_by_role("button", name="bone").click()
    page.wait_settled()
    assert page.widget.transfer == preset("bone", page.widget.volume)
    assert page.js("w.nodes.length") == 4
    assert marked.all_inner_texts() == ["bone"]
    page.focus(2)
    page.key("ArrowUp")
    assert marked.count() == 0


def test_bars_and_colours_are_where_the_values_are(drawn: Any) -> None:
    values = np.zeros((20, 100, 10), np.uint8)
    values[:, 50:] = 150
    values[0, 0, 0] = 199
    flat = TransferFunction(((0, 1, 0, 0), (100, 0, 1, 0), (199, 0, 0, 1)), ((0, 0), (199, 0)))
    page = drawn(TransferEditor(Volume.from_array(values), flat))
    ink = page.pixels()

    def pixel_at(value: float, up: float) -> Any:
        x, y = page.at((value, 0))
        return ink[round(y - up), round(x)]

    height = page.js("w.axes.box.height")
    paper = pixel_at(75, 0.5 * height)
    assert (pixel_at(150, 0.9 * height) < paper - 15).all()  # half the voxels: as high as the air
    assert (pixel_at(152, 0.9 * height) == paper).all()
    for value, colour in ((15, (217, 38, 0)), (50, (127, 127, 0)), (100, (0, 255, 0)), (185, (0, 36, 219))):
        oracle.assert_close(pixel_at(value, -34), colour, atol=12)


# ---- keys ------------------------------------------------------------------------------------------------------------


def test_a_key_is_dragged_and_selected(drawn: Any) -> None:
    page = drawn(DepthKeys((0.0, 0.5, 1.0)))
    page.listen()
    page.drag(0.5, 0.7)
    assert page.widget.knots == (0.0, pytest.approx(0.7, abs=0.005), 1.0)
    assert page.widget.selected == 1
    edit, phase = page.heard[-1]
    assert (edit.kind, edit.index, phase) == ("move", 1, "end")
    page.drag(0.0, 0.9)
    assert page.widget.knots[:2] == (pytest.approx(page.widget.knots[1] - 0.01), pytest.approx(0.7, abs=0.005))


def test_a_click_selects_a_key_and_moves_none(drawn: Any) -> None:
    page = drawn(DepthKeys((0.0, 0.5, 1.0)))
    page.listen()
    page.page.mouse.click(*page.at(1.0))
    page.wait_settled()
    assert (page.widget.selected, page.widget.knots) == (2, (0.0, 0.5, 1.0))
    assert [(e.kind, e.index, p) for e, p in page.heard] == [("select", 2, "end")]
    assert page.page.locator(".dnb-cv-facts").inner_text() == "Key 3 of 3 at depth 1"
    page.page.mouse.click(*page.at(1.0))
    page.wait_settled()
    assert len(page.heard) == 1


def test_keys_come_and_go(drawn: Any) -> None:
    page = drawn(DepthKeys((0.0, 1.0)))
    page.listen()
    page.page.mouse.dblclick(*page.at(0.3))
    page.wait_settled()
    assert page.widget.knots == (0.0, pytest.approx(0.3, abs=0.005), 1.0)
    assert page.widget.selected == 1
    page.page.get_by_label("Add a key").click()
    page.wait_settled()
    assert page.widget.knots[2] == pytest.approx(0.65, abs=0.005)
    page.page.mouse.click(*page.at(page.widget.knots[1]), button="right")
    page.wait_settled()
    assert len(page.widget.knots) == 3
    assert page.widget.selected == 1  # still the one added last
    for _ in range(3):
        page.page.get_by_label("Remove the selected").click(force=True)
    page.wait_settled()
    assert len(page.widget.knots) == 1
    assert [(e.kind, e.index) for e, _ in page.heard] == [
        ("add", 1),
        ("add", 2),
        ("remove", 1),
        ("remove", 1),
        ("remove", 1),
    ]
    assert "One key stays" in page.page.locator(".dnb-cv-alert").inner_text()


def test_keys_of_the_keyboard(drawn: Any) -> None:
    page = drawn(DepthKeys((0.0, 0.5, 1.0)))
    page.focus(1)
    page.key("Enter", "ArrowRight", "Shift+ArrowRight")
    assert page.widget.selected == 1
    assert page.widget.knots == (0.0, 0.61, 1.0)
    page.key("Delete")
    assert page.widget.knots == (0.0, 1.0)
    page.key("a")
    assert page.widget.knots == (0.0, 0.5, 1.0)


@pytest.mark.parametrize("kind", ["curve", "transfer", "keys"])
def test_a_click_with_ctrl_removes_nothing_for_on_a_mac_it_opens_menus(drawn: Any, kind: str) -> None:
    page = drawn(make_editor(kind))
    marks = page.page.locator(".dnb-cv-node, .dnb-cv-grip[data-stop]")
    before = marks.count()
    for mark in (marks.nth(1), marks.last):
        box = mark.locator(".dnb-cv-dot, .dnb-cv-pin").bounding_box()
        page.page.keyboard.down("Control")
        page.page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2, button="right")
        page.page.keyboard.up("Control")
    page.wait_settled()
    assert marks.count() == before
    assert page.sent("edit") == []


# ---- how it looks ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_a_style_sheet_may_come_late_and_the_page_may_change_its_width(drawn: Any, kind: str) -> None:
    page = drawn(width=700)
    page.add(make_editor(kind), "late", draw=False)
    of_widget = page.widgets["late"].get_state(["_css", "_esm"])
    page.page.evaluate("([n, s]) => draw(n, s)", ["late", of_widget["_esm"]])
    page.page.add_style_tag(content=of_widget["_css"])
    for width in (700, 500):
        page.page.set_viewport_size({"width": width, "height": 900})
        page.wait(f"document.querySelector('.dnb-cv-svg').getAttribute('viewBox').startsWith('0 0 {width - 2} ')")
        page.wait_settled()


def test_small_opacities_are_labelled_as_such(drawn: Any) -> None:
    page = drawn(transfer(), width=900)
    assert page.page.locator(".dnb-cv-text").all_text_contents()[:6] == ["0", "0.001", "0.01", "0.1", "0.5", "1"]


@pytest.mark.parametrize("width", [300, 420, 900])
@pytest.mark.parametrize("kind", KINDS)
def test_nothing_is_cut_off(drawn: Any, kind: str, width: int) -> None:
    page = drawn(make_editor(kind), width=width)
    assert page.page.evaluate("document.documentElement.scrollWidth") <= width
    beyond = page.js("""[...w.root.querySelectorAll('text, .dnb-cv-dot, .dnb-cv-end, .dnb-cv-ring, button, select, '
        + 'input, span')].filter((e) => {
        const a = e.getBoundingClientRect(), b = w.root.getBoundingClientRect();
        return a.width && (a.left < b.left || a.right > b.right || a.top < b.top || a.bottom > b.bottom); }).length""")
    assert beyond == 0
    overlaps = page.js("""(() => {
        const boxes = [...w.svg.querySelectorAll('.dnb-cv-text')].map((e) => e.getBoundingClientRect());
        return boxes.filter((a, k) => boxes.some((b, j) => j > k && a.left < b.right && b.left < a.right
          && a.top + 3 < b.bottom && b.top + 3 < a.bottom)).length; })()""")
    assert overlaps == 0


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_light_and_dark_can_be_read(drawn: Any, kind: str, dark: bool) -> None:
    page = drawn(make_editor(kind), dark=dark)
    colours = page.js("""(() => {
        const rgb = (e, p) => getComputedStyle(e)[p].match(/[\\d.]+/g).slice(0, 3).map(Number);
        const text = w.root.querySelector(".dnb-cv-text");
        return [rgb(w.root, "backgroundColor"), rgb(text, "fill"), rgb(w.root, "color")];
        })()""")
    paper, soft, ink = (0.2126 * r + 0.7152 * g + 0.0722 * b for r, g, b in colours)
    assert (paper < 60) == dark
    assert abs(soft - paper) > 90
    assert abs(ink - paper) > 160
    page.widget.theme = "light" if dark else "dark"
    page.wait_settled()
    assert page.js("w.root.classList.contains('dnb-dark')") is not dark


@pytest.mark.parametrize("kind", KINDS)
def test_everything_is_named_and_keeps_its_own_keys(drawn: Any, kind: str) -> None:
    page = drawn(make_editor(kind))
    found = page.js("""[...w.root.querySelectorAll('button, input, select, [tabindex]')].map((e) =>
        [e.dataset.lmSuppressShortcuts, Boolean(e.getAttribute('aria-label') || e.textContent.trim())])""")
    assert len(found) >= 5
    assert {tuple(row) for row in found} == {("true", True)}
    slider = page.page.get_by_role("slider").nth(1)
    assert slider.get_attribute("aria-valuetext")
    assert float(slider.get_attribute("aria-valuemin")) <= float(slider.get_attribute("aria-valuenow"))

"""The table of points in a real browser, beside an editor: names, switches, coordinates, keys, thousands of rows."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage, five_points, smooth_picture
from browser.live_page import LivePage
from widgets.studio.panels.test_steps_history import Guarded

from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.editor.space_slices import PANES, Pane
from deformnb.widgets.inputs.points_table import PointsTable
from deformnb.widgets.studio.panels.points import PointsPanel
from deformnb.widgets.studio.panels.steps import HistoryPanel

pytestmark = pytest.mark.needs_browser

TABLE = "document.querySelector('.dnb-points-table').deformnb"


class TableOnPage:
    """An editor with the table of its points below, and their session behind both."""

    def __init__(self, browser: Any, points: ControlPoints | None = None) -> None:
        picture = smooth_picture()
        first = Deformation((Step((five_points() if points is None else points,), picture.plane),))
        self.session = Session(Volume(np.zeros((2, 3, 4), np.uint8), Grid((2, 3, 4))), first)
        self.guard = Guarded()
        self.editor = Editor(picture, self.session.editing.points, height=360, density=0)
        self.on_page = EditorOnPage(browser, self.editor, (1000, 900))
        self.page = self.on_page.page
        worker: Any = SimpleNamespace(latest=lambda name, job: job())
        self.panel = PointsPanel(self.session, self.guard, SimpleNamespace(current=self.editor), worker)
        self.on_page.add(self.panel.table, "table")
        self.session.editing.observe(self._follow, "deformation")
        self.editor.observe(self._edited, "points")
        self.on_page.wait(f"{TABLE}.list.points.length === {len(self.session.editing.points)}")

    def _follow(self, _change: Any) -> None:
        self.editor.points = self.session.editing.points
        self.panel.refresh()

    def _edited(self, change: Any) -> None:
        if change["new"] != self.session.editing.points:
            self.session.editing.edit_points(change["new"])

    def cell(self, point: int, key: str) -> Any:
        return self.page.locator(f'.dnb-pt-row[data-id="{point}"] [data-key="{key}"]')

    def wait_answered(self) -> None:
        """Until Python has heard of all that was done in table and picture, and both show what it made of that."""
        self.on_page.wait(f"{TABLE}.requests.waiting.size === 0")
        self.on_page.wait_answered()
        self.on_page.wait(f"!{TABLE}.frame && {TABLE}.list.points.length === {len(self.session.editing.points)}")
        self.on_page.flush()

    def write(self, point: int, key: str, text: str) -> None:
        self.cell(point, key).dblclick()
        self.page.keyboard.type(text)
        self.page.keyboard.press("Enter")
        self.wait_answered()

    def focused(self) -> tuple[str | None, str | None]:
        found = self.page.evaluate("""() => { const cell = document.activeElement.closest(".dnb-pt-cell");
            return cell ? [cell.parentElement.dataset.id ?? null, cell.dataset.key] : [null, null]; }""")
        return found[0], found[1]

    def close(self) -> None:
        assert self.on_page.errors == []
        self.on_page.close()


@pytest.fixture
def table(browser: Any) -> Any:
    made = TableOnPage(browser)
    yield made
    made.close()


def pixel(table: TableOnPage, canvas: np.ndarray, a: float, b: float) -> np.ndarray:
    """Colour of the screen at a place of the picture."""
    view = table.on_page.js(f"({PAGE}.viewport.view)")
    x, y = view["k"] * a + view["x"], view["k"] * b + view["y"]
    return canvas[round(view["ratio"] * y), round(view["ratio"] * x)]


def test_a_name_a_switch_and_a_coordinate_reach_the_session_and_the_picture(table: TableOnPage) -> None:
    before = table.on_page.canvas()
    table.write(4, "name", "nose")
    assert table.session.editing.points.names[4] == "nose"
    assert table.page.locator(".dnb-ed-name", has_text="nose").count() == 1
    table.write(4, "target_b", "37.5")
    assert table.session.editing.points.target[4].tolist() == [70.0, 37.5]
    table.on_page.wait_settled()
    moved = table.on_page.canvas()
    assert np.abs(moved - before).max() > 20
    assert np.abs(pixel(table, moved, 70, 37.5) - pixel(table, before, 70, 25)).max() <= 4  # the feature came along
    assert np.abs(pixel(table, moved, 70, 37.5) - pixel(table, before, 70, 37.5)).max() > 8
    assert table.cell(4, "target_b").inner_text() == "37.50"
    assert table.cell(4, "drag").inner_text() == "12.50"
    table.cell(4, "active").locator("input").click()
    table.wait_answered()
    assert not table.session.editing.points.active[4]
    table.on_page.wait_settled()
    assert np.abs(table.on_page.canvas() - before).max() <= 4  # it has no say any more
    assert not table.cell(4, "active").locator("input").is_checked()


def test_what_is_no_number_is_refused_in_words_and_the_old_value_stays(table: TableOnPage) -> None:
    table.write(2, "source_b", "NaN")
    assert table.guard.errors == ["source b of point 3 must be a number, got 'NaN'."]
    assert table.cell(2, "source_b").inner_text() == "60.00"
    assert "dnb-pt-refused" in table.cell(2, "source_b").get_attribute("class")
    table.cell(2, "source_b").dblclick()
    table.page.keyboard.type("5")
    table.page.keyboard.press("Escape")
    assert table.cell(2, "source_b").inner_text() == "60.00"
    assert len(table.session.editing.history_tree()) == 1


def test_a_locked_point_says_so_and_takes_no_coordinates(table: TableOnPage) -> None:
    table.cell(1, "locked").locator("input").click()
    table.wait_answered()
    assert table.session.editing.points.locked[1]
    table.cell(1, "target_a").dblclick()
    assert table.page.locator(".dnb-pt-input").count() == 0
    assert table.page.locator(".dnb-pt-said").inner_text() == "top right is locked. Unlock it to move it."
    assert table.cell(1, "target_a").get_attribute("aria-readonly") == "true"
    table.write(1, "name", "held")
    assert table.session.editing.points.names[1] == "held"


def test_the_button_of_a_row_brings_its_point_to_the_middle(table: TableOnPage) -> None:
    before = table.on_page.js(f"({PAGE}.viewport.view)")
    table.cell(3, "go").locator("button").click()
    table.wait_answered()
    table.on_page.wait(f"{PAGE}.viewport.view.k > {2 * before['k']}")
    box = table.page.locator(".dnb-ed-stage").bounding_box()
    x, y = table.on_page.to_screen((35.0, 55.0))
    assert abs(x - box["x"] - box["width"] / 2) < 2
    assert abs(y - box["y"] - box["height"] / 2) < 2
    assert table.editor.selected == [3]
    assert "dnb-pt-selected" in table.page.locator('.dnb-pt-row[data-id="3"]').get_attribute("class")


def test_rows_and_picture_share_the_selection(table: TableOnPage) -> None:
    table.cell(1, "drag").click()
    table.cell(3, "drag").click(modifiers=["Shift"])
    table.wait_answered()
    assert table.editor.selected == [1, 2, 3]
    x, y = table.on_page.to_screen((30.0, -10.0))
    table.page.mouse.click(x, y)
    table.on_page.wait(f"[...{TABLE}.selection.ids].join() === '0'")
    table.on_page.wait("document.querySelector('.dnb-pt-facts').innerText.startsWith('5 points \u00b7 1 selected')")


def test_rows_follow_a_drag_before_python_has_heard_of_it(table: TableOnPage) -> None:
    x, y = table.on_page.to_screen((70.0, 25.0))
    k = table.on_page.js(f"{PAGE}.viewport.view.k")
    table.page.mouse.move(x, y)
    table.page.mouse.down()
    table.page.mouse.move(x + 30, y, steps=4)
    cell = """document.querySelector('.dnb-pt-row[data-id="4"] [data-key="target_a"]').innerText"""
    table.on_page.wait(f"Math.abs(Number({cell}) - {70 + 30 / k}) < 0.02")
    shown = float(table.cell(4, "target_a").inner_text())
    assert table.session.editing.points.target[4, 0] == 70
    table.page.mouse.up()
    table.on_page.wait_answered()
    table.wait_answered()
    assert table.session.editing.points.target[4, 0] == pytest.approx(shown, abs=0.01)
    assert table.cell(4, "target_a").inner_text() == f"{table.session.editing.points.target[4, 0]:.2f}"


def test_all_is_done_by_keys(table: TableOnPage) -> None:
    keys = table.page.keyboard
    table.page.locator('[data-act="paste"]').focus()
    keys.press("Tab")
    assert table.focused() == ("0", "name")  # one stop of Tab for all cells
    keys.press("ArrowDown")
    keys.press("ArrowRight")
    assert table.focused() == ("1", "active")
    keys.press("Space")
    table.wait_answered()
    assert not table.session.editing.points.active[1]
    assert table.focused() == ("1", "active")
    keys.press("ArrowLeft")
    keys.type("chin")  # writing begins with the first letter
    keys.press("Enter")
    table.wait_answered()
    assert table.session.editing.points.names[1] == "chin"
    assert table.focused() == ("2", "name")
    keys.press("F2")
    keys.type("ear")
    keys.press("Tab")
    table.wait_answered()
    assert table.session.editing.points.names[2] == "ear"
    assert table.focused() == ("2", "source_a")
    keys.press("End")
    assert table.focused() == ("2", "go")
    keys.press("Control+Home")
    assert table.focused() == ("0", "id")
    keys.press("Space")
    keys.press("Shift+ArrowDown")
    table.wait_answered()
    assert table.editor.selected == [0, 1]
    keys.press("Delete")
    table.wait_answered()
    assert table.session.editing.points.ids == (2, 3, 4)
    assert table.focused()[0] == "3"  # the focus does not fall out of the table
    keys.press("Control+z")
    table.wait_answered()
    assert table.session.editing.points.ids == (0, 1, 2, 3, 4)
    assert table.page.locator(".dnb-pt-said").inner_text() == "Undone: remove 2 points"
    keys.press("Control+a")
    table.wait_answered()
    assert len(table.editor.selected) == 5
    keys.press("Escape")
    table.wait_answered()
    assert table.editor.selected == []
    keys.press("Tab")
    assert table.focused() == (None, None)


def test_columns_sort_up_down_and_back(table: TableOnPage) -> None:
    def row_order() -> list[str]:
        rows = table.page.locator(".dnb-pt-body .dnb-pt-row")
        found = [
            (int(rows.nth(k).get_attribute("aria-rowindex")), rows.nth(k).get_attribute("data-id"))
            for k in range(rows.count())
        ]
        assert [index for index, _ in found] == sorted(index for index, _ in found)
        return [point for _, point in found]

    head = table.page.locator('.dnb-pt-head-cell[data-key="target_a"] button')
    assert row_order() == ["0", "1", "2", "3", "4"]
    head.click()
    assert row_order() == ["0", "3", "4", "2", "1"]
    assert table.page.locator('[aria-sort="ascending"]').get_attribute("data-key") == "target_a"
    head.click()
    assert row_order() == ["1", "2", "4", "3", "0"]
    head.click()
    assert row_order() == ["0", "1", "2", "3", "4"]
    table.page.locator('.dnb-pt-head-cell[data-key="name"] button').click()
    assert row_order()[:2] == ["4", "1"]  # those without a name come last


@pytest.mark.parametrize("width", [1000, 760, 480])
def test_headings_stand_above_their_columns(table: TableOnPage, width: int) -> None:
    table.page.set_viewport_size({"width": width, "height": 900})
    table.wait_answered()
    table.page.wait_for_function("document.querySelectorAll('.dnb-points-table .dnb-pt-row').length === 6")
    places = table.page.evaluate("""() => [...document.querySelectorAll(".dnb-points-table .dnb-pt-row")].map((row) =>
        [...row.children].map((cell) => Math.round(cell.getBoundingClientRect().right)))""")
    assert len(places) == 6
    assert all(row == places[0] for row in places)


def test_a_point_is_added_at_numbers_and_put_back(table: TableOnPage) -> None:
    table.page.locator(".dnb-pt-place").fill("50, 20.5")
    table.page.keyboard.press("Enter")
    table.wait_answered()
    assert table.session.editing.points.target[-1].tolist() == [50.0, 20.5]
    assert table.page.locator(".dnb-pt-place").input_value() == ""
    table.write(5, "target_b", "24")
    table.cell(5, "drag").click()
    table.page.locator('[data-act="reset"]').click()
    table.wait_answered()
    assert not table.session.editing.points.displacement[5].any()
    table.page.locator(".dnb-pt-place").fill("50")
    table.page.locator('[data-act="add"]').click()
    table.wait_answered()
    assert table.guard.errors == ["a new point needs 2 numbers, a, b; got 1."]
    assert table.page.locator(".dnb-pt-place").input_value() == "50"  # to be corrected, not typed again


def test_points_are_copied_changed_and_pasted(table: TableOnPage) -> None:
    table.page.evaluate("""() => document.addEventListener("copy", (event) => {
        window.copied = event.clipboardData.getData("text/plain"); })""")
    table.cell(4, "drag").click()
    table.page.keyboard.press("Control+c")
    table.page.wait_for_function("() => window.copied")
    copied = table.page.evaluate("() => window.copied")
    assert copied.splitlines() == [
        "id,name,active,locked,source_a,source_b,target_a,target_b,weight,radius",
        "4,middle,true,false,70,25,70,25,1,",
    ]
    changed = copied.replace("70,25,1,", "75,26,1,30") + ",new,,,50,20,,,,\n"
    table.page.locator('[data-act="paste"]').click()
    table.page.locator(".dnb-pt-rows").fill(changed)
    table.page.locator('[data-act="take"]').click()
    table.wait_answered()
    points = table.session.editing.points
    assert points.target[4].tolist() == [75, 26]
    assert points.radius[4] == 30
    assert points.names[-1] == "new"
    assert table.page.locator(".dnb-pt-said").inner_text() == "1 points added, 1 changed."
    assert not table.page.locator(".dnb-pt-rows").is_visible()


def test_two_thousand_points_put_a_few_dozen_rows_into_the_page(page: LivePage) -> None:
    shown = PointsTable()
    source = np.random.default_rng(0).random((2000, 2)) * 100
    page.add(shown, "table")
    shown.show(ControlPoints.from_arrays(source))
    page.wait(f"{TABLE}.list.points.length === 2000")
    count = "document.querySelectorAll('.dnb-pt-body .dnb-pt-row').length"
    assert page.page.evaluate(f"() => {count}") < 40
    page.page.evaluate("() => { document.querySelector('.dnb-pt-scroller').scrollTop = 26000; }")
    page.wait("document.querySelector('.dnb-pt-row[data-id=\"1000\"]')")
    assert page.page.evaluate(f"() => {count}") < 40
    row = page.page.locator('.dnb-pt-row[data-id="1000"]')
    assert row.get_attribute("aria-rowindex") == "1002"
    assert row.locator('[data-key="source_a"]').inner_text() == f"{source[1000, 0]:.2f}"
    row.locator('[data-key="source_a"]').click()
    page.page.keyboard.press("Control+End")
    page.wait("document.activeElement.closest('.dnb-pt-row').dataset.id === '1999'")
    assert page.errors == []


def test_a_table_of_points_in_space_has_three_coordinates(page: LivePage) -> None:
    shown = PointsTable()
    page.add(shown, "table")
    shown.show(ControlPoints.from_arrays([[1, 2, 3]], [[4, 5, 6]], names=["<b>x</b>"]))
    page.wait("document.querySelectorAll('.dnb-pt-body .dnb-pt-row').length === 1")
    assert page.page.locator('.dnb-pt-row [data-key="target_z"]').last.inner_text() == "6.00"
    assert page.page.locator('.dnb-pt-body [data-key="name"]').inner_text() == "<b>x</b>"
    focusable = page.page.locator(".dnb-points-table :is(button, input, textarea, [tabindex])")
    for k in range(focusable.count()):
        assert focusable.nth(k).get_attribute("data-lm-suppress-shortcuts") == "true"
    assert page.errors == []


def test_a_click_in_the_history_goes_there(page: LivePage) -> None:
    session = Session(Volume(np.zeros((8, 8, 8), np.uint8), Grid((8, 8, 8))))
    panel = HistoryPanel(session, Guarded())
    page.add(panel.items, "items")
    session.editing.change(trend="none")
    session.editing.change(kernel="gaussian")
    session.editing.undo()
    session.editing.change(strength=2.0)
    panel.refresh()
    page.flush()
    rows = page.page.locator(".dnb-il-row")
    assert [t.strip() for t in page.page.locator(".dnb-il-name").all_inner_texts()] == [
        "the beginning",
        "change trend",
        "change kernel",
        "change strength",
    ]
    left = [page.page.locator(".dnb-il-choose").nth(k).bounding_box()["x"] for k in range(4)]
    assert left[0] == left[1] == left[3] < left[2]
    page.page.locator(".dnb-il-choose", has_text="change kernel").click()
    page.wait("document.querySelector('.dnb-il-table').ariaBusy !== 'true'")
    assert "change kernel" in page.page.locator(".dnb-il-chosen").inner_text()
    assert session.editing.step.kernel == "gaussian"
    page.page.keyboard.press("ArrowUp")  # the branch that is left stands above it now
    page.page.keyboard.press("Enter")
    page.wait("document.querySelector('.dnb-il-chosen').textContent.includes('change strength')")
    assert session.editing.step.strength == 2.0
    assert rows.count() == 4
    assert page.errors == []


@pytest.mark.nightly
def test_a_point_in_space_comes_into_the_middle_of_pictures_that_are_zoomed_in(page: LivePage) -> None:
    z, y, x = np.mgrid[:24, :28, :32]
    volume = Volume((x + 2 * y + z).astype(np.uint8), Grid((24, 28, 32)))
    editor = SpaceEditor(volume, ControlPoints.from_arrays([[10.0, 9.0, 8.0], [20.0, 20.0, 15.0]]), height=240)
    space = "document.querySelector('.dnb-space').deformnb"
    try:
        page.add(editor, "editor")
        page.wait(f"{space}.parts.requests.shownCount > 0")
        page.page.evaluate(f"() => {{ for (const pane of {space}.parts.row.panes) pane.viewport.zoomAt(6, 10, 10); }}")
        editor.look_at(1)
        page.wait(f"{space}.parts.cursor.place.join() === '20,20,15' && !{space}.frames.request")
        for k in range(3):
            pane = f"{space}.parts.row.panes[{k}]"
            size = f"{pane}.viewport.view"
            middle = page.page.evaluate(f"() => {pane}.viewport.placeAt([{size}.width / 2, {size}.height / 2])")
            wanted = Pane.of(volume.grid, list(PANES)[k]).plane.to_plane([20.0, 20.0, 15.0])[:2]
            assert np.abs(np.subtract(middle, wanted)).max() < 0.1
    finally:
        editor.close()


def test_a_point_that_is_selected_while_an_older_selection_is_on_its_way_stays_selected(table: TableOnPage) -> None:
    table.on_page.held = []
    table.cell(1, "drag").click()  # the editor's page hears of it from Python, later
    table.on_page.wait("true")
    assert table.editor.selected == [1]
    assert table.on_page.held == [("selected", [1])]
    chosen = "{ %s.points.select([3]); models.editor.fromPython('selected', [1]); return [...%s.points.selected]; }"
    assert table.on_page.js(chosen % (PAGE, PAGE)) == [3]
    table.on_page.held = None
    table.on_page.wait(f"[...{TABLE}.selection.ids].join() === '3'")
    assert table.editor.selected == [3]


def test_rows_that_are_selected_before_an_older_selection_is_sent_stay_selected(table: TableOnPage) -> None:
    x, y = table.on_page.to_screen((30.0, -10.0))
    row = table.cell(1, "drag").bounding_box()
    # Both within the rest of the editor, whatever the machine is busy with.
    table.page.evaluate(
        """([point, row]) => {
        const press = ([x, y], types, kind) => {
            const at = { clientX: x, clientY: y, bubbles: true, composed: true, isPrimary: true, pointerId: 1 };
            for (const type of types) document.elementFromPoint(x, y).dispatchEvent(new kind(type, at));
        };
        press(point, ["pointerdown", "pointerup"], PointerEvent);
        press(row, ["pointerdown", "pointerup"], PointerEvent);
        press(row, ["click"], MouseEvent);
    }""",
        [[x, y], [row["x"] + row["width"] / 2, row["y"] + row["height"] / 2]],
    )
    table.wait_answered()
    table.page.wait_for_timeout(300)  # longer than the rest of the editor
    assert table.editor.selected == [1]
    assert table.panel.table.selected == [1]
    assert table.on_page.js(f"[...{PAGE}.points.selected]") == [1]

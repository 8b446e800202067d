"""The window of the picture changed in the page, the wheel through the slices, and the value under the pointer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from browser.pane_messages import message_text

from deformnb.document.json_regions import region_to_data
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Mask
from deformnb.volume.colour_maps import colour_table
from deformnb.volume.plane import Picture
from deformnb.volume.volume import Grid
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.messages.editors import WandRequest

pytestmark = pytest.mark.needs_browser

SLICES = {"count": 9, "first": -8.0, "spacing": 2.0}


def source_pixels(page: EditorOnPage) -> Any:
    return np.array(page.js(f"[...{PAGE}.picture.painter.source.levels[0].pixels]"))


def wanted(picture: Picture | None) -> Any:
    assert picture is not None
    return (picture.grey() * 255 + 0.5).astype(np.uint8).ravel()


@pytest.mark.parametrize("factor", [1.0, 11.7])
def test_a_drag_with_the_right_button_changes_the_window_at_once_and_python_hears_the_end(
    open_editor: Any, picture: Picture, points: ControlPoints, factor: float
) -> None:
    if factor != 1.0:  # values that need two bytes
        values = picture.values * np.float32(factor) - 1000
        picture = replace(picture, values=values, window=(-900.0, 1500.0), unit="HU")
    page = open_editor(Editor(picture, points, show_grid=False))
    assert np.abs(source_pixels(page).astype(int) - wanted(picture)).max() <= (0 if factor == 1.0 else 1)
    bright, mouse = page.canvas().mean(), page.page.mouse
    x, y = page.to_screen(points.target[4])
    mouse.move(x, y)
    mouse.down(button="right")
    mouse.move(x - 40, y - 90, steps=4)
    page.wait(f"{PAGE}.model.get('window').length === 2")
    assert page.canvas().mean() < bright - 5  # before Python hears of it
    assert page.editor.window == []
    told = message_text(page.page)
    assert told.startswith("window ")
    assert told.endswith("HU") == (factor != 1.0)
    mouse.up(button="right")
    page.wait(f"{PAGE}.model.saved.some((state) => 'window' in state)")
    low, high = page.editor.window
    assert high - low < picture.window[1] - picture.window[0]
    assert (low + high) / 2 > sum(picture.window) / 2
    assert np.abs(source_pixels(page).astype(int) - wanted(page.editor.picture)).max() <= 1
    assert page.points == points  # what began on a point has deleted nothing


def test_the_tool_changes_the_window_by_any_pointer_and_by_keys_and_resets_it(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points, show_grid=False))
    before = page.canvas()
    page.page.locator("[data-command=window]").click()
    page.wait_settled()
    assert page.page.locator("[data-command=window]").get_attribute("aria-pressed") == "true"
    page.drag(points.target[4], (60, 0))
    low, high = page.editor.window
    assert high - low > 255
    assert page.points == points
    page.page.keyboard.press("ArrowUp")
    page.page.keyboard.press("ArrowLeft")
    page.wait(f"!{PAGE}.tools.window.trait.isAhead")
    a, b = page.editor.window
    assert b - a < high - low
    assert a + b > low + high
    page.page.mouse.dblclick(*page.to_screen(points.target[4]))
    page.wait_settled()
    assert page.editor.window == []
    np.testing.assert_array_equal(page.canvas(), before)
    page.page.keyboard.press("ArrowRight")
    page.page.get_by_role("button", name="Auto").click()
    page.wait(f"!{PAGE}.tools.window.trait.isAhead")
    assert page.editor.window == []
    assert page.points == points
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("Escape")
    assert page.js(f"{PAGE}.tools.window.isOn") is False
    page.page.keyboard.press("w")
    assert page.js(f"{PAGE}.tools.window.isOn") is True


def test_a_colour_bar_has_the_colours_and_its_handles_set_the_window(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points, show_grid=False))
    bar = page.page.locator(".dnb-ed-colours")
    assert bar.is_hidden()
    page.editor.colour_map = "viridis"
    page.wait(f"{PAGE}.picture.hasColours")
    page.wait_settled()
    table = {tuple(colour) for colour in colour_table("viridis").tolist()}
    seen = np.unique(page.canvas()[200:400, 300:500].reshape(-1, page.canvas().shape[-1])[:, :3], axis=0)
    assert {tuple(colour) for colour in seen.tolist()} <= table
    handles, (low, high) = page.page.locator(".dnb-ed-colours-handle"), picture.window
    box = handles.nth(0).bounding_box()
    page.page.mouse.move(box["x"] + 10, box["y"] + 11)
    page.page.mouse.down()
    page.page.mouse.move(box["x"] + 10, box["y"] - 29, steps=2)
    page.page.mouse.up()
    page.wait(f"{PAGE}.model.saved.some((state) => 'window' in state)")
    black, white = page.editor.window
    assert (black > low + 10, white) == (True, high)
    assert handles.nth(0).inner_text() == handles.nth(0).get_attribute("aria-valuenow") == f"{black:g}"
    handles.nth(1).press("ArrowDown")
    page.wait_settled()
    assert page.editor.window[1] < high
    handles.nth(1).press("Home")
    page.wait_settled()
    assert page.editor.window == []
    assert page.points == points
    page.editor.colour_map = "grey"
    bar.wait_for(state="hidden")


def test_the_picture_is_compared_by_a_line_and_by_an_opacity(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points.move(4, points.target[4] + [9, -5]), show_grid=False, overlay="none"))

    def canvas_pixels(shows: str) -> Any:
        page.editor.shows = shows
        page.wait(f"{PAGE}.picture.compare.shows === '{shows}'")
        page.wait_settled()
        return page.canvas().astype(float)

    deformed, original = canvas_pixels("deformed"), canvas_pixels("original")
    assert np.abs(deformed - original).max() > 20
    wipe, width = canvas_pixels("wipe"), deformed.shape[1]
    near = slice(width // 2 - 2, width // 2 + 2)
    for image, part in ((original, slice(0, width // 2)), (deformed, slice(width // 2, None))):
        difference = np.abs(wipe - image)[:, part]
        assert difference.max() <= 8  # the lattice of the map begins at the line
        assert difference.mean() < 0.2
    assert np.abs(deformed - original)[:, near].max() > 8
    assert page.js(f"{PAGE}.map.fitAt([10, 10])") is None
    nodes = page.js(f"""(() => {{ const editor = {PAGE}; editor.frames.markMoving(); editor.frames.drawNow();
        return editor.picture.painter.sampled.fit.sampled.raster; }})()""")  # of grid and folds while something moves
    ends = nodes["origin"][0] + np.array([0, nodes["spacing"][0] * (nodes["shape"][1] - 1)])
    assert np.allclose(ends, picture.raster.box[:2], atol=nodes["spacing"][0])  # also below the original
    page.wait_settled()
    page.page.locator(".dnb-wipe").press("Home")
    page.wait_settled()
    np.testing.assert_array_equal(page.canvas(), deformed)
    canvas_pixels("fade")
    page.page.locator(".dnb-fade input").fill("0.25")
    page.wait(f"!{PAGE}.frames.isMoving")
    page.wait_settled()
    assert np.abs(page.canvas() - (0.25 * original + 0.75 * deformed)).max() <= 2
    assert page.points == page.editor.points


def test_escape_gives_a_drag_of_the_window_up(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points, window=[50, 150]))
    page.page.keyboard.press("Tab")
    x, y = page.to_screen((90, 10))
    page.page.locator(".dnb-ed-stage").focus()
    page.page.mouse.move(x, y)
    page.page.mouse.down(button="right")
    page.page.mouse.move(x + 50, y)
    page.wait(f"{PAGE}.model.get('window')[1] !== 150")
    page.page.keyboard.press("Escape")
    assert page.js(f"{PAGE}.model.get('window')") == [50, 150]
    page.page.mouse.up(button="right")
    assert page.editor.window == [50, 150]


def test_wheel_and_page_keys_go_through_the_slices(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    seen = replace(picture, grid=Grid((44, 9, 60), (2.0, 2.0, 2.5), unit="mm"))
    page = open_editor(Editor(seen, points, slices=SLICES, slice=3))
    status = page.page.locator(".dnb-ed-slice")
    assert status.inner_text() == "slice 4 / 9, -2.0 mm"
    page.page.evaluate("document.body.style.height = '4000px'")
    page.page.mouse.move(*page.to_screen((90, 10)))
    page.page.mouse.wheel(0, 100)
    page.wait("window.scrollY > 50")
    assert page.editor.slice == 3  # until the picture is clicked the page scrolls
    page.page.evaluate("window.scrollTo(0, 0)")
    page.wait("window.scrollY === 0")
    page.page.mouse.click(*page.to_screen((90, 10)))
    k = page.js(f"{PAGE}.viewport.view.k")
    page.page.mouse.wheel(0, 100)
    page.wait(f"{PAGE}.model.get('slice') === 4")
    assert page.js(f"{PAGE}.viewport.view.k") == k
    page.page.keyboard.press("PageUp")
    page.page.keyboard.press("PageUp")
    page.wait_settled()
    assert page.editor.slice == 2
    assert status.inner_text() == "slice 3 / 9, -4.0 mm"
    page.page.keyboard.down("Control")
    page.page.mouse.wheel(0, -100)
    page.page.keyboard.up("Control")
    page.wait(f"{PAGE}.viewport.view.k > {k}")
    assert page.editor.slice == 2


def test_the_status_line_names_place_and_value_under_the_pointer(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    moved = points.move(4, points.target[4] + [10.0, 0.0])
    page = open_editor(Editor(replace(picture, unit="HU"), moved))
    page.page.mouse.move(*page.to_screen(points.target[4] + [10.0, 0.0]))
    line = page.page.locator(".dnb-ed-value")
    page.wait("document.querySelector('.dnb-ed-value').textContent !== ''")
    a, b = points.source[4]  # what is seen there was there before
    value = picture.values[round((b + 30) / 2.5), round((a - 11) / 2)]
    place, shown = line.inner_text().split(": ")
    assert shown.endswith(" HU")
    assert float(shown[:-3]) == pytest.approx(float(value), abs=4)
    assert np.allclose([float(v) for v in place.removesuffix(" mm").split(", ")], [a + 10, b], atol=0.6)
    assert "before the deformation" in (line.get_attribute("title") or "")
    page.page.mouse.move(5, 5)
    page.wait("document.querySelector('.dnb-ed-value').textContent === ''")


def test_the_wand_asks_for_what_is_seen_shows_its_outline_and_makes_a_part(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor = Editor(
        picture, points.move(points.ids[4], points.target[4] + [4.0, 0.0]), show_grid=False, wand={"region": None}
    )
    asked: list[WandRequest] = []
    editor.on_wand(asked.append)
    page = open_editor(editor)
    before = page.points
    page.page.locator("[data-command=wand]").click()
    x, y = page.to_screen(points.target[4] + [4.0, 0.0])
    page.page.mouse.click(x, y)
    page.wait_settled()
    assert asked[-1].what == "preview"
    assert asked[-1].place == pytest.approx(points.source[4], abs=0.6)  # where that was before it was dragged
    first = asked[-1].tolerance
    page.page.keyboard.press("]")
    page.wait(f"{PAGE}.model.sent.filter((m) => m.type === 'wand').length === 2")
    page.wait_settled()
    assert asked[-1].tolerance > first
    mask = Mask(picture.values > 100, picture.raster)
    editor.wand = {"region": region_to_data(mask), "words": "100 to 200", "share": 1.0}
    page.wait("document.querySelector('.dnb-ed-wand-line').getAttribute('d').length > 10")
    assert message_text(page.page) == "100 to 200"
    inside = """([x, y]) => { const fill = document.querySelector('.dnb-ed-wand-fill');
        return fill.isPointInFill(new DOMPoint(x, y)); }"""
    box = page.page.locator(".dnb-ed-svg").bounding_box()
    seen, dark = (np.argwhere(part)[len(np.argwhere(part)) // 2] for part in (mask.values, ~mask.values))
    for (line, column), is_in in ((seen, True), (dark, False)):  # all of it is marked, and nothing else
        at = np.subtract(
            page.to_screen(np.array([picture.raster.columns[column], picture.raster.rows[line]])), (box["x"], box["y"])
        )
        assert page.page.evaluate(inside, at.tolist()) is is_in
    page.page.get_by_role("button", name="Make rigid part").click()
    page.wait_settled()
    assert [m.what for m in asked[-1:]] == ["part"]
    assert page.page.get_by_role("group", name="Wand").is_visible()  # for the next one
    page.page.mouse.click(x + 3, y)
    page.wait_settled()
    assert asked[-1].what == "preview"
    page.page.keyboard.press("Escape")
    page.wait("document.querySelector('.dnb-ed-wand-bar').hidden")
    assert page.points == before

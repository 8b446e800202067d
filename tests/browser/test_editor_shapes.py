"""Cuts and rigid parts in the editor: drawn with the real mouse and keys, their pixels held against the core."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from browser.pane_messages import message_text

from deformnb.errors import DeformError
from deformnb.rbf.cuts import CUT_RULES, Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line, Mask, Polygon
from deformnb.rbf.rigid import RigidPart, without_conflicts
from deformnb.volume.plane import Picture
from deformnb.warping.warper import warp_picture
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.messages.editors import ShapesEdit

pytestmark = pytest.mark.needs_browser

PAPER = 86  # the red of the stage in the light theme: what is seen through a gap


def two_sides() -> ControlPoints:
    """Three points on either side of a = 71."""
    return ControlPoints.from_arrays([[50.0, -10], [45, 25], [50, 60], [95, -10], [102, 25], [95, 60]])


def pull(page: EditorOnPage, points: ControlPoints, ids: list[int], by: tuple[float, float]) -> None:
    """Drags these points together."""
    page.page.locator(f"[data-id='{ids[0]}']").click()
    for k in ids[1:]:
        page.page.locator(f"[data-id='{k}']").click(modifiers=["Shift"])
    page.drag(points.target[ids[0]], by)


def draw(page: EditorOnPage, key: str, places: list[tuple[float, float]], end: str | None = "Enter") -> None:
    """Sets places of a shape with the mouse, and ends it with a key."""
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press(key)
    for place in places:
        page.page.mouse.click(*page.to_screen(place))
    if end:
        page.page.keyboard.press(end)
    page.wait_answered()


def assert_as_the_core(page: EditorOnPage, picture: Picture, least: int) -> np.ndarray:
    """All that is opaque is what the core shows, all else the paper; returns the opacity."""
    field, raster = page.editor.fit(), page.raster()
    at, d = raster.points(), 2 * raster.spacing[0]
    a0, a1, b0, b1 = picture.raster.box
    inside = (at[..., 0] > a0 + d) & (at[..., 0] < a1 - d) & (at[..., 1] > b0 + d) & (at[..., 1] < b1 - d)
    opacity, shown = field.opacity(at), page.canvas()[..., 0]
    expected = warp_picture(picture.values, picture.raster, field, output=raster).astype(int)
    full, empty = inside & (opacity == 1), inside & (opacity == 0)
    assert full.sum() > least
    assert np.quantile(np.abs(shown - expected)[full], 0.999) <= 2
    assert (shown[empty] == PAPER).all()
    return np.where(inside, opacity, np.nan)


# ---- cuts -----------------------------------------------------------------------------------------------------------


def test_a_cut_is_drawn_and_opens_as_wide_as_its_sides_are_pulled(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, two_sides(), show_grid=False, theme="light"))
    before = page.canvas()
    draw(page, "x", [(71, -25), (71, 75)])
    (cut,) = page.editor.cuts
    assert cut.region.kind == "line"
    assert cut.region.vertices == pytest.approx(np.array([[71, -25], [71, 75]]), abs=0.4)
    assert np.abs(page.canvas() - before).max() <= 1  # a closed cut is not seen
    pull(page, two_sides(), [0, 1, 2], (-40, 0))
    pull(page, two_sides(), [3, 4, 5], (50, 0))
    page.wait_answered()
    opacity = assert_as_the_core(page, picture, 100_000)
    row = opacity[opacity.shape[0] // 2]
    gap = np.nansum(1 - row) / page.js(f"{PAGE}.viewport.view.ratio")
    assert gap == pytest.approx(90, abs=1.0)
    columns = np.flatnonzero(row < 0.5)
    middle = page.to_screen((71, 0))[0] - page.page.locator(".dnb-ed-stage").bounding_box()["x"]
    assert (columns.min(), columns.max()) == pytest.approx((middle - 40, middle + 50), abs=4)


def test_the_chosen_cut_stops_at_its_ends_and_is_pulled_open_by_its_bar(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, front_only=False))
    bar = page.page.get_by_role("group", name="Chosen cut")
    assert bar.is_hidden()
    draw(page, "x", [(71, 5), (71, 45)])
    bar.get_by_label("Stop at the ends").check()
    bar.get_by_label("Front only").check()
    bar.get_by_role("button", name="Pull open").click()
    page.wait_answered()
    assert page.editor.cuts[0].region.stops == (True, True)
    assert page.editor.front_only is True
    moved = page.editor.points.displacement.any(axis=1)
    (left, right) = page.editor.points.target[moved][np.argsort(page.editor.points.target[moved][:, 0])]
    assert left[0] < 71 < right[0]
    assert page.editor.fit().opacity([[71.0, 25]]) == 0
    assert page.editor.fit().opacity([[71.0, 60]]) == 1
    page.editor.front_only = None
    page.wait_answered()
    assert bar.get_by_label("Front only").is_hidden()


def test_an_outline_that_was_traced_becomes_points_in_its_place(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture))
    bar = page.page.get_by_role("group", name="Chosen cut")
    corners = [(40.0, 10.0), (100.0, 10.0), (100.0, 45.0), (40.0, 45.0)]
    draw(page, "x", [*corners, corners[0]], None)  # closed where it began
    assert bar.get_by_role("button", name="Pull open").is_hidden()
    (cut,) = page.editor.cuts
    outline = np.array([*cut.region.vertices, cut.region.vertices[0]])
    bar.get_by_role("button", name="Make points").click()
    page.wait_answered()
    assert page.editor.cuts == ()
    points = page.editor.points
    assert points.names == tuple(f"outline {k}" for k in range(1, 17))
    assert not points.displacement.any()
    ways = np.diff(outline, axis=0)
    shares = [
        np.clip(((points.source - a) @ way) / (way @ way), 0, 1) for a, way in zip(outline[:-1], ways, strict=True)
    ]
    away = [
        np.linalg.norm(points.source - a - share[:, None] * way, axis=1)
        for a, way, share in zip(outline[:-1], ways, shares, strict=True)
    ]
    np.testing.assert_allclose(np.min(away, axis=0), 0, atol=1e-9)
    assert bar.is_hidden()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("rule", list(CUT_RULES))
@pytest.mark.parametrize(
    "region",
    [Line([(71, -20), (78, 10), (64, 30), (76, 70)]), Polygon([(80, 0), (120, 5), (115, 50), (80, 45)]), "mask"],
)
def test_what_is_seen_beside_cuts_is_what_the_core_shows(
    open_editor: Any, picture: Picture, region: Any, rule: str
) -> None:
    if region == "mask":
        at = picture.raster.points() - [102, 30]
        region = Mask((at[..., 0] / 18) ** 2 + (at[..., 1] / 45) ** 2 < 1, picture.raster)
    page = open_editor(Editor(picture, two_sides(), show_grid=False, theme="light", cuts=[Cut(region)], cut_rule=rule))
    pull(page, two_sides(), [0, 1, 2], (-33, 12))
    pull(page, two_sides(), [4, 5], (41, -20))
    assert page.points.displacement.any(axis=1).tolist() == [True, True, True, False, True, True]
    opacity = assert_as_the_core(page, picture, 100_000)
    assert (opacity == 0).sum() > 500


def test_a_cut_is_closed_by_a_click_on_its_start_and_drawn_in_one_stroke(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, two_sides()))
    draw(page, "x", [(30, 0), (60, 0), (60, 40), (30, 0)], end=None)
    assert page.editor.cuts[0].region.kind == "polygon"
    assert len(page.editor.cuts[0].region.vertices) == 3
    page.page.locator("[data-command='cut']").click()
    turns = np.linspace(0, 1, 30)
    stroke = np.stack([80 + 10 * np.sin(9 * turns), -20 + 90 * turns], axis=-1)
    mouse = page.page.mouse
    mouse.move(*page.to_screen(stroke[0]))
    mouse.down()
    for place in stroke[1:]:
        mouse.move(*page.to_screen(place))
    mouse.up()
    page.wait_answered()
    line = page.editor.cuts[1].region
    assert line.kind == "line"
    assert 5 < len(line.vertices) < 25
    assert np.abs(Line(line.vertices).signed_distance(stroke)).max() < 1.0
    assert page.js(f"{PAGE}.tools.pen.isOn") is False


def test_points_show_the_region_they_bend(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, two_sides(), cuts=[Cut(Line([(71, -20), (71, 70)]))]))
    fills = page.js("""[...document.querySelectorAll('.dnb-ed-target')].map((t) => {
        const [disc, form] = ['disc', 'form'].map((name) => getComputedStyle(t.querySelector(`.dnb-ed-${name}`)));
        return [t.dataset.region, disc.display, form.display, form.fill]; })""")
    right, left = ["1", "none", "inline", "rgb(0, 158, 115)"], ["0", "inline", "none", "rgb(213, 94, 0)"]
    assert fills == [left] * 3 + [right] * 3
    assert page.page.locator(".dnb-ed-legend").inner_text().split() == ["3", "3"]
    bands = page.js("[...document.querySelectorAll('.dnb-ed-shape-bands path')].map((b) => b.dataset.region)")
    assert sorted(bands) == ["0", "1"]
    page.editor.cuts = []
    page.wait_settled()
    assert page.js("document.querySelector('.dnb-ed-target').hasAttribute('data-region')") is False


def test_the_grid_is_split_at_a_cut(open_editor: Any, picture: Picture) -> None:
    points = two_sides().move(0, [40, -10]).move(1, [35, 25]).move(2, [40, 60])
    page = open_editor(Editor(picture, points, cuts=[Cut(Line([(71, -40), (71, 90)]))], density=8))
    runs = page.js(f"{PAGE}.layers.grid.last.lines.map((l) => l.runs.map((r) => Array.from(r)))")
    across = [line for line in runs if len(line) == 2]
    assert len(across) == 8  # the lines from left to right, 7 cells high
    for left, right in across:
        assert left[-2] == pytest.approx(61, abs=0.02)
        assert right[0] == pytest.approx(71, abs=0.02)


# ---- rigid parts ----------------------------------------------------------------------------------------------------


def test_nothing_moves_within_a_rigid_part(open_editor: Any, picture: Picture) -> None:
    points = ControlPoints.from_arrays([[30.0, -10], [110, -5], [100, 60], [35, 70], [60, 25]])
    page = open_editor(Editor(picture, points, show_grid=False, theme="light"))
    before = page.canvas()
    corners = [(75, 10), (100, 12), (98, 45), (72, 40)]
    draw(page, "p", corners)
    (part,) = page.editor.parts
    assert part.region.vertices == pytest.approx(np.array(corners), abs=0.4)
    page.drag((60, 25), (-30, 45))
    page.wait_answered()
    at, after = page.raster().points(), page.canvas()
    within = Polygon(part.region.vertices).signed_distance(at) < -0.2
    assert within.sum() > 5000
    assert np.abs(after - before)[within].max() <= 1
    assert np.abs(after - before)[~within].max() > 40
    assert_as_the_core(page, picture, 100_000)


def test_a_point_cannot_be_dragged_into_a_part(open_editor: Any, picture: Picture) -> None:
    part = RigidPart(Polygon([(75, 10), (100, 10), (100, 45), (75, 45)]), name="bone")
    page = open_editor(Editor(picture, two_sides(), parts=[part], stop_at_folds=False))
    x, y = page.to_screen((45, 25))
    there = page.to_screen((85, 25))
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(*there, steps=4)
    page.wait_settled()
    assert page.js("document.querySelector('[data-id=\"1\"]').classList.contains('dnb-ed-locked')")
    assert 'cannot go into the rigid part "bone"' in message_text(page.page)
    page.page.mouse.up()
    assert page.points.target[1] == pytest.approx([75, 25], abs=0.1)  # as far as it may go
    assert page.points.target[1][0] < 75
    assert page.js("document.querySelectorAll('.dnb-ed-locked').length") == 0
    page.editor.fit()


@pytest.mark.parametrize("how", ["carry", "switch off"])
def test_a_part_around_a_dragged_point_asks_what_becomes_of_the_point(
    open_editor: Any, picture: Picture, how: str
) -> None:
    points = two_sides().move(1, [55, 25])
    editor, corners = Editor(picture, points), [(45.0, 15.0), (70.0, 15.0), (70.0, 35.0), (45.0, 35.0)]
    page = open_editor(editor)
    draw(page, "p", corners)
    assert editor.parts == ()
    assert "Point 2 in this rigid part requires another movement" in message_text(page.page)
    page.wait("document.querySelector('.dnb-ed-draft').getAttribute('visibility') === 'visible'")  # the outline is kept
    page.page.keyboard.press("Escape")
    page.wait("document.querySelector('.dnb-ed-draft').getAttribute('visibility') === 'hidden'")
    assert page.page.locator("[data-action]").count() == 0
    draw(page, "p", corners)
    page.js(f"{{ {PAGE}.messages.show('It has failed'); }}")
    assert message_text(page.page) == "It has failed"
    page.page.get_by_role("button", name="Close this message").click()
    assert "Point 2 in this rigid part requires another movement" in message_text(page.page)  # it waits for an answer
    page.page.get_by_role("button", name="Close this message").click()
    page.wait("document.querySelector('.dnb-ed-draft').getAttribute('visibility') === 'hidden'")
    draw(page, "p", corners)
    page.page.locator("[data-action=carry]" if how == "carry" else "[data-action=off]").click()
    page.wait_answered()
    np.testing.assert_allclose(editor.parts[0].region.vertices, corners, atol=0.1)
    part = RigidPart(Polygon(editor.parts[0].region.vertices))
    assert editor.points == without_conflicts(points, [part], how) != points
    assert page.js(f"{PAGE}.tools.shapes.choice.shape.region.vertices.length") == 4
    editor.fit()
    page.page.locator("[data-command=undo]").click()  # one edit
    page.wait_answered()
    assert (editor.parts, editor.points) == ((), points)
    page.page.locator("[data-command=redo]").click()
    page.wait_answered()
    assert (len(editor.parts), editor.points) == (1, without_conflicts(points, [part], how))


def test_the_fixed_side_is_the_half_that_bears_its_name_until_the_sides_are_swapped(
    open_editor: Any, picture: Picture
) -> None:
    page = open_editor(Editor(picture, two_sides()))
    draw(page, "g", [(20, 40), (120, 45)], end=None)
    region = page.editor.parts[0].region
    assert page.editor.parts[0].name == "fixed side"
    fixed = HalfSpace(region.point, region.normal)
    assert fixed.signed_distance([[70.0, 20.0], [70.0, 78.0]]) == pytest.approx([22.5, -35.5], abs=0.6)

    def names_half() -> list[float]:
        label = page.page.locator(".dnb-ed-shape-name").bounding_box()
        stage = page.page.locator(".dnb-ed-stage").bounding_box()
        x, y = label["x"] + label["width"] / 2 - stage["x"], label["y"] + label["height"] / 2 - stage["y"]
        return page.js(f"{PAGE}.viewport.placeAt([{x}, {y}])")

    assert fixed.signed_distance([names_half()])[0] < 0
    for press in (
        lambda: page.page.keyboard.press("f"),
        lambda: page.page.locator(".dnb-ed-swap").click(),
        lambda: (page.page.locator(".dnb-ed-swap").focus(), page.page.keyboard.press("Enter")),
    ):
        normal = page.editor.parts[0].region.normal
        press()
        page.wait_answered()
        assert page.editor.parts[0].region.normal == pytest.approx(-np.array(normal))
    assert fixed.signed_distance([names_half()])[0] > 0


def test_the_side_of_what_was_dragged_is_not_the_fixed_one(open_editor: Any, picture: Picture) -> None:
    points = two_sides()
    low = int(np.argmax(points.target[:, 1]))
    page = open_editor(Editor(picture, points.move(points.ids[low], points.target[low] + [2.0, 1.0])))
    draw(page, "g", [(20, 40), (120, 45)], end=None)
    region = page.editor.parts[0].region
    assert HalfSpace(region.point, region.normal).signed_distance([points.target[low]])[0] > 0


# ---- reshaping ------------------------------------------------------------------------------------------------------


def test_corners_are_dragged_made_and_deleted(open_editor: Any, picture: Picture) -> None:
    start = [(71.0, -20.0), (75.0, 20.0), (71.0, 70.0)]
    page = open_editor(Editor(picture, two_sides(), cuts=[Cut(Line(start))]))
    k = page.js(f"{PAGE}.viewport.view.k")
    page.page.mouse.click(*page.to_screen((73, 0)))  # choose it by its line
    page.drag((75, 20), (30, 10))
    vertices = np.array(start) + np.array([[0, 0], [30 / k, 10 / k], [0, 0]])
    page.wait_answered()
    assert page.editor.cuts[0].region.vertices == pytest.approx(vertices, abs=1e-6)
    middle = vertices[1:].mean(axis=0)
    page.drag(middle, (-25, 0))
    page.wait_answered()
    assert page.editor.cuts[0].region.vertices[2] == pytest.approx(middle - [25 / k, 0], abs=1e-6)
    page.page.keyboard.press("Delete")  # the new corner has the focus
    page.wait_answered()
    assert page.editor.cuts[0].region.vertices == pytest.approx(vertices, abs=1e-6)
    for _ in range(3):
        page.page.keyboard.press("Control+z")
    page.wait_answered()
    assert page.editor.cuts[0].region.vertices == pytest.approx(np.array(start))


def test_a_double_click_on_an_end_lets_a_cut_stop_there(open_editor: Any, picture: Picture) -> None:
    """Its tip is dragged like a corner; the picture is that of the core, with no gap beyond the tip."""
    line = Line([(71, -20), (71, 15)], stops=(False, False))
    page = open_editor(Editor(picture, two_sides(), show_grid=False, theme="light", cuts=[Cut(line)]))
    page.page.mouse.click(*page.to_screen((71, 0)))
    page.page.mouse.dblclick(*page.to_screen((71, 15)))
    page.wait_answered()
    assert page.editor.cuts == (Cut(Line(line.vertices, stops=(False, True))),)
    assert page.page.locator(".dnb-ed-tip").count() == 1
    page.drag((71, 15), (0, 30))
    page.wait_answered()
    (cut,) = page.editor.cuts
    tip = cut.region.vertices[1]
    assert tip == pytest.approx((71, 15 + 30 / page.js(f"{PAGE}.viewport.view.k")), abs=1e-6)
    pull(page, two_sides(), [0], (-40, 0))
    pull(page, two_sides(), [3], (50, 0))
    page.wait_answered()
    opacity, at = assert_as_the_core(page, picture, 100_000), page.raster().points()
    assert (opacity[at[..., 1] < tip[1] - 12] == 0).sum() > 500
    assert (opacity[at[..., 1] > tip[1] + 4] < 1).sum() == 0
    page.page.mouse.click(*page.to_screen((71, 0)))  # the points were chosen last
    page.page.locator(".dnb-ed-tip").focus()
    page.page.keyboard.press("Enter")
    page.wait_answered()
    assert page.editor.cuts[0].region.stops == (False, False)


def test_a_line_that_would_cross_itself_stays_as_it_was(open_editor: Any, picture: Picture) -> None:
    start = [(50.0, -20.0), (50.0, 20.0), (90.0, 20.0), (90.0, 70.0)]
    page = open_editor(Editor(picture, ControlPoints.empty(), cuts=[Cut(Line(start))]))
    page.page.mouse.click(*page.to_screen((50, 0)))
    page.drag((90, 70), (-50, -500))
    assert "crosses itself" in message_text(page.page)
    page.wait_answered()
    Line(page.editor.cuts[0].region.vertices)
    page.page.keyboard.press("Escape")
    draw(page, "x", [(30, -10), (60, 60), (110, 0), (20, 20)])
    assert "Draw it without a loop" in message_text(page.page)
    assert len(page.editor.cuts) == 1
    assert page.js(f"{PAGE}.tools.pen.draft.places.length") == 4  # and can be mended
    page.page.keyboard.press("Backspace")
    page.page.keyboard.press("Enter")
    page.wait_answered()
    assert len(page.editor.cuts) == 2


# ---- history and Python ---------------------------------------------------------------------------------------------


def test_shapes_and_points_are_undone_in_their_order(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, two_sides()))
    draw(page, "x", [(71, -25), (71, 75)])
    page.drag((45, 25), (-30, 0))
    draw(page, "p", [(105, -20), (125, -20), (125, 10)])
    state = [len(page.editor.cuts), len(page.editor.parts), bool(page.points.displacement.any())]
    assert state == [1, 1, True]
    seen = []
    for key in ["Control+z"] * 3 + ["Control+y"] * 3:
        page.page.keyboard.press(key)
        page.wait_answered()
        seen.append((len(page.editor.cuts), len(page.editor.parts), bool(page.editor.points.displacement.any())))
    assert seen == [(1, 0, True), (1, 0, False), (0, 0, False), (1, 0, False), (1, 0, True), (1, 1, True)]
    kinds = page.js("models.editor.sent.filter((m) => m.type === 'shapes').map((m) => [m.what, m.kind])")
    assert kinds[:2] == [["cuts", "add cut"], ["parts", "add rigid part"]]


def test_python_owns_the_history_where_it_has_one(open_editor: Any, picture: Picture) -> None:
    editor = Editor(picture, two_sides())
    editor.history = {"undo": "", "redo": ""}
    page, asked, heard = open_editor(editor), [], []
    editor.on_history(asked.append)
    editor.on_shapes(heard.append)
    under_way: list[Any] = []
    editor.observe(lambda change: under_way.append(editor.edit_under_way), "cuts")
    draw(page, "x", [(71, -25), (71, 75)])
    assert [(m.what, m.kind, len(m.shapes)) for m in heard] == [("cuts", "add cut", 1)]
    assert isinstance(under_way[0], ShapesEdit)
    editor.history = {"undo": "add cut", "redo": ""}
    page.page.keyboard.press("Control+z")
    page.wait("models.editor.sent.some((m) => m.type === 'history')")
    page.wait_answered()
    assert asked == ["undo"]
    editor.cuts = []
    page.wait_settled()
    assert page.js(f"{PAGE}.points.shapes.cuts.length") == 0
    assert editor.edit_under_way is None


def test_the_chosen_shape_is_the_same_in_python_and_in_the_page_however_late(
    open_editor: Any, picture: Picture
) -> None:
    boxes = [[(a, 5.0), (a + 15, 5.0), (a + 15, 25.0), (a, 25.0)] for a in (20.0, 60.0, 100.0)]
    bones = [RigidPart(Polygon(box), name=name) for box, name in zip(boxes, "abc", strict=True)]
    editor = Editor(picture, ControlPoints.empty(), parts=bones)
    page = open_editor(editor)

    def names() -> tuple[str, str]:
        """The chosen shape in the page, and in Python."""
        chosen = editor.chosen_shape
        name = page.js(f"{PAGE}.tools.shapes.choice.shape?.name ?? ''")
        return name, editor.parts[chosen["index"]].name if chosen else ""

    page.page.mouse.click(*page.to_screen((60.0, 15.0)))
    page.wait_answered()
    assert names() == ("b", "b")
    editor.parts = editor.parts[1:]  # the list is another one before the page has said what is clicked on
    page.held = []
    editor.parts = editor.parts[::-1]
    page.page.mouse.click(*page.to_screen((115.0, 15.0)))
    page.wait("models.editor.sent.at(-1).shape?.name === 'c'")
    assert names() == ("c", "c")
    while page.held:
        page.deliver_next()
        assert names() == ("c", "c")
    page.held = None
    editor.choose("parts", 1)
    assert names() == ("b", "b")
    page.page.keyboard.press("Delete")
    page.wait_answered()
    assert ([part.name for part in editor.parts], names()) == (["c"], ("", ""))


def test_shapes_that_python_refuses_go_back(open_editor: Any, picture: Picture) -> None:
    editor = Editor(picture, two_sides())

    def refuse(change: Any) -> None:
        if change["new"]:
            raise DeformError("no cuts today.")

    editor.observe(refuse, "cuts")
    page = open_editor(editor)
    draw(page, "x", [(71, -25), (71, 75)])
    page.wait(f"{PAGE}.points.shapes.cuts.length === 0")
    assert "no cuts today." in message_text(page.page)
    assert editor.cuts == ()


# ---- keys -----------------------------------------------------------------------------------------------------------


def test_a_cut_is_drawn_named_reshaped_and_deleted_by_keys_alone(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, two_sides()))
    press, k = page.page.keyboard.press, page.js(f"{PAGE}.viewport.view.k")
    page.page.locator(".dnb-ed-stage").focus()
    press("x")
    for _ in range(10):
        press("ArrowUp")
    press("Enter")
    for _ in range(15):
        press("ArrowDown")
    press("Shift+ArrowRight")
    press("Enter")
    assert page.page.locator(".dnb-ed-spoken").inner_text() == "place 2 set"
    press("Enter")  # again on the same place: done
    page.wait_answered()
    a0, a1, b0, b1 = picture.raster.box
    first = np.array([(a0 + a1) / 2, (b0 + b1) / 2 - 100 / k])
    found = np.array(page.editor.cuts[0].region.vertices)
    assert found == pytest.approx(np.stack([first, first + np.array([1, 150]) / k]), abs=1e-6)
    focused = "document.activeElement.getAttribute('aria-label')"
    assert page.js(focused) == "Cut 1, open line with 2 corners"
    press("F2")
    page.page.keyboard.type("mouth")
    press("Enter")
    page.wait_answered()
    assert page.editor.cuts[0].name == "mouth"
    assert page.js(focused) == "Cut 1 mouth, open line with 2 corners"
    press("o")
    page.wait_answered()
    assert page.editor.cuts[0].enabled is False
    press("o")
    press("Tab")
    assert page.js(focused).startswith("Corner 1 of 2 of mouth")
    press("Shift+ArrowLeft")
    page.wait_answered()
    du = picture.raster.spacing[0]
    assert page.editor.cuts[0].region.vertices[0] == pytest.approx(first - [10 * du, 0], abs=1e-6)
    press("Tab")
    press("Tab")
    assert page.js(focused) == "Middle of edge 1: Enter makes it a corner"
    press("Enter")
    page.wait_answered()
    assert len(page.editor.cuts[0].region.vertices) == 3
    press("Delete")
    page.wait_answered()
    assert len(page.editor.cuts[0].region.vertices) == 2
    press("Delete")  # a line of one place is none
    page.wait_answered()
    assert page.editor.cuts == ()


def test_nothing_is_added_in_a_gap(open_editor: Any, picture: Picture) -> None:
    points = two_sides().move(0, [40, -10]).move(1, [35, 25]).move(2, [40, 60])
    page = open_editor(Editor(picture, points, cuts=[Cut(Line([(71, -40), (71, 90)]))]))
    page.page.mouse.dblclick(*page.to_screen((66, 20)))
    assert "This is a gap" in message_text(page.page)
    page.page.mouse.dblclick(*page.to_screen((58, 20)))
    assert len(page.points) == 7
    assert page.points.source[6] == pytest.approx([68, 20], abs=0.3)


def test_escape_gives_a_drawing_up_and_a_read_only_editor_draws_nothing(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, two_sides(), cuts=[Cut(Line([(71, -20), (71, 70)]))]))
    draw(page, "p", [(30, 0), (60, 0), (60, 40)], end="Escape")
    assert page.editor.parts == ()
    page.editor.read_only = True
    page.wait_settled()
    draw(page, "x", [(30, 0), (60, 0)])
    page.page.mouse.click(*page.to_screen((71, 40)))
    page.page.keyboard.press("Delete")
    page.wait_answered()
    assert len(page.editor.cuts) == 1
    assert page.js("document.querySelectorAll('.dnb-ed-grip').length") == 0


@pytest.mark.sampled(2)
@pytest.mark.parametrize("rule", list(CUT_RULES))
def test_the_quick_picture_of_a_drag_is_the_full_one_but_for_corners_of_cuts(
    open_editor: Any, picture: Picture, rule: str
) -> None:
    cut = Cut(Line([(71, -20), (78, 10), (64, 30), (76, 70)]))
    page = open_editor(Editor(picture, two_sides(), show_grid=False, theme="light", cuts=[cut], cut_rule=rule))
    pull(page, two_sides(), [0, 1, 2], (-33, 12))
    full = page.canvas()
    page.js(f"""(() => {{ const {{ map, picture: {{ box, painter }}, theme, viewport: {{ view }} }} = {PAGE};
        painter.cost = 0; // or it would draw fewer pixels
        painter.paint(view, map.layered, {{ isMoving: true, paper: theme.colours.stage }});
        painter.drawFrame(view, box); }})()""")
    quick = page.canvas()
    assert (np.abs(quick - full).max(axis=-1) > 6).mean() < 1e-3


def test_a_double_click_beside_the_end_of_a_line_is_its_own(open_editor: Any, picture: Picture) -> None:
    page = open_editor(Editor(picture, ControlPoints.empty()))
    page.js("{ performance.now = () => 1000; }")  # no time passes
    corners = [(45.0, 15.0), (70.0, 15.0), (70.0, 35.0)]
    page.js(f"{{ {PAGE}.commands.run('cut', null); }}")
    for corner in corners:
        page.page.mouse.click(*page.to_screen(corner))
    page.page.mouse.dblclick(*page.to_screen(corners[0]))  # its first press closes the line
    page.wait_answered()
    assert len(page.editor.cuts) == 1
    assert page.points.ids == ()
    page.page.mouse.dblclick(*page.to_screen((100, 30)))
    page.wait_answered()
    assert len(page.points.ids) == 1

"""Messages and keys of the editor: focus, waiting, hints, tips, folds and the list of keys."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from browser.pane_messages import message_text

from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.messages.editors import PointsEdit

pytestmark = pytest.mark.needs_browser

ON_STAGE = "document.activeElement === document.querySelector('.dnb-ed-stage')"


def notes(page: EditorOnPage) -> str:
    page.wait_settled()
    return message_text(page.page)


# ---- focus ----------------------------------------------------------------------------------------------------------


def test_undo_and_redo_go_on_when_the_point_in_focus_is_gone(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    page.page.mouse.dblclick(*page.to_screen([50, 20]))
    added = page.points
    page.drag(added.target[5], (20, 12))
    moved = page.points
    assert moved != added
    page.page.keyboard.press("Control+z")
    page.page.keyboard.press("Control+z")
    assert page.points.ids == points.ids
    assert page.js(ON_STAGE)
    page.page.keyboard.press("Control+y")
    assert page.points == added
    page.page.keyboard.press("Control+y")
    assert page.points == moved


def test_focus_stays_in_the_editor_when_python_takes_the_point_away(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor, past = Editor(picture, points), [points]

    def edited(edit: PointsEdit) -> None:
        past.append(edit.points)

    def step(way: str) -> None:
        editor.points = past[-2] if way == "undo" else past[-1]

    editor.history = {"undo": "the edit", "redo": "the edit"}
    editor.on_edit(edited, details=True)
    editor.on_history(step)
    page = open_editor(editor)
    page.page.mouse.dblclick(*page.to_screen([50, 20]))
    assert len(page.points) == 6
    assert page.js("document.activeElement.dataset.id") == "5"
    page.page.keyboard.press("Control+z")
    assert page.points == points
    assert page.js(ON_STAGE)
    page.page.keyboard.press("Control+y")
    assert len(page.points) == 6
    page.page.locator("[data-id='2']").focus()
    page.page.keyboard.press("F2")
    editor.points = points.remove(2)  # while its name is being typed
    page.wait_settled()
    page.page.keyboard.press("Enter")
    page.wait_settled()
    assert page.js(ON_STAGE)


def test_focus_outside_stays_outside(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    editor = Editor(picture, points)
    page = open_editor(editor)
    page.js("{ const b = document.createElement('button'); b.id = 'other'; document.body.append(b); b.focus(); }")
    editor.points = points.remove(2)
    page.wait_settled()
    assert page.js("document.activeElement.id") == "other"


# ---- waiting --------------------------------------------------------------------------------------------------------


def test_nothing_is_edited_while_python_makes_another_picture(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor = Editor(picture, points)
    page = open_editor(editor)
    page.drag(points.target[4], (30, 20))
    moved = page.points
    page.page.locator("[data-id='4']").focus()
    editor.waiting = "Making the picture from the front"
    page.wait("document.querySelector('.dnb-ed-waiting') !== null")
    assert page.page.locator(".dnb-ed-wait").inner_text() == "Making the picture from the front"
    assert page.page.locator(".dnb-ed-stage").get_attribute("aria-busy") == "true"
    page.wait("getComputedStyle(document.querySelector('.dnb-ed-veil')).backgroundColor === 'rgba(20, 22, 26, 0.55)'")
    for key in ("Control+z", "ArrowRight", "o", "Home", "Delete", "F2", "a"):
        page.page.keyboard.press(key)
    page.drag(moved.target[4], (-25, 10))
    page.page.mouse.dblclick(*page.to_screen([50, 20]))
    page.page.mouse.click(*page.to_screen(moved.target[1]), button="right")
    page.page.locator("[data-command=undo]").click(force=True)
    page.page.locator("[data-command=reset]").click(force=True)
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("Enter")
    assert page.points == moved
    assert page.js(f"{PAGE}.points.list.map((p) => p.target)") == moved.target.tolist()
    assert page.page.locator("[data-command=undo]").get_attribute("aria-disabled") == "true"
    editor.waiting = ""
    page.wait("document.querySelector('.dnb-ed-waiting') === null")
    assert page.page.locator(".dnb-ed-wait").inner_text() == ""
    page.page.keyboard.press("Control+z")
    assert page.points == points
    page.drag(points.target[4], (12, 0))
    assert page.points != points


def test_waiting_ends_a_drag_and_a_name_as_escape_does(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor, seen = Editor(picture, points), []
    editor.on_edit(lambda p, phase: seen.append((phase, p.target[4].tolist())))
    page = open_editor(editor)
    x, y = page.to_screen(points.target[4])
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    page.page.mouse.move(x + 40, y + 20, steps=4)
    page.wait("models.editor.sent.length > 0")
    editor.waiting = "Another picture"
    page.wait("document.querySelector('.dnb-ed-waiting') !== null")
    page.page.mouse.move(x + 60, y + 30, steps=3)
    assert page.js(f"[{PAGE}.tools.drag.drag0, {PAGE}.points.list.map((p) => p.target)]") == [
        None,
        points.target.tolist(),
    ]
    page.page.mouse.up()
    assert page.points == points
    assert page.js(f"{PAGE}.points.list.map((p) => p.target)") == points.target.tolist()
    page.wait("models.editor.sent.at(-1).points[4].target[0] === 70")
    assert {phase for phase, _ in seen} == {"move"}
    editor.waiting = ""
    page.wait("document.querySelector('.dnb-ed-waiting') === null")
    page.page.keyboard.press("F2")
    page.page.keyboard.type("x")
    editor.waiting = "Another picture"
    page.wait("document.querySelector('.dnb-ed-input').hidden")
    assert page.points == points


# ---- what is said ---------------------------------------------------------------------------------------------------


def test_points_that_turn_without_a_fold_are_not_said_to_fold(open_editor: Any, picture: Picture) -> None:
    # Four points turned by 90 degrees within a fixed ring: neighbours pass each other, and the map does not fold.
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.c_[np.cos(angles), np.sin(angles)] * 50 + [70, 25]
    four = np.array([[80.0, 25], [70, 35], [60, 25], [70, 15]])
    source, target = np.concatenate([ring, four]), np.concatenate([ring, np.roll(four, 1, axis=0)])
    editor = Editor(picture, ControlPoints.from_arrays(source, target))
    page = open_editor(editor)
    assert not any("fold" in note for note in editor.fit().notes)
    assert page.js(f"{PAGE}.map.folds.least") > 0
    assert "fold" not in notes(page)
    assert "no folds" in page.page.locator(".dnb-ed-folds").inner_text()
    corners = np.array([[20.0, -20], [120, -20], [120, 70], [20, 70]])
    editor.points = ControlPoints.from_arrays([*corners, [40, 20], [90, 25]], [*corners, [90.5, 25], [90, 25]])
    page.wait_settled()
    assert page.js(f"{PAGE}.map.folds.least") < 0
    assert notes(page) == "control points 5 and 6 are pulled past each other: the map folds there"
    line = np.array([[30.0, 0.0], [60.0, 20.0], [90.0, 40.0]])
    editor.points = ControlPoints.from_arrays(line, line + np.array([[0, 0], [3, 2], [0, 0]]))
    page.wait_settled()
    assert "the control points lie nearly on one line" in notes(page)  # no word on folds, so it stays


def test_whoever_has_not_begun_hears_how_a_point_is_added(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    start = "Double-click adds a point. Drag a disc to move what is under it; ? for keys"
    assert notes(page) == start
    page.drag([52, 30], (8, 12))
    assert notes(page) == "Double-click adds a point to drag; after A, press and drag in one go"
    page.page.get_by_role("button", name="Close this message").click()
    page.drag(points.target[4], (20, 5))
    page.page.keyboard.press("Escape")
    assert notes(page) == "Drag a disc to move what is under it; ? for keys"
    page.editor.points = ControlPoints.empty()
    page.wait_settled()
    assert notes(page) == "Double-click adds a point: one moves the picture, two turn it, three bend it"


def test_a_band_around_points_says_nothing(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.drag([15, 40], (70 * page.js(f"{PAGE}.viewport.view.k"), 30 * page.js(f"{PAGE}.viewport.view.k")))
    assert page.js(f"[...{PAGE}.points.selected]") == [3]
    assert page.page.locator(".dnb-messages").get_attribute("data-kind") == "advice"


def test_tips_explain_the_folds_and_the_points(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    editor = Editor(picture, points.move(1, [115, -9]).edit(3, active=False), support=80.0)
    page = open_editor(editor)
    tip = page.page.locator(".dnb-ed-folds").get_attribute("title")
    assert "smallest factor" in tip
    assert "below 0 the picture folds over itself" in tip
    tips = page.js("[...document.querySelectorAll('[data-id] > title')].map((t) => t.textContent)")
    assert tips[0] == "point 1: not dragged; reaches 80"
    assert tips[1] == "top right: dragged by 5, -4 from 110, -5; reaches 80"
    assert tips[3] == "point 4: not dragged; switched off"
    editor.points = ControlPoints.empty()
    page.wait_settled()
    assert page.page.locator(".dnb-ed-folds").get_attribute("title") == ""


# ---- the list of keys -----------------------------------------------------------------------------------------------

# JupyterLab and other hosts style lists of definitions, tables and spans of their outputs.
HOST = "dl, dt, dd, li { width: 20%; float: left; } "


@pytest.mark.parametrize(("width", "columns"), [(1000, 2), (545, 2), (360, 1)])
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_list_of_keys_is_wide_and_its_keys_never_wrap(
    open_editor: Any, picture: Picture, points: ControlPoints, width: int, columns: int, theme: str
) -> None:
    page = open_editor(Editor(picture, points, theme=theme, height=240), size=(width, 600))
    page.page.add_style_tag(content=HOST)
    page.page.locator(".dnb-ed-stage").focus()
    page.page.keyboard.press("?")
    panel, stage = (page.page.locator(f".dnb-ed-{name}").bounding_box() for name in ("help", "stage"))
    assert panel["width"] >= min(600, width - 16)
    assert panel["x"] >= stage["x"]
    assert panel["x"] + panel["width"] <= stage["x"] + stage["width"]
    assert panel["y"] + panel["height"] <= stage["y"] + stage["height"]
    rows = page.js("""[...document.querySelectorAll(".dnb-ed-entry")].map((row) => [...row.children].map((e) => {
        const b = e.getBoundingClientRect(); return [b.left, b.right, b.height, e.textContent]; }))""")
    assert len({key[0] for key, _ in rows}) == columns
    assert all(key[2] < 20 for key, _ in rows)  # one line
    assert all(key[1] <= what[0] and what[1] <= panel["x"] + panel["width"] for key, what in rows)
    assert all(what[2] < 40 for _, what in rows)
    assert ["Enter on a point", "select it"] in [[key[3], what[3]] for key, what in rows]
    assert ["Enter on the picture", "add a point in the middle"] in [[key[3], what[3]] for key, what in rows]
    assert panel["height"] > stage["height"] - 16  # the rest by scrolling, with the keys too
    page.page.keyboard.press("End")
    page.wait(
        "(([p, e]) => e.bottom <= p.bottom)([document.querySelector('.dnb-ed-help'), "
        "[...document.querySelectorAll('.dnb-ed-entry')].at(-1)].map((e) => e.getBoundingClientRect()))"
    )

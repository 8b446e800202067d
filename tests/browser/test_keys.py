"""The list of keys: one table for the handlers, the list on "?", and the tips of the buttons."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage
from browser.test_space_editor_page import Opened, waves
from scripts import run_script

from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.widgets.bundle import SOURCES
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.editor.space_editor import SpaceEditor


def script_keys(name: str) -> set[str]:
    """Keys that a script compares with: every quoted text beside a `key`, and the names of its tables of keys."""
    text = re.sub(r"//.*", "", (SOURCES / name).read_text(encoding="utf-8"))
    found = set(re.findall(r"\bkey === \"([^\"]+)\"", text))
    for table in re.findall(r"(?:arrows|SPACE_ARROWS|TURN_WAYS|turns)(?:: [^=]*)? = \{([^}]*)\}", text):
        found |= {a or b for a, b in re.findall(r"(?:\"([^\"]+)\"|(\b[A-Z]\w+)): ", table)}
    return found


def table_keys(table: str) -> set[str]:
    main = f"() => keyRows({table}).flatMap(([, , about]) => about?.keys ?? [])"
    keys = set(run_script(("ui/keys.ts",), main, None))
    return {part.split("+")[-1] or "+" for part in keys}


@pytest.mark.parametrize(
    ("scripts", "table"),
    [
        (("editor/editor_keys.ts", "editor/shape_tools.ts", "editor/brush_tool.ts"), "EDITOR_KEYS"),
        (("space_editor/keys.ts",), "SPACE_EDITOR_KEYS"),
        (("view/pointer.ts", "view/picture_plane.ts"), "VIEW_KEYS"),
    ],
)
def test_every_key_that_is_heard_is_told(scripts: tuple[str, ...], table: str) -> None:
    keys = set().union(*(script_keys(name) for name in scripts))
    assert len(keys) >= 4  # others are taken from the table
    # The same keys with Shift held, on one keyboard or another.
    assert keys - table_keys(table) <= {"<", ">", ";", ":"}


@pytest.mark.parametrize("table", ["EDITOR_KEYS", "SPACE_EDITOR_KEYS"])
def test_no_key_has_two_meanings_and_every_command_is_run(table: str) -> None:
    main = f"() => keyRows({table}).map(([shown, what, about]) => [shown, what, about ?? {{}}])"
    rows = run_script(("ui/keys.ts",), main, None)
    commands = [(key, about["command"]) for _, _, about in rows if "command" in about for key in about["keys"]]
    assert len({key for key, _ in commands}) == len(commands)
    assert all(what and shown for shown, what, _ in rows)
    folder = "editor" if table == "EDITOR_KEYS" else "space_editor"
    text = (SOURCES / folder / "commands.ts").read_text(encoding="utf-8")
    for command in {command for _, command in commands} - {"rotate", "scale", "brush-radius", "zoom"}:
        assert re.search(rf'[{{,\s]"?{command}"?: \(.*?\) =>', text), command


@pytest.mark.needs_browser
def test_the_list_is_a_dialog_that_escape_closes_and_the_focus_returns(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    page.page.locator("[data-id='2']").focus()
    page.page.keyboard.press("?")
    dialog = page.page.get_by_role("dialog", name="Keys and gestures")
    assert dialog.is_visible()
    assert page.js("document.activeElement.className") == "dnb-ed-help"
    groups = page.page.locator(".dnb-ed-help [role=list]")
    assert [groups.nth(k).get_attribute("aria-label") for k in range(groups.count())] == [
        "Points",
        "In the volume",
        "Several points",
        "Brushes",
        "Helpers",
        "Cuts and rigid parts",
        "View",
    ]
    before = page.points
    page.page.keyboard.press("Delete")  # keys of the editor rest while the list is read
    assert page.points == before
    page.page.keyboard.press("Escape")
    assert dialog.is_hidden()
    assert page.js("document.activeElement.dataset.id") == "2"
    page.page.locator("[data-command=help]").click()
    assert dialog.is_visible()
    page.page.keyboard.press("?")
    assert dialog.is_hidden()


@pytest.mark.needs_browser
def test_tips_tell_the_keys_and_the_keys_do_what_the_tips_tell(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points, wand={"region": None}))
    tips = dict(
        page.js(
            "[...document.querySelectorAll('.dnb-editor [data-command]')].map((b) => "
            "[b.dataset.command, [b.title, b.getAttribute('aria-keyshortcuts')]])"
        )
    )
    assert tips["add"] == ["Add points: press on a feature and drag it, or click (Double-click, A)", "A"]
    assert tips["undo"] == ["Undo (Ctrl+Z)", "Control+Z"]
    assert tips["mirror-axis"] == ["Make the line of the mirror horizontal or vertical (Shift+M)", "Shift+M"]
    assert tips["zoom-in"][1] == "+"
    for command, key in (
        ("move", "s"),
        ("grow", "e"),
        ("cut", "x"),
        ("part", "p"),
        ("fixed", "g"),
        ("grid", "n"),
        ("compare", "c"),
        ("mirror", "m"),
        ("snap", "Shift+N"),
        ("stop", "t"),
        ("radius", "r"),
        ("select", "b"),
        ("wand", "q"),
    ):
        button = page.page.locator(f"[data-command={command}]")
        state = "aria-checked" if button.get_attribute("role") == "menuitemcheckbox" else "aria-pressed"
        before = button.get_attribute(state)
        page.page.locator(".dnb-ed-stage").focus()
        page.page.keyboard.press(key)
        page.wait_settled()
        assert button.get_attribute(state) != before, command


# ---- in space -------------------------------------------------------------------------------------------------------


@pytest.mark.needs_browser
def test_the_editor_in_space_lists_its_keys_locks_and_selects_by_a_band(page: LivePage) -> None:
    start = ControlPoints.from_arrays([[-10.0, 25, 20], [10, 45, 30], [25, 40, 25]])
    space = Opened(page, SpaceEditor(waves(), start.edit(1, locked=True), cursor=[-10.0, 25, 20]))
    keyboard, editor = page.page.keyboard, space.editor
    page.page.locator("[data-id='0']").first.focus()
    keyboard.press("?")
    assert page.page.get_by_role("dialog", name="Keys and gestures").is_visible()
    assert page.page.locator(".dnb-ed-help").get_by_text("lock, unlock").is_visible()
    keyboard.press("Escape")
    assert space.js("document.activeElement.dataset.id") == "0"
    page.page.locator("[data-id='1']").first.focus()
    for key in ("ArrowRight", "Delete"):
        keyboard.press(key)
    space.drag(0, start.target[1], (20, 10))
    assert np.array_equal(editor.points.target, start.target)
    assert page.page.locator("[data-id='1'] .dnb-ed-lock").first.is_visible()
    keyboard.press("Control+a")
    keyboard.press("l")
    space.wait_settled()
    assert editor.points.locked.tolist() == [True] * 3
    keyboard.press("l")
    space.wait_settled()
    assert not editor.points.locked.any()
    keyboard.press("Escape")
    stage = page.page.locator(".dnb-sp-stage").first.bounding_box()
    keyboard.down("Shift")
    space.mouse.move(stage["x"] + 3, stage["y"] + 3)
    space.mouse.down()
    space.mouse.move(stage["x"] + stage["width"] - 3, stage["y"] + stage["height"] - 3, steps=4)
    space.mouse.up()
    keyboard.up("Shift")
    space.wait_settled()
    assert space.js("[...document.querySelector('.dnb-space').deformnb.parts.points.selected]") == [
        0
    ]  # the only one on the slice
    assert np.allclose(editor.cursor, [-10, 25, 20])  # the cross-hair stays
    editor.close()

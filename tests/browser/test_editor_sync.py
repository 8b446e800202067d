"""The editor's page and its Python: what each hears of the other, and what is said where one does not answer."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from browser.editor_page import PAGE, EditorOnPage
from browser.pane_messages import message_script, message_text

from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture
from deformnb.widgets.editor.editor import Editor

pytestmark = pytest.mark.needs_browser


def pressed(page: EditorOnPage, place: Any, *ways: tuple[float, float]) -> None:
    """The mouse goes down on a place of the picture and moves; it stays down."""
    x, y = page.to_screen(place)
    page.page.mouse.move(x, y)
    page.page.mouse.down()
    for dx, dy in ways:
        page.page.mouse.move(x + dx, y + dy, steps=4)


# ---- the history in Python ------------------------------------------------------------------------------------------


class History:
    """Undo of an editor's points in Python, as whoever owns a document keeps it."""

    def __init__(self, editor: Editor) -> None:
        self.editor = editor
        self.past: list[tuple[str, ControlPoints]] = []
        self.future: list[tuple[str, ControlPoints]] = []
        self._shown = editor.points
        editor.observe(self._edited, "points")
        editor.on_history(self._step)
        self._publish_history()

    def _publish_history(self) -> None:
        self.editor.history = {
            "undo": f"{len(self.past)} back" if self.past else "",
            "redo": f"{len(self.future)} on" if self.future else "",
        }

    def _edited(self, change: Any) -> None:
        if self.editor.edit_under_way is not None:
            self.past.append((self.editor.edit_under_way.kind, self._shown))
            self.future, self._shown = [], change["new"]
            self._publish_history()

    def _step(self, way: str) -> None:
        source, target = (self.past, self.future) if way == "undo" else (self.future, self.past)
        if source:
            kind, points = source.pop()
            target.append((kind, self._shown))
            self._shown = self.editor.points = points
            self._publish_history()


def test_python_owns_the_undo_where_it_says_so(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    editor = Editor(picture, points)
    page, held = open_editor(editor), History(editor)
    button = page.page.locator("[data-command=undo]")
    page.wait("document.querySelector('[data-command=undo]').ariaDisabled === 'true'")
    page.drag(points.target[4], (40, 20))
    page.page.keyboard.press("Delete")
    page.wait_answered()
    assert [kind for kind, _ in held.past] == ["move", "remove"]
    assert (button.get_attribute("title"), button.get_attribute("aria-label")) == ("Undo 2 back (Ctrl+Z)",) * 2
    page.page.locator(".dnb-messages-text").click()  # nothing there takes the focus by itself
    page.page.keyboard.press("Control+z")
    page.wait_answered()
    assert page.js(f"{PAGE}.points.list.length") == len(editor.points) == 5
    button.click()  # and a button keeps the focus
    page.page.keyboard.press("Control+y")
    page.page.keyboard.press("Control+z")
    page.wait_answered()
    assert editor.points == points
    assert page.js(f"{PAGE}.points.list.map((p) => p.target)") == points.target.tolist()
    ways = [m["way"] for m in page.js("models.editor.sent") if m["type"] == "history"]
    assert ways == ["undo", "undo", "redo", "undo"]
    page.page.keyboard.press("?")
    page.page.keyboard.press("Control+y")  # over the list of keys too
    page.wait_answered()
    assert editor.points == page.points != points
    editor.history = {}
    page.wait("document.querySelector('[data-command=undo]').title === 'Undo (Ctrl+Z)'")


def lit(page: EditorOnPage) -> tuple[bool, bool]:
    """Check whether undo and redo are enabled on the page."""
    undo, redo = (page.page.locator(f"[data-command={way}]").get_attribute("aria-disabled") for way in ("undo", "redo"))
    return undo == "false", redo == "false"


def test_undo_and_redo_are_lit_by_what_is_there_however_late_python_answers(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor = Editor(picture, points)
    page, held = open_editor(editor), History(editor)
    page.held = []
    sent = "models.editor.sent.length === {}"
    pressed(page, points.target[4], (40, 20))
    page.page.mouse.up()
    page.wait(sent.format(1))
    page.wait_settled()
    assert (lit(page), len(held.past)) == ((True, False), 1)  # Python has it, the page has not heard of that
    while page.held:
        assert lit(page) == (True, False)
        page.deliver_next()
    for _ in range(3):  # faster than any answer, and once more than there is to undo
        page.page.keyboard.press("Control+z")
    page.wait(sent.format(4))
    page.wait_settled()
    while page.held:
        assert lit(page)[1]
        page.deliver_next()
    assert lit(page) == (False, True)
    pressed(page, points.target[4], (-30, 10))  # an edit right after the undo: there is nothing to do again
    page.page.mouse.up()
    page.wait(sent.format(5))
    page.wait_settled()
    while page.held:
        assert lit(page) == (True, False)
        page.deliver_next()
    assert lit(page) == (True, False)
    page.held = None


def test_a_name_being_typed_keeps_its_own_undo(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.drag(points.target[4], (40, 20))
    moved = page.points
    page.page.keyboard.press("F2")
    page.page.keyboard.type("x")
    page.page.keyboard.press("Control+z")
    page.page.keyboard.press("Escape")
    assert page.points == moved
    page.page.keyboard.press("Control+z")
    assert page.points == points


# ---- what Python hears ----------------------------------------------------------------------------------------------


def test_python_hears_what_was_done_and_what_belongs_together(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor, seen = Editor(picture, points), []
    editor.on_edit(lambda edit: seen.append((edit.kind, edit.joins)), details=True)
    page = open_editor(editor)
    page.page.locator("[data-id='4']").focus()
    page.js(
        f"{{ const {{ history }} = {PAGE}.sender, record = history.record.bind(history); let now = 0;"
        "history.record = (before, kind) => record(before, kind, now += 300); }"
    )  # a slow machine joins as well
    for key in ("ArrowRight", "ArrowRight", "ArrowDown", "o", "ArrowRight", "Home", "Delete"):
        page.page.keyboard.press(key)
        page.wait_answered()
    page.page.keyboard.press("Control+z")
    page.page.mouse.dblclick(*page.to_screen([50, 50]))
    page.page.keyboard.press("F2")
    page.page.keyboard.type("eye")
    page.page.keyboard.press("Enter")
    page.wait_answered()
    assert seen == [
        ("nudge", False),
        ("nudge", True),
        ("nudge", True),
        ("switch", False),
        ("nudge", False),
        ("reset", False),
        ("remove", False),
        ("undo", False),
        ("add", False),
        ("rename", False),
    ]


def test_an_error_of_a_callback_is_seen_while_the_drag_goes_on(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor = Editor(picture, points)

    def fail(_points: ControlPoints, phase: str) -> None:
        if phase == "move":
            raise RuntimeError("no room on the card")

    editor.on_edit(fail)
    page = open_editor(editor)
    pressed(page, points.target[4], (20, 10))
    page.wait("document.querySelector('.dnb-messages').dataset.kind === 'error'")
    assert "RuntimeError in a callback: no room on the card" in message_text(page.page)
    x, y = page.to_screen(points.target[4])
    page.page.mouse.move(x + 50, y - 30, steps=5)
    page.page.mouse.up()
    k = page.js(f"{PAGE}.viewport.view.k")
    assert page.points.displacement[4] == pytest.approx(np.array([-50, 30]) / k, abs=1e-9)


def test_a_drag_that_is_given_up_ends_where_it_began_for_python_too(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor, seen = Editor(picture, points), []
    editor.on_edit(lambda p, phase: seen.append((phase, p == points)))
    page = open_editor(editor)
    pressed(page, points.target[4], (20, 10), (50, 30))
    page.wait_answered()
    page.page.keyboard.press("Escape")
    page.page.mouse.up()
    page.wait_answered()
    assert ("move", False) in seen
    assert seen[-1] == ("move", True)
    assert editor.points == points


# ---- a kernel that does not answer ----------------------------------------------------------------------------------


def test_a_busy_kernel_is_said_until_it_answers(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.drag(points.target[0], (10, 5))
    page.wait(f"{PAGE}.sender.channel.isAnswered")
    pressed(page, points.target[4], (20, 10))
    page.page.mouse.up()  # the answer stays in the outbox
    is_said = f"{message_script()}.startsWith('The kernel is busy; the volume in Python follows later')"
    page.page.wait_for_function(is_said, timeout=60_000)
    page.wait(f"!{is_said}")
    page.drag(points.target[1], (10, 5))
    assert (page.points.target[:2] != points.target[:2]).any(axis=1).all()


def test_edits_that_cannot_be_sent_stay_and_are_said(open_editor: Any, picture: Picture, points: ControlPoints) -> None:
    page = open_editor(Editor(picture, points))
    page.js("{ models.editor.send = () => { throw new Error('Cannot send'); }; }")
    pressed(page, points.target[4], (20, 10))
    page.page.mouse.up()
    page.page.wait_for_function(f"{message_script()}.startsWith('The kernel was restarted or is gone')")
    assert page.js(f"{PAGE}.points.list[4].target[0]") != 70
    assert page.editor.points == points
    assert all("could not be sent" in error for error in page.errors)
    page.js(f"{{ {PAGE}.messages.hint('Drag a disc'); }}")  # which passes
    assert message_text(page.page).startswith("The kernel was restarted or is gone")
    page.page.get_by_role("button", name="Next message").click()
    assert message_text(page.page) == "Drag a disc"
    page.errors.clear()


# ---- several windows ------------------------------------------------------------------------------------------------


def test_two_windows_and_a_new_one_show_what_python_has(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    editor = Editor(picture, points)
    first, second = open_editor(editor), open_editor(editor)

    def send(content: Any, buffers: Any = None) -> None:
        for page in (first, second):
            page.outbox.append(("editor", content, []))

    editor.send = send  # type: ignore[method-assign]
    first.drag(points.target[4], (30, 20))
    first.wait_answered()
    second.drag(points.target[0], (-10, 15))
    second.page.keyboard.press("Control+z")
    second.page.keyboard.press("Control+z")  # what the other window did is undone as well
    second.wait_answered()
    first.drag(points.target[2], (12, 6))
    first.wait_answered()
    second.wait_answered()
    wanted = editor.points.target.tolist()
    assert wanted[:2] == points.target[:2].tolist()
    assert wanted[4] == points.target[4].tolist()
    assert wanted[2] != points.target[2].tolist()
    third = open_editor(editor)
    for page in (first, second, third):
        assert page.js(f"{PAGE}.points.list.map((p) => p.target)") == wanted
    assert set(editor.seen) == {page.js(f"{PAGE}.sender.channel.id") for page in (first, second)}


def test_what_waits_is_sent_when_the_editor_is_closed(
    open_editor: Any, picture: Picture, points: ControlPoints
) -> None:
    page = open_editor(Editor(picture, points))
    page.page.locator("[data-id='4']").focus()
    for _ in range(4):
        page.page.keyboard.press("ArrowRight")  # no answer comes: two are sent, the newest waits
    assert len(page.js("models.editor.sent")) == 2
    page.js("models.editor.cleanups.pop()()")
    page.wait("models.editor.sent.length === 3")
    assert page.editor.points.displacement[4, 0] == pytest.approx(-4 * picture.raster.spacing[0])

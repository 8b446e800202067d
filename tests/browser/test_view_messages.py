"""Messages of a view of the volume: in a row below its picture, one at a time, the most dangerous first."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.app_tab import PATIENCE
from browser.live_page import LivePage
from browser.pane_messages import message_script, message_text
from running_app import RunningApp

from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.view.live_view import LiveView

pytestmark = pytest.mark.needs_browser

MESSAGES = "document.querySelector('.dnb-view').deformnb.elements.messages"
EDITOR = "document.querySelector('.dnb-pane-picture .dnb-editor').deformnb"
LONG = "a message that is much longer than the row is wide " * 6


def set_message(page: Any, source: str, text: str, kind: str = "info") -> None:
    page.evaluate(f"([source, text, kind]) => {MESSAGES}.set(source, text, {{ kind }})", [source, text, kind])


@pytest.fixture
def view_page(page: LivePage) -> Any:
    """The page of a view of a block, drawn, without messages."""
    page.add(LiveView(Volume(np.full((16, 16, 16), 200, np.uint8), Grid((16, 16, 16))), width=320, height=240))
    page.wait_loaded()
    assert message_text(page.page) == ""
    return page.page


def test_the_most_dangerous_comes_first_and_a_button_shows_the_next(view_page: Any) -> None:
    for source, text, kind in (("a", "a fact", "info"), ("b", "a failure", "error"), ("c", "a fold", "warning")):
        set_message(view_page, source, text, kind)
    row = view_page.locator(".dnb-messages")
    assert (message_text(view_page), row.get_attribute("data-kind")) == ("a failure", "error")
    turn = view_page.get_by_role("button", name="Next message")
    assert turn.inner_text() == "1 / 3"
    turn.click()
    assert (message_text(view_page), turn.inner_text()) == ("a fold", "2 / 3")
    set_message(view_page, "a", "another fact")
    assert message_text(view_page) == "a failure"  # what is new begins with the most dangerous again
    set_message(view_page, "b", "")
    assert (message_text(view_page), turn.inner_text()) == ("a fold", "1 / 2")
    set_message(view_page, "c", "")
    assert (message_text(view_page), turn.is_visible()) == ("another fact", False)


def test_a_closed_message_stays_closed_until_its_source_has_another(view_page: Any) -> None:
    set_message(view_page, "a", "a fact")
    set_message(view_page, "b", "a failure", "error")
    close = view_page.get_by_role("button", name="Close this message")
    close.click()
    assert message_text(view_page) == "a fact"
    set_message(view_page, "b", "a failure", "error")  # said again, as with every picture
    assert message_text(view_page) == "a fact"
    close.click()
    assert (message_text(view_page), close.is_visible()) == ("", False)
    set_message(view_page, "b", "another failure", "error")
    assert message_text(view_page) == "another failure"


@pytest.mark.parametrize("width", [320, 900])
def test_a_message_of_any_length_is_whole_and_the_picture_keeps_its_size(view_page: Any, width: int) -> None:
    view_page.set_viewport_size({"width": width, "height": 700})
    before = view_page.locator(".dnb-canvas").bounding_box()
    set_message(view_page, "a", LONG)
    assert view_page.locator(".dnb-canvas").bounding_box() == before
    row, text, close = (
        view_page.locator(part).bounding_box()
        for part in (".dnb-messages", ".dnb-messages-text", ".dnb-messages-close")
    )
    assert row["y"] >= before["y"] + before["height"]
    assert text["height"] > 36  # three lines at least
    assert row["y"] + row["height"] >= text["y"] + text["height"]
    assert close["x"] >= text["x"] + text["width"]
    assert row["width"] <= before["width"]
    set_message(view_page, "a", "short")
    height = view_page.evaluate("() => document.documentElement.scrollHeight")
    set_message(view_page, "a", "")
    assert view_page.evaluate("() => document.documentElement.scrollHeight") == height  # the page does not jump


@pytest.fixture
def studio_page(browser: Any, app: RunningApp) -> Iterator[Any]:
    context = browser.new_context(viewport={"width": 1280, "height": 800})
    opened = context.new_page()
    opened.goto(app.server.url)
    opened.wait_for_function("() => document.querySelector('.dnb-view')?.deformnb?.caster?.isReady", timeout=PATIENCE)
    opened.locator(".dnb-studio-start").wait_for()
    yield opened
    context.close()


@pytest.mark.parametrize("width", [1280, 390])
def test_a_studio_shows_one_message_of_all_beside_the_object(studio_page: Any, app: RunningApp, width: int) -> None:
    page = studio_page
    page.set_viewport_size({"width": width, "height": 800})
    start, row = page.locator(".dnb-studio-start > *").first, page.locator(".dnb-pane-volume .dnb-messages")
    say = app.application.thread.call
    set_message(page, "a", "a fact")
    row.wait_for(state="hidden")
    assert start.is_visible()  # a fact does not hide the examples to begin with
    set_message(page, "b", LONG, "warning")
    row.wait_for()
    start.wait_for(state="hidden")
    page.wait_for_function("""() => { const row = document.querySelector(".dnb-pane-volume .dnb-messages"),
      canvas = document.querySelector(".dnb-canvas").getBoundingClientRect(), { top } = row.getBoundingClientRect();
      return row.scrollHeight <= row.clientHeight + 1 && top >= canvas.bottom - 1; }""")
    words = app.application.studio.parts.words
    say(lambda: words.show("It has failed", is_error=True)).result(30)
    page.get_by_text("It has failed").wait_for()
    row.wait_for(state="hidden")
    page.locator(".dnb-studio-messages .dnb-message-close").click()
    row.wait_for()
    say(lambda: words.show("")).result(30)  # or the next page begins with it
    row.get_by_role("button", name="Close this message").click()
    set_message(page, "a", "")
    start.wait_for()


@pytest.mark.parametrize("width", [1280, 390])
def test_a_message_of_the_editor_is_whole_below_its_picture(studio_page: Any, width: int) -> None:
    page = studio_page
    page.set_viewport_size({"width": width, "height": 800})
    page.evaluate(f"""() => {EDITOR}.messages.set("a", "{LONG}", {{ kind: "warning",
        actions: [{{ name: "one", text: "Larger support", act() {{}} }}] }})""")
    page.wait_for_function("""() => { const status = document.querySelector(".dnb-pane-picture .dnb-ed-status"),
        stage = document.querySelector(".dnb-pane-picture .dnb-ed-stage");
        return status.scrollHeight <= status.clientHeight + 1
          && status.getBoundingClientRect().top >= stage.getBoundingClientRect().bottom - 1; }""")
    row, text, action, close = (
        page.locator(f".dnb-pane-picture {part}").bounding_box()
        for part in (".dnb-messages", ".dnb-messages-text", "[data-action=one]", ".dnb-messages-close")
    )
    assert text["height"] > 34
    assert action["y"] >= text["y"] + text["height"] - 4 or action["x"] >= text["x"] + text["width"]
    assert action["y"] + action["height"] <= row["y"] + row["height"]
    assert close["x"] >= max(text["x"] + text["width"], action["x"] + action["width"])
    page.evaluate(f"""() => {EDITOR}.messages.set("a", "")""")


@pytest.mark.parametrize("width", [1280, 900])
def test_advice_of_two_lines_leaves_the_panes_as_they_are(studio_page: Any, width: int) -> None:
    page = studio_page
    page.set_viewport_size({"width": width, "height": 800})
    canvas, notes = page.locator(".dnb-canvas"), page.locator(".dnb-pane-picture .dnb-messages")
    before = canvas.bounding_box()
    page.locator(".dnb-pane-picture .dnb-ed-stage").focus()
    page.keyboard.press("Control+a")
    page.wait_for_function(f"{message_script('.dnb-pane-picture')}.startsWith('Arrows')")
    assert notes.bounding_box()["height"] == 34  # two lines
    assert canvas.bounding_box() == before
    assert page.evaluate("""() => { const status = document.querySelector(".dnb-pane-picture .dnb-ed-status");
        return status.scrollHeight <= status.clientHeight; }""")

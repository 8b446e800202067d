"""The menu of presets in a page: pictures of the volume, chosen by pointer and keys."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from browser.live_page import LivePage

from deformnb.datasets import PHANTOMS
from deformnb.volume.transfer import PRESETS
from deformnb.widgets import TransferEditor
from deformnb.widgets.inputs.transfer_editor import PresetMenu

pytestmark = pytest.mark.needs_browser

PICTURES = "[...document.querySelectorAll('.dnb-pm-option img')].filter((i) => i.naturalWidth > 100).length"


@pytest.fixture
def page(browser: Any) -> Iterator[LivePage]:
    editor = TransferEditor(PHANTOMS["fish"].make((12, 24, 12)), "specimen")
    made = LivePage(browser, (420, 300))
    made.add(PresetMenu(editor, value="specimen"), "menu")
    yield made
    made.close()


def test_each_preset_is_shown_on_this_volume_and_chosen(page: LivePage) -> None:
    menu, button = page.widgets["menu"], page.page.get_by_role("button", name="Preset: Specimen")
    assert page.page.get_by_role("option").count() == 0  # while it is closed
    button.click()
    page.wait(f"{PICTURES} === {len(PRESETS)}")
    options = page.page.get_by_role("option")
    assert options.all_inner_texts() == [name.capitalize() for name in PRESETS]
    assert [option.get_attribute("aria-selected") for option in options.all()].count("true") == 1
    box = page.page.get_by_role("listbox").bounding_box()
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= 420
    page.page.get_by_role("option", name="Bone").click()
    page.wait_answered()
    assert menu.value == "bone"
    assert page.page.get_by_role("option").count() == 0
    assert page.page.get_by_role("button", name="Preset: Bone").is_visible()


def test_keys_go_round_and_choose_and_escape_changes_nothing(page: LivePage) -> None:
    menu, keyboard = page.widgets["menu"], page.page.keyboard
    page.page.get_by_role("button", name="Preset: Specimen").focus()
    for keys, value in (
        (("Enter", "ArrowLeft", "Escape"), "specimen"),
        (("Enter", "ArrowLeft", "Enter"), "xray"),
        (("Enter", "ArrowRight", " "), "specimen"),
    ):
        for key in keys:
            keyboard.press(key)
        page.wait_answered()
        assert menu.value == value
        assert page.page.evaluate("document.activeElement.className") == "dnb-pm-button"


def test_own_colours_and_a_menu_that_is_off(page: LivePage) -> None:
    menu = page.widgets["menu"]
    menu.value = ""
    page.wait_answered()
    assert page.page.get_by_role("button", name="Preset: Own colours").inner_text() == "Own colours"
    menu.disabled = True
    page.wait_answered()
    assert page.page.get_by_role("button").is_disabled()

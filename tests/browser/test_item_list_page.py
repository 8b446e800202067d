"""The list of rows in a real browser: mouse, keys, names, and what stays while Python answers."""

from __future__ import annotations

from typing import Any

import pytest
from browser.live_page import LivePage

from deformnb.widgets.inputs.item_list import ItemList

pytestmark = pytest.mark.needs_browser

ROWS = [
    {"title": "from the front", "facts": ["front", "5 points"]},
    {"name": "bend", "facts": ["left", "4 points"]},
    {"title": "in space", "facts": ["in space", "8 points"], "on": False},
]


@pytest.fixture
def item_list(page: LivePage) -> Any:
    """A list on a page that does what it is asked for, and tells."""
    items = ItemList(label="Steps", columns=["Step", "Side", "Points"])
    rows, heard = [dict(row) for row in ROWS], []

    def act(what: str, index: int, value: Any) -> None:
        heard.append((what, index, value))
        chosen = index
        if what in ("up", "down"):
            chosen = index + (1 if what == "down" else -1)
            rows.insert(chosen, rows.pop(index))
        elif what == "remove":
            del rows[index]
            chosen = min(index, len(rows) - 1)
        elif what == "double":
            chosen = index + 1
            rows.insert(chosen, dict(rows[index]))
        elif what == "switch":
            rows[index]["on"] = value
        elif what == "rename":
            rows[index]["name"] = value
        items.show(rows, chosen)

    items.on_act(act)
    items.show(rows, 0)
    page.add(items, "items")
    page.heard = heard  # type: ignore[attr-defined]
    yield page
    assert page.errors == []


def texts(page: LivePage) -> list[str]:
    page.flush()
    return [t.strip() for t in page.page.locator(".dnb-il-name").all_inner_texts()]


def until(page: LivePage, count: int) -> None:
    page.wait("true")
    page.wait_until(lambda: len(page.heard) >= count)  # type: ignore[attr-defined]
    page.wait("document.querySelector('.dnb-il-table').ariaBusy !== 'true'")


def test_rows_stand_in_columns_and_none_is_cut_off(item_list: LivePage) -> None:
    assert texts(item_list) == ["from the front", "bend", "in space"]
    left = item_list.page.evaluate("""() => [...document.querySelectorAll(".dnb-il-row")].map((row) =>
        [...row.children].map((cell) => Math.round(cell.getBoundingClientRect().left)))""")
    assert left[0] == left[1] == left[2]
    assert item_list.page.locator(".dnb-il-number").all_inner_texts() == ["1", "2", "3"]
    tall = item_list.page.locator(".dnb-item-list").bounding_box()["height"]
    assert 3 * 26 + 22 <= tall <= 3 * 26 + 30


def test_a_click_chooses_and_buttons_act_on_their_row(item_list: LivePage) -> None:
    page = item_list.page
    page.locator(".dnb-il-fact", has_text="4 points").click()
    until(item_list, 1)
    assert page.locator(".dnb-il-chosen").inner_text().split()[1] == "bend"
    page.locator("[data-part=switch]").nth(2).click()
    until(item_list, 2)
    assert page.locator("[data-part=switch]").nth(2).is_checked()
    page.locator("[data-part=down]").nth(0).click()
    until(item_list, 3)
    assert texts(item_list) == ["bend", "from the front", "in space"]
    page.locator("[data-part=double]").nth(2).click()
    until(item_list, 4)
    page.locator("[data-part=remove]").nth(0).click()
    until(item_list, 5)
    assert texts(item_list) == ["from the front", "in space", "in space"]
    assert [act[:2] for act in item_list.heard] == [  # type: ignore[attr-defined]
        ("choose", 1),
        ("switch", 2),
        ("down", 0),
        ("double", 2),
        ("remove", 0),
    ]


def test_all_is_done_by_keys_and_the_focus_goes_along(item_list: LivePage) -> None:
    page = item_list.page
    page.keyboard.press("Tab")
    assert page.evaluate("() => document.activeElement.textContent") == "from the front"
    page.keyboard.press("ArrowDown")
    page.keyboard.press("Enter")
    until(item_list, 1)
    page.keyboard.press("Alt+ArrowUp")
    until(item_list, 2)
    assert texts(item_list) == ["bend", "from the front", "in space"]
    assert page.evaluate("() => document.activeElement.textContent") == "bend"
    page.keyboard.press("Alt+ArrowUp")  # it is the first
    page.keyboard.press("F2")
    page.keyboard.type("tail")
    page.keyboard.press("Enter")
    until(item_list, 3)
    assert texts(item_list)[0] == "tail"
    page.keyboard.press("F2")
    page.keyboard.type("nonsense")
    page.keyboard.press("Escape")
    assert texts(item_list)[0] == "tail"
    page.keyboard.press("Delete")
    until(item_list, 4)
    assert texts(item_list) == ["from the front", "in space"]
    page.keyboard.press("Tab")
    page.keyboard.press("Space")
    until(item_list, 5)
    assert item_list.heard == [
        ("choose", 1, None),
        ("up", 1, None),
        ("rename", 0, "tail"),  # type: ignore[attr-defined]
        ("remove", 0, None),
        ("switch", 0, False),
    ]


def test_a_name_being_written_outlives_news_of_python(item_list: LivePage) -> None:
    page, items = item_list.page, item_list.widgets["items"]
    page.locator("[data-part=choose]").nth(1).dblclick()  # the first click chooses, and Python answers meanwhile
    page.keyboard.type("ne")
    until(item_list, 1)
    items.show([{**row, "facts": ["new", "facts"]} for row in ROWS], 1)
    item_list.flush()
    page.keyboard.type("ck")
    page.keyboard.press("Enter")
    until(item_list, 2)
    assert item_list.heard[-1] == ("rename", 1, "neck")  # type: ignore[attr-defined]


def test_the_pencil_names_a_row(item_list: LivePage) -> None:
    item_list.page.locator("[data-part=rename]").nth(1).click()
    item_list.page.keyboard.type("neck")
    item_list.page.mouse.click(600, 500)  # elsewhere
    until(item_list, 1)
    assert item_list.heard == [("rename", 1, "neck")]  # type: ignore[attr-defined]


def test_clicks_on_rows_that_have_moved_do_nothing(item_list: LivePage) -> None:
    page = item_list.page
    page.evaluate("() => { const b = document.querySelector('[data-part=remove]'); b.click(); b.click(); }")
    until(item_list, 1)
    item_list.wait_answered()
    assert len(item_list.heard) == 1  # type: ignore[attr-defined]
    assert texts(item_list) == ["bend", "in space"]


def test_names_are_text_and_elements_keep_their_own_keys(item_list: LivePage) -> None:
    item_list.widgets["items"].show([{"name": "<img src=x onerror=alert(1)>", "swatch": "#e0559a"}], 0)
    item_list.flush()
    assert texts(item_list) == ["<img src=x onerror=alert(1)>"]
    assert item_list.page.locator(".dnb-item-list img").count() == 0
    focusable = item_list.page.locator(".dnb-item-list button, .dnb-item-list input")
    for k in range(focusable.count()):
        assert focusable.nth(k).get_attribute("data-lm-suppress-shortcuts") == "true"
        assert focusable.nth(k).get_attribute("aria-label")

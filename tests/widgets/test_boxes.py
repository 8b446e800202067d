"""Boxes of widgets: messages to the front end, and its choices."""

from __future__ import annotations

import gc
import weakref

import ipywidgets as ipw
import pytest
from front_end import deliver
from ipywidgets.embed import dependency_state

from deformnb.errors import DeformError
from deformnb.widgets.boxes import Box, Boxes, Fold, Tabs, column, row
from deformnb.widgets.cell_widgets import close_all


def test_the_front_end_gets_the_tree_and_the_widgets_in_it() -> None:
    a, b = ipw.Button(), ipw.Button()
    inner = row(b)
    boxes = Boxes([column(a, inner, min_width="0")])
    (outer,) = boxes.tree["children"]
    assert (outer["classes"], outer["style"], outer["shown"]) == (["widget-vbox"], {"min-width": "0"}, True)
    assert [outer["children"][0], outer["children"][1]["children"]] == [0, [1]]
    assert boxes.contents == (a, b)
    assert {a.model_id, b.model_id} <= dependency_state(boxes).keys()
    inner.is_visible = False
    inner.children = ()
    inner.set_style(grid_gap=None)
    data = boxes.tree["children"][0]["children"][1]
    assert (data["shown"], data["children"], "grid-gap" in data["style"]) == (False, [], False)
    assert boxes.contents == (a,)
    a.close()
    inner.update()
    assert boxes.contents == ()  # closed widgets are not shown
    boxes.close()


def test_choices_of_the_front_end_are_taken_and_wrong_ones_are_dropped(caplog: pytest.LogCaptureFixture) -> None:
    fold, tabs = Fold(Box(), "Points"), Tabs([Box(), Box()], ["Shape", "View"])
    boxes, chosen = Boxes([fold, tabs]), list[str]()
    fold.changed = lambda: chosen.append(f"fold {fold.is_open}")
    tabs.changed = lambda: chosen.append(f"tab {tabs.selected}")
    for box, index in ((fold, 0), (fold, 0), (tabs, 1), (fold, None)):
        deliver(boxes, {"type": "choose", "box": box.number, "index": index})
    assert chosen == ["fold True", "tab 1", "fold False"]
    assert [child["selected"] for child in boxes.tree["children"]] == [None, 1]
    for number, index in ((tabs.number, 2), (tabs.number, None), (10**6, 0), (tabs.children[0].number, 0), (-1, 0)):
        deliver(boxes, {"type": "choose", "box": number, "index": index})
    assert tabs.selected == 1
    assert caplog.text.count("was dropped") == 5
    with pytest.raises(DeformError, match="nothing to choose"):
        Box().choose(0)
    boxes.close()


def test_a_box_closes_with_what_is_in_it_and_keeps_no_widget_around_it() -> None:
    button = ipw.Button()
    inner = column(button)
    boxes = Boxes([inner])
    reference = weakref.ref(boxes)
    close_all(boxes)
    assert button.comm is None
    del boxes
    gc.collect()
    assert reference() is None
    inner.is_visible = False  # nobody shows it

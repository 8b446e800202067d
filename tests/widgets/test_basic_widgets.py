"""Widgets that share layouts and styles: changes affect one alone, and shared ones outlive them."""

from __future__ import annotations

import ipywidgets as ipw
from comm import get_comm_manager
from studio_driver import a_volume

from deformnb.widgets import Studio
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.cell_widgets import close_all


def test_what_looks_alike_shares_layout_and_style() -> None:
    one, other = (basic.Text(description=name, style={"description_width": "7px"}) for name in "ab")
    assert one.layout is other.layout
    assert one.style is other.style
    wide = basic.Text(layout=basic.layout(width="auto"))
    assert wide.layout is not one.layout
    assert wide.style is not one.style
    assert basic.Label("a").layout is one.layout


def test_a_widget_that_is_hidden_hides_no_other() -> None:
    one, other = (basic.Button(layout=basic.layout(width="3px")) for _ in range(2))
    shared = one.layout
    basic.set_visible(one, True)
    assert one.layout is shared  # nothing had to change
    basic.set_visible(one, False)
    assert (one.layout.display, one.layout.width, other.layout.display) == ("none", "3px", None)
    basic.set_visible(one, True)
    assert one.layout is shared
    own = ipw.Button(layout={"width": "3px"})
    basic.set_visible(own, False)
    assert (own.layout.display, one.layout.display) == ("none", None)  # a user may hold the layout: it stays


def test_what_is_shared_stays_when_a_widget_is_closed_and_comes_back_when_all_are() -> None:
    one = basic.HTML("a")
    own = basic.own_layout(one)
    close_all(one, basic.HTML("b"))
    assert (one.comm, own.comm) == (None, None)
    assert basic.HTML("c").layout.comm is not None
    assert one.style.comm is not None
    for model in basic.shared_models():
        model.close()  # as ipywidgets.Widget.close_all() does
    assert basic.HTML("d").layout.comm is not None
    assert isinstance(basic.HTML("e").style, ipw.widgets.widget_string.HTMLStyle)


def test_a_studio_opens_few_comms() -> None:
    for model in basic.shared_models():
        model.close()
    before = set(get_comm_manager().comms)
    studio = Studio(a_volume())
    studio.wait()
    assert len(set(get_comm_manager().comms) - before) <= 60
    studio.close()

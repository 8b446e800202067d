"""The curve and the keys of the depth in a page: the volume follows them while the mouse is down."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from browser.live_page import LivePage

from deformnb.datasets import PHANTOMS
from deformnb.session.session import Session
from deformnb.widgets import LiveView
from deformnb.widgets.studio.editors import make_editor
from deformnb.widgets.studio.panels.depth import DepthPanel
from deformnb.widgets.studio.view_sync import StudioLink
from deformnb.widgets.worker import Worker

pytestmark = pytest.mark.needs_browser

PAGE = "document.querySelector('.dnb-curves').deformnb"


class Depth:
    """A session whose point moves, its volume in a live view that follows its editor, and what sets the depth."""

    def __init__(self, page: LivePage, rule: str) -> None:
        self.page = page
        self.session = Session(PHANTOMS["bar"].make((24, 24, 32)), view="+y")
        points = self.session.editing.points
        middle = points.source.mean(axis=0)
        self.session.editing.edit_points(points.add(middle, middle + np.array([0.0, 6.0])))
        self.session.editing.change(extrusion=rule)
        self.view = LiveView(self.session.volume, transfer="surface", width=320, height=240)
        self.view.set_camera((0.3, 0.2, -1))
        self.editor, self.worker = make_editor(self.session, 200), Worker()
        self.link = StudioLink(self.session, self.view, self.worker)
        self.panel = DepthPanel(self.session, self._guard, self.link.preview)
        self.widget: Any = self.panel.curve if rule == "modulate" else self.panel.keys
        page.add(self.editor, "editor")
        page.add(self.widget, "depth")
        page.add(self.view, "view")
        self.link.show(self.editor)
        self.session.editing.observe(self._changed, "deformation")
        page.wait_loaded()
        page.wait("document.querySelector('.dnb-view').deformnb.shownField.link.index !== null")

    def _guard(self, action: Any) -> bool:
        action()
        return True

    def _changed(self, _change: Any) -> None:
        self.link.show(self.editor)
        self.panel.refresh()

    def pixels(self) -> Any:
        return self.page.pixels().astype(int)

    def differ(self, before: Any, least: int = 150) -> Any:
        """The picture, once it is another one."""
        self.page.wait_until(lambda: (np.abs(self.pixels() - before).sum(axis=-1) > 25).sum() > least)
        return self.pixels()

    def wait_restored(self, before: Any) -> None:
        self.page.wait_until(lambda: (np.abs(self.pixels() - before).sum(axis=-1) > 40).sum() < 20)

    def press(self, selector: str) -> tuple[float, float]:
        box = self.page.page.locator(selector).bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        self.page.page.mouse.move(x, y)
        self.page.page.mouse.down()
        return x, y


@pytest.fixture
def make_depth(browser: Any) -> Iterator[Any]:
    all_made: list[Depth] = []

    def make(rule: str) -> Depth:
        all_made.append(Depth(LivePage(browser, (760, 1000)), rule))
        return all_made[-1]

    yield make
    for depth in all_made:
        assert depth.page.errors == []
        depth.worker.close()
        depth.page.close()


def test_the_volume_follows_the_curve_while_the_mouse_is_down(make_depth: Any) -> None:
    depth = make_depth("modulate")
    document, before = depth.session.editing.deformation, depth.pixels()
    x, y = depth.press(".dnb-curve-editor [data-node='0'] .dnb-cv-dot")
    depth.page.page.mouse.move(x, y - 60, steps=6)
    lifted = depth.differ(before)
    assert depth.session.editing.deformation is document
    depth.page.page.mouse.move(x, y + 20, steps=6)
    depth.differ(lifted)
    depth.page.page.mouse.move(x, y - 60, steps=6)
    depth.wait_restored(lifted)
    depth.page.page.mouse.up()
    depth.page.wait(f"{PAGE}.link.waiting.size === 0")
    assert depth.session.editing.history["undo"] == "change curve"
    depth.wait_restored(lifted)
    depth.session.editing.undo()
    assert depth.session.editing.deformation == document  # one edit
    depth.wait_restored(before)


def test_a_drag_that_is_given_up_leaves_the_volume_as_it_was(make_depth: Any) -> None:
    depth = make_depth("modulate")
    before = depth.pixels()
    x, y = depth.press(".dnb-curve-editor [data-node='0'] .dnb-cv-dot")
    depth.page.page.mouse.move(x, y - 60, steps=6)
    depth.differ(before)
    depth.page.page.keyboard.press("Escape")
    depth.page.page.mouse.up()
    depth.wait_restored(before)


def test_the_volume_follows_a_key_and_then_its_points_again(make_depth: Any) -> None:
    depth = make_depth("interpolate")
    session = depth.session
    points = session.editing.points
    session.editing.edit_step(0, 1)
    session.editing.edit_points(points.reset())
    depth.page.wait(f"{PAGE}.knots.length === 3")
    before, document = depth.pixels(), session.editing.deformation
    x, y = depth.press(".dnb-depth-keys [data-key='1'] .dnb-cv-dot")
    depth.page.page.mouse.move(x + 250, y, steps=6)
    moved = depth.differ(before)
    assert session.editing.deformation is document
    depth.page.page.mouse.up()
    depth.page.wait(f"{PAGE}.link.waiting.size === 0")
    depth.wait_restored(moved)
    assert session.editing.history["undo"] == "move a key"
    session.editing.undo()
    assert session.editing.deformation == document
    depth.wait_restored(before)

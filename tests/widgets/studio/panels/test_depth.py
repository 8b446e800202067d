"""The panel of the depth: its controls, and a view that follows a curve or a key while the user moves it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from studio_driver import a_drag, a_volume, drag, panel, wait_for

from deformnb.rbf.extrusion import EXTRUSIONS, modulate
from deformnb.rbf.fields import AbstractField
from deformnb.session.session import Session
from deformnb.widgets import Studio
from deformnb.widgets.studio.panels.depth import DepthPanel
from deformnb.widgets.studio.view_sync import StudioLink
from deformnb.widgets.worker import Worker

RAMP = [[0, 0], [1, 1]]
TENT = [[0, 0], [0.5, 1], [1, 0]]


class View:
    """A view that records its contents."""

    def __init__(self) -> None:
        self.fields: list[AbstractField] = []
        self.followed: list[Any] = []

    def follow(self, editor: Any, field: AbstractField, index: int = 0, **_: Any) -> None:
        self.fields.append(field)
        self.followed.append(editor)

    def show_deformation(self, field: AbstractField, **_: Any) -> None:
        self.fields.append(field)
        self.followed.append(None)

    def moves(self, grid: Any) -> Any:
        """Displacement of the middle of every slice along the picture, of the field shown last."""
        middle = (np.asarray(grid.shape[::-1]) - 1) / 2
        at = np.array([[middle[0], k, middle[2]] for k in range(grid.shape[1])])
        return np.linalg.norm(self.fields[-1](grid.index_to_point(at)), axis=-1)


class Depth:
    """A session with one point that moves, its panel, and a view linked to both."""

    def __init__(self, rule: str) -> None:
        self.session = Session(a_volume(), view="+y")
        self.session.editing.edit_points(self.session.editing.points.add([10.0, 10.0], [10.0, 14.0]))
        self.session.editing.change(extrusion=rule)
        self.view, self.worker = View(), Worker()
        self.link = StudioLink(self.session, self.view, self.worker)
        self.refused: list[Exception] = []
        self.panel = DepthPanel(self.session, self.guard, self.link.preview)
        self.editor = object()
        self.session.editing.observe(lambda _: self.link.show(self.editor), "deformation")
        self.link.show(self.editor)

    def guard(self, action: Any) -> bool:
        action()
        return True

    def say(self, widget: Any, value: Any, phase: str, seq: int = 1) -> None:
        deliver(widget, {"type": "edit", "seq": seq, "view": "v", "phase": phase, "value": value})
        self.worker.call(lambda: None).result()  # a call goes before jobs
        done = []
        self.worker.latest("done", lambda: done.append(1))
        while not done:
            self.worker.call(lambda: None).result()

    def curve(self, nodes: Any, phase: str) -> None:
        self.say(self.panel.curve, {"nodes": nodes, "smooth": False}, phase)

    def key(self, knots: Any, phase: str, index: int = 1) -> None:
        self.say(self.panel.keys, {"kind": "move", "index": index, "knots": knots, "selected": index}, phase)

    @property
    def moves(self) -> Any:
        return self.view.moves(self.session.volume.grid)


@pytest.fixture
def make_depth() -> Iterator[Any]:
    all_made: list[Depth] = []

    def make(rule: str) -> Depth:
        all_made.append(Depth(rule))
        return all_made[-1]

    yield make
    for depth in all_made:
        depth.worker.close()


def test_the_view_follows_a_curve_that_is_dragged(make_depth: Any) -> None:
    depth = make_depth("modulate")
    document, undo = depth.session.editing.deformation, depth.session.editing.history["undo"]
    ramp = depth.moves
    depth.curve(TENT, "move")
    tent = depth.moves
    assert depth.session.editing.deformation is document
    assert depth.link.previews == 1
    assert depth.view.followed[-1] is None
    z = np.linspace(0, 1, len(tent))
    assert ramp[-1] > 1
    np.testing.assert_allclose(ramp, ramp[-1] * z, atol=1e-4)
    np.testing.assert_allclose(tent, ramp[-1] * np.minimum(2 * z, 2 - 2 * z), atol=1e-4)
    depth.curve([[0, 0.5], [1, 0.5]], "move")
    np.testing.assert_allclose(depth.moves, ramp[-1] / 2, rtol=1e-4)
    depth.curve([[0, 1], [1, 1]], "end")
    assert depth.session.editing.history["undo"] != undo
    assert depth.view.followed[-1] is depth.editor
    np.testing.assert_allclose(depth.moves, ramp[-1], rtol=1e-4)
    depth.session.editing.undo()
    assert depth.session.editing.deformation == document
    np.testing.assert_allclose(depth.moves, ramp)


def test_a_drag_that_is_given_up_shows_again_what_was_there(make_depth: Any) -> None:
    depth = make_depth("modulate")
    before, document = depth.moves, depth.session.editing.deformation
    depth.curve(TENT, "move")
    assert not np.allclose(depth.moves, before)
    depth.curve(RAMP, "end")  # as Escape sends: nodes with the values of the formula
    np.testing.assert_allclose(depth.moves, before, atol=1e-9)
    assert depth.view.followed[-1] is depth.editor
    shown = len(depth.view.fields)
    depth.link.preview(None)
    assert len(depth.view.fields) == shown  # nothing to give up
    depth.session.editing.undo()
    assert modulate(depth.session.editing.step.curve)[1].tolist() == modulate(document.steps[0].curve)[1].tolist()


def test_the_view_follows_a_key_that_is_dragged(make_depth: Any) -> None:
    depth = make_depth("interpolate")
    session = depth.session
    points = session.editing.points
    session.editing.edit_step(0, 1)
    session.editing.edit_points(points.reset())  # nothing moves at the middle key
    before = depth.moves
    document, knots = session.editing.deformation, session.editing.step.knots
    depth.key([knots[0], 0.8, knots[2]], "move")
    assert session.editing.deformation is document
    count = len(before)
    assert depth.moves[count // 2] > before[count // 2] + 0.1
    assert depth.moves[round(0.8 * (count - 1))] < before[round(0.8 * (count - 1))]
    depth.key(list(knots), "end")
    assert session.editing.deformation is document
    np.testing.assert_allclose(depth.moves, before)
    depth.key([knots[0], 0.8, knots[2]], "move")
    moved = depth.moves
    depth.key([knots[0], 0.8, knots[2]], "end")
    np.testing.assert_allclose(depth.moves, moved)
    assert session.editing.history["undo"] == "move a key"


def test_a_movement_that_comes_after_the_edit_is_not_shown(make_depth: Any) -> None:
    depth = make_depth("modulate")
    step, started = depth.session.editing.step, []
    depth.worker.latest("busy", lambda: started.append(depth.worker) or _until(lambda: len(started) > 1))
    deliver(
        depth.panel.curve,
        {"type": "edit", "seq": 1, "view": "v", "phase": "move", "value": {"nodes": TENT, "smooth": False}},
    )
    depth.link.show(depth.editor)
    shown = len(depth.view.fields)
    started.append(None)  # the thread continues, with a preview from before
    depth.say(depth.panel.keys, {"kind": "select", "index": 0, "knots": [0, 1], "selected": 0}, "move")
    assert len(depth.view.fields) == shown
    assert depth.session.editing.step is step


def test_a_rule_that_was_registered_later_is_offered_and_said(make_depth: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(EXTRUSIONS, "half", lambda: modulate("0.5"))
    depth = make_depth("half")
    assert depth.panel.rule.value == "half"
    assert "A special rule" in depth.panel.hint.value
    assert (depth.panel.curve.layout.display, depth.panel.keys.layout.display) == ("none", "none")


def test_the_studio_shows_a_curve_on_its_way_and_makes_one_edit_of_it() -> None:
    studio = Studio(a_volume())
    drag(studio, a_drag(studio))
    studio.session.editing.change(extrusion="modulate")
    studio.wait()
    document, curve = studio.deformation, panel(studio, "Depth").curve
    for seq, (height, phase) in enumerate(((0.5, "move"), (1.0, "move"), (1.0, "end")), 1):
        if phase == "end":
            wait_for(lambda: studio.stats()["previews"] > 0)
            assert studio.deformation is document
        deliver(
            curve,
            {
                "type": "edit",
                "seq": seq,
                "view": "v",
                "phase": phase,
                "value": {"nodes": [[0, height], [1, 1]], "smooth": False},
            },
        )
    assert studio.session.editing.step.curve == (1.0, 1.0)
    studio.undo()
    assert studio.deformation == document
    studio.close()


def _until(condition: Any) -> None:
    import time

    while not condition():
        time.sleep(0.005)

"""The controls of a rigid part: its middle, and its motion as a turn and a shift, on pictures and in space."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from deformnb.errors import DeformError
from deformnb.rbf.regions import HalfSpace, Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.session.session import Session
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.studio.panels.shapes import PartControls, middle_of, turn_and_shift

GRID = Grid((10, 12, 14), (1.0, 2.0, 3.0), (5.0, -4.0, 7.0))


def done(action: Any) -> bool:
    action()
    return True


def test_the_middle_of_every_kind_of_region() -> None:
    assert middle_of(HalfSpace((1.0, 2.0, 3.0), (0.0, 0.0, 1.0))) == (1.0, 2.0, 3.0)
    around = [(0.0, 0.0), (0.0, 6.0), (3.0, 0.0)]  # a triangle, in the other direction
    assert_allclose(middle_of(Polygon(around)), (1, 2))
    flat = np.zeros((4, 5), bool)
    flat[1:3, 2:5] = True  # rows 1 and 2, columns 2 to 4
    assert_allclose(middle_of(Mask(flat, Raster((4, 5), (2.0, 3.0), (10.0, 20.0)))), (10 + 3 * 2, 20 + 1.5 * 3))
    deep = np.zeros(GRID.shape, bool)
    deep[2:5, 4, 6] = True
    assert_allclose(middle_of(Mask(deep, GRID)), GRID.index_to_point([6.0, 4.0, 3.0]))


@pytest.mark.parametrize("degrees", [-170.0, -30.0, 0.0, 12.5, 179.0])
@pytest.mark.parametrize("axis", [None, 0, 1, 2])
def test_a_motion_is_read_back_as_it_was_set(degrees: float, axis: int | None) -> None:
    about = (3.0, -2.0) if axis is None else (3.0, -2.0, 8.0)
    shift = (1.5, -0.5) if axis is None else (1.5, -0.5, 4.0)
    motion = RigidMotion.turn(degrees, about, shift, None if axis is None else np.eye(3)[axis])
    found, found_axis, found_shift = turn_and_shift(motion, about)
    assert found == pytest.approx(degrees, abs=1e-9)
    assert_allclose(found_shift, shift, atol=1e-9)
    if degrees and axis is not None:
        assert found_axis == axis


def test_a_part_in_space_is_turned_about_an_axis_of_its_own() -> None:
    session = Session(Volume(np.zeros(GRID.shape, np.uint8), GRID))
    session.steps.add(in_space=True)
    values = np.zeros(GRID.shape, bool)
    values[4:6, 5:7, 6:8] = True
    session.editing.edit_parts([RigidPart(Mask(values, GRID), name="stone")])
    panel = PartControls(session, done, lambda: 0)
    found = {c.widget.description: c.widget for c in panel.controls}
    found["Part"].value = "moved"
    panel.refresh()
    assert found["About"].layout.display == found["Shift z"].layout.display is None
    assert found["Shift right"].layout.display == "none"
    found["About"].value = "0"
    found["Turn"].value = 90.0
    found["Shift z"].value = 2.0
    middle = np.array(middle_of(session.editing.step.parts[0].region))
    moved = session.editing.step.parts[0].motion(
        [middle + np.array([0, 1, 0])]
    )  # y turns to z, by the right hand about x
    assert_allclose(moved, [middle + np.array([0, 0, 1 + 2.0])], atol=1e-9)
    assert session.editing.history["undo"] == "shift stone"
    found["About"].value = "2"
    moved = session.editing.step.parts[0].motion([middle + np.array([1, 0, 0])])
    assert_allclose(moved, [middle + np.array([0, 1, 2.0])], atol=1e-9)
    found["Part"].value = "fixed"
    assert session.editing.step.parts[0].motion is None


def test_a_slow_hand_on_each_slider_makes_one_edit(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr("deformnb.session.history.time", SimpleNamespace(monotonic=lambda: now, time=time.time))
    session = Session(Volume(np.zeros(GRID.shape, np.uint8), GRID))
    session.steps.add(in_space=True)
    values = np.zeros(GRID.shape, bool)
    values[4:6, 5:7, 6:8] = True
    still = RigidMotion.turn(0.0, (9, 8, 20), axis=(0, 0, 1))
    session.editing.edit_parts([RigidPart(Mask(values, GRID), name="stone", motion=still)])
    found = {c.widget.description: c.widget for c in PartControls(session, done, lambda: 0).controls}
    states = []
    for name in ("Turn", "Shift x", "Shift y", "Reach"):
        states.append(session.editing.deformation)
        for value in (0.5, 1.0, 1.5):
            found[name].value = value
            now += 2.0
    for state in reversed(states):
        session.editing.undo()
        assert session.editing.deformation == state


def test_a_part_turns_about_a_joint_that_is_chosen() -> None:
    session = Session(Volume(np.zeros(GRID.shape, np.uint8), GRID))
    bone = Polygon([(2, 2), (5, 2), (5, 6), (2, 6)])
    session.editing.edit_parts([RigidPart(bone, name="shin")], "draw shin")
    panel = PartControls(session, done, lambda: 0)
    found = {c.widget.description: c.widget for c in panel.controls}
    found["Part"].value = "moved"
    panel.refresh()
    assert (found["Pivot right"].value, found["Pivot down"].value) == middle_of(bone)
    assert found["Pivot right"].layout.display is None
    assert found["Pivot x"].layout.display == "none"
    found["Pivot right"].value = 2.3
    found["Pivot down"].value = 1.9
    panel.refresh()
    found["Turn"].value = 30.0
    assert_allclose(session.editing.step.parts[0].motion([(2.3, 1.9)]), [(2.3, 1.9)], atol=1e-9)
    found["Shift right"].value = -2.8
    panel.refresh()
    assert found["Shift right"].value == pytest.approx(-2.8)
    found["Pivot down"].value = 6.0  # turned as much and shifted as far as before, about another place
    assert_allclose(session.editing.step.parts[0].motion([(2.3, 6.0)]), [(2.3 - 2.8, 6.0)], atol=1e-9)
    assert np.degrees(np.arctan2(*session.editing.step.parts[0].motion.matrix[1])) == pytest.approx(30.0)


def test_the_controls_show_a_pivot_and_a_motion_that_were_set_on_the_picture() -> None:
    session = Session(Volume(np.zeros(GRID.shape, np.uint8), GRID))
    bone = Polygon([(2, 2), (5, 2), (5, 6), (2, 6)])
    session.editing.edit_parts([RigidPart(bone)])
    panel = PartControls(session, done, lambda: 0)
    found = {c.widget.description: c.widget for c in panel.controls}
    motion = RigidMotion.turn(25, (5, 2), (1.5, -0.5))
    session.editing.edit_parts([RigidPart(bone, motion, pivot=(5, 2))])
    panel.refresh()
    assert found["Part"].value == "moved"
    shown = [found[name].value for name in ("Turn", "Shift right", "Shift down", "Pivot right", "Pivot down")]
    assert shown == pytest.approx([25, 1.5, -0.5, 5, 2])
    found["Turn"].value = 10.0
    assert session.editing.step.parts[0] == RigidPart(bone, RigidMotion.turn(10, (5, 2), (1.5, -0.5)), pivot=(5, 2))


def test_a_part_set_over_points_is_proposed_to_the_picture_which_asks() -> None:
    session = Session(Volume(np.zeros(GRID.shape, np.uint8), GRID))
    bone = RigidPart(Polygon([(2, 2), (5, 2), (5, 6), (2, 6)]), RigidMotion.turn(0, (0, 0)), name="shin")
    session.editing.edit_parts([bone])
    session.editing.edit_points(session.editing.points.add((7, 4), (7, 4)))
    editor, refused = Editor(None), []

    def guard(action: Any) -> bool:
        try:
            action()
        except DeformError as error:
            refused.append(str(error))
        return not refused

    sent: list[Any] = []
    editor.send = lambda content, buffers=None: sent.append(content)
    found = {c.widget.description: c.widget for c in PartControls(session, guard, lambda: 0, editor).controls}
    found["Shift right"].value = 3.0
    assert session.editing.step.parts == (bone,)
    assert "the user decides about them" in refused[0]
    assert [(m["type"], m["kind"], m["parts"][0]["motion"]["shift"]) for m in sent] == [
        ("parts", "shift shin", [3.0, 0.0])
    ]
    assert found["Shift right"].value == 0.0


def test_controls_without_a_part_edit_nothing() -> None:
    session = Session(Volume(np.zeros(GRID.shape, np.uint8), GRID))
    panel = PartControls(session, done, lambda: None)
    for control in panel.controls:
        if control.widget.description in ("Turn", "Reach", "Shift x"):
            control.widget.value = control.widget.max
    found = {c.widget.description: c.widget for c in panel.controls}
    found["Part"].value = "moved"
    found["Influence by"].value = "distance"
    assert session.editing.history == {"undo": "", "redo": ""}

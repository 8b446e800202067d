"""The panel of points: what its table gets, what it takes from a page, and what it does to the session."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from widgets.studio.panels.test_steps_history import Guarded

from deformnb.rbf.conditioning import LARGEST_SET
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.inputs.points_table import PointsTable
from deformnb.widgets.studio.panels.points import PointsPanel


class Desk:
    """A panel with its session, an editor, and a page that is played by hand."""

    def __init__(self, in_space: bool = False) -> None:
        self.session = Session(Volume(np.zeros((16, 16, 16), np.uint8), Grid((16, 16, 16))))
        self.guard = Guarded()
        if in_space:
            self.session.add_step(in_space=True)
            self.editor: Any = SpaceEditor(self.session.volume, self.session.points)
        else:
            self.editor = Editor(self.session.picture(), self.session.points)
        self.jobs: list[Any] = []
        worker: Any = SimpleNamespace(latest=lambda name, job: self.jobs.append(job))
        self.panel = PointsPanel(self.session, self.guard, SimpleNamespace(current=self.editor), worker)
        self.table = self.panel.table
        self.sent: list[dict[str, Any]] = []
        self.table.send = lambda content, buffers=None: self.sent.append(content)  # type: ignore[method-assign]
        self.session.observe(self.follow, "deformation")
        self.seq = 0

    def follow(self, _change: Any = None) -> None:
        self.editor.points = self.session.points
        self.panel.refresh()

    def says(self, what: str, ids: Any = (), **more: Any) -> dict[str, Any]:
        """A message of the page; returns the answer."""
        self.seq += 1
        message = {"type": "act", "view": "page", "seq": self.seq, "what": what, "ids": list(ids), "field": "",
                   "axis": 0, "value": None, **more}
        self.table._handle_custom_msg(message, [])
        assert self.sent[-1]["seq"] == self.seq
        return self.sent[-1]

    def cell(self, point: int, field: str, value: Any, axis: int = 0) -> bool:
        return bool(self.says("cell", [point], field=field, axis=axis, value=value)["ok"])

    def rows(self) -> np.ndarray:
        return np.frombuffer(self.table.numbers).reshape(len(self.table.ids), -1)

    def think(self) -> None:
        for job in self.jobs:
            job()
        self.jobs.clear()

    @property
    def points(self) -> ControlPoints:
        return self.session.points


@pytest.fixture
def desk() -> Desk:
    made = Desk()
    made.says("seen", value=True)
    return made


# ---- what the table gets ---------------------------------------------------------------------------------------------


def test_points_go_to_a_table_that_is_seen_and_to_no_other() -> None:
    desk = Desk()
    assert desk.table.ids == []
    desk.says("seen", value=True)
    assert desk.table.ids == [0, 1, 2, 3]
    assert desk.table.names == ["corner"] * 4
    before = desk.table.numbers
    desk.says("seen", value=False)
    desk.session.edit_points(desk.points.move(0, [1.0, 2.0]))
    assert desk.table.numbers == before
    desk.says("seen", value=True)
    assert_array_equal(desk.rows()[0, 2:4], [1.0, 2.0])


def test_a_table_that_two_pages_see_goes_on_when_one_is_closed(desk: Desk) -> None:
    desk.says("seen", view="other", value=True)
    desk.says("seen", view="other", value=False)
    assert desk.table.is_seen
    desk.says("seen", value=False)
    assert not desk.table.is_seen


def test_numbers_are_source_target_weight_radius_and_error(desk: Desk) -> None:
    points = ControlPoints.from_arrays([[1, 2], [3, 4]], [[5, 6], [7, 8]], weight=[1, 2], radius=[np.nan, 9],
                                       active=[True, False], locked=[False, True])
    desk.table.show(points, np.array([0.5, np.nan]), [0])
    assert_array_equal(desk.rows(), [[1, 2, 5, 6, 1, np.nan, 0.5], [3, 4, 7, 8, 2, 9, np.nan]])
    assert list(desk.table.flags) == [1 + 4, 2]


def test_a_refresh_without_other_points_sends_nothing(desk: Desk) -> None:
    desk.think()
    told: list[str] = []
    desk.table.observe(lambda change: told.append(change["name"]))
    for k in range(5):
        desk.session.change(strength=1 + k / 10)
        desk.panel.refresh()
    assert told == []


def test_errors_and_suspects_come_from_the_worker(desk: Desk) -> None:
    place = np.stack(np.meshgrid(np.linspace(1, 14, 5), np.linspace(1, 14, 5)), axis=-1).reshape(-1, 2)
    target = place + np.array([0.2, 0.0])
    target[12] += [0.0, 2.2]
    desk.session.edit_points(ControlPoints.from_arrays(place, target))
    assert np.isnan(desk.rows()[:, -1]).all()
    desk.think()
    errors = desk.rows()[:, -1]
    assert np.isfinite(errors).all()
    assert errors.argmax() == 12
    assert errors[12] > 1.5
    assert list(np.flatnonzero(np.frombuffer(desk.table.flags, np.uint8) & 4)) == [12]


@pytest.mark.nightly
def test_errors_stay_until_the_next_ones_are_there_and_go_with_the_step(desk: Desk) -> None:
    desk.session.edit_points(desk.points.add([8.0, 8.0], [9.0, 8.0]).add([3.0, 3.0]))
    desk.think()
    before = desk.rows()[:, -1]
    desk.session.edit_points(desk.points.move(4, [11.0, 8.0]).add([5.0, 3.0]))
    assert_array_equal(desk.rows()[:, -1], [*before, np.nan])
    desk.think()
    assert np.isfinite(desk.rows()[:, -1]).all()
    assert desk.rows()[4, -1] > before[4] + 1
    desk.session.change(kernel="gaussian")  # the points are the same, the errors are not
    kept = desk.rows()[:, -1]
    desk.think()
    assert (desk.rows()[:, -1] != kept).any()
    desk.session.add_step()
    assert np.isnan(desk.rows()[:, -1]).all()


def test_points_that_cannot_be_judged_are_shown_without_errors(desk: Desk) -> None:
    desk.session.edit_points(desk.points.remove(0, 1, 2, 3))
    desk.think()
    assert desk.table.ids == []


# ---- cells -----------------------------------------------------------------------------------------------------------


def test_each_cell_writes_its_part_of_the_point(desk: Desk) -> None:
    assert desk.cell(2, "name", "  nose ")
    assert desk.cell(2, "target", "9.5", 0)
    assert desk.cell(2, "target", "10,25", 1)  # as half of the world writes it
    assert desk.cell(1, "source", "14", 0)
    assert desk.cell(1, "weight", "2.5")
    assert desk.cell(1, "radius", "30")
    assert desk.cell(3, "active", False)
    assert desk.cell(3, "locked", True)
    points = desk.points
    assert points.names[2] == "nose"
    assert points.target[2].tolist() == [9.5, 10.25]
    assert points.source[1, 0] == 14
    assert (points.weight[1], points.radius[1]) == (2.5, 30)
    assert (bool(points.active[3]), bool(points.locked[3])) == (False, True)
    assert desk.session.history["undo"] == 'lock "corner"'
    assert desk.cell(1, "radius", "")
    assert np.isnan(desk.points.radius[1])
    assert desk.guard.errors == []


@pytest.mark.parametrize(("field", "text", "words"), [
    ("target", "nan", "target a of control point 2 .* must be a number, got 'nan'"), ("target", "", "got 'nothing'"),
    ("source", "inf", "source a of"), ("source", "1e300", "below 1e15"), ("weight", "-1", "weights must be positive"),
    ("weight", "heavy", "the weight of .* must be a number, got 'heavy'"), ("radius", "0", "positive length"),
    ("target", "1,2,3", "must be a number"),
])
def test_what_is_refused_is_said_and_the_old_value_stays(desk: Desk, field: str, text: str, words: str) -> None:
    before = desk.points
    assert not desk.cell(2, field, text)
    assert len(desk.guard.errors) == 1
    import re
    assert re.search(words, desk.guard.errors[0])
    assert desk.points is before


def test_a_locked_point_is_not_moved_and_not_deleted(desk: Desk) -> None:
    desk.session.edit_points(desk.points.move(0, [1.0, 1.0]).edit(0, locked=True))
    before = desk.points
    assert not desk.cell(0, "target", "3")
    assert not desk.cell(0, "source", "3")
    assert not desk.says("reset", [0])["ok"]
    assert not desk.says("remove", [0])["ok"]
    assert not desk.says("paste", value="id,source_a,source_b\n0,5,5\n")["ok"]
    assert all("locked" in error for error in desk.guard.errors)
    assert desk.points is before
    assert desk.cell(0, "name", "held")
    assert desk.says("remove", [0, 1])["ok"]  # what is free goes
    assert desk.points.ids == (0, 2, 3)


def test_a_point_that_is_gone_is_said(desk: Desk) -> None:
    assert not desk.cell(17, "name", "nobody")
    assert desk.guard.errors == ["there is no control point 17 any more."]
    assert desk.says("remove", [17])["ok"]  # nothing is left to do


# ---- commands --------------------------------------------------------------------------------------------------------


def test_commands_act_on_all_that_is_chosen(desk: Desk) -> None:
    desk.session.edit_points(desk.points.move(1, [9.0, 1.0]).move(2, [9.0, 9.0]))
    desk.says("reset", [1, 3])
    assert_array_equal(desk.points.displacement.any(axis=1), [False, False, True, False])
    desk.says("lock", [1, 2])
    assert desk.points.locked.tolist() == [False, True, True, False]
    desk.says("lock", [0, 1])
    assert desk.points.locked.tolist() == [True, True, True, False]
    desk.says("lock", [0, 1])
    assert desk.points.locked.tolist() == [False, False, True, False]
    desk.says("switch", [0, 3])
    assert desk.points.active.tolist() == [False, True, True, False]
    desk.says("switch", [0, 1])
    assert desk.points.active.tolist() == [False, False, True, False]
    desk.says("remove", [0, 1])
    assert desk.points.ids == (2, 3)
    assert desk.says("undo")["text"] == "Undone: remove 2 points"
    assert desk.says("redo")["text"] == "Done again: remove 2 points"
    assert desk.says("redo")["text"] == ""


def test_a_point_that_is_added_takes_hold_of_what_is_seen_there(desk: Desk) -> None:
    desk.session.edit_points(desk.points.add([8.0, 8.0], [10.0, 8.0]))
    fit = desk.editor.fit()
    answer = desk.says("add", value="9, 7.5")
    assert answer == {**answer, "ok": True, "text": "Point 5 added."}
    assert_array_equal(desk.points.target[-1], [9.0, 7.5])
    assert_allclose(desk.points.displacement[-1], fit.displacement([9.0, 7.5]), atol=1e-12)
    assert desk.editor.selected == [5]
    assert not desk.says("add", value="9")["ok"]
    assert not desk.says("add", value="9, nan")["ok"]
    assert desk.guard.errors == ["a new point needs 2 numbers, a, b; got 1.",
                                 "b of the new point must be a number, got 'nan'."]


def test_rows_are_pasted(desk: Desk) -> None:
    answer = desk.says("paste", value="id,name,source_a,source_b,target_a,target_b\n0,,,,1,1\n,fin,5,6,7,8\n")
    assert answer["text"] == "1 points added, 1 changed."
    assert desk.points.target[0].tolist() == [1, 1]
    assert desk.points.names[-1] == "fin"
    desk.session.undo()
    assert len(desk.points) == 4
    assert not desk.says("paste", value="nonsense")["ok"]


def test_the_selection_goes_both_ways(desk: Desk) -> None:
    desk.editor.selected = [2]
    assert desk.table.selected == [2]
    desk.table.set_state({"selected": [1, 3]})
    assert desk.editor.selected == [1, 3]


def test_a_point_is_looked_at_on_a_picture(desk: Desk) -> None:
    sent: list[Any] = []
    desk.editor.send = lambda content, buffers=None: sent.append(content)
    assert desk.says("look", [2])["ok"]
    assert sent == [{"type": "look", "id": 2}]
    assert desk.editor.selected == [2]


def test_a_point_in_space_is_written_and_looked_at() -> None:
    desk = Desk(in_space=True)
    try:
        desk.says("seen", value=True)
        assert desk.table.dim == 3
        assert desk.cell(5, "target", "4.5", 2)
        assert desk.points.target[5, 2] == 4.5
        assert_array_equal(desk.rows()[5, 3:6], desk.points.target[5])
        assert desk.says("add", value="3 4 5")["ok"]
        desk.says("look", [5])
        assert list(desk.editor.cursor) == desk.points.target[5].tolist()
        assert not desk.says("cell", [0], field="target", axis=3, value="1")["ok"]
    finally:
        desk.editor.close()


# ---- what a page may say ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wrong", [
    {"what": "explode"}, {"what": None}, {"ids": "0"}, {"ids": [True]}, {"ids": [-1]}, {"ids": [0.5]}, {"ids": [0, 1]},
    {"ids": [0] * (LARGEST_SET + 1)}, {"field": "ids"}, {"field": "__class__"}, {"field": ["name"]}, {"axis": 3},
    {"axis": -1}, {"axis": True}, {"axis": "0"}, {"value": 5}, {"value": None}, {"value": "x" * 70_000},
    {"field": "active", "value": "true"}, {"field": "locked", "value": 1}, {"what": "remove", "field": "name"},
    {"what": "seen", "value": 1}, {"what": "paste", "field": "", "value": b"1"},
])
def test_what_is_wrong_is_dropped_and_answered(desk: Desk, wrong: dict[str, Any], caplog: Any) -> None:
    before = desk.points
    message = {"what": "cell", "ids": [0], "field": "name", "axis": 0, "value": "x", **wrong}
    assert not desk.says(**message)["ok"]
    assert desk.points is before
    assert "dropped" in caplog.text


@pytest.mark.parametrize("wrong", [{"type": "do"}, {"view": 5}, {"view": "x" * 50}, {"seq": "1"}, {"seq": None}])
def test_what_cannot_be_answered_is_dropped(desk: Desk, wrong: dict[str, Any], caplog: Any) -> None:
    count = len(desk.sent)
    message = {"type": "act", "view": "page", "seq": 9, "what": "undo", "ids": [], "value": None, **wrong}
    desk.table._handle_custom_msg(message, [])
    desk.table._handle_custom_msg("nonsense", [])
    assert len(desk.sent) == count
    assert "dropped" in caplog.text


@pytest.mark.parametrize("state", [{"ids": [5]}, {"selected": [1.5]}, {"selected": "x"}, {"selected": [-1]}, []])
def test_a_page_owns_its_selection_and_nothing_else(state: Any) -> None:
    table = PointsTable()
    table.set_state(state)
    assert (table.ids, table.selected) == ([], [])


def test_a_failing_callback_ends_nothing(desk: Desk, caplog: Any) -> None:
    desk.table.on_act(lambda act: 1 / 0)  # type: ignore[arg-type, return-value]
    assert not desk.says("undo")["ok"]
    assert "ZeroDivisionError" in caplog.text

"""The panel of points: the data of its table, messages of a front end, and their effect on the session."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from front_end import deliver
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


class Bench:
    """A panel with its session, an editor, and a simulated front end."""

    def __init__(self, in_space: bool = False) -> None:
        self.session = Session(Volume(np.zeros((16, 16, 16), np.uint8), Grid((16, 16, 16))))
        self.guard = Guarded()
        if in_space:
            self.session.steps.add(in_space=True)
            self.editor: Any = SpaceEditor(self.session.volume, self.session.editing.points)
        else:
            self.editor = Editor(self.session.pictures.picture(), self.session.editing.points)
        self.jobs: list[Any] = []
        worker: Any = SimpleNamespace(latest=lambda name, job: self.jobs.append(job))
        self.panel = PointsPanel(self.session, self.guard, SimpleNamespace(current=self.editor), worker)
        self.table = self.panel.table
        self.sent: list[dict[str, Any]] = []
        self.table.send = lambda content, buffers=None: self.sent.append(content)  # type: ignore[method-assign]
        self.session.editing.observe(self.follow, "deformation")
        self.seq = 0

    def follow(self, _change: Any = None) -> None:
        self.editor.points = self.session.editing.points
        self.panel.refresh()

    def says(self, what: str, ids: Any = (), **more: Any) -> dict[str, Any]:
        """A message of the page; returns the answer."""
        self.seq += 1
        message = {
            "type": "act",
            "view": "page",
            "seq": self.seq,
            "what": what,
            "ids": list(ids),
            "field": "",
            "axis": 0,
            "value": None,
            **more,
        }
        deliver(self.table, message)
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
        return self.session.editing.points


@pytest.fixture
def bench() -> Bench:
    made = Bench()
    made.says("seen", value=True)
    return made


# ---- what the table gets ---------------------------------------------------------------------------------------------


def test_points_go_to_a_table_that_is_seen_and_to_no_other() -> None:
    bench = Bench()
    assert bench.table.ids == []
    bench.says("seen", value=True)
    assert bench.table.ids == [0, 1, 2, 3]
    assert bench.table.names == ["corner"] * 4
    before = bench.table.numbers
    bench.says("seen", value=False)
    bench.session.editing.edit_points(bench.points.move(0, [1.0, 2.0]))
    assert bench.table.numbers == before
    bench.says("seen", value=True)
    assert_array_equal(bench.rows()[0, 2:4], [1.0, 2.0])


def test_a_table_that_two_pages_see_goes_on_when_one_is_closed(bench: Bench) -> None:
    bench.says("seen", view="other", value=True)
    bench.says("seen", view="other", value=False)
    assert bench.table.is_visible
    bench.says("seen", value=False)
    assert not bench.table.is_visible


def test_numbers_are_source_target_weight_radius_and_error(bench: Bench) -> None:
    points = ControlPoints.from_arrays(
        [[1, 2], [3, 4]],
        [[5, 6], [7, 8]],
        weight=[1, 2],
        radius=[np.nan, 9],
        active=[True, False],
        locked=[False, True],
    )
    bench.table.show(points, np.array([0.5, np.nan]), [0])
    assert_array_equal(bench.rows(), [[1, 2, 5, 6, 1, np.nan, 0.5], [3, 4, 7, 8, 2, 9, np.nan]])
    assert list(bench.table.flags) == [1 + 4, 2]


def test_a_refresh_without_other_points_sends_nothing(bench: Bench) -> None:
    bench.think()
    told: list[str] = []
    bench.table.observe(lambda change: told.append(change["name"]))
    for k in range(5):
        bench.session.editing.change(strength=1 + k / 10)
        bench.panel.refresh()
    assert told == []


def test_errors_and_suspects_come_from_the_worker(bench: Bench) -> None:
    place = np.stack(np.meshgrid(np.linspace(1, 14, 5), np.linspace(1, 14, 5)), axis=-1).reshape(-1, 2)
    target = place + np.array([0.2, 0.0])
    target[12] += [0.0, 2.2]
    bench.session.editing.edit_points(ControlPoints.from_arrays(place, target))
    assert np.isnan(bench.rows()[:, -1]).all()
    bench.think()
    errors = bench.rows()[:, -1]
    assert np.isfinite(errors).all()
    assert errors.argmax() == 12
    assert errors[12] > 1.5
    assert list(np.flatnonzero(np.frombuffer(bench.table.flags, np.uint8) & 4)) == [12]


@pytest.mark.nightly
def test_errors_stay_until_the_next_ones_are_there_and_go_with_the_step(bench: Bench) -> None:
    bench.session.editing.edit_points(bench.points.add([8.0, 8.0], [9.0, 8.0]).add([3.0, 3.0]))
    bench.think()
    before = bench.rows()[:, -1]
    bench.session.editing.edit_points(bench.points.move(4, [11.0, 8.0]).add([5.0, 3.0]))
    assert_array_equal(bench.rows()[:, -1], [*before, np.nan])
    bench.think()
    assert np.isfinite(bench.rows()[:, -1]).all()
    assert bench.rows()[4, -1] > before[4] + 1
    bench.session.editing.change(kernel="gaussian")  # the points are the same, the errors are not
    kept = bench.rows()[:, -1]
    bench.think()
    assert (bench.rows()[:, -1] != kept).any()
    bench.session.steps.add()
    assert np.isnan(bench.rows()[:, -1]).all()


def test_points_that_cannot_be_judged_are_shown_without_errors(bench: Bench) -> None:
    bench.session.editing.edit_points(bench.points.remove(0, 1, 2, 3))
    bench.think()
    assert bench.table.ids == []


# ---- cells -----------------------------------------------------------------------------------------------------------


def test_each_cell_writes_its_part_of_the_point(bench: Bench) -> None:
    assert bench.cell(2, "name", "  nose ")
    assert bench.cell(2, "target", "9.5", 0)
    assert bench.cell(2, "target", "10,25", 1)  # as half of the world writes it
    assert bench.cell(1, "source", "14", 0)
    assert bench.cell(1, "weight", "2.5")
    assert bench.cell(1, "radius", "30")
    assert bench.cell(3, "active", False)
    assert bench.cell(3, "locked", True)
    points = bench.points
    assert points.names[2] == "nose"
    assert points.target[2].tolist() == [9.5, 10.25]
    assert points.source[1, 0] == 14
    assert (points.weight[1], points.radius[1]) == (2.5, 30)
    assert (bool(points.active[3]), bool(points.locked[3])) == (False, True)
    assert bench.session.editing.history["undo"] == 'lock "corner"'
    assert bench.cell(1, "radius", "")
    assert np.isnan(bench.points.radius[1])
    assert bench.guard.errors == []


@pytest.mark.parametrize(
    ("field", "text", "words"),
    [
        ("target", "nan", "target a of point 3 .* must be a number, got 'nan'"),
        ("target", "", "got 'nothing'"),
        ("source", "inf", "source a of"),
        ("source", "1e300", "below 1e15"),
        ("weight", "-1", "weights must be positive"),
        ("weight", "heavy", "the weight of .* must be a number, got 'heavy'"),
        ("radius", "0", "positive length"),
        ("target", "1,2,3", "must be a number"),
    ],
)
def test_what_is_refused_is_said_and_the_old_value_stays(bench: Bench, field: str, text: str, words: str) -> None:
    before = bench.points
    assert not bench.cell(2, field, text)
    assert len(bench.guard.errors) == 1
    import re

    assert re.search(words, bench.guard.errors[0])
    assert bench.points is before


def test_a_locked_point_is_not_moved_and_not_deleted(bench: Bench) -> None:
    bench.session.editing.edit_points(bench.points.move(0, [1.0, 1.0]).edit(0, locked=True))
    before = bench.points
    assert not bench.cell(0, "target", "3")
    assert not bench.cell(0, "source", "3")
    assert not bench.says("reset", [0])["ok"]
    assert not bench.says("remove", [0])["ok"]
    assert not bench.says("paste", value="id,source_a,source_b\n0,5,5\n")["ok"]
    assert all("locked" in error for error in bench.guard.errors)
    assert bench.points is before
    assert bench.cell(0, "name", "held")
    assert bench.says("remove", [0, 1])["ok"]  # free points go
    assert bench.points.ids == (0, 2, 3)


def test_a_point_that_is_gone_is_said(bench: Bench) -> None:
    assert not bench.cell(17, "name", "nobody")
    assert bench.guard.errors == ["there is no control point 17 any more."]
    assert bench.says("remove", [17])["ok"]  # nothing is left to do


# ---- commands --------------------------------------------------------------------------------------------------------


def test_commands_act_on_all_that_is_chosen(bench: Bench) -> None:
    bench.session.editing.edit_points(bench.points.move(1, [9.0, 1.0]).move(2, [9.0, 9.0]))
    bench.says("reset", [1, 3])
    assert_array_equal(bench.points.displacement.any(axis=1), [False, False, True, False])
    bench.says("lock", [1, 2])
    assert bench.points.locked.tolist() == [False, True, True, False]
    bench.says("lock", [0, 1])
    assert bench.points.locked.tolist() == [True, True, True, False]
    bench.says("lock", [0, 1])
    assert bench.points.locked.tolist() == [False, False, True, False]
    bench.says("switch", [0, 3])
    assert bench.points.active.tolist() == [False, True, True, False]
    bench.says("switch", [0, 1])
    assert bench.points.active.tolist() == [False, False, True, False]
    bench.says("remove", [0, 1])
    assert bench.points.ids == (2, 3)
    assert bench.says("undo")["text"] == "Undone: remove 2 points"
    assert bench.says("redo")["text"] == "Done again: remove 2 points"
    assert bench.says("redo")["text"] == ""


def test_a_point_that_is_added_takes_hold_of_what_is_seen_there(bench: Bench) -> None:
    bench.session.editing.edit_points(bench.points.add([8.0, 8.0], [10.0, 8.0]))
    fit = bench.editor.fit()
    answer = bench.says("add", value="9, 7.5")
    assert answer == {**answer, "ok": True, "text": "Point 6 added."}
    assert_array_equal(bench.points.target[-1], [9.0, 7.5])
    assert_allclose(bench.points.displacement[-1], fit.displacement([9.0, 7.5]), atol=1e-12)
    assert bench.editor.selected == [5]
    assert not bench.says("add", value="9")["ok"]
    assert not bench.says("add", value="9, nan")["ok"]
    assert bench.guard.errors == [
        "a new point needs 2 numbers, a, b; got 1.",
        "b of the new point must be a number, got 'nan'.",
    ]


def test_rows_are_pasted(bench: Bench) -> None:
    answer = bench.says("paste", value="id,name,source_a,source_b,target_a,target_b\n0,,,,1,1\n,fin,5,6,7,8\n")
    assert answer["text"] == "1 points added, 1 changed."
    assert bench.points.target[0].tolist() == [1, 1]
    assert bench.points.names[-1] == "fin"
    bench.session.editing.undo()
    assert len(bench.points) == 4
    assert not bench.says("paste", value="nonsense")["ok"]


def test_the_selection_goes_both_ways(bench: Bench) -> None:
    bench.editor.selected = [2]
    assert bench.table.selected == [2]
    bench.table.set_state({"selected": [1, 3]})
    assert bench.editor.selected == [1, 3]


def test_a_point_is_looked_at_on_a_picture(bench: Bench) -> None:
    sent: list[Any] = []
    bench.editor.send = lambda content, buffers=None: sent.append(content)
    assert bench.says("look", [2])["ok"]
    assert sent == [{"type": "look", "id": 2}]
    assert bench.editor.selected == [2]


def test_a_point_in_space_is_written_and_looked_at() -> None:
    bench = Bench(in_space=True)
    try:
        bench.says("seen", value=True)
        assert bench.table.dim == 3
        assert bench.cell(5, "target", "4.5", 2)
        assert bench.points.target[5, 2] == 4.5
        assert_array_equal(bench.rows()[5, 3:6], bench.points.target[5])
        assert bench.says("add", value="3 4 5")["ok"]
        bench.says("look", [5])
        assert list(bench.editor.cursor) == bench.points.target[5].tolist()
        assert not bench.says("cell", [0], field="target", axis=3, value="1")["ok"]
    finally:
        bench.editor.close()


# ---- what a page may say ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "wrong",
    [
        {"what": "explode"},
        {"what": None},
        {"ids": "0"},
        {"ids": [True]},
        {"ids": [-1]},
        {"ids": [0.5]},
        {"ids": [0, 1]},
        {"ids": [0] * (LARGEST_SET + 1)},
        {"field": "ids"},
        {"field": "__class__"},
        {"field": ["name"]},
        {"axis": 3},
        {"axis": -1},
        {"axis": True},
        {"axis": "0"},
        {"value": 5},
        {"value": None},
        {"value": "x" * 70_000},
        {"field": "active", "value": "true"},
        {"field": "locked", "value": 1},
        {"what": "remove", "field": "name"},
        {"what": "seen", "value": 1},
        {"what": "paste", "field": "", "value": b"1"},
    ],
)
def test_what_is_wrong_is_dropped_and_answered(bench: Bench, wrong: dict[str, Any], caplog: Any) -> None:
    before = bench.points
    message = {"what": "cell", "ids": [0], "field": "name", "axis": 0, "value": "x", **wrong}
    assert not bench.says(**message)["ok"]
    assert bench.points is before
    assert "dropped" in caplog.text


@pytest.mark.parametrize("wrong", [{"type": "do"}, {"view": 5}, {"view": "x" * 50}, {"seq": "1"}, {"seq": None}])
def test_what_cannot_be_answered_is_dropped(bench: Bench, wrong: dict[str, Any], caplog: Any) -> None:
    count = len(bench.sent)
    message = {"type": "act", "view": "page", "seq": 9, "what": "undo", "ids": [], "value": None, **wrong}
    deliver(bench.table, message)
    deliver(bench.table, "nonsense")
    assert len(bench.sent) == count
    assert "dropped" in caplog.text


@pytest.mark.parametrize("state", [{"ids": [5]}, {"selected": [1.5]}, {"selected": "x"}, {"selected": [-1]}, []])
def test_a_page_owns_its_selection_and_nothing_else(state: Any) -> None:
    table = PointsTable()
    table.set_state(state)
    assert (table.ids, table.selected) == ([], [])


def test_a_failing_callback_ends_nothing(bench: Bench, caplog: Any) -> None:
    bench.table.on_act(lambda act: 1 / 0)  # type: ignore[arg-type, return-value]
    assert not bench.says("undo")["ok"]
    assert "ZeroDivisionError" in caplog.text

"""The tree of old states: held against a literal model, by drawn sequences of edits, undo, redo and jumps."""

from __future__ import annotations

import gc
import time
import tracemalloc
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from deformnb import Cut, Mask, Raster, Session
from deformnb.document.deformation import Deformation, Step
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.session.history import History, weigh_part
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume


def flat(history: History) -> list[tuple[int, int | None, str]]:
    return [(node.id, node.parent, node.label) for node in history.nodes()]


def a_session(**traits: Any) -> Session:
    return Session(Volume(np.zeros((8, 8, 8), np.uint8), Grid((8, 8, 8))), **traits)


PLANE = Plane.from_view(Grid((8, 8, 8)), "+y")


# ---- the tree, literally ---------------------------------------------------------------------------------------------


def test_an_edit_after_undo_makes_a_branch_and_the_old_one_stays() -> None:
    history = History()
    history.record("A", "to B")
    history.record("B", "to C")
    assert history.step("undo", "C") == ("B", "to C")
    assert history.step("undo", "B") == ("A", "to B")
    assert history.step("undo", "A") is None
    history.record("A", "to D")
    assert history.labels() == {"undo": "to D", "redo": ""}
    assert flat(history) == [(0, None, ""), (1, 0, "to B"), (2, 1, "to C"), (3, 0, "to D")]
    assert [node.is_on_way for node in history.nodes()] == [True, False, False, True]
    assert [node.is_current for node in history.nodes()] == [False, False, False, True]
    assert history.go(2, "D") == ("C", "to C")
    assert history.step("undo", "C") == ("B", "to C")
    assert history.step("undo", "B") == ("A", "to B")
    assert history.labels() == {"undo": "", "redo": "to B"}  # the branch that was seen last, not the newest
    assert history.go(3, "A") == ("D", "to D")
    assert history.go(3, "D") == ("D", "to D")
    assert history.step("undo", "D") == ("A", "to D")
    assert history.step("redo", "A") == ("D", "to D")


def test_a_state_that_is_not_there_is_refused_in_words() -> None:
    history = History()
    history.record("A", "to B")
    for wrong in (7, -1, None, "1"):
        with pytest.raises(DeformError, match="no state"):
            history.go(wrong, "B")  # type: ignore[arg-type]
    assert history.step("undo", "B") == ("A", "to B")


def test_edits_of_one_kind_in_quick_succession_are_one_state() -> None:
    history = History()
    for k, now in enumerate((0.0, 0.5, 1.0, 3.0)):
        history.record(k, f"nudge {k}", "nudge", now=now)
    assert flat(history) == [(0, None, ""), (1, 0, "nudge 0"), (2, 1, "nudge 3")]
    history.record(4, "drag", now=3.1)
    history.record(5, "drag", now=3.2)  # kind None never joins
    assert [history.step("undo", None)[0] for _ in range(4)] == [5, 4, 3, 0]  # type: ignore[index]


def test_a_slider_takes_its_time_and_each_hold_of_it_is_one_state() -> None:
    history = History()
    for k, now in enumerate((0.0, 2.0, 31.0, 62.0)):
        history.record(k, f"slide {k}", "strength", now=now, slides=True)
    assert flat(history) == [(0, None, ""), (1, 0, "slide 0"), (2, 1, "slide 3")]
    history.start_drag()
    history.record(4, "again", "strength", now=62.1, slides=True)
    history.record(5, "again", "strength", now=70.0, slides=True)
    history.record(6, "menu", "kernel", now=71.0)
    history.record(7, "menu", "kernel", now=73.0)
    assert [history.step("undo", None)[0] for _ in range(5)] == [7, 6, 4, 3, 0]  # type: ignore[index]


def test_an_edit_after_a_step_never_joins_what_was_before_it() -> None:
    history = History()
    history.record("A", "nudge", "nudge", now=0.0)
    history.step("undo", "B")
    history.step("redo", "A")
    history.record("B", "nudge", "nudge", now=0.1)
    assert history.step("undo", "C") == ("B", "nudge")


def test_the_time_of_a_state_is_that_of_its_last_edit() -> None:
    before, history = time.time(), History()
    history.record("A", "nudge", "nudge", now=0.0)
    made = history.nodes()[1].time
    time.sleep(0.002)
    history.record("B", "nudge", "nudge", now=0.1)
    assert before <= made < history.nodes()[1].time <= time.time()


# ---- bounds ----------------------------------------------------------------------------------------------------------


def test_the_oldest_states_go_where_there_is_one_way_only() -> None:
    history = History(most=10)
    for k in range(1000):
        history.record(k, f"edit {k}")
    found = [history.step("undo", None)[0] for _ in range(10)]  # type: ignore[index]
    assert found == list(range(999, 989, -1))
    assert history.step("undo", None) is None
    assert history.labels()["undo"] == ""


def test_old_branches_go_before_the_way_back() -> None:
    history = History(most=4)
    history.record("A", "to B")  # 1
    history.step("undo", "B")
    history.record("A", "to C")  # 2
    history.step("undo", "C")
    history.record("A", "to D")  # 3
    history.record("D", "to E")  # 4: A, B, C, D beside it
    assert [node.id for node in history.nodes()] == [0, 1, 2, 3, 4]
    history.record("E", "to F")
    assert [node.id for node in history.nodes()] == [0, 2, 3, 4, 5]
    history.record("F", "to G")
    assert [node.id for node in history.nodes()] == [0, 3, 4, 5, 6]
    history.record("G", "to H")  # no branch is left: the oldest of all
    assert flat(history)[0] == (3, None, "to D")
    assert history.labels()["undo"] == "to H"


def test_what_redo_leads_to_stays_longer_than_what_it_does_not() -> None:
    history = History(most=3)
    for k in range(3):
        history.record(k, f"edit {k}")
    for k in (3, 2, 1):
        history.step("undo", k)
    assert [node.id for node in history.nodes()] == [0, 1, 2, 3]
    history.go(1, 0)
    history.record(1, "else")  # 2 and 3 are a branch now, and 2 is no end of it
    assert [node.id for node in history.nodes()] == [0, 1, 2, 4]


def test_states_weigh_what_they_do_not_share() -> None:
    one, two = np.zeros(1000), np.ones(1000)
    history = History()
    history.record((one, two), "edit")
    alone = history.bytes
    assert 16_000 <= alone < 17_000
    history.record((one, two), "edit")  # both arrays are there already
    assert history.bytes - alone < 1000
    history.step("undo", (one, two))
    history.step("undo", (one, two))
    assert 16_000 <= history.bytes < 17_500
    history.go(1, (one, two, np.ones(500)))
    assert 20_000 <= history.bytes < 21_500


def test_large_states_push_old_ones_out_and_one_always_stays() -> None:
    history = History(most_bytes=100_000)
    for k in range(50):
        history.record(np.full(4_000, float(k)), "edit")  # 32 kB each
        assert history.bytes <= 100_000
    assert len(history) == 4
    history.record(np.zeros(10**6), "huge")
    assert len(history) == 2
    assert history.step("undo", np.zeros(3))[0].size == 10**6  # type: ignore[index]
    history.step("redo", np.zeros(3))
    history.record(np.zeros(3), "small again")
    assert len(history) == 3
    assert history.bytes < 1000


def test_a_document_weighs_its_points_and_masks() -> None:
    points = ControlPoints.from_arrays(np.random.default_rng(0).random((500, 2)))
    own, inner = weigh_part(points)
    assert not inner
    assert own >= 500 * (4 * 8 + 1 + 8)
    raster = Raster((100, 100), (1.0, 1.0), (0.0, 0.0))
    mask = Mask(np.eye(100, dtype=bool), raster)
    assert 10_000 <= weigh_part(mask)[0] <= 60_000
    history, step = History(), Step((points,), PLANE, cuts=(Cut(mask),))
    history.record(Deformation((step,)), "edit")
    assert own + 10_000 <= history.bytes <= own + 100_000
    first = history.bytes
    for k in range(10):  # points change, the mask does not
        history.record(Deformation((step.with_points(points.move(0, [float(k), 0.0]), 0),)), "edit")
    assert 10 * own <= history.bytes - first <= 10 * (own + 10_000)


@pytest.mark.nightly
def test_thousands_of_edits_take_the_memory_of_two_hundred() -> None:
    history = History()
    points = ControlPoints.from_arrays(np.random.default_rng(1).random((50, 2)))
    held, rng = [], np.random.default_rng(2)
    tracemalloc.start()
    try:
        for k in range(2_500):
            history.record(Deformation((Step((points.move(k % 50, rng.random(2)),), PLANE),)), f"edit {k}")
            if k % 7 == 0:
                history.step("undo", Deformation())
            if k in (499, 2_499):
                gc.collect()
                held.append((tracemalloc.get_traced_memory()[0], history.bytes, len(history)))
    finally:
        tracemalloc.stop()
    (early, early_bytes, early_count), (late, late_bytes, late_count) = held
    assert (early_count, late_count) == (201, 201)
    assert late < 1.2 * early
    assert abs(late_bytes - early_bytes) < 0.1 * early_bytes
    assert 0.3 < late_bytes / late < 3  # the estimate is one


# ---- against a model -------------------------------------------------------------------------------------------------


class Tree(RuleBasedStateMachine):
    """A history of at most eight states compared with a dictionary that never forgets."""

    MOST = 8

    def __init__(self) -> None:
        super().__init__()
        self.history = History(most=self.MOST, most_bytes=6_000)
        self.states: dict[int, np.ndarray] = {0: np.zeros(1)}
        self.parents: dict[int, int] = {}
        self.labels = {0: ""}
        self.visits = {0: 0}  # when each was shown last, or led to the one shown
        self.at = self.count = 0

    @property
    def here(self) -> np.ndarray:
        return self.states[self.at]

    def visit(self, node: int) -> None:
        self.at, self.count = node, self.count + 1
        while True:
            self.visits[node] = self.count
            if node not in self.parents:
                return
            node = self.parents[node]

    def known(self) -> dict[int, int | None]:
        return {node.id: node.parent for node in self.history.nodes()}

    def children(self, node: int) -> list[int]:
        return [child for child, parent in self.known().items() if parent == node]

    @rule(size=st.integers(1, 300))
    def edit(self, size: int) -> None:
        made, value = len(self.states), float(len(self.states))
        self.history.record(self.here, f"edit {made}")
        self.states[made], self.parents[made] = np.full(size, value), self.at
        self.labels[made] = f"edit {made}"
        self.visit(made)
        assert self.history.current == made

    @rule()
    def undo(self) -> None:
        expected = self.known()[self.at]
        found = self.history.step("undo", self.here)
        if expected is None:
            assert found is None
            return
        assert found[0] is self.states[expected]
        assert found[1] == self.labels[self.at]
        self.visit(expected)

    @rule()
    def redo(self) -> None:
        children = self.children(self.at)
        found = self.history.step("redo", self.here)
        if not children:
            assert found is None
            return
        expected = max(children, key=lambda child: self.visits[child])
        assert found[0] is self.states[expected]
        assert found[1] == self.labels[expected]
        self.visit(expected)

    @rule(choice=st.integers(0, 10**6))
    def jump(self, choice: int) -> None:
        known = sorted(self.known())
        node = known[choice % len(known)]
        state, label = self.history.go(node, self.here)
        assert state is self.states[node]
        assert label == self.labels[node]
        self.visit(node)

    @rule()
    def there_and_back(self) -> None:
        before, parent = self.at, self.known()[self.at]
        if parent is None:
            return
        self.undo()
        self.redo()
        assert self.at == before

    @invariant()
    def holds(self) -> None:
        known = self.known()
        assert self.history.current == self.at
        assert self.at in known
        assert 1 <= len(known) <= self.MOST + 1
        assert self.history.bytes <= 6_000 or len(known) == 2
        roots = [node for node, parent in known.items() if parent is None]
        assert len(roots) == 1
        for node, parent in known.items():
            assert parent is None or (parent == self.parents[node] and parent in known)
        undo = self.labels[self.at] if known[self.at] is not None else ""
        children = self.children(self.at)
        redo = self.labels[max(children, key=lambda child: self.visits[child])] if children else ""
        assert self.history.labels() == {"undo": undo, "redo": redo}


TestTree = Tree.TestCase
TestTree.settings = settings(max_examples=60, stateful_step_count=40, deadline=None)


# ---- the session -----------------------------------------------------------------------------------------------------


def test_a_session_goes_to_any_state_and_observers_see_one_change() -> None:
    session = a_session()
    first = session.editing.deformation
    session.editing.change(trend="none")
    session.steps.add()
    second, index = session.editing.deformation, session.editing.index
    session.editing.undo()
    session.editing.undo()
    session.editing.change(kernel="gaussian")
    tree = session.editing.history_tree()
    assert [(n.id, n.parent, n.label, n.is_current) for n in tree] == [
        (0, None, "", False),
        (1, 0, "change trend", False),
        (2, 1, "add a step", False),
        (3, 0, "change kernel", True),
    ]
    seen: list[Any] = []
    session.editing.observe(
        lambda change: seen.append(
            (len(session.editing.deformation.steps), session.editing.index, session.editing.history["undo"])
        ),
        ["deformation", "index", "history"],
    )
    assert session.editing.go_to(2) == "add a step"
    assert (session.editing.deformation, session.editing.index) == (second, index)
    assert set(seen) == {(2, 1, "add a step")}
    assert session.editing.go_to(0) == ""
    assert session.editing.deformation == first
    assert session.editing.history == {"undo": "", "redo": "change trend"}
    with pytest.raises(DeformError, match="no state 9"):
        session.editing.go_to(9)
    assert session.editing.deformation == first


def test_going_between_equal_documents_goes_all_the_same() -> None:
    session = a_session()
    session.editing.change(trend="none")
    session.editing.change(trend="affine")
    session.editing.go_to(0)
    assert session.editing.history == {"undo": "", "redo": "change trend"}
    assert next(n for n in session.editing.history_tree() if n.is_current).id == 0


def test_the_documents_of_a_session_weigh_only_what_changed() -> None:
    session = a_session()
    points = session.editing.points
    for place in np.random.default_rng(0).random((300, 2)) * 7:
        points = points.add(place)
    session.editing.edit_points(points)
    for k in range(20):
        session.editing.change(strength=1 + k / 100)  # the points are shared
    assert session.editing.past.bytes < 2 * weigh_part(points)[0]

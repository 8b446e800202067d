"""Control points: stable ids, nothing shared or half changed, and complaints that name the point."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints

THREE = ControlPoints.from_arrays([[0, 0], [10, 0], [0, 10]], [[1, 1], [12, 1], [0, 10]], names=["a", "", "c"])
NUMBERS = st.floats(-1e15, 1e15)


def test_displacement_is_backward() -> None:
    assert THREE.displacement.tolist() == [[-1, -1], [-2, -1], [0, 0]]


def test_targets_are_the_sources_where_not_given_and_nothing_is_shared() -> None:
    source = np.arange(6.0).reshape(3, 2)
    points = ControlPoints.from_arrays(source)
    source[0] = 99
    assert points.source[0].tolist() == points.target[0].tolist() == [0, 1]
    assert source.flags.writeable  # the caller's own array stays as it was
    for array in (points.source, points.target, points.active, points.weight):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_every_change_leaves_the_old_set_alone() -> None:
    before = [np.array(a) for a in (THREE.source, THREE.target, THREE.active, THREE.weight)]
    THREE.add([5, 5])
    THREE.move(1, [3, 3])
    THREE.edit(1, source=[8, 8], name="b", active=False, weight=4.0)
    THREE.remove(0, 2)
    THREE.scaled(2.0)
    THREE.reset()
    for old, now in zip(before, (THREE.source, THREE.target, THREE.active, THREE.weight), strict=True):
        assert (old == now).all()
    assert (THREE.ids, THREE.names, THREE.next_id) == ((0, 1, 2), ("a", "", "c"), 3)


def test_edit_changes_what_is_given_and_nothing_else() -> None:
    points = THREE.edit(1, source=[8, 9], name="b", active=False, weight=4.0)
    assert points.source.tolist() == [[0, 0], [8, 9], [0, 10]]
    assert points.target.tolist() == THREE.target.tolist()
    assert points.names == ("a", "b", "c")
    assert points.active.tolist() == [True, False, True]
    assert points.weight.tolist() == [1, 4, 1]
    assert THREE.edit(1, name="").names[1] == ""
    assert THREE.edit(1) == THREE


def test_a_removed_id_never_comes_back() -> None:
    points = THREE.remove(2).add([1, 2])
    assert points.ids == (0, 1, 3)
    assert points.remove(0, 1, 3).add([0, 0]).ids == (4,)
    assert ControlPoints.from_arrays([[0, 0]], ids=[41]).add([1, 1]).ids == (41, 42)
    assert THREE.take([2, 0]).ids == (2, 0)
    assert THREE.take([2, 0]).next_id == 3
    with pytest.raises(DeformError, match=r"there is no control point 2; there are \[0, 1\]"):
        THREE.remove(2).move(2, [0, 0])


def test_blending_goes_from_the_sources_through_the_targets() -> None:
    assert THREE.scaled(1.0) == THREE
    assert THREE.scaled(0.0) == THREE.reset()
    assert THREE.scaled(2.0).target.tolist() == [[2, 2], [14, 2], [0, 10]]
    assert THREE.scaled(-1.0).target.tolist() == [[-1, -1], [8, -1], [0, 10]]
    for bad in (np.nan, np.inf):
        with pytest.raises(DeformError, match="strength must be a finite number"):
            THREE.scaled(bad)


def test_equality_looks_at_everything() -> None:
    assert THREE.take(range(3)) == THREE
    for other in (
        THREE.move(0, [1, 1.5]),
        THREE.edit(0, name="x"),
        THREE.edit(0, active=False),
        THREE.take([1, 0, 2]),
        THREE.edit(0, weight=2.0),
        THREE.add([0, 0]).remove(3),
    ):  # the last differs in the next id
        assert other != THREE
    assert THREE != "points"
    with pytest.raises(TypeError):
        hash(THREE)


@pytest.mark.parametrize(
    "source",
    [
        [1, 2],
        [[1]],
        [[1, 2, 3, 4]],
        [[[1, 2]]],
        [[1, 2], [3]],
        "ab",
        [["x", "y"]],
        None,
        [[1, 2j]],
        np.array([[1, 2j]]),
    ],
)
def test_arrays_of_other_shapes_and_kinds_are_refused(source: Any) -> None:
    with pytest.raises(DeformError, match="source"):
        ControlPoints.from_arrays(source)


@pytest.mark.parametrize(
    "options",
    [
        {"target": [[0, 0]]},
        {"target": [[0, 0, 0]] * 3},
        {"ids": [1, 2]},
        {"names": ["a"]},
        {"active": [True]},
        {"weight": [1, 1]},
        {"ids": [1, 1, 2]},
        {"active": np.ones((3, 1), bool)},
        {"weight": np.ones((3, 2))},
        {"ids": ["a", "b", "c"]},
        {"ids": [1, 2, 10**30]},
        {"weight": ["a"] * 3},
        {"radius": [1, 2, "wide"]},
        {"radius": [1, [2], 3]},
        {"locked": [[True], True, False]},
    ],
)
def test_parts_that_do_not_fit_together_are_refused(options: dict[str, Any]) -> None:
    with pytest.raises(DeformError):
        ControlPoints.from_arrays([[0, 0], [1, 1], [2, 2]], **options)


@pytest.mark.parametrize("change", [{"weight": "a"}, {"radius": "wide"}, {"radius": [1, 2]}, {"radius": 10**400}])
def test_what_is_no_number_is_refused_by_name(change: dict[str, Any]) -> None:
    with pytest.raises(DeformError, match=f"the {next(iter(change))} of a control point cannot be"):
        THREE.edit(1, **change)


@pytest.mark.parametrize("weight", [0.0, -1.0, np.nan, np.inf])
def test_weights_that_are_not_positive_name_the_point(weight: float) -> None:
    with pytest.raises(DeformError, match=r'the weight of point 3 \("c"\) is .*must be positive'):
        THREE.edit(2, weight=weight)


@pytest.mark.parametrize("place", [5.0, [1.0], [1, 2, 3], [[1, 2]], "xy", [np.nan, 0], [None, 0]])
def test_a_place_that_is_none_is_refused_and_not_spread(place: Any) -> None:
    for change in (
        lambda: THREE.move(1, place),
        lambda: THREE.edit(1, source=place),
        lambda: THREE.add(place),
        lambda: THREE.add([0, 0], place),
    ):
        with pytest.raises(DeformError, match=r"coordinates|numbers"):
            change()


@pytest.mark.parametrize("positions", [[2], [-3], [0, 2], [1, -3]])
def test_positions_beyond_the_points_are_refused(positions: list[int]) -> None:
    points = ControlPoints.from_arrays([[0, 0], [5, 0]])
    with pytest.raises(DeformError, match="there are 2 control points; positions"):
        points.take(positions)
    assert points.take([-2, 1]).ids == (0, 1)


def test_an_empty_set_grows() -> None:
    for dim in (2, 3):
        points = ControlPoints.empty(dim)
        assert len(points) == 0
        assert points.dim == dim
        assert points.add(np.arange(dim)).source.tolist() == [list(range(dim))]
        assert points.reset() == points.scaled(0.3) == points


@given(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS), max_size=6), st.data())
def test_removing_what_was_added_leaves_the_rest(rows: list[tuple[float, ...]], data: st.DataObject) -> None:
    points = ControlPoints.empty(2)
    for a, b, c, d in rows:
        points = points.add([a, b], [c, d])
    kept = data.draw(st.sets(st.sampled_from(points.ids))) if rows else set()
    left = points.remove(*(set(points.ids) - kept))
    assert left == points.take([points.index(i) for i in points.ids if i in kept])
    assert left.next_id == len(rows)


class Gestures(RuleBasedStateMachine):
    """Any sequence of gestures against a plain dictionary."""

    def __init__(self) -> None:
        super().__init__()
        self.points = ControlPoints.empty(2)
        self.model: dict[int, list[Any]] = {}
        self.given: set[int] = set()

    def some(self, data: st.DataObject) -> int:
        return data.draw(st.sampled_from(sorted(self.model)))

    @rule(x=NUMBERS, y=NUMBERS, name=st.text(max_size=3))
    def add(self, x: float, y: float, name: str) -> None:
        self.points = self.points.add([x, y], name=name)
        new = self.points.ids[-1]
        assert new not in self.given
        self.given.add(new)
        self.model[new] = [[x, y], [x, y], name, True]

    @precondition(lambda self: self.model)
    @rule(x=NUMBERS, y=NUMBERS, data=st.data())
    def move(self, x: float, y: float, data: st.DataObject) -> None:
        k = self.some(data)
        self.points = self.points.move(k, [x, y])
        self.model[k][1] = [x, y]

    @precondition(lambda self: self.model)
    @rule(data=st.data())
    def switch(self, data: st.DataObject) -> None:
        k = self.some(data)
        self.model[k][3] = not self.model[k][3]
        self.points = self.points.edit(k, active=self.model[k][3])

    @precondition(lambda self: self.model)
    @rule(data=st.data())
    def remove(self, data: st.DataObject) -> None:
        k = self.some(data)
        self.points = self.points.remove(k)
        del self.model[k]

    @invariant()
    def agrees(self) -> None:
        p = self.points
        rows = {
            i: [p.source[k].tolist(), p.target[k].tolist(), p.names[k], bool(p.active[k])] for k, i in enumerate(p.ids)
        }
        assert rows == self.model


TestGestures = Gestures.TestCase


def test_points_are_printed_in_one_line() -> None:
    points = ControlPoints.from_arrays([[0, 0], [10, 0], [5, 5]], [[0, 0], [12, 1], [5, 5]], names=["tail", "", "head"])
    assert repr(points) == "<ControlPoints: 3 points in the plane, 1 moved: 'tail', 'head'>"
    assert repr(ControlPoints.empty(3)) == "<ControlPoints: 0 points in space, 0 moved>"
    many = ControlPoints.from_arrays(np.arange(600).reshape(-1, 3), names=[f"point {k}\n" * 9 for k in range(200)])
    assert repr(many).startswith("<ControlPoints: 200 points in space, 0 moved: 'point 0")
    assert len(repr(many)) < 300
    assert "\n" not in repr(many)

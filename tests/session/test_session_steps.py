"""The list of steps in a session: order, switches, sums, cuts and parts, and undo of all of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from deformnb.document.deformation import Deformation, Keyframe, Step
from deformnb.document.json_format import from_json, to_json
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.fields import compose
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.session.session import Session
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import warp

GRID = Grid((10, 12, 14), (1.0, 1.5, 2.0), (3.0, -4.0, 5.0))


def a_volume() -> Volume:
    z, y, x = np.indices(GRID.shape)
    values = (120 + 60 * np.sin(x / 2 + y / 3) + 40 * np.cos(z / 2 + y)).astype(np.uint8)
    values[0, 0, 0] = 0  # the value that fills a gap
    return Volume(values, GRID, "waves")


def test_a_part_around_a_dragged_point_is_one_edit_with_the_point() -> None:
    session = Session(a_volume(), view="+y")
    middle = session.editing.points.source.mean(axis=0)
    session.editing.edit_points(session.editing.points.add(middle, np.add(middle, [1.0, 0.5])))
    points, (a, b) = session.editing.points, middle
    part = RigidPart(Polygon([(a - 3, b - 3), (a + 3, b - 3), (a + 3, b + 3), (a - 3, b + 3)]), name="bone")
    with pytest.raises(DeformError, match='is in the rigid part "bone"'):
        session.editing.add_part(part)
    with pytest.raises(DeformError, match="no way 'drop'"):
        session.editing.add_part(part, held="drop")
    assert (session.editing.step.parts, session.editing.points) == ((), points)
    for held in ("carry", "switch off"):
        session.editing.add_part(part, held=held)
        assert_allclose(session.editing.points.target[-1], middle if held == "carry" else points.target[-1])
        assert bool(session.editing.points.active[-1]) is (held == "carry")
        assert session.editing.undo() == 'add the rigid part "bone"'
        assert (session.editing.step.parts, session.editing.points) == ((), points)
    moved = replace(part, motion=RigidMotion.turn(20, middle, (0.5, 0.0)))
    session.editing.add_part(moved, held="carry")
    assert_allclose(session.editing.points.target[-1], moved.motion([middle])[0])  # type: ignore[misc]


def a_drag(session: Session, by: float = 1.0) -> None:
    middle = session.editing.points.source.mean(axis=0)
    way = np.array([by, by / 2, -by / 3])[: session.editing.points.dim]
    session.editing.edit_points(session.editing.points.add(middle, middle + way))


@pytest.fixture
def session() -> Session:
    """Three steps: from the front, from above, in space; each with a drag, and called a, b, c."""
    made = Session(a_volume())
    a_drag(made)
    made.set_view("-z")
    a_drag(made, -1.5)
    made.steps.add(in_space=True)
    a_drag(made, 0.8)
    for k, name in enumerate("abc"):
        made.steps.rename(k, name)
    return made


def names(session: Session) -> str:
    return "".join(step.name for step in session.editing.deformation.steps)


# -- order, switches, sums ---------------------------------------------------------------------------------------------


def test_a_step_in_space_begins_with_a_point_in_each_corner_of_the_volume() -> None:
    session = Session(a_volume())
    session.steps.add(in_space=True)
    assert session.editing.step.plane is None
    assert session.steps.view is None
    assert {tuple(p) for p in session.editing.points.source} == {tuple(p) for p in GRID.corners(centres=True)}
    assert not session.editing.points.displacement.any()
    session.set_view("+y")  # nothing was done in space: back on the first picture
    assert [session.steps.view_of(s.plane) for s in session.editing.deformation.steps] == ["+y"]


@pytest.mark.parametrize(("index", "to", "order"), [(0, 1, "bac"), (0, 2, "bca"), (2, 0, "cab"), (1, 1, "abc")])
def test_another_order_is_the_composition_in_that_order(session: Session, index: int, to: int, order: str) -> None:
    steps = {step.name: step for step in session.editing.deformation.steps}
    session.steps.move(index, to)
    assert names(session) == order
    expected = warp(session.volume, compose(*(steps[name].field(GRID) for name in order)))
    assert_array_equal(session.results.volume().values, expected.values)
    assert session.editing.step.name == "c"  # the one that was edited, wherever it is
    assert session.editing.history["undo"] == (
        "rename step 3" if index == to else f"do step {index + 1} {'earlier' if to < index else 'later'}"
    )


def test_the_order_matters_unless_the_steps_are_added_up(session: Session) -> None:
    first = session.results.volume().values
    session.steps.move(0, 2)
    assert not np.array_equal(session.results.volume().values, first)
    session.steps.set_mode("blend")
    added = session.results.volume().values
    session.steps.move(0, 1)
    assert_allclose(
        session.results.volume().values.astype(float), added, atol=1
    )  # sums in another order round otherwise


def test_blended_steps_add_up(session: Session) -> None:
    session.steps.set_mode("blend")
    assert session.editing.history["undo"] == "blend the steps"
    x = np.random.default_rng(3).uniform([4, -3, 6], [28, 12, 13], (50, 3))
    total = sum(step.field(GRID).displacement(x) for step in session.editing.deformation.steps)
    assert_allclose(session.results.field().displacement(x), total, atol=1e-12)
    assert np.abs(total).max() > 0.5


@pytest.mark.parametrize("index", [0, 1, 2])
@pytest.mark.parametrize("mode", ["compose", "blend"])
def test_a_step_that_is_off_is_as_if_absent(session: Session, index: int, mode: str) -> None:
    session.steps.set_mode(mode)
    before = session.results.volume().values
    session.steps.set_enabled(index, False)
    assert session.editing.history["undo"] == f"switch step {index + 1} off"
    off = session.results.volume().values
    assert not np.array_equal(off, before)
    assert_array_equal(off, session.editing.deformation.without_step(index).apply(session.volume).values)
    session.steps.set_enabled(index, True)
    assert_array_equal(session.results.volume().values, before)


def test_the_picture_shows_what_the_steps_before_have_made_in_either_mode(session: Session) -> None:
    for mode in ("compose", "blend"):
        session.steps.set_mode(mode)
        before = replace(session.editing.deformation, steps=session.editing.deformation.steps[:2])
        assert_array_equal(session.pictures.base().values, before.apply(session.volume).values)


def test_the_step_that_is_edited_stays_so(session: Session) -> None:
    session.editing.edit_step(1)
    session.steps.move(0, 2)
    assert (names(session), session.editing.index) == ("bca", 0)
    session.steps.remove(2)
    assert (names(session), session.editing.index) == ("bc", 0)
    session.editing.edit_step(1)
    session.steps.remove(0)
    assert (names(session), session.editing.index, session.editing.step.name) == ("c", 0, "c")


def test_a_step_done_twice_is_composed_with_itself(session: Session) -> None:
    session.steps.duplicate(0)
    assert names(session) == "aabc"
    assert session.editing.index == 1
    a, _, b, c = (step.field(GRID) for step in session.editing.deformation.steps)
    assert_array_equal(session.results.volume().values, warp(session.volume, compose(a, a, b, c)).values)


def test_what_names_no_step_is_refused_and_changes_nothing(session: Session) -> None:
    before, history = session.editing.deformation, session.editing.history
    for edit in (
        lambda: session.steps.move(0, 3),
        lambda: session.steps.move(3, 0),
        lambda: session.steps.move(-1, 0),
        lambda: session.steps.set_enabled(7, False),
        lambda: session.steps.rename(-1, "x"),
        lambda: session.steps.remove(3),
        lambda: session.steps.duplicate(9),
        lambda: session.steps.set_mode("mix"),
        lambda: session.editing.change(cut_rule="free"),
        lambda: session.editing.edit_document(before, "nothing", index=4),
    ):
        with pytest.raises(DeformError):
            edit()
    assert session.editing.deformation is before
    assert session.editing.history == history


# -- cuts and rigid parts ----------------------------------------------------------------------------------------------


def a_cut_session() -> Session:
    """A picture from the front, cut down its middle, with a drag to either side."""
    session = Session(a_volume())
    (left, top), (right, bottom) = session.editing.points.source.min(axis=0), session.editing.points.source.max(axis=0)
    x = (left + right) / 2
    session.editing.change("add a cut", cuts=[Cut(Line([(x, bottom), (x, top)]), "middle")])
    y = (top + bottom) / 2
    session.editing.edit_points(
        session.editing.points.add([x - 2, y], [x - 3, y]).add([x + 2, y], [x + 3, y]), "pull it open"
    )
    return session


def test_a_cut_that_is_pulled_open_shows_a_gap_and_undo_closes_it() -> None:
    session = a_cut_session()
    whole = session.volume.values
    open_one = session.results.volume().values
    columns = np.flatnonzero((open_one == 0).sum(axis=(0, 1)) > 20)
    assert columns.tolist() == [6, 7]  # the middle of 14
    assert_array_equal(open_one, session.editing.deformation.apply(session.volume).values)
    assert session.editing.undo() == "pull it open"
    assert_array_equal(session.results.volume().values, whole)
    session.editing.redo()
    assert_array_equal(session.results.volume().values, open_one)


def test_later_steps_follow_an_edit_of_a_cut_before_them() -> None:
    session = a_cut_session()
    session.set_view("-z")
    a_drag(session)
    first, second = session.editing.deformation.steps
    assert (session.pictures.base().values == 0).sum() > 100  # the gap is background in the second picture
    session.editing.edit_step(0)
    session.editing.change(cuts=[])
    session.editing.edit_step(1)
    assert (session.pictures.base().values == 0).sum() == 1
    bare = replace(first, cuts=())
    expected = warp(session.volume, compose(bare.field(GRID), second.field(GRID)))
    assert_array_equal(session.results.volume().values, expected.values)


def test_a_rigid_part_keeps_its_form_and_a_point_in_it_is_refused() -> None:
    session = Session(a_volume())
    middle = session.editing.points.source.mean(axis=0)
    ground = HalfSpace(tuple(middle), (0.0, -1.0))  # below the middle of the picture
    a_drag(session)
    inside = middle + np.array([0, 2])
    torn = replace(
        session.editing.step,
        parts=(RigidPart(ground, name="ground"),),
        maps=(session.editing.points.add(inside, inside + np.array([2, 0])),),
    )
    with pytest.raises(DeformError, match="ground"):
        session.editing.edit_document(session.editing.deformation.with_step(0, torn), "both")
    assert session.editing.step.parts == ()
    up = ControlPoints.from_arrays([middle - np.array([0, 3])], [middle - np.array([1, 5])])
    part = RigidPart(ground, name="ground")
    session.editing.edit_document(
        session.editing.deformation.with_step(0, replace(session.editing.step, parts=(part,), maps=(up,))), "hold it"
    )
    x = Plane.from_view(GRID, "+y").from_plane(np.array([[middle[0] + 3.0, middle[1] + 2.5, 0.0]]))
    assert_allclose(session.results.field().displacement(x), 0, atol=1e-12)
    assert np.abs(session.results.field().displacement(x + np.array([-3, 0, 5.5]))).max() > 0.5
    assert session.editing.history["undo"] == "hold it"


def test_points_that_a_part_carries_go_with_it_in_one_edit() -> None:
    session = Session(a_volume())
    middle = session.editing.points.source.mean(axis=0)
    bone = RigidPart(Polygon(middle + 2 * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])), name="bone")
    session.editing.edit_points(session.editing.points.add(middle + 1, middle + 1))
    session.editing.edit_parts([bone], "draw bone")
    before = session.editing.points
    motion = RigidMotion.turn(40, middle, (1.0, 0.5))
    session.editing.edit_parts([replace(bone, motion=motion)], "turn bone")
    assert_allclose(session.editing.points.target[-1], motion(middle + 1))
    assert_array_equal(session.editing.points.target[:-1], before.target[:-1])
    session.editing.change(strength=0.5)  # half of the turn is not half of the path
    session.results.field()
    session.editing.undo()
    session.editing.undo()
    assert (session.editing.points, session.editing.step.parts) == (before, (bone,))


def test_an_untouched_picture_with_a_cut_is_not_thrown_away_by_a_turn() -> None:
    session = Session(a_volume())
    session.editing.change(cuts=[Cut(Line([(5.0, 0.0), (5.0, 9.0)]))])
    session.set_view("-z")
    assert [len(step.cuts) for step in session.editing.deformation.steps] == [1, 0]


def test_cuts_parts_and_steps_survive_files_and_code(session: Session) -> None:
    session.editing.edit_parts([RigidPart(HalfSpace((0.0, 0.0, 6.0), (0.0, 0.0, 1.0)), name="table")])
    session.set_view("+y")
    session.editing.change(
        cuts=[Cut(Line([(9.0, 0.0), (11.0, 9.0)]), "line"), Cut(HalfSpace((2.0, 2.0), (1.0, 0.0)), enabled=False)]
    )
    session.editing.edit_parts(
        [
            RigidPart(
                Polygon([(20, 1), (24, 1), (24, 6), (20, 6)]), RigidMotion.turn(5, (22, 3)), "distance", 7.0, "bone"
            )
        ]
    )
    session.editing.change(cut_rule="paper")
    session.steps.set_mode("blend")
    assert from_json(to_json(session.editing.deformation)) == session.editing.deformation
    scope: dict[str, Any] = {"a_volume": a_volume}
    exec(session.code("a_volume()"), scope)
    assert scope["deformation"] == session.editing.deformation
    assert_array_equal(scope["deformed"].values, session.results.volume().values)


def test_a_reset_takes_key_frames_along_and_undo_brings_them_back(session: Session) -> None:
    keys = tuple(Keyframe(float(t), session.editing.deformation.steps) for t in range(3))
    session.editing.edit_document(replace(session.editing.deformation, keyframes=keys), "add key frames")
    kept = session.editing.deformation
    session.editing.reset()
    assert session.editing.deformation.keyframes == ()
    assert session.editing.undo() == "reset"
    assert session.editing.deformation == kept


def test_any_document_is_one_edit(session: Session) -> None:
    before = session.editing.deformation
    session.editing.edit_document(Deformation(before.steps[:1]), "keep the first", index=0)
    assert (session.editing.index, session.editing.history["undo"]) == (0, "keep the first")
    session.editing.undo()
    assert (session.editing.deformation, session.editing.index) == (before, 2)
    session.editing.edit_document(Deformation(before.steps[:1]), "keep the first")
    assert session.editing.index == 0  # there is no third step any more
    session.editing.edit_document(session.editing.deformation, "nothing changes")
    assert session.editing.history["undo"] == "keep the first"


# -- all of it ---------------------------------------------------------------------------------------------------------


def a_half(session: Session, n: int) -> HalfSpace:
    normal = np.eye(session.editing.points.dim)[n % session.editing.points.dim]
    return HalfSpace(tuple(session.editing.points.source.mean(axis=0) + n - 3.3), tuple(normal))


def may_grow(session: Session) -> bool:
    return len(session.editing.deformation.steps) < 4


EDITS: dict[str, Callable[[Session, int, int], Any]] = {
    "drag": lambda s, n, at: a_drag(s, 0.1 * (n + 1)),
    "add": lambda s, n, at: may_grow(s) and s.steps.add(),
    "space": lambda s, n, at: may_grow(s) and s.steps.add(in_space=True),
    "double": lambda s, n, at: may_grow(s) and s.steps.duplicate(at),
    "remove": lambda s, n, at: s.steps.remove(at),
    "move": lambda s, n, at: s.steps.move(at, (n // 2) % len(s.editing.deformation.steps)),
    "switch": lambda s, n, at: s.steps.set_enabled(at, n % 2 == 0),
    "rename": lambda s, n, at: s.steps.rename(at, f"step {n}"),
    "mode": lambda s, n, at: s.steps.set_mode("blend" if n % 2 else "compose"),
    "cut": lambda s, n, at: s.editing.change(cuts=[Cut(a_half(s, n))] if n % 4 else []),
    "part": lambda s, n, at: s.editing.edit_parts([RigidPart(a_half(s, n))] if n % 4 else []),
    "rule": lambda s, n, at: s.editing.change(cut_rule="paper" if n % 2 else "source"),
    "view": lambda s, n, at: s.set_view(["+y", "-z", "+x"][n % 3]),
    "choose": lambda s, n, at: s.editing.edit_step(at),
}


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(sorted(EDITS)), st.integers(0, 7)), max_size=14))
def test_undo_leads_back_through_every_document(edits: list[tuple[str, int]]) -> None:
    session = Session(a_volume())
    documents = [session.editing.deformation]
    for what, n in edits:
        before = session.editing.deformation
        try:
            EDITS[what](session, n, n % len(session.editing.deformation.steps))
        except DeformError:  # such as a point in a rigid part: nothing has changed
            assert session.editing.deformation is before
        if session.editing.deformation != documents[-1]:
            documents.append(session.editing.deformation)
        assert 0 <= session.editing.index < len(session.editing.deformation.steps)
        assert 0 <= session.editing.key < len(session.editing.step.maps)
    back = [session.editing.deformation]
    while session.editing.undo():
        if session.editing.deformation != back[-1]:
            back.append(session.editing.deformation)
    assert back == documents[::-1]
    assert isinstance(session.editing.step, Step)


def test_a_cut_that_is_modulated_is_open_in_front() -> None:
    session = Session(Volume(np.zeros((8, 8, 8), np.uint8), Grid((8, 8, 8))), view="+y")
    session.editing.change("draw a cut", cuts=[Cut(Line(((4, 0), (4, 8))))])
    session.editing.change(extrusion="modulate")
    assert session.editing.step.curve == "1-z"
    assert "open in front" in session.editing.notice
    session.editing.change(extrusion="replicate")
    session.editing.change(extrusion="modulate", curve="z")  # requested
    assert session.editing.step.curve == "z"

"""Examples of a deformation: one edit each, undone in one step, and their effect on the subject."""

from __future__ import annotations

import numpy as np
import pytest

from deformnb.analysis import jacobian_determinant
from deformnb.datasets import PHANTOMS
from deformnb.errors import DeformError
from deformnb.imaging.demo import subject_box
from deformnb.session.examples import EXAMPLES, apply_example, fitting_examples
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume


@pytest.fixture
def session() -> Session:
    return Session(PHANTOMS["fish"].make((24, 48, 24)), view="-x")


@pytest.mark.parametrize("name", list(EXAMPLES))
def test_an_example_is_one_edit_that_one_undo_takes_back(session: Session, name: str) -> None:
    before = session.editing.deformation
    apply_example(session, name)
    assert session.editing.deformation != before
    assert session.editing.points.displacement.any()
    assert EXAMPLES[name].title.lower() in session.editing.history["undo"]
    session.editing.undo()
    assert session.editing.deformation == before


@pytest.mark.parametrize("name", list(EXAMPLES))
def test_an_example_takes_the_place_of_what_was_there(session: Session, name: str) -> None:
    apply_example(session, name)
    once = session.editing.deformation
    apply_example(session, "open")
    apply_example(session, name)
    assert session.editing.deformation.steps == once.steps


def test_the_bent_middle_line_is_an_arc_of_the_same_length(session: Session) -> None:
    apply_example(session, "bend")
    target = session.editing.points.target.reshape(3, 5, 2)[1]  # of the middle line
    source = session.editing.points.source.reshape(3, 5, 2)[1]
    chords = np.linalg.norm(np.diff(target, axis=0), axis=1)
    np.testing.assert_allclose(chords, chords[0])
    angle = 1.0 / 4  # of a chord: a fourth of a radian
    np.testing.assert_allclose(chords, np.linalg.norm(source[1] - source[0]) * np.sin(angle / 2) / (angle / 2))
    turned = np.diff(target, axis=0) / chords[:, None]
    np.testing.assert_allclose(np.sum(turned[1:] * turned[:-1], axis=1), np.cos(angle))


@pytest.mark.parametrize("degrees", [-55, 0, 30])
@pytest.mark.parametrize("name", ["bend", "open"])
def test_examples_follow_a_subject_that_lies_across_the_picture(name: str, degrees: float) -> None:
    """An ellipse whose axis is known: 30 by 9, turned about the middle of the picture."""
    x, y = np.meshgrid(np.arange(80.0) - 39.5, np.arange(90.0) - 44.5)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    seen = ((c * x + s * y) / 30) ** 2 + ((c * y - s * x) / 9) ** 2 < 1
    session = Session(Volume.from_array(np.repeat(200 * seen[None].astype(np.uint8), 3, axis=0)), view="+z")
    apply_example(session, name)
    way = (
        session.editing.points.source.reshape(3, 5, 2)[1, -1] - session.editing.points.source.reshape(3, 5, 2)[1, 0]
        if name == "bend"
        else np.subtract(*session.editing.step.cuts[0].region.vertices)
    )
    plane = session.editing.step.plane
    turned = plane.from_plane([[*way, 0.0]])[0] - plane.from_plane([[0.0, 0.0, 0.0]])[0]
    assert (np.degrees(np.arctan2(turned[1], turned[0])) - degrees + 90) % 180 - 90 == pytest.approx(0, abs=1)
    assert np.hypot(*way) == pytest.approx(60 if name == "bend" else 36, rel=0.03)


def test_an_incision_opens_inside_the_subject_from_the_front_without_a_fold(session: Session) -> None:
    apply_example(session, "open")
    (cut,) = session.editing.step.cuts
    a0, a1, b0, b1 = subject_box(session.pictures.picture())
    middle, reach = (a0 + a1) / 2, 0.6 * (a1 - a0) / 2
    ends = [(middle - reach, (b0 + b1) / 2), (middle + reach, (b0 + b1) / 2)]
    np.testing.assert_allclose(cut.region.vertices, ends, atol=0.05 * (a1 - a0))  # the fish lies along the picture
    assert cut.region.stops == (True, True)
    sides = cut.region.signed_distance(session.editing.points.source) < 0
    moved = session.editing.points.displacement.any(axis=1)
    assert sorted(sides[moved].tolist()) == [False, True]
    away = cut.region.signed_distance(session.editing.points.target[moved])
    assert (np.abs(away) > np.abs(cut.region.signed_distance(session.editing.points.source[moved]))).all()
    grid, plane = session.volume.grid, session.editing.step.plane
    assert jacobian_determinant(session.editing.deformation, grid).min() > 0.2
    slices = plane.slices(grid)
    behind = plane.from_plane([(middle + reach / 2, (b0 + b1) / 2 + 1, slices.depth(slices.count - 1))])
    assert np.abs(session.editing.deformation.field(grid).displacement(behind)).max() < 1e-9


def test_what_cannot_be_done_is_said_and_changes_nothing(session: Session) -> None:
    before = session.editing.deformation
    with pytest.raises(DeformError, match="unknown example 'twist'; choose one of bend, widen, open, thompson"):
        apply_example(session, "twist")
    session.steps.add(in_space=True)
    with pytest.raises(DeformError, match="points in space"):
        apply_example(session, "bend")
    session.editing.undo()
    assert session.editing.deformation == before
    empty = Session(Volume(np.zeros((4, 5, 6), np.uint8), Grid((4, 5, 6))))
    with pytest.raises(DeformError, match="all pixels are equal"):
        apply_example(empty, "bend")


@pytest.mark.parametrize(
    ("name", "view", "fitting"),
    [
        ("fish", "-x", ("bend", "open", "thompson")),
        ("head", "+y", ("widen", "open")),
        ("abdomen", "+y", ("widen", "open")),
    ],
)
def test_a_fish_s_grid_is_offered_for_what_is_like_a_fish(name: str, view: str, fitting: tuple[str, ...]) -> None:
    session = Session(PHANTOMS[name].make((32, 32, 32)), view=view)
    found = fitting_examples(session)
    assert set(found) >= set(fitting)
    assert ("thompson" in found) == ("thompson" in fitting)
    session.steps.add(in_space=True)
    assert fitting_examples(session) == ()


def test_both_sides_are_widened_by_the_same_amount() -> None:
    session = Session(PHANTOMS["head"].make((32, 32, 32)), view="+y")
    apply_example(session, "widen")
    moved = session.editing.points.displacement
    moved = moved[moved.any(axis=1)]
    np.testing.assert_allclose(moved[0], -moved[1])
    assert jacobian_determinant(session.editing.deformation, session.volume.grid).min() > 0.2

"""Points that a session adds by itself: along the outline of the picture, and from landmarks."""

from __future__ import annotations

import numpy as np
import pytest

from deformnb.datasets import PHANTOMS
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.registration.outlines import OUTLINE_POINT
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.points import Landmarks


@pytest.fixture
def session() -> Session:
    return Session(PHANTOMS["fish"].make((24, 48, 24)), view="-x")


# -- the outline -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["mip", "mean", "slice", "shaded"])
def test_a_held_outline_keeps_the_body_from_being_sheared_by_a_drag(method: str) -> None:
    session = Session(PHANTOMS["fish"].make((24, 48, 24)), view="-x", method=method)
    middle = session.editing.points.source.mean(axis=0)

    def moved(points: ControlPoints) -> float:
        """Displacement of the outline when its middle is dragged, as a share of the drag."""
        way = 0.1 * np.ptp(session.editing.points.source, axis=0)
        session.editing.edit_points(points.add(middle, middle + way))
        (fit,) = session.editing.step.fits(session.volume.grid)
        return float(np.linalg.norm(fit.displacement(outline), axis=1).mean() / np.linalg.norm(way))

    session.fix_outline()
    held = session.editing.points
    outline = held.source[[name == OUTLINE_POINT for name in held.names]]
    assert len(outline) > 8
    assert session.editing.history["undo"] == "hold the outline"
    assert session.editing.notice.startswith(f"{len(outline)} points hold the outline")
    with_it = moved(held)
    session.editing.undo()
    session.editing.undo()
    assert OUTLINE_POINT not in session.editing.points.names
    assert with_it < 0.02 < moved(session.editing.points)


def test_an_outline_is_that_of_the_body_whatever_window_is_set(session: Session) -> None:
    session.fix_outline()
    wanted = session.editing.points
    session.editing.undo()
    low, high = session.volume.value_range
    session.pictures.window = (0.8 * high + 0.2 * low, high)  # nothing but bone is seen
    session.fix_outline()
    np.testing.assert_array_equal(session.editing.points.source, wanted.source)


def test_an_outline_needs_a_picture_with_something_on_it(session: Session) -> None:
    session.steps.add(in_space=True)
    with pytest.raises(DeformError, match="points in space"):
        session.fix_outline()
    empty = Session(Volume(np.zeros((8, 8, 8), np.uint8), Grid((8, 8, 8))))
    with pytest.raises(DeformError, match=r"outline|one grey value"):
        empty.fix_outline()
    assert empty.editing.history["undo"] == ""


# -- landmarks ---------------------------------------------------------------------------------------------------------


def test_landmarks_in_space_become_points_of_the_picture_and_come_back(session: Session) -> None:
    plane, before = session.editing.plane, len(session.editing.points)
    places = plane.from_plane([[10.0, 5.0, 3.0], [20.0, 8.0, -2.0], [30.0, 4.0, 0.0]])
    fixed = plane.from_plane([[12.0, 5.0, 3.0], [np.nan] * 3, [30.0, 9.0, 0.0]])
    session.add_landmarks(Landmarks(places, ("nose", "eye", "tail"), fixed=fixed, active=np.array([True, True, False])))
    points = session.editing.points
    np.testing.assert_allclose(points.source[before:], [[10, 5], [20, 8], [30, 4]], atol=1e-9)
    np.testing.assert_allclose(points.target[before:], [[12, 5], [20, 8], [30, 9]], atol=1e-9)
    assert points.names[before:] == ("nose", "eye", "tail")
    assert points.active.tolist()[before:] == [True, True, False]
    back = session.landmarks()
    assert back.names == points.names
    np.testing.assert_allclose(plane.to_plane(back.points)[:, :2], points.source, atol=1e-9)
    assert back.fixed is not None
    np.testing.assert_allclose(plane.to_plane(back.fixed)[:, :2], points.target, atol=1e-9)
    session.editing.undo()
    assert len(session.editing.points) == before


def test_landmarks_of_a_picture_and_of_space_go_where_they_belong(session: Session) -> None:
    session.add_landmarks(Landmarks([[10.0, 5.0]], ("nose",)))
    np.testing.assert_array_equal(session.editing.points.source[-1], [10.0, 5.0])
    session.steps.add(in_space=True)
    with pytest.raises(DeformError, match="are on a picture"):
        session.add_landmarks(Landmarks([[10.0, 5.0]]))
    session.add_landmarks(Landmarks([[1.0, 2.0, 3.0]], ("eye",), fixed=[[2.0, 2.0, 3.0]]))
    np.testing.assert_array_equal(session.landmarks().points[-1], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(session.editing.points.displacement[-1], [-1.0, 0.0, 0.0])

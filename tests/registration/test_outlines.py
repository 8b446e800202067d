"""Outlines of pictures, and points that slide along them, against circles, ellipses and Bookstein's energy."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from deformed_pictures import picture
from numpy.typing import NDArray

from deformnb.analysis.quality import bending_energy
from deformnb.errors import Cancelled, DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.registration.outlines import (
    OUTLINE_POINT,
    ClosedCurve,
    area,
    bending_matrix,
    dark_and_bright,
    fit_outline,
    fix_outline,
    outline,
    slide,
)


def _blob(phase: float = 0.0, count: int = 720, wave: float = 0.2) -> NDArray[np.float64]:
    """A lobed outline around (50, 60), positive area."""
    t = np.linspace(0, 2 * np.pi, count, endpoint=False) + phase
    r = 30 * (1 + wave * np.cos(3 * t) + 0.1 * np.sin(2 * t))
    return np.stack([50 + r * np.cos(t), 60 + r * np.sin(t)], axis=1)


def _ellipse(a: float, b: float, count: int = 720) -> NDArray[np.float64]:
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([50 + a * np.cos(t), 50 + b * np.sin(t)], axis=1)


def _points_on_arc(curve: ClosedCurve, s: Any) -> NDArray[np.float64]:
    return curve.at(np.asarray(s) * curve.length)


# -- outlines ----------------------------------------------------------------------------------------------------------


def test_the_outline_of_a_disc_with_a_hole_lies_on_its_circles() -> None:
    a, b = np.meshgrid(np.arange(80) * 0.5 + 10, np.arange(60) * 0.5 - 3)
    r = np.hypot(a - 30, b - 12)
    ring = np.clip(0.5 + (10 - r), 0, 1) * np.clip(0.5 + (r - 4), 0, 1)
    outer, hole = outline(picture(ring, 0.5, (10.0, -3.0)), 0.5)
    assert np.abs(np.hypot(*(outer - [30, 12]).T) - 10).max() < 0.05
    assert np.abs(np.hypot(*(hole - [30, 12]).T) - 4).max() < 0.05
    assert area(outer) == pytest.approx(np.pi * 100, rel=0.01)
    assert area(hole) == pytest.approx(-np.pi * 16, rel=0.02)


def test_an_outline_cut_off_by_the_picture_is_closed_along_its_edge() -> None:
    a, b = np.meshgrid(np.arange(40.0), np.arange(40.0))
    [line] = outline(picture(np.clip(0.5 + 20 - np.hypot(a, b), 0, 1)), 0.5)
    assert line.min() == pytest.approx(-0.5)
    assert area(line) == pytest.approx(np.pi * 400 / 4 + 20, rel=0.02)


def test_specks_are_left_out_and_the_largest_comes_first() -> None:
    values = np.zeros((100, 100))
    values[50, 50] = 1
    values[10:20, 10:20] = 1
    values[60:90, 60:90] = 1
    found = [area(line) for line in outline(picture(values))]
    assert found == pytest.approx([900, 100], rel=0.02)


def test_the_default_level_parts_dark_from_bright() -> None:
    rng = np.random.default_rng(0)
    grey = np.concatenate([rng.normal(0.1, 0.02, 5000), rng.normal(0.6, 0.05, 800)]).clip(0, 1)
    assert 0.2 < dark_and_bright(grey) < 0.5


@pytest.mark.parametrize(
    ("values", "level", "words"),
    [
        (np.zeros((9, 9)), None, "one grey value only"),
        (np.eye(9), 1.5, "between 0"),
    ],
)
def test_pictures_without_an_outline_are_refused(values: Any, level: float | None, words: str) -> None:
    with pytest.raises(DeformError, match=words):
        outline(picture(values), level)


# -- curves ------------------------------------------------------------------------------------------------------------


def test_a_curve_is_walked_by_arc_length() -> None:
    square = ClosedCurve([[0, 0], [4, 0], [4, 4], [4, 4], [0, 4]])
    assert square.length == 16
    assert square.at([1, 6, 15, 17, -1]).tolist() == [[1, 0], [4, 2], [0, 1], [1, 0], [0, 1]]
    assert square.nearest(np.array([5.0, 3.0])) == (7, 1)
    assert square.tangent(np.array([2.0])).tolist()[0] == pytest.approx([1, 0], abs=0.8)
    path = ClosedCurve([[0, 0], [4, 0]], closed=False)
    assert path.at([-1, 3, 9]).tolist() == [[0, 0], [3, 0], [4, 0]]


@pytest.mark.parametrize("line", [[[0, 0]], [[1, 1], [1, 1]], [[0, 0], [np.nan, 1]], [[0, 0, 0], [1, 1, 1]]])
def test_what_is_no_curve_is_refused(line: Any) -> None:
    with pytest.raises(DeformError, match="outline"):
        ClosedCurve(line)


# -- bending -----------------------------------------------------------------------------------------------------------


def test_the_bending_matrix_gives_the_energy_of_the_quality_module() -> None:
    rng = np.random.default_rng(4)
    source = rng.random((12, 2)) * 40 + 100
    target = source + rng.normal(0, 2, source.shape)
    matrix = bending_matrix(source)
    points = ControlPoints.from_arrays(source, target)
    assert (target * (matrix @ target)).sum() == pytest.approx(bending_energy(points), rel=1e-9)
    assert np.abs(matrix @ np.column_stack([np.ones(12), source])).max() < 1e-9 * np.abs(matrix).max() * 100
    assert np.linalg.eigvalsh(matrix).min() > -1e-12 * np.abs(matrix).max()


@pytest.mark.parametrize("source", [[[0, 0], [1, 0], [2, 0], [5, 0]], [[0, 0], [4, 0], [0, 4], [4, 4], [4, 4]]])
def test_sources_without_a_spline_are_refused(source: Any) -> None:
    with pytest.raises(DeformError, match="no thin-plate spline"):
        bending_matrix(source)


# -- sliding -----------------------------------------------------------------------------------------------------------


def _slid_off(count: int = 20) -> tuple[ControlPoints, NDArray[np.float64]]:
    """Points on a lobed outline whose targets have slid along it, every fifth a true landmark."""
    line = _blob()
    curve, share = ClosedCurve(line), np.arange(count) / count
    off = 0.012 * np.sin(2 * np.pi * share * 3) + 0.008 * np.cos(2 * np.pi * share)
    off[::5] = 0
    return ControlPoints.from_arrays(_points_on_arc(curve, share), _points_on_arc(curve, share + off)), line


def test_on_identical_outlines_they_return_to_their_places() -> None:
    points, line = _slid_off()
    start = np.linalg.norm(points.displacement, axis=1)
    found = slide(points, [line], fixed_ids=[0, 5, 10, 15])
    left = np.linalg.norm(found.points.displacement, axis=1)
    assert start.max() > 3
    assert left.max() < 1e-3
    assert found.energy[-1] < 1e-6 * found.energy[0]
    assert len(found.ids) == 16


def test_the_energy_never_rises_and_is_that_of_the_points() -> None:
    points, _ = _slid_off()
    other = _blob(wave=0.05)
    found = slide(points, [other], ids=[k for k in range(20) if k % 5])
    assert (np.diff(found.energy) < 0).all()
    assert len(found.energy) > 3
    assert found.energy[-1] == pytest.approx(bending_energy(found.points), rel=1e-6)


def test_they_stay_on_the_outline_and_true_landmarks_where_they_are() -> None:
    points, line = _slid_off()
    points = points.edit(3, locked=True).edit(8, active=False)
    found = slide(points, [line], fixed_ids=[0, 5, 10, 15], iterations=2)
    curve = ClosedCurve(line)
    assert max(curve.nearest(t)[1] for t in found.points.target) < 1e-9
    stay = [0, 3, 5, 8, 10, 15]
    assert (found.points.target[stay] == points.target[stay]).all()
    assert not set(stay) & set(found.ids)
    assert found.points == replace(points, target=found.points.target)


def test_a_circle_becomes_an_ellipse_by_an_affine_map() -> None:
    """That map bends nothing, so equal angles, not equal lengths of arc, correspond: 8.7 units apart at first."""
    count = 24
    found = fit_outline(ControlPoints.empty(), _ellipse(30, 30), _ellipse(48, 24), count=count, iterations=100)
    first = fit_outline(ControlPoints.empty(), _ellipse(30, 30), _ellipse(48, 24), count=count, iterations=0)
    source = found.points.source - 50
    ends = [(p.points.target - 50 - source * [1.6, 0.8]) for p in (first, found)]
    angle = [np.linalg.lstsq(source, p.points.target - 50, rcond=None)[1].sum() for p in (first, found)]
    assert np.linalg.norm(ends[0], axis=1).max() > 2
    assert found.energy[-1] < 1e-4 * found.energy[0]
    assert angle[1] < 1e-2 * angle[0]  # what no linear map explains
    assert found.points.names[0] == "outline 1"
    assert found.points.ids == found.ids == tuple(range(count))


def test_points_that_are_there_already_stay_and_are_not_put_on_the_outline() -> None:
    corners = ControlPoints.from_arrays([[0.0, 0.0], [100, 0], [0, 120], [100, 120]], names=["corner"] * 4)
    found = fit_outline(corners, _blob(), _blob(wave=0.1), count=12).points
    assert len(found) == 16
    assert found.take(range(4)) == replace(corners, next_id=16)
    again = slide(found, [_blob(wave=0.1)])
    assert set(again.ids) == set(range(4, 16))


def test_outlines_that_begin_elsewhere_or_run_the_other_way_correspond() -> None:
    one, other = _blob(), np.add(np.roll(_blob(), 200, axis=0)[::-1], [7.0, -3.0])
    found = fit_outline(ControlPoints.empty(), one, other, count=16, iterations=0).points
    assert np.abs(found.target - found.source - [7, -3]).max() < 0.2


def test_none_overtakes_another() -> None:
    points, line = _slid_off(40)
    curve = ClosedCurve(line)
    found = slide(points, [line])
    places = np.array([curve.nearest(t)[0] for t in found.points.target])
    assert ((np.diff(places) % curve.length) < curve.length / 2).all()


def test_progress_and_stopping() -> None:
    points, line = _slid_off()
    told: list[float] = []
    slide(points, [line], progress=told.append)
    assert told == sorted(told)
    assert told[-1] == 1

    def stop(share: float) -> None:
        raise Cancelled("enough")

    before = points.target.copy()
    with pytest.raises(Cancelled):
        slide(points, [line], progress=stop)
    assert (points.target == before).all()


def test_what_cannot_slide_is_said() -> None:
    points, line = _slid_off()
    with pytest.raises(DeformError, match="no point can slide"):
        slide(points, [line + 40.0])
    with pytest.raises(DeformError, match="no control point 99"):
        slide(points, [line], fixed_ids=[99])
    with pytest.raises(DeformError, match="an outline at least"):
        slide(points, [])
    with pytest.raises(DeformError, match="3 to 500 points"):
        fit_outline(points, line, line, count=2)
    with pytest.raises(DeformError, match=r"3 to 500 points, got 3\.5"):
        fit_outline(points, line, line, count=3.5)  # type: ignore[arg-type]
    for no_line in ([], "line", [[0, 0, 0], [1, 1, 1], [2, 0, 0]]):
        with pytest.raises(DeformError, match="an outline must be finite points"):
            fit_outline(points, no_line, line)
    with pytest.raises(DeformError, match="points in space"):
        fit_outline(ControlPoints.empty(3), line, line)


# -- an outline that is held -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [3, 16, 50])
def test_points_that_hold_an_outline_lie_on_it_evenly_and_stay(count: int) -> None:
    held = fix_outline(ControlPoints.empty(), _blob(), count=count)
    curve = ClosedCurve(_blob())
    assert held.names == (OUTLINE_POINT,) * count
    np.testing.assert_array_equal(held.source, held.target)
    along = np.sort([curve.nearest(place)[0] for place in held.source])
    assert max(curve.nearest(place)[1] for place in held.source) < 1e-9
    np.testing.assert_allclose(np.diff(along), curve.length / count, rtol=1e-6)


def test_what_was_dragged_stays_and_has_room_and_a_second_call_changes_nothing() -> None:
    tip = _blob()[0]
    dragged = ControlPoints.from_arrays([tip, [50.0, 60.0]], [tip + 12.0, [50.0, 60.0]], names=["tip", ""])
    held = fix_outline(dragged, _blob(), count=20)
    assert held.names[:2] == ("tip", "")
    gap = ClosedCurve(_blob()).length / 40
    others = held.source[2:]
    assert np.linalg.norm(others - tip, axis=1).min() >= gap
    assert np.linalg.norm(others - tip - 12.0, axis=1).min() >= gap
    again = fix_outline(held, _blob(), count=20)
    np.testing.assert_array_equal(again.source, held.source)
    moved = held.move(held.ids[-1], held.target[-1] + 5.0)
    assert held.ids[-1] in fix_outline(moved, _blob(), count=20).ids  # dragged, it is a point like any other


@pytest.mark.parametrize("count", [2, 501, 3.5])
def test_an_outline_is_held_by_a_number_of_points(count: Any) -> None:
    with pytest.raises(DeformError, match="3 to 500"):
        fix_outline(ControlPoints.empty(), _blob(), count=count)
    with pytest.raises(DeformError, match="on a picture"):
        fix_outline(ControlPoints.empty(3), _blob())

"""Paths of control points between key frames: turning limbs keep their size, rigid parts stay rigid."""

from __future__ import annotations

import numpy as np
import pytest

from deformnb.document.motion_paths import HandlePath, neighbours
from deformnb.errors import DeformError

# A leg along x: thigh, knee, calf, and the corners of the picture.
THIGH = np.array([[x, y] for x in (0.0, 10.0, 20.0, 30.0, 40.0) for y in (-4.0, 4.0)])
KNEE = np.array([[48.0, 0.0]])
CALF = np.array([[x, y] for x in (55.0, 65.0, 75.0, 85.0) for y in (-3.0, 3.0)])
CORNERS = np.array([[-60.0, -80.0], [160.0, -80.0], [160.0, 80.0], [-60.0, 80.0]])
LEG = np.concatenate([THIGH, KNEE, CALF, CORNERS])
KNEE_AT, CALF_AT = 10, slice(11, 19)
TIMES = np.linspace(0, 1, 21)


def turned(points: np.ndarray, degrees: float, about: tuple[float, float]) -> np.ndarray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    x, y = (points - about).T
    return np.stack([c * x - s * y, s * x + c * y], axis=1) + about


def bent(degrees: float) -> np.ndarray:
    end = LEG.copy()
    end[CALF_AT] = turned(CALF, degrees, (48.0, 0.0))
    return end


def length(places: np.ndarray) -> float:
    """From the knee to the foot; 37 at rest."""
    return float(np.linalg.norm(places[17:19].mean(axis=0) - places[KNEE_AT]))


# Length of the leg halfway on straight paths: cos(angle / 2), to three digits.
@pytest.mark.parametrize(("degrees", "straight"), [(30, 0.966), (60, 0.866), (90, 0.707), (150, 0.259)])
def test_a_leg_that_bends_keeps_its_length(degrees: float, straight: float) -> None:
    path = HandlePath(LEG, bent(degrees))
    assert length((LEG + bent(degrees)) / 2) == pytest.approx(37 * straight, rel=2e-3)
    lengths = [length(path.at(t)) for t in TIMES]
    assert min(lengths) > 37 * 0.995  # 0.9952 is the least, at 90 degrees
    assert max(lengths) < 37 * 1.001
    angle = np.degrees(np.arctan2(*(path.at(0.5)[17:19].mean(axis=0) - path.at(0.5)[KNEE_AT])[::-1]))
    assert angle == pytest.approx(degrees / 2, abs=0.5)
    for t in TIMES:
        assert (path.at(t)[: KNEE_AT + 1] == LEG[: KNEE_AT + 1]).all(), "what is fixed has moved"
        assert (path.at(t)[19:] == CORNERS).all()


@pytest.mark.parametrize("degrees", [30, 60, 90, 150])
def test_one_point_turns_about_those_that_are_fixed(degrees: float) -> None:
    """The paper's knee: points around the end of the femur, one in the calf."""
    angles = np.arange(8) * np.pi / 4
    start = np.concatenate([np.stack([40 + 6 * np.cos(angles), 6 * np.sin(angles)], axis=1), [[90.0, 0.0]]])
    end = start.copy()
    end[8] = turned(start[8:], degrees, (40.0, 0.0))[0]
    path = HandlePath(start, end)
    assert [np.hypot(*(path.at(t)[8] - (40, 0))) for t in TIMES] == pytest.approx([50.0] * 21, rel=0.01)


@pytest.mark.parametrize("degrees", [0.0, 40.0, 130.0, -175.0])
def test_a_rigid_motion_of_all_points_is_met_exactly(degrees: float) -> None:
    start = LEG[:19]
    path = HandlePath(start, turned(start, degrees, (300.0, -50.0)))
    for t in TIMES:
        np.testing.assert_allclose(path.at(t), turned(start, degrees * t, (300.0, -50.0)), atol=1e-9)
    assert np.degrees(path.largest_turn) == pytest.approx(abs(degrees), abs=1e-6)


def test_a_shift_is_straight() -> None:
    path = HandlePath(LEG, LEG + np.array([30, -10]))
    np.testing.assert_allclose(path.at(0.3), LEG + np.array([9, -3]), atol=1e-9)
    assert path.largest_turn == pytest.approx(0, abs=1e-9)


def test_a_screw_in_space_is_met_exactly() -> None:
    rng = np.random.default_rng(1)
    start = rng.uniform(-20, 20, (40, 3))

    def screw(t: float) -> np.ndarray:  # 120 degrees about an axis along z through (5, 0), and 12 along it
        flat = turned(start[:, :2], 120 * t, (5.0, 0.0))
        return np.column_stack([flat, start[:, 2] + 12 * t])

    path = HandlePath(start, screw(1.0))
    for t in (0.1, 0.5, 0.8):
        np.testing.assert_allclose(path.at(t), screw(t), atol=1e-9)


def test_an_arm_in_space_keeps_its_length() -> None:
    body = np.array([[x, y, z] for x in (0.0, 10.0) for y in (0.0, 10.0) for z in (-20.0, -10.0, 0.0)])
    arm = np.array([[x, y, z] for x in (4.0, 6.0) for y in (4.0, 6.0) for z in (10.0, 20.0, 30.0)])
    end = np.concatenate([body, arm])
    x, y, z = (arm - (5, 5, 0)).T
    end[12:] = np.stack([z, y, -x], axis=1) + np.array([5, 5, 0])  # 90 degrees about y
    path = HandlePath(np.concatenate([body, arm]), end)
    for t in TIMES:
        hand = path.at(t)[12:][[2, 5, 8, 11]].mean(axis=0) - (5, 5, 0)
        assert np.linalg.norm(hand) == pytest.approx(30, rel=0.02)
    assert path.at(0.5)[12:].mean(axis=0) == pytest.approx([5 + 20 * 0.7071, 5, 20 * 0.7071], abs=0.6)


def test_a_tail_that_curls_by_more_than_half_a_turn_goes_round() -> None:
    heading = np.radians(np.concatenate([[0.0, 0.0], np.arange(1, 11) * 25.0]))  # the last piece by 250 degrees
    steps = 10 * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    end = np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)])
    start = np.stack([10.0 * np.arange(13), np.zeros(13)], axis=1)
    path = HandlePath(start, end)
    assert np.degrees(path.turns[-1, 2]) == pytest.approx(225, abs=20)
    half = path.at(0.5)
    assert np.linalg.norm(np.diff(half, axis=0), axis=1) == pytest.approx([10.0] * 12, rel=0.02)
    last = np.degrees(np.arctan2(*(half[-1] - half[-2])[::-1]))
    assert last == pytest.approx(125, abs=8)


def test_a_point_that_is_alone_goes_straight() -> None:
    start = np.array([[0, 0], [10, 0], [10, 10], [0, 10], [5, 5.0]])
    end = start.copy()
    end[4] = (30, 5)
    assert HandlePath(start, end).at(0.5)[4] == pytest.approx([17.5, 5], abs=0.15)


def test_both_ends_are_met_to_the_bit_and_what_is_held_goes_where_it_is_put() -> None:
    end = bent(90)
    path = HandlePath(LEG, end, held=np.arange(len(LEG)) == KNEE_AT)
    assert (path.at(0) == LEG).all()
    assert (path.at(1) == end).all()
    wanted = np.full_like(LEG, np.nan)
    wanted[KNEE_AT] = (48, 2)
    assert path.at(0.5)[KNEE_AT].tolist() == [48, 0]  # it does not move: no question
    moved = end.copy()
    moved[KNEE_AT] = (48, 4)
    path = HandlePath(LEG, moved, held=np.arange(len(LEG)) == KNEE_AT)
    places = path.at(0.5, wanted)
    assert places[KNEE_AT].tolist() == [48, 2]
    assert np.isfinite(places).all()


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_few_points_have_ways_too(count: int) -> None:
    start = np.array([[0.0, 0.0], [10.0, 0.0], [0.0, 0.0]])[:count]
    end = np.array([[1.0, 1.0], [1.0, 11.0], [1.0, 1.0]])[:count]
    places = HandlePath(start, end).at(0.5)
    assert places.shape == (count, 2)
    assert np.isfinite(places).all()
    if count > 1:
        assert np.linalg.norm(places[1] - places[0]) == pytest.approx(10)


def test_many_points_in_a_crowd_are_one_net() -> None:
    rng = np.random.default_rng(2)
    crowds = np.concatenate([rng.normal(centre, 1, (300, 3)) for centre in (0, 100, 500)])
    edges = neighbours(crowds)
    assert len(np.unique(edges)) == 900
    assert len(edges) < 900 * 12
    places = HandlePath(crowds, crowds + np.array([0, 0, 50])).at(0.5)
    np.testing.assert_allclose(places, crowds + np.array([0, 0, 25]), atol=1e-9)


def test_places_of_two_kinds_are_refused() -> None:
    with pytest.raises(DeformError, match=r"\(3, 2\) and \(2, 2\)"):
        HandlePath(np.zeros((3, 2)), np.zeros((2, 2)))

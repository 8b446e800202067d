"""Motions of rigid parts: a group, with one-parameter subgroups that run along screws."""

from __future__ import annotations

import math

import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from deformnb.errors import DeformError
from deformnb.rbf.rigid import RigidMotion

ANGLES = [0.0, 1e-9, 1e-5, 0.0057, 0.0058, 1.0, 30.0, 90.0, 179.999, -170.0]
PLACES = np.random.default_rng(0).uniform(-50, 50, (20, 3))


def motion(degrees: float, dim: int, seed: int = 1) -> RigidMotion:
    rng = np.random.default_rng(seed)
    about, shift, axis = rng.uniform(-40, 40, dim), rng.uniform(-9, 9, dim), rng.normal(size=3)
    return RigidMotion.turn(degrees, about, shift, axis if dim == 3 else None)


def after(second: RigidMotion, first: RigidMotion) -> RigidMotion:
    """The product of the two, by matrices."""
    m = np.asarray(second.matrix) @ np.asarray(first.matrix)
    t = np.asarray(second.matrix) @ np.asarray(first.shift) + np.asarray(second.shift)
    return RigidMotion(tuple(map(tuple, m.tolist())), tuple(t.tolist()))


def same(a: RigidMotion, b: RigidMotion, atol: float = 1e-10) -> None:
    oracle.assert_close(a(PLACES[:, : a.dim]), b(PLACES[:, : b.dim]), atol=atol)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("degrees", ANGLES)
def test_powers_are_a_one_parameter_group(degrees: float, dim: int) -> None:
    m = motion(degrees, dim)
    for s, t in ((0.5, 0.5), (0.3, 0.7), (2.0, -1.0), (-0.25, 1.25)):
        same(after(m.power(s), m.power(t)), m)
        same(after(m.power(s), m.power(t)), after(m.power(t), m.power(s)))
    same(m.power(-1.0), m.inverse)
    same(after(m, m.inverse), RigidMotion(tuple(map(tuple, np.eye(dim).tolist())), (0.0,) * dim))
    assert m.power(1) is m
    oracle.assert_close(m.power(0.0)(PLACES[:, :dim]), PLACES[:, :dim], atol=1e-12)
    same(m.power(2.0), after(m, m))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("degrees", ANGLES)
@pytest.mark.parametrize("t", [0.1, 0.75, -0.6])
def test_a_power_is_the_exponential_of_its_generator(degrees: float, dim: int, t: float) -> None:
    """exp(t log M) as a matrix of one dimension more, by another program; the log is known from how M was made."""
    rng = np.random.default_rng(1)
    about, shift, axis = rng.uniform(-40, 40, dim), rng.uniform(-9, 9, dim), rng.normal(size=3)
    angle, w = math.radians(degrees), np.array([0.0, 0, 1]) if dim == 2 else axis / np.linalg.norm(axis)
    k = angle * np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])[:dim, :dim]
    # Find v with exp([k v]) = M: v enters linearly, so three (two) exponentials give its matrix.
    columns = [expm(np.block([[k, e[:, None]], [np.zeros((1, dim + 1))]]))[:dim, dim] for e in np.eye(dim)]
    m = RigidMotion.turn(degrees, about, shift, axis if dim == 3 else None)
    v = np.linalg.solve(np.stack(columns, axis=1), m.shift)
    whole = expm(t * np.block([[k, v[:, None]], [np.zeros((1, dim + 1))]]))
    part = m.power(t)
    oracle.assert_close(part.matrix, whole[:dim, :dim], atol=1e-12)
    oracle.assert_close(part.shift, whole[:dim, dim], atol=1e-9)


@pytest.mark.parametrize("dim", [2, 3])
def test_a_pure_shift_runs_straight_and_a_turn_keeps_its_centre(dim: int) -> None:
    shift = np.arange(3.0, 3 + dim)
    still = RigidMotion.turn(0, np.zeros(dim), shift, [1, 0, 0] if dim == 3 else None)
    oracle.assert_close(still.power(0.3).shift, 0.3 * shift, atol=1e-15)
    centre = np.arange(1.0, dim + 1) * 7
    turn = RigidMotion.turn(77, centre, axis=[1, 2, 3] if dim == 3 else None)
    for t in (-1.0, 0.2, 0.9, 1.0):
        oracle.assert_close(turn.power(t)(centre), centre, atol=1e-12)


def test_half_a_turn_of_180_degrees_is_a_quarter() -> None:
    half = RigidMotion.turn(180, (3, 4))
    quarter = half.power(0.5)
    same(after(quarter, quarter), half)
    oracle.assert_close(np.abs(np.linalg.eigvals(np.asarray(quarter.matrix)).imag), 1.0, atol=1e-12)
    in_space = RigidMotion.turn(180, (3, 4, 5), axis=(1, -1, 2))
    same(after(in_space.power(0.5), in_space.power(0.5)), in_space)


def test_a_turn_is_clockwise_on_a_picture_and_right_handed_in_space() -> None:
    oracle.assert_close(RigidMotion.turn(90, (0, 0))([1, 0]), [0, 1], atol=1e-15)  # b points down
    oracle.assert_close(RigidMotion.turn(90, (0, 0, 0), axis=(0, 0, 9))([1, 0, 5]), [0, 1, 5], atol=1e-15)
    oracle.assert_close(RigidMotion.turn(90, (1, 0), (10, 0))([1, 0]), [11, 0], atol=1e-15)


@given(degrees=st.floats(-400, 400), a=st.floats(-1e3, 1e3), b=st.floats(-1e3, 1e3))
def test_distances_are_kept_and_the_way_back_leads_back(degrees: float, a: float, b: float) -> None:
    m = RigidMotion.turn(degrees, (a, b), (b, -a))
    p = PLACES[:, :2]
    before, now = (np.linalg.norm(np.diff(q, axis=0), axis=1) for q in (p, m(p)))
    oracle.assert_close(now, before, atol=1e-9)
    oracle.assert_close(m.inverse(m(p)), p, atol=1e-9)
    assert m(p.reshape(4, 5, 2)).shape == (4, 5, 2)


def rounded(m: RigidMotion) -> NDArray[np.float64]:
    return np.float64(np.float32(m.matrix))


@pytest.mark.parametrize("dim", [2, 3])
def test_a_matrix_of_seven_digits_is_taken_for_the_turn_it_was(dim: int) -> None:
    m = motion(33.0, dim)
    read = RigidMotion(tuple(map(tuple, rounded(m).tolist())), m.shift)
    oracle.assert_close(np.asarray(read.matrix) @ np.asarray(read.matrix).T, np.eye(dim), atol=1e-14)
    oracle.assert_close(read.matrix, m.matrix, atol=1e-7)
    far = np.full(dim, 4e6)
    oracle.assert_close(read.inverse(read(far)), far, atol=1e-6)
    assert RigidMotion(read.matrix, read.shift) == read


@pytest.mark.parametrize(
    ("matrix", "shift", "message"),
    [
        (((1, 0), (0, -1)), (0, 0), "mirror"),
        (((2, 0), (0, 2)), (0, 0), "stretch"),
        (((1, 0.1), (0, 1)), (0, 0), "shear"),
        (-np.eye(3), (0, 0, 0), "mirror"),
        (np.eye(3), (0, 0), "as many"),
        (np.eye(2), (0, math.nan), "finite"),
        (((math.inf, 0), (0, 1)), (0, 0), "finite"),
        ("abc", (0, 0), "2 x 2 or 3 x 3"),
        (np.eye(4), (0,) * 4, "2 x 2 or 3 x 3"),
        (np.eye(2), 3, "as many"),
        (((1, 0), (0,)), (0, 0), "2 x 2"),
    ],
)
def test_what_does_more_than_turn_is_refused(matrix: object, shift: object, message: str) -> None:
    with pytest.raises(DeformError, match=message):
        RigidMotion(matrix, shift)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("about", "axis"),
    [
        ((0, 0, 0), None),
        ((0, 0, 0), (0, 0, 0)),
        ((0, 0, 0), (1, 0)),
        ((0, 0, 0), (1, 0, math.nan)),
        ((0,), None),
        ("ab", None),
        ((0, 0, 0), "x"),
    ],
)
def test_a_turn_without_an_axis_is_refused(about: object, axis: object) -> None:
    with pytest.raises(DeformError, match="a turn is about a place"):
        RigidMotion.turn(10, about, axis=axis)  # type: ignore[arg-type]
    with pytest.raises(DeformError, match="finite"):
        RigidMotion.turn(math.nan, (0, 0))
    with pytest.raises(DeformError, match="finite numbers"):
        RigidMotion.turn(3, (0, 0), shift=(1, 2, 3))

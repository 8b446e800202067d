"""Sets of points that a plain fit gets wrong in silence: each row of the table, in the plane and in space."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import oracle
import pytest
from hypothesis import assume, event, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from deformnb.errors import DeformError
from deformnb.rbf.conditioning import MOST_POINTS, SAME_PLACE, box_diagonal, diameter
from deformnb.rbf.fitting import fit_one_system, fit_rbf
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.support import longest_support, usual_support
from deformnb.rbf.trends import THIN, TRENDS

ROW = np.array([0.0, 20, 45, 60, 100])


def linear_part(fit: RBFInterpolant) -> np.ndarray:
    return np.eye(fit.dim) + fit.polynomial.linear / fit.support


def turn(dim: int, degrees: float) -> np.ndarray:
    return Rotation.from_euler("z", degrees, degrees=True).as_matrix()[:dim, :dim]


def anywhere(dim: int, n: int = 30) -> np.ndarray:
    return np.random.default_rng(8).uniform(-50, 150, (n, dim))


def collinear_points(dim: int) -> np.ndarray:
    return ROW[:, None] * np.array([0.6, 0.8, 0.0])[:dim] + 7


# ---- few points ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("trend", TRENDS)
@pytest.mark.parametrize("all_off", [False, True])
def test_no_points_is_the_identity(dim: int, trend: str, all_off: bool) -> None:
    points = ControlPoints.empty(dim)
    if all_off:
        points = ControlPoints.from_arrays(np.zeros((3, dim)), np.ones((3, dim)), active=[False] * 3)
    fit = fit_rbf(points, trend=trend)
    assert (fit.displacement(anywhere(dim)) == 0).all()
    assert fit.dim == dim
    assert fit.ids == ()
    assert fit.notes == ()


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", ["wendland_c2", "linear", "thin_plate"])
@pytest.mark.parametrize("trend", [t for t in TRENDS if t != "none"])
def test_one_point_is_a_translation(dim: int, kernel: str, trend: str) -> None:
    if kernel == "thin_plate" and trend != "affine":
        return  # refused, see test_rbf
    fit = fit_rbf(ControlPoints.from_arrays([np.arange(dim) + 5.0], [np.arange(dim) * 2.0]), kernel=kernel, trend=trend)
    wanted = np.broadcast_to(5.0 - np.arange(dim), (30, dim))
    oracle.assert_close(fit.displacement(anywhere(dim)), wanted, atol=1e-12)
    assert not fit.notes or "one control point" in fit.notes[0]
    assert bool(fit.notes) == (trend != "translation")


@pytest.mark.parametrize("dim", [2, 3])
def test_one_point_without_trend_is_a_bump_of_a_given_reach(dim: int) -> None:
    point = ControlPoints.from_arrays([np.zeros(dim)], [np.full(dim, 4.0)], names=["nose"])
    fit = fit_rbf(point, trend="none", support=10.0)
    oracle.assert_close(fit.displacement(point.target), [np.full(dim, -4.0)], atol=1e-12)
    assert (fit.displacement(np.full((1, dim), 4 + 10.1)) == 0).all()
    with pytest.raises(DeformError, match=r'point 1 \("nose"\) is alone .* give a support radius'):
        fit_rbf(point, trend="none")
    own = fit_rbf(point.edit(0, radius=10.0), trend="none")  # it is self-explanatory
    oracle.assert_close(own.displacement([[7.0] * dim]), fit.displacement([[7.0] * dim]), atol=1e-12)


# ---- rows and planes -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [2, 5])
@pytest.mark.parametrize("degrees", [0.001, 30, 60, 90, 150, 180])
@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("trend", ["affine", "similarity", "rigid"])
def test_a_row_turned_by_any_angle_keeps_its_determinant(trend: str, dim: int, degrees: float, count: int) -> None:
    """The least-norm affine map has determinant 0.87, 0.50 and 0.00 at 30, 60 and 90 degrees."""
    x = collinear_points(dim)[:count]
    m = turn(dim, degrees)
    fit = fit_rbf(ControlPoints.from_arrays(x @ m.T + 3, x), trend=trend)
    assert np.linalg.det(linear_part(fit)) == pytest.approx(1.0, abs=1e-5)  # in space 1e-6 of the last turn is mixed in
    oracle.assert_close(fit.displacement(x), x @ m.T + 3 - x, atol=1e-9)
    if dim == 2:
        oracle.assert_close(linear_part(fit), m, atol=1e-9)
    assert any("on one line" in note for note in fit.notes) == (trend == "affine" or dim == 3)


@pytest.mark.parametrize("kernel", ["thin_plate", "cubic", "wendland_c2", "multiquadric"])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_stretched_row_stretches_the_space_and_stays_bounded(kernel: str, dim: int) -> None:
    x = collinear_points(dim)
    fit = fit_rbf(ControlPoints.from_arrays(1.5 * x, x), kernel=kernel, trend="affine")
    oracle.assert_close(linear_part(fit), 1.5 * np.eye(dim), atol=1e-9)
    d = np.random.default_rng(1).uniform(-12, 12, (5, dim))
    fit = fit_rbf(ControlPoints.from_arrays(x + d, x), kernel=kernel, trend="affine")
    oracle.assert_close(fit.displacement(x), d, atol=1e-9)
    assert np.abs(fit.displacement(anywhere(dim))).max() < 100  # other programs: 400 to 2800


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("kernel", ["thin_plate", "wendland_c2"])
def test_a_row_straight_but_for_rounding_is_a_row(kernel: str, dim: int) -> None:
    x = collinear_points(dim) + np.random.default_rng(0).normal(0, 1e-7, (5, dim))
    d = np.random.default_rng(1).normal(0, 5, (5, dim))
    fit = fit_rbf(ControlPoints.from_arrays(x + d, x), kernel=kernel, trend="affine")
    assert any("on one line" in note for note in fit.notes)
    assert np.linalg.norm(linear_part(fit), 2) < 3
    oracle.assert_close(fit.displacement(x), d, atol=1e-6)


def test_a_nearly_straight_row_that_makes_a_steep_trend_says_so() -> None:
    x = collinear_points(2) + np.random.default_rng(0).normal(0, 1e-3, (5, 2))
    d = np.random.default_rng(1).normal(0, 5, (5, 2))
    points = ControlPoints.from_arrays(x + d, x)
    settings: list[dict[str, Any]] = [{"trend": "affine_exact"}, {"kernel": "thin_plate"}]
    for options in settings:
        steep = fit_rbf(points, **options)
        assert np.linalg.norm(linear_part(steep), 2) > 10
        assert any("the trend similarity would not" in note for note in steep.remarks)
        assert any("across it nothing holds the affine trend" in note for note in steep.remarks)
    for trend in ("affine", "similarity"):
        calm = fit_rbf(points, trend=trend)
        assert np.linalg.norm(linear_part(calm), 2) < 3
        assert not any("stretches" in note for note in calm.remarks)


@pytest.mark.parametrize("kernel", ["wendland_c2", "cubic"])
@pytest.mark.parametrize("trend", ["affine", "similarity", "rigid"])
def test_coplanar_points_in_space_turn_with_their_plane(kernel: str, trend: str) -> None:
    if kernel == "cubic" and trend != "affine":
        return  # refused, see test_rbf
    rng = np.random.default_rng(2)
    plane = Rotation.from_rotvec([0.4, -1.0, 0.3]).as_matrix()
    x = np.c_[rng.uniform(0, 100, (6, 2)), np.zeros(6)] @ plane.T
    m = Rotation.from_rotvec([-1.1, 0.2, 0.9]).as_matrix()
    fit = fit_rbf(ControlPoints.from_arrays(x @ m.T, x), kernel=kernel, trend=trend)
    oracle.assert_close(linear_part(fit), m, atol=1e-8)  # a penalty of 1e7 across the plane costs digits
    assert any("in one plane" in note for note in fit.notes) == (trend == "affine")


# ---- one place -------------------------------------------------------------------------------------------------------

BASE = np.array([[0.0, 0, 10], [100, 0, 0], [0, 100, 5], [80, 70, 60], [30, 40, 90]])


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("apart", [0.0, 1e-9])
@pytest.mark.parametrize("kernel", ["wendland_c2", "thin_plate"])
def test_points_at_one_place_that_agree_are_one(dim: int, apart: float, kernel: str) -> None:
    source, target = BASE[:, :dim], BASE[:, :dim] + np.arange(dim) * 5
    target = target + np.random.default_rng(1).normal(0, 3, target.shape)
    plain = fit_rbf(ControlPoints.from_arrays(source, target), kernel=kernel)
    doubled = ControlPoints.from_arrays(
        np.r_[source, source[[1]] + apart],
        np.r_[target, target[[1]] + apart],
        ids=[3, 8, 4, 11, 2, 9],
        names=["", "nose", "", "", "", ""],
    )
    fit = fit_rbf(doubled, kernel=kernel, support=plain.support)
    assert fit.count == 5
    assert fit.ids == (3, 8, 4, 11, 2)
    assert 'point 2 ("nose"), point 6 are at one place and count as one' in fit.notes
    oracle.assert_close(fit.displacement(anywhere(dim)), plain.displacement(anywhere(dim)), atol=1e-8)


@pytest.mark.parametrize("dim", [2, 3])
def test_points_at_one_place_that_disagree_are_both_named(dim: int) -> None:
    points = ControlPoints.from_arrays(
        np.r_[BASE, BASE[[1]] + 2][:, :dim],
        np.r_[BASE, BASE[[1]]][:, :dim],
        ids=[3, 8, 4, 11, 2, 9],
        names=["", "nose", "", "", "", "tip"],
    )
    with pytest.raises(DeformError) as error:
        fit_rbf(points)
    for part in ('point 2 ("nose")', 'point 6 ("tip")', "(100, 0", "(0, 0", "(2, 2", "smoothing on"):
        assert part in str(error.value)
    again = fit_rbf(points.edit(9, active=False))  # the advice works
    assert again.ids == (3, 8, 4, 11, 2)


def test_smoothing_takes_the_weighted_mean_of_points_at_one_place() -> None:
    source, target, weight = BASE[:, :2] + [[4, 0]], BASE[:, :2], np.array([1.0, 3, 1, 1, 1])
    both = ControlPoints.from_arrays(
        np.r_[source, source[[1]] + 8], np.r_[target, target[[1]]], weight=np.r_[weight, 1.0]
    )
    mean = source.copy()
    mean[1] += 8 * 1 / 4
    merged = ControlPoints.from_arrays(mean, target, weight=[1, 4, 1, 1, 1])
    a, b = (fit_rbf(p, smoothing=0.5, support=90.0) for p in (both, merged))
    oracle.assert_close(a.displacement(anywhere(2)), b.displacement(anywhere(2)), atol=1e-11)


@pytest.mark.parametrize("gap", [1.0, 0.1, 0.01])
def test_near_points_that_pull_apart_are_noted_and_near_points_that_agree_are_not(gap: float) -> None:
    """The ripple grows as 0.105 R |difference| / gap."""
    x = np.array([[0.0, 0], [gap, 0], [200, 0], [0, 200]])
    apart = ControlPoints.from_arrays(x, x, ids=[5, 3, 7, 1]).edit(5, source=[2.0, 0.0])
    fit = fit_rbf(apart, support=100.0, trend="none")
    assert [n for n in fit.notes if "points 1 and 2 are pulled past each other" in n]
    oracle.assert_close(fit.displacement(x), apart.displacement, atol=1e-8)
    line = np.c_[np.linspace(-100, 100, 4001), np.zeros(4001)]
    assert np.abs(fit.displacement(line)).max() == pytest.approx(0.105 * 100 * 2 / gap, rel=0.12)
    agree = ControlPoints.from_arrays(x + 2.0, x)
    assert fit_rbf(agree, support=100.0, trend="none").notes == ()


@pytest.mark.parametrize("trend", ["affine", "similarity", "none"])
@pytest.mark.parametrize("gap", [1.0, 0.3, 0.1])
def test_points_piled_on_one_place_are_named_and_not_those_that_suffer_from_it(trend: str, gap: float) -> None:
    """Such a pair bends the affine trend until other points seem to cross as well."""
    corners = [[0.0, 0.0], [500, 0], [500, 195], [0, 195]]
    piled = ControlPoints.from_arrays(
        [*corners, [145, 98], [254, 98], [361, 98]], [*corners, [254 + gap, 98], [254, 98], [361, 98]]
    )
    notes = [note for note in fit_rbf(piled, trend=trend).remarks if "pulled past" in note]
    assert notes == ["control points 5 and 6 are pulled past each other: the map folds there"]
    two = ControlPoints.from_arrays([[0, 0], [100, 0], [0, 900], [100, 900]], [[100, 0], [0, 0], [100, 900], [0, 900]])
    assert len(fit_rbf(two, trend="translation").remarks) == 2  # two pairs that are as bad as each other are both named


def test_a_turn_is_no_crossing() -> None:
    x = BASE[:, :2]
    for trend in ("affine", "similarity", "rigid"):
        assert fit_rbf(ControlPoints.from_arrays(x @ turn(2, 170).T, x), trend=trend).notes == ()


# ---- numbers that are none -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, 1.1e15])
@pytest.mark.parametrize("what", ["source", "target"])
def test_coordinates_that_are_not_finite_name_the_point_before_any_solve(value: float, what: str) -> None:
    arrays = {"source": BASE.copy(), "target": BASE + 1}
    arrays[what][3, 1] = value
    with pytest.raises(DeformError, match=rf'the {what} of point 4 \("tail"\) is .*must be finite'):
        ControlPoints.from_arrays(**arrays, ids=[11, 12, 13, 14, 15], names=["", "", "", "tail", ""])


@pytest.mark.parametrize("support", [0.0, -3.0, np.nan, np.inf])
@pytest.mark.parametrize("trend", ["affine", "none"])
def test_a_support_that_is_no_length_is_refused(support: float, trend: str) -> None:
    with pytest.raises(DeformError, match="support radius must be a positive length"):
        fit_rbf(ControlPoints.from_arrays(BASE, BASE + 1), support=support, trend=trend)


def test_more_points_than_a_fit_can_take_are_refused_at_once() -> None:
    x = np.random.default_rng(0).uniform(0, 100, (MOST_POINTS + 1, 2))
    points = ControlPoints.from_arrays(x, x + 1)
    with pytest.raises(DeformError, match="20001 control points are more than the 20000"):
        fit_rbf(points)
    with pytest.raises(DeformError, match="20001 control points are more than the 2000 whose"):
        fit_one_system(points)


@pytest.mark.allow_nan
@pytest.mark.parametrize("kernel", ["gaussian", "wendland_c4", "multiquadric"])
def test_a_kernel_far_too_flat_is_refused_with_the_nearest_pair(kernel: str) -> None:
    x = np.random.default_rng(0).uniform(0, 1, (25, 2))
    points = ControlPoints.from_arrays(x, x + np.random.default_rng(1).normal(0, 0.1, x.shape))
    near = np.linalg.norm(points.target[:, None] - points.target[None], axis=-1) + 9 * np.eye(25)
    i, j = np.unravel_index(near.argmin(), near.shape)
    with pytest.raises(DeformError, match="is too flat for these 25 control points") as error:
        fit_rbf(points, kernel=kernel, support=5000.0)
    assert f"point {i + 1} and point {j + 1}" in str(error.value)


# ---- the default support ---------------------------------------------------------------------------------------------


def test_the_box_diagonal_is_the_diagonal_of_the_sources_and_stays_during_a_drag() -> None:
    points = ControlPoints.from_arrays([[0, 0], [30, 10], [5, 40]])
    assert box_diagonal(points) == 50.0
    assert fit_rbf(points.move(1, [900.0, -900.0])).support == pytest.approx(np.hypot(5, 40))  # the diameter
    assert box_diagonal(points.edit(2, active=False)) == pytest.approx(np.hypot(30, 10))
    assert box_diagonal(ControlPoints.empty(2)) is None
    assert box_diagonal(points.take([0])) is None


@pytest.mark.parametrize("noise", [0.0, 1e-12])
def test_sources_at_one_place_leave_the_support_to_the_targets(noise: float) -> None:
    source = 3.3 + noise * np.array([[0, 0], [1, 0], [0, 1]])
    points = ControlPoints.from_arrays(source, [[0, 0], [30, 10], [5, 40]])
    assert box_diagonal(points) == 50.0
    assert any("nearly coincide" in n for n in fit_rbf(points, trend="similarity").notes)


# ---- never a wrong result in silence ---------------------------------------------------------------------------------

PLACES = st.integers(0, 4)
NUDGES = st.sampled_from([0.0, 0.0, 0.0, 1e-9, 1e-7, 2e-6, 1e-4, 1e-2])


@st.composite
def nasty_sets(draw: Any) -> ControlPoints:
    """Few places of a lattice, so that rows, planes and equal places are common; nudged by anything; anywhere."""
    dim = draw(st.sampled_from([2, 3]))
    n = draw(st.integers(0, 8))
    scale = draw(st.sampled_from([1e-6, 1.0, 1e5]))
    offset = draw(st.sampled_from([0.0, 1e3, -1e8]))
    place = st.tuples(*[PLACES] * dim)
    target = [[v + draw(NUDGES) for v in draw(place)] for _ in range(n)]
    if draw(st.booleans()):
        source = [[v + draw(NUDGES) for v in draw(place)] for _ in range(n)]
    else:
        source = [[v + (k == 0) for v in p] for k, p in enumerate(target)]
    source, target = (np.array(a, dtype=float).reshape(-1, dim) * scale + offset * scale for a in (source, target))
    active = [draw(st.sampled_from([True, True, False])) for _ in range(n)]
    return ControlPoints.from_arrays(source, target, active=active)


@pytest.mark.allow_nan
@settings(max_examples=2 * settings().max_examples)
@given(
    points=nasty_sets(),
    pairing=st.sampled_from([("wendland_c2", t) for t in TRENDS] + [("thin_plate", "affine")]),
    support=st.sampled_from([None, 0.5, 5.0, 50.0]),
)
def test_any_set_gives_a_finite_field_that_interpolates_or_an_error(
    points: ControlPoints, pairing: tuple[str, str], support: float | None
) -> None:
    kernel, trend = pairing
    both = np.r_[points.source, points.target]
    extent = float(np.ptp(both, axis=0).max()) if len(both) else 0.0
    extent = extent or 1.0
    try:
        fit = fit_rbf(points, kernel=kernel, trend=trend, support=support and support * extent)
    except DeformError as error:
        event("refused")
        assert str(error).endswith(".")  # noqa: PT017 (which of the two comes is not known beforehand)
        return
    active = [k for k in range(len(points)) if points.active[k]]
    assert set(fit.ids) <= {points.ids[k] for k in active}
    centre = points.target[active].mean(axis=0) if active else np.zeros(points.dim)
    x = centre + extent * np.random.default_rng(0).uniform(-2, 2, (10, points.dim))
    assert np.isfinite(fit.displacement(x)).all()
    assert np.isfinite(fit.lattice_values(x.T, np.zeros((points.dim, 2)), extent / 100)).all()
    used = [points.index(i) for i in fit.ids]
    places = np.asarray(fit.origin) + fit.support * np.asarray(fit.centers)[: len(used)]
    off = np.abs(places - points.target[used]).max(initial=0.0)
    assert off <= 8 * SAME_PLACE * fit.support  # merged points are that near one another, no other point is moved
    miss = np.abs(fit.displacement(places) - points.displacement[used]).max(initial=0.0)
    spacing = np.spacing(np.abs(points.target).max(initial=1.0))  # places at an offset are known no better
    slope = np.abs(np.asarray(fit.coefficients)).max() / fit.support * 10
    assert miss <= 1e-6 * extent + 1e-9 * fit.support + spacing * slope


def test_every_kernel_survives_the_closest_points_it_lets_in() -> None:
    for kernel, kind in KERNELS.items():
        trend = ["none", "translation", "affine", "quadratic"][kind.order]
        x = np.r_[BASE[:, :2], BASE[:1, :2] + [3 * SAME_PLACE * 120, 0]]
        try:
            points = ControlPoints.from_arrays(x + 4 * (x[:, :1] > 50), x)
            fit = fit_rbf(points, kernel=kernel, trend=trend, support=120.0)
        except DeformError as error:
            assert "point 1 and point 6" in str(error)  # noqa: PT017 (some kernels can)
        else:
            oracle.assert_close(fit.displacement(x), 4 * np.repeat(x[:, :1] > 50, 2, axis=1), atol=1e-5)


def test_sources_on_one_line_whose_targets_are_not_press_everything_flat_and_say_so() -> None:
    points = ControlPoints.from_arrays([[0, 0], [3, 0], [6, 0], [9, 0]], [[0, 0], [4, 0], [6, 0], [9, 1]])
    assert any("presses everything flat" in note for note in fit_rbf(points, trend="affine_exact").notes)
    assert not any("flat" in note for note in fit_rbf(points).notes)
    assert not any("flat" in note for note in fit_rbf(points, trend="similarity").notes)
    assert not any("flat" in note for note in fit_rbf(points.reset()).notes)


# ---- points nearly on one line, or in one plane ----------------------------------------------------------------------

ROW_LENGTH, DRAG = 100.0, 10.0


def nearly_straight(count: int, off: float, dim: int) -> list[np.ndarray]:
    """Rows along the first axis, some of whose points are off it by up to ``off``."""
    x = np.zeros((count, dim))
    x[:, 0] = np.linspace(0, ROW_LENGTH, count)
    one, zigzag, strewn = x.copy(), x.copy(), x.copy()
    one[count // 2, 1] += off
    zigzag[:, 1] += off / 2 * (-1.0) ** np.arange(count)
    strewn[:, 1:] += off * np.random.default_rng(count).uniform(-1, 1, (count, dim - 1))
    return [one, zigzag, strewn] if off else [x]


def points_near_line(dim: int) -> np.ndarray:
    """Places at half the row's length from it."""
    along = np.linspace(0, ROW_LENGTH, 11)
    angles = [0, np.pi] if dim == 2 else np.linspace(0, 2 * np.pi, 6, endpoint=False)
    across = np.array([[np.cos(a), np.sin(a)] for a in angles])[:, : dim - 1] * ROW_LENGTH / 2
    return np.array([[u, *v] for u in along for v in across])


def supports_chosen(points: ControlPoints, kernel: str) -> list[float]:
    """Every support that the default may choose."""
    kind, size = KERNELS[kernel], diameter(points)
    assert size is not None
    limit = longest_support(points, kind)
    return sorted({*(share * size for share in kind.shares if share * size <= limit), usual_support(points, kind)})


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("count", [3, 5, 9, 33])
@pytest.mark.parametrize("kernel", [name for name, kind in KERNELS.items() if kind.order == 0])
def test_a_point_dragged_in_a_row_leaves_what_lies_beside_the_row_in_place(kernel: str, count: int, dim: int) -> None:
    """A row of 100 mm whose middle is 2 mm off, dragged by 10 mm, moved places 50 mm next to it by 42 mm."""
    places, drags = points_near_line(dim), DRAG * np.eye(dim)[:2]
    for source in [s for off in (0.0, 0.1, 1.0, 2.0) for s in nearly_straight(count, off, dim)]:
        for moved, drag in itertools.product({0, count // 2}, [*drags, *-drags]):
            target = source.copy()
            target[moved] += drag
            points = ControlPoints.from_arrays(source, target)
            for support in supports_chosen(points, kernel):
                fit = fit_rbf(points, kernel=kernel, support=support)
                assert np.linalg.norm(fit.displacement(places), axis=1).max() <= 2 * DRAG
                assert np.linalg.det(np.eye(dim) + fit.jacobian(places)).min() > 0.3
                assert any("nearly on one line" in note for note in fit.remarks)


@pytest.mark.parametrize("dim", [2, 3])
def test_the_note_on_a_row_is_the_same_in_every_direction(dim: int) -> None:
    along = np.array([np.cos(0.5), np.sin(0.5), 0.0])[:dim]
    source = np.outer(np.arange(5.0), along) * 10
    fit = fit_rbf(ControlPoints.from_arrays(source, source + np.eye(dim)[0] * [[0], [0], [1], [0], [0]]))
    assert any("nearly on one line: across it" in note for note in fit.remarks)


def test_the_note_on_a_flat_set_says_that_it_is_flat() -> None:
    source = np.random.default_rng(1).uniform(0, 100, (9, 3)) * [1, 0.02, 1]
    fit = fit_rbf(ControlPoints.from_arrays(source, source + np.random.default_rng(2).normal(0, 2, (9, 3))))
    assert any("in one plane: across it" in note for note in fit.remarks)


def test_the_map_does_not_jump_while_a_point_is_dragged_across_the_line() -> None:
    """Steps of 1/100 of the row: the map next to it changes by little more than the drag, through s = 0 as well."""
    source = np.array([[0.0, 0], [50, 20], [100, 0]])
    places, heights = points_near_line(2), np.linspace(60, -60, 241)
    maps = [
        fit_rbf(ControlPoints.from_arrays(source, [[0, 0], [50, h], [100, 0]]), support=50.0).displacement(places)
        for h in heights
    ]
    change = np.linalg.norm(np.diff(maps, axis=0), axis=-1).max()
    finer = [
        fit_rbf(ControlPoints.from_arrays(source, [[0, 0], [50, h], [100, 0]]), support=50.0).displacement(places)
        for h in np.linspace(1, -1, 41)
    ]
    assert np.linalg.norm(np.diff(finer, axis=0), axis=-1).max() < change / 5  # a tenth of the displacement: no jump


@pytest.mark.parametrize("kernel", ["wendland_c2", "gaussian", "multiquadric"])
@pytest.mark.parametrize("dim", [2, 3])
def test_sets_a_quarter_as_wide_as_long_keep_the_affine_trend_bit_for_bit(kernel: str, dim: int) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        x = rng.normal(0, 1, (12, dim))
        u, sigma, vt = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)
        source = 50 * u @ np.diag(np.maximum(sigma, 0.3 * sigma[0])) @ vt + 7
        points = ControlPoints.from_arrays(source + rng.normal(0, 0.5, source.shape), source)
        plain = fit_rbf(points, kernel=kernel, support=60.0, trend="affine_exact")
        fit = fit_rbf(points, kernel=kernel, support=60.0)
        assert (fit.coefficients == plain.coefficients).all()
        assert (fit.polynomial.linear == plain.polynomial.linear).all()
        assert (fit.polynomial.constant == plain.polynomial.constant).all()


@given(st.integers(2, 3), st.integers(0, 10**6), st.floats(0.001, 0.24))
def test_the_trend_across_a_thin_direction_lies_between_similarity_and_affine(dim: int, seed: int, thin: float) -> None:
    """Maps that are similarities of all points stay what they are, however thin the set, unless it is a row in space:
    the turn about that is held.
    """
    rng = np.random.default_rng(seed)
    x = rng.uniform(-50, 50, (8, dim)) * ([1.0] * (dim - 1) + [thin])
    spreads = np.linalg.svd(x - x.mean(axis=0), compute_uv=False)
    assume(dim == 2 or spreads[1] >= THIN * spreads[0])
    m = 1.2 * turn(dim, rng.uniform(-170, 170))
    fit = fit_rbf(ControlPoints.from_arrays(x @ m.T + 3, x), support=60.0)
    oracle.assert_close(linear_part(fit), m, atol=1e-7)


def test_points_of_one_source_that_are_dragged_apart_are_named() -> None:
    points = ControlPoints.from_arrays(
        [[0, 0], [100, 0], [0, 100], [50, 50], [50, 50]], [[0, 0], [100, 0], [0, 100], [40, 50], [60, 50]]
    )
    notes = fit_rbf(points).notes
    assert "control points 4 and 5 share a source and have different targets: the map folds between them" in notes


@pytest.mark.parametrize("kernel", ["wendland_c0", "wendland_c2", "wendland_c4"])
def test_a_support_far_beyond_the_points_keeps_them_apart(kernel: str) -> None:
    """1e6 times the gaps merged distinct points, with a note that they were at one place."""
    source = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1], [0.4, 0.6]])
    points = ControlPoints.from_arrays(source, source + np.array([[0, 0], [0, 0], [0.1, 0], [0, 0], [0, 0.1]]))
    fit = fit_rbf(points, kernel=kernel, support=1e6)
    assert fit.count == 5
    assert any("limited to 100 times the largest distance" in note for note in fit.remarks)
    assert not any("one place" in note for note in fit.remarks)
    oracle.assert_close(fit.displacement(points.target), points.displacement, atol=1e-7)

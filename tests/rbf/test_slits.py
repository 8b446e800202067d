"""Cuts that stop inside the body: interpolation, no jump beyond a tip, and the same map in NumPy and JAX."""

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from deformnb._jax import float64
from deformnb.errors import DeformError
from deformnb.rbf.cuts import sides_of
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line

CORNERS = [[-80, -80], [80, -80], [80, 80], [-80, 80]]
SLIT = Line([(-30, 5), (0, 0), (30, 5)], stops=(True, True))
OTHER = Line([(-50, 40), (40, 52)], stops=(False, True))
BORDER = Line([(-60, -40), (60, -45)])


def open_slit_points(step: float = 6.0) -> ControlPoints:
    """Both sides of the slit pulled apart between fixed corners."""
    return ControlPoints.from_arrays([*CORNERS, [0, -12], [0, 14]], [*CORNERS, [1, -12 - step], [0, 14 + step]])


@given(
    st.lists(
        st.tuples(st.floats(-70, 70), st.floats(-70, 70), st.floats(-4, 4), st.floats(-4, 4)), min_size=1, max_size=6
    ),
    st.sampled_from([(SLIT,), (SLIT, OTHER, BORDER)]),
)
@settings(max_examples=10, deadline=None)
def test_every_point_is_interpolated(rows: list[tuple[float, ...]], cuts: tuple[Line, ...]) -> None:
    source = np.array([r[:2] for r in rows])
    apart = [k for k in range(len(rows)) if all(np.linalg.norm(source[k] - source[j]) > 5 for j in range(k))]
    points = ControlPoints.from_arrays(source[apart], source[apart] + np.array([r[2:] for r in rows])[apart])
    found = FitSettings(support=60.0).fits(points, cuts=cuts)
    for one, own in zip(points.source, sides_of(cuts, points.source).tolist(), strict=True):
        at = points.target[(points.source == one).all(axis=1)]
        np.testing.assert_allclose(at + found[tuple(own)].displacement(at), one[None], atol=1e-6)


@given(st.floats(0, 60), st.sampled_from(["source", "jacobian"]))
@settings(max_examples=10, deadline=None)
def test_nothing_jumps_beyond_a_tip_and_all_is_seen_there(way: float, what: str) -> None:
    field = FitSettings().fit(open_slit_points(), cuts=(SLIT,), softness=1.0)
    first, second = field.fields
    x = np.array([[30 + way, 5 + way / 6]])  # of the tissue; where is it after the drags?
    y = x - first.displacement(x)
    for _ in range(60):
        y = x - first.displacement(y)
    if what == "source":
        np.testing.assert_allclose(first.displacement(y), second.displacement(y), atol=1e-9)
        assert field.opacity(y) == 1
    else:
        np.testing.assert_allclose(first.jacobian(y), second.jacobian(y), atol=1e-9)


def test_a_slit_opens_between_its_tips_and_shuts_towards_them() -> None:
    """Tissue on both sides of the line separates: far in the middle, less and less towards each tip, evenly."""
    field = FitSettings().fit(open_slit_points(), cuts=(SLIT,), softness=0.5)
    left, right = field.fields
    along = np.linspace(0, 1, 13)
    x = np.stack([30 * along, 5 * along], axis=-1)
    jump = np.linalg.norm(left.displacement(x) - right.displacement(x), axis=-1)
    assert jump[0] > 10
    assert (np.diff(jump) < 0).all()
    assert jump[-1] < 1e-3 * jump[0]
    assert field.opacity([[0.0, 0.0]]) == 0
    assert (field.opacity([[-45.0, 7.5], [45.0, 7.5]]) == 1).all()
    assert SLIT.opening([[0.0, 0.0]]) > 0.95


def test_all_ways_to_evaluate_agree() -> None:
    """NumPy and JAX, at points and on lattices; the slope with differences."""
    field = FitSettings().fit(open_slit_points(), cuts=(SLIT, OTHER), softness=1.0)
    alone = FitSettings().fit(open_slit_points(), cuts=(SLIT,), softness=1.0)
    rows, columns = np.array([[0.0] * 5, np.linspace(-70, 70, 5)]), np.array([np.linspace(-70, 70, 6), [0.0] * 6])
    x = np.moveaxis(rows[:, :, None] + columns[:, None, :], 0, -1)
    for one in (field.fields[1], alone.fields[0]):
        d = one.displacement(x)
        if one is alone.fields[0]:  # the others would be compiled too
            with float64():
                np.testing.assert_allclose(np.asarray(one(jnp.asarray(x))), d, atol=1e-9)
        np.testing.assert_allclose(np.moveaxis(one.lattice_values(rows, columns, 1.0), 0, -1), d, atol=2e-4)
        slope = one.jacobian(x)
        beside = [(one.displacement(x + h) - one.displacement(x - h)) / 2e-4 for h in 1e-4 * np.eye(2)]
        np.testing.assert_allclose(slope, np.stack(beside, axis=-1), atol=1e-6)
        np.testing.assert_allclose(
            one.lattice_jacobians(rows, columns), np.moveaxis(slope, (-2, -1), (0, 1)), atol=1e-5
        )


def test_other_cuts_stay_open_beyond_the_tip_of_one() -> None:
    """Multilinear: where one slit has ended, the map still jumps along the others as it does without it."""
    points = ControlPoints.from_arrays([*CORNERS, [60, -30], [60, -60]], [*CORNERS, [60, -25], [60, -66]])
    both = FitSettings().fit(points, cuts=(SLIT, BORDER), softness=1.0)
    alone = FitSettings().fit(points, cuts=(BORDER,), softness=1.0)
    x = np.stack([np.full(40, 62.0), np.linspace(-79, 79, 40)], axis=-1)
    np.testing.assert_allclose(both.displacement(x), alone.displacement(x), atol=1e-9)
    assert both.opacity([[60.0, -45.0]]) == 0


def test_a_side_without_points_follows_at_the_tip_only() -> None:
    points = ControlPoints.from_arrays([[0, 20]], [[0, 26]])
    field = FitSettings(support=40.0).fit(points, cuts=(Line([(-20, 0), (20, 0)], stops=(False, True)),), softness=1.0)
    away, beyond = field.displacement([[-10.0, -5.0], [40.0, -5.0]])
    assert np.abs(away).max() == 0
    assert abs(beyond[1]) > 1


def test_what_cannot_stop_is_refused() -> None:
    slits = [Line([(-30, 10 * k), (30, 10 * k)], stops=(True, True)) for k in range(4)]
    with pytest.raises(DeformError, match="at most 3 cuts"):
        FitSettings().fit(open_slit_points(), cuts=slits)
    with pytest.raises(DeformError, match='use the rule "source"'):
        FitSettings().fit(open_slit_points(), cuts=[SLIT], cut_rule="paper")
    with pytest.raises(DeformError, match="True and False"):
        Line([(0, 0), (1, 1)], stops=(True,))  # type: ignore[arg-type]
    assert not FitSettings().fits(ControlPoints.empty(2), cuts=[SLIT])

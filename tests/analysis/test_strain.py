"""Stretches of tissue against closed forms, and laws that hold for any map."""

from __future__ import annotations

import numpy as np
import oracle
import pytest
from analysis.test_folds import one_drag
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from warping.test_inverse import RASTER, dragged, linear, turned

from deformnb.analysis.folds import jacobian_determinant
from deformnb.analysis.strain import stretches
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import extrude, replicate
from deformnb.rbf.fields import Identity
from deformnb.rbf.fitting import fit_rbf
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid
from deformnb.warping.points import warp_points

AT = np.array([[10.0, 20.0], [70.0, 30.0]])


def along(direction: NDArray[np.float64], wanted: list[float]) -> None:
    """Directions have no sign."""
    oracle.assert_close(np.abs(direction @ np.asarray(wanted)), np.linalg.norm(wanted), atol=1e-9)


@pytest.mark.parametrize(
    ("m", "principal", "first"),
    [
        (np.diag([2.0, 1.0]), [2.0, 1.0], [1.0, 0.0]),  # stretched along a
        (np.diag([0.5, 3.0]), [3.0, 0.5], [0.0, 1.0]),
        (
            turned(30) @ np.diag([2.0, 0.5]),
            [2.0, 0.5],
            [np.cos(np.pi / 6), 0.5],
        ),  # stretched, then rotated: in the result
        (np.diag([2.0, 0.5]) @ turned(30), [2.0, 0.5], [1.0, 0.0]),
        # Simple shear by g: stretches (sqrt(g^2 + 4) +- g) / 2, along the axes of F F^T; for g = 1.5: 2 and 1/2.
        (np.array([[1.0, 1.5], [0.0, 1.0]]), [2.0, 0.5], [2.0, 1.0]),
    ],
)
def test_pure_stretch_and_shear(m: NDArray[np.float64], principal: list[float], first: list[float]) -> None:
    found = stretches(linear(m, [5.0, 6.0], np.array([40.0, 50.0])), AT)
    oracle.assert_close(found.area, np.full(2, np.linalg.det(m)), rtol=1e-10)
    oracle.assert_close(found.principal, np.broadcast_to(principal, (2, 2)), rtol=1e-9)
    along(found.directions[:, 0], first)
    along(found.directions[:, 1], [-first[1], first[0]])


def test_a_turn_stretches_nothing() -> None:
    for degrees in (0.0, 45.0, 90.0, 180.0, -170.0):
        found = stretches(linear(turned(degrees), [0.0, 3.0], np.array([40.0, 50.0])), AT)
        oracle.assert_close(found.principal, 1.0, atol=1e-10)
        oracle.assert_close(found.area, 1.0, atol=1e-10)


def test_in_space() -> None:
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    found = stretches(linear(turn @ np.diag([3.0, 1.5, 0.25]), [1.0, 2, 3], np.zeros(3)), [5.0, 6.0, 7.0])
    assert found.area == pytest.approx(3 * 1.5 * 0.25)
    oracle.assert_close(found.principal, [3.0, 1.5, 0.25], rtol=1e-9)
    oracle.assert_close(np.abs(found.directions @ turn), np.eye(3), atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([2, 3]), st.floats(0.1, 10))
def test_laws(seed: int, dim: int, size: float) -> None:
    field = fit_rbf(dragged(seed, size, dim=dim), support=80.0)
    x = np.random.default_rng(seed).uniform(0, 100, (4, 5, dim))
    found = stretches(field, x)
    assert (found.area.shape, found.principal.shape, found.directions.shape) == ((4, 5), (4, 5, dim), (4, 5, dim, dim))
    det = jacobian_determinant(field, x)
    assert (np.isnan(found.area) == (det <= 0)).all()
    whole = det > 0
    oracle.assert_close(found.area[whole], 1 / det[whole], rtol=1e-9)
    oracle.assert_close(found.principal[whole].prod(axis=-1), found.area[whole], rtol=1e-9)
    assert (np.diff(found.principal[whole], axis=-1) <= 0).all()
    u = found.directions[whole]
    oracle.assert_close(u @ np.swapaxes(u, 1, 2), np.broadcast_to(np.eye(dim), u.shape), atol=1e-12)
    forward = np.linalg.inv(np.eye(dim) + field.jacobian(x[whole]))
    # F F^T = U diag(s^2) U^T
    spread = np.swapaxes(u, 1, 2) @ (found.principal[whole][..., None] ** 2 * u)
    wanted = forward @ np.swapaxes(forward, 1, 2)
    oracle.assert_close(spread, wanted, atol=1e-9 * np.abs(wanted).max(initial=1.0))


def test_a_small_circle_becomes_the_ellipse_that_is_told() -> None:
    """Points of tissue around a place, followed forward: their farthest and nearest are along the axes."""
    field = fit_rbf(dragged(4, 4.0), support=70.0)
    centre = np.array([45.0, 52.0])
    place, reached = warp_points(centre, field, tolerance=1e-12)
    assert reached
    h, angle = 1e-3, np.linspace(0, 2 * np.pi, 720, endpoint=False)
    circle, _ = warp_points(centre + h * np.stack([np.cos(angle), np.sin(angle)], axis=-1), field, tolerance=1e-12)
    away = (circle - place) / h
    length = np.linalg.norm(away, axis=1)
    found = stretches(field, place)
    oracle.assert_close([length.max(), length.min()], found.principal, rtol=1e-3)
    assert np.abs(away[length.argmax()] @ found.directions[0]) == pytest.approx(length.max(), rel=1e-3)


def test_folded_places_are_not_numbers() -> None:
    field = one_drag(40.0, 40.0)  # twice as far as is good
    det = jacobian_determinant(field, RASTER.points())
    found = stretches(field, RASTER.points())
    assert (det <= 0).any()
    for values in (found.area[..., None], found.principal, found.directions.reshape(*RASTER.shape, -1)):
        assert (np.isnan(values).all(axis=-1) == (det <= 0)).all()
        assert (np.isnan(values).any(axis=-1) == (det <= 0)).all()


def test_a_replication_stretches_nothing_along_its_depth() -> None:
    grid = Grid((8, 9, 10), (10.0,) * 3)
    plane = Plane.from_view(grid, "+z")
    flat = fit_rbf(dragged(4, 4.0), support=70.0)
    x = np.array([33.0, 41.0, 50.0])
    there, here = stretches(extrude(plane, grid, [flat], replicate()), x), stretches(flat, plane.to_plane(x)[:2])
    assert there.area == pytest.approx(float(here.area))
    oracle.assert_close(there.principal, sorted([*here.principal, 1.0], reverse=True), rtol=1e-9)


def test_of_no_points_and_of_wrong_ones() -> None:
    found = stretches(Identity(3), np.zeros((0, 3)))
    assert (found.area.shape, found.principal.shape, found.directions.shape) == ((0,), (0, 3), (0, 3, 3))
    with pytest.raises(DeformError, match="3 coordinates"):
        stretches(Identity(3), [[1.0, 2.0]])

"""Determinants against closed forms, differences and SimpleITK's; folds where they must be; how far is safe."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import oracle
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from rbf.test_cuts import CUTS, MIDDLE, fitted, pushed, scattered
from rbf.test_rigid_parts import BOX, TURN, WALL, points, within
from warping.test_inverse import GRID, RASTER, RULES, TILTED, dragged, linear, nodes, turned
from warping.test_warper import Wave

from deformnb.analysis.folds import Folds, find_folds, jacobian_determinant, largest_safe_share
from deformnb.errors import Cancelled, DeformError
from deformnb.rbf.cuts import CUT_RULES, Decoupled
from deformnb.rbf.extrusion import extrude, modulate, replicate
from deformnb.rbf.fields import AbstractField, Blended, DisplacementField, Identity, compose
from deformnb.rbf.fitting import fit_rbf, fit_rigid
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid

SINGLE = 1e-5
"""Float32 derivatives of the size of 1, and sums of two or six products of them."""


def determinants_at(field: AbstractField, x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.linalg.det(np.eye(field.dim) + field.jacobian(x))


# ---- closed forms ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("m", [turned(30), turned(180) * 2, np.diag([3.0, 0.2]), np.diag([1.0, -1.0])])
def test_of_affine_maps_it_is_one_over_the_growth(m: NDArray[np.float64]) -> None:
    field = linear(m, [3.0, 4.0], np.array([40.0, 50.0]))
    wanted = 1 / np.linalg.det(m)
    oracle.assert_close(jacobian_determinant(field, [[1.0, 2.0], [90.0, 80.0]]), wanted, rtol=1e-10)
    found = jacobian_determinant(field, RASTER)
    assert found.shape == RASTER.shape
    assert found.dtype == np.float32
    oracle.assert_close(found, wanted, rtol=SINGLE)
    folds = find_folds(field, RASTER)
    assert folds.share == (wanted <= 0)  # mirrored is folded, everywhere
    assert folds.least == pytest.approx(wanted, rel=SINGLE)


def test_of_affine_maps_in_space() -> None:
    m = np.array([[1.2, 0.3, 0.0], [-0.4, 0.9, 0.1], [0.2, 0.0, 1.5]])
    for grid in (GRID, TILTED):
        found = jacobian_determinant(linear(m, [4.0, 0, -3], grid.center), grid)
        assert found.shape == grid.shape
        oracle.assert_close(found, 1 / np.linalg.det(m), rtol=SINGLE)


def test_of_the_identity_it_is_one() -> None:
    assert (jacobian_determinant(Identity(3), GRID) == 1).all()
    assert find_folds(Identity(2), RASTER) == Folds(1.0, (0.0, 5.0), 0.0)


# ---- one dragged point -----------------------------------------------------------------------------------------------


def one_drag(length: float, radius: float, degrees: float = 0.0, at: Any = (50.0, 50.0)) -> AbstractField:
    way = turned(degrees) @ [length, 0.0]
    return fit_rbf(ControlPoints.from_arrays([np.asarray(at) - way], [at]), support=radius, trend="none")


@settings(max_examples=40, deadline=None)
@given(st.floats(0.05, 2.0), st.floats(15, 60), st.floats(0, 360))
def test_one_point_folds_beyond_64_supports_of_135(share: float, radius: float, degrees: float) -> None:
    """The steepest slope of the kernel is 135 / (64 R), at a quarter of its support: det = 1 - |d| 135 / (64 R)."""
    length = share * 64 / 135 * radius
    field = one_drag(length, radius, degrees)
    way = turned(degrees) @ [1.0, 0.0]
    behind = np.array([50.0, 50.0]) - radius / 4 * way
    oracle.assert_close(jacobian_determinant(field, behind), 1 - share, atol=1e-9)
    fine = Raster((41, 41), (radius / 40, radius / 40), tuple(behind - radius / 2))  # behind is one of its nodes
    folds = find_folds(field, fine)
    assert folds.least == pytest.approx(1 - share, abs=1e-4)
    oracle.assert_close(folds.place, behind, atol=radius / 10)
    if abs(share - 1) > 1e-3:
        assert (folds.share > 0) == (share > 1)


def test_the_safe_part_of_a_drag() -> None:
    """Half as far as required: 1 - t s = least, to the last halving."""
    radius, least = 40.0, 0.05
    fine = Raster((81, 81), (0.5, 0.5), (20.0, 30.0))
    for share in (0.5, 0.9, 1.5, 4.0):
        length = share * 64 / 135 * radius
        safe = largest_safe_share(lambda t, d=length: find_folds(one_drag(t * d, radius), fine).least >= least)  # type: ignore[misc]
        wanted = min(1.0, (1 - least) / share)
        assert wanted - 1 / 1024 - 1e-4 <= safe <= wanted + 1e-4
        assert find_folds(one_drag(safe * length, radius), fine).least >= least


def test_what_is_safe_from_the_start_only_counts() -> None:
    """A map that is mirrored half way and whole again later is safe until then only."""
    m = linear(np.eye(2), [0.0, 0.0], np.zeros(2))

    def make(t: float) -> AbstractField:
        return linear(np.diag([1.0, -1.0]), [0.0, 0], np.zeros(2)) if 0.3 < t < 0.6 else m

    assert largest_safe_share(lambda t: find_folds(make(t), RASTER).least > 0) == pytest.approx(0.3, abs=1 / 1024)
    assert largest_safe_share(lambda t: True) == 1
    assert largest_safe_share(lambda t: False) == 0


# ---- every kind of field ---------------------------------------------------------------------------------------------


@pytest.mark.sampled(3)
@pytest.mark.parametrize("kernel", [k for k in KERNELS if k not in ("linear", "wendland_c0")])
def test_on_rasters_as_at_points(kernel: str) -> None:
    trend = "quadratic" if KERNELS[kernel].order > 2 else "affine"
    field = fit_rbf(dragged(2, 3.0), kernel=kernel, support=60.0, trend=trend)
    oracle.assert_close(jacobian_determinant(field, RASTER), determinants_at(field, RASTER.points()), atol=10 * SINGLE)


@pytest.mark.parametrize("grid", [GRID, TILTED])
@pytest.mark.parametrize("view", ["+x", "-y", "+z", "oblique"])
@pytest.mark.parametrize("rule", RULES)
def test_extrusions(rule: str, view: str, grid: Grid) -> None:
    plane = Plane.from_normal(grid.center, (1, 2, -0.5)) if view == "oblique" else Plane.from_view(grid, view)
    maps = [fit_rbf(dragged(k, 3.0), support=60.0) for k in range(len(RULES[rule][1]))]
    field = extrude(plane, grid, maps, RULES[rule])
    found = jacobian_determinant(field, grid)
    x = nodes(grid)
    z = field.zeta(plane.to_plane(x)[..., 2])  # at a knot the derivative jumps, and the determinant does not
    oracle.assert_close(found, determinants_at(field, x), atol=SINGLE)
    oracle.assert_close(jacobian_determinant(field, x), found, atol=SINGLE)
    assert z.min() == 0
    shares: list[float] = []
    folds = find_folds(field, grid, shares.append)
    assert folds.least == found.min()
    assert folds.share == pytest.approx(np.mean(found <= 0))
    oracle.assert_close(jacobian_determinant(field, [folds.place]), found.min(), atol=SINGLE)
    assert shares == sorted(shares)
    assert shares[-1] == pytest.approx(1)


def test_a_replication_is_the_same_along_its_depth() -> None:
    grid = Grid((12, 30, 31), (3.0,) * 3)
    flat = one_drag(30.0, 40.0)
    folds = find_folds(flat, Raster((30, 31), (3.0, 3.0), (0.0, 0.0)))
    whole = extrude(Plane.from_view(grid, "+z"), grid, [flat], replicate())
    there = find_folds(whole, grid)
    assert (there.least, there.share) == (pytest.approx(folds.least), pytest.approx(folds.share))
    assert folds.share > 0
    at = whole.plane.to_plane(there.place)
    oracle.assert_close(at[:2], folds.place, atol=1e-9)
    half = extrude(Plane.from_view(grid, "+z"), grid, [flat], modulate("z"))
    assert find_folds(half, grid).place[2] == pytest.approx(33)  # where the weight is 1
    assert 0 < find_folds(half, grid).share < folds.share


def test_compositions_sums_samples_parts_and_cuts() -> None:
    fit, wave = fit_rbf(dragged(1, 2.0), support=60.0), Wave(1.0, 0.05, dim=2)
    parts = fit_rigid(points(), [RigidPart(BOX, TURN), RigidPart(WALL)], support=100.0)
    held = fit_rigid(points(), [RigidPart(BOX)], support=100.0)
    for field in (compose(fit, wave), Blended((fit, wave)), DisplacementField.sample(fit, RASTER), parts, held):
        oracle.assert_close(jacobian_determinant(field, RASTER), determinants_at(field, RASTER.points()), atol=SINGLE)
    oracle.assert_close(jacobian_determinant(parts, TURN(within(BOX))), 1.0, atol=1e-12)
    one, two = jacobian_determinant(fit, RASTER.points()), jacobian_determinant(compose(fit, fit), RASTER.points())
    there = jacobian_determinant(fit, RASTER.points() + fit.displacement(RASTER.points()))
    oracle.assert_close(two, one * there, atol=1e-12)  # determinants multiply


@pytest.mark.sampled(3)
@pytest.mark.parametrize("rule", CUT_RULES)
@pytest.mark.parametrize("name", CUTS)
def test_beside_cuts_that_of_the_region_seen(name: str, rule: str) -> None:
    field = fitted(scattered(2.0), CUTS[name], rule)
    odd = Raster((40, 40), (2.317, 2.411), (1.13, 1.27))  # no node on a cut
    off = np.abs(jacobian_determinant(field, odd) - determinants_at(field, odd.points()))
    assert np.mean(off < SINGLE) > 0.995  # float32 may see the other side of a cut
    assert jacobian_determinant(pushed(-4.0, 3.0, rule=rule), odd) == pytest.approx(1, abs=1e-6)


def test_cuts_in_space() -> None:
    grid = Grid((6, 40, 40), (2.0, 2.317, 2.411))
    plane = Plane.from_view(grid, "+z")
    flat = fitted(scattered(2.0), (MIDDLE,))
    for rule in (replicate(), modulate("1 - z")):
        field = Decoupled(tuple(extrude(plane, grid, [m], rule) for m in flat.fields), flat.sides, flat.regions, plane)
        off = np.abs(jacobian_determinant(field, grid) - determinants_at(field, nodes(grid)))
        assert np.mean(off < SINGLE) > 0.995


# ---- SimpleITK -------------------------------------------------------------------------------------------------------


def test_simpleitk_has_the_same_convention() -> None:
    """Its differences over two voxels err by h^2 / 6 of the third derivatives, here at most 0.25^3 * 1.5 a voxel."""
    sitk = pytest.importorskip("SimpleITK")
    grid = Grid((14, 15, 16), (1.5, 1.0, 2.0))
    wave = Wave(1.5, 0.25 / 2)
    image = sitk.GetImageFromArray(wave.displacement(nodes(grid)), isVector=True)
    image.SetSpacing(grid.spacing)
    theirs = sitk.GetArrayFromImage(sitk.DisplacementFieldJacobianDeterminant(image))
    inner = (slice(1, -1),) * 3
    ours = jacobian_determinant(wave, grid)
    assert np.ptp(ours) > 0.2
    oracle.assert_close(ours[inner], theirs[inner], atol=2.0**2 / 6 * 1.5 * 0.125**3 * 3 * 1.5)
    affine = linear(np.array([[1.2, 0.3, 0.0], [-0.4, 0.9, 0.1], [0.2, 0.0, 1.5]]), [4.0, 0, -3], grid.center)
    image = sitk.GetImageFromArray(affine.displacement(nodes(grid)), isVector=True)
    image.SetSpacing(grid.spacing)
    theirs = sitk.GetArrayFromImage(sitk.DisplacementFieldJacobianDeterminant(image))
    oracle.assert_close(jacobian_determinant(affine, grid)[inner], theirs[inner], atol=SINGLE)  # exact but for float32


# ---- use -------------------------------------------------------------------------------------------------------------


def test_many_blocks_of_a_grid_are_walked_and_may_be_cancelled(monkeypatch: pytest.MonkeyPatch) -> None:
    from deformnb.analysis import folds

    middle = np.asarray(GRID.center)
    field = fit_rbf(ControlPoints.from_arrays([middle - [9, 3, 9]], [middle]), support=15.0, trend="none")
    whole = jacobian_determinant(field, GRID)
    assert (whole <= 0).any()
    monkeypatch.setattr(folds, "_NODES_AT_A_TIME", 100)
    shares: list[float] = []
    found = find_folds(field, GRID, shares.append)
    assert len(shares) == 7
    assert shares[-1] == 1
    oracle.assert_close(jacobian_determinant(field, GRID), whole, atol=SINGLE)
    assert found.least == pytest.approx(whole.min(), abs=SINGLE)
    k, j, i = np.unravel_index(whole.argmin(), whole.shape)
    oracle.assert_close(found.place, GRID.index_to_point([i, j, k]), atol=1e-9)
    assert found.share == np.mean(whole <= 0)

    def stop(_: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        find_folds(field, GRID, stop)


def test_what_is_not_a_number_is_a_fold() -> None:
    class Broken(Identity):
        def lattice_jacobians(self, rows: Any, columns: Any) -> Any:
            found = super().lattice_jacobians(rows, columns)
            found[..., 0, 0] = np.nan
            return found

    folds = find_folds(Broken(2), RASTER)
    assert np.isnan(folds.least)
    assert folds.place == (0.0, 5.0)
    assert folds.share == pytest.approx(1 / (31 * 41))


@pytest.mark.parametrize(("field", "where"), [(Identity(2), GRID), (Identity(3), RASTER), (Identity(3), [[1.0, 2.0]])])
def test_other_dimensions_are_refused(field: AbstractField, where: Any) -> None:
    with pytest.raises(DeformError, match=r"dimension|coordinates"):
        jacobian_determinant(field, where)


def test_switched_off_points_fold_nothing() -> None:
    given = dragged(3, 40.0)
    off = replace(given, active=np.zeros(len(given), dtype=bool))
    assert find_folds(fit_rbf(given, support=60.0), RASTER).share > 0
    assert find_folds(fit_rbf(off, support=60.0), RASTER).share == 0

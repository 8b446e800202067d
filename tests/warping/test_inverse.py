"""The inverse of a map against closed forms, SimpleITK's, and its own certificate."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import numpy as np
import oracle
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from rbf.test_cuts import MIDDLE, fitted, pushed, scattered
from rbf.test_rigid_parts import BOX, TURN, WALL, points
from warping.test_warper import Wave

from deformnb.analysis.folds import find_folds
from deformnb.errors import Cancelled, DeformError
from deformnb.rbf.cuts import CUT_RULES, Decoupled
from deformnb.rbf.extrusion import Extrusion, extrude, interpolate, modulate, replicate
from deformnb.rbf.fields import AbstractField, Blended, DisplacementField, Identity, compose
from deformnb.rbf.fitting import fit_points, fit_rbf, fit_rigid
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.warping import inverse as inversion
from deformnb.warping.inverse import Inverse, invert, round_trip
from deformnb.warping.warper import warp

RASTER = Raster((31, 41), (2.5, 3.0), (0.0, 5.0))
GRID = Grid((7, 9, 8), (3.0, 2.0, 4.0), (1.0, -5.0, 20.0))
TILTED = Grid(
    (7, 9, 8),
    (3.0, 2.0, 4.0),
    (1.0, -5.0, 20.0),
    tuple(map(tuple, np.linalg.qr(np.random.default_rng(4).normal(size=(3, 3)))[0].tolist())),
)


def nodes(lattice: Grid | Raster) -> NDArray[np.float64]:
    if isinstance(lattice, Raster):
        return lattice.points()
    return lattice.index_to_point(np.moveaxis(np.indices(lattice.shape)[::-1], 0, -1))


def assert_certified(inverse: Inverse, field: AbstractField) -> None:
    """Places that count as reached are right, others do not count, and the error is the true one."""
    x = nodes(inverse.field.lattice)
    y = x + inverse.field.values
    error = np.linalg.norm(y + field.displacement(y) - x, axis=-1)
    assert inverse.error.shape == inverse.reached.shape == x.shape[:-1]
    assert np.isfinite(inverse.field.values).all()
    oracle.assert_close(inverse.error, error, atol=1e-6 * inverse.tolerance, rtol=1e-6)
    assert (error[inverse.reached] <= inverse.tolerance * (1 + 1e-6)).all()
    assert inverse.share == inverse.reached.mean()


def linear(m: NDArray[np.float64], shift: Any, about: Any) -> AbstractField:
    """The backward field of tissue that moves from s to m (s - about) + about + shift."""
    dim = len(m)
    source = np.concatenate([np.zeros((1, dim)), 10 * np.eye(dim)]) + about
    return fit_rbf(ControlPoints.from_arrays(source, (source - about) @ m.T + about + shift), trend="affine_exact")


def turned(degrees: float) -> NDArray[np.float64]:
    a = np.deg2rad(degrees)
    return np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])


def dragged(seed: int, size: float, n: int = 8, dim: int = 2) -> ControlPoints:
    rng = np.random.default_rng(seed)
    source = rng.uniform(0, 100, (n, dim))
    return ControlPoints.from_arrays(source, source + rng.normal(0, size, source.shape))


# ---- closed forms ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "m", [turned(30), turned(180), turned(-100) * 1.7, np.array([[1.0, 0.8], [0, 1]]), np.diag([3.0, 0.2])]
)
def test_the_inverse_of_an_affine_map_on_a_plane(m: NDArray[np.float64]) -> None:
    about, shift = np.array([40.0, 50.0]), np.array([3.0, -2.0])
    inverse = invert(linear(m, shift, about), RASTER)
    x = RASTER.points()
    wanted = (x - about) @ m.T + about + shift - x
    assert inverse.share == 1
    assert inverse.field.values.dtype == np.float32
    # |y + D(y) - x| <= t means that y is off by at most |m| t.
    oracle.assert_close(inverse.field.values, wanted, atol=np.linalg.norm(m, 2) * 2.5e-3)


@pytest.mark.parametrize("grid", [GRID, TILTED])
def test_the_inverse_of_an_affine_map_in_space(grid: Grid) -> None:
    m = np.array([[1.2, 0.3, 0.0], [-0.4, 0.9, 0.1], [0.2, 0.0, 1.5]])
    field = linear(m, [4.0, 0, -3], grid.center)
    inverse = invert(field, grid, tolerance=1e-9)
    x = nodes(grid)
    assert inverse.share == 1
    assert inverse.field.values.dtype == np.float64  # float32 could not hold the required precision
    oracle.assert_close(x + inverse.field.values, (x - grid.center) @ m.T + grid.center + [4.0, 0, -3], atol=2e-9)


def test_control_points_go_from_source_to_target() -> None:
    given = dragged(0, 2.0)
    field = fit_rbf(given, support=60.0)
    at = Raster((1, 1), (1.0, 1.0), tuple(given.source[3]))
    found = invert(field, at, tolerance=1e-10)
    oracle.assert_close(found.field.values[0, 0], given.target[3] - given.source[3], atol=1e-8)


def test_nothing_happens_where_nothing_was_done() -> None:
    for lattice in (RASTER, GRID):
        inverse = invert(Identity(len(lattice.shape)), lattice)
        assert (inverse.field.values == 0).all()
        assert (inverse.error == 0).all()
        assert inverse.share == 1


# ---- the certificate -------------------------------------------------------------------------------------------------


@pytest.mark.nightly
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0, 20), st.sampled_from([2, 3]))
def test_what_is_reached_is_right_and_all_is_reached_without_folds(seed: int, size: float, dim: int) -> None:
    field = fit_rbf(dragged(seed, size, dim=dim), support=80.0)
    lattice = Raster((21, 21), (5.0, 5.0), (0.0, 0.0)) if dim == 2 else Grid((8, 8, 8), (14.0,) * 3)
    inverse = invert(field, lattice)
    assert_certified(inverse, field)
    fine = Raster((120, 120), (2.0, 2.0), (-70, -70)) if dim == 2 else Grid((40, 40, 40), (6.0,) * 3, (-70,) * 3)
    if find_folds(field, fine).least > 0.2:  # at nodes; a margin for places between and beyond them
        assert inverse.share == 1


def test_folded_maps_give_the_right_place_or_say_so() -> None:
    field = fit_rbf(dragged(3, 40.0), support=60.0)
    assert find_folds(field, RASTER).share > 0.1
    inverse = invert(field, RASTER)
    assert_certified(inverse, field)
    assert inverse.share > 0.9  # a continuous map that is affine far away is onto


def test_what_has_no_place_is_flagged_and_finite() -> None:
    @partial(jax.tree_util.register_dataclass, data_fields=[], meta_fields=["amplitude", "frequency", "dim"])
    @dataclass(frozen=True)
    class Pressed(Wave):
        """The result shows the input's plane z = 20 only."""

        def _at(self, x: Any, xp: Any) -> Any:
            return xp.stack([0 * x[..., 0], 0 * x[..., 1], 20 - x[..., 2]], axis=-1)

    inverse = invert(Pressed(), GRID)
    assert inverse.reached.mean(axis=(1, 2)).tolist() == [1, 0, 0, 0, 0, 0, 0]
    assert_certified(inverse, Pressed())


def test_a_large_drag_in_stages_is_inverted() -> None:
    given = ControlPoints.from_arrays(
        [[40, 40], [60, 40], [10, 10], [90, 90], [10, 90], [90, 10]],
        [[75, 45], [50, 75], [10, 10], [90, 90], [10, 90], [90, 10]],
    )
    field = fit_points(given, stages=16, support=50.0)
    assert find_folds(field, RASTER).share == 0
    inverse = invert(field, RASTER)
    assert inverse.share == 1
    assert_certified(inverse, field)


# ---- every kind of field ---------------------------------------------------------------------------------------------

RULES = {"replicate": replicate(), "modulate": modulate("sin(pi * z)"), "interpolate": interpolate([0.1, 0.5, 0.8])}


@pytest.mark.parametrize("grid", [GRID, TILTED])
@pytest.mark.parametrize("view", ["+x", "-y", "+z", "oblique", "rounded"])
@pytest.mark.parametrize("rule", RULES)
def test_extrusions(rule: str, view: str, grid: Grid, monkeypatch: pytest.MonkeyPatch) -> None:
    plane = (
        Plane.from_normal(grid.center, (1, 2, -0.5)) if view in ("oblique", "rounded") else Plane.from_view(grid, view)
    )
    if view == "rounded":  # a plane from a file of few digits is not orthonormal to the last one
        plane = Plane(plane.origin, *(tuple(np.round(w, 7).tolist()) for w in (plane.u, plane.v)))
    maps = [fit_rbf(dragged(k, 1.0), support=60.0) for k in range(len(RULES[rule][1]))]
    field = extrude(plane, grid, maps, RULES[rule])
    inverse = invert(field, grid, tolerance=1e-8)
    assert inverse.share == 1
    assert_certified(inverse, field)
    oracle.assert_close(inverse.field.values @ np.array(plane.normal), np.zeros(grid.shape), atol=1e-9)
    monkeypatch.setattr(inversion, "unchanging_axes", lambda *_: frozenset())  # the long way does not find others
    oracle.assert_close(invert(field, grid, tolerance=1e-8).field.values, inverse.field.values, atol=1e-7)


def test_a_replication_is_solved_on_one_slice() -> None:
    grid = Grid((200, 20, 10))
    field = extrude(Plane.from_view(grid, "+z"), grid, [fit_rbf(dragged(0, 1.0), support=60.0)], replicate())
    seen: list[int] = []

    @partial(jax.tree_util.register_dataclass, data_fields=["maps", "knots", "weights"], meta_fields=["plane", "depth"])
    @dataclass(frozen=True, eq=False)
    class Counted(Extrusion):
        def displacement(self, points: Any) -> Any:
            seen.append(len(points))
            return super().displacement(points)

    inverse = invert(Counted(field.plane, field.depth, field.maps, field.knots, field.weights), grid)
    assert sum(seen) <= 200
    assert inverse.field.values.shape == (200, 20, 10, 3)
    assert (inverse.field.values == inverse.field.values[:1]).all()
    assert_certified(inverse, field)


def test_compositions_sums_samples_and_parts() -> None:
    wave, fit = Wave(1.0, 0.05, dim=2), fit_rbf(dragged(1, 2.0), support=60.0)
    sampled = DisplacementField.sample(fit, Raster((60, 60), (2.0, 2.0), (-5.0, -5.0)))
    parts = fit_rigid(points(), [RigidPart(BOX, TURN), RigidPart(WALL)], support=100.0)
    for field in (compose(fit, wave, fit), Blended((fit, wave)), sampled, compose(sampled, wave)):
        inverse = invert(field, RASTER)
        assert inverse.share == 1
        assert_certified(inverse, field)
    inverse = invert(parts, RASTER)
    assert_certified(inverse, parts)
    inside = BOX.signed_distance(RASTER.points()) < 0
    assert inverse.reached[inside].all()
    moved = RASTER.points()[inside]
    oracle.assert_close(inverse.field.values[inside], TURN(moved) - moved, atol=5e-3)


def test_an_inverse_of_an_inverse_is_the_field() -> None:
    fit = fit_rbf(dragged(1, 1.0), support=60.0)
    fine = Raster((150, 150), (1.0, 1.0), (-25.0, -25.0))
    back = invert(invert(fit, fine).field, RASTER)
    oracle.assert_close(back.field.values, np.moveaxis(fit.sample_on_raster(RASTER), 0, -1), atol=0.02)


# ---- cuts ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rule", CUT_RULES)
def test_beside_an_opened_cut_each_side_goes_its_own_way(rule: str) -> None:
    field = pushed(-4.0, 3.0, rule=rule)
    inverse = invert(field, RASTER)
    assert_certified(inverse, field)
    assert inverse.share == 1
    left = RASTER.points()[..., 0] < 50
    oracle.assert_close(inverse.field.values, np.where(left[..., None], [-4.0, 0], [3.0, 0]), atol=3e-3)


@pytest.mark.parametrize("rule", CUT_RULES)
def test_matter_hidden_behind_the_other_side_is_not_reached(rule: str) -> None:
    """Both sides over the cut, 4 and 3 far: tissue pushed across is covered by that of the other side."""
    field = pushed(4.0, -3.0, rule=rule)
    line = Raster((1, 200), (0.5, 1.0), (0.25, 30.0))
    inverse = invert(field, line)
    assert_certified(inverse, field)
    a = line.columns
    assert (inverse.reached[0] == ((a < 46) | (a > 53))).all()


@pytest.mark.parametrize("rule", CUT_RULES)
@pytest.mark.parametrize("size", [2.0, 8.0])
def test_bent_sides_of_cuts(size: float, rule: str) -> None:
    field = fitted(scattered(size), (MIDDLE,), rule)
    inverse = invert(field, RASTER)
    assert_certified(inverse, field)
    assert inverse.share > 0.8
    hidden = field.opacity(RASTER.points() + inverse.field.values) == 0
    assert not (hidden & inverse.reached).any() or rule == "source"


def test_cuts_in_space_are_solved_on_one_slice_and_in_compositions() -> None:
    grid = Grid((6, 50, 50), (2.0, 2.0, 1.0))
    plane = Plane.from_view(grid, "+z")
    flat = pushed(-4.0, 3.0)
    cut = Decoupled(tuple(extrude(plane, grid, [f], replicate()) for f in flat.fields), flat.sides, flat.regions, plane)
    inverse = invert(cut, grid)
    assert_certified(inverse, cut)
    left = nodes(grid)[..., 0] < 50
    oracle.assert_close(inverse.field.values[..., 0], np.where(left, -4.0, 3.0), atol=3e-3)
    both = compose(cut, Wave(0.5, 0.05))
    small = grid.crop((0, 20, 20), (2, 10, 10))
    inverse = invert(both, small)
    assert_certified(inverse, both)
    assert inverse.share > 0.9


# ---- SimpleITK -------------------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_simpleitk_finds_the_same() -> None:
    """Both invert the same samples, read linearly, so they differ by their residuals alone, stretched less than twice.

    ITK stops when the mean residual is small, 1e-7 here; its largest is then 1e-4. With its own default of 1e-3 it is
    off by a fifth of a voxel at the steepest places, and does not report it.
    """
    sitk = pytest.importorskip("SimpleITK")
    size = 40
    grid = Grid((24, size, size), (1.5, 1.0, 2.0))
    x = nodes(grid)
    middle, far = np.array(grid.center), np.array([28.0, 19.0, 22.0])
    bump = np.exp(-(((x - middle) / far * 3.2) ** 2).sum(-1, keepdims=True))  # no boundary to disagree about
    values = (bump * [3.0, -2.0, 2.5]).astype(np.float64)
    image = sitk.GetImageFromArray(values, isVector=True)
    image.SetSpacing(grid.spacing)
    theirs = sitk.GetArrayFromImage(sitk.InvertDisplacementField(image, 1000, 1e-6, 1e-7))
    inverse = invert(DisplacementField(values, grid), grid, tolerance=1e-6)
    assert inverse.share == 1
    assert np.abs(values).max() > 2
    y = x + theirs
    residual = np.linalg.norm(y + DisplacementField(values, grid).displacement(y) - x, axis=-1)
    assert residual.max() < 5e-4
    oracle.assert_close(inverse.field.values, theirs, atol=2 * float(residual.max()))


# ---- use -------------------------------------------------------------------------------------------------------------


def test_warping_by_the_inverse_undoes_warping() -> None:
    grid = Grid((40, 40, 40))
    x = nodes(grid)
    blob = Volume(np.exp(-((x - [19.0, 21.0, 20.0]) ** 2).sum(-1) / 60), grid)
    field = fit_rbf(ControlPoints.from_arrays([[19, 21, 20], [5, 5, 5]], [[23, 19, 21], [5, 5, 5]]), support=30.0)
    there = warp(blob, field)
    back = warp(there, invert(field, grid).field)
    assert np.abs(there.values - blob.values).max() > 0.3
    # Read linearly twice: 2 h^2/8 |f''|, and f'' of the blob is at most 3 / 30.
    oracle.assert_close(back.values, blob.values, atol=0.03)


def test_progress_grows_to_one_and_may_cancel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inversion, "POINTS_AT_A_TIME", 500)
    field = fit_rbf(dragged(1, 2.0), support=60.0)
    shares: list[float] = []
    inverse = invert(field, RASTER, progress=shares.append)
    assert len(shares) == 3
    assert shares == sorted(shares)
    assert shares[-1] == 1
    np.testing.assert_array_equal(inverse.field.values, invert(field, RASTER).field.values)

    def stop(_: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        invert(field, RASTER, progress=stop)


@pytest.mark.parametrize(
    ("field", "lattice", "tolerance", "message"),
    [
        (Identity(2), GRID, None, "of dimension 2"),
        (Identity(3), RASTER, None, "of dimension 3"),
        (Identity(2), RASTER, 0.0, "tolerance"),
        (Identity(2), RASTER, float("nan"), "tolerance"),
    ],
)
def test_what_has_no_inverse_is_refused(field: AbstractField, lattice: Any, tolerance: Any, message: str) -> None:
    with pytest.raises(DeformError, match=message):
        invert(field, lattice, tolerance=tolerance)


def test_the_round_trip_of_points() -> None:
    field = fit_rbf(dragged(1, 2.0), support=60.0)
    x = np.random.default_rng(0).uniform(0, 100, (500, 2))
    trip = round_trip(field, x)
    assert 0 < trip.mean <= trip.worst <= 2e-4  # a millionth of the extent
    assert trip.reached == 1
    assert round_trip(field, np.zeros((0, 2))).reached == 1
    hidden = round_trip(pushed(4.0, -3.0), np.array([[20.0, 30.0], [48.0, 30.0], [51.0, 30.0], [70.0, 30.0]]))
    assert hidden.reached == 0.5
    assert hidden.worst < 1e-3
    with pytest.raises(DeformError, match="not finite"):
        round_trip(field, [[np.nan, 0.0]])

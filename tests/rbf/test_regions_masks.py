"""Masks against distances to the boxes of their voxels, and silhouettes against projected centres."""

from __future__ import annotations

from itertools import product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deformnb._jax import float64
from deformnb.errors import DeformError
from deformnb.rbf import regions as masks
from deformnb.rbf.fitting import fit_rigid
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Mask
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume

AXES = tuple(map(tuple, Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix().tolist()))
GRID = Grid((7, 8, 9), (0.5, 1.0, 2.5), (3.0, -20.0, 8.0), AXES)
RASTER = Raster((12, 14), (0.7, 2.0), (-3.0, 5.0))


def blob(shape: tuple[int, ...], seed: int = 0) -> NDArray[np.bool_]:
    """A few voxels, none at the edge of the lattice."""
    values = np.random.default_rng(seed).random(shape) < 0.15
    for axis in range(len(shape)):
        values[(slice(None),) * axis + ([0, -1],)] = False
    return values


def lattice_of(dim: int) -> Raster | Grid:
    return RASTER if dim == 2 else GRID


def box_distance(values: NDArray[np.bool_], spacing: Any, index: NDArray[np.float64]) -> float:
    """The distance from an index (z, y, x) to the nearest box of a voxel that is set, one after the other."""
    gaps = np.maximum(np.abs(np.argwhere(values) - index) - 0.5, 0.0) * spacing
    return float(np.sqrt((gaps**2).sum(axis=1).min()))


def centres(lattice: Raster | Grid) -> NDArray[np.float64]:
    if isinstance(lattice, Raster):
        return lattice.points()
    return lattice.index_to_point(np.moveaxis(np.indices(lattice.shape)[::-1], 0, -1))


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_at_the_centres_distances_are_those_to_the_boxes(dim: int, seed: int) -> None:
    lattice = lattice_of(dim)
    values, spacing = blob(lattice.shape, seed), np.array(lattice.spacing)[::-1]
    found = Mask(values, lattice).signed_distance(centres(lattice))
    for index in np.ndindex(lattice.shape):
        exact = box_distance(values != values[index], spacing, np.array(index))
        assert (found[index] < 0) == values[index]
        # The voxel with the nearest centre is taken, which is not always the one with the nearest face.
        assert -1e-5 <= abs(found[index]) - exact <= np.linalg.norm(spacing) / 2


@pytest.mark.parametrize("dim", [2, 3])
def test_the_boundary_runs_along_the_faces(dim: int) -> None:
    lattice = Raster((8, 9), (2.0, 2.0), (3.0, 4.0)) if dim == 2 else Grid((8, 9, 7), (2.0,) * 3, (3.0, 4.0, 5.0), AXES)
    values = np.zeros(lattice.shape, dtype=bool)
    values[(slice(2, 5),) * dim] = True
    mask = Mask(values, lattice)
    for axis, side in product(range(dim), (1.5, 4.5)):
        index = np.full(dim, 3.0)
        index[axis] = side
        place = (
            lattice.index_to_point(index[::-1])
            if isinstance(lattice, Grid)
            else np.array(lattice.origin) + index[::-1] * lattice.spacing
        )
        assert mask.signed_distance(place) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("dim", [2, 3])
def test_jax_says_what_numpy_says(dim: int) -> None:
    mask = Mask(blob(lattice_of(dim).shape), lattice_of(dim))
    middle = centres(mask.lattice).reshape(-1, dim).mean(axis=0)
    p = middle + np.random.default_rng(1).uniform(-30, 30, (500, dim))
    with float64():
        found = np.asarray(jax.jit(lambda m, x: m(x))(mask, jnp.asarray(p)))
        slope = np.asarray(jax.jit(jax.vmap(jax.grad(lambda x: mask(x))))(jnp.asarray(p[:50])))  # noqa: PLW0108
    oracle.assert_close(found, mask.signed_distance(p), atol=1e-6)
    assert np.isfinite(slope).all()


@pytest.mark.parametrize("dim", [2, 3])
def test_beyond_the_lattice_there_is_nothing_of_a_mask_inside_it(dim: int) -> None:
    mask = Mask(blob(lattice_of(dim).shape), lattice_of(dim))
    box = centres(mask.lattice).reshape(-1, dim)
    far = box.mean(axis=0) + 1000 * np.random.default_rng(3).normal(size=(50, dim))
    d = mask.signed_distance(far)
    nearest = np.array([np.linalg.norm(box - p, axis=1).min() for p in far])
    assert (d >= nearest).all()
    assert (d <= nearest + np.linalg.norm(np.ptp(box, axis=0))).all()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("dim", [2, 3])
def test_an_empty_mask_is_nowhere_and_a_full_one_all_around(dim: int) -> None:
    lattice = lattice_of(dim)
    empty, full = (Mask(np.full(lattice.shape, value), lattice) for value in (False, True))
    places = np.concatenate([centres(lattice).reshape(-1, dim), np.full((1, dim), 1e4)])
    for mask, sign in ((empty, 1), (full, -1)):
        for measured in (mask.signed_distance(places), np.asarray(mask(places))):
            np.testing.assert_allclose(measured, sign * 1e15, rtol=1e-6)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("weight", ["saturated", "distance"])
def test_an_empty_part_is_not_felt_beside_another(weight: str) -> None:
    """At twice the diagonal its motion had a share in the other part's surroundings."""
    raster = Raster((20, 30), (1.0, 1.0), (0.0, 0.0))
    values = np.zeros(raster.shape, dtype=bool)
    values[8:12, 10:14] = True
    bone = RigidPart(Mask(values, raster), RigidMotion.turn(20.0, (12.0, 10.0)), weight=weight)
    nothing = RigidPart(
        Mask(np.zeros_like(values), raster), RigidMotion.turn(0.0, (0.0, 0.0), (500.0, 0.0)), weight=weight
    )
    points = ControlPoints.from_arrays([[0.0, 0], [29, 0], [0, 19], [29, 19]], [[0.0, 0], [29, 0], [0, 19], [29, 19]])
    places = centres(raster).reshape(-1, 2)
    alone, both = (fit_rigid(points, parts, trend="none")(places) for parts in ((bone,), (bone, nothing)))
    np.testing.assert_allclose(both, alone, atol=1e-3)


def test_a_mask_at_the_edge_goes_on_beyond_it() -> None:
    values = np.zeros((1, 10), dtype=bool)
    values[0, 6:] = True
    mask = Mask(values, Raster((1, 10), (1.0, 1.0), (0.0, 0.0)))
    assert mask.signed_distance([[9.0, 0.0], [9.9, 0.0], [9.0, 0.9]]).tolist() == pytest.approx([-3.5, -2.6, -2.6])


def test_large_masks_are_measured_coarsely(monkeypatch: pytest.MonkeyPatch) -> None:
    values = blob(GRID.shape, 5)
    fine = Mask(values, GRID).signed_distance(centres(GRID))
    monkeypatch.setattr(masks, "_MOST_VOXELS", 10)
    coarse = Mask(values, GRID).signed_distance(centres(GRID))
    assert (coarse != fine).any()
    assert (np.abs(coarse - fine) <= 2 * np.linalg.norm(GRID.spacing)).all()


# ---- silhouettes -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", VIEWS)
def test_a_silhouette_along_an_axis_is_the_projection(view: str) -> None:
    mask, plane = Mask(blob(GRID.shape), GRID), Plane.from_view(GRID, view)
    flat = mask.silhouette(plane)
    axis = int(np.abs(np.asarray(GRID.direction).T @ plane.normal).argmax())
    assert flat.values.sum() == mask.values.any(axis=2 - axis).sum()
    seen = plane.to_plane(centres(GRID)[mask.values])[:, :2]
    assert (flat.signed_distance(seen) < 0).all()
    missed = plane.to_plane(centres(GRID)[~np.broadcast_to(mask.values.any(axis=2 - axis, keepdims=True), GRID.shape)])
    assert (flat.signed_distance(missed[:, :2]) > 0).all()


def test_an_oblique_silhouette_has_every_centre_and_no_holes() -> None:
    values = np.zeros(GRID.shape, dtype=bool)
    values[2:5, 2:6, 2:7] = True
    plane = Plane.from_normal(GRID.index_to_point([4, 3, 3]), (1, 2, 3))
    flat = Mask(values, GRID).silhouette(plane)
    seen = plane.to_plane(centres(GRID)[values])[:, :2]
    assert (flat.signed_distance(seen) < 0).all()
    between = np.random.default_rng(0).uniform([2, 2, 2], [6, 5, 4], (2000, 3))
    within = plane.to_plane(GRID.index_to_point(between))[:, :2]
    assert (flat.signed_distance(within) < 0).all()
    outline = np.random.default_rng(1).uniform([1.5, 1.5, 1.5], [6.5, 5.5, 4.5], (9000, 3))
    hull = plane.to_plane(GRID.index_to_point(outline))[:, :2]
    around = flat.lattice.points()[flat.values]  # type: ignore[union-attr]
    assert max(np.linalg.norm(hull - p, axis=1).min() for p in around) < 0.71  # no pixel next to the projected block


def test_labels() -> None:
    values = np.zeros(GRID.shape, np.uint8)
    values[2, 3, 4], values[3, 3, 3], values[4, 4, 4] = 7, 9, 11
    volume = Volume(values, GRID, "knee", is_labels=True)
    assert Mask.from_labels(volume).values.sum() == 3
    assert np.argwhere(Mask.from_labels(volume, 9).values).tolist() == [[3, 3, 3]]
    assert Mask.from_labels(volume, [7, 11]).values.sum() == 2
    with pytest.raises(DeformError, match=r"no voxel of knee has a label of \[5\]; it has \[0, 7, 9, 11\]"):
        Mask.from_labels(volume, 5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Mask(np.zeros((12, 14)), RASTER), "True and False, got float64"),
        (lambda: Mask(np.zeros((3, 3), bool), RASTER), r"shape \(3, 3\) does not fit"),
        (lambda: Mask(np.zeros(RASTER.shape, bool), RASTER).silhouette(Plane.from_view(GRID)), "on a picture already"),
    ],
)
def test_what_is_no_mask_is_refused(make: Any, message: str) -> None:
    with pytest.raises(DeformError, match=message):
        make()


def test_masks_are_compared_by_their_voxels_and_do_not_change() -> None:
    values = blob(RASTER.shape)
    mask = Mask(values, RASTER)
    values[:] = False
    assert mask.values.any()
    assert mask == Mask(mask.values.copy(), RASTER) != Mask(values, RASTER)
    assert len({mask, Mask(mask.values.copy(), RASTER)}) == 1
    with pytest.raises(ValueError, match="read-only"):
        mask.values[0, 0] = True


@pytest.mark.parametrize("form", ["ellipsoid", "box"])
def test_a_drawn_mask_has_its_form(form: Any) -> None:
    rng = np.random.default_rng(7)
    frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    middle, radii = np.array([4.0, -9.0, 30.0]), np.array([8.0, 3.0, 5.0])
    mask = Mask.drawn(form, middle, radii, frame)
    places = middle + rng.uniform(-1.3, 1.3, (4000, 3)) * radii @ frame
    at = (places - middle) @ frame.T / radii
    size = np.linalg.norm(at, axis=1) if form == "ellipsoid" else np.abs(at).max(axis=1)
    sure = np.abs(size - 1) > 0.07  # a voxel has an eighth of the smallest radius at most
    np.testing.assert_array_equal(mask.signed_distance(places[sure]) < 0, size[sure] < 1)
    assert sure.mean() > 0.7


@pytest.mark.parametrize(("form", "radii"), [("ball", (1, 1, 1)), ("box", (1, 0, 1)), ("box", (1, np.inf, 1))])
def test_a_mask_that_cannot_be_drawn_says_why(form: Any, radii: Any) -> None:
    with pytest.raises(DeformError, match=r"drawn as one of|positive lengths"):
        Mask.drawn(form, (0, 0, 0), radii, np.eye(3))

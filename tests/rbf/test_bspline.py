"""B-spline fields: the literal sum over all coefficients, SciPy's splines, ITK's transform and its resampling."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk  # noqa: N813 (the name that its own manual uses)
from scipy.interpolate import BSpline

import deformnb as dn
from deformnb import DeformError, Volume, chunked
from deformnb._jax import float64, jax, jnp
from deformnb.io.transforms.formats import describe_transform, read_transform, write_transform
from deformnb.rbf.bspline import ORDERS, BSplineField
from deformnb.rbf.fields import Affine, compose
from deformnb.volume.volume import Grid
from deformnb.warping.reach import DisplacementBounds

RANDOM = np.random.default_rng(8)
ORIGINS = {2: (3.0, -7.0), 3: (3.0, -7.0, 2.0)}
AXES = {2: ((8.0, -6.0), (6.0, 8.0)), 3: ((8.0, -4.8, 0.0), (6.0, 6.4, 0.0), (0.0, 0.0, 9.0))}


def spline_field(dim: int, order: int) -> BSplineField:
    counts = (7, 6, 8)[:dim]
    return BSplineField(RANDOM.normal(size=(*counts, dim)), ORIGINS[dim], AXES[dim], order)


def places(field: BSplineField, count: int, beyond: float = 0.7) -> np.ndarray:
    low, high = field.domain
    index = RANDOM.uniform(low - beyond, high + beyond, (count, field.dim))
    return index @ np.asarray(field.axes).T + np.asarray(field.origin)


def literal(field: BSplineField, points: np.ndarray) -> np.ndarray:
    """The sum over all coefficients, with the cardinal splines of SciPy."""
    knots = np.arange(field.order + 2) - (field.order + 1) / 2
    spline = BSpline.basis_element(knots, extrapolate=False)
    out = np.zeros_like(points)
    low, high = field.domain
    for number, point in enumerate(points):
        index = np.linalg.solve(np.asarray(field.axes), point - np.asarray(field.origin))
        if (index < low).any() or (index > high).any():
            continue
        for at in itertools.product(*(range(n) for n in field.counts)):
            weight = np.prod([np.nan_to_num(spline(i - k)) for i, k in zip(index, at, strict=True)])
            out[number] += weight * field.coefficients[at[::-1]]
    return out


CASES = list(itertools.product((2, 3), ORDERS))


@pytest.mark.parametrize(("dim", "order"), CASES)
def test_the_displacement_is_the_sum_of_all_splines(dim: int, order: int) -> None:
    field = spline_field(dim, order)
    points = places(field, 12)
    known = literal(field, points)
    assert 0 < (known == 0).all(axis=1).sum() < 12
    np.testing.assert_allclose(field.displacement(points), known, rtol=0, atol=1e-12)


@pytest.mark.parametrize(("dim", "order"), CASES)
def test_jax_and_numpy_agree_and_derivatives_are_those_of_differences(dim: int, order: int) -> None:
    field = spline_field(dim, order)
    points = places(field, 200)
    with float64():
        found = np.asarray(jax.jit(field.jax_displacement)(jnp.asarray(points)))
        slopes = np.asarray(jax.vmap(jax.jacfwd(field.jax_displacement))(jnp.asarray(points)))
    np.testing.assert_allclose(found, field.displacement(points), rtol=0, atol=1e-13)
    np.testing.assert_allclose(slopes, field.jacobian(points), rtol=0, atol=1e-13)
    single = np.asarray(field.jax_displacement(jnp.asarray(points, jnp.float32)))
    inside = np.abs(found).max(axis=1) > 0
    low, high = field.domain
    index = field.index_of(points)
    clear = ((np.abs(index - low) > 1e-3) & (np.abs(index - high) > 1e-3)).all(axis=1)  # of the border
    np.testing.assert_allclose(single[clear], found[clear], rtol=0, atol=1e-4)
    h = 1e-6
    for k in range(dim):
        step = h * np.eye(dim)[k]
        difference = (field.displacement(points + step) - field.displacement(points - step)) / (2 * h)
        cell = (index - (order - 1) / 2) % 1
        smooth = inside & clear & ((np.abs(cell - 0.5) < 0.499) | (order > 1)).all(axis=1)
        np.testing.assert_allclose(field.jacobian(points)[smooth, :, k], difference[smooth], rtol=0, atol=1e-6)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("turned", [False, True])
def test_voxels_of_a_grid_have_the_displacements_of_their_places(order: int, turned: bool) -> None:
    axes = np.eye(3) * [9.0, 8.0, 7.0] if turned else np.asarray(AXES[3])
    field = BSplineField(RANDOM.normal(size=(7, 6, 8, 3)), ORIGINS[3], tuple(map(tuple, axes.tolist())), order)
    direction = tuple(map(tuple, (np.asarray(AXES[3]) / np.linalg.norm(AXES[3], axis=0)).tolist()))
    grid = Grid((11, 12, 13), (5.1, 4.3, 6.2), (-4.0, -9.0, 1.0), direction)
    values = field.sample_on_grid(grid)
    index = np.moveaxis(np.indices(grid.shape)[::-1], 0, -1)
    known = field.displacement(grid.index_to_point(index))
    assert 0.05 < (known == 0).all(axis=-1).mean() < 0.98
    np.testing.assert_allclose(values, known, rtol=0, atol=1e-6)


def _itk_spline(image: sitk.Image, order: int = 3) -> Any:
    spline = sitk.BSplineTransformInitializer(image, [4, 3, 5], order)
    spline.SetParameters(RANDOM.uniform(-2, 2, len(spline.GetParameters())).tolist())
    return spline


GRID = Grid((20, 22, 24), (1.5, 1.0, 2.0), (5.0, -30.0, 12.0), ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
VOLUME = Volume(RANDOM.uniform(0, 200, GRID.shape).astype(np.float32), GRID)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("suffix", ["tfm", "h5"])
def test_volumes_are_resampled_as_itk_does_voxel_for_voxel(order: int, suffix: str, tmp_path: Path) -> None:
    image = VOLUME.to_sitk()
    spline = _itk_spline(image, order)
    centre = tuple(GRID.index_to_point([12, 11, 10]).tolist())
    euler = sitk.Euler3DTransform(centre, 0.1, -0.05, 0.2, (1.0, -2.0, 0.5))
    affine = sitk.AffineTransform([1.1, 0.02, 0, 0, 0.9, 0.05, 0.01, 0, 1.05], (0.5, 0.0, -1.0), centre)
    for whole in (spline, sitk.CompositeTransform([euler, spline, affine])):
        path = tmp_path / f"a.{suffix}"
        sitk.WriteTransform(whole, str(path))
        field = read_transform(path)
        known = sitk.GetArrayFromImage(sitk.Resample(image, image, whole, sitk.sitkLinear, -1.0))
        found = dn.warp(VOLUME, field, fill=-1.0).values
        inside = (known != -1) & (found != -1)
        assert inside.mean() > 0.3
        assert (inside == (known != -1)).mean() > 0.995  # at the border either may round outwards
        # Displacements are float32 in the warp: 1e-6 of a voxel's place, times 200 grey levels between neighbours.
        assert np.abs(known - found)[inside].max() < 0.02
        points = GRID.index_to_point(RANDOM.uniform(-3, 27, (500, 3)))
        there = np.array([whole.TransformPoint(tuple(p)) for p in points.tolist()])
        assert np.abs(points + field.displacement(points) - there).max() < 1e-9


@pytest.mark.parametrize("suffix", ["tfm", "h5"])
def test_a_spline_that_is_written_is_the_same_spline_for_itk(suffix: str, tmp_path: Path) -> None:
    fit = dn.fit_rbf(
        dn.ControlPoints.from_arrays(
            GRID.index_to_point([[3, 3, 3], [9, 9, 9]]), GRID.index_to_point([[4, 3, 3], [9, 8, 9]])
        ),
        support=40.0,
    )
    field = compose(fit, spline_field(3, 3), Affine(np.eye(3) * 1.01, np.zeros(3)), spline_field(3, 2))
    path = tmp_path / f"a.{suffix}"
    write_transform(field, path, GRID)
    again, theirs = read_transform(path), sitk.ReadTransform(str(path))
    assert [type(part).__name__ for part in again.steps] == [
        "DisplacementField",
        "BSplineField",
        "Affine",
        "BSplineField",
    ]
    points = GRID.index_to_point(RANDOM.uniform(0, 20, (300, 3)))
    there = np.array([theirs.TransformPoint(tuple(p)) for p in points.tolist()])
    assert np.abs(points + again.displacement(points) - there).max() < 1e-9
    assert np.abs(again.displacement(points) - field.displacement(points)).max() < 0.05  # of the samples of the fit
    assert "B-spline of order 3 with 8 x 6 x 7 coefficients" in describe_transform(path)["part 2"]


def test_a_spline_is_warped_in_parts_and_inverted() -> None:
    spline = _itk_spline(VOLUME.to_sitk())
    spline.SetParameters((0.5 * np.asarray(spline.GetParameters())).tolist())
    fixed = np.asarray(spline.GetFixedParameters())
    size, direction = fixed[:3].astype(int), fixed[9:].reshape(3, 3)
    values = np.moveaxis(np.asarray(spline.GetParameters()).reshape(3, *size[::-1]), 0, -1)
    field = BSplineField(values, tuple(fixed[3:6]), tuple(map(tuple, (direction * fixed[6:9]).tolist())))
    found = chunked.warp(VOLUME, field, Volume, chunks=(8, 8, 8), fill=-1.0)
    np.testing.assert_allclose(found.values, dn.warp(VOLUME, field, fill=-1.0).values, rtol=0, atol=1e-2)
    inverse = dn.invert(field, GRID)
    assert inverse.share > 0.99
    nodes = GRID.index_to_point(RANDOM.integers(6, 14, (50, 3)))
    back = nodes + inverse.field.displacement(nodes)
    assert np.abs(back + field.displacement(back) - nodes).max() < 1e-2


def test_a_spline_in_another_unit_stays_a_spline(tmp_path: Path) -> None:
    field, grid = spline_field(3, 3), Grid((4, 5, 6), unit="\u00b5m")
    write_transform(field, tmp_path / "a.tfm", grid)  # lengths of the grid's unit, which become millimetres
    found = read_transform(tmp_path / "a.tfm")
    assert (type(found), found.unit) == (BSplineField, "mm")
    points = places(field, 50)
    np.testing.assert_allclose(1000 * found.displacement(points / 1000), field.displacement(points), rtol=0, atol=1e-12)
    again = read_transform(tmp_path / "a.tfm", grid)
    assert (type(again), again.unit) == (BSplineField, "\u00b5m")
    np.testing.assert_allclose(again.displacement(points), field.displacement(points), rtol=0, atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
def test_every_displacement_in_a_box_is_within_the_bounds(order: int) -> None:
    field = spline_field(3, order)
    for _ in range(40):
        ends = np.sort(places(field, 2, beyond=2.0), axis=0)
        low, high = DisplacementBounds(field, 1.0).bounds_in(ends[0], ends[1])
        d = field.displacement(RANDOM.uniform(ends[0], ends[1], (400, 3)))
        assert (d >= low - 1e-12).all()
        assert (d <= high + 1e-12).all()


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"order": 4}, "order"),
        ({"order": 0}, "order"),
        ({"origin": (0.0, np.nan, 0.0)}, "finite"),
        ({"axes": ((1.0, 0, 0), (1.0, 0, 0), (0, 0, 1.0))}, "independent"),
        ({"origin": (0.0, 0.0)}, "axes"),
        ({"coefficients": np.zeros((3, 5, 5, 3))}, "do not fit"),
        ({"coefficients": np.zeros((5, 5, 5, 2))}, "do not fit"),
    ],
)
def test_what_is_no_spline_is_refused(given: dict[str, Any], words: str) -> None:
    whole: dict[str, Any] = {"coefficients": np.zeros((5, 5, 5, 3)), "origin": (0.0, 0.0, 0.0), "axes": AXES[3]}
    with pytest.raises(DeformError, match=words):
        BSplineField(**(whole | given))

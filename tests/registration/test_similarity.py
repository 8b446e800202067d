"""Measures of similarity against literal oracles and NumPy, and the slope of the loss against central differences."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from deformed_pictures import lattice_points, picture, texture, warp_by_scipy

from deformnb._jax import float64
from deformnb.errors import DeformError
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.registration import similarity
from deformnb.registration.optimise import GreyImage, MultiscaleFit, initial_objective
from deformnb.registration.similarity import (
    MEASURES,
    Objective,
    find_measure,
    least_det,
    read_linear,
    value_and_gradient,
)
from deformnb.volume.volume import Grid, Volume

RNG = np.random.default_rng(5)
A, W = RNG.random(400), (RNG.random(400) > 0.2).astype(float)


def _similarity(name: str, a: Any, b: Any, w: Any = W) -> float:
    with float64():
        return float(MEASURES[name](a, b, w))


def test_correlation_is_that_of_numpy_where_the_weight_is() -> None:
    b = A**2 + 0.2 * RNG.random(400)
    assert _similarity("ncc", A, b) == pytest.approx(np.corrcoef(A[W > 0], b[W > 0])[0, 1], abs=1e-6)
    assert _similarity("ncc", A, 1 - A) == pytest.approx(-1, abs=1e-6)


def test_squared_difference_is_a_share_of_the_variance() -> None:
    b = RNG.random(400)
    some = W > 0
    assert _similarity("ssd", A, b) == pytest.approx(-((A - b)[some] ** 2).mean() / b[some].var(), rel=1e-6)
    assert _similarity("ssd", A, A) == 0


def test_mutual_information_knows_a_picture_turned_into_its_negative() -> None:
    same, negative, folded, other = (_similarity("mi", A, b) for b in (A, 1 - A, np.abs(A - 0.5), RNG.random(400)))
    assert same == pytest.approx(negative, rel=1e-9)
    assert same > 0.3
    assert same > folded > 2 * other  # one grey value of b is two of a
    assert other < 0.15


def test_mutual_information_of_two_equal_halves_is_one() -> None:
    """Two grey values in the middle of bins, apart by more than a bin's reach: H(a) = H(b) = H(a, b) for any soft bin
    that both share in the same way; here a value at the end falls into one bin and a neighbour, equally in both."""
    a = np.repeat([4 / 23, 18 / 23], 50)
    soft = np.array([1 / 6, 2 / 3, 1 / 6])
    one = np.concatenate([soft, soft]) / 2
    joint = np.concatenate([np.outer(soft, soft).ravel()] * 2) / 2
    entropy = [-(p * np.log(p)).sum() for p in (one, joint)]
    assert _similarity("mi", a, a, np.ones(100)) == pytest.approx(2 * entropy[0] / entropy[1] - 1, rel=1e-9)


def test_an_unknown_measure_is_refused_with_the_names() -> None:
    with pytest.raises(DeformError, match="ncc, ssd, mi"):
        find_measure("cosine")


@pytest.mark.parametrize("shape", [(5, 7), (4, 5, 6)])
def test_reading_is_linear_between_values_and_goes_on_at_the_edge(shape: tuple[int, ...]) -> None:
    from scipy import ndimage

    values = RNG.random(shape)
    index = RNG.uniform(-2, 8, (200, len(shape)))
    with float64():
        read = np.asarray(read_linear(values, index))
    assert np.abs(read - ndimage.map_coordinates(values, index.T, order=1, mode="nearest")).max() < 1e-12


# -- the slope ---------------------------------------------------------------------------------------------------------

CASES: dict[str, dict[str, Any]] = {
    "ncc": {"measure": "ncc"},
    "ssd": {"measure": "ssd"},
    "mi": {"measure": "mi"},
    "similarity": {"trend": "similarity"},
    "no trend": {"trend": "none", "kernel": "wendland_c4"},
    "thin plate": {"kernel": "thin_plate"},
    "multiquadric, rigid": {"kernel": "multiquadric", "trend": "rigid"},
    "three stages": {"stages": 3},
    "smoothing": {"smoothing": 0.5},
    "radii": {"radius": True},
}


def _scene(
    points: ControlPoints,
    measure: str = "ncc",
    stages: int = 1,
    smoothing: float = 0.0,
    radius: bool = False,
    energy: float = 0.3,
    **fit: Any,
) -> Objective:
    if radius:
        points = points.edit(2, radius=50.0).edit(4, radius=36.0)
    moving = picture(texture((96, 96)))
    fixed = warp_by_scipy(moving, fit_rbf(lattice_points(96, 3, 4.0, seed=8)))
    start = fit_rbf(points, smoothing=smoothing, **fit)
    objective = initial_objective(points, start, smoothing, energy, find_measure(measure), stages)
    images = GreyImage.of(moving), GreyImage.of(fixed)
    search = MultiscaleFit(objective, start.origin, start.support, *images, 1, 0.05, float)
    return search.level(2)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("case", list(CASES))
def test_the_slope_is_that_of_central_differences(case: str) -> None:
    points = lattice_points(96, 3, 2.0)
    objective = _scene(points.edit(0, locked=True), **CASES[case])
    h, value = 1e-6, value_and_gradient(np.zeros(objective.x.shape), objective)
    direction = value.slope / np.abs(value.slope).max()
    noise = np.random.default_rng(2).uniform(-0.5, 0.5, objective.x.shape)
    direction += noise * (np.arange(len(objective.x)) < 9)[:, None]
    ahead, behind = (value_and_gradient(sign * h * direction, objective).loss for sign in (1, -1))
    slope = float((value.slope * direction).sum())
    assert (ahead - behind) / (2 * h) == pytest.approx(slope, rel=1e-5)
    assert slope > 1e-3
    assert not value.slope[0].any()  # locked
    assert not value.slope[9:].any()


def test_the_slope_of_the_barrier_is_that_of_central_differences() -> None:
    points = lattice_points(96, 3)
    points = points.move(4, points.target[4] + [27.0, 0.5])  # nearly onto its neighbour
    objective = replace(_scene(points, energy=0.0), measure=_nothing)
    direction = RNG.standard_normal(objective.x.shape) * (np.arange(len(objective.x)) < 9)[:, None]
    value = value_and_gradient(np.zeros(objective.x.shape), objective)
    ahead, behind = (value_and_gradient(sign * 1e-6 * direction, objective).loss for sign in (1, -1))
    assert value.least < 0.15
    assert value.loss > 0
    assert (ahead - behind) / 2e-6 == pytest.approx(float((value.slope * direction).sum()), rel=1e-4)


def _nothing(a: Any, b: Any, weights: Any) -> Any:
    return (a * 0).sum()


def test_a_barrier_rises_towards_a_fold_and_stays_finite_behind_it() -> None:
    det = np.array([1.0, 0.15, 0.1, 0.02, 0.0, -5.0])
    heights = [similarity.barrier(np.array([d]))[0] for d in det]
    assert heights[:2] == [0, 0]
    assert np.all(np.diff(heights[1:]) > 0)
    assert np.isfinite(heights).all()


@pytest.mark.parametrize("stages", [1, 3])
def test_the_smallest_determinant_is_that_of_the_field(stages: int) -> None:
    points = lattice_points(96, 3, 6.0)
    objective = _scene(points, stages=stages)
    least = least_det(objective.x, objective.fitting, objective.lattice)
    a, b = np.meshgrid(*[np.linspace(-0.5, 95.5, 64)] * 2)
    x = np.stack([a, b], axis=-1).reshape(-1, 2)
    product = np.ones(len(x))
    for j in range(stages, 0, -1):  # the parts of the displacement, the last first
        ends = [points.source + s / stages * (points.target - points.source) for s in (j - 1, j)]
        fit = fit_rbf(ControlPoints.from_arrays(*ends), support=scene_support(points))
        product *= np.linalg.det(np.eye(2) + fit.jacobian(x))
        x = x + fit.displacement(x)
    assert least == pytest.approx(product.min(), rel=1e-6)


def scene_support(points: ControlPoints) -> float:
    """The support of all stages: the diagonal of the box of the sources."""
    return float(np.linalg.norm(np.ptp(points.source, axis=0)))


def test_grey_values_lie_where_the_picture_and_the_volume_do() -> None:
    shown = GreyImage.of(picture(np.arange(12.0).reshape(3, 4) / 12, 2.0, (10.0, 20.0)))
    read = shown.at(np.array([[16.0, 22.0], [15.0, 22.0], [16.9, 22.0], [17.1, 22.0], [30.0, 22.0]]))
    assert read.tolist() == pytest.approx([7 / 12, 6.5 / 12, 7 / 12, 0, 0])  # the edge pixel reaches half a pixel on
    assert shown.covers(np.array([[9.1, 20.0], [8.9, 20.0]])).tolist() == [True, False]
    assert shown.points([1.0], [3.0]).ravel().tolist() == pytest.approx([16.0, 22.0])
    grid = Grid((3, 4, 5), (2.0, 1.0, 3.0), (1.0, 2.0, 3.0), ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0)))
    volume = Volume(np.arange(60, dtype=np.uint8).reshape(3, 4, 5), grid)
    image = GreyImage.of(volume)
    places = grid.index_to_point([[4, 3, 2], [0, 0, 0], [1, 2, 1]])
    assert image.at(places).tolist() == pytest.approx([1.0, 0.0, 31 / 59])
    assert image.pixel == pytest.approx(1.0)

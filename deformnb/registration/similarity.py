"""Similarity of a deformed picture and a fixed one, as a differentiable function of the targets of control points.

All of it is pure JAX and works in the plane and in space: the fit (:func:`solve`), the displacement
it makes, the moving picture sampled there, a measure of similarity, the energy of the fit, and det J on a lattice. The
targets are the variables. The use of two pictures, and the optimiser, are in
:mod:`deformnb.registration.optimise`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb._jax import float64, jax, jit, jnp, lax, pytree
from deformnb.errors import DeformError
from deformnb.rbf.kernels import AbstractKernel
from deformnb.rbf.system import solve

LOCAL_PLACES = 4096
"""Places whose displacements are computed together: with 64 points 2 MiB for each intermediate, within the cache."""

Measure = Callable[[Any, Any, Any], Any]
"""(values of the deformed picture, of the other one, weights), all of one shape -> similarity, larger is better."""

# Squares below this are no structure: grey values are in [0, 1], and a step of 8 bits has a square of 1.5e-5.
_FLAT = 1e-10
# Grey values are counted in this many bins. Mattes et al. (IEEE TMI 22, 2003) take 32 to 100 for volumes; a picture has
# fewer pixels, and fewer bins make a smoother function.
_BINS = 24

# Barrier: nothing above _FREE; rises as a squared logarithm; below _STEEP it continues as a line, so that it is finite
# where a trial step has folded the map, with a gradient that unfolds it.
_FREE, _STEEP, _BARRIER = 0.15, 0.02, 0.01


def correlation(a: Any, b: Any, weights: Any) -> Any:
    """Normalised cross-correlation in [-1, 1]: indifferent to brightness and contrast.

    >>> import numpy as np
    >>> a = np.array([0.0, 0.2, 0.7, 0.4])
    >>> round(float(correlation(a, 0.5 * a + 0.3, np.ones(4))), 5)
    1.0
    """
    total = jnp.sum(weights)
    a = a - jnp.sum(weights * a) / total
    b = b - jnp.sum(weights * b) / total
    spread = (jnp.sum(weights * a * a) / total + _FLAT) * (jnp.sum(weights * b * b) / total + _FLAT)
    return jnp.sum(weights * a * b) / total / jnp.sqrt(spread)


def squared_difference(a: Any, b: Any, weights: Any) -> Any:
    """Minus the mean squared difference, as a share of the variance of b: for pictures on one grey scale."""
    total = jnp.sum(weights)
    mean = jnp.sum(weights * b) / total
    return -jnp.sum(weights * (a - b) ** 2) / (jnp.sum(weights * (b - mean) ** 2) + _FLAT * total)


def mutual_information(a: Any, b: Any, weights: Any) -> Any:
    """Normalised mutual information in [0, 1]: for any relation of grey values, even inverted.

    (H(a) + H(b)) / H(a, b) - 1 (Studholme et al., Pattern Recognition 32, 1999), of a histogram softened by cubic
    B-splines so that it can be differentiated (Mattes et al., IEEE TMI 22, 2003).
    """
    joint = (_histogram(a).T * (weights / jnp.sum(weights))) @ _histogram(b)
    return (_entropy(joint.sum(axis=0)) + _entropy(joint.sum(axis=1))) / _entropy(joint) - 1


def _histogram(values: Any) -> Any:
    """(P, bins): what share of each value falls into each bin."""
    distance = jnp.abs(jnp.clip(values, 0, 1)[:, None] * (_BINS - 1) - jnp.arange(_BINS))
    inner, outer = 2 / 3 - distance**2 * (1 - distance / 2), jnp.maximum(2 - distance, 0.0) ** 3 / 6
    share = jnp.where(distance < 1, inner, outer)
    return share / share.sum(axis=1, keepdims=True)  # at the ends some would fall outside


def _entropy(shares: Any) -> Any:
    some = shares > 1e-12
    return -jnp.sum(jnp.where(some, shares * jnp.log(jnp.where(some, shares, 1.0)), 0.0))


MeasureName: TypeAlias = Literal["ncc", "ssd", "mi"]
"""Names of the measures of similarity."""

MEASURES: dict[str, Measure] = {"ncc": correlation, "ssd": squared_difference, "mi": mutual_information}
"""All measures of similarity by name; the first is the default. One more row is one more measure."""


def find_measure(name: str) -> Measure:
    """The measure of a name; DeformError listing the names if there is none."""
    try:
        return MEASURES[name]
    except KeyError:
        raise DeformError(f"unknown measure of similarity {name!r}; choose one of {', '.join(MEASURES)}.") from None


@pytree(data_fields=["source", "active", "nugget", "scales", "span", "turn"], meta_fields=["kernel", "trend", "stages"])
@dataclass(frozen=True, eq=False)
class Fitting:
    """Fit as a function of its targets; all lengths are relative to an origin and a support.

    Parameters
    ----------
    source : (C, dim), zero beyond the points in use; active : (C,) True for these.
    nugget, scales, span, turn, kernel, trend : as :func:`deformnb.rbf.system.solve` takes them.
    stages : equal parts in which the points go their way.
    """

    source: Any
    active: Any
    nugget: Any
    scales: Any
    span: Any
    turn: Any
    kernel: type[AbstractKernel]
    trend: str
    stages: int = 1


@pytree(data_fields=["values", "matrix", "offset"], meta_fields=[])
@dataclass(frozen=True, eq=False)
class SampledImage:
    """The moving picture: values with a rim of background, and the transform of relative places to indices."""

    values: Any
    matrix: Any
    offset: Any


@dataclass(frozen=True, eq=False)
class Objective:
    """Two pictures to be registered at one level.

    Parameters
    ----------
    x : (C, dim) relative targets to start from; free : (C, 1) 1 for those that may move.
    fitting, moving : how they become a fit, and what that deforms.
    places : (B, LOCAL_PLACES, dim) where the pictures are compared; fixed, weights : (B * LOCAL_PLACES,) the other
        picture there.
    lattice : (B, LOCAL_PLACES, dim) where the map must not fold.
    measure : of similarity; energy : how much the energy of the fit counts; unit : relative length of one variable.
    """

    x: NDArray[np.float64]
    free: NDArray[np.float64]
    fitting: Fitting
    lattice: Any
    energy: float
    measure: Measure
    moving: SampledImage | None = None
    places: Any = ()
    fixed: Any = None
    weights: Any = None
    unit: float = 1.0


class Value(NamedTuple):
    """A loss, its slope (C, dim) by the moves, and its terms: similarity, energy, the smallest det J."""

    loss: float
    slope: NDArray[np.float64]
    alike: float
    energy: float
    least: float


def value_and_gradient(moves: Any, objective: Objective) -> Value:
    """Value and gradient of the function to minimise, for ``moves`` (C, dim) of the targets in units.

    The chain rule is written out: blocks of one size are compiled once for all levels and pictures of a size,
    where the whole in one piece took five times as long to compile. What needs no slope is left out.
    """
    with float64():
        x = jnp.asarray(objective.x + objective.free * moves * objective.unit)
        fits, energy = _fit(x, objective.fitting)
        seen = [_see(p, fits, objective.fitting, objective.moving) for p in objective.places]
        det = [_determine(p, fits, objective.fitting) for p in objective.lattice]
        alike, slopes = _compare(jnp.concatenate(seen), objective.fixed, objective.weights, measure=objective.measure)
        rows = np.asarray(slopes).reshape(-1, LOCAL_PLACES)
        back = [
            _see_back(p, fits, objective.fitting, objective.moving, -row)
            for p, row in zip(objective.places, rows, strict=True)
        ]
        det = [np.asarray(d) for d in det]
        walls = [barrier(d) for d in det]
        back += [
            _determine_back(p, fits, objective.fitting, slope)
            for p, (_, slope) in zip(objective.lattice, walls, strict=True)
            if slope.any()
        ]
        total = jax.tree.map(lambda *parts: np.sum(parts, axis=0), *back)
        slope = np.asarray(_fit_back(x, objective.fitting, total, np.float64(objective.energy)))
    loss = objective.energy * float(energy) + sum(height for height, _ in walls) - float(alike)
    return Value(loss, slope * objective.free * objective.unit, float(alike), float(energy), float(np.min(det)))


def least_det(x: NDArray[np.float64], fitting: Fitting, lattice: Any) -> float:
    """The smallest det J of the map of relative targets on a lattice (B, LOCAL_PLACES, dim); NaN if there is no map."""
    with float64():
        fits, _ = _fit(jnp.asarray(x), fitting)
        return float(np.min([np.asarray(_determine(p, fits, fitting)) for p in lattice]))


def _fits(x: Any, fitting: Fitting) -> tuple[Any, Any]:
    """Centres and coefficients (stages, ...) of the fits, the last first as a backward map needs them; energy."""
    parts = jnp.arange(fitting.stages, 0, -1) / fitting.stages
    inner = fitting.active[:, None]
    ends = jnp.where(inner, fitting.source + parts[:, None, None] * (x - fitting.source), 0.0)
    step = jnp.where(inner, (fitting.source - x) / fitting.stages, 0.0)

    def one(end: Any) -> Any:
        alpha, linear, constant, _, bent = solve(
            end,
            step,
            fitting.active,
            fitting.nugget,
            fitting.span,
            fitting.turn,
            fitting.scales,
            kernel=fitting.kernel,
            trend=fitting.trend,
        )
        left = jnp.where(inner, step - end @ linear.T - constant - _quadratic_displacement(end, bent), 0.0)
        # Individual radii leave no energy that is never negative: the residual of the trend replaces it.
        return (end, alpha, linear, constant, bent), jnp.sum((left if fitting.scales is not None else alpha) * left)

    fits, energies = jax.vmap(one)(ends)
    return fits, jnp.sum(energies)


def _squares(p: Any, centers: Any, scales: Any) -> Any:
    s = sum((p[:, None, k] - centers[None, :, k]) ** 2 for k in range(p.shape[1]))
    return s if scales is None else s * scales**2


def _quadratic_displacement(p: Any, quadratic: Any) -> Any:
    """The quadratic part of a trend at places (n, dim); 0 without one."""
    return 0.0 if quadratic is None else jnp.einsum("nk,mkj,nj->nm", p, quadratic, p)


def _displace(p: Any, fit: Any, fitting: Fitting) -> Any:
    centers, alpha, linear, constant, bent = fit
    trend = p @ linear.T + constant + _quadratic_displacement(p, bent)
    return p + trend + fitting.kernel.of_square(_squares(p, centers, fitting.scales)) @ alpha


def _sample_moving(p: Any, fits: Any, fitting: Fitting, moving: SampledImage) -> Any:
    """The moving picture at the places that the backward map sends p to."""
    p, _ = lax.scan(lambda q, fit: (_displace(q, fit, fitting), None), p, fits)
    return read_linear(moving.values, p @ moving.matrix.T + moving.offset)


def read_linear(values: Any, index: Any) -> Any:
    """Values at fractional indices (P, dim), linearly; beyond the edge its values continue."""
    last = jnp.array(values.shape) - 1.0
    at = jnp.clip(index, 0.0, last)
    low = jnp.clip(jnp.floor(at), 0.0, jnp.maximum(last - 1, 0.0))
    t, first = at - low, low.astype(jnp.int32)
    total: Any = 0.0
    for corner in itertools.product((0, 1), repeat=values.ndim):
        share: Any = 1.0
        for k, bit in enumerate(corner):
            share = share * (t[:, k] if bit else 1 - t[:, k])
        total = total + share * values[tuple(first[:, k] + bit for k, bit in enumerate(corner))]
    return total


def _determinants(p: Any, fits: Any, fitting: Fitting) -> Any:
    """Det of the Jacobian of the backward map, stage by stage."""

    def stage(state: tuple[Any, Any], fit: Any) -> tuple[tuple[Any, Any], None]:
        (q, product), (centers, alpha, linear, _, bent) = state, fit
        slope = 2 * fitting.kernel.slope(_squares(q, centers, fitting.scales))
        slope = slope if fitting.scales is None else slope * fitting.scales**2
        across = [(slope * (q[:, None, k] - centers[None, :, k])) @ alpha for k in range(q.shape[1])]
        j = [[linear[m, k] + (m == k) + across[k][:, m] for k in range(q.shape[1])] for m in range(q.shape[1])]
        if bent is not None:
            j = [[j[m][k] + 2 * q @ bent[m, k] for k in range(q.shape[1])] for m in range(q.shape[1])]
        return (_displace(q, fit, fitting), product * _det(j)), None

    (_, product), _ = lax.scan(stage, (p, jnp.ones(len(p), p.dtype)), fits)
    return product


def _det(j: list[list[Any]]) -> Any:
    if len(j) == 2:
        return j[0][0] * j[1][1] - j[0][1] * j[1][0]
    return sum(
        j[0][k] * (j[1][(k + 1) % 3] * j[2][(k + 2) % 3] - j[1][(k + 2) % 3] * j[2][(k + 1) % 3]) for k in range(3)
    )


def barrier(det: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """The height of the barrier over all places, and its slope at each."""
    held = np.clip(det, _STEEP, _FREE)
    rise = np.log(_FREE / held)
    edge = 2 * np.log(_FREE / _STEEP) / _STEEP
    height = rise**2 + edge * np.maximum(_STEEP - det, 0.0)
    slope = np.where(det < _STEEP, -edge, -2 * rise / held)
    return _BARRIER * float(height.sum()), _BARRIER * slope


# ---- compiled pieces -------------------------------------------------------------------------------------------------


def _pull_back(function: Callable[[Any], Any], at: Any, slope: Any) -> Any:
    return jax.vjp(function, at)[1](slope)[0]


_fit = jit(_fits)
_fit_back = jit(lambda x, fitting, slope, energy: _pull_back(lambda y: _fits(y, fitting), x, (slope, energy)))
_see = jit(_sample_moving)
_see_back = jit(
    lambda p, fits, fitting, moving, slope: _pull_back(lambda f: _sample_moving(p, f, fitting, moving), fits, slope)
)
_determine = jit(_determinants)
_determine_back = jit(lambda p, fits, fitting, slope: _pull_back(lambda f: _determinants(p, f, fitting), fits, slope))
_compare = jit(lambda a, b, weights, measure: jax.value_and_grad(measure)(a, b, weights), static_argnames="measure")

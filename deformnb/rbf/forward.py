"""Fits in the forward direction: from sources to targets, with a certified numerical inverse as backward map.

A warp needs for each place y of the result the place x of the input that is shown there. A fit *backward* is this map
itself: it interpolates the sources at the targets. A fit *forward* interpolates the targets at the sources,
``x + F(x) = y``, as most programs of morphometrics fit thin plates; its inverse is found place by place with Newton's
method, and a place counts as found where ``|x + F(x) - y|`` vanishes to rounding and F does not fold at x.

Where the points are spread evenly in the input and unevenly in the result, or vice versa, one of the directions
predicts the places between them better; :func:`~deformnb.rbf.prediction.choose_fit` finds out which.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import scipy
from deformnb._jax import adjugate, determinant, full_precision, jax, jnp, lax, one_plus, pytree
from deformnb._typing import Floats
from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.rbf.exactness import SHARES
from deformnb.rbf.fields import BLOCK, AbstractFit, AbstractInterpolant
from deformnb.rbf.kernels import AbstractKernel
from deformnb.rbf.newton import keep_better, lengths_of, map_of, newton, search
from deformnb.rbf.points import ControlPoints

FitDirection: TypeAlias = Literal["backward", "forward"]
"""Names of the directions of a fit or of a written transform."""

DIRECTIONS: tuple[FitDirection, ...] = get_args(FitDirection)
"""Directions of a fit: from the result to the input, or from the input to the result. The first is the default."""

# Newton's method ends at this share of the size of the points, a digit above the rounding of a fit of some hundred
# points; what ends within the second share, below the error of interpolation, counts as found.
AIM, FOUND = 1e-12, 1e-9

MOST_NEWTON_STEPS = 50

# Nodes per axis, over the sources and half of their size around them, from which places are sought that the usual
# starts do not reach; how many of the nearest are tried.
SEEDS = {2: 64, 3: 16}
SEEDS_AROUND = 0.5
TRIED = 4

# On a lattice every so manieth column is solved from scratch; in between the start is interpolated.
_STRIDE = 8
_PIXEL_SHARE = 1e-5  # of a pixel, to which lattices are solved

# Lengths of a step that compiled functions try.
_SHARES = (1.0, 0.5, 0.25, 0.0625)
_SMALLEST = 1e-30  # a determinant that is taken for zero by them


def check_direction(direction: Any) -> None:
    """Raise a DeformError unless this is one of :data:`DIRECTIONS`."""
    if not isinstance(direction, str) or direction not in DIRECTIONS:
        known = ", ".join(DIRECTIONS)
        raise DeformError(f"unknown direction {short_value(direction)} of a fit; choose one of {known}.")


def orient_points(points: ControlPoints, direction: str) -> ControlPoints:
    """The points as they are fitted: with sources and targets exchanged for a fit forward.

    Examples
    --------
    >>> orient_points(ControlPoints.from_arrays([[0, 0]], [[1, 2]]), "forward").source.tolist()
    [[1.0, 2.0]]
    """
    return replace(points, source=points.target, target=points.source) if direction == "forward" else points


@pytree(data_fields=["forward"], meta_fields=[])
@dataclass(frozen=True, eq=False, repr=False)
class ForwardFit(AbstractFit):
    """The inverse of a fit from sources to targets; a backward displacement field of dimension 2 or 3.

    Parameters
    ----------
    forward : F, whose centres are the sources.

    Examples
    --------
    >>> from deformnb.rbf.fitting import fit_forward
    >>> points = ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9], [9, 9]], [[0, 0], [9, 0], [0, 9], [14, 12]])
    >>> fit = fit_forward(points)
    >>> fit.displacement([[14.0, 12.0]]).round(9).tolist()
    [[-5.0, -3.0]]
    >>> fit.found([[14.0, 12.0]]).tolist()
    [True]
    """

    forward: AbstractInterpolant

    def __repr__(self) -> str:
        return f"<ForwardFit: inverse of {self.forward!r}>"

    @property
    def dim(self) -> int:
        return self.forward.dim

    @property
    def ids(self) -> tuple[int, ...]:
        """Ids of the control points behind the fit."""
        return self.forward.ids

    @property
    def kernel(self) -> type[AbstractKernel]:
        """The kernel of the fit."""
        return self.forward.kernel

    @property
    def support(self) -> float:
        """The support radius of the fit, in the input."""
        return float(self.forward.support)

    @property
    def trend(self) -> str:
        """The trend of the fit."""
        return self.forward.trend

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks of the fit, and on control points at which it has no inverse."""
        count = int((~self.found(self._targets)).sum()) if len(self.ids) else 0
        lost = (f"the fit forward folds at {count} of its control points and has no inverse there",) if count else ()
        return (*self.forward.notes, *lost)

    @property
    def is_identity(self) -> bool:
        return self.forward.is_identity

    def bound(self, pixel: float = 0.0) -> float:
        """As :meth:`~deformnb.rbf.interpolant.RBFInterpolant.bound`: that of the fit, and the residual that a certain
        place may have, times the largest stretch of the inverse at the points.
        """
        if self.is_identity:
            return self.forward.bound()
        stretch = max(1.0, float(np.linalg.norm(self._point_data[1], 2, axis=(1, 2)).max(initial=1.0)))
        return stretch * (self.forward.bound() + FOUND * self.size) + SHARES["lattice"] * pixel

    def folds_between_points(self) -> bool:
        """Check for a fold of the fit at a control point or between them, where the inverse jumps."""
        return self.forward.folds_between_points()

    @full_precision
    def jax_displacement(self, points: Any) -> Any:
        """Displacements at points (..., dim) in pure JAX; the derivative is that of the implicit function."""
        y, forward = jnp.asarray(points), self.forward.jax_displacement
        x = lax.custom_root(lambda x: x + forward(x) - y, y - forward(y), _newton_in_jax, _tangent)
        return x - y

    def displacement(self, points: ArrayLike) -> Floats:
        """Displacements (..., dim); where no place was found that is certain (:meth:`found`), to the best one known."""
        y = self._check_residuals(points)
        return np.asarray(self._solve(y.reshape(-1, self.dim))[0].reshape(y.shape) - y)

    def jacobian(self, points: ArrayLike) -> Floats:
        """dD/dy: the inverse of ``1 + dF/dx``, less 1; where nothing is found the map has the determinant 0."""
        y = self._check_residuals(points)
        if self.is_identity:
            return np.zeros((*y.shape, self.dim))
        x, error = self._solve(y.reshape(-1, self.dim))
        a = self._derivative(x)
        det = determinant(a)
        lost = ~(self._certain(y.reshape(-1, self.dim), error, det))
        inverse = np.where(lost, 0.0, adjugate(a) / np.where(lost, 1.0, det))
        return np.asarray(np.moveaxis(inverse, -1, 0) - np.eye(self.dim)).reshape(*y.shape, self.dim)

    def found(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Check whether the source of each of the points (..., dim) of the result is certain.

        That is where the residual ``|x + F(x) - y|`` is below 1e-9 of the size of the points, and ``det(1 + dF/dx)``
        has the sign that it has at most of the control points.
        """
        y = self._check_residuals(points)
        if self.is_identity:
            return np.ones(y.shape[:-1], dtype=bool)
        flat = y.reshape(-1, self.dim)
        x, error = self._solve(flat)
        return np.asarray(self._certain(flat, error, determinant(self._derivative(x))).reshape(y.shape[:-1]))

    def target_places(self, points: Floats, tolerance: float) -> tuple[Floats, NDArray[np.bool_]]:
        """Exact places x + F(x) of points x (n, dim) of the input, and a check whether the result shows them there."""
        y = points + self.forward.displacement(points)
        back = lengths_of(y + self.displacement(y) - points)
        return y, (back <= max(tolerance, FOUND * self.size)) & self.found(y)

    def lattice_values(self, rows: ArrayLike, columns: ArrayLike, resolution: float) -> NDArray[np.float32]:
        r, c = np.asarray(rows, dtype=np.float64), np.asarray(columns, dtype=np.float64)
        out = np.zeros((self.dim, r.shape[1], c.shape[1]), np.float32)
        step = max(1, BLOCK // max(1, c.shape[1]))
        for start in range(0, 0 if self.is_identity else r.shape[1], step):
            y = np.moveaxis(r[:, start : start + step, None] + c[:, None, :], 0, -1)
            out[:, start : start + step] = np.moveaxis(self._solve_lines(y, _PIXEL_SHARE * resolution), -1, 0)
        return out

    def _solve_lines(self, y: Floats, tolerance: float) -> Floats:
        """Displacements at places (rows, columns, dim) along straight lines at equal steps."""
        count = y.shape[1]
        if count < 2 * _STRIDE:
            return self.displacement(y)
        known = np.unique(np.append(np.arange(0, count, _STRIDE), count - 1))
        d = self.displacement(y[:, known])
        at = np.searchsorted(known, np.arange(count), side="right").clip(1, len(known) - 1)
        t = ((np.arange(count) - known[at - 1]) / (known[at] - known[at - 1]))[:, None]
        flat = y.reshape(-1, self.dim)
        start = flat + ((1 - t) * d[:, at - 1] + t * d[:, at]).reshape(flat.shape)
        x, error = newton(start, flat, np.arange(len(flat)), map_of(self.forward), tolerance, MOST_NEWTON_STEPS)
        lost = np.flatnonzero(~(error <= tolerance))
        if len(lost):
            x[lost] = self._solve(flat[lost])[0]
        return np.asarray((x - flat).reshape(y.shape))

    def _check_residuals(self, points: ArrayLike) -> Floats:
        y = np.asarray(points, dtype=np.float64)
        if y.shape[-1:] != (self.dim,):
            raise DeformError(f"points must have shape (..., {self.dim}), got {y.shape}.")
        return y

    def _derivative(self, x: Floats) -> Floats:
        """1 + dF/dx as (dim, dim, n)."""
        return one_plus(np.moveaxis(self.forward.jacobian(x), 0, -1))

    def _certain(self, y: Floats, error: Floats, det: Floats) -> NDArray[np.bool_]:
        far = np.maximum(self.size, lengths_of(y - self._middle))
        return np.asarray((error <= FOUND * far) & (det * self._sign > 0))

    @cached_property
    def _sources(self) -> Floats:
        """The sources of the control points, (n, dim)."""
        return np.unique(self.forward.targets, axis=0)  # boxes of local fits share some

    @cached_property
    def _targets(self) -> Floats:
        return self._sources + self.forward.displacement(self._sources)

    @cached_property
    def _middle(self) -> Floats:
        return np.asarray(self._targets.mean(axis=0))

    @cached_property
    def size(self) -> float:
        """Size of the points; the support for one place and for none."""
        if not len(self._sources):
            return self.support
        both = np.concatenate([self._sources, self._targets])
        return float(np.linalg.norm(np.ptp(both, axis=0))) or self.support

    @cached_property
    def _point_data(self) -> tuple[Any, Floats, float]:
        """A tree of the targets, ``(1 + dF/dx)^-1`` at the sources (n, dim, dim), and the sign of most determinants."""
        a = self._derivative(self._sources)
        det = determinant(a)
        flat = np.abs(det) < 1e-6 * np.sqrt((a**2).sum(axis=0)).prod(axis=0)
        inverse = np.where(flat, np.eye(self.dim)[..., None], adjugate(a) / np.where(flat, 1.0, det))
        sign = float(np.sign(np.median(np.sign(det))))
        return scipy.spatial.cKDTree(self._targets), np.moveaxis(inverse, -1, 0), sign

    @property
    def _sign(self) -> float:
        return self._point_data[2] or 1.0

    @cached_property
    def _lattice(self) -> tuple[Floats, Any]:
        """Places of the input around the sources, and a tree of where they come to."""
        low, high = self._sources.min(axis=0), self._sources.max(axis=0)
        reach = SEEDS_AROUND * max(float(np.linalg.norm(high - low)), 1e-3 * self.size)
        lines = [np.linspace(a - reach, b + reach, SEEDS[self.dim]) for a, b in zip(low, high, strict=True)]
        nodes = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, self.dim)
        return nodes, scipy.spatial.cKDTree(nodes + self.forward.displacement(nodes))

    def _solve(self, y: Floats) -> tuple[Floats, Floats]:
        """The places x with x + F(x) = y that are found for places y (n, dim), and their residuals (n)."""
        if self.is_identity or not len(y):
            return y.copy(), np.zeros(len(y))
        tree, inverse, _ = self._point_data
        at, tolerance = map_of(self.forward), AIM * self.size
        near = tree.query(y)[1]
        start = self._sources[near] + np.einsum("nij,nj->ni", inverse[near], y - self._targets[near])
        x, error = search(y, at, tolerance, MOST_NEWTON_STEPS, start)
        for column in range(TRIED):
            left = np.flatnonzero(~self._certain(y, error, determinant(self._derivative(x))))
            if not len(left):
                break
            nodes, brought = self._lattice
            first = nodes[brought.query(y[left], TRIED)[1][:, column]]
            self._keep_certain(x, error, left, y, *newton(first, y[left], left, at, tolerance, MOST_NEWTON_STEPS))
        return x, error

    def _keep_certain(
        self, x: Floats, error: Floats, left: NDArray[np.intp], y: Floats, x_new: Floats, error_new: Floats
    ) -> None:
        """Take places that are certain, and of the others those with a smaller residual."""
        certain = self._certain(y[left], error_new, determinant(self._derivative(x_new)))
        x[left[certain]], error[left[certain]] = x_new[certain], error_new[certain]
        rest = ~certain
        keep_better(x, error, left[rest], x_new[rest], error_new[rest])


# ---- in compiled functions -------------------------------------------------------------------------------------------


def _columns(linear: Callable[[Any], Any], like: Any) -> list[list[Any]]:
    """Entries [m][k] of the matrices (...) of a map that is linear in each of the vectors (..., dim) separately."""
    dim = like.shape[-1]
    images = [linear(jnp.zeros_like(like).at[..., k].set(1.0)) for k in range(dim)]
    return [[images[k][..., m] for k in range(dim)] for m in range(dim)]


def _solve_matrices(a: list[list[Any]], b: Any) -> Any:
    """The vectors (..., dim) that matrices map to b; zero where the determinant is."""
    if len(a) == 2:
        c = [[a[1][1], -a[0][1]], [-a[1][0], a[0][0]]]
    else:
        c = [
            [
                a[(k + 1) % 3][(m + 1) % 3] * a[(k + 2) % 3][(m + 2) % 3]
                - a[(k + 1) % 3][(m + 2) % 3] * a[(k + 2) % 3][(m + 1) % 3]
                for k in range(3)
            ]
            for m in range(3)
        ]
    det = sum(a[0][k] * c[k][0] for k in range(len(a)))
    is_flat = jnp.abs(det) < _SMALLEST
    found = [sum(row[k] * b[..., k] for k in range(len(a))) / jnp.where(is_flat, 1.0, det) for row in c]
    return jnp.stack([jnp.where(is_flat, 0.0, part) for part in found], axis=-1)


def _tangent(linear: Callable[[Any], Any], right: Any) -> Any:
    return _solve_matrices(_columns(linear, right), right)


def _newton_in_jax(residual: Callable[[Any], Any], start: Any) -> Any:
    """The root of a residual, for each place (..., dim) separately; ends when no place gets better."""

    def square(r: Any) -> Any:
        return jnp.sum(r * r, axis=-1)

    def turn(state: tuple[Any, Any, Any, Any]) -> tuple[Any, Any, Any, Any]:
        x, r, _, count = state
        step = _solve_matrices(_columns(lambda v: jax.jvp(residual, (x,), (v,))[1], x), -r)
        best, least, improved = x, r, jnp.zeros(x.shape[:-1], bool)
        for share in _SHARES:
            trial = x + share * step
            r_trial = residual(trial)
            better = square(r_trial) < square(least)
            best, least = (jnp.where(better[..., None], new, old) for new, old in ((trial, best), (r_trial, least)))
            improved = improved | better
        return best, least, jnp.any(improved), count + 1

    first = residual(start)
    state = (start, first, jnp.any(square(first) > 0), 0)
    return lax.while_loop(lambda s: s[2] & (s[3] < MOST_NEWTON_STEPS), turn, state)[0]

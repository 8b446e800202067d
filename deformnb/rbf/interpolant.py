"""Radial basis function fit of control points: Eqs. 1-4 and 9 of the paper, Eq. 5 as corrected by the trends.

The interpolant is ``D(x) = A x + t + sum_j alpha_j phi(|x - x_j| / R)``, with the trend "quadratic" also
``x^T H_m x`` in each component m, with centres x_j at the *targets* and
``D(x_j) = source_j - target_j`` (backward). All components share one matrix, factored once, in float64. Coordinates
are centred and divided by the support radius R before anything else, so that neither a large offset nor the unit costs
digits, and evaluation can run in float32. The linear part A, t is the trend; :mod:`deformnb.rbf.trends` has the
correction of Eq. 5.

Points may have individual support radii R_j: ``phi(|x - x_j| / R_j)``. Their matrix is not symmetric, so it need
not be definite and there is no energy to make least: the trend is that of least squares (all points count equally),
the rest is solved by elimination, and a system that comes out nearly singular is refused.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import scipy
from deformnb._jax import HAS_JAX, float64, full_precision, jit, jnp, pytree
from deformnb.devices import is_host
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import PointRemarks, PreparedPoints, crossing_pairs, torn_pairs
from deformnb.rbf.cross_validation import MOST_LEFT_OUT, leave_one_out, parameters_of, polynomials_of
from deformnb.rbf.evaluation import (
    CAPACITIES,
    Leaves,
    PlainLeaves,
    RadialSum,
    capacity,
    evaluate_lattice,
    evaluate_points,
    is_compiled,
    is_culled,
    jacobian_at_lattice,
    jacobian_at_points,
    lattice_on_device,
    local_sums,
    pad_centers,
    profile_of,
    steepest_distance,
)
from deformnb.rbf.exactness import DERIVATIVE, MOST_MISSED, RESIDUAL, ROUNDING, SHARES, largest_miss
from deformnb.rbf.factors import DENSE, Matrix, factor_matrix, matrix_of
from deformnb.rbf.fields import AbstractInterpolant, grid_lines, raster_lines
from deformnb.rbf.kernels import BUILT_IN, AbstractKernel, WendlandC2
from deformnb.rbf.system import Solved, solve, solve_bordered, solve_factored
from deformnb.rbf.trends import NO_ANGLE, Span, TrendName, spread_of
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid

# Coefficients this many times the largest drag are no fit but the effect of a matrix that nothing prevents from being
# singular; points 1/100 of their radius apart that are pulled past each other were seen to take 1000 times.
MOST_GAIN = 1e5

FOLDS_WARNING = (
    "the map folds between its control points (det J <= 0): a larger support radius, the thin-plate kernel, "
    "smaller drags or several stages help"
)
POOR = (
    "the control points predict each other worse than their affine trend alone does: the map between them is a "
    "guess; smoothing, other points or another support radius help"
)

# Rounding errors of the terms of a sum add up like a random walk: the error of float32 evaluation was measured at 1.5
# to 14 times (once 36 times, thin plate) ulp * sqrt(sum alpha^2) * max |phi|, for every kernel, 8 to 512 points and
# supports of 1/8 to 3/2 of the image. Those of the partial sums grow with the number n of terms, most where neighbours
# follow each other and move in the same way: 30 times for 512 points in order along an axis (linear), 60 times for 600
# thin-plate points of a lattice that move like a sine, for 2048 with a compact kernel 65 times, for 1200 of WendlandC0
# whose supports hold all points 72 times, that is 1.4 to 2.5 sqrt(n).
_ROUNDING_ERROR = 6e-8
_TERMS, _PARTIAL_SUMS = 36.0, 4.0
_COMPACT_TERMS, _COMPACT_PARTIAL_SUMS = 14.0, 3.5
# Errors of derivatives of all centres were a fifth of what this foretells of values at most, for eight kernels of 32 to
# 600 points.
_SLOPES = 1 / 3
# Places are sampled where the estimate is at most this many times the allowed error; about so many, of tiles of eight
# by eight, which few centres reach.
_PROBED, _SAMPLED, _TILE = 16.0, 1024, 8
# A kernel beyond its support grows by no more than this power of the distance.
_STEEPEST_POWER = 5.0


class Polynomial(NamedTuple):
    """The trend of a displacement: ``linear @ p + constant + p @ quadratic @ p`` at relative coordinates p.

    Parameters
    ----------
    linear, constant : (dim, dim) and (dim,), physical units.
    quadratic : (dim, dim, dim) symmetric matrices, of the trend "quadratic"; None for the others.
    """

    linear: Any
    constant: Any
    quadratic: Any = None

    @property
    def is_zero(self) -> bool:
        """True if it moves nothing."""
        return not any(np.asarray(part).any() for part in self if part is not None)

    def as_type(self, dtype: Any) -> Polynomial:
        """Copies of the arrays in a type of numbers."""
        return Polynomial(*(None if part is None else np.array(part, dtype=dtype) for part in self))

    def rounding(self, reach: float) -> float:
        """Estimated error of evaluating it in float32, up to ``reach`` from the origin."""
        found = np.abs(np.asarray(self.linear)).sum(axis=1).max() * reach * _ROUNDING_ERROR
        if self.quadratic is not None:
            found += np.abs(np.asarray(self.quadratic)).sum(axis=(1, 2)).max() * reach**2 * _ROUNDING_ERROR
        return float(found)

    def slope_rounding(self, reach: float) -> float:
        """Estimated error of its derivatives in float32, up to ``reach`` from the origin."""
        found = np.abs(np.asarray(self.linear)).sum(axis=1).max() * _ROUNDING_ERROR
        if self.quadratic is not None:
            found += 2 * np.abs(np.asarray(self.quadratic)).sum(axis=(1, 2)).max() * reach * _ROUNDING_ERROR
        return float(found)


@pytree(
    data_fields=[
        "centers",
        "coefficients",
        "polynomial",
        "origin",
        "support",
        "count",
        "scales",
        "nugget",
        "largest",
        "missed",
    ],
    meta_fields=["kernel", "trend", "of_points", "ids", "unit"],
)
@dataclass(frozen=True, eq=False, repr=False)
class RBFInterpolant(AbstractInterpolant):
    """The solved interpolant; a backward displacement field of dimension 2 or 3.

    Parameters
    ----------
    centers : (C, dim) targets as (x - origin) / support, zero beyond ``count``.
    coefficients : (C, dim) alpha_j in physical units, zero beyond ``count``.
    polynomial : the trend of D in relative coordinates.
    origin, support : the relative coordinates.
    count : number of centres in use; C is one of :data:`CAPACITIES`.
    kernel : kernel class; trend : name of the trend that was used (it may be simpler than the one requested).
    of_points : what is known of the points before the fit: the first :attr:`notes`, and their numbers for others.
    ids : ids of the control points behind the centres, in order.
    scales : (C,) support / R_j of centres with individual radii, 1 for the others; None if there are none.
    nugget : (C,) lambda / weight of a smoothing fit; None without smoothing.
    largest : length of the largest displacement that the points were given, physical; None if that is not known.
    missed : by how much it may miss its targets, physical, in addition to the bound of all maps.
    unit : of the points; "" where it is that of the volume on which they are used.

    Examples
    --------
    >>> from deformnb.rbf.fitting import fit_rbf
    >>> from deformnb.rbf.points import ControlPoints
    >>> fit = fit_rbf(ControlPoints.from_arrays([[0, 0], [10, 0], [0, 10]], [[0, 0], [14, 0], [0, 10]]))
    >>> fit.displacement([[14.0, 0.0]]).round(3).tolist()
    [[-4.0, 0.0]]
    """

    centers: Any
    coefficients: Any
    polynomial: Polynomial
    origin: Any
    support: Any
    count: Any
    kernel: type[AbstractKernel] = WendlandC2
    trend: TrendName = "affine"
    of_points: PointRemarks = field(default=PointRemarks())
    ids: tuple[int, ...] = field(default=())
    scales: Any = None
    nugget: Any = None
    largest: Any = None
    missed: Any = 0.0
    unit: str = ""

    def __repr__(self) -> str:
        count = len(self.ids)
        return (
            f"<RBFInterpolant: {count} {'point' if count == 1 else 'points'} "
            f"{'in the plane' if self.dim == 2 else 'in space'}, {self.kernel.name}, trend {self.trend}>"
        )

    @property
    def dim(self) -> int:
        return int(self.centers.shape[-1])

    @property
    def is_culled(self) -> bool:
        """True if tiles of places have lists of the centres that reach them."""
        return is_culled(self.kernel, self.count)

    @cached_property
    def is_identity(self) -> bool:
        return self.polynomial.is_zero and not np.asarray(self.coefficients).any()

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Remarks for a status line: undetermined parts of the map, its folds, its predictions."""
        found = ((FOLDS_WARNING, self.folds_between_points()), (POOR, self._predicts_poorly()))
        return (*self.remarks, *(note for note, is_so in found if is_so))

    @cached_property
    def remarks(self) -> tuple[str, ...]:
        """Those of the :attr:`notes` that are known of the points and the trend, without looking at the map."""
        return self.of_points.texts if self.is_identity else self.of_points.texts + _warnings(self)

    @property
    def targets(self) -> NDArray[np.float64]:
        centers = np.asarray(self.centers, dtype=np.float64)[: int(self.count)]
        return np.asarray(self.origin) + float(self.support) * centers

    def prescribed_displacements(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Targets (n, dim) of the points behind the centres, and the displacements that are prescribed there."""
        n, targets = int(self.count), self.targets
        given = self.displacement(targets)
        return targets, given if self.nugget is None else given + (
            np.asarray(self.nugget)[:n, None] * np.asarray(self.coefficients)[:n]
        )

    def folds_between_points(self) -> bool:
        """Check for ``det(1 + dD/dx) <= 0`` at a control point, next to it or between them.

        Tests :meth:`steep_places`; :func:`deformnb.analysis.folds.find_folds` tests a whole picture.
        """
        if not np.asarray(self.coefficients).any() and self.polynomial.quadratic is None:
            return bool(np.linalg.det(np.eye(self.dim) + np.asarray(self.polynomial.linear) / self.support) <= 0)
        return self.folds_at(self.steep_places())

    def folds_at(self, places: ArrayLike) -> bool:
        """Check for ``det(1 + dD/dx) <= 0`` at one of these places (n, dim)."""
        return bool((np.linalg.det(np.eye(self.dim) + self.jacobian(places)) <= 0).any())

    def steep_places(self) -> NDArray[np.float64]:
        """Places (n, dim) at which the map changes most.

        They are the control points, three places on each edge of their Delaunay triangulation and the middles of its
        simplices, and for each control point the places next to it, along its coefficient alpha_i, where the kernel's
        profile is steepest; a kernel without an end has no such place, it is steeper the farther one goes.
        """
        n = int(self.count)
        x, alpha = (np.asarray(a, dtype=np.float64)[:n] for a in (self.centers, self.coefficients))
        if not n:
            return x
        if self.kernel.order:
            return np.asarray(self.origin + self.support * probe_places(x))
        size = np.linalg.norm(alpha, axis=1, keepdims=True)
        way = steepest_distance(self.kernel) * np.divide(alpha, size, out=np.zeros_like(alpha), where=size > 0)
        way = way if self.scales is None else way / np.asarray(self.scales)[:n, None]
        return np.asarray(self.origin + self.support * np.concatenate([probe_places(x), x - way, x + way]))

    def _predicts_poorly(self) -> bool:
        """Check whether points predict each other worse than the affine trend alone does, by leave-one-out.

        Defined for sets most of which are dragged; one drag among points that are held still predicts nothing.
        """
        n = int(self.count)
        x, alpha = (np.asarray(a, dtype=np.float64)[:n] for a in (self.centers, self.coefficients))
        least = parameters_of(self.trend, self.dim) + 3
        if not least <= n <= MOST_LEFT_OUT or self.scales is not None or not alpha.any():
            return False
        nugget = np.zeros(n) if self.nugget is None else np.asarray(self.nugget)[:n]
        drags = (
            self.prescribed_displacements()[1] / self.support
        )  # in the unit of the places: rigid maps are not linear in it
        if np.count_nonzero(drags.any(axis=1)) <= n / 2:
            return False
        try:
            errors = leave_one_out(x, drags, self.kernel, self.trend, nugget)
        except np.linalg.LinAlgError:
            return False
        p = polynomials_of(x, "affine")
        hat = p @ p.T
        alone = (drags - hat @ drags) / np.maximum(1 - hat.diagonal(), 1e-9)[:, None]
        return bool((errors**2).sum() > (alone**2).sum())

    def bound(self, pixel: float = 0.0) -> float:
        """The largest ``|D(target) - (source - target)|`` of the control points by any evaluation, physical.

        It is that of :func:`~deformnb.rbf.exactness.largest_miss`, and more where a note states it; smoothing, which
        means to miss, is left out.

        Parameters
        ----------
        pixel : smallest side of the pixels or voxels that the map is evaluated for; 0 at single places.

        Examples
        --------
        >>> from deformnb.rbf.fitting import fit_rbf
        >>> from deformnb.rbf.points import ControlPoints
        >>> fit = fit_rbf(ControlPoints.from_arrays([[0, 0], [10, 0], [0, 10]], [[0, 0], [14, 0], [0, 10]]))
        >>> bool(abs(fit([[14.0, 0.0]]) - [[-4.0, 0.0]]).max() <= fit.bound()), f"{fit.bound(0.5):.1g}"
        (True, '0.0005')
        """
        centers = np.asarray(self.centers, dtype=np.float64)[: int(self.count)]
        extent = float(self.support) * float(np.sqrt((centers**2).sum(axis=1)).max(initial=0.0))
        return largest_miss(self._largest, extent, pixel) + float(self.missed)

    @property
    def _largest(self) -> float:
        return np.inf if self.largest is None else float(self.largest)

    @full_precision
    def jax_displacement(self, points: Any) -> Any:
        """Displacements at points (..., dim) in pure JAX; gradients are finite everywhere, at the centres too."""
        p = (jnp.asarray(points) - self.origin) / self.support
        s = jnp.sum((p[..., None, :] - self.centers) ** 2, axis=-1)
        s = s if self.scales is None else s * jnp.asarray(self.scales) ** 2
        linear, constant, bent = self.polynomial
        plain = p @ jnp.asarray(linear).T + constant + self.kernel.of_square(s) @ self.coefficients
        return plain if bent is None else plain + jnp.einsum("...k,mkj,...j->...m", p, bent, p)

    def displacement(self, points: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
        """Displacements at points (..., dim), computed in this type of numbers."""
        relative, shape = self._relative(points)
        if self.is_identity:  # every studio starts with one, and nothing is compiled for it
            return np.zeros(shape)
        return evaluate_points(relative, _summed(self, dtype), self.kernel, dtype).T.reshape(shape)

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        """dD/dx at points (..., dim): ``A/R + (2/R^2) sum_j alpha_j phi'(s_j) (x - x_j)^T`` with phi of s = rho^2.

        Kernels with a kink have no derivative at a control point; there the kernel's share is 0.
        """
        relative, shape = self._relative(points)
        if self.is_identity:
            return np.zeros((*shape, self.dim))
        d = jacobian_at_points(relative, _summed(self, np.float64), self.kernel, np.float64) / self.support
        return np.moveaxis(d, -1, 0).reshape(*shape, self.dim)

    def _relative(self, points: ArrayLike) -> tuple[NDArray[np.float64], tuple[int, ...]]:
        x = np.asarray(points, dtype=np.float64)
        if x.shape[-1:] != (self.dim,):
            raise DeformError(f"points must have shape (..., {self.dim}), got {x.shape}.")
        return ((x - self.origin) / self.support).reshape(-1, self.dim).T, x.shape

    def lattice_jacobians(self, rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float32]:
        """dD_m/dx_k at ``rows[:, r] + columns[:, c]``, (dim, dim, R, C): for pictures, not for proofs (float32)."""
        first, other = self._relative_lines(rows, columns)
        if self.is_identity:
            return np.zeros((self.dim, self.dim, first.shape[1], other.shape[1]), np.float32)
        dtype = self.derivative_type(_reach(first, other))
        d = jacobian_at_lattice(first, other, _summed(self, dtype), self.kernel, dtype)
        return np.asarray(d / self.support, dtype=np.float32)

    def lattice_values(self, rows: ArrayLike, columns: ArrayLike, resolution: float) -> NDArray[np.float32]:
        first, other = self._relative_lines(rows, columns)
        if self.is_identity:
            return np.zeros((self.dim, first.shape[1], other.shape[1]), np.float32)
        dtype = self.type_within(_reach(first, other), resolution)
        summed = _summed(self, dtype)
        if dtype is np.float64 and _is_exact_in_float32(self, first, other, summed, min(resolution, self._largest)):
            dtype = np.float32
        return np.asarray(evaluate_lattice(first, other, summed, self.kernel, dtype), dtype=np.float32)

    def evaluate_on_device(self, lattice: Grid | Raster) -> tuple[tuple[Any, ...], Any]:
        """Displacements on a grid or a raster in the memory of the device in use, and whether all are finite.

        Three components (nz, ny, nx) or two (nv, nu), float32. Call it within
        :func:`deformnb.devices.device_context`.
        """
        lines = raster_lines(lattice) if isinstance(lattice, Raster) else grid_lines(lattice)
        rows, columns = self._relative_lines(*lines)
        dtype = self.type_within(_reach(rows, columns), min(lattice.spacing))
        return lattice_on_device(rows, columns, self._leaves(dtype), self.kernel, dtype, lattice.shape)

    def type_within(self, reach: float, resolution: float) -> Any:
        """The type that meets :meth:`bound` on pixels of this size, up to ``reach`` supports from the origin."""
        allowed = SHARES["lattice"] * min(resolution, self._largest)
        return np.float64 if self.float32_error(reach) > allowed else np.float32

    def derivative_type(self, reach: float) -> Any:
        """The type in which dD/dx is right to :data:`~deformnb.rbf.exactness.DERIVATIVE`, as :meth:`type_within`."""
        if self.kernel.order > 2:  # the terms of r^5 cancel each other
            return np.float64
        return np.float64 if self.float32_slope_error(reach) > DERIVATIVE else np.float32

    def _relative_lines(self, rows: ArrayLike, columns: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        first = (np.asarray(rows, dtype=np.float64) - np.asarray(self.origin)[:, None]) / self.support
        other = np.asarray(columns, dtype=np.float64) / self.support
        middle = other[:, [0, -1]].mean(axis=1, keepdims=True) if other.size else 0.0
        return first + middle, other - middle  # float32 has no digits left for pixels far from their origin

    @cached_property
    def _local_error(self) -> float:
        """Estimated error of the sum over the centres that reach a place, in float32, for a kernel of slope 1."""
        *squares, count = local_sums(self._leaves(np.float64)).tolist()
        return float(max(_COMPACT_TERMS, _COMPACT_PARTIAL_SUMS * count**0.5) * _ROUNDING_ERROR * max(squares) ** 0.5)

    def float32_error(self, reach: float = 1.0) -> float:
        """Estimated error of evaluating in float32, in physical units, up to ``reach`` supports from the origin."""
        if self.is_culled:
            return self._local_error
        farthest = (reach + np.sqrt((np.asarray(self.centers) ** 2).sum(axis=-1)).max()) * self.support
        # Places far away in units of the support are rounded too, and count by the kernel's slope.
        ends = np.abs(profile_of(np.array([0.0, (farthest / float(self.support)) ** 2]), self.kernel))
        largest = max(ends.max(), reach / 12 * self.kernel.steepest)
        return float(self._global_error * largest + self.polynomial.rounding(reach))

    @cached_property
    def _global_error(self) -> float:
        """As :meth:`_local_error`, of all centres."""
        terms = max(_TERMS, _PARTIAL_SUMS * int(self.count) ** 0.5) * _ROUNDING_ERROR
        return float(terms * np.sqrt((np.asarray(self.coefficients) ** 2).sum(axis=0)).max())

    def float32_slope_error(self, reach: float = 1.0) -> float:
        """Estimated error of dD/dx in float32, without unit, up to ``reach`` supports from the origin."""
        steepest = self.kernel.steepest
        if self.is_culled:
            return self._local_error * steepest / float(self.support)
        farthest = float(reach + np.sqrt((np.asarray(self.centers) ** 2).sum(axis=-1)).max())
        far = float(np.abs(profile_of(np.array([farthest**2]), self.kernel))[0])
        # Places are rounded as for values; a slope changes by a few times itself over a support.
        largest = max(steepest, _STEEPEST_POWER * far / farthest, reach / 12 * 4 * steepest)
        trend = self.polynomial.slope_rounding(reach)
        return float((_SLOPES * self._global_error * largest + trend) / float(self.support))

    def radial_sum(self, dtype: Any) -> RadialSum:
        """The sum over the centres for compiled functions, in float32 or float64; see :meth:`type_within`."""
        return RadialSum(
            self._leaves(dtype), np.asarray(self.origin, np.float64), np.float64(1 / self.support), self.kernel
        )

    def _leaves(self, dtype: Any) -> Leaves:
        if self.is_culled:
            dtype = np.float64  # tiles subtract their middle first
        # Copies: where a user's own jax.jit has taken the arrays of a field as constants, JAX 0.10 takes these in 32
        # bits ever after, and fails where a function was compiled for 64.
        centers, coefficients = (pad_centers(a, dtype) for a in (self.centers, self.coefficients))
        scales = None if self.scales is None else pad_centers(self.scales, dtype)
        linear, constant, bent = self.polynomial.as_type(dtype)
        return Leaves(centers, coefficients, linear, constant, np.int32(self.count), scales, bent)


def _reach(rows: NDArray[np.float64], columns: NDArray[np.float64]) -> float:
    """Largest distance from the origin, in supports, of the sums of relative lines."""
    return float(np.sqrt(sum(np.abs(lines).max(initial=0.0) ** 2 for lines in (*rows, *columns))))


def _summed(fit: RBFInterpolant, dtype: Any) -> Leaves | PlainLeaves:
    """The arrays from which sums of a type are computed at places that are known."""
    if not is_compiled(fit.kernel):
        return fit.radial_sum(dtype).leaves
    n = int(fit.count)
    centers, coefficients = np.asarray(fit.centers)[:n], np.asarray(fit.coefficients)[:n]
    linear, constant, bent = fit.polynomial
    scales = None if fit.scales is None else np.asarray(fit.scales)[:n]
    return PlainLeaves(Leaves(centers, coefficients, linear, constant, n, scales, bent))


def _is_exact_in_float32(
    fit: RBFInterpolant,
    rows: NDArray[np.float64],
    columns: NDArray[np.float64],
    summed: Leaves | PlainLeaves,
    length: float,
) -> bool:
    """Check by a sample of the places that float32 is exact enough where its estimate, for the worst, says not.

    The largest error on a picture of 600 to 2048 centres, in three kernels and six arrangements, was 3 to 26 times less
    than the estimate, and up to 2.5 times that of a sample.

    Parameters
    ----------
    length : a pixel, or the largest displacement if that is less.
    """
    allowed = SHARES["lattice"] * length
    if not (fit.is_culled and isinstance(summed, PlainLeaves)) or fit.float32_error() > _PROBED * allowed:
        return False
    stride = max(1, round((rows.shape[1] * columns.shape[1] / _SAMPLED) ** 0.5))
    i, j = (part.ravel() for part in np.mgrid[: rows.shape[1] : stride, : columns.shape[1] : stride])
    order = np.lexsort((j // (_TILE * stride), i // (_TILE * stride)))
    places = rows[:, i[order]] + columns[:, j[order]]
    quick, exact = (evaluate_points(places, summed, fit.kernel, dtype) for dtype in (np.float32, np.float64))
    return bool(np.abs(quick - exact).max(initial=0.0) <= 0.4 * allowed)


def probe_places(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Places x (n, dim), on the edges of their triangulation and in its simplices; on a line, between neighbours."""
    n, dim = x.shape
    simplices = None
    if n > dim + 1:
        with contextlib.suppress(scipy.spatial.QhullError):
            simplices = np.asarray(scipy.spatial.Delaunay(x).simplices)
    if simplices is None:
        near = np.asarray(scipy.spatial.cKDTree(x).query(x, k=min(n, 5))[1]).reshape(n, -1)
        edges, middles = np.stack([np.repeat(np.arange(n), near.shape[1]), near.ravel()], axis=1), x[:0]
    else:
        edges = np.concatenate([simplices[:, [i, j]] for i in range(dim + 1) for j in range(i)])
        middles = x[simplices].mean(axis=1)
    a, b = x[np.unique(np.sort(edges, axis=1), axis=0)].transpose(1, 0, 2)
    return np.concatenate([x, middles, *(a + share * (b - a) for share in (0.25, 0.5, 0.75))])


_solve = jit(solve, static_argnames=("kernel", "trend"))


def _solve_whole(
    x: NDArray[np.float64],
    d: NDArray[np.float64],
    active: NDArray[np.bool_],
    nugget: NDArray[np.float64],
    span: Span,
    turn: NDArray[np.float64],
    scales: NDArray[np.float64] | None,
    kernel: type[AbstractKernel],
    trend: TrendName,
) -> Solved:
    """The system by elimination; NaN where it has no solution."""
    if HAS_JAX and (kernel.name not in BUILT_IN or not is_host()):
        with float64():
            return _solve(x, d, active, nugget, span, turn, scales, kernel=kernel, trend=trend)
    n, (size, dim) = int(active.sum()), x.shape
    own = None if scales is None else scales[:n]
    with contextlib.suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
        return solve(x[:n], d[:n], active[:n], nugget[:n], span, turn, own, kernel=kernel, trend=trend)
    unknown = np.full((size, dim), np.nan)
    return Solved(unknown, np.full((dim, dim), np.nan), unknown[0], unknown)


def solve_prepared(
    ready: PreparedPoints, kernel: type[AbstractKernel], smoothing: float, previous: RBFInterpolant | None
) -> RBFInterpolant:
    """Fit points that were checked; see :func:`~deformnb.rbf.fitting.fit_rbf`. Without points it is the identity."""
    n, dim = ready.targets.shape
    if n == 0:
        zero = np.zeros((CAPACITIES[0], dim))
        return RBFInterpolant(
            zero,
            zero,
            Polynomial(np.zeros((dim, dim)), np.zeros(dim)),
            np.zeros(dim),
            1.0,
            0,
            kernel,
            "none",
            ready.remarks(ready.notes),
            (),
            largest=0.0,
        )
    size = capacity(n)
    x, d, nugget = np.zeros((size, dim)), np.zeros((size, dim)), np.ones(size)
    x[:n], d[:n], nugget[:n] = ready.relative, ready.displacements / ready.support, smoothing / ready.weights
    smoothed = nugget if smoothing else None
    scales = None
    if (ready.radii != ready.support).any():
        scales = np.ones(size)
        scales[:n] = ready.support / ready.radii
    if not d.any():  # exactly the identity, which a solve would miss by rounding
        zero = np.zeros((dim, dim))
        return RBFInterpolant(
            x,
            np.zeros((size, dim)),
            Polynomial(zero, zero[0]),
            ready.origin,
            ready.support,
            n,
            kernel,
            ready.trend,
            ready.remarks(ready.notes),
            ready.ids,
            scales,
            smoothed,
            largest=0.0,
        )
    turn = np.eye(dim) if previous is None or previous.dim != dim else _rotation_of(previous)
    most = RESIDUAL * np.abs(d).max() + ROUNDING * np.abs(x).max()
    is_whole = n > dim + 1 and ready.span.basis.shape[1] == dim  # enough points, and not all on a line or in a plane
    own = None if scales is None else scales[:n]
    origin = ready.origin
    solved = None
    if (kernel.order == 0 and (scales is None or (kernel.compact and n > DENSE))) or (
        kernel.order in (1, 2) and scales is None and ready.trend != "quadratic" and is_whole
    ):
        solved, origin = _solve_factored(ready, d[:n], nugget[:n], own, turn, kernel, most)
        x[:n] = (ready.targets - origin) / ready.support
    # A nearly singular matrix with polynomials has no Cholesky factor; elimination may still interpolate by it.
    if solved is None or (kernel.order and not np.abs(solved.miss).max() <= most):
        solved = _solve_whole(x, d, np.arange(size) < n, nugget, ready.span, turn, scales, kernel, ready.trend)
    alpha, linear, constant, miss = map(np.asarray, solved[:4])
    bent = None if solved.quadratic is None else np.asarray(solved.quadratic) * ready.support
    if scales is not None and not np.abs(alpha).max() <= MOST_GAIN * np.abs(d).max():
        raise DeformError(
            "the individual support radii of these control points are incompatible: the system is nearly "
            f"singular (closest are {ready.closest}). Give neighbours more similar radii, or smaller ones."
        )
    missed, notes = ready.missed, ready.notes
    # On the host, where max() propagates NaN: the compiler's fast minimum and maximum drop it.
    if not np.abs(miss).max() <= most:
        if not np.abs(miss).max() <= MOST_MISSED * np.abs(d).max():
            raise TooFlatError(_too_flat(ready, kernel))
        own_miss = float(np.linalg.norm(miss, axis=1).max()) * ready.support
        missed, notes = missed + _MISSED_MORE * own_miss, (*notes, nearly_singular(own_miss, ready.closest))
    r, coefficients = ready.support, np.zeros((size, dim))
    coefficients[:n] = alpha[:n] * r
    return RBFInterpolant(
        x,
        coefficients,
        Polynomial(linear * r, constant * r, bent),
        origin,
        r,
        n,
        kernel,
        ready.trend,
        ready.remarks(notes),
        ready.ids,
        scales,
        smoothed,
        float(np.linalg.norm(d, axis=1).max()) * r,
        missed,
    )


class TooFlatError(DeformError):
    """The system of a fit is singular to working precision; fewer points at a time may not be."""


# The rounding of a sum whose terms cancel is another one at the next evaluation.
_MISSED_MORE = 3.0


def nearly_singular(miss: float, closest: str) -> str:
    """The note on a fit that misses its targets by a length."""
    return (
        f"the system is nearly singular (closest are {closest}): the map misses its targets by up to {miss:.1g}; a "
        "smaller support, a Wendland kernel or a little smoothing would not"
    )


def _too_flat(ready: PreparedPoints, kernel: type[AbstractKernel]) -> str:
    return (
        f"the {kernel.name} kernel with support {ready.support:.6g} is too flat for these {ready.count} control "
        f"points: the system is singular to working precision (closest are {ready.closest}). Use a smaller "
        "support, a Wendland kernel, or a little smoothing."
    )


# Where points have moved since a matrix was factored its residual is a little larger; beyond this share of the
# allowed one it is factored again.
_UPDATED = 1e-2


def _solve_factored(
    ready: PreparedPoints,
    d: NDArray[np.float64],
    nugget: NDArray[np.float64],
    scales: NDArray[np.float64] | None,
    turn: NDArray[np.float64],
    kernel: type[AbstractKernel],
    most: float,
) -> tuple[Solved, NDArray[np.float64]]:
    """The fit by a factored matrix, a cached one where that is exact enough, and the origin of its places."""

    def solve_by(matrix: Matrix, origin: NDArray[np.float64]) -> Solved:
        x = (ready.targets - origin) / ready.support
        if kernel.order:
            return solve_bordered(x, d, matrix, ready.span, turn, order=kernel.order, trend=ready.trend)
        return solve_factored(x, d, matrix, ready.span, turn, is_skew=scales is not None, trend=ready.trend)

    matrix, origin = matrix_of(ready, nugget, scales, kernel)
    if ready.trend == "quadratic":  # its penalty is that of centred points
        origin = ready.origin
    solved = solve_by(matrix, origin)
    if matrix.is_updated and not np.abs(solved.miss).max() <= _UPDATED * most:
        origin = ready.origin
        solved = solve_by(factor_matrix(ready, nugget, kernel), origin)
    return solved, origin


# Nobody enlarges ten times by dragging points; points 1/1000 off a line were seen to require 25 to 3600 times.
STEEP = 10.0

_COLLAPSES = {
    "affine": "the trend collapses everything to one place",
    "affine_exact": "the trend collapses everything to one place",
    "quadratic": "the trend collapses everything to one place",
    "similarity": "the trend collapses everything to one place",
    "rigid": "the rotation is undetermined and stays as it was",
}


def _warnings(fit: RBFInterpolant) -> tuple[str, ...]:
    """Notes on a fit that is valid but probably a mistake: collapsed trends and crossing points."""
    targets, displacements = fit.prescribed_displacements()
    sources, map_linear = targets + displacements, np.eye(fit.dim) + np.asarray(fit.polynomial.linear) / fit.support
    torn = torn_pairs(targets, sources, fit.ids)
    crossed = [
        pair
        for pair in crossing_pairs(targets, sources, fit.ids, map_linear)
        if pair not in torn and _folds_between(fit, *(targets[fit.ids.index(i)] for i in pair))
    ]
    number = dict(zip(fit.ids, fit.of_points.numbers or range(1, len(fit.ids) + 1), strict=True))
    notes = [
        f"control points {number[i]} and {number[j]} share a source and have different targets: "
        "the map folds between them"
        for i, j in torn
    ]
    notes += [
        f"control points {number[i]} and {number[j]} are pulled past each other: the map folds there"
        for i, j in crossed
    ]
    is_plain = fit.trend == "affine_exact" or (fit.trend in ("affine", "quadratic") and fit.kernel.order >= 2)
    if is_plain and np.linalg.norm(map_linear, 2) > STEEP:
        notes.append(
            f"the affine trend stretches more than {STEEP:g} times: the control points nearly lie on one line or in "
            "one plane; the trend similarity would not"
        )
    spread = [spread_of(places) for places in (sources, targets)]
    if fit.trend in _COLLAPSES and spread[0] < NO_ANGLE * spread[1]:
        notes.append(f"the sources nearly coincide: {_COLLAPSES[fit.trend]}")
    elif is_plain and np.linalg.cond(map_linear) > 1 / NO_ANGLE:
        notes.append(
            "the sources lie on one line or in one plane and the targets do not: the affine trend presses "
            "everything flat"
        )
    return tuple(notes)


# Places on the line from one point to another at which the determinant is computed.
_BETWEEN = (np.arange(16) + 0.5) / 16


def _folds_between(fit: RBFInterpolant, first: NDArray[np.float64], second: NDArray[np.float64]) -> bool:
    """Check for ``det(1 + dD/dx) <= 0`` on the straight way between two places."""
    places = first + _BETWEEN[:, None] * (second - first)
    return bool((np.linalg.det(np.eye(fit.dim) + fit.jacobian(places)) <= 0).any())


def _rotation_of(fit: RBFInterpolant) -> NDArray[np.float64]:
    """The turn of a fit's trend, or no turn."""
    m = np.eye(fit.dim) + np.asarray(fit.polynomial.linear) / fit.support
    u, _, vt = np.linalg.svd(m)
    r = u @ vt
    return r if np.linalg.det(r) > 0 else np.eye(fit.dim)

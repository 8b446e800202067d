"""Kriging uncertainty of a fit: the inverse of its linear system, weights of control points, variance between them.

An interpolant of radial functions is the mean of a Gaussian process with the same kernel ("kriging"), its trend a mean
of unknown parameters. With K = Phi + diag(lambda / w), P the polynomials that the system itself carries (ones; for
kernels of order 2 and more linear functions too, and with the trend "quadratic" products of coordinates), and

    [K, P; P^T, 0]^-1 = [C, W; W^T, Q]

the coefficients are ``alpha = C (d - X A^T)``, and the variance that is left at x is, up to the scale sigma^2,
``phi(0) - k^T C k - 2 p^T W^T k - p^T Q p``, with k the kernel values and p the polynomials at x. A trend whose linear
part A is found in a second step (affine, similarity, rigid) adds what its generators leave open: the trend is replaced
by its tangent at the solution, which is exact for an affine one.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import scipy
from deformnb._jax import float64, jit, jnp, lax
from deformnb._typing import Floats
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import PreparedPoints, prepare
from deformnb.rbf.evaluation import capacity, few_sizes
from deformnb.rbf.fitting import fit_one_system
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.kernels import AbstractKernel, KernelName
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import Span, TrendName, find_trend, products

_BLOCK = 1024  # places at a time: with 32 points their kernel values stay in the second-level cache


@dataclass(frozen=True, eq=False)
class FitSystem:
    """A fit together with the inverse of its matrix.

    Parameters
    ----------
    fit : the solved interpolant; ready : its points, merged and centred.
    x, d : (n, dim) targets and displacements in units of the support.
    phi : (n, n) kernel values; nugget : (n,) lambda / weight.
    energy : C (n, n) above; the plain inverse where there is no polynomial or points have individual radii.
    weights : W (n, p); rest : Q (p, p).
    kept : (n,) mask, false for points left out by :meth:`leave_out`.
    """

    fit: RBFInterpolant
    ready: PreparedPoints
    x: Floats
    d: Floats
    phi: Floats
    nugget: Floats
    energy: Floats
    weights: Floats
    rest: Floats
    kept: NDArray[np.bool_]

    @property
    def count(self) -> int:
        """Number of different places."""
        return len(self.x)

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return int(self.x.shape[1])

    @property
    def has_second_step(self) -> bool:
        """True if the linear part of the trend is not part of the system itself."""
        return self.fit.kernel.order < 2 and self.ready.trend not in ("none", "translation", "quadratic")

    @property
    def has_own_radii(self) -> bool:
        """True if points have individual support radii: no energy, a trend of least squares."""
        return self.fit.scales is not None

    @property
    def free_parameters(self) -> int:
        """Number of parameters that the trend takes from the points."""
        dim, rank = self.dim, self.ready.span.basis.shape[1]
        turns = dim * (dim - 1) // 2 - (dim == 3 and rank == 1)  # about the line of all points nothing is known
        if self.ready.trend == "quadratic":
            assert self.ready.span.quadrics is not None
            return dim + dim * rank + dim * int(self.ready.span.quadrics.shape[1])
        return {
            "none": 0,
            "translation": dim,
            "rigid": dim + turns,
            "similarity": dim + turns + 1,
            "affine": dim + dim * rank,
            "affine_exact": dim + dim * rank,
        }[self.ready.trend]

    @property
    def gram(self) -> Floats:
        """Measure of a trend's energy: C, or the plain mean removed with individual radii."""
        if not self.has_own_radii:
            return self.energy
        kept = self.kept.astype(float)
        return np.diag(kept) - np.outer(kept, kept) / kept.sum()

    def leave_out(self, k: int) -> FitSystem:
        """The system of all points but one, by a change of rank one; for the errors of the rest, not for a new fit.

        Its arrays have the same size: the row and the column of a point that is out are zero, and ``kept`` marks it.
        """
        c, kept = self.energy, self.kept.copy()
        energy = scipy.linalg.blas.dger(-1 / c[k, k], c[:, k], c[k], a=np.array(c, order="F"), overwrite_a=1)
        energy[k], energy[:, k], kept[k] = 0.0, 0.0, False
        return replace(self, energy=energy, kept=kept)


def fit_system(
    points: ControlPoints,
    *,
    kernel: KernelName | str = "wendland_c2",
    support: float | None = None,
    trend: TrendName = "affine",
    smoothing: float = 0.0,
) -> FitSystem:
    """Fit points as :func:`~deformnb.rbf.fitting.fit_rbf` does, and store the inverse of the system.

    Raises
    ------
    DeformError
        Where the fit does; if no point is active; if the system is singular to working precision.
    """
    fit = fit_one_system(points, kernel=kernel, support=support, trend=trend, smoothing=smoothing)
    if not int(fit.count):
        raise DeformError("there is no active control point to judge a fit by; add or switch on some.")
    ready = prepare(points, fit.kernel, float(fit.support), find_trend(trend), smoothing)
    ready = replace(ready, origin=np.asarray(fit.origin))
    x, d = ready.relative, ready.displacements / ready.support
    scales = None if fit.scales is None else np.asarray(fit.scales)[: len(x)]
    phi = kernel_values(fit.kernel, x, x, scales)
    nugget = smoothing / ready.weights
    matrix = phi.copy()
    matrix.flat[:: len(x) + 1] += nugget
    try:
        inverse = _inverse(matrix, _polynomials(x, ready.span, np), fit.kernel.order, ready.trend, scales is not None)
    except np.linalg.LinAlgError:
        raise DeformError(
            f"the {fit.kernel.name} kernel with support {ready.support:.6g} is too flat for these "
            f"{len(x)} control points to be inverted (closest are {ready.closest}). Use a smaller "
            "support, a Wendland kernel, or a little smoothing."
        ) from None
    return FitSystem(fit, ready, x, d, phi, nugget, *inverse, np.ones(len(x), dtype=bool))


def kernel_values(kernel: type[AbstractKernel], x: Floats, centers: Floats, scales: Floats | None = None) -> Floats:
    """Phi at relative places x (m, dim) for centres (n, dim): (m, n)."""
    with float64():
        return np.asarray(
            _kernel_values(x, centers, np.ones(len(centers)) if scales is None else scales, kernel=kernel)
        )


def _values(x: Any, centers: Any, scales: Any, *, kernel: type[AbstractKernel]) -> Any:
    # Differences, not |x|^2 - 2 x c + |c|^2, which leaves 1e-8 of a distance where a kernel has a kink.
    s = sum((x[:, None, k] - centers[None, :, k]) ** 2 for k in range(x.shape[1]))
    return kernel.profile(s * scales**2)


_kernel_values = jit(_values, static_argnames="kernel")


def _polynomials(x: Any, span: Span, xp: Any) -> Any:
    """Ones, the places x (n, dim) on the span of the points and, with the trend "quadratic", their products."""
    columns = [xp.ones((len(x), 1)), x @ span.basis]
    if span.quadrics is not None:
        columns.append(products(x, xp) @ span.quadrics)
    return xp.concatenate(columns, axis=1)


def _inverse(matrix: Floats, p: Floats, order: int, trend: str, is_skew: bool) -> tuple[Floats, Floats, Floats]:
    """C, W and Q of the module's formula; ``p`` (n, k) are the polynomials of :func:`_polynomials`."""
    n = len(matrix)
    if is_skew:
        return np.asarray(scipy.linalg.inv(matrix, overwrite_a=True)), np.zeros((n, 0)), np.zeros((0, 0))
    if order >= 2 or trend == "quadratic":
        bordered = np.block([[matrix, p], [p.T, np.zeros((p.shape[1],) * 2)]])
        whole = scipy.linalg.inv(bordered, overwrite_a=True)
        whole = (whole + whole.T) / 2
        return whole[:n, :n], whole[:n, n:], whole[n:, n:]
    # A constant added to a kernel of order 1 makes it definite and changes nothing but Q.
    lift = 2 * float(np.abs(matrix).max()) if order == 1 else 0.0
    factor, failed = scipy.linalg.lapack.dpotrf(matrix + lift, lower=1, overwrite_a=1)
    if failed:
        raise np.linalg.LinAlgError
    half = scipy.linalg.lapack.dpotri(factor, lower=1, overwrite_c=1)[0]  # above the diagonal there are zeros
    inverse = half + half.T
    inverse.flat[:: n + 1] /= 2
    if trend == "none":
        return inverse, np.zeros((n, 0)), np.zeros((0, 0))
    v = inverse.sum(axis=1, keepdims=True)
    total = v.sum()
    return inverse - v * v.T / total, v / total, np.array([[lift - 1 / total]])


def process_scale(system: FitSystem) -> float:
    """Sigma of the Gaussian process by maximum likelihood with the trend's parameters counted off; NaN if none is left.

    In physical units: the standard deviation far from all points of the process without its trend, for kernels of
    order 0.
    """
    free = system.count * system.dim - system.free_parameters
    if free <= 0 or system.has_own_radii:
        return float("nan")
    alpha = np.asarray(system.fit.coefficients)[: system.count] / system.fit.support
    rest = system.d - system.x @ np.asarray(system.fit.polynomial.linear).T / system.fit.support
    return float(system.fit.support * np.sqrt(max(float((alpha * rest).sum()), 0.0) / free))


# ---- the uncertainty of the map --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Standard deviation of a map, of one component of its displacement, as a function of the place in the result.

    Parameters
    ----------
    system : the fit with its inverse.
    sigma : scale of the process, physical units.
    open : Q (dim, dim) weights of the error of the trend at a place; None for trends without a linear part.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [10, 0], [0, 10], [10, 10]], [[0, 0], [10, 0], [0, 10], [11, 12]])
    >>> known = uncertainty(points)
    >>> bool(known.at([[11.0, 12.0]])[0] < 1e-6 < known.at([[5.0, 5.0]])[0] < known.at([[40.0, 5.0]])[0])
    True
    """

    system: FitSystem
    sigma: float
    open: Floats | None

    @property
    def dim(self) -> int:
        """2 in the plane, 3 in space."""
        return self.system.dim

    def at(self, points: ArrayLike) -> Floats:
        """Standard deviations (...) at points (..., dim), in the unit of the volume."""
        x = np.asarray(points, dtype=np.float64)
        if x.shape[-1:] != (self.dim,):
            raise DeformError(f"points must have shape (..., {self.dim}), got {x.shape}.")
        relative = ((x - self.system.ready.origin) / self.system.ready.support).reshape(-1, self.dim)
        return (self.sigma * np.sqrt(self._variance(relative))).reshape(x.shape[:-1])

    def lattice_values(self, rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float32]:
        """Standard deviations (R, C) at all points ``rows[:, r] + columns[:, c]`` of lines (dim, R) and (dim, C)."""
        places = np.asarray(rows, dtype=np.float64)[:, :, None] + np.asarray(columns, dtype=np.float64)[:, None, :]
        return self.at(np.moveaxis(places, 0, -1)).astype(np.float32)

    def _variance(self, x: Floats) -> Floats:
        """The remaining variance at relative places (m, dim), in units of sigma^2."""
        s, m = self.system, len(x)
        n, blocks = s.count, max(1, few_sizes(-(-m // _BLOCK)))
        places = np.zeros((blocks * _BLOCK, self.dim))
        places[:m] = x
        size = capacity(n)
        centers, energy = np.zeros((size, self.dim)), np.zeros((size, size))
        weights = np.zeros((size, len(s.rest)))
        centers[:n], energy[:n, :n], weights[:n] = s.x, s.energy, s.weights
        missed = np.zeros((self.dim, self.dim)) if self.open is None else self.open / self.dim
        with float64():
            found = _variances(
                places.reshape(blocks, _BLOCK, self.dim),
                centers,
                energy,
                weights,
                s.rest,
                s.ready.span,
                missed,
                kernel=s.fit.kernel,
            )
        return np.asarray(found).ravel()[:m]


def _variances_of(
    blocks: Any,
    centers: Any,
    energy: Any,
    weights: Any,
    rest: Any,
    span: Span,
    missed: Any,
    *,
    kernel: type[AbstractKernel],
) -> Any:
    """The module's formula; padded centres have zeros in all matrices and so no effect."""

    def block_variances(x: Any) -> Any:
        k = _values(x, centers, 1.0, kernel=kernel)
        pull = k @ energy
        p = _polynomials(x, span, jnp)[:, : len(rest)]
        known = (pull * k).sum(axis=1) + (p * (2 * k @ weights + p @ rest)).sum(axis=1)
        off = x - (pull + p @ weights.T) @ centers
        return jnp.maximum(kernel.profile(0.0 * x[0, 0]) - known + ((off @ missed) * off).sum(axis=1), 0.0)

    return lax.map(block_variances, blocks)


_variances = jit(_variances_of, static_argnames="kernel")


def uncertainty(
    points: ControlPoints,
    *,
    kernel: KernelName | str = "wendland_c2",
    support: float | None = None,
    trend: TrendName = "affine",
    smoothing: float = 0.0,
    sigma: float | None = None,
) -> Uncertainty:
    """Uncertainty of the map of control points: the deviation of the Gaussian process with the same kernel.

    It is zero at the points (without smoothing) and grows away from them; where it is large, the map is only a guess
    that the kernel makes. Across points on one line, or in one plane of space, the trend's own deviation is not
    counted. Radii of single points are left aside: the common support is taken.

    Parameters
    ----------
    points, kernel, support, trend, smoothing : as for :func:`~deformnb.rbf.fitting.fit_rbf`.
    sigma : scale of the process, physical; default is the likeliest one. Zero where nothing bends.

    Raises
    ------
    DeformError
        Where the fit does, and if there are too few points to estimate a scale.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [10, 0], [0, 10], [10, 10]], [[0, 0], [12, 0], [0, 10], [10, 11]])
    >>> spread = uncertainty(points)
    >>> bool(spread.at([[10.0, 11.0]]) < spread.at([[5.0, 5.0]]))
    True
    """
    if sigma is not None and not 0 <= sigma < np.inf:
        raise DeformError(f"sigma must be 0 or a positive length, got {sigma}.")
    if points.has_own_radii:
        points = replace(points, radius=np.full(len(points), np.nan))
    system = fit_system(points, kernel=kernel, support=support, trend=trend, smoothing=smoothing)
    scale = process_scale(system) if sigma is None else float(sigma)
    if not scale >= 0:
        least = system.free_parameters // system.dim + 1
        raise DeformError(
            f"{system.count} control point(s) give no estimate of the error of the map, for the trend "
            f"{system.ready.trend!r} takes all their freedom; have at least {least}, or give sigma."
        )
    return Uncertainty(system, scale, _open_part(system))


def _open_part(system: FitSystem) -> Floats | None:
    """Variance left open by the trend's linear part: sum over its generators L_m of G^-1_ml L_m^T L_l, relative."""
    if not system.has_second_step:
        return None
    generators = _generators(system)
    s = system.x.T @ system.energy @ system.x
    if system.ready.trend == "affine":
        s = s + np.trace(s) * system.ready.span.ridge
    gram = np.einsum("mab,bc,lac->ml", generators, s, generators)
    inverse = np.linalg.pinv(gram, rcond=1e-12, hermitian=True)  # a turn about the line of all points is not open
    return np.asarray(np.einsum("ml,mab,lac->bc", inverse, generators, generators))


def _generators(system: FitSystem) -> Floats:
    """The directions (m, dim, dim) in which the linear part of the trend can change at its solution."""
    dim, basis = system.dim, system.ready.span.basis
    if system.ready.trend.startswith("affine"):
        return np.einsum("ma,kb->mbak", np.eye(dim), basis).reshape(-1, dim, dim)
    linear = np.eye(dim) + np.asarray(system.fit.polynomial.linear) / system.fit.support
    pairs = [(a, b) for a in range(dim) for b in range(a)]
    skew = np.zeros((len(pairs), dim, dim))
    for m, (a, b) in enumerate(pairs):
        skew[m, a, b], skew[m, b, a] = 1.0, -1.0
    turns = skew @ linear
    return np.concatenate([turns, linear[None]]) if system.ready.trend == "similarity" else turns

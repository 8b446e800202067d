"""Prediction errors of places that a fit has not seen: single points left out, and all points around a place.

With C the inverse of Phi + nugget, projected off the polynomials of the trend, the errors at a set B of points
that are left out together are ``(C_BB)^-1 (C d)_B``: one inverse gives them all, where a fit for each would cost N
times as much (S. Rippa, Adv. Comput. Math. 11 (1999) 193-210, for single points; blocks by the inverse of a partitioned
matrix).

A point that is left out alone has its next neighbour at the usual distance. Places that no point is near, between
clusters and in holes, are farther away, and leaving out all within :func:`balls_of` of a point approximates them
(K. Le Rest et al., Glob. Ecol. Biogeogr. 23 (2014) 811-820). Balls rotate with the points and ignore their order;
blocks of a raster would not.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import scipy
from deformnb._typing import Floats
from deformnb.rbf.conditioning import SAME_DISTANCE
from deformnb.rbf.factors import kernel_values
from deformnb.rbf.kernels import AbstractKernel
from deformnb.rbf.trends import FLAT, TRENDS, Span, plain_moments, products, spread_of

Positions = NDArray[np.intp]

MOST_LEFT_OUT = 512
"""Points that are left out of a larger set, about: leaving out costs N^3 too."""

# Ratio of the diagonal entries of a Cholesky factor below which its matrix is singular to working precision.
_SINGULAR = 1e-7
# Ratio of the eigenvalues of a block of C below which the points that remain leave a polynomial open.
_OPEN = 1e-12


def parameters_of(trend: str, dim: int) -> int:
    """Number of points that determine an affine trend, or the quadratic one where that is required."""
    return (dim + 1) * (dim + 2) // 2 if trend == "quadratic" else dim + 1


def leave_one_out(x: Floats, d: Floats, kernel: type[AbstractKernel], trend: str, nugget: Floats) -> Floats:
    """Leave-one-out errors (n, dim) of displacements d (n, dim) at places x (n, dim), all in units of the support.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is singular to working precision.
    """
    return _single_errors(*_reduce(x, d, kernel, trend, nugget))


def leave_block_out(
    x: Floats, d: Floats, kernel: type[AbstractKernel], trend: str, nugget: Floats, blocks: Sequence[Positions]
) -> list[Floats]:
    """Errors (k, dim) of the points of each block (k positions), which are left out together.

    They are NaN where the points that remain do not determine the polynomials of the trend.

    Examples
    --------
    >>> from deformnb.rbf.kernels import WendlandC2
    >>> x = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1], [0.5, 0.4]])
    >>> d = np.array([[0.0, 0], [0, 0], [0, 0], [0, 0], [0.1, 0]])
    >>> single = leave_one_out(x, d, WendlandC2, "affine", np.zeros(5))
    >>> blocks = leave_block_out(x, d, WendlandC2, "affine", np.zeros(5), [np.array([4]), np.array([4, 3])])
    >>> bool(np.allclose(blocks[0], single[4:])), len(blocks[1])
    (True, 2)
    """
    c, d = _reduce(x, d, kernel, trend, nugget)
    return _block_errors(c, c @ d, blocks)


def prediction_errors(
    x: Floats, d: Floats, kernel: type[AbstractKernel], trend: str, nugget: Floats, balls: Sequence[Positions]
) -> Floats:
    """Lengths (n, 2) of the errors of each point, left out alone and with its ball; NaN where that is empty.

    Raises
    ------
    numpy.linalg.LinAlgError
        If the matrix is singular to working precision.
    """
    c, d = _reduce(x, d, kernel, trend, nugget)
    lengths = np.full((len(x), 2), np.nan)
    lengths[:, 0] = np.linalg.norm(_single_errors(c, d), axis=1)
    for k, error in enumerate(_block_errors(c, c @ d, balls)):
        if len(error):
            lengths[k, 1] = np.linalg.norm(error[0])
    return lengths


def _single_errors(c: Floats, d: Floats) -> Floats:
    diagonal = np.maximum(c.diagonal(), _SINGULAR * c.diagonal().max())
    return np.asarray(c @ d / diagonal[:, None])


def _block_errors(c: Floats, cd: Floats, blocks: Sequence[Positions]) -> list[Floats]:
    sizes = np.array([len(block) for block in blocks], dtype=int)
    errors: list[Floats] = [cd[:0]] * len(blocks)
    for size in np.unique(sizes[sizes > 0]).tolist():  # those of one size together
        at = np.flatnonzero(sizes == size)
        rows = np.stack([blocks[k] for k in at.tolist()])
        inner = c[rows[:, :, None], rows[:, None, :]]
        values, vectors = np.linalg.eigh(inner)
        is_open = values[:, 0] <= _OPEN * np.abs(values[:, -1])
        with np.errstate(divide="ignore", invalid="ignore"):
            found = vectors @ ((np.swapaxes(vectors, 1, 2) @ cd[rows]) / values[:, :, None])
        found[is_open] = np.nan
        for k, error in zip(at.tolist(), found, strict=True):
            errors[k] = error
    return errors


def _reduce(x: Floats, d: Floats, kernel: type[AbstractKernel], trend: str, nugget: Floats) -> tuple[Floats, Floats]:
    """The matrix C (n, n), and displacements d (n, dim) of which C d are the coefficients of the fit.

    The polynomials are linear ones for affine trends, else constants. The similarity and rigid trends of least squares
    are taken out of the displacements before, once for all points; :func:`deformnb.analysis.quality.fit_quality` does
    it for each.
    """
    n, dim = x.shape
    phi = kernel_values(x, x, kernel)
    phi.flat[:: n + 1] += nugget
    if trend in ("similarity", "rigid"):
        rule, moments = TRENDS[trend].linear, plain_moments(x, d, np.ones((n, 1)))
        assert rule is not None
        with np.errstate(all="ignore"):
            map_linear = rule(*moments, Span(np.eye(dim), np.zeros((dim, dim))), np.eye(dim))
        d = d - (x - x.mean(axis=0)) @ (map_linear - np.eye(dim)).T
    p = polynomials_of(x, trend)
    if kernel.order >= 2:
        whole = np.linalg.inv(np.block([[phi, p], [p.T, np.zeros((p.shape[1],) * 2)]]))[:n, :n]
        return whole, d
    # A constant added to a kernel of order 1 makes it definite and changes nothing else.
    factor = scipy.linalg.cho_factor(phi + (2 * np.abs(phi).max() if kernel.order else 0.0), lower=True)
    if factor[0].diagonal().min() < _SINGULAR * factor[0].diagonal().max():
        raise np.linalg.LinAlgError
    whole = scipy.linalg.cho_solve(factor, np.eye(n))
    if p.shape[1]:
        w = whole @ p
        whole = whole - w @ np.linalg.solve(p.T @ w, w.T)
    return whole, d


def polynomials_of(x: Floats, trend: str) -> Floats:
    """An orthonormal basis (n, r) of the polynomials of a trend at places x (n, dim): those that these distinguish.

    These are found by the singular values, of the products of two coordinates after the affine ones, so that
    neither the axes nor the unit have a share in it.
    """
    n = len(x)
    one = np.full((n, 1), n**-0.5)
    if not trend.startswith("affine") and trend != "quadratic":
        return one[:, : trend != "none"]
    centred = x - x.mean(axis=0)
    p = np.concatenate([one, _basis_of(centred)], axis=1)
    if trend == "quadratic":
        q = products(centred)
        size = float(np.linalg.norm(q))
        rest = q - p @ (p.T @ q)
        p = np.concatenate([p, _basis_of(rest - p @ (p.T @ rest), size)], axis=1)
    return p


def _basis_of(columns: Floats, size: float | None = None) -> Floats:
    """An orthonormal basis of the span of columns (n, k); none where they are rounding of what had this norm."""
    u, sigma, _ = np.linalg.svd(columns, full_matrices=False)
    least = FLAT * (sigma[0] if len(sigma) else 0.0)
    return np.asarray(u[:, sigma > max(least, FLAT * (size or 0.0))])


# ---- points left out ------------------------------------------------------------------------------------------------


def gap_of(x: Floats) -> float:
    """The smallest distance at which places (n, dim) hang together: the longest edge of their shortest tree (Prim).

    Every split of the places in two has a pair across it that is no farther apart, and one has none that is nearer.
    """
    size = spread_of(x)
    if size == 0.0:
        return 0.0
    x = (x - x.mean(axis=0)) / size  # squares of tiny lengths would be zero
    near, longest = np.linalg.norm(x - x[0], axis=1), 0.0
    waiting = np.ones(len(x), dtype=bool)
    waiting[0] = False
    for _ in range(len(x) - 1):
        k = int(np.where(waiting, near, np.inf).argmin())
        longest = max(longest, float(near[k]))
        waiting[k] = False
        near = np.minimum(near, np.linalg.norm(x - x[k], axis=1))
    return size * longest


def balls_of(x: Floats, least: int) -> list[Positions]:
    """For each of n places those within half of :func:`gap_of` of it, itself first; none where there are no others.

    A place in the middle of the widest gap is as far from all points. At least ``least`` places stay: a ball that would
    leave fewer is smaller, and points equally far from its middle are in it or not together.
    """
    reach = 0.5 * gap_of(x) * (1 + SAME_DISTANCE)
    most = len(x) - least
    balls = []
    for k in range(len(x)):
        row = np.linalg.norm(x - x[k], axis=1)
        within = row <= reach
        if most < 2:
            within[:] = False
        elif np.count_nonzero(within) > most:
            within = row < np.partition(row, most)[most] * (1 - SAME_DISTANCE)
        others = np.flatnonzero(within)
        others = others[others != k]
        balls.append(np.concatenate([[k], others] if len(others) else [others]).astype(np.intp))
    return balls


def sample_of(x: Floats, most: int = MOST_LEFT_OUT) -> Positions:
    """About ``most`` of the places x (n, dim), spread over all, in any order and for any axes; all where few.

    They are taken by their distance from the centroid, every so-manyth; points equally far, such as the eight nodes of
    a grid that its symmetries exchange, are taken together. There are none of places more than twice as many as given
    for that are all equally far (a ring, a ball's surface).
    """
    n = len(x)
    if n <= most:
        return np.arange(n)
    distance = np.linalg.norm((x - x.mean(axis=0)) / (spread_of(x) or 1.0), axis=1)
    order = np.argsort(distance, kind="stable")
    ranked = distance[order]
    group = np.concatenate([[0], np.cumsum(np.diff(ranked) > SAME_DISTANCE * ranked[-1])])
    sizes, taken, passed = np.bincount(group), 0, []
    for size, end in zip(sizes.tolist(), np.cumsum(sizes).tolist(), strict=True):
        passed.append(taken + size / 2 <= end * most / n)
        taken += size if passed[-1] else 0
    return np.sort(order[np.array(passed)[group]])

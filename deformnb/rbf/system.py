"""Linear systems of a fit: compiled and differentiable for every kernel; by a factored matrix for orders 0 to 2.

Coordinates are relative to the support radius. All components of the displacement share one matrix.
"""

from __future__ import annotations

import contextlib
from typing import Any, NamedTuple

import numpy as np

from deformnb._jax import jax, namespace_of
from deformnb._typing import Floats
from deformnb.rbf.factors import Matrix
from deformnb.rbf.kernels import AbstractKernel
from deformnb.rbf.trends import TRENDS, Span, complete, plain_moments, products, quadratic_forms, regularize_moments


class Solved(NamedTuple):
    """A solved fit in relative coordinates.

    Parameters
    ----------
    alpha (C, dim), linear A (dim, dim), constant t (dim,); miss (C, dim), the residual of the conditions, zero but for
    rounding; quadratic (dim, dim, dim), the matrices H_m of the trend "quadratic", else None.
    """

    alpha: Any
    linear: Any
    constant: Any
    miss: Any
    quadratic: Any = None


def solve(
    x: Any,
    d: Any,
    active: Any,
    nugget: Any,
    span: Span,
    turn: Any,
    scales: Any = None,
    *,
    kernel: type[AbstractKernel],
    trend: str,
) -> Solved:
    """The fit as a pure, differentiable function of relative targets x (C, dim) and displacements d (C, dim).

    ``active`` (C,) masks the padding, ``nugget`` (C,) is lambda / weight, ``span`` the part that the centred points
    determine, ``turn`` is the rotation to fall back on, ``scales`` (C,) are support / R_j where points have radii of
    their own. Arrays of NumPy are solved by NumPy, for a built-in kernel; it raises a LinAlgError where there is no
    solution, and JAX returns NaN.
    """
    xp = namespace_of(x, d, nugget)
    both = active[:, None] & active[None, :]
    s = sum((x[:, None, k] - x[None, :, k]) ** 2 for k in range(x.shape[1]))
    s = s if scales is None else s * scales**2
    values = kernel.profile(s) if xp is np else kernel.of_square(s)
    phi = xp.where(both, values, 0.0) + xp.diag(xp.where(active, nugget, 1.0))
    one = active.astype(x.dtype)[:, None]
    c, q, whole = None, None, d
    if trend == "quadratic":
        q = products(x, xp)
        if kernel.order < 3:
            c, trend = _quadratic_part(phi, x, d, q, one, span, scales is not None), "affine"
            d = d - q @ c
    if scales is not None:
        alpha, linear, constant = _least_squares(phi, x, d, one, span, turn, trend)
    elif kernel.order == 3:
        assert q is not None
        alpha, linear, constant, c = _bordered_system(phi, x, d, one, span.basis, q, span.quadrics)
    elif kernel.order == 2:
        alpha, linear, constant, _ = _bordered_system(phi, x, d, one, span.basis)
    elif TRENDS[trend].linear is None:
        alpha, linear, constant = _inverse_of(phi)(d), xp.zeros((x.shape[1],) * 2), xp.zeros(x.shape[1])
    else:
        alpha, linear, constant = _least_energy(phi, x, d, one, span, turn, kernel, trend)
    bent = 0.0 if c is None else q @ c
    miss = one * (phi @ alpha + x @ linear.T + constant + bent - whole)
    return Solved(alpha, linear, constant, miss, None if c is None else quadratic_forms(c, x.shape[1]))


def _quadratic_part(phi: Any, x: Any, d: Any, q: Any, one: Any, span: Span, is_skew: bool) -> Any:
    """C (q, dim) of least energy relative to all affine maps, ``(S + tr(S) bend)^-1 Q^T W d`` with ``S = Q^T W Q``.

    W is the energy matrix with the affine maps removed; where Phi is not symmetric, the plain projection. Zero where
    the points determine none of it: S and its trace would be rounding, and C any number.
    """
    xp = namespace_of(phi, d)
    if _is_open(span):
        return xp.zeros((q.shape[1], d.shape[1]))
    p = xp.concatenate([one, x @ span.basis], axis=1)
    both = xp.concatenate([q, d], axis=1)
    if is_skew:
        w = both - p @ xp.linalg.lstsq(p, both, rcond=None)[0]
    else:
        border = xp.zeros((p.shape[1],) * 2)
        bordered = xp.block([[phi, p], [p.T, border]])
        w = xp.linalg.solve(bordered, xp.concatenate([both, xp.zeros((p.shape[1], both.shape[1]))]))[: len(x)]
    count = q.shape[1]
    s, h = q.T @ w[:, :count], q.T @ w[:, count:]
    size = xp.trace(s)
    held = s if span.bend is None else s + xp.where(size > 0, size, 1.0) * span.bend
    return xp.linalg.solve(held, h)


def _is_open(span: Span) -> bool:
    """Check that the points determine no quadratic trend at all."""
    return span.quadrics is not None and span.quadrics.shape[1] == 0


def _inverse_of(phi: Any) -> Any:
    if namespace_of(phi) is np:
        return lambda b: np.linalg.solve(phi, b)
    factor = jax.scipy.linalg.cho_factor(phi, lower=True)
    return lambda b: jax.scipy.linalg.cho_solve(factor, b)


def _least_energy(
    phi: Any, x: Any, d: Any, one: Any, span: Span, turn: Any, kernel: type[AbstractKernel], trend: str
) -> tuple[Any, Any, Any]:
    """Alpha = W (d - A x), t = mean(d) - A mean(x), with the A of least energy; ``mean`` is kriging's."""
    xp, dim = namespace_of(phi, d), x.shape[1]
    rhs = xp.concatenate([x, d], axis=1)
    if kernel.order == 0:
        v = _inverse_of(phi)(xp.concatenate([one, rhs], axis=1))
        mean = (one.T @ v[:, 1:]) / (one.T @ v[:, :1])
        w = v[:, 1:] - v[:, :1] * mean
    else:  # Phi is not definite: only the bordered system is well posed
        bordered = xp.block([[phi, one], [one.T, xp.zeros((1, 1))]])
        v = xp.linalg.solve(bordered, xp.concatenate([rhs, xp.zeros((1, 2 * dim))]))
        w, mean = v[:-1], v[-1:]
    wx, wd = w[:, :dim], w[:, dim:]
    s = x.T @ wx
    linear = _linear_part((s, s + d.T @ wx), plain_moments(x, d, one), span, turn, trend=trend)
    return wd - wx @ linear.T, linear, mean[0, dim:] - linear @ mean[0, :dim]


def _linear_part(moments: tuple[Any, Any], plain: tuple[Any, Any], span: Span, turn: Any, *, trend: str) -> Any:
    """A (dim, dim) of a trend from the moments S and H of the energy, and those of all points with equal weights."""
    rule = TRENDS[trend].linear
    assert rule is not None
    if trend == "affine":
        moments = regularize_moments(moments, plain, span.ridge)
    return rule(*moments, span, turn) - np.eye(len(turn))


def _least_squares(phi: Any, x: Any, d: Any, one: Any, span: Span, turn: Any, trend: str) -> tuple[Any, Any, Any]:
    """For a matrix that is not symmetric: the trend of least squares, and Phi alpha = its residual."""
    xp, dim, rule = namespace_of(phi, d), x.shape[1], TRENDS[trend].linear
    linear, constant = xp.zeros((dim, dim)), xp.zeros(dim)
    if rule is not None:
        mean_x, mean_d = (xp.sum(one * a, axis=0) / xp.sum(one) for a in (x, d))
        linear = rule(*plain_moments(x, d, one), span, turn) - xp.eye(dim)
        constant = mean_d - linear @ mean_x
    return xp.linalg.solve(phi, d - one * (x @ linear.T + constant)), linear, constant


def _bordered_system(
    phi: Any, x: Any, d: Any, one: Any, basis: Any, q: Any = None, quadrics: Any = None
) -> tuple[Any, Any, Any, Any]:
    """Eqs. 3-4 as printed, for kernels of order 2 and 3: [Phi P; P^T 0], P = (1, x on the span of the points).

    For order 3 P has the quadratic products ``q`` (C, k) too, in the combinations ``quadrics`` (k, r) that the points
    determine. Returns alpha, A, t, and their factors (k, dim) or None.
    """
    xp, n, (dim, rank) = namespace_of(phi, d), x.shape[0], basis.shape
    columns = [one, x @ basis]
    if q is not None:
        quadrics = xp.eye(q.shape[1]) if quadrics is None else quadrics
        columns.append(q @ quadrics)
    p = xp.concatenate(columns, axis=1)
    width = p.shape[1]
    whole = xp.block([[phi, p], [p.T, xp.zeros((width, width))]])
    factor = None if xp is np else jax.scipy.linalg.lu_factor(whole)

    def border(b: Any) -> Any:
        given = xp.concatenate([b, xp.zeros((width, dim))])
        return np.linalg.solve(whole, given) if factor is None else jax.scipy.linalg.lu_solve(factor, given)

    v, last = border(d), n + 1 + rank
    bent = None if q is None else quadrics @ v[last:]
    if rank == dim:
        return v[:n], v[n + 1 : last].T @ basis.T, v[n], bent
    linear = complete(basis + v[n + 1 : last].T, basis) - xp.eye(dim)
    # Points that are flat only to rounding are a little off their span, where the completed map displaces them too:
    # fit the residual. Its trend is of the size of that rounding, and is added.
    rest = border(d - x @ linear.T - (0.0 if q is None else q @ bent))
    bent = bent if q is None else bent + quadrics @ rest[last:]
    return rest[:n], linear + rest[n + 1 : last].T @ basis.T, rest[n], bent


# ---- matrices that are factored on the host --------------------------------------------------------------------------


def solve_factored(x: Floats, d: Floats, matrix: Matrix, span: Span, turn: Any, *, is_skew: bool, trend: str) -> Solved:
    """The fit of :func:`solve` for a kernel of order 0 by a matrix that is factored; NumPy, without padding.

    Parameters
    ----------
    is_skew : points have individual radii, so that the matrix is not symmetric.
    """
    n, dim = x.shape
    one, linear, constant = np.ones((n, 1)), np.zeros((dim, dim)), np.zeros(dim)
    bent, rest = None, d
    if trend == "quadratic":
        q = products(x)
        bent = _quadratic_of(x, d, q, span, None if is_skew else matrix)
        rest, trend = d - q @ bent, "affine"
    if trend == "none":
        alpha = matrix.solve(rest)
    elif is_skew:
        linear = _linear_on_host(x, rest, None, span, turn, trend)
        constant = rest.mean(axis=0) - linear @ x.mean(axis=0)
        alpha = matrix.solve(rest - x @ linear.T - constant)
    else:
        v = matrix.solve(np.concatenate([one, x, rest], axis=1))
        mean = v[:, 1:].sum(axis=0) / v[:, 0].sum()
        w = v[:, 1:] - v[:, :1] * mean
        s = x.T @ w[:, :dim]
        moments = s, s + rest.T @ w[:, :dim]
        linear = _linear_on_host(x, rest, moments, span, turn, trend)
        constant = mean[dim:] - linear @ mean[:dim]
        alpha = w[:, dim:] - w[:, :dim] @ linear.T
    miss = matrix.product(alpha) + x @ linear.T + constant - rest
    return Solved(alpha, linear, constant, miss, None if bent is None else quadratic_forms(bent, dim))


def solve_bordered(x: Floats, d: Floats, matrix: Matrix, span: Span, turn: Floats, *, order: int, trend: str) -> Solved:
    """The fit of :func:`solve` for a kernel of order 1 or 2 by a bordered matrix that is factored.

    Parameters
    ----------
    x : places from the origin of the matrix.
    trend : any but "quadratic".
    """
    n, dim = x.shape
    given = np.concatenate([d, np.zeros((dim + 1 if order == 2 else 1, dim))])
    if order == 2:
        v, miss = _refine(matrix, matrix.solve(given), given)
        return Solved(v[:n], v[n + 1 :].T, v[n], miss[:n])
    v = matrix.solve(np.concatenate([np.pad(x, ((0, 1), (0, 0))), given], axis=1))
    s = x.T @ v[:n, :dim]
    linear = _linear_on_host(x, d, (s, s + d.T @ v[:n, :dim]), span, turn, trend)
    given[:n] -= x @ linear.T
    found, miss = _refine(matrix, v[:, dim:] - v[:, :dim] @ linear.T, given)
    return Solved(found[:n], linear, found[n], miss[:n])


def _refine(matrix: Matrix, found: Floats, given: Floats) -> tuple[Floats, Floats]:
    """A solution and its residual; of points that have moved since they were factored with one step of refinement.

    The interpolant was wrong by 5e-11 of the extent of 220 thin-plate points without it.
    """
    miss = matrix.product(found) - given
    if matrix.is_updated:
        found = found - matrix.solve(miss)
        miss = matrix.product(found) - given
    return found, miss


def _linear_on_host(
    x: Floats, d: Floats, moments: tuple[Floats, Floats] | None, span: Span, turn: Floats, trend: str
) -> Floats:
    """As :func:`_linear_part` of arrays; without moments of an energy all points have equal weights."""
    if moments is not None and trend == "affine" and not span.ridge.any():  # of most fits; the rule is H S^-1 then
        with contextlib.suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.solve(moments[0], moments[1].T).T - np.eye(len(turn)))
    plain = plain_moments(x, d, np.ones((len(x), 1)))
    with contextlib.suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):
        return np.asarray(_linear_part(moments or plain, plain, span, turn, trend=trend))
    return np.full((len(turn),) * 2, np.nan)  # which the check of the residual finds


def _quadratic_of(x: Floats, d: Floats, q: Floats, span: Span, matrix: Matrix | None) -> Floats:
    """As :func:`_quadratic_part`; without a matrix the plain projection."""
    if _is_open(span):
        return np.zeros((q.shape[1], d.shape[1]))
    p = np.concatenate([np.ones((len(x), 1)), x @ span.basis], axis=1)
    both = np.concatenate([q, d], axis=1)
    if matrix is None:
        w = both - p @ np.linalg.lstsq(p, both, rcond=None)[0]
    else:
        v = matrix.solve(np.concatenate([p, both], axis=1))
        vp, w = v[:, : p.shape[1]], v[:, p.shape[1] :]
        w = w - vp @ np.linalg.solve(p.T @ vp, p.T @ w)
    s, h = q.T @ w[:, : q.shape[1]], q.T @ w[:, q.shape[1] :]
    size = float(np.trace(s))
    return np.asarray(np.linalg.solve(s if span.bend is None else s + (size if size > 0 else 1.0) * span.bend, h))

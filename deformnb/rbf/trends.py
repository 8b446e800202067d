"""Trends of a fit: the linear map that the kernels only correct.

A fit is ``T(x) = x + D(x) = trend(x) + sum_j alpha_j phi(|x - x_j|)``. Any trend plus the kernels of the residual
interpolates; the trend of least energy ``tr (Y - X M^T)^T W (Y - X M^T)`` is taken, where Y are the sources, X the
targets and W the energy matrix of the kernel (the inverse of Phi, with the mean removed). Both S = X^T W X and
H = Y^T W X are small, so every trend below is a closed form on matrices of dim x dim.

Points nearly on one line (in space: in one plane) determine an affine trend across it by their small offsets alone,
which would be magnified over the whole volume. The trend "affine" therefore shrinks to the similarity across the
directions in which the points are thin, :func:`thin_directions`; "affine_exact" is the paper's, Eqs. 3-4.

The trend "quadratic" adds ``q(x) C`` to the affine one, with q the products of two coordinates. C is the one of least
energy relative to all affine maps, and shrinks to zero in directions that the points hardly determine, such as that of
a conic through all of them; :func:`quadric_span`.

The similarity and rigid trends replace the paper's Eq. 5, whose printed system has more equations than unknowns; these
are its exact optima (S. Umeyama, IEEE PAMI 13 (1991) 376-380, with the dense weight W).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb._jax import jnp, lax, namespace_of, with_derivative
from deformnb.checks import short_value
from deformnb.errors import DeformError

# Below this share of the data's size a rotation has no angle (all handles share one source): reuse the last one.
NO_ANGLE = 1e-6

# Directions in which the points spread by less than this share of their length are thin: an affine trend is shrunk
# there, and from it on it is the plain one.
THIN = 0.25
_SURELY = 1 + 1e-6  # beyond rounding
_LEAST_MOMENT = 1e-280  # squares of tiny lengths have no digits
# Rate: the penalty on the departure of a thin direction from the similarity is, relative to the trace of S,
# ((THIN - spread) / spread)^2 / SOFTNESS. Of rows with one point dragged by a tenth of their length this value was
# tried and had det J above 0.3 next to them; smaller ones are nearer to a similarity.
SOFTNESS = 0.5
# Below this spread the similarity is reached to rounding; it makes the penalty finite.
LEAST_SPREAD = 1e-4
# The same limit for the quadratic part: the spread of the square of a direction that is just not thin.
THIN_BEND = THIN**2
# Ratio of singular values of the centred points below which they lie on a line or in a plane (independent of the axes).
FLAT = 1e-7


class Span(NamedTuple):
    """The span of a set of points: the part of a linear map that they determine.

    Parameters
    ----------
    basis : (dim, rank) orthonormal columns that span the centred targets.
    ridge : (dim, dim) penalty of the trend "affine" across the :func:`thin_directions`; zero where there are none.
    quadrics, bend : of :func:`quadric_span`, for the trend "quadratic"; None means all, and no penalty.
    """

    basis: Any
    ridge: Any
    quadrics: Any = None
    bend: Any = None


@dataclass(frozen=True)
class Trend:
    """One choice of trend.

    Parameters
    ----------
    name, title : in code and in menus.
    order : order of conditional positive definiteness of the kernels it can be paired with (see kernels).
    linear : function (S, H, span, previous) -> M, the linear part of T; None if there is no polynomial at all. That
        of "quadratic" is the one of what its quadratic part leaves.
    """

    name: str
    title: str
    order: int
    linear: Callable[[Any, Any, Any, Any], Any] | None


def _translation(s: Any, h: Any, span: Span, previous: Any) -> Any:
    return namespace_of(s).eye(s.shape[0], dtype=s.dtype)


def _affine(s: Any, h: Any, span: Span, previous: Any) -> Any:
    """M = G + (H - G S) (S + tr(S) ridge)^-1 with the similarity G; without a ridge that is H S^-1."""
    xp = namespace_of(s, h, span.ridge)
    rotation = nearest_rotation(_fix_row_rotation(h, xp.trace(s), span.ridge), xp.trace(s), previous)
    similar = xp.maximum(xp.sum(rotation * h) / xp.trace(s), 0.0) * rotation
    is_thin = xp.any(span.ridge)
    rest = h - xp.where(is_thin, 1.0, 0.0) * (similar @ s)
    found = xp.linalg.solve(s + xp.trace(s) * span.ridge, rest.T).T
    return xp.where(is_thin, similar + found, found)


def _fix_row_rotation(h: Any, size: Any, ridge: Any) -> Any:
    """H with the smallest turn of a row of points in space added, as much as the row is thin.

    The turn about a row is determined by the small offsets of its points alone: a point dragged across the row would
    rotate all places next to it by half a turn.
    """
    if h.shape[0] == 2:
        return h
    xp = namespace_of(h, ridge)
    weights, axes = xp.linalg.eigh(_fixed(ridge))  # that of the row is zero and comes first
    along = axes[:, 0]
    image = _fixed(h) @ along
    length = xp.sqrt(xp.sum(image * image))
    # Half a turn is about the direction in which the row is thinnest, if there is one.
    aside = xp.where(weights[2] > _SURELY * weights[1], axes[:, 2], _transverse_axis(along))
    turn = _smallest_turn(along, xp.where(length > 0, image / xp.where(length > 0, length, 1.0), along), aside)
    across = xp.eye(3, dtype=h.dtype) - xp.outer(along, along)
    return h + xp.maximum(weights[1], 0.0) * size * turn @ across


def _affine_exact(s: Any, h: Any, span: Span, previous: Any) -> Any:
    """M^T = S^-1 H^T on the span of the points (columns of its basis), completed across it."""
    small = span.basis.T @ s @ span.basis
    return complete(namespace_of(small, h).linalg.solve(small, span.basis.T @ h.T).T, span.basis)


def _similarity(s: Any, h: Any, span: Span, previous: Any) -> Any:
    xp = namespace_of(s, h)
    rotation = nearest_rotation(h, xp.trace(s), previous)
    scale = xp.sum(rotation * h) / xp.trace(s)
    return xp.maximum(scale, 0.0) * rotation


def _rigid(s: Any, h: Any, span: Span, previous: Any) -> Any:
    return nearest_rotation(h, namespace_of(s, h).trace(s), previous)


TrendName: TypeAlias = Literal["affine", "similarity", "rigid", "translation", "none", "affine_exact", "quadratic"]
"""Names of the trends."""

TRENDS: dict[str, Trend] = {
    t.name: t
    for t in (
        Trend("affine", "Affine", 2, _affine),
        Trend("similarity", "Similarity (turn, scale, shift)", 1, _similarity),
        Trend("rigid", "Rigid (turn, shift)", 1, _rigid),
        Trend("translation", "Translation", 1, _translation),
        Trend("none", "None", 0, None),
        Trend("affine_exact", "Affine, exact across a row of points too", 2, _affine_exact),
        Trend("quadratic", "Quadratic", 3, _affine),
    )
}
"""All trends by name; the first is the default."""


def find_trend(name: str) -> Trend:
    """The trend of a name; DeformError listing the names if there is none."""
    try:
        return TRENDS[name]
    except (KeyError, TypeError):  # what has no hash is no name either
        raise DeformError(f"unknown trend {short_value(name)}; choose one of {', '.join(TRENDS)}.") from None


def thin_directions(
    xx: NDArray[np.float64], yy: NDArray[np.float64], yx: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Principal directions of control points, and how far the points spread along each, relative to the longest.

    A direction is as thin as it is in the targets or, rotated back by the best rotation, in the sources: a map between
    a row and a triangle is determined across the row by neither. With A and B the two matrices of second moments, each
    relative to its largest eigenvalue, the spreads are the square roots of the eigenvalues of ``2 A (A + B)^-1 B``,
    which are above the smaller ones of the two sets.

    Parameters
    ----------
    xx, yy, yx : (..., dim, dim) second moments of the centred targets, of the centred sources, and ``Y^T X``.

    Returns
    -------
    directions (..., dim, dim), in columns, and spreads (..., dim), falling from 1.
    """
    dim = xx.shape[-1]
    sizes = np.sqrt(np.trace(xx, axis1=-2, axis2=-1) * np.trace(yy, axis1=-2, axis2=-1))[..., None, None]
    u, _, vt = np.linalg.svd(yx + 1e-9 * sizes * np.eye(dim))  # the smallest turn where one is open
    u[..., :, -1] *= np.sign(np.linalg.det(u @ vt))[..., None]
    rotation = u @ vt
    a, b = _relative_moments(xx), _relative_moments(np.swapaxes(rotation, -1, -2) @ yy @ rotation)
    b = np.where(np.asarray(yy.any(axis=(-2, -1)))[..., None, None], b, a)  # one place determines no direction
    tiny = 1e-12 * np.eye(dim)  # both may be flat in one direction
    both = 2 * (a + tiny) @ np.linalg.solve(a + b + 2 * tiny, b + tiny)
    values, vectors = np.linalg.eigh((both + np.swapaxes(both, -1, -2)) / 2)
    values, vectors = np.maximum(values[..., ::-1], 0.0), vectors[..., ::-1]
    return vectors, np.sqrt(values / values[..., :1])


def spreads_of(
    targets: NDArray[np.float64], sources: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """:func:`thin_directions` of places (n, dim) at two places at least."""
    x, y = (places - places.mean(axis=0) for places in (targets, sources))
    x, y = (places / (spread_of(places) or 1.0) for places in (x, y))  # squares of tiny lengths would be zero
    return thin_directions(x.T @ x, y.T @ y, y.T @ x)


def spread_of(places: NDArray[np.float64]) -> float:
    """The root mean square distance of places (n, dim) from their centroid; 0 for none.

    >>> spread_of(np.array([[1.0, 0.0], [5.0, 0.0]]))
    2.0
    """
    if len(places) == 0:
        return 0.0
    centred = places - np.add.reduce(places) / len(places)
    largest = float(np.maximum.reduce(np.abs(centred), axis=None))  # squares of tiny lengths would be zero
    if not largest > 0:
        return 0.0
    centred /= largest
    return largest * math.sqrt(float(np.vdot(centred, centred)) / len(places))


def are_wide(centred: NDArray[np.float64], displacements: NDArray[np.float64]) -> bool:
    """Check that no direction of :func:`thin_directions` is thin, where the two sets alone show that.

    The spreads are above the smaller ones of the sets, whose moments take one product and the eigenvalues of both.

    Parameters
    ----------
    centred : (n, dim) targets less their mean.
    displacements : (n, dim) from the targets to the sources.
    """
    both = np.concatenate([centred.T, (centred + displacements).T])
    both = (both - both.mean(axis=1, keepdims=True)).reshape(2, centred.shape[1], -1)
    values = np.linalg.eigvalsh(both @ both.swapaxes(1, 2))
    return bool((values[:, 0] > np.maximum(_SURELY * THIN**2 * values[:, -1], _LEAST_MOMENT)).all())


def _relative_moments(m: NDArray[np.float64]) -> NDArray[np.float64]:
    largest = np.linalg.eigvalsh(m)[..., -1:, None]
    return np.asarray(m / np.where(largest > 0, largest, 1.0))


def ridge_of(directions: NDArray[np.float64], spreads: NDArray[np.float64]) -> NDArray[np.float64]:
    """The penalty (..., dim, dim) of the trend "affine" for :func:`thin_directions`; zero where none is thin."""
    weight = _penalty(spreads, THIN)
    return np.asarray(directions * weight[..., None, :] @ np.swapaxes(directions, -1, -2))


def products(x: Any, xp: Any = np) -> Any:
    """The products of two coordinates of x (n, dim): all squares, then the mixed ones times sqrt(2), (n, q).

    With that factor a rotation of x rotates them as well.

    >>> products(np.array([[1.0, 2.0]])).round(3).tolist()
    [[1.0, 4.0, 2.828]]
    """
    dim = x.shape[1]
    mixed = [np.sqrt(2.0) * x[:, a] * x[:, b] for a in range(dim) for b in range(a)]
    return xp.stack([*(x[:, a] * x[:, a] for a in range(dim)), *mixed], axis=1)


def quadratic_forms(coefficients: Any, dim: int) -> Any:
    """The symmetric matrices H_m (dim, dim, dim) with ``(products(x) C)_m = x^T H_m x`` for C (q, dim)."""
    pairs = [*((a, a) for a in range(dim)), *((a, b) for a in range(dim) for b in range(a))]
    units = np.zeros((len(pairs), dim, dim))
    for k, (a, b) in enumerate(pairs):
        units[k, a, b] = units[k, b, a] = 1.0 if a == b else np.sqrt(0.5)
    return namespace_of(coefficients).einsum("qm,qab->mab", coefficients, units)


def quadric_span(
    centred: NDArray[np.float64], basis: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The part of the :func:`products` that centred points determine in addition to affine maps.

    Parameters
    ----------
    centred : (n, dim); basis : (dim, rank) of their span.

    Returns
    -------
    quadrics (q, r), orthonormal columns of the combinations that do not vanish at the points but for an affine part;
    bend (q, q), the penalty of those that nearly do: fewer than 6 points in the plane or 10 in space, or points on a
    conic or a quadric, leave some open.
    """
    size = spread_of(centred) or 1.0
    p = np.concatenate([np.ones((len(centred), 1)), centred @ basis / size], axis=1)
    q = np.linalg.qr(p)[0]
    every = products(centred / size)
    rest = every - q @ (q.T @ every)
    _, sigma, vt = np.linalg.svd(np.concatenate([rest, np.zeros((every.shape[1],) * 2)]), full_matrices=False)
    if not sigma[0] > FLAT * np.linalg.norm(every):
        return np.zeros((every.shape[1], 0)), np.eye(every.shape[1])
    spread = sigma / sigma[0]
    return np.ascontiguousarray(vt[spread > FLAT].T), (vt.T * _penalty(spread, THIN_BEND)) @ vt


def _penalty(spreads: NDArray[np.float64], limit: float) -> NDArray[np.float64]:
    s = np.maximum(spreads, LEAST_SPREAD)
    return np.where(s < limit, ((limit - s) / s) ** 2 / SOFTNESS, 0.0)


def regularize_moments(moments: tuple[Any, Any], plain: tuple[Any, Any], ridge: Any) -> tuple[Any, Any]:
    """S and H (..., dim, dim), plus those of all points with equal weights as much as the points are thin.

    The energy of a row of points is that of its small wiggles: by it, one point dragged past its neighbours would turn
    and scale all places next to the row.
    """
    xp = namespace_of(*moments, *plain, ridge)
    share = xp.linalg.eigvalsh(_fixed(ridge))[..., -1:, None]  # the largest penalty, for any axes
    is_thin = share > 0

    def relative(to: Any, weight: Any, where_wide: float) -> Any:
        size = xp.trace(to, axis1=-2, axis2=-1)[..., None, None]
        return xp.where(is_thin, weight / xp.where(size > 0, size, 1.0), where_wide)

    first, other = relative(moments[0], 1.0, 1.0), relative(plain[0], share, 0.0)
    s, h = (first * m + other * m0 for m, m0 in zip(moments, plain, strict=True))
    return s, h


def nearest_rotation(h: Any, size: Any, previous: Any) -> Any:
    """The rotation R with the largest tr(R^T H); ``previous`` where H leaves the angle open.

    ``size`` is tr S, the size H has where nothing is dragged: measured by H alone, the rounding of sources that
    coincide would pass for a turn. In space a small multiple of ``previous`` is added where a turn is open: points on
    one line leave the turn about the line free, and the singular vectors alone would pick any (zero displacement was
    seen to move voxels by 91 of 100). Adding it everywhere would miss rigid motions by that multiple.
    """
    xp = namespace_of(h, size, previous)
    fixed = _fixed(h)
    least = NO_ANGLE * xp.maximum(_fixed(size), xp.sqrt(xp.sum(fixed * fixed)))
    if h.shape[0] == 2:
        c, s = h[0, 0] + h[1, 1], h[1, 0] - h[0, 1]
        known = c * c + s * s > least * least
        length = xp.sqrt(xp.where(known, c * c + s * s, 1.0))
        return xp.where(known, xp.array([[c, -s], [s, c]]) / length, previous)
    stretch = _polar(fixed)[2]
    known = stretch[1] + stretch[2] > least
    found = h + xp.where(known, 0.0, least) * previous
    return _polar(found)[0] if xp is np else _polar_rotation(found)


def _fixed(x: Any) -> Any:
    """The same numbers, which JAX does not differentiate."""
    return x if namespace_of(x) is np else lax.stop_gradient(x)


def _polar(h: Any) -> tuple[Any, Any, Any]:
    """R, V and p of H = R V diag(p) V^T with R a rotation; p falls, its last is negative where H mirrors."""
    xp = namespace_of(h)
    u, sigma, vt = xp.linalg.svd(h)
    proper = xp.array([1.0, 1.0, xp.sign(xp.linalg.det(u) * xp.linalg.det(vt))], dtype=h.dtype)
    return (u * proper) @ vt, vt.T, sigma * proper


def _polar_rotation_jvp(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
    # R V [K_ij / (p_i + p_j)] V^T with K the skew part of R^T dH; differentiating through the singular vectors divides
    # by p_i - p_j instead, zero for a ball of points.
    (h,), (dh,) = primals, tangents
    r, v, p = _polar(h)
    k = v.T @ (r.T @ dh - dh.T @ r) @ v
    both = p[:, None] + p[None, :]
    return r, r @ v @ (k / jnp.where(both > 0, both, 1.0)) @ v.T


_polar_rotation = with_derivative(lambda h: _polar(h)[0], _polar_rotation_jvp)


def complete(images: Any, basis: Any) -> Any:
    """The linear map that sends the columns of ``basis`` (dim, rank) to those of ``images`` and is natural across them.

    Points on a line or in a plane of space do not determine the direction across. Taking no displacement there (the
    least norm) flattens a row of points rotated by 90 degrees to nothing; instead the cross direction turns and scales
    along with the span, so that similarities of the points come out as similarities of space.
    """
    xp, (dim, rank) = namespace_of(images, basis), basis.shape
    if rank == dim:
        return images @ basis.T
    if rank == 0:
        return xp.eye(dim, dtype=basis.dtype)
    if dim == 2:
        quarter = xp.array([[0.0, -1.0], [1.0, 0.0]], dtype=basis.dtype)
        return images @ basis.T + (quarter @ images) @ (quarter @ basis).T
    if rank == 2:
        across, image = xp.cross(basis[:, 0], basis[:, 1]), xp.cross(images[:, 0], images[:, 1])
        area = xp.sqrt(xp.sum(image * image))
        # |m1 x m2| / sqrt(area) = sqrt(area): the mean scale of the two directions in the plane
        image = image / xp.sqrt(xp.where(area > 0, area, 1.0))
        return images @ basis.T + xp.outer(image, across)
    return _smallest_turn(basis[:, 0], images[:, 0])


def _transverse_axis(q: Any) -> Any:
    """The axis of coordinates that is farthest from the direction q."""
    xp = namespace_of(q)
    return xp.eye(3, dtype=q.dtype)[xp.argmin(xp.abs(q))]


def _smallest_turn(q: Any, image: Any, aside: Any = None) -> Any:
    """Scale times the smallest rotation that takes the unit vector q to the direction of ``image`` (Rodrigues).

    Half a turn is about the unit vector ``aside`` across q. Points on a line determine none: it is the axis of
    coordinates that is farthest from the line then, the one thing here that is not rotated with the points.
    """
    xp = namespace_of(q, image)
    length = xp.sqrt(xp.sum(image * image))
    t = image / xp.where(length > 0, length, 1.0)
    opposite = xp.dot(q, t) < -1 + 1e-9  # half a turn, and the rest from there
    start = xp.where(opposite, -q, q)
    axis = xp.cross(start, t)
    k = xp.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    other = _transverse_axis(q) if aside is None else aside
    other = other - xp.dot(other, q) * q
    other = other / xp.sqrt(xp.sum(other * other))
    half = 2 * xp.outer(other, other) - xp.eye(3, dtype=q.dtype)
    # 1 + cosine as |q + t|^2 / 2, which preserves its digits next to half a turn
    turn = xp.eye(3, dtype=q.dtype) + k + (k @ k) * (2 / xp.sum((start + t) ** 2))
    return length * xp.where(opposite, turn @ half, turn)


def plain_moments(x: Any, d: Any, one: Any) -> tuple[Any, Any]:
    """The matrices S and H in which all points have equal weights."""
    mean_x, mean_d = ((one.T @ a / one.sum()) for a in (x, d))
    centred = one * (x - mean_x)
    s = centred.T @ centred
    return s, s + (d - mean_d).T @ centred

"""The trend: the linear map that the kernels only correct.

A fit is ``T(x) = x + D(x) = trend(x) + sum_j alpha_j phi(|x - x_j|)``. Any trend plus the kernels of the residual
interpolates; the trend of least energy ``tr (Y - X M^T)^T W (Y - X M^T)`` is taken, where Y are the sources, X the
targets and W the energy matrix of the kernel (the inverse of Phi, with the mean removed). Both S = X^T W X and
H = Y^T W X are small, so every trend below is a closed form on matrices of dim x dim.

The similarity and rigid trends replace the paper's Eq. 5, whose printed system has more equations than unknowns; these
are its exact optima (S. Umeyama, IEEE PAMI 13 (1991) 376-380, with the dense weight W).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from deformnb.checks import shown_value
from deformnb.errors import DeformError

# Below this share of the data's size a rotation has no angle (all handles share one source): keep the last one.
NO_ANGLE = 1e-6


@dataclass(frozen=True)
class Trend:
    """One choice of trend.

    Parameters
    ----------
    name, title : in code and in menus.
    order : order of conditional positive definiteness of the kernels it can be paired with (see kernels).
    linear : function (S, H, basis, previous) -> M, the linear part of T; None if there is no polynomial at all.
    """

    name: str
    title: str
    order: int
    linear: Callable[[Any, Any, Any, Any], Any] | None


def _translation(s: Any, h: Any, basis: Any, previous: Any) -> Any:
    return jnp.eye(s.shape[0], dtype=s.dtype)


def _affine(s: Any, h: Any, basis: Any, previous: Any) -> Any:
    """M^T = S^-1 H^T on the span of the points (columns of ``basis``), completed across it."""
    small = basis.T @ s @ basis
    return complete(jnp.linalg.solve(small, basis.T @ h.T).T, basis)


def _similarity(s: Any, h: Any, basis: Any, previous: Any) -> Any:
    rotation = nearest_rotation(h, jnp.trace(s), previous)
    scale = jnp.sum(rotation * h) / jnp.trace(s)
    return jnp.maximum(scale, 0.0) * rotation


def _rigid(s: Any, h: Any, basis: Any, previous: Any) -> Any:
    return nearest_rotation(h, jnp.trace(s), previous)


TRENDS: dict[str, Trend] = {
    t.name: t
    for t in (
        Trend("affine", "Affine", 2, _affine),
        Trend("similarity", "Similarity (turn, scale, shift)", 1, _similarity),
        Trend("rigid", "Rigid (turn, shift)", 1, _rigid),
        Trend("translation", "Translation", 1, _translation),
        Trend("none", "None", 0, None),
    )
}
"""All trends by name; the first is the default."""


def trend_named(name: str) -> Trend:
    """The trend of a name; DeformError listing the names if there is none."""
    try:
        return TRENDS[name]
    except (KeyError, TypeError):  # what has no hash is no name either
        raise DeformError(f"unknown trend {shown_value(name)}; choose one of {', '.join(TRENDS)}.") from None


def nearest_rotation(h: Any, size: Any, previous: Any) -> Any:
    """The rotation R with the largest tr(R^T H); ``previous`` where H leaves the angle open.

    ``size`` is tr S, the size H has where nothing is dragged: measured by H alone, the rounding of sources that
    coincide would pass for a turn. In space a small multiple of ``previous`` is added where a turn is open: points on
    one line leave the turn about the line free, and the singular vectors alone would pick any (zero displacement was
    seen to move voxels by 91 of 100). Adding it everywhere would miss rigid motions by that multiple.
    """
    fixed = lax.stop_gradient(h)
    least = NO_ANGLE * jnp.maximum(lax.stop_gradient(size), jnp.sqrt(jnp.sum(fixed * fixed)))
    if h.shape[0] == 2:
        c, s = h[0, 0] + h[1, 1], h[1, 0] - h[0, 1]
        known = c * c + s * s > least * least
        length = jnp.sqrt(jnp.where(known, c * c + s * s, 1.0))
        return jnp.where(known, jnp.array([[c, -s], [s, c]]) / length, previous)
    stretch = _polar(fixed)[2]
    known = stretch[1] + stretch[2] > least
    return _polar_rotation(h + jnp.where(known, 0.0, least) * previous)


def _polar(h: Any) -> tuple[Any, Any, Any]:
    """R, V and p of H = R V diag(p) V^T with R a rotation; p falls, its last is negative where H mirrors."""
    u, sigma, vt = jnp.linalg.svd(h)
    proper = jnp.array([1.0, 1.0, jnp.sign(jnp.linalg.det(u) * jnp.linalg.det(vt))], dtype=h.dtype)
    return (u * proper) @ vt, vt.T, sigma * proper


@jax.custom_jvp
def _polar_rotation(h: Any) -> Any:
    return _polar(h)[0]


@_polar_rotation.defjvp
def _polar_rotation_jvp(primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
    # R V [K_ij / (p_i + p_j)] V^T with K the skew part of R^T dH; differentiating through the singular vectors divides
    # by p_i - p_j instead, zero for a ball of points.
    (h,), (dh,) = primals, tangents
    r, v, p = _polar(h)
    k = v.T @ (r.T @ dh - dh.T @ r) @ v
    both = p[:, None] + p[None, :]
    return r, r @ v @ (k / jnp.where(both > 0, both, 1.0)) @ v.T


def complete(images: Any, basis: Any) -> Any:
    """The linear map that sends the columns of ``basis`` (dim, rank) to those of ``images`` and is natural across them.

    Points on a line or in a plane of space say nothing about the direction across. Taking no displacement there (the
    least norm) flattens a row of points turned by 90 degrees to nothing; instead the cross direction turns and scales
    along with the span, so that similarities of the points come out as similarities of space.
    """
    dim, rank = basis.shape
    if rank == dim:
        return images @ basis.T
    if rank == 0:
        return jnp.eye(dim, dtype=basis.dtype)
    if dim == 2:
        quarter = jnp.array([[0.0, -1.0], [1.0, 0.0]], dtype=basis.dtype)
        return images @ basis.T + (quarter @ images) @ (quarter @ basis).T
    if rank == 2:
        across, image = jnp.cross(basis[:, 0], basis[:, 1]), jnp.cross(images[:, 0], images[:, 1])
        area = jnp.sqrt(jnp.sum(image * image))
        # |m1 x m2| / sqrt(area) = sqrt(area): the mean scale of the two directions in the plane
        image = image / jnp.sqrt(jnp.where(area > 0, area, 1.0))
        return images @ basis.T + jnp.outer(image, across)
    return _smallest_turn(basis[:, 0], images[:, 0])


def _smallest_turn(q: Any, image: Any) -> Any:
    """Scale times the smallest rotation that takes the unit vector q to the direction of ``image`` (Rodrigues)."""
    length = jnp.sqrt(jnp.sum(image * image))
    t = image / jnp.where(length > 0, length, 1.0)
    opposite = jnp.dot(q, t) < -1 + 1e-9  # half a turn, about any axis across q, and the rest from there
    start = jnp.where(opposite, -q, q)
    axis = jnp.cross(start, t)
    k = jnp.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    other = jnp.eye(3, dtype=q.dtype)[jnp.argmin(jnp.abs(q))]
    other = other - jnp.dot(other, q) * q
    other = other / jnp.sqrt(jnp.sum(other * other))
    half = 2 * jnp.outer(other, other) - jnp.eye(3, dtype=q.dtype)
    # 1 + cosine as |q + t|^2 / 2, which keeps its digits next to half a turn
    turn = jnp.eye(3, dtype=q.dtype) + k + (k @ k) * (2 / jnp.sum((start + t) ** 2))
    return length * jnp.where(opposite, turn @ half, turn)

"""The weights and shares of rigid parts, functions of the distances to them, and their derivatives.

With the distance ``d_k`` of a part, measured where it has moved to, its weight is ``W(d_k / s_k)`` and its share of the
motion ``d_k^-2 / sum_j d_j^-2``; see :mod:`deformnb.rigid_parts`.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from deformnb.compilation import compiled
from deformnb.fields import in_blocks
from deformnb.regions import AbstractRegion

# Distances on lattices that are kept while a control point is dragged, for the parts do not move: 256^3 twice.
_KEPT_BYTES = 2**27


def saturated(t: Any, xp: Any = np) -> Any:
    """A step from 0 to 1 over t from 0 to 1 with two continuous derivatives: 6 t^5 - 15 t^4 + 10 t^3.

    >>> saturated(np.array([-1.0, 0.5, 2.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    t = xp.clip(t, 0.0, 1.0)
    return t * t * t * (t * (6.0 * t - 15.0) + 10.0)


def _distance(t: Any, xp: Any = np) -> Any:
    return xp.maximum(t, 0.0)


WEIGHTS: dict[str, Callable[..., Any]] = {"saturated": saturated, "distance": _distance}
"""What is made of a part's distance, in units of its scale: the smooth step, or the paper's distance itself."""

_WEIGHT_SLOPES: dict[str, Callable[[Any], Any]] = {
    "saturated": lambda t: 30.0 * np.square(np.clip(t, 0.0, 1.0) * (1.0 - np.clip(t, 0.0, 1.0))),
    "distance": lambda t: np.where(t > 0, 1.0, 0.0),
}
"""The derivatives of :data:`WEIGHTS`."""


def blended(x: Any, back: list[Any], distances: list[Any], scales: Any, weights: tuple[str, ...],
            xp: Any) -> tuple[Any, Any]:
    """L(x) - x and w(x) from every part's motion and distance."""
    weight = weight_of(distances, scales, weights, xp)
    if len(back) == 1:
        return back[0] - x, weight
    # 1 / distance^2, multiplied by the least of all, which is finite in the parts and keeps the digits beside them.
    least = distances[0]
    for d in distances[1:]:
        least = xp.minimum(least, d)
    shares = [xp.where(d > least, (least / xp.where(d > 0, d, 1.0)) ** 2, 1.0) for d in distances]
    total = sum(shares)
    return sum((s / total)[..., None] * (y - x) for s, y in zip(shares, back, strict=True)), weight


def weight_of(distances: list[Any], scales: Any, weights: tuple[str, ...], xp: Any) -> Any:
    """w(x), the product over the parts."""
    weight = 1.0
    for distance, scale, name in zip(distances, scales, weights, strict=True):
        # A NumPy scalar of 64 bits would make 64 bits of all distances.
        weight = weight * WEIGHTS[name](distance / (float(scale) if xp is np else scale), xp)
    return weight


def weight_gradient(distances: list[Any], slopes: list[Any], scales: Any,
                    weights: tuple[str, ...]) -> tuple[Any, Any]:
    """w (n) and its gradient (n, dim), from every part's distance (n) and the gradient of that."""
    units = [d / float(s) for d, s in zip(distances, scales, strict=True)]
    values = [WEIGHTS[name](t) for t, name in zip(units, weights, strict=True)]
    gradient = 0.0
    for k, (t, slope, scale, name) in enumerate(zip(units, slopes, scales, weights, strict=True)):
        others = np.prod([v for j, v in enumerate(values) if j != k], axis=0)
        gradient = gradient + (others * _WEIGHT_SLOPES[name](t) / float(scale))[:, None] * slope
    return np.prod(values, axis=0), gradient


def drift_gradient(x: NDArray[np.float64], back: list[Any], distances: list[Any], slopes: list[Any],
                   matrices: Any) -> NDArray[np.float64]:
    """The derivative (n, dim, dim) of L(x) - x.

    With the shares ``p_k = d_k^-2 / sum_j d_j^-2`` of the parts, ``dp_k = 2 p_k (sum_j p_j q_j - q_k)`` and
    ``q_k = (grad d_k) / d_k``; within a part its share is 1 and does not change.
    """
    turns = [np.asarray(m) - np.eye(x.shape[1]) for m in matrices]
    if len(back) == 1:
        return np.broadcast_to(turns[0], (*x.shape, x.shape[1]))
    least = np.min(distances, axis=0)
    raw = [np.where(d > least, (least / np.where(d > 0, d, 1.0)) ** 2, 1.0) for d in distances]
    shares = [r / sum(raw) for r in raw]
    rates = [np.where(d[:, None] > 0, g / np.where(d > 0, d, 1.0)[:, None], 0.0)
             for d, g in zip(distances, slopes, strict=True)]
    mean = sum(p[:, None] * q for p, q in zip(shares, rates, strict=True))
    out = np.zeros((*x.shape, x.shape[1]))
    for p, q, y, turn in zip(shares, rates, back, turns, strict=True):
        change = np.where(least[:, None] > 0, 2 * p[:, None] * (mean - q), 0.0)
        out += p[:, None, None] * turn + (y - x)[:, :, None] * change[:, None, :]
    return out


_measured = compiled(lambda region, points: jnp.concatenate(
    [region(points)[:, None], jax.vmap(jax.grad(region))(points)], axis=1))


def gradients(region: AbstractRegion, matrix: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[Any, Any]:
    """A part's distance (n) and its gradient (n, dim) by x, where x lies at y in the part; both zero within it."""
    found = in_blocks(partial(_measured, region), y)
    outside = found[:, 0] > 0
    return np.where(outside, found[:, 0], 0.0), np.where(outside[:, None], found[:, 1:] @ matrix, 0.0)


_kept: OrderedDict[Any, NDArray[np.float32]] = OrderedDict()
_keeping = threading.Lock()


def kept_distances(region: AbstractRegion, matrix: NDArray[np.float64], shift: NDArray[np.float64],
                   rows: NDArray[np.float64], columns: NDArray[np.float64],
                   places: NDArray[np.float64]) -> NDArray[np.float32]:
    """Distances on a lattice, from the last edit if they are the same: a drag moves points, and no parts."""
    return _remembered((region, matrix.tobytes(), shift.tobytes(), rows.tobytes(), columns.tobytes()),
                       lambda: np.maximum(region.signed_distance(places), 0.0))


def kept_gradients(region: AbstractRegion, rows: NDArray[np.float64],
                   columns: NDArray[np.float64]) -> NDArray[np.float32]:
    """The same for distances beside a part that stays, with their gradients: (R C, 1 + dim)."""

    def make() -> NDArray[np.float64]:
        places = np.stack([a[:, None] + b[None, :] for a, b in zip(rows, columns, strict=True)], axis=-1)
        distance, slope = gradients(region, np.eye(region.dim), places.reshape(-1, region.dim))
        return np.concatenate([distance[:, None], slope], axis=1)

    return _remembered((region, "gradients", rows.tobytes(), columns.tobytes()), make)


def _remembered(key: Any, make: Callable[[], NDArray[np.float64]]) -> NDArray[np.float32]:
    with _keeping:
        found = _kept.pop(key, None)
    if found is None:
        found = make().astype(np.float32)
    with _keeping:
        _kept[key] = found  # the newest is last
        while sum(a.nbytes for a in _kept.values()) > _KEPT_BYTES and len(_kept) > 1:
            _kept.popitem(last=False)
    return found

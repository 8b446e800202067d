"""Places in a picture or in space with a signed distance: what rigid parts and cuts are made of; masks are next door.

Distances are physical, exact for straight boundaries, and negative inside. In a picture the coordinates are (a, b) of
its plane, in space (x, y, z).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.errors import DeformError

LARGEST_SHAPE = 512
"""Vertices of a drawn line; a hand draws some dozens."""

# Directions whose sine is less count as parallel: rounding would let parallel ends of a line meet far away.
_PARALLEL = 1e-9


class AbstractRegion(ABC):
    """A place with an inside: a frozen pytree that maps points to signed distances."""

    kind: ClassVar[str]
    """Its name in documents."""

    @property
    @abstractmethod
    def dim(self) -> int:
        """2 for a place in a picture, 3 for one in space."""

    @abstractmethod
    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        """Distances (...) of points (..., dim) to the boundary, physical units, negative inside; NumPy."""

    @abstractmethod
    def __call__(self, points: Any) -> Any:
        """The same in pure JAX."""


def _array_of(values: Any, what: str, least: int, dims: tuple[int, ...]) -> NDArray[np.float64]:
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        array = np.zeros(0)
    if array.ndim != 2 or array.shape[1] not in dims or not least <= len(array) <= LARGEST_SHAPE:
        raise DeformError(f"the {what} must be {least} to {LARGEST_SHAPE} places of {' or '.join(map(str, dims))} "
                          f"coordinates, got shape {array.shape}.")
    if not np.isfinite(array).all() or np.abs(array).max(initial=0.0) > 1e15:
        raise DeformError(f"the {what} must be finite numbers below 1e15.")
    return array


@jax.tree_util.register_pytree_node_class
@dataclass(frozen=True)
class HalfSpace(AbstractRegion):
    """All on one side of a straight line in a picture, or of a plane in space: ``(x - point) . normal < 0``.

    Parameters
    ----------
    point : a place on the boundary, of 2 or 3 coordinates.
    normal : points out of it; made a unit vector.

    Examples
    --------
    >>> ground = HalfSpace((0, 0, 0), (0, 0, 1))  # all below z = 0
    >>> ground.signed_distance([[5, 5, 2], [0, 0, -3]]).tolist()
    [2.0, -3.0]
    """

    point: tuple[float, ...]
    normal: tuple[float, ...]
    kind: ClassVar[str] = "half_space"

    def __post_init__(self) -> None:
        pair = _array_of([self.point, self.normal], "point and normal of a half space", 2, (2, 3))
        length = float(np.linalg.norm(pair[1]))
        if not length > 0:
            raise DeformError("the normal of a half space must not be zero.")
        object.__setattr__(self, "point", tuple(pair[0].tolist()))
        if abs(length - 1) > 1e-12:  # a unit vector stays bit by bit what it is, so that documents equal themselves
            pair[1] /= length
        object.__setattr__(self, "normal", tuple(pair[1].tolist()))

    @property
    def dim(self) -> int:
        return len(self.point)

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        return (np.asarray(points, dtype=np.float64) - np.asarray(self.point)) @ np.asarray(self.normal)

    def __call__(self, points: Any) -> Any:
        return (jnp.asarray(points) - jnp.asarray(self.point)) @ jnp.asarray(self.normal)

    def tree_flatten(self) -> tuple[tuple[Any, ...], None]:
        """What JAX traces, and what it keeps."""
        return (np.asarray(self.point), np.asarray(self.normal)), None

    @classmethod
    def tree_unflatten(cls, _aux: None, leaves: tuple[Any, ...]) -> HalfSpace:
        """The same again, of what JAX has made of it; nothing is checked."""
        made = object.__new__(cls)
        object.__setattr__(made, "point", leaves[0])
        object.__setattr__(made, "normal", leaves[1])
        return made


def _cross(p: Any, q: Any) -> Any:
    return p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]


class _Drawn(AbstractRegion):
    """What is bounded by straight edges on a picture."""

    vertices: Any
    is_closed: ClassVar[bool]

    @property
    def dim(self) -> int:
        return 2

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        # Edge by edge: arrays of (points x edges) took six times as long.
        p, v = np.asarray(points, dtype=np.float64), np.asarray(self.vertices)
        start, edge, low, high = self._edges(v, np)
        x, y = np.moveaxis(p, -1, 0)
        least, place = np.full(x.shape, np.inf), np.zeros(x.shape)
        nearest = np.zeros(x.shape, dtype=np.intp)
        for k, ((sx, sy), (ex, ey)) in enumerate(zip(start, edge, strict=True)):
            ax, ay = x - sx, y - sy
            t = np.clip((ax * ex + ay * ey) / (ex * ex + ey * ey), low[k], high[k])
            square = (ax - t * ex) ** 2 + (ay - t * ey) ** 2
            nearer = square < least
            least, place, nearest = (np.where(nearer, new, old) for new, old in (
                (square, least), (t, place), (k, nearest)))
        return np.where(self._side(p, v, nearest, place, np) < 0, -1.0, 1.0) * np.sqrt(least)

    def __call__(self, points: Any) -> Any:
        p, v = jnp.asarray(points), jnp.asarray(self.vertices)
        start, edge, low, high = self._edges(v, jnp)
        away = p[..., None, :] - start
        t = jnp.clip((away * edge).sum(-1) / (edge ** 2).sum(-1), low, high)
        square = ((away - t[..., None] * edge) ** 2).sum(-1)
        nearest = square.argmin(-1)
        place = jnp.take_along_axis(t, nearest[..., None], -1)[..., 0]
        least = square.min(-1)
        distance = jnp.sqrt(jnp.where(least > 0, least, 1.0)) * (least > 0)  # the root has no slope at 0
        return jnp.where(self._side(p, v, nearest, place, jnp) < 0, -distance, distance)

    def _edges(self, v: Any, xp: Any) -> tuple[Any, Any, NDArray[np.float64], NDArray[np.float64]]:
        """Starts, directions, and the range along each from 0 to 1, which goes on at the ends of an open line."""
        edge = (xp.roll(v, -1, axis=0) if self.is_closed else v[1:]) - v[: len(v) - (not self.is_closed)]
        low, high = np.zeros(len(edge)), np.ones(len(edge))
        if not self.is_closed:
            low[0], high[-1] = -np.inf, np.inf
        return v[: len(edge)], edge, low, high

    def _side(self, p: Any, v: Any, nearest: Any, place: Any, xp: Any) -> Any:
        """Negative inside, from the number of the nearest edge and the place on it.

        Where that is a corner, the sum of the normals of both its edges tells the side, at any angle.
        """
        _, edge, low, high = self._edges(v, xp)
        normal = xp.stack([-edge[:, 1], edge[:, 0]], axis=-1) / xp.sqrt((edge ** 2).sum(-1, keepdims=True))
        if self.is_closed:
            w = v - v[:1]  # far from the origin the products would cancel
            normal = normal * xp.where(_cross(w, xp.roll(w, -1, axis=0)).sum() > 0, -1.0, 1.0)
        before, after = xp.roll(normal, 1, axis=0), xp.roll(normal, -1, axis=0)
        normals = xp.stack([normal, normal + before, normal + after], axis=1)
        is_begin, is_end = place <= xp.asarray(low)[nearest], place >= xp.asarray(high)[nearest]
        corner = v[(nearest + is_end) % len(v)]
        return ((p - corner) * normals[nearest, xp.where(is_begin, 1, xp.where(is_end, 2, 0))]).sum(-1)

    def tree_flatten(self) -> tuple[tuple[Any, ...], None]:
        """What JAX traces, and what it keeps."""
        return (np.asarray(self.vertices),), None

    @classmethod
    def tree_unflatten(cls, _aux: None, leaves: tuple[Any, ...]) -> Any:
        """The same again, of what JAX has made of it; nothing is checked."""
        made = object.__new__(cls)
        object.__setattr__(made, "vertices", leaves[0])
        return made


@jax.tree_util.register_pytree_node_class
@dataclass(frozen=True)
class Polygon(_Drawn):
    """The inside of a closed line on a picture, drawn either way round.

    Parameters
    ----------
    vertices : three or more places (a, b); the last is joined to the first.

    Raises
    ------
    DeformError
        If the line crosses itself.

    Examples
    --------
    >>> square = Polygon([(0, 0), (4, 0), (4, 4), (0, 4)])
    >>> square.signed_distance([[2, 1], [7, 8]]).tolist()
    [-1.0, 5.0]
    """

    vertices: tuple[tuple[float, float], ...]
    kind: ClassVar[str] = "polygon"
    is_closed: ClassVar[bool] = True

    def __post_init__(self) -> None:
        v = _array_of(self.vertices, "corners of a polygon", 3, (2,))
        object.__setattr__(self, "vertices", tuple(map(tuple, v.tolist())))
        _refuse_crossing(v, "polygon", is_closed=True)


@jax.tree_util.register_pytree_node_class
@dataclass(frozen=True)
class Line(_Drawn):
    """One side of an open line on a picture, whose first and last edge go on straight for ever.

    Parameters
    ----------
    vertices : two or more places (a, b). Inside is what lies on the left hand of someone who walks along the line on a
        picture whose b points down.

    Raises
    ------
    DeformError
        If the line crosses itself, also where its ends go on.

    Examples
    --------
    >>> middle = Line([(5, 9), (5, 0)])  # drawn upwards
    >>> middle.signed_distance([[3, 2], [9, 40]]).tolist()
    [-2.0, 4.0]
    """

    vertices: tuple[tuple[float, float], ...]
    kind: ClassVar[str] = "line"
    is_closed: ClassVar[bool] = False

    def __post_init__(self) -> None:
        v = _array_of(self.vertices, "places of a line", 2, (2,))
        object.__setattr__(self, "vertices", tuple(map(tuple, v.tolist())))
        _refuse_crossing(v, "line (its ends go on straight)", is_closed=False)


def _refuse_crossing(v: NDArray[np.float64], what: str, *, is_closed: bool) -> None:
    """Refuse edges of no length, edges that go back over the one before, and edges that cross others."""
    edge = np.roll(v, -1, axis=0) - v if is_closed else np.diff(v, axis=0)
    start, length, n = v[: len(edge)], np.linalg.norm(edge, axis=1), len(edge)
    if (length == 0).any():
        raise DeformError(f"two places of the {what} that follow each other are the same; remove one.")
    after = np.roll(edge, -1, axis=0)
    turns_back = (np.abs(_cross(edge, after)) <= _PARALLEL * length * np.roll(length, -1)) & ((edge * after).sum(1) < 0)
    for k in np.flatnonzero(turns_back if is_closed else turns_back[:-1]).tolist():
        raise DeformError(f"the {what} goes straight back at its place {(k + 1) % len(v) + 1}; remove that place.")
    low, high = np.zeros(n), np.ones(n)
    if not is_closed:
        low[0], high[-1] = -np.inf, np.inf
    gap = np.arange(n)[None, :] - np.arange(n)[:, None]
    apart = (gap > 1) & ~(is_closed & (gap == n - 1))
    bad = np.argwhere(apart & _meet(start, edge, length, low, high))
    if len(bad):
        i, j = (int(k) for k in bad[0])
        raise DeformError(f"the {what} crosses itself: its edges {i + 1} and {j + 1} meet. Draw it without a loop.")


def _meet(start: NDArray[np.float64], edge: NDArray[np.float64], length: NDArray[np.float64], low: NDArray[np.float64],
          high: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which pairs of edges ``start + t edge``, t from low to high, have a place in common."""
    away, d, e = start[None] - start[:, None], edge[:, None], edge[None]
    size, det = length[:, None] * length[None], _cross(d, e)
    parallel = np.abs(det) <= _PARALLEL * size
    safe = np.where(parallel, 1.0, det)
    t, u = _cross(away, e) / safe, _cross(away, d) / safe
    crosses = (t >= low[:, None]) & (t <= high[:, None]) & (u >= low) & (u <= high)
    on_one_line = np.abs(_cross(away, d)) <= _PARALLEL * np.linalg.norm(away, axis=-1) * length[:, None]
    # The second edge's range on the scale of the first.
    first, rate = (away * d).sum(-1) / length[:, None] ** 2, (d * e).sum(-1) / length[:, None] ** 2
    with np.errstate(invalid="ignore"):
        ends = first + rate * np.stack([np.broadcast_to(low, rate.shape), np.broadcast_to(high, rate.shape)])
    overlaps = (ends.max(axis=0) >= low[:, None]) & (ends.min(axis=0) <= high[:, None])
    return np.where(parallel, on_one_line & overlaps, crosses)

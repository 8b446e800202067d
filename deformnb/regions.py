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

# At a corner two edges are equally near, and the one that is seen more from the front has the right sign: perpendicular
# distances count this much. Far above the rounding of float32 squares, and only the sign is taken from it.
_FRONTAL = 1e-6


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
        pair = _array_of([tuple(self.point), tuple(self.normal)] if len(tuple(self.point)) == len(tuple(self.normal))
                         else None, "point and normal of a half space", 2, (2, 3))
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
        return (np.asarray(self.point), np.asarray(self.normal)), None

    @classmethod
    def tree_unflatten(cls, _aux: None, leaves: tuple[Any, ...]) -> HalfSpace:
        made = object.__new__(cls)
        object.__setattr__(made, "point", leaves[0])
        object.__setattr__(made, "normal", leaves[1])
        return made


class _Drawn(AbstractRegion):
    """What is bounded by straight edges on a picture."""

    vertices: Any
    is_closed: ClassVar[bool]

    @property
    def dim(self) -> int:
        return 2

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        # Edge by edge: arrays of (points x edges) took six times as long.
        x, y = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
        v = np.asarray(self.vertices)
        least, best, side = np.full(x.shape, np.inf), np.full(x.shape, np.inf), np.zeros(x.shape)
        for (sx, sy), (ex, ey), low, high in self._edges(v):
            ax, ay, length = x - sx, y - sy, ex * ex + ey * ey
            t = np.clip((ax * ex + ay * ey) / length, low, high)
            square = (ax - t * ex) ** 2 + (ay - t * ey) ** 2
            cross = ex * ay - ey * ax
            rank = square - _FRONTAL * cross * cross / length
            nearer = rank < best
            best, side = np.where(nearer, rank, best), np.where(nearer, cross, side)
            least = np.minimum(least, square)
        return np.where((side > 0) != self._is_reversed(v), 1.0, -1.0) * np.sqrt(least)

    def _edges(self, v: NDArray[np.float64]) -> list[tuple[Any, Any, float, float]]:
        """Start, direction, and the range along it from 0 to 1, which goes on at the ends of an open line."""
        n = len(v) if self.is_closed else len(v) - 1
        ends = [(-np.inf if k == 0 and not self.is_closed else 0.0,
                 np.inf if k == n - 1 and not self.is_closed else 1.0) for k in range(n)]
        return [(v[k], v[(k + 1) % len(v)] - v[k], *end) for k, end in enumerate(ends)]

    def __call__(self, points: Any) -> Any:
        x, v = jnp.asarray(points), jnp.asarray(self.vertices)
        start, end = (v, jnp.roll(v, -1, axis=0)) if self.is_closed else (v[:-1], v[1:])
        edge, away = end - start, x[..., None, :] - start
        length = (edge ** 2).sum(-1)
        number = jnp.arange(len(edge))
        low = jnp.where((number == 0) & (not self.is_closed), -jnp.inf, 0.0)
        high = jnp.where((number == len(edge) - 1) & (not self.is_closed), jnp.inf, 1.0)
        t = jnp.clip((away * edge).sum(-1) / length, low, high)
        square = ((away - t[..., None] * edge) ** 2).sum(-1)
        cross = edge[:, 0] * away[..., 1] - edge[:, 1] * away[..., 0]
        nearest = (square - _FRONTAL * cross ** 2 / length).argmin(-1)
        side = jnp.take_along_axis(cross, nearest[..., None], -1)[..., 0]
        least = square.min(-1)
        distance = jnp.sqrt(jnp.where(least > 0, least, 1.0)) * (least > 0)  # the root has no slope at 0
        return jnp.where((side > 0) != self._is_reversed(v), distance, -distance)

    def _is_reversed(self, v: Any) -> Any:
        if not self.is_closed:
            return False
        after = v[[*range(1, len(v)), 0]]
        return (v[:, 0] * after[:, 1] - after[:, 0] * v[:, 1]).sum() > 0

    def tree_flatten(self) -> tuple[tuple[Any, ...], None]:
        return (np.asarray(self.vertices),), None

    @classmethod
    def tree_unflatten(cls, _aux: None, leaves: tuple[Any, ...]) -> Any:
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
        _refuse_crossing(v, np.roll(v, -1, axis=0), "polygon", is_closed=True)


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
        start, end = v[:-1].copy(), v[1:].copy()
        reach = np.linalg.norm(np.ptp(v, axis=0))
        first, last = v[0] - v[1], v[-1] - v[-2]
        if np.linalg.norm(first) > 0 and np.linalg.norm(last) > 0:
            start[0] = v[0] + reach * first / np.linalg.norm(first)
            end[-1] = v[-1] + reach * last / np.linalg.norm(last)
        _refuse_crossing(start, end, "line (its ends go on straight)", is_closed=False)


def _refuse_crossing(start: NDArray[np.float64], end: NDArray[np.float64], what: str, *, is_closed: bool) -> None:
    """Refuse edges of no length and edges that cross others but their neighbours."""
    n = len(start)
    if (np.linalg.norm(end - start, axis=1) == 0).any():
        raise DeformError(f"two places of the {what} that follow each other are the same; remove one.")

    def cross(o: Any, p: Any, q: Any) -> Any:
        return (p[..., 0] - o[..., 0]) * (q[..., 1] - o[..., 1]) - (p[..., 1] - o[..., 1]) * (q[..., 0] - o[..., 0])

    s, e, p, q = start[:, None], end[:, None], start[None], end[None]
    meets = (cross(s, e, p) * cross(s, e, q) <= 0) & (cross(p, q, s) * cross(p, q, e) <= 0)
    gap = np.abs(np.arange(n)[:, None] - np.arange(n)[None, :])
    neighbours = (gap <= 1) | (is_closed & (gap == n - 1))
    # Edges on one straight line have all four products zero: they meet only if their boxes do.
    boxes = ((np.minimum(s, e) <= np.maximum(p, q)) & (np.minimum(p, q) <= np.maximum(s, e))).all(-1)
    bad = np.argwhere(meets & boxes & ~neighbours)
    if len(bad):
        i, j = (int(k) for k in bad[0])
        raise DeformError(f"the {what} crosses itself: its edges {i + 1} and {j + 1} meet. Draw it without a loop.")

"""Regions of a picture or of space with a signed distance, from which rigid parts and cuts are made.

Distances are physical, exact for straight boundaries, and negative inside. In a picture the coordinates are (a, b) of
its plane, in space (x, y, z).

In addition to half-spaces, polygons and lines there are masks: regions made of pixels or voxels, such as labels of a
segmentation, and their silhouettes on a picture.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, ClassVar, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import ndimage
from deformnb._jax import blockwise, full_precision, jax, jnp, lax, pytree, pytree_node
from deformnb.checks import LARGEST_COORDINATE, any_array, check_fields, real_array
from deformnb.errors import DeformError
from deformnb.native import library
from deformnb.native.edges import edge_distances
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid, Volume, VolumeLike, as_volume

LARGEST_SHAPE = 512
"""Vertices of a drawn line; drawing by hand gives some dozens."""

# Directions whose sine is less count as parallel: rounding would let parallel ends of a line meet far away.
_PARALLEL = 1e-9


class AbstractRegion(ABC):
    """A place with an inside: a frozen pytree that maps points to signed distances.

    Examples
    --------
    >>> HalfSpace((0.0, 5.0), (0.0, 1.0)).dim
    2
    """

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

    def to_jax(self) -> Any:
        """An equivalent with the same distances in pure JAX, a pytree of arrays of few shapes: each is compiled."""
        return self

    def samples(self, count: int) -> NDArray[np.float64]:
        """Places (n, dim) inside, about ``count`` along the longest side; none of a region without an end.

        Examples
        --------
        >>> Polygon([(0, 0), (4, 0), (4, 4), (0, 4)]).samples(3).tolist()
        [[2.0, 2.0]]
        """
        return np.zeros((0, self.dim))


def _inside(
    region: AbstractRegion, low: NDArray[np.float64], high: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """The nodes of a lattice over a box that are inside a region."""
    step = max(float((high - low).max()) / max(count - 1, 1), 1e-300)
    lines = [np.linspace(a, b, int(np.ceil((b - a) / step)) + 1) for a, b in zip(low, high, strict=True)]
    x = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, region.dim)
    return x[region.signed_distance(x) < 0]


def _array_of(values: Any, what: str, least: int, dims: tuple[int, ...]) -> NDArray[np.float64]:
    given = real_array(values)
    array = np.zeros(0) if given is None else given
    if array.ndim != 2 or array.shape[1] not in dims or not least <= len(array) <= LARGEST_SHAPE:
        raise DeformError(
            f"the {what} must be {least} to {LARGEST_SHAPE} places of {' or '.join(map(str, dims))} "
            f"coordinates, got shape {array.shape}."
        )
    if not np.isfinite(array).all() or np.abs(array).max(initial=0.0) > 1e15:
        raise DeformError(f"the {what} must be finite numbers below 1e15.")
    return array


def _leaf(values: Any) -> Any:
    """Numbers as an array for JAX, which may follow them already."""
    return values if hasattr(values, "shape") else np.asarray(values)


@pytree_node
@dataclass(frozen=True)
class HalfSpace(AbstractRegion):
    """The places on one side of a straight line in a picture, or of a plane in space: ``dot(x - point, normal) < 0``.

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
        if abs(length - 1) > 1e-12:  # a unit vector stays the same bit by bit, so that documents equal themselves
            pair[1] /= length
        object.__setattr__(self, "normal", tuple(pair[1].tolist()))

    @property
    def dim(self) -> int:
        return len(self.point)

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        return (np.asarray(points, dtype=np.float64) - np.asarray(self.point)) @ np.asarray(self.normal)

    @full_precision
    def __call__(self, points: Any) -> Any:
        return (jnp.asarray(points) - jnp.asarray(self.point)) @ jnp.asarray(self.normal)

    def tree_flatten(self) -> tuple[tuple[Any, ...], None]:
        """The arrays that JAX traces, and the constants."""
        return (_leaf(self.point), _leaf(self.normal)), None

    @classmethod
    def tree_unflatten(cls, _aux: None, leaves: tuple[Any, ...]) -> HalfSpace:
        """The object rebuilt from the leaves that JAX returns; nothing is checked."""
        made = object.__new__(cls)
        object.__setattr__(made, "point", leaves[0])
        object.__setattr__(made, "normal", leaves[1])
        return made


def _cross(p: Any, q: Any) -> Any:
    return p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]


def _nearer(found: tuple[Any, Any], edge: tuple[Any, ...], x: Any, y: Any, xp: Any) -> tuple[Any, Any]:
    """The least squared distance of places to edges, and a number with the sign of their side, after one edge more."""
    (sx, sy), (ex, ey), low, high, normals = edge
    ax, ay = x - sx, y - sy
    t = xp.clip((ax * ex + ay * ey) / (ex * ex + ey * ey), low, high)
    square = (ax - t * ex) ** 2 + (ay - t * ey) ** 2
    is_begin, is_end = t <= low, t >= high
    nx, ny = (xp.where(is_begin, n[1], xp.where(is_end, n[2], n[0])) for n in normals.T)
    side = (ax - is_end * ex) * nx + (ay - is_end * ey) * ny  # from the corner, if that is nearest
    nearer = square < found[0]
    return xp.where(nearer, square, found[0]), xp.where(nearer, side, found[1])


def _apply_sign(found: tuple[Any, Any], xp: Any) -> Any:
    least, side = found
    distance = xp.sqrt(xp.where(least > 0, least, 1.0)) * (least > 0)  # the root has no slope at 0
    return xp.where(side < 0, -distance, distance)


def _edge_distances(edges: tuple[Any, ...], points: Any) -> Any:
    """Signed distances (...) of points (..., 2), edge by edge: arrays of (points x edges) took six times as long."""
    x, y = points[..., 0], points[..., 1]

    def compare(found: tuple[Any, Any], edge: tuple[Any, ...]) -> tuple[tuple[Any, Any], None]:
        return _nearer(found, edge, x, y, jnp), None

    start = jnp.full_like(x, jnp.inf), jnp.zeros_like(x)
    return _apply_sign(lax.scan(compare, start, tuple(map(jnp.asarray, edges)))[0], jnp)


@pytree(data_fields=["arrays"], meta_fields=[])
@dataclass(frozen=True, eq=False)
class _Edges:
    """The edges of an outline, the last one repeated up to a power of two."""

    arrays: tuple[Any, ...]

    def __call__(self, points: Any) -> Any:
        return _edge_distances(self.arrays, points)


_distance_samples = blockwise(lambda edges, places: edges(places.T))

# Coordinates for which NumPy takes as long as a function of JAX to be called; 87 and 9 ns for each of many places.
_FEW = 256


class _Outline(AbstractRegion):
    """Base of the regions bounded by straight edges on a picture."""

    vertices: Any
    is_closed: ClassVar[bool]

    @property
    def dim(self) -> int:
        return 2

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        p = np.asarray(points, dtype=np.float64)
        if library.loops() is not None:
            return edge_distances(self._own_edges, p.reshape(-1, 2)).reshape(p.shape[:-1])
        if p.size <= _FEW:
            x, y = p[..., 0], p[..., 1]
            found = np.full(x.shape, np.inf), np.zeros(x.shape)
            for edge in zip(*self._own_edges, strict=True):
                found = _nearer(found, edge, x, y, np)
            return np.asarray(_apply_sign(found, np))
        return np.asarray(_distance_samples(self.to_jax(), p.reshape(-1, 2).T)).reshape(p.shape[:-1])

    def __call__(self, points: Any) -> Any:
        return _edge_distances(self._edges(jnp.asarray(self.vertices), jnp), jnp.asarray(points))

    @cached_property
    def _own_edges(self) -> tuple[Any, ...]:
        return self._edges(np.asarray(self.vertices), np)

    def to_jax(self) -> _Edges:
        edges = self._own_edges
        full = 1 << (len(edges[0]) - 1).bit_length()
        return _Edges(tuple(part[np.minimum(np.arange(full), len(part) - 1)] for part in edges))

    def _edges(self, v: Any, xp: Any) -> tuple[Any, ...]:
        """Starts, directions, the range along each from 0 to 1, which extends at the ends of an open line, and normals.

        The normals of every edge are (E, 3, 2): its own, out of the region, and the sums with those before and after
        it, which decide the side where a corner is nearest, at any angle.
        """
        edge = (xp.roll(v, -1, axis=0) if self.is_closed else v[1:]) - v[: len(v) - (not self.is_closed)]
        low, high = np.zeros(len(edge)), np.ones(len(edge))
        if not self.is_closed:
            low[0], high[-1] = -np.inf, np.inf
        normal = xp.stack([-edge[:, 1], edge[:, 0]], axis=-1) / xp.sqrt((edge**2).sum(-1, keepdims=True))
        if self.is_closed:
            w = v - v[:1]  # far from the origin the products would cancel
            normal = normal * xp.where(_cross(w, xp.roll(w, -1, axis=0)).sum() > 0, -1.0, 1.0)
        before, after = xp.roll(normal, 1, axis=0), xp.roll(normal, -1, axis=0)
        return v[: len(edge)], edge, low, high, xp.stack([normal, normal + before, normal + after], axis=1)

    def tree_flatten(self) -> tuple[tuple[Any, ...], Any]:
        """The arrays that JAX traces, and the constants."""
        return (_leaf(self.vertices),), None

    @classmethod
    def tree_unflatten(cls, _aux: Any, leaves: tuple[Any, ...]) -> Any:
        """The object rebuilt from the leaves that JAX returns; nothing is checked."""
        made = object.__new__(cls)
        object.__setattr__(made, "vertices", leaves[0])
        return made


@pytree_node
@dataclass(frozen=True)
class Polygon(_Outline):
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

    def samples(self, count: int) -> NDArray[np.float64]:
        v = np.asarray(self.vertices)
        return _inside(self, v.min(axis=0), v.max(axis=0), count)


@pytree_node
@dataclass(frozen=True)
class Line(_Outline):
    """One side of an open line on a picture, whose first and last edge continue straight to infinity.

    Parameters
    ----------
    vertices : two or more places (a, b). Inside is the left side of the line, followed from its first vertex to its
        last, on a picture whose b points down.
    stops : whether a cut along the line stops at its first vertex, and at its last; else it continues to the border of
        the picture. The two sides are the same either way; see :meth:`opening`. The part of a line that turns back
        beyond the level of its tip stays shut: an arc of up to half a circle opens as a whole.

    Raises
    ------
    DeformError
        If the line crosses itself, also where its ends continue.

    Examples
    --------
    >>> middle = Line([(5, 9), (5, 0)])  # drawn upwards
    >>> middle.signed_distance([[3, 2], [9, 40]]).tolist()
    [-2.0, 4.0]
    """

    vertices: tuple[tuple[float, float], ...]
    stops: tuple[bool, bool] = (False, False)
    kind: ClassVar[str] = "line"
    is_closed: ClassVar[bool] = False

    def __post_init__(self) -> None:
        v = _array_of(self.vertices, "places of a line", 2, (2,))
        object.__setattr__(self, "vertices", tuple(map(tuple, v.tolist())))
        stops = any_array(self.stops)
        if stops.shape != (2,) or stops.dtype != np.bool_:
            raise DeformError(
                "the stops of a line are two of True and False, for its first vertex and its last, got "
                f"{self.stops!r:.60}."
            )
        object.__setattr__(self, "stops", tuple(stops.tolist()))
        _refuse_crossing(v, "line (its ends go on straight)", is_closed=False)

    def opening(self, points: Any, xp: Any = np) -> Any:
        """Share of the opening of a cut along the line at places (..., 2) before the deformation: from 0, shut, to 1.

        The product over the tips, the vertices at which it stops, of ``S(t) = t^2 (3 - 2 t)`` with
        ``t = clamp((tip - x) . e / L, 0, 1)``; e is the unit direction in which the line would continue, and L half the
        length of the line. It has a continuous derivative and is 0 from the tip onwards, and 1 where no tip is near.

        Examples
        --------
        >>> slit = Line([(5, 0), (5, 8)], stops=(False, True))
        >>> slit.opening([[5, 2], [9, 6], [5, 8], [5, 20]]).tolist()
        [1.0, 0.5, 0.0, 0.0]
        """
        ends = [self._end_coordinate(end, points, xp) for end in self._tips(xp)]
        total = xp.ones(xp.asarray(points).shape[:-1])
        for t in ends:
            total = total * t * t * (3.0 - 2.0 * t)
        return total

    def opening_gradient(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The derivative (..., 2) of :meth:`opening` at places (..., 2)."""
        tips = self._tips(np)
        ends = [self._end_coordinate(end, points, np) for end in tips]
        total = np.zeros(points.shape)
        for k, (t, (_, outward)) in enumerate(zip(ends, tips, strict=True)):
            others = np.prod([s * s * (3.0 - 2.0 * s) for j, s in enumerate(ends) if j != k], axis=0)
            total -= (others * 6.0 * t * (1.0 - t))[..., None] * outward
        return total

    def _tips(self, xp: Any) -> list[tuple[Any, Any]]:
        """The places where a cut stops, each with the direction in which the line would continue, divided by L."""
        v = xp.asarray(self.vertices, dtype=float) if xp is np else xp.asarray(self.vertices)
        edges = v[1:] - v[:-1]
        lengths = xp.sqrt((edges**2).sum(-1))
        ends = ((v[0], -edges[0] / lengths[0]), (v[-1], edges[-1] / lengths[-1]))
        return [(tip, 2.0 * e / lengths.sum()) for (tip, e), is_tip in zip(ends, self.stops, strict=True) if is_tip]

    def _end_coordinate(self, end: tuple[Any, Any], points: Any, xp: Any) -> Any:
        tip, outward = end
        return xp.clip(((tip - xp.asarray(points)) * outward).sum(-1), 0.0, 1.0)

    def tree_flatten(self) -> tuple[tuple[Any, ...], Any]:
        """The arrays that JAX traces, and the constants."""
        return (_leaf(self.vertices),), self.stops

    @classmethod
    def tree_unflatten(cls, aux: Any, leaves: tuple[Any, ...]) -> Line:
        """The object rebuilt from the leaves that JAX returns; nothing is checked."""
        made: Line = super().tree_unflatten(None, leaves)
        object.__setattr__(made, "stops", aux)
        return made


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


def _meet(
    start: NDArray[np.float64],
    edge: NDArray[np.float64],
    length: NDArray[np.float64],
    low: NDArray[np.float64],
    high: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Pairs of edges ``start + t edge``, t from low to high, that have a place in common."""
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


# Masks of more voxels are measured at half the resolution: 256^3 takes 0.7 s instead of 6 s. The mask only grows by it.
_MOST_VOXELS = 4_000_000

# The distance of an empty mask. Infinity itself would become NaN in interpolations (0 inf) and in the scales of rigid
# parts (inf / inf); this is the largest coordinate that a point may have, and its square is still a float32.
_NOWHERE = LARGEST_COORDINATE

MaskForm: TypeAlias = Literal["ellipsoid", "box"]
"""Forms of masks that are drawn."""

# Voxels of a drawn mask along its longest axis, and at least along each: a face then lies within a hundredth of it.
_MOST_DRAWN, _FEWEST_DRAWN = 64, 8


@pytree_node
@dataclass(frozen=True, eq=False)
class Mask(AbstractRegion):
    """The pixels or voxels of a mask; the boundary runs along their faces.

    Parameters
    ----------
    values : bool, [v, u] on a raster or [z, y, x] on a grid.
    lattice : their places, a :class:`~deformnb.volume.plane.Raster` or a :class:`~deformnb.volume.volume.Grid`.

    Notes
    -----
    Distances of the centres are those to the faces of the voxel with the nearest centre, at most half its diagonal
    more than to the nearest face; between the centres they are interpolated. Outside the lattice its distance is added:
    a mask that reaches the lattice's edge extends there, as far as it is deep. A mask of more than 4 million voxels is
    measured at half the resolution, which shifts its boundary by up to a voxel. A mask in which nothing is set is at
    1e15, farther than any point may be, and one in which all is set is around every place, as deep.

    Examples
    --------
    >>> bone = Mask(np.array([[False, True, True, False]]), Raster((1, 4), (2.0, 2.0), (0.0, 0.0)))
    >>> bone.signed_distance([[1.0, 0.0], [6.0, 0.0]]).tolist()
    [0.0, 1.0]
    """

    values: NDArray[np.bool_]
    lattice: Raster | Grid
    kind: ClassVar[str] = "mask"

    def __post_init__(self) -> None:
        values = np.array(any_array(self.values))
        if values.dtype != np.bool_:
            raise DeformError(f"a mask holds True and False, got {values.dtype}; compare it with a label first.")
        if isinstance(self.lattice, Volume):
            object.__setattr__(self, "lattice", self.lattice.grid)
        check_fields(self, "lattice")
        if values.shape != tuple(self.lattice.shape):
            raise DeformError(f"a mask of shape {values.shape} does not fit a lattice of {tuple(self.lattice.shape)}.")
        values.flags.writeable = False
        object.__setattr__(self, "values", values)

    @classmethod
    def from_labels(cls, volume: VolumeLike, labels: int | Sequence[int] | None = None) -> Mask:
        """The voxels of these labels of a volume, of any but 0 if None.

        Raises
        ------
        DeformError
            If no voxel has one of them; the message names the labels there are.
        """
        volume = as_volume(volume)
        chosen = [labels] if isinstance(labels, int | np.integer) else labels
        values = volume.values != 0 if chosen is None else np.isin(volume.values, list(chosen))
        if not values.any():
            present = np.unique(volume.values)[:20].tolist()
            raise DeformError(f"no voxel of {volume.name or 'the volume'} has a label of {chosen}; it has {present}.")
        return cls(values, volume.grid)

    @classmethod
    def drawn(cls, form: MaskForm, middle: Sequence[float], radii: Sequence[float], frame: ArrayLike) -> Mask:
        """An ellipsoid or a box in space, in voxels that are finer than what is seen of it.

        Parameters
        ----------
        form : "ellipsoid" or "box".
        middle : of it. radii : half its lengths along the rows of ``frame``.
        frame : three unit vectors at right angles, one in each row.

        Examples
        --------
        >>> ball = Mask.drawn("ellipsoid", (10, 20, 30), (5, 5, 5), np.eye(3))
        >>> ball.signed_distance([[10, 20, 30], [18, 20, 30]]).round().tolist()
        [-5.0, 3.0]
        """
        if form not in get_args(MaskForm):
            raise DeformError(f"a mask is drawn as one of {', '.join(get_args(MaskForm))}, got {form!r:.40}.")
        axes, half = np.asarray(frame, dtype=np.float64), np.asarray(radii, dtype=np.float64)
        if not (np.isfinite(half).all() and (half > 0).all()):
            raise DeformError(f"the radii of a drawn mask must be positive lengths, got {half.tolist()}.")
        counts = np.maximum(_FEWEST_DRAWN, np.ceil(_MOST_DRAWN * half / half.max())).astype(int)
        spacing, sizes = 2 * half / counts, counts + 2  # a layer around it in which nothing is set
        origin = np.asarray(middle, dtype=np.float64) - (spacing * (sizes - 1) / 2) @ axes
        u, v, n = (np.abs(2 * np.arange(size) - size + 1) / count for size, count in zip(sizes, counts, strict=True))
        z, y, x = np.meshgrid(n, v, u, indexing="ij")
        values = x * x + y * y + z * z <= 1 if form == "ellipsoid" else np.maximum(np.maximum(x, y), z) <= 1
        direction: Any = tuple(map(tuple, axes.T.tolist()))
        shape: Any = tuple(int(k) for k in sizes[::-1])
        return cls(values, Grid(shape, tuple(spacing.tolist()), tuple(origin.tolist()), direction))

    def silhouette(self, plane: Plane) -> Mask:
        """Silhouette of a mask in space on a picture: every pixel with a voxel of it in front or behind."""
        if not isinstance(self.lattice, Grid):
            raise DeformError("this mask is on a picture already.")
        grid = self.lattice
        along = np.abs(plane.frame[:2] @ np.asarray(grid.direction))  # [u v, axis x y z]
        is_aligned = bool((along.max(axis=1) > 1 - 1e-6).all())
        spacing = [grid.spacing[int(k)] if is_aligned else min(grid.spacing) for k in along.argmax(axis=1)]
        corners = plane.to_plane(grid.corners(centres=True))[:, :2]
        origin = corners.min(axis=0)
        counts = np.round(np.ptp(corners, axis=0) / spacing).astype(int) + 1
        flat = np.zeros((counts[1], counts[0]), dtype=bool)
        # What hides the rest is enough; on an oblique picture places so dense that no pixel between others stays empty.
        depth = int(along.argmax(axis=1).sum()) - 1  # of the array: the axis that is neither u nor v
        surface = (
            self.values.any(axis=depth, keepdims=True)
            if is_aligned
            else self.values & ~ndimage.binary_erosion(self.values)
        )
        index = np.argwhere(surface)[:, ::-1].astype(np.float64)
        counted = [1 if is_aligned else int(np.ceil(2 * s / min(grid.spacing))) for s in grid.spacing]
        for offset in product(*((np.arange(n) + 0.5) / n - 0.5 for n in counted)):
            at = plane.to_plane(grid.index_to_point(index + np.array(offset)))[:, :2]
            cell = np.clip(np.round((at - origin) / spacing).astype(int), 0, counts - 1)
            flat[cell[:, 1], cell[:, 0]] = True
        return Mask(
            flat,
            Raster((int(counts[1]), int(counts[0])), (spacing[0], spacing[1]), (float(origin[0]), float(origin[1]))),
        )

    @property
    def dim(self) -> int:
        return 2 if isinstance(self.lattice, Raster) else 3

    def samples(self, count: int) -> NDArray[np.float64]:
        index = np.argwhere(self.values)[:, ::-1].astype(np.float64)
        index = index[:: max(1, len(index) // count**self.dim)]
        if isinstance(self.lattice, Grid):
            return self.lattice.index_to_point(index)
        return np.asarray(self.lattice.origin) + index * np.asarray(self.lattice.spacing)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mask):
            return NotImplemented
        return self.lattice == other.lattice and np.array_equal(self.values, other.values)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.lattice, self.values.tobytes()))  # 20 ms for 256^3, and a drag needs it at every block

    @cached_property
    def _distance_samples(self) -> tuple[NDArray[np.float32], Raster | Grid]:
        """Signed distances of the centres, and their places."""
        values, lattice = self.values, self.lattice
        if values.size > _MOST_VOXELS and isinstance(lattice, Grid):
            values, lattice = _halve(values, lattice)
        h = np.asarray(lattice.spacing)[::-1]
        outside, inside = _box_distance(values, h), _box_distance(~values, h)
        return np.where(values, -inside, outside).astype(np.float32), lattice

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        distances, lattice = self._distance_samples
        p = np.asarray(points, dtype=np.float64)
        index, beyond = _clamped_index(lattice, p.reshape(-1, self.dim), np)
        # float32 samples: SciPy would otherwise copy them to float64 at every call
        found = ndimage.map_coordinates(distances, index.T[::-1], order=1, mode="nearest", output=np.float64)
        return (found + beyond).reshape(p.shape[:-1])

    @full_precision
    def __call__(self, points: Any) -> Any:
        distances, lattice = self._distance_samples
        index, beyond = _clamped_index(lattice, jnp.asarray(points), jnp)
        at = [index[..., k] for k in reversed(range(self.dim))]
        values = jnp.asarray(distances).astype(index.dtype)
        return jax.scipy.ndimage.map_coordinates(values, at, order=1, mode="nearest") + beyond

    def tree_flatten(self) -> tuple[tuple[Any, ...], Any]:
        """The arrays that JAX traces, and the constants."""
        distances, lattice = self._distance_samples
        return (distances,), (lattice, self.dim)

    @classmethod
    def tree_unflatten(cls, aux: Any, leaves: tuple[Any, ...]) -> Mask:
        """The object rebuilt from the leaves that JAX returns; nothing is checked."""
        made = object.__new__(cls)
        object.__setattr__(made, "lattice", aux[0])
        made.__dict__["_distance_samples"] = (leaves[0], aux[0])
        return made


def _halve(values: NDArray[np.bool_], grid: Grid) -> tuple[NDArray[np.bool_], Grid]:
    """Blocks of 2 x 2 x 2 voxels, set where one of them is."""
    odd = [n % 2 for n in values.shape]
    even = np.pad(values, [(0, n) for n in odd])
    z, y, x = (n // 2 for n in even.shape)
    coarse: NDArray[np.bool_] = np.asarray(even.reshape(z, 2, y, 2, x, 2).any(axis=(1, 3, 5)))
    first = grid.index_to_point([0.5, 0.5, 0.5])
    spacing = tuple(2 * s for s in grid.spacing)
    return coarse, replace(grid, shape=(z, y, x), spacing=spacing, origin=tuple(first))  # type: ignore[arg-type]


def _box_distance(values: NDArray[np.bool_], spacing: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of every centre to the nearest voxel that is set, measured to its faces; 1e15 if there is none."""
    if not values.any():  # SciPy would return a plausible ramp
        return np.full(values.shape, _NOWHERE)
    nearest = ndimage.distance_transform_edt(~values, sampling=spacing, return_distances=False, return_indices=True)
    square = np.zeros(values.shape)
    for axis, (at, h) in enumerate(zip(nearest, spacing, strict=True)):
        own = np.arange(values.shape[axis]).reshape([-1 if k == axis else 1 for k in range(values.ndim)])
        square += np.maximum(np.abs(at - own) - 0.5, 0.0) ** 2 * h**2
    return np.sqrt(square)


def _clamped_index(lattice: Raster | Grid, points: Any, xp: Any) -> tuple[Any, Any]:
    """Fractional index of the nearest place within a lattice, and the distance of the point from there."""
    origin = np.asarray(lattice.origin)
    shape = np.asarray(lattice.shape[::-1])
    if isinstance(lattice, Raster):
        index, matrix = (points - origin) / np.asarray(lattice.spacing), np.diag(lattice.spacing)
    else:
        index, matrix = (points - origin) @ lattice.inverse.T, lattice.matrix
    clamped = xp.clip(index, 0.0, shape - 1.0)
    square = (((index - clamped) @ matrix.T) ** 2).sum(-1)
    return clamped, xp.sqrt(xp.where(square > 0, square, 1.0)) * (square > 0)

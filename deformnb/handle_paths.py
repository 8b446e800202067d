"""Ways of control points between two key frames that neither shrink nor shear what turns.

A straight way for every point makes a limb that turns by an angle shorter by cos(angle / 2) halfway. So it is the edges
between neighbouring points that are interpolated: each turns at an even pace and its length changes evenly. The places
are those that fit the edges best, as in Alexa, Cohen-Or, Levin, "As-rigid-as-possible shape interpolation" (2000),
with the neighbours of a point in the place of triangles.

What an angle counts is seen in the turn of all edges around a point at once; two neighbours turn by almost the same, so
that a tail that curls by more than half a turn goes round and not back.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from deformnb.errors import DeformError

Points = NDArray[np.float64]

_NEIGHBOURS = {2: 6, 3: 10}
# An edge that becomes longer or shorter by this share counts half: it spans a joint and says nothing of a limb's turn.
_STRAIN = 0.05
# What a direction that no edge shows is turned by: as all points together.
_PRIOR_TURN = 1e-3
_STILL = 1e-9


class HandlePath:
    """Where points are on the way from one set of places to another.

    Parameters
    ----------
    start, end : (N, dim) places at t = 0 and t = 1; dim is 2 or 3.
    rest : (N, dim) places that tell who is whose neighbour; default is ``start``.
    held : (N,) bool; points whose way is given in :meth:`at`. Those that do not move are held by themselves.

    Attributes
    ----------
    turns : (N, 3) how far the surroundings of each point turn from start to end, axis times angle in radians.

    Examples
    --------
    A rod that turns about its fixed end by 120 degrees keeps its length.

    >>> path = HandlePath([[0, 0], [5, 0], [10, 0]], [[0, 0], [-2.5, 4.330127], [-5, 8.660254]])
    >>> np.hypot(*path.at(0.5)[2]).round(4), np.hypot(*np.add([10, 0], [-5, 8.660254]) / 2).round(4)
    (np.float64(10.0), np.float64(5.0))
    """

    def __init__(self, start: ArrayLike, end: ArrayLike, rest: ArrayLike | None = None,
                 held: ArrayLike | None = None) -> None:
        a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        if a.shape != b.shape or a.ndim != 2 or a.shape[1] not in (2, 3):
            raise DeformError(f"places at both ends must have the shape (N, 2) or (N, 3), got {a.shape} and {b.shape}.")
        self.start, self.end = a, b
        self._size = max(float(np.ptp(np.concatenate([a, b]), axis=0).max()) if len(a) else 0.0, 1e-300)
        is_still = np.linalg.norm(b - a, axis=1) <= _STILL * self._size
        given = np.zeros(len(a), dtype=bool) if held is None else np.array(held, dtype=bool)
        self._held = given | is_still
        self._middle, self._turn, self._shift = _whole_motion(a, b)
        self.turns = np.zeros((len(a), 3))
        self._solver: Any = None
        self._edge_turns = np.zeros(0)
        if len(a) > 1 and not is_still.all():
            self._set_edges(neighbours(a if rest is None else np.asarray(rest, dtype=np.float64)))
            self._factor()

    def _set_edges(self, edges: NDArray[np.int_]) -> None:
        a, b = (_in_space(points[edges[:, 1]] - points[edges[:, 0]]) for points in (self.start, self.end))
        lengths = np.linalg.norm([a, b], axis=2)
        weight = 1 / ((lengths**2).mean(axis=0) + (1e-4 * self._size) ** 2)
        self.turns = _unwrapped(_turns(edges, weight, a, b, len(self.start), self._turn, self.start.shape[1]), edges)
        base = self.turns[edges].mean(axis=1)
        back = Rotation.from_rotvec(base).inv().apply(b)
        self._edges, self._lengths, self._base = edges, lengths, base
        self._direction = _directions(a, back)
        self._rest = _shortest_turn(self._direction, _directions(back, a))
        strain = np.abs(lengths[1] - lengths[0]) / np.maximum(lengths.max(axis=0), 1e-300)
        self._weight = weight / (1 + (strain / _STRAIN) ** 2)
        # A point that keeps its distance to nobody, not by a quarter, belongs to no limb: it goes straight.
        near = 1 / (1 + (strain / (2 * _STRAIN)) ** 2)
        self._edge_turns = np.linalg.norm(base + self._rest, axis=1)[near > 0.5]
        best, pull = np.zeros(len(self.start)), np.zeros(len(self.start))
        for side in (0, 1):
            np.maximum.at(best, edges[:, side], near)
            np.add.at(pull, edges[:, side], weight)
        self._pull = pull * (1 - best) ** 8

    def _factor(self) -> None:
        n, (i, j), w = len(self.start), self._edges.T, self._weight
        diagonal = np.bincount(i, w, n) + np.bincount(j, w, n)
        pull = self._pull + (0.0 if self._held.any() else 1e-9) * diagonal.mean()  # else all of them could float away
        laplacian = sparse.coo_matrix((np.concatenate([-w, -w, diagonal + pull]),
                                       (np.concatenate([i, j, np.arange(n)]), np.concatenate([j, i, np.arange(n)]))),
                                      (n, n)).tocsc()
        self._free = np.flatnonzero(~self._held)
        rows = laplacian[self._free]
        self._to_held = rows[:, np.flatnonzero(self._held)]
        self._solver = splu(rows[:, self._free].tocsc()) if len(self._free) else None

    def at(self, t: float, held: ArrayLike | None = None) -> Points:
        """Places (N, dim) at t in [0, 1]; the start at 0 and the end at 1 exactly.

        Parameters
        ----------
        held : (N, dim) places of the points that are held; what it says of others does not count.
        """
        if t in (0, 1):
            return np.array(self.end if t else self.start)
        path = self._path(t)
        if self._held.all() and held is None:
            return path
        wanted = path if held is None else np.asarray(held, dtype=np.float64)
        still = np.linalg.norm(self.end - self.start, axis=1) <= _STILL * self._size
        fixed = np.where(still[:, None], path, wanted)
        result = np.where(self._held[:, None], fixed, path)
        if self._solver is None:
            return result
        # What is looked for is how far the places lie from the path: nothing for a motion that is rigid as a whole.
        i, j = self._edges.T
        missing = self._weight[:, None] * (self._edges_at(t) - (path[j] - path[i]))
        right = np.zeros_like(path)
        np.add.at(right, j, missing)
        np.subtract.at(right, i, missing)
        known = (result - path)[self._held]
        result[self._free] += self._solver.solve(right[self._free] - self._to_held @ known)
        return result

    def _path(self, t: float) -> Points:
        """The way that says nothing of neighbours: straight if some points are held, else with the whole motion."""
        if self._held.any():
            return np.asarray(self.start + t * (self.end - self.start))
        a, b, dim = _in_space(self.start), _in_space(self.end), self.start.shape[1]
        # The end, seen by someone who takes part in the motion of all, differs from the start only by what bends.
        seen = _advanced(b, -1.0, self._middle, self._turn, self._shift)
        return np.asarray(_advanced((1 - t) * a + t * seen, t, self._middle, self._turn, self._shift)[:, :dim])

    def _edges_at(self, t: float) -> Points:
        length = (1 - t) * self._lengths[0] + t * self._lengths[1]
        turned = Rotation.from_rotvec(t * self._rest).apply(self._direction)
        turned = Rotation.from_rotvec(t * self._base).apply(turned)
        return np.asarray(length[:, None] * turned)[:, : self.start.shape[1]]

    @property
    def largest_turn(self) -> float:
        """The largest angle in radians by which the surroundings of a point turn, or an edge that keeps its length."""
        around = float(np.linalg.norm(self.turns, axis=1).max(initial=0.0))
        return max(around, float(self._edge_turns.max(initial=0.0)))


def neighbours(points: Points) -> NDArray[np.int_]:
    """Pairs (E, 2) of points that lie near each other; every point can be reached from every other."""
    n, dim = points.shape
    if n < 2:
        return np.zeros((0, 2), dtype=int)
    found = cKDTree(points).query(points, k=min(n, _NEIGHBOURS[dim] + 1))[1]
    pairs = np.stack([np.repeat(np.arange(n), found.shape[1]), found.ravel()], axis=1)
    edges = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    while True:
        graph = sparse.coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (n, n))
        count, group = connected_components(graph, directed=False)
        if count == 1:
            return edges
        inside, outside = np.flatnonzero(group == group[0]), np.flatnonzero(group != group[0])
        distance, nearest = map(np.asarray, cKDTree(points[inside]).query(points[outside]))
        k = int(distance.argmin())
        edges = np.concatenate([edges, [[inside[nearest[k]], outside[k]]]])


def _in_space(vectors: Points) -> Points:
    return vectors if vectors.shape[1] == 3 else np.pad(vectors, ((0, 0), (0, 1)))


def _whole_motion(a: Points, b: Points) -> tuple[Points, Points, Points]:
    """The rigid motion that brings a nearest to b: a fixed place (or the middle), axis times angle, shift along it."""
    if not len(a):
        return np.zeros(3), np.zeros(3), np.zeros(3)
    before, after = _in_space(a), _in_space(b)
    p, q = before.mean(axis=0), after.mean(axis=0)
    turn = _kabsch(((after - q).T @ (before - p))[None], np.zeros((1, 3, 3)), a.shape[1])[0]
    angle = float(np.linalg.norm(turn))
    if angle < 1e-6:  # the fixed place would be too far away for its digits: a shift
        return p, turn, q - p
    axis = turn / angle
    along = (q - p) @ axis * axis
    across = q - p - along
    centre = p + across / 2 + np.cross(axis, across) / (2 * np.tan(angle / 2))
    return centre, turn, along


def _advanced(points: Points, t: float, middle: Points, turn: Points, shift: Points) -> Points:
    return np.asarray(Rotation.from_rotvec(t * turn).apply(points - middle) + middle + t * shift)


def _turns(edges: NDArray[np.int_], weight: Points, a: Points, b: Points, count: int, whole: Points,
           dim: int) -> Points:
    """The rotation of the edges around each point, axis times angle: (N, 3)."""
    outer = (weight[:, None, None] * b[:, :, None]) * a[:, None, :]
    sums = np.zeros((count, 3, 3))
    np.add.at(sums, edges[:, 0], outer)
    np.add.at(sums, edges[:, 1], outer)
    return _kabsch(sums, Rotation.from_rotvec(whole).as_matrix()[None], dim)


def _kabsch(sums: Points, prior: Points, dim: int) -> Points:
    """Rotations (axis times angle) nearest to sums (N, 3, 3) of outer products after x before."""
    if dim == 2:
        angle = np.arctan2(sums[:, 1, 0] - sums[:, 0, 1], sums[:, 0, 0] + sums[:, 1, 1])
        return np.stack([np.zeros_like(angle), np.zeros_like(angle), angle], axis=1)
    size = np.linalg.norm(sums, axis=(1, 2), keepdims=True)
    u, _, vt = np.linalg.svd(sums + _PRIOR_TURN * size * prior)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    return np.asarray(Rotation.from_matrix(u @ vt).as_rotvec())


def _unwrapped(turns: Points, edges: NDArray[np.int_]) -> Points:
    """The same rotations, each with the whole turns that bring it nearest to its neighbour's; the least one begins."""
    around: list[list[int]] = [[] for _ in turns]
    for i, j in edges.tolist():
        around[i].append(j)
        around[j].append(i)
    angles = np.linalg.norm(turns, axis=1)
    result, first = turns.copy(), int(angles.argmin())
    seen, waiting = {first}, deque([first])
    while waiting:
        i = waiting.popleft()
        for j in around[i]:
            if j not in seen:
                seen.add(j)
                waiting.append(j)
                if angles[j] > 0:
                    axis = turns[j] / angles[j]
                    whole = np.round((result[i] @ axis - angles[j]) / (2 * np.pi))
                    result[j] = turns[j] + 2 * np.pi * whole * axis
    return result


def _directions(vectors: Points, instead: Points) -> Points:
    """Vectors of length 1; where there is none, that of ``instead``."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    other = np.linalg.norm(instead, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1),
                    instead / np.where(other > 0, other, 1))


def _shortest_turn(a: Points, b: Points) -> Points:
    """Axis times angle of the turn that brings each direction of a to that of b."""
    cross, dot = np.cross(a, b), (a * b).sum(axis=1)
    sine = np.linalg.norm(cross, axis=1)
    is_opposite = (sine < 1e-12) & (dot < 0)
    if is_opposite.any():  # about any axis across; in the plane there is one
        flat = a[is_opposite]
        spare = np.eye(3)[np.abs(flat).argmin(axis=1)]
        spare[flat[:, 2] == 0] = (0.0, 0.0, 1.0)
        across = spare - (spare * flat).sum(axis=1, keepdims=True) * flat
        cross[is_opposite] = across / np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(np.arctan2(sine, dot)[:, None] * cross / np.where(is_opposite | (sine == 0), 1, sine)[:, None])

"""Motion paths of a step between two key frames: as-rigid-as-possible for its points, even for its numbers.

Differences between the two keys:

- A point that only one key has, or that is switched on at one only, is at the other where that key's own deformation
  takes it. So a point that was added later changes nothing before.
- A step that only one key has, or that is switched off at one, comes or goes: at the other key nothing is dragged. So
  do two steps at one place of the list that have different planes.
- A kernel, a trend, a rule of extrusion, cuts and the places of rigid parts have nothing between them: those of the
  earlier key hold until the later one. ``notes`` reports it.

The paths of control points neither shrink nor shear what turns. A straight path for every point makes a limb that
turns by an angle shorter by cos(angle / 2) halfway. So it is the edges between neighbouring points that are
interpolated: each turns at an even pace and its length changes evenly. The places are those that fit the edges best, as
in Alexa, Cohen-Or, Levin, "As-rigid-as-possible shape interpolation" (2000), with the neighbours of a point in the
place of triangles.

The number of full turns in an angle follows from the turn of all edges around a point together; two neighbours turn by
almost the same, so that a tail that curls by more than half a turn goes round and not back.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import fields, replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import scipy
from deformnb._typing import Floats
from deformnb.document.deformation import STEP_LABELS, Step
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import box_diagonal
from deformnb.rbf.cuts import sides_of
from deformnb.rbf.extrusion import CURVE_KNOTS, modulate
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.fit_settings import SETTINGS, FitSettings
from deformnb.rbf.fitting import fit_points
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidMotion, RigidPart, scaled_points
from deformnb.rbf.slits import is_slit

Points = NDArray[np.float64]

_NEIGHBOURS = {2: 6, 3: 10}
# An edge that becomes longer or shorter by this share counts half: it spans a joint and shows no limb's turn.
_STRAIN = 0.05
# The turn of a direction that no edge has: that of all points together.
_PRIOR_TURN = 1e-3
_STILL = 1e-9


class HandlePath:
    """Paths of points from one set of places to another.

    Parameters
    ----------
    start, end : (N, dim) places at t = 0 and t = 1; dim is 2 or 3.
    rest : (N, dim) places that determine the neighbours; default is ``start``.
    held : (N,) bool; points whose path is given in :meth:`at`. Those that do not move are always among them.

    Attributes
    ----------
    turns : (N, 3) rotation of the surroundings of each point from start to end, axis times angle in radians.

    Examples
    --------
    A rod that turns about its fixed end by 120 degrees keeps its length.

    >>> path = HandlePath([[0, 0], [5, 0], [10, 0]], [[0, 0], [-2.5, 4.330127], [-5, 8.660254]])
    >>> np.hypot(*path.at(0.5)[2]).round(4), np.hypot(*np.add([10, 0], [-5, 8.660254]) / 2).round(4)
    (np.float64(10.0), np.float64(5.0))
    """

    def __init__(
        self, start: ArrayLike, end: ArrayLike, rest: ArrayLike | None = None, held: ArrayLike | None = None
    ) -> None:
        a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        if a.shape != b.shape or a.ndim != 2 or a.shape[1] not in (2, 3):
            raise DeformError(f"places at both ends must have the shape (N, 2) or (N, 3), got {a.shape} and {b.shape}.")
        self.start, self.end = a, b
        size = max(float(np.ptp(np.concatenate([a, b]), axis=0).max()) if len(a) else 0.0, 1e-300)
        self._is_still = np.linalg.norm(b - a, axis=1) <= _STILL * size
        given = np.zeros(len(a), dtype=bool) if held is None else np.array(held, dtype=bool)
        self._held = given | self._is_still
        self._whole = _whole_motion(a, b)
        self._edges: _Edges | None = None
        self._solver: Any = None
        if len(a) > 1 and not self._is_still.all():
            pairs = neighbours(a if rest is None else np.asarray(rest, dtype=np.float64))
            self._edges = _Edges(pairs, a, b, size, self._whole[1])
            self._factor(self._edges)
        self.turns = np.zeros((len(a), 3)) if self._edges is None else self._edges.turns

    def _factor(self, edges: _Edges) -> None:
        self._free = np.flatnonzero(~self._held)
        rows = edges.laplacian(0.0 if self._held.any() else 1e-9)[self._free]  # else all of them could float away
        self._to_held = rows[:, np.flatnonzero(self._held)]
        self._solver = scipy.sparse.linalg.splu(rows[:, self._free].tocsc()) if len(self._free) else None

    def at(self, t: float, held: ArrayLike | None = None) -> Points:
        """Places (N, dim) at t in [0, 1]; the start at 0 and the end at 1 exactly.

        Parameters
        ----------
        held : (N, dim) places of the points that are held; other rows are ignored.
        """
        if t in (0, 1):
            return np.array(self.end if t else self.start)
        path = self._path(t)
        if self._held.all() and held is None:
            return path
        prescribed = path if held is None else np.asarray(held, dtype=np.float64)
        fixed = np.where(self._is_still[:, None], path, prescribed)
        result = np.where(self._held[:, None], fixed, path)
        if self._edges is None or self._solver is None:
            return result
        # The unknown is the distance of the places from the path: zero for a motion that is rigid as a whole.
        right = self._edges.edge_residuals(t, path)
        known = (result - path)[self._held]
        result[self._free] += self._solver.solve(right[self._free] - self._to_held @ known)
        return result

    def _path(self, t: float) -> Points:
        """The path without regard to neighbours: straight if some points are held, else with the whole motion."""
        if self._held.any():
            return np.asarray(self.start + t * (self.end - self.start))
        a, b, dim = _to_space(self.start), _to_space(self.end), self.start.shape[1]
        # The end, seen by someone who takes part in the motion of all, differs from the start only by what bends.
        seen = _advance(b, -1.0, *self._whole)
        return np.asarray(_advance((1 - t) * a + t * seen, t, *self._whole)[:, :dim])

    @property
    def largest_turn(self) -> float:
        """The largest angle in radians by which the surroundings of a point turn, or an edge of constant length."""
        around = float(np.linalg.norm(self.turns, axis=1).max(initial=0.0))
        return around if self._edges is None else max(around, float(self._edges.of_limbs.max(initial=0.0)))


class _Edges:
    """Edges between neighbours, each of which turns and becomes longer or shorter separately.

    Attributes
    ----------
    turns : (N, 3) rotation of the surroundings of each point.
    of_limbs : angles by which the edges of constant length turn.
    """

    def __init__(self, pairs: NDArray[np.int_], start: Points, end: Points, size: float, turn: Points) -> None:
        self._ends, self._dim = pairs.T, start.shape[1]
        a, b = (_to_space(points[pairs[:, 1]] - points[pairs[:, 0]]) for points in (start, end))
        lengths = np.linalg.norm([a, b], axis=2)
        weight = 1 / ((lengths**2).mean(axis=0) + (1e-4 * size) ** 2)
        self.turns = _unwrap(_turns(pairs, weight, a, b, len(start), turn, self._dim), pairs)
        self._lengths, self._base = lengths, self.turns[pairs].mean(axis=1)
        back = scipy.spatial.transform.Rotation.from_rotvec(self._base).inv().apply(b)
        self._direction = _directions(a, back)
        self._rest = _shortest_turn(self._direction, _directions(back, a))
        strain = np.abs(lengths[1] - lengths[0]) / np.maximum(lengths.max(axis=0), 1e-300)
        self._weight = weight / (1 + (strain / _STRAIN) ** 2)
        # A point whose distances to all others change by more than a quarter belongs to no limb: it moves straight.
        near = 1 / (1 + (strain / (2 * _STRAIN)) ** 2)
        self.of_limbs = np.linalg.norm(self._base + self._rest, axis=1)[near > 0.5]
        best, pull = np.zeros(len(start)), np.zeros(len(start))
        for side in self._ends:
            np.maximum.at(best, side, near)
            np.add.at(pull, side, weight)
        self._pull = pull * (1 - best) ** 8

    def laplacian(self, pull: float) -> Any:
        """The sparse matrix of the weights, each point pulled to its path by this share of their mean, or more."""
        n, (i, j), w = len(self._pull), self._ends, self._weight
        diagonal = np.bincount(i, w, n) + np.bincount(j, w, n)
        places = np.concatenate([i, j, np.arange(n)]), np.concatenate([j, i, np.arange(n)])
        values = np.concatenate([-w, -w, diagonal + (self._pull + pull * diagonal.mean())])
        return scipy.sparse.coo_matrix((values, places), (n, n)).tocsc()

    def edge_residuals(self, t: float, path: Points) -> Points:
        """Differences of the edges between these places from those at ``t``, summed at their points."""
        length = (1 - t) * self._lengths[0] + t * self._lengths[1]
        turned = scipy.spatial.transform.Rotation.from_rotvec(t * self._rest).apply(self._direction)
        turned = scipy.spatial.transform.Rotation.from_rotvec(t * self._base).apply(turned)
        (i, j), right = self._ends, np.zeros_like(path)
        missing = self._weight[:, None] * ((length[:, None] * turned)[:, : self._dim] - (path[j] - path[i]))
        np.add.at(right, j, missing)
        np.subtract.at(right, i, missing)
        return right


def neighbours(points: Points) -> NDArray[np.int_]:
    """Pairs (E, 2) of points near each other; every point can be reached from every other."""
    n, dim = points.shape
    if n < 2:
        return np.zeros((0, 2), dtype=int)
    found = scipy.spatial.cKDTree(points).query(points, k=min(n, _NEIGHBOURS[dim] + 1))[1]
    pairs = np.stack([np.repeat(np.arange(n), found.shape[1]), found.ravel()], axis=1)
    edges = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    while True:
        graph = scipy.sparse.coo_matrix((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), (n, n))
        count, group = scipy.sparse.csgraph.connected_components(graph, directed=False)
        if count == 1:
            return edges
        inside, outside = np.flatnonzero(group == group[0]), np.flatnonzero(group != group[0])
        distance, nearest = map(np.asarray, scipy.spatial.cKDTree(points[inside]).query(points[outside]))
        k = int(distance.argmin())
        edges = np.concatenate([edges, [[inside[nearest[k]], outside[k]]]])


def _to_space(vectors: Points) -> Points:
    return vectors if vectors.shape[1] == 3 else np.pad(vectors, ((0, 0), (0, 1)))


def _whole_motion(a: Points, b: Points) -> tuple[Points, Points, Points]:
    """The rigid motion that maps a nearest to b: a fixed place (or the middle), axis times angle, shift along it."""
    if not len(a):
        return np.zeros(3), np.zeros(3), np.zeros(3)
    before, after = _to_space(a), _to_space(b)
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


def _advance(points: Points, t: float, middle: Points, turn: Points, shift: Points) -> Points:
    turned = scipy.spatial.transform.Rotation.from_rotvec(t * turn).apply(points - middle)
    return np.asarray(turned + middle + t * shift)


def _turns(
    edges: NDArray[np.int_], weight: Points, a: Points, b: Points, count: int, whole: Points, dim: int
) -> Points:
    """The rotation of the edges around each point, axis times angle: (N, 3)."""
    outer = (weight[:, None, None] * b[:, :, None]) * a[:, None, :]
    sums = np.zeros((count, 3, 3))
    np.add.at(sums, edges[:, 0], outer)
    np.add.at(sums, edges[:, 1], outer)
    return _kabsch(sums, scipy.spatial.transform.Rotation.from_rotvec(whole).as_matrix()[None], dim)


def _kabsch(sums: Points, prior: Points, dim: int) -> Points:
    """Rotations (axis times angle) nearest to sums (N, 3, 3) of outer products after x before."""
    if dim == 2:
        angle = np.arctan2(sums[:, 1, 0] - sums[:, 0, 1], sums[:, 0, 0] + sums[:, 1, 1])
        return np.stack([np.zeros_like(angle), np.zeros_like(angle), angle], axis=1)
    size = np.linalg.norm(sums, axis=(1, 2), keepdims=True)
    u, _, vt = np.linalg.svd(sums + _PRIOR_TURN * size * prior)
    u[:, :, 2] *= np.sign(np.linalg.det(u @ vt))[:, None]
    return np.asarray(scipy.spatial.transform.Rotation.from_matrix(u @ vt).as_rotvec())


def _unwrap(turns: Points, edges: NDArray[np.int_]) -> Points:
    """The same rotations, each with the whole turns that make it nearest to its neighbour's; the least one begins."""
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
    return np.where(length > 0, vectors / np.where(length > 0, length, 1), instead / np.where(other > 0, other, 1))


def _shortest_turn(a: Points, b: Points) -> Points:
    """Axis times angle of the rotation of each direction of a to that of b."""
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


# Settings between two of which there is one halfway; a change of the others, and of cuts, is a switch.
_MIXED = tuple(setting.name for setting in fields(FitSettings) if isinstance(setting.default, float))
_SWITCHED = (*(name for name in SETTINGS if name not in (*_MIXED, "support", "chosen_support")), "cuts", "cut_rule")
_SAME = 1e-6  # of the box of all points: left to a rigid part


class StepPath:
    """One step between two key frames.

    Parameters
    ----------
    before, after : the step at both; on one plane.
    label : how notes name it, such as "step 1".

    Attributes
    ----------
    notes : what switches instead of being interpolated.
    turn : the largest angle in radians by which something turns.
    """

    def __init__(self, before: Step, after: Step, label: str = "the step") -> None:
        words = [STEP_LABELS[name] for name in _SWITCHED if getattr(before, name) != getattr(after, name)]
        notes = [f"the {word} of {label} {'change' if word.endswith('s') else 'changes'}" for word in words]
        if before.strength != after.strength:  # a share of a turn is a turn, and no shorter path
            before, after = _with_unit_strength(before), _with_unit_strength(after)
        before, after, is_shared = _unify_rules(before, after)
        if not is_shared:
            notes.append(f"the extrusion of {label} changes")
            after = replace(after, extrusion=before.extrusion, curve=before.curve, knots=before.knots, maps=before.maps)
        self._parts = PartPaths(before.parts, after.parts)
        if self._parts.is_switched:
            notes.append(f"the rigid parts of {label} change")
        self.before, self.after = before, after
        self._maps = [_PointsPath(before, after, k, self._parts) for k in range(len(before.maps))]
        self._support = _supports(before, after, self._maps)
        self._curve = _curves(before.curve, after.curve) if before.extrusion == "modulate" else None
        self.notes = tuple(notes)
        self.turn = max([self._parts.turn, *(path.turn for path in self._maps)])

    def at(self, t: float) -> Step:
        """The step at t between 0 and 1."""
        a, b = self.before, self.after
        changed: dict[str, Any] = {"maps": tuple(path.at(t) for path in self._maps), "parts": self._parts.at(t)}
        changed |= {
            name: (1 - t) * getattr(a, name) + t * getattr(b, name)
            for name in _MIXED
            if getattr(a, name) != getattr(b, name)
        }
        if self._support is not None:
            changed["support"] = float((1 - t) * self._support[0] + t * self._support[1])
        if self._curve is not None:
            changed["curve"] = tuple(((1 - t) * self._curve[0] + t * self._curve[1]).tolist())
        if a.knots != b.knots:
            changed["knots"] = tuple((1 - t) * p + t * q for p, q in zip(a.knots, b.knots, strict=True))
        return replace(a, **changed)


def step_paths(before: Sequence[Step], after: Sequence[Step]) -> list[StepPath]:
    """The paths of all steps, matched by their places in the list."""
    paths = []
    for k, (a, b) in enumerate(zip_longest(before, after)):
        label = f"step {k + 1}"
        if a is None or b is None:
            pairs = [(_without_drags(b), b) if a is None else (a, _without_drags(a))]
        elif a.plane != b.plane:
            pairs = [(a, _without_drags(a)), (_without_drags(b), b)]
        elif a.enabled != b.enabled:
            pairs = [(a, _without_drags(a)) if a.enabled else (_without_drags(b), b)]
        else:
            pairs = [(a, b)]
        paths += [StepPath(p, q, label) for p, q in pairs]
    return paths


def _without_drags(step: Step) -> Step:
    """The same step with nothing dragged."""
    return replace(
        step, maps=tuple(m.reset() for m in step.maps), parts=tuple(replace(part, motion=None) for part in step.parts)
    )


def _with_unit_strength(step: Step) -> Step:
    """The same deformation with a strength of 1."""
    maps = tuple(scaled_points(m, step.parts, step.strength) for m in step.maps)
    return replace(step, strength=1.0, maps=maps, parts=tuple(part.scaled(step.strength) for part in step.parts))


def _unify_rules(a: Step, b: Step) -> tuple[Step, Step, bool]:
    """Both with the same rule of extrusion, where one can be written as the other: replication is f(z) = 1."""
    rules = {a.extrusion, b.extrusion}
    if rules == {"replicate", "modulate"}:
        ones: dict[str, Any] = {"extrusion": "modulate", "curve": (1.0, 1.0)}
        a, b = (replace(s, **ones) if s.extrusion == "replicate" else s for s in (a, b))
    elif rules == {"replicate", "interpolate"}:
        keyed = a if a.extrusion == "interpolate" else b
        a, b = (
            s if s is keyed else replace(s, extrusion="interpolate", knots=keyed.knots, maps=s.maps * len(keyed.knots))
            for s in (a, b)
        )
    return a, b, a.extrusion == b.extrusion and len(a.maps) == len(b.maps)


def _curves(a: Any, b: Any) -> tuple[Floats, Floats] | None:
    if a == b:
        return None
    z = np.linspace(0.0, 1.0, CURVE_KNOTS)
    values = [np.interp(z, knots, weights[0]) for knots, weights in (modulate(a), modulate(b))]
    return values[0], values[1]


def _supports(a: Step, b: Step, maps: Sequence[_PointsPath]) -> tuple[float, float] | None:
    """The support radius at both ends; None where it is the same."""
    if (a.support, a.chosen_support) == (b.support, b.chosen_support) and (
        not isinstance(a.support, str) or all(path.is_same for path in maps)
    ):
        return None
    found = a.support_for(a.points), b.support_for(b.points)
    radius = found[0] or found[1]
    return None if radius is None else (found[0] or radius, found[1] or radius)


class _PointsPath:
    """One set of control points between two key frames."""

    def __init__(self, a: Step, b: Step, index: int, parts: PartPaths) -> None:
        first, last = a.maps[index], b.maps[index]
        self.is_same = first.ids == last.ids and np.array_equal(first.active, last.active)
        if not self.is_same:
            first, last = _add_missing(first, last, a), _add_missing(last, first, b)
            last = last.take([last.index(i) for i in first.ids])
        self.first, self.last = first, last
        self._moving = np.flatnonzero(first.active)
        start, end = first.target[self._moving], last.target[self._moving]
        self._held = parts.part_numbers(first.source[self._moving], start, end)
        rest = (first.source + last.source)[self._moving] / 2
        self._path = HandlePath(start, end, rest, self._held >= 0)
        self._parts = parts
        self.turn = self._path.largest_turn

    def at(self, t: float) -> ControlPoints:
        a, b = self.first, self.last
        source, target, weight = (
            (1 - t) * x + t * y for x, y in ((a.source, b.source), (a.target, b.target), (a.weight, b.weight))
        )
        held = None
        if (self._held >= 0).any():
            held = self._parts.move(source[self._moving], self._held, t)
        target[self._moving] = self._path.at(t, held)
        return replace(a, source=source, target=target, weight=weight, next_id=max(a.next_id, b.next_id))


def _add_missing(points: ControlPoints, others: ControlPoints, step: Step) -> ControlPoints:
    """With those points of another key that this one lacks, where this key takes them; a point that is off in both is
    off.
    """
    known = {i: k for k, i in enumerate(points.ids)}
    missing = [
        k for k, i in enumerate(others.ids) if i not in known or (others.active[k] and not points.active[known[i]])
    ]
    if not missing:
        return points
    some = others.take(missing)
    carried = _carry_places(points, some.source, step)
    result = points.take([k for k, i in enumerate(points.ids) if i not in some.ids])
    ids = (*result.ids, *some.ids)
    return ControlPoints(
        np.concatenate([result.source, some.source]),
        np.concatenate([result.target, carried]),
        ids,
        (*result.names, *some.names),
        np.concatenate([result.active, some.active]),
        np.concatenate([result.weight, some.weight]),
        max(points.next_id, others.next_id),
        np.concatenate([result.locked, some.locked]),
        np.concatenate([result.radius, some.radius]),
    )


def _carry_places(points: ControlPoints, places: Floats, step: Step) -> Floats:
    """The places to which a step takes the tissue at these places."""
    chosen = scaled_points(points, step.parts, step.strength)
    regions = [cut.region for cut in step.cuts if cut.enabled]
    result = places.copy()
    sides = sides_of(regions, places) if regions else np.zeros((len(places), 0), dtype=bool)
    own = sides_of(regions, chosen.source) if regions else np.zeros((len(chosen), 0), dtype=bool)
    blended = (
        step.settings.fits(points, step.parts, regions, lone=_extent(points, places))
        if any(map(is_slit, regions))
        else None
    )
    for side in np.unique(sides, axis=0):
        here = (sides == side).all(axis=1)
        if blended is not None:
            if tuple(side.tolist()) in blended:
                result[here] = _forward(blended[tuple(side.tolist())], places[here], chosen)
            continue
        some = chosen.take(np.flatnonzero((own == side).all(axis=1)))
        if some.active.any() and some.displacement[some.active].any():
            result[here] = _forward(_fit(some, places, step), places[here], some)
    # Carried points are evaluated again as they are blended: at the strength of the step they must be there.
    return places + (result - places) / step.strength if step.strength else places


def _extent(points: ControlPoints, places: Floats) -> float | None:
    return box_diagonal(ControlPoints.from_arrays(np.concatenate([points.source, places])))


def _fit(points: ControlPoints, places: Floats, step: Step) -> AbstractField:
    parts = [part.scaled(step.strength) for part in step.parts if part.enabled]
    return fit_points(
        points,
        parts,
        stages=step.stages,
        direction=step.direction,
        **step.settings.arguments(points, _extent(points, places)),
    )


def _forward(field: AbstractField, places: Floats, points: ControlPoints) -> Floats:
    """y with y + D(y) = x, by Newton's method from where the nearest control point has gone."""
    dim = places.shape[1]
    nearest = np.linalg.norm(places[:, None] - points.source[None], axis=2).argmin(axis=1)
    y = places - points.displacement[nearest]
    size = max(float(np.ptp(np.concatenate([points.source, places]), axis=0).max()), 1e-300)
    step = 1e-5 * size * np.eye(dim)
    error = y + field.displacement(y) - places
    for _ in range(20):
        if np.abs(error).max() < 1e-9 * size:
            break
        slopes = [(field.displacement(y + h) - field.displacement(y - h)) / (2e-5 * size) for h in step]
        jacobian = np.eye(dim) + np.stack(slopes, axis=-1)
        way = np.einsum("nij,nj->ni", np.linalg.pinv(jacobian), error)
        share = np.ones(len(y))
        for _ in range(6):  # only as far as it gets better
            trial = y - share[:, None] * way
            missed = trial + field.displacement(trial) - places
            is_better = np.linalg.norm(missed, axis=1) < np.linalg.norm(error, axis=1)
            if is_better.all():
                break
            share = np.where(is_better, share, share / 2)
        y, error = np.where(is_better[:, None], trial, y), np.where(is_better[:, None], missed, error)
    is_found = np.linalg.norm(error, axis=1) < 1e-4 * size
    return np.where(is_found[:, None], y, places - field.displacement(places))  # in a fold: about there


class PartPaths:
    """Rigid parts between two key frames: each moves along one screw."""

    def __init__(self, before: tuple[RigidPart, ...], after: tuple[RigidPart, ...]) -> None:
        self.is_switched = len(before) != len(after) or any(
            (p.region, p.weight, p.enabled) != (q.region, q.weight, q.enabled)
            for p, q in zip(before, after, strict=False)
        )
        self.before = before
        self.after = before if self.is_switched else after
        self._ways = [_relative_motion(p.motion, q.motion) for p, q in zip(before, self.after, strict=True)]
        self.turn = max((_angle(way) for way in self._ways if way is not None), default=0.0)

    def at(self, t: float) -> tuple[RigidPart, ...]:
        return tuple(self._part(k, t) for k in range(len(self.before)))

    def _part(self, k: int, t: float) -> RigidPart:
        p, q, way = self.before[k], self.after[k], self._ways[k]
        reach = p.reach if p.reach is None or q.reach is None else (1 - t) * p.reach + t * q.reach
        return replace(p, motion=p.motion if way is None else _then(p.motion, way.power(t)), reach=reach)

    def part_numbers(self, source: Floats, start: Floats, end: Floats) -> NDArray[np.int_]:
        """The number of the part that each point goes with at both ends; -1 for none."""
        result = np.full(len(source), -1)
        size = float(np.linalg.norm(np.ptp(np.concatenate([source, start, end]), axis=0))) if len(source) else 0.0
        for k, (p, q) in enumerate(zip(self.before, self.after, strict=True)):
            if p.enabled and len(source):
                goes = [
                    np.linalg.norm(_move_places(part.motion, source) - at, axis=1) <= _SAME * size
                    for part, at in ((p, start), (q, end))
                ]
                result[(p.region.signed_distance(source) <= 0) & goes[0] & goes[1]] = k
        return result

    def move(self, source: Floats, held: NDArray[np.int_], t: float) -> Floats:
        """The places to which the parts take their points."""
        places = source.copy()
        for k in np.unique(held[held >= 0]).tolist():
            places[held == k] = _move_places(self._part(k, t).motion, source[held == k])
        return places


def _move_places(motion: RigidMotion | None, places: Floats) -> Floats:
    return places if motion is None else motion(places)


def _relative_motion(p: RigidMotion | None, q: RigidMotion | None) -> RigidMotion | None:
    """The motion that is done after p to make it q; None if there is nothing to do."""
    if p == q:
        return None
    end = (
        q
        if q is not None
        else RigidMotion.turn(
            0, np.zeros(2 if p is None else p.dim), axis=(0, 0, 1) if p is not None and p.dim == 3 else None
        )
    )
    return end if p is None else _then(p.inverse, end)


def _then(p: RigidMotion | None, q: RigidMotion) -> RigidMotion:
    if p is None:
        return q
    m, n = np.asarray(p.matrix), np.asarray(q.matrix)
    u, _, vt = np.linalg.svd(n @ m)  # products of many rotations stay rotations
    return RigidMotion(tuple(map(tuple, (u @ vt).tolist())), tuple((n @ np.asarray(p.shift) + q.shift).tolist()))


def _angle(motion: RigidMotion) -> float:
    m = np.eye(3)
    m[: motion.dim, : motion.dim] = motion.matrix
    return float(np.linalg.norm(scipy.spatial.transform.Rotation.from_matrix(m).as_rotvec()))


def one_map(steps: Sequence[Step]) -> Step | None:
    """The one step in use, if a single map over its plane describes it; None if none is in use.

    Raises
    ------
    DeformError
        If there are more of them, or no such map.
    """
    used = [step for step in steps if step.enabled]
    if not used:
        return None
    if len(used) > 1 or used[0].plane is None:
        found = f"{len(used)} steps in use" if len(used) > 1 else "a step in space"
        raise DeformError(
            f"maps over time are made of one step on one plane, this animation has {found}; render its "
            "frames one by one."
        )
    if used[0].cut_regions:
        raise DeformError(
            "a displacement that jumps along a cut is no map that can be blended over time; render the "
            "frames one by one, or switch the cuts off."
        )
    if used[0].extrusion == "interpolate":
        raise DeformError(
            "maps over time need one map for each moment, the rule 'interpolate' has several; render the "
            "frames one by one."
        )
    return used[0]

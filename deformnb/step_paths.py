"""The way of one step from a key frame to the next: its points go as rigidly as they can, its numbers evenly.

What the two keys do not share:

- A point that only one key has, or that is switched on at one only, is at the other where that key's own deformation
  takes it. So a point that was added later changes nothing before.
- A step that only one key has, or that is switched off at one, comes or goes: at the other key nothing is dragged. So
  do two steps at one place of the list that lie on different planes.
- A kernel, a trend, a rule of extrusion, cuts and the places of rigid parts have nothing between them: those of the
  earlier key hold until the later one. ``notes`` says so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from deformnb.control_points import ControlPoints
from deformnb.cuts import sides_of
from deformnb.deformation import Step
from deformnb.degenerate import box_diagonal
from deformnb.errors import DeformError
from deformnb.extrusion import CURVE_KNOTS, modulate
from deformnb.fields import AbstractField
from deformnb.handle_paths import HandlePath
from deformnb.rigid_motion import RigidMotion
from deformnb.rigid_parts import RigidPart
from deformnb.staged import fit_points

Places = NDArray[np.float64]

_SWITCHED = {"kernel": "kernel", "trend": "trend", "cuts": "cuts", "cut_rule": "rule of the cuts",
             "stages": "number of stages"}
_SAME = 1e-6  # of the box of all points: what a rigid part does anyway


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
        notes = [f"the {word} of {label} changes" for name, word in _SWITCHED.items()
                 if getattr(before, name) != getattr(after, name)]
        if before.strength != after.strength:  # a share of a turn is a turn, and no shorter way
            before, after = _applied(before), _applied(after)
        before, after, is_shared = _with_one_rule(before, after)
        if not is_shared:
            notes.append(f"the extrusion of {label} changes")
            after = replace(after, extrusion=before.extrusion, curve=before.curve, knots=before.knots, maps=before.maps)
        self._parts = _PartPaths(before.parts, after.parts)
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
        changed: dict[str, Any] = {"maps": tuple(path.at(t) for path in self._maps), "parts": self._parts.at(t),
                                   "smoothing": (1 - t) * a.smoothing + t * b.smoothing}
        if self._support is not None:
            changed["support"] = float((1 - t) * self._support[0] + t * self._support[1])
        if self._curve is not None:
            changed["curve"] = tuple(((1 - t) * self._curve[0] + t * self._curve[1]).tolist())
        if a.knots != b.knots:
            changed["knots"] = tuple((1 - t) * p + t * q for p, q in zip(a.knots, b.knots, strict=True))
        return replace(a, **changed)


def step_paths(before: Sequence[Step], after: Sequence[Step]) -> list[StepPath]:
    """The ways of all steps, matched by their places in the list."""
    paths = []
    for k, (a, b) in enumerate(zip_longest(before, after)):
        label = f"step {k + 1}"
        if a is None or b is None:
            pairs = [(_untouched(b), b) if a is None else (a, _untouched(a))]
        elif a.plane != b.plane:
            pairs = [(a, _untouched(a)), (_untouched(b), b)]
        elif a.enabled != b.enabled:
            pairs = [(a, _untouched(a)) if a.enabled else (_untouched(b), b)]
        else:
            pairs = [(a, b)]
        paths += [StepPath(p, q, label) for p, q in pairs]
    return paths


def _untouched(step: Step) -> Step:
    """The same step with nothing dragged."""
    return replace(step, maps=tuple(m.reset() for m in step.maps),
                   parts=tuple(replace(part, motion=None) for part in step.parts))


def _applied(step: Step) -> Step:
    """The same deformation with a strength of 1."""
    return replace(step, strength=1.0, maps=tuple(m.blended(step.strength) for m in step.maps),
                   parts=tuple(part.scaled(step.strength) for part in step.parts))


def _with_one_rule(a: Step, b: Step) -> tuple[Step, Step, bool]:
    """Both with the same rule of extrusion, where one can be said as the other: replication is f(z) = 1."""
    rules = {a.extrusion, b.extrusion}
    if rules == {"replicate", "modulate"}:
        ones: dict[str, Any] = {"extrusion": "modulate", "curve": (1.0, 1.0)}
        a, b = (replace(s, **ones) if s.extrusion == "replicate" else s for s in (a, b))
    elif rules == {"replicate", "interpolate"}:
        keyed = a if a.extrusion == "interpolate" else b
        a, b = (s if s is keyed else replace(s, extrusion="interpolate", knots=keyed.knots,
                                             maps=s.maps * len(keyed.knots)) for s in (a, b))
    return a, b, a.extrusion == b.extrusion and len(a.maps) == len(b.maps)


def _curves(a: Any, b: Any) -> tuple[Places, Places] | None:
    if a == b:
        return None
    z = np.linspace(0.0, 1.0, CURVE_KNOTS)
    values = [np.interp(z, knots, weights[0]) for knots, weights in (modulate(a), modulate(b))]
    return values[0], values[1]


def _supports(a: Step, b: Step, maps: Sequence[_PointsPath]) -> tuple[float, float] | None:
    """The support radius at both ends; None where it is the same."""
    if (a.support, a.chosen_support) == (b.support, b.chosen_support) and (
            not isinstance(a.support, str) or all(path.is_same for path in maps)):
        return None
    found = a.support_for(a.points), b.support_for(b.points)
    radius = found[0] or found[1]
    return None if radius is None else (found[0] or radius, found[1] or radius)


class _PointsPath:
    """One set of control points between two key frames."""

    def __init__(self, a: Step, b: Step, index: int, parts: _PartPaths) -> None:
        first, last = a.maps[index], b.maps[index]
        self.is_same = first.ids == last.ids and np.array_equal(first.active, last.active)
        if not self.is_same:
            first, last = _with_all(first, last, a), _with_all(last, first, b)
            last = last.take([last.index(i) for i in first.ids])
        self.first, self.last = first, last
        self._moving = np.flatnonzero(first.active)
        start, end = first.target[self._moving], last.target[self._moving]
        self._held = parts.held(first.source[self._moving], start, end)
        rest = (first.source + last.source)[self._moving] / 2
        self._path = HandlePath(start, end, rest, self._held >= 0)
        self._parts = parts
        self.turn = self._path.largest_turn

    def at(self, t: float) -> ControlPoints:
        a, b = self.first, self.last
        source, target, weight = ((1 - t) * x + t * y for x, y in (
            (a.source, b.source), (a.target, b.target), (a.weight, b.weight)))
        held = None
        if (self._held >= 0).any():
            held = self._parts.moved(source[self._moving], self._held, t)
        target[self._moving] = self._path.at(t, held)
        return replace(a, source=source, target=target, weight=weight, next_id=max(a.next_id, b.next_id))


def _with_all(points: ControlPoints, others: ControlPoints, step: Step) -> ControlPoints:
    """With those points of another key that this one lacks, where this key takes them; a point that is off in both is
    off.
    """
    known = {i: k for k, i in enumerate(points.ids)}
    wanted = [k for k, i in enumerate(others.ids)
              if i not in known or (others.active[k] and not points.active[known[i]])]
    if not wanted:
        return points
    some = others.take(wanted)
    carried = _carried(points, some.source, step)
    result = points.take([k for k, i in enumerate(points.ids) if i not in some.ids])
    ids = (*result.ids, *some.ids)
    return ControlPoints(
        np.concatenate([result.source, some.source]), np.concatenate([result.target, carried]), ids,
        (*result.names, *some.names), np.concatenate([result.active, some.active]),
        np.concatenate([result.weight, some.weight]), max(points.next_id, others.next_id),
        np.concatenate([result.locked, some.locked]), np.concatenate([result.radius, some.radius]))


def _carried(points: ControlPoints, places: Places, step: Step) -> Places:
    """Where a step takes the matter at these places."""
    chosen = points if step.strength == 1 else points.blended(step.strength)
    regions = [cut.region for cut in step.cuts if cut.enabled]
    result = places.copy()
    sides = sides_of(regions, places) if regions else np.zeros((len(places), 0), dtype=bool)
    own = sides_of(regions, chosen.source) if regions else np.zeros((len(chosen), 0), dtype=bool)
    for side in np.unique(sides, axis=0):
        here = (sides == side).all(axis=1)
        some = chosen.take(np.flatnonzero((own == side).all(axis=1)))
        if some.active.any() and some.displacement[some.active].any():
            result[here] = _forward(_fit(some, places, step), places[here], some)
    # What is carried is asked for again as it is blended: at the strength of the step it must lie there.
    return places + (result - places) / step.strength if step.strength else places


def _fit(points: ControlPoints, places: Places, step: Step) -> AbstractField:
    every = ControlPoints.from_arrays(np.concatenate([points.source, places]))
    support = step.support_for(points) or box_diagonal(every)
    parts = [part.scaled(step.strength) for part in step.parts if part.enabled]
    return fit_points(points, parts, stages=step.stages, kernel=step.kernel, support=support, trend=step.trend,
                      smoothing=step.smoothing)


def _forward(field: AbstractField, places: Places, points: ControlPoints) -> Places:
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


class _PartPaths:
    """Rigid parts between two key frames: each moves along one screw."""

    def __init__(self, before: tuple[RigidPart, ...], after: tuple[RigidPart, ...]) -> None:
        self.is_switched = len(before) != len(after) or any(
            (p.region, p.weight, p.enabled) != (q.region, q.weight, q.enabled)
            for p, q in zip(before, after, strict=False))
        self.before = before
        self.after = before if self.is_switched else after
        self._ways = [_way(p.motion, q.motion) for p, q in zip(before, self.after, strict=True)]
        self.turn = max((_angle(way) for way in self._ways if way is not None), default=0.0)

    def at(self, t: float) -> tuple[RigidPart, ...]:
        return tuple(self._part(k, t) for k in range(len(self.before)))

    def _part(self, k: int, t: float) -> RigidPart:
        p, q, way = self.before[k], self.after[k], self._ways[k]
        reach = p.reach if p.reach is None or q.reach is None else (1 - t) * p.reach + t * q.reach
        return replace(p, motion=p.motion if way is None else _then(p.motion, way.power(t)), reach=reach)

    def held(self, source: Places, start: Places, end: Places) -> NDArray[np.int_]:
        """The number of the part that each point goes with at both ends; -1 for none."""
        result = np.full(len(source), -1)
        size = float(np.linalg.norm(np.ptp(np.concatenate([source, start, end]), axis=0))) if len(source) else 0.0
        for k, (p, q) in enumerate(zip(self.before, self.after, strict=True)):
            if p.enabled and len(source):
                goes = [np.linalg.norm(_moved(part.motion, source) - at, axis=1) <= _SAME * size
                        for part, at in ((p, start), (q, end))]
                result[(p.region.signed_distance(source) <= 0) & goes[0] & goes[1]] = k
        return result

    def moved(self, source: Places, held: NDArray[np.int_], t: float) -> Places:
        """Where the parts take their points."""
        places = source.copy()
        for k in np.unique(held[held >= 0]).tolist():
            places[held == k] = _moved(self._part(k, t).motion, source[held == k])
        return places


def _moved(motion: RigidMotion | None, places: Places) -> Places:
    return places if motion is None else motion(places)


def _way(p: RigidMotion | None, q: RigidMotion | None) -> RigidMotion | None:
    """The motion that is done after p to make it q; None if there is nothing to do."""
    if p == q:
        return None
    end = q if q is not None else RigidMotion.turn(0, np.zeros(2 if p is None else p.dim),
                                                   axis=(0, 0, 1) if p is not None and p.dim == 3 else None)
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
    return float(np.linalg.norm(Rotation.from_matrix(m).as_rotvec()))


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
        raise DeformError(f"maps over time are made of one step on one plane, this animation has {found}; render its "
                          "frames one by one.")
    if used[0].cut_regions:
        raise DeformError("a displacement that jumps along a cut is no map that can be blended over time; render the "
                          "frames one by one, or switch the cuts off.")
    if used[0].extrusion == "interpolate":
        raise DeformError("maps over time need one map for each moment, the rule 'interpolate' has several; render the "
                          "frames one by one.")
    return used[0]

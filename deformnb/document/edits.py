"""Edits of a document with their consequences, and edits of its key frames.

A new kernel sets its trend, an extrusion rule its points, a turned picture begins a new step. Each edit of the key
frames returns the next document, or refuses with the reason.

A key frame stores the steps of the document as they were when it was made. The document continues: a key frame is
changed by going to it (:func:`document_at_key`), editing, and storing the result in it (:func:`update_key`).
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from deformnb.document.deformation import Deformation, Keyframe, Step
from deformnb.errors import DeformError
from deformnb.rbf.kernels import as_kernel
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.support import CHOOSE_SUPPORT
from deformnb.rbf.trends import TRENDS, find_trend
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid

# Depths that the points are spread to when the rule "interpolate" is chosen: front, middle, back.
_FIRST_KNOTS = (0.0, 0.5, 1.0)


def initial_step(plane: Plane | None, grid: Grid) -> Step:
    """Initial step of a picture, or of a box (plane None): a point in each corner, so that no drag moves the border."""
    corners = grid.corners(centres=True)
    if plane is None:
        return Step((ControlPoints.from_arrays(corners, names=["corner"] * 8),))
    flat = plane.to_plane(corners)[:, :2]
    (a0, b0), (a1, b1) = flat.min(axis=0), flat.max(axis=0)
    return Step((ControlPoints.from_arrays([[a0, b0], [a1, b0], [a1, b1], [a0, b1]], names=["corner"] * 4),), plane)


def complete_change(step: Step, points: ControlPoints, fields: dict[str, Any]) -> str:
    """Add to the changed fields of a step the others that they need; returns a notice, or an empty text.

    Parameters
    ----------
    points : the set of control points being edited, which stays when the rule of extrusion changes.
    """
    rule = fields.get("extrusion", step.extrusion)
    if rule == "interpolate" and step.extrusion != "interpolate":
        fields.setdefault("knots", _FIRST_KNOTS)
        fields.setdefault("maps", (points,) * len(fields["knots"]))
    elif rule != "interpolate" and step.extrusion == "interpolate":
        fields.setdefault("knots", ())
        fields.setdefault("maps", (points,))
        if any(m != points for m in step.maps):
            return "The key picture that was being edited stays; undo restores the others."
    if rule == "modulate" != step.extrusion and step.cuts and step.curve == "z" and "curve" not in fields:
        fields["curve"] = "1-z"  # reversed, a cut would be shut on the side of the viewer
        return "The cut is open in front and closed at the back now: f = 1 - z."
    if (CHOOSE_SUPPORT | {"maps"}) & set(fields):
        fields.setdefault("chosen_support", None)  # found again
    kernel = as_kernel(fields.get("kernel", step.kernel))
    trend = find_trend(fields.get("trend", step.trend))
    if kernel.order <= trend.order:
        return ""
    if "kernel" in fields and "trend" not in fields:
        fields["trend"] = next(
            t.name for t in sorted(TRENDS.values(), key=lambda t: t.order) if t.order >= kernel.order
        )
        return f"The kernel {kernel.title} needs the trend {find_trend(fields['trend']).title}: it is chosen now."
    if "trend" in fields and "kernel" not in fields:
        fields["kernel"] = "wendland_c2"
        return f"The kernel {kernel.title} needs a richer trend than {trend.title}; Wendland C2 took its place."
    return ""


def points_between(maps: list[ControlPoints], knots: list[float], index: int) -> ControlPoints:
    """Points interpolated at a new key from its neighbours; those of the nearer one if they differ."""
    if index == 0 or index == len(maps):
        return maps[0 if index == 0 else -1]
    before, after = maps[index - 1], maps[index]
    t = (knots[index] - knots[index - 1]) / (knots[index + 1] - knots[index - 1])
    nearer = before if t < 0.5 else after
    if before.ids != after.ids:
        return nearer
    return replace(
        nearer, source=(1 - t) * before.source + t * after.source, target=(1 - t) * before.target + t * after.target
    )


def is_edited(step: Step, untouched: Step) -> bool:
    """Check whether a step has points, cuts or parts that its initial state does not have."""
    return step.maps != untouched.maps or bool(step.cuts or step.parts)


_VIEW_NAME = re.compile(r"view ([0-9]{1,9})")


def is_view_name(name: str) -> bool:
    """Check whether a name is one that :func:`next_view_name` gives."""
    return _VIEW_NAME.fullmatch(name) is not None


def next_view_name(deformation: Deformation) -> str:
    """The name of one more oblique view: "view 1", or one more than the largest number in the document.

    Examples
    --------
    >>> plane = Plane.from_normal((0, 0, 0), (1, 1, 0))
    >>> next_view_name(Deformation((Step((ControlPoints.from_arrays([[1, 1]]),), plane, name="view 3"),)))
    'view 4'
    """
    every = [*deformation.steps, *(step for key in deformation.keyframes for step in key.steps)]
    numbers = [int(found[1]) for step in every if (found := _VIEW_NAME.fullmatch(step.name))]
    return f"view {max(numbers, default=0) + 1}"


def turn_picture(
    deformation: Deformation, index: int, new: Step, untouched: Step, side_of: Callable[[Plane | None], str]
) -> tuple[Deformation, int, str]:
    """The document and the step to edit once the picture is turned, and a notice.

    For a side that has a step already, that step is selected. Else the step being edited is turned if it is as it
    began, and a new one comes after all others if it is not.

    Parameters
    ----------
    index : of the step that was being edited.
    new : a step on the other side, without drags; untouched : the initial state of the one being edited.
    side_of : the side of a plane in words, such as "from above".
    """
    steps = list(deformation.steps)
    old = steps[index]
    is_used = is_edited(old, untouched)
    there = max((k for k, step in enumerate(steps) if step.plane == new.plane and k != index), default=None)
    if there is not None:
        if not is_used:
            del steps[index]
            there -= there > index
        notice = f"Back at step {there + 1}, {side_of(new.plane)}."
        return replace(deformation, steps=tuple(steps)), there, notice
    if not is_used:
        return deformation.with_step(index, new), index, ""
    count = len(steps)
    notice = (
        f"Step {count + 1} begins, {side_of(new.plane)}. The points of step {index + 1}, "
        f"{side_of(old.plane)}, are unchanged: choose that side or step again to edit them."
    )
    return deformation.then(new), count, notice


APART = 1e-3
"""Seconds between two key frames at least; nearer times count as the same moment."""

_PAUSE = 1.0  # seconds after the last key frame, where the next one comes by default


def free_time(deformation: Deformation) -> float:
    """Time of the next key frame: at 0, or one second after the last."""
    keys = deformation.keyframes
    return keys[-1].time + _PAUSE if keys else 0.0


def key_at(deformation: Deformation, time: float) -> int | None:
    """The number of the key frame at a moment; None if there is none."""
    return next((k for k, key in enumerate(deformation.keyframes) if abs(key.time - time) < APART), None)


def add_key(deformation: Deformation, time: float | None = None) -> Deformation:
    """One more key frame of the document as it is now; one that is there already is replaced.

    Parameters
    ----------
    time : in seconds; default is :func:`free_time`.

    Examples
    --------
    >>> twice = add_key(add_key(Deformation()))
    >>> [key.time for key in twice.keyframes]
    [0.0, 1.0]
    """
    at = free_time(deformation) if time is None else float(time)
    here = key_at(deformation, at)
    if here is not None:
        return update_key(deformation, here)
    return _with_keys(deformation, (*deformation.keyframes, Keyframe(at, deformation.steps)))


def update_key(deformation: Deformation, index: int) -> Deformation:
    """The document's steps of now in the place of those of a key frame."""
    keys = _check_key(deformation, index)
    return _with_keys(deformation, (*keys[:index], replace(keys[index], steps=deformation.steps), *keys[index + 1 :]))


def remove_key(deformation: Deformation, index: int) -> Deformation:
    """Without a key frame."""
    keys = _check_key(deformation, index)
    return _with_keys(deformation, (*keys[:index], *keys[index + 1 :]))


def move_key(deformation: Deformation, index: int, time: float) -> Deformation:
    """A key frame at another moment; it may pass others."""
    keys = _check_key(deformation, index)
    moved = replace(keys[index], time=float(time))
    there = key_at(deformation, moved.time)
    if there not in (None, index):
        raise DeformError(
            f"there is a key frame at {keys[there or 0].time:g} s already; remove it or choose another moment."
        )
    return _with_keys(deformation, (*keys[:index], moved, *keys[index + 1 :]))


def repeat_key(deformation: Deformation, index: int) -> Deformation:
    """The same steps once more, one second after the last key frame: so a loop is closed."""
    steps = _check_key(deformation, index)[index].steps
    return _with_keys(deformation, (*deformation.keyframes, Keyframe(free_time(deformation), steps)))


def document_at_key(deformation: Deformation, index: int) -> Deformation:
    """The document as it was at a key frame, to be edited."""
    return with_steps(deformation, _check_key(deformation, index)[index].steps)


def with_steps(deformation: Deformation, steps: tuple[Step, ...]) -> Deformation:
    """The document with the steps of another moment.

    Points that are added then get ids that no key frame has: points of two key frames are the same by their ids.
    """
    every = [key.steps for key in deformation.keyframes] + [deformation.steps]
    return replace(
        deformation,
        steps=tuple(
            replace(
                step,
                maps=tuple(
                    _with_fresh_ids(points, [m for others in every if k < len(others) for m in others[k].maps])
                    for points in step.maps
                ),
            )
            for k, step in enumerate(steps)
        ),
    )


def _with_fresh_ids(points: ControlPoints, others: list[ControlPoints]) -> ControlPoints:
    return replace(points, next_id=max([points.next_id, *(m.next_id for m in others)]))


def is_now(deformation: Deformation, index: int) -> bool:
    """Check whether a key frame equals the current document."""
    steps = _check_key(deformation, index)[index].steps
    return with_steps(deformation, steps).steps == with_steps(deformation, deformation.steps).steps


def _check_key(deformation: Deformation, index: int) -> tuple[Keyframe, ...]:
    keys = deformation.keyframes
    if not 0 <= index < len(keys):
        raise DeformError(f"there is no key frame {index + 1}; there are {len(keys)}.")
    return keys


def _with_keys(deformation: Deformation, keys: tuple[Keyframe, ...]) -> Deformation:
    return replace(deformation, keyframes=tuple(sorted(keys, key=lambda key: key.time)))

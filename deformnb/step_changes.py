"""What one change brings along: a kernel its trend, a rule of extrusion its points, a turn of the picture a step."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from deformnb.control_points import ControlPoints
from deformnb.deformation import Deformation, Step
from deformnb.kernels import kernel_named
from deformnb.plane import Plane
from deformnb.trend import TRENDS, trend_named
from deformnb.volume import Grid

# Depths that the points are spread to when the rule "interpolate" is chosen: front, middle, back.
_FIRST_KNOTS = (0.0, 0.5, 1.0)


def untouched_step(plane: Plane | None, grid: Grid) -> Step:
    """What a picture, or a box (plane None), begins with: a point in each corner, so that no drag moves the border."""
    corners = grid.corners(centres=True)
    if plane is None:
        return Step((ControlPoints.from_arrays(corners, names=["corner"] * 8),))
    flat = plane.to_plane(corners)[:, :2]
    (a0, b0), (a1, b1) = flat.min(axis=0), flat.max(axis=0)
    return Step((ControlPoints.from_arrays([[a0, b0], [a1, b0], [a1, b1], [a0, b1]], names=["corner"] * 4),), plane)


def complete_change(step: Step, points: ControlPoints, fields: dict[str, Any]) -> str:
    """Adds to the changed fields of a step what they need; returns what has to be said about it, or nothing.

    Parameters
    ----------
    points : the set of control points being edited, which a change of the rule of extrusion keeps.
    """
    rule = fields.get("extrusion", step.extrusion)
    if rule == "interpolate" and step.extrusion != "interpolate":
        fields.setdefault("knots", _FIRST_KNOTS)
        fields.setdefault("maps", (points,) * len(fields["knots"]))
    elif rule != "interpolate" and step.extrusion == "interpolate":
        fields.setdefault("knots", ())
        fields.setdefault("maps", (points,))
        if any(m != points for m in step.maps):
            return "The key picture that was being edited stays; undo brings the others back."
    if rule == "modulate" != step.extrusion and step.cuts and step.curve == "z" and "curve" not in fields:
        fields["curve"] = "1-z"  # the other way round a cut is shut where one looks at it
        return "The cut is open in front and closed at the back now: f = 1 - z."
    if {"kernel", "trend", "smoothing", "support", "maps"} & set(fields):
        fields.setdefault("chosen_support", None)  # found anew
    kernel = kernel_named(fields.get("kernel", step.kernel))
    trend = trend_named(fields.get("trend", step.trend))
    if kernel.order <= trend.order:
        return ""
    if "kernel" in fields and "trend" not in fields:
        fields["trend"] = next(t.name for t in sorted(TRENDS.values(), key=lambda t: t.order)
                               if t.order >= kernel.order)
        return f"The kernel {kernel.title} needs the trend {trend_named(fields['trend']).title}: it is chosen now."
    if "trend" in fields and "kernel" not in fields:
        fields["kernel"] = "wendland_c2"
        return f"The kernel {kernel.title} needs a richer trend than {trend.title}; Wendland C2 took its place."
    return ""


def points_between(maps: list[ControlPoints], knots: list[float], index: int) -> ControlPoints:
    """What interpolation makes at a new key of the neighbours' points; those of the nearer one if they differ."""
    if index == 0 or index == len(maps):
        return maps[0 if index == 0 else -1]
    before, after = maps[index - 1], maps[index]
    t = (knots[index] - knots[index - 1]) / (knots[index + 1] - knots[index - 1])
    nearer = before if t < 0.5 else after
    if before.ids != after.ids:
        return nearer
    return replace(nearer, source=(1 - t) * before.source + t * after.source,
                   target=(1 - t) * before.target + t * after.target)


def turned(deformation: Deformation, index: int, new: Step, untouched: Step) -> tuple[Deformation, int, str]:
    """The document and the step to edit once the picture is turned, and what has to be said about it.

    A side that has a step already leads back to it. Else the step being edited is turned if it is as it began, and a
    new one comes after all others if it is not.

    Parameters
    ----------
    index : of the step that was being edited.
    new : a step on the other side, without drags; untouched : what the one being edited began as.
    """
    steps = list(deformation.steps)
    old = steps[index]
    is_used = old.maps != untouched.maps or bool(old.cuts or old.parts)
    there = max((k for k, step in enumerate(steps) if step.plane == new.plane and k != index), default=None)
    if there is not None:
        if not is_used:
            del steps[index]
            there -= there > index
        notice = f"Back at step {there + 1}, which was made from this side."
        return replace(deformation, steps=tuple(steps)), there, notice
    if not is_used:
        return deformation.with_step(index, new), index, ""
    count = len(steps)
    notice = (f"Step {count + 1} begins. The points of step {index + 1} are kept: "
              "choose its side again to edit them.")
    return deformation.then(new), count, notice

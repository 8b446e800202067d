"""What one change of a step brings along: a kernel its trend, a rule of extrusion its sets of points."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from deformnb.control_points import ControlPoints
from deformnb.deformation import Step
from deformnb.kernels import kernel_named
from deformnb.trend import TRENDS, trend_named

# Depths that the points are spread to when the rule "interpolate" is chosen: front, middle, back.
_FIRST_KNOTS = (0.0, 0.5, 1.0)


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

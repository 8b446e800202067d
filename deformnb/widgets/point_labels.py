"""An edit of control points in words, for the history of a studio or an application."""

from __future__ import annotations

import re

import numpy as np

from deformnb.control_points import ControlPoints

JOINING = ("nudge", "turn", "scale")
"""Kinds of edits that keys do: held down they are one step of the history."""

_STROKE = re.compile(r"(smudge|expand|shrink) \d+")


def edit_label(before: ControlPoints, after: ControlPoints, kind: str = "") -> str:
    """What was done to a set of points; ``kind`` is what the page calls it, where it was one.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [4, 0]], names=["tail", ""])
    >>> edit_label(points, points.move(0, [1, 0])), edit_label(points, points.remove(1))
    ('move "tail"', 'remove point 1')
    >>> edit_label(points, points.edit(1, locked=True))
    'lock point 1'
    >>> edit_label(points, points.move(0, [0, 3]).move(1, [4, 1]), "turn")
    'turn 2 points'
    >>> edit_label(points, points.add([9, 9], name="smudge 4"), "brush")
    'smudge 4'
    """
    if kind in ("turn", "scale", "brush"):
        return _tool(before, after, kind)
    old, new = (dict(zip(p.ids, range(len(p)), strict=True)) for p in (before, after))
    added = [k for i, k in new.items() if i not in old]
    removed = [k for i, k in old.items() if i not in new]
    if added and removed:
        return "replace points"
    if added:
        return f"add {_who(after, added)}"
    if removed:
        return f"remove {_who(before, removed)}"
    both = [(k, old[i]) for i, k in new.items()]
    for what, name in (("move", "target"), ("move the source of", "source"), ("switch", "active"), ("weigh", "weight"),
                       ("lock", "locked"), ("change the radius of", "radius")):
        new_values, old_values = getattr(after, name), getattr(before, name)
        changed = [k for k, j in both if not np.array_equal(new_values[k], old_values[j], equal_nan=True)]
        if changed and name == "locked" and not after.locked[changed].any():
            return f"unlock {_who(after, changed)}"
        if changed:
            return f"{what} {_who(after, changed)}"
    renamed = [k for k, j in both if after.names[k] != before.names[j]]
    return f"rename {_who(after, renamed)}" if renamed else "change points"


def _tool(before: ControlPoints, after: ControlPoints, kind: str) -> str:
    old = dict(zip(before.ids, before.target, strict=True))
    changed = [k for k, i in enumerate(after.ids) if i not in old or not np.array_equal(after.target[k], old[i])]
    strokes = {after.names[k] for k in changed if after.ids[k] not in old and _STROKE.fullmatch(after.names[k])}
    if kind == "brush" and strokes:
        return min(strokes)
    return f"{kind} {_who(after, changed)}" if changed else "change points"


def _who(points: ControlPoints, positions: list[int]) -> str:
    if len(positions) > 1:
        return f"{len(positions)} points"
    k = positions[0]
    return f'"{points.names[k]}"' if points.names[k] else f"point {points.ids[k]}"

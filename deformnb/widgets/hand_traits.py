"""Traits by which the page of an editor keeps how a hand works: its mirror, its grid, its brush."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from deformnb.errors import DeformError

_AXES = ("a", "b")


def _mirror(value: Any) -> None:
    keys = {"on", "axis", "at"}
    if not isinstance(value, dict) or set(value) != keys:
        raise DeformError('the mirror must have "on", "axis" and "at", such as {"on": True, "axis": "a", "at": None}; '
                          f"got {value!r:.80}.")
    if not isinstance(value["on"], bool) or value["axis"] not in _AXES:
        raise DeformError(f'the mirror is on or off, and its axis "a" or "b"; got {value!r:.80}.')
    if value["at"] is not None and not _is_length(value["at"]):
        raise DeformError(f"the axis of the mirror must be at a finite number or None, got {value['at']!r:.40}.")


def _length(value: Any) -> None:
    if not _is_length(value) or value < 0:
        raise DeformError(f"it must be 0 or a positive length, got {value!r:.40}.")


def _switch(value: Any) -> None:
    if not isinstance(value, bool):
        raise DeformError("it must be true or false.")


def _is_length(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value) and abs(value) < 1e15


PAGE_TRAITS: dict[str, Callable[[Any], None]] = {
    "mirror": _mirror, "snap": _length, "brush_radius": _length, "stop_at_folds": _switch}
"""What checks a value of each of these traits; it raises :class:`~deformnb.errors.DeformError` with the reason."""

"""Traits by which the page of an editor keeps how a hand works: its mirror, its grid, its brush."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import traitlets

from deformnb.errors import DeformError


def _flat_mirror(value: Any) -> None:
    _mirror(value, ("a", "b"))


def _space_mirror(value: Any) -> None:
    _mirror(value, ("x", "y", "z"))


def _mirror(value: Any, axes: tuple[str, ...]) -> None:
    keys = {"on", "axis", "at"}
    if not isinstance(value, dict) or set(value) != keys:
        raise DeformError(f'the mirror must have "on", "axis" and "at", such as {{"on": True, "axis": "{axes[0]}", '
                          f'"at": None}}; got {value!r:.80}.')
    if not isinstance(value["on"], bool) or value["axis"] not in axes:
        names = " or ".join(f'"{axis}"' for axis in axes)
        raise DeformError(f"the mirror is on or off, and its axis {names}; got {value!r:.80}.")
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
    "mirror": _flat_mirror, "snap": _length, "brush_radius": _length, "stop_at_folds": _switch}
"""What checks a value of each of these traits; it raises :class:`~deformnb.errors.DeformError` with the reason."""

SPACE_TRAITS: dict[str, Callable[[Any], None]] = {"mirror": _space_mirror, "snap": _length}
"""The same for an editor in space."""


class SpaceHandTraits(traitlets.HasTraits):
    """How a hand works in space: the plane of its mirror, and the lattice to which targets keep."""

    mirror = traitlets.Dict({"on": False, "axis": "x", "at": None}).tag(sync=True)
    snap = traitlets.Float(0.0).tag(sync=True)

    @traitlets.validate("mirror", "snap")
    def _of_the_hand(self, proposal: Any) -> Any:
        SPACE_TRAITS[proposal["trait"].name](proposal["value"])
        return proposal["value"]

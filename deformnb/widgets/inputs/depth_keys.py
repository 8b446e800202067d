"""Depths of the key pictures of the extrusion rule "interpolate", as marks on a bar.

Values of its messages (see :mod:`deformnb.widgets.inputs.base`): ``{"kind": "move" | "add" | "remove" | "select",
"index": k, "knots": [...], "selected": k}``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import traitlets

from deformnb.errors import DeformError
from deformnb.rbf.extrusion import interpolate
from deformnb.widgets.bundle import bundle
from deformnb.widgets.inputs.base import AbstractEdited, is_number, is_whole
from deformnb.widgets.messages.inputs import MOST_KEYS

LEAST_APART = 0.01
"""Least distance of keys in the front end; two at one depth would tear the volume."""


_KINDS = {"move": 0, "add": 1, "remove": -1, "select": 0}


@dataclass(frozen=True)
class KeyEdit:
    """Edit of the keys.

    Parameters
    ----------
    kind : "move", "add", "remove" or "select".
    index : which key: of the new list, or for "remove" of the old one.
    knots : the depths afterwards.
    selected : index of the key that is edited afterwards.
    """

    kind: str
    index: int
    knots: tuple[float, ...]
    selected: int


class _KnotsTrait(traitlets.TraitType[tuple[float, ...], tuple[float, ...]]):
    """Rising depths in [0, 1]."""

    info_text = "rising numbers from 0 to 1"

    def validate(self, obj: Any, value: Any) -> tuple[float, ...]:
        knots = np.atleast_1d(np.asarray(_floats(value)))
        interpolate(knots)
        return tuple(float(k) for k in knots)


def _floats(value: Any) -> list[float]:
    try:
        return [float(v) for v in value]
    except (TypeError, ValueError):
        raise DeformError(f"knots must be numbers from 0 (first slice) to 1 (last), got {value!r:.60}.") from None


class DepthKeys(AbstractEdited):
    """Keys at depths in [0, 1], of which one is selected.

    Parameters
    ----------
    knots : rising depths: 0 is the first slice, 1 the last.
    selected : index of the key whose points are edited.
    theme, label, read_only : as in :class:`~deformnb.widgets.Editor`.

    Notes
    -----
    ``knots`` and ``selected`` are traits. To store a set of points for each key use ``on_edit``: its callback gets a
    :class:`KeyEdit` with the key that was added or removed.

    Examples
    --------
    >>> keys = DepthKeys((0.0, 0.5, 1.0), selected=1)
    >>> keys.knots = (0.25,)
    >>> keys.selected
    0
    """

    _esm = bundle("depth_keys.js")
    _css = bundle("depth_keys.css")

    knots = _KnotsTrait((0.0, 1.0))
    selected = traitlets.Int(0)
    least_apart = traitlets.Float(LEAST_APART, read_only=True).tag(sync=True)

    def __init__(self, knots: Sequence[float] = (0.0, 1.0), selected: int = 0, **traits: Any) -> None:
        super().__init__(knots=knots, **{"label": "Depths of the key pictures", **traits})
        self.selected = selected
        self._show()

    def _check_value(self, value: Any) -> KeyEdit:
        if not isinstance(value, dict) or value.get("kind") not in tuple(_KINDS):
            raise DeformError(f"an edit of keys is one of {', '.join(_KINDS)}.")
        kind, knots = value["kind"], value.get("knots")
        index: Any = value.get("index")
        selected: Any = value.get("selected")
        if not isinstance(knots, list) or not 0 < len(knots) <= MOST_KEYS or not all(map(is_number, knots)):
            raise DeformError(f"knots must be a list of 1 to {MOST_KEYS} numbers.")
        before = len(self.knots)
        if len(knots) != before + _KINDS[kind]:
            raise DeformError(f"{kind!r} leaves {before + _KINDS[kind]} keys of {before}, not {len(knots)}.")
        if not (
            is_whole(index)
            and 0 <= index < max(before, len(knots))
            and is_whole(selected)
            and 0 <= selected < len(knots)
        ):
            raise DeformError("there is no such key.")
        interpolate(knots)
        apart = min(LEAST_APART, *np.diff(self.knots)) if before > 1 else LEAST_APART  # a document's may be nearer
        if len(knots) > 1 and np.diff(knots).min() < apart - 1e-9:
            raise DeformError(f"keys must be at least {LEAST_APART:g} of the depth apart.")
        return KeyEdit(kind, index, tuple(float(k) for k in knots), selected)

    def _take(self, edit: KeyEdit) -> None:
        with self.hold_trait_notifications():  # observers of one see the other
            self.knots = edit.knots
            self.selected = edit.selected
        self._show()

    @traitlets.validate("selected")
    def _a_key(self, proposal: Any) -> int:
        index = int(proposal["value"])
        if not 0 <= index < len(self.knots):
            raise DeformError(f"there is no key {index}; there are {len(self.knots)}.")
        return index

    @traitlets.observe("knots", "selected")
    def _handle_change(self, _change: Any) -> None:
        self.selected = min(self.selected, len(self.knots) - 1)
        self._show()

    def _show(self) -> None:
        self._set_content(knots=list(self.knots), selected=self.selected)

    def __repr__(self) -> str:
        depths = ", ".join(f"{k:.4g}" for k in self.knots)
        return f"DepthKeys(({depths}), selected={self.selected})"

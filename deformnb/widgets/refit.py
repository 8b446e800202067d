"""What an editor's points make of a deformation while they move: one map of it fitted anew, by the core."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from deformnb.control_points import ControlPoints
from deformnb.degenerate import default_support
from deformnb.errors import DeformError
from deformnb.extrusion import Extrusion
from deformnb.fields import AbstractField, Composed
from deformnb.rbf import RBFInterpolant, fit_rbf
from deformnb.widgets.card_maps import count_maps

_SETTINGS = ("kernel", "support", "trend", "smoothing", "strength", "lone_support")


class Refit:
    """A field, one map of which follows an editor.

    Parameters
    ----------
    field : an extrusion, or a composition that ends with one; all but the one map stays.
    index : which of its maps the editor's points make.

    Raises
    ------
    DeformError
        If the field does not end with an extrusion, or has no such map.
    """

    def __init__(self, field: AbstractField | None, index: int) -> None:
        count = count_maps(field)
        if count is None:
            raise DeformError("an editor moves the maps of an extrusion, and this field does not end with one.")
        if not 0 <= index < count:
            raise DeformError(f"there is no map {index}; the extrusion has {count}.")
        self._field, self._index = field, index
        self._previous: RBFInterpolant | None = None

    def __call__(self, points: ControlPoints, settings: dict[str, Any]) -> AbstractField | None:
        """The field with the map of these points; the last one where they cannot be fitted, as the editor says."""
        try:
            support = settings["support"] or default_support(points) or settings["lone_support"]
            strength = settings["strength"]
            fit = fit_rbf(points if strength == 1 else points.blended(strength), kernel=settings["kernel"],
                          support=support, trend=settings["trend"], smoothing=settings["smoothing"],
                          previous=self._previous)
        except DeformError:
            return self._field
        self._previous = fit
        self._field = self._with(fit)
        return self._field

    def _with(self, fit: RBFInterpolant) -> AbstractField:
        field = self._field
        last = field.then if isinstance(field, Composed) else field
        assert isinstance(last, Extrusion)
        moved = replace(last, maps=(*last.maps[: self._index], fit, *last.maps[self._index + 1 :]))
        return replace(field, then=moved) if isinstance(field, Composed) else moved


def follow_editor(editor: Any, refit: Refit,
                  put: Callable[[Callable[[], AbstractField | None]], None]) -> Callable[[], None]:
    """Put what makes the field of an editor's points at every movement in it; what is returned ends it.

    Parameters
    ----------
    put : a method, held weakly: an editor keeps no view alive. What it gets is to be called later, in any thread.
    """
    held = weakref.WeakMethod(put)

    def tell(points: ControlPoints, phase: str) -> None:
        taker = held()
        if taker is not None:
            taker(partial(refit, points, {name: getattr(editor, name) for name in _SETTINGS}))

    def changed(change: Any) -> None:
        tell(editor.points, "end")

    names = ["points", *_SETTINGS]
    editor.on_edit(tell)
    editor.observe(changed, names)

    def unfollow() -> None:
        editor.on_edit(tell, remove=True)
        editor.unobserve(changed, names)

    return unfollow

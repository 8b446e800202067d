"""Depth panel: the rule of extrusion from the picture into depth, its curve, its key pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from deformnb.document.deformation import Step
from deformnb.session.session import Session
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, row
from deformnb.widgets.inputs.curve_editor import CurveEditor
from deformnb.widgets.inputs.depth_keys import DepthKeys
from deformnb.widgets.studio.controls import Guard, Panel, prose, widget_of

HINTS = {
    "replicate": "Every slice behind the picture is deformed like the picture.",
    "modulate": "The picture shows the displacement where f is 1; at other depths it is f times as much.",
    "interpolate": "Each key has separate points, which the picture shows; between two keys they are blended.",
}
"""Hints on the effect of each rule on a picture's step."""

_OF_ANOTHER = "A special rule of extrusion, with nothing to set here."
_IN_SPACE = "Points in space have their own depth: there is nothing to extrude."

Preview = Callable[[Step | None], None]
"""Function that shows a step while it is being changed."""


class DepthPanel(Panel):
    """The rule of extrusion of the step that is edited.

    Parameters
    ----------
    preview : shows a step in progress while the user moves the curve or a key; None gives it up.

    Attributes
    ----------
    curve, keys : the widgets in which f(z) is drawn and key pictures are placed.
    """

    title = "Depth"

    def __init__(self, session: Session, guard: Guard, preview: Preview | None = None) -> None:
        super().__init__(session, guard)
        self._preview = preview
        self.rule = self.bind_step(widget_of("extrusion"), "extrusion")
        self.curve = CurveEditor(session.editing.step.curve)
        self.keys = DepthKeys(session.editing.step.knots or (0.0, 1.0))
        self.curve.observe(self._curve_changed, "curve")
        if preview is not None:
            self.curve.on_edit(self._curve_dragged)
        self.keys.on_edit(self._keys_changed)
        self.hint = basic.HTML()  # a label would cut long words
        self.box = column(row(self.rule), self.hint, self.curve, self.keys, max_width="720px")
        self.refresh()

    def arrange(self) -> None:
        step = self.session.editing.step
        basic.set_visible(self.rule, step.plane is not None)
        self.hint.value = prose(_IN_SPACE if step.plane is None else HINTS.get(step.extrusion, _OF_ANOTHER))
        basic.set_visible(self.curve, step.extrusion == "modulate")
        basic.set_visible(self.keys, step.extrusion == "interpolate")
        if step.extrusion == "modulate" and self.curve.curve != step.curve:
            self.curve.curve = step.curve
        if step.extrusion == "interpolate":
            key = min(self.session.editing.key, len(step.knots) - 1)
            if (self.keys.knots, self.keys.selected) != (step.knots, key):
                with self.keys.hold_trait_notifications():
                    self.keys.knots, self.keys.selected = step.knots, key

    def _curve_changed(self, change: Any) -> None:
        if self.session.editing.step.extrusion == "modulate" and change["new"] != self.session.editing.step.curve:
            self.guard(lambda: self.session.editing.change(curve=change["new"], kind="curve"))

    def _curve_dragged(self, curve: Any, phase: str) -> None:
        if self.session.editing.step.extrusion == "modulate":
            self._show(phase, curve=curve)

    def _show(self, phase: str, **changed: Any) -> None:
        """Show a preview; where no edit came of it, the state before is shown again."""
        if self._preview is not None:
            self._preview(replace(self.session.editing.step, **changed) if phase == "move" else None)

    def _keys_changed(self, edit: Any, phase: str) -> None:
        if self.session.editing.step.extrusion != "interpolate":
            return
        if phase == "end":
            self._edit_keys(edit)
        if edit.kind == "move":
            self._show(phase, knots=edit.knots)

    def _edit_keys(self, edit: Any) -> None:
        session = self.session
        if edit.kind == "select":
            self.guard(lambda: session.editing.edit_step(session.editing.index, edit.selected))
            return
        way = {"add": "added", "remove": "removed"}.get(edit.kind)
        options = {way: edit.index} if way else {}
        self.guard(lambda: session.editing.edit_keys(edit.knots, selected=edit.selected, **options))

"""View plane panel: the picture of any camera, turned by degrees, and set back to a side."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from deformnb.session.session import Session
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, row
from deformnb.widgets.studio.controls import WHOLE_DESCRIPTION, Guard, Panel, action_button, prose, widget_of

_ANGLES = {
    "up": ("Up", "Degrees by which the viewer moves up: more of the object is seen from above"),
    "right": ("Right", "Degrees by which the viewer moves to the right"),
    "roll": ("Roll", "Degrees by which the picture turns clockwise"),
}
_HINT = "Turn the volume as you like, and edit on the picture that it shows: all tools work on it as on a side."


class ViewPlanePanel(Panel):
    """The plane of the picture that is edited: from the camera of the view, by angles, or that of the nearest side.

    Parameters
    ----------
    edit_view : edits on the picture that the camera of the view sees.
    """

    title = "View plane"

    def __init__(self, session: Session, guard: Guard, view: Any, edit_view: Callable[[], None]) -> None:
        super().__init__(session, guard)
        self.angles = {
            name: basic.BoundedFloatText(
                0.0,
                min=-180.0,
                max=180.0,
                step=5.0,
                description=label,
                tooltip=tip,
                style=WHOLE_DESCRIPTION,
                layout=basic.layout(width="96px"),
            )
            for name, (label, tip) in _ANGLES.items()
        }
        self.turn = action_button("turn_view", self._turn_by_angles)
        self.back = action_button("set_back", lambda: guard(session.set_back))
        frame = []
        if view.has_trait("plane_frame"):
            frame.append(
                self.add(
                    widget_of("plane_frame"),
                    lambda: session.steps.view is None if view.plane_frame is None else view.plane_frame,
                    lambda value: view.set_trait("plane_frame", value),
                )
            )
        self.box = column(
            basic.HTML(prose(_HINT)),
            row(action_button("edit_view", edit_view), self.back, *frame),
            row(*self.angles.values(), self.turn),
        )
        self.refresh()

    def _turn_by_angles(self) -> None:
        angles = {name: float(widget.value) for name, widget in self.angles.items()}
        if self.guard(lambda: self.session.turn_view(**angles)):
            for widget in self.angles.values():
                widget.value = 0.0

    def arrange(self) -> None:
        in_space = self.session.editing.step.plane is None
        self.turn.disabled = in_space
        self.back.disabled = in_space or self.session.steps.view is not None

"""The studio's two editors, one for points on a picture and one for points in space, and the place they share.

Whatever the session says is shown in the one that the step being edited needs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import ipywidgets as ipw
import numpy as np

from deformnb.deformation import lone_support
from deformnb.fields import AbstractField
from deformnb.plane import Picture
from deformnb.session import Session
from deformnb.widgets.cell_widgets import parts_of_another
from deformnb.widgets.editor import Editor
from deformnb.widgets.shape_messages import checked_shapes
from deformnb.widgets.space_editor import SpaceEditor

_OF_THE_STEP = ("kernel", "support", "trend", "smoothing", "strength", "stages")

_HALF, _WHOLE = "1 1 320px", "1 1 100%"
_SPACE_SHARE, _LOWEST = 0.7, 160  # of the height: in space pictures and view are one below the other


def make_editor(session: Session, height: int) -> Editor:
    """An editor of the step that a session edits, empty if that lies in space; its undo is the session's."""
    step = session.step
    made = Editor(session.picture(), None, height=height, history=session.history,
                  label=f"Picture of {session.volume.name or 'the volume'}")
    made.chooses_support = False
    made.lone_support = lone_support(session.volume.grid)
    if step.plane is not None:
        show_step(made, session)
    return made


def show_step(editor: Any, session: Session) -> None:
    """Show the points, settings and shapes of the step that a session edits, all at once."""
    step = session.step
    with editor.hold_sync():
        for name in _OF_THE_STEP:
            if getattr(editor, name) != getattr(step, name):
                setattr(editor, name, getattr(step, name))
        editor.chosen_support = step.chosen_support and step.chosen_support.radius
        if isinstance(editor, Editor):
            for name in ("cuts", "parts"):
                shapes = checked_shapes(name, getattr(step, name))
                if getattr(editor, name) != shapes:
                    setattr(editor, name, shapes)
            editor.cut_rule = step.cut_rule
            editor.beyond = _box_on_picture(session)
        elif editor.options != _options(session):
            editor.options = _options(session)
        if editor.points != session.points:
            editor.points = session.points


def _box_on_picture(session: Session) -> list[float]:
    """Where the result's box reaches on the picture, (a0, a1, b0, b1); empty for the volume's own."""
    if session.output is None:
        return []
    corners = session.plane.to_plane(session.output.corners())[:, :2]
    return np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1).ravel().tolist()


def _options(session: Session) -> dict[str, Any]:
    step = session.step
    return {"cuts": step.cuts, "parts": step.parts, "cut_rule": step.cut_rule}


class StudioEditors:
    """What stands on the left of a studio.

    Parameters
    ----------
    session : which step is shown.
    height : of the picture in CSS pixels.
    listen : called with each editor when it is made.

    Attributes
    ----------
    plane : the editor on a picture; space : the one in space, None until a step needs it.
    box : the place; beside : that of the view. Three pictures need the whole width, and the view goes below them.
    """

    def __init__(self, session: Session, height: int, listen: Callable[[Any], None]) -> None:
        self._session, self._listen = session, listen
        self._low_height = max(_LOWEST, int(_SPACE_SHARE * height))
        self.plane = make_editor(session, height)
        self.space: SpaceEditor | None = None
        listen(self.plane)
        self.box = ipw.Box([self.plane], layout=ipw.Layout(flex=_HALF, min_width="0"))
        self.beside = ipw.Box([], layout=ipw.Layout(flex=_HALF, min_width="0"))
        self.plane.layout.width = "100%"
        if session.step.plane is None:
            self.show_picture(self.make_picture())

    @property
    def current(self) -> Any:
        """The editor of the step that is edited."""
        if self._session.step.plane is not None:
            return self.plane
        if self.space is None:
            self.space = self._make_space()
        return self.space

    def _make_space(self) -> SpaceEditor:
        session = self._session
        with parts_of_another():
            made = SpaceEditor(session.volume, session.points, height=self._low_height, history=session.history,
                               transfer=session.transfer_function, before=session.before())
        made.chooses_support = False
        made.layout.width = "100%"
        self._listen(made)
        return made

    def make_picture(self) -> Picture | AbstractField | None:
        """What the editor of this step shows behind its points: takes time, and changes nothing yet."""
        session = self._session
        return session.picture() if session.step.plane is not None else session.before()

    def show_picture(self, made: Any) -> None:
        """Show it together with its points: a picture must never meet another one's points."""
        editor = self.current
        with editor.hold_sync():
            if isinstance(editor, Editor):
                editor.picture = made
                editor.lone_support = lone_support(self._session.volume.grid)
            elif editor.before is not made:
                editor.before = made
            self.show_step()
        if self.box.children != (editor,):
            in_space = editor is self.space
            self.box.layout.flex = _WHOLE if in_space else _HALF
            self.beside.layout.min_height = f"{self._low_height}px" if in_space else None
            self.box.children = (editor,)

    def show_step(self) -> None:
        """Show the points, settings and shapes of the step."""
        show_step(self.current, self._session)

    def tell(self, **traits: Any) -> None:
        """Set traits of both editors, such as their history."""
        for editor in (self.plane, self.space):
            if editor is not None:
                for name, value in traits.items():
                    setattr(editor, name, value)

    def close(self) -> None:
        """Close the editor that has no place now."""
        for editor in (self.plane, self.space):
            if editor is not None and editor not in self.box.children:
                editor.close()

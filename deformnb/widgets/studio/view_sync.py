"""Synchronisation of the studio's view with the displacement of the session and with a drag in progress.

While a point of the last step on a picture is dragged, the view's front end follows the editor's without Python. Drags
that it cannot compute there (in an earlier step, in space, or of steps that are added up) are shown by Python,
coarsely: the newest movement, whenever the one before is done.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from deformnb.document.deformation import Deformation, Step
from deformnb.document.edits import is_view_name
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidPart
from deformnb.session.session import Session
from deformnb.volume.plane import Plane
from deformnb.widgets.messages.editors import PointsEdit
from deformnb.widgets.textures import MOST_MAPS, count_maps
from deformnb.widgets.view.picture_plane import ShowsPlane
from deformnb.widgets.worker import Worker


def followed_step(deformation: Deformation) -> int | None:
    """The step whose drags a front end can show alone: the last in use, on a picture, and not added to others."""
    in_use = [k for k, step in enumerate(deformation.steps) if step.enabled]
    if not in_use or deformation.steps[in_use[-1]].plane is None:
        return None
    return in_use[-1] if deformation.mode == "compose" or len(in_use) == 1 else None


def show_plane(view: Any, session: Session) -> None:
    """Show the place of a session's picture in a view, that of the slice where it is one."""
    if not isinstance(view, ShowsPlane):
        return
    step, pictures = session.editing.step, session.pictures
    if step.plane is None:
        view.show_plane(None, name="in space")
        return
    places = step.plane.to_plane(session.editing.grid.corners())[:, :2]
    (a0, b0), (a1, b1) = places.min(axis=0).tolist(), places.max(axis=0).tolist()
    view.show_plane(
        step.plane.shifted(pictures.depth) if pictures.method == "slice" else step.plane,
        (a0, a1, b0, b1),
        session.steps.side_of(step.plane),
        is_named=bool(step.name) and not is_view_name(step.name),
        is_side=session.steps.view is not None,
    )


class StudioLink:
    """Between a session and a view.

    Parameters
    ----------
    session : whose displacement is shown, view : where.
    worker : does what takes time.
    """

    def __init__(self, session: Session, view: Any, worker: Worker) -> None:
        self._session, self._view, self._worker = session, view, worker
        self._lock = threading.Lock()
        self._serial = 0  # of the last content; a movement that belongs to an earlier one comes too late
        self._editor: Any = None  # that was shown last
        self._has_previewed = False  # something that is no edit, since then
        self._observed: Any = None  # the editor whose movements come to Python
        self._in_space: Any = None  # the editor whose points are seen in the view as well
        self.previews = 0

    def show(self, editor: Any) -> None:
        """Show the displacement of the session, and from now on the drags in this editor."""
        session = self._session
        field = session.results.field()
        follows = self._client_can_follow(field)
        with self._lock:
            self._serial += 1
            self._editor, self._has_previewed = editor, False
            if follows:
                index = min(session.editing.key, len(session.editing.step.maps) - 1)
                self._view.follow(editor, field, index, output=session.results.grid)
            else:
                self._view.follow(None, field, output=session.results.grid)
        show_plane(self._view, session)
        if hasattr(self._view, "picture_editor"):
            self._view.picture_editor = None if session.editing.step.plane is None else editor
        in_space = editor if session.editing.step.plane is None and hasattr(self._view, "edit_points") else None
        if in_space is not self._in_space:
            self._in_space = in_space
            self._view.edit_points(in_space, self.field_of)
        self._observe_editor(None if follows or in_space is not None else editor)

    def preview(self, step: Step | None) -> None:
        """Preview the document with this in place of the step that is edited; of several the newest only.

        Parameters
        ----------
        step : a preview that is no edit yet, such as a curve that is being dragged. None cancels it: the
            state of the session is shown again.
        """
        if step is None:
            if self._has_previewed:
                self.show(self._editor)
            return
        session, self._has_previewed = self._session, True
        document, index = session.editing.deformation, session.editing.index
        self._latest(lambda: document.with_step(index, step).field(session.editing.grid))

    @property
    def is_at_picture(self) -> bool:
        """True if the camera looks as the picture does."""
        camera = self._view.camera
        plane = Plane.from_normal((0, 0, 0), camera["direction"], camera["up"])
        return self._session.editing.plane.has_same_directions(plane)

    def turn(self) -> None:
        """Set the camera to the picture: to a side rotated a little for depth, to an oblique view straight.

        A camera that looks as the picture does stays, but for a perspective: then picture and volume coincide.
        """
        u, v, n = self._session.editing.plane.frame
        if self.is_at_picture:
            self._view.set_camera(perspective=False)
        elif self._session.steps.view is None:
            self._view.set_camera(n, -v, perspective=False)
        else:
            self._view.set_camera(n + 0.35 * u + 0.2 * v, -v)

    def close(self) -> None:
        """Stop observing the editors."""
        self._observe_editor(None)
        if self._in_space is not None:
            self._view.edit_points(None)

    def _client_can_follow(self, field: AbstractField) -> bool:
        if self._session.editing.index != followed_step(self._session.editing.deformation):
            return False
        maps = count_maps(field)
        return maps is not None and maps <= MOST_MAPS

    def _observe_editor(self, editor: Any) -> None:
        if editor is self._observed:
            return
        if self._observed is not None:
            self._observed.on_edit(self._preview_move, remove=True)
        self._observed = editor
        if editor is not None:
            editor.on_edit(self._preview_move, details=True)

    def _preview_move(self, edit: PointsEdit) -> None:
        if edit.phase == "move":
            self._latest(lambda: self.preview_field(edit))

    def preview_field(self, edit: PointsEdit) -> AbstractField:
        """The displacement of the whole document while points or a rigid part of the edited step are dragged."""
        return self.field_of(edit.points, edit.with_part(self._session.editing.step.parts))

    def _latest(self, make: Callable[[], AbstractField]) -> None:
        if not self._worker.is_closed:
            serial = self._serial
            self._worker.latest("preview", lambda: self._preview(make, serial))

    def _preview(self, make: Callable[[], AbstractField], serial: int) -> None:
        try:
            field = make()
        except DeformError:  # two points met in the drag; the edit will report it if it ends so
            return
        with self._lock:
            if serial == self._serial:
                self._view.show_deformation(field, output=self._session.results.grid)
                self.previews += 1

    def field_of(self, points: ControlPoints, parts: tuple[RigidPart, ...] | None = None) -> AbstractField:
        """The displacement of the whole document, had the step that is edited these points and rigid parts."""
        session = self._session
        step = session.editing.step if parts is None else replace(session.editing.step, parts=parts)
        if points == session.editing.points and step == session.editing.step:
            return session.results.field()
        step = step.with_points(points, min(session.editing.key, len(step.maps) - 1))
        return session.editing.deformation.with_step(session.editing.index, step).field(session.editing.grid)

"""Model of the application: a session with the widgets that show it, and no server.

Everything here is called in one thread, the application's own (:attr:`Application.thread`), so that an edit that takes
a second never keeps the server from answering.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from deformnb.app.diagnostics import ApplicationDiagnostics
from deformnb.app.files import ApplicationFiles
from deformnb.app.panel_widgets import PanelWidgets
from deformnb.app.volumes import Volumes, facing, nearly_facing
from deformnb.document.deformation import STEP_LABELS
from deformnb.document.json_format import to_json
from deformnb.errors import DeformError
from deformnb.rbf.support import lone_support
from deformnb.session.autosave import COMMANDS, Recovery
from deformnb.session.session import Session
from deformnb.volume.transfer import TransferFunction
from deformnb.widgets.inputs.base import is_whole
from deformnb.widgets.messages import EditDone
from deformnb.widgets.parameters import Number, parameters
from deformnb.widgets.studio.editors import looks_alike, make_editor, picture_key, show_step
from deformnb.widgets.studio.history_labels import JOINING, edit_label, go_to, history_rows
from deformnb.widgets.studio.view_sync import StudioLink
from deformnb.widgets.worker import Worker

_LOG = logging.getLogger(__name__)

REQUESTS = ("undo", "redo", "reset", "save", "front", "beside", "restore", "skip", "delete", "take_back", "unfold",
            "stop_file", "take_anyway", "forget_file", "fit_box", "own_box", "take_hold", "add_step")
"""Actions that a client may request by name."""

NUMBERED = ("go_to", "look_at")
"""Actions that a client may request by name and number: a state of the history, a control point."""

_NOT_OFFERED = ("density", "cut_rule")
_LONGEST_NAME = 64  # of a client's window
_OF_THE_EDITOR = ("show_grid", "drag_grid", "show_radius", "overlay")


class Application:
    """A session, its picture and its volume.

    Parameters
    ----------
    session : what is edited.
    viewer : "live" or "vtk": who draws the volume.

    Attributes
    ----------
    pictures : how many sets of points on pictures were shown so far. What a client has done to the one before comes
        late.

    Examples
    --------
    >>> from deformnb.datasets.phantoms import PHANTOMS
    >>> app = Application(Session(PHANTOMS["bar"].make((12, 8, 16)), view="+y"))
    >>> app.set("kernel", "gaussian")
    >>> app.state()["kernel"], app.state()["undo"]
    ('gaussian', 'change kernel')
    >>> app.close()
    """

    def __init__(self, session: Session, viewer: str = "live") -> None:
        self.session, self.viewer = session, viewer
        known = parameters(session.volume.grid.diagonal)
        self.parameters = {name: known[name] for name in known if name not in _NOT_OFFERED}
        self.thread = Worker("deformnb-application")
        self.error = ""
        self.milliseconds = 0.0
        self.changed: Callable[[], None] = lambda: None
        self._listening = True
        self._shown: tuple[Any, ...] = ()
        self._colours = session.transfer_function
        self.pictures = 0
        self._is_late = self._is_refused = False
        _choose_a_picture(session)
        self.editor = make_editor(session, 1200)
        self._pictured = picture_key(session)
        self._points_of: Any = (session.index, session.key, session.plane)
        self._faced = session.plane
        self.volumes = Volumes(session, self._show_message, self.thread.call)
        self.live = self.volumes.live
        self._previews = Worker("deformnb-preview")
        self.link = StudioLink(session, self.volumes, self._previews)
        self._set_camera(*nearly_facing(session.plane))
        self.editor.observe(self._dragged, "points")
        self.editor.observe(self._drawn, ["cuts", "parts"])
        self.editor.observe(self._set_in_the_editor, list(_OF_THE_EDITOR))
        self.editor.on_history(self.act)
        self.parts = PanelWidgets(session, self.editor, self.live, self.link.preview, self._edited, self._recolour)
        self.diagnostics = ApplicationDiagnostics(session, self.editor, self.thread.call, self._diagnostics_changed)
        self.files = ApplicationFiles(session, self.volumes.seen, self.editor, self.live, self._notify)
        self.recovery = Recovery(session, self._show_message, self._notify)
        self.thread.latest("warm up", session.warm_up)
        self._show()

    @property
    def widgets(self) -> dict[str, Any]:
        """The widgets of the client by name."""
        return {"editor": self.editor, "live": self.live, **self.parts.widgets}

    # -- what the client requests --------------------------------------------------------------------------------------

    def set(self, name: str, value: Any) -> None:
        """Set a control; an error is reported in :attr:`error` and nothing changes."""
        control = self.parameters.get(name)
        if control is None:
            raise DeformError("there is no such control.")
        self._try(lambda: self._apply(name, control.checked(value)))

    def _apply(self, name: str, value: Any) -> None:
        session = self.session
        if name in STEP_LABELS:
            session.change(kind=name, slides=isinstance(self.parameters[name], Number), **{name: value})
        elif name == "automatic_support":
            session.change(kind=name, support=None if value else self._support())
        elif name == "view":
            session.set_view(value)
        elif name == "depth":
            low, high = session.depth_range
            session.depth = low + value * (high - low)
        elif name == "method":
            session.method = value
        elif name == "mode":
            session.set_mode(value)
        else:
            self._apply_to_the_view(name, value)

    def _apply_to_the_view(self, name: str, value: Any) -> None:
        """Apply a setting that is no part of the document."""
        if name == "projection":
            self.volumes.set_projection(value)
        elif name == "shows":
            self.volumes.set_shows(value)
        elif name in _OF_THE_EDITOR:
            setattr(self.editor, name, value)
        elif name == "keep_free":
            self.diagnostics.set_keep_free(value)
        elif name == "show_folds":
            self.volumes.set_folds(value)

    def act(self, name: str, *number: int) -> None:
        """Do one of the actions that give nothing back."""
        if name not in (*REQUESTS, *NUMBERED) or name == "save" or len(number) != (name in NUMBERED):
            raise DeformError("there is no such action.")
        if name == "take_hold":  # no edit: the message about the last one stays
            self.session.take_hold()
            return
        actions: dict[str, Callable[[], Any]] = {
            "take_back": self.diagnostics.model.fold_actions.take_back,
            "unfold": self.diagnostics.model.fold_actions.unfold,
            "go_to": lambda: go_to(self.session, *number, recovery=self.recovery),
            "look_at": lambda: self.diagnostics.look_at(*number),
            "undo": self.session.undo, "redo": self.session.redo, "reset": self.session.reset,
            "add_step": self.session.add_step,
            "front": lambda: self._set_camera(*facing(self.session.plane)),
            "beside": lambda: self._set_camera(*nearly_facing(self.session.plane)),
            "stop_file": self.files.stop, "take_anyway": self.files.take_anyway, "forget_file": self.files.forget,
            "fit_box": self.session.fit_output, "own_box": partial(setattr, self.session, "output", None),
            **{name: partial(self.recovery.act, name) for name in COMMANDS},
        }
        self._try(actions[name])

    def write(self, kind: str, page: str) -> None:
        """Begin to write a file for a client; see :class:`~deformnb.app.files.ApplicationFiles`."""
        before = self.milliseconds
        self._try(lambda: self.files.write(kind, page))
        self.milliseconds = before  # it is no edit

    def open(self, text: str) -> None:
        """Go on with a saved session that a client has."""
        self._try(lambda: self.files.take(text))

    def document(self) -> str:
        """The session as the text of a document that ``deformnb warp`` and ``Session.open`` take."""
        document = self.session.document()
        self.session.saved = document  # the client downloads it
        return to_json(document)

    def receive(self, name: str, message: dict[str, Any], picture: int | None = None) -> None:
        """A message of the client for one of the widgets, as its comm would bring it.

        Parameters
        ----------
        picture : the value of :attr:`pictures` when it came. If that has changed since, a drag was of other points.
        """
        widget = self.widgets.get(name)
        if widget is None:
            raise DeformError("there is no such widget.")
        content = message.get("content")
        self._is_late = picture not in (None, self.pictures)
        try:
            if self._is_late and widget is self.editor and isinstance(content, dict) and content.get("phase") == "move":
                _answer(widget, content)
                return
            widget.comm.handle_msg({"content": {"data": message}, "buffers": []})
        finally:
            self._is_late = False
        if self._is_refused:  # the views have followed it and must go back
            self._is_refused, self._shown = False, ()
            self._show()

    # -- what the client shows -----------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Values of all controls and the texts of the client."""
        session, step = self.session, self.session.step
        labels = session.history
        count, moved = len(session.points), int(session.points.displacement.any(axis=1).sum())
        steps = len(session.deformation.steps)
        which = f" · step {session.index + 1} of {steps}" if steps > 1 else ""
        which += f" · key {session.key + 1} of {len(step.maps)}" if len(step.maps) > 1 else ""
        values = {name: getattr(step, name) for name in self.parameters if name in STEP_LABELS}
        values.update({name: getattr(self.editor, name) for name in _OF_THE_EDITOR})
        states, shown = history_rows(session.history_tree(), self.recovery.earlier)
        return {
            **values, "support": self._support(), "automatic_support": not isinstance(step.support, float),
            "view": session.view or "", "method": session.method,
            "mode": session.deformation.mode, "depth": self._depth(), "projection": self.live.projection,
            "shows": self.live.shows, "show_folds": self.live.show_folds, "keep_free": self.diagnostics.model.keep_free,
            "states": states, "state_shown": states[shown]["id"],
            "undo": labels.get("undo", ""), "redo": labels.get("redo", ""),
            "error": self.error, "notice": session.notice or " ".join(session.notes()),
            "lost": self.recovery.offer, "files": self.files.state, "box": _box_text(session),
            **self.diagnostics.state(),
            "several": steps > 1,
            "facts": f"{count} points, {moved} moved{which}",
            "latency": f"{self.milliseconds:.0f} ms for the last edit" if self.milliseconds else "",
        }

    def _support(self) -> float:
        """The support radius that the points have now, within the range of its slider."""
        session, control = self.session, self.parameters["support"]
        assert isinstance(control, Number)
        found = session.step.support_for(session.points) or lone_support(session.volume.grid)
        return min(max(found, control.low), control.high)

    def _depth(self) -> float:
        """Relative depth of the slice, 0 in front and 1 at the back."""
        low, high = self.session.depth_range
        return (self.session.depth - low) / (high - low) if high > low else 0.5

    def _try(self, action: Callable[[], Any]) -> None:
        started = time.perf_counter()
        self.error = ""
        self.files.pass_on()
        try:
            action()
            self._show()
        except DeformError as error:
            self.error = str(error)
            self._show()
        except Exception as error:
            _LOG.exception("an action of the client failed")
            self.error = f"{type(error).__name__}: {error}"
        self.milliseconds = 1000 * (time.perf_counter() - started)
        self.changed()

    def _dragged(self, change: Any) -> None:
        if not self._listening:
            return
        points, made = change["new"], self.editor.edit_under_way
        done = made.kind if made is not None else ""
        kind = done if done in JOINING else None  # keys held down are one edit
        label = edit_label(self.session.points, points, done)
        self._try(lambda: self._edit(lambda: self.session.edit_points(points, label, kind)))

    def _drawn(self, change: Any) -> None:
        if not self._listening:
            return
        shapes, made = change["new"], self.editor.edit_under_way
        label, points = (made.kind, made.points) if made is not None else ("", None)
        if change["name"] == "cuts":
            self._try(lambda: self._edit(lambda: self.session.edit_cuts(shapes, label)))
        else:
            self._try(lambda: self._edit(lambda: self.session.edit_parts(shapes, label, points=points)))

    def _edited(self, edit: Callable[[], Any]) -> bool:
        """Do an action of one of the smaller widgets; returns whether it could be done."""
        self._try(lambda: self._edit(edit))
        return not self.error

    def _recolour(self, transfer: TransferFunction, is_end: bool) -> None:
        self.volumes.set_transfer(transfer)
        if is_end:
            self._try(lambda: self.session.set_trait("transfer", transfer))

    def _edit(self, edit: Callable[[], Any]) -> None:
        """Edit the session, unless it was done to a picture that another one has replaced meanwhile."""
        self._is_refused = True
        if self._is_late:
            raise DeformError("the picture was being replaced when this was dragged; drag it again on the new one.")
        edit()
        self._is_refused = False

    def _set_in_the_editor(self, change: Any) -> None:
        if change["name"] == "overlay":
            self.diagnostics.soon()
        self.changed()

    def _diagnostics_changed(self) -> None:
        if self.session.deformation is not self._shown[0]:  # stages were chosen for it
            self._show()
        self.changed()

    def _show(self) -> None:
        """Bring the widgets to the state of the session."""
        session, editor = self.session, self.editor
        if session.step.plane is None:
            _choose_a_picture(session)
            session.notice = "Points in space are edited in a studio; here you go on with those of a picture."
        shown, picture = (session.deformation, session.index, session.key), picture_key(session)
        points_of = (session.index, session.key, session.plane)
        self._listening = False  # a notice of the session is no edit
        try:
            if picture != self._pictured:
                editor.waiting = "The picture is being made"  # no gesture shall be made on the old one
            made = session.picture()
            if shown != self._shown:  # first, or the views take the points for those of the map before
                self.link.show(editor)
                self._shown = shown
                self.diagnostics.soon()
            with editor.hold_sync():
                if editor.picture is not made:
                    editor.picture = made
                editor.lone_support = lone_support(session.volume.grid)
                show_step(editor, session)
                editor.history = dict(session.history)
            self._pictured = picture
            if points_of != self._points_of:
                self._points_of, self.pictures = points_of, self.pictures + 1
            if session.transfer_function != self._colours:
                self._colours = session.transfer_function
                self.volumes.set_transfer(self._colours)
            self.parts.refresh()
            if session.plane != self._faced:
                self._faced = session.plane
                if looks_alike(self._own_camera, self.volumes.camera):  # else a user has turned it
                    self._set_camera(*facing(session.plane))
        finally:
            editor.waiting = ""
            self._listening = True

    def _set_camera(self, direction: Any, up: Any) -> None:
        self.volumes.set_camera(direction, up)
        self._own_camera = self.volumes.camera

    def give_up(self) -> None:
        """A client has gone, and with it what its user was about to do: what the session holds is shown."""
        self.link.show(self.editor)
        self.volumes.set_transfer(self._colours)

    def fail(self, message: str) -> None:
        """Report an error in the client; may be called from any thread."""
        def show() -> None:
            self.error = message
            self.changed()

        self.thread.call(show)

    def _notify(self) -> None:
        def show() -> None:
            self.changed()  # looked up when it is called: the bridge may come later

        self.thread.call(show)

    def _show_message(self, text: str) -> None:
        """Show the message of another thread."""
        def show() -> None:
            self.session.notice = text
            self.files.pass_on()
            self.changed()

        self.thread.call(show)

    def close(self) -> None:
        """End the threads; what was not saved stays in the history of who opens the volume again."""
        self.files.close()
        self.recovery.close()
        self.diagnostics.close()
        self.parts.close()
        self.link.close()
        self._previews.close()
        self.volumes.close()
        self.thread.close()


def _choose_a_picture(session: Session) -> None:
    """Edit the last step on a picture, or a new one: the client has no editor for points in space."""
    on_pictures = [k for k, step in enumerate(session.deformation.steps) if step.plane is not None]
    if not on_pictures:
        session.set_view(session.plane)
    elif session.step.plane is None:
        session.edit_step(on_pictures[-1])


def _answer(editor: Any, content: dict[str, Any]) -> None:
    """Confirm a message without doing what it requests: its client waits for that."""
    sender, number = content.get("sender"), content.get("seq")
    if isinstance(sender, str) and len(sender) <= _LONGEST_NAME and isinstance(number, int) and is_whole(number):
        editor.send(EditDone(type="done", sender=sender, seq=number))


def _box_text(session: Session) -> str:
    if session.output is None:
        return ""
    return f"{' × '.join(str(n) for n in session.output.shape[::-1])} voxels (x, y, z)"

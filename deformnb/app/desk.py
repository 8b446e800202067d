"""The model side of the application: a session with the widgets that show it, and no server.

Everything here is called in one thread, the desk's own (:attr:`Desk.thread`), so that an edit that takes a second
never keeps the server from answering.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from deformnb.app.controls import ACTIONS, NUMBERED, control_table
from deformnb.app.remote import RemoteView, dragged
from deformnb.app.trust import DeskTrust
from deformnb.deformation import lone_support
from deformnb.document import to_json
from deformnb.errors import DeformError
from deformnb.plane import Plane
from deformnb.recovery import COMMANDS, Recovery
from deformnb.session import Session
from deformnb.widgets.history_rows import go_to, history_rows
from deformnb.widgets.live_view import LiveView
from deformnb.widgets.point_labels import JOINING, edit_label
from deformnb.widgets.shape_messages import shapes_of
from deformnb.widgets.studio_editors import make_editor, show_step
from deformnb.widgets.studio_link import followed_step
from deformnb.widgets.view import checked_camera
from deformnb.widgets.worker import Worker

_LOG = logging.getLogger(__name__)

_OF_THE_STEP = ("kernel", "trend", "smoothing", "extrusion", "curve", "strength", "stages")
_GLANCE = (0.12, -0.07)  # of the height of the view, as if the mouse had been dragged so far
_OF_THE_EDITOR = ("show_net", "drag_net", "show_radius", "overlay")


class Desk:
    """A session, its picture and its volume.

    Parameters
    ----------
    session : what is edited.
    viewer : "live" or "vtk": who draws the volume.

    Examples
    --------
    >>> from deformnb.datasets.phantoms import PHANTOMS
    >>> desk = Desk(Session(PHANTOMS["bar"].make((12, 8, 16)), view="+y"))
    >>> desk.set("kernel", "gaussian")
    >>> desk.state()["kernel"], desk.state()["undo"]
    ('gaussian', 'change kernel')
    >>> desk.close()
    """

    def __init__(self, session: Session, viewer: str = "live") -> None:
        self.session, self.viewer = session, viewer
        self.controls = control_table(session.volume.grid.diagonal)
        self.thread = Worker("deformnb-desk")
        self.error = ""
        self.milliseconds = 0.0
        self.changed: Callable[[], None] = lambda: None
        self._listening = True
        self._shown: tuple[Any, ...] = ()
        self.remote: RemoteView | None = None
        _choose_a_picture(session)
        self.editor = make_editor(session, 1200)
        self.live = LiveView(session.volume, transfer=session.transfer, background="dark", width=900, height=900)
        self._look(*_beside(session.plane))
        self.editor.observe(self._dragged, "points")
        self.editor.observe(self._drawn, ["cuts", "parts"])
        self.editor.observe(self._set_in_the_editor, list(_OF_THE_EDITOR))
        self.editor.on_history(self.act)
        self.trust = DeskTrust(session, self.editor, self.thread.call, self._trust_changed)
        self.recovery = Recovery(session, self._told, self._tell)
        self.thread.latest("warm up", session.warm_up)
        self._show()

    @property
    def widgets(self) -> dict[str, Any]:
        """The widgets of the page by name."""
        return {"editor": self.editor, "live": self.live}

    # -- what the page asks for ----------------------------------------------------------------------------------------

    def set(self, name: str, value: Any) -> None:
        """Set a control; what is wrong is said in :attr:`error` and nothing changes."""
        control = self.controls.get(name)
        if control is None:
            raise DeformError("there is no such control.")
        self._try(lambda: self._apply(name, control.checked(value)))

    def _apply(self, name: str, value: Any) -> None:
        session = self.session
        if name in _OF_THE_STEP:
            fields: dict[str, Any] = {name: int(value) if name == "stages" else value}
            session.change(kind=name, **fields)
        elif name == "support":
            session.change(kind=name, support=value or None)
        elif name == "view":
            session.set_view(value)
            self._look(*_beside(session.plane))
        elif name == "depth":
            low, high = session.depth_range
            session.depth = low + value * (high - low)
        elif name == "key":
            session.edit_step(session.index, int(value))
        elif name in ("method", "transfer"):
            setattr(session, name, value)
            if name == "transfer":
                self.live.set_transfer(value)
                self._draw(lambda scene: scene.set_transfer(value))
        else:
            self._apply_to_the_view(name, value)

    def _apply_to_the_view(self, name: str, value: Any) -> None:
        """What is no part of the document."""
        if name == "projection":
            self.live.projection = value
            self._draw(lambda scene: scene.set_projection(value))
        elif name == "shows":
            self.live.shows = value
            self._draw(lambda scene: scene.set_shows(value))
        elif name in _OF_THE_EDITOR:
            setattr(self.editor, name, value)
        elif name == "keep_free":
            self.trust.keep_free = value
            if value and self.trust.state()["unsafe"]:
                self.trust.safety.unfold()
        elif name == "show_folds":
            self.live.show_folds = value

    def act(self, name: str, *number: int) -> None:
        """Do one of the actions of :mod:`~deformnb.app.controls` that give nothing back."""
        if name not in (*ACTIONS, *NUMBERED) or name == "save" or len(number) != (name in NUMBERED):
            raise DeformError("there is no such action.")
        actions: dict[str, Callable[[], Any]] = {
            "take_back": self.trust.safety.take_back, "unfold": self.trust.safety.unfold,
            "go_to": lambda: go_to(self.session, *number), "look_at": lambda: self.trust.look_at(*number),
            "undo": self.session.undo, "redo": self.session.redo, "reset": self.session.reset,
            "front": lambda: self._look(*_camera(self.session.plane)),
            "beside": lambda: self._look(*_beside(self.session.plane)),
            **{name: partial(self.recovery.act, name) for name in COMMANDS},
        }
        self._try(actions[name])

    def document(self) -> str:
        """The session as the text of a document that ``deformnb warp`` and ``Session.open`` take."""
        document = self.session.document()
        self.session.saved = document  # the page hands it to the browser's downloads
        return to_json(document)

    def receive(self, name: str, message: dict[str, Any]) -> None:
        """A message of the page for one of the widgets, as its comm would bring it."""
        widget = self.widgets.get(name)
        if widget is None:
            raise DeformError("there is no such widget.")
        widget.comm.handle_msg({"content": {"data": message}, "buffers": []})

    # -- what the page shows -------------------------------------------------------------------------------------------

    def state(self) -> dict[str, Any]:
        """Values of all controls and the texts of the page."""
        session, step = self.session, self.session.step
        labels = session.history
        count, moved = len(session.points), int(session.points.displacement.any(axis=1).sum())
        values = {name: getattr(step, name) for name in _OF_THE_STEP}
        values.update({name: getattr(self.editor, name) for name in _OF_THE_EDITOR})
        states, shown = history_rows(session.history_tree())
        return {
            **values, "curve": step.curve if isinstance(step.curve, str) else "", "support": step.support or 0.0,
            "view": session.view or "", "method": session.method, "key": str(session.key),
            "transfer": session.transfer if isinstance(session.transfer, str) else "",
            "depth": self._depth(), "projection": self.live.projection,
            "shows": self.live.shows, "show_folds": self.live.show_folds, "keep_free": self.trust.keep_free,
            "states": states, "state_shown": states[shown]["id"],
            "undo": labels.get("undo", ""), "redo": labels.get("redo", ""),
            "error": self.error, "notice": session.notice or " ".join(session.notes()),
            "lost": self.recovery.offer, **self.trust.state(),
            "facts": f"{count} points, {moved} moved" + _step_text(session),
            "latency": f"{self.milliseconds:.0f} ms for the last edit" if self.milliseconds else "",
        }

    def _depth(self) -> float:
        """Where the slice lies, 0 in front and 1 at the back."""
        low, high = self.session.depth_range
        return (self.session.depth - low) / (high - low) if high > low else 0.5

    def _try(self, action: Callable[[], Any]) -> None:
        started = time.perf_counter()
        self.error = ""
        try:
            action()
            self._show()
        except DeformError as error:
            self.error = str(error)
            self._show()
        except Exception as error:
            _LOG.exception("an action of the page failed")
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
        self._try(lambda: self.session.edit_points(points, label, kind))

    def _drawn(self, change: Any) -> None:
        if not self._listening:
            return
        shapes, made = shapes_of(change["name"], change["new"]), self.editor.edit_under_way
        edit = self.session.edit_cuts if change["name"] == "cuts" else self.session.edit_parts
        self._try(lambda: edit(shapes, made.kind if made is not None else ""))

    def _set_in_the_editor(self, change: Any) -> None:
        if change["name"] == "overlay":
            self.trust.soon()
        self.changed()

    def _trust_changed(self) -> None:
        if self.session.deformation is not self._shown[0]:  # stages were chosen for it
            self._show()
        self.changed()

    def _show(self) -> None:
        """Bring the widgets to what the session says."""
        session, editor = self.session, self.editor
        self._listening = False  # what the session says is no edit
        try:
            picture = session.picture()
            if editor.picture is not picture:
                editor.picture = picture
            with editor.hold_sync():
                editor.lone_support = lone_support(session.volume.grid)
                show_step(editor, session)
                editor.history = dict(session.history)
        finally:
            self._listening = True
        shown = (session.deformation, session.index, session.key)
        if shown != self._shown:
            self._shown = shown
            self._show_volume()
            self.trust.soon()

    def _show_volume(self) -> None:
        session, live = self.session, self.live
        field = session.field()
        if session.index == followed_step(session.deformation):
            live.follow(self.editor, field, session.key)
        else:
            live.follow(None, field)  # what is dragged passes through the others, in Python
        self._draw(lambda scene: scene.set_field(field))

    def _look(self, direction: Any, up: Any) -> None:
        self.live.set_camera(direction, up)
        if self.remote is not None:
            self.remote.set_camera(direction, up)

    def _draw(self, change: Callable[[Any], None]) -> None:
        """Change the scene that VTK draws, if there is one."""
        if self.remote is not None:
            self.remote.change(change)

    def make_scene(self, size: tuple[int, int]) -> Any:
        """What is shown now as a scene of VTK; called in the scene's thread."""
        from deformnb.widgets.vtk_scene import VtkScene

        scene = VtkScene(self.session.volume, size, transfer=self.session.transfer, projection=self.live.projection,
                         background=self.live.background)
        scene.set_field(self.session.field())
        scene.set_shows(self.live.shows)
        return scene

    def fail(self, message: str) -> None:
        """Say in the page what is wrong; may be called from any thread."""
        def tell() -> None:
            self.error = message
            self.changed()

        self.thread.call(tell)

    def _tell(self) -> None:
        def tell() -> None:
            self.changed()  # looked up when it is called: the bridge may come later

        self.thread.call(tell)

    def _told(self, text: str) -> None:
        """What is said from another thread."""
        def tell() -> None:
            self.session.notice = text
            self.changed()

        self.thread.call(tell)

    def close(self) -> None:
        """End the threads; what was not saved is offered to who opens the volume again."""
        self.recovery.close(orderly=False)
        self.trust.close()
        if self.remote is not None:
            self.remote.close()
        self.thread.close()


def _choose_a_picture(session: Session) -> None:
    """Edit the last step on a picture, or a new one: the page has no editor for points in space."""
    on_pictures = [k for k, step in enumerate(session.deformation.steps) if step.plane is not None]
    if not on_pictures:
        session.set_view(session.plane)
    elif session.step.plane is None:
        session.edit_step(on_pictures[-1])


def _camera(plane: Plane) -> tuple[tuple[float, ...], tuple[float, ...]]:
    return tuple(plane.normal), tuple(-c for c in plane.v)


def _beside(plane: Plane) -> tuple[list[float], list[float]]:
    """Nearly as the picture is seen, but turned a little, so that the depth shows."""
    direction, up = _camera(plane)
    camera = dragged(checked_camera({"direction": direction, "up": up}), "turn", *_GLANCE, 1.0)
    return camera["direction"], camera["up"]


def _step_text(session: Session) -> str:
    count = len(session.deformation.steps)
    return f" · picture {session.index + 1} of {count}" if count > 1 else ""

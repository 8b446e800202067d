"""The editor: control points dragged on a picture that follows them while the mouse moves.

The page fits the points and warps the picture itself, by the same mathematics as :func:`deformnb.rbf.fit_rbf`, so a
drag needs no kernel. The kernel gets the points at the end of an edit, and during a drag only if a callback asked.

Messages by the page:

- ``{"type": "edit", "sender": id, "seq": n, "phase": "move" | "end", "kind": "add", "joins": false, "next_id": n,
  "points": [...]}``
- ``{"type": "history", "sender": id, "seq": n, "way": "undo" | "redo"}``

Messages to the page: ``{"type": "done", "sender": id, "seq": n}`` after the callbacks, and
``{"type": "error", "message": text}``.

Points go to Python by these messages alone and to the page by the trait alone; the trait ``seen`` tells each window
which of its messages the points include (see sender.js).
"""

from __future__ import annotations

import logging
import threading
import uuid
from collections.abc import Callable
from typing import Any

import anywidget
import numpy as np
import traitlets

from deformnb.control_points import ControlPoints
from deformnb.deformation import Step
from deformnb.degenerate import default_support
from deformnb.errors import DeformError
from deformnb.kernels import kernel_named
from deformnb.picture import Picture
from deformnb.plane import Raster
from deformnb.rbf import RBFInterpolant, fit_rbf
from deformnb.trend import trend_named
from deformnb.widgets.assets import joined, style
from deformnb.widgets.editor_pictures import picture_png, preview_png, raster_json, sheet
from deformnb.widgets.point_messages import (
    EditMessage,
    HistoryMessage,
    Message,
    RefusedMessage,
    checked_state,
    message_from_page,
    points_to_json,
)
from deformnb.widgets.static_picture import with_png

_FILES = ("rbf_solve.js", "rbf.js", "link.js", "maps.js", "edits.js", "sender.js", "elements.js", "paint.js",
          "handles.js", "toolbar.js", "gestures.js", "editor_drawing.js", "editor.js")

_LOG = logging.getLogger(__name__)

# Without a trend one point alone has no reach of its own: a quarter of the picture is a bump one can see and grab.
_LONE_POINT_SHARE = 0.25

# Windows that have shown an editor and may still have an edit on its way.
_WINDOWS = 8

EditCallback = Callable[[ControlPoints, str], None]
"""Called with the points and "move" or "end"."""

DetailCallback = Callable[[EditMessage], None]
"""Called with all that the page says of an edit."""

HistoryCallback = Callable[[str], None]
"""Called with "undo" or "redo"."""


class _PointsTrait(traitlets.TraitType[ControlPoints, ControlPoints]):
    """Control points of a picture; in the page a plain list."""

    info_text = "control points of dimension 2"

    def validate(self, obj: Any, value: Any) -> ControlPoints:
        if not isinstance(value, ControlPoints):
            raise DeformError(f"the points of an editor must be ControlPoints, got {type(value).__name__}.")
        if value.dim != 2:
            raise DeformError("an editor shows points on a picture, with two coordinates; these lie in space.")
        return value


class Editor(anywidget.AnyWidget):
    """Control points on a picture, dragged in the page.

    Parameters
    ----------
    picture : what is seen behind the points; None for an empty sheet.
    points : control points in the picture's coordinates; default is none.
    raster : where an empty sheet lies; default is the box of the points with some air.
    kernel, support, trend, smoothing, strength : of the fit, as in :class:`~deformnb.deformation.Step`.
    density : cells of the grid along the longer side of the picture; 0 for no grid.
    show_net, show_radius : whether the grid and the reach of the points are drawn.
    height : largest height of the picture in CSS pixels; the editor is as wide as its place, and lower in a narrow one.
    theme : "auto" follows the page, "light" and "dark" do not.
    label : what a screen reader calls the picture.
    read_only : True shows points that cannot be changed.
    lone_support : reach of a single point without trend; default is a quarter of the picture's diagonal.

    Notes
    -----
    ``points`` is a trait: ``editor.observe(f, "points")`` calls f after every edit, ``editor.points = ...`` shows
    others. While f runs for an edit of the page, ``edit_under_way`` says what was done; it is None where code did it.
    ``selected`` holds the ids of the selected points. ``history`` is {} where the page keeps an undo of its
    own. Whoever keeps one in Python sets it to ``{"undo": "move nose", "redo": ""}``: what would be undone and redone,
    "" for nothing; :meth:`on_history` then tells what the page asks for. ``waiting`` is "" or says what is being made,
    such as another picture: while it is not empty the page dims the picture, shows that text over it and takes no edit
    and no undo; a drag under way is given up. An edit sent just before may still come. ``uid`` names the
    editor in its page, where other widgets find its live points without the kernel (see link.js).

    Raises
    ------
    DeformError
        For points in space, an unknown name, or a setting that is no sensible number.

    Examples
    --------
    >>> editor = Editor(None, ControlPoints.from_arrays([[0, 0], [40, 0], [0, 30]], [[0, 0], [50, 0], [0, 30]]))
    >>> editor.points = editor.points.move(2, [5, 33])
    >>> bool(abs(editor.fit().displacement([5.0, 33.0]) - [-5.0, -3.0]).max() < 1e-12)
    True
    """

    _esm = joined(*_FILES)
    _css = style("editor.css")

    points = _PointsTrait(ControlPoints.empty()).tag(
        sync=True, to_json=lambda value, widget: points_to_json(value))
    next_id = traitlets.Int(0).tag(sync=True)
    seen = traitlets.Dict(help="the last message of each window that the points include").tag(sync=True)
    history = traitlets.Dict(help="what Python would undo and redo; empty if the page does").tag(sync=True)
    selected = traitlets.List(traitlets.Int()).tag(sync=True)
    kernel = traitlets.Unicode("wendland_c2").tag(sync=True)
    support = traitlets.Float(None, allow_none=True).tag(sync=True)
    trend = traitlets.Unicode("affine").tag(sync=True)
    smoothing = traitlets.Float(0.0).tag(sync=True)
    strength = traitlets.Float(1.0).tag(sync=True)
    lone_support = traitlets.Float(1.0).tag(sync=True)
    density = traitlets.Int(16, min=0, max=64).tag(sync=True)
    show_net = traitlets.Bool(True).tag(sync=True)
    show_radius = traitlets.Bool(False).tag(sync=True)
    height = traitlets.Int(560, min=120, max=4096).tag(sync=True)
    theme = traitlets.Enum(["auto", "light", "dark"], "auto").tag(sync=True)
    label = traitlets.Unicode("Picture").tag(sync=True)
    read_only = traitlets.Bool(False).tag(sync=True)
    waiting = traitlets.Unicode("", help="what the page waits for; nothing is edited meanwhile").tag(sync=True)
    live = traitlets.Bool(False, help="whether the page reports every movement").tag(sync=True)
    uid = traitlets.Unicode().tag(sync=True)
    raster = traitlets.Dict().tag(sync=True)
    image = traitlets.Bytes(b"", help="the picture as PNG").tag(sync=True)

    def __init__(self, picture: Picture | None = None, points: ControlPoints | None = None, *,
                 raster: Raster | None = None, **settings: Any) -> None:
        given = ControlPoints.empty() if points is None else points
        self._callbacks: list[tuple[Callable[..., None], bool]] = []
        self._history_callbacks: list[HistoryCallback] = []
        self.edit_under_way: EditMessage | None = None  # for observers of "points": what the page did, None for code
        self._sending = threading.RLock()
        self._previous: RBFInterpolant | None = None
        self._picture = picture
        super().__init__(points=given, uid=uuid.uuid4().hex, **{**_of_picture(picture, raster, given), **settings})
        self.on_msg(self._received)

    # ---- what is shown ----------------------------------------------------------------------------------------------

    @property
    def picture(self) -> Picture | None:
        """What is seen behind the points; setting another one keeps the points."""
        return self._picture

    @picture.setter
    def picture(self, picture: Picture | None) -> None:
        traits = _of_picture(picture, None, self.points)
        self._picture = picture
        with self.hold_sync():  # both in one message: a picture must never meet another one's raster
            for name, value in traits.items():
                setattr(self, name, value)

    def fit(self) -> RBFInterpolant:
        """The fit of the points as the core makes it: the displacement that the page shows.

        Raises
        ------
        DeformError
            If the points cannot be fitted; the page shows the same message.
        """
        points = self.points
        fit = fit_rbf(points if self.strength == 1 else points.blended(self.strength), kernel=self.kernel,
                      support=self.support or default_support(points) or self.lone_support, trend=self.trend,
                      smoothing=self.smoothing, previous=self._previous)
        self._previous = fit
        return fit

    def step(self, **options: Any) -> Step:
        """The points and settings as a step of a :class:`~deformnb.deformation.Deformation`.

        Parameters
        ----------
        options : further fields of the step, such as its rule of extrusion.
        """
        if self._picture is None:
            raise DeformError("an editor without a picture has no plane in space; give it a picture.")
        return Step((self.points,), self._picture.plane, kernel=self.kernel, support=self.support, trend=self.trend,
                    smoothing=self.smoothing, strength=self.strength, **options)

    def preview_png(self) -> bytes:
        """The deformed picture with its grid and points as a PNG: what is seen where no front end runs."""
        picture = self._picture or sheet(self.points)
        return preview_png(picture, self.points, self.fit(), self.density if self.show_net else 0)

    # ---- edits ------------------------------------------------------------------------------------------------------

    def on_edit(self, callback: EditCallback | DetailCallback, remove: bool = False, *, details: bool = False) -> None:
        """Call ``callback(points, phase)`` while points are dragged ("move") and after each edit ("end").

        During a drag ``editor.points`` stays as it was; only the callback sees the points on their way. A drag that is
        given up ends with a "move" back to where it began. Exceptions of the callback are logged and shown in the page.

        Parameters
        ----------
        callback : what is called, in the order of registration.
        remove : True takes the callback away again.
        details : True calls ``callback(edit)`` instead, with an
            :class:`~deformnb.widgets.point_messages.EditMessage`: ``points``, ``phase``, what was done (``kind``) and
            whether it goes on with the edit before it (``joins``).
        """
        if remove:
            self._callbacks = [held for held in self._callbacks if held[0] != callback]
        else:
            self._callbacks.append((callback, details))
        self.live = bool(self._callbacks)

    def on_history(self, callback: HistoryCallback, remove: bool = False) -> None:
        """Call ``callback("undo")`` or ``callback("redo")`` when the page asks, if ``history`` is not empty.

        Exceptions of the callback are logged and shown in the page.
        """
        if remove:
            self._history_callbacks.remove(callback)
        else:
            self._history_callbacks.append(callback)

    def _received(self, _widget: Any, content: Any, _buffers: Any) -> None:
        message = message_from_page(content, self.next_id)
        if message is None:
            return
        try:
            self._take(message)
        except Exception as error:  # of anyone's callback or observer: it must not end the conversation with the page
            _LOG.exception("a callback of an editor failed")
            self.send({"type": "error", "message": f"{type(error).__name__} in a callback: {error}"})
        finally:
            self._note(message)  # whatever came of it: a page that waits for it takes no other points
            self.send({"type": "done", "sender": message.sender, "seq": message.seq})

    def _take(self, message: Message) -> None:
        if isinstance(message, RefusedMessage):
            self.send({"type": "error", "message": f"Python did not take these points: {message.reason}"})
        elif isinstance(message, HistoryMessage):
            for step in tuple(self._history_callbacks):
                step(message.way)
        elif isinstance(message, EditMessage) and message.seq > self.seen.get(message.sender, -1):
            if message.phase == "end":
                self.edit_under_way = message
                try:
                    self.points = message.points
                finally:
                    self.edit_under_way = None
                self._note(message)
            for callback, details in tuple(self._callbacks):
                callback(message) if details else callback(message.points, message.phase)

    def _note(self, message: Message) -> None:
        # After the points and not together with them: until the page reads this it leaves the points alone, and two
        # updates in order need no pause of all others (hold_sync), which threads would take from one another.
        if message.seq <= self.seen.get(message.sender, -1) or _is_movement(message):
            return
        others = [(sender, seq) for sender, seq in self.seen.items() if sender != message.sender]
        self.seen = dict([*others, (message.sender, message.seq)][-_WINDOWS:])

    def send_state(self, key: Any = None) -> None:
        """Tell the page of traits; what is told last is what holds, whichever thread told it."""
        with self._sending:
            super().send_state(key)

    def set_state(self, sync_data: Any) -> None:
        """Take what the page says of its traits, as far as it is right."""
        state = checked_state(sync_data)
        if state:
            super().set_state(state)

    # ---- traits -----------------------------------------------------------------------------------------------------

    @traitlets.observe("points")
    def _ids_never_come_back(self, change: Any) -> None:
        self.next_id = max(self.next_id, change["new"].next_id)

    @traitlets.validate("kernel", "trend")
    def _known(self, proposal: Any) -> str:
        check = {"kernel": kernel_named, "trend": trend_named}[proposal["trait"].name]
        check(proposal["value"])
        return str(proposal["value"])

    @traitlets.validate("support", "lone_support")
    def _a_length(self, proposal: Any) -> float | None:
        value = proposal["value"]
        if value is not None and not (np.isfinite(value) and value > 0):
            raise DeformError(f"the support radius must be a positive length, got {value}.")
        return None if value is None else float(value)

    @traitlets.validate("history")
    def _two_texts(self, proposal: Any) -> dict[str, str]:
        value = dict(proposal["value"])
        if value and (set(value) != {"undo", "redo"} or not all(isinstance(v, str) for v in value.values())):
            raise DeformError(f'the history must be {{}} or texts for "undo" and "redo", got {value}.')
        return value

    @traitlets.validate("smoothing", "strength")
    def _a_number(self, proposal: Any) -> float:
        name, value = proposal["trait"].name, proposal["value"]
        if not np.isfinite(value) or (name == "smoothing" and value < 0):
            allowed = "0 or a positive number" if name == "smoothing" else "a finite number"
            raise DeformError(f"{name} must be {allowed}, got {value}.")
        return float(value)

    # ---- display ----------------------------------------------------------------------------------------------------

    def __repr__(self) -> str:
        if self._picture is None:
            return f"Editor({len(self.points)} points, no picture)"
        nv, nu = self._picture.raster.shape
        return f"Editor({len(self.points)} points, picture of {nu} x {nv})"

    def _repr_mimebundle_(self, **options: Any) -> Any:
        return with_png(super()._repr_mimebundle_(**options), self.preview_png)


def _is_movement(message: Message) -> bool:
    return isinstance(message, EditMessage) and message.phase == "move"


def _of_picture(picture: Picture | None, raster: Raster | None, points: ControlPoints) -> dict[str, Any]:
    """The traits that follow from a picture, or from an empty sheet."""
    where = picture.raster if picture is not None else raster or sheet(points).raster
    image, channels = (b"", 1) if picture is None else picture_png(picture)
    return {"image": image, "raster": raster_json(where, channels), "lone_support": _LONE_POINT_SHARE * where.diagonal}

"""Base of the editors of control points: points and their settings, callbacks, and messages with the front end.

The messages of both sides are in :mod:`deformnb.widgets.messages`.
Points go to Python by these messages alone and to the front end by the trait alone; the trait ``seen`` gives each
window the number of its last message that the points include (see ``js/sync/edits.js``).

Further traits store the pointer settings of a front end: its mirror, its grid, its brush.
"""

from __future__ import annotations

import logging
import math
import uuid
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import traitlets
from msgspec import structs

from deformnb.checks import check_window
from deformnb.errors import DeformError
from deformnb.rbf.fit_settings import SETTINGS, FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.support import CHOOSE_SUPPORT
from deformnb.widgets.kernel_table import table_for_client
from deformnb.widgets.messages.editors import (
    EDITOR,
    EditDone,
    EditRefused,
    FromWindow,
    Greeting,
    HistoryRequest,
    PointsEdit,
    ShapeChoice,
    ShapesEdit,
)
from deformnb.widgets.messages.points import points_to_json
from deformnb.widgets.messages.record import Channel, Refused
from deformnb.widgets.messages.shapes import place_of, shapes_to_json, track_index
from deformnb.widgets.messages.traits import checked_state
from deformnb.widgets.synced import SyncedWidget


def _flat_mirror(value: Any) -> None:
    _mirror(value, ("a", "b"))


def _space_mirror(value: Any) -> None:
    _mirror(value, ("x", "y", "z"))


def _mirror(value: Any, axes: tuple[str, ...]) -> None:
    keys = {"on", "axis", "at"}
    if not isinstance(value, dict) or set(value) != keys:
        raise DeformError(
            f'the mirror must have "on", "axis" and "at", such as {{"on": True, "axis": "{axes[0]}", '
            f'"at": None}}; got {value!r:.80}.'
        )
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


def _window(value: Any) -> None:
    if value != []:
        check_window(value)


def _number(value: Any) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**31:
        raise DeformError(f"it must be a whole number from 0, got {value!r:.40}.")


def _slice_number(value: Any) -> None:
    if value not in (-1, 0, 1, 2) or isinstance(value, bool):
        raise DeformError(f"it must be the number of one of three slices, or -1 for none, got {value!r:.40}.")


FRONT_END_TRAITS: dict[str, Callable[[Any], None]] = {
    "mirror": _flat_mirror,
    "snap": _length,
    "brush_radius": _length,
    "stop_at_folds": _switch,
    "front_only": _switch,
    "window": _window,
    "slice": _number,
}
"""Check of each of these traits; it raises :class:`~deformnb.errors.DeformError` with the reason."""

SPACE_TRAITS: dict[str, Callable[[Any], None]] = {
    "mirror": _space_mirror,
    "snap": _length,
    "brush_radius": _length,
    "stop_at_folds": _switch,
    "large_slice": _slice_number,
}
"""The same for an editor in space."""


_LOG = logging.getLogger(__name__)

# Windows that have shown an editor and may still have an edit in transit.
_WINDOWS = 8

ShapesCallback = Callable[[ShapesEdit], None]
"""Called with each edit of cuts or rigid parts by the front end."""

EditCallback = Callable[[ControlPoints, str], None]
"""Called with the points and "move" or "end"."""

DetailCallback = Callable[[PointsEdit], None]
"""Called with all that the front end sends of an edit."""

HistoryCallback = Callable[[str], None]
"""Called with "undo" or "redo"."""


class PointsTrait(traitlets.TraitType[ControlPoints, ControlPoints]):
    """Control points of one dimension; in the front end a plain list."""

    def __init__(self, dim: int) -> None:
        super().__init__(ControlPoints.empty(dim))
        self.info_text = f"control points of dimension {dim}"
        self._dim = dim
        self.tag(sync=True, to_json=lambda value, widget: points_to_json(value))

    def validate(self, obj: Any, value: Any) -> ControlPoints:
        if not isinstance(value, ControlPoints):
            raise DeformError(f"the points of an editor must be ControlPoints, got {type(value).__name__}.")
        if value.dim != self._dim and self._dim == 2:
            raise DeformError("an editor shows points on a picture, with two coordinates; these are in space.")
        if value.dim != self._dim:
            raise DeformError("an editor in space needs points with three coordinates; these are on a picture.")
        return value


def _settings_to_json(value: FitSettings, widget: Any) -> dict[str, Any]:
    table = table_for_client(value.kernel)
    return {
        **value.as_dict(),
        "chosen_support": value.chosen_support and value.chosen_support.radius,
        **({"kernel_table": table} if table else {}),
    }


class SettingsTrait(traitlets.TraitType[FitSettings, FitSettings]):
    """Settings of a fit; the front end gets them by name, of the chosen support the radius, and the table of a kernel
    that it has no formula of.
    """

    def __init__(self) -> None:
        super().__init__(FitSettings())
        self.tag(sync=True, to_json=_settings_to_json)

    def validate(self, obj: Any, value: Any) -> FitSettings:
        if not isinstance(value, FitSettings):
            raise DeformError(
                f"the settings of an editor must be FitSettings, got {type(value).__name__}; "
                "editor.change(strength=0.5) changes one of them."
            )
        return value


class EditedPoints(SyncedWidget):
    """Control points, cuts and rigid parts that are edited in the front end.

    ``points`` is a :class:`PointsTrait` of each editor, ``cuts`` and ``parts`` are a
    :class:`~deformnb.widgets.messages.shapes.ShapesTrait`.

    Attributes
    ----------
    settings : of the fit, a :class:`~deformnb.rbf.fit_settings.FitSettings`; each is an attribute too, such as
        ``editor.strength``, and :meth:`change` changes several in one message.
    mirror : ``{"on": bool, "axis": name, "at": number or None}``; an editor in space names other axes.
    snap : step of the lattice to which targets snap, 0 for none.
    front_end_traits : checks of the traits that the front end may change, by name.
    """

    points: Any
    cuts: Any
    parts: Any
    channel: ClassVar[Channel[Any]] = EDITOR
    front_end_traits: Mapping[str, Callable[[Any], None]] = FRONT_END_TRAITS
    chooses_support = True
    """True if the chosen support follows the points; False where a session sets it."""

    next_id = traitlets.Int(0).tag(sync=True)
    mirror = traitlets.Dict({"on": False, "axis": "a", "at": None}).tag(sync=True)
    snap = traitlets.Float(0.0).tag(sync=True)
    seen = traitlets.Dict(help="the last message of each window that the points include").tag(sync=True)
    history = traitlets.Dict(help="what Python would undo and redo; empty if the front end does").tag(sync=True)
    selected = traitlets.List(traitlets.Int()).tag(sync=True)
    chosen_shape = traitlets.Dict(help="the cut or part that is chosen, {} for none").tag(sync=True)
    settings = SettingsTrait()
    lone_support = traitlets.Float(1.0, help="support radius where the points do not determine it").tag(sync=True)
    height = traitlets.Int(560, min=120, max=4096).tag(sync=True)
    theme = traitlets.Enum(["auto", "light", "dark"], "auto").tag(sync=True)
    fill = traitlets.Bool(False, help="take the size of the box around it instead of a height").tag(sync=True)
    label = traitlets.Unicode("Picture").tag(sync=True)
    read_only = traitlets.Bool(False).tag(sync=True)
    waiting = traitlets.Unicode("", help="the work that the front end waits for; no edits meanwhile").tag(sync=True)
    live = traitlets.Bool(False, help="whether the front end reports every movement").tag(sync=True)
    uid = traitlets.Unicode().tag(sync=True)

    def __init__(self, **given: Any) -> None:
        self._callbacks: list[tuple[Callable[..., None], bool]] = []
        self._history_callbacks: list[HistoryCallback] = []
        self._shapes_callbacks: list[ShapesCallback] = []
        self.edit_under_way: Any = None  # for observers: the message that changes a trait, None for code
        self._drawn: dict[str, float] = {}
        own = {name: given.pop(name) for name in SETTINGS if name in given}
        if own:
            given["settings"] = replace(given.get("settings", FitSettings()), **own)
        super().__init__(uid=uuid.uuid4().hex, **given)

    # ---- edits ------------------------------------------------------------------------------------------------------

    def on_edit(self, callback: EditCallback | DetailCallback, remove: bool = False, *, details: bool = False) -> None:
        """Call ``callback(points, phase)`` while points are dragged ("move") and after each edit ("end").

        During a drag ``editor.points`` stays as it was; only the callback gets the intermediate points. A cancelled
        drag ends with a "move" back to where it began. Exceptions of the callback are logged and shown in the front
        end.

        Parameters
        ----------
        callback : functions are called in the order of registration.
        remove : True unregisters the callback.
        details : True calls ``callback(edit)`` instead, with an
            :class:`~deformnb.widgets.messages.editors.PointsEdit`: ``points``, ``phase``, the ``kind`` of edit and
            whether it continues the edit before it (``joins``).
        """
        if remove:
            self._callbacks = [held for held in self._callbacks if held[0] != callback]
        else:
            self._callbacks.append((callback, details))
        self.live = bool(self._callbacks)

    def on_history(self, callback: HistoryCallback, remove: bool = False) -> None:
        """Call ``callback("undo")`` or ``callback("redo")`` when the user requests it, if ``history`` is not empty.

        Exceptions of the callback are logged and shown in the front end.
        """
        if remove:
            self._history_callbacks.remove(callback)
        else:
            self._history_callbacks.append(callback)

    def on_shapes(self, callback: ShapesCallback, remove: bool = False) -> None:
        """Call ``callback(edit)`` after cuts or rigid parts were drawn, changed or removed in the front end.

        ``edit`` is a :class:`~deformnb.widgets.messages.editors.ShapesEdit`: ``what`` ("cuts" or "parts"), ``kind``
        (in words) and ``shapes``. Exceptions of the callback are logged and shown in the front end.
        """
        if remove:
            self._shapes_callbacks.remove(callback)
        else:
            self._shapes_callbacks.append(callback)

    def choose(self, what: str | None, index: int = 0) -> None:
        """Mark a shape in the front end: one of the "cuts" or "parts" by its place in the list; None marks none."""
        self.chosen_shape = {} if what is None else {"what": what, "index": index}

    def take_message(self, message: Any, buffers: Any = ()) -> None:
        try:
            message = _checked_message(message, self.points.dim, self.next_id)
        except DeformError as error:
            _LOG.warning("an edit of %s was dropped: %s", type(self).__name__, error)
            self._refuse(Refused(str(error), {"sender": message.sender, "seq": message.seq}))
            return
        try:
            self._take(message)
        except Exception as error:  # of any callback or observer: it must not end the connection with the front end
            _LOG.exception("a callback of an editor failed")
            self.post(EditRefused(message=f"{type(error).__name__} in a callback: {error}"))
        finally:
            self._note(message)  # also after a refusal: a front end that waits for it takes no other points
            self.post(EditDone(sender=message.sender, seq=message.seq))

    def _refuse(self, refused: Refused) -> None:
        if refused.content:
            self.post(EditRefused(message=f"Python did not take this edit: {refused.reason}"))
            self._note(FromWindow(**refused.content))
            self.post(EditDone(**refused.content))

    def _take(self, message: FromWindow) -> None:
        if isinstance(message, HistoryRequest):
            for step in tuple(self._history_callbacks):
                step(message.way)
        elif isinstance(message, ShapeChoice | ShapesEdit):
            self._take_shapes(message)
        elif isinstance(message, PointsEdit) and message.seq > self.seen.get(message.sender, -1):
            if message.phase == "end":
                self._drawn = _measurements(message.drawn) or self._drawn
                self.edit_under_way = message
                try:
                    if message.fit is not None:
                        self.change(**message.fit.as_dict())
                    self.points = message.points
                finally:
                    self.edit_under_way = None
                self._note(message)
            for callback, details in tuple(self._callbacks):
                callback(message) if details else callback(message.points, message.phase)

    def _take_shapes(self, message: ShapeChoice | ShapesEdit) -> None:
        if isinstance(message, ShapeChoice):
            shapes = [] if message.what is None else shapes_to_json(message.what, getattr(self, message.what))
            place = place_of(message.index, message.shape, shapes)
            self.choose(None if place is None else message.what, place or 0)
        elif message.seq > self.seen.get(message.sender, -1):
            before = getattr(self, message.what)
            self.edit_under_way = message
            try:
                setattr(self, message.what, message.shapes)
                self.points = self.points if message.points is None else message.points
            except DeformError as error:  # of an observer: these shapes are refused
                setattr(self, message.what, before)
                self.post(EditRefused(message=f"Python did not take these {message.what}: {error}"))
                return
            finally:
                self.edit_under_way = None
            self._note(message)
            for callback in tuple(self._shapes_callbacks):
                callback(message)

    def _note(self, message: FromWindow) -> None:
        # After the points and not together with them: until the front end reads this it leaves the points alone, and
        # two updates in order need no pause of all others (hold_sync), which threads would take from one another.
        if message.seq <= self.seen.get(message.sender, -1) or _changes_nothing(message):
            return
        others = [(sender, seq) for sender, seq in self.seen.items() if sender != message.sender]
        self.seen = dict([*others, (message.sender, message.seq)][-_WINDOWS:])

    def set_state(self, sync_data: Any) -> None:
        """Take the trait values that the front end sends, as far as they are right."""
        state = checked_state(sync_data, self.front_end_traits)
        if state:
            super().set_state(state)

    def stats(self) -> dict[str, float]:
        """Measurements of the front end in the last drag that took a moment: ``drag_hz`` and ``picture_ms``.

        The first is how many pictures a second were drawn, the second the median from a movement of the pointer to its
        picture. 0 before the first such drag, and where a front end does not measure.
        """
        return {"drag_hz": self._drawn.get("hz", 0.0), "picture_ms": self._drawn.get("ms", 0.0)}

    def change(self, **settings: Any) -> None:
        """Change settings of the fit, such as ``editor.change(strength=0.5)``.

        Parameters
        ----------
        settings : fields of :class:`~deformnb.rbf.fit_settings.FitSettings`.
        """
        unknown = set(settings) - set(SETTINGS)
        if unknown:
            raise DeformError(f"a fit has no setting {min(unknown)!r}; its settings are {', '.join(SETTINGS)}.")
        self.settings = replace(self.settings, **settings)

    # ---- traits -----------------------------------------------------------------------------------------------------

    @traitlets.observe("points")
    def _raise_next_id(self, change: Any) -> None:
        self.next_id = max(self.next_id, change["new"].next_id)

    @traitlets.observe("points", "settings")
    def _choose_support(self, change: Any) -> None:
        """Choose the support again when points are added, removed or switched, and for other settings."""
        old, new, current = change["old"], change["new"], None
        if change["name"] == "points":
            chosen = self.settings.chosen_support
            is_the_same, current = (
                isinstance(old, ControlPoints) and new.has_same_sources(old),
                chosen and chosen.radius,
            )
        else:
            is_the_same = isinstance(old, FitSettings) and all(
                getattr(old, name) == getattr(new, name) for name in CHOOSE_SUPPORT
            )
        if self.chooses_support and not is_the_same:
            self.settings = self.settings.with_chosen_support([self.points], current)

    @traitlets.validate("lone_support")
    def _a_length(self, proposal: Any) -> float:
        value = proposal["value"]
        if not (math.isfinite(value) and value > 0):
            raise DeformError(f"the support radius must be a positive length, got {value}.")
        return float(value)

    @traitlets.validate("history")
    def _two_texts(self, proposal: Any) -> dict[str, str]:
        value = dict(proposal["value"])
        if value and (set(value) != {"undo", "redo"} or not all(isinstance(v, str) for v in value.values())):
            raise DeformError(f'the history must be {{}} or texts for "undo" and "redo", got {value}.')
        return value

    @traitlets.validate("chosen_shape")
    def _valid_shape(self, proposal: Any) -> dict[str, Any]:
        value = dict(proposal["value"])
        count = len(getattr(self, value["what"])) if value.get("what") in ("cuts", "parts") else 0
        if value and not (set(value) == {"what", "index"} and value["index"] in range(count)):
            raise DeformError(
                'the chosen shape must be {} or {"what": "cuts" or "parts", "index": its place} of one '
                f"that is there, got {value}."
            )
        return value

    @traitlets.observe("cuts", "parts")
    def _follow_the_chosen_shape(self, change: Any) -> None:
        chosen = self.chosen_shape
        if chosen and chosen["what"] == change["name"]:
            place = track_index(change["old"], change["new"], chosen["index"])
            self.choose(None if place is None else chosen["what"], place or 0)

    @traitlets.validate("mirror", "snap")
    def _check_front_end_trait(self, proposal: Any) -> Any:
        self.front_end_traits[proposal["trait"].name](proposal["value"])
        return proposal["value"]


def _setting(name: str) -> property:
    """A setting of the fit as an attribute of an editor."""
    return property(
        lambda editor: getattr(editor.settings, name),
        lambda editor, value: editor.change(**{name: value}),
        doc=f"``settings.{name}``",
    )


for _name in SETTINGS:
    setattr(EditedPoints, _name, _setting(_name))


def _checked_message(message: FromWindow, dim: int, next_id: int) -> FromWindow:
    """The message with points of as many coordinates as the editor's, and no id that was given before."""
    if not isinstance(message, PointsEdit | ShapesEdit) or message.points is None:
        return message
    points = message.points
    if points.dim != dim and len(points):
        raise DeformError(f"its points have {points.dim} coordinates, and not {dim}.")
    points = points if len(points) else ControlPoints.empty(dim)
    least = message.next_id if isinstance(message, PointsEdit) else 0
    return structs.replace(message, points=replace(points, next_id=max(points.next_id, least, next_id)))


def _measurements(drawn: Any) -> dict[str, float]:
    """Measurements of a front end; nothing if they are odd, for no edit is refused for that."""
    given = drawn if isinstance(drawn, dict) else {}
    return {name: float(given[name]) for name in ("hz", "ms") if _is_length(given.get(name)) and 0 <= given[name] < 1e6}


def _changes_nothing(message: FromWindow) -> bool:
    return isinstance(message, Greeting) or (isinstance(message, PointsEdit) and message.phase == "move")

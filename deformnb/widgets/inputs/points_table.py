"""Table of control points: names, switches, locks, coordinates that can be edited.

Python owns the points; the front end requests actions (PointsCommand of :mod:`deformnb.widgets.messages`), each of
which is answered, and sets the trait ``selected``.

Points go to the front end as arrays, and only while the table is visible in one.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any

import numpy as np
import traitlets
from numpy.typing import NDArray

from deformnb.io.landmarks.formats import LONGEST_TABLE
from deformnb.rbf.conditioning import LARGEST_SET
from deformnb.rbf.points import ControlPoints
from deformnb.widgets.bundle import bundle
from deformnb.widgets.edit_messages import LONGEST_MESSAGE
from deformnb.widgets.inputs.base import is_whole
from deformnb.widgets.messages import PointsCommandDone
from deformnb.widgets.synced import SyncedWidget

_LOG = logging.getLogger(__name__)

FIELDS = ("name", "active", "locked", "source", "target", "weight", "radius")
"""Fields of a point that can be edited."""

ACTS = ("cell", "add", "remove", "reset", "lock", "switch", "look", "paste", "undo", "redo", "seen")
"""Actions that a front end may request."""

_LONGEST_VIEW, _VIEWS = 40, 16
_SWITCHES = ("active", "locked")


@dataclass(frozen=True)
class TableAct:
    """Action requested by a user of the table.

    Attributes
    ----------
    what : one of :data:`ACTS`; ids : the points that it is about.
    field, axis : which part of a point a "cell" is, and which coordinate of a place.
    value : True or False of a switch, else the text that was written.
    """

    what: str
    ids: tuple[int, ...]
    field: str
    axis: int
    value: Any


ActCallback = Callable[[TableAct], str | None]
"""Does it and returns a report, or None if it was refused."""


class PointsTable(SyncedWidget):
    """Rows of control points that can be sorted, written into, selected.

    Parameters
    ----------
    traits : ``uid`` of the editor whose drags the rows follow without Python; ``smoothing_on``, whether weights matter;
        ``read_only``.

    Examples
    --------
    >>> table = PointsTable()
    >>> table.show(ControlPoints.from_arrays([[0, 0], [3, 4]], names=["tail", "head"]))
    >>> table.names, len(table.numbers)
    (['tail', 'head'], 112)
    """

    _esm = bundle("points_table.js")
    _css = bundle("points_table.css")

    ids = traitlets.List(traitlets.Int()).tag(sync=True)
    names = traitlets.List(traitlets.Unicode()).tag(sync=True)
    dim = traitlets.Int(2).tag(sync=True)
    flags = traitlets.Bytes(b"", help="of each point: 1 on, 2 locked, 4 suspect").tag(sync=True)
    numbers = traitlets.Bytes(b"", help="float64: source, target, weight, radius, error of each point").tag(sync=True)
    selected = traitlets.List(traitlets.Int()).tag(sync=True)
    uid = traitlets.Unicode("").tag(sync=True)
    smoothing_on = traitlets.Bool(False).tag(sync=True)
    read_only = traitlets.Bool(False).tag(sync=True)

    def __init__(self, **traits: Any) -> None:
        self._callback: ActCallback = lambda act: ""
        self._visibility_callback: Callable[[], None] = lambda: None
        self._seen: dict[str, bool] = {}
        super().__init__(**traits)
        self.on_msg(self._received)

    # -- what is shown -------------------------------------------------------------------------------------------------

    @property
    def is_seen(self) -> bool:
        """True if the table is visible in a front end."""
        return any(self._seen.values())

    def show(
        self, points: ControlPoints, errors: NDArray[np.float64] | None = None, suspects: Collection[int] = ()
    ) -> None:
        """Show these points.

        Parameters
        ----------
        errors : (N,) how far the others miss each of them; NaN where that is not known.
        suspects : ids of those that disagree with their neighbours.
        """
        n, doubted = len(points), set(suspects)
        rows = np.concatenate(
            [
                points.source,
                points.target,
                points.weight[:, None],
                points.radius[:, None],
                np.full((n, 1), np.nan) if errors is None else errors[:, None],
            ],
            axis=1,
        )
        is_suspect = np.array([i in doubted for i in points.ids], dtype=bool)
        flags = points.active * 1 + points.locked * 2 + is_suspect * 4
        with self.hold_sync():
            self.dim = points.dim
            if self.ids != list(points.ids):
                self.ids = list(points.ids)
            if self.names != list(points.names):
                self.names = list(points.names)
            self.flags = flags.astype(np.uint8).tobytes()
            self.numbers = rows.astype("<f8").tobytes()

    # -- messages of the front end -------------------------------------------------------------------------------------

    def on_act(self, callback: ActCallback) -> None:
        """Call ``callback(act)`` when the user requests an action; it returns a message, or None if refused."""
        self._callback = callback

    def on_visible(self, callback: Callable[[], None]) -> None:
        """Call ``callback()`` when the table becomes visible in a front end."""
        self._visibility_callback = callback

    def _received(self, _widget: Any, content: Any, _buffers: Any) -> None:
        envelope = _envelope(content)
        if envelope is None:
            _LOG.warning("a message to a table of points was dropped: %.200r", content)
            return
        view, seq = envelope
        answer: str | None = None
        try:
            act = _checked(content)
            if act is None:
                _LOG.warning("an act in a table of points was dropped: %.200r", content)
            elif act.what == "seen":
                answer = self._take_visibility(view, act.value)
            else:
                answer = self._callback(act)
        except Exception:  # it must not end the conversation with the front end
            _LOG.exception("a callback of a table of points failed")
        finally:
            self.send(PointsCommandDone(type="done", view=view, seq=seq, ok=answer is not None, text=answer or ""))

    def _take_visibility(self, view: str, is_seen: bool) -> str:
        was = self.is_seen
        self._seen.pop(view, None)
        self._seen[view] = is_seen
        while len(self._seen) > _VIEWS:  # a front end that was closed without a word
            del self._seen[next(iter(self._seen))]
        if self.is_seen and not was:
            self._visibility_callback()
        return ""

    def set_state(self, sync_data: Any) -> None:
        """Take the selection, if it is one; the front end owns nothing else."""
        given = sync_data.get("selected") if isinstance(sync_data, dict) else None
        if isinstance(given, list) and len(given) <= LARGEST_SET and all(is_whole(i) and i >= 0 for i in given):
            super().set_state({"selected": given})
        else:
            _LOG.warning("a state of a table of points was dropped: %.80r", sync_data)


def _envelope(content: Any) -> tuple[str, int] | None:
    if not isinstance(content, dict) or content.get("type") != "act":
        return None
    view, seq = content.get("view"), content.get("seq")
    if not isinstance(view, str) or len(view) > _LONGEST_VIEW or not isinstance(seq, int) or not is_whole(seq):
        return None
    return view, seq


def _checked(content: dict[str, Any]) -> TableAct | None:
    """The act of a message, None if anything is wrong with it."""
    what, ids, value = content.get("what"), content.get("ids"), content.get("value")
    field, axis = content.get("field", ""), content.get("axis", 0)
    if what not in ACTS or not isinstance(ids, list) or len(ids) > LARGEST_SET:
        return None
    if not all(is_whole(i) and i >= 0 for i in ids) or not _is_value(what, field, value):
        return None
    if what == "cell" and (field not in FIELDS or len(ids) != 1 or not is_whole(axis) or not 0 <= axis <= 2):
        return None
    if what != "cell" and field != "":
        return None
    return TableAct(what, tuple(ids), field, axis, value)


def _is_value(what: str, field: Any, value: Any) -> bool:
    if what == "seen" or (what == "cell" and field in _SWITCHES):
        return isinstance(value, bool)
    if what == "paste":
        return isinstance(value, str) and len(value) <= LONGEST_TABLE
    if what in ("cell", "add"):
        return isinstance(value, str) and len(json.dumps(value)) <= LONGEST_MESSAGE
    return value is None

"""Table of control points: names, switches, locks, coordinates that can be edited.

Python owns the points; the front end requests actions (PointsCommand of :mod:`deformnb.widgets.messages.inputs`), each
of which is answered, and sets the trait ``selected``.

Points go to the front end as arrays, and only while the table is visible in one.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection
from typing import Any

import numpy as np
import traitlets
from numpy.typing import NDArray

from deformnb.rbf.conditioning import LARGEST_SET
from deformnb.rbf.points import ControlPoints
from deformnb.widgets.bundle import bundle
from deformnb.widgets.inputs.base import is_whole
from deformnb.widgets.messages.inputs import TABLE, PointsCommand, PointsCommandDone
from deformnb.widgets.messages.record import Refused
from deformnb.widgets.synced import SyncedWidget

_LOG = logging.getLogger(__name__)

_VIEWS = 16

ActCallback = Callable[[PointsCommand], str | None]
"""Does it and returns a report, or None if it was refused."""


class PointsTable(SyncedWidget):
    """Rows of control points that can be sorted, written into, selected.

    Parameters
    ----------
    traits : ``uid`` of the editor whose drags the rows follow without Python; ``smoothing_on``, whether weights count;
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
    channel = TABLE

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

    # -- display -------------------------------------------------------------------------------------------------------

    @property
    def is_visible(self) -> bool:
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

    def take_message(self, message: PointsCommand, buffers: Any = ()) -> None:
        report: str | None = None
        try:
            if message.what == "seen":
                report = self._take_visibility(message.view, message.is_on)
            else:
                report = self._callback(message)
        finally:
            self._report(message.view, message.seq, report)

    def _refuse(self, refused: Refused) -> None:
        if refused.content:
            self._report(refused.content["view"], refused.content["seq"], None)

    def _report(self, view: str, seq: int, report: str | None) -> None:
        self.post(PointsCommandDone(view=view, seq=seq, ok=report is not None, text=report or ""))

    def _take_visibility(self, view: str, is_visible: bool) -> str:
        was = self.is_visible
        self._seen.pop(view, None)
        self._seen[view] = is_visible
        while len(self._seen) > _VIEWS:  # a front end that was closed without a word
            del self._seen[next(iter(self._seen))]
        if self.is_visible and not was:
            self._visibility_callback()
        return ""

    def set_state(self, sync_data: Any) -> None:
        """Take the selection, if it is one; the front end owns nothing else."""
        given = sync_data.get("selected") if isinstance(sync_data, dict) else None
        if isinstance(given, list) and len(given) <= LARGEST_SET and all(is_whole(i) and i >= 0 for i in given):
            super().set_state({"selected": given})
        else:
            _LOG.warning("a state of a table of points was dropped: %.80r", sync_data)

"""Base of the small widgets whose value the user changes in the front end: messages, callbacks, checks.

Python sends the contents of the widget in one trait, ``shown``; the front end never writes traits.

The messages are ValueEdit, ValueTaken and ValueRefused of :mod:`deformnb.widgets.messages.inputs`. An error in a
message is shown in the front end, logged, and changes nothing.
"""

from __future__ import annotations

import logging
from abc import ABC, abstractmethod
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import traitlets

from deformnb.errors import DeformError
from deformnb.widgets.messages.inputs import VALUE, ValueEdit, ValueRefused, ValueTaken
from deformnb.widgets.synced import SyncedWidget, ViewMeta

_LOG = logging.getLogger(__name__)

_PAGES = 16  # that are distinguished; an older one has long been closed

InputCallback = Callable[[Any, str], None]
"""Called with the value and "move" or "end"."""


class AbstractEdited(ABC, SyncedWidget, metaclass=ViewMeta):
    """A value that is changed by the user in the front end.

    Notes
    -----
    ``on_edit(callback)`` receives every movement of a drag; the traits change at its end only.
    """

    channel = VALUE

    shown = traitlets.Dict(help="content for the front end").tag(sync=True)
    theme = traitlets.Enum(["auto", "light", "dark"], "auto").tag(sync=True)
    label = traitlets.Unicode("").tag(sync=True)
    read_only = traitlets.Bool(False).tag(sync=True)
    live = traitlets.Bool(False, help="whether the front end reports every movement").tag(sync=True)

    def __init__(self, **traits: Any) -> None:
        self._callbacks: list[InputCallback] = []
        self._seen: dict[str, int] = {}
        super().__init__(**traits)

    @abstractmethod
    def _check_value(self, value: Any) -> Any:
        """Checked value of a message, for callbacks and :meth:`_take`; DeformError for anything wrong."""

    @abstractmethod
    def _take(self, edit: Any) -> Any:
        """Make an edit the value of the traits."""

    @abstractmethod
    def _show(self) -> None:
        """Call :meth:`_set_content` with the content for the front end."""

    def _set_content(self, **shown: Any) -> None:
        # In one trait, for a front end must know of each new value whether its own last edit is in it.
        self.shown = {**shown, "seen": dict(self._seen)}

    def _callback_value(self, edit: Any) -> Any:
        """The value that callbacks get of an edit."""
        return edit

    def on_edit(self, callback: InputCallback, remove: bool = False) -> None:
        """Call ``callback(value, phase)`` while something is dragged ("move") and after each edit ("end").

        During a drag the traits stay as they were; only the callback gets the intermediate value. Exceptions of the
        callback are logged and shown in the front end.
        """
        if remove:
            self._callbacks.remove(callback)
        else:
            self._callbacks.append(callback)
        self.live = bool(self._callbacks)

    def take_message(self, message: ValueEdit, buffers: Any = ()) -> None:
        seq, view, phase = message.seq, message.view, message.phase
        try:
            edit = self._check_value(message.value)
            if phase == "end":
                self._see(view, seq)
                self._take(edit)
            for callback in tuple(self._callbacks):
                callback(self._callback_value(edit), phase)
        except DeformError as error:
            _LOG.warning("an edit of %s was refused: %s", type(self).__name__, error)
            self.post(ValueRefused(view=view, message=str(error)))
        except Exception as error:  # of any callback or observer: it must not end the connection with the front end
            _LOG.exception("a callback of %s failed", type(self).__name__)
            self.post(ValueRefused(view=view, message=f"{type(error).__name__} in a callback: {error}"))
        finally:
            if phase == "end":  # taken or refused: the current content is the answer
                self._see(view, seq)
                self._show()
            self.post(ValueTaken(seq=seq, view=view))

    def _see(self, view: str, seq: int) -> None:
        self._seen.pop(view, None)
        self._seen[view] = seq
        while len(self._seen) > _PAGES:
            del self._seen[next(iter(self._seen))]

    def set_state(self, sync_data: Any) -> None:
        """Take the trait values that the front end sends: only ipywidgets' own count of views."""
        given = sync_data if isinstance(sync_data, dict) else {"": sync_data}
        count = given.get("_view_count")
        if set(given) - {"_view_count"} or not (count is None or (is_whole(count) and count >= 0)):
            _LOG.warning(
                "traits of %s from the front end were dropped: %.80r", type(self).__name__, sorted(map(str, given))
            )
        elif given:
            super().set_state(given)


def is_whole(value: Any) -> bool:
    """Check whether this is a whole number that JavaScript counts exactly."""
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) < 2**53


def is_number(value: Any) -> bool:
    """Check whether this is a finite number of ordinary size."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300


def nodes_from_json(data: Any, fewest: int, most: int) -> tuple[tuple[float, float], ...]:
    """Nodes (x, y) from the front end's list, x not falling.

    >>> nodes_from_json([[0, 1], [2, 0.5]], 2, 9)
    ((0.0, 1.0), (2.0, 0.5))
    """
    if not isinstance(data, list) or not fewest <= len(data) <= most:
        raise DeformError(f"a curve needs a list of {fewest} to {most} nodes.")
    if not all(isinstance(row, list) and len(row) == 2 and all(map(is_number, row)) for row in data):
        raise DeformError("a node of a curve must be two finite numbers.")
    if any(a[0] > b[0] for a, b in pairwise(data)):
        raise DeformError("the nodes of a curve must come from left to right.")
    return tuple((float(x), float(y)) for x, y in data)

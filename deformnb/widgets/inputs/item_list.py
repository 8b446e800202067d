"""List of items with a name, some facts, a switch and buttons: steps, cuts, rigid parts.

Python owns the list; the front end requests actions (RowCommand of :mod:`deformnb.widgets.messages.inputs`), each of
which is answered. A request for an earlier version of the rows is dropped: another row may be at its place now.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import traitlets

from deformnb.errors import DeformError
from deformnb.widgets.bundle import bundle
from deformnb.widgets.messages.inputs import LIST, CommandDone, RowCommand
from deformnb.widgets.messages.record import Refused
from deformnb.widgets.synced import SyncedWidget

COMMANDS = ("rename", "up", "down", "double", "remove")
"""Commands for which a row may have a button."""

ItemCallback = Callable[[str, int, Any], None]
"""Called with "choose", "switch" or one of :data:`COMMANDS`, the row's number, and True, False or a name."""


class ItemList(SyncedWidget):
    """Rows that can be chosen, switched, renamed, moved, duplicated and removed.

    Parameters
    ----------
    columns : headings of name and facts; none is shown without.
    commands : those of :data:`COMMANDS` that a row has buttons and keys for.
    switches : whether rows can be switched on and off.
    label : the accessible name of the list; empty : shown where there is no row.

    Examples
    --------
    >>> items = ItemList(commands=["remove"])
    >>> items.show([{"title": "from the front", "facts": ["5 points"], "on": True}], 0)
    >>> items.on_act(lambda what, index, value: items.show([], -1))
    >>> items._handle_custom_msg({"type": "act", "what": "remove", "index": 0, "version": items.version}, [])
    >>> items.rows
    []
    """

    _esm = bundle("item_list.js")
    _css = bundle("item_list.css")
    channel = LIST

    rows = traitlets.List(traitlets.Dict()).tag(sync=True)
    chosen = traitlets.Int(-1).tag(sync=True)
    version = traitlets.Int(0).tag(sync=True)
    columns = traitlets.List(traitlets.Unicode()).tag(sync=True)
    commands = traitlets.List(traitlets.Enum(COMMANDS), list(COMMANDS)).tag(sync=True)
    switches = traitlets.Bool(True).tag(sync=True)
    label = traitlets.Unicode("List").tag(sync=True)
    empty = traitlets.Unicode("").tag(sync=True)

    def __init__(self, **traits: Any) -> None:
        self._callbacks: list[ItemCallback] = []
        super().__init__(**traits)

    def show(self, rows: Sequence[dict[str, Any]], chosen: int) -> None:
        """Show these rows.

        Parameters
        ----------
        rows : of each ``name``, or ``title`` where it has none; ``facts``, a list of texts; ``on``; a colour as
            ``swatch`` or a letter as ``mark`` in the place of its number, or the letter on the colour; ``tip``;
            ``time`` in seconds since 1970, shown as one more fact; ``indent``, its depth in a tree; ``id``, if
            nothing else identifies it.
        chosen : the row that is marked, -1 for none.
        """
        whole = [{"name": "", "title": "", "facts": [], "swatch": "", "tip": "", "on": True, **row} for row in rows]
        with self.hold_sync():
            if whole != self.rows:
                if [_identity(row) for row in whole] != [_identity(row) for row in self.rows]:
                    self.version += 1
                self.rows = whole
            self.chosen = chosen

    def on_act(self, callback: ItemCallback) -> None:
        """Call ``callback(what, index, value)`` when the user requests an action."""
        self._callbacks.append(callback)

    def take_message(self, message: RowCommand, buffers: Any = ()) -> None:
        try:
            if message.what not in ("choose", "switch", *self.commands):
                raise DeformError(f"its rows have no command {message.what!r}.")
            if message.version == self.version:
                if message.index >= len(self.rows):
                    raise DeformError(f"it has no row {message.index}.")
                value = message.value if message.what in ("switch", "rename") else None
                for callback in tuple(self._callbacks):
                    callback(message.what, message.index, value)
        finally:
            self.post(CommandDone())

    def _refuse(self, refused: Refused) -> None:
        self.post(CommandDone())

    def set_state(self, sync_data: Any) -> None:
        """The front end owns nothing here."""


def _identity(row: dict[str, Any]) -> tuple[Any, ...]:
    """Identity of a row, which distinguishes it from another one at its place."""
    return row.get("name"), row.get("title"), row.get("swatch"), row.get("id")

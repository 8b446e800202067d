"""The history as a list: every state that can be gone to, branches moved in, the one that is shown marked."""

from __future__ import annotations

from typing import Any

import ipywidgets as ipw

from deformnb.history import HistoryNode
from deformnb.recovery import Recovery
from deformnb.session import Session
from deformnb.session_store import SavedSession
from deformnb.widgets.cell_widgets import weakly
from deformnb.widgets.controls import Guard, Panel, prose
from deformnb.widgets.history_rows import go_to, history_rows
from deformnb.widgets.item_list import ItemList

_HINT = "Click on a state to go there. An edit after an undo begins a branch; what was undone stays, indented."


class HistoryPanel(Panel):
    """All states of the document that can be gone to, and what earlier sessions on the volume have left unsaved.

    Attributes
    ----------
    recovery : what knows of earlier sessions; None for none.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((8, 8, 8)))
    >>> panel = HistoryPanel(session, lambda action: action() or True)
    >>> session.change(trend="none")
    >>> panel.refresh()
    >>> [row["title"] for row in panel.items.rows]
    ['the beginning', 'change trend']
    >>> panel.close()
    """

    title = "History"

    def __init__(self, session: Session, guard: Guard) -> None:
        super().__init__(session, guard)
        self.recovery: Recovery | None = None
        self._shown: tuple[tuple[HistoryNode, ...], tuple[SavedSession, ...]] = (), ()
        self._order: list[int] = []
        self._is_seen = True  # until somebody says that another tab is
        self.items = ItemList(label="History", commands=[], switches=False, columns=["What was done", "When"])
        self.items.on_act(self._act)
        self.box = ipw.VBox([self.items, ipw.HTML(prose(_HINT))])
        # Going between equal documents changes nothing else, and refreshes no panel.
        self._heard = weakly(self, HistoryPanel._history_changed, lambda panel: True)
        session.observe(self._heard, "history")
        self.refresh()

    def _history_changed(self, _change: Any) -> None:
        self.refresh()

    def _act(self, what: str, index: int, _value: Any) -> None:
        if what == "choose":
            state = self._order[index]
            self.guard(lambda: go_to(self.session, state, recovery=self.recovery))
            self.refresh()

    def opened(self, is_open: bool) -> None:
        self._is_seen = is_open
        self.refresh()

    def arrange(self) -> None:
        if not self._is_seen:  # hundreds of rows would go to the page after every edit
            return
        nodes = self.session.history_tree(), tuple(self.recovery.earlier if self.recovery is not None else ())
        if nodes == self._shown:
            return
        self._shown = nodes
        rows, shown = history_rows(*nodes)
        self._order = [row["id"] for row in rows]
        self.items.show(rows, shown)

    def close(self) -> None:
        self.session.unobserve(self._heard, "history")

"""Steps panel: choose, name, switch, order, duplicate and delete steps; add one; composition mode; the history.

The history is a list of every state that can be restored, with branches indented and the current one marked.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from deformnb._weak import weakly
from deformnb.document.deformation import Step
from deformnb.session.autosave import Recovery
from deformnb.session.autosave_store import SavedSession
from deformnb.session.history import HistoryNode
from deformnb.session.session import Session
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, row
from deformnb.widgets.inputs.item_list import ItemList
from deformnb.widgets.studio.controls import STEP_COLOURS, Guard, Panel, action_button, button, prose, widget_of
from deformnb.widgets.studio.history_labels import go_to, history_rows

"""Labels of the compositions of steps."""

_HINTS = {
    "compose": "Each step deforms the result of the steps above it.",
    "blend": "The displacements of all steps are added; their order does not matter.",
}
_ALONE = "To continue from another side, choose it over the picture: a second step begins automatically."


class StepsPanel(Panel):
    """All steps of the deformation."""

    title = "Steps"

    def __init__(self, session: Session, guard: Guard) -> None:
        super().__init__(session, guard)
        self.items = ItemList(label="Steps", columns=["Step", "Side", "Points", "On it"])
        self.items.on_act(self._act)
        here = action_button("add_step", lambda: guard(session.steps.add))
        space = button(
            "Add step in space",
            "Deform with points in the volume itself instead of on a picture of it",
            lambda: guard(lambda: session.steps.add(in_space=True)),
        )
        mode = self.add(widget_of("mode"), lambda: session.editing.deformation.mode, session.steps.set_mode)
        self._hint = basic.HTML(layout=basic.layout(flex="1 1 300px", min_width="0"))  # a label would cut long words
        self.box = column(self.items, row(here, space, mode, self._hint))
        self.refresh()

    def _act(self, what: str, index: int, value: Any) -> None:
        session = self.session
        actions: dict[str, Callable[[], None]] = {
            "choose": lambda: session.editing.edit_step(index),
            "switch": lambda: session.steps.set_enabled(index, value),
            "rename": lambda: session.steps.rename(index, value),
            "up": lambda: session.steps.move(index, index - 1),
            "down": lambda: session.steps.move(index, index + 1),
            "double": lambda: session.steps.duplicate(index),
            "remove": lambda: session.steps.remove(index),
        }
        self.guard(actions[what])
        self.refresh()  # a refused value shows its state before

    def arrange(self) -> None:
        session = self.session
        steps = session.editing.deformation.steps
        titles = session.steps.titles()
        rows = [_row(step, k, titles[k], session.steps.side_of(step.plane)) for k, step in enumerate(steps)]
        self.items.show(rows, session.editing.index)
        self._hint.value = prose(_HINTS[session.editing.deformation.mode] if len(steps) > 1 else _ALONE)


def _row(step: Step, k: int, title: str, side: str) -> dict[str, Any]:
    moved = sum(int(np.count_nonzero(m.displacement.any(axis=1))) for m in step.maps)
    points = sum(len(m) for m in step.maps)
    keys = f" in {len(step.maps)} keys" if len(step.maps) > 1 else ""
    return {
        "name": step.name,
        "title": title,
        "on": step.enabled,
        "mark": str(k + 1),
        "swatch": STEP_COLOURS[k % len(STEP_COLOURS)],
        "facts": [side, f"{points}{keys}, {moved} dragged", shapes_words(step)],
        "tip": f"Step {k + 1}, {side}, {moved} of {points} points dragged. Click to edit it; F2 or double-click to "
        "name it",
    }


def shapes_words(step: Step) -> str:
    """Shapes of a step, without its points, in words; empty for none."""
    found = (("cut", step.cuts), ("rigid part", step.parts))
    counts = [(name, sum(shape.enabled for shape in shapes)) for name, shapes in found]
    return ", ".join(f"{count} {name}{'' if count == 1 else 's'}" for name, count in counts if count)


_HINT = "Click on a state to go there. An edit after an undo begins a branch; undone states stay, indented."


class HistoryPanel(Panel):
    """All states of the document that can be restored, and unsaved edits of earlier sessions on the volume.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((8, 8, 8)))
    >>> panel = HistoryPanel(session, lambda action: action() or True)
    >>> session.editing.change(trend="none")
    >>> panel.refresh()
    >>> [row["title"] for row in panel.items.rows]
    ['the beginning', 'change trend']
    >>> panel.close()
    """

    title = "History"

    def __init__(self, session: Session, guard: Guard) -> None:
        super().__init__(session, guard)
        self._recovery: Recovery | None = None
        self._shown: tuple[tuple[HistoryNode, ...], tuple[SavedSession, ...]] = (), ()
        self._order: list[int] = []
        self._is_seen = True  # until it is hidden
        self.items = ItemList(label="History", commands=[], switches=False, columns=["What was done", "When"])
        self.items.on_act(self._act)
        self.box = column(self.items, basic.HTML(prose(_HINT)))
        # Going between equal documents changes nothing else, and refreshes no panel.
        self._observer = weakly(self, HistoryPanel._history_changed, lambda panel: True)
        session.editing.observe(self._observer, "history")
        self.refresh()

    def take_recovery(self, recovery: Recovery) -> None:
        """List what earlier sessions on the volume have left unsaved, too."""
        self._recovery = recovery
        self.refresh()

    def offer_return(self, former: Session, open_session: Callable[[Session], None]) -> None:
        """Offer to open the session of another volume again, as it was left."""
        name = former.volume.name or "the volume before"
        back = button(
            f"Back to {name}",
            f"Open {name} again, with its edits and their history",
            lambda: self.guard(lambda: open_session(former)),
        )
        self.box.children = (back, *self.box.children)

    def _history_changed(self, _change: Any) -> None:
        self.refresh()

    def _act(self, what: str, index: int, _value: Any) -> None:
        if what == "choose":
            state = self._order[index]
            self.guard(lambda: go_to(self.session, state, recovery=self._recovery))
            self.refresh()

    def handle_visibility(self, is_open: bool) -> None:
        self._is_seen = is_open
        self.refresh()

    def arrange(self) -> None:
        if not self._is_seen:  # hundreds of rows would go to the front end after every edit
            return
        nodes = self.session.editing.history_tree(), tuple(self._recovery.earlier if self._recovery is not None else ())
        if nodes == self._shown:
            return
        self._shown = nodes
        rows, shown = history_rows(*nodes)
        self._order = [row["id"] for row in rows]
        self.items.show(rows, shown)

    def close(self) -> None:
        self.session.editing.unobserve(self._observer, "history")

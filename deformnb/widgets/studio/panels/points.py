"""Points panel: the table of the points being edited, with names, switches, locks, coordinates, and possible outliers.

Every change in the table is an edit of the session. Python sends rows only while the table is visible, and computes
leave-one-out errors in the studio's thread, so that an edit waits for neither.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._weak import weakly
from deformnb.errors import DeformError
from deformnb.io.landmarks.formats import parse_number, points_from_csv
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session
from deformnb.widgets.boxes import column
from deformnb.widgets.inputs.points_table import PointsTable
from deformnb.widgets.messages.inputs import PointsCommand
from deformnb.widgets.studio.controls import Guard, Panel
from deformnb.widgets.studio.history_labels import edit_label
from deformnb.widgets.studio.panels.landmarks import LandmarkFiles
from deformnb.widgets.studio.step_diagnostics import diagnostics_of
from deformnb.widgets.worker import Worker

_AXES = {2: ("a", "b"), 3: ("x", "y", "z")}


class PointsPanel(Panel):
    """The points being edited as a table.

    Parameters
    ----------
    editors : ``current`` is the editor of the step being edited, whose selection the table shares; it ``look_at``s.
    worker : the thread in which errors are computed.
    """

    title = "Points"

    def __init__(self, session: Session, guard: Guard, editors: Any, worker: Worker) -> None:
        super().__init__(session, guard)
        self._editors, self._worker = editors, worker
        self._followed: Any = None
        self._shown: ControlPoints | None = None
        self._sent_state: tuple[Any, ...] | None = None
        self._errors: dict[int, float] = {}
        self._suspects: tuple[int, ...] = ()
        self._said = ""
        self._showing = threading.RLock()  # edits come from any thread, errors from the worker
        self._unfollow: Callable[[], None] = lambda: None
        self.table = PointsTable()
        self.table.on_act(self._act)
        self.table.on_visible(self.refresh)
        self.table.observe(weakly(self, PointsPanel._rows_selected, lambda panel: True), "selected")
        self._observer = weakly(self, PointsPanel._points_selected, lambda panel: True)
        self.files = LandmarkFiles(session, guard)
        self.box = column(self.table, self.files.box)
        self.refresh()

    # -- display -------------------------------------------------------------------------------------------------------

    def arrange(self) -> None:
        self._follow(self._editors.current)
        self.table.smoothing_on = self.session.editing.step.smoothing > 0
        if self.table.is_visible:
            self._show()

    def _show(self) -> None:
        with self._showing:
            session = self.session
            state = (session.editing.deformation, session.editing.index, session.editing.key)
            if self._sent_state is None or self._sent_state[0] is not state[0] or self._sent_state[1:] != state[1:]:
                if self._sent_state is None or self._sent_state[1:] != state[1:]:
                    self._errors, self._suspects = {}, ()  # of other points
                self._sent_state = state
                self._worker.latest("point diagnostics", weakly(self, PointsPanel._compute, lambda panel: True))
            if self._shown is not session.editing.points:
                self._shown = session.editing.points
                self._send()

    def _send(self) -> None:
        """Send the points with their errors: those of the edit before until they are computed again."""
        points = self.session.editing.points
        errors = np.array([self._errors.get(point, np.nan) for point in points.ids])
        self.table.show(points, errors, self._suspects)

    def _compute(self) -> None:
        """Compute errors in the studio's thread, where the first request waits and later ones find them done."""
        if not self.table.is_visible:
            self._sent_state = None
            return
        found = diagnostics_of(self.session).quality
        with self._showing:
            self._errors, self._suspects = {}, ()
            if found is not None:
                lengths = np.linalg.norm(found.leave_one_out, axis=1)
                self._errors = dict(zip(found.ids, lengths.tolist(), strict=True))
                self._suspects = tuple(found.suspects)
            self._send()

    # -- the selection -------------------------------------------------------------------------------------------------

    def _follow(self, editor: Any) -> None:
        if editor is self._followed:
            return
        self._unfollow()
        self._followed = editor
        editor.observe(self._observer, "selected")
        self._unfollow = lambda: editor.unobserve(self._observer, "selected")
        self.table.uid = editor.uid
        self.table.selected = list(editor.selected)

    def _points_selected(self, change: Any) -> None:
        self.table.selected = list(change["new"])

    def _rows_selected(self, change: Any) -> None:
        if self._followed is not None and set(self._followed.selected) != set(change["new"]):
            self._followed.selected = list(change["new"])

    # -- actions -------------------------------------------------------------------------------------------------------

    def _act(self, act: PointsCommand) -> str | None:
        self._said = ""
        if act.what in ("undo", "redo"):
            what = getattr(self.session.editing, act.what)()
            return f"{'Undone' if act.what == 'undo' else 'Done again'}: {what}" if what else ""
        return self._said if self.guard(lambda: self._do(act)) else None

    def _do(self, act: PointsCommand) -> None:
        points = self.session.editing.points
        known = [i for i in act.ids if i in set(points.ids)]
        if act.what == "look":
            self._show_point(known)
        elif act.what == "cell" and not known:
            raise DeformError(f"there is no control point {act.ids[0]} any more.")
        elif act.what == "cell":
            self._edit(_with_cell(points, known[0], act))
        elif act.what == "add":
            self._add(act.text)
        elif act.what == "paste":
            self._paste(act.text)
        elif known:
            commands = {"remove": _remove, "reset": _reset, "lock": _lock, "switch": _switch}
            self._edit(commands[act.what](points, known))

    def _edit(self, points: ControlPoints) -> None:
        before = self.session.editing.points
        if points != before:
            self.session.editing.edit_points(points, edit_label(before, points))

    def _show_point(self, ids: list[int]) -> None:
        if ids:
            self._editors.current.selected = ids[:1]
            self._editors.current.look_at(ids[0])

    def _add(self, text: str) -> None:
        points, axes = self.session.editing.points, _AXES[self.session.editing.points.dim]
        words = text.replace(";", " ").replace(",", " ").split()
        if len(words) != len(axes):
            raise DeformError(f"a new point needs {len(axes)} numbers, {', '.join(axes)}; got {len(words)}.")
        place = np.array([parse_number(w, f"{axis} of the new point") for w, axis in zip(words, axes, strict=True)])
        new = points.next_id
        self._edit(points.add(self._source_of(place), place))
        self._editors.current.selected = [new]
        self._said = f"Point {len(points) + 1} added."

    def _source_of(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        """Source of a visible place: a new point there moves nothing."""
        try:
            way = np.asarray(self._editors.current.fit().displacement(place)) / (
                self.session.editing.step.strength or 1.0
            )
        except DeformError:  # nothing is fitted yet
            return place
        if not np.isfinite(way).all():
            raise DeformError("this is a gap: there is nothing to drag. Choose another place.")
        return place + way

    def _paste(self, text: str) -> None:
        before = self.session.editing.points
        read = points_from_csv(text, before)
        held = [i for i in read.changed if before.locked[before.index(i)] and _is_moved(before, read.points, i)]
        if held:
            raise DeformError(f"{before.label(before.index(held[0]))} is locked; unlock it to move it.")
        if read.points != before:
            label = "add points" if read.added and not read.changed else "take points from a text"
            self.session.editing.edit_points(read.points, label)
        self._said = f"{len(read.added)} points added, {len(read.changed)} changed."

    def close(self) -> None:
        self._unfollow()
        self._unfollow = lambda: None


def _is_moved(before: ControlPoints, after: ControlPoints, point: int) -> bool:
    k, j = before.index(point), after.index(point)
    return bool((before.source[k] != after.source[j]).any() or (before.target[k] != after.target[j]).any())


def _with_cell(points: ControlPoints, point: int, act: PointsCommand) -> ControlPoints:
    """The points with the new value of one cell."""
    k, field = points.index(point), act.field
    if field == "active":
        return points.edit(point, active=act.is_on)
    if field == "locked":
        return points.edit(point, locked=act.is_on)
    text = act.text.strip()
    if field == "name":
        return points.edit(point, name=text)
    if field == "radius" and not text:
        return points.edit(point, radius=float("nan"))
    if field in ("weight", "radius"):
        number: dict[str, Any] = {field: _parse(text, f"the {field} of {points.label(k)}")}
        return points.edit(point, **number)
    if points.locked[k]:
        raise DeformError(f"{points.label(k)} is locked; unlock it to move it.")
    if act.axis >= points.dim:
        raise DeformError(f"{points.label(k)} has {points.dim} coordinates.")
    place = np.array(getattr(points, field)[k])
    place[act.axis] = _parse(text, f"{field} {_AXES[points.dim][act.axis]} of {points.label(k)}")
    placed: dict[str, Any] = {field: place}
    return points.edit(point, **placed)


def _parse(text: str, what: str) -> float:
    """A number as people write it, with a point or a comma."""
    return parse_number(text.replace(",", ".") if text.count(",") == 1 and "." not in text else text, what)


def _free(points: ControlPoints, ids: list[int], what: str) -> list[int]:
    free = [i for i in ids if not points.locked[points.index(i)]]
    if not free:
        raise DeformError(f"the selection is locked; unlock it to {what} it.")
    return free


def _remove(points: ControlPoints, ids: list[int]) -> ControlPoints:
    return points.remove(*_free(points, ids, "delete"))


def _reset(points: ControlPoints, ids: list[int]) -> ControlPoints:
    chosen, target = np.isin(points.ids, _free(points, ids, "move")), np.array(points.target)
    target[chosen] = points.source[chosen]
    return replace(points, target=target)


def _lock(points: ControlPoints, ids: list[int]) -> ControlPoints:
    return _toggle(points, ids, "locked")


def _switch(points: ControlPoints, ids: list[int]) -> ControlPoints:
    return _toggle(points, ids, "active")


def _toggle(points: ControlPoints, ids: list[int], what: str) -> ControlPoints:
    """Set for all, or if it is for all, for none: one press always does something visible."""
    chosen, flags = np.isin(points.ids, ids), np.array(getattr(points, what))
    flags[chosen] = not flags[chosen].all() if what == "locked" else not flags[chosen].any()
    toggled: dict[str, Any] = {what: flags}
    return replace(points, **toggled)

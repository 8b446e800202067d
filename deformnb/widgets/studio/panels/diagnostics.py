"""Diagnostics panel: figures of the deformation, possible outliers among its points, and actions against folds.

Slow figures are computed in the studio's thread after an edit, the newest first, and never during a drag: Python
receives a drag at its end.
"""

from __future__ import annotations

import html
from collections.abc import Callable
from functools import partial
from typing import Any

import ipywidgets as ipw
import traitlets

from deformnb._weak import weakly
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, line, row
from deformnb.widgets.cell_widgets import close_all
from deformnb.widgets.parameters import ACTIONS
from deformnb.widgets.studio.controls import Guard, Panel, action_button, button, widget_of
from deformnb.widgets.studio.step_diagnostics import (
    Diagnostics,
    Findings,
    StepDiagnostics,
    facts_html,
    look_at_point,
    point_name,
    suspects_of,
)
from deformnb.widgets.worker import Worker

_WAITING = "<i>Computing diagnostics ...</i>"


class DiagnosticsUpdates(Panel):
    """Diagnostics after each edit, in the studio's thread: possible outliers are marked on the picture, seen or not.

    Parameters
    ----------
    editors : ``plane`` is the editor on pictures, ``current`` that of the step being edited.
    worker : the thread for what takes time.

    Attributes
    ----------
    model : computes them; findings : the last ones, None before the first.
    done : called with new findings.
    """

    def __init__(self, session: Session, guard: Guard, editors: Any, worker: Worker) -> None:
        super().__init__(session, guard)
        self._editors, self._worker = editors, worker
        self.model = StepDiagnostics(session)
        self.findings: Findings | None = None
        self.done: Callable[[Findings], None] = lambda _: None
        editors.plane.observe(self.weakly(DiagnosticsUpdates._overlay_changed), "overlay")
        self.refresh()

    def weakly(self, method: Callable[..., Any], owner: Any = None) -> Callable[..., None]:
        """A callback that does nothing once its owner, by default this, is deleted or the thread has ended."""
        worker = self._worker
        return weakly(owner or self, method, lambda _owner: not worker.is_closed)

    def arrange(self) -> None:
        if not self._worker.is_closed:
            self._worker.latest("diagnostics", self.weakly(DiagnosticsUpdates._compute))

    def _compute(self) -> None:
        findings = self.model.compute(self._editors.plane.overlay)
        if findings is None:
            return  # another one waits
        self.findings = findings
        self.done(findings)
        self.model.show(findings, self._editors.current, self._editors.plane)

    def _overlay_changed(self, _change: Any) -> None:
        self.refresh()

    def act(self, action: Callable[[], Any]) -> None:
        """Do something in the thread; its errors are shown in the front end."""
        run = self.weakly(lambda updates: updates.guard(action))
        self.guard(lambda: self._worker.latest("fold action", run))


class DiagnosticsPanel(Panel):
    """Figures of the step being edited, and buttons that make it fold-free.

    Parameters
    ----------
    view : of the volume; its trait ``show_folds``, if it has one, can be switched.
    editors : ``plane`` is the editor on pictures, ``current`` that of the step being edited.
    updates : of the diagnostics.

    Attributes
    ----------
    facts : the figures; suspects : a row of buttons with the possible outliers.
    buttons : by the names of their actions; keep, chosen : the switches next to them.
    """

    title = "Diagnostics"

    def __init__(self, session: Session, guard: Guard, view: Any, editors: Any, updates: DiagnosticsUpdates) -> None:
        super().__init__(session, guard)
        self._editors, self._updates = editors, updates
        self._shown: Diagnostics | None = None
        self._named: list[str] = []
        self.facts = basic.HTML(_WAITING, layout=basic.layout(flex="1.2 1 335px", min_width="0"))
        self.suspects = line(flex_flow="row wrap", align_items="center", grid_gap="0 6px")
        self.message = basic.HTML("", layout=basic.layout(min_width="0"))
        self.overlay = widget_of("overlay")
        self._links = [traitlets.link((editors.plane, "overlay"), (self.overlay, "value"))]
        overlays = [self.overlay]
        if view.has_trait("show_folds"):
            overlays.append(widget_of("show_folds"))
            self._links.append(traitlets.link((view, "show_folds"), (overlays[1], "value")))
        fold_actions = updates.model.fold_actions
        actions = {
            "take_back": fold_actions.take_back,
            "unfold": fold_actions.unfold,
            "best_prediction": fold_actions.predict,
        }
        self.buttons = {name: action_button(name, partial(updates.act, action)) for name, action in actions.items()}
        stages = self.bind_step(widget_of("stages", layout=basic.layout(width="240px"), label="48px"), "stages")
        self.keep, self.chosen = widget_of("keep_free"), widget_of("keep_chosen")
        self.keep.observe(updates.weakly(DiagnosticsPanel._keep_changed, self), "value")
        self.chosen.observe(updates.weakly(DiagnosticsPanel._chosen_changed, self), "value")
        doing = column(
            row(self.buttons["take_back"], self.buttons["unfold"], stages, self.keep),
            row(self.buttons["best_prediction"], self.chosen),
            self.suspects,
            row(*overlays),
            self.message,
            flex="1 1 425px",
            min_width="0",
        )
        self.box = line(self.facts, doing, flex_flow="row wrap", grid_gap="4px 24px")
        updates.done = updates.weakly(DiagnosticsPanel._show, self)
        if updates.findings is not None:
            self._show(updates.findings)
        self.refresh()

    # -- display -------------------------------------------------------------------------------------------------------

    def arrange(self) -> None:
        self.overlay.disabled = self.session.editing.step.plane is None
        if (
            self._shown is not None and self._shown.step is not self.session.editing.step
        ):  # on a busy machine it takes seconds
            self.facts.value = f'<div style="opacity: 0.45">{facts_html(self._shown)}</div>'
            self.message.value = _WAITING
            self._shown = None

    def _show(self, findings: Findings) -> None:
        found = findings.diagnostics
        if self._shown is not found:
            self._shown = found
            self.facts.value = facts_html(found)
            self._show_suspects(found)
        self.message.value = html.escape(findings.reason)

    def _show_suspects(self, found: Diagnostics) -> None:
        points = self.session.editing.points
        text, known = suspects_of(found, points)
        shown = [text, *(point_name(points, i) for i in known)]
        if shown == self._named:
            return
        self._named, old = shown, self.suspects.children
        self.suspects.children = (basic.Label(text), *(self._suspect(points, i) for i in known))
        for widget in old:
            close_all(widget)

    def _suspect(self, points: ControlPoints, point: int) -> ipw.Button:
        return button(
            point_name(points, point),
            ACTIONS["look_at"].tooltip,
            lambda: self.guard(lambda: look_at_point(self._editors.current, point)),
        )

    # -- actions -------------------------------------------------------------------------------------------------------

    def _keep_changed(self, change: Any) -> None:
        model = self._updates.model
        model.keep_free = change["new"]
        if change["new"] and self._shown is not None and self._shown.is_fold_free is False:
            self._updates.act(model.fold_actions.unfold)

    def _chosen_changed(self, change: Any) -> None:
        model = self._updates.model
        model.keep_chosen = change["new"]
        if change["new"]:
            self._updates.act(model.fold_actions.predict)

    def close(self) -> None:
        for link in self._links:
            link.unlink()

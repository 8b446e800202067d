"""Diagnostics panel: figures of the deformation, possible outliers among its points, and actions against folds.

Slow figures are computed in the studio's thread after an edit, the newest first, and never during a drag: Python
receives a drag at its end.
"""

from __future__ import annotations

import html
from collections.abc import Callable
from typing import Any

import ipywidgets as ipw
import traitlets

from deformnb._weak import weakly
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.cell_widgets import close_all
from deformnb.widgets.parameters import ACTIONS
from deformnb.widgets.studio.controls import Guard, Panel, action_button, button, row, widget_of
from deformnb.widgets.studio.step_diagnostics import (
    Diagnostics,
    StepDiagnostics,
    facts_html,
    look_at_point,
    point_name,
    suspects_of,
)
from deformnb.widgets.worker import Worker

_WAITING = "<i>Computing diagnostics ...</i>"


class DiagnosticsPanel(Panel):
    """Figures of the step being edited, and buttons that make it fold-free.

    Parameters
    ----------
    view : of the volume; its trait ``show_folds``, if it has one, can be switched.
    editors : ``plane`` is the editor on pictures, ``current`` that of the step being edited.
    worker : the thread for what takes time.

    Attributes
    ----------
    facts : the figures; suspects : a row of buttons with the possible outliers.
    """

    title = "Diagnostics"

    def __init__(self, session: Session, guard: Guard, view: Any, editors: Any, worker: Worker) -> None:
        super().__init__(session, guard)
        self._view, self._editors, self._worker = view, editors, worker
        self._model = StepDiagnostics(session)
        self._shown: Diagnostics | None = None
        self._named: list[str] = []
        self.facts = basic.HTML(_WAITING, layout=basic.layout(flex="1.2 1 335px", min_width="0"))
        self.suspects = basic.HBox(
            [], layout=basic.layout(flex_flow="row wrap", align_items="center", grid_gap="0 6px")
        )
        self.message = basic.HTML("", layout=basic.layout(min_width="0"))
        doing = basic.VBox(
            [row(*self._fold_buttons()), row(*self._prediction()), self.suspects, row(*self._overlays()), self.message],
            layout=basic.layout(flex="1 1 425px", min_width="0"),
        )
        self.box = basic.HBox([self.facts, doing], layout=basic.layout(flex_flow="row wrap", grid_gap="4px 24px"))
        editors.plane.observe(weakly(self, DiagnosticsPanel._overlay_changed, _open_while(worker)), "overlay")
        self.refresh()

    # -- the parts -----------------------------------------------------------------------------------------------------

    def _fold_buttons(self) -> list[Any]:
        self.back = action_button("take_back", lambda: self._soon(self._model.fold_actions.take_back))
        self.unfold = action_button("unfold", lambda: self._soon(self._model.fold_actions.unfold))
        self.stages = self.of_step(widget_of("stages", layout=basic.layout(width="240px"), label="48px"), "stages")
        self.keep = widget_of("keep_free")
        self.keep.observe(weakly(self, DiagnosticsPanel._keep_changed, _open_while(self._worker)), "value")
        return [self.back, self.unfold, self.stages, self.keep]

    def _prediction(self) -> list[Any]:
        self.predict = action_button("best_prediction", lambda: self._soon(self._model.fold_actions.predict))
        self.chosen = widget_of("keep_chosen")
        self.chosen.observe(weakly(self, DiagnosticsPanel._chosen_changed, _open_while(self._worker)), "value")
        return [self.predict, self.chosen]

    def _overlays(self) -> list[Any]:
        overlay = widget_of("overlay")
        self._links = [traitlets.link((self._editors.plane, "overlay"), (overlay, "value"))]
        self.overlay = overlay
        if not self._view.has_trait("show_folds"):
            return [overlay]
        in_volume = widget_of("show_folds")
        self._links.append(traitlets.link((self._view, "show_folds"), (in_volume, "value")))
        return [overlay, in_volume]

    # -- what is shown -------------------------------------------------------------------------------------------------

    def arrange(self) -> None:
        self.overlay.disabled = self.session.editing.step.plane is None
        if (
            self._shown is not None and self._shown.step is not self.session.editing.step
        ):  # on a busy machine it takes seconds
            self.facts.value = f'<div style="opacity: 0.45">{facts_html(self._shown)}</div>'
            self.message.value = _WAITING
            self._shown = None
        if not self._worker.is_closed:
            self._worker.latest("diagnostics", weakly(self, DiagnosticsPanel._compute, _open_while(self._worker)))

    def _compute(self) -> None:
        findings = self._model.compute(self._editors.plane.overlay)
        if findings is None:
            return  # another one waits
        found = findings.diagnostics
        if self._shown is not found:
            self._shown = found
            self.facts.value = facts_html(found)
            self._show_suspects(found)
        self.message.value = html.escape(findings.reason)
        self._model.show(findings, self._editors.current, self._editors.plane)

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

    # -- the uncertainty overlay ---------------------------------------------------------------------------------------

    def _overlay_changed(self, _change: Any) -> None:
        self.refresh()

    # -- what is done --------------------------------------------------------------------------------------------------

    def _soon(self, action: Callable[[], Any]) -> None:
        """In the thread, its errors in the front end."""
        run = weakly(self, lambda panel: panel.guard(action), _open_while(self._worker))
        self.guard(lambda: self._worker.latest("fold action", run))

    def _keep_changed(self, change: Any) -> None:
        self._model.keep_free = change["new"]
        if change["new"] and self._shown is not None and self._shown.is_fold_free is False:
            self._soon(self._model.fold_actions.unfold)

    def _chosen_changed(self, change: Any) -> None:
        self._model.keep_chosen = change["new"]
        if change["new"]:
            self._soon(self._model.fold_actions.predict)

    def close(self) -> None:
        for link in self._links:
            link.unlink()


def _open_while(worker: Worker) -> Callable[[Any], bool]:
    """Check of a panel, whichever, that its thread has not ended."""
    return lambda _panel: not worker.is_closed

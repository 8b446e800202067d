"""Diagnostics of the map being edited: figures, possible outliers, an uncertainty overlay, cut-off tissue.

The tissue counted as cut off is that which leaves the box. All is computed in a thread of its own after an edit, the
newest first, so that no edit waits for it, and shown by the application's thread.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from functools import partial
from typing import Any

from deformnb.errors import DeformError
from deformnb.session.session import Session
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.studio.panels.files import cut_off_text
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

_LOG = logging.getLogger(__name__)


class ApplicationDiagnostics:
    """Computes the diagnostics of the step that an application edits.

    Parameters
    ----------
    session, editor : the application's.
    later : does something in the application's thread.
    show : called there when the session has changed, or something is to be reported.

    Attributes
    ----------
    model : the diagnostics, which the studio has too.
    """

    def __init__(self, session: Session, editor: Editor, later: Callable[[Callable[[], None]], object],
                 show: Callable[[], None]) -> None:
        self._session, self._editor, self._later, self._show = session, editor, later, show
        self._worker = Worker("deformnb-diagnostics")
        self._found: Diagnostics | None = None
        self._left: tuple[str, ...] = ()  # the sides of the box where tissue leaves it
        self._facts, self._said = "", ""  # the figures as HTML; why there is no uncertainty overlay
        self.model = StepDiagnostics(session)

    def soon(self) -> None:
        """Compute the diagnostics of the session's current state."""
        if not self._worker.is_closed:
            self._worker.latest("diagnostics", self._compute)

    def state(self) -> dict[str, Any]:
        """State that the client shows."""
        found, points = self._found, self._session.points
        text, known = ("", []) if found is None else suspects_of(found, points)
        verdict = [] if found is None else [text for text in (found.folds_text, found.trip_text) if text]
        return {
            "diagnostics": self._facts, "verdict": " \u00b7 ".join(verdict), "uncertainty_said": self._said,
            "folded": found is not None and found.is_folded,
            "cut_off": cut_off_text(self._left),
            "suspects_text": text, "suspects": [{"id": i, "name": point_name(points, i)} for i in known],
        }

    def set_keep_free(self, is_on: bool) -> None:
        """Keep the step fold-free after every edit, from now on."""
        self.model.keep_free = is_on
        if is_on and self._found is not None and self._found.is_fold_free is False:
            self.model.fold_actions.unfold()

    def look_at(self, point: int) -> None:
        """Select a point in the client and bring it to the middle."""
        look_at_point(self._editor, point)

    def close(self) -> None:
        """End the thread."""
        self._worker.close()

    # -- in the thread -------------------------------------------------------------------------------------------------

    def _compute(self) -> None:
        try:
            findings, left = self.model.compute(self._editor.overlay), self._session.exceeded_sides()
            after = self._show if findings is None else partial(self._take, findings, left)
        except Exception as error:  # shown, or the client would wait for its figures for ever
            _LOG.exception("the diagnostics of a step could not be computed")
            after = partial(self._fail, f"{type(error).__name__}: {error}")
        with contextlib.suppress(DeformError):  # the application has been closed
            self._later(after)

    # -- in the application's thread -------------------------------------------------------------------------------

    def _fail(self, text: str) -> None:
        self._found, self._left, self._facts = None, (), ""
        self._session.notice = f"The diagnostics could not be computed: {text}"
        self._show()

    def _take(self, findings: Findings, left: tuple[str, ...]) -> None:
        session, found = self._session, findings.diagnostics
        if found.step is not session.step or found.key != session.key:
            return  # another one comes
        if found is not self._found:
            self._found, self._facts = found, facts_html(found)
        self._left, self._said = left, findings.reason
        self.model.show(findings, self._editor, self._editor)
        self._show()

"""Makes the step that a session edits safe, for the studio's panel and for the application. No widgets here.

What it does is said in the session's notice. It may be called from any thread.
"""

from __future__ import annotations

from dataclasses import replace

from deformnb.control_points import ControlPoints
from deformnb.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.session import Session
from deformnb.trust import LEAST, safe_points, safe_strength, stages_needed
from deformnb.widgets.judgement import Judgement, judgement_of


class Safety:
    """Knows the points of a session when they last did not fold, and the ways back.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((16, 16, 16)), view="+y")
    >>> safety = Safety(session)
    >>> safety.look().folds_text
    'no folds'
    >>> safety.unfold()
    >>> session.notice
    'Nothing folds here.'
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._safe: tuple[int, int, ControlPoints] | None = None  # the last points of a step that did not fold

    def look(self, keep_free: bool = False) -> Judgement | None:
        """Judge the session; None if it has changed meanwhile, so that it must be judged anew.

        Parameters
        ----------
        keep_free : where it folds, choose stages that leave no fold, as part of the edit that folded.
        """
        session = self._session
        deformation = session.deformation
        found = judgement_of(session)
        if session.deformation is not deformation:
            return None
        if found.folds is not None and found.folds.least >= LEAST:
            self._safe = (session.index, session.key, session.points)
        elif keep_free and found.folds is not None and self._kept_free(deformation):
            return None
        return found

    def take_back(self) -> None:
        """The last drag, or else the strength, as far as is safe.

        Raises
        ------
        DeformError
            If that is not at all.
        """
        session, step, grid = self._session, self._session.step, self._session.volume.grid
        start, points = self._start_of_drag(), session.points
        if start is not None:
            made = safe_points(step, start, points, grid, session.key)
            if made is not points:
                session.edit_points(made, "largest safe drag")
                self._tell("The last drag goes as far as is safe now.")
                return
        safe = safe_strength(step, grid)
        if safe == step.strength:
            self._tell("Nothing folds here: the whole drag is safe.")
        elif safe == 0:
            raise DeformError("the map folds however weak it is; the control points, or a shape, ask for too much.")
        else:
            session.change("largest safe strength", strength=safe)
            self._tell(f"The strength is {safe:.2f} now, as much as is safe.")

    def unfold(self) -> None:
        """As few stages as leave no fold.

        Raises
        ------
        DeformError
            If no number of stages does.
        """
        session, step = self._session, self._session.step
        count = stages_needed(step, session.volume.grid)
        if count == step.stages:
            self._tell("Nothing folds here." if count == 1 else f"Nothing folds in {count} stages.")
            return
        session.change("unfold by stages" if count > 1 else "back to one stage", stages=count)
        self._tell(f"Done in {count} stages: nothing folds." if count > 1 else "One stage is enough.")

    def _tell(self, text: str) -> None:
        self._session.notice = ""  # the same words again are said again
        self._session.notice = text

    def _start_of_drag(self) -> ControlPoints | None:
        """The points of this step when it last did not fold, if they are others than now."""
        if self._safe is None or self._safe[:2] != (self._session.index, self._session.key):
            return None
        points = self._safe[2]
        return points if points.dim == self._session.points.dim and points != self._session.points else None

    def _kept_free(self, deformation: Deformation) -> bool:
        """Choose stages that leave no fold, as part of the edit that folded; whether that was done."""
        session = self._session
        index, step = session.index, session.step
        try:
            count = stages_needed(step, session.volume.grid)
        except DeformError as error:
            self._tell(str(error))
            return False
        if count == step.stages:
            return False
        made = deformation.with_step(index, replace(step, stages=count))
        return session.amend(deformation, made, f"Done in {count} stages, so that nothing folds.")

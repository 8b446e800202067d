"""The result of an exercise that follows the studio."""

from __future__ import annotations

from typing import Any

import ipywidgets as ipw

from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.widgets.cell_widgets import runs_for_later_readers
from deformnb_lessons.exercises import AbstractExercise, Result
from deformnb_lessons.studio_tasks import session_of

_HEIGHT = 150  # CSS pixels: a studio below does not jump when the drawing comes


class FollowedResult(ipw.HTML):  # type: ignore[misc]  # ipywidgets has no types
    """Answer of a check of the studio, judged again after each gesture.

    Parameters
    ----------
    exercise : done in the studio.
    studio : the studio, or its session.

    Attributes
    ----------
    result : of the last gesture.

    Raises
    ------
    DeformError
        If it is no studio.

    Examples
    --------
    >>> from deformnb_lessons import LESSONS, lesson_carp, lesson_start
    >>> from deformnb.session.session import Session
    >>> carp = lesson_carp()
    >>> session = Session(carp, lesson_start("fish", carp))
    >>> followed = LESSONS["fish"].follow("antigonia", session)
    >>> followed.result.text
    'Nothing has been dragged yet. Drag the points to where their nodes belong, and check again.'
    """

    result: Result

    def __init__(self, exercise: AbstractExercise, studio: object) -> None:
        session = session_of(studio)
        if session is None:
            raise DeformError(
                f"the result follows a studio, got {short_value(studio)}; run the cell of the studio "
                "first, and give the studio itself."
            )
        super().__init__()
        self.add_class("dnb-followed-result")
        self._exercise, self._session = exercise, session
        session.editing.observe(self._judge, ["deformation", "index"])
        self._judge()

    def _judge(self, _change: Any = None) -> None:
        self.result = self._exercise.judge(self._session)
        drawing = f'<div style="flex: none; width: 230px">{self.result.drawing}</div>' if self.result.drawing else ""
        self.value = (
            f'<div style="display: flex; gap: 12px; align-items: center; min-height: {_HEIGHT}px">'
            f"{self.result.words_html()}{drawing}</div>"
        )  # low, so that the picture below is seen too

    def _repr_mimebundle_(self, **options: Any) -> Any:
        bundle = super()._repr_mimebundle_(**options)
        data = bundle[0] if isinstance(bundle, tuple) else bundle
        if data is not None:  # where a page shows no widgets
            data["text/html"] = self.value
            if runs_for_later_readers():
                data.pop("application/vnd.jupyter.widget-view+json", None)
        return bundle

    def close(self) -> None:
        """Stop following the studio."""
        session = self.__dict__.pop("_session", None)  # ipywidgets closes a half-made widget too, and each one twice
        if session is not None:
            session.editing.unobserve(self._judge, ["deformation", "index"])
        super().close()

"""Which picture a studio's editor stands on, and the making of the next one in the studio's thread."""

from __future__ import annotations

import time
from typing import Any

from deformnb.session import Session
from deformnb.widgets.cell_widgets import weakly
from deformnb.widgets.studio_editors import StudioEditors
from deformnb.widgets.studio_link import StudioLink
from deformnb.widgets.studio_words import StudioWords
from deformnb.widgets.worker import Worker


class StudioPicture:
    """The picture behind the points of the step that is edited.

    Parameters
    ----------
    session : says which picture is wanted; editors : show it.
    link : shows the volume from the side of the picture.
    worker : the thread that makes it.
    words : says what went wrong.

    Attributes
    ----------
    milliseconds : how long the last one took; None until one was made.
    """

    def __init__(self, session: Session, editors: StudioEditors, link: StudioLink, worker: Worker,
                 words: StudioWords) -> None:
        self._session, self._editors, self._link, self._worker, self._words = session, editors, link, worker, words
        self._shown = self._wanted()
        self.milliseconds: float | None = None

    @property
    def is_shown(self) -> bool:
        """Whether the editor shows the picture that the session asks for."""
        return bool(self._shown == self._wanted())

    def ask(self) -> None:
        """Make the picture that is wanted and show it; until then the editor takes no gesture."""
        self._editors.tell(waiting="The picture is being made")
        self._worker.latest("picture", weakly(self, StudioPicture._show, lambda it: not it._worker.is_closed))

    def _wanted(self) -> Any:
        """What the picture depends on: the steps before the one being edited, its plane, and how it is projected."""
        s = self._session
        return (s.index, s.deformation.steps[: s.index], s.step.plane, s.method,
                s.depth if s.method == "slice" else 0.0, s.deformation.mode,
                s.transfer if s.method in ("composite", "shaded") else None)

    def _show(self) -> None:
        wanted = self._wanted()
        self._words.guarded(lambda: self._set(wanted))
        if wanted == self._wanted():
            self._editors.tell(waiting="")

    def _set(self, wanted: Any) -> None:
        start = time.perf_counter()
        made = self._editors.make_picture()
        if self._shown[2] != wanted[2]:
            self._link.turn()
        self._link.show(self._editors.current)
        self._shown = wanted
        self._editors.show_picture(made)
        self.milliseconds = (time.perf_counter() - start) * 1e3

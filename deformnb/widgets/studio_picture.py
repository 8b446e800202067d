"""Which picture a studio's editor stands on, and the making of the next one in the studio's thread."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import ipywidgets as ipw
import numpy as np

from deformnb.session import Session
from deformnb.widgets.cell_widgets import weakly
from deformnb.widgets.controls import button, row
from deformnb.widgets.studio_editors import StudioEditors
from deformnb.widgets.studio_link import StudioLink
from deformnb.widgets.studio_words import as_html, reason_of
from deformnb.widgets.worker import Worker

_MAKING = "The picture is being made"
_FAILED = "The picture could not be made; below it says why"
_STANDS = 1e-6  # of a direction's length: less is a rounding error of the page


def picture_key(session: Session) -> Any:
    """What a picture depends on: the steps before the one being edited, its plane, and how it is projected."""
    s = session
    return (s.index, s.deformation.steps[: s.index], s.step.plane, s.method,
            s.depth if s.method == "slice" else 0.0, s.deformation.mode,
            s.transfer if s.method in ("composite", "shaded") else None)


class StudioPicture:
    """The picture behind the points of the step that is edited.

    Parameters
    ----------
    session : says which picture is wanted; editors : show it.
    link : shows the volume from the side of the picture; view : where.
    worker : the thread that makes it.
    undo : takes back the last edit.

    Attributes
    ----------
    milliseconds : how long the last one took; None until one was made.
    ways_on : why the picture that is wanted cannot be made, and two buttons; unseen while it can.
    """

    def __init__(self, session: Session, editors: StudioEditors, link: StudioLink, view: Any, worker: Worker,
                 undo: Callable[[], None]) -> None:
        self._session, self._editors, self._link, self._view, self._worker = session, editors, link, view, worker
        self._shown = self._wanted()
        self._turned_to: Mapping[str, Any] | None = None
        self.milliseconds: float | None = None
        again = weakly(self, StudioPicture.ask, StudioPicture._is_open)
        self._reason = ipw.HTML("", layout=ipw.Layout(flex="0 1 auto", min_width="0"))
        self.ways_on = row(self._reason, button("Try again", "Make the picture once more", again),
                           button("Undo", "Take back the last edit", undo))
        self.ways_on.layout.display = "none"

    @property
    def is_shown(self) -> bool:
        """Whether the editor shows the picture that the session asks for."""
        return bool(self._shown == self._wanted())

    def renew(self) -> bool:
        """Ask for the picture that the session wants, if it is another than the one that is shown; says whether."""
        if not self.is_shown:
            self.ask()
            return True
        if self._reason.value:  # back from a picture that could not be made to the one that still stands there
            self._settle("")
        return False

    def ask(self) -> None:
        """Make the picture that is wanted and show it; until then the editor takes no gesture."""
        self._editors.tell(waiting=_MAKING)
        self._worker.latest("picture", weakly(self, StudioPicture._show, StudioPicture._is_open))

    def turn(self) -> None:
        """Look at the volume from the side of the picture, unless somebody has turned it to look from elsewhere."""
        if self._turned_to is None or looks_alike(self._turned_to, self._view.camera):
            self._link.turn()
            self._turned_to = dict(self._view.camera)

    def _is_open(self) -> bool:
        return not self._worker.is_closed

    def _wanted(self) -> Any:
        return picture_key(self._session)

    def _show(self) -> None:
        wanted = self._wanted()
        reason = ""
        try:
            self._set(wanted)
        except Exception as error:
            reason = reason_of(error)
        if wanted == self._wanted():  # else another one is asked for by now
            self._settle(reason)

    def _settle(self, reason: str) -> None:
        """Let the editor be used, or say why not: points of one picture on another are worse than none."""
        self._reason.value = as_html(reason, is_error=True)
        self._editors.tell(waiting=_FAILED if reason else "")
        self.ways_on.layout.display = "" if reason else "none"

    def _set(self, wanted: Any) -> None:
        start = time.perf_counter()
        made = self._editors.make_picture()
        if self._shown[2] != wanted[2]:
            self.turn()
        self._link.show(self._editors.current)
        self._editors.show_picture(made)
        self._shown = wanted
        self.milliseconds = (time.perf_counter() - start) * 1e3


def looks_alike(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether two cameras look the same way; how near they stand does not count."""
    return all(np.allclose(one[name], other[name], atol=_STANDS) for name in ("direction", "up", "pan"))

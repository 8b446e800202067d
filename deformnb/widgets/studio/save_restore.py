"""Restore bar of the studio: edits that were lost when a kernel died are offered again.

The bar at the top of the studio offers the edits that were lost when a kernel died, and reports that it has died just
now. Python sends its offer and the time of the last autosave. The front end requests one of three actions
(RestoreCommand of :mod:`deformnb.widgets.messages.inputs`); a request for an earlier offer is dropped. A page that has
outlived its Python names the session that it showed (ResumeRequest), which goes on without a question.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from typing import Any

import traitlets

from deformnb.session.autosave import Recovery
from deformnb.session.session import Session
from deformnb.widgets.bundle import bundle
from deformnb.widgets.messages.inputs import RESTORE, CommandDone, RestoreCommand, ResumeRequest
from deformnb.widgets.messages.record import Refused
from deformnb.widgets.synced import SyncedWidget


class RestoreBar(SyncedWidget):
    """Writes a session after each edit and offers the lost ones on its volume; nothing is seen while there is none.

    Parameters
    ----------
    session : to edit.
    guard : runs an edit and shows what went wrong with it.
    show : shows a text.
    options : of :class:`~deformnb.session.autosave.Autosave`.

    Attributes
    ----------
    offer : the question; written : when the session was last written, for a front end whose kernel has ended.
    session : name of the autosave, empty before the first edit; ready : whether the sessions of earlier processes are
        known, and one can be resumed.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> bar = RestoreBar(Session(PHANTOMS["bar"].make((8, 8, 8))), lambda action: action() is None, str)
    >>> bar.offer
    ''
    >>> bar.close()
    """

    _esm = bundle("restore_bar.js")
    _css = bundle("restore_bar.css")
    channel = RESTORE

    offer = traitlets.Unicode("").tag(sync=True)
    written = traitlets.Unicode("").tag(sync=True)
    session = traitlets.Unicode("").tag(sync=True)
    ready = traitlets.Bool(False).tag(sync=True)
    version = traitlets.Int(0).tag(sync=True)

    def __init__(
        self, session: Session, guard: Callable[[Callable[[], None]], bool], show: Callable[[str], None], **options: Any
    ) -> None:
        self._recovery: Recovery | None = None
        self._showing = threading.RLock()  # the thread that writes shows news as well as that of an edit
        super().__init__()
        self._guard = guard
        self._recovery = Recovery(session, show, _weak_refresh(self), **options)
        self.show()  # offers found before this line

    @property
    def recovery(self) -> Recovery:
        """Recovery, which writes and restores."""
        assert self._recovery is not None
        return self._recovery

    def show(self) -> None:
        """Show the present offers."""
        if self._recovery is None or self.comm is None:
            return
        with self._showing, self.hold_sync():
            if self.offer != self._recovery.offer:
                self.version += 1
                self.offer = self._recovery.offer
            self.written = self._recovery.written
            self.session = self._recovery.name
            self.ready = self._recovery.ready.is_set()

    def take_message(self, message: RestoreCommand | ResumeRequest, buffers: Any = ()) -> None:
        try:
            if isinstance(message, ResumeRequest):
                self._guard(lambda: self._resume(message.session))
            elif message.version == self.version:
                self._guard(lambda: self.recovery.act(message.what))
        finally:
            self.post(CommandDone())

    def _resume(self, session: str) -> None:
        self.recovery.resume_named(session)

    def _refuse(self, refused: Refused) -> None:
        self.post(CommandDone())

    def set_state(self, sync_data: Any) -> None:
        """The front end owns nothing here."""

    def close(self) -> None:
        """End; unsaved edits stay in the history."""
        if self._recovery is not None:
            self._recovery.autosave.close()
        super().close()


def _weak_refresh(bar: RestoreBar) -> Callable[[], None]:
    reference = weakref.ref(bar)

    def show() -> None:
        found = reference()
        if found is not None:
            found.show()

    return show

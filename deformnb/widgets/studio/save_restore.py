"""Restore bar of the studio: edits that were lost when a kernel died are offered again.

The bar at the top of the studio offers the edits that were lost when a kernel died, and reports that it has died just
now. Python sends its offer and the time of the last autosave. The front end requests one of three actions
(RestoreCommand of :mod:`deformnb.widgets.messages`); a request for an earlier offer is dropped.
"""

from __future__ import annotations

import logging
import threading
import weakref
from collections.abc import Callable
from typing import Any

import traitlets

from deformnb.session.autosave import RECOVERY_COMMANDS, Recovery
from deformnb.session.session import Session
from deformnb.widgets.bundle import bundle
from deformnb.widgets.messages import CommandDone
from deformnb.widgets.synced import SyncedWidget

_LOG = logging.getLogger(__name__)


class RestoreBar(SyncedWidget):
    """Writes a session after each edit and offers the lost ones on its volume; nothing is seen while there is none.

    Parameters
    ----------
    session : what is edited.
    guard : runs an edit and shows what went wrong with it.
    show : shows a text.
    options : of :class:`~deformnb.session.autosave.Autosave`.

    Attributes
    ----------
    offer : the question; written : when the session was last written, for a front end whose kernel has gone.

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

    offer = traitlets.Unicode("").tag(sync=True)
    written = traitlets.Unicode("").tag(sync=True)
    version = traitlets.Int(0).tag(sync=True)

    def __init__(
        self, session: Session, guard: Callable[[Callable[[], None]], bool], show: Callable[[str], None], **options: Any
    ) -> None:
        self._recovery: Recovery | None = None
        self._showing = threading.RLock()  # the thread that writes shows news as well as that of an edit
        super().__init__()
        self._guard = guard
        self.on_msg(self._received)
        self._recovery = Recovery(session, show, _weakly_shown(self), **options)
        self.show()  # what was found before this line

    @property
    def recovery(self) -> Recovery:
        """Recovery, which writes and restores."""
        assert self._recovery is not None
        return self._recovery

    def show(self) -> None:
        """Show what is offered now."""
        if self._recovery is None or self.comm is None:
            return
        with self._showing, self.hold_sync():
            if self.offer != self._recovery.offer:
                self.version += 1
                self.offer = self._recovery.offer
            self.written = self._recovery.written

    def _received(self, _widget: Any, content: Any, _buffers: Any) -> None:
        try:
            what = content.get("what") if isinstance(content, dict) and content.get("type") == "act" else None
            if not isinstance(what, str) or what not in RECOVERY_COMMANDS:
                _LOG.warning("a message to the bar of lost sessions was dropped: %.200r", content)
            elif content.get("version") == self.version:
                self._guard(lambda: self.recovery.act(what))
        except Exception:  # it must not end the conversation with the front end
            _LOG.exception("the bar of lost sessions failed")
        finally:
            self.send(CommandDone(type="done"))

    def set_state(self, sync_data: Any) -> None:
        """The front end owns nothing here."""

    def close(self) -> None:
        """End; what was not saved stays in the history."""
        if self._recovery is not None:
            self._recovery.close()
        super().close()


def _weakly_shown(bar: RestoreBar) -> Callable[[], None]:
    reference = weakref.ref(bar)

    def show() -> None:
        found = reference()
        if found is not None:
            found.show()

    return show

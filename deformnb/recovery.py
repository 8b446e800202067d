"""What is offered to who opens a volume on which something was lost, and what becomes of it.

The same for the notebook's studio and the application, which only show it.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any

from deformnb.autosave import Autosave
from deformnb.deformation import VolumeReference
from deformnb.errors import DeformError
from deformnb.session import Session
from deformnb.session_store import SavedSession, counted, delete, moment, restore, saved_sessions, skip, state_folder

COMMANDS = ("restore", "skip", "delete")
"""What can be done with a lost session."""


class Recovery:
    """Writes a session after each edit, and offers the lost ones on its volume one after the other.

    Parameters
    ----------
    session : what is edited.
    say : told of trouble, and of a document that was made on another volume.
    changed : called when there is another offer, or something was written; from any thread.
    options : of :class:`~deformnb.autosave.Autosave`.

    Attributes
    ----------
    autosave : what writes.
    lost : what is offered, the newest first.
    earlier : sessions on the volume that ended by themselves with edits that are in no file, the newest first.
    written : when what is not saved was last written, for people; empty if there is nothing such.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> recovery = Recovery(Session(PHANTOMS["bar"].make((8, 8, 8))))
    >>> recovery.offer
    ''
    >>> recovery.close()
    """

    def __init__(self, session: Session, say: Callable[[str], object] = str, changed: Callable[[], object] = bool,
                 **options: Any) -> None:
        self.session = session
        self.lost: list[SavedSession] = []
        self.earlier: list[SavedSession] = []
        self.written = ""
        self._say, self._changed = say, changed
        self._ready = threading.Event()
        self._differs = session.deformation if session.deformation.volume is not None else None
        self._folder = Path(options.pop("folder", None) or state_folder())
        self.autosave = Autosave(session, self._folder, on_ready=_weakly(self._look), on_written=_weakly(self._note),
                                 on_trouble=say, **options)

    @property
    def offer(self) -> str:
        """What is asked of the user; empty for nothing."""
        lost = self.lost
        if not lost:
            return ""
        older = len(lost) - 1
        more = f" {counted(older, 'older edit')} follow{'s' if older == 1 else ''}." if older else ""
        size = f"{counted(lost[0].points, 'point')}, {counted(lost[0].steps, 'step')}"
        return f"An edit of {moment(lost[0].edited)} was not saved ({size}).{more}"

    def act(self, command: str) -> None:
        """Do one of the :data:`COMMANDS` with what is offered.

        Raises
        ------
        DeformError
            If its file is damaged or gone; it is offered no more then.
        """
        if command not in COMMANDS:
            raise DeformError(f"unknown command {command!r:.40}; choose one of {', '.join(COMMANDS)}.")
        if not self.lost:
            return
        entry = self.lost.pop(0)
        try:
            if command == "restore":
                self._restore(entry)
                self.lost.clear()  # the others are offered the next time: this is what is wanted now
            else:
                (skip if command == "skip" else delete)(entry)
        finally:
            self._changed()

    def _restore(self, entry: SavedSession) -> None:
        document = restore(entry)
        index = entry.index if 0 <= entry.index < len(document.steps) else None
        self.session.edit_document(document, f"restore the edit of {moment(entry.edited)}", index=index)
        self.autosave.replaces(entry)

    def go_back(self, which: int) -> None:
        """Go on with one of the :attr:`earlier` sessions; can be undone.

        Raises
        ------
        DeformError
            If there is no such one, or its file is damaged or gone.
        """
        if not 0 <= which < len(self.earlier):
            raise DeformError("this earlier session is no longer kept.")
        entry = self.earlier[which]
        document = restore(entry)
        index = entry.index if 0 <= entry.index < len(document.steps) else None
        self.session.edit_document(document, f"go back to the edit of {moment(entry.edited)}", index=index)

    def wait(self, timeout: float = 60.0) -> bool:
        """Until it is known what was lost; for scripts and tests."""
        return self._ready.wait(timeout)

    def close(self) -> None:
        """End; see :meth:`Autosave.close <deformnb.autosave.Autosave.close>`."""
        self.autosave.close()

    def _look(self, reference: VolumeReference) -> None:
        try:
            found = saved_sessions(reference, self._folder, every=True)
            self.lost = [entry for entry in found if entry.is_lost]
            self.earlier = [entry for entry in found if entry.is_earlier]
            if self._differs is not None:
                difference, self._differs = self.session.difference(self._differs), None
                if difference:
                    self._say(difference)
        finally:
            self._ready.set()
        if self.lost or self.earlier:
            self._changed()

    def _note(self, entry: SavedSession) -> None:
        written = moment(entry.edited) if entry.state == "open" else ""
        if written != self.written:
            self.written = written
            self._changed()


def _weakly(method: Callable[[Any], None]) -> Callable[[Any], None]:
    """A bound method that does not keep its object: the thread that calls it must not keep a session alive."""
    reference = weakref.WeakMethod(method)

    def call(given: Any) -> None:
        found = reference()
        if found is not None:
            found(given)

    return call

"""Autosave of a session, a second after each edit, into a folder of the user, and recovery from it.

An edit only stores its document here; everything else, the checksum of the volume too, happens in a thread
that holds no reference to the session, and that ends when nothing waits: a session that nobody closes, such as that of
a widget whose variable was deleted, has no thread while nobody edits it. A failure is reported once and never stops an
edit.

Recovery is offered to a user who opens a volume on which something was lost, and records the answer. It is the same for
the notebook's studio and the application, which only show it.
"""

from __future__ import annotations

import atexit
import logging
import os
import secrets
import threading
import time
import weakref
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple, get_args

from deformnb._threads import can_start_threads
from deformnb._typing import RecoveryCommand
from deformnb._weak import weakly
from deformnb.document.deformation import Deformation, VolumeReference
from deformnb.errors import DeformError
from deformnb.io.files.atomic import create_locked, sweep
from deformnb.io.files.paths import as_path
from deformnb.session.autosave_store import (
    SavedSession,
    count_text,
    delete,
    file_name,
    mark,
    moment,
    next_number,
    prune,
    restore,
    saved_sessions,
    skip,
    state_folder,
    write_session,
)
from deformnb.session.editing import Edited
from deformnb.session.session import Session

__all__ = ["Autosave", "SavedSession", "delete", "restore", "saved_sessions", "skip"]

_LOG = logging.getLogger(__name__)

LONGEST_WAIT = 5.0
"""Seconds after the first edit of a row at which it is written though the next comes: as many delays as a default."""

_WATCHED = ["deformation", "index", "key"]
_PATIENCE_AT_EXIT = 3.0
_WAIT_AT_CLOSE = 1.0


class _Snapshot(NamedTuple):
    """Snapshot to be written, as it was after an edit."""

    state: Edited
    edited: datetime


class Autosave:
    """Writer of a session after each edit.

    Parameters
    ----------
    session : to observe; held by a weak reference.
    folder : where to; default is :func:`~deformnb.session.autosave_store.state_folder`.
    delay : seconds after the last edit; after :data:`LONGEST_WAIT` of edits without a pause it is written too.
    on_ready : called once the volume's checksum is known, with what identifies the volume.
    on_written : called with the facts of the written state.
    on_trouble : called with the obstacle, once until it works again.

    Notes
    -----
    The writing thread calls all three.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((8, 8, 8)))
    >>> autosave = Autosave(session)
    >>> session.editing.change(strength=0.5)
    >>> autosave.flush()
    >>> [(entry.state, entry.points) for entry in saved_sessions(session.volume, every=True)]
    [('open', 4)]
    >>> autosave.close()
    True
    """

    def __init__(
        self,
        session: Session,
        folder: str | os.PathLike[str] | None = None,
        delay: float = 1.0,
        *,
        on_ready: Callable[[VolumeReference], None] | None = None,
        on_written: Callable[[SavedSession], None] | None = None,
        on_trouble: Callable[[str], object] | None = None,
    ) -> None:
        folder = as_path(folder) if folder is not None else state_folder()
        self._job = job = _Job(
            session.editing.state, session.files.reference, folder, delay, _Reports(on_ready, on_written, on_trouble)
        )
        self._session = weakref.ref(session)
        session.editing.observe(job.note_edit, _WATCHED)
        session.files.observe(job.note_saved, "saved")
        _OPEN.add(job)
        job.start()
        weakref.finalize(session, job.end).atexit = False

    @property
    def path(self) -> Path | None:
        """The session's file, once it was written."""
        entry = self._job.file.entry
        return None if entry is None else entry.path

    def replaces(self, entry: SavedSession) -> None:
        """Let the session continue with this one, which is offered no more once the session itself is written."""
        self._job.file.replaced.append(entry)

    def flush(self, timeout: float = 60.0) -> None:
        """Write now what waits, and wait for it.

        Raises
        ------
        TimeoutError
            If it takes longer, or the volume cannot be identified, so that nothing is written at all.
        """
        if not self._job.flush(timeout):
            raise TimeoutError(f"the session was not written within {timeout:g} seconds.")

    def close(self, timeout: float = _WAIT_AT_CLOSE) -> bool:
        """Write pending edits and end: no crash, so nothing is offered; unsaved edits stay in the history.

        Parameters
        ----------
        timeout : seconds to wait for it.

        Returns
        -------
        Whether it has ended by then.
        """
        session = self._session()
        if session is not None and not self._job.is_ending:
            session.editing.unobserve(self._job.note_edit, _WATCHED)
            session.files.unobserve(self._job.note_saved, "saved")
        self._job.end()
        return self._job.is_current_thread or self._job.wait_released(timeout)


class _Reports:
    """Callbacks of an autosave, which cannot stop it; a failure is reported once until something is written again."""

    def __init__(
        self,
        on_ready: Callable[[VolumeReference], None] | None,
        on_written: Callable[[SavedSession], None] | None,
        on_trouble: Callable[[str], object] | None,
    ) -> None:
        self._on_ready, self._on_written, self._on_trouble = on_ready, on_written, on_trouble
        self._has_trouble = False

    def ready(self, reference: VolumeReference) -> None:
        """The volume is identified."""
        _safely(lambda: self._on_ready and self._on_ready(reference))

    def note_written(self, entry: SavedSession | None) -> None:
        """A snapshot is safe; None where nothing had to be written."""
        self._has_trouble = False
        _safely(lambda: entry and self._on_written and self._on_written(entry))

    def trouble(self, error: Exception) -> None:
        """Report an obstacle."""
        if self._has_trouble:
            return
        self._has_trouble = True
        _LOG.warning("autosave of a session failed: %s", error)
        text = f"Autosave is not possible now, save the session yourself: {_why(error)}"
        _safely(lambda: self._on_trouble and self._on_trouble(text))


class _SessionFile:
    """The file that a running session is written to, and holds; used by the thread that writes.

    Parameters
    ----------
    first : the document with which the session began.
    """

    def __init__(self, folder: Path, first: Deformation) -> None:
        self.folder = folder
        self.reference: VolumeReference | None = None
        self.saved: Deformation | None = None
        self.replaced: list[SavedSession] = []
        self.entry: SavedSession | None = None
        self.held: int | None = None
        self._first = _bare(first)
        self._is_pruned = False

    def write(self, snapshot: _Snapshot) -> SavedSession | None:
        """Write the edits, if the document differs from that at the start of the session."""
        assert self.reference is not None
        bare = _bare(snapshot.state.deformation)
        state = "saved" if bare == self.saved else "unchanged" if bare == self._first else "open"
        if self.entry is None and state == "unchanged":
            return None
        if self.entry is None or not self.entry.lock_path.exists():  # the first time, or the folder was removed
            self._begin()
        assert self.entry is not None
        self.entry = replace(
            self.entry,
            state=state,
            edited=snapshot.edited,
            index=snapshot.state.index,
            key=snapshot.state.key,
            points=sum(len(m) for step in bare.steps for m in step.maps),
            steps=len(bare.steps),
        )
        write_session(self.entry, replace(bare, volume=self.reference))
        while self.replaced:
            mark(self.replaced.pop(), "restored")
        return self.entry

    def prune(self) -> None:
        """Remove files of the folder that are too old or too many, once."""
        if not self._is_pruned and self.entry is not None:
            self._is_pruned = True
            prune(self.folder)

    def _begin(self) -> None:
        """Make the file that is held while the session runs."""
        assert self.reference is not None
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        self._release()
        number = next_number(self.folder)
        while self.held is None:
            path = self.folder / file_name(self.reference, secrets.token_hex(4))
            self.entry = SavedSession(path, self.reference, datetime.now(UTC), "open", 0, 0, number=number)
            try:
                self.held = create_locked(self.entry.lock_path)
            except OSError:
                self.entry = None
                raise
        _HELD.add(self.held)

    def close(self) -> None:
        """The session has ended normally: no process holds the file any more."""
        if self.entry is not None and self.entry.state == "open":
            mark(self.entry, "closed")
        self._release()

    def _release(self) -> None:
        if self.held is not None and self.entry is not None:
            _HELD.discard(self.held)
            os.close(self.held)
            sweep(self.entry.lock_path)
        self.held = None


class _Job:
    """Snapshots that wait to be written, and the thread that writes them; it does not hold the session.

    Parameters
    ----------
    state : with which the session began.
    refer : identifies the volume, in the thread.
    folder, delay : as of :class:`Autosave`.
    """

    def __init__(
        self, state: Edited, refer: Callable[[], VolumeReference], folder: Path, delay: float, reports: _Reports
    ) -> None:
        self.file = _SessionFile(folder, state.deformation)
        self.reports = reports
        self.refer: Callable[[], VolumeReference] | None = refer
        self.delay = float(delay)
        self.changed = threading.Condition()  # guards what follows, and wakes the thread
        self.latest = _Snapshot(state, datetime.now(UTC))
        self.waiting: _Snapshot | None = None
        self.unwritten: _Snapshot | None = None  # the last one, if writing it failed
        self.since = self.due = 0.0
        self.is_urgent = self.is_busy = self.is_ending = self.is_done = False
        self.thread: threading.Thread | None = None

    # -- from the session's threads ------------------------------------------------------------------------------------

    @property
    def is_current_thread(self) -> bool:
        """True in the thread that writes."""
        return threading.current_thread() is self.thread

    def start(self) -> None:
        """Start the thread unless it runs or the end has come; where there are no threads, write now."""
        with self.changed:
            if self.thread is None and not self.is_done and not can_start_threads():
                self.thread, self.is_urgent = threading.current_thread(), True
                _run(self)
                self.is_urgent = False
            elif self.thread is None and not self.is_done:
                self.thread = threading.Thread(target=_run, args=(self,), name="deformnb-autosave", daemon=True)
                try:
                    self.thread.start()
                except RuntimeError as error:  # there are too many; the next edit tries again
                    self.thread = None
                    self.reports.trouble(error)

    def note_edit(self, change: Any) -> None:
        """An edit was made, or another step chosen; this takes microseconds."""
        with self.changed:
            edited = datetime.now(UTC) if change["name"] == "deformation" else self.latest.edited
            self.latest = _Snapshot(change["owner"].state, edited)
            self._wait()

    def note_saved(self, change: Any) -> None:
        """The session was saved, or a saved one opened."""
        with self.changed:
            self.file.saved = None if change["new"] is None else _bare(change["new"])
            self._wait()

    def _wait(self) -> None:
        now, is_first = time.monotonic(), self.waiting is None
        self.waiting = self.latest
        self.since = now if is_first else self.since
        self.due = min(now + self.delay, self.since + LONGEST_WAIT * max(self.delay, 1e-3))
        self.start()  # a thread that waits already checks the time again when it wakes

    def flush(self, timeout: float) -> bool:
        with self.changed:
            self.is_urgent = True
            self.changed.notify_all()
            done = self.changed.wait_for(lambda: (self.waiting is None and not self.is_busy) or self.is_done, timeout)
            self.is_urgent = False
            return done and self.waiting is None

    def end(self, in_this_thread: bool = False) -> None:
        """Write what waits and leave: in the thread that has begun to write, else in a new one or in this one."""
        with self.changed:
            self.is_ending = True
            self.waiting, self.unwritten = self.waiting or self.unwritten, None  # the disk may have room again
            self.changed.notify_all()
            is_free = self.thread is None and not self.is_done
            if is_free and in_this_thread:
                self.thread = threading.current_thread()
            elif is_free:
                self.start()
        if is_free and in_this_thread:
            _run(self)

    def wait_released(self, timeout: float) -> bool:
        """Wait until the file is held no more."""
        with self.changed:
            return self.changed.wait_for(lambda: self.is_done, timeout)

    # -- in the thread -------------------------------------------------------------------------------------------------

    def take(self) -> _Snapshot | None:
        """The next snapshot to write, when it is due; None at the end and when nothing waits: the thread ends."""
        with self.changed:
            while True:
                self.is_busy = False
                self.changed.notify_all()
                left = self.due - time.monotonic()
                if self.waiting is not None and (self.is_ending or self.is_urgent or left <= 0):
                    taken, self.waiting, self.is_busy = self.waiting, None, True
                    return taken
                if self.waiting is None:
                    if not self.is_ending:
                        self.thread = None
                    return None
                self.changed.wait(left)

    def write(self, snapshot: _Snapshot) -> None:
        """Write a snapshot, or record that it could not be written."""
        try:
            entry = self.file.write(snapshot)
            self.unwritten = None
            self.reports.note_written(entry)
            self.file.prune()
        except Exception as error:  # a full disk, a folder that is gone or read-only
            self.unwritten = snapshot
            self.reports.trouble(error)

    def leave(self) -> None:
        """The last work."""
        try:
            self.file.close()
        finally:
            _OPEN.discard(self)
            with self.changed:
                self.is_done, self.thread = True, None
                self.changed.notify_all()


def _run(job: _Job) -> None:
    try:
        if job.refer is not None:
            reference = job.file.reference = job.refer()
            job.refer = None  # and with it the volume
            job.reports.ready(reference)
        while (snapshot := job.take()) is not None:
            job.write(snapshot)
            del snapshot
    except Exception as error:  # the volume cannot be read for its checksum
        _LOG.exception("autosave of a session failed")
        job.reports.trouble(error)
    finally:
        if job.is_current_thread:  # else the thread was given up, and another may be at work by now
            _safely(job.leave)


def _safely(action: Callable[[], Any]) -> None:
    try:
        action()
    except Exception:
        _LOG.exception("a session's own saving met trouble")


def _bare(deformation: Deformation) -> Deformation:
    """The document without its volume, which does not count when documents are compared."""
    return replace(deformation, volume=None, unit="")


def _why(error: Exception) -> str:
    if isinstance(error, DeformError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename or 'the folder of sessions'}: {error.strerror or error}."
    return f"{type(error).__name__}: {error}"


# -- the end of the process --------------------------------------------------------------------------------------------

_OPEN: set[_Job] = set()
_HELD: set[int] = set()


@atexit.register
def _end_all() -> None:
    """Write waiting snapshots and close open files: the normal end of a process is no crash."""
    jobs = list(_OPEN)
    until = time.monotonic() + _PATIENCE_AT_EXIT
    for job in jobs:
        job.end(in_this_thread=True)  # no thread can be started any more
    for job in jobs:
        job.wait_released(max(0.0, until - time.monotonic()))


def _release_all() -> None:
    """Release all files in a copy of the process: files, threads and their locks belong to the original."""
    for descriptor in _HELD:
        os.close(descriptor)
    for job in _OPEN:
        job.changed = threading.Condition()
        job.is_done, job.thread, job.file.held = True, None, None
    _HELD.clear()
    _OPEN.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_release_all)


class Recovery:
    """Writes a session after each edit, and offers the lost ones on its volume one after the other.

    Parameters
    ----------
    session : to edit.
    report : receives failures, and notes on a document that was made on another volume.
    changed : called when there is another offer, or something was written; from any thread.
    options : of :class:`~deformnb.session.autosave.Autosave`.

    Attributes
    ----------
    autosave : what writes.
    lost : the offers, the newest first.
    earlier : sessions on the volume that ended normally with edits that are in no file, the newest first.
    ready : set once the lost sessions are known.
    written : time of the last write of unsaved edits, for people; empty if there are none.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> recovery = Recovery(Session(PHANTOMS["bar"].make((8, 8, 8))))
    >>> recovery.offer
    ''
    >>> recovery.autosave.close()
    True
    """

    def __init__(
        self,
        session: Session,
        report: Callable[[str], object] = str,
        changed: Callable[[], object] = bool,
        **options: Any,
    ) -> None:
        self.session = session
        self.lost: list[SavedSession] = []
        self.earlier: list[SavedSession] = []
        self._found: list[SavedSession] = []
        self.written = self._noted = ""
        self._report, self._changed = report, changed
        self.ready = threading.Event()
        self._differs = session.editing.deformation if session.editing.deformation.volume is not None else None
        self._folder = Path(options.pop("folder", None) or state_folder())
        self.autosave = Autosave(
            session,
            self._folder,
            on_ready=weakly(self, Recovery._find_lost),
            on_written=weakly(self, Recovery._note),
            on_trouble=report,
            **options,
        )

    @property
    def offer(self) -> str:
        """Question to the user; empty for none."""
        lost = self.lost
        if not lost:
            return ""
        older = len(lost) - 1
        more = f" {count_text(older, 'older edit')} follow{'s' if older == 1 else ''}." if older else ""
        size = f"{count_text(lost[0].points, 'point')}, {count_text(lost[0].steps, 'step')}"
        return f"An edit of {moment(lost[0].edited)} was not saved ({size}).{more}"

    def act(self, command: str) -> None:
        """Do a :data:`~deformnb._typing.RecoveryCommand` with the offered session.

        Raises
        ------
        DeformError
            If its file is damaged or gone; it is offered no more then.
        """
        if command not in get_args(RecoveryCommand):
            raise DeformError(f"unknown command {command!r:.40}; choose one of {', '.join(get_args(RecoveryCommand))}.")
        if not self.lost:
            return
        entry = self.lost.pop(0)
        try:
            if command == "restore":
                self._restore(entry)
                self.lost.clear()  # the others are offered the next time: this is the answer for now
            else:
                (skip if command == "skip" else delete)(entry)
        finally:
            self._changed()

    def _restore(self, entry: SavedSession) -> None:
        document = restore(entry)
        index = entry.index if 0 <= entry.index < len(document.steps) else None
        self.session.editing.edit_document(document, f"restore the edit of {moment(entry.edited)}", index=index)
        self.autosave.replaces(entry)

    def resume(self, which: int) -> None:
        """Continue one of the :attr:`earlier` sessions; can be undone.

        Raises
        ------
        DeformError
            If there is no such one, or its file is damaged or gone.
        """
        if not 0 <= which < len(self.earlier):
            raise DeformError("this earlier session is no longer stored.")
        entry = self.earlier[which]
        document = restore(entry)
        index = entry.index if 0 <= entry.index < len(document.steps) else None
        self.session.editing.edit_document(document, f"go back to the edit of {moment(entry.edited)}", index=index)

    @property
    def name(self) -> str:
        """Name of the autosave of this session, which names it in the next process too; empty before the first edit."""
        path = self.autosave.path
        return "" if path is None else path.stem

    def resume_named(self, name: str) -> bool:
        """Continue the session of another process that has ended; can be undone.

        Parameters
        ----------
        name : its :attr:`name` there.

        Returns
        -------
        Whether there is such a session on this volume.

        Raises
        ------
        DeformError
            If its file is damaged.
        """
        entry = next((entry for entry in self._found if entry.path.stem == name and not entry.is_live), None)
        if entry is None:
            return False
        try:
            self._restore(entry)
            self.lost = [other for other in self.lost if other.path != entry.path]
            self.earlier = [other for other in self.earlier if other.path != entry.path]
        finally:
            self._changed()
        return True

    def _find_lost(self, reference: VolumeReference) -> None:
        try:
            found = self._found = saved_sessions(reference, self._folder, every=True)
            self.lost = [entry for entry in found if entry.is_lost]
            self.earlier = [entry for entry in found if entry.is_earlier]
            if self._differs is not None:
                difference, self._differs = self.session.files.difference(self._differs), None
                if difference:
                    self._report(difference)
        finally:
            self.ready.set()
        self._changed()

    def _note(self, entry: SavedSession) -> None:
        written = moment(entry.edited) if entry.state == "open" else ""
        if written != self.written or entry.path.stem != self._noted:
            self.written, self._noted = written, entry.path.stem
            self._changed()

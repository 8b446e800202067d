"""Worker threads for slow work and for VTK.

VTK needs a separate thread, because an OpenGL context belongs to the thread that made it. Callbacks of widgets come
from any thread. The work that they request is queued here: calls in the order in which they
came, then the newest job of each name, then jobs that wait for a rest.

Where no thread can be started, as in a browser, the work is done at once, in the thread that requests it.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import sys
import threading
import time
import weakref
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any, TypeVar

from deformnb._jax import ENDING
from deformnb._threads import Timer, can_start_threads
from deformnb.checks import report_notes
from deformnb.errors import DeformError

_LOG = logging.getLogger(__name__)

_Result = TypeVar("_Result")

_IDLE = 30.0  # seconds without work after which a thread ends, until something is to be done again

# At the end of the process a program that is being compiled and a picture that is being drawn are finished: XLA and VTK
# torn out of their work end in a crash. No further program begins, so this is as long as the slowest of a busy machine.
_PATIENCE_AT_EXIT = 30.0
_SILENCE_AT_EXIT = 1.0  # seconds of waiting after which the process reports the cause


class Worker:
    """A thread that does one thing after the other, started by the first of them.

    It holds no reference to its maker: when the last reference to this object goes, the thread ends. It also ends when
    nothing was to be done for a while, and another takes its place when something is: dropping a widget that the
    front end may still show is left with no thread.

    Parameters
    ----------
    name : shown by debuggers.
    at_end : called in each thread as its last work.
    is_needed : whether the thread must stay though nothing is to be done.
    failed : called in the thread with the exception of a job, which is logged in any case. That of a call belongs to
        its future.

    Examples
    --------
    >>> worker = Worker()
    >>> worker.call(lambda: 6 * 7).result()
    42
    >>> worker.close()
    """

    def __init__(
        self,
        name: str = "deformnb-worker",
        at_end: Callable[[], None] | None = None,
        failed: Callable[[Exception], None] | None = None,
        is_needed: Callable[[], bool] = lambda: False,
    ) -> None:
        self._queue = _Queue(at_end, failed, is_needed)
        self._name = name
        self._thread: threading.Thread | None = None
        weakref.finalize(self, self._queue.close).atexit = False

    def call(self, function: Callable[[], _Result]) -> Future[_Result]:
        """Do this in the thread; calls are done in the order in which they came, before jobs.

        Returns
        -------
        A future with the result. Wait for it anywhere but in the thread itself.
        """
        future: Future[_Result] = Future()
        with self._queue.changed:  # the thread cannot end between the two
            self._start()
            self._queue.put_call(lambda: _settle(future, function), future)
        self._queue.work_here()
        return future

    def latest(self, key: str, function: Callable[[], None]) -> None:
        """Do this in the thread soon; it takes the place of a job of the same name that still waits."""
        with self._queue.changed:
            self._start()
            self._queue.put_job(key, function)
        self._queue.work_here()

    def debounce(self, delay: float, function: Callable[[], None]) -> None:
        """Do this once nothing else has come for ``delay`` seconds; what comes first drops it, and so does the end."""
        # It may be closed while the job is done that requests this.
        with contextlib.suppress(DeformError), self._queue.changed:
            self._start()
            self._queue.put_rest(delay, function)

    @contextlib.contextmanager
    def pause(self) -> Iterator[None]:
        """A context in which nothing is done: what is requested waits for its end."""
        is_over = threading.Event()
        self._queue.is_paused = not can_start_threads()
        if not self._queue.is_paused:
            self.call(is_over.wait)
        try:
            yield
        finally:
            is_over.set()
            self._queue.is_paused = False
            self._queue.work_here()

    @property
    def is_wanted(self) -> bool:
        """True if something waits or the thread should end: long work checks this and stops."""
        return self._queue.is_wanted

    @property
    def is_current_thread(self) -> bool:
        """True in the thread itself."""
        return self._queue.is_at_work_here or threading.current_thread() is self._thread

    @property
    def is_closed(self) -> bool:
        """True after :meth:`close`."""
        return self._queue.closed

    def close(self, wait: float = 0.1) -> None:
        """End the thread after its current work; waiting jobs are cancelled.

        Parameters
        ----------
        wait : seconds that this takes at most. Longer work continues, and the thread ends behind it.
        """
        self._queue.close()
        self._queue.end_here()
        thread = self._thread
        if thread is not None and not self.is_current_thread:
            thread.join(wait)

    def _start(self) -> None:
        if self._queue.closed:
            raise DeformError("the view is closed; make a new one.")
        if not self._queue.has_thread and can_start_threads():
            before, self._queue.has_thread = self._thread, True
            self._thread = threading.Thread(target=_work, args=(self._queue, before), name=self._name, daemon=True)
            _RUNNING[self._thread] = self._queue
            self._thread.start()


class _Queue:
    """Queue of jobs, shared by the thread and its owner, with a reference to neither."""

    def __init__(
        self,
        at_end: Callable[[], None] | None,
        failed: Callable[[Exception], None] | None,
        is_needed: Callable[[], bool],
    ) -> None:
        self.changed = threading.Condition()
        self.calls: deque[tuple[Callable[[], None], Future[Any]]] = deque()
        self.jobs: dict[str, Callable[[], None]] = {}
        self.rest: tuple[float, Callable[[], None]] | None = None
        self.closed = False
        self.has_thread = False
        self.is_paused = self.is_at_work_here = self.has_worked_here = False  # where there are no threads
        self.at_end = at_end
        self.failed = failed
        self.is_needed = is_needed

    @property
    def is_wanted(self) -> bool:
        return bool(self.closed or self.calls or self.jobs)

    def put_call(self, work: Callable[[], None], future: Future[Any]) -> None:
        with self.changed:
            self.calls.append((work, future))
            self.rest = None
            self.changed.notify()

    def put_job(self, key: str, work: Callable[[], None]) -> None:
        with self.changed:
            self.jobs[key] = work  # a dict preserves the place of the first: no job waits for ever
            self.rest = None
            self.changed.notify()

    def put_rest(self, delay: float, work: Callable[[], None]) -> None:
        with self.changed:
            if self.is_wanted:
                return
            self.rest = rest = (time.monotonic() + delay, work)
            self.changed.notify()
            if not self.has_thread:
                Timer(delay, lambda: self._rest_here(rest)).start()

    def _rest_here(self, rest: tuple[float, Callable[[], None]]) -> None:
        """Do what waited for a rest, where there are no threads.

        Without a loop of events that is at once, but for what a job requests: one that requests itself again would
        never end.
        """
        if self.rest is rest:
            self.rest = None
            if not self.is_at_work_here:
                self.put_job("rest", rest[1])
                self.work_here()

    def work_here(self) -> None:
        """Do all that waits in this thread, where no other can be started."""
        if self.has_thread or self.is_paused or self.is_at_work_here:
            return
        self.is_at_work_here = self.has_worked_here = True
        try:
            while self.is_wanted and not self.closed:
                work = self.take()
                if work is not None:
                    _do(self, work)
        finally:
            self.is_at_work_here = False

    def end_here(self) -> None:
        """Do the last work, where no other thread does it."""
        if self.has_worked_here and self.at_end is not None:
            self.has_worked_here = False
            self.at_end()

    def close(self) -> None:
        with self.changed:
            self.closed = True
            for _, future in self.calls:
                future.cancel()
            self.calls.clear()
            self.jobs.clear()
            self.rest = None
            self.changed.notify_all()

    def report_failure(self, error: Exception) -> None:
        """Report that a job has failed; not after the owner was deleted."""
        if self.failed is None or self.closed:
            return
        try:
            self.failed(error)
        except Exception:
            _LOG.exception("the failure of a job could not be reported")

    def take(self) -> Callable[[], None] | None:
        """The next thing to do, waiting for it; None at the end, and when nothing has come for a while."""
        with self.changed:
            while True:
                if self.closed:
                    return None
                if self.calls:
                    return self.calls.popleft()[0]
                if self.jobs:
                    return self.jobs.pop(next(iter(self.jobs)))
                left = None if self.rest is None else self.rest[0] - time.monotonic()
                if self.rest is not None and left is not None and left <= 0:
                    work, self.rest = self.rest[1], None
                    return work
                is_idle = not self.changed.wait(_IDLE if left is None else left)
                if is_idle and not self.is_wanted and self.rest is None and not self.is_needed():
                    self.has_thread = False
                    return None


def _work(queue: _Queue, before: threading.Thread | None) -> None:
    if before is not None:
        before.join()  # it may still clear state that is made again here
        before = None
    while (work := queue.take()) is not None:
        _do(queue, work)
        del work  # else the thread holds the owner of its last job while it waits
    if queue.at_end is not None:
        try:
            queue.at_end()
        except Exception:
            _LOG.exception("a worker could not put its things away")
    _RUNNING.pop(threading.current_thread(), None)


def _do(queue: _Queue, work: Callable[[], None]) -> None:
    try:
        with report_notes():  # by the widgets
            work()
    except Exception as error:  # of a job, whose owner should have caught it: the next one must still be done
        if not ENDING.is_set():  # which cancels the computation of a job
            _LOG.exception("a job of a worker failed")
            queue.report_failure(error)


def _settle(future: Future[Any], function: Callable[[], Any]) -> None:
    if not future.set_running_or_notify_cancel():
        return
    try:
        future.set_result(function())
    except BaseException as error:  # it belongs to the waiting caller
        future.set_exception(error)


_RUNNING: dict[threading.Thread, _Queue] = {}


@atexit.register
def _end_all() -> None:
    ENDING.set()
    running = list(_RUNNING.items())
    for _, queue in running:
        queue.close()
    threads = [thread for thread, _ in running]
    _join(threads, _SILENCE_AT_EXIT)
    busy = [thread.name for thread in threads if thread.is_alive()]
    if busy:
        with contextlib.suppress(OSError, ValueError):  # a terminal that was closed
            sys.stderr.write(f"deformnb: finishing what {', '.join(busy)} is computing.\n")
        _join(threads, _PATIENCE_AT_EXIT)


def _join(threads: list[threading.Thread], wait: float) -> None:
    until = time.monotonic() + wait
    for thread in threads:
        thread.join(max(0.0, until - time.monotonic()))

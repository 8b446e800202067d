"""Worker threads for slow work and for VTK, and the widgets of a notebook's cell.

VTK needs a thread of its own, because an OpenGL context belongs to the thread that made it. Callbacks of widgets come
from whatever thread a front end likes. The work that they request is queued here: calls in the order in which they
came, then the newest job of each name, then jobs that wait for a rest.

A cell that runs again closes the widgets that it showed before. ipywidgets keeps every widget until it is closed. A
studio or a view that is made again with each run of its cell would leave its volume, its threads, its windows and its
servers behind each time.
"""

from __future__ import annotations

import atexit
import contextlib
import logging
import sys
import threading
import time
import weakref
from collections import defaultdict, deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar

import ipywidgets as ipw

from deformnb.errors import DeformError

_LOG = logging.getLogger(__name__)

_Result = TypeVar("_Result")

_IDLE = 30.0  # seconds without work after which a thread ends, until something is to be done again

# At the end of the process a picture that is being drawn may be finished: VTK torn out of its work ends in a crash.
_PATIENCE_AT_EXIT = 5.0


class Worker:
    """A thread that does one thing after the other, started by the first of them.

    It holds nothing of whoever made it: when the last reference to this object goes, the thread ends. It also ends when
    nothing was to be done for a while, and another takes its place when something is: who forgets a widget that the
    front end may still show is left with no thread.

    Parameters
    ----------
    name : shown by debuggers.
    at_end : called in each thread as its last work.
    is_kept : whether the thread must stay though nothing is to be done.
    failed : called in the thread with what a job has raised, which is logged in any case. What a call raises belongs to
        its future.

    Examples
    --------
    >>> worker = Worker()
    >>> worker.call(lambda: 6 * 7).result()
    42
    >>> worker.close()
    """

    def __init__(self, name: str = "deformnb-worker", at_end: Callable[[], None] | None = None,
                 failed: Callable[[Exception], None] | None = None,
                 is_kept: Callable[[], bool] = lambda: False) -> None:
        self._queue = _Queue(at_end, failed, is_kept)
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
        return future

    def latest(self, key: str, function: Callable[[], None]) -> None:
        """Do this in the thread soon; it takes the place of a job of the same name that still waits."""
        with self._queue.changed:
            self._start()
            self._queue.put_job(key, function)

    def at_rest(self, delay: float, function: Callable[[], None]) -> None:
        """Do this once nothing else has come for ``delay`` seconds; what comes first drops it, and so does the end."""
        # It may be closed while the job is done that requests this.
        with contextlib.suppress(DeformError), self._queue.changed:
            self._start()
            self._queue.put_rest(delay, function)

    @property
    def is_wanted(self) -> bool:
        """True if something waits or the thread shall end: long work looks here and stops."""
        return self._queue.is_wanted

    @property
    def is_here(self) -> bool:
        """True in the thread itself."""
        return threading.current_thread() is self._thread

    @property
    def is_closed(self) -> bool:
        """True after :meth:`close`."""
        return self._queue.closed

    def close(self, wait: float = 0.1) -> None:
        """End the thread after what it is doing; what waits is cancelled.

        Parameters
        ----------
        wait : seconds that this takes at most. Longer work goes on, and the thread ends behind it.
        """
        self._queue.close()
        thread = self._thread
        if thread is not None and not self.is_here:
            thread.join(wait)

    def _start(self) -> None:
        if self._queue.closed:
            raise DeformError("the view is closed; make a new one.")
        if not self._queue.has_thread:
            before, self._queue.has_thread = self._thread, True
            self._thread = threading.Thread(target=_work, args=(self._queue, before), name=self._name, daemon=True)
            _RUNNING[self._thread] = self._queue
            self._thread.start()


class _Queue:
    """Queue of jobs, shared by the thread and its owner, with a reference to neither."""

    def __init__(self, at_end: Callable[[], None] | None, failed: Callable[[Exception], None] | None,
                 is_kept: Callable[[], bool]) -> None:
        self.changed = threading.Condition()
        self.calls: deque[tuple[Callable[[], None], Future[Any]]] = deque()
        self.jobs: dict[str, Callable[[], None]] = {}
        self.rest: tuple[float, Callable[[], None]] | None = None
        self.closed = False
        self.has_thread = False
        self.at_end = at_end
        self.failed = failed
        self.is_kept = is_kept

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
            self.jobs[key] = work  # a dict keeps the place of the first: nobody waits for ever
            self.rest = None
            self.changed.notify()

    def put_rest(self, delay: float, work: Callable[[], None]) -> None:
        with self.changed:
            if not self.is_wanted:
                self.rest = (time.monotonic() + delay, work)
                self.changed.notify()

    def close(self) -> None:
        with self.changed:
            self.closed = True
            for _, future in self.calls:
                future.cancel()
            self.calls.clear()
            self.jobs.clear()
            self.rest = None
            self.changed.notify_all()

    def tell(self, error: Exception) -> None:
        """Report that a job has failed; not when nobody is there any more."""
        if self.failed is None or self.closed:
            return
        try:
            self.failed(error)
        except Exception:
            _LOG.exception("the failure of a job could not be told")

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
                if is_idle and not self.is_wanted and self.rest is None and not self.is_kept():
                    self.has_thread = False
                    return None


def _work(queue: _Queue, before: threading.Thread | None) -> None:
    if before is not None:
        before.join()  # it may still put away what is made again here
        before = None
    while (work := queue.take()) is not None:
        try:
            work()
        except Exception as error:  # of a job, whose owner should have caught it: the next one must still be done
            if not _ENDING.is_set():  # at the end of the process JAX has put away what a job still needs
                _LOG.exception("a job of a worker failed")
                queue.tell(error)
        del work  # else the thread holds the owner of its last job while it waits
    if queue.at_end is not None:
        try:
            queue.at_end()
        except Exception:
            _LOG.exception("a worker could not put its things away")
    _RUNNING.pop(threading.current_thread(), None)


def _settle(future: Future[Any], function: Callable[[], Any]) -> None:
    if not future.set_running_or_notify_cancel():
        return
    try:
        future.set_result(function())
    except BaseException as error:  # it belongs to whoever waits
        future.set_exception(error)


_RUNNING: dict[threading.Thread, _Queue] = {}
_ENDING = threading.Event()


@atexit.register
def _end_all() -> None:
    _ENDING.set()
    running = list(_RUNNING.items())
    for _, queue in running:
        queue.close()
    until = time.monotonic() + _PATIENCE_AT_EXIT
    for thread, _ in running:
        thread.join(max(0.0, until - time.monotonic()))


_LOG = logging.getLogger(__name__)

_MAKING = threading.RLock()  # ipywidgets tells one listener of what is made

# By the cell's id and the name of the class, for anywidget makes a class of each widget: the run they were made in, and
# the widgets of that run.
_SHOWN: dict[tuple[str, str], tuple[str, list[weakref.ref[Any]]]] = defaultdict(lambda: ("", []))

_IS_PART = ContextVar("_IS_PART", default=False)


@contextmanager
def parts_of_another() -> Iterator[None]:
    """Context in which new widgets belong to a widget that closes them, and not to the cell that runs."""
    before = _IS_PART.set(True)
    try:
        yield
    finally:
        _IS_PART.reset(before)


def leave_to_another(widget: Any) -> None:
    """A widget that a cell has made belongs to another one from now on, which closes it."""
    for cell, (run, shown) in _SHOWN.items():
        _SHOWN[cell] = (run, [reference for reference in shown if reference() is not widget])


def close_earlier_of_this_cell(widget: Any) -> None:
    """Close the widgets of this class that earlier runs of the running cell have made, and remember this one.

    Call it when nothing can fail any more: who cannot have a new widget keeps the one of before.
    """
    place = None if _IS_PART.get() else _cell_and_run()
    if place is None:
        return
    kind = type(widget)
    cell, run = (place[0], f"{kind.__module__}.{kind.__qualname__}"), place[1]
    last_run, shown = _SHOWN[cell]
    if run != last_run:
        for reference in shown:
            earlier = reference()
            if earlier is not None:
                if hasattr(earlier, "hand_on"):
                    earlier.hand_on(widget)
                earlier.close()
        shown = []
    _SHOWN[cell] = (run, [*shown, weakref.ref(widget)])


def _cell_and_run() -> tuple[str, str] | None:
    """Ids of the cell that runs and of its run, where the front end sends them."""
    ipython = sys.modules.get("IPython")  # whoever runs cells has it; nobody else needs it
    shell = ipython.get_ipython() if ipython is not None else None
    parent: dict[str, Any] = getattr(shell, "get_parent", dict)() if shell is not None else {}
    cell = (parent.get("metadata") or {}).get("cellId")
    run = (parent.get("header") or {}).get("msg_id")
    return (cell, run) if isinstance(cell, str) and isinstance(run, str) else None


@contextmanager
def closed_on_failure(end: Callable[[], None]) -> Iterator[None]:
    """Close the widgets that this thread makes meanwhile, should it end with an error: nobody else could.

    Parameters
    ----------
    end : called before that.
    """
    made: list[Any] = []
    thread = threading.get_ident()
    with _MAKING:
        before = getattr(ipw.Widget, "_widget_construction_callback", None)

        def remember(widget: Any) -> None:
            if threading.get_ident() == thread:
                made.append(widget)
            if before is not None:
                before(widget)
        ipw.Widget.on_widget_constructed(remember)
        try:
            yield
        except BaseException:
            for close in [end, *(widget.close for widget in reversed(made))]:
                _try(close)
            raise
        finally:
            ipw.Widget.on_widget_constructed(before)


def _try(close: Callable[[], None]) -> None:
    try:
        close()
    except Exception:  # of half a widget; the error that matters is on its way
        _LOG.exception("a widget that was not finished could not be closed")


def close_all(widget: Any) -> None:
    """Close a widget and all that it is made of: children, layouts, styles."""
    parts: dict[int, Any] = {}
    _collect(widget, parts)
    for part in parts.values():
        if part is not widget:
            part.close()
    ipw.Widget.close(widget)


def _collect(widget: Any, parts: dict[int, Any]) -> None:
    if not isinstance(widget, ipw.Widget) or id(widget) in parts:
        return
    parts[id(widget)] = widget
    for child in getattr(widget, "children", ()):
        _collect(child, parts)
    for name in ("layout", "style"):
        if widget.has_trait(name):
            _collect(getattr(widget, name), parts)

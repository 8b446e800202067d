"""Results that a thread computes: the newest request wins, and its result comes back to the thread of the viewer."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from qtpy.QtCore import QObject, Signal

from deformnb._typing import Progress
from deformnb.errors import Cancelled, DeformError
from deformnb.widgets.worker import Worker
from napari_deformnb.results import Result

Job = Callable[[Progress], Result]
"""Computes a result; the progress that it is given ends it where it has become superfluous."""


class LiveResults(QObject):
    """A thread for results. Previews are finished, so that each shows something; full results give way to requests.

    Attributes
    ----------
    done : emitted with a Result, in the thread of this object.
    failed : emitted with a sentence, likewise.
    progressed : emitted with the share of a full result, 0 to 1.
    """

    done = Signal(object)
    failed = Signal(str)
    progressed = Signal(float)
    _came = Signal(int, object)

    def __init__(self) -> None:
        super().__init__()
        self._worker = Worker("deformnb-napari")
        self._number = self._shown = 0
        self._came.connect(self._deliver)

    @property
    def is_busy(self) -> bool:
        """True while the newest request has no result."""
        return self._shown < self._number

    def request(self, job: Job, *, is_preview: bool) -> None:
        """Compute a result soon, in place of a request that still waits."""
        if self._worker.is_closed:
            return
        self._number += 1
        number = self._number

        def check(share: float) -> None:
            if self._worker.is_closed or (self._worker.is_wanted and not is_preview):
                raise Cancelled("a newer request takes its place")
            if not is_preview:
                self._emit(lambda: self.progressed.emit(share))

        def work() -> None:
            found: Result | str | None
            try:
                found = job(check)
            except Cancelled:
                found = None
            except DeformError as error:  # that of a preview comes again at the end of the drag
                found = None if is_preview else str(error)
            except Exception as error:
                found = f"the deformation could not be computed: {error!r}"
                self._emit(lambda: self._came.emit(number, found))
                raise
            self._emit(lambda: self._came.emit(number, found))

        self._worker.latest("result", work)

    def cancel(self) -> None:
        """Drop the request that waits or is computed."""
        if not self._worker.is_closed:
            self._number += 1
            self._worker.latest("result", lambda: None)
            self._shown = self._number

    def close(self, wait: float = 30.0) -> None:
        """End the thread, after what it is computing."""
        self._worker.close(wait)
        self._shown = self._number

    def _emit(self, emission: Callable[[], None]) -> None:
        """Emit a signal, unless Qt has deleted this object meanwhile."""
        try:
            emission()
        except RuntimeError:
            self._worker.close(0.0)

    def _deliver(self, number: int, found: Any) -> None:
        if self._worker.is_closed or number < self._shown:
            return
        self._shown = number
        if isinstance(found, str):
            self.failed.emit(found)
        elif found is not None:
            self.done.emit(found)

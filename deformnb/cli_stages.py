"""What the commands tell while they work: notes, and how far a piece of work has come."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import TypeAlias

_PATIENCE = 1.0  # seconds of silence

Stage: TypeAlias = Callable[[str], Callable[[float], None]]


def note(*notes: str) -> None:
    """Remarks on standard error."""
    for text in notes:
        print(f"deformnb: note: {text}", file=sys.stderr)


@contextlib.contextmanager
def stages() -> Iterator[Stage]:
    """A function that begins a piece of work by name and returns what is told how far it has come.

    What takes longer than a second shows a bar; where standard error is a file or a pipe, a line when it is done.
    """
    make = _Bar if sys.stderr.isatty() else _Line
    current: list[_Bar | _Line] = []

    def stage(name: str) -> Callable[[float], None]:
        while current:
            current.pop().finish()
        current.append(make(name))
        return current[0].move

    try:
        yield stage
        while current:
            current.pop().finish()
    finally:
        while current:
            current.pop().abandon()


class _Bar:
    """A progress bar that appears after one second."""

    def __init__(self, name: str) -> None:
        from tqdm import tqdm

        self._bar = tqdm(total=100, desc=name, delay=_PATIENCE, file=sys.stderr, leave=True,
                         bar_format="{desc:28} {bar} {n:3.0f} % {elapsed}")

    def move(self, share: float) -> None:
        self._bar.update(max(0.0, 100 * min(share, 1.0) - self._bar.n))

    def finish(self) -> None:
        self._bar.close()

    abandon = finish


class _Line:
    """A line for logs when work of more than a second is done."""

    def __init__(self, name: str) -> None:
        self._name, self._start = name, time.monotonic()

    def move(self, share: float) -> None:
        """A log needs no bars."""

    def finish(self) -> None:
        elapsed = time.monotonic() - self._start
        if elapsed > _PATIENCE:
            print(f"{self._name:28} {elapsed:4.0f} s", file=sys.stderr)

    def abandon(self) -> None:
        """It was not finished."""

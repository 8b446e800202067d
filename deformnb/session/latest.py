"""A cache of one value: the last that was computed, by a key of its inputs."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

K = TypeVar("K")
V = TypeVar("V")


class Latest(Generic[K, V]):
    """The value of the last key; one thread at a time computes, each for the key of the moment at which it begins.

    Examples
    --------
    >>> squares = Latest()
    >>> squares.of(lambda: 3, lambda key: key**2), squares.of(lambda: 3, lambda key: 0)
    (9, 9)
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()  # guards the entry, and lets a second thread wait for the value of the first
        self._entry: tuple[K, V] | None = None

    def of(self, key: Callable[[], K], make: Callable[[K], V]) -> V:
        """The value of the present key; a value whose key has changed while it was computed is not stored.

        Parameters
        ----------
        key : returns the key of this moment.
        make : computes the value of a key; must not use this cache.
        """
        with self._lock:
            wanted = key()
            if self._entry is not None and self._entry[0] == wanted:
                return self._entry[1]
            made = make(wanted)
            if key() == wanted:
                self._entry = wanted, made
            return made

"""Callbacks that do not keep their owner alive."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import Any


def weakly(owner: Any, method: Callable[..., Any], is_open: Callable[[Any], bool] | None = None) -> Callable[..., None]:
    """A callback ``method(owner, ...)`` that does not keep its owner alive.

    It does nothing once the owner is deleted, or no longer open where ``is_open`` is given: threads, timers and
    observers that hold it must not keep an unused session or view alive.
    """
    reference = weakref.ref(owner)

    def call(*given: Any) -> None:
        found = reference()
        if found is not None and (is_open is None or is_open(found)):
            method(found, *given)

    return call

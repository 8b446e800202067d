"""Checks of what a page says to a view: each returns what it was given, or raises ValueError."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any

import traitlets

_LOG = logging.getLogger(__name__)

# A message of the page says little; only a screenshot is larger: 4096 x 4096 pixels of a noisy picture as PNG.
LONGEST_TEXT = 200
_LARGEST_PICTURE = 2**26

MEASURED = ("drag_ms", "full_ms", "passes", "frames", "scale", "width", "height", "received", "edits", "edit_ms")
"""What a page measures."""


def text(value: Any) -> str:
    """The name of a page's view."""
    if not isinstance(value, str) or len(value) > LONGEST_TEXT:
        raise ValueError("a view without a name")
    return value


def whole(value: Any, low: int, high: int) -> int:
    """A whole number within limits."""
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ValueError(f"a number that is not whole and between {low} and {high}")
    return value


def picture(buffers: list[Any]) -> bytes:
    """The one PNG of a message."""
    png = bytes(buffers[0]) if len(buffers) == 1 and memoryview(buffers[0]).nbytes <= _LARGEST_PICTURE else b""
    if not png.startswith(b"\x89PNG\r\n\x1a\n"):
        raise ValueError("a picture that is no PNG or too large")
    return png


def measured(content: dict[str, Any]) -> dict[str, float]:
    """The finite numbers among :data:`MEASURED`."""
    numbers = {name: float(content[name]) for name in MEASURED if isinstance(content.get(name), int | float)}
    return {name: value for name, value in numbers.items() if math.isfinite(value)}


@contextmanager
def dropping(what: str) -> Iterator[None]:
    """Whatever a page sends: a mistake is logged and dropped, never raised into the front end's channel."""
    try:
        yield
    except (traitlets.TraitError, ValueError, TypeError, KeyError) as error:
        _LOG.warning("%s of the page was dropped: %s", what, error)


def take_traits(said: Any, of_page: Collection[str], put: Callable[[dict[str, Any]], Any]) -> None:
    """Put what a page says of its widget's traits, one by one: a wrong one is logged, dropped, and costs no other.

    Parameters
    ----------
    said : values by name; of_page : the names a page may decide on.
    """
    for name, value in dict(said).items():
        with dropping("a trait"):
            if name not in of_page:
                raise ValueError(f"the page does not decide on {str(name)[:LONGEST_TEXT]!r}")
            put({name: value})

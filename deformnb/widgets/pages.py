"""The pages that show one view: how large each of them is, whether they are dark, and what they must know."""

from __future__ import annotations

import threading
from typing import Any

from deformnb.volume import Grid, Volume
from deformnb.widgets.shown_volume import ShownVolume
from deformnb.widgets.view_messages import whole

LARGEST = 4096
"""Pixels along a side of a picture at most."""

_MOST = 8  # of one view; an older one has been closed without a word


class Pages:
    """Sizes by name of a page; may be used by several threads.

    Examples
    --------
    >>> pages = Pages()
    >>> pages.put("a", {"width": 300, "height": 200, "background": "light"})
    >>> pages.size((720, 540)), pages.theme, bool(pages)
    ((300, 200), 'light', True)
    """

    def __init__(self) -> None:
        self.theme = "dark"
        self._lock = threading.Lock()
        self._sizes: dict[str, tuple[int, int]] = {}

    def __bool__(self) -> bool:
        return bool(self._sizes)

    def put(self, name: str, content: dict[str, Any]) -> None:
        """What a page says of itself: width and height in pixels, background; ValueError if that is wrong."""
        size = (whole(content.get("width"), 1, LARGEST), whole(content.get("height"), 1, LARGEST))
        with self._lock:
            self._sizes.pop(name, None)
            self._sizes[name] = size
            while len(self._sizes) > _MOST:
                del self._sizes[next(iter(self._sizes))]
        if content.get("background") in ("dark", "light"):
            self.theme = str(content["background"])

    def drop(self, name: str) -> None:
        """A page is closed."""
        with self._lock:
            self._sizes.pop(name, None)

    def size(self, default: tuple[int, int]) -> tuple[int, int]:
        """The largest of what the pages show."""
        with self._lock:
            return max(self._sizes.values(), key=lambda s: s[0] * s[1], default=default)


def about(volume: Volume, output: Grid | None) -> dict[str, Any]:
    """What a page must know to turn a camera around a volume: its axes, its sides and the box that is seen."""
    shown = ShownVolume(volume, volume.grid, (0.0, 1.0), (1, 1, 1), "", 0, 1.0)
    info = shown.info()
    names = ("axes", "views", "origin", "spacing", "to_frame", "unit")
    return {**{name: info[name] for name in names}, "box": shown.box(output)}

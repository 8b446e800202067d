"""Pictures on their way to pages: JPEG, numbered, and not more of them than pages have confirmed."""

from __future__ import annotations

import io
import threading
import time
from typing import Any

import numpy as np

from deformnb.widgets.scene_loop import Frame, Scene
from deformnb.widgets.stills import PREVIEW_SIZE, as_png
from deformnb.widgets.view import Image

_QUALITY = 85  # 600 x 600 pixels are 14 kB and take 1 ms; PNG and WebP take five times as long
_IN_FLIGHT = 2  # pictures that no page has confirmed: the second hides the way of the first
_LOST_AFTER = 2.0  # seconds; a page that was closed confirms nothing
_PREVIEW_SHARE = 0.6  # of a preview's pixels


class FrameSender:
    """Makes messages of frames and knows which of them have been seen; may be used by several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._number = self._last_bytes = self._bytes = 0
        self._unseen: dict[int, float] = {}
        self.last: Frame | None = None
        self._was_full = False  # whether someone was refused: the next confirmation draws again

    @property
    def may_send(self) -> bool:
        """Whether few enough pictures are on their way; once it was False, :meth:`seen` returns True."""
        with self._lock:
            now = time.monotonic()
            self._unseen = {n: at for n, at in self._unseen.items() if now - at < _LOST_AFTER}
            self._was_full = len(self._unseen) >= _IN_FLIGHT
            return not self._was_full

    def pack(self, frame: Frame, **content: Any) -> tuple[dict[str, Any], list[bytes]]:
        """The message of a frame, with more entries, and its buffers. It counts as sent."""
        buffers = [_jpeg(image) for image in frame.images]
        with self._lock:
            self._number += 1
            number = self._number
            self.last = frame
            self._unseen[number] = time.monotonic()
            self._last_bytes = sum(map(len, buffers))
            self._bytes += self._last_bytes
        return {"type": "frame", "seq": number, "full": frame.is_full, **content}, buffers

    def seen(self, number: int) -> bool:
        """A page shows the frame of this number. Returns whether someone was refused meanwhile."""
        with self._lock:
            self._unseen = {n: at for n, at in self._unseen.items() if n > number}
            was_full, self._was_full = self._was_full, False
            return was_full

    def forget(self) -> None:
        """Nobody is left who could confirm anything."""
        with self._lock:
            self._unseen.clear()
            self.last = None

    def stats(self) -> dict[str, int]:
        """``bytes_per_frame`` (of the last), ``frame_bytes`` (of all) and ``sent`` (how many)."""
        return {"bytes_per_frame": self._last_bytes, "frame_bytes": self._bytes, "sent": self._number}


def drawn(scene: Scene, size: tuple[int, int], shows: str, **options: Any) -> Image:
    """A picture of another size than the scene's own, which stays."""
    before = scene.size
    scene.set_size(size)
    try:
        image = scene.render(shows=shows, **options)
    finally:
        scene.set_size(before)
    assert image is not None
    return image


def preview_png(scene: Scene, shows: str) -> bytes:
    """A small picture as a PNG, from fewer pixels than it has: it must not hold up its cell."""
    from PIL import Image as Pillow

    few = Pillow.fromarray(drawn(scene, PREVIEW_SIZE, shows, scale=_PREVIEW_SHARE, coarseness=2.0))
    return as_png(np.asarray(few.resize(PREVIEW_SIZE, Pillow.Resampling.BICUBIC)))


def _jpeg(image: Image) -> bytes:
    from PIL import Image as Pillow

    stream = io.BytesIO()
    Pillow.fromarray(image).save(stream, format="JPEG", quality=_QUALITY)
    return stream.getvalue()

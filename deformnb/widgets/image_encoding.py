"""Pictures that are sent to front ends: PNG, and JPEG for the frames of a view that Python draws."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from deformnb._typing import Image
from deformnb.errors import DeformError

JPEG_QUALITY = 85
"""Of the frames of a view: 600 x 600 pixels are 14 kB and take 1 ms; PNG and WebP take five times as long."""

_COMPRESSION = 3  # of PNG, 0 to 9: 9 takes five times as long for a tenth less

PREVIEW_SIZE = (560, 420)
"""Width and height of a preview in pixels."""

PREVIEW_SHARE = 0.6
"""Share of its pixels that are drawn: a cell waits for its preview before it shows its widget."""


def as_png(image: Image) -> bytes:
    """A picture (height, width, 3) as PNG."""
    from PIL import Image as Pillow

    stream = io.BytesIO()
    Pillow.fromarray(image).save(stream, format="PNG", compress_level=_COMPRESSION)
    return stream.getvalue()


def as_jpeg(image: Image) -> bytes:
    """A picture (height, width, 3) as JPEG."""
    from PIL import Image as Pillow

    stream = io.BytesIO()
    Pillow.fromarray(image).save(stream, format="JPEG", quality=JPEG_QUALITY)
    return stream.getvalue()


def checked_png(png: Any) -> bytes:
    """The bytes of a picture that a front end has sent; DeformError if they are no PNG."""
    data = bytes(png)
    if not data.startswith(b"\x89PNG\r\n\x1a\n"):
        raise DeformError("the picture is no PNG.")
    return data


def from_png(png: bytes) -> Image:
    """The picture (height, width, 3) of a PNG."""
    from PIL import Image as Pillow

    return np.asarray(Pillow.open(io.BytesIO(png)).convert("RGB")).copy()

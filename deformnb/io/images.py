"""Pictures as volumes of one slice (read only): PNG, JPEG and others that Pillow reads, as grey values.

Rows of a picture run along y and columns along x, so that it stands upright when it is seen along z.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.io.headers import Header, fail, shown

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".webp")
_DEEP = {"I;16", "I;16B", "I;16L", "I;16N"}


def read_header(path: Path) -> Header:
    """The header of a picture: its colours become grey values (ITU-R 601), and it is turned as its camera says."""
    with _opened(path) as picture:
        sideways = picture.getexif().get(0x0112, 1) in (5, 6, 7, 8)
        width, height = reversed(picture.size) if sideways else picture.size
        deep = picture.mode in _DEEP
        notes = ["a picture was taken as a volume of one slice"]
        if picture.mode not in (*_DEEP, "L", "1"):
            notes.append("its colours became grey values")
        if getattr(picture, "n_frames", 1) > 1:
            notes.append("the first of its frames was read")
    dtype = np.dtype(np.uint16 if deep else np.uint8)
    return Header(path, (1, height, width), dtype, partial(_blocks, path, dtype), notes=tuple(notes),
                  working_bytes=5 * width * height)


@contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """The picture, not decoded yet; VolumeFileError for what is none, or is larger than any picture."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the memory is checked by the caller
            with Image.open(path, formats=("PNG", "JPEG", "BMP", "WEBP")) as picture:
                yield picture
    except UnidentifiedImageError:
        raise fail(path, "it is cut short or no picture.") from None
    except (Image.DecompressionBombError, SyntaxError) as error:
        raise fail(path, f"it cannot be read as a picture ({shown(error)}).") from None


def _blocks(path: Path, dtype: np.dtype[Any]) -> Iterator[NDArray[Any]]:
    from PIL import ImageOps

    with _opened(path) as picture:
        upright = ImageOps.exif_transpose(picture)
        yield np.asarray(upright if dtype.itemsize == 2 else upright.convert("L"), dtype=dtype)[None]

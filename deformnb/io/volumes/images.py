"""Pictures as volumes of one slice: PNG, JPEG and WebP, as grey values or in their colours.

Rows of a picture run along y and columns along x, so that it is upright when it is seen along z.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.io.files.atomic import atomic_write
from deformnb.io.files.errors import fail, printable
from deformnb.io.volumes.headers import Header, Layout
from deformnb.volume.channels import Channels
from deformnb.volume.volume import Volume

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp")
_DEEP = {"I;16", "I;16B", "I;16L", "I;16N"}


def read_header(path: Path) -> Header:
    """The header of a picture: its colours become grey values (ITU-R 601), and its orientation tag is applied."""
    with _open(path) as picture:
        sideways = picture.getexif().get(0x0112, 1) in (5, 6, 7, 8)
        width, height = reversed(picture.size) if sideways else picture.size
        deep = picture.mode in _DEEP
        notes = ["a picture was taken as a volume of one slice"]
        if picture.mode not in (*_DEEP, "L", "1"):
            notes.append("its colours became grey values")
        if getattr(picture, "n_frames", 1) > 1:
            notes.append("the first of its frames was read")
    dtype = np.dtype(np.uint16 if deep else np.uint8)
    return Header(
        path,
        (1, height, width),
        dtype,
        partial(_blocks, path, dtype),
        notes=tuple(notes),
        working_bytes=5 * width * height,
    )


def read_colour_header(path: Path) -> Header:
    """The header of a picture in its colours; that of :func:`read_header` for one that has none."""
    grey = read_header(path)
    with _open(path) as picture:
        if picture.mode in (*_DEEP, "L", "1", "I", "F"):
            return grey
        kind = "rgba" if picture.has_transparency_data else "rgb"
    notes = tuple(note for note in grey.notes if "grey" not in note)
    layout = Layout(1, len(kind), kind, interleaved=True)
    return replace(grey, layout=layout, notes=notes, blocks=partial(_colour_blocks, path, kind.upper()))


def write(volume: Volume, path: Path, overwrite: bool, progress: Progress | None) -> None:
    """Write a volume of one slice as a grey picture: 8 or 16 bits as PNG, 8 bits as JPEG and WebP."""
    values = volume.values.view(np.uint8) * 255 if volume.dtype == np.bool_ else volume.values
    _save(values, path, overwrite)


def write_colours(channels: Channels, path: Path, overwrite: bool) -> None:
    """Write colours of one slice as a picture."""
    values = channels.values
    if channels.kind == "rgba" and path.suffix.lower() in (".jpg", ".jpeg"):
        raise fail(path, "JPEG has no transparency, and these colours have; write a .png.")
    _save(values, path, overwrite)


def _save(values: NDArray[Any], path: Path, overwrite: bool) -> None:
    from PIL import Image

    kind = {".png": "PNG", ".webp": "WEBP"}.get(path.suffix.lower(), "JPEG")
    if values.shape[0] != 1:
        raise fail(
            path,
            f"a picture is one slice, and this volume has {values.shape[0]}; write .nrrd or .nii.gz, or "
            "one slice of it: Volume.from_array(volume.values[k]).",
        )
    deep = kind == "PNG" and values.ndim == 3
    if values.dtype != np.uint8 and not (deep and values.dtype == np.uint16):
        raise fail(
            path,
            f"pixels of {kind} are whole numbers of 8 bits{', or grey ones of 16' * (kind == 'PNG')}, and "
            f"these are {values.dtype}; scale them, or write .nrrd.",
        )
    settings: dict[str, dict[str, Any]] = {"WEBP": {"lossless": True}, "JPEG": {"quality": 95, "subsampling": 0}}
    with atomic_write(path, overwrite=overwrite) as file:
        Image.fromarray(np.ascontiguousarray(values[0])).save(file, kind, **settings.get(kind, {}))


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    """The picture, not decoded yet; VolumeFileError for no picture, or one larger than any picture."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the memory is checked by the caller
            with Image.open(path, formats=("PNG", "JPEG", "WEBP")) as picture:
                yield picture
    except UnidentifiedImageError:
        raise fail(path, "it is cut short or no picture.") from None
    except (Image.DecompressionBombError, SyntaxError) as error:
        raise fail(path, f"it cannot be read as a picture ({printable(error)}).") from None


def _colour_blocks(path: Path, mode: str) -> Iterator[NDArray[Any]]:
    from PIL import ImageOps

    with _open(path) as picture:
        yield np.asarray(ImageOps.exif_transpose(picture).convert(mode), dtype=np.uint8)[None]


def _blocks(path: Path, dtype: np.dtype[Any]) -> Iterator[NDArray[Any]]:
    from PIL import ImageOps

    with _open(path) as picture:
        upright = ImageOps.exif_transpose(picture)
        yield np.asarray(upright if dtype.itemsize == 2 else upright.convert("L"), dtype=dtype)[None]

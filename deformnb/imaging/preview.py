"""A preview of a marked picture by Pillow and NumPy alone, for readers of a notebook in which no front end runs.

It is made before a widget is shown, so neither JAX nor Matplotlib is imported for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Image
from deformnb.imaging.drawing import SOURCE, STYLES, TARGET
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture

_AIR = 0.01  # of the longer side, around a picture and its grid
_FINE = 2  # lines and discs are drawn so many times larger, for Pillow draws them with jagged edges
_LEVELS = np.arange(256)


def draw_preview(picture: Picture, lines: Sequence[NDArray[np.float64]], points: ControlPoints, size: int) -> Image:
    """A picture with its grid, and its points as lines from source to target.

    Parameters
    ----------
    lines : polylines (n, 2) in picture coordinates.
    size : pixels of the longer side of the drawing.

    Returns
    -------
    (height, width, 3) uint8.

    Examples
    --------
    >>> from deformnb.volume.plane import Plane, Raster
    >>> plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    >>> picture = Picture(np.zeros((30, 40), np.uint8), plane, Raster((30, 40), (1, 1), (0, 0)), "black", (0.0, 1.0))
    >>> draw_preview(picture, [], ControlPoints.empty(2), 102).shape
    (77, 102, 3)
    """
    from PIL import Image as Images
    from PIL import ImageDraw

    colours = STYLES["dark"]
    paper = _bytes(colours.paper)
    a0, a1, b0, b1 = picture.raster.box
    ends = np.concatenate([*lines, [[a0, b0], [a1, b1]]])
    low, high = ends.min(axis=0), ends.max(axis=0)
    air = _AIR * (high - low).max()
    low, high = low - air, high + air
    scale = _FINE * size / (high - low).max()
    width, height = np.ceil((high - low) * scale / _FINE - 1e-6).astype(int).tolist()
    canvas = Images.new("RGB", (_FINE * width, _FINE * height), paper)

    def at(places: Any) -> list[tuple[float, float]]:
        return [(float(x), float(y)) for x, y in (np.asarray(places) - low) * scale]

    (left, top), (right, bottom) = at([[a0, b0], [a1, b1]])
    extent = max(1, round(right - left)), max(1, round(bottom - top))
    canvas.paste(Images.fromarray(_ink(picture)).resize(extent, Images.Resampling.BILINEAR), (round(left), round(top)))
    draw = ImageDraw.Draw(canvas)
    for line in lines:
        draw.line(at(line), fill=_bytes(colours.grid), width=_FINE, joint="curve")
    sources, targets = at(points.source), at(points.target)
    for source, target, active in zip(sources, targets, points.active, strict=True):
        if active and source != target:
            draw.line([source, target], fill=_bytes(colours.ink), width=_FINE)
    for x, y in sources:
        draw.circle((x, y), 3 * _FINE, outline=_bytes(SOURCE), width=_FINE)
    for x, y in targets:
        draw.circle((x, y), 2.5 * _FINE, fill=_bytes(TARGET))
    return np.asarray(canvas.resize((width, height), Images.Resampling.BOX))


def _ink(picture: Picture) -> Image:
    """The pixels as in drawings of the dark style."""
    dark, bright = (np.array(_bytes(c)) for c in (STYLES["dark"].dark, STYLES["dark"].bright))
    if picture.values.ndim == 3 or picture.colour_map != "grey":
        return picture.rgb8(tuple(dark / 255))
    ramp = dark + (_LEVELS / 255)[:, None] * (bright - dark)
    return np.asarray((ramp + 0.5).astype(np.uint8)[(picture.grey() * 255 + 0.5).astype(np.uint8)])


def _bytes(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)

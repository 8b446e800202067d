"""Pictures of an editor: as the page gets them, and as a still where there is no page."""

from __future__ import annotations

import io
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.control_points import ControlPoints
from deformnb.cuts import Decoupled
from deformnb.fields import AbstractField
from deformnb.forward import warp_points
from deformnb.plane import Picture, Plane, Raster
from deformnb.warp import warp_picture

# Pixels along the longer side of an empty sheet: the arrow keys move points by one of them.
_SHEET = 200
_AIR = 0.2  # of the box of the points, on each side
_PREVIEW_DPI = 80  # 560 pixels along the longer side, some 100 kB in the notebook
_PARTS = 6  # of a grid line in a cell


def picture_png(picture: Picture) -> tuple[bytes, int]:
    """The picture as PNG and its channels: 1 for grey values, 3 for colours over black."""
    from PIL import Image

    is_grey = picture.values.ndim == 2
    pixels = (picture.grey() * 255 + 0.5).astype(np.uint8) if is_grey else picture.rgb8()
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, format="PNG")
    return stream.getvalue(), 1 if is_grey else 3


def raster_json(raster: Raster, channels: int) -> dict[str, Any]:
    """A raster as the page gets it."""
    return {"shape": list(raster.shape), "spacing": list(raster.spacing), "origin": list(raster.origin),
            "channels": channels}


def sheet(points: ControlPoints) -> Picture:
    """An empty picture around the points."""
    places = np.concatenate([points.source, points.target]) if len(points) else np.array([[0.0, 0.0], [100.0, 100.0]])
    low, high = places.min(axis=0), places.max(axis=0)
    longest = float((high - low).max()) or 100.0
    low, high = low - _AIR * longest, high + _AIR * longest
    d = float((high - low).max()) / _SHEET
    nu, nv = (max(1, round(float(v) / d)) for v in high - low)
    raster = Raster((nv, nu), (d, d), (float(low[0]) + d / 2, float(low[1]) + d / 2))
    return Picture(np.zeros((nv, nu), np.uint8), Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), raster, "sheet", (0.0, 1.0))


def grid_lines(raster: Raster, cells: int) -> list[NDArray[np.float64]]:
    """A net of square cells over a raster, ``cells`` along its longer side, as polylines (n, 2) that can bend."""
    a0, a1, b0, b1 = raster.box
    size = max(a1 - a0, b1 - b0) / cells
    across, down = max(1, round((a1 - a0) / size)), max(1, round((b1 - b0) / size))
    a, b = np.linspace(a0, a1, across * _PARTS + 1), np.linspace(b0, b1, down * _PARTS + 1)
    upright = [np.stack([np.full_like(b, x), b], axis=-1) for x in a[::_PARTS]]
    return upright + [np.stack([a, np.full_like(a, y)], axis=-1) for y in b[::_PARTS]]


def deformed_lines(lines: list[NDArray[np.float64]], fit: AbstractField) -> list[NDArray[np.float64]]:
    """Where lines of a picture are after its deformation, in pieces where the map folds and at cuts."""
    places = np.concatenate(lines)
    moved, found = warp_points(places, fit)
    region = np.zeros(len(places), dtype=int)
    if isinstance(fit, Decoupled):
        for k, (lies_there, _) in enumerate(fit.of_source(places)):
            region[lies_there] = k
    region[~found] = -1
    ends = np.cumsum([len(line) for line in lines])[:-1]
    pieces = []
    for line, label in zip(np.split(moved, ends), np.split(region, ends), strict=True):
        changes = np.flatnonzero(np.diff(label)) + 1
        runs = zip(np.split(line, changes), np.split(label, changes), strict=True)
        pieces += [run for run, of_run in runs if of_run[0] >= 0 and len(run) > 1]
    return pieces


def preview_png(picture: Picture, points: ControlPoints, fit: AbstractField, cells: int) -> bytes:
    """The deformed picture with its net and points."""
    from deformnb.drawing import draw_pictures

    lines = grid_lines(picture.raster, cells) if cells else []
    if points.displacement.any():  # most editors are shown before anything is dragged: no need to compile for that
        picture = replace(picture, values=warp_picture(picture.values, picture.raster, fit))
        lines = deformed_lines(lines, fit) if lines else []
    figure = draw_pictures([picture], nets=[lines], points=[points], style="dark")
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_PREVIEW_DPI, facecolor=figure.get_facecolor())
    return stream.getvalue()

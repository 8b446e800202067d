"""A live view's picture rendered by the core: for browsers without WebGL2, for scripts and for tests."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.fields import AbstractField
from deformnb.picture import project
from deformnb.plane import Plane
from deformnb.render import render_volume
from deformnb.transfer import TransferFunction
from deformnb.volume import Grid, Volume
from deformnb.warp import warp

Image = NDArray[np.uint8]

BACKGROUNDS = {"dark": (0.09, 0.097, 0.115), "light": (0.945, 0.948, 0.955)}
"""The middle tone of the view's two backgrounds."""

_INKS = {"dark": (0.97, 0.96, 0.93), "light": (0.09, 0.1, 0.13)}
_AIR = 1.02  # as in camera.js
_SMALLEST_SHARE = 0.62  # as in camera.js


def seen_height(grid: Grid, direction: Any, up: Any, aspect: float, zoom: float = 1.0) -> float:
    """The length in space that a view's picture is high; camera.js does the same.

    Parameters
    ----------
    grid : whose box is shown.
    aspect : width of the picture by its height.
    """
    plane = Plane.through(grid.center, direction, up)
    corners = np.abs(plane.to_plane(grid.corners()))
    far = grid.diagonal / 2
    tall = max(corners[:, 1].max(), corners[:, 0].max() / aspect, _SMALLEST_SHARE * far * min(1.0, 1 / aspect))
    return float(2 * _AIR * tall / zoom)


def render_still(volume: Volume, field: AbstractField | None, output: Grid | None, camera: dict[str, Any],
                 transfer: TransferFunction, projection: str, background: str, white: float,
                 size: tuple[int, int]) -> Image:
    """What a view with this camera shows, (height, width, 3).

    Parameters
    ----------
    volume : what is shown, before the deformation.
    output : grid whose box is seen.
    white : value that is white in a maximum projection.
    """
    warped = volume if field is None else warp(volume, field, output=output)
    box = output or volume.grid
    direction, up = camera["direction"], camera.get("up")
    aspect = size[0] / size[1]
    height = seen_height(box, direction, up, aspect, float(camera.get("zoom") or 1.0))
    plane = Plane.through(box.center, direction, up)
    right, above = (float(v) for v in camera.get("pan") or (0.0, 0.0))
    plane = replace(plane, origin=tuple(plane.from_plane([right, -above])))
    if projection == "mip":
        return _mip(warped, plane, height, size, background, white)
    return _composite(warped, plane, height, size, background, transfer)


def _composite(volume: Volume, plane: Plane, height: float, size: tuple[int, int], background: str,
               transfer: TransferFunction) -> Image:
    # The renderer looks at the middle of the volume: what is seen beside it is cut out of a larger picture.
    shift = plane.to_plane(volume.grid.center)[:2] * size[1] / height
    more = np.ceil(2 * np.abs(shift) - 1e-6).astype(int)  # no pixel more for a rounding error
    wide, tall = (int(n) for n in np.asarray(size) + more)
    image = render_volume(volume, transfer=transfer, direction=plane.normal, up=[-c for c in plane.v],
                          height=height * tall / size[1], size=(wide, tall), background=BACKGROUNDS[background],
                          backend="core")
    left, top = (int(n) for n in np.round(more / 2 - shift))
    return image[max(0, top) : max(0, top) + size[1], max(0, left) : max(0, left) + size[0]]


def _mip(volume: Volume, plane: Plane, height: float, size: tuple[int, int], background: str, white: float) -> Image:
    from PIL import Image as Pillow

    step = height / size[1]
    picture = project(volume, plane, "mip", spacing=max(min(volume.grid.spacing), step))
    low = volume.background
    share = np.clip((picture.values.astype(np.float64) - low) / max(white - low, 1e-12), 0, 1)
    a0, _, b0, _ = picture.raster.box
    d = picture.raster.spacing[0]
    places = (step / d, 0.0, (-size[0] / 2 * step - a0) / d, 0.0, step / d, (-size[1] / 2 * step - b0) / d)
    drawn = Pillow.fromarray(share.astype(np.float32)).transform(
        size, Pillow.Transform.AFFINE, places, Pillow.Resampling.BILINEAR, fillcolor=0)
    v = np.asarray(drawn)[..., None]
    color: NDArray[np.float64] = np.asarray(_INKS[background]) * v + np.asarray(BACKGROUNDS[background]) * (1 - v)
    return np.asarray(np.clip(color, 0, 1) * 255 + 0.5, dtype=np.uint8)

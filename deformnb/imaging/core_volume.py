"""A volume drawn by this package itself, the same on every machine: its ray caster's picture on a canvas."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3, Image, Progress
from deformnb.imaging.camera import Camera
from deformnb.imaging.projection import ProjectionName, project
from deformnb.imaging.raycast import PerspectiveCamera
from deformnb.volume.clip import ClipBox
from deformnb.volume.plane import Picture
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Volume


def draw_core(
    volume: Volume,
    camera: Camera,
    size: tuple[int, int],
    transfer: TransferFunction,
    background: Float3,
    *,
    projection: ProjectionName = "shaded",
    spacing: float | None = None,
    part: ClipBox | None = None,
    ambience: Volume | None = None,
    progress: Progress | None = None,
) -> Image:
    """A picture of a volume by light that passes through it.

    Parameters
    ----------
    size : (width, height) in pixels.
    background : red, green and blue in [0, 1].
    projection : "shaded" or "composite".
    spacing : distance of samples; default is that of the camera.
    part : the unclipped part; None for all.
    ambience : as for :func:`~deformnb.imaging.projection.project`.

    Returns
    -------
    (height, width, 3) uint8.
    """
    from PIL import Image as Pillow

    picture = project(
        volume,
        camera.plane,
        projection,
        transfer=transfer,
        part=part,
        eye=_eye(camera, size),
        spacing=camera.sample_distance(volume.grid, size[1]) if spacing is None else spacing,
        ambience=ambience,
        progress=progress,
    )
    drawn = Pillow.fromarray(picture.rgb8(background)).transform(
        size,
        Pillow.Transform.AFFINE,
        _places(picture, camera, size),
        Pillow.Resampling.BICUBIC,
        fillcolor=color_bytes(background),
    )
    return np.asarray(drawn)


def draw_core_mip(
    volume: Volume,
    camera: Camera,
    size: tuple[int, int],
    white: float,
    ink: Float3,
    background: Float3,
    *,
    part: ClipBox | None = None,
    progress: Progress | None = None,
) -> Image:
    """A picture of the largest value along each ray, from the background colour to that of the ink.

    Parameters
    ----------
    white : the value that has the colour of the ink.
    size, background, part : as for :func:`draw_core`.
    """
    from PIL import Image as Pillow

    spacing = max(min(volume.grid.spacing), camera.height / size[1])
    picture = project(
        volume, camera.plane, "mip", spacing=spacing, part=part, eye=_eye(camera, size), progress=progress
    )
    low = volume.background
    share = np.clip((picture.values.astype(np.float64) - low) / max(white - low, 1e-12), 0, 1)
    drawn = Pillow.fromarray(share.astype(np.float32)).transform(
        size, Pillow.Transform.AFFINE, _places(picture, camera, size), Pillow.Resampling.BILINEAR, fillcolor=0
    )
    v = np.asarray(drawn)[..., None]
    color: NDArray[np.float64] = np.asarray(ink) * v + np.asarray(background) * (1 - v)
    return np.asarray(np.clip(color, 0, 1) * 255 + 0.5, dtype=np.uint8)


def color_bytes(color: Float3) -> tuple[int, int, int]:
    """A colour in [0, 1] as numbers from 0 to 255."""
    r, g, b = (round(255 * min(max(c, 0.0), 1.0)) for c in color)
    return r, g, b


def _eye(camera: Camera, size: tuple[int, int]) -> PerspectiveCamera | None:
    if camera.distance is None:
        return None
    return PerspectiveCamera(camera.distance, camera.height * size[0] / size[1], camera.height)


def _places(picture: Picture, camera: Camera, size: tuple[int, int]) -> tuple[Any, ...]:
    """Places in a picture of the pixels of a canvas: the plane's origin is the middle of the canvas.

    A sample is never smaller than a pixel, so nothing is lost by taking each pixel from its own place; a resized image
    would have to be moved by half pixels.
    """
    a0, _, b0, _ = picture.raster.box
    d, step = picture.raster.spacing[0], camera.height / size[1]
    return step / d, 0.0, (-size[0] / 2 * step - a0) / d, 0.0, step / d, (-size[1] / 2 * step - b0) / d

"""A live view's picture rendered by the core: for browsers without WebGL2, for scripts and for tests."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.clipping import WHOLE, Clip, Part
from deformnb.fields import AbstractField
from deformnb.picture import project
from deformnb.plane import Picture, Plane
from deformnb.sight import Eye
from deformnb.transfer import TransferFunction
from deformnb.volume import Grid, Volume
from deformnb.warp import warp
from deformnb.widgets.camera import BACKGROUNDS, INKS, STANDOFF, Image, Progress, seen_height, within
from deformnb.widgets.shown_volume import ShownVolume, coarser, factors_of

PREVIEW_SIZE = (560, 420)
"""Width and height of a preview in pixels."""

# Samples in space count with the third power of the pixels' number: 0.6 makes a picture of 256^3 five times as fast.
_PREVIEW_SHARE = 0.6
_PREVIEW_VOXELS = 128**3


@dataclass(frozen=True, eq=False)
class Scene:
    """All that a picture of a view follows from; equal where the picture is.

    Parameters
    ----------
    shown : what is shown, before the deformation.
    output : grid whose box is seen.
    camera : as in :class:`~deformnb.widgets.view.CameraTrait`.
    background : a name of :data:`BACKGROUNDS`.
    shows : a name of :data:`~deformnb.widgets.view.SHOWS`.
    clip : the part of the box that is seen.
    """

    shown: ShownVolume
    field: AbstractField | None
    output: Grid | None
    camera: dict[str, Any]
    transfer: TransferFunction
    projection: str
    background: str
    shows: str
    clip: Clip = WHOLE

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Scene):
            return NotImplemented
        mine, others = vars(self), vars(other)
        # Fields are compared by identity: they never change, and comparing what they say costs as much as a picture.
        return all(mine[name] is others[name] or (name in _PLAIN and mine[name] == others[name]) for name in mine)

    __hash__ = None  # type: ignore[assignment]


_PLAIN = ("output", "camera", "transfer", "projection", "background", "shows", "clip")


def render_scene(scene: Scene, size: tuple[int, int], most: int | None = None,
                 progress: Progress | None = None) -> Image:
    """A picture of a scene, (height, width, 3); original and deformed share it where they are side by side.

    Parameters
    ----------
    most : voxels of the deformed volume at most; default is as many as there are.
    progress : called with the finished share from 0 to 1.
    """
    if scene.shows != "side_by_side":
        return _render(scene, size, scene.shows == "original", most, progress)
    left, height = size[0] // 2, size[1]
    halves = (_render(scene, (left, height), True, most, within(progress, 0.0, 0.5)),
              _render(scene, (size[0] - left, height), False, most, within(progress, 0.5, 1.0)))
    return np.concatenate(halves, axis=1)


def _render(scene: Scene, size: tuple[int, int], is_original: bool, most: int | None,
            progress: Progress | None = None) -> Image:
    shown, camera = scene.shown, scene.camera
    box = scene.output or shown.volume.grid
    lattice = scene.output if most is None else coarser(box, factors_of(box, most, most))
    field = None if is_original else scene.field
    warped = 0.0 if field is None else 0.3
    seen = shown.volume if field is None else warp(shown.volume, field, output=lattice,
                                                   progress=within(progress, 0.0, warped))
    sides, zoom = (camera["direction"], camera.get("up")), float(camera.get("zoom") or 1.0)
    height = seen_height(box, *sides, size[0] / size[1], zoom)
    plane = Plane.through(box.center, *sides)
    right, above = (float(v) for v in camera.get("pan") or (0.0, 0.0))
    plane = replace(plane, origin=tuple(plane.from_plane([right, -above])))
    part = Part.of(shown.volume.grid, scene.clip, scene.output or shown.original)
    eye = Eye(STANDOFF * height, height * size[0] / size[1], height) if camera.get("perspective") else None
    draw = _mip if scene.projection == "mip" else _composite
    return draw(scene, seen, plane, height, size, part, eye, within(progress, warped, 1.0))


def preview_png(scene: Scene) -> bytes:
    """A small picture with captions as a PNG, quickly: from fewer voxels and fewer pixels than it has."""
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    width, height = PREVIEW_SIZE
    few = (round(_PREVIEW_SHARE * width), round(_PREVIEW_SHARE * height))
    canvas = Pillow.fromarray(render_scene(scene, few, _PREVIEW_VOXELS)).resize(PREVIEW_SIZE, Pillow.Resampling.BICUBIC)
    captions = {"original": ["original"], "side_by_side": ["original", "deformed"]}.get(scene.shows, [])
    draw, ink = ImageDraw.Draw(canvas), tuple(round(255 * c) for c in INKS[scene.background])
    for k, caption in enumerate(captions):
        draw.text((10 + k * canvas.width / len(captions), 8), caption, fill=ink, font=ImageFont.load_default(14))
    return as_png(np.asarray(canvas))


def as_png(image: Image) -> bytes:
    """A picture (height, width, 3) as PNG."""
    from PIL import Image as Pillow

    stream = io.BytesIO()
    Pillow.fromarray(image).save(stream, format="PNG", compress_level=3)
    return stream.getvalue()


def from_png(png: bytes) -> Image:
    """The picture (height, width, 3) of a PNG."""
    from PIL import Image as Pillow

    return np.asarray(Pillow.open(io.BytesIO(png)).convert("RGB")).copy()


def _in_bytes(transfer: TransferFunction, low: float, high: float) -> TransferFunction:
    """The transfer function of the bytes that a window makes of values."""
    scale = 255 / (high - low)
    colors = tuple(((v - low) * scale, r, g, b) for v, r, g, b in transfer.colors)
    opacities = tuple(((v - low) * scale, alpha) for v, alpha in transfer.opacities)
    return TransferFunction(colors, opacities, transfer.unit)


def _composite(scene: Scene, volume: Volume, plane: Plane, height: float, size: tuple[int, int], part: Part | None,
               eye: Eye | None, progress: Progress | None) -> Image:
    from PIL import Image as Pillow

    # Bytes instead of the volume's own values: what the page has too, and a colour is looked up by value. Half a voxel
    # between two samples (a whole one makes surfaces grainy), or a pixel if that is larger.
    background = BACKGROUNDS[scene.background]
    picture = project(volume, plane, scene.projection, transfer=_in_bytes(scene.transfer, *scene.shown.window),
                      spacing=max(min(volume.grid.spacing) / 2, height / size[1]), part=part, eye=eye,
                      progress=progress)
    ink: Any = tuple(round(255 * c) for c in background)
    drawn = Pillow.fromarray(picture.rgb8(background)).transform(
        size, Pillow.Transform.AFFINE, _places(picture, height, size), Pillow.Resampling.BICUBIC, fillcolor=ink)
    return np.asarray(drawn)


def _mip(scene: Scene, volume: Volume, plane: Plane, height: float, size: tuple[int, int], part: Part | None,
         eye: Eye | None, progress: Progress | None) -> Image:
    from PIL import Image as Pillow

    picture = project(volume, plane, "mip", spacing=max(min(volume.grid.spacing), height / size[1]), part=part, eye=eye,
                      progress=progress)
    low, white = volume.background, 255 * scene.shown.white
    share = np.clip((picture.values.astype(np.float64) - low) / max(white - low, 1e-12), 0, 1)
    drawn = Pillow.fromarray(share.astype(np.float32)).transform(
        size, Pillow.Transform.AFFINE, _places(picture, height, size), Pillow.Resampling.BILINEAR, fillcolor=0)
    v, ground = np.asarray(drawn)[..., None], np.asarray(BACKGROUNDS[scene.background])
    color: NDArray[np.float64] = np.asarray(INKS[scene.background]) * v + ground * (1 - v)
    return np.asarray(np.clip(color, 0, 1) * 255 + 0.5, dtype=np.uint8)


def _places(picture: Picture, height: float, size: tuple[int, int]) -> tuple[float, ...]:
    """Where each pixel of a canvas lies in a picture: the plane's origin is the middle of the canvas."""
    a0, _, b0, _ = picture.raster.box
    d, step = picture.raster.spacing[0], height / size[1]
    return (step / d, 0.0, (-size[0] / 2 * step - a0) / d, 0.0, step / d, (-size[1] / 2 * step - b0) / d)

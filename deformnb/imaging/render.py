"""Shaded renderings of a volume in space, for stills: by VTK where OpenGL works, by this package itself elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._typing import Image, Progress
from deformnb.checks import finite_number, short_value
from deformnb.errors import DeformError
from deformnb.imaging.camera import Camera, check_color, check_size, fitting_height
from deformnb.imaging.core_volume import color_bytes, draw_core
from deformnb.imaging.vtk_volume import (
    VolumeWindow,
    check_gl,
    clip_outliers,
    gl_status,
    mark_modified,
    prepare_for_vtk,
    straight_image,
)
from deformnb.io.files.atomic import atomic_write
from deformnb.io.files.errors import printable
from deformnb.rbf.fields import Identity
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import PresetName, TransferFunction, as_transfer
from deformnb.volume.volume import Grid, Volume, VolumeLike, as_grid, as_volume
from deformnb.warping.points import Landmarks, check_points

_SMALLEST = 8  # letters that can still be read, in pixels


def render_volume(
    volume: VolumeLike,
    *,
    transfer: TransferFunction | PresetName | None = None,
    direction: ArrayLike = (0.4, 1.0, -0.3),
    up: ArrayLike | None = None,
    height: float | None = None,
    size: tuple[int, int] = (800, 600),
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    backend: RendererName = "auto",
    progress: Progress | None = None,
) -> Image:
    """A shaded picture of the whole volume, in parallel projection.

    Parameters
    ----------
    transfer : colours and opacities, or the name of a preset; default is "specimen".
    direction : viewing direction, of any length.
    up : direction that points up in the picture; default is +z, or -y for a view along z.
    height : length in space that the picture is high; default shows the whole box.
    size : (width, height) in pixels.
    background : red, green and blue in [0, 1].
    backend : a name of :data:`RENDERERS`, or "auto" for VTK where it works and "core" elsewhere.

    Returns
    -------
    (height, width, 3) uint8.

    Raises
    ------
    DeformError
        If an argument is invalid, or VTK was chosen and cannot draw here.

    Examples
    --------
    >>> from deformnb.datasets.phantoms import PHANTOMS
    >>> render_volume(PHANTOMS["bar"].make((8, 8, 16)), size=(64, 48), backend="core").shape
    (48, 64, 3)
    """
    volume = as_volume(volume)
    renderer = RENDERERS[find_renderer(backend)](as_transfer(transfer, volume), size, background)
    camera = _camera(volume.grid, direction, up, height, size)
    try:
        return renderer(volume, camera, progress)
    finally:
        renderer.close()


def _camera(
    grid: Grid, direction: ArrayLike, up: ArrayLike | None, height: float | None, size: tuple[int, int]
) -> Camera:
    plane = Plane.from_normal(grid.center, direction, up)
    if height is None:
        return Camera(plane, fitting_height(grid, plane, check_size(size)))
    wanted = "the height of the view must be a positive length"
    length = finite_number(height, wanted)
    if length <= 0:
        raise DeformError(f"{wanted}, got {length}.")
    return Camera(plane, length)


def image_places(
    points: ArrayLike | Landmarks,
    grid: Grid | VolumeLike,
    *,
    direction: ArrayLike = (0.4, 1.0, -0.3),
    up: ArrayLike | None = None,
    height: float | None = None,
    size: tuple[int, int] = (800, 600),
) -> NDArray[np.float64]:
    """Project places (..., 3) in space, or landmarks, to :func:`render_volume`'s picture of a volume on this grid.

    Parameters
    ----------
    direction, up, height, size : as they were given there.

    Returns
    -------
    (..., 2) pixels to the right and down, 0 in the middle of the first one.

    Examples
    --------
    >>> image_places([4.5, 0, 4.5], Grid((10, 10, 10)), direction=(0, 1, 0), height=10, size=(300, 200)).tolist()
    [149.5, 99.5]
    """
    places, camera = check_points(points, Identity(3), grid), _camera(as_grid(grid), direction, up, height, size)
    return camera.plane.to_plane(places)[..., :2] * (size[1] / camera.height) + (np.array(size) - 1) / 2


class CoreRenderer:
    """Pictures of volumes by this package itself, which are the same on every machine.

    Parameters
    ----------
    transfer, size, background : as for :func:`render_volume`.
    """

    def __init__(
        self,
        transfer: TransferFunction,
        size: tuple[int, int],
        background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self._transfer, self._size, self._background = transfer, check_size(size), check_color(background)

    def __call__(self, volume: Volume, camera: Camera, progress: Progress | None = None) -> Image:
        """The picture of a volume, (height, width, 3) uint8."""
        return draw_core(volume, camera, self._size, self._transfer, self._background, progress=progress)

    def close(self) -> None:
        """Do nothing: no resources."""


class VtkRenderer:
    """Pictures of volumes by VTK, whose window, shaders and textures of voxels are reused from picture to picture.

    All calls, and the last one to :meth:`close`, must come from one thread, which OpenGL requires. A picture after that
    opens another window.

    Parameters
    ----------
    transfer, size, background : as for :func:`render_volume`.
    """

    def __init__(
        self,
        transfer: TransferFunction,
        size: tuple[int, int],
        background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        self._transfer, self._size, self._background = transfer, check_size(size), check_color(background)
        self._window: VolumeWindow | None = None
        self._values: NDArray[Any] | None = None  # of the volume that is shown
        self._ready: Volume | None = None
        self._image: Any = None

    def __call__(self, volume: Volume, camera: Camera, progress: Progress | None = None) -> Image:
        """The picture of a volume, (height, width, 3) uint8."""
        if self._window is None:
            self._window = VolumeWindow(self._background)
        if volume.values is not self._values:
            self._show(self._window, prepare_for_vtk(clip_outliers(volume, self._transfer)))
            self._values = volume.values
        distance = camera.sample_distance(volume.grid, self._size[1])
        image = self._window.draw(camera, self._size, distance, progress=progress)
        assert image is not None
        return image

    def _show(self, window: VolumeWindow, volume: Volume) -> None:
        shown = self._ready
        if shown is not None and (shown.grid, shown.dtype) == (volume.grid, volume.dtype):
            shown.values[...] = volume.values
            mark_modified(self._image)
        else:
            self._ready, self._image = volume, straight_image(volume)
            window.load(self._image, volume.grid)
        window.set_transfer(self._transfer, volume.value_range)

    def close(self) -> None:
        """Release the resources of VTK."""
        window, self._window = self._window, None
        self._values = self._ready = self._image = None
        if window is not None:
            window.close()


RendererName: TypeAlias = Literal["auto", "vtk", "core"]
"""Names of the renderers, and "auto" for the one that works here."""

RENDERERS: dict[str, type[CoreRenderer | VtkRenderer]] = {"vtk": VtkRenderer, "core": CoreRenderer}
"""Renderers of many pictures of one size in the same colours, by name: "vtk" needs OpenGL, "core" needs nothing."""


def find_renderer(name: str) -> str:
    """The name of a renderer that works here, with "auto" resolved; DeformError for an unknown name."""
    if isinstance(name, str) and name == "auto":
        return "vtk" if gl_status()[0] else "core"
    if not isinstance(name, str) or name not in RENDERERS:
        raise DeformError(f"unknown renderer {short_value(name)}; choose auto, {' or '.join(RENDERERS)}.")
    if name == "vtk":
        check_gl()
    return name


def render_pair(
    before: VolumeLike,
    after: VolumeLike,
    *,
    path: str | PathLike[str] | None = None,
    captions: tuple[str, str] = ("before", "after"),
    transfer: TransferFunction | PresetName | None = None,
    direction: ArrayLike = (0.4, 1.0, -0.3),
    up: ArrayLike | None = None,
    size: tuple[int, int] = (900, 640),
    backend: RendererName = "auto",
    background: tuple[float, float, float] = (0.06, 0.065, 0.08),
    progress: Progress | None = None,
) -> Image:
    """Two volumes side by side, from the same side and to the same scale.

    ``size`` is that of one half; ``path`` writes a PNG, atomically. The transfer function is made for the
    volume before, so that unchanged parts look the same.

    Examples
    --------
    >>> from deformnb.datasets.phantoms import PHANTOMS
    >>> bar = PHANTOMS["bar"].make((8, 8, 16))
    >>> render_pair(bar, bar, size=(64, 48)).ndim
    3
    """
    before, after = as_volume(before), as_volume(after)
    function = as_transfer(transfer, before)
    size, background = check_size(size), check_color(background)
    if not isinstance(captions, Sequence) or [isinstance(text, str) for text in captions] != [True, True]:
        raise DeformError(f"captions are two texts, got {short_value(captions)}.")
    planes = [Plane.from_normal(v.grid.center, direction, up) for v in (before, after)]
    height = max(fitting_height(v.grid, p, size) for v, p in zip((before, after), planes, strict=True))
    halves = []
    for k, volume in enumerate((before, after)):
        part = None if progress is None else (lambda share, k=k: progress((k + share) / 2))
        halves.append(
            render_volume(
                volume,
                transfer=function,
                direction=direction,
                up=up,
                height=height,
                size=size,
                background=background,
                backend=backend,
                progress=part,
            )
        )
    halves = _trim(halves, background)
    image = np.concatenate([_add_caption(h, c, background) for h, c in zip(halves, captions, strict=True)], axis=1)
    if path is not None:
        save_image(image, path)
    return image


def _trim(images: list[Image], background: tuple[float, float, float], margin: float = 0.05) -> list[Image]:
    """The same part of all images: the bounding box of the foregrounds, with a margin and room for a caption."""
    seen = np.any([(np.abs(i.astype(int) - color_bytes(background)) > 3).any(axis=2) for i in images], axis=0)
    if not seen.any():
        return images
    ranges = []
    for axis, room in ((1, 2.2), (0, 1.0)):  # rows with a caption below, columns
        found, size = np.flatnonzero(seen.any(axis=axis)), seen.shape[1 - axis]
        air = margin * seen.shape[0]
        ranges.append(slice(max(0, round(found[0] - air)), min(size, round(found[-1] + 1 + room * air))))
    return [i[ranges[0], ranges[1]] for i in images]


def _add_caption(image: Image, caption: str, background: tuple[float, float, float]) -> Image:
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    canvas = Pillow.fromarray(image)
    ink = (235, 232, 226) if sum(background) < 1.5 else (40, 36, 30)
    draw, place, text = ImageDraw.Draw(canvas), (image.shape[1] / 2, image.shape[0] - 12), printable(caption)
    size = max(_SMALLEST, image.shape[0] // 28, image.shape[1] // 55)
    length = draw.textlength(text, ImageFont.load_default(size))
    if length > 0.96 * image.shape[1]:  # a long name is written smaller, and at last cut off
        size = max(_SMALLEST, int(size * 0.96 * image.shape[1] / length))
    draw.text(place, text, fill=ink, anchor="md", font=ImageFont.load_default(size))
    return np.asarray(canvas)


def save_image(image: Image, path: str | PathLike[str]) -> None:
    """Write (h, w, 3) uint8 as PNG, atomically."""
    from PIL import Image as Pillow

    with atomic_write(path) as stream:
        Pillow.fromarray(image).save(stream, format="PNG")

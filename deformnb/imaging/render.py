"""Shaded renderings of a volume in space, for stills: by VTK where OpenGL works, by this package itself elsewhere."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._typing import Image, Progress
from deformnb.errors import DeformError
from deformnb.imaging.projection import project
from deformnb.io.atomic import atomic_write
from deformnb.io.headers import shown
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import TransferFunction, preset, typical_range
from deformnb.volume.volume import Grid, Volume

_SMALLEST = 8  # letters that can still be read, in pixels

_PROBE = (
    "import vtkmodules.vtkRenderingOpenGL2\n"
    "from vtkmodules.vtkRenderingCore import vtkRenderWindow\n"
    "w = vtkRenderWindow(); w.SetOffScreenRendering(1); w.SetSize(8, 8); w.Render(); print(w.GetClassName())"
)
# The window classes that draw without a screen, best first. OSMesa is gone from newer Debians, EGL is in all.
_WINDOWS = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
_REMEDY = "apt-get install libegl1 libgl1 (Debian, Ubuntu); until then choose the renderer core"


@cache
def gl_status() -> tuple[bool, str, str]:
    """Check whether VTK can draw off screen here: (works, findings, packages to install).

    A missing library does not raise in VTK, it ends the process: so a child process tries, once, for about a second.
    """
    for name in _WINDOWS:
        environment = {**os.environ, "VTK_DEFAULT_OPENGL_WINDOW": name}
        try:
            run = subprocess.run([sys.executable, "-c", _PROBE], env=environment, capture_output=True, timeout=60,
                                 check=False, text=True)
        except (OSError, subprocess.TimeoutExpired):
            continue
        if run.returncode == 0:
            # Before the first window of this process: saves VTK's search for an X server and its warning.
            os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", name)
            return True, run.stdout.strip().splitlines()[-1] if run.stdout.strip() else name, ""
    return False, "VTK cannot draw off screen: no OpenGL library was found", _REMEDY


def render_volume(volume: Volume, *, transfer: TransferFunction | None = None, direction: ArrayLike = (0.4, 1.0, -0.3),
                  up: ArrayLike | None = None, height: float | None = None, size: tuple[int, int] = (800, 600),
                  background: tuple[float, float, float] = (0.0, 0.0, 0.0), backend: str = "auto",
                  progress: Progress | None = None) -> Image:
    """A shaded picture of the whole volume, in parallel projection.

    Parameters
    ----------
    transfer : colours and opacities; default is the preset "specimen".
    direction : where the viewer looks, any length.
    up : what points up in the picture; default is +z, or -y for a view along z.
    height : length in space that the picture is high; default shows the whole box.
    size : (width, height) in pixels.
    background : red, green and blue in [0, 1].
    backend : a name of :data:`RENDERERS`, or "auto" for VTK where it works and "core" elsewhere.

    Returns
    -------
    (height, width, 3) uint8.
    """
    chosen = renderer_named(backend)
    _check_size(size)
    if height is not None and not (np.isfinite(height) and height > 0):
        raise DeformError(f"the height of what is seen must be a positive length, got {height}.")
    function = preset("specimen", volume) if transfer is None else transfer
    plane = Plane.through(volume.grid.center, direction, up)
    tall = fitting_height(volume.grid, plane, size) if height is None else float(height)
    return RENDERERS[chosen](volume, function, plane, tall, size, background, progress)


class Scene:
    """Many pictures of one size in the same colours, as :func:`render_volume` makes them; closed at the end.

    What can be kept from picture to picture is kept: with VTK that is the window, its shaders and the voxels in its
    memory. All calls, and the last one to :meth:`close`, must come from one thread, which OpenGL requires.

    Parameters
    ----------
    transfer, size, background, backend : as for :func:`render_volume`.
    """

    def __init__(self, transfer: TransferFunction, size: tuple[int, int], *,
                 background: tuple[float, float, float] = (0.0, 0.0, 0.0), backend: str = "auto") -> None:
        _check_size(size)
        self._arguments = transfer, size, background
        self._draw = RENDERERS[renderer_named(backend)]
        self._window: _VtkScene | None = None

    def __call__(self, volume: Volume, plane: Plane, height: float, progress: Progress | None = None) -> Image:
        """The picture of a volume from a plane whose origin is the middle of the picture, ``height`` high in space."""
        transfer, size, background = self._arguments
        if self._draw is _render_vtk:
            self._window = self._window or _VtkScene(transfer, size, background)
            return self._window(volume, plane, height, progress)
        return self._draw(volume, transfer, plane, height, size, background, progress)

    def close(self) -> None:
        """Give back what VTK holds; a later picture takes it again."""
        window, self._window = self._window, None
        if window is not None:
            window.close()


def _check_size(size: tuple[int, int]) -> None:
    if len(size) != 2 or min(size) < 1 or any(int(n) != n for n in size):
        raise DeformError(f"the size of a picture is two whole numbers from 1 on, got {size}.")


def fitting_height(grid: Grid, plane: Plane, size: tuple[int, int]) -> float:
    """The length in space that a picture of a whole grid is high.

    Parameters
    ----------
    plane : the picture's.
    size : its (width, height) in pixels.
    """
    a, b, _ = np.ptp(plane.to_plane(grid.corners()), axis=0)
    return float(max(b, a * size[1] / size[0]) * 1.02)


def image_places(points: ArrayLike, grid: Grid, *, direction: ArrayLike = (0.4, 1.0, -0.3),
                 up: ArrayLike | None = None, height: float | None = None,
                 size: tuple[int, int] = (800, 600)) -> NDArray[np.float64]:
    """Project places (..., 3) in space to :func:`render_volume`'s picture of a volume on this grid.

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
    plane = Plane.through(grid.center, direction, up)
    tall = fitting_height(grid, plane, size) if height is None else height
    return plane.to_plane(points)[..., :2] * (size[1] / tall) + (np.array(size) - 1) / 2


def _sampling(volume: Volume, height: float, size: tuple[int, int]) -> float:
    """Distance of samples: half a voxel (a whole one makes surfaces grainy), or a pixel if that is larger."""
    return max(min(volume.grid.spacing) / 2, height / size[1])


def _render_core(volume: Volume, transfer: TransferFunction, plane: Plane, height: float, size: tuple[int, int],
                 background: tuple[float, float, float], progress: Progress | None) -> Image:
    from PIL import Image as Pillow

    picture = project(volume, plane, "shaded", transfer=transfer, progress=progress,
                      spacing=_sampling(volume, height, size))
    # The plane's origin is the middle of the canvas. A sample is never smaller than a pixel, so nothing is lost by
    # taking each pixel from its own place; a resized image would have to be moved by half pixels.
    a0, _, b0, _ = picture.raster.box
    (d, _), step = picture.raster.spacing, height / size[1]
    places = (step / d, 0.0, (-size[0] / 2 * step - a0) / d, 0.0, step / d, (-size[1] / 2 * step - b0) / d)
    drawn = Pillow.fromarray(picture.rgb8(background)).transform(
        size, Pillow.Transform.AFFINE, places, Pillow.Resampling.BICUBIC, fillcolor=_ink(background))
    return np.asarray(drawn)


def _ink(color: tuple[float, float, float]) -> tuple[int, int, int]:
    """A colour as numbers from 0 to 255."""
    r, g, b = (round(255 * min(max(c, 0.0), 1.0)) for c in color)
    return r, g, b


def _render_vtk(volume: Volume, transfer: TransferFunction, plane: Plane, height: float, size: tuple[int, int],
                background: tuple[float, float, float], progress: Progress | None) -> Image:
    scene = _VtkScene(transfer, size, background)
    try:
        return scene(volume, plane, height, progress)
    finally:
        scene.close()


class _VtkScene:
    """A window of VTK that is kept from picture to picture: its shaders are compiled once, its voxels overwritten.

    It must be used and closed by one thread, which OpenGL requires.
    """

    def __init__(self, transfer: TransferFunction, size: tuple[int, int],
                 background: tuple[float, float, float]) -> None:
        import pyvista

        # One lamp at the camera: the three of pyvista's kit dim what faces the viewer, and stain it where they meet.
        self._plotter: Any = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="none")
        self._plotter.add_light(pyvista.Light(light_type="headlight"))
        self._plotter.renderer.SetBackground(*background)
        self._transfer, self._size = transfer, size
        self._image: Any = None
        self._actor: Any = None
        self._is_of: Any = None
        self._values: Any = None

    def __call__(self, volume: Volume, plane: Plane, height: float, progress: Progress | None = None) -> Image:
        if volume.values is not self._values:
            self._show(for_vtk(clipped_for(volume, self._transfer)))
            self._values = volume.values
        plotter = self._plotter
        self._actor.mapper.SetSampleDistance(_sampling(volume, height, self._size))
        far = 2 * volume.grid.diagonal
        focus, n = np.asarray(plane.origin), np.asarray(plane.normal)
        plotter.camera_position = [tuple(focus - far * n), tuple(focus), tuple(-np.asarray(plane.v))]
        plotter.camera.parallel_projection = True
        plotter.camera.parallel_scale = height / 2
        plotter.renderer.ResetCameraClippingRange()
        plotter.render()  # a screenshot alone gives the last picture again
        image = np.asarray(plotter.screenshot(return_img=True))[..., :3].copy()
        if progress is not None:
            progress(1.0)
        return image

    def _show(self, volume: Volume) -> None:
        alike = (volume.grid, volume.dtype)
        if self._actor is not None and alike == self._is_of:
            self._image.active_scalars[:] = volume.values.reshape(-1)
            self._image.GetPointData().GetScalars().Modified()
            self._image.Modified()
            set_vtk_transfer(self._actor.prop, self._transfer, volume.value_range)
            return
        if self._actor is not None:
            self._plotter.remove_actor(self._actor)
        self._image, self._is_of = straight_image(volume), alike
        # The transfer function and its unit replace these choices, but pyvista makes them in any case.
        self._actor = self._plotter.add_volume(
            self._image, mapper="gpu", shade=True, show_scalar_bar=False, cmap="gray", opacity="linear",
            opacity_unit_distance=self._transfer.unit, reset_camera=False, render=False)
        self._actor.user_matrix = placement(volume.grid)
        set_vtk_transfer(self._actor.prop, self._transfer, volume.value_range)
        self._actor.mapper.SetAutoAdjustSampleDistances(False)

    def close(self) -> None:
        self._plotter.close()


def for_vtk(volume: Volume) -> Volume:
    """A volume as VTK draws it well: no NaN (it makes holes), no bool (pyvista drops them), background all around.

    VTK's body ends at the centres of the outermost voxels: one slice would have no thickness, and the face of a body
    that is cut off there no slope, which VTK paints black.
    """
    values = np.pad(volume.finite_values, 1, constant_values=volume.background)
    if np.ptp(volume.value_range) <= 1:  # VTK's slopes of whole numbers are black where a mask is flat
        values = values.astype(np.float32)
    nz, ny, nx = volume.shape
    return replace(volume, values=values, grid=volume.grid.crop((-1, -1, -1), (nz + 2, ny + 2, nx + 2)))


def straight_image(volume: Volume) -> Any:
    """The voxels for VTK with the axes and the first voxel where they are of no concern; see :func:`placement`.

    VTK's shader takes slopes along the axes of the voxels and does not turn them with the direction that an image may
    have: the face of a body in a turned image is lit as if it looked elsewhere. An actor's matrix turns both.
    """
    return replace(volume, grid=Grid(volume.shape, volume.grid.spacing)).to_pyvista()


def placement(grid: Grid) -> NDArray[np.float64]:
    """The matrix (4, 4) of an actor that puts a :func:`straight_image` where the grid is.

    Examples
    --------
    >>> placement(Grid((2, 2, 2), (2, 2, 2), origin=(5, 6, 7)))[:3, 3]
    array([5., 6., 7.])
    """
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = grid.direction, grid.origin
    return matrix


def clipped_for(volume: Volume, transfer: TransferFunction) -> Volume:
    """A volume without outliers that a transfer function cannot distinguish from the values beside them.

    VTK tabulates colours and opacities over all values that it is given, in 16384 entries at most: one voxel of 1e6 in
    a ramp of 0 to 100 would leave two of them to the ramp. What lies outside of the typical range and of the transfer
    function's window, where end values hold, is moved to the nearer end.

    Returns
    -------
    The same volume where no outlier stretches its range.

    Examples
    --------
    >>> values = np.arange(1000.0).reshape(10, 10, 10)
    >>> values[5, 5, 5] = 1e6
    >>> ramp = TransferFunction(((0, 1, 1, 1),), ((0, 0), (1200, 1)))
    >>> clipped_for(Volume.from_array(values), ramp).value_range
    (0.0, 1200.0)
    """
    (low, high), (first, last) = typical_range(volume), transfer.window
    smallest, largest = volume.value_range
    low, high = min(low, max(first, smallest)), max(high, min(last, largest))
    if (low, high) == (smallest, largest):
        return volume
    if volume.dtype.kind in "iu":
        low, high = np.floor(low), np.ceil(high)
    return replace(volume, values=np.clip(volume.finite_values, volume.dtype.type(low), volume.dtype.type(high)))


# VTK makes its tables as long as the smallest distance of two nodes requires, up to a power of two and 16384 at most.
_VTK_ENTRIES = 16000


def _vtk_nodes(transfer: TransferFunction, low: float, high: float) -> list[tuple[float, NDArray[np.float64]]]:
    """Nodes (value, colour and alpha) for VTK, at least an entry of its tables apart, and the first two just that.

    VTK reads its tables up to half an entry beside the value, and allows no two nodes at one value. So a jump ends two
    entries below its value, where what comes after it holds: at most 1/5000 of the range too early.
    """
    gap = ((high - low) or 1.0) / _VTK_ENTRIES
    values, rgba = transfer.knots()
    nodes = [(values[0] - 4 * gap, rgba[0]), (values[0] - 3 * gap, rgba[0])]
    crowds = np.split(np.arange(len(values)), np.flatnonzero(np.diff(values) >= gap) + 1)
    for crowd in crowds:
        at = values[crowd[-1]]
        jump = [(at - 3 * gap, rgba[crowd[0]]), (at - 2 * gap, rgba[crowd[-1]])]
        for value, color in [(at, rgba[crowd[0]])] if len(crowd) == 1 else jump:
            nodes.append((max(value, nodes[-1][0] + gap), color))
    return nodes


def set_vtk_transfer(prop: Any, transfer: TransferFunction, values: tuple[float, float]) -> None:
    """Give a volume's property in VTK the colours and opacities, and the light of all pictures.

    Parameters
    ----------
    values : the smallest and the largest one that VTK is given.
    """
    from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
    from vtkmodules.vtkRenderingCore import vtkColorTransferFunction

    colors, opacities = vtkColorTransferFunction(), vtkPiecewiseFunction()
    for value, (r, g, b, alpha) in _vtk_nodes(transfer, *values):
        colors.AddRGBPoint(value, r, g, b)
        opacities.AddPoint(value, alpha)
    prop.SetColor(colors)
    prop.SetScalarOpacity(opacities)
    prop.SetScalarOpacityUnitDistance(transfer.unit)
    prop.SetInterpolationTypeToLinear()
    prop.SetAmbient(0.35)
    prop.SetDiffuse(0.75)
    prop.SetSpecular(0.35)
    prop.SetSpecularPower(24)


RENDERERS: dict[str, Callable[..., Image]] = {"vtk": _render_vtk, "core": _render_core}
"""Ways to render, by name: "vtk" needs OpenGL, "core" needs nothing and is the same on every machine."""


def renderer_named(name: str) -> str:
    """The name of a renderer that works here, "auto" decided; DeformError if there is none of that name."""
    if name == "auto":
        return "vtk" if gl_status()[0] else "core"
    if name not in RENDERERS:
        raise DeformError(f"unknown renderer {name!r}; choose auto, {' or '.join(RENDERERS)}.")
    works, found, remedy = gl_status() if name == "vtk" else (True, "", "")
    if not works:
        raise DeformError(f"{found}; {remedy}.")
    return name


def render_pair(before: Volume, after: Volume, *, path: str | PathLike[str] | None = None,
                captions: tuple[str, str] = ("before", "after"), transfer: TransferFunction | None = None,
                direction: ArrayLike = (0.4, 1.0, -0.3), up: ArrayLike | None = None,
                size: tuple[int, int] = (900, 640), backend: str = "auto",
                background: tuple[float, float, float] = (0.06, 0.065, 0.08),
                progress: Progress | None = None) -> Image:
    """Two volumes side by side, from the same side and to the same scale.

    ``size`` is that of one half; ``path`` writes a PNG, whole or not at all. The transfer function is made for the
    volume before, so that what is not changed looks the same.
    """
    function = preset("specimen", before) if transfer is None else transfer
    planes = [Plane.through(v.grid.center, direction, up) for v in (before, after)]
    height = max(fitting_height(v.grid, p, size) for v, p in zip((before, after), planes, strict=True))
    halves = []
    for k, volume in enumerate((before, after)):
        part = None if progress is None else (lambda share, k=k: progress((k + share) / 2))
        halves.append(render_volume(volume, transfer=function, direction=direction, up=up, height=height,
                                    size=size, background=background, backend=backend, progress=part))
    halves = _trimmed(halves, background)
    image = np.concatenate([_captioned(h, c, background) for h, c in zip(halves, captions, strict=True)], axis=1)
    if path is not None:
        save_image(image, path)
    return image


def _trimmed(images: list[Image], background: tuple[float, float, float], margin: float = 0.05) -> list[Image]:
    """The same part of all images: what is not empty in any of them, with a margin and room for a caption."""
    seen = np.any([(np.abs(i.astype(int) - _ink(background)) > 3).any(axis=2) for i in images], axis=0)
    if not seen.any():
        return images
    ranges = []
    for axis, room in ((1, 2.2), (0, 1.0)):  # rows with a caption below, columns
        found, size = np.flatnonzero(seen.any(axis=axis)), seen.shape[1 - axis]
        air = margin * seen.shape[0]
        ranges.append(slice(max(0, round(found[0] - air)), min(size, round(found[-1] + 1 + room * air))))
    return [i[ranges[0], ranges[1]] for i in images]


def _captioned(image: Image, caption: str, background: tuple[float, float, float]) -> Image:
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    canvas = Pillow.fromarray(image)
    ink = (235, 232, 226) if sum(background) < 1.5 else (40, 36, 30)
    draw, place, text = ImageDraw.Draw(canvas), (image.shape[1] / 2, image.shape[0] - 12), shown(caption)
    size = max(_SMALLEST, image.shape[0] // 28, image.shape[1] // 55)
    length = draw.textlength(text, ImageFont.load_default(size))
    if length > 0.96 * image.shape[1]:  # a long name is written smaller, and at last cut off
        size = max(_SMALLEST, int(size * 0.96 * image.shape[1] / length))
    draw.text(place, text, fill=ink, anchor="md", font=ImageFont.load_default(size))
    return np.asarray(canvas)


def save_image(image: Image, path: str | PathLike[str]) -> None:
    """Write (h, w, 3) uint8 as PNG, whole or not at all."""
    from PIL import Image as Pillow

    with atomic_write(path) as stream:
        Pillow.fromarray(image).save(stream, format="PNG")

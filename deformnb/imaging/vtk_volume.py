"""A volume in a window of VTK: one place for light, colours, camera, samples and read-back.

Stills, frames of movies and the interactive views all draw with :class:`VolumeWindow`, so that exports look
like the view on the screen.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import cache
from importlib.util import find_spec
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._packages import install_command
from deformnb._typing import Image
from deformnb.errors import DeformError
from deformnb.imaging.camera import Camera
from deformnb.imaging.gl_context import WINDOW_CLASS, separate_from_glx, use_window_class
from deformnb.volume.transfer import TransferFunction, typical_range
from deformnb.volume.volume import Grid, Volume

_PROBE = (
    "import vtkmodules.vtkRenderingOpenGL2\n"
    "from vtkmodules.vtkRenderingCore import vtkRenderWindow\n"
    "w = vtkRenderWindow(); w.SetOffScreenRendering(1); w.SetSize(8, 8); w.Render(); print(w.GetClassName())"
)
# The window classes that draw without a screen, best first. OSMesa is missing in newer Debians, EGL is in all.
_WINDOWS = ("vtkEGLRenderWindow", "vtkOSOpenGLRenderWindow")
_REMEDY = "apt-get install libegl1 libgl1 (Debian, Ubuntu); until then choose the renderer core"


@cache
def gl_status() -> tuple[bool, str, str]:
    """Check whether VTK can draw off screen here: (works, findings, packages to install).

    A missing library does not raise in VTK, it ends the process: so a child process tries, once, for about a second.
    """
    if find_spec("vtkmodules") is None:
        return False, "VTK is not installed", f"{install_command('vtk')}; until then choose the renderer core"
    for name in _WINDOWS:
        environment = {**os.environ, WINDOW_CLASS: name}
        try:
            run = subprocess.run(
                [sys.executable, "-c", _PROBE],
                env=environment,
                capture_output=True,
                timeout=60,
                check=False,
                encoding="utf-8",
                errors="replace",  # names of drivers, in any encoding
            )
        except (OSError, subprocess.TimeoutExpired):
            continue
        if run.returncode == 0:
            return True, run.stdout.strip().splitlines()[-1] if run.stdout.strip() else name, ""
    return False, "VTK cannot draw off screen: no OpenGL library was found", _REMEDY


def check_gl() -> None:
    """Raise a DeformError that names the packages to install where VTK cannot draw."""
    works, found, remedy = gl_status()
    if not works:
        raise DeformError(f"{found}; {remedy}.")


_IN_SPACE = ("vtkActor", "vtkOpenGLActor")  # actors that look the same from any part of a camera
_LEAST_ROWS = 8  # of a part of a picture


class VolumeWindow:
    """An off-screen window of VTK with one volume, lit by one lamp at the camera.

    It must be used and closed by one thread, which OpenGL requires.

    Parameters
    ----------
    background : red, green and blue in [0, 1].

    Attributes
    ----------
    plotter : the ``pyvista.Plotter``; actors that are added to it are drawn too.
    actor : of the volume; None before :meth:`load`.
    """

    def __init__(self, background: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        import pyvista

        # One lamp at the camera: the three of pyvista's kit dim surfaces that face the viewer, and tint them.
        with use_window_class(gl_status()[1]):
            plotter: Any = pyvista.Plotter(off_screen=True, window_size=[8, 8], lighting="none")
        plotter.add_light(pyvista.Light(light_type="headlight"))
        plotter.render_window.SetMultiSamples(0)  # smooths edges of meshes, of which most scenes have none
        self._renderers = plotter.render_window.GetRenderers().GetNumberOfItems()
        self.plotter = plotter
        self.set_background(background)
        self.actor: Any = None
        self._grid: Grid | None = None
        self._range: tuple[float, float] | None = None  # the widest of the voxels in one actor

    def context(self) -> AbstractContextManager[None]:
        """A block in which its OpenGL context can be current, beside those of other programs in the same thread."""
        return separate_from_glx(self.plotter.render_window.ReleaseCurrent)

    def set_background(self, background: Sequence[float]) -> None:
        """Set the background colour."""
        self.plotter.renderer.SetBackground(*background)

    def load(self, image: Any, grid: Grid) -> None:
        """Draw other voxels, in a new actor.

        Parameters
        ----------
        image : a :func:`straight_image`, whose memory is shared: see :func:`mark_modified`.
        grid : where its voxels are.
        """
        self.unload()
        # The transfer function and its unit replace these choices, but pyvista makes them in any case.
        self.actor = self.plotter.add_volume(
            image,
            mapper="gpu",
            shade=True,
            show_scalar_bar=False,
            cmap="gray",
            opacity="linear",
            opacity_unit_distance=1.0,
            reset_camera=False,
            render=False,
        )
        self.actor.user_matrix = placement(grid)
        self.actor.mapper.SetAutoAdjustSampleDistances(False)
        self._grid, self._range = grid, None

    def unload(self) -> None:
        """Remove the volume."""
        if self.actor is not None:
            self.plotter.remove_actor(self.actor, render=False)
            self.actor = None

    def set_transfer(self, transfer: TransferFunction, values: tuple[float, float], projection: str = "shaded") -> None:
        """Set colours and opacities.

        Parameters
        ----------
        values : the smallest and the largest one of the volume. VTK makes its tables before it reads voxels that
            have been exchanged for others, so that the range of those before counts too: in a film's narrower range
            the nodes would be nearer than the tables are long.
        projection : "shaded", "composite" or "mip".
        """
        before = self._range or values
        self._range = (min(before[0], values[0]), max(before[1], values[1]))
        _set_transfer(self.actor.prop, transfer, self._range)
        self.actor.prop.SetShade(projection == "shaded")
        if projection == "mip":
            self.actor.mapper.SetBlendModeToMaximumIntensity()
        else:
            self.actor.mapper.SetBlendModeToComposite()

    def set_clipping_planes(self, planes: Sequence[Any]) -> None:
        """Cut the volume off at planes of VTK (and at no others)."""
        self.actor.mapper.RemoveAllClippingPlanes()
        for plane in planes:
            self.actor.mapper.AddClippingPlane(plane)

    def draw(
        self,
        camera: Camera,
        size: tuple[int, int],
        sample_distance: float,
        *,
        bands: int = 1,
        before: Callable[[int], None] | None = None,
        interrupted: Callable[[], bool] | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Image | None:
        """The picture, (height, width, 3) uint8.

        Parameters
        ----------
        size : (width, height) in pixels.
        sample_distance : length between two samples along a ray.
        bands : parts that are drawn one after the other, from above; one where there is a 2D overlay.
        before : called before each part with the rows of the picture that are below it.
        interrupted : called between two parts; if it returns True, the work is dropped and None returned.
        progress : called after each part with the finished share; an exception of it ends the work.
        """
        self._aim(camera)
        self.actor.mapper.SetSampleDistance(sample_distance)
        count = 1 if self._has_overlay() else max(1, min(bands, size[1] // _LEAST_ROWS))
        parts: list[Image] = []
        for top, bottom in pairwise(np.linspace(0, size[1], count + 1).astype(int).tolist()):
            if parts and interrupted is not None and interrupted():
                return None
            if before is not None:
                before(size[1] - bottom)
            with self.context():
                parts.append(self._band(camera, size, top, bottom))
            if progress is not None:
                progress(len(parts) / count)
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _aim(self, wanted: Camera) -> None:
        """Set the place of VTK's camera."""
        assert self._grid is not None
        plane, camera = wanted.plane, self.plotter.camera
        focus, n = np.asarray(plane.origin), np.asarray(plane.normal)
        away = 2 * self._grid.diagonal if wanted.distance is None else wanted.distance
        camera.SetFocalPoint(*focus)
        camera.SetPosition(*(focus - n * away))
        camera.SetViewUp(*(-np.asarray(plane.v)))
        camera.SetParallelProjection(wanted.distance is None)
        self.plotter.renderer.ResetCameraClippingRange()

    def _band(self, wanted: Camera, size: tuple[int, int], top: int, bottom: int) -> Image:
        """A band of rows of the picture: the view of a window of their height through its own part of the camera."""
        window, camera = self.plotter.render_window, self.plotter.camera
        share = (bottom - top) / size[1]
        camera.SetWindowCenter(0.0, (1 - (top + bottom) / size[1]) / share)
        camera.SetParallelScale(wanted.height / 2 * share)
        if wanted.distance is not None:
            camera.SetViewAngle(float(np.degrees(2 * np.arctan(share * wanted.height / 2 / wanted.distance))))
        window.SetSize(size[0], bottom - top)
        window.Render()
        return _pixels(window)

    def _has_overlay(self) -> bool:
        """Check for 2D overlays: they would be drawn once in every part."""
        if self.plotter.render_window.GetRenderers().GetNumberOfItems() > self._renderers:
            return True  # the corner with axes has a separate one
        return any(
            not prop.IsA("vtkVolume") and prop.GetClassName() not in _IN_SPACE
            for renderer in self.plotter.renderers
            for prop in renderer.GetViewProps()
        )

    def close(self) -> None:
        """Release the window and all memory of the GPU."""
        with self.context():
            self.unload()
            self.plotter.close()


def _pixels(window: Any) -> Image:
    """Read the pixels of a render window, (height, width, 3), without drawing it again."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

    width, height = window.GetSize()
    data = vtkUnsignedCharArray()
    window.GetPixelData(0, 0, width - 1, height - 1, 0, data, 0)
    rgb: Image = vtk_to_numpy(data).reshape(height, width, 3)  # type: ignore[no-untyped-call]
    return np.ascontiguousarray(rgb[::-1])


def mark_modified(image: Any) -> None:
    """Report that the voxels of a :func:`straight_image` were written over: VTK sends them with the next picture."""
    image.GetPointData().GetScalars().Modified()
    image.Modified()


def prepare_for_vtk(volume: Volume) -> Volume:
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


def clip_outliers(volume: Volume, transfer: TransferFunction) -> Volume:
    """A volume without outliers that a transfer function cannot distinguish from the values next to them.

    VTK tabulates colours and opacities over all values that it is given, in 16384 entries at most: one voxel of 1e6 in
    a ramp of 0 to 100 would leave two of them to the ramp. Values outside of the typical range and of the transfer
    function's window, where end values hold, is moved to the nearer end.

    Returns
    -------
    The same volume where no outlier stretches its range.

    Examples
    --------
    >>> values = np.arange(1000.0).reshape(10, 10, 10)
    >>> values[5, 5, 5] = 1e6
    >>> ramp = TransferFunction(((0, 1, 1, 1),), ((0, 0), (1200, 1)))
    >>> clip_outliers(Volume.from_array(values), ramp).value_range
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

    VTK reads its tables up to half an entry off the value, and allows no two nodes at one value. So a jump ends two
    entries below its value, where the next node is valid: at most 1/5000 of the range too early.
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


def _set_transfer(prop: Any, transfer: TransferFunction, values: tuple[float, float]) -> None:
    """Set the colours and opacities of a volume's property in VTK, and the light of all pictures.

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

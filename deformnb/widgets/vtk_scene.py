"""A volume, its deformation, a camera and colours as a scene of VTK, without a widget: for views, servers and movies.

All calls must come from one thread, which OpenGL asks for (see :mod:`~deformnb.widgets.worker`). The voxels go
to the card once. An edit sends maps of displacements, which VTK's shader looks up at every sample; where this version
of VTK cannot, the core warps the voxels and they are written over the old ones in place.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np

from deformnb.clipping import WHOLE, Clip, checked_clip
from deformnb.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.fields import AbstractField, Identity
from deformnb.plane import Plane
from deformnb.render import clipped_for, gl_status, placement, set_vtk_transfer
from deformnb.transfer import TransferFunction, preset
from deformnb.volume import Grid, Volume
from deformnb.widgets.camera import (
    BACKGROUNDS,
    INKS,
    SHOWS,
    STANDOFF,
    Image,
    checked_camera,
    known,
    seen_height,
    within,
)
from deformnb.widgets.card_maps import CardMaps, card_maps
from deformnb.widgets.vtk_folds import Folding
from deformnb.widgets.vtk_probe import cut_probe, is_like, probe, warped
from deformnb.widgets.vtk_voxels import SceneVoxels, clipping_planes, frame_of, white_of
from deformnb.widgets.vtk_warp import VolumeWarp
from deformnb.widgets.vtk_window import has_overlay, new_plotter, pixels

PROJECTIONS = ("shaded", "composite", "mip")


class VtkScene:
    """One volume in a window of VTK that nobody sees.

    Parameters
    ----------
    volume : what is shown; its voxels are copied once, with a margin.
    size : (width, height) of the picture in pixels.
    transfer : a transfer function or the name of a preset.
    projection : "shaded", "composite" or "mip".
    background : "dark" or "light".
    map_size : samples of a map of displacements along its longer side.
    space_size : samples along the longest side of a displacement that is no extrusion.
    method : "texture" deforms in the shader, "array" warps the voxels, "auto" tries the first (see
        :func:`texture_works`).

    Attributes
    ----------
    folding : ``folding.show`` paints red where the map folds; ``folding.remark`` says what that means here.

    Raises
    ------
    DeformError
        If VTK cannot draw here, or a name is unknown.
    """

    def __init__(self, volume: Volume, size: tuple[int, int] = (720, 540), *,
                 transfer: TransferFunction | str = "specimen", projection: str = "shaded", background: str = "dark",
                 map_size: int = 192, space_size: int = 64, method: str = "auto") -> None:
        works, found, remedy = gl_status()
        if not works:
            raise DeformError(f"{found}; {remedy}.")
        if method not in ("auto", "texture", "array"):
            raise DeformError(f"unknown method {method!r}; choose auto, texture or array.")
        self.path = ("texture" if texture_works() else "array") if method == "auto" else method
        self._is_trusted = method == "texture"
        self.folding = Folding(self._is_trusted)
        self._map_size, self._space_size = int(map_size), int(space_size)
        self._plotter = new_plotter()
        self._renderers = self._plotter.render_window.GetRenderers().GetNumberOfItems()
        self._actor: Any = None
        self._warp: VolumeWarp | None = None
        self._maps: CardMaps | None = None
        self._loaded: CardMaps | None = None  # what the shader has of them
        self._transfer: TransferFunction | None = None
        self._camera = checked_camera({})
        self._clip = WHOLE
        self.set_size(size)
        self.set_shows("deformed")
        self.set_background(background)
        self._projection = known(projection, PROJECTIONS, "projection")
        self._wanted_transfer = transfer
        self.set_volume(volume)

    # -- what is shown -------------------------------------------------------------------------------------------------

    @property
    def plotter(self) -> Any:
        """The ``pyvista.Plotter``: meshes, axes and clipping planes can be added; the camera is set by the scene."""
        self._plotter.render_window.SetSize(*self._size)  # not that of a part, for sizes of letters
        return self._plotter

    @property
    def volume(self) -> Volume:
        """What is shown, before the deformation."""
        return self._volume

    def set_volume(self, volume: Volume) -> None:
        """Show another volume, without deformation, from the same side."""
        self._volume = volume
        self._field: AbstractField | None = None
        self.folding.set(None)
        self._transfer = self._named(self._wanted_transfer)
        self._load(None)

    def set_field(self, field: Deformation | AbstractField | None, output: Grid | None = None) -> None:
        """Deform what is shown.

        Parameters
        ----------
        field : a document, a backward field in space, or None for the volume as it is.
        output : its box is what can be seen; default is the volume's own.
        """
        grid = self._volume.grid
        wanted = field.field(output or grid) if isinstance(field, Deformation) else field
        if wanted is not None and wanted.dim != 3:
            raise DeformError("a volume needs a field in space; extrude the field of a plane first.")
        if isinstance(wanted, Identity):
            wanted = None
        maps = None
        if wanted is not None and self._warp is not None:
            maps = card_maps(wanted, frame_of(self._volume), output, self._map_size, self._space_size)
            maps = maps if self._can(maps) else None  # and it is done in the voxels
        if output != self._output:
            self._load(output)
        self._field, self._maps = wanted, maps
        self.folding.set(maps, wanted, output or grid)

    def _can(self, maps: CardMaps) -> bool:
        """Whether the shader shows these rightly: not cuts of steps before the last, nor any where they fail."""
        has_cuts = bool((maps.content["planar"] or {}).get("cut"))
        is_early = maps.content["coarse"] or bool((maps.content["space"] or {}).get("cut"))
        return not is_early and (self._is_trusted or not has_cuts or cuts_work())

    def set_transfer(self, transfer: TransferFunction | str) -> None:
        """Show with other colours and opacities: a transfer function, or the name of a preset."""
        self._wanted_transfer = transfer
        self._transfer = self._named(transfer)
        if clipped_for(self._volume, self._transfer).value_range != self._voxels.volume.value_range:
            self._load(self._output)
            if self._field is not None:
                self.set_field(self._field, self._output)
        self._apply_looks()

    def _named(self, transfer: TransferFunction | str) -> TransferFunction:
        return preset(transfer, self._volume) if isinstance(transfer, str) else transfer

    def set_projection(self, projection: str) -> None:
        """Show "shaded", as "composite" without shading, or the largest value of each ray, "mip"."""
        self._projection = known(projection, PROJECTIONS, "projection")
        self._apply_looks()

    def set_background(self, background: str) -> None:
        """A "dark" or a "light" one."""
        self._background = known(background, tuple(BACKGROUNDS), "background")
        self._plotter.renderer.SetBackground(*BACKGROUNDS[background])
        self._apply_looks()

    def set_camera(self, camera: dict[str, Any]) -> None:
        """Look from another side: direction, up, zoom, pan and perspective as in a view's ``camera``."""
        self._camera = checked_camera(camera)

    def set_clip(self, clip: Clip) -> None:
        """Which part of the box is seen: shares along its axes as in a view's ``clip``."""
        self._clip = checked_clip(clip)
        self._apply_clip()

    def set_shows(self, shows: str) -> None:
        """What is seen, a name of :data:`~deformnb.widgets.view.SHOWS`; a picture of "flicker" is the deformed one."""
        self._shows = known(shows, tuple(SHOWS), "kind of picture")

    def set_size(self, size: tuple[int, int]) -> None:
        """Another (width, height) of the picture in pixels."""
        if len(size) != 2 or min(size) < 1 or any(int(n) != n for n in size):
            raise DeformError(f"the size of a picture is two whole numbers from 1 on, got {size}.")
        self._size = (int(size[0]), int(size[1]))

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture in pixels."""
        return self._size

    # -- pictures ------------------------------------------------------------------------------------------------------

    def render(self, *, scale: float = 1.0, coarseness: float = 1.0, shows: str | None = None, bands: int = 1,
               interrupted: Callable[[], bool] | None = None,
               progress: Callable[[float], None] | None = None) -> Image | None:
        """The picture, (height, width, 3) uint8.

        Parameters
        ----------
        scale : share of the size in pixels, for a quick picture.
        coarseness : samples lie this many times farther apart along a ray.
        shows : instead of what was set.
        bands : parts that are drawn one after the other, from above; one where the plotter has labels or axes.
        interrupted : asked between two parts; if it says True, the work is dropped and None returned.
        progress : called after each part with the finished share; what it raises ends the work.
        """
        width, height = (max(8, round(n * scale)) for n in self._size)
        kind = self._shows if shows is None else known(shows, tuple(SHOWS), "kind of picture")
        if kind != "side_by_side":
            return self._picture((width, height), kind != "original", coarseness, bands, interrupted, progress)
        left_half, right_half = (within(progress, first, first + 0.5) for first in (0.0, 0.5))
        left = self._picture((width // 2, height), False, coarseness, bands, interrupted, left_half)
        right = left if left is None else self._picture((width - width // 2, height), True, coarseness, bands,
                                                        interrupted, right_half)
        if left is None or right is None:
            return None
        return np.concatenate([left, right], axis=1)

    def _picture(self, size: tuple[int, int], deformed: bool, coarseness: float, bands: int,
                 interrupted: Callable[[], bool] | None, progress: Callable[[float], None] | None) -> Image | None:
        self._deform(deformed)
        seen = self._look(size)
        # Half a voxel (a whole one makes surfaces grainy), or a pixel if that is larger.
        self._actor.mapper.SetSampleDistance(max(min(self._volume.grid.spacing) / 2, seen / size[1]) * coarseness)
        count = 1 if has_overlay(self._plotter, self._renderers) else max(1, min(bands, size[1] // 8))
        rows = np.linspace(0, size[1], count + 1).astype(int)
        parts: list[Image] = []
        for top, bottom in pairwise(rows.tolist()):
            if parts and interrupted is not None and interrupted():
                return None
            parts.append(self._band(size, top, bottom, seen))
            if progress is not None:
                progress(len(parts) / count)
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def _band(self, size: tuple[int, int], top: int, bottom: int, seen: float) -> Image:
        """Some rows of the picture: what a window as high as they are sees through its own part of the camera."""
        window, camera = self._plotter.render_window, self._plotter.camera
        share = (bottom - top) / size[1]
        camera.SetWindowCenter(0.0, (1 - (top + bottom) / size[1]) / share)
        camera.SetParallelScale(seen / 2 * share)
        camera.SetViewAngle(float(np.degrees(2 * np.arctan(share / 2 / STANDOFF))))
        window.SetSize(size[0], bottom - top)
        if self._warp is not None:
            self._warp.set_row(size[1] - bottom)
        window.Render()
        return pixels(window)

    def _look(self, size: tuple[int, int]) -> float:
        """Put the camera in its place; the length in space that the picture is high."""
        wanted, box, camera = self._camera, self._output or self._volume.grid, self._plotter.camera
        plane = Plane.through(box.center, wanted["direction"], wanted["up"])
        seen = seen_height(box, wanted["direction"], wanted["up"], size[0] / size[1], wanted["zoom"])
        right, above = wanted["pan"]
        focus, n = plane.from_plane([right, -above]), np.asarray(plane.normal)
        bent = bool(wanted.get("perspective"))
        camera.SetFocalPoint(*focus)
        camera.SetPosition(*(focus - n * (seen * STANDOFF if bent else 2 * self._voxels.lattice.diagonal)))
        camera.SetViewUp(*(-np.asarray(plane.v)))
        camera.SetParallelProjection(not bent)
        self._plotter.renderer.ResetCameraClippingRange()
        return seen

    # -- VTK -----------------------------------------------------------------------------------------------------------

    def _load(self, output: Grid | None) -> None:
        """Voxels that reach as far as what can be seen, in a new actor."""
        assert self._transfer is not None
        self._output, self._voxels = output, SceneVoxels(clipped_for(self._volume, self._transfer), output)
        self._maps = self._loaded = None
        self._close_actor()
        self._actor = self._plotter.add_volume(self._voxels.image, mapper="gpu", shade=True, show_scalar_bar=False,
                                               cmap="gray", opacity="linear", reset_camera=False, render=False,
                                               opacity_unit_distance=1.0)
        self._actor.user_matrix = placement(self._voxels.lattice)
        self._actor.mapper.SetAutoAdjustSampleDistances(False)
        if self.path == "texture":
            self._plotter.render_window.SetSize(8, 8)
            self._plotter.render_window.Render()  # makes the context that textures live in
            self._warp = VolumeWarp(self._actor, self._plotter.render_window)
        self._apply_clip()
        self._apply_looks()

    def _apply_looks(self) -> None:
        if self._actor is None or self._transfer is None:
            return
        prop, mapper, values = self._actor.prop, self._actor.mapper, self._voxels.volume.value_range
        if self._projection == "mip":
            low, white = self._voxels.volume.background, white_of(self._volume)
            ink = INKS[self._background]
            ramp = TransferFunction(((low, *ink),), ((low, 0.0), (max(white, low + 1e-6), 1.0)))
            set_vtk_transfer(prop, ramp, values)
            mapper.SetBlendModeToMaximumIntensity()
        else:
            set_vtk_transfer(prop, self._transfer, values)
            mapper.SetBlendModeToComposite()
        prop.SetShade(self._projection == "shaded")
        if self._warp is not None:
            self._warp.set_projection(self._projection == "mip", self._projection == "shaded")

    def _apply_clip(self) -> None:
        if self._warp is not None:
            is_cut = np.not_equal(np.transpose(self._clip), [[0.0], [1.0]]).astype(float)
            self._warp.set_box(*self._voxels.box(self._clip), self._voxels.lattice, is_cut)
        elif self._actor is not None:
            self._actor.mapper.RemoveAllClippingPlanes()
            for plane in clipping_planes(self._voxels.lattice, self._voxels.kept(self._clip)):
                self._actor.mapper.AddClippingPlane(plane)

    def _deform(self, deformed: bool) -> None:
        wanted = deformed and self._field is not None
        if self._warp is not None:
            if self._maps is not self._loaded:
                self._warp.set_maps(self._maps, self._voxels.lattice, self._voxels.first)
                self._loaded = self._maps
            self._warp.set_strength(1.0 if wanted else 0.0)
            self._warp.set_folds(self.folding.is_red)
        # A shader cuts off by itself what lies outside of what is seen, and needs it for what comes from there.
        kept = None if self._warp is not None else self._voxels.kept(self._clip)
        if wanted and (self._warp is None or self._maps is None):
            self._voxels.write("warped", self._field, kept)
        else:
            is_whole = self._warp is not None or (self._output is None and kept is None)
            self._voxels.write("plain" if is_whole else "cropped", None, kept)

    def _close_actor(self) -> None:
        if self._warp is not None:
            self._warp.close()
            self._warp = None
        if self._actor is not None:
            self._plotter.remove_actor(self._actor, render=False)
            self._actor = None

    def close(self) -> None:
        """Give back the window and all that is on the card; a second time does nothing."""
        if self._plotter is not None:
            self._close_actor()
            self._plotter.close()
            self._plotter = None


@cache
def texture_works() -> bool:
    """Whether VTK's shader deforms as the core does: a small volume is drawn both ways and compared, once a process.

    To be called by a thread that renders. What VTK says of a shader that it cannot compile is not shown.
    """
    return _is_right(*probe())


@cache
def cuts_work() -> bool:
    """The same of displacements with cuts, whose text is another one."""
    return texture_works() and _is_right(*cut_probe())


def _is_right(volume: Volume, field: AbstractField) -> bool:
    from vtkmodules.vtkCommonCore import vtkObject

    says = vtkObject.GetGlobalWarningDisplay()
    vtkObject.GlobalWarningDisplayOff()
    try:
        got, wanted = _still_of(volume, field, "texture"), _still_of(warped(volume, field), None, "array")
    except DeformError:
        return False
    finally:
        vtkObject.SetGlobalWarningDisplay(says)
    return is_like(got, wanted, has_cuts=field.has_cuts)


def _still_of(volume: Volume, field: AbstractField | None, method: str) -> Image:
    scene = VtkScene(volume, (96, 96), transfer="surface", method=method)
    try:
        scene.set_field(field)
        image = scene.render()
        assert image is not None
        return image
    finally:
        scene.close()

"""VTK scene of a volume, its deformation, a camera and colours, without a widget: for views, servers and movies.

All calls must come from one thread, which OpenGL requires (see :mod:`~deformnb.widgets.worker`). The voxels go
to the GPU once. An edit sends maps of displacements, which VTK's shader samples at every step; where this version
of VTK cannot, the voxels are warped in Python and are written over the old ones in place.

The scene draws in a :class:`~deformnb.imaging.vtk_volume.VolumeWindow`, as stills and movies do, and adds what is
interactive: the deformation in the shader, the box, the visible part and folds. It takes from a volume its voxels
within the visible box, its frame, and its white value. A small volume and a deformation of which every part has a
visible effect check that a shader deforms rightly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage
from deformnb._typing import Floats, Image
from deformnb.checks import check_choice
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.imaging.camera import check_size
from deformnb.imaging.vtk_volume import (
    VolumeWindow,
    check_gl,
    clip_outliers,
    mark_modified,
    prepare_for_vtk,
    straight_image,
)
from deformnb.io.files.errors import human_bytes
from deformnb.io.files.memory import available_memory
from deformnb.rbf.cuts import Decoupled
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField, Composed, DisplacementField, Identity
from deformnb.rbf.regions import Line
from deformnb.volume.clip import WHOLE, Clip, check_clip, framed_box
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.transfer import PresetName, TransferFunction, as_transfer, levels
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import Warper
from deformnb.widgets.camera import (
    BACKGROUNDS,
    COMPARISONS,
    INKS,
    SHOWS,
    camera_of,
    checked_camera,
    comparison_image,
    partial_progress,
)
from deformnb.widgets.packed_volume import PackedVolume
from deformnb.widgets.textures import FieldTextures, field_textures
from deformnb.widgets.vtk.folds import Folding, mirrored_block
from deformnb.widgets.vtk.shader import VolumeWarp

IndexBox = tuple[Floats, Floats]
"""Lowest and highest index (i, j, k) of the visible part of a lattice."""


def pad_to_box(volume: Volume, output: Grid | None) -> tuple[Volume, NDArray[np.float64]]:
    """The volume with background around it up to the box of ``output``, and where its first voxel (i, j, k) is.

    Raises
    ------
    DeformError
        If there is no memory for that: a box of few voxels may be large, or far away.
    """
    grid = volume.grid if output is None else volume.grid.cover(output.corners())
    if grid.shape == volume.grid.shape:
        return volume, np.zeros(3)
    needed, free = 2 * grid.size * volume.dtype.itemsize, available_memory()  # another copy is made for VTK
    if needed > free:
        raise DeformError(
            f"to show this box in VTK takes {human_bytes(needed)} and {human_bytes(free)} are free; "
            "choose a box nearer to the volume, or a live view."
        )
    start = np.round(grid.point_to_index(volume.grid.origin))
    values = np.full(grid.shape, volume.dtype.type(volume.background))
    nz, ny, nx = volume.shape
    x, y, z = start.astype(int)
    values[z : z + nz, y : y + ny, x : x + nx] = volume.finite_values
    return replace(volume, values=values, grid=grid), start


def frame_of(volume: Volume) -> PackedVolume:
    """The frame of maps of displacements: lengths along the axes from the centre of the first voxel."""
    return PackedVolume(volume, volume.grid, (0.0, 1.0), (1, 1, 1), "", 0, 1.0)


def white_of(volume: Volume) -> float:
    """The value that is white in a maximum projection."""
    discrete = volume.is_labels or volume.dtype == np.bool_
    return volume.value_range[1] if discrete else levels(volume)[3]


class SceneVoxels:
    """The voxels that VTK draws, written over in place where its shader cannot deform.

    Parameters
    ----------
    volume : to show; its voxels are copied once, with a margin of background.
    output : its box is what can be seen; None for the volume's own.

    Attributes
    ----------
    image : what VTK has; lattice : where its voxels are; first : index (i, j, k) of the volume's first voxel there.
    written : the state of the voxels: their kind, the field that moved them, and the box outside of which is nothing.
    """

    def __init__(self, volume: Volume, output: Grid | None) -> None:
        around, start = pad_to_box(volume, output)
        ready = prepare_for_vtk(around)
        self.volume, self.output = volume, output
        self.lattice, self.first = ready.grid, start + 1
        self.image: Any = straight_image(ready)
        self.written: tuple[str, AbstractField | None, Any] = ("plain", None, None)
        self._values = ready.values
        self._plain: NDArray[Any] | None = None
        self._warper: Warper | None = None
        corners = self.lattice.point_to_index((output or volume.grid).corners())
        self._low, self._high = corners.min(axis=0), corners.max(axis=0)  # of what can be seen

    def box(self, clip: Clip) -> IndexBox:
        """Visible box of the lattice; without a field of view up to the centres of the background around."""
        shares, margin = np.asarray(clip), 0.5 if self.output is None else 0.0
        low, high = self._cut_at(shares)
        return (
            np.where(shares[:, 0] > 0, low, self._low - margin),
            np.where(shares[:, 1] < 1, high, self._high + margin),
        )

    def _cut_at(self, shares: Floats) -> IndexBox:
        length = self._high - self._low
        return self._low + shares[:, 0] * length, self._low + shares[:, 1] * length

    def clip_box(self, clip: Clip) -> IndexBox | None:
        """The whole indices between which voxels stay when others are emptied; None if all do."""
        if clip == WHOLE:
            return None
        shares, last = np.asarray(clip), np.asarray(self.lattice.shape[::-1]) - 1.0
        low, high = (np.round(side) for side in self._cut_at(shares))
        return np.where(shares[:, 0] > 0, low, 0.0), np.where(shares[:, 1] < 1, np.maximum(low, high), last)

    def write(self, kind: str, field: AbstractField | None, kept: IndexBox | None) -> None:
        """Have other voxels in the memory that VTK has, which it sends to the GPU with the next picture.

        Parameters
        ----------
        kind : "plain" for all there are, "cropped" for those that can be seen, "warped" for the volume that
            ``field`` has deformed.
        kept : outside of these indices is background.
        """
        state = (kind, field, None if kept is None else tuple(np.concatenate(kept)))
        if state[0] == self.written[0] and state[1] is self.written[1] and state[2] == self.written[2]:
            return
        if self._plain is None:
            self._plain = self._values.copy()  # only this method needs the voxels twice
        if kind == "plain":
            self._values[...] = self._plain
        else:
            self._put_inside(self._plain, field)
        if kept is not None:
            self._empty_around(kept)
        mark_modified(self.image)
        self.written = state

    def _put_inside(self, plain: NDArray[Any], field: AbstractField | None) -> None:
        """Only the voxels whose centres can be seen; around them is background."""
        low = np.ceil(self._low - 1e-6).astype(int)[::-1]
        high = np.floor(self._high + 1e-6).astype(int)[::-1] + 1
        inside = tuple(map(slice, low, high))
        self._values[...] = self.volume.background
        if field is None:
            self._values[inside] = plain[inside]
        else:
            part = self.volume.grid if self.output is None else self.lattice.crop(tuple(low), tuple(high - low))
            self._values[inside] = self._warper_for(part, field)(field).values

    def _empty_around(self, kept: IndexBox) -> None:
        for axis, (low, high) in enumerate(zip(*kept, strict=True)):
            along = np.moveaxis(self._values, 2 - axis, 0)
            along[: int(low)] = along[int(high) + 1 :] = self.volume.background

    def _warper_for(self, part: Grid, field: AbstractField) -> Warper:
        if self._warper is None or self._warper.output != part:
            self._warper = Warper(self.volume, output=part)
        if isinstance(field, Extrusion) and field.is_replication:
            axis = field.axis_of(self.volume.grid)
            if axis is not None:
                self._warper.prepare(axis)
        return self._warper


def clipping_planes(lattice: Grid, kept: IndexBox | None) -> list[Any]:
    """Planes of VTK on the sides of a box of indices: between a voxel and an emptied one is a skin of neither."""
    from vtkmodules.vtkCommonDataModel import vtkPlane

    planes: list[Any] = []
    last = np.asarray(lattice.shape[::-1]) - 1.0
    for sign, ends, open_at in () if kept is None else ((1.0, kept[0], np.zeros(3)), (-1.0, kept[1], last)):
        for axis in np.flatnonzero(ends != open_at):
            plane = vtkPlane()
            plane.SetOrigin(*lattice.index_to_point(np.where(np.arange(3) == axis, ends - sign * 1e-3, 0.0)))
            plane.SetNormal(*(sign * np.asarray(lattice.direction)[:, axis]))
            planes.append(plane)
    return planes


# Mean grey levels of 255 between two pictures of the volume below. Voxels that are warped before they are drawn are
# interpolated twice, which costs 1.1; a shader that deforms nothing is off by 13, one that forgets the slopes by 8, one
# that takes two deformations in the wrong order by 4.
_LIKE = 2.0


# Of the volume with cuts: cut faces have the colour of the inside in one of them, and of the values between it and
# nothing in the other, which costs 2.6; a shader that hides nothing is off by 4.8, one without slopes there by 3.7.
_LIKE_WITH_CUTS = 3.2


def is_like(image: Image, other: Image, *, has_cuts: bool = False) -> bool:
    """Check whether two pictures of a volume below, 96 x 96, show the same."""
    return float(np.abs(image.astype(int) - other.astype(int)).mean()) < (_LIKE_WITH_CUTS if has_cuts else _LIKE)


def probe() -> tuple[Volume, AbstractField]:
    """A bar without symmetry, moved by maps over an oblique plane that change with depth, after a shift in space."""
    grid = Grid((40, 48, 56), (0.6, 0.5, 0.7), (3.0, -5.0, 2.0))
    k, j, i = (a / n for a, n in zip(np.indices(grid.shape), grid.shape, strict=True))
    bar = np.maximum(np.abs(i - 0.5) / 0.3, np.maximum(np.abs(j - 0.45) / 0.16, np.abs(k - 0.55) / 0.2))
    ball = np.sqrt((i - 0.35) ** 2 + (j - 0.6) ** 2 + (k - 0.35) ** 2) / 0.22
    volume = Volume((np.clip(4 * (1.2 - np.minimum(bar, ball)), 0, 1) * 200).astype(np.uint8), grid)
    plane = Plane.from_normal(grid.center, (1.0, 2.0, -0.7))
    ripple = np.array(
        [
            [[2.0, 0.0], [-3.0, 2.0], [0.0, 3.0]],
            [[4.0, -2.0], [0.0, 5.0], [-4.0, 1.0]],
            [[0.0, 2.0], [3.0, 0.0], [2.0, -3.0]],
        ]
    )
    maps = tuple(DisplacementField(a, Raster((3, 3), (12.0, 10.0), (-12.0, -10.0))) for a in (ripple, -ripple[::-1]))
    bend = Extrusion(plane, plane.depth_range(grid), maps, np.array([0.2, 0.9]), np.eye(2))
    shift = np.zeros((2, 2, 2, 3))
    shift[1, ..., 0], shift[:, 1, :, 2] = 3.0, -2.0
    lattice = Grid((2, 2, 2), grid.lengths, grid.origin)
    return volume, Composed(DisplacementField(shift, lattice), bend)


def cut_probe() -> tuple[Volume, AbstractField]:
    """The same bar, cut along two lines and pulled apart, more at one end than at the other."""
    volume, moved = probe()
    grid = volume.grid
    plane = Plane.from_normal(grid.center, (0.3, 2.0, -0.5))
    lines = (Line(((-2.0, -9.0), (3.0, 9.0))), Line(((-9.0, 1.0), (9.0, 3.0))))
    sides = ((False, False), (False, True), (True, False))
    pulls = ((4.0, -2.0), (3.0, 3.0), (-3.0, -2.0))
    box = Raster((2, 2), (1.0, 1.0), (0.0, 0.0))
    fields = tuple(
        Extrusion(
            plane,
            plane.depth_range(grid),
            (DisplacementField(np.full((2, 2, 2), pull), box),),
            np.array([0.0, 1.0]),
            np.array([[0.4, 1.0]]),
        )
        for pull in pulls
    )
    assert isinstance(moved, Composed)
    return volume, Composed(moved.first, Decoupled(fields, sides, lines, plane, "source", 0.6))


def warp_volume(volume: Volume, field: AbstractField) -> Volume:
    """As :func:`deformnb.warping.warper.warp` does it, without the second that it takes to compile."""
    index = np.moveaxis(np.indices(volume.shape)[::-1], 0, -1)
    points = volume.grid.index_to_point(index)
    at = volume.grid.point_to_index(points + field.displacement(points))
    values = ndimage.map_coordinates(volume.values, np.moveaxis(at, -1, 0)[::-1], order=1, mode="grid-constant")
    opacity = field.opacity(points)  # of which little is one where the background is zero
    return replace(volume, values=(values * opacity).astype(values.dtype))


VOLUME_PROJECTIONS = ("shaded", "composite", "mip")


class ShaderMaps:
    """Deformation in VTK's shader, which samples maps of displacements.

    Parameters
    ----------
    map_size, space_size : samples, as of a scene.
    shows_cuts : whether the shader shows cuts rightly.

    Attributes
    ----------
    warp : the shader; None where there is none, and before :meth:`open`.
    maps : those to sample; None for no deformation, and where it is done in the voxels.
    """

    def __init__(self, map_size: int, space_size: int, shows_cuts: Callable[[], bool]) -> None:
        self._map_size, self._space_size, self._shows_cuts = map_size, space_size, shows_cuts
        self.warp: VolumeWarp | None = None
        self.maps: FieldTextures | None = None
        self._loaded: FieldTextures | None = None  # the part in the shader
        self._window: VolumeWindow | None = None

    def maps_of(self, field: AbstractField, volume: Volume, output: Grid | None) -> FieldTextures | None:
        """The maps of a field; None where the shader does not show them rightly.

        It does not show cuts of steps before the last, nor any where they fail.
        """
        if self.warp is None:
            return None
        maps = field_textures(field, frame_of(volume), output, self._map_size, self._space_size)
        has_cuts = maps.content.planar is not None and maps.content.planar["cut"] is not None
        is_early = maps.content.coarse or (maps.content.space is not None and maps.content.space.get("cut") is not None)
        return None if is_early or (has_cuts and not self._shows_cuts()) else maps

    def open(self, window: VolumeWindow) -> None:
        """Take the shader of a window's present content."""
        render_window = window.plotter.render_window
        render_window.SetSize(8, 8)
        with window.context():
            render_window.Render()  # makes the context that textures live in
            self.warp = VolumeWarp(window.actor, render_window)
        self._window = window

    def load(self, voxels: SceneVoxels) -> None:
        """Have the shader sample the maps in these voxels."""
        if self.warp is not None and self._window is not None and self.maps is not self._loaded:
            with self._window.context():
                self.warp.set_maps(self.maps, voxels.lattice, voxels.first)
            self._loaded = self.maps

    def close(self) -> None:
        """Release the memory of the GPU."""
        if self.warp is not None and self._window is not None:
            with self._window.context():
                self.warp.close()
        self.warp = self.maps = self._loaded = self._window = None


class VtkScene:
    """One volume in an off-screen window of VTK.

    Parameters
    ----------
    volume : to show; its voxels are copied once, with a margin.
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
    voxels : those that VTK draws; shader : the deformation in its shader.
    folding : ``folding.show`` paints red where the map folds; ``folding.remark`` explains what that means here.

    Raises
    ------
    DeformError
        If VTK cannot draw here, or a name is unknown.
    """

    def __init__(
        self,
        volume: Volume,
        size: tuple[int, int] = (720, 540),
        *,
        transfer: TransferFunction | PresetName = "specimen",
        projection: str = "shaded",
        background: str = "dark",
        map_size: int = 192,
        space_size: int = 64,
        method: str = "auto",
    ) -> None:
        check_gl()
        if method not in ("auto", "texture", "array"):
            raise DeformError(f"unknown method {method!r}; choose auto, texture or array.")
        self.path = ("texture" if texture_works() else "array") if method == "auto" else method
        is_trusted = method == "texture"
        self.folding = Folding(None if is_trusted else folds_work)
        self.shader = ShaderMaps(int(map_size), int(space_size), (lambda: True) if is_trusted else cuts_work)
        self._window: VolumeWindow | None = VolumeWindow()
        self._transfer: TransferFunction | None = None
        self._camera = checked_camera({})
        self._parts = {"clip": WHOLE, "frame": WHOLE}  # of the box: what is seen, and what the camera frames
        self.set_size(size)
        self.set_shows("deformed")
        self.set_background(background)
        self._projection = check_choice(projection, VOLUME_PROJECTIONS, "projection")
        self._wanted_transfer = transfer
        self.set_volume(volume)

    # -- display -------------------------------------------------------------------------------------------------------

    @property
    def plotter(self) -> Any:
        """The ``pyvista.Plotter``: meshes, axes and clipping planes can be added; the camera is set by the scene."""
        plotter = self._vtk_window.plotter
        plotter.render_window.SetSize(*self._size)  # not that of a part, for sizes of letters
        return plotter

    @property
    def _vtk_window(self) -> VolumeWindow:
        if self._window is None:
            raise DeformError("this scene was closed; make another one.")
        return self._window

    @property
    def volume(self) -> Volume:
        """Volume before the deformation."""
        return self._volume

    def set_volume(self, volume: Volume) -> None:
        """Show another volume, without deformation, from the same side."""
        self._volume = volume
        self._field: AbstractField | None = None
        self.folding.set(None)
        self._transfer = as_transfer(self._wanted_transfer, volume)
        self._load(None)

    def set_field(self, field: Deformation | AbstractField | None, output: Grid | None = None) -> None:
        """Set the field that deforms the volume.

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
        maps = None if wanted is None else self.shader.maps_of(wanted, self._volume, output)
        if output != self.voxels.output:
            self._load(output)
        self._field, self.shader.maps = wanted, maps
        self.folding.set(maps, wanted, output or grid)

    def set_transfer(self, transfer: TransferFunction | PresetName) -> None:
        """Show with other colours and opacities: a transfer function, or the name of a preset."""
        self._wanted_transfer = transfer
        self._transfer = as_transfer(transfer, self._volume)
        if clip_outliers(self._volume, self._transfer).value_range != self.voxels.volume.value_range:
            self._load(self.voxels.output)
            if self._field is not None:
                self.set_field(self._field, self.voxels.output)
        self._apply_display()

    def set_projection(self, projection: str) -> None:
        """Show "shaded", as "composite" without shading, or the largest value of each ray, "mip"."""
        self._projection = check_choice(projection, VOLUME_PROJECTIONS, "projection")
        self._apply_display()

    def set_background(self, background: str) -> None:
        """A "dark" or a "light" one."""
        self._background = check_choice(background, BACKGROUNDS, "background")
        self._vtk_window.set_background(BACKGROUNDS[background])
        self._apply_display()

    def set_camera(self, camera: dict[str, Any]) -> None:
        """Set the camera: direction, up, zoom, pan and perspective as in a view's ``camera``."""
        self._camera = checked_camera(camera)

    def set_frame(self, frame: Clip) -> None:
        """Frame a part of the volume's box, as a view's ``frame``."""
        self._parts["frame"] = check_clip(frame)

    def set_clip(self, clip: Clip) -> None:
        """Clip the box: shares along its axes as in a view's ``clip``."""
        self._parts["clip"] = check_clip(clip)
        self._apply_clip()

    def set_shows(self, shows: str) -> None:
        """Set the display mode, a name of :data:`SHOWS`; a picture of "flicker" is the deformed one."""
        self._shows = check_choice(shows, SHOWS, "kind of picture")

    def set_size(self, size: tuple[int, int]) -> None:
        """Another (width, height) of the picture in pixels."""
        self._size = check_size(size)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the picture in pixels."""
        return self._size

    # -- pictures ------------------------------------------------------------------------------------------------------

    def render(
        self,
        *,
        scale: float = 1.0,
        coarseness: float = 1.0,
        shows: str | None = None,
        bands: int = 1,
        interrupted: Callable[[], bool] | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Image | None:
        """The picture, (height, width, 3) uint8.

        Parameters
        ----------
        scale : share of the size in pixels, for a quick picture.
        coarseness : samples are this many times farther apart along a ray.
        shows : instead of the present mode.
        bands : parts that are drawn one after the other, from above; one where the plotter has labels or axes.
        interrupted : called between two parts; if it returns True, the work is dropped and None returned.
        progress : called after each part with the finished share; its exceptions end the work.
        """
        width, height = (max(8, round(n * scale)) for n in self._size)
        kind = self._shows if shows is None else check_choice(shows, SHOWS, "kind of picture")
        if kind not in ("side_by_side", *COMPARISONS):
            return self._picture((width, height), kind != "original", coarseness, bands, interrupted, progress)
        widths = (width, width) if kind in COMPARISONS else (width // 2, width - width // 2)
        first, second = (partial_progress(progress, start, start + 0.5) for start in (0.0, 0.5))
        left = self._picture((widths[0], height), False, coarseness, bands, interrupted, first)
        right = (
            left if left is None else self._picture((widths[1], height), True, coarseness, bands, interrupted, second)
        )
        if left is None or right is None:
            return None
        return comparison_image(kind, left, right)

    def _picture(
        self,
        size: tuple[int, int],
        deformed: bool,
        coarseness: float,
        bands: int,
        interrupted: Callable[[], bool] | None,
        progress: Callable[[float], None] | None,
    ) -> Image | None:
        self._deform(deformed)
        framed = framed_box(self._volume.grid, self.voxels.output, self._parts["frame"])
        camera = camera_of(self._camera, framed, size[0] / size[1])
        distance = camera.sample_distance(self._volume.grid, size[1]) * coarseness
        return self._vtk_window.draw(
            camera,
            size,
            distance,
            bands=bands,
            interrupted=interrupted,
            progress=progress,
            before=None if self.shader.warp is None else self.shader.warp.set_row,
        )

    # -- VTK -----------------------------------------------------------------------------------------------------------

    def _load(self, output: Grid | None) -> None:
        """Voxels that reach as far as what can be seen, in a new actor."""
        assert self._transfer is not None
        self.voxels = SceneVoxels(clip_outliers(self._volume, self._transfer), output)
        self.shader.close()
        window = self._vtk_window
        window.load(self.voxels.image, self.voxels.lattice)
        if self.path == "texture":
            self.shader.open(window)
        self._apply_clip()
        self._apply_display()

    def _apply_display(self) -> None:
        if self._transfer is None:
            return
        transfer, values = self._transfer, self.voxels.volume.value_range
        if self._projection == "mip":
            low, white, ink = self.voxels.volume.background, white_of(self._volume), INKS[self._background]
            transfer = TransferFunction(((low, *ink),), ((low, 0.0), (max(white, low + 1e-6), 1.0)))
        self._vtk_window.set_transfer(transfer, values, self._projection)
        if self.shader.warp is not None:
            self.shader.warp.set_projection(self._projection == "mip", self._projection == "shaded")

    def _apply_clip(self) -> None:
        if self.shader.warp is not None:
            is_cut = np.not_equal(np.transpose(self._parts["clip"]), [[0.0], [1.0]]).astype(float)
            self.shader.warp.set_box(*self.voxels.box(self._parts["clip"]), self.voxels.lattice, is_cut)
        else:
            self._vtk_window.set_clipping_planes(
                clipping_planes(self.voxels.lattice, self.voxels.clip_box(self._parts["clip"]))
            )

    def _deform(self, deformed: bool) -> None:
        wanted = deformed and self._field is not None
        if self.shader.warp is not None:
            self.shader.load(self.voxels)
            self.shader.warp.set_strength(1.0 if wanted else 0.0)
            self.shader.warp.set_folds(self.folding.is_red)
        # A shader clips at the visible box, and needs the tissue outside for displacements from there.
        kept = None if self.shader.warp is not None else self.voxels.clip_box(self._parts["clip"])
        if wanted and (self.shader.warp is None or self.shader.maps is None):
            self.voxels.write("warped", self._field, kept)
        else:
            is_whole = self.shader.warp is not None or (self.voxels.output is None and kept is None)
            self.voxels.write("plain" if is_whole else "cropped", None, kept)

    def close(self) -> None:
        """Give back the window and all that is on the GPU; a second time does nothing."""
        if self._window is not None:
            self.shader.close()
            self._window.close()
            self._window = None


@cache
def texture_works() -> bool:
    """Check that VTK's shader deforms as Python does: a small volume is drawn by both and compared, once a process.

    Call it in the thread that renders. VTK's message about a shader that it cannot compile is not shown.
    """
    return _is_right(*probe())


@cache
def cuts_work() -> bool:
    """The same of displacements with cuts, whose code differs."""
    return texture_works() and _is_right(*cut_probe())


@cache
def folds_work() -> bool:
    """Check that VTK's shader shows folds red, and only those; a small volume is drawn and examined, once a process.

    Call it in the thread that renders.
    """
    volume, field = mirrored_block()
    scene = VtkScene(volume, (64, 64), transfer="surface", method="texture", projection="composite")
    try:
        plane = Plane.from_view(volume.grid, "+z")
        scene.set_camera({"direction": plane.normal, "up": [-c for c in plane.v]})
        scene.set_field(field)
        plain = scene.render()
        scene.folding.show = True
        image = scene.render()
        assert plain is not None
        assert image is not None
    finally:
        scene.close()
    # A shader that cannot be compiled leaves nothing of the block, neither left nor right.
    kept = bool((image[16:48, 14:28] == plain[16:48, 14:28]).all()) and int(plain[16:48, 14:28].max()) > 60
    r, g, b = np.moveaxis(image[16:48, 36:48].astype(int), -1, 0)
    return kept and bool(((r > g + 30) & (r > b + 30)).mean() > 0.6)


def _is_right(volume: Volume, field: AbstractField) -> bool:
    from vtkmodules.vtkCommonCore import vtkObject

    shown = vtkObject.GetGlobalWarningDisplay()
    vtkObject.GlobalWarningDisplayOff()
    try:
        got, wanted = _still_of(volume, field, "texture"), _still_of(warp_volume(volume, field), None, "array")
    except DeformError:
        return False
    finally:
        vtkObject.SetGlobalWarningDisplay(shown)
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

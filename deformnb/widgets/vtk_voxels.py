"""What a scene of VTK must know of a volume: its voxels as far as can be seen, its frame, and what is white."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.clipping import WHOLE, Clip
from deformnb.errors import DeformError
from deformnb.extrusion import Extrusion
from deformnb.fields import AbstractField
from deformnb.io.headers import human_bytes
from deformnb.io.memory import available_memory
from deformnb.render import for_vtk, straight_image
from deformnb.transfer import levels
from deformnb.volume import Grid, Volume
from deformnb.warp import Warper
from deformnb.widgets.shown_volume import ShownVolume

Float3 = NDArray[np.float64]
Box = tuple[Float3, Float3]
"""Lowest and highest index (i, j, k) of what is seen of a lattice."""


def covering(volume: Volume, output: Grid | None) -> tuple[Volume, NDArray[np.float64]]:
    """The volume with background around it up to the box of ``output``, and where its first voxel (i, j, k) is.

    Raises
    ------
    DeformError
        If there is no memory for that: a box of few voxels may be large, or far away.
    """
    grid = volume.grid if output is None else volume.grid.covering(output.corners())
    if grid.shape == volume.grid.shape:
        return volume, np.zeros(3)
    needed, free = 2 * grid.size * volume.dtype.itemsize, available_memory()  # another copy is made for VTK
    if needed > free:
        raise DeformError(f"to show this box in VTK takes {human_bytes(needed)} and {human_bytes(free)} are free; "
                          "choose a box nearer to the volume, or a live view.")
    start = np.round(grid.point_to_index(volume.grid.origin))
    values = np.full(grid.shape, volume.dtype.type(volume.background))
    nz, ny, nx = volume.shape
    x, y, z = start.astype(int)
    values[z : z + nz, y : y + ny, x : x + nx] = volume.finite_values
    return replace(volume, values=values, grid=grid), start


def frame_of(volume: Volume) -> ShownVolume:
    """The frame that maps of displacements lie in: lengths along the axes from the centre of the first voxel."""
    return ShownVolume(volume, volume.grid, (0.0, 1.0), (1, 1, 1), "", 0, 1.0)


def white_of(volume: Volume) -> float:
    """The value that is white in a maximum projection."""
    discrete = volume.is_labels or volume.dtype == np.bool_
    return volume.value_range[1] if discrete else levels(volume)[3]


class SceneVoxels:
    """The voxels that VTK draws, written over in place where its shader cannot do what is wanted.

    Parameters
    ----------
    volume : what is shown; its voxels are copied once, with a margin of background.
    output : its box is what can be seen; None for the volume's own.

    Attributes
    ----------
    image : what VTK has; lattice : where its voxels are; first : index (i, j, k) of the volume's first voxel there.
    written : what the voxels are now: their kind, the field that moved them, and the box outside of which is nothing.
    """

    def __init__(self, volume: Volume, output: Grid | None) -> None:
        around, start = covering(volume, output)
        ready = for_vtk(around)
        self.volume, self.output = volume, output
        self.lattice, self.first = ready.grid, start + 1
        self.image: Any = straight_image(ready)
        self.written: tuple[str, AbstractField | None, Any] = ("plain", None, None)
        self._values = ready.values
        self._plain: NDArray[Any] | None = None
        self._warper: Warper | None = None
        corners = self.lattice.point_to_index((output or volume.grid).corners())
        self._low, self._high = corners.min(axis=0), corners.max(axis=0)  # of what can be seen

    def box(self, clip: Clip) -> Box:
        """What is seen of the lattice; without a field of view up to the centres of the background around."""
        shares, margin = np.asarray(clip), 0.5 if self.output is None else 0.0
        low, high = self._cut_at(shares)
        return (np.where(shares[:, 0] > 0, low, self._low - margin),
                np.where(shares[:, 1] < 1, high, self._high + margin))

    def _cut_at(self, shares: Float3) -> Box:
        length = self._high - self._low
        return self._low + shares[:, 0] * length, self._low + shares[:, 1] * length

    def kept(self, clip: Clip) -> Box | None:
        """The whole indices between which voxels stay when others are emptied; None if all do."""
        if clip == WHOLE:
            return None
        shares, last = np.asarray(clip), np.asarray(self.lattice.shape[::-1]) - 1.0
        low, high = (np.round(side) for side in self._cut_at(shares))
        return np.where(shares[:, 0] > 0, low, 0.0), np.where(shares[:, 1] < 1, np.maximum(low, high), last)

    def write(self, kind: str, field: AbstractField | None, kept: Box | None) -> None:
        """Have other voxels in the memory that VTK has, which it sends to the card with the next picture.

        Parameters
        ----------
        kind : "plain" for all there are, "cropped" for those that can be seen, "warped" for what ``field`` brings.
        kept : outside of these indices is background.
        """
        state = (kind, field, None if kept is None else tuple(np.concatenate(kept)))
        if state[0] == self.written[0] and state[1] is self.written[1] and state[2] == self.written[2]:
            return
        if self._plain is None:
            self._plain = self._values.copy()  # only this way needs the voxels twice
        if kind == "plain":
            self._values[...] = self._plain
        else:
            self._put_inside(self._plain, field)
        if kept is not None:
            self._empty_around(kept)
        self.image.GetPointData().GetScalars().Modified()
        self.image.Modified()
        self.written = state

    def _put_inside(self, plain: NDArray[Any], field: AbstractField | None) -> None:
        """Only the voxels whose centres can be seen; around them lies background."""
        low = np.ceil(self._low - 1e-6).astype(int)[::-1]
        high = np.floor(self._high + 1e-6).astype(int)[::-1] + 1
        inside = tuple(map(slice, low, high))
        self._values[...] = self.volume.background
        if field is None:
            self._values[inside] = plain[inside]
        else:
            part = self.volume.grid if self.output is None else self.lattice.crop(tuple(low), tuple(high - low))
            self._values[inside] = self._warper_for(part, field)(field).values

    def _empty_around(self, kept: Box) -> None:
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


def clipping_planes(lattice: Grid, kept: Box | None) -> list[Any]:
    """Planes of VTK on the sides of a box of indices: between a voxel and an emptied one lies a skin of neither."""
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

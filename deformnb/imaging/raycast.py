"""Ray casting by NumPy: front-to-back compositing of layers, gradient shading, clipped faces, perspective.

The layers are those that a viewer in front of a plane sees of a volume, one behind the other, clipped and in
perspective. A perspective needs no separate ray: a layer twice as far from the eye is looked up twice as wide, and
the parallel composite of these layers is the picture that the eye sees. Most samples of a scan are air, and most rays
end at a surface: colours, slopes and light are computed for the samples that a ray still reaches, and for no others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage
from deformnb._typing import Float3
from deformnb.checks import check_fields
from deformnb.errors import DeformError
from deformnb.volume.clip import ClipBox
from deformnb.volume.plane import Plane
from deformnb.volume.sampling import compute_type
from deformnb.volume.transfer import TransferFunction, typical_range
from deformnb.volume.volume import Grid, Volume
from deformnb.warping import planning
from deformnb.warping.voxel_readers import CompiledReader, VoxelInput, make_reader

_AMBIENT, _DIFFUSE, _GLOSS = 0.35, 0.75, 0.35

_OPAQUE = 2.0**-15
"""A ray of which less is left ends: the rest would change no byte of a picture."""

LAMP = np.array([-0.35, -0.45, -0.82]) / np.linalg.norm([-0.35, -0.45, -0.82])
"""The direction to the lamp along u, v and n of a picture: above the viewer's left shoulder. Pure headlight looks flat,
light from far aside leaves half in the dark."""

_BLOCKS = 12
"""Blocks along each axis of a volume: layers are sampled where one of them is that is not transparent."""

_HALF = (LAMP - [0, 0, 1]) / np.linalg.norm(LAMP - [0, 0, 1])
"""Between the directions to the lamp and to the viewer: a surface with this normal shines."""

_NEAREST = 0.02  # of the distance of the eye: nearer places are not seen

Samples = NDArray[np.floating]
PlaneCoordinates = tuple[Samples, Samples, Samples]


@dataclass(frozen=True)
class PerspectiveCamera:
    """A perspective camera in front of a plane's origin.

    Parameters
    ----------
    distance : from the plane; objects in the plane have their true size.
    width, height : lengths of the visible part of the plane.
    """

    distance: float
    width: float
    height: float

    def __post_init__(self) -> None:
        check_fields(self)
        if not min(self.distance, self.width, self.height) > 0:
            raise DeformError(f"the distance, width and height of a camera are positive lengths, got {self}.")

    def lattice(self, grid: Grid, plane: Plane, spacing: float) -> Grid:
        """Samples along a plane's axes as wide as its visible part, and as deep as ``grid`` before the eye."""
        depths = plane.to_plane(grid.corners())[:, 2]
        near, far = max(float(depths.min()), (_NEAREST - 1) * self.distance), float(depths.max())
        wide, tall, deep = (
            max(1, int(np.ceil(length / spacing - 1e-9))) for length in (self.width, self.height, far - near)
        )
        first = [-(wide - 1) / 2 * spacing, -(tall - 1) / 2 * spacing, (near + far - (deep - 1) * spacing) / 2]
        axes = tuple(map(tuple, plane.frame.T))
        return Grid(
            (deep, tall, wide),
            (spacing,) * 3,
            tuple(plane.from_plane(first)),
            axes,  # type: ignore[arg-type]
            grid.unit,
        )


@dataclass(frozen=True)
class Layers:
    """Layers [depth, v, u] that a viewer sees, front to back.

    Parameters
    ----------
    spacing : distances (dn, dv, du) of neighbours.
    values : number of a layer, some of its rows and columns -> values [v, u].
    places : number of a layer, rows and columns (n,) -> coordinates (u, v, n) of these samples in the plane; None where
        the layers are voxels.
    windows : first row, end of rows, first column and end of columns (depth, 4) of the part of each layer that has to
        be sampled; None where all of it has to.
    """

    shape: tuple[int, int, int]
    spacing: Float3
    values: Callable[[int, slice, slice], NDArray[np.generic]]
    places: Callable[[int, NDArray[np.intp], NDArray[np.intp]], PlaneCoordinates] | None = None
    windows: NDArray[np.intp] | None = None

    def window(self, k: int, rows: slice) -> tuple[slice, slice]:
        """Rows, of those that are given, and columns of a layer that have to be sampled."""
        if self.windows is None:
            return rows, slice(0, self.shape[2])
        top, bottom, left, right = self.windows[k].tolist()
        first = min(max(rows.start, top), rows.stop)
        return slice(first, max(first, min(rows.stop, bottom))), slice(left, right)

    @classmethod
    def from_lattice(
        cls,
        volume: Volume,
        lattice: Grid,
        plane: Plane,
        *,
        held: Sequence[ClipBox] = (),
        eye: PerspectiveCamera | None = None,
        is_smooth: bool = False,
        windows: NDArray[np.intp] | None = None,
    ) -> Layers:
        """Layers of a lattice along the axes of ``plane``, trilinear between voxels.

        Parameters
        ----------
        held : outside of each is background.
        eye : sees the layers, which are then wider the farther they are.
        is_smooth : a mask is interpolated like numbers; other labels are not.
        windows : parts that have to be sampled, see :func:`windows_of`.
        """
        voxels = np.ascontiguousarray(volume.finite_values)
        is_linear = not volume.is_labels or (is_smooth and volume.dtype == np.bool_)
        if volume.dtype == np.bool_:
            voxels = voxels.view(np.uint8)
        kind = compute_type(volume.dtype)
        (a0, b0, c0), d = plane.to_plane(lattice.origin), lattice.spacing[0]
        bend = 0.0 if eye is None else 1 / eye.distance
        to_index, origin = _indices(volume.grid, plane)
        along = [box for box in held if box.grid == volume.grid]
        lowest = np.max([[-1.0] * 3, *(box.low for box in along)], axis=0)
        highest = np.min([volume.shape[::-1], *(box.high for box in along)], axis=0)
        sides = [(*_indices(box.grid, plane), box.low, box.high) for box in held if box not in along]

        def size(k: int) -> tuple[float, float]:
            """Depth of a layer, and how wide it is."""
            depth = c0 + d * k
            return depth, max(_NEAREST, 1 + depth * bend)

        def values(k: int, rows: slice, columns: slice) -> NDArray[np.generic]:
            shape = rows.stop - rows.start, columns.stop - columns.start
            if not min(shape):
                return np.empty(shape, kind)
            depth, wide = size(k)
            # Of indices along x, y and z: those of the first row and column, and steps along v and u.
            first = to_index @ [wide * a0, wide * b0, depth] + origin
            index = np.column_stack([first, wide * d * to_index[:, [1, 0]]])
            found, is_outside = _sample(voxels, (rows, columns), index, (lowest, highest), kind, is_linear)
            found[is_outside] = volume.background
            for steps, shifts, lows, highs in sides:
                u, v = (
                    wide * (start + d * np.arange(part.start, part.stop))
                    for start, part in zip((a0, b0), (columns, rows), strict=True)
                )
                for (du, dv, dn), shift, low, high in zip(steps, shifts, lows, highs, strict=True):
                    index = du * u + (dv * v + (dn * depth + shift))[:, None]
                    found[(index < low) | (index >= high)] = volume.background
            return found

        def places(k: int, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> PlaneCoordinates:
            depth, wide = size(k)
            return wide * (a0 + d * columns), wide * (b0 + d * rows), np.full(len(rows), depth)

        return cls(lattice.shape, (d, d, d), values, places, windows)

    @classmethod
    def read_rounded(cls, volume: Volume, lattice: Grid, windows: NDArray[np.intp] | None = None) -> Layers | None:
        """Layers of :meth:`from_lattice` in the type of the volume, background outside of it, read by compiled loops.

        Returns
        -------
        None where no compiled loops are at hand, or the volume is too large for them.
        """
        voxels = np.ascontiguousarray(volume.finite_values)
        if voxels.dtype == np.bool_:
            voxels = voxels.view(np.uint8)
        compute = compute_type(voxels.dtype)
        method = "nearest" if volume.is_labels else "linear"
        source = VoxelInput(voxels, planning.places(volume.grid, lattice, compute), method, volume.background)
        reader = make_reader(source)
        if not isinstance(reader, CompiledReader):
            return None
        reader.load()
        still = (np.zeros((1, 1, 1), np.float32),) * 3

        def values(k: int, rows: slice, columns: slice) -> NDArray[np.generic]:
            block = (slice(k, k + 1), rows, columns)
            out = np.empty([part.stop - part.start for part in block], voxels.dtype)
            if not out.size:
                return out[0]
            node = tuple((np.zeros(n, np.int32), np.ones((1, n), np.float32)) for n in out.shape)
            return reader.read_block(out, block, still, node)[0]

        return cls(lattice.shape, lattice.spacing, values, windows=windows)


def corners_of_blocks(mask: NDArray[np.bool_], grid: Grid) -> NDArray[np.float64]:
    """Corners (n, 8, 3) of the blocks of a grid that have a voxel of a mask; each reaches to the next voxels."""
    sizes = [-(-n // _BLOCKS) for n in grid.shape]
    for axis, (size, count) in enumerate(zip(sizes, grid.shape, strict=True)):
        parts = np.split(mask, range(size, count, size), axis=axis)
        mask = np.stack([part.any(axis=axis) for part in parts], axis=axis)
    first = np.argwhere(mask) * sizes
    ends = np.stack([first - 1, np.minimum(first + sizes, grid.shape)], axis=1)[..., ::-1]
    sides = np.stack(np.meshgrid(*[(0, 1)] * 3), axis=-1).reshape(-1, 3)
    return grid.index_to_point(ends[:, sides, np.arange(3)])


def _sample(
    voxels: NDArray[np.generic],
    window: tuple[slice, slice],
    index: NDArray[np.float64],
    box: tuple[NDArray[np.float64], NDArray[np.float64]],
    kind: str,
    is_linear: bool,
) -> tuple[Samples, NDArray[np.bool_]]:
    """Voxels at the places of a plane, and a mask of the places beyond a box.

    Importing SciPy, which can do it too, takes as long as a small picture.

    Parameters
    ----------
    voxels : those at the border continue.
    window : rows and columns.
    index : along x, y and z of the first row and column, and its steps along v and u (3, 3).
    box : lower and upper indices along x, y and z.
    kind : type of the samples.
    is_linear : whether they are trilinear, or those of the nearest voxels.
    """
    kind_of_index = np.int32 if voxels.size < 2**31 else np.int64
    rows, columns = (np.arange(part.start, part.stop) for part in window)
    start, shares = np.zeros((len(rows), len(columns)), kind_of_index), []
    is_outside = np.zeros(start.shape, bool)
    for (first, down, right), low, high, axis in zip(index, *box, (2, 1, 0), strict=True):
        at = (first + right * columns).astype(kind) + (down * rows).astype(kind)[:, None]
        last, step = voxels.shape[axis] - 1, int(np.prod(voxels.shape[axis + 1 :]))
        ends = at[[0, 0, -1, -1], [0, -1, 0, -1]]
        if ends.min() < max(low, 0) or ends.max() >= min(high, last):
            is_outside |= (at < low) | (at >= high)
            np.clip(at, 0, last, out=at)
        before = (at if is_linear else at + 0.5).astype(kind_of_index)
        if is_linear and last:
            np.minimum(before, last - 1, out=before)
            shares.append((np.subtract(at, before, dtype=kind), step))
        start += before * step

    def blend(axes: int, offset: int) -> NDArray[np.generic]:
        """Means of neighbours along as many axes."""
        if not axes:
            return voxels.ravel()[offset:].take(start)
        share, step = shares[axes - 1]
        before, after = blend(axes - 1, offset), blend(axes - 1, offset + step)
        found = np.subtract(after, before, dtype=kind)
        found *= share
        found += before
        return found

    return blend(len(shares), 0).astype(kind, copy=False), is_outside


def windows_of(
    blocks: NDArray[np.float64], lattice: Grid, plane: Plane, eye: PerspectiveCamera | None
) -> NDArray[np.intp]:
    """The part of each layer of a lattice that blocks cover, with the samples around it.

    Parameters
    ----------
    blocks : corners (n, 8, 3) of each.
    eye : sees the layers, which are then wider the farther they are.

    Returns
    -------
    First row, end of rows, first column and end of columns (depth, 4); the ends are the firsts where there is no block.
    """
    at = plane.to_plane(blocks.reshape(-1, 3)).reshape(-1, 8, 3)
    if eye is not None:
        wide = 1 + at[..., 2] / eye.distance
        at[..., :2] /= np.maximum(wide, _NEAREST)[..., None]
    index = (at - plane.to_plane(lattice.origin)) / lattice.spacing[0]
    low, high = np.floor(index.min(axis=1)) - 1, np.ceil(index.max(axis=1)) + 2
    if eye is not None:  # it may be seen everywhere if the eye is within it
        is_around = (wide <= _NEAREST).any(axis=1)
        low[is_around, :2], high[is_around, :2] = -np.inf, np.inf
    layers = np.arange(lattice.shape[0])[:, None]
    is_met = (low[:, 2] <= layers) & (layers < high[:, 2])
    found = np.zeros((lattice.shape[0], 4), np.intp)
    for side, (axis, size) in enumerate(((1, lattice.shape[1]), (0, lattice.shape[2]))):
        first = np.where(is_met, low[:, axis], np.inf).min(axis=1, initial=np.inf)
        end = np.where(is_met, high[:, axis], -np.inf).max(axis=1, initial=-np.inf)
        found[:, 2 * side], found[:, 2 * side + 1] = np.clip(first, 0, size), np.clip(end, 0, size)
    found[(found[:, 0] >= found[:, 1]) | (found[:, 2] >= found[:, 3])] = 0
    return found


def _indices(grid: Grid, plane: Plane) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Matrix and shift from coordinates (u, v, n) of a plane to indices of a grid."""
    return grid.inverse @ plane.frame.T, grid.point_to_index(plane.origin)


@dataclass(frozen=True)
class Shader:
    """Colours, opacities and light of the samples of a volume.

    Parameters
    ----------
    transfer : colours and opacities for a thickness of ``transfer.unit``.
    background : the value outside of the volume.
    width : of the range of its values: slopes of less than a hundredth of it per voxel are no surface.
    is_shaded : whether surfaces are lit.
    kind : of the numbers in which values are compared.
    faces : that cut off, and are lit evenly where they cut through a body.
    ambience : coordinates of samples -> the light from all around that reaches each; all of it where there is none.
    """

    transfer: TransferFunction
    background: float
    width: float
    is_shaded: bool
    kind: str = "float32"
    faces: Faces | None = None
    ambience: Callable[[PlaneCoordinates], Samples] | None = None

    @classmethod
    def from_volume(cls, volume: Volume, transfer: TransferFunction, is_shaded: bool) -> Shader:
        """The shader of a volume."""
        low, high = typical_range(volume)
        return cls(
            transfer, volume.background, (high - low) or max(1.0, abs(low)), is_shaded, compute_type(volume.dtype)
        )

    def visible_blocks(self, volume: Volume) -> NDArray[np.float64]:
        """Corners (n, 8, 3) of blocks of a volume outside of which all is transparent."""
        first, last = self._limits
        # Between two voxels on one side of all opaque values there is none.
        if volume.background <= first:
            return corners_of_blocks(volume.finite_values > first, volume.grid)
        if volume.background >= last:
            return corners_of_blocks(volume.finite_values < last, volume.grid)
        return volume.grid.corners()[None]

    @cached_property
    def _limits(self) -> tuple[float, float]:
        """Bounds of all values that are not transparent."""
        at, rgba = self.transfer.knots()
        (opaque,) = np.nonzero(rgba[:, 3] > 0)
        if not len(opaque):
            return np.inf, -np.inf
        first, last = opaque[0], opaque[-1]
        low = -np.inf if first == 0 else at[first - 1]
        if first and low == at[first]:  # a jump: the node after it is valid there
            low = np.nextafter(np.float32(low), np.float32(-np.inf))
        return float(low), float(at[last + 1]) if last + 1 < len(at) else np.inf

    def composite(self, layers: Layers, rows: slice) -> NDArray[np.float32]:
        """Front to back: C += (1 - A) alpha c, A += (1 - A) alpha, over some rows of layers.

        Returns
        -------
        (rows, columns, 4) red, green, blue times opacity, and opacity.
        """
        first, last = self._limits
        shape = rows.stop - rows.start, layers.shape[2]
        wide = shape[1] + 2  # with a sample of background around all
        color, passing = np.zeros((3, shape[0] * shape[1])), np.ones(shape[0] * shape[1])
        power = layers.spacing[0] / self.transfer.unit
        before, here, after = (self._padded_rows(layers, k, rows) for k in (-2, -1, 0))
        for k in range(layers.shape[0]):
            before, here, after = here, after, self._padded_rows(layers, k + 1, rows)
            height, width = layers.window(k, rows)
            top, columns = height.start - rows.start, width.stop - width.start
            if height.start == height.stop:
                continue
            inner = here[top + 1 : top + 1 + height.stop - height.start, width.start + 1 : width.stop + 1]
            is_passing = passing.reshape(shape)[top : height.stop - rows.start, width] > _OPAQUE
            v, u = np.divmod(np.flatnonzero((inner > first) & (inner < last) & is_passing), columns)
            v, u = v + top, u + width.start
            at, place = v * shape[1] + u, (v + 1) * wide + u + 1
            *rgb, opacity = self.transfer.channels(here.ravel()[place])
            alpha = 1 - (1 - opacity) ** power
            bright: NDArray[np.floating] | float = 1.0
            places = layers.places(k, v + rows.start, u) if layers.places is not None else None
            if self.is_shaded:
                slopes = (
                    here.ravel()[place + 1] - here.ravel()[place - 1],
                    here.ravel()[place + wide] - here.ravel()[place - wide],
                    after.ravel()[place] - before.ravel()[place],
                )
                ambient = 1.0 if self.ambience is None or places is None else self.ambience(places)
                bright = self._brightness(slopes, layers.spacing, ambient)
            if self.faces is not None and places is not None:
                held, bare, glow = self.faces.sample(places)
                alpha *= held
                if self.is_shaded:
                    bright = bright + bare * (glow - bright)
            light = passing[at]
            passing[at] = light * (1 - alpha)
            light *= alpha
            light *= bright
            for channel, share in zip(color, rgb, strict=True):
                channel[at] += light * share
            if k % 8 == 0 and passing.max() <= _OPAQUE:
                break
        return np.column_stack([*color, 1 - passing]).astype(np.float32).reshape(*shape, 4)

    def _padded_rows(self, layers: Layers, k: int, rows: slice) -> Samples:
        """Rows of a layer and those around them; outside of the layers is background.

        So a body is lit like any surface where it is cut off.
        """
        deep, tall, wide = layers.shape
        out = np.full((rows.stop - rows.start + 2, wide + 2), self.background, self.kind)
        if 0 <= k < deep:
            height, width = layers.window(k, slice(max(rows.start - 1, 0), min(rows.stop + 1, tall)))
            place = slice(height.start - rows.start + 1, height.stop - rows.start + 1)
            out[place, width.start + 1 : width.stop + 1] = layers.values(k, height, width)
        return out

    def _brightness(self, slopes: PlaneCoordinates, spacing: Float3, ambient: Samples | float) -> Samples:
        """Brightness by Blinn and Phong; 0.8 where the slope vanishes and all ambient light comes.

        Parameters
        ----------
        slopes : differences (n,) of neighbours along u, v and n.
        """
        u, v, n = (slope / (step * self.width) for slope, step in zip(slopes, spacing[::-1], strict=True))
        size = np.sqrt(u * u + v * v + n * n)
        lit = _shade((u, v, n), np.maximum(size, 1e-30), ambient)
        # An even region has no surface: fade to plain colour where the slope is below a hundredth of the range a voxel.
        sure = np.clip(size * (min(spacing) / 0.02), 0, 1)
        plain = 0.8 * (0.3 + 0.7 * ambient)
        return np.asarray(plain + sure * (lit - plain))


def _shade(normals: PlaneCoordinates, size: Samples | float, ambient: Samples | float = 1.0) -> Samples:
    """Brightness of surfaces with normals (n,) along u, v and n, lit from both sides by Blinn and Phong.

    Places with less ambient light get less of the lamp, for it is no point; shares as in the live view's shader.

    Parameters
    ----------
    size : length of the normals.
    """
    lamp, gloss = (
        np.abs(sum(share * part for share, part in zip(towards, normals, strict=True))) / size
        for towards in (LAMP, _HALF)
    )
    for _ in range(3):
        gloss *= gloss
    gloss = gloss * gloss * gloss
    return np.asarray(ambient * (_AMBIENT + _GLOSS * gloss) + ((0.42 + 0.58 * ambient) * _DIFFUSE) * lamp)


@dataclass(frozen=True)
class Faces:
    """The six faces of a part that is left of a body, in coordinates (u, v, n) of a plane.

    Parameters
    ----------
    planes : (6, 4): how far within it a place (u, v, n, 1) is.
    nearness : (6,): 1 over the depth, along n, to which it is lit, 0 of one that is not seen.
    glow : (6,): how brightly.
    """

    planes: NDArray[np.float64]
    nearness: NDArray[np.float64]
    glow: Samples

    @classmethod
    def from_part(cls, part: ClipBox, plane: Plane, spacing: float) -> Faces:
        """The faces of a part, for samples so far apart."""
        points, inward = part.sides()
        normals = inward @ plane.frame.T
        offsets = ((np.asarray(plane.origin) - points) * inward).sum(axis=-1)
        deep = 2 * max(spacing, min(part.grid.spacing))  # as in the live view: wholly for a voxel, then less and less
        # Depth within a face that is 1 deep along n is its slope deep: seen only if it faces the viewer.
        slope = np.maximum(normals[:, 2], 0.0)
        nearness = np.where(slope > 1e-3, 1 / (deep * np.maximum(slope, 1e-3)), 0)
        u, v, n = normals.T
        return cls(np.column_stack([normals, offsets]), nearness, _shade((u, v, n), 1.0))

    def sample(self, places: PlaneCoordinates) -> tuple[NDArray[np.bool_], Samples, Samples]:
        """Masks of places (n,) within all faces, their nearness to a face that is seen, and the light of that face."""
        a, b, c = places
        held, bare, glow = np.ones(len(a), bool), np.zeros(len(a)), np.zeros(len(a))
        for (u, v, n, offset), nearness, light in zip(self.planes, self.nearness, self.glow, strict=True):
            depth = u * a + v * b + n * c + offset
            held &= depth >= 0
            if nearness > 0:
                at = np.flatnonzero(depth < 1.5 / nearness)
                near = np.minimum(1.5 - depth[at] * nearness, 1)
                at, near = at[near > bare[at]], near[near > bare[at]]
                bare[at], glow[at] = near, light
        return held, bare, glow


def light_sampler(light: Volume, plane: Plane) -> Callable[[PlaneCoordinates], Samples]:
    """A function of places in a plane's coordinates that samples ambient light.

    Parameters
    ----------
    light : see :func:`deformnb.imaging.occlusion.ambient_light`.
    """

    def at(places: PlaneCoordinates) -> Samples:
        index = light.grid.point_to_index(plane.from_plane(np.stack(places, axis=-1)))
        return np.asarray(ndimage.map_coordinates(light.values, index.T[::-1], order=1, mode="nearest"))

    return at

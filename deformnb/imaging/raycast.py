"""Ray casting by NumPy and SciPy: front-to-back compositing of layers, gradient shading, clipped faces, perspective.

The layers are those that a viewer in front of a plane sees of a volume, one behind the other, clipped and in
perspective. A perspective needs no separate ray: a layer twice as far from the eye is looked up twice as wide, and
the parallel composite of these layers is the picture that the eye sees. Most samples of a scan are air, and most rays
end at a surface: colours, slopes and light are computed for the samples that a ray still sees, and for no others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

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

_AMBIENT, _DIFFUSE, _GLOSS, _POWER = 0.35, 0.75, 0.35, 24

_OPAQUE = 2.0**-15
"""A ray of which less is left ends: the rest would change no byte of a picture."""

LAMP = np.array([-0.35, -0.45, -0.82]) / np.linalg.norm([-0.35, -0.45, -0.82])
"""The direction to the lamp along u, v and n of a picture: above the viewer's left shoulder. Pure headlight looks flat,
light from far aside leaves half in the dark."""

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
    values : number of a layer and some of its rows -> values [v, u].
    places : number of a layer, rows and columns (n,) -> coordinates (u, v, n) of these samples in the plane; None where
        the layers are voxels.
    """

    shape: tuple[int, int, int]
    spacing: Float3
    values: Callable[[int, slice], NDArray[np.generic]]
    places: Callable[[int, NDArray[np.intp], NDArray[np.intp]], PlaneCoordinates] | None = None

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
    ) -> Layers:
        """Layers of a lattice along the axes of ``plane``, trilinear between voxels.

        Parameters
        ----------
        held : outside of each is background.
        eye : sees the layers, which are then wider the farther they are.
        is_smooth : a mask is interpolated like numbers; other labels are not.
        """
        given = volume.finite_values if volume.dtype != np.bool_ else volume.finite_values.view(np.uint8)
        voxels = np.pad(given, 1, mode="edge")  # up to half a voxel beyond the middle of the last one holds its value
        order: Literal[0, 1] = 0 if volume.is_labels and not (is_smooth and volume.dtype == np.bool_) else 1
        (a0, b0, c0), d = plane.to_plane(lattice.origin), lattice.spacing[0]
        bend = 0.0 if eye is None else 1 / eye.distance
        to_index, origin = _indices(volume.grid, plane)
        sides = [(*_indices(box.grid, plane), box.low, box.high) for box in held]

        def size(k: int) -> tuple[float, float]:
            """Depth of a layer, and how wide it is."""
            depth = c0 + d * k
            return depth, max(_NEAREST, 1 + depth * bend)

        def values(k: int, rows: slice) -> NDArray[np.generic]:
            depth, wide = size(k)
            at = np.array([wide * a0, wide * (b0 + d * rows.start), depth])
            found = np.empty((rows.stop - rows.start, lattice.shape[2]), compute_type(volume.dtype))
            ndimage.affine_transform(
                voxels,
                (to_index * [wide * d, wide * d, 1.0])[::-1, ::-1],
                (to_index @ at + origin)[::-1] + 1,
                output=found[None],
                order=order,
                mode="constant",
                cval=volume.background,
                prefilter=False,
            )
            u, v = (at[axis] + wide * d * np.arange(found.shape[1 - axis], dtype=np.float32) for axis in (0, 1))
            for steps, first, lows, highs in sides:
                for (du, dv, dn), shift, low, high in zip(steps, first, lows, highs, strict=True):
                    index = du * u + (dv * v + (dn * depth + shift))[:, None]
                    found[(index < low) | (index >= high)] = volume.background
            return found

        def places(k: int, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> PlaneCoordinates:
            depth, wide = size(k)
            return wide * (a0 + d * columns), wide * (b0 + d * rows), np.full(len(rows), depth)

        return cls(lattice.shape, (d, d, d), values, places)


def _indices(grid: Grid, plane: Plane) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Matrix and shift from coordinates (u, v, n) of a plane to indices of a grid."""
    return np.linalg.inv(grid.matrix) @ plane.frame.T, grid.point_to_index(plane.origin)


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

    def visible_box(self, volume: Volume) -> NDArray[np.float64] | None:
        """Corners (8, 3) of the part of a volume outside of which all is transparent; None if nothing is at all."""
        first, last = self._limits
        # Between two voxels on one side of all opaque values there is none.
        if volume.background <= first:
            seen = volume.finite_values > first
        elif volume.background >= last:
            seen = volume.finite_values < last
        else:
            return volume.grid.corners()
        ends = []
        for axis in range(3):
            (found,) = np.nonzero(seen.any(axis=tuple(k for k in range(3) if k != axis)))
            if not len(found):
                return None
            ends.append((int(found[0]) - 1, int(found[-1]) + 2))
        start = tuple(first for first, _ in ends)
        return volume.grid.crop(start, tuple(end - first for first, end in ends)).corners()  # type: ignore[arg-type]

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
        color, passing = np.zeros((shape[0] * shape[1], 3)), np.ones(shape[0] * shape[1])
        power = layers.spacing[0] / self.transfer.unit
        before, here, after = (self._padded_rows(layers, k, rows) for k in (-2, -1, 0))
        for k in range(layers.shape[0]):
            before, here, after = here, after, self._padded_rows(layers, k + 1, rows)
            inner = here[1:-1, 1:-1]
            at = np.flatnonzero((inner > first) & (inner < last) & (passing > _OPAQUE).reshape(shape))
            v, u = np.divmod(at, shape[1])
            place = (v + 1) * wide + u + 1
            rgba = self.transfer(here.ravel()[place])
            alpha = 1 - (1 - rgba[:, 3]) ** power
            bright: NDArray[np.floating] | float = 1.0
            places = layers.places(k, v + rows.start, u) if layers.places is not None else None
            if self.is_shaded:
                slopes = [
                    after.ravel()[place] - before.ravel()[place],
                    here.ravel()[place + wide] - here.ravel()[place - wide],
                    here.ravel()[place + 1] - here.ravel()[place - 1],
                ]
                ambient = 1.0 if self.ambience is None or places is None else self.ambience(places)
                bright = self._brightness(slopes, layers.spacing, ambient)
            if self.faces is not None and places is not None:
                held, bare, glow = self.faces.sample(places)
                alpha *= held
                if self.is_shaded:
                    bright = bright + bare * (glow - bright)
            color[at] += (passing[at] * alpha * bright)[:, None] * rgba[:, :3]
            passing[at] *= 1 - alpha
            if k % 8 == 0 and passing.max() <= _OPAQUE:
                break
        return np.column_stack([color, 1 - passing]).astype(np.float32).reshape(*shape, 4)

    def _padded_rows(self, layers: Layers, k: int, rows: slice) -> Samples:
        """Rows of a layer and those around them; outside of the layers is background.

        So a body is lit like any surface where it is cut off.
        """
        deep, tall, wide = layers.shape
        out = np.full((rows.stop - rows.start + 2, wide + 2), self.background, self.kind)
        if 0 <= k < deep:
            first, last = max(rows.start - 1, 0), min(rows.stop + 1, tall)
            out[first - rows.start + 1 : last - rows.start + 1, 1:-1] = layers.values(k, slice(first, last))
        return out

    def _brightness(self, slopes: list[Samples], spacing: Float3, ambient: Samples | float) -> Samples:
        """Brightness by Blinn and Phong; 0.8 where the slope vanishes and all ambient light comes.

        Parameters
        ----------
        slopes : differences (n,) of neighbours along n, v and u.
        """
        dn, dv, du = spacing
        g = np.stack([slopes[2] / du, slopes[1] / dv, slopes[0] / dn], axis=-1) / self.width
        size = np.sqrt((g * g).sum(axis=-1))
        lit = _shade(g / np.maximum(size, 1e-30)[:, None], ambient)
        # An even region has no surface: fade to plain colour where the slope is below a hundredth of the range a voxel.
        sure = np.clip(size * (min(spacing) / 0.02), 0, 1)
        return np.asarray(sure * lit + (1 - sure) * 0.8 * (0.3 + 0.7 * ambient))


def _shade(normals: Samples, ambient: Samples | float = 1.0) -> Samples:
    """Brightness of surfaces with normals (..., 3) along u, v and n, lit from both sides by Blinn and Phong.

    Places with less ambient light get less of the lamp, for it is no point; shares as in the live view's shader.
    """
    half = LAMP + np.array([0.0, 0.0, -1.0])
    half = half / np.linalg.norm(half)
    lamp = (0.42 + 0.58 * ambient) * _DIFFUSE * np.abs(normals @ LAMP)
    return np.asarray(ambient * (_AMBIENT + _GLOSS * np.abs(normals @ half) ** _POWER) + lamp)


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
        return cls(np.column_stack([normals, offsets]), nearness, _shade(normals))

    def sample(self, places: PlaneCoordinates) -> tuple[NDArray[np.bool_], Samples, Samples]:
        """Masks of places (n,) within all faces, their nearness to a face that is seen, and the light of that face."""
        a, b, c = places
        held, bare, glow = np.ones(len(a), bool), np.zeros(len(a)), np.zeros(len(a))
        for (u, v, n, offset), nearness, light in zip(self.planes, self.nearness, self.glow, strict=True):
            depth = u * a + v * b + n * c + offset
            held &= depth >= 0
            if nearness > 0:
                near = np.clip(1.5 - depth * nearness, 0, 1)
                glow = np.where(near > bare, light, glow)
                bare = np.maximum(bare, near)
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

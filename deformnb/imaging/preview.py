"""Previews: small pictures by Pillow and NumPy alone, for readers of a notebook in which no front end runs.

They are made before a widget is shown, so nothing is compiled for them, and neither JAX nor Matplotlib is imported. A
volume is drawn as a stack of textured slices, back to front (B. Cabral, N. Cam, J. Foran, "Accelerated volume
rendering and tomographic reconstruction using texture mapping hardware", VolVis 1994): each slice of voxels across the
direction of view lands on the picture by a perspective map of the plane. Colours, opacities and light are those of the
ray caster.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3, Image
from deformnb.imaging.camera import Camera
from deformnb.imaging.drawing import SOURCE, STYLES, TARGET
from deformnb.imaging.raycast import LAMP, glow_of
from deformnb.rbf.points import ControlPoints
from deformnb.volume.clip import ClipBox
from deformnb.volume.plane import Picture
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Volume

if TYPE_CHECKING:
    from PIL.Image import Image as Pillow

Index = NDArray[np.intp]
PixelWindow = tuple[slice, slice]

_AIR = 0.01  # of the longer side, around a picture and its grid
_FINE = 2  # lines and discs are drawn so many times larger, for Pillow draws them with jagged edges
_LEVELS = np.arange(256)
_WHOLE = slice(0, None), slice(0, None)


def draw_marked(picture: Picture, lines: Sequence[NDArray[np.float64]], points: ControlPoints, size: int) -> Image:
    """A picture with its grid, and its points as lines from source to target.

    Parameters
    ----------
    lines : polylines (n, 2) in picture coordinates.
    size : pixels of the longer side of what is drawn.

    Returns
    -------
    (height, width, 3) uint8.

    Examples
    --------
    >>> from deformnb.volume.plane import Plane, Raster
    >>> plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    >>> picture = Picture(np.zeros((30, 40), np.uint8), plane, Raster((30, 40), (1, 1), (0, 0)), "black", (0.0, 1.0))
    >>> draw_marked(picture, [], ControlPoints.empty(2), 102).shape
    (77, 102, 3)
    """
    from PIL import Image as Images
    from PIL import ImageDraw

    colours = STYLES["dark"]
    paper = _bytes(colours.paper)
    a0, a1, b0, b1 = picture.raster.box
    ends = np.concatenate([*lines, [[a0, b0], [a1, b1]]])
    low, high = ends.min(axis=0), ends.max(axis=0)
    air = _AIR * (high - low).max()
    low, high = low - air, high + air
    scale = _FINE * size / (high - low).max()
    width, height = np.ceil((high - low) * scale / _FINE - 1e-6).astype(int).tolist()
    canvas = Images.new("RGB", (_FINE * width, _FINE * height), paper)

    def at(places: Any) -> list[tuple[float, float]]:
        return [(float(x), float(y)) for x, y in (np.asarray(places) - low) * scale]

    (left, top), (right, bottom) = at([[a0, b0], [a1, b1]])
    extent = max(1, round(right - left)), max(1, round(bottom - top))
    canvas.paste(
        Images.fromarray(_inked(picture)).resize(extent, Images.Resampling.BILINEAR), (round(left), round(top))
    )
    draw = ImageDraw.Draw(canvas)
    for line in lines:
        draw.line(at(line), fill=_bytes(colours.grid), width=_FINE, joint="curve")
    sources, targets = at(points.source), at(points.target)
    for source, target, active in zip(sources, targets, points.active, strict=True):
        if active and source != target:
            draw.line([source, target], fill=_bytes(colours.ink), width=_FINE)
    for x, y in sources:
        draw.circle((x, y), 3 * _FINE, outline=_bytes(SOURCE), width=_FINE)
    for x, y in targets:
        draw.circle((x, y), 2.5 * _FINE, fill=_bytes(TARGET))
    return np.asarray(canvas.resize((width, height), Images.Resampling.BOX))


def _inked(picture: Picture) -> Image:
    """The pixels as drawings in the dark style have them."""
    dark, bright = (np.array(_bytes(c)) for c in (STYLES["dark"].dark, STYLES["dark"].bright))
    if picture.values.ndim == 3 or picture.colour_map != "grey":
        return picture.rgb8(tuple(dark / 255))
    ramp = dark + (_LEVELS / 255)[:, None] * (bright - dark)
    return np.asarray((ramp + 0.5).astype(np.uint8)[(picture.grey() * 255 + 0.5).astype(np.uint8)])


def _bytes(colour: str) -> tuple[int, int, int]:
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


def draw_slices(
    volume: Volume,
    camera: Camera,
    size: tuple[int, int],
    transfer: TransferFunction,
    background: Float3,
    *,
    is_lit: bool = True,
    part: ClipBox | None = None,
) -> Image:
    """A picture of a volume of bytes by light that passes through it, slice by slice.

    Parameters
    ----------
    volume : uint8, and small: a preview needs no more than some 64 to 100 voxels along an axis.
    size : (width, height) in pixels.
    transfer : of the bytes.
    background : red, green and blue in [0, 1].
    is_lit : surfaces are lit as in the projection "shaded".
    part : what is not clipped; None for all.

    Returns
    -------
    (height, width, 3) uint8.

    Examples
    --------
    >>> from deformnb.volume.plane import Plane
    >>> volume = Volume.from_array(np.full((8, 8, 8), 200, np.uint8))
    >>> white = TransferFunction(((0, 1, 1, 1),), ((0, 0), (100, 1)))
    >>> camera = Camera(Plane((3.5, 3.5, 3.5), (1, 0, 0), (0, 1, 0)), height=16)
    >>> draw_slices(volume, camera, (4, 4), white, (0, 0, 0), is_lit=False)[..., 0].tolist()
    [[0, 0, 0, 0], [0, 255, 255, 0], [0, 255, 255, 0], [0, 0, 0, 0]]
    """
    from PIL import Image as Images

    stack = _Stack(volume, camera, size, part)
    rgba = transfer(_LEVELS)
    rgba[:, 3] = 1 - (1 - rgba[:, 3]) ** (stack.thickness / transfer.unit)
    table = (255 * rgba).astype(np.float32)
    plain, is_visible = _rounded(table), rgba[:, 3] > 0
    canvas = Images.new("RGBA", size, (*(round(255 * c) for c in background), 255))
    for k in stack.back_to_front():
        values = stack.values[k]
        there = np.nonzero(is_visible[values] & stack.held(k))
        if len(there[0]):  # no work for the rest: most of a scan is air
            around = _around(*there)
            pixels = plain[values[around]]
            if part is not None:
                pixels[..., 3] *= stack.held(k)[around]
            if is_lit:
                bright = table[values[there], :3] * _light(stack.slopes(k, *there), stack.smallest)[:, None]
                pixels[there[0] - around[0].start, there[1] - around[1].start, :3] = _rounded(bright)
            stack.put(Images.fromarray(pixels), k, around, canvas.alpha_composite)
    return np.asarray(canvas)[..., :3]


def draw_slices_mip(
    volume: Volume,
    camera: Camera,
    size: tuple[int, int],
    white: float,
    ink: Float3,
    background: Float3,
    *,
    part: ClipBox | None = None,
) -> Image:
    """A picture of the largest byte along each ray of a volume, from the background colour to that of the ink.

    Parameters
    ----------
    white : the value that has the colour of the ink.
    volume, size, background, part : as for :func:`draw_slices`.
    """
    from PIL import Image as Images
    from PIL import ImageChops

    stack, low = _Stack(volume, camera, size, part), float(volume.background)
    table = np.clip((_LEVELS - low) / max(white - low, 1e-12), 0, 1)
    table = (255 * table + 0.5).astype(np.uint8)
    canvas = Images.new("L", size)

    def brighten(drawn: Pillow, place: tuple[int, int]) -> None:
        before = canvas.crop((*place, place[0] + drawn.width, place[1] + drawn.height))
        canvas.paste(ImageChops.lighter(before, drawn), place)

    for k in stack.back_to_front():
        grey = table[stack.values[k]] * stack.held(k)
        if grey.any():
            stack.put(Images.fromarray(grey.astype(np.uint8)), k, _WHOLE, brighten)
    v = np.asarray(canvas)[..., None] / 255
    color = np.asarray(ink) * v + np.asarray(background) * (1 - v)
    return np.asarray(np.clip(color, 0, 1) * 255 + 0.5, dtype=np.uint8)


class _Stack:
    """The slices of a volume along the index axis nearest to the direction of view, and where they lie on a picture."""

    def __init__(self, volume: Volume, camera: Camera, size: tuple[int, int], part: ClipBox | None) -> None:
        grid, plane = volume.grid, camera.plane
        # Columns: steps along x, y, z of the index, in lengths along the picture's u, v and n.
        steps = plane.frame @ grid.matrix
        self._axis = int(np.abs(plane.frame[2] @ np.asarray(grid.direction)).argmax())
        across = [axis for axis in range(3) if axis != self._axis]
        order = (2 - self._axis, 2 - across[1], 2 - across[0])
        self.values = volume.values.transpose(order)
        cosine = abs(float((plane.frame[2] @ np.asarray(grid.direction))[self._axis]))
        self.thickness = grid.spacing[self._axis] / cosine
        self.smallest = min(grid.spacing)
        self._normals = plane.frame @ np.asarray(grid.direction)[:, [self._axis, across[1], across[0]]]
        self._spacing = [grid.spacing[axis] for axis in (self._axis, across[1], across[0])]
        self._background = float(volume.background)
        self._held = None if part is None else part.holds(grid).transpose(order)
        self._is_away = steps[2, self._axis] > 0
        # Of the middle of a voxel's lower edge: Pillow's places in an image begin at the edge of the first pixel.
        self._first = plane.to_plane(grid.index_to_point([-0.5 * (axis != self._axis) for axis in range(3)]))
        self._along, self._sides = steps[:, self._axis], steps[:, across]
        self._pixel, self._size, self._distance = camera.height / size[1], size, camera.distance

    def back_to_front(self) -> list[int]:
        """Numbers of the slices, the farthest first."""
        count = len(self.values)
        return list(range(count))[:: -1 if self._is_away else 1]

    def held(self, k: int) -> Any:
        """Mask of the voxels of a slice that are not clipped; 1 for all."""
        return 1 if self._held is None else self._held[k]

    def slopes(self, k: int, rows: Index, columns: Index) -> NDArray[np.float32]:
        """The slope of the values at some voxels of a slice (voxels, 3), along the picture's u, v and n."""
        values = self._padded.ravel()
        at = np.ravel_multi_index((k + 1, rows + 1, columns + 1), self._padded.shape)
        parts = [
            (values[at + stride].astype(np.float32) - values[at - stride]) / np.float32(2 * step)
            for stride, step in zip(self._padded.strides, self._spacing, strict=True)
        ]
        return np.stack(parts, axis=-1) @ self._normals.T.astype(np.float32)

    @cached_property
    def _padded(self) -> NDArray[np.uint8]:
        """The values with one voxel of background around them."""
        return np.pad(np.ascontiguousarray(self.values), 1, constant_values=self._background)

    def put(self, pixels: Pillow, k: int, part: PixelWindow, add: Callable[[Pillow, tuple[int, int]], None]) -> None:
        """Add a part of a slice, as an image of its own, where it lies on the picture."""
        from PIL import Image as Images

        to_picture = self._map(k) @ np.array([[1, 0, part[1].start], [0, 1, part[0].start], [0, 0, 1]])
        width, height = pixels.size
        corners = np.array([[0, width, width, 0], [0, 0, height, height], [1, 1, 1, 1]]).T @ to_picture.T
        if (corners[:, 2] <= 0).any():  # beside or behind the eye
            return
        corners = corners[:, :2] / corners[:, 2:]
        x0, y0 = np.maximum(np.floor(corners.min(axis=0)), 0).astype(int)
        x1, y1 = np.minimum(np.ceil(corners.max(axis=0)), self._size).astype(int)
        if x1 <= x0 or y1 <= y0:
            return
        back = np.linalg.inv(to_picture) @ np.array([[1, 0, x0], [0, 1, y0], [0, 0, 1]])
        back = (back / back[2, 2]).ravel()[:8]
        drawn = pixels.transform(
            (int(x1 - x0), int(y1 - y0)), Images.Transform.PERSPECTIVE, tuple(back), Images.Resampling.BILINEAR
        )
        add(drawn, (int(x0), int(y0)))

    def _map(self, k: int) -> NDArray[np.float64]:
        """Homogeneous 3 x 3 map from places in a slice's image to places on the picture."""
        a, b, c = np.column_stack([self._sides, self._first + k * self._along])
        wide = np.array([0.0, 0.0, 1.0]) + (0.0 if self._distance is None else c / self._distance)
        return np.stack([self._size[0] / 2 * wide + a / self._pixel, self._size[1] / 2 * wide + b / self._pixel, wide])


def _around(rows: Index, columns: Index) -> PixelWindow:
    """The smallest part of a slice with these voxels and their neighbours."""
    top, left = max(0, int(rows.min()) - 1), max(0, int(columns.min()) - 1)
    return slice(top, int(rows.max()) + 2), slice(left, int(columns.max()) + 2)


def _rounded(colours: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.minimum(colours + np.float32(0.5), 255).astype(np.uint8)


def _light(slopes: NDArray[np.float32], smallest: float) -> NDArray[np.float32]:
    """Brightness of places (n,) with slopes (n, 3): that of their surface, and plain colour where there is none.

    As in the ray caster a place is a surface where the slope is a hundredth of the range of bytes per voxel, or more.
    """
    size = np.sqrt((slopes * slopes).sum(axis=-1))
    normals = slopes / np.maximum(size, 1e-6)[..., None]
    sure = np.clip(size * np.float32(2 * smallest / (0.02 * 255)), 0, 1)
    return np.asarray(sure * glow_of(normals, LAMP) + (1 - sure) * np.float32(0.8), np.float32)

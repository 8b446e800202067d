"""Foreground of a volume: the level above the background, and the sides at which it leaves a box."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage
from deformnb._typing import Floats
from deformnb.rbf.regions import Mask
from deformnb.volume.clip import WHOLE, Clip
from deformnb.volume.plane import Picture, Plane, Raster
from deformnb.volume.transfer import levels
from deformnb.volume.volume import Grid, Volume

IsTissue = Callable[[Floats], NDArray[np.bool_]]
"""Test of tissue at points (n, dim) of the input, such as of :func:`tissue_test`."""

# Foreground leaves a box if it does so by more than a voxel and this share of the edge: a scan is often cut through
# tissue.
LEAVES = 0.01

# With the letters that views show at their edges: in a picture from the front, left is on the right.
_TOWARDS = (("left side (L)", "right side (R)"), ("back (P)", "front (A)"), ("top (S)", "bottom (I)"))


def foreground_level(volume: Volume) -> float:
    """The value above which voxels are foreground: the edge between air and tissue, the background of labels."""
    plain = volume.is_labels or volume.dtype == np.bool_
    return float(volume.background if plain else levels(volume)[1])


def find_foreground_voxels(volume: Volume) -> NDArray[np.bool_]:
    """The voxels of a volume above :func:`foreground_level`; on a picture whose rim is bright the dark ones.

    Returns
    -------
    bool, of the shape of the volume.

    Examples
    --------
    >>> paper = np.full((1, 20, 30), 240, np.uint8)
    >>> paper[0, 5:15, 10:20] = 40
    >>> int(find_foreground_voxels(Volume.from_array(paper)).sum())
    100
    """
    values = volume.finite_values
    bright: NDArray[np.bool_] = values > foreground_level(volume)
    if volume.is_labels or values.dtype == np.bool_ or not _is_picture(volume.grid) or not _covers_rim(bright[0]):
        return bright
    inverse = Volume.from_array(values.max() - values)
    return np.asarray(inverse.values > foreground_level(inverse))


def foreground_at(
    volume: Volume, z: NDArray[np.int64], y: NDArray[np.int64], x: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Of :func:`find_foreground_voxels` those with these numbers (n,); fast where they are few."""
    if _is_picture(volume.grid):
        return find_foreground_voxels(volume)[z, y, x]
    return np.asarray(volume.finite_values[z, y, x] > foreground_level(volume))


def _is_picture(grid: Grid) -> bool:
    return grid.shape[0] == 1


def _covers_rim(there: NDArray[np.bool_]) -> bool:
    """Check that more than half of the outermost pixels are set."""
    rim = np.concatenate([there[0], there[-1], there[:, 0], there[:, -1]])
    return bool(rim.mean() > 0.5)


# Cells along the longest side of a mask of which an outline is made: each is less than what leaves a box.
_OUTLINED = 128


def silhouette(volume: Volume, plane: Plane) -> Mask:
    """The foreground of a volume at any depth behind a picture, of at most 128 cells along the longest axis.

    Examples
    --------
    >>> values = np.zeros((8, 8, 32), np.uint8)
    >>> values[2:5, :, 10:14] = 200
    >>> volume = Volume.from_array(values)
    >>> int(silhouette(volume, Plane.from_view(volume.grid, "+y")).values.sum())
    12
    """
    if not _is_picture(volume.grid):
        return coarse_tissue(volume, _OUTLINED).silhouette(plane)
    grid, there = volume.grid, find_foreground_voxels(volume)
    factor = max(1, -(-max(there.shape) // _OUTLINED))
    cells = _mostly_set(there[0], factor)[None]
    spacing = (factor * grid.spacing[0], factor * grid.spacing[1], grid.spacing[2])
    origin = tuple(grid.index_to_point(np.array([(factor - 1) / 2, (factor - 1) / 2, 0.0])).tolist())
    return Mask(cells, replace(grid, shape=cells.shape, spacing=spacing, origin=origin)).silhouette(plane)


def picture_silhouette(picture: Picture) -> Mask:
    """The foreground of a picture as it is seen, of at most 128 cells along its longer side.

    Examples
    --------
    >>> plane, raster = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), Raster((4, 6), (1.0, 1.0), (0.0, 0.0))
    >>> grey = np.zeros((4, 6), np.uint8)
    >>> grey[1:3, 2:5] = 200
    >>> int(picture_silhouette(Picture(grey, plane, raster, "mip", (0.0, 200.0))).values.sum())
    6
    """
    grey = picture.values if picture.values.ndim == 2 else picture.grey()
    there = find_foreground_voxels(Volume.from_array(np.ascontiguousarray(grey)[None]))[0]
    factor = max(1, -(-max(there.shape) // _OUTLINED))
    cells, ((du, dv), (a, b)) = _mostly_set(there, factor), (picture.raster.spacing, picture.raster.origin)
    middle = (factor - 1) / 2
    rows, columns = cells.shape
    return Mask(cells, Raster((rows, columns), (factor * du, factor * dv), (a + middle * du, b + middle * dv)))


def _mostly_set(there: NDArray[np.bool_], factor: int) -> NDArray[np.bool_]:
    """Squares of so many pixels in which at least half are set: specks of noise are no subject."""
    high, wide = (max(1, n // factor) for n in there.shape)
    squares = there[: high * factor, : wide * factor].reshape(high, factor, wide, factor) if factor > 1 else None
    return there if squares is None else np.asarray(squares.mean(axis=(1, 3)) >= 0.5)


# The foreground of a slice counts from this share of it on: dust and the noise of air are less, the tip of a fin is
# more.
_LEAST_OF_SLICE = 5e-4
_SAMPLED_VOXELS = 2**21  # of which the box is found: it is exact to the distance of samples, 1 % of 128 samples
_BOX_MARGIN = 0.03  # of the box, on each side: whiskers and the skin are below the level


def foreground_shares(volume: Volume) -> Clip:
    """The part of the box of a volume that holds its foreground, with a small margin; all of it where there is none.

    Returns
    -------
    Pairs (low, high) of shares of the box from 0 to 1 along x, y and z.

    Examples
    --------
    >>> values = np.zeros((10, 20, 50), np.uint8)
    >>> values[:, 4:16, 10:40] = 200
    >>> [[round(share, 2) for share in pair] for pair in foreground_shares(Volume.from_array(values))]
    [[0.18, 0.82], [0.18, 0.82], [0.0, 1.0]]
    """
    step = max(1, round((volume.values.size / _SAMPLED_VOXELS) ** (1 / 3)))
    there = volume.finite_values[::step, ::step, ::step] > foreground_level(volume)
    pairs: list[tuple[float, float]] = []
    for axis in (2, 1, 0):
        others = tuple(k for k in range(3) if k != axis)
        counts = np.count_nonzero(there, axis=others)
        found = np.flatnonzero(counts > _LEAST_OF_SLICE * there.size / there.shape[axis])
        if not found.size:
            return WHOLE
        margin = _BOX_MARGIN * (found[-1] + 1 - found[0])
        low, high = (found[0] - margin) / len(counts), (found[-1] + 1 + margin) / len(counts)
        pairs.append((max(0.0, float(low)), min(1.0, float(high))))
    return pairs[0], pairs[1], pairs[2]


# Voxels around tissue that count as such: a fold next to it would still be visible.
_BESIDE_TISSUE = 2


def coarse_tissue(volume: Volume, most: int) -> Mask:
    """The foreground of a volume at every n-th voxel, so that no axis has more than ``most``.

    Examples
    --------
    >>> values = np.zeros((8, 8, 32), np.uint8)
    >>> values[:, :, 10:14] = 200
    >>> coarse_tissue(Volume.from_array(values), 16).values.shape
    (8, 8, 16)
    """
    factors = [-(-count // most) for count in volume.shape]
    there = volume.values[tuple(slice(None, None, factor) for factor in factors)] > foreground_level(volume)
    dx, dy, dz = (step * factor for step, factor in zip(volume.grid.spacing, factors[::-1], strict=True))
    return Mask(there, replace(volume.grid, shape=there.shape, spacing=(dx, dy, dz)))


def tissue_test(volume: Volume, plane: Plane | None = None) -> IsTissue:
    """A test whether points (n, 3) lie in the foreground of a volume, or within two voxels of it.

    Parameters
    ----------
    plane : whose depth is ignored: places in front of tissue, or behind it, count as tissue too. Only along
        an axis of the volume; of other planes every point counts.

    Examples
    --------
    >>> values = np.zeros((8, 8, 32), np.uint8)
    >>> values[:, :, 10:14] = 200
    >>> tissue_test(Volume.from_array(values))(np.array([[12.0, 4, 4], [8, 4, 4], [3, 4, 4]])).tolist()
    [True, True, False]
    """
    depth = None
    if plane is not None:
        cosines = np.abs(np.asarray(volume.grid.direction).T @ plane.frame[2])
        depth = int(cosines.argmax())
        if not np.isclose(cosines[depth], 1.0, atol=1e-6):
            return lambda x: np.ones(len(x), np.bool_)

    @cache
    def mask() -> NDArray[np.bool_]:  # at the first call: most maps are far from folding, and nothing is tested
        there: NDArray[np.bool_] = volume.finite_values > foreground_level(volume)
        if depth is not None:
            there = np.asarray(there.any(axis=2 - depth, keepdims=True))
        for axis in (axis for axis in range(3) if there.shape[axis] > 1):
            there = ndimage.maximum_filter1d(there, 2 * _BESIDE_TISSUE + 1, axis=axis, mode="constant")
        return there

    def is_tissue(x: NDArray[np.float64]) -> NDArray[np.bool_]:
        there = mask()
        index = np.rint(volume.grid.point_to_index(x)).astype(np.int64)
        if depth is not None:
            index[:, depth] = 0
        within = np.clip(index, 0, np.array(there.shape[::-1]) - 1)
        i, j, k = within.T
        return np.asarray((index == within).all(axis=1) & there[k, j, i])

    return is_tissue


PICTURE_SIDES = ("left side", "right side", "top", "bottom")
"""The sides of a picture as it is seen."""

# Of a volume that is a picture, and of a grid whose axes are not known to be a patient's.
_PICTURE_ENDS = (PICTURE_SIDES[1::-1], PICTURE_SIDES[:1:-1], ("back", "front"))
_AXIS_ENDS = (("high x side", "low x side"), ("high y side", "low y side"), ("high z side", "low z side"))


def leaving_voxels(box: Grid) -> Floats:
    """Voxels along x, y, z beyond the sides of a box, from which on foreground counts as outside."""
    most: Floats = 1.0 + LEAVES * np.array(box.shape[::-1])
    return most


def side_names(box: Grid) -> tuple[str, ...]:
    """The six sides of a box in words: where x is lowest and highest, then y, then z.

    Examples
    --------
    >>> side_names(Grid((4, 4, 4)))[:2]
    ('right side (R)', 'left side (L)')
    """
    names = []
    for axis in np.asarray(box.direction).T:
        for towards in (-axis, axis):
            world = int(np.abs(towards).argmax())
            words = _TOWARDS if box.is_anatomical else _PICTURE_ENDS if _is_picture(box) else _AXIS_ENDS
            names.append(words[world][int(towards[world] < 0)])
    return tuple(names)


def picture_side_names(plane: Plane, box: Grid | None) -> tuple[str, ...]:
    """The sides of a box that are the four sides of a picture: left, right, upper and lower side as it is seen.

    Parameters
    ----------
    box : None of a picture that is of no volume.

    Examples
    --------
    >>> box = Grid((4, 4, 4))
    >>> picture_side_names(Plane.from_view(box, "+y"), box)
    ('right side (R)', 'left side (L)', 'top (S)', 'bottom (I)')
    """
    if box is None:
        return PICTURE_SIDES
    names, axes = side_names(box), np.asarray(box.direction).T
    found: list[str] = []
    for way in (plane.frame[0], plane.frame[1]):
        cosines = axes @ way
        axis = int(np.abs(cosines).argmax())
        low, high = names[2 * axis : 2 * axis + 2]
        found += [low, high] if cosines[axis] > 0 else [high, low]
    return tuple(found)


CUT_OFF = "Tissue leaves the box at the {sides}, and is cut off there."
"""A warning of foreground that is cut off; braces hold the names of the sides."""

LARGER_BOX = "Make the box larger"
LARGER_BOX_TIP = "As large as needed, now and after every edit: then nothing is cut off"
"""The remedy next to the warning: its name and what it does."""


def cut_off_text(sides: tuple[str, ...]) -> str:
    """A warning of foreground cut off at these sides of the box; empty for none.

    Examples
    --------
    >>> cut_off_text(("left side (L)", "top (S)"))
    'Tissue leaves the box at the left side (L) and top (S), and is cut off there.'
    """
    return CUT_OFF.format(sides=join_names(sides)) if sides else ""


def join_names(sides: tuple[str, ...]) -> str:
    """Names of sides in a sentence, with commas and an "and"."""
    return " and ".join([", ".join(sides[:-1]), sides[-1]]) if len(sides) > 1 else sides[0]

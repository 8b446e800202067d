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
from deformnb.volume.plane import Plane
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


# Of a grid whose axes are not known to be a patient's.
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
            words = _TOWARDS if box.is_anatomical else _AXIS_ENDS
            names.append(words[world][int(towards[world] < 0)])
    return tuple(names)


def cut_off_text(sides: tuple[str, ...]) -> str:
    """A warning of foreground cut off at these sides of the box; empty for none.

    Examples
    --------
    >>> cut_off_text(("left side (L)", "top (S)"))
    'Tissue leaves the box at the left side (L) and top (S), and is cut off there.'
    """
    return f"Tissue leaves the box at the {join_names(sides)}, and is cut off there." if sides else ""


def join_names(sides: tuple[str, ...]) -> str:
    """Names of sides in a sentence, with commas and an "and"."""
    return " and ".join([", ".join(sides[:-1]), sides[-1]]) if len(sides) > 1 else sides[0]

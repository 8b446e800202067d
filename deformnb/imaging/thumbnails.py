"""Small pictures of a volume in the colours of each preset, made in some tenths of a second from a coarse copy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from deformnb.imaging.projection import project
from deformnb.volume.coarsening import block_means, coarser
from deformnb.volume.transfer import PresetName, levels, preset
from deformnb.volume.views import ViewName
from deformnb.volume.volume import Volume, as_volume

_VOXELS = 64  # along each axis of the coarse copy, up to half as many again
_SEEN, _MARGIN = 0.02, 0.04  # the cropped border around the subject is empty, but for a margin


def preset_thumbnails(
    volume: Volume, view: ViewName = "+y", size: int = 112, names: Iterable[PresetName] = get_args(PresetName)
) -> dict[str, NDArray[np.uint8]]:
    """Pictures of a volume in the colours of presets, by their names: all show the same part, that of the subject.

    Parameters
    ----------
    volume : a coarse copy of it is drawn, in the presets' colours for the volume itself.
    view : one of :data:`~deformnb.volume.views.VIEWS`.
    size : pixels along each side.
    names : of :data:`~deformnb.volume.transfer.PRESETS`.

    Returns
    -------
    (size, size, 4) each: red, green, blue and opacity.

    Examples
    --------
    >>> values = np.zeros((9, 9, 9), np.uint8)
    >>> values[2:7, 2:7, 2:7] = 200
    >>> found = preset_thumbnails(Volume.from_array(values), size=32)
    >>> sorted(found)
    ['bone', 'muscle', 'specimen', 'surface', 'xray']
    >>> found["surface"].shape, int(found["surface"][16, 16, 3] > 200)
    ((32, 32, 4), 1)
    """
    volume = as_volume(volume)
    low, _, _, high = levels(volume)
    high = high if high > low else low + 1.0
    coarse = _coarse(volume, low, high)
    pictures = {
        name: project(coarse, view, "shaded", transfer=preset(name, volume).quantize(low, high)) for name in names
    }
    seen = np.any([picture.values[..., 3] > _SEEN for picture in pictures.values()], axis=0)
    return {
        name: _fit_square(picture.values, seen, picture.raster.spacing[::-1], size)
        for name, picture in pictures.items()
    }


def _coarse(volume: Volume, low: float, high: float) -> Volume:
    """A small copy of the values in a window, from 0 to 255: means of eight places in each block of voxels.

    Of labels one place is taken.
    """
    parts = [1 if volume.is_labels or n < 2 * _VOXELS * 0.75 else 2 for n in volume.shape]
    strides = [max(1, round(n / _VOXELS / part)) for n, part in zip(volume.shape, parts, strict=True)]
    taken = volume.finite_values[tuple(slice(None, None, stride) for stride in strides)].astype(np.float64)
    shares = (255 * np.clip((taken - low) / (high - low), 0, 1)).astype(np.float32)
    fz, fy, fx = (stride * part for stride, part in zip(strides, parts, strict=True))
    pz, py, px = parts
    values = block_means(shares, (px, py, pz))
    grid = replace(coarser(volume.grid, (fx, fy, fz)), shape=values.shape)
    return Volume(values, grid)


def _fit_square(
    picture: NDArray[np.float32], seen: NDArray[np.bool_], steps: tuple[float, ...], size: int
) -> NDArray[np.uint8]:
    """The part that is seen, in the middle of a square."""
    from PIL import Image

    rows, columns = (
        np.flatnonzero(seen.any(axis=axis)) if seen.any() else np.arange(seen.shape[1 - axis]) for axis in (1, 0)
    )
    part = picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    lengths = np.array(part.shape[:2]) * steps
    height, width = np.maximum(1, np.round(lengths / lengths.max() * size * (1 - 2 * _MARGIN))).astype(int)
    planes = [
        np.asarray(Image.fromarray(part[..., c]).resize((width, height), Image.Resampling.BICUBIC)) for c in range(4)
    ]
    large = np.clip(np.stack(planes, axis=-1), 0, 1)
    large[..., :3] = np.minimum(1, large[..., :3] / np.maximum(large[..., 3:], 1e-6))
    canvas = np.zeros((size, size, 4), np.uint8)
    top, left = (size - height) // 2, (size - width) // 2
    canvas[top : top + height, left : left + width] = (255 * large + 0.5).astype(np.uint8)
    return canvas

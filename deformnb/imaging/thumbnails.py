"""Small pictures of a volume in the colours of each preset, made in some hundredths of a second.

All presets share the layers of a coarse copy and their light, which the ray caster of
:mod:`~deformnb.imaging.raycast` would sample anew for each.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3
from deformnb.imaging.projection import voxel_order
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import PRESETS, TransferFunction, levels, preset
from deformnb.volume.volume import Volume, as_volume

_VOXELS = 64  # along each axis of the coarse copy, up to half as many again
_LEVELS = 256
_AMBIENT, _DIFFUSE = 0.45, 0.65
_FLAT = 0.02  # of the range per voxel: a slope below is noise
_SEEN, _MARGIN = 0.02, 0.04  # what is cut out around the subject is empty, but for a margin


def preset_thumbnails(
    volume: Volume, view: str = "+y", size: int = 112, names: Iterable[str] = tuple(PRESETS)
) -> dict[str, NDArray[np.uint8]]:
    """Pictures of a volume in the colours of presets, by their names: all show the same part, that of the subject.

    Parameters
    ----------
    volume : a coarse copy of it is drawn, in the presets' colours for the volume itself.
    view : one of :data:`~deformnb.volume.plane.VIEWS`.
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
    low, _, _, high = levels(as_volume(volume))
    share, steps = _coarse_layers(volume, view, low, high)
    light, codes = _light(share, steps), (share * (_LEVELS - 1) + 0.5).astype(np.uint8)
    values = np.linspace(low, high, _LEVELS)
    made = {name: _composite(codes, light, preset(name, volume), values, steps[0]) for name in names}
    seen = np.any([picture[..., 3] > _SEEN for picture in made.values()], axis=0)
    return {name: _fitted(picture, seen, steps[1:], size) for name, picture in made.items()}


def _coarse_layers(volume: Volume, view: str, low: float, high: float) -> tuple[NDArray[np.float32], Float3]:
    """Shares [depth, v, u] of the way from ``low`` to ``high`` as seen from a side, and their distances.

    They are means of eight places of each block of voxels; of labels one is taken.
    """
    order = voxel_order(volume.grid, Plane.along(volume, view))
    assert order is not None  # the plane lies along the axes of the voxels
    values = volume.finite_values.transpose([axis for axis, _ in order])[tuple(slice(None, None, s) for _, s in order)]
    parts = [1 if volume.is_labels or n < 2 * _VOXELS * 0.75 else 2 for n in values.shape]
    strides = [max(1, round(n / _VOXELS / part)) for n, part in zip(values.shape, parts, strict=True)]
    taken = values[tuple(slice(None, None, stride) for stride in strides)].astype(np.float64)
    share = np.clip((taken - low) / ((high - low) or 1.0), 0, 1).astype(np.float32)
    for axis, part in enumerate(parts):
        share = share.take(range(share.shape[axis] // part * part), axis)
        share = share.reshape(*share.shape[:axis], -1, part, *share.shape[axis + 1 :]).mean(axis=axis + 1)
    dn, dv, du = (
        volume.grid.spacing[2 - axis] * stride * part
        for (axis, _), stride, part in zip(order, strides, parts, strict=True)
    )
    return share, (dn, dv, du)


def _light(share: NDArray[np.float32], steps: Float3) -> NDArray[np.float32]:
    """Light on what has a surface, of a lamp above the viewer's left shoulder."""
    slopes = [np.gradient(share, axis=axis) if share.shape[axis] > 1 else np.zeros_like(share) for axis in range(3)]
    size = np.sqrt(sum((slope / d) ** 2 for slope, d in zip(slopes, steps, strict=True))) * min(steps)
    lamp = np.array((0.82, 0.45, 0.35)) / np.linalg.norm((0.82, 0.45, 0.35))
    facing = np.abs(sum(slope * (c / d) for slope, c, d in zip(slopes, lamp, steps, strict=True))) * min(steps)
    sure = np.clip(size / _FLAT, 0, 1)
    lit = _AMBIENT + _DIFFUSE * facing / np.maximum(size, 1e-9)
    return np.asarray(1 - sure * (1 - lit), np.float32)


def _composite(
    codes: NDArray[np.uint8],
    light: NDArray[np.float32],
    function: TransferFunction,
    values: NDArray[np.float64],
    thickness: float,
) -> NDArray[np.float32]:
    """Front to back, over layers [depth, v, u] of levels: red, green, blue times opacity, and opacity."""
    table = function(values).astype(np.float32)
    alpha = (-np.expm1(thickness / function.unit * np.log1p(-np.minimum(table[:, 3], 0.9999))))[codes]
    through = np.cumprod(1 - alpha, axis=0)
    weight = np.concatenate([alpha[:1], alpha[1:] * through[:-1]])
    colors = [np.einsum("nvu,nvu->vu", weight * light, table[:, c][codes]) for c in range(3)]
    return np.stack([*colors, 1 - through[-1]], axis=-1)


def _fitted(
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

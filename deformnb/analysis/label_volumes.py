"""Volumes of labels: how large each region of a segmentation is before and after a deformation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.volume.volume import Volume, VolumeLike, as_volumes, slabs


@dataclass(frozen=True)
class LabelVolume:
    """One region of a segmentation, before and after.

    Parameters
    ----------
    label : the number of its voxels.
    name : of the label; empty if that is not known.
    before, after : its volume, in the cube of the unit of the spacing (mm³).

    Examples
    --------
    >>> row = LabelVolume(3, "liver", 1500.0, 1530.0)
    >>> row.after - row.before
    30.0
    """

    label: int
    name: str
    before: float
    after: float

    @property
    def change(self) -> float:
        """Change in percent of the volume before; NaN where there was none."""
        return 100 * (self.after - self.before) / self.before if self.before else math.nan


def label_volumes(
    before: VolumeLike, after: VolumeLike, names: Mapping[int, str] | None = None
) -> tuple[LabelVolume, ...]:
    """The volume of each label before and after a deformation: number of voxels times the size of a voxel.

    Parameters
    ----------
    before, after : labels, each on its own grid; whole numbers or bool.
    names : of the labels, as :func:`deformnb.io.read_label_names` finds them.

    Returns
    -------
    One row for each label of either volume, by number, without 0, the background.

    Raises
    ------
    DeformError
        If the voxels of one are not whole numbers.

    Examples
    --------
    >>> before = Volume.from_array(np.array([[0, 1, 1, 2]], np.uint8), spacing=(2, 1, 1))
    >>> after = Volume.from_array(np.array([[1, 1, 1, 2]], np.uint8), spacing=(2, 1, 1))
    >>> for row in label_volumes(before, after, {1: "liver"}):
    ...     print(row.label, row.name, row.before, row.after, row.change)
    1 liver 4.0 6.0 50.0
    2  2.0 2.0 0.0
    """
    first, second = as_volumes((before, after))
    both = (first, second.to_unit(first.grid.unit))
    counts = [_counts(volume) for volume in both]
    sizes = [float(np.prod(volume.grid.spacing)) for volume in both]
    named = names or {}
    return tuple(
        LabelVolume(label, named.get(label, ""), counts[0].get(label, 0) * sizes[0], counts[1].get(label, 0) * sizes[1])
        for label in sorted(counts[0].keys() | counts[1].keys())
        if label != 0
    )


def _counts(volume: Volume) -> dict[int, int]:
    values = volume.values
    if values.dtype.kind not in "iub":
        raise DeformError(f"labels are whole numbers, and the voxels of {short_value(volume.name)} are {values.dtype}.")
    found: dict[int, int] = {}
    for slab in slabs(values):
        part: NDArray[np.int64]
        numbers, part = np.unique(slab, return_counts=True)
        for number, count in zip(numbers.tolist(), part.tolist(), strict=True):
            found[int(number)] = found.get(int(number), 0) + int(count)
    return found

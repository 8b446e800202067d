"""Headers of volume files: shape, type and place of the voxels, before any voxel is read.

Headers are read by this package's own short parsers with bounds on everything, because common readers crash, hang or
load garbage in silence when a header is wrong. Text of a header is only ever text.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Float3
from deformnb.errors import DeformError
from deformnb.io.files.errors import fail, printable
from deformnb.volume.volume import IDENTITY, Grid, Matrix3

HEADER_BYTES = 2**20
"""Longest text header that is read. Real ones have a few kB; scanners' private fields are below 100 kB."""

MOST_SKIPPED = 2**26
"""Maximum of bytes or lines before the voxels that a header may skip."""

# Sizes are Python integers, so nothing overflows; this many bytes no machine has (an exbibyte).
_TOO_MANY_BYTES = 2**60

VoxelBlocks = Callable[[], Iterator[NDArray[Any]]]

# More channels or moments than this are no channels but a damaged header, or another kind of axis.
MOST_MOMENTS = 1_000_000
"""Moments of a file."""
_MOST_CHANNELS = 1024


@dataclass(frozen=True)
class Layout:
    """Axes of a file besides the three of a volume: channels, moments in time, or both.

    Parameters
    ----------
    frames : number of moments.
    channels : number of channels, or of the parts of a colour.
    kind : a key of :data:`~deformnb.volume.channels.CHANNEL_KINDS`.
    names : of the channels; empty where the file has none.
    colours : of the channels; empty where the file has none.
    interleaved : blocks come as [some z, y, x, channel], frame by frame; else as [some z, y, x], of each frame all
        slices of its first channel, then those of the second, and so on.
    duration : from one frame to the next; 0 if the file does not state it.
    is_vector : the file states that its channels are the components of vectors.
    """

    frames: int = 1
    channels: int = 1
    kind: str = "channels"
    names: tuple[str, ...] = ()
    colours: tuple[Float3, ...] = ()
    interleaved: bool = False
    duration: float = 0.0
    is_vector: bool = False

    @property
    def is_single(self) -> bool:
        """True if the file holds one volume."""
        return self.frames == 1 and self.channels == 1

    def __str__(self) -> str:
        parts = [f"{self.frames} moments"] * (self.frames > 1)
        if self.kind != "channels":
            parts.append("colours")
        elif self.is_vector:
            parts.append(f"vectors of {self.channels} components")
        elif self.channels > 1:
            parts.append(f"{self.channels} channels")
        return " of ".join(parts) or "one volume"


SINGLE = Layout()
"""The layout of one volume."""


def layout_description(layout: Layout) -> str:
    """Kind, names and colours of the channels as one line of JSON, for a comment in a header."""
    return json.dumps({"kind": layout.kind, "names": layout.names, "colours": layout.colours})


def parse_channels(layout: Layout, text: str) -> Layout:
    """The layout with the channels of such a line, where it fits; else unchanged."""
    try:
        found = json.loads(text) if text else {}
        colours = tuple(triple([min(1.0, max(0.0, float(part))) for part in colour]) for colour in found["colours"])
        names = tuple(printable(name) for name in found["names"])
        if layout.channels == {"rgb": 3, "rgba": 4}.get(
            found["kind"], layout.channels if found["kind"] == "channels" else 0
        ):
            layout = replace(layout, kind=found["kind"], is_vector=False)
    except (ValueError, TypeError, KeyError, IndexError, RecursionError):
        return layout
    return replace(
        layout,
        names=names if len(names) == layout.channels else (),
        colours=colours if len(colours) == layout.channels else (),
    )


def check_layout(path: Path, layout: Layout) -> Layout:
    """The layout, if its numbers can be; VolumeFileError else."""
    if not (1 <= layout.channels <= _MOST_CHANNELS and 1 <= layout.frames <= MOST_MOMENTS):
        raise fail(
            path,
            f"it has {layout.frames} moments and {layout.channels} channels, more than can be; the header "
            "is damaged, or it holds something else than channels or times.",
        )
    return layout


@dataclass(frozen=True)
class Geometry:
    """Place of the voxels as a file states it, in LPS; a spacing may be negative or wrong until :meth:`Header.grid`.

    Parameters
    ----------
    affine : 4 x 4 LPS map of indices (i, j, k), for files that have one instead of the three.
    is_anatomical : whether the file states where a patient's left, back and head are.
    """

    spacing: Float3 = (1.0, 1.0, 1.0)
    origin: Float3 = (0.0, 0.0, 0.0)
    direction: Matrix3 = IDENTITY
    affine: NDArray[np.float64] | None = None
    is_anatomical: bool = False


@dataclass(frozen=True)
class Header:
    """Description of a volume file, without its voxels.

    Parameters
    ----------
    path : the file (or the folder of a series).
    shape : (nz, ny, nx).
    dtype : voxel type as stored, byte order included.
    blocks : opens the file and yields the voxels in order, as arrays of whole slices in the stored type.
    geometry : where the voxels are, as the file states it.
    slope, intercept : voxels mean ``slope * stored + intercept``.
    transposed : blocks come along x, as [x, y, z].
    is_labels : as in the file, None if it is not stated.
    notes : remarks for a status line.
    working_bytes : memory that reading takes besides the voxels: a page, a packed and an unpacked strip or tile.
    layout : channels and moments; the shape is that of one channel at one moment, the blocks are those of all.
    levels : headers of all resolutions of a pyramid, this one the first; empty for other files.
    unit : of lengths, a symbol of :data:`~deformnb.volume.units.UNITS`; "" where the file states none.
    """

    path: Path
    shape: tuple[int, int, int]
    dtype: np.dtype[Any]
    blocks: VoxelBlocks
    geometry: Geometry = Geometry()
    slope: float = 1.0
    intercept: float = 0.0
    transposed: bool = False
    is_labels: bool | None = None
    notes: tuple[str, ...] = ()
    working_bytes: int = 0
    layout: Layout = SINGLE
    levels: tuple[Header, ...] = ()
    unit: str = ""

    @property
    def is_scaled(self) -> bool:
        """True if stored numbers differ from the values that they encode."""
        return (self.slope, self.intercept) != (1.0, 0.0)

    @property
    def loaded_dtype(self) -> np.dtype[Any]:
        """Native type of the voxels once loaded; scaled ones become float32, or float64 where 24 bits are too few."""
        return np.result_type(self.dtype, np.float32) if self.is_scaled else self.dtype.newbyteorder("=")

    def scaled(self, stored: NDArray[Any]) -> NDArray[Any]:
        """The values that stored numbers mean; float64 if they are scaled."""
        return stored.astype(np.float64) * self.slope + self.intercept if self.is_scaled else stored

    def grid(self, spacing: Float3 | None = None) -> tuple[Grid, tuple[str, ...]]:
        """Grid of the voxels, with another spacing if given, and remarks; a negative spacing flips its direction."""
        notes: tuple[str, ...] = ()
        stated = self.geometry
        try:
            if stated.affine is not None:
                grid = Grid.from_affine(self.shape, stated.affine, self.unit)
                grid = replace(grid, is_anatomical=stated.is_anatomical)
                return (grid if spacing is None else replace(grid, spacing=spacing)), notes
            lengths, direction, notes = straighten(stated.spacing if spacing is None else spacing, stated.direction)
            return Grid(self.shape, lengths, stated.origin, direction, self.unit, stated.is_anatomical), notes
        except DeformError as error:
            raise fail(self.path, str(error)) from error


def straighten(spacing: Float3, direction: Matrix3) -> tuple[Float3, Matrix3, tuple[str, ...]]:
    """The same axes with positive spacing: the sign moves into the column of direction; with a remark if one moved."""
    lengths = np.asarray(spacing, dtype=np.float64)
    if lengths.shape != (3,) or not (lengths < 0).any():
        return spacing, direction, ()
    flips = np.where(lengths < 0, -1.0, 1.0)
    turned = np.asarray(direction, dtype=np.float64) * flips
    named = " and ".join(axis for axis, flip in zip("xyz", flips, strict=True) if flip < 0)
    positive = (float(abs(lengths[0])), float(abs(lengths[1])), float(abs(lengths[2])))
    rows: Matrix3 = tuple(tuple(row) for row in turned.tolist())  # type: ignore[assignment]
    return positive, rows, (f"the spacing along {named} is negative in the file: the axis is flipped instead",)


def triple(values: list[float]) -> Float3:
    """Three floats as a tuple."""
    return values[0], values[1], values[2]


def volume_shape(path: Path, sizes: list[int], itemsize: int) -> tuple[tuple[int, int, int], tuple[str, ...]]:
    """(nz, ny, nx) of the sizes along x, y, z and beyond, and a remark for a single picture.

    Raises
    ------
    VolumeFileError
        For a size below one, more than three real axes (listed), or more bytes than there can be.
    """
    if not sizes or min(sizes) < 1:
        raise fail(path, f"every size must be at least 1 voxel, but the sizes along x, y, z are {sizes}.")
    real = list(sizes)
    while len(real) > 3 and real[-1] == 1:
        real.pop()
    if len(real) > 3:
        names = ("x", "y", "z", "t", "5th", "6th", "7th")
        axes = ", ".join(f"{name}: {size}" for name, size in zip(names, real, strict=False))
        raise fail(
            path,
            f"a volume has three axes but this file has {len(real)} ({axes}). Save one time point or one "
            "channel as a separate file and read that.",
        )
    notes = ("a 2-D image was taken as a volume of one slice",) if len(sizes) < 3 else ()
    nx, ny, nz = (*real, 1, 1)[:3]
    if math.prod(real) * itemsize >= _TOO_MANY_BYTES:
        raise fail(path, f"the sizes {real} need more memory than any machine has; the header is damaged.")
    return (nz, ny, nx), notes

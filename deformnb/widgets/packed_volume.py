"""Volumes packed for the GPU: small enough, one byte a voxel, in compressed pieces.

The 256 levels of a byte cover a window of values, which is narrower, and so finer, where a transfer function changes
within a small part of it.
"""

from __future__ import annotations

import gzip
import threading
import uuid
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.checks import check_window
from deformnb.errors import DeformError
from deformnb.volume.coarsening import block_means, coarser
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import TransferFunction, levels
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.messages.views import BoxData

# A piece of the volume in transit to the front end: below the 10 MB that proxies and servers refuse, large enough that
# the round trip of some 50 ms does not count.
MOST_VOXELS_SENT = 256**3
"""Voxels that a front end gets at most; a larger volume is averaged."""

PACKED_CHUNK_BYTES = 2**21
_LEVEL = 1  # gzip: 16.8 MB in 0.1 to 0.4 s; level 6 takes five times as long for a tenth less

_TABLE = 2**17  # voxels from which on a table of what becomes of each whole number is quicker than to compute it

_AXES = "xyz"


@dataclass(frozen=True, eq=False)
class PackedVolume:
    """Voxels of a volume as bytes, at the resolution and in the intensity window in which they are shown.

    Parameters
    ----------
    volume : bytes on a grid that may be coarser than the original.
    original : grid of the volume as it was given; its box is visible.
    window : values shown as 0 and 255.
    factors : how many voxels were averaged along x, y, z.
    id : of this content, so that late pieces of other contents are dropped.
    outside : the byte outside the volume.
    white : share of the window that is white in a maximum projection.
    share : of all values of interest that the window holds; 1 shows them all.
    """

    volume: Volume
    original: Grid
    window: tuple[float, float]
    factors: tuple[int, int, int]
    id: str
    outside: int
    white: float
    share: float = 1.0

    @property
    def note(self) -> str:
        """Note for the user: "shown at 1/2"."""
        fine = f"finer greys from {self.window[0]:.4g} to {self.window[1]:.4g}" if self.share < 1 else ""
        return "; ".join(words for words in (fine, self._size_note) if words)

    @property
    def _size_note(self) -> str:
        if max(self.factors) == 1:
            return ""
        if len(set(self.factors)) == 1:
            return f"shown at 1/{self.factors[0]}"
        parts = [f"1/{f} along {axis}" for axis, f in zip(_AXES, self.factors, strict=True) if f > 1]
        return "shown at " + ", ".join(parts)

    @property
    def slices(self) -> int:
        """Slices in one piece."""
        nz, ny, nx = self.volume.shape
        return min(nz, max(1, PACKED_CHUNK_BYTES // (ny * nx)))

    @property
    def chunks(self) -> int:
        """Number of pieces."""
        return -(-self.volume.shape[0] // self.slices)

    def chunk(self, index: int) -> tuple[int, bytes]:
        """Place of the first voxel of a piece, and its voxels packed by gzip."""
        first = index * self.slices
        voxels = np.ascontiguousarray(self.volume.values[first : first + self.slices])
        start = first * self.volume.shape[1] * self.volume.shape[2]
        return start, gzip.compress(voxels.tobytes(), _LEVEL, mtime=0)

    def to_frame(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points in space as lengths along the index axes, from the centre of the first voxel: the GPU's frame."""
        return np.asarray(self.volume.grid.point_to_index(points) * np.asarray(self.volume.grid.spacing))

    @property
    def frame(self) -> NDArray[np.float64]:
        """3 x 3 rows, from vectors in space to the GPU's frame."""
        grid = self.volume.grid
        return np.asarray(grid.inverse * np.asarray(grid.spacing)[:, None])

    def box(self, grid: Grid | None = None) -> BoxData:
        """The box of a grid (default: the volume's own) along the index axes."""
        corners = self.to_frame((grid or self.original).corners())
        return {"low": corners.min(axis=0).tolist(), "high": corners.max(axis=0).tolist()}

    def info(self) -> dict[str, Any]:
        """Facts for the front end before the voxels come."""
        grid = self.volume.grid
        home = {"direction": [0.4, 1.0, -0.3], "up": [0.0, 0.0, 1.0]}
        views = {view: _camera_axes(Plane.from_view(self.original, view)) for view in VIEWS}
        return {
            "id": self.id,
            "shape": list(grid.shape[::-1]),
            "spacing": list(grid.spacing),
            "origin": list(grid.origin),
            "chunks": self.chunks,
            "to_frame": self.frame.tolist(),
            "axes": np.asarray(grid.direction).tolist(),
            "box": self.box(),
            "outside": self.outside,
            "is_labels": self.volume.is_labels,
            "grey": [0.0, self.white],
            "note": self.note,
            "share": self.share,
            "unit": unit_of(self.original),
            "anatomical": self.original.is_anatomical,
            "views": {**views, "home": home},
        }


class Pieces:
    """The packed pieces of one volume, each made once, whichever thread requests it first.

    Parameters
    ----------
    volume : whose pieces they are. Another volume has other pieces, so that none of this one gets among them.

    Examples
    --------
    >>> volume = packed_volume(Volume.from_array(np.zeros((2, 3, 4), np.uint8)), 100, 100)
    >>> start, packed = Pieces(volume)[0]
    >>> start, len(gzip.decompress(packed))
    (0, 24)
    """

    def __init__(self, volume: PackedVolume) -> None:
        self.volume = volume
        self._lock = threading.Lock()
        self._made: dict[int, tuple[int, bytes]] = {}

    def __getitem__(self, index: int) -> tuple[int, bytes]:
        with self._lock:
            if index not in self._made:
                self._made[index] = self.volume.chunk(index)
            return self._made[index]


def unit_of(grid: Grid) -> str:
    """The unit of lengths as it is shown: voxels where it is not known and the spacing is 1, else nothing then."""
    return grid.unit or ("voxels" if grid.spacing == (1.0, 1.0, 1.0) else "")


def _camera_axes(plane: Plane) -> dict[str, list[float]]:
    return {"direction": list(plane.normal), "up": [-c for c in plane.v]}


def packed_volume(
    volume: Volume,
    limit: int,
    largest: int,
    window: tuple[float, float] | None = None,
    progress: Progress | None = None,
) -> PackedVolume:
    """A volume with at most ``limit`` voxels and ``largest`` along each axis, as bytes.

    Parameters
    ----------
    window : values that become 0 and 255; default is the whole range for bytes, and up to the densest tissue (all but
        the brightest 1 in 10 000) for others, so that a piece of metal does not take all the grey levels.
    """
    factors = factors_of(volume.grid, limit, largest)
    low, high = whole_window(volume) if window is None else check_window(window)
    grid = coarser(volume.grid, factors)
    values = np.empty(grid.shape, np.uint8)
    fx, fy, fz = factors
    step = max(1, 2**22 // (fz * volume.shape[1] * volume.shape[2]))  # slabs of about 4 million voxels
    discrete = volume.is_labels or volume.dtype == np.bool_
    for k in range(0, grid.shape[0], step):
        slab = volume.finite_values[k * fz : (k + step) * fz]
        values[k : k + step] = _bytes(slab[::fz, ::fy, ::fx] if discrete else block_means(slab, factors), low, high)
        if progress is not None:
            progress(min(1.0, (k + step) / grid.shape[0]))
    background = int(_bytes(np.array(volume.background), low, high))
    return PackedVolume(
        Volume(values, grid, volume.name, is_labels=discrete),
        volume.grid,
        (low, high),
        factors,
        uuid.uuid4().hex,
        background,
        _white(volume, low, high),
    )


def _bytes(values: NDArray[Any], low: float, high: float) -> NDArray[np.uint8]:
    if values.dtype.kind in "iu" and values.dtype.itemsize <= 2 and values.size > _TABLE:
        kind = np.iinfo(values.dtype)
        table = _bytes(np.arange(kind.min, kind.max + 1).astype(values.dtype), low, high)
        # Of whole numbers of two bytes the sign is an offset, which the table has as well.
        return np.asarray(np.roll(table, kind.min)[values.view(f"u{values.dtype.itemsize}")])
    return _scale(values, low, high).astype(np.uint8)


def _scale(values: NDArray[Any], low: float, high: float) -> NDArray[Any]:
    """From 0 to 255 and rounded by truncation; in one place of memory, which takes a third of the time of five."""
    scaled = np.empty(values.shape, np.float64 if values.dtype.itemsize > 2 else np.float32)
    np.subtract(values, low, out=scaled, dtype=scaled.dtype)
    np.multiply(scaled, 255 / (high - low), out=scaled)
    np.add(scaled, 0.5, out=scaled)
    return np.asarray(np.clip(scaled, 0, 255, out=scaled))


def factors_of(grid: Grid, limit: int, largest: int) -> tuple[int, int, int]:
    """Numbers of voxels to average along x, y, z: always where they are closest, so that they end up nearly cubes."""
    factors, counts, spacing = np.ones(3, int), np.array(grid.shape[::-1]), np.asarray(grid.spacing)
    while True:
        left = -(-counts // factors)
        too_long = left > largest
        if not too_long.any() and int(np.prod(left)) <= limit:
            return int(factors[0]), int(factors[1]), int(factors[2])
        can = too_long if too_long.any() else left > 1
        if not can.any():
            raise DeformError(f"no volume has fewer than one voxel; the limit is {limit}, along an axis {largest}.")
        factors[int(np.where(can, spacing * factors, np.inf).argmin())] += 1


def whole_window(volume: Volume) -> tuple[float, float]:
    """The values of interest: all of bytes, and of others up to the densest tissue."""
    low, high = volume.value_range
    if not (volume.is_labels or volume.dtype in (np.bool_, np.uint8)):
        low, _, _, high = levels(volume)
    return low, high if high > low else low + max(1.0, abs(low)) * 1e-6


def _white(volume: Volume, low: float, high: float) -> float:
    """Share of the window from which on a maximum projection is white: one dense spot must not darken the rest."""
    dense = high if volume.is_labels or volume.dtype == np.bool_ else levels(volume)[3]
    return float(np.clip((dense - low) / (high - low), 1 / 255, 1.0))


ValueWindow = tuple[float, float]

_LEVELS = 255
_SHARE = 0.25  # of the window: a transfer function that changes within less of it is seen in bands
_ROOM = 0.05  # of that part, on each side
_FINEST = 1 / 64  # of the window


def fine_window(function: TransferFunction, volume: Volume, coarse: ValueWindow) -> ValueWindow | None:
    """The part of a window within which a transfer function changes, if bytes over all of it show that in bands.

    Parameters
    ----------
    function : is constant outside of the part, so that no colour changes by leaving out the rest.
    volume : whole numbers are not resolved more finely than they are.
    coarse : the window of all values of interest.

    Examples
    --------
    >>> volume = Volume.from_array(np.array([[[0, 4000]]], dtype=np.int16))
    >>> narrow = TransferFunction(((1000, 0, 0, 0), (1600, 1, 1, 1)), ((1000, 0), (1600, 1)))
    >>> fine_window(narrow, volume, (0.0, 4000.0))
    (970.0, 1630.0)
    >>> fine_window(narrow, volume, (0.0, 2000.0)) is None  # resolved well as it is
    True
    """
    whole = coarse[1] - coarse[0]
    step = 1.0 if np.issubdtype(volume.dtype, np.integer) else 0.0
    if volume.is_labels or volume.dtype == np.bool_ or whole <= _LEVELS * step:
        return None
    values = np.unique([*(c[0] for c in function.colors), *(o[0] for o in function.opacities)])
    differ = np.flatnonzero((np.diff(function(values), axis=0) != 0).any(axis=1))
    if len(differ) == 0:
        return None
    low, high = (float(np.clip(v, *coarse)) for v in (values[differ[0]], values[differ[-1] + 1]))
    if not 0 < high - low < _SHARE * whole:
        return None
    width = max((1 + 2 * _ROOM) * (high - low), _FINEST * whole, _LEVELS * step)
    middle = (low + high) / 2
    return max(coarse[0], middle - width / 2), min(coarse[1], middle + width / 2)


def is_fine_enough(function: TransferFunction, volume: Volume, window: ValueWindow, coarse: ValueWindow) -> bool:
    """Check whether a window in use will do: it leaves out nothing, and another one would not be much finer."""
    needed = fine_window(function, volume, coarse) or coarse
    holds_all = window[0] <= needed[0] and needed[1] <= window[1]
    return holds_all and (window == needed or window[1] - window[0] < (needed[1] - needed[0]) / (2 * _SHARE))

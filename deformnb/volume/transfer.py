"""Transfer functions: the colour and opacity of a voxel value, and presets that adapt to a volume."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.checks import check_choice, check_fields, is_finite, real_array, short_value
from deformnb.errors import DeformError
from deformnb.volume.volume import Volume, VolumeLike, as_volume

# Slices that a histogram samples, spread through the volume: 64 of 256^3 give the levels within 1 % in 10 ms.
HISTOGRAM_SLICES = 64
BINS = 256
# A range that all but 1 in 10 000 voxels (one at least) fill by less than a sixteenth is not theirs: a hot voxel, or a
# marker. Below 512 voxels a single one counts.
OUTLIERS, STRETCH, FEW_VOXELS = 1e-4, 16, 512
# The share of the voxels below the edge of tissue that is taken for air; of the range up to that edge what is air in
# any case, and what is no thin part where air reaches it.
AIR_SHARE, NEAR_AIR, NEAR_TISSUE = 0.97, 0.2, 0.3
# Entries between neighbouring bytes, at most, in a front end's table: 255 * 8 + 1 = 2041 fit into the smallest texture
# that WebGL2 allows, 2048.
FINEST = 8
# What reaches from air to bone on Hounsfield's scale is taken to be on it: lung is at -700, spongy bone at 300. Below
# -1100 there is nothing: air is at -1000, give or take noise; the rest are values such as -2000 or -3024, which
# scanners write where nothing was measured. Resampling leaves a few values between them and air.
AIR_HU, BONE_HU, NOTHING_HU = -700.0, 300.0, -1100.0
RESAMPLED = 0.02
# The field of a scanner is a circle in a square: at least so much of its slices is outside, it comes so near to their
# sides, and so few places are on the wrong side of it. About so many places along each axis are sampled.
_CORNERS, _TOUCHES, _STRAY, _LOOKED_AT = 0.05, 0.95, 0.03, 64
_FEWEST_ROWS = 8  # in which a circle is distinct from a line
_CLIPPED = "colours and opacities were clipped to 0 to 1"


@dataclass(frozen=True)
class TransferFunction:
    """Colour and opacity as piecewise linear functions of the value.

    Parameters
    ----------
    colors : nodes (value, red, green, blue), values rising, colours in [0, 1].
    opacities : nodes (value, alpha), values rising; alpha is the share of light that a layer of thickness ``unit``
        stops.
    unit : thickness that the alphas are meant for, in the volume's unit of length.
    notes : remarks, such as an alpha that was clipped into [0, 1].

    Raises
    ------
    DeformError
        If there is no node, a value is not finite, or values do not rise.

    Examples
    --------
    >>> ramp = TransferFunction(((0, 0, 0, 0), (100, 1, 1, 1)), ((0, 0), (100, 0.5)))
    >>> ramp([50.0]).tolist()
    [[0.5, 0.5, 0.5, 0.25]]
    """

    colors: tuple[tuple[float, float, float, float], ...]
    opacities: tuple[tuple[float, float], ...]
    unit: float = 1.0
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not (is_finite(self.unit) and self.unit > 0):
            raise DeformError(
                f"the unit thickness of opacities must be a positive length, got {short_value(self.unit)}."
            )
        check_fields(self, "unit", "notes")
        clipped = False
        for name, width in (("colors", 4), ("opacities", 2)):
            given = real_array(getattr(self, name))
            nodes = np.zeros(0) if given is None else given
            if nodes.ndim != 2 or nodes.shape[1:] != (width,) or len(nodes) == 0 or not np.isfinite(nodes).all():
                raise DeformError(f"{name} of a transfer function need rows of {width} finite numbers.")
            if (np.diff(nodes[:, 0]) < 0).any():
                raise DeformError(f"the values of {name} must rise, got {nodes[:, 0].tolist()}.")
            inside = np.clip(nodes[:, 1:], 0.0, 1.0)
            clipped = clipped or bool((inside != nodes[:, 1:]).any())
            nodes[:, 1:] = inside
            object.__setattr__(self, name, tuple(tuple(float(v) for v in row) for row in nodes))
        if clipped and _CLIPPED not in self.notes:
            object.__setattr__(self, "notes", (*self.notes, _CLIPPED))

    def __call__(self, values: ArrayLike) -> NDArray[np.float64]:
        """Red, green, blue and alpha (..., 4) of values (...)."""
        return np.stack(self.channels(values), axis=-1)

    def channels(self, values: ArrayLike) -> list[NDArray[np.float64]]:
        """Red, green, blue and alpha of values, in one array each.

        Examples
        --------
        >>> ramp = TransferFunction(((0, 0, 0, 0), (100, 1, 1, 1)), ((0, 0), (100, 0.5)))
        >>> [part.tolist() for part in ramp.channels([50.0])]
        [[0.5], [0.5], [0.5], [0.25]]
        """
        v = np.asarray(values, dtype=np.float64)
        c, o = np.asarray(self.colors), np.asarray(self.opacities)
        return [*(np.interp(v, c[:, 0], c[:, k]) for k in (1, 2, 3)), np.interp(v, o[:, 0], o[:, 1])]

    def knots(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The nodes of colours and opacities together: linear interpolation between them is the function itself.

        Returns
        -------
        Values (n,), not falling, and their red, green, blue and alpha (n, 4). Where the function jumps a value is there
        twice, before and after the jump; at that value holds what comes after it.

        Examples
        --------
        >>> step = TransferFunction(((0, 0, 0, 0), (8, 1, 1, 1)), ((4, 0), (4, 1)))
        >>> step.knots()[0].tolist()
        [0.0, 4.0, 4.0, 8.0]
        >>> step.knots()[1][:, 3].tolist()
        [0.0, 0.0, 1.0, 1.0]
        """
        c, o = np.asarray(self.colors), np.asarray(self.opacities)
        values = np.unique(np.concatenate([c[:, 0], o[:, 0]]))
        after = self(values)
        before = np.stack(
            [_left_interpolation(c[:, 0], c[:, k], values) for k in (1, 2, 3)]
            + [_left_interpolation(o[:, 0], o[:, 1], values)],
            axis=-1,
        )
        jumps = (before != after).any(axis=1)
        places = np.concatenate([np.flatnonzero(jumps), np.arange(len(values))])
        rows = np.concatenate([before[jumps], after])
        order = np.argsort(places, kind="stable")  # what comes before a jump first
        return values[places][order], rows[order]

    def quantize(self, low: float, high: float) -> TransferFunction:
        """The transfer function of the bytes that a window from ``low`` to ``high`` makes of values.

        Examples
        --------
        >>> TransferFunction(((0, 1, 1, 1),), ((0, 0), (10, 1))).quantize(0, 20).opacities
        ((0.0, 0.0), (127.5, 1.0))
        """
        scale = 255 / (high - low)
        colors = tuple(((v - low) * scale, r, g, b) for v, r, g, b in self.colors)
        opacities = tuple(((v - low) * scale, alpha) for v, alpha in self.opacities)
        return TransferFunction(colors, opacities, self.unit)

    def table(self, low: float, high: float) -> NDArray[np.float32]:
        """Red, green, blue and alpha of evenly spaced values, for graphics hardware that reads them linearly.

        Parameters
        ----------
        low, high : values of the first and the last entry; beyond them hold these.

        Returns
        -------
        (255 k + 1, 4) with k = 1, 2, 4 or 8, so that each of 256 levels from ``low`` to ``high`` has an entry of its
        own. There are 16 entries or more in the narrowest segment in which the function changes, or k is 8: then a jump
        is spread over 1/2040 of the range. Elsewhere the error is at most a quarter of an entry's distance times the
        change of slope at a node.

        Examples
        --------
        >>> ramp = TransferFunction(((0, 0, 0, 0), (100, 1, 1, 1)), ((0, 0), (100, 0.5)))
        >>> ramp.table(0, 100).shape
        (256, 4)
        >>> ramp.table(0, 4000).shape
        (1021, 4)
        """
        values, rgba = self.knots()
        changes = (np.diff(rgba, axis=0) != 0).any(axis=1) & (values[1:] >= low) & (values[:-1] <= high)
        narrowest = np.diff(values)[changes].min(initial=np.inf)
        k = next((k for k in (1, 2, 4, FINEST) if narrowest >= 16 * (high - low) / (255 * k)), FINEST)
        return self(np.linspace(low, high, 255 * k + 1)).astype(np.float32)

    def scaled(self, factor: float) -> TransferFunction:
        """The same with all alphas times ``factor``."""
        return replace(self, opacities=tuple((v, a * factor) for v, a in self.opacities))

    def with_opacities(self, nodes: Iterable[Sequence[float]]) -> TransferFunction:
        """The same colours with other nodes (value, alpha).

        >>> flat = TransferFunction(((0, 1, 1, 1),), ((0, 0), (9, 1)), unit=2.0)
        >>> flat.with_opacities([(3, 0.5)]).opacities
        ((3.0, 0.5),)
        """
        rows = tuple(tuple(row) for row in nodes)
        return replace(self, opacities=rows)  # type: ignore[arg-type]  # the rows are checked where they arrive

    def with_colors(self, stops: Iterable[tuple[float, str | Sequence[float]]]) -> TransferFunction:
        """The same opacities with other colours.

        Parameters
        ----------
        stops : pairs of a value and its colour: "#rrggbb", or red, green and blue from 0 to 1.

        >>> ramp = TransferFunction(((0, 1, 1, 1),), ((0, 0), (9, 1)))
        >>> ramp.with_colors([(0, "#ff0000"), (9, (0, 0, 1))]).colors
        ((0.0, 1.0, 0.0, 0.0), (9.0, 0.0, 0.0, 1.0))
        """
        try:
            rows = tuple((value, *_rgb(color)) for value, color in stops)
        except DeformError:
            raise
        except (TypeError, ValueError):
            raise DeformError("colours need pairs of a value and a colour, such as (120, '#ffcc99').") from None
        return replace(self, colors=rows)  # type: ignore[arg-type]  # the rows are checked where they arrive

    @property
    def window(self) -> tuple[float, float]:
        """The values of the first and of the last node, of colours and opacities together."""
        values = [node[0] for node in (*self.colors, *self.opacities)]
        return min(values), max(values)

    def windowed(self, low: float, high: float) -> TransferFunction:
        """The same, stretched so that its :attr:`window` is from ``low`` to ``high``.

        >>> ramp = TransferFunction(((0, 0, 0, 0), (100, 1, 1, 1)), ((0, 0), (50, 0.1), (100, 0.5)))
        >>> ramp.windowed(-200, 200).opacities
        ((-200.0, 0.0), (0.0, 0.1), (200.0, 0.5))
        """
        first, last = self.window
        if not (np.isfinite([low, high]).all() and low < high):
            raise DeformError(f"a window needs two values that rise, got {low:g} to {high:g}.")
        if not first < last:
            raise DeformError(f"a transfer function with all nodes at {first:g} has no width; add a node first.")

        def at(value: float) -> float:  # never falling, and met exactly at either end
            return high if value == last else min(high, low + (value - first) / (last - first) * (high - low))

        return replace(
            self,
            colors=tuple((at(v), r, g, b) for v, r, g, b in self.colors),
            opacities=tuple((at(v), alpha) for v, alpha in self.opacities),
        )


def _left_interpolation(
    nodes: NDArray[np.float64], heights: NDArray[np.float64], values: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Linear interpolation; at a jump what comes before it, where ``np.interp`` gives what comes after."""
    return np.interp(-values, -nodes[::-1], heights[::-1])


_HEX_COLOR = re.compile(r"#[0-9a-fA-F]{6}")


def _rgb(color: str | Sequence[float]) -> Sequence[float]:
    if not isinstance(color, str):
        return color
    if not _HEX_COLOR.fullmatch(color):
        raise DeformError(f"a colour is written as #rrggbb, got {color!r:.40}.")
    return [int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)]


@dataclass(frozen=True, eq=False)
class Histogram:
    """Histogram of the values of a volume, counted in slices spread through it.

    Parameters
    ----------
    counts : voxels in each of the equally wide bins from ``low`` to ``high``.
    low, high : outer edges of the first and last bin; values beyond are not counted.
    slices : number of slices sampled.
    total : how many there are.
    """

    counts: NDArray[np.int64]
    low: float
    high: float
    slices: int
    total: int

    @property
    def is_sampled(self) -> bool:
        """True if some slices were left out."""
        return self.slices < self.total


def histogram(volume: Volume, low: float, high: float, bins: int = BINS, slices: int = HISTOGRAM_SLICES) -> Histogram:
    """Count the values of a volume from ``low`` to ``high``.

    Parameters
    ----------
    volume : whose values are counted; NaN and infinity count as background.
    low, high : outer edges of the first and last bin.
    bins : equally wide, each without its upper edge but for the last.
    slices : if the volume has twice as many or more, that many up to twice as many are sampled, equally spaced.

    Examples
    --------
    >>> three = Volume.from_array(np.array([[[0, 1, 1, 7]]]))
    >>> histogram(three, -0.5, 2.5, 3).counts.tolist()
    [1, 2, 0]
    """
    if not high > low:
        raise DeformError(f"a histogram needs a range of values that rises, got {low:g} to {high:g}.")
    step = max(1, volume.shape[0] // slices)
    counts = np.zeros(bins, np.int64)
    smallest, largest = volume.value_range
    for values in volume.finite_values[::step]:  # np.histogram refuses bool, and a range of a few steps of a float32
        inside = values if low <= smallest and largest <= high else values[(values >= low) & (values <= high)]
        at = (inside.astype(np.float64) - low) / (high - low) * bins
        counts += np.bincount(np.minimum(at, bins - 1).astype(np.intp).ravel(), minlength=bins)
    return Histogram(counts, low, high, len(range(0, volume.shape[0], step)), volume.shape[0])


def levels(volume: Volume) -> tuple[float, float, float, float]:
    """Air, the edge between air and tissue, the edge between tissue and dense tissue, and the densest value.

    The edges are Otsu's thresholds (IEEE Trans. SMC 9 (1979) 62-66): of all voxels, and of those above the first.
    Padding is left out, see :func:`smallest_measurement`, and outliers that stretch the range, see
    :func:`typical_range`.
    """
    return _measure(volume).levels


def smallest_measurement(volume: Volume) -> float:
    """The smallest value that is no padding: not what scanners write where they have measured nothing.

    Padding is far below air in Hounsfield units, such as -2000 or -3024, and one value that fills the slices
    outside of the circle that a scanner images, for any scale.

    Examples
    --------
    >>> values = np.full((10, 10, 10), -3024, np.int16)
    >>> values[:, 1:9, 1:9], values[:, 3:7, 3:7], values[:, 5, 5] = -1000, 40, 900
    >>> smallest_measurement(Volume.from_array(values))
    -1000.0
    """
    if volume not in _SMALLEST:
        _SMALLEST[volume] = _padding_limit(volume)
    return _SMALLEST[volume]


_SMALLEST: WeakKeyDictionary[Volume, float] = WeakKeyDictionary()


def _padding_limit(volume: Volume) -> float:
    low, high = volume.value_range
    if volume.is_labels or volume.dtype == np.bool_ or not low < high:
        return low
    if low < NOTHING_HU and high >= BONE_HU:
        air = _smallest_from(volume, NOTHING_HU)
        near = low + (NOTHING_HU - low) / 8
        between = sum(int(np.count_nonzero((part > near) & (part < NOTHING_HU))) for part in volume.finite_values)
        if air <= AIR_HU and between <= RESAMPLED * volume.grid.size:
            return air
    if _fills_corners(volume, low):
        return _smallest_from(
            volume, float(np.nextafter(volume.dtype.type(low), np.inf)) if volume.dtype.kind == "f" else low + 1
        )
    return low


def _smallest_from(volume: Volume, limit: float) -> float:
    """The smallest value at or above a limit that is not above all values."""
    found = (part[part >= limit] for part in volume.finite_values)
    return min(float(part.min()) for part in found if part.size)


def _fills_corners(volume: Volume, value: float) -> bool:
    """Check whether a value fills the outside of a circle in the slices of some axis, and nothing within it."""
    steps = [max(1, n // _LOOKED_AT) for n in volume.shape]
    is_there = volume.finite_values[tuple(slice(None, None, step) for step in steps)] == volume.dtype.type(value)
    share = float(is_there.mean())
    if not _CORNERS < share < 1 - np.pi / 4 / 2:
        return False
    for axis in range(3):
        rows, columns = np.delete(is_there.shape, axis)
        if min(rows, columns) < _FEWEST_ROWS:
            continue
        radius = np.hypot(np.linspace(-1, 1, rows)[:, None], np.linspace(-1, 1, columns))
        edge = np.quantile(radius, 1 - share)
        stray = np.abs(is_there.mean(axis=axis) - (radius > edge)).mean()
        if stray < _STRAY and edge > _TOUCHES:
            return True
    return False


def typical_range(volume: Volume) -> tuple[float, float]:
    """The smallest and the largest value, but of padding and of outliers that stretch this range sixteenfold or more.

    Padding is below :func:`smallest_measurement`. Outliers are at most 1 in 10 000 voxels, or one: hot
    voxels, a marker. Labels, bytes and volumes of fewer than 512 voxels have none.

    Examples
    --------
    >>> values = np.arange(1000.0).reshape(10, 10, 10)
    >>> values[5, 5, 5] = 1e6
    >>> typical_range(Volume.from_array(values))
    (0.0, 999.0)
    """
    return _measure(volume).range if _may_have_outliers(volume) else volume.value_range


def _may_have_outliers(volume: Volume) -> bool:
    return not volume.is_labels and volume.dtype.itemsize > 1 and volume.grid.size >= FEW_VOXELS


@dataclass(frozen=True)
class _Measured:
    range: tuple[float, float]
    levels: tuple[float, float, float, float]
    air_end: float
    """The end of the values of air: up to the edge of tissue there are thin parts such as fins."""


_MEASURED: WeakKeyDictionary[Volume, _Measured] = WeakKeyDictionary()


def _measure(volume: Volume) -> _Measured:
    if volume not in _MEASURED:
        low, high = smallest_measurement(volume), volume.value_range[1]
        if high <= low:
            _MEASURED[volume] = _Measured((low, low), (low, low, low, low), low)
        else:
            found = _typical(volume, histogram(volume, low, high))
            _MEASURED[volume] = _Measured((found.low, found.high), _levels(found), _air_end(found))
    return _MEASURED[volume]


def _typical(volume: Volume, whole: Histogram) -> Histogram:
    """The histogram over :func:`typical_range`, from the one over all values."""
    if not _may_have_outliers(volume):
        return whole
    size = volume.grid.size
    if whole.low > volume.background:  # values below are padding
        size = sum(int(np.count_nonzero(part >= whole.low)) for part in volume.finite_values)
    most, found = max(1, int(OUTLIERS * size)), whole
    while (ends := _crowded_bins(found, most)) is not None:
        inside = [part[(part >= ends[0]) & (part <= ends[1])] for part in volume.finite_values]
        low, high = (float(f([f(part) for part in inside if part.size])) for f in (min, max))
        if not low < high or size - sum(part.size for part in inside) > most:  # a spot on an even ground is no outlier
            return whole
        if (low, high) == (found.low, found.high):
            break
        found = histogram(volume, low, high)
    return found


def _crowded_bins(counts: Histogram, most: int) -> tuple[float, float] | None:
    """Edges of the few bins that hold all that is counted but ``most`` voxels; None if they are not few."""
    below = np.concatenate([[0], np.cumsum(counts.counts)])
    ends = np.searchsorted(below, below + below[-1] - most)  # the first bin's edge up to which there are that many
    first = int(np.where(ends < len(below), ends - np.arange(len(below)), len(below)).argmin())
    if ends[first] - first > len(counts.counts) // STRETCH:
        return None
    width = (counts.high - counts.low) / len(counts.counts)
    return counts.low + first * width, counts.low + float(ends[first]) * width


def _levels(found: Histogram) -> tuple[float, float, float, float]:
    low, high, counts = found.low, found.high, found.counts
    middle = low + (np.arange(BINS) + 0.5) * ((high - low) / BINS)
    first = _otsu(counts)
    second = first + 1 + _otsu(counts[first + 1 :]) if counts[first + 1 :].sum() else first
    top = int(np.flatnonzero(np.cumsum(counts[::-1]) > 1e-4 * counts[first + 1 :].sum())[0])
    return low, float(middle[first]), float(middle[second]), float(middle[BINS - 1 - top])


def _air_end(found: Histogram) -> float:
    """The value that nearly all voxels below the edge between air and tissue are below; some way from the lowest."""
    below = found.counts[: _otsu(found.counts) + 1]
    last = int(np.searchsorted(np.cumsum(below), AIR_SHARE * below.sum()))
    return found.low + max(last + 1, NEAR_AIR * len(below)) * ((found.high - found.low) / BINS)


def otsu_threshold(values: NDArray[np.float64]) -> float:
    """Otsu's threshold of values (IEEE Trans. SMC 9 (1979) 62-66): it parts them into the two most even classes.

    Examples
    --------
    >>> 10 < otsu_threshold(np.array([8.0, 9, 10, 40, 41, 43])) < 40
    True
    """
    finite = values[np.isfinite(values)]
    counts, edges = np.histogram(finite, BINS)
    return float(edges[_otsu(counts) + 1])


def _otsu(counts: NDArray[np.int64]) -> int:
    """The last bin of the lower class that makes the variance between two classes largest."""
    n = np.cumsum(counts).astype(np.float64)
    s = np.cumsum(counts * np.arange(len(counts)))
    with np.errstate(invalid="ignore", divide="ignore"):
        between = (s[-1] * n / n[-1] - s) ** 2 / (n * (n[-1] - n))
    return int(np.nanargmax(np.where(np.isfinite(between), between, -1.0)))


def _make_increasing(values: list[float]) -> list[float]:
    return [float(v) for v in np.maximum.accumulate(values)]


def is_hounsfield(volume: Volume) -> bool:
    """Check whether the values are taken to be on Hounsfield's scale: they reach from air to bone.

    >>> is_hounsfield(Volume.from_array(np.array([[[-1000, 40, 700]]])))
    True
    """
    low, high = volume.value_range
    if volume.is_labels or volume.dtype.kind == "b" or low > AIR_HU or high < BONE_HU:
        return False
    found = levels(volume)
    return _is_hounsfield(found[0], found[3])


def _layer(volume: Volume) -> float:
    """One hundredth of the shortest edge of the volume: the thickness that preset opacities are meant for."""
    return min(volume.grid.lengths) / 100


def _is_hounsfield(low: float, high: float) -> bool:
    """Check whether values alone show bone: in a trunk, Otsu's second threshold parts fat and lean instead."""
    return low <= AIR_HU and high >= BONE_HU


def _function(
    volume: Volume, values: list[float], colors: list[tuple[float, float, float]], alphas: list[float]
) -> TransferFunction:
    """Colours and alphas of values, each at least the one before, for layers of :func:`_layer`."""
    v = _make_increasing(values)
    return TransferFunction(
        tuple((a, *c) for a, c in zip(v, colors, strict=True)), tuple(zip(v, alphas, strict=True)), _layer(volume)
    )


def specimen(volume: Volume) -> TransferFunction:
    """A fish or a lobster in a glass jar, bone in translucent skin: faint flesh, bright bones."""
    low, air, dense, high = levels(volume)
    if _is_hounsfield(low, high):  # blankets and the foam of a table are below -200, fat is at -100, spongy bone at 200
        return _function(
            volume,
            [low, -200.0, -80.0, 60.0, 160.0, 300.0, 700.0, max(high, 1000.0)],
            [
                (0.55, 0.28, 0.18),
                (0.78, 0.5, 0.34),
                (0.86, 0.6, 0.42),
                (0.78, 0.36, 0.25),
                (0.9, 0.52, 0.36),
                (0.98, 0.86, 0.66),
                (1.0, 0.96, 0.86),
                (1.0, 1.0, 0.97),
            ],
            [0.0, 0.0, 0.008, 0.01, 0.03, 0.22, 0.6, 0.9],
        )
    body, end = air + 0.35 * (dense - air), _measure(volume).air_end
    values = [air, body, dense, dense + 0.35 * (high - dense), high]
    colors = [
        (0.62, 0.33, 0.2),
        (0.86, 0.55, 0.38),
        (0.98, 0.86, 0.66),
        (1.0, 0.96, 0.86),
        (1.0, 1.0, 0.97),
    ]
    skin = (0.55, 0.28, 0.18)
    if end > air - NEAR_TISSUE * (air - low):  # noise reaches the edge of tissue
        return _function(volume, [low, *values], [skin, *colors], [0.0, 0.0, 0.03, 0.045, 0.45, 0.9])
    # Fins, legs and antennae are thinner than a voxel here and there, and fainter than the edge. Nearer to air there
    # may be a medium around the body, whose haze would cost a view half of its pictures.
    return _function(
        volume, [low, (end + air) / 2, *values], [skin, skin, *colors], [0.0, 0.0, 0.03, 0.03, 0.045, 0.45, 0.9]
    )


def bone(volume: Volume) -> TransferFunction:
    """Only dense tissue: bones in CT."""
    low, _, dense, high = levels(volume)
    if _is_hounsfield(low, high):
        values = [low, 150.0, 400.0, max(high, 1000.0)]
    else:
        values = [low, dense, dense + 0.25 * (high - dense), high]
    return _function(
        volume,
        values,
        [(0.7, 0.5, 0.35), (0.85, 0.7, 0.52), (0.96, 0.9, 0.78), (1.0, 1.0, 0.98)],
        [0.0, 0.0, 0.6, 0.95],
    )


def muscle(volume: Volume) -> TransferFunction:
    """Flesh over bones: red soft tissue that lets the skeleton through, fat hardly seen."""
    low, air, dense, high = levels(volume)
    if _is_hounsfield(low, high):
        values = [low, -200.0, 0.0, 60.0, 180.0, 400.0, max(high, 1000.0)]
    else:
        edge = dense - air
        values = [low, air, air + 0.3 * edge, air + 0.7 * edge, dense, dense + 0.35 * (high - dense), high]
    rgb = [
        (0.6, 0.45, 0.25),
        (0.7, 0.5, 0.3),
        (0.72, 0.22, 0.15),
        (0.8, 0.25, 0.17),
        (0.93, 0.6, 0.42),
        (1.0, 0.95, 0.84),
        (1.0, 1.0, 0.97),
    ]
    return _function(volume, values, rgb, [0.0, 0.0, 0.012, 0.035, 0.1, 0.6, 0.95])


def surface(volume: Volume) -> TransferFunction:
    """The skin: everything that is not air, opaque."""
    low, air, dense, high = levels(volume)
    values = [low, air, air + 0.3 * (dense - air), dense, high]
    if _is_hounsfield(low, high):  # skin is at -100 and more; hair, cloth and foam are below
        values = [low, -350.0, -50.0, 200.0, max(high, 1000.0)]
    return _function(
        volume,
        values,
        [(0.75, 0.55, 0.42), (0.8, 0.6, 0.47), (0.9, 0.72, 0.58), (0.96, 0.86, 0.74), (1.0, 0.98, 0.94)],
        [0.0, 0.0, 0.8, 0.95, 0.98],
    )


def xray(volume: Volume) -> TransferFunction:
    """Like an X-ray film: everything adds a little, the dense adds more."""
    low, air, dense, high = levels(volume)
    if _is_hounsfield(low, high):
        values, alphas = [low, -200.0, 60.0, 200.0, max(high, 1000.0)], [0.0, 0.0, 0.005, 0.02, 0.07]
    else:
        values, alphas = [low, air, air + 0.1 * (dense - air), dense, high], [0.0, 0.0, 0.002, 0.02, 0.06]
    return _function(volume, values, [(0.9, 0.94, 1.0)] * 5, alphas)


PresetName: TypeAlias = Literal["specimen", "bone", "muscle", "surface", "xray"]
"""Names of the transfer functions that fit themselves to a volume."""

PRESETS: dict[str, Callable[[Volume], TransferFunction]] = {
    "specimen": specimen,
    "bone": bone,
    "muscle": muscle,
    "surface": surface,
    "xray": xray,
}
"""Transfer functions that fit themselves to a volume, by name; the first is the default."""


def as_transfer(given: TransferFunction | PresetName | None, volume: VolumeLike) -> TransferFunction:
    """A transfer function itself, or the preset of a name for a volume; None is the preset "specimen".

    Raises
    ------
    DeformError
        For anything else.
    """
    if given is None or isinstance(given, str):
        return preset("specimen" if given is None else given, volume)
    if not isinstance(given, TransferFunction):
        raise DeformError(
            f"a TransferFunction is needed, or the name of a preset ({', '.join(PRESETS)}), got {short_value(given)}."
        )
    return given


def preset(name: PresetName, volume: VolumeLike) -> TransferFunction:
    """The preset of a name for a volume; DeformError listing the names if there is none.

    Examples
    --------
    >>> from deformnb.datasets.phantoms import PHANTOMS
    >>> len(preset("specimen", PHANTOMS["bar"].make((8, 8, 16))).opacities) > 2
    True
    """
    return PRESETS[check_choice(name, PRESETS, "transfer function")](as_volume(volume))

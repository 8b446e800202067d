"""The path of nodes through a composition: their displacements, and where they are not smooth enough to interpolate.

Every deformation of a composition is evaluated at the places to which those after it lead. Meanwhile it is noted which
nodes are near the border of a cut or of a rigid part, or in a bump that is narrower than the nodes are apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from dataclasses import field as member
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage
from deformnb._typing import Floats
from deformnb.rbf.cuts import Decoupled, Sides
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField, Affine, Composed, Identity
from deformnb.rbf.forward import ForwardFit
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line, Polygon
from deformnb.rbf.rigid import RigidInterpolant, drift_and_weight
from deformnb.rbf.slits import TipBlend, blend_displacements
from deformnb.rbf.stages import Staged

NEAR_CUT, BENT = 1, 2
"""Marks of nodes: a cell around the node may hold the border of a cut; or something else that is not smooth."""

JUMPS = {1: 0.375, 2: 0.065, 3: 0.049}
"""The factors c by the first derivative that jumps."""

NARROWEST = 4
"""A bump of so many diagonals of a cell as support shows in the fourth differences at any place."""

STEEPEST = 3**0.5
"""Distances that are read off a mask's table change by up to this per length, those to lines and polygons by 1."""

# How much farther than half a diagonal the nearest node may be in cells that the deformation bends.
_BENT = 1.15

# Places that differ by less than this share of a voxel are the same.
_SAME = 1e-9

# Samples of a curve of modulation between two nodes, at least and at most.
_SAMPLES = 8, 256


def smoothness_of(field: AbstractField) -> int | None:
    """The first derivative of a field that may jump away from the borders of cuts and parts, at most 3; None if that
    is not known.

    Examples
    --------
    >>> smoothness_of(Identity(3))
    3
    """
    match field:
        case Identity() | Affine():
            return 3
        case RBFInterpolant():
            return field.kernel.smoothness
        case ForwardFit():  # the inverse of a function has as many derivatives
            return smoothness_of(field.forward)
        case RigidInterpolant():  # distances bend where two borders are equally near, weights where they end
            known_base = smoothness_of(field.base)
            most = 2 if len(field.regions) == 1 and isinstance(field.regions[0], HalfSpace) else 1
            return None if known_base is None else min(known_base, most)
        case Composed():
            parts: tuple[AbstractField, ...] = (field.first, field.then)
        case Staged():
            parts = field.fits
        case Extrusion():
            parts = field.maps
        case Decoupled():
            parts = field.fields
        case TipBlend():
            parts = field.fits
        case _:
            return None
    known = [smoothness_of(part) for part in parts]
    if isinstance(field, TipBlend):
        known.append(2)  # of the opening of a cut that stops
    return None if None in known else min((k for k in known if k is not None), default=3)


def lagrange(t: Any) -> tuple[Any, ...]:
    """Weights of the values at -1, 0, 1 and 2 for a place t from 0 to 1."""
    return (
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    )


# Places whose sums over centres are computed at a time: they stay in the cache.
_PLACES = 2**14


@dataclass
class FitSums:
    """Sums over the centres of fits, in the types that are exact enough.

    Parameters
    ----------
    resolution : the side of a voxel; an error far below it is negligible.
    """

    resolution: float
    _types: dict[tuple[int, int], Any] = member(default_factory=dict)

    def __call__(self, fit: RBFInterpolant, places: Floats) -> Floats:
        """Displacements (dim, n) of a fit at places (dim, n)."""
        if fit.is_identity:
            return np.zeros_like(places)
        dtype = self._type_at(fit, places)
        out = np.empty_like(places)
        for start in range(0, places.shape[1], _PLACES):
            some = slice(start, start + _PLACES)
            out[:, some] = fit.displacement(places[:, some].T, dtype).T
        return out

    def _type_at(self, fit: RBFInterpolant, places: Floats) -> Any:
        low, high = places.min(axis=1, initial=np.inf), places.max(axis=1, initial=-np.inf)
        reach = float(np.linalg.norm(np.maximum(high - fit.origin, fit.origin - low)) / fit.support)
        key = id(fit), int(np.ceil(np.log2(max(reach, 1.0))))
        if key not in self._types:
            self._types[key] = fit.type_within(2.0 ** key[1], self.resolution)
        return self._types[key]


@dataclass(frozen=True)
class Walk:
    """The path of nodes through a composition: their displacements, and which are near something that is not smooth.

    Places (dim, z, y, x) are those of a lattice of nodes; along an axis on which they do not change there is one.

    Parameters
    ----------
    sums : of fits.
    marks : (z, y, x) of the lattice, sums of :data:`NEAR_CUT` and :data:`BENT`, set by the walk.
    error : (z, y, x), grows by that of the interpolation of curves of modulation there.
    regions : (z, y, x), becomes a number for the regions at cuts that a node passes.
    widths : (z,), become the diagonals of cells where fits are evaluated, as shares of their supports: the largest, or
        a bound of it where that is narrow enough.
    lattice : the places of a regular lattice (dim, z, y, x), which are rows (dim, R) plus columns (dim, C), and these.
    """

    sums: FitSums
    marks: NDArray[np.uint8]
    error: NDArray[np.float32]
    regions: NDArray[np.int32]
    widths: NDArray[np.float32]
    lattice: tuple[Floats, Floats, Floats] | None = None

    def displacements(self, field: AbstractField, x: Floats) -> Floats:
        """Displacements of places, which are those of the nodes at some stage."""
        match field:
            case Composed():
                d = self.displacements(field.then, x)
                return d + self.displacements(field.first, x + d)
            case Staged():
                return self._stages(field.fits[::-1], x) - x
            case RBFInterpolant():
                return self._fits((field,), x) - x
            case ForwardFit():
                return self._walk_forward_fit(field, x)
            case RigidInterpolant():
                return self._walk_parts(field, x)
            case Extrusion():
                return self._walk_extrusion(field, x)
            case Decoupled():
                return self._walk_cuts(field, x)
            case TipBlend():
                return self._walk_tips(field, x)
            case _:
                return np.moveaxis(field.displacement(np.moveaxis(x, 0, -1)), -1, 0)

    def _stages(self, fits: Sequence[AbstractField], x: Floats) -> Floats:
        if all(isinstance(fit, RBFInterpolant) for fit in fits):
            return self._fits(fits, x)  # type: ignore[arg-type]
        for fit in fits:
            x = x + self.displacements(fit, x)
        return x

    def _fits(self, fits: Sequence[RBFInterpolant], x: Floats) -> Floats:
        """The places to which fits lead, one after the other."""
        moving = [fit for fit in fits if not fit.is_identity]
        side, moved = _diagonal(x) if moving else 0.0, np.zeros_like(x)
        for fit in moving:
            scale = _largest_scale(fit) / fit.support
            # What displacements differ by anywhere bounds what they add to a cell; seldom more has to be tested.
            spread = float(np.linalg.norm(np.ptp(moved.reshape(len(x), -1), axis=1))) if fit is not moving[0] else 0.0
            width = (side + spread) * scale
            if spread and NARROWEST * width > 1:
                width = _diagonal(x) * scale
            np.maximum(self.widths, width, out=self.widths)
            d = self._sum(fit, x)
            moved += d
            x = x + d
        return x

    def _sum(self, fit: RBFInterpolant, x: Floats) -> Floats:
        """The displacements of a fit at places, in the type that is exact enough."""
        if self.lattice is not None and x is self.lattice[0]:
            d = fit.lattice_values(*self.lattice[1:], self.sums.resolution)
            return d.reshape(x.shape).astype(np.float64)
        return self.sums(fit, x.reshape(len(x), -1)).reshape(x.shape)

    def _walk_forward_fit(self, field: ForwardFit, x: Floats) -> Floats:
        """The inverse jumps where a place has no source, and bends as the fit does in the input."""
        last = np.moveaxis(x, 0, -1)
        d = np.moveaxis(field.displacement(last), -1, 0)
        if isinstance(field.forward, RBFInterpolant):
            width = max(_diagonal(x + d), _diagonal(x)) * _largest_scale(field.forward) / field.support
            np.maximum(self.widths, width, out=self.widths)
        self._mark(~field.found(last), BENT)
        return d

    def _walk_parts(self, field: RigidInterpolant, x: Floats) -> Floats:
        back = [rotate(np.asarray(m), x) + _column(t) for m, t in zip(field.matrices, field.shifts, strict=True)]
        distances = [_distances([region], y)[0] for region, y in zip(field.regions, back, strict=True)]
        for region, y, distance in zip(field.regions, back, distances, strict=True):
            self._mark(np.abs(distance) <= _change(y, [region]), BENT)
        outside = [np.maximum(distance, 0.0) for distance in distances]
        last = [np.moveaxis(y, 0, -1) for y in (x, *back)]
        moved, weight = drift_and_weight(last[0], last[1:], outside, field.scales, field.weights, np)
        return np.moveaxis(moved, -1, 0) + weight * self.displacements(field.base, x)

    def _walk_extrusion(self, field: Extrusion, x: Floats) -> Floats:
        abc = rotate(field.plane.frame, x - _column(field.plane.origin))
        ab, depth = self._walk_unique(abc[:2]), self._walk_unique(abc[2:])[0]
        moves = [self.displacements(m, ab) for m in field.maps]
        if not field.is_replication:
            errors = _curve_errors(field, depth.ravel(), max(_sides(depth[None])))
            for error, d in zip(errors, moves, strict=True):
                length = np.linalg.norm(d, axis=0)
                # The error of weights may be infinite, and where nothing moves it makes none.
                self.error[...] += np.where(length > 0, error.reshape(depth.shape), 0.0) * length
        weights = field.weights_at(depth[:1, :1, :1] if field.is_replication else depth)
        return rotate(field.plane.frame[:2].T, sum(w * d for w, d in zip(weights, moves, strict=True)))

    def _walk_unique(self, places: Floats) -> Floats:
        """Places, one for all along an axis on which they do not change."""
        for axis in (1, 2, 3):
            first = places.take([0], axis)
            ends = places.take([-1], axis)  # which differ as a rule where anything does
            if all(np.abs(some - first).max(initial=0.0) <= _SAME * self.sums.resolution for some in (ends, places)):
                places = first
        return places

    def _walk_tips(self, field: TipBlend, x: Floats) -> Floats:
        moves = [self.displacements(fit, x) for fit in field.fits]
        source = np.moveaxis(x + moves[0], 0, -1)
        return np.asarray(blend_displacements(moves, [line.opening(source) for line in field.lines]))

    def _walk_cuts(self, field: Decoupled, x: Floats) -> Floats:
        """Displacements of a cut field; places are marked unless they and their sources are deep in one region."""
        here, total, farthest = self.distances(field, x), np.zeros_like(x), reach_of(field, x)
        # An odd factor above the number of regions: overflowing, it still separates paths that differ in one region.
        self.regions[...] = 257 * self.regions + sum((d < 0) << k for k, d in enumerate(here))
        is_deep = np.abs(here).min(axis=0) > farthest
        for f, side in zip(field.fields, field.sides, strict=True):
            is_own = depth_in(side, here) > 0
            if not is_own.any():
                continue
            box = _bounding_box(is_own)
            at = x[:, *box]
            d = self._restrict(box).displacements(f, at)
            total[:, *box] = np.where(is_own[box], d, total[:, *box])
            farthest = max(farthest, reach_of(field, at + d))
        there = (np.sign(here) * self.distances(field, x + total)).min(axis=0)
        self._mark(~(is_deep & (there > farthest)), NEAR_CUT)
        return total

    def _restrict(self, box: tuple[slice, ...]) -> Walk:
        return replace(
            self,
            marks=self.marks[box],
            error=self.error[box],
            regions=self.regions[box],
            widths=self.widths[box[0]],
            lattice=None,
        )

    def distances(self, field: Decoupled, places: Floats) -> Floats:
        """Signed distances (cuts, z, y, x) of places to the cuts of a field."""
        return _distances(field.regions, self._walk_unique(_cut_coordinates(field, places)))

    def _mark(self, some: NDArray[np.bool_], mark: int) -> None:
        self.marks[...] |= (mark * some).astype(np.uint8)


def depth_in(side: Sides, distances: Floats) -> Floats:
    """Depth (...) within a region of places with signed distances (cuts, ...); negative outside."""
    return np.asarray(np.min([-d if inside else d for d, inside in zip(distances, side, strict=True)], axis=0))


def _bounding_box(some: NDArray[np.bool_]) -> tuple[slice, ...]:
    """The smallest box with some nodes and their neighbours; all of an axis along which they do not change."""
    box = []
    for axis, n in enumerate(some.shape):
        at = np.flatnonzero(some.any(axis=tuple(k for k in range(3) if k != axis)))
        box.append(slice(None) if n == 1 else slice(max(0, int(at[0]) - 1), int(at[-1]) + 2))
    return tuple(box)


def reach_of(field: Decoupled, places: Floats) -> float:
    """The depth from which on no place in the cells around these nodes sees anything of a cut."""
    return farthest_of(field, places) + field.softness


def farthest_of(field: Decoupled, places: Floats) -> float:
    """A bound of how distances to cuts differ between any place in a cell and its nearest node, for these places."""
    return _change(_cut_coordinates(field, places), field.regions)


def cut_distances(field: Decoupled, places: Floats) -> Floats:
    """Signed distances (cuts, ...) of places (dim, ...) to the cuts of a field."""
    return _distances(field.regions, _cut_coordinates(field, places))


def _cut_coordinates(field: Decoupled, places: Floats) -> Floats:
    """Places in the coordinates of the cuts."""
    if field.plane is None:
        return places
    origin = np.reshape(field.plane.origin, (-1, *[1] * (places.ndim - 1)))
    return rotate(field.plane.frame[:2], places - origin)


def _column(values: Any) -> Floats:
    """Numbers (n,) as (n, 1, 1, 1), one for all places of a lattice."""
    return np.asarray(values, dtype=np.float64).reshape(-1, 1, 1, 1)


def rotate(matrix: Floats, places: Floats) -> Floats:
    """Vectors (dim, ...) by a matrix, in products and sums: BLAS would wait for its threads."""
    out = np.empty((len(matrix), *places.shape[1:]))
    for turned, row in zip(out, matrix.tolist(), strict=True):
        turned[...] = sum(part if m == 1 else m * part for m, part in zip(row, places, strict=True) if m)
    return out


def _sides(places: NDArray[Any]) -> list[float]:
    """Bounds of the sides of the cells between places, along each axis of the lattice."""
    return [
        float(np.linalg.norm([np.abs(np.diff(p, axis=axis)).max(initial=0.0) for p in places])) for axis in range(3)
    ]


def _diagonal(places: NDArray[Any]) -> float:
    """A bound of the diagonals of the cells between places."""
    return float(np.linalg.norm(_sides(places)))


def _change(places: Floats, regions: Sequence[AbstractRegion]) -> float:
    """A bound of how distances differ between any place in a cell and its nearest node, for these places."""
    is_exact = all(isinstance(region, HalfSpace | Polygon | Line) for region in regions)
    return (1.0 if is_exact else STEEPEST) * _BENT * _diagonal(places) / 2


def _largest_scale(fit: RBFInterpolant) -> float:
    return 1.0 if fit.scales is None else float(np.asarray(fit.scales)[: int(fit.count)].max(initial=0.0))


def _distances(regions: Sequence[AbstractRegion], places: Floats) -> Floats:
    """Signed distances (regions, z, y, x) of places to regions of their dimension."""
    last = np.moveaxis(places, 0, -1)
    return np.stack([region.signed_distance(last) for region in regions])


def _curve_errors(field: Extrusion, depth: Floats, side: float) -> Floats:
    """Errors (K, n) of cubic interpolation of the weights around depths (n), between nodes that are ``side`` apart.

    A curve is known in one dimension, so that it is compared at many places with what nodes anywhere make of it.
    """
    (c0, c1), knots = field.depth, np.asarray(field.knots, dtype=np.float64)
    gap = min((b - a for a, b in pairwise(knots)), default=1.0) * (c1 - c0)
    if not (side > 0 and gap > 0):
        return np.zeros((len(field.maps), len(depth)))
    samples = max(_SAMPLES[0], int(np.ceil(2 * side / gap)))
    if samples > _SAMPLES[1]:
        return np.full((len(field.maps), len(depth)), np.inf)
    step = side / samples
    first = max(float(depth.min()), c0 - side) - 3 * side
    last = min(float(depth.max()), c1 + side) + 3 * side
    c = first + step * np.arange(int(np.ceil(max(last - first, 6 * side) / step)) + 1)
    w = field.weights_at(np.asarray(c, dtype=np.float64))
    count = w.shape[1] - 3 * samples
    error = np.zeros_like(w)
    for j in range(1, samples):  # the place is j steps behind the second of four nodes
        read = sum(share * w[:, k * samples : k * samples + count] for k, share in enumerate(lagrange(j / samples)))
        at = slice(samples + j, samples + j + count)
        error[:, at] = np.maximum(error[:, at], np.abs(w[:, at] - read))
    error = ndimage.maximum_filter1d(error, 2 * samples + 1, axis=1, mode="nearest")
    return np.stack([np.interp(depth, c, e) for e in error])

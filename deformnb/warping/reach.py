"""Bounds of a displacement over a box, and with them the part of a source that a block of the result can show.

``output(x) = input(x + D(x))``: a block of the result needs the input at ``x + D(x)`` for all x of the block, and
nothing else. The bounds hold everywhere in the box, between the sampled places too. A fit is evaluated at
the nodes of a lattice; between nodes at distances h_k it differs from the multilinear interpolation of these by at most

    sum_j |alpha_j| min( K_j sum_k h_k^2 / 8,  G_j |h| / 2 )

with K_j a bound of the second derivatives of the kernel around centre j within the box, and G_j one of its slope (the
error of linear interpolation: de Boor, A Practical Guide to Splines, 2001, chapter III; the second one because an
interpolated value is a mean of values at nodes that are |h| / 2 away in the root mean square), and a quadratic trend
x^T H x by at most sum_k |H_kk| h_k^2 / 4. Everything that is made
of fits follows by interval arithmetic. At a cut each side may be visible, so the bounds contain those of all sides.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Floats, VoxelSlices
from deformnb.errors import DeformError
from deformnb.rbf.bspline import BSplineField
from deformnb.rbf.cuts import Decoupled
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField, Affine, Blended, DisplacementField, Identity
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.rigid import WEIGHTS, RigidInterpolant
from deformnb.rbf.slits import TipBlend
from deformnb.volume.sampling import METHODS
from deformnb.volume.volume import Grid

Bounds = tuple[Floats, Floats]
"""Lowest and highest of each component."""

# Nodes along each axis of the lattice on which a fit is evaluated: more until the margin is below a voxel.
_NODES = (2, 3, 5, 9, 17)

# Voxels next to the neighbours that are interpolated: the warp evaluates fields in float32, up to 1e-3 voxels off.
_ROUNDING = 1

# The coefficients of the cubic spline depend on voxels n away by 0.268^n (Unser 1999): 1e-9 for 16.
_SPLINE = 16

# Share of a voxel by which a place may be off a voxel's centre by rounding.
_CENTRE_TOLERANCE = 1e-7

# A distance that is read off a mask's table changes by up to the square root of 3 per length, others by 1.
_STEEPEST = 2.0


class UnknownBounds(Exception):  # noqa: N818  # no fault: the field is evaluated at every voxel instead
    """A field has no bounds but its values."""


class DisplacementBounds:
    """Bounds of one displacement over boxes; results are cached by box.

    Parameters
    ----------
    field : backward displacements.
    resolution : a length; margins far below it are not worth more evaluations.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> from deformnb.rbf.fitting import fit_rbf
    >>> bump = fit_rbf(ControlPoints.from_arrays([[5.3, 5, 5]], [[7.3, 5, 5]]), support=1.0, trend="none")
    >>> low, high = DisplacementBounds(bump, 1.0).bounds_in(np.zeros(3), np.full(3, 20.0))
    >>> bool(low[0] <= -2.0)
    True
    """

    def __init__(self, field: AbstractField, resolution: float) -> None:
        self._field, self._resolution = field, resolution
        self._kept: dict[Any, Bounds] = {}

    def bounds_in(self, low: Floats, high: Floats) -> Bounds:
        """Lowest and highest displacement (dim,) over the box from ``low`` to ``high`` (dim,).

        Raises
        ------
        UnknownBounds
            If the field is of a kind that has none.
        """
        return self._field_bounds(self._field, low, high)

    def _field_bounds(self, field: AbstractField, low: Floats, high: Floats) -> Bounds:
        key = (id(field), low.tobytes(), high.tobytes())
        if key not in self._kept:
            self._kept[key] = self._find_bounds(field, low, high)
        return self._kept[key]

    def _find_bounds(self, field: AbstractField, low: Floats, high: Floats) -> Bounds:
        if len(field.steps) > 1:
            return self._sequential_bounds(field.steps, low, high)
        match field:
            case Identity():
                return np.zeros(field.dim), np.zeros(field.dim)
            case Affine():
                return _affine(np.asarray(field.matrix) - np.eye(field.dim), np.asarray(field.offset), low, high)
            case DisplacementField():
                return _sample_bounds(field, low, high)
            case BSplineField():
                return _spline_bounds(field, low, high)
            case RBFInterpolant():
                return self._fit_bounds(field, low, high)
            case RigidInterpolant():
                return self._rigid_bounds(field, low, high)
            case TipBlend():  # a mean of its fits
                return _union([self._field_bounds(f, low, high) for f in field.fits])
            case Decoupled():
                return _union([(np.zeros(field.dim),) * 2, *(self._field_bounds(f, low, high) for f in field.fields)])
            case Extrusion():
                return self._extrusion_bounds(field, low, high)
            case Blended():
                parts = [self._field_bounds(f, low, high) for f in field.fields]
                return sum(a for a, _ in parts) + np.zeros(field.dim), sum(b for _, b in parts) + np.zeros(field.dim)
            case _:
                raise UnknownBounds

    def _sequential_bounds(self, steps: tuple[AbstractField, ...], low: Floats, high: Floats) -> Bounds:
        total = np.zeros_like(low), np.zeros_like(high)
        for step in reversed(steps):  # the last one is sampled first, at the place in the result
            d = self._field_bounds(step, low + total[0], high + total[1])
            total = total[0] + d[0], total[1] + d[1]
        return total

    def _fit_bounds(self, fit: RBFInterpolant, low: Floats, high: Floats) -> Bounds:
        n, support = int(fit.count), float(fit.support)
        first, last = (low - fit.origin) / support, (high - fit.origin) / support
        centers, alpha = np.asarray(fit.centers)[:n], np.abs(np.asarray(fit.coefficients)[:n])
        scale = np.ones(n) if fit.scales is None else np.asarray(fit.scales)[:n]
        near = np.linalg.norm(np.maximum(np.maximum(first - centers, centers - last), 0), axis=1) * scale
        far = np.linalg.norm(np.maximum(np.abs(first - centers), np.abs(last - centers)), axis=1) * scale
        bounds = fit.kernel.curvature(near, far)
        if bounds is None:
            raise UnknownBounds
        slope, bend = bounds
        bent = (
            np.zeros((fit.dim, fit.dim))
            if fit.polynomial.quadratic is None
            else np.abs(np.diagonal(np.asarray(fit.polynomial.quadratic), axis1=1, axis2=2))
        )
        for nodes in _NODES:
            h = (last - first) / (nodes - 1)
            between = np.minimum(scale**2 * bend * (h**2).sum() / 8, scale * slope * np.linalg.norm(h) / 2)
            margin = alpha.T @ between + bent @ h**2 / 4  # x^T H x has the second derivatives 2 H_kk
            if margin.max(initial=0.0) <= self._resolution / 2:
                break
        lines = [np.linspace(a, b, nodes) for a, b in zip(low, high, strict=True)]
        values = fit.displacement(np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)).reshape(-1, fit.dim)
        return values.min(axis=0) - margin, values.max(axis=0) + margin

    def _rigid_bounds(self, field: RigidInterpolant, low: Floats, high: Floats) -> Bounds:
        """``L(x) - x + w(x) g(x)``: L is a mean of the motions of the parts, w a product of weights."""
        middle, reach = (low + high) / 2, _STEEPEST * float(np.linalg.norm(high - low)) / 2
        drifts, lowest, highest = [], 1.0, 1.0
        motions = [(np.asarray(m), np.asarray(t)) for m, t in zip(field.matrices, field.shifts, strict=True)]
        for region, (m, t), scale, name in zip(field.regions, motions, field.scales, field.weights, strict=True):
            drifts.append(_affine(m - np.eye(field.dim), t, low, high))
            distance = float(region.signed_distance(middle @ m.T + t))
            ends = np.maximum([distance - reach, distance + reach], 0.0) / float(scale)
            w = WEIGHTS[name](ends)  # which never falls with distance
            lowest, highest = lowest * float(w[0]), highest * float(w[1])
        drift = _union(drifts)
        g = _product(
            (np.full(field.dim, lowest), np.full(field.dim, highest)), self._field_bounds(field.base, low, high)
        )
        return drift[0] + g[0], drift[1] + g[1]

    def _extrusion_bounds(self, field: Extrusion, low: Floats, high: Floats) -> Bounds:
        frame = field.plane.frame
        middle, half = field.plane.to_plane((low + high) / 2), np.abs(frame) @ (high - low) / 2
        first, last = middle - half, middle + half
        c0, c1 = field.depth
        knots = c0 + np.asarray(field.knots) * (c1 - c0)
        within = knots[(knots > first[2]) & (knots < last[2])]
        weights = field.weights_at(np.concatenate([[first[2], last[2]], within]))
        total = np.zeros(2), np.zeros(2)
        for m, w in zip(field.maps, weights, strict=True):
            part = _product((np.full(2, w.min()), np.full(2, w.max())), self._field_bounds(m, first[:2], last[:2]))
            total = total[0] + part[0], total[1] + part[1]
        return _rotate_bounds(frame[:2].T, total)


def _affine(matrix: Floats, offset: Floats, low: Floats, high: Floats) -> Bounds:
    middle, half = matrix @ (low + high) / 2 + offset, np.abs(matrix) @ (high - low) / 2
    return middle - half, middle + half


def _rotate_bounds(matrix: NDArray[np.floating[Any]], bounds: Bounds) -> Bounds:
    """Bounds of ``matrix @ d``."""
    return _affine(np.asarray(matrix, dtype=np.float64), np.zeros(len(matrix)), *bounds)


def _union(bounds: list[Bounds]) -> Bounds:
    return np.min([low for low, _ in bounds], axis=0), np.max([high for _, high in bounds], axis=0)


def _product(a: Bounds, b: Bounds) -> Bounds:
    every = np.stack([x * y for x in a for y in b])
    return every.min(axis=0), every.max(axis=0)


def _sample_bounds(field: DisplacementField, low: Floats, high: Floats) -> Bounds:
    """Interpolated values are between the samples around them."""
    grid = field.lattice
    if isinstance(grid, Grid):
        first, last = _rotate_bounds(grid.inverse, (low - grid.origin, high - grid.origin))
    else:
        first, last = (low - grid.origin) / grid.spacing, (high - grid.origin) / grid.spacing
    counts = np.array(grid.shape[::-1])
    a = np.clip(np.floor(first), 0, counts - 1).astype(int)[::-1]
    b = np.clip(np.ceil(last), 0, counts - 1).astype(int)[::-1]
    values = np.asarray(field.values[tuple(slice(i, j + 1) for i, j in zip(a, b, strict=True))], dtype=np.float64)
    axes = tuple(range(field.dim))
    return values.min(axis=axes), values.max(axis=axes)


def _spline_bounds(field: BSplineField, low: Floats, high: Floats) -> Bounds:
    """A displacement is a mean of the coefficients around it, for the splines add up to 1; outside it is zero."""
    inverse = np.linalg.inv(np.asarray(field.axes))
    first, last = _rotate_bounds(inverse, (low - field.origin, high - field.origin))
    begin, end = field.domain
    if (last < begin - _CENTRE_TOLERANCE).any() or (first > end + _CENTRE_TOLERANCE).any():
        return np.zeros(field.dim), np.zeros(field.dim)
    # The first coefficient that counts is (order - 1) / 2 before a place at most, rounded down; the last one after it.
    margin, counts = (field.order - 1) / 2, field.counts
    a = np.clip(np.floor(np.maximum(first, begin) - margin) - 1, 0, counts - 1).astype(int)[::-1]
    b = np.clip(np.ceil(np.minimum(last, end) + margin) + 1, 0, counts - 1).astype(int)[::-1]
    some = np.asarray(field.coefficients[tuple(slice(i, j + 1) for i, j in zip(a, b, strict=True))], dtype=np.float64)
    axes = tuple(range(field.dim))
    within = some.min(axis=axes), some.max(axis=axes)
    beyond = (first < begin).any() or (last > end).any()
    return _union([within, (np.zeros(field.dim),) * 2]) if beyond else within


def source_part(
    bounds: DisplacementBounds, field: AbstractField, block: Grid, source: Grid, method: str
) -> VoxelSlices | None:
    """The voxels of a source that a block of the result can show, as slices along z, y, x; None if there are none.

    Parameters
    ----------
    bounds : of the field.
    field : backward displacements in space.
    block : the grid of the block.
    source : the grid of the whole source.
    method : of interpolation, a name of :data:`METHODS`.

    Raises
    ------
    DeformError
        If the field is not finite.
    """
    corners = block.corners(centres=True)
    try:
        d = bounds.bounds_in(corners.min(axis=0), corners.max(axis=0))
    except UnknownBounds:
        values = field.components_on_grid(block).reshape(3, -1).astype(np.float64)
        d = values.min(axis=1), values.max(axis=1)
    if not np.isfinite(d).all():
        raise DeformError(
            "the field is not finite everywhere; look for control points far away or nearly on top of each other."
        )
    at, moved = source.point_to_index(corners), _rotate_bounds(source.inverse, d)
    more = _ROUNDING + _SPLINE * METHODS[method].is_spline
    counts = np.array(source.shape[::-1])
    still = (moved[0] == 0) & (moved[1] == 0) & np.all(np.abs(at - np.round(at)) < _CENTRE_TOLERANCE, axis=0)
    bound = 4.0 * (counts + 2 * more)  # beyond the source by far; no number too large to be counted
    first = np.clip(np.floor(at.min(axis=0) + moved[0]) - more, -bound, bound).astype(int)
    stop = np.clip(np.floor(at.max(axis=0) + moved[1]) + 2 + more, -bound, bound).astype(int)
    # Along an axis on which nothing moves the voxels are read as they are.
    margin = _SPLINE * METHODS[method].is_spline
    first = np.where(still, np.round(at.min(axis=0)).astype(int) - margin, first)
    stop = np.where(still, np.round(at.max(axis=0)).astype(int) + 1 + margin, stop)
    if (stop <= 0).any() or (first >= counts).any():
        return None
    x, y, z = (slice(int(max(a, 0)), int(min(b, n))) for a, b, n in zip(first, stop, counts, strict=True))
    return z, y, x

"""Exactness of maps at their control points: one bound for every way to evaluate them.

A fit without smoothing has ``D(target) = source - target``. Computed with a finite number of digits it misses that by

    ``|D(target) - (source - target)| <= EXACT |d| + EXACT_PLACE L + share min(pixel, |d|)``

with ``|d|`` the largest displacement of a control point, L the largest distance of a target from the middle of all, and
a share of the pixel where the map is computed for pixels or voxels (:data:`SHARES`); it is 0 at single places. The
first two terms are ten times the residual of a solve (:data:`RESIDUAL`, :data:`ROUNDING`): the places of an evaluation
are rounded once more. A fit that cannot meet the bound is refused, or a note states by how much it misses: up to
:data:`MOST_MISSED`.

Three choices follow, and all are made here or by these numbers: whether a fit is solved well enough; whether a sum over
control points may run in float32, which is 2.8 times as fast, by its estimated error
(:meth:`~deformnb.rbf.interpolant.RBFInterpolant.float32_error`); and the largest spacing of the nodes of a warp.
"""

from __future__ import annotations

RESIDUAL = 1e-7
"""Largest residual of a solve, as a share of the largest displacement: far above the rounding of a healthy
system (1e-15 times a condition of 1e6), far below anything visible (1e-3 voxel)."""

ROUNDING = 1e-10
"""Further residual, as a share of the extent: rounding of the trend is that, however small the drag."""

EXACT, EXACT_PLACE = 10 * RESIDUAL, 10 * ROUNDING
"""The promised shares of the largest displacement and of the extent, for every evaluation of a map."""

MOST_MISSED = 1e-4
"""Share of the largest displacement by which a nearly singular system may miss with a note, which states by how much: a
tenth of the error allowed in pictures. Coefficients are that many times as large as their sum, so that no solver
would leave less; points that are missed by more are fitted locally or refused."""

SHARES = {"lattice": 1e-3, "nodes": 1e-2, "page": 2e-2}
"""Shares of the smallest side of a pixel or voxel that are added for pictures, grids and volumes.

lattice : sums over control points on a raster or a grid: a thousandth of the contrast of neighbouring pixels, which no
    type of voxels shows. nodes : compositions of several steps or stages in a warp, which are interpolated between
    nodes, of the voxel however small the drags are; where neighbouring voxels differ by 100 grey levels, that changes
    the result by one at most. page : stored maps of exported pages, rounded to 1/64 so that they are small to send.
"""

DERIVATIVE = 5e-3
"""Largest error of a derivative dD/dx on a lattice, no unit: a tenth of the determinant that counts as nearly folded.
At single places derivatives are computed in float64."""


def largest_miss(largest: float, extent: float, pixel: float = 0.0, share: float = SHARES["lattice"]) -> float:
    """The bound on ``|D(target) - (source - target)|``, a length.

    Parameters
    ----------
    largest : length of the largest displacement of a control point.
    extent : largest distance of a target from the middle of all targets.
    pixel : smallest side of the pixels or voxels that the map is computed for; 0 at single places.
    share : one of :data:`SHARES`.

    Examples
    --------
    >>> f"{largest_miss(5.0, 100.0):.2g} {largest_miss(5.0, 100.0, pixel=0.5):.2g}"
    '5.1e-06 0.00051'
    """
    return EXACT * largest + EXACT_PLACE * extent + share * min(pixel, largest)

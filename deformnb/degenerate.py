"""What is done with sets of control points that a plain fit would get wrong, silently, in other systems.

=================================  ==================================================================================
set of active points               what is done
=================================  ==================================================================================
none                               the identity
one                                a translation (trend "none": one bump)
on one line, or in one plane       the trend goes on across them as a similarity would; a note says so
(of space)
same place, same displacement      merged; a note names them
same place, other displacement     DeformError naming both; with smoothing their weighted mean
same place, other radius           the radius of the first
pulled past one another            fitted, and a note names the pair: a fold is likely
not finite, beyond 1e15            refused by ControlPoints, before any LAPACK call (inf makes some of them hang)
more than 2000                     DeformError
=================================  ==================================================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
import scipy.sparse
import scipy.spatial
from numpy.typing import NDArray

from deformnb.control_points import ControlPoints
from deformnb.errors import DeformError
from deformnb.kernels import AbstractKernel
from deformnb.trend import Trend

LARGEST_SET = 2000
"""Dense solves cost N^3: 2000 points take 0.1 s, ten times as many would take minutes."""

# Points nearer than this share of the support radius make Phi singular to working precision (condition (R/gap)^2..3).
SAME_PLACE = 1e-6
# Displacements that differ by less than this share of the support are the same: the promised exactness of a fit.
SAME_DISPLACEMENT = 1e-9
# Ratio of singular values of the centred points below which they lie on a line or in a plane (independent of the axes).
FLAT = 1e-7

# What a trend shortens more than this it collapses; ratios beyond would be rounding.
_COLLAPSED = 1e-6
# Pairs of crossing points this many quarters of an octave (8 times) behind the worst are not named.
_FAR_BEHIND = 12


@dataclass(frozen=True, eq=False)
class PreparedPoints:
    """Active points, merged and centred, ready for the solve.

    targets, displacements (n, dim) and weights (n,); origin (dim,) their centre; support radius; basis (dim, rank) of
    the span of the centred targets; trend: the name of the trend they can carry; ids, notes, and the closest pair;
    radii (n,) of their own, that of all where they have none.
    """

    targets: NDArray[np.float64]
    displacements: NDArray[np.float64]
    weights: NDArray[np.float64]
    origin: NDArray[np.float64]
    support: float
    basis: NDArray[np.float64]
    trend: str
    ids: tuple[int, ...]
    notes: tuple[str, ...]
    closest: str
    radii: NDArray[np.float64]

    @property
    def count(self) -> int:
        """Number of different places."""
        return len(self.targets)


def default_support(points: ControlPoints) -> float | None:
    """The diagonal of the box of the active sources (of the targets if the sources coincide); None for one place.

    The sources do not move during a drag, so the radius does not either.
    """
    if not points.active.any():
        return None
    boxes = (np.ptp(array[points.active], axis=0) for array in (points.source, points.target))
    sources, targets = (float(np.linalg.norm(box)) for box in boxes)
    # Sources that coincide but for rounding would make spikes of the width of that rounding.
    return (sources if sources > SAME_PLACE * targets else targets) or None


def prepare(points: ControlPoints, kernel: type[AbstractKernel], support: float | None, trend: Trend,
            smoothing: float) -> PreparedPoints:
    """Check, merge and centre the active points; see the table at the top of this module."""
    chosen = np.flatnonzero(points.active)
    if len(chosen) > LARGEST_SET:
        raise DeformError(
            f"{len(chosen)} control points are more than the {LARGEST_SET} a dense solve is meant for; switch some "
            "off or thin them out."
        )
    radius = _radius(points, support, trend, len(chosen))
    active = points.take(chosen)
    targets, displacements, weights, first, notes = _merge(active, radius, smoothing)
    origin = targets.mean(axis=0) if len(targets) else np.zeros(points.dim)
    basis = _span(targets - origin)
    name, remark = _bearable(trend, kernel, len(targets), basis.shape[1], points.dim)
    return PreparedPoints(targets, displacements, weights, origin, radius, basis, name,
                          tuple(active.ids[k] for k in first), (*notes, *remark), _closest(active, targets, first),
                          np.where(np.isnan(active.radius), radius, active.radius)[first])


def _radius(points: ControlPoints, support: float | None, trend: Trend, n: int) -> float:
    radius = default_support(points) if support is None else float(support)
    if radius is None and n and not np.isnan(own := float(points.radius[points.active][0])):
        radius = own
    if radius is None:
        if n and trend.linear is None:
            raise DeformError(
                f"{points.label(int(np.flatnonzero(points.active)[0]))} is alone and there is no trend, so nothing "
                "tells how far it reaches; give a support radius."
            )
        radius = 1.0  # a translation does not depend on it
    if not (np.isfinite(radius) and radius > 0):
        raise DeformError(f"the support radius must be a positive length, got {radius}.")
    return radius


def _merge(points: ControlPoints, radius: float, smoothing: float) -> tuple[
        NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], list[int], tuple[str, ...]]:
    """Points at one place become one; returns targets, displacements, weights, first positions and notes."""
    n = len(points)
    x, d, w = points.target, points.displacement, points.weight
    pairs: NDArray[Any] = np.zeros((0, 2), dtype=np.int64)
    if n > 1:
        pairs = scipy.spatial.cKDTree(x).query_pairs(SAME_PLACE * radius, output_type="ndarray")
    if len(pairs) == 0:
        return x, d, w, list(range(n)), ()
    if smoothing == 0:
        _refuse_conflicts(points, pairs, radius)
    graph = scipy.sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    groups, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    first = sorted(int(np.flatnonzero(label == g)[0]) for g in range(groups))
    members = [np.flatnonzero(label == label[k]) for k in first]
    total = np.array([w[m].sum() for m in members])
    mean = [np.stack([(a[m] * w[m, None]).sum(axis=0) for m in members]) / total[:, None] for a in (x, d)]
    notes = tuple(
        f"{', '.join(points.label(int(k)) for k in m)} are at one place and count as one" for m in members if len(m) > 1
    )
    return mean[0], mean[1], total, first, notes


def _refuse_conflicts(points: ControlPoints, pairs: NDArray[Any], radius: float) -> None:
    gap = np.linalg.norm(points.displacement[pairs[:, 0]] - points.displacement[pairs[:, 1]], axis=1)
    bad = np.flatnonzero(gap > SAME_DISPLACEMENT * radius)
    if len(bad):
        i, j = (int(k) for k in pairs[bad[0]])
        place, one, two = (
            "(" + ", ".join(f"{v:.6g}" for v in a) + ")"
            for a in (points.target[i], points.displacement[i], points.displacement[j])
        )
        raise DeformError(
            f"{points.label(i)} and {points.label(j)} are at the same place {place} but ask for different "
            f"displacements {one} and {two}; move or delete one, or turn smoothing on."
        )


def _span(centred: NDArray[np.float64]) -> NDArray[np.float64]:
    """Orthonormal columns that span the centred points; (dim, rank)."""
    if len(centred) < 2:
        return np.zeros((centred.shape[1], 0))
    _, sigma, vt = scipy.linalg.svd(centred, full_matrices=False)
    rank = int((sigma > FLAT * sigma[0]).sum()) if sigma[0] > 0 else 0
    return np.eye(centred.shape[1]) if rank == centred.shape[1] else np.ascontiguousarray(vt[:rank].T)


def _bearable(trend: Trend, kernel: type[AbstractKernel], n: int, rank: int, dim: int) -> tuple[str, tuple[str, ...]]:
    """The trend that n points spanning ``rank`` dimensions determine, and a note if it is not the one asked for."""
    if n == 0 or trend.name in ("none", "translation") or rank == dim:
        return trend.name, ()
    if rank == 0:
        name = trend.name if kernel.order == 2 else "translation"
        return name, ("one control point: the trend is a translation",)
    where = "on one line" if rank == 1 else "in one plane"
    if trend.name == "affine":
        return trend.name, (f"the control points lie {where}: across it the affine trend goes on as a similarity",)
    if dim == 3 and rank == 1:
        return trend.name, ("the control points lie on one line: the turn about it is the smallest possible",)
    return trend.name, ()


def _closest(points: ControlPoints, targets: NDArray[np.float64], first: list[int]) -> str:
    """The two points that lie closest to each other, for the message of a singular system."""
    if len(targets) < 2:
        return "a single point"
    distance, other = _neighbours(targets, 2)
    k = int(distance[:, 1].argmin())
    return f"{points.label(first[k])} and {points.label(first[int(other[k, 1])])}"


def _neighbours(points: NDArray[np.float64], k: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Distances and positions (n, k) of the k nearest points of each point, itself first."""
    distance, position = scipy.spatial.cKDTree(points).query(points, k=k)
    return np.asarray(distance), np.asarray(position)


def crossing_pairs(ready: PreparedPoints, linear: NDArray[np.float64], most: int = 3) -> list[tuple[int, int]]:
    """Ids of neighbouring points that the fit pulls past one another; ``linear`` is T's trend (dim, dim).

    Beside the trend the displacement changes by more than the distance. Head on the map must fold between them; four
    points turned by 90 degrees within a fixed ring also come here, and may not fold (det J down to 0.18 was seen).
    The worst come first to be named: two points piled on one place bend the trend until others seem to cross as well.
    """
    x = ready.targets @ linear.T
    y = ready.targets + ready.displacements
    neighbours = min(len(x), 5)
    if neighbours < 2:
        return []
    _, near = _neighbours(ready.targets, neighbours)
    first, second = np.repeat(np.arange(len(x)), neighbours - 1), near[:, 1:].ravel()
    along = x[first] - x[second]
    beside = y[first] - y[second] - along
    gap = np.linalg.norm(ready.targets[first] - ready.targets[second], axis=1)
    ratio = np.linalg.norm(beside, axis=1) / np.maximum(np.linalg.norm(along, axis=1), _COLLAPSED * gap)
    # In quarters of an octave: neither rounding nor a small move changes who is named.
    degree = np.round(4 * np.log2(np.maximum(ratio, 1.0)))
    pairs = {(min(i, j), max(i, j)): d for i, j, d, r in zip(
        first.tolist(), second.tolist(), degree.tolist(), ratio.tolist(), strict=True) if r > 1}
    worst = sorted(pairs, key=lambda pair: (-pairs[pair], pair))[:most]
    return [(ready.ids[i], ready.ids[j]) for i, j in sorted(worst) if pairs[i, j] >= pairs[worst[0]] - _FAR_BEHIND]

"""Degenerate sets of control points, which a plain fit would get wrong in silence: detection and treatment.

=================================  ==================================================================================
set of active points               treatment
=================================  ==================================================================================
none                               the identity
one                                a translation (trend "none": one bump)
nearly on one line, or in one      the trend "affine" shrinks across them to a similarity; a note names the direction
plane of space                     (:func:`deformnb.rbf.trends.thin_directions`)
fewer than 6 (10 in space), or     the undetermined part of the trend "quadratic" is left out, with a note
nearly on a conic or a quadric     (:func:`deformnb.rbf.trends.quadric_span`)
same place, same displacement      merged; a note names them
same place, other displacement     DeformError naming both; with smoothing their weighted mean
same place, other radius           the radius of the first
pulled past one another            fitted, and a note names the pair: a fold is likely
from one source to two targets     fitted, and a note names the pair: the map folds between them
much nearer than the support       a compact kernel's support is limited to 100 of their diameters, with a note
not finite, beyond 1e15            refused by ControlPoints, before any LAPACK call (inf makes some of them hang)
more than 2000                     a sparse system, or with kernels without an end local fits, with a note
more than 20000                    DeformError
=================================  ==================================================================================
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import scipy
from deformnb.errors import DeformError
from deformnb.rbf.kernels import AbstractKernel
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import (
    FLAT,
    THIN,
    Span,
    Trend,
    TrendName,
    are_wide,
    quadric_span,
    ridge_of,
    spread_of,
    spreads_of,
)

LARGEST_SET = 2000
"""Points of one dense system, which costs N^3: 2000 take 0.1 s, ten times as many would take minutes. More of them have
a sparse system (compact kernels) or local fits (:mod:`deformnb.rbf.partition`), and exported pages take no more."""

MOST_POINTS = 20000
"""Points of any fit: the sums at a million places take a minute then."""

SAME_DISTANCE = 1e-6
"""Distances that differ by less than this share are one: those of a rotated lattice differ by their rounding."""

# Points nearer than this share of the support, or of their diameter, make Phi singular to working precision (its
# condition is (R/gap)^2..3).
SAME_PLACE = 1e-6
# Displacements that differ by less than this share of the support are the same: the promised exactness of a fit. So are
# those that differ by no more than the distance of the points, as those of any map without folds do.
SAME_DISPLACEMENT = 1e-9

# A compact kernel is close to its flat limit at this many diameters of the set of points; beyond, Phi loses the digits
# that separate near points (the error of a fit was 5e-8 of it at 100).
LONGEST_SHARE = 100.0

_LIMITED = (
    f"the support radius is limited to {LONGEST_SHARE:g} times the largest distance between control points; "
    "beyond that the map hardly changes"
)
_UNHELD = (
    " nothing holds the affine trend, which may shear or stretch without bounds; a Wendland kernel with the "
    "trend affine stays calm"
)

# Places whose distances to all others are computed at a time.
_ENDS = 256

# A direction that a trend shortens more than this is collapsed; ratios beyond would be rounding.
COLLAPSED = 1e-6
# A direction in which points of a lattice have different places; of length 1, so that no distance grows.
_ASLANT = np.array([0.7548, 0.5698, 0.3247])
# Neighbours of a point that may cross it, and how many more that are as far are examined: a lattice in space has 6,
# the closest packing 12.
NEAREST, NEAREST_AND_EQUAL = 4, 12
# Pairs of crossing points this many quarters of an octave (8 times) behind the worst are not named.
FAR_BEHIND = 12


class PointRemarks(NamedTuple):
    """Remarks on the points of a fit, and their numbers in the list that people see, in the order of its ids."""

    texts: tuple[str, ...] = ()
    numbers: tuple[int, ...] = ()


@dataclass(frozen=True, eq=False)
class PreparedPoints:
    """Active points, merged and centred, ready for the solve.

    targets, displacements (n, dim) and weights (n,); origin (dim,) their centre; support radius; span: the part of a
    linear map that the centred points determine; trend: the name of the trend they can carry; ids and notes; radii (n,)
    of their own, that of all where they have none; active: the points that were given, without inactive ones; missed:
    distance of points that count as one from the place that they share, physical; place_of: (active,) the number of the
    place of each.
    """

    targets: NDArray[np.float64]
    displacements: NDArray[np.float64]
    weights: NDArray[np.float64]
    origin: NDArray[np.float64]
    support: float
    span: Span
    trend: TrendName
    ids: tuple[int, ...]
    notes: tuple[str, ...]
    radii: NDArray[np.float64]
    active: ControlPoints
    missed: float
    place_of: NDArray[np.intp]

    @property
    def count(self) -> int:
        """Number of different places."""
        return len(self.targets)

    def remarks(self, texts: tuple[str, ...]) -> PointRemarks:
        """These remarks with the numbers of the points."""
        number = dict(zip(self.active.ids, self.active.numbers, strict=True))
        return PointRemarks(texts, tuple(number[i] for i in self.ids))

    @property
    def relative(self) -> NDArray[np.float64]:
        """The targets, from the origin in units of the support."""
        return (self.targets - self.origin) / self.support

    @property
    def closest(self) -> str:
        """The closest two points, for the message of a singular system."""
        if self.count < 2:
            return "a single point"
        distance, other = _neighbours(self.targets, 2)
        k = int(distance[:, 1].argmin())
        first, second = (self.active.label(self.active.index(self.ids[j])) for j in (k, int(other[k, 1])))
        return f"{first} and {second}"


def diameter_of(places: NDArray[np.float64]) -> float:
    """The largest distance between two of the places (n, dim), invariant under rotation.

    >>> round(diameter_of(np.array([[0.0, 0.0], [3.0, 0.0], [0.0, 4.0]])), 12)
    5.0
    """
    return _diameter_of(np.ascontiguousarray(places, np.float64).tobytes(), places.shape[1])


@lru_cache(maxsize=8)  # sources do not move during a drag
def _diameter_of(content: bytes, dim: int) -> float:
    places = np.frombuffer(content).reshape(-1, dim)
    size = spread_of(places)
    if size == 0.0:
        return 0.0
    centred = (places - places.mean(axis=0)) / size  # squares of tiny lengths would be zero
    away = np.sqrt((centred**2).sum(axis=1))
    one = np.sqrt(((centred - centred[away.argmax()]) ** 2).sum(axis=1))
    least = float(np.sqrt(((centred - centred[one.argmax()]) ** 2).sum(axis=1).max()))
    ends = centred[away >= (1 - 1e-9) * (least - away.max())]  # others are within ``least`` of all
    far = [((ends[k : k + _ENDS, None] - ends[None]) ** 2).sum(axis=-1).max() for k in range(0, len(ends), _ENDS)]
    return size * float(np.sqrt(max(far)))


def resting_places(points: ControlPoints) -> NDArray[np.float64]:
    """The active sources, which do not move during a drag; the targets if the sources coincide.

    Sources that coincide but for rounding would make spikes of the width of that rounding.
    """
    is_whole = points.active.all()
    source, target = (places if is_whole else places[points.active] for places in (points.source, points.target))
    return source if spread_of(source) > SAME_PLACE * spread_of(target) else target


def box_diagonal(points: ControlPoints) -> float | None:
    """The diagonal of the box of the active sources (of the targets if the sources coincide); None for one place.

    It is the support of documents of before 2.0 and depends on the axes; nothing else is decided by it.
    """
    places = resting_places(points)
    return float(np.linalg.norm(np.ptp(places, axis=0))) or None if len(places) else None


def diameter(points: ControlPoints) -> float | None:
    """The largest distance between two active sources (targets if the sources coincide); None for one place."""
    return diameter_of(resting_places(points)) or None


def prepare(
    points: ControlPoints, kernel: type[AbstractKernel], support: float | None, trend: Trend, smoothing: float
) -> PreparedPoints:
    """Check, merge and centre the active points; see the table at the top of this module."""
    count = int(points.active.sum())
    if count > MOST_POINTS:
        raise DeformError(
            f"{count} control points are more than the {MOST_POINTS} that a fit takes; switch some "
            "off or thin them out."
        )
    active = points if count == len(points) else points.subset(np.flatnonzero(points.active))
    radius = _radius(active, kernel, support, trend)
    size = diameter(active)
    limit = LONGEST_SHARE * (size or np.inf)
    limited: tuple[str, ...] = ()
    if kernel.compact and radius > limit:
        radius, limited = limit, (_LIMITED,)
    near = SAME_PLACE * min(radius, size or radius)
    targets, displacements, weights, first, notes, missed, place_of = _merge(active, radius, near, smoothing)
    origin = targets.mean(axis=0) if len(targets) else np.zeros(points.dim)
    span, where = _span(targets - origin, displacements)
    name: Any
    name, remark = _determined_trend(trend, kernel, len(targets), span.basis.shape, where)
    if name == "quadratic":
        quadrics, bend = quadric_span(targets - origin, span.basis)
        span = span._replace(quadrics=quadrics, bend=bend)
        remark += _bending_notes(len(targets), points.dim, kernel, bool(bend.any()))
    ids = active.ids if len(first) == len(active) else tuple(active.ids[k] for k in first.tolist())
    return PreparedPoints(
        targets,
        displacements,
        weights,
        origin,
        radius,
        span,
        name,
        ids,
        (*limited, *notes, *remark),
        np.where(np.isnan(active.radius), radius, active.radius)[first],
        active,
        missed,
        place_of,
    )


def _radius(active: ControlPoints, kernel: type[AbstractKernel], support: float | None, trend: Trend) -> float:
    radius = support
    if radius is None and len(active) and not np.isnan(own := float(active.radius[0])):
        radius = own
    if radius is None:
        if len(active) and trend.linear is None:
            raise DeformError(
                f"{active.label(0)} is alone and there is no trend, so nothing determines its range; give a "
                "support radius."
            )
        radius = 1.0  # a translation does not depend on it
    if not (np.isfinite(radius) and radius > 0):
        raise DeformError(f"the support radius must be a positive length, got {radius}.")
    return radius


def _merge(
    points: ControlPoints, radius: float, near: float, smoothing: float
) -> tuple[
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.float64],
    NDArray[np.intp],
    tuple[str, ...],
    float,
    NDArray[np.intp],
]:
    """Points nearer than ``near`` become one.

    Returns targets, displacements, weights, first positions, notes, the distance of a point from the place that it
    shares, and the number of the place of each point.
    """
    n = len(points)
    x, d, w = points.target, points.displacement, points.weight
    pairs: NDArray[Any] = np.zeros((0, 2), dtype=np.int64)
    along = np.sort(x @ _ASLANT[: points.dim])
    if (along[1:] - along[:-1] <= near).any():  # else no two are that near
        pairs = scipy.spatial.cKDTree(x).query_pairs(near, output_type="ndarray")
    if len(pairs) == 0:
        return x, d, w, np.arange(n), (), 0.0, np.arange(n)
    if smoothing == 0:
        _refuse_conflicts(points, pairs, radius)
    graph = scipy.sparse.coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    groups, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    first_of = np.array([np.flatnonzero(label == g)[0] for g in range(groups)])
    first = np.sort(first_of)
    members = [np.flatnonzero(label == label[k]) for k in first]
    total = np.array([w[m].sum() for m in members])
    mean = [np.stack([(a[m] * w[m, None]).sum(axis=0) for m in members]) / total[:, None] for a in (x, d)]
    notes = tuple(
        f"{', '.join(points.label(int(k)) for k in m)} are at one place and count as one" for m in members if len(m) > 1
    )
    missed = max(float(np.linalg.norm(d[m] - own, axis=1).max()) for m, own in zip(members, mean[1], strict=True))
    place_of = np.searchsorted(first, first_of[label])
    return mean[0], mean[1], total, first, notes, 0.0 if smoothing else 2 * missed, place_of


def same_place(points: ControlPoints, radius: float) -> float:
    """The distance up to which active points count as being at one place."""
    return SAME_PLACE * min(radius, diameter(points) or radius)


def _refuse_conflicts(points: ControlPoints, pairs: NDArray[Any], radius: float) -> None:
    gap, apart = (np.linalg.norm(a[pairs[:, 0]] - a[pairs[:, 1]], axis=1) for a in (points.displacement, points.target))
    bad = np.flatnonzero(gap > SAME_DISPLACEMENT * radius + apart)
    if len(bad):
        i, j = (int(k) for k in pairs[bad[0]])
        place, one, two = (
            "(" + ", ".join(f"{v:.6g}" for v in a) + ")"
            for a in (points.target[i], points.displacement[i], points.displacement[j])
        )
        raise DeformError(
            f"{points.label(i)} and {points.label(j)} are at the same place {place} but require different "
            f"displacements {one} and {two}; move or delete one, or turn smoothing on."
        )


def _span(centred: NDArray[np.float64], displacements: NDArray[np.float64]) -> tuple[Span, str]:
    """The span that centred targets (n, dim) determine of a linear map, and the thin directions in words."""
    n, dim = centred.shape
    if n < 2 or not centred.any():
        return Span(np.zeros((dim, 0)), np.zeros((dim, dim))), ""
    basis = np.eye(dim)
    if are_wide(centred, displacements):
        return Span(basis, np.zeros((dim, dim))), ""
    directions, spreads = spreads_of(centred, centred + displacements)
    if spreads.min() < THIN:
        _, sigma, vt = scipy.linalg.svd(centred, full_matrices=False)
        rank = int((sigma > FLAT * sigma[0]).sum())
        basis = basis if rank == dim else np.ascontiguousarray(vt[:rank].T)
    return Span(basis, ridge_of(directions, spreads)), _thinly(spreads)


def _thinly(spreads: NDArray[np.float64]) -> str:
    """Line or plane near which thin control points lie, in words; invariant under rotation."""
    wide = int((spreads >= THIN).sum())
    return "" if wide == len(spreads) else "on one line" if wide == 1 else "in one plane"


def _determined_trend(
    trend: Trend, kernel: type[AbstractKernel], n: int, shape: tuple[int, ...], where: str
) -> tuple[str, tuple[str, ...]]:
    """The trend that n points determine whose span has a basis of this shape, and a note if another was requested."""
    dim, rank = shape
    if n == 0 or trend.name in ("none", "translation"):
        return trend.name, ()
    if rank == 0:
        name = trend.name if kernel.order >= 2 else "translation"
        return name, ("one control point: the trend is a translation",)
    if not where:
        return trend.name, ()
    if trend.order >= 2:
        lie = f"the control points lie nearly {where}: across it"
        if trend.name != "affine_exact" and kernel.order < 2:
            return trend.name, (f"{lie} the affine trend turns and scales as along it",)
        return trend.name, (lie + _UNHELD,)
    if rank == 1 and dim == 3:
        return trend.name, ("the control points lie on one line: the turn about it is the smallest possible",)
    return trend.name, ()


def _bending_notes(n: int, dim: int, kernel: type[AbstractKernel], is_open: bool) -> tuple[str, ...]:
    """A note where n points do not determine all of the quadratic trend."""
    if not is_open or n < 2:
        return ()
    least = (dim + 1) * (dim + 2) // 2
    few = f"the quadratic trend needs {least} control points or more, and there are {n}"
    curve = "one conic (an ellipse, a hyperbola, two lines)" if dim == 2 else "one quadric (an ellipsoid, two planes)"
    why = few if n < least else f"the control points lie nearly on {curve}"
    if kernel.order > 2 and n >= least:
        return (f"{why}: the quadratic trend is undetermined off it; the thin-plate kernel would vary less there",)
    return (f"{why}: the part of it that they do not determine is left out",)


def _neighbours(points: NDArray[np.float64], k: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Distances and positions (n, k) of the k nearest points of each point, itself first."""
    distance, position = scipy.spatial.cKDTree(points).query(points, k=k)
    return np.asarray(distance), np.asarray(position)


def _near_pairs(targets: NDArray[np.float64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Pairs of a place and one of its four nearest, and of those that are as far as the fourth, as in a lattice."""
    distance, near = _neighbours(targets, min(len(targets), NEAREST_AND_EQUAL + 1))
    is_near = distance[:, 1:] <= distance[:, [min(NEAREST, near.shape[1] - 1)]] * (1 + SAME_DISTANCE)
    first, column = np.nonzero(is_near)
    return first, near[first, column + 1].astype(np.intp)


def torn_pairs(
    targets: NDArray[np.float64], sources: NDArray[np.float64], ids: tuple[int, ...], most: int = 3
) -> list[tuple[int, int]]:
    """Ids of points that share a source and have different targets: no map without folds does that."""
    size = diameter_of(targets)
    pairs = scipy.spatial.cKDTree(sources).query_pairs(SAME_PLACE * size) if len(sources) > 1 and size else set()
    return [(ids[i], ids[j]) for i, j in sorted(pairs)[:most]]


def crossing_pairs(
    targets: NDArray[np.float64],
    sources: NDArray[np.float64],
    ids: tuple[int, ...],
    linear: NDArray[np.float64],
    most: int = 3,
) -> list[tuple[int, int]]:
    """Ids of neighbouring points that the fit pulls past one another; ``linear`` is T's trend (dim, dim).

    Without the trend the displacement changes by more than the distance. Head on the map must fold between them; four
    points rotated by 90 degrees within a fixed ring also occur, and need not fold (det J down to 0.18 was seen): the
    determinant between them decides.
    The worst come first to be named: two points piled on one place bend the trend until others seem to cross as well.
    """
    x, y = targets @ linear.T, sources
    if len(x) < 2:
        return []
    first, second = _near_pairs(targets)
    along = x[first] - x[second]
    beside = y[first] - y[second] - along
    gap = np.linalg.norm(targets[first] - targets[second], axis=1)
    ratio = np.linalg.norm(beside, axis=1) / np.maximum(np.linalg.norm(along, axis=1), COLLAPSED * gap)
    # In quarters of an octave: neither rounding nor a small move changes who is named.
    degree = np.round(4 * np.log2(np.maximum(ratio, 1.0)))
    pairs = {
        (min(i, j), max(i, j)): d
        for i, j, d, r in zip(first.tolist(), second.tolist(), degree.tolist(), ratio.tolist(), strict=True)
        if r > 1
    }
    worst = sorted(pairs, key=lambda pair: (-pairs[pair], ids[pair[0]], ids[pair[1]]))[:most]
    return [(ids[i], ids[j]) for i, j in sorted(worst) if pairs[i, j] >= pairs[worst[0]] - FAR_BEHIND]

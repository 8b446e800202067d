"""Cuts: displacements that are smooth on either side of a line and jump across it (Eqs. 7 and 8 of the paper).

A cut divides the picture, or space, into its inside and its outside; several cuts divide it into as many regions as
there are combinations. Every region has a separate fit, of the control points whose sources are in it (Eq. 7); a
region without points does not move. Each fit is smooth everywhere, so a map is never interpolated across a cut: the
valid fit is chosen again at every sample.

Two rules choose the region that is seen at a place x of the result, with ``s_k = x + D_k(x)`` the place that region k
would show:

- "paper" (Eq. 8): the field of the region that contains x itself, and nothing where s is in another region. Tissue
  never crosses the line, so moving both sides together leaves a false gap.
- "source", the default: the field of any region k that contains its s_k, the region of x first. It contains
  Eq. 8 where that shows something.

The opacity A (the paper's transparency map) falls from 1 to 0 within one voxel, by the share of the voxel at s_k in
region k: ``c(m) = clamp(1/2 + m / softness)`` with m the depth of s_k within region k. The coverages of neighbouring
regions add up to 1 along a closed cut, so a cut that is not pulled open is not seen.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._jax import full_precision, jax, jnp, lax, pytree
from deformnb.checks import check_fields
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion
from deformnb.volume.plane import Plane

MOST_CUTS = 8
"""Eight cuts make up to 256 regions; every region with points is one more fit and one more sample at every voxel."""

# Coverages add up to 1 but for the rounding of float32 pixels; opaque voxels must stay so bit by bit.
OPAQUE = 1 - 1e-4


Sides = tuple[bool, ...]
"""A region: for every cut whether it is its inside."""


@dataclass(frozen=True)
class Cut:
    """A line along which tissue comes apart.

    Parameters
    ----------
    region : one side of the cut: a :class:`Line` (which continues straight to the border, or ``stops`` at an end or
        both: see :mod:`deformnb.rbf.slits`), a polygon, a mask, or a half space.
    name : shown to people.
    enabled : a cut that is switched off stays in the list.

    Examples
    --------
    >>> from deformnb.rbf.regions import Line
    >>> incision = Cut(Line([(50, 20), (50, 80)], stops=(True, True)), "incision")
    """

    region: AbstractRegion
    name: str = ""
    enabled: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.region, AbstractRegion):
            raise DeformError(f"a cut needs a region, got {type(self.region).__name__}.")
        check_fields(self)


def sides_of(regions: Sequence[AbstractRegion], points: ArrayLike) -> NDArray[np.bool_]:
    """Test whether points (..., dim) are inside each of the regions: shape (..., number of regions)."""
    return np.stack([r.signed_distance(points) < 0 for r in regions], axis=-1)


# Nodes along each side of a box at which the sides of a cut are compared.
_BOX_NODES = 33


def cuts_outside(cuts: Sequence[Cut], low: ArrayLike, high: ArrayLike) -> tuple[str, ...]:
    """Sentences on the cuts that are switched on and do not cross a box, so that they part nothing.

    Parameters
    ----------
    low, high : corners (dim,) of the box, in the coordinates of the cuts.

    Examples
    --------
    >>> from deformnb.rbf.regions import Line
    >>> cuts_outside([Cut(Line([(50, 0), (50, 9)])), Cut(Line([(5, 0), (5, 9)]))], (0, 0), (20, 20))
    ('cut 1 is outside the volume and divides nothing; move it onto the picture.',)
    """
    low, high = (np.asarray(corner, dtype=np.float64) for corner in (low, high))
    lines = [np.linspace(a, b, _BOX_NODES if b > a else 1) for a, b in zip(low, high, strict=True)]
    nodes = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, len(low))
    cell = float(np.linalg.norm(high - low)) / (_BOX_NODES - 1)
    return tuple(
        f"cut {cut.name or k + 1} is outside the volume and divides nothing; move it onto the picture."
        for k, cut in enumerate(cuts)
        if cut.enabled and not _crosses(cut.region, nodes, cell, low, high)
    )


def _crosses(
    region: AbstractRegion, nodes: NDArray[np.float64], cell: float, low: NDArray[np.float64], high: NDArray[np.float64]
) -> bool:
    """Check whether the boundary of a region, or the drawn part of a line that stops, is in a box."""
    if any(getattr(region, "stops", ())):
        v = np.asarray(region.vertices)  # type: ignore[attr-defined]
        t = np.linspace(0.0, 1.0, _BOX_NODES)[:, None]
        drawn = np.concatenate([a + t * (b - a) for a, b in pairwise(v)])
        return bool(((drawn >= low) & (drawn <= high)).all(axis=1).any())
    distance = region.signed_distance(nodes)
    return bool(distance.min() < 0 < distance.max() or np.abs(distance).min() < cell)


def points_of_regions(points: ControlPoints, regions: Sequence[AbstractRegion]) -> dict[Sides, ControlPoints]:
    """Active points of every region that has some, by the region of their sources (Eq. 7)."""
    chosen = np.flatnonzero(points.active).tolist()
    if not chosen:
        return {}
    sides = [tuple(row) for row in sides_of(regions, points.source[chosen]).tolist()]
    return {
        region: points.subset([k for k, s in zip(chosen, sides, strict=True) if s == region])
        for region in sorted(set(sides))
    }


# ---- the rules -------------------------------------------------------------------------------------------------------


def _coverage(depth: Any, softness: Any, xp: Any) -> Any:
    return xp.clip(0.5 + depth / softness, 0.0, 1.0)


def _depth(distances: Any, sides: Sides, xp: Any) -> Any:
    """Depth within a region of places with these distances to the cuts; negative outside."""
    within = [(1 - 2 * inside) * d for d, inside in zip(distances, sides, strict=True)]
    least = within[0]
    for d in within[1:]:
        least = xp.minimum(least, d)
    return least


def _paper_rule(own: Any, here: Any, there: Any, still: Any, xp: Any) -> tuple[Any, Any]:
    """Eq. 8: the region of x or nothing. Divided by the coverage at x, so that a cut without a drag is not seen."""
    count = len(there)
    choice, opacity = xp.full(still.shape, count, np.int32), xp.ones_like(still)
    for k in range(count):
        choice = xp.where(own[k], k, choice)
        share = xp.minimum(1.0, there[k] / xp.where(here[k] > 0, here[k], 1.0))
        opacity = xp.where(own[k], share, opacity)
    return choice, opacity


def _source_rule(own: Any, here: Any, there: Any, still: Any, xp: Any) -> tuple[Any, Any]:
    """The rule "source": the tissue moved here, of the region of x first, else of the region that covers most."""
    count = len(there)
    choice, best, total = xp.full(still.shape, count, np.int32), still, still
    for k in range(count):
        choice, best = xp.where(own[k], k, choice), xp.where(own[k], there[k], best)
        total = total + there[k]
    is_certain = best >= 0.5
    for k, covered in [*enumerate(there), (count, still)]:
        better = ~is_certain & (covered > best)
        choice, best = xp.where(better, k, choice), xp.where(better, covered, best)
    return choice, xp.minimum(1.0, total)


CutRuleName: TypeAlias = Literal["source", "paper"]
"""Names of the rules for the visible region at a cut."""

CUT_RULES: dict[str, Callable[..., tuple[Any, Any]]] = {"source": _source_rule, "paper": _paper_rule}
"""Rules for the visible region at a cut, by name; the first is the default."""


def decide(
    here: Sequence[Any],
    there: Sequence[Sequence[Any]],
    sides: Sequence[Sides],
    rule: str,
    softness: float,
    xp: Any = np,
) -> tuple[Any, Any]:
    """The visible region at places x, and its opacity.

    Parameters
    ----------
    here : signed distances (...) of x to every cut.
    there : for every field the distances (...) to every cut of the place x + D_k(x).
    sides : the region of every field.

    Returns
    -------
    choice : (...) number of the field; their count for "none of them", that is no displacement.
    opacity : (...) from 0 to 1.
    """
    own = [_is_own(here, region, xp) for region in sides]
    covered = [_coverage(_depth(here, region, xp), softness, xp) for region in sides]
    brought = [_coverage(_depth(d, region, xp), softness, xp) for d, region in zip(there, sides, strict=True)]
    still = xp.clip(1.0 - sum(covered), 0.0, 1.0) if sides else xp.ones(here[0].shape)
    choice, opacity = CUT_RULES[rule](own, covered, brought, still, xp)
    return choice, xp.where(opacity > OPAQUE, 1.0, opacity)


def is_doubtful(
    here: Sequence[Any],
    there: Sequence[Sequence[Any]],
    sides: Sequence[Sides],
    softness: float,
    error: float,
    errors: Sequence[float],
) -> NDArray[np.bool_]:
    """Check where distances that may be wrong leave :func:`decide` in doubt; parameters as there.

    Parameters
    ----------
    error : of the distances ``here``; errors : of those ``there``, for each field.

    Places surely in a region, whose sources are surely in it too, show these by either rule. Elsewhere there is
    no doubt where all are farther from the border than the opacity falls.
    """
    is_sure, is_near = np.zeros(here[0].shape, dtype=bool), np.zeros(here[0].shape, dtype=bool)
    for region, led, error_there in zip(sides, there, errors, strict=True):
        depth, brought = _depth(here, region, np), _depth(led, region, np)
        most = softness / 2 + error_there
        is_sure |= (depth > error) & (brought >= most)
        is_near |= (np.abs(depth) <= softness / 2 + error) | (np.abs(brought) <= most)
    return np.asarray(is_near & ~is_sure)


def _is_own(here: Sequence[Any], region: Sides, xp: Any) -> Any:
    same = xp.ones(here[0].shape, dtype=bool)
    for d, inside in zip(here, region, strict=True):
        same = same & ((d < 0) == inside)
    return same


# ---- the field -------------------------------------------------------------------------------------------------------


@pytree(data_fields=["regions", "frame", "origin", "sides", "softness"], meta_fields=["rule"])
@dataclass(frozen=True, eq=False)
class SideChoice:
    """The choice among regions at cuts for compiled functions; its arrays have few shapes.

    Parameters
    ----------
    regions : one for every cut. frame, origin : rows of the axes, and the origin, of the cuts' coordinates.
    sides : of the regions that may be seen. rule : by which they are seen.
    softness : of the cuts, in the type in which distances are measured.
    """

    regions: tuple[Any, ...]
    frame: Any
    origin: Any
    sides: tuple[Any, ...]
    softness: Any
    rule: str

    def distances(self, places: Sequence[Sequence[Any]]) -> tuple[list[Any], list[list[Any]]]:
        """Signed distances (...) to every cut of places given by their components (...), first and others.

        All places go through one loop over the edges of each cut.
        """
        apart = [jnp.stack(parts) - o for parts, o in zip(zip(*places, strict=True), self.origin, strict=True)]
        within = jnp.stack(
            [sum(f * a for f, a in zip(row, apart, strict=True)).astype(self.softness.dtype) for row in self.frame],
            axis=-1,
        )
        measured = [lax.optimization_barrier(region(within)) for region in self.regions]
        first, *others = [[part[k] for part in measured] for k in range(len(places))]
        return first, others

    def decide(self, here: Sequence[Any], there: Sequence[Sequence[Any]]) -> tuple[Any, Any]:
        """:func:`decide` by these distances."""
        return decide(here, there, self.sides, self.rule, self.softness, jnp)


@pytree(data_fields=["fields", "regions"], meta_fields=["sides", "plane", "rule", "softness"])
@dataclass(frozen=True, eq=False, repr=False)
class Decoupled(AbstractField):
    """Smooth fields of the regions between cuts, and the choice among them: the paper's decoupled interpolant.

    Parameters
    ----------
    fields : of the regions that have control points, all of one dimension.
    sides : the region of each field.
    regions : one for every cut.
    plane : the plane on which the cuts are drawn, for fields in space; None if the cuts have the fields' dimension.
    rule : a name of :data:`CUT_RULES`.
    softness : width over which the opacity falls at a cut, physical; about a voxel.

    Examples
    --------
    >>> from deformnb.rbf.fit_settings import FitSettings
    >>> from deformnb.rbf.regions import Line
    >>> pull = ControlPoints.from_arrays([[2, 0], [8, 0]], [[1, 0], [9, 0]])  # both sides one away from the middle
    >>> cut = Line([(5, 9), (5, 0)])
    >>> field = FitSettings().fit(pull, cuts=[cut], softness=0.5)
    >>> x = [[3.0, 0.0], [4.5, 0.0], [5.5, 0.0], [7.0, 0.0]]
    >>> field.displacement(x).round(9)[:, 0].tolist(), field.opacity(x).round(9).tolist()
    ([1.0, 1.0, -1.0, -1.0], [1.0, 0.0, 0.0, 1.0])
    """

    fields: tuple[AbstractField, ...]
    sides: tuple[Sides, ...]
    regions: tuple[AbstractRegion, ...]
    plane: Plane | None = None
    rule: CutRuleName = "source"
    softness: float = 1.0

    def __post_init__(self) -> None:
        if self.rule not in CUT_RULES:
            raise DeformError(f"unknown rule {self.rule!r} of cuts; choose one of {', '.join(CUT_RULES)}.")
        if not 1 <= len(self.regions) <= MOST_CUTS:
            raise DeformError(f"one to {MOST_CUTS} cuts are possible, got {len(self.regions)}.")
        if len(self.fields) != len(self.sides) or any(len(s) != len(self.regions) for s in self.sides):
            raise DeformError("every field needs its region, and every region a side of every cut.")
        if not self.softness > 0:  # NaN as well
            raise DeformError(f"the softness of cuts must be a positive length, got {self.softness}.")

    @property
    def dim(self) -> int:
        return 3 if self.plane is not None else self.regions[0].dim

    @property
    def has_cuts(self) -> bool:
        return True

    @full_precision
    def jax_displacement(self, points: Any) -> Any:
        x = jnp.asarray(points)
        moves = [f.jax_displacement(x) for f in self.fields]
        here, *there = ([r(p) for r in self.regions] for p in self._cut_coordinates([x, *(x + d for d in moves)], jnp))
        choice, _ = decide(here, there, self.sides, self.rule, self.softness, jnp)
        total = jnp.zeros_like(x)
        for k, d in enumerate(moves):
            total = jnp.where((choice == k)[..., None], d, total)
        return total

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.displacement_and_opacity(points)[0]

    def opacity(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.displacement_and_opacity(points)[1]

    def displacement_and_opacity(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        x = np.asarray(points, dtype=np.float64)
        moves = [f.displacement(x) for f in self.fields]
        choice, opacity = self.choose(x, moves)
        total = np.zeros_like(x)
        for k, d in enumerate(moves):
            total = np.where((choice == k)[..., None], d, total)
        return total, np.asarray(opacity)

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        """The Jacobian of the field seen at each point; it does not contain the jump across a cut."""
        x = np.asarray(points, dtype=np.float64)
        choice, _ = self.choose(x, [f.displacement(x) for f in self.fields])
        out = np.zeros((*x.shape, self.dim))
        for k, f in enumerate(self.fields):
            own = choice == k
            if own.any():
                out[own] = f.jacobian(x[own])
        return out

    def lattice_jacobians(self, rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float32]:
        r, c = np.asarray(rows, dtype=np.float64), np.asarray(columns, dtype=np.float64)
        x = np.stack([a[:, None] + b[None, :] for a, b in zip(r, c, strict=True)], axis=-1)
        moves = [np.moveaxis(f.lattice_values(r, c, self.softness), 0, -1) for f in self.fields]
        choice, _ = self.choose(x, moves)
        out = np.zeros((self.dim, self.dim, *choice.shape), dtype=np.float32)
        for k, f in enumerate(self.fields):
            own = choice == k
            if own.any():
                out = np.where(own, f.lattice_jacobians(r, c), out)
        return out

    def choice(self, sides: Sequence[Sides], dtype: Any = np.float64) -> SideChoice:
        """The choice among some regions, for compiled functions of places by components, by distances of a type."""
        frame, origin = (
            (np.eye(self.dim), np.zeros(self.dim)) if self.plane is None else (self.plane.frame[:2], self.plane.origin)
        )
        regions = jax.tree.map(
            lambda part: np.asarray(part, min(part.dtype, np.dtype(dtype))),
            tuple(region.to_jax() for region in self.regions),
        )
        return SideChoice(
            regions,
            np.asarray(frame, np.float64),
            np.asarray(origin, np.float64),
            tuple(tuple(map(np.bool_, side)) for side in sides),
            dtype(self.softness),
            self.rule,
        )

    def choose(self, x: NDArray[np.float64], moves: Sequence[NDArray[Any]]) -> tuple[Any, Any]:
        """The field seen at places x (..., dim) by its number, and the opacity, as :func:`decide` returns them.

        Parameters
        ----------
        moves : displacements (..., dim) of all fields there.
        """
        places = self._cut_coordinates([x, *(x + d for d in moves)], np)
        return self._choose_among(places)

    def choose_in_plane(self, x: NDArray[np.float64], moves: Sequence[NDArray[Any]]) -> tuple[Any, Any]:
        """:meth:`choose` at places x (..., 2) by displacements (..., 2), both in the coordinates of the cuts."""
        return self._choose_among([x, *(x + d for d in moves)])

    def _choose_among(self, places: Sequence[NDArray[np.float64]]) -> tuple[Any, Any]:
        here, *there = ([r.signed_distance(p) for r in self.regions] for p in places)
        return decide(here, there, self.sides, self.rule, self.softness)

    def _cut_coordinates(self, places: Sequence[Any], xp: Any) -> list[Any]:
        """Places in the coordinates of the cuts."""
        if self.plane is None:
            return list(places)
        frame, origin = xp.asarray(self.plane.frame[:2]), xp.asarray(self.plane.origin)
        return [(x - origin) @ frame.T for x in places]

    def lattice_values_and_opacity(
        self, rows: ArrayLike, columns: ArrayLike, resolution: float
    ) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        r, c = np.asarray(rows, dtype=np.float64), np.asarray(columns, dtype=np.float64)
        x = np.stack([a[:, None] + b[None, :] for a, b in zip(r, c, strict=True)], axis=-1)
        moves = [f.lattice_values(r, c, resolution) for f in self.fields]
        choice, opacity = self.choose(x, [np.moveaxis(d, 0, -1) for d in moves])
        total = np.zeros((self.dim, *choice.shape), dtype=np.float32)
        for k, d in enumerate(moves):
            total = np.where(choice == k, d, total)
        return total, np.asarray(opacity, dtype=np.float32)

    def lattice_values(self, rows: ArrayLike, columns: ArrayLike, resolution: float) -> NDArray[np.float32]:
        return self.lattice_values_and_opacity(rows, columns, resolution)[0]

    def fields_by_source(self, points: NDArray[np.float64]) -> list[tuple[NDArray[np.bool_], AbstractField | None]]:
        """Masks of points (N, dim) before the deformation that each field moves, and None for those that stay."""
        own = self._sides(points)
        masks = [(own == np.asarray(region)).all(axis=-1) for region in self.sides]
        rest = ~np.logical_or.reduce([*masks, np.zeros(len(points), dtype=bool)])
        return [*zip(masks, self.fields, strict=True), (rest, None)]

    def region_numbers(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """The number of the region, with or without points, that contains each of the points (N, dim)."""
        return self._sides(points) @ (1 << np.arange(len(self.regions)))

    def _sides(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        return sides_of(self.regions, points if self.plane is None else self.plane.to_plane(points)[..., :2])

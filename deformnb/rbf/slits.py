"""Slits: cuts that stop inside the body, which open between their ends and close continuously at each tip.

A cut divides the picture into two sides with a map each, and so continues to the border. Where a line stops
(:class:`~deformnb.rbf.regions.Line` with ``stops``), the map of a side is blended towards the tip into the map without
that cut. With one line that stops, ``D_side`` the fit of the points of one side and ``D_0`` the fit of all points:

    ``D(x) = w D_side(x) + (1 - w) D_0(x)``,  ``w = W(x + D_0(x))``

W is :meth:`~deformnb.rbf.regions.Line.opening`: 0 from the tip onwards, 1 away from it, with a continuous derivative.
It is measured where the tissue comes from without the cut, so that the tip is a place of the tissue and is carried by a
drag. Three things follow:

- A control point is hit exactly at any w: both fits take it where it should go.
- Both sides have the same map, D_0, wherever w = 0. So there is no jump beyond the tip, nor at it, as long as the map
  does not fold; the jump tends to 0 with w, like the square of the distance from the tip.
- Each side's map has a continuous derivative.

Of several lines that stop each is blended by its own w (multilinear): ``D = sum_A prod_{k in A} w_k
prod_{k not in A} (1 - w_k) D_A`` over the subsets A of these lines, with D_A the fit of the points that no line of A,
and no cut that continues to the border, parts from the region. All w are measured at ``x + D_{}(x)``.

Where a displacement is weighted by depth, w is that of full weight, so that a tip lies exactly where it was drawn only
where f(z) = 1 or where the tissue at the tip does not move.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._jax import jax, pytree
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Sides, points_of_regions
from deformnb.rbf.fields import AbstractField, AbstractFit, Identity
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion, Line

MOST_SLITS = 3
"""Cuts of a step that stop inside the body: each doubles the fits that every region blends."""


@pytree(data_fields=["fits", "lines"], meta_fields=[])
@dataclass(frozen=True, eq=False, repr=False)
class TipBlend(AbstractFit):
    """The map of one region with cuts that stop: its fits with and without each of these cuts, blended at the tips.

    Parameters
    ----------
    fits : 2^n fields of dimension 2 for n lines; bit k of a field's place is set where line k parts its points.
    lines : which stop.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> cut = Line([(0, 0), (10, 0)], stops=(True, True))
    >>> TipBlend((Identity(2), Identity(2)), (cut,)).displacement([[5.0, 1.0]]).tolist()
    [[0.0, 0.0]]
    """

    fits: tuple[AbstractField, ...]
    lines: tuple[Line, ...]

    @property
    def dim(self) -> int:
        return 2

    @property
    def ids(self) -> tuple[int, ...]:
        """Ids of the control points that move the region away from the tips."""
        last = self.fits[-1]
        return last.ids if isinstance(last, AbstractFit) else ()

    @property
    def trend(self) -> str:
        """The trend of the fits."""
        return next((fit.trend for fit in self.fits if isinstance(fit, AbstractFit)), "none")

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks of all fits, each once."""
        return tuple(dict.fromkeys(note for fit in self.fits if isinstance(fit, AbstractFit) for note in fit.notes))

    def jax_displacement(self, points: Any) -> Any:
        moves = [fit.jax_displacement(points) for fit in self.fits]
        weights = [line.opening(points + moves[0], jax.numpy)[..., None] for line in self.lines]
        return blend_displacements(moves, weights)

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        x = np.asarray(points, dtype=np.float64)
        moves = [fit.displacement(x) for fit in self.fits]
        return np.asarray(blend_displacements(moves, [w[..., None] for w in self._openings(x + moves[0])]))

    def lattice_values(self, rows: ArrayLike, columns: ArrayLike, resolution: float) -> NDArray[np.float32]:
        moves = [fit.lattice_values(rows, columns, resolution) for fit in self.fits]
        source = np.moveaxis(_outer_sum(rows, columns) + moves[0], 0, -1)
        return np.asarray(blend_displacements(moves, [w.astype(np.float32) for w in self._openings(source)]))

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        """dD/dx by the product rule, with ``dw/dx = (1 + dD_0/dx)^T grad W``."""
        x = np.asarray(points, dtype=np.float64)
        moves, slopes = [fit.displacement(x) for fit in self.fits], [fit.jacobian(x) for fit in self.fits]
        source, turned = x + moves[0], np.eye(2) + slopes[0]
        for k in reversed(range(len(self.lines))):
            w = self.lines[k].opening(source)[..., None]
            slope = np.einsum("...i,...ij->...j", self.lines[k].opening_gradient(source), turned)
            half = 1 << k
            slopes = [
                p + w[..., None] * (q - p) + (b - a)[..., :, None] * slope[..., None, :]
                for p, q, a, b in zip(slopes[:half], slopes[half:], moves[:half], moves[half:], strict=True)
            ]
            moves = _one_less(moves, w)
        return slopes[0]

    def lattice_jacobians(self, rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float32]:
        places = np.moveaxis(_outer_sum(rows, columns), 0, -1)
        return np.moveaxis(self.jacobian(places), (-2, -1), (0, 1)).astype(np.float32)

    def _openings(self, source: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        return [np.asarray(line.opening(source)) for line in self.lines]


def _outer_sum(rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float64]:
    return np.asarray(np.asarray(rows, dtype=np.float64)[:, :, None] + np.asarray(columns, dtype=np.float64)[:, None])


def _one_less(values: list[Any], weight: Any) -> list[Any]:
    """The values with the last of the lines blended in."""
    half = len(values) // 2
    return [a + weight * (b - a) for a, b in zip(values[:half], values[half:], strict=True)]


def blend_displacements(values: list[Any], weights: list[Any]) -> Any:
    """The displacements of 2^n fits, blended by the openings of n lines that stop, for NumPy and JAX."""
    for weight in reversed(weights):
        values = _one_less(values, weight)
    return values[0]


def is_slit(region: AbstractRegion) -> bool:
    """Check whether a cut along this region stops inside the body at one end or both."""
    return isinstance(region, Line) and any(region.stops)


def check_slits(cuts: Sequence[AbstractRegion], rule: str) -> None:
    """Refuse cuts that stop where there are too many, or with a rule that supports none.

    Raises
    ------
    DeformError
        With the remedy.
    """
    count = sum(map(is_slit, cuts))
    if count > MOST_SLITS:
        raise DeformError(
            f"at most {MOST_SLITS} cuts of a step may stop inside the body, got {count}; let one continue "
            "to the border, or put it in a separate step."
        )
    if count and rule == "paper":
        raise DeformError(
            'the rule "paper" of cuts (Eq. 8) hides what crosses a line, also where that has stopped; '
            'use the rule "source", or let the cuts continue to the border.'
        )


def fits_around_slits(
    points: ControlPoints,
    cuts: Sequence[AbstractRegion],
    fit: Callable[[Sides, ControlPoints, Any], AbstractField],
    previous: Mapping[Sides, Any],
) -> dict[Sides, TipBlend]:
    """Blended fits of every region between cuts of which some stop; none if no point is active.

    Parameters
    ----------
    fit : makes the fit of some of the points; it gets the region's sides of the cuts that count, the points, and the
        fit before, None for none.
    previous : the blended fits before these.
    """
    stop = [k for k, cut in enumerate(cuts) if is_slit(cut)]
    active = points.subset(np.flatnonzero(points.active))
    if not len(active):
        return {}
    subsets = [
        [k for k in range(len(cuts)) if k not in stop or bits >> stop.index(k) & 1] for bits in range(1 << len(stop))
    ]
    groups: list[dict[Sides, ControlPoints]]
    groups = [points_of_regions(active, [cuts[k] for k in some]) if some else {(): active} for some in subsets]
    known: dict[tuple[int, Sides], AbstractField] = {}
    made: dict[Sides, TipBlend] = {}
    for region in product((False, True), repeat=len(cuts)):
        own = [tuple(region[k] for k in some) for some in subsets]
        before = getattr(previous.get(region), "fits", [None] * len(subsets))
        for bits, sides in enumerate(own):
            if sides in groups[bits] and (bits, sides) not in known:
                known[bits, sides] = fit(sides, groups[bits][sides], before[bits] if bits < len(before) else None)
        fits = tuple(known.get((bits, sides), Identity(2)) for bits, sides in enumerate(own))
        if any(not isinstance(one, Identity) for one in fits):
            made[region] = TipBlend(fits, tuple(cuts[k] for k in stop))  # type: ignore[misc]
    return made

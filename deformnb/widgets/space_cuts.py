"""A composition in which one step has cuts as a graphics card reads it: samples in space, each region by itself.

What lies beside the cut is smooth in every region, beyond its edge too, so it may be sampled coarsely and interpolated:
the displacement of all steps together, how deep the place that it leads to lies within the region, and how deep the
sample itself does. The card chooses by them at every place, as :mod:`deformnb.cuts` does.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.cuts import Decoupled, Sides
from deformnb.fields import AbstractField, Composed, Identity
from deformnb.widgets.card_cuts import MOST_REGIONS


@dataclass(frozen=True, eq=False)
class CutChain:
    """A composition around the one of its steps whose cuts are kept.

    Parameters
    ----------
    later : the steps after it, the last one first; they are undone first.
    cut : the step.
    earlier : the steps before it, in the same order.
    """

    later: tuple[AbstractField, ...]
    cut: Decoupled
    earlier: tuple[AbstractField, ...]

    @property
    def is_exact(self) -> bool:
        """Whether no other step has cuts, which would be smeared between samples."""
        return not any(f.has_cuts for f in (*self.later, *self.earlier))


def cut_chain(field: AbstractField) -> CutChain | None:
    """The chain of a composition, around the last of its steps that has cuts; None if there is none."""
    steps = _steps(field)
    for k, step in enumerate(steps):
        if isinstance(step, Decoupled):
            return CutChain(tuple(steps[:k]), step, tuple(steps[k + 1 :]))
    return None


def chain_is_exact(field: AbstractField) -> bool:
    """Whether a composition has cuts in one of its steps only."""
    chain = cut_chain(field)
    return chain is not None and chain.is_exact


def _steps(field: AbstractField) -> list[AbstractField]:
    """In the order in which they are undone, the last one first."""
    return [*_steps(field.then), *_steps(field.first)] if isinstance(field, Composed) else [field]


@dataclass(frozen=True, eq=False)
class SpaceLayers:
    """What is known at every sample.

    Parameters
    ----------
    moves : (regions, ..., 4), the displacement, and the depth within the region of where it leads to.
    depths : (regions, ..., 2), the depth of the sample itself, and the share of it that other steps leave.
    """

    moves: NDArray[np.float64]
    depths: NDArray[np.float64]


def space_layers(chain: CutChain, points: NDArray[np.float64]) -> SpaceLayers | None:
    """The samples of every region at points (..., 3); None if there are too many regions."""
    cut = chain.cut
    before, kept = _through(chain.later, points)
    here = _distances(cut, before)
    sides = _all_sides(cut, here)
    if len(sides) > MOST_REGIONS:
        return None
    fields = dict(zip(cut.sides, cut.fields, strict=True))
    moves = np.empty((len(sides), *points.shape[:-1], 4))
    depths = np.empty((*moves.shape[:-1], 2))
    for r, side in enumerate(sides):
        place = before + fields.get(side, Identity(3)).displacement(before)
        end, left = _through(chain.earlier, place)
        moves[r, ..., :3], moves[r, ..., 3] = end - points, _depth(_distances(cut, place), side)
        depths[r, ..., 0], depths[r, ..., 1] = _depth(here, side), kept * left
    return SpaceLayers(moves, depths)


def _through(steps: tuple[AbstractField, ...], points: NDArray[np.float64]) -> tuple[NDArray[np.float64], Any]:
    """Where points come from, and the share of them that is seen."""
    at, kept = points, np.ones(points.shape[:-1])
    for step in steps:
        d, opacity = step.seen(at)
        at, kept = at + d, kept * opacity
    return at, kept


def _distances(cut: Decoupled, points: NDArray[np.float64]) -> NDArray[np.float64]:
    at = points if cut.plane is None else cut.plane.to_plane(points)[..., :2]
    return np.stack([region.signed_distance(at) for region in cut.regions], axis=-1)


def _depth(distances: NDArray[np.float64], side: Sides) -> NDArray[np.float64]:
    return np.asarray((distances * np.where(side, -1.0, 1.0)).min(axis=-1))


def _all_sides(cut: Decoupled, here: NDArray[np.float64]) -> list[Sides]:
    """The regions that have a field, and those that are there without one."""
    found = np.unique((here < 0).reshape(-1, len(cut.regions)), axis=0)
    return sorted({*cut.sides, *map(tuple, found.tolist())})

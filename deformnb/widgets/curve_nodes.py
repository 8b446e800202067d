"""Curves over [0, 1] through nodes: their values, and the nodes that draw a given curve."""

from __future__ import annotations

from collections.abc import Sequence
from math import gcd
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Nodes: TypeAlias = tuple[tuple[float, float], ...]

PARTS = 128
"""The page puts nodes at multiples of 1/128, so that 129 values hold a curve exactly and give its nodes back."""

MOST_NODES = 64
"""More cannot be told apart on a plot of 360 pixels."""

# Of the height: differences that nobody sees, and that rounding makes.
_SEEN, _ROUNDING = 0.004, 1e-9


def values_of(nodes: Nodes, z: ArrayLike, smooth: bool = False) -> NDArray[np.float64]:
    """The curve through nodes at z: straight lines, or if ``smooth`` the cubic that never overshoots.

    >>> values_of(((0, 0), (0.5, 1), (1, 0)), [0.0, 0.25, 0.75]).tolist()
    [0.0, 0.5, 0.5]
    """
    at, (x, y) = np.asarray(z, dtype=np.float64), np.asarray(nodes, dtype=np.float64).T
    if not smooth or len(x) < 3:
        return np.interp(at, x, y)
    from scipy.interpolate import PchipInterpolator

    return np.asarray(PchipInterpolator(x, y)(np.clip(at, x[0], x[-1])), dtype=np.float64)


def fewest_values(nodes: Nodes) -> int:
    """How many values at equal steps hold the straight lines through nodes exactly, at most 129.

    >>> fewest_values(((0, 0), (0.25, 1), (1, 1)))
    5
    """
    at = [x * PARTS for x, _ in nodes]
    if any(abs(a - round(a)) > 1e-9 * PARTS for a in at):
        return PARTS + 1
    return PARTS // gcd(PARTS, *(round(a) for a in at)) + 1


def exact_nodes(values: Sequence[float]) -> Nodes | None:
    """The nodes whose straight lines are these values at equal steps; None if there are too many.

    >>> exact_nodes((0.0, 0.5, 1.0, 1.0))
    ((0.0, 0.0), (0.666..., 1.0), (1.0, 1.0))
    """
    y = np.asarray(values, dtype=np.float64)
    bends = np.abs(np.diff(y, 2)) > _ROUNDING * _height(y)
    kept = np.concatenate(([0], np.flatnonzero(bends) + 1, [len(y) - 1]))
    if len(kept) > MOST_NODES:
        return None
    return tuple((float(k / (len(y) - 1)), float(y[k])) for k in kept)


def few_nodes(values: Sequence[float], most: int = 9) -> Nodes:
    """At most ``most`` nodes that draw these values at equal steps about as well as so few can.

    Even spacing where it does as well, for it is easier on the eye; else a node wherever the lines err most.
    """
    z, y = np.linspace(0.0, 1.0, len(values)), np.asarray(values, dtype=np.float64)
    best: Nodes = ()
    for count in (n for n in (2, 3, 5, 9) if n <= most):
        x = np.round(np.linspace(0, 1, count) * PARTS) / PARTS
        best = tuple(zip(x.tolist(), np.interp(x, z, y).tolist(), strict=True))
        if _error(best, z, y) <= _SEEN * _height(y):
            return best
    chosen = _greedy(z, y, most)
    return chosen if _error(chosen, z, y) < 0.7 * _error(best, z, y) else best


def _greedy(z: NDArray[np.float64], y: NDArray[np.float64], most: int) -> Nodes:
    grid = np.arange(PARTS + 1) / PARTS
    on_grid, kept = np.interp(grid, z, y), [0, PARTS]
    while len(kept) < most:
        off = np.abs(np.interp(grid, grid[kept], on_grid[kept]) - on_grid)
        if off.max() <= _SEEN * _height(y):
            break
        kept = sorted({*kept, int(off.argmax())})
    return tuple((float(grid[k]), float(on_grid[k])) for k in kept)


def _error(nodes: Nodes, z: NDArray[np.float64], y: NDArray[np.float64]) -> float:
    return float(np.abs(values_of(nodes, z) - y).max())


def _height(y: NDArray[np.float64]) -> float:
    return max(float(np.ptp(y)), float(np.abs(y).max()), 1e-12)

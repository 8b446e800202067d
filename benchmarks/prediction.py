"""How well maps predict nodes that were left out: ``python -m benchmarks prediction > docs/prediction.md``.

For each of D'Arcy Thompson's pairs of grids a part of the nodes is left out, the map of the others is evaluated there,
and its error is the root of the mean squared distance from Thompson's node, in pixels of the scan of the source.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from deformnb.datasets import thompson_map, thompson_pairs
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints

HELD = {
    "checkerboard": lambda rows, columns, shape: (rows + columns) % 2 == 0,
    "every other row and column": lambda rows, columns, shape: (rows % 2 == 0) & (columns % 2 == 0),
    "outline": lambda rows, columns, shape: (rows % (shape[0] - 1) == 0) | (columns % (shape[1] - 1) == 0),
}
"""Nodes that are known, by name: of rows and columns counted from 0, and the numbers of both."""

METHODS = ("affine", "thin plate", "deformnb")

_PAGE = """# How well it predicts

Thompson drew every node of his grids by hand. Here a part of the nodes of each pair is left out, the map through the
others predicts them, and the distance from what he drew is measured: the root of the mean square, in pixels of the
scan of the first fish, where a node is read with an error of about 2. "affine" is the best affine map, "thin plate"
the spline of BigWarp and geomorph, and "deformnb" is `dn.fit_rbf` with its defaults: Wendland's C2 kernel, an affine
trend, and a support chosen by leave-one-out errors.

"checkerboard" knows every other node, "every other row and column" a quarter of them, and "outline" those at the rim.

| pair | known nodes | {methods} |
|---|---|{bars}|
{rows}
| **median of all** | | {medians} |

An outline alone does not tell what happens inside a deep fish such as Antigonia, with any of the maps. `python -m
benchmarks prediction` makes this page, and a test holds its figures.
"""


def errors() -> Iterator[tuple[str, str, dict[str, float]]]:
    """Pair, known nodes, and the error of each method in pixels of the scan of the source."""
    for first, second in thompson_pairs():
        pair = thompson_map(first, second, box=(0.0, 1.0, 0.0, 1.0), scale="area", cells="square")
        pixels = float(np.ptp(pair.source.nodes[..., 0]))
        source, target = pair.source_nodes * pixels, pair.target_nodes * pixels
        for name, chosen in HELD.items():
            known = chosen(*np.indices(source.shape[:2]), source.shape[:2])
            points = ControlPoints.from_arrays(source[known], target[known])
            fits = {"thin plate": fit_rbf(points, kernel="thin_plate"), "deformnb": fit_rbf(points)}
            at, right = target[~known], source[~known]
            found = {"affine": _affine(target[known], source[known], at)}
            found |= {method: at + fit.displacement(at) for method, fit in fits.items()}
            yield (f"{first} to {second}", name,
                   {m: float(np.sqrt(((found[m] - right) ** 2).sum(axis=1).mean())) for m in METHODS})


def _affine(target: NDArray[np.float64], source: NDArray[np.float64], at: NDArray[np.float64]) -> NDArray[np.float64]:
    """The affine map of least squares from targets to sources, at places."""
    with_one = [np.column_stack([places, np.ones(len(places))]) for places in (target, at)]
    solution: NDArray[np.float64] = np.linalg.lstsq(with_one[0], source, rcond=None)[0]
    return with_one[1] @ solution


def page() -> str:
    """The page of the documentation."""
    found = list(errors())
    rows = "\n".join(f"| {pair} | {known} | {' | '.join(f'{of[method]:.1f}' for method in METHODS)} |"
                     for pair, known, of in found)
    medians = " | ".join(f"**{np.median([of[m] for _, _, of in found]):.1f}**" for m in METHODS)
    return _PAGE.format(methods=" | ".join(METHODS), bars="|".join(["---:"] * len(METHODS)), rows=rows, medians=medians)


def main(arguments: list[str]) -> int:
    print(page(), end="")
    return 0

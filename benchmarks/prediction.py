"""Errors of maps at places that were left out: ``python -m benchmarks prediction > docs/prediction.md``.

For each of D'Arcy Thompson's pairs of grids a part of the nodes is left out, maps are fitted to the others, and their
error is the root of the mean squared distance between where a left-out node of the first drawing comes to in the second
and where Thompson drew it, in pixels of the scan of the first. Two files of landmarks as arguments add their rows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from deformnb.datasets import thompson_map, thompson_pairs
from deformnb.io import read_landmarks
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.prediction import choose_fit, describe_settings
from deformnb.warping.points import warp_points

Places = NDArray[np.float64]

HELD: dict[str, Callable[[Any, Any, Any], Any]] = {
    "checkerboard": lambda rows, columns, shape: (rows + columns) % 2 == 0,
    "rows and columns": lambda rows, columns, shape: (rows % 2 == 0) & (columns % 2 == 0),
    "interior": lambda rows, columns, shape: (rows % (shape[0] - 1) == 0) | (columns % (shape[1] - 1) == 0),
}
"""Nodes that are known, by what is left out: of rows and columns counted from 0, and the numbers of both."""

METHODS = ("plate backward", "plate forward", "default", "chosen", "all-knowing")

_PAGE = """# Prediction accuracy

Thompson drew every node of his grids by hand. Here a part of the nodes of each pair is left out, maps are fitted to the
others, and the distance is measured between a left-out node of the first drawing as mapped to the second and as he drew
it: the root of the mean square, in pixels of the scan of the first, where a node is read with an error of about 2.
"checkerboard" knows every other node, "rows and columns" every other row and column (a quarter), and "interior" only
those at the rim.

A fit *backward* finds for each place of the result where it comes from, as a warp needs it; a fit *forward* finds where
each place of the input goes, as most programs of morphometrics fit thin plates, and is inverted numerically
(`direction="forward"`). "plate backward" and "plate forward" are thin plates in both directions, "default" is
`dn.fit_rbf(points)`, and "chosen" is what `dn.rbf.choose_fit(points)` takes: kernel, trend, support radius, smoothing
and direction by leaving out some of the *known* nodes again, one by one and in blocks; it never sees those it is judged
by. "all-knowing" is the best of all fits that it tries, picked by the errors at the left-out nodes themselves: no rule
can know it, and it bounds what any choice among these fits reaches.

| pair | left out | {methods} | chosen / better plate | chosen fit |
|---|---|{bars}---:|---|
{rows}
| **median of all** | | {medians} | **{median:.2f}** | |

{verdict}

The choice is a statement about the points: with few of them, or with a rim alone, a fit that predicts its own left-out
points well may be another one than that which predicts the middle. `python -m benchmarks prediction` makes this page,
and a test holds its figures.
"""


class Case(NamedTuple):
    """One set of places of which some are known: name, what is left out, sources and targets, and which are known."""

    name: str
    left_out: str
    source: Places
    target: Places
    known: NDArray[np.bool_]


class Found(NamedTuple):
    """Errors by method, and the fit that was chosen, in words."""

    case: Case
    error: dict[str, float]
    chosen: str

    @property
    def ratio(self) -> float:
        """The error of the chosen fit relative to that of the better thin plate."""
        return self.error["chosen"] / self.plate

    @property
    def plate(self) -> float:
        """The error of the better thin plate."""
        return min(self.error["plate backward"], self.error["plate forward"])


def grids() -> Iterator[Case]:
    """Thompson's pairs with each part of their nodes left out."""
    for first, second in thompson_pairs():
        pair = thompson_map(first, second, box=(0.0, 1.0, 0.0, 1.0), scale="area", cells="square")
        pixels = float(np.ptp(pair.source.nodes[..., 0]))
        source, target = pair.source_nodes * pixels, pair.target_nodes * pixels
        for name, chosen in HELD.items():
            known = chosen(*np.indices(source.shape[:2]), source.shape[:2])
            yield Case(f"{first} to {second}", name, source.reshape(-1, 2), target.reshape(-1, 2), known.ravel())


def landmarks(first: str, second: str) -> Iterator[Case]:
    """Two files of corresponding landmarks, with some left out: along their longest axis, or within their hull."""
    points = ControlPoints.from_landmarks(read_landmarks(first), read_landmarks(second)).points
    centred = points.source - points.source.mean(axis=0)
    rank = np.argsort(np.argsort(centred @ np.linalg.svd(centred, full_matrices=False)[2][0]))
    hull = np.isin(np.arange(len(points)), ConvexHull(points.source).vertices)
    for name, known in (("every other", rank % 2 == 0), ("three of four", rank % 4 == 0), ("inner ones", hull)):
        yield Case("landmarks of two mice (mm)", name, points.source, points.target, known)


def measure(case: Case) -> Found:
    """The errors of all methods."""
    points = ControlPoints.from_arrays(case.source[case.known], case.target[case.known])
    plate = "thin_plate" if points.dim == 2 else "linear"
    chosen = choose_fit(points)

    def error(fit: Any) -> float:
        moved = warp_points(case.source[~case.known], fit)[0]
        return float(np.sqrt(((moved - case.target[~case.known]) ** 2).sum(axis=1).mean()))

    every = [error(row.settings.fit(points)) for row in chosen.tried if not row.why]
    found = [
        error(FitSettings(kernel=plate, direction="backward").fit(points)),
        error(FitSettings(kernel=plate, direction="forward").fit(points)),
        error(FitSettings().with_chosen_support([points]).fit(points)),
        error(chosen.fit),
        min(every),
    ]
    return Found(case, dict(zip(METHODS, found, strict=True)), describe_settings(chosen.settings))


def errors(cases: Iterator[Case] | None = None) -> list[Found]:
    """The errors of all methods for Thompson's grids, or for other cases."""
    return [measure(case) for case in (grids() if cases is None else cases)]


def is_reached(found: Found) -> bool:
    """Check that the choice is not worse than the better plate by more than a quarter and half a pixel."""
    return found.error["chosen"] <= max(1.25 * found.plate, found.plate + 0.5)


def _verdict(found: list[Found]) -> str:
    """Summary of the table in words."""
    ratios = [one.ratio for one in found]
    better, worse = sum(r < 0.95 for r in ratios), sum(r > 1.05 for r in ratios)
    missed = [f"{one.case.name}, {one.case.left_out}" for one in found if not is_reached(one)]
    best = np.median([one.error["all-knowing"] / one.plate for one in found])
    count = len(found)
    text = (
        f"Against the better of the two thin plates, which nobody knows beforehand, the choice is better by more "
        f"than 5 % in {better} of {count} rows, within 5 % in {count - better - worse} and worse by more than 5 % in "
        f"{worse}; the median ratio is {np.median(ratios):.2f}, and that of the all-knowing choice {best:.2f}. "
    )
    backward = np.median([one.error["chosen"] / one.error["plate backward"] for one in found])
    text += (
        f"Against the thin plate backward alone it is {backward:.2f}, and the default fit is "
        f"{np.median([one.error['default'] / one.error['plate backward'] for one in found]):.2f} times as far off "
        "as that. "
    )
    return text + (
        "No row is worse than the better plate by more than a quarter and half a pixel."
        if not missed
        else f"Worse than the better plate by more than a quarter and half a pixel: {'; '.join(missed)}."
    )


def page(found: list[Found]) -> str:
    """The page of the documentation."""

    def digits(one: Found) -> int:
        return 1 if one.case.source.shape[1] == 2 else 2

    rows = "\n".join(
        f"| {one.case.name} | {one.case.left_out} | "
        + " | ".join(f"{one.error[method]:.{digits(one)}f}" for method in METHODS)
        + f" | {one.ratio:.2f} | {one.chosen} |"
        for one in found
    )
    flat = [one for one in found if one.case.source.shape[1] == 2]
    medians = " | ".join(f"**{np.median([one.error[m] for one in flat]):.1f}**" for m in METHODS)
    return _PAGE.format(
        methods=" | ".join(METHODS),
        bars="---:|" * len(METHODS),
        rows=rows,
        medians=medians,
        median=np.median([one.ratio for one in found]),
        verdict=_verdict(found),
    )


def main(arguments: list[str]) -> int:
    found = errors()
    if len(arguments) == 2:
        found += errors(landmarks(*arguments))
    print(page(found), end="")
    return 0

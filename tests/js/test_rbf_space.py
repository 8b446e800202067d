"""The fit of points in space in the browser is the fit of the package, also at the nodes of a lattice."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

import numpy as np
import pytest
from js.test_rbf import CLOSE, PAIRS, as_json, fit_in_python, with_choice, with_radii
from scripts import run_script

from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid

FILES = ("maths/rbf.ts",)
LATTICE = Grid((5, 6, 7), (60.0, 75.0, 110.0), (-30.0, 12.0, -44.0))  # another spacing along each axis

MAIN = """(cases) => cases.map(({ points, settings, lattice }) => {
  try {
    const fit = rbfFit(points, settings, 3);
    return { values: Array.from(rbfOnLattice(fit, lattice)), notes: fit.notes, ids: fit.ids, trend: fit.trend,
      support: fit.support, count: fit.count };
  } catch (error) {
    if (!(error instanceof RbfError)) throw error;
    return { error: error.message };
  }
})"""


def scattered(n: int = 15, size: float = 14.0) -> ControlPoints:
    """n points in a box of 400 x 400 x 400, none next to another, dragged by about ``size``."""
    rng = np.random.default_rng(3)
    lattice = np.stack(np.meshgrid(*[np.linspace(40, 420, 3)] * 3), axis=-1).reshape(-1, 3)[rng.permutation(27)[:n]]
    source = lattice + rng.uniform(-30, 30, lattice.shape)
    return ControlPoints.from_arrays(
        source, source + rng.normal(0, size, source.shape), weight=rng.uniform(0.5, 3, len(source))
    )


def flat(n: int = 9, off: float = 0.0) -> ControlPoints:
    """Points of a plane that lies aslant, dragged out of it."""
    rng = np.random.default_rng(5)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    source = np.concatenate([rng.uniform(0, 300, (n, 2)), rng.uniform(-off, off, (n, 1))], axis=1) @ frame + 100
    return ControlPoints.from_arrays(source, source + rng.normal(0, 8, source.shape))


def row(turned: bool = False, off: float = 0.0) -> ControlPoints:
    rng = np.random.default_rng(6)
    source = np.outer(np.arange(5.0), [30.0, 40.0, 15.0]) + rng.uniform(-off, off, (5, 3))
    target = source @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]) if turned else source + rng.normal(0, 4, (5, 3))
    return ControlPoints.from_arrays(source, target)


def cases() -> dict[str, tuple[ControlPoints, dict[str, Any]]]:
    found: dict[str, tuple[ControlPoints, dict[str, Any]]] = {}
    sets = {
        "": scattered(),
        "-flat": flat(),
        "-nearly flat": flat(off=12.0),
        "-row": row(),
        "-turned": row(True),
        "-nearly a row": row(off=5.0),
        "-two": row().take([0, 3]),
        "-three": row(off=20.0).take([0, 2, 4]),
        "-four": scattered().take([0, 4, 7, 9]),
        "-few": scattered().take(range(7)),
    }
    for kernel, trend in PAIRS:
        both = {"kernel": kernel, "trend": trend}
        found |= {f"{kernel}-{trend}{name}": (points, both) for name, points in sets.items()}
        found[f"{kernel}-{trend}-one"] = (row().take([2]), {**both, "support": 100.0})
        found[f"{kernel}-{trend}-smooth"] = (scattered(), {**both, "smoothing": 0.3, "support": 260.0})
        if KERNELS[kernel].order == 0:
            found[f"{kernel}-{trend}-radii"] = (with_radii(scattered()), {**both, "support": 260.0})
    some = scattered()
    same = np.full((4, 3), 9.0)
    found |= {
        "none": (ControlPoints.empty(3), {}),
        "at rest": (some.reset(), {}),
        "some off": (some.edit(3, active=False).edit(7, active=False), {}),
        "merged": (some.add(some.source[2], some.target[2], name="twin"), {}),
        "conflict": (some.add(some.source[2] + 5, some.target[2], name="other"), {}),
        "one source": (ControlPoints.from_arrays(same, some.target[:4]), {"trend": "similarity"}),
        "one target": (ControlPoints.from_arrays(same, same - 4), {}),
        "mirrored": (ControlPoints.from_arrays(some.source, some.source * [1, 1, -1]), {"trend": "rigid"}),
        "half a turn of a row": (ControlPoints.from_arrays(row().source, row().source[::-1]), {}),
        "crossing": (some.move(some.ids[0], some.target[1] + 3).move(some.ids[1], some.target[0] - 3), {}),
        "torn": (ControlPoints.from_arrays(some.source[[0, 0, 1, 2, 3]], some.target[:5]), {}),
        "many": (ControlPoints.from_arrays(*np.random.default_rng(0).uniform(0, 400, (2, 150, 3))), {}),
        "lone without trend": (row().take([1]), {"trend": "none"}),
        "too flat": (some, {"kernel": "gaussian", "support": 1e5}),
        "needs a trend": (some, {"kernel": "cubic", "trend": "rigid"}),
    }
    return found


@cache
def answers() -> dict[str, dict[str, Any]]:
    given = cases()
    lattice = {"shape": LATTICE.shape[::-1], "spacing": LATTICE.spacing, "origin": LATTICE.origin}
    asked = [
        {"points": as_json(points), "settings": with_choice(points, settings), "lattice": lattice}
        for points, settings in given.values()
    ]
    return dict(zip(given, run_script(FILES, MAIN, json.loads(json.dumps(asked))), strict=True))


@pytest.mark.parametrize("name", list(cases()))
def test_the_browser_fits_points_in_space_as_the_package_does(name: str) -> None:
    points, settings = cases()[name]
    answer = answers()[name]
    fit = fit_in_python(answer, points, settings)
    if fit is None:
        return
    index = np.moveaxis(np.indices(LATTICE.shape)[::-1], 0, -1)
    oracle = fit.displacement(LATTICE.index_to_point(index))
    # The page keeps float32 of what it has computed in float64.
    values = np.array(answer["values"]).reshape(oracle.shape)
    assert np.abs(values - oracle).max() < CLOSE * max(1, np.abs(oracle).max())
    if fit.count:
        assert answer["support"] == pytest.approx(fit.support, rel=1e-12)

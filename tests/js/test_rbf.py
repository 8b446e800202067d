"""The fit in the browser is the fit of the package: same displacements, same remarks, same refusals."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scripts import run_script

from deformnb.errors import DeformError
from deformnb.rbf.conditioning import box_diagonal
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.support import choose_support, usual_support
from deformnb.rbf.trends import TRENDS
from deformnb.volume.plane import Raster

FILES = ("maths/rbf.ts",)
# The promise is 1e-3 of a pixel; both sides solve the same system in float64, with condition numbers up to 1e6 (the
# Gaussian), so a thousandth of a thousandth of that is what rounding may do.
CLOSE = 1e-7
RASTER = Raster((9, 11), (50.0, 55.0), (-30.0, 12.0))
PAIRS = [(k, t) for k in KERNELS for t in TRENDS if TRENDS[t].order >= KERNELS[k].order]

MAIN = """(cases) => cases.map(({ points, settings, raster, places }) => {
  try {
    const fit = rbfFit(points, settings);
    return { map: Array.from(rbfOnRaster(fit, raster, new Float64Array(raster.shape[0] * raster.shape[1] * 2))),
      at: places.map(([a, b]) => rbfAt(fit, a, b)), jacobian: places.map(([a, b]) => rbfJacobianAt(fit, a, b)),
      notes: fit.notes, ids: fit.ids, trend: fit.trend, support: fit.support, count: fit.count };
  } catch (error) {
    if (!(error instanceof RbfError)) throw error;
    return { error: error.message };
  }
})"""


def as_json(points: ControlPoints) -> list[dict[str, Any]]:
    return [
        {
            "id": points.ids[k],
            "name": points.names[k],
            "source": points.source[k].tolist(),
            "target": points.target[k].tolist(),
            "active": bool(points.active[k]),
            "weight": float(points.weight[k]),
            "locked": bool(points.locked[k]),
            "radius": None if np.isnan(points.radius[k]) else float(points.radius[k]),
        }
        for k in range(len(points))
    ]


def scattered(n: int = 12, size: float = 14.0, seed: int = 1) -> ControlPoints:
    """n points on a picture of 500 x 450, none next to another, dragged by about ``size``."""
    rng = np.random.default_rng(seed)
    lattice = np.stack(np.meshgrid(np.linspace(40, 460, 4), np.linspace(40, 400, 3)), axis=-1).reshape(-1, 2)[:n]
    source = lattice + rng.uniform(-30, 30, lattice.shape)
    return ControlPoints.from_arrays(
        source, source + rng.normal(0, size, source.shape), weight=rng.uniform(0.5, 3, len(source))
    )


def with_radii(points: ControlPoints, low: float = 60.0, high: float = 240.0) -> ControlPoints:
    """Two of three points with a radius of their own."""
    radius = np.random.default_rng(5).uniform(low, high, len(points))
    radius[::3] = np.nan
    return replace(points, radius=radius)


def shifted(points: ControlPoints, by: list[float]) -> ControlPoints:
    return ControlPoints.from_arrays(points.source + by, points.target + by)


def cases() -> dict[str, tuple[ControlPoints, dict[str, Any]]]:
    some, line = scattered(), np.outer(np.arange(4.0), [30.0, 40.0])
    bent = line + np.array([[0, 0], [5, 2], [3, 9], [0, 0]])
    turned = line @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    found: dict[str, tuple[ControlPoints, dict[str, Any]]] = {}
    for kernel, trend in PAIRS:
        both = {"kernel": kernel, "trend": trend}
        found[f"{kernel}-{trend}"] = (some, both)
        found[f"{kernel}-{trend}-smooth"] = (some, {**both, "smoothing": 0.3, "support": 260.0})
        found[f"{kernel}-{trend}-line"] = (ControlPoints.from_arrays(line, bent), both)
        found[f"{kernel}-{trend}-turned"] = (ControlPoints.from_arrays(line, turned), both)
        found[f"{kernel}-{trend}-one"] = (ControlPoints.from_arrays([[5, 6]], [[7, 9]]), {**both, "support": 100.0})
        found[f"{kernel}-{trend}-two"] = (ControlPoints.from_arrays([[5, 6], [90, 70]], [[7, 9], [70, 90]]), both)
    for kernel, trend in (pair for pair in PAIRS if KERNELS[pair[0]].order == 0):
        both = {"kernel": kernel, "trend": trend}
        found[f"{kernel}-{trend}-radii"] = (with_radii(some), {**both, "support": 200.0})
        found[f"{kernel}-{trend}-radii-smooth"] = (with_radii(some), {**both, "smoothing": 0.3, "support": 260.0})
        found[f"{kernel}-{trend}-radii-line"] = (with_radii(ControlPoints.from_arrays(line, bent), 40.0, 90.0), both)
        found[f"{kernel}-{trend}-radii-one"] = (
            ControlPoints.from_arrays([[5, 6]], [[7, 9]], radius=[40.0]),
            {**both, "support": 100.0},
        )
    off = some.edit(3, active=False).edit(7, active=False)
    same = some.add(some.source[2], some.target[2], name="twin")
    crossing = ControlPoints.from_arrays([[0, 0], [100, 0], [0, 90], [100, 90]], [[100, 0], [0, 0], [0, 90], [100, 90]])
    corners = [[0, 0], [500, 0], [500, 195], [0, 195]]
    piled = ControlPoints.from_arrays(
        [*corners, [145, 98], [254, 98], [361, 98]], [*corners, [259, 98], [254, 98], [361, 98]]
    )
    nearly = ControlPoints.from_arrays(
        [[0, 0], [100, 0.01], [200, 0], [300, 0.1]], [[0, 0], [100, 9], [200, 40], [300, 90]]
    )
    found |= {
        "none": (ControlPoints.empty(), {}),
        "all switched off": (some.edit(0, active=False).take([0]), {}),
        "at rest": (some.reset(), {}),
        "some off": (off, {}),
        "merged": (same, {}),
        "radii of a kernel without end": (with_radii(some), {"kernel": "thin_plate"}),
        "radii switched off": (
            replace(some, radius=np.where(np.arange(12) == 3, 50.0, np.nan)).edit(3, active=False),
            {"kernel": "thin_plate"},
        ),
        "radii that are all alike": (replace(some, radius=np.full(12, 80.0)), {}),
        "radii and merged": (with_radii(same.edit(12, radius=33.0)), {}),
        "radii at rest": (with_radii(some.reset()), {}),
        "radii that do not go together": (
            ControlPoints.from_arrays([[0, 0], [1, 0], [0, 90]], [[0, 9], [1, -9], [0, 90]], radius=[1e6, 2e6, 3e6]),
            {"kernel": "wendland_c4"},
        ),
        "merged with smoothing": (some.add(some.source[2], some.target[2] + 0.0), {"smoothing": 1.0}),
        "far away": (shifted(some, [1e6, -1e6]), {}),
        "crossing": (crossing, {}),
        "piled": (piled, {}),
        "nearly a line": (nearly, {}),
        "one source": (ControlPoints.from_arrays(np.full((4, 2), 9.0), some.target[:4]), {"trend": "similarity"}),
        "one source rigid": (ControlPoints.from_arrays(np.full((4, 2), 9.0), some.target[:4]), {"trend": "rigid"}),
        "one target": (ControlPoints.from_arrays([[9, 9]] * 3, [[4, 5]] * 3), {}),
        "many": (ControlPoints.from_arrays(np.random.default_rng(0).uniform(0, 500, (150, 2))), {}),
        "lone without trend": (ControlPoints.from_arrays([[5, 6]], [[7, 9]]), {"trend": "none"}),
        "unknown kernel": (some, {"kernel": "toString"}),
        "unknown trend": (some, {"trend": "x"}),
        "needs a trend": (some, {"kernel": "cubic", "trend": "rigid"}),
        "too flat": (some, {"kernel": "gaussian", "support": 1e5}),
        "negative smoothing": (some, {"smoothing": -0.5}),
        "support zero": (some, {"support": -0.5}),
        "conflict": (some.add(some.source[2] + 5, some.target[2], name="other"), {}),
    }
    return found


def with_choice(points: ControlPoints, settings: dict[str, Any]) -> dict[str, Any]:
    """The settings with the support that Python chooses, as an editor sends them."""
    if "support" in settings:
        return settings
    kernel, trend = settings.get("kernel", "wendland_c2"), settings.get("trend", "affine")
    if kernel not in KERNELS or trend not in TRENDS or TRENDS[trend].order < KERNELS[kernel].order:
        return settings
    radius = choose_support([points], kernel=kernel, trend=trend, smoothing=max(0.0, settings.get("smoothing", 0.0)))
    return settings if radius is None else {**settings, "chosen_support": radius}


@cache
def answers() -> dict[str, dict[str, Any]]:
    given = cases()
    raster = {"shape": RASTER.shape, "spacing": RASTER.spacing, "origin": RASTER.origin}
    asked = [
        {
            "points": as_json(points),
            "settings": with_choice(points, settings),
            "raster": raster,
            "places": [*points.target[:3].tolist(), [33.0, 44.0], [-300.0, 900.0]],
        }
        for points, settings in given.values()
    ]
    return dict(zip(given, run_script(FILES, MAIN, json.loads(json.dumps(asked))), strict=True))


def fit_in_python(answer: dict[str, Any], points: ControlPoints, settings: dict[str, Any]) -> Any:
    """The package's fit, None where both refuse the points for one reason; with the notes of the browser's."""
    if "error" in answer:
        with pytest.raises(DeformError) as caught:
            fit_rbf(points, **settings)
        assert refusal(answer["error"]) == refusal(str(caught.value))
        return None
    fit = fit_rbf(points, **settings)
    assert (tuple(answer["notes"]), tuple(answer["ids"]), answer["trend"]) == (fit.remarks, fit.ids, fit.trend)
    assert answer["count"] == fit.count
    return fit


@pytest.mark.parametrize("name", list(cases()))
def test_the_browser_fits_as_the_package_does(name: str) -> None:
    points, settings = cases()[name]
    answer = answers()[name]
    fit = fit_in_python(answer, points, settings)
    if fit is None:
        return
    places = np.concatenate([points.target[:3], [[33.0, 44.0], [-300.0, 900.0]]])
    assert np.abs(np.array(answer["at"]) - fit.displacement(places)).max() < CLOSE
    oracle = fit.displacement(RASTER.points())
    assert np.abs(np.array(answer["map"]).reshape(oracle.shape) - oracle).max() < CLOSE
    if fit.count:
        assert answer["support"] == pytest.approx(fit.support, rel=1e-12)


def refusal(message: str) -> str:
    """A refusal without the digits of its numbers and the quotes of names."""
    return message.replace('"', "'").replace("100000", "1e+05")


@pytest.mark.parametrize(("kernel", "trend"), PAIRS)
def test_the_jacobian_in_the_browser_is_that_of_the_package(kernel: str, trend: str) -> None:
    name = f"{kernel}-{trend}"
    points, settings = cases()[name]
    fit: AbstractField = fit_rbf(points, **settings)
    # Not at the points themselves, where a kernel with a kink has no slope and the two round to different sides.
    oracle = fit.jacobian(np.array([[33.0, 44.0], [-300.0, 900.0]]))
    assert np.abs(np.array(answers()[name]["jacobian"][3:]) - oracle).max() < 1e-9


@pytest.mark.parametrize("name", [name for name in cases() if name.endswith("-radii")])
def test_so_is_the_jacobian_of_points_with_radii_of_their_own(name: str) -> None:
    points, settings = cases()[name]
    oracle = fit_rbf(points, **settings).jacobian(np.array([[33.0, 44.0], [-300.0, 900.0]]))
    assert np.abs(np.array(answers()[name]["jacobian"][3:]) - oracle).max() < 1e-9


def test_the_registries_are_alike() -> None:
    names = run_script(
        FILES,
        """() => [RBF_KERNELS, RBF_TRENDS].map(
        (table) => Object.entries(table).map(([name, row]) => [name, row.title, row.order, row.share ?? 0,
            Number.isFinite(row.gaps) ? row.gaps : 0]))""",
        None,
    )
    kernels = [
        [k, v.title, v.order, v.shares[len(v.shares) // 2], v.gaps if np.isfinite(v.gaps) else 0]
        for k, v in KERNELS.items()
    ]
    assert names == [kernels, [[k, v.title, v.order, 0, 0] for k, v in TRENDS.items()]]


def test_a_page_that_knows_no_choice_takes_the_usual_support() -> None:
    """Of scattered points, of a row, of sources at one place, of none, of many; and the box's diagonal of older
    documents."""
    row = ControlPoints.from_arrays(np.outer(np.arange(9.0), [30.0, 40.0]))
    piled = ControlPoints.from_arrays(np.full((4, 2), 9.0), scattered().target[:4])
    many = np.random.default_rng(3).uniform(0, 300, (1100, 2))
    sets = [
        scattered(),
        row,
        row.take([0, 3]),
        piled,
        ControlPoints.empty(),
        ControlPoints.from_arrays(many),
        ControlPoints.from_arrays(many * [1.0, 1e-3]),
    ]
    main = """({ sets, kernels }) => sets.map((points) => [rbfBoxDiagonal(points),
        ...kernels.map((kernel) => rbfSupport(points, { kernel, lone_support: null }))])"""
    found = run_script(FILES, main, {"sets": [as_json(points) for points in sets], "kernels": list(KERNELS)})
    for points, values in zip(sets, found, strict=True):
        wanted = [box_diagonal(points), *(usual_support(points, kernel) for kernel in KERNELS.values())]
        assert values == [None if w is None else pytest.approx(w, rel=1e-12) for w in wanted]


def test_the_strength_is_that_of_a_step() -> None:
    points = scattered()
    main = """({ points, at }) => {
        const fit = rbfFit(points, { strength: 1.7, support: "box_diagonal" });
        return at.map((p) => rbfAt(fit, ...p));
    }"""
    at = [[33.0, 44.0], [120.0, 310.0]]
    found = run_script(FILES, main, {"points": as_json(points), "at": at})
    oracle = fit_rbf(points.scaled(1.7), support=box_diagonal(points)).displacement(at)
    assert np.abs(np.array(found) - oracle).max() < CLOSE


def test_a_lone_point_reaches_as_far_as_it_is_told() -> None:
    points = ControlPoints.from_arrays([[5, 6]], [[7, 9]])
    main = "(points) => rbfFit(points, { trend: 'none', lone_support: 80 }).support"
    assert run_script(FILES, main, as_json(points)) == 80


def test_coordinates_that_are_no_numbers_are_refused_and_named() -> None:
    main = """(points) => { points[1].target = [1, NaN];
        try { rbfFit(points); return "none"; } catch (error) { return error.message; } }"""
    message = run_script(FILES, main, as_json(scattered(3)))
    assert message.startswith("the target of point 2 is [1,NaN]")


def test_a_turn_that_the_points_leave_open_is_kept() -> None:
    first = ControlPoints.from_arrays([[0, 0], [40, 0], [0, 30]], [[0, 0], [0, 40], [-30, 0]])
    then = ControlPoints.from_arrays([[9, 9]] * 3, [[0, 0], [0, 40], [-30, 0]])
    main = """([first, then]) => { const settings = { trend: "rigid" }, previous = rbfFit(first, settings);
        return rbfAt(rbfFit(then, { ...settings, previous }), 7, 8); }"""
    found = run_script(FILES, main, [as_json(first), as_json(then)])
    oracle = fit_rbf(then, trend="rigid", previous=fit_rbf(first, trend="rigid")).displacement([7.0, 8.0])
    assert np.abs(np.array(found) - oracle).max() < CLOSE

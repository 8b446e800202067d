"""The maps of an editor in its scripts are those of the package: the inverse, folds, slopes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from js.test_rbf import as_json, scattered
from scripts import run_script

from deformnb.rbf.conditioning import box_diagonal
from deformnb.rbf.fitting import fit_rbf, fit_rigid
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.warping.points import warp_points

BOX = [0.0, 500.0, 0.0, 450.0]
MAPS = ("maths/rbf.ts", "maths/rigid_stages.ts", "maths/cuts.ts", "maths/warp_map.ts", "maths/folds.ts")


def test_the_inverse_is_that_of_the_package() -> None:
    points = scattered()
    places = np.random.default_rng(2).uniform(0, 400, (40, 2))
    main = """({ points, places }) => { const fit = rbfFit(points, { support: "box_diagonal" });
        return places.map(([a, b]) => {
        const at = new Float64Array([a, b]); return [mapInverse(fit, a, b, at, 1e-9), ...at]; }); }"""
    found = run_script(MAPS, main, {"points": as_json(points), "places": places.tolist()})
    moved, converged = warp_points(places, fit_rbf(points, support=box_diagonal(points)), tolerance=1e-9)
    assert converged.all()
    assert all(row[0] for row in found)
    assert np.abs(np.array(found)[:, 1:] - moved).max() < 1e-7


def folds(points: Any) -> dict[str, float]:
    main = f"(points) => foldsOf(layeredFit(points, {{ support: 'box_diagonal' }}), {BOX}, 33)"
    return dict(run_script(MAPS, main, as_json(points)))


def test_folds_are_those_of_the_jacobian() -> None:
    points = scattered(size=60.0)
    a, b = np.meshgrid(np.linspace(0, 500, 33), np.linspace(0, 450, 33))
    at = np.concatenate([np.stack([a, b], axis=-1).reshape(-1, 2), points.target])
    det = np.linalg.det(np.eye(2) + fit_rbf(points, support=box_diagonal(points)).jacobian(at))
    found = folds(points)
    assert found["least"] <= det.min() + 1e-9  # between the nodes it is less still
    at_place = fit_rbf(points, support=box_diagonal(points)).jacobian(found["place"])
    assert abs(found["least"] - np.linalg.det(np.eye(2) + at_place)) < 1e-9
    assert found["share"] == (det[: 33 * 33] <= 0).mean() > 0
    assert folds(points.reset()) == {"least": 1, "share": 0, "air": 0, "place": [0, 0]}


def test_the_least_determinant_is_found_between_the_nodes() -> None:
    # Two points a fortieth of the picture apart change places: the fold is smaller than a cell.
    corners = [[0, 0], [500, 0], [0, 450], [500, 450]]
    points = ControlPoints.from_arrays([*corners, [231, 217], [243, 217]], [*corners, [243, 217], [231, 217]])
    settings: dict[str, Any] = {"kernel": "wendland_c4", "support": 40.0}
    a, b = np.meshgrid(np.linspace(200, 275, 301), np.linspace(180, 255, 301))
    at = np.stack([a, b], axis=-1)
    det = np.linalg.det(np.eye(2) + fit_rbf(points, **settings).jacobian(at))
    main = f"([points, settings, n]) => foldsOf(layeredFit(points, settings), {BOX}, n)"
    for nodes in (9, 17, 33):
        found = run_script(MAPS, main, [as_json(points), settings, nodes])
        assert found["least"] == pytest.approx(det.min(), rel=0.01)
        assert np.abs(np.subtract(found["place"], at[np.unravel_index(det.argmin(), det.shape)])).max() < 8


def test_what_folds_is_outlined_where_the_determinant_is_zero() -> None:
    points = scattered(size=60.0)
    fit = fit_rbf(points, support=box_diagonal(points))
    main = """(points) => { const layered = layeredFit(points, { support: "box_diagonal" });
        const raster = { shape: [46, 51], spacing: [10, 10], origin: [0, 0] };
        const dets = detsOnRaster(layered, raster), probes = probesOf(layered);
        return [Array.from(dets), foldPieces(detMapOf(layered), raster, dets, probes, 1e7)]; }"""
    dets, pieces = run_script(MAPS, main, as_json(points))
    a, b = np.meshgrid(np.arange(51) * 10.0, np.arange(46) * 10.0)
    oracle = np.linalg.det(np.eye(2) + fit.jacobian(np.stack([a, b], axis=-1)))
    assert np.abs(np.reshape(dets, oracle.shape) - oracle).max() < 1e-9
    ends = np.array(pieces["edge"]).reshape(-1, 2)
    slope = np.abs(np.linalg.det(np.eye(2) + fit.jacobian(ends)))
    assert len(ends) > 40
    assert slope.max() < 0.02  # of a second order in a quarter of a cell
    fine_a, fine_b = np.meshgrid(np.arange(0, 500, 2.0), np.arange(0, 450, 2.0))
    det = np.linalg.det(np.eye(2) + fit.jacobian(np.stack([fine_a, fine_b], axis=-1)))
    assert sum(area(piece) for piece in pieces["fill"]) == pytest.approx(4 * (det <= 0).sum(), rel=0.03)


def area(polygon: list[float]) -> float:
    """By the shoelace formula."""
    x, y = np.reshape(polygon, (-1, 2)).T
    return float(abs(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2)


def test_the_grid_breaks_where_the_map_folds_and_covers_the_box_where_it_does_not() -> None:
    main = f"""(points) => deformedGrid(layeredFit(points, {{ support: 'box_diagonal' }}), {BOX}, 8, 4, 1e-6)
        .map((line) => line.runs.map((run) => Array.from(run)))"""
    whole = run_script(MAPS, main, as_json(scattered()))
    assert [len(runs) for runs in whole] == [1] * (9 + 8)  # 500 x 450 with cells of 62.5: 8 across, 7 down
    fit = fit_rbf(scattered(), support=box_diagonal(scattered()))
    for k, (run,) in enumerate(whole[:9]):
        line = np.array(run).reshape(-1, 2)
        back = line + fit.displacement(line)
        assert np.abs(back[:, 0] - 62.5 * k).max() < 1e-5
        assert np.abs(back[[0, -1], 1] - [0, 450]).max() < 1e-5
    folded = run_script(MAPS, main, as_json(scattered(size=60.0)))
    assert all(np.isfinite(run).all() for runs in folded for run in runs)


def test_the_slope_beside_rigid_parts_is_that_of_the_package() -> None:
    points, region = scattered(), Polygon([(200, 150), (330, 160), (320, 260), (210, 250)])
    part = RigidPart(region, RigidMotion.turn(12, (260, 200), (3, 1)))
    points = points.take(np.flatnonzero(region.signed_distance(points.target) > 25))
    data = {
        "region": {"kind": "polygon", "vertices": region.vertices},
        "weight": "saturated",
        "motion": {"matrix": part.motion.matrix, "shift": part.motion.shift},
    }  # type: ignore[union-attr]
    at = np.random.default_rng(4).uniform(50, 400, (60, 2))
    main = """({ points, part, at }) => {
        const fit = layeredFit(points, { support: "box_diagonal", parts: [part] }).fits[0].fit;
        return at.map(([a, b]) => Array.from(fieldWithSlope(fit, a, b, new Float64Array(6)))); }"""
    found = np.array(run_script(MAPS, main, {"points": as_json(points), "part": data, "at": at.tolist()}))
    fit = fit_rigid(points, [part], support=box_diagonal(points))
    assert np.abs(found[:, :2] - at - fit.displacement(at)).max() < 1e-9
    assert np.abs(found[:, 2:].reshape(-1, 2, 2) - np.eye(2) - fit.jacobian(at)).max() < 1e-3

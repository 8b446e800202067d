"""Fits forward in the browser are those of the package: maps, slopes, determinants, inverses, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from js.test_editor import MAPS
from js.test_rbf import CLOSE, as_json, refusal, scattered, with_radii
from js.test_regions import CUTS, FIXED, pulled, region_data
from js.test_stages import AT, RASTER, answer
from rbf.test_forward import folded
from scripts import run_script

from deformnb.analysis.folds import jacobian_determinant
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import box_diagonal
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.fitting import fit_forward
from deformnb.rbf.forward import orient_points
from deformnb.rbf.interpolant import FOLDS_WARNING, POOR
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidPart
from deformnb.warping.points import warp_points

POINTS = scattered(size=12.0)
CASES: dict[str, tuple[ControlPoints, dict[str, Any], list[RigidPart]]] = {
    "plain": (POINTS, {}, []),
    "thin plate": (POINTS, {"kernel": "thin_plate"}, []),
    "quadratic": (POINTS, {"trend": "quadratic", "kernel": "cubic"}, []),
    "smooth": (POINTS, {"smoothing": 0.3}, []),
    "strong": (POINTS, {"strength": 1.4}, []),
    "backwards": (POINTS, {"strength": -0.5, "kernel": "thin_plate"}, []),
    "stages": (scattered(size=45.0), {"stages": 4}, []),
    "radii": (with_radii(POINTS), {"support": 200.0}, []),
    "at rest": (POINTS.reset(), {}, []),
    "none": (ControlPoints.empty(), {}, []),
    "one": (ControlPoints.from_arrays([[5, 5]], [[9, 8]]), {"support": 90.0, "trend": "none"}, []),
    "beside a part": (POINTS, {}, [FIXED]),
    "sideways": (POINTS, {"direction": "sideways"}, []),
}


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", list(CASES))
def test_fits_forward_in_the_browser_are_those_of_the_package(name: str) -> None:
    points, given, parts = CASES[name]
    settings = {"direction": "forward", **given}
    size = box_diagonal(orient_points(points, "forward"))
    found = answer(points, {"support": size, **settings}, parts)
    if "error" in found:
        with pytest.raises(DeformError) as caught:
            FitSettings(support=size, **settings).fit(points, parts)
        assert refusal(found["error"]) == refusal(str(caught.value))
        return
    fit = FitSettings(**{"support": size, **settings}).fit(points)
    expected, where = fit.displacement(AT), RASTER.points()
    assert np.abs(np.array(found["at"]) - expected).max() < CLOSE
    # Rows are followed from pixel to pixel; one is 50 wide, and nobody sees a ten-thousandth of it.
    assert np.abs(np.array(found["map"]).reshape(9, 11, 2) - fit.displacement(where)).max() < 5e-3
    slope = np.array(found["slope"])
    assert np.abs(slope[:, :2] - AT - expected).max() < CLOSE
    assert np.abs(slope[:, 2:].reshape(-1, 2, 2) - np.eye(2) - fit.jacobian(AT)).max() < 1e-7
    assert np.abs(np.array(found["dets"]).reshape(9, 11) - jacobian_determinant(fit, where)).max() < 1e-6
    assert sorted(set(found["notes"])) == sorted(set(fit.notes) - {FOLDS_WARNING, POOR})


def test_refusals_are_among_the_cases() -> None:
    names = [
        name
        for name, (points, given, parts) in CASES.items()
        if "error" in answer(points, {"direction": "forward", **given}, parts)
    ]
    assert names == ["beside a part", "sideways"]


def test_a_fine_raster_is_filled_by_following_its_rows() -> None:
    fit = fit_forward(POINTS, kernel="thin_plate")
    raster = {"shape": [70, 90], "spacing": [6.0, 6.5], "origin": [-20.0, 10.0]}
    main = """({ points, raster }) => Array.from(fieldOnRaster(stagedFit(points, [], { kernel: "thin_plate",
        direction: "forward" }), raster, new Float32Array(2 * 70 * 90)))"""
    found = np.array(run_script(MAPS, main, {"points": as_json(POINTS), "raster": raster})).reshape(70, 90, 2)
    b, a = np.meshgrid(10 + 6.5 * np.arange(70), -20 + 6.0 * np.arange(90), indexing="ij")
    # A pixel is 6 wide; what is drawn may be a thousandth of one off.
    assert np.abs(found - fit.displacement(np.stack([a, b], axis=-1))).max() < 6e-3


def test_places_go_forward_and_back() -> None:
    fit = fit_forward(POINTS, kernel="thin_plate")
    main = """({ points, at }) => { const fit = stagedFit(points, [], { kernel: "thin_plate", direction: "forward" });
        return at.map(([a, b]) => { const y = new Float64Array([a, b]), work = new Float64Array(6);
          return [mapInverse(fit, a, b, y, 1e-9, work), ...y, ...work]; }); }"""
    found = np.array(run_script(MAPS, main, {"points": as_json(POINTS), "at": AT.tolist()}))
    places, is_found = warp_points(AT, fit)
    assert found[:, 0].all()
    assert is_found.all()
    assert np.abs(found[:, 1:3] - places).max() < 1e-8
    assert np.abs(found[:, 3:5] - AT).max() < 1e-7


def test_a_fold_has_no_source_in_the_browser_either() -> None:
    points, places, is_found = folded()
    main = """({ points, at }) => { const work = new Float64Array(6), fit = stagedFit(points, [], { kernel: "cubic",
        trend: "quadratic", direction: "forward" });
        return at.map(([a, b]) => {
          fieldWithSlope(fit, a, b, work);
          return work[2] * work[5] - work[3] * work[4]; }); }"""
    dets = np.array(run_script(MAPS, main, {"points": as_json(points), "at": places.tolist()}))
    assert ((dets == 0) == ~is_found).all()


@pytest.mark.parametrize("name", ["a line", "two"])
def test_every_region_has_a_fit_of_its_own(name: str) -> None:
    points, regions = pulled(), CUTS[name]
    settings = {"cuts": [{"region": region_data(r)} for r in regions], "direction": "forward", "support": 300.0}
    main = """({ points, settings, at }) => { const layered = layeredFit(points, settings);
        return at.map(([a, b]) => placeOf(layered, a, b, 6).slice()); }"""
    found = np.array(run_script(MAPS, main, {"points": as_json(points), "settings": settings, "at": AT.tolist()}))
    field = FitSettings(support=300.0, direction="forward").fit(points, cuts=regions, softness=6.0)
    moves, opacity = field.displacement_and_opacity(AT)
    assert np.abs(found[:, :2] - moves)[opacity > 1e-6].max() < CLOSE


def test_a_fit_in_space_is_that_of_the_package() -> None:
    rng = np.random.default_rng(3)
    source = rng.uniform(0, 100, (20, 3))
    points = ControlPoints.from_arrays(source, source + rng.normal(0, 4, source.shape))
    lattice = {"shape": [14, 6, 5], "spacing": [7.0, 15.0, 20.0], "origin": [3.0, 2.0, 1.0]}
    main = """({ points, lattice, settings }) => Array.from(forwardOnLattice(forwardFit(points, settings, 3).forward,
        lattice))"""
    for settings in ({"kernel": "linear"}, {"kernel": "cubic", "trend": "quadratic"}):
        given = {"points": as_json(points), "lattice": lattice, "settings": settings}
        found = np.array(run_script((*MAPS, "maths/forward_fit.ts"), main, given)).reshape(5, 6, 14, 3)
        z, y, x = np.meshgrid(1 + 20.0 * np.arange(5), 2 + 15.0 * np.arange(6), 3 + 7.0 * np.arange(14), indexing="ij")
        expected = fit_forward(points, **settings).displacement(np.stack([x, y, z], axis=-1))
        assert np.abs(found - expected).max() < 7e-3  # a thousandth of the distance of nodes

"""Fits in stages in the browser are those of the package: maps, slopes, determinants, inverses, refusals."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from js.test_editor import MAPS
from js.test_rbf import CLOSE, as_json, refusal, scattered, with_radii
from js.test_regions import CUTS, FIXED, TURNED, part_data, pulled, region_data
from numpy.typing import NDArray
from scripts import run_script

from deformnb.analysis.folds import jacobian_determinant
from deformnb.errors import DeformError
from deformnb.rbf.conditioning import box_diagonal
from deformnb.rbf.cuts import CUT_RULES, Decoupled
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.fitting import fit_points
from deformnb.rbf.interpolant import FOLDS_WARNING, POOR
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidPart
from deformnb.rbf.stages import MOST_STAGES
from deformnb.volume.plane import Raster
from deformnb.warping.points import warp_points

RASTER = Raster((9, 11), (50.0, 55.0), (-30.0, 12.0))
AT = np.random.default_rng(4).uniform(-50, 550, (60, 2))
BOX = [0.0, 500.0, 0.0, 450.0]

MAIN = """({ points, settings, parts, raster, at }) => {
  try {
    const fit = stagedFit(points, parts, settings), work = new Float64Array(6), layered = layeredFit(points, {
      ...settings, parts });
    return { at: at.map((p) => fieldAt(fit, ...p)), notes: fit.notes,
      map: Array.from(fieldOnRaster(fit, raster, new Float64Array(raster.shape[0] * raster.shape[1] * 2))),
      slope: at.map((p) => Array.from(fieldWithSlope(fit, ...p, work))),
      dets: Array.from(detsOnRaster(layered, raster)) };
  } catch (error) {
    if (!(error instanceof RbfError)) throw error;
    return { error: error.message };
  }
}"""


def answer(points: ControlPoints, settings: dict[str, Any], parts: list[RigidPart]) -> dict[str, Any]:
    raster = {"shape": RASTER.shape, "spacing": RASTER.spacing, "origin": RASTER.origin}
    given = {"support": "box_diagonal", **settings}
    return dict(
        run_script(
            MAPS,
            MAIN,
            {
                "points": as_json(points),
                "settings": given,
                "raster": raster,
                "at": AT.tolist(),
                "parts": [part_data(part) for part in parts],
            },
        )
    )


def far() -> ControlPoints:
    """Points that are taken so far that one fit folds."""
    return scattered(size=45.0)


ASIDE = np.array([150.0, 0.0])  # away from the part
CASES: dict[str, tuple[ControlPoints, dict[str, Any], list[RigidPart]]] = {
    "two": (far(), {"stages": 2}, []),
    "eight": (far(), {"stages": 8}, []),
    "all": (scattered(6, 30.0), {"stages": MOST_STAGES}, []),
    "one": (far(), {"stages": 1}, []),
    "thin plate": (far(), {"stages": 4, "kernel": "thin_plate"}, []),
    "similar": (far(), {"stages": 3, "trend": "similarity", "kernel": "gaussian", "support": 150.0}, []),
    "smooth": (far(), {"stages": 3, "smoothing": 0.4}, []),
    "at rest": (far().reset(), {"stages": 4}, []),
    "none": (ControlPoints.empty(), {"stages": 4}, []),
    "some off": (far().edit(3, active=False), {"stages": 4}, []),
    "strong": (far(), {"stages": 4, "strength": 1.3}, []),
    "backwards": (far(), {"stages": 4, "strength": -0.5}, []),
    "radii": (with_radii(far()), {"stages": 4, "support": 200.0}, []),
    "held": (replace(far(), source=far().source + ASIDE, target=far().target + ASIDE), {"stages": 4}, [FIXED]),
    "a turned part": (far(), {"stages": 2}, [TURNED]),
    "through one another": (
        ControlPoints.from_arrays([[0, 0], [100, 0], [0, 90]], [[100, 0], [0, 0], [0, 90]]),
        {"stages": 2},
        [],
    ),
    "too many": (far(), {"stages": 65}, []),
    "none at all": (far(), {"stages": 0}, []),
}


def oracle(points: ControlPoints, settings: dict[str, Any], parts: list[RigidPart]) -> Any:
    given = {"support": box_diagonal(points), **settings}
    strength = given.pop("strength", 1.0)
    return fit_points(points if strength == 1 else points.scaled(strength), parts, **given)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", list(CASES))
def test_stages_in_the_browser_are_those_of_the_package(name: str) -> None:
    found = answer(*CASES[name])
    if "error" in found:
        with pytest.raises(DeformError) as caught:
            oracle(*CASES[name])
        assert refusal(found["error"]) == refusal(str(caught.value))
        return
    fit = oracle(*CASES[name])
    expected = fit.displacement(AT)
    assert np.abs(np.array(found["at"]) - expected).max() < CLOSE
    assert np.abs(np.array(found["map"]).reshape(9, 11, 2) - fit.displacement(RASTER.points())).max() < CLOSE
    slope = np.array(found["slope"])
    assert np.abs(slope[:, :2] - AT - expected).max() < CLOSE
    matrix = np.eye(2) + fit.jacobian(AT)
    rough = 1e-4 if CASES[name][2] else 1e-8  # what rigid parts do is differenced in the page
    assert np.abs(slope[:, 2:].reshape(-1, 2, 2) - matrix).max() < rough
    dets = jacobian_determinant(fit, RASTER.points())
    assert np.abs(np.array(found["dets"]).reshape(9, 11) - dets).max() < 10 * rough
    assert sorted(set(found["notes"])) == sorted(
        set(fit.notes) - {FOLDS_WARNING, POOR}
    )  # the page has a map of its folds


def test_refusals_are_among_the_cases() -> None:
    names = [name for name in CASES if "error" in answer(*CASES[name])]
    assert names == ["a turned part", "through one another", "too many", "none at all"]


@pytest.mark.parametrize("rule", list(CUT_RULES))
@pytest.mark.parametrize("name", ["a line", "two"])
def test_every_region_has_stages_of_its_own(name: str, rule: str) -> None:
    points, regions = pulled(), CUTS[name]
    settings = {
        "cuts": [{"region": region_data(r)} for r in regions],
        "cut_rule": rule,
        "stages": 4,
        "support": "box_diagonal",
    }
    main = """({ points, settings, at }) => { const layered = layeredFit(points, settings);
        return at.map(([a, b]) => placeOf(layered, a, b, 6).slice()); }"""
    found = np.array(run_script(MAPS, main, {"points": as_json(points), "settings": settings, "at": AT.tolist()}))
    fits = FitSettings(support="box_diagonal", stages=4).fits(points, cuts=regions)
    field = Decoupled(tuple(fits.values()), tuple(fits), tuple(regions), rule=rule, softness=6.0)
    moves, opacity = field.displacement_and_opacity(AT)
    assert np.abs(found[:, :2] - moves)[opacity > 1e-6].max() < CLOSE
    assert np.abs(found[:, 2] - opacity).max() < 1e-6


def test_stages_are_undone_one_after_the_other() -> None:
    points = far()
    fit = fit_points(points, stages=8, support=box_diagonal(points))
    main = """({ points, at }) => { const fit = stagedFit(points, [], { stages: 8, support: "box_diagonal" });
        return at.map(([a, b]) => { const y = new Float64Array([a, b]);
          return [mapInverse(fit, a, b, y, 1e-9), ...y]; }); }"""
    found = np.array(run_script(MAPS, main, {"points": as_json(points), "at": AT.tolist()}))
    assert found[:, 0].all()
    back = found[:, 1:] + fit.displacement(found[:, 1:])
    assert np.abs(back - AT).max() < 1e-8
    assert np.abs(found[:, 1:] - warp_points(AT, fit, tolerance=1e-9)[0]).max() < 1e-6


def folds(points: ControlPoints, stages: int) -> dict[str, Any]:
    main = f"([points, stages]) => foldsOf(layeredFit(points, {{ stages, support: 'box_diagonal' }}), {BOX}, 33)"
    return dict(run_script(MAPS, main, [as_json(points), stages]))


def least(fit: Any) -> float:
    a, b = np.meshgrid(np.linspace(0, 500, 101), np.linspace(0, 450, 101))
    det: NDArray[np.float64] = np.linalg.det(np.eye(2) + fit.jacobian(np.stack([a, b], axis=-1)))
    return float(det.min())


def test_enough_stages_unfold_and_the_page_says_so() -> None:
    points = far()
    folded, whole = folds(points, 1), folds(points, 16)
    assert folded["least"] < 0 < folded["share"]
    assert whole["least"] > 0 == whole["share"]
    assert whole["least"] <= least(fit_points(points, stages=16, support=box_diagonal(points))) + 1e-9
    assert folded["least"] <= least(fit_points(points, support=box_diagonal(points))) + 1e-9

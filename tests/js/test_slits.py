"""Cuts that stop inside the body are in the browser those of the package: maps, slopes, what is seen, refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from js.test_editor import MAPS
from js.test_rbf import CLOSE, as_json, refusal
from js.test_regions import part_data, places, pulled
from scripts import run_script

from deformnb.document.json_regions import region_to_data
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Decoupled
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line, Polygon
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Raster

BENT = [(240, 420), (250, 300), (180, 240), (330, 180), (260, 60)]
CUTS: dict[str, list[AbstractRegion]] = {
    "one tip": [Line(BENT, stops=(False, True))],
    "two lines that stop, and a border": [
        Line(BENT[1:3], stops=(True, True)),
        HalfSpace((0, 200), (0, 1)),
        Line([(100, 60), (120, 300)], stops=(True, False)),
    ],
}
RASTER = Raster((5, 7), (70.0, 80.0), (13.0, 21.0))

MAIN = """({ points, settings, at, raster }) => {
  const layered = layeredFit(points, settings), work = new Float64Array(6);
  return { seen: at.map(([a, b]) => placeOf(layered, a, b, 6).slice()), sides: layered.fits.map(({ sides }) => sides),
    slopes: layered.fits.map(({ fit }) => at.map((p) => Array.from(fieldWithSlope(fit, ...p, work)))),
    maps: layersOnRaster(layered, raster).map((map) => Array.from(map)), folds: foldsOf(layered, [0, 500, 0, 450], 9),
    moved: at.map((p) => findVisiblePlace(layered, p, 1e-6)) };
}"""


@pytest.mark.parametrize("name", list(CUTS))
def test_slits_are_those_of_the_package(name: str) -> None:
    parts = [RigidPart(Polygon([(10, 380), (90, 380), (90, 440), (10, 440)]))]
    points, regions, at = pulled(12.0), CUTS[name], places(200)
    given: dict[str, Any] = {"support": 200.0, "stages": 2}
    settings = {
        **given,
        "cuts": [{"region": region_to_data(r)} for r in regions],
        "parts": [part_data(part) for part in parts],
    }
    found = run_script(
        MAPS,
        MAIN,
        {
            "points": as_json(points),
            "settings": settings,
            "at": at.tolist(),
            "raster": {"shape": RASTER.shape, "spacing": RASTER.spacing, "origin": RASTER.origin},
        },
    )
    fits = FitSettings(**given).fits(points, parts, regions)
    field = Decoupled(tuple(fits.values()), tuple(fits), tuple(regions), softness=6.0)
    assert [tuple(row) for row in found["sides"]] == list(fits)
    moves, opacity = field.displacement_and_opacity(at)
    is_seen = opacity > 1e-6  # elsewhere rounding chooses
    assert np.abs(np.array(found["seen"])[:, :2] - moves)[is_seen].max() < CLOSE
    assert np.abs(np.array(found["seen"])[:, 2] - opacity).max() < 1e-6
    for fit, slopes, values in zip(fits.values(), found["slopes"], found["maps"], strict=True):
        slope = np.array(slopes)
        np.testing.assert_allclose(slope[:, :2], at + fit.displacement(at), atol=CLOSE)
        np.testing.assert_allclose(slope[:, 2:].reshape(-1, 2, 2), np.eye(2) + fit.jacobian(at), atol=1e-5)
        oracle = np.moveaxis(fit.sample_on_raster(RASTER), 0, -1)
        np.testing.assert_allclose(np.reshape(values, oracle.shape), oracle, atol=1e-3)
    assert np.isfinite(found["folds"]["least"])
    is_moved = np.array([p is not None for p in found["moved"]])
    assert is_moved.mean() > 0.5
    there = np.array([p or [0, 0] for p in found["moved"]])[is_moved]
    np.testing.assert_allclose(there + field.displacement(there), at[is_moved], atol=1e-4)


def test_what_cannot_stop_is_refused_alike() -> None:
    slits = [Line([(60 * k, 10), (60 * k + 5, 300)], stops=(False, True)) for k in range(1, 5)]
    main = """({ points, cuts, rule }) => { try { layeredFit(points, { cuts, cut_rule: rule }); }
      catch (e) { return e.message; } }"""
    for rule, some in (("source", slits), ("paper", slits[:1])):
        message = run_script(
            MAPS,
            main,
            {"points": as_json(pulled()), "rule": rule, "cuts": [{"region": region_to_data(r)} for r in some]},
        )
        with pytest.raises(DeformError) as caught:
            FitSettings().fit(pulled(), cuts=some, cut_rule=rule, softness=1.0)
        assert refusal(message) == refusal(str(caught.value))

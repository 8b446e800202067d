"""The stop of drags before tissue folds, as the front end does it, against the determinants of Python's fits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scripts import run_script

from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints

BOX = (0.0, 100.0, 0.0, 80.0)
CORNERS = [[0, 0], [100, 0], [100, 80], [0, 80]]
SETTINGS = {"kernel": "wendland_c2", "support": 60.0, "trend": "affine", "smoothing": 0, "strength": 1, "stages": 1}
MAIN = """({ cases, settings, box }) => cases.map(({ points, ids, by, middle, radius }) => {
  const shapes = { cuts: [], parts: [] };
  const list = points.map(([source, target], id) => ({ id, source, target, active: true, weight: 1 }));
  const tissueTest = (layered) => radius === null ? undefined : (a, b) => {
    const [da, db] = placeOf(layered, a, b, 1e-9);
    return Math.hypot(a + da - middle[0], b + db - middle[1]) < radius;
  };
  const fitOf = (given, more) => layeredFit(given, { ...settings, ...more });
  const editor = {
    model: { get: () => true }, points: { list, shapes }, picture: { box },
    map: { fitOf, tissueTest }, tools: { foldOffers: { drop() {}, propose() {} } },
  };
  const stop = new FoldStop(editor);
  stop.begin();
  const before = list;
  const make = (share) => ({ shapes, points: translatePoints(before, ids, share * by[0], share * by[1], "target") });
  let found = list;
  for (let move = 0; move < 12; move++) found = stop.limit(make).points; // each movement of a hand comes closer
  return { targets: found.map((p) => p.target), share: stop.stopped ? stop.stopped.share : 1 };
})"""


def stopped(cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
    modules = ("editor/fold_stop.ts", "maths/cuts.ts", "maths/points.ts")
    found: list[dict[str, Any]] = run_script(modules, MAIN, {"cases": cases, "settings": SETTINGS, "box": BOX})
    return found


def random_case(rng: np.random.Generator, with_air: bool) -> dict[str, Any]:
    inner = rng.uniform([8, 8], [92, 72], (rng.integers(1, 7), 2)).tolist()
    places = CORNERS + inner
    ids = rng.choice(np.arange(4, len(places)), rng.integers(1, len(inner) + 1), replace=False).tolist()
    return {
        "points": [[p, p] for p in places],
        "ids": ids,
        "by": rng.normal(0, 45, 2).tolist(),
        "middle": rng.uniform([30, 20], [70, 60]).tolist(),
        "radius": float(rng.uniform(10, 30)) if with_air else None,
    }


def least_in_tissue(case: dict[str, Any], targets: list[list[float]]) -> float:
    """The smallest determinant at the nodes of a fine lattice that are in tissue."""
    points = ControlPoints.from_arrays([source for source, _ in case["points"]], targets)
    field = FitSettings(support=SETTINGS["support"]).fit(points)
    a, b = np.meshgrid(np.linspace(*BOX[:2], 201), np.linspace(*BOX[2:], 161))
    places = np.stack([a, b], axis=-1).reshape(-1, 2)
    slopes = np.asarray(field.jacobian(places))
    dets = np.linalg.det(np.eye(2) + slopes)
    if case["radius"] is None:
        return float(dets.min())
    seen = np.linalg.norm(places + field.displacement(places) - case["middle"], axis=1) < case["radius"]
    return float(dets[seen].min()) if seen.any() else 1.0


@settings(max_examples=4, deadline=None)
@given(st.integers(0, 2**31), st.booleans())
def test_no_drag_folds_tissue(seed: int, with_air: bool) -> None:
    rng = np.random.default_rng(seed)
    cases = [random_case(rng, with_air) for _ in range(6)]
    for case, found in zip(cases, stopped(cases), strict=True):
        assert least_in_tissue(case, found["targets"]) > 0
        if found["share"] < 1 and not with_air:  # and it is no shorter than it must be: tissue may leave a fold
            start = np.array([source for source, _ in case["points"]])
            beyond = []
            for share in found["share"] + np.linspace(0, 1 / 64, 6)[1:]:
                way = start.copy()
                way[case["ids"]] += share * np.array(case["by"])
                beyond.append(least_in_tissue(case, way.tolist()))
            assert min(beyond) < 0.12


@settings(max_examples=4, deadline=None)
@given(st.integers(0, 2**31))
def test_a_drag_that_unfolds_is_never_shortened(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cases = []
    while len(cases) < 8:
        case = random_case(rng, with_air=False)
        far = [list(source) for source, _ in case["points"]]
        for k in case["ids"]:
            far[k] = (np.array(far[k]) + case["by"]).tolist()
        if least_in_tissue(case, far) < 0:
            back = [[source, target] for (source, _), target in zip(case["points"], far, strict=True)]
            cases.append({**case, "points": back, "by": (-np.array(case["by"])).tolist()})
    for case, found in zip(cases, stopped(cases), strict=True):
        assert found["share"] == 1
        assert found["targets"] == pytest.approx(np.array([source for source, _ in case["points"]]), abs=1e-9)


def test_folds_of_air_alone_stop_nothing() -> None:
    rng = np.random.default_rng(0)
    cases = [{**random_case(rng, with_air=True), "middle": [-500.0, 0.0]} for _ in range(12)]
    assert {found["share"] for found in stopped(cases)} == {1}

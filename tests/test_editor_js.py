"""The editor's scripts without a page: edits and their undo, messages in flight, the inverse map and folds."""

from __future__ import annotations

from typing import Any

import numpy as np
from scripts import run_script
from test_rbf_js import as_json, scattered

from deformnb.rbf import fit_rbf
from deformnb.forward import warp_points

BOX = [0.0, 500.0, 0.0, 450.0]


def test_edits_change_what_they_say_and_nothing_else() -> None:
    points = as_json(scattered(4))
    main = """(points) => { const before = JSON.stringify(points), out = {
        moved: movedPoints(points, [1, 3], 5, -2), both: movedPoints(points, [0], 1, 1, "both"),
        source: movedPoints(points, [2], 3, 0, "source"), removed: removedPoints(points, [0, 2]),
        off: switchedPoints(points, [1]), on: switchedPoints(switchedPoints(points, [1]), [1]),
        mixed: switchedPoints(switchedPoints(points, [1]), [0, 1]), named: renamedPoint(points, 2, "  fin "),
        reset: resetPoints(points, [3]), added: addedPoint(points, 9, [1, 2], [3, 4]), next: nextId(points, 7) };
        return [out, before === JSON.stringify(points)]; }"""
    out, is_pure = run_script(("edits.js",), main, points)
    assert is_pure
    targets = {name: [p["target"] for p in out[name]] for name in ("moved", "both", "source", "reset")}
    sources = {name: [p["source"] for p in out[name]] for name in ("moved", "both", "source", "reset")}
    t, s = [p["target"] for p in points], [p["source"] for p in points]
    assert targets["moved"] == [t[0], [t[1][0] + 5, t[1][1] - 2], t[2], [t[3][0] + 5, t[3][1] - 2]]
    assert sources["moved"] == s
    assert (targets["both"][0], sources["both"][0]) == ([t[0][0] + 1, t[0][1] + 1], [s[0][0] + 1, s[0][1] + 1])
    assert (targets["source"], sources["source"][2]) == (t, [s[2][0] + 3, s[2][1]])
    assert targets["reset"] == [*t[:3], s[3]]
    assert [p["id"] for p in out["removed"]] == [1, 3]
    switches = [[p["active"] for p in out[name]] for name in ("off", "on", "mixed")]
    assert switches == [[True, False, True, True], [True] * 4, [False, False, True, True]]
    assert out["named"][2]["name"] == "fin"
    assert out["added"][4] == {"id": 9, "name": "", "source": [1, 2], "target": [3, 4], "active": True, "weight": 1}
    assert out["next"] == 7


def test_undo_goes_back_to_the_start_and_redo_to_the_end() -> None:
    main = """() => { const history = new History(3), seen = [];
        let now = 0;
        for (let k = 0; k < 5; k++) { history.record(k, null, now += 5000); }
        let current = 5;
        for (;;) { const back = history.undo(current); if (back === null) break; seen.push(current = back); }
        for (;;) { const next = history.redo(current); if (next === null) break; seen.push(current = next); }
        history.undo(current); history.record(99);
        return [seen, history.redo(0)]; }"""
    assert run_script(("edits.js",), main, None) == [[4, 3, 2, 3, 4, 5], None]  # the oldest two are forgotten


def test_quick_steps_of_one_kind_are_undone_as_one() -> None:
    main = """() => { const history = new History();
        const steps = [["nudge 1", 0], ["nudge 1", 100], ["nudge 1", 500], ["nudge 2", 600], ["nudge 2", 5000],
            [null, 5001], [null, 5002]];
        steps.forEach(([kind, at], k) => history.record(k, kind, at));
        return history.past; }"""
    assert run_script(("edits.js",), main, None) == [0, 3, 4, 5, 6]


def test_points_from_anywhere_are_cleaned() -> None:
    main = """() => [cleanPoints(null), cleanPoints([3, null, { id: 1, source: [1, 2] },
        { id: 0.5, source: [1, 2], target: [1, 2] },
        { id: 4, source: [1, 2], target: [3, 4], weight: -1 }, { id: 4, source: [1, 2], target: [3, 4] },
        { id: 5, source: [1, NaN], target: [3, 4] }])]"""
    good = {"id": 4, "name": "", "source": [1, 2], "target": [3, 4], "active": True, "weight": 1}
    assert run_script(("edits.js",), main, None) == [[], [good]]


MAPS = ("rbf_solve.js", "rbf.js", "regions.js", "region_masks.js", "rigid_fits.js", "cut_fits.js", "maps.js")


def test_the_inverse_is_that_of_the_package() -> None:
    points = scattered()
    places = np.random.default_rng(2).uniform(0, 400, (40, 2))
    main = """({ points, places }) => { const fit = rbfFit(points); return places.map(([a, b]) => {
        const at = new Float64Array([a, b]); return [mapInverse(fit, a, b, at, 1e-9), ...at]; }); }"""
    found = run_script(MAPS, main, {"points": as_json(points), "places": places.tolist()})
    moved, converged = warp_points(places, fit_rbf(points), tolerance=1e-9)
    assert converged.all()
    assert all(row[0] for row in found)
    assert np.abs(np.array(found)[:, 1:] - moved).max() < 1e-7


def folds(points: Any) -> dict[str, float]:
    main = f"(points) => foldsOf(layeredFit(points), {BOX}, 33)"
    return dict(run_script(MAPS, main, as_json(points)))


def test_folds_are_those_of_the_jacobian() -> None:
    points = scattered(size=60.0)
    a, b = np.meshgrid(np.linspace(0, 500, 33), np.linspace(0, 450, 33))
    at = np.concatenate([np.stack([a, b], axis=-1).reshape(-1, 2), points.target])
    det = np.linalg.det(np.eye(2) + fit_rbf(points).jacobian(at))
    found = folds(points)
    assert abs(found["least"] - det.min()) < 1e-9
    assert found["share"] == (det[: 33 * 33] <= 0).mean() > 0
    assert folds(points.reset()) == {"least": 1, "share": 0}


def test_the_net_breaks_where_the_map_folds_and_covers_the_box_where_it_does_not() -> None:
    main = f"(points) => deformedNet(layeredFit(points), {BOX}, 8, 4, 1e-6).map((l) => l.runs.map((r) => Array.from(r)))"
    whole = run_script(MAPS, main, as_json(scattered()))
    assert [len(runs) for runs in whole] == [1] * (9 + 8)  # 500 x 450 with cells of 62.5: 8 across, 7 down
    fit = fit_rbf(scattered())
    for k, (run,) in enumerate(whole[:9]):
        line = np.array(run).reshape(-1, 2)
        back = line + fit.displacement(line)
        assert np.abs(back[:, 0] - 62.5 * k).max() < 1e-5
        assert np.abs(back[[0, -1], 1] - [0, 450]).max() < 1e-5
    folded = run_script(MAPS, main, as_json(scattered(size=60.0)))
    assert all(np.isfinite(run).all() for runs in folded for run in runs)

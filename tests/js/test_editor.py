"""The editor's scripts without a page: edits and their undo, messages in flight, the inverse map and folds."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from js.test_rbf import as_json, scattered
from scripts import run_script

from deformnb.rbf.conditioning import box_diagonal
from deformnb.rbf.interpolant import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart, fit_rigid
from deformnb.warping.points import warp_points

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
    out, is_pure = run_script(("maths/points.js",), main, points)
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
    assert out["added"][4] == {"id": 9, "name": "", "source": [1, 2], "target": [3, 4], "active": True, "weight": 1,
                               "locked": False, "radius": None}
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
    assert run_script(("maths/points.js",), main, None) == [[4, 3, 2, 3, 4, 5], None]  # the oldest two are forgotten


def test_quick_steps_of_one_kind_are_undone_as_one() -> None:
    main = """() => { const history = new History();
        const steps = [["nudge 1", 0], ["nudge 1", 100], ["nudge 1", 500], ["nudge 2", 600], ["nudge 2", 5000],
            [null, 5001], [null, 5002]];
        steps.forEach(([kind, at], k) => history.record(k, kind, at));
        return history.past; }"""
    assert run_script(("maths/points.js",), main, None) == [0, 3, 4, 5, 6]


def test_points_from_anywhere_are_cleaned() -> None:
    main = """() => [cleanPoints(null), cleanPoints([3, null, { id: 1, source: [1, 2] },
        { id: 0.5, source: [1, 2], target: [1, 2] },
        { id: 4, source: [1, 2], target: [3, 4], weight: -1 }, { id: 4, source: [1, 2], target: [3, 4] },
        { id: 5, source: [1, NaN], target: [3, 4] }])]"""
    good = {"id": 4, "name": "", "source": [1, 2], "target": [3, 4], "active": True, "weight": 1,
            "locked": False, "radius": None}
    assert run_script(("maths/points.js",), main, None) == [[], [good]]


MAPS = ("maths/rbf.js", "maths/rigid_stages.js", "maths/cuts.js", "maths/warp_map.js", "maths/folds.js")


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
    assert folds(points.reset()) == {"least": 1, "share": 0, "place": [0, 0]}


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
        return [Array.from(dets), foldPieces(layered, raster, dets, probes, 1e7)]; }"""
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


def test_the_net_breaks_where_the_map_folds_and_covers_the_box_where_it_does_not() -> None:
    main = f"""(points) => deformedNet(layeredFit(points, {{ support: 'box_diagonal' }}), {BOX}, 8, 4, 1e-6)
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


# ---- shapes ---------------------------------------------------------------------------------------------------------

SHAPES = ("maths/points.js", "maths/shapes.js")


def test_a_half_plane_is_turned_by_two_places_on_its_line() -> None:
    main = """([region, place]) => { const moved = movedCorner(region, 0, place, 10);
        return [cornersOf(region, 10), moved, cornersOf(moved, 10)]; }"""
    region = {"kind": "half_space", "point": [5, 5], "normal": [0, 1]}  # all above b = 5 is inside
    before, moved, after = run_script(SHAPES, main, [region, [-5, 15]])
    assert before == [[-5, 5], [15, 5]]
    assert after[0] == pytest.approx([-5, 15])
    along = np.subtract(after[1], after[0])
    assert along[0] * -10 - along[1] * 20 == pytest.approx(0)  # through the other place as before
    assert np.dot(moved["normal"], [0, 1]) > 0.8  # the same side
    turned = run_script(SHAPES, "(region) => turnedRegion(region)", region)
    assert np.array_equal(turned["normal"], [0, -1])


@pytest.mark.parametrize("ends", [([0, 40], [100, 50]), ([100, 50], [0, 40])])
def test_the_ground_is_away_from_the_middle(ends: tuple[list[float], list[float]]) -> None:
    found = run_script(SHAPES, "([p, q]) => groundThrough(p, q, [50, 10])", ends)
    assert np.dot(np.subtract([50, 10], found["point"]), found["normal"]) > 0
    assert np.hypot(*found["normal"]) == pytest.approx(1, abs=1e-12)


def test_a_stroke_keeps_its_corners_and_nothing_else() -> None:
    stroke = [[k, 0] for k in range(20)] + [[20, k] for k in range(20)]
    stroke += [[20 + k, 20 + 0.2 * (k % 2)] for k in range(20)]
    assert run_script(SHAPES, "(path) => simplified(path, 0.5)", stroke) == [[0, 0], [20, 0], [20, 20], [39, 20.2]]


def test_a_line_keeps_two_corners_and_a_closed_one_three() -> None:
    line = {"kind": "line", "vertices": [[0, 0], [5, 5], [9, 0]]}
    main = """(line) => [removedCorner(line, 1), removedCorner(removedCorner(line, 1), 0),
        removedCorner({ ...line, kind: "polygon" }, 0), insertedCorner(line, 1, [7, 3]).vertices,
        movedRegion(line, 1, 2).vertices, turnedRegion(line).vertices[0], turnedRegion({ ...line, kind: "polygon" })]"""
    less, none, triangle, more, moved, first, closed = run_script(SHAPES, main, line)
    assert less["vertices"] == [[0, 0], [9, 0]]
    assert (none, triangle, closed) == (None, None, None)
    assert more == [[0, 0], [5, 5], [7, 3], [9, 0]]
    assert (moved, first) == ([[1, 2], [6, 7], [10, 2]], [9, 0])


def test_regions_that_are_known_stay_the_same_objects() -> None:
    main = """(list) => { const old = cleanShapes(list, "cuts"), told = JSON.parse(JSON.stringify(list));
        const again = cleanShapes(told, "cuts", old);
        return [again[0].region === old[0].region, sameShapes(again, old), cleanShapes([null, 3, {}], "cuts")]; }"""
    assert run_script(SHAPES, main, [{"region": {"vertices": [[0, 1], [2, 3]], "kind": "line"}}]) == [True, True, []]


def test_the_slope_beside_rigid_parts_is_that_of_the_package() -> None:
    points, region = scattered(), Polygon([(200, 150), (330, 160), (320, 260), (210, 250)])
    part = RigidPart(region, RigidMotion.turn(12, (260, 200), (3, 1)))
    points = points.take(np.flatnonzero(region.signed_distance(points.target) > 25))
    data = {"region": {"kind": "polygon", "vertices": region.vertices}, "weight": "saturated",
            "motion": {"matrix": part.motion.matrix, "shift": part.motion.shift}}  # type: ignore[union-attr]
    at = np.random.default_rng(4).uniform(50, 400, (60, 2))
    main = """({ points, part, at }) => {
        const fit = layeredFit(points, { support: "box_diagonal", parts: [part] }).fits[0].fit;
        return at.map(([a, b]) => Array.from(fieldWithSlope(fit, a, b, new Float64Array(6)))); }"""
    found = np.array(run_script(MAPS, main, {"points": as_json(points), "part": data, "at": at.tolist()}))
    fit = fit_rigid(points, [part], support=box_diagonal(points))
    assert np.abs(found[:, :2] - at - fit.displacement(at)).max() < 1e-9
    assert np.abs(found[:, 2:].reshape(-1, 2, 2) - np.eye(2) - fit.jacobian(at)).max() < 1e-3

"""Strokes of the brush in space, whose points Python fits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scripts import run_script

from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid
from deformnb.widgets.editor.space_slices import Pane

GRID = Grid((40, 50, 60), (1.5, 1.2, 1.0), (-20.0, 10.0, 5.0))
MIDDLE = np.asarray(GRID.center)
RADIUS = 9.0
MODULES = ("maths/brushes.ts", "maths/space_stages.ts", "maths/space_folds.ts")
STROKE = """({ pane, middle, radius, tool, steps }) => {
  const sourceAt = (points) => (place) => sourceOfFits(points.length ? spaceFits(points) : [], place);
  const around = { frame: volumeFrame(pane), reach: 0, sourceAt, settle: (at) => at };
  const stroke = new Stroke([], middle, radius, { tool, id: 0 }, around);
  for (const step of steps) tool === "move" ? stroke.move(step) : stroke.grow(step);
  return stroke.points;
}"""


def stroke(tool: str, steps: list[Any]) -> ControlPoints:
    data = {
        "pane": Pane.of(GRID, "+y").info(),
        "middle": MIDDLE.tolist(),
        "radius": RADIUS,
        "tool": tool,
        "steps": steps,
    }
    found = run_script(MODULES, STROKE, data)
    return ControlPoints.from_arrays(
        [p["source"] for p in found], [p["target"] for p in found], names=[p["name"] for p in found]
    )


def around(distance: float) -> Any:
    """Places on a sphere around the middle, in the volume."""
    directions = np.random.default_rng(1).normal(size=(400, 3))
    places = MIDDLE + distance * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    index = GRID.point_to_index(places)
    return places[((index >= 0) & (index <= np.asarray(GRID.shape[::-1]) - 1)).all(axis=1)]


def dets(points: ControlPoints, places: Any) -> Any:
    return np.linalg.det(np.eye(3) + np.asarray(fit_rbf(points).jacobian(places)))


def everywhere() -> Any:
    rng = np.random.default_rng(2)
    return GRID.index_to_point(rng.uniform(0, np.asarray(GRID.shape[::-1]) - 1, (20000, 3)))


@pytest.mark.parametrize("way", [(5.0, 0.0, 0.0), (3.0, -2.0, 4.0)])
def test_a_stroke_moves_the_tissue_of_its_ball_and_no_other(way: Any) -> None:
    points = stroke("move", [(MIDDLE + np.multiply(share, way)).tolist() for share in (0.3, 0.7, 1.0)])
    assert set(points.names) == {"move 1"}
    assert len(points) < 90
    field = fit_rbf(points)
    held = np.linalg.norm(points.source - MIDDLE, axis=1) < 1e-9
    assert points.target[held] == pytest.approx(np.array([MIDDLE + way]), abs=1e-9)
    assert field.displacement(MIDDLE + way) == pytest.approx(-np.array(way), abs=1e-5)
    length = np.linalg.norm(way)
    for distance in (1.4 * RADIUS, 2.2 * RADIUS, 3 * RADIUS):  # a tenth: kernels reach between still points
        assert np.linalg.norm(field.displacement(around(distance)), axis=1).max() < 0.14 * length
    assert dets(points, everywhere()).min() > 0.1


def test_a_long_stroke_leaves_its_tissue_behind_before_it_folds() -> None:
    ways = np.linspace(0, 1.6 * RADIUS, 9)
    points = stroke("move", [(MIDDLE + np.multiply(x, (0.0, 0.6, -0.8))).tolist() for x in ways])
    assert dets(points, everywhere()).min() > 0.05
    farthest = np.linalg.norm(points.displacement, axis=1).max()
    assert 0.7 * RADIUS < farthest < 1.3 * RADIUS


THIN = STROKE.replace(
    "return stroke.points;",
    "const all = stroke.points; stroke.thin(TOLERANCE, (points) => points); return [all, stroke.points];",
)


def as_points(found: list[dict[str, Any]]) -> ControlPoints:
    return ControlPoints.from_arrays([p["source"] for p in found], [p["target"] for p in found])


@pytest.mark.parametrize(("share", "most"), [(0.15, 30), (0.5, 70)])
def test_a_stroke_leaves_only_the_points_that_move_tissue(share: float, most: int) -> None:
    tolerance = 0.5 * min(GRID.spacing)
    way = [(MIDDLE + np.multiply(x, (share * RADIUS, 0.0, 0.0))).tolist() for x in (0.4, 1.0)]
    data = {"pane": Pane.of(GRID, "+y").info(), "middle": MIDDLE.tolist(), "radius": RADIUS, "tool": "move"}
    found = run_script(MODULES, THIN.replace("TOLERANCE", str(tolerance)), {**data, "steps": way})
    whole, thin = map(as_points, found)
    assert len(thin) < most < len(whole)
    assert {tuple(p) for p in thin.target.tolist()} < {tuple(p) for p in whole.target.tolist()}
    places = np.concatenate([whole.target, everywhere()[:4000]])
    away = np.linalg.norm(np.subtract(*(fit_rbf(made).displacement(places) for made in (whole, thin))), axis=1)
    assert away[: len(whole)].max() <= tolerance + 1e-6
    assert away.max() < 2.2 * tolerance  # between the points of the stroke, where nothing holds it to the whole map
    assert dets(thin, everywhere()).min() > 0.1


@pytest.mark.parametrize(("swell", "name"), [(0.5, "grow 1"), (-0.5, "shrink 1")])
def test_the_ball_grows_and_shrinks_in_all_directions(swell: float, name: str) -> None:
    points = stroke("grow", [0.2 * swell, swell])
    assert set(points.names) == {name}
    scale = np.exp(swell * (1 - 0.55**2) ** 2)
    inner = around(0.55 * RADIUS * scale)
    away = np.linalg.norm(inner + fit_rbf(points).displacement(inner) - MIDDLE, axis=1)
    assert away.mean() == pytest.approx(0.55 * RADIUS, rel=0.12)
    assert away.std() < 0.12 * RADIUS
    outer = around(3 * RADIUS)
    assert np.linalg.norm(fit_rbf(points).displacement(outer), axis=1).max() < 0.06 * RADIUS
    assert dets(points, everywhere()).min() > 0.1

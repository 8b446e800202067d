"""Rigid parts in space of the front end, against those of Python."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from js.test_space_folds import as_json
from scripts import run_script

from deformnb.document.json_regions import motion_from_data, part_to_data
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Mask
from deformnb.rbf.rigid import RigidMotion, RigidPart, carry_points
from deformnb.volume.volume import Grid
from deformnb.widgets.editor.space_slices import PANES, Pane
from deformnb.widgets.studio.panels.shapes import middle_of

TURNED = ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
GRID = Grid((20, 30, 40), (1.5, 1.2, 1.0), (-5.0, 45.0, -3.0), TURNED)
MIDDLE = np.asarray(GRID.center)
MOTION = RigidMotion.turn(25, MIDDLE, (2.0, -3.0, 1.0), (0.3, -0.5, 0.8))
REGIONS: dict[str, AbstractRegion] = {
    "ellipsoid": Mask.drawn("ellipsoid", MIDDLE, (8, 6, 5), np.eye(3)),
    "box of a turned grid": Mask(np.pad(np.ones((8, 12, 14), bool), 4), replace(GRID, shape=(16, 20, 22))),
    "half": HalfSpace(tuple(MIDDLE.tolist()), (0.4, 0.5, -0.7)),
}


def run(main: str, data: Any) -> Any:
    return run_script(("maths/space_parts.ts", "maths/regions.ts"), main, data)


@pytest.mark.parametrize("name", REGIONS)
def test_moving_and_turning_in_a_slice_are_motions_of_python(name: str) -> None:
    part = RigidPart(REGIONS[name], MOTION)
    pane, axis = Pane.of(GRID, "-x"), Pane.of(GRID, "-x").plane.normal
    main = """({ part, pane }) => {
      const turned = turnInSpace(part, pane.n, 0.4);
      return [shiftInSpace(part, [1, 2, 3]).motion, turned.motion, pivotInSpace(turned), twistOf(turned, pane.n) -
        twistOf(part, pane.n), placeBeforeInSpace(part.motion, moveInSpace(part.motion, [3, 4, 5]))];
    }"""
    shifted, turned, pivot, twist, same = run(main, {"part": part_to_data(part), "pane": pane.info()})
    places = MIDDLE + np.random.default_rng(2).uniform(-9, 9, (20, 3))
    np.testing.assert_allclose(motion_from_data(shifted)(places), MOTION(places) + np.array([1, 2, 3]), atol=1e-9)
    about = MOTION([middle_of(part.region)])[0]
    turn = RigidMotion.turn(np.degrees(0.4), about, axis=axis)
    np.testing.assert_allclose(motion_from_data(turned)(places), turn(MOTION(places)), atol=1e-9)
    np.testing.assert_allclose(pivot, about, atol=1e-9)
    assert 0 < twist < 0.8
    np.testing.assert_allclose(same, [3, 4, 5], atol=1e-9)


@pytest.mark.parametrize("name", REGIONS)
def test_a_slice_shows_a_part_where_it_has_moved(name: str) -> None:
    part = RigidPart(REGIONS[name], MOTION, name="bone")
    for view in PANES:
        pane = Pane.of(GRID, view)
        depth = pane.depth_of(MOTION([middle_of(part.region)])[0]) + 0.7
        a0, a1, b0, b1 = pane.box[:4]
        ab = np.random.default_rng(3).uniform((a0, b0), (a1, b1), (600, 2))
        main = """({ part, pane, depth, places }) => {
          const { name, pivot, region } = partOnSlice(part, pane, depth), distance = regionDistance(region);
          return [name, pivot, places.map(([a, b]) => distance(a, b))];
        }"""
        data = {"part": part_to_data(part), "pane": pane.info(), "depth": depth, "places": ab.tolist()}
        found, pivot, distances = run(main, data)
        x = pane.plane.from_plane(np.column_stack([ab, np.full(len(ab), depth)]))
        far = part.region.signed_distance(MOTION.inverse(x))
        sure = np.abs(far) > 1.5
        np.testing.assert_array_equal(np.array(distances)[sure] < 0, far[sure] < 0)
        assert (far < 0).sum() > 10
        assert found == "bone"
        np.testing.assert_allclose(pivot, pane.plane.to_plane(MOTION([middle_of(part.region)])[0])[:2], atol=1e-9)


def test_a_slice_that_a_part_does_not_meet_shows_nothing_of_it() -> None:
    part, pane = RigidPart(REGIONS["ellipsoid"]), Pane.of(GRID, "+z")
    main = "({ part, pane, depth }) => regionDistance(partOnSlice(part, pane, depth).region)(20, 20)"
    data = {"part": part_to_data(part), "pane": pane.info(), "depth": pane.depth_of(MIDDLE) + 7}
    assert run(main, data) > 1e6
    level = RigidPart(HalfSpace(tuple(MIDDLE.tolist()), (0.0, 0.0, 1.0)))  # parallel to the slice
    main = "({ part, pane, depth }) => partOnSlice(part, pane, depth).region.kind"
    depths = [pane.plane.to_plane(MIDDLE + np.array([0, 0, z]))[2] for z in (-2, 2)]
    kinds = [run(main, {"part": part_to_data(level), "pane": pane.info(), "depth": depth}) for depth in depths]
    assert kinds == ["polygon", "mask"]


def test_points_that_a_part_carries_follow_it_as_in_python() -> None:
    source = MIDDLE + np.array([[0, 0, 0], [2, 1, 0], [3, 0, 1], [15, 0, 0]])
    before = RigidPart(REGIONS["ellipsoid"])
    after = replace(before, motion=MOTION)
    points = ControlPoints.from_arrays(source).move(2, MIDDLE + np.array([5, 5, 5]))
    main = "({ points, before, after }) => carryInSpace(points, before, after).map((p) => p.target)"
    data = {"points": as_json(points), "before": part_to_data(before), "after": part_to_data(after)}
    found = np.array(run(main, data))
    np.testing.assert_allclose(found, carry_points(points, [before], [after]).target, atol=1e-9)
    assert not np.allclose(found[:2], source[:2])
    np.testing.assert_array_equal(found[2:], points.target[2:])

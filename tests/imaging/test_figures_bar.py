"""Figures 1 and 2 of the paper: a bar bent by points on a grid, and cut; in voxels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import oracle
import pytest

from deformnb.datasets import PHANTOMS
from deformnb.document.deformation import Deformation, Step
from deformnb.imaging.figures import picture_field
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Volume
from deformnb.warping.points import warp_points

BAR = PHANTOMS["bar"].make(noise=0)
PLANE = Plane.from_view(BAR.grid, "+y")
VOXEL = 2.0
NODES = np.array([[a, b] for a in np.linspace(27, 227, 5) for b in (75.0, 115)])
CUT = Cut(Line([(127, 190), (127, 0)]))
HANDS = np.array([[100.0, 60], [100, 130], [154, 60], [154, 130]])


def arch(points: np.ndarray) -> np.ndarray:
    """Onto a circle of 100 degrees below the bar."""
    radius = 200 / np.deg2rad(100)
    angle, height = (points[:, 0] - 127) / radius, radius + 95 - points[:, 1]
    return np.column_stack([127 + height * np.sin(angle), 77 + radius - height * np.cos(angle)])


BEND = Step((ControlPoints.from_arrays(NODES, arch(NODES)),), PLANE, trend="rigid")


# ---- figure 1 --------------------------------------------------------------------------------------------------------


def test_the_nodes_land_within_a_thousandth_of_a_voxel() -> None:
    landed, found = warp_points(NODES, picture_field(BEND, BAR.grid))
    assert found.all()
    assert np.abs(landed - arch(NODES)).max() < 1e-3 * VOXEL


def test_the_bar_bends_at_every_depth_alike() -> None:
    """The bright core runs through the middle of the bar: in the middle of the picture it is lifted with the grid."""
    bent = Deformation((BEND,)).apply(BAR)
    bright = bent.values[:, :, 63] > 200  # at a = 126, the middle of the arch
    rows = np.flatnonzero(bright[:, 31] & bright[:, 32])  # along the axis of the core, y = 64
    core = BAR.grid.origin[2] + VOXEL * rows.mean()
    oracle.assert_close(core, 96 + 18, atol=VOXEL)  # the core was at z = 96; the arch lifts the middle by 18 mm
    place = np.array([126.0, 64.0, 114.0])
    fields = [
        Deformation((BEND,)).field(BAR.grid).displacement(place + np.array([0.0, depth, 0.0])) for depth in (-60, 0, 60)
    ]
    oracle.assert_close(fields[0], fields[1], atol=1e-12)
    oracle.assert_close(fields[2], fields[1], atol=1e-12)


def test_the_displacement_has_no_component_along_the_depth() -> None:
    d = Deformation((BEND,)).field(BAR.grid).displacement(np.random.default_rng(1).uniform(0, 190, (200, 3)))
    assert np.abs(d[:, 1]).max() == 0.0


# ---- figure 2 --------------------------------------------------------------------------------------------------------


def pull(left: float, right: float, **options: object) -> Step:
    goal = HANDS + np.array([left, left, right, right])[:, None] * [1, 0]
    return Step((ControlPoints.from_arrays(HANDS, goal),), PLANE, trend="translation", cuts=(CUT,), **options)  # type: ignore[arg-type]


def gaps(step: Step) -> np.ndarray:
    """Empty voxels in the middle of the rows of a block without pattern, for every depth (y)."""
    block = Volume(np.full(BAR.shape, 200, np.uint8), BAR.grid)
    values = Deformation((step,)).apply(block, fill=0).values[30:60, :, 20:108]
    return np.asarray((1 - values / 200.0).sum(axis=2).mean(axis=0))


@pytest.mark.parametrize("rule", ["source", "paper"])
@pytest.mark.parametrize("drag", [1.0, 5.3, 16.0, 25.0])
def test_the_gap_is_as_wide_as_the_drag(rule: str, drag: float) -> None:
    width = gaps(pull(-drag / 2, drag / 2, cut_rule=rule))
    assert np.abs(width - drag / VOXEL).max() < 0.1


def test_the_papers_rule_leaves_a_false_gap_when_both_halves_go_one_way() -> None:
    assert np.abs(gaps(pull(16, 16, cut_rule="paper")) - 8).max() < 0.1
    assert np.abs(gaps(pull(16, 16, cut_rule="source"))).max() < 0.02


def test_a_cut_that_is_not_pulled_is_not_seen() -> None:
    for rule in ("source", "paper"):
        same = Deformation((pull(0, 0, cut_rule=rule),)).apply(BAR)
        assert np.abs(same.values.astype(int) - BAR.values).max() == 0


@pytest.mark.parametrize(
    ("curve", "f"),
    [
        ("1-z", lambda z: 1 - z),
        ("z", lambda z: z),
        (tuple(0.5 + 0.5 * np.cos(np.pi * np.linspace(0, 1, 101))), lambda z: 0.5 + 0.5 * np.cos(np.pi * z)),
    ],
)
def test_modulated_the_gap_is_the_curve_times_the_drag(curve: object, f: object) -> None:
    width = gaps(pull(-8, 8, extrusion="modulate", curve=curve))
    zeta = np.linspace(0, 1, BAR.shape[1])
    assert np.abs(width - 8 * f(zeta)).max() < 0.1  # type: ignore[operator]


def test_the_halves_are_solved_for_without_each_other() -> None:
    one, both = pull(-8, 0), pull(-8, 8)
    there = np.array([[60.0, 90], [90, 100]])
    alone, together = (picture_field(step, BAR.grid).displacement(there) for step in (one, both))
    oracle.assert_close(alone, together, atol=1e-12)
    without = picture_field(replace(both, cuts=()), BAR.grid).displacement(there)
    assert np.abs(without - together).max() > 1.0

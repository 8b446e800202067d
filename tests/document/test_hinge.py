"""A hinge: what is far from the joint moves exactly as a rigid body, and the joint is smooth."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scripts import run_script

from deformnb.document.deformation import Step
from deformnb.document.edits import initial_step
from deformnb.document.hinge import hinge, hinge_outlines
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidMotion
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid

GRID = Grid((4, 160, 200))
PLANE = Plane.from_view(GRID, "+z")
PIVOT, END, HALF = (80.0, 80.0), (170.0, 80.0), 12.0


@pytest.mark.parametrize("angle", [-80.0, -30.0, 20.0, 60.0, 90.0])
def test_far_from_the_joint_a_hinge_is_rigid(angle: float) -> None:
    field = hinge(initial_step(PLANE, GRID), PIVOT, END, angle, HALF).field(GRID)
    turn = RigidMotion.turn(angle, about=PIVOT)
    a, b = np.meshgrid(np.linspace(80 + 3 * HALF, 165, 12), np.linspace(80 - HALF + 1, 80 + HALF - 1, 7))
    before = np.stack([a.ravel(), b.ravel()], axis=1)
    after = turn(before)
    within = ((after > 1) & (after < [198, 158])).all(axis=1)
    places = np.column_stack([after[within], np.full(within.sum(), 1.0)])
    moved = field.displacement(places)[:, :2]
    assert within.sum() > 20
    assert after[within] + moved == pytest.approx(before[within], abs=1e-6)
    still = np.column_stack([160 - before, np.full(len(before), 1.0)])
    still = still[(still[:, 0] > 1)]
    assert field.displacement(still) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("angle", [-45.0, 45.0])
def test_the_joint_does_not_fold_on_the_axis_and_is_continuous(angle: float) -> None:
    field = hinge(initial_step(PLANE, GRID), PIVOT, END, angle, HALF).field(GRID)
    turn = RigidMotion.turn(angle / 2, about=PIVOT)
    line = np.stack([np.linspace(-2 * HALF, 2 * HALF, 400), np.zeros(400)], axis=1) * [1, 0] + PIVOT
    places = np.column_stack([turn(line), np.ones(400)])
    source = places + field.displacement(places)
    steps = np.linalg.norm(np.diff(source, axis=0), axis=1)
    assert steps.max() < 6 * 4 * HALF / 399


@pytest.mark.parametrize("end", [(170.0, 80.0), (60.0, 140.0)])
def test_the_front_end_makes_the_same_parts(end: tuple[float, float]) -> None:
    found = run_script(
        ("maths/hinge.ts",),
        "({ pivot, end, width }) => hingeOutlines(pivot, end, width)",
        {"pivot": PIVOT, "end": end, "width": HALF},
    )
    for corners, expected in zip(found, hinge_outlines(PIVOT, end, HALF), strict=True):
        assert np.array(corners) == pytest.approx(expected, abs=1e-9)


def test_points_on_the_limb_go_with_it() -> None:
    start = initial_step(PLANE, GRID)
    step = hinge(start.with_points(start.points.add([150, 80], [150, 80])), PIVOT, END, 30.0, HALF)
    expected = RigidMotion.turn(30, about=PIVOT)(np.array([[150.0, 80.0]]))[0]
    assert step.points.target[-1] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ((PIVOT, END, 120.0, HALF), "90 degrees"),
        ((PIVOT, PIVOT, 20.0, HALF), "another place"),
        ((PIVOT, END, 20.0, 0.0), "positive length"),
    ],
)
def test_what_is_no_hinge_is_refused(options: tuple[Any, ...], words: str) -> None:
    with pytest.raises(DeformError, match=words):
        hinge(initial_step(PLANE, GRID), *options)
    with pytest.raises(DeformError, match="on a picture"):
        hinge(Step((ControlPoints.empty(3),)), PIVOT, END, 20.0, HALF)

"""The best prediction of a step: its regions and key pictures, and the problem with rigid parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deformnb.document.deformation import Step
from deformnb.document.step_checks import best_prediction
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.prediction import choose_fit
from deformnb.rbf.regions import HalfSpace
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane

SOURCE = np.stack(np.meshgrid(np.arange(6.0), np.arange(5.0)), axis=-1).reshape(-1, 2) * 10
POINTS = ControlPoints.from_arrays(SOURCE, SOURCE + np.column_stack([SOURCE[:, 1] ** 2, SOURCE[:, 0] * 8]) / 300)
STEP = Step((POINTS,), Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)))


def test_beside_rigid_parts_fits_backward_alone_are_tried() -> None:
    assert best_prediction(STEP).settings.direction == "forward"
    held = replace(STEP, parts=(RigidPart(HalfSpace((-50.0, 0.0), (1.0, 0.0))),))
    assert {row.settings.direction for row in best_prediction(held).tried} == {"backward"}
    off = replace(held, parts=(replace(held.parts[0], enabled=False),))
    assert best_prediction(off).settings.direction == "forward"


def test_regions_between_cuts_are_judged_by_their_own_points() -> None:
    cut = replace(STEP, cuts=(Cut(HalfSpace((24.0, 0.0), (1.0, 0.0))),))
    left = SOURCE[:, 0] < 24
    apart = choose_fit([POINTS.take(np.flatnonzero(side)) for side in (left, ~left)])
    whole = best_prediction(cut)
    assert [row.settings.kernel for row in whole.tried] == [row.settings.kernel for row in apart.tried]
    assert [row.error for row in whole.tried if not row.why] == pytest.approx(
        [row.error for row in apart.tried if not row.why], rel=1e-6
    )


def test_every_key_picture_counts() -> None:
    rough = ControlPoints.from_arrays(SOURCE, SOURCE + np.random.default_rng(0).normal(0, 3, SOURCE.shape))
    keyed = replace(STEP, maps=(POINTS, rough), extrusion="interpolate", knots=(0.0, 1.0))
    assert best_prediction(keyed).tried[0].error > best_prediction(STEP).tried[0].error

"""Objects of a notebook are printed in one short line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deformnb.document.deformation import Deformation, Step
from deformnb.imaging.projection import project
from deformnb.rbf.fields import DisplacementField
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.inverse import invert
from deformnb.warping.mesh import Mesh
from deformnb.warping.points import Landmarks

GRID = Grid((4, 8, 8))
VOLUME = Volume(np.zeros(GRID.shape, np.uint8), GRID, "a bar")
MANY = np.random.default_rng(0).random((200, 2))
POINTS = ControlPoints.from_arrays(MANY, MANY + 0.01, names=[f"point {k}" for k in range(200)])
ONE = Deformation.from_picture_points(GRID, "+z", POINTS)
FIELD = fit_rbf(POINTS)
RASTER = Raster((8, 8), (1.0, 1.0), (0.0, 0.0))


@pytest.mark.parametrize(
    "shown",
    [
        VOLUME,
        GRID,
        POINTS,
        ONE,
        ONE.steps[0],
        ONE.steps[0].plane,
        project(VOLUME, "+z"),
        RASTER,
        FIELD,
        ONE.field(GRID),
        DisplacementField(np.zeros((4, 8, 8, 3)), GRID),
        invert(FIELD, RASTER),
        Landmarks(MANY, tuple(f"mark {k}" for k in range(200))),
        Mesh(np.eye(3), np.array([[0, 1, 2]]), "horse"),
    ],
    ids=lambda shown: type(shown).__name__,
)
def test_one_short_line(shown: Any) -> None:
    assert "\n" not in repr(shown)
    assert len(repr(shown)) < 250


def test_a_deformation_says_what_it_holds() -> None:
    assert repr(ONE) == "<Deformation: 1 step (compose)>"
    assert repr(FIELD) == "<RBFInterpolant: 200 points in the plane, wendland_c2, trend affine>"
    in_space = Step((ControlPoints.from_arrays([[0, 0, 0]]),), None, name="hold", enabled=False)
    assert repr(in_space) == "<Step 'hold': 1 point in space, wendland_c2, trend affine, switched off>"

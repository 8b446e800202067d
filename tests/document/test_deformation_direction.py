"""Steps that are fitted forward: documents, scripts, warps, inverses and remarks on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

import deformnb as dn
from deformnb.document.deformation import Deformation, Step
from deformnb.document.json_format import from_json, to_json
from deformnb.document.script import as_python
from deformnb.document.step_checks import step_folds, step_quality, step_uncertainty
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.forward import ForwardFit
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.points import warp_points

GRID = Grid((4, 30, 50))
_AT = np.stack(np.meshgrid(np.linspace(3, 46, 5), np.linspace(3, 26, 4)), axis=-1).reshape(-1, 2)
POINTS = ControlPoints.from_arrays(_AT, _AT + 2.5 * np.sin(_AT[:, ::-1] / 9))
STEP = Step((POINTS,), Plane.from_view(GRID, "+z"), direction="forward", kernel="thin_plate")
NODES = np.stack(np.meshgrid(np.arange(50.0), np.arange(30.0), np.arange(4.0), indexing="ij"), axis=-1).reshape(-1, 3)


def add_depth(ab: np.ndarray) -> np.ndarray:
    return np.column_stack([ab, np.full(len(ab), 1.5)])


def test_documents_and_scripts_keep_the_direction() -> None:
    document = Deformation((STEP, replace(STEP, direction="backward")))
    text = to_json(document)
    assert text.count('"direction": "forward"') == 1  # that of the usual one is left out
    assert from_json(text) == document
    assert 'direction="forward"' in as_python(document, GRID)
    with pytest.raises(DeformError, match="unknown direction 'up'"):
        from_json(text.replace('"direction": "forward"', '"direction": "up"'))


@pytest.mark.parametrize(
    "steps",
    [
        (STEP,),
        (STEP, replace(STEP, direction="backward", kernel="wendland_c2")),
        (replace(STEP, stages=2),),
        (replace(STEP, strength=0.5),),
    ],
)
def test_a_volume_is_warped_to_the_places_of_the_inverse(steps: tuple[Step, ...]) -> None:
    rng = np.random.default_rng(0)
    smooth = (
        map_coordinates(
            rng.random((3, 6, 9)), np.indices(GRID.shape).reshape(3, -1) / [[2], [6], [6]], order=3, mode="nearest"
        )
        .reshape(GRID.shape)
        .astype(np.float32)
    )
    document = Deformation(steps)
    field = document.field(GRID)
    back = NODES + field.displacement(NODES)
    expected = map_coordinates(smooth, back[:, ::-1].T, order=1, mode="nearest")
    inside = ((back > 0) & (back < [49, 29, 3])).all(axis=1)
    warped = document.apply(Volume(smooth, GRID)).values[tuple(NODES[:, ::-1].T.astype(int))]
    assert np.abs(warped - expected)[inside].max() < 2e-3  # a hundredth of a voxel, of a range of 1 in some voxels


def test_points_go_forth_and_back() -> None:
    field = Deformation((STEP,)).field(GRID)
    moved, found = warp_points(add_depth(POINTS.source), field)
    assert found.all()
    assert np.abs(moved - add_depth(POINTS.target)).max() < 1e-9
    inverse = dn.invert(field, GRID)
    assert inverse.share > 0.8  # what leaves the box is not counted, places beyond the points may fold
    at = inverse.reached.reshape(-1)
    nodes = GRID.index_to_point(np.stack(np.unravel_index(np.arange(GRID.shape[0] * 1500), GRID.shape)[::-1], axis=-1))
    ends = nodes[at] + inverse.field.values.reshape(-1, 3)[at]
    assert np.abs(ends + field.displacement(ends) - nodes[at]).max() < 2e-3


def test_cuts_part_fits_forward_and_parts_are_refused() -> None:
    halves = replace(STEP, cuts=(Cut(HalfSpace((25.3, 0.0), (1.0, 0.0))),)).fits_of_regions(GRID)[0]
    assert len(halves) == 2
    for fit in halves.values():
        own = POINTS.take([POINTS.index(i) for i in fit.ids])
        assert isinstance(fit, ForwardFit)
        assert np.abs(fit.displacement(own.target) - own.displacement).max() < 1e-9
    slit = replace(STEP, cuts=(Cut(Line([(20, 15), (30, 15)], stops=(True, True))),)).field(GRID)
    assert np.abs(slit.displacement(add_depth(POINTS.target))[:, :2] - POINTS.displacement).max() < 1e-9
    part = RigidPart(HalfSpace((25.3, 0.0), (1.0, 0.0)), name="bone")
    with pytest.raises(DeformError, match="bone"):
        replace(STEP, parts=(part,))
    assert replace(STEP, parts=(replace(part, enabled=False),)).direction == "forward"


def test_errors_and_uncertainty_are_those_of_the_fit_forward() -> None:
    backward = replace(STEP, direction="backward")
    turned = replace(backward, maps=(ControlPoints.from_arrays(POINTS.target, POINTS.source),))
    assert step_quality(STEP, GRID).root_mean_square == pytest.approx(step_quality(turned, GRID).root_mean_square)
    assert step_folds(STEP, GRID).least > 0.3
    # At the points it is certain; in between it is that of the other fit, by the derivative of the inverse.
    spread = step_uncertainty(STEP, GRID)
    assert np.abs(spread.at(POINTS.target)).max() < 1e-4
    x = np.array([[20.0, 12.0], [31.0, 17.0]])
    y = warp_points(add_depth(x), STEP.field(GRID))[0][:, :2]
    slope = np.eye(2) + STEP.fits(GRID)[0].jacobian(y)
    expected = step_uncertainty(turned, GRID).at(x) * np.sqrt((slope**2).sum(axis=(1, 2)) / 2)
    assert spread.at(y) == pytest.approx(expected, rel=1e-3)

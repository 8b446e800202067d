"""Figure 7 of the paper: the wall of an abdomen cut open, with the organs and the spine left where they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import oracle
import pytest

from deformnb.datasets import PHANTOMS, load
from deformnb.document.deformation import Deformation, Step
from deformnb.imaging.figures import picture_field
from deformnb.imaging.projection import project
from deformnb.rbf.cuts import Cut, Decoupled
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Volume
from deformnb.warping.points import warp_points
from deformnb.warping.warper import warp_picture

SHAPE = (66, 53, 72)
BODY = PHANTOMS["abdomen"].make(SHAPE, noise=0)
FRONT = Plane.from_view(BODY.grid, "+y")
SUPPORT = 170.0
LUMBAR = [501, 502, 503, 504, 505]
WIDTH = np.array([26.0, 46, 54, 46, 26])
ENDS = np.array([[172.0, 62], [188, 62], [172, 278], [188, 278]])


def lips(a: float) -> np.ndarray:
    return np.column_stack([np.full(5, a), [100.0, 135, 170, 205, 240]])


def open_cut(plane: Plane, wall: float, gone: float, thickness: float) -> Step:
    """Both lips of a cut pulled apart; whole down to ``wall`` behind the first slice, nothing ``gone`` behind that."""
    out = WIDTH[:, None] * [1, 0]
    points = ControlPoints.from_arrays(
        np.concatenate([lips(168), lips(192), ENDS]), np.concatenate([lips(168) - out, lips(192) + out, ENDS])
    )
    depth = np.linspace(0, thickness, 151)
    curve = 0.5 + 0.5 * np.cos(np.pi * np.clip((depth - wall) / gone, 0, 1))
    return Step(
        (points,),
        plane,
        trend="none",
        support=SUPPORT,
        cuts=(Cut(Line([(180, 330), (180, 0)])),),
        extrusion="modulate",
        curve=tuple(curve),
    )


STEP = open_cut(FRONT, 52, 40, 264)


def decoupled(step: Step, volume: Volume) -> Decoupled:
    field = picture_field(step, volume.grid)
    assert isinstance(field, Decoupled)
    return field


# ---- on the picture --------------------------------------------------------------------------------------------------


def test_every_point_lands_with_its_side_of_the_cut() -> None:
    field = decoupled(STEP, BODY)
    landed, found = warp_points(STEP.points.source, field)
    assert found.all()
    assert np.abs(landed - STEP.points.target).max() < 1e-3
    assert sorted(field.sides) == [(False,), (True,)]


@pytest.mark.parametrize("height", [100.0, 135.0, 170.0, 222.0])
def test_the_gap_is_as_wide_as_the_edges_have_moved(height: float) -> None:
    field = decoupled(STEP, BODY)
    edges = [
        warp_points([[180.0, height]], fit)[0][0]
        for _, fit in field.fields_by_source(np.array([[180.0, height]]))
        if fit is not None
    ]
    row = np.linspace(60, 300, 4801)
    empty = (1 - field.opacity(np.column_stack([row, np.full(len(row), edges[0][1])]))).sum() * (row[1] - row[0])
    wide = abs(edges[0][0] - edges[1][0])
    oracle.assert_close(edges[0][1], edges[1][1], atol=1e-6)  # both edges at the same height: the cut is symmetric
    oracle.assert_close(empty, wide, atol=0.1 * BODY.grid.spacing[0])


def test_a_rigid_pull_opens_the_cut_by_the_drag() -> None:
    """The edge moves with equally displaced points of a side: the gap is the displacement, 2 x 30 mm."""
    pull = np.repeat([-30.0, 30.0], 5)[:, None] * [1, 0]
    sources = np.concatenate([lips(168), lips(192)])
    step = replace(STEP, maps=(ControlPoints.from_arrays(sources, sources + pull),), trend="translation")
    row = np.linspace(60, 300, 4801)
    empty = (1 - decoupled(step, BODY).opacity(np.column_stack([row, np.full(len(row), 150.0)]))).sum() * 0.05
    oracle.assert_close(empty, 60.0, atol=0.1 * BODY.grid.spacing[0])


def test_the_background_is_seen_through_the_gap_and_nowhere_else() -> None:
    picture = project(BODY, FRONT, "shaded")
    above = warp_picture(picture.values, picture.raster, decoupled(STEP, BODY), fill=0.0)
    middle, beside = (np.abs(picture.raster.columns - a).argmin() for a in (180, 90))
    row = np.abs(picture.raster.rows - 170).argmin()
    assert above[row, middle, 3] == 0.0
    assert above[row, beside, 3] > 0.5
    assert above[np.abs(picture.raster.rows - 40).argmin(), middle, 3] > 0.5  # above the end of the slit


# ---- in the volume ---------------------------------------------------------------------------------------------------


def test_nothing_moves_beyond_the_support() -> None:
    field = decoupled(STEP, BODY)
    places = np.stack(np.meshgrid(np.arange(-200, 560, 7.0), np.arange(-200, 530, 7.0)), -1)
    reach = np.linalg.norm(places[..., None, :] - STEP.points.target, axis=-1).min(axis=-1)
    assert np.abs(field.displacement(places)[reach >= SUPPORT]).max() == 0.0
    assert np.abs(field.displacement(places)[reach < SUPPORT]).max() > 20


def test_neither_side_folds() -> None:
    places = np.stack(np.meshgrid(np.arange(0, 360, 5.0), np.arange(0, 330, 5.0)), -1)
    for fit in decoupled(STEP, BODY).fields:
        assert np.linalg.det(np.eye(2) + fit.jacobian(places)).min() > 0.2


def test_the_spine_stays_and_the_wall_opens() -> None:
    labels = PHANTOMS["abdomen"].labels(SHAPE)
    after = Deformation((STEP,)).apply(labels).values
    spine = np.isin(labels.values, LUMBAR)
    assert spine.sum() > 500
    assert (after == labels.values)[spine].all()
    places = BODY.grid.index_to_point(np.argwhere(spine)[:, ::-1])
    moved = Deformation((STEP,)).field(BODY.grid).displacement(places)
    assert np.abs(moved).max() < 0.1 * min(BODY.grid.spacing)
    # In the middle of the opening the first voxels with tissue were the wall; now they are behind it.
    column = (33, slice(None), 36)
    before = np.flatnonzero(BODY.values[column] > 30)[0]
    behind = np.flatnonzero(Deformation((STEP,)).apply(BODY).values[column] > 30)[0]
    assert (behind - before) * BODY.grid.spacing[1] > 25


def test_little_tissue_is_lost() -> None:
    """Measured at this resolution and at twice that: 0.7 % of the voxels are squeezed or covered."""
    opened = Deformation((STEP,)).apply(BODY)
    share = (opened.values > 30).sum() / (BODY.values > 30).sum()
    assert 0.985 < share < 1.0


@pytest.mark.nightly
def test_the_real_abdomen_opens_too(real_data: Callable[[str], Path]) -> None:
    scan = load("abdomen_ct", folder=real_data("abdomen_ct.nii.gz").parent)
    step = open_cut(Plane.from_view(scan.grid, "+y"), 75, 40, 300)
    opened = Deformation((step,)).apply(scan)
    assert opened.dtype == scan.dtype
    bone = scan.values > 300  # the spine, the ribs and the hips; in front there is none but the pubis, below the cut
    rows = scan.grid.index_to_point(np.argwhere(bone)[:, ::-1])
    depth = step.plane.to_plane(rows)[:, 2] + 150  # type: ignore[union-attr]
    back = np.flatnonzero(bone)[depth > 120]
    assert len(back) > 5000
    oracle.assert_close(opened.values.reshape(-1)[back], scan.values.reshape(-1)[back], atol=0)
    tissue = [(v.values > -200).sum() for v in (scan, opened)]
    assert 0.97 < tissue[1] / tissue[0] < 1.0
    # The hole in the front: air where there was fat and muscle, in the middle of the cut.
    first = [
        np.flatnonzero(
            project(v, step.plane.shifted(0.0), "slice", depth=-82.0).values[170 // 3]  # type: ignore[union-attr]
            > -200
        )
        for v in (scan, opened)
    ]
    gone = np.setdiff1d(first[0], first[1]) * 3.0
    assert gone.size * 3 > 60
    assert abs(gone.mean() - 180) < 12

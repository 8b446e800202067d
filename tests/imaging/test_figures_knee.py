"""Figure 4 of the paper: a knee bent by points, trends and rigid parts; and a real knee, scanned straight and bent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest

from deformnb.datasets import PHANTOMS
from deformnb.document.deformation import Deformation, Step
from deformnb.imaging.figures import picture_field
from deformnb.imaging.projection import project
from deformnb.io import read_volume
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Mask, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Volume
from deformnb.warping.points import warp_points

SHAPE = (100, 64, 44)
KNEE = PHANTOMS["knee"].make(SHAPE, noise=0)
SIDE = Plane.from_view(KNEE.grid, "-x")
BEND = RigidMotion.turn(-40, about=(67, 140), shift=(2, 4))
FEMUR_END = [
    (47, 100),
    (44, 120),
    (38, 135),
    (40, 150),
    (48, 160),
    (60, 165),
    (75, 165),
    (88, 160),
    (96, 150),
    (97, 138),
    (86, 126),
    (76, 105),
]
CALF = [(72, 270)]
SHAFT = np.array([(70.0, 175), (70, 295)])
ACROSS = np.array([(52.0, 240), (90, 240)])
POINTS = ControlPoints.from_arrays(np.array(FEMUR_END + CALF), np.concatenate([FEMUR_END, BEND(CALF)]))


@cache
def labels() -> Volume:
    return PHANTOMS["knee"].labels(SHAPE)


def rigid_step() -> Step:
    femur, shin = (Mask.from_labels(labels(), which).silhouette(SIDE) for which in (95, [96, 97]))
    return Step((ControlPoints.empty(2),), SIDE, parts=(RigidPart(femur), RigidPart(shin, BEND)))


def shares(field: AbstractField) -> tuple[float, float, float]:
    """Length and width of the shaft of the shin relative to those before, and the angle it has turned by."""
    (p, q, r, s), found = warp_points(np.concatenate([SHAFT, ACROSS]), field)
    assert found.all()
    return (
        float(np.linalg.norm(q - p) / 120),
        float(np.linalg.norm(s - r) / 38),
        float(np.degrees(np.arctan2(*(q - p)))),
    )


# ---- trends ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("trend", ["affine", "similarity", "rigid"])
def test_every_trend_puts_the_points_where_they_were_dragged(trend: str) -> None:
    landed, found = warp_points(POINTS.source, picture_field(Step((POINTS,), SIDE, trend=trend), KNEE.grid))
    assert found.all()
    assert np.abs(landed - POINTS.target).max() < 1e-3


def test_affine_squashes_the_shin_and_rigid_does_so_less() -> None:
    width = {
        trend: shares(picture_field(Step((POINTS,), SIDE, trend=trend), KNEE.grid))[1]
        for trend in ("affine", "similarity", "rigid")
    }
    assert width["affine"] > 1.5  # half as wide again: the paper's "unrealistic squashing"
    assert width["similarity"] < 1.3
    assert width["rigid"] <= width["similarity"]
    assert width["rigid"] > 1.01  # a trend alone preserves no bone


def test_how_far_the_shin_turns_depends_on_the_support() -> None:
    angles = [
        shares(picture_field(Step((POINTS,), SIDE, trend="rigid", support=r), KNEE.grid))[2]
        for r in (60.0, 120, 240, 480)
    ]
    assert np.all(np.diff(angles) > 1.0)
    assert angles[0] < 40 < angles[-1]


# ---- rigid parts -----------------------------------------------------------------------------------------------------


def test_rigid_parts_keep_the_bones() -> None:
    length, width, angle = shares(picture_field(rigid_step(), KNEE.grid))
    oracle.assert_close([length, width, angle], [1, 1, 40], atol=1e-9)


def test_in_the_voxels_the_bones_keep_their_length_within_a_percent() -> None:
    step = rigid_step()
    after = Deformation((step,)).apply(labels())
    for part, bone in zip(step.parts, (95, 96), strict=True):
        (long_before, count_before), (long_after, count_after) = extent(labels(), bone, None), extent(after, bone, part)
        assert abs(long_after / long_before - 1) < 0.01
        assert abs(count_after / count_before - 1) < 0.01
    same = labels().values == 95
    assert (after.values[same] == 95).all()


def extent(volume: Volume, bone: int, part: RigidPart | None) -> tuple[float, int]:
    """Root of the largest variance of a bone's voxels, a length, and their number; only where a part has gone."""
    places = volume.grid.index_to_point(np.argwhere(volume.values == bone)[:, ::-1])
    if part is not None:
        seen = SIDE.to_plane(places)[:, :2]
        back = seen if part.motion is None else part.motion.inverse(seen)
        places = places[part.region.signed_distance(back) <= 0]
    return float(np.sqrt(np.linalg.eigvalsh(np.cov(places.T))[-1])), len(places)


def test_the_wedge_that_the_shin_has_left_shows_little_of_it_again() -> None:
    """Between parts that come apart the blend of their backward motions passes the place where the shin was."""
    step = rigid_step()
    after = Deformation((step,)).apply(labels())
    again = (after.values == 96).sum() - extent(after, 96, step.parts[1])[1]
    assert 0 <= again < 0.09 * (labels().values == 96).sum()


def test_the_smallest_set_that_bends_is_two_parts_and_no_point() -> None:
    after = Deformation((rigid_step(),)).apply(KNEE)
    seen = project(after, SIDE)
    tip = BEND([[70.0, 285.0]])[0]  # where the marrow of the shin's end goes
    a, b = seen.raster.columns, seen.raster.rows
    assert seen.values[np.abs(b - tip[1]).argmin(), np.abs(a - tip[0]).argmin()] > 150
    assert seen.values[np.abs(b - 285).argmin(), np.abs(a - 40).argmin()] == 0


# ---- the labels of the SPL atlas -------------------------------------------------------------------------------------


def test_the_bones_of_the_spl_atlas_are_kept_too(real_data: Callable[[str], Path]) -> None:
    atlas = read_volume(real_data("knee_labels.nrrd"), is_labels=True)
    coarse = replace(
        atlas,
        values=np.ascontiguousarray(atlas.values[::2, ::7, ::7]),
        grid=replace(
            atlas.grid,
            shape=atlas.values[::2, ::7, ::7].shape,  # type: ignore[arg-type]
            spacing=tuple(float(s) * k for s, k in zip(atlas.grid.spacing, (7, 7, 2), strict=True)),
        ),
    )
    femur, shin = Mask.from_labels(coarse, 95), Mask.from_labels(coarse, [96, 97])
    joint = np.array(
        [
            coarse.grid.index_to_point(np.argwhere(np.isin(coarse.values, which))[:, ::-1]).mean(axis=0)
            for which in (95, [96, 97])
        ]
    ).mean(axis=0)
    bend = RigidMotion.turn(20, about=joint, axis=(1, 0, 0))
    step = Step((ControlPoints.empty(3),), None, parts=(RigidPart(femur), RigidPart(shin, bend)))
    field = Deformation((step,)).field(coarse.grid)
    tibia = coarse.grid.index_to_point(np.argwhere(coarse.values == 96)[:, ::-1])
    moved = bend(tibia)
    free = np.asarray(femur.signed_distance(moved) > 0)  # where the turned shin does not run into the thigh bone
    assert free.mean() > 0.95
    oracle.assert_close(moved[free] + field.displacement(moved[free]), tibia[free], atol=1e-9)
    thigh = coarse.grid.index_to_point(np.argwhere(coarse.values == 95)[:, ::-1])
    apart = np.asarray(shin.signed_distance(bend.inverse(thigh)) > 0)
    assert np.abs(field.displacement(thigh[apart])).max() == 0.0


# ---- a real knee, straight and bent ----------------------------------------------------------------------------------

# (x, z) in the straight scan and in the bent one, read by eye on the slices y = 24 and y = 34.
FEMUR = [((91, 43.5), (86, 49.5)), ((84, 54.5), (79, 61)), ((80, 58.5), (75, 64.5)), ((84, 90), (79.3, 96))]
SHIN = [
    ((66, 34), (55, 46)),
    ((93.5, 38.5), (81.5, 43.5)),
    ((95, 30), (81.5, 34)),
    ((74.5, 12), (54.2, 24)),
    ((69.5, 39.5), (59, 51.5)),
]
SKIN = [
    ((58, 70), (51, 66)),
    ((113, 60), (108, 62)),
    ((108, 36), (98, 38)),
    ((38, 5), (17, 20)),
    ((56, 110), (54, 110)),
    ((112, 100), (110, 100)),
]
OUTLINES = (
    [
        (84, 128),
        (84, 80),
        (80.5, 64),
        (79, 57),
        (84, 49),
        (91, 43.5),
        (100, 46),
        (105, 55),
        (103, 64),
        (99.5, 75),
        (98, 128),
    ],
    [(67, 39), (70, 40.5), (82, 40), (94, 36), (95, 30), (93, 20), (88, 0), (74, 0), (74, 20), (68, 31)],
)


def project_places(places: Any) -> np.ndarray:
    return np.asarray(np.array(places, dtype=float) * [1, -1] + [0, 127])


def control_points(pairs: Any) -> ControlPoints:
    return ControlPoints.from_arrays(*(project_places([pair[k] for pair in pairs]) for k in (0, 1)))


def motion(pairs: Any) -> RigidMotion:
    """The rigid motion that fits landmarks best: a strongly smoothed fit is its trend."""
    fit = fit_rbf(control_points(pairs), trend="rigid", smoothing=1e6, support=100.0)
    corners = np.array([[0.0, 0], [1, 0], [0, 1]])
    back = fit.displacement(corners) + corners
    return RigidMotion((back[1:] - back[0]).T, back[0]).inverse


@cache
def real_results(straight: Path, bent: Path) -> dict[str, np.ndarray]:
    """Correlation and mean difference from the bent scan over (thigh bone, shin, all), (3, 2), by method of bending."""
    volume, truth = read_volume(straight), read_volume(bent)
    side = Plane.from_view(volume.grid, "+y")
    moves, outlines = [motion(FEMUR), motion(SHIN)], [Polygon(project_places(o)) for o in OUTLINES]
    parts = tuple(RigidPart(o, m) for o, m in zip(outlines, moves, strict=True))
    few = control_points([*FEMUR, SHIN[3]])
    ways: dict[str, Step] = {trend: Step((few,), side, trend=trend) for trend in ("affine", "similarity", "rigid")}
    ways["parts"] = Step((ControlPoints.empty(2),), side, parts=parts)
    ways["parts and skin"] = Step((control_points(SKIN),), side, parts=parts, trend="none")
    pixels = project(volume, side, "slice").raster.points()
    masks = [o.signed_distance(m.inverse(pixels)) < 0 for o, m in zip(outlines, moves, strict=True)]
    masks.append(np.ones_like(masks[0]))
    found = {}
    for name, after in {"nothing": volume, **{n: Deformation((s,)).apply(volume) for n, s in ways.items()}}.items():
        a, b = (v.values[::-1, 16:42].astype(float) for v in (after, truth))
        both = [(a[m], b[m]) for m in (np.repeat(mask[:, None], 26, axis=1) for mask in masks)]
        found[name] = np.array([(np.corrcoef(p, q)[0, 1], np.abs(p - q).mean()) for p, q in both])
    return found


@pytest.fixture
def real_knee(real_data: Callable[[str], Path]) -> dict[str, np.ndarray]:
    return real_results(real_data("knee_mr_straight.nrrd"), real_data("knee_mr_bent.nrrd"))


def test_the_landmarks_of_a_bone_move_rigidly_within_a_voxel_and_a_half() -> None:
    for pairs, degrees in ((FEMUR, 0.4), (SHIN, 18.3)):
        moved = motion(pairs)
        points = control_points(pairs)
        assert np.linalg.norm(moved(points.source) - points.target, axis=1).max() < 1.5
        turn = np.degrees(np.arctan2(moved.matrix[1][0], moved.matrix[0][0]))
        oracle.assert_close(turn, degrees, atol=0.1)


def test_rigid_parts_reproduce_the_bent_bones(real_knee: dict[str, np.ndarray]) -> None:
    """Measured: thigh bone 0.65 -> 0.93, shin -0.03 -> 0.86."""
    (femur, shin, _), (femur_before, shin_before, _) = real_knee["parts"], real_knee["nothing"]
    assert femur_before[0] < 0.7
    assert shin_before[0] < 0.1
    assert femur[0] > 0.92
    assert shin[0] > 0.84
    assert femur[1] < 0.5 * femur_before[1]
    assert shin[1] < 0.4 * shin_before[1]


def test_the_papers_order_of_the_trends_holds_on_a_real_knee(real_knee: dict[str, np.ndarray]) -> None:
    shin = {name: rows[1, 0] for name, rows in real_knee.items()}
    assert shin["nothing"] < shin["affine"] - 0.3 < shin["rigid"] - 0.5
    assert abs(shin["similarity"] - shin["rigid"]) < 0.02
    assert shin["rigid"] < shin["parts"] - 0.05


def test_the_flesh_needs_points_on_the_skin(real_knee: dict[str, np.ndarray]) -> None:
    whole = {name: rows[2] for name, rows in real_knee.items()}
    assert whole["nothing"][0] < 0.5
    assert whole["parts and skin"][0] > 0.87
    assert whole["parts and skin"][0] == max(row[0] for row in whole.values())
    assert whole["parts and skin"][1] == min(row[1] for row in whole.values())
    oracle.assert_close(real_knee["parts and skin"][:2], real_knee["parts"][:2], atol=0.005)  # the bones as before

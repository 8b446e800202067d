"""Results of deformations as layers, compared with the package's own functions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from napari.layers import Image, Labels, Points, Shapes, Surface, Tracks

import deformnb as dn
from deformnb.errors import DeformError
from napari_deformnb.results import (
    COARSE_VOXELS,
    Calculator,
    VisiblePart,
    coarse_grid,
    coarsening,
    deform_layer,
    grid_lines,
)
from napari_deformnb.subject import Subject


@pytest.fixture
def subject(ball: dn.Volume) -> Subject:
    return Subject(Image(ball.values, **_attributes(ball)))


def _attributes(volume: dn.Volume) -> dict[str, Any]:
    return dict(dn.interop.to_napari(volume)[0][1])


@pytest.fixture
def bump(ball: dn.Volume) -> dn.Deformation:
    x, y, z = ball.grid.center
    points = dn.ControlPoints.from_arrays([[x, y, z]], [[x + 3, y + 2, z - 1]], unit="mm")
    return dn.Deformation.from_space_points(points, trend="none", support=14.0)


def test_a_full_result_is_that_of_the_package(subject: Subject, bump: dn.Deformation, ball: dn.Volume) -> None:
    found = Calculator(subject).full(bump, "made")
    expected = bump.apply(ball)
    assert np.array_equal(found.array, expected.values)  # type: ignore[arg-type]
    assert (expected.values != ball.values).mean() > 0.02


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_preview_of_a_slice_is_that_slice_of_the_full_result(
    subject: Subject, bump: dn.Deformation, ball: dn.Volume, axis: int
) -> None:
    found = Calculator(subject).preview(bump, VisiblePart(axis, 7))
    assert found.array is not None
    assert np.array_equal(found.array, bump.apply(ball).values.take(7, axis=axis))


@pytest.mark.parametrize("is_colour", [False, True], ids=["grey", "colours"])
def test_a_preview_of_a_picture_is_its_full_result(is_colour: bool) -> None:
    values = np.random.default_rng(3).integers(0, 255, (20, 30, 3), np.uint8)
    picture = Subject(Image(values, rgb=True) if is_colour else Image(values[..., 0]))
    points = dn.ControlPoints.from_arrays([[0, 0], [29, 0], [0, 19], [15, 10]], [[0, 0], [29, 0], [0, 19], [18, 12]])
    bend = dn.Deformation.from_picture_points(picture.grid, dn.Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), points)
    found, full = (Calculator(picture).preview(bend, VisiblePart(0, 0)), Calculator(picture).full(bend, "bent"))
    assert found.array is not None
    assert found.array.shape == picture.to_array(list(picture.volumes)).shape
    assert np.array_equal(found.array, full.array)


def test_a_preview_of_a_large_volume_is_coarse_and_lies_where_the_full_one_does() -> None:
    volume = dn.Volume.from_array(np.tile(np.arange(128, dtype=np.float32), (96, 100, 1)))
    factor = coarsening(volume.grid)
    assert factor == 2
    assert volume.grid.size > COARSE_VOXELS
    still = dn.Deformation.from_space_points(dn.ControlPoints.from_arrays([[9, 9, 9]], [[9, 9, 9]]), trend="none")
    found = Calculator(Subject(Image(volume.values))).preview(still, VisiblePart())
    assert found.array is not None
    assert found.array.shape == volume.shape
    # Each pair of voxels has the value between them: half a voxel from both.
    assert np.abs(found.array - volume.values).max() == pytest.approx(0.5)
    assert coarse_grid(dn.Grid((4, 4, 4), 2.0), 2).origin == (1, 1, 1)


def test_folds_are_warnings_with_the_sentence_of_the_package(subject: Subject, ball: dn.Volume) -> None:
    x, y, z = ball.grid.center
    points = dn.ControlPoints.from_arrays([[x, y, z]], [[x + 9, y, z]], unit="mm")
    folding = dn.Deformation.from_space_points(points, trend="none", support=10.0)
    found = Calculator(subject).full(folding, "made")
    assert found.warnings[0].startswith("The map folds: det J is -")
    with pytest.warns(dn.DeformWarning, match="The map folds"):
        assert found.warnings[0] in folding.apply(ball).notes


def test_lines_of_the_grid_move_with_the_tissue(subject: Subject, bump: dn.Deformation) -> None:
    still = grid_lines(subject, dn.Deformation(()), VisiblePart(0, 5), 4)
    lines = grid_lines(subject, bump, VisiblePart(0, 5), 4)
    assert lines.shape == still.shape
    assert (lines[:, 0, 0] == 5).all()  # drawn on the slice that is shown
    assert (lines[:, 1, 0] == 0).all()
    starts = np.concatenate([np.full((len(still), 1), 5.0), still[:, 0, 1:]], axis=1)
    expected, _ = bump.warp_points(subject.to_points(starts), subject.grid)
    assert np.allclose(lines[:, 0, 1:], subject.to_index(expected)[:, 1:], atol=1e-9)
    assert np.abs(lines - still).max() > 0.5
    everywhere = grid_lines(subject, bump, VisiblePart(), 4)
    assert len(np.unique(np.sign(everywhere[:, 1]).round(), axis=0)) > 3
    with pytest.raises(DeformError, match="from 1 to 64 cells"):
        grid_lines(subject, bump, VisiblePart(), 65)


def test_labels_on_a_finer_grid_are_deformed_by_the_nearest(subject: Subject, bump: dn.Deformation) -> None:
    grid = subject.grid.resampled(spacing=np.asarray(subject.grid.spacing) / 2)
    values = (np.indices(grid.shape).sum(axis=0) // 5 % 7).astype(np.int32)
    layer = Labels(values, **_attributes(dn.Volume(values, grid, is_labels=True)))
    data, attributes, kind = deform_layer(layer.as_layer_data_tuple(), subject, bump, Subject(layer))
    expected = dn.warp(dn.Volume(values, grid, is_labels=True), bump)
    assert kind == "labels"
    assert attributes["name"].endswith("deformed")
    assert np.array_equal(data, expected.values)
    assert set(np.unique(data)) == set(range(7))


def test_points_with_a_place_of_their_own_go_along(subject: Subject, bump: dn.Deformation, ball: dn.Volume) -> None:
    center = np.array(ball.grid.center)
    places = np.add(center, [(0, 0, 0), (1, 2, 1), (900, 0, 0)])
    layer = Points((places[:, ::-1] - (1, 2, 3)) / 4 * 1000, scale=(4, 4, 4), translate=(1000, 2000, 3000), units="um")
    data, _, _ = deform_layer(layer.as_layer_data_tuple(), subject, bump, None)
    moved = (np.asarray(data) * 4 / 1000 + (1, 2, 3))[:, ::-1]
    expected, _ = dn.warp_points(places, bump, grid=ball)
    assert np.allclose(moved, expected, atol=1e-6)
    assert np.allclose(moved[0], np.add(center, (3, 2, -1)), atol=1e-4)
    assert np.allclose(moved[2], places[2])


def test_shapes_bend_along_their_edges(subject: Subject, bump: dn.Deformation) -> None:
    index = subject.to_index([subject.grid.center])[0]
    corners = index + np.array([(0, -6, -6), (0, -6, 6), (0, 6, 6), (0, 6, -6)])
    layer = Shapes([corners, corners[:2], corners], shape_type=["rectangle", "line", "ellipse"], **subject.place())
    data, attributes, kind = deform_layer(layer.as_layer_data_tuple(), subject, bump, None)
    assert kind == "shapes"
    assert attributes["shape_type"] == ["polygon", "path", "polygon"]
    assert [len(one) for one in data] == [32, 9, 64]
    expected, _ = bump.warp_points(subject.to_points(corners), subject.grid)
    assert np.allclose(data[0][::8], subject.to_index(expected), atol=1e-6)
    assert np.allclose(data[1][[0, -1]], subject.to_index(expected)[:2], atol=1e-6)
    Shapes(data, **attributes)


def test_surfaces_move_by_their_vertices(subject: Subject, bump: dn.Deformation) -> None:
    vertices = subject.to_index([subject.grid.center, np.add(subject.grid.center, 1), np.add(subject.grid.center, 2)])
    layer = Surface((vertices, np.array([[0, 1, 2]]), np.array([1.0, 2, 3])), **subject.place())
    data, _, kind = deform_layer(layer.as_layer_data_tuple(), subject, bump, None)
    assert kind == "surface"
    expected, _ = bump.warp_points(subject.to_points(vertices), subject.grid)
    assert np.allclose(subject.to_points(data[0]), expected, atol=1e-5)
    assert data[2].tolist() == [1, 2, 3]


@pytest.mark.parametrize(
    ("layer", "words"),
    [
        (Points(np.zeros((1, 2)), name="flat"), "the layer 'flat' has 2 dimensions and the deformed one 3"),
        (
            Tracks([[0, 0, 1, 1, 1], [0, 1, 1, 1, 2]], name="way"),
            "the layer 'way' is of tracks, which cannot be deformed",
        ),
    ],
)
def test_other_layers_are_refused_with_the_reason(
    subject: Subject, bump: dn.Deformation, layer: Any, words: str
) -> None:
    with pytest.raises(DeformError, match=words):
        deform_layer(layer.as_layer_data_tuple(), subject, bump, None)

"""Control points on slices and in space as coordinates of layers, in literal numbers."""

from __future__ import annotations

import numpy as np
import pytest
from napari.layers import Image

from deformnb.errors import DeformError
from napari_deformnb import drawing
from napari_deformnb.subject import Subject

SUBJECT = Subject(Image(np.zeros((4, 5, 6)), scale=(5, 1, 2), translate=(10, 20, 30)))


@pytest.mark.parametrize(
    ("displayed", "axis", "place"),
    [
        ((1, 2), 0, (6, 2)),  # to the right x: 3 voxels of 2; down y: 2 voxels of 1
        ((2, 1), 0, (2, 6)),
        ((0, 2), 1, (6, 5)),  # down z: 1 voxel of 5
        ((0, 1), 2, (2, 5)),
    ],
)
def test_points_on_a_slice_are_right_and_down_from_its_first_voxel(
    displayed: tuple[int, int], axis: int, place: tuple[float, float]
) -> None:
    plane = drawing.plane_of_slice(SUBJECT, displayed)
    assert drawing.axis_of_plane(SUBJECT, plane) == axis
    assert drawing.from_layer(SUBJECT, plane, [[1, 2, 3]])[0] == pytest.approx(place)
    shown = drawing.to_layer(SUBJECT, plane, [place], depth=3)[0]
    assert shown[axis] == 3
    assert np.delete(shown, axis) == pytest.approx(np.delete((1, 2, 3), axis))


def test_points_in_space_are_in_the_world() -> None:
    assert drawing.from_layer(SUBJECT, None, [[1, 2, 3]]).tolist() == [[36, 22, 15]]
    assert drawing.to_layer(SUBJECT, None, [[36, 22, 15]], depth=0).tolist() == [[1, 2, 3]]


def test_points_of_a_picture_have_two_coordinates() -> None:
    picture = Subject(Image(np.zeros((5, 6)), scale=(2, 3)))
    plane = drawing.plane_of_slice(picture, (0, 1))
    assert drawing.from_layer(picture, plane, [[1, 2]]).tolist() == [[6, 2]]
    assert drawing.to_layer(picture, plane, [[6, 2]], depth=0).tolist() == [[1, 2]]


def test_axes_of_other_layers_are_refused() -> None:
    with pytest.raises(DeformError, match="does not show two axes of this layer"):
        drawing.plane_of_slice(SUBJECT, (1, 1))

"""Layers as volumes: napari's own coordinates are those of the grid, in literal numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from napari.layers import Image, Labels, Points

import deformnb as dn
from deformnb.errors import DeformError
from napari_deformnb.subject import Subject

# A quarter turn of y and x: what goes along x by napari goes along -y, and then everything is shifted by 100 along y.
AFFINE = np.array([[1, 0, 0, 0], [0, 0, -1, 100], [0, 1, 0, 0], [0, 0, 0, 1]], float)


@pytest.mark.parametrize(
    ("place", "point"),
    [
        ({}, (3, 2, 1)),
        ({"scale": (5, 1, 2)}, (6, 2, 5)),
        ({"scale": (5, 1, 2), "translate": (10, 20, 30)}, (36, 22, 15)),
        ({"scale": (5, 1, 2), "translate": (10, 20, 30), "affine": AFFINE}, (22, 64, 15)),
        ({"scale": (5, 1, 2), "rotate": AFFINE[:3, :3]}, (2, -6, 5)),
    ],
    ids=["plain", "scale", "translate", "affine", "rotate"],
)
def test_the_world_of_a_layer_is_space_with_x_first(place: dict[str, Any], point: tuple[float, ...]) -> None:
    layer = Image(np.zeros((4, 5, 6)), **place)
    subject = Subject(layer)
    assert subject.to_points([[1, 2, 3]])[0] == pytest.approx(point, abs=1e-9)
    assert np.asarray(layer.data_to_world((1, 2, 3)))[::-1] == pytest.approx(point, abs=1e-9)
    assert subject.to_index([point])[0] == pytest.approx((1, 2, 3), abs=1e-9)
    copy = Points([(1, 2, 3)], **subject.place())
    assert np.asarray(copy.data_to_world((1, 2, 3)))[::-1] == pytest.approx(point, abs=1e-9)


def test_units_are_those_of_the_layer() -> None:
    micrometres = Subject(Image(np.zeros((4, 5, 6)), scale=(2, 1, 1), units=("um", "um", "um")))
    assert micrometres.grid.unit == "µm"
    mixed = Subject(Image(np.zeros((4, 5, 6)), scale=(2, 1, 1), units=("mm", "um", "um")))
    assert mixed.grid.spacing == pytest.approx((1, 1, 2000))
    assert Subject(Image(np.zeros((4, 5, 6)))).grid.unit == ""


def test_a_picture_is_one_slice() -> None:
    subject = Subject(Image(np.zeros((5, 6)), scale=(2, 3), translate=(10, 20)))
    assert (subject.ndim, subject.grid.shape) == (2, (1, 5, 6))
    assert subject.to_points([[1, 2]]).tolist() == [[26, 12, 0]]
    assert subject.to_index([[26, 12, 0]]).tolist() == [[1, 2]]


@pytest.mark.parametrize(
    "layer",
    [
        Image(np.random.default_rng(1).integers(0, 255, (4, 5, 6), np.uint8), scale=(2, 1, 1), colormap="red"),
        Image(np.random.default_rng(1).integers(0, 255, (4, 5, 3), np.uint8), rgb=True),
        Image(np.random.default_rng(1).integers(0, 255, (4, 5, 6, 4), np.uint8), rgb=True),
        Labels(np.random.default_rng(1).integers(0, 9, (4, 5, 6)).astype(np.int64)),
        Labels(np.eye(5, dtype=bool)),
    ],
    ids=["image", "picture in colours", "volume in colours", "labels of 64 bits", "a mask"],
)
def test_results_look_as_the_layer(layer: Any) -> None:
    subject = Subject(layer)
    data, attributes, kind = subject.to_layer(list(subject.volumes), "made")
    assert data.shape == layer.data.shape
    assert np.array_equal(data, layer.data)
    assert kind == type(layer).__name__.lower()
    assert attributes["name"] == "made"
    made = type(layer)(data, **attributes)
    assert np.array_equal(made.data_to_world((1,) * layer.ndim), layer.data_to_world((1,) * layer.ndim))
    assert subject.volumes[0].is_labels == (kind == "labels")
    if kind == "image" and not layer.rgb:
        assert made.colormap.name == "red"


def test_a_result_in_another_box_is_at_its_place() -> None:
    subject = Subject(Image(np.zeros((4, 5, 6)), scale=(5, 1, 2)))
    box = dn.Grid((2, 2, 2), (1, 1, 1), (7, 8, 9))
    data, attributes, _ = subject.to_layer([dn.Volume(np.zeros((2, 2, 2)), box)], "box")
    assert data.shape == (2, 2, 2)
    assert Image(data, **attributes).data_to_world((0, 0, 0)) == (9, 8, 7)


@pytest.mark.parametrize(
    ("layer", "words"),
    [
        (
            Points(np.zeros((1, 3)), name="dots"),
            "the layer 'dots' is of points; choose a layer of",
        ),
        (Image(np.zeros((2, 3, 4, 5))), "has 4 dimensions, and 2 or 3 can be deformed: choose Split Stack"),
        (
            Image(np.zeros((3, 4, 5)), shear=(0.5, 0, 0)),
            "shear is [0.5, 0.0, 0.0]; a volume has straight axes",
        ),
        (Image([np.zeros((8, 8, 8)), np.zeros((4, 4, 4))], multiscale=True), "is multiscale: add one of its levels"),
    ],
    ids=["points", "four dimensions", "shear", "pyramid"],
)
def test_what_cannot_be_deformed_is_refused_with_the_reason(layer: Any, words: str) -> None:
    with pytest.raises(DeformError) as caught:
        Subject(layer)
    assert words in str(caught.value)


def test_data_in_chunks_are_refused() -> None:
    dask = pytest.importorskip("dask.array")
    with pytest.raises(DeformError, match="chunks"):
        Subject(Image(dask.zeros((4, 5, 6), chunks=2), contrast_limits=(0, 1)))

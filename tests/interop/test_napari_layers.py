"""Layers of napari: round trips, and napari itself makes layers of them."""

from __future__ import annotations

import numpy as np
import pytest

import deformnb as dn
from deformnb.interop import from_napari, to_napari

TURNED = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))


def _volume(direction: object = dn.Grid((1, 1, 1)).direction, *, is_labels: bool = False) -> dn.Volume:
    grid = dn.Grid((3, 4, 5), (1.0, 2.0, 0.5), (7.0, -3.0, 11.0), direction)  # type: ignore[arg-type]
    return dn.Volume(np.arange(60, dtype=np.uint8).reshape(3, 4, 5), grid, "voxels", is_labels)


@pytest.mark.parametrize("is_labels", [False, True], ids=["image", "labels"])
@pytest.mark.parametrize("direction", [dn.Grid((1, 1, 1)).direction, TURNED], ids=["straight", "turned and mirrored"])
def test_a_volume_comes_back_as_it_went(direction: object, is_labels: bool) -> None:
    volume = _volume(direction, is_labels=is_labels)
    [layer] = to_napari(volume)
    back = from_napari(layer)
    assert isinstance(back, dn.Volume)
    assert layer[2] == ("labels" if is_labels else "image")
    assert back.is_labels == is_labels
    assert back.name == "voxels"
    assert np.shares_memory(back.values, volume.values)
    assert back.grid.is_like(volume.grid)


def test_the_world_of_a_layer_is_scale_shear_rotation_translation_and_affine() -> None:
    # A quarter turn about z in napari's order (z, y, x): index (0, 0, 1) along x goes 2 along -y, then to +x.
    rotate = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    affine = np.eye(4)
    affine[:3, 3] = (0, 0, 100)
    attributes = {"scale": (3, 1, 2), "rotate": rotate, "translate": (0, 5, 0), "shear": (0, 0, 0), "affine": affine}
    volume = from_napari((np.zeros((2, 3, 4)), attributes, "image"))
    assert isinstance(volume, dn.Volume)
    assert np.allclose(volume.grid.index_to_point([1, 0, 0]), (100, 5 - 2, 0))
    assert np.allclose(volume.grid.index_to_point([0, 1, 0]), (100 + 1, 5, 0))
    assert np.allclose(volume.grid.index_to_point([0, 0, 1]), (100, 5, 3))


def test_channels_are_layers_in_their_colours_and_colours_are_one() -> None:
    stained = dn.volume.Channels.from_array(np.zeros((3, 4, 5, 2), np.uint16), names=("nuclei", "actin"))
    layers = to_napari(stained)
    assert [attributes["name"] for _, attributes, _ in layers] == ["nuclei", "actin"]
    assert [attributes["colormap"][1].tolist() for _, attributes, _ in layers] == [[0, 1, 0, 1], [1, 0, 1, 1]]
    photo = dn.volume.Channels.from_array(np.arange(60, dtype=np.uint8).reshape(1, 4, 5, 3), kind="rgb")
    [colours] = to_napari(photo)
    back = from_napari(colours)
    assert isinstance(back, dn.volume.Channels)
    assert np.array_equal(back.values, photo.values)


@pytest.mark.parametrize(
    ("layer", "said"),
    [
        (([], {}, "shapes"), "neither an image"),
        ((np.zeros((2, 2, 2, 2)), {}, "image"), "pick one time"),
        ((np.zeros((2, 2, 2)), {"scale": (1, 1)}, "image"), "3 numbers"),
        (4, "tuple"),
        ((np.zeros((2, 2, 2)), {"shear": (0.5, 0, 0)}, "image"), "straight axes"),
        (([np.zeros((2, 2, 2))], {}, "image"), "pyramid"),
    ],
)
def test_what_is_no_volume_is_refused(layer: object, said: str) -> None:
    with pytest.raises(dn.DeformError, match=said):
        from_napari(layer)
    with pytest.raises(dn.DeformError, match="a Volume is needed"):
        to_napari(object())  # type: ignore[arg-type]


@pytest.mark.nightly
def test_napari_makes_layers_of_it() -> None:
    layers = pytest.importorskip("napari.layers")
    turned = _volume(TURNED)
    marks = dn.warping.Landmarks([[1.0, 2.0, 3.0]], ("tip",))
    stained = dn.volume.Channels.from_array(np.arange(120, dtype=np.uint8).reshape(3, 4, 5, 2))
    for given in (turned, _volume(is_labels=True), marks, stained):
        parts = list(given) if isinstance(given, dn.volume.Channels) else [given]
        for data, expected in zip(to_napari(given), parts, strict=True):
            back = from_napari(layers.Layer.create(*data))
            if isinstance(expected, dn.Volume):
                assert isinstance(back, dn.Volume)
                assert back.grid.is_like(expected.grid)
                assert np.array_equal(back.values, expected.values)
            else:
                assert isinstance(back, dn.warping.Landmarks)
                assert back.points.tolist() == marks.points.tolist()
                assert back.names == marks.names

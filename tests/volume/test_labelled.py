"""Volumes of xarray's arrays: places of the coordinates, and the attributes that dn.warp preserves."""

from __future__ import annotations

import numpy as np
import pytest
import xarray

import deformnb as dn
from deformnb.rbf.fields import Affine

SHIFT = Affine(np.eye(3), np.array([1.0, 0.0, 0.0]))  # output(x) = input(x + 1)


def _array() -> xarray.DataArray:
    values = np.arange(24.0).reshape(2, 3, 4)
    coords = {
        "z": [10.0, 12.0],
        "y": [0.0, 1.0, 2.0],
        "x": [5.0, 6.0, 7.0, 8.0],
        "subject": 7,
        "name": ("z", ["a", "b"]),
    }
    return xarray.DataArray(values, coords, ("z", "y", "x"), "grey", {"unit": "HU"})


def test_coordinates_are_places_and_falling_ones_point_back() -> None:
    array = _array()
    volume = dn.volume.from_xarray(array)
    assert volume.grid == dn.Grid((2, 3, 4), (1, 1, 2), (5, 0, 10))
    turned = dn.volume.from_xarray(array.isel(x=slice(None, None, -1)).transpose("x", "z", "y"))
    assert turned.grid.origin == (8, 0, 10)
    assert turned.grid.direction[0][0] == -1
    assert turned.values[1, 2, 0] == volume.values[1, 2, 3]


def test_a_turned_volume_keeps_its_direction_as_itk_writes_it() -> None:
    turned = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    volume = dn.Volume.from_array(np.zeros((2, 3, 4)), (1, 2, 3), (4, 5, 6), turned, "scan")
    array = dn.volume.to_xarray(volume)
    assert array.attrs["direction"].tolist() == [[-1, 0, 0], [0, 0, 1], [0, -1, 0]]  # rows and columns z, y, x
    assert dn.volume.from_xarray(array).grid == volume.grid


def test_warp_keeps_dims_coordinates_and_attributes_and_moves_all_channels() -> None:
    array = _array()
    both = xarray.concat([array, -array], dim="c").transpose("y", "c", "x", "z")
    result = dn.warp(both, SHIFT, fill=-99)
    assert result.dims == both.dims
    assert result.attrs == {"unit": "HU"}
    assert result.name == "grey"
    for name in ("x", "y", "z", "subject", "name"):
        assert result.coords[name].equals(both.coords[name])
    moved = np.concatenate([array.values[..., 1:], np.full((2, 3, 1), -99.0)], axis=2)
    assert np.array_equal(result.isel(c=0).transpose("z", "y", "x"), moved)
    assert np.array_equal(result.isel(c=1).transpose("z", "y", "x")[..., :3], -moved[..., :3])


def test_another_grid_of_the_result_has_its_own_coordinates() -> None:
    result = dn.warp(_array(), SHIFT, output=dn.Grid((2, 3, 2), (1, 1, 2), (6, 0, 10)))
    assert result.coords["x"].values.tolist() == [6, 7]
    assert result.values[0, 0].tolist() == [2, 3]
    assert "subject" in result.coords
    assert "name" not in result.coords  # it is one of the old slices


def test_a_picture_is_one_slice() -> None:
    picture = _array().isel(z=0)
    assert dn.volume.from_xarray(picture).shape == (1, 3, 4)
    assert dn.warp(picture, SHIFT).values[:, :3].tolist() == picture.values[:, 1:].tolist()


@pytest.mark.parametrize(
    ("array", "said"),
    [
        (_array().assign_coords(x=[0.0, 1.0, 2.0, 9.0]), "not evenly spaced"),
        (_array().rename(x="time"), "dimensions z, y, x"),
        (_array().expand_dims(t=2), "has t too"),
        (_array().assign_coords(x=list("abcd")), "no places"),
        (_array().assign_attrs(direction=[1, 2]), "3 x 3"),
        ([1, 2], "DataArray"),
    ],
    ids=["uneven", "time", "four", "text", "direction", "list"],
)
def test_what_is_no_volume_is_refused(array: object, said: str) -> None:
    with pytest.raises(dn.DeformError, match=said):
        dn.volume.from_xarray(array)


class _InChunks:
    """An array with the interface that dask, Zarr and h5py have in common."""

    chunks, shape, dtype = (64, 64, 64), (2048, 2048, 1024), np.dtype(np.uint16)

    def __array__(self, *_: object, **__: object) -> None:
        raise AssertionError("it was loaded")


def test_an_array_in_chunks_is_never_loaded_without_a_word() -> None:
    with pytest.raises(dn.DeformError, match=r"8192 MiB.*chunked\.warp"):
        dn.Volume.from_array(_InChunks())  # type: ignore[arg-type]

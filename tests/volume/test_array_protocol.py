"""Slices, operators and NumPy's functions on volumes and pictures, against plain arrays and places in space."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import deformnb as dn
from deformnb.errors import DeformError

TURN = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
GRID = dn.Grid((4, 5, 6), (0.5, 1.0, 2.0), (7.0, -3.0, 11.0), TURN, "mm")
VALUES = np.random.default_rng(0).integers(0, 200, GRID.shape).astype(np.uint8)
VOLUME = dn.Volume(VALUES, GRID, "a box", notes=("2 voxels are not finite, shown as background", "read twice"))
OTHER = dn.Volume((VALUES % 7).astype(np.int16), GRID)


@pytest.mark.parametrize(
    "key",
    [
        np.s_[1:3],
        np.s_[:, 2:],
        np.s_[..., -3:-1],
        np.s_[1:, ..., 4:],
        np.s_[::2, 1::3, ::5],
        np.s_[3:100],
        np.s_[...],
        np.s_[:, :, :],
    ],
)
def test_slices_keep_every_voxel_at_its_place(key: Any) -> None:
    part = VOLUME[key]
    np.testing.assert_array_equal(part.values, VALUES[key])
    k, j, i = (axis[key] for axis in np.meshgrid(*map(np.arange, GRID.shape), indexing="ij"))
    places = GRID.index_to_point(np.stack([i, j, k], axis=-1))
    nz, ny, nx = part.shape
    k, j, i = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    np.testing.assert_allclose(part.grid.index_to_point(np.stack([i, j, k], axis=-1)), places, atol=1e-12)
    assert (part.name, part.grid.unit, part.grid.direction) == ("a box", "mm", TURN)
    assert part.notes == ("read twice",)  # what was said of all voxels need not be so of these
    assert np.shares_memory(part.values, VALUES)


def test_a_part_has_the_notes_of_its_own_voxels() -> None:
    whole = dn.Volume.from_array(np.array([[[np.nan, 1.0]], [[2.0, 3.0]], [[4.0, 4.0]]]))
    assert whole.notes == ("1 voxel is not finite, shown as background",)
    assert whole[1:].notes == ()
    assert whole[:1].notes == ("1 voxel is not finite, shown as background",)
    assert whole[2:].notes[0].startswith("every voxel has the value 4:")


def test_a_part_of_a_memory_map_is_not_read() -> None:
    flat = np.zeros((2, 3, 4), np.int16)
    flat.flags.writeable = False
    assert np.shares_memory(dn.Volume.from_array(flat)[1:].values, flat)


def test_numbers_and_masks_leave_arrays() -> None:
    assert VOLUME[1].shape == (5, 6)
    assert VOLUME[1, 2, 3] == VALUES[1, 2, 3]
    np.testing.assert_array_equal(VOLUME[1:3, 0], VALUES[1:3, 0])
    np.testing.assert_array_equal(VOLUME[VOLUME > 100], VALUES[VALUES > 100])
    np.testing.assert_array_equal(VOLUME[VALUES > 100], VALUES[VALUES > 100])
    with pytest.raises(IndexError):
        VOLUME[4]
    with pytest.raises(TypeError, match="item assignment"):
        VOLUME[0] = 1  # type: ignore[index]


@pytest.mark.parametrize(
    ("key", "sentence"),
    [
        (np.s_[::-1], "has a step of 1 or more, got -1, which would reverse an axis"),
        (np.s_[::0], "has a step of 1 or more, got 0"),
        (np.s_[3:3], "the slice 3:3 leaves no voxel of an axis of 4"),
        (np.s_[:, 9::2], "the slice 9::2 leaves no voxel of an axis of 5"),
        (np.s_[:, :, :, :], "an array of 3 axes takes as many slices, got 4"),
        (np.s_[..., 1:, ...], "an array of 3 axes takes as many slices, got 1"),
    ],
)
def test_other_slices_are_refused_in_a_sentence(key: Any, sentence: str) -> None:
    with pytest.raises(DeformError, match=re.escape(sentence)):
        VOLUME[key]


def test_crop_is_the_part_of_the_grid_of_that_name() -> None:
    part = VOLUME.crop((1, 0, 2), (2, 5, 3))
    assert part.grid == GRID.crop((1, 0, 2), (2, 5, 3))
    np.testing.assert_array_equal(part.values, VALUES[1:3, 0:5, 2:5])
    for start, shape in (((-1, 0, 0), (1, 1, 1)), ((0, 0, 0), (5, 1, 1))):
        with pytest.raises(DeformError, match="reaches outside the volume of \\(4, 5, 6\\)"):
            VOLUME.crop(start, shape)
    with pytest.raises(DeformError, match="at least one voxel along each of z, y, x"):
        VOLUME.crop((0, 0, 0), (0, 1, 1))


BINARY = [operator.add, operator.sub, operator.mul, operator.truediv, operator.floordiv, operator.mod]
BINARY += [operator.lt, operator.le, operator.gt, operator.ge, np.maximum, np.hypot]


@pytest.mark.parametrize("compute", BINARY)
@pytest.mark.parametrize("other", [2, 1.5, OTHER, np.float32(3), np.full(GRID.shape, 3), np.arange(1, 7)])
@pytest.mark.filterwarnings("ignore:divide by zero", "ignore:invalid value")
def test_operators_compute_as_numpy_and_keep_the_grid(compute: Callable[[Any, Any], Any], other: Any) -> None:
    plain = np.asarray(other) if isinstance(other, dn.Volume) else other
    pairs = ((VOLUME, other), (VALUES, plain)), ((other, VOLUME), (plain, VALUES))
    for of_volumes, of_arrays in pairs:
        found, wanted = compute(*of_volumes), compute(*of_arrays)
        assert isinstance(found, dn.Volume)
        assert found.grid == GRID
        np.testing.assert_array_equal(found.values, wanted)


def test_functions_of_one_volume_keep_the_grid() -> None:
    for compute in (
        np.sqrt,
        np.abs,
        np.isfinite,
        operator.neg,
        operator.pos,
        operator.invert,
        abs,
        np.square,
        lambda v: v**2,
    ):
        found = compute(VOLUME)
        assert found.grid == GRID
        np.testing.assert_array_equal(found.values, compute(VALUES))
    share, whole = np.modf(VOLUME)
    np.testing.assert_array_equal(share.values + whole.values, VALUES)
    assert share.grid == whole.grid == GRID


def test_sums_are_arrays_and_numbers() -> None:
    assert np.sum(VOLUME) == VALUES.sum()
    assert np.mean(VOLUME) == VALUES.mean()
    np.testing.assert_array_equal(np.max(VOLUME, axis=0), VALUES.max(axis=0))
    np.testing.assert_array_equal(np.percentile(VOLUME, [1, 99]), np.percentile(VALUES, [1, 99]))
    into = np.empty(GRID.shape)
    assert np.sqrt(VOLUME, out=into) is into


def test_masks_and_labels() -> None:
    mask = (VOLUME > 50) & (VOLUME < 100)
    assert (mask.dtype, mask.is_labels) == (np.bool_, True)
    labels = OTHER.mark_labels(True)
    assert (labels + 1).is_labels
    assert not (labels * 0.5).is_labels
    assert not (labels + VOLUME).is_labels
    np.testing.assert_array_equal((labels == 3).values, VALUES % 7 == 3)
    np.testing.assert_array_equal((labels != 3).values, VALUES % 7 != 3)  # type: ignore[attr-defined]
    assert (labels == 3).grid == GRID
    assert (labels == OTHER) is False  # two objects, though of equal voxels
    np.testing.assert_array_equal(np.equal(labels, OTHER).values, True)


def test_types_are_numpys_or_the_next_that_a_volume_has() -> None:
    assert (VOLUME + 1).dtype == np.uint8
    assert (VOLUME + np.int64(2**40)).dtype == np.float64
    assert VOLUME.astype("float16").dtype == np.float32
    assert VOLUME.astype(np.float64).grid == GRID
    with pytest.raises(DeformError, match="complex voxels are not supported"):
        VOLUME * 1j


def test_other_grids_and_shapes_are_refused() -> None:
    moved = dn.Volume(VALUES, dn.Grid(GRID.shape, GRID.spacing))
    for compute in (operator.add, operator.gt, np.equal, lambda a, b: a[b > 0]):
        with pytest.raises(DeformError, match=r"on different grids, of \(4, 5, 6\) and \(4, 5, 6\) voxels"):
            compute(VOLUME, moved)
    resampled = dn.Deformation().apply(VOLUME[::2], output=VOLUME)
    assert (resampled + VOLUME).grid == GRID  # as the sentence says
    with pytest.raises(DeformError, match=r"the result has the shape \(2, 4, 5, 6\)"):
        VOLUME + np.zeros((2, 4, 5, 6))
    with pytest.raises(DeformError, match="never changed in place: make another one, for example volume = volume"):
        operator.iadd(VOLUME, 1)
    with pytest.raises(TypeError):
        VOLUME + "1"  # type: ignore[operator]


def test_equal_places_in_other_units_count_as_one_grid() -> None:
    found = VOLUME + VOLUME.to_unit("um")
    assert found.grid == GRID
    np.testing.assert_array_equal(found.values, VALUES + VALUES)


def test_a_volume_without_a_grid_names_the_way() -> None:
    with pytest.raises(DeformError, match=r"needs the grid of its voxels; Volume.from_array\(array, spacing, origin\)"):
        dn.Volume(VALUES)


def test_pictures_are_arrays() -> None:
    grey = dn.project(VOLUME, "+z")
    assert np.asarray(grey) is grey.values
    assert (grey.shape, grey.ndim, grey.dtype) == (grey.values.shape, 2, np.uint8)
    assert np.asarray(grey, np.float64).dtype == np.float64
    assert not np.shares_memory(np.array(grey), grey.values)
    with pytest.raises(ValueError, match="do not become float32 without a copy"):
        np.array(grey, dtype=np.float32, copy=False)
    shown = Figure().add_subplot().imshow(grey)  # type: ignore[arg-type]
    np.testing.assert_array_equal(shown.get_array(), grey.values)
    coloured = dn.project(VOLUME, "+z", "shaded")
    assert np.asarray(coloured).shape == (*grey.shape, 4)


def test_plots_are_in_lengths() -> None:
    given = Figure().add_subplot()
    axes = VOLUME.plot("+z", "slice", ax=given)
    picture = dn.project(VOLUME, "+z", "slice")
    assert axes is given
    assert tuple(axes.images[0].get_extent()) == picture.extent
    np.testing.assert_array_equal(axes.images[0].get_array(), picture.rgb8())
    assert (axes.get_xlabel(), axes.get_title()) == ("x (mm)", "a box")


def test_xarray_as_a_method_like_its_neighbours() -> None:
    pytest.importorskip("xarray")
    array = VOLUME.to_xarray()
    assert array.dims == ("z", "y", "x")
    back = dn.Volume.from_xarray(array, is_labels=True)
    assert (back.grid, back.is_labels) == (GRID, True)

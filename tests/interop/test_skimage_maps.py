"""Maps for scikit-image: places of a literal shift, and fields that have no map."""

from __future__ import annotations

import numpy as np
import pytest

import deformnb as dn
from deformnb.interop import skimage_coordinates, skimage_map, to_sitk_transform
from deformnb.rbf.fields import Affine


def test_a_map_of_a_raster_counts_columns_and_rows() -> None:
    raster = dn.Raster((4, 6), (0.5, 2.0), (10.0, 20.0))
    shift = Affine(np.eye(2), np.array([1.0, 6.0]))  # D = (1, 6): two columns and three rows
    assert skimage_map(shift, raster)([[0, 0], [1, 2]]).tolist() == [[2, 3], [3, 5]]
    coordinates = skimage_coordinates(shift, raster)
    assert coordinates.shape == (2, 4, 6)
    assert coordinates[:, 1, 2].tolist() == [4, 4]  # (row, column)


def test_coordinates_of_a_turned_grid_are_indices() -> None:
    grid = dn.Grid((2, 3, 4), (1.0, 2.0, 4.0), (5, 6, 7), ((0, -1, 0), (1, 0, 0), (0, 0, 1)))
    shift = Affine(np.eye(3), np.array([-2.0, 3.0, 4.0]))  # three voxels along x, one along y, one along z
    assert np.allclose(skimage_coordinates(shift, grid) - np.indices(grid.shape), np.reshape([1, 1, 3], (3, 1, 1, 1)))


def test_what_has_no_map_is_refused() -> None:
    volume = dn.Volume.from_array(np.zeros((4, 5, 6)))
    plane, space = Affine(np.eye(2), np.zeros(2)), Affine(np.eye(3), np.zeros(3))
    line = dn.Line([(2.0, -9.0), (2.0, 9.0)])
    points = dn.ControlPoints.from_arrays([[1, 1], [4, 1]], [[0, 1], [5, 1]])
    cut = dn.Deformation.from_picture_points(volume, "+z", points, cuts=(dn.Cut(line),))
    for call, said in (
        (lambda: skimage_map(space, volume), "4 slices"),
        (lambda: skimage_coordinates(plane, volume), "in space"),
        (lambda: skimage_coordinates(cut, volume), "cuts"),
        (lambda: to_sitk_transform(plane, volume), "over a plane"),
        (lambda: to_sitk_transform(cut, volume), "cuts"),
        (lambda: dn.io.to_vtk_transform(cut, volume), "cuts"),
        (lambda: skimage_map(plane, dn.Raster((2, 2), (1, 1), (0, 0)))([1, 2]), r"\(M, 2\)"),
    ):
        with pytest.raises(dn.DeformError, match=said):
            call()

"""Deformations for VTK: its grid transform maps points equally, and image data hold the displacements."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyvista
from format_table import bound
from vtkmodules.vtkFiltersHybrid import vtkGridTransform
from vtkmodules.vtkImagingCore import vtkImageReslice

import deformnb as dn
from deformnb.errors import DeformError, VolumeFileError
from deformnb.io.transforms.formats import read_transform, write_transform
from deformnb.io.transforms.vtk import to_vtk_transform
from deformnb.rbf.fields import DisplacementField
from deformnb.volume.volume import Grid, Volume

RANDOM = np.random.default_rng(3)
PLAIN = Grid((8, 9, 10), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), unit="mm")
TURNED = Grid((8, 9, 10), (1.0, 2.0, 3.0), (4.0, 5.0, 6.0), ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), "mm")


@pytest.mark.parametrize("grid", [PLAIN, TURNED], ids=["plain", "turned"])
def test_vtk_maps_points_as_the_field_does(grid: Grid, tmp_path: Path) -> None:
    field = DisplacementField(RANDOM.normal(size=(*grid.shape, 3)), grid)
    points = grid.index_to_point(RANDOM.uniform(0, 7, (40, 3)))
    known = points + field.displacement(points)
    mapped = np.array([to_vtk_transform(field, grid).TransformPoint(point) for point in points.tolist()])
    assert np.abs(mapped - known).max() < bound("transforms", "vti", "VTK")

    write_transform(field, tmp_path / "a.vti", grid)
    image = pyvista.read(tmp_path / "a.vti")
    np.testing.assert_array_equal(image.direction_matrix, grid.direction)
    assert b"<!-- backward: " in (tmp_path / "a.vti").read_bytes()
    vectors = image.point_data["displacement_backward"].reshape(*grid.shape, 3)
    assert np.abs(vectors - field.values).max() < bound("transforms", "vti", "VTK")
    again = read_transform(tmp_path / "a.vti")
    assert isinstance(again, DisplacementField)
    assert again.lattice == grid
    np.testing.assert_array_equal(again.values, vectors)


def test_a_reslice_with_it_is_the_warp(tmp_path: Path) -> None:
    volume = Volume(RANDOM.uniform(0, 255, PLAIN.shape).astype(np.float32), PLAIN)
    field = DisplacementField(RANDOM.normal(size=(*PLAIN.shape, 3)), PLAIN)
    transform = to_vtk_transform(field, PLAIN)
    assert isinstance(transform, vtkGridTransform)
    reslice = vtkImageReslice()
    reslice.SetInputData(volume.to_pyvista())
    reslice.SetResliceTransform(transform)
    reslice.SetInterpolationModeToLinear()
    reslice.SetBackgroundLevel(-1.0)
    reslice.Update()
    found = pyvista.wrap(reslice.GetOutput()).active_scalars.reshape(PLAIN.shape)
    known = dn.warp(volume, field, fill=-1.0).values
    inside = (found != -1) & (known != -1)
    assert inside.mean() > 0.4
    assert np.abs(found - known)[inside].max() < 0.02  # 1e-4 of a step, where neighbours differ by up to 255


def test_what_has_no_vectors_or_is_a_plane_is_refused(tmp_path: Path) -> None:
    dn.write_volume(Volume.from_array(np.zeros((3, 4, 5))), tmp_path / "a.vti")
    with pytest.raises(VolumeFileError, match="no array of three components"):
        read_transform(tmp_path / "a.vti")
    image = pyvista.ImageData(dimensions=(3, 4, 5))
    image["v"] = np.full((60, 3), np.nan)
    image.save(tmp_path / "b.vti")
    with pytest.raises(VolumeFileError, match="not finite"):
        read_transform(tmp_path / "b.vti")
    at = [[6.0, -20.0], [8.0, -10.0], [9.0, -25.0]]
    with pytest.raises(DeformError, match="over a plane"):
        to_vtk_transform(dn.fit_rbf(dn.ControlPoints.from_arrays(at, at)), PLAIN)

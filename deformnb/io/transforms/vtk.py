"""Deformations for VTK: vtkGridTransform, and its displacements as image data (.vti).

A vtkGridTransform adds the displacement that it interpolates at a point. Used as the reslice transform of a
vtkImageReslice it is a backward map, as fields are here.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from deformnb._typing import Progress
from deformnb.checks import optional_package
from deformnb.io.transforms.displacement_images import check_displacements
from deformnb.io.volumes.vti import read_vectors, write_vectors
from deformnb.rbf.fields import AbstractField, HasField, as_transform_field, convert_unit
from deformnb.volume.volume import IDENTITY, Grid, VolumeLike, as_grid


def to_vtk_transform(transform: AbstractField | HasField, grid: Grid | VolumeLike) -> Any:
    """A vtkGridTransform with the displacements at the voxels of a grid, interpolated linearly.

    Parameters
    ----------
    transform : a field in space, or a Deformation of a volume on ``grid``.
    grid : whose voxels are the samples; lengths of the transform are millimetres where its unit is known.

    Returns
    -------
    vtkGridTransform. It has no directions of axes: on a grid that is turned, a vtkGeneralTransform with one between
    the maps to the axes of the grid and back.

    Raises
    ------
    DeformError
        If the field is over a plane.
    MissingPackageError
        If VTK is not installed.

    Examples
    --------
    >>> from deformnb.rbf.fields import Affine
    >>> shift = to_vtk_transform(Affine(np.eye(3), np.array([0.0, 0.0, 5.0])), Grid((4, 4, 4)))
    >>> shift.TransformPoint((1.0, 1.0, 1.0))
    (1.0, 1.0, 6.0)
    """
    own = as_grid(grid)
    lattice = own.to_unit("mm")
    field = convert_unit(as_transform_field(transform, own), own.unit, lattice.unit)
    pyvista, vtk = optional_package("pyvista"), optional_package("vtkmodules.vtkFiltersHybrid")
    turned = np.asarray(lattice.direction)
    plain = lattice.direction == IDENTITY
    nz, ny, nx = lattice.shape
    image = pyvista.ImageData(
        dimensions=(nx, ny, nz), spacing=lattice.spacing, origin=lattice.origin if plain else (0.0, 0.0, 0.0)
    )
    image.point_data["displacement"] = (field.sample_on_grid(lattice) @ turned).reshape(-1, 3)
    image.point_data.active_scalars_name = "displacement"
    made = vtk.vtkGridTransform()
    made.SetDisplacementGridData(image)
    made.SetInterpolationModeToLinear()
    made.Update()
    if plain:
        return made
    common = optional_package("vtkmodules.vtkCommonTransforms")
    to_space = np.eye(4)
    to_space[:3, :3], to_space[:3, 3] = turned, lattice.origin
    whole = common.vtkGeneralTransform()
    whole.PostMultiply()
    whole.Concatenate(np.linalg.inv(to_space).ravel().tolist())
    whole.Concatenate(made)
    whole.Concatenate(to_space.ravel().tolist())
    return whole


def read_vti_field(path: Path, _grid: Grid | None) -> AbstractField:
    """The field of the vectors at the points of a VTI file."""
    return check_displacements(path, *read_vectors(path))


def write_vti_field(
    field: AbstractField, path: Path, grid: Grid, remark: str, overwrite: bool, progress: Progress | None
) -> None:
    """Write the displacements at the voxels of a grid, float32, as vectors named displacement_backward or _forward."""
    name = f"displacement_{remark.partition(':')[0]}"
    write_vectors(field.sample_on_grid(grid), grid, name, remark, path, overwrite, progress)

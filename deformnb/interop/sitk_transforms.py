"""A deformation as a transform of SimpleITK, for its resampling and registration filters."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import optional_package
from deformnb.rbf.fields import AbstractField, HasField, as_transform_field
from deformnb.volume.units import ratio
from deformnb.volume.volume import Grid, VolumeLike, as_grid


def to_sitk_transform(field: AbstractField | HasField, grid: Grid | VolumeLike) -> Any:
    """The ``SimpleITK.DisplacementFieldTransform`` of a deformation.

    ITK's resampling samples the input for every voxel of the result, so the transform is the backward map, as here.

    Parameters
    ----------
    field : backward displacements in space, or a Deformation; of several steps it is their composition.
    grid : whose voxels are the samples, in float64; ITK interpolates linearly between them, and takes no displacement
        outside. Lengths of the transform are millimetres where the unit of the grid is known.

    Raises
    ------
    DeformError
        If the field is over a plane, or has cuts, which no transform can hold.
    MissingPackageError
        Without SimpleITK.

    See Also
    --------
    deformnb.write_transform : the same as a file.

    Examples
    --------
    >>> import numpy as np, SimpleITK as sitk
    >>> import deformnb as dn
    >>> volume = dn.Volume.from_array(np.broadcast_to(np.arange(20.0), (20, 20, 20)))
    >>> points = dn.ControlPoints.from_arrays([[5, 10, 10]], [[8, 10, 10]])
    >>> transform = dn.interop.to_sitk_transform(dn.Deformation.from_space_points(points, support=30.0), volume)
    >>> transform.GetName()
    'DisplacementFieldTransform'
    >>> resampled = sitk.Resample(volume.to_sitk(), transform)
    >>> round(resampled.GetPixel(8, 10, 10), 4)
    5.0
    """
    lattice = as_grid(grid)
    values = as_transform_field(field, lattice).sample_on_grid(lattice).astype(np.float64)
    sitk = optional_package("SimpleITK")
    values *= ratio(lattice.unit, "mm")
    return sitk.DisplacementFieldTransform(image_of_vectors(sitk, values, lattice.to_unit("mm")))


def image_of_vectors(sitk: Any, values: NDArray[np.floating[Any]], grid: Grid) -> Any:
    """An image of SimpleITK of vectors (nz, ny, nx, 3) at the voxels of a grid."""
    image = sitk.GetImageFromArray(np.ascontiguousarray(values), isVector=True)
    image.SetSpacing(grid.spacing)
    image.SetOrigin(grid.origin)
    image.SetDirection(np.ravel(grid.direction).tolist())
    return image

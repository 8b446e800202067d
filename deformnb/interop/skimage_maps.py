"""Maps for ``skimage.transform.warp``: a callable for pictures, an array of coordinates for volumes.

scikit-image samples the input for every pixel of the result, as :mod:`deformnb.warping` does, so the map is the
backward one. Its callables take and give places as (column, row), its arrays of coordinates have the rows first.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField, HasField, as_field
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid, VolumeLike, as_grid


def skimage_map(
    field: AbstractField | HasField, lattice: Grid | Raster | VolumeLike
) -> Callable[[ArrayLike], NDArray[np.float64]]:
    """The ``inverse_map`` of ``skimage.transform.warp`` for a picture.

    Parameters
    ----------
    field : backward displacements on a plane, for a Raster; in space, or a Deformation, for a volume of one slice.
    lattice : of the pixels of the picture: a Raster, or a volume of one slice (or its grid).

    Returns
    -------
    A callable: places (M, 2) as (column, row) in the result to the places in the input that are seen there.

    Raises
    ------
    DeformError
        If the volume has several slices (use :func:`skimage_coordinates`) or the field has another dimension.

    Examples
    --------
    >>> import numpy as np, skimage.transform
    >>> import deformnb as dn
    >>> picture = dn.Volume.from_array(np.tile(np.arange(20.0), (20, 1)))        # grey values rise from left to right
    >>> points = dn.ControlPoints.from_arrays([[5, 10]], [[8, 10]])              # what was at column 5 goes to column 8
    >>> deformation = dn.Deformation.from_picture_points(picture, "+z", points, support=30.0)
    >>> inverse_map = dn.interop.skimage_map(deformation, picture)
    >>> warped = skimage.transform.warp(picture.values[0], inverse_map, preserve_range=True)
    >>> round(float(warped[10, 8]), 6)
    5.0
    """
    if isinstance(lattice, Raster):
        on_plane = _field_of_dimension(as_field(field), 2)
        spacing, origin = np.asarray(lattice.spacing), np.asarray(lattice.origin)
        return lambda places: _pixels(places) + on_plane.displacement(_pixels(places) * spacing + origin) / spacing
    grid = as_grid(lattice)
    if grid.shape[0] != 1:
        raise DeformError(
            f"a callable map is for pictures, and this volume has {grid.shape[0]} slices; "
            "skimage_coordinates(field, volume) makes an array of coordinates for it."
        )
    in_space = _field_of_dimension(as_field(field, grid), 3)

    def look_up(places: ArrayLike) -> NDArray[np.float64]:
        index = np.pad(_pixels(places), ((0, 0), (0, 1)))
        points = grid.index_to_point(index)
        return grid.point_to_index(points + in_space.displacement(points))[:, :2]

    return look_up


def skimage_coordinates(field: AbstractField | HasField, lattice: Grid | Raster | VolumeLike) -> NDArray[np.float64]:
    """The coordinates for ``skimage.transform.warp`` or ``scipy.ndimage.map_coordinates``, of a volume or a picture.

    Parameters
    ----------
    field : backward displacements, or a Deformation.
    lattice : a volume or its grid; or a Raster, for a field on its plane.

    Returns
    -------
    (3, nz, ny, nx): slice, row and column in the input for each voxel of the result; (2, nv, nu) for a Raster. They
    take 24 (16) bytes to a voxel.

    Examples
    --------
    >>> import numpy as np, skimage.transform
    >>> import deformnb as dn
    >>> volume = dn.Volume.from_array(np.broadcast_to(np.arange(20.0), (20, 20, 20)), spacing=(2, 1, 1))
    >>> points = dn.ControlPoints.from_arrays([[10, 10, 10]], [[16, 10, 10]])    # from column 5 to column 8
    >>> bump = dn.Deformation.from_space_points(points, support=30.0)
    >>> coordinates = dn.interop.skimage_coordinates(bump, volume)
    >>> warped = skimage.transform.warp(volume.values, coordinates, preserve_range=True)
    >>> round(float(warped[10, 10, 8]), 4)
    5.0
    """
    if isinstance(lattice, Raster):
        index = np.stack(np.meshgrid(*(np.arange(float(n)) for n in lattice.shape[::-1])), axis=-1)
        found = skimage_map(field, lattice)(index.reshape(-1, 2)).reshape(index.shape)
        return np.ascontiguousarray(np.moveaxis(found[..., ::-1], -1, 0))
    grid = as_grid(lattice)
    moves = _field_of_dimension(as_field(field, grid), 3).sample_on_grid(grid) @ grid.inverse.T
    coordinates = np.indices(grid.shape, dtype=np.float64)
    coordinates += np.moveaxis(moves[..., ::-1], -1, 0)
    return coordinates


def _field_of_dimension(field: AbstractField, dim: int) -> AbstractField:
    if field.dim != dim:
        raise DeformError(
            f"this needs a field {'over a plane' if dim == 2 else 'in space'}, and the one given is "
            f"{'over a plane' if field.dim == 2 else 'in space'}; a Raster goes with the first, a volume "
            "with the second."
        )
    if field.has_cuts:
        raise DeformError(
            "this deformation has cuts, which hide tissue, and a map alone cannot represent that; dn.warp applies it."
        )
    return field


def _pixels(places: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(places, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 2:
        raise DeformError(f"pixels are (column, row) pairs of shape (M, 2), got {short_value(places)}.")
    return array

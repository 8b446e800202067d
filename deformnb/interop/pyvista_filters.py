"""A deformation as a filter of pyvista's data sets: images are resampled, points of meshes are moved."""

from __future__ import annotations

from typing import Any

import numpy as np

from deformnb._typing import Progress
from deformnb.checks import optional_package
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField, HasField
from deformnb.volume.volume import Grid, Volume, VolumeLike
from deformnb.warping.points import Landmarks, warp_points
from deformnb.warping.warper import deform_volumes


def warp_pyvista(
    data: Any,
    field: AbstractField | HasField,
    grid: Grid | VolumeLike | None = None,
    *,
    progress: Progress | None = None,
) -> Any:
    """A pyvista data set deformed: an ImageData on the same points, any data set with explicit points moved.

    Parameters
    ----------
    data : ``pyvista.ImageData``, whose point data are all deformed by one map; or a PolyData, UnstructuredGrid or
        StructuredGrid, whose points move forward with the tissue (:func:`deformnb.warp_points`). Data of cells stay
        with the cells of a mesh. VTK's own objects are wrapped.
    field : backward displacements in space, or a Deformation.
    grid : of the volume that the deformation was made on, for a mesh and a Deformation.
    progress : called with the finished share from 0 to 1, for an image.

    Returns
    -------
    A new data set of the same kind. Points without a place in the result are not moved and are marked by 0 in
    the point data "deformnb_found", which is there only then. Normals of points, which no longer hold, are left out.

    Raises
    ------
    DeformError
        If an image has no point data (of cells: ``image.cells_to_points()``), or the data set has no points to move.

    Examples
    --------
    >>> import numpy as np, pyvista
    >>> import deformnb as dn
    >>> volume = dn.Volume.from_array(np.broadcast_to(np.arange(20.0), (20, 20, 20)), name="grey")
    >>> points = dn.ControlPoints.from_arrays([[5, 10, 10]], [[8, 10, 10]])
    >>> bump = dn.Deformation.from_space_points(points, support=30.0)
    >>> image = dn.interop.warp_pyvista(volume.to_pyvista(), bump)
    >>> round(float(image["grey"].reshape(20, 20, 20)[10, 10, 8]), 4)
    5.0
    >>> marker = dn.interop.warp_pyvista(pyvista.PolyData([[5.0, 10.0, 10.0]]), bump, grid=volume)
    >>> np.round(marker.points, 4).tolist()
    [[8.0, 10.0, 10.0]]
    """
    pyvista = optional_package("pyvista")
    data = pyvista.wrap(data)
    if isinstance(data, pyvista.ImageData):
        return _image(data, field, progress)
    if not isinstance(data, pyvista.DataSet) or isinstance(data, pyvista.RectilinearGrid):
        raise DeformError(
            f"a {type(data).__name__} has no points that could move; cast it: "
            "data.cast_to_structured_grid(), or deform the data sets of a MultiBlock one by one."
        )
    moved = data.copy()
    places = np.asarray(data.points, dtype=np.float64)
    # As landmarks in the millimetres that VTK's lengths are taken to be.
    target, found = warp_points(Landmarks(places, unit="mm"), field, grid=grid)
    moved.points = np.where(found[:, None], target, places)
    for normals in {"Normals", data.point_data.active_normals_name} & set(moved.point_data.keys()):
        moved.point_data.remove(normals)
    if not found.all():
        moved.point_data["deformnb_found"] = found.astype(np.uint8)
    return moved


def _image(image: Any, field: AbstractField | HasField, progress: Progress | None) -> Any:
    names = list(image.point_data.keys())
    if not names:
        raise DeformError("the image has no point data to deform; image.cells_to_points() makes them of cell data.")
    parts: list[tuple[str, Volume]] = []
    for name in names:
        values = np.asarray(image.point_data[name])
        single = image.copy(deep=False)
        single.clear_data()
        for k in range(1 if values.ndim == 1 else values.shape[1]):
            single.point_data["part"] = values if values.ndim == 1 else np.ascontiguousarray(values[:, k])
            parts.append((name, Volume.from_pyvista(single, "part")))
    results = deform_volumes([volume for _, volume in parts], field, progress=progress)
    made = results[0].to_pyvista()
    made.clear_data()
    for name in names:
        columns = [
            result.values.reshape(-1) for (owner, _), result in zip(parts, results, strict=True) if owner == name
        ]
        made.point_data[name] = columns[0] if image.point_data[name].ndim == 1 else np.stack(columns, axis=1)
    made.point_data.active_scalars_name = image.point_data.active_scalars_name
    return made

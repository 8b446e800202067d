"""Every entrance takes any kind of volume, and places it as the package that it comes from states.

The entrances are found by the annotations of public functions, so that a new one cannot be missed: each has its row in
``ENTRANCES`` or ``OF_GRIDS``, a call with everything else right.
"""

from __future__ import annotations

import inspect
import re
import struct
import subprocess
import sys
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deformnb as dn
import deformnb_lessons
from deformnb.errors import DeformError
from deformnb.rbf.fields import Affine
from deformnb.volume import converters
from deformnb.volume.volume import as_grid, as_volume
from deformnb.warping.points import Landmarks

VALUES = np.arange(4 * 6 * 8, dtype=np.uint8).reshape(4, 6, 8)
STRAIGHT = dn.Grid((4, 6, 8), (3.125, 8.0, 6.25), (-5.0, 7.0, 11.0))
TURNED = dn.Grid(
    (4, 6, 8), (3.125, 8.0, 6.25), (-5.0, 7.0, 11.0), ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
)
MARKED = (5, 2, 1)  # (i, j, k) of the voxel whose place is compared
POINTS = dn.ControlPoints.from_arrays(
    [[10.0, 20.0], [15.0, 30.0], [5.0, 40.0]], [[12.0, 20.0], [15.0, 30.0], [5.0, 40.0]]
)
SHIFT = Affine(np.eye(3), np.array([3.125, 0.0, 0.0]))
SMALL: dict[str, Any] = {"size": (16, 12), "backend": "core"}


# -- objects of other packages, each with the place of the marked voxel as that package computes it --------------------


def _sitk(grid: dn.Grid) -> tuple[Any, Any]:
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.GetImageFromArray(VALUES)
    image.SetSpacing(grid.spacing)
    image.SetOrigin(grid.origin)
    image.SetDirection(np.ravel(grid.direction).tolist())
    return image, image.TransformIndexToPhysicalPoint(MARKED)


def _nibabel(grid: dn.Grid, *, slope: float | None = None, axes: int = 3) -> tuple[Any, Any]:
    nibabel = pytest.importorskip("nibabel")
    ras = np.diag([-1.0, -1.0, 1.0, 1.0])
    affine = ras @ np.vstack([np.column_stack([np.asarray(grid.direction) * grid.spacing, grid.origin]), [0, 0, 0, 1]])
    values = VALUES.T.reshape(8, 6, 4, *[1] * (axes - 3))
    image = nibabel.Nifti1Image(values, affine)
    if slope is not None:
        data = bytearray(image.to_bytes())
        data[112:116] = struct.pack("<f", slope)  # scl_slope of the header
        image = nibabel.Nifti1Image.from_bytes(bytes(data))
    return image, (ras @ image.affine @ [*MARKED, 1])[:3]


def _pyvista(grid: dn.Grid, *, cells: bool = False) -> tuple[Any, Any]:
    pyvista = pytest.importorskip("pyvista")
    shift = np.asarray(grid.direction) @ np.asarray(grid.spacing) / 2 if cells else np.zeros(3)
    image = pyvista.ImageData(
        dimensions=np.add(grid.shape[::-1], int(cells)),
        spacing=grid.spacing,
        origin=np.asarray(grid.origin) - shift,
        direction_matrix=np.asarray(grid.direction),
    )
    (image.cell_data if cells else image.point_data)["values"] = VALUES.ravel()
    k = np.ravel_multi_index(MARKED[::-1], grid.shape)
    return image, (image.cell_centers().points if cells else image.points)[k]


def _vtk(grid: dn.Grid) -> tuple[Any, Any]:
    image, place = _pyvista(grid)
    plain = pytest.importorskip("vtkmodules.vtkCommonDataModel").vtkImageData()
    plain.ShallowCopy(image)
    return plain, place


def _rectilinear(grid: dn.Grid) -> tuple[Any, Any]:
    pyvista = pytest.importorskip("pyvista")
    lines = [
        start + step * np.arange(n) for start, step, n in zip(grid.origin, grid.spacing, grid.shape[::-1], strict=True)
    ]
    image = pyvista.RectilinearGrid(*lines)
    image.point_data["values"] = VALUES.ravel()
    return image, image.points[np.ravel_multi_index(MARKED[::-1], grid.shape)]


def _xarray(
    grid: dn.Grid, *, order: tuple[str, ...] = ("z", "y", "x"), falls: str = "", dataset: bool = False
) -> tuple[Any, Any]:
    xarray = pytest.importorskip("xarray")
    coords = {
        name: start + step * np.arange(n)
        for name, start, step, n in zip("zyx", grid.origin[::-1], grid.spacing[::-1], grid.shape, strict=True)
    }
    array = xarray.DataArray(VALUES, coords, ("z", "y", "x"), "values")
    place = [float(array.coords[name][at]) for name, at in zip("xyz", MARKED, strict=True)]
    array = array.transpose(*order)
    if falls:
        array = array.isel({falls: slice(None, None, -1)})
    return array.to_dataset() if dataset else array, place


class Layer:
    """The interface of a layer of napari, whose class comes from there."""

    def __init__(self, data: Any, attributes: dict[str, Any], kind: str) -> None:
        self._tuple = data, attributes, kind

    def as_layer_data_tuple(self) -> Any:
        return self._tuple


Layer.__module__ = "napari.layers.image"


def _napari(grid: dn.Grid, *, plain: bool = False) -> tuple[Any, Any]:
    attributes = {
        "scale": grid.spacing[::-1],
        "translate": grid.origin[::-1],
        "rotate": np.asarray(grid.direction)[::-1, ::-1],
    }
    # napari: world = rotate (scale * index) + translate, in the order of the array's axes.
    place = attributes["rotate"] @ (np.asarray(MARKED[::-1]) * attributes["scale"]) + attributes["translate"]
    layer = (VALUES, attributes, "image")
    return layer if plain else Layer(*layer), place[::-1]


def _file(grid: dn.Grid, folder: Path, suffix: str = ".nrrd") -> tuple[Any, Any]:
    path = folder / f"marked{suffix}"
    dn.write_volume(dn.Volume(VALUES, grid), path)
    image = pytest.importorskip("SimpleITK").ReadImage(str(path))
    return path, image.TransformIndexToPhysicalPoint(MARKED)


Made = Callable[[Path], tuple[Any, Any]]

OBJECTS: dict[str, Made] = {
    "volume": lambda _: (dn.Volume(VALUES, TURNED), np.asarray(TURNED.matrix) @ MARKED + TURNED.origin),
    "SimpleITK": lambda _: _sitk(TURNED),
    "nibabel": lambda _: _nibabel(TURNED),
    "nibabel of four axes": lambda _: _nibabel(TURNED, axes=4),
    "nibabel with a slope": lambda _: _nibabel(STRAIGHT, slope=2.0),
    "pyvista": lambda _: _pyvista(TURNED),
    "pyvista cells": lambda _: _pyvista(TURNED, cells=True),
    "VTK": lambda _: _vtk(TURNED),
    "rectilinear": lambda _: _rectilinear(STRAIGHT),
    "xarray": lambda _: _xarray(STRAIGHT),
    "xarray x, z, y": lambda _: _xarray(STRAIGHT, order=("x", "z", "y")),
    "xarray falling y": lambda _: _xarray(STRAIGHT, falls="y"),
    "xarray Dataset": lambda _: _xarray(STRAIGHT, dataset=True),
    "napari": lambda _: _napari(TURNED),
    "napari LayerData": lambda _: _napari(TURNED, plain=True),
    "path": lambda folder: _file(TURNED, folder),
    "text": lambda folder: (str(_file(STRAIGHT, folder, ".mha")[0]), _file(STRAIGHT, folder, ".mha")[1]),
}
"""By name: what makes an object, and the place of the marked voxel as the object's own package computes it."""


OF_ITK = """
import sys, itk, numpy as np
from deformnb.volume.volume import as_volume
image = itk.image_from_array(np.arange(4 * 6 * 8, dtype=np.uint8).reshape(4, 6, 8))
image.SetSpacing((3.125, 8.0, 6.25))
image.SetOrigin((-5.0, 7.0, 11.0))
image.SetDirection(itk.matrix_from_array(np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])))
region = itk.ImageRegion[3](itk.Index[3]((1, 2, 1)), itk.Size[3]((4, 3, 2)))
part = itk.region_of_interest_image_filter(image, region_of_interest=region)
for given, mark in ((image, (5, 2, 1)), (itk.xarray_from_image(image), (5, 2, 1)), (part, (2, 1, 1))):
    volume = as_volume(given)
    place = (image if given is not part else part).TransformIndexToPhysicalPoint(mark)
    value = itk.array_from_image(image if given is not part else part)[mark[::-1]]
    found = np.argwhere(volume.values == value)
    assert len(found) == 1, found
    assert np.allclose(volume.grid.index_to_point(found[0][::-1]), list(place)), (volume.grid, list(place))
print("right")
"""


def test_an_image_of_itk_lies_where_itk_says() -> None:
    pytest.importorskip("itk")  # in a separate process: with SimpleITK and VTK its libraries crash
    done = subprocess.run([sys.executable, "-c", OF_ITK], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "right", done.stderr[-2000:]


@pytest.mark.parametrize("name", OBJECTS)
def test_an_object_lies_where_its_own_package_says(name: str, tmp_path: Path) -> None:
    given, place = OBJECTS[name](tmp_path)
    volume = as_volume(given)
    value = int(VALUES[MARKED[::-1]]) * (2 if "slope" in name else 1)
    found = np.argwhere(volume.values == value)
    assert len(found) == 1
    np.testing.assert_allclose(volume.grid.index_to_point(found[0][::-1]), np.asarray(place), rtol=1e-6)
    assert as_grid(given) == volume.grid
    assert volume.values.size == VALUES.size
    assert converters.NO_PLACE not in volume.notes


# -- the entrances -----------------------------------------------------------------------------------------------------


def public() -> Iterator[Any]:
    """Every public callable of the package, with the public methods of classes."""
    seen = set()
    spaces = [getattr(dn, name) for name in dir(dn)]
    for space in [dn, deformnb_lessons, *(one for one in spaces if isinstance(one, types.ModuleType))]:
        for name in dir(space):
            one = getattr(space, name)
            if name.startswith("_") or isinstance(one, types.ModuleType) or not callable(one) or id(one) in seen:
                continue
            seen.add(id(one))
            yield one
            if inspect.isclass(one) and one.__module__.startswith("deformnb"):
                for own, method in vars(one).items():
                    function = getattr(method, "__func__", method)
                    if not own.startswith("_") and inspect.isfunction(function):
                        yield function


def annotated(pattern: str) -> set[str]:
    """The parameters of public callables whose annotation has a word: "module.name(parameter)"."""
    found = set()
    for one in public():
        try:
            parameters = inspect.signature(one).parameters.values()
        except (TypeError, ValueError):
            continue
        for parameter in parameters:
            text = parameter.annotation if isinstance(parameter.annotation, str) else ""
            if re.search(pattern, text) and "Callable" not in text:
                found.add(f"{one.__module__.removeprefix('deformnb.')}.{one.__qualname__}({parameter.name})")
    return found


PLACES = np.array([[3.0, 20.0, 5.0], [1.0, 10.0, 9.0]])


def _h(v: Any) -> Any:
    return dn.Deformation.from_picture_points(as_grid(v), "+z", POINTS, support=40.0)


def _closed(made: Any, seen: Callable[[Any], Any]) -> Any:
    try:
        return seen(made)
    finally:
        made.close()


def _written(folder: Path, write: Callable[[Path], None], read: Callable[[Path], Any] = dn.read_volume) -> Any:
    path = folder / "written.nrrd"
    write(path)
    return read(path)


def _segmentation(given: Any, folder: Path) -> Any:
    like = folder / "like.seg.nrrd"
    if not like.exists():
        like.write_bytes(b"")
    return dn.io.write_segmentation(given, folder / "out.seg.nrrd", like)


def _reference() -> dn.Volume:
    return dn.Volume(VALUES, TURNED)


def _animated(given: Any) -> dn.Deformation:
    step = _h(given).steps
    return dn.Deformation(keyframes=(dn.Keyframe(0, step), dn.Keyframe(1, step)))


def _match(moving: Any, fixed: Any) -> Any:
    points = dn.ControlPoints.from_arrays([as_grid(moving).center])
    return dn.registration.fit_targets(points, moving, fixed, iterations=1, stages=1).points


def _snap(moving: Any, fixed: Any) -> Any:
    points = dn.ControlPoints.from_arrays([as_grid(moving).center])
    return dn.registration.snap_to_match(points, None, moving, fixed)


def _like(given: Any) -> dn.Volume:
    """A plain volume on the same grid, for the other one of a pair."""
    return dn.Volume(
        np.ascontiguousarray(VALUES[::-1])
        if as_grid(given).shape == VALUES.shape
        else np.zeros(as_grid(given).shape, np.uint8),
        as_grid(given),
    )


def _ball(v: Any) -> Any:
    low, high = as_grid(v).corners().min(axis=0), as_grid(v).corners().max(axis=0)
    corners = np.array([[0.3, 0.3, 0.3], [0.7, 0.3, 0.3], [0.3, 0.7, 0.3], [0.3, 0.3, 0.7]])
    return dn.warping.Mesh(low + corners * (high - low), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def _score(v: Any) -> Any:
    grids = dn.datasets.thompson_map("Polyprion", "Antigonia", box=(0.0, 25.0, 0.0, 48.0))
    return dn.datasets.thompson_score(_h(v), grids, grid=v)


def _warped_pyvista(v: Any) -> Any:
    return dn.interop.warp_pyvista(pytest.importorskip("pyvista").PolyData(PLACES), _h(v), v).points


def _written_transform(v: Any, folder: Path) -> Any:
    dn.write_transform(SHIFT, folder / "shift.nrrd", v)
    return dn.read_transform(folder / "shift.nrrd").displacement(PLACES)


def _read_transform(v: Any, folder: Path) -> Any:
    dn.write_transform(SHIFT, folder / "shift.nrrd", TURNED)
    return dn.read_transform(folder / "shift.nrrd", v).displacement(PLACES)


def _volume_info(view: Any) -> Any:
    return {key: value for key, value in view.volume_info.items() if key != "id"}


def _mask(mask: dn.Mask) -> Any:
    return mask.values, mask.lattice


ENTRANCES: dict[str, Callable[[Any, Path], Any]] = {
    "analysis.label_volumes.label_volumes(after)": lambda v, _: dn.analysis.label_volumes(_like(v), v),
    "analysis.label_volumes.label_volumes(before)": lambda v, _: dn.analysis.label_volumes(v, _like(v)),
    "document.deformation.Deformation.apply(volume)": lambda v, _: _h(v).apply(v),
    "document.deformation.Deformation.apply_all(volumes)": lambda v, _: _h(v).apply_all([v]),
    "document.deformation.VolumeReference.has_labels(volume)": lambda v, _: dn.document.VolumeReference.of(
        _like(v)
    ).has_labels(v),
    "document.deformation.VolumeReference.matches(volume)": lambda v, _: dn.document.VolumeReference.of(
        as_volume(v)
    ).matches(v),
    "document.deformation.VolumeReference.of(volume)": lambda v, _: dn.document.VolumeReference.of(v).grid,
    "imaging.movie_frames.animation_frames(volume)": lambda v, _: list(
        dn.imaging.animation_frames(v, _animated(v), fps=1, **SMALL)
    ),
    "imaging.movie_frames.deformation_frames(volume)": lambda v, _: list(
        dn.imaging.deformation_frames(v, _h(v), strengths=1, **SMALL)
    ),
    "imaging.picking.surface_point(volume)": lambda v, _: dn.imaging.surface_point(
        v, (_like(v).grid.center, [0, 0, 1]), "surface"
    ),
    "imaging.projection.project(ambience)": lambda v, _: dn.project(as_volume(v), "+z", "shaded", ambience=v),
    "imaging.projection.project(volume)": lambda v, _: dn.project(v, "+z"),
    "imaging.projection.project_channels(channels)": lambda v, _: dn.imaging.project_channels(v, "+z"),
    "imaging.render.render_pair(after)": lambda v, _: dn.imaging.render_pair(_like(v), v, **SMALL),
    "imaging.render.render_pair(before)": lambda v, _: dn.imaging.render_pair(v, _like(v), **SMALL),
    "imaging.render.render_volume(volume)": lambda v, _: dn.render_volume(v, **SMALL),
    "interop.napari_layers.to_napari(given)": lambda v, _: as_volume(dn.interop.to_napari(v)[0]),
    "io.volumes.formats.write_volume(volume)": lambda v, f: _written(f, lambda path: dn.write_volume(v, path)),
    "io.volumes.label_names.write_segmentation(volume)": _segmentation,
    "io.volumes.series.write_channels(channels)": lambda v, f: _written(f, lambda path: dn.io.write_channels(v, path)),
    "io.volumes.series.write_series(moments)": lambda v, f: _written(f, lambda path: dn.io.write_series([v], path, 1)),
    "deformnb_lessons.pages.lesson_start(volume)": lambda v, _: (
        deformnb_lessons.lesson_start("affine", v).steps[0].points.source
    ),
    "deformnb_lessons.studio_tasks.FishTask.grids(volume)": lambda v, _: (
        deformnb_lessons.FishTask("", "", "Polyprion", "Antigonia", 65).grids(v).source_nodes
    ),
    "rbf.regions.Mask.from_labels(volume)": lambda v, _: _mask(dn.Mask.from_labels(v, 21)),
    "registration.optimise.fit_targets(fixed)": lambda v, _: _match(_like(v), v),
    "registration.optimise.fit_targets(moving)": lambda v, _: _match(v, _like(v)),
    "registration.optimise.snap_to_match(fixed)": lambda v, _: _snap(_like(v), v),
    "registration.optimise.snap_to_match(moving)": lambda v, _: _snap(v, _like(v)),
    "session.autosave_store.saved_sessions(volume)": dn.session.saved_sessions,
    "session.session.Session(channels)": lambda v, _: dn.Session(_like(v), channels=v).channels,
    "session.session.Session(volume)": lambda v, _: dn.Session(v).volume,
    "volume.channels.Channels(volumes)": lambda v, _: dn.volume.Channels((v,)),
    "volume.channels.Channels.with_volumes(volumes)": lambda v, _: dn.volume.Channels((_like(v),)).with_volumes([v]),
    "volume.labelled.to_xarray(volume)": lambda v, _: dn.volume.to_xarray(v),
    "volume.transfer.preset(volume)": lambda v, _: dn.preset("bone", v),
    "warping.mesh.fill_distance(distance)": lambda v, _: dn.warping.fill_distance(v),
    "warping.mesh.isosurface(volume)": lambda v, _: dn.warping.isosurface(v, 20.5).points,
    "warping.warper.Warper(volume)": lambda v, _: dn.Warper(v)(SHIFT),
    "warping.warper.warp(volume)": lambda v, _: dn.warp(v, SHIFT),
    "warping.warper.warp_all(volumes)": lambda v, _: dn.warping.warp_all([v], SHIFT),
    "widgets.editor.space_editor.SpaceEditor(volume)": lambda v, _: _closed(
        dn.widgets.SpaceEditor(v), lambda editor: editor.volume
    ),
    "widgets.inputs.transfer_editor.TransferEditor(volume)": lambda v, _: _closed(
        dn.widgets.TransferEditor(v), lambda editor: editor.volume
    ),
    "widgets.studio.studio.Studio(labels)": lambda v, _: _closed(
        dn.Studio(_like(v), labels=v), lambda studio: studio.volume
    ),
    "widgets.studio.studio.Studio(target)": lambda v, _: _closed(
        dn.Studio(_like(v), target=v), lambda studio: studio.volume
    ),
    "widgets.studio.studio.Studio(volume)": lambda v, _: _closed(dn.Studio(v), lambda studio: studio.volume),
    "widgets.studio.studio.Studio.open_volume(volume)": lambda v, _: _closed(
        dn.Studio(_like(v)), lambda studio: (studio.open_volume(v), studio.volume)[1]
    ),
    "widgets.view.live_view.LiveView(volume)": lambda v, _: _closed(dn.widgets.LiveView(v), _volume_info),
    "widgets.view.live_view.LiveView.show(volume)": lambda v, _: _closed(
        dn.widgets.LiveView(), lambda view: (view.show(v), _volume_info(view))[1]
    ),
    "widgets.view.volume_view.VolumeView(volume)": lambda v, _: _closed(dn.widgets.VolumeView(v), _volume_info),
    "widgets.view.volume_view.VolumeView.show(volume)": lambda v, _: _closed(
        dn.widgets.VolumeView(), lambda view: (view.show(v), _volume_info(view))[1]
    ),
}
"""Parameters that are volumes or channels, each with a call in which everything else is right."""


def _warp_markups(grid: Any, folder: Path) -> Any:
    dn.write_landmarks(Landmarks(PLACES), folder / "a.mrk.json")
    dn.io.warp_markups(folder / "a.mrk.json", folder / "b.mrk.json", _h(grid), grid, overwrite=True)
    return dn.read_landmarks(folder / "b.mrk.json").points


OF_GRIDS: dict[str, Callable[[Any, Path], Any]] = {
    "analysis.folds.find_folds(grid)": lambda v, _: dn.analysis.find_folds(_h(v), as_grid(v), grid=v),
    "analysis.folds.find_folds(lattice)": lambda v, _: dn.analysis.find_folds(_h(v), v),
    "analysis.folds.jacobian_determinant(grid)": lambda v, _: dn.analysis.jacobian_determinant(_h(v), PLACES, grid=v),
    "analysis.folds.jacobian_determinant(where)": lambda v, _: dn.analysis.jacobian_determinant(_h(v), v),
    "analysis.strain.stretches(grid)": lambda v, _: dn.analysis.stretches(_h(v), PLACES, grid=v).principal,
    "chunked.warper.warp(output)": lambda v, _: dn.chunked.warp(_reference(), SHIFT, dn.Volume, output=v),
    "datasets.grid_score.thompson_score(grid)": lambda v, _: _score(v),
    "document.deformation.Deformation.difference(volume)": lambda v, _: (
        dn.Deformation(volume=dn.document.VolumeReference.of(_like(v))).difference(v) != ""
    ),
    "document.deformation.Deformation.field(grid)": lambda v, _: _h(v).field(v).displacement(PLACES),
    "document.deformation.Deformation.inverse(grid)": lambda v, _: _h(v).inverse(v).field.values,
    "document.deformation.Deformation.from_picture_points(grid)": lambda v, _: (
        dn.Deformation.from_picture_points(v, "+z", POINTS).steps[0].plane
    ),
    "document.deformation.Deformation.warp_points(grid)": lambda v, _: _h(v).warp_points(PLACES, v),
    "imaging.movie_frames.animation_frames(output)": lambda v, _: list(
        dn.imaging.animation_frames(_like(v), _animated(v), fps=1, output=v, **SMALL)
    ),
    "imaging.movie_frames.deformation_frames(output)": lambda v, _: list(
        dn.imaging.deformation_frames(_like(v), _h(v), strengths=1, output=v, **SMALL)
    ),
    "imaging.render.image_places(grid)": lambda v, _: dn.imaging.image_places(PLACES, v),
    "imaging.thompson.draw_grids(grid)": lambda v, _: (
        dn.draw_grids(_h(v), dn.project(_like(v), "+z"), grid=v).grids.nodes
    ),
    "interop.pyvista_filters.warp_pyvista(grid)": lambda v, _: _warped_pyvista(v),
    "interop.sitk_transforms.to_sitk_transform(grid)": lambda v, _: dn.interop.to_sitk_transform(
        _h(v), v
    ).TransformPoint(PLACES[0].tolist()),
    "interop.skimage_maps.skimage_coordinates(lattice)": lambda v, _: dn.interop.skimage_coordinates(_h(v), v),
    "interop.skimage_maps.skimage_map(lattice)": lambda v, _: dn.interop.skimage_map(_h(v), v),
    "io.transforms.formats.read_transform(grid)": _read_transform,
    "io.transforms.formats.write_transform(grid)": _written_transform,
    "io.transforms.vtk.to_vtk_transform(grid)": lambda v, _: dn.io.to_vtk_transform(_h(v), v).TransformPoint(
        PLACES[0].tolist()
    ),
    "rbf.extrusion.extrude(grid)": lambda v, _: dn.rbf.extrude(
        dn.Plane.from_view(TURNED, "+z"), v, [dn.fit_rbf(POINTS)], dn.rbf.replicate()
    ).displacement(PLACES),
    "rbf.fields.AbstractField.sample_on_grid(grid)": lambda v, _: SHIFT.sample_on_grid(v),
    "rbf.fields.DisplacementField.sample(lattice)": lambda v, _: dn.rbf.DisplacementField.sample(_h(v), v).values,
    "rbf.fields.as_field(grid)": lambda v, _: dn.rbf.as_field(_h(v), v).displacement(PLACES),
    "rbf.fields.blend(grid)": lambda v, _: dn.rbf.blend(_h(v), SHIFT, grid=v).displacement(PLACES),
    "rbf.fields.compose(grid)": lambda v, _: dn.rbf.compose(_h(v), SHIFT, grid=v).displacement(PLACES),
    "session.session.Session(output)": lambda v, _: dn.Session(_reference(), output=v).editing.output,
    "volume.plane.Plane.from_camera(grid)": lambda v, _: dn.Plane.from_camera(v, (1, 2, 3)),
    "volume.plane.Plane.from_view(grid)": lambda v, _: dn.Plane.from_view(v, "-x"),
    "volume.plane.Plane.depth_range(grid)": lambda v, _: dn.Plane.from_view(TURNED, "-x").depth_range(v),
    "volume.plane.Plane.slices(grid)": lambda v, _: dn.Plane.from_view(TURNED, "-x").slices(v),
    "warping.inverse.invert(grid)": lambda v, _: dn.invert(_h(v), as_grid(v), grid=v).field.values,
    "warping.inverse.invert(lattice)": lambda v, _: dn.invert(_h(v), v).field.values,
    "warping.inverse.round_trip(grid)": lambda v, _: dn.warping.round_trip(_h(v), PLACES, grid=v).worst,
    "warping.mesh.signed_distance(grid)": lambda v, _: dn.warping.signed_distance(_ball(v), v),
    "warping.mesh.warp_mesh(grid)": lambda v, _: dn.warp_mesh(_ball(v), _h(v), v).points,
    "io.landmarks.markups.warp_markups(grid)": _warp_markups,
    "warping.points.warp_landmarks(grid)": lambda v, _: dn.warp_landmarks(Landmarks(PLACES), _h(v), v).points,
    "warping.points.warp_points(grid)": lambda v, _: dn.warp_points(PLACES, _h(v), v),
    "warping.warper.Warper(output)": lambda v, _: dn.Warper(_reference(), output=v)(SHIFT),
    "warping.warper.warp(output)": lambda v, _: dn.warp(_reference(), SHIFT, output=v),
    "warping.warper.warp_all(output)": lambda v, _: dn.warping.warp_all([_reference()], SHIFT, output=v),
    "widgets.studio.studio.Studio(output)": lambda v, _: _closed(
        dn.Studio(_reference(), output=v), lambda studio: studio.session.editing.output
    ),
}
"""Parameters that are grids, for which a volume will do."""


def test_every_public_entrance_has_its_row() -> None:
    of_volumes = annotated(r"\b(Volume|VolumeLike|Channels|ChannelsLike|Pictured)\b")
    of_grids = annotated(r"\bGrid\b") & of_volumes
    internal = {"widgets.view.live_view.LiveView.page_scene(volume)"}  # takes only the parts that its page shows
    assert set(OF_GRIDS) == of_grids
    assert set(ENTRANCES) == of_volumes - of_grids - internal


def outcome(call: Callable[[Any, Path], Any], given: Any, folder: Path) -> Any:
    """Result of a call in comparable form: arrays, grids and numbers; or its refusal."""
    try:
        return plain(call(given, folder))
    except DeformError as error:
        return f"refused: {type(error).__name__}"


def plain(found: Any) -> Any:
    if isinstance(found, dn.Volume):
        return found.values, found.grid.affine
    if isinstance(found, dn.volume.Channels):
        return found.values, found.grid.affine
    if type(found).__name__ == "DataArray":
        return plain(as_volume(found))
    if isinstance(found, dn.ControlPoints):
        return found.source, found.target
    if isinstance(found, dn.Picture):
        return found.values, repr(found.plane)
    if isinstance(found, dict):
        return [f"{key}: {value}" for key, value in found.items()]
    if isinstance(found, dn.Grid):
        return found.affine, found.shape
    if isinstance(found, list | tuple) and not hasattr(found, "_fields"):
        return [plain(one) for one in found]
    return found


def same(found: Any, wanted: Any) -> None:
    if isinstance(wanted, list | tuple):
        assert len(found) == len(wanted)
        for one, other in zip(found, wanted, strict=True):
            same(one, other)
    elif isinstance(wanted, np.ndarray | float):
        np.testing.assert_allclose(found, wanted, rtol=1e-6, atol=1e-6)
    else:
        assert found == wanted or repr(found) == repr(wanted)


REFUSE = {"interop.skimage_maps.skimage_map(lattice)", "io.volumes.label_names.write_segmentation(volume)"}
"""Entrances that refuse this volume, which has several slices, or the file next to it, which is no segmentation."""

FOREIGN = [name for name in OBJECTS if name not in ("volume", "nibabel with a slope", "xarray falling y")]
"""Those whose voxels have the same order as those of the volume that each is compared with."""


def check(entrance: str, name: str, folder: Path) -> None:
    call = (ENTRANCES | OF_GRIDS)[entrance]
    given, _ = OBJECTS[name](folder)
    grid = as_volume(given).grid
    wanted = outcome(call, dn.Volume(VALUES, grid), folder)
    assert isinstance(wanted, str) == (entrance in REFUSE), wanted
    same(outcome(call, given, folder), wanted)


def paired(table: dict[str, Any]) -> list[tuple[str, str]]:
    """Each entrance with one of the objects, and each object with one or more of the entrances."""
    return [(entrance, FOREIGN[k % len(FOREIGN)]) for k, entrance in enumerate(sorted(table))]


@pytest.mark.sampled(4)
@pytest.mark.parametrize(("entrance", "name"), paired(ENTRANCES | OF_GRIDS))
def test_an_entrance_takes_an_object_as_the_volume_that_it_is(entrance: str, name: str, tmp_path: Path) -> None:
    check(entrance, name, tmp_path)


@pytest.mark.nightly
@pytest.mark.parametrize("name", FOREIGN)
@pytest.mark.parametrize("entrance", sorted(ENTRANCES | OF_GRIDS))
def test_every_entrance_takes_every_object(entrance: str, name: str, tmp_path: Path) -> None:
    check(entrance, name, tmp_path)

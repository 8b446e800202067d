"""The same warp by other packages, each as its manual recommends. Absent packages are left out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Run = Callable[[], NDArray[Any]]


def scipy_warp(values: NDArray[Any], lookup: NDArray[np.float64], fill: float) -> Run:
    # float output and rounding: with bytes as output, scipy cuts the fraction off
    def run() -> NDArray[Any]:
        out = ndimage.map_coordinates(values, lookup, output=np.float32, order=1, mode="grid-constant", cval=fill)
        return rounded(out, values.dtype)

    return run


def scipy_slices(values: NDArray[Any], lookup: NDArray[np.float64], fill: float, axis: int) -> Run:
    """Two-dimensional lookups, slice by slice along the axis of replication."""
    planes = np.ascontiguousarray(np.moveaxis(np.delete(lookup, axis, 0), axis + 1, 1)[:, 0])
    moved = np.ascontiguousarray(np.moveaxis(values, axis, 0))

    def run() -> NDArray[Any]:
        out = np.empty(moved.shape, np.float32)
        for k, plane in enumerate(moved):
            ndimage.map_coordinates(plane, planes, output=out[k], order=1, mode="grid-constant", cval=fill)
        return np.moveaxis(rounded(out, values.dtype), 0, axis)

    return run


def skimage_warp(values: NDArray[Any], lookup: NDArray[np.float64], fill: float) -> Run:
    from skimage.transform import warp

    def run() -> NDArray[Any]:
        out = warp(values, lookup, order=1, mode="constant", cval=fill, preserve_range=True)
        return rounded(out, values.dtype)

    return run


def sitk_warp(values: NDArray[Any], displacement: NDArray[Any], fill: float, threads: int) -> Run:
    import SimpleITK as sitk  # noqa: N813 (the name that its own manual uses)

    image = sitk.GetImageFromArray(values)
    field = sitk.GetImageFromArray(displacement.astype(np.float64), isVector=True)
    warper = sitk.WarpImageFilter()
    _limit(sitk, threads)
    warper.SetOutputParameteresFromImage(image)
    warper.SetEdgePaddingValue(fill)
    return _view_result(sitk, lambda: warper.Execute(image, field))


def sitk_resample(values: NDArray[Any], displacement: NDArray[Any], fill: float, threads: int) -> Run:
    import SimpleITK as sitk  # noqa: N813

    image = sitk.GetImageFromArray(values)
    transform = sitk.DisplacementFieldTransform(sitk.GetImageFromArray(displacement.astype(np.float64), isVector=True))
    _limit(sitk, threads)
    return _view_result(sitk, lambda: sitk.Resample(image, image, transform, sitk.sitkLinear, fill))


def _view_result(sitk: Any, make: Callable[[], Any]) -> Run:
    """The voxels without a copy; the image must live as long as they are used."""
    images: list[Any] = []

    def run() -> NDArray[Any]:
        images[:] = [make()]
        return np.asarray(sitk.GetArrayViewFromImage(images[0]))

    return run


def _limit(sitk: Any, threads: int) -> None:
    if threads:
        sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(threads)


def vtk_reslice(values: NDArray[Any], displacement: NDArray[Any], fill: float) -> Run:
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData
    from vtkmodules.vtkFiltersHybrid import vtkGridTransform
    from vtkmodules.vtkImagingCore import vtkImageReslice

    def image(array: NDArray[Any], components: int) -> Any:
        data = vtkImageData()
        data.SetDimensions(*values.shape[::-1])
        data.GetPointData().SetScalars(numpy_to_vtk(array.reshape(-1, components), deep=True))
        return data

    grid = vtkGridTransform()
    grid.SetDisplacementGridData(image(displacement.astype(np.float32), 3))
    grid.SetInterpolationModeToLinear()
    reslice = vtkImageReslice()
    reslice.SetInputData(image(values, 1))
    reslice.SetResliceTransform(grid)
    reslice.SetInterpolationModeToLinear()
    reslice.SetBackgroundLevel(fill)

    def run() -> NDArray[Any]:
        reslice.GetOutput().ReleaseData()  # the last result, or it would not count as memory
        reslice.Update()
        return vtk_to_numpy(reslice.GetOutput().GetPointData().GetScalars()).reshape(values.shape)

    return run


def rounded(values: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Halves upwards, as we do."""
    return np.floor(values + 0.5).astype(dtype) if dtype.kind in "iu" else values.astype(dtype, copy=False)

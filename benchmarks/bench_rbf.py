"""From control points to a map: solve and evaluate on a picture, as one edit does it."""

from __future__ import annotations

import importlib.util
from argparse import Namespace
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from benchmarks import problem
from benchmarks.timing import Case, Group
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Raster


def groups(options: Namespace) -> Iterator[Group]:
    size = options.size
    for count in sorted({8, options.points, 128}):
        points = problem.control_points(count, 2, size)
        raster = Raster((size, size), (1.0, 1.0), (0.0, 0.0))
        # a wrong formula is wrong by pixels; how exact each one is stands in the table
        name = f"RBF: solve {count} points and evaluate {size} x {size}"
        yield Group(name, _cases(points, raster, size), 0.01, "pixels")
    yield from many()


def many() -> Iterator[Group]:
    """Many points of compact support on a small picture: lists of centres against the sums of others."""
    size, count = 256, 2048
    points = problem.control_points(count, 2, size)
    raster, support = Raster((size, size), (1.0, 1.0), (0.0, 0.0)), 0.1 * (size - 1)
    at, d = np.asarray(points.target), np.asarray(points.source) - np.asarray(points.target)
    pixels = raster.points().reshape(-1, 2)
    fit = fit_rbf(points, support=support)
    exact = np.moveaxis(fit.displacement(raster.points()), -1, 0)
    theirs = RBFInterpolator(at, d, kernel="thin_plate_spline", degree=1)
    near = RBFInterpolator(at, d, kernel="thin_plate_spline", degree=1, neighbors=32)
    thin = theirs(pixels).T.reshape(exact.shape)
    name = f"RBF: {count} points on {size} x {size}, Wendland C2 of support {support:.3g}"
    yield Group(name, [
        Case("deformnb: evaluate", lambda: fit.on_raster(raster), lambda r: r - exact, ours=True),
        Case("deformnb: solve and evaluate", lambda: fit_rbf(points, support=support).on_raster(raster),
             lambda r: r - exact, ours=True),
        Case("scipy RBFInterpolator, thin plate: evaluate", lambda: theirs(pixels).T.reshape(exact.shape),
             lambda r: r - thin),
        Case("scipy RBFInterpolator, 32 neighbours: evaluate", lambda: near(pixels).T.reshape(exact.shape),
             lambda r: r - thin),
    ], 1.0, "pixels")


def _cases(points: ControlPoints, raster: Raster, size: int) -> list[Case]:
    at, d = np.asarray(points.target), np.asarray(points.source) - np.asarray(points.target)
    pixels = raster.points().reshape(-1, 2)
    support = problem.SUPPORT * (size - 1)
    thin = RBFInterpolator(at, d, kernel="thin_plate_spline", degree=1)(pixels).T.reshape(2, *raster.shape)
    compact = fit_rbf(points, support=support).displacement(raster.points())

    def ours(**options: Any) -> Callable[[], NDArray[Any]]:
        return lambda: fit_rbf(points, **options).on_raster(raster)

    def scipy() -> NDArray[Any]:
        return RBFInterpolator(at, d, kernel="thin_plate_spline", degree=1)(pixels).T.reshape(2, *raster.shape)

    def error(result: NDArray[Any]) -> NDArray[Any]:
        return result - thin

    cases = [
        Case("deformnb, Wendland C2", ours(support=support), lambda r: r - np.moveaxis(compact, -1, 0), ours=True),
        Case("deformnb, thin plate", ours(kernel="thin_plate"), error, ours=True),
        Case("scipy RBFInterpolator, thin plate", scipy, error),
    ]
    if importlib.util.find_spec("vtkmodules"):
        cases.append(Case("VTK ThinPlateSpline + TransformToGrid", _vtk(at, d, raster), error))
    if importlib.util.find_spec("skimage"):
        cases.append(Case("scikit-image ThinPlateSpline", _skimage(at, d, raster), error))
    return cases


def _vtk(at: NDArray[np.float64], d: NDArray[np.float64], raster: Raster) -> Callable[[], NDArray[Any]]:
    from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonTransforms import vtkThinPlateSplineTransform
    from vtkmodules.vtkFiltersHybrid import vtkTransformToGrid

    def cloud(xy: NDArray[np.float64]) -> Any:
        points = vtkPoints()
        points.SetData(numpy_to_vtk(np.column_stack([xy, np.zeros(len(xy))]), deep=True))
        return points

    def run() -> NDArray[Any]:
        spline = vtkThinPlateSplineTransform()
        spline.SetBasisToR2LogR()
        spline.SetSourceLandmarks(cloud(at))
        spline.SetTargetLandmarks(cloud(at + d))
        grid = vtkTransformToGrid()
        grid.SetInput(spline)
        grid.SetGridExtent(0, raster.shape[1] - 1, 0, raster.shape[0] - 1, 0, 0)
        grid.SetGridOrigin(*raster.origin, 0)
        grid.SetGridSpacing(*raster.spacing, 1)
        grid.SetGridScalarTypeToFloat()
        grid.Update()
        values = vtk_to_numpy(grid.GetOutput().GetPointData().GetScalars()).reshape(*raster.shape, 3)
        return np.moveaxis(values[..., :2], -1, 0)

    return run


def _skimage(at: NDArray[np.float64], d: NDArray[np.float64], raster: Raster) -> Callable[[], NDArray[Any]]:
    from skimage.transform import ThinPlateSplineTransform

    pixels = raster.points().reshape(-1, 2)

    def run() -> NDArray[Any]:
        spline = ThinPlateSplineTransform.from_estimate(at, at + d)
        return (spline(pixels) - pixels).T.reshape(2, *raster.shape)

    return run

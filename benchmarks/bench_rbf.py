"""From control points to a map: solve and evaluate on a picture, as one edit does it, and a drag of one of many."""

from __future__ import annotations

import importlib.util
import itertools
from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from benchmarks import c_loops, problem
from benchmarks.timing import Case, Group
from deformnb.rbf.conditioning import LARGEST_SET
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Raster


def groups(options: Namespace) -> Iterator[Group]:
    size = options.size
    raster = Raster((size, size), (1.0, 1.0), (0.0, 0.0))
    for count in sorted({8, options.points, 128}):
        # a wrong formula is wrong by pixels; the exactness of each is in the table
        name = f"RBF: solve {count} points and evaluate {size} x {size}"
        yield Group(name, _cases(problem.control_points(count, 2, size), raster, options), 0.01, "pixels")
    for count, share in ((512, 0.2), (2048, 0.1)):
        yield _many(count, share * (size - 1), raster, options)


MOVES = 40
"""Sets of points in rotation, each moved a little: more than the factors that are cached, so that none is found."""


def _move_points(points: ControlPoints, which: Any) -> Callable[[], ControlPoints]:
    """Calls that return the points with some of them moved; prepared, since an editor has them already."""
    sets = []
    for k in range(1, MOVES + 1):
        target = np.array(points.target)
        target[which] += 1e-3 * k * np.cos(np.arange(len(target)))[which, None]
        sets.append(replace(points, target=target))
    return itertools.cycle(sets).__next__


_EVENTS = 10  # of a drag of one point, a sixth of a second of it


def _many(count: int, support: float, raster: Raster, options: Namespace) -> Group:
    """Many points of compact support: from scratch, and a drag of one of them."""
    points = problem.control_points(count, 2, options.size)
    fit = fit_rbf(points, support=support)
    exact = np.moveaxis(fit.displacement(raster.points()), -1, 0)
    every, one = _move_points(points, slice(None)), _move_points(points, [count // 2])

    def error(result: NDArray[Any]) -> NDArray[Any]:
        return result - exact

    def solve(moved: Callable[[], ControlPoints], **settings: Any) -> Any:
        return fit_rbf(moved(), support=support, **settings)

    cases = [
        Case("deformnb: evaluate", lambda: fit.sample_on_raster(raster), error, ours=True),
        Case("deformnb: solve", lambda: solve(every), ours=True),
        Case("deformnb: solve and evaluate", lambda: solve(every).sample_on_raster(raster), error, ours=True),
        Case(f"deformnb: drag of one point, {_EVENTS} events", lambda: _events(lambda: solve(one)), ours=True),
        Case("deformnb: drag of one point and evaluate", lambda: solve(one).sample_on_raster(raster), error, ours=True),
    ]
    if count <= LARGEST_SET:
        cases += [
            Case("deformnb: thin plate, solve", lambda: solve(every, kernel="thin_plate"), ours=True),
            Case(
                f"deformnb: thin plate, drag of one point, {_EVENTS} events",
                lambda: _events(lambda: solve(one, kernel="thin_plate")),
                ours=True,
            ),
        ]
    if not c_loops.why_absent():
        cases.append(Case("C loop", c_loops.sums(fit, raster), error))
    if not options.loops:
        cases += _scipy_of_many(points, raster)
    name = f"RBF: {count} points on {raster.shape[1]} x {raster.shape[0]}, Wendland C2 of support {support:.3g}"
    return Group(name, cases, 1.0, "pixels")


def _events(event: Callable[[], Any]) -> Any:
    """The last of several events of a drag: the cache of the first serves the others."""
    for _ in range(_EVENTS - 1):
        event()
    return event()


def _scipy_of_many(points: ControlPoints, raster: Raster) -> list[Case]:
    at, d = np.asarray(points.target), np.asarray(points.displacement)
    pixels, shape = raster.points().reshape(-1, 2), (2, *raster.shape)
    theirs = RBFInterpolator(at, d, kernel="thin_plate_spline", degree=1)
    near = RBFInterpolator(at, d, kernel="thin_plate_spline", degree=1, neighbors=32)
    return [
        Case("scipy RBFInterpolator, thin plate: solve", lambda: RBFInterpolator(at, d, degree=1)),
        Case("scipy RBFInterpolator, thin plate: evaluate", lambda: theirs(pixels).T.reshape(shape)),
        Case("scipy RBFInterpolator, 32 neighbours: evaluate", lambda: near(pixels).T.reshape(shape)),
    ]


def _cases(points: ControlPoints, raster: Raster, options: Namespace) -> list[Case]:
    at, d = np.asarray(points.target), np.asarray(points.source) - np.asarray(points.target)
    pixels = raster.points().reshape(-1, 2)
    support = problem.SUPPORT * (options.size - 1)
    thin = RBFInterpolator(at, d, kernel="thin_plate_spline", degree=1)(pixels).T.reshape(2, *raster.shape)
    fit = fit_rbf(points, support=support)
    compact = np.moveaxis(fit.displacement(raster.points()), -1, 0)

    def ours(**settings: Any) -> Callable[[], NDArray[Any]]:
        return lambda: fit_rbf(points, **settings).sample_on_raster(raster)

    def scipy() -> NDArray[Any]:
        return RBFInterpolator(at, d, kernel="thin_plate_spline", degree=1)(pixels).T.reshape(2, *raster.shape)

    def error(result: NDArray[Any]) -> NDArray[Any]:
        return result - thin

    cases = [
        Case("deformnb, Wendland C2", ours(support=support), lambda r: r - compact, ours=True),
        Case("deformnb, thin plate", ours(kernel="thin_plate"), error, ours=True),
    ]
    if not c_loops.why_absent():
        cases.append(Case("C loop", c_loops.sums(fit, raster), lambda r: r - compact))  # without the solve
    if options.loops:
        return cases
    cases.append(Case("scipy RBFInterpolator, thin plate", scipy, error))
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

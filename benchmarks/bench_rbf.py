"""From control points to a map: solve and evaluate on a picture, as one edit does it, and a drag of one of many."""

from __future__ import annotations

import importlib.util
import itertools
from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RBFInterpolator

from benchmarks import c_loops, problem
from benchmarks.goals import GENERAL
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


_EVENTS = 10  # of a drag of one point, a sixth of a second of it: the first one finds what the others use again


@cache
def general_warp(size: int, points: int) -> tuple[Case, ...]:
    """The general warp in C, its field given, by which the goals of fits are measured."""
    volume = problem.volume(size, "uint8")
    fit = fit_rbf(problem.control_points(points, 3, size), support=problem.SUPPORT * (size - 1))
    given = volume.values, list(fit.components_on_grid(volume.grid)), 0.0
    return tuple(c_loops.cases("uint8", lambda loops: c_loops.general(loops, *given), name=GENERAL))


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

    def drag(then: Callable[[Any], Any] = lambda fit: fit, **settings: Any) -> Any:
        """The last of several events."""
        return [then(solve(one, **settings)) for _ in range(_EVENTS)][-1]

    def ours(name: str, run: Callable[[], Any], row: str, **settings: Any) -> Case:
        return Case(f"deformnb: {name}", run, ours=True, row=row, **settings)

    cases = [
        ours("evaluate", lambda: fit.sample_on_raster(raster), "", error=error),
        ours("solve", lambda: solve(every), "solve 512 points" if count == 512 else ""),
        ours(
            "solve and evaluate",
            lambda: solve(every).sample_on_raster(raster),
            f"solve and map of {count} points",
            error=error,
        ),
        ours("drag of one point, an event", drag, f"drag one of {count} points", times=_EVENTS),
        ours(
            "drag of one point and evaluate, an event",
            lambda: drag(lambda fit: fit.sample_on_raster(raster)),
            f"drag one of {count} points and map",
            times=_EVENTS,
            error=error,
        ),
    ]
    if count <= LARGEST_SET:
        cases += [
            ours("thin plate, solve", lambda: solve(every, kernel="thin_plate"), ""),
            ours("thin plate, drag of one point, an event", lambda: drag(kernel="thin_plate"), "", times=_EVENTS),
        ]
    cases += c_loops.cases("uint8", lambda loops: c_loops.sums(loops, fit, raster), error)
    cases += general_warp(options.size, options.points)
    if not options.loops:
        cases += _scipy_of_many(points, raster)
    name = f"RBF: {count} points on {raster.shape[1]} x {raster.shape[0]}, Wendland C2 of support {support:.3g}"
    return Group(name, cases, 1.0, "pixels")


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

    rows = {32: "solve and map of 32 points", 128: "solve and map of 128 points of wide support"}
    row = rows.get(len(at), "")
    cases = [
        Case("deformnb, Wendland C2", ours(support=support), lambda r: r - compact, ours=True, row=row),
        Case("deformnb, thin plate", ours(kernel="thin_plate"), error, ours=True),
    ]
    # without the solve
    cases += c_loops.cases("uint8", lambda loops: c_loops.sums(loops, fit, raster), lambda r: r - compact)
    cases += general_warp(options.size, options.points)
    if options.loops:
        return cases
    cases.append(Case("scipy RBFInterpolator, thin plate", scipy, error))
    if importlib.util.find_spec("vtkmodules"):
        cases.append(Case("VTK ThinPlateSpline + TransformToGrid", _vtk(at, d, raster), error))
    if importlib.util.find_spec("itk"):
        cases.append(Case("ITK ThinPlateR2LogRSplineKernelTransform", _itk(at, d, raster, options.threads), error))
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


def _itk(at: NDArray[np.float64], d: NDArray[np.float64], raster: Raster, threads: int) -> Callable[[], NDArray[Any]]:
    import itk

    field = itk.Image[itk.Vector[itk.F, 2], 2]

    def run() -> NDArray[Any]:
        spline = itk.ThinPlateR2LogRSplineKernelTransform[itk.D, 2].New()
        landmarks = spline.GetModifiableSourceLandmarks(), spline.GetModifiableTargetLandmarks()
        for places, given in zip(landmarks, (at, at + d), strict=True):
            for k, point in enumerate(given.tolist()):
                places.SetPoint(k, point)
        spline.ComputeWMatrix()
        filled = itk.TransformToDisplacementFieldFilter[field, itk.D].New()
        filled.SetTransform(spline)
        filled.SetSize(raster.shape[::-1])
        filled.SetOutputSpacing(raster.spacing)
        filled.SetOutputOrigin(raster.origin)
        if threads:
            filled.SetNumberOfWorkUnits(threads)
        filled.Update()
        return np.moveaxis(itk.array_from_image(filled.GetOutput()), -1, 0)

    return run


def _skimage(at: NDArray[np.float64], d: NDArray[np.float64], raster: Raster) -> Callable[[], NDArray[Any]]:
    from skimage.transform import ThinPlateSplineTransform

    pixels = raster.points().reshape(-1, 2)

    def run() -> NDArray[Any]:
        spline = ThinPlateSplineTransform.from_estimate(at, at + d)
        return (spline(pixels) - pixels).T.reshape(2, *raster.shape)

    return run

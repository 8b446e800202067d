"""Questions about a map: M1 where it folds, on a picture; M2 its inverse at 100 000 nodes, in a plane and in space."""

from __future__ import annotations

import importlib.util
from argparse import Namespace
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import LinearNDInterpolator

from benchmarks import problem
from benchmarks.timing import Case, Group
from deformnb.analysis.folds import jacobian_determinant
from deformnb.rbf.extrusion import extrude, modulate, replicate
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.fitting import fit_rbf
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid
from deformnb.warping.inverse import invert
from deformnb.warping.points import warp_points

NODES = 100_000

# At the rim a peer that knows samples only has nothing to look up; the drags are a twentieth of the edge long.
RIM = 0.15


def groups(options: Namespace) -> Iterator[Group]:
    size = options.size
    flat = fit_rbf(problem.control_points(options.points, 2, size), support=problem.SUPPORT * (size - 1))
    solid = fit_rbf(problem.control_points(options.points, 3, size), support=problem.SUPPORT * (size - 1))
    yield _folds(flat, size)
    edge = round(NODES ** (1 / 2))
    step = (size - 1) / (edge - 1)
    yield _inverse("in a plane", flat, Raster((edge, edge), (step, step), (0.0, 0.0)), options)
    edge = round(NODES ** (1 / 3))
    step = (size - 1) / (edge - 1)
    grid = Grid((edge, edge, edge), (step, step, step))
    yield _inverse("in space", solid, grid, options)
    yield _extruded(flat, grid)


def _nodes(lattice: Grid | Raster) -> NDArray[np.float64]:
    if isinstance(lattice, Raster):
        return lattice.points()
    return lattice.index_to_point(np.moveaxis(np.indices(lattice.shape)[::-1], 0, -1))


def _folds(field: AbstractField, size: int) -> Group:
    raster = Raster((size, size), (1.0, 1.0), (0.0, 0.0))
    truth = jacobian_determinant(field, raster.points())
    sampled = np.ascontiguousarray(np.moveaxis(field.sample_on_raster(raster), 0, -1))

    def error(result: NDArray[Any]) -> NDArray[Any]:
        return (result - truth)[1:-1, 1:-1]

    def differences() -> NDArray[Any]:
        by_row, by_column = np.gradient(sampled, axis=(0, 1))
        return (1 + by_column[..., 0]) * (1 + by_row[..., 1]) - by_row[..., 0] * by_column[..., 1]

    cases = [
        Case("deformnb, from the control points", lambda: jacobian_determinant(field, raster), error, ours=True),
        Case("deformnb, float64", lambda: jacobian_determinant(field, raster.points()), error, ours=True),
        Case(
            "JAX, automatic, float64",
            lambda: np.linalg.det(np.eye(2) + AbstractField.jacobian(field, raster.points())),
            error,
        ),
        Case("NumPy differences, the field given at all pixels", differences, error),
    ]
    if importlib.util.find_spec("SimpleITK"):
        import SimpleITK as sitk  # noqa: N813 (the name that its own manual uses)

        image = sitk.GetImageFromArray(sampled.astype(np.float64), isVector=True)
        cases.append(
            Case(
                "SimpleITK, the field given at all pixels",
                lambda: sitk.GetArrayFromImage(sitk.DisplacementFieldJacobianDeterminant(image)),
                error,
            )
        )
    return Group(f"M1: determinants at {size} x {size}", cases, 0.02, "1")


def _inverse(name: str, field: AbstractField, lattice: Grid | Raster, options: Namespace) -> Group:
    x, step = _nodes(lattice), min(lattice.spacing)
    truth = (warp_points(x, field, tolerance=1e-10)[0] - x) / step
    inner = tuple(slice(int(RIM * n), n - int(RIM * n)) for n in lattice.shape)

    def error(result: NDArray[Any]) -> NDArray[Any]:
        return (result / step - truth)[inner]

    values = field.displacement(x)

    def scipy() -> NDArray[Any]:
        arrived = (x + values).reshape(-1, field.dim)
        return np.asarray(LinearNDInterpolator(arrived, -values.reshape(-1, field.dim))(x))

    cases = [
        Case("deformnb invert", lambda: invert(field, lattice).field.values, error, ours=True),
        Case(
            "deformnb invert, to 1e-6 of a step",
            lambda: invert(field, lattice, tolerance=1e-6 * step).field.values,
            error,
            ours=True,
        ),
        Case("scipy LinearNDInterpolator", scipy, error),
    ]
    if importlib.util.find_spec("SimpleITK"):
        cases += _itk(values, lattice, options.threads, error)
    return Group(f"M2: inverse of {x[..., 0].size} nodes {name}", cases, 1.0, "steps")


def _itk(values: NDArray[np.float64], lattice: Grid | Raster, threads: int, error: Any) -> list[Case]:
    import SimpleITK as sitk  # noqa: N813

    if threads:
        sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(threads)
    image = sitk.GetImageFromArray(values, isVector=True)
    image.SetSpacing(lattice.spacing)

    def case(name: str, run: Callable[[], Any]) -> Case:
        return Case(f"SimpleITK {name}", lambda: sitk.GetArrayFromImage(run()), error)

    return [
        case("InvertDisplacementField, as it comes", lambda: sitk.InvertDisplacementField(image)),
        case(
            "InvertDisplacementField, 100 turns to 1e-3", lambda: sitk.InvertDisplacementField(image, 100, 1e-3, 1e-4)
        ),
        case("IterativeInverseDisplacementField, as it comes", lambda: sitk.IterativeInverseDisplacementField(image)),
    ]


def _extruded(field: AbstractField, grid: Grid) -> Group:
    plane, x = Plane.from_view(grid, "+z"), _nodes(grid)
    same, pages = (extrude(plane, grid, [field], rule) for rule in (replicate(), modulate("sin(pi*z)")))
    truth = warp_points(x, same, tolerance=1e-10)[0] - x

    def error(result: NDArray[Any]) -> NDArray[Any]:
        return (result - truth) / min(grid.spacing)

    cases = [
        Case("deformnb invert, replicated", lambda: invert(same, grid).field.values, error, ours=True),
        Case("deformnb warp_points, replicated", lambda: warp_points(x, same)[0] - x, error, ours=True),
        Case("deformnb invert, modulated", lambda: invert(pages, grid).field.values, ours=True),
    ]
    return Group(f"M2: inverse of {x[..., 0].size} nodes of an extrusion", cases, 0.01, "steps")

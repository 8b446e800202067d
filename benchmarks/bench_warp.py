"""Warps of a volume: W1 one replicated map, W2 a map that varies with depth, W3 any field, given or fitted, W4 any
field given for a volume of twice the edge, 512^3 voxels."""

from __future__ import annotations

import importlib.util
from argparse import Namespace
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks import c_loops, peers, problem
from benchmarks.goals import PREPARED
from benchmarks.timing import Case, Group
from deformnb.rbf.extrusion import extrude, modulate, replicate
from deformnb.rbf.fields import AbstractField, DisplacementField
from deformnb.rbf.fitting import fit_rbf
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Volume
from deformnb.warping.warper import Warper

FILL = 0.0

Error = Callable[[NDArray[Any]], NDArray[np.float32]]


def groups(options: Namespace) -> Iterator[Group]:
    volume = problem.volume(options.size, options.dtype)
    support = problem.SUPPORT * (options.size - 1)
    flat = fit_rbf(problem.control_points(options.points, 2, options.size), support=support)
    stored = DisplacementField.sample(flat, Raster((options.size, options.size), (1.0, 1.0), (0.0, 0.0)))
    for view, axis in (("+y", 1), ("+x", 2), ("+z", 0)):
        plane = Plane.from_view(volume.grid, view)
        yield _replicated(volume, extrude(plane, volume.grid, [stored], replicate()), view, axis, options)
    plane = Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    yield _modulated(volume, extrude(plane, volume.grid, [stored], modulate("sin(pi*z)")), options)
    solid = fit_rbf(problem.control_points(options.points, 3, options.size), support=support)
    yield _general(volume, solid, options)
    if options.dtype != "float32":
        yield _given(problem.volume(options.size, "float32"), solid, "general, field given, float32")
    yield _large(options)


def _replicated(volume: Volume, field: AbstractField, view: str, axis: int, options: Namespace) -> Group:
    name = f"W1 {view}: replicated map along {'zyx'[axis]}, {volume.dtype}, map given"
    displacement, lookup, error = _truth(volume, field)
    fast, plain = Warper(volume, fill=FILL), Warper(volume, fill=FILL)
    fast.prepare(axis)
    cases = [
        _ours("prepared", lambda: fast(field).values, error, f"replicated along {'zyx'[axis]}, prepared"),
        _ours("in place", lambda: plain(field).values, error, f"replicated along {'zyx'[axis]}, in place"),
        Case("deformnb, one call from scratch", lambda: Warper(volume, fill=FILL)(field).values, error, ours=True),
    ]
    rest = [2 - a for a in range(3) if a != axis]  # component x, y, z of rows and columns
    flat = displacement.take(0, axis)
    given = volume.values, flat[..., rest[0]], flat[..., rest[1]], FILL, axis
    for loop, make in _loops_of_rows(given).items():
        cases += c_loops.cases(options.dtype, make, error, loop)
    if _is_installed("numba"):
        from benchmarks import loops

        cases.append(Case("numba loop", loops.rows(*given), error))
    if options.loops:
        return Group(name, cases, *_tolerance(volume))
    cases.append(Case("scipy map_coordinates by slice", peers.scipy_slices(volume.values, lookup, FILL, axis), error))
    return Group(name, cases + _rivals(volume, displacement, lookup, error, options), *_tolerance(volume))


def _loops_of_rows(given: tuple[Any, ...]) -> dict[str, Callable[[c_loops.Loops], c_loops.Run]]:
    """Loops in C by their names: with the axis last in memory, as the prepared warp has it, and the volume as it lies.
    Weights of 8 bits are another job, up to two grey levels off."""
    values, axis = given[0], given[-1]
    made: dict[str, Callable[[c_loops.Loops], c_loops.Run]] = {PREPARED: lambda loops: c_loops.rows(loops, *given)}
    if axis < 2:
        made["C in place"] = lambda loops: c_loops.rows_in_place(loops, *given)
    if values.dtype == np.uint8:
        made["C, weights of 8 bits"] = lambda loops: c_loops.rows(loops, *given, function="rows_of_8_bits")
    return made


def _ours(name: str, run: Callable[[], Any], error: Error | None, row: str) -> Case:
    return Case(f"deformnb, {name}" if name else "deformnb", run, error, ours=True, row=row)


def _modulated(volume: Volume, field: AbstractField, options: Namespace) -> Group:
    displacement, lookup, error = _truth(volume, field)
    warper = Warper(volume, fill=FILL)
    cases = [_ours("", lambda: warper(field).values, error, "modulated along z")]
    middle = displacement[volume.shape[0] // 2]
    weights = np.abs(displacement).max(axis=(1, 2, 3)) / np.abs(middle).max()
    given = volume.values, middle[..., 1], middle[..., 0], weights, FILL
    cases += c_loops.cases(options.dtype, lambda loops: c_loops.modulated(loops, *given), error)
    if _is_installed("numba"):
        from benchmarks import loops

        cases.append(Case("numba loop", loops.general(volume.values, displacement, FILL), error))
    cases += _rivals(volume, displacement, lookup, error, options)[:2]
    return Group(f"W2: map times sin(pi z) along z, {volume.dtype}, map given", cases, *_tolerance(volume))


def _general(volume: Volume, field: AbstractField, options: Namespace) -> Group:
    stored = DisplacementField.sample(field, volume.grid)
    displacement, lookup, error = _truth(volume, stored)
    warper = Warper(volume, fill=FILL)
    row = "general, field given" + (", float32" if options.dtype == "float32" else "")
    cases = [_ours("field given", lambda: warper(stored).values, error, row)]
    given = volume.values, c_loops.components(displacement), FILL
    cases += c_loops.cases(options.dtype, lambda loops: c_loops.general(loops, *given), error)
    if _is_installed("numba"):
        from benchmarks import loops

        cases.append(Case("numba loop", loops.general(volume.values, displacement, FILL), error))
    cases += _rivals(volume, displacement, lookup, error, options)
    if _is_installed("skimage") and not options.loops:
        cases.append(Case("scikit-image warp", peers.skimage_warp(volume.values, lookup, FILL), error))
    for step in (1, 2, 4):
        coarse = Warper(volume, fill=FILL, step=step)
        cases.append(
            Case(
                f"deformnb, {options.points} points to voxels, step {step}",
                lambda coarse=coarse: coarse(field).values,
                error if step == 1 else None,
                ours=True,
                row="general, 32 points, a node every 4 voxels" if (step, options.points) == (4, 32) else "",
            )
        )
    return Group(f"W3: general field in space, {volume.dtype}", cases, *_tolerance(volume))


def _given(volume: Volume, field: AbstractField, row: str) -> Group:
    """A given field alone, beside C."""
    stored = DisplacementField.sample(field, volume.grid)
    displacement, _, error = _truth(volume, stored)
    warper, given = Warper(volume, fill=FILL), (volume.values, c_loops.components(displacement), FILL)
    cases = [_ours("field given", lambda: warper(stored).values, error, row)]
    cases += c_loops.cases(volume.dtype.name, lambda loops: c_loops.general(loops, *given), error)
    return Group(f"W3: general field in space, {volume.dtype}, field given", cases, *_tolerance(volume))


def _large(options: Namespace) -> Group:
    """Eight times as many voxels: no cache holds them. What they should be is known from the smaller volumes."""
    size = 2 * options.size
    volume, points = problem.volume(size, options.dtype), problem.control_points(options.points, 3, size)
    stored = DisplacementField.sample(fit_rbf(points, support=problem.SUPPORT * (size - 1)), volume.grid)
    warper, given = Warper(volume, fill=FILL), (volume.values, c_loops.components(stored.values), FILL)
    cases = [_ours("field given", lambda: warper(stored).values, None, "general, field given, 512^3")]
    cases += c_loops.cases(options.dtype, lambda loops: c_loops.general(loops, *given))
    return Group(f"W4: general field in space, {size}^3, {volume.dtype}", cases, *_tolerance(volume))


def _rivals(
    volume: Volume, displacement: NDArray[Any], lookup: NDArray[np.float64], error: Error, options: Namespace
) -> list[Case]:
    """The libraries that take any field."""
    if options.loops:
        return []
    cases = [Case("scipy map_coordinates", peers.scipy_warp(volume.values, lookup, FILL), error)]
    if _is_installed("SimpleITK"):
        warp = peers.sitk_warp(volume.values, displacement, FILL, options.threads)
        resample = peers.sitk_resample(volume.values, displacement, FILL, options.threads)
        cases += [Case("SimpleITK Warp", warp, error), Case("SimpleITK Resample", resample, error)]
    if _is_installed("vtkmodules"):
        cases.append(Case("VTK ImageReslice", peers.vtk_reslice(volume.values, displacement, FILL), error))
    return cases


def _truth(volume: Volume, field: AbstractField) -> tuple[NDArray[np.float32], NDArray[np.float64], Error]:
    """Displacements (nz, ny, nx, 3), their lookups (3, nz, ny, nx), and the error of a result by scipy's float64.

    Only places between the outermost voxel centres are compared: at the rim each library has its own rule.
    """
    if isinstance(field, DisplacementField):
        displacement = np.asarray(field.values, dtype=np.float32)
    else:
        displacement = field.sample_on_grid(volume.grid)
    lookup = problem.lookup(displacement)
    right = ndimage.map_coordinates(volume.values, lookup, output=np.float32, order=1, mode="nearest")
    inside = ((lookup >= 0) & (lookup <= volume.shape[0] - 1)).all(axis=0)

    def error(result: NDArray[Any]) -> NDArray[np.float32]:
        return np.where(inside, result - right, 0)

    return displacement, lookup, error


def _tolerance(volume: Volume) -> tuple[float, str]:
    # Some cut the fraction off where we round; VTK reads the field with float32 places, 2e-5 voxels off.
    return (1.01 if volume.dtype.kind in "iu" else 255 * 1e-4), "grey levels"


def _is_installed(module: str) -> bool:
    return importlib.util.find_spec(module) is not None

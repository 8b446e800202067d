"""Whole edits, from control points that have moved to the new volume: E1 near a cut, E2 near a rigid part, E3 of
points in space, E4 of several deformations one after the other. Each is the work after a point is dropped;
the previews are the work while it moves."""

from __future__ import annotations

import itertools
from argparse import Namespace
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.interpolate import RBFInterpolator

from benchmarks import c_loops, peers, problem
from benchmarks.goals import GENERAL, ROWS
from benchmarks.timing import Case, Group
from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.cuts import Cut, sides_of
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Line
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import Warper

FILL = 0.0

# Nodes of the displacement in space are this many voxels apart; between them it is interpolated, as the peer does.
STEP = 4


def groups(options: Namespace) -> Iterator[Group]:
    volume = problem.volume(options.size, options.dtype)
    flat = problem.control_points(options.points, 2, options.size)
    solid = problem.control_points(options.points, 3, options.size)
    plane = Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    middle = (options.size - 1) / 2
    cut = Cut(Line(((middle, options.size), (middle + 3, middle), (middle, -1.0))))
    on_picture = Step((flat,), plane, kernel="thin_plate", cuts=(cut,), cut_rule="paper")
    loop = _loop(volume, solid)
    yield _near_cut(volume, on_picture, loop, options)
    ground = RigidPart(HalfSpace((0.0, 1.02 * options.size), (0.0, -1.0)))
    yield _plain_edit(volume, "rigid part on a picture", Step((flat,), plane, parts=(ground,)), loop)
    below = RigidPart(HalfSpace((0.0, 0.0, -0.02 * options.size), (0.0, 0.0, 1.0)))
    yield _plain_edit(volume, "rigid part in space", Step((solid,), parts=(below,)), loop)
    yield _replicated(volume, Step((flat,), plane), loop, options)
    yield _space_edits(volume, Step((solid,), kernel="thin_plate"), loop, options)
    yield _composition(volume, flat, solid, plane, cut, loop)


def _loop(volume: Volume, solid: ControlPoints) -> list[Case]:
    """The general warp in C, its field given, by which the goals of edits are measured."""
    given = volume.values, list(Step((solid,)).field(volume.grid).components_on_grid(volume.grid)), FILL
    return list(c_loops.cases(volume.dtype.name, lambda loops: c_loops.general(loops, *given), name=GENERAL))


def _edits(volume: Volume, edited: Step, **options: Any) -> Callable[[], NDArray[Any]]:
    """Calls that move the points a little, so that nothing of the edit before can be reused."""
    warper = Warper(volume, fill=FILL, **options)
    if edited.plane is not None:
        warper.prepare(0)
    strengths = itertools.cycle([1.0, 1.0 + 1e-6])

    def edit() -> NDArray[Any]:
        return warper(replace(edited, strength=next(strengths)).field(volume.grid)).values

    return edit


def _preview(volume: Volume, edited: Step, **options: Any) -> Case:
    values = np.ascontiguousarray(volume.values[::2, ::2, ::2])
    half = Volume(values, Grid(values.shape, (2.0, 2.0, 2.0)))
    return Case("deformnb, preview of half the resolution", _edits(half, edited, **options), ours=True)


def _replicated(volume: Volume, step: Step, loop: list[Case], options: Namespace) -> Group:
    cases = [Case("deformnb", _edits(volume, step), ours=True, row="edit on a picture")]
    cases += c_loops.cases(volume.dtype.name, lambda loops: _edit_in_c(loops, volume, step))
    cases += loop
    if not options.loops:
        cases.append(Case("scipy RBFInterpolator and map_coordinates", _scipy_picture(volume, step)))
    return Group(f"E3: points on a picture, replicated, {volume.dtype}", cases, 0, "grey levels")


def _edit_in_c(loops: c_loops.Loops, volume: Volume, step: Step) -> c_loops.Run:
    """A map evaluated from coefficients that are solved, and a warp of a volume with the axis of replication last."""
    fit, raster = fit_rbf(step.points), Raster(volume.shape[1:], (1.0, 1.0), (0.0, 0.0))
    evaluate = c_loops.sums(loops, fit, raster)
    across, down = evaluate()  # which the warp reads: it is the same memory at every call
    warp = c_loops.rows(loops, volume.values, down, across, FILL, 0)

    def edit() -> NDArray[Any]:
        evaluate()
        return warp()

    return edit


def _scipy_picture(volume: Volume, step: Step) -> Callable[[], NDArray[Any]]:
    raster = np.stack(np.meshgrid(*[np.arange(n, dtype=float) for n in volume.shape[:0:-1]]), axis=-1)

    def edit() -> NDArray[Any]:
        there = raster + RBFInterpolator(step.points.target, step.points.displacement, degree=1)(
            raster.reshape(-1, 2)
        ).reshape(raster.shape)
        return np.stack(
            [ndimage.map_coordinates(plane, [there[..., 1], there[..., 0]], order=1) for plane in volume.values]
        )

    return edit


def _composition(
    volume: Volume, flat: ControlPoints, solid: ControlPoints, front: Plane, cut: Cut, loop: list[Case]
) -> Group:
    """Chains of displacements, and one fit in space that is evaluated at every voxel."""
    side = Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    first, then = Step((flat,), front), Step((flat,), side)
    chains = {
        "two planes": (first, then),
        "two planes, one with a cut": (replace(first, cuts=(cut,)), then),
        "16 stages": (Step((solid,), stages=16),),
        "edit in space, every voxel": (Step((solid,)),),
    }
    cases = [
        Case(
            f"deformnb, {name}",
            _edits_of_steps(volume, steps),
            ours=True,
            row=name if name in ROWS else "",
        )
        for name, steps in chains.items()
    ]
    return Group(f"E4: composed, {volume.dtype}", cases + loop, 0, "grey levels")


def _edits_of_steps(volume: Volume, steps: tuple[Step, ...]) -> Callable[[], NDArray[Any]]:
    warper, strengths = Warper(volume, fill=FILL), itertools.cycle([1.0, 1.0 + 1e-6])

    def edit() -> NDArray[Any]:
        strength = next(strengths)
        moved = Deformation(tuple(replace(step, strength=strength) for step in steps))
        return warper(moved.field(volume.grid)).values

    return edit


def _plain_edit(volume: Volume, name: str, step: Step, loop: list[Case]) -> Group:
    coarse = {} if step.plane is not None else {"step": STEP}
    free = replace(step, parts=())
    cases = [
        Case("deformnb", _edits(volume, step, **coarse), ours=True, row=f"edit near a {name}"),
        _preview(volume, step, **coarse),
        Case(
            "deformnb, without the part",
            _edits(volume, free, **coarse),
            ours=True,
            row=f"edit in space, a node every {STEP} voxels" if coarse else "",
        ),
    ]
    return Group(f"E2: {name}, {volume.dtype}", cases + loop, 0, "grey levels")


def _near_cut(volume: Volume, step: Step, loop: list[Case], options: Namespace) -> Group:
    truth = _edits(volume, step)().astype(np.float32)
    field = step.field(volume.grid)
    raster = np.stack(np.meshgrid(*[np.arange(n, dtype=float) for n in volume.shape[:0:-1]]), axis=-1)
    at = np.concatenate([raster, np.full((*raster.shape[:2], 1), 0.0)], axis=-1)
    clear = np.isin(field.opacity(at), (0.0, 1.0))  # the peer has no pixels that are partly covered

    def error(result: NDArray[Any]) -> NDArray[np.float32]:
        return np.where(clear, result - truth, 0)[:, 8:-8, 8:-8]  # at the rim each library has its own rule

    cases = [
        Case("deformnb", _edits(volume, step), error, ours=True, row="edit near a cut"),
        _preview(volume, step),
        Case(
            "deformnb, modulated by sin(pi z)",
            _edits(volume, replace(step, extrusion="modulate", curve="sin(pi*z)")),
            ours=True,
            row="edit near a modulated cut",
        ),
        *loop,
    ]
    if not options.loops:
        cases.append(Case("scipy RBFInterpolator and map_coordinates", _scipy_cut(volume, step, raster), error))
    tolerance = 1.01 if volume.dtype.kind in "iu" else 0.1
    return Group(f"E1: cut, replicated, {volume.dtype}", cases, tolerance, "grey levels")


def _scipy_cut(volume: Volume, step: Step, raster: NDArray[np.float64]) -> Callable[[], NDArray[Any]]:
    """Eqs. 7 and 8 as one would write them with SciPy; the regions of the pixels are known before."""
    region = step.cuts[0].region
    inside = region.signed_distance(raster) < 0

    def edit() -> NDArray[Any]:
        points = step.points
        belongs = sides_of([region], points.source)[:, 0]
        d = np.zeros_like(raster)
        for side in (True, False):
            some = belongs == side
            fit = RBFInterpolator(points.target[some], points.displacement[some], kernel="thin_plate_spline", degree=1)
            d[inside == side] = fit(raster[inside == side])
        there = raster + d
        seen = (region.signed_distance(there) < 0) == inside
        out = np.empty(volume.shape, np.float32)
        for k, plane in enumerate(volume.values):
            ndimage.map_coordinates(
                plane, [there[..., 1], there[..., 0]], output=out[k], order=1, mode="grid-constant", cval=FILL
            )
        return peers.rounded(np.where(seen, out, FILL), volume.dtype)

    return edit


def _space_edits(volume: Volume, step: Step, loop: list[Case], options: Namespace) -> Group:
    truth = _edits(volume, step, step=STEP)().astype(np.float32)

    def error(result: NDArray[Any]) -> NDArray[np.float32]:
        rim = slice(8, -8)
        return (result - truth)[rim, rim, rim]

    cases = [
        Case(
            f"deformnb, a node every {STEP} voxels",
            _edits(volume, step, step=STEP),
            error,
            ours=True,
        ),
        _preview(volume, step, step=STEP),
        Case("deformnb, every voxel", _edits(volume, step), ours=True),
        *loop,
    ]
    if not options.loops:
        cases.append(
            Case(f"scipy RBFInterpolator every {STEP} voxels, map_coordinates", _scipy_space(volume, step), error)
        )
    # Along x we have a node at every voxel and the peer every fourth: 2 grey levels where it bends most.
    return Group(f"E3: points in space, {volume.dtype}", cases, 6.0, "grey levels")


def _scipy_space(volume: Volume, step: Step) -> Callable[[], NDArray[Any]]:
    counts = [-(-(n - 1) // STEP) + 1 for n in volume.shape]
    lines = [STEP * np.arange(n, dtype=float) for n in counts]
    nodes = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)[..., ::-1]
    index = np.indices(volume.shape, dtype=np.float32)

    def edit() -> NDArray[Any]:
        points = step.points
        fit = RBFInterpolator(points.target, points.displacement, kernel="thin_plate_spline", degree=1)
        d = fit(nodes.reshape(-1, 3)).reshape(*counts, 3)
        lookup = np.stack([index[a] + ndimage.map_coordinates(d[..., 2 - a], index / STEP, order=1) for a in range(3)])
        return peers.scipy_warp(volume.values, lookup, FILL)()

    return edit

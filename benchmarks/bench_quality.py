"""Diagnostics of a fit: Q1 leave-one-out of all points, Q2 the uncertainty of the map on a picture."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import problem
from benchmarks.timing import Case, Group
from deformnb.analysis.gaussian_process import uncertainty
from deformnb.analysis.quality import fit_quality
from deformnb.rbf.fields import raster_lines
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.kernels import WendlandC2
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Raster


def groups(options: Namespace) -> Iterator[Group]:
    support = problem.SUPPORT * (options.size - 1)
    for count in (128, 512):
        yield _leave_one_out(problem.control_points(count, 2, options.size), support)
    yield _uncertainty(problem.control_points(options.points, 2, options.size), support, options.size)


def _leave_one_out(points: ControlPoints, support: float) -> Group:
    def ours(trend: str) -> NDArray[Any]:
        return fit_quality(points, support=support, trend=trend).leave_one_out

    def loop(trend: str) -> NDArray[Any]:
        return np.array(
            [
                points.displacement[k]
                - fit_rbf(points.remove(i), support=support, trend=trend).displacement(points.target[k])
                for k, i in enumerate(points.ids)
            ]
        )

    right = {trend: loop(trend) for trend in ("affine", "rigid")}
    cases = [
        Case("deformnb, affine, with all figures", lambda: ours("affine"), lambda r: r - right["affine"], ours=True),
        Case("deformnb, rigid, with all figures", lambda: ours("rigid"), lambda r: r - right["rigid"], ours=True),
        Case("a fit for every point, affine", lambda: loop("affine"), lambda r: r - right["affine"]),
    ]
    return Group(f"Q1: leave-one-out of {len(points)} points", cases, 1e-6, "pixels")


def _uncertainty(points: ControlPoints, support: float, size: int) -> Group:
    raster = Raster((size, size), (1.0, 1.0), (0.0, 0.0))
    known = uncertainty(points, support=support)
    right = known.at(raster.points())

    def dense() -> NDArray[Any]:
        """Universal kriging by its textbook formula, in NumPy."""
        kernel, x, at = WendlandC2(support), points.target, raster.points().reshape(-1, 2)
        phi = kernel(np.linalg.norm(x[:, None] - x[None], axis=-1))
        p, here = (np.column_stack([np.ones(len(a)), a]) for a in (x, at))
        bordered = np.block([[phi, p], [p.T, np.zeros((3, 3))]])
        k = np.column_stack([kernel(np.linalg.norm(at[:, None] - x[None], axis=-1)), here])
        variance = 1 - (k * np.linalg.solve(bordered, k.T).T).sum(axis=1)
        return known.sigma * np.sqrt(np.maximum(variance, 0)).reshape(raster.shape)

    cases = [
        Case(
            "deformnb, with the fit",
            lambda: uncertainty(points, support=support).lattice_values(*raster_lines(raster)),
            lambda r: r - right,
            ours=True,
        ),
        Case("kriging in NumPy", dense, lambda r: r - right),
    ]
    return Group(f"Q2: uncertainty, {len(points)} points, {size} x {size}", cases, 1e-3, "pixels")

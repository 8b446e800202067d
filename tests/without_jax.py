"""The same calls for a process where JAX is installed and for one without it, which ``test_without_jax.py`` compares.

Run as a program, this module hides the packages whose names it is given, and then does one of its :data:`TASKS`.
"""

from __future__ import annotations

import doctest
import importlib
import inspect
import pkgutil
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np


class Hidden:
    """A finder of modules, the first of all, by which packages are as if they were not installed."""

    def __init__(self, *names: str) -> None:
        self.names = frozenset(names)

    def find_spec(self, name: str, _path: object = None, _target: object = None) -> None:
        if name.partition(".")[0] in self.names:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


# ---- the same calls --------------------------------------------------------------------------------------------------


def calls() -> Iterator[tuple[str, Callable[[], Any]]]:
    """Calls of every kind by name; each returns an array or several."""
    yield from _fits()
    yield from _kernels()
    yield from _fields()
    yield from _judged()
    yield from _warps()


def _points(dim: int, count: int = 9) -> Any:
    dn: Any = importlib.import_module("deformnb")

    rng = np.random.default_rng(dim)
    source = rng.uniform(0, 40, (count, dim))
    return dn.ControlPoints.from_arrays(source, source + rng.normal(0, 1.5, source.shape))


def _places(dim: int) -> Any:
    return np.random.default_rng(9).uniform(-5, 45, (70, dim))


def _evaluated(field: Any) -> tuple[Any, ...]:
    x = _places(field.dim)
    lines = [np.outer(np.eye(field.dim)[k], np.linspace(0, 40, 9)) for k in (0, 1)]
    return field.displacement(x), field.jacobian(x), field.lattice_values(*lines, 1.0), field.lattice_jacobians(*lines)


def _fitted(dim: int, settings: dict[str, Any]) -> tuple[Any, ...]:
    from deformnb.rbf.fitting import fit_rbf

    return _evaluated(fit_rbf(_points(dim, 12), **settings))


def _fits() -> Iterator[tuple[str, Callable[[], Any]]]:
    dn: Any = importlib.import_module("deformnb")
    from deformnb.rbf.kernels import KERNELS, WendlandC2
    from deformnb.rbf.trends import TRENDS

    for kernel, trend, dim in product(KERNELS.values(), TRENDS.values(), (2, 3)):
        if trend.order >= kernel.order:
            name = f"{kernel.name}, {trend.name}, {dim}"
            settings: dict[str, Any] = {"kernel": kernel.name, "trend": trend.name, "support": 50.0}
            yield name, partial(_fitted, dim, settings)
    own = replace(_points(2), radius=np.linspace(15.0, 30.0, 9))
    yield "radii", lambda: _evaluated(dn.fit_rbf(own))
    yield "smoothing", lambda: _evaluated(dn.fit_rbf(_points(2), smoothing=0.1))
    yield "many", lambda: _evaluated(dn.fit_rbf(_points(2, 600), kernel=WendlandC2, support=6.0, smoothing=0.1))


def _kernels() -> Iterator[tuple[str, Callable[[], Any]]]:
    from deformnb.rbf.fitting import fit_rbf
    from deformnb.rbf.kernels import KERNELS, register_kernel
    from deformnb.widgets.kernel_table import kernel_table

    r = np.linspace(0.0, 30.0, 61)
    for kernel in KERNELS.values():
        yield f"values of {kernel.name}", partial(kernel(20.0), r)

    def matern(rho: Any) -> Any:
        if isinstance(rho, np.ndarray) or "jax" not in sys.modules:
            return (1 + 6 * rho + 12 * rho**2) * np.exp(-6 * rho)
        jnp = importlib.import_module("jax.numpy")
        return (1 + 6 * rho + 12 * rho**2) * jnp.exp(-6 * rho)

    def registered() -> tuple[Any, ...]:
        kind = register_kernel(matern, name="of_the_test")
        try:
            return *_evaluated(fit_rbf(_points(2), kernel=kind, support=40.0)), kernel_table(kind).powers
        finally:
            del KERNELS[kind.name]

    yield "a registered kernel", registered


def _fields() -> Iterator[tuple[str, Callable[[], Any]]]:
    dn: Any = importlib.import_module("deformnb")
    from deformnb.rbf.bspline import BSplineField
    from deformnb.rbf.cuts import CUT_RULES
    from deformnb.rbf.extrusion import EXTRUSIONS, extrude
    from deformnb.rbf.fields import AbstractField, DisplacementField
    from deformnb.rbf.fit_settings import FitSettings
    from deformnb.rbf.fitting import fit_forward
    from deformnb.rbf.rigid import WEIGHTS, without_conflicts

    flat = _points(2)
    bone = dn.Polygon([(12, 12), (20, 11), (24, 22), (14, 26)])
    marks = np.zeros((20, 20), bool)
    marks[6:11, 4:12] = True
    mask = dn.Mask(marks, dn.Raster((20, 20), (2.0, 2.0), (0.0, 0.0)))
    across = dn.Line([(5, 18), (20, 22), (35, 17)])
    slit = replace(across, stops=(False, True))
    turn = dn.RigidMotion.turn(20, about=(18, 18), shift=(1, 0))

    def with_parts(parts: list[Any]) -> tuple[Any, ...]:
        return _evaluated(FitSettings().fit(without_conflicts(flat, parts), parts))

    for (where, region), weight, motion in product(
        (("polygon", bone), ("mask", mask), ("half space", dn.HalfSpace((0, 3), (0, 1)))), WEIGHTS, (None, turn)
    ):
        part = dn.RigidPart(region, motion, weight=weight)
        name = f"part {where}, {weight}, {'fixed' if motion is None else 'moved'}"
        yield name, partial(with_parts, [part])
    parts = [dn.RigidPart(bone, turn), dn.RigidPart(dn.HalfSpace((0, 3), (0, 1)))]
    yield "two parts", partial(with_parts, parts)
    for rule in CUT_RULES:

        def opened(rule: Any = rule) -> tuple[Any, ...]:
            field = FitSettings().fit(flat, cuts=[across], cut_rule=rule, softness=0.5)
            return *_evaluated(field), field.opacity(_places(2))

        yield f"cut, {rule}", opened
    yield "slit", lambda: _evaluated(FitSettings().fit(flat, cuts=[slit], softness=0.5))
    yield "stages", lambda: _evaluated(FitSettings(stages=3).fit(flat))
    for region in (bone, mask, across, dn.HalfSpace((0, 3, 1), (0, 1, 1))):
        yield f"distance of {region.kind}", partial(region.signed_distance, _places(region.dim))

    def forward() -> tuple[Any, ...]:
        fit = fit_forward(flat)
        return *_evaluated(fit)[:3], fit.found(_places(2))

    yield "forward", forward
    grid = dn.Grid((9, 10, 11), (4.0, 4.0, 4.0))
    given: dict[str, Any] = {"replicate": (), "modulate": ("sin(z)",), "interpolate": ([0.2, 0.8],)}
    for name, make in EXTRUSIONS.items():
        maps = [dn.fit_rbf(flat), dn.fit_rbf(_points(2, 7))][: 2 if name == "interpolate" else 1]
        field = extrude(dn.Plane.from_view(grid, "+y"), grid, maps, make(*given[name]))
        yield f"extrusion {name}", partial(_evaluated, field)
    space = dn.fit_rbf(_points(3))
    yield "composed", lambda: _evaluated(dn.rbf.compose(space, dn.fit_rbf(_points(3, 7))))
    yield "sampled", lambda: _evaluated(DisplacementField.sample(space, grid))
    coefficients = np.random.default_rng(3).normal(size=(12, 12, 12, 3))
    axes = tuple(map(tuple, 5.0 * np.eye(3)))
    yield "B-spline", lambda: _evaluated(BSplineField(coefficients, (-10.0, -10.0, -10.0), axes))

    class Own(AbstractField):
        """A map whose derivative the package finds itself."""

        dim = 2

        def displacement(self, points: Any) -> Any:
            return np.asarray(self.jax_displacement(np.asarray(points, float)))

        def jax_displacement(self, points: Any) -> Any:
            return points * points[..., ::-1] / 100 + (points**3).sum(axis=-1, keepdims=True) / 1e4

    yield "a field of one's own", lambda: Own().jacobian(_places(2))


def _judged() -> Iterator[tuple[str, Callable[[], Any]]]:
    dn: Any = importlib.import_module("deformnb")
    from deformnb.rbf.trends import TRENDS

    flat = _points(2)

    def missed(trend: str) -> Any:
        return dn.analysis.fit_quality(flat, trend=trend).leave_one_out

    for name in TRENDS:
        yield f"quality, {name}", partial(missed, name)
    yield "uncertainty", lambda: dn.analysis.uncertainty(flat).at(_places(2))
    field = dn.fit_rbf(_points(3))
    yield "stretches", lambda: dn.analysis.stretches(field, _places(3)).principal
    yield "points", lambda: dn.warp_points(_places(3), field)
    yield "inverse", lambda: dn.invert(field, dn.Grid((9, 10, 11), (4.0, 4.0, 4.0))).field.values


def _warps() -> Iterator[tuple[str, Callable[[], Any]]]:
    dn: Any = importlib.import_module("deformnb")
    from deformnb.volume.sampling import METHODS

    carp = dn.datasets.PHANTOMS["fish"].make((12, 24, 20))
    flat = dn.ControlPoints.from_arrays(*(np.asarray(p) * 0.8 for p in (_points(2).source, _points(2).target)))
    plain = dn.Deformation.from_picture_points(carp, "-x", flat)
    step = plain.steps[0]
    steps = {
        "extruded": step,
        "modulated": replace(step, extrusion="modulate", curve="z*z"),
        "cut": replace(step, cuts=(dn.Cut(dn.Line([(10, -50), (10, 50)])),)),
        "opened with depth": replace(
            step, cuts=(dn.Cut(dn.Line([(10, -50), (10, 50)])),), extrusion="modulate", curve="z"
        ),
        "stages": replace(step, stages=2),
    }

    def warped(volume: Any, deformation: Any, method: str) -> Any:
        return dn.warp(volume, deformation, method=method).values

    for (what, one), method in product(steps.items(), METHODS):
        yield f"{what}, {method}", partial(warped, carp, dn.Deformation((one,)), method)
    deep = dn.Deformation.from_space_points(_points(3))
    for dtype, method in product(("uint8", "int16", "float32", "int32", "float64", "bool"), METHODS):
        if dtype != "bool" or method == "nearest":
            typed = dn.Volume((carp.values > 40) if dtype == "bool" else carp.values.astype(dtype), carp.grid)
            yield f"in space, {dtype}, {method}", partial(warped, typed, deep, method)
    fine = dn.Grid((14, 20, 21), tuple(0.9 * s for s in carp.grid.spacing), (2.0, 1.0, 3.0), carp.grid.direction)
    yield "another grid", lambda: dn.warp(carp, deep, output=fine, step=2).values
    picture = dn.project(carp, "-x")
    yield "picture", lambda: dn.warp_picture(picture.values, picture.raster, dn.fit_rbf(flat))

    def replayed() -> Any:
        session = dn.Session(carp)
        middle = session.editing.points.source.mean(axis=0)
        session.editing.edit_points(session.editing.points.add(middle, middle + np.array([2.0, 1.0])))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "session.json"
            session.save(path)
            return dn.read_deformation(path).apply(carp).values, session.results.volume().values

    yield "session", replayed


# ---- tasks of a process ----------------------------------------------------------------------------------------------


def write_results(path: str, level: str) -> None:
    """Results of all calls, with the compiled loops of a level."""
    from deformnb.native import library

    library.use_level(level or None)
    np.savez(path, allow_pickle=False, **results())


def results() -> dict[str, Any]:
    """The arrays that all calls return."""
    from deformnb.errors import DeformWarning

    found: dict[str, Any] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeformWarning)
        for name, call in calls():
            made = call()
            for k, array in enumerate(made if isinstance(made, tuple) else (made,)):
                found[f"{name} [{k}]"] = np.asarray(array)
    return found


class _Runner(doctest.DocTestRunner):
    """Examples, of which those that need JAX are listed."""

    def __init__(self) -> None:
        super().__init__(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE | doctest.FAIL_FAST, verbose=False)
        self.of_jax: list[str] = []
        self.wrong: list[str] = []

    def report_start(self, *_: Any) -> None:
        """Nothing."""

    def report_failure(self, out: Any, test: Any, example: Any, got: str) -> None:
        self.wrong.append(f"{test.name}: {example.source.strip()} gave {got.strip()}")

    def report_unexpected_exception(self, out: Any, test: Any, example: Any, exc_info: Any) -> None:
        error = exc_info[1]
        if (isinstance(error, ImportError) and getattr(error, "name", "") == "jax") or str(error).endswith(
            "needs JAX, which is not installed: pip install jax"
        ):
            self.of_jax.append(test.name)
        else:
            self.wrong.append(f"{test.name}: {example.source.strip()} raised {error!r}")


MATHEMATICS = ("analysis", "document", "rbf", "registration", "warping")
"""Packages whose examples compute most."""


def run_examples(path: str, level: str, packages: tuple[str, ...] = ()) -> None:
    """Run the examples of packages, by default of all, and write those that need JAX and those that fail."""
    import deformnb
    from deformnb.errors import DeformWarning
    from deformnb.native import library

    library.use_level(level or None)
    warnings.simplefilter("ignore", DeformWarning)
    sys.modules["matplotlib"] = importlib.import_module("matplotlib")
    sys.modules["matplotlib"].use("agg")
    runner, finder = _Runner(), doctest.DocTestFinder(exclude_empty=True)
    names = [module.name for module in pkgutil.walk_packages(deformnb.__path__, "deformnb.")]
    for name in names:
        if name in ("deformnb.__main__", "deformnb._jax"):  # the latter's are on JAX itself
            continue
        if not packages or name.split(".")[1] in packages:
            module = importlib.import_module(name)
            for test in finder.find(module, name):
                with tempfile.TemporaryDirectory():
                    runner.run(test, out=lambda text: None)
    text = [f"{runner.tries} examples", *map("needs JAX: {}".format, runner.of_jax), *runner.wrong]
    Path(path).write_text("\n".join(text), encoding="utf-8")


TASKS: dict[str, Callable[[str, str], None]] = {
    "results": write_results,
    "examples": run_examples,
    "examples of mathematics": lambda path, level: run_examples(path, level, MATHEMATICS),
}

if __name__ == "__main__":
    task, out, loops, *hidden = sys.argv[1:]
    sys.meta_path.insert(0, Hidden(*hidden))
    TASKS[task](out, loops)
    imported = sorted(name for name in sys.modules if name.partition(".")[0] in hidden)
    assert not imported, imported
    assert inspect.ismodule(sys.modules["deformnb"])

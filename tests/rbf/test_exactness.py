"""Every way to evaluate a map takes the control points to their targets within the stated bound, or reports by how much
it cannot: a table of kernels x evaluators x sets of points.

Targets are on centres of pixels, so that maps on lattices are compared without any interpolation in between. What is
right is given: ``D(target) = source - target``; away from the points it is the literal system in fifty digits.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property
from inspect import isabstract
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import jax
import numpy as np
import oracle
import pytest
from scripts import run_script

import deformnb as dn
from deformnb import devices
from deformnb.document.deformation import Deformation
from deformnb.document.json_format import from_json, to_json
from deformnb.imaging.thompson import magnify_field
from deformnb.io.transforms.formats import read_transform, write_transform
from deformnb.rbf.bspline import BSplineField
from deformnb.rbf.conditioning import prepare
from deformnb.rbf.exactness import DERIVATIVE, EXACT, EXACT_PLACE, SHARES
from deformnb.rbf.extrusion import Extrusion, modulate
from deformnb.rbf.fields import AbstractField, Affine, DisplacementField, Identity, Rescaled, blend, compose
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.fitting import fit_forward, fit_points, fit_rbf, fit_rigid
from deformnb.rbf.forward import ForwardFit
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.kernels import BUILT_IN, KERNELS
from deformnb.rbf.partition import LocalFits, fit_locally
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line, Polygon
from deformnb.rbf.rigid import RigidPart
from deformnb.rbf.slits import TipBlend
from deformnb.rbf.stages import Staged
from deformnb.rbf.trends import TRENDS
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.node_walk import FitSums

GAP = 4  # pixels between control points
SETS = {
    "few": (10, "dense", 1.0),
    "tiny drags": (150, "loose", 0.01),
    "noise": (400, "dense", 10.0),
    "many": (1200, "dense", 1.0),
    "many loose": (1200, "loose", 0.1),
    "local": (3000, "dense", 1.0),
}
"""Number of points, support, and drags in gaps."""
REACH = {"dense": 2.5, "loose": 8.0}  # gaps, which only kernels that are definite by themselves have


class Made:
    """A fit of a set of points whose targets are pixels, with its fields and files."""

    def __init__(self, kernel: str, name: str) -> None:
        count, reach, drag = SETS[name]
        rng = np.random.default_rng(len(kernel) + count)
        side = int(np.ceil(count**0.5))
        margin = int(np.ceil(drag * GAP)) + 3
        lattice = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).reshape(-1, 2)
        self.pixels = margin + GAP * lattice[rng.permutation(side * side)[:count]]
        self.size = 2 * margin + GAP * side
        self.target = self.pixels.astype(float)
        self.wanted = rng.uniform(-1, 1, self.target.shape) * drag * GAP
        self.points = ControlPoints.from_arrays(self.target + self.wanted, self.target)
        self.settings = {
            "kernel": kernel,
            "support": REACH[reach] * GAP,
            "trend": "quadratic" if KERNELS[kernel].order > 2 else "affine",
        }
        self.fit = fit_rbf(self.points, **self.settings)

    @cached_property
    def volume(self) -> Volume:
        """A ramp along x: the value of a voxel is the x of its source."""
        return Volume.from_array(np.broadcast_to(np.arange(float(self.size)), (2, self.size, self.size)).copy())

    @property
    def raster(self) -> Raster:
        return Raster((self.size, self.size), (1.0, 1.0), (0.0, 0.0))

    @cached_property
    def deformation(self) -> Deformation:
        return Deformation.from_picture_points(self.volume, "+z", self.points, **self.settings)

    @cached_property
    def field(self) -> AbstractField:
        return self.deformation.field(self.volume.grid)

    @cached_property
    def space(self) -> np.ndarray:
        return np.column_stack([self.target, np.zeros(len(self.target))])

    def picked(self, values: Any) -> np.ndarray:
        """The values of maps (2, rows, columns) at the targets (n, 2)."""
        x, y = self.pixels.T
        return np.asarray(values, dtype=float)[:2, y, x].T


@cache
def fit_case(kernel: str, name: str) -> Made:
    return Made(kernel, name)


class Evaluator(NamedTuple):
    """A way to evaluate a map: its results at the targets (n, 2), the methods it covers, the pixel's share."""

    at_targets: Callable[[Made], Any]
    methods: tuple[str, ...]
    share: float = 0.0


def lines(m: Made) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.zeros((2, m.size)), np.zeros((2, m.size))
    rows[1], columns[0] = np.arange(m.size), np.arange(m.size)
    return rows, columns


def single(m: Made) -> np.ndarray:
    return m.target.astype(np.float32)  # pixels are whole numbers, so nothing is rounded


def values_on_device(m: Made) -> np.ndarray:
    if not isinstance(m.fit, RBFInterpolant):  # local fits are evaluated on the host
        return m.fit(m.target)
    with devices.device_context():
        parts, is_finite = m.fit.evaluate_on_device(m.raster)
        assert is_finite
        return m.picked(np.stack(parts))


def one_after_the_other(m: Made) -> np.ndarray:
    return FitSums(1.0)(m.fit, m.target.T).T if isinstance(m.fit, RBFInterpolant) else m.fit(m.target)


def values_in_file(m: Made, suffix: str) -> np.ndarray:
    with TemporaryDirectory() as folder:
        path = Path(folder) / f"map{suffix}"
        write_transform(m.field, path, m.volume.grid)
        return read_transform(path)(m.space)[:, :2]


def warped(m: Made, field: Any, shift: int = 0) -> np.ndarray:
    """Displacements along x at the targets, by the values of a warp; those along y are not tested."""
    values = np.asarray(dn.warp(m.volume, field).values, dtype=float)
    x, y = m.pixels.T
    return np.column_stack([values[0, y, x - shift] - x, m.wanted[:, 1]])


SHIFT = Affine(np.eye(3), np.array([1.0, 0.0, 0.0]))

PAGE = """({ points, settings, at, raster }) => {
  const fit = rbfFit(points, settings);
  return { at: at.map(([a, b]) => rbfAt(fit, a, b)), map: Array.from(rbfOnRaster(fit, raster)) };
}"""


@cache
def page(kernel: str, name: str) -> dict[str, Any] | None:
    m = fit_case(kernel, name)
    if len(m.points) > 400:  # the solver of exported pages takes n^3 operations in JavaScript: seconds from here on
        return None
    data = [
        {
            "id": k,
            "name": "",
            "source": s.tolist(),
            "target": t.tolist(),
            "active": True,
            "weight": 1.0,
            "locked": False,
            "radius": None,
        }
        for k, (s, t) in enumerate(zip(m.points.source, m.target, strict=True))
    ]
    found: dict[str, Any] = run_script(
        ("maths/rbf.ts",),
        PAGE,
        {
            "points": data,
            "settings": m.settings,
            "at": m.target.tolist(),
            "raster": {"shape": [m.size, m.size], "spacing": [1, 1], "origin": [0, 0]},
        },
    )
    return found


def values_on_page(m: Made, what: str) -> np.ndarray:
    found = page(m.settings["kernel"], next(name for name in SETS if fit_case(m.settings["kernel"], name) is m))
    if found is None:
        return m.fit(m.target)
    if what == "at":
        return np.array(found["at"])
    return m.picked(np.moveaxis(np.reshape(found["map"], (m.size, m.size, 2)), -1, 0))


LATTICE, NODES = SHARES["lattice"], SHARES["nodes"]

EVALUATORS = {
    "call": Evaluator(lambda m: m.fit(m.target), ("__call__",)),
    "call with a list": Evaluator(lambda m: m.fit(m.target.tolist()), ("__call__",)),
    "call with JAX": Evaluator(lambda m: m.fit(jax.numpy.asarray(m.target)), ("__call__",)),
    "displacement": Evaluator(lambda m: m.fit.displacement(m.target), ("displacement",)),
    "jit": Evaluator(lambda m: jax.jit(m.fit)(single(m)), ("jax_displacement",)),
    "vmap": Evaluator(lambda m: jax.jit(jax.vmap(m.fit))(single(m)[:50]), ("jax_displacement",)),
    "seen": Evaluator(lambda m: m.fit.displacement_and_opacity(m.target)[0], ("displacement_and_opacity",)),
    "on a raster": Evaluator(lambda m: m.picked(m.fit.sample_on_raster(m.raster)), ("sample_on_raster",), LATTICE),
    "on lines": Evaluator(lambda m: m.picked(m.fit.lattice_values(*lines(m), 1.0)), ("lattice_values",), LATTICE),
    "seen on lines": Evaluator(
        lambda m: m.picked(m.fit.lattice_values_and_opacity(*lines(m), 1.0)[0]),
        ("lattice_values_and_opacity",),
        LATTICE,
    ),
    "on the device": Evaluator(values_on_device, ("evaluate_on_device",), LATTICE),
    "one after the other": Evaluator(one_after_the_other, ("radial_sum", "type_within"), LATTICE),
    "extrusion": Evaluator(lambda m: m.field(m.space)[:, :2], ("__call__",)),
    "extrusion in jit": Evaluator(lambda m: jax.jit(m.field)(m.space.astype(np.float32))[:, :2], ("__call__",)),
    "composition": Evaluator(lambda m: compose(m.field, SHIFT)(m.space - [1, 0, 0])[:, :2] - [1, 0], ("__call__",)),
    "composition in jit": Evaluator(
        lambda m: jax.jit(compose(m.field, SHIFT))((m.space - [1, 0, 0]).astype(np.float32))[:, :2] - np.array([1, 0]),
        ("__call__",),
    ),
    "on a grid": Evaluator(
        lambda m: m.picked(np.moveaxis(m.field.sample_on_grid(m.volume.grid)[0], -1, 0)),
        ("sample_on_grid", "components_on_grid"),
        LATTICE,
    ),
    "document": Evaluator(lambda m: from_json(to_json(m.deformation)).field(m.volume.grid)(m.space)[:, :2], ()),
    "transform file": Evaluator(lambda m: values_in_file(m, ".nrrd"), (), LATTICE),
    "transform file in 64 bits": Evaluator(lambda m: values_in_file(m, ".h5"), (), LATTICE),
    "warp": Evaluator(lambda m: warped(m, m.deformation), (), LATTICE),
    "warp of a composition": Evaluator(lambda m: warped(m, compose(m.field, SHIFT), 1), (), NODES),
    "page": Evaluator(lambda m: values_on_page(m, "at"), ()),
    "raster of a page": Evaluator(lambda m: values_on_page(m, "map"), (), LATTICE),
}

# Public callables of maps that give no displacements of given places: derivatives have a separate test below.
OTHERS = {
    "prescribed_displacements",
    "kernel",
    "jacobian",
    "lattice_jacobians",
    "opacity",
    "bound",
    "float32_error",
    "float32_slope_error",
    "derivative_type",
    "folds_between_points",
    "weights_at",
    "slopes_at",
    "zeta",
    "lines",
    "axis_of",
    "found",
    "steep_places",
    "target_places",
    "folds_at",
    "rescaled",
}


def test_every_method_of_a_map_is_in_the_table() -> None:
    kinds = (AbstractField, RBFInterpolant, LocalFits, ForwardFit, Extrusion, Staged, TipBlend)
    public = {
        name for kind in kinds for name in dir(kind) if not name.startswith("_") and callable(getattr(kind, name))
    }
    covered = {name for evaluator in EVALUATORS.values() for name in evaluator.methods}
    assert public - covered - OTHERS == set()


def promised(m: Made, share: float) -> float:
    """The bound, written out once more; float32 resolves 2^-24 of a displacement and of the places it leads to."""
    largest, extent = (float(np.linalg.norm(a, axis=1).max()) for a in (m.wanted, m.target - m.target.mean(axis=0)))
    return EXACT * largest + EXACT_PLACE * extent + share * (1.0 if share == NODES else min(1.0, largest))


@pytest.mark.parametrize("evaluator", EVALUATORS)
@pytest.mark.parametrize("kernel", sorted(BUILT_IN))
@pytest.mark.parametrize("name", SETS)
def test_points_are_met_by_every_evaluator(name: str, kernel: str, evaluator: str) -> None:
    m, way = fit_case(kernel, name), EVALUATORS[evaluator]
    got = np.asarray(way.at_targets(m), dtype=float)
    miss = np.abs(got - m.wanted[: len(got)]).max()
    more = m.fit.bound() - promised(m, 0.0)  # which a note states
    assert more < 1e-12 or any("misses its targets by up to" in note for note in m.fit.notes)
    assert more < 1e-3 * np.abs(m.wanted).max()
    storage = 0.0 if way.share == 0 and "jit" not in evaluator and evaluator != "vmap" else 2.0**-23 * m.size
    assert miss <= promised(m, way.share) + max(more, 0.0) + storage


@pytest.mark.parametrize("kernel", sorted(BUILT_IN))
def test_arrays_stay_numpy_and_what_jax_follows_stays_jax(kernel: str) -> None:
    fit = fit_case(kernel, "few").fit
    for x in (np.zeros((3, 2)), np.zeros((3, 2), np.float32), np.zeros((3, 2), int), [[0, 0]], jax.numpy.zeros(2)):
        got = fit(x)
        assert isinstance(got, np.ndarray)
        assert got.dtype == np.float64
        assert got.shape == np.shape(x)
    kinds: list[Any] = []
    single, half = np.zeros((3, 2), np.float32), np.zeros((3, 2), np.float16)
    for given in (single, half):
        got = jax.jit(lambda x: kinds.append(fit(x)) or fit(x))(given)
        assert got.dtype == given.dtype
    assert all(isinstance(kind, jax.core.Tracer) for kind in kinds)
    assert not jax.config.jax_enable_x64  # type: ignore[attr-defined]


# ---- away from the points, and derivatives ---------------------------------------------------------------------------


@pytest.mark.parametrize("kernel", sorted(BUILT_IN))
def test_between_points_too_it_is_the_system_in_fifty_digits(kernel: str) -> None:
    m = fit_case(kernel, "few")
    at = (m.target[:4] + m.target[1:5]) / 2 + [0.5, 0.25]  # halves and quarters are exact in 32 bits
    wanted = oracle.fifty_digits(m.target, m.wanted, kernel, m.settings["support"], m.settings["trend"], at)
    scale = EXACT * np.abs(m.wanted).max()
    for got, allowed in ((m.fit(at), scale), (jax.jit(m.fit)(at.astype(np.float32)), scale + 2.0**-23 * m.size)):
        np.testing.assert_allclose(np.asarray(got, dtype=float), wanted, rtol=0, atol=allowed)


@pytest.mark.sampled(17)
@pytest.mark.parametrize("kernel", sorted(BUILT_IN))
@pytest.mark.parametrize("name", SETS)
def test_derivatives_are_those_of_differences(name: str, kernel: str) -> None:
    """Central differences of D in 64 bits, whose own error is 1e-10 |D| / h plus h^2 of the third derivative."""
    m, h = fit_case(kernel, name), 1e-4
    inner = m.pixels[np.linspace(0, len(m.pixels) - 1, 12).astype(int)] + [1, 2]  # next to the points, where kinks are
    x = inner.astype(float)
    wanted = np.stack([(m.fit(x + h * e) - m.fit(x - h * e)) / (2 * h) for e in np.eye(2)], axis=-1)
    size = 1e-5 * max(1.0, np.abs(wanted).max())
    np.testing.assert_allclose(m.fit.jacobian(x), wanted, rtol=0, atol=size)
    followed = jax.jit(jax.vmap(jax.jacfwd(m.fit)))(x.astype(np.float32))
    np.testing.assert_allclose(np.asarray(followed, dtype=float), wanted, rtol=0, atol=size)
    backward = jax.vmap(jax.jacrev(m.fit))(x[:2].astype(np.float32))
    np.testing.assert_allclose(np.asarray(backward, dtype=float), wanted[:2], rtol=0, atol=size)
    drawn = m.fit.lattice_jacobians(*lines(m))[:, :, inner[:, 1], inner[:, 0]]
    np.testing.assert_allclose(np.moveaxis(drawn, -1, 0), wanted, rtol=1e-6, atol=DERIVATIVE + size)


@pytest.mark.sampled(7)
@pytest.mark.parametrize("kernel", sorted(BUILT_IN))
@pytest.mark.parametrize("name", [name for name in SETS if name != "local"])
def test_the_error_of_32_bits_is_not_above_its_estimate(name: str, kernel: str) -> None:
    m = fit_case(kernel, name)
    if not isinstance(m.fit, RBFInterpolant):
        pytest.skip("the system of all is singular; local fits are evaluated in 64 bits")
    x = m.target[:200] + 0.3
    reach = float(np.linalg.norm((x - m.fit.origin) / m.fit.support, axis=1).max())
    error = np.abs(m.fit.displacement(x, np.float32) - m.fit(x)).max()
    assert error <= m.fit.float32_error(reach)


@pytest.mark.sampled(6)
@pytest.mark.parametrize("way", ["call", "jit", "on a raster", "staged", "landmarks"])
@pytest.mark.parametrize("kernel", sorted(BUILT_IN))
def test_so_are_points_of_other_maps_of_the_same_points(kernel: str, way: str) -> None:
    """Fits forward, stages, and landmarks that are moved: smooth drags, for maps without folds."""
    pixels = 10 + 6 * np.stack(np.meshgrid(np.arange(6), np.arange(6)), axis=-1).reshape(-1, 2)
    target = pixels.astype(float)
    source = target + 0.5 * np.sin(target / 8)[:, ::-1]
    points = ControlPoints.from_arrays(source, target)
    settings = {"kernel": kernel, "support": 20.0, "trend": "quadratic" if KERNELS[kernel].order > 2 else "affine"}
    bound = fit_rbf(points, **settings).bound()
    raster = Raster((60, 60), (1.0, 1.0), (0.0, 0.0))
    if way == "staged":
        got, allowed = fit_points(points, stages=3, **settings)(target), 6 * bound  # of each stage, carried on
    elif way == "landmarks":
        fit = fit_rbf(points, **settings)
        moved, found = dn.warp_points(source, fit)
        assert found.all()
        got, allowed = source - moved, 4 * bound  # det J is above 1/2
    else:
        fit_f, x, y = fit_forward(points, **settings), *pixels.T
        got, allowed = {
            "call": lambda: (fit_f(target), 4 * bound),
            "jit": lambda: (jax.jit(fit_f)(target.astype(np.float32)), 4 * bound + 2.0**-23 * 60),
            "on a raster": lambda: (fit_f.sample_on_raster(raster)[:, y, x].T, LATTICE),
        }[way]()
    np.testing.assert_allclose(np.asarray(got, dtype=float), source - target, rtol=0, atol=allowed)


# ---- every kind of map -----------------------------------------------------------------------------------------------

LINE = Line([(0, 25), (60, 25)])
SLIT = Line([(20, 25), (40, 25)], stops=(True, True))


def steep(dim: int = 2) -> RBFInterpolant:
    """A fit whose coefficients are 10^4 times as large as its displacements: 32 bits leave three digits of it."""
    rng = np.random.default_rng(dim)
    target = rng.uniform(0, 60, (120, dim))
    fit = fit_rbf(ControlPoints.from_arrays(target + rng.normal(0, 1.0, target.shape), target), kernel="cubic")
    assert isinstance(fit, RBFInterpolant)
    assert fit.float32_error() > 0.01
    return fit


def apart() -> ControlPoints:
    return ControlPoints.from_arrays(
        [[10, 10], [30, 12], [50, 10], [10, 40], [30, 38], [50, 40]],
        [[10, 11], [31, 14], [50, 10], [10, 39], [29, 36], [50, 40]],
    )


def samples() -> DisplacementField:
    return DisplacementField(np.random.default_rng(4).normal(0, 1, (7, 7, 2)), Raster((7, 7), (10.0, 10.0), (0.0, 0.0)))


MAPS: dict[str, Callable[[], AbstractField]] = {
    "RBFInterpolant": steep,
    "LocalFits": lambda: fit_locally(
        prepare(fit_case("multiquadric", "few").points, KERNELS["multiquadric"], 10.0, TRENDS["affine"], 0.0),
        KERNELS["multiquadric"],
        0.0,
    ),
    "ForwardFit": lambda: fit_forward(apart(), kernel="thin_plate"),
    "RigidInterpolant": lambda: fit_rigid(apart(), [RigidPart(Polygon([(25, 20), (35, 20), (30, 30)]))]),
    "Staged": lambda: Staged((steep(), steep())),
    "TipBlend": lambda: FitSettings().fit(apart(), cuts=(SLIT,), softness=1.0).fields[0],  # type: ignore[attr-defined]
    "Decoupled": lambda: FitSettings().fit(apart(), cuts=(LINE,), softness=1.0),
    "Extrusion": lambda: Extrusion(Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), (0.0, 60.0), (steep(),), *modulate("1 - z")),
    "Composed": lambda: compose(steep(), Affine(np.eye(2), np.array([1.0, 0.5]))),
    "Blended": lambda: blend(steep(), steep()),
    "Affine": lambda: Affine(np.array([[1.1, 0.2], [0.0, 0.9]]), np.array([1.0, 0.5])),
    "Identity": lambda: Identity(2),
    "DisplacementField": samples,
    "BSplineField": lambda: BSplineField(
        np.random.default_rng(4).normal(0, 1, (9, 9, 2)), (-10.0, -10.0), ((10.0, 0.0), (0.0, 10.0))
    ),
    "Rescaled": lambda: Rescaled(steep(), 1000.0, "\u00b5m"),
    "_Magnified": lambda: magnify_field(samples(), 3.0),
}


def kinds_of(kind: type[AbstractField]) -> set[str]:
    is_final = kind.__module__.startswith("deformnb.") and not isabstract(kind)
    own = {kind.__name__} if is_final else set()
    return own.union(*map(kinds_of, kind.__subclasses__()))


def test_every_kind_of_map_is_in_the_table() -> None:
    assert kinds_of(AbstractField) == set(MAPS)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("kind", MAPS)
def test_a_map_gives_the_same_place_by_every_door(kind: str) -> None:
    field = MAPS[kind]()
    assert type(field).__name__ == kind
    x = np.random.default_rng(5).integers(4, 56, (20, field.dim)).astype(float)  # exact in 32 bits
    wanted = field.displacement(x)
    for given in (x, x.tolist(), x.astype(int), x.astype(np.float32), jax.numpy.asarray(x, np.float32)):
        got = field(given)
        assert isinstance(got, np.ndarray)
        assert got.dtype == np.float64
        np.testing.assert_array_equal(got, wanted)
    single = x.astype(np.float32)
    for got in (jax.jit(field)(single), jax.jit(jax.vmap(field))(single)):
        assert got.dtype == np.float32
        np.testing.assert_allclose(np.asarray(got, dtype=float), wanted, rtol=1e-6, atol=1e-6)
    slope = jax.jit(jax.vmap(jax.jacfwd(field)))(single + np.float32(0.25))
    np.testing.assert_allclose(np.asarray(slope, dtype=float), field.jacobian(x + 0.25), rtol=1e-5, atol=1e-5)


def test_a_plane_in_space_is_evaluated_as_its_map_is() -> None:
    m = fit_case("thin_plate", "few")
    plane = Plane.from_view(Grid((2, m.size, m.size)), "+z")
    field = Extrusion(plane, (0.0, 1.0), (m.fit,), np.array([0.0, 1.0]), np.ones((1, 2)))
    np.testing.assert_allclose(field(m.space)[:, :2], m.fit(m.target), atol=1e-12)

"""Composition of several deformations, evaluated at all voxels of a block.

``D = D_last(x) + D_before(x + D_last(x)) + ...``: only the last one is evaluated on a lattice, the others at the places
to which the ones after them lead. Where the composition is smooth it is interpolated between nodes
(:mod:`deformnb.warping.node_table`). The voxels that are left beside cuts are evaluated one by one; there the maps over
a picture are kept as tables and read linearly. A table is as fine as it must be for an error below a five-hundredth of
a voxel; where that would take too many nodes, or a place lies beyond the table, the field itself is evaluated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage
from deformnb._jax import compiled, jnp, lax
from deformnb._typing import Progress
from deformnb.rbf.cuts import Decoupled, decide
from deformnb.rbf.extrusion import CURVE_KNOTS, Extrusion
from deformnb.rbf.fields import AbstractField, Identity, links_of, raster_lines
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.rigid import RigidInterpolant
from deformnb.rbf.slits import TipBlend
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid
from deformnb.warping import planning
from deformnb.warping.cut_tiles import look_up
from deformnb.warping.node_table import Displacements, NodeTable, Replacement, seen_at
from deformnb.warping.node_walk import smoothness_of

# Ten times below what linear interpolation between voxels of a noisy scan changes.
_TABLE_ERROR = 2e-3
_MOST_NODES = 3_000_000

# How far beyond the volume's box the tables reach, as a share of it; beyond, the field itself is evaluated.
_MARGIN = 0.1

# Places that are looked up at a time at least.
_LEAST_PLACES = 4096

# Places at which a table is compared with its map.
_TRIALS = 2000

Evaluator = Callable[[NDArray[np.float32], NDArray[np.float64]], tuple[Any, Any]]
"""From places (3, n) relative to an origin, and that origin, to displacements (3, n) and opacity (n)."""


class ComposedEvaluator:
    """The steps of a composition, made ready for one output grid.

    Parameters
    ----------
    field : any field in space; one that is no composition has one step.
    grid : the output's grid.
    """

    def __init__(self, field: AbstractField, grid: Grid) -> None:
        self._field, self._grid = field, grid
        self._links = [link for link in links_of(field) if not isinstance(link, Identity)] or [Identity(3)]
        self.has_cuts = field.has_cuts
        # Without cuts little is left to the exact way, which needs no tables then.
        self._evaluators = [_evaluator(link, grid) if self.has_cuts else partial(seen_at, link)
                            for link in self._links]
        # Fields with cuts are slow on a lattice too; others are exact and fast there.
        start = 0 if self._links[0].has_cuts else 1
        self._first, self._rest = self._links[0] if start else None, self._evaluators[start:]
        is_long = bool(self._rest) or len(field.steps) > 1
        self._is_known = is_long and smoothness_of(field) is not None
        self._nodes: NodeTable | None = None

    @property
    def is_single(self) -> bool:
        """True if there is nothing that a lattice would not do."""
        return not self._rest and not self._is_known

    def prepare(self, progress: Progress | None = None) -> None:
        """Evaluate the nodes between which the composition is interpolated.

        Parameters
        ----------
        progress : called with the finished share.
        """
        if self._is_known:
            self._nodes = NodeTable(self._field, self._grid, progress, self._at_places)

    def block(self, block: tuple[slice, slice]) -> Displacements:
        """Displacements in a block of planes and rows, one of :func:`~deformnb.warping.planning.square_blocks`."""
        found = None if self._nodes is None else self._nodes.block(block)
        return self._at_all(planning.lattice(self._grid, block, 1)) if found is None else found

    def left(self) -> list[Callable[[], Replacement]]:
        """What is to be replaced in the blocks so far, see :meth:`NodeTable.left`."""
        return [] if self._nodes is None else self._nodes.left()

    def _at_places(self, places: NDArray[np.float32], origin: NDArray[np.float64]) -> tuple[Any, Any]:
        d, opacity = np.zeros_like(places), np.ones(places.shape[1], np.float32)
        for evaluate in self._evaluators:
            more, share = evaluate(places + d, origin)
            d, opacity = d + more, opacity * share
        return d, opacity

    def _at_all(self, lattice: Grid) -> Displacements:
        shape, origin = lattice.shape, np.asarray(lattice.origin)
        (nz, ny, nx), m = shape, lattice.matrix
        lines = [m[:, [k]] * np.arange(n) for k, n in ((2, nz), (1, ny), (0, nx))]
        at = lines[0][:, :, None, None] + lines[1][:, None, :, None] + lines[2][:, None, None, :]
        d = np.zeros((3, nz * ny * nx), np.float32)
        if self._first is not None:
            first = _as_parts(planning.seen(self._first, lattice)[0])
            d = np.stack([np.asarray(part) for part in first]).reshape(3, -1)
        places, opacity = at.reshape(3, -1).astype(np.float32), np.ones(d.shape[1], np.float32)
        for evaluate in self._rest:
            more, share = evaluate(places + d, origin)
            d = d + more
            opacity = opacity * share
        shown = opacity.reshape(shape) if self.has_cuts else None
        return Displacements(tuple(part.reshape(shape) for part in d), opacity=shown)


def _as_parts(d: Any) -> list[Any]:
    return list(d) if isinstance(d, tuple) else list(np.moveaxis(np.asarray(d), -1, 0))


def _evaluator(field: AbstractField, grid: Grid) -> Evaluator:
    table = _table(field, grid)
    return partial(seen_at, field) if table is None else table


@dataclass(frozen=True, eq=False)
class _Table:
    """The maps of an extrusion, or of all regions between cuts, as samples on a raster over its plane."""

    field: Extrusion | Decoupled
    extrusion: Extrusion
    raster: Raster
    maps: NDArray[np.float32]  # (R, K, 2, rows, columns)
    distances: NDArray[np.float32]  # (C, rows, columns)
    sides: tuple[tuple[bool, ...], ...]
    rule: str
    softness: float

    def __call__(self, places: NDArray[np.float32], origin: NDArray[np.float64]) -> tuple[Any, Any]:
        extrusion, scale = self.extrusion, (1 / np.asarray(self.raster.spacing)).astype(np.float32)
        shift, (c0, c1) = extrusion.plane.to_plane(origin), extrusion.depth
        start = np.asarray([*(shift[:2] - self.raster.origin), shift[2] - c0], np.float32)
        frame = extrusion.plane.frame.astype(np.float32)
        n = places.shape[1]
        full = max(_LEAST_PLACES, 1 << (n - 1).bit_length())  # the last one repeated: few shapes are compiled
        places = places[:, np.minimum(np.arange(full), n - 1)]
        # Two calls: in one, XLA looks the maps up anew for each of the distances that they lead to, ten times as long.
        at, moves = _moves(places, self.maps, frame, start, scale, np.float32(1 / (c1 - c0) if c1 > c0 else 0.0),
                           _at_equal_steps(extrusion))
        d, opacity = _seen(at, moves, self.distances, frame, scale, np.float32(self.softness), sides=self.sides,
                           rule=self.rule)
        at, d, opacity = np.asarray(at), np.asarray(d), np.asarray(opacity)
        last = np.asarray(self.raster.shape[::-1])[:, None] - 1
        outside = ((at < 0) | (at > last)).any(axis=0)
        if len(self.distances):  # where a displacement leads the distances are looked up too
            led = at + np.asarray(moves) * scale[:, None]
            outside |= ((led < 0) | (led > last)).any(axis=(0, 1))
        beyond = np.flatnonzero(outside)
        if len(beyond):
            d, opacity = d.copy(), opacity.copy()
            d[:, beyond], opacity[beyond] = seen_at(self.field, places[:, beyond], origin)
        return d[:, :n], opacity[:n]


def _at_equal_steps(extrusion: Extrusion) -> NDArray[np.float32]:
    """The weights (K, steps) of its maps from the first slice to the last; one step where they never change."""
    if extrusion.is_replication:
        return np.asarray(extrusion.weights, np.float32)[:, :1]
    z = np.linspace(0.0, 1.0, 4 * (CURVE_KNOTS - 1) + 1)
    return np.stack([np.interp(z, extrusion.knots, w) for w in np.asarray(extrusion.weights)]).astype(np.float32)


@partial(compiled, on_one_thread=True)
def _moves(places: Any, maps: Any, frame: Any, start: Any, scale: Any, depth: Any, weights: Any) -> tuple[Any, Any]:
    """Columns and rows (2, n) of places (3, n) on the raster, and what each region moves there, (R, 2, n)."""
    a, b, c = (frame[k, 0] * places[0] + frame[k, 1] * places[1] + frame[k, 2] * places[2] + start[k] for k in range(3))
    x, y = a * scale[0], b * scale[1]
    share = [w[0] if len(w) == 1 else _along(w, c * depth) for w in weights]
    moves = [[sum(w * look_up(m[n], x, y) for w, m in zip(share, regional, strict=True)) for n in range(2)]
             for regional in maps]
    return jnp.stack([x, y]), jnp.stack([jnp.stack(pair) for pair in moves])


@partial(compiled, on_one_thread=True, static_argnames=("sides", "rule"))
def _seen(at: Any, moves: Any, distances: Any, frame: Any, scale: Any, softness: Any, *, sides: Any,
          rule: str) -> tuple[Any, Any]:
    """Displacements x, y, z (3, n) and opacity (n)."""
    if distances.shape[0] == 0:
        u, v, opacity = moves[0, 0], moves[0, 1], jnp.ones_like(at[0])
    else:
        here = [look_up(t, at[0], at[1]) for t in distances]
        there = [[look_up(t, at[0] + u * scale[0], at[1] + v * scale[1]) for t in distances] for u, v in moves]
        here, there = lax.optimization_barrier((here, there))
        choice, opacity = decide(here, there, sides, rule, softness, jnp)
        u = v = jnp.zeros_like(at[0])
        for r, (mu, mv) in enumerate(moves):
            u, v = jnp.where(choice == r, mu, u), jnp.where(choice == r, mv, v)
    return jnp.stack([frame[0, k] * u + frame[1, k] * v for k in range(3)]), opacity


def _along(weights: Any, z: Any) -> Any:
    at = jnp.clip(z, 0.0, 1.0) * (len(weights) - 1)
    low = jnp.minimum(at.astype(jnp.int32), len(weights) - 2)
    t = at - low
    return (1 - t) * weights[low] + t * weights[low + 1]


def _table(field: AbstractField, grid: Grid) -> _Table | None:
    """The table of a field, or None where it has none that is good enough."""
    cut = field if isinstance(field, Decoupled) else None
    fields = cut.fields if cut is not None else (field,)
    first = fields[0] if fields else None
    if not isinstance(first, Extrusion) or not all(_alike(f, first) for f in fields):
        return None
    at = first.plane.to_plane(grid.corners())[:, :2]
    size = np.ptp(at, axis=0)
    low, high = at.min(axis=0) - _MARGIN * size.max(), at.max(axis=0) + _MARGIN * size.max()
    along = np.abs(first.plane.frame[:2] @ np.asarray(grid.direction)) ** 2  # [u v, axis x y z], rows add up to 1
    pixel = along @ np.asarray(grid.spacing)
    allowed, step = _TABLE_ERROR * float(pixel.min()), pixel.copy()
    for _ in range(4):
        counts = np.ceil((high - low) / step).astype(int) + 1
        if counts.prod() * len(fields) * len(first.maps) > _MOST_NODES:
            return None
        (columns, rows), (du, dv), (a, b) = counts.tolist(), step.tolist(), low.tolist()
        raster = Raster((rows, columns), (du, dv), (a, b))
        maps = np.stack([[m.on_raster(raster) for m in f.maps] for f in fields])  # type: ignore[attr-defined]
        error = _error(fields, maps, raster)
        if error <= allowed:
            break
        step *= max(0.3, 0.9 * float(np.sqrt(allowed / error)))
    else:
        return None
    regions = cut.regions if cut is not None else ()
    lines = raster_lines(raster)
    nodes = np.moveaxis(lines[0][:, :, None] + lines[1][:, None, :], 0, -1)
    distances = np.zeros((len(regions), *raster.shape), np.float32)
    for k, region in enumerate(regions):
        distances[k] = region.signed_distance(nodes)
    return _Table(field, first, raster, maps, distances, cut.sides if cut else ((),), cut.rule if cut else "",  # type: ignore[arg-type]
                  cut.softness if cut else 1.0)


def _alike(field: AbstractField, first: Extrusion) -> bool:
    """Check whether a field is extruded as the first one is, so that one look-up of the weights does for all."""
    return (isinstance(field, Extrusion) and field.plane == first.plane and field.depth == first.depth
            and np.array_equal(field.knots, first.knots) and np.array_equal(field.weights, first.weights))


def _error(fields: Any, maps: NDArray[np.float32], raster: Raster) -> float:
    """The largest difference between maps and their tables at many places."""
    worst = 0.0
    for field, regional in zip(fields, maps, strict=True):
        for m, table in zip(field.maps, regional, strict=True):
            index = _trials(m, raster)
            at = np.asarray(raster.origin) + index[:, ::-1] * np.asarray(raster.spacing)
            read = [ndimage.map_coordinates(part, index.T, order=1) for part in table]
            worst = max(worst, float(np.abs(m.displacement(at).T - read).max()))
    return worst


def _trials(field: AbstractField, raster: Raster) -> NDArray[np.float64]:
    """Rows and columns (n, 2): the middle of cells, where the error is largest, all over the raster, and places around
    every control point, for a narrow bump hides between the others.
    """
    rng = np.random.default_rng(0)
    last = np.asarray(raster.shape) - 1.0
    everywhere: NDArray[np.float64] = rng.integers(0, last.astype(int), (_TRIALS, 2)).astype(np.float64) + 0.5
    if isinstance(field, TipBlend):
        return np.concatenate([_trials(fit, raster) for fit in field.fits])
    fit = field.base if isinstance(field, RigidInterpolant) else field
    if not isinstance(fit, RBFInterpolant) or not int(fit.count):
        return everywhere
    centers = np.repeat(np.asarray(fit.centers)[: int(fit.count)], 8, axis=0)
    near = np.asarray(fit.origin) + float(fit.support) * (centers + rng.uniform(-0.6, 0.6, centers.shape))
    index = ((near - raster.origin) / np.asarray(raster.spacing))[:, ::-1]
    return np.concatenate([everywhere, index[((index >= 0) & (index <= last)).all(axis=1)]])

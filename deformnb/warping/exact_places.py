"""Displacements of a field in space at listed places, in the precision that the size of a voxel requires.

A composition is evaluated link by link, each at the places to which the one after it leads. On a GPU extrusions, fits,
stages and cuts are evaluated on a lattice by a function that is compiled for their kind and not for each number of
places, points or edges.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb import devices
from deformnb._jax import as_numpy, float64, jax, jit, jnp, lax, pytree
from deformnb._typing import Floats
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Decoupled, SideChoice
from deformnb.rbf.evaluation import RadialSum, check_parts, outer_sum, stack_sums
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField, Identity, grid_lines
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.slits import TipBlend, blend_displacements
from deformnb.rbf.stages import Staged
from deformnb.volume.volume import Grid
from deformnb.warping.node_walk import FitSums, rotate
from deformnb.warping.planning import NOT_FINITE

Components = Sequence[Any]


@pytree(data_fields=[])
@dataclass(frozen=True, eq=False)
class _Still:
    """No displacement."""

    def __call__(self, x: Components) -> list[Any]:
        return [jnp.zeros_like(part) for part in x]


@pytree(data_fields=["sums"])
@dataclass(frozen=True, eq=False)
class _Stages:
    """Stacked sums, each evaluated where the one before leads."""

    sums: RadialSum

    def __call__(self, x: Components) -> list[Any]:
        def move(places: list[Any], each: RadialSum) -> tuple[list[Any], None]:
            return [p + d for p, d in zip(places, each(places), strict=True)], None

        ends, _ = lax.scan(move, list(x), self.sums)
        return [end - start for end, start in zip(ends, x, strict=True)]


@pytree(data_fields=["fits", "lines"])
@dataclass(frozen=True, eq=False)
class _Tips:
    """:class:`~deformnb.rbf.slits.TipBlend` of sums."""

    fits: tuple[Any, ...]
    lines: tuple[Any, ...]

    def __call__(self, x: Components) -> list[Any]:
        moves = [jnp.stack(fit(x)) for fit in self.fits]
        source = jnp.moveaxis(jnp.stack(x) + moves[0], 0, -1)
        return list(blend_displacements(moves, [line.opening(source, jnp) for line in self.lines]))


@pytree(data_fields=["maps", "frame", "origin", "depth", "knots", "weights"])
@dataclass(frozen=True, eq=False)
class _Extruded:
    """:class:`~deformnb.rbf.extrusion.Extrusion` of maps.

    Parameters
    ----------
    depth : where zeta is 0, and by how much it rises. knots : None if they are at equal steps from 0 to 1.
    """

    maps: tuple[Any, ...]
    frame: Any
    origin: Any
    depth: Any
    knots: Any
    weights: Any

    def __call__(self, x: Components) -> list[Any]:
        away = [part - o for part, o in zip(x, self.origin, strict=True)]
        a, b, c = (sum(f * part for f, part in zip(row, away, strict=True)) for row in self.frame)
        z = jnp.clip((c - self.depth[0]) * self.depth[1], 0.0, 1.0)
        u = v = jnp.zeros_like(a)
        for m, w in zip(self.maps, self.weights, strict=True):
            share = (
                w[0]
                if len(w) == 1
                else _interpolate_steps(w, z)
                if self.knots is None
                else jnp.interp(z, self.knots, w)
            )
            du, dv = m([a, b])
            u, v = u + share * du, v + share * dv
        return [p * u + q * v for p, q in zip(self.frame[0], self.frame[1], strict=True)]


def _interpolate_steps(values: Any, z: Any) -> Any:
    """Values at equal steps from 0 to 1, linear in between."""
    at = z * (len(values) - 1)
    low = jnp.minimum(at.astype(jnp.int32), len(values) - 2)
    return values[low] + (at - low) * (values[low + 1] - values[low])


@pytree(data_fields=["fields", "choice"])
@dataclass(frozen=True, eq=False)
class _Cut:
    """:class:`~deformnb.rbf.cuts.Decoupled`: displacements and opacity."""

    fields: tuple[Any, ...]
    choice: SideChoice

    def displacement_and_opacity(self, x: Components) -> tuple[list[Any], Any]:
        """Components of the displacements, and the opacity."""
        moves = lax.optimization_barrier([field(x) for field in self.fields])
        here, there = self.choice.distances([x, *([p + d for p, d in zip(x, move, strict=True)] for move in moves)])
        chosen, opacity = self.choice.decide(here, there)
        total = [jnp.zeros_like(part) for part in x]
        for k, move in enumerate(moves):
            total = [jnp.where(chosen == k, d, t) for d, t in zip(move, total, strict=True)]
        return total, opacity


def _displacement_and_opacity(form: Any, x: Components) -> tuple[list[Any], Any]:
    """Components of the displacements, and the opacity with cuts."""
    return form.displacement_and_opacity(x) if isinstance(form, _Cut) else (form(x), None)


def _lattice_displacements(
    forms: Sequence[Any], rows: Any, columns: Any, *, shape: tuple[int, ...]
) -> tuple[Any, Any, Any]:
    start = [place.reshape(shape) for place in outer_sum(rows, columns)]
    ends, shown = start, None
    for form in forms:
        d, opacity = _displacement_and_opacity(form, ends)
        ends = [x + along for x, along in zip(ends, d, strict=True)]
        shown = opacity if shown is None else shown if opacity is None else shown * opacity
    moved, is_finite = check_parts(x - x0 for x, x0 in zip(ends, start, strict=True))
    return moved, None if shown is None else shown.astype(jnp.float32), is_finite


_evaluate_on_lattice = jit(_lattice_displacements, static_argnames="shape")


class ExactPlaces:
    """Deformations in space, one after the other, at listed places.

    Parameters
    ----------
    links : from the one done last to the one done first, as :func:`~deformnb.rbf.fields.links_of` lists them.
    grid : the voxels that are shown; an error far below their size is negligible.
    """

    def __init__(self, links: Sequence[AbstractField], grid: Grid) -> None:
        self._moving, self._grid = [link for link in links if not link.is_identity], grid
        self._sums = FitSums(min(grid.spacing))

    @cached_property
    def _forms(self) -> list[Any]:
        forms = [_form(link, self._grid.corners(), min(self._grid.spacing)) for link in self._moving]
        with float64():  # on JAX's side once, and not again at every call
            return list(jax.device_put(forms))

    @property
    def is_on_gpu(self) -> bool:
        """Check for a GPU that evaluates all of the deformations."""
        return not devices.is_host() and all(form is not None for form in self._forms)

    def evaluate_on_gpu(self, lattice: Grid) -> tuple[tuple[Any, ...], NDArray[np.float32] | None]:
        """Displacements (nz, ny, nx) along x, y, z on a lattice, in the memory of the GPU, and the opacity with cuts.

        Raises
        ------
        DeformError
            If they are not finite.
        """
        with float64():
            d, opacity, is_finite = _evaluate_on_lattice(self._forms, *grid_lines(lattice), shape=lattice.shape)
            if not is_finite:
                raise DeformError(NOT_FINITE)
            return d, None if opacity is None else as_numpy(opacity)

    def __call__(self, places: Floats) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Displacements (3, n) and opacity (n) at places (3, n)."""
        ends, shown = places, np.ones(places.shape[1], np.float32)
        for link in self._moving:
            d, opacity = self._evaluate(link, ends)
            ends = ends + d
            shown = shown if opacity is None else (shown * opacity).astype(np.float32)
        return (ends - places).astype(np.float32), shown

    def _evaluate(self, field: AbstractField, x: Floats) -> tuple[Floats, Floats | None]:
        """Displacements (dim, n) of a field at places (dim, n), and the opacity (n) with cuts."""
        match field:
            case RBFInterpolant():
                return self._sums(field, x), None
            case Staged():
                ends = x
                for fit in field.fits[::-1]:
                    ends = ends + self._evaluate(fit, ends)[0]
                return ends - x, None
            case TipBlend():
                moves = [self._evaluate(fit, x)[0] for fit in field.fits]
                source = (x + moves[0]).T
                return np.asarray(blend_displacements(moves, [line.opening(source) for line in field.lines])), None
            case Extrusion() if not any(m.has_cuts for m in field.maps):
                frame = field.plane.frame
                abc = rotate(frame, x - np.reshape(field.plane.origin, (3, 1)))
                weights = field.weights_at(abc[2, :1] if field.is_replication else abc[2])
                total = sum(w * self._evaluate(m, abc[:2])[0] for m, w in zip(field.maps, weights, strict=True))
                return rotate(frame[:2].T, np.asarray(total)), None
            case Decoupled() if not any(part.has_cuts for part in field.fields):
                moves = [self._evaluate(part, x)[0] for part in field.fields]
                choice, opacity = field.choose(x.T, [d.T for d in moves])
                return np.select([choice == k for k in range(len(moves))], moves), opacity
            case _:
                d, opacity = field.displacement_and_opacity(x.T)
                return d.T, opacity if field.has_cuts else None


def _form(field: AbstractField, corners: Floats, resolution: float) -> Any | None:
    """Form of a field that is evaluated between corners (n, dim) in pure JAX; None where there is none."""

    def all_of(fields: Sequence[AbstractField], around: Floats = corners) -> tuple[Any, ...] | None:
        forms = tuple(_form(f, around, resolution) for f in fields)
        return None if None in forms else forms

    match field:
        case Identity():
            return _Still()
        case RBFInterpolant():
            return None if field.is_culled else field.radial_sum(_type_of([field], corners, resolution))
        case Staged() if all(isinstance(fit, RBFInterpolant) and not fit.is_culled for fit in field.fits):
            kind = _type_of(field.fits, corners, resolution)
            sums = [fit.radial_sum(kind) for fit in field.fits[::-1]]
            return _Stages(stack_sums(sums)) if len(set(map(jax.tree.structure, sums))) == 1 else None
        case TipBlend():
            fits = all_of(field.fits)
            return fits and _Tips(fits, field.lines)
        case Extrusion():
            maps = all_of(field.maps, field.plane.to_plane(corners)[:, :2])
            return maps and _extrusion_form(field, maps)
        case Decoupled():
            fields = all_of(field.fields)
            return fields and _Cut(fields, field.choice(field.sides))
        case _:
            return None


def _type_of(fits: Sequence[RBFInterpolant], corners: Floats, resolution: float) -> Any:
    """The type in which all fits are exact enough between the corners."""
    reaches = [float(np.linalg.norm((corners - fit.origin) / fit.support, axis=1).max()) for fit in fits]
    types = [fit.type_within(reach, resolution) for fit, reach in zip(fits, reaches, strict=True)]
    return np.float64 if np.float64 in types else np.float32


def _extrusion_form(field: Extrusion, maps: tuple[Any, ...]) -> _Extruded:
    (c0, c1), weights = field.depth, np.asarray(field.weights, np.float64)
    knots = np.asarray(field.knots, np.float64)
    is_even = np.array_equal(knots, np.linspace(0.0, 1.0, len(knots)))
    return _Extruded(
        maps,
        np.asarray(field.plane.frame),
        np.asarray(field.plane.origin, np.float64),
        np.array([c0, 1 / (c1 - c0) if c1 > c0 else 0.0]),
        None if is_even else knots,
        weights[:, :1] if field.is_replication else weights,
    )

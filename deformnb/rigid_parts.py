r"""Parts that stay rigid while all around them bends: Eq. 6 of the paper, after Little, Hill and Hawkes.

The displacement is ``D(x) = (L(x) - x) + w(x) g(x)``. L is the known backward motion of the parts, the identity where
they are fixed; w vanishes within the parts; g is the plain fit of what the control points ask for beyond L,
``(d_i - (L(x_i) - x_i)) / w(x_i)``. The paper's factor w(x_i) in ``phi_R(x, x_i) = w(x) w(x_i) phi`` only rescales the
coefficients, so this is its Eq. 6. Two things are done otherwise:

- The free polynomial of Eq. 2 would move the parts. Here the trend is weighted by w too.
- The paper's w is the distance itself. It overshoots: with a control point 1/10 of the support away from the part the
  displacement between grows to 3.8 times the drag, and it has a kink on the part's surface. The default is a smooth
  step of the distance that has reached 1 at the nearest control point; ``weight="distance"`` is the paper's.

With several parts, each keeps its own motion and L blends them with weights 1 / distance^2. A part's distance is
measured where it has moved to.

Three things follow that one may not expect. A part that moves takes all along with it where neither a fixed part nor a
control point holds the rest. A control point very near a part makes the weight rise over that short way, and a long
drag folds the map there. Between two parts that turn apart the wedge that opens is filled from both: some matter is
seen twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.control_points import ControlPoints
from deformnb.errors import DeformError
from deformnb.fields import AbstractField
from deformnb.kernels import kernel_named
from deformnb.rbf import RBFInterpolant, choose_support, fit_rbf
from deformnb.regions import AbstractRegion
from deformnb.rigid_motion import RigidMotion
from deformnb.rigid_weights import (
    WEIGHTS,
    blended,
    drift_gradient,
    gradients,
    kept_distances,
    kept_gradients,
    weight_gradient,
    weight_of,
)

# A point that asks, inside a part, for what the part does anyway may miss it by this share of the box of all points.
_SAME_MOTION = 1e-6


@dataclass(frozen=True)
class RigidPart:
    """A region whose matter is not deformed.

    Parameters
    ----------
    region : where the part lies before the deformation; a :class:`~deformnb.regions.Line` has no inside to be a part.
    motion : how it moves; None if it is fixed.
    weight : a name of :data:`WEIGHTS`.
    reach : distance at which the part is no longer felt at the latest; None leaves that to the nearest control point.
    name : shown to people.
    enabled : a part that is switched off stays in the list.
    """

    region: AbstractRegion
    motion: RigidMotion | None = None
    weight: str = "saturated"
    reach: float | None = None
    name: str = ""
    enabled: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.region, AbstractRegion):
            raise DeformError(f"a rigid part needs a region, got {type(self.region).__name__}.")
        if self.region.kind == "line":
            raise DeformError("a line has no inside to stay rigid; use a polygon or a half space.")
        if self.weight not in WEIGHTS:
            raise DeformError(f"unknown weight {self.weight!r} of a rigid part; choose one of {', '.join(WEIGHTS)}.")
        if self.reach is not None and not (np.isfinite(self.reach) and self.reach > 0):
            raise DeformError(f"the reach of a rigid part must be a positive length, got {self.reach}.")
        if self.motion is not None and self.motion.dim != self.region.dim:
            raise DeformError(f"a motion of {self.motion.dim} dimensions does not move a region of {self.region.dim}.")

    @property
    def label(self) -> str:
        """How messages name it."""
        return f'the rigid part "{self.name}"' if self.name else "a rigid part"

    def scaled(self, strength: float) -> RigidPart:
        """The same part moved ``strength`` times as far."""
        return self if self.motion is None or strength == 1 else replace(self, motion=self.motion.power(strength))


@partial(
    jax.tree_util.register_dataclass,
    data_fields=["base", "regions", "matrices", "shifts", "scales"],
    meta_fields=["weights", "notes"],
)
@dataclass(frozen=True, eq=False)
class RigidInterpolant(AbstractField):
    """The solved displacement beside rigid parts: ``D(x) = (L(x) - x) + w(x) g(x)``.

    Parameters
    ----------
    base : g, the fit of what is left to the control points.
    regions : K regions; matrices (K, dim, dim), shifts (K, dim): their backward motions L_k.
    scales : (K,) lengths by which the distances are divided.
    weights : K names of :data:`WEIGHTS`.
    notes : remarks for a status line.
    """

    base: RBFInterpolant
    regions: tuple[AbstractRegion, ...]
    matrices: Any
    shifts: Any
    scales: Any
    weights: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def dim(self) -> int:
        return self.base.dim

    @property
    def ids(self) -> tuple[int, ...]:
        """Ids of the control points behind the fit."""
        return self.base.ids

    @property
    def trend(self) -> str:
        """The trend of what the parts leave free."""
        return self.base.trend

    def __call__(self, points: Any) -> Any:
        x = jnp.asarray(points)
        back = [x @ jnp.asarray(m).T + t for m, t in zip(self.matrices, self.shifts, strict=True)]
        distances = [jnp.maximum(r(y), 0.0) for r, y in zip(self.regions, back, strict=True)]
        moved, weight = blended(x, back, distances, self.scales, self.weights, jnp)
        return moved + weight[..., None] * self.base(x)

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        x = np.asarray(points, dtype=np.float64)
        moved, weight = self.parts_at(x)
        return np.asarray(moved + weight[..., None] * self.base.displacement(x))

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        """The product rule: ``d(L - x) + w J_g + g (dw)^T``.

        The smooth weight has no edge. The paper's distance has one on the part's surface, where the inner side counts.
        """
        x = np.asarray(points, dtype=np.float64)
        places = x.reshape(-1, self.dim)
        parts = list(zip(self.regions, self.matrices, self.shifts, strict=True))
        back = [places @ np.asarray(m).T + t for _, m, t in parts]
        measured = [gradients(r, np.asarray(m), y) for (r, m, _), y in zip(parts, back, strict=True)]
        distances, slopes = [d for d, _ in measured], [g for _, g in measured]
        weight, rate = weight_gradient(distances, slopes, self.scales, self.weights)
        base = self.base.displacement(places)
        out = weight[:, None, None] * self.base.jacobian(places) + base[:, :, None] * rate[:, None, :]
        out += drift_gradient(places, back, distances, slopes, self.matrices)
        return np.asarray(out).reshape(*x.shape, self.dim)

    def jacobian_on_outer_sum(self, rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float32]:
        r, c = np.asarray(rows, dtype=np.float64), np.asarray(columns, dtype=np.float64)
        if not all(map(_is_still, self.matrices, self.shifts)):
            return super().jacobian_on_outer_sum(r, c)
        measured = [kept_gradients(region, r, c) for region in self.regions]  # a drag moves no parts
        shape = (r.shape[1], c.shape[1])
        weight, rate = weight_gradient([m[:, 0] for m in measured], [m[:, 1:] for m in measured], self.scales,
                                       self.weights)
        base = self.base.on_outer_sum(r, c, 1.0)
        rate = np.moveaxis(rate.reshape(*shape, self.dim), -1, 0)
        out = weight.reshape(shape) * self.base.jacobian_on_outer_sum(r, c) + base[:, None] * rate[None]
        return np.asarray(out, dtype=np.float32)

    def parts_at(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """L(x) - x, (..., dim), and w(x), (...), at points."""
        back = [x @ np.asarray(m).T + t for m, t in zip(self.matrices, self.shifts, strict=True)]
        distances = [np.maximum(r.signed_distance(y), 0.0) for r, y in zip(self.regions, back, strict=True)]
        return blended(x, back, distances, self.scales, self.weights, np)

    def on_outer_sum(self, rows: ArrayLike, columns: ArrayLike, resolution: float) -> NDArray[np.float32]:
        r, c = np.asarray(rows, dtype=np.float64), np.asarray(columns, dtype=np.float64)
        base = self.base.on_outer_sum(r, c, resolution)
        places = np.stack([a[:, None] + b[None, :] for a, b in zip(r, c, strict=True)], axis=-1)
        back, distances, all_still = [], [], True
        for region, m, t in zip(self.regions, self.matrices, self.shifts, strict=True):
            still = _is_still(m, t)
            y = places if still else places @ np.asarray(m).T + t
            back.append(y)
            distances.append(kept_distances(region, np.asarray(m), np.asarray(t), r, c, y))
            all_still &= still
        if all_still:  # the common case, without the drift that is zero everywhere
            return np.asarray(weight_of(distances, self.scales, self.weights, np), dtype=np.float32) * base
        moved, weight = blended(places, back, distances, self.scales, self.weights, np)
        return np.asarray(np.moveaxis(moved, -1, 0) + weight * base, dtype=np.float32)


def _is_still(matrix: Any, shift: Any) -> bool:
    return bool((np.asarray(matrix) == np.eye(len(shift))).all() and not np.asarray(shift).any())


def fit_rigid(points: ControlPoints, parts: Sequence[RigidPart], *, kernel: str = "wendland_c2",
              support: float | None = None, trend: str = "affine",
              smoothing: float = 0.0) -> RBFInterpolant | RigidInterpolant:
    """Fit control points beside rigid parts (Eq. 6).

    Parameters
    ----------
    points : as for :func:`~deformnb.rbf.fit_rbf`. A point within a part that asks for what the part does anyway is left
        out.
    parts : those that are switched on count; without any this is :func:`~deformnb.rbf.fit_rbf`.
    kernel, support, trend, smoothing : of the fit. The trend is weighted like the rest and moves no part; beside the
        weight "distance", which has no end, there is none.

    Returns
    -------
    RigidInterpolant.

    Raises
    ------
    DeformError
        If a point within a part asks for something else than the part does; names both.

    Examples
    --------
    >>> from deformnb.regions import HalfSpace
    >>> ground = RigidPart(HalfSpace((0, 0), (0, -1)), name="ground")  # all below b = 0, with b upwards
    >>> points = ControlPoints.from_arrays([[0, -8]], [[3, -8]])
    >>> fit = fit_rigid(points, [ground], trend="none", support=10.0)
    >>> fit.displacement([[3.0, -8.0], [3.0, 1.0]]).round(9).tolist()
    [[-3.0, 0.0], [0.0, 0.0]]
    """
    chosen = [part for part in parts if part.enabled]
    if not chosen:
        return fit_rbf(points, kernel=kernel, support=support, trend=trend, smoothing=smoothing)
    raw = _checked_weights(chosen, points.dim, kernel)
    back = [np.eye(points.dim) if p.motion is None else np.asarray(p.motion.inverse.matrix) for p in chosen]
    shifts = [np.zeros(points.dim) if p.motion is None else np.asarray(p.motion.inverse.shift) for p in chosen]
    x = points.target
    moved = [x @ m.T + t for m, t in zip(back, shifts, strict=True)]
    distances = np.stack([p.region.signed_distance(y) for p, y in zip(chosen, moved, strict=True)])
    free, notes = _free_points(points, chosen, moved, distances)
    if support is None:
        support = choose_support([points], kernel=kernel, trend=trend, smoothing=smoothing)
    scales = np.array([_scale(p, d[free]) for p, d in zip(chosen, distances, strict=True)])
    weights = tuple(p.weight for p in chosen)
    drift, weight = blended(x[free], [y[free] for y in moved], [d[free] for d in distances], scales, weights, np)
    rest = points.take(np.flatnonzero(free))
    asked = (rest.displacement - drift) / weight[:, None]
    base = fit_rbf(replace(rest, source=rest.target + asked, weight=rest.weight * weight**2), kernel=kernel,
                   support=support, trend="none" if raw else trend, smoothing=smoothing)
    return RigidInterpolant(base, tuple(p.region for p in chosen), np.stack(back), np.stack(shifts), scales, weights,
                            (*notes, *base.remarks))


HELD = ("refuse", "carry", "switch off")
"""What becomes of control points within a rigid part that ask for something else than the part does."""


def without_conflicts(points: ControlPoints, parts: Sequence[RigidPart], held: str = "carry") -> ControlPoints:
    """The control points beside rigid parts, without any that asks for something else than the part it lies in.

    Parameters
    ----------
    held : "carry" lets such points go where their part takes them, which is back to their sources in a fixed part;
        "switch off" keeps their places and switches them off; "refuse" leaves them for :func:`fit_rigid` to refuse.

    Raises
    ------
    DeformError
        If ``held`` is none of :data:`HELD`.

    Examples
    --------
    >>> from deformnb.regions import Polygon
    >>> bone = RigidPart(Polygon([(0, 0), (9, 0), (9, 9), (0, 9)]))
    >>> points = ControlPoints.from_arrays([[2, 2], [20, 2]], [[5, 5], [22, 2]])
    >>> without_conflicts(points, [bone]).target.tolist()
    [[2.0, 2.0], [22.0, 2.0]]
    >>> without_conflicts(points, [bone], "switch off").active.tolist()
    [False, True]
    """
    if held not in HELD:
        raise DeformError(f"there is no way {held!r} for points within a rigid part; choose one of {', '.join(HELD)}.")
    for part in parts if held != "refuse" else ():
        if not part.enabled:
            continue
        back = points.target if part.motion is None else part.motion.inverse(points.target)
        size = _size_of(points)
        asks = points.active & (part.region.signed_distance(back) <= 0)
        asks &= np.linalg.norm(points.source - back, axis=1) > _SAME_MOTION * size
        carried = points.source if part.motion is None else part.motion(points.source)
        for k in np.flatnonzero(asks).tolist():
            points = points.edit(points.ids[k], **({"target": carried[k]} if held == "carry" else {"active": False}))
    return points


def _checked_weights(parts: Sequence[RigidPart], dim: int, kernel: str) -> bool:
    """Whether one of the weights is the distance itself, beside which there is no trend."""
    for part in parts:
        if part.region.dim != dim:
            raise DeformError(f"{part.label} lies in {part.region.dim} dimensions, the control points in {dim}.")
    raw = any(part.weight == "distance" for part in parts)
    if raw and kernel_named(kernel).order > 0:
        raise DeformError(f"beside a rigid part with the weight 'distance' there is no trend, and the {kernel} kernel "
                          "needs one; take the weight 'saturated' or a Wendland kernel.")
    return raw


def _size_of(points: ControlPoints) -> float:
    """The diagonal of the box of all sources and targets; 0 without points."""
    places = np.concatenate([points.source, points.target])
    return float(np.linalg.norm(np.ptp(places, axis=0))) if len(points) else 0.0


def _free_points(points: ControlPoints, parts: Sequence[RigidPart], moved: Sequence[NDArray[np.float64]],
                 distances: NDArray[np.float64]) -> tuple[NDArray[np.bool_], list[str]]:
    """Which active points lie beside all parts; refuses one that a part holds and that asks for something else."""
    free, notes = points.active.copy(), []
    size = _size_of(points)
    within = [part.region.signed_distance(points.source) < 0 for part in parts]  # of all points at once: a drag waits
    for k in np.flatnonzero(points.active).tolist():
        holders = np.flatnonzero(distances[:, k] <= 0).tolist()
        for h in holders:
            asked, done = points.source[k], moved[h][k]
            if np.linalg.norm(asked - done) > _SAME_MOTION * size:
                held = "is fixed" if parts[h].motion is None else "has a motion of its own"
                raise DeformError(f"{points.label(k)} lies in {parts[h].label}, which {held}; move or remove the "
                                  "point, or change the part.")
        if len(holders):
            free[k] = False
            if points.displacement[k].any():
                notes.append(f"{points.label(k)} lies in {parts[holders[0]].label}, which holds it already")
            continue
        torn = next((p for p, is_within in zip(parts, within, strict=True) if is_within[k]), None)
        if torn is not None:
            notes.append(f"{points.label(k)} takes hold of {torn.label}, which does not follow: its matter is seen "
                         "twice")
    return free, notes


def _scale(part: RigidPart, distances: NDArray[np.float64]) -> float:
    """The distance at which a part's weight is 1: at the nearest control point at the latest.

    The paper's distance has no such place: it is only brought to the size of 1, which changes nothing (w -> c w).
    """
    nearest = float(distances.min(initial=np.inf))
    if part.weight == "distance":
        return float(distances.max(initial=0.0)) or 1.0
    return min(part.reach or np.inf, nearest) if np.isfinite(nearest) or part.reach else 1.0

"""Rigid parts in a deformation that bends around them: Eq. 6 of the paper, after Little, Hill and Hawkes.

The known motions of the parts are rotations and translations. The displacement is ``D(x) = (L(x) - x) + w(x) g(x)``.
L is the known backward motion of the parts, the identity where they are fixed; w vanishes within the parts; g is the
plain fit of the displacements that the control points require beyond L, ``(d_i - (L(x_i) - x_i)) / w(x_i)``. The
paper's factor w(x_i) in ``phi_R(x, x_i) = w(x) w(x_i) phi`` only rescales the coefficients, so this is its Eq. 6. Two
things are done otherwise:

- The free polynomial of Eq. 2 would move the parts. Here the trend is weighted by w too.
- The paper's w is the distance itself. It overshoots: with a control point 1/10 of the support away from the part the
  displacement between grows to 3.8 times the drag, and it has a kink on the part's surface. The default is a smooth
  step of the distance that has reached 1 at the nearest control point; ``weight="distance"`` is the paper's.

With several parts, each has its own motion and L blends them with weights 1 / distance^2. A part's distance ``d_k``
is measured where it has moved to; its weight is ``W(d_k / s_k)`` and its share of the motion
``d_k^-2 / sum_j d_j^-2``. Weights and shares come with their derivatives.

Three consequences may be unexpected. A part that moves takes all along with it where neither a fixed part nor a
control point holds the rest. A control point very near a part makes the weight rise over that short way, and a long
drag folds the map there. Between two parts that turn apart the wedge that opens is filled from both: some tissue is
seen twice.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import scipy
from deformnb._jax import blockwise, full_precision, jnp, pytree, value_and_slopes
from deformnb.checks import check_fields, real_array
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractFit, AbstractInterpolant
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion

# Directions and lengths that differ by less are rounding of numbers written to a file with seven digits.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class RigidMotion:
    """A turn and a shift of tissue, forward: ``x -> matrix @ x + shift``.

    Parameters
    ----------
    matrix : rows of a rotation, 2 x 2 or 3 x 3.
    shift : as many numbers, physical.

    Raises
    ------
    DeformError
        If the matrix does not turn only: it may not stretch, shear or mirror.

    Examples
    --------
    >>> quarter = RigidMotion.turn(90, about=(1, 0))
    >>> quarter([[3, 0]]).round(12).tolist()
    [[1.0, 2.0]]
    >>> half = quarter.power(0.5)
    >>> bool(abs(half(half([[3, 0]])) - quarter([[3, 0]])).max() < 1e-12)
    True
    """

    matrix: tuple[tuple[float, ...], ...]
    shift: tuple[float, ...]

    def __post_init__(self) -> None:
        m, t = _numbers(self.matrix), _numbers(self.shift)
        dim = t.size
        if t.shape not in ((2,), (3,)) or m.shape != (dim, dim) or not (np.isfinite(m).all() and np.isfinite(t).all()):
            raise DeformError("a rigid motion needs a matrix of 2 x 2 or 3 x 3 finite numbers and a shift of as many.")
        if np.abs(m @ m.T - np.eye(dim)).max() > _ROUNDING or np.linalg.det(m) < 0:
            raise DeformError("the matrix of a rigid motion must turn only: not stretch, shear or mirror.")
        if np.abs(m @ m.T - np.eye(dim)).max() > 1e-12:  # the nearest rotation, so that the inverse is exact
            u, _, v = np.linalg.svd(m)
            m = u @ v
        object.__setattr__(self, "matrix", tuple(map(tuple, m.tolist())))
        object.__setattr__(self, "shift", tuple(t.tolist()))

    @classmethod
    def turn(
        cls, degrees: float, about: ArrayLike, shift: ArrayLike | None = None, axis: ArrayLike | None = None
    ) -> RigidMotion:
        """A turn about a place, then a shift.

        Parameters
        ----------
        degrees : on a picture from its a axis to its b axis, so clockwise to the eye; in space by the right hand.
        about : the place that would stay, (a, b) or (x, y, z).
        axis : direction of the axis of the turn; needed in space only.
        """
        centre, shift, axis = (_numbers(value) for value in (about, shift, axis))
        if centre.shape == (2,):
            angle = np.deg2rad(degrees)
            m = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        elif centre.shape == (3,) == axis.shape and 0 < np.linalg.norm(axis) < np.inf:
            turn = np.deg2rad(degrees) * axis / np.linalg.norm(axis)
            m = scipy.spatial.transform.Rotation.from_rotvec(turn).as_matrix()
        else:
            raise DeformError("a turn is about a place of 2 coordinates, or about one of 3 and an axis.")
        if shift.shape not in ((0,), centre.shape):
            raise DeformError(f"the shift of a turn needs {len(centre)} finite numbers, got shape {shift.shape}.")
        t = centre - m @ centre + (shift if shift.size else 0.0)
        return cls(tuple(map(tuple, m.tolist())), tuple(t.tolist()))

    @property
    def dim(self) -> int:
        """2 on a picture, 3 in space."""
        return len(self.shift)

    @property
    def inverse(self) -> RigidMotion:
        """The inverse motion."""
        m = np.asarray(self.matrix).T
        return RigidMotion(tuple(map(tuple, m.tolist())), tuple((-m @ np.asarray(self.shift)).tolist()))

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Move points (..., dim) by this motion."""
        return np.asarray(points, dtype=np.float64) @ np.asarray(self.matrix).T + np.asarray(self.shift)

    def power(self, t: float) -> RigidMotion:
        """The motion done t times, along one screw: half of it for 0.5, its inverse for -1.

        The matrix of 200 degrees one way is that of 160 the other; the shorter way is taken.
        """
        if t == 1:
            return self
        dim = self.dim
        m, shift = np.eye(3), np.zeros(3)
        m[:dim, :dim], shift[:dim] = self.matrix, self.shift
        turn = scipy.spatial.transform.Rotation.from_matrix(m).as_rotvec()
        rate = np.linalg.solve(_path(turn), shift)
        part, along = scipy.spatial.transform.Rotation.from_rotvec(t * turn).as_matrix(), _path(t * turn) @ (t * rate)
        return RigidMotion(tuple(map(tuple, part[:dim, :dim].tolist())), tuple(along[:dim].tolist()))


def _numbers(value: ArrayLike | None) -> NDArray[np.float64]:
    """An array of float64; an empty one for None or for anything without numbers."""
    found = None if value is None else real_array(value)
    return np.zeros(0) if found is None else found


def _path(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """The integral of exp(s [turn]) over s from 0 to 1: from the velocity of a screw to its shift."""
    angle = float(np.linalg.norm(turn))
    k = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
    if angle < 1e-4:  # the next terms are below 1e-9
        return np.eye(3) + k / 2 + k @ k / 6
    return np.eye(3) + k * (1 - np.cos(angle)) / angle**2 + k @ k * (angle - np.sin(angle)) / angle**3


# Distances on lattices, cached while a control point is dragged, for the parts do not move: 256^3 twice.
_KEPT_BYTES = 2**27


def smoothstep(t: Any, xp: Any = np) -> Any:
    """A step from 0 to 1 over t from 0 to 1 with two continuous derivatives: 6 t^5 - 15 t^4 + 10 t^3.

    >>> smoothstep(np.array([-1.0, 0.5, 2.0])).tolist()
    [0.0, 0.5, 1.0]
    """
    t = xp.clip(t, 0.0, 1.0)
    return t * t * t * (t * (6.0 * t - 15.0) + 10.0)


def _distance(t: Any, xp: Any = np) -> Any:
    return xp.maximum(t, 0.0)


RigidWeightName: TypeAlias = Literal["saturated", "distance"]
"""Names of the weights of a rigid part."""

WEIGHTS: dict[str, Callable[..., Any]] = {"saturated": smoothstep, "distance": _distance}
"""Weights from a part's distance, in units of its scale: the smooth step, or the paper's distance itself."""

_WEIGHT_SLOPES: dict[str, Callable[[Any], Any]] = {
    "saturated": lambda t: 30.0 * np.square(np.clip(t, 0.0, 1.0) * (1.0 - np.clip(t, 0.0, 1.0))),
    "distance": lambda t: np.where(t > 0, 1.0, 0.0),
}
"""The derivatives of :data:`WEIGHTS`."""


def drift_and_weight(
    x: Any, back: list[Any], distances: list[Any], scales: Any, weights: tuple[str, ...], xp: Any
) -> tuple[Any, Any]:
    """L(x) - x and w(x) from every part's motion and distance."""
    weight = weight_of(distances, scales, weights, xp)
    if len(back) == 1:
        return back[0] - x, weight
    # 1 / distance^2, multiplied by the least of all, which is finite in the parts and exact next to them.
    least = distances[0]
    for d in distances[1:]:
        least = xp.minimum(least, d)
    shares = [xp.where(d > least, (least / xp.where(d > 0, d, 1.0)) ** 2, 1.0) for d in distances]
    total = sum(shares)
    return sum((s / total)[..., None] * (y - x) for s, y in zip(shares, back, strict=True)), weight


def weight_of(distances: list[Any], scales: Any, weights: tuple[str, ...], xp: Any) -> Any:
    """w(x), the product over the parts."""
    weight = 1.0
    for distance, scale, name in zip(distances, scales, weights, strict=True):
        # A NumPy scalar of 64 bits would make 64 bits of all distances.
        weight = weight * WEIGHTS[name](distance / (float(scale) if xp is np else scale), xp)
    return weight


def weight_gradient(distances: list[Any], slopes: list[Any], scales: Any, weights: tuple[str, ...]) -> tuple[Any, Any]:
    """w (n) and its gradient (n, dim), from every part's distance (n) and the gradient of that."""
    units = [d / float(s) for d, s in zip(distances, scales, strict=True)]
    values = [WEIGHTS[name](t) for t, name in zip(units, weights, strict=True)]
    gradient = 0.0
    for k, (t, slope, scale, name) in enumerate(zip(units, slopes, scales, weights, strict=True)):
        others = np.prod([v for j, v in enumerate(values) if j != k], axis=0)
        gradient = gradient + (others * _WEIGHT_SLOPES[name](t) / float(scale))[:, None] * slope
    return np.prod(values, axis=0), gradient


def drift_gradient(
    x: NDArray[np.float64], back: list[Any], distances: list[Any], slopes: list[Any], matrices: Any
) -> NDArray[np.float64]:
    """The derivative (n, dim, dim) of L(x) - x.

    With the shares ``p_k = d_k^-2 / sum_j d_j^-2`` of the parts, ``dp_k = 2 p_k (sum_j p_j q_j - q_k)`` and
    ``q_k = (grad d_k) / d_k``; within a part its share is 1 and does not change.
    """
    turns = [np.asarray(m) - np.eye(x.shape[1]) for m in matrices]
    if len(back) == 1:
        return np.broadcast_to(turns[0], (*x.shape, x.shape[1]))
    least = np.min(distances, axis=0)
    raw = [np.where(d > least, (least / np.where(d > 0, d, 1.0)) ** 2, 1.0) for d in distances]
    shares = [r / sum(raw) for r in raw]
    rates = [
        np.where(d[:, None] > 0, g / np.where(d > 0, d, 1.0)[:, None], 0.0)
        for d, g in zip(distances, slopes, strict=True)
    ]
    mean = sum(p[:, None] * q for p, q in zip(shares, rates, strict=True))
    out = np.zeros((*x.shape, x.shape[1]))
    for p, q, y, turn in zip(shares, rates, back, turns, strict=True):
        change = np.where(least[:, None] > 0, 2 * p[:, None] * (mean - q), 0.0)
        out += p[:, None, None] * turn + (y - x)[:, :, None] * change[:, None, :]
    return out


def _measure(region: AbstractRegion, places: Any) -> tuple[Any, Any]:
    distance, slope = value_and_slopes(region, places.T)
    return distance, slope.T


_measured = blockwise(_measure)


def gradients(region: AbstractRegion, matrix: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[Any, Any]:
    """A part's distance (n) and its gradient (n, dim) by x, where x is at y in the part; both zero within it."""
    distance, slope = _measured(region, y.T)
    outside = distance > 0
    return np.where(outside, distance, 0.0), np.where(outside[:, None], slope.T @ matrix, 0.0)


_kept: OrderedDict[Any, NDArray[np.float32]] = OrderedDict()
_keeping = threading.Lock()


def cached_distances(
    region: AbstractRegion,
    matrix: NDArray[np.float64],
    shift: NDArray[np.float64],
    rows: NDArray[np.float64],
    columns: NDArray[np.float64],
) -> NDArray[np.float32]:
    """Distances (R, C) of a part from the places ``rows[:, r] + columns[:, c]``, measured at their places in it.

    They are cached from the last edit if they are the same: a drag moves points, and no parts.
    """
    return _cached(
        (region, matrix.tobytes(), shift.tobytes(), rows.tobytes(), columns.tobytes()),
        lambda: np.maximum(region.signed_distance(_outer_sum(rows, columns) @ matrix.T + shift), 0.0),
    )


def cached_gradients(
    region: AbstractRegion, rows: NDArray[np.float64], columns: NDArray[np.float64]
) -> NDArray[np.float32]:
    """The same for distances to a part that stays, with their gradients: (R C, 1 + dim)."""

    def make() -> NDArray[np.float64]:
        distance, slope = gradients(region, np.eye(region.dim), _outer_sum(rows, columns).reshape(-1, region.dim))
        return np.concatenate([distance[:, None], slope], axis=1)

    return _cached((region, "gradients", rows.tobytes(), columns.tobytes()), make)


def _outer_sum(rows: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """The places (R, C, dim)."""
    return np.stack([a[:, None] + b[None, :] for a, b in zip(rows, columns, strict=True)], axis=-1)


def _cached(key: Any, make: Callable[[], NDArray[np.float64]]) -> NDArray[np.float32]:
    with _keeping:
        found = _kept.pop(key, None)
    if found is None:
        found = make().astype(np.float32)
    with _keeping:
        _kept[key] = found  # the newest is last
        while sum(a.nbytes for a in _kept.values()) > _KEPT_BYTES and len(_kept) > 1:
            _kept.popitem(last=False)
    return found


# A point inside a part that requires the motion of the part may miss it by this share of the box of all points.
SAME_MOTION = 1e-6

# Parts that touch, as bones in a joint do, may share this much of one of them: shapes are drawn by hand, and
# silhouettes of bones in space overlap by 1 % on a picture.
_CONTACT = 0.03


@dataclass(frozen=True)
class RigidPart:
    """A region whose tissue is not deformed.

    Parameters
    ----------
    region : the part before the deformation; a :class:`Line` has no inside to be a part.
    motion : how it moves; None if it is fixed.
    weight : a name of :data:`WEIGHTS`.
    reach : distance from the part beyond which it has no effect; None leaves that to the nearest control point.
    name : shown to people.
    enabled : a part that is switched off stays in the list.
    pivot : the place of the region about which editors turn it, as many coordinates; None is the region's middle. It
        decides how a motion is set and shown, and changes none.

    Examples
    --------
    >>> from deformnb.rbf.regions import Polygon
    >>> bone = RigidPart(Polygon([(0, 0), (20, 0), (20, 40), (0, 40)]), name="femur")
    >>> bone.name, bone.motion is None
    ('femur', True)
    """

    region: AbstractRegion
    motion: RigidMotion | None = None
    weight: RigidWeightName = "saturated"
    reach: float | None = None
    name: str = ""
    enabled: bool = True
    pivot: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.region, AbstractRegion):
            raise DeformError(f"a rigid part needs a region, got {type(self.region).__name__}.")
        if self.region.kind == "line":
            raise DeformError("a line has no inside to stay rigid; use a polygon or a half space.")
        check_fields(self, "motion", "weight", "reach", "name", "enabled")
        if self.weight not in WEIGHTS:
            raise DeformError(f"unknown weight {self.weight!r} of a rigid part; choose one of {', '.join(WEIGHTS)}.")
        if self.reach is not None and not (np.isfinite(self.reach) and self.reach > 0):
            raise DeformError(f"the reach of a rigid part must be a positive length, got {self.reach}.")
        if self.motion is not None and self.motion.dim != self.region.dim:
            raise DeformError(f"a motion of {self.motion.dim} dimensions does not move a region of {self.region.dim}.")
        if self.pivot is not None:
            pivot = _numbers(self.pivot)
            if pivot.shape != (self.region.dim,) or not np.isfinite(pivot).all():
                raise DeformError(
                    f"the pivot of a rigid part in {self.region.dim} dimensions must be as many finite "
                    f"numbers, got {self.pivot}."
                )
            object.__setattr__(self, "pivot", tuple(pivot.tolist()))

    @property
    def label(self) -> str:
        """Label of the part in messages."""
        return f'the rigid part "{self.name}"' if self.name else "a rigid part"

    def scaled(self, strength: float) -> RigidPart:
        """The same part moved ``strength`` times as far."""
        return self if self.motion is None or strength == 1 else replace(self, motion=self.motion.power(strength))


@pytree(data_fields=["base", "regions", "matrices", "shifts", "scales"], meta_fields=["weights", "notes"])
@dataclass(frozen=True, eq=False, repr=False)
class RigidInterpolant(AbstractFit):
    """The solved displacement with rigid parts: ``D(x) = (L(x) - x) + w(x) g(x)``.

    Parameters
    ----------
    base : g, the fit of the residual at the control points.
    regions : K regions; matrices (K, dim, dim), shifts (K, dim): their backward motions L_k.
    scales : (K,) lengths by which the distances are divided.
    weights : K names of :data:`WEIGHTS`.
    notes : remarks for a status line.
    """

    base: AbstractInterpolant
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
        """The trend of the fit of the residual."""
        return self.base.trend

    @full_precision
    def jax_displacement(self, points: Any) -> Any:
        x = jnp.asarray(points)
        back = [x @ jnp.asarray(m).T + t for m, t in zip(self.matrices, self.shifts, strict=True)]
        distances = [jnp.maximum(r(y), 0.0) for r, y in zip(self.regions, back, strict=True)]
        moved, weight = drift_and_weight(x, back, distances, self.scales, self.weights, jnp)
        return moved + weight[..., None] * self.base.jax_displacement(x)

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

    def lattice_jacobians(self, rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float32]:
        r, c = np.asarray(rows, dtype=np.float64), np.asarray(columns, dtype=np.float64)
        if not all(map(_is_still, self.matrices, self.shifts)):
            return super().lattice_jacobians(r, c)
        measured = [cached_gradients(region, r, c) for region in self.regions]  # a drag moves no parts
        shape = (r.shape[1], c.shape[1])
        weight, rate = weight_gradient(
            [m[:, 0] for m in measured], [m[:, 1:] for m in measured], self.scales, self.weights
        )
        base = self.base.lattice_values(r, c, 1.0)
        rate = np.moveaxis(rate.reshape(*shape, self.dim), -1, 0)
        out = weight.reshape(shape) * self.base.lattice_jacobians(r, c) + base[:, None] * rate[None]
        return np.asarray(out, dtype=np.float32)

    def parts_at(self, x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """L(x) - x, (..., dim), and w(x), (...), at points."""
        back = [x @ np.asarray(m).T + t for m, t in zip(self.matrices, self.shifts, strict=True)]
        distances = [np.maximum(r.signed_distance(y), 0.0) for r, y in zip(self.regions, back, strict=True)]
        return drift_and_weight(x, back, distances, self.scales, self.weights, np)

    def lattice_values(self, rows: ArrayLike, columns: ArrayLike, resolution: float) -> NDArray[np.float32]:
        r, c = np.asarray(rows, dtype=np.float64), np.asarray(columns, dtype=np.float64)
        base = self.base.lattice_values(r, c, resolution)
        motions = [(np.asarray(m), np.asarray(t)) for m, t in zip(self.matrices, self.shifts, strict=True)]
        distances = [cached_distances(region, m, t, r, c) for region, (m, t) in zip(self.regions, motions, strict=True)]
        if all(_is_still(m, t) for m, t in motions):  # the common case, without the drift that is zero everywhere
            return np.asarray(weight_of(distances, self.scales, self.weights, np), dtype=np.float32) * base
        places = _outer_sum(r, c)
        back = [places @ m.T + t for m, t in motions]
        moved, weight = drift_and_weight(places, back, distances, self.scales, self.weights, np)
        return np.asarray(np.moveaxis(moved, -1, 0) + weight * base, dtype=np.float32)


def _is_still(matrix: Any, shift: Any) -> bool:
    return bool((np.asarray(matrix) == np.eye(len(shift))).all() and not np.asarray(shift).any())


# Samples along each side of the box of a part, to find what two parts have in common.
_SAMPLES = 24


def part_conflicts(parts: Sequence[RigidPart]) -> tuple[str, ...]:
    """Sentences on rigid parts that contradict each other: of the same tissue in two motions, or pushed together.

    Examples
    --------
    >>> from deformnb.rbf.regions import Polygon
    >>> bone = Polygon([(0, 0), (9, 0), (9, 9), (0, 9)])
    >>> for angle in (0, 20):
    ...     print(part_conflicts([RigidPart(bone, RigidMotion.turn(0, (0, 0))),
    ...                           RigidPart(bone, RigidMotion.turn(angle, (4, 4)))]))
    ()
    ('rigid parts 1 and 2 hold the same tissue and move it to different places: their motions are blended there. \
Separate the parts, or give them one motion.',)
    """
    chosen = [(str(k + 1) if not part.name else part.name, part) for k, part in enumerate(parts) if part.enabled]
    found = []
    for k, (name, part) in enumerate(chosen):
        for other_name, other in chosen[k + 1 :]:
            overlap, contact = _overlap(part, other)
            if overlap:
                found.append(
                    f"rigid parts {name} and {other_name} hold the same tissue and move it to different "
                    "places: their motions are blended there. Separate the parts, or give them one motion."
                )
            elif contact:
                found.append(
                    f"rigid parts {name} and {other_name} are pushed into each other: tissue of both is "
                    "lost there. Move them apart."
                )
    return tuple(found)


def _overlap(part: RigidPart, other: RigidPart) -> tuple[bool, bool]:
    """Check whether two parts claim the same tissue with different motions, and whether they overlap after them."""
    overlap = contact = False
    for one, two in ((part, other), (other, part)):
        x = one.region.samples(_SAMPLES)
        if not len(x):
            continue
        here, there = (x if p.motion is None else p.motion(x) for p in (one, two))
        size = float(np.linalg.norm(np.ptp(x, axis=0)))
        before = two.region.signed_distance(x)
        shared = (before < 0) & (np.linalg.norm(here - there, axis=1) > SAME_MOTION * size)
        overlap |= bool(shared.mean() > _CONTACT)
        back = here if two.motion is None else two.motion.inverse(here)
        contact |= bool(((two.region.signed_distance(back) < 0) & (before >= 0)).mean() > _CONTACT)
    return overlap, contact


HeldPointRule: TypeAlias = Literal["refuse", "carry", "switch off"]
"""Names of the rules for points within a rigid part."""

HELD_POINT_RULES: tuple[HeldPointRule, ...] = get_args(HeldPointRule)
"""Treatments of control points within a rigid part that require another displacement than the part's."""


def without_conflicts(
    points: ControlPoints, parts: Sequence[RigidPart], held: HeldPointRule = "carry"
) -> ControlPoints:
    """The control points with rigid parts, without any that requires something else than the part that contains it.

    Parameters
    ----------
    held : "carry" lets such points go where their part takes them, which is back to their sources in a fixed part;
        "switch off" leaves their places and switches them off; "refuse" leaves them for :func:`fit_rigid` to refuse.

    Raises
    ------
    DeformError
        If ``held`` is none of :data:`HELD_POINT_RULES`.

    Examples
    --------
    >>> from deformnb.rbf.regions import Polygon
    >>> bone = RigidPart(Polygon([(0, 0), (9, 0), (9, 9), (0, 9)]))
    >>> points = ControlPoints.from_arrays([[2, 2], [20, 2]], [[5, 5], [22, 2]])
    >>> without_conflicts(points, [bone]).target.tolist()
    [[2.0, 2.0], [22.0, 2.0]]
    >>> without_conflicts(points, [bone], "switch off").active.tolist()
    [False, True]
    """
    if held not in HELD_POINT_RULES:
        raise DeformError(
            f"there is no way {held!r} for points within a rigid part; choose one of {', '.join(HELD_POINT_RULES)}."
        )
    for part in parts if held != "refuse" else ():
        if not part.enabled:
            continue
        back = points.target if part.motion is None else part.motion.inverse(points.target)
        size = size_of(points)
        differs = points.active & (part.region.signed_distance(back) <= 0)
        differs &= np.linalg.norm(points.source - back, axis=1) > SAME_MOTION * size
        carried = points.source if part.motion is None else part.motion(points.source)
        for k in np.flatnonzero(differs).tolist():
            points = points.edit(points.ids[k], **({"target": carried[k]} if held == "carry" else {"active": False}))
    return points


def carry_points(points: ControlPoints, before: Sequence[RigidPart], after: Sequence[RigidPart]) -> ControlPoints:
    """The control points after rigid parts have got other motions: those that a part carried follow it.

    Parameters
    ----------
    before, after : the same parts in the same order; those whose motion alone differs count. A part carries the
    active points in it that require its motion.

    Examples
    --------
    >>> from deformnb.rbf.regions import Polygon
    >>> bone = RigidPart(Polygon([(0, 0), (9, 0), (9, 9), (0, 9)]))
    >>> points = ControlPoints.from_arrays([[2, 2], [20, 2]])
    >>> carry_points(points, [bone], [replace(bone, motion=RigidMotion.turn(0, (0, 0), (5, 1)))]).target.tolist()
    [[7.0, 3.0], [20.0, 2.0]]
    """
    target = points.target.copy()
    for p, q in zip(before, after, strict=False):
        if p.motion != q.motion and p.region == q.region and p.enabled and q.enabled:
            goes = _carried_mask(points, p)
            target[goes] = points.source[goes] if q.motion is None else q.motion(points.source[goes])
    return points if np.array_equal(target, points.target) else replace(points, target=target)


def scaled_points(points: ControlPoints, parts: Sequence[RigidPart], strength: float) -> ControlPoints:
    """The control points dragged ``strength`` times as far; those that a part carries go as far as it does then.

    Half a rotation is not half the displacement: a carried point that went straight would leave its place in the part.

    Examples
    --------
    >>> from deformnb.rbf.regions import Polygon
    >>> bone = RigidPart(Polygon([(0, 0), (9, 0), (9, 9), (0, 9)]), RigidMotion.turn(180, (0, 0)))
    >>> points = ControlPoints.from_arrays([[2, 0], [20, 2]], [[-2, 0], [24, 2]])
    >>> scaled_points(points, [bone], 0.5).target.round(9).tolist()
    [[0.0, 2.0], [22.0, 2.0]]
    """
    if strength == 1:
        return points
    scaled = points.scaled(strength)
    target = scaled.target.copy()
    for part in parts:
        if part.enabled and part.motion is not None:
            goes = _carried_mask(points, part)
            target[goes] = part.motion.power(strength)(points.source[goes])
    return replace(scaled, target=target)


def _carried_mask(points: ControlPoints, part: RigidPart) -> NDArray[np.bool_]:
    """Mask of the active points in a part that require the part's displacement."""
    if part.region.dim != points.dim:
        return np.zeros(len(points), dtype=bool)
    back = points.target if part.motion is None else part.motion.inverse(points.target)
    near = np.linalg.norm(points.source - back, axis=1) <= SAME_MOTION * size_of(points)
    return np.asarray(points.active & near & (part.region.signed_distance(back) <= 0))


def size_of(points: ControlPoints) -> float:
    """The diagonal of the box of all sources and targets; 0 without points."""
    places = np.concatenate([points.source, points.target])
    return float(np.linalg.norm(np.ptp(places, axis=0))) if len(points) else 0.0

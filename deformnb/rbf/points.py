"""Control points: pairs of a source (the place of a feature) and a target (the place to which it should move).

Dragging a point moves its target. The backward displacement at the target is ``source - target``, so the feature of
the source appears exactly where it was dropped. Every change makes a new object; ids are never given twice.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._entrances import AbstractCellOutput
from deformnb.checks import LARGEST_COORDINATE, check_fields, is_finite, optional_package, short_value
from deformnb.errors import DeformError
from deformnb.rbf.named_points import AXIS_NAMES, AbstractNamedPoints, check_table, names_of, read_columns
from deformnb.volume.units import check_unit, ratio

NAMES_SHOWN = 8  # by repr


class HasPlaces(Protocol):
    """Named places, as of Landmarks."""

    @property
    def points(self) -> NDArray[np.float64]:
        """The places, (N, 2) or (N, 3)."""

    @property
    def names(self) -> tuple[str, ...]:
        """N texts."""

    @property
    def active(self) -> NDArray[np.bool_] | None:
        """N switches, or none."""


def _index_by_name(places: HasPlaces, which: str) -> dict[str, int]:
    found = dict[str, int]()
    for k, name in enumerate(places.names):
        if not name or name in found:
            why = f"{short_value(name)} comes more than once" if name else f"landmark {k + 1} has no name"
            raise DeformError(
                f"of the {which} landmarks {why}, so that they cannot be paired by name; correct it, or "
                'pair them with pair="order".'
            )
        found[name] = k
    return found


@dataclass(frozen=True)
class ControlPoint:
    """One control point of a set, as ``points["head"]`` and iteration give it; editing is done by the set.

    Parameters
    ----------
    id, name, active, weight, locked : as in :class:`ControlPoints`.
    source, target : coordinates (a, b) or (x, y, z).
    radius : its own support radius; None if it has that of all points.

    Examples
    --------
    >>> ControlPoints.from_arrays([[10, 0]], [[12, 1]], names=["head"])["head"].target
    (12.0, 1.0)
    """

    id: int
    name: str
    source: tuple[float, ...]
    target: tuple[float, ...]
    active: bool
    weight: float
    locked: bool
    radius: float | None


@dataclass(frozen=True, eq=False)
class ControlPoints(AbstractNamedPoints[ControlPoint], AbstractCellOutput):
    """A set of control points in the plane of a picture (dim 2) or in space (dim 3).

    ``points["head"]`` and ``points[0]`` are one point by its name or position, ``points[1:]`` and ``points[mask]`` sets
    of several; a name is also accepted wherever an id is.

    Parameters
    ----------
    source, target : (N, dim) float64, physical coordinates: (a, b) of a picture's plane or (x, y, z).
    ids : N different integers, stable for the life of the set.
    names : N texts, free and not necessarily different.
    active : (N,) bool; a point that is switched off is stored but takes no part in the fit.
    weight : (N,) positive; how much a point counts when smoothing is on (inverse variance).
    next_id : the id of the next point; grows only, so that the id of a removed point is never used again.
    locked : (N,) bool; editors, brushes and fits leave such a point where it is. Code may move it.
    radius : (N,) positive, a support radius of the point's own; NaN where it has that of all.
    unit : of all lengths, a symbol or a name of :data:`~deformnb.volume.units.UNITS`; "" where it is that of the volume
        on which they are used. A step of a deformation has that of its deformation.
    numbers : of the points in the list that people see, for labels: 1 to N unless this is a subset of that list.
        Neither compared nor stored.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [10, 0]], [[0, 0], [12, 1]], names=["tail", "head"])
    >>> points.displacement.tolist()
    [[0.0, 0.0], [-2.0, -1.0]]
    >>> points = points.move(1, [11, 0]).add([5, 5], name="fin")
    >>> points.ids, points.names
    ((0, 1, 2), ('tail', 'head', 'fin'))
    """

    source: NDArray[np.float64]
    target: NDArray[np.float64]
    ids: tuple[int, ...]
    names: tuple[str, ...]
    active: NDArray[np.bool_]
    weight: NDArray[np.float64]
    next_id: int = field(default=0)
    locked: NDArray[np.bool_] = field(default=None)  # type: ignore[arg-type]  # made in __post_init__
    radius: NDArray[np.float64] = field(default=None)  # type: ignore[arg-type]
    unit: str = ""
    numbers: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        check_fields(self, "source", "target", "ids", "names", "active", "weight", "numbers")
        n = len(self.ids)
        object.__setattr__(self, "unit", check_unit(self.unit))
        object.__setattr__(self, "numbers", self.numbers or tuple(range(1, n + 1)))
        if self.locked is None:
            object.__setattr__(self, "locked", np.zeros(n, dtype=bool))
        if self.radius is None:
            object.__setattr__(self, "radius", np.full(n, np.nan))
        check_fields(self, "locked", "radius", "next_id")
        if self.source.ndim != 2 or self.source.shape[1] not in (2, 3) or self.source.shape != self.target.shape:
            raise DeformError(
                "source and target must both have shape (N, 2) or (N, 3), "
                f"got {self.source.shape} and {self.target.shape}."
            )
        counts = [array.shape[0] if array.ndim else -1 for array in self._per_point.values()]
        if {len(self.source), len(self.names), len(self.numbers), *counts} != {n}:
            raise DeformError(f"{len(self.source)} points need as many ids, names, switches, weights, locks and radii.")
        if len(set(self.ids)) != n:
            twice = sorted({i for i in self.ids if self.ids.count(i) > 1})
            raise DeformError(f"control point ids must differ; {twice} come more than once.")
        self._check_numbers()
        for array in (self.source, self.target, *self._per_point.values()):
            array.flags.writeable = False
        if self.next_id > 2**53:
            raise DeformError(f"the id of the next point must be a whole number, got {short_value(self.next_id)}.")
        object.__setattr__(self, "next_id", max([self.next_id, *(i + 1 for i in self.ids)]))

    def __repr__(self) -> str:
        moved = int((self.source != self.target).any(axis=1).sum())
        named = [name[:20] for name in self.names if name]
        names = ", ".join(map(repr, named[:NAMES_SHOWN])) + (", ..." if len(named) > NAMES_SHOWN else "")
        return (
            f"<ControlPoints: {len(self)} {'point' if len(self) == 1 else 'points'} "
            f"{'in the plane' if self.dim == 2 else 'in space'}, {moved} moved{': ' if names else ''}{names}>"
        )

    @property
    def _per_point(self) -> dict[str, NDArray[Any]]:
        """The arrays with one entry for each point, apart from its places, id and name."""
        return {"active": self.active, "weight": self.weight, "locked": self.locked, "radius": self.radius}

    def _check_numbers(self) -> None:
        for what, array in zip(("switches", "weights", "locks", "radii"), self._per_point.values(), strict=True):
            if array.ndim != 1:
                raise DeformError(f"the {what} of control points must be one for each, got shape {array.shape}.")
        for what, array in (("source", self.source), ("target", self.target)):
            good = (np.abs(array) <= LARGEST_COORDINATE).all(axis=1)  # False for NaN as well
            if not good.all():
                k = int(np.flatnonzero(~good)[0])
                raise DeformError(
                    f"the {what} of {self.label(k)} is {array[k].tolist()}; coordinates must be finite and below 1e15. "
                    "Correct or remove that point."
                )
        if not (np.isfinite(self.weight) & (self.weight > 0)).all():
            k = int(np.flatnonzero(~(np.isfinite(self.weight) & (self.weight > 0)))[0])
            raise DeformError(f"the weight of {self.label(k)} is {self.weight[k]}; weights must be positive numbers.")
        good = np.isnan(self.radius) | (self.radius > 0) & (self.radius <= LARGEST_COORDINATE)
        if not good.all():
            k = int(np.flatnonzero(~good)[0])
            raise DeformError(
                f"the radius of {self.label(k)} is {self.radius[k]}; a radius is a positive length, or "
                "nan for the one that all points have."
            )

    @classmethod
    def from_arrays(
        cls,
        source: ArrayLike,
        target: ArrayLike | None = None,
        *,
        ids: Sequence[int] | None = None,
        names: Sequence[str] | None = None,
        active: ArrayLike | None = None,
        weight: ArrayLike | None = None,
        next_id: int = 0,
        locked: ArrayLike | None = None,
        radius: ArrayLike | None = None,
        unit: str = "",
    ) -> ControlPoints:
        """Points from arrays of shape (N, 2) or (N, 3); the targets are the sources where not given."""
        s = _as_points(source, "source")
        t = s.copy() if target is None else _as_points(target, "target")
        n = len(s)
        return cls(
            s,
            t,
            tuple(range(n)) if ids is None else tuple(_per_point(ids, np.int64, "ids").tolist()),
            tuple(str(name) for name in ([""] * n if names is None else _check_list(names, "names"))),
            np.ones(n, dtype=bool) if active is None else _per_point(active, np.bool_, "switches"),
            np.ones(n) if weight is None else _per_point(weight, np.float64, "weights"),
            next_id,
            None if locked is None else _per_point(locked, np.bool_, "locks"),  # type: ignore[arg-type]
            # None becomes nan: a list may leave out single radii
            None if radius is None else _per_point(radius, np.float64, "radii"),  # type: ignore[arg-type]
            unit,
        )

    def to_unit(self, unit: str) -> ControlPoints:
        """The same points in numbers of another unit; where their own or the other one is not known, themselves.

        Examples
        --------
        >>> ControlPoints.from_arrays([[1, 2]], [[1, 3]], unit="mm").to_unit("um").target.tolist()
        [[1000.0, 3000.0]]
        """
        to = check_unit(unit)
        if to in ("", self.unit) or not self.unit:
            return self
        factor = ratio(self.unit, to)
        return replace(
            self, source=self.source * factor, target=self.target * factor, radius=self.radius * factor, unit=to
        )

    @classmethod
    def from_landmarks(cls, moving: HasPlaces, fixed: HasPlaces, *, pair: Literal["name", "order"] = "name") -> Paired:
        """Pairs of two lists of landmarks, and the unpaired ones: each moving place corresponds to a fixed one.

        Parameters
        ----------
        moving, fixed : Landmarks of the volume that is deformed, and of the one that it is fitted to. Where both have
            their unit the points are in that of the moving ones.
        pair : "name" pairs those with the same name, in the order of the moving ones; "order" the first with the
            first, and so on.

        Returns
        -------
        The points and the labels of what has no counterpart in either list. A pair is active where both are.

        Raises
        ------
        DeformError
            If the lists have other dimensions, or for "name" a name is missing or occurs twice.

        Examples
        --------
        >>> from deformnb.warping.points import Landmarks
        >>> mouse = Landmarks([[0, 0, 0], [9, 0, 0]], ("nose", "tail"))
        >>> atlas = Landmarks([[9, 1, 0], [5, 5, 0]], ("tail", "ear"))
        >>> points, left_moving, left_fixed = ControlPoints.from_landmarks(mouse, atlas)
        >>> points.displacement.tolist(), left_moving, left_fixed
        ([[0.0, -1.0, 0.0]], ('nose',), ('ear',))
        """
        for side in (moving, fixed):
            if not all(hasattr(side, name) for name in ("points", "names", "active")):
                raise DeformError(
                    f"Landmarks are needed, got {short_value(side)}; Landmarks(points, names) makes some."
                )
        if moving.points.shape[1] != fixed.points.shape[1]:
            raise DeformError(
                f"the moving landmarks have {moving.points.shape[1]} coordinates and the fixed ones "
                f"{fixed.points.shape[1]}; they must have the same."
            )
        counts = len(moving.points), len(fixed.points)
        if pair == "order":
            found = [(k, k) for k in range(min(counts))]
        elif pair == "name":
            places = [_index_by_name(*each) for each in ((moving, "moving"), (fixed, "fixed"))]
            found = [(k, places[1][name]) for name, k in places[0].items() if name in places[1]]
        else:
            raise DeformError(f'landmarks are paired by "name" or by "order", got {short_value(pair)}.')
        a, b = ([each[which] for each in found] for which in (0, 1))
        active = [
            np.ones(n, bool) if side.active is None else side.active
            for side, n in zip((moving, fixed), counts, strict=True)
        ]
        own, other = (getattr(side, "unit", "") for side in (moving, fixed))
        points = cls.from_arrays(
            moving.points[a],
            fixed.points[b] * ratio(other, own),
            active=active[0][a] & active[1][b],
            unit=own or other,
            names=[moving.names[k] or fixed.names[j] for k, j in found],
        )
        left = [
            tuple(side.names[k] or f"landmark {k + 1}" for k in range(n) if k not in used)
            for side, n, used in zip((moving, fixed), counts, (set(a), set(b)), strict=True)
        ]
        return Paired(points, *left)

    @classmethod
    def empty(cls, dim: int = 2, next_id: int = 0) -> ControlPoints:
        """No points yet, in the plane (dim 2) or in space (dim 3)."""
        if dim not in (2, 3):
            raise DeformError(f"control points have 2 or 3 coordinates, got {short_value(dim)}.")
        return cls.from_arrays(np.zeros((0, dim)), next_id=next_id)

    def __len__(self) -> int:
        return len(self.ids)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ControlPoints):
            return NotImplemented
        return (
            self.ids == other.ids
            and self.names == other.names
            and self.next_id == other.next_id
            and np.array_equal(self.source, other.source)
            and np.array_equal(self.target, other.target)
            and np.array_equal(self.active, other.active)
            and np.array_equal(self.weight, other.weight)
            and np.array_equal(self.locked, other.locked)
            and np.array_equal(self.radius, other.radius, equal_nan=True)
            and self.unit == other.unit
        )

    __hash__ = None  # type: ignore[assignment]

    @property
    def dim(self) -> int:
        """2 for points on a picture, 3 for points in space."""
        return int(self.source.shape[1])

    @property
    def displacement(self) -> NDArray[np.float64]:
        """Backward displacement at the targets: ``source - target``, shape (N, dim)."""
        return np.asarray(self.source - self.target)

    def label(self, index: int) -> str:
        """Label of the point at a position, by its number in the list, for messages: 'point 3 ("nose")'."""
        name = f' ("{self.names[index]}")' if self.names[index] else ""
        return f"point {self.numbers[index]}{name}"

    def point_at(self, position: int) -> ControlPoint:
        """The point at a position from 0 on."""
        radius = float(self.radius[position])
        return ControlPoint(
            self.ids[position],
            self.names[position],
            tuple(self.source[position].tolist()),
            tuple(self.target[position].tolist()),
            bool(self.active[position]),
            float(self.weight[position]),
            bool(self.locked[position]),
            None if np.isnan(radius) else radius,
        )

    def __array__(self, *_: Any, **__: Any) -> NDArray[np.float64]:
        raise TypeError("control points are two arrays; take points.source or points.target.")

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame`` with a row for each point, by id, and the unit in its ``attrs``.

        Its columns are name, source_a and source_b on a picture or source_x to source_z in space, those of the target
        alike, active, weight, locked and radius (NaN for that of all).

        Examples
        --------
        >>> points = ControlPoints.from_arrays([[0, 0], [10, 0]], [[0, 0], [12, 1]], names=["tail", "head"])
        >>> points.to_pandas()["target_a"].tolist()
        [0.0, 12.0]
        """
        columns: dict[str, Any] = {"name": list(self.names)}
        for what, array in (("source", self.source), ("target", self.target)):
            columns |= {f"{what}_{axis}": array[:, k].copy() for k, axis in enumerate(AXIS_NAMES[self.dim])}
        columns |= {what: array.copy() for what, array in self._per_point.items()}
        pandas = optional_package("pandas")
        table = pandas.DataFrame(columns, index=pandas.Index(self.ids, name="id", dtype=np.int64))
        table.attrs.update(unit=self.unit, next_id=self.next_id)
        return table

    @classmethod
    def from_pandas(cls, table: Any) -> ControlPoints:
        """Control points of a ``pandas.DataFrame`` with the columns of :meth:`to_pandas`.

        The coordinates of the sources must be there; targets are at the sources where there are none, and ids count
        from 0 where the index is not named "id". Other columns are ignored.

        Raises
        ------
        DeformError
            If it is no table, or a coordinate is missing.

        Examples
        --------
        >>> import pandas as pd
        >>> table = pd.DataFrame({"source_a": [1], "source_b": [2], "target_a": [3], "target_b": [2]})
        >>> ControlPoints.from_pandas(table).displacement.tolist()
        [[-2.0, 0.0]]
        """
        table = check_table(table, "control points")
        source = read_columns(table, "source_", "control points")
        if source is None:
            raise DeformError(
                "the table of control points has no columns source_a and source_b (on a picture) or source_x, source_y "
                f"and source_z; it has {', '.join(map(str, table.columns))[:200]}."
            )
        given = {name: table[name].to_numpy() for name in ("active", "weight", "locked", "radius") if name in table}
        return cls.from_arrays(
            source,
            read_columns(table, "target_", "control points"),
            ids=table.index.tolist() if table.index.name == "id" else None,
            names=names_of(table),
            next_id=table.attrs.get("next_id", 0),
            unit=table.attrs.get("unit", ""),
            **given,
        )

    def index(self, point: int | str) -> int:
        """Position of the point with this id or name; DeformError if there is none."""
        if isinstance(point, str):
            return self.position_of(point)
        try:
            return self.ids.index(point)
        except ValueError:
            raise DeformError(f"there is no control point {short_value(point)}; there are {list(self.ids)}.") from None

    def add(
        self, source: ArrayLike, target: ArrayLike | None = None, *, name: str = "", weight: float = 1.0
    ) -> ControlPoints:
        """One more point, under the id ``next_id``; its target is its source unless given."""
        s = self._one_place(source, "source")[None]
        t = s if target is None else self._one_place(target, "target")[None]
        return ControlPoints(
            np.concatenate([self.source, s]),
            np.concatenate([self.target, t]),
            (*self.ids, self.next_id),
            (*self.names, name),
            np.append(self.active, True),
            np.append(self.weight, weight),
            self.next_id + 1,
            np.append(self.locked, False),
            np.append(self.radius, np.nan),
            self.unit,
        )

    def _one_place(self, value: ArrayLike, what: str) -> NDArray[np.float64]:
        try:
            place = np.array(value, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise DeformError(f"the {what} of a point must be {self.dim} numbers, got {short_value(value)}.") from None
        if place.shape != (self.dim,):  # a single number would be taken for all coordinates
            raise DeformError(f"the {what} of a point of this set has {self.dim} coordinates, got {value!r}.")
        return place

    def move(self, point: int | str, target: ArrayLike) -> ControlPoints:
        """Drop the point with this id or name at another target."""
        return self.edit(point, target=target)

    def edit(
        self,
        point: int | str,
        *,
        source: ArrayLike | None = None,
        target: ArrayLike | None = None,
        name: str | None = None,
        active: bool | None = None,
        weight: float | None = None,
        locked: bool | None = None,
        radius: float | None = None,
    ) -> ControlPoints:
        """Change the given values of the point with this id; a radius of nan is again the one that all points have."""
        k = self.index(point)
        changed: dict[str, Any] = {}
        for key, value in (
            ("source", source),
            ("target", target),
            ("active", active),
            ("weight", weight),
            ("locked", locked),
            ("radius", radius),
        ):
            if value is not None:
                array = np.array(getattr(self, key))
                array[k] = self._one_place(value, key) if array.ndim == 2 else _one(value, array.dtype, key)
                changed[key] = array
        if name is not None:
            changed["names"] = (*self.names[:k], name, *self.names[k + 1 :])
        return replace(self, **changed)

    def remove(self, *points: int | str) -> ControlPoints:
        """The set without the points of these ids or names; the other ids stay as they are."""
        gone = {self.index(p) for p in points}
        return self.take([k for k in range(len(self)) if k not in gone])

    def take(self, positions: Iterable[int]) -> ControlPoints:
        """The points at these positions, in this order: a list of its own, numbered from 1."""
        return replace(self.subset(positions), numbers=())

    def subset(self, positions: Iterable[int]) -> ControlPoints:
        """The points at these positions, in this order, as part of this list: each keeps its number."""
        k = _per_point(_check_list(positions, "positions"), np.int64, "positions").tolist()
        if k and not -len(self) <= min(k) <= max(k) < len(self):
            raise DeformError(f"there are {len(self)} control points; positions {min(k)} to {max(k)} were requested.")
        return ControlPoints(
            self.source[k],
            self.target[k],
            tuple(self.ids[p] for p in k),
            tuple(self.names[p] for p in k),
            self.active[k],
            self.weight[k],
            self.next_id,
            self.locked[k],
            self.radius[k],
            self.unit,
            numbers=tuple(self.numbers[p] for p in k),
        )

    def scaled(self, strength: float) -> ControlPoints:
        """The same points dragged ``strength`` times as far: 0 not at all, 1 as now, 2 exaggerated, -1 opposite."""
        if not is_finite(strength):
            raise DeformError(f"strength must be a finite number, got {short_value(strength)}.")
        return replace(self, target=self.source + strength * (self.target - self.source))

    def has_same_sources(self, other: ControlPoints) -> bool:
        """True if the same points are active as in another set, with the same sources: they were dragged at most."""
        return (
            self.ids == other.ids
            and np.array_equal(self.active, other.active)
            and np.array_equal(self.source, other.source)
        )

    @property
    def has_own_radii(self) -> bool:
        """True if an active point has an individual support radius."""
        return bool((~np.isnan(self.radius) & self.active).any())

    def reset(self) -> ControlPoints:
        """Every target back at its source."""
        return replace(self, target=self.source.copy())


def as_control_points(given: Any) -> ControlPoints:
    """Control points themselves, or those of pairs of landmarks; DeformError for anything else."""
    make = getattr(given, "control_points", None)
    if not isinstance(given, ControlPoints) and callable(make) and not isinstance(given, type):
        given = make()
    if not isinstance(given, ControlPoints):
        raise DeformError(
            f"ControlPoints are needed, got {short_value(given)}; ControlPoints.from_arrays(source, target) makes them."
        )
    return given


def _check_list(value: Any, what: str) -> list[Any]:
    if not isinstance(value, Iterable):
        raise DeformError(f"the {what} of control points are a list, got {short_value(value)}.")
    return list(value)


def _per_point(value: Any, kind: Any, what: str) -> NDArray[Any]:
    try:
        array = np.array(value, dtype=kind)
        if array.ndim != 1:
            raise ValueError
    except (TypeError, ValueError, OverflowError):
        raise DeformError(f"the {what} of control points must be one for each, got {short_value(value)}.") from None
    return array


def _one(value: Any, kind: Any, what: str) -> Any:
    try:
        return np.array(value, dtype=kind).reshape(())[()]
    except (TypeError, ValueError, OverflowError):
        raise DeformError(f"the {what} of a control point cannot be {short_value(value)}.") from None


def _as_points(value: ArrayLike, what: str) -> NDArray[np.float64]:
    try:
        array = np.asarray(value).astype(np.float64, casting="same_kind")  # a copy; no complex numbers, no texts
    except (TypeError, ValueError) as error:
        raise DeformError(f"{what} must be an array of numbers of shape (N, 2) or (N, 3): {error}.") from None
    if array.ndim != 2:
        raise DeformError(f"{what} must have shape (N, 2) or (N, 3), got {array.shape}.")
    return array


class Paired(NamedTuple):
    """Two lists of landmarks in pairs.

    Attributes
    ----------
    points : the pairs.
    left_moving, left_fixed : labels of the landmarks without a counterpart.
    """

    points: ControlPoints
    left_moving: tuple[str, ...]
    left_fixed: tuple[str, ...]

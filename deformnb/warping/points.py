"""Forward mapping of points and landmarks, by inverting the backward map.

Damped Newton on the map's own derivative: ``y <- y - t (1 + dD/dx)^-1 (y + D(y) - x)`` with t halved until the error
falls. Near a solution the error is squared at every turn. Where the result depends on the start, several are tried.

Landmarks are named places that follow a deformation; pairs of landmarks define one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from deformnb._deferred import scipy
from deformnb._entrances import AbstractCellOutput
from deformnb._jax import determinant, one_plus
from deformnb._typing import Floats
from deformnb.checks import check_fields, is_same_array, optional_package, real_array, short_value
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Decoupled
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField, HasField, as_field
from deformnb.rbf.forward import ForwardFit
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.named_points import AXIS_NAMES, AbstractNamedPoints, check_table, names_of, read_columns
from deformnb.rbf.newton import BackwardMap, keep_better, lengths_of, map_of, newton, search
from deformnb.rbf.partition import LocalFits
from deformnb.rbf.points import NAMES_SHOWN, ControlPoints
from deformnb.volume.units import check_unit, ratio
from deformnb.volume.volume import Grid, VolumeLike, as_grid

POINTS_AT_A_TIME = 2**14
"""Points of one block: few enough that only some shapes are ever compiled, and enough to be quick."""

# Newton's method ends at this share of the extent of the points: three digits better than a thousandth of a voxel in a
# volume of 1000 voxels, and far above the rounding of a stored float32 field (1e-7 of its displacement).
_POINT_TOLERANCE = 1e-6

# Coordinates themselves are rounded to 1e-16 of their size, and a sum of many terms to some more.
_ROUNDING = 1e-14

# Nodes at which the map is sampled to find a start where the usual ones lead nowhere: per axis, by dimension; and how
# many of the nearest are tried.
_SEEDS = {2: 128, 3: 24}
_NODES_TRIED = 4


def warp_points(
    points: ArrayLike | Landmarks,
    field: AbstractField | HasField,
    grid: Grid | VolumeLike | None = None,
    *,
    tolerance: float | None = None,
    max_iterations: int = 50,
) -> tuple[Floats, NDArray[np.bool_]]:
    """Map points of the input forward to the result: y with ``y + D(y) = x``, the inverse of the backward map.

    Damped Newton with the field's own derivative, from ``x - D(x)`` and, for what that does not reach, from x itself
    and from the places that the map brings nearest to x. A field of several steps is followed step by step. Where the
    map folds there are several such places and one of them is found.

    Parameters
    ----------
    points : (..., dim), physical; (a, b) on the plane for a field of dimension 2. Or landmarks, which go there and
        back in their own unit where it is another than the field's; an array has that of the field.
    field : backward displacements, or a Deformation.
    grid : of the volume that is deformed; needed for a Deformation.
    tolerance : largest error of ``y + D(y)``, as a length; default is 1e-6 of the extent of points and displacements.
    max_iterations : Newton steps at most, of each start.

    Returns
    -------
    moved : (..., dim), float64 and finite, the best place found.
    converged : (...), bool; False where the map has no such place, where it was not found, where the one found
        is on an inverted sheet of the folded map (det J has the other sign than around), and where the
        paper's rule of cuts hides it. Never ignore it.

    Raises
    ------
    DeformError
        If points are not finite or do not have the field's dimension.

    See Also
    --------
    deformnb.invert : the same for all nodes of a lattice.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> moved, converged = warp_points([[1.0, 2.0, 3.0]], Identity())
    >>> moved.tolist(), converged.tolist()
    ([[1.0, 2.0, 3.0]], [True])
    """
    field = as_field(field, grid)
    factor = unit_factor(points, field, grid)
    x = check_points(points, field, grid)
    if not x.size:
        return x, np.ones(x.shape[:-1], dtype=bool)
    flat = x.reshape(-1, field.dim)
    y, found = np.empty_like(flat), np.empty(len(flat), dtype=bool)
    tolerance = default_tolerance(flat, field) if tolerance is None else tolerance * factor
    for start in range(0, len(flat), POINTS_AT_A_TIME):
        part = slice(start, start + POINTS_AT_A_TIME)
        y[part], found[part] = deform_places(flat[part], field, tolerance, max_iterations)
    return y.reshape(x.shape) / factor, found.reshape(x.shape[:-1])


def unit_factor(points: object, field: AbstractField, grid: Grid | VolumeLike | None = None) -> float:
    """Factor from the unit of landmarks to that of a field, or of the volume that it deforms; 1 else."""
    there = field.unit or ("" if grid is None else as_grid(grid).unit)
    return ratio(points.unit, there) if isinstance(points, Landmarks | ControlPoints) else 1.0


def check_points(points: ArrayLike | Landmarks, field: AbstractField, grid: Grid | VolumeLike | None = None) -> Floats:
    """A copy of points (..., dim) as float64, of landmarks in the unit of the field or of the volume that it deforms.

    Raises
    ------
    DeformError
        If they are not finite or not of the field's dimension.
    """
    given = (
        points.points
        if isinstance(points, Landmarks)
        else points.source
        if isinstance(points, ControlPoints)
        else points
    )
    x = real_array(given)
    if x is None:
        raise DeformError(f"points are numbers of shape (..., {field.dim}) or Landmarks, got {short_value(points)}.")
    if x.ndim < 1 or x.shape[-1] != field.dim:
        raise DeformError(f"points need {field.dim} coordinates for this field, got an array of shape {x.shape}.")
    flat = x.reshape(-1, field.dim)
    bad = np.flatnonzero(~np.isfinite(flat).all(axis=1))
    if len(bad):
        raise DeformError(f"point {bad[0]} is not finite ({flat[bad[0]].tolist()}); remove it or give its place.")
    return x * unit_factor(points, field, grid)


def default_tolerance(x: Floats, field: AbstractField) -> float:
    """1e-6 of the extent of points (N, dim), and of how far they go; never less than rounding."""
    d = [np.abs(field.displacement(x[k : k + POINTS_AT_A_TIME])) for k in range(0, len(x), POINTS_AT_A_TIME)]
    far = float(max(np.where(np.isfinite(part), part, 0.0).max() for part in d))
    return max(_POINT_TOLERANCE * max(float(np.ptp(x, axis=0).max()), far), _ROUNDING * (float(np.abs(x).max()) + far))


def deform_places(
    x: Floats,
    field: AbstractField,
    tolerance: float,
    max_iterations: int = 50,
    *,
    start: Floats | None = None,
    thorough: bool = True,
) -> tuple[Floats, NDArray[np.bool_]]:
    """Result of :func:`warp_points`, for a block of points (N, dim), at least one.

    Parameters
    ----------
    start : (N, dim), about where they go, if that is known; for a field without cuts.
    thorough : False leaves what the first starts do not reach.
    """
    if isinstance(field, Decoupled):
        return _move_with_regions(x, field, tolerance, max_iterations)
    if isinstance(field, ForwardFit):
        return field.target_places(x, tolerance)
    if start is None and len(field.steps) > 1:
        y, found = x, np.ones(len(x), dtype=bool)
        for step in field.steps:
            y, is_found = deform_places(y, step, tolerance, max_iterations)
            found &= is_found
        if field.has_cuts:  # a map that jumps has no derivative of the whole to continue with
            return y, found
        start = y
    if isinstance(field, Extrusion) and _is_exact(field):
        y, error = _solve_in_plane(x, field, tolerance, max_iterations, start)
    else:
        y, error = search(x, map_of(field), tolerance, max_iterations, start)
    left = np.flatnonzero(~(error <= tolerance))
    if len(left) and thorough:
        y[left], error[left] = _solve_from_seeds(x[left], y[left], error[left], field, tolerance, max_iterations)
    _bring_to_targets(y, error, x, field, tolerance)
    found = error <= tolerance
    return y, found & ~_inverted_mask(y, found, x, field)


def _bring_to_targets(y: Floats, error: Floats, x: Floats, field: AbstractField, tolerance: float) -> None:
    """Put points x (N, dim) that are where a map without steps takes a control point's target from at that target.

    Where the map folds there are several places that it takes to one source, and a landmark's own is its target.
    """
    if field.is_identity:  # no place but x; and scipy stays out of the start of a studio, where nothing is dragged
        return
    fits = field.fits if isinstance(field, LocalFits) else (field,)
    targets = [
        fit.origin + fit.support * np.asarray(fit.centers, dtype=np.float64)[: int(fit.count)]
        for fit in fits
        if isinstance(fit, RBFInterpolant) and int(fit.count)
    ]
    if not targets:
        return
    places = np.concatenate(targets)
    brought = places + field.displacement(places)
    gap, nearest = map(np.asarray, scipy.spatial.cKDTree(brought).query(x, distance_upper_bound=tolerance))
    at = np.flatnonzero(gap <= tolerance)
    y[at], error[at] = places[nearest[at]], gap[at]


def _inverted_mask(y: Floats, found: NDArray[np.bool_], x: Floats, field: AbstractField) -> NDArray[np.bool_]:
    """Mask of the places y found for points x (N, dim) where the map is inverted, as its middle sheet is in a fold.

    A place is inverted where det J has the other sign than far around the points: a map may mirror as a whole.
    """
    is_over = np.zeros(len(x), dtype=bool)
    if found.any():
        centre, half = (x.max(axis=0) + x.min(axis=0)) / 2, np.ptp(x, axis=0).max() + np.abs(y - x)[found].max()
        signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * x.shape[1]), axis=-1).reshape(-1, x.shape[1])
        around = _determinants(centre + 4 * half * signs, field)
        is_over[found] = _determinants(y[found], field) * np.sign(np.median(np.sign(around))) < 0
    return is_over


def _determinants(places: Floats, field: AbstractField) -> Floats:
    return np.asarray(determinant(one_plus(np.moveaxis(field.jacobian(places), 0, -1))))


def _move_with_regions(
    x: Floats, field: Decoupled, tolerance: float, max_iterations: int
) -> tuple[Floats, NDArray[np.bool_]]:
    """Tissue moves with its region; by the paper's rule none is visible across a cut."""
    y, found = x.copy(), np.ones(len(x), dtype=bool)
    for mask, own in field.fields_by_source(x):
        if own is not None and mask.any():
            y[mask], found[mask] = deform_places(x[mask], own, tolerance, max_iterations)
    if field.rule == "paper":
        found &= field.region_numbers(y) == field.region_numbers(x)
    return y, found


# ---- the search ------------------------------------------------------------------------------------------------------


def _is_exact(field: Extrusion) -> bool:
    """Check whether the plane's frame is orthonormal to rounding, so that lengths on the plane are those in space."""
    frame = field.plane.frame
    return bool(np.abs(frame @ frame.T - np.eye(3)).max() < 1e-12)


def _solve_in_plane(
    x: Floats, field: Extrusion, tolerance: float, max_iterations: int, start: Floats | None
) -> tuple[Floats, Floats]:
    """Nothing leaves its depth: two unknowns instead of three, and weights that are known from the start."""
    plane = field.plane
    abc = plane.to_plane(x)
    ab, weights = abc[:, :2], field.weights_at(abc[:, 2])
    first = None if start is None else plane.to_plane(start)[:, :2]
    if field.is_plain:
        only = field.maps[0]
        y, _ = deform_places(ab, only, tolerance, max_iterations, start=first, thorough=False)
        error = lengths_of(y + only.displacement(y) - ab)
    else:
        parts = list(zip(field.maps, weights, strict=True))
        total = BackwardMap(
            lambda y, k: _sum(w[k, None] * m.displacement(y) for m, w in parts),
            lambda y, k: _sum(w[k, None, None] * m.jacobian(y) for m, w in parts),
        )
        y, error = search(ab, total, tolerance, max_iterations, first)
    return x + (y - ab) @ plane.frame[:2], error


def _sum(parts: Any) -> Floats:
    return np.asarray(sum(parts))


def _solve_from_seeds(
    x: Floats, y: Floats, error: Floats, field: AbstractField, tolerance: float, max_iterations: int
) -> tuple[Floats, Floats]:
    """The same for points that the usual starts do not reach: from the nodes of a lattice that are brought nearest."""
    d = field.displacement(x)
    reach = float(np.abs(np.where(np.isfinite(d), d, 0.0)).max()) + 0.1 * float(np.ptp(x, axis=0).max()) + tolerance
    lines = [
        np.linspace(a - reach, b + reach, _SEEDS[field.dim]) for a, b in zip(x.min(axis=0), x.max(axis=0), strict=True)
    ]
    nodes = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, field.dim)
    brought = nodes + field.displacement(nodes)
    finite = np.isfinite(brought).all(axis=1)
    if not finite.any():
        return y, error
    nodes, tree = nodes[finite], scipy.spatial.cKDTree(brought[finite])
    nearest = tree.query(x, min(_NODES_TRIED, len(nodes)))[1].reshape(len(x), -1)
    y, error, at = y.copy(), error.copy(), map_of(field)
    for column in nearest.T:
        left = np.flatnonzero(~(error <= tolerance))
        if not len(left):
            break
        keep_better(y, error, left, *newton(nodes[column[left]], x[left], left, at, tolerance, max_iterations))
    return y, error


@dataclass(frozen=True, eq=False)
class Landmarks(AbstractNamedPoints[NDArray[np.float64]], AbstractCellOutput):
    """Places in space, or on a picture, with names.

    ``landmarks["head"]`` and ``landmarks[0]`` are one place by its name or position, ``landmarks[1:]`` and
    ``landmarks[mask]`` several landmarks, and ``np.asarray(landmarks)`` all places.

    Parameters
    ----------
    points : (N, 3) physical, LPS; or (N, 2).
    names : N texts; default none.
    fixed : the places that the points correspond to in another volume, as in BigWarp's files; NaN where there is none.
    active : (N,) bool, False for a landmark that is switched off.
    notes : remarks for a status line.
    unit : of the places, a symbol or a name of :data:`~deformnb.volume.units.UNITS`; "" where it is not known.
    found : (N,) bool of landmarks that were warped, False for those that have no place in the result; None of others.

    Examples
    --------
    >>> marks = Landmarks([[0, 0, 0], [10, 0, 0]], ("tail", "head"), fixed=[[0, 0, 0], [12, 1, 0]])
    >>> marks.control_points().displacement.tolist()
    [[0.0, 0.0, 0.0], [-2.0, -1.0, 0.0]]
    """

    points: NDArray[np.float64]
    names: tuple[str, ...] = ()
    fixed: NDArray[np.float64] | None = None
    active: NDArray[np.bool_] | None = None
    notes: tuple[str, ...] = ()
    unit: str = ""
    found: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        check_fields(self, "notes")
        object.__setattr__(self, "unit", check_unit(self.unit))
        points = _places(self.points, "landmarks")
        bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
        if len(bad):
            raise DeformError(f"landmark {bad[0] + 1} is not finite ({points[bad[0]].tolist()}); correct it.")
        fixed = None if self.fixed is None else _places(self.fixed, "fixed places of landmarks")
        if isinstance(self.names, str) or not isinstance(self.names, Iterable):
            raise DeformError(f"the names of landmarks are a list of texts, got {short_value(self.names)}.")
        names = tuple(map(str, self.names)) or ("",) * len(points)
        check_fields(self, "active", "found")
        active = np.ones(len(points), dtype=bool) if self.active is None else np.array(self.active, dtype=bool)
        if (
            len(names) != len(points)
            or active.shape != (len(points),)
            or (fixed is not None and fixed.shape != points.shape)
            or (self.found is not None and self.found.shape != (len(points),))
        ):
            raise DeformError(f"{len(points)} landmarks need as many names, switches and fixed places.")
        for name, value in (("points", points), ("names", names), ("fixed", fixed), ("active", active)):
            if isinstance(value, np.ndarray):
                value.flags.writeable = False
            object.__setattr__(self, name, value)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Landmarks):
            return NotImplemented
        same = (self.names, self.notes, self.unit) == (other.names, other.notes, other.unit)
        arrays = ((getattr(one, name) for one in (self, other)) for name in ("points", "fixed", "active", "found"))
        return same and all(is_same_array(*pair) for pair in arrays)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        named = [name[:20] for name in self.names if name]
        names = ", ".join(map(repr, named[:NAMES_SHOWN])) + (", ..." if len(named) > NAMES_SHOWN else "")
        pairs = "" if self.fixed is None else ", paired with fixed places"
        unit = self.unit and f", in {self.unit}"
        return (
            f"<Landmarks: {len(self)} {'in space' if self.points.shape[1] == 3 else 'on a picture'}{pairs}{unit}"
            f"{': ' if names else ''}{names}>"
        )

    def __len__(self) -> int:
        return len(self.points)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """The places (N, 2) or (N, 3), for ``np.asarray``."""
        return np.array(self.points, dtype=dtype, copy=copy)

    def point_at(self, position: int) -> NDArray[np.float64]:
        """The place at a position from 0 on: (a, b) or (x, y, z)."""
        return np.asarray(self.points[position])

    def take(self, positions: Iterable[int]) -> Landmarks:
        """The landmarks at these positions, in this order."""
        chosen = list(positions)
        parts: dict[str, Any] = {"points": self.points[chosen], "names": tuple(self.names[k] for k in chosen)}
        for name in ("fixed", "active", "found"):
            array = getattr(self, name)
            parts[name] = None if array is None else array[chosen]
        return replace(self, **parts)

    def to_pandas(self) -> Any:
        """A ``pandas.DataFrame`` with a row for each landmark, and the unit in its ``attrs``.

        Its columns are name, x, y and z (or a and b on a picture), fixed_x and so on of pairs, and active.

        Examples
        --------
        >>> Landmarks([[0, 0, 0], [10, 0, 0]], ("tail", "head")).to_pandas()["x"].tolist()
        [0.0, 10.0]
        """
        columns: dict[str, Any] = {"name": list(self.names)}
        for prefix, array in (("", self.points), ("fixed_", self.fixed)):
            if array is not None:
                columns |= {
                    prefix + axis: array[:, k].copy() for k, axis in enumerate(AXIS_NAMES[self.points.shape[1]])
                }
        table = optional_package("pandas").DataFrame(columns | {"active": self.active})
        table.attrs["unit"] = self.unit
        return table

    @classmethod
    def from_pandas(cls, table: Any) -> Landmarks:
        """Landmarks of a ``pandas.DataFrame`` with the columns of :meth:`to_pandas`, of which x, y and z must be there.

        Raises
        ------
        DeformError
            If it is no table, or a coordinate is missing.

        Examples
        --------
        >>> import pandas as pd
        >>> Landmarks.from_pandas(pd.DataFrame({"name": ["tip"], "x": [1], "y": [2], "z": [3]}))["tip"].tolist()
        [1.0, 2.0, 3.0]
        """
        table = check_table(table, "landmarks")
        points = read_columns(table, "", "landmarks")
        if points is None:
            raise DeformError(
                "the table of landmarks has no columns x, y and z (or a and b on a picture); it has "
                f"{', '.join(map(str, table.columns))[:200]}."
            )
        return cls(
            points,
            tuple(names_of(table) or ()),
            fixed=read_columns(table, "fixed_", "landmarks"),
            active=table["active"].to_numpy(dtype=bool) if "active" in table else None,
            unit=table.attrs.get("unit", ""),
        )

    def to_unit(self, unit: str) -> Landmarks:
        """The same places in numbers of another unit; where their own or the other one is not known, themselves.

        Examples
        --------
        >>> Landmarks([[1, 2, 3]], unit="mm").to_unit("µm").points.tolist()
        [[1000.0, 2000.0, 3000.0]]
        """
        to = check_unit(unit)
        if to in ("", self.unit) or not self.unit:
            return self
        factor = ratio(self.unit, to)
        fixed = None if self.fixed is None else self.fixed * factor
        return replace(self, points=self.points * factor, fixed=fixed, unit=to)

    def control_points(self) -> ControlPoints:
        """Pairs as control points: each place is dragged to its fixed one. What has none is left out."""
        if self.fixed is None:
            raise DeformError("these landmarks are single places, not pairs; control points need where each should go.")
        whole = np.flatnonzero(np.isfinite(self.fixed).all(axis=1))
        assert self.active is not None
        return ControlPoints.from_arrays(
            self.points[whole],
            self.fixed[whole],
            active=self.active[whole],
            unit=self.unit,
            names=[self.names[k] for k in whole],
        )


LandmarksLike: TypeAlias = Landmarks | ControlPoints | ArrayLike
"""Objects that :func:`as_landmarks` takes where landmarks are required."""


def as_landmarks(given: LandmarksLike) -> Landmarks:
    """Landmarks: themselves; control points, of which each is a pair of source and target; an array (N, 3) or (N, 2).

    Raises
    ------
    DeformError
        For anything else.

    Examples
    --------
    >>> as_landmarks(ControlPoints.from_arrays([[1, 2]], [[3, 4]], names=["tip"])).fixed.tolist()
    [[3.0, 4.0]]
    """
    if isinstance(given, Landmarks):
        return given
    if isinstance(given, ControlPoints):
        return Landmarks(given.source, given.names, fixed=given.target, active=given.active)
    array = real_array(given)
    if array is None or array.ndim != 2:
        raise DeformError(
            f"Landmarks are needed, got {short_value(given)}; Landmarks(points, names), ControlPoints "
            "and arrays of shape (N, 3) are some."
        )
    return Landmarks(array)


def _places(given: Any, what: str) -> NDArray[np.float64]:
    real = real_array(given)
    array = np.zeros(()) if real is None else np.array(real)
    if real is None:
        raise DeformError(f"{what} must be numbers of shape (N, 3) or (N, 2).")
    if array.size == 0:
        array = array.reshape(0, array.shape[-1] if array.shape[-1:] in ((2,), (3,)) else 3)
    if array.ndim != 2 or array.shape[1] not in (2, 3):
        raise DeformError(f"{what} must have shape (N, 3) or (N, 2), got {array.shape}.")
    return array


def warp_landmarks(
    landmarks: LandmarksLike, field: AbstractField | HasField, grid: Grid | VolumeLike | None = None
) -> Landmarks:
    """The landmarks in the deformed volume; those without a place in it stay where they were.

    A note names them, and ``found`` of the result is False for them.

    Parameters
    ----------
    landmarks : in the space of the volume that the field deforms; their fixed places are in another space and stay.
    field : backward displacements, of the landmarks' dimension; or a Deformation.
    grid : of the volume that is deformed; needed for a Deformation.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> warp_landmarks(Landmarks([[1, 2, 3]]), Identity()).points.tolist()
    [[1.0, 2.0, 3.0]]
    """
    landmarks = as_landmarks(landmarks)
    moved, found = warp_points(landmarks, field, grid=grid)
    notes, there = landmarks.notes, "" if grid is None else as_grid(grid).unit
    if landmarks.unit and there not in ("", landmarks.unit):
        notes += (f"the landmarks are in {landmarks.unit} and the volume in {there}: their lengths were converted",)
    if not found.all():
        lost = [landmarks.names[k] or str(k) for k in np.flatnonzero(~found)]
        more = f" and {len(lost) - 5} more" if len(lost) > 5 else ""
        notes += (f"these landmarks have no place in the result and stay where they were: {', '.join(lost[:5])}{more}",)
    return replace(landmarks, points=np.where(found[:, None], moved, landmarks.points), notes=notes, found=found)

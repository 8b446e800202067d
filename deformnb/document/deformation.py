"""Deformation document: all edits of a volume, immutable, independent of any volume's voxels.

A :class:`Deformation` is a list of :class:`Step`, done one after the other (section 4.3 of the paper: deform on one
plane, turn the volume, deform on another). An edit makes a new document, so undo is the list of old ones, and the same
document can be applied to another volume. :mod:`deformnb.document.json_format` turns it into JSON and back.

It also holds the easing of an animation: the course of time between two key frames, and after the last one.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field, fields, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, TypeAlias, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._entrances import AbstractCellOutput
from deformnb.checks import check_arguments, check_fields, is_finite, real_array, short_value
from deformnb.document.space_maps import Scale, rescaled_step
from deformnb.errors import DeformError
from deformnb.rbf.cuts import CUT_RULES, MOST_CUTS, Cut, CutRuleName, Decoupled, Sides, cuts_outside
from deformnb.rbf.extrusion import EXTRUSIONS, ExtrusionName, Weights, extrude
from deformnb.rbf.fields import AbstractField, AbstractFit, Identity, blend, compose
from deformnb.rbf.fit_settings import AbstractFitSettings, FitSettings, label_of
from deformnb.rbf.fitting import check_parts_of_direction, check_stages
from deformnb.rbf.interpolant import FOLDS_WARNING
from deformnb.rbf.kernels import as_kernel
from deformnb.rbf.named_points import AbstractNamedItems
from deformnb.rbf.points import ControlPoints, as_control_points
from deformnb.rbf.regions import AbstractRegion
from deformnb.rbf.rigid import RigidPart, part_conflicts
from deformnb.rbf.slits import check_slits
from deformnb.rbf.support import lone_support
from deformnb.volume.channels import Channels
from deformnb.volume.known_spacings import KnownSpacing, older_document
from deformnb.volume.plane import Plane
from deformnb.volume.units import check_unit, ratio
from deformnb.volume.views import ViewName
from deformnb.volume.volume import (
    Grid,
    Matrix3,
    Volume,
    VolumeLike,
    as_finest_grid,
    as_output,
    as_volume,
    as_volumes,
    voxel_checksum,
)
from deformnb.warping.inverse import Inverse, invert
from deformnb.warping.map_checks import add_cautions, map_notes
from deformnb.warping.mesh import Mesh, warp_mesh
from deformnb.warping.points import Landmarks, warp_landmarks, warp_points
from deformnb.warping.warper import volumes_of, warp_all

EasingName: TypeAlias = Literal["linear", "smooth"]
"""Names of the easings of time."""

EASINGS: dict[str, Callable[[float], float]] = {"linear": lambda t: t, "smooth": lambda t: t * t * (3 - 2 * t)}
"""Easings of time from one key frame to the next, by name: at an even pace, or slowly at both ends."""

LoopName: TypeAlias = Literal["once", "loop", "swing"]
"""Names of the behaviours after the last key frame."""

LOOPS = {
    "once": "from the first key frame to the last",
    "loop": "over and over from the beginning",
    "swing": "there and back, over and over",
}
"""Behaviours after the last key frame."""


MOST_STEPS = 500
"""Steps of a deformation: composed fields call one another, and Python allows a depth of 1000 calls."""


@dataclass(frozen=True)
class Step(AbstractFitSettings):
    """One deformation: control points on a plane with a rule of extrusion, or control points in space.

    Parameters
    ----------
    maps : one set of control points; several for the rule "interpolate".
    plane : of the points; None for points in space (dimension 3, Eq. 9).
    extrusion : a name of :data:`~deformnb.rbf.extrusion.EXTRUSIONS`.
    curve : f(z) of the rule "modulate": a formula, or values at equal steps.
    knots : depths in [0, 1] of the maps of the rule "interpolate".
    enabled : a step that is switched off stays in the list.
    name : shown to people.
    extra : fields of a newer minor version, stored for saving.
    parts : what stays rigid (Eq. 6), in the picture's coordinates, or in space for points in space.
    cuts : along which tissue comes apart (Eq. 7), in the same coordinates.
    cut_rule : the picture next to a cut, a name of :data:`~deformnb.rbf.cuts.CUT_RULES`.
    settings : (of the fit, by their names) the fields of :class:`~deformnb.rbf.fit_settings.AbstractFitSettings`. In
        several ``stages`` on a plane the composed map is extruded, so that a depth with f(z) between 0 and 1 may
        still fold. ``chosen_support``, None for points at one place, stays while points are dragged, so that the map
        does not jump, and in documents; :meth:`with_points` finds it again when points are added, removed or switched,
        and so does a step with another kernel.

    Raises
    ------
    DeformError
        If the parts do not fit together.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> points = ControlPoints.from_arrays([[5, 5], [20, 5]], [[5, 5], [26, 5]])
    >>> step = Step((points,), Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), trend="rigid")
    >>> step.trend, len(step.points)
    ('rigid', 2)
    """

    maps: tuple[ControlPoints, ...] = field(kw_only=False, metadata={"label": "points"})
    plane: Plane | None = None
    _: KW_ONLY
    extrusion: ExtrusionName = "replicate"
    curve: str | tuple[float, ...] = "z"
    knots: tuple[float, ...] = field(default=(), metadata={"label": "keys"})
    enabled: bool = field(default=True, metadata={"label": "switch"})
    name: str = ""
    extra: Mapping[str, Any] = field(default_factory=dict)
    parts: tuple[RigidPart, ...] = field(default=(), metadata={"label": "rigid parts"})
    cuts: tuple[Cut, ...] = ()
    cut_rule: CutRuleName = "source"

    def __post_init__(self) -> None:
        for name in ("maps", "knots", "curve", "parts", "cuts"):  # lists too, so that a document equals its file
            if name != "curve" or not isinstance(self.curve, str):
                object.__setattr__(self, name, _as_tuple(getattr(self, name), name))
        self._check_kinds()
        unit = next((given.unit for given in self.maps if given.unit), "")
        object.__setattr__(self, "maps", tuple(given.to_unit(unit) for given in self.maps))
        check_fields(self, "extrusion", "curve", "knots", "enabled", "name", "extra", "cut_rule")
        if not isinstance(self.extrusion, str) or self.extrusion not in EXTRUSIONS:
            known = ", ".join(EXTRUSIONS)
            raise DeformError(f"unknown extrusion {short_value(self.extrusion)}; choose one of {known}.")
        super().__post_init__()
        dim = 3 if self.plane is None else 2
        needed = len(self.knots) if self.extrusion == "interpolate" else 1
        if len(self.maps) != needed:
            raise DeformError(f"the rule {self.extrusion!r} needs {needed} set(s) of points, got {len(self.maps)}.")
        if any(m.dim != dim for m in self.maps):
            raise DeformError(
                "control points on a plane have two coordinates, control points in space have three and no plane; "
                f"these have {self.maps[0].dim} and {'no' if dim == 3 else 'a'} plane."
            )
        if dim == 3 and self.extrusion != "replicate":
            raise DeformError("control points in space are not extruded; leave the rule at 'replicate'.")
        self._check_shapes(dim)
        self.weights()  # checks the curve and the knots
        if self.extrusion != "modulate" and self.curve != "z":
            EXTRUSIONS["modulate"](self.curve)  # checked for when the rule changes
        if self.chosen_support is None:
            chosen = FitSettings.of(self).with_chosen_support(self.maps).chosen_support
            object.__setattr__(self, "chosen_support", chosen)

    def _check_kinds(self) -> None:
        for given in self.maps:
            if not isinstance(given, ControlPoints):
                raise DeformError(
                    f"the maps of a step are ControlPoints, got {_kind(given)}; "
                    "make some with ControlPoints.from_arrays(sources, targets)."
                )
        if not isinstance(self.plane, Plane | None):
            raise DeformError(
                f"the plane of a step is a Plane or None, got {_kind(self.plane)}; "
                'Plane.from_view(volume, "+y") makes one.'
            )

    def _check_shapes(self, dim: int) -> None:
        if self.cut_rule not in CUT_RULES:
            raise DeformError(f"unknown rule {self.cut_rule!r} of cuts; choose one of {', '.join(CUT_RULES)}.")
        for kind, what, given in ((RigidPart, "parts", self.parts), (Cut, "cuts", self.cuts)):
            for shape in given:
                if not isinstance(shape, kind):
                    raise DeformError(f"the {what} of a step must be of type {kind.__name__}, got {shape!r:.60}.")
                if shape.region.dim != dim:
                    way = "take the silhouette(plane) of a mask" if dim == 2 else "give it three coordinates"
                    raise DeformError(
                        f"the {what} of this step need regions of dimension {dim}, as its points have; "
                        f"one has {shape.region.dim}: {way}."
                    )
        check_stages(self.stages, self.parts)
        check_parts_of_direction(self.direction, self.parts)
        if len(self.cuts) > MOST_CUTS:
            raise DeformError(f"a step has at most {MOST_CUTS} cuts, got {len(self.cuts)}.")
        check_slits(self.cut_regions, self.cut_rule)

    def __repr__(self) -> str:
        name = f" {self.name[:60]!r}" if self.name else ""
        count = len(self.points)
        where = "in space" if self.plane is None else "in the plane"
        kinds = [f"{count} {'point' if count == 1 else 'points'} {where}"]
        kinds += [f"{len(given)} {what}" for given, what in ((self.parts, "rigid"), (self.cuts, "cut")) if given]
        rule, off = "" if self.plane is None else f", {self.extrusion}", "" if self.enabled else ", switched off"
        return f"<Step{name}: {', '.join(kinds)}, {self.kernel}, trend {self.trend}{rule}{off}>"

    @cached_property
    def settings(self) -> FitSettings:
        """The settings of the fit alone."""
        return FitSettings.of(self)

    @property
    def points(self) -> ControlPoints:
        """The (first) set of control points."""
        return self.maps[0]

    @check_arguments
    def with_points(self, points: ControlPoints, key: int = 0) -> Step:
        """The same step with another set of control points (the key-th, for the rule "interpolate")."""
        if not 0 <= key < len(self.maps):
            raise DeformError(f"there is no set of control points {key}; there are {len(self.maps)}.")
        maps, settings = (*self.maps[:key], points, *self.maps[key + 1 :]), self.settings
        if not points.has_same_sources(self.maps[key]):
            settings = settings.with_chosen_support(maps, self.chosen_support and self.chosen_support.radius)
        return replace(self, maps=maps, chosen_support=settings.chosen_support)

    def weights(self) -> Weights:
        """Knots and weights of the extrusion rule."""
        arguments = {"replicate": (), "modulate": (self.curve,), "interpolate": (self.knots,)}
        return EXTRUSIONS[self.extrusion](*arguments.get(self.extrusion, ()))

    @check_arguments
    def fits(self, grid: Grid) -> tuple[AbstractFit, ...]:
        """The solved interpolants: one for each set of control points, and for each region of it between cuts."""
        return tuple(fit for fits in self.fits_of_regions(grid) for fit in fits.values())

    @check_arguments
    def fits_of_regions(self, grid: Grid) -> tuple[Mapping[Sides, AbstractFit], ...]:
        """For each set of control points the fits of the regions that have some; without cuts there is one region.

        They are solved once for a grid, and cached until another is requested: a step never changes.
        """
        known: tuple[Grid, tuple[Mapping[Sides, AbstractFit], ...]] | None = self.__dict__.get("_solved")
        if known is None or known[0] != grid:
            settings, lone = self.settings, lone_support(grid)
            fits = tuple(settings.fits(points, self.parts, self.cut_regions, lone=lone) for points in self.maps)
            known = (grid, fits)
            self.__dict__["_solved"] = known  # in one assignment, for threads
        return known[1]

    @check_arguments
    def cautions(self, grid: Grid) -> tuple[str, ...]:
        """Sentences on probable mistakes of a step on a volume's grid: a support radius below a voxel, cuts
        that cross nothing, and rigid parts that contradict each other.
        """
        corners = grid.corners(centres=False)
        corners = corners if self.plane is None else self.plane.to_plane(corners)[:, :2]
        parts = [part.scaled(self.strength) for part in self.parts]
        return (
            *self._narrow_supports(grid),
            *part_conflicts(parts),
            *cuts_outside(self.cuts, corners.min(axis=0), corners.max(axis=0)),
        )

    def _narrow_supports(self, grid: Grid) -> tuple[str, ...]:
        if not as_kernel(self.kernel).compact:
            return ()
        across = [
            k
            for k, axis in enumerate(np.asarray(grid.direction).T)
            if self.plane is None or abs(axis @ self.plane.frame[2]) < 1 - 1e-6
        ]
        voxel = min(grid.spacing[k] for k in across)
        radii = [self.support_for(points) or lone_support(grid) for points in self.maps]
        radii += [float(r) for points in self.maps for r in points.radius[points.active] if np.isfinite(r)]
        if min(radii) >= voxel:
            return ()
        note = (
            f"the support radius {min(radii):.3g} is smaller than a voxel ({voxel:.3g}): between the control "
            "points nothing follows them. Choose a larger one."
        )
        return (note,)

    @property
    def cut_regions(self) -> tuple[AbstractRegion, ...]:
        """The regions of the cuts that are switched on."""
        return tuple(cut.region for cut in self.cuts if cut.enabled)

    @check_arguments
    def field(self, grid: Grid) -> AbstractField:
        """The backward displacement in space of this step on a volume's grid."""
        if self.points.unit not in ("", grid.unit):
            return rescaled_step(self, grid.unit).field(grid)
        regions, found = self.cut_regions, self.fits_of_regions(grid)
        sides = sorted({side for fits in found for side in fits})
        nothing = Identity(2 if self.plane else 3)
        maps = [[fits.get(side, nothing) for fits in found] for side in sides]
        fields = [m[0] if self.plane is None else extrude(self.plane, grid, m, self.weights()) for m in maps]
        if not regions:
            return fields[0]
        return Decoupled(tuple(fields), tuple(sides), regions, self.plane, self.cut_rule, _pixel(grid, self.plane))


STEP_LABELS = {given.name: label_of(given) for given in fields(Step)}
"""Names of the fields of a step in plain English."""


def _pixel(grid: Grid, plane: Plane | None) -> float:
    """The size of a voxel as it is seen on a plane, or in space: over which a cut is softened."""
    spacing = np.asarray(grid.spacing)
    if plane is None:
        return float(spacing.mean())
    along = np.abs(plane.frame[:2] @ np.asarray(grid.direction)) ** 2  # [u v, axis x y z], rows add up to 1
    return float((along @ spacing).mean())


def _kind(given: Any) -> str:
    """The kind of an object, for messages."""
    kind = type(given).__name__
    return f"{kind} {short_value(given)}" if isinstance(given, str | int | float) else kind


def _check_steps(given: Any, whose: str) -> tuple[Step, ...]:
    """Steps as a tuple, or what to give instead."""
    if isinstance(given, Step):
        raise DeformError(f"the steps of {whose} are a list; write [step], or (step,) with its comma.")
    try:
        steps = tuple(given)
    except TypeError:
        raise DeformError(f"the steps of {whose} are a list of Step, got {_kind(given)}.") from None
    if all(isinstance(step, Step) for step in steps):
        return steps
    wrong = next(step for step in steps if not isinstance(step, Step))
    way = "Deformation.from_picture_points and Deformation.from_space_points make one of points"
    if isinstance(wrong, Deformation):
        way = "first.then(second) joins two deformations"
    elif isinstance(wrong, AbstractField):
        way = (
            "a document has control points and no fields; warp(volume, field) applies one, and "
            "compose(first, second, grid=volume) joins it with a deformation"
        )
    raise DeformError(f"the steps of {whose} are of type Step, got {_kind(wrong)}; {way}.")


_LISTS = {"maps": "sets of control points", "parts": "rigid parts", "cuts": "cuts"}


def _as_tuple(value: Any, name: str) -> tuple[Any, ...]:
    try:
        if isinstance(value, str | bytes | ControlPoints):
            raise TypeError
        return tuple(value) if name in _LISTS else tuple(float(v) for v in value)
    except (TypeError, ValueError, OverflowError):
        what = _LISTS.get(name, "numbers" if name == "knots" else "numbers or a formula")
        raise DeformError(f"the {name} of a step must be {what}, got {short_value(value)}.") from None


_OTHER_SIZE = 3.0  # between the diagonals of two volumes: of two scans of one kind of body they differ less


def _size_difference(made: VolumeReference, here: Grid) -> str:
    """A sentence on two volumes of very different sizes, to follow another; empty where they are similar."""
    was = np.multiply(made.shape[::-1], made.spacing)
    factor = here.diagonal / float(np.linalg.norm(was))
    if 1 / _OTHER_SIZE <= factor <= _OTHER_SIZE:
        return ""
    then, now = (" x ".join(f"{length:.3g}" for length in lengths) for lengths in (was, here.lengths))
    times = f"{factor:.3g} times larger" if factor > 1 else f"{1 / factor:.3g} times smaller"
    unit = here.unit and f" {here.unit}"
    return (
        f" Its volume measures {then}{unit}, this one {now}{unit}: it is {times}, and the points lie in another part "
        'of it. The alignment "box" (deformnb replay --align box, deformnb.document.transplant) scales them to it.'
    )


@dataclass(frozen=True)
class VolumeReference:
    """Reference to the volume of a document: enough to find it again and to notice that it changed.

    Parameters
    ----------
    name : of the volume; never a path.
    shape, spacing : of its grid.
    sha256 : of type, shape and voxels.
    origin, direction : of its grid; None in documents of before 1.2.
    unit : of its grid; "" where it is not known, as in documents of before 2.2.

    Examples
    --------
    >>> VolumeReference("scan", (4, 5, 6), (1.0, 1.0, 2.0), "0" * 64).shape
    (4, 5, 6)
    """

    name: str
    shape: tuple[int, int, int]
    spacing: tuple[float, float, float]
    sha256: str
    origin: tuple[float, float, float] | None = None
    direction: Matrix3 | None = None
    unit: str = ""

    def __post_init__(self) -> None:
        check_fields(self)
        identity = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
        whole = Grid(self.shape, self.spacing, self.origin or (0, 0, 0), self.direction or identity)
        for name in ("shape", "spacing", "origin", "direction"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, getattr(whole, name))

    @classmethod
    def of(cls, volume: VolumeLike) -> VolumeReference:
        """The reference of a volume; of a level of a pyramid that of the pyramid, whichever level it is."""
        volume = as_volume(volume)
        grid = volume.finest_grid
        checksum = (
            voxel_checksum(volume.dtype, volume.shape, volume.values)
            if volume.level is None
            else volume.level.checksum()
        )
        return cls(volume.name, grid.shape, grid.spacing, checksum, grid.origin, grid.direction, grid.unit)

    @property
    def grid(self) -> Grid | None:
        """Grid of the volume; None if that is not known."""
        if self.origin is None or self.direction is None:
            return None
        return Grid(self.shape, self.spacing, self.origin, self.direction, self.unit)

    def to_unit(self, unit: str) -> VolumeReference:
        """The same volume in numbers of another unit; one without a unit is taken to be in that one."""
        if unit in ("", self.unit):
            return self
        grid = Grid(self.shape, self.spacing, self.origin or (0.0, 0.0, 0.0), unit=self.unit or unit).to_unit(unit)
        return replace(self, spacing=grid.spacing, origin=self.origin and grid.origin, unit=unit)

    def matches(self, volume: VolumeLike) -> bool:
        """True if the voxels are the same; the name does not count."""
        volume = as_volume(volume)
        return self.shape == volume.finest_grid.shape and self.sha256 == VolumeReference.of(volume).sha256

    def has_labels(self, volume: VolumeLike) -> bool:
        """True for labels as large as the volume: they have other voxels and may well belong to it."""
        volume = as_volume(volume)
        return volume.is_labels and self.shape == volume.finest_grid.shape


class LazyReference:
    """The reference of a volume, cached by the first call; the cache does not keep the volume alive."""

    def __init__(self, volume: Volume) -> None:
        self._volume: Volume | None = volume
        self._made: VolumeReference | None = None
        self._making = threading.Lock()

    def __call__(self) -> VolumeReference:
        with self._making:
            if self._made is None:
                assert self._volume is not None
                self._made, self._volume = VolumeReference.of(self._volume), None
            return self._made


@dataclass(frozen=True)
class Keyframe:
    """The steps of a document at one moment of an animation; see :mod:`deformnb.document.animation`.

    Parameters
    ----------
    time : seconds from the beginning.
    steps : as they are then.

    Examples
    --------
    >>> from deformnb.rbf.points import ControlPoints
    >>> step = Step((ControlPoints.from_arrays([[0, 0, 0]], [[4, 0, 0]]),))
    >>> Keyframe(0.5, (step,)).time
    0.5
    """

    time: float
    steps: tuple[Step, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "steps", _check_steps(self.steps, "a key frame"))
        if not (is_finite(self.time) and self.time >= 0):
            raise DeformError(f"the time of a key frame must be seconds from 0 on, got {short_value(self.time)}.")
        check_fields(self)


ModeName: TypeAlias = Literal["compose", "blend"]
"""Names of the ways in which steps add up."""

MODES: dict[str, Callable[..., AbstractField]] = {"compose": compose, "blend": blend}
"""Compositions of several steps into one displacement: one after the other, exactly, or as the sum of all."""


@dataclass(frozen=True)
class Deformation(AbstractNamedItems, AbstractCellOutput):
    """An immutable list of steps, applied first to last; called with a volume or with points it deforms them.

    ``deformation["bend"]`` and ``deformation[0]`` are a step by its name or position, and ``len`` is their number.

    Parameters
    ----------
    steps : the steps in the order in which they are done.
    name : shown to people.
    volume : the volume it was made on, if known.
    extra : fields of a newer minor version, stored for saving.
    mode : a name of :data:`MODES`.
    keyframes : of an animation, their times rising.
    easing, loop : names of :data:`EASINGS` and :data:`LOOPS`.
    output : the grid of the result, its field of view and resolution, wherever it is applied; None is the volume's own.
    unit : of all lengths; by default that of its volume or of its points. Where it is not known, "", the numbers are
        those of the volume that the document is applied to; else the document is converted to the unit of that volume.

    Examples
    --------
    >>> from deformnb.volume.volume import Grid, Matrix3, Volume
    >>> volume = Volume(np.zeros((4, 8, 8), np.uint8), Grid((4, 8, 8)))
    >>> points = ControlPoints.from_arrays([[1, 1], [6, 1], [3, 6]], [[1, 1], [6, 1], [3, 7]])
    >>> deformation = Deformation.from_picture_points(volume, "+z", points)
    >>> deformation.apply(volume).shape
    (4, 8, 8)
    """

    steps: tuple[Step, ...] = ()
    name: str = ""
    volume: VolumeReference | None = None
    extra: Mapping[str, Any] = field(default_factory=dict)
    mode: ModeName = "compose"
    keyframes: tuple[Keyframe, ...] = ()
    easing: EasingName = "linear"
    loop: LoopName = "once"
    output: Grid | None = None
    unit: str = ""

    def __len__(self) -> int:
        return len(self.steps)

    def __bool__(self) -> bool:
        return True  # also without steps, as the identity

    def __iter__(self) -> Iterator[Step]:
        return iter(self.steps)

    def __getitem__(self, key: int | str) -> Step:
        """A step, by its position or by its name.

        Raises
        ------
        DeformError
            If there is none, or several have that name.

        Examples
        --------
        >>> points = (ControlPoints.from_arrays([[1, 1, 1]], [[1, 1, 2]]),)
        >>> Deformation((Step(points, name="bend"), Step(points, name="twist")))["twist"].name
        'twist'
        """
        if isinstance(key, str):
            named = [step for step in self.steps if step.name == key]
            if len(named) == 1:
                return named[0]
            names = ", ".join(repr(step.name) for step in self.steps[:8])
            raise DeformError(f"{len(named)} of the steps are named {short_value(key)}; they are {names or 'none'}.")
        is_number = isinstance(key, int | np.integer) and not isinstance(key, bool)
        if not is_number or not -len(self.steps) <= key < len(self.steps):
            raise DeformError(
                f"a step is taken by its position, counted from 0, or by its name, and this deformation has "
                f"{len(self.steps)}; got {short_value(key)}."
            )
        return self.steps[key]

    def __post_init__(self) -> None:
        object.__setattr__(self, "steps", _check_steps(self.steps, "a deformation"))
        keys = tuple(self.keyframes) if isinstance(self.keyframes, Iterable) else (self.keyframes,)
        for key in keys:
            if not isinstance(key, Keyframe):
                raise DeformError(
                    f"the key frames of a deformation are of type Keyframe, got {_kind(key)}; "
                    "Keyframe(seconds, steps) makes one."
                )
        object.__setattr__(self, "keyframes", keys)
        if isinstance(self.output, Volume):
            object.__setattr__(self, "output", self.output.grid)
        check_fields(self, "name", "volume", "extra")
        longest = max(map(len, (self.steps, *(key.steps for key in self.keyframes))))
        if longest > MOST_STEPS:
            raise DeformError(
                f"a deformation of {longest} steps cannot be computed; at most {MOST_STEPS} are. Apply it in parts."
            )
        if not isinstance(self.output, Grid | None):
            raise DeformError(f"the output of a deformation is a Grid or None, got {short_value(self.output)}.")
        for what, value, known in (
            ("mode", self.mode, MODES),
            ("easing", self.easing, EASINGS),
            ("loop", self.loop, LOOPS),
        ):
            if not isinstance(value, str) or value not in known:
                raise DeformError(
                    f"unknown {what} {short_value(value)} of a deformation; choose one of {', '.join(known)}."
                )
        self._bring_to_one_unit()
        times = [key.time for key in self.keyframes]
        if any(late <= early for early, late in pairwise(times)):
            raise DeformError(f"the times of key frames must rise, each later than the one before, got {times}.")

    def _bring_to_one_unit(self) -> None:
        """State the unit once: here, and not with the points of every step."""
        steps = (*self.steps, *(step for key in self.keyframes for step in key.steps))
        parts: tuple[Any, ...] = (self.volume, self.output, *(step.points for step in steps))
        unit = check_unit(self.unit) or next((part.unit for part in parts if part is not None and part.unit), "")
        object.__setattr__(self, "unit", unit)
        if self.volume is not None:
            object.__setattr__(self, "volume", self.volume.to_unit(unit))
        if self.output is not None:
            output = self.output.to_unit(unit)
            object.__setattr__(self, "output", output if output.unit == unit else replace(output, unit=unit))
        object.__setattr__(self, "steps", tuple(rescaled_step(step, unit) for step in self.steps))
        if any(step.points.unit for key in self.keyframes for step in key.steps):
            object.__setattr__(
                self,
                "keyframes",
                tuple(
                    replace(key, steps=tuple(rescaled_step(step, unit) for step in key.steps)) for key in self.keyframes
                ),
            )

    def to_unit(self, unit: str) -> Deformation:
        """The same deformation in numbers of another unit; itself where its own or the other one is not known.

        Examples
        --------
        >>> points = ControlPoints.from_arrays([[1, 1, 1]], [[2, 1, 1]], unit="mm")
        >>> Deformation.from_space_points(points).to_unit("um").steps[0].points.target.tolist()
        [[2000.0, 1000.0, 1000.0]]
        """
        to = check_unit(unit)
        if to in ("", self.unit) or not self.unit:
            return self
        known: dict[str, Deformation] = self.__dict__.setdefault("_in_units", {})  # with the fits of its steps
        if to not in known:
            scale = Scale(ratio(self.unit, to))
            keys = tuple(Keyframe(key.time, tuple(map(scale.step, key.steps))) for key in self.keyframes)
            known[to] = replace(
                self,
                steps=tuple(map(scale.step, self.steps)),
                keyframes=keys,
                unit=to,
                volume=self.volume and self.volume.to_unit(to),
                output=self.output and self.output.to_unit(to),
            )
        return known[to]

    def _unit_notes(self, unit: str) -> tuple[str, ...]:
        """A remark where this document and the data it is applied to are in different units."""
        if unit == self.unit or not self.unit:
            return ()
        if not unit:
            note = "the unit of the volume is not known: its numbers were taken to be in"
            return (f"{note} {self.unit}, as the document's are",)
        return (f"the document is in {self.unit} and the volume in {unit}: its lengths were converted",)

    def __repr__(self) -> str:
        name = f" {self.name[:60]!r}" if self.name else ""
        keys = f", {len(self.keyframes)} key frames" if self.keyframes else ""
        made = f", made on {self.volume.name[:60]!r}" if self.volume and self.volume.name else ""
        count = len(self.steps)
        return f"<Deformation{name}: {count} {'step' if count == 1 else 'steps'} ({self.mode}){keys}{made}>"

    @classmethod
    def from_picture_points(
        cls, grid: Grid | VolumeLike, view: ViewName | Plane, points: ControlPoints, **options: Any
    ) -> Deformation:
        """One step on a picture of a volume.

        Parameters
        ----------
        grid : a volume or its grid.
        view : one of :data:`~deformnb.volume.views.VIEWS`, or any plane.
        points : control points in the picture's coordinates.
        options : further fields of :class:`Step`, lengths in the unit of the volume.
        """
        unit = as_finest_grid(grid).unit
        plane = view if isinstance(view, Plane) else Plane.from_view(grid, view)
        step = Step((as_control_points(points).to_unit(unit),), plane, **options)
        return cls((step,), unit=unit or step.points.unit)

    @classmethod
    def from_space_points(cls, points: ControlPoints, **options: Any) -> Deformation:
        """One step with control points (x, y, z) in space; lengths among the options are in the unit of the points."""
        return cls((Step((as_control_points(points),), None, **options),))

    def then(self, following: Step | Deformation) -> Deformation:
        """Append one step, or all steps of another deformation.

        Parameters
        ----------
        following : done after this one. A deformation adds its steps, and its ``output`` if it has one; all else
            (name, volume, how it is played) stays that of this one.

        Raises
        ------
        DeformError
            If what follows is neither, or two deformations do not make one: with key frames, or with several steps that
            are added up ("blend").

        Examples
        --------
        >>> points = ControlPoints.from_arrays([[1, 1, 1]], [[2, 1, 1]])
        >>> first = second = Deformation.from_space_points(points)
        >>> len(first.then(second).steps)
        2
        """
        if not isinstance(following, Deformation):
            return replace(self, steps=(*self.steps, following))
        for one in (self, following):
            if one.keyframes:
                raise DeformError(
                    "deformations with key frames cannot be joined; join their steps: "
                    "Deformation((*first.steps, *second.steps))."
                )
            if one.mode != "compose" and len(one.steps) > 1:
                raise DeformError(
                    f"one of these deformations adds up its {len(one.steps)} steps (mode {one.mode!r}), "
                    "and a document has one mode; apply one after the other: "
                    "second.apply(first.apply(volume))."
                )
        return replace(
            self,
            steps=(*self.steps, *following.steps),
            mode="compose",
            output=self.output if following.output is None else following.output,
        )

    def with_step(self, index: int, step: Step) -> Deformation:
        """Replace a step by another one."""
        self._check(index)
        return replace(self, steps=(*self.steps[:index], step, *self.steps[index + 1 :]))

    @check_arguments
    def without_step(self, index: int) -> Deformation:
        """Remove a step."""
        self._check(index)
        return replace(self, steps=(*self.steps[:index], *self.steps[index + 1 :]))

    @check_arguments
    def move_step(self, index: int, to: int) -> Deformation:
        """The same steps with one of them moved in the order."""
        self._check(index)
        self._check(to)
        rest = [step for k, step in enumerate(self.steps) if k != index]
        return replace(self, steps=(*rest[:to], self.steps[index], *rest[to:]))

    @check_arguments
    def _check(self, index: int) -> None:
        if not 0 <= index < len(self.steps):
            raise DeformError(f"there is no step {index}; there are {len(self.steps)}.")

    @check_arguments
    def scaled(self, strength: float) -> Deformation:
        """Every step ``strength`` times as strong."""
        return replace(self, steps=tuple(replace(s, strength=s.strength * strength) for s in self.steps))

    def field(self, grid: Grid | VolumeLike) -> AbstractField:
        """The backward displacement in space of all enabled steps, composed exactly or blended."""
        lattice = as_finest_grid(grid)
        own = self.to_unit(lattice.unit)
        if own is not self:
            return own.field(lattice)
        return MODES[self.mode](*(step.field(lattice) for step in self.steps if step.enabled))

    def inverse(self, grid: Grid | VolumeLike, **options: Any) -> Inverse:
        """The inverse of the map on the grid of a volume; options are those of :func:`deformnb.warping.inverse.invert`.

        Examples
        --------
        >>> points = ControlPoints.from_arrays([[1, 1, 1]], [[2, 1, 1]])
        >>> moved = Deformation.from_space_points(points, trend="translation")
        >>> moved.inverse(Grid((3, 4, 5)))
        <Inverse: <DisplacementField: 5 x 4 x 3 samples in space>, 100 % of the nodes reached within 0.001>
        """
        return invert(self, grid, **options)

    def warp_points(
        self, points: ArrayLike | Landmarks, grid: Grid | VolumeLike, **options: Any
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Points of the input in the result, and which of them have a place there.

        Parameters
        ----------
        points : (..., 3) in space, or landmarks.
        grid : a volume or its grid.
        options : those of :func:`deformnb.warping.points.warp_points`.
        """
        return warp_points(points, self, grid=grid, **options)

    def __call__(self, given: Any, grid: Grid | VolumeLike | None = None, **options: Any) -> Any:
        """A deformed volume, or deformed places: :meth:`apply`, :func:`deformnb.warp_landmarks`, ``warp_mesh``.

        Parameters
        ----------
        given : anything that is a volume or channels; Landmarks or a Mesh; or an array of points (..., 3) in space, of
            one or two axes; with three axes it is a volume.
        grid : of the volume that is deformed, for places; by default that on which the deformation was made, if it is
            known.
        options : those of :meth:`apply`.

        Returns
        -------
        An object of the same kind. Of an array of points a row that has no place in the result is NaN.

        Raises
        ------
        DeformError
            If the grid is not known, and for control points, whose sources or targets could be meant.

        Examples
        --------
        >>> points = ControlPoints.from_arrays([[1, 1, 1]], [[2, 1, 1]])
        >>> moved = Deformation.from_space_points(points, trend="translation")
        >>> moved(np.zeros((4, 5, 6))).shape
        (4, 5, 6)
        >>> moved([[1, 1, 1]], grid=Grid((4, 5, 6))).round(6).tolist()
        [[2.0, 1.0, 1.0]]
        """
        if isinstance(given, ControlPoints):
            raise DeformError(
                "control points have two places each; deform one of them: deformation(points.source, grid=volume)."
            )
        array = real_array(given) if isinstance(given, list | tuple) else given
        is_points = isinstance(array, np.ndarray) and array.ndim < 3
        if not is_points and not isinstance(given, Landmarks | Mesh):
            return self.apply(given, **options)
        lattice = self._grid_for_places(grid)
        if isinstance(given, Mesh):
            return warp_mesh(given, self, grid=lattice)
        if isinstance(given, Landmarks):
            return warp_landmarks(given, self, grid=lattice)
        moved, found = self.warp_points(given, lattice)
        return np.where(found[..., None], moved, np.nan)

    def _grid_for_places(self, grid: Grid | VolumeLike | None) -> Grid:
        made = self.volume and self.volume.grid
        if grid is None and made is None:
            raise DeformError(
                "it is not known which volume these places are in; give it, or its Grid: "
                "deformation(points, grid=volume)."
            )
        return as_finest_grid(made if grid is None else grid)

    def fit_notes(self, grid: Grid) -> tuple[str, ...]:
        """Remarks of all fits, each once."""
        steps = self.to_unit(grid.unit).steps
        fits = (fit for step in steps if step.enabled for fit in step.fits(grid))
        return (*self._unit_notes(grid.unit), *dict.fromkeys(note for fit in fits for note in fit.notes))

    @check_arguments
    def notes(self, grid: Grid) -> tuple[str, ...]:
        """Remarks of all fits ("points on one line ..."), each once, and that of a document with an older spacing.

        Parameters
        ----------
        grid : of the volume that the document is applied to.
        """
        known = self.older_spacing(grid)
        found = self.fit_notes(self.own_grid(grid))
        return found if known is None else (known.older_note, *found)

    def cautions(self, grid: Grid) -> tuple[str, ...]:
        """Sentences on probable mistakes of this document on a volume's grid, each once.

        They are about a volume other than its own, and those of :meth:`Step.cautions`.
        """
        own = self.own_grid(grid)
        differs = "" if self.older_spacing(grid) else self.difference(grid)
        steps = self.to_unit(own.unit).steps
        found = (caution for step in steps if step.enabled for caution in step.cautions(own))
        return tuple(dict.fromkeys([*([differs] if differs else []), *found]))

    @check_arguments
    def older_spacing(self, grid: Grid) -> KnownSpacing | None:
        """The volume, if this was made on a known one with the wrong spacing of its file and ``grid`` has the true one.

        See :mod:`deformnb.volume.known_spacings`.
        """
        made = self.volume
        if made is None:
            return None
        spacing = made.spacing if made.grid is None else made.grid.to_unit(grid.unit).spacing
        return older_document(made.sha256, spacing, grid)

    @check_arguments
    def own_grid(self, grid: Grid) -> Grid:
        """Grid of a volume in the coordinates of this document: its own grid, but for :meth:`older_spacing`."""
        known = self.older_spacing(grid)
        return grid if known is None else known.to_file_spacing(grid)

    def difference(self, volume: VolumeLike | Grid, reference: Callable[[], VolumeReference] | None = None) -> str:
        """Warning about a volume that this was not made on; empty for the one that it was made on.

        Labels on the volume's grid belong to it. A document without a volume fits any.

        Parameters
        ----------
        volume : or its grid alone, where its voxels are not available.
        reference : makes that of the volume, where it is cached.
        """
        volume = volume if isinstance(volume, Grid) else as_volume(volume)
        made, here = self.volume, self.own_grid(as_finest_grid(volume))
        made = made if made is None else made.to_unit(here.unit)
        if made is None:
            return ""
        is_same = made.shape == here.shape and (
            isinstance(volume, Grid)
            or made.has_labels(volume)
            or made.sha256 == (VolumeReference.of(volume) if reference is None else reference()).sha256
        )
        if not is_same:
            name = short_value(made.name) if made.name else "without a name"
            return (
                f"This document was made on another volume ({name}, {' x '.join(map(str, made.shape[::-1]))} "
                f"voxels); its points may be at another place.{_size_difference(made, here)}"
            )
        if (made.grid or replace(here, spacing=made.spacing)).is_like(here):  # before 1.2 it had no place
            return ""
        then, now = (" x ".join(f"{s:.6g}" for s in spacing) for spacing in (made.spacing, here.spacing))
        return (
            f"This document was made on the same voxels at another place or of another size ({then} then, {now} "
            "now); its points may be at another place."
        )

    @overload
    def apply(self, volume: Channels, **options: Any) -> Channels: ...

    @overload
    def apply(self, volume: VolumeLike, **options: Any) -> Volume: ...

    def apply(self, volume: Channels | VolumeLike, **options: Any) -> Any:
        """The deformed volume on the document's ``output``; options are those of :func:`deformnb.warping.warper.warp`.

        Channels become channels, an array of xarray becomes one, and all else that is a volume a Volume.

        The result has the notes of the volume, and those of this document. One that was made on a known volume with the
        wrong spacing of its file gives the voxels that it gave then, on a grid with the true spacing.
        """
        volumes, made_of = volumes_of(volume)
        return made_of(self.apply_all(volumes, **options))

    def apply_all(self, volumes: Sequence[VolumeLike], **options: Any) -> list[Volume]:
        """Several volumes on one grid, such as channels, each as by :meth:`apply`; the map is computed once.

        Raises
        ------
        DeformError
            As :func:`deformnb.warping.warper.warp_all`.
        """
        volumes = as_volumes(volumes)
        own = volumes[0].finest_grid
        here = self.to_unit(own.unit)  # the same map in numbers of the volume
        known, grid = here.older_spacing(own), here.own_grid(own)
        output = here.output or grid
        if known is not None and (options.get("output") is not None or output.direction != grid.direction):
            raise DeformError(
                f"{known.older_note}, so that its result has no other grid than its own; open it in a "
                f"studio on this volume and save it again, or read the volume with "
                f"spacing={known.header_spacing}."
            )
        field = here.field(grid)
        notes = tuple(
            note for note in here.fit_notes(grid) if note != FOLDS_WARNING
        )  # of the fits; the map is checked below
        subject = volumes[0] if known is None else replace(volumes[0], grid=grid)
        wanted = options.get("output")
        asked = as_output(output if wanted is None else wanted, own)
        cautions = [*here.cautions(own), *map_notes(subject, field, asked, options.get("fill"))]
        if known is None:
            box = None if here.output is None else volumes[0].to_own_resolution(here.output)
            warped = warp_all(volumes, field, **{"output": box, **options})
        else:
            then = [replace(volume, grid=grid) for volume in volumes]
            corrected = known.correct_spacing(output, own)
            warped = [replace(done, grid=corrected) for done in warp_all(then, field, **{**options, "output": output})]
            notes = (known.older_note, *notes)
        converted = () if here is self else self._unit_notes(own.unit)
        return add_cautions(volumes, warped, (*notes, *converted), cautions)

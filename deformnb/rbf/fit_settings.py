"""Settings of a fit of control points, and the fit that they make.

One value holds all that a step of a document, an editor and a view that follows it have of a fit except points,
rigid parts and cuts. To copy, store, send or show settings go through :data:`SETTINGS`: a new one is then one field
of :class:`AbstractFitSettings`, which a step has too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from typing import Any

from deformnb.checks import check_fields, is_finite, short_value
from deformnb.errors import DeformError
from deformnb.rbf.cuts import CutRuleName, Decoupled, Sides, points_of_regions
from deformnb.rbf.fields import AbstractField, AbstractFit
from deformnb.rbf.fitting import check_stages, fit_points
from deformnb.rbf.forward import FitDirection, check_direction, orient_points
from deformnb.rbf.kernels import AbstractKernel, KernelName, as_kernel
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion
from deformnb.rbf.rigid import RigidPart, scaled_points
from deformnb.rbf.slits import check_slits, fits_around_slits, is_slit
from deformnb.rbf.support import (
    SUPPORT_RULES,
    ChosenSupport,
    SupportRuleName,
    check_support,
    choose_support,
    usual_support,
)
from deformnb.rbf.trends import TrendName, find_trend


@dataclass(frozen=True, kw_only=True)
class AbstractFitSettings:
    """Fields that both :class:`FitSettings` and a :class:`~deformnb.document.deformation.Step` have.

    Parameters
    ----------
    kernel, trend : names of :data:`~deformnb.rbf.kernels.KERNELS` and :data:`~deformnb.rbf.trends.TRENDS`. A kernel
        may be given as a function of the relative distance or as a kernel class too, which are registered
        (:func:`~deformnb.rbf.kernels.register_kernel`) and stored by their names; or as a kernel with its support.
    support : support radius in physical units; None lets the points choose it (``chosen_support``); "box_diagonal"
        takes the diagonal of the box of the sources of each set, and of each region between cuts, as documents of
        before 2.0 do.
    smoothing : lambda of the fit, 0 interpolates.
    strength : factor of the displacement of the points and the rigid parts: 0 not at all, 1 as they are, -1 the
        opposite way.
    stages : number of equal parts of the points' way, one map after the other; see :mod:`deformnb.rbf.stages`.
    direction : a name of :data:`~deformnb.rbf.forward.DIRECTIONS`: "backward" fits the sources as a function of the
        targets, "forward" the targets as a function of the sources, which is then inverted; its support is measured in
        the input.
    chosen_support : what :func:`~deformnb.rbf.support.choose_support` found while ``support`` is None, and for
        which kernel; that of another kernel is dropped.

    Raises
    ------
    DeformError
        Naming the setting that is wrong.
    """

    kernel: KernelName | str = "wendland_c2"
    support: float | SupportRuleName | None = field(default=None, metadata={"label": "support radius"})
    trend: TrendName = "affine"
    smoothing: float = 0.0
    strength: float = 1.0
    stages: int = 1
    direction: FitDirection = "backward"
    chosen_support: ChosenSupport | None = None

    def __post_init__(self) -> None:
        given, kind = self.kernel, as_kernel(self.kernel)
        if not isinstance(given, str):
            object.__setattr__(self, "kernel", kind.name)
            if isinstance(given, AbstractKernel) and self.support is None:
                object.__setattr__(self, "support", given.support)
        find_trend(self.trend)
        if not is_finite(self.strength):
            raise DeformError(f"strength must be a finite number, got {short_value(self.strength)}.")
        check_support(self.support)
        if not (is_finite(self.smoothing) and self.smoothing >= 0):
            raise DeformError(f"smoothing must be 0 or a positive number, got {short_value(self.smoothing)}.")
        check_stages(self.stages, ())
        check_direction(self.direction)
        check_fields(self, "kernel", "support", "trend", "smoothing", "strength", "stages", "direction")
        if self.chosen_support is not None:
            object.__setattr__(self, "chosen_support", self._cached_support(self.chosen_support))

    def _cached_support(self, given: Any) -> ChosenSupport | None:
        try:
            kept = ChosenSupport(*given)
            if isinstance(given, str) or not isinstance(kept.kernel, str) or not is_finite(kept.radius):
                raise TypeError
        except TypeError:
            raise DeformError(
                f"the chosen support of a step must be a radius and the name of a kernel, got {given!r:.60}."
            ) from None
        check_support(kept.radius)
        return kept if self.support is None and kept.kernel == self.kernel else None

    def support_for(self, points: ControlPoints) -> float | None:
        """The support radius for a set of points, or for the part of it between cuts: as given, by a rule, as it was
        chosen, or the usual one. None for points at one place, which do not determine it.
        """
        points = orient_points(points, self.direction)
        if isinstance(self.support, str):
            return SUPPORT_RULES[self.support](points)
        chosen = self.chosen_support and self.chosen_support.radius
        return self.support or chosen or usual_support(points, as_kernel(self.kernel))


SETTINGS = tuple(setting.name for setting in fields(AbstractFitSettings))
"""Names of the settings of a fit."""


def label_of(setting: Field[Any]) -> str:
    """The name of a field of the settings, or of a step, in plain English: its ``label``, or that of the code.

    Examples
    --------
    >>> [label_of(setting) for setting in fields(FitSettings)][:3]
    ['kernel', 'support radius', 'trend']
    """
    return str(setting.metadata.get("label", setting.name.replace("_", " ")))


@dataclass(frozen=True)
class FitSettings(AbstractFitSettings):
    """Settings of the fit of a set of control points; their meaning is that of :class:`AbstractFitSettings`.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9]], [[1, 0], [9, 2], [0, 9]])
    >>> FitSettings(strength=0.5).fit(points).displacement([0.5, 0.0]).round(9).tolist()
    [-0.5, 0.0]
    """

    @classmethod
    def of(cls, holder: Any) -> FitSettings:
        """The settings of what has them as attributes, such as a step."""
        return cls(**{name: getattr(holder, name) for name in SETTINGS})

    def as_dict(self) -> dict[str, Any]:
        """The settings by their names, such as a step takes them."""
        return {name: getattr(self, name) for name in SETTINGS}

    def with_chosen_support(self, sets: Sequence[ControlPoints], current: float | None = None) -> FitSettings:
        """The same settings with the support that these sets of points choose; as they are where ``support`` is given.

        Parameters
        ----------
        current : the radius so far, which stays unless another one is clearly better.
        """
        if self.support is not None:
            return self
        fitted = [orient_points(points, self.direction) for points in sets]
        radius = choose_support(fitted, kernel=self.kernel, trend=self.trend, smoothing=self.smoothing, current=current)
        return replace(self, chosen_support=None if radius is None else ChosenSupport(radius, self.kernel))

    def arguments(self, points: ControlPoints, lone: float | None = None) -> dict[str, Any]:
        """Keyword arguments of :func:`~deformnb.rbf.interpolant.fit_rbf` for a set of points.

        Parameters
        ----------
        lone : support radius where the points do not determine it, such as :func:`lone_support`.
        """
        return {
            "kernel": self.kernel,
            "support": self.support_for(points) or lone,
            "trend": self.trend,
            "smoothing": self.smoothing,
        }

    def fits(
        self,
        points: ControlPoints,
        parts: Sequence[RigidPart] = (),
        cuts: Sequence[AbstractRegion] = (),
        *,
        lone: float | None = None,
        previous: Mapping[Sides, Any] | None = None,
    ) -> dict[Sides, AbstractFit]:
        """Fit control points in each region between cuts that has some; without cuts there is one region.

        With cuts that stop inside the body every region has a :class:`~deformnb.rbf.slits.TipBlend`.

        Parameters
        ----------
        points : as they were dragged; ``strength`` is applied here, to the parts too.
        parts : of which those that are switched on count.
        cuts : regions of the cuts that are switched on.
        lone : support radius where the points do not determine it.
        previous : the fits before these, by the same regions, while points are dragged.

        Raises
        ------
        DeformError
            As :func:`~deformnb.rbf.fitting.fit_points` does.
        """
        moved = [part.scaled(self.strength) for part in parts if part.enabled]
        before = dict(previous or {})

        def fit(_sides: Sides, own: ControlPoints, last: Any) -> AbstractFit:
            dragged = scaled_points(own, parts, self.strength)
            return fit_points(
                dragged, moved, stages=self.stages, direction=self.direction, previous=last, **self.arguments(own, lone)
            )

        if any(map(is_slit, cuts)):
            return dict(fits_around_slits(points, cuts, fit, before))
        every = points_of_regions(points, cuts) if cuts else {(): points}
        return {sides: fit(sides, own, before.get(sides)) for sides, own in every.items()}

    def fit(
        self,
        points: ControlPoints,
        parts: Sequence[RigidPart] = (),
        cuts: Sequence[AbstractRegion] = (),
        *,
        cut_rule: CutRuleName = "source",
        softness: float = 0.0,
        lone: float | None = None,
        previous: AbstractField | None = None,
    ) -> AbstractField:
        """As :meth:`fits`, joined to one displacement.

        Parameters
        ----------
        cut_rule, softness : of :class:`~deformnb.rbf.cuts.Decoupled`.
        previous : the displacement before this one.

        Returns
        -------
        The only fit, or with cuts a :class:`~deformnb.rbf.cuts.Decoupled`.
        """
        check_slits(cuts, cut_rule)
        before: Any = (
            dict(zip(previous.sides, previous.fields, strict=True))
            if isinstance(previous, Decoupled)
            else {(): previous}
        )
        found = self.fits(points, parts, cuts, lone=lone, previous=before)
        if not cuts:
            return found[()]
        return Decoupled(tuple(found.values()), tuple(found), tuple(cuts), rule=cut_rule, softness=softness)

"""Diagnostics of the edited step, and actions against its folds, for the studio and the application.

The figures are folds, the round trip, and the agreement of its points. An action makes the step that a session edits
fold-free and reports its changes in the session's notice; it may be called from any thread. There are no widgets here.
"""

from __future__ import annotations

import html
import threading
import weakref
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.analysis.folds import Folds
from deformnb.analysis.quality import FitQuality, bending_energy
from deformnb.document.deformation import Deformation, Step
from deformnb.document.step_checks import (
    LEAST,
    best_prediction,
    picture_raster,
    required_stages,
    safe_points,
    safe_strength,
    step_folds,
    step_quality,
    step_uncertainty,
)
from deformnb.errors import DeformError
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.prediction import ChosenFit
from deformnb.rbf.trends import TRENDS
from deformnb.session.session import Session
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.foreground import IsTissue, tissue_test
from deformnb.warping.inverse import RoundTrip, round_trip
from deformnb.widgets.packed_volume import unit_of

_AGREE = "No point is an outlier."
_UNKNOWN = "Too few points to detect outliers."

# Places along the longest side that go forth and back.
_TRIPS_ON_PLANE, _TRIPS_IN_SPACE = 25, 9

# Cells of an uncertainty overlay along the longer side: it is smooth, and the front end spreads it.
_UNCERTAINTY_CELLS = 96
_CONTOURS = (0.3, 0.6, 0.9)
_DIGITS = (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8)


@dataclass(frozen=True, eq=False)
class Diagnostics:
    """Figures of one step.

    Parameters
    ----------
    step, key : of the diagnostics.
    folds, trip, quality, bending : None where they could not be found; ``reason`` then explains why.
    unit : of lengths, in words.
    """

    step: Step
    key: int
    folds: Folds | None
    trip: RoundTrip | None
    quality: FitQuality | None
    bending: float | None
    reason: str
    unit: str

    @property
    def is_fold_free(self) -> bool | None:
        """True if the map is as far from a fold as it should be; None if that is not known."""
        return None if self.folds is None else self.folds.least >= LEAST

    @property
    def folds_text(self) -> str:
        """Such as "no folds"."""
        if self.folds is None:
            return "folds unknown"
        if self.folds.least > 0:
            return "no folds in tissue" if self.folds.air else "no folds"
        share = 100 * self.folds.share
        return f"folds {share:.0f} %" if share >= 1 else "folds < 1 %"

    @property
    def trip_text(self) -> str:
        """Such as "round trip 0.001 mm"."""
        return "" if self.trip is None else f"round trip {length_text(self.trip.worst)}{self.unit and f' {self.unit}'}"


def tissue_of(session: Session) -> IsTissue | None:
    """Test of tissue at points of the input of the step that a session edits, on a picture at any depth.

    None, so that every fold counts, where steps before have deformed the volume.
    """
    if any(step.enabled for step in session.editing.deformation.steps[: session.editing.index]):
        return None
    volume, plane = session.volume, session.editing.step.plane
    with _COMPUTING_TISSUE:
        kept = _TISSUE.get(session)
        if kept is None or kept[0] is not volume or kept[1] != plane:
            kept = _TISSUE[session] = (volume, plane, tissue_test(volume, plane))
        return kept[2]


_TISSUE: weakref.WeakKeyDictionary[Session, tuple[Volume, Plane | None, IsTissue]] = weakref.WeakKeyDictionary()
_COMPUTING_TISSUE = threading.Lock()


def diagnose(step: Step, key: int, grid: Grid, is_tissue: IsTissue | None = None) -> Diagnostics:
    """Diagnostics of a step; takes some hundredths of a second, more for points in space.

    Parameters
    ----------
    is_tissue : where folds count, see :func:`tissue_of`; default everywhere.
    """
    unit, reasons = unit_of(grid), []
    folds = trip = quality = bending = None
    try:
        field = step.field(grid)
        folds, trip = step_folds(step, grid, field, is_tissue), round_trip(field, _places(step, grid))
    except DeformError as error:
        reasons.append(str(error))
    points = step.maps[min(key, len(step.maps) - 1)]
    try:
        bending = bending_energy(points if step.strength == 1 else points.scaled(step.strength))
        quality = step_quality(step, grid, min(key, len(step.maps) - 1))
    except DeformError as error:
        reasons.append(str(error))
    return Diagnostics(step, key, folds, trip, quality, bending, " ".join(dict.fromkeys(reasons)), unit)


def warm_up(session: Session) -> None:
    """Compile the code for the first edit of a session, by diagnostics of a dragged point; changes nothing."""
    points, step = session.editing.points, session.editing.step
    place = points.target.mean(axis=0) if len(points) else (0.0, 0.0, 0.0)[: points.dim]
    moved = points.add(place, [c + 0.01 * session.editing.grid.diagonal for c in place])
    diagnose(replace(step, maps=(moved,) * len(step.maps)), session.editing.key, session.editing.grid)


def _places(step: Step, grid: Grid) -> NDArray[np.float64]:
    """Places of tissue for the round trip: all over the middle slice, or the volume."""
    if step.plane is not None:
        raster = picture_raster(step.plane, grid, _TRIPS_ON_PLANE)
        depth = sum(step.plane.depth_range(grid)) / 2
        a, b = np.meshgrid(raster.columns, raster.rows)
        return step.plane.from_plane(np.stack([a, b, np.full_like(a, depth)], axis=-1)).reshape(-1, 3)
    axes = [np.linspace(0, n - 1, min(n, _TRIPS_IN_SPACE)) for n in grid.shape[::-1]]
    return grid.index_to_point(np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3))


_COMPUTED: weakref.WeakKeyDictionary[Session, tuple[Deformation, int, int, Diagnostics]] = weakref.WeakKeyDictionary()
_COMPUTING = threading.Lock()


def diagnostics_of(session: Session) -> Diagnostics:
    """The diagnostics of the step that a session edits; the last ones are cached."""
    with _COMPUTING:
        state = session.editing.deformation, session.editing.index, session.editing.key
        kept = _COMPUTED.get(session)
        if kept is None or kept[0] is not state[0] or kept[1:3] != state[1:]:
            kept = (
                *state,
                diagnose(session.editing.step, session.editing.key, session.editing.grid, tissue_of(session)),
            )
            _COMPUTED[session] = kept
        return kept[3]


def length_text(value: float) -> str:
    """A length with two digits that count; rounding of less than a billionth counts as 0.

    >>> [length_text(v) for v in (0.0, 3e-12, 3.2e-7, 0.00123, 0.5, 7.25, 1234.0)]
    ['0', '0', '< 0.0001', '0.0012', '0.5', '7.2', '1234']
    """
    if value < 1e-4:
        return "0" if value < 1e-9 else "< 0.0001"
    return f"{value:.2g}" if value < 100 else f"{value:.0f}"


def point_name(points: ControlPoints, point: int) -> str:
    """Label of a point in a panel."""
    k = points.index(point)
    number, name = points.numbers[k], points.names[k]
    return f"point {number} ({name[:40]})" if name else f"point {number}"


def suspects_of(found: Diagnostics, points: ControlPoints) -> tuple[str, list[int]]:
    """A label and the ids of the possible outliers, without points that have been removed since."""
    known = [i for i in (() if found.quality is None else found.quality.suspects) if i in points.ids]
    return "Possible outliers:" if known else _AGREE if found.quality is not None else _UNKNOWN, known


def facts_html(found: Diagnostics) -> str:
    """The figures as a table."""
    cells = "".join(
        f'<tr title="{html.escape(_WHY[name], quote=True)}"><th style="{_NAME_STYLE}">{name}</th>'
        f'<td style="padding: 0">{html.escape(text)}</td></tr>'
        for name, text in _texts(found).items()
    )
    reason = f'<div style="opacity: 0.8; max-width: 60ch">{html.escape(found.reason)}</div>' if found.reason else ""
    return f'<table class="dnb-diagnostics" style="line-height: 1.5; border-spacing: 0">{cells}</table>{reason}'


_NAME_STYLE = (
    "text-align: left; vertical-align: top; font-weight: normal; opacity: 0.75; padding: 0 14px 0 0; "
    "white-space: nowrap"
)

_WHY = {
    "Folds": "det J is the Jacobian determinant of the backward map: 1 keeps areas, below 1 they grow, at 0 or less "
    f"the map folds. {LEAST:g} counts as fold-free. Folds in air are counted separately.",
    "Round trip": "Distance between a point and its image under the inverse map and then the map. A lost point "
    "has no place in the result: it is hidden in a fold or behind a cut.",
    "Residual": "How far points miss their sources: more than 0 only with smoothing.",
    "Leave-one-out": "How far the other points miss a point that is left out, and which one most.",
    "Affine share": "What one turn, stretch and shear of all points explains; the rest bends.",
    "Bending energy": "Of the thin-plate spline through the same points (Bookstein); 0 for affine maps.",
}


def _texts(found: Diagnostics) -> dict[str, str]:
    """The figures that there are, by the names of :data:`_WHY`."""
    unit, texts = found.unit and f" {found.unit}", dict[str, str]()
    if found.folds is not None:
        least, share = found.folds.least, found.folds.share
        none = f"none in tissue, {100 * found.folds.air:.2g} % in air" if found.folds.air else "none"
        how = none if least > 0 else f"{100 * share:.2g} % folded" if share else "at single places"
        texts["Folds"] = f"{how}; smallest det J {least:.3g}"
    if found.trip is not None:
        trip = found.trip
        lost = f"; {100 * (1 - trip.reached):.2g} % lost" if trip.reached < 1 else ""
        mean = f", mean {length_text(trip.mean)}" if trip.worst >= 1e-4 else ""
        texts["Round trip"] = f"{length_text(trip.worst)}{unit} at most{mean}{lost}"
    q = found.quality
    if q is not None:
        points = found.step.maps[min(found.key, len(found.step.maps) - 1)]
        name = point_name(points, q.ids[int(np.argmax((q.leave_one_out**2).sum(axis=1)))])
        most = [float(np.sqrt((a**2).sum(axis=1).max())) for a in (q.residual, q.leave_one_out)]
        texts["Residual"] = f"{length_text(most[0])}{unit} at most"
        texts["Leave-one-out"] = f"{length_text(q.root_mean_square)}{unit} RMS; {length_text(most[1])} at {name}"
        texts["Affine share"] = f"{100 * q.affine_share:.0f} % of the drags"
    if found.bending is not None:
        length = "" if found.step.plane is not None else unit
        texts["Bending energy"] = (
            "infinite: one source has two targets"
            if np.isinf(found.bending)
            else f"{found.bending if found.bending > 1e-12 else 0.0:.3g}{length}"
        )
    return texts


# ---- the uncertainty overlay -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class UncertaintyOverlay:
    """Uncertainty overlay of a map, as an editor shows it.

    Parameters
    ----------
    data : one byte for each cell, rows first; 255 where the map is known least.
    facts : width, height and legend of the trait ``uncertainty_facts``.
    """

    data: bytes
    facts: dict[str, object]


NO_UNCERTAINTY = UncertaintyOverlay(b"", {})


def uncertainty_overlay(step: Step, key: int, grid: Grid, raster: Raster) -> UncertaintyOverlay:
    """The uncertainty of a step on its picture, with contours at round numbers.

    Raises
    ------
    DeformError
        If there are too few points for an estimate.
    """
    a0, a1, b0, b1 = raster.box
    cell = max(a1 - a0, b1 - b0) / _UNCERTAINTY_CELLS
    width, height = (max(2, round(side / cell)) for side in (a1 - a0, b1 - b0))
    a = a0 + (np.arange(width) + 0.5) * (a1 - a0) / width
    b = b0 + (np.arange(height) + 0.5) * (b1 - b0) / height
    known = step_uncertainty(step, grid, key)
    values = known.lattice_values(np.stack([np.zeros(height), b]), np.stack([a, np.zeros(width)]))
    most = float(values.max())
    if not most > 1e-9 * (a1 - a0):
        raise DeformError(
            "nothing bends, so the points give no estimate of the error of the map between them; drag one."
        )
    levels = dict.fromkeys(_round_number(share * most) for share in _CONTOURS)
    legend = [[round(255 * v / most), f"\u00b1 {v:g} {unit_of(grid)}".strip()] for v in levels if 0 < v < most]
    return UncertaintyOverlay(
        np.round(255 * values / most).astype(np.uint8).tobytes(), {"width": width, "height": height, "legend": legend}
    )


class UncertaintyCache:
    """The uncertainty overlay of the picture of a session, made again only for another request."""

    def __init__(self) -> None:
        self._kept: tuple[tuple[Any, ...], UncertaintyOverlay, str] | None = None

    def make(self, session: Session) -> tuple[UncertaintyOverlay, str]:
        """The uncertainty overlay, or none and the reason why."""
        settings = (session.editing.step, session.editing.key, session.editing.grid, session.pictures.picture().raster)
        kept = self._kept
        if kept is None or kept[0][0] is not settings[0] or kept[0][1:] != settings[1:]:
            try:
                kept = settings, uncertainty_overlay(*settings), ""
            except DeformError as error:
                kept = settings, NO_UNCERTAINTY, f"Uncertainty: {error}"
            self._kept = kept
        return kept[1:]


def _round_number(value: float) -> float:
    """The next number below that is easily read.

    >>> [_round_number(v) for v in (0.0187, 0.9, 13.2, 240.0)]
    [0.015, 0.8, 12.0, 200.0]
    """
    power = 10.0 ** np.floor(np.log10(value))
    digits = max(d for d in _DIGITS if d <= value / power + 1e-9)
    return float(f"{digits * power:.2g}")


CHOSEN = ("kernel", "trend", "support", "smoothing", "direction")
"""Settings of the fit that are chosen by how well it predicts."""


def chosen_fields(chosen: ChosenFit, step: Step) -> dict[str, Any]:
    """The settings of a choice that differ from those of a step; none where too few points were judged."""
    if not chosen.tried:
        return {}
    found = {name: getattr(chosen.settings, name) for name in CHOSEN}
    return {name: value for name, value in found.items() if getattr(step, name) != value}


def describe_choice(chosen: ChosenFit, grid: Grid) -> str:
    """A choice in one sentence for the status line."""
    if not chosen.tried:
        return "There are too few control points to leave some of them out."
    settings, best = chosen.settings, chosen.tried[0]
    folds = " Every fit that was tried folds." if best.folds else ""
    return (
        f"Best prediction: {settings.direction.capitalize()}, {KERNELS[settings.kernel].title}, "
        f"{TRENDS[settings.trend].title}. Left-out points come within {length_text(best.error)} "
        f"{unit_of(grid)} of their targets.{folds}"
    )


class FoldActions:
    """Actions against folds, and for the best prediction: limit the last drag or the strength, divide the deformation
    into stages, choose the fit.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((16, 16, 16)), view="+y")
    >>> fold_actions = FoldActions(session)
    >>> fold_actions.diagnose().folds_text
    'no folds'
    >>> fold_actions.unfold()
    >>> session.editing.notice
    'Nothing folds here.'
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._chosen_for: tuple[ControlPoints, ...] = ()  # the points for which the fit was chosen
        self._safe: tuple[int, int, ControlPoints] | None = None  # the last points of a step that did not fold

    def diagnose(self, keep_free: bool = False) -> Diagnostics | None:
        """Diagnostics of the session; None if it has changed meanwhile, so that they must be computed again.

        Parameters
        ----------
        keep_free : where it folds, choose stages that leave no fold, as part of the edit that folded.
        """
        session = self._session
        deformation = session.editing.deformation
        found = diagnostics_of(session)
        if session.editing.deformation is not deformation:
            return None
        if found.is_fold_free:
            self._safe = (session.editing.index, session.editing.key, session.editing.points)
        elif keep_free and found.is_fold_free is False and self._remove_folds(deformation):
            return None
        return found

    def take_back(self) -> None:
        """The last drag, or else the strength, as far as is safe.

        Raises
        ------
        DeformError
            If that is not at all.
        """
        session, step, grid = self._session, self._session.editing.step, self._session.editing.grid
        start, points = self._start_of_drag(), session.editing.points
        if start is not None:
            made = safe_points(step, start, points, grid, session.editing.key, is_tissue=tissue_of(session))
            if made is not points:
                session.editing.edit_points(made, "largest safe drag")
                self._report("The last drag goes as far as is safe now.")
                return
        safe = safe_strength(step, grid, is_tissue=tissue_of(session))
        if safe == step.strength:
            self._report("Nothing folds here: the whole drag is safe.")
        elif safe == 0:
            raise DeformError("the map folds however weak it is; the control points, or a shape, require too much.")
        else:
            session.editing.change("largest safe strength", strength=safe)
            self._report(f"The strength is {safe:.2f} now, as much as is safe.")

    def unfold(self) -> None:
        """As few stages as leave no fold.

        Raises
        ------
        DeformError
            If no number of stages does.
        """
        session, step = self._session, self._session.editing.step
        count = required_stages(step, session.editing.grid, is_tissue=tissue_of(session))
        if count == step.stages:
            self._report("Nothing folds here." if count == 1 else f"Nothing folds in {count} stages.")
            return
        session.editing.change("unfold by stages" if count > 1 else "back to one stage", stages=count)
        self._report(f"Done in {count} stages: nothing folds." if count > 1 else "One stage is enough.")

    def predict(self) -> None:
        """The fit that predicts left-out points best.

        Raises
        ------
        DeformError
            If no point is active.
        """
        session = self._session
        self._chosen_for = session.editing.step.maps
        chosen = best_prediction(session.editing.step)
        fields = chosen_fields(chosen, session.editing.step)
        if fields:
            session.editing.change("best prediction", **fields)
        self._report(describe_choice(chosen, session.editing.grid))

    def keep_chosen(self) -> bool:
        """Choose the fit again where the points have changed, as part of the edit; returns whether it did."""
        session = self._session
        deformation, index, step = session.editing.deformation, session.editing.index, session.editing.step
        if self._chosen_for == step.maps:
            return False
        self._chosen_for = step.maps
        try:
            chosen = best_prediction(step)
        except DeformError as error:
            self._report(str(error))
            return False
        fields = chosen_fields(chosen, step)
        if not fields:
            return False
        made = deformation.with_step(index, replace(step, **fields))
        return session.editing.amend(deformation, made, describe_choice(chosen, session.editing.grid))

    def _report(self, text: str) -> None:
        self._session.editing.notice = ""  # the same message again is shown again
        self._session.editing.notice = text

    def _start_of_drag(self) -> ControlPoints | None:
        """The points of this step when it last did not fold, if they are others than now."""
        if self._safe is None or self._safe[:2] != (self._session.editing.index, self._session.editing.key):
            return None
        points = self._safe[2]
        return (
            points
            if points.dim == self._session.editing.points.dim and points != self._session.editing.points
            else None
        )

    def _remove_folds(self, deformation: Deformation) -> bool:
        """Choose stages that leave no fold, as part of the edit that folded; whether that was done."""
        session = self._session
        index, step = session.editing.index, session.editing.step
        try:
            count = required_stages(step, session.editing.grid, is_tissue=tissue_of(session))
        except DeformError as error:
            self._report(str(error))
            return False
        if count == step.stages:
            return False
        made = deformation.with_step(index, replace(step, stages=count))
        return session.editing.amend(deformation, made, f"Done in {count} stages, so that nothing folds.")


# ---- summaries for the studio and the application --------------------------------------------------------------------


@dataclass(frozen=True)
class Findings:
    """Diagnostics of a step with the uncertainty overlay, if that was requested.

    Parameters
    ----------
    diagnostics : of the step.
    uncertainty : the overlay; None if none was requested.
    reason : why there is none, if it was.
    """

    diagnostics: Diagnostics
    uncertainty: UncertaintyOverlay | None = None
    reason: str = ""


class StepDiagnostics:
    """Diagnostics of the step that a session edits: the model of the studio's panel and of the application's section.

    Attributes
    ----------
    fold_actions : the actions that make the step fold-free.
    keep_free : whether to choose stages that leave no fold after every edit.
    keep_chosen : whether to choose the fit that predicts best after every edit of the points.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._uncertainty = UncertaintyCache()
        self.fold_actions = FoldActions(session)
        self.keep_free = False
        self.keep_chosen = False

    def compute(self, overlay: str) -> Findings | None:
        """Diagnostics of the session's current state; takes a moment. None if it changes meanwhile.

        Parameters
        ----------
        overlay : of the picture; "uncertainty" computes it.
        """
        if self.keep_chosen and self.fold_actions.keep_chosen():
            return None
        found = self.fold_actions.diagnose(self.keep_free)
        if found is None:
            return None
        if overlay != "uncertainty" or found.step.plane is None:
            return Findings(found)
        return Findings(found, *self._uncertainty.make(self._session))

    def show(self, findings: Findings, current: Any, picture: Any) -> None:
        """Mark possible outliers in the current editor, and lay the uncertainty over the picture."""
        if current.has_trait("marked"):
            current.marked = suspects_of(findings.diagnostics, self._session.editing.points)[1]
        if findings.uncertainty is not None:
            with picture.hold_sync():
                picture.uncertainty, picture.uncertainty_facts = findings.uncertainty.data, findings.uncertainty.facts


def look_at_point(editor: Any, point: int) -> None:
    """Select a point in an editor and center it.

    Raises
    ------
    DeformError
        If there is none with this id.
    """
    editor.points.index(point)
    editor.selected = [point]
    editor.look_at(point)

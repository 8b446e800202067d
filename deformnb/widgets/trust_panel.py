"""Whether the deformation can be believed, in the studio: figures, points that disagree, and what to do about folds.

What takes time is done in the studio's thread after an edit, the newest first, and never while something is dragged:
Python hears of a drag at its end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import ipywidgets as ipw
import traitlets

from deformnb.control_points import ControlPoints
from deformnb.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.session import Session
from deformnb.trust import LEAST, safe_points, safe_strength, stages_needed
from deformnb.widgets.cell_widgets import close_all, weakly
from deformnb.widgets.controls import Guard, Panel, button, menu, row
from deformnb.widgets.judgement import NO_HAZE, Judgement, facts_html, haze_of, judgement_of, point_name
from deformnb.widgets.worker import Worker

OVERLAY_WORDS = [("nothing", "none"), ("folds, red", "folds"), ("area: green grows, purple shrinks", "area"),
                 ("principal strains", "strain"), ("uncertainty, haze", "uncertainty")]

_WAITING = "<i>Looking at the map ...</i>"
_AGREE = "All points agree with one another."
_UNKNOWN = "Too few points to tell which of them disagree."


class TrustPanel(Panel):
    """Figures of the step being edited, and buttons that make it safe.

    Parameters
    ----------
    view : of the volume; its trait ``show_folds``, if it has one, can be switched.
    editors : ``plane`` is the editor on pictures, ``current`` that of the step being edited.
    worker : the thread for what takes time.

    Attributes
    ----------
    facts : the figures; suspects : a row of buttons with the points that disagree.
    """

    title = "Trust"

    def __init__(self, session: Session, guard: Guard, view: Any, editors: Any, worker: Worker) -> None:
        super().__init__(session, guard)
        self._view, self._editors, self._worker = view, editors, worker
        self._safe: tuple[int, int, ControlPoints] | None = None  # the last points of a step that did not fold
        self._shown: Judgement | None = None
        self._named: list[str] = []
        self._hazed: tuple[Any, ...] | None = None
        self.facts = ipw.HTML(_WAITING, layout=ipw.Layout(flex="1.2 1 335px", min_width="0"))
        self.suspects = ipw.HBox([], layout=ipw.Layout(flex_flow="row wrap", align_items="center", grid_gap="0 6px"))
        self.said = ipw.HTML("", layout=ipw.Layout(min_width="0"))
        doing = ipw.VBox([row(*self._safety()), self.suspects, row(*self._overlays()), self.said],
                         layout=ipw.Layout(flex="1 1 425px", min_width="0"))
        self.box = ipw.HBox([self.facts, doing], layout=ipw.Layout(flex_flow="row wrap", grid_gap="4px 24px"))
        editors.plane.observe(weakly(self, TrustPanel._overlay_changed, _is_open), "overlay")
        self.refresh()

    # -- the parts -----------------------------------------------------------------------------------------------------

    def _safety(self) -> list[Any]:
        least = f"the smallest det J is {LEAST:g}"
        self.back = button("Largest safe drag", "Take the last drag, or else the strength, back to where " + least,
                           lambda: self._soon(TrustPanel._take_back))
        self.unfold = button("Unfold by stages", "The same drag in as many stages as leave no fold; every point still "
                             "comes to its target", lambda: self._soon(TrustPanel._unfold))
        self.stages = self.of_step(
            ipw.BoundedIntText(min=1, max=64, description="Stages", style={"description_width": "48px"},
                               tooltip="Small maps done one after the other; more fold later and take longer",
                               layout=ipw.Layout(width="120px")), "stages")
        self.keep = ipw.Checkbox(False, description="keep fold-free", indent=False, layout=ipw.Layout(width="auto"),
                                 tooltip="After every edit, choose the stages that leave no fold")
        self.keep.observe(weakly(self, TrustPanel._keep_changed, _is_open), "value")
        return [self.back, self.unfold, self.stages, self.keep]

    def _overlays(self) -> list[Any]:
        overlay = menu("On the picture", OVERLAY_WORDS, "What is laid over the picture; V goes through them there")
        overlay.style.description_width = "96px"
        self._links = [traitlets.link((self._editors.plane, "overlay"), (overlay, "value"))]
        self.overlay = overlay
        if not self._view.has_trait("show_folds"):
            return [overlay]
        in_volume = ipw.Checkbox(description="folds in the volume", indent=False, layout=ipw.Layout(width="auto"),
                                 tooltip="Red stripes on matter that is shown twice")
        self._links.append(traitlets.link((self._view, "show_folds"), (in_volume, "value")))
        return [overlay, in_volume]

    # -- what is shown -------------------------------------------------------------------------------------------------

    def arrange(self) -> None:
        self.overlay.disabled = self.session.step.plane is None
        if not self._worker.is_closed:
            self._worker.latest("trust", weakly(self, TrustPanel._judge, _is_open))

    def _judge(self) -> None:
        deformation = self.session.deformation
        found = judgement_of(self.session)
        if self.session.deformation is not deformation:
            return  # another one waits
        if found.folds is not None and found.folds.least >= LEAST:
            self._safe = (self.session.index, self.session.key, self.session.points)
        elif self.keep.value and found.folds is not None and self._kept_free(deformation):
            return  # which is judged in turn
        if self._shown is not found:
            self._shown = found
            self.facts.value = facts_html(found)
            self._show_suspects(found)
        self._show_haze()

    def _show_suspects(self, found: Judgement) -> None:
        ids = () if found.quality is None else found.quality.suspects
        editor, points = self._editors.current, self.session.points
        known = [i for i in ids if i in points.ids]
        if editor.has_trait("marked"):
            editor.marked = known
        text = "Disagree with the rest:" if known else _AGREE if found.quality is not None else _UNKNOWN
        told = [text, *(point_name(points, i) for i in known)]
        if told == self._named:
            return
        self._named, old = told, self.suspects.children
        self.suspects.children = (ipw.Label(text), *(self._suspect(points, i) for i in known))
        for widget in old:
            close_all(widget)

    def _suspect(self, points: ControlPoints, point: int) -> ipw.Button:
        return button(point_name(points, point), "Show it: a wrong place, two points swapped, or a drag that its "
                      "neighbours do not follow", lambda: self.guard(lambda: self._look_at(point)))

    def _look_at(self, point: int) -> None:
        editor = self._editors.current
        if point in editor.points.ids:
            editor.selected = [point]
            editor.look_at(point)

    # -- the haze ------------------------------------------------------------------------------------------------------

    def _overlay_changed(self, _change: Any) -> None:
        self.refresh()

    def _show_haze(self) -> None:
        editor, session = self._editors.plane, self.session
        if editor.overlay != "uncertainty" or session.step.plane is None:
            self.said.value = ""
            return
        asked = (session.step, session.key, session.volume.grid, session.picture().raster)
        if self._hazed is not None and self._hazed[0] is asked[0] and self._hazed[1:] == asked[1:]:
            return
        try:
            made, said = haze_of(*asked), ""
        except DeformError as error:
            made, said = NO_HAZE, f"Uncertainty: {error}"
        self._hazed, self.said.value = asked, said.replace("&", "&amp;").replace("<", "&lt;")
        with editor.hold_sync():
            editor.haze, editor.haze_facts = made.data, made.facts

    # -- what is done --------------------------------------------------------------------------------------------------

    def _soon(self, method: Callable[[Any], None]) -> None:
        """In the thread, its errors in the page."""
        self.guard(lambda: self._worker.latest("make safe", weakly(self, _guarded(method), _is_open)))

    def _take_back(self) -> None:
        session, step, grid = self.session, self.session.step, self.session.volume.grid
        start, points = self._start_of_drag(), session.points
        if start is not None:
            made = safe_points(step, start, points, grid, session.key)
            if made is not points:
                session.edit_points(made, "largest safe drag")
                self._tell("The last drag goes as far as is safe now.")
                return
        safe = safe_strength(step, grid)
        if safe == step.strength:
            self._tell("Nothing folds here: the whole drag is safe.")
        elif safe == 0:
            raise DeformError("the map folds however weak it is; the control points, or a shape, ask for too much.")
        else:
            session.change("largest safe strength", strength=safe)
            self._tell(f"The strength is {safe:.2f} now, as much as is safe.")

    def _tell(self, text: str) -> None:
        self.session.notice = ""  # the same words again are said again
        self.session.notice = text

    def _start_of_drag(self) -> ControlPoints | None:
        """The points of this step when it last did not fold, if they are others than now."""
        if self._safe is None or self._safe[:2] != (self.session.index, self.session.key):
            return None
        points = self._safe[2]
        return points if points.dim == self.session.points.dim and points != self.session.points else None

    def _unfold(self) -> None:
        session, step = self.session, self.session.step
        count = stages_needed(step, session.volume.grid)
        if count == step.stages:
            self._tell("Nothing folds here." if count == 1 else f"Nothing folds in {count} stages.")
            return
        session.change("unfold by stages" if count > 1 else "back to one stage", stages=count)
        self._tell(f"Done in {count} stages: nothing folds." if count > 1 else "One stage is enough.")

    def _kept_free(self, deformation: Deformation) -> bool:
        """Choose stages that leave no fold, as part of the edit that folded; whether that was done."""
        session = self.session
        index, step = session.index, session.step
        try:
            count = stages_needed(step, session.volume.grid)
        except DeformError as error:
            self._tell(str(error))
            return False
        if count == step.stages:
            return False
        made = deformation.with_step(index, replace(step, stages=count))
        return session.amend(deformation, made, f"Done in {count} stages, so that nothing folds.")

    def _keep_changed(self, change: Any) -> None:
        folds = None if self._shown is None else self._shown.folds
        if change["new"] and folds is not None and folds.least < LEAST:
            self._soon(TrustPanel._unfold)

    def close(self) -> None:
        for link in self._links:
            link.unlink()


def _is_open(panel: TrustPanel) -> bool:
    return not panel._worker.is_closed


def _guarded(method: Callable[[Any], None]) -> Callable[[Any], None]:
    def run(panel: TrustPanel) -> None:
        panel.guard(lambda: method(panel))
    return run

"""Synchronisation of a studio with its session: every change is shown, and what users choose in editors is done."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from deformnb._weak import weakly
from deformnb.document.deformation import Deformation
from deformnb.rbf.extrusion import FRONT_ONLY
from deformnb.session.session import Session
from deformnb.widgets.camera import picture_mode
from deformnb.widgets.inputs.transfer_editor import TransferEditor
from deformnb.widgets.studio.editors import StudioEditors, StudioEdits, StudioPicture, is_front_only
from deformnb.widgets.studio.slices import StudioSlices
from deformnb.widgets.studio.status import StudioStatus
from deformnb.widgets.studio.step_diagnostics import Diagnostics, diagnostics_of
from deformnb.widgets.studio.view_sync import StudioLink
from deformnb.widgets.worker import Worker

_LATER = 2.0  # seconds of rest after which the times of the view are looked at again


def latency_text(edit_ms: float | None, stats: Mapping[str, Any]) -> str:
    """Time that Python took for the last edit, and for a picture of the view in motion; empty for neither.

    Examples
    --------
    >>> latency_text(3.2, {"drag_ms": 41.0})
    'edit 3 ms, volume 41 ms'
    >>> latency_text(None, {"frames": 0})
    ''
    """
    volume_ms = stats.get("drag_ms") or stats.get("frame_ms")
    times = (("edit", edit_ms), ("volume", volume_ms))
    return ", ".join(f"{what} {ms:.0f} ms" if ms >= 1 else f"{what} < 1 ms" for what, ms in times if ms is not None)


def status_text(session: Session, latency: str = "", found: Diagnostics | None = None) -> str:
    """Status line: number of points, edited step, folds and round trip, and the time that these took."""
    step = session.editing.step
    moved = int(np.count_nonzero(session.editing.points.displacement.any(axis=1) & session.editing.points.active))
    facts = [f"{len(session.editing.points)} points, {moved} dragged"]
    if len(session.editing.deformation.steps) > 1:
        facts.append(f"step {session.editing.index + 1} of {len(session.editing.deformation.steps)}")
    if step.extrusion == "interpolate":
        facts.append(f"key {session.editing.key + 1} of {len(step.maps)}")
    if step.stages > 1:
        facts.append(f"{step.stages} stages")
    if found is not None:
        facts += [text for text in (found.folds_text, found.trip_text) if text]
    if latency:
        facts.append(latency)
    return " \u00b7 ".join(facts)


class StudioSync:
    """Between the session of a studio and the parts that show it.

    Parameters
    ----------
    session : is observed, and takes what users choose.
    words : reports errors and shows the status line.
    worker : the studio's thread; nothing is done once it is closed.
    changed : called with each new document.
    """

    def __init__(
        self, session: Session, words: StudioStatus, worker: Worker, changed: Callable[[Deformation], None]
    ) -> None:
        self._session, self._words, self._worker, self._changed = session, words, worker, changed
        self._shown = (session.editing.deformation, session.editing.index, session.editing.key)

    def start(
        self,
        view: Any,
        editors: StudioEditors,
        edits: StudioEdits,
        link: StudioLink,
        picture: StudioPicture,
        slices: StudioSlices,
        opacity: TransferEditor,
        refresh_panels: Callable[[], None],
    ) -> None:
        """Show the session in these parts, from now on each of its changes.

        Parameters
        ----------
        view, editors, link, picture, slices : show it.
        edits : take the points and shapes of the editors.
        opacity : the editor of the opacity curve.
        refresh_panels : has the panels show it.
        """
        self._view, self._editors, self._edits, self._link = view, editors, edits, link
        self._picture, self._slices, self._opacity, self._refresh = picture, slices, opacity, refresh_panels
        session = self._session
        session.editing.observe(self._weakly(StudioSync._document_changed), ["deformation", "index", "key"])
        session.pictures.observe(
            self._weakly(StudioSync._picture_changed), ["method", "depth", "transfer", "channel_displays"]
        )
        session.pictures.observe(self._weakly(StudioSync._window_changed), ["window", "colour_map"])
        session.pictures.observe(self._weakly(StudioSync._transfer_changed), "transfer")
        session.pictures.observe(self._weakly(StudioSync._occlusion_changed), "ambient_occlusion")
        session.editing.observe(self._weakly(StudioSync._send_history), "history")
        session.editing.observe(self._weakly(StudioSync._show_notice), "notice")
        opacity.on_edit(self._weakly(StudioSync._opacity_changed))
        if view.has_trait("projection"):
            view.observe(self._weakly(StudioSync._refresh_panels), "projection")
        if view.has_trait("shows"):
            view.observe(self._weakly(StudioSync._comparison_changed), "shows")
            self._comparison_changed(None)
        picture.turn()
        self._occlusion_changed()
        link.show(editors.current)
        self._words.status.value = status_text(session)
        self._words.show(session.editing.notice)

    def _weakly(self, method: Callable[..., Any]) -> Callable[..., None]:
        return weakly(self, method, StudioSync._is_open)

    def _is_open(self) -> bool:
        return not self._worker.is_closed

    # -- what users choose in an editor --------------------------------------------------------------------------------

    def observe_editor(self, editor: Any) -> None:
        """Take the edits and the selection of a user in an editor."""
        editor.observe(self._weakly(StudioSync._points_changed), "points")
        editor.observe(self._weakly(StudioSync._window_chosen), "window")
        editor.observe(self._weakly(StudioSync._shapes_changed), ["cuts", "parts"])
        if editor.has_trait("slice"):
            editor.observe(self._weakly(StudioSync._slice_chosen), "slice")
            editor.observe(self._weakly(StudioSync._depth_chosen), "front_only")
        editor.on_history(self._weakly(StudioSync._travel))

    def _points_changed(self, change: Any) -> None:
        self._edits.points_changed(change["owner"], change["new"])

    def _shapes_changed(self, change: Any) -> None:
        self._edits.shapes_changed(change["owner"], change["name"], change["new"])

    def _window_chosen(self, change: Any) -> None:
        window = tuple(change["new"]) or None
        self._words.run_guarded(lambda: self._session.pictures.set_trait("window", window))

    def _slice_chosen(self, change: Any) -> None:
        session, slices = self._session, self._session.pictures.slices
        if session.pictures.method == "slice" and slices.index(session.pictures.depth) != change["new"]:
            self._words.run_guarded(lambda: session.pictures.set_trait("depth", slices.depth(change["new"])))

    def _depth_chosen(self, change: Any) -> None:
        session = self._session
        if (
            session.editing.step.plane is None
            or change["new"] is None
            or change["new"] == is_front_only(session.editing.step)
        ):
            return
        depth: dict[str, Any] = (
            {"extrusion": "modulate", "curve": FRONT_ONLY} if change["new"] else {"extrusion": "replicate"}
        )
        self._edits.apply_edit(
            lambda: session.editing.change("in front only" if change["new"] else "at every depth", **depth)
        )

    def _travel(self, way: str) -> None:
        self._edits.travel(way)

    def _opacity_changed(self, transfer: Any, _phase: str) -> None:
        self._words.run_guarded(lambda: self._session.pictures.set_trait("transfer", transfer))

    def _comparison_changed(self, _change: Any) -> None:
        self._editors.plane.shows = picture_mode(self._view.shows)
        self._refresh_panels()

    # -- state of the session ------------------------------------------------------------------------------------------

    def _document_changed(self, _change: Any) -> None:
        session = self._session
        now = (session.editing.deformation, session.editing.index, session.editing.key)
        if now == self._shown:  # the session notifies of each of the three
            return
        self._shown = now
        self._words.show(session.editing.notice)
        if not self._picture.renew():
            self._link.show(self._editors.current)  # first, or the view takes the points for those of the map before
            self._editors.show_step()
            self._picture.request_deformed()
        self._slices.follow()
        self._refresh_panels()
        self.request_status()
        self._words.run_guarded(lambda: self._changed(session.editing.deformation))  # observers of other cells

    def _picture_changed(self, _change: Any = None) -> None:
        self._refresh_panels()
        self._picture.renew()

    def _window_changed(self, _change: Any) -> None:
        self._editors.show_view_state()
        self._picture.request_deformed()
        self._slices.follow()
        self._refresh_panels()

    def _send_history(self, _change: Any) -> None:
        self._editors.set_traits(history=dict(self._session.editing.history))

    def _show_notice(self, _change: Any) -> None:
        if self._session.editing.notice:
            self._words.show(self._session.editing.notice)

    def _transfer_changed(self, _change: Any) -> None:
        function = self._session.pictures.transfer_function
        self._view.set_transfer(function)
        if self._opacity.transfer != function:
            self._opacity.set_transfer(self._session.pictures.transfer)
        self._refresh_panels()

    def _occlusion_changed(self, _change: Any = None) -> None:
        if self._view.has_trait("ambient_occlusion"):
            self._view.ambient_occlusion = self._session.pictures.ambient_occlusion
        self._refresh_panels()

    def _refresh_panels(self, _change: Any = None) -> None:
        self._refresh()

    # -- the status line -----------------------------------------------------------------------------------------------

    def request_status(self) -> None:
        """Write the status line in the studio's thread."""
        self._worker.latest("status", self._weakly(StudioSync._show_status))

    def _show_status(self) -> None:
        self._update_status_line()
        # By then the front end has sent its times.
        self._worker.debounce(_LATER, self._weakly(StudioSync._update_status_line))

    def _update_status_line(self) -> None:
        latency = latency_text(self._edits.milliseconds, self._view.stats())
        self._words.status.value = status_text(self._session, latency, diagnostics_of(self._session))

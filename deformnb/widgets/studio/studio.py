"""Studio: a picture with its control points, the volume that follows them, and the controls, in one line of a cell.

The studio wires and decides nothing: the :class:`Session` holds the document, the editor's front end
fits and warps while the mouse moves, and the view's front end follows it. Python receives the end of an edit, makes the
next document, and does slow work in one thread of its own, the newest first.

The module also builds the parts of a studio: its view, the layout of its widgets, its status line, its still.
"""

from __future__ import annotations

import io
import sys
import threading
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import ipywidgets as ipw
import numpy as np
import traitlets
from numpy.typing import NDArray

from deformnb._weak import weakly
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import FRONT_ONLY
from deformnb.session.exports import export
from deformnb.session.inputs import (
    as_deformation,
    as_volume_and_channels,
    best_view,
    source_of,
    source_of_labels,
    subject_from,
    volume_from,
)
from deformnb.session.session import Session
from deformnb.volume.channels import ChannelsLike
from deformnb.volume.converters import NO_PLACE
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume, VolumeLike
from deformnb.widgets.camera import on_picture
from deformnb.widgets.cell_widgets import (
    close_all,
    close_earlier_of_this_cell,
    closed_on_failure,
    leave_to_another,
    parts_of_another,
)
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.inputs.file_input import FileInput
from deformnb.widgets.inputs.transfer_editor import TransferEditor
from deformnb.widgets.studio.editors import StudioEditors, StudioEdits, StudioPicture, is_front_only, make_editor
from deformnb.widgets.studio.head import StudioHead
from deformnb.widgets.studio.layout import PanelParts, StudioPanels, arranged, make_panels
from deformnb.widgets.studio.save_restore import RestoreBar
from deformnb.widgets.studio.slices import StudioSlices
from deformnb.widgets.studio.status import StudioStatus
from deformnb.widgets.studio.step_diagnostics import Diagnostics, diagnostics_of, warm_up
from deformnb.widgets.studio.view_sync import StudioLink, followed_step
from deformnb.widgets.synced import worded_by_another
from deformnb.widgets.view.base import AbstractView
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.view.stills import PREVIEW_SIZE, as_png, with_png
from deformnb.widgets.worker import Worker
from deformnb.words import language as chosen_language

VIEW_KINDS = ("live", "vtk")
"""Views by name: rendered in the browser, or by VTK in Python."""


def make_view(kind: str | AbstractView, volume: Volume, transfer: Any, height: int) -> Any:
    """A view of the volume by its name in :data:`VIEW_KINDS`, or one that was made by hand."""
    if isinstance(kind, AbstractView):
        if not (isinstance(kind, ipw.DOMWidget) and kind.has_trait("camera")):
            raise DeformError(
                f"a studio cannot show a {type(kind).__name__}; a view of your own must be a widget with "
                "a trait named camera, deformnb.widgets.view.base.CameraTrait()."
            )
        leave_to_another(kind)
        kind.show(volume)
        kind.set_transfer(transfer)
        return kind
    with parts_of_another():
        if kind == "live":
            return LiveView(volume, transfer=transfer, width=720, height=height)
        if kind == "vtk":
            from deformnb.widgets.view.volume_view import VolumeView

            return VolumeView(volume, transfer=transfer, width=720, height=height)
    raise DeformError(f"unknown view {kind!r}; choose one of {', '.join(VIEW_KINDS)}, or give a view.")


def laid_on(given: Any, volume: Volume, name: str) -> Volume | None:
    """A volume of whatever is one; an array, which has no place of its own, lies as another volume does; None of None.

    Parameters
    ----------
    name : what it is: "labels" or "target".

    Raises
    ------
    DeformError
        If it is none, or an array of another shape.
    """
    if given is None:
        return None
    found = volume_from(given)
    if NO_PLACE not in found.notes:
        return found
    if found.shape != volume.shape:
        raise DeformError(
            f"{name} of shape {found.shape} do not lie on a volume of {volume.shape}; give a Volume "
            "with a grid of its own."
        )
    notes = tuple(note for note in found.notes if note != NO_PLACE)
    return Volume(found.values, volume.grid, name, found.is_labels, notes)


def last_step(session: Session, editor: Editor, view: Any) -> tuple[Editor, LiveView]:
    """An editor and a live view of the last step in use, whichever is edited: what a page without Python shows.

    What such a page cannot drag (points in space, steps that are added up) is done to its volume beforehand, and the
    page goes on with a picture of that.
    """
    last = followed_step(session.editing.deformation)
    deformed = None if last is not None else session.results.volume()
    channels = session.results.channels() if deformed and session.channels else session.channels
    pictures = session.pictures
    whole = Session(
        deformed or session.volume,
        None if deformed else session.editing.deformation,
        view=session.editing.plane,
        channels=channels,
        channel_displays=pictures.channel_displays,
        method=pictures.method,
        window=pictures.window,
        colour_map=pictures.colour_map,
    )
    whole.editing.edit_step(last or 0)
    shown = make_editor(whole, editor.height)
    shown.density, shown.theme, shown.shows = editor.density, editor.theme, on_picture(view.shows)
    with parts_of_another():
        live = LiveView(whole.volume, transfer=pictures.transfer_function, width=view.width, height=view.height)
    live.camera, live.shows, live.clip = dict(view.camera), view.shows, view.clip
    for name in ("projection", "background", "show_folds", "ambient_occlusion"):
        if view.has_trait(name):
            setattr(live, name, getattr(view, name))
    live.follow(shown, whole.results.field(), whole.editing.key, output=whole.results.grid)
    return shown, live


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


def side_by_side(editor: Any, view: AbstractView, width: int) -> NDArray[np.uint8]:
    """Picture and volume as an image, (height, width, 3)."""
    from PIL import Image

    left = Image.open(io.BytesIO(editor.preview_png())).convert("RGB")
    height = round(width / 2 * left.height / left.width)
    left = left.resize((width // 2, height), Image.Resampling.LANCZOS)
    return np.concatenate([np.asarray(left), view.still((width - width // 2, height))], axis=1)


def preview_png(editor: Any, view: Any) -> bytes:
    """Picture and volume side by side as a PNG, from few voxels: it is made before the studio is shown."""
    from PIL import Image

    left = Image.open(io.BytesIO(editor.preview_png())).convert("RGB")
    small = view.preview_png() if hasattr(view, "preview_png") else as_png(view.still(PREVIEW_SIZE))
    right = Image.open(io.BytesIO(small)).convert("RGB")
    left = left.resize((right.width, round(right.width / left.width * left.height)), Image.Resampling.LANCZOS)
    whole = Image.new("RGB", (left.width + right.width, max(left.height, right.height)), left.getpixel((0, 0)))
    for image, x in ((left, 0), (right, left.width)):
        whole.paste(image, (x, (whole.height - image.height) // 2))
    return as_png(np.asarray(whole))


_PARTS = (
    "session",
    "view",
    "_shown",
    "_words",
    "_worker",
    "_edits",
    "_editors",
    "_link",
    "_picture",
    "_slices",
    "_opacity",
    "_panels",
    "_bar",
)  # attributes that are replaced with the session


def _end(parts: Mapping[str, Any]) -> None:
    """End what runs of the parts of a studio, whatever there is of them by now."""
    for name in ("_worker", "_link", "_slices", "_editors"):
        if name in parts:
            parts[name].close()
    if "_opacity" in parts:
        close_all(parts["_opacity"])  # it is in no box before its panel is seen
    if "_panels" in parts:
        for part in (*parts["_panels"].made, parts["_panels"].wand):
            part.close()


_LATER = 2.0  # seconds of rest after which the times of the view are looked at again


class Studio(ipw.VBox):  # type: ignore[misc]  # ipywidgets has no types
    """Deform a volume by dragging points on a picture of it.

    Parameters
    ----------
    volume : what is deformed: a :class:`~deformnb.volume.volume.Volume`, an array [z, y, x], or the path of a file; or
        :class:`~deformnb.volume.channels.Channels`, which pictures show in their colours, added up.
    deformation : to go on with; a :class:`~deformnb.document.deformation.Deformation` or the path of a saved one.
    side : where the first picture is taken from, one of :data:`VIEWS`; default is the side that shows
        most of the subject.
    method : projection of the picture, a name of :data:`~deformnb.imaging.projection.PROJECTIONS`.
    transfer : colours and opacities of the volume: a transfer function, or the name of a preset. Both are by default as
        the deformation was saved, or else "mip" and "specimen".
    view : "live" renders in the browser, "vtk" in Python; or a view of your own.
    height : of the panes and the panel together, in CSS pixels.
    folder : where files are saved and opened by the controls.
    labels : numbered parts of the volume, such as bones: a volume, an array as large as the volume, or a file. Their
        regions can be made rigid or cut out; label_names : what the numbers are called.
    target : what the volume shall look like: a volume, an array as large, or a file, chosen in the panel "Fit".
    output : grid of the result, which is what can be seen; default is the document's, or the volume's own. See
        :meth:`Results.grow <deformnb.session.results.Results.grow>` and :meth:`Results.fit_output
        <deformnb.session.results.Results.fit_output>`.
    language : of what is seen, "en" or "de"; default is the one of :func:`deformnb.set_language`.

    Attributes
    ----------
    session : the document and its history.
    editor, view : the widgets on the left and on the right; the editor is another one for a step in space.
    deformation : the document; an observable trait, and setting it is an edit.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> studio = Studio(PHANTOMS["bar"].make((24, 24, 48)))
    >>> studio.editor.points = studio.editor.points.add([20.0, 10.0], [20.0, 13.0])
    >>> studio.deformation.steps[0].points.names
    ('corner', 'corner', 'corner', 'corner', '')
    >>> studio.undo()
    >>> len(studio.editor.points)
    4
    >>> studio.close()
    """

    children: Any
    deformation = traitlets.Instance(Deformation)

    def __init__(
        self,
        volume: ChannelsLike,
        deformation: Deformation | str | PathLike[str] | None = None,
        *,
        side: str | Plane | None = None,
        method: str | None = None,
        transfer: Any = None,
        view: str | AbstractView = "live",
        height: int = 600,
        folder: str | PathLike[str] = ".",
        labels: VolumeLike | None = None,
        label_names: Mapping[int, str] | None = None,
        target: VolumeLike | None = None,
        output: Grid | VolumeLike | None = None,
        language: str | None = None,
    ) -> None:
        self._language = chosen_language(language)
        given, channels = as_volume_and_channels(subject_from(volume))
        look = {name: value for name, value in (("method", method), ("transfer", transfer)) if value is not None}
        session = Session(
            given,
            as_deformation(deformation),
            view=side or best_view(given),
            output=output,
            channels=channels,
            source=source_of(volume),
            **look,
        )
        if isinstance(deformation, (str, PathLike)):
            session.files.known.remember(deformation)
        self._options = view, height, folder
        self._begin(session, laid_on(labels, given, "labels"), label_names, laid_on(target, given, "target"))

    def _begin(
        self,
        session: Session,
        labels: Volume | None = None,
        label_names: Mapping[int, str] | None = None,
        target: Volume | None = None,
    ) -> None:
        """Make the parts of a studio for a session; where that fails the parts before, if any, stay as they were."""
        before = {name: self.__dict__.pop(name) for name in _PARTS if name in self.__dict__}
        self.session = session
        self._shown = (session.editing.deformation, session.editing.index, session.editing.key)
        self._words = StudioStatus()
        self._worker = Worker("deformnb-studio", failed=self._words.failed)
        is_whole = threading.Event()
        self._worker.call(is_whole.wait)  # nothing is done for half a studio
        try:
            with closed_on_failure(lambda: _end(vars(self))), worded_by_another():  # by the head
                self._make(before, labels, label_names, target)
        except BaseException:
            close_all(self._words.box, self._words.notice, self._words.status)
            self.__dict__.update(before)
            raise
        finally:
            is_whole.set()
        self._request_status()
        if before:
            self._warm_up_when_shown()

    def _make(
        self,
        before: Mapping[str, Any],
        labels: Volume | None,
        label_names: Mapping[int, str] | None,
        target: Volume | None,
    ) -> None:
        """Make the parts; once all are there, take the place of those before, or of what the cell has shown before."""
        view, height, folder = self._options
        self._edits = StudioEdits(self.session, self._words, self._weakly(Studio._request_status))
        self.view = make_view(view, self.volume, self.session.pictures.transfer_function, height)
        self._editors = StudioEditors(self.session, height, self._listen_to)
        self._link = StudioLink(self.session, self.view, self._worker)
        self._picture = StudioPicture(
            self.session, self._editors, self._link, self.view, self._worker, self._weakly(Studio.undo)
        )
        self._edits.take_edits_from(self._editors, self._picture)
        self._slices = StudioSlices(self.session, self._link, self._editors.plane, self._worker, self._editors.beside)
        kept = before["_panels"].opening.box if before else None
        self._panels = panels = self._make_panels(folder, labels, label_names, target, kept)
        head = StudioHead(
            self.session, self._edits.edited, self._words.show, folder, self._worker.call, language=self._language
        )
        file_input, *rows = arranged(head, self._editors, self.view, panels, self._words, height)
        if before:
            self._leave(before)
            panels.history.lead_back(before["session"], self._weakly(Studio._open_session))
        else:
            close_earlier_of_this_cell(self)
        self._bar = RestoreBar(self.session, self._edits.edited, self._words.show)  # finds what that one has left
        panels.history.recovery = self._bar.recovery
        panels.opening.begin()
        self._words.box.children = (self._picture.ways_on, self._words.notice)
        if before:
            (_, *shown), self.children = self.children, (file_input, self._bar, *rows)
            close_all(*shown)
        else:
            super().__init__([file_input, self._bar, *rows], layout=ipw.Layout(width="100%", max_width="1600px"))
            self.add_class("dnb-studio")
        self.deformation = self.session.editing.deformation
        self._listen()
        self._picture.turn()
        self._occlusion_changed()
        self._link.show(self._editors.current)
        self._words.status.value = status_text(self.session)
        self._words.show(self.session.editing.notice)

    def _leave(self, before: Mapping[str, Any]) -> None:
        """End the parts that are replaced; the edits that are in no file are written by the autosave."""
        _end(before)
        before["_bar"].close()
        if before["view"] is self.view:
            before["_editors"].beside.children = ()

    # -- the parts -----------------------------------------------------------------------------------------------------

    def _make_panels(
        self,
        folder: str | PathLike[str],
        labels: Volume | None,
        names: Mapping[int, str] | None,
        target: Volume | None,
        file_input: FileInput | None,
    ) -> StudioPanels:
        self._opacity = TransferEditor(self.session.volume, self.session.pictures.transfer, worker=self._worker)
        return make_panels(
            PanelParts(
                self.session,
                self._edits.edited,
                self.view,
                self._editors,
                self._worker,
                self._slices,
                self._opacity,
                folder,
                self.export_html,
                labels,
                names,
                target,
                self._link.preview,
                self._weakly(Studio.open_volume),
                self._weakly(Studio._decide_labels),
                file_input,
            )
        )

    # -- what happens --------------------------------------------------------------------------------------------------

    def _listen(self) -> None:
        session = self.session
        session.editing.observe(self._weakly(Studio._document_changed), ["deformation", "index", "key"])
        session.pictures.observe(
            self._weakly(Studio._picture_changed), ["method", "depth", "transfer", "channel_displays"]
        )
        session.pictures.observe(self._weakly(Studio._window_changed), ["window", "colour_map"])
        session.pictures.observe(self._weakly(Studio._transfer_changed), "transfer")
        session.pictures.observe(self._weakly(Studio._occlusion_changed), "ambient_occlusion")
        session.editing.observe(self._weakly(Studio._send_history), "history")
        session.editing.observe(self._weakly(Studio._show_notice), "notice")
        self._opacity.on_edit(self._weakly(Studio._opacity_changed))
        if self.view.has_trait("projection"):
            self.view.observe(self._weakly(Studio._refresh_panels), "projection")
        if self.view.has_trait("shows"):
            self.view.observe(self._weakly(Studio._comparison_changed), "shows")
            self._comparison_changed(None)

    def _listen_to(self, editor: Any) -> None:
        editor.observe(self._weakly(Studio._points_changed), "points")
        if editor.has_trait("cuts"):
            editor.observe(self._weakly(Studio._shapes_changed), ["cuts", "parts"])
            editor.observe(self._weakly(Studio._window_chosen), "window")
            editor.observe(self._weakly(Studio._slice_chosen), "slice")
            editor.observe(self._weakly(Studio._depth_chosen), "front_only")
        editor.on_history(self._weakly(Studio._travel))

    def _weakly(self, method: Callable[..., Any]) -> Callable[..., None]:
        worker = self._worker  # each session has its own
        return weakly(self, method, lambda studio: studio._worker is worker and not worker.is_closed)  # noqa: SLF001

    def _points_changed(self, change: Any) -> None:
        self._edits.points_changed(change["owner"], change["new"])

    def _shapes_changed(self, change: Any) -> None:
        self._edits.shapes_changed(change["owner"], change["name"], change["new"])

    def _window_chosen(self, change: Any) -> None:
        window = tuple(change["new"]) or None
        self._words.guarded(lambda: self.session.pictures.set_trait("window", window))

    def _slice_chosen(self, change: Any) -> None:
        session, slices = self.session, self.session.pictures.slices
        if session.pictures.method == "slice" and slices.index(session.pictures.depth) != change["new"]:
            self._words.guarded(lambda: session.pictures.set_trait("depth", slices.depth(change["new"])))

    def _depth_chosen(self, change: Any) -> None:
        session = self.session
        if (
            session.editing.step.plane is None
            or change["new"] is None
            or change["new"] == is_front_only(session.editing.step)
        ):
            return
        depth: dict[str, Any] = (
            {"extrusion": "modulate", "curve": FRONT_ONLY} if change["new"] else {"extrusion": "replicate"}
        )
        self._edits.edited(
            lambda: session.editing.change("in front only" if change["new"] else "at every depth", **depth)
        )

    def _window_changed(self, _change: Any) -> None:
        self._editors.show_view_state()
        self._slices.follow()
        self._refresh_panels()

    def _comparison_changed(self, _change: Any) -> None:
        self._editors.plane.shows = on_picture(self.view.shows)
        self._refresh_panels()

    def _travel(self, way: str) -> None:
        self._edits.travel(way)

    def _document_changed(self, _change: Any) -> None:
        now = (self.session.editing.deformation, self.session.editing.index, self.session.editing.key)
        if now == self._shown:  # the session notifies of each of the three
            return
        self._shown = now
        self._words.show(self.session.editing.notice)
        if not self._picture.renew():
            self._link.show(self._editors.current)  # first, or the view takes the points for those of the map before
            self._editors.show_step()
        self._slices.follow()
        self._refresh_panels()
        self._request_status()
        self._words.guarded(
            lambda: self.set_trait("deformation", self.session.editing.deformation)
        )  # observers of other cells

    @traitlets.validate("deformation")
    def _valid_deformation(self, proposal: Any) -> Deformation:
        if proposal["value"] is not self.session.editing.deformation:
            self.session.editing.deformation = proposal["value"]
        return self.session.editing.deformation

    def _picture_changed(self, _change: Any = None) -> None:
        self._refresh_panels()
        self._picture.renew()

    def _send_history(self, _change: Any) -> None:
        self._editors.set_traits(history=dict(self.session.editing.history))

    def _show_notice(self, _change: Any) -> None:
        if self.session.editing.notice:
            self._words.show(self.session.editing.notice)

    def _transfer_changed(self, _change: Any) -> None:
        function = self.session.pictures.transfer_function
        self.view.set_transfer(function)
        if self._opacity.transfer != function:
            self._opacity.set_transfer(self.session.pictures.transfer)
        self._refresh_panels()

    def _occlusion_changed(self, _change: Any = None) -> None:
        if self.view.has_trait("ambient_occlusion"):
            self.view.ambient_occlusion = self.session.pictures.ambient_occlusion
        self._refresh_panels()

    def _opacity_changed(self, transfer: Any, _phase: str) -> None:
        self._words.guarded(lambda: self.session.pictures.set_trait("transfer", transfer))

    def _refresh_panels(self, _change: Any = None) -> None:
        for panel in self._panels.made:
            panel.refresh()

    def _request_status(self) -> None:
        self._worker.latest("status", self._weakly(Studio._show_status))

    def _show_status(self) -> None:
        self._update_status_line()
        # By then the front end has sent its times.
        self._worker.at_rest(_LATER, self._weakly(Studio._update_status_line))

    def _update_status_line(self) -> None:
        latency = latency_text(self._edits.milliseconds, self.view.stats())
        self._words.status.value = status_text(self.session, latency, diagnostics_of(self.session))

    # -- for other cells -----------------------------------------------------------------------------------------------

    @property
    def editor(self) -> Any:
        """The editor of the step that is edited: an :class:`Editor` on a picture or a :class:`SpaceEditor` in space."""
        return self._editors.current

    @property
    def volume(self) -> Volume:
        """The volume as it was given."""
        return self.session.volume

    def result(self, progress: Callable[[float], None] | None = None) -> Volume:
        """The deformed volume, on the grid ``session.editing.output``."""
        return self.session.results.volume(progress)

    def undo(self) -> None:
        """Take back the last edit."""
        self._travel("undo")

    def redo(self) -> None:
        """Do again what was taken back."""
        self._travel("redo")

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the document as JSON; see :meth:`Session.save <deformnb.session.session.Session.save>`."""
        self.session.save(path, overwrite=overwrite)

    def load(self, path: str | PathLike[str], *, allow_other_volume: bool = False) -> None:
        """Go on with a saved document; can be undone."""
        self.session.open(path, allow_other_volume=allow_other_volume)

    def open_volume(
        self,
        volume: ChannelsLike,
        deformation: Deformation | str | PathLike[str] | None = None,
        *,
        side: str | Plane | None = None,
    ) -> None:
        """Go on with another volume in this place, with a session, an editor and a view of its own.

        The edits of the volume before are kept: the menu "History" leads back to them, also when the other volume is
        opened again later.

        Parameters
        ----------
        volume, deformation, side : as of the studio.

        Raises
        ------
        DeformError
            If it cannot be opened; everything stays as it was.

        Examples
        --------
        >>> from deformnb.datasets import PHANTOMS
        >>> studio = Studio(PHANTOMS["bar"].make((8, 8, 8)))
        >>> studio.open_volume(PHANTOMS["fish"].make((8, 8, 16)))
        >>> studio.volume.name
        'carp (phantom)'
        >>> studio.close()
        """
        given, channels = as_volume_and_channels(subject_from(volume))
        session = Session(
            given,
            as_deformation(deformation),
            view=side or best_view(given),
            channels=channels,
            source=source_of(volume),
        )
        if isinstance(deformation, (str, PathLike)):
            session.files.known.remember(deformation)
        self._open_session(session)

    def _decide_labels(self, is_labels: bool) -> None:
        """Go on with the voxels as labels, with all edits; or with them as amounts, which they are so far."""
        session = self.session
        if is_labels:
            self._open_session(
                Session(
                    session.volume.decided(True),
                    session.pictures.view_state.added_to(session.editing.deformation),
                    view=session.editing.plane,
                    source=source_of_labels(session.files.source),
                )
            )
        self.session.editing.notice = (
            "The voxels are labels: each keeps its number."
            if is_labels
            else "The voxels are amounts: values between them are blended."
        )

    def _open_session(self, session: Session) -> None:
        before = self.session
        self._words.show(f"Opening {session.volume.name or 'the volume'} \u2026")
        with parts_of_another():
            self._begin(session)
        name = before.volume.name or "the volume before"
        self.session.editing.notice = f"{session.volume.name or 'The volume'} is open; History leads back to {name}."

    def export(
        self,
        path: str | PathLike[str],
        progress: Callable[[float], None] | None = None,
        *,
        size: tuple[int, int] | None = None,
        fps: float = 24.0,
        overwrite: bool = False,
    ) -> Path:
        """Write a file; its suffix chooses what: see :data:`EXPORTS`, and ``.html`` for a page.

        Parameters
        ----------
        progress : called with the finished share from 0 to 1; may raise :class:`~deformnb.errors.Cancelled`.
        size : (width, height) in pixels of renderings and movies, which show what the view shows: its camera,
            projection, clip, background, and whether the original stands beside; default is 1600 x 1200, and 640 x 480
            for movies.
        fps : pictures a second of movies.
        overwrite : replace any file; else only one that holds what this studio has opened or written.
        """
        if Path(path).suffix.lower() == ".html":
            self.export_html(path, overwrite=overwrite, progress=progress)
            return Path(path)
        return export(
            self.session, path, seen=self.view.seen(), size=size, fps=fps, overwrite=overwrite, progress=progress
        )

    def export_html(
        self,
        path: str | PathLike[str],
        *,
        title: str = "",
        about: str = "",
        limit: int | None = None,
        controls: Iterable[str] | None = None,
        overwrite: bool = False,
        progress: Callable[[float], None] | None = None,
    ) -> None:
        """Write one offline file in which the volume still deforms, without a kernel.

        Parameters
        ----------
        title, about : of the page; a line under the title.
        limit : voxels in the file at most; a larger volume is averaged, which the page reports. Default is 256^3, and
            fewer where these would take more than 10 MB.
        controls : names of :data:`~deformnb.widgets.standalone.CONTROLS` that the page has; default is all.
        overwrite, progress : as of :meth:`export`.
        """
        from deformnb.widgets.standalone import CONTROLS, write_standalone

        editor, view = last_step(self.session, self._editors.plane, self.view)
        try:
            with self.session.files.known.writing(path, overwrite=overwrite):
                write_standalone(
                    path,
                    editor,
                    view,
                    title=title or self.volume.name,
                    about=about,
                    language=self._language,
                    limit=limit,
                    controls=CONTROLS if controls is None else controls,
                    progress=progress,
                )
        finally:
            close_all(editor)
            close_all(view)

    def stats(self) -> dict[str, Any]:
        """Measurements: ``edit_ms`` and ``picture_ms`` in Python, counts of edits, and the view's own figures.

        ``previews`` counts the displacements that Python made while something was dragged. ``editor`` has the rate at
        which the picture followed the pointer in the last drag: ``drag_hz`` and ``picture_ms``, of
        :meth:`Editor.stats <deformnb.widgets.Editor.stats>`.
        """
        times = {"edit_ms": self._edits.milliseconds, "picture_ms": self._picture.milliseconds}
        return {
            **times,
            **self._edits.counts,
            "previews": self._link.previews,
            "editor": self.editor.stats(),
            "view": self.view.stats(),
        }

    def show_session(self) -> None:
        """Show what the session holds, in place of a drag that will not end because its page has gone."""
        self._link.show(self.editor)
        self._editors.show_step()
        self.view.set_transfer(self.session.pictures.transfer_function)

    def wait(self, timeout: float = 60.0) -> None:
        """Wait until the work of the studio's thread is done, pictures among it. For scripts and tests."""
        done = threading.Event()

        def look() -> None:
            if self._worker.is_wanted and not self._worker.is_closed:
                self._worker.latest("wait", look)  # behind what the work itself has requested
            else:
                done.set()

        self._worker.latest("wait", look)
        if not done.wait(timeout):
            raise TimeoutError(f"the studio is still at work after {timeout:g} seconds.")

    def warm_up(self) -> None:
        """Import JAX and compile for the first edits, in the studio's thread; done once the view has its voxels."""
        if not self._worker.is_closed:
            self._worker.latest("warm up", partial(warm_up, self.session))

    def _warm_up_when_shown(self) -> None:
        if isinstance(self.view, LiveView):
            self.view.source.when_sent(self._weakly(Studio.warm_up))
        else:
            self.warm_up()

    def hand_on(self, other: Any) -> None:
        """Leave a view that another studio of the same cell was given as well to that one."""
        if getattr(other, "view", None) is self.view:
            self._editors.beside.children = ()

    def close(self) -> None:
        """End the studio with all its widgets and its threads; the next one's History has what was not saved.

        ipywidgets keeps a studio that is not closed, with its volume, though no variable names it: a page may show it.
        Its threads end when nothing is to be done, and each edit is written as before.
        """
        worker = getattr(self, "_worker", None)  # ipywidgets closes again when the object goes, also a half-made one
        if worker is None or worker.is_closed:
            super().close()
            return
        _end(vars(self))
        close_all(*self.children, self.layout)
        super().close()

    # -- display -------------------------------------------------------------------------------------------------------

    def still(self, width: int = 1120) -> NDArray[np.uint8]:
        """Picture and volume side by side, (height, width, 3): what is seen where no front end runs."""
        return side_by_side(self.editor, self.view, width)

    def __repr__(self) -> str:
        z, y, x = self.volume.shape
        return f"Studio({self.volume.name or 'volume'} {x} x {y} x {z}, {len(self.deformation.steps)} steps)"

    def _display_(self) -> Any:
        """Display in marimo, which has anywidgets but no boxes, sliders and tabs: picture and volume."""
        marimo = sys.modules["marimo"]  # which calls this: it is there, and is needed here only

        self._warm_up_when_shown()
        both = (self.editor, self.view)
        for shown in both:  # no pane is around them, whose height they would take
            if shown.has_trait("fill"):
                shown.fill = False
        half = {"width": "0", "min-width": "100%"}  # of what is there: the view asks for more than its half
        return marimo.hstack([marimo.as_html(shown).style(half) for shown in both], widths="equal", align="start")

    def _repr_mimebundle_(self, **options: Any) -> Any:
        bundle = with_png(super()._repr_mimebundle_(**options), lambda: preview_png(self.editor, self.view))
        self._warm_up_when_shown()
        return bundle

"""The studio: picture with its control points, the volume that follows them, and the controls, in one line of a cell.

The studio wires and decides nothing: the :class:`~deformnb.session.Session` holds the document, the editor's page
fits and warps while the mouse moves, and the view's page follows it. Python hears of the end of an edit, makes the next
document, and does whatever takes time in one thread of its own, the newest first.
"""

from __future__ import annotations

import html
import logging
import threading
import time
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import ipywidgets as ipw
import numpy as np
import traitlets
from numpy.typing import NDArray

from deformnb.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.exports import export
from deformnb.opening import as_deformation, as_volume, best_view
from deformnb.plane import Plane
from deformnb.session import Session
from deformnb.volume import Volume
from deformnb.widgets import studio_parts as parts
from deformnb.widgets.cell_widgets import close_all, close_earlier_of_this_cell, weakly
from deformnb.widgets.controls import Panel
from deformnb.widgets.judgement import judgement_of
from deformnb.widgets.point_labels import JOINING, edit_label
from deformnb.widgets.restore_bar import RestoreBar
from deformnb.widgets.shape_messages import checked_shapes, shapes_of
from deformnb.widgets.static_picture import with_png
from deformnb.widgets.stills import as_png
from deformnb.widgets.studio_editors import StudioEditors
from deformnb.widgets.studio_link import StudioLink
from deformnb.widgets.studio_panels import PanelParts, make_panels
from deformnb.widgets.transfer_editor import TransferEditor
from deformnb.widgets.view import AbstractView
from deformnb.widgets.worker import Worker

_LOG = logging.getLogger(__name__)


class Studio(ipw.VBox):  # type: ignore[misc]  # ipywidgets has no types
    """Deform a volume by dragging points on a picture of it.

    Parameters
    ----------
    volume : what is deformed: a :class:`~deformnb.volume.Volume`, an array [z, y, x], or the path of a file.
    deformation : to go on with; a :class:`~deformnb.deformation.Deformation` or the path of a saved one.
    side : where the first picture is taken from, one of :data:`~deformnb.plane.VIEWS`; default is the side that shows
        most of the subject.
    method : projection of the picture, a name of :data:`~deformnb.picture.PROJECTIONS`.
    transfer : colours and opacities of the volume: a transfer function, or the name of a preset.
    view : "live" renders in the browser, "vtk" in Python; or a view of your own.
    height : of picture and volume in CSS pixels.
    folder : where files are saved and opened by the controls.
    labels : numbered parts of the volume, such as bones: a volume, an array as large as the volume, or a file. Their
        regions can be made rigid or cut out; label_names : what the numbers are called.
    target : what the volume shall look like: a volume, an array as large, or a file, chosen in the panel "Fit".

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

    deformation = traitlets.Instance(Deformation)

    def __init__(self, volume: Volume | NDArray[Any] | str | PathLike[str],
                 deformation: Deformation | str | PathLike[str] | None = None, *, side: str | Plane | None = None,
                 method: str = "mip", transfer: Any = "specimen", view: str | AbstractView = "live", height: int = 430,
                 folder: str | PathLike[str] = ".", labels: Volume | NDArray[Any] | str | PathLike[str] | None = None,
                 label_names: Mapping[int, str] | None = None,
                 target: Volume | NDArray[Any] | str | PathLike[str] | None = None) -> None:
        given = as_volume(volume)
        close_earlier_of_this_cell(self)
        self.session = Session(given, as_deformation(deformation), view=side or best_view(given), method=method,
                               transfer=transfer)
        self.deformation = self.session.deformation
        self._shown = (self.session.deformation, self.session.index, self.session.key)
        self._panels: list[Panel] = []
        self._worker = Worker("deformnb-studio")
        self._times: dict[str, float] = {}
        self._count = {"edits": 0, "refused": 0, "late": 0}
        self.view = parts.make_view(view, given, self.session.transfer_function, height)
        self._editors = StudioEditors(self.session, height, self._listen_to)
        self._pictured = self._picture_key()
        self._link = StudioLink(self.session, self.view, self._worker)
        self._status = ipw.Label("", layout=ipw.Layout(flex="1 1 auto", min_width="0"))
        self._notice = ipw.HTML("", layout=ipw.Layout(flex="1 1 400px", min_width="0"))  # a label would cut long words
        self._panels = self._make_panels(folder, parts.as_labels(labels, given), label_names,
                                         parts.as_target(target, given))
        self._bar = RestoreBar(self.session, self._edited, self._weakly(Studio._say))
        arranged = parts.arranged(self._editors, self.view, self._panels, [self._status, self._notice])
        super().__init__([self._bar, *arranged], layout=ipw.Layout(width="100%", max_width="1600px"))
        self.add_class("dnb-studio")
        self._listen()
        self._link.turn()
        self._link.show(self._editors.current)
        self._status.value = parts.status_text(self.session, None)
        if not any(m.displacement.any() for step in self.deformation.steps for m in step.maps):
            self._say(parts.WELCOME)
        self._worker.latest("warm up", self.session.warm_up)
        self._worker.latest("status", self._weakly(Studio._show_status))

    # -- the parts -----------------------------------------------------------------------------------------------------

    def _make_panels(self, folder: str | PathLike[str], labels: Volume | None,
                     names: Mapping[int, str] | None, target: Volume | None) -> list[Panel]:
        self._opacity = TransferEditor(self.session.volume, self.session.transfer)
        return make_panels(PanelParts(self.session, self._edited, self.view, self._editors, self._worker, self._opacity,
                                      folder, self.export_html, labels, names, target))

    # -- what happens --------------------------------------------------------------------------------------------------

    def _listen(self) -> None:
        session = self.session
        session.observe(self._weakly(Studio._document_changed), ["deformation", "index", "key"])
        session.observe(self._weakly(Studio._picture_changed), ["method", "depth", "transfer"])
        session.observe(self._weakly(Studio._transfer_changed), "transfer")
        session.observe(self._weakly(Studio._tell_history), "history")
        session.observe(self._weakly(Studio._tell_notice), "notice")
        self._opacity.on_edit(self._weakly(Studio._opacity_changed))
        for name in ("shows", "projection"):
            if self.view.has_trait(name):
                self.view.observe(self._weakly(Studio._refresh_panels), name)

    def _listen_to(self, editor: Any) -> None:
        editor.observe(self._weakly(Studio._points_changed), "points")
        if editor.has_trait("cuts"):
            editor.observe(self._weakly(Studio._shapes_changed), ["cuts", "parts"])
        editor.on_history(self._weakly(Studio._travel))

    def _weakly(self, method: Callable[..., Any]) -> Callable[..., None]:
        return weakly(self, method, lambda studio: not studio._worker.is_closed)

    def _edited(self, action: Callable[[], None]) -> bool:
        """Do what a user asked for; what was said of the edit before goes."""
        self._say("")
        return self._guarded(action)

    def _guarded(self, action: Callable[[], None]) -> bool:
        """Do something that may go wrong, and say it in the page if it does."""
        try:
            action()
        except DeformError as error:
            self._say(str(error), is_error=True)
            return False
        except Exception as error:
            _LOG.exception("an action of the studio failed")
            self._say(f"{type(error).__name__}: {error}", is_error=True)
            return False
        return True

    def _say(self, text: str, *, is_error: bool = False) -> None:
        colour = "color: var(--jp-error-color1, #c62828)" if is_error else "opacity: 0.85"
        shown = f'<div role="status" style="{colour}; line-height: 1.35">{html.escape(text)}</div>'
        self._notice.value = shown if text else ""

    def _points_changed(self, change: Any) -> None:
        editor, points = change["owner"], change["new"]
        if points == self.session.points:
            return
        made = editor.edit_under_way
        done = made.kind if made is not None else ""
        kind = done if done in JOINING else None
        label = edit_label(self.session.points, points, done) if points.dim == self.session.points.dim else ""
        self._take(editor, lambda: self.session.edit_points(points, label, kind))

    def _shapes_changed(self, change: Any) -> None:
        editor, what = change["owner"], change["name"]
        if checked_shapes(what, getattr(self.session.step, what)) == change["new"]:
            return
        made, shapes = editor.edit_under_way, shapes_of(what, change["new"])
        label = made.kind if made is not None else f"change {'cuts' if what == 'cuts' else 'rigid parts'}"
        edit = self.session.edit_cuts if what == "cuts" else self.session.edit_parts
        self._take(editor, lambda: edit(shapes, label))

    def _take(self, editor: Any, edit: Callable[[], None]) -> None:
        """Do what was done in an editor; if it cannot be, the editor shows again what the session holds."""
        if self._pictured != self._picture_key() or editor is not self._editors.current:
            self._count["late"] += 1  # a drag on a picture that is being replaced
            self._ask_for_picture()
            return
        start = time.perf_counter()
        if not self._edited(edit):
            self._count["refused"] += 1
            self._editors.show_step()
        self._count["edits"] += 1
        self._times["edit_ms"] = (time.perf_counter() - start) * 1e3

    def _travel(self, way: str) -> None:
        self._say("")
        what = self.session.undo() if way == "undo" else self.session.redo()
        if what:
            self._say(f"{'Undone' if way == 'undo' else 'Done again'}: {what}")

    def _document_changed(self, _change: Any) -> None:
        now = (self.session.deformation, self.session.index, self.session.key)
        if now == self._shown:  # the session tells of each of the three
            return
        self._shown = now
        self._say(self.session.notice)
        if self._pictured != self._picture_key():
            self._ask_for_picture()
        else:
            self._link.show(self._editors.current)  # first, or the view takes the points for those of the map before
            self._editors.show_step()
        self._refresh_panels()
        self._worker.latest("status", self._weakly(Studio._show_status))
        self._guarded(lambda: self.set_trait("deformation", self.session.deformation))  # observers of other cells

    @traitlets.validate("deformation")
    def _valid_deformation(self, proposal: Any) -> Deformation:
        if proposal["value"] is not self.session.deformation:
            self.session.deformation = proposal["value"]
        return self.session.deformation

    def _picture_key(self) -> Any:
        """What the picture depends on: the steps before the one being edited, its plane, and how it is projected."""
        s = self.session
        return (s.index, s.deformation.steps[: s.index], s.step.plane, s.method,
                s.depth if s.method == "slice" else 0.0, s.deformation.mode,
                s.transfer if s.method in ("composite", "shaded") else None)

    def _picture_changed(self, _change: Any = None) -> None:
        self._refresh_panels()
        if self._pictured != self._picture_key():
            self._ask_for_picture()

    def _ask_for_picture(self) -> None:
        self._editors.tell(waiting="The picture is being made")  # no gesture shall be made on the old one
        self._worker.latest("picture", self._weakly(Studio._show_picture))

    def _show_picture(self) -> None:
        key = self._picture_key()
        self._guarded(lambda: self._set_picture(key))
        if key == self._picture_key():
            self._editors.tell(waiting="")

    def _set_picture(self, key: Any) -> None:
        start = time.perf_counter()
        made = self._editors.make_picture()
        if self._pictured is not None and self._pictured[2] != key[2]:
            self._link.turn()
        self._link.show(self._editors.current)
        self._pictured = key
        self._editors.show_picture(made)
        self._times["picture_ms"] = (time.perf_counter() - start) * 1e3

    def _tell_history(self, _change: Any) -> None:
        self._editors.tell(history=dict(self.session.history))

    def _tell_notice(self, _change: Any) -> None:
        if self.session.notice:
            self._say(self.session.notice)

    def _transfer_changed(self, _change: Any) -> None:
        function = self.session.transfer_function
        self.view.set_transfer(function)
        if self._opacity.transfer != function:
            self._opacity.set_transfer(self.session.transfer)

    def _opacity_changed(self, transfer: Any, _phase: str) -> None:
        self._guarded(lambda: self.session.set_trait("transfer", transfer))

    def _refresh_panels(self, _change: Any = None) -> None:
        for panel in self._panels:
            panel.refresh()

    def _show_status(self) -> None:
        self._status.value = parts.status_text(self.session, self._times.get("edit_ms"), judgement_of(self.session))

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
        """The deformed volume."""
        return self.session.result(progress)

    def undo(self) -> None:
        """Take back the last edit."""
        self._travel("undo")

    def redo(self) -> None:
        """Do again what was taken back."""
        self._travel("redo")

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the document as JSON; see :meth:`Session.save <deformnb.session.Session.save>`."""
        self.session.save(path, overwrite=overwrite)

    def load(self, path: str | PathLike[str], *, allow_other_volume: bool = False) -> None:
        """Go on with a saved document; can be undone."""
        self.session.open(path, allow_other_volume=allow_other_volume)

    def export(self, path: str | PathLike[str], progress: Callable[[float], None] | None = None) -> Path:
        """Write a file; its suffix chooses what: see :data:`deformnb.exports.EXPORTS`, and ``.html`` for a page."""
        if Path(path).suffix.lower() == ".html":
            self.export_html(path)
            return Path(path)
        return export(self.session, path, camera=dict(self.view.camera), progress=progress)

    def export_html(self, path: str | PathLike[str], *, title: str = "", about: str = "") -> None:
        """Write one offline file in which the volume still deforms, without a kernel."""
        from deformnb.widgets.standalone import write_standalone

        editor, view = parts.last_step(self.session, self._editors.plane, self.view)
        try:
            write_standalone(path, editor, view, title=title or self.volume.name, about=about)
        finally:
            close_all(editor)
            close_all(view)

    def stats(self) -> dict[str, Any]:
        """What was measured: ``edit_ms`` and ``picture_ms`` in Python, counts of edits, and the view's own figures.

        ``previews`` counts the displacements that Python made while something was dragged.
        """
        return {**self._times, **self._count, "previews": self._link.previews, "view": self.view.stats()}

    def wait(self, timeout: float = 60.0) -> None:
        """Until what the studio's thread has to do is done, pictures among it. For scripts and tests."""
        done = threading.Event()
        self._worker.latest("wait", done.set)  # behind all that waits now
        if not done.wait(timeout):
            raise TimeoutError(f"the studio is still at work after {timeout:g} seconds.")

    def leave(self) -> None:
        """End as :meth:`close` does, and offer what was not saved to the next studio of the volume."""
        self._bar.leave()
        self.close()

    def close(self) -> None:
        """End the studio with all its widgets and its threads; what was not saved is given up."""
        worker = getattr(self, "_worker", None)  # ipywidgets closes again when the object goes, also a half-made one
        if worker is None or worker.is_closed:
            return
        worker.close()
        for part in ("_link", "_editors"):
            if hasattr(self, part):
                getattr(self, part).close()
        for panel in self._panels:
            panel.close()
        close_all(self)

    # -- display -------------------------------------------------------------------------------------------------------

    def still(self, width: int = 1120) -> NDArray[np.uint8]:
        """Picture and volume side by side, (height, width, 3): what is seen where no front end runs."""
        return parts.side_by_side(self.editor, self.view, width)

    def __repr__(self) -> str:
        z, y, x = self.volume.shape
        return f"Studio({self.volume.name or 'volume'} {x} x {y} x {z}, {len(self.deformation.steps)} steps)"

    def _repr_mimebundle_(self, **options: Any) -> Any:
        return with_png(super()._repr_mimebundle_(**options), lambda: as_png(self.still()))

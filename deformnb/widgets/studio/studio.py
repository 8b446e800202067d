"""Studio: a picture with its control points, the volume that follows them, and the controls, in one line of a cell.

The studio wires and decides nothing: the :class:`Session` holds the document, the editor's front end
fits and warps while the mouse moves, and the view's front end follows it. Python receives the end of an edit, makes the
next document, and does slow work in a separate thread, the newest first.

The module also builds the parts of a studio: its view, the layout of its widgets, its status line, its still.
"""

from __future__ import annotations

import io
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import ipywidgets as ipw
import numpy as np
import traitlets
from numpy.typing import ArrayLike, NDArray

from deformnb._weak import weakly
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.imaging.projection import ProjectionName
from deformnb.io.files.paths import as_path
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
from deformnb.volume.views import ViewName
from deformnb.volume.volume import Grid, Volume, VolumeLike
from deformnb.widgets.boxes import Boxes
from deformnb.widgets.camera import picture_mode
from deformnb.widgets.cell_widgets import (
    close_all,
    close_earlier_of_this_cell,
    closed_on_failure,
    owned_widgets,
    transfer_ownership,
    with_png,
)
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.embedded_page import (
    EMBEDDED_CONTROLS,
    EMBEDDED_LIMIT,
    EmbeddedPage,
    embeds_for_later_readers,
)
from deformnb.widgets.image_encoding import PREVIEW_SIZE, as_png
from deformnb.widgets.inputs.transfer_editor import TransferEditor
from deformnb.widgets.parameters import PAGE_CONTROLS
from deformnb.widgets.studio.editors import StudioEditors, StudioEdits, StudioPicture, make_editor
from deformnb.widgets.studio.head import StudioHead
from deformnb.widgets.studio.layout import GivenVolumes, PanelParts, StudioPanels, arrange, make_panels
from deformnb.widgets.studio.save_restore import RestoreBar
from deformnb.widgets.studio.slices import StudioSlices
from deformnb.widgets.studio.status import StudioStatus
from deformnb.widgets.studio.step_diagnostics import warm_up
from deformnb.widgets.studio.sync import StudioSync
from deformnb.widgets.studio.view_sync import StudioLink, followed_step, show_plane
from deformnb.widgets.synced import translated_by_owner
from deformnb.widgets.view.base import AbstractView
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.view.picture_plane import ShowsPlane
from deformnb.widgets.worker import Worker
from deformnb.words import language as chosen_language

ViewKind: TypeAlias = Literal["live", "vtk"]
"""Names of the views."""

VIEW_KINDS: tuple[ViewKind, ...] = get_args(ViewKind)
"""Views by name: rendered in the browser, or by VTK in Python."""


def make_view(kind: ViewKind | AbstractView, volume: Volume, transfer: Any, height: int) -> Any:
    """A view of the volume by its name in :data:`VIEW_KINDS`, or a custom one."""
    if isinstance(kind, AbstractView):
        if not (isinstance(kind, ipw.DOMWidget) and kind.has_trait("camera")):
            raise DeformError(
                f"a studio cannot show a {type(kind).__name__}; a custom view must be a widget with "
                "a trait named camera, deformnb.widgets.view.base.CameraTrait()."
            )
        transfer_ownership(kind)
        kind.show(volume)
        kind.set_transfer(transfer)
        return kind
    with owned_widgets():
        if kind == "live":
            return LiveView(volume, transfer=transfer, width=720, height=height)
        if kind == "vtk":
            from deformnb.widgets.view.volume_view import VolumeView

            return VolumeView(volume, transfer=transfer, width=720, height=height)
    raise DeformError(f"unknown view {kind!r}; choose one of {', '.join(VIEW_KINDS)}, or give a view.")


def volume_for(given: Any, volume: Volume, name: str) -> Volume | None:
    """A volume of any volume-like object; an array, which has no frame, gets that of another volume; None of None.

    Parameters
    ----------
    name : its role: "labels" or "target".

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
            f"{name} of shape {found.shape} do not fit a volume of {volume.shape}; give a Volume with its own grid."
        )
    notes = tuple(note for note in found.notes if note != NO_PLACE)
    return Volume(found.values, volume.grid, name, found.is_labels, notes)


def last_step(session: Session, editor: Editor, view: Any) -> tuple[Editor, LiveView]:
    """An editor and a live view of the last step in use, whichever is edited: the content of a web page without Python.

    Steps that such a page cannot drag (points in space, steps that are added up) are applied to its volume, and the
    page continues with a picture of that.
    """
    last = followed_step(session.editing.deformation)
    deformed = None if last is not None else session.results.volume()
    is_followed = deformed is None
    channels = session.channels if is_followed or not session.channels else session.results.channels()
    pictures = session.pictures
    whole = Session(
        session.volume if deformed is None else deformed,
        session.editing.deformation if is_followed else None,
        view=session.editing.plane,
        channels=channels,
        channel_displays=pictures.channel_displays,
        method=pictures.method,
        window=pictures.window,
        colour_map=pictures.colour_map,
    )
    whole.editing.edit_step(last or 0)
    shown = make_editor(whole, editor.height)
    shown.density, shown.theme, shown.shows = editor.density, editor.theme, picture_mode(view.shows)
    shown.stop_at_folds = editor.stop_at_folds
    with owned_widgets():
        live = LiveView(whole.volume, transfer=pictures.transfer_function, width=view.width, height=view.height)
    live.camera, live.shows, live.clip, live.frame = dict(view.camera), view.shows, view.clip, pictures.frame
    for name in ("projection", "background", "show_folds", "ambient_occlusion"):
        if view.has_trait(name):
            setattr(live, name, getattr(view, name))
    show_plane(live, whole)
    live.follow(shown, whole.results.field(), whole.editing.key, output=whole.results.grid)
    return shown, live


@contextmanager
def page_widgets(session: Session, editor: Editor, view: Any) -> Iterator[tuple[Editor, LiveView]]:
    """Editor and view of :func:`last_step`, for the time in which the page is made."""
    editor, view = last_step(session, editor, view)
    try:
        yield editor, view
    finally:
        close_all(editor)
        close_all(view)


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


@dataclass(eq=False)
class StudioParts:
    """The parts of a studio for one session; a studio that continues with another volume takes others.

    Parameters
    ----------
    session : the document and its history.
    view : of the volume; link : shows the displacement there.
    words : the status line and the messages.
    worker : the studio's thread.
    editors : of the points; edits : apply their edits; picture : behind the points.
    slices : in the place of the view.
    opacity : the editor of colours and opacities.
    panels : the controls.
    sync : shows every change of the session.
    ends : end what runs of the parts.
    bar : writes the session; made when that of the session before has written its own.
    """

    session: Session
    view: Any
    words: StudioStatus
    worker: Worker
    edits: StudioEdits
    editors: StudioEditors
    link: StudioLink
    picture: StudioPicture
    slices: StudioSlices
    opacity: TransferEditor
    panels: StudioPanels
    sync: StudioSync
    ends: Sequence[Callable[[], None]]
    bar: RestoreBar | None = None

    def close(self) -> None:
        """End the thread and stop observing; the widgets close with the studio's children."""
        end_all(self.ends)

    def leave_view(self) -> None:
        """Take the view out of its place, for a studio that shows it elsewhere."""
        self.editors.beside.children = ()


def end_all(ends: Sequence[Callable[[], None]]) -> None:
    """End what runs, in this order."""
    for end in ends:
        end()


_NONE_GIVEN = GivenVolumes()


class Studio(Boxes):
    """Deform a volume by dragging points on a picture of it.

    Parameters
    ----------
    volume : to deform: a :class:`~deformnb.volume.volume.Volume`, an array [z, y, x], or the path of a file; or
        :class:`~deformnb.volume.channels.Channels`, which pictures show in their colours, added up.
    deformation : to continue; a :class:`~deformnb.document.deformation.Deformation` or the path of a saved one.
    side : where the first picture is taken from, one of :data:`VIEWS`; default is the side that shows
        most of the subject.
    method : projection of the picture, a name of :data:`~deformnb.imaging.projection.PROJECTIONS`.
    transfer : colours and opacities of the volume: a transfer function, or the name of a preset. Both are by default as
        the deformation was saved, or else "mip" and "specimen".
    view : "live" renders in the browser, "vtk" in Python; or a custom view.
    height : of the panes and the panel together, in CSS pixels.
    folder : where files are saved and opened by the controls.
    labels : numbered parts of the volume, such as bones: a volume, an array as large as the volume, or a file. Their
        regions can be made rigid or cut out; label_names : the names of the numbers.
    target : of a fit: a volume, an array of the same size, or a file, chosen in the panel "Fit".
    output : grid of the result, which is what can be seen; default is the document's, or the volume's own. See
        :meth:`Results.grow <deformnb.session.results.Results.grow>` and :meth:`Results.fit_output
        <deformnb.session.results.Results.fit_output>`.
    language : of the studio, "en" or "de"; default is the one of :func:`deformnb.set_language`.

    Attributes
    ----------
    session : the document and its history.
    editor, view : the widgets on the left and on the right; the editor is another one for a step in space.
    parts : all that belongs to this session, such as its panels and messages.
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

    parts: StudioParts
    deformation = traitlets.Instance(Deformation)

    def __init__(
        self,
        volume: ChannelsLike,
        deformation: Deformation | str | PathLike[str] | None = None,
        *,
        side: ViewName | Plane | None = None,
        method: ProjectionName | None = None,
        transfer: Any = None,
        view: ViewKind | AbstractView = "live",
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
        self._options = view, height, as_path(folder)
        others = GivenVolumes(volume_for(labels, given, "labels"), label_names, volume_for(target, given, "target"))
        self._begin(session, others)

    def _begin(self, session: Session, given: GivenVolumes = _NONE_GIVEN) -> None:
        """Take the parts for a session; where they cannot be made those before, if any, stay as they were."""
        before: StudioParts | None = getattr(self, "parts", None)
        words = StudioStatus()
        worker = Worker("deformnb-studio", failed=words.report_error)
        ends: list[Callable[[], None]] = [worker.close]
        with worker.pause():  # nothing is done for half a studio
            try:
                with closed_on_failure(lambda: end_all(ends)), translated_by_owner():  # by the head
                    parts = self._make(before, session, words, worker, ends, given)
                    self._show(parts, before)
            except BaseException:
                close_all(words.box, words.notice, words.status)
                if before is not None:
                    self.parts = before
                raise
        parts.sync.request_status()
        if before is not None:
            _schedule_warm_up(self)

    def _make(
        self,
        before: StudioParts | None,
        session: Session,
        words: StudioStatus,
        worker: Worker,
        ends: list[Callable[[], None]],
        given: GivenVolumes,
    ) -> StudioParts:
        """Make the parts, and note what ends each of them once it is there."""
        kind, height, folder = self._options
        notify = _weakly_in_session(self, lambda studio, document: studio.set_trait("deformation", document), worker)
        sync = StudioSync(session, words, worker, notify)
        edits = StudioEdits(session, words, weakly(sync, StudioSync.request_status))
        # Thread and autosave hold the messages, and so this button among them.
        undo = _weakly_in_session(self, Studio.undo, worker)
        open_session = _weakly_in_session(self, Studio._open_session, worker)
        view = make_view(kind, session.volume, session.pictures.transfer_function, height)
        if view.has_trait("frame"):
            view.frame = session.pictures.frame
        editors = StudioEditors(session, height, sync.observe_editor)
        link = StudioLink(session, view, worker)
        ends.append(link.close)
        picture = StudioPicture(session, editors, link, view, worker, undo)
        edits.take_edits(editors, picture)
        slices = StudioSlices(session, link, editors.plane, worker, editors.beside)
        ends += [slices.close, editors.close]
        opacity = TransferEditor(session.volume, session.pictures.transfer, worker=worker)
        ends.append(partial(close_all, opacity))  # it is in no box before its panel is seen
        panels = make_panels(
            PanelParts(
                session,
                edits.apply_edit,
                view,
                editors,
                worker,
                slices,
                opacity,
                folder,
                self.export_html,
                given,
                link.preview,
                _weakly_in_session(self, Studio.edit_view, worker),
                _weakly_in_session(self, Studio.open_volume, worker),
                _weakly_in_session(self, partial(_decide_labels, open_session), worker),
                None if before is None else before.panels.opening.box,
            )
        )
        ends.append(panels.close)
        return StudioParts(
            session, view, words, worker, edits, editors, link, picture, slices, opacity, panels, sync, ends
        )

    def _show(self, parts: StudioParts, before: StudioParts | None) -> None:
        """Replace the parts before, or the former output of the cell."""
        _, height, folder = self._options
        session, panels, words, edits = parts.session, parts.panels, parts.words, parts.edits
        head = StudioHead(
            session,
            edits.apply_edit,
            words.show,
            folder,
            parts.worker.call,
            open_menu=panels.open_menu,
            language=self._language,
        )
        file_input, *rows = arrange(head, parts.editors, parts.view, panels, words, height)
        self.parts = parts
        if before is None:
            close_earlier_of_this_cell(self)
        else:
            before.close()
            assert before.bar is not None
            before.bar.close()  # the edits that are in no file are written by the autosave
            if before.view is parts.view:
                before.leave_view()
            open_former = _weakly_in_session(self, Studio._open_session, parts.worker)
            former = before.session
            panels.history.call_when_ready(lambda history: history.offer_return(former, open_former))
        parts.bar = RestoreBar(session, edits.apply_edit, words.show)  # finds what that one has left
        recovery = parts.bar.recovery
        panels.history.call_when_ready(lambda history: history.take_recovery(recovery))
        panels.opening.begin()
        words.box.children = (parts.picture.ways_on, words.notice)
        if before is None:
            # With the first message: anywidget ignores a class that comes after its view was made.
            whole = {"layout": ipw.Layout(width="100%", max_width="1600px"), "_dom_classes": ("dnb-studio",)}
            super().__init__([file_input, parts.bar, *rows], **whole)
        else:
            (_, *shown), self.children = self.children, (file_input, parts.bar, *rows)
            close_all(*shown)
        self.deformation = session.editing.deformation
        if isinstance(parts.view, ShowsPlane):
            parts.view.on_edit_view(weakly(parts.edits, StudioEdits.edit_view, lambda _: not parts.worker.is_closed))
        parts.sync.start(
            parts.view, parts.editors, edits, parts.link, parts.picture, parts.slices, parts.opacity, panels.refresh
        )

    @traitlets.validate("deformation")
    def _valid_deformation(self, proposal: Any) -> Deformation:
        if proposal["value"] is not self.session.editing.deformation:
            self.session.editing.deformation = proposal["value"]
        return self.session.editing.deformation

    # -- for other cells -----------------------------------------------------------------------------------------------

    @property
    def editor(self) -> Any:
        """The editor of the step that is edited: an :class:`Editor` on a picture or a :class:`SpaceEditor` in space."""
        return self.parts.editors.current

    @property
    def session(self) -> Session:
        """The document and its history."""
        return self.parts.session

    @property
    def view(self) -> Any:
        """The view on the right."""
        return self.parts.view

    @property
    def volume(self) -> Volume:
        """The volume as it was given."""
        return self.session.volume

    def result(self, progress: Callable[[float], None] | None = None) -> Volume:
        """The deformed volume, on the grid ``session.editing.output``."""
        return self.session.results.volume(progress)

    def edit_view(self, direction: ArrayLike | None = None, up: ArrayLike | None = None) -> None:
        """Edit on the picture that the camera of the view sees; see :meth:`Session.edit_view
        <deformnb.session.session.Session.edit_view>`.

        Parameters
        ----------
        direction, up : of another camera, to which the view is turned.
        """
        if direction is not None:
            self.view.set_camera(direction, up)
        self.parts.edits.edit_view(self.view.camera)

    def undo(self) -> None:
        """Undo the last edit."""
        self.parts.edits.travel("undo")

    def redo(self) -> None:
        """Redo the last edit that was undone."""
        self.parts.edits.travel("redo")

    def save(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the document as JSON; see :meth:`Session.save <deformnb.session.session.Session.save>`."""
        self.session.save(path, overwrite=overwrite)

    def load(self, path: str | PathLike[str], *, allow_other_volume: bool = False) -> None:
        """Open a saved document; can be undone."""
        self.session.open(path, allow_other_volume=allow_other_volume)

    def open_volume(
        self,
        volume: ChannelsLike,
        deformation: Deformation | str | PathLike[str] | None = None,
        *,
        side: ViewName | Plane | None = None,
    ) -> None:
        """Continue with another volume in this place, with a separate session, editor and view.

        The edits of the volume before are stored: the menu "History" restores them, also when the other volume is
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

    def _open_session(self, session: Session) -> None:
        before = self.session
        self.parts.words.show(f"Opening {session.volume.name or 'the volume'} \u2026")
        with owned_widgets():
            self._begin(session)
        name = before.volume.name or "the volume before"
        self.session.editing.notice = f"{session.volume.name or 'The volume'} is open; History returns to {name}."

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
        size : (width, height) in pixels of renderings and movies, which have the state of the view: its camera,
            projection, clip, background, and whether the original is next to it; default is 1600 x 1200, and 640 x 480
            for movies.
        fps : pictures a second of movies.
        overwrite : replace any file; else only one that holds what this studio has opened or written.
        """
        path = as_path(path)
        if path.suffix.lower() == ".html":
            self.export_html(path, overwrite=overwrite, progress=progress)
            return path
        return export(
            self.session, path, seen=self.view.settings(), size=size, fps=fps, overwrite=overwrite, progress=progress
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
        controls : names of :data:`~deformnb.widgets.parameters.PAGE_CONTROLS` that the page has; default is all.
        overwrite, progress : as of :meth:`export`.
        """
        from deformnb.widgets.standalone import write_standalone

        with (
            page_widgets(self.session, self.parts.editors.plane, self.view) as (editor, view),
            self.session.files.known.writing(path, overwrite=overwrite),
        ):
            write_standalone(
                path,
                editor,
                view,
                title=title or self.volume.name,
                about=about,
                language=self._language,
                limit=limit,
                controls=PAGE_CONTROLS if controls is None else controls,
                progress=progress,
            )

    def embed(
        self,
        path: str | PathLike[str] | None = None,
        *,
        title: str = "",
        about: str = "",
        limit: int = EMBEDDED_LIMIT,
        controls: Iterable[str] = EMBEDDED_CONTROLS,
        height: int | None = None,
        overwrite: bool = False,
    ) -> EmbeddedPage:
        """The studio as it is now as a page that works without Python, in its place in a saved notebook.

        As the last expression of a cell it is shown in a frame, which is saved with the notebook: the points can be
        dragged by whoever opens that, or a page that nbconvert, Quarto, Jupyter Book or MyST-NB makes of it.
        JupyterLab shows it in notebooks that are trusted. With the environment variable ``DEFORMNB_EMBED=1`` each
        studio of a notebook that such a program runs is shown so.

        Parameters
        ----------
        path : a file beside the notebook that gets the page, relative to it; default is that the notebook contains it.
        title, about : of the page; a line under the title.
        limit : voxels in the page at most: with a million it takes about 1 MB.
        controls : names of :data:`~deformnb.widgets.parameters.PAGE_CONTROLS` that the page has.
        height : of the frame, in CSS pixels.
        overwrite : as of :meth:`export`.

        Examples
        --------
        >>> from deformnb.datasets import PHANTOMS
        >>> studio = Studio(PHANTOMS["bar"].make((8, 8, 16)))
        >>> page = studio.embed(title="A bar")
        >>> "srcdoc" in page.markup()
        True
        >>> studio.close()
        """
        from deformnb.widgets.standalone import standalone_html

        name = title or self.volume.name or "Deformation"
        with page_widgets(self.session, self.parts.editors.plane, self.view) as (editor, view):
            page = standalone_html(
                editor, view, title=name, about=about, language=self._language, limit=limit, controls=controls
            )
        still = preview_png(self.editor, self.view)
        options = {} if height is None else {"height": height}
        embedded = EmbeddedPage(page, name, still, source="" if path is None else as_path(path).as_posix(), **options)
        if path is not None:
            with self.session.files.known.writing(path, overwrite=overwrite):
                embedded.write(path, overwrite=True)
        return embedded

    def stats(self) -> dict[str, Any]:
        """Measurements: ``edit_ms`` and ``picture_ms`` in Python, counts of edits, and the view's own figures.

        ``previews`` counts the displacements that Python made while something was dragged. ``editor`` has the rate at
        which the picture followed the pointer in the last drag: ``drag_hz`` and ``picture_ms``, of
        :meth:`Editor.stats <deformnb.widgets.Editor.stats>`.
        """
        parts = self.parts
        times = {"edit_ms": parts.edits.milliseconds, "picture_ms": parts.picture.milliseconds}
        return {
            **times,
            **parts.edits.counts,
            "previews": parts.link.previews,
            "editor": self.editor.stats(),
            "view": self.view.stats(),
        }

    def show_session(self) -> None:
        """Show the state of the session, in place of a drag that will not end because its front end was closed."""
        self.parts.link.show(self.editor)
        self.parts.editors.show_step()
        self.view.set_transfer(self.session.pictures.transfer_function)

    def wait(self, timeout: float = 60.0) -> None:
        """Wait until the work of the studio's thread is done, pictures among it. For scripts and tests."""
        done, worker = threading.Event(), self.parts.worker

        def poll() -> None:
            if worker.is_wanted and not worker.is_closed:
                worker.latest("wait", poll)  # behind the requests of the work itself
            else:
                done.set()

        worker.latest("wait", poll)
        if not done.wait(timeout):
            raise TimeoutError(f"the studio is still at work after {timeout:g} seconds.")

    def warm_up(self) -> None:
        """Import JAX and compile for the first edits, in the studio's thread; done once the view has its voxels."""
        if not self.parts.worker.is_closed:
            self.parts.worker.latest("warm up", partial(warm_up, self.session))

    def forward_view(self, other: Any) -> None:
        """Transfer a view to another studio of the same cell that was given it as well."""
        if getattr(other, "view", None) is self.view:
            self.parts.leave_view()

    def close(self) -> None:
        """End the studio with all its widgets and its threads; the next one's History has the unsaved edits.

        ipywidgets holds a studio that is not closed, with its volume, though no variable names it: clients may show it.
        Its threads end when nothing is to be done, and each edit is written as before.
        """
        # ipywidgets closes again when the object goes, also a half-made one.
        parts: StudioParts | None = getattr(self, "parts", None)
        if parts is None or parts.worker.is_closed:
            super().close()
            return
        parts.close()
        close_all(*self.children, self.layout)
        super().close()

    # -- display -------------------------------------------------------------------------------------------------------

    def still(self, width: int = 1120) -> NDArray[np.uint8]:
        """Picture and volume side by side, (height, width, 3): the still where no front end runs."""
        return side_by_side(self.editor, self.view, width)

    def __repr__(self) -> str:
        z, y, x = self.volume.shape
        return f"Studio({self.volume.name or 'volume'} {x} x {y} x {z}, {len(self.deformation.steps)} steps)"

    def _display_(self) -> Any:
        """Display in marimo, which has anywidgets but no boxes, sliders and tabs: picture and volume."""
        marimo = sys.modules["marimo"]  # which calls this: it is there, and is needed here only

        _schedule_warm_up(self)
        both = (self.editor, self.view)
        for shown in both:  # no pane is around them, whose height they would take
            if shown.has_trait("fill"):
                shown.fill = False
        half = {"width": "0", "min-width": "100%"}  # of the row: the view requests more than its half
        return marimo.hstack([marimo.as_html(shown).style(half) for shown in both], widths="equal", align="start")

    def _repr_mimebundle_(self, **options: Any) -> Any:
        if embeds_for_later_readers():
            return self.embed()._repr_mimebundle_()
        bundle = with_png(super()._repr_mimebundle_(**options), lambda: preview_png(self.editor, self.view))
        _schedule_warm_up(self)
        return bundle


def _decide_labels(open_session: Callable[[Session], None], studio: Studio, is_labels: bool) -> None:
    """Continue with the voxels as labels, with all edits; or with them as amounts, as before."""
    session = studio.session
    if is_labels:
        open_session(
            Session(
                session.volume.mark_labels(True),
                session.pictures.view_state.add_to(session.editing.deformation),
                view=session.editing.plane,
                source=source_of_labels(session.files.source),
            )
        )
    studio.session.editing.notice = (
        "The voxels are labels: numbers are preserved."
        if is_labels
        else "The voxels are amounts: values between them are blended."
    )


def _schedule_warm_up(studio: Studio) -> None:
    if isinstance(studio.view, LiveView):
        studio.view.source.call_after_upload(_weakly_in_session(studio, Studio.warm_up, studio.parts.worker))
    else:
        studio.warm_up()


def _weakly_in_session(studio: Studio, method: Callable[..., Any], worker: Worker) -> Callable[..., None]:
    """A callback that does nothing once another session has come: each has a separate thread."""

    def is_open(studio: Studio) -> bool:
        parts: StudioParts | None = getattr(studio, "parts", None)
        return parts is not None and parts.worker is worker and not worker.is_closed

    return weakly(studio, method, is_open)

"""Three linked slices of the deformed volume in the place of a studio's view: axial, coronal and sagittal.

Their cross-hair and the picture's own slice, where it shows one, move together.
"""

from __future__ import annotations

from functools import partial
from typing import Any

from deformnb._weak import weakly
from deformnb.errors import DeformError
from deformnb.imaging.projection import project
from deformnb.session.session import Session
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.cell_widgets import owned_widgets
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.editor.space_slices import PANES
from deformnb.widgets.messages.editors import PointsEdit
from deformnb.widgets.studio.view_sync import StudioLink
from deformnb.widgets.worker import Worker


class StudioSlices:
    """The slices of a studio, made when they are first shown.

    Parameters
    ----------
    session : whose volume and deformation are shown.
    link : gives the deformation of a drag in progress.
    editor : where points are dragged.
    worker : does what takes time.
    place : a box of widgets that the slices replace.
    """

    def __init__(self, session: Session, link: StudioLink, editor: Editor, worker: Worker, place: Any) -> None:
        self._session, self._link, self._editor, self._worker, self._place = session, link, editor, worker, place
        self._widget: SpaceEditor | None = None
        self._window: tuple[float, float] | None = None  # the automatic one
        self._moved = weakly(self, StudioSlices._preview, StudioSlices._is_open)
        self._of_picture = weakly(self, StudioSlices._follow_picture, StudioSlices._is_open)
        session.pictures.observe(self._of_picture, ["depth", "method"])
        self.is_visible = False

    def show(self, is_visible: bool) -> None:
        """Show the slices instead of the view, or the view again."""
        if is_visible == self.is_visible:
            return
        if self._widget is None:
            self._widget = self._make()
            self._place.children = (*self._place.children, self._widget)
            self._widget.observe(weakly(self, StudioSlices._follow_cursor, StudioSlices._is_open), "cursor")
            self._follow_picture()
        self.is_visible = is_visible
        for widget in self._place.children:
            basic.set_visible(widget, (widget is self._widget) == is_visible)
        self._editor.on_edit(self._moved, remove=not is_visible, details=True)
        self.follow()

    def follow(self) -> None:
        """Show the state of the session."""
        if self.is_visible:
            self._worker.latest("slices", weakly(self, StudioSlices._follow, StudioSlices._is_open))

    def close(self) -> None:
        """Stop observing the editor and the session; the caller that closes the place closes the slices too."""
        self._editor.on_edit(self._moved, remove=True)
        self._session.pictures.unobserve(self._of_picture, ["depth", "method"])

    def _make(self) -> SpaceEditor:
        session = self._session
        windows = [project(session.volume, side, "slice").window for side in PANES]
        self._window = min(low for low, _ in windows), max(high for _, high in windows)
        with owned_widgets():
            made = SpaceEditor(
                session.volume,
                before=session.results.field(),
                window=session.pictures.window or self._window,
                read_only=True,
                theme="dark",
                fill=True,
                transfer=session.pictures.transfer_function,
                label=f"Slices of {session.volume.name or 'the volume'}",
            )
        made.layout.width, made.large_slice = "100%", made.largest_slice
        return made

    def _is_open(self) -> bool:
        return not self._worker.is_closed

    def _follow(self) -> None:
        session, widget = self._session, self._widget
        assert widget is not None
        widget.set_display(session.pictures.window or self._window, session.pictures.colour_map)
        widget.before = session.results.field()

    def _has_slice(self) -> bool:
        return self._session.pictures.method == "slice" and self._session.editing.step.plane is not None

    def _follow_cursor(self, _change: Any = None) -> None:
        """Show the slice of the picture that is nearest to the cross-hair."""
        session, widget = self._session, self._widget
        if widget is None or not self._has_slice():
            return
        slices = session.pictures.slices
        index = slices.index(float(session.editing.plane.to_plane([widget.cursor])[0, 2]))
        if index != slices.index(session.pictures.depth):
            session.pictures.depth = slices.depth(index)

    def _follow_picture(self, _change: Any = None) -> None:
        """Move the cross-hair across the picture to its slice, unless it is there already."""
        session, widget = self._session, self._widget
        if widget is None or not self._has_slice():
            return
        a, b, c = session.editing.plane.to_plane([widget.cursor])[0]
        if session.pictures.slices.index(float(c)) != session.pictures.slices.index(session.pictures.depth):
            widget.cursor = session.editing.plane.from_plane([(a, b, session.pictures.depth)])[0].tolist()

    def _preview(self, edit: PointsEdit) -> None:
        if edit.phase == "move":
            self._worker.latest("slices", partial(weakly(self, StudioSlices._show, StudioSlices._is_open), edit))

    def _show(self, edit: PointsEdit) -> None:
        try:
            field = self._link.preview_field(edit)
        except DeformError:  # two points met in the drag; the edit will report it if it ends so
            return
        if self._widget is not None:
            self._widget.preview(field)

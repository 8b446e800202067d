"""Editors of the studio, one for points on a picture and one for points in space, and their shared place.

Every change of the session is shown in the editor that the step being edited needs. Edits that come from the front end
of an editor become edits of the session, or are reverted. The next picture of an editor is made in the studio's
thread; a key records the one that it shows.
"""

from __future__ import annotations

import threading
import time
import weakref
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from deformnb._weak import weakly
from deformnb.document.deformation import Step
from deformnb.document.json_regions import region_to_data
from deformnb.document.step_checks import safe_parts, safe_points
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import FRONT_ONLY
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.support import lone_support
from deformnb.session.opening import show_opening
from deformnb.session.session import Session
from deformnb.volume.plane import Picture
from deformnb.warping.foreground import coarse_tissue, foreground_level
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import Box, row
from deformnb.widgets.cell_widgets import owned_widgets
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.editor.outlines import outline_of_volume
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.messages.editors import ShowPart
from deformnb.widgets.studio.controls import button
from deformnb.widgets.studio.history_labels import JOINING, edit_label
from deformnb.widgets.studio.status import StudioStatus, as_html, reason_of
from deformnb.widgets.studio.step_diagnostics import tissue_of
from deformnb.widgets.studio.view_sync import StudioLink
from deformnb.widgets.view.picture_plane import ViewPart
from deformnb.widgets.worker import Worker


def make_editor(session: Session, height: int) -> Editor:
    """An editor of the step that a session edits, empty if that is in space; its undo is the session's."""
    step = session.editing.step
    made = Editor(
        session.pictures.automatic_picture(),
        None,
        height=height,
        history=session.editing.history,
        label=f"Picture of {session.volume.name or 'the volume'}",
    )
    made.chooses_support, made.grid_waits = False, True
    made.lone_support = lone_support(session.editing.grid)
    show_view_state(made, session)
    if step.plane is not None:
        show_step(made, session)
    return made


def show_step(editor: Any, session: Session) -> None:
    """Show the points, settings and shapes of the step that a session edits, in one update."""
    step = session.editing.step
    with editor.hold_sync():
        editor.settings = step.settings
        if isinstance(editor, Editor):
            editor.cuts, editor.parts, editor.cut_rule = step.cuts, step.parts, step.cut_rule
            editor.beyond = _box_on_picture(session)
            editor.subject = list(session.pictures.subject_box)
            editor.outline = _outline(session)
            editor.front_only = is_front_only(step)
        else:
            editor.cuts, editor.parts = step.cuts, step.parts
            if editor.options.get("cut_rule") != step.cut_rule:
                editor.options = _options(session)
        if editor.points != session.editing.points:
            editor.points = session.editing.points


def is_front_only(step: Step) -> bool:
    """Check that a step on a picture leaves the back of the volume as it is, by the curve of that name."""
    return step.extrusion == "modulate" and step.curve == FRONT_ONLY


def show_view_state(editor: Any, session: Session) -> None:
    """Show the window, the colour map and the number of the slice that a session has."""
    if isinstance(editor, SpaceEditor):
        editor.set_display(session.pictures.window, session.pictures.colour_map)
    if isinstance(editor, Editor):
        editor.window = list(session.pictures.window or ())
        editor.colour_map = session.pictures.colour_map
        editor.air = _air(session)
        editor.tissue = tissue_on_picture(session)
        slices = (
            session.pictures.slices
            if session.pictures.method == "slice" and session.editing.step.plane is not None
            else None
        )
        editor.slices = {} if slices is None else vars(slices)
        editor.slice = 0 if slices is None else slices.index(session.pictures.depth)


def _air(session: Session) -> float | None:
    """The value of the picture up to which nothing is seen; None where its values are not those of the volume."""
    if (
        session.editing.step.plane is None
        or session.pictures.method not in ("slice", "mip")
        or session.pictures.shows_channels
    ):
        return None
    return foreground_level(session.volume)


_MOST_VOXELS = 128  # along each axis of the mask of tissue: a fold is wider


def tissue_on_picture(session: Session) -> dict[str, Any]:
    """The mask of tissue at any depth behind the picture, as documents hold it; {} where the picture itself shows that.

    A map that is the same at every depth must not fold tissue that lies before or behind a slice. A maximum shows all
    of it, and where steps before have deformed the volume, every fold counts.
    """
    edited, pictures = session.editing.state, session.pictures
    if edited.step.plane is None or pictures.method == "mip" or edited.earlier.steps:
        return {}
    volume = session.volume
    kept = _SILHOUETTES.get(volume)
    if kept is None or kept[0] != edited.step.plane:
        kept = _SILHOUETTES[volume] = (
            edited.step.plane,
            region_to_data(coarse_tissue(volume, _MOST_VOXELS).silhouette(edited.step.plane)),
        )
    return kept[1]


_SILHOUETTES: weakref.WeakKeyDictionary[Any, tuple[Any, dict[str, Any]]] = weakref.WeakKeyDictionary()


def _box_on_picture(session: Session) -> list[float]:
    """Outline of the result's box on the picture, (a0, a1, b0, b1); empty for the volume's own."""
    if session.editing.output is None:
        return []
    corners = session.editing.plane.to_plane(session.editing.output.corners())[:, :2]
    return np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1).ravel().tolist()


def _outline(session: Session) -> dict[str, Any]:
    """The tissue that the step moves as it is on the picture; {} where other steps or its depth decide that too."""
    edited, step = session.editing.state, session.editing.step
    if step.plane is None or step.extrusion != "replicate" or len(edited.deformation.steps) > 1:
        return {}
    return outline_of_volume(session.volume, step.plane)


def _options(session: Session) -> dict[str, Any]:
    step = session.editing.step
    return {"cuts": step.cuts, "parts": step.parts, "cut_rule": step.cut_rule}


class StudioEditors:
    """The editors on the left of a studio.

    Parameters
    ----------
    session : which step is shown.
    height : of the picture in CSS pixels.
    listen : called with each editor when it is made.

    Attributes
    ----------
    plane : the editor on a picture; space : the one in space, None until a step needs it.
    box : the place; beside : that of the view.
    """

    def __init__(self, session: Session, height: int, listen: Callable[[Any], None]) -> None:
        self._session, self._listen = session, listen
        self._height = height
        self._making = threading.RLock()
        self.plane = make_editor(session, height)
        self.space: SpaceEditor | None = None
        listen(self.plane)
        self.box = Box([self.plane], min_width="0")
        self.beside = Box([], min_width="0")
        basic.own_layout(self.plane).width = "100%"
        self.plane.fill, self.plane.theme = True, "dark"
        if session.editing.step.plane is None:
            self.show_picture(self.make_picture())

    @property
    def current(self) -> Any:
        """The editor of the step that is edited."""
        if self._session.editing.step.plane is not None:
            return self.plane
        with self._making:  # the thread that makes pictures asks too, and both must get the same one
            if self.space is None:
                self.space = self._make_space()
            return self.space

    def _make_space(self) -> SpaceEditor:
        session = self._session
        with owned_widgets():
            made = SpaceEditor(
                session.volume,
                session.editing.points,
                height=self._height,
                history=session.editing.history,
                transfer=session.pictures.transfer_function,
                before=session.pictures.before(),
                options=_options(session),
                theme="dark",
                fill=True,
                **{name: getattr(self.plane, name) for name in _SHARED},
            )
        for editor in (self.plane, made):
            editor.observe(weakly(self, StudioEditors._share), _SHARED)
        made.chooses_support = False
        made.large_slice = made.largest_slice
        show_view_state(made, session)
        basic.own_layout(made).width = "100%"
        self._listen(made)
        return made

    def _share(self, change: Any) -> None:
        """Set a trait of both editors as one."""
        self.set_traits(**{change["name"]: change["new"]})

    def make_picture(self) -> Picture | AbstractField | None:
        """Make the picture behind the points of this step's editor: takes time, and changes nothing yet."""
        session = self._session
        return (
            session.pictures.automatic_picture()
            if session.editing.step.plane is not None
            else session.pictures.before()
        )

    def show_picture(self, made: Any) -> None:
        """Show it together with its points, so that both always match."""
        editor = self.current
        with editor.hold_sync():
            if isinstance(editor, Editor):
                editor.picture = made
                editor.lone_support = lone_support(self._session.editing.grid)
                show_view_state(editor, self._session)
            elif editor.before is not made:
                editor.before = made
            self.show_step()
        if self.box.children != (editor,):
            self.box.children = (editor,)

    def show_step(self) -> None:
        """Show the points, settings and shapes of the step."""
        show_step(self.current, self._session)

    def show_view_state(self) -> None:
        """Show the window, the colour map and the number of the slice."""
        show_view_state(self.current, self._session)

    def set_traits(self, **traits: Any) -> None:
        """Set traits of both editors, such as their history."""
        for editor in (self.plane, self.space):
            if editor is not None:
                for name, value in traits.items():
                    setattr(editor, name, value)

    def close(self) -> None:
        """Close the editor that has no place now."""
        for editor in (self.plane, self.space):
            if editor is not None and editor not in self.box.children:
                editor.close()


_MAKING = "The picture is being made"
_FAILED = "The picture could not be made; the reason is below"
_SHARED = ["stop_at_folds", "show_grid", "density"]  # traits of both editors
_STOPPED = ("move", "brush", "nudge", "turn", "scale")  # kinds of edits in space that stop before tissue folds
_STOPPED_WORDS = "Stopped before tissue folds; the button Safe drag lets drags go on."
_STANDS = 1e-6  # of a direction's length: less is a rounding error of the front end


def picture_key(session: Session) -> Any:
    """Key of a picture, of all that it depends on: the steps before the edited one, its plane, and the projection."""
    edited, pictures = session.editing.state, session.pictures
    return (
        edited.index,
        edited.deformation.steps[: edited.index],
        edited.step.plane,
        pictures.method,
        pictures.depth if pictures.method == "slice" else 0.0,
        edited.deformation.mode,
        pictures.transfer if pictures.method in ("composite", "shaded") else None,
        pictures.channel_displays if pictures.shows_channels else (),
    )


class StudioPicture:
    """The picture behind the points of the step that is edited.

    Parameters
    ----------
    session : determines the picture; editors : show it.
    link : shows the volume from the side of the picture; view : where.
    worker : the thread that makes it.
    undo : undoes the last edit.

    Attributes
    ----------
    milliseconds : how long the last one took; None until one was made.
    ways_on : the reason why the requested picture cannot be made, and two buttons; unseen while it can.
    """

    def __init__(
        self,
        session: Session,
        editors: StudioEditors,
        link: StudioLink,
        view: Any,
        worker: Worker,
        undo: Callable[[], None],
    ) -> None:
        self._session, self._editors, self._link, self._view, self._worker = session, editors, link, view, worker
        self._shown = self._needed_picture()
        self._turned_to: Mapping[str, Any] | None = None
        self.milliseconds: float | None = None
        self._part_lock = threading.Lock()
        self._wanted_part: tuple[Any, ViewPart | None] | None = None  # of the picture with this key
        self._undo, self._reason = undo, ""
        self.ways_on = row()
        self.ways_on.is_visible = False

    @property
    def is_visible(self) -> bool:
        """True if the editor shows the picture that the session requires."""
        return bool(self._shown == self._needed_picture())

    def renew(self) -> bool:
        """Request the picture that the session requires, if it is not the one that is shown; returns whether."""
        if not self.is_visible:
            self.request()
            return True
        if self._reason:  # back from a picture that could not be made to the one still shown
            self._settle("")
        return False

    def show_part(self, part: ViewPart | None) -> None:
        """Show a part of the required picture, as soon as that is shown.

        Parameters
        ----------
        part : that the view shows; None for all of the picture.
        """
        with self._part_lock:  # the thread that makes the picture may show it now
            self._wanted_part = self._needed_picture(), part
            if self.is_visible:
                self._post_part(is_turned=False)

    def _post_part(self, is_turned: bool) -> None:
        """Show the part that is wanted of the picture that is shown, or all of a picture from another side."""
        key, part = self._wanted_part or (None, None)
        is_wanted = key == self._shown
        if is_wanted or key != self._needed_picture():
            self._wanted_part = None
        if is_wanted and part is not None:
            middle = self._shown[2].to_plane(part[0])[:2].tolist()  # the plane of the picture that is shown
            self._editors.plane.post(ShowPart(middle=middle, scale=part[1]))
        elif is_wanted or is_turned:
            self._editors.plane.post(ShowPart(middle=None))

    def request_deformed(self) -> None:
        """Make the picture of the deformed volume, where it is not the picture deformed in its plane."""
        editor = self._editors.plane
        if not self._session.pictures.changes_with_depth:
            editor.deformed_picture = None
        self._worker.latest("deformed picture", weakly(self, StudioPicture._show_deformed, StudioPicture._is_open))

    def _show_deformed(self) -> None:
        session, editor = self._session, self._editors.plane
        before = session.editing.state, session.pictures.settings
        try:
            made = session.pictures.deformed_picture()
        except DeformError:  # of a map that cannot be computed: the edit reports it
            made = None
        is_newest = before == (session.editing.state, session.pictures.settings)
        if is_newest and self.is_visible and editor.points == session.editing.points:
            editor.deformed_picture = made

    def request(self) -> None:
        """Make the requested picture and show it; until then the editor takes no gesture."""
        self._editors.set_traits(waiting=_MAKING)
        self._worker.latest("picture", weakly(self, StudioPicture._show, StudioPicture._is_open))

    def turn(self) -> None:
        """Set the view to the side of the picture, unless the user has turned it elsewhere."""
        if self._turned_to is None or equal_directions(self._turned_to, self._view.camera) or self._link.is_at_picture:
            self._link.turn()
            self._turned_to = dict(self._view.camera)

    def _is_open(self) -> bool:
        return not self._worker.is_closed

    def _needed_picture(self) -> Any:
        return picture_key(self._session)

    def _show(self) -> None:
        needed = self._needed_picture()
        reason = ""
        try:
            self._set(needed)
        except Exception as error:
            reason = reason_of(error)
        if needed == self._needed_picture():  # else another one is requested by now
            self._settle(reason)

    def _settle(self, reason: str) -> None:
        """Enable the editor, or show why not: points of one picture on another are worse than none."""
        self._reason = reason
        self._editors.set_traits(waiting=_FAILED if reason else "")
        if reason and not self.ways_on.children:
            again = weakly(self, StudioPicture.request, StudioPicture._is_open)
            self.ways_on.children = (
                basic.HTML("", layout=basic.layout(flex="0 1 auto", min_width="0")),
                button("Try again", "Make the picture once more", again),
                button("Undo", "Undo the last edit", self._undo),
            )
        if self.ways_on.children:
            self.ways_on.children[0].value = as_html(reason, is_error=True)
        self.ways_on.is_visible = bool(reason)

    def _set(self, needed: Any) -> None:
        start = time.perf_counter()
        made = self._editors.make_picture()
        is_turned = self._shown[2] != needed[2]
        if is_turned:
            self.turn()
        self._link.show(self._editors.current)
        self._editors.plane.deformed_picture = None  # that of another picture
        self._editors.show_picture(made)
        with self._part_lock:
            self._shown = needed
            self._post_part(is_turned)
        self.request_deformed()
        self.milliseconds = (time.perf_counter() - start) * 1e3


def equal_directions(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Check whether two cameras have the same direction; their distance does not count."""
    return all(np.allclose(one[name], other[name], atol=_STANDS) for name in ("direction", "up", "pan"))


class StudioEdits:
    """Between the editors of a studio and its session.

    Parameters
    ----------
    session : is edited.
    words : reports errors.
    timed : called when there is a new time of an edit.

    Attributes
    ----------
    counts : of the edits that came, of those that were refused, and of those on a picture that was being replaced.
    milliseconds : how long Python took for the last edit of the document; None before the first.
    """

    def __init__(self, session: Session, words: StudioStatus, timed: Callable[[], None]) -> None:
        self._session, self._words, self._timed = session, words, timed
        self.counts = {"edits": 0, "refused": 0, "late": 0}
        self.milliseconds: float | None = None

    def take_edits(self, editors: StudioEditors, picture: StudioPicture) -> None:
        """Take edits from these editors, as long as they show the picture that belongs to them."""
        self._editors, self._picture = editors, picture

    def apply_edit(self, action: Callable[[], None]) -> bool:
        """Apply a request of the user, by an editor or by a control; the report of the edit before goes."""
        self._words.show("")
        before, start = self._session.editing.deformation, time.perf_counter()
        is_done = self._words.run_guarded(action)
        if self._session.editing.deformation is not before:  # much that is requested edits nothing
            self.milliseconds = (time.perf_counter() - start) * 1e3
            self._timed()
        return is_done

    def edit_view(self, camera: Mapping[str, Any], part: ViewPart | None = None) -> None:
        """Edit on the picture that a camera sees, and have the view show it by parallel rays.

        Parameters
        ----------
        part : that the view shows, and the picture then.
        """
        is_done = self.apply_edit(lambda: self._session.edit_view(camera["direction"], camera["up"]))
        self._picture.turn()
        if is_done:
            self._picture.show_part(part)

    def points_changed(self, editor: Any, points: Any) -> None:
        """An editor has other points."""
        session = self._session
        if points == session.editing.points:
            return
        made = editor.edit_under_way
        done = made.kind if made is not None else ""
        kind = done if done in JOINING else None
        label = edit_label(session.editing.points, points, done) if points.dim == session.editing.points.dim else ""
        fit = getattr(made, "fit", None)
        wanted, points = points, self._safe(editor, points, done, {} if fit is None else fit.as_dict())
        if fit is None:
            self._take(editor, lambda: session.editing.edit_points(points, label, kind))
        else:
            self._take(editor, lambda: session.editing.edit_fit(points, fit.as_dict(), label))
        if points is not wanted:
            self._words.show(_STOPPED_WORDS)
            self._editors.show_step()
        if done in ("open", "apart") and session.editing.points == points:
            show_opening(session)

    def _safe(self, editor: Any, points: Any, kind: str, fit: dict[str, Any]) -> Any:
        """The points of a drag or a key in space as far as tissue does not fold, while the stop at folds is on.

        ``fit`` holds the settings of the fit that the edit changes too.

        The front end of an editor on a picture stops its drags itself; that in space does so on a coarse lattice.
        """
        session = self._session
        if isinstance(editor, Editor) or not editor.stop_at_folds or kind not in _STOPPED:
            return points
        before, step = session.editing.points, session.editing.step
        try:
            step = replace(step, **fit)
            safe = safe_points(
                step, before, points, session.editing.grid, session.editing.key, is_tissue=tissue_of(session)
            )
        except DeformError:  # it folds already, or cannot be fitted: the edit itself says why
            return points
        return safe

    def shapes_changed(self, editor: Any, what: str, changed: Any) -> None:
        """An editor has other cuts, or other rigid parts."""
        session = self._session
        if getattr(session.editing.step, what) == changed:
            return
        made = editor.edit_under_way
        label = made.kind if made is not None else f"change {'cuts' if what == 'cuts' else 'rigid parts'}"
        kind = label if made is not None and made.joins else None
        if what == "cuts":
            self._take(editor, lambda: session.editing.change(label, kind, cuts=changed))
            return
        points = made.points if made is not None else None
        wanted, changed = changed, self._safe_parts(editor, changed, made)
        points = points if changed is wanted else None  # those that the parts carry follow them
        self._take(editor, lambda: session.editing.edit_parts(changed, label, kind, points=points))
        if changed is not wanted:
            self._words.show(_STOPPED_WORDS)
            self._editors.show_step()

    def _safe_parts(self, editor: Any, parts: Any, made: Any) -> Any:
        """The rigid parts of a drag or a key in space as far as tissue does not fold, while the stop at folds is on."""
        session = self._session
        step = session.editing.step
        is_moved = len(parts) == len(step.parts) and any(
            p.motion != q.motion for p, q in zip(step.parts, parts, strict=True)
        )
        if isinstance(editor, Editor) or not editor.stop_at_folds or made is None or not is_moved:
            return parts
        try:
            return safe_parts(step, parts, session.editing.grid, is_tissue=tissue_of(session))
        except DeformError:  # it folds already, or cannot be fitted: the edit itself says why
            return parts

    def travel(self, way: str) -> None:
        """Go "undo" or "redo", and report what that was."""
        self._words.show("")
        what = self._session.editing.undo() if way == "undo" else self._session.editing.redo()
        if what:
            self._words.show(f"{'Undone' if way == 'undo' else 'Done again'}: {what}")

    def _take(self, editor: Any, edit: Callable[[], None]) -> None:
        """Apply the edit of an editor; on failure, the editor shows the state of the session again."""
        if not self._picture.is_visible or editor is not self._editors.current:
            self.counts["late"] += 1  # a drag on a picture that is being replaced
            self._picture.request()
            return
        if not self.apply_edit(edit):
            self.counts["refused"] += 1
            self._editors.show_step()
        self.counts["edits"] += 1

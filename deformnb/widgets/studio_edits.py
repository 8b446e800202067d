"""What becomes of the edits that come from the page of a studio's editor: edits of the session, or a way back."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from deformnb.session import Session
from deformnb.widgets.point_labels import JOINING, edit_label
from deformnb.widgets.shape_messages import checked_shapes, shapes_of
from deformnb.widgets.studio_editors import StudioEditors
from deformnb.widgets.studio_picture import StudioPicture
from deformnb.widgets.studio_words import StudioWords


class StudioEdits:
    """Between the editors of a studio and its session.

    Parameters
    ----------
    session : is edited.
    words : says what went wrong.
    timed : called when there is a new time of an edit.

    Attributes
    ----------
    counts : of the edits that came, of those that were refused, and of those on a picture that was being replaced.
    milliseconds : how long Python took for the last edit of the document; None before the first.
    """

    def __init__(self, session: Session, words: StudioWords, timed: Callable[[], None]) -> None:
        self._session, self._words, self._timed = session, words, timed
        self.counts = {"edits": 0, "refused": 0, "late": 0}
        self.milliseconds: float | None = None

    def stand_on(self, editors: StudioEditors, picture: StudioPicture) -> None:
        """Take edits from these editors, as long as they show the picture that belongs to them."""
        self._editors, self._picture = editors, picture

    def edited(self, action: Callable[[], None]) -> bool:
        """Do what a user asked for, be it with an editor or with a control; what was said of the edit before goes."""
        self._words.say("")
        before, start = self._session.deformation, time.perf_counter()
        is_done = self._words.guarded(action)
        if self._session.deformation is not before:  # much that is asked for edits nothing
            self.milliseconds = (time.perf_counter() - start) * 1e3
            self._timed()
        return is_done

    def points_changed(self, editor: Any, points: Any) -> None:
        """An editor has other points."""
        session = self._session
        if points == session.points:
            return
        made = editor.edit_under_way
        done = made.kind if made is not None else ""
        kind = done if done in JOINING else None
        label = edit_label(session.points, points, done) if points.dim == session.points.dim else ""
        self._take(editor, lambda: session.edit_points(points, label, kind))

    def shapes_changed(self, editor: Any, what: str, changed: Any) -> None:
        """An editor has other cuts, or other rigid parts."""
        session = self._session
        if checked_shapes(what, getattr(session.step, what)) == changed:
            return
        made, shapes = editor.edit_under_way, shapes_of(what, changed)
        label = made.kind if made is not None else f"change {'cuts' if what == 'cuts' else 'rigid parts'}"
        if what == "cuts":
            self._take(editor, lambda: session.edit_cuts(shapes, label))
        else:
            points = made.points if made is not None else None
            self._take(editor, lambda: session.edit_parts(shapes, label, points=points))

    def travel(self, way: str) -> None:
        """Go "undo" or "redo", and say what that was."""
        self._words.say("")
        what = self._session.undo() if way == "undo" else self._session.redo()
        if what:
            self._words.say(f"{'Undone' if way == 'undo' else 'Done again'}: {what}")

    def _take(self, editor: Any, edit: Callable[[], None]) -> None:
        """Do what was done in an editor; if it cannot be, the editor shows again what the session holds."""
        if not self._picture.is_shown or editor is not self._editors.current:
            self.counts["late"] += 1  # a drag on a picture that is being replaced
            self._picture.ask()
            return
        if not self.edited(edit):
            self.counts["refused"] += 1
            self._editors.show_step()
        self.counts["edits"] += 1

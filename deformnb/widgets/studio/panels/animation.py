"""Animation panel: a list of key frames, a player, and movies of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import ipywidgets as ipw
import numpy as np

from deformnb.document import edits as key_frames
from deformnb.document.animation import Animation
from deformnb.document.deformation import EASINGS, Deformation, Keyframe
from deformnb.errors import Cancelled
from deformnb.io.movies import write_movie
from deformnb.session.exports import Frozen, movie_frames
from deformnb.session.session import Session
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, row
from deformnb.widgets.inputs.item_list import ItemList
from deformnb.widgets.inputs.player import LONGEST_MOVIE, Playback, Player
from deformnb.widgets.studio.controls import (
    WHOLE_DESCRIPTION,
    Guard,
    Panel,
    ProgressBar,
    button,
    error_action,
    widget_of,
)
from deformnb.widgets.studio.panels.folder import plain_name
from deformnb.widgets.view.page_scene import PageGoneError
from deformnb.widgets.worker import Worker

_EASINGS = {"linear": "at an even pace", "smooth": "slowly at each key frame"}
_KINDS = {"MP4": ".mp4", "GIF": ".gif", "WebP": ".webp", "Pictures (PNG)": ""}
_EMPTY = (
    "No key frames yet. Press \u201cAdd key frame\u201d for the start; drag points, and press it again for the "
    "next moment."
)
# The front end reports the time at which it has stopped only after an edit has stopped it: that must not hide the
# edit again.
_LATE = 1.0


class AnimationPanel(Panel):
    """The key frames of the document.

    Parameters
    ----------
    view : shows the playback, and its camera is the movies'.
    folder : of the movies.

    Attributes
    ----------
    player : the :class:`~deformnb.widgets.Player`; playback : its link with the view.
    """

    title = "Animation"

    def __init__(self, session: Session, guard: Guard, view: Any, folder: str | PathLike[str]) -> None:
        super().__init__(session, guard)
        self._chosen = -1
        self._known = session.editing.deformation
        self.quiet_until = 0.0
        self._held = -1.0  # moment of the key frame at which the player was put, until it leaves that
        self.items = ItemList(
            label="Key frames",
            columns=["Time", "Points", ""],
            commands=["double", "remove"],
            switches=False,
            empty=_EMPTY,
        )
        self.items.on_act(self._act)
        self.player = Player(label="Animation of the key frames")
        self.easing = basic.Dropdown(
            options=[(_EASINGS.get(name, name), name) for name in EASINGS],
            description="Time passes",
            style=WHOLE_DESCRIPTION,
            layout=basic.layout(width="280px"),
            tooltip="Speed of the movement from one key frame to the next",
        )
        self.playback = Playback(
            view, self.player, self.animation, session.editing.grid, self._run_guarded, lambda: session.results.grid
        )
        self.add(
            self.easing, lambda: session.editing.deformation.easing, lambda value: self._set_playback(easing=value)
        )
        self.player.observe(lambda change: self._set_playback(loop=change["new"]), "loop")
        self.movie = MovieControls(session, guard, view, Path(folder))
        self.time = basic.BoundedFloatText(
            min=0,
            max=LONGEST_MOVIE,
            step=0.1,
            description="Time (s)",
            style=WHOLE_DESCRIPTION,
            layout=basic.layout(width="170px"),
            tooltip="When the chosen key frame comes",
            continuous_update=False,
        )
        self.add(
            self.time,
            self._chosen_time,
            lambda value: self._edit("move a key frame", partial(key_frames.move_key, index=self._chosen, time=value)),
        )
        self._update = self._button(
            "Update",
            "The chosen key frame becomes the current document",
            "update a key frame",
            lambda d: key_frames.update_key(d, self._chosen),
        )
        add = button(
            "Add key frame",
            "The document as it is now; where the player rests between two key frames, or one second after the last",
            lambda: self.guard(self._add),
        )
        self._here = self._button(
            "Edit this moment",
            "The document becomes the moment that the player shows, to be edited",
            "go to a moment",
            self._take_moment,
        )
        # Above the list, which grows: buttons pressed repeatedly stay in place.
        self.box = column(
            row(add, self._update),
            self.items,
            row(self.time, self._here),
            self.player,
            row(self.easing, self.movie.box),
            grid_gap="6px",
        )
        self.refresh()

    def _button(self, text: str, tooltip: str, label: str, change: Callable[[Deformation], Deformation]) -> ipw.Button:
        return button(text, tooltip, lambda: self.guard(lambda: self._edit(label, change)))

    def animation(self) -> Animation | None:
        """Animation for the player; None without key frames, and right after an edit, whose result is to be seen."""
        document = self.session.editing.deformation
        if abs(self.player.time - self._held) > key_frames.APART:
            self._held = -1.0
        rests = self._held >= 0 or time.monotonic() < self.quiet_until
        if not document.keyframes or (rests and not self.player.is_playing):
            return None
        # Of the document only what an animation depends on: its steps of now are no part of it.
        return Animation(replace(document, steps=document.keyframes[0].steps, name="", volume=None, extra={}))

    def _run_guarded(self, action: Callable[[], None]) -> bool:
        return self.guard(action)

    # -- edits ---------------------------------------------------------------------------------------------------------

    def _edit(self, label: str, change: Callable[[Deformation], Deformation]) -> None:
        before = self.session.editing.deformation
        after = change(before)
        chosen = _follow(before, after, self._chosen)
        self.session.editing.edit_document(after, label, index=min(self.session.editing.index, len(after.steps) - 1))
        self._chosen = chosen
        self.refresh()

    def _add(self) -> None:
        """Add a key frame, and rest there: further drags are for the next one."""
        moment = self.player.time if self._is_between() else None
        self._edit("add a key frame", lambda document: key_frames.add_key(document, moment))
        self._go(self._chosen)
        document = self.session.editing.deformation
        added, following = document.keyframes[self._chosen].time, key_frames.free_time(document)
        play = " Or play the present ones." if len(document.keyframes) > 1 else ""
        self.session.editing.notice = (
            f"Key frame {self._chosen + 1} is at {added:.4g} s. Drag on and press \u201cAdd key "
            f"frame\u201d again for the next, at {following:.4g} s.{play}"
        )

    def _is_between(self) -> bool:
        """True if the player rests between two key frames."""
        keys, t = self.session.editing.deformation.keyframes, self.player.time
        return (
            len(keys) > 1
            and keys[0].time < t < keys[-1].time
            and key_frames.key_at(self.session.editing.deformation, t) is None
        )

    def _take_moment(self, deformation: Deformation) -> Deformation:
        self.player.pause()
        return key_frames.with_steps(deformation, Animation(deformation).at(self.player.time).steps)

    def _set_playback(self, **looks: Any) -> None:
        """Another easing or loop, stored with the key frames; ignored without any."""
        document = self.session.editing.deformation
        if document.keyframes and any(getattr(document, name) != value for name, value in looks.items()):
            self.guard(lambda: self._edit(f"change the {next(iter(looks))}", lambda d: replace(d, **looks)))
            self.playback.show()

    def _act(self, what: str, index: int, _value: Any) -> None:
        edits: dict[str, tuple[str, Callable[[Deformation], Deformation]]] = {
            "choose": (f"go to key frame {index + 1}", lambda d: key_frames.document_at_key(d, index)),
            "double": ("repeat a key frame", lambda d: key_frames.repeat_key(d, index)),
            "remove": ("remove a key frame", lambda d: key_frames.remove_key(d, index)),
        }
        label, change = edits[what]

        def act() -> None:
            self._edit(label, change)
            if what == "choose":
                self._go(index)

        self.guard(act)
        self.refresh()

    def _go(self, index: int) -> None:
        self._chosen = index
        if self.player.is_playing:
            self._rest()
        self._held = self.session.editing.deformation.keyframes[index].time
        self.player.time = self._held

    def _rest(self) -> None:
        """The view shows the document, not a moment."""
        self.quiet_until = time.monotonic() + _LATE
        self.player.pause()

    # -- display -------------------------------------------------------------------------------------------------------

    def _chosen_time(self) -> float:
        keys = self.session.editing.deformation.keyframes
        return keys[self._chosen].time if 0 <= self._chosen < len(keys) else 0.0

    def arrange(self) -> None:
        document = self.session.editing.deformation
        keys = document.keyframes
        known, self._known = self._known, document
        if (document.steps, document.keyframes) != (known.steps, known.keyframes) and self.player.is_playing:
            self._rest()
        self._chosen = min(self._chosen, len(keys) - 1)
        rows = [_row(key, key_frames.is_now(document, k)) for k, key in enumerate(keys)]
        self.items.show(rows, self._chosen)
        self._update.disabled = self.time.disabled = self._chosen < 0
        self._here.disabled = not keys
        if keys:
            self.player.take(Animation(document))
            self.player.loop = document.loop
        else:
            self.player.duration, self.player.marks = 0.0, []
        self.movie.arrange(bool(keys))

    def close(self) -> None:
        """Stop the playback and the export."""
        self.playback.close()
        self.movie.close()


def _row(key: Keyframe, is_now: bool) -> dict[str, Any]:
    sets = [m for step in key.steps if step.enabled for m in step.maps]
    moved = sum(int(np.count_nonzero(m.displacement.any(axis=1))) for m in sets)
    facts = [f"{sum(map(len, sets))}, {moved} dragged", "as it is now" if is_now else ""]
    return {"title": f"{round(key.time, 3):g} s", "facts": facts, "tip": "Click to go to this key frame and edit it"}


def _follow(before: Deformation, after: Deformation, chosen: int) -> int:
    """The number of the key frame that is chosen after an edit: a new one, or the same one at its new place."""
    old, new = before.keyframes, after.keyframes
    if len(new) == len(old) + 1:
        return next((k for k, key in enumerate(new) if k == len(old) or key != old[k]), chosen)
    if len(new) < len(old) or not 0 <= chosen < len(old):
        return min(chosen, len(new) - 1)
    changed = [k for k, key in enumerate(new) if key not in old]
    return changed[0] if len(changed) == 1 else chosen


class MovieControls:
    """Writes a movie of the key frames into the folder, with progress and a button to stop."""

    def __init__(self, session: Session, guard: Guard, view: Any, folder: Path) -> None:
        self._session, self._guard, self._view, self._folder = session, guard, view, folder
        self._thread = Worker("deformnb-movie")
        self._has_keys = False
        layouts = {
            "kind": {"width": "130px"},
            "fps": {"width": "130px"},
            "name": {"flex": "1 1 120px", "min_width": "80px", "max_width": "260px"},
        }
        self.kind = basic.Dropdown(options=list(_KINDS.items()), layout=layouts["kind"], tooltip="Kind of file")
        self.name = basic.Text(
            value="animation.mp4",
            layout=layouts["name"],
            placeholder="file name",
            tooltip="In the folder of the notebook; pictures get a separate one",
        )
        self.fps = basic.BoundedFloatText(
            value=24,
            min=1,
            max=50,
            step=1,
            description="Frames/s",
            layout=layouts["fps"],
            style={"description_width": "60px"},
        )
        self.kind.observe(lambda change: self._set_suffix(change["new"]), "value")
        self.write = button("Write movie", "Write it into the folder of the notebook", lambda: guard(self._start))
        self.progress = ProgressBar("Cancel", "Stop; no half file is left", "120px")
        self.renderer = widget_of("movie_renderer", layout=basic.layout(width="190px"), label="60px")
        self.message = basic.Label("")
        chosen = [self.renderer] if hasattr(view, "page_scene") else []
        self.box = row(
            self.kind, self.name, self.fps, *chosen, self.write, self.progress.stop, self.progress.bar, self.message
        )
        self.arrange(False)

    def _set_suffix(self, suffix: str) -> None:
        stem = Path(self.name.value.strip() or "animation").stem
        self.name.value = f"{stem}{suffix}"

    def arrange(self, has_keys: bool) -> None:
        """Let movies be written where there is something to write."""
        self._has_keys = has_keys
        self.write.disabled = self.progress.is_busy or not has_keys

    def _start(self) -> None:
        path = self._folder / plain_name(self.name.value)
        frozen = Frozen.of(self._session, self._view.settings())
        fps, by_page = float(self.fps.value), self._takes_page()
        self.progress.begin()
        self.message.value = f"Writing {path.name} ..."
        self.arrange(self._has_keys)
        self._thread.call(lambda: self._do(path, frozen, fps, by_page=by_page))

    def _takes_page(self) -> bool:
        """Check whether the front end should draw: where that was chosen, or where it has a GPU."""
        chosen = self.renderer.value
        if not hasattr(self._view, "page_scene") or chosen == "python":
            return False
        return chosen == "page" or bool(self._view.has_client(by_card=True))

    def _do(self, path: Path, frozen: Frozen, fps: float, *, by_page: bool) -> None:
        message = ""
        try:
            with frozen.files.known.writing(path):
                note = self._write_frames(path, frozen, fps, by_page=by_page)
            message = f"Wrote {path.name}.{note}"
        except Cancelled:
            message = f"Stopped; {path.name} was not written."
        except Exception as error:
            reason = error
            self._guard(error_action(reason))
        finally:
            self.message.value = message
            self.progress.end()
            self.arrange(self._has_keys)

    def _write_frames(self, path: Path, frozen: Frozen, fps: float, *, by_page: bool) -> str:
        """Write the movie; returns a note if the front end could not draw it, so that Python has drawn it."""
        note = ""
        if by_page:
            of_page = replace(frozen, seen=replace(frozen.seen, scene=self._view.page_scene))
            try:
                write_movie(
                    path, movie_frames(of_page, fps), fps, progress=self._count, cancel=self.progress.is_stopped
                )
                return note
            except PageGoneError as error:
                note = f" Python has drawn it: {error}."
            self.progress.begin()
        write_movie(path, movie_frames(frozen, fps), fps, progress=self._count, cancel=self.progress.is_stopped)
        return note

    def _count(self, done: int, total: int) -> None:
        left = self.progress.show(done / max(total, 1))
        self.message.value = ", ".join(words for words in (f"{done} of {total or '?'} pictures", left) if words)

    def wait(self, timeout: float = 120.0) -> None:
        """Wait until nothing is being written. For scripts and tests."""
        self._thread.call(lambda: None).result(timeout)

    def close(self) -> None:
        """Stop the export."""
        self.progress.cancel()
        self._thread.close()

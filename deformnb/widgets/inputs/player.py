"""Player for animations: play and pause, a bar with the key frames, speed and loop.

The clock runs in the front end. A live view that has the frames (:meth:`~deformnb.widgets.LiveView.play`) follows it
there, and nothing is sent. Python receives the time a few times a second while it plays, and exactly where it rests;
the front end may write the traits ``time``, ``is_playing``, ``speed`` and ``loop`` and nothing else.

While a player plays the key frames of a document, a view that can play frames without Python gets them once, as maps
over time. Any other view, and a document whose moments are no maps, is shown moment by moment, the newest first.
"""

from __future__ import annotations

import threading
import uuid
from collections.abc import Callable
from typing import Any

import numpy as np
import traitlets

from deformnb.document.animation import Animation, TimeMaps
from deformnb.document.deformation import LOOPS
from deformnb.errors import DeformError
from deformnb.volume.volume import Grid
from deformnb.widgets.bundle import bundle
from deformnb.widgets.messages.traits import take_traits
from deformnb.widgets.synced import SyncedWidget
from deformnb.widgets.textures import MAP_SIZE
from deformnb.widgets.worker import Worker

FASTEST, SLOWEST = 20.0, 0.01

LONGEST_MOVIE = 3600.0
"""Seconds that a player can show; an hour of key frames is a mistake of a unit."""

_OF_PAGE = frozenset({"time", "is_playing", "speed", "loop"})


class _Seconds(traitlets.Float[float, float]):
    """A finite number of seconds."""

    def validate(self, obj: Any, value: Any) -> float:
        seconds = super().validate(obj, value)
        if not np.isfinite(seconds):
            raise DeformError(f"{self.name} must be a finite number of seconds, got {seconds}.")
        return float(seconds)


class Player(SyncedWidget):
    """Plays from 0 to ``duration`` seconds.

    Parameters
    ----------
    animation : whose duration, key frames and loop are shown.
    time : the moment that is shown; setting it goes there. A moment beyond the ends goes to the nearer one.
    duration : of the whole in seconds.
    marks : the times of the key frames, shown on the bar.
    is_playing : setting it plays or pauses in all front ends; at the end it becomes False, unless it loops.
    speed : 1 is real time.
    loop : a name of :data:`~deformnb.document.deformation.LOOPS`.
    step : seconds that an arrow key goes.
    sync_ms : how often Python receives the time while it plays.
    theme : "auto" follows the front end, "light" and "dark" do not.

    Examples
    --------
    >>> player = Player(duration=2.0, marks=[0.0, 1.0, 2.0])
    >>> player.time = 7
    >>> player.time
    2.0
    """

    _esm = bundle("player.js")
    _css = bundle("player.css")

    time = _Seconds(0.0).tag(sync=True)
    duration = _Seconds(1.0, min=0.0, max=LONGEST_MOVIE).tag(sync=True)
    marks = traitlets.List(traitlets.Float()).tag(sync=True)
    is_playing = traitlets.Bool(False).tag(sync=True)
    speed = traitlets.Float(1.0, min=SLOWEST, max=FASTEST).tag(sync=True)
    loop = traitlets.Enum(list(LOOPS), "once").tag(sync=True)
    step = _Seconds(1 / 24, min=1e-3).tag(sync=True)
    sync_ms = traitlets.Float(250.0, min=20.0, max=10000.0).tag(sync=True)
    theme = traitlets.Enum(["auto", "light", "dark"], "auto").tag(sync=True)
    label = traitlets.Unicode("Animation").tag(sync=True)
    uid = traitlets.Unicode(read_only=True).tag(sync=True)

    def __init__(self, animation: Animation | None = None, **traits: Any) -> None:
        self.set_trait("uid", uuid.uuid4().hex)
        super().__init__(**traits)
        if animation is not None:
            self.take(animation)
            self.loop = traits.get("loop", animation.loop)

    def take(self, animation: Animation) -> None:
        """Show the duration and the key frames of an animation; the moment stays as far as there is one."""
        with self.hold_sync():
            self.duration = animation.duration
            self.marks = [key.time for key in animation.keyframes]

    def play(self) -> None:
        """Begin to play."""
        self.is_playing = True

    def pause(self) -> None:
        """Stop at the moment that is shown."""
        self.is_playing = False

    @traitlets.validate("time")
    def _within(self, proposal: Any) -> float:
        return float(np.clip(proposal["value"], 0.0, self.duration))

    @traitlets.observe("duration")
    def _shorter(self, _change: Any) -> None:
        self.time = min(self.time, self.duration)

    def set_state(self, sync_data: Any) -> None:
        """Take the trait values that the front end sends, as far as they are right."""
        take_traits(sync_data, _OF_PAGE, super().set_state)


# How often a view that Python has to draw receives the time: its pictures are no faster.
_PYTHON_MS = 60.0


class Playback:
    """The link of a player with a view.

    Parameters
    ----------
    view : any view of a volume; player : a :class:`~deformnb.widgets.Player`.
    animation : returns the one to play now, None for nothing; called at every moment.
    grid : of the volume.
    guard : does something and shows what goes wrong with it.
    output : returns the grid whose box is seen now, None for the volume's own; called at every moment.

    Notes
    -----
    Any other content of the view ends the playback there, until the player moves again.
    """

    def __init__(
        self,
        view: Any,
        player: Any,
        animation: Callable[[], Animation | None],
        grid: Grid,
        guard: Callable[[Callable[[], None]], Any],
        output: Callable[[], Grid | None] = lambda: None,
    ) -> None:
        self._output = output
        self._view, self._player, self._animation, self._grid, self._guard = view, player, animation, grid, guard
        self._worker = Worker("deformnb-playback")
        self._made: tuple[tuple[Animation, Grid | None], TimeMaps | None] | None = None
        if not hasattr(view, "play"):
            player.sync_ms = min(player.sync_ms, _PYTHON_MS)
        player.observe(self._moved, ["time", "is_playing"])

    def _moved(self, _change: Any) -> None:
        if not self._worker.is_closed:
            self._worker.latest("moment", lambda: self._guard(self._show))

    def show(self) -> None:
        """Show the moment of the player now."""
        self._moved(None)

    def _show(self) -> None:
        animation = self._animation()
        if animation is None:
            return
        output = self._output()
        maps = self._maps(animation, output)
        if maps is None:
            self._view.show_deformation(animation.field(self._player.time, self._grid), output=output)
        elif not hasattr(self._view, "play"):
            self._view.show_deformation(maps.field(self._player.time), output=output)
        elif self._view.moments is not maps:
            self._view.play(maps, self._player, output=output)

    def _maps(self, animation: Animation, output: Grid | None) -> TimeMaps | None:
        """All moments as maps, made once; None where they are no maps."""
        if self._made is None or self._made[0] != (animation, output):
            self._made = ((animation, output), _stack(animation, self._grid, output))
        return self._made[1]

    def wait(self, timeout: float = 60.0) -> None:
        """Wait until the moment of the player is shown. For scripts and tests."""
        done = threading.Event()
        self.show()
        self._worker.latest("wait", done.set)  # behind the moment
        if not done.wait(timeout):
            raise TimeoutError(f"the moment is still not shown after {timeout:g} seconds.")

    def close(self) -> None:
        """End the link and its thread."""
        self._player.unobserve(self._moved, ["time", "is_playing"])
        self._worker.close()


def _stack(animation: Animation, grid: Grid, output: Grid | None) -> TimeMaps | None:
    try:
        return animation.stack(grid, size=MAP_SIZE, output=output)
    except DeformError:  # several steps, cuts, points in space: each moment is solved for
        return None

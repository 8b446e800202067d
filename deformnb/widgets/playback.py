"""What a view shows while a player plays the key frames of a document.

A view that can go through frames by itself gets them once, as maps over time. Any other view, and a document whose
moments are no maps, is shown moment by moment, the newest first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from deformnb.animation import Animation
from deformnb.errors import DeformError
from deformnb.time_maps import TimeMaps
from deformnb.volume import Grid
from deformnb.widgets.worker import Worker

# How often a view that Python has to draw hears of the time: its pictures are no faster.
_PYTHON_MS = 60.0

# Samples of a map along its longer side: those of a live view.
_MAP_SIZE = 192


class Playback:
    """The link of a player with a view.

    Parameters
    ----------
    view : any view of a volume; player : a :class:`~deformnb.widgets.Player`.
    animation : what is played now, None for nothing; asked at every moment.
    grid : of the volume.
    guard : does something and shows what goes wrong with it.
    output : the grid whose box is seen now, None for the volume's own; asked at every moment.

    Notes
    -----
    Whatever else is shown in the view ends what is played there, until the player moves again.
    """

    def __init__(self, view: Any, player: Any, animation: Callable[[], Animation | None], grid: Grid,
                 guard: Callable[[Callable[[], None]], Any], output: Callable[[], Grid | None] = lambda: None) -> None:
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
            self._made = ((animation, output), _stacked(animation, self._grid, output))
        return self._made[1]

    def wait(self, timeout: float = 60.0) -> None:
        """Until the moment of the player is shown. For scripts and tests."""
        self._worker.call(lambda: self._guard(self._show)).result(timeout)

    def close(self) -> None:
        """End the link and its thread."""
        self._player.unobserve(self._moved, ["time", "is_playing"])
        self._worker.close()


def _stacked(animation: Animation, grid: Grid, output: Grid | None) -> TimeMaps | None:
    try:
        return animation.stack(grid, size=_MAP_SIZE, output=output)
    except DeformError:  # several steps, cuts, points in space: each moment is solved for
        return None

"""Server-side fallback of a live view for browsers that cannot draw it: a volume view without its own front ends.

Such a front end sends StillRequest and ToServerRenderer of :mod:`deformnb.widgets.messages.views`, and gets
DrawnByPython, VolumeInfo and the messages of a volume view to its front ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import Any

from deformnb._weak import weakly
from deformnb.rbf.fields import AbstractField
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.cell_widgets import owned_widgets
from deformnb.widgets.messages.views import DrawnByPython, StillRequest, ToServerRenderer, VolumeInfo
from deformnb.widgets.synced import LocalComm
from deformnb.widgets.view.live_front_ends import Send

SHARED = ("camera", "shows", "projection", "background", "show_folds", "clip", "frame")
"""Traits that the server renderer has in common with the view."""

_PLAYED_MS = 60.0  # how often Python receives the time of a player: its pictures are no faster


@dataclass(frozen=True, eq=False)
class RenderedState:
    """All that a server renderer shows.

    Parameters
    ----------
    volume, transfer, field, output : as of the view.
    looks : its traits of :data:`SHARED`.
    followed : an editor whose points move the field, and which of its maps.
    player : of the moments of an animation, where some are played.
    """

    volume: Volume
    transfer: TransferFunction
    field: AbstractField | None
    output: Grid | None
    looks: Mapping[str, Any]
    followed: tuple[Any, int] | None = None
    player: Any = None


class FallbackHost:
    """Renders the content of a live view on the server, from when a front end without WebGL2 requests it.

    Parameters
    ----------
    send : sends the content of a message to the front ends.
    state : returns the present content, or None before the first volume.
    changed : called with the name and the value of a trait of :data:`SHARED` that a user changes there.
    lock : held while the state is taken over.
    options : of the :class:`~deformnb.widgets.VolumeView` that draws.

    Examples
    --------
    >>> import threading
    >>> host = FallbackHost(lambda content, buffers: None, lambda: None, lambda name, value: None, threading.RLock())
    >>> host.start(StillRequest(view="a"))  # there is nothing to draw
    >>> host.is_running
    False
    """

    def __init__(
        self,
        send: Send,
        state: Callable[[], RenderedState | None],
        changed: Callable[[str, Any], None],
        lock: AbstractContextManager[Any],
        **options: Any,
    ) -> None:
        self._send, self._state, self._changed, self._lock, self._options = send, state, changed, lock, options
        self._view: Any = None
        self._volume: Volume | None = None  # that it has
        self._player: Any = None
        self._played = weakly(self, lambda host, _change: host.update())

    @property
    def is_running(self) -> bool:
        """True if Python draws for some front end."""
        return self._view is not None

    def start(self, message: StillRequest) -> None:
        """Take a front end that cannot draw."""
        if self._state() is not None:
            info = dict(self._running().volume_info)
            answer = DrawnByPython(view=message.view, info=info)
            self._send(answer.content(), [])

    def receive(self, message: ToServerRenderer) -> None:
        """Take what such a front end sends to the renderer, which ends with the last of them."""
        if self._state() is None:
            return
        view = self._running()
        view.take_message(message.say)
        if not view.is_watched:
            self.close()

    def _running(self) -> Any:
        """The view that draws; made if there is none."""
        from deformnb.widgets.view.volume_view import VolumeView

        with self._lock:
            state = self._state()
            if self._view is None and state is not None:
                with owned_widgets():
                    comm = LocalComm(partial(_forward, self._send))
                    view = VolumeView(comm=comm, transfer=state.transfer, **state.looks, **self._options)
                view.observe(lambda change: view.post(VolumeInfo(info=change["new"])), "volume_info")
                view.observe(lambda change: self._changed(change["name"], change["new"]), SHARED)
                self._view = view
                self.update()
            return self._view

    def update(self) -> None:
        """Show the present content of the view, where Python draws."""
        with self._lock:
            state, view = self._state(), self._view
            if state is None or view is None:
                return
            if state.volume is not self._volume:
                self._volume = state.volume
                view.show(state.volume)
            if state.followed is not None and state.field is not None:
                view.follow(state.followed[0], state.field, state.followed[1], output=state.output)
            else:
                view.show_deformation(state.field, output=state.output)
            if state.player is not None and state.player is not self._player:
                self._unobserve_player()
                self._player = state.player
                self._player.sync_ms = min(self._player.sync_ms, _PLAYED_MS)
                self._player.observe(self._played, "time")

    def set_display(self, change: Any) -> None:
        """Take a trait of :data:`SHARED` of the view that has changed."""
        if self._view is not None:
            self._view.set_trait(change["name"], change["new"])

    def set_transfer(self, transfer: TransferFunction) -> None:
        """Show with other colours and opacities, where Python draws."""
        if self._view is not None:
            self._view.set_transfer(transfer)

    def _unobserve_player(self) -> None:
        if self._player is not None:
            self._player.unobserve(self._played, "time")
            self._player = None

    def stats(self) -> dict[str, Any]:
        """Measurements: see :meth:`VolumeView.stats <deformnb.widgets.VolumeView.stats>`; empty where none draws."""
        view = self._view
        return {} if view is None else view.stats()

    def close(self) -> None:
        """Give back the window that was drawn in, and stop observing editor and player."""
        with self._lock:
            view, self._view, self._volume = self._view, None, None
        self._unobserve_player()
        if view is not None:
            view.close()


def _forward(send: Send, data: dict[str, Any], buffers: list[bytes]) -> None:
    """Send a message of the view that draws to the other view's front ends; they need none of its traits."""
    if data.get("method") == "custom":
        send(data["content"], buffers)

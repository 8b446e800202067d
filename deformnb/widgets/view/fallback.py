"""Server-side fallback of a live view for browsers that cannot draw it: a volume view without front ends of its own.

Messages of such a front end: ``still`` (it cannot draw, and requests a server renderer) and ``drawn`` (say: the message
that the front end of a volume view would send, see :mod:`deformnb.widgets.view.volume_view`). Messages to it: ``drawn``
(a server renderer is there), ``info`` (of the box that is seen, as the trait ``volume_info`` of a volume view;
``drawn`` has it too), and those of a volume view to its front ends.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable
from functools import partial
from typing import Any

import traitlets

from deformnb.rbf.fields import AbstractField
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.cell_widgets import parts_of_another
from deformnb.widgets.messages import VolumeInfo
from deformnb.widgets.synced import LocalComm
from deformnb.widgets.view.volume_view import VolumeView

_PLAYED_MS = 60.0  # how often Python receives the time of a player: its pictures are no faster

_SHARED = ("camera", "shows", "projection", "background", "show_folds", "clip")

Send = Callable[[dict[str, Any], list[bytes]], None]


class ServerRenderer:
    """Renders on the server what another view shows, for front ends without WebGL2.

    Parameters
    ----------
    view : the view whose pictures it renders, held weakly; the two share camera, clip and the like.
    send : a method of it that sends a message to its front ends, held weakly too.
    options : of the :class:`~deformnb.widgets.VolumeView` that draws.
    """

    def __init__(self, view: traitlets.HasTraits, send: Send, **options: Any) -> None:
        with parts_of_another():
            self._view = VolumeView(comm=LocalComm(partial(_pass_on, weakref.WeakMethod(send))), **options)
        self._view.observe(lambda change: self._view.send(VolumeInfo(type="info", info=change["new"])), "volume_info")
        shared = [name for name in _SHARED if view.has_trait(name) and self._view.has_trait(name)]
        self._links = [traitlets.link((view, name), (self._view, name)) for name in shared]
        self._volume: Volume | None = None
        self._player: Any = None
        self._came: Callable[[Any], None] | None = None

    def receive(self, content: Any) -> bool:
        """Take a front end's message to the server renderer; returns whether any front end is left."""
        self._view._receive(None, content, [])
        return bool(self._view._front_ends)

    @property
    def info(self) -> dict[str, Any]:
        """Facts for a front end about the visible box, sent again when that is another one."""
        return dict(self._view.volume_info)

    def show(
        self, volume: Volume, field: AbstractField | None, output: Grid | None, followed: tuple[Any, int] | None
    ) -> None:
        """Show this.

        Parameters
        ----------
        followed : an editor whose points move the field, and which of its maps.
        """
        if volume is not self._volume:
            self._volume = volume
            self._view.show(volume)
        if followed is not None and field is not None:
            self._view.follow(followed[0], field, followed[1], output=output)
        else:
            self._view.show_deformation(field, output=output)

    def observe_player(self, player: Any, moment: Callable[[], None]) -> None:
        """Call ``moment()``, a method held weakly, whenever a player has come to another time."""
        if player is self._player:
            return
        self._unobserve_player()
        held = weakref.WeakMethod(moment)

        def came(_change: Any) -> None:
            call = held()
            if call is not None:
                call()

        self._player, self._came = player, came
        player.sync_ms = min(player.sync_ms, _PLAYED_MS)
        player.observe(came, "time")

    def set_transfer(self, transfer: TransferFunction) -> None:
        """Show with other colours and opacities."""
        self._view.set_transfer(transfer)

    def _unobserve_player(self) -> None:
        if self._player is not None:
            self._player.unobserve(self._came, "time")
            self._player = None

    def stats(self) -> dict[str, Any]:
        """Measurements: see :meth:`VolumeView.stats <deformnb.widgets.VolumeView.stats>`."""
        return self._view.stats()

    def close(self) -> None:
        """Give back the window that was drawn in, and stop observing the editor."""
        self._unobserve_player()
        for link in self._links:
            link.unlink()
        self._view.close()


def _pass_on(held: weakref.WeakMethod[Send], data: dict[str, Any], buffers: list[bytes]) -> None:
    """Send a message of the view that draws to the other view's front ends; they need none of its traits."""
    send = held()
    if send is not None and data.get("method") == "custom":
        send(data["content"], buffers)

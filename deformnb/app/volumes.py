"""Volume display of an application: rendered by each client itself, by VTK on the server, or both, as one view."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from deformnb.app.remote import RemoteView
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField
from deformnb.session.exports import Seen
from deformnb.session.session import Session
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid
from deformnb.widgets.camera import checked_camera
from deformnb.widgets.view.base import Following, Refit
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.view.stills import make_scene
from deformnb.widgets.view.volume_view import about
from deformnb.widgets.web.remote_area import dragged

_GLANCE = (0.12, -0.07)  # of the height of the view, as if the mouse had been dragged so far


class Volumes:
    """Volume display of an application, in whatever way its clients can.

    A client that renders follows the pointer by itself. For one that gets pictures the editor's movements come to
    Python, which costs every client messages: so they come from the moment on that a client requests pictures.

    Parameters
    ----------
    session : whose volume is shown.
    notify : called with notes for people about the pictures, from any thread.
    later : does something in the application's thread.

    Attributes
    ----------
    live : the view in the client.
    remote : the one drawn here; None before there is a server.
    """

    def __init__(self, session: Session, notify: Callable[[str], None],
                 later: Callable[[Callable[[], None]], object]) -> None:
        self._session, self._notify, self._later = session, notify, later
        self.live = LiveView(session.volume, transfer=session.transfer, background="dark", width=900, height=900)
        self.live.observe(self._cut_open, "clip")
        self.remote: RemoteView | None = None
        self._transfer: TransferFunction | str = session.transfer
        self._followed: tuple[Any, int] = (None, 0)
        self._following: Following | None = None
        self._field: AbstractField | None = None
        self._output: Grid | None = None

    @property
    def views(self) -> dict[str, dict[str, list[float]]]:
        """Direction and up of a camera by the name of a side, and of "home"."""
        views: dict[str, dict[str, list[float]]] = about(self._session.volume, None)["views"]
        return views

    @property
    def camera(self) -> dict[str, Any]:
        """The camera from which the volume is seen."""
        return dict(self.remote.camera if self.remote is not None and self.remote.is_used else self.live.camera)

    def seen(self) -> Seen:
        """Display settings of the client, for pictures in files."""
        return replace(self.live.seen(), camera=self.camera)

    # -- as a view -----------------------------------------------------------------------------------------------------

    def follow(self, editor: Any, field: AbstractField, index: int = 0, *, output: Grid | None = None) -> None:
        """Show a displacement, one map of which an editor moves; None ends that."""
        self.live.follow(editor, field, index, output=output)
        self._followed, self._field, self._output = (editor, index), field, output
        self._show_remote()

    def show_deformation(self, deformation: AbstractField | None, *, output: Grid | None = None) -> None:
        """Show a displacement that no editor moves."""
        self.live.show_deformation(deformation, output=output)
        self._followed, self._field, self._output = (None, 0), deformation, output
        self._show_remote()

    def set_camera(self, direction: Any, up: Any = None) -> None:
        """Set the direction of view."""
        self.live.set_camera(direction, up)
        if self.remote is not None:
            self.remote.set_camera(direction, up)

    def set_transfer(self, transfer: TransferFunction | str) -> None:
        """Show with other colours and opacities."""
        self.live.set_transfer(transfer)
        self._transfer = transfer
        self._change("transfer", lambda scene: scene.set_transfer(transfer))

    def set_projection(self, projection: str) -> None:
        """Show shaded, as composite or mip."""
        self.live.projection = projection
        self._change("projection", lambda scene: scene.set_projection(projection))

    def set_shows(self, shows: str) -> None:
        """Set the display mode, a name of :data:`~deformnb.widgets.camera.SHOWS`."""
        self.live.shows = shows
        if self.remote is not None:
            self.remote.set_shows(shows)

    def set_folds(self, is_shown: bool) -> None:
        """Paint tissue red where the map folds, or not."""
        self.live.show_folds = is_shown
        self._change("folds", lambda scene: setattr(scene.folding, "show", is_shown))

    # -- drawn here ----------------------------------------------------------------------------------------------------

    def serve(self, fail: Callable[[str], None], push: Callable[[bytes, dict[str, Any]], None]) -> RemoteView:
        """Begin to be ready for clients that get pictures; see :class:`~deformnb.app.remote.RemoteView`."""
        self.remote = RemoteView(self._make_scene, fail, push, self._session.volume.grid, self.live.camera,
                                 turned=self._turned)
        self.remote.set_shows(self.live.shows)
        return self.remote

    def wake(self) -> None:
        """A client has requested pictures."""
        self._show_remote()

    def look(self, side: Any) -> None:
        """A client that gets pictures looks from a side, by its name in :attr:`views`."""
        views = self.views
        if not isinstance(side, str) or side not in views or self.remote is None:
            raise DeformError("there is no such side.")
        self.remote.set_camera(**views[side])
        self._turned()

    def close(self) -> None:
        """Follow no editor, and end the thread that draws."""
        self._unfollow()
        if self.remote is not None:
            self.remote.close()

    def _make_scene(self, size: tuple[int, int]) -> Any:
        """Make the scene of the current state, in its own thread; changes meanwhile come after it."""
        live = self.live
        scene, notice = make_scene(self._session.volume, size, transfer=self._transfer, projection=live.projection,
                                   background=live.background)
        scene.set_field(self._field, self._output)
        scene.set_clip(live.clip)
        scene.set_shows(live.shows)
        scene.folding.show = live.show_folds
        if notice:
            self._notify(notice)
        return scene

    def _cut_open(self, change: Any) -> None:
        clip = change["new"]
        self._change("clip", lambda scene: scene.set_clip(clip))

    def _turned(self) -> None:
        """Send the new direction of view to other parts of the client after the picture was turned."""
        with contextlib.suppress(DeformError):  # the application has been closed
            self._later(lambda: self.live.set_trait("camera", self.camera))

    def _show_remote(self) -> None:
        if self.remote is None or not self.remote.is_used:
            return
        self.remote.box = self._output or self._session.volume.grid
        (editor, index), field, following = self._followed, self._field, self._following
        if field is not None and following is not None and following.goes_on(editor, index):
            self._put(following.show(field))
            return
        self._unfollow()
        self._put(lambda: field)
        if editor is not None:
            self._following = Following(editor, Refit(field, index), self._put)

    def _unfollow(self) -> None:
        if self._following is not None:
            self._following.close()
            self._following = None

    def _put(self, make: Callable[[], AbstractField | None]) -> None:
        output = self._output
        self._change("field", lambda scene: scene.set_field(make(), output))

    def _change(self, key: str, function: Callable[[Any], None]) -> None:
        if self.remote is not None:
            self.remote.change(key, function)


def facing(plane: Plane) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Direction and up of a camera that sees what the picture shows."""
    return tuple(plane.normal), tuple(-c for c in plane.v)


def nearly_facing(plane: Plane) -> tuple[list[float], list[float]]:
    """The same turned a little, so that the depth shows."""
    direction, up = facing(plane)
    camera = dragged(checked_camera({"direction": direction, "up": up}), "turn", *_GLANCE, 1.0)
    return camera["direction"], camera["up"]

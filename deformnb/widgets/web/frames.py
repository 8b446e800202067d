"""Notebook display of a volume view's pictures by trame: a remote controlled area in an inline frame.

The server is the application's, with the same access control: this machine only, a password made for this view, and of
other pages' origins only the notebook's may frame it. It runs in a separate thread and ends with the view, or some
minutes after the last client has left. Pictures and mouse events use this connection; all else stays with the
notebook's own channel.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import weakref
from collections.abc import Callable
from typing import Any

from deformnb.errors import DeformError
from deformnb.widgets.camera import checked_camera
from deformnb.widgets.messages.views import FrameSent
from deformnb.widgets.vtk.render_loop import Frame
from deformnb.widgets.web.addresses import checked_origin
from deformnb.widgets.web.guard import Answer
from deformnb.widgets.web.remote_area import AREA, MouseCamera, Pictures, for_area
from deformnb.widgets.web.server import PageServer

_NAME = "trame"  # of the frame among the view's pages
_IDLE = 300.0  # seconds without a page, after which the server ends
_LONGEST_END = 5.0

_LOG = logging.getLogger(__name__)


class TrameFrames:
    """Sends a view's pictures to a frame in its page; :meth:`open` starts a server where none runs.

    Parameters
    ----------
    view : a :class:`~deformnb.widgets.VolumeView`.

    Attributes
    ----------
    served : the servers by the origin of the pages that frame them.
    """

    def __init__(self, view: Any) -> None:
        self._view = weakref.ref(view)
        self._lock = threading.Lock()
        self.served: dict[str, _Served] = {}

    def open(self, origin: Any, notify: Callable[[str], None]) -> None:
        """Start a server of the pictures for a page of this origin.

        Parameters
        ----------
        notify : called with the frame's address, once it can be opened and from any thread.

        Raises
        ------
        DeformError
            If that is no origin.
        """
        allowed = checked_origin(origin)
        with self._lock:
            self.served = {name: one for name, one in self.served.items() if one.thread.is_alive()}
            view = self._view()
            if view is None:
                return
            served = self.served.get(allowed)
            if served is None:
                served = self.served[allowed] = _Served(view, allowed)
        served.when_ready(notify)

    def deliver(self, message: FrameSent, pictures: list[bytes], frame: Frame) -> None:
        """A picture, by the thread that draws."""
        for served in list(self.served.values()):
            served.area.deliver(message, pictures, frame)

    def close(self) -> None:
        """End all servers."""
        with self._lock:
            served, self.served = list(self.served.values()), {}
        for one in served:
            one.close()


class _Served:
    """One server in a separate thread, for pages that are framed by those of one origin."""

    def __init__(self, view: Any, origin: str) -> None:
        self.area = _ViewArea(view)
        self._origin = origin
        self._ready = threading.Event()
        self.server: PageServer | None = None
        self._is_closed = False
        self.thread = threading.Thread(target=self._run, name="deformnb-trame", daemon=True)
        self.thread.start()

    def _run(self) -> None:
        async def serve() -> None:
            self.server = PageServer(self.area.serve, idle=_IDLE, framed_by=self._origin)
            if self._is_closed:
                return
            await self.server.run(lambda _: self._ready.set())

        try:
            asyncio.run(serve())
        except Exception:
            _LOG.exception("the server of a view has failed")
        finally:
            self._ready.set()
            self.area.close()

    def when_ready(self, notify: Callable[[str], None]) -> None:
        """Call ``notify(address)`` once pages can come, in a thread that may wait for it."""

        def wait() -> None:
            self._ready.wait(60)
            if self.server is not None and self.server.url:
                notify(self.server.url)

        threading.Thread(target=wait, name="deformnb-trame-ready", daemon=True).start()

    def close(self) -> None:
        """End the server; takes a moment at most."""
        self._is_closed = True  # if the server is not made yet
        if self.server is not None:
            self.server.stop()
        self.thread.join(_LONGEST_END)


class _ViewArea:
    """Page with the picture of one view and nothing else: the content of a :class:`PageServer`.

    Parameters
    ----------
    view : a :class:`~deformnb.widgets.VolumeView`, held weakly.
    """

    def __init__(self, view: Any) -> None:
        self._view = weakref.ref(view)
        self._sides: dict[str, Any] = view.volume_info.get("views", {})
        self._mouse = MouseCamera(self._change_camera, self._store_camera)
        self._pictures = Pictures(self._push)
        self._server: PageServer | None = None
        self._camera = view.camera
        self._number = 0

    # -- for the server ------------------------------------------------------------------------------------------------

    def serve(self, server: PageServer) -> _ViewArea:
        """Be the content of this server."""
        from trame.ui.html import DivLayout
        from trame.widgets import html
        from trame_client.widgets.core import AbstractElement
        from trame_rca.widgets import rca

        self._server = server
        server.trame.enable_module(
            {"scripts": ["deformnb/remote.js"], "styles": ["deformnb/remote.css"], "vue_use": ["deformnb_app"]}
        )
        server.trame.state.trame__title = "deformnb"
        server.trame.state.dnb_views = self._sides
        with DivLayout(server.trame), html.Div(classes="dnb-app-fill dnb-app-remote"):
            html.Div("VTK draws the first picture …", classes="dnb-app-waiting")
            rca.RemoteControlledArea(name=AREA, display="image", image_style=("dnb_image", {"width": "100%"}))
            remote = AbstractElement("deformnb-remote", area=AREA, views=("dnb_views",))
            remote._attr_names.extend(["area", "views"])  # noqa: SLF001  # trame has no public API
        return self

    def start(self) -> None:
        """Wait for a page."""

    def answers(self) -> dict[str, Answer]:
        """Remote procedures: size and mouse of the area, the cube next to it, and confirmations."""
        return {
            "trame.rca.size": for_area(self._size),
            "trame.rca.event": for_area(self._event),
            "deformnb.seen": for_area(self._confirm),
            "deformnb.look": self._set_side,
        }

    def bundles(self) -> tuple[str, ...]:
        """Script and styles of the overlays on the picture."""
        return ("remote.js", "remote.css")

    def disconnect(self) -> None:
        """A page was closed; it held nothing but the mouse."""

    def _size(self, origin: str, size: Any) -> None:
        """A page has connected. The view's own page around it sends the size of the pictures."""
        view = self._view()
        if view is not None:
            view.draw_again()

    def _event(self, origin: str, event: Any) -> None:
        view = self._view()
        if view is None:
            return
        if not self._mouse.is_pressed:
            self._camera = view.camera  # Python may have turned it
        self._mouse.handle_event(event, view.scene.ready().box, view.shows)

    def _confirm(self, number: Any, page: Any = "") -> None:
        self._send_to_view({"type": "seen", "seq": number}, page)

    def _set_side(self, side: Any) -> None:
        """Set the camera to a side, by its name."""
        view = self._view()
        if not isinstance(side, str) or side not in self._sides or view is None:
            raise DeformError("there is no such side.")
        view.camera = self._camera = checked_camera(self._sides[side])

    def _change_camera(self, change: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        self._camera = change(self._camera)
        self._number += 1
        self._send_to_view({"type": "camera", "camera": self._camera, "number": self._number}, _NAME)

    def _store_camera(self) -> None:
        view = self._view()
        if view is not None:
            view.camera = self._camera

    def _send_to_view(self, content: dict[str, Any], page: Any) -> None:
        view = self._view()
        if view is not None:
            view.receive({**content, "view": page})

    # -- for the view --------------------------------------------------------------------------------------------------

    def deliver(self, message: FrameSent, pictures: list[bytes], frame: Frame) -> None:
        """A picture of the view, or two that alternate; called by the thread that draws."""
        view = self._view()
        if view is not None:
            camera = self._camera if self._mouse.is_pressed else view.camera
            self._pictures.show(
                frame.images,
                pictures,
                camera,
                {"n": message.seq, "full": frame.is_full, "shows": view.shows},
            )

    def _push(self, jpeg: bytes, about: dict[str, Any]) -> None:
        if self._server is not None:
            self._server.push_picture(jpeg, about)

    def close(self) -> None:
        """End its thread."""
        self._pictures.close()

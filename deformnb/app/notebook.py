"""Notebook display of a volume view's pictures by trame: a remote controlled area in an inline frame.

The server is the application's, with the same access control: this machine only, a password made for this view, and of
other pages' origins only the notebook's may frame it. It lives in a thread of its own and ends with the view, or some
minutes after the last client has gone. Pictures and mouse events use this connection; all else stays with the
notebook's own channel.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import weakref
from collections.abc import Callable
from typing import Any

from deformnb.app.guard import checked_origin
from deformnb.app.remote import AREA, MouseLooks, about_picture
from deformnb.app.server import AppServer
from deformnb.errors import DeformError
from deformnb.widgets.camera import checked_camera
from deformnb.widgets.protocol import text, whole
from deformnb.widgets.vtk.render_loop import Frame
from deformnb.widgets.worker import Worker

_NAME = "trame"  # of the frame among the view's pages
_BLINK = 0.7  # seconds of each of two pictures that are shown in turn
_IDLE = 300.0  # seconds without a page, after which the server ends
_LONGEST_END = 5.0

_LOG = logging.getLogger(__name__)


class Pane(MouseLooks):
    """Pane that the server shows instead of a desk: one view, and nothing to set.

    Parameters
    ----------
    view : a :class:`~deformnb.widgets.VolumeView`, held weakly.
    """

    def __init__(self, view: Any) -> None:
        self._view = weakref.ref(view)
        self.widgets: dict[str, Any] = {}
        self.controls: dict[str, Any] = {}
        self.changed: Callable[[], None] = lambda: None
        self.volumes = self.pictures = self.files = self  # a desk keeps these apart from itself
        self.is_used = False
        self.views: dict[str, Any] = view.volume_info.get("views", {})
        self.thread = Worker("deformnb-pane")
        self._blink = Worker("deformnb-blink")
        self._push: Callable[[bytes, dict[str, Any]], None] = lambda data, about: None
        self._lock = threading.RLock()
        self._layers: list[tuple[bytes, dict[str, Any]]] = []
        self._camera = view.camera
        self._number = 0

    # -- for the server ------------------------------------------------------------------------------------------------

    def serve(self, fail: Any, push: Callable[[bytes, dict[str, Any]], None]) -> Pane:
        """Pictures go to ``push`` from now on."""
        self._push = push
        return self

    def state(self) -> dict[str, Any]:
        """There is nothing to set in the page."""
        return {}

    def fail(self, message: str) -> None:
        """The view reports errors by itself."""

    def wake(self) -> None:
        """A page has come; :meth:`update_size` has requested its picture."""

    def give_up(self) -> None:
        """A page has gone; it held nothing but the mouse."""

    def act(self, name: str, *number: int) -> None:
        """No action is offered."""
        raise DeformError("there is no such action.")

    def document(self) -> str:
        """No document is offered."""
        raise DeformError("there is no document here.")

    def open(self, text: str) -> None:
        """No document is taken."""
        raise DeformError("no document is opened here.")

    def write(self, kind: str, page: str) -> None:
        """No file is offered."""
        raise DeformError("no file is written here.")

    def path(self, key: str) -> None:
        """No file is ready."""

    def update_size(self, size: Any) -> None:
        """A page is there. The view's own page around it sends the size of the pictures."""
        self.is_used = True
        view = self._view()
        if view is not None:
            view.draw_again()

    def seen(self, number: Any, page: Any = "") -> None:
        """A page, by a name of its own, has received the picture of this number."""
        self._say({"type": "seen", "seq": whole(number, 1, 2**53)}, text(page))

    def on_event(self, event: Any) -> None:
        """The mouse over the area, as :meth:`MouseLooks.on_event` takes it; the view receives its end."""
        view = self._view()
        if view is None:
            return
        self.box, self._shows = view.shown_box, view.shows
        if self._held is None:
            self._camera = view.camera  # Python may have turned it
        super().on_event(event)

    def look(self, side: Any) -> None:
        """Look from a side, by its name."""
        view = self._view()
        if not isinstance(side, str) or side not in self.views or view is None:
            raise DeformError("there is no such side.")
        view.camera = self._camera = checked_camera(self.views[side])

    def _at_rest(self) -> None:
        view = self._view()
        if view is not None:
            view.camera = self._camera

    def _look(self, change: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        self._camera = change(self._camera)
        self._number += 1
        self._say({"type": "camera", "camera": self._camera, "number": self._number}, _NAME)

    def _say(self, content: dict[str, Any], page: str) -> None:
        view = self._view()
        if view is not None:
            view._receive(view, {**content, "view": page}, [])

    # -- for the view --------------------------------------------------------------------------------------------------

    def deliver(self, message: dict[str, Any], pictures: list[bytes], frame: Frame) -> None:
        """A picture of the view, or two that are shown in turn; called by the thread that draws."""
        view = self._view()
        if view is None:
            return
        camera = self._camera if self._held is not None else view.camera
        about = {"n": message["seq"], "full": frame.is_full, "shows": view.shows, "badge": view.badge}
        layers = [(picture, {**about_picture(image, camera), **about, "layer": k})
                  for k, (image, picture) in enumerate(zip(frame.images, pictures, strict=True))]
        with self._lock:
            self._layers = layers
            self._push(*layers[0])
        if len(layers) > 1 and not self._blink.is_closed:
            self._blink.at_rest(_BLINK, self._show_other)

    def _show_other(self) -> None:
        with self._lock:
            if len(self._layers) < 2 or self._blink.is_closed:
                return
            self._layers.reverse()
            self._push(*self._layers[0])
        self._blink.at_rest(_BLINK, self._show_other)

    def close(self) -> None:
        """End its threads."""
        self._blink.close()
        self.thread.close()


class TrameFrames:
    """Carries a view's pictures to a frame in its page; :meth:`open` starts a server where none runs.

    Parameters
    ----------
    view : a :class:`~deformnb.widgets.VolumeView`.
    """

    def __init__(self, view: Any) -> None:
        self._view = weakref.ref(view)
        self._lock = threading.Lock()
        self._served: dict[str, _Served] = {}

    def open(self, origin: Any, tell: Callable[[str], None]) -> None:
        """A page of this origin wants the pictures.

        Parameters
        ----------
        tell : called with the frame's address, once it can be opened and from any thread.

        Raises
        ------
        DeformError
            If that is no origin.
        """
        allowed = checked_origin(origin)
        with self._lock:
            self._served = {name: one for name, one in self._served.items() if one.is_alive}
            view = self._view()
            if view is None:
                return
            served = self._served.get(allowed)
            if served is None:
                served = self._served[allowed] = _Served(Pane(view), allowed)
        served.when_ready(tell)

    def deliver(self, message: dict[str, Any], pictures: list[bytes], frame: Frame) -> None:
        """A picture, by the thread that draws."""
        for served in list(self._served.values()):
            served.pane.deliver(message, pictures, frame)

    def close(self) -> None:
        """End all servers."""
        with self._lock:
            served, self._served = list(self._served.values()), {}
        for one in served:
            one.close()


class _Served:
    """One server in a thread of its own."""

    def __init__(self, pane: Pane, origin: str) -> None:
        self.pane, self._origin = pane, origin
        self._ready = threading.Event()
        self._server: AppServer | None = None
        self._is_closed = False
        self._thread = threading.Thread(target=self._run, name="deformnb-trame", daemon=True)
        self._thread.start()

    @property
    def is_alive(self) -> bool:
        return self._thread.is_alive()

    def _run(self) -> None:
        async def serve() -> None:
            self._server = AppServer(self.pane, idle=_IDLE, page=build_pane, framed_by=self._origin)  # type: ignore[arg-type]
            if self._is_closed:
                return
            await self._server.run(lambda _: self._ready.set())

        try:
            asyncio.run(serve())
        except Exception:
            _LOG.exception("the server of a view has failed")
        finally:
            self._ready.set()
            self.pane.close()

    def when_ready(self, tell: Callable[[str], None]) -> None:
        """Call ``tell(address)`` once pages can come, in a thread that may wait for it."""
        def wait() -> None:
            self._ready.wait(60)
            if self._server is not None and self._server.url:
                tell(self._server.url)

        threading.Thread(target=wait, name="deformnb-trame-ready", daemon=True).start()

    def close(self) -> None:
        """End the server; takes a moment at most."""
        self._is_closed = True  # if the server is not made yet
        if self._server is not None:
            self._server.stop()
        self._thread.join(_LONGEST_END)


def build_pane(server: Any, pane: Any) -> None:
    """Give trame's server a page that is the picture and nothing else."""
    from trame.ui.html import DivLayout
    from trame.widgets import html
    from trame_client.widgets.core import AbstractElement
    from trame_rca.widgets import rca

    server.enable_module({"scripts": ["deformnb/app.js"], "styles": ["deformnb/app.css", "deformnb/widgets.css"],
                          "vue_use": ["deformnb_app"]})
    server.state.trame__title = "deformnb"
    server.state.dnb_views = pane.views
    with DivLayout(server), html.Div(classes="dnb-app-fill dnb-app-remote"):
        html.Div("VTK draws the first picture …", classes="dnb-app-waiting")
        rca.RemoteControlledArea(name=AREA, display="image", image_style=("dnb_image", {"width": "100%"}))
        AbstractElement("deformnb-remote", area=AREA, views=("dnb_views",))._attr_names.extend(["area", "views"])

"""What the pages of a view drawn in Python say and get: sizes, cameras and confirmations; pictures, notices, badges.

Messages by a page (each with ``view``, its own name): ``hello`` and ``size`` (width, height in pixels, background;
origin, for pictures by trame),
``camera`` (camera, number), ``seen`` (seq), ``bye``. Messages to the page: ``frame`` (seq, full, camera: the newest
number that it shows, with one JPEG, or two that are shown in turn), ``notice`` and ``badge`` (text), ``trame`` (view,
url: where a frame gets the pictures instead).
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable
from typing import Any

import traitlets

from deformnb.errors import DeformError
from deformnb.widgets.camera import checked_camera
from deformnb.widgets.frames import FrameSender
from deformnb.widgets.pages import Pages
from deformnb.widgets.scene_loop import Frame, SceneLoop
from deformnb.widgets.view_messages import dropping, take_traits, text, whole

_OF_PAGE = frozenset({"camera", "clip", "shows", "projection", "background", "width", "height"})


TRANSPORTS = {"comm": "", "trame": "deformnb.app.notebook:TrameFrames"}
"""How pictures reach a page, by name: over the notebook's own channel, or by what is imported once it is asked for."""


def check_transport(name: str) -> None:
    """Refuse a transport that is unknown or not installed."""
    if name not in TRANSPORTS:
        raise DeformError(f"unknown transport {name!r}; choose one of {', '.join(TRANSPORTS)}.")
    if name == "trame" and importlib.util.find_spec("trame_rca") is None:
        raise DeformError('pictures by trame need trame and trame-rca: pip install "deformnb[app]", or use '
                          'transport="comm".')


def carrier(name: str) -> Any:
    """The class that carries pictures."""
    module, _, made = TRANSPORTS[name].partition(":")
    return getattr(importlib.import_module(module), made)


class ServesPages(traitlets.HasTraits):
    """A view that sends pictures to its pages and takes what they say.

    Attributes
    ----------
    badge : what stands in a corner of the pictures.
    """

    width: Any
    height: Any
    background: Any
    badge: str
    transport: Any
    send: Callable[..., None]
    _loop: SceneLoop | None
    _change: Callable[..., None]

    def __init__(self, *args: Any, **traits: Any) -> None:
        self._pages = Pages()
        self._frames = FrameSender()
        self._notice = ""
        self._carrier: Any = None  # of pictures that do not go the notebook's way
        self._shown_camera: tuple[str, int] = ("", 0)  # of which page, and its number of the newest one in the scene
        super().__init__(*args, **traits)

    def _left(self) -> None:
        """The last page has gone."""
        raise NotImplementedError

    # -- to the pages --------------------------------------------------------------------------------------------------

    def _deliver(self, frame: Frame) -> None:
        view, number = self._shown_camera
        message, pictures = self._frames.pack(frame, camera=number, by=view)
        if self._carrier is None:
            self.send(message, pictures)
        else:
            self._carrier.deliver(message, pictures, frame)

    def _say(self, notice: str) -> None:
        self._notice = notice
        self.send({"type": "notice", "text": notice})

    # -- from the pages ------------------------------------------------------------------------------------------------

    def set_state(self, sync_data: Any) -> None:
        """Take what the page says of its traits, as far as it is right."""
        take_traits(sync_data, _OF_PAGE, super().set_state)  # type: ignore[misc]

    def _receive(self, _: Any, content: Any, buffers: list[Any]) -> None:
        with dropping("a message"):
            kind = content.get("type") if isinstance(content, dict) else None
            answer = _ANSWERS.get(kind) if isinstance(kind, str) else None
            if answer is None:
                raise ValueError("unknown kind")
            answer(self, text(content.get("view")), content)

    def _resized(self, view: str, content: dict[str, Any]) -> None:
        self._pages.put(view, content)
        if self.transport != "comm" and content["type"] == "hello":
            self._carry(view, content.get("origin"))
        self._change_page()
        for kind, words in (("notice", self._notice), ("badge", self.badge)):
            if content["type"] == "hello" and words:
                self.send({"type": kind, "text": words})

    def _carry(self, view: str, origin: Any) -> None:
        """Tell a page where its frame gets the pictures."""
        if self._carrier is None:
            self._carrier = carrier(self.transport)(self)
        self._carrier.open(origin, lambda url: self.send({"type": self.transport, "view": view, "url": url}))

    def draw_again(self) -> None:
        """A page has come that was not there when the last picture was sent: none is on its way to it."""
        self._frames.lost()
        if self._loop is not None and self._pages:
            self._loop.touch()

    def _put_carrier_away(self) -> None:
        carrier, self._carrier = self._carrier, None
        if carrier is not None:
            carrier.close()

    def _bye(self, view: str, content: dict[str, Any]) -> None:
        self._pages.drop(view)
        self._go_on(self._frames.left(view))
        if not self._pages:
            self._left()

    def _camera(self, view: str, content: dict[str, Any]) -> None:
        camera, number = checked_camera(content.get("camera")), whole(content.get("number"), 0, 2**53)

        def turn(scene: Any) -> None:
            scene.set_camera(camera)
            self._shown_camera = (view, number)

        self._change("camera", turn)

    def _seen(self, view: str, content: dict[str, Any]) -> None:
        self._go_on(self._frames.seen(whole(content.get("seq"), 1, 2**53), view))

    def _go_on(self, is_free: bool) -> None:
        """Draw what was held back while too many pictures were on their way."""
        if is_free and self._loop is not None:
            self._loop.touch()

    # -- what the pictures take from them ------------------------------------------------------------------------------

    def _shade(self) -> str:
        return self._pages.theme if self.background == "auto" else str(self.background)

    def _size(self) -> tuple[int, int]:
        """The largest of what the pages show, or what the traits say."""
        return self._pages.size((self.width, self.height))

    def _change_page(self) -> None:
        size, background = self._size(), self._shade()

        def resize(scene: Any) -> None:
            scene.set_size(size)
            scene.set_background(background)

        self._change("page", resize)


_ANSWERS: dict[str, Callable[[ServesPages, str, dict[str, Any]], None]] = {
    "hello": ServesPages._resized, "size": ServesPages._resized, "camera": ServesPages._camera,
    "seen": ServesPages._seen, "bye": ServesPages._bye,
}
"""What is done about each kind of message."""

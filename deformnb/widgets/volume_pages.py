"""What the pages of a view drawn in Python say and get: sizes, cameras and confirmations; pictures, notices, badges.

Messages by a page (each with ``view``, its own name): ``hello`` and ``size`` (width, height in pixels, background),
``camera`` (camera, number), ``seen`` (seq), ``bye``. Messages to the page: ``frame`` (seq, full, camera: the newest
number that it shows, with one JPEG, or two that are shown in turn), ``notice`` and ``badge`` (text).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import traitlets

from deformnb.widgets.frames import FrameSender
from deformnb.widgets.pages import Pages
from deformnb.widgets.scene_loop import Frame, SceneLoop
from deformnb.widgets.view import checked_camera
from deformnb.widgets.view_messages import dropping, take_traits, text, whole

_OF_PAGE = frozenset({"camera", "clip", "shows", "projection", "background", "width", "height"})


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
    send: Callable[..., None]
    _loop: SceneLoop | None
    _change: Callable[..., None]

    def __init__(self, *args: Any, **traits: Any) -> None:
        self._pages = Pages()
        self._frames = FrameSender()
        self._notice = ""
        self._shown_camera: tuple[str, int] = ("", 0)  # of which page, and its number of the newest one in the scene
        super().__init__(*args, **traits)

    def _left(self) -> None:
        """The last page has gone."""
        raise NotImplementedError

    # -- to the pages --------------------------------------------------------------------------------------------------

    def _deliver(self, frame: Frame) -> None:
        view, number = self._shown_camera
        self.send(*self._frames.pack(frame, camera=number, by=view))

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
        self._change_page()
        for kind, words in (("notice", self._notice), ("badge", self.badge)):
            if content["type"] == "hello" and words:
                self.send({"type": kind, "text": words})

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

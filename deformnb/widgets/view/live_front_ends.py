"""The front ends of a live view: which of them draw, their reports, and messages to them."""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Callable
from typing import Any

from msgspec import UnsetType

from deformnb.errors import DeformError
from deformnb.widgets.image_encoding import checked_png
from deformnb.widgets.messages.record import Message
from deformnb.widgets.messages.views import Measurements, PointsFollowed, Screenshot, ScreenshotRequest

Post = Callable[[Message, list[bytes]], None]
"""Sends a message with its buffers to the front ends."""

Send = Callable[[dict[str, Any], list[bytes]], None]
"""Sends the content of a message, with its buffers."""

_WINDOWS = 16  # front ends whose windows are known


class Outbox:
    """Sends messages to all front ends of a widget and counts them.

    Parameters
    ----------
    send : the widget's own.

    Examples
    --------
    >>> sent = []
    >>> outbox = Outbox(lambda content, buffers: sent.append(content["type"]))
    >>> outbox.post(ScreenshotRequest(id=1), [])
    >>> sent, outbox.count
    (['screenshot'], 1)
    """

    def __init__(self, send: Send) -> None:
        self._send = send
        self.count = 0

    def post(self, message: Message, buffers: list[bytes]) -> None:
        """Send a message with its buffers."""
        self.send(message.content(), buffers)

    def send(self, content: dict[str, Any], buffers: list[bytes]) -> None:
        """Send the content of a message of another widget."""
        self.count += 1
        self._send(content, buffers)


class LiveFrontEnds:
    """The front ends of a live view that draw, and their reports.

    Attributes
    ----------
    theme : background around the front end, "dark" or "light".
    stats : the last measurements.

    Examples
    --------
    >>> front_ends = LiveFrontEnds()
    >>> front_ends.add("a", has_card=False)
    >>> front_ends.newest_renderer(by_card=False), front_ends.newest_renderer(by_card=True)
    ('a', None)
    """

    def __init__(self) -> None:
        self.theme = "dark"
        self.stats: dict[str, float] = {}
        self._drawing: dict[str, bool] = {}  # each with whether by a graphics card
        self._senders: dict[str, str] = {}  # of the edits of points in space in the windows of front ends

    def add(self, view: str, *, has_card: bool) -> None:
        """A front end has come that draws, newest last."""
        self._drawing.pop(view, None)
        self._drawing[view] = has_card

    def drop(self, view: str) -> None:
        """A front end is closed."""
        self._drawing.pop(view, None)
        self._senders.pop(view, None)

    def take_theme(self, background: str | UnsetType) -> None:
        """Take the background around a front end, where its message has one."""
        self.theme = background or self.theme

    def follow(self, message: PointsFollowed) -> None:
        """Take the sender of the edits of points in space in a front end's window."""
        self._senders.pop(message.view, None)
        self._senders = dict([*self._senders.items(), (message.view, message.sender)][-_WINDOWS:])

    def measure(self, message: Measurements) -> None:
        """Take the measurements of a front end."""
        self.stats = message.numbers()

    def newest_renderer(self, *, by_card: bool) -> str | None:
        """The newest front end that draws, one with a graphics card first; ``by_card``: only such a one."""
        drawing = sorted(self._drawing.items(), key=lambda item: item[1])
        return drawing[-1][0] if drawing and drawing[-1][1] >= by_card else None

    def has_window_of(self, sender: str) -> bool:
        """Check whether one that draws is in the window of this sender of edits."""
        return any(self._senders.get(view) == sender for view in self._drawing)


class Screenshots:
    """Requests for the picture that is on the screen, and who waits for them.

    Parameters
    ----------
    post : sends a message to the front ends.

    Examples
    --------
    >>> screenshots = Screenshots(lambda message, buffers: None)
    >>> asyncio.run(screenshots.request(0.01)) is None  # no front end
    True
    """

    def __init__(self, post: Post) -> None:
        self._post = post
        self._numbers = itertools.count(1)
        self._waiting: dict[int, Callable[[bytes], None]] = {}

    async def request(self, timeout: float) -> bytes | None:
        """The first picture of a front end as a PNG, or None after so many seconds."""
        loop, number = asyncio.get_running_loop(), next(self._numbers)
        answer: asyncio.Future[bytes] = loop.create_future()

        def deliver(png: bytes) -> None:
            loop.call_soon_threadsafe(_settle, answer, png)

        self._waiting[number] = deliver
        try:
            self._post(ScreenshotRequest(id=number), [])
            return await asyncio.wait_for(answer, timeout)
        except TimeoutError:
            return None
        finally:
            self._waiting.pop(number, None)

    def receive(self, message: Screenshot, png: Any) -> None:
        """Take a picture of a front end; DeformError if no call waits for it."""
        deliver = self._waiting.get(message.id)
        if deliver is None:
            raise DeformError("no call waits for this picture.")
        deliver(checked_png(png))


def _settle(answer: asyncio.Future[bytes], png: bytes) -> None:
    if not answer.done():
        answer.set_result(png)

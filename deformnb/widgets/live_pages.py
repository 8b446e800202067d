"""What a live view and its pages say to each other.

Messages by the page (each with ``view``, the page's own name): ``hello`` (largest texture, voxels if the card has been
found to hold no more, renderer, background: the page's), ``chunk`` (id, index: asks for a piece), ``seen`` (seq: that
field is on the screen), ``screenshot`` (id, with a PNG), ``stats``, and ``still`` and ``drawn`` (see
:mod:`~deformnb.widgets.stand_in`). Messages to the page: ``chunk`` (id, index, start, with gzip), ``field`` (see
:mod:`~deformnb.widgets.card_maps`; seq: to be confirmed unless 0; follow: the index of the map that an editor moves,
and points, cuts and parts that the maps are of, or null), ``screenshot`` (id: asks for one), and ``drawn``. What the
page sends is checked and dropped if it is wrong.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import threading
from abc import abstractmethod
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from deformnb.errors import DeformError
from deformnb.fields import AbstractField
from deformnb.transfer import TransferFunction
from deformnb.volume import Grid, Volume
from deformnb.widgets.camera import Image
from deformnb.widgets.card_maps import CardMaps, card_maps
from deformnb.widgets.card_times import card_frames
from deformnb.widgets.live_moments import AbstractMoments
from deformnb.widgets.pacing import Pacer
from deformnb.widgets.shown_volume import Pieces, ShownVolume
from deformnb.widgets.space_points import QUICK_SIZE
from deformnb.widgets.stills import from_png
from deformnb.widgets.view_messages import measured, picture, text, whole

if TYPE_CHECKING:
    from deformnb.widgets.stand_in import StandIn

_LOG = logging.getLogger(__name__)

_ANY = 2**53  # a number of voxels that no card limits

OF_PAGE = frozenset({"camera", "clip", "shows", "projection", "background", "width", "height", "target_ms",
                     "settle_ms"})
"""Traits that a page may change: the camera by hand, the others by links of one widget with another in the page."""


class AnswersPages(AbstractMoments):
    """A part of a live view: what it sends to its pages, and what it does about their messages."""

    is_quick: bool
    editor: Any
    send: Callable[..., None]
    _limit: int
    _map_size: int
    _space_size: int
    _volume: Volume | None = None
    _window: tuple[float, float] | None = None
    _pieces: Pieces | None = None
    _field: AbstractField | None = None
    _output: Grid | None = None
    _followed: dict[str, Any] | None = None
    _transfer: TransferFunction | None = None
    _maps: CardMaps | None = None  # of the field, made when a page wants them
    _stand_in: StandIn | None = None  # draws for the pages that cannot

    def _meet_pages(self) -> None:
        self._lock = threading.RLock()  # callbacks run in another thread than cells
        self._largest = 2048  # along an axis of a texture, until a page says less
        self._sent_cut: str | None = None  # whose distances all pages have
        self._pacer = Pacer(self._send_field)
        self._has_page = False
        self._page_theme = "dark"
        self._waiting: dict[int, Callable[[bytes], None]] = {}
        self._numbers = itertools.count(1)
        self._page_stats: dict[str, float] = {}
        self._sent = {"volume_bytes": 0, "field_bytes": 0, "messages": 0}

    @abstractmethod
    def _put(self, volume: Volume, window: tuple[float, float] | None, field: AbstractField | None,
             output: Grid | None, followed: dict[str, Any] | None) -> None:
        """Show this from now on, with the voxels made ready anew."""

    @abstractmethod
    def still(self, size: tuple[int, int] | None = None) -> Image:
        """The same picture rendered by the core."""

    @property
    def _shown(self) -> ShownVolume | None:
        pieces = self._pieces
        return None if pieces is None else pieces.shown

    # -- to the pages --------------------------------------------------------------------------------------------------

    async def screenshot(self, timeout: float = 10.0) -> Image:
        """The picture that is on the screen now, (height, width, 3); without a page the one of :meth:`still`.

        Parameters
        ----------
        timeout : seconds to wait for the page. Where a front end delivers messages only between cells, nothing comes
            while this is awaited, and the still is returned.
        """
        loop, number = asyncio.get_running_loop(), next(self._numbers)
        answer: asyncio.Future[bytes] = loop.create_future()

        def deliver(png: bytes) -> None:
            loop.call_soon_threadsafe(_settle, answer, png)

        self._waiting[number] = deliver
        try:
            self._post({"type": "screenshot", "id": number}, [])
            return from_png(await asyncio.wait_for(answer, timeout))
        except TimeoutError:
            return self.still()
        finally:
            self._waiting.pop(number, None)

    def _post(self, content: dict[str, Any], buffers: list[bytes]) -> None:
        self._sent["messages"] += 1
        self.send(content, buffers)

    def _offer(self) -> None:
        if self._has_page:  # a page that comes later asks
            self._pacer.offer()

    def _send_field(self, number: int, view: str | None = None) -> None:
        with self._lock:
            shown, followed = self._shown, self._followed
            if shown is None:
                return
            maps = self._maps = self._maps or self._made_maps(shown)
        cut = (maps.content["planar"] or {}).get("cut")
        if number and cut and cut["id"] == self._sent_cut:
            maps = maps.without("distances")
        elif view is None:
            self._sent_cut = cut and cut["id"]
        self._sent["field_bytes"] += maps.size
        self._post({"type": "field", "view": view, "seq": number, "follow": followed, **maps.content}, maps.buffers)

    def _made_maps(self, shown: ShownVolume) -> CardMaps:
        if self._moments is not None:
            return card_frames(self._moments, shown, self._output, self._map_size)
        nodes = min(QUICK_SIZE, self._space_size) if self.is_quick else self._space_size
        return card_maps(self._field, shown, self._output, self._map_size, nodes)

    def _tell_stand_in(self) -> None:
        """Let whoever draws for pages that cannot draw what is shown now."""
        with self._lock:
            if self._stand_in is None or self._volume is None:
                return
            moment = self._at_present(self._field)
            is_followed = self._followed is not None and self._moments is None and self.editor is not None
            followed = (self.editor, self._followed["index"]) if is_followed and self._followed else None
            self._stand_in.show(self._volume, moment, self._output, followed)
            if self._moments is not None:
                self._stand_in.hear(self.player, self._tell_stand_in)

    def _draw_here(self) -> StandIn:
        """Whoever draws for pages that cannot."""
        from deformnb.widgets.stand_in import StandIn

        with self._lock:
            if self._stand_in is None:
                self._stand_in = StandIn(self, self._post, transfer=self._transfer or "specimen",
                                         map_size=self._map_size, space_size=self._space_size)
                self._tell_stand_in()
            return self._stand_in

    def _draw_no_more(self) -> None:
        with self._lock:
            stand_in, self._stand_in = self._stand_in, None
        if stand_in is not None:
            stand_in.close()

    # -- from the pages ------------------------------------------------------------------------------------------------

    def _receive(self, _: Any, content: Any, buffers: list[Any]) -> None:
        """Whatever a page sends: a mistake is logged and dropped, never raised into the front end's channel."""
        try:
            kind = content.get("type") if isinstance(content, dict) else None
            answer = _ANSWERS.get(kind) if isinstance(kind, str) else None
            if answer is None:
                raise ValueError("unknown kind")
            answer(self, text(content.get("view")), content, buffers or [])
        except (ValueError, TypeError, KeyError, DeformError) as error:
            _LOG.warning("a message of the page was dropped: %s", error)

    def _hello(self, view: str | None, content: dict[str, Any], buffers: list[Any]) -> None:
        largest = whole(content.get("largest"), 0, 2**16)
        self._take_theme(content)
        if largest == 0:
            return  # it cannot draw, and will ask to be drawn for
        self._has_page = True
        voxels = whole(content.get("voxels", _ANY), 1, _ANY)
        if (largest < self._largest or voxels < self._limit) and self._make_smaller(largest, voxels):
            view = None  # for all pages: what they have is of a finer volume
        self._send_field(0, view)

    def _make_smaller(self, largest: int, voxels: int) -> bool:
        """Whether there had to be fewer voxels for a card that holds no more along an axis, or no more of them."""
        with self._lock:
            self._largest, self._limit = min(largest, self._largest), min(voxels, self._limit)
            size = None if self._shown is None else self._shown.volume.grid
            if self._volume is None or size is None or (max(size.shape) <= largest and size.size <= voxels):
                return False
            self._put_again()
        return True

    def _put_again(self) -> None:
        """Show the same, with the voxels made ready anew."""
        assert self._volume is not None
        moments = self._moments
        self._put(self._volume, self._window, self._field, self._output, self._followed)
        self._moments = moments

    def _take_theme(self, content: dict[str, Any]) -> None:
        if content.get("background") in ("dark", "light"):
            self._page_theme = content["background"]

    def _seen(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        self._pacer.seen(whole(content.get("seq"), 1, 2**53))

    def _chunk(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        pieces = self._pieces  # taken once: a cell may show another volume meanwhile
        if pieces is None or content.get("id") != pieces.shown.id:
            return  # of a volume that was shown before: the page will notice
        index = whole(content.get("index"), 0, pieces.shown.chunks - 1)
        start, packed = pieces[index]
        self._sent["volume_bytes"] += len(packed)
        self._post({"type": "chunk", "view": view, "id": pieces.shown.id, "index": index, "start": start}, [packed])

    def _still(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        self._take_theme(content)
        if self._volume is not None:
            self._post({"type": "drawn", "view": view, "info": self._draw_here().info}, [])

    def _drawn(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        if self._volume is not None and not self._draw_here().receive(content.get("say")):
            self._draw_no_more()

    def _screenshot(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        deliver = self._waiting.get(whole(content.get("id"), 1, 2**53))
        if deliver is None:
            raise ValueError("a picture that nobody waits for")
        deliver(picture(buffers))

    def _stats(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        self._page_stats = measured(content)


_ANSWERS: dict[str, Callable[[AnswersPages, str, dict[str, Any], list[Any]], None]] = {
    "hello": AnswersPages._hello, "chunk": AnswersPages._chunk, "still": AnswersPages._still,
    "drawn": AnswersPages._drawn, "seen": AnswersPages._seen, "screenshot": AnswersPages._screenshot,
    "stats": AnswersPages._stats,
}
"""What is done about each kind of message."""


def _settle(answer: asyncio.Future[bytes], png: bytes) -> None:
    if not answer.done():
        answer.set_result(png)

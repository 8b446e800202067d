"""Pictures of a live view that its front end draws for Python, one after the other: the frames of a movie.

The messages are MovieFrame, MovieEnd, MoviePiece and MovieFailed of :mod:`deformnb.widgets.messages.views`.
"""

from __future__ import annotations

import threading
import uuid
import weakref
from collections.abc import Callable
from typing import Any

from deformnb._typing import Image, Progress
from deformnb.errors import DeformError
from deformnb.imaging.display import DisplaySettings
from deformnb.rbf.fields import AbstractField
from deformnb.volume.volume import Grid
from deformnb.widgets.image_encoding import checked_png, from_png
from deformnb.widgets.messages.views import MovieEnd, MovieFailed, MovieFrame, MoviePiece
from deformnb.widgets.textures import FieldTextures
from deformnb.widgets.view.live_front_ends import Post

# A frame takes a graphics card less than a second and a software renderer some seconds; before the first one the volume
# is made ready. Where messages come between cells only, nothing comes while one runs.
_PATIENCE = 30.0

_LOOKS = ("camera", "projection", "shows", "background", "clip", "frame", "show_folds", "ambient_occlusion")


class PageGoneError(DeformError):
    """The front end that draws was closed, does not answer, or cannot draw."""


class PageScene:
    """A renderer of exports whose pictures one front end of a live view draws; used and closed by one thread.

    Parameters
    ----------
    post : sends a message to the front ends.
    front_end : the one that draws.
    size : (width, height) in pixels.
    seen : how it is shown; the volume and its colours are those of the front end.
    maps : the textures of a field in the box of a grid.
    patience : seconds without a message of the front end after which it is abandoned.
    """

    def __init__(
        self,
        post: Post,
        front_end: str,
        size: tuple[int, int],
        seen: DisplaySettings,
        maps: Callable[[AbstractField | None, Grid | None], FieldTextures],
        *,
        patience: float = _PATIENCE,
    ) -> None:
        self._post, self.front_end, self._size, self._maps, self._patience = post, front_end, size, maps, patience
        self._looks = {name: getattr(seen, name) for name in _LOOKS}
        self._id = uuid.uuid4().hex
        self._index = 0
        self._heard = threading.Condition()
        self._pieces: dict[int, bytes] = {}
        self._wanted = -1  # bytes of the frame, known with its first piece
        self._why = ""
        self._field = maps(None, None)

    def set_field(self, field: AbstractField | None, output: Grid | None = None) -> None:
        """Deform the volume, in the box of a grid."""
        self._field = self._maps(field, output)

    def render(self, *, bands: int = 1, progress: Progress | None = None) -> Image | None:
        """The picture, (height, width, 3) uint8.

        Raises
        ------
        PageGoneError
            If the front end has been closed, has failed, or has not answered for a while.
        """
        with self._heard:
            self._pieces, self._wanted = {}, -1
            self._index += 1
            message = MovieFrame(
                view=self.front_end,
                id=self._id,
                index=self._index,
                size=list(self._size),
                looks=self._looks,
                **self._field.fields(),
            )
            self._post(message, self._field.buffers)
            while not self._why and sum(map(len, self._pieces.values())) != self._wanted:
                if not self._heard.wait(self._patience):
                    raise PageGoneError(f"the page has not answered for {self._patience:g} seconds")
            if self._why:
                raise PageGoneError(self._why)
            png = b"".join(self._pieces[offset] for offset in sorted(self._pieces))
        try:
            image = from_png(checked_png(png))
        except (ValueError, OSError) as error:  # no PNG, or a torn one
            raise PageGoneError("the page has sent no picture") from error
        if image.shape[1::-1] != self._size:
            raise PageGoneError(f"the page has drawn {image.shape[1]} x {image.shape[0]} pixels")
        return image

    def receive(self, message: MoviePiece, piece: Any) -> None:
        """Take a piece of a frame; DeformError if it is none of this one."""
        if message.id != self._id or message.index != self._index:
            raise DeformError("it is a piece of another movie or frame.")
        size, offset = message.size, message.offset
        with self._heard:
            there = sum(len(other) for start, other in self._pieces.items() if start != offset)
            if offset >= size or self._wanted not in (-1, size) or there + memoryview(piece).nbytes > size:
                raise DeformError("its piece does not fit.")
            self._wanted = size
            self._pieces[offset] = bytes(piece)
            self._heard.notify_all()

    def fail(self, message: MovieFailed) -> None:
        """Receive the report of the front end."""
        if message.id == self._id:
            self.give_up(f"the page reports: {message.message[:200]}")

    def give_up(self, why: str) -> None:
        """End the wait for a picture with an error."""
        with self._heard:
            self._why = why
            self._heard.notify_all()

    def close(self) -> None:
        """Let the front end release its resources."""
        self._post(MovieEnd(view=self.front_end, id=self._id), [])


class MovieHost:
    """The movie that a front end of a live view draws, if any: gives it what front ends send.

    Examples
    --------
    >>> piece = MoviePiece(view="a", id="m", index=1, offset=0, size=1)
    >>> MovieHost().receive(piece, b"")
    Traceback (most recent call last):
    deformnb.errors.DeformError: it is a piece of no movie.
    """

    def __init__(self) -> None:
        self._movie: Callable[[], PageScene | None] = _no_movie

    def start(self, movie: PageScene) -> PageScene:
        """Take this movie, held weakly, as the one in progress."""
        self._movie = weakref.ref(movie)
        return movie

    def receive(self, message: MoviePiece, piece: Any) -> None:
        """Take a piece of a frame; DeformError if no movie is drawn."""
        movie = self._movie()
        if movie is None:
            raise DeformError("it is a piece of no movie.")
        movie.receive(message, piece)

    def fail(self, message: MovieFailed) -> None:
        """Receive an error report of the front end."""
        movie = self._movie()
        if movie is not None:
            movie.fail(message)

    def drop(self, view: str) -> None:
        """A front end is closed: its movie ends with an error."""
        movie = self._movie()
        if movie is not None and movie.front_end == view:
            movie.give_up("the page has been closed")


def _no_movie() -> None:
    """The movie before the first one."""

"""Pieces of frames that a page draws: taken in any order, and refused where they do not fit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deformnb.imaging.display import DisplaySettings
from deformnb.widgets.image_encoding import as_png
from deformnb.widgets.messages.record import Message, Refused
from deformnb.widgets.messages.views import LIVE, FieldContent, MovieFrame, MoviePiece
from deformnb.widgets.textures import FieldTextures
from deformnb.widgets.view.page_scene import PageGoneError, PageScene

SIZE = (16, 12)
SHADES = np.arange(12 * 16 * 3, dtype=np.uint8).reshape(12, 16, 3)


class Page:
    """Answers each request for a frame with these pieces of a PNG: (offset, end)."""

    def __init__(self, *pieces: tuple[int, int | None], png: bytes | None = None, **about: Any) -> None:
        self.png, self.pieces, self.about = png or as_png(SHADES), pieces, about
        self.refused: list[str] = []
        nothing = FieldTextures(FieldContent(box={"low": [], "high": []}), [])
        self.scene = PageScene(self.take, "p", SIZE, DisplaySettings(), lambda field, output: nothing, patience=0.01)

    def take(self, message: Message, _buffers: list[bytes]) -> None:
        if not isinstance(message, MovieFrame):
            return
        for offset, end in self.pieces:
            about = {"id": message.id, "index": message.index, "size": len(self.png), "offset": offset, **self.about}
            piece = LIVE.read({"type": "movie_piece", "view": "p", **about}, [self.png[offset:end]])
            if isinstance(piece, Refused):
                self.refused.append(piece.reason)
                continue
            assert isinstance(piece, MoviePiece)
            try:
                self.scene.receive(piece, self.png[offset:end])
            except ValueError as error:
                self.refused.append(str(error))


def test_a_frame_is_put_together_of_its_pieces_also_if_one_comes_twice() -> None:
    page = Page((40, 90), (0, 40), (40, 90), (90, None))
    np.testing.assert_array_equal(page.scene.render(), SHADES)
    np.testing.assert_array_equal(page.scene.render(), SHADES)
    assert page.refused == []


@pytest.mark.parametrize(
    ("about", "why"),
    [
        ({"id": "another"}, "another movie"),
        ({"index": 7}, "or frame"),
        ({"size": 2**40}, "size: expected a whole number <="),
        ({"size": 1.5}, "size: expected a whole number"),
        ({"offset": -1}, "offset: expected a whole number >= 0"),
        ({"offset": None}, "offset: expected a whole number"),
        ({"size": 20}, "does not fit"),
    ],
    ids=str,
)
def test_a_piece_that_does_not_fit_is_refused_and_the_wait_has_an_end(about: dict[str, Any], why: str) -> None:
    page = Page((0, None), **about)
    with pytest.raises(PageGoneError, match=r"not answered for 0\.01 seconds"):
        page.scene.render()
    assert why in page.refused[0]


def test_pieces_that_overlap_never_hold_more_than_the_frame() -> None:
    page = Page((0, 90), (10, None), (90, None))
    np.testing.assert_array_equal(page.scene.render(), SHADES)
    assert page.refused == ["its piece does not fit."]


def test_a_picture_of_another_size_ends_the_movie() -> None:
    page = Page((0, None), png=as_png(SHADES[:, :9]))
    with pytest.raises(PageGoneError, match="9 x 12 pixels"):
        page.scene.render()


@pytest.mark.parametrize("png", [b"no picture at all", as_png(SHADES)[:60]], ids=["text", "torn"])
def test_what_is_no_picture_ends_the_movie(png: bytes) -> None:
    with pytest.raises(PageGoneError, match="no picture"):
        Page((0, None), png=png).scene.render()

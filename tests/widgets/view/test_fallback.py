"""The renderer for clients of a live view that cannot draw: its answers, its inputs, and its end. No browser."""

from __future__ import annotations

import io
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from front_end import deliver, deliver_edit
from PIL import Image

from deformnb.document.deformation import Deformation
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.messages.editors import PointsEdit
from deformnb.widgets.view.live_view import LiveView

GRID = Grid((20, 20, 20))
PLANE = Plane.from_view(GRID, "+y")


class Recorded(LiveView):
    """A view whose messages are recorded instead of sent."""

    def send(self, content: Any, buffers: Any = None) -> None:
        self.__dict__.setdefault("out", []).append((content, list(buffers or [])))

    def say(self, view: str = "a", **content: Any) -> None:
        deliver(self, {"view": view, **content})

    def draws(self, **said: Any) -> None:
        """A message of a front end to its renderer."""
        self.say(type="drawn", say={"view": "a", **said})

    @property
    def frames(self) -> list[tuple[dict[str, Any], list[bytes]]]:
        return [(c, b) for c, b in list(self.__dict__.get("out", [])) if c["type"] == "frame"]

    def wait(self, condition: Callable[[dict[str, Any], np.ndarray], bool], timeout: float = 120.0) -> np.ndarray:
        """A page that shows every picture, until one is as wanted."""
        end, at = time.monotonic() + timeout, 0
        while time.monotonic() < end:
            for content, (jpeg, *_) in (frames := self.frames)[at:]:
                self.draws(type="seen", seq=content["seq"])
                image = np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB")).astype(int)
                if condition(content, image):
                    return image
            at = len(frames)
            time.sleep(0.01)
        raise TimeoutError("no such picture has come")


def ball() -> Volume:
    k = np.indices(GRID.shape) - 9.5
    return Volume(np.clip(60 * (5.5 - np.sqrt((k**2).sum(axis=0))), 0, 200).astype(np.uint8), GRID, "ball")


def moved(by: float) -> ControlPoints:
    return ControlPoints.from_arrays([[10.0, 10.0]], [[10.0 + by, 10.0]])


def column(image: np.ndarray) -> float:
    """The middle of the bright part, as a share of the width."""
    bright = np.nonzero(image.max(axis=2) > 64)[1]
    return float(bright.mean() / image.shape[1]) if len(bright) else -1.0


@pytest.fixture
def view() -> Iterator[Recorded]:
    made = Recorded(ball(), transfer="surface", background="dark", settle_ms=20.0)
    made.set_camera((0, 1, 0))
    yield made
    made.close()


def drawn_for(view: Recorded) -> np.ndarray:
    """A page that cannot draw has come; its first full picture."""
    view.__dict__["out"] = []
    view.say(type="hello", largest=0, renderer="", software=True, background="dark")
    view.say(type="still", background="dark")
    view.draws(type="hello", width=96, height=72, background="dark")
    return view.wait(lambda content, image: content["full"])


def test_a_page_that_cannot_draw_gets_pictures_and_no_field(view: Recorded) -> None:
    image = drawn_for(view)
    said = [content for content, _ in view.__dict__["out"]]
    assert [content["view"] for content in said if content["type"] == "drawn"] == ["a"]
    assert not {"field", "chunk"} & {content["type"] for content in said}
    assert image.shape == (72, 96, 3)
    assert column(image) == pytest.approx(0.5, abs=0.02)
    assert view.stats()["server_renderer"]["frames"] >= 1


def test_what_a_page_turns_and_what_python_shows_is_drawn_soon(view: Recorded) -> None:
    drawn_for(view)
    camera = {**view.camera, "pan": [-6.0, 0.0]}  # the eye to the left: all goes right
    view.draws(type="camera", camera=camera, number=7)
    image = view.wait(lambda content, image: content["camera"] == 7)
    assert column(image) > 0.55
    view.camera = {**camera, "pan": [0.0, 0.0]}
    view.wait(lambda content, image: abs(column(image) - 0.5) < 0.02)
    view.show_deformation(Deformation.from_picture_points(GRID, PLANE, moved(4.0), trend="translation"))
    view.wait(lambda content, image: column(image) > 0.56)
    view.shows = "original"
    view.wait(lambda content, image: abs(column(image) - 0.5) < 0.02)
    view.show(ball())
    view.background, view.shows = "light", "deformed"
    view.wait(lambda content, image: bool(image[2, 2].min() > 200))


def test_a_page_knows_the_box_that_its_pictures_show(view: Recorded) -> None:
    away = Deformation.from_picture_points(GRID, PLANE, moved(4.0), trend="translation")
    view.show_deformation(away, output=GRID.crop((0, 0, 0), (20, 20, 28)))
    drawn_for(view)
    (told,) = [content["info"]["box"] for content, _ in view.__dict__["out"] if content["type"] == "drawn"]
    assert told["high"] == [27.5, 19.5, 19.5]
    view.show_deformation(away)
    told = [content["info"]["box"] for content, _ in list(view.__dict__["out"]) if content["type"] == "info"][-1]
    assert told["high"] == [19.5, 19.5, 19.5]


def test_a_drag_is_followed_while_the_button_is_down(view: Recorded) -> None:
    editor = Editor(None, moved(0.0), trend="translation")
    view.follow(editor, Deformation.from_picture_points(GRID, PLANE, moved(0.0), trend="translation").field(GRID))
    assert not editor.live  # the page would follow by itself
    drawn_for(view)
    assert editor.live
    for k in range(1, 5):
        deliver_edit(editor, PointsEdit(sender="a", seq=k, phase="move", kind="move", points=moved(float(k))))
    view.wait(lambda content, image: column(image) > 0.56)
    assert editor.points == moved(0.0)  # the user has not let go
    deliver_edit(editor, PointsEdit(sender="a", seq=9, phase="move", kind="move", points=moved(0.0)))
    view.wait(lambda content, image: abs(column(image) - 0.5) < 0.02)


def test_it_ends_with_its_last_page(view: Recorded) -> None:
    editor = Editor(None, moved(0.0), trend="translation")
    view.follow(editor, Deformation.from_picture_points(GRID, PLANE, moved(0.0), trend="translation").field(GRID))
    drawn_for(view)
    view.draws(type="bye")
    assert not editor.live
    assert "server_renderer" not in view.stats()
    drawn_for(view)  # the page comes again
    view.close()
    assert not editor.live


@pytest.mark.parametrize(
    "said",
    [
        None,
        {},
        {"type": "camera", "view": "a", "camera": {"zoom": "x"}, "number": 1},
        {"type": "hello", "view": "a", "width": 10**9, "height": 10, "background": "dark"},
    ],
)
def test_what_is_wrong_is_dropped(view: Recorded, said: Any, caplog: pytest.LogCaptureFixture) -> None:
    drawn_for(view)
    view.say(type="drawn", say=said)
    assert "dropped" in caplog.text
    assert view.stats()["server_renderer"]["width"] == 96

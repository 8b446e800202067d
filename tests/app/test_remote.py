"""Pictures for pages that cannot draw: the newest of all changes, none lost, and no more of them than a page takes."""

from __future__ import annotations

import asyncio
import io
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from running_app import PATIENCE, RunningApp, connected, edit_of, heard

from deformnb.app.remote import RemoteView
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.errors import DeformError
from deformnb.session.session import Session
from deformnb.volume.volume import Volume
from deformnb.widgets.protocol import points_to_json

SIZE = {"w": 300, "h": 200, "p": 1}


def until(condition: Callable[[], Any]) -> None:
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "it did not come true"
        time.sleep(0.005)


class Folding:
    remark = ""


class Scene:
    """A scene of one grey level, which notes what is asked of it and draws while its gate is open."""

    def __init__(self) -> None:
        self.grey, self.size, self.closed, self.folding = 0, (8, 8), 0, Folding()
        self.cameras: list[dict[str, Any]] = []
        self.drawn: list[tuple[float, int]] = []
        self.gate = threading.Event()
        self.gate.set()

    def set_camera(self, camera: dict[str, Any]) -> None:
        self.cameras.append(camera)

    def set_size(self, size: tuple[int, int]) -> None:
        self.size = size

    def set_shows(self, shows: str) -> None:
        self.shows = shows

    def render(self, *, scale: float = 1.0, shows: str | None = None, **options: Any) -> Any:
        self.drawn.append((scale, self.grey))
        self.gate.wait(PATIENCE)
        grey = 255 - self.grey if shows == "original" else self.grey
        return np.full((max(1, int(self.size[1] * scale)), max(1, int(self.size[0] * scale)), 3), grey, np.uint8)

    def close(self) -> None:
        self.closed += 1


class Page:
    """What a view sends, and a page that says of each picture that it has come, unless it is silent."""

    def __init__(self, *, answers: bool = True, scene: Scene | None = None, **options: Any) -> None:
        self.scene, self.answers = scene or Scene(), answers
        self.pictures: list[tuple[bytes, dict[str, Any]]] = []
        self.said: list[str] = []
        self.making = threading.Event()
        self.may_make = threading.Event()
        self.may_make.set()
        self.view = RemoteView(self.make, self.said.append, self.push, PHANTOMS["bar"].make((12, 16, 20)).grid,
                               settle_ms=20.0, **options)

    def make(self, size: tuple[int, int]) -> Scene:
        self.making.set()
        assert self.may_make.wait(PATIENCE)
        self.scene.size = size
        return self.scene

    def push(self, data: bytes, about: dict[str, Any]) -> None:
        self.pictures.append((data, about))
        if self.answers:
            self.view.seen(about["n"], "page")

    @property
    def grey(self) -> int:
        """Of the last picture."""
        from PIL import Image

        return int(np.asarray(Image.open(io.BytesIO(self.pictures[-1][0])))[0, 0, 0])

    def shows(self, grey: int) -> bool:
        """Whether a full picture of this grey level is the last one."""
        return bool(self.pictures) and self.pictures[-1][1]["full"] and abs(self.grey - grey) < 2


@pytest.fixture
def page() -> Iterator[Page]:
    made = Page()
    yield made
    made.scene.gate.set()
    made.may_make.set()
    made.view.close()


def grey(value: int) -> Callable[[Any], None]:
    return lambda scene: setattr(scene, "grey", value)


def test_it_draws_quickly_then_fully_once_a_page_has_a_size(page: Page) -> None:
    page.view.change("grey", grey(90))
    time.sleep(0.1)
    assert not page.making.is_set()  # nobody looks
    page.view.update_size(SIZE)
    until(lambda: page.shows(90))
    sizes = [(about["w"], about["h"]) for _, about in page.pictures]
    assert sizes[-1] == page.scene.size == (300, 200)
    assert sizes[0][0] < 300
    assert not page.pictures[0][1]["full"]
    assert {about["type"] for _, about in page.pictures} == {"image/jpeg"}
    page.view.close()
    assert page.scene.closed == 1


def test_a_hand_turns_only_while_a_button_is_held(page: Page) -> None:
    page.view.on_event({"type": "LeftButtonPress", "x": 10, "y": 10})  # before there is a scene
    page.view.update_size(SIZE)
    until(lambda: page.shows(0))
    first = page.pictures[-1][1]["camera"]
    page.view.on_event({"type": "MouseMove", "x": 40, "y": 10, "w": 300, "h": 200})
    until(lambda: page.pictures[-1][1]["full"] and page.pictures[-1][1]["camera"] != first)
    turned = page.pictures[-1][1]["camera"]
    assert turned["direction"][0] > first["direction"][0] + 0.2  # what is in front has gone to the right
    page.view.on_event({"type": "LeftButtonRelease", "x": 40, "y": 10})
    page.view.on_event({"type": "MouseMove", "x": 90, "y": 10, "w": 300, "h": 200})
    assert page.view.camera["direction"] == turned["direction"]


def test_an_edit_while_the_scene_is_made_is_not_lost(page: Page) -> None:
    page.may_make.clear()
    page.view.update_size(SIZE)
    assert page.making.wait(PATIENCE)
    page.view.change("grey", grey(120))  # the scene is being made from what was before
    page.view.set_camera((1, 0, 0))
    page.may_make.set()
    until(lambda: page.shows(120))
    assert page.pictures[-1][1]["camera"]["direction"] == [1.0, 0.0, 0.0]


def test_a_slider_that_is_faster_than_pictures_starves_none_and_its_last_value_is_shown(page: Page) -> None:
    page.view.update_size(SIZE)
    until(lambda: page.shows(0))
    before, value = len(page.scene.drawn), 0
    end = time.monotonic() + PATIENCE
    while len({level for _, level in page.scene.drawn[before:]}) < 4:  # while it goes on, not only at its end
        assert time.monotonic() < end, "the slider keeps pictures from being drawn"
        value = value % 250 + 1
        page.view.change("grey", grey(value))
        page.view.set_camera((1, value / 100, 0))
        time.sleep(0.002)
    page.view.change("grey", grey(200))
    page.view.set_camera((1, 2, 0))
    until(lambda: page.shows(200))
    assert page.pictures[-1][1]["camera"]["direction"] == [1.0, 2.0, 0.0]


def test_of_edits_behind_a_slow_picture_only_the_newest_is_made(page: Page) -> None:
    page.view.update_size(SIZE)
    until(lambda: page.shows(0))
    page.scene.gate.clear()
    done: list[int] = []
    page.view.change("grey", grey(1))
    until(lambda: page.scene.drawn[-1][1] == 1)  # the picture of it is being drawn
    for value in range(2, 100):
        page.view.change("grey", lambda scene, value=value: (done.append(value), grey(value)(scene)))
    page.scene.gate.set()
    until(lambda: page.shows(99))
    assert done == [99]


def test_what_fails_is_said_and_what_comes_after_it_is_drawn(page: Page) -> None:
    def wrong(scene: Any) -> None:
        raise DeformError("this cannot be")

    page.view.update_size(SIZE)
    until(lambda: page.shows(0))
    page.view.change("bad", wrong)
    page.view.change("grey", grey(70))
    until(lambda: page.shows(70))
    assert page.said == ["this cannot be"]


def test_no_more_pictures_are_on_their_way_than_a_page_has_taken() -> None:
    page = Page(answers=False)
    page.view.update_size(SIZE)
    until(lambda: page.shows(0))
    first = page.pictures[-1][1]["n"]
    page.view.seen(first, "page")
    for value in range(1, 60):
        page.view.change("grey", grey(value))
        time.sleep(0.005)
    until(lambda: page.pictures[-1][1]["n"] > first)
    quick = [about["n"] for _, about in page.pictures if about["n"] > first and not about["full"]]
    # Two, for the page has answered none of them; and one more for each second that a busy machine takes for this.
    assert len(quick) <= 6
    page.answers = True
    page.view.seen(page.pictures[-1][1]["n"], "page")
    until(lambda: page.shows(59))
    page.view.close()


def test_a_scene_that_cannot_be_made_is_said_once_and_tried_again() -> None:
    said: list[str] = []
    tries: list[tuple[int, int]] = []

    def make(size: tuple[int, int]) -> Any:
        tries.append(size)
        raise DeformError("no OpenGL here.")

    view = RemoteView(make, said.append, lambda data, about: None, PHANTOMS["bar"].make((12, 16, 20)).grid)
    for count, width in enumerate((300, 310), 1):
        view.update_size({"w": width, "h": 200, "p": 1})
        until(lambda count=count: len(tries) == count)
    view.close()
    assert said == ["no OpenGL here."]
    assert tries[1] == (310, 200)


def test_before_and_after_are_shown_in_turn(page: Page) -> None:
    page.view.update_size(SIZE)
    page.view.change("grey", grey(40))
    until(lambda: page.shows(40))
    page.view.set_shows("flicker")
    until(lambda: abs(page.grey - 215) < 2)
    assert page.pictures[-1][1]["layer"] == 1
    until(lambda: abs(page.grey - 40) < 2)
    assert page.pictures[-1][1]["layer"] == 0
    assert page.scene.shows == "flicker"
    page.view.set_shows("deformed")
    until(lambda: page.pictures[-1][1]["shows"] == "deformed" and page.shows(40))
    count = len(page.pictures)
    time.sleep(1.0)  # longer than a turn
    assert len(page.pictures) == count


def test_words_about_folds_come_with_the_picture(page: Page) -> None:
    page.view.update_size(SIZE)
    page.view.change("fold", lambda scene: setattr(scene.folding, "remark", "red: where the map folds"))
    until(lambda: bool(page.pictures) and page.pictures[-1][1]["badge"] == "red: where the map folds")
    page.view.set_shows("original")
    until(lambda: page.pictures[-1][1]["badge"] == "")


@pytest.mark.parametrize("size", [
    {"w": 4, "h": 200}, {"w": 300, "h": 9e9}, {"w": "a", "h": 3}, None, {"w": 99, "h": 99, "p": 0}])
def test_sizes_that_cannot_be_are_refused(page: Page, size: Any) -> None:
    with pytest.raises(DeformError):
        page.view.update_size(size)
    assert not page.view.is_used


@pytest.mark.parametrize("given", [(0, ""), (True, ""), ("1", ""), (1, 3), (1, "n" * 500)])
def test_confirmations_that_cannot_be_are_refused(page: Page, given: tuple[Any, Any]) -> None:
    with pytest.raises(ValueError, match=r"a number|a view"):
        page.view.seen(*given)


@pytest.mark.needs_gl
def test_vtk_sends_pictures_that_follow_the_session() -> None:
    from PIL import Image

    voxels = np.zeros((16, 16, 32), np.uint8)
    voxels[5:11, 5:11, 13:19] = 255  # a cube in the middle

    async def talk(running: RunningApp) -> tuple[Any, Any]:
        async with connected(running) as page:
            def full(message: dict[str, Any]) -> bool:
                meta = message.get("result", {}).get("meta") or {}
                return message["id"].startswith("publish:trame.rca.topic.stream") and meta.get("full")

            await page.call("trame.trigger", "front", [], {})
            await page.call("trame.rca.size", "volume", "page", {"w": 320, "h": 200, "p": 1})
            before = (await heard(page, full))["result"]["content"]
            page.heard.clear()
            points = running.application.session.points
            moved = points
            for k in range(len(points)):
                moved = moved.move(int(points.ids[k]), points.target[k] + [6.0, 0.0])
            await page.call("deformnb.message", "editor", edit_of(points_to_json(moved)))
            return before, (await heard(page, full))["result"]["content"]

    session = Session(Volume.from_array(voxels), view="+y", transfer="bone")
    with RunningApp(session, viewer="vtk") as running:
        before, after = (np.asarray(Image.open(io.BytesIO(data)).convert("L"), float)
                         for data in asyncio.run(talk(running)))

    def middle(picture: Any) -> float:
        bright = picture > 100
        assert bright.sum() > 200
        return float(np.nonzero(bright)[1].mean())

    width = before.shape[1]  # of a full picture, which has fewer pixels on a slow machine
    assert middle(before) == pytest.approx(width / 2 - 0.5, abs=width / 80)
    assert middle(after) > middle(before) + width / 13  # 6 of some 32 voxels to the right

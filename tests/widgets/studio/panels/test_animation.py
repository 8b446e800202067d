"""Key frames in the studio: made, chosen, moved and played from the panel; movies with progress and a stop button."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
import pytest
from front_end import deliver

from deformnb.document.animation import Animation
from deformnb.document.deformation import Deformation
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.image_encoding import as_png
from deformnb.widgets.studio.panels import animation as animation_panel
from deformnb.widgets.studio.panels.animation import AnimationPanel
from deformnb.widgets.view.live_view import LiveView

GRID = Grid((16, 16, 32))


def bar() -> Volume:
    k, j, i = np.indices(GRID.shape)
    inside = (np.abs(k - 7.5) < 3) & (np.abs(j - 7.5) < 4) & (np.abs(i - 15.5) < 13)
    return Volume((200 * inside).astype(np.uint8), GRID, "bar")


class Bench:
    """A panel with its session and a view, as the studio holds them."""

    def __init__(self, folder: Path, view: Any = None) -> None:
        volume = bar()
        self.said: list[str] = []
        points = ControlPoints.from_arrays([[4.0, 6.0], [4.0, 9.0], [15.0, 7.5], [28.0, 7.5]])
        self.session = Session(volume, Deformation.from_picture_points(GRID, "+y", points))
        self.view = view or LiveView(volume, width=64, height=64)
        self.panel = AnimationPanel(self.session, self.guard, self.view, folder)
        self.session.editing.observe(lambda _: self.panel.refresh(), "deformation")

    def guard(self, action: Any) -> bool:
        try:
            action()
        except Exception as error:
            self.said.append(str(error))
            return False
        return True

    def press(self, text: str) -> None:
        found = [w for w in everything(self.panel.box) if getattr(w, "description", "") == text]
        found[0].click()

    def act(self, what: str, index: int) -> None:
        items = self.panel.items
        deliver(items, {"type": "act", "what": what, "index": index, "version": items.version})

    def drag(self, target: tuple[float, float]) -> None:
        self.session.editing.edit_points(self.session.editing.points.move(3, target))

    @property
    def times(self) -> list[float]:
        return [key.time for key in self.session.editing.deformation.keyframes]

    @property
    def titles(self) -> list[str]:
        return [row["title"] for row in self.panel.items.rows]


def everything(widget: Any) -> Iterator[Any]:
    yield widget
    for child in getattr(widget, "children", ()):
        yield from everything(child)


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path)
    yield made
    made.panel.close()


def test_key_frames_are_added_chosen_updated_moved_and_removed(bench: Bench) -> None:
    assert bench.panel.items.rows == []
    assert bench.panel.player.duration == 0
    bench.press("Add key frame")
    bench.drag((22.0, 16.0))
    bench.press("Add key frame")
    assert bench.titles == ["0 s", "1 s"]
    assert [row["facts"][1] for row in bench.panel.items.rows] == ["", "as it is now"]
    assert (bench.panel.items.chosen, bench.panel.player.duration, bench.panel.player.marks) == (1, 1.0, [0.0, 1.0])
    assert bench.panel.player.time == 1.0
    assert "Key frame 2 is at 1 s" in bench.session.editing.notice
    assert "the next, at 2 s" in bench.session.editing.notice

    bench.act("choose", 0)
    assert bench.session.editing.points.target[3].tolist() == [28.0, 7.5]
    assert (bench.panel.items.chosen, bench.panel.player.time) == (0, 0.0)
    bench.drag((28.0, 8.5))
    assert [row["facts"][1] for row in bench.panel.items.rows] == ["", ""]
    bench.press("Update")
    assert bench.session.editing.deformation.keyframes[0].steps[0].points.target[3].tolist() == [28.0, 8.5]

    bench.panel.time.value = 3.0
    assert bench.times == [1.0, 3.0]
    assert (bench.panel.items.chosen, bench.panel.time.value) == (1, 3.0)
    bench.panel.time.value = 1.0  # there is one already
    assert "at 1 s already" in bench.said[-1]
    assert (bench.times, bench.panel.time.value) == ([1.0, 3.0], 3.0)
    bench.act("double", 0)
    assert bench.times == [1.0, 3.0, 4.0]
    assert bench.panel.items.chosen == 2
    bench.act("remove", 1)
    assert bench.times == [1.0, 4.0]
    for _ in range(2):
        bench.session.editing.undo()
    assert bench.times == [1.0, 3.0]
    assert bench.session.editing.history["redo"] == "repeat a key frame"


def test_a_key_frame_comes_where_the_player_rests_between_two(bench: Bench) -> None:
    bench.press("Add key frame")
    bench.drag((22.0, 16.0))
    bench.press("Add key frame")
    bench.panel.player.time = 0.4
    bench.press("Edit this moment")
    assert bench.session.editing.points.target[3] == pytest.approx([25.9, 11.1], abs=0.5)
    assert bench.session.editing.history["undo"] == "go to a moment"
    bench.press("Add key frame")
    assert bench.times == [0.0, 0.4, 1.0]
    bench.press("Add key frame")  # it is on a key frame now: after the last
    assert bench.times == [0.0, 0.4, 1.0, 2.0]


def test_the_view_goes_through_the_moments_and_comes_back_to_the_document(bench: Bench) -> None:
    bench.press("Add key frame")
    bench.drag((22.0, 16.0))
    bench.press("Add key frame")
    bench.panel.player.time = 0.5
    bench.panel.playback.wait()
    maps = bench.view.moments
    assert maps is not None
    assert len(maps) >= 4
    bench.panel.player.time = 0.7
    bench.panel.playback.wait()
    assert bench.view.moments is maps  # nothing is made or sent again
    middle = bench.view.still((64, 48)).astype(int)
    bench.view.show_deformation(bench.session.editing.deformation)  # as the studio does after an edit
    assert bench.view.moments is None
    assert np.abs(bench.view.still((64, 48)).astype(int) - middle).max() > 20
    bench.panel.easing.value = "smooth"
    bench.panel.playback.wait()
    assert bench.view.moments is not None
    assert bench.view.moments is not maps


def test_an_edit_stops_the_player_and_is_not_hidden_by_it(bench: Bench) -> None:
    bench.press("Add key frame")
    bench.drag((22.0, 16.0))
    bench.press("Add key frame")
    bench.panel.player.is_playing = True
    bench.panel.playback.wait()
    assert bench.view.moments is not None
    bench.drag((20.0, 14.0))
    assert not bench.panel.player.is_playing
    bench.view.show_deformation(bench.session.editing.deformation)
    bench.panel.player.time = 0.33  # a late message of the front end: where it has stopped
    bench.panel.playback.wait()
    assert bench.view.moments is None
    bench.panel.quiet_until = 0.0
    bench.panel.player.time = 0.5
    bench.panel.playback.wait()
    assert bench.view.moments is not None


def test_a_view_that_python_draws_is_shown_every_moment(tmp_path: Path) -> None:
    class DrawnByPython:
        def __init__(self) -> None:
            self.camera: dict[str, Any] = {}
            self.shown: list[Any] = []

        def show_deformation(self, field: Any, *, output: Any = None) -> None:
            self.shown.append(field)

    view = DrawnByPython()
    bench = Bench(tmp_path, view)
    bench.press("Add key frame")
    bench.drag((22.0, 16.0))
    bench.press("Add key frame")
    assert bench.panel.player.sync_ms == 60
    for time in (0.25, 1.0):
        bench.panel.player.time = time
        bench.panel.playback.wait()
        target = Animation(bench.session.editing.deformation).at(time).steps[0].points.target[3]
        plane = bench.session.editing.plane
        place = plane.from_plane([*target, 0.0])
        found = plane.to_plane(place + view.shown[-1].displacement(place))[:2]
        assert found == pytest.approx([28.0, 7.5], abs=0.3)  # where the point was taken
    bench.panel.close()


def test_moments_that_are_no_maps_are_shown_one_by_one(bench: Bench) -> None:
    bench.session.editing.change(cuts=(Cut(Line([(15.0, -5.0), (15.0, 30.0)])),))
    bench.press("Add key frame")
    bench.drag((24.0, 9.0))
    bench.press("Add key frame")
    shown: list[Any] = []

    def show(field: Any, *, output: Any = None) -> None:
        shown.append(field)

    bench.view.show_deformation = show
    bench.panel.player.time = 0.5
    bench.panel.playback.wait()
    assert bench.view.moments is None
    assert shown[-1].has_cuts
    assert bench.said == []


@pytest.mark.parametrize(("kind", "name"), [(".gif", "swim.gif"), ("", "swim")])
def test_a_movie_is_written(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, name: str
) -> None:
    monkeypatch.setattr("deformnb.session.exports._FRAME", (48, 36))
    movie = bench.panel.movie
    assert movie.write.disabled
    bench.press("Add key frame")
    bench.drag((22.0, 12.0))
    bench.press("Add key frame")
    movie.name.value = "swim.mp4"
    movie.kind.value = kind or ".gif"
    movie.kind.value = kind
    assert movie.name.value == name
    movie.fps.value = 4
    bench.panel.player.loop = "loop"
    bench.press("Write movie")
    movie.wait()
    assert bench.said == []
    assert movie.message.value == f"Wrote {name}."
    if kind:
        from PIL import Image

        with Image.open(tmp_path / name) as gif:
            assert gif.n_frames == 4  # it continues with the first
    else:
        assert len(list((tmp_path / name).glob("*.png"))) == 4
    assert not movie.write.disabled


def test_a_movie_is_stopped_and_nothing_is_left(bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun = threading.Event()

    def slow(*_given: Any, **_options: Any) -> Iterator[np.ndarray]:
        for _ in range(1000):
            yield np.zeros((12, 16, 3), np.uint8)
            begun.set()
            sleep(0.05)

    monkeypatch.setattr(animation_panel, "movie_frames", slow)
    bench.press("Add key frame")
    bench.panel.movie.kind.value = ".gif"
    bench.press("Write movie")
    assert bench.panel.movie.write.disabled
    assert begun.wait(30)
    bench.press("Cancel")
    bench.panel.movie.wait()
    assert bench.panel.movie.message.value == "Stopped; animation.gif was not written."
    assert list(tmp_path.iterdir()) == []
    bench.panel.movie.name.value = "../out.gif"
    bench.press("Write movie")
    assert "no plain file name" in bench.said[-1]


class DrawingPage:
    """A front end with a graphics card, whose frames are of one colour each; it leaves before the frame ``leaves``."""

    def __init__(self, view: LiveView, leaves: int = 1000) -> None:
        self.view, self.leaves, self.colours, self.requests = view, leaves, list[int](), list[str]()
        view.send = self.take
        deliver(view, {"type": "hello", "view": "p", "largest": 2048, "renderer": "a card", "software": False})

    def take(self, content: Any, buffers: Any = ()) -> None:
        if not content["type"].startswith("movie"):
            return
        self.requests.append(content["type"])
        if content["type"] == "movie_end":
            return
        if len(self.colours) == self.leaves:
            deliver(self.view, {"type": "bye", "view": "p"})
            return
        self.colours.append(40 + 10 * len(self.colours))
        width, height = content["size"]
        png = as_png(np.full((height, width, 3), self.colours[-1], np.uint8))
        about = {"type": "movie_piece", "view": "p", "id": content["id"], "index": content["index"], "size": len(png)}
        deliver(self.view, {**about, "id": "another", "offset": 0}, [png])  # is dropped
        for offset in (50, 0):  # in any order
            deliver(self.view, {**about, "offset": offset}, [png[offset : offset + 50] if offset == 0 else png[50:]])


def write_pictures(bench: Bench, folder: Path, name: str) -> list[np.ndarray]:
    from PIL import Image

    bench.panel.movie.kind.value, bench.panel.movie.name.value = "", name
    bench.press("Write movie")
    bench.panel.movie.wait()
    assert bench.said == []
    return [np.asarray(Image.open(path)) for path in sorted((folder / name).glob("*.png"))]


def test_a_page_with_a_card_draws_the_movie_and_python_all_of_it_if_the_page_leaves(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deformnb.session.exports._FRAME", (48, 36))
    movie, page = bench.panel.movie, DrawingPage(bench.view)
    bench.press("Add key frame")
    bench.drag((22.0, 12.0))
    bench.press("Add key frame")
    movie.fps.value = 3
    frames = write_pictures(bench, tmp_path, "page")
    assert [frame.ravel().tolist() for frame in frames] == [[c] * (48 * 36 * 3) for c in page.colours]
    assert len(frames) == len(page.colours) == 4
    assert movie.message.value == "Wrote page."
    assert page.requests[-1] == "movie_end"

    movie.renderer.value = "python"
    by_python = write_pictures(bench, tmp_path, "python")
    assert len(page.colours) == 4
    assert all(frame.std() > 5 for frame in by_python)

    movie.renderer.value = "automatic"
    leaving = DrawingPage(bench.view, leaves=2)
    np.testing.assert_array_equal(write_pictures(bench, tmp_path, "left"), by_python)
    assert len(leaving.colours) == 2
    assert movie.message.value == "Wrote left. Python has drawn it: the page has been closed."

    movie.renderer.value = "page"
    np.testing.assert_array_equal(write_pictures(bench, tmp_path, "nobody"), by_python)
    assert movie.message.value == "Wrote nobody. Python has drawn it: no page shows the view."


def test_how_an_animation_is_played_is_kept_with_its_document(bench: Bench) -> None:
    bench.panel.player.loop = "swing"  # nothing to store it with yet
    assert bench.session.editing.history["undo"] == ""
    bench.press("Add key frame")
    bench.drag((22.0, 12.0))
    bench.press("Add key frame")
    bench.panel.easing.value = "smooth"
    bench.panel.player.loop = "loop"
    document = bench.session.editing.deformation
    assert (document.easing, document.loop) == ("smooth", "loop")
    assert Animation(document).easing == "smooth"
    bench.session.editing.undo()
    bench.panel.refresh()
    assert bench.panel.player.loop == "once"
    bench.session.editing.undo()
    bench.panel.refresh()
    assert bench.panel.easing.value == "linear"

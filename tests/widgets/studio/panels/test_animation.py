"""Key frames in the studio: made, chosen, moved and played from the panel; movies with progress and a way to stop."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb.document.animation import Animation
from deformnb.document.deformation import Deformation
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.studio.panels import animation as animation_panel
from deformnb.widgets.studio.panels.animation import AnimationPanel
from deformnb.widgets.view.live_view import LiveView

GRID = Grid((16, 16, 32))


def bar() -> Volume:
    k, j, i = np.indices(GRID.shape)
    inside = (np.abs(k - 7.5) < 3) & (np.abs(j - 7.5) < 4) & (np.abs(i - 15.5) < 13)
    return Volume((200 * inside).astype(np.uint8), GRID, "bar")


class Desk:
    """A panel with its session and a view, as the studio holds them."""

    def __init__(self, folder: Path, view: Any = None) -> None:
        volume = bar()
        self.said: list[str] = []
        points = ControlPoints.from_arrays([[4.0, 6.0], [4.0, 9.0], [15.0, 7.5], [28.0, 7.5]])
        self.session = Session(volume, Deformation.on_picture(GRID, "+y", points))
        self.view = view or LiveView(volume, width=64, height=64)
        self.panel = AnimationPanel(self.session, self.guard, self.view, folder)
        self.session.observe(lambda _: self.panel.refresh(), "deformation")

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
        items._handle_custom_msg({"type": "act", "what": what, "index": index, "version": items.version}, [])

    def drag(self, target: tuple[float, float]) -> None:
        self.session.edit_points(self.session.points.move(3, target))

    @property
    def times(self) -> list[float]:
        return [key.time for key in self.session.deformation.keyframes]

    @property
    def titles(self) -> list[str]:
        return [row["title"] for row in self.panel.items.rows]


def everything(widget: Any) -> Iterator[Any]:
    yield widget
    for child in getattr(widget, "children", ()):
        yield from everything(child)


@pytest.fixture
def desk(tmp_path: Path) -> Iterator[Desk]:
    made = Desk(tmp_path)
    yield made
    made.panel.close()


def test_key_frames_are_added_chosen_updated_moved_and_removed(desk: Desk) -> None:
    assert desk.panel.items.rows == []
    assert desk.panel.player.duration == 0
    desk.press("Add key frame")
    desk.drag((22.0, 16.0))
    desk.press("Add key frame")
    assert desk.titles == ["0 s", "1 s"]
    assert [row["facts"][1] for row in desk.panel.items.rows] == ["", "as it is now"]
    assert (desk.panel.items.chosen, desk.panel.player.duration, desk.panel.player.marks) == (1, 1.0, [0.0, 1.0])

    desk.act("choose", 0)
    assert desk.session.points.target[3].tolist() == [28.0, 7.5]
    assert (desk.panel.items.chosen, desk.panel.player.time) == (0, 0.0)
    desk.drag((28.0, 8.5))
    assert [row["facts"][1] for row in desk.panel.items.rows] == ["", ""]
    desk.press("Update")
    assert desk.session.deformation.keyframes[0].steps[0].points.target[3].tolist() == [28.0, 8.5]

    desk.panel._time.value = 3.0
    assert desk.times == [1.0, 3.0]
    assert (desk.panel.items.chosen, desk.panel._time.value) == (1, 3.0)
    desk.panel._time.value = 1.0  # there is one already
    assert "at 1 s already" in desk.said[-1]
    assert (desk.times, desk.panel._time.value) == ([1.0, 3.0], 3.0)
    desk.act("double", 0)
    assert desk.times == [1.0, 3.0, 4.0]
    assert desk.panel.items.chosen == 2
    desk.act("remove", 1)
    assert desk.times == [1.0, 4.0]
    for _ in range(2):
        desk.session.undo()
    assert desk.times == [1.0, 3.0]
    assert desk.session.history["redo"] == "repeat a key frame"


def test_a_key_frame_comes_where_the_player_rests_between_two(desk: Desk) -> None:
    desk.press("Add key frame")
    desk.drag((22.0, 16.0))
    desk.press("Add key frame")
    desk.panel.player.time = 0.4
    desk.press("Edit this moment")
    assert desk.session.points.target[3] == pytest.approx([25.9, 11.1], abs=0.5)
    assert desk.session.history["undo"] == "go to a moment"
    desk.press("Add key frame")
    assert desk.times == [0.0, 0.4, 1.0]
    desk.press("Add key frame")  # it stands on a key frame now: after the last
    assert desk.times == [0.0, 0.4, 1.0, 2.0]


def test_the_view_goes_through_the_moments_and_comes_back_to_the_document(desk: Desk) -> None:
    desk.press("Add key frame")
    desk.drag((22.0, 16.0))
    desk.press("Add key frame")
    desk.panel.player.time = 0.5
    desk.panel.playback.wait()
    maps = desk.view.moments
    assert maps is not None
    assert len(maps) >= 4
    desk.panel.player.time = 0.7
    desk.panel.playback.wait()
    assert desk.view.moments is maps  # nothing is made or sent again
    middle = desk.view.still((64, 48)).astype(int)
    desk.view.show_deformation(desk.session.deformation)  # as the studio does after an edit
    assert desk.view.moments is None
    assert np.abs(desk.view.still((64, 48)).astype(int) - middle).max() > 20
    desk.panel._easing.value = "smooth"
    desk.panel.playback.wait()
    assert desk.view.moments is not None
    assert desk.view.moments is not maps


def test_an_edit_stops_the_player_and_is_not_hidden_by_it(desk: Desk) -> None:
    desk.press("Add key frame")
    desk.drag((22.0, 16.0))
    desk.press("Add key frame")
    desk.panel.player.is_playing = True
    desk.panel.playback.wait()
    assert desk.view.moments is not None
    desk.drag((20.0, 14.0))
    assert not desk.panel.player.is_playing
    desk.view.show_deformation(desk.session.deformation)
    desk.panel.player.time = 0.33  # what the page says a little later: where it has stopped
    desk.panel.playback.wait()
    assert desk.view.moments is None
    desk.panel._quiet_until = 0.0
    desk.panel.player.time = 0.5
    desk.panel.playback.wait()
    assert desk.view.moments is not None


def test_a_view_that_python_draws_is_shown_every_moment(tmp_path: Path) -> None:
    class DrawnByPython:
        def __init__(self) -> None:
            self.camera: dict[str, Any] = {}
            self.shown: list[Any] = []

        def show_deformation(self, field: Any, *, output: Any = None) -> None:
            self.shown.append(field)

    view = DrawnByPython()
    desk = Desk(tmp_path, view)
    desk.press("Add key frame")
    desk.drag((22.0, 16.0))
    desk.press("Add key frame")
    assert desk.panel.player.sync_ms == 60
    for time in (0.25, 1.0):
        desk.panel.player.time = time
        desk.panel.playback.wait()
        target = Animation(desk.session.deformation).at(time).steps[0].points.target[3]
        plane = desk.session.plane
        place = plane.from_plane([*target, 0.0])
        found = plane.to_plane(place + view.shown[-1].displacement(place))[:2]
        assert found == pytest.approx([28.0, 7.5], abs=0.3)  # where the point was taken
    desk.panel.close()


def test_moments_that_are_no_maps_are_shown_one_by_one(desk: Desk) -> None:
    desk.session.change(cuts=(Cut(Line([(15.0, -5.0), (15.0, 30.0)])),))
    desk.press("Add key frame")
    desk.drag((24.0, 9.0))
    desk.press("Add key frame")
    shown: list[Any] = []

    def show(field: Any, *, output: Any = None) -> None:
        shown.append(field)

    desk.view.show_deformation = show
    desk.panel.player.time = 0.5
    desk.panel.playback.wait()
    assert desk.view.moments is None
    assert shown[-1].has_cuts
    assert desk.said == []


@pytest.mark.parametrize(("kind", "name"), [(".gif", "swim.gif"), ("", "swim")])
def test_a_movie_is_written(desk: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, name: str) -> None:
    monkeypatch.setattr("deformnb.session.exports._FRAME", (48, 36))
    movie = desk.panel.movie
    assert movie.write.disabled
    desk.press("Add key frame")
    desk.drag((22.0, 12.0))
    desk.press("Add key frame")
    movie.name.value = "swim.mp4"
    movie.kind.value = kind or ".gif"
    movie.kind.value = kind
    assert movie.name.value == name
    movie.fps.value = 4
    desk.panel.player.loop = "loop"
    desk.press("Write movie")
    movie.wait()
    assert desk.said == []
    assert movie.said.value == f"Wrote {name}."
    if kind:
        from PIL import Image

        with Image.open(tmp_path / name) as gif:
            assert gif.n_frames == 4  # it goes on with the first
    else:
        assert len(list((tmp_path / name).glob("*.png"))) == 4
    assert not movie.write.disabled


def test_a_movie_is_stopped_and_nothing_is_left(desk: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun = threading.Event()

    def slow(*_given: Any, **_options: Any) -> Iterator[np.ndarray]:
        for _ in range(1000):
            yield np.zeros((12, 16, 3), np.uint8)
            begun.set()
            desk.panel.movie._stop.wait(0.05)

    monkeypatch.setattr(animation_panel, "movie_frames", slow)
    desk.press("Add key frame")
    desk.panel.movie.kind.value = ".gif"
    desk.press("Write movie")
    assert desk.panel.movie.write.disabled
    assert begun.wait(30)
    desk.press("Cancel")
    desk.panel.movie.wait()
    assert desk.panel.movie.said.value == "Stopped; animation.gif was not written."
    assert list(tmp_path.iterdir()) == []
    desk.panel.movie.name.value = "../out.gif"
    desk.press("Write movie")
    assert "no plain file name" in desk.said[-1]


def test_how_an_animation_is_played_is_kept_with_its_document(desk: Desk) -> None:
    desk.panel.player.loop = "swing"  # nothing to keep it with yet
    assert desk.session.history["undo"] == ""
    desk.press("Add key frame")
    desk.drag((22.0, 12.0))
    desk.press("Add key frame")
    desk.panel._easing.value = "smooth"
    desk.panel.player.loop = "loop"
    document = desk.session.deformation
    assert (document.easing, document.loop) == ("smooth", "loop")
    assert Animation(document).easing == "smooth"
    desk.session.undo()
    desk.panel.refresh()
    assert desk.panel.player.loop == "once"
    desk.session.undo()
    desk.panel.refresh()
    assert desk.panel._easing.value == "linear"

"""The volume view's Python: messages and refusals, moves of an editor, threads, experts. No browser."""

from __future__ import annotations

import asyncio
import gc
import importlib.util
import io
import json
import logging
import socket
import threading
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from front_end import deliver, deliver_edit
from PIL import Image
from waiting import Threads, wait_for

from deformnb.document.deformation import Deformation, Step
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import Composed, Identity
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.messages.editors import PointsEdit
from deformnb.widgets.view.base import AbstractView, PlanarFit, Refit
from deformnb.widgets.view.stills import CoreScene
from deformnb.widgets.view.volume_view import TRANSPORTS, VolumeView

GRID = Grid((10, 20, 12), (1.5, 1.0, 2.0), (5.0, -7.0, 30.0))
PLANE = Plane.from_view(GRID, "+y")
PAGE = {"width": 96, "height": 72, "background": "dark"}


def ball() -> Volume:
    k = np.indices(GRID.shape)[::-1] - (np.array(GRID.shape[::-1]) - 1).reshape(3, 1, 1, 1) / 2
    return Volume(np.clip(40 * (4.5 - np.sqrt((k**2).sum(axis=0))), 0, 200).astype(np.uint8), GRID, "ball")


def points(moved: float = 0.0) -> ControlPoints:
    source = np.array([[2.0, 2.0], [18.0, 3.0], [9.0, 12.0], [11.0, 7.0]])
    return ControlPoints.from_arrays(source, source + np.array([moved, 0.0]))


class Recorded(VolumeView):
    """A view whose messages are recorded instead of sent."""

    def send(self, content: Any, buffers: Any = None) -> None:
        self.__dict__.setdefault("out", []).append((content, list(buffers or [])))

    def say(self, **content: Any) -> None:
        deliver(self, {"view": "a", **content})

    @property
    def frames(self) -> list[tuple[dict[str, Any], list[bytes]]]:
        return [(c, b) for c, b in self.__dict__.get("out", []) if c["type"] == "frame"]

    @property
    def urls(self) -> list[str]:
        return [content["url"] for content, _ in self.__dict__.get("out", []) if content["type"] == "trame"]

    def see_all(self) -> None:
        """A page that shows every frame, until the full one of the newest state is there."""
        wait_for(
            lambda: (
                self._step()
                and self.scene.loop is not None
                and self.scene.loop.is_settled
                and self.frames
                and self.frames[-1][0]["full"]
            )
        )

    def _step(self) -> bool:
        if self.frames:
            self.say(type="seen", seq=self.frames[-1][0]["seq"])
        return True


@pytest.fixture
def open_view() -> Iterator[Callable[..., Recorded]]:
    made: list[Recorded] = []

    def make(volume: Volume | None = None, **options: Any) -> Recorded:
        made.append(
            Recorded(
                volume or ball(), **{"transfer": "surface", "settle_ms": 20.0, "width": 96, "height": 72, **options}
            )
        )
        return made[-1]

    yield make
    for view in made:
        view.close()


def picture(jpeg: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB")).astype(int)


def middle(image: np.ndarray) -> float:
    return float(np.nonzero(image.max(axis=2) > 64)[1].mean())


def test_the_view_keeps_the_contract_of_all_views() -> None:
    view = Recorded()
    assert isinstance(view, AbstractView)
    for call in (view.still, lambda: view.show_deformation(None), lambda: view.call(lambda plotter: None)):
        with pytest.raises(DeformError, match="no volume yet"):
            call()
    with pytest.raises(DeformError, match="unknown method"):
        VolumeView(method="gpu")
    with pytest.raises(DeformError, match="unknown transfer function"):
        VolumeView(ball(), transfer="no")
    view.close()


@pytest.mark.needs_gl
def test_a_page_gets_quick_and_full_pictures_of_its_size_and_of_the_deformation(open_view: Any) -> None:
    view = open_view()
    view.say(type="hello", **PAGE)
    view.see_all()
    (first, (quick,)), *_, (last, (full,)) = view.frames
    assert (first["full"], last["full"]) == (False, True)
    assert picture(quick).shape[1] < 96
    assert picture(full).shape == (72, 96, 3)
    assert np.abs(picture(full) - view.still()).mean() < 3  # JPEG
    view.set_camera((0, 1, 0))
    view.see_all()
    before = middle(picture(view.frames[-1][1][0]))
    view.show_deformation(Deformation.from_picture_points(GRID, PLANE, points(3.0)))
    view.see_all()
    assert middle(picture(view.frames[-1][1][0])) > before + 4  # three lengths of two pixels and more
    view.say(type="size", **{**PAGE, "width": 120})
    view.see_all()
    assert picture(view.frames[-1][1][0]).shape == (72, 120, 3)
    stats = view.stats()
    assert stats["path"] in ("texture", "array")
    assert (stats["width"], stats["height"]) == (120, 72)
    assert stats["bytes_per_frame"] == len(view.frames[-1][1][0])
    assert stats["frames"] == stats["sent"] == len(view.frames)
    assert min(stats["edit_ms"], stats["frame_ms"], stats["full_ms"]) > 0


@pytest.mark.needs_gl
def test_no_third_frame_is_sent_before_one_is_seen(open_view: Any) -> None:
    view = open_view(settle_ms=60000.0)
    view.say(type="hello", **PAGE)
    wait_for(lambda: len(view.frames) == 1)
    for zoom in (1.1, 1.2):
        view.set_camera(zoom=zoom)
    wait_for(lambda: len(view.frames) == 2)
    view.set_camera(zoom=1.5)
    wait_for(lambda: view.pictures.frames.was_full)
    assert len(view.frames) == 2
    view.say(type="seen", seq=1)
    wait_for(lambda: len(view.frames) == 3)  # the last change is drawn at last


@pytest.mark.needs_gl
def test_the_camera_of_a_page_turns_the_picture_and_frames_say_which_they_show(open_view: Any) -> None:
    view = open_view()
    view.say(type="hello", **PAGE)
    view.see_all()
    before = picture(view.frames[-1][1][0])
    view.say(type="camera", camera={"direction": [1, 0, 0], "zoom": 2.0}, number=7)
    view.see_all()
    content, (jpeg,) = view.frames[-1]
    assert (content["camera"], content["by"]) == (7, "a")
    assert np.abs(picture(jpeg) - before).mean() > 5
    assert view.camera["zoom"] == 1.0  # the trait changes when the front end reports the end of the movement
    view.set_state({"camera": {"direction": [1, 0, 0], "zoom": 2.0}})
    assert view.camera["zoom"] == 2.0


@pytest.mark.parametrize(
    "message",
    [
        None,
        [],
        "hello",
        {},
        {"type": "nothing"},
        {"type": []},
        {"type": "hello", "view": 3},
        {"type": "hello", "view": "a"},
        {"type": "hello", "view": "a", "width": 1e3, "height": 5},
        {"type": "size", "view": "a", "width": 9, "height": 10**9},
        {"type": "camera", "view": "a", "number": 1},
        {"type": "camera", "view": "a", "camera": {"zoom": -1}, "number": 1},
        {"type": "camera", "view": "a", "camera": {"direction": [0, 0, 0]}, "number": 1},
        {"type": "camera", "view": "a", "camera": {"evil": 1}, "number": 1},
        {"type": "camera", "view": "a", "camera": {}},
        {"type": "seen", "view": "a", "seq": "x"},
        {"type": "_rest", "view": "a"},
    ],
)
def test_a_wrong_message_is_logged_and_dropped(message: Any, caplog: pytest.LogCaptureFixture, open_view: Any) -> None:
    view, threads = open_view(), Threads()
    with caplog.at_level(logging.WARNING):
        deliver(view, message)
        view.set_state({"label": "x", "camera": {"zoom": 0}})
    assert caplog.text.count("dropped") == 3
    assert view.frames == []
    assert threads.alive == []  # nothing was made for it
    assert view.label == "Volume ball"


def test_a_saved_notebook_holds_no_voxels_and_no_pictures(open_view: Any) -> None:
    state = {k: v for k, v in open_view().get_state().items() if k not in ("_esm", "_css")}
    assert len(json.dumps(state, default=str)) < 4000


@pytest.mark.needs_gl
def test_an_editor_moves_the_picture_with_every_movement(open_view: Any) -> None:
    view = open_view()
    view.set_camera((0, 1, 0))
    editor = Editor(None, points())
    field = Deformation.from_picture_points(GRID, PLANE, points()).field(GRID)
    view.follow(editor, field)
    assert editor.live
    view.say(type="hello", **PAGE)
    view.see_all()
    before = middle(picture(view.frames[-1][1][0]))
    for k in range(5):
        deliver_edit(editor, PointsEdit(sender="a", seq=k + 1, phase="move", kind="move", points=points(0.6 * (k + 1))))
    view.see_all()
    assert middle(picture(view.frames[-1][1][0])) > before + 4
    view.follow(None, field)
    assert not editor.live
    editor.points = points(-3.0)
    assert abs(middle(view.still((96, 72))) - before) < 0.5
    view.follow(editor, field)
    editor.points = points(3.0)
    assert middle(view.still((96, 72))) > before + 4


def test_the_answer_to_a_drag_does_not_throw_back_the_next_one(open_view: Any) -> None:
    view, editor = open_view(method="core"), Editor(None, points())

    def answer(moved: float, **options: Any) -> Extrusion:
        made = Deformation.from_picture_points(GRID, PLANE, points(moved), **options).field(GRID)
        assert isinstance(made, Extrusion)
        return made

    def displacement() -> float:
        """The displacement of the tissue at the dragged point, and at half of the depth."""
        field = view.scene.ready().field()
        return float(-(field.displacement(PLANE.from_plane([9.0, 12.0, 15.0])) @ np.asarray(PLANE.u)))

    view.follow(editor, answer(0.0))
    deliver_edit(editor, PointsEdit(sender="a", seq=1, phase="end", kind="move", points=points(1.0)))
    deliver_edit(editor, PointsEdit(sender="a", seq=2, phase="move", kind="move", points=points(3.0)))
    view.follow(editor, answer(1.0))  # it took its time
    assert displacement() == pytest.approx(3.0, abs=1e-6)
    view.follow(editor, answer(1.0, extrusion="modulate", curve="0.5"))  # what else is new is seen
    assert displacement() == pytest.approx(1.5, abs=1e-6)
    clash = ControlPoints.from_arrays([[1, 1], [4, 4]], [[2, 2], [2, 2]])
    deliver_edit(editor, PointsEdit(sender="a", seq=3, phase="move", kind="move", points=clash))
    assert displacement() == pytest.approx(1.5, abs=1e-6)  # the last good one stays
    deliver_edit(
        editor, PointsEdit(sender="a", seq=4, phase="move", kind="move", points=points(1.0))
    )  # the drag is given up
    view.follow(editor, answer(5.0))
    assert displacement() == pytest.approx(5.0, abs=1e-6)
    deliver_edit(editor, PointsEdit(sender="a", seq=5, phase="move", kind="move", points=points(3.0)))
    editor.observe(lambda change: view.follow(editor, answer(2.0)), "points")  # as a studio answers the end of a drag
    deliver_edit(editor, PointsEdit(sender="a", seq=6, phase="end", kind="move", points=points(2.5)))
    assert displacement() == pytest.approx(2.5, abs=1e-6)  # the end itself comes last
    view.follow(editor, answer(2.0))
    assert displacement() == pytest.approx(2.0, abs=1e-6)
    view.show_deformation(None)
    assert not editor.live  # it was followed once, however often that was requested


def test_a_refit_keeps_all_but_one_map_and_the_last_good_field() -> None:
    maps = (points(), points(1.0))
    field = Deformation((Step(maps, PLANE, extrusion="interpolate", knots=(0.0, 1.0)),)).field(GRID)
    assert isinstance(field, Extrusion)
    how = PlanarFit(FitSettings(), lone=5.0)
    refit = Refit(Composed(Identity(), field), 1)
    made = refit(points(2.0), how)
    assert isinstance(made, Composed)
    assert isinstance(made.then, Extrusion)
    assert made.then.maps[0] is field.maps[0]
    np.testing.assert_allclose(made.then.maps[1].displacement([9.0, 9.0]), [-2.0, 0.0], atol=1e-9)
    clash = ControlPoints.from_arrays([[1, 1], [4, 4]], [[2, 2], [2, 2]])
    assert refit(clash, how) is made
    twice = replace(how, settings=FitSettings(strength=2.0))
    np.testing.assert_allclose(refit(points(1.0), twice).then.maps[1].displacement([9.0, 9.0]), [-2.0, 0.0], atol=1e-9)
    for wrong in (Identity(), None):
        with pytest.raises(DeformError, match="does not end with one"):
            Refit(wrong, 0)
    with pytest.raises(DeformError, match="there is no map 2"):
        Refit(field, 2)


@pytest.mark.needs_gl
def test_experts_reach_the_plotter_in_its_thread(open_view: Any) -> None:
    import pyvista

    view = open_view()
    before = view.still()
    mesh = pyvista.Sphere(radius=4.0, center=GRID.center)
    where = view.call(lambda plotter: plotter.add_mesh(mesh, color="red") and threading.current_thread())
    assert where is not threading.current_thread()
    assert np.abs(view.still().astype(int) - before).mean() > 1
    view.say(type="hello", **PAGE)
    view.see_all()
    view.say(type="bye")
    assert np.abs(view.still().astype(int) - before).mean() > 1  # the mesh stays when the last page has gone
    with pytest.raises(ZeroDivisionError):
        view.call(lambda plotter: 1 / 0)


def test_a_scene_that_cannot_take_its_field_is_closed(open_view: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    closed: list[CoreScene] = []

    def note(scene: CoreScene) -> None:
        closed.append(scene)

    monkeypatch.setattr(CoreScene, "close", note)

    def refuse(_scene: CoreScene, _field: Any, _output: Any = None) -> None:
        raise DeformError("these maps are wrong")

    monkeypatch.setattr(CoreScene, "set_field", refuse)
    view = open_view(method="core")
    with pytest.raises(DeformError, match="these maps are wrong"):
        view.still()
    assert len(closed) == 1


@pytest.mark.needs_gl
def test_an_error_is_said_on_the_page_and_the_picture_stays(open_view: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    view = open_view()
    view.say(type="hello", **PAGE)
    view.see_all()

    def broken(_scene: Any) -> None:
        raise DeformError("these maps are wrong")

    view.scene.change("content", broken)
    wait_for(lambda: "these maps are wrong" in [c["text"] for c, _ in view.__dict__["out"] if c["type"] == "notice"])
    view.show_deformation(None)
    view.see_all()
    assert np.abs(picture(view.frames[-1][1][0]) - view.still()).mean() < 3


@pytest.mark.nightly
@pytest.mark.needs_gl
def test_twenty_pages_and_views_one_after_the_other_leave_no_thread() -> None:
    threads = Threads()
    for _ in range(20):
        view = Recorded(ball(), transfer="surface", settle_ms=0.0)
        view.say(type="hello", width=32, height=24, background="dark")
        wait_for(lambda view=view: bool(view.frames))
        view.say(type="bye")  # the last page has gone: window and thread are given back
        view.say(type="hello", width=32, height=24, background="dark")
        seen = len(view.frames)
        wait_for(lambda view=view, seen=seen: len(view.frames) > seen)
        view.close()
    threads.wait()
    held = weakref.ref(view)
    del view
    wait_for(lambda: gc.collect() >= 0 and held() is None)


def test_a_closed_view_begins_nothing_anew() -> None:
    view, threads = Recorded(ball(), method="core"), Threads()
    view.say(type="hello", **PAGE)
    view.close()
    threads.wait()
    camera = {"direction": [1, 0, 0]}
    view.receive({"view": "a", "type": "camera", "camera": camera, "number": 7})  # a user who has not let go yet
    view.projection = "mip"
    with pytest.raises(DeformError, match="the view is closed"):
        view.still()
    assert threads.alive == []


def test_a_scene_that_nobody_watches_is_given_back_and_made_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.widgets.worker._IDLE", 0.05)
    closed: list[CoreScene] = []
    close = CoreScene.close
    monkeypatch.setattr(CoreScene, "close", lambda scene: (closed.append(scene), close(scene))[1])
    threads = Threads()
    view = Recorded(ball(), method="core", settle_ms=1.0)
    first = view.still((48, 36))
    threads.wait()
    assert len(closed) == 1
    view.set_camera((1, 0, 0))
    assert np.abs(view.still((48, 36)).astype(int) - first).mean() > 1  # as it is now
    view.set_camera((0, 1, 0))
    threads.wait()
    view.say(type="hello", **PAGE)
    view.see_all()
    assert threads.alive  # and stays for its page, at rest as well
    view.close()


@pytest.mark.skipif(importlib.util.find_spec("trame_rca") is None, reason="trame-rca is not installed")
def test_the_servers_of_a_view_end_with_it_whoever_has_come(monkeypatch: pytest.MonkeyPatch) -> None:
    run = ["cell", "1"]
    monkeypatch.setattr("deformnb.widgets.cell_widgets._cell_and_run", lambda: tuple(run))
    threads, ports = Threads(), []
    for number in range(3):
        run[1] = str(number)
        view = Recorded(ball(), method="core", transport="trame")
        view.say(type="hello", origin="http://localhost:8888", **PAGE)
        wait_for(lambda view=view: bool(view.urls))
        (url,) = view.urls
        ports.append(int(url.split("/")[2].split(":")[1]))
        for _ in range(20):  # as an <img> in any page does
            with socket.create_connection(("127.0.0.1", ports[-1])) as visitor:
                visitor.sendall(f"GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{ports[-1]}\r\n\r\n".encode())
                assert visitor.recv(64).startswith(b"HTTP/1.1 403")
        assert [_is_open(port) for port in ports] == [False] * number + [True]
    view.close()
    assert not _is_open(ports[-1])
    threads.wait()


def _is_open(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def test_without_opengl_the_core_draws_and_the_page_says_so(open_view: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    found = (False, "no OpenGL library was found", "apt-get install libegl1 libgl1")
    monkeypatch.setattr("deformnb.widgets.view.stills.gl_status", lambda: found)
    view = open_view()
    view.say(type="hello", **PAGE)
    view.see_all()
    assert view.stats()["path"] == "core"
    notices = [c["text"] for c, _ in view.__dict__["out"] if c["type"] == "notice"]
    assert "apt-get install libegl1 libgl1" in notices[0]
    view.say(type="hello", **PAGE)  # a later client is informed too
    assert sum(c["type"] == "notice" for c, _ in view.__dict__["out"]) == 2
    with pytest.raises(DeformError, match="no plotter"):
        view.call(lambda plotter: None)


def test_a_screenshot_waits_for_the_full_picture_of_the_last_change(open_view: Any) -> None:
    view = open_view(method="core", settle_ms=400.0)
    view.say(type="hello", **PAGE)
    wait_for(lambda: view.frames)
    assert not view.frames[0][0]["full"]  # quick and small: no screenshot
    assert asyncio.run(view.screenshot()).shape == (72, 96, 3)
    view.set_camera((1, 0, 0))
    shown = asyncio.run(view.screenshot())
    assert np.abs(shown.astype(int) - view.still()).mean() < 1  # of the new side, though the old one was there in full
    view.settle_ms = 60000.0
    view.set_camera((0, 1, 0))
    assert asyncio.run(view.screenshot(timeout=0.1)).shape == (72, 96, 3)


@pytest.mark.needs_gl
def test_stills_screenshots_and_previews_need_no_page(open_view: Any) -> None:
    view = open_view()
    assert view.still((50, 40)).shape == (40, 50, 3)
    assert asyncio.run(view.screenshot()).shape == (72, 96, 3)
    bundle = view._repr_mimebundle_()
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    png = np.asarray(Image.open(io.BytesIO(data["image/png"])))
    assert png.shape == (420, 560, 3)
    assert (png.max(axis=2) > 64).sum() > 5000
    view.shows = "side_by_side"
    view.show_deformation(Deformation.from_picture_points(GRID, PLANE, points(4.0)))
    both = view.still((120, 60))
    assert np.abs(both[:, :60].astype(int) - both[:, 60:]).mean() > 5
    view.say(type="hello", **PAGE)
    view.see_all()
    assert asyncio.run(view.screenshot()).shape == (72, 96, 3)
    view.shows = "flicker"
    view.see_all()
    assert len(view.frames[-1][1]) == 2


def folding(by: float) -> Deformation:
    """A point that is taken to the right, past one that stays."""
    source = np.array([[1.0, 1.0], [20.0, 1.0], [1.0, 17.0], [20.0, 17.0], [7.0, 9.0], [13.0, 9.0]])
    moved = source + by * np.eye(6)[:, 4:5] * np.array([1.0, 0.0])
    return Deformation.from_picture_points(GRID, PLANE, ControlPoints.from_arrays(source, moved))


def red(image: np.ndarray) -> int:
    r, g, b = np.moveaxis(image.astype(int), -1, 0)
    return int(((r > g + 30) & (r > b + 30)).sum())


def badges(view: Recorded) -> list[str]:
    return [content["text"] for content, _ in view.out if content["type"] == "badge"]


@pytest.mark.needs_gl
def test_folds_are_red_and_named_and_can_be_switched_off(open_view: Any) -> None:
    matter = Volume(np.full(GRID.shape, 200, np.uint8), GRID)
    view = open_view(matter, method="texture", projection="composite", transfer="bone")
    view.set_camera(PLANE.normal, [-c for c in PLANE.v])
    view.say(type="hello", **PAGE)
    view.show_deformation(folding(2.0))
    view.see_all()
    assert (red(view.still()), badges(view), view.pictures.badge) == (0, [], "")
    view.show_deformation(folding(12.0))
    view.see_all()
    assert red(view.still()) > 100
    assert red(picture(view.frames[-1][1][0])) > 50
    assert badges(view) == ["the map folds: tissue there is red"]
    view.say(type="hello", **{**PAGE, "view": "b"})  # a second client is informed too
    assert badges(view) == 2 * ["the map folds: tissue there is red"]
    view.shows = "original"
    assert (red(view.still()), view.pictures.badge) == (0, "")
    view.shows = "deformed"
    view.show_folds = False
    assert (red(view.still()), view.pictures.badge) == (0, "")
    view.show_folds = True
    assert red(view.still()) > 100
    assert badges(view)[-1] == "the map folds: tissue there is red"
    assert view.get_state(["show_folds"]) == {"show_folds": True}


def test_where_folds_are_not_shown_it_is_said(open_view: Any) -> None:
    view = open_view(method="core")
    view.show_deformation(folding(12.0))
    view.still((64, 48))
    assert view.pictures.badge == "the map folds; this renderer does not show where"
    view.show_folds = False
    view.still((64, 48))
    assert view.pictures.badge == ""


def test_a_transport_that_is_unknown_or_not_installed_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DeformError, match="unknown transport 'pigeon'; choose one of comm, trame"):
        VolumeView(transport="pigeon")
    monkeypatch.setattr("deformnb.widgets.view.volume_view.find_spec", lambda name: None)
    with pytest.raises(DeformError, match=r"pip install .deformnb-core\[app\]."):
        VolumeView(transport="trame")


class Carrier:
    """Stands for what carries pictures: nothing but a list."""

    def __init__(self, view: Any) -> None:
        self.opened: list[Any] = []
        self.delivered: list[Any] = []
        self.closed = 0

    def open(self, origin: Any, tell: Callable[[str], None]) -> None:
        self.opened.append(origin)
        if origin != "http://nb:1":
            raise DeformError("no origin.")
        tell("http://127.0.0.1:2/")

    def deliver(self, message: Any, pictures: list[bytes], frame: Any) -> None:
        self.delivered.append((message.seq, pictures[0][:2]))

    def close(self) -> None:
        self.closed += 1


def test_pictures_go_by_the_transport_and_the_page_hears_where(
    open_view: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setitem(TRANSPORTS, "trame", Carrier)
    monkeypatch.setattr("deformnb.widgets.view.volume_view.find_spec", lambda name: True)
    view = open_view(method="core", transport="trame")
    view.say(type="hello", **PAGE, origin="http://nb:1")
    assert {"type": "trame", "view": "a", "url": "http://127.0.0.1:2/"} in [c for c, _ in view.__dict__["out"]]
    carrier = view.pictures.carrier
    wait_for(lambda: len(carrier.delivered) == 2)  # the quick one and the full one
    assert carrier.delivered[0] == (1, b"\xff\xd8")
    assert view.frames == []
    view.draw_again()  # a page that comes late gets a picture
    wait_for(lambda: len(carrier.delivered) > 2)
    with caplog.at_level(logging.WARNING):
        view.say(type="hello", **PAGE, origin="javascript:x")
    assert "dropped" in caplog.text
    view.close()
    assert carrier.closed == 1

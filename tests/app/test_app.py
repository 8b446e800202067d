"""The application without a browser: its controls, its app, and its conversation with pages."""

from __future__ import annotations

import asyncio
import re
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from running_app import PATIENCE, RunningApp, connected, edit_of, heard

from deformnb.app.application import REQUESTS, Application
from deformnb.app.launch import _announce, check_app, made_up_carp
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.document.deformation import Deformation
from deformnb.document.json_format import from_json
from deformnb.errors import DeformError
from deformnb.session.session import Session
from deformnb.volume.volume import Volume
from deformnb.widgets.protocol import points_to_json


def _bar() -> Volume:
    return PHANTOMS["bar"].make((12, 16, 20))


@pytest.fixture
def app() -> Iterator[Application]:
    made = Application(Session(_bar(), view="+y"))
    yield made
    made.close()


def _dragged_points(app: Application, by: float = 3.0) -> list[dict[str, Any]]:
    points = points_to_json(app.session.points)
    points[0]["target"] = [points[0]["target"][0] + by, points[0]["target"][1]]
    return points


# -- controls ----------------------------------------------------------------------------------------------------------


def test_every_control_takes_what_the_desk_says_of_itself(app: Application) -> None:
    state = app.state()
    for name, control in app.parameters.items():
        assert control.checked(state[name]) == state[name]


# -- the application ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "value", "seen"), [
    ("kernel", "gaussian", lambda s: s.step.kernel), ("trend", "rigid", lambda s: s.step.trend),
    ("smoothing", 0.5, lambda s: s.step.smoothing), ("strength", -0.5, lambda s: s.step.strength),
    ("support", 12.0, lambda s: s.step.support), ("extrusion", "modulate", lambda s: s.step.extrusion),
    ("view", "-x", lambda s: s.view), ("method", "mean", lambda s: s.method),
])
def test_a_control_changes_the_session(app: Application, name: str, value: Any, seen: Callable[[Session], Any]) -> None:
    app.set(name, value)
    assert seen(app.session) == value
    assert app.state()[name] == value
    assert app.error == ""


def test_widgets_follow_the_session(app: Application) -> None:
    image = app.editor.image
    app.set("kernel", "thin_plate")
    assert (app.editor.kernel, app.session.step.trend) == ("thin_plate", "affine")
    app.set("view", "-x")
    assert app.editor.image != image
    assert app.editor.picture is app.session.picture()
    app.set("shows", "original")
    assert app.live.shows == "original"
    app.set("projection", "mip")
    assert app.live.projection == "mip"
    for name in ("show_radius", "drag_grid"):
        app.set(name, True)
        assert getattr(app.editor, name)


def test_a_slice_goes_from_front_to_back(app: Application) -> None:
    app.set("method", "slice")
    low, high = app.session.depth_range
    app.set("depth", 0.0)
    front = app.editor.image
    assert app.session.depth == pytest.approx(low)
    app.set("depth", 0.5)
    assert app.editor.image != front  # the bar is inside
    app.set("depth", 1.0)
    assert app.session.depth == pytest.approx(high)
    assert app.state()["depth"] == pytest.approx(1.0)


def test_a_drag_in_the_page_is_an_edit_that_can_be_undone(app: Application) -> None:
    from deformnb.widgets.synced import LocalComm

    app.editor.comm = LocalComm(lambda data, buffers: None)
    app.receive("editor", {"method": "custom", "content": edit_of(_dragged_points(app))})
    np.testing.assert_allclose(app.session.points.displacement[0], [-3.0, 0.0])
    assert app.state()["undo"]
    app.act("undo")
    assert not app.session.points.displacement.any()
    assert not app.editor.points.displacement.any()
    app.act("redo")
    assert app.editor.points.displacement.any()
    app.act("reset")
    assert not app.editor.points.displacement.any()
    assert app.state()["facts"].startswith("4 points, 0 moved")


def test_points_that_cannot_be_fitted_go_back(app: Application) -> None:
    before = app.session.points
    target = before.target.copy()
    target[1] = target[0]
    app.editor.points = type(before).from_arrays(before.source, target)  # two features asked to be in one place
    assert "control point 0 and control point 1" in app.error
    assert app.session.points == before
    assert app.editor.points == before


def test_two_pictures_are_deformed_one_after_the_other(app: Application) -> None:
    app.editor.points = app.editor.points.move(0, app.editor.points.target[0] + 2.0)
    app.set("view", "-x")
    assert len(app.session.deformation.steps) == 2
    assert "step 2 of 2" in app.state()["facts"]
    assert app.editor.points == app.session.points
    app.act("undo")
    assert app.state()["view"] == "+y"
    assert app.editor.picture is app.session.picture()


def test_cameras_look_from_the_side_of_the_picture(app: Application) -> None:
    glance = np.array(app.live.camera["direction"])
    assert 0.8 < glance @ np.array(app.session.plane.normal) < 0.99  # turned a little, so that depth shows
    app.act("front")
    np.testing.assert_allclose(app.live.camera["direction"], app.session.plane.normal, atol=1e-12)
    np.testing.assert_allclose(app.live.camera["up"], [-c for c in app.session.plane.v], atol=1e-12)


def test_another_side_is_seen_square_on_unless_somebody_has_turned_the_volume(app: Application) -> None:
    for side, toward in (("-x", (-1, 0, 0)), ("+z", (0, 0, 1))):
        app.set("view", side)
        np.testing.assert_allclose(app.live.camera["direction"], toward, atol=1e-12)
    turned = [0.6, 0.0, 0.8]
    app.live.set_camera(turned)
    app.set("view", "-x")
    np.testing.assert_allclose(app.live.camera["direction"], turned, atol=1e-12)
    app.act("front")
    app.set("view", "+y")
    np.testing.assert_allclose(app.live.camera["direction"], (0, 1, 0), atol=1e-12)


def test_the_points_of_a_side_wait_there_and_choosing_it_again_leads_back(app: Application) -> None:
    app.editor.points = dragged = app.editor.points.move(0, app.editor.points.target[0] + 2.0)
    app.set("view", "-x")
    assert app.state()["notice"] == "Step 2 begins. The points of step 1 are kept: choose its side again to edit them."
    assert app.editor.points != dragged
    app.editor.points = others = app.editor.points.move(1, app.editor.points.target[1] - 1.0)
    app.set("view", "+y")
    assert (app.editor.points, app.session.points) == (dragged, dragged)
    assert "step 1 of 2" in app.state()["facts"]
    app.set("view", "-x")
    assert app.editor.points == others


@pytest.mark.parametrize(("name", "values"), [
    ("strength", (0.4, 0.9, 2.6)), ("smoothing", (0.1, 0.2, 0.3)), ("support", (30.0, 90.0, 40.0)),
])
def test_a_slow_hand_on_a_slider_makes_one_edit(app: Application, monkeypatch: pytest.MonkeyPatch, name: str,
                                                values: tuple[float, ...]) -> None:
    now = 100.0
    monkeypatch.setattr("deformnb.session.history.time.monotonic", lambda: now)
    first = app.state()[name]
    for hold in range(2):
        app.act("take_hold")
        for value in values:
            app.set(name, value + 0.05 * hold)
            now += 2.0
    app.act("undo")
    assert app.state()[name] == values[-1]
    app.act("undo")
    assert app.state()[name] == first
    assert app.state()["undo"] == ""


def test_unknown_names_are_refused(app: Application) -> None:
    for call in (lambda: app.set("volume", 1), lambda: app.act("close"), lambda: app.act("save"),
                 lambda: app.receive("comm", {})):
        with pytest.raises(DeformError):
            call()
    assert "save" in REQUESTS


# -- the conversation --------------------------------------------------------------------------------------------------


@pytest.fixture
def running() -> Iterator[RunningApp]:
    with RunningApp(Session(_bar(), view="+y")) as running:
        yield running


def test_a_page_gets_all_of_a_widget(running: RunningApp) -> None:
    async def talk() -> Any:
        async with connected(running) as page:
            return await page.call("deformnb.open", "editor"), await page.call("deformnb.open", "live")

    editor, live = asyncio.run(talk())
    assert editor["state"]["image"].startswith(b"\x89PNG")
    assert len(editor["state"]["points"]) == 4
    assert editor["models"] == {widget.model_id: name for name, widget in running.application.widgets.items()}
    assert live["state"]["editor"] == f"IPY_MODEL_{running.application.editor.model_id}"
    assert not {"layout", "comm", "_esm"} & set(live["state"])


def test_the_volume_comes_in_pieces_that_make_it_whole(running: RunningApp) -> None:
    import gzip

    async def talk() -> Any:
        async with connected(running) as page:
            info = (await page.call("deformnb.open", "live"))["state"]["volume_info"]
            await page.call("deformnb.message", "live", {"type": "chunk", "view": "v", "id": info["id"], "index": 0})
            return info, await heard(page, lambda m: m.get("result", {}).get("content", {}).get("type") == "chunk")

    info, message = asyncio.run(talk())
    voxels = np.frombuffer(gzip.decompress(message["result"]["buffers"][0]), np.uint8)
    assert voxels.reshape(info["shape"][::-1]).tobytes() == running.application.live._shown.volume.values.tobytes()


def test_what_one_page_drags_the_other_sees(running: RunningApp) -> None:
    points = _dragged_points(running.application)

    async def talk() -> Any:
        async with connected(running) as mine, connected(running) as other:
            await mine.call("deformnb.message", "editor", edit_of(points))
            news = await heard(other, lambda m: m.get("result", {}).get("state", {}).get("points"))
            await mine.call("deformnb.state", "editor", "mine", {"selected": [2]})
            chosen = await heard(other, lambda m: m.get("result", {}).get("widget") == "editor"
                                 and m["result"].get("state", {}).get("selected"))
            facts = await heard(other, lambda m: "facts" in m.get("result", {}))
            return news, chosen, facts

    news, chosen, facts = asyncio.run(talk())
    assert chosen["result"] == {"widget": "editor", "state": {"selected": [2]}, "origin": "mine"}  # no echo for it
    assert news["result"]["state"]["points"][0]["target"] == points[0]["target"]
    assert facts["result"]["facts"] == "4 points, 1 moved"
    assert facts["result"]["undo"]


def test_what_one_page_sets_the_other_sees_and_no_echo_comes_back(running: RunningApp) -> None:
    async def talk() -> Any:
        async with connected(running) as mine, connected(running) as other:
            await mine.call("trame.state.update", [{"key": "kernel", "value": "gaussian"}])
            await heard(other, lambda m: m.get("result", {}).get("kernel") == "gaussian")
            await heard(mine, lambda m: m.get("result", {}).get("undo") == "change kernel")
            # An equal value may come with what the application says when it has done it; alone it would be an echo.
            return [m["result"] for m in mine.heard if "kernel" in m.get("result", {}) and "undo" not in m["result"]]

    assert asyncio.run(talk()) == []
    assert running.application.session.step.kernel == "gaussian"


def test_a_page_whose_wish_is_refused_gets_the_old_value_back(running: RunningApp,
                                                              monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**fields: Any) -> None:
        raise DeformError("not now.")

    monkeypatch.setattr(running.application.session, "change", refuse)

    async def talk() -> Any:
        async with connected(running) as page:
            await page.call("trame.state.update", [{"key": "extrusion", "value": "modulate"}])
            await heard(page, lambda m: m.get("result", {}).get("error"))  # in one message or in two
            await heard(page, lambda m: m.get("result", {}).get("extrusion") == "replicate")
            return {k: v for m in page.heard for k, v in m.get("result", {}).items()}

    news = asyncio.run(talk())
    assert (news["extrusion"], news["error"]) == ("replicate", "not now.")


def test_only_the_newest_of_many_values_counts(running: RunningApp) -> None:
    async def talk() -> None:
        async with connected(running) as page:
            for value in np.linspace(-1, 2, 61):
                await page.send("trame.state.update", [{"key": "strength", "value": round(float(value), 3)}])
            await page.call("trame.state.get")

    free = threading.Event()
    running.application.thread.call(lambda: free.wait(PATIENCE))  # an application that is busy meanwhile
    calls: list[float] = []
    change = running.application.set
    running.application.set = lambda name, value: (calls.append(value), change(name, value))[1]  # type: ignore[method-assign]
    asyncio.run(talk())
    free.set()
    running.settled()
    assert running.application.session.step.strength == 2.0
    assert calls == [2.0]


def test_a_saved_session_is_a_document(running: RunningApp) -> None:
    async def talk() -> Any:
        async with connected(running) as page:
            await page.call("trame.state.update", [{"key": "kernel", "value": "cubic"}])
            return await page.call("trame.trigger", "save", [], {})

    document = from_json(asyncio.run(talk()))
    assert document.steps[0].kernel == "cubic"
    assert document.volume is not None
    assert document.volume.shape == (12, 16, 20)


def test_a_name_that_is_html_stays_text() -> None:
    volume = Volume.from_array(np.zeros((6, 6, 6), np.uint8) + np.arange(6, dtype=np.uint8), name="<b>{{ 1+1 }}.nii")
    with RunningApp(Session(volume, view="+y")) as running:
        state = running.server.trame.state
        assert state["dnb_name"] == "<b>{{ 1+1 }}.nii"  # shown by Vue as text
        assert "<b>" not in state["trame__template_main"]
        assert state["dnb_document"] == "-b----1-1----session.json"


def test_the_page_has_every_control_and_action(running: RunningApp) -> None:
    page = running.server.trame.state["trame__template_main"]
    for name in running.application.parameters:
        assert re.search(rf'="(Math\.log10\()?{name}\)?"', page), name
    for name in ("undo", "redo", "reset", "save", "front"):
        assert f"trigger('{name}')" in page


# -- the command -------------------------------------------------------------------------------------------------------


def test_options_are_checked_before_a_volume_is_read() -> None:
    assert check_app("localhost", 0, None) == "127.0.0.1"
    for host, port, side in (("0.0.0.0", 0, None), ("127.0.0.1", 65536, None), ("127.0.0.1", -1, None),
                             ("127.0.0.1", 0, "z")):
        with pytest.raises(DeformError):
            check_app(host, port, side)
    assert check_app("localhost", 0, None, 0) == "127.0.0.1"
    for idle in (-1, float("nan"), float("inf")):
        with pytest.raises(DeformError, match="--idle takes minutes"):
            check_app("127.0.0.1", 0, None, idle)


def test_it_says_when_it_ends_by_itself(capsys: pytest.CaptureFixture[str]) -> None:
    for idle, words in ((240.0, "240 minutes without a page"), (0.0, "Ctrl-C ends it.")):
        _announce("http://here", idle, None)
        said = capsys.readouterr()
        assert said.out == "http://here\n"  # and nothing else
        assert words in said.err


def test_a_port_that_is_taken_is_said() -> None:
    with RunningApp(Session(_bar(), view="+y")) as running, pytest.raises(OSError, match=r"in use|only one usage"):
        RunningApp(Session(_bar(), view="+y"), port=running.server.port).__enter__()


def test_who_brings_no_volume_gets_a_carp() -> None:
    shares: list[float] = []
    carp = made_up_carp(shares.append)
    assert carp.name.startswith("carp")
    assert shares


# -- cuts, rigid parts, saved sessions ---------------------------------------------------------------------------------


def test_cuts_drawn_in_the_page_are_edits_and_go_back_if_they_cannot_be(app: Application) -> None:
    line = {"region": {"kind": "line", "vertices": [[9.0, 20.0], [9.0, -1.0]]}}
    app.receive("editor", _message({"type": "shapes", "what": "cuts", "kind": "add cut", "shapes": [line]}, 1))
    assert len(app.session.step.cuts) == 1
    assert app.state()["undo"] == "add cut"
    app.act("undo")
    assert app.editor.cuts == ()
    points = _dragged_points(app, 0.5)
    app.receive("editor", _message(edit_of(points, 2), 2))
    corner = points[0]["source"]
    around = {"name": "stone", "region": {"kind": "polygon", "vertices": [
        [corner[0] - 2, corner[1] - 2], [corner[0] + 1, corner[1] - 2], [corner[0] + 1, corner[1] + 2],
        [corner[0] - 2, corner[1] + 2]]}}
    app.receive("editor", _message({"type": "shapes", "what": "parts", "kind": "add", "shapes": [around]}, 3))
    assert "stone" in app.error
    assert app.editor.parts == ()


def _message(content: dict[str, Any], seq: int) -> dict[str, Any]:
    return {"method": "custom", "content": {"sender": "window", **content, "seq": seq}}


def test_a_desk_goes_on_with_a_session_and_edits_its_last_picture() -> None:
    volume = _bar()
    session = Session(volume, view="+y")
    session.edit_points(session.points.add([8.0, 6.0], [10.0, 6.0]))
    session.add_step(in_space=True)
    session.edit_points(session.points.add([8.0, 6.0, 6.0], [8.0, 7.0, 6.0]))
    kept = session.deformation
    made = Application(Session(volume, kept, view="+y"))
    assert made.session.index == 0
    assert made.session.deformation == kept
    assert made.live.editor is None  # a step in space comes after it
    made.close()
    alone = Application(Session(volume, Deformation(kept.steps[1:]), view="+y"))
    assert [s.plane is None for s in alone.session.deformation.steps] == [True, False]
    alone.close()


def test_the_notes_of_a_volume_are_said_in_the_page() -> None:
    constant = Volume.from_array(np.full((6, 7, 8), 3.0))
    app = Application(Session(constant))
    assert app.state()["notice"] == "Every voxel has the value 3: there is nothing to see in this volume."
    app.close()

"""The application without a browser: its controls, its desk, and its conversation with pages."""

from __future__ import annotations

import asyncio
import re
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from running_app import PATIENCE, RunningApp, connected, edit_of, heard

from deformnb.app.desk import REQUESTS, Desk
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
def desk() -> Iterator[Desk]:
    made = Desk(Session(_bar(), view="+y"))
    yield made
    made.close()


def _dragged_points(desk: Desk, by: float = 3.0) -> list[dict[str, Any]]:
    points = points_to_json(desk.session.points)
    points[0]["target"] = [points[0]["target"][0] + by, points[0]["target"][1]]
    return points


# -- controls ----------------------------------------------------------------------------------------------------------


def test_every_control_takes_what_the_desk_says_of_itself(desk: Desk) -> None:
    state = desk.state()
    for name, control in desk.parameters.items():
        assert control.checked(state[name]) == state[name]


# -- the desk ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "value", "seen"), [
    ("kernel", "gaussian", lambda s: s.step.kernel), ("trend", "rigid", lambda s: s.step.trend),
    ("smoothing", 0.5, lambda s: s.step.smoothing), ("strength", -0.5, lambda s: s.step.strength),
    ("support", 12.0, lambda s: s.step.support), ("extrusion", "modulate", lambda s: s.step.extrusion),
    ("view", "-x", lambda s: s.view), ("method", "mean", lambda s: s.method),
])
def test_a_control_changes_the_session(desk: Desk, name: str, value: Any, seen: Callable[[Session], Any]) -> None:
    desk.set(name, value)
    assert seen(desk.session) == value
    assert desk.state()[name] == value
    assert desk.error == ""


def test_widgets_follow_the_session(desk: Desk) -> None:
    image = desk.editor.image
    desk.set("kernel", "thin_plate")
    assert (desk.editor.kernel, desk.session.step.trend) == ("thin_plate", "affine")
    desk.set("view", "-x")
    assert desk.editor.image != image
    assert desk.editor.picture is desk.session.picture()
    desk.set("shows", "original")
    assert desk.live.shows == "original"
    desk.set("projection", "mip")
    assert desk.live.projection == "mip"
    for name in ("show_radius", "drag_grid"):
        desk.set(name, True)
        assert getattr(desk.editor, name)


def test_a_slice_goes_from_front_to_back(desk: Desk) -> None:
    desk.set("method", "slice")
    low, high = desk.session.depth_range
    desk.set("depth", 0.0)
    front = desk.editor.image
    assert desk.session.depth == pytest.approx(low)
    desk.set("depth", 0.5)
    assert desk.editor.image != front  # the bar is inside
    desk.set("depth", 1.0)
    assert desk.session.depth == pytest.approx(high)
    assert desk.state()["depth"] == pytest.approx(1.0)


def test_a_drag_in_the_page_is_an_edit_that_can_be_undone(desk: Desk) -> None:
    from deformnb.widgets.synced import PageComm

    desk.editor.comm = PageComm(lambda data, buffers: None)
    desk.receive("editor", {"method": "custom", "content": edit_of(_dragged_points(desk))})
    np.testing.assert_allclose(desk.session.points.displacement[0], [-3.0, 0.0])
    assert desk.state()["undo"]
    desk.act("undo")
    assert not desk.session.points.displacement.any()
    assert not desk.editor.points.displacement.any()
    desk.act("redo")
    assert desk.editor.points.displacement.any()
    desk.act("reset")
    assert not desk.editor.points.displacement.any()
    assert desk.state()["facts"].startswith("4 points, 0 moved")


def test_points_that_cannot_be_fitted_go_back(desk: Desk) -> None:
    before = desk.session.points
    target = before.target.copy()
    target[1] = target[0]
    desk.editor.points = type(before).from_arrays(before.source, target)  # two features asked to be in one place
    assert "control point 0 and control point 1" in desk.error
    assert desk.session.points == before
    assert desk.editor.points == before


def test_two_pictures_are_deformed_one_after_the_other(desk: Desk) -> None:
    desk.editor.points = desk.editor.points.move(0, desk.editor.points.target[0] + 2.0)
    desk.set("view", "-x")
    assert len(desk.session.deformation.steps) == 2
    assert "step 2 of 2" in desk.state()["facts"]
    assert desk.editor.points == desk.session.points
    desk.act("undo")
    assert desk.state()["view"] == "+y"
    assert desk.editor.picture is desk.session.picture()


def test_cameras_look_from_the_side_of_the_picture(desk: Desk) -> None:
    glance = np.array(desk.live.camera["direction"])
    assert 0.8 < glance @ np.array(desk.session.plane.normal) < 0.99  # turned a little, so that depth shows
    desk.act("front")
    np.testing.assert_allclose(desk.live.camera["direction"], desk.session.plane.normal, atol=1e-12)
    np.testing.assert_allclose(desk.live.camera["up"], [-c for c in desk.session.plane.v], atol=1e-12)


def test_another_side_is_seen_square_on_unless_somebody_has_turned_the_volume(desk: Desk) -> None:
    for side, toward in (("-x", (-1, 0, 0)), ("+z", (0, 0, 1))):
        desk.set("view", side)
        np.testing.assert_allclose(desk.live.camera["direction"], toward, atol=1e-12)
    turned = [0.6, 0.0, 0.8]
    desk.live.set_camera(turned)
    desk.set("view", "-x")
    np.testing.assert_allclose(desk.live.camera["direction"], turned, atol=1e-12)
    desk.act("front")
    desk.set("view", "+y")
    np.testing.assert_allclose(desk.live.camera["direction"], (0, 1, 0), atol=1e-12)


def test_the_points_of_a_side_wait_there_and_choosing_it_again_leads_back(desk: Desk) -> None:
    desk.editor.points = dragged = desk.editor.points.move(0, desk.editor.points.target[0] + 2.0)
    desk.set("view", "-x")
    assert desk.state()["notice"] == "Step 2 begins. The points of step 1 are kept: choose its side again to edit them."
    assert desk.editor.points != dragged
    desk.editor.points = others = desk.editor.points.move(1, desk.editor.points.target[1] - 1.0)
    desk.set("view", "+y")
    assert (desk.editor.points, desk.session.points) == (dragged, dragged)
    assert "step 1 of 2" in desk.state()["facts"]
    desk.set("view", "-x")
    assert desk.editor.points == others


@pytest.mark.parametrize(("name", "values"), [
    ("strength", (0.4, 0.9, 2.6)), ("smoothing", (0.1, 0.2, 0.3)), ("support", (30.0, 90.0, 40.0)),
])
def test_a_slow_hand_on_a_slider_makes_one_edit(desk: Desk, monkeypatch: pytest.MonkeyPatch, name: str,
                                                values: tuple[float, ...]) -> None:
    now = 100.0
    monkeypatch.setattr("deformnb.session.history.time.monotonic", lambda: now)
    first = desk.state()[name]
    for hold in range(2):
        desk.act("take_hold")
        for value in values:
            desk.set(name, value + 0.05 * hold)
            now += 2.0
    desk.act("undo")
    assert desk.state()[name] == values[-1]
    desk.act("undo")
    assert desk.state()[name] == first
    assert desk.state()["undo"] == ""


def test_unknown_names_are_refused(desk: Desk) -> None:
    for call in (lambda: desk.set("volume", 1), lambda: desk.act("close"), lambda: desk.act("save"),
                 lambda: desk.receive("comm", {})):
        with pytest.raises(DeformError):
            call()
    assert "save" in REQUESTS


# -- the conversation --------------------------------------------------------------------------------------------------


@pytest.fixture
def app() -> Iterator[RunningApp]:
    with RunningApp(Session(_bar(), view="+y")) as running:
        yield running


def test_a_page_gets_all_of_a_widget(app: RunningApp) -> None:
    async def talk() -> Any:
        async with connected(app) as page:
            return await page.call("deformnb.open", "editor"), await page.call("deformnb.open", "live")

    editor, live = asyncio.run(talk())
    assert editor["state"]["image"].startswith(b"\x89PNG")
    assert len(editor["state"]["points"]) == 4
    assert editor["models"] == {widget.model_id: name for name, widget in app.desk.widgets.items()}
    assert live["state"]["editor"] == f"IPY_MODEL_{app.desk.editor.model_id}"
    assert not {"layout", "comm", "_esm"} & set(live["state"])


def test_the_volume_comes_in_pieces_that_make_it_whole(app: RunningApp) -> None:
    import gzip

    async def talk() -> Any:
        async with connected(app) as page:
            info = (await page.call("deformnb.open", "live"))["state"]["volume_info"]
            await page.call("deformnb.message", "live", {"type": "chunk", "view": "v", "id": info["id"], "index": 0})
            return info, await heard(page, lambda m: m.get("result", {}).get("content", {}).get("type") == "chunk")

    info, message = asyncio.run(talk())
    voxels = np.frombuffer(gzip.decompress(message["result"]["buffers"][0]), np.uint8)
    assert voxels.reshape(info["shape"][::-1]).tobytes() == app.desk.live._shown.volume.values.tobytes()


def test_what_one_page_drags_the_other_sees(app: RunningApp) -> None:
    points = _dragged_points(app.desk)

    async def talk() -> Any:
        async with connected(app) as mine, connected(app) as other:
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


def test_what_one_page_sets_the_other_sees_and_no_echo_comes_back(app: RunningApp) -> None:
    async def talk() -> Any:
        async with connected(app) as mine, connected(app) as other:
            await mine.call("trame.state.update", [{"key": "kernel", "value": "gaussian"}])
            await heard(other, lambda m: m.get("result", {}).get("kernel") == "gaussian")
            await heard(mine, lambda m: m.get("result", {}).get("undo") == "change kernel")
            # An equal value may come with what the desk says when it has done it; alone it would be an echo.
            return [m["result"] for m in mine.heard if "kernel" in m.get("result", {}) and "undo" not in m["result"]]

    assert asyncio.run(talk()) == []
    assert app.desk.session.step.kernel == "gaussian"


def test_a_page_whose_wish_is_refused_gets_the_old_value_back(app: RunningApp, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(**fields: Any) -> None:
        raise DeformError("not now.")

    monkeypatch.setattr(app.desk.session, "change", refuse)

    async def talk() -> Any:
        async with connected(app) as page:
            await page.call("trame.state.update", [{"key": "extrusion", "value": "modulate"}])
            await heard(page, lambda m: m.get("result", {}).get("error"))  # in one message or in two
            await heard(page, lambda m: m.get("result", {}).get("extrusion") == "replicate")
            return {k: v for m in page.heard for k, v in m.get("result", {}).items()}

    news = asyncio.run(talk())
    assert (news["extrusion"], news["error"]) == ("replicate", "not now.")


def test_only_the_newest_of_many_values_counts(app: RunningApp) -> None:
    async def talk() -> None:
        async with connected(app) as page:
            for value in np.linspace(-1, 2, 61):
                await page.send("trame.state.update", [{"key": "strength", "value": round(float(value), 3)}])
            await page.call("trame.state.get")

    free = threading.Event()
    app.desk.thread.call(lambda: free.wait(PATIENCE))  # a desk that is busy meanwhile
    calls: list[float] = []
    change = app.desk.set
    app.desk.set = lambda name, value: (calls.append(value), change(name, value))[1]  # type: ignore[method-assign]
    asyncio.run(talk())
    free.set()
    app.settled()
    assert app.desk.session.step.strength == 2.0
    assert calls == [2.0]


def test_a_saved_session_is_a_document(app: RunningApp) -> None:
    async def talk() -> Any:
        async with connected(app) as page:
            await page.call("trame.state.update", [{"key": "kernel", "value": "cubic"}])
            return await page.call("trame.trigger", "save", [], {})

    document = from_json(asyncio.run(talk()))
    assert document.steps[0].kernel == "cubic"
    assert document.volume is not None
    assert document.volume.shape == (12, 16, 20)


def test_a_name_that_is_html_stays_text() -> None:
    volume = Volume.from_array(np.zeros((6, 6, 6), np.uint8) + np.arange(6, dtype=np.uint8), name="<b>{{ 1+1 }}.nii")
    with RunningApp(Session(volume, view="+y")) as app:
        state = app.server.trame.state
        assert state["dnb_name"] == "<b>{{ 1+1 }}.nii"  # shown by Vue as text
        assert "<b>" not in state["trame__template_main"]
        assert state["dnb_document"] == "-b----1-1----session.json"


def test_the_page_has_every_control_and_action(app: RunningApp) -> None:
    page = app.server.trame.state["trame__template_main"]
    for name in app.desk.parameters:
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
    with RunningApp(Session(_bar(), view="+y")) as app, pytest.raises(OSError, match=r"in use|only one usage"):
        RunningApp(Session(_bar(), view="+y"), port=app.server.port).__enter__()


def test_who_brings_no_volume_gets_a_carp() -> None:
    shares: list[float] = []
    carp = made_up_carp(shares.append)
    assert carp.name.startswith("carp")
    assert shares


# -- cuts, rigid parts, saved sessions ---------------------------------------------------------------------------------


def test_cuts_drawn_in_the_page_are_edits_and_go_back_if_they_cannot_be(desk: Desk) -> None:
    line = {"region": {"kind": "line", "vertices": [[9.0, 20.0], [9.0, -1.0]]}}
    desk.receive("editor", _message({"type": "shapes", "what": "cuts", "kind": "add cut", "shapes": [line]}, 1))
    assert len(desk.session.step.cuts) == 1
    assert desk.state()["undo"] == "add cut"
    desk.act("undo")
    assert desk.editor.cuts == ()
    points = _dragged_points(desk, 0.5)
    desk.receive("editor", _message(edit_of(points, 2), 2))
    corner = points[0]["source"]
    around = {"name": "stone", "region": {"kind": "polygon", "vertices": [
        [corner[0] - 2, corner[1] - 2], [corner[0] + 1, corner[1] - 2], [corner[0] + 1, corner[1] + 2],
        [corner[0] - 2, corner[1] + 2]]}}
    desk.receive("editor", _message({"type": "shapes", "what": "parts", "kind": "add", "shapes": [around]}, 3))
    assert "stone" in desk.error
    assert desk.editor.parts == ()


def _message(content: dict[str, Any], seq: int) -> dict[str, Any]:
    return {"method": "custom", "content": {"sender": "window", **content, "seq": seq}}


def test_a_desk_goes_on_with_a_session_and_edits_its_last_picture() -> None:
    volume = _bar()
    session = Session(volume, view="+y")
    session.edit_points(session.points.add([8.0, 6.0], [10.0, 6.0]))
    session.add_step(in_space=True)
    session.edit_points(session.points.add([8.0, 6.0, 6.0], [8.0, 7.0, 6.0]))
    kept = session.deformation
    made = Desk(Session(volume, kept, view="+y"))
    assert made.session.index == 0
    assert made.session.deformation == kept
    assert made.live.editor is None  # a step in space comes after it
    made.close()
    alone = Desk(Session(volume, Deformation(kept.steps[1:]), view="+y"))
    assert [s.plane is None for s in alone.session.deformation.steps] == [True, False]
    alone.close()


def test_the_notes_of_a_volume_are_said_in_the_page() -> None:
    constant = Volume.from_array(np.full((6, 7, 8), 3.0))
    desk = Desk(Session(constant))
    assert desk.state()["notice"] == "Every voxel has the value 3: there is nothing to see in this volume."
    desk.close()

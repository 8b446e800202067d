"""The application without a browser: its widgets in their thread, its conversation with pages, its command."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from running_app import RunningApp, await_message, connect, edit_message
from waiting import PATIENCE, wait_for

from deformnb.app.application import Application, synthetic_carp
from deformnb.app.bridge import SETTABLE
from deformnb.app.start import announce, check_app
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.session.session import Session
from deformnb.volume.volume import Volume
from deformnb.widgets.messages.points import points_to_json


def _bar() -> Volume:
    return PHANTOMS["bar"].make((12, 16, 20))


@pytest.fixture
def running(tmp_path: Path) -> Iterator[RunningApp]:
    with RunningApp(Application(_bar(), side="+y", folder=tmp_path)) as running:
        yield running


def _drag_points(running: RunningApp, by: float = 3.0) -> list[dict[str, Any]]:
    points = points_to_json(running.session.editing.points)
    points[0]["target"] = [points[0]["target"][0] + by, points[0]["target"][1]]
    return points


def _named(states: dict[str, Any], trait: str, value: Any) -> str:
    """The id of the first widget with this value of a trait."""
    return next(name for name, state in states.items() if state.get(trait) == value)


def _custom(content: dict[str, Any]) -> dict[str, Any]:
    return {"method": "custom", "content": content}


def _update(**state: Any) -> dict[str, Any]:
    return {"method": "update", "state": state, "buffer_paths": []}


# -- the conversation --------------------------------------------------------------------------------------------------


def test_a_page_gets_all_widgets_that_the_studio_refers_to(running: RunningApp) -> None:
    async def talk() -> Any:
        async with connect(running) as page:
            return await page.call("deformnb.open")

    answer = asyncio.run(talk())
    states, studio = answer["widgets"], running.studio
    assert answer["studio"] == studio.model_id
    text = str(states)
    for name in states:  # each is the studio itself or referred to
        assert name == studio.model_id or f"IPY_MODEL_{name}" in text
    editor = states[studio.editor.model_id]
    assert editor["image"].startswith(b"\x89PNG")
    assert len(editor["points"]) == 4
    assert states[studio.view.model_id]["editor"] == f"IPY_MODEL_{studio.editor.model_id}"


def test_all_inputs_of_the_studio_may_be_set(running: RunningApp) -> None:
    """Traits saved by the front end, by kind of input; a new kind is missing here until it is added."""

    async def talk() -> Any:
        async with connect(running) as page:
            return (await page.call("deformnb.open"))["widgets"]

    for late in running.studio.parts.panels.late:
        running.application.thread.call(late.make).result(30)
    shown_only = {"HTMLModel", "LabelModel", "ImageModel", "ButtonModel", "FloatProgressModel", "AnyModel"}
    kinds = {
        state["_model_name"]
        for state in asyncio.run(talk()).values()
        if state["_model_module"] != "@jupyter-widgets/base" and not state["_model_name"].endswith("StyleModel")
    }
    boxes = {"VBoxModel", "HBoxModel", "BoxModel"}
    assert kinds - shown_only - boxes == set(SETTABLE) & kinds
    assert set(SETTABLE) - kinds <= {"FloatTextModel"}  # of a row that is made when it is needed


def test_a_widget_that_is_made_later_comes_before_what_refers_to_it(running: RunningApp) -> None:
    async def talk() -> Any:
        async with connect(running) as page:
            before = (await page.call("deformnb.open"))["widgets"]
            step = _named(before, "description", "Add step in space")
            await page.call("deformnb.comm", step, _custom({"event": "click"}), "1", [])
            await asyncio.to_thread(running.wait_idle)  # the studio has its new editor by now
            return before, (await await_message(page, lambda m: is_opened(m.get("result", {}))))["result"]

    def is_opened(news: dict[str, Any]) -> bool:
        return running.studio.editor.model_id in news.get("opened", {})

    before, news = asyncio.run(talk())
    made = running.studio.editor.model_id
    assert made not in before
    assert f"IPY_MODEL_{made}" in str(news["data"]["state"])


def test_the_volume_comes_in_pieces_that_make_it_whole(running: RunningApp) -> None:
    import gzip

    async def talk() -> Any:
        async with connect(running) as page:
            view = running.studio.view.model_id
            info = (await page.call("deformnb.open"))["widgets"][view]["volume_info"]
            chunk = {"type": "chunk", "view": "v", "id": info["id"], "index": 0}
            await page.call("deformnb.comm", view, _custom(chunk), "1", [])
            return info, await await_message(
                page, lambda m: m.get("result", {}).get("data", {}).get("content", {}).get("type") == "chunk"
            )

    info, message = asyncio.run(talk())
    voxels = np.frombuffer(gzip.decompress(message["result"]["buffers"][0]), np.uint8)
    assert voxels.reshape(info["shape"][::-1]).tobytes() == running.studio.view.source.voxels.volume.values.tobytes()


def test_what_one_page_drags_the_other_sees_and_its_own_echo_is_marked(running: RunningApp) -> None:
    points, editor = _drag_points(running), running.studio.editor.model_id

    def is_update(message: dict[str, Any], trait: str) -> bool:
        result = message.get("result", {})
        return bool(result.get("widget") == editor and trait in result.get("data", {}).get("state", {}))

    async def talk() -> Any:
        async with connect(running) as mine, connect(running) as other:
            await mine.call("deformnb.open")
            await mine.call("deformnb.comm", editor, _custom(edit_message(points)), "mine-1", [])
            news = await await_message(other, lambda m: is_update(m, "points"))
            await mine.call("deformnb.comm", editor, _update(selected=[2]), "mine-2", [])
            return news, await await_message(other, lambda m: is_update(m, "selected"))

    news, chosen = asyncio.run(talk())
    assert news["result"]["data"]["state"]["points"][0]["target"] == points[0]["target"]
    assert chosen["result"]["data"] == {"method": "echo_update", "state": {"selected": [2]}, "buffer_paths": []}
    assert chosen["result"]["parent"] == "mine-2"
    np.testing.assert_allclose(running.session.editing.points.displacement[0], [-3.0, 0.0])


def test_points_that_cannot_be_fitted_go_back(running: RunningApp) -> None:
    points, before = _drag_points(running), running.session.editing.points
    points[0]["target"] = points[1]["target"]  # two features at one target

    async def talk() -> Any:
        async with connect(running) as page:
            await page.call("deformnb.open")
            await page.call("deformnb.comm", running.studio.editor.model_id, _custom(edit_message(points)), "1", [])
            await await_message(
                page,
                lambda m: (
                    "are at the same place"
                    in str(m.get("result", {}).get("data", {}).get("state", {}).get("value", ""))
                ),
            )

    asyncio.run(talk())
    running.wait_idle()  # the reason is reported before the points go back
    assert running.session.editing.points == before
    assert running.studio.editor.points == before


def test_a_volume_that_is_opened_in_place_reaches_the_pages() -> None:
    with RunningApp(Application(_bar(), side="+y")) as running:
        studio = running.studio
        before = studio.editor.model_id
        other = Volume.from_array(_bar().values[:, ::2], name="other")

        async def talk() -> tuple[Any, Any]:
            async with connect(running) as page:
                await page.call("deformnb.open")
                running.application.thread.call(lambda: studio.open_volume(other))
                news = await await_message(page, lambda m: studio.model_id == m.get("result", {}).get("widget"))
                message = {"method": "custom", "content": {"type": "act"}}
                return news["result"], await page.call("deformnb.comm", before, message, "1", [])

        news, answer = asyncio.run(talk())
        running.wait_idle()
        assert studio.editor.model_id in news["opened"]
        assert before not in news["opened"]
        assert answer is None  # a page speaks to a widget until it learns that it is closed
        assert running.application.session.volume is other
        wait_for(lambda: running.server.trame.state["trame__title"] == "other - deformnb")


def test_a_name_that_is_html_stays_text() -> None:
    volume = Volume.from_array(np.zeros((6, 6, 6), np.uint8) + np.arange(6, dtype=np.uint8), name="<b>{{ 1+1 }}.nii")
    with RunningApp(Application(volume, side="+y")) as running:
        state = running.server.trame.state
        assert state["trame__title"] == "<b>{{ 1+1 }}.nii - deformnb"
        assert "<b>" not in state["trame__template_main"]


# -- the command -------------------------------------------------------------------------------------------------------


def test_options_are_checked_before_a_volume_is_read() -> None:
    assert check_app("localhost", 0, None) == "127.0.0.1"
    for host, port, side in (
        ("0.0.0.0", 0, None),
        ("127.0.0.1", 65536, None),
        ("127.0.0.1", -1, None),
        ("127.0.0.1", 0, "z"),
    ):
        with pytest.raises(DeformError):
            check_app(host, port, side)
    assert check_app("localhost", 0, None, 0) == "127.0.0.1"
    for idle in (-1, float("nan"), float("inf")):
        with pytest.raises(DeformError, match="--idle takes minutes"):
            check_app("127.0.0.1", 0, None, idle)


def test_it_says_when_it_ends_by_itself(capsys: pytest.CaptureFixture[str]) -> None:
    for idle, words in ((240.0, "240 minutes without a page"), (0.0, "Ctrl-C ends it.")):
        announce("http://here", idle, None)
        said = capsys.readouterr()
        assert said.out == "http://here\n"  # and nothing else
        assert words in said.err


def test_a_port_that_is_taken_is_said(running: RunningApp) -> None:
    other = Application(_bar())
    with pytest.raises(OSError, match=r"in use|only one usage"):
        RunningApp(other, port=running.server.port).__enter__()
    other.close()


def test_who_brings_no_volume_gets_a_carp() -> None:
    shares: list[float] = []
    carp = synthetic_carp(shares.append)
    assert carp.name.startswith("carp")
    assert shares


def test_it_goes_on_with_a_session() -> None:
    volume = _bar()
    session = Session(volume, view="+y")
    session.editing.edit_points(session.editing.points.add([8.0, 6.0], [10.0, 6.0]))
    app = Application(volume, Deformation(session.editing.deformation.steps), side="+y")
    assert app.session.editing.deformation.steps == session.editing.deformation.steps
    assert app.thread.call(lambda: len(app.studio.editor.points)).result(PATIENCE) == 5
    app.close()

"""What the application says of a map, and how it makes it safe, without a browser."""

from __future__ import annotations

import asyncio
import queue
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from driven_studio import a_volume
from running_app import PATIENCE, RunningApp, connected

from deformnb.app.application import Application
from deformnb.app.diagnostics import ApplicationDiagnostics
from deformnb.document.step_checks import step_folds
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session


@pytest.fixture
def app() -> Iterator[Application]:
    made = Application(Session(a_volume()))
    settled(made)
    yield made
    made.close()


def settled(app: Application) -> dict[str, Any]:
    """What the page shows once nothing is being judged or shown any more."""
    for _ in range(3):  # a judgement may choose stages, which are judged in turn
        app.diagnostics._worker.call(lambda: None).result(PATIENCE)
        _emptied(app)
    return app.thread.call(app.state).result(PATIENCE)


def _emptied(app: Application) -> None:
    until = time.monotonic() + PATIENCE
    while app.diagnostics._worker.is_wanted and time.monotonic() < until:
        time.sleep(0.01)
    app.diagnostics._worker.call(lambda: None).result(PATIENCE)
    app.thread.call(lambda: None).result(PATIENCE)


def drag(app: Application, far: float) -> dict[str, Any]:
    """A point in the middle, dragged so far to the right."""
    points = app.session.points
    if len(points) == 4:
        points = points.add(points.target.mean(axis=0))
    made = points.move(points.ids[-1], points.source[-1] + np.array([far, far / 2]))
    app.thread.call(lambda: app._try(lambda: app.session.edit_points(made, "a drag"))).result(PATIENCE)
    return settled(app)


def act(app: Application, name: str, *number: int) -> dict[str, Any]:
    app.thread.call(lambda: app.act(name, *number)).result(PATIENCE)
    return settled(app)


def put(app: Application, name: str, value: Any) -> dict[str, Any]:
    app.thread.call(lambda: app.set(name, value)).result(PATIENCE)
    return settled(app)


def least(app: Application) -> float:
    step, grid = app.session.step, app.session.volume.grid
    return step_folds(step, grid).least


FAR = 12.0  # of a drag that folds


def test_outdated_diagnostics_are_not_shown(app: Application) -> None:
    waiting: queue.Queue[Callable[[], None]] = queue.Queue()
    shown = []
    diagnostics = ApplicationDiagnostics(app.session, app.editor, waiting.put, lambda: shown.append(app.session.step))
    diagnostics.soon()
    late = waiting.get(timeout=PATIENCE)
    drag(app, FAR)
    late()
    assert (shown, diagnostics.state()["diagnostics"]) == ([], "")
    diagnostics.soon()
    waiting.get(timeout=PATIENCE)()
    assert shown == [app.session.step]
    assert diagnostics.state()["folded"]
    diagnostics.close()


def test_the_figures_follow_the_edits(app: Application) -> None:
    state = app.state()
    assert state["verdict"].startswith("no folds \u00b7 round trip 0 ")
    assert "none; smallest det J 1" in state["diagnostics"]
    assert not state["folded"]
    state = drag(app, FAR)
    assert least(app) < 0
    assert f"smallest det J {least(app):.3g}" in state["diagnostics"]
    assert state["verdict"].startswith("folds ")
    assert state["folded"]


@pytest.mark.parametrize(("make", "undo"), [
    (lambda app: act(app, "unfold"), "unfold by stages"), (lambda app: act(app, "take_back"), "largest safe drag"),
    (lambda app: put(app, "keep_free", True), "unfold by stages")], ids=["unfold", "take back", "keep free"])
def test_what_folds_is_made_fold_free_and_undo_brings_it_back(app: Application, make: Callable[[Application], Any],
                                                              undo: str) -> None:
    drag(app, 2.0)
    assert drag(app, FAR)["folded"]
    state = make(app)
    assert least(app) > 0
    assert (state["folded"], state["undo"]) == (False, undo)
    assert state["stages"] == app.editor.stages == app.session.step.stages
    assert np.array_equal(app.editor.points.target, app.session.points.target)
    assert act(app, "undo")["folded"]


def test_stages_are_a_whole_number(app: Application) -> None:
    assert (put(app, "stages", 16.0)["stages"], type(app.session.step.stages)) == (16, int)


def test_points_that_disagree_are_marked_and_found(app: Application) -> None:
    rng = np.random.default_rng(0)
    cells = np.stack(np.meshgrid(np.arange(4) * 6.0 + 2, np.arange(3) * 5.0 + 2), axis=-1).reshape(-1, 2)
    source = cells + rng.uniform(-0.8, 0.8, cells.shape)
    target = source * 1.05
    target[[5, 6]] = target[[6, 5]]
    names = [f"<b>{k}</b>" for k in range(12)]
    points = ControlPoints.from_arrays(source, target, names=names, ids=range(20, 32))
    app.thread.call(lambda: app._try(lambda: app.session.edit_points(points))).result(PATIENCE)
    state = settled(app)
    assert app.editor.marked == [25, 26]
    assert state["suspects"] == [{"id": 25, "name": "point 25 (<b>5</b>)"}, {"id": 26, "name": "point 26 (<b>6</b>)"}]
    assert "<b>" not in state["diagnostics"]
    sent: list[Any] = []
    app.editor.send = lambda content, buffers=None: sent.append(content)  # type: ignore[method-assign]
    act(app, "look_at", 26)
    assert app.editor.selected == [26]
    assert sent == [{"type": "look", "id": 26}]
    assert "99" in act(app, "look_at", 99)["error"]
    assert act(app, "undo")["suspects"] == app.editor.marked == []


def test_what_leaves_the_box_is_warned_of_and_the_button_makes_it_larger(app: Application) -> None:
    assert settled(app)["cut_off"] == ""
    state = drag(app, 40.0)
    assert state["cut_off"].startswith("Tissue leaves the box at the ")
    state = act(app, "fit_box")
    assert (state["cut_off"], app.session.exceeded_sides()) == ("", ())
    assert "Tissue leaves" in act(app, "own_box")["cut_off"]
    assert act(app, "reset")["cut_off"] == ""


def test_the_uncertainty_overlay_is_made_while_it_is_looked_at(app: Application) -> None:
    drag(app, 3.0)
    assert app.editor.uncertainty == b""
    put(app, "overlay", "uncertainty")
    facts, before = app.editor.uncertainty_facts, app.editor.uncertainty
    assert len(before) == facts["width"] * facts["height"] > 0
    drag(app, 5.0)
    assert app.editor.uncertainty != before
    act(app, "undo")
    assert "nothing bends" in act(app, "undo")["uncertainty_said"]
    assert app.editor.uncertainty == b""


def test_one_goes_to_any_state_of_the_history(app: Application) -> None:
    drag(app, 2.0)
    put(app, "kernel", "gaussian")
    act(app, "undo")
    state = put(app, "kernel", "cubic")
    titles = [(row["title"], row["indent"], row["on"]) for row in state["states"]]
    assert titles == [("the beginning", 0, True), ("a drag", 0, True), ("change kernel", 1, False),
                      ("change kernel", 0, True)]
    other = state["states"][2]["id"]
    state = act(app, "go_to", other)
    assert (state["kernel"], state["state_shown"], app.editor.kernel) == ("gaussian", other, "gaussian")
    assert state["notice"] == "As it was after: change kernel"
    state = act(app, "go_to", state["states"][0]["id"])
    assert state["facts"].startswith("4 points, 0 moved")
    assert app.editor.points == app.session.points
    assert act(app, "go_to", 12345)["error"]


def test_what_fails_unexpectedly_is_said(app: Application, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(keep_free: bool) -> Any:
        raise ZeroDivisionError("by nothing")

    monkeypatch.setattr(app.diagnostics.model.fold_actions, "diagnose", fail)
    state = drag(app, 2.0)
    assert "could not be computed: ZeroDivisionError: by nothing" in state["notice"]
    assert (state["diagnostics"], state["verdict"]) == ("", "")


# -- the page ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def running() -> Iterator[RunningApp]:
    with RunningApp(Session(a_volume())) as running:
        yield running


_TOOLS: dict[str, Any] = {
    "overlay": "area", "mirror": {"on": True, "axis": "b", "at": 4.5}, "snap": 2.5, "brush_radius": 7.0,
    "stop_at_folds": True, "show_grid": False, "show_radius": True, "selected": [2]}


def test_what_the_tools_of_the_editor_set_reaches_python_and_other_pages(running: RunningApp) -> None:
    async def talk() -> Any:
        async with connected(running) as mine, connected(running) as other:
            for name, value in _TOOLS.items():
                await mine.call("deformnb.state", "editor", "mine", {name: value})
            seen: dict[str, Any] = {}
            while len(seen) < len(_TOOLS):
                result = (await other.next()).get("result", {})
                if isinstance(result, dict) and result.get("origin") == "mine":
                    seen.update(result["state"])
            drawer = {k: v for message in mine.heard for k, v in (message.get("result") or {}).items()}
            while not {"overlay", "show_grid", "show_radius"} <= set(drawer):
                drawer.update((await mine.next()).get("result") or {})
            return seen, drawer

    seen, drawer = asyncio.run(talk())
    assert seen == _TOOLS
    assert {name: getattr(running.application.editor, name) for name in _TOOLS} == _TOOLS
    assert (drawer["overlay"], drawer["show_grid"], drawer["show_radius"]) == ("area", False, True)


@pytest.mark.parametrize("call", [("go_to", [], {}), ("go_to", ["1"], {}), ("go_to", [True], {}), ("go_to", [1, 2], {}),
                                  ("go_to", [1.5], {}), ("go_to", [], {"state": 1}), ("undo", [1], {}),
                                  ("look_at", "1", {})])
def test_actions_of_another_form_are_dropped(running: RunningApp, call: Any) -> None:
    async def talk() -> Any:
        async with connected(running) as page:
            return await page.call("trame.trigger", *call)

    calls: list[Any] = []
    act, running.application.act = running.application.act, lambda *given: calls.append(given)  # type: ignore[method-assign]
    dropped = running.server.dropped
    try:
        assert asyncio.run(talk()) is None
        running.settled()
    finally:
        running.application.act = act  # type: ignore[method-assign]
    assert calls == []
    assert running.server.dropped == dropped + 1


@pytest.mark.parametrize("call", [lambda d: d.act("go_to"), lambda d: d.act("undo", 3), lambda d: d.act("close", 3)])
def test_the_desk_wants_a_number_where_one_belongs(app: Application, call: Callable[[Application], None]) -> None:
    with pytest.raises(DeformError):
        call(app)

"""A Python as restricted as that of a browser: no JAX, VTK, threads, processes or compiled loops; the studio works."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import browser_python
import pytest

from deformnb import _threads
from deformnb._threads import Timer, can_start_threads
from deformnb.chunked.execution import run_on_threads
from deformnb.warping.planning import run_parts
from deformnb.widgets.worker import Worker


def first_steps(*how: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, browser_python.__file__, *how],
        env=os.environ,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_the_first_steps_of_a_notebook_work_as_in_a_browser(isolated_folders: Path) -> None:
    restricted, usual = first_steps("restricted"), first_steps()
    assert restricted.pop("threads") == 1 < usual.pop("threads")
    assert restricted.pop("saved") == [["open", 5]]
    usual.pop("saved")  # the thread of its autosave waits for a rest
    assert restricted == usual
    assert restricted["points"] == 5
    assert restricted["shown"]
    assert restricted["picture"]
    assert restricted["undone"]


@pytest.fixture
def no_threads(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    def refuse(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    monkeypatch.setattr(_threads, "_has_started", False)
    assert not can_start_threads()
    yield
    monkeypatch.undo()
    assert can_start_threads()


@pytest.mark.usefixtures("no_threads")
def test_a_worker_does_all_at_once_in_order() -> None:
    done: list[str] = []
    worker = Worker(at_end=lambda: done.append("end"))
    with worker.pause():
        worker.latest("b", lambda: done.append("old b"))
        worker.latest("b", lambda: done.append("b"))
        future = worker.call(lambda: done.append("a"))
        assert not done
    assert future.done()
    assert done == ["a", "b"]
    worker.latest("c", lambda: worker.latest("d", lambda: done.append(f"d {worker.is_current_thread}")))
    assert done == ["a", "b", "d True"]
    assert not worker.is_current_thread
    worker.close()
    assert done[3:] == ["end"]


@pytest.mark.usefixtures("no_threads")
def test_the_failure_of_a_job_is_reported_and_the_next_is_done(caplog: pytest.LogCaptureFixture) -> None:
    found: list[Any] = []
    worker = Worker(failed=found.append)
    worker.latest("wrong", lambda: found[3])
    worker.latest("right", lambda: found.append("right"))
    assert isinstance(found[0], IndexError)
    assert found[1:] == ["right"]
    with pytest.raises(ZeroDivisionError):
        worker.call(lambda: 1 // 0).result()
    assert "a job of a worker failed" in caplog.text


@pytest.mark.usefixtures("no_threads")
def test_a_rest_is_waited_for_by_the_loop_of_events_and_else_at_once_and_once() -> None:
    done: list[int] = []

    def again() -> None:
        done.append(len(done))
        worker.debounce(0.01, again)

    worker = Worker()
    worker.debounce(0.01, again)
    assert done == [0]

    async def with_loop() -> None:
        worker.debounce(0.01, lambda: done.append(-1))
        assert done == [0]
        while done[-1] != -1:
            await asyncio.sleep(0.001)

    asyncio.run(with_loop())
    assert done == [0, -1]


@pytest.mark.usefixtures("no_threads")
def test_a_timer_is_cancelled_in_the_loop_of_events() -> None:
    async def with_loop() -> list[str]:
        called: list[str] = []
        first, second = (Timer(0.005, lambda name=name: called.append(name)) for name in ("first", "second"))  # type: ignore[misc]
        first.start()
        second.start()
        first.cancel()
        while not called:
            await asyncio.sleep(0.001)
        return called

    assert asyncio.run(with_loop()) == ["second"]


@pytest.mark.usefixtures("no_threads")
def test_parts_and_blocks_are_worked_on_in_the_same_thread() -> None:
    found: list[int] = []
    shares: list[float] = []
    run_parts(range(4), found.append, shares.append)
    assert found == [0, 1, 2, 3]
    assert shares == [0.25, 0.5, 0.75, 1.0]
    assert list(run_on_threads(found.append, [7, 8], 2)) == [7, 8]
    assert found[4:] == [7, 8]

"""The thread that does one thing after the other: order, the newest of each name, rest, the end. No VTK."""

from __future__ import annotations

import gc
import logging
import os
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path

import pytest
from waiting import PATIENCE, Threads, wait_for

from deformnb.errors import DeformError
from deformnb.widgets.worker import Worker


def test_everything_is_done_by_one_thread_in_the_order_in_which_it_came() -> None:
    thread, done = Worker(), []
    futures = [thread.call(lambda k=k: done.append((k, threading.current_thread()))) for k in range(20)]
    for future in futures:
        future.result(PATIENCE)
    assert [k for k, _ in done] == list(range(20))
    assert {t for _, t in done} == {done[0][1]} != {threading.current_thread()}
    thread.close()


def test_the_newest_job_of_a_name_is_done_and_those_before_it_are_not() -> None:
    thread, gate, done = Worker(), threading.Event(), []
    thread.call(gate.wait)
    for k in range(5):
        thread.latest("a", lambda k=k: done.append(("a", k)))
        thread.latest("b", lambda k=k: done.append(("b", k)))
    assert thread.is_wanted
    gate.set()
    wait_for(lambda: len(done) == 2)
    assert done == [("a", 4), ("b", 4)]
    assert not thread.is_wanted
    thread.close()


def test_what_waits_for_a_rest_is_dropped_by_whatever_comes_first() -> None:
    thread, done = Worker(), []
    thread.debounce(0.02, lambda: done.append("rest"))
    wait_for(lambda: done == ["rest"])
    thread.debounce(30.0, lambda: done.append("never"))
    thread.latest("a", lambda: done.append("job"))
    wait_for(lambda: done == ["rest", "job"])
    thread.debounce(0.0, lambda: done.append("again"))
    wait_for(lambda: done == ["rest", "job", "again"])
    thread.close()


def test_a_job_drops_what_waits_for_a_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.widgets.worker._IDLE", 0.01)
    begun, may_end, done = threading.Event(), threading.Event(), list[str]()
    worker = Worker(at_end=lambda: done.append("end"))
    worker.latest("first", lambda: (begun.set(), may_end.wait(PATIENCE), done.append("first"))[0])
    assert begun.wait(PATIENCE)
    worker.debounce(0.0, lambda: done.append("rest"))
    worker.latest("next", lambda: done.append("next"))
    may_end.set()
    wait_for(lambda: "end" in done)  # idle: what waits still would have been done by now
    assert done == ["first", "next", "end"]
    worker.close()


def test_a_job_that_is_done_while_the_worker_is_closed_may_ask_for_a_rest(caplog: pytest.LogCaptureFixture) -> None:
    thread, begun, gate, done = Worker(), threading.Event(), threading.Event(), threading.Event()

    def job() -> None:
        begun.set()
        gate.wait(PATIENCE)
        thread.debounce(0.0, lambda: None)  # the worker was closed meanwhile
        done.set()

    thread.latest("a", job)
    assert begun.wait(PATIENCE)
    thread.close(wait=0.0)
    gate.set()
    assert done.wait(PATIENCE)
    assert caplog.records == []


def test_a_process_that_ends_cancels_what_a_job_computes_between_two_programs(tmp_path: Path) -> None:
    compiling = """if True:
        import sys
        import threading
        from deformnb._jax import jit, jnp
        from deformnb.widgets.worker import Worker

        begun, worker = threading.Event(), Worker()

        def job():
            for k in range(10000):  # minutes
                jit(lambda x, k=k: jnp.linalg.eigh(jnp.sort(x, axis=k % 2) + k)[1])(jnp.ones((5, 5)))
                begun.set()

        worker.latest("compile", job)
        begun.wait()
    """
    environment = {**os.environ, "DEFORMNB_COMPILATION_CACHE": "off"}
    ended = subprocess.run(
        [sys.executable, "-c", compiling],
        cwd=tmp_path,
        env=environment,
        timeout=PATIENCE,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stdout) == (0, ""), ended.stderr  # XLA torn out of its work: -6 or -11


def test_an_exception_goes_to_who_waits_and_the_thread_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    thread = Worker()
    with pytest.raises(ZeroDivisionError):
        thread.call(lambda: 1 // 0).result(PATIENCE)
    with caplog.at_level(logging.ERROR):
        thread.latest("a", lambda: 1 // 0)  # type: ignore[arg-type, return-value]
        assert thread.call(lambda: 5).result(PATIENCE) == 5
        assert thread.call(lambda: 6).result(PATIENCE) == 6
        wait_for(lambda: "a job of a worker failed" in caplog.text)
    thread.close()


def test_the_end_cancels_what_waits_and_comes_behind_the_work_of_now() -> None:
    gate, ended = threading.Event(), threading.Event()
    thread = Worker(at_end=ended.set)
    under_way, waiting = thread.call(gate.wait), thread.call(lambda: 1)
    wait_for(under_way.running)
    start = time.monotonic()
    thread.close()
    assert time.monotonic() - start < 30  # it does not wait for the work
    assert waiting.cancelled()
    assert thread.is_closed
    assert not ended.is_set()
    gate.set()
    assert ended.wait(PATIENCE)
    with pytest.raises(DeformError, match="closed"):
        thread.call(lambda: 1)
    thread.close()


def test_without_its_owner_the_thread_ends_and_holds_nothing_of_its_last_job() -> None:
    class Owner:
        def work(self) -> None:
            """A job."""

    threads, owner = Threads(), Owner()
    thread = Worker()
    thread.call(owner.work).result(PATIENCE)
    held = weakref.ref(owner)
    del owner
    wait_for(lambda: gc.collect() >= 0 and held() is None)
    assert len(threads.alive) == 1
    del thread
    wait_for(lambda: gc.collect() >= 0 and not threads.alive)


def test_a_thread_that_never_worked_was_never_started() -> None:
    threads = Threads()
    thread = Worker(at_end=lambda: pytest.fail("nothing was begun"))
    assert threads.alive == []
    thread.close()


def test_a_thread_without_work_ends_and_another_takes_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.widgets.worker._IDLE", 0.01)
    ended: list[threading.Thread] = []
    worker = Worker(at_end=lambda: ended.append(threading.current_thread()))
    threads = []
    for _ in range(3):
        threads.append(worker.call(threading.current_thread).result(PATIENCE))
        wait_for(lambda: not threads[-1].is_alive())
    assert len(set(threads)) == 3
    assert ended == threads  # each clears the state that it alone may touch
    worker.debounce(0.05, lambda: threads.append(threading.current_thread()))  # longer than it takes to be idle
    wait_for(lambda: len(threads) == 4)
    worker.close()
    with pytest.raises(DeformError, match="is closed"):
        worker.call(lambda: None)


def test_a_thread_that_is_kept_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.widgets.worker._IDLE", 0.001)
    asked: list[bool] = []

    def is_needed() -> bool:
        asked.append(len(asked) < 5)
        return asked[-1]

    worker = Worker(is_needed=is_needed)
    thread = worker.call(threading.current_thread).result(PATIENCE)
    wait_for(lambda: not thread.is_alive())
    assert asked == [True] * 5 + [False]
    worker.close()


def test_nothing_is_lost_while_threads_end_and_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.widgets.worker._IDLE", 0.0)
    working, done, clashes = threading.Lock(), [], []

    def work(number: int) -> int:
        clashes.append(not working.acquire(blocking=False))
        done.append(number)
        working.release()
        return number

    def put_away() -> None:
        clashes.append(not working.acquire(blocking=False))
        working.release()

    worker = Worker(at_end=put_away)
    askers = [
        threading.Thread(
            target=lambda first=first: [
                worker.call(lambda k=k: work(k)).result(PATIENCE) for k in range(first, first + 200)
            ]
        )
        for first in (0, 1000, 2000)
    ]
    for asker in askers:
        asker.start()
    for asker in askers:
        asker.join(PATIENCE)
    worker.close(PATIENCE)
    assert sorted(done) == [first + k for first in (0, 1000, 2000) for k in range(200)]
    assert not any(clashes)

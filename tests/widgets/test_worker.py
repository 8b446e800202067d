"""The thread that does one thing after the other: order, the newest of each name, rest, the end. No VTK."""

from __future__ import annotations

import gc
import logging
import threading
import time
import weakref
from collections.abc import Callable

import pytest

from deformnb.errors import DeformError
from deformnb.widgets.worker import Worker


def until(condition: Callable[[], bool], timeout: float = 20.0) -> None:
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_everything_is_done_by_one_thread_in_the_order_in_which_it_came() -> None:
    thread, done = Worker(), []
    futures = [thread.call(lambda k=k: done.append((k, threading.current_thread()))) for k in range(20)]
    for future in futures:
        future.result(20)
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
    until(lambda: len(done) == 2)
    assert done == [("a", 4), ("b", 4)]
    assert not thread.is_wanted
    thread.close()


def test_what_waits_for_a_rest_is_dropped_by_whatever_comes_first() -> None:
    thread, done = Worker(), []
    thread.at_rest(0.02, lambda: done.append("rest"))
    until(lambda: done == ["rest"])
    thread.at_rest(30.0, lambda: done.append("never"))
    thread.latest("a", lambda: done.append("job"))
    until(lambda: done == ["rest", "job"])
    thread.at_rest(0.0, lambda: done.append("again"))
    until(lambda: done == ["rest", "job", "again"])
    thread.close()


def test_a_job_drops_what_waits_for_a_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.widgets.worker._IDLE", 0.01)
    begun, may_end, done = threading.Event(), threading.Event(), list[str]()
    worker = Worker(at_end=lambda: done.append("end"))
    worker.latest("first", lambda: (begun.set(), may_end.wait(20), done.append("first"))[0])
    assert begun.wait(20)
    worker.at_rest(0.0, lambda: done.append("rest"))
    worker.latest("next", lambda: done.append("next"))
    may_end.set()
    until(lambda: "end" in done)  # idle: what waits still would have been done by now
    assert done == ["first", "next", "end"]
    worker.close()


def test_a_job_that_is_done_while_the_worker_is_closed_may_ask_for_a_rest(caplog: pytest.LogCaptureFixture) -> None:
    thread, begun, gate, done = Worker(), threading.Event(), threading.Event(), threading.Event()

    def job() -> None:
        begun.set()
        gate.wait(20)
        thread.at_rest(0.0, lambda: None)  # the worker was closed meanwhile
        done.set()

    thread.latest("a", job)
    assert begun.wait(20)
    thread.close(wait=0.0)
    gate.set()
    assert done.wait(20)
    assert caplog.records == []


def test_an_exception_goes_to_who_waits_and_the_thread_goes_on(caplog: pytest.LogCaptureFixture) -> None:
    thread = Worker()
    with pytest.raises(ZeroDivisionError):
        thread.call(lambda: 1 // 0).result(20)
    with caplog.at_level(logging.ERROR):
        thread.latest("a", lambda: 1 // 0)  # type: ignore[arg-type, return-value]
        assert thread.call(lambda: 5).result(20) == 5
        assert thread.call(lambda: 6).result(20) == 6
        until(lambda: "a job of a worker failed" in caplog.text)
    thread.close()


def test_the_end_cancels_what_waits_and_comes_behind_the_work_of_now() -> None:
    gate, ended = threading.Event(), threading.Event()
    thread = Worker(at_end=ended.set)
    under_way, waiting = thread.call(gate.wait), thread.call(lambda: 1)
    until(under_way.running)
    start = time.monotonic()
    thread.close()
    assert time.monotonic() - start < 5  # it does not wait for the work
    assert waiting.cancelled()
    assert thread.is_closed
    assert not ended.is_set()
    gate.set()
    assert ended.wait(20)
    with pytest.raises(DeformError, match="closed"):
        thread.call(lambda: 1)
    thread.close()


def test_without_its_owner_the_thread_ends_and_holds_nothing_of_its_last_job() -> None:
    class Owner:
        def work(self) -> None:
            """A job."""

    before, owner = threading.active_count(), Owner()
    thread = Worker()
    thread.call(owner.work).result(20)
    held = weakref.ref(owner)
    del owner
    until(lambda: gc.collect() >= 0 and held() is None)
    assert threading.active_count() == before + 1
    del thread
    until(lambda: gc.collect() >= 0 and threading.active_count() == before)


def test_a_thread_that_never_worked_was_never_started() -> None:
    before = threading.active_count()
    thread = Worker(at_end=lambda: pytest.fail("nothing was begun"))
    assert threading.active_count() == before
    thread.close()


def test_a_thread_without_work_ends_and_another_takes_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.widgets.worker._IDLE", 0.01)
    ended: list[threading.Thread] = []
    worker = Worker(at_end=lambda: ended.append(threading.current_thread()))
    threads = []
    for _ in range(3):
        threads.append(worker.call(threading.current_thread).result(20))
        until(lambda: not threads[-1].is_alive())
    assert len(set(threads)) == 3
    assert ended == threads  # each puts away what it alone may touch
    worker.at_rest(0.05, lambda: threads.append(threading.current_thread()))  # longer than it takes to be idle
    until(lambda: len(threads) == 4)
    worker.close()
    with pytest.raises(DeformError, match="is closed"):
        worker.call(lambda: None)


def test_a_thread_that_is_kept_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.widgets.worker._IDLE", 0.001)
    asked: list[bool] = []

    def is_kept() -> bool:
        asked.append(len(asked) < 5)
        return asked[-1]

    worker = Worker(is_kept=is_kept)
    thread = worker.call(threading.current_thread).result(20)
    until(lambda: not thread.is_alive())
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
    askers = [threading.Thread(target=lambda first=first: [
        worker.call(lambda k=k: work(k)).result(20) for k in range(first, first + 200)]) for first in (0, 1000, 2000)]
    for asker in askers:
        asker.start()
    for asker in askers:
        asker.join(60)
    worker.close(20)
    assert sorted(done) == [first + k for first in (0, 1000, 2000) for k in range(200)]
    assert not any(clashes)

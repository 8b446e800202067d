"""Sessions that write themselves: when, what, and that nothing about it stops an edit."""

from __future__ import annotations

import gc
import json
import os
import shutil
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from studio_driver import crash, finish, wait_for
from waiting import PATIENCE

from deformnb.datasets import PHANTOMS
from deformnb.document.deformation import LazyReference
from deformnb.session import autosave as module
from deformnb.session.autosave import Autosave, restore, saved_sessions
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume


def a_volume(seed: int = 0) -> Volume:
    values = np.random.default_rng(seed).integers(0, 255, (6, 7, 8)).astype(np.uint8)
    return Volume(values, Grid((6, 7, 8)), "noise")


@pytest.fixture
def session() -> Session:
    return Session(a_volume())


def entries(volume: Volume, every: bool = True) -> list[Any]:
    return saved_sessions(volume, every=every)


def test_an_edit_is_written_after_a_pause_and_a_row_of_edits_once(
    session: Session, state_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[Any] = []
    saving = Autosave(session, delay=0.3, on_written=told.append)
    with monkeypatch.context() as clock:  # it stands still: the row has no pause, however busy the machine is
        now = time.monotonic()
        clock.setattr(module, "time", SimpleNamespace(monotonic=lambda: now))
        for k in range(10):
            session.editing.change(strength=0.1 * k)
    wait_for(lambda: told)
    assert time.monotonic() - now >= 0.29
    assert len(told) == 1
    assert restore(told[0]).steps == session.editing.deformation.steps
    assert told[0].path.parent == state_folder / "sessions"
    assert told[0].is_live
    assert entries(session.volume, every=False) == []  # it runs
    saving.close()


def test_edits_without_a_pause_are_written_all_the_same(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "LONGEST_WAIT", 2.0)
    told: list[Any] = []
    saving = Autosave(session, delay=0.4, on_written=told.append)
    end = time.monotonic() + 20
    while not told and time.monotonic() < end:
        session.editing.change(strength=0.5 + 0.4 * np.sin(time.monotonic()))
        time.sleep(0.02)
    assert told
    saving.close()


def test_what_was_left_is_lost_and_comes_back_exactly(session: Session) -> None:
    saving = Autosave(session, delay=60)
    middle = session.editing.points.source.mean(axis=0)
    session.editing.edit_points(session.editing.points.add(middle, middle + np.array([0.1, 1 / 3])))
    session.set_view("+z")
    session.editing.edit_step(0)
    crash(saving)
    (entry,) = entries(session.volume, every=False)
    assert restore(entry).steps == session.editing.deformation.steps
    assert (entry.points, entry.steps, entry.index) == (9, 2, 0)
    assert [p.suffix for p in entry.path.parent.iterdir()] == [".json"]


def test_the_box_of_the_result_comes_back_with_the_rest(session: Session) -> None:
    autosave = Autosave(session)
    session.results.grow(3.0)
    autosave.flush()
    crash(autosave)
    (lost,) = saved_sessions(session.volume)
    assert session.editing.output is not None
    assert restore(lost).output == session.editing.output


def test_what_was_closed_or_saved_or_never_edited_is_not_lost(session: Session, tmp_path: Path) -> None:
    saving = Autosave(session)
    saving.flush()
    assert entries(session.volume) == []
    session.editing.change(strength=0.5)
    saving.flush()
    assert [e.state for e in entries(session.volume)] == ["open"]
    session.save(tmp_path / "a.json")
    saving.flush()
    assert [e.state for e in entries(session.volume)] == ["saved"]
    session.editing.change(strength=0.6)
    saving.flush()
    assert [e.state for e in entries(session.volume)] == ["open"]
    while session.editing.undo():
        pass
    saving.flush()
    assert [e.state for e in entries(session.volume)] == ["unchanged"]
    session.editing.redo()
    saving.flush()
    assert [e.state for e in entries(session.volume)] == ["saved"]  # as it is in the file
    session.editing.change(strength=0.65)
    finish(saving)
    assert [e.state for e in entries(session.volume)] == ["closed"]
    assert [e.is_earlier for e in entries(session.volume)] == [True]
    assert entries(session.volume, every=False) == []
    session.editing.change(strength=0.7)  # nobody listens any more
    saving.close()


def test_an_edit_before_the_checksum_is_known_is_kept(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    of, slow = LazyReference.__call__, []

    def slowly(self: LazyReference) -> Any:
        while not slow:
            time.sleep(0.01)
        return of(self)

    monkeypatch.setattr(LazyReference, "__call__", slowly)
    saving = Autosave(session, delay=0.01)
    start = time.perf_counter()
    session.editing.change(strength=0.5)
    assert time.perf_counter() - start < 30
    time.sleep(0.1)
    assert not slow
    slow.append(True)
    saving.flush()
    assert [e.state for e in entries(session.volume)] == ["open"]
    saving.close()


def test_trouble_is_told_once_and_editing_goes_on(session: Session, tmp_path: Path) -> None:
    told: list[str] = []
    place = tmp_path / "no" / "folder"
    place.parent.write_text("a file is in the way", encoding="utf-8")
    saving = Autosave(session, place, delay=0.01, on_trouble=told.append)
    for strength in (0.5, 0.6):
        session.editing.change(strength=strength)
        saving.flush()
    assert len(told) == 1
    assert "save the session yourself" in told[0]
    assert "\n" not in told[0]
    place.parent.unlink()
    session.editing.change(strength=0.7)
    saving.flush()
    assert [e.state for e in saved_sessions(session.volume, place, every=True)] == ["open"]
    shutil.rmtree(place.parent)  # while it runs: it is made again, and held again
    session.editing.change(strength=0.8)
    saving.flush()
    (entry,) = saved_sessions(session.volume, place, every=True)
    assert entry.is_live
    assert restore(entry).steps[0].strength == 0.8
    shutil.rmtree(place.parent)
    place.parent.write_text("again", encoding="utf-8")
    session.editing.change(strength=0.9)
    saving.flush()
    assert len(told) == 2
    saving.close()


def test_a_failing_listener_stops_nothing(session: Session) -> None:
    def fail(_given: Any) -> None:
        raise RuntimeError("of another")

    saving = Autosave(session, delay=0.01, on_ready=fail, on_written=fail, on_trouble=fail)
    session.editing.change(strength=0.5)
    saving.flush()
    assert len(entries(session.volume)) == 1
    saving.close()


def test_what_is_continued_is_offered_until_the_new_one_is_written(session: Session) -> None:
    first = Autosave(session)
    session.editing.change(strength=0.5)
    crash(first)
    (lost,) = entries(session.volume, every=False)
    later = Session(session.volume)
    saving = Autosave(later, delay=60)
    later.editing.edit_document(restore(lost), "restore")
    saving.replaces(lost)
    assert entries(session.volume, every=False) == [lost]
    saving.flush()
    assert [e.state for e in entries(session.volume)] == ["open", "restored"]
    saving.close()


def test_neither_session_nor_volume_is_kept_alive_and_the_last_edit_is_written() -> None:
    volume = a_volume()
    session = Session(volume)
    saving = Autosave(session, delay=60)
    session.editing.change(strength=0.5)
    alive, held, twin = weakref.ref(session), weakref.ref(volume), a_volume()
    del session, volume
    gc.collect()
    assert alive() is None
    wait_for(lambda: not writers())  # it has told of its end before it came
    assert held() is None
    (entry,) = entries(twin)
    assert (entry.state, restore(entry).steps[0].strength) == ("closed", 0.5)
    assert saving.close(PATIENCE)  # once more does no harm


def test_a_session_that_nobody_edits_has_no_thread_and_is_written_when_it_is_edited_again(session: Session) -> None:
    told: list[Any] = []
    saving = Autosave(session, delay=0.01, on_written=lambda entry: told.append((entry, threading.current_thread())))
    for strength in (0.5, 0.25, 0.75):
        wait_for(lambda: not writers())
        session.editing.change(strength=strength)
        wait_for(lambda: told and restore(told[-1][0]).steps[0].strength == strength)  # noqa: B023
        assert told[-1][0].is_live  # another process takes it for running
    wait_for(lambda: not writers())
    assert len({thread for _, thread in told}) == 3
    assert entries(session.volume, every=False) == []
    finish(saving)
    assert [entry.state for entry in entries(session.volume)] == ["closed"]


def test_an_edit_goes_on_where_no_thread_can_be_started(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[str] = []
    saving = Autosave(session, delay=0.01, on_trouble=told.append)
    wait_for(lambda: not writers())

    def refuse(_thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as system:
        system.setattr(threading.Thread, "start", refuse)
        session.editing.change(strength=0.25)
    [trouble] = told
    assert trouble.endswith("save the session yourself: RuntimeError: can't start new thread")
    session.editing.change(strength=0.5)
    saving.flush()
    assert [restore(entry).steps[0].strength for entry in entries(session.volume)] == [0.5]
    saving.close()


IDLE = """
import gc, os, threading, time
from deformnb.session.autosave import Autosave, saved_sessions
from deformnb.datasets import PHANTOMS
from deformnb.session.session import Session
session = Session(PHANTOMS["bar"].make((8, 8, 8)))
saving = Autosave(session, delay=0.0)
session.editing.change(strength=0.5)
saving.flush()
while threading.active_count() > 1:
    time.sleep(0.01)
"""

COPY = """
child = os.fork()
if child == 0:
    session.editing.change(strength=0.25)
    saving.close()
    os._exit(threading.active_count())
assert os.waitpid(child, 0)[1] == 256  # no thread was started, and it has ended by itself
assert saved_sessions(session.volume, every=True)[0].is_live
"""


@pytest.mark.parametrize(
    "last",
    [
        "",
        "del session, saving; gc.collect()",
        pytest.param(
            COPY, marks=pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are copied as on POSIX")
        ),
    ],
    ids=["open", "deleted", "copied"],
)
def test_a_session_without_a_thread_is_closed_at_the_end_of_its_process_alone(state_folder: Path, last: str) -> None:
    subprocess.run([sys.executable, "-c", IDLE + last], check=True, timeout=120)
    (entry,) = entries(PHANTOMS["bar"].make((8, 8, 8)))
    assert (entry.state, restore(entry).steps[0].strength, entry.is_live) == ("closed", 0.5, False)


def writers() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name == "deformnb-autosave"]


def test_the_file_is_text_that_can_be_read_without_the_program(session: Session) -> None:
    saving = Autosave(session)
    session.editing.change(strength=0.5)
    crash(saving)
    (entry,) = entries(session.volume)
    facts, document = entry.path.read_text(encoding="utf-8").split("\n", 1)
    assert json.loads(facts)["points"] == 4
    assert json.loads(document)["steps"][0]["strength"] == 0.5
    assert entry.path.stat().st_mode & 0o077 in (0o000, 0o044, 0o066)
    assert entry.path.parent.stat().st_mode & 0o077 == 0


def test_what_could_not_be_written_is_tried_once_more_at_the_end(
    session: Session, state_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    saving = Autosave(session, delay=0.01, on_trouble=told.append)

    def full(*_given: Any) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr(module, "write_session", full)
        session.editing.change(strength=0.25)
        saving.flush()
        assert len(told) == 1
        assert entries(session.volume) == []
    crash(saving)
    wait_for(lambda: entries(session.volume, every=False))
    [entry] = entries(session.volume)
    assert restore(entry).steps[0].strength == 0.25


def test_a_volume_without_a_checksum_is_trouble_and_flushes_nothing(session: Session) -> None:
    told: list[str] = []

    def unreadable() -> Any:
        raise OSError(5, "Input/output error")

    session.files.reference = unreadable  # type: ignore[assignment]
    saving = Autosave(session, delay=0.01, on_trouble=told.append)
    wait_for(lambda: told)
    assert "Autosave is not possible now" in told[0]
    session.editing.change(strength=0.25)
    with pytest.raises(TimeoutError):
        saving.flush(5)
    saving.close()

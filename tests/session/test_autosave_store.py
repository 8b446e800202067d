"""Files of sessions that were written by themselves: which are offered, which are stored."""

from __future__ import annotations

import os
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from deformnb.document.deformation import VolumeReference
from deformnb.errors import DeformError
from deformnb.io.files.atomic import create_locked
from deformnb.session import autosave_store
from deformnb.session.autosave_store import SavedSession, delete, prune, restore, saved_sessions, skip, write_session
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume


def a_volume(seed: int = 0, spacing: float = 1.0) -> Volume:
    values = np.random.default_rng(seed).integers(0, 255, (6, 7, 8)).astype(np.uint8)
    return Volume(values, Grid((6, 7, 8), (spacing, 1.0, 1.0)), "noise")


def written(
    folder: Path, *, minutes: float = 1.0, state: str = "open", volume: Volume | None = None, strength: float = 1.0
) -> SavedSession:
    session = Session(volume or a_volume())
    session.editing.change(strength=strength)
    reference = session.files.reference()
    count = len(list(folder.glob("*.json"))) if folder.exists() else 0
    path = folder / autosave_store.file_name(reference, f"{count:08x}")
    entry = SavedSession(path, reference, datetime.now(UTC) - timedelta(minutes=minutes), state, 4, 1)
    write_session(entry, session.document())
    return entry


def test_the_folder_is_the_users_own_unless_another_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("DEFORMNB_STATE", str(tmp_path / "here"))
    assert autosave_store.state_folder() == tmp_path / "here" / "sessions"
    monkeypatch.delenv("DEFORMNB_STATE")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "xdg"))
    if os.name == "posix":
        assert autosave_store.state_folder() == tmp_path / "xdg" / "deformnb" / "sessions"


def test_what_was_lost_is_listed_newest_first_and_comes_back(tmp_path: Path) -> None:
    written(tmp_path, minutes=9, strength=0.5)
    newest = written(tmp_path, minutes=2, strength=0.25)
    for state in autosave_store.STATES[1:]:
        written(tmp_path, state=state)
    written(tmp_path, volume=a_volume(1))
    written(tmp_path, volume=a_volume(0, spacing=2.0))  # the same voxels, larger
    there = replace(a_volume().grid, origin=(5.0, 0.0, 0.0))
    written(tmp_path, volume=replace(a_volume(), grid=there))  # the same voxels, elsewhere
    found = saved_sessions(a_volume(), tmp_path)
    assert found[0] == newest
    assert [restore(entry).steps[0].strength for entry in found] == [0.25, 0.5]
    assert len(saved_sessions(a_volume(), tmp_path, every=True)) == 2 + len(autosave_store.STATES) - 1
    assert (tmp_path.stat().st_mode & 0o777) or os.name == "nt"


def test_a_running_session_is_not_lost(tmp_path: Path) -> None:
    entry = written(tmp_path)
    descriptor = create_locked(entry.lock_path)
    assert descriptor is not None
    assert entry.is_live
    assert saved_sessions(a_volume(), tmp_path) == []
    os.close(descriptor)
    assert saved_sessions(a_volume(), tmp_path) == [entry]


def test_skipping_is_remembered_and_deleting_leaves_nothing(tmp_path: Path) -> None:
    entry, other = written(tmp_path), written(tmp_path, minutes=5)
    skip(entry)
    autosave_store.skipped_here.clear()  # as in the next process
    assert saved_sessions(a_volume(), tmp_path) == [other]
    assert restore(entry).steps  # it can still be had
    delete(other)
    delete(other)
    assert saved_sessions(a_volume(), tmp_path) == []
    assert [p.name for p in tmp_path.iterdir()] == [entry.path.name]
    with pytest.raises(DeformError, match="cannot be read any more"):
        restore(other)


@pytest.mark.parametrize(
    "damage",
    [
        b"",
        b"{}\n",
        b"nothing",
        b"[1]\n{}",
        b'{"format": "deformnb-autosave"}\n',
        b"\xff\xfe\n{}",
        b"[" * 9000,
        b'{"format": "deformnb-autosave", "state": "open", "edited": "2020"}\n',
        b"1e999\n",
    ],
)
def test_a_damaged_file_is_no_session_and_goes_in_the_end(damage: bytes, tmp_path: Path) -> None:
    entry = written(tmp_path)
    bad = tmp_path / autosave_store.file_name(entry.volume, "ffffffff")
    bad.write_bytes(damage)
    assert saved_sessions(a_volume(), tmp_path, every=True) == [entry]
    prune(tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == [entry.path.name]


def test_a_damaged_document_is_said(tmp_path: Path) -> None:
    entry = written(tmp_path)
    whole = entry.path.read_bytes()
    for cut in (len(whole) // 2, len(whole) - 3):
        entry.path.write_bytes(whole[:cut])
        with pytest.raises(DeformError, match="not complete JSON"):
            restore(entry)


def test_a_name_from_a_file_is_kept_short_and_no_path(tmp_path: Path) -> None:
    reference = replace(VolumeReference.of(a_volume()), name="../../" + "x" * 5000, sha256="0" * 64)
    entry = replace(written(tmp_path), volume=reference, path=tmp_path / autosave_store.file_name(reference, "a"))
    write_session(entry, restore(written(tmp_path)))
    found = saved_sessions(reference, tmp_path)
    assert len(found) == 1
    assert found[0].path.parent == tmp_path
    assert len(found[0].volume.name) == 200


def test_few_are_kept_and_all_that_nobody_has_answered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(autosave_store, "MOST_PER_VOLUME", 2)
    monkeypatch.setattr(autosave_store, "MOST_AUTOSAVES", 3)
    old = written(tmp_path, minutes=60 * 24 * 31)
    lost = [written(tmp_path, minutes=100 + k) for k in range(3)]
    saved = [written(tmp_path, minutes=k, state=state) for k, state in enumerate(("saved", "closed", "skipped"))]
    others = [written(tmp_path, minutes=10 + k, volume=a_volume(1), state="closed") for k in range(2)]
    running = written(tmp_path, minutes=60 * 24 * 40)
    descriptor = create_locked(running.lock_path)
    dead = create_locked(old.lock_path)
    assert descriptor is not None
    assert dead is not None
    os.close(dead)
    prune(tmp_path)
    assert set(tmp_path.glob("*.json")) == {entry.path for entry in [old, *lost, *saved[:2], others[0], running]}
    assert list(tmp_path.glob("*.live")) == [running.lock_path]
    os.close(descriptor)


@pytest.mark.parametrize("days", [-400, -40, 40, 400])
def test_a_clock_that_goes_wrong_removes_nothing(days: float, tmp_path: Path) -> None:
    """An edit that seems to be in the future or long ago was perhaps made a minute ago."""
    entries = [
        written(tmp_path, minutes=days * 24 * 60 + k, state=state) for k, state in enumerate(autosave_store.STATES)
    ]
    written(tmp_path, minutes=0, state="closed")
    prune(tmp_path)
    assert {entry.path for entry in entries} <= set(tmp_path.iterdir())


@pytest.mark.parametrize("days", [-40, 40])
def test_the_session_that_began_last_stays_whatever_the_clock_says(
    days: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(autosave_store, "MOST_PER_VOLUME", 2)
    made = written(tmp_path / "one")
    for k in range(4):
        path = tmp_path / autosave_store.file_name(made.volume, f"{k:08x}")
        edited = made.edited + timedelta(days=days * k)
        number = autosave_store.next_number(tmp_path)
        write_session(replace(made, path=path, state="closed", edited=edited, number=number), restore(made))
        prune(tmp_path)
        assert [e.number for e in saved_sessions(a_volume(), tmp_path, every=True)] == [k + 1, k][: k + 1]


def test_what_was_lost_stays_until_it_is_answered(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(autosave_store, "MOST_PER_VOLUME", 1)
    monkeypatch.setattr(autosave_store, "MOST_AUTOSAVES", 1)
    monkeypatch.setattr(autosave_store, "MOST_AUTOSAVE_BYTES", 1)
    lost = [written(tmp_path, minutes=60 * 24 * 365 * k) for k in range(1, 30)]
    prune(tmp_path)
    assert saved_sessions(a_volume(), tmp_path) == lost
    for entry in lost[1:]:
        skip(entry)
    prune(tmp_path)
    assert saved_sessions(a_volume(), tmp_path, every=True) == lost[:1]


def test_together_they_stay_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entries = [written(tmp_path, minutes=k, state="closed") for k in (1, 2, 3)]
    monkeypatch.setattr(autosave_store, "MOST_AUTOSAVE_BYTES", int(2.5 * entries[0].path.stat().st_size))
    prune(tmp_path)
    assert set(tmp_path.iterdir()) == {entry.path for entry in entries[:2]}


def test_what_else_lies_in_the_folder_is_left_alone(tmp_path: Path) -> None:
    """Somebody may name the folder of a project, with documents and settings of other programs."""
    entry = written(tmp_path)
    others = {tmp_path / name for name in ("my work.json", "settings.json", "0123-4-5.json", "server.live")}
    for path in others:
        path.write_text("{}", encoding="utf-8")
    prune(tmp_path)
    assert set(tmp_path.iterdir()) == {entry.path, *others}


def test_what_is_written_while_the_folder_is_looked_through_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    entry, late = written(tmp_path), list[SavedSession]()
    read_all = autosave_store.read_entries

    def read_and_be_late(folder: Path) -> list[SavedSession]:
        found = read_all(folder)
        late.append(written(tmp_path, strength=0.5))
        return found

    monkeypatch.setattr(autosave_store, "read_entries", read_and_be_late)
    prune(tmp_path)
    assert set(tmp_path.iterdir()) == {entry.path, late[0].path}

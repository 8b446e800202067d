"""Processes that are killed at random moments, run as a separate program: ``python crashes.py what folder seed``.

Importing takes seconds and being killed no time: so one process imports, and forks of it are killed. It reports
as JSON its findings after each of them.
"""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError, FileChangedError
from deformnb.io.documents import read_deformation, read_document, write_deformation
from deformnb.io.files.atomic import KnownFiles
from deformnb.io.volumes.formats import read_volume, write_volume
from deformnb.rbf.points import ControlPoints
from deformnb.session.autosave import Autosave
from deformnb.session.autosave_store import restore, saved_sessions
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume

ROUNDS = {"save": 40, "writers": 20, "pairs": 23}


def a_volume() -> Volume:
    values = np.random.default_rng(7).integers(0, 255, (6, 7, 8)).astype(np.uint8)
    return Volume(values, Grid((6, 7, 8)), "noise")


def a_document(number: int, count: int = 300) -> Deformation:
    """The same document for the same number, tens of kilobytes long."""
    places = np.random.default_rng(number).uniform(0, 5, (count, 2))
    points = ControlPoints.from_arrays(places, places + 0.001 * number)
    return replace(Deformation.from_picture_points(Grid((6, 7, 8)), "+y", points), name=str(number))


def fork(work: Callable[[], Any]) -> int:
    """The id of a fork of this process that does this."""
    pid = os.fork()
    if pid:
        return pid
    try:
        work()
    finally:
        os._exit(0)


def kill_after(pid: int, after: float) -> None:
    time.sleep(after)
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)


def listing(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


# -- their operations --------------------------------------------------------------------------------------------------


def save(folder: Path, chance: random.Random) -> Any:
    """Kill a process while it saves one document after the other into one file."""
    path, last, most, found = folder / "fish.json", -1, 0, set()
    write_deformation(a_document(0, 120), path)
    documents = [a_document(number, 120) for number in range(5)]

    def work() -> None:
        while True:
            for document in documents:
                write_deformation(document, path)

    for _ in range(ROUNDS["save"]):
        kill_after(fork(work), chance.uniform(0.01, 0.2))
        document = read_deformation(path)  # raises if it is not whole
        last = int(document.name)
        assert document == documents[last]
        found.add(last)
        most = max(most, len(listing(folder)))
    write_deformation(documents[0], path)
    return {"found": len(found), "most": most, "left": listing(folder)}


def autosave(folder: Path, chance: random.Random) -> Any:
    """Edit without end with autosave; reports the strength that was written."""

    def tell(entry: Any) -> None:
        os.write(1, b"%d\n" % round(restore(entry).steps[0].strength * 1e6))

    session = Session(a_volume())
    Autosave(session, folder, 0.002, on_written=tell)
    for number in range(1, 10**6):
        session.editing.change(strength=number / 1e6)
        time.sleep(chance.uniform(0, 0.002))


def writers(folder: Path, chance: random.Random) -> Any:
    """Two processes that have read one file save at once: one of them receives the error that the other was first."""
    path, outcomes = folder / "fish.json", []
    mine = [a_document(100 + k) for k in range(2)]
    for number in range(ROUNDS["writers"]):
        write_deformation(a_document(number, 40), path)
        ready = [os.pipe() for _ in range(2)]
        start, result = os.pipe(), os.pipe()

        def work(k: int, start: Any = start, ready: Any = ready, result: Any = result) -> None:
            known = KnownFiles()
            known.remember(path, read_document(path)[1])
            os.write(ready[k][1], b".")
            os.read(start[0], 1)
            try:
                write_deformation(mine[k], path, known=known, overwrite=False)
                os.write(result[1], b"%d" % k)
            except FileChangedError:
                os.write(result[1], b"r")

        pids = [fork(lambda k=k: work(k)) for k in range(2)]
        for reader, _ in ready:
            os.read(reader, 1)
        os.write(start[1], b"..")
        for pid in pids:
            os.waitpid(pid, 0)
        told = os.read(result[0], 10).decode()
        winner = told.replace("r", "")
        outcomes.append(len(told) == 2 and len(winner) == 1 and read_deformation(path) == mine[int(winner)])
        for pipe in (*ready, start, result):
            os.close(pipe[0])
            os.close(pipe[1])
    return {"outcomes": outcomes, "left": listing(folder)}


def pairs(folder: Path, chance: random.Random) -> Any:
    """Kill a process while one volume after the other is written over a header with detached voxels.

    First before every single operation on a name in the folder, then at random moments. Each volume's spacing marks
    its voxels: a header with the voxels of another is detected.
    """
    wrong, most, found = [], 0, set()
    for suffix in (".mhd", ".nhdr"):
        path = folder / f"fish{suffix}"
        write_volume(_volume(1), path)

        def check(when: str, path: Path = path) -> None:
            nonlocal most
            volume = read_volume(path)
            number = int(volume.grid.spacing[0])
            found.add(number)
            if not np.array_equal(volume.values, _volume(number).values):
                wrong.append(f"{path.name} {when}")
            most = max(most, len(listing(folder)))

        for count in range(1, 60):
            pid = fork(lambda count=count, path=path: (_die_before(count, folder), write_volume(_volume(2), path)))
            is_done = os.WIFEXITED(os.waitpid(pid, 0)[1])
            check(f"before operation {count}")
            write_volume(_volume(1), path)
            if is_done:
                break
        assert count > 4, count  # both files were opened and renamed at least

        def work(path: Path = path) -> None:
            while True:
                for number in range(1, 5):
                    write_volume(_volume(number), path)

        for k in range(ROUNDS["pairs"]):
            kill_after(fork(work), chance.uniform(0.005, 0.06))
            check(f"killed {k}")
        write_volume(_volume(3), path)
    return {"wrong": wrong, "found": len(found), "most": most, "left": listing(folder)}


def _volume(number: int) -> Volume:
    values = np.random.default_rng(number).integers(0, 255, (20, 30, 40)).astype(np.uint8)
    return Volume(values, Grid((20, 30, 40), (float(number), 1.0, 1.0)), "marked")


def _die_before(count: int, folder: Path) -> None:
    """Have this process killed before the operation of this number on a name in a folder."""
    left = count

    def hook(event: str, given: tuple[Any, ...]) -> None:
        nonlocal left
        if event in ("open", "os.rename", "os.remove") and str(folder) in str(given[0]):
            left -= 1
            if left == 0:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)


def full(folder: Path, chance: random.Random) -> Any:
    """On a disk of 64 kB: a document that does not fit, then one that does; the same with a session's own file."""
    path, told, said = folder / "fish.json", [], []
    small, large = a_document(1, 20), a_document(2, 600)
    write_deformation(small, path)
    for attempt in range(3):
        try:
            write_deformation(large, path)
        except DeformError as error:
            said.append(str(error))
        assert read_deformation(path) == small, attempt
    session = Session(a_volume())
    saving = Autosave(session, folder / "state", 0.01, on_trouble=told.append)
    strengths = [0.5]
    session.editing.change(strength=0.5)
    saving.flush()
    (folder / "filler").write_bytes(b"")
    with suppress(OSError), (folder / "filler").open("wb", buffering=0) as filler:
        while True:
            filler.write(bytes(512))
    for strength in (0.6, 0.7):
        session.editing.change(strength=strength)  # editing continues
        saving.flush()
        strengths.append(restore(saved_sessions(session.volume, folder / "state", every=True)[0]).steps[0].strength)
    try:
        session.save(path, overwrite=True)
    except DeformError as error:
        said.append(str(error))
    assert read_deformation(path) == small
    left = listing(folder)
    (folder / "filler").unlink()
    session.editing.change(strength=0.8)
    saving.flush()
    strengths.append(restore(saved_sessions(session.volume, folder / "state", every=True)[0]).steps[0].strength)
    session.save(path, overwrite=True)
    assert read_deformation(path).steps == session.editing.deformation.steps
    saving.close()
    return {"said": said, "told": told, "strengths": strengths, "left": left, "after": listing(folder)}


def ends(folder: Path, chance: random.Random) -> Any:
    """Edit and exit, as a program or a kernel that is shut down; nothing is closed or waited for."""
    session = Session(a_volume())
    saving = Autosave(session, folder, 60.0)
    session.editing.change(strength=chance.uniform(0.1, 0.9))
    globals().update(_kept=session, _kept_by=saving)  # as in a notebook
    return session.editing.step.strength


def lost(folder: Path, chance: random.Random) -> Any:
    """Edit, wait until it is written, report its state, and die."""
    session = Session(a_volume())
    written: list[Any] = []
    Autosave(session, folder, 0.05, on_written=written.append)
    for _ in range(5):
        place = np.array([chance.uniform(0.5, 6.5), chance.uniform(0.5, 4.5)])
        session.editing.edit_points(session.editing.points.add(place, place + chance.uniform(0.01, 0.1)))
    session.set_view("+z")
    while not written or written[-1].steps < 2 or written[-1].points < 13:
        time.sleep(0.01)
    sys.stdout.write(
        json.dumps([m.target.tolist() for step in session.editing.deformation.steps for m in step.maps]) + "\n"
    )
    sys.stdout.flush()
    os.kill(os.getpid(), signal.SIGKILL)
    return None


if __name__ == "__main__":
    found = {f.__name__: f for f in (save, autosave, writers, pairs, full, lost, ends)}[sys.argv[1]](
        Path(sys.argv[2]), random.Random(int(sys.argv[3]))
    )
    sys.stdout.write(json.dumps(found) + "\n")

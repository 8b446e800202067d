"""Recovery: the offers when a volume is opened again, and their commands."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from studio_driver import crash, wait_for
from waiting import PATIENCE

from deformnb.errors import DeformError
from deformnb.session import autosave
from deformnb.session.autosave import Recovery
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume


def a_volume(seed: int = 0) -> Volume:
    values = np.random.default_rng(seed).integers(0, 255, (6, 7, 8)).astype(np.uint8)
    return Volume(values, Grid((6, 7, 8)), "noise")


def lose(strength: float = 0.5, points: int = 5) -> Session:
    """A session that ends without being saved or closed."""
    session = Session(a_volume())
    saving = autosave.Autosave(session)
    session.editing.change(strength=strength)
    for k in range(points - 4):
        session.editing.edit_points(session.editing.points.add([2.0 + k, 2.5], [2.0 + k, 3.0 + k / 7]))
    session.set_view("+z")
    crash(saving)
    return session


def open_recovery(session: Session | None = None, **options: Any) -> Recovery:
    made = Recovery(session or Session(a_volume()), **options)
    assert made.ready.wait(PATIENCE)
    return made


def test_nothing_is_offered_where_nothing_was_lost() -> None:
    lose()
    for session in (Session(a_volume(1)),):
        recovery = open_recovery(session)
        assert recovery.offer == ""
        recovery.act("restore")
        assert session.editing.history["undo"] == ""
        recovery.autosave.close()


def test_what_was_lost_comes_back_exactly_and_can_be_undone() -> None:
    lost = lose(points=5)
    told: list[str] = []
    recovery = open_recovery(report=told.append)
    session = recovery.session
    first = session.editing.deformation
    assert recovery.offer.startswith("An edit of ")
    assert recovery.offer.endswith(" was not saved (9 points, 2 steps).")
    recovery.act("restore")
    assert session.editing.deformation.steps == lost.editing.deformation.steps
    assert session.editing.index == lost.editing.index
    assert recovery.offer == ""
    assert told == []
    assert session.editing.undo().startswith("restore the edit of ")
    assert session.editing.deformation == first
    session.editing.redo()
    recovery.autosave.flush()
    assert recovery.written
    crash(recovery.autosave)
    again = open_recovery()
    assert len(again.lost) == 1  # the one that went on, and not the first one too
    again.autosave.close()


def test_the_newest_is_offered_first_and_each_is_skipped_or_deleted_once() -> None:
    for k in range(3):
        lose(points=5 + k)
    changes: list[int] = []
    recovery = open_recovery(changed=lambda: changes.append(1))
    assert "(11 points, 2 steps). 2 older edits follow." in recovery.offer
    recovery.act("skip")
    assert "(10 points, 2 steps). 1 older edit follows." in recovery.offer
    recovery.act("delete")
    assert recovery.offer.endswith("(9 points, 2 steps).")
    assert len(changes) == 3
    recovery.autosave.close()
    again = open_recovery()
    assert again.offer.endswith("(9 points, 2 steps).")
    again.act("delete")
    assert again.offer == ""
    with pytest.raises(DeformError, match="choose one of restore, skip, delete"):
        again.act("rm -rf")
    again.autosave.close()


def test_a_damaged_one_is_said_and_the_next_is_offered() -> None:
    lose(points=5)
    lose(points=6)
    recovery = open_recovery()
    whole = recovery.lost[0].path.read_bytes()
    recovery.lost[0].path.write_bytes(whole[:-20])
    before = recovery.session.editing.deformation
    with pytest.raises(DeformError, match="not complete JSON"):
        recovery.act("restore")
    assert recovery.session.editing.deformation is before
    assert recovery.offer.endswith("(9 points, 2 steps).")
    recovery.autosave.close()


def test_a_document_that_was_made_on_another_volume_is_spoken_of() -> None:
    told: list[str] = []
    document = lose().document()
    fitting = open_recovery(Session(a_volume(), document), report=told.append)
    assert told == []
    other = open_recovery(Session(a_volume(1), document), report=told.append)
    wait_for(lambda: told)
    assert "another volume ('noise', 8 x 7 x 6 voxels)" in told[0]
    fitting.autosave.close()
    other.autosave.close()

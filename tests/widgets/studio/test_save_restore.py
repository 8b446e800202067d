"""The bar of lost sessions and the studio that shows it, without a browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from front_end import deliver
from studio_driver import a_drag, a_volume, act, crash, drag, get_notice, panel, wait_for
from uploads import upload_file
from waiting import PATIENCE

from deformnb.session.autosave import saved_sessions
from deformnb.session.session import Session
from deformnb.volume.volume import Volume
from deformnb.widgets import Studio, cell_widgets


@pytest.fixture(autouse=True)
def _last_file_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """A user who closes a studio waits for a second only, and a busy machine may take longer to write."""
    monkeypatch.setattr("deformnb.session.autosave._WAIT_AT_CLOSE", PATIENCE)


def studio_of(volume: Volume | None = None, **options: Any) -> Studio:
    studio = Studio(volume or a_volume(), side="+y", **options)
    assert studio.parts.bar.recovery.ready.wait(PATIENCE)
    return studio


def click(studio: Studio, what: Any, version: Any = None) -> None:
    bar = studio.parts.bar
    deliver(bar, {"type": "act", "what": what, "version": bar.version if version is None else version})


@pytest.fixture
def lost() -> Any:
    """The state of a studio whose kernel was killed."""
    studio = studio_of()
    drag(studio, a_drag(studio))
    steps = studio.deformation.steps
    crash(studio.parts.bar.recovery.autosave)
    studio.close()
    return steps


def test_the_bar_offers_what_was_lost_and_restores_it(lost: Any) -> None:
    studio = studio_of()
    wait_for(lambda: studio.parts.bar.offer)
    assert studio.children[1] is studio.parts.bar  # behind the file input, which takes no room
    assert studio.parts.bar.offer.endswith("was not saved (5 points, 1 step).")
    click(studio, "restore")
    assert studio.deformation.steps == lost
    assert studio.editor.points == lost[0].points
    assert studio.parts.bar.offer == ""
    studio.undo()
    assert len(studio.editor.points) == 4
    studio.close()


def test_old_and_wrong_messages_are_dropped(lost: Any) -> None:
    studio = studio_of()
    wait_for(lambda: studio.parts.bar.offer)
    for what, version in (("restore", studio.parts.bar.version - 1), ("rm", None), (["restore"], None), (None, None)):
        click(studio, what, version)
    deliver(studio.parts.bar, ["restore"])
    studio.parts.bar.set_state({"offer": "pay here"})
    assert "was not saved" in studio.parts.bar.offer
    assert len(studio.editor.points) == 4
    studio.close()


def test_trouble_of_writing_is_said_in_the_studio(state_folder: Path) -> None:
    (state_folder / "sessions").write_text("in the way", encoding="utf-8")
    studio = studio_of()
    drag(studio, a_drag(studio))
    studio.parts.bar.recovery.autosave.flush()
    wait_for(lambda: "save the session yourself" in get_notice(studio))
    assert len(studio.editor.points) == 5
    studio.close()


def test_a_cell_that_runs_again_keeps_what_its_studio_held_in_the_history(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = iter([("cell", "one"), ("cell", "two")])
    monkeypatch.setattr(cell_widgets, "_cell_and_run", lambda: next(runs))
    first = studio_of()
    drag(first, a_drag(first))
    held = first.deformation.steps
    second = studio_of()
    assert first.parts.worker.is_closed
    assert second.parts.bar.offer == ""
    go_back(second)
    assert second.deformation.steps == held
    second.undo()
    assert len(second.editor.points) == 4
    second.close()


def go_back(studio: Studio) -> None:
    """Choose the last row of the history."""
    history = panel(studio, "History")
    history.handle_visibility(True)
    assert history.items.rows[-1]["title"] == "an earlier session, not saved: 5 points, 1 step"
    act(history.items, "choose", len(history.items.rows) - 1)


def test_a_studio_that_is_closed_offers_nothing_and_the_history_has_it() -> None:
    studio = studio_of()
    drag(studio, a_drag(studio))
    studio.close()
    assert saved_sessions(a_volume()) == []
    assert [entry.state for entry in saved_sessions(a_volume(), every=True)] == ["closed"]
    again = studio_of()
    assert again.parts.bar.offer == ""
    go_back(again)
    assert len(again.editor.points) == 5
    again.close()


def test_the_files_panel_asks_before_it_opens_or_writes_over(tmp_path: Path) -> None:
    studio = studio_of(folder=tmp_path)
    files = panel(studio, "Export")
    drag(studio, a_drag(studio))
    other = Session(Volume(a_volume().values // 2, a_volume().grid, "half"))
    other.editing.change(strength=0.25)
    other.save(tmp_path / "half.json")
    opening, content = panel(studio, "Open"), (tmp_path / "half.json").read_bytes()
    upload_file(opening.box, "half.json", content)
    assert opening.question.box.is_visible
    assert "another volume (&#x27;half" in opening.question.text
    assert studio.session.editing.step.strength == 1.0
    opening.question.box.children[-1].click()
    assert not opening.question.box.is_visible
    assert opening.question.box.children == ()  # no question
    assert studio.session.editing.step.strength == 1.0
    upload_file(opening.box, "half.json", content)
    opening.question.box.children[1].click()
    assert studio.session.editing.step.strength == 0.25
    assert studio.undo() is None

    files.name.value = "mine.json"
    files.write.click()
    wait_for(lambda: files.writing.message.value.startswith("Wrote mine.json"))
    assert studio.session.files.saved is not None
    mine = (tmp_path / "mine.json").read_bytes()
    other.save(tmp_path / "mine.json", overwrite=True)
    files.write.click()
    wait_for(lambda: files.writing.question.box.is_visible)
    wait_for(lambda: not files.write.disabled)
    assert "changed by someone else" in files.writing.question.text
    assert (tmp_path / "mine.json").read_bytes() != mine
    files.writing.question.box.children[1].click()
    wait_for(lambda: (tmp_path / "mine.json").read_bytes() == mine)
    studio.close()

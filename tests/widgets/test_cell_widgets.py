"""Widgets of a cell that runs again: what earlier runs have made is closed, and leaves nothing."""

from __future__ import annotations

import gc
import weakref
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from waiting import PATIENCE, Threads, wait_for

from deformnb.errors import DeformError
from deformnb.session.autosave import restore, saved_sessions
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets import Studio, cell_widgets
from deformnb.widgets.cell_widgets import owned_widgets
from deformnb.widgets.editor.space_editor import SpaceEditor
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.view.volume_view import VolumeView

GRID = Grid((8, 10, 12))


def a_volume() -> Volume:
    return Volume(np.indices(GRID.shape, np.uint8).sum(axis=0, dtype=np.uint8), GRID, "ramp")


class Cell:
    """The cell that runs, and which run of it that is."""

    def __init__(self) -> None:
        self.name, self.count = "cell", 1

    def again(self, name: str = "cell") -> None:
        """This cell runs, with a separate id for each run."""
        self.name, self.count = name, self.count + 1


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch) -> Cell:
    running = Cell()
    monkeypatch.setattr("deformnb.widgets.cell_widgets._cell_and_run", lambda: (running.name, str(running.count)))
    monkeypatch.setattr(cell_widgets, "CELL_WIDGETS", defaultdict(cell_widgets.CELL_WIDGETS.default_factory))
    return running


def a_volume_view() -> VolumeView:
    made = VolumeView(a_volume(), method="core", width=64, height=64)
    made.still((32, 24))  # a scene, and a thread
    return made


def a_live_view() -> LiveView:
    made = LiveView(a_volume())
    deliver(made, {"type": "still", "view": "page"})  # it is drawn by a scene of VTK's or the core's
    return made


def a_space_editor() -> SpaceEditor:
    made = SpaceEditor(a_volume())
    made.sender.worker.call(lambda: None).result(PATIENCE)
    return made


MAKERS = (a_volume_view, a_live_view, a_space_editor)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("make", MAKERS, ids=lambda make: make.__name__)
def test_ten_runs_leave_one_widget_and_its_threads(cell: Cell, make: Callable[[], Any]) -> None:
    threads, first = Threads(), make()
    one, made = len(threads.alive), [first]
    for _ in range(9):
        cell.again()
        made.append(make())
    wait_for(lambda: len(threads.alive) <= one)
    assert [widget.comm is None for widget in made] == [True] * 9 + [False]
    gone = [weakref.ref(widget) for widget in made[:-1]]
    last = made[-1]
    del made, first
    wait_for(lambda: gc.collect() >= 0 and not any(reference() for reference in gone))
    last.close()


def test_results_that_ipython_stores_do_not_hold_what_is_closed(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    from IPython.core.interactiveshell import InteractiveShell

    make_shell: Any = InteractiveShell  # which has no types
    shell = make_shell()
    shell.user_ns["make"] = a_live_view
    monkeypatch.setattr("IPython.get_ipython", lambda: shell)
    gone: list[weakref.ref[Any]] = []
    for _ in range(3):
        cell.again()
        shell.run_cell("made = make()\nmade", store_history=True)
        gone.append(weakref.ref(shell.user_ns["made"]))
        wait_for(lambda: gc.collect() >= 0 and not any(value() for value in gone[:-1]))
    shell.run_cell("7 * 6", store_history=True)
    assert shell.user_ns["_"] == 6 * 7
    assert list(shell.user_ns["Out"]) == [3, 4]
    shell.user_ns["made"].close()
    shell.reset()
    shell.history_manager.end_session()


def test_widgets_of_one_run_and_of_other_cells_and_kinds_stay(cell: Cell) -> None:
    a, b = LiveView(a_volume()), LiveView(a_volume())
    editor = SpaceEditor(a_volume())
    cell.again("another cell")
    c = LiveView(a_volume())
    cell.again()
    assert [widget.comm is not None for widget in (a, b, c, editor)] == [True] * 4
    d = LiveView(a_volume())
    assert [widget.comm is not None for widget in (a, b, c, d, editor)] == [False, False, True, True, True]
    for widget in (c, d, editor):
        widget.close()


def test_who_cannot_have_a_new_view_keeps_the_one_of_before(cell: Cell) -> None:
    view = VolumeView(a_volume(), method="core")
    cell.again()
    with pytest.raises(DeformError, match="unknown transfer function"):
        VolumeView(a_volume(), transfer="no")
    assert view.comm is not None
    view.close()


def test_parts_are_closed_by_their_owner_alone(cell: Cell) -> None:
    with owned_widgets():
        part = LiveView(a_volume())
    cell.again()
    own = LiveView(a_volume())
    assert part.comm is not None
    part.close()
    own.close()


@pytest.mark.parametrize("kind", [LiveView, VolumeView])
def test_a_view_that_a_studio_shows_stays_when_its_own_cell_runs_again(cell: Cell, kind: Any, tmp_path: Path) -> None:
    cell.again("views")
    view = kind(a_volume())
    cell.again("studio")
    studio = Studio(a_volume(), folder=tmp_path, view=view)
    cell.again("views")
    another = kind(a_volume())
    assert view.comm is not None
    cell.again("studio")
    last = Studio(a_volume(), folder=tmp_path, view=another)
    assert view.comm is None  # with the studio that showed it
    assert another.comm is not None
    last.close()
    assert studio.comm is None


@pytest.mark.parametrize("view", ["live", "vtk"])
def test_studios_of_a_cell_leave_one_with_its_threads(cell: Cell, tmp_path: Path, view: str) -> None:
    threads = Threads()
    studio = Studio(a_volume(), folder=tmp_path, view=view)
    for _ in range(3):
        cell.again()
        studio = Studio(a_volume(), folder=tmp_path, view=view)
    wait_for(lambda: len(threads.alive) <= 2)  # its own and that which writes sessions
    studio.close()
    threads.wait()


@pytest.mark.sampled(2)
@pytest.mark.parametrize("view", ["live", "vtk"])
def test_a_studio_that_nobody_closed_has_no_threads_and_its_last_edit_is_written(
    tmp_path: Path, view: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deformnb.widgets.worker._IDLE", 0.01)
    volume, threads = a_volume(), Threads()
    studio = Studio(volume, folder=tmp_path, view=view)
    left = weakref.ref(studio)
    studio.session.editing.change(strength=0.5)
    del studio
    wait_for(lambda: gc.collect() >= 0 and not threads.alive)
    (entry,) = saved_sessions(volume, every=True)
    assert (entry.state, restore(entry).steps[0].strength) == ("open", 0.5)
    kept = left()  # by ipywidgets: a page may show it
    assert kept is not None
    kept.session.editing.change(strength=0.25)
    threads.wait()
    assert restore(entry).steps[0].strength == 0.25
    kept.close()
    del kept
    wait_for(lambda: gc.collect() >= 0 and left() is None)
    threads.wait()

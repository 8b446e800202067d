"""The faults of sessions, exports, page and kernel that were foreseen, each with the tests that hold it.

The numbers are those of the catalogue of faults. What was tested nowhere else is tested here: processes that are
killed, two that write at once, a disk that is full, a folder that goes away.
"""

from __future__ import annotations

import ast
import json
import os
import random
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import crashes
import numpy as np
import pytest
from full_disk import full_disk
from studio_driver import a_drag, a_volume, crash, drag, finish, get_notice, panel, wait_for
from waiting import PATIENCE, Threads

from deformnb.errors import DeformError
from deformnb.rbf.evaluation import capacity
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.session.autosave import Autosave
from deformnb.session.autosave_store import MOST_PER_VOLUME, restore, saved_sessions
from deformnb.session.session import Session
from deformnb.widgets import Studio, cell_widgets

TESTS = Path(__file__).resolve().parent

HELD_BY: dict[int, str] = {
    45: "document/test_json_format: what_is_no_document_is_refused_in_one_sentence, every_truncation_is_refused; "
    "io/test_documents: damaged_files_are_named_with_what_is_wrong, every_cut_is_noticed; "
    "session/test_autosave_recovery: a_damaged_one_is_said_and_the_next_is_offered",
    46: "document/test_json_format: documents_of_every_released_form_stay_readable, "
    "other_versions_are_refused_in_one_sentence, "
    "a_newer_minor_version_is_read_and_its_fields_are_kept",
    47: "document/test_json_format: what_is_no_document_is_refused_in_one_sentence, "
    "nesting_is_bounded_where_it_says_also_in_fields_that_are_only_kept, no_text_ever_raises_anything_else",
    48: "widgets/studio/test_studio: the_files_panel_writes_into_its_folder_only; "
    "io/files/test_atomic: what_stands_in_the_way_is_said; "
    "session/test_autosave_store: a_name_from_a_file_is_kept_short_and_no_path",
    49: "document/test_json_format: a_pickle_is_never_opened; io/test_faults: a_pickle_in_disguise_is_never_opened",
    50: "session/test_session: a_saved_document_comes_back_and_another_volume_is_noticed, "
    "labels_of_the_same_scan_are_no_other_volume; "
    "widgets/studio/test_save_restore: the_files_panel_asks_before_it_opens_or_writes_over; "
    "session/test_autosave_recovery: a_document_that_was_made_on_another_volume_is_spoken_of",
    51: "session/test_session: a_file_that_somebody_else_has_changed_is_not_written_over; "
    "test_faults: of_two_that_write_at_once_one_is_told; "
    "widgets/studio/test_save_restore: the_files_panel_asks_before_it_opens_or_writes_over",
    52: "test_faults: a_full_disk_keeps_the_old_file_and_stops_no_edit, no_more_room_for_a_file_is_said; "
    "io/files/test_atomic: a_disk_that_fills_up_leaves_the_old_file; imaging/test_movie_frames: a_full_disk_is_said",
    53: "test_faults: a_process_killed_while_it_saves_leaves_a_whole_document, "
    "processes_killed_while_they_save_themselves_leave_what_they_had_told, "
    "a_process_killed_while_it_writes_a_header_and_its_voxels_leaves_two_that_belong_together; "
    "io/files/test_atomic: a_killed_program_leaves_the_old_file",
    54: "session/test_exports: what_cannot_be_written_is_said_before_the_work; "
    "io/files/test_atomic: what_stands_in_the_way_is_said; "
    "test_faults: a_folder_that_goes_away_stops_nothing",
    55: "session/test_exports: a_cancelled_export_leaves_nothing; "
    "widgets/studio/test_studio: writing_can_be_cancelled; "
    "io/test_round_trip: progress_ends_at_one_and_cancelling_leaves_nothing; "
    "imaging/test_movie_frames: what_is_cancelled_leaves_nothing",
    56: "session/test_exports: a_result_beyond_the_memory_is_refused_with_numbers; "
    "io/test_faults: a_volume_beyond_the_limit_is_refused_with_numbers_and_a_stride",
    57: "io/test_round_trip: simpleitk_reads_the_same_places; "
    "warping/test_warper: simpleitk_resample_through_a_displacement_field",
    58: "test_faults: points_of_a_killed_process_come_back_exactly; session/test_autosave: "
    "what_was_left_is_lost_and_comes_back_exactly; browser/test_restore_lab: what_a_killed_kernel_held_comes_back",
    60: "widgets/studio/test_studio: an_exception_of_an_observer_is_told_to_the_page; widgets/editor/test_editor: "
    "an_exception_of_a_callback_is_told_the_page; browser/test_hosts: the_exception_of_a_callback_is_seen",
    61: "browser/test_restore_lab: what_a_killed_kernel_held_comes_back",
    62: "browser/test_hosts: the_page_can_be_loaded_again; "
    "browser/test_app_page: a_page_that_is_loaded_again_shows_the_same",
    63: "browser/test_editor_page: two_views_of_one_editor_agree; browser/test_app_page: two_tabs_show_one_session; "
    "../frontend/tests/edits.test.js: windows, views and Python end with the same",
    64: "../frontend/tests/edits.test.js: movements never queue up; "
    "widgets/studio/test_studio: rapid_edits_end_in_the_state_of_the_last; "
    "browser/test_editor_page: edits_on_their_way_are_few_and_the_last_always_arrives",
    65: "widgets/studio/test_studio: an_edit_that_comes_after_the_picture_was_turned_is_dropped; "
    "widgets/vtk/test_render_loop: of_many_changes_the_newest_is_drawn_and_the_last_always; "
    "browser/test_curve_editor_page: old_news_do_not_undo_an_edit",
    66: "session/test_exports: an_export_knows_nothing_of_later_edits; "
    "test_faults: edits_go_on_while_a_movie_is_written",
    67: "widgets/test_worker: the_end_cancels_what_waits_and_comes_behind_the_work_of_now, "
    "without_its_owner_the_thread_ends_and_holds_nothing_of_its_last_job; "
    "widgets/studio/test_studio: a_closed_studio_leaves_nothing",
    68: "test_faults: a_cell_that_runs_again_and_again_keeps_nothing; "
    "browser/test_hosts: twenty_runs_of_the_cell_keep_nothing; "
    "widgets/vtk/test_scene: twenty_scenes_one_after_the_other_leave_no_thread_and_no_window",
    69: "widgets/vtk/test_scene: updates_from_many_threads_are_never_black; "
    "session/test_session: edits_from_many_threads_all_count; "
    "widgets/test_worker: everything_is_done_by_one_thread_in_the_order_in_which_it_came",
    70: "test_faults: edits_go_on_while_a_movie_is_written; "
    "rbf/test_points: a_place_that_is_none_is_refused_and_not_spread",
    71: "session/test_history: thousands_of_edits_take_the_memory_of_two_hundred, "
    "an_edit_after_undo_makes_a_branch_and_the_old_one_stays",
    72: "browser/test_editor_page: two_fingers_zoom_and_one_drags_a_point, nothing_is_clipped; "
    "browser/test_live_view_page: without_webgl_python_draws_and_says_so; "
    "browser/test_faults_page: a_drag_goes_where_the_hand_goes_from_right_to_left_and_enlarged",
    73: "volume/test_transfer: wrong_colours_are_refused_by_name, wrong_opacities_are_refused_by_name; "
    "session/test_session: colours_belong_to_the_composite_picture_only",
    74: "volume/test_transfer: numbers_beyond_0_to_1_are_clipped_and_said_once",
    75: "test_faults: a_new_point_compiles_nothing; rbf/test_interpolant: padding_never_changes_a_result; "
    "test_jax_compilation: float64_is_local, compiled_functions_are_kept_between_processes",
}
"""By the number of a fault: files of tests and in each what they say, in Python without the word "test"."""


@pytest.mark.parametrize("number", [*range(45, 59), *range(60, 76)])
def test_every_fault_is_held_by_tests_that_exist(number: int) -> None:
    for part in HELD_BY[number].split("; "):
        file, names = part.split(": ")
        if file.endswith(".js"):
            assert names in (TESTS / file).read_text(encoding="utf-8"), f"{file} has no {names}"
            continue
        known = _tests_of(TESTS / f"{file}.py")
        for name in names.split(", "):
            assert f"test_{name}" in known, f"{file} has no {name}"


@cache
def _tests_of(path: Path) -> set[str]:
    return {node.name for node in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(node, ast.FunctionDef)}


# -- processes that are killed -----------------------------------------------------------------------------------------


def started(what: str, folder: Path, seed: int = 1) -> subprocess.Popen[str]:
    paths = os.pathsep.join([str(TESTS.parent), str(TESTS)])
    return subprocess.Popen(
        [sys.executable, str(TESTS / "crashes.py"), what, str(folder), str(seed)],
        text=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": paths},
    )


def run_victim(what: str, folder: Path) -> Any:
    child = started(what, folder)
    try:
        out, _ = child.communicate(timeout=120)
    finally:
        child.kill()
        child.wait()
    assert child.returncode == 0
    return json.loads(out)


posix = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are copied and killed as on POSIX")


@posix
def test_a_process_killed_while_it_saves_leaves_a_whole_document(tmp_path: Path) -> None:
    found = run_victim("save", tmp_path)  # it reads the file after each of many kills, and fails where it is not whole
    assert found["found"] > 1
    assert found["most"] <= 2  # the file, and what one killed writer has left
    assert found["left"] == ["fish.json"]


@pytest.mark.nightly
@posix
def test_a_process_killed_while_it_writes_a_header_and_its_voxels_leaves_two_that_belong_together(
    tmp_path: Path,
) -> None:
    found = run_victim("pairs", tmp_path)  # it reads them after each of many kills
    assert found["wrong"] == []
    assert found["found"] > 1
    assert found["most"] <= 9  # two of the other kind, a header, four data files at most, what one writer has left
    assert [name.split(".")[1] for name in found["left"]] == ["mhd", "mhd", "nhdr", "nhdr"]


@pytest.mark.nightly
@posix
def test_processes_killed_while_they_save_themselves_leave_what_they_had_told(tmp_path: Path) -> None:
    chance = random.Random(3)
    children = [started("autosave", tmp_path, seed) for seed in range(3)]
    newest: list[int] = []
    try:
        for child in children:
            assert child.stdout is not None
            first = child.stdout.readline()
            time.sleep(chance.uniform(0, 0.3))
            child.kill()
            newest.append(int([first, *child.stdout.read().split("\n")[:-1]][-1]))
            child.wait()
    finally:
        for child in children:
            child.kill()
            child.communicate()
    volume = crashes.a_volume()
    entries = {int(entry.path.name.split("-")[1]): entry for entry in saved_sessions(volume, tmp_path)}
    assert set(entries) == {child.pid for child in children}
    for child, known in zip(children, newest, strict=True):
        assert round(restore(entries[child.pid]).steps[0].strength * 1e6) >= known
    session = Session(volume)
    saving = Autosave(session, tmp_path)
    session.editing.change(strength=0.5)
    crash(saving)
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".json"] * 4  # no litter stays
    assert len(children) < MOST_PER_VOLUME


@posix
def test_points_of_a_killed_process_come_back_exactly(tmp_path: Path) -> None:
    child = started("lost", tmp_path)
    try:
        out, _ = child.communicate(timeout=120)
    finally:
        child.kill()
        child.wait()
    assert child.returncode == -9
    (entry,) = saved_sessions(crashes.a_volume(), tmp_path)
    assert (entry.points, entry.steps) == (13, 2)
    assert [m.target.tolist() for step in restore(entry).steps for m in step.maps] == json.loads(out)  # to the last bit


def test_a_process_that_ends_by_itself_offers_nothing_and_keeps_its_last_edit(tmp_path: Path) -> None:
    strength = run_victim("ends", tmp_path)
    assert saved_sessions(crashes.a_volume(), tmp_path) == []
    (entry,) = saved_sessions(crashes.a_volume(), tmp_path, every=True)
    assert (entry.state, entry.is_earlier) == ("closed", True)
    assert restore(entry).steps[0].strength == strength


@pytest.mark.nightly
@posix
def test_a_kernel_that_is_shut_down_or_restarted_offers_nothing_and_one_that_is_killed_does(tmp_path: Path) -> None:
    manager = pytest.importorskip("jupyter_client.manager")
    work = (
        "import sys; sys.path[:0] = [%r, %r]; import crashes; from pathlib import Path\n"
        "crashes.ends(Path(%r), crashes.random.Random(%d))"
    )
    states = []
    for number, end in enumerate(("shut down", "restarted", "killed")):
        kernel, client = manager.start_new_kernel(kernel_name="python3")
        try:
            folder = tmp_path / end
            client.execute_interactive(work % (str(TESTS.parent), str(TESTS), str(folder), number), timeout=120)
            if end == "killed":
                client.execute("import os, signal; crashes._kept_by.flush(); os.kill(os.getpid(), signal.SIGKILL)")
                kernel.provisioner.process.wait(60)
            elif end == "restarted":
                kernel.restart_kernel()
        finally:
            client.stop_channels()
            kernel.shutdown_kernel()
        (entry,) = saved_sessions(crashes.a_volume(), folder, every=True)
        states.append((end, entry.state, entry.is_lost))
    assert states == [("shut down", "closed", False), ("restarted", "closed", False), ("killed", "open", True)]


@pytest.mark.nightly
@posix
def test_of_two_that_write_at_once_one_is_told(tmp_path: Path) -> None:
    found = run_victim("writers", tmp_path)
    assert found["outcomes"] == [True] * crashes.ROUNDS["writers"]
    assert found["left"] == ["fish.json"]


# -- disks and folders -------------------------------------------------------------------------------------------------


@posix
def test_a_full_disk_keeps_the_old_file_and_stops_no_edit(tmp_path: Path) -> None:
    mount = f'mount -t tmpfs -o size=64k tmpfs "{tmp_path}"'
    private = ["unshare", "--mount", "--map-root-user", "sh", "-c"]
    if shutil.which("unshare") is None or subprocess.call([*private, mount], stderr=subprocess.DEVNULL):
        pytest.skip("a small disk of its own needs unshare and user namespaces")
    paths = os.pathsep.join([str(TESTS.parent), str(TESTS)])
    command = f'{mount} && exec "{sys.executable}" "{TESTS / "crashes.py"}" full "{tmp_path}" 1'
    done = subprocess.run(
        [*private, command],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env={**os.environ, "PYTHONPATH": paths},
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert len(found["said"]) == 4
    assert all("is full; an older file of this name is untouched" in words for words in found["said"])
    assert len(found["told"]) == 1  # of three edits
    assert "save the session yourself" in found["told"][0]
    assert found["strengths"] == [0.5, 0.5, 0.5, 0.8]  # what was written before the disk was full, and then again
    assert found["left"] == ["filler", "fish.json", "state"]
    assert found["after"] == ["fish.json", "state"]


def test_no_more_room_for_a_file_is_said(tmp_path: Path) -> None:
    session = Session(crashes.a_volume())
    session.save(tmp_path / "fish.json")
    before = (tmp_path / "fish.json").read_bytes()
    troubles: list[str] = []
    saving = Autosave(session, tmp_path / "state", 0.01, on_trouble=troubles.append)
    with full_disk(500):
        session.editing.change(strength=0.5)
        saving.flush()
        with pytest.raises(DeformError, match="is full; an older file of this name is untouched"):
            session.save(tmp_path / "fish.json")
    assert len(troubles) == 1
    assert (tmp_path / "fish.json").read_bytes() == before
    session.save(tmp_path / "fish.json")
    finish(saving)
    assert [entry.state for entry in saved_sessions(session.volume, tmp_path / "state", every=True)] == ["saved"]


def test_a_folder_that_goes_away_stops_nothing(tmp_path: Path, state_folder: Path) -> None:
    (tmp_path / "work").mkdir()
    studio = Studio(a_volume(), side="+y", folder=tmp_path / "work")
    files = panel(studio, "Export")
    studio.save(tmp_path / "work" / "a.json")
    studio.parts.bar.recovery.autosave.flush()  # nothing is written into the folder while it goes away
    shutil.rmtree(tmp_path / "work")
    shutil.rmtree(state_folder)
    drag(studio, a_drag(studio))
    with pytest.raises(DeformError, match="there is no folder"):
        studio.save(tmp_path / "work" / "a.json")
    files.name.value = "ball.nrrd"
    files.write.click()
    wait_for(lambda: "there is no folder" in get_notice(studio))
    wait_for(lambda: not files.write.disabled)
    drag(studio, a_drag(studio, 3.0))
    assert len(studio.editor.points) == 5
    studio.parts.bar.recovery.autosave.flush()
    assert len(saved_sessions(a_volume(), every=True)) == 1
    studio.close()


# -- page and kernel ---------------------------------------------------------------------------------------------------


def test_edits_go_on_while_a_movie_is_written(tmp_path: Path) -> None:
    studio = Studio(a_volume(), side="+y", folder=tmp_path)
    files = panel(studio, "Export")
    continues_map = threading.Event()
    files.writing.bar.observe(lambda _: continues_map.wait(PATIENCE), "value")  # which the other thread moves
    drag(studio, a_drag(studio))
    files.name.value = "ball.nrrd"
    files.write.click()
    before = studio.result().values
    drag(studio, a_drag(studio, 4.0))  # taken in this thread, while the other waits in the midst of its work
    assert files.write.disabled
    assert not np.array_equal(studio.result().values, before)
    continues_map.set()
    wait_for(lambda: not files.write.disabled)
    from deformnb.io.volumes.formats import read_volume

    assert np.array_equal(read_volume(tmp_path / "ball.nrrd").values, before)
    studio.close()


@pytest.mark.nightly
def test_a_cell_that_runs_again_and_again_keeps_nothing(monkeypatch: pytest.MonkeyPatch, state_folder: Path) -> None:
    run = [0]
    monkeypatch.setattr(cell_widgets, "_cell_and_run", lambda: ("again", str(run[0])))
    threads = Threads()
    for run[0] in range(5):
        studio = Studio(a_volume(), side="+y")
        assert studio.parts.bar.recovery.ready.wait(PATIENCE)
        drag(studio, a_drag(studio, 1.0 + run[0]))
        studio.wait()
    wait_for(lambda: len(threads.alive) <= 2)  # its own and that which writes sessions
    studio.close()
    threads.wait()
    assert len(list((state_folder / "sessions").glob("*.json"))) == 5
    assert list((state_folder / "sessions").glob("*.live")) == []


def test_a_new_point_compiles_nothing(caplog: pytest.LogCaptureFixture) -> None:
    import jax

    rng = np.random.default_rng(0)

    def fitted(count: int) -> Callable[..., Any]:
        places = rng.uniform(0, 50, (count, 2))
        return fit_rbf(
            ControlPoints.from_arrays(places, places + rng.normal(0, 1, places.shape)),
            kernel="wendland_c2",
            trend="affine",
            support=40.0,
        )

    line = np.linspace(0, 50, 33)
    rows, columns = np.stack([line, 0 * line]), np.stack([0 * line, line])
    fitted(9).lattice_values(rows, columns, 1.0)
    assert capacity(9) == capacity(16) == 16
    with jax.log_compiles(), caplog.at_level("WARNING"):
        for count in range(10, 17):
            fitted(count).lattice_values(rows, columns, 1.0)
    assert [record.message for record in caplog.records if "ompil" in record.message] == []

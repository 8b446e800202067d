"""Faults in a studio: they are reported in the front end, nothing is lost, and work can continue."""

from __future__ import annotations

import gc
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import ipywidgets as ipw
import numpy as np
import pytest
from front_end import deliver
from studio_driver import a_drag, a_volume, controls, drag, get_notice, get_status, open_widgets, panel, wait_for, walk
from traitlets import TraitError
from uploads import upload_file
from waiting import PATIENCE, Threads

from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.session.pictures import Pictures
from deformnb.widgets import LiveView, Studio
from deformnb.widgets.image_encoding import PREVIEW_SIZE, from_png
from deformnb.widgets.studio.controls import Panel, fill
from deformnb.widgets.studio.head import StudioHead
from deformnb.widgets.studio.sync import latency_text


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[Studio]:
    made = Studio(a_volume(), folder=tmp_path)
    made.wait()
    yield made
    made.close()


# -- a studio that cannot be made --------------------------------------------------------------------------------------


@pytest.mark.sampled(4)
@pytest.mark.parametrize(
    "wrong",
    [
        {"view": "hologram"},
        {"side": "+w"},
        {"transfer": "no such preset"},
        {"method": "cubist"},
        {"deformation": "none.json"},
        {"labels": np.zeros((3, 3, 3))},
        {"target": np.zeros(7)},
    ],
)
def test_who_cannot_have_a_new_studio_keeps_the_one_of_before(
    wrong: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = ["cell", "1"]
    monkeypatch.setattr("deformnb.widgets.cell_widgets._cell_and_run", lambda: tuple(run))
    good = Studio(a_volume(), folder=tmp_path)
    good.wait()
    gc.collect()
    widgets, threads = open_widgets(), Threads()
    run[1] = "2"
    with pytest.raises((DeformError, OSError, TraitError)):
        Studio(a_volume(), folder=tmp_path, **wrong)
    assert open_widgets() <= widgets
    threads.wait()
    drag(good, a_drag(good))
    assert good.stats()["edits"] == 1
    run[1] = "3"
    Studio(a_volume(), folder=tmp_path).close()
    assert good.parts.worker.is_closed


def test_a_studio_that_fails_at_its_last_part_ends_all_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    view = LiveView(a_volume())
    gc.collect()
    widgets, threads = open_widgets(), Threads()

    def fails(*_given: Any, **_more: Any) -> None:
        raise ZeroDivisionError("the last part")

    monkeypatch.setattr(LiveView, "follow", fails)
    for shown in ("live", view):
        with pytest.raises(ZeroDivisionError, match="the last part"):
            Studio(a_volume(), folder=tmp_path, view=shown)
        assert open_widgets() <= widgets  # the view of one's own among them, still open
        threads.wait()
    assert view.comm is not None
    view.close()


def test_others_still_hear_of_widgets(tmp_path: Path) -> None:
    heard: list[str] = []
    ipw.Widget.on_widget_constructed(lambda made: heard.append(type(made).__name__))
    try:
        Studio(a_volume(), folder=tmp_path).close()
        ipw.Label("after it").close()
    finally:
        ipw.Widget.on_widget_constructed(None)
    assert "Studio" in heard
    assert heard[-3:].count("Label") == 1


def test_a_view_of_ones_own_goes_from_studio_to_studio(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = ["cell", "1"]
    monkeypatch.setattr("deformnb.widgets.cell_widgets._cell_and_run", lambda: tuple(run))
    view = LiveView(a_volume())
    first = Studio(a_volume(), folder=tmp_path, view=view)
    run[1] = "2"
    second = Studio(a_volume(), folder=tmp_path, view=view)
    assert first.parts.worker.is_closed
    assert second.view is view
    assert view.comm is not None
    assert view.editor is second.editor
    second.close()


# -- a picture that cannot be made -------------------------------------------------------------------------------------


def test_a_picture_that_cannot_be_made_leaves_two_ways_on(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    drag(studio, a_drag(studio))
    before = studio.session.steps.view
    assert not studio.parts.picture.ways_on.is_visible
    is_poor = [True]
    make = Pictures.automatic_picture

    def picture(pictures: Pictures, *given: Any) -> Any:
        if is_poor[0]:
            raise MemoryError("no room for a picture")
        return make(pictures, *given)

    monkeypatch.setattr(Pictures, "automatic_picture", picture)
    controls(studio)["Side"].value = "+z"
    studio.wait()
    reason, again, back = studio.parts.picture.ways_on.children
    assert "no room for a picture" in reason.value
    assert "could not be made" in studio.editor.waiting  # no gesture on the old one
    assert studio.parts.picture.ways_on.is_visible
    assert studio.editor.picture.plane != studio.session.editing.plane
    again.click()  # it fails once more
    studio.wait()
    assert "no room" in reason.value
    assert studio.parts.picture.ways_on.is_visible
    back.click()  # to the picture that is still shown
    studio.wait()
    assert studio.session.steps.view == before
    assert "Undone" in get_notice(studio)
    assert (studio.editor.waiting, studio.parts.picture.ways_on.is_visible) == ("", False)
    studio.redo()
    studio.wait()
    assert "no room" in reason.value
    is_poor[0] = False
    again.click()
    studio.wait()
    assert (studio.editor.waiting, studio.parts.picture.ways_on.is_visible) == ("", False)
    assert reason.value == ""
    assert studio.editor.picture.plane == studio.session.editing.plane
    count = studio.stats()["late"]
    drag(studio, a_drag(studio))
    assert studio.stats()["late"] == count
    assert studio.session.editing.points == studio.editor.points


# -- what fails unseen -------------------------------------------------------------------------------------------------


def test_what_fails_in_the_studios_thread_is_said(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_given: Any) -> None:
        raise FloatingPointError("of the status line")

    with monkeypatch.context() as patched:
        patched.setattr("deformnb.widgets.studio.sync.diagnostics_of", fails)
        drag(studio, a_drag(studio))
        studio.wait()
        assert "FloatingPointError: of the status line" in get_notice(studio)
    with monkeypatch.context() as patched:
        patched.setattr(Deformation, "with_step", fails)
        studio.parts.words.show("")
        studio.parts.link.preview(studio.session.editing.step)
        wait_for(lambda: "of the status line" in get_notice(studio))
    drag(studio, a_drag(studio, 1.0))  # and it works
    studio.wait()
    assert "of the status line" not in get_notice(studio)
    assert "5 points, 1 dragged" in get_status(studio)


def test_what_two_threads_show_at_once_is_nobodys_edit(studio: Studio) -> None:
    in_arrange, go_on = threading.Event(), threading.Event()
    edits: list[str] = []

    class Choosing(Panel):
        slow = True

        def arrange(self) -> None:
            if threading.current_thread() is slow:
                in_arrange.set()
                assert go_on.wait(PATIENCE)
                fill(self.menu, [("a", "a"), ("b", "b"), ("c", "c")])  # chooses the first of them

    panel = Choosing(studio.session, lambda action: action() or True)
    panel.menu = panel.add(ipw.Dropdown(options=[("b", "b")], value="b"), lambda: "b", edits.append)
    slow = threading.Thread(target=panel.refresh)
    slow.start()
    assert in_arrange.wait(PATIENCE)
    panel.refresh()  # another thread comes and is done
    go_on.set()
    slow.join(PATIENCE)
    assert edits == []
    assert panel.menu.value == "b"
    panel.menu.value = "c"  # a user
    assert edits == ["c"]


# -- what is measured --------------------------------------------------------------------------------------------------


def test_the_status_line_tells_how_long_edit_and_volume_take(studio: Studio) -> None:
    assert studio.stats()["edit_ms"] is None
    assert "edit" not in get_status(studio)
    drag(studio, a_drag(studio))
    first = studio.stats()["edit_ms"]
    studio.wait()
    assert first > 0
    assert latency_text(first, {}) in get_status(studio)
    controls(studio)["Strength"].value = 2.0
    second = studio.stats()["edit_ms"]
    assert second != first  # a slider edits as well
    controls(studio)["Compare"].value = "original"  # and this edits nothing
    assert studio.stats()["edit_ms"] == second
    stats = {"type": "stats", "view": "page", "drag_ms": 41.0, "full_ms": 300.0, "frames": 3}
    deliver(studio.view, stats)
    wait_for(lambda: "volume 41 ms" in get_status(studio))  # in a moment of rest
    controls(studio)["Side"].value = "+z"
    studio.wait()
    assert studio.stats()["picture_ms"] > 0


# -- the camera --------------------------------------------------------------------------------------------------------


def test_the_volume_is_turned_with_the_picture_until_somebody_turns_it(studio: Studio) -> None:
    side, view = controls(studio)["Side"], studio.view
    first = view.camera["direction"]
    side.value = "+z"
    studio.wait()
    assert view.camera["direction"] != first
    studio.undo()
    studio.wait()
    assert view.camera["direction"] == first
    view.camera = {**view.camera, "zoom": 2.0}  # nearer is not elsewhere
    side.value = "+z"
    studio.wait()
    assert view.camera["direction"] != first
    view.set_camera((1.0, 0.2, 0.3))  # as a user would
    mine = view.camera
    studio.undo()
    studio.wait()
    side.value = "-y"
    studio.wait()
    assert view.camera == mine


# -- controls ----------------------------------------------------------------------------------------------------------


def test_the_grid_can_be_as_fine_as_the_editor_draws_it(studio: Studio) -> None:
    density = next(w for w in walk(panel(studio, "Picture").box) if getattr(w, "description", "") == "Grid")
    studio.editor.density = 64
    assert density.value == 64


def test_no_file_is_written_over_unasked(studio: Studio, tmp_path: Path) -> None:
    files = panel(studio, "Export")
    for name in ("ball.py", "ball.json", "ball.svg"):
        (tmp_path / name).write_bytes(b"somebody's")
        files.name.value = name
        files.write.click()
        assert f"{name} is already there. Write over it?" in files.writing.question.text
        assert not files.write.disabled
        files.writing.question.box.children[-1].click()
        assert (tmp_path / name).read_bytes() == b"somebody's"
    files.name.value = "ball.py"
    files.write.click()
    files.writing.question.box.children[1].click()
    wait_for(lambda: files.writing.message.value.startswith("Wrote"))
    assert b"import deformnb" in (tmp_path / "ball.py").read_bytes()
    files.writing.message.value = ""
    files.write.click()  # its own by now
    wait_for(lambda: files.writing.message.value.startswith("Wrote"))


def test_a_picture_without_a_front_end_is_no_full_one(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    drag(studio, a_drag(studio, 6.0))

    def full(*_given: Any) -> None:
        raise AssertionError("a picture of all voxels")

    monkeypatch.setattr(LiveView, "still", full)
    bundle = studio._repr_mimebundle_()
    shown = from_png((bundle[0] if isinstance(bundle, tuple) else bundle)["image/png"])
    assert shown.shape[1] == 2 * PREVIEW_SIZE[0]
    for part in (shown[:, : PREVIEW_SIZE[0]], shown[:, PREVIEW_SIZE[0] :]):
        assert part.std() > 8
    studio.session.editing.reset()
    bundle = studio._repr_mimebundle_()
    before = from_png((bundle[0] if isinstance(bundle, tuple) else bundle)["image/png"])
    assert before.shape != shown.shape or np.abs(before.astype(int) - shown).max() > 60  # it shows the drag


# -- saving ------------------------------------------------------------------------------------------------------------


def head_of(studio: Studio) -> StudioHead:
    return next(w for w in walk(studio) if isinstance(w, StudioHead))


def test_the_button_saves_into_a_file_of_its_own(studio: Studio, tmp_path: Path) -> None:
    head = head_of(studio)
    (tmp_path / "ball.json").write_text("somebody's", encoding="utf-8")
    assert not head.unsaved
    drag(studio, a_drag(studio))
    assert head.unsaved
    deliver(head, {"type": "save"})
    wait_for(lambda: "Saved ball-2.json." in get_notice(studio))
    assert not head.unsaved
    assert "ball-2.json" in head.tip
    assert (tmp_path / "ball.json").read_text(encoding="utf-8") == "somebody's"
    first = (tmp_path / "ball-2.json").read_bytes()
    drag(studio, a_drag(studio, 1.0))
    head.press()
    wait_for(lambda: not head.unsaved)
    assert (tmp_path / "ball-2.json").read_bytes() != first  # the same one
    studio.save(tmp_path / "mine.json")
    assert "mine.json" in head.tip
    (tmp_path / "mine.json").write_text("changed by someone", encoding="utf-8")
    drag(studio, a_drag(studio, 2.0))
    head.press()
    wait_for(lambda: "changed by someone else" in get_notice(studio))
    assert head.unsaved
    assert (tmp_path / "mine.json").read_text(encoding="utf-8") == "changed by someone"
    upload_file(panel(studio, "Open").box, "s.json", first)
    assert not head.unsaved
    head.press()  # a session opened from elsewhere replaces nobody's file
    wait_for(lambda: "Saved ball-3.json." in get_notice(studio))


def test_a_page_cannot_say_where_to_save(studio: Studio, tmp_path: Path) -> None:
    head = head_of(studio)
    for wrong in (None, "save", {"type": "delete"}, ["save"]):
        deliver(head, wrong)
    head.set_state({"unsaved": True, "tip": "x"})
    assert not head.unsaved
    assert list(tmp_path.iterdir()) == []

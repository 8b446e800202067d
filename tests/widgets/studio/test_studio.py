"""The studio without a browser: what its widgets, its session and its page's messages do to each other."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import ipywidgets as ipw
import jax.numpy as jnp
import numpy as np
import pytest
from front_end import deliver
from numpy.testing import assert_array_equal
from studio_driver import (
    a_drag,
    a_volume,
    act,
    controls,
    drag,
    find_box,
    get_classes,
    get_notice,
    open_widgets,
    panel,
    post,
    wait_for,
    walk,
)
from uploads import upload_file
from waiting import Threads

from deformnb.document.deformation import Deformation
from deformnb.document.json_format import to_json
from deformnb.errors import DeformError
from deformnb.imaging.projection import PROJECTIONS
from deformnb.io.volumes.series import read_channels, write_channels
from deformnb.rbf import fitting
from deformnb.rbf.extrusion import FRONT_ONLY
from deformnb.rbf.kernels import KERNELS, register_kernel
from deformnb.rbf.trends import TRENDS
from deformnb.volume.channels import ChannelDisplay, Channels
from deformnb.volume.transfer import levels, preset
from deformnb.volume.views import SIDES, VIEWS
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import warp
from deformnb.widgets import Studio
from deformnb.widgets.boxes import Tabs
from deformnb.widgets.camera import SHOWS
from deformnb.widgets.cell_widgets import close_all, close_earlier_of_this_cell
from deformnb.widgets.inputs.transfer_editor import PresetMenu
from deformnb.widgets.messages.points import points_to_json
from deformnb.widgets.studio.studio import last_step


@pytest.fixture
def studio(tmp_path: Path) -> Iterator[Studio]:
    made = Studio(a_volume(), folder=tmp_path)
    made.wait()
    yield made
    made.close()


# -- edits of the page -------------------------------------------------------------------------------------------------


def test_an_edit_of_the_page_becomes_a_document(studio: Studio) -> None:
    seen: list[Deformation] = []
    studio.observe(lambda change: seen.append(change["new"]), "deformation")
    points = a_drag(studio)
    drag(studio, points)
    assert studio.deformation.steps[0].points == points
    assert seen == [studio.deformation]
    expected = Deformation.from_picture_points(studio.volume.grid, studio.session.steps.view or "", points).apply(
        studio.volume
    )
    assert_array_equal(studio.result().values, expected.values)
    assert not np.array_equal(studio.result().values, studio.volume.values)
    assert studio.stats()["edits"] == 1


def test_a_kernel_that_is_registered_later_is_in_the_menu(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(KERNELS, "bell", KERNELS["gaussian"])  # so that it is gone in the end
    register_kernel(lambda rho: jnp.exp(-4.5 * rho**2), name="bell", title="Bell")
    studio.session.editing.change(kernel="bell")
    assert controls(studio)["Kernel"].value == studio.editor.kernel == "bell"
    assert ("Bell", "bell") in controls(studio)["Kernel"].options
    sent = studio.editor.get_state("settings")["settings"]["kernel_table"]
    assert (sent["name"], sent["title"], sent["order"]) == ("bell", "Bell", 0)
    controls(studio)["Kernel"].value = "thin_plate"
    assert "kernel_table" not in studio.editor.get_state("settings")["settings"]
    controls(studio)["Kernel"].value = "wendland_c2"  # before it is gone from the menu's names


def test_undo_of_the_page_goes_through_the_document(studio: Studio) -> None:
    first = studio.editor.points
    points = a_drag(studio)
    drag(studio, points, "add")
    assert studio.editor.history == {"undo": f"add point {len(points)}", "redo": ""}
    controls(studio)["Kernel"].value = "gaussian"
    post(studio, {"type": "history", "way": "undo"})
    assert studio.session.editing.step.kernel == "wendland_c2"
    assert controls(studio)["Kernel"].value == "wendland_c2"
    assert studio.editor.points == points
    post(studio, {"type": "history", "way": "undo"})
    assert studio.editor.points == first
    post(studio, {"type": "history", "way": "redo"})
    assert studio.editor.points == points


def test_points_that_cannot_be_fitted_come_back_with_a_reason(studio: Studio) -> None:
    before = studio.editor.points
    wrong = before.add([3.0, 3.0], [5.0, 5.0]).add([9.0, 9.0], [5.0, 5.0])
    drag(studio, wrong)
    assert studio.editor.points == before
    assert "point 5" in get_notice(studio)
    assert studio.stats()["refused"] == 1
    drag(studio, a_drag(studio))  # and the studio works
    assert "point 5" not in get_notice(studio)


def test_rapid_edits_end_in_the_state_of_the_last(studio: Studio) -> None:
    for k in range(60):
        drag(studio, a_drag(studio, 0.05 * (k % 7 - 3)))
    last = studio.editor.points
    assert studio.session.editing.points == last
    studio.wait()
    assert studio.view.fields.shown.field is studio.session.results.field()


def test_a_drop_is_solved_once_for_the_page_and_the_result(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    drag(studio, a_drag(studio))
    studio.wait()
    solved, solve = [], fitting.solve_prepared

    def counted(*args: Any) -> Any:
        solved.append(threading.current_thread())
        return solve(*args)

    monkeypatch.setattr(fitting, "solve_prepared", counted)
    drag(studio, a_drag(studio, 3.0))
    studio.session.results.volume()
    studio.session.results.field()
    assert solved.count(threading.current_thread()) == 1
    studio.wait()
    assert len(solved) <= 2  # diagnostics invert the whole system, in a separate thread


def test_an_exception_of_an_observer_is_told_to_the_page(studio: Studio) -> None:
    sent: list[Any] = []
    studio.editor.send = lambda content, buffers=None: sent.append(content)  # what would go to the page

    def fails(_change: Any) -> None:
        raise ZeroDivisionError("of a cell")

    studio.observe(fails, "deformation")
    drag(studio, a_drag(studio))
    said = get_notice(studio) + str(sent)
    assert "ZeroDivisionError" in said
    studio.unobserve(fails, "deformation")


def test_edits_of_a_followed_picture_send_the_view_nothing(studio: Studio) -> None:
    hello = {"type": "hello", "view": "page", "largest": 2048, "renderer": "", "software": True}
    deliver(studio.view, hello)
    drag(studio, a_drag(studio))
    before = studio.view.stats()["field_bytes"]
    for k in range(5):
        drag(studio, a_drag(studio, 0.3 + 0.1 * k))
    controls(studio)["Strength"].value = 1.5
    controls(studio)["Kernel"].value = "gaussian"
    studio.undo()
    assert studio.view.stats()["field_bytes"] == before
    shown = studio.view.still((60, 40))
    controls(studio)["Extrusion"].value = "modulate"  # unknown to the front end
    wait_for(lambda: studio.view.stats()["field_bytes"] > before)
    assert not np.array_equal(studio.view.still((60, 40)), shown)


# -- code in other cells -----------------------------------------------------------------------------------------------


def test_a_document_can_be_set_and_undone(studio: Studio, tmp_path: Path) -> None:
    drag(studio, a_drag(studio))
    kept = studio.deformation
    studio.save(tmp_path / "kept.json")
    studio.session.editing.reset()
    assert not studio.session.editing.points.displacement.any()
    studio.deformation = kept
    assert studio.editor.points == kept.steps[0].points
    studio.undo()
    assert not studio.editor.points.displacement.any()
    studio.load(tmp_path / "kept.json")
    assert studio.deformation.steps == kept.steps
    with pytest.raises(DeformError):
        studio.deformation = Deformation.from_space_points(studio.editor.points)


def test_a_studio_opens_arrays_files_and_documents(tmp_path: Path, studio: Studio) -> None:
    drag(studio, a_drag(studio))
    studio.export(tmp_path / "ball.nrrd")
    (tmp_path / "did.json").write_text(to_json(studio.deformation), encoding="utf-8")
    for given in (tmp_path / "ball.nrrd", str(tmp_path / "ball.nrrd"), studio.result().values):
        other = Studio(given, tmp_path / "did.json")
        assert other.deformation.steps == studio.deformation.steps
        assert_array_equal(other.volume.values, studio.result().values)
        other.close()
    for wrong in (tmp_path / "none.nrrd", np.zeros(5), "x"):
        with pytest.raises((DeformError, OSError)):
            Studio(wrong)
    with pytest.raises(DeformError, match="live"):
        Studio(a_volume(), view="hologram")


# -- controls ----------------------------------------------------------------------------------------------------------


def test_every_row_of_the_registries_can_be_chosen(studio: Studio) -> None:
    found = controls(studio)
    for kernel in KERNELS:
        found["Kernel"].value = kernel
        assert (studio.session.editing.step.kernel, studio.editor.kernel) == (kernel, kernel)
        assert found["Trend"].value == studio.session.editing.step.trend == studio.editor.trend
        offered = {value for _, value in found["Trend"].options}
        assert offered == {t.name for t in TRENDS.values() if t.order >= KERNELS[kernel].order}
    found["Kernel"].value = "wendland_c2"
    for trend in TRENDS:
        found["Trend"].value = trend
        assert studio.editor.trend == trend
    assert {value for _, value in found["Side"].options} == set(VIEWS) == set(SIDES)
    for method in PROJECTIONS:
        found["Projection"].value = method
        studio.wait()
        assert studio.editor.picture.method == method
    for shows in SHOWS:
        found["Compare"].value = shows
        assert studio.view.shows == shows


def test_turning_the_picture_replaces_picture_and_points_together(studio: Studio) -> None:
    together: list[tuple[Any, Any]] = []
    side = controls(studio)["Side"]
    for view in VIEWS:
        side.value = view
        studio.wait()
        together.append((studio.editor.picture.plane, studio.session.editing.plane))
        a0, a1, b0, b1 = studio.editor.picture.raster.box
        inside = studio.editor.points.target
        assert (inside >= [a0, b0]).all()
        assert (inside <= [a1, b1]).all()
    assert all(a == b for a, b in together)
    assert len(studio.deformation.steps) == 1


def test_an_edit_that_comes_after_the_picture_was_turned_is_dropped(studio: Studio) -> None:
    drag(studio, a_drag(studio))
    late = a_drag(studio)
    hold = threading.Event()
    studio.parts.worker.call(hold.wait)  # the new picture waits behind this
    controls(studio)["Side"].value = next(v for v in VIEWS if v != studio.session.steps.view)
    count = len(studio.deformation.steps)
    drag(studio, late)
    hold.set()
    studio.wait()
    assert len(studio.deformation.steps) == count == 2
    assert studio.editor.points == studio.session.editing.points
    assert not studio.session.editing.points.displacement.any()
    assert studio.stats()["late"] == 1


def test_sliders_and_keys_edit_the_step(studio: Studio) -> None:
    drag(studio, a_drag(studio))
    found = controls(studio)
    found["Strength"].value = 2.5
    assert studio.editor.strength == studio.session.editing.step.strength == 2.5
    found["Automatic"].value = False
    found["Support radius"].value = 12.0
    assert studio.editor.support == pytest.approx(12.0)
    found["Smoothing"].value = 0.5
    assert studio.editor.smoothing == 0.5
    found["Extrusion"].value = "modulate"
    panel(studio, "Depth").curve.curve = "sin(pi*z)"
    assert studio.session.editing.step.curve == "sin(pi*z)"
    found["Extrusion"].value = "interpolate"
    keys = panel(studio, "Depth").keys
    assert keys.knots == studio.session.editing.step.knots == (0.0, 0.5, 1.0)
    message = {"kind": "select", "index": 2, "knots": [0.0, 0.5, 1.0], "selected": 2}
    deliver(keys, {"type": "edit", "seq": 1, "view": "v", "phase": "end", "value": message})
    assert studio.session.editing.key == 2
    drag(studio, a_drag(studio, -3.0))
    assert studio.session.editing.step.maps[2] != studio.session.editing.step.maps[0]
    assert studio.view.editor_map == 2
    found["Automatic"].value = True
    assert studio.session.editing.step.support is None


def test_a_page_that_rounds_a_slider_to_its_step_edits_nothing(studio: Studio) -> None:
    support = controls(studio)["Support radius"]
    exact = support.value
    rounded = 10 ** (support.min + round((np.log10(exact) - support.min) / support.step) * support.step)
    assert rounded != exact
    support.set_state({"value": rounded})  # as ipywidgets' page does when it shows a slider for the first time
    assert studio.session.editing.history["undo"] == ""
    assert studio.session.editing.step.support is None
    support.set_state({"value": 10 ** (np.log10(rounded) + support.step)})  # a user who moves it by one step
    assert studio.session.editing.step.support == pytest.approx(10 ** (np.log10(rounded) + support.step))
    studio.session.editing.change(strength=0.123456)
    controls(studio)["Strength"].set_state({"value": 0.12})
    assert studio.session.editing.step.strength == 0.123456


def test_opacities_reach_session_and_view(studio: Studio) -> None:
    before = studio.view.table
    value = {"nodes": [[0, 0], [100, 0.3], [230, 0.9]]}
    message = {"type": "edit", "seq": 1, "view": "v", "phase": "move", "value": value}
    deliver(studio.parts.opacity, message)
    assert studio.session.pictures.transfer.opacities == ((0.0, 0.0), (100.0, 0.3), (230.0, 0.9))
    assert studio.view.table != before
    studio.session.pictures.transfer = "bone"
    assert studio.parts.opacity.transfer == studio.session.pictures.transfer_function


def test_a_slow_hand_on_a_slider_makes_one_edit(studio: Studio, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr("deformnb.session.history.time", SimpleNamespace(monotonic=lambda: now, time=time.time))
    for name, field in (("Strength", "strength"), ("Smoothing", "smoothing"), ("Support radius", "support")):
        first = getattr(studio.session.editing.step, field)
        for value in (0.5, 1.0, 1.5):
            controls(studio)[name].value = value * (20 if field == "support" else 1)
            now += 2.0
        studio.undo()
        assert getattr(studio.session.editing.step, field) == first
    for kernel in ("gaussian", "cubic"):  # a menu has no value between
        controls(studio)["Kernel"].value = kernel
        now += 2.0
    studio.undo()
    assert studio.session.editing.step.kernel == "gaussian"


def test_ambient_occlusion_is_switched_in_the_panel_and_kept_by_a_page(studio: Studio) -> None:
    box = controls(studio)["Ambient occlusion"]
    assert (box.value, studio.view.ambient_occlusion) == (True, True)
    box.value = False
    assert (studio.session.pictures.ambient_occlusion, studio.view.ambient_occlusion) == (False, False)
    assert not studio.view.settings().ambient_occlusion
    editor, view = last_step(studio.session, studio.parts.editors.plane, studio.view)
    assert not view.ambient_occlusion
    close_all(editor)
    close_all(view)
    studio.session.pictures.ambient_occlusion = True
    assert (box.value, studio.view.ambient_occlusion) == (True, True)


def test_the_window_of_the_page_is_that_of_the_session_and_of_its_pictures(studio: Studio) -> None:
    session, image = studio.session, studio.editor.image
    studio.editor.set_state({"window": [20.0, 90.0]})
    assert session.pictures.window == session.pictures.picture().window == studio.editor.picture.window == (20, 90)
    assert studio.editor.image == image  # the page has it already
    session.pictures.method = "mean"
    studio.wait()
    assert studio.editor.window == [20, 90]
    session.pictures.window = None
    assert studio.editor.window == []
    assert studio.editor.picture.window == session.pictures.picture().window
    session.pictures.window, session.pictures.colour_map = (10, 30), "bone"
    assert studio.editor.picture.colour_map == "bone"
    assert len(studio.editor.colours) == 3 * 256
    studio.view.shows = "fade"
    assert studio.editor.shows == "fade"
    studio.view.shows = "flicker"  # which pictures do not
    assert studio.editor.shows == "deformed"
    session.pictures.method = "composite"
    studio.wait()
    assert studio.editor.raster["channels"] == 3


def test_three_slices_of_the_deformed_volume_take_the_place_of_the_view(studio: Studio) -> None:
    drag(studio, a_drag(studio))
    button = controls(studio)["Slices"]
    assert not studio.editor.live
    button.value = True
    studio.wait()
    place = next(box for box in walk(studio) if studio.view in getattr(box, "children", ()))
    view, slices = place.children
    assert (view.layout.display, slices.layout.display) == ("none", None)
    assert slices.before is studio.session.results.field()
    assert (slices.read_only, len(slices.points)) == (True, 0)
    assert studio.editor.live  # a drag in progress is shown too
    points = studio.editor.points.move(4, [3.0, 3.0])
    post(
        studio,
        {
            "type": "edit",
            "phase": "move",
            "kind": "move",
            "joins": False,
            "next_id": points.next_id,
            "points": points_to_json(points),
        },
    )
    studio.wait()
    wanted = studio.session.editing.step.with_points(points, 0).field(studio.volume.grid)
    place = [[3.0, 3.0, 3.0]]
    assert_array_equal(slices.before.displacement(place), wanted.displacement(place))
    studio.undo()
    studio.wait()
    assert slices.before is studio.session.results.field()
    button.value = False
    assert (view.layout.display, slices.layout.display, studio.editor.live) == (None, "none", False)


def test_the_page_goes_through_the_slices(studio: Studio) -> None:
    session = studio.session
    assert studio.editor.slices == {}
    session.pictures.method = "slice"
    studio.wait()
    slices = session.pictures.slices
    assert studio.editor.slices == {"count": slices.count, "first": slices.first, "spacing": slices.spacing}
    studio.editor.set_state({"slice": 2})
    studio.wait()
    assert session.pictures.depth == slices.depth(2)
    assert studio.editor.slice == 2
    assert_array_equal(studio.editor.picture.values, session.pictures.picture().values)
    session.pictures.depth = slices.depth(4)
    studio.wait()
    assert studio.editor.slice == 4
    studio.editor.set_state({"slice": 10**6})
    studio.wait()
    assert session.pictures.depth == slices.depth(slices.count - 1)
    session.pictures.method = "mip"
    studio.wait()
    assert studio.editor.slices == {}


def test_front_only_of_the_page_is_the_depth_of_the_step(studio: Studio) -> None:
    session, editor = studio.session, studio.editor
    assert editor.front_only is False
    editor.set_state({"front_only": True})
    assert (session.editing.step.extrusion, session.editing.step.curve) == ("modulate", FRONT_ONLY)
    editor.set_state({"front_only": False})
    assert session.editing.step.extrusion == "replicate"
    session.editing.change(extrusion="modulate", curve="sin(pi*z)")
    studio.wait()
    assert editor.front_only is False
    studio.undo()
    studio.undo()
    studio.wait()
    assert editor.front_only is True
    assert session.editing.step.curve == FRONT_ONLY


def test_the_cross_hair_of_the_three_slices_and_the_slice_of_the_picture_move_together(studio: Studio) -> None:
    session = studio.session
    controls(studio)["Slices"].value = True
    session.pictures.method = "slice"
    studio.wait()
    place = next(box for box in walk(studio) if studio.view in getattr(box, "children", ()))
    three, slices, plane = place.children[1], session.pictures.slices, session.editing.plane

    def at(a: float, b: float, c: float) -> list[float]:
        return plane.from_plane([(a, b, c)])[0].tolist()

    three.cursor = at(2.0, 3.0, slices.depth(1))
    studio.wait()
    assert session.pictures.depth == slices.depth(1)
    assert studio.editor.slice == 1
    assert_array_equal(studio.editor.picture.values, session.pictures.picture().values)
    studio.editor.set_state({"slice": 4})
    studio.wait()
    assert three.cursor == pytest.approx(at(2.0, 3.0, slices.depth(4)))
    session.pictures.method = "mip"
    three.cursor = at(2.0, 3.0, slices.depth(0))
    assert session.pictures.depth == slices.depth(4)  # which shows no slice


def test_a_preset_is_chosen_over_the_volume_and_shown_as_such(studio: Studio) -> None:
    session, menu = studio.session, next(found for found in walk(studio) if isinstance(found, PresetMenu))
    menu.value = "bone"
    studio.wait()
    assert session.pictures.transfer_function == preset("bone", studio.volume)
    session.pictures.transfer = replace(session.pictures.transfer_function, opacities=((0.0, 0.0), (200.0, 0.5)))
    studio.wait()
    assert menu.value == ""
    session.pictures.transfer = "surface"
    studio.wait()
    assert menu.value == "surface"


def test_air_around_the_body_is_known_where_the_picture_has_values_of_the_volume(studio: Studio) -> None:
    air = levels(studio.volume)[1]
    for method, wanted in (("mip", air), ("slice", air), ("mean", None), ("composite", None)):
        studio.session.pictures.method = method
        studio.wait()
        assert studio.editor.air == wanted


def test_several_steps_can_be_chosen_and_switched_off(studio: Studio) -> None:
    drag(studio, a_drag(studio))
    controls(studio)["Side"].value = "+z"
    studio.wait()
    drag(studio, a_drag(studio))
    words = SIDES[studio.session.steps.view_of(studio.deformation.steps[0].plane) or ""].split(" (")[0]
    steps = panel(studio, "Steps").items
    assert [row["facts"] for row in steps.rows] == [[words, "5, 1 dragged", ""], ["from below", "5, 1 dragged", ""]]
    assert [row["title"] for row in steps.rows] == [words, "from below"]
    act(steps, "choose", 0)
    studio.wait()
    assert studio.session.editing.index == 0
    assert studio.view.editor is None  # points of an earlier step pass through the later ones, in Python
    act(steps, "choose", 1)
    studio.wait()
    assert studio.view.editor is studio.editor
    act(steps, "switch", 1, False)
    assert not steps.rows[1]["on"]
    assert_array_equal(studio.result().values, Deformation(studio.deformation.steps[:1]).apply(studio.volume).values)


def test_what_is_done_in_a_second_step_stays_there(studio: Studio) -> None:
    drag(studio, a_drag(studio))
    controls(studio)["Side"].value = "+z"
    studio.wait()
    assert "Step 2 begins" in get_notice(studio)
    for _ in range(3):  # each changes the words of the menu of steps
        drag(studio, studio.editor.points.add([4.0, 4.0 + len(studio.editor.points)]), "add")
        drag(studio, a_drag(studio))
        assert studio.session.editing.index == 1
        assert panel(studio, "Steps").items.chosen == 1
    assert len(studio.deformation.steps) == 2


def test_the_page_shows_all_steps_whichever_is_edited(studio: Studio, tmp_path: Path) -> None:
    drag(studio, a_drag(studio))
    controls(studio)["Side"].value = "+z"
    studio.wait()
    drag(studio, a_drag(studio))
    studio.view.set_camera((0, 1, 0))
    studio.export_html(tmp_path / "last.html")
    act(panel(studio, "Steps").items, "choose", 0)
    studio.wait()
    studio.view.set_camera((0, 1, 0))
    studio.export_html(tmp_path / "first.html")
    assert (tmp_path / "first.html").read_bytes() == (tmp_path / "last.html").read_bytes()


def test_words_in_the_page_are_escaped_and_go_with_the_next_edit(studio: Studio) -> None:
    studio.parts.words.show("<img src=x onerror=alert(1)>", is_error=True)
    assert "<img" not in get_notice(studio)
    drag(studio, a_drag(studio))
    assert "img" not in get_notice(studio)


# -- files -------------------------------------------------------------------------------------------------------------


def test_the_files_panel_writes_into_its_folder_only(studio: Studio, tmp_path: Path) -> None:
    drag(studio, a_drag(studio))
    files = panel(studio, "Export")
    for name in ("ball.nrrd", "ball.svg", "ball.py", "ball.json", "ball.html"):
        files.name.value = name
        files.write.click()
        wait_for(lambda: not files.write.disabled)
        assert (tmp_path / name).stat().st_size > 0, get_notice(studio)
        assert name in files.writing.message.value
    for wrong in ("../ball.json", "/tmp/ball.json", "ball.exe", ".json", "a\\b.json"):
        files.name.value = wrong
        files.write.click()
        assert get_notice(studio)
        assert not files.write.disabled
    assert sorted(p.name for p in tmp_path.iterdir()) == ["ball.html", "ball.json", "ball.nrrd", "ball.py", "ball.svg"]


def test_a_scan_is_not_written_over_unasked(studio: Studio, tmp_path: Path) -> None:
    files = panel(studio, "Export")
    assert files.name.value == "ball_deformed.nii.gz"
    (tmp_path / "ball.nrrd").write_bytes(b"the scan")
    files.name.value = "ball.nrrd"
    files.write.click()
    assert "already there" in files.writing.question.text
    assert not files.write.disabled
    assert (tmp_path / "ball.nrrd").read_bytes() == b"the scan"
    files.writing.question.box.children[1].click()
    wait_for(lambda: files.writing.message.value.startswith("Wrote"))
    files.write.click()  # its own file
    wait_for(lambda: not files.write.disabled and files.writing.message.value.startswith("Wrote"))


def test_writing_can_be_cancelled(studio: Studio, tmp_path: Path) -> None:
    files = panel(studio, "Export")
    files.name.value = "ball.gif"
    files.write.click()
    files.writing.cancel.click()
    wait_for(lambda: not files.write.disabled)
    assert "Stopped" in files.writing.message.value
    wait_for(lambda: not list(tmp_path.iterdir()))  # the panel is free before the writer has ended


def test_a_session_file_is_opened_from_the_page(studio: Studio) -> None:
    drag(studio, a_drag(studio))
    saved = to_json(studio.session.document()).encode()
    studio.undo()
    opening = panel(studio, "Open").box
    upload_file(opening, "s.json", saved)
    assert studio.session.editing.points.displacement.any()
    upload_file(opening, "s.json", b"{nonsense")
    assert "JSON" in get_notice(studio)


def test_panels_are_made_when_they_are_first_seen_or_used(tmp_path: Path) -> None:
    studio = Studio(a_volume(), folder=tmp_path, language="de")
    try:
        made = {late.title: late for late in studio.parts.panels.late if late.made is not None}
        assert list(made) == ["Strength", "Steps", "Interpolation"]
        drag(studio, a_drag(studio))
        tabs = next(box for box in walk(studio) if isinstance(box, Tabs))
        tabs.choose(2)
        assert {late.title for late in studio.parts.panels.late if late.made is not None} == {
            *made,
            "Colours and opacity",
            "Picture",
        }
        points = next(late for late in studio.parts.panels.late if late.title == "Points")
        assert "dnb-late" in get_classes(points.box)
        points.reveal()
        assert tabs.selected == 0
        assert points.box.children == (points.panel.box,)
        assert "dnb-late" not in get_classes(points.box)
        table = points.panel.table
        assert table.language == ""  # its words are those of the head, in the page
        assert table.uid == studio.editor.uid
        again = points.panel
        points.reveal()
        assert points.panel is again
    finally:
        studio.close()


# -- display and the end -----------------------------------------------------------------------------------------------


def test_where_no_front_end_runs_there_is_a_picture(studio: Studio) -> None:
    still = studio.still(300)
    assert still.shape[1] == 300
    assert still[:, :150].std() > 5
    assert still[:, 150:].std() > 5
    data = studio._repr_mimebundle_()
    assert (data[0] if isinstance(data, tuple) else data)["image/png"].startswith(b"\x89PNG")


def test_a_closed_studio_leaves_nothing(tmp_path: Path) -> None:
    Studio(a_volume()).close()  # objects that are made once
    gc.collect()
    widgets, threads = open_widgets(), Threads()
    for _ in range(3):
        made = Studio(a_volume(), folder=tmp_path)
        drag(made, a_drag(made))
        reference = weakref.ref(made)
        made.close()
        del made
        wait_for(lambda: gc.collect() >= 0 and reference() is None)  # work in progress ends first  # noqa: B023
    threads.wait()
    assert open_widgets() <= widgets


def test_a_cell_that_runs_again_closes_its_studios(monkeypatch: pytest.MonkeyPatch) -> None:
    run = ["cell", "1"]
    monkeypatch.setattr("deformnb.widgets.cell_widgets._cell_and_run", lambda: tuple(run))
    closed: list[str] = []

    class Shown:
        def __init__(self, name: str) -> None:
            self.name = name

        def close(self) -> None:
            closed.append(self.name)

    a, b, c = Shown("a"), Shown("b"), Shown("c")
    close_earlier_of_this_cell(a)
    close_earlier_of_this_cell(b)  # a second one of the same run
    assert closed == []
    run[1] = "2"
    close_earlier_of_this_cell(c)
    assert closed == ["a", "b"]
    run[0] = "other cell"
    close_earlier_of_this_cell(Shown("d"))
    assert closed == ["a", "b"]


def test_the_studio_stands_in_boxes(studio: Studio) -> None:
    box = ipw.HBox([studio, ipw.Label("beside")])
    assert box.children[0] is studio
    assert "24 x 20 x 16" in repr(studio)


@pytest.mark.parametrize(
    ("value", "why"), [(0, "Every voxel has the value 0: "), (np.nan, "No voxel is a finite number: ")]
)
def test_a_volume_without_contrast_says_why_nothing_is_seen_and_what_to_do(value: float, why: str) -> None:
    voxels = np.full((12, 14, 16), value, np.float32)
    for given in (voxels, Volume(voxels, Grid(voxels.shape))):
        studio = Studio(given)
        assert f"{why}there is nothing to see in this volume; check how it was made or read" in get_notice(studio)
        assert get_notice(studio).count("nothing to see") == 1
        studio.close()


def test_the_notes_of_a_volume_are_shown_over_the_volume() -> None:
    values = np.random.default_rng(5).random((8, 9, 10))
    values[2, 3, 4] = np.nan
    studio = Studio(values)
    said = get_notice(studio)
    assert "1 voxel is not finite, shown as background." in said
    assert studio.parts.words.box in find_box(studio, "dnb-studio-messages").children, (
        "over the panes: it moves no picture"
    )
    studio.close()


def test_channels_are_shown_in_colours_of_their_own(tmp_path: Path) -> None:
    _, y, x = np.mgrid[:10, :20, :30]
    values = np.stack([200 * (x < 12), 100 * (x >= 18), 50 * (y < 8)], axis=-1).astype(np.uint8)
    stained = Channels.from_array(
        values, Grid((10, 20, 30)), ("nuclei", "actin", "membrane"), ((0, 0, 1), (1, 0, 0), (0, 1, 0))
    )
    write_channels(stained, tmp_path / "in.nrrd")
    studio = Studio(tmp_path / "in.nrrd", side="+z", folder=tmp_path)
    try:
        studio.wait()
        names = [box.description for box in walk(panel(studio, "Channels").box) if isinstance(box, ipw.Checkbox)]
        assert names == ["nuclei", "actin", "membrane"]
        picture = studio.session.pictures.picture()
        assert picture.rgb8()[[15, 15, 2], [5, 25, 5]].tolist() == [[0, 0, 255], [255, 0, 0], [0, 255, 255]]
        (box, colour), (window,) = (part.children for part in panel(studio, "Channels").rows[0].children)
        colour.value, window.value = "#ff00ff", (0.0, 400.0)
        assert studio.session.pictures.channel_displays[0] == ChannelDisplay(
            (1, 0, 1), (0, 200)
        )  # no more than there is
        window.value = (100.0, 200.0)
        panel(studio, "Channels").rows[1].children[0].children[0].value = False
        studio.wait()
        assert studio.editor.picture.rgb8()[[15, 15], [5, 25]].tolist() == [[255, 0, 255], [0, 0, 0]]
        box.value = False
        studio.wait()
        assert not studio.editor.picture.rgb8()[15].any()
        drag(studio, a_drag(studio, 4.0))
        whole = studio.session.results.channels()
        field = studio.session.results.field()
        for made, given in zip(whole, stained, strict=True):
            assert_array_equal(made.values, warp(given, field).values)
        written = read_channels(studio.export(tmp_path / "out.nrrd"))
        assert_array_equal(written.values, whole.values)
        assert written.names == stained.names
    finally:
        studio.close()


def test_colours_of_a_file_are_shown_and_one_volume_has_no_channels(tmp_path: Path) -> None:
    photo = np.zeros((12, 16, 3), np.uint8)
    photo[:6] = (200, 100, 0)
    write_channels(Channels.from_array(photo, kind="rgb"), tmp_path / "photo.png")
    studio = Studio(tmp_path / "photo.png")
    try:
        assert studio.session.pictures.picture().rgb8()[[2, 10], 3].tolist() == [[200, 100, 0], [0, 0, 0]]
        studio.session.pictures.method = "shaded"  # which has the colours of the transfer function
        assert not studio.session.pictures.shows_channels
        with pytest.raises(DeformError, match="ChannelDisplay"):
            studio.session.pictures.channel_displays = ()
    finally:
        studio.close()
    plain = Studio(a_volume())
    try:
        assert not any(one.title == "Channels" for one in plain.parts.panels.late)
        with pytest.raises(DeformError, match="no channels"):
            plain.session.results.channels()
    finally:
        plain.close()

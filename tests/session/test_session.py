"""A session: edits, undo, views and files, without any widget."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import traitlets
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from deformnb.document.deformation import Deformation, Step
from deformnb.errors import DeformError, FileChangedError, OtherVolumeError, VolumeFileError
from deformnb.imaging.projection import project
from deformnb.rbf.kernels import KERNELS
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.trends import TRENDS
from deformnb.session.inputs import source_of
from deformnb.session.session import Session
from deformnb.session.view_state import without_view_state
from deformnb.volume.plane import VIEWS, Plane
from deformnb.volume.transfer import PRESETS, TransferFunction
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import warp


def a_volume(seed: int = 0) -> Volume:
    values = np.random.default_rng(seed).integers(0, 255, (9, 10, 12)).astype(np.uint8)
    return Volume(values, Grid((9, 10, 12), (1.0, 1.5, 2.0), (3.0, -4.0, 5.0)), "noise")


@pytest.fixture
def session() -> Session:
    return Session(a_volume())


def dragged(session: Session, by: float = 0.8) -> ControlPoints:
    middle = session.points.source.mean(axis=0)
    return session.points.add(middle, middle + np.array([by, by / 2]))


# -- the beginning -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", VIEWS)
def test_a_session_begins_with_a_point_in_each_corner_of_the_picture(view: str) -> None:
    session = Session(a_volume(), view=view)
    a0, a1, b0, b1 = session.picture().raster.box
    du, dv = session.picture().raster.spacing
    left, right, top, bottom = a0 + du / 2, a1 - du / 2, b0 + dv / 2, b1 - dv / 2
    corners = {(left, top), (right, top), (left, bottom), (right, bottom)}
    assert {tuple(np.round(p, 9)) for p in session.points.source} == {tuple(np.round(c, 9)) for c in corners}
    assert not session.points.displacement.any()
    assert_array_equal(session.result().values, session.volume.values)
    assert session.view == view
    assert session.history == {"undo": "", "redo": ""}


def test_a_session_goes_on_with_a_document() -> None:
    points = ControlPoints.from_arrays([[0, 0], [5, 0], [0, 5]], [[0, 0], [6, 0], [0, 5]])
    volume = a_volume()
    given_one = Deformation.on_picture(volume.grid, "-x", points).then(Step((points,), Plane.along(volume.grid, "+z")))
    session = Session(volume, given_one)
    assert session.deformation is given_one
    assert session.index == 1
    assert session.view == "+z"


# -- edits and undo ----------------------------------------------------------------------------------------------------


def test_an_edit_makes_the_next_document_and_observers_see_it_whole(session: Session) -> None:
    seen: list[tuple[int, str]] = []
    session.observe(lambda change: seen.append((len(session.points), session.history["undo"])), "deformation")
    before = session.deformation
    session.edit_points(dragged(session), "add a point")
    assert seen == [(5, "add a point")]
    assert len(before.steps[0].points) == 4


def test_what_cannot_be_fitted_changes_nothing(session: Session) -> None:
    before, history = session.deformation, session.history
    twice = ControlPoints.from_arrays([[0, 0], [5, 0], [0, 5], [3, 3]], [[0, 0], [5, 0], [2, 2], [2, 2]])
    for edit in (
        lambda: session.edit_points(twice),
        lambda: session.change(kernel="round"),
        lambda: session.change(curve="z +", extrusion="modulate"),
        lambda: session.change(strength=np.inf),
        lambda: session.edit_step(3),
        lambda: session.set_view("up"),
    ):
        with pytest.raises(DeformError):
            edit()
    assert session.deformation is before
    assert session.history == history


def test_a_document_from_outside_is_an_edit_too(session: Session) -> None:
    before = session.deformation
    session.deformation = before.with_step(0, replace(session.step, kernel="gaussian"))
    assert session.history["undo"] == "change by code"
    session.undo()
    assert session.deformation == before
    with pytest.raises(DeformError):
        session.deformation = before.with_step(0, replace(session.step, kernel="cubic", trend="none"))
    assert session.deformation == before


def test_setting_a_document_without_steps_leaves_one_to_edit(session: Session) -> None:
    session.edit_points(dragged(session))
    session.deformation = Deformation(name="empty")
    assert len(session.deformation.steps) == 1
    assert session.deformation.name == "empty"
    assert_array_equal(session.result().values, session.volume.values)


EDITS = ("drag", "kernel", "trend", "rule", "view", "strength", "reset", "undo", "redo", "key")


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(EDITS), st.integers(0, 7)), max_size=12))
def test_undo_goes_back_to_the_beginning_and_redo_to_the_end(edits: list[tuple[str, int]]) -> None:
    session = Session(a_volume())
    first = session.deformation
    for what, n in edits:
        do(session, what, n)
    last, index, key = session.deformation, session.index, session.key
    while session.history["undo"]:
        assert session.undo()
    assert session.deformation == first
    while session.history["redo"]:
        assert session.redo()
    if not any(what in ("undo", "redo") for what, _ in edits):
        assert (session.deformation, session.index, session.key) == (last, index, key)


def do(session: Session, what: str, n: int) -> None:
    if what == "drag":
        session.edit_points(dragged(session, 0.1 * (n + 1)))
    elif what == "kernel":
        session.change(kernel=list(KERNELS)[n % len(KERNELS)])
    elif what == "trend":
        session.change(trend=list(TRENDS)[n % len(TRENDS)])
    elif what == "rule":
        session.change(extrusion=["replicate", "modulate", "interpolate"][n % 3])
    elif what == "view":
        session.set_view(VIEWS[n % 6])
    elif what == "strength":
        session.change(strength=n / 3)
    elif what == "key":
        if n < len(session.step.maps):
            session.edit_step(session.index, n)
    else:
        getattr(session, what)()


# -- settings that need each other -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("trend", TRENDS)
def test_every_kernel_can_be_chosen_with_every_trend_before_it(kernel: str, trend: str, session: Session) -> None:
    session.change(trend=trend)
    session.change(kernel=kernel)
    assert session.step.kernel == kernel
    needs_more = TRENDS[trend].order < KERNELS[kernel].order
    assert bool(session.notice) == needs_more
    assert (session.step.trend == trend) != needs_more


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("trend", TRENDS)
def test_every_trend_can_be_chosen_with_every_kernel_before_it(kernel: str, trend: str, session: Session) -> None:
    session.change(kernel=kernel, trend="quadratic" if KERNELS[kernel].order > TRENDS["affine"].order else "affine")
    session.change(trend=trend)
    assert session.step.trend == trend


def test_interpolation_begins_with_the_same_points_thrice_and_leaves_those_being_edited(session: Session) -> None:
    session.edit_points(dragged(session))
    before = session.result().values
    session.change(extrusion="interpolate")
    assert session.step.knots == (0.0, 0.5, 1.0)
    assert_array_equal(session.result().values, before)
    session.edit_step(0, 2)
    session.edit_points(dragged(session, 1.3))
    kept = session.points
    assert session.step.maps[0] != kept
    session.change(extrusion="modulate")
    assert session.step.maps == (kept,)
    assert session.key == 0


def test_a_name_is_that_of_a_landmark_at_every_key(session: Session) -> None:
    session.edit_points(session.points.add((3.0, 4.0)))
    session.change(extrusion="interpolate")
    session.edit_step(0, 1)
    new = session.points.next_id
    session.edit_points(session.points.edit(4, name="fin").add((6.0, 6.0), name="only here"))
    assert [m.names[m.index(4)] for m in session.step.maps] == ["fin"] * 3
    assert [new in m.ids for m in session.step.maps] == [False, True, False]
    session.undo()
    assert [m.names[m.index(4)] for m in session.step.maps] == [""] * 3


def test_a_new_key_begins_between_its_neighbours_and_changes_nothing(session: Session) -> None:
    session.change(extrusion="interpolate", knots=(0.0, 1.0))
    session.edit_points(dragged(session, 1.0))
    session.edit_step(0, 1)
    front = session.step.maps[0]
    session.edit_points(front.move(4, front.target[4] + [0.4, -0.6]))
    session.edit_keys((0.0, 0.25, 1.0), added=1, selected=1)
    assert_array_equal(session.points.target[4], front.target[4] + 0.25 * np.array([0.4, -0.6]))
    session.edit_keys((0.0, 0.4, 1.0), selected=1)
    assert session.step.knots == (0.0, 0.4, 1.0)
    session.edit_keys((0.4, 1.0), removed=0)
    assert session.step.maps[0].target[4].tolist() == (front.target[4] + 0.25 * np.array([0.4, -0.6])).tolist()
    assert session.history["undo"] == "remove a key"


# -- views -------------------------------------------------------------------------------------------------------------


def test_turning_an_untouched_picture_moves_its_plane_and_a_used_one_begins_a_step(session: Session) -> None:
    session.set_view("+z")
    assert len(session.deformation.steps) == 1
    session.edit_points(dragged(session))
    session.set_view("-x")
    assert len(session.deformation.steps) == 2
    assert session.index == 1
    first = Deformation(session.deformation.steps[:1])
    expected = project(warp(session.volume, first.field(session.volume.grid)), "-x", "mip")
    assert_array_equal(session.picture().values, expected.values)
    session.edit_step(0)
    assert session.view == "+z"
    assert_array_equal(session.picture().values, project(session.volume, "+z", "mip").values)


def test_a_side_leads_back_to_its_step_and_leaves_no_empty_one(session: Session) -> None:
    session.edit_points(dragged(session))
    first = session.view
    session.set_view("+z")
    assert "Step 2 begins" in session.notice
    session.set_view("-x")  # nothing was done on it
    assert [session.view_of(s.plane) for s in session.deformation.steps] == [first, "-x"]
    session.edit_points(dragged(session))
    assert session.notice == ""
    session.set_view(first or "")
    assert (session.index, len(session.deformation.steps)) == (0, 2)
    assert "Back at step 1" in session.notice
    session.set_view("+z")
    session.set_view(first or "")
    assert [session.view_of(s.plane) for s in session.deformation.steps] == [first, "-x"]


def test_sliders_of_two_steps_are_two_sliders(session: Session) -> None:
    session.edit_points(dragged(session))
    session.set_view("+z")
    session.change(kind="strength", slides=True, strength=0.5)
    session.edit_step(0)
    session.change(kind="strength", slides=True, strength=0.25)
    session.change(kind="strength", slides=True, strength=0.2)
    session.undo()
    assert [step.strength for step in session.deformation.steps] == [1.0, 0.5]


def test_steps_can_be_added_and_removed(session: Session) -> None:
    session.edit_points(dragged(session))
    kept = session.deformation
    session.add_step()
    assert session.index == 1
    session.edit_points(dragged(session, 0.3))
    session.remove_step()
    assert session.deformation == kept
    session.remove_step()
    assert not session.points.displacement.any()
    session.undo()
    assert session.deformation == kept


def test_key_pictures_that_are_left_are_spoken_of(session: Session) -> None:
    session.change(extrusion="interpolate")
    session.change(extrusion="replicate")
    assert session.notice == ""
    session.change(extrusion="interpolate")
    session.edit_points(dragged(session))
    session.change(extrusion="replicate")
    assert "undo brings the others back" in session.notice
    session.undo()
    assert len(session.step.maps) == 3


def test_the_picture_is_made_once_for_each_question(session: Session) -> None:
    first = session.picture()
    session.edit_points(dragged(session))  # the picture shows what is before the step
    assert session.picture() is first
    session.window, session.colour_map = (10, 30), "bone"
    shown = session.picture()
    assert (shown.window, shown.colour_map) == ((10, 30), "bone")
    assert session.picture() is shown
    session.window = (10, 40)
    assert session.picture().window == (10, 40)
    session.window, session.colour_map = None, "grey"
    assert session.picture() is first
    session.method = "slice"
    middle = session.picture()
    session.depth = session.depth_range[0]
    front = project(session.volume, "+y", "slice", depth=session.depth_range[0])
    assert_array_equal(session.picture().values, front.values)
    assert not np.array_equal(session.picture().values, middle.values)


def test_colours_belong_to_the_composite_picture_only(session: Session) -> None:
    mip = session.picture()
    session.transfer = "bone"
    assert session.picture() is mip
    session.method = "composite"
    bone = session.picture()
    session.transfer = PRESETS["muscle"](session.volume)
    assert session.picture() is not bone
    assert isinstance(session.transfer_function, TransferFunction)
    for wrong in ("gold", 3):
        with pytest.raises(DeformError):
            session.transfer = wrong


# -- files and code ----------------------------------------------------------------------------------------------------


def test_a_saved_document_comes_back_and_another_volume_is_noticed(session: Session, tmp_path: Path) -> None:
    session.edit_points(dragged(session))
    session.change(extrusion="modulate", curve="sin(pi*z)")
    file = tmp_path / "fish.json"
    session.save(file)
    again = Session(a_volume())
    again.open(file)
    assert again.deformation.steps == session.deformation.steps
    assert again.notice == ""
    assert again.undo() == "open a document"
    other = Session(a_volume(1))
    before = other.deformation
    words = r"another volume \('noise', 12 x 10 x 9 voxels\).*allow_other_volume=True"
    with pytest.raises(OtherVolumeError, match=words):
        other.open(file)
    assert other.deformation is before
    assert (other.history["undo"], other.saved) == ("", None)
    other.open(file, allow_other_volume=True)
    assert other.deformation.steps == session.deformation.steps
    assert "another volume ('noise', 12 x 10 x 9 voxels)" in other.notice


def test_labels_of_the_same_scan_are_no_other_volume(session: Session) -> None:
    labels = replace(a_volume(1), is_labels=True)
    assert Session(labels).difference(session.document()) == ""
    assert "another volume" in Session(a_volume(1)).difference(session.document())
    smaller = Volume(labels.values[1:], Grid((8, 10, 12)), "part", is_labels=True)
    assert "another volume" in Session(smaller).difference(session.document())


@pytest.mark.parametrize("place", [{"spacing": (2.0, 2.0, 2.0)}, {"origin": (50.0, 0.0, 0.0)}])
def test_the_same_voxels_elsewhere_are_another_volume_to_points(place: dict[str, Any], session: Session) -> None:
    there = Session(replace(session.volume, grid=replace(session.volume.grid, **place)))
    assert there.reference().sha256 == session.reference().sha256
    with pytest.raises(OtherVolumeError, match="same voxels at another place or of another size"):
        there.take(session.document())
    rounded = tuple(x + 1e-5 for x in session.volume.grid.origin)
    near = Session(replace(session.volume, grid=replace(session.volume.grid, origin=rounded)))
    assert near.difference(session.document()) == ""


def test_a_document_like_the_one_shown_is_no_edit(session: Session) -> None:
    session.deformation = replace(session.deformation)
    assert len(session.history_tree()) == 1
    assert session.undo() == ""


def test_a_file_that_somebody_else_has_changed_is_not_written_over(session: Session, tmp_path: Path) -> None:
    file = tmp_path / "fish.json"
    session.save(file)
    session.save(file)  # our own is no other's
    other = Session(a_volume())
    other.open(file)
    other.edit_points(dragged(other))
    other.save(file)
    theirs = file.read_bytes()
    words = r"^fish.json has been changed by someone else.*another name.*overwrite=True"
    with pytest.raises(FileChangedError, match=words):
        session.save(file)
    assert file.read_bytes() == theirs
    session.save(tmp_path / "mine.json")
    session.save(file, overwrite=True)
    assert file.read_bytes() != theirs
    with pytest.raises(FileChangedError):
        other.save(file)
    file.unlink()
    other.save(file)  # what is gone is not written over
    assert sorted(p.name for p in tmp_path.iterdir()) == ["fish.json", "mine.json"]
    file.touch()
    other.save(file)  # other times, the same content


def test_a_file_that_was_there_before_is_not_written_over(session: Session, tmp_path: Path) -> None:
    file = tmp_path / "fish.json"
    for content in (b"a letter", b""):
        file.write_bytes(content)
        with pytest.raises(FileChangedError, match=r"^fish\.json was there before.*another name.*overwrite=True"):
            session.save(file)
        assert file.read_bytes() == content
        assert (session.saved, session.file) == (None, None)
    session.save(file, overwrite=True)
    session.change(strength=0.5)
    session.save(file)  # what is in it was written here
    with pytest.raises(FileChangedError):
        Session(session.volume).save(file)
    again = Session(session.volume)
    again.open(file)
    again.save(file)  # opened here
    link = tmp_path / "link.json"
    link.symlink_to(file)
    again.save(link)
    assert link.is_symlink()
    assert [p.name for p in sorted(tmp_path.iterdir())] == ["fish.json", "link.json"]


def test_what_is_safe_in_a_file_is_known(session: Session, tmp_path: Path) -> None:
    assert session.saved is None
    session.edit_points(dragged(session))
    session.save(tmp_path / "a.json")
    assert session.saved == without_view_state(session.document())
    early = session.document()
    session.change(strength=0.5)
    session.save(tmp_path / "early.json", document=early)
    again = Session(a_volume())
    again.open(tmp_path / "early.json")
    assert again.step.strength == 1.0
    assert again.saved == again.deformation
    again.change(strength=0.2)
    with pytest.raises(VolumeFileError):
        again.save(tmp_path / "none" / "a.json")
    assert again.saved != again.document()


def test_the_code_makes_the_document(session: Session) -> None:
    session.edit_points(dragged(session))
    scope: dict[str, Any] = {"a_volume": a_volume}
    exec(session.code("a_volume()"), scope)
    assert scope["deformation"] == session.deformation
    assert_array_equal(scope["deformed"].values, session.result().values)


def test_edits_from_many_threads_all_count(session: Session) -> None:
    def work(n: int) -> None:
        for k in range(10):
            session.change(label=f"{n} {k}", strength=0.01 * (10 * n + k) + 0.005)

    threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    count = 0
    while session.undo():
        count += 1
    assert count == 40
    assert session.step.strength == 1.0


def test_a_picture_that_an_edit_overtakes_is_of_its_own_moment_and_not_kept(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    from deformnb.session import session as module

    before, made = session.plane, []

    def slowly(*given: Any, **options: Any) -> Any:
        if not made:  # another thread turns the picture while this one draws it
            made.append(given)
            session.set_view("-x")
        return project(*given, **options)

    monkeypatch.setattr(module, "project", slowly)
    assert session.picture().plane == before
    assert session.picture().plane == session.plane != before
    assert session.picture() is session.picture()


# -- the box of the result ---------------------------------------------------------------------------------------------


def a_brick() -> Session:
    """A session on a brick with air around it; its middle can be dragged out of the box."""
    values = np.zeros((16, 16, 16), np.uint8)
    values[4:12, 4:12, 4:12] = 200
    return Session(Volume(values, Grid((16, 16, 16), (2.0, 2.0, 2.0)), "brick"))


def drag_out(session: Session, by: float = 24.0) -> None:
    middle = session.points.source.mean(axis=0)
    session.edit_points(session.points.add(middle, middle + np.array([by, 0.0])))


def test_what_is_dragged_out_of_the_box_is_kept_by_a_larger_one() -> None:
    session = a_brick()
    assert session.exceeded_sides() == ()
    drag_out(session)
    assert session.exceeded_sides() == ("left side (L)",)
    small = session.result()
    assert small.grid == session.volume.grid
    assert session.fit_output()
    large = session.result()
    assert session.output == large.grid != session.volume.grid
    assert session.exceeded_sides() == ()
    assert_array_equal(large.values[:, :, : small.shape[2]], small.values)
    wide = warp(session.volume, session.field(), output=session.volume.grid.crop((-9, -9, -9), (40, 40, 60)))
    assert (large.values > 100).sum() == (wide.values > 100).sum() > (small.values > 100).sum()


def test_the_volumes_own_box_is_chosen_by_an_edit_too() -> None:
    session = a_brick()
    drag_out(session)
    session.fit_output()
    session.output = None
    assert session.deformation.output is None
    assert session.document().output is None
    assert session.exceeded_sides() == ("left side (L)",)
    assert session.history["undo"] == "change the result box"


def test_the_box_goes_along_with_undo_and_is_an_edit_of_its_own() -> None:
    session = a_brick()
    told: list[Any] = []
    session.observe(lambda change: told.append(change["new"]), "output")
    drag_out(session)
    session.fit_output()
    fitted = session.output
    assert told == [fitted]
    assert session.undo() == "change the result box"
    assert session.output is None
    assert len(session.points) == 5
    assert session.redo() == "change the result box"
    assert session.output == fitted
    session.grow(5.0)
    assert session.box.shape == (22, 22, 22)  # whole voxels
    session.grow(0.0)
    assert session.output is None
    with pytest.raises(traitlets.TraitError):
        session.output = (3, 4, 5)
    session.deformation = replace(session.deformation, output=fitted)  # by the document as well
    assert session.output == fitted
    session.reset()
    assert session.output == fitted  # where the result ends is no deformation


def test_a_box_that_joins_the_last_edit_is_taken_back_with_it() -> None:
    session = a_brick()
    session.fit_output()
    assert session.output == session.volume.grid
    drag_out(session)
    session.notice = "said before"
    session.fit_output(joins=True)
    assert session.notice == "said before"
    assert session.exceeded_sides() == ()
    assert session.history["undo"] == "move points"
    session.undo()
    assert session.output == session.volume.grid
    session.fit_output(joins=True)  # an older state stays as it was
    assert session.history["redo"] == "move points"


def test_a_box_that_would_be_too_large_is_told() -> None:
    session = a_brick()
    drag_out(session, 200.0)
    assert not session.fit_output(most=1.5)
    assert "farther than a box of 1.5 times" in session.notice
    assert session.box.size <= 1.5 * session.volume.grid.size


def test_the_box_is_saved_opened_and_written_as_code(tmp_path: Path) -> None:
    session = a_brick()
    drag_out(session)
    session.fit_output()
    session.save(tmp_path / "fitted.json")
    other = a_brick()
    other.open(tmp_path / "fitted.json")
    assert other.output == session.output
    assert_array_equal(other.result().values, session.result().values)
    space: dict[str, Any] = {"brick": session.volume}
    exec(session.code(volume="brick"), space)
    assert space["deformation"] == session.deformation
    assert_array_equal(space["deformed"].values, session.result().values)
    assert "volume.grid.crop((0, 0, 0), (16, 16, " in session.code()


def test_a_session_may_begin_with_a_box_of_another_resolution() -> None:
    grid = a_brick().volume.grid.resampled(spacing=3.0, margin=4.0)
    session = Session(a_brick().volume, output=grid)
    assert session.output == grid
    assert session.result().grid == grid
    assert session.history["undo"] == ""
    space: dict[str, Any] = {"brick": session.volume}
    exec(session.code(volume="brick"), space)
    assert space["deformed"].grid == grid


def test_a_result_without_room_is_refused() -> None:
    session = a_brick()
    session.output = replace(session.volume.grid, shape=(2**12, 2**13, 2**13))
    with pytest.raises(DeformError, match=r"takes 256\.0 GiB and .* smaller result box"):
        session.result()


def test_a_script_reads_the_file_that_the_volume_came_from() -> None:
    session = a_brick()
    assert 'dn.read_volume("volume.nii.gz")' in session.code()
    session.source = source_of('scans/a "carp".nrrd')
    assert r'volume = dn.read_volume("scans/a \"carp\".nrrd")' in session.code()
    assert "volume = brick" in session.code(volume="brick")

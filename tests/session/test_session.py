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
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import PRESETS, TransferFunction
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import warp


def a_volume(seed: int = 0) -> Volume:
    values = np.random.default_rng(seed).integers(0, 255, (9, 10, 12)).astype(np.uint8)
    return Volume(values, Grid((9, 10, 12), (1.0, 1.5, 2.0), (3.0, -4.0, 5.0)), "noise")


@pytest.fixture
def session() -> Session:
    return Session(a_volume())


def dragged(session: Session, by: float = 0.8) -> ControlPoints:
    middle = session.editing.points.source.mean(axis=0)
    return session.editing.points.add(middle, middle + np.array([by, by / 2]))


# -- the beginning -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", VIEWS)
def test_a_session_begins_with_a_point_in_each_corner_of_the_picture(view: str) -> None:
    session = Session(a_volume(), view=view)
    a0, a1, b0, b1 = session.pictures.picture().raster.box
    du, dv = session.pictures.picture().raster.spacing
    left, right, top, bottom = a0 + du / 2, a1 - du / 2, b0 + dv / 2, b1 - dv / 2
    corners = {(left, top), (right, top), (left, bottom), (right, bottom)}
    assert {tuple(np.round(p, 9)) for p in session.editing.points.source} == {tuple(np.round(c, 9)) for c in corners}
    assert not session.editing.points.displacement.any()
    assert_array_equal(session.results.volume().values, session.volume.values)
    assert session.steps.view == view
    assert session.editing.history == {"undo": "", "redo": ""}


def test_a_session_goes_on_with_a_document() -> None:
    points = ControlPoints.from_arrays([[0, 0], [5, 0], [0, 5]], [[0, 0], [6, 0], [0, 5]])
    volume = a_volume()
    given_one = Deformation.from_picture_points(volume.grid, "-x", points).then(
        Step((points,), Plane.from_view(volume.grid, "+z"))
    )
    session = Session(volume, given_one)
    assert session.editing.deformation is given_one
    assert session.editing.index == 1
    assert session.steps.view == "+z"


# -- edits and undo ----------------------------------------------------------------------------------------------------


def test_an_edit_makes_the_next_document_and_observers_see_it_whole(session: Session) -> None:
    seen: list[tuple[int, str]] = []
    session.editing.observe(
        lambda change: seen.append((len(session.editing.points), session.editing.history["undo"])), "deformation"
    )
    before = session.editing.deformation
    session.editing.edit_points(dragged(session), "add a point")
    assert seen == [(5, "add a point")]
    assert len(before.steps[0].points) == 4


def test_what_cannot_be_fitted_changes_nothing(session: Session) -> None:
    before, history = session.editing.deformation, session.editing.history
    twice = ControlPoints.from_arrays([[0, 0], [5, 0], [0, 5], [3, 3]], [[0, 0], [5, 0], [2, 2], [2, 2]])
    for edit in (
        lambda: session.editing.edit_points(twice),
        lambda: session.editing.change(kernel="round"),
        lambda: session.editing.change(curve="z +", extrusion="modulate"),
        lambda: session.editing.change(strength=np.inf),
        lambda: session.editing.edit_step(3),
        lambda: session.set_view("up"),
    ):
        with pytest.raises(DeformError):
            edit()
    assert session.editing.deformation is before
    assert session.editing.history == history


def test_a_document_from_outside_is_an_edit_too(session: Session) -> None:
    before = session.editing.deformation
    session.editing.deformation = before.with_step(0, replace(session.editing.step, kernel="gaussian"))
    assert session.editing.history["undo"] == "change by code"
    session.editing.undo()
    assert session.editing.deformation == before
    with pytest.raises(DeformError):
        session.editing.deformation = before.with_step(0, replace(session.editing.step, kernel="cubic", trend="none"))
    assert session.editing.deformation == before


def test_setting_a_document_without_steps_leaves_one_to_edit(session: Session) -> None:
    session.editing.edit_points(dragged(session))
    session.editing.deformation = Deformation(name="empty")
    assert len(session.editing.deformation.steps) == 1
    assert session.editing.deformation.name == "empty"
    assert_array_equal(session.results.volume().values, session.volume.values)


EDITS = ("drag", "kernel", "trend", "rule", "view", "strength", "reset", "undo", "redo", "key")


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.sampled_from(EDITS), st.integers(0, 7)), max_size=12))
def test_undo_goes_back_to_the_beginning_and_redo_to_the_end(edits: list[tuple[str, int]]) -> None:
    session = Session(a_volume())
    first = session.editing.deformation
    for what, n in edits:
        do(session, what, n)
    last, index, key = session.editing.deformation, session.editing.index, session.editing.key
    while session.editing.history["undo"]:
        assert session.editing.undo()
    assert session.editing.deformation == first
    while session.editing.history["redo"]:
        assert session.editing.redo()
    if not any(what in ("undo", "redo") for what, _ in edits):
        assert (session.editing.deformation, session.editing.index, session.editing.key) == (last, index, key)


def do(session: Session, what: str, n: int) -> None:
    if what == "drag":
        session.editing.edit_points(dragged(session, 0.1 * (n + 1)))
    elif what == "kernel":
        session.editing.change(kernel=list(KERNELS)[n % len(KERNELS)])
    elif what == "trend":
        session.editing.change(trend=list(TRENDS)[n % len(TRENDS)])
    elif what == "rule":
        session.editing.change(extrusion=["replicate", "modulate", "interpolate"][n % 3])
    elif what == "view":
        session.set_view(VIEWS[n % 6])
    elif what == "strength":
        session.editing.change(strength=n / 3)
    elif what == "key":
        if n < len(session.editing.step.maps):
            session.editing.edit_step(session.editing.index, n)
    else:
        getattr(session.editing, what)()


# -- settings that need each other -------------------------------------------------------------------------------------


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("trend", TRENDS)
def test_every_kernel_can_be_chosen_with_every_trend_before_it(kernel: str, trend: str, session: Session) -> None:
    session.editing.change(trend=trend)
    session.editing.change(kernel=kernel)
    assert session.editing.step.kernel == kernel
    needs_more = TRENDS[trend].order < KERNELS[kernel].order
    assert bool(session.editing.notice) == needs_more
    assert (session.editing.step.trend == trend) != needs_more


@pytest.mark.parametrize("kernel", KERNELS)
@pytest.mark.parametrize("trend", TRENDS)
def test_every_trend_can_be_chosen_with_every_kernel_before_it(kernel: str, trend: str, session: Session) -> None:
    session.editing.change(
        kernel=kernel, trend="quadratic" if KERNELS[kernel].order > TRENDS["affine"].order else "affine"
    )
    session.editing.change(trend=trend)
    assert session.editing.step.trend == trend


def test_interpolation_begins_with_the_same_points_thrice_and_leaves_those_being_edited(session: Session) -> None:
    session.editing.edit_points(dragged(session))
    before = session.results.volume().values
    session.editing.change(extrusion="interpolate")
    assert session.editing.step.knots == (0.0, 0.5, 1.0)
    assert_array_equal(session.results.volume().values, before)
    session.editing.edit_step(0, 2)
    session.editing.edit_points(dragged(session, 1.3))
    kept = session.editing.points
    assert session.editing.step.maps[0] != kept
    session.editing.change(extrusion="modulate")
    assert session.editing.step.maps == (kept,)
    assert session.editing.key == 0


def test_a_name_is_that_of_a_landmark_at_every_key(session: Session) -> None:
    session.editing.edit_points(session.editing.points.add((3.0, 4.0)))
    session.editing.change(extrusion="interpolate")
    session.editing.edit_step(0, 1)
    new = session.editing.points.next_id
    session.editing.edit_points(session.editing.points.edit(4, name="fin").add((6.0, 6.0), name="only here"))
    assert [m.names[m.index(4)] for m in session.editing.step.maps] == ["fin"] * 3
    assert [new in m.ids for m in session.editing.step.maps] == [False, True, False]
    session.editing.undo()
    assert [m.names[m.index(4)] for m in session.editing.step.maps] == [""] * 3


def test_a_new_key_begins_between_its_neighbours_and_changes_nothing(session: Session) -> None:
    session.editing.change(extrusion="interpolate", knots=(0.0, 1.0))
    session.editing.edit_points(dragged(session, 1.0))
    session.editing.edit_step(0, 1)
    front = session.editing.step.maps[0]
    session.editing.edit_points(front.move(4, front.target[4] + [0.4, -0.6]))
    session.editing.edit_keys((0.0, 0.25, 1.0), added=1, selected=1)
    assert_array_equal(session.editing.points.target[4], front.target[4] + 0.25 * np.array([0.4, -0.6]))
    session.editing.edit_keys((0.0, 0.4, 1.0), selected=1)
    assert session.editing.step.knots == (0.0, 0.4, 1.0)
    session.editing.edit_keys((0.4, 1.0), removed=0)
    assert session.editing.step.maps[0].target[4].tolist() == (front.target[4] + 0.25 * np.array([0.4, -0.6])).tolist()
    assert session.editing.history["undo"] == "remove a key"


# -- views -------------------------------------------------------------------------------------------------------------


def test_turning_an_untouched_picture_moves_its_plane_and_a_used_one_begins_a_step(session: Session) -> None:
    session.set_view("+z")
    assert len(session.editing.deformation.steps) == 1
    session.editing.edit_points(dragged(session))
    session.set_view("-x")
    assert len(session.editing.deformation.steps) == 2
    assert session.editing.index == 1
    first = Deformation(session.editing.deformation.steps[:1])
    expected = project(warp(session.volume, first.field(session.volume.grid)), "-x", "mip")
    assert_array_equal(session.pictures.picture().values, expected.values)
    session.editing.edit_step(0)
    assert session.steps.view == "+z"
    assert_array_equal(session.pictures.picture().values, project(session.volume, "+z", "mip").values)


def test_a_side_leads_back_to_its_step_and_leaves_no_empty_one(session: Session) -> None:
    session.editing.edit_points(dragged(session))
    first = session.steps.view
    session.set_view("+z")
    assert "Step 2 begins" in session.editing.notice
    session.set_view("-x")  # nothing was done on it
    assert [session.steps.view_of(s.plane) for s in session.editing.deformation.steps] == [first, "-x"]
    session.editing.edit_points(dragged(session))
    assert session.editing.notice == ""
    session.set_view(first or "")
    assert (session.editing.index, len(session.editing.deformation.steps)) == (0, 2)
    assert "Back at step 1" in session.editing.notice
    session.set_view("+z")
    session.set_view(first or "")
    assert [session.steps.view_of(s.plane) for s in session.editing.deformation.steps] == [first, "-x"]


def test_sliders_of_two_steps_are_two_sliders(session: Session) -> None:
    session.editing.edit_points(dragged(session))
    session.set_view("+z")
    session.editing.change(kind="strength", slides=True, strength=0.5)
    session.editing.edit_step(0)
    session.editing.change(kind="strength", slides=True, strength=0.25)
    session.editing.change(kind="strength", slides=True, strength=0.2)
    session.editing.undo()
    assert [step.strength for step in session.editing.deformation.steps] == [1.0, 0.5]


def test_steps_can_be_added_and_removed(session: Session) -> None:
    session.editing.edit_points(dragged(session))
    kept = session.editing.deformation
    session.steps.add()
    assert session.editing.index == 1
    session.editing.edit_points(dragged(session, 0.3))
    session.steps.remove()
    assert session.editing.deformation == kept
    session.steps.remove()
    assert not session.editing.points.displacement.any()
    session.editing.undo()
    assert session.editing.deformation == kept


def test_key_pictures_that_are_left_are_spoken_of(session: Session) -> None:
    session.editing.change(extrusion="interpolate")
    session.editing.change(extrusion="replicate")
    assert session.editing.notice == ""
    session.editing.change(extrusion="interpolate")
    session.editing.edit_points(dragged(session))
    session.editing.change(extrusion="replicate")
    assert "undo restores the others" in session.editing.notice
    session.editing.undo()
    assert len(session.editing.step.maps) == 3


def test_the_picture_is_made_once_for_each_question(session: Session) -> None:
    first = session.pictures.picture()
    session.editing.edit_points(dragged(session))  # the picture shows the result before the step
    assert session.pictures.picture() is first
    session.pictures.window, session.pictures.colour_map = (10, 30), "bone"
    shown = session.pictures.picture()
    assert (shown.window, shown.colour_map) == ((10, 30), "bone")
    assert session.pictures.picture() is shown
    session.pictures.window = (10, 40)
    assert session.pictures.picture().window == (10, 40)
    session.pictures.window, session.pictures.colour_map = None, "grey"
    assert session.pictures.picture() is first
    session.pictures.method = "slice"
    middle = session.pictures.picture()
    session.pictures.depth = session.pictures.depth_range[0]
    front = project(session.volume, "+y", "slice", depth=session.pictures.depth_range[0])
    assert_array_equal(session.pictures.picture().values, front.values)
    assert not np.array_equal(session.pictures.picture().values, middle.values)


def test_colours_belong_to_the_composite_picture_only(session: Session) -> None:
    mip = session.pictures.picture()
    session.pictures.transfer = "bone"
    assert session.pictures.picture() is mip
    session.pictures.method = "composite"
    bone = session.pictures.picture()
    session.pictures.transfer = PRESETS["muscle"](session.volume)
    assert session.pictures.picture() is not bone
    assert isinstance(session.pictures.transfer_function, TransferFunction)
    for wrong in ("gold", 3):
        with pytest.raises(DeformError):
            session.pictures.transfer = wrong


# -- files and code ----------------------------------------------------------------------------------------------------


def test_a_saved_document_comes_back_and_another_volume_is_noticed(session: Session, tmp_path: Path) -> None:
    session.editing.edit_points(dragged(session))
    session.editing.change(extrusion="modulate", curve="sin(pi*z)")
    file = tmp_path / "fish.json"
    session.save(file)
    again = Session(a_volume())
    again.open(file)
    assert again.editing.deformation.steps == session.editing.deformation.steps
    assert again.editing.notice == ""
    assert again.editing.undo() == "open a document"
    other = Session(a_volume(1))
    before = other.editing.deformation
    words = r"another volume \('noise', 12 x 10 x 9 voxels\).*allow_other_volume=True"
    with pytest.raises(OtherVolumeError, match=words):
        other.open(file)
    assert other.editing.deformation is before
    assert (other.editing.history["undo"], other.files.saved) == ("", None)
    other.open(file, allow_other_volume=True)
    assert other.editing.deformation.steps == session.editing.deformation.steps
    assert "another volume ('noise', 12 x 10 x 9 voxels)" in other.editing.notice


def test_labels_of_the_same_scan_are_no_other_volume(session: Session) -> None:
    labels = replace(a_volume(1), is_labels=True)
    assert Session(labels).files.difference(session.document()) == ""
    assert "another volume" in Session(a_volume(1)).files.difference(session.document())
    smaller = Volume(labels.values[1:], Grid((8, 10, 12)), "part", is_labels=True)
    assert "another volume" in Session(smaller).files.difference(session.document())


@pytest.mark.parametrize("place", [{"spacing": (2.0, 2.0, 2.0)}, {"origin": (50.0, 0.0, 0.0)}])
def test_the_same_voxels_elsewhere_are_another_volume_to_points(place: dict[str, Any], session: Session) -> None:
    there = Session(replace(session.volume, grid=replace(session.volume.grid, **place)))
    assert there.files.reference().sha256 == session.files.reference().sha256
    with pytest.raises(OtherVolumeError, match="same voxels at another place or of another size"):
        there.take(session.document())
    rounded = tuple(x + 1e-5 for x in session.volume.grid.origin)
    near = Session(replace(session.volume, grid=replace(session.volume.grid, origin=rounded)))
    assert near.files.difference(session.document()) == ""


def test_a_document_like_the_one_shown_is_no_edit(session: Session) -> None:
    session.editing.deformation = replace(session.editing.deformation)
    assert len(session.editing.history_tree()) == 1
    assert session.editing.undo() == ""


def test_a_file_that_somebody_else_has_changed_is_not_written_over(session: Session, tmp_path: Path) -> None:
    file = tmp_path / "fish.json"
    session.save(file)
    session.save(file)  # our own is no other's
    other = Session(a_volume())
    other.open(file)
    other.editing.edit_points(dragged(other))
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
    other.save(file)  # a missing file is not written over
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
        assert (session.files.saved, session.files.path) == (None, None)
    session.save(file, overwrite=True)
    session.editing.change(strength=0.5)
    session.save(file)  # its content was written here
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
    assert session.files.saved is None
    session.editing.edit_points(dragged(session))
    session.save(tmp_path / "a.json")
    assert session.files.saved == without_view_state(session.document())
    early = session.document()
    session.editing.change(strength=0.5)
    session.files.write(early, tmp_path / "early.json")
    again = Session(a_volume())
    again.open(tmp_path / "early.json")
    assert again.editing.step.strength == 1.0
    assert again.files.saved == again.editing.deformation
    again.editing.change(strength=0.2)
    with pytest.raises(VolumeFileError):
        again.save(tmp_path / "none" / "a.json")
    assert again.files.saved != again.document()


def test_the_code_makes_the_document(session: Session) -> None:
    session.editing.edit_points(dragged(session))
    scope: dict[str, Any] = {"a_volume": a_volume}
    exec(session.code("a_volume()"), scope)
    assert scope["deformation"] == session.editing.deformation
    assert_array_equal(scope["deformed"].values, session.results.volume().values)


def test_edits_from_many_threads_all_count(session: Session) -> None:
    def work(n: int) -> None:
        for k in range(10):
            session.editing.change(label=f"{n} {k}", strength=0.01 * (10 * n + k) + 0.005)

    threads = [threading.Thread(target=work, args=(n,)) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    count = 0
    while session.editing.undo():
        count += 1
    assert count == 40
    assert session.editing.step.strength == 1.0


def test_a_picture_that_an_edit_overtakes_is_of_its_own_moment_and_not_kept(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> None:
    from deformnb.session import pictures as module

    before, made = session.editing.plane, []

    def slowly(*given: Any, **options: Any) -> Any:
        if not made:  # another thread turns the picture while this one draws it
            made.append(given)
            session.set_view("-x")
        return project(*given, **options)

    monkeypatch.setattr(module, "project", slowly)
    assert session.pictures.picture().plane == before
    assert session.pictures.picture().plane == session.editing.plane != before
    assert session.pictures.picture() is session.pictures.picture()


# -- the box of the result ---------------------------------------------------------------------------------------------


def a_brick() -> Session:
    """A session on a brick with air around it; its middle can be dragged out of the box."""
    values = np.zeros((16, 16, 16), np.uint8)
    values[4:12, 4:12, 4:12] = 200
    return Session(Volume(values, Grid((16, 16, 16), (2.0, 2.0, 2.0)), "brick"))


def drag_out(session: Session, by: float = 24.0) -> None:
    middle = session.editing.points.source.mean(axis=0)
    session.editing.edit_points(session.editing.points.add(middle, middle + np.array([by, 0.0])))


def test_what_is_dragged_out_of_the_box_is_kept_by_a_larger_one() -> None:
    session = a_brick()
    assert session.results.exceeded_sides() == ()
    drag_out(session)
    assert session.results.exceeded_sides() == ("left side (L)",)
    small = session.results.volume()
    assert small.grid == session.volume.grid
    assert session.results.fit_output()
    large = session.results.volume()
    assert session.editing.output == large.grid != session.volume.grid
    assert session.results.exceeded_sides() == ()
    assert_array_equal(large.values[:, :, : small.shape[2]], small.values)
    wide = warp(session.volume, session.results.field(), output=session.volume.grid.crop((-9, -9, -9), (40, 40, 60)))
    assert (large.values > 100).sum() == (wide.values > 100).sum() > (small.values > 100).sum()


def test_the_volumes_own_box_is_chosen_by_an_edit_too() -> None:
    session = a_brick()
    drag_out(session)
    session.results.fit_output()
    session.editing.output = None
    assert session.editing.deformation.output is None
    assert session.document().output is None
    assert session.results.exceeded_sides() == ("left side (L)",)
    assert session.editing.history["undo"] == "change the result box"


def test_the_box_goes_along_with_undo_and_is_an_edit_of_its_own() -> None:
    session = a_brick()
    told: list[Any] = []
    session.editing.observe(lambda change: told.append(change["new"]), "output")
    drag_out(session)
    session.results.fit_output()
    fitted = session.editing.output
    assert told == [fitted]
    assert session.editing.undo() == "change the result box"
    assert session.editing.output is None
    assert len(session.editing.points) == 5
    assert session.editing.redo() == "change the result box"
    assert session.editing.output == fitted
    session.results.grow(5.0)
    assert session.results.box.shape == (22, 22, 22)  # whole voxels
    session.results.grow(0.0)
    assert session.editing.output is None
    with pytest.raises(traitlets.TraitError):
        session.editing.output = (3, 4, 5)
    session.editing.deformation = replace(session.editing.deformation, output=fitted)  # by the document as well
    assert session.editing.output == fitted
    session.editing.reset()
    assert session.editing.output == fitted  # where the result ends is no deformation


def test_a_box_that_joins_the_last_edit_is_taken_back_with_it() -> None:
    session = a_brick()
    session.results.fit_output()
    assert session.editing.output == session.volume.grid
    drag_out(session)
    session.editing.notice = "said before"
    session.results.fit_output(joins=True)
    assert session.editing.notice == "said before"
    assert session.results.exceeded_sides() == ()
    assert session.editing.history["undo"] == "move points"
    session.editing.undo()
    assert session.editing.output == session.volume.grid
    session.results.fit_output(joins=True)  # an older state stays as it was
    assert session.editing.history["redo"] == "move points"


def test_a_box_that_would_be_too_large_is_told() -> None:
    session = a_brick()
    drag_out(session, 200.0)
    assert not session.results.fit_output(most=1.5)
    assert "farther than a box of 1.5 times" in session.editing.notice
    assert session.results.box.size <= 1.5 * session.volume.grid.size


def test_the_box_is_saved_opened_and_written_as_code(tmp_path: Path) -> None:
    session = a_brick()
    drag_out(session)
    session.results.fit_output()
    session.save(tmp_path / "fitted.json")
    other = a_brick()
    other.open(tmp_path / "fitted.json")
    assert other.editing.output == session.editing.output
    assert_array_equal(other.results.volume().values, session.results.volume().values)
    space: dict[str, Any] = {"brick": session.volume}
    exec(session.code(volume="brick"), space)
    assert space["deformation"] == session.editing.deformation
    assert_array_equal(space["deformed"].values, session.results.volume().values)
    assert "volume.grid.crop((0, 0, 0), (16, 16, " in session.code()


def test_a_session_may_begin_with_a_box_of_another_resolution() -> None:
    grid = a_brick().volume.grid.resampled(spacing=3.0, margin=4.0)
    session = Session(a_brick().volume, output=grid)
    assert session.editing.output == grid
    assert session.results.volume().grid == grid
    assert session.editing.history["undo"] == ""
    space: dict[str, Any] = {"brick": session.volume}
    exec(session.code(volume="brick"), space)
    assert space["deformed"].grid == grid


def test_a_result_without_room_is_refused() -> None:
    session = a_brick()
    session.editing.output = replace(session.volume.grid, shape=(2**12, 2**13, 2**13))
    with pytest.raises(DeformError, match=r"takes 256\.0 GiB and .* smaller result box"):
        session.results.volume()


def test_a_script_reads_the_file_that_the_volume_came_from() -> None:
    session = a_brick()
    assert 'dn.read_volume("volume.nii.gz")' in session.code()
    session.files.source = source_of('scans/a "carp".nrrd')
    assert r'volume = dn.read_volume("scans/a \"carp\".nrrd")' in session.code()
    assert "volume = brick" in session.code(volume="brick")

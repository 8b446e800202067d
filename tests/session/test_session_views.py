"""Any camera as the picture: oblique planes in a session, its document, its script, and what is made of them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy import ndimage
from scipy.spatial.transform import Rotation

import deformnb as dn
from deformnb.document.deformation import Deformation, Keyframe
from deformnb.document.json_format import from_json, to_json
from deformnb.document.transplant import transplant
from deformnb.errors import DeformError
from deformnb.imaging.projection import project
from deformnb.rbf.cuts import Cut
from deformnb.rbf.regions import Line
from deformnb.session.batch import replay
from deformnb.session.session import Session
from deformnb.volume.plane import Plane
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume

GRID = Grid((14, 16, 18), (1.0, 1.5, 1.25), (3.0, -4.0, 5.0))
DIRECTION, UP = (0.7, 1.0, -0.45), (0.1, 0.2, 1.0)

rotations = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1).map(Rotation.from_quat)


def waves(grid: Grid = GRID, kind: type = np.float64) -> Volume:
    z, y, x = np.indices(grid.shape)
    values = 120 + 60 * np.sin(x / 3 + y / 4) + 40 * np.cos(z / 3 + y / 2)
    return Volume(values.astype(kind), grid, "waves")


def drag(session: Session, by: tuple[float, float] = (1.5, -0.8)) -> None:
    middle = session.editing.points.source.mean(axis=0)
    session.editing.edit_points(session.editing.points.add(middle, middle + by))


def test_the_subject_of_an_oblique_picture_is_what_is_seen_of_it() -> None:
    z, y, x = np.indices((60, 70, 80))
    middle, radius = np.array([48.0, 30.0, 25.0]), 14.0
    inside = (x - middle[0]) ** 2 + (y - middle[1]) ** 2 + (z - middle[2]) ** 2 < radius**2
    direction = Rotation.from_euler("zyx", [20, -10, 5], degrees=True).as_matrix()
    grid = Grid(inside.shape, (1.0, 1.0, 1.0), (300.0, -40.0, 5.0), tuple(map(tuple, direction.tolist())))
    session = Session(Volume(inside.astype(np.uint8) * 200, grid, "ball"))
    session.edit_view(DIRECTION, UP)
    a, b, _ = session.editing.plane.to_plane(grid.index_to_point(middle))
    expected = (a - radius, a + radius, b - radius, b + radius)
    assert_allclose(session.pictures.subject_box, expected, atol=4)  # a voxel of the coarse foreground is 3 wide
    session.edit_view(direction @ [0.0, 1.0, 0.0], direction @ [0.0, 0.0, 1.0])
    a, b, _ = session.editing.plane.to_plane(grid.index_to_point(middle))
    expected = (a - radius, a + radius, b - radius, b + radius)
    assert_allclose(session.pictures.subject_box, expected, atol=4)


def test_the_subject_of_an_empty_volume_is_its_box() -> None:
    session = Session(Volume(np.zeros(GRID.shape, np.uint8), GRID, "empty"))
    session.edit_view(DIRECTION, UP)
    corners = session.editing.plane.to_plane(GRID.corners())[:, :2]
    expected = np.stack([corners.min(axis=0), corners.max(axis=0)], axis=1).ravel()
    assert_allclose(session.pictures.subject_box, expected)


# -- planes from cameras -----------------------------------------------------------------------------------------------


@given(rotations)
@settings(max_examples=30, deadline=None)
def test_a_plane_from_a_camera_looks_as_the_camera_does(rotation: Rotation) -> None:
    right, up, ahead = rotation.as_matrix().T
    if np.dot(np.cross(ahead, up), right) < 0:
        right = -right
    plane = Plane.from_camera(GRID, 3 * ahead, up)
    if plane.origin == tuple(GRID.center):
        assert_allclose(plane.frame, [right, -up, ahead], atol=1e-9)
    else:  # of a side
        assert any(plane == Plane.from_view(GRID, view) for view in VIEWS)
    assert_allclose(plane.shifted(0.0).to_plane(GRID.center)[2], 0.0, atol=1e-9)


@given(rotations, *[st.floats(-170.0, 170.0)] * 3)
@settings(max_examples=30, deadline=None)
def test_a_turn_by_degrees_is_the_rotation_about_the_axes_of_the_picture(
    rotation: Rotation, up: float, right: float, roll: float
) -> None:
    u, v, _ = rotation.as_matrix().T
    plane = Plane((1.0, 2.0, 3.0), tuple(u), tuple(v))
    frame = np.array(plane.frame)
    # Each turn is about an axis of the picture as it stands by then: right-handed about u, v and n.
    for axis, angle in ((0, -up), (1, -right), (2, -roll)):
        frame = Rotation.from_rotvec(np.deg2rad(angle) * frame[axis]).apply(frame)
    direction, above = plane.turned_directions(up, right, roll)
    assert_allclose(direction, frame[2], atol=1e-9)
    assert_allclose(above, -frame[1], atol=1e-9)


def test_a_viewer_who_moves_up_sees_the_top() -> None:
    front = Plane.from_view(GRID, "+y")
    for turn, view in (({"up": 90.0}, "-z"), ({"right": 90.0}, "-x"), ({"right": -90.0}, "+x")):
        assert_allclose(front.turned_directions(**turn)[0], Plane.from_view(GRID, view).normal, atol=1e-12)
    _, above = front.turned_directions(roll=90.0)
    assert_allclose(above, np.negative(front.u), atol=1e-12)  # clockwise: what was left is at the top
    with pytest.raises(DeformError, match="degrees"):
        front.turned_directions(roll=float("nan"))


# -- the picture -------------------------------------------------------------------------------------------------------


@given(rotations, st.floats(-4.0, 4.0))
@settings(max_examples=25, deadline=None)
def test_a_slice_along_an_oblique_plane_is_the_volume_sampled_there(rotation: Rotation, depth: float) -> None:
    session = Session(waves())
    session.edit_view(rotation.apply(DIRECTION), rotation.apply(UP))
    session.pictures.method, session.pictures.depth = "slice", depth
    picture = session.pictures.picture()
    places = picture.plane.from_plane(
        np.concatenate([picture.raster.points(), np.full((*picture.raster.shape, 1), depth)], axis=-1)
    )
    index = GRID.point_to_index(places)[..., ::-1]
    inside = ((index >= 0) & (index <= np.array(GRID.shape) - 1)).all(axis=-1)  # the rim takes the edge voxels
    expected = ndimage.map_coordinates(session.volume.values, index[inside].T, order=1, mode="nearest")
    assert inside.sum() > 20
    # Pictures are in float32 of values up to 220.
    assert_allclose(picture.values[inside], expected, atol=float(220 * 4 * np.finfo(np.float32).eps))


def test_slices_go_along_the_normal_in_steps_of_a_voxel() -> None:
    session = Session(waves())
    session.edit_view(DIRECTION, UP)
    slices, (near, far) = session.pictures.slices, session.pictures.depth_range
    assert (slices.spacing, slices.first) == (1.0, near)
    assert far - slices.depth(slices.count - 1) < 1.0
    session.pictures.method = "slice"
    for index in (1, slices.count // 2, slices.count - 2):
        session.pictures.depth = slices.depth(index)
        assert slices.index(session.pictures.depth) == index
        assert session.pictures.picture().values.max() > 0


# -- equivariance ------------------------------------------------------------------------------------------------------


@given(rotations)
@settings(max_examples=10, deadline=None)
def test_an_edit_along_an_oblique_plane_of_a_turned_volume_is_that_along_the_axis(rotation: Rotation) -> None:
    """Turning voxels' grid and camera together turns the result: voxel by voxel the same numbers."""
    straight = waves()
    matrix = rotation.as_matrix()
    turned_grid = Grid(
        GRID.shape, GRID.spacing, tuple(matrix @ GRID.origin), (matrix @ np.asarray(GRID.direction)).tolist()
    )
    turned = Volume(straight.values, turned_grid, "turned")
    results = []
    for volume, turn in ((straight, np.eye(3)), (turned, matrix)):
        session = Session(volume)
        for direction, up in ((DIRECTION, UP), ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0))):
            plane = Plane.from_normal(volume.grid.center, turn @ direction, turn @ up)
            session.set_view(plane)
            drag(session)
            session.editing.change(extrusion="modulate", curve="1-z")
        results.append(session.results.volume().values)
    assert np.abs(results[0] - straight.values).max() > 5
    assert_allclose(results[0], results[1], atol=2e-3)  # values up to 220 in float32, at places that differ by rounding


# -- steps and their names ---------------------------------------------------------------------------------------------


def test_views_are_named_in_order_and_turned_while_nothing_is_on_them() -> None:
    session = Session(waves())
    session.edit_view(DIRECTION, UP)
    assert (session.steps.titles(), session.steps.view, session.editing.index) == (["view 1"], None, 0)
    session.edit_view((0.2, 1.0, 0.6))
    assert session.steps.titles() == ["view 1"]  # turned
    drag(session)
    first = session.editing.plane
    session.edit_view(DIRECTION, UP)
    drag(session)
    assert session.steps.titles() == ["view 1", "view 2"]
    session.edit_view(first.normal, [-c for c in first.v])
    assert (session.editing.index, session.editing.plane, session.editing.notice) == (
        0,
        first,
        "Back at step 1, view 1.",
    )
    session.set_back()
    assert session.steps.titles() == ["view 1", "view 2", "from the front"]
    assert session.editing.notice.startswith("Step 3 begins, from the front.")
    session.set_view(first)
    assert session.steps.titles() == ["view 1", "view 2"]
    session.steps.rename(0, "jaw")
    session.edit_view((1.0, 0.3, 0.1))
    assert session.steps.titles() == ["jaw", "view 2", "view 3"]
    assert session.steps.side_of(first) == "jaw"
    assert list(session.steps.oblique_views().values()) == ["jaw", "view 2", "view 3"]
    session.steps.add()
    assert session.steps.titles()[-1] == "view 3, 2nd"
    session.editing.undo()
    session.editing.undo()
    assert session.steps.titles() == ["jaw", "view 2"]


def test_names_count_on_from_key_frames_and_a_side_keeps_no_name_of_a_view() -> None:
    step = Session(waves())
    step.edit_view(DIRECTION, UP)
    drag(step)
    old = step.editing.step
    document = Deformation(
        (Session(waves()).editing.step,),
        keyframes=(Keyframe(0.0, (dn.document.Step(old.maps, old.plane, name="view 7"),)),),
    )
    session = Session(waves(), document)
    session.edit_view((1, 1, 1))
    assert session.steps.titles() == ["view 8"]
    session.set_back()
    assert [step.name for step in session.editing.deformation.steps] == [""]
    session.steps.rename(0, "tail")
    session.edit_view((1, 1, 1))
    assert session.steps.titles() == ["tail"]


@pytest.mark.parametrize("view", VIEWS)
def test_a_camera_on_a_side_leads_to_that_side(view: str) -> None:
    session, side = Session(waves()), Plane.from_view(GRID, view)
    session.edit_view(np.multiply(side.normal, 4.0) + 1e-9, np.negative(side.v))
    assert (session.steps.view, session.editing.plane) == (view, side)
    session.turn_view(up=12.0, right=-7.0, roll=3.0)
    assert session.steps.view is None
    session.set_back()
    assert session.steps.view == view


def test_two_turns_there_and_back_are_the_step_of_before() -> None:
    session = Session(waves())
    session.edit_view(DIRECTION, UP)
    drag(session)
    plane = session.editing.plane
    session.turn_view(right=20.0)
    assert session.steps.titles() == ["view 1", "view 2"]
    session.turn_view(right=-20.0)
    assert (session.editing.plane, session.steps.titles()) == (plane, ["view 1"])


# -- documents, scripts, replay ----------------------------------------------------------------------------------------


def edited(volume: Volume) -> Session:
    session = Session(volume)
    session.edit_view(DIRECTION, UP)
    drag(session)
    middle = session.editing.points.source.mean(axis=0)
    first, second = (tuple(np.add(middle, (3.0, way)).tolist()) for way in (-4.0, 4.0))
    session.editing.change(cuts=(Cut(Line((first, second))),), extrusion="modulate", curve="1-z")
    session.edit_view((-0.3, 0.5, 0.9))
    drag(session, (-0.7, 0.4))
    return session


@given(rotations)
@settings(max_examples=10, deadline=None)
def test_a_document_of_a_view_survives_json_and_script_bit_for_bit(rotation: Rotation) -> None:
    session = Session(waves())
    session.edit_view(rotation.apply(DIRECTION), rotation.apply(UP))
    drag(session)
    document = session.editing.deformation
    assert from_json(to_json(document)) == document
    names: dict[str, Any] = {"dn": dn, "the_volume": session.volume}
    exec(session.code("the_volume"), names)
    assert names["deformation"] == document
    assert_array_equal(names["deformed"].values, session.results.volume().values)


def test_a_view_is_replayed_restored_and_transplanted(tmp_path: Path) -> None:
    session = edited(waves(kind=np.uint8))
    session.save(tmp_path / "edit.json")
    dn.write_volume(session.volume, tmp_path / "waves.nii.gz")
    again = Session(session.volume, tmp_path / "edit.json")
    assert again.steps.titles() == session.steps.titles() == ["view 1", "view 2"]
    assert again.editing.deformation.steps == session.editing.deformation.steps
    replay(dn.read_deformation(tmp_path / "edit.json"), [tmp_path / "waves.nii.gz"], tmp_path / "out")
    (written,) = (tmp_path / "out").glob("*.nii.gz")
    assert_array_equal(dn.read_volume(written).values, session.results.volume().values)
    document = json.loads((tmp_path / "edit.json").read_text(encoding="utf-8"))
    assert [step["name"] for step in document["steps"]] == ["view 1", "view 2"]
    shifted = Grid(GRID.shape, GRID.spacing, tuple(np.add(GRID.origin, [10.0, 5.0, -2.0])), GRID.direction)
    moved = transplant(session.document(), shifted, "box")
    result = moved.apply(Volume(session.volume.values, shifted))
    assert_allclose(result.values.astype(float), session.results.volume().values, atol=1)


# -- picture and view --------------------------------------------------------------------------------------------------


@given(rotations, st.floats(-6.0, 6.0), st.floats(-6.0, 6.0), st.floats(-6.0, 6.0))
@settings(max_examples=30, deadline=None)
def test_a_place_of_the_picture_is_at_the_same_place_of_a_parallel_view_at_any_depth(
    rotation: Rotation, a: float, b: float, c: float
) -> None:
    from deformnb.widgets.camera import camera_of, checked_camera

    session = Session(waves())
    direction, up = rotation.apply(DIRECTION), rotation.apply(UP)
    session.edit_view(direction, up)
    plane = session.editing.plane
    camera = camera_of(checked_camera({"direction": direction, "up": up}), GRID, 1.5)
    assert camera.distance is None
    seen = camera.plane.to_plane(plane.from_plane([a, b, c]))[:2]
    middle = camera.plane.to_plane(plane.from_plane([0.0, 0.0, 0.0]))[:2]
    assert_allclose(seen - middle, [a, b], atol=1e-6 * 20)
    assert_allclose(middle + plane.to_plane(GRID.center)[:2], [0.0, 0.0], atol=1e-6 * 20)


def test_every_projection_of_a_view_is_that_of_its_plane() -> None:
    session = Session(waves(kind=np.uint8))
    session.edit_view(DIRECTION, UP)
    for method in ("mip", "slice", "mean", "composite", "shaded"):
        session.pictures.method = method
        picture = session.pictures.automatic_picture()
        expected = project(session.volume, session.editing.plane, method, transfer=session.pictures.transfer_function)
        assert_array_equal(picture.values, expected.values)
        assert picture.plane == session.editing.plane

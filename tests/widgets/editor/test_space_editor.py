"""The editor in space without a browser: its pictures, its messages, and linked coordinates."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage
from scripts import run_script
from waiting import PATIENCE, wait_for

from deformnb.analysis.folds import jacobian_determinant
from deformnb.document.deformation import Deformation
from deformnb.document.json_regions import part_to_data
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.fields import Identity, compose
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import HalfSpace, Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.volume.transfer import preset
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets import SpaceEditor
from deformnb.widgets.editor.space_slices import PANES, Pane, SpacePictures, cuts_on, slice_folds
from deformnb.widgets.messages.editors import ShapesEdit
from deformnb.widgets.messages.points import points_to_json

EDITS = ("ui/dom.ts", "maths/camera.ts", "maths/points.ts", "editor/handles.ts", "maths/space.ts")
SHAPE, SPACING, ORIGIN = (24, 30, 36), (1.0, 1.5, 2.0), (5.0, -8.0, 3.0)


@pytest.fixture(scope="module")
def volume() -> Volume:
    """Smooth and without symmetry."""
    z, y, x = np.mgrid[: SHAPE[0], : SHAPE[1], : SHAPE[2]]
    values = 100 + 60 * np.sin(x / 5) + 40 * np.cos(y / 4 + x / 9) + 50 * np.sin(z / 6 + 1)
    return Volume(values.astype(np.float32), Grid(SHAPE, SPACING, ORIGIN), "waves")


@pytest.fixture
def points(volume: Volume) -> ControlPoints:
    rng = np.random.default_rng(3)
    source = np.asarray(volume.grid.center) + rng.uniform(-10, 10, (6, 3))
    return ControlPoints.from_arrays(source, source + rng.normal(0, 2, (6, 3)), names=["nose", *[""] * 5])


@pytest.fixture
def editor(volume: Volume, points: ControlPoints, monkeypatch: pytest.MonkeyPatch) -> Iterator[SpaceEditor]:
    made = SpaceEditor(volume, points)
    made.messages = messages = []
    monkeypatch.setattr(made, "send", lambda content, buffers=None: messages.append((content, list(buffers or []))))
    yield made
    made.close()


def receive(editor: SpaceEditor, content: Any) -> None:
    deliver(editor, content)


def edit(points: Any, seq: int = 1, phase: str = "end", kind: str = "move") -> dict[str, Any]:
    given = points_to_json(points) if isinstance(points, ControlPoints) else points
    return {"type": "edit", "sender": "w1", "seq": seq, "phase": phase, "kind": kind, "points": given}


def pictures(editor: SpaceEditor, since: int = 0) -> tuple[dict[str, Any], list[bytes]]:
    """The next message with pictures after so many messages."""

    def come() -> list[tuple[dict[str, Any], list[bytes]]]:
        return [message for message in editor.messages[since:] if message[0]["type"] == "pictures"]

    wait_for(come)
    return come()[0]


# ---- the pictures ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("index", range(3))
def test_a_slice_shows_where_the_core_looks_each_pixel_up(volume: Volume, points: ControlPoints, index: int) -> None:
    made, place = SpacePictures(volume, preset("specimen", volume), (0.0, 255.0)), np.array([22.0, 13.0, 27.0])
    field, pane = fit_rbf(points), made.panes[index]
    shown = made.slice(index, field, place, 512)
    depth = np.full((*shown.raster.shape, 1), pane.plane.to_plane(place)[2])
    at = pane.plane.from_plane(np.concatenate([shown.raster.points(), depth], axis=-1))
    came_from = volume.grid.point_to_index(at + field.displacement(at))
    inside = ((came_from > 0) & (came_from < np.array(SHAPE[::-1]) - 1)).all(axis=-1)
    assert inside.mean() > 0.5
    expected = ndimage.map_coordinates(volume.values, came_from[inside][:, ::-1].T, order=1)
    assert np.abs(shown.values[inside] - np.clip(expected, 0, 255)).max() <= 1


def test_directions_are_those_of_radiologists(volume: Volume) -> None:
    axial, coronal, sagittal = (Pane.of(volume.grid, view) for view in PANES)
    assert (axial.plane.u, axial.plane.v) == ((1, 0, 0), (0, 1, 0))  # left is right, the back is down
    assert (coronal.plane.u, coronal.plane.v) == ((1, 0, 0), (0, 0, -1))
    assert (sagittal.plane.u, sagittal.plane.v) == ((0, 1, 0), (0, 0, -1))  # the nose to the left, the head up
    assert axial.spacing == (1.0, 1.5, 2.0)
    assert axial.depths == (0.0, 46.0)
    assert axial.box == (-0.5, 35.5, -0.75, 44.25, -1.0, 47.0)


def test_a_maximum_projection_knows_how_deep_its_brightest_voxels_lie() -> None:
    values = np.zeros((10, 12, 14), np.uint8)
    values[7, 3, 5] = 255
    volume = Volume(values, Grid((10, 12, 14), SPACING, ORIGIN))
    made = SpacePictures(volume, preset("specimen", volume))
    for index, pane in enumerate(made.panes):
        shown = made.projection(index, None, "mip", is_quick=True)
        row, column = np.unravel_index(int(shown.values.argmax()), shown.values.shape)
        assert shown.depths is not None
        a, b = shown.raster.columns[column], shown.raster.rows[row]
        found = pane.plane.from_plane([a, b, shown.depths[row, column]])
        np.testing.assert_allclose(found, volume.grid.index_to_point([5, 3, 7]), atol=1e-5)


def test_a_composite_finds_the_front_of_what_is_opaque() -> None:
    values = np.zeros((40, 40, 40), np.uint8)
    values[10:30, 8:32, 12:28] = 200
    volume = Volume(values, Grid((40, 40, 40)))
    shown = SpacePictures(volume, preset("surface", volume)).projection(1, None, "composite", is_quick=True)
    assert shown.depths is not None
    assert shown.values.shape == (40, 40, 3)
    assert abs(float(shown.depths[20, 20]) - 8.0) <= 3.0  # seen from the front, y = 8
    assert shown.values[20, 20].sum() > shown.values[2, 2].sum()


def test_folds_are_found_and_their_measure_is_right(volume: Volume) -> None:
    source = np.array([[5, -8, 3], [40, -8, 3], [5, 35, 3], [5, -8, 49.0]])
    doubled = fit_rbf(ControlPoints.from_arrays(source, source[0] + 2 * (source - source[0])))
    found = slice_folds(doubled, volume.grid)
    assert abs(found.least - 1 / 8) < 1e-4  # backward: every length halved
    assert found.share == 0
    mirrored = fit_rbf(ControlPoints.from_arrays(source, source * [-1, 1, 1]))
    assert slice_folds(mirrored, volume.grid).share == 1.0
    still = slice_folds(Identity(3), volume.grid)
    assert (still.least, still.share) == (1.0, 0.0)


# ---- the widget ------------------------------------------------------------------------------------------------------


def test_it_speaks_as_the_editor_of_a_picture_does(editor: SpaceEditor, points: ControlPoints, volume: Volume) -> None:
    step = editor.step(name="in space")
    assert step.plane is None
    assert step.maps == (points,)
    assert step.name == "in space"
    document = Deformation((step,))
    x = points.target
    np.testing.assert_allclose(document.field(volume.grid).displacement(x), points.displacement, atol=1e-9)
    np.testing.assert_allclose(editor.fit().displacement(x), points.displacement, atol=1e-9)
    json.dumps(editor.get_state(["points", "panes", "cursor", "projection", "seen", "history"]))


def test_points_on_a_picture_are_refused(editor: SpaceEditor, points: ControlPoints) -> None:
    with pytest.raises(DeformError, match="three coordinates"):
        editor.points = ControlPoints.empty(2)
    receive(editor, edit([{"id": 0, "source": [1, 2], "target": [1, 2]}]))
    assert editor.points == points
    assert "2 coordinates, and not 3" in editor.messages[0][0]["message"]


def test_the_end_of_an_edit_sets_the_points_and_is_answered(editor: SpaceEditor, points: ControlPoints) -> None:
    told: list[tuple[ControlPoints, str]] = []
    editor.on_edit(lambda given, phase: told.append((given, phase)))
    moved = points.move(0, points.target[0] + [0, 3, 0])
    receive(editor, edit(moved, 1, "move"))
    assert editor.points == points
    receive(editor, edit(moved, 2))
    assert editor.points == moved
    assert told == [(moved, "move"), (moved, "end")]
    assert [m for m, _ in editor.messages] == [{"type": "done", "sender": "w1", "seq": k} for k in (1, 2)]


def test_a_new_point_takes_hold_of_what_is_seen_there(editor: SpaceEditor, points: ControlPoints) -> None:
    place, before = points.target[0] + [4.0, 2.0, -3.0], editor.fit()
    expected = place + before.displacement(place)
    raw = points.add(place)
    receive(editor, edit(raw, 1, kind="add"))
    np.testing.assert_allclose(editor.points.source[-1], expected, atol=1e-12)
    np.testing.assert_allclose(editor.points.target[-1], place)
    dragged = raw.move(raw.ids[-1], place + np.array([1, 0, 0]))  # by a front end that has not received it
    receive(editor, edit(dragged, 2))
    np.testing.assert_allclose(editor.points.source[-1], expected, atol=1e-12)
    x = points.target[3] + [0.5, 0.5, 0.5]
    editor.points = editor.points.move(raw.ids[-1], place)
    np.testing.assert_allclose(editor.fit().displacement(x), before.displacement(x), atol=0.3)  # nothing jumps


def test_a_new_point_counts_strength(volume: Volume, points: ControlPoints) -> None:
    editor = SpaceEditor(volume, points, strength=2.0)
    place = points.target[0] + [4.0, 2.0, -3.0]
    field = editor.fit()
    receive(editor, edit(points.add(place), 1, kind="add"))
    np.testing.assert_allclose(editor.points.source[-1], place + field.displacement(place) / 2, atol=1e-12)
    editor.close()


def test_pictures_come_when_a_page_is_there_and_only_those_that_changed(editor: SpaceEditor) -> None:
    editor.points = editor.points.move(0, [20, 10, 20])
    assert not editor.sender.worker.is_wanted
    editor.sender.worker.call(lambda: None).result(PATIENCE)  # the work of the thread is done
    assert editor.messages == []  # nobody looks
    receive(editor, {"type": "hello", "view": "v"})
    content, buffers = pictures(editor)
    assert content["view"] == "v"
    assert [p["index"] for p in content["panes"]] == [0, 1, 2]
    assert [len(b) for b in buffers] == [p["shape"][0] * p["shape"][1] for p in content["panes"]]
    count = len(editor.messages)
    x, y, z = editor.cursor
    receive(editor, {"type": "look", "view": "v", "cursor": [x, y, z + 4], "moving": False})
    content, _ = pictures(editor, count)
    assert [p["index"] for p in content["panes"]] == [0]  # the axial slice has moved, the others are the same
    assert editor.cursor == [x, y, z + 4]


def test_a_movement_shows_what_the_core_makes_of_it(editor: SpaceEditor, points: ControlPoints, volume: Volume) -> None:
    receive(editor, {"type": "hello", "view": "v"})
    pictures(editor)
    count, moved = len(editor.messages), points.move(0, points.target[0] + [6, 0, 0])
    receive(editor, edit(moved, 1, "move"))
    content, buffers = pictures(editor, count)
    made = SpacePictures(volume, preset("specimen", volume))
    expected = made.slice(0, fit_rbf(moved), editor.cursor, 256).values
    sent = np.frombuffer(buffers[0], np.uint8).reshape(content["panes"][0]["shape"])
    assert np.abs(sent.astype(int) - expected).max() <= 1
    assert np.abs(sent.astype(int) - made.slice(0, fit_rbf(points), editor.cursor, 256).values).max() > 5


def test_points_that_cannot_be_fitted_are_said_and_the_last_pictures_stay(
    editor: SpaceEditor, points: ControlPoints
) -> None:
    receive(editor, {"type": "hello", "view": "v"})
    pictures(editor)
    count = len(editor.messages)
    editor.points = points.move(1, points.target[0])
    content, _ = pictures(editor, count)
    assert content["facts"]["isBad"]
    assert "at the same place" in content["facts"]["note"]
    with pytest.raises(DeformError, match="at the same place"):
        editor.fit()
    count = len(editor.messages)
    receive(editor, {"type": "seen", "view": "v", "seq": content["seq"]})
    editor.points = points
    wait_for(
        lambda: any(
            content["type"] == "pictures" and not content["facts"]["isBad"] for content, _ in editor.messages[count:]
        )
    )


@pytest.mark.parametrize(
    "content",
    [
        {"type": "look"},
        {"type": "look", "view": "v", "cursor": [1, 2]},
        {"type": "look", "view": "v", "cursor": "here"},
        {"type": "look", "view": "v", "cursor": [1, 2, float("nan")]},
        {"type": "look", "view": "v", "projection": "x-ray"},
        {"type": "look", "view": "v", "original": 3},
        {"type": "seen", "view": "v", "seq": -1},
        {"type": "seen", "view": 4},
        {"type": "hello", "view": "v" * 300},
        {"type": ["look"]},
        None,
        7,
    ],
)
def test_what_is_wrong_in_a_message_is_dropped(editor: SpaceEditor, content: Any) -> None:
    before = editor.get_state(["cursor", "projection", "shows_original", "points"])
    receive(editor, content)
    assert editor.get_state(["cursor", "projection", "shows_original", "points"]) == before


def test_a_page_sets_no_trait_of_its_own_accord(editor: SpaceEditor) -> None:
    editor.set_state({"cursor": [0, 0, 0], "panes": [], "points": [], "selected": [2]})
    assert editor.selected == [2]
    assert len(editor.points) == 6
    assert len(editor.panes) == 3


def test_a_cursor_stays_in_the_volume(editor: SpaceEditor, volume: Volume) -> None:
    editor.cursor = [1e6, 0, 20]
    assert editor.cursor == [40.0, 0.0, 20.0]
    with pytest.raises(DeformError, match="three finite numbers"):
        editor.cursor = [1, 2, float("inf")]


def test_what_was_done_before_is_seen_too(volume: Volume, points: ControlPoints) -> None:
    before = fit_rbf(ControlPoints.from_arrays([[10, 10, 10.0]], [[14, 10, 10.0]]))
    editor = SpaceEditor(volume, points, before=before)
    x = points.target
    expected = compose(before, editor.fit()).displacement(x)
    np.testing.assert_allclose(editor.field().displacement(x), expected, atol=1e-12)
    editor.close()


def test_a_rigid_part_in_space_stays_where_it_is(volume: Volume, points: ControlPoints) -> None:
    ground = RigidPart(HalfSpace((0.0, 0.0, 6.0), (0.0, 0.0, 1.0)), name="ground")
    editor = SpaceEditor(volume, points, options={"parts": (ground,)})
    assert editor.step().parts == (ground,)
    below, above = np.array([20.0, 10.0, 4.0]), points.target[0]
    np.testing.assert_allclose(editor.fit().displacement(below), 0, atol=1e-12)
    np.testing.assert_allclose(editor.fit().displacement(above), points.displacement[0], atol=1e-6)
    with pytest.raises(TypeError):
        editor.options = {"colour": "red"}
    assert editor.options == {"parts": (ground,)}
    editor.close()


@pytest.mark.parametrize("view", list(PANES))
def test_behind_the_slice_is_where_the_wheel_goes(volume: Volume, view: str) -> None:
    pane, place = Pane.of(volume.grid, view), np.asarray(volume.grid.center)
    at = pane.plane.from_plane(pane.plane.to_plane(place) + np.array([[1.0, 2.0, 3.0], [2.0, -1.0, -3.0]]))
    np.testing.assert_allclose(pane.behind(place).signed_distance(at), [-3.0, 3.0], atol=1e-9)


def test_cuts_are_marked_where_they_are_on_a_slice(volume: Volume) -> None:
    cut = Cut(HalfSpace((0.0, 20.0, 0.0), (0.0, 1.0, 0.0)))
    axial, coronal, _ = (Pane.of(volume.grid, view) for view in PANES)
    assert cuts_on(axial, 0.0, ()) is None
    assert cuts_on(axial, 0.0, (replace(cut, enabled=False),)) is None
    lines = cuts_on(axial, 0.0, (cut,))
    assert lines is not None
    assert lines.shape == axial.raster(192).shape
    rows = np.flatnonzero(lines.max(axis=1))
    np.testing.assert_allclose(axial.plane.from_plane([0, axial.raster(192).rows[rows].mean()])[1], 20.0, atol=1.0)
    assert lines.max() == 255
    flat = cuts_on(coronal, coronal.depth_of([0.0, 20.0, 0.0]), (cut,))
    assert flat is not None
    assert 20 < flat.min() <= flat.max() < 50  # it lies in the slice, which is seen through it
    assert len(rows) <= 4


@pytest.mark.parametrize(("most", "fineness"), [(192, 1.0), (10, 3.2)])
def test_a_picture_is_as_fine_as_the_voxels_but_has_no_more_pixels_than_asked(most: int, fineness: float) -> None:
    pane = Pane.of(Grid((8, 16, 32), (1.0, 2.0, 3.0)), "+z")
    raster = pane.raster(most)
    assert raster.shape == (round(32 / fineness), round(32 / fineness))
    np.testing.assert_allclose(raster.spacing, fineness, rtol=0.1)
    np.testing.assert_allclose(raster.box, pane.box[:4])


def test_a_cut_is_sent_with_its_slices(volume: Volume, editor: SpaceEditor) -> None:
    editor.options = {"cuts": (Cut(HalfSpace((0.0, 0.0, 6.0), (0.0, 0.0, 1.0))),)}
    receive(editor, {"type": "hello", "view": "v"})
    content, buffers = pictures(editor)
    assert len(buffers) == 6
    assert [len(b) for b in buffers[1::2]] == [p["cuts"][0] * p["cuts"][1] for p in content["panes"]]


@pytest.mark.parametrize("has_part", [False, True])
def test_det_j_is_sent_where_no_front_end_knows_the_map(editor: SpaceEditor, has_part: bool) -> None:
    here = np.asarray(editor.volume.grid.center)
    editor.change(trend="none", support=12.0)
    editor.parts = (RigidPart(HalfSpace((0.0, 0.0, -9.0), (0.0, 0.0, 1.0))),) if has_part else ()
    editor.points = ControlPoints.from_arrays([here, here + np.array([3, 0, 0])]).move(0, here + np.array([9, 0, 0]))
    receive(editor, {"type": "hello", "view": "v"})
    content, buffers = pictures(editor)
    axial = content["panes"][0]
    assert (axial["dets"] is not None) is has_part
    if has_part:
        pane = Pane.of(editor.volume.grid, "+z")
        expected = jacobian_determinant(editor.field(), pane.lattice(pane.depth_of(editor.cursor), 96))[0]
        np.testing.assert_allclose(np.frombuffer(buffers[1], "<f4").reshape(axial["dets"]), expected, atol=1e-5)
        assert expected.min() <= 0


# ---- rigid parts -----------------------------------------------------------------------------------------------------


def drawn(seq: int = 1, **changes: Any) -> dict[str, Any]:
    place = {"form": "ellipsoid", "middle": [20.0, 18.0, 15.0], "radii": [6.0, 5.0, 4.0]}
    return {"type": "part", "sender": "w1", "seq": seq, **place, **changes}


def test_a_drawn_part_becomes_one_and_is_chosen(editor: SpaceEditor) -> None:
    receive(editor, drawn())
    (part,) = editor.parts
    assert editor.chosen_shape == {"what": "parts", "index": 0}
    assert (part.motion, editor.seen, editor.tissue) == (None, {"w1": 1}, None)
    pane = Pane.of(editor.volume.grid, next(iter(PANES)))
    for k, radius in enumerate((6.0, 5.0, 4.0)):
        ends = np.array([20.0, 18.0, 15.0]) + np.outer([-1, 1], radius * pane.plane.frame[k])
        np.testing.assert_allclose(part.region.signed_distance(ends), 0, atol=0.15)
    assert editor.options == {"parts": (part,)}
    np.testing.assert_allclose(editor.fit().displacement([20.0, 18.0, 15.0]), 0, atol=1e-12)


@pytest.mark.parametrize("wrong", [{"form": "ball"}, {"radii": [1.0, 0.0, 1.0]}, {"middle": [1.0, 2.0]}])
def test_a_drawing_that_is_none_changes_nothing(editor: SpaceEditor, wrong: dict[str, Any]) -> None:
    receive(editor, drawn(**wrong))
    error, done = (content for content, _ in editor.messages)
    assert error["type"] == "error"
    assert done == {"type": "done", "sender": "w1", "seq": 1}
    assert (editor.parts, editor.seen) == ((), {"w1": 1})


def test_a_part_that_is_dragged_moves_in_the_slices_and_is_an_edit_at_its_end(editor: SpaceEditor) -> None:
    receive(editor, drawn())
    (part,) = editor.parts
    motion = RigidMotion.turn(20, (20, 18, 15), (2, 1, 0), (0, 0, 1))
    data = part_to_data(replace(part, motion=motion))
    move = {**edit(editor.points, 2, "move"), "part": {"index": 0, "motion": data["motion"]}}
    receive(editor, {"type": "hello", "view": "v"})
    receive(editor, {"type": "seen", "view": "v", "seq": pictures(editor)[0]["seq"]})
    since = len(editor.messages)
    receive(editor, move)
    content, buffers = pictures(editor, since)
    assert editor.parts == (part,)  # on its way it is no edit
    moved = editor.field(parts=(replace(part, motion=motion),))
    made = SpacePictures(editor.volume, preset("specimen", editor.volume))
    for index, pane in enumerate(content["panes"]):
        expected = made.slice(pane["index"], moved, editor.cursor, max(pane["shape"])).values
        np.testing.assert_array_equal(np.frombuffer(buffers[index], np.uint8).reshape(pane["shape"]), expected)
    heard: list[ShapesEdit] = []
    editor.on_shapes(heard.append)
    receive(editor, {"type": "shapes", "sender": "w1", "seq": 3, "what": "parts", "kind": "move it", "shapes": [data]})
    np.testing.assert_allclose(editor.parts[0].motion.matrix, motion.matrix)
    assert [(e.kind, e.what) for e in heard] == [("move it", "parts")]
    np.testing.assert_allclose(editor.field().displacement(motion([20, 18, 15])), [-2, -1, 0], atol=1e-6)


def test_a_part_of_a_picture_is_refused_in_space(editor: SpaceEditor) -> None:
    flat = RigidPart(Polygon([(0, 0), (4, 0), (4, 4)]))
    with pytest.raises(DeformError, match="is on a picture"):
        editor.parts = (flat,)
    shapes = [part_to_data(flat)]
    receive(editor, {"type": "shapes", "sender": "w1", "seq": 1, "what": "parts", "kind": "add", "shapes": shapes})
    assert "Python did not take these parts: parts[0] is on a picture" in editor.messages[0][0]["message"]
    assert editor.parts == ()


def test_another_volume_keeps_the_points(editor: SpaceEditor, points: ControlPoints) -> None:
    editor.volume = Volume.from_array(np.zeros((8, 9, 10), np.uint8))
    assert editor.points == points
    assert editor.panes[0]["depths"] == [0.0, 7.0]
    assert editor.cursor == [4.5, 4.0, 3.5]


def test_its_still_picture_is_a_png(editor: SpaceEditor) -> None:
    assert editor.preview_png().startswith(b"\x89PNG")
    assert "6 points" in repr(editor)


# ---- linked coordinates ----------------------------------------------------------------------------------------------

# A drag in each picture along each path, for whole grids of any direction.
DRAGS = """({ panes, points, ways }) => panes.map((pane) => ways.map(([da, db]) => {
  const moved = translateInSpace(points, points.map((p) => p.id), vectorFromPane(pane, da, db));
  return { depths: moved.map((p) => toPane(pane, p.target)[2]), before: points.map((p) => toPane(pane, p.target)[2]),
    moved: moved.map((p) => p.target), sources: moved.map((p) => p.source) };
}))"""

numbers = st.floats(-1e3, 1e3, allow_nan=False)


@settings(max_examples=12, deadline=None)
@given(
    place=st.tuples(numbers, numbers, numbers), way=st.tuples(numbers, numbers), turn=st.sampled_from([0.0, 0.3, -1.1])
)
def test_a_drag_in_a_picture_never_leaves_its_depth(
    place: tuple[float, ...], way: tuple[float, float], turn: float
) -> None:
    c, s = float(np.cos(turn)), float(np.sin(turn))
    grid = Grid(SHAPE, SPACING, ORIGIN, ((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
    panes = [Pane.of(grid, view) for view in PANES]
    points = points_to_json(ControlPoints.from_arrays([[1.0, 2.0, 3.0]], [place]))
    results = run_script(EDITS, DRAGS, {"panes": [p.info() for p in panes], "points": points, "ways": [way]})
    for pane, (result,) in zip(panes, results, strict=True):
        np.testing.assert_allclose(result["depths"], result["before"], rtol=0, atol=1e-9)
        assert result["sources"] == [[1.0, 2.0, 3.0]]
        a, b, depth = pane.plane.to_plane(place)
        expected = pane.plane.from_plane([a + way[0], b + way[1], depth])
        np.testing.assert_allclose(result["moved"][0], expected, atol=1e-9)
        if turn == 0:  # along the axes of space the third number is not touched at all
            k = int(np.abs(pane.plane.normal).argmax())
            assert result["moved"][0][k] == place[k]


def test_a_point_off_the_slice_says_how_far(volume: Volume, points: ControlPoints) -> None:
    pane = Pane.of(volume.grid, "+z")
    depth = pane.depth_of(points.target[0])
    flat = run_script(
        EDITS,
        "({ pane, points, depth }) => points.map((p) => { const flat = flatPoint(p, pane, depth); "
        "return { ...flat, label: spaceLabel(flat, p.id + 1), tip: spaceTip(flat) }; })",
        {"pane": pane.info(), "points": points_to_json(points), "depth": depth},
    )
    assert not flat[0]["isFar"]
    assert flat[0]["label"].startswith("Point 1 nose, at ")
    for k, p in enumerate(flat):
        away = points.target[k][2] - points.target[0][2]
        assert abs(p["away"] - away) < 1e-9
        assert p["isFar"] == (abs(away) > 1.5)
        if p["isFar"]:
            assert ("behind" if away > 0 else "in front of") in p["tip"]

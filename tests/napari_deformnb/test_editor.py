"""Edits of layers of points in a real viewer, and what comes of them; results as of independent calls."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from napari.layers import Labels, Points
from waiting import Threads

import deformnb as dn
from deformnb.errors import DeformError
from napari_deformnb.editor import LayerEditor, Mode, describe

Wait = Callable[[Callable[[], Any]], None]


@pytest.fixture
def make_editor(viewer: Any, wait: Wait) -> Iterator[Callable[..., LayerEditor]]:
    made: list[LayerEditor] = []

    def make(layer: Any, mode: Mode = "space", **options: Any) -> LayerEditor:
        editor = LayerEditor(viewer, layer, mode, **options)
        made.append(editor)
        wait(lambda: not editor.is_busy)
        return editor

    yield make
    for editor in made:
        editor.close()


def _drag(layer: Points, row: int, by: tuple[float, ...]) -> None:
    """Move one point as a drag ends: the same array with one other row."""
    data = layer.data.copy()
    data[row] += by
    layer.data = data


def test_a_dragged_point_gives_the_package_s_own_result(
    make_editor: Any, add_volume: Any, ball: dn.Volume, wait: Wait
) -> None:
    """In space, from literal numbers: index (z, y, x) = (5, 9, 12) is at (22, -6.5, 42.5) mm."""
    editor = make_editor(add_volume(ball))
    target = editor.pairs.sides["target"]
    target.add([5, 9, 12])
    _drag(target, 8, (1, 2, 3))
    wait(lambda: not editor.is_busy)
    points = editor.editing.points
    assert len(points) == 9
    assert points.source[8] == pytest.approx((22, -6.5, 42.5))
    assert points.target[8] == pytest.approx((25, -3.5, 45))
    corners = ball.grid.corners(centres=True)
    same = dn.ControlPoints.from_arrays(
        [*corners, (22, -6.5, 42.5)], [*corners, (25, -3.5, 45)], names=["corner"] * 8 + [""], unit="mm"
    )
    assert np.allclose(points.source, same.source)
    assert np.allclose(points.target, same.target)
    own = dn.Deformation.from_space_points(same).apply(ball)
    assert np.array_equal(editor.deformed.data, dn.Deformation.from_space_points(points).apply(ball).values)
    assert np.abs(editor.deformed.data.astype(int) - own.values).max() <= 1  # a half may be rounded either way
    assert (editor.deformed.data != ball.values).mean() > 0.05
    assert editor.deformed.units == editor.layer.units
    assert not editor.layer.visible


@pytest.mark.sampled(3)
@pytest.mark.parametrize("order", [(2, 0, 1), (0, 1, 2), (1, 0, 2)])
def test_a_drag_on_a_slice_is_extruded(
    make_editor: Any, add_volume: Any, viewer: Any, ball: dn.Volume, wait: Wait, order: tuple[int, int, int]
) -> None:
    layer = add_volume(ball)
    viewer.dims.order = order
    editor = make_editor(layer, "slice")
    target = editor.pairs.sides["target"]
    target.add([5, 9, 12])
    move = np.array([0.0, 0, 0])
    move[list(order[1:])] = 2
    _drag(target, 4, tuple(move))
    wait(lambda: not editor.is_busy)
    # By the package alone: right and down on the picture in mm from the first voxel.
    spacing = np.array(ball.grid.spacing[::-1])
    down, right = order[1:]
    start = (np.array((5, 9, 12)) * spacing)[[right, down]]
    end = ((np.array((5, 9, 12)) + move) * spacing)[[right, down]]
    axes = np.eye(3)[::-1]
    plane = dn.Plane(ball.grid.origin, tuple(axes[right]), tuple(axes[down]))
    last = ((np.array(ball.shape) - 1) * spacing)[[right, down]]
    corners = [(0, 0), (last[0], 0), tuple(last), (0, last[1])]
    points = dn.ControlPoints.from_arrays([*corners, start], [*corners, end])
    assert editor.editing.points.source == pytest.approx(points.source)
    assert editor.editing.points.target == pytest.approx(points.target)
    expected = dn.Deformation.from_picture_points(ball, plane, editor.editing.points).apply(ball)
    assert np.array_equal(editor.deformed.data, expected.values)
    assert (expected.values != ball.values).mean() > 0.05


@pytest.mark.nightly
def test_points_of_a_slice_go_with_the_slice_that_is_shown(
    make_editor: Any, add_volume: Any, viewer: Any, ball: dn.Volume
) -> None:
    layer = add_volume(ball)
    editor = make_editor(layer, "slice")
    before = editor.editing.points
    viewer.dims.set_current_step(0, 2)
    assert (editor.pairs.sides["source"].data[:, 0] == 2).all()
    viewer.dims.set_current_step(0, 9)
    assert (editor.pairs.sides["target"].data[:, 0] == 9).all()
    assert editor.editing.points is before


def test_a_rotated_layer_in_micrometres(make_editor: Any, viewer: Any, wait: Wait) -> None:
    """A turned and shifted layer with three spacings, in literal numbers."""
    values = np.random.default_rng(3).integers(0, 255, (6, 8, 10), np.uint8)
    turn = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], float)  # y goes along x, x along -y
    layer = viewer.add_image(values, scale=(5, 1, 2), rotate=turn, translate=(7, 30, 9), units=("um",) * 3)
    editor = make_editor(layer)
    source, target = editor.pairs.sides["source"], editor.pairs.sides["target"]
    source.add([2, 4, 5])
    assert target.data[8] == pytest.approx((2, 4, 5))
    _drag(target, 8, (0, 0, 1))
    wait(lambda: not editor.is_busy)
    # (z, y, x) = (7 + 5 * 2, 30 - 2 * 5, 9 + 1 * 4); one voxel further along the array's x goes 2 along -y.
    assert editor.editing.points.source[8] == pytest.approx((13, 20, 17))
    assert editor.editing.points.target[8] == pytest.approx((13, 18, 17))
    assert editor.document.unit == "µm"
    grid = dn.Grid((6, 8, 10), (2, 1, 5), (9, 30, 7), ((0, 1, 0), (-1, 0, 0), (0, 0, 1)), "um")
    expected = dn.Deformation.from_space_points(editor.editing.points).apply(dn.Volume(values, grid))
    assert np.array_equal(editor.deformed.data, expected.values)
    assert editor.deformed.data_to_world((1, 2, 3)) == layer.data_to_world((1, 2, 3))


def test_pairs_are_added_and_removed_together(make_editor: Any, add_volume: Any, ball: dn.Volume, wait: Wait) -> None:
    editor = make_editor(add_volume(ball))
    source, target = editor.pairs.sides["source"], editor.pairs.sides["target"]
    source.add([[5, 9, 12], [5, 4, 6]])
    target.add([4, 4, 4])
    wait(lambda: not editor.is_busy)
    assert len(source.data) == len(target.data) == len(editor.pairs.lines.data) == 11
    assert np.allclose(source.data, target.data, atol=1e-6)
    assert source.features["pair"].tolist() == target.features["pair"].tolist() == list(range(11))
    target.selected_data = {0, 9}
    target.remove_selected()
    assert len(source.data) == len(target.data) == 9
    assert source.features["pair"].tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 10]
    assert np.allclose(source.data[-2:], [(5, 9, 12), (4, 4, 4)], atol=1e-6)
    _drag(target, 7, (0, 1, 0))
    assert np.allclose(editor.pairs.lines.data[7], [(5, 9, 12), (0, 1, 0)])
    source.data = np.zeros((0, 3))
    assert len(target.data) == len(editor.editing.points) == 0


def test_a_point_on_the_result_holds_what_is_seen_there(
    make_editor: Any, add_volume: Any, ball: dn.Volume, wait: Wait
) -> None:
    editor = make_editor(add_volume(ball))
    target = editor.pairs.sides["target"]
    target.add([5, 9, 12])
    _drag(target, 8, (0, 3, 3))
    wait(lambda: not editor.is_busy)
    before, field = editor.deformed.data.copy(), editor.editing.deformation.field(ball.grid)
    place = ball.grid.index_to_point([14, 11, 6])
    target.add([6, 11, 14])
    wait(lambda: not editor.is_busy)
    points = editor.editing.points
    assert points.target[9] == pytest.approx(place)
    assert points.source[9] == pytest.approx(place + field.displacement(place[None])[0])
    assert np.abs(editor.deformed.data.astype(int) - before).max() < 40  # the map is nearly the same
    source = editor.pairs.sides["source"]
    source.add([5, 12, 9])
    x = ball.grid.index_to_point([9, 12, 5])
    expected, _ = dn.warp_points(x, dn.Deformation.from_space_points(points), grid=ball)
    assert editor.editing.points.target[10] == pytest.approx(expected, abs=1e-3)


def test_undo_and_redo_show_the_points(make_editor: Any, add_volume: Any, ball: dn.Volume, wait: Wait) -> None:
    editor = make_editor(add_volume(ball))
    target = editor.pairs.sides["target"]
    target.add([5, 9, 12])
    _drag(target, 8, (0, 3, 0))
    wait(lambda: not editor.is_busy)
    moved = editor.deformed.data.copy()
    assert editor.editing.undo() == "move points"
    wait(lambda: not editor.is_busy)
    assert target.data[8] == pytest.approx((5, 9, 12))
    assert np.array_equal(editor.deformed.data, ball.values)
    assert editor.editing.undo() == "add points"
    assert len(target.data) == len(editor.pairs.sides["source"].data) == 8
    assert [editor.editing.redo(), editor.editing.redo()] == ["add points", "move points"]
    wait(lambda: not editor.is_busy)
    assert target.data[8] == pytest.approx((5, 12, 12))
    assert np.array_equal(editor.deformed.data, moved)


def test_points_that_cannot_be_fitted_are_refused_and_go_back(
    make_editor: Any, add_volume: Any, ball: dn.Volume, wait: Wait
) -> None:
    editor = make_editor(add_volume(ball))
    said: list[str] = []
    editor.failed.connect(said.append)
    target = editor.pairs.sides["target"]
    target.add([5, 9, 12])
    target.add([5, 4, 6])
    _drag(target, 8, (0, 2, 0))
    data = target.data.copy()
    before = data.copy()
    data[9] = data[8]  # two targets at one place whose sources are not
    target.data = data
    wait(lambda: not editor.is_busy)
    assert len(said) == 1
    assert said[0].startswith("point 9 and point 10 are at the same place (22, -3.5, 42.5)")
    assert np.allclose(target.data, before)


def test_the_slice_follows_a_drag_and_the_rest_comes_at_its_end(
    make_editor: Any, add_volume: Any, viewer: Any, ball: dn.Volume, wait: Wait
) -> None:
    """While napari moves points it emits no event of their data: a refresh of the layer alone."""
    editor = make_editor(add_volume(ball))
    viewer.dims.set_current_step(0, 6)
    target = editor.pairs.sides["target"]
    target.add([6, 9, 12])
    wait(lambda: not editor.is_busy)
    before, document = editor.deformed.data.copy(), editor.editing.deformation
    with target.events.data.blocker():
        target.data[8] = (6, 11, 14)
        target.refresh()
        wait(lambda: not editor.is_busy)
    assert editor.editing.deformation is document
    assert np.array_equal(editor.layer.data, ball.values)  # the slices are written into the result alone
    points = editor.editing.points.move(8, ball.grid.index_to_point([14, 11, 6]))
    expected = dn.Deformation.from_space_points(points).apply(ball).values
    assert np.array_equal(editor.deformed.data[6], expected[6])
    assert np.array_equal(editor.deformed.data[5], before[5])
    assert editor.pairs.lines.data[8, 1] == pytest.approx((0, 2, 2))
    _drag(target, 8, (0, 0, 0))
    wait(lambda: not editor.is_busy)
    assert np.array_equal(editor.deformed.data, expected)


def test_pictures_and_colours_and_labels(make_editor: Any, viewer: Any, wait: Wait) -> None:
    values = np.random.default_rng(5).integers(0, 255, (20, 30, 3), np.uint8)
    photo = viewer.add_image(values, rgb=True, scale=(2, 3))
    editor = make_editor(photo, "space")  # two dimensions: on the picture all the same
    target = editor.pairs.sides["target"]
    target.add([10, 15])
    _drag(target, 4, (3, 2))
    wait(lambda: not editor.is_busy)
    assert editor.editing.points.target[4] == pytest.approx((51, 26))  # (a, b) is right and down
    channels = dn.volume.Channels.from_array(values, kind="rgb")
    grid = dn.Grid((1, 20, 30), (3, 2, 1))
    volumes = [dn.Volume(one.values, grid) for one in channels]
    plane = dn.Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    expected = dn.Deformation.from_picture_points(grid, plane, editor.editing.points)
    for k, volume in enumerate(volumes):
        assert np.array_equal(editor.deformed.data[..., k], expected.apply(volume).values[0])
    editor.close()
    names = viewer.add_labels((values[..., 0] // 50).astype(np.int32), scale=(2, 3))
    editor = make_editor(names, "slice")
    target = editor.pairs.sides["target"]
    target.add([10, 15])
    _drag(target, 4, (3, 2))
    wait(lambda: not editor.is_busy)
    assert isinstance(editor.deformed, Labels)
    labels = dn.Volume(names.data[None], grid, is_labels=True)
    assert np.array_equal(editor.deformed.data, expected.apply(labels).values[0])


@pytest.mark.nightly
def test_settings_of_the_fit(make_editor: Any, add_volume: Any, ball: dn.Volume, wait: Wait) -> None:
    editor = make_editor(add_volume(ball), "slice")
    target = editor.pairs.sides["target"]
    target.add([6, 9, 12])
    _drag(target, 4, (0, 4, 0))
    editor.editing.change(kernel="thin_plate", trend="affine", extrusion="modulate", curve="sin(pi*z)")
    wait(lambda: not editor.is_busy)
    plane = editor.plane
    expected = dn.Deformation.from_picture_points(
        ball, plane, editor.editing.points, kernel="thin_plate", extrusion="modulate", curve="sin(pi*z)"
    ).apply(ball)
    assert np.array_equal(editor.deformed.data, expected.values)
    assert np.array_equal(editor.deformed.data[0], ball.values[0])


def test_steps_are_composed(make_editor: Any, add_volume: Any, viewer: Any, ball: dn.Volume, wait: Wait) -> None:
    editor = make_editor(add_volume(ball), "slice")
    target = editor.pairs.sides["target"]
    target.add([6, 9, 12])
    _drag(target, 4, (0, 4, 0))
    viewer.dims.order = (2, 0, 1)
    editor.add_step()
    target.add([6, 9, 12])
    _drag(target, 4, (1, 1, 0))
    wait(lambda: not editor.is_busy)
    assert [len(step.points) for step in editor.editing.deformation.steps] == [5, 5]
    steps = editor.editing.deformation.steps
    assert steps[0].plane != steps[1].plane
    assert np.array_equal(editor.deformed.data, dn.Deformation(steps).apply(ball).values)
    editor.editing.edit_step(0)
    assert target.data[4, 1:] == pytest.approx((13, 12))
    editor.remove_step()
    with pytest.raises(DeformError, match="only step"):
        editor.remove_step()


def test_layers_deformed_along(make_editor: Any, add_volume: Any, viewer: Any, ball: dn.Volume, wait: Wait) -> None:
    labels = add_volume(dn.Volume((ball.values > 90).astype(np.uint8), ball.grid, "bone", is_labels=True))
    dots = viewer.add_points([[6, 9, 12], [6, 4, 8]], **editor_place(labels), name="dots")
    flat = viewer.add_points([[1.0, 2.0]], name="flat")
    editor = make_editor(add_volume(ball))
    target = editor.pairs.sides["target"]
    target.add([6, 9, 12])
    _drag(target, 8, (0, 3, 2))
    editor.set_others([labels, dots, flat])
    labels.name = "bones"  # while it is computed
    results: list[Any] = []
    editor.finished.connect(results.append)
    wait(lambda: not editor.is_busy)
    document = editor.editing.deformation
    bone, moved = editor.others[labels], editor.others[dots]
    assert np.array_equal(bone.data, document.apply(dn.interop.from_napari(labels)).values)
    assert moved.data[0] == pytest.approx((6, 12, 14), abs=1e-3)
    assert moved.name == "dots deformed"
    assert editor.others[flat] is None
    text, is_warning = describe(editor, results[-1])
    assert is_warning
    assert "The layer 'flat' has 2 dimensions and the deformed one 3" in text
    _drag(target, 8, (0, 1, 0))
    wait(lambda: not editor.is_busy)
    assert editor.others[dots] is moved
    assert moved.data[0] == pytest.approx((6, 13, 14), abs=1e-3)
    editor.set_others([])
    assert bone not in viewer.layers
    assert moved not in viewer.layers


def editor_place(layer: Any) -> dict[str, Any]:
    return {name: getattr(layer, name) for name in ("scale", "translate", "units")}


@pytest.mark.nightly
def test_a_document_is_saved_and_opened(
    make_editor: Any, add_volume: Any, ball: dn.Volume, wait: Wait, tmp_path: Path
) -> None:
    editor = make_editor(add_volume(ball), "slice")
    target = editor.pairs.sides["target"]
    target.add([6, 9, 12])
    _drag(target, 4, (0, 4, 0))
    wait(lambda: not editor.is_busy)
    editor.save(tmp_path / "bend.json")
    document = dn.read_deformation(tmp_path / "bend.json")
    assert np.array_equal(document.apply(ball).values, editor.deformed.data)
    assert document.volume is not None
    assert document.volume.matches(ball)
    script = editor.script()
    assert "dn.Deformation.from_picture_points" in script
    editor.editing.reset()
    wait(lambda: not editor.is_busy)
    assert np.array_equal(editor.deformed.data, ball.values)
    assert editor.open(tmp_path / "bend.json") == ""
    wait(lambda: not editor.is_busy)
    assert target.data[4, 1:] == pytest.approx((13, 12))
    assert np.array_equal(editor.deformed.data, document.apply(ball).values)
    editor.close()
    other = make_editor(add_volume(dn.Volume(ball.values[:, ::-1].copy(), ball.grid)))
    assert "made on another volume" in other.open(tmp_path / "bend.json")


def test_removed_layers_end_what_needs_them_and_no_thread_is_left(
    make_editor: Any, add_volume: Any, viewer: Any, ball: dn.Volume, wait: Wait
) -> None:
    threads = Threads()
    layer = add_volume(ball)
    for which in ("layer", "source", "target"):
        editor = make_editor(layer)
        reasons: list[str] = []
        editor.ended.connect(reasons.append)
        editor.pairs.sides["target"].add([6, 9, 12])
        _drag(editor.pairs.sides["target"], 8, (0, 1, 0))  # it computes while the layer goes
        deformed, own = editor.deformed, editor.pairs.layers
        gone = layer if which == "layer" else editor.pairs.sides[which]
        viewer.layers.remove(gone)
        assert editor.is_closed
        assert len(reasons) == 1
        assert gone.name in reasons[0]
        assert not set(own) & set(viewer.layers)
        assert deformed in viewer.layers
        if which == "layer":
            viewer.layers.append(layer)
    threads.wait()


@pytest.mark.nightly
def test_results_that_are_removed_are_not_computed(
    make_editor: Any, add_volume: Any, viewer: Any, ball: dn.Volume, wait: Wait
) -> None:
    editor = make_editor(add_volume(ball))
    editor.set_cells(6)
    wait(lambda: not editor.is_busy)
    assert len(editor.overlay.data) > 20
    viewer.layers.remove(editor.overlay)
    viewer.layers.remove(editor.deformed)
    assert (editor.cells, editor.is_live) == (0, False)
    editor.pairs.sides["target"].add([6, 9, 12])
    wait(lambda: not editor.is_busy)
    assert editor.deformed is None
    editor.set_live(True)
    wait(lambda: not editor.is_busy)
    assert editor.deformed in viewer.layers
    editor.set_live(False)
    assert editor.deformed is None


@pytest.mark.nightly
def test_other_voxels_in_the_layer_are_deformed_and_another_place_ends_it(
    make_editor: Any, add_volume: Any, ball: dn.Volume, wait: Wait
) -> None:
    layer = add_volume(ball)
    editor = make_editor(layer)
    editor.pairs.sides["target"].add([6, 9, 12])
    _drag(editor.pairs.sides["target"], 8, (0, 3, 0))
    layer.data = ball.values[:, :, ::-1].copy()
    wait(lambda: not editor.is_busy)
    assert np.array_equal(
        editor.deformed.data, editor.editing.deformation.apply(dn.Volume(layer.data, ball.grid)).values
    )
    reasons: list[str] = []
    editor.ended.connect(reasons.append)
    layer.scale = (1, 1, 1)
    assert "was moved or scaled" in reasons[0]


@pytest.mark.nightly
def test_a_cancelled_computation_leaves_the_layers(
    make_editor: Any, add_volume: Any, ball: dn.Volume, wait: Wait
) -> None:
    editor = make_editor(add_volume(ball))
    before = editor.deformed.data.copy()
    editor.pairs.sides["target"].add([6, 9, 12])
    wait(lambda: not editor.is_busy)
    _drag(editor.pairs.sides["target"], 8, (0, 3, 0))
    editor.cancel()
    assert not editor.is_busy
    wait(lambda: True)
    assert np.array_equal(editor.deformed.data, before)
    editor.compute()
    wait(lambda: not editor.is_busy)
    assert not np.array_equal(editor.deformed.data, before)


@pytest.mark.nightly
def test_pairs_of_two_layers_are_taken(make_editor: Any, add_volume: Any, viewer: Any, ball: dn.Volume) -> None:
    editor = make_editor(add_volume(ball))
    a = viewer.add_points([[42.5, -6.5, 22.0]], units=("mm",) * 3)
    b = viewer.add_points([[45.0, -3.5, 25.0], [1, 1, 1]], units=("mm",) * 3)
    with pytest.raises(DeformError, match="have 1 and 2 points"):
        editor.add_landmarks(a, b)
    b.data = b.data[:1]
    editor.add_landmarks(a, b)
    assert editor.pairs.sides["source"].data[8] == pytest.approx((5, 9, 12))
    assert editor.pairs.sides["target"].data[8] == pytest.approx((6, 11, 15))


def test_a_volume_that_is_shown_whole_has_no_slice_to_draw_on(
    make_editor: Any, add_volume: Any, viewer: Any, ball: dn.Volume, wait: Wait
) -> None:
    layer = add_volume(ball)
    viewer.dims.ndisplay = 3
    with pytest.raises(DeformError, match="show it in two dimensions"):
        LayerEditor(viewer, layer, "slice")
    editor = make_editor(layer)
    target = editor.pairs.sides["target"]
    target.add([6, 9, 12])
    wait(lambda: not editor.is_busy)
    with target.events.data.blocker():
        target.data[8] = (6, 11, 14)
        target.refresh()
        wait(lambda: not editor.is_busy)
    points = editor.editing.points.move(8, ball.grid.index_to_point([14, 11, 6]))
    assert np.array_equal(editor.deformed.data, dn.Deformation.from_space_points(points).apply(ball).values)

"""The widget in a real viewer: what napari finds, real presses of the mouse, files, and what users are told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from waiting import Threads

import deformnb as dn
from napari_deformnb.widget import DeformVolumeWidget

Wait = Callable[[Callable[[], Any]], None]
MANIFEST = Path(__file__).resolve().parents[2] / "napari-deformnb" / "napari_deformnb" / "napari.yaml"


@pytest.fixture
def widget(viewer: Any) -> Any:
    made = DeformVolumeWidget(viewer)
    yield made
    made.stop()
    made.close()
    made.deleteLater()


def _rest(widget: DeformVolumeWidget, wait: Wait) -> None:
    wait(lambda: widget.editor is None or not widget.editor.is_busy)


def test_the_manifest_is_valid_and_names_what_there_is() -> None:
    npe2 = pytest.importorskip("npe2")
    manifest = npe2.PluginManifest.from_file(MANIFEST)
    manifest.validate_imports()
    stated = yaml.safe_load(MANIFEST.read_text(encoding="utf-8"))["contributions"]
    commands = {row["id"] for row in stated["commands"]}
    used = [row["command"] for key in ("widgets", "readers", "writers", "sample_data") for row in stated[key]]
    used += [row["command"] for rows in stated["menus"].values() for row in rows]
    assert set(used) == commands


@pytest.mark.parametrize("viewer", [True], indirect=True)
def test_a_point_is_dragged_by_the_mouse(
    viewer: Any, widget: DeformVolumeWidget, add_volume: Any, ball: dn.Volume, wait: Wait
) -> None:
    from qtpy.QtCore import QPoint, Qt
    from qtpy.QtTest import QTest
    from qtpy.QtWidgets import QApplication, QWidget

    layer = add_volume(ball)
    viewer.window.resize(1000, 700)
    widget.start(layer, "slice")
    _rest(widget, wait)
    editor = widget.editor
    assert editor is not None
    target = editor.pairs.sides["target"]
    viewer.reset_view()
    camera = getattr(viewer, "scene", viewer).camera  # napari 0.9 has moved it
    widgets = [one for one in QApplication.allWidgets() if one.isVisible()]
    canvas = next(one for one in widgets if type(one).__name__.startswith("CanvasBackend"))
    assert isinstance(canvas, QWidget)

    def pixel(index: tuple[float, float]) -> QPoint:
        place = np.array(layer.data_to_world((0, *index)))[1:]
        away = (place - np.array(camera.center)[1:]) * camera.zoom
        return QPoint(round(canvas.width() / 2 + away[1]), round(canvas.height() / 2 + away[0]))

    wait(lambda: canvas.width() > 200)
    target.mode = "add"
    QTest.mouseMove(canvas, pixel((9, 12)))
    QTest.mouseClick(canvas, Qt.MouseButton.LeftButton, pos=pixel((9, 12)))
    wait(lambda: len(target.data) == 5)
    _rest(widget, wait)
    start = target.data[4].copy()
    assert start[1:] == pytest.approx((9, 12), abs=0.2)
    before = editor.deformed.data.copy()
    target.mode = "select"
    QTest.mouseMove(canvas, pixel((9, 12)))
    QTest.mousePress(canvas, Qt.MouseButton.LeftButton, pos=pixel((9, 12)))
    document = editor.editing.deformation
    for share in (0.25, 0.5, 0.75, 1.0):
        QTest.mouseMove(canvas, pixel((9 + 4 * share, 12 + 3 * share)))
        wait(lambda: True)
    wait(lambda: not np.array_equal(editor.deformed.data, before))  # the result follows while the button is down
    assert editor.editing.deformation is document
    position = editor.visible_part().position
    assert np.array_equal(np.delete(editor.deformed.data, position, axis=0), np.delete(before, position, axis=0))
    QTest.mouseRelease(canvas, Qt.MouseButton.LeftButton, pos=pixel((13, 15)))
    wait(lambda: editor.editing.deformation is not document)
    _rest(widget, wait)
    assert target.data[4][1:] == pytest.approx((13, 15), abs=0.3)
    assert editor.pairs.sides["source"].data[4] == pytest.approx(start)
    assert editor.editing.history["undo"] == "move points"
    expected = editor.editing.deformation.apply(ball)
    assert np.array_equal(editor.deformed.data, expected.values)
    assert "1 dragged. The map has no folds." in widget.status.text()


def test_settings_are_those_of_the_package(
    widget: DeformVolumeWidget, add_volume: Any, ball: dn.Volume, wait: Wait
) -> None:
    for name, names in (("kernel", dn.rbf.KERNELS), ("trend", dn.rbf.TRENDS), ("extrusion", dn.rbf.EXTRUSIONS)):
        menu = widget.menus[name]
        assert [menu.itemData(k) for k in range(menu.count())] == list(names)
    layer = add_volume(ball)
    widget.start(layer, "slice")
    editor = widget.editor
    assert editor is not None
    editor.pairs.sides["target"].add([6, 9, 12])
    widget.menus["kernel"].setCurrentIndex(widget.menus["kernel"].findData("thin_plate"))
    widget.menus["extrusion"].setCurrentIndex(widget.menus["extrusion"].findData("modulate"))
    widget.curve.setText("sin(pi*z)")
    widget.curve.editingFinished.emit()
    widget.numbers["stages"].setValue(3)
    widget.numbers["smoothing"].setValue(0.25)
    step = editor.editing.step
    assert (step.kernel, step.extrusion, step.curve) == ("thin_plate", "modulate", "sin(pi*z)")
    assert (step.stages, step.smoothing) == (3, 0.25)
    widget.menus["kernel"].setCurrentIndex(widget.menus["kernel"].findData("wendland_c4"))
    assert editor.editing.step.support is None
    widget.automatic.setChecked(False)
    widget.support.setValue(12.5)
    assert editor.editing.step.support == 12.5
    widget.automatic.setChecked(True)
    assert editor.editing.step.support is None
    assert widget.undo_button.isEnabled()
    widget.undo_button.click()
    assert editor.editing.step.support == 12.5
    widget.reset_button.click()
    assert len(editor.editing.points) == 4
    _rest(widget, wait)


def test_wrong_inputs_are_told_in_a_sentence(
    widget: DeformVolumeWidget, viewer: Any, add_volume: Any, ball: dn.Volume, messages: list[str], wait: Wait
) -> None:
    widget.start()
    assert messages[-1].startswith("There is no image and there are no labels to deform")
    time = viewer.add_image(np.zeros((2, 3, 4, 5)), name="film")
    widget.start(time, "space")
    assert messages[-1].startswith("The layer 'film' has 4 dimensions, and 2 or 3 can be deformed")
    assert widget.editor is None
    viewer.layers.clear()
    layer = add_volume(ball)
    viewer.dims.ndisplay = 3
    widget.start(layer, "slice")
    assert "show it in two dimensions" in messages[-1]
    viewer.dims.ndisplay = 2
    widget.start(layer, "slice")
    editor = widget.editor
    assert editor is not None
    widget.curve.setText("nonsense(z)")
    widget.menus["extrusion"].setCurrentIndex(widget.menus["extrusion"].findData("modulate"))
    widget.curve.setText("nonsense(z)")
    widget.curve.editingFinished.emit()
    assert "nonsense" in messages[-1]
    assert editor.editing.step.curve == "z"
    assert widget.curve.text() == "z"
    widget.pair_button.click()
    assert messages[-1].startswith("Select two layers of points")
    widget.open_session("missing.json")
    assert "missing.json" in messages[-1]
    widget.live.setChecked(False)
    widget.save_deformed("a.nii.gz")
    assert messages[-1].startswith("There is no deformed layer")
    viewer.layers.remove(layer)
    assert messages[-1].startswith("The layer 'ball' was removed")
    assert widget.editor is None
    assert not widget.body.isEnabled()


def test_folds_are_shown_as_a_warning(widget: DeformVolumeWidget, add_volume: Any, ball: dn.Volume, wait: Wait) -> None:
    widget.start(add_volume(ball), "slice")
    editor = widget.editor
    assert editor is not None
    target = editor.pairs.sides["target"]
    target.add([6, 9, 12])
    widget.automatic.setChecked(False)
    widget.support.setValue(8)
    data = target.data.copy()
    data[4] += (0, 0, 9)
    target.data = data
    _rest(widget, wait)
    wait(lambda: "The map folds: det J is -" in widget.status.text())
    assert "color" in widget.status.styleSheet()


def test_files_by_the_widget(
    widget: DeformVolumeWidget, viewer: Any, add_volume: Any, ball: dn.Volume, wait: Wait, tmp_path: Path
) -> None:
    layer = add_volume(ball)
    widget.start(layer, "slice")
    editor = widget.editor
    assert editor is not None
    target = editor.pairs.sides["target"]
    target.add([6, 9, 12])
    data = target.data.copy()
    data[4] += (0, 3, 2)
    target.data = data
    _rest(widget, wait)
    widget.save_session(tmp_path / "bend.json")
    widget.save_script(tmp_path / "bend.py")
    widget.save_deformed(str(tmp_path / "bent.nii.gz"))
    widget.save_deformed(str(tmp_path / "bent.tif"))
    expected = dn.read_deformation(tmp_path / "bend.json").apply(ball)
    found = dn.read_volume(tmp_path / "bent.nii.gz")
    assert np.array_equal(found.values, expected.values)
    assert found.grid.is_like(ball.grid)
    assert np.array_equal(dn.read_volume(tmp_path / "bent.tif").values, expected.values)
    compile((tmp_path / "bend.py").read_text(encoding="utf-8"), "bend.py", "exec")
    widget.stop()
    assert [one.name for one in viewer.layers] == ["ball", "ball deformed"]
    widget.start(layer, "slice")
    widget.open_session(tmp_path / "bend.json")
    _rest(widget, wait)
    assert widget.editor is not None
    assert np.array_equal(widget.editor.deformed.data, expected.values)


def test_the_lists_follow_the_layers(
    widget: DeformVolumeWidget, viewer: Any, add_volume: Any, ball: dn.Volume, wait: Wait
) -> None:
    layer = add_volume(ball)
    dots = viewer.add_points([[6, 9, 12]], name="dots")
    assert [widget.layer_menu.itemText(k) for k in range(widget.layer_menu.count())] == ["ball"]
    widget.start(layer, "space")
    assert [widget.others.item(k).text() for k in range(widget.others.count())] == ["dots (points)"]
    from qtpy.QtCore import Qt

    widget.others.item(0).setCheckState(Qt.CheckState.Checked)
    _rest(widget, wait)
    assert widget.editor is not None
    assert list(widget.editor.others) == [dots]
    assert "dots deformed" in [one.name for one in viewer.layers]
    widget.cells.setValue(8)
    _rest(widget, wait)
    assert "ball: grid" in [one.name for one in viewer.layers]
    assert [widget.others.item(k).text() for k in range(widget.others.count())] == ["dots (points)"]
    layer.name, dots.name = "blob", "marks"
    assert widget.layer_menu.currentText() == "blob"
    assert [widget.others.item(k).text() for k in range(widget.others.count())] == ["marks (points)"]
    widget.editor.add_step()
    assert widget.step_menu.count() == 2
    widget.step_menu.setCurrentIndex(0)
    assert widget.editor.editing.index == 0
    widget.remove_step_button.click()
    assert widget.step_menu.count() == 1
    _rest(widget, wait)


def test_a_closed_window_ends_the_thread(add_volume: Any, viewer: Any, ball: dn.Volume, wait: Wait) -> None:
    threads = Threads()
    _, widget = viewer.window.add_plugin_dock_widget("napari-deformnb", "Deform volume")
    widget.start(add_volume(ball), "space")
    wait(lambda: not widget.editor.is_busy)
    assert threads.alive
    viewer.window.remove_dock_widget(widget)
    wait(lambda: widget.editor is None)
    threads.wait()


def test_a_new_start_continues_where_the_layer_is_as_it_was(
    widget: DeformVolumeWidget, add_volume: Any, ball: dn.Volume, messages: list[str], wait: Wait
) -> None:
    layer = add_volume(ball)
    widget.start(layer, "space")
    assert widget.editor is not None
    widget.editor.pairs.sides["target"].add([6, 9, 12])
    points = widget.editor.editing.points
    widget.stop()
    widget.start(layer, "space")
    assert widget.editor is not None
    assert widget.editor.editing.points == points
    scale = layer.scale
    layer.scale = (1, 1, 1)
    assert "was moved or scaled" in messages[-1]
    assert widget.editor is None
    widget.start(layer, "space")
    assert widget.editor is not None
    assert len(widget.editor.editing.points) == 8
    widget.stop()
    layer.scale = scale
    widget.start(layer, "slice")
    assert widget.editor is not None
    assert len(widget.editor.editing.points) == 4
    _rest(widget, wait)

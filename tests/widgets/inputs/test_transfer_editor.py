"""The transfer editor without a browser: histogram, presets, and messages of the front end."""

from __future__ import annotations

import base64
import io
import json
import threading
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from PIL import Image
from scripts import run_script
from waiting import PATIENCE, Threads

from deformnb.datasets import PHANTOMS
from deformnb.errors import DeformError
from deformnb.session.session import Session
from deformnb.volume.transfer import PRESETS, TransferFunction, levels, preset
from deformnb.volume.volume import Volume
from deformnb.widgets import LiveView, TransferEditor
from deformnb.widgets.inputs.transfer_editor import display_histogram
from deformnb.widgets.studio.controls import DisplayPanel
from deformnb.widgets.worker import Worker


@pytest.fixture
def volume() -> Volume:
    return PHANTOMS["fish"].make((24, 48, 24))


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    messages: list[Any] = []
    monkeypatch.setattr(TransferEditor, "send", lambda self, content, buffers=None: messages.append(content))
    return messages


def receive(editor: TransferEditor, value: Any, phase: str = "end") -> None:
    content = {"type": "edit", "seq": 1, "view": "v", "phase": phase, "value": value}
    deliver(editor, json.loads(json.dumps(content)))


# ---- histogram -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "bins", "first", "last"),
    [
        (np.arange(200, dtype=np.uint8), 200, 0, 199),
        (np.arange(200, dtype=np.int16) * 16 - 1000, 200, -1000, 2184),  # 12 bits in 16
        ((np.arange(200) / 255).astype(np.float32), 200, 0, 199 / 255),  # former bytes
        (np.arange(4000, dtype=np.int32), 999, 0, 3995),  # four values to a bin, but for the very brightest
    ],
)
def test_bins_hold_whole_steps_so_that_none_is_empty(values: Any, bins: int, first: float, last: float) -> None:
    volume = Volume.from_array(np.stack([values.reshape(-1, 20)] * 4).repeat(2, 1).repeat(2, 2))
    found, extent = display_histogram(volume)
    assert len(found.counts) == bins
    assert len(set(found.counts.tolist())) == 1
    np.testing.assert_allclose(extent, (first, last), rtol=1e-6)


def test_two_values_in_a_slice_are_no_step() -> None:
    values = np.zeros((9, 20, 20), np.uint8)
    values[:, 8:12] = 150
    values[0, 0, :9] = np.arange(9) * 7
    found, _ = display_histogram(Volume.from_array(values))
    assert len(found.counts) > 140
    assert found.counts[[0, 7, 150]].tolist() == [9 * 16 * 20 - 8, 1, 9 * 4 * 20]


def test_a_few_voxels_of_metal_do_not_press_the_rest_together() -> None:
    values = np.random.default_rng(1).integers(0, 200, (40, 60, 60)).astype(np.int16)
    values[20, 30, 30:32] = 2000
    found, (first, last) = display_histogram(Volume.from_array(values))
    assert (first, last < 300) == (0, True)
    assert found.counts.sum() == values.size - 2


def test_air_does_not_flatten_the_rest() -> None:
    values = np.zeros((20, 100, 100), np.uint8)
    values[5:10, 40:50, 40:50] = np.arange(100, 200, dtype=np.uint8).reshape(10, 10)
    heights = TransferEditor(Volume.from_array(values)).histogram["heights"]
    assert heights[0] == 1.0
    assert heights[150] == pytest.approx(np.log1p(5) / np.log1p(199500), abs=1e-3)
    assert heights[50] == 0.0


@pytest.mark.parametrize(
    "values",
    [
        np.zeros((2, 3, 4), np.uint8),
        np.full((1, 1, 1), -7.5),
        np.ones((2, 2, 2), bool),
        np.full((3, 3, 3), np.nan, np.float32),
    ],
)
def test_a_constant_volume_has_a_plot(values: Any) -> None:
    editor = TransferEditor(Volume.from_array(values))
    low, high = editor.histogram["low"], editor.histogram["high"]
    assert low < high
    assert max(editor.histogram["heights"]) == 1.0
    json.dumps(editor.shown, allow_nan=False)


def test_a_large_volume_is_sampled_and_says_so() -> None:
    values = np.broadcast_to(np.arange(100, dtype=np.uint8).reshape(10, 10), (60, 10, 10))
    assert TransferEditor(Volume.from_array(values)).histogram["note"] == "30 of 60 slices"
    assert TransferEditor(Volume.from_array(values[:40])).histogram["note"] == ""


# ---- transfer functions ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", list(PRESETS))
def test_presets_fit_the_volume(volume: Volume, name: str) -> None:
    editor = TransferEditor(volume)
    editor.preset(name)
    assert editor.transfer == preset(name, volume)
    assert editor.shown["preset"] == name
    assert editor.shown["nodes"] == [list(node) for node in preset(name, volume).opacities]
    low, high = editor.shown["range"]
    assert all(low <= v <= high for v, _ in editor.transfer.opacities)
    assert repr(editor).endswith(f", {name!r})")


def test_another_volume_keeps_the_preset_or_the_nodes(volume: Volume) -> None:
    other = Volume.from_array(np.asarray(volume.values) * 2.0)
    editor = TransferEditor(volume, "bone")
    editor.volume = other
    assert editor.transfer == preset("bone", other)
    mine = editor.transfer.with_opacities([(levels(other)[1], 0.0), (levels(other)[2], 0.7)])
    editor.transfer = mine
    editor.volume = volume
    assert editor.transfer == mine
    assert editor.shown["preset"] == ""
    assert editor.shown["range"][1] >= mine.opacities[1][0]  # a node beyond the values is still seen


def test_other_things_are_refused(volume: Volume) -> None:
    editor = TransferEditor(volume, "bone")
    with pytest.raises(DeformError, match="choose one of specimen"):
        editor.preset("wood")
    with pytest.raises(DeformError, match="must be a TransferFunction, got str"):
        editor.transfer = "bone"
    assert editor.shown["preset"] == "bone"


def test_dragging_a_node_changes_the_opacities_alone(volume: Volume, sent: list[Any]) -> None:
    editor = TransferEditor(volume, "xray")
    before, heard = editor.transfer, []
    editor.on_edit(lambda *given: heard.append(given))
    moved = [[0, 0], [50.5, 0.25], [90, 1]]
    receive(editor, {"nodes": moved}, "move")
    assert editor.transfer is before
    receive(editor, {"nodes": moved})
    wanted = TransferFunction(before.colors, ((0, 0), (50.5, 0.25), (90, 1)), before.unit)
    assert heard == [(wanted, "move"), (wanted, "end")]
    assert editor.transfer == wanted
    assert editor.shown["nodes"] == moved
    assert editor.shown["preset"] == ""
    assert repr(editor).endswith("3 nodes)")
    receive(editor, {"preset": "surface"})
    assert editor.transfer == preset("surface", volume)
    assert [m["type"] for m in sent] == ["done"] * 3


@pytest.mark.parametrize(
    "value",
    [
        {},
        [],
        {"nodes": []},
        {"nodes": [[1, 0], [0, 0]]},
        {"nodes": [[0, -0.1]]},
        {"nodes": [[0, 1.1]]},
        {"nodes": [[0, None]]},
        {"nodes": [[0, 0]] * 65},
        {"preset": "wood"},
        {"preset": 3},
        {"preset": ["bone"]},
        {"colors": []},
        {"colors": None},
        {"colors": [[0, "#ff0000"]] * 65},
        {"colors": [[0, "red"]]},
        {"colors": [[0, 3]]},
        {"colors": [[0, "#ff0000", 1]]},
        {"colors": [["0", "#ff0000"]]},
        {"colors": [[None, "#ff0000"]]},
        {"colors": [[9, "#ff0000"], [0, "#ff0000"]]},
        {"colors": [[0, "#ff00001"]]},
        {"colors": [[0, "url(x)"]]},
        {"window": None},
        {"window": [0]},
        {"window": [0, 1, 2]},
        {"window": [1, 1]},
        {"window": [2, 1]},
        {"window": ["0", 1]},
        {"window": [0, 1e301]},
        {"window": [0, True]},
    ],
)
def test_wrong_opacities_are_refused_and_answered(volume: Volume, value: Any, sent: list[Any]) -> None:
    editor = TransferEditor(volume)
    before = editor.transfer
    receive(editor, value)
    assert editor.transfer is before
    assert [m["type"] for m in sent] == ["error", "done"]
    assert "callback" not in sent[0]["message"]


def test_dragging_a_stop_changes_the_colours_alone(volume: Volume, sent: list[Any]) -> None:
    editor = TransferEditor(volume, "xray")
    before, heard = editor.transfer, []
    editor.on_edit(lambda *given: heard.append(given))
    stops = [[-3, "#000000"], [50.5, "#ff8000"], [90, "#FFFFFF"]]
    receive(editor, {"colors": stops}, "move")
    assert editor.transfer is before
    receive(editor, {"colors": stops})
    assert editor.transfer == before.with_colors(stops)  # type: ignore[arg-type]
    assert editor.transfer.colors[1] == (50.5, 1.0, 128 / 255, 0.0)
    assert (editor.transfer.opacities, editor.transfer.unit) == (before.opacities, before.unit)
    assert [phase for _, phase in heard] == ["move", "end"]
    assert editor.shown["colors"][2] == [90.0, 1.0, 1.0, 1.0]
    assert (editor.shown["preset"], editor.shown["back"]) == ("", "xray")
    assert editor.shown["range"][0] == -3.0  # a stop beyond the values is still seen
    receive(editor, {"preset": "xray"})
    assert (editor.transfer, editor.shown["preset"]) == (before, "xray")


def test_a_window_takes_nodes_and_colours_along(volume: Volume, sent: list[Any]) -> None:
    editor = TransferEditor(volume, "specimen")
    before = editor.transfer
    receive(editor, {"window": [-10, 20]}, "move")
    receive(editor, {"window": [40, 60]})
    assert editor.transfer == before.windowed(40, 60)
    assert editor.transfer.window == (40, 60)
    assert (editor.shown["nodes"][0][0], editor.shown["nodes"][-1][0]) == (40, 60)
    assert [m["type"] for m in sent] == ["done"] * 2


def test_nodes_at_one_value_cannot_be_stretched(volume: Volume, sent: list[Any]) -> None:
    editor = TransferEditor(volume, TransferFunction(((5, 1, 1, 1),), ((5, 0.5),)))
    receive(editor, {"window": [0, 1]})
    assert "no width" in sent[0]["message"]
    assert editor.shown["back"] == ""


def test_a_node_for_a_step_may_share_its_value(volume: Volume, sent: list[Any]) -> None:
    editor = TransferEditor(volume)
    receive(editor, {"nodes": [[0, 0], [40, 0], [40, 1]]})
    assert editor.transfer.opacities == ((0, 0), (40, 0), (40, 1))


# ---- thumbnails ------------------------------------------------------------------------------------------------------


def thumbnail_images(editor: TransferEditor) -> dict[str, Any]:
    return {
        name: np.asarray(Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2]))))
        for name, url in editor.thumbnails.items()
    }


def test_each_preset_has_a_picture_of_the_volume(volume: Volume) -> None:
    worker = Worker()
    editor = TransferEditor(volume, worker=worker)
    worker.latest("behind it", (done := threading.Event()).set)
    assert done.wait(PATIENCE)
    made = thumbnail_images(editor)
    assert list(made) == list(PRESETS) == list(editor.presets)
    editor.volume = Volume.from_array(np.asarray(volume.values)[:, ::-1])
    assert editor.thumbnails == {}  # never those of another volume
    worker.latest("behind it", (again := threading.Event()).set)
    assert again.wait(PATIENCE)
    assert any((thumbnail_images(editor)[name] != made[name]).any() for name in PRESETS)
    worker.close()
    editor.volume = volume  # as a studio that is closed
    assert editor.thumbnails == {}


def test_the_thread_of_a_lone_editor_ends_with_its_pictures(volume: Volume) -> None:
    threads, made = Threads(), threading.Event()
    editor = TransferEditor(volume)
    editor.observe(lambda _change: made.set(), "thumbnails")
    if not editor.thumbnails:
        assert made.wait(PATIENCE)
    threads.wait()


# ---- scripts ---------------------------------------------------------------------------------------------------------


def test_the_page_stretches_a_window_as_python_does() -> None:
    function = preset("specimen", PHANTOMS["fish"].make((24, 48, 24)))
    main = """({ nodes, stops, to }) => { const from = windowOf(nodes, stops);
        return [from, ...[nodes, stops].map((rows) => rows.map(([v]) => stretchValue(v, from, to)))]; }"""
    window, nodes, stops = run_script(
        ("inputs/transfer_rows.ts",),
        main,
        {"nodes": function.opacities, "stops": function.colors, "to": [-12.5, 31.7]},
    )
    assert tuple(window) == function.window
    wanted = function.windowed(-12.5, 31.7)
    np.testing.assert_allclose(nodes, [v for v, _ in wanted.opacities], atol=1e-12)
    np.testing.assert_allclose(stops, [v for v, *_ in wanted.colors], atol=1e-12)
    assert (nodes[0], nodes[-1]) == (-12.5, 31.7)


def test_the_panel_of_the_look_gives_it_one_width_whatever_it_says(volume: Volume) -> None:
    editor = TransferEditor(volume)
    panel = DisplayPanel(Session(volume), lambda action: bool(action() or True), LiveView(volume), editor)
    place = next(box for box in panel.box.children[0].children if editor in box.children)
    assert "widget-vbox" in place.classes  # stretches its children; a Box would be as wide as the words below the plot
    assert place.data([])["style"]["max-width"] == "720px"
    panel.close()

"""The transfer editor without a browser: histogram, presets, and what the page may say."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from deformnb.datasets import PHANTOMS
from deformnb.errors import DeformError
from deformnb.transfer import PRESETS, TransferFunction, levels, preset
from deformnb.volume import Volume
from deformnb.widgets import TransferEditor
from deformnb.widgets.transfer_editor import shown_histogram


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
    editor._handle_custom_msg(json.loads(json.dumps(content)), [])


# ---- histogram -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("values", "bins", "first", "last"), [
    (np.arange(200, dtype=np.uint8), 200, 0, 199),
    (np.arange(200, dtype=np.int16) * 16 - 1000, 200, -1000, 2184),  # 12 bits in 16
    ((np.arange(200) / 255).astype(np.float32), 200, 0, 199 / 255),  # what was once bytes
    (np.arange(1000, dtype=np.int32), 250, 0, 999),  # four values to a bin
])
def test_bins_hold_whole_steps_so_that_none_is_empty(values: Any, bins: int, first: float, last: float) -> None:
    volume = Volume.from_array(np.stack([values.reshape(-1, 20)] * 4).repeat(2, 1).repeat(2, 2))
    found, extent = shown_histogram(volume)
    assert len(found.counts) == bins
    assert len(set(found.counts.tolist())) == 1
    np.testing.assert_allclose(extent, (first, last), rtol=1e-6)


def test_two_values_in_a_slice_are_no_step() -> None:
    values = np.zeros((9, 20, 20), np.uint8)
    values[:, 8:12] = 150
    values[0, 0, :9] = np.arange(9) * 7
    found, _ = shown_histogram(Volume.from_array(values))
    assert len(found.counts) > 140
    assert found.counts[[0, 7, 150]].tolist() == [9 * 16 * 20 - 8, 1, 9 * 4 * 20]


def test_a_few_voxels_of_metal_do_not_press_the_rest_together() -> None:
    values = np.random.default_rng(1).integers(0, 200, (40, 60, 60)).astype(np.int16)
    values[20, 30, 30:32] = 2000
    found, (first, last) = shown_histogram(Volume.from_array(values))
    assert (first, last < 300) == (0, True)
    assert found.counts.sum() == values.size - 2


def test_air_does_not_flatten_the_rest() -> None:
    values = np.zeros((20, 100, 100), np.uint8)
    values[5:10, 40:50, 40:50] = np.arange(100, 200, dtype=np.uint8).reshape(10, 10)
    heights = TransferEditor(Volume.from_array(values)).histogram["heights"]
    assert heights[0] == 1.0
    assert heights[150] == pytest.approx(np.log1p(5) / np.log1p(199500), abs=1e-3)
    assert heights[50] == 0.0


@pytest.mark.parametrize("values", [np.zeros((2, 3, 4), np.uint8), np.full((1, 1, 1), -7.5), np.ones((2, 2, 2), bool),
                                    np.full((3, 3, 3), np.nan, np.float32)])
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


@pytest.mark.parametrize("value", [
    {}, [], {"nodes": []}, {"nodes": [[1, 0], [0, 0]]}, {"nodes": [[0, -0.1]]}, {"nodes": [[0, 1.1]]},
    {"nodes": [[0, None]]}, {"nodes": [[0, 0]] * 65}, {"preset": "wood"}, {"preset": 3}, {"preset": ["bone"]},
])
def test_wrong_opacities_are_refused_and_answered(volume: Volume, value: Any, sent: list[Any]) -> None:
    editor = TransferEditor(volume)
    before = editor.transfer
    receive(editor, value)
    assert editor.transfer is before
    assert [m["type"] for m in sent] == ["error", "done"]
    assert "callback" not in sent[0]["message"]


def test_a_node_for_a_step_may_share_its_value(volume: Volume, sent: list[Any]) -> None:
    editor = TransferEditor(volume)
    receive(editor, {"nodes": [[0, 0], [40, 0], [40, 1]]})
    assert editor.transfer.opacities == ((0, 0), (40, 0), (40, 1))

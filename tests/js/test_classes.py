"""Classes of the front end are small, hold parts, and give each of them the few things that it uses."""

from __future__ import annotations

import json
import subprocess
from functools import cache
from typing import Any

import numpy as np
import pytest

import node_tasks

MOST_METHODS, MOST_ATTRIBUTES, MOST_NAMES = 30, 15, 12

# Classes that are larger: these figures only fall.
LARGE_CLASSES = {
    "inputs/curve_plot.ts:CurvePlot": (35, 19),
    "inputs/player.ts:PlayerView": (17, 21),
    "inputs/points_table.ts:PointsTableView": (50, 37),
    "inputs/transfer_editor.ts:TransferEditorView": (38, 21),
    "sync/edits.ts:Sender": (31, 22),
    "view/render_loop.ts:FrameLoop": (27, 29),
    "view/space_points.ts:SpacePoints": (28, 22),
    "webgl/raycaster.ts:RayCaster": (28, 25),
}

# Parts that are given their owner, and methods that only call another of the same arguments: none is added.
GIVEN_OWNERS = {
    "ColorStops of TransferEditorView",
    "MoreMenu of Toolbar",
    "PresetButtons of TransferEditorView",
    "WindowBar of TransferEditorView",
}
FORWARDS: set[str] = set()

# What parts use of the editor, where it is more than a dozen names: these figures only fall.
LARGE_INTERFACES = {
    "KeysEditor": 16,
    "NodesEditor": 14,
    "PointEditor": 15,
    "PointerEditor": 16,
    "ShapeEditor": 13,
    "StatusEditor": 14,
}


@cache
def _front_end() -> dict[str, Any]:
    if not (node_tasks.FRONT_END / "node_modules" / "typescript").is_dir():  # never installed here: others run by now
        pytest.skip('TypeScript is not installed: run "sh run check" first')
    node = node_tasks.need_package("typescript")
    script = node_tasks.FRONT_END / "tests" / "classes.mjs"
    done = subprocess.run([node, str(script)], capture_output=True, encoding="utf-8", timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_a_class_has_at_most_30_methods_and_15_attributes() -> None:
    sizes = {name: (found["methods"], found["attributes"]) for name, found in _front_end()["classes"].items()}
    assert len(sizes) > 100
    above = {name: size for name, size in sizes.items() if size[0] > MOST_METHODS or size[1] > MOST_ATTRIBUTES}
    grown = {name: size for name, size in above.items() if np.greater(size, LARGE_CLASSES.get(name, (0, 0))).any()}
    assert not grown, "let it hold parts, each of which knows the few things that it uses"
    assert set(LARGE_CLASSES) <= set(above), "leave out of the table what is small by now"


def test_no_part_is_given_its_owner() -> None:
    classes = {name.rpartition(":")[2]: found for name, found in _front_end()["classes"].items()}
    given = {
        f"{name} of {owner}"
        for name, found in classes.items()
        for owner in found["given"]
        if name in classes.get(owner, {}).get("makes", ())
    }
    assert given == GIVEN_OWNERS, "give it an interface of what it uses"


def test_no_method_only_forwards() -> None:
    found = {f"{name}.{method}" for name, found in _front_end()["classes"].items() for method in found["forwards"]}
    assert found == FORWARDS, "let the caller hold the part"


def test_a_part_uses_a_dozen_others_at_most() -> None:
    counts = _front_end()["interfaces"]
    assert len(counts) > 25
    above = {name: count for name, count in counts.items() if count > MOST_NAMES}
    assert above == LARGE_INTERFACES, "divide it, or leave out of the table what is small by now"

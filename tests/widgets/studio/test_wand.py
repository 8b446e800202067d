"""The wand of a studio: the selection of a click, in the picture and through the depth, and its shapes."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from front_end import deliver
from scipy import ndimage
from widgets.studio.panels.test_steps_history import Guarded

from deformnb.document.json_regions import region_from_data
from deformnb.rbf.regions import Mask
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.studio.editors import make_editor
from deformnb.widgets.studio.wand import Wand
from deformnb.widgets.worker import Worker


def volume() -> Volume:
    """A body with a rod that is bent in depth: seen in two pieces in any slice along y."""
    values = np.zeros((20, 24, 28), np.uint8)
    values[2:18, 2:22, 2:26] = 60
    values[4:16, 4:10, 6:10] = values[4:16, 14:20, 18:22] = 200
    values[4:6, 4:20, 6:22] = 200
    values[9, 6:8, 7] = 60  # a hole in the rod
    return Volume(values, Grid(values.shape), "rod")


def test_what_hangs_together_is_selected_and_becomes_a_part_and_a_cut() -> None:
    made = volume()
    session = Session(made, view="+y")
    session.pictures.method = "slice"
    session.pictures.depth = session.pictures.slices.depth(7)
    editor, worker, guard = make_editor(session, 300), Worker("test"), Guarded()
    taken: list[tuple[str, str, Mask]] = []
    wand = Wand(
        session, editor, worker, guard, lambda what, regions: taken.extend((what, name, mask) for name, mask in regions)
    )
    assert editor.wand == {"region": None, "words": "", "share": 1.0}

    def use(place: Any, what: str = "preview", **changes: Any) -> dict[str, Any]:
        message = {
            "type": "wand",
            "what": what,
            "place": list(place),
            "tolerance": 20.0,
            "rule": "near",
            "through": False,
            **changes,
        }
        deliver(editor, message)
        done = threading.Event()
        worker.latest("wait", done.set)  # behind the preview
        assert done.wait(30)
        return dict(editor.wand)

    picture = session.pictures.picture()
    raster = picture.raster
    line, column = np.argwhere(picture.values == 200)[-1]
    rod = (float(raster.columns[column]), float(raster.rows[line]))
    flat = region_from_data(use(rod)["region"])
    bright = picture.values == 200
    assert bright.sum() < flat.values.sum() == ndimage.binary_fill_holes(bright).sum()
    assert "180 to 220" in editor.wand["words"]
    deep = region_from_data(use(rod, through=True)["region"])
    assert deep.values.sum() == (made.values == 200).any(axis=1).sum()
    assert use(rod, rule="darker", tolerance=0.0)["region"] is not None
    assert "air or padding" in use((0.0, 0.0))["words"]
    assert editor.wand["failed"]
    assert "outside the picture" in use((-99.0, 0.0))["words"]

    use(rod, through=True)
    use(rod, "part")
    assert taken == [("part", "region 1", deep)]
    assert editor.wand["region"] is None
    use(rod, "cut")
    assert "with the wand first" in guard.errors[-1]
    use(rod)
    use(rod, "cut")
    assert taken[1:] == [("cut", "region 1", flat)]

    use(rod)
    assert use(rod, "stop")["region"] is None
    use(rod)
    session.pictures.method = "shaded"
    assert editor.wand["region"] is None
    assert "shows colours" in use(rod)["words"]
    wand.close()
    worker.close()
    editor.close()


@pytest.mark.parametrize(
    "wrong",
    [
        {"what": "all"},
        {"place": [1.0]},
        {"place": [1.0, float("nan")]},
        {"rule": "any"},
        {"tolerance": -1.0},
        {"through": 1},
        {"tolerance": "5"},
    ],
)
def test_a_wrong_message_is_dropped(wrong: dict[str, Any], caplog: pytest.LogCaptureFixture) -> None:
    seen: list[Any] = []
    editor = Editor()
    editor.on_wand(seen.append)
    good = {"type": "wand", "what": "preview", "place": [1.0, 2.0], "tolerance": 2.0, "rule": "near", "through": False}
    deliver(editor, {**good, **wrong})
    assert seen == []
    assert "dropped" in caplog.text
    deliver(editor, good)
    assert len(seen) == 1

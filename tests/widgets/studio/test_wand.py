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
from deformnb.rbf.cuts import Cut
from deformnb.rbf.regions import Line, Mask
from deformnb.session.session import Session
from deformnb.volume.plane import Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.studio.editors import make_editor
from deformnb.widgets.studio.wand import Wand, change_region, pieces_of
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

    holed = region_from_data(use(rod, fill=False)["region"])
    assert (holed.values == bright).all()
    grown = region_from_data(use(rod, grow=2)["region"])
    assert (grown.values == ndimage.binary_dilation(flat.values, iterations=2)).all()
    smooth = region_from_data(use(rod, smooth=1)["region"])
    assert 0 < (smooth.values != flat.values).sum() < 0.3 * flat.values.sum()
    assert "Nothing is left" in use(rod, grow=-20)["words"]
    middle = float(raster.rows[line]) - 2.5 * raster.spacing[1]
    across = Cut(Line(((raster.box[0] - 9, middle), (raster.box[1] + 9, middle))))
    session.editing.change(cuts=(across,))
    found = use(rod)
    assert found["pieces"] == 2
    assert "; 2 pieces, the largest has " in found["words"]
    largest = region_from_data(use(rod, largest=True)["region"])
    assert ndimage.label(largest.values)[1] == 1
    share = 100 * largest.values.sum() / flat.values.sum()
    assert f"largest has {share:.0f} %" in found["words"]
    session.editing.undo()

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


@pytest.mark.parametrize("seed", range(4))
def test_changes_of_a_region_keep_their_order(seed: int) -> None:
    values = ndimage.gaussian_filter(np.random.default_rng(seed).normal(size=(40, 50)), 3) > 0
    assert (change_region(values) == values).all()
    assert (change_region(values, grow=1) >= values).all()
    assert (change_region(values, grow=-1) <= values).all()
    assert (change_region(change_region(values, grow=2), grow=-2) >= values).all()  # a closing
    edge = np.zeros_like(values)
    edge[:, :20] = True
    assert (change_region(edge, smooth=3) == edge).all()  # a straight edge stays, at the border too
    assert not change_region(np.eye(40, 50, dtype=bool), smooth=1)[3:-3, 3:37].any()  # a line of one pixel goes


def test_pieces_are_counted_with_what_a_cut_parts() -> None:
    values = np.zeros((20, 30), bool)
    values[2:18, 2:10] = values[5:9, 20:28] = True
    region = Mask(values, Raster((20, 30), (2.0, 1.0), (5.0, -3.0)))
    numbers, sizes = pieces_of(region)
    assert sizes.tolist() == [128, 32]
    assert ((numbers > 0) == values).all()
    level = Line(((-100.0, 3.5), (200.0, 3.5)))  # of the rows
    assert sorted(pieces_of(region, (level,))[1].tolist()) == sorted([40, 88, 16, 16])


@pytest.mark.parametrize(
    "wrong",
    [
        {"what": "all"},
        {"grow": 1000},
        {"smooth": -1},
        {"fill": 1},
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

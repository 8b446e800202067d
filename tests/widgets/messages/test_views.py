"""Every widget that receives messages, under mutated ones: nothing escapes, and a refused one changes nothing."""

from __future__ import annotations

import logging
import random
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from example_messages import example, mutate
from waiting import Threads

from deformnb.imaging.projection import project
from deformnb.rbf.points import ControlPoints
from deformnb.session.session import Session
from deformnb.volume.volume import Volume
from deformnb.widgets import (
    CurveEditor,
    DepthKeys,
    Editor,
    LiveView,
    SpaceEditor,
    TransferEditor,
    VolumeView,
)
from deformnb.widgets.boxes import Box, Boxes, Fold, Tabs
from deformnb.widgets.inputs.file_input import FileInput
from deformnb.widgets.inputs.grid_drawing import GridDrawing
from deformnb.widgets.inputs.item_list import ItemList
from deformnb.widgets.inputs.points_table import PointsTable
from deformnb.widgets.messages.record import Refused
from deformnb.widgets.messages.schema import CHANNELS
from deformnb.widgets.studio.head import StudioHead
from deformnb.widgets.studio.save_restore import RestoreBar
from deformnb.widgets.synced import SyncedWidget

PER_RUN, RUNS = 500, 10  # messages; by day the first run only, at night all 5000


def guard(action: Callable[[], None]) -> bool:
    try:
        action()
    except ValueError:
        return False
    return True


def volume() -> Volume:
    return Volume.from_array((np.indices((6, 7, 8)).sum(axis=0) * 9).astype(np.uint8))


def space_editor() -> SpaceEditor:
    corners = volume().grid.corners()
    return SpaceEditor(volume(), ControlPoints.from_arrays(corners, corners + 0.25))


def rows() -> ItemList:
    items = ItemList()
    items.show([{"name": "a"}, {"name": "b"}], 0)
    return items


def table() -> PointsTable:
    made = PointsTable()
    made.show(ControlPoints.from_arrays([[0, 0], [3, 4]]))
    return made


MAKERS: dict[str, Callable[[], SyncedWidget]] = {
    "Boxes": lambda: Boxes([Tabs([Fold(Box(), "a"), Box()], ["b", "c"])]),
    "Editor": lambda: Editor(None, ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9]])),
    "SpaceEditor": space_editor,
    "CurveEditor": CurveEditor,
    "TransferEditor": lambda: TransferEditor(volume()),
    "DepthKeys": DepthKeys,
    "GridDrawing": lambda: GridDrawing(project(volume(), "+z")),
    "ItemList": rows,
    "PointsTable": table,
    "FileInput": lambda: FileInput(lambda path, progress: None, guard),
    "RestoreBar": lambda: RestoreBar(Session(volume()), guard, str),
    "StudioHead": lambda: StudioHead(Session(volume()), lambda action: True, str),
    "LiveView": lambda: LiveView(volume()),
    "VolumeView": lambda: VolumeView(volume(), method="core"),
}


class Records(logging.Handler):
    """The lines of the log: those of the thread that made this, and what has failed in others."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[logging.LogRecord] = []
        self.failures: list[str] = []
        self._own = threading.get_ident()

    def emit(self, record: logging.LogRecord) -> None:
        if record.thread == self._own:
            self.lines.append(record)
        elif record.levelno >= logging.ERROR:
            self.failures.append(self.format(record))


def state(widget: SyncedWidget) -> dict[str, Any]:
    """The state of a front end, without numbers of answers and results of threads."""
    found = {name: value for name, value in widget.get_state().items() if name not in ("seen", "thumbnails", "ready")}
    shown = found.get("shown")
    return {**found, "shown": {**shown, "seen": None}} if isinstance(shown, dict) else found


def test_every_widget_that_receives_messages_is_tried() -> None:
    assert {name for channel in CHANNELS if channel.incoming_records for name in channel.widgets} == set(MAKERS)


@pytest.mark.sampled(RUNS)
@pytest.mark.parametrize("run", range(RUNS))
@pytest.mark.parametrize("name", MAKERS)
def test_a_mutated_message_raises_nothing_and_where_it_is_refused_changes_nothing(name: str, run: int) -> None:
    threads = Threads()
    widget, log = MAKERS[name](), Records()
    channel = widget.channel
    assert channel is not None
    widget.send = lambda content, buffers=None: None  # type: ignore[method-assign]
    logger = logging.getLogger("deformnb")
    logger.addHandler(log)
    rng = random.Random(f"{name} {run}")
    refused, before = 0, state(widget)
    try:
        for k in range(PER_RUN):
            message, buffers = mutate(rng, *example(rng.choice(channel.incoming_records)))
            log.lines.clear()
            is_refused = isinstance(channel.read(message, buffers), Refused)
            widget.receive(message, buffers)
            if is_refused:
                refused += 1
                assert [line.levelname for line in log.lines] == ["WARNING"], (message, log.lines)
                assert "\n" not in log.lines[0].getMessage()
            if not is_refused or k % 20 == 0:
                after = state(widget)
                assert after == before or not is_refused, message
                before = after
        assert refused > PER_RUN / 4
        widget.close()
        threads.wait()  # their log belongs to this widget
        assert log.failures == []
    finally:
        logger.removeHandler(log)
        widget.close()

"""The list of cuts: where the chosen one ends."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from deformnb.rbf.cuts import Cut
from deformnb.rbf.regions import Line, Polygon
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.studio.panels.shapes import ShapesPanel

GRID = Grid((10, 12, 14))


def done(action: Any) -> bool:
    action()
    return True


def test_a_cut_ends_here_or_goes_on_to_the_border() -> None:
    session = Session(Volume(np.zeros(GRID.shape, np.uint8), GRID))
    editor = Editor(None)
    panel = ShapesPanel(session, done, SimpleNamespace(plane=editor, current=editor))
    session.editing.change(cuts=[Cut(Line([(3, 2), (4, 8)]), "incision")])
    panel.refresh()
    (ends,) = (c.widget for c in panel.controls if c.widget.description == "Cut's ends")
    assert (ends.value, ends.layout.display) == ("go on to the border", None)
    ends.value = "last end here"
    assert session.editing.step.cuts == (Cut(Line([(3, 2), (4, 8)], stops=(False, True)), "incision"),)
    panel.refresh()
    assert panel.items.rows[0]["facts"][-1] == "last end here"
    session.editing.undo()
    panel.refresh()
    assert ends.value == "go on to the border"
    session.editing.change(cuts=[Cut(Polygon([(1, 1), (5, 1), (1, 5)]))])
    panel.refresh()
    assert ends.layout.display == "none"
    panel.close()

"""Small widgets of the client that the studio has too.

These are the curve and the key pictures of the depth, colours and opacities, clipping, the list of steps and the table
of points.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from deformnb.session.session import Session
from deformnb.volume.transfer import TransferFunction
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.inputs.clip_controls import ClipControls
from deformnb.widgets.inputs.curve_editor import CurveEditor
from deformnb.widgets.inputs.depth_keys import DepthKeys
from deformnb.widgets.inputs.item_list import ItemList
from deformnb.widgets.inputs.points_table import PointsTable
from deformnb.widgets.inputs.transfer_editor import TransferEditor
from deformnb.widgets.studio.controls import Guard
from deformnb.widgets.studio.panels.depth import DepthPanel, Preview
from deformnb.widgets.studio.panels.points import PointsPanel
from deformnb.widgets.studio.panels.steps import StepsPanel
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.worker import Worker

WIDGETS: dict[str, type[Any]] = {
    "editor": Editor, "live": LiveView, "curve": CurveEditor, "keys": DepthKeys, "colours": TransferEditor,
    "clip": ClipControls, "steps": ItemList, "points": PointsTable,
}
"""Classes of the widgets in the client, by name."""


_LOW = 84  # CSS pixels of the curve's plot: beside it a projector has room for the other settings


class PanelWidgets:
    """The widgets beside picture and volume.

    Parameters
    ----------
    session : what they edit.
    editor, live : picture and volume, which they share selection and camera with.
    preview : shows a step that is on its way; None gives it up.
    guard : does an edit and reports errors; returns whether it was done.
    recolour : called with colours and opacities, and with whether that was the end of the movement.
    """

    def __init__(self, session: Session, editor: Editor, live: LiveView, preview: Preview, guard: Guard,
                 recolour: Callable[[TransferFunction, bool], None]) -> None:
        self._session = session
        self._worker = Worker("deformnb-points")
        self._depth = DepthPanel(session, guard, preview)
        self._depth.curve.height = _LOW
        self._steps = StepsPanel(session, guard)
        self._steps.items.columns = []  # the drawer is narrow
        self._points = PointsPanel(session, guard, SimpleNamespace(current=editor), self._worker)
        self._colours = TransferEditor(session.volume, session.transfer)
        self._colours.on_edit(lambda transfer, phase: recolour(transfer, phase == "end"))
        self._clip = ClipControls(live)

    @property
    def widgets(self) -> dict[str, Any]:
        """The widgets by name, as in :data:`WIDGETS`."""
        return {"curve": self._depth.curve, "keys": self._depth.keys, "colours": self._colours, "clip": self._clip,
                "steps": self._steps.items, "points": self._points.table}

    def refresh(self) -> None:
        """Show what the session holds."""
        for panel in (self._depth, self._steps, self._points):
            panel.refresh()
        if self._colours.transfer != self._session.transfer_function:
            self._colours.set_transfer(self._session.transfer)

    def close(self) -> None:
        """Stop observing, and end the thread that searches for points that disagree."""
        self._points.close()
        self._worker.close()

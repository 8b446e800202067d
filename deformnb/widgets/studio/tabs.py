"""Tabs of a studio: its panels in order; the first is the strip below the pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from os import PathLike
from typing import Any

from deformnb.session.session import Session
from deformnb.volume.volume import Volume
from deformnb.widgets.inputs.transfer_editor import TransferEditor
from deformnb.widgets.studio.controls import DisplayPanel, Guard, MapPanel, Panel, PicturePanel, strip
from deformnb.widgets.studio.editors import StudioEditors
from deformnb.widgets.studio.panels.animation import AnimationPanel
from deformnb.widgets.studio.panels.depth import DepthPanel, Preview
from deformnb.widgets.studio.panels.diagnostics import DiagnosticsPanel
from deformnb.widgets.studio.panels.files import FilesPanel, ResultBox
from deformnb.widgets.studio.panels.points import PointsPanel
from deformnb.widgets.studio.panels.registration import FitPanel
from deformnb.widgets.studio.panels.shapes import ShapesPanel
from deformnb.widgets.studio.panels.steps import HistoryPanel, StepsPanel
from deformnb.widgets.studio.panels.thompson import ThompsonPanel
from deformnb.widgets.worker import Worker


@dataclass(frozen=True)
class PanelParts:
    """Parts of a studio that panels may need.

    Parameters
    ----------
    guard : does what a user requested and shows errors in the front end.
    editors : ``editors.plane`` is the editor on pictures, ``editors.current`` that of the step being edited.
    worker : the studio's thread, ``worker.latest(name, work)``.
    opacity : the editor of the opacity curve.
    folder : where files are saved and opened.
    export_html : writes the page that deforms without a kernel.
    labels, label_names : numbered parts of the volume and what they are called.
    target : what the volume shall look like, to be chosen in the panel of fitting.
    preview : shows a step that is on its way and no edit yet; None gives it up.
    """

    session: Session
    guard: Guard
    view: Any
    editors: StudioEditors
    worker: Worker
    opacity: TransferEditor
    folder: str | PathLike[str]
    export_html: Callable[..., None]
    labels: Volume | None
    label_names: Mapping[int, str] | None
    target: Volume | None = None
    preview: Preview | None = None


def make_panels(s: PanelParts) -> list[Panel]:
    """All panels of a studio; one without a title stands in another one."""
    head, _ = strip(s.session, s.guard, s.view)
    files = FilesPanel(s.session, s.guard, s.view, s.folder, s.export_html)
    result_box = ResultBox(s.session, s.guard, s.worker)  # late: what others do of themselves comes before it
    files.box.children = (result_box.box, *files.box.children)
    return [
        head,
        PicturePanel(s.session, s.guard, s.editors.plane),
        PointsPanel(s.session, s.guard, s.editors, s.worker),
        StepsPanel(s.session, s.guard),
        ShapesPanel(s.session, s.guard, s.editors.plane, s.labels, s.label_names),
        MapPanel(s.session, s.guard),
        DepthPanel(s.session, s.guard, s.preview),
        DiagnosticsPanel(s.session, s.guard, s.view, s.editors, s.worker),
        FitPanel(s.session, s.guard, s.editors, s.folder, s.target),
        ThompsonPanel(s.session, s.guard, s.editors.plane, s.folder),
        AnimationPanel(s.session, s.guard, s.view, s.folder),
        DisplayPanel(s.session, s.guard, s.view, s.opacity),
        HistoryPanel(s.session, s.guard),
        result_box,
        files,
    ]

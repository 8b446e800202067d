"""Layout of a studio: head, panes with picture and volume, and the panel next to them in groups of folded sections.

    head: name, undo, redo, menus (History, Examples, Export), Save
    panes: picture | volume        panel: Shape  Depth  View  Animate  Check

The widths at which the panel goes below the panes are in frontend/src/studio/studio.css.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from os import PathLike
from typing import Any

from deformnb.rbf.regions import AbstractRegion
from deformnb.session.session import Session
from deformnb.volume.channels import Channels
from deformnb.volume.volume import Volume
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import Box, Fold, Tabs, column
from deformnb.widgets.inputs.file_input import FileInput
from deformnb.widgets.inputs.transfer_editor import TransferEditor
from deformnb.widgets.studio.controls import (
    ChannelsPanel,
    DisplayPanel,
    Guard,
    LatePanel,
    MapPanel,
    Panel,
    PictureLookPanel,
    PicturePanel,
    StrengthPanel,
    VolumePanel,
)
from deformnb.widgets.studio.editors import StudioEditors
from deformnb.widgets.studio.panels.animation import AnimationPanel
from deformnb.widgets.studio.panels.compare import ComparePanel
from deformnb.widgets.studio.panels.depth import DepthPanel, Preview
from deformnb.widgets.studio.panels.diagnostics import DiagnosticsPanel, DiagnosticsUpdates
from deformnb.widgets.studio.panels.examples import ExamplesPanel
from deformnb.widgets.studio.panels.files import FilesPanel, OutputCheck, ResultBox
from deformnb.widgets.studio.panels.opening import OpenPanel
from deformnb.widgets.studio.panels.points import PointsPanel
from deformnb.widgets.studio.panels.registration import FitPanel
from deformnb.widgets.studio.panels.shapes import ShapesPanel
from deformnb.widgets.studio.panels.steps import HistoryPanel, StepsPanel
from deformnb.widgets.studio.panels.thompson import ThompsonPanel
from deformnb.widgets.studio.panels.view_plane import ViewPlanePanel
from deformnb.widgets.studio.slices import StudioSlices
from deformnb.widgets.studio.status import StudioStatus
from deformnb.widgets.studio.wand import Wand
from deformnb.widgets.worker import Worker


@dataclass(frozen=True)
class GivenVolumes:
    """Volumes that a user gives with the one that is deformed.

    Parameters
    ----------
    labels, label_names : numbered parts of the volume and their names.
    target : of a fit, to be chosen in the panel of fitting.
    """

    labels: Volume | None = None
    label_names: Mapping[int, str] | None = None
    target: Volume | None = None


@dataclass(frozen=True)
class PanelParts:
    """Parts of a studio that panels may need.

    Parameters
    ----------
    guard : runs requests of the user and shows errors in the front end.
    editors : ``editors.plane`` is the editor on pictures, ``editors.current`` that of the step being edited.
    worker : the studio's thread, ``worker.latest(name, work)``.
    slices : three slices in the place of the view.
    opacity : the editor of the opacity curve.
    folder : where files are saved and opened.
    export_html : writes the web page that deforms without a kernel.
    given : other volumes that belong to the session's.
    preview : shows a step in progress and no edit yet; None gives it up.
    edit_view : edits on the picture that the camera of the view sees.
    open_volume : opens a volume in place of the session's.
    decide_labels : takes the voxels of the session's for labels, or for amounts.
    file_input : takes files dropped on the studio; None for a new one.
    """

    session: Session
    guard: Guard
    view: Any
    editors: StudioEditors
    worker: Worker
    slices: StudioSlices
    opacity: TransferEditor
    folder: str | PathLike[str]
    export_html: Callable[..., None]
    given: GivenVolumes
    preview: Preview
    edit_view: Callable[[], None]
    open_volume: Callable[[Volume | Channels], None]
    decide_labels: Callable[[bool], None]
    file_input: FileInput | None


@dataclass(frozen=True)
class Section:
    """A section of a group, under the title of its panel.

    Parameters
    ----------
    panel : its contents, made when they are first shown; they are notified when they are.
    is_open : from the start.
    has_heading : by which it is folded; one without is always open.
    """

    panel: LatePanel[Any]
    is_open: bool = False
    has_heading: bool = True


@dataclass(frozen=True)
class StudioPanels:
    """All panels of a studio, by their places.

    Parameters
    ----------
    groups : sections by the title of their tab.
    menus : panels of the head's menus, by their names; made when they are first opened.
    picture, volume : above the panes.
    start : above the picture while nothing is deformed.
    opening : takes files that are dropped on the studio.
    others : in other panels.
    wand : the tool of the picture.
    """

    groups: Mapping[str, Sequence[Section]]
    menus: Mapping[str, Sequence[LatePanel[Any]]]
    picture: Panel
    volume: Panel
    start: Panel
    opening: OpenPanel
    others: Sequence[Panel]
    wand: Wand

    @property
    def initial(self) -> list[Panel]:
        """The panels that are there from the start."""
        return [self.picture, self.volume, self.start, self.opening, *self.others]

    @property
    def late(self) -> list[LatePanel[Any]]:
        """The panels of the sections and the menus."""
        sections = [section.panel for group in self.groups.values() for section in group]
        return [*sections, *(panel for panels in self.menus.values() for panel in panels)]

    @property
    def history(self) -> LatePanel[HistoryPanel]:
        """The panel of the menu "History"."""
        return self.menus["history"][0]

    @property
    def loaded_panels(self) -> list[Panel]:
        """All panels that have been made."""
        return [*self.initial, *(late.made for late in self.late if late.made is not None)]

    def refresh(self) -> None:
        """Show the session in all panels that have been made."""
        for panel in self.loaded_panels:
            panel.refresh()

    def open_menu(self, name: str) -> None:
        """Make the panels of a menu."""
        for panel in self.menus[name]:
            panel.handle_visibility(True)

    def close(self) -> None:
        """End what runs of the panels; their widgets close with the boxes that they are in."""
        for panel in self.loaded_panels:
            panel.close()
        self.wand.close()


def make_panels(s: PanelParts) -> StudioPanels:
    """All panels of a studio."""
    output = OutputCheck(s.session, s.guard, s.worker, s.editors.plane)
    diagnostics = DiagnosticsUpdates(s.session, s.guard, s.editors, s.worker)
    points = LatePanel(PointsPanel, s.session, s.guard, s.editors, s.worker)
    shapes = LatePanel(ShapesPanel, s.session, s.guard, s.editors, s.given.labels, s.given.label_names, s.folder)
    fit = LatePanel(FitPanel, s.session, s.guard, s.editors, s.folder, s.given.target)
    thompson = LatePanel(ThompsonPanel, s.session, s.guard, s.editors.plane, s.folder)
    folded: list[LatePanel[Any]] = [points, shapes, fit, thompson]
    shape = [
        _alone(StrengthPanel, s.session, s.guard),
        Section(LatePanel(StepsPanel, s.session, s.guard), is_open=True),
        Section(LatePanel(MapPanel, s.session, s.guard), is_open=True),
        *(Section(panel) for panel in folded),
    ]

    def take_regions(what: str, regions: Sequence[tuple[str, AbstractRegion]]) -> None:
        shapes.panel.add_regions(what, regions)

    wand = Wand(s.session, s.editors.plane, s.worker, s.guard, take_regions)
    compare = LatePanel(ComparePanel, s.session, s.guard, s.view, s.editors.beside, s.worker, s.folder, s.given.target)
    channels = [LatePanel(ChannelsPanel, s.session, s.guard)] if s.session.channels else []
    groups = {
        "Shape": shape,
        "Depth": [_alone(DepthPanel, s.session, s.guard, s.preview)],
        "View": [
            Section(LatePanel(DisplayPanel, s.session, s.guard, s.view, s.opacity), is_open=True),
            *(Section(panel, is_open=True) for panel in channels),
            Section(LatePanel(PictureLookPanel, s.session, s.guard, s.editors.plane), is_open=True),
            Section(LatePanel(ViewPlanePanel, s.session, s.guard, s.view, s.edit_view)),
            Section(compare),
        ],
        "Animate": [_alone(AnimationPanel, s.session, s.guard, s.view, s.folder)],
        "Check": [_alone(DiagnosticsPanel, s.session, s.guard, s.view, s.editors, diagnostics)],
    }
    menus: dict[str, list[LatePanel[Any]]] = {
        "history": [LatePanel(HistoryPanel, s.session, s.guard)],
        "examples": [LatePanel(ExamplesPanel, s.session, s.guard)],
        "export": [
            LatePanel(ResultBox, s.session, s.guard, output),
            LatePanel(FilesPanel, s.session, s.guard, s.view, s.folder, s.export_html),
        ],
    }
    return StudioPanels(
        groups,
        menus,
        PicturePanel(s.session, s.guard, s.editors.plane, thompson.reveal),
        VolumePanel(s.session, s.guard, s.view, s.slices, s.opacity),
        ExamplesPanel(s.session, s.guard, is_start=True),
        OpenPanel(s.session, s.guard, points, shapes, fit, compare, s.open_volume, s.decide_labels, s.file_input),
        [output, diagnostics],
        wand,
    )


def arrange(
    head: Any, editors: StudioEditors, view: Any, panels: StudioPanels, words: StudioStatus, height: int
) -> list[Any]:
    """The rows of a studio: its file input, its head, the menus of that, and the body of panes and panel.

    The file input comes first, where the front end has its view, with the file in progress, when the rows
    behind it are replaced.
    """
    basic.own_layout(view).width = "100%"
    if view.has_trait("fill"):
        view.fill = True  # as large as its pane
    if view.has_trait("background"):
        view.background = "dark"  # bones and fins are bright
    editors.beside.children = (view,)
    panes = [_pane(panels.picture.box, editors.box, "picture"), _pane(panels.volume.box, editors.beside, "volume")]
    warnings = [panel.warning for panel in panels.initial if panel.warning is not None]
    messages = column(*warnings, words.box, classes="dnb-studio-messages")
    tabs = _group(panels.groups)
    tabs.children[-1].children += (column(words.status, classes="dnb-section-plain"),)  # figures are under "Check"
    side = column(tabs, classes="dnb-studio-panel")
    start = column(panels.start.box, classes="dnb-studio-start")
    body = column(
        column(*panes, start, messages, classes="dnb-studio-panes"),
        side,
        classes="dnb-studio-body",
        height=f"{height}px",
    )
    menus = [
        column(*(panel.box for panel in made), classes=f"dnb-studio-menu dnb-menu-{name}")
        for name, made in panels.menus.items()
    ]
    return [panels.opening.box.add_class("dnb-studio-open"), head, *menus, body]


def _pane(head: Box, contents: Box, name: str) -> Box:
    return column(head.add_class("dnb-pane-head"), contents, classes=f"dnb-pane dnb-pane-{name}")


def _group(groups: Mapping[str, Sequence[Section]]) -> Tabs:
    """Tabs of groups of sections; a panel is notified when it is shown."""
    boxes = {title: [_section(section) for section in sections] for title, sections in groups.items()}
    tabs = Tabs([column(*group, classes="dnb-group") for group in boxes.values()], list(groups))
    known = [
        (number, box, weakref.ref(section.panel))
        for number, title in enumerate(groups)
        for section, box in zip(groups[title], boxes[title], strict=True)
    ]

    def notify() -> None:
        for number, box, reference in known:
            panel = reference()
            if panel is not None:
                panel.handle_visibility(tabs.selected == number and (not isinstance(box, Fold) or box.is_open))

    def show(number: int, box: Box) -> None:
        tabs.choose(number)
        if isinstance(box, Fold):
            box.choose(0)

    for number, box, reference in known:
        if (panel := reference()) is not None:
            panel.unfold = partial(show, number, box)
        if isinstance(box, Fold):
            box.changed = notify
    tabs.changed = notify
    notify()
    return tabs


def _alone(kind: type[Panel], *arguments: Any) -> Section:
    return Section(LatePanel(kind, *arguments), is_open=True, has_heading=False)


def _section(section: Section) -> Box:
    if section.has_heading:
        return Fold(section.panel.box, section.panel.title, is_open=section.is_open)
    return column(section.panel.box, classes="dnb-section-plain")

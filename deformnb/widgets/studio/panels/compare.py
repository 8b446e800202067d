"""Second volume next to the first in a studio: another scan, the target of a fit, or the result of another session."""

from __future__ import annotations

import html
from os import PathLike
from typing import Any

import ipywidgets as ipw
import traitlets

from deformnb._weak import weakly
from deformnb.session.session import Session
from deformnb.volume.volume import Volume
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, row
from deformnb.widgets.cell_widgets import close_all, owned_widgets
from deformnb.widgets.studio.controls import Guard, Panel, fill, menu, prose
from deformnb.widgets.studio.panels.target import GIVEN, NO_TARGET, FitTarget
from deformnb.widgets.studio.status import reason_of
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.worker import Worker

_SHARED = ("projection", "clip", "background")  # traits of both views, in addition to the camera


class ComparePanel(Panel):
    """Panel of the second volume: it turns with the first.

    Parameters
    ----------
    view : of the first volume.
    place : the box in which that is.
    worker : reads files.
    folder : of volumes and sessions that can be chosen; given : a volume that can be chosen too.
    """

    title = "Second volume"

    def __init__(
        self,
        session: Session,
        guard: Guard,
        view: Any,
        place: Any,
        worker: Worker,
        folder: str | PathLike[str],
        given: Volume | None,
    ) -> None:
        super().__init__(session, guard)
        self._view, self._place, self._worker = view, place, worker
        self.chosen = FitTarget(session, folder, given)
        self._wanted = NO_TARGET
        self._second: LiveView | None = None
        self._links: list[traitlets.link] = []
        self._name: ipw.HTML | None = None  # of the second volume, over its view
        self._line = basic.HTML()
        chooser = menu(
            "Show side by side",
            self.chosen.choices(),
            "Another volume of the folder, or the result of another session; both turn together",
        )
        self._menu = self.add(chooser, lambda: self._wanted, self._choose)
        session.pictures.observe(weakly(self, ComparePanel._follow_colours), "transfer")
        self.box = column(row(self._menu), self._line)
        self.refresh()

    def take(self, volume: Volume) -> None:
        """Show a volume next to the first."""
        self.chosen.offer(volume.to_unit(self.session.editing.grid.unit))
        self._choose(GIVEN)
        self.refresh()

    def arrange(self) -> None:
        fill(self._menu, self.chosen.choices())

    def close(self) -> None:
        for link in self._links:
            link.unlink()
        self._links = []

    def _choose(self, key: str) -> None:
        self._wanted = key
        if key != NO_TARGET:
            self._line.value = prose("Reading the volume \u2026")
        self._worker.latest("second volume", weakly(self, ComparePanel._load, ComparePanel._is_open))

    def _is_open(self) -> bool:
        return not self._worker.is_closed

    def _load(self) -> None:
        """Read the last selection, and show it; on failure the one before stays."""
        key = self._wanted
        try:
            self.chosen.choose(key)
            self._show(self.chosen.volume)
            self._line.value = prose(self.chosen.note) if self.chosen.note else ""
        except Exception as error:
            self._line.value = prose(reason_of(error))
            if key == self._wanted:
                self._wanted = self.chosen.key
        self.refresh()

    def _show(self, volume: Volume | None) -> None:
        if volume is None:
            self._remove()
            return
        name = html.escape(volume.name or "second volume")
        if self._second is not None and self._name is not None:
            self._name.value = name
            self._second.show(volume)
            self._follow_colours()
            return
        view = self._view
        with owned_widgets():
            made = LiveView(
                volume, transfer=self.session.pictures.transfer, width=view.width, height=view.height, fill=True
            )
        basic.own_layout(made).width = "100%"
        self._links = [
            view.link_camera(made),
            *(traitlets.link((view, name), (made, name)) for name in _SHARED if view.has_trait(name)),
        ]
        self._second, self._name = made, basic.HTML(name)
        beside = column(self._name, made, classes="dnb-second")
        beside.is_visible = view.layout.display != "none"
        first, *others = self._place.children
        self._place.children = (first, beside, *others)

    def _remove(self) -> None:
        self.close()
        second, self._second, self._name = self._second, None, None
        if second is None:
            return
        gone = [box for box in self._place.children if second in getattr(box, "children", ())]
        self._place.children = tuple(box for box in self._place.children if box not in gone)
        for box in gone:
            close_all(box)

    def _follow_colours(self, _change: Any = None) -> None:
        if self._second is not None:
            self._second.set_transfer(self.session.pictures.transfer)

"""Labels of the panel "Rigid parts and cuts": a file of numbered regions is opened, its labels are chosen by name."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from deformnb._typing import Progress
from deformnb.errors import DeformError
from deformnb.io.volumes.formats import read_volume, supported_suffixes
from deformnb.io.volumes.label_names import (
    LABEL_TABLES,
    is_label_table,
    read_label_names,
    read_label_table,
)
from deformnb.rbf.regions import Mask
from deformnb.session.session import Session
from deformnb.volume.volume import Volume
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, row
from deformnb.widgets.inputs.file_input import FileInput
from deformnb.widgets.studio.controls import Guard, Panel, button, fill, menu
from deformnb.widgets.studio.panels.folder import FolderFiles, is_volume_name, plain_name

TakeRegions = Callable[[str, list[tuple[str, Mask]]], None]
"""Called with "part" or "cut", and names and regions of the labels that were chosen."""

_MOST_LABELS = 200
_SHOWN = 8  # rows of the list of labels at most; more are scrolled
_LIKELY = re.compile("label|seg|mask", re.IGNORECASE)  # in the names of files that hold labels
_NONE = ""  # of the files is open
_CLOSED = ("open a label file", _NONE)


class LabelChooser(Panel):
    """Opens label volumes of a folder, and makes rigid parts or cuts of their labels.

    Parameters
    ----------
    session : with the volume of the labels.
    guard : runs requests of the user, and shows errors.
    take : makes parts or cuts of regions.
    folder : whose files can be opened.
    labels : a volume of numbered regions to begin with, names : the names of the numbers.

    Attributes
    ----------
    file : the menu of the files; upload : opens one of the browser's; list : the labels by name, of which several can
        be chosen.
    box : all of it.
    """

    def __init__(
        self,
        session: Session,
        guard: Guard,
        take: TakeRegions,
        folder: str | PathLike[str],
        labels: Volume | None = None,
        names: Mapping[int, str] | None = None,
    ) -> None:
        super().__init__(session, guard)
        self._take, self._files = take, FolderFiles(folder)
        self._labels: Volume | None = None
        self._table: Mapping[int, str] = {}  # of names, which was opened without labels
        self._opened = _NONE
        self.file = self.add(
            menu(
                "Labels",
                [_CLOSED],
                "A label volume of this scan in the folder, such as bones.nii.gz or 3D Slicer's .seg.nrrd",
            ),
            lambda: self._opened,
            self._open,
        )
        self.upload = FileInput(
            self._take_file,
            guard,
            _check_name,
            label="Open label file",
            tip="Label volume of this scan from this computer, and a table of its names",
            accept=",".join([supported_suffixes().replace(" ", ""), *LABEL_TABLES]),
        )
        self.list = basic.SelectMultiple(
            tooltip="Labels; Ctrl or Shift chooses several",
            layout=basic.layout(flex="1 1 140px", width="auto", min_width="100px"),
        )
        add = [
            button(text, tip, self._taker(what))
            for text, tip, what in (
                ("Label as part", "Keep these regions rigid", "part"),
                ("Label as cut", "Cut along their outlines", "cut"),
            )
        ]
        self._choice = row(self.list, *add)
        self.box = column(row(self.file, self.upload), self._choice)
        basic.set_visible(self._choice, False)
        if labels is not None:
            self._show(labels, names or {})
        self.refresh()

    def close(self) -> None:
        """Let go of the label volume."""
        self._labels = None

    def arrange(self) -> None:
        given = [] if self._labels is None or self._opened else [(self._labels.name or "labels", _NONE)]
        likely_first = sorted(self._files.names(), key=lambda name: not _LIKELY.search(name))
        files = [(name, name) for name in likely_first]
        if self._opened and (self._opened, self._opened) not in files:
            files.append((self._opened, self._opened))  # it is gone, and its labels are still here
        fill(self.file, [*(given or [_CLOSED]), *files])
        basic.set_visible(self.file, files or given)

    # -- opening -------------------------------------------------------------------------------------------------------

    def _open(self, name: str) -> None:
        if name == _NONE:
            return
        path = self._files.folder / plain_name(name)
        self.take(name, read_volume(path, is_labels=True), read_label_names(path))

    def _take_file(self, path: Path, progress: Progress) -> None:
        if is_label_table(path.name):
            self.take_table(path)
            return
        self.take(path.name, read_volume(path, is_labels=True, progress=progress), read_label_names(path))

    def take(self, name: str, labels: Volume, names: Mapping[int, str]) -> None:
        """Show the labels of a file that has been read.

        Parameters
        ----------
        name : of the file; names : of its labels, empty for those of a table that has come before.

        Raises
        ------
        DeformError
            If it is elsewhere in space, or is no label volume; the labels before stay.
        """
        labels = labels.to_unit(self.session.editing.grid.unit)
        if not labels.grid.overlaps(self.session.volume.grid):
            raise DeformError(
                f"{name} is at another place in space than {self.session.volume.name or 'the volume'}: "
                "open the labels of this scan."
            )
        self._show(labels, names or self._table)
        self._opened = name
        self.refresh()

    def take_table(self, path: Path) -> None:
        """Call the labels as a table does: those that are shown, and those of the next file that names none.

        Raises
        ------
        DeformError
            If the file is no table of label names; the names stay.
        """
        names = read_label_table(path)
        if not names:
            raise DeformError(f"{path.name} is no table of label names: it needs columns such as label and name.")
        self._table = names
        if self._labels is None:
            self.session.editing.notice = (
                f"{path.name} names {len(names)} labels: open the label volume that they belong to."
            )
            return
        chosen, numbers = self.list.value, [number for _, number in self.list.options]
        self.list.options = [(names.get(n, words), n) for words, n in self.list.options]
        self.list.value = chosen
        self.session.editing.notice = (
            f"{path.name} names {sum(n in names for n in numbers)} of the {len(numbers)} labels."
        )

    def _show(self, labels: Volume, names: Mapping[int, str]) -> None:
        present = np.unique(labels.values)
        if len(present) > _MOST_LABELS or not (np.isfinite(present).all() and (present == np.round(present)).all()):
            raise DeformError(
                f"{labels.name or 'this volume'} is no label volume: its voxels must be whole numbers, "
                f"one for each region and at most {_MOST_LABELS}."
            )
        chosen = [int(value) for value in present if value != 0]
        if not chosen:
            raise DeformError(f"{labels.name or 'the label volume'} has no label to choose; every voxel of it is 0.")
        self._labels = labels
        self.list.options = [(names.get(n) or f"label {n}", n) for n in chosen]
        self.list.rows = min(_SHOWN, len(chosen))
        self.list.value = (chosen[0],)
        basic.set_visible(self._choice, True)

    # -- choosing ------------------------------------------------------------------------------------------------------

    def _taker(self, what: str) -> Callable[[], Any]:
        return lambda: self.guard(lambda: self._take(what, self._regions()))

    def _regions(self) -> list[tuple[str, Mask]]:
        if self._labels is None or not self.list.value:
            raise DeformError("no label is chosen; click on one in the list, with Ctrl or Shift on several.")
        plane = self.session.editing.step.plane
        masks = [Mask.from_labels(self._labels, n) for n in self.list.value]
        return [
            (name, mask if plane is None else mask.silhouette(plane))
            for name, mask in zip(self.list.label, masks, strict=True)
        ]


def _check_name(name: str) -> None:
    """DeformError for the name of a file that is no volume file and no table."""
    if not (is_volume_name(name) or is_label_table(name)):
        raise DeformError(
            f"{name} is no kind of volume file; open {supported_suffixes()}, or a table of label names "
            f"({', '.join(LABEL_TABLES)})."
        )

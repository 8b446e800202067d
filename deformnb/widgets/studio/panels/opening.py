"""Files that are dropped on the studio or chosen under "Open": the name and the contents determine their use.

Landmarks become points, a session replaces the one that is open, a label volume shows its labels under "Rigid parts and
cuts", and a table of names becomes those of the labels. Any other volume can take the place of the one that is open,
be shown next to it, or be the target under "Match to another picture": the user chooses, also whether whole numbers
are labels, where the file does not state it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from deformnb._typing import Progress
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError, OtherVolumeError
from deformnb.io.documents import read_document
from deformnb.io.landmarks.formats import is_landmarks, landmark_suffixes
from deformnb.io.transforms.formats import is_transform
from deformnb.io.volumes.formats import supported_suffixes
from deformnb.io.volumes.label_names import (
    LABEL_TABLES,
    is_label_table,
    read_label_names,
    read_label_table,
)
from deformnb.session.inputs import as_volume_and_channels, subject_from
from deformnb.session.session import Session
from deformnb.volume.channels import Channels
from deformnb.volume.volume import Volume, label_note
from deformnb.widgets.inputs.file_input import FileInput
from deformnb.widgets.studio.controls import Guard, LatePanel, Panel, Question
from deformnb.widgets.studio.panels.compare import ComparePanel
from deformnb.widgets.studio.panels.folder import is_volume_name
from deformnb.widgets.studio.panels.points import PointsPanel
from deformnb.widgets.studio.panels.registration import FitPanel
from deformnb.widgets.studio.panels.shapes import ShapesPanel

_SESSION = ".json"
_KINDS = (
    f"a volume or labels ({supported_suffixes()}), names of labels ({', '.join(LABEL_TABLES)}), landmarks "
    f"({landmark_suffixes()}) or a session ({_SESSION})"
)


class OpenPanel(Panel):
    """Opens files from the computer on which the browser runs.

    Parameters
    ----------
    points : takes landmarks; shapes : takes labels; fit : takes targets; compare : shows a second volume.
    open_volume : opens a volume in place of the one that is open.
    decide_labels : takes the voxels of the one that is open for labels, or for amounts.
    box : the one of the panel before, None for a new one; see :meth:`begin`.

    Attributes
    ----------
    box : takes files dropped on the studio.
    warning : the question what becomes of a volume, whether a session of another volume is opened, and whether the
        voxels of the volume that is open are labels.
    """

    title = "Open"

    def __init__(
        self,
        session: Session,
        guard: Guard,
        points: LatePanel[PointsPanel],
        shapes: LatePanel[ShapesPanel],
        fit: LatePanel[FitPanel],
        compare: LatePanel[ComparePanel],
        open_volume: Callable[[Volume | Channels], None],
        decide_labels: Callable[[bool], None],
        box: FileInput | None = None,
    ) -> None:
        super().__init__(session, guard)
        self._points, self.shapes, self._fit, self.compare = points, shapes, fit, compare
        self._open_volume = open_volume
        self.question = Question(guard)
        self.warning = self.question.box
        self.box = box or FileInput(
            self._take,
            guard,
            _check_name,
            drops=True,
            tip="Open a volume, labels and their names, landmarks, or a session",
        )
        if session.volume.is_undecided:
            name = session.volume.name or "this volume"
            self.question.ask(
                f"The voxels of {name} look like labels. Preserve each number, or blend them as amounts?",
                "They are labels",
                lambda: decide_labels(True),
                {"They are amounts": lambda: decide_labels(False)},
            )

    def begin(self) -> None:
        """Take the files from the panel before, also one in progress: it was chosen for the present volume."""
        self.box.give_to(self._take, self.guard)

    def _take(self, path: Path, progress: Progress) -> None:
        self.question.forget()
        if is_label_table(path.name) and (read_label_table(path) or not is_landmarks(path)):  # both have .csv files
            self.shapes.panel.labels.take_table(path)
            self.shapes.reveal()
        elif is_landmarks(path):
            self._points.panel.files.take(path)
        elif path.suffix.lower() == _SESSION:
            self._take_session(path)
        else:
            self._take_volume(path, progress)

    def _take_session(self, path: Path) -> None:
        document = read_document(path)[0]
        try:
            self._open_session(path.name, document)
        except OtherVolumeError:
            self.question.ask(
                self.session.files.difference(document),
                "Open anyway",
                lambda: self._open_session(path.name, document, allow_other_volume=True),
            )

    def _open_session(self, name: str, document: Deformation, allow_other_volume: bool = False) -> None:
        self.session.take(document, f"open {name}", allow_other_volume=allow_other_volume)
        self.session.editing.notice = self.session.editing.notice or f"Opened {name}; undo reverts this."

    def _take_volume(self, path: Path, progress: Progress) -> None:
        subject, names = subject_from(path, progress=progress), read_label_names(path)
        volume, _ = as_volume_and_channels(subject)
        present = self.session.volume.name or "the volume that is open"
        kept = f" The edits of {present} stay under History." if self.session.editing.history.get("undo") else ""
        answers: dict[str, Callable[[], None]] = {
            "Open": lambda: self._open_volume(subject),
            "Show side by side": lambda: self._show_second(path.name, volume),
            "Match to it": lambda: self._take_target(path.name, volume),
            "Use as labels": lambda: self._take_labels(path.name, volume, names),
        }
        question = f"Open {path.name} in place of {present}?{kept}"
        if volume.grid.overlaps(self.session.volume.grid) and (names or is_segmentation(volume)):
            if names or volume.is_labels:
                answers["Use as labels"]()
                return
            question = f"{path.name} looks like labels. Use them as labels of {present}, or open it in its place?{kept}"
            answers = {"Use as labels": answers.pop("Use as labels"), **answers}
        first, *others = answers
        self.question.ask(question, first, answers[first], {words: answers[words] for words in others})

    def _show_second(self, name: str, volume: Volume) -> None:
        self.compare.panel.take(volume)
        self.compare.reveal()
        self.session.editing.notice = (
            f'{name} is shown side by side; "Second volume" under View chooses another one, or none.'
        )

    def _take_target(self, name: str, volume: Volume) -> None:
        self._fit.panel.take(volume)
        self._fit.reveal()
        self.session.editing.notice = f'{name} is the target under "Match to another picture".'

    def _take_labels(self, name: str, volume: Volume, names: Mapping[int, str]) -> None:
        self.shapes.panel.labels.take(name, replace(volume, is_labels=True), names)
        self.shapes.reveal()
        count = len(self.shapes.panel.labels.list.options)
        self.session.editing.notice = (
            f'{name} has {count} label{"" if count == 1 else "s"}: choose some under "Rigid '
            'parts and cuts", and make them rigid parts or cuts.'
        )


def is_segmentation(volume: Volume) -> bool:
    """Check whether the voxels of a volume are labels: by its file, or by their values."""
    if volume.is_labels or label_note(volume.values):
        return True
    return volume.dtype.kind in "biu" and len(np.unique(volume.values[:: max(1, volume.shape[0] // 8)])) <= 2


def _check_name(name: str) -> None:
    """DeformError for the name of a file of another kind; text files (.txt) are read as landmarks or label names."""
    if not (is_landmarks(name) or is_label_table(name) or name.lower().endswith(_SESSION) or is_volume_name(name)):
        if is_transform(name):
            raise DeformError(f"{name} is a transform, and no session: deformnb warp {name} VOLUME RESULT applies it.")
        raise DeformError(f"{name} is no file that can be opened here; drop or choose {_KINDS}.")

"""Files that are dropped on the studio or chosen under "Open": the name and the contents choose what becomes of them.

Landmarks become points, a session replaces the one that is open, a label volume shows its labels under "Rigid parts and
cuts", and any other volume is the target under "Match to another picture".
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from deformnb._typing import Progress
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError, OtherVolumeError
from deformnb.io.documents import read_document
from deformnb.io.formats import read_volume, supported
from deformnb.io.label_names import read_label_names
from deformnb.io.landmarks import is_landmarks, landmark_suffixes
from deformnb.io.transforms import is_transform
from deformnb.session.session import Session
from deformnb.volume.volume import Volume, label_note
from deformnb.widgets.inputs.file_input import FileInput
from deformnb.widgets.studio.controls import Guard, Panel
from deformnb.widgets.studio.panels.files import Question
from deformnb.widgets.studio.panels.labels import is_volume_name
from deformnb.widgets.studio.panels.points import PointsPanel
from deformnb.widgets.studio.panels.registration import FitPanel
from deformnb.widgets.studio.panels.shapes import ShapesPanel

_SESSION = ".json"
_KINDS = f"landmarks ({landmark_suffixes()}), a session ({_SESSION}), a label volume or another volume ({supported()})"


class OpenPanel(Panel):
    """Opens files from the computer on which the browser runs.

    Parameters
    ----------
    points : takes landmarks; shapes : takes labels; fit : takes targets.

    Attributes
    ----------
    box : takes what is dropped on the studio; warning : the question whether a session of another volume is opened.
    """

    title = "Open"

    def __init__(self, session: Session, guard: Guard, points: PointsPanel, shapes: ShapesPanel, fit: FitPanel) -> None:
        super().__init__(session, guard)
        self._points, self._shapes, self._fit = points, shapes, fit
        self.question = Question(guard)
        self.warning = self.question.box
        self.box = FileInput(self._take, guard, _check_name, drops=True,
                             tip="Open landmarks, a session, a label volume or another volume")

    def _take(self, path: Path, progress: Progress) -> None:
        self.question.forget()
        if is_landmarks(path):
            self._points.files.take(path)
        elif path.suffix.lower() == _SESSION:
            self._take_session(path)
        else:
            self._take_volume(path, progress)

    def _take_session(self, path: Path) -> None:
        document = read_document(path)[0]
        try:
            self._opened(path.name, document)
        except OtherVolumeError:
            self.question.ask(self.session.difference(document), "Open anyway",
                              lambda: self._opened(path.name, document, allow_other_volume=True))

    def _opened(self, name: str, document: Deformation, allow_other_volume: bool = False) -> None:
        self.session.take(document, f"open {name}", allow_other_volume=allow_other_volume)
        self.session.notice = self.session.notice or f"Opened {name}; undo leads back."

    def _take_volume(self, path: Path, progress: Progress) -> None:
        volume = read_volume(path, progress=progress)
        if not is_segmentation(path, volume):
            self._fit.take(volume)
            self._fit.reveal()
            self.session.notice = (f'{path.name} is the target under "Match to another picture". To deform it instead, '
                                   "open it by itself: Studio(...) in a notebook, or deformnb app.")
            return
        self._shapes.labels.take(path, replace(volume, is_labels=True))
        self._shapes.reveal()
        count = len(self._shapes.labels.list.options)
        self.session.notice = (f'{path.name} has {count} label{"" if count == 1 else "s"}: choose some under "Rigid '
                               'parts and cuts", and make them rigid parts or cuts.')


def is_segmentation(path: Path, volume: Volume) -> bool:
    """Check whether the voxels of a file are labels: as it says, as 3D Slicer names them, or as they look."""
    if volume.is_labels or read_label_names(path) or label_note(volume.values):
        return True
    return volume.dtype.kind in "biu" and len(np.unique(volume.values[:: max(1, volume.shape[0] // 8)])) <= 2


def _check_name(name: str) -> None:
    """DeformError for the name of a file of another kind; text files (.txt) are read as landmarks."""
    if not (is_landmarks(name) or name.lower().endswith(_SESSION) or is_volume_name(name)):
        if is_transform(name):
            raise DeformError(f"{name} is a transform, and no session: deformnb warp {name} VOLUME RESULT applies it.")
        raise DeformError(f"{name} is no file that can be opened here; drop or choose {_KINDS}.")

"""Landmark files of the points being edited: opened by the browser, and handed to its downloads."""

from __future__ import annotations

import tempfile
from pathlib import Path

from deformnb._typing import Progress
from deformnb.errors import DeformError
from deformnb.io.landmarks.formats import (
    LANDMARK_FORMATS,
    landmark_suffixes,
    read_landmarks,
    write_landmarks,
)
from deformnb.session.session import Session
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import row
from deformnb.widgets.inputs.file_input import FileInput
from deformnb.widgets.inputs.file_transfer import FileTransfer
from deformnb.widgets.studio.controls import Guard, button, file_stem


class LandmarkFiles:
    """A row of controls that opens and saves landmarks.

    Parameters
    ----------
    session : whose points they are.
    guard : runs requests of the user and shows errors in the front end.

    Attributes
    ----------
    box : the row; upload, kind, save : its controls; file_transfer : sends the file to the browser.
    """

    def __init__(self, session: Session, guard: Guard) -> None:
        self._session, self._guard = session, guard
        suffixes = [row.suffix for row in LANDMARK_FORMATS.values()]
        self.upload = FileInput(
            self.take,
            guard,
            label="Open landmarks",
            accept=",".join([*suffixes, ".json"]),
            tip=f"Points from a file of landmarks ({landmark_suffixes()}); pairs are dragged to their fixed places",
        )
        pairs = ", ".join(row.suffix for row in LANDMARK_FORMATS.values() if row.has_fixed)
        self.kind = basic.Dropdown(
            options=suffixes,
            value=suffixes[0],
            layout=basic.layout(width="auto"),
            tooltip=f"{pairs} store where the points were dragged too, the others store places only",
        )
        self.save = button("Save landmarks", "Download the points in the browser", lambda: guard(self._download))
        self.file_transfer = FileTransfer()
        self.box = row(self.upload, self.save, self.kind, self.file_transfer)

    def take(self, path: Path, _progress: Progress | None = None) -> None:
        """Add the landmarks of a file to the points."""
        found = read_landmarks(path)
        self._session.add_landmarks(found)
        notes = [f"{len(found)} landmarks of {path.name} are control points now", *found.notes]
        self._session.editing.notice = "; ".join(notes)

    def _download(self) -> None:
        landmarks = self._session.landmarks()
        if not len(landmarks):
            raise DeformError("there are no points to save; add one by a double click on the picture.")
        stem = file_stem(self._session.volume)
        name = f"{stem}{self.kind.value}"
        with tempfile.TemporaryDirectory(prefix="deformnb-") as folder:
            path = Path(folder) / name
            write_landmarks(landmarks, path)
            self.file_transfer.download(name, path.read_bytes())

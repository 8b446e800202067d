"""Landmark files of the points being edited: opened by the browser, and handed to its downloads."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import ipywidgets as ipw

from deformnb.errors import DeformError
from deformnb.io.landmarks import LANDMARK_FORMATS, landmark_suffixes, read_landmarks, write_landmarks
from deformnb.session.session import Session
from deformnb.widgets.inputs.file_transfer import FileTransfer
from deformnb.widgets.studio.controls import Guard, button, file_stem, row


class LandmarkFiles:
    """A row of controls that opens and saves landmarks.

    Parameters
    ----------
    session : whose points they are.
    guard : does what a user requested and shows errors in the front end.

    Attributes
    ----------
    box : the row; upload, kind, save : its controls; file_transfer : hands the file to the browser.
    """

    def __init__(self, session: Session, guard: Guard) -> None:
        self._session, self._guard = session, guard
        suffixes = [row.suffix for row in LANDMARK_FORMATS.values()]
        self.upload = ipw.FileUpload(accept=",".join([*suffixes, ".json"]), description="Open landmarks",
                                     layout=ipw.Layout(width="auto"),
                                     tooltip=f"Points from a file of landmarks ({landmark_suffixes()}); pairs are "
                                             "dragged to their fixed places")
        self.upload.observe(lambda change: self._open(change["new"]), "value")
        self.kind = ipw.Dropdown(options=suffixes, value=suffixes[0], layout=ipw.Layout(width="auto"),
                                 tooltip=".csv is BigWarp's and holds where the points were dragged, the others hold "
                                         "places only")
        self.save = button("Save landmarks", "Hand the points to the browser's downloads",
                           lambda: guard(self._download))
        self.file_transfer = FileTransfer()
        self.box = row(self.upload, self.save, self.kind, self.file_transfer)

    def _open(self, files: Any) -> None:
        if files:
            self._guard(lambda: self._take(files[0]["name"], bytes(files[0]["content"])))
            self.upload.value = ()

    def _take(self, name: str, content: bytes) -> None:
        with _file(name) as path:
            path.write_bytes(content)
            found = read_landmarks(path)
        self._session.add_landmarks(found)
        self._session.notice = "; ".join([f"{len(found)} landmarks of {name} are control points now", *found.notes])

    def _download(self) -> None:
        landmarks = self._session.landmarks()
        if not len(landmarks):
            raise DeformError("there are no points to save; add one by a double click on the picture.")
        stem = file_stem(self._session.volume)
        name = f"{stem}{self.kind.value}"
        with _file(name) as path:
            write_landmarks(landmarks, path)
            self.file_transfer.download(name, path.read_bytes())


@contextmanager
def _file(name: str) -> Iterator[Path]:
    """A path of this name in a folder of its own, for formats are told by the end of a name."""
    with tempfile.TemporaryDirectory(prefix="deformnb-") as folder:
        yield Path(folder) / Path(name).name

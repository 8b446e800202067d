"""The files of a session: where its document is safe, what may be replaced, and the script that makes it again."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import traitlets

from deformnb.document.deformation import Deformation, LazyReference
from deformnb.document.script import UNKNOWN_VOLUME, as_python, grid_expression
from deformnb.io.documents import write_deformation
from deformnb.io.files.atomic import KnownFiles
from deformnb.io.files.paths import as_path
from deformnb.session.view_state import without_view_state
from deformnb.volume.volume import Volume


class Files(traitlets.HasTraits):
    """Files that a session has opened and written.

    Parameters
    ----------
    volume : that is deformed.
    source : an expression that reads the volume, for scripts; empty if that is not known.

    Attributes
    ----------
    saved : the document that is safe in a file of its user's, as it was last written or opened; None if none is.
    path : where it was last written or opened; None if nowhere.
    known : files opened and written here, which alone are replaced without a question.
    reference : call it for what identifies the volume; the first call takes a moment for a large volume.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> files = Files(PHANTOMS["bar"].make((8, 8, 8)), 'dn.read_volume("bar.nrrd")')
    >>> 'dn.read_volume("bar.nrrd")' in files.code(Deformation())
    True
    """

    saved = traitlets.Instance(Deformation, allow_none=True)
    path = traitlets.Instance(Path, allow_none=True)

    def __init__(self, volume: Volume, source: str = "") -> None:
        super().__init__()
        self.source = source
        self.known = KnownFiles()
        self.reference = LazyReference(volume)
        self._volume = volume

    def write(self, document: Deformation, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write a document as JSON, which is safe then.

        Parameters
        ----------
        overwrite : replace any file; else only one as it was opened or saved here.

        Raises
        ------
        FileChangedError
            If the file was there before, or another program has changed it; nothing is written.
        """
        write_deformation(document, path, known=self.known, overwrite=overwrite)
        self.path, self.saved = as_path(path), document

    def difference(self, deformation: Deformation) -> str:
        """Warning about a document that was made on another volume; empty if it was made on this one."""
        return deformation.difference(self._volume, self.reference)

    def code(self, deformation: Deformation, volume: str = "") -> str:
        """A document as a Python script; see :func:`deformnb.document.script.as_python`.

        Parameters
        ----------
        volume : expression that gives the volume; default reads the file that it came from.
        """
        volume, grid = volume or self.source or UNKNOWN_VOLUME, self._volume.finest_grid
        return as_python(deformation, grid, volume=volume, own=grid_expression(self._volume))

    @traitlets.validate("saved")
    def _valid_saved(self, proposal: Any) -> Deformation | None:
        """Without its view state: a document with other colours only is not unsaved."""
        return None if proposal["value"] is None else without_view_state(proposal["value"])

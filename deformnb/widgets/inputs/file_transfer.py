"""Transfer of a text to the clipboard, or of a file to the browser's downloads, which only the front end can do."""

from __future__ import annotations

import uuid
from typing import Any

import traitlets

from deformnb.errors import DeformError
from deformnb.widgets.bundle import bundle
from deformnb.widgets.messages.inputs import LARGEST_DOWNLOAD, CopyText, Download
from deformnb.widgets.synced import SyncedWidget


class FileTransfer(SyncedWidget):
    """A line in the front end that reports each transfer.

    Examples
    --------
    >>> FileTransfer().download("big.bin", bytes(LARGEST_DOWNLOAD + 1))
    Traceback (most recent call last):
    deformnb.errors.DeformError: big.bin has 134 MB, more than the 134 MB of a browser's download; it is in the folder.
    """

    _esm = bundle("file_transfer.js")
    _css = bundle("file_transfer.css")

    uid = traitlets.Unicode(help="distinguishes views of this widget from those of others").tag(sync=True)

    def __init__(self, **traits: Any) -> None:
        super().__init__(uid=uuid.uuid4().hex, **traits)

    def copy(self, text: str, note: str = "") -> None:
        """Put a text on the clipboard; where the browser refuses, it is shown and selected.

        Parameters
        ----------
        note : what to do with it, shown along with how much was copied.
        """
        self.post(CopyText(text=text, note=note))

    def download(self, name: str, content: bytes) -> None:
        """Let the browser save a file under this name."""
        if len(content) > LARGEST_DOWNLOAD:
            raise DeformError(
                f"{name} has {len(content) / 1e6:.0f} MB, more than the {LARGEST_DOWNLOAD / 1e6:.0f} MB "
                "of a browser's download; it is in the folder."
            )
        self.post(Download(name=name), [content])

    def set_state(self, sync_data: Any) -> None:
        """The front end owns nothing here."""

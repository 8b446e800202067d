"""Upload of files from the browser: by a button that opens its file chooser, and by a drop on the studio.

A file comes in pieces, each requested by Python when it has the one before: a socket takes only small messages (see
:mod:`deformnb.widgets.web.guard`), and a file without a callback is never held in memory. The messages are UploadBegin,
UploadPiece, UploadCancel, PieceRequest, UploadReading and UploadDone of :mod:`deformnb.widgets.messages.inputs`.
"""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import traitlets

from deformnb._typing import Progress
from deformnb.errors import Cancelled, DeformError
from deformnb.widgets.bundle import bundle
from deformnb.widgets.messages.inputs import (
    LARGEST_UPLOAD,
    PIECE,
    UPLOAD,
    PieceRequest,
    UploadBegin,
    UploadCancel,
    UploadDone,
    UploadPiece,
    UploadReading,
)
from deformnb.widgets.messages.record import LONGEST_NAME, Refused
from deformnb.widgets.synced import SyncedWidget
from deformnb.widgets.worker import Worker

_MOST_UPLOADS = 4  # in progress at a time, of all clients; the oldest belongs to a closed one
_LOG = logging.getLogger(__name__)

TakeFile = Callable[[Path, Progress], None]
"""Called with the path of the whole file, which is gone afterwards, and with a report of progress, which may raise
Cancelled."""


class FileInput(SyncedWidget):
    """A button that uploads files from the browser.

    Parameters
    ----------
    take : called with each file, in a separate thread.
    guard : does that and shows errors; also those of a file that is refused before it is sent.
    check : called with the name of a file before it is sent; raises DeformError for one that cannot be taken.
    label : of the button; accept : endings of names that the file chooser offers.
    tip : what can be opened; the limit is added.
    drops : whether files dropped on the studio around the widget are uploaded too.

    Examples
    --------
    >>> found = []
    >>> upload = FileInput(lambda path, progress: found.append(path.read_bytes()), lambda action: action() is None)
    >>> upload._handle_custom_msg({"type": "begin", "id": "a", "name": "b.csv", "size": 2}, [])
    >>> upload._handle_custom_msg({"type": "piece", "id": "a", "offset": 0}, [memoryview(b"hi")])
    >>> upload.wait()
    >>> found
    [b'hi']
    >>> upload.close()
    """

    _esm = bundle("file_input.js")
    _css = bundle("file_input.css")
    channel = UPLOAD

    label = traitlets.Unicode("Open").tag(sync=True)
    accept = traitlets.Unicode("").tag(sync=True)
    tip = traitlets.Unicode("").tag(sync=True)
    drops = traitlets.Bool(False).tag(sync=True)

    def __init__(
        self,
        take: TakeFile,
        guard: Callable[[Callable[[], None]], bool],
        check: Callable[[str], None] | None = None,
        *,
        tip: str = "",
        **traits: Any,
    ) -> None:
        self._take, self._guard, self._check = take, guard, check
        self._uploads: dict[str, _Upload] = {}
        self._worker = Worker("deformnb-upload")
        limit = f"files of up to {LARGEST_UPLOAD / 1e6:.0f} MB"
        super().__init__(tip=f"{tip}; {limit}" if tip else limit, **traits)

    def give_to(self, take: TakeFile, guard: Callable[[Callable[[], None]], bool]) -> None:
        """Give the files from now on, those in progress too, to another.

        Parameters
        ----------
        take, guard : as of the widget.
        """
        self._take, self._guard = take, guard

    def wait(self, timeout: float = 60.0) -> None:
        """Wait until the files that have come are taken. For scripts and tests."""
        self._worker.call(lambda: None).result(timeout)

    def close(self) -> None:
        """Drop the uploads in progress."""
        if hasattr(self, "_uploads"):  # ipywidgets closes a half-made widget too
            for upload in [*self._uploads.values()]:
                self._end(upload)
            self._worker.close()
        super().close()

    def set_state(self, sync_data: Any) -> None:
        """The front end owns nothing here."""

    # -- messages ------------------------------------------------------------------------------------------------------

    def take_message(self, message: UploadBegin | UploadPiece | UploadCancel, buffers: Any = ()) -> None:
        name = message.id
        try:
            if isinstance(message, UploadBegin):
                self._begin(name, message.name, message.size)
            elif name in self._uploads:
                upload = self._uploads[name]
                if isinstance(message, UploadCancel):
                    self._cancel(upload)
                else:
                    self._add(upload, message.offset, bytes(buffers[0]))
        except Exception as error:
            if name in self._uploads:
                self._end(self._uploads[name])
            self._done(name)
            reason = error
            self._guard(lambda: _raise(reason))

    def _refuse(self, refused: Refused) -> None:
        name = refused.content.get("id")
        if name is not None and name not in self._uploads:  # one in progress continues
            self._done(name)
            self._guard(lambda: _raise(DeformError(f"the upload was refused: {refused.reason}")))

    def _begin(self, name: str, file: str, size: int) -> None:
        file = Path(file.replace("\\", "/")).name
        if file in ("", ".", "..") or len(file) > LONGEST_NAME or any(ord(c) < 32 for c in file):
            raise DeformError("the file has no name that can be used here; rename it.")
        if self._check is not None:
            self._check(file)
        if size == 0:
            raise DeformError(f"{file} is empty.")
        if size > LARGEST_UPLOAD:
            raise DeformError(
                f"{file} has {size / 1e6:.0f} MB, more than the {LARGEST_UPLOAD / 1e6:.0f} MB that can "
                "be uploaded; put it into the folder of the notebook or application instead."
            )
        if name in self._uploads:
            raise DeformError("an upload of this number is under way.")
        while len(self._uploads) >= _MOST_UPLOADS:
            self._end(next(iter(self._uploads.values())))
        self._uploads[name] = upload = _Upload(name, file, size)
        self._request(upload)

    def _request(self, upload: _Upload) -> None:
        self.post(PieceRequest(id=upload.id, offset=upload.count, length=min(PIECE, upload.size - upload.count)))

    def _add(self, upload: _Upload, offset: int, piece: bytes) -> None:
        if upload.count == upload.size:
            return
        if offset != upload.count or not 0 < len(piece) <= min(PIECE, upload.size - upload.count):
            raise DeformError(f"{upload.path.name} did not arrive as a whole; upload it again.")
        upload.file.write(piece)
        upload.count += len(piece)
        if upload.count < upload.size:
            self._request(upload)
        else:
            upload.file.close()
            self._worker.call(lambda: self._finish(upload))

    def _cancel(self, upload: _Upload) -> None:
        upload.is_cancelled = True
        if upload.count < upload.size:  # else it is being read, and its report of progress ends that
            self._end(upload)
            self._done(upload.id)

    def _finish(self, upload: _Upload) -> None:
        def progress(share: float) -> None:
            if upload.is_cancelled:
                raise Cancelled("stopped in the studio.")
            if share - upload.reported > 0.01 or share == 1:
                upload.reported = share
                self.post(UploadReading(id=upload.id, share=share))

        def take() -> None:
            try:
                progress(0.0)
                self._take(upload.path, progress)
            except Cancelled:
                _LOG.info("%s was cancelled while it was read", upload.path.name)

        try:
            self.post(UploadReading(id=upload.id, share=0.0))
            self._guard(take)
        finally:
            self._end(upload)
            self._done(upload.id)

    def _done(self, name: str) -> None:
        self.post(UploadDone(id=name))

    def _end(self, upload: _Upload) -> None:
        self._uploads.pop(upload.id, None)
        upload.close()


class _Upload:
    """A file that is arriving, in a separate folder: suffixes of names select formats."""

    def __init__(self, name: str, file: str, size: int) -> None:
        self.id, self.size, self.count, self.reported, self.is_cancelled = name, size, 0, 0.0, False
        self._folder = tempfile.TemporaryDirectory(prefix="deformnb-")
        self.path = Path(self._folder.name) / file
        try:
            self.file = self.path.open("wb")
        except OSError:  # of a name that is too long here
            self._folder.cleanup()
            raise

    def close(self) -> None:
        self.file.close()
        self._folder.cleanup()


def _raise(error: Exception) -> None:
    raise error

"""Downloads and uploads of the application: files written here and sent to a client, and saved sessions.

A file is written in a thread of its own into a folder that only this user may read. A client gets it by an address that
was never used before and is sent to clients of this session alone; the next file, and the end, remove it.
"""

from __future__ import annotations

import contextlib
import logging
import re
import secrets
import shutil
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from deformnb.document.deformation import Deformation
from deformnb.document.json_format import from_json
from deformnb.errors import Cancelled, DeformError, OtherVolumeError
from deformnb.session.exports import EXPORTS, Frozen, Seen, export
from deformnb.session.session import Session
from deformnb.widgets.cell_widgets import close_all
from deformnb.widgets.studio.studio import last_step
from deformnb.widgets.worker import Worker

DOWNLOADS = {"volume": "Deformed volume", "rendering": "Picture of the volume", "drawing": "Picture before and after",
          "movie": "Movie", "page": "Web page that deforms", "script": "Python script"}
"""Files that a client may request by name, with labels for a menu. A session is saved elsewhere."""

_PAGE_SUFFIX = ".html"
_BRIEFLY = 8.0  # seconds that the report of a success is shown
_LOG = logging.getLogger(__name__)


def suffix_of(kind: str) -> str:
    """Suffix of such a file's name."""
    return _PAGE_SUFFIX if kind == "page" else EXPORTS[kind].suffixes[0]


class ApplicationFiles:
    """Writes files of an application's session for its clients, one at a time.

    Parameters
    ----------
    session : what is written. seen : gives the client's display settings of now.
    live : the view whose display settings a page without Python takes; editor : the same of the picture.
    notify : called from any thread when :attr:`state` is another one.
    """

    def __init__(self, session: Session, seen: Callable[[], Seen], editor: Any, live: Any,
                 notify: Callable[[], None]) -> None:
        self._session, self._seen, self._editor, self._live, self._notify = session, seen, editor, live, notify
        self._thread = Worker("deformnb-app-files")
        self._stop, self._reporting = threading.Event(), threading.Lock()
        self._folder: Path | None = None
        self._ready: tuple[str, Path] | None = None
        self._doubtful: Deformation | None = None
        self._passing = ""  # the message that need not be read
        stem = session.volume.name.split(".", maxsplit=1)[0]
        self._stem = re.sub(r"[^\w-]+", "_", stem, flags=re.ASCII).strip("_")[:40] or "deformed"
        self.state: dict[str, Any] = {"busy": False, "message": "", "share": 0.0, "key": "", "name": "", "page": "",
                                      "doubt": ""}

    # -- to the client -------------------------------------------------------------------------------------------------

    def write(self, kind: str, page: str) -> None:
        """Begin to write a file of a kind of :data:`DOWNLOADS` for the client of this name."""
        if kind not in DOWNLOADS:
            raise DeformError("there is no such file.")
        if self.state["busy"]:
            raise DeformError(f"{self.state['name']} is still being written; wait for it or stop it.")
        name = f"{self._stem}{'_deformed' if kind == 'volume' else ''}{suffix_of(kind)}"
        frozen = Frozen.of(self._session, self._seen())
        self._stop.clear()
        self._report(busy=True, name=name, share=0.0, key="", page=page, message=f"Writing {name} ...")
        self._thread.call(lambda: self._write(kind, name, frozen))

    def stop(self) -> None:
        """Stop what is being written; no half file is left."""
        self._stop.set()

    def path(self, key: str) -> Path | None:
        """The file that is ready under this part of an address, or None."""
        ready = self._ready
        if ready is None or not secrets.compare_digest(ready[0].encode(), key.encode()):
            return None
        return ready[1]

    def close(self) -> None:
        """End the thread and remove the files."""
        self._stop.set()
        self._ready = None
        self._thread.close(wait=5.0)
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)

    def _write(self, kind: str, name: str, frozen: Frozen) -> None:
        message, key = "", ""
        try:
            self._ready = None
            path = self._place(name)
            if kind == "page":
                self._write_page(path, frozen.seen)
            else:
                export(frozen, path, progress=self._progress)
            key = secrets.token_urlsafe(24)
            self._ready = (key, path)
            message = self._passing = f"{name} goes to the downloads."
        except Cancelled:
            message = self._passing = f"Stopped; {name} was not written."
        except DeformError as error:
            message = str(error)
        except Exception as error:  # of whatever writes this kind of file: the client must receive the error
            _LOG.exception("a file could not be written")
            message = f"{name} could not be written: {type(error).__name__}: {error}"
        self._report(busy=False, message=message, key=key)
        self._thread.at_rest(_BRIEFLY, self.pass_on)

    def _place(self, name: str) -> Path:
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp(prefix="deformnb-"))  # only its owner may read it
        for old in self._folder.iterdir():
            with contextlib.suppress(OSError):
                old.unlink()
        return self._folder / name

    def _write_page(self, path: Path, seen: Seen) -> None:
        from deformnb.widgets.standalone import write_standalone

        editor, view = last_step(self._session, self._editor, self._live)
        try:
            view.camera = dict(seen.camera)  # not of the application's own view, which other clients look through
            write_standalone(path, editor, view, title=self._session.volume.name, progress=self._progress)
        finally:
            close_all(editor)
            close_all(view)

    def _progress(self, share: float) -> None:
        if self._stop.is_set():
            raise Cancelled("stopped by the user.")
        if share - self.state["share"] > 0.01 or share >= 1:  # a message for every slice would flood the clients
            self._report(share=min(1.0, float(share)))

    def _report(self, **news: Any) -> None:
        with self._reporting:  # two threads write here, and neither may take back what the other wrote
            self.state = {**self.state, **news}
        self._notify()

    # -- from the client -----------------------------------------------------------------------------------------------

    def take(self, text: str) -> None:
        """Go on with a saved session; can be undone. For one of another volume a question is shown first."""
        self.forget()
        document = from_json(text)
        try:
            self._session.take(document)
        except OtherVolumeError:
            self._doubtful = document
            self._report(doubt=self._session.difference(document))
            return
        self._passing = "Opened; undo leads back, but for the colours."
        self._report(message=self._passing)
        self._thread.at_rest(_BRIEFLY, self.pass_on)

    def take_anyway(self) -> None:
        """Go on with the session of the question."""
        document = self._doubtful
        self.forget()
        if document is not None:
            self._session.take(document, allow_other_volume=True)

    def pass_on(self) -> None:
        """Remove the report of a success: it was read, or there is another report. That of a failure stays."""
        if self._passing and self.state["message"] == self._passing:
            self._report(message="")

    def forget(self) -> None:
        """Remove the question and the report."""
        self._doubtful = None
        self._report(doubt="", message="" if not self.state["busy"] else self.state["message"])

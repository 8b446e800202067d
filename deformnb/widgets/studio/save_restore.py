"""Save button and restore bar of the studio.

The bar at the top of the studio offers the edits that were lost when a kernel died, and reports that it has died just
now. Python sends its offer and the time of the last autosave. The front end requests one of three actions
(RestoreCommand of :mod:`deformnb.widgets.messages`); a request for an earlier offer is dropped.

The button "Save", which Ctrl+S presses anywhere in the studio, writes the session into one file of its own. The front
end sends a SaveRequest and nothing else. The notebook's own Ctrl+S is unchanged where it works; in the
editor it never did, for the keys there are the editor's.
"""

from __future__ import annotations

import logging
import re
import weakref
from collections.abc import Callable
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import traitlets

from deformnb._weak import weakly
from deformnb.document.deformation import Deformation
from deformnb.session.autosave import COMMANDS, Recovery
from deformnb.session.session import Session
from deformnb.widgets.bundle import bundle
from deformnb.widgets.messages import CommandDone
from deformnb.widgets.studio.controls import Guard
from deformnb.widgets.synced import SyncedWidget

_LOG = logging.getLogger(__name__)


class RestoreBar(SyncedWidget):
    """Writes a session after each edit and offers the lost ones on its volume; nothing is seen while there is none.

    Parameters
    ----------
    session : what is edited.
    guard : runs an edit and shows what went wrong with it.
    show : shows a text.
    options : of :class:`~deformnb.session.autosave.Autosave`.

    Attributes
    ----------
    offer : the question; written : when the session was last written, for a front end whose kernel has gone.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> bar = RestoreBar(Session(PHANTOMS["bar"].make((8, 8, 8))), lambda action: action() is None, str)
    >>> bar.offer
    ''
    >>> bar.close()
    """

    _esm = bundle("restore_bar.js")
    _css = bundle("restore_bar.css")

    offer = traitlets.Unicode("").tag(sync=True)
    written = traitlets.Unicode("").tag(sync=True)
    version = traitlets.Int(0).tag(sync=True)

    def __init__(self, session: Session, guard: Callable[[Callable[[], None]], bool], show: Callable[[str], None],
                 **options: Any) -> None:
        self._recovery: Recovery | None = None
        super().__init__()
        self._guard = guard
        self.on_msg(self._received)
        self._recovery = Recovery(session, show, _weakly_shown(self), **options)
        self.show()  # what was found before this line

    @property
    def recovery(self) -> Recovery:
        """Recovery, which writes and restores."""
        assert self._recovery is not None
        return self._recovery

    def show(self) -> None:
        """Show what is offered now."""
        if self._recovery is None or self.comm is None:
            return
        with self.hold_sync():
            if self.offer != self._recovery.offer:
                self.version += 1
                self.offer = self._recovery.offer
            self.written = self._recovery.written

    def _received(self, _widget: Any, content: Any, _buffers: Any) -> None:
        try:
            what = content.get("what") if isinstance(content, dict) and content.get("type") == "act" else None
            if not isinstance(what, str) or what not in COMMANDS:
                _LOG.warning("a message to the bar of lost sessions was dropped: %.200r", content)
            elif content.get("version") == self.version:
                self._guard(lambda: self.recovery.act(what))
        except Exception:  # it must not end the conversation with the front end
            _LOG.exception("the bar of lost sessions failed")
        finally:
            self.send(CommandDone(type="done"))

    def set_state(self, sync_data: Any) -> None:
        """The front end owns nothing here."""

    def close(self) -> None:
        """End; what was not saved stays in the history."""
        if self._recovery is not None:
            self._recovery.close()
        super().close()


def _weakly_shown(bar: RestoreBar) -> Callable[[], None]:
    reference = weakref.ref(bar)

    def show() -> None:
        found = reference()
        if found is not None:
            found.show()

    return show


_LOG = logging.getLogger(__name__)


class SaveButton(SyncedWidget):
    """Saves a session where it was saved or opened last, or else in a new file.

    Parameters
    ----------
    session : what is saved.
    guard : does it and shows what went wrong.
    show : shows a text.
    folder : of a new file; one that is there is never written over.
    run : does it in a thread, for the checksum of a large volume takes a moment; default is here.

    Attributes
    ----------
    unsaved : whether the document is another than the one in the file.
    tip : the tooltip of the button.

    Examples
    --------
    >>> import tempfile
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((8, 8, 8)))
    >>> button = SaveButton(session, lambda action: action() is None, print, tempfile.mkdtemp())
    >>> session.change(trend="none")
    >>> button.unsaved
    True
    >>> button.press()
    Saved bar_phantom.json.
    >>> button.unsaved
    False
    >>> button.close()
    """

    _esm = bundle("save_button.js")
    _css = bundle("save_button.css")

    unsaved = traitlets.Bool(False).tag(sync=True)
    tip = traitlets.Unicode("").tag(sync=True)

    def __init__(self, session: Session, guard: Guard, show: Callable[[str], None], folder: str | PathLike[str] = ".",
                 run: Callable[[Callable[[], None]], Any] | None = None) -> None:
        super().__init__()
        self._session, self._guard, self._show_text, self._folder = session, guard, show, Path(folder)
        self._run = run or (lambda work: work())
        self._first = _bare(session.deformation)
        self._observer = weakly(self, SaveButton._update, lambda button: button.comm is not None)
        session.observe(self._observer, ["deformation", "saved", "file"])
        self.on_msg(self._received)
        self._update()

    def press(self) -> None:
        """Save now."""
        self._run(self._press)

    def _press(self) -> None:
        self._guard(self._save)

    def _save(self) -> None:
        path = self._session.file or self._new_file()
        self._session.save(path)
        self._update()
        self._show_text(f"Saved {path.name}.")

    def _new_file(self) -> Path:
        stem = re.sub(r"[^\w-]+", "_", self._session.volume.name).strip("_")[:40] or "deformed"
        names = (f"{stem}{f'-{k}' if k > 1 else ''}.json" for k in range(1, 10**6))
        return next(path for path in (self._folder / name for name in names) if not path.exists())

    def _update(self, _change: Any = None) -> None:
        saved = self._session.saved
        self.unsaved = _bare(self._session.deformation) != (self._first if saved is None else _bare(saved))
        file = self._session.file
        self.tip = f"Save the session {'in ' + file.name if file else 'in a new file'} (Ctrl+S)"

    def _received(self, _widget: Any, content: Any, _buffers: Any) -> None:
        if isinstance(content, dict) and content.get("type") == "save":
            try:
                self.press()
            except Exception:  # it must not end the conversation with the front end
                _LOG.exception("the session could not be saved")
        else:
            _LOG.warning("a message to the button of saving was dropped: %.200r", content)

    def set_state(self, sync_data: Any) -> None:
        """The front end owns nothing here."""

    def close(self) -> None:
        """End, and stop observing the session."""
        if hasattr(self, "_observer"):
            self._session.unobserve(self._observer, ["deformation", "saved", "file"])
            del self._observer
        super().close()


def _bare(document: Deformation) -> Deformation:
    """A document without its volume, which a saved one names and one that is edited does not."""
    return replace(document, volume=None)

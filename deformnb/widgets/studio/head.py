"""Head of the studio: name of the volume, undo, redo, menus and "Save", which Ctrl+S presses anywhere in the studio.

The session is written into one file. The front end sends a SaveRequest, and a MenuRequest when a menu is
opened. The notebook's own Ctrl+S is unchanged where it works; in the editor it never did, for the keys there are the
editor's. The style sheet of the head is that of the studio's whole layout.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import traitlets

from deformnb._weak import weakly
from deformnb.document.deformation import Deformation
from deformnb.session.session import Session
from deformnb.volume.volume import Volume
from deformnb.widgets.bundle import bundle
from deformnb.widgets.messages.inputs import HEAD, MenuRequest, SaveRequest
from deformnb.widgets.packed_volume import unit_of
from deformnb.widgets.studio.controls import Guard, file_stem
from deformnb.widgets.synced import SyncedWidget

_EDITING = ["deformation", "index", "history"]
_FILES = ["saved", "path"]


def volume_facts(volume: Volume) -> str:
    """Size and spacing of a volume along x, y and z, in words, and its level in a pyramid.

    Examples
    --------
    >>> import numpy as np
    >>> from deformnb.volume.volume import Grid
    >>> print(volume_facts(Volume(np.zeros((2, 3, 4), np.uint8), Grid((2, 3, 4), unit="mm"))))
    4 × 3 × 2 · 1 × 1 × 1 mm
    """
    z, y, x = volume.shape
    size, spacing = (
        " \u00d7 ".join(parts) for parts in ((str(x), str(y), str(z)), [f"{s:.3g}" for s in volume.grid.spacing])
    )
    level = "" if volume.level is None else f" \u00b7 {volume.level}"
    return f"{size} \u00b7 {spacing} {unit_of(volume.grid)}".strip() + level


class StudioHead(SyncedWidget):
    """The head of a studio: name of the volume, undo and redo, menus, and "Save".

    A session is saved where it was saved or opened last, or else in a new file.

    Parameters
    ----------
    session : to save.
    guard : does it and shows what went wrong.
    show : shows a text.
    folder : of a new file; one that is there is never written over.
    open_menu : called with the name of a menu that is opened.
    run : does it in a thread, for the checksum of a large volume takes a moment; default is here.
    language : of all words of the studio around it; default is the one that was chosen.

    Attributes
    ----------
    name, facts : of the volume, and its size and spacing in words.
    history : what "undo" and "redo" would do, in words.
    unsaved : whether the document differs from the one in the file.
    tip : the tooltip of the button.

    Examples
    --------
    >>> import tempfile
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((8, 8, 8)))
    >>> head = StudioHead(session, lambda action: action() is None, print, tempfile.mkdtemp())
    >>> session.editing.change(trend="none")
    >>> head.unsaved
    True
    >>> head.press()
    Saved bar_phantom.json.
    >>> head.unsaved
    False
    >>> head.close()
    """

    _esm = bundle("studio_head.js")
    _css = bundle("studio_head.css")
    channel = HEAD

    unsaved = traitlets.Bool(False).tag(sync=True)
    tip = traitlets.Unicode("").tag(sync=True)
    name = traitlets.Unicode("").tag(sync=True)
    facts = traitlets.Unicode("").tag(sync=True)
    history = traitlets.Dict().tag(sync=True)

    def __init__(
        self,
        session: Session,
        guard: Guard,
        show: Callable[[str], None],
        folder: str | PathLike[str] = ".",
        run: Callable[[Callable[[], Any]], Any] | None = None,
        *,
        open_menu: Callable[[str], None] = lambda _: None,
        language: str | None = None,
    ) -> None:
        traits = {} if language is None else {"language": language}
        super().__init__(name=session.volume.name or "volume", facts=volume_facts(session.volume), **traits)
        self._session, self._show_text, self._folder = session, show, Path(folder)
        in_thread = run or (lambda work: work())
        self._do: Callable[[Callable[[], None]], Any] = lambda action: in_thread(lambda: guard(action))
        self._open_menu = open_menu
        self._first = _bare(session.editing.first)
        self._observer = weakly(self, StudioHead._update, lambda head: head.comm is not None)
        session.editing.observe(self._observer, _EDITING)
        session.files.observe(self._observer, _FILES)
        self._update()

    def press(self) -> None:
        """Save now."""
        self._do(self._save)

    def _save(self) -> None:
        path = self._session.files.path or self._new_file()
        self._session.save(path)
        self._update()
        self._show_text(f"Saved {path.name}.")

    def _new_file(self) -> Path:
        stem = file_stem(self._session.volume)
        names = (f"{stem}{f'-{k}' if k > 1 else ''}.json" for k in range(1, 10**6))
        return next(path for path in (self._folder / name for name in names) if not path.exists())

    def _update(self, _change: Any = None) -> None:
        saved = self._session.files.saved
        self.unsaved = _bare(self._session.editing.deformation) != (self._first if saved is None else _bare(saved))
        file = self._session.files.path
        self.history = dict(self._session.editing.history)
        self.tip = f"Save the session {'in ' + file.name if file else 'in a new file'} (Ctrl+S)"

    def take_message(self, message: SaveRequest | MenuRequest, buffers: Any = ()) -> None:
        if isinstance(message, SaveRequest):
            self.press()
        else:
            self._open_menu(message.name)

    def set_state(self, sync_data: Any) -> None:
        """The front end owns nothing here."""

    def close(self) -> None:
        """End, and stop observing the session."""
        if hasattr(self, "_observer"):
            self._session.editing.unobserve(self._observer, _EDITING)
            self._session.files.unobserve(self._observer, _FILES)
            del self._observer
        super().close()


def _bare(document: Deformation) -> Deformation:
    """A document without its volume, which a saved one names and one that is edited does not."""
    return replace(document, volume=None, unit="")

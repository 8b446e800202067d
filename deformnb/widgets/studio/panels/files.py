"""Files panel: saving and exporting by plain names in one folder, with progress and a button to stop.

The box of the result is set here too: as the volume, with a margin, or as large as the deformed foreground needs.
Foreground that is dragged out of the box is cut off everywhere: in the view, in the result, in every written file. So
at the end of each edit the editor of a picture warns of that, with a button that makes the box larger. The studio's
thread checks it exactly, for steps of every kind, and makes the box again if it should be as large as needed.
"""

from __future__ import annotations

import contextlib
import html
import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import ipywidgets as ipw

from deformnb._progress import remaining_time
from deformnb._weak import weakly
from deformnb.analysis.extent import padded
from deformnb.document.deformation import Deformation
from deformnb.document.script import VOLUME_LINE
from deformnb.errors import Cancelled, DeformError, FileChangedError
from deformnb.io.files.atomic import guard_writes
from deformnb.io.files.errors import human_bytes
from deformnb.session.exports import EXPORTS, Frozen, export, export_for
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.foreground import LARGER_BOX, LARGER_BOX_TIP, cut_off_text, join_names
from deformnb.widgets import basic_widgets as basic
from deformnb.widgets.boxes import column, row
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.inputs.file_transfer import FileTransfer
from deformnb.widgets.packed_volume import unit_of
from deformnb.widgets.parameters import PAGE_CONTROLS
from deformnb.widgets.studio.controls import Guard, Panel, Question, button, error_action, file_stem, fill, menu, wide
from deformnb.widgets.studio.panels.folder import plain_name
from deformnb.widgets.studio.status import as_html
from deformnb.widgets.worker import Worker

_PAGE = (".html",)
_FOLDERS = EXPORTS["full resolution"].suffixes
_VOLUMES = ("volume", "full resolution")  # kinds of exports

WritePage = Callable[..., None]


class FilesPanel(Panel):
    """Exports, and the code of the document.

    Parameters
    ----------
    view : whose camera renderings and movies take.
    folder : of the files; the front end names files in it and cannot leave it.
    write_page : writes the studio as one HTML file.
    """

    title = "Export"

    def __init__(
        self, session: Session, guard: Guard, view: Any, folder: str | PathLike[str], write_page: WritePage
    ) -> None:
        super().__init__(session, guard)
        self._view = view
        self._folder = Path(folder)
        stem = file_stem(session.volume)
        kinds = [
            (f"{e.title} ({e.suffixes[0]})", f"{stem}{'_deformed' * (name in _VOLUMES)}{e.suffixes[0]}")
            for name, e in EXPORTS.items()
        ]  # not the name of the scan itself
        kinds.append(("Web page that deforms (.html)", f"{stem}.html"))
        self.kind = basic.Dropdown(options=kinds, layout=basic.layout(width="240px"), tooltip="Kind of file")
        self.name = basic.Text(
            value=kinds[0][1],
            layout=basic.layout(flex="1 1 120px", min_width="80px"),
            placeholder="file name",
            tooltip="The suffix of the name sets the format of the file",
        )
        self.kind.observe(lambda change: setattr(self.name, "value", change["new"]), "value")
        self.write = self._action_button(
            "Write", "Write it into the folder of the notebook", lambda: self._start(False)
        )
        self.download = self._action_button(
            "Download", "Write it and download it in the browser", lambda: self._start(True)
        )
        whole = self._action_button(
            "Export at full resolution",
            "Deform the finest level of the pyramid block by block, into an OME-Zarr folder next to the notebook",
            self._choose_folder_format,
        )
        self.level = row(
            basic.HTML(html.escape(_level_text(session.volume)), layout=basic.layout(flex="1 1 240px", min_width="0")),
            whole,
        )
        basic.set_visible(self.level, _level_text(session.volume))
        self.copy = self._action_button("Copy as Python", "The document as a script", self._copy)
        self.page = PageOptions(session.volume.name)
        self.name.observe(self._show_page_options, "value")
        self._show_page_options()
        self.writing = FileWriting(guard, write_page, self._set_busy)
        self.box = column(
            row(self.kind, self.name, self.write, self.download, self.writing.cancel),
            self.level,
            self.page.box,
            row(self.copy, self.writing.bar, self.writing.message),
            self.writing.question.box,
            self.writing.file_transfer,
        )

    def _action_button(self, text: str, tooltip: str, action: Callable[[], None]) -> ipw.Button:
        return button(text, tooltip, lambda: self.guard(action))

    # -- writing -------------------------------------------------------------------------------------------------------

    def _show_page_options(self, _change: Any = None) -> None:
        basic.set_visible(self.page.box, self.name.value.lower().endswith(_PAGE))

    def _choose_folder_format(self) -> None:
        if not self.name.value.lower().endswith(_FOLDERS):
            self.kind.value = self.name.value = next(name for _, name in self.kind.options if name.endswith(_FOLDERS))
        self._start(False)

    def _start(self, downloads: bool) -> None:
        path = self._folder / plain_name(self.name.value)
        if downloads and path.name.lower().endswith(_FOLDERS):
            raise DeformError(f"{path.name} is a folder, which a browser cannot take over; press Write.")
        if not path.name.lower().endswith(_PAGE):
            try:
                export_for(path)  # refuses an unknown suffix, before anything begins
            except DeformError as error:
                self.writing.message.value = ""
                raise DeformError(f"{str(error).rstrip('.')}; web page {_PAGE[0]}.") from None
        frozen = Frozen.of(self.session, self._view.settings())
        job = Job(path, frozen, downloads, page=self.page.options())
        if os.path.lexists(path) and not frozen.files.known.has(path):
            self.writing.message.value = ""
            is_volume = path.name.lower().endswith((*EXPORTS["volume"].suffixes, *_FOLDERS))
            doubt = ", and may be the original" if is_volume else ""
            self.writing.ask(f"{path.name} is already there{doubt}. Write over it?", job)
            return
        self.writing.begin(job)

    def _set_busy(self, is_busy: bool) -> None:
        self.download.disabled = self.write.disabled = is_busy

    def _copy(self) -> None:
        self.writing.message.value = ""
        note = (
            ""
            if self.session.files.source
            else (f"This volume has no file: line {VOLUME_LINE} is the place for yours before the script is run.")
        )
        self.writing.file_transfer.copy(self.session.code(), note)

    def close(self) -> None:
        """Stop the export."""
        self.writing.close()


class PageOptions:
    """Options of a web page: its title, the text under it, and the controls that it has.

    Parameters
    ----------
    name : of the volume, the first title.

    Attributes
    ----------
    box : of the widgets; title, text : the fields; controls : switches by the names of controls.

    Examples
    --------
    >>> options = PageOptions("fish")
    >>> options.controls["reset"].value = False
    >>> options.options()["title"], "reset" in options.options()["controls"]
    ('fish', False)
    """

    def __init__(self, name: str) -> None:
        whole = {"width": "auto", "margin": "2px 0"}
        self.title = basic.Text(value=name, description="Title", layout=whole, tooltip="Of the web page")
        self.text = basic.Textarea(
            description="Text",
            rows=3,
            layout=whole,
            continuous_update=False,
            placeholder="Instructions for readers of the page",
            tooltip="Text under the title of the web page",
        )
        self.controls = {
            name: basic.Checkbox(
                value=True,
                description=f"{label} on the page",
                indent=False,
                layout={"width": "auto", "margin": "2px 8px 2px 0"},
                tooltip="Whether the web page has this control",
            )
            for name, label in PAGE_CONTROLS.items()
        }
        self.box = column(self.title, self.text, row(*self.controls.values()))

    def options(self) -> dict[str, Any]:
        """The choices, as options of ``write_page``."""
        return {
            "title": self.title.value,
            "about": self.text.value,
            "controls": [name for name, box in self.controls.items() if box.value],
        }


class FileWriting:
    """Writes one file at a time in a separate thread, with progress and a button to stop.

    Parameters
    ----------
    guard : shows errors.
    write_page : writes the studio as one HTML file.
    set_busy : called with True while a file is being written, with False at its end.

    Attributes
    ----------
    bar, message, cancel : of the export; question : whether to write over a file.
    file_transfer : sends files to the browser.
    """

    def __init__(self, guard: Guard, write_page: WritePage, set_busy: Callable[[bool], None]) -> None:
        self._guard, self._write_page, self._set_busy = guard, write_page, set_busy
        self._job: Job | None = None  # to wait for
        self._ending = threading.Lock()
        self._thread = Worker("deformnb-files")
        self.bar = basic.FloatProgress(min=0.0, max=1.0, layout=basic.layout(width="120px", display="none"))
        self.message = basic.Label("")
        self.cancel = button("Cancel", "Stop; no half file is left", lambda: guard(self._cancel))
        self.question = Question(guard)
        self.file_transfer = FileTransfer()
        self._idle()

    def ask(self, text: str, job: Job) -> None:
        """Ask the user before a job that writes over a file."""
        over = Job(job.path, job.frozen, job.downloads, page=job.page, overwrite=True)
        self.question.ask(text, "Write over it", lambda: self.begin(over))

    def begin(self, job: Job) -> None:
        """Begin a job."""
        self.question.forget()
        self._set_busy(True)
        self.cancel.disabled = False
        self.bar.value = 0.0
        basic.set_visible(self.bar, True)
        self.message.value = f"Writing {job.path.name} ..."
        self._job = job
        self._thread.call(lambda: self._do(job))

    def _do(self, job: Job) -> None:
        try:
            with guard_writes(job.replace_target):
                if job.path.name.lower().endswith(_PAGE):
                    self._write_page(
                        job.path, **job.page, overwrite=job.overwrite, progress=partial(self._progress, job)
                    )
                else:
                    export(job.frozen, job.path, overwrite=job.overwrite, progress=partial(self._progress, job))
            content = job.path.read_bytes() if job.downloads else None
            if self._finish(job, f"Wrote {job.path.name} ({_size(job.path)}).") and content is not None:
                self._guard(lambda: self.file_transfer.download(job.path.name, content))
        except Cancelled:
            self._finish(job, f"Stopped; {job.path.name} was not written.")
        except FileChangedError:
            if self._finish(job, ""):
                self.ask(
                    f"{job.path.name} has been changed by someone else since it was opened or saved here."
                    " Write it under another name, or over theirs?",
                    job,
                )
        except Exception as error:
            reason = error
            if self._finish(job, ""):
                self._guard(error_action(reason))

    def _progress(self, job: Job, share: float) -> None:
        if job.is_cancelled:
            raise Cancelled("stopped in the studio.")
        if share - self.bar.value > 0.01 or share == 1:  # a message for every slice would flood the front end
            with self._ending:
                if self._job is job:
                    self.bar.value = share
                    left = remaining_time(time.monotonic() - job.begun, share)
                    self.message.value = ", ".join(w for w in (f"Writing {job.path.name} ... {share:.0%}", left) if w)

    def _cancel(self) -> None:
        """Free the panel immediately; the thread may notice the cancellation late, and ends then."""
        job = self._job
        if job is not None and job.cancel():
            self._thread.close(0)
            self._thread = Worker("deformnb-files")
            self._finish(job, f"Stopped; {job.path.name} was not written.")

    def _finish(self, job: Job, message: str) -> bool:
        """End the wait for a job with a message; False if it was awaited no more."""
        with self._ending:
            if self._job is not job:
                return False
            self._job = None
            self.message.value = message
            self._idle()
            return True

    def _idle(self) -> None:
        self.cancel.disabled = True
        basic.set_visible(self.bar, False)
        self._set_busy(False)  # last: who writes the next file finds all of it idle

    def close(self) -> None:
        """Stop the export."""
        if self._job is not None:
            self._job.cancel()
        self._thread.close()


class Job:
    """A file that is being written: it can be cancelled until it takes its place.

    Parameters
    ----------
    path : where it is written.
    frozen : what of.
    downloads : whether it is handed to the browser too.
    page : content of a web page, as options of ``write_page``.
    overwrite : whether the user has agreed that any file is replaced.

    Attributes
    ----------
    is_cancelled : whether it has been cancelled.
    begun : when, on the clock of :func:`time.monotonic`.

    Examples
    --------
    >>> job = Job(Path("fish.png"), None, False)
    >>> with job.replace_target():
    ...     job.cancel()
    False
    """

    def __init__(
        self,
        path: Path,
        frozen: Frozen,
        downloads: bool,
        *,
        page: Mapping[str, Any] | None = None,
        overwrite: bool = False,
    ) -> None:
        self.path, self.frozen, self.downloads, self.overwrite = path, frozen, downloads, overwrite
        self.page = dict(page or {})
        self.is_cancelled = self._is_landing = False
        self.begun = time.monotonic()
        self._lock = threading.Lock()

    def cancel(self) -> bool:
        """Cancel the writing; True if there will be no file, False once it takes its place, which takes no time."""
        with self._lock:
            self.is_cancelled = not self._is_landing
            return self.is_cancelled

    @contextmanager
    def replace_target(self) -> Iterator[None]:
        """The moment in which the file takes its place; Cancelled if it has been cancelled."""
        with self._lock:
            if self.is_cancelled:
                raise Cancelled("stopped in the studio.")
            self._is_landing = True
        yield


def _level_text(volume: Volume) -> str:
    """A line on the level of a pyramid that is shown; empty where that is the finest, or there is none."""
    if volume.level is None or volume.level.number == 0:
        return ""
    grid = volume.finest_grid
    return (
        f"Shown and edited: {volume.level}. The finest has {' x '.join(map(str, grid.shape[::-1]))} voxels, "
        f"{human_bytes(grid.size * volume.dtype.itemsize)}."
    )


def _size(path: Path) -> str:
    files = path.rglob("*") if path.is_dir() else [path]
    size = sum(file.stat().st_size for file in files if file.is_file())
    return f"{size / 1e6:.1f} MB" if size >= 1e5 else f"{size / 1e3:.1f} kB"


CHOICES = {"as the volume": "volume", "as large as needed": "needed", "with a margin": "margin"}
"""Choices of the result's box, as labels and names."""

_OWN = ("custom", "own")  # set by code

# Of the longest edge of the volume: the margin that is proposed.
_MARGIN = 0.1


class OutputCheck(Panel):
    """Check after each edit whether :attr:`Editing.output` cuts something off; where it should not, it grows.

    Parameters
    ----------
    worker : the studio's thread.
    editor : on whose picture the front end warns, from the outline of the tissue and at the end of each edit; it gets
        what is found here.

    Attributes
    ----------
    warning : a line below the pictures while something is cut off by a step in space, with the remedy.
    follows : whether the box is as large as needed after every edit; it then belongs to the edit, and goes with it.
    sides : of the box at which something is cut off.
    done : called after each check.
    """

    def __init__(self, session: Session, guard: Guard, worker: Worker, editor: Editor) -> None:
        super().__init__(session, guard)
        self.worker, self.editor = worker, editor
        self.follows = self._is_requested = False
        self.sides: tuple[str, ...] = ()
        self._checks = 0
        self.done: Callable[[], None] = lambda: None
        self._known: Deformation | None = None
        self._text: Any = None  # made with the first warning, as is the button
        self.warning = row()
        self.warning.is_visible = False
        editor.observe_larger_box(weakly(self, OutputCheck._make_larger))
        self.refresh()

    @property
    def is_needed(self) -> bool:
        """Choice of a box that is, or is about to be, as large as needed."""
        return self._is_requested or (self.follows and self.session.editing.output is not None)

    def follow(self, is_needed: bool) -> None:
        """Make the box as large as needed from now on, or leave it."""
        self.follows = self._is_requested = is_needed
        if is_needed:
            self._request()

    def arrange(self) -> None:
        if self.session.editing.output is None and not self._is_requested:
            self.follows = False  # it was undone
        if self._known is not self.session.editing.deformation:
            self._known = self.session.editing.deformation
            self._request()
        self._show_warning()

    def _show_warning(self) -> None:
        sides = () if self.session.editing.step.plane is not None else self.sides
        self.editor.enlarges = not self.follows  # then it is as large as it may be
        if sides and self._text is None:
            self._text = basic.HTML("", layout=basic.layout(flex="0 1 auto", min_width="0"))
            self.warning.children = (self._text, button(LARGER_BOX, LARGER_BOX_TIP, self._make_larger))
        if self._text is not None:
            self._text.value = as_html(cut_off_text(sides))
            basic.set_visible(self.warning.children[1], not self.follows)
        basic.set_visible(self.warning, sides)

    def _make_larger(self) -> None:
        self.guard(lambda: self.follow(True))
        self.refresh()
        self.done()

    # -- in the studio's thread ----------------------------------------------------------------------------------------

    def _request(self) -> None:
        if not self.worker.is_closed:
            self.worker.latest("result box", weakly(self, OutputCheck._check_again))

    def _fit(self) -> None:
        self.session.results.fit_output()

    def _check_again(self) -> None:
        with contextlib.suppress(DeformError):  # of an edit that has already reported it
            self.check()

    def check(self) -> None:
        """Make the box as large as needed, or find the tissue it cuts off; takes a moment."""
        session = self.session
        if self._is_requested:
            self.guard(self._fit)
            self._is_requested = False
        elif self.follows and session.editing.output is not None:
            session.results.fit_output(joins=True)
        self.sides = session.results.exceeded_sides()
        self._checks += 1
        self.editor.cut_off = {"check": self._checks, "sides": list(self.sides)}
        self.refresh()
        self.done()


class ResultBox(Panel):
    """A row of controls for :attr:`Editing.output`, in another panel."""

    def __init__(self, session: Session, guard: Guard, check: OutputCheck) -> None:
        super().__init__(session, guard)
        self.check = check
        self._length = float(f"{_MARGIN * max(session.editing.grid.lengths):.1g}")
        self.margin = basic.BoundedFloatText(
            value=self._length,
            min=0.0,
            max=4 * session.editing.grid.diagonal,
            step=1.0,
            continuous_update=False,
            description=unit_of(session.editing.grid),
            layout=basic.layout(width="120px"),
            style={"description_width": "28px"},
            tooltip="Added on every side of the volume, in whole voxels",
        )
        self.words = basic.HTML(
            "", layout=basic.layout(flex="1 1 200px", min_width="0")
        )  # a label would cut long words
        self.choice = self.add(
            menu(
                "Result box",
                self._options(),
                "The visible part, and the grid of the result: tissue dragged out of this box is cut off",
                wide(max_width="280px"),
            ),
            self._current_choice,
            self._choose,
        )
        self.add(self.margin, lambda: self._length, self._grow)
        self.box = row(self.choice, self.margin, self.words)
        check.done = weakly(self, ResultBox.refresh)
        self.refresh()

    def _current_choice(self) -> str:
        output = self.session.editing.output
        if self.check.is_needed:
            return "needed"
        if output is None:
            return "volume"
        return "own" if self._margin_of(output) is None else "margin"

    def _options(self) -> list[tuple[str, str]]:
        return [*CHOICES.items(), *([_OWN] if self._current_choice() == "own" else [])]

    def _margin_of(self, output: Grid) -> float | None:
        """The margin that makes this box; None if there is none."""
        grid = self.session.editing.grid
        index = -grid.point_to_index(output.origin)
        for length in (self._length, *(abs(index) * grid.spacing).tolist()):
            if padded(grid, length) == output:
                return float(length)
        return None

    def _choose(self, what: str) -> None:
        self.check.follow(what == "needed")
        if what == "margin":
            self._grow(self._length)
        elif what == "volume":
            self.session.editing.output = None

    def _grow(self, length: float) -> None:
        self._length = float(length)
        self.check.follows = False
        self.session.results.grow(self._length)

    def arrange(self) -> None:
        output, chosen = self.session.editing.output, self._current_choice()
        if chosen == "margin" and output is not None:
            self._length = self._margin_of(output) or self._length
        fill(self.choice, self._options())
        basic.set_visible(self.margin, chosen == "margin")
        grid = self.session.results.box
        size = " x ".join(map(str, grid.shape[::-1]))
        facts = [f"{size} voxels (x, y, z), {human_bytes(grid.size * self.session.volume.dtype.itemsize)}"]
        if self.check.sides:
            facts.append(f"cut off at the {join_names(self.check.sides)}")
        self.words.value = "; ".join(facts)

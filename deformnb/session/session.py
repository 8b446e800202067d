"""Session of one person with one volume: the edited document, its history, and the view state.

A session knows no widget and no thread: the notebook's studio and the application are thin front ends of it. Every
edit makes the next immutable document, or raises and leaves everything as it was; undo is a tree of old documents.
It may be called from any thread; observers are called in the thread of the edit.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Container
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike

from deformnb.analysis.extent import MOST, Matter, field_of_view, grown, landed, matter_of, sides_left
from deformnb.document.deformation import Deformation, LazyReference
from deformnb.document.edits import turned
from deformnb.document.script import UNKNOWN_VOLUME, as_python
from deformnb.document.transplant import with_true_spacing
from deformnb.errors import DeformError, OtherVolumeError
from deformnb.imaging.picture import PROJECTIONS, project
from deformnb.io.atomic import KnownFiles
from deformnb.io.documents import read_document, write_deformation
from deformnb.io.headers import human_bytes, shown
from deformnb.io.memory import available_memory
from deformnb.rbf.fields import AbstractField
from deformnb.session.editing import EditedSteps
from deformnb.session.view_state import Look, without_look
from deformnb.volume.plane import VIEWS, Picture, Plane
from deformnb.volume.transfer import TransferFunction, preset
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import warp


class Session(EditedSteps):
    """A volume, the deformation made of it so far, and the way back.

    Parameters
    ----------
    volume : what is deformed; never changed.
    deformation : to go on with, and to look at as it was saved; default is one step with a point in each corner of the
        picture that holds it still.
    view : side of the first picture, one of :data:`~deformnb.volume.plane.VIEWS`.
    output : grid of the result; default is the document's, and the volume's own if it has none.
    traits : first values of the traits below.

    Attributes
    ----------
    deformation : the document, observable; setting it is an edit that can be undone.
    index : the step that is edited.
    key : its set of control points that is edited, for the rule "interpolate".
    method : projection of the picture, a name of :data:`~deformnb.imaging.picture.PROJECTIONS`.
    depth : where a "slice" lies along the normal, from the middle of the volume.
    transfer : colours and opacities, a :class:`~deformnb.volume.transfer.TransferFunction` or the name of a preset.
    history : what "undo" and "redo" would do, in words.
    notice : the last thing worth saying, such as a trend that was changed along with a kernel; first the notes of the
        volume.
    saved : the document that is safe in a file of its user's, as it was last written or opened; None if none is.
    output : the grid of the result, which is what can be seen of it too (the field of view); None is the volume's own.
        It is part of the document: setting it is an edit that can be undone, and it is saved, restored and written as
        code along with the drags that need it. See :meth:`grow` and :meth:`fit_output`.
    source : an expression that reads the volume, for scripts; empty if that is not known.
    file : where it was last written or opened; None if nowhere.
    files : what was opened and written here, which alone is replaced unasked.
    reference : call it for what tells the volume from others; the first call takes a moment for a large volume.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> session = Session(PHANTOMS["bar"].make((32, 32, 32)), view="+y")
    >>> session.edit_points(session.points.add([10.0, 4.0], [10.0, 6.0]))
    >>> session.change(extrusion="modulate", curve="sin(pi*z)")
    >>> session.history["undo"]
    'change extrusion'
    >>> session.undo(), len(session.points)
    ('change extrusion', 5)
    """

    method = traitlets.Enum(list(PROJECTIONS), "mip")
    depth = traitlets.Float(0.0)
    transfer = traitlets.Any("specimen")
    saved = traitlets.Instance(Deformation, allow_none=True)
    file = traitlets.Instance(Path, allow_none=True)
    output = traitlets.Instance(Grid, allow_none=True)
    source = traitlets.Unicode("")

    def __init__(self, volume: Volume, deformation: Deformation | None = None, *, view: str | Plane = "+y",
                 output: Grid | None = None, **traits: Any) -> None:
        deformation, look = Look.parted(deformation or Deformation())
        deformation, laid = with_true_spacing(deformation, volume.grid)
        if output is not None:
            deformation = replace(deformation, output=output)
        self._matter: Matter | None = None
        self._base: tuple[Deformation, Volume] | None = None
        self._picture: tuple[Any, Picture] | None = None
        self._drawing, self._looking = threading.Lock(), threading.Lock()
        self._transfer: tuple[Any, TransferFunction] | None = None
        self.reference = LazyReference(volume)
        self.files = KnownFiles()
        self.volume = volume
        home = view if isinstance(view, Plane) else Plane.along(volume.grid, view)
        super().__init__(volume, deformation, home, **traits)
        self.notice = " ".join(f"{note[:1].upper()}{note[1:].rstrip('.')}." for note in (*volume.notes, laid) if note)
        made_on = deformation.volume  # whether it was this very one would take its checksum: see difference
        self._look_as(look, besides=traits, is_other=made_on is not None and made_on.shape != volume.shape)

    # -- the side of the picture ---------------------------------------------------------------------------------------

    @property
    def view(self) -> str | None:
        """The side of the picture by name, None for an oblique plane and for points in space."""
        return self.view_of(self.step.plane)

    def view_of(self, plane: Plane | None) -> str | None:
        """The name of a plane's side, None for an oblique plane and for none."""
        return next((v for v in VIEWS if Plane.along(self.volume.grid, v) == plane), None)

    def set_view(self, view: str | Plane) -> None:
        """Look from another side: back at the step made from there, or else on a new one after all others.

        So the volume is deformed on one picture, turned, and deformed on another (section 4.3 of the paper); the new
        picture shows what the steps before have made. A step as it began is turned instead of kept.
        """
        plane = view if isinstance(view, Plane) else Plane.along(self.volume.grid, view)
        with self._lock:
            if plane == self.step.plane:
                return
            new = replace(self._untouched(plane), kernel=self.step.kernel, trend=self.step.trend)
            deformation, index, notice = turned(self.deformation, self.index, new, self._untouched(self.step.plane))
            self.depth = 0.0
            self._become(deformation, "turn the picture", index=index, key=0)
            self.notice = notice

    # -- what is seen --------------------------------------------------------------------------------------------------

    @property
    def transfer_function(self) -> TransferFunction:
        """Colours and opacities, a preset fitted to the volume."""
        with self._lock:
            wanted = self.transfer
            if self._transfer is None or self._transfer[0] != wanted:
                self._transfer = (wanted, preset(wanted, self.volume) if isinstance(wanted, str) else wanted)
            return self._transfer[1]

    @traitlets.validate("transfer")
    def _valid_transfer(self, proposal: Any) -> Any:
        value = proposal["value"]
        if isinstance(value, str):
            preset(value, self.volume)
        elif not isinstance(value, TransferFunction):
            raise DeformError(f"transfer must be a TransferFunction or the name of a preset, got {value!r:.60}.")
        return value

    def _look_as(self, look: Look, *, besides: Container[str] = (), is_other: bool = False) -> None:
        """Take over how a document was looked at, as far as it tells."""
        for name, value in look.traits(is_other=is_other).items():
            if name not in besides:
                setattr(self, name, float(np.clip(value, *self.depth_range)) if name == "depth" else value)

    def base(self) -> Volume:
        """The volume as the steps before the one being edited have made it: what the picture shows."""
        return self._base_of(self._earlier())

    def _base_of(self, earlier: Deformation) -> Volume:
        if not earlier.steps:
            return self.volume
        kept = self._base
        if kept is None or kept[0] != earlier:
            kept = self._base = (earlier, warp(self.volume, earlier.field(self.volume.grid)))
        return kept[1]

    def before(self) -> AbstractField | None:
        """The backward displacement of the steps before the one being edited; None if there are none."""
        earlier = self._earlier()
        return earlier.field(self.volume.grid) if earlier.steps else None

    def _earlier(self) -> Deformation:
        with self._lock:
            steps = self.deformation.steps[: self.index]
            return Deformation(tuple(s for s in steps if s.enabled), mode=self.deformation.mode)

    def picture(self, progress: Callable[[float], None] | None = None) -> Picture:
        """The picture that is being edited, before the step that is edited; kept until something else is requested."""
        with self._drawing:  # one thread after the other, each for the document of one moment
            asked = self._asked()
            kept = self._picture
            if kept is not None and kept[0] == asked:
                return kept[1]
            earlier, plane, method, depth, colours = asked
            made = project(self._base_of(earlier), plane, method, transfer=colours,
                           depth=depth if method == "slice" else None, progress=progress)
            if asked == self._asked():  # else another one is wanted by now
                self._picture = (asked, made)
            return made

    def _asked(self) -> tuple[Deformation, Plane, str, float, TransferFunction | None]:
        """The settings on which the picture depends."""
        with self._lock:
            colours = self.transfer_function if self.method in ("composite", "shaded") else None
            return self._earlier(), self.plane, self.method, self.depth if self.method == "slice" else 0.0, colours

    @property
    def depth_range(self) -> tuple[float, float]:
        """Range of slice depths, from the middle of the volume."""
        return self.plane.depth_range(self.volume.grid)

    # -- the box of the result -----------------------------------------------------------------------------------------

    @traitlets.validate("output")
    def _valid_output(self, proposal: Any) -> Grid | None:
        self._set_output(proposal["value"])
        return self.deformation.output

    @traitlets.observe("output")
    def _output_taken_back(self, change: Any) -> None:
        if change["new"] is None:  # traitlets has nobody validate None
            self._set_output(None)

    def _set_output(self, grid: Grid | None) -> None:
        with self._lock:
            if grid != self.deformation.output:  # set from outside: an edit like any other
                self._become(replace(self.deformation, output=grid), "change the result box", "result box")

    def _show_parts(self) -> None:
        self.output = self.deformation.output

    @property
    def box(self) -> Grid:
        """The grid of the result, the volume's own if there is no other."""
        return self.output or self.volume.grid

    def grow(self, margin: ArrayLike) -> None:
        """Give the result a margin around the volume, so that what is dragged out of its box is not cut off.

        Parameters
        ----------
        margin : a length or (x, y, z), rounded up to whole voxels; 0 is the volume's own box again, negative crops.
        """
        grid = grown(self.volume.grid, margin)
        self.output = None if grid == self.volume.grid else grid

    def fit_output(self, *, most: float = MOST, joins: bool = False) -> bool:
        """Give the result a box as large as deformed foreground needs, and at least that of the volume.

        Parameters
        ----------
        most : how many times the voxels of the volume it may have; a notice says if that is too few.
        joins : as part of the last edit, which undo takes back together with it; nothing happens if another edit, or an
            older state, is shown by the time that the box is known.

        Returns
        -------
        Whether all of the foreground fits.
        """
        with self._lock:
            deformation, field = self.deformation, self.field()
        found = field_of_view(self.matter(), field, most=most)
        if joins:
            if found.grid != deformation.output:
                self.amend(deformation, replace(deformation, output=found.grid), self.notice)
        else:
            self.output = found.grid
        if found.is_limited:
            self.notice = (f"Matter reaches farther than a box of {most:g} times the volume's voxels; what lies beyond "
                           "it is cut off.")
        return not found.is_limited

    def sides_left(self) -> tuple[str, ...]:
        """The sides on which dragged foreground leaves the box of the result, in words; takes a moment."""
        if not _moves(self.deformation):
            return ()
        return sides_left(landed(self.matter(), self.field()), self.box)

    def matter(self) -> Matter:
        """Foreground of the volume; looked up once."""
        with self._looking:
            if self._matter is None:
                self._matter = matter_of(self.volume)
            return self._matter

    @traitlets.validate("saved")
    def _valid_saved(self, proposal: Any) -> Deformation | None:
        """Without its look: what has other colours only is not unsaved."""
        return None if proposal["value"] is None else without_look(proposal["value"])

    # -- results -------------------------------------------------------------------------------------------------------

    def result(self, progress: Callable[[float], None] | None = None) -> Volume:
        """The deformed volume on the grid :attr:`output`, warped with the document of this moment."""
        with self._lock:
            field, output = self.field(), self.output
        check_room(self.volume, output)
        return warp(self.volume, field, output=output, progress=progress)

    def document(self) -> Deformation:
        """The deformation, how it is looked at, and the checksum of its volume, as it is saved."""
        return Look.of(self).added_to(replace(self.deformation, volume=self.reference()))

    def save(self, path: str | PathLike[str], *, overwrite: bool = False, document: Deformation | None = None) -> None:
        """Write the document as JSON.

        Parameters
        ----------
        overwrite : replace any file; else only one that holds what was opened or saved here.
        document : of an earlier moment; default is that of now.

        Raises
        ------
        FileChangedError
            If the file was there before, or somebody else has changed it; nothing is written.
        """
        document = document or self.document()
        write_deformation(document, path, known=self.files, overwrite=overwrite)
        self.file, self.saved = Path(path), document

    def open(self, path: str | PathLike[str], *, allow_other_volume: bool = False) -> None:
        """Go on with a saved document; can be undone.

        Parameters
        ----------
        allow_other_volume : open it even if it was made on another volume; a notice says so.

        Raises
        ------
        OtherVolumeError
            If it was made on another volume and that is not allowed; everything stays as it was.
        """
        document, content = read_document(path)
        self.take(document, allow_other_volume=allow_other_volume)
        if self.saved is not None:  # else it was changed to fit, and the file keeps what it was
            self.files.remember(path, content)
            self.file = Path(path)

    def take(self, deformation: Deformation, label: str = "open a document", *,
             allow_other_volume: bool = False) -> None:
        """Go on with another document that is kept elsewhere; can be undone, but for colours and projection.

        See :meth:`open`.
        """
        deformation, look = Look.parted(deformation)
        laid = ""
        try:
            deformation, laid = with_true_spacing(deformation, self.volume.grid)
        except OtherVolumeError:
            if not allow_other_volume:
                raise
        difference = self.difference(deformation)
        if difference and not allow_other_volume:
            raise OtherVolumeError(f"{difference} Pass allow_other_volume=True to open it all the same.")
        with self._lock:
            self._become(deformation, label, index=max(0, len(deformation.steps) - 1), key=0)
            self.file, self.saved = None, None if laid else self.deformation
        self._look_as(look, is_other=bool(difference))
        if difference or laid:
            self.notice = difference or laid

    def difference(self, deformation: Deformation) -> str:
        """Warning about a document that was made on another volume; empty if it was made on this one.

        Labels that lie as the volume does belong to it. A document that does not tell its volume fits any.
        """
        made_on = deformation.volume
        if made_on is None:
            return ""
        if made_on.shape == self.volume.shape and (
                made_on.sha256 == self.reference().sha256 or made_on.has_labels(self.volume)):
            here = self.volume.grid
            if (made_on.grid or replace(here, spacing=made_on.spacing)).is_like(here):  # before 1.2 it told no place
                return ""
            then, now = (" x ".join(f"{s:.6g}" for s in spacing) for spacing in (made_on.spacing, here.spacing))
            return ("This document was made on the same voxels at another place or of another size "
                    f"({then} then, {now} now); its points may lie elsewhere.")
        return (f"This document was made on another volume ({shown(made_on.name) or 'without a name'}, "
                f"{' x '.join(str(n) for n in made_on.shape[::-1])} voxels); its points may lie elsewhere.")

    def code(self, volume: str = "") -> str:
        """The document as a Python script; see :func:`deformnb.document.script.as_python`.

        Parameters
        ----------
        volume : expression that gives the volume; default reads the file that it came from.
        """
        return as_python(self.deformation, self.volume.grid, volume=volume or self.source or UNKNOWN_VOLUME)


def check_room(volume: Volume, output: Grid | None) -> None:
    """Refuse a result that there is no memory for: else the system would end the process, and the session with it.

    Raises
    ------
    DeformError
        With what it takes and what is free.
    """
    grid = output or volume.grid
    needed, free = grid.size * volume.dtype.itemsize, available_memory()
    if needed > free:
        remedy = "choose a smaller result box" if grid.size > volume.grid.size else "read the volume with a stride"
        raise DeformError(f"the deformed volume takes {human_bytes(needed)} and {human_bytes(free)} are free; "
                          f"close something else, or {remedy}.")


def _moves(deformation: Deformation) -> bool:
    """Check whether anything is dragged at all: a scan may be cut through tissue as it is."""
    return any(part.motion is not None for step in deformation.steps for part in step.parts) or any(
        bool(points.displacement.any()) for step in deformation.steps for points in step.maps)

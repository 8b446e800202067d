"""What one person does to one volume: the document being edited, its history, and how it is looked at.

A session knows no widget and no thread: the notebook's studio and the application are thin front ends of it. Every
edit makes the next immutable document, or raises and leaves everything as it was; undo is the list of old documents.
It may be called from any thread; observers are called in the thread of the edit.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any, NamedTuple

import traitlets

from deformnb.control_points import ControlPoints
from deformnb.deformation import Deformation, Step, VolumeReference
from deformnb.errors import DeformError
from deformnb.fields import AbstractField
from deformnb.history import History
from deformnb.io.documents import read_deformation, write_deformation
from deformnb.picture import PROJECTIONS, Picture, project
from deformnb.plane import VIEWS, Plane
from deformnb.script import as_python
from deformnb.step_changes import complete_change, points_between, turned, untouched_step
from deformnb.transfer import TransferFunction, preset
from deformnb.volume import Volume
from deformnb.warp import warp

_NAMES = {"kernel": "kernel", "support": "support radius", "trend": "trend", "smoothing": "smoothing",
          "extrusion": "extrusion", "curve": "curve", "knots": "keys", "strength": "strength", "enabled": "switch",
          "maps": "points", "plane": "plane", "name": "name"}


class _State(NamedTuple):
    deformation: Deformation
    step: int
    key: int


class Session(traitlets.HasTraits):
    """A volume, the deformation made of it so far, and the way back.

    Parameters
    ----------
    volume : what is deformed; never changed.
    deformation : to go on with; default is one step with a point in each corner of the picture that holds it still.
    view : side of the first picture, one of :data:`~deformnb.plane.VIEWS`.
    traits : first values of the traits below.

    Attributes
    ----------
    deformation : the document, observable; setting it is an edit that can be undone.
    index : the step that is edited.
    key : its set of control points that is edited, for the rule "interpolate".
    method : projection of the picture, a name of :data:`~deformnb.picture.PROJECTIONS`.
    depth : where a "slice" lies along the normal, from the middle of the volume.
    transfer : colours and opacities, a :class:`~deformnb.transfer.TransferFunction` or the name of a preset.
    history : what "undo" and "redo" would do, in words.
    notice : the last thing worth saying, such as a trend that was changed along with a kernel.

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

    deformation = traitlets.Instance(Deformation)
    index = traitlets.Int(0)
    key = traitlets.Int(0)
    method = traitlets.Enum(list(PROJECTIONS), "mip")
    depth = traitlets.Float(0.0)
    transfer = traitlets.Any("specimen")
    history = traitlets.Dict()
    notice = traitlets.Unicode("")

    def __init__(self, volume: Volume, deformation: Deformation | None = None, *, view: str | Plane = "+y",
                 **traits: Any) -> None:
        self._lock = threading.RLock()
        self._history = History()
        self._is_checked = False  # while a document is set that has been checked
        self._field: tuple[Deformation, AbstractField] | None = None
        self._base: tuple[tuple[Step, ...], Volume] | None = None
        self._picture: tuple[Any, Picture] | None = None
        self._transfer: tuple[Any, TransferFunction] | None = None
        self._reference: VolumeReference | None = None
        self.volume = volume
        self._home = view if isinstance(view, Plane) else Plane.along(volume.grid, view)
        super().__init__(**traits)
        first = self._checked(deformation or Deformation())
        self._show(_State(first, len(first.steps) - 1, 0))

    # -- the document --------------------------------------------------------------------------------------------------

    @property
    def step(self) -> Step:
        """The step that is edited."""
        return self.deformation.steps[min(self.index, len(self.deformation.steps) - 1)]

    @property
    def points(self) -> ControlPoints:
        """The control points that are edited."""
        step = self.step
        return step.maps[min(self.key, len(step.maps) - 1)]

    @property
    def plane(self) -> Plane:
        """Where the picture lies; for points in space, where the first picture lay."""
        return self.step.plane or self._home

    @property
    def view(self) -> str | None:
        """The side of the picture by name, None for an oblique plane."""
        return self.view_of(self.plane)

    def view_of(self, plane: Plane | None) -> str | None:
        """The name of a plane's side, None for an oblique plane and for none."""
        return next((v for v in VIEWS if Plane.along(self.volume.grid, v) == plane), None)

    def edit_points(self, points: ControlPoints, label: str = "move points", kind: str | None = None) -> None:
        """Other control points in the place of those being edited.

        Parameters
        ----------
        label : what was done, for the history.
        kind : edits of one kind in quick succession are one step of undo; None never joins.

        Raises
        ------
        DeformError
            If they cannot be fitted; everything stays as it was.
        """
        with self._lock:
            step = self.step.with_points(points, min(self.key, len(self.step.maps) - 1))
            self._become(self.deformation.with_step(self.index, step), label, kind)

    def change(self, label: str = "", kind: str | None = None, **fields: Any) -> None:
        """Change fields of the step being edited, such as ``kernel="gaussian"``.

        A kernel that needs a richer trend gets it, with a notice. The rule "interpolate" spreads the points to three
        depths at first; leaving it keeps those being edited.

        Raises
        ------
        DeformError
            If that makes no deformation; everything stays as it was.
        """
        with self._lock:
            notice = complete_change(self.step, self.points, fields)
            label = label or "change " + " and ".join(_NAMES.get(name, name) for name in list(fields)[:1])
            step = replace(self.step, **fields)
            key = min(self.key, len(step.maps) - 1)
            self._become(self.deformation.with_step(self.index, step), label, kind, key=key)
            self.notice = notice

    def set_view(self, view: str | Plane) -> None:
        """Look from another side: back at the step made from there, or else on a new one after all others.

        So the volume is deformed on one picture, turned, and deformed on another (section 4.3 of the paper); the new
        picture shows what the steps before have made. A step as it began is turned instead of kept.
        """
        plane = view if isinstance(view, Plane) else Plane.along(self.volume.grid, view)
        with self._lock:
            if plane == self.plane:
                return
            new = replace(self._untouched(plane), kernel=self.step.kernel, trend=self.step.trend)
            deformation, index, notice = turned(self.deformation, self.index, new, self._untouched(self.plane))
            self.depth = 0.0
            self._become(deformation, "turn the picture", index=index, key=0)
            self.notice = notice

    def add_step(self) -> None:
        """One more step after all others, on the same side."""
        with self._lock:
            last = len(self.deformation.steps)
            self._become(self.deformation.then(self._untouched(self.plane)), "add a step", index=last, key=0)
            self.notice = f"Step {last + 1} begins: what is dragged now is done after step {last}."

    def remove_step(self) -> None:
        """Without the step that is edited; of the only one, only its drags go."""
        with self._lock:
            if len(self.deformation.steps) == 1:
                self.reset()
                return
            left = self.deformation.without_step(self.index)
            self._become(left, f"remove step {self.index + 1}", index=max(0, self.index - 1), key=0)

    def edit_step(self, index: int, key: int = 0) -> None:
        """Choose the step, and its set of points, that is edited."""
        if not 0 <= index < len(self.deformation.steps):
            raise DeformError(f"there is no step {index}; there are {len(self.deformation.steps)}.")
        if not 0 <= key < len(self.deformation.steps[index].maps):
            raise DeformError(f"step {index} has no set of points {key}.")
        with self._lock, self.hold_trait_notifications():
            self.index, self.key = index, key

    def edit_keys(self, knots: Sequence[float], *, added: int | None = None, removed: int | None = None,
                  selected: int = 0) -> None:
        """Move, add or remove key pictures of the rule "interpolate".

        Parameters
        ----------
        knots : their depths afterwards.
        added : index of a new one, which begins as the blend of its neighbours; removed : old index of one that goes.
        selected : the key that is edited afterwards.
        """
        with self._lock:
            maps, z = list(self.step.maps), list(knots)
            if removed is not None:
                del maps[removed]
            if added is not None:
                maps.insert(added, points_between(maps, z, added))
            step = replace(self.step, maps=tuple(maps), knots=tuple(z))
            label = "add a key" if added is not None else "remove a key" if removed is not None else "move a key"
            self._become(self.deformation.with_step(self.index, step), label, key=selected)

    def reset(self) -> None:
        """The volume as it was, seen from the same side."""
        with self._lock:
            self._become(replace(self.deformation, steps=(self._untouched(self.plane),)), "reset", index=0, key=0)

    def _untouched(self, plane: Plane) -> Step:
        return untouched_step(plane, self.volume.grid)

    def _become(self, deformation: Deformation, label: str, kind: str | None = None, *, index: int | None = None,
                key: int | None = None) -> None:
        deformation = self._checked(deformation)
        before = self._state
        after = _State(deformation, before.step if index is None else index, before.key if key is None else key)
        if after == before:
            return
        self.notice = ""  # what was said of the edit before
        self._history.record(before, label, kind)
        self._show(after)

    @property
    def _state(self) -> _State:
        return _State(self.deformation, self.index, self.key)

    def _show(self, state: _State) -> None:
        """Set what has been checked, all at once: observers see no mixture."""
        self._is_checked = True
        try:
            with self.hold_trait_notifications():
                self.deformation, self.index, self.key = state
                self.history = self._history.labels()
        finally:
            self._is_checked = False

    def _checked(self, deformation: Any) -> Deformation:
        if not isinstance(deformation, Deformation):
            raise DeformError(f"a session holds a Deformation, got {type(deformation).__name__}.")
        if not deformation.steps:
            deformation = replace(deformation, steps=(self._untouched(self._home),))
        self._field = (deformation, deformation.field(self.volume.grid))  # refuses what cannot be fitted
        return deformation

    @traitlets.validate("deformation")
    def _valid_deformation(self, proposal: Any) -> Deformation:
        if self._is_checked:
            return proposal["value"]
        with self._lock:  # set from outside: an edit like any other
            deformation = self._checked(proposal["value"])
            self._history.record(self._state, "change by code")
        return deformation

    @traitlets.observe("deformation")
    def _fit_the_rest(self, _change: Any) -> None:
        if not self._is_checked:
            self.index = min(self.index, len(self.deformation.steps) - 1)
            self.key = min(self.key, len(self.step.maps) - 1)
            self.history = self._history.labels()

    # -- the way back --------------------------------------------------------------------------------------------------

    def undo(self) -> str:
        """Take back the last edit; returns what it was, empty if there is none."""
        return self._travel("undo")

    def redo(self) -> str:
        """Do again what was taken back; returns what it was, empty if there is nothing."""
        return self._travel("redo")

    def _travel(self, way: str) -> str:
        with self._lock:
            found = self._history.step(way, self._state)
            if found is None:
                return ""
            self._show(found[0])
            return found[1]

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

    def base(self) -> Volume:
        """The volume as the steps before the one being edited have made it: what the picture shows."""
        with self._lock:
            steps = tuple(s for s in self.deformation.steps[: self.index] if s.enabled)
        if not steps:
            return self.volume
        if self._base is None or self._base[0] != steps:
            self._base = (steps, warp(self.volume, Deformation(steps).field(self.volume.grid)))
        return self._base[1]

    def picture(self, progress: Callable[[float], None] | None = None) -> Picture:
        """The picture that is being edited, before the step that is edited; kept until something else is asked for."""
        base, plane = self.base(), self.plane
        colours = self.transfer_function if self.method in ("composite", "shaded") else None
        asked = (id(base), plane, self.method, self.depth if self.method == "slice" else 0.0, colours)
        kept = self._picture
        if kept is None or kept[0] != asked:
            depth = self.depth if self.method == "slice" else None
            made = project(base, plane, self.method, transfer=colours, depth=depth, progress=progress)
            kept = self._picture = (asked, made)
        return kept[1]

    @property
    def depth_range(self) -> tuple[float, float]:
        """Where slices may lie, from the middle of the volume."""
        return self.plane.depth_range(self.volume.grid)

    # -- results -------------------------------------------------------------------------------------------------------

    def field(self) -> AbstractField:
        """The backward displacement in space of the whole document."""
        with self._lock:
            assert self._field is not None
            if self._field[0] is not self.deformation:
                self._field = (self.deformation, self.deformation.field(self.volume.grid))
            return self._field[1]

    def warm_up(self) -> None:
        """Compile what the first drag needs, so that it need not wait; changes nothing."""
        points, step = self.points, self.step
        place = points.target.mean(axis=0) if len(points) else (0.0, 0.0, 0.0)[: points.dim]
        moved = points.add(place, [c + 0.01 * self.volume.grid.diagonal for c in place])
        with contextlib.suppress(DeformError):  # the first edit will say it
            replace(step, maps=(moved,) * len(step.maps)).field(self.volume.grid)

    def notes(self) -> tuple[str, ...]:
        """Remarks of the fits, each once."""
        return self.deformation.notes(self.volume.grid)

    def result(self, progress: Callable[[float], None] | None = None) -> Volume:
        """The deformed volume, warped with the document of this moment."""
        return warp(self.volume, self.field(), progress=progress)

    def document(self) -> Deformation:
        """The deformation together with the checksum of its volume, as it is saved."""
        if self._reference is None:
            self._reference = VolumeReference.of(self.volume)
        return replace(self.deformation, volume=self._reference)

    def save(self, path: str | PathLike[str]) -> None:
        """Write the document as JSON."""
        write_deformation(self.document(), path)

    def open(self, path: str | PathLike[str]) -> None:
        """Go on with a saved document; can be undone. A notice says if it was made on another volume."""
        self.take(read_deformation(path))

    def take(self, deformation: Deformation, label: str = "open a document") -> None:
        """Go on with another document; can be undone."""
        with self._lock:
            self._become(deformation, label, index=max(0, len(deformation.steps) - 1), key=0)
        made_on = deformation.volume
        if made_on is not None and made_on.sha256 != self.document().volume.sha256:  # type: ignore[union-attr]
            self.notice = (f"This document was made on another volume ({made_on.name or 'without a name'}, "
                           f"{' x '.join(str(n) for n in made_on.shape[::-1])} voxels); its points may lie elsewhere.")

    def code(self, volume: str = 'dn.read_volume("volume.nii.gz")') -> str:
        """The document as a Python script; see :func:`deformnb.script.as_python`."""
        return as_python(self.deformation, self.volume.grid, volume=volume)

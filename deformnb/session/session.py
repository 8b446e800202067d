"""Session of one user with one volume: the edited document, its history, and the view state.

A session has no widget and no thread: the notebook's studio and the application are thin front ends of it. Every
edit makes the next immutable document, or raises and leaves everything as it was; undo is a tree of old documents.
It may be called from any thread; observers are called in the thread of the edit.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import product
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import traitlets
from numpy.typing import ArrayLike

from deformnb.analysis.extent import (
    MOST,
    Foreground,
    exceeded_sides,
    field_of_view,
    foreground_of,
    padded,
    reached_places,
)
from deformnb.checks import check_arguments, checked_window, one_of
from deformnb.document.deformation import STEP_LABELS, Deformation, LazyReference, Step
from deformnb.document.edits import complete_change, points_between, turned, untouched_step
from deformnb.document.script import UNKNOWN_VOLUME, as_python, own_grid_text
from deformnb.document.transplant import with_true_spacing
from deformnb.errors import DeformError, OtherVolumeError
from deformnb.imaging.projection import OF_CHANNELS, PROJECTIONS, project, project_channels
from deformnb.io.documents import read_document, write_deformation
from deformnb.io.files.atomic import KnownFiles
from deformnb.io.files.memory import check_room
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidPart, carried_points, without_conflicts
from deformnb.registration.outlines import OUTLINE_POINT, hold_outline, outline
from deformnb.session.history import History, HistoryNode
from deformnb.session.inputs import as_deformation, as_volume_and_channels, source_of, subject_from
from deformnb.session.view_state import ViewState, without_view_state
from deformnb.volume.channels import ChannelDisplay, Channels, ChannelsLike, as_channels
from deformnb.volume.colour_maps import COLOUR_MAPS
from deformnb.volume.plane import SIDES, VIEWS, Picture, Plane, Slices
from deformnb.volume.transfer import TransferFunction, levels, preset
from deformnb.volume.volume import Grid, Volume, VolumeLike, as_grid
from deformnb.warping.points import Landmarks, LandmarksLike, as_landmarks
from deformnb.warping.warper import warp_all


class _State(NamedTuple):
    deformation: Deformation
    step: int
    key: int


class Session(traitlets.HasTraits):
    """A volume, the deformation made of it so far, and the way back.

    Parameters
    ----------
    volume : what is deformed; never changed. Whatever is a volume, channels or a mesh will do, as in the studio.
    deformation : to go on with, and to look at as it was saved; default is one step with a point in each corner of the
        picture that holds it still.
    view : side of the first picture, one of :data:`~deformnb.volume.plane.VIEWS`.
    output : grid of the result; default is the document's, and the volume's own if it has none.
    channels : that are deformed together, where the volume is their
        :meth:`~deformnb.volume.channels.Channels.brightness`.
    traits : first values of the traits below.

    Attributes
    ----------
    deformation : the document, observable; setting it is an edit that can be undone.
    index : the step that is edited.
    key : its set of control points that is edited, for the rule "interpolate".
    method : projection of the picture, a name of :data:`~deformnb.imaging.projection.PROJECTIONS`.
    depth : where a "slice" lies along the normal, from the middle of the volume.
    window : values shown as black and white in grey pictures, set by hand; None for the automatic window of each.
    colour_map : of grey pictures, a name of :data:`~deformnb.volume.colour_maps.COLOUR_MAPS`.
    channel_displays : colour, window and visibility of each of the channels, a
        :class:`~deformnb.volume.channels.ChannelDisplay`; empty where there are none.
    ambient_occlusion : whether hollows of the volume are darker in a live view.
    transfer : colours and opacities, a :class:`~deformnb.volume.transfer.TransferFunction` or the name of a preset.
    history : what "undo" and "redo" would do, in words.
    notice : the last message to the user, such as a trend that was changed along with a kernel; first the notes of the
        volume.
    first : the document with which it began.
    saved : the document that is safe in a file of its user's, as it was last written or opened; None if none is.
    output : the grid of the result, which is what can be seen of it too (the field of view); None is the volume's own.
        It is part of the document: setting it is an edit that can be undone, and it is saved, restored and written as
        code along with the drags that need it. See :meth:`grow` and :meth:`fit_output`.
    source : an expression that reads the volume, for scripts; empty if that is not known.
    file : where it was last written or opened; None if nowhere.
    files : what was opened and written here, which alone is replaced unasked.
    reference : call it for what identifies the volume; the first call takes a moment for a large volume.

    Notes
    -----
    The selection is one step of the document and one of its sets of points. Both go along with undo, and the step goes
    on being edited wherever it is moved. Steps count from 0 here, and from 1 in the words of the history.

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
    history = traitlets.Dict()
    notice = traitlets.Unicode("")
    method = traitlets.Enum(list(PROJECTIONS), "mip")
    depth = traitlets.Float(0.0)
    window = traitlets.Any(None)
    colour_map = traitlets.Unicode(COLOUR_MAPS[0])
    channel_displays = traitlets.Tuple()
    ambient_occlusion = traitlets.Bool(True)
    transfer = traitlets.Any("specimen")
    saved = traitlets.Instance(Deformation, allow_none=True)
    file = traitlets.Instance(Path, allow_none=True)
    output = traitlets.Instance(Grid, allow_none=True)
    source = traitlets.Unicode("")

    def __init__(
        self,
        volume: ChannelsLike,
        deformation: Deformation | str | PathLike[str] | None = None,
        *,
        view: str | Plane = "+y",
        output: Grid | VolumeLike | None = None,
        channels: ChannelsLike | None = None,
        **traits: Any,
    ) -> None:
        traits.setdefault("source", source_of(volume))
        volume, own = as_volume_and_channels(subject_from(volume))
        channels = own if channels is None else as_channels(channels)
        output = None if output is None else as_grid(output)
        deformation, view_state = ViewState.split(as_deformation(deformation) or Deformation())
        deformation, laid = with_true_spacing(deformation, volume.finest_grid)
        if output is not None:
            deformation = replace(deformation, output=output)
        self._lock = threading.RLock()
        self._history = History()
        self._is_checked = False  # while a document is set that has been checked
        self._field: tuple[Deformation, AbstractField] | None = None
        self._foreground: Foreground | None = None
        self._base: tuple[Deformation, Volume] | None = None
        self._picture: tuple[Any, Picture] | None = None
        self._styled: tuple[Picture, Picture] | None = None  # in its automatic window, and as it is shown
        self._drawing, self._looking = threading.Lock(), threading.Lock()
        self._transfer: tuple[Any, TransferFunction] | None = None
        self.reference = LazyReference(volume)
        self.files = KnownFiles()
        self.volume, self.channels = volume, channels
        self._deformed_channels: tuple[Deformation, Channels] | None = None
        if channels is not None:
            traits.setdefault("channel_displays", channels.displays())
        self._home = view if isinstance(view, Plane) else Plane.along(volume.finest_grid, view)
        super().__init__(**traits)
        first = self._checked(deformation)
        self.first = first
        self._show(_State(first, len(first.steps) - 1, 0))
        notes = (*volume.decided(volume.is_labels).notes, laid)  # whether voxels are labels is asked by the front end
        self.notice = " ".join(f"{note[:1].upper()}{note[1:].rstrip('.')}." for note in notes if note)
        made_on = deformation.volume  # whether it was this very one would take its checksum: see difference
        self._restore_view_state(
            view_state, besides=traits, is_other=made_on is not None and made_on.shape != self.grid.shape
        )

    # -- the step that is edited ---------------------------------------------------------------------------------------

    @property
    def grid(self) -> Grid:
        """The grid on which the document is stated: the volume's, or that of the finest level of its pyramid."""
        return self.volume.finest_grid

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
        """Plane of the picture; for points in space, that of the first picture."""
        return self.step.plane or self._home

    @check_arguments
    def edit_step(self, index: int, key: int = 0) -> None:
        """Choose the step, and its set of points, that is edited."""
        if not 0 <= index < len(self.deformation.steps):
            raise DeformError(f"there is no step {index}; there are {len(self.deformation.steps)}.")
        if not 0 <= key < len(self.deformation.steps[index].maps):
            raise DeformError(f"step {index} has no set of points {key}.")
        with self._lock, self.hold_trait_notifications():
            self.index, self.key = index, key

    # -- edits of the document, its points and its settings ------------------------------------------------------------

    def edit_document(
        self, deformation: Deformation, label: str, index: int | None = None, kind: str | None = None
    ) -> None:
        """Any other document in the place of this one, as one edit that can be undone.

        Parameters
        ----------
        label : what was done, for the history.
        index : the step that is edited afterwards; None stays at its place in the list, if there is one.
        kind : edits of one kind in quick succession are one step of undo; None never joins.

        Raises
        ------
        DeformError
            If it cannot be fitted; everything stays as it was.
        """
        with self._lock:
            self._become(deformation, label, kind, index=index)

    @check_arguments
    def edit_points(self, points: ControlPoints, label: str = "move points", kind: str | None = None) -> None:
        """Other control points in the place of those being edited.

        A name is that of a landmark: points of other keys that have the same id get it too.

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
            key, before = min(self.key, len(self.step.maps) - 1), self.points
            points = replace(points.in_unit(self.grid.unit), unit="")
            step = _renamed(self.step.with_points(points, key), key, before)
            self._become(self.deformation.with_step(self.index, step), label, kind)

    def add_landmarks(self, landmarks: LandmarksLike) -> None:
        """Add control points at landmarks, dragged to their fixed places where they have any.

        Parameters
        ----------
        landmarks : places in space (LPS), which on a picture are seen from its side, or on a picture its (a, b). Where
            their unit is known they are converted to that of the volume.

        Raises
        ------
        DeformError
            If they have two coordinates and the step's points three, or the points cannot be fitted.
        """
        landmarks, plane = as_landmarks(landmarks), self.step.plane
        if plane is None and landmarks.points.shape[1] == 2:
            raise DeformError(
                "these landmarks lie on a picture, and the points of this step in space: choose another step."
            )
        landmarks = landmarks.in_unit(self.grid.unit)
        source, points = landmarks.points, self.points
        target = source if landmarks.fixed is None else np.where(np.isfinite(landmarks.fixed), landmarks.fixed, source)
        if plane is not None and source.shape[1] == 3:
            source, target = (plane.to_plane(places)[:, :2] for places in (source, target))
        assert landmarks.active is not None
        for start, end, name, active in zip(source, target, landmarks.names, landmarks.active, strict=True):
            new = points.next_id
            points = points.add(start, end, name=name)
            points = points if active else points.edit(new, active=False)
        self.edit_points(points, "add landmarks")

    def landmarks(self) -> Landmarks:
        """The control points being edited as landmarks in space (LPS), with their targets as fixed places.

        Those of a picture lie in its plane.
        """
        points, plane = self.points, self.step.plane
        ends = [points.source, points.target]
        source, target = ends if plane is None else [plane.from_plane(end) for end in ends]
        return Landmarks(source, points.names, fixed=target, active=points.active, unit=self.grid.unit)

    def hold_outline(self, count: int = 16) -> None:
        """Add points that stay along the outline of what the picture shows: drags bend only what lies around them.

        On a slice and a maximum the outline is where the values rise above air, elsewhere where dark and bright part
        best. Points that hold it already and were not moved make room.

        Parameters
        ----------
        count : places along the outline; those beside another point stay free.

        Raises
        ------
        DeformError
            For a step in space, and where nothing is seen on the picture.
        """
        if self.step.plane is None:
            raise DeformError(
                "an outline lies on a picture, and this step has its points in space: choose another step, or add one."
            )
        picture, level = self.automatic_picture(), None  # a window set by hand may begin above air
        if self.method in ("slice", "mip"):
            low, high = picture.window
            level = min(max((levels(self.volume)[1] - low) / (high - low), 0.02), 0.98)
        lines = outline(picture, level)
        if not lines:
            raise DeformError("there is no outline on the picture: all of it is alike.")
        points = hold_outline(self.points, lines[0], count=count)
        self.edit_points(points, "hold the outline")
        self.notice = (
            f"{points.names.count(OUTLINE_POINT)} points hold the outline: a drag bends only what lies around it."
        )

    def change(self, label: str = "", kind: str | None = None, *, slides: bool = False, **fields: Any) -> None:
        """Change fields of the step being edited, such as ``kernel="gaussian"``.

        A kernel that needs a richer trend gets it, with a notice. The rule "interpolate" spreads the points to three
        depths at first; leaving it keeps those being edited.

        Parameters
        ----------
        label : what was done, for the history.
        kind : edits of one kind in quick succession are one step of undo; None never joins.
        slides : it comes from a slider: a slow drag joins for half a minute, or until :meth:`take_hold`.

        Raises
        ------
        DeformError
            If that makes no deformation; everything stays as it was.
        """
        with self._lock:
            notice = complete_change(self.step, self.points, fields)
            label = label or "change " + " and ".join(STEP_LABELS.get(name, name) for name in list(fields)[:1])
            step = replace(self.step, **fields)
            self._become(self.deformation.with_step(self.index, step), label, kind, slides=slides)
            self.notice = notice

    def take_hold(self) -> None:
        """The user has taken hold of a slider: the drag is a step of undo of its own."""
        with self._lock:
            self._history.take_hold()

    def amend(self, made: Deformation, better: Deformation, notice: str = "") -> bool:
        """Put another form of the document in the place of the one that the last edit made, as part of that edit.

        Parameters
        ----------
        made : what the edit made. If something else is shown by now, or an older state, nothing happens.
        better : what shall be shown instead; undo takes back the edit with it.
        notice : the message to the user.

        Returns
        -------
        Whether it was done.
        """
        with self._lock:
            if self.deformation is not made or self.history.get("redo") or not self.history.get("undo"):
                return False
            better = self._checked(better)
            self.notice = ""
            self._show(_State(better, min(self.index, len(better.steps) - 1), self.key))
            self.notice = notice
            return True

    def reset(self) -> None:
        """The volume as it was, seen from the same side; key frames of an animation go too."""
        with self._lock:
            bare = replace(self.deformation, steps=(self._untouched(self.plane),), keyframes=())
            self._become(bare, "reset", index=0, key=0)

    # -- the list of steps ---------------------------------------------------------------------------------------------

    def add_step(self, in_space: bool = False) -> None:
        """One more step after all others: on the same side, or with control points in space (Eq. 9)."""
        with self._lock:
            last = len(self.deformation.steps)
            step = self._untouched(None if in_space else self.plane)
            self._become(self.deformation.then(step), "add a step", index=last, key=0)
            self.notice = (
                f"Step {last + 1} begins, {self.side_of(step.plane)}: what is dragged now is done after step {last}."
            )

    def remove_step(self, index: int | None = None) -> None:
        """Without a step, by default the one that is edited; of the only one, only its drags go."""
        with self._lock:
            at = self._at(index)
            if len(self.deformation.steps) == 1:
                self.reset()
                return
            edited = self.index - (at <= self.index)
            self._become(
                self.deformation.without_step(at),
                f"remove step {at + 1}",
                index=max(0, edited),
                key=0 if at == self.index else None,
            )

    def duplicate_step(self, index: int | None = None) -> None:
        """The same step once more, right behind it; the second one is edited then."""
        with self._lock:
            at, steps = self._at(index), self.deformation.steps
            twice = replace(self.deformation, steps=(*steps[: at + 1], *steps[at:]))
            self._become(twice, f"duplicate step {at + 1}", index=at + 1, key=None if at == self.index else 0)

    def move_step(self, index: int, to: int) -> None:
        """Do a step earlier or later: at the place ``to`` of the list."""
        with self._lock:
            count = len(self.deformation.steps)
            if not 0 <= to < count:
                raise DeformError(f"there is no place {to} among {count} steps; the last is {count - 1}.")
            order = list(range(count))
            order.insert(to, order.pop(self._at(index)))
            moved = self.deformation.moved_step(index, to)
            label = f"do step {index + 1} {'earlier' if to < index else 'later'}"
            self._become(moved, label, index=order.index(self.index))

    def set_step_enabled(self, index: int, is_on: bool) -> None:
        """Switch a step on or off; one that is off stays in the list and does nothing."""
        self._change_step(index, f"switch step {index + 1} {'on' if is_on else 'off'}", enabled=bool(is_on))

    def rename_step(self, index: int, name: str) -> None:
        """Call a step something; an empty name lets its side stand for it."""
        self._change_step(index, f"rename step {index + 1}", name=str(name))

    def set_mode(self, mode: str) -> None:
        """Set the composition of the steps: "compose" one after the other, "blend" the sum of their displacements."""
        with self._lock:
            label = "blend the steps" if mode == "blend" else "do the steps one after the other"
            self._become(replace(self.deformation, mode=mode), label)

    def _change_step(self, index: int, label: str, **fields: Any) -> None:
        with self._lock:
            step = replace(self.deformation.steps[self._at(index)], **fields)
            self._become(self.deformation.with_step(index, step), label)

    def _at(self, index: int | None) -> int:
        at = self.index if index is None else index
        if not 0 <= at < len(self.deformation.steps):
            raise DeformError(f"there is no step {at}; there are {len(self.deformation.steps)}.")
        return at

    # -- cuts, rigid parts and key pictures of the step that is edited -------------------------------------------------

    def edit_cuts(self, cuts: Iterable[Any], label: str = "", kind: str | None = None) -> None:
        """Other cuts of the step being edited: :class:`Cut`, in the picture or in space as its points.

        Parameters
        ----------
        label : what was done, for the history; kind : as of :meth:`edit_points`.
        """
        self.change(label, kind, cuts=tuple(cuts))

    def edit_parts(
        self,
        parts: Iterable[Any],
        label: str = "",
        kind: str | None = None,
        *,
        slides: bool = False,
        points: ControlPoints | None = None,
    ) -> None:
        """Other rigid parts of the step being edited, :class:`~deformnb.rbf.rigid.RigidPart`; see :meth:`edit_cuts`.

        Points that a part carries go on with it where it gets another motion. A point inside a part that requires
        something else than the part does is refused; ``slides`` is as of :meth:`change`. ``points`` are other control
        points that belong to the same edit.
        """
        with self._lock:
            step, parts = self.step, tuple(parts)
            key = min(self.key, len(step.maps) - 1)
            step = replace(step, maps=tuple(carried_points(own, step.parts, parts) for own in step.maps))
            step = step if points is None else step.with_points(points, key)
            fields = {} if step.maps == self.step.maps else {"maps": step.maps}
            self.change(label or "change rigid parts", kind, slides=slides, parts=parts, **fields)

    def add_part(self, part: RigidPart, label: str = "", *, held: str = "refuse") -> None:
        """One more rigid part on the step being edited, as one edit together with what becomes of the points in it.

        Parameters
        ----------
        part : the new part.
        label : what was done, for the history.
        held : what becomes of points within a part that require something else than it does, one of
            :data:`~deformnb.rbf.rigid.HELD_POINT_RULES`: "carry" lets them go with the part, "switch off" switches
            them off, "refuse" raises.

        Raises
        ------
        DeformError
            If the points and parts cannot be fitted; everything stays as it was.

        Examples
        --------
        >>> from deformnb import Session
        >>> from deformnb.datasets import PHANTOMS
        >>> from deformnb.rbf.regions import Polygon
        >>> session = Session(PHANTOMS["bar"].make((24, 24, 48)), view="+y")
        >>> session.edit_points(session.points.add([20.0, 10.0], [20.0, 13.0]))
        >>> session.add_part(RigidPart(Polygon([(16, 9), (24, 9), (24, 15), (16, 15)])), held="carry")
        >>> session.points.target[-1].tolist(), session.undo(), session.points.target[-1].tolist()
        ([20.0, 10.0], 'add a rigid part', [20.0, 13.0])
        """
        with self._lock:
            parts = (*self.step.parts, part)
            self.edit_parts(parts, label or f"add {part.label}", points=without_conflicts(self.points, parts, held))

    def edit_keys(
        self, knots: Sequence[float], *, added: int | None = None, removed: int | None = None, selected: int = 0
    ) -> None:
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

    # -- undo and redo -------------------------------------------------------------------------------------------------

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

    def history_tree(self) -> tuple[HistoryNode, ...]:
        """All states that can be gone to, from the oldest to the newest: an edit after an undo begins a branch.

        Returns
        -------
        For each state its ``id``, that of its ``parent``, its ``label`` (what was done to get there), its ``time``, and
        whether it ``is_current`` and ``is_on_way``, where undo and redo lead.
        """
        with self._lock:
            return self._history.nodes()

    def go_to(self, state: int) -> str:
        """The document as it was in any state of the history; observers see one change.

        Parameters
        ----------
        state : its id, see :meth:`history_tree`.

        Returns
        -------
        What was done to get to that state.

        Raises
        ------
        DeformError
            If there is no such state (any more); everything stays as it was.
        """
        with self._lock:
            found, label = self._history.go(state, self._state)
            self._show(found)
            return label

    # -- from one state to the next ------------------------------------------------------------------------------------

    def _untouched(self, plane: Plane | None) -> Step:
        return untouched_step(plane, self.grid)

    def _become(
        self,
        deformation: Deformation,
        label: str,
        kind: str | None = None,
        *,
        index: int | None = None,
        key: int | None = None,
        slides: bool = False,
    ) -> None:
        deformation = self._checked(deformation)
        before = self._state
        at = before.step if index is None else index
        if index is None:
            at = min(at, len(deformation.steps) - 1)
        elif not 0 <= at < len(deformation.steps):
            raise DeformError(f"there is no step {index} to edit; the document has {len(deformation.steps)}.")
        last_key = len(deformation.steps[at].maps) - 1
        after = _State(deformation, at, min(before.key if key is None else key, last_key))
        if after == before:
            return
        self.notice = ""  # the notice of the edit before
        where = f"{before.step}, {before.key}: {kind}"  # a slider of another step is another slider
        self._history.record(before, label, kind and where, slides=slides)
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
                self.output = self.deformation.output
        finally:
            self._is_checked = False

    def _checked(self, deformation: Any) -> Deformation:
        if not isinstance(deformation, Deformation):
            raise DeformError(f"a session holds a Deformation, got {type(deformation).__name__}.")
        deformation = deformation.in_unit(self.grid.unit)
        if not deformation.steps:
            deformation = replace(deformation, steps=(self._untouched(self._home),))
        self._field = (deformation, deformation.field(self.grid))  # refuses what cannot be fitted
        return deformation

    @traitlets.validate("deformation")
    def _valid_deformation(self, proposal: Any) -> Deformation:
        if self._is_checked:
            return proposal["value"]
        with self._lock:  # set from outside: an edit like any other
            deformation = self._checked(proposal["value"])
            if deformation != self.deformation:  # an equal one is not reported, so there is nothing to undo
                self._history.record(self._state, "change by code")
        return deformation

    @traitlets.observe("deformation")
    def _fit_the_rest(self, _change: Any) -> None:
        if not self._is_checked:
            self.index = min(self.index, len(self.deformation.steps) - 1)
            self.key = min(self.key, len(self.step.maps) - 1)
            self.history = self._history.labels()
            self.output = self.deformation.output

    # -- the side of the picture ---------------------------------------------------------------------------------------

    @property
    def view(self) -> str | None:
        """The side of the picture by name, None for an oblique plane and for points in space."""
        return self.view_of(self.step.plane)

    def view_of(self, plane: Plane | None) -> str | None:
        """The name of a plane's side, None for an oblique plane and for none."""
        return None if plane is None else _sides_of(self.grid).get(plane)

    def side_of(self, plane: Plane | None) -> str:
        """The side of a plane in words: "from above", "oblique", or "in space" for none."""
        return "in space" if plane is None else SIDES.get(self.view_of(plane) or "", "oblique").split(" (")[0]

    def step_titles(self) -> list[str]:
        """What the steps are called: their names, or else their sides, numbered where a side comes again.

        Examples
        --------
        >>> from deformnb.datasets import PHANTOMS
        >>> session = Session(PHANTOMS["bar"].make((8, 8, 8)), view="+y")
        >>> session.add_step()
        >>> session.step_titles()
        ['from the front', 'from the front, 2nd']
        """
        titles: list[str] = []
        sides = [self.side_of(step.plane) for step in self.deformation.steps]
        for k, (step, side) in enumerate(zip(self.deformation.steps, sides, strict=True)):
            number = sides[: k + 1].count(side)
            titles.append(step.name or (side if number == 1 else f"{side}, {_ordinal(number)}"))
        return titles

    def set_view(self, view: str | Plane) -> None:
        """ViewState from another side: back at the step made from there, or else on a new one after all others.

        So the volume is deformed on one picture, turned, and deformed on another (section 4.3 of the paper); the new
        picture shows what the steps before have made. A step as it began is turned instead of kept.
        """
        plane = view if isinstance(view, Plane) else Plane.along(self.grid, view)
        with self._lock:
            if plane == self.step.plane:
                return
            new = replace(self._untouched(plane), kernel=self.step.kernel, trend=self.step.trend)
            deformation, index, notice = turned(
                self.deformation, self.index, new, self._untouched(self.step.plane), self.side_of
            )
            self.depth = 0.0
            self._become(deformation, "turn the picture", index=index, key=0)
            self.notice = notice

    # -- what is seen --------------------------------------------------------------------------------------------------

    @property
    def transfer_function(self) -> TransferFunction:
        """Colours and opacities, a preset fitted to the volume."""
        with self._lock:
            chosen = self.transfer
            if self._transfer is None or self._transfer[0] != chosen:
                self._transfer = (chosen, preset(chosen, self.volume) if isinstance(chosen, str) else chosen)
            return self._transfer[1]

    @traitlets.validate("transfer")
    def _valid_transfer(self, proposal: Any) -> Any:
        value = proposal["value"]
        if isinstance(value, str):
            preset(value, self.volume)
        elif not isinstance(value, TransferFunction):
            raise DeformError(f"transfer must be a TransferFunction or the name of a preset, got {value!r:.60}.")
        return value

    @traitlets.validate("window")
    def _valid_window(self, proposal: Any) -> tuple[float, float]:
        return checked_window(proposal["value"])  # traitlets validates no None

    @traitlets.validate("colour_map")
    def _valid_colour_map(self, proposal: Any) -> str:
        return one_of(proposal["value"], COLOUR_MAPS, "colour map")

    @property
    def view_state(self) -> ViewState:
        """View state at this moment; the depth only where it is the slice of the last step."""
        is_slice = self.method == "slice" and self.index == len(self.deformation.steps) - 1
        return ViewState(
            self.transfer,
            self.method,
            self.depth if is_slice else None,
            self.window,
            self.colour_map,
            self.ambient_occlusion,
        )

    def _restore_view_state(self, stored: ViewState, *, besides: Container[str] = (), is_other: bool = False) -> None:
        """Take over the view state of a document, as far as it is stored."""
        for name, value in stored.traits(is_other=is_other).items():
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
            kept = self._base = (earlier, warp_all([self.volume], earlier.field(self.grid))[0])
        return kept[1]

    def before(self) -> AbstractField | None:
        """The backward displacement of the steps before the one being edited; None if there are none."""
        earlier = self._earlier()
        return earlier.field(self.grid) if earlier.steps else None

    def _earlier(self) -> Deformation:
        with self._lock:
            steps = self.deformation.steps[: self.index]
            return Deformation(tuple(s for s in steps if s.enabled), mode=self.deformation.mode)

    def picture(self, progress: Callable[[float], None] | None = None) -> Picture:
        """The picture that is being edited, before the step that is edited; kept until something else is requested.

        A grey one is in the colour map of the session, and in the window that was set by hand, if one was.
        """
        picture = self.automatic_picture(progress)
        with self._lock:
            window, colour_map = self.window or picture.window, self.colour_map
            if (picture.window, picture.colour_map) == (window, colour_map):
                self._styled = None
                return picture
            kept = self._styled
            if kept is None or kept[0] is not picture or (kept[1].window, kept[1].colour_map) != (window, colour_map):
                kept = self._styled = (picture, replace(picture, window=window, colour_map=colour_map))
            return kept[1]

    def automatic_picture(self, progress: Callable[[float], None] | None = None) -> Picture:
        """The picture that is being edited, in its automatic window; kept until something else is requested."""
        with self._drawing:  # one thread after the other, each for the document of one moment
            settings = self._picture_settings()
            kept = self._picture
            if kept is not None and kept[0] == settings:
                return kept[1]
            earlier, plane, method, depth, colours, displays = settings
            at = depth if method == "slice" else None
            if displays:
                made = project_channels(
                    self._channels_of(earlier), plane, method, displays=displays, depth=at, progress=progress
                )
            else:
                made = project(self._base_of(earlier), plane, method, transfer=colours, depth=at, progress=progress)
            if settings == self._picture_settings():  # else another one is requested by now
                self._picture = (settings, made)
            return made

    def _picture_settings(
        self,
    ) -> tuple[Deformation, Plane, str, float, TransferFunction | None, tuple[ChannelDisplay, ...]]:
        """The settings on which the picture depends."""
        with self._lock:
            colours = self.transfer_function if self.method in ("composite", "shaded") else None
            depth = self.depth if self.method == "slice" else 0.0
            displays = self.channel_displays if self.shows_channels else ()
            return self._earlier(), self.plane, self.method, depth, colours, displays

    @property
    def shows_channels(self) -> bool:
        """Whether the picture shows channels in their colours."""
        return self.channels is not None and self.method in OF_CHANNELS

    @traitlets.validate("channel_displays")
    def _valid_displays(self, proposal: Any) -> tuple[ChannelDisplay, ...]:
        given, count = tuple(proposal["value"]), 0 if self.channels is None else len(self.channels.coloured)
        if len(given) != count or not all(isinstance(one, ChannelDisplay) for one in given):
            raise DeformError(
                f"channel_displays are a ChannelDisplay for each of the {count} channels that have a "
                f"colour, got {given!r:.60}."
            )
        return given

    def show_channel(self, index: int, **changes: Any) -> None:
        """Change colour, window or visibility of a channel.

        Parameters
        ----------
        index : of the channel, from 0.
        changes : fields of :class:`~deformnb.volume.channels.ChannelDisplay`.
        """
        displays = list(self.channel_displays)
        if not 0 <= index < len(displays):
            raise DeformError(f"there is no channel {index}; there are {len(displays)} that have a colour.")
        displays[index] = replace(displays[index], **changes)
        self.channel_displays = tuple(displays)

    def _channels_of(self, earlier: Deformation) -> Channels:
        assert self.channels is not None
        if not earlier.steps:
            return self.channels
        kept = self._deformed_channels
        if kept is None or kept[0] != earlier:
            warped = warp_all(self.channels.volumes, earlier.field(self.grid))
            kept = self._deformed_channels = (earlier, self.channels.with_volumes(warped))
        return kept[1]

    @property
    def depth_range(self) -> tuple[float, float]:
        """Range of slice depths, from the middle of the volume."""
        return self.plane.depth_range(self.grid)

    @property
    def slices(self) -> Slices:
        """The slices that the picture can show, by their depths."""
        return self.plane.slices(self.volume.grid)

    # -- the box of the result -----------------------------------------------------------------------------------------

    @traitlets.validate("output")
    def _valid_output(self, proposal: Any) -> Grid | None:
        self._set_output(proposal["value"])
        return self.deformation.output

    @traitlets.observe("output")
    def _output_taken_back(self, change: Any) -> None:
        if change["new"] is None:  # traitlets validates no None
            self._set_output(None)

    def _set_output(self, grid: Grid | None) -> None:
        with self._lock:
            if grid != self.deformation.output:  # set from outside: an edit like any other
                self._become(replace(self.deformation, output=grid), "change the result box", "result box")

    @property
    def result_grid(self) -> Grid | None:
        """The box :attr:`output` in voxels as large as those of the volume; None is the volume's own grid."""
        return None if self.output is None else self.volume.at_own_resolution(self.output)

    @property
    def box(self) -> Grid:
        """The grid of the result, the volume's own if there is no other."""
        return self.result_grid or self.volume.grid

    def grow(self, margin: ArrayLike) -> None:
        """Give the result a margin around the volume, so that what is dragged out of its box is not cut off.

        Parameters
        ----------
        margin : a length or (x, y, z), rounded up to whole voxels; 0 is the volume's own box again, negative crops.
        """
        grid = padded(self.grid, margin)
        self.output = None if grid == self.grid else grid

    def fit_output(self, *, most: float = MOST, joins: bool = False) -> bool:
        """Give the result a box as large as deformed foreground needs, and at least that of the volume.

        Parameters
        ----------
        most : how many times the voxels of the volume it may have; a notice reports if that is too few.
        joins : as part of the last edit, which undo takes back together with it; nothing happens if another edit, or an
            older state, is shown by the time that the box is known.

        Returns
        -------
        Whether all of the foreground fits.
        """
        with self._lock:
            deformation, field = self.deformation, self.field()
        found = field_of_view(self.foreground(), field, most=most)
        box = self.volume.at_finest_resolution(found.grid)
        if joins:
            if box != deformation.output:
                self.amend(deformation, replace(deformation, output=box), self.notice)
        else:
            self.output = box
        if found.is_limited:
            self.notice = (
                f"Tissue reaches farther than a box of {most:g} times the volume's voxels; what lies beyond is cut off."
            )
        return not found.is_limited

    def exceeded_sides(self) -> tuple[str, ...]:
        """The sides on which dragged foreground leaves the box of the result, in words; takes a moment."""
        if not _moves(self.deformation):
            return ()
        return exceeded_sides(reached_places(self.foreground(), self.field()), self.box)

    def foreground(self) -> Foreground:
        """Foreground of the volume; looked up once."""
        with self._looking:
            if self._foreground is None:
                self._foreground = foreground_of(self.volume)
            return self._foreground

    @traitlets.validate("saved")
    def _valid_saved(self, proposal: Any) -> Deformation | None:
        """Without its view state: a document with other colours only is not unsaved."""
        return None if proposal["value"] is None else without_view_state(proposal["value"])

    # -- results -------------------------------------------------------------------------------------------------------

    def field(self) -> AbstractField:
        """The backward displacement in space of the whole document."""
        with self._lock:
            assert self._field is not None
            if self._field[0] is not self.deformation:
                self._field = (self.deformation, self.deformation.field(self.grid))
            return self._field[1]

    def notes(self) -> tuple[str, ...]:
        """Remarks of the fits, each once."""
        return self.deformation.notes(self.grid)

    def result(self, progress: Callable[[float], None] | None = None) -> Volume:
        """The deformed volume on :attr:`result_grid`, warped with the document of this moment."""
        return self._deformed([self.volume], progress)[0]

    def result_channels(self, progress: Callable[[float], None] | None = None) -> Channels:
        """The deformed channels, all by one map, on :attr:`result_grid`.

        Raises
        ------
        DeformError
            If there are none.
        """
        if self.channels is None:
            raise DeformError("this volume has no channels; result() is the deformed volume.")
        return self.channels.with_volumes(self._deformed(self.channels.volumes, progress))

    def _deformed(self, volumes: Sequence[Volume], progress: Callable[[float], None] | None) -> list[Volume]:
        with self._lock:
            deformation, output = self.deformation, self.result_grid
        check_room(self.volume, output)
        return deformation.apply_all(volumes, output=output, progress=progress)

    def document(self) -> Deformation:
        """The deformation, its view state, and the checksum of its volume, as it is saved."""
        return self.view_state.added_to(replace(self.deformation, volume=self.reference()))

    def save(self, path: str | PathLike[str], *, overwrite: bool = False, document: Deformation | None = None) -> None:
        """Write the document as JSON.

        Parameters
        ----------
        overwrite : replace any file; else only one that holds what was opened or saved here.
        document : of an earlier moment; default is that of now.

        Raises
        ------
        FileChangedError
            If the file was there before, or another program has changed it; nothing is written.
        """
        document = document or self.document()
        write_deformation(document, path, known=self.files, overwrite=overwrite)
        self.file, self.saved = Path(path), document

    def open(self, path: str | PathLike[str], *, allow_other_volume: bool = False) -> None:
        """Go on with a saved document; can be undone.

        Parameters
        ----------
        allow_other_volume : open it even if it was made on another volume; a notice reports it.

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

    def take(
        self, deformation: Deformation, label: str = "open a document", *, allow_other_volume: bool = False
    ) -> None:
        """Go on with another document that is kept elsewhere; can be undone, but for colours and projection.

        See :meth:`open`.
        """
        deformation, view_state = ViewState.split(deformation)
        laid = ""
        try:
            deformation, laid = with_true_spacing(deformation, self.grid)
        except OtherVolumeError:
            if not allow_other_volume:
                raise
        difference = self.difference(deformation)
        if difference and not allow_other_volume:
            raise OtherVolumeError(f"{difference} Pass allow_other_volume=True to open it all the same.")
        with self._lock:
            self._become(deformation, label, index=max(0, len(deformation.steps) - 1), key=0)
            self.file, self.saved = None, None if laid else self.deformation
        self._restore_view_state(view_state, is_other=bool(difference))
        if difference or laid:
            self.notice = difference or laid

    def difference(self, deformation: Deformation) -> str:
        """Warning about a document that was made on another volume; empty if it was made on this one."""
        return deformation.difference(self.volume, self.reference)

    def code(self, volume: str = "") -> str:
        """The document as a Python script; see :func:`deformnb.document.script.as_python`.

        Parameters
        ----------
        volume : expression that gives the volume; default reads the file that it came from.
        """
        return as_python(
            self.deformation, self.grid, volume=volume or self.source or UNKNOWN_VOLUME, own=own_grid_text(self.volume)
        )


def _renamed(step: Step, key: int, before: ControlPoints) -> Step:
    """The step with names that were changed at one key changed at all keys."""
    if len(step.maps) == 1:
        return step
    known, points = dict(zip(before.ids, before.names, strict=True)), step.maps[key]
    names = {i: name for i, name in zip(points.ids, points.names, strict=True) if known.get(i, name) != name}
    maps = list(step.maps)
    for k, i in product(range(len(maps)), names):
        if i in maps[k].ids:
            maps[k] = maps[k].edit(i, name=names[i])
    return replace(step, maps=tuple(maps))


@lru_cache(maxsize=8)
def _sides_of(grid: Grid) -> dict[Plane, str]:
    """The names of the planes along the axes of a grid: asked for several times an edit, while the grid stays."""
    return {Plane.along(grid, view): view for view in reversed(VIEWS)}  # the first name of a plane counts


def _ordinal(number: int) -> str:
    return f"{number}{'th' if 10 < number % 100 < 14 else {1: 'st', 2: 'nd', 3: 'rd'}.get(number % 10, 'th')}"


def _moves(deformation: Deformation) -> bool:
    """Check whether anything is dragged at all: a scan may be cut through tissue as it is."""
    return any(part.motion is not None for step in deformation.steps for part in step.parts) or any(
        bool(points.displacement.any()) for step in deformation.steps for points in step.maps
    )

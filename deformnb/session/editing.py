"""Editing of a document: each edit makes the next immutable one, or raises and leaves everything as it was.

Undo goes along a tree of old documents. The selection is one step of the document and one of its sets of points; both
go along with undo. It may be called from any thread; observers are called in the thread of the edit.

There are edits of the points, of the list of steps, and of everything else that lies on a step: cuts, rigid parts, key
pictures. The step that is edited goes on being edited wherever it is moved.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, NamedTuple

import traitlets

from deformnb.document.deformation import Deformation, Step
from deformnb.document.edits import complete_change, points_between, untouched_step
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidPart, without_conflicts
from deformnb.session.history import History, HistoryNode
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Volume

_NAMES = {"kernel": "kernel", "support": "support radius", "trend": "trend", "smoothing": "smoothing",
          "extrusion": "extrusion", "curve": "curve", "knots": "keys", "strength": "strength", "enabled": "switch",
          "maps": "points", "plane": "plane", "name": "name", "cuts": "cuts", "parts": "rigid parts",
          "cut_rule": "rule of the cuts", "stages": "stages"}


class _State(NamedTuple):
    deformation: Deformation
    step: int
    key: int


class EditedDocument(traitlets.HasTraits):
    """A deformation of a volume, which of its steps is edited, and the way back.

    Parameters
    ----------
    volume : what is deformed; never changed.
    deformation : to go on with; default is one step with a point in each corner of the picture that holds it still.
    home : plane of the first picture.
    traits : first values of the traits below, and of those of a subclass.

    Attributes
    ----------
    deformation : the document, observable; setting it is an edit that can be undone.
    index : the step that is edited.
    key : its set of control points that is edited, for the rule "interpolate".
    history : what "undo" and "redo" would do, in words.
    notice : the last thing worth saying, such as a trend that was changed along with a kernel.
    """

    deformation = traitlets.Instance(Deformation)
    index = traitlets.Int(0)
    key = traitlets.Int(0)
    history = traitlets.Dict()
    notice = traitlets.Unicode("")

    def __init__(self, volume: Volume, deformation: Deformation | None, home: Plane, **traits: Any) -> None:
        self._lock = threading.RLock()
        self._history = History()
        self._is_checked = False  # while a document is set that has been checked
        self._field: tuple[Deformation, AbstractField] | None = None
        self._home = home
        self.volume = volume
        super().__init__(**traits)
        first = self._checked(deformation or Deformation())
        self._show(_State(first, len(first.steps) - 1, 0))

    # -- what is edited ------------------------------------------------------------------------------------------------

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

    def edit_step(self, index: int, key: int = 0) -> None:
        """Choose the step, and its set of points, that is edited."""
        if not 0 <= index < len(self.deformation.steps):
            raise DeformError(f"there is no step {index}; there are {len(self.deformation.steps)}.")
        if not 0 <= key < len(self.deformation.steps[index].maps):
            raise DeformError(f"step {index} has no set of points {key}.")
        with self._lock, self.hold_trait_notifications():
            self.index, self.key = index, key

    # -- edits ---------------------------------------------------------------------------------------------------------

    def edit_document(self, deformation: Deformation, label: str, index: int | None = None,
                      kind: str | None = None) -> None:
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
            step = _renamed(self.step.with_points(points, key), key, before)
            self._become(self.deformation.with_step(self.index, step), label, kind)

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
            label = label or "change " + " and ".join(_NAMES.get(name, name) for name in list(fields)[:1])
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
        notice : what to say of it.

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

    def _untouched(self, plane: Plane | None) -> Step:
        return untouched_step(plane, self.volume.grid)

    def _become(self, deformation: Deformation, label: str, kind: str | None = None, *, index: int | None = None,
                key: int | None = None, slides: bool = False) -> None:
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
        self.notice = ""  # what was said of the edit before
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
                self._show_parts()
        finally:
            self._is_checked = False

    def _show_parts(self) -> None:
        """Set what a subclass shows of the document by a trait of its own."""

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
            if deformation != self.deformation:  # of an equal one nobody is told, so there is nothing to undo
                self._history.record(self._state, "change by code")
        return deformation

    @traitlets.observe("deformation")
    def _fit_the_rest(self, _change: Any) -> None:
        if not self._is_checked:
            self.index = min(self.index, len(self.deformation.steps) - 1)
            self.key = min(self.key, len(self.step.maps) - 1)
            self.history = self._history.labels()
            self._show_parts()

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


class EditedSteps(EditedDocument):
    """A document whose steps can be added, moved, switched off, renamed, duplicated and removed.

    Every edit can be undone, and one that makes the fit fail raises a :class:`~deformnb.errors.DeformError` and leaves
    everything as it was. Steps count from 0 here, and from 1 in the words of the history.
    """

    # -- the list ------------------------------------------------------------------------------------------------------

    def add_step(self, in_space: bool = False) -> None:
        """One more step after all others: on the same side, or with control points in space (Eq. 9)."""
        with self._lock:
            last = len(self.deformation.steps)
            step = self._untouched(None if in_space else self.plane)
            self._become(self.deformation.then(step), "add a step", index=last, key=0)
            self.notice = f"Step {last + 1} begins: what is dragged now is done after step {last}."

    def remove_step(self, index: int | None = None) -> None:
        """Without a step, by default the one that is edited; of the only one, only its drags go."""
        with self._lock:
            at = self._at(index)
            if len(self.deformation.steps) == 1:
                self.reset()
                return
            edited = self.index - (at <= self.index)
            self._become(self.deformation.without_step(at), f"remove step {at + 1}", index=max(0, edited),
                         key=0 if at == self.index else None)

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

    # -- what lies on the step being edited ----------------------------------------------------------------------------

    def edit_cuts(self, cuts: Iterable[Any], label: str = "", kind: str | None = None) -> None:
        """Other cuts of the step being edited: :class:`Cut`, in the picture or in space as its points.

        Parameters
        ----------
        label : what was done, for the history; kind : as of :meth:`edit_points`.
        """
        self.change(label, kind, cuts=tuple(cuts))

    def edit_parts(self, parts: Iterable[Any], label: str = "", kind: str | None = None, *,
                   slides: bool = False, points: ControlPoints | None = None) -> None:
        """Other rigid parts of the step being edited, :class:`~deformnb.rbf.rigid.RigidPart`; see :meth:`edit_cuts`.

        A point inside a part that requires something else than the part does is refused; ``slides`` is as of
        :meth:`change`. ``points`` are other control points that belong to the same edit.
        """
        with self._lock:
            key = min(self.key, len(self.step.maps) - 1)
            fields = {} if points is None else {"maps": self.step.with_points(points, key).maps}
            self.change(label or "change rigid parts", kind, slides=slides, parts=tuple(parts), **fields)

    def add_part(self, part: RigidPart, label: str = "", *, held: str = "refuse") -> None:
        """One more rigid part on the step being edited, as one edit together with what becomes of the points in it.

        Parameters
        ----------
        part : the new part.
        label : what was done, for the history.
        held : what becomes of points within a part that require something else than it does, one of
            :data:`~deformnb.rbf.rigid.HELD`: "carry" lets them go with the part, "switch off" switches them off,
            "refuse" raises.

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

    def set_cut_rule(self, rule: str) -> None:
        """Set the rule for the visible region beside a cut: a name of :data:`~deformnb.rbf.cuts.CUT_RULES`."""
        self.change(cut_rule=rule)

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

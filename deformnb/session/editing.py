"""The edited document of a session: its selected step and points, edits, undo and redo."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import traitlets

from deformnb.checks import check_arguments
from deformnb.document.deformation import STEP_LABELS, Deformation, Step
from deformnb.document.edits import complete_change, initial_step, points_between
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import HeldPointRule, RigidPart, carry_points, without_conflicts
from deformnb.session.history import History, HistoryNode
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid


@dataclass(frozen=True)
class Edited:
    """A document, and the step and the set of control points in it that are edited.

    Parameters
    ----------
    index : of the step.
    key : of its set of points, for the rule "interpolate".
    """

    deformation: Deformation
    index: int
    key: int

    @property
    def step(self) -> Step:
        """The step that is edited."""
        return self.deformation.steps[self.index]

    @property
    def points(self) -> ControlPoints:
        """The control points that are edited."""
        return self.step.maps[self.key]

    @property
    def earlier(self) -> Deformation:
        """The enabled steps before the one that is edited."""
        steps = self.deformation.steps[: self.index]
        return Deformation(tuple(step for step in steps if step.enabled), mode=self.deformation.mode)


class Editing(traitlets.HasTraits):
    """The document that is edited, and its history. Every edit makes the next immutable document, or raises.

    Parameters
    ----------
    grid : on which the document is stated: the volume's, or that of the finest level of its pyramid.
    home : plane of the first picture.
    deformation : to begin with.

    Attributes
    ----------
    deformation : the document, observable; setting it is an edit that can be undone.
    index : the step that is edited.
    key : its set of control points that is edited, for the rule "interpolate".
    history : what "undo" and "redo" would do, in words.
    notice : the last message to the user, such as a trend that was changed along with a kernel.
    output : the grid of the result, which is what can be seen of it too (the field of view); None is the volume's own.
        It is part of the document: setting it is an edit that can be undone.
    first : the document with which it began.
    state : document and selection at one moment, for other threads.
    past : the states that can be restored.
    lock : guards the state and the history from the reading of a state to the edit that is made of it.

    Notes
    -----
    The selection is one step of the document and one of its sets of points. Both go along with undo, and the step goes
    on being edited wherever it is moved. Steps count from 0 here, and from 1 in the words of the history.

    Examples
    --------
    >>> grid = Grid((24, 24, 48))
    >>> editing = Editing(grid, Plane.from_view(grid, "+y"), Deformation())
    >>> editing.edit_points(editing.points.add([20.0, 10.0], [20.0, 13.0]))
    >>> editing.change(extrusion="modulate", curve="sin(pi*z)")
    >>> editing.history["undo"]
    'change extrusion'
    >>> editing.undo(), len(editing.points)
    ('change extrusion', 5)
    """

    deformation = traitlets.Instance(Deformation)
    index = traitlets.Int(0)
    key = traitlets.Int(0)
    history = traitlets.Dict()
    notice = traitlets.Unicode("")
    output = traitlets.Instance(Grid, allow_none=True)

    def __init__(self, grid: Grid, home: Plane, deformation: Deformation) -> None:
        super().__init__()
        self.grid = grid
        self.lock = threading.RLock()
        self._home = home
        self.past = History()
        self._is_showing = False  # while a document is set that has been checked
        self.first = self._check(deformation)
        self._show(Edited(self.first, len(self.first.steps) - 1, 0))

    @property
    def step(self) -> Step:
        """The step that is edited."""
        return self.state.step

    @property
    def points(self) -> ControlPoints:
        """The control points that are edited."""
        return self.state.points

    @property
    def plane(self) -> Plane:
        """Plane of the picture; for points in space, that of the first picture."""
        return self.step.plane or self._home

    def initial_step(self, plane: Plane | None) -> Step:
        """A step as it begins on a plane, or in space."""
        return initial_step(plane, self.grid)

    def _bare_step(self) -> Step:
        """The edited step as it begins, with its name: that of an oblique view is no edit."""
        return replace(self.initial_step(self.plane), name=self.step.name if self.step.plane is not None else "")

    @check_arguments
    def edit_step(self, index: int, key: int = 0) -> None:
        """Choose the step, and its set of points, that is edited."""
        with self.lock:
            steps = self.deformation.steps
            if not 0 <= index < len(steps):
                raise DeformError(f"there is no step {index}; there are {len(steps)}.")
            if not 0 <= key < len(steps[index].maps):
                raise DeformError(f"step {index} has no set of points {key}.")
            self._show(Edited(self.deformation, index, key))

    # -- edits of the document, its points and its settings ------------------------------------------------------------

    def edit_document(
        self,
        deformation: Deformation,
        label: str,
        index: int | None = None,
        kind: str | None = None,
        *,
        key: int | None = None,
        slides: bool = False,
    ) -> None:
        """Any other document in the place of this one, as one edit that can be undone.

        Parameters
        ----------
        label : name of the edit, for the history.
        index : the step that is edited afterwards; None stays at its place in the list, if there is one.
        kind : edits of one kind in quick succession are one step of undo; None never joins.
        key : the set of points that is edited afterwards; None stays at its place.
        slides : it comes from a slider: a slow drag joins for half a minute, or until :meth:`start_drag`.

        Raises
        ------
        DeformError
            If it cannot be fitted; everything stays as it was.
        """
        with self.lock:
            deformation, before = self._check(deformation), self.state
            at = before.index if index is None else index
            if index is None:
                at = min(at, len(deformation.steps) - 1)
            elif not 0 <= at < len(deformation.steps):
                raise DeformError(f"there is no step {index} to edit; the document has {len(deformation.steps)}.")
            last_key = len(deformation.steps[at].maps) - 1
            after = Edited(deformation, at, min(before.key if key is None else key, last_key))
            if after == before:
                return
            self.notice = ""  # the notice of the edit before
            where = f"{before.index}, {before.key}: {kind}"  # a slider of another step is another slider
            self.past.record(before, label, kind and where, slides=slides)
            self._show(after)

    @check_arguments
    def edit_points(self, points: ControlPoints, label: str = "move points", kind: str | None = None) -> None:
        """Other control points in the place of those being edited.

        A name is that of a landmark: points of other keys that have the same id get it too.

        Parameters
        ----------
        label : name of the edit, for the history.
        kind : edits of one kind in quick succession are one step of undo; None never joins.

        Raises
        ------
        DeformError
            If they cannot be fitted; everything stays as it was.
        """
        with self.lock:
            points = replace(points.to_unit(self.grid.unit), unit="")
            step = _rename_points(self.step.with_points(points, self.key), self.key, self.points)
            self.edit_document(self.deformation.with_step(self.index, step), label, kind=kind)

    def edit_fit(self, points: ControlPoints, fields: dict[str, Any], label: str) -> None:
        """Other control points and other settings of their fit, as one edit.

        Parameters
        ----------
        fields : of the step, such as ``{"stages": 4}``.
        label : name of the edit, for the history; the settings are added to it.

        Raises
        ------
        DeformError
            If they cannot be fitted; everything stays as it was.
        """
        with self.lock:
            named = " and ".join(STEP_LABELS.get(name, name) for name in fields)
            points = replace(points.to_unit(self.grid.unit), unit="")
            maps = _rename_points(self.step.with_points(points, self.key), self.key, self.points).maps
            self.change(f"{label}, change {named}" if label else f"change {named}", **{**fields, "maps": maps})

    def change(self, label: str = "", kind: str | None = None, *, slides: bool = False, **fields: Any) -> None:
        """Change fields of the step being edited, such as ``kernel="gaussian"``.

        A kernel that needs a richer trend gets it, with a notice. The rule "interpolate" spreads the points to three
        depths at first; leaving it preserves those being edited.

        Parameters
        ----------
        label : name of the edit, for the history.
        kind : edits of one kind in quick succession are one step of undo; None never joins.
        slides : as of :meth:`edit_document`.

        Raises
        ------
        DeformError
            If that makes no deformation; everything stays as it was.
        """
        with self.lock:
            notice = complete_change(self.step, self.points, fields)
            label = label or "change " + " and ".join(STEP_LABELS.get(name, name) for name in list(fields)[:1])
            step = replace(self.step, **fields)
            self.edit_document(self.deformation.with_step(self.index, step), label, kind=kind, slides=slides)
            self.notice = notice

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
        with self.lock:
            maps, z = list(self.step.maps), list(knots)
            if removed is not None:
                del maps[removed]
            if added is not None:
                maps.insert(added, points_between(maps, z, added))
            step = replace(self.step, maps=tuple(maps), knots=tuple(z))
            label = "add a key" if added is not None else "remove a key" if removed is not None else "move a key"
            self.edit_document(self.deformation.with_step(self.index, step), label, key=selected)

    def edit_parts(
        self,
        parts: Iterable[Any],
        label: str = "",
        kind: str | None = None,
        *,
        slides: bool = False,
        points: ControlPoints | None = None,
    ) -> None:
        """Other rigid parts of the step being edited, :class:`~deformnb.rbf.rigid.RigidPart`.

        Points that a part carries follow it where it gets another motion. A point inside a part that requires
        something else than the part does is refused.

        Parameters
        ----------
        label, kind, slides : as of :meth:`change`.
        points : other control points that belong to the same edit.
        """
        with self.lock:
            step, parts = self.step, tuple(parts)
            step = replace(step, maps=tuple(carry_points(own, step.parts, parts) for own in step.maps))
            step = step if points is None else step.with_points(points, self.key)
            fields = {} if step.maps == self.step.maps else {"maps": step.maps}
            self.change(label or "change rigid parts", kind, slides=slides, parts=parts, **fields)

    def add_part(self, part: RigidPart, label: str = "", *, held: HeldPointRule = "refuse") -> None:
        """One more rigid part on the step being edited, as one edit together with what becomes of the points in it.

        Parameters
        ----------
        part : the new part.
        label : name of the edit, for the history.
        held : what becomes of points within a part that require something else than it does, one of
            :data:`~deformnb.rbf.rigid.HELD_POINT_RULES`: "carry" lets them go with the part, "switch off" switches
            them off, "refuse" raises.

        Raises
        ------
        DeformError
            If the points and parts cannot be fitted; everything stays as it was.

        Examples
        --------
        >>> from deformnb.rbf.regions import Polygon
        >>> grid = Grid((24, 24, 48))
        >>> editing = Editing(grid, Plane.from_view(grid, "+y"), Deformation())
        >>> editing.edit_points(editing.points.add([20.0, 10.0], [20.0, 13.0]))
        >>> editing.add_part(RigidPart(Polygon([(16, 9), (24, 9), (24, 15), (16, 15)])), held="carry")
        >>> editing.points.target[-1].tolist(), editing.undo(), editing.points.target[-1].tolist()
        ([20.0, 10.0], 'add a rigid part', [20.0, 13.0])
        """
        with self.lock:
            parts = (*self.step.parts, part)
            self.edit_parts(parts, label or f"add {part.label}", points=without_conflicts(self.points, parts, held))

    def amend(self, made: Deformation, better: Deformation, notice: str = "") -> bool:
        """Put another form of the document in the place of the one that the last edit made, as part of that edit.

        Parameters
        ----------
        made : result of the edit. If something else is shown by now, or an older state, nothing happens.
        better : what should be shown instead; undo reverts the edit with it.
        notice : the message to the user.

        Returns
        -------
        Whether it was done.
        """
        with self.lock:
            if self.deformation is not made or self.history.get("redo") or not self.history.get("undo"):
                return False
            better = self._check(better)
            self.notice = ""
            index = min(self.index, len(better.steps) - 1)
            self._show(Edited(better, index, min(self.key, len(better.steps[index].maps) - 1)))
            self.notice = notice
            return True

    def reset(self) -> None:
        """The volume as it was, seen from the same side; key frames of an animation go too."""
        with self.lock:
            bare = replace(self.deformation, steps=(self._bare_step(),), keyframes=())
            self.edit_document(bare, "reset", 0, key=0)

    # -- undo and redo -------------------------------------------------------------------------------------------------

    def start_drag(self) -> None:
        """Start the drag of a slider, which is a separate step of undo."""
        with self.lock:
            self.past.start_drag()

    def undo(self) -> str:
        """Undo the last edit; returns its description, empty if there is none."""
        return self._travel("undo")

    def redo(self) -> str:
        """Redo the edit that was undone last; returns its description, empty if there is none."""
        return self._travel("redo")

    def _travel(self, way: str) -> str:
        with self.lock:
            found = self.past.step(way, self.state)
            if found is None:
                return ""
            self._show(found[0])
            return found[1]

    def history_tree(self) -> tuple[HistoryNode, ...]:
        """All states that can be restored, from the oldest to the newest: an edit after an undo begins a branch.

        Returns
        -------
        For each state its ``id``, that of its ``parent``, its ``label`` (the edit that led there), its ``time``, and
        whether it ``is_current`` and ``is_on_way``, where undo and redo lead.
        """
        with self.lock:
            return self.past.nodes()

    def go_to(self, state: int) -> str:
        """The document as it was in any state of the history; observers see one change.

        Parameters
        ----------
        state : its id, see :meth:`history_tree`.

        Returns
        -------
        The edit that led to that state.

        Raises
        ------
        DeformError
            If there is no such state (any more); everything stays as it was.
        """
        with self.lock:
            found, label = self.past.go(state, self.state)
            self._show(found)
            return label

    # -- from one state to the next ------------------------------------------------------------------------------------

    def _show(self, state: Edited) -> None:
        """Set what has been checked, in one update: observers see no mixture."""
        self.state, self._is_showing = state, True
        try:
            with self.hold_trait_notifications():
                self.deformation, self.index, self.key = state.deformation, state.index, state.key
                self.history = self.past.labels()
                self.output = state.deformation.output
        finally:
            self._is_showing = False

    def _check(self, deformation: Any) -> Deformation:
        if not isinstance(deformation, Deformation):
            raise DeformError(f"a session holds a Deformation, got {type(deformation).__name__}.")
        deformation = deformation.to_unit(self.grid.unit)
        if not deformation.steps:
            deformation = replace(deformation, steps=(self.initial_step(self._home),))
        deformation.field(self.grid)  # refuses what cannot be fitted
        return deformation

    @traitlets.validate("deformation")
    def _valid_deformation(self, proposal: Any) -> Deformation:
        if not self._is_showing:  # set from outside: an edit like any other
            self.edit_document(proposal["value"], "change by code")
        return self.state.deformation

    @traitlets.validate("output")
    def _valid_output(self, proposal: Any) -> Grid | None:
        self._set_output(proposal["value"])
        return self.state.deformation.output

    @traitlets.observe("output")
    def _remove_output(self, change: Any) -> None:
        if change["new"] is None:  # traitlets validates no None
            self._set_output(None)

    def _set_output(self, grid: Grid | None) -> None:
        if not self._is_showing and grid != self.state.deformation.output:  # set from outside: an edit like any other
            self.edit_document(replace(self.deformation, output=grid), "change the result box", kind="result box")


def _rename_points(step: Step, key: int, before: ControlPoints) -> Step:
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

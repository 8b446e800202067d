"""Edits of the list of steps, and of what lies on a step besides its points: cuts, rigid parts, key pictures.

The step that is edited goes on being edited wherever it is moved.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from deformnb.control_points import ControlPoints
from deformnb.edited_document import EditedDocument
from deformnb.errors import DeformError
from deformnb.rigid_parts import RigidPart, without_conflicts
from deformnb.step_changes import points_between


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
        """How the steps make one deformation: "compose" one after the other, "blend" the sum of what each does."""
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
        """Other cuts of the step being edited: :class:`~deformnb.cuts.Cut`, in the picture or in space as its points.

        Parameters
        ----------
        label : what was done, for the history; kind : as of :meth:`edit_points`.
        """
        self.change(label, kind, cuts=tuple(cuts))

    def edit_parts(self, parts: Iterable[Any], label: str = "", kind: str | None = None, *,
                   slides: bool = False, points: ControlPoints | None = None) -> None:
        """Other rigid parts of the step being edited, :class:`~deformnb.rigid_parts.RigidPart`; see :meth:`edit_cuts`.

        A point inside a part that asks for something else than the part does is refused; ``slides`` is as of
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
        held : what becomes of points within a part that ask for something else than it does, one of
            :data:`~deformnb.rigid_parts.HELD`: "carry" lets them go with the part, "switch off" switches them off,
            "refuse" raises.

        Raises
        ------
        DeformError
            If the points and parts cannot be fitted; everything stays as it was.

        Examples
        --------
        >>> from deformnb import Session
        >>> from deformnb.datasets import PHANTOMS
        >>> from deformnb.regions import Polygon
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
        """What is seen beside a cut: a name of :data:`~deformnb.cuts.CUT_RULES`."""
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

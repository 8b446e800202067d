"""The list of steps of a session: order, switches, names and sides."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deformnb.document.deformation import ModeName, Step
from deformnb.document.edits import is_edited, is_view_name, next_view_name, turn_picture
from deformnb.errors import DeformError
from deformnb.session.editing import Editing
from deformnb.volume.plane import Plane
from deformnb.volume.views import VIEWS, ViewName, side_words
from deformnb.volume.volume import Grid


class Steps:
    """Edits of the list of steps of a document, each of which can be undone.

    Parameters
    ----------
    editing : the document.

    Examples
    --------
    >>> from deformnb.datasets import PHANTOMS
    >>> from deformnb.session import Session
    >>> session = Session(PHANTOMS["bar"].make((8, 8, 8)), view="+y")
    >>> session.steps.add()
    >>> session.steps.titles()
    ['from the front', 'from the front, 2nd']
    """

    def __init__(self, editing: Editing) -> None:
        self._editing = editing

    def add(self, in_space: bool = False) -> None:
        """One more step after all others: on the same side, or with control points in space (Eq. 9)."""
        editing = self._editing
        with editing.lock:
            last = len(editing.deformation.steps)
            step = editing.initial_step(None if in_space else editing.plane)
            editing.edit_document(editing.deformation.then(step), "add a step", last, key=0)
            editing.notice = f"Step {last + 1} begins, {self.side_of(step.plane)}: drags now apply after step {last}."

    def remove(self, index: int | None = None) -> None:
        """Without a step, by default the one that is edited; of the only one, only its drags go."""
        editing = self._editing
        with editing.lock:
            at = self._at(index)
            if len(editing.deformation.steps) == 1:
                editing.reset()
                return
            edited = editing.index - (at <= editing.index)
            editing.edit_document(
                editing.deformation.without_step(at),
                f"remove step {at + 1}",
                max(0, edited),
                key=0 if at == editing.index else None,
            )

    def duplicate(self, index: int | None = None) -> None:
        """The same step once more, right behind it; the second one is edited then."""
        editing = self._editing
        with editing.lock:
            at, steps = self._at(index), editing.deformation.steps
            twice = replace(editing.deformation, steps=(*steps[: at + 1], *steps[at:]))
            key = None if at == editing.index else 0
            editing.edit_document(twice, f"duplicate step {at + 1}", at + 1, key=key)

    def move(self, index: int, to: int) -> None:
        """Do a step earlier or later: at the place ``to`` of the list."""
        editing = self._editing
        with editing.lock:
            count = len(editing.deformation.steps)
            if not 0 <= to < count:
                raise DeformError(f"there is no place {to} among {count} steps; the last is {count - 1}.")
            order = list(range(count))
            order.insert(to, order.pop(self._at(index)))
            moved = editing.deformation.move_step(index, to)
            label = f"do step {index + 1} {'earlier' if to < index else 'later'}"
            editing.edit_document(moved, label, order.index(editing.index))

    def set_enabled(self, index: int, is_on: bool) -> None:
        """Switch a step on or off; one that is off stays in the list and does nothing."""
        self._change(index, f"switch step {index + 1} {'on' if is_on else 'off'}", enabled=bool(is_on))

    def rename(self, index: int, name: str) -> None:
        """Set the name of a step; with an empty name its side names it."""
        self._change(index, f"rename step {index + 1}", name=str(name))

    def set_mode(self, mode: ModeName) -> None:
        """Set the composition of the steps: "compose" one after the other, "blend" the sum of their displacements."""
        editing = self._editing
        with editing.lock:
            label = "blend the steps" if mode == "blend" else "do the steps one after the other"
            editing.edit_document(replace(editing.deformation, mode=mode), label)

    def turn(self, plane: Plane) -> None:
        """Edit on another side: return to the step on this plane, or begin a new one after all others.

        A step without edits is turned instead. The step of an oblique plane gets the name "view 1", or the next one
        that the document does not have.
        """
        editing = self._editing
        with editing.lock:
            step, untouched = editing.step, editing.initial_step(editing.step.plane)
            new = replace(editing.initial_step(plane), kernel=step.kernel, trend=step.trend)
            new = replace(new, name=self._name_on(plane, None if is_edited(step, untouched) else step))
            is_new = self.view_of(plane) is None and plane not in self.oblique_views()
            deformation, index, notice = turn_picture(
                editing.deformation,
                editing.index,
                new,
                untouched,
                lambda seen: new.name if is_new and seen is plane else self.side_of(seen),
            )
            editing.edit_document(deformation, "turn the picture", index, key=0)
            editing.notice = notice

    def _name_on(self, plane: Plane, turned: Step | None) -> str:
        """The name of a step that begins on a plane; the step that is turned, if any, keeps its own."""
        is_side = self.view_of(plane) is not None
        if turned is not None and turned.name and not (is_side and is_view_name(turned.name)):
            return turned.name
        return "" if is_side else next_view_name(self._editing.deformation)

    def plane_from(self, direction: ArrayLike, up: ArrayLike | None = None) -> Plane:
        """The plane of a picture from a camera: that of a step or a side which is seen so, else a new one.

        Parameters
        ----------
        direction, up : of the camera, as of :meth:`Plane.from_normal <deformnb.volume.plane.Plane.from_normal>`.

        Raises
        ------
        DeformError
            For a direction of zero, or an up vector along it.
        """
        plane = Plane.from_camera(self._editing.grid, direction, up)
        steps = reversed(self._editing.deformation.steps)
        planes = (step.plane for step in steps if step.plane is not None)
        return next((known for known in planes if known.has_same_directions(plane)), plane)

    def nearest_side(self, plane: Plane) -> ViewName:
        """The name of the side from which a picture differs least."""
        sides = ((name, Plane.from_view(self._editing.grid, name)) for name in VIEWS)
        return max(sides, key=lambda side: float(np.dot(side[1].normal, plane.normal)))[0]

    def _change(self, index: int, label: str, **fields: Any) -> None:
        editing = self._editing
        with editing.lock:
            step = replace(editing.deformation.steps[self._at(index)], **fields)
            editing.edit_document(editing.deformation.with_step(index, step), label)

    def _at(self, index: int | None) -> int:
        at, count = self._editing.index if index is None else index, len(self._editing.deformation.steps)
        if not 0 <= at < count:
            raise DeformError(f"there is no step {at}; there are {count}.")
        return at

    # -- sides ---------------------------------------------------------------------------------------------------------

    @property
    def view(self) -> str | None:
        """The side of the picture by name, None for an oblique plane and for points in space."""
        return self.view_of(self._editing.step.plane)

    def view_of(self, plane: Plane | None) -> str | None:
        """The name of a plane's side, None for an oblique plane and for none."""
        return None if plane is None else _sides_of(self._editing.grid).get(plane)

    def side_of(self, plane: Plane | None) -> str:
        """The side of a plane in words: "from above", "in space" for none; of an oblique one the name of its step."""
        if plane is None:
            return "in space"
        side = self.view_of(plane)
        return (
            self.oblique_views().get(plane, "oblique")
            if side is None
            else side_words(side, is_anatomical=self._editing.grid.is_anatomical).split(" (")[0]
        )

    def oblique_views(self) -> dict[Plane, str]:
        """The oblique planes of the steps, and the name of the first step on each, or "oblique" without one."""
        views: dict[Plane, str] = {}
        for step in self._editing.deformation.steps:
            if step.plane is not None and self.view_of(step.plane) is None and not views.get(step.plane):
                views[step.plane] = step.name
        return {plane: name or "oblique" for plane, name in views.items()}

    def titles(self) -> list[str]:
        """Titles of the steps: their names, or else their sides, numbered where a side comes again."""
        titles: list[str] = []
        steps = self._editing.deformation.steps
        sides = [self.side_of(step.plane) for step in steps]
        for k, (step, side) in enumerate(zip(steps, sides, strict=True)):
            number = sides[: k + 1].count(side)
            titles.append(step.name or (side if number == 1 else f"{side}, {_ordinal(number)}"))
        return titles


@lru_cache(maxsize=8)
def _sides_of(grid: Grid) -> dict[Plane, str]:
    """The names of the planes along the axes of a grid: looked up several times an edit, while the grid stays."""
    return {Plane.from_view(grid, view): view for view in reversed(VIEWS)}  # the first name of a plane counts


def _ordinal(number: int) -> str:
    return f"{number}{'th' if 10 < number % 100 < 14 else {1: 'st', 2: 'nd', 3: 'rd'}.get(number % 10, 'th')}"

"""Control points in space over a view of the volume: their editor, and the deformation that they make immediately."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import ipywidgets
import numpy as np
import traitlets

from deformnb._jax import jax
from deformnb._threads import Timer
from deformnb._weak import weakly
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.forward import ForwardFit
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.volume import Grid
from deformnb.widgets.messages.editors import PointsEdit

# Samples along the longest side of a displacement while points move: 0.4 MB, which a front end gets 30 times a second.
# The values between them are off by less than a pixel of the picture for a bump of a quarter of the volume.
QUICK_SIZE = 32

MOST_FITTED = 48
"""Points that a front end fits and evaluates itself while they move: at QUICK_SIZE nodes along each axis a sum over so
many takes 16 to 26 ms there."""

_REST = 1.5  # seconds after the last movement, if its end does not arrive: a pointer may rest, and a kernel be slow

FieldOf = Callable[..., AbstractField]  # of points, and of the rigid parts while one of them is dragged


class ShowsPoints(traitlets.HasTraits):
    """A view over which the points of an editor in space are seen and dragged."""

    points_editor = traitlets.Any(None, allow_none=True).tag(sync=True, **ipywidgets.widget_serialization)
    picture_editor = traitlets.Any(
        None, allow_none=True, help="an editor of a picture, whose points are seen and dragged over the volume as well"
    ).tag(sync=True, **ipywidgets.widget_serialization)

    is_quick = False
    """True while the deformation is in motion, so that a coarser one will do."""

    show_deformation: Callable[..., None]

    @property
    def output_grid(self) -> Grid | None:
        """The grid whose box is seen, None for that of the volume."""
        return None

    def is_moved_in_client(self, sender: str) -> bool:
        """Check whether the front end in the window of this sender of edits makes the displacement of moving points."""
        return False

    def edit_points(self, editor: Any, field: FieldOf | None = None) -> None:
        """Show the points of an editor in space, to be dragged here as well, and their deformation of the volume.

        Parameters
        ----------
        editor : a :class:`~deformnb.widgets.SpaceEditor`, or None to end it: the content stays.
        field : what these points make of the volume; default is ``editor.field``. A document of several steps gives its
            own, with these points in the step that is edited.

        Notes
        -----
        In the front end: drag a point parallel to the screen or over the surface, or along x, y or z by its arrows;
        the wheel on it moves it along the ray, arrow keys by a voxel; a double click puts a point on the first
        visible surface, as :func:`~deformnb.imaging.surface_point` finds it. ``picture_editor`` is an
        :class:`~deformnb.widgets.Editor` whose points are shown and edited so too, projected on its picture.
        """
        leave = getattr(self, "_leave_points", None)
        if leave is not None:
            leave()
        self._leave_points: Callable[[], None] | None = None
        self.points_editor = editor
        if editor is not None:
            make = editor.field if field is None else field
            self._leave_points = self._follow_points(editor, make)
            self._show_points(make, editor.points, "end")

    def _follow_points(self, editor: Any, make: FieldOf) -> Callable[[], None]:
        """Show every movement, edit and setting; the result ends it. An editor keeps no view alive."""
        show = weakly(self, ShowsPoints._show_points)
        show_moved = weakly(self, ShowsPoints._show_moved)

        def changed(change: Any) -> None:
            show(make, editor.points, "end")

        def moved(edit: PointsEdit) -> None:
            show_moved(make, edit)

        names = ["points", "settings", "revision"]
        editor.on_edit(moved, details=True)
        editor.observe(changed, names)

        def leave() -> None:
            editor.on_edit(moved, remove=True)
            editor.unobserve(changed, names)

        return leave

    def _show_moved(self, make: FieldOf, edit: PointsEdit) -> None:
        """Show a movement; the end of an edit arrives as a change of the points."""
        if edit.phase == "move" and not self.is_moved_in_client(edit.sender):
            parts = None if edit.part is None else edit.with_part(self.points_editor.parts)
            self._show_points(make, edit.points, edit.phase, parts)

    def _show_points(
        self, make: FieldOf, points: ControlPoints, phase: str, parts: tuple[RigidPart, ...] | None = None
    ) -> None:
        try:
            field = make(points) if parts is None else make(points, parts)
        except DeformError:
            return  # the last good picture stays, and the editor reports the error
        timer = getattr(self, "_rest_timer", None)
        if timer is not None:
            timer.cancel()
        self.is_quick = phase == "move"
        self.show_deformation(field, output=self.output_grid)
        if self.is_quick:  # a cancelled drag ends without a message
            show = weakly(self, ShowsPoints._show_finely, lambda view: view.is_quick)
            self._rest_timer = Timer(_REST, partial(show, make, points, parts))
            self._rest_timer.start()

    def _show_finely(self, make: FieldOf, points: ControlPoints, parts: tuple[RigidPart, ...] | None) -> None:
        self._show_points(make, points, "end", parts)


def plain_fit(field: AbstractField | None, editor: Any) -> ControlPoints | None:
    """The points of an editor in space if a field is their fit and nothing else, so that a front end can make it; else
    None: with rigid parts, cuts or stages, after another deformation, and of more than :data:`MOST_FITTED` points.
    """
    if editor is None or not isinstance(field, RBFInterpolant | ForwardFit) or len(field.ids) > MOST_FITTED:
        return None
    step = editor.step()
    try:
        own = step.field(editor.volume.finest_grid)
    except DeformError:
        return None
    (leaves, form), (others, other_form) = jax.tree_util.tree_flatten(field), jax.tree_util.tree_flatten(own)
    # Nearly: where points have moved since a matrix was factored, two fits of the same differ by rounding.
    is_same = form == other_form and all(map(np.allclose, leaves, others))  # type: ignore[operator]  # as in textures
    return step.points if is_same else None

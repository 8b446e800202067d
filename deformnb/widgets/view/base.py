"""Base of all views of a volume, which makes them interchangeable.

Views that follow an editor get its deformation while its points move: one map is fitted again in Python.
"""

from __future__ import annotations

import contextlib
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import traitlets
from numpy.typing import ArrayLike

from deformnb._typing import Image
from deformnb.checks import short_value
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.imaging.display import DisplaySettings
from deformnb.rbf.cuts import Cut, CutRuleName, Decoupled
from deformnb.rbf.fields import AbstractField, Composed, Identity
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidPart
from deformnb.volume.transfer import PresetName, TransferFunction
from deformnb.volume.volume import Grid, VolumeLike
from deformnb.widgets.camera import update_camera
from deformnb.widgets.messages.editors import PointsEdit
from deformnb.widgets.messages.views import FollowData
from deformnb.widgets.textures import MOST_MAPS, count_maps, cut_plane, equal_fields


class AbstractView(ABC):
    """A window on one volume and its deformation.

    A view holds its volume; edits send displacements only. All lengths are physical, all directions in
    space (LPS). A view never changes its inputs.

    Attributes
    ----------
    shows : a name of :data:`SHOWS`; setting it changes the picture, :meth:`still` included (a still of
        "flicker" shows the deformed volume). Widgets declare it as a :class:`ShowsTrait`.
    clip : the part of the box that is seen, a :class:`ClipTrait`; see :meth:`set_clip`.
    camera : position of the viewer, a :class:`CameraTrait`; :meth:`set_camera` and the user change it.
    draws_by_vtk : whether its pictures are VTK's, and so those in files too.
    """

    shows: Any
    clip: Any
    camera: Any
    draws_by_vtk = False
    _following: Any = None
    _followed_output: Grid | None = None

    @abstractmethod
    def show(self, volume: VolumeLike) -> None:
        """Show another volume, without deformation, from the same side."""

    @abstractmethod
    def show_deformation(self, deformation: Deformation | AbstractField | None, *, output: Grid | None = None) -> None:
        """Deform the content of the view.

        Parameters
        ----------
        deformation : a document, a backward field in space, or None for the volume as it is.
        output : its box is what can be seen (the field of view); default is the volume's own.
        """

    def follow(self, editor: Any, field: AbstractField, index: int = 0, *, output: Grid | None = None) -> None:
        """Let an editor deform the content: each movement of its points, not only the end of an edit.

        Parameters
        ----------
        editor : an :class:`~deformnb.widgets.Editor`, or None to end it.
        field : shown until the next movement: an extrusion over the editor's plane, or a composition that ends
            with one. Its plane, depths and weights stay, also while points move.
        index : which of its maps the editor's points make.

        Notes
        -----
        May be called after every edit: a point being dragged stays at the pointer. Unless a view has its own
        means, Python fits the map again and :meth:`show_deformation` shows it.
        """
        following, self._followed_output = self._following, output
        if following is not None and following.continues_map(editor, index):
            self.show_deformation(following.show(field)(), output=output)
            return
        self._stop_following()
        self.show_deformation(field, output=output)
        if editor is not None:
            self._following = Following(editor, Refit(field, index), self._show_followed)

    def _show_followed(self, make: Callable[[], AbstractField | None]) -> None:
        self.show_deformation(make(), output=self._followed_output)

    def _stop_following(self) -> None:
        """Stop observing the editor."""
        following, self._following = self._following, None
        if following is not None:
            following.close()

    @abstractmethod
    def set_transfer(self, transfer: TransferFunction | PresetName) -> None:
        """Show with other colours and opacities: a transfer function, or the name of a preset."""

    def set_camera(
        self,
        direction: ArrayLike | None = None,
        up: ArrayLike | None = None,
        zoom: float | None = None,
        *,
        perspective: bool | None = None,
    ) -> None:
        """Set the camera.

        Parameters
        ----------
        direction : of view, any length; None for no change.
        up : what points up; default is +z, or -y for a view along z.
        zoom : 1 shows the whole box, 2 half of it; None for no change.
        perspective : False for parallel rays; None for no change.
        """
        self.camera = update_camera(self.camera, direction, up, zoom, perspective)

    def link_camera(self, other: AbstractView) -> traitlets.link:
        """Turn, move and zoom another view along with this one, and this one along with it.

        Parameters
        ----------
        other : takes this one's camera immediately.

        Returns
        -------
        traitlets.link
            Its ``unlink()`` ends it.

        Raises
        ------
        DeformError
            If the other one has no camera.

        Examples
        --------
        >>> from deformnb.datasets import PHANTOMS
        >>> from deformnb.widgets import LiveView
        >>> before, after = (LiveView(PHANTOMS["bar"].make((8, 8, 16))) for _ in range(2))
        >>> link = before.link_camera(after)
        >>> after.set_camera(zoom=2.0)
        >>> before.camera["zoom"]
        2.0
        """
        if not (isinstance(other, traitlets.HasTraits) and other.has_trait("camera")) or other is self:
            raise DeformError(f"cameras link two views, got {short_value(other)} for the other one.")
        return traitlets.link((self, "camera"), (other, "camera"))

    def set_clip(
        self, x: Sequence[float] | None = None, y: Sequence[float] | None = None, z: Sequence[float] | None = None
    ) -> None:
        """Clip the tissue outside a part of the box: in space, after the deformation.

        Parameters
        ----------
        x, y, z : lowest and highest share of the box along that index axis, from 0 to 1; None for no change.
        """
        self.clip = [old if new is None else new for old, new in zip(self.clip, (x, y, z), strict=True)]

    def settings(self) -> DisplaySettings:
        """Display settings of this view, apart from the deformation, with which a picture in a file shows the same."""
        from deformnb.widgets.view.stills import StillAsSeen, display_scene

        names = ("camera", "projection", "frame", "show_folds", "ambient_occlusion")
        looks = {name: getattr(self, name) for name in names if hasattr(self, name)}
        return DisplaySettings(
            shows=self.shows,
            clip=self.clip,
            background=self._shade(),
            scene=display_scene,
            still=None if self.draws_by_vtk else StillAsSeen,
            **looks,
        )

    def _shade(self) -> str:
        """The background of the front end, "dark" or "light"."""
        return "light" if getattr(self, "background", "") == "light" else "dark"

    @abstractmethod
    async def screenshot(self, timeout: float = 10.0) -> Image:
        """The picture that is on the screen now, (height, width, 3); without a screen the one of :meth:`still`."""

    @abstractmethod
    def still(self, size: tuple[int, int] | None = None) -> Image:
        """The same picture by the ray caster in Python, immediately and without a screen, (height, width, 3)."""

    @abstractmethod
    def stats(self) -> dict[str, Any]:
        """Frame times in milliseconds, bytes sent and the resolution; keys differ between views."""


_OBSERVED = ["points", "settings", "lone_support", "cuts", "parts", "cut_rule"]


@dataclass(frozen=True, eq=False)
class PlanarFit:
    """The fit of points on a picture: all that an editor holds of it except the points.

    Parameters
    ----------
    settings : of the fit.
    parts, cuts, cut_rule : of the picture, as in :class:`~deformnb.document.deformation.Step`.
    softness : width over which the opacity falls at a cut.
    lone : support radius where the points do not determine it.
    """

    settings: FitSettings
    parts: tuple[RigidPart, ...] = ()
    cuts: tuple[Cut, ...] = ()
    cut_rule: CutRuleName = "source"
    softness: float = 1.0
    lone: float | None = None

    def __call__(self, points: ControlPoints, previous: AbstractField | None = None) -> AbstractField:
        """The displacement of the picture; ``previous`` is the one before, while points are dragged."""
        cuts = [cut.region for cut in self.cuts if cut.enabled]
        return self.settings.fit(
            points, self.parts, cuts, cut_rule=self.cut_rule, softness=self.softness, lone=self.lone, previous=previous
        )


def with_map(field: AbstractField, index: int, flat: AbstractField) -> AbstractField:
    """The same field with another map.

    Parameters
    ----------
    field : an extrusion, cut or not, or a composition that ends with one. Plane, depths and weights stay.
    index : of the replaced map.
    flat : what takes its place, over the plane; its cuts become those of the field. Where the other maps would have to
        be divided by other cuts than before, the field stays as it is, for only their points could determine how.
    """
    if isinstance(field, Composed):
        return replace(field, then=with_map(field.then, index, flat))
    last = cut_plane(field, MOST_MAPS)
    if last is None:
        raise DeformError("only an extrusion has maps that can be replaced, and this field is none.")
    old = dict(zip(last.sides or ((),), last.regions, strict=True))
    new = dict(zip(flat.sides, flat.fields, strict=True)) if isinstance(flat, Decoupled) else {(): flat}
    cuts, before = (f.regions if isinstance(f, Decoupled) else () for f in (flat, field))
    is_same = len(cuts) == len(before) and all(map(equal_fields, cuts, before))
    if not is_same and last.count > 1:
        return field
    sides = sorted({*new, *(old if last.count > 1 else ())})
    nothing = (Identity(2),) * last.count
    made = []
    for side in sides:
        maps = old[side].maps if side in old and is_same else nothing
        made.append(replace(last.first, maps=(*maps[:index], new.get(side, nothing[0]), *maps[index + 1 :])))
    if not isinstance(flat, Decoupled):
        return made[0]
    softness = field.softness if isinstance(field, Decoupled) else flat.softness
    return Decoupled(tuple(made), tuple(sides), flat.regions, last.first.plane, flat.rule, softness)


def check_map(field: AbstractField | None, index: int) -> None:
    """Refuse to let an editor move a map that is not there."""
    count = count_maps(field)
    if count is None:
        raise DeformError("an editor moves the maps of an extrusion, and this field does not end with one.")
    if not 0 <= index < count:
        raise DeformError(f"there is no map {index}; the extrusion has {count}.")


def followed_state(editor: Any, index: int) -> FollowData:
    """State of an editor of which a field is made, by which its front end checks whether it has changed since."""
    shapes = ("cuts", "cut_rule", "parts")
    state = editor.get_state(["points", *shapes])
    return {"index": index, "points": state.get("points"), "shapes": {name: state.get(name) for name in shapes}}


class Refit:
    """A field, one map of which follows an editor.

    Parameters
    ----------
    field : an extrusion, or a composition that ends with one; all but the one map stays.
    index : which of its maps the editor's points make.

    Raises
    ------
    DeformError
        If the field does not end with an extrusion, or has no such map.
    """

    def __init__(self, field: AbstractField | None, index: int) -> None:
        check_map(field, index)
        assert field is not None
        self.index = index
        self._field = field
        self._good = (field, field)  # the field with another map, behind the one that it was made of
        self._previous: AbstractField | None = None

    def __call__(self, points: ControlPoints, how: PlanarFit) -> AbstractField:
        """The field with the map of these points; the last one where they cannot be fitted, as the editor reports."""
        field, (of, good) = self._field, self._good  # another thread may put another field meanwhile
        last = good if of is field else field
        with contextlib.suppress(DeformError):
            self._previous = how(points, self._previous)
            last = with_map(last, self.index, self._previous)
        self._good = (field, last)
        return last

    def put(self, field: AbstractField) -> None:
        """Continue with another field, of which the same map follows the editor."""
        check_map(field, self.index)
        self._field = field


class Following:
    """Puts what makes the field of an editor's points at every movement in it, until it is closed.

    Parameters
    ----------
    put : a method, held weakly: an editor keeps no view alive. Its argument is to be called later, in any thread.
    """

    def __init__(self, editor: Any, refit: Refit, put: Callable[[Callable[[], AbstractField | None]], None]) -> None:
        self._editor, self._refit = editor, refit
        self._put = weakref.WeakMethod(put)
        self._moving: tuple[ControlPoints, PlanarFit] | None = None
        editor.on_edit(self._moved, details=True)
        editor.observe(self._changed, _OBSERVED)

    def continues_map(self, editor: Any, index: int) -> bool:
        """Check whether it is this map of this editor that is followed."""
        return editor is self._editor and index == self._refit.index

    def show(self, field: AbstractField) -> Callable[[], AbstractField | None]:
        """Maker of another field, in the editor's current state: a point that is being dragged does not jump back."""
        self._refit.put(field)
        moving = self._moving
        if moving is None or self._editor.edit_under_way is not None or moving[0] == self._editor.points:
            return lambda: field
        return partial(self._refit, *moving)

    def close(self) -> None:
        """Stop observing the editor."""
        self._editor.on_edit(self._moved, remove=True)
        self._editor.unobserve(self._changed, _OBSERVED)

    def _moved(self, edit: PointsEdit) -> None:
        how = self._editor.current_fit()
        parts = edit.with_part(how.parts)
        self._apply(edit.points, how if parts is how.parts else replace(how, parts=parts), edit.phase)

    def _apply(self, points: ControlPoints, how: PlanarFit, phase: str) -> None:
        put = self._put()
        if put is None:
            return
        self._moving = (points, how) if phase == "move" else None
        put(partial(self._refit, points, how))

    def _changed(self, change: Any) -> None:
        self._apply(self._editor.points, self._editor.current_fit(), "end")

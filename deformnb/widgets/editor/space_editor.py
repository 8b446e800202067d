"""Editor of control points in space, with three coordinates, in three linked slices of the volume (Eq. 9).

The front end draws points and cross-hairs and moves them; the pictures are warped here, at every movement, and
sent as bytes. The messages are those of :mod:`deformnb.widgets.messages.editors`.
"""

from __future__ import annotations

import io
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import traitlets
from msgspec import UNSET, structs
from numpy.typing import NDArray

from deformnb._jax import ENDING
from deformnb._weak import weakly
from deformnb.document.deformation import Step
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField, compose
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Mask
from deformnb.rbf.rigid import RigidPart
from deformnb.rbf.support import lone_support
from deformnb.volume.colour_maps import ColourMapName
from deformnb.volume.plane import Picture
from deformnb.volume.transfer import PresetName, TransferFunction, preset
from deformnb.volume.volume import Volume, VolumeLike, as_volume
from deformnb.widgets.bundle import bundle
from deformnb.widgets.cell_widgets import close_earlier_of_this_cell, with_png
from deformnb.widgets.editor.base import SPACE_TRAITS, EditedPoints, PointsTrait
from deformnb.widgets.editor.space_slices import (
    SLICE_PROJECTIONS,
    Shown,
    SpacePictures,
    cuts_on,
    dets_on,
    slice_folds,
    tissue_mask,
)
from deformnb.widgets.messages.editors import (
    SPACE_EDITOR,
    DrawnPart,
    FromWindow,
    Pictures,
    PicturesWanted,
    PointsEdit,
    ShapesEdit,
    ShowPoint,
    SlicesMoved,
)
from deformnb.widgets.messages.record import Seen
from deformnb.widgets.messages.shapes import Shapes, ShapesTrait
from deformnb.widgets.packed_volume import unit_of
from deformnb.widgets.view.transport import Pacer
from deformnb.widgets.worker import Worker

_LOG = logging.getLogger(__name__)

_MOVING, _RESTING = 256, 512  # pixels along the longer side of a slice
_SLOW, _FEWER = 0.07, 160  # seconds for the pictures of a movement, from which on they have fewer pixels
_REST = 0.35  # seconds after the last movement
_PREVIEW_DPI = 80


class LastField:
    """The last field that could be made, and the facts about the newest state; may be used by several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._key: tuple[Any, ...] | None = None
        self.field: AbstractField | None = None
        self.facts: dict[str, Any] = {}

    def of(self, key: tuple[Any, ...], make: Callable[[], AbstractField | None]) -> AbstractField | None:
        """The field of a state, made if it is another one; the last good one where it cannot be made."""
        with self._lock:
            if self._key is None or any(a is not b and not _is_same(a, b) for a, b in zip(key, self._key, strict=True)):
                try:
                    self.field = make()
                    self.facts = {"note": "; ".join(getattr(self.field, "notes", ())), "isBad": False}
                except DeformError as error:
                    self.facts = {"note": str(error), "isBad": True}
                self._key = key
            return self.field


class PaneSender:
    """Has pictures drawn in a thread as often as front ends show them: smaller while something moves, large at rest.

    Parameters
    ----------
    draw : draws and sends the pictures: called with their number and with the front end that gets all, None for each.

    Attributes
    ----------
    is_moving : True while something is dragged.
    worker : the thread; pacer : which counts what front ends have shown.
    sent : the last message for each pane.
    """

    def __init__(self, draw: Callable[[int, str | None], None]) -> None:
        self._draw, self.is_moving = draw, False
        self.sent: dict[int, Any] = {}
        self._seconds = 0.0  # for the pictures of the last movements
        self._has_front_end = False
        self.worker = Worker("deformnb-space-editor")
        self.pacer = Pacer(lambda number: self.worker.latest("pictures", partial(draw, number, None)))

    def most(self, is_moving: bool) -> int:
        """Pixels along the longer side of a slice."""
        return _RESTING if not is_moving else _MOVING if self._seconds < _SLOW else _FEWER

    def greet(self, view: str) -> None:
        """Send a front end all pictures."""
        self._has_front_end = True
        self.worker.latest(f"hello {view}", partial(self._draw, 0, view))

    def offer(self) -> None:
        """Have the newest state drawn, soon."""
        if self._has_front_end:  # a front end that comes later sends a request
            self.pacer.offer()

    def note(self, seconds: float) -> None:
        """Note the time that pictures of a movement took, after which there will be a rest."""
        self._seconds += 0.3 * (seconds - self._seconds)
        self.worker.debounce(_REST, self._rest)

    def _rest(self) -> None:
        self.is_moving = False
        self.offer()

    def close(self) -> None:
        """End the thread."""
        self.pacer.close()
        self.worker.close()


class SpaceEditor(EditedPoints):
    """Control points in space, placed and dragged in three pictures at right angles.

    Parameters
    ----------
    volume : to deform.
    points : control points of dimension 3; default is none.
    before : the deformation before this step, a backward field in space.
    options : further fields of the step, such as its rigid ``parts`` and ``cuts``, which are traits too: see
        :meth:`step`.
    window : values that are black and white; default is from the background to the densest tissue.
    transfer : of composite pictures, or the name of a preset.
    cursor : the place (x, y, z) through which the slices go; default is the middle.
    projection : "slice", or "mip", "composite" and "shaded" for all of the volume seen from that side.
    kernel, support, etc. : settings of the fit, as in :class:`~deformnb.rbf.fit_settings.AbstractFitSettings`.
    height : largest height of the pictures in CSS pixels.
    theme, label, read_only : as in :class:`~deformnb.widgets.Editor`.

    Notes
    -----
    It can take an :class:`~deformnb.widgets.Editor`'s place: ``points``, ``selected``, ``history``, ``waiting``,
    ``on_edit``, ``on_history``, ``edit_under_way``, ``fit`` and ``step`` mean the same.
    ``LiveView.edit_points(editor)`` shows its points in a live view, where they can be dragged as well.
    ``large_slice`` is the number of the slice that is shown larger than the other two, -1 for none.
    ``window`` holds the values shown as black and white, as they were set manually; empty for the automatic ones.
    ``mirror`` is ``{"on": bool, "axis": "x" | "y" | "z", "at": number}``: while it is on, actions of the pointer in the
    pictures on one side of that plane are done on the other side too; the plane is one of the volume's own, the next to
    that axis, None its middle. ``snap`` is the step of a lattice to which targets snap, 0 for none.
    ``stop_at_folds``, which is on at first, stops drags and arrow keys before they fold tissue; ``tissue`` is the mask
    of that, as documents hold it, {} where every fold counts, None where a map of more than the points is not checked.
    ``brush_radius`` is the radius of the ball of the brushes, 0 for a share of the volume.
    ``overlay`` is "folds", which paints red on the slices where the map of the points folds, or "none"; ``show_grid``
    draws a grid that bends with them, ``density`` cells along the longest side of the volume.
    One that is ``read_only`` and has no points is a viewer of three linked slices: ``SpaceEditor(volume, before=field,
    read_only=True)`` shows the deformed volume.

    Examples
    --------
    >>> volume = Volume.from_array(np.zeros((20, 30, 40), np.uint8))
    >>> editor = SpaceEditor(volume, ControlPoints.from_arrays([[10, 10, 10]], [[14, 10, 10]]), trend="none")
    >>> editor.fit().displacement([14.0, 10.0, 10.0]).round(6).tolist()
    [-4.0, 0.0, 0.0]
    >>> editor.close()
    """

    _esm = bundle("space_editor.js")
    _css = bundle("space_editor.css")

    points = PointsTrait(3)
    cuts = ShapesTrait("cuts", 3)
    parts = ShapesTrait("parts", 3)
    channel = SPACE_EDITOR
    front_end_traits = SPACE_TRAITS
    mirror = traitlets.Dict({"on": False, "axis": "x", "at": None}).tag(sync=True)
    cursor = traitlets.Any(help="the place (x, y, z) through which the slices go").tag(sync=True)
    projection = traitlets.Enum(list(SLICE_PROJECTIONS), "slice").tag(sync=True)
    shows_original = traitlets.Bool(False).tag(sync=True)
    brush_radius = traitlets.Float(0.0).tag(sync=True)
    stop_at_folds = traitlets.Bool(True).tag(sync=True)
    tissue: Any = traitlets.Dict({}, allow_none=True).tag(sync=True)
    overlay = traitlets.Enum(["none", "folds"], "folds").tag(sync=True)
    density = traitlets.Int(16, min=0, max=64).tag(sync=True)
    show_grid = traitlets.Bool(True).tag(sync=True)
    large_slice = traitlets.Int(-1, min=-1, max=2, help="the slice that is larger than the others").tag(sync=True)
    window = traitlets.List(traitlets.Float(), help="values shown as black and white, set manually").tag(sync=True)
    panes: Any = traitlets.List().tag(sync=True)
    unit = traitlets.Unicode(help="of lengths; empty where it is not known").tag(sync=True)
    revision = traitlets.Int(0, help="counts changes of other data than traits: volume, before, options")

    def __init__(
        self,
        volume: VolumeLike,
        points: ControlPoints | None = None,
        *,
        before: AbstractField | None = None,
        options: dict[str, Any] | None = None,
        window: tuple[float, float] | None = None,
        transfer: TransferFunction | PresetName = "specimen",
        **settings: Any,
    ) -> None:
        volume = as_volume(volume)
        self._lock = threading.RLock()  # callbacks run in another thread than cells
        self._window, self._transfer = window, transfer
        self._before, self._options = before, _without_shapes(options or {})
        self._last = LastField()
        self._moved: tuple[ControlPoints, tuple[RigidPart, ...]] | None = None
        self._lifted: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
        self.sender = PaneSender(weakly(self, SpaceEditor._draw))
        traits = self._volume_traits(volume)
        super().__init__(
            **{**traits, "label": volume.name or "Volume", "height": 360, **settings},
            points=ControlPoints.empty(3) if points is None else points,
            window=list(window or ()),
            **{name: (options or {}).get(name, ()) for name in _SHAPES},
        )
        self._update_tissue()
        self.observe(self._window_chosen, "window")
        self.observe(self._shapes_changed, _SHAPES)
        shown = ["points", "settings", "revision", "cursor", "projection", "shows_original"]
        self.observe(lambda change: self._changed(), shown)
        close_earlier_of_this_cell(self)

    # ---- display ----------------------------------------------------------------------------------------------------

    def _volume_traits(self, volume: Volume) -> dict[str, Any]:
        function = preset(self._transfer, volume) if isinstance(self._transfer, str) else self._transfer
        self._pictures = SpacePictures(volume, function, self._window)
        return {
            "panes": [pane.info() for pane in self._pictures.panes],
            "cursor": list(volume.grid.center),
            "unit": unit_of(volume.grid),
            "lone_support": lone_support(volume.finest_grid),
        }

    @property
    def volume(self) -> Volume:
        """Volume to deform; the points stay when another one is set."""
        return self._pictures.volume

    @volume.setter
    def volume(self, volume: Volume) -> None:
        with self._lock:
            traits = self._volume_traits(as_volume(volume))
        with self.hold_sync():  # both in one message: cursor and pictures must match
            for name, value in traits.items():
                setattr(self, name, value)
            self._update_tissue()
        self.revision += 1

    def _update_tissue(self) -> None:
        mask = {} if self._before is not None or self.read_only else tissue_mask(self.volume)
        self.tissue = None if self.cuts or self.parts else mask

    def _shapes_changed(self, _change: Any) -> None:
        self._update_tissue()
        self.revision += 1

    @property
    def before(self) -> AbstractField | None:
        """Deformation before this step: a backward field in space, or None."""
        return self._before

    @before.setter
    def before(self, field: AbstractField | None) -> None:
        self._before = field
        self._update_tissue()
        self.revision += 1

    def preview(self, field: AbstractField | None) -> None:
        """Show the deformation before this step while it changes: with fewer pixels, until it rests."""
        self.sender.is_moving = True
        self.before = field

    def set_display(self, window: tuple[float, float] | None, colour_map: ColourMapName) -> None:
        """Show other values as black and white, None for the default, and slices in a colour map."""
        with self._lock:
            made = self._pictures
            self._pictures = SpacePictures(made.volume, made.transfer, window, colour_map)
            self._window = window
        self.window = list(window or ())
        self.revision += 1

    def _window_chosen(self, change: Any) -> None:
        window = tuple(change["new"]) or None
        if window != self._window:
            self.set_display(window, self._pictures.colour_map)

    @property
    def largest_slice(self) -> int:
        """The number of the slice that shows most of the volume."""
        sizes = [(a1 - a0) * (b1 - b0) for a0, a1, b0, b1, *_ in (pane.box for pane in self._pictures.panes)]
        return int(np.argmax(sizes))

    @property
    def options(self) -> dict[str, Any]:
        """Further fields of the step, such as its rigid ``parts``; set it again to change them."""
        return {**self._options, **{name: shapes for name in _SHAPES if (shapes := getattr(self, name))}}

    @options.setter
    def options(self, options: dict[str, Any]) -> None:
        replace(self.step(), **options)  # refuses what no step has
        self._options = _without_shapes(options)
        for name in _SHAPES:
            setattr(self, name, options.get(name, ()))
        self.revision += 1

    def fit(self) -> AbstractField:
        """The backward displacement of the points, without the deformation before.

        Raises
        ------
        DeformError
            If the points cannot be fitted; the front end shows the same message.
        """
        return self.step().field(self.volume.finest_grid)

    def step(self, **options: Any) -> Step:
        """The points and settings as a step of a :class:`~deformnb.document.deformation.Deformation`.

        Parameters
        ----------
        options : further fields of the step, in addition to those of ``editor.options``.
        """
        return self._step(self.points, **options)

    def _step(self, points: ControlPoints, **options: Any) -> Step:
        return Step((points,), None, **{**self.settings.as_dict(), **self.options, **options})

    def look_at(self, point: int) -> None:
        """Move the slices to the target of the point with this id."""
        self.cursor = self.points.target[self.points.index(point)].tolist()
        self.post(ShowPoint(id=point))

    def field(self, points: ControlPoints | None = None, parts: tuple[RigidPart, ...] | None = None) -> AbstractField:
        """The whole deformation: that before, and then these points and rigid parts or the editor's own.

        Raises
        ------
        DeformError
            If the points cannot be fitted.
        """
        parts = self.parts if parts is None else parts
        step = self._step(self.points if points is None else points, parts=parts).field(self.volume.finest_grid)
        return step if self._before is None else compose(self._before, step)

    def preview_png(self) -> bytes:
        """The three pictures with the points as a PNG: the still where no front end runs."""
        from deformnb.imaging.drawing import draw_pictures

        made, field = self._pictures, self.field()
        shown = [made.slice(k, field, self.cursor, _MOVING) for k in range(len(made.panes))]
        pictures = [
            Picture(s.values, p.plane, s.raster, p.name, (0.0, 255.0)) for s, p in zip(shown, made.panes, strict=True)
        ]
        flat = [
            replace(
                self.points,
                source=p.plane.to_plane(self.points.source)[:, :2],
                target=p.plane.to_plane(self.points.target)[:, :2],
            )
            for p in made.panes
        ]
        figure = draw_pictures(pictures, points=flat, titles=[p.name for p in made.panes], style="dark")
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=_PREVIEW_DPI, facecolor=figure.get_facecolor())
        return stream.getvalue()

    # ---- the front end ----------------------------------------------------------------------------------------------

    def take_message(self, message: Any, buffers: Any = ()) -> None:
        if isinstance(message, PicturesWanted):
            self.sender.greet(message.view)
        elif isinstance(message, Seen):
            self.sender.pacer.confirm(message.seq)
        elif isinstance(message, SlicesMoved):
            self._take_slices(message)
        else:
            super().take_message(message, buffers)

    def _take_slices(self, message: SlicesMoved) -> None:
        self.sender.is_moving = message.moving
        for name, value in (
            ("cursor", message.cursor),
            ("projection", message.projection),
            ("shows_original", message.original),
            ("window", message.window),
        ):
            if value is not UNSET:
                setattr(self, name, value)
        self.sender.offer()  # also where nothing has changed: it may have come to rest

    def _take(self, message: FromWindow) -> None:
        if isinstance(message, PointsEdit):
            message = structs.replace(message, points=self._with_sources(message.points))
            self.sender.is_moving = message.phase == "move"
            if self.sender.is_moving:
                self._moved = message.points, message.with_part(self.parts)
                self.sender.offer()
        drawn, count = isinstance(message, DrawnPart), len(self.parts)
        if isinstance(message, DrawnPart):
            region = Mask.drawn(message.form, message.middle, message.radii, self._pictures.panes[0].plane.frame)
            message = ShapesEdit(
                sender=message.sender,
                seq=message.seq,
                what="parts",
                kind="add rigid part",
                shapes=Shapes((*self.parts, RigidPart(region))),
            )
        super()._take(message)
        if drawn and len(self.parts) > count:
            self.choose("parts", count)

    def _with_sources(self, points: ControlPoints) -> ControlPoints:
        """Points of the front end; the source of a new one is the tissue seen at its place.

        A front end has the target only and sends it as the source. The tissue there comes from target + D, and with
        that as its source nothing moves. Until the front end has received it, it sends the same again.
        """
        known, source = set(self.points.ids), points.source.copy()
        for k, number in enumerate(points.ids):
            if number not in known and number not in self._lifted and np.array_equal(source[k], points.target[k]):
                self._lifted[number] = (source[k].copy(), self._origin(source[k]))
            raw, origin = self._lifted.get(number, (None, source[k]))
            if raw is not None and np.array_equal(source[k], raw):
                source[k] = origin
        return replace(points, source=source)

    def _origin(self, place: NDArray[np.float64]) -> NDArray[np.float64]:
        field = None if self.shows_original else self._field(self.points, self.parts)
        if field is None:
            return place.copy()
        if self._before is not None:  # sources are places of what this step is given
            field = self._step(self.points).field(self.volume.finest_grid)
        return np.asarray(place + field.displacement(place) / (self.strength or 1.0))

    # ---- pictures ---------------------------------------------------------------------------------------------------

    def _changed(self) -> None:
        self._moved = None
        self.sender.offer()

    def _field(self, points: ControlPoints, parts: tuple[RigidPart, ...]) -> AbstractField | None:
        """Field of these points and parts; the last good one where they cannot be fitted, and the reason."""
        key = (points, self.volume, self._before, self._options, self.cuts, parts, self.settings)
        is_any = bool(len(points) or parts or self._before is not None)
        return self._last.of(key, lambda: self.field(points, parts) if is_any else None)

    def _draw(self, number: int, view: str | None) -> None:
        (points, parts), is_moving = self._moved or (self.points, self.parts), self.sender.is_moving
        start = time.monotonic()
        try:
            field = self._field(points, parts)
            images = self._images(None if self.shows_original else field, is_moving, all_of_them=view is not None)
            facts = dict(self._last.facts)
            facts["window"] = list(self._pictures.window)
            if field is not None:
                found = slice_folds(field, self.volume.grid, is_quick=is_moving)
                facts |= {"folds": (found.least, found.share), "worst": found.place}
        except Exception as error:  # in a separate thread nothing else would report it
            if ENDING.is_set():
                raise
            _LOG.exception("pictures could not be made")
            images, facts = {}, {"note": f"The pictures could not be made: {error}", "isBad": True}
        descriptions, sent = [], []
        for index, shown in images.items():
            about, buffers = shown.message()
            descriptions.append({"index": index, **about})
            sent += buffers
        self.post(Pictures(seq=number, view=view, panes=descriptions, facts=facts), sent)
        if is_moving:
            self.sender.note(time.monotonic() - start)

    def _images(self, field: AbstractField | None, is_moving: bool, *, all_of_them: bool) -> dict[int, Shown]:
        """The pictures that have changed since the last ones."""
        images = {}
        pictures, cursor, projection = self._pictures, self.cursor, self.projection
        most = self.sender.most(is_moving)
        for index, pane in enumerate(pictures.panes):
            depth = pane.depth_of(cursor) if projection == "slice" else None
            key = (pictures, field, projection, depth, most, self.cuts)
            if key == self.sender.sent.get(index) and not all_of_them:
                continue
            if projection == "slice":
                made = pictures.slice(index, field, cursor, most)
                at, is_known = pane.depth_of(cursor), self.tissue is not None and self.direction != "forward"
                dets = None if is_known or field is None else dets_on(pane, at, field, is_quick=is_moving)
                images[index] = replace(made, cuts=cuts_on(pane, at, self.cuts), dets=dets)
            else:
                images[index] = pictures.projection(index, field, projection, is_quick=is_moving)
            self.sender.sent[index] = key
        return images

    # ---- traits and display -----------------------------------------------------------------------------------------

    @traitlets.validate("cursor")
    def _inside(self, proposal: Any) -> list[float]:
        place = np.asarray(proposal["value"], dtype=np.float64)
        if place.shape != (3,) or not np.isfinite(place).all():
            raise DeformError(f"the cursor must be three finite numbers (x, y, z), got {proposal['value']!r:.60}.")
        grid = self.volume.grid
        index = np.clip(grid.point_to_index(place), 0, np.asarray(grid.shape[::-1]) - 1)
        return [
            float(x) for x in (place if np.allclose(index, grid.point_to_index(place)) else grid.index_to_point(index))
        ]

    def close(self) -> None:
        """End the widget and its thread."""
        self.sender.close()
        super().close()

    def __repr__(self) -> str:
        nz, ny, nx = self.volume.shape
        return f"SpaceEditor({len(self.points)} points, volume of {nx} x {ny} x {nz})"

    def _repr_mimebundle_(self, **options: Any) -> Any:
        return with_png(super()._repr_mimebundle_(**options), self.preview_png)


_SHAPES = ["cuts", "parts"]  # fields of a step that are traits of the editor


def _without_shapes(options: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if name not in _SHAPES}


def _is_same(a: Any, b: Any) -> bool:
    return isinstance(a, str | float | int | None) and isinstance(b, str | float | int | None) and a == b

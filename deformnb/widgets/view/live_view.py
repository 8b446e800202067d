"""Live view: a volume rendered by WebGL in the browser, rotated and deformed without sending it again.

The front end gets the voxels once, in packed pieces that it requests, and then displacements only: it warps at every
sample of a ray, as the paper does on its GPU. A live view can also play the moments of an animation by
itself.

The messages are those of :data:`deformnb.widgets.messages.views.LIVE`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import ipywidgets
import traitlets

from deformnb._threads import Timer
from deformnb._typing import Image
from deformnb._weak import weakly
from deformnb.document.animation import TimeMaps
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.imaging.display import DisplaySettings
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField
from deformnb.volume.transfer import PresetName, TransferFunction
from deformnb.volume.volume import Grid, Volume, VolumeLike, as_volume
from deformnb.widgets.bundle import bundle
from deformnb.widgets.camera import CameraTrait, ClipTrait, ShowsTrait
from deformnb.widgets.cell_widgets import close_earlier_of_this_cell, with_png
from deformnb.widgets.image_encoding import from_png
from deformnb.widgets.messages.record import Seen as FieldSeen
from deformnb.widgets.messages.traits import take_traits
from deformnb.widgets.messages.views import (
    LIVE,
    ChunkRequest,
    Closed,
    EditView,
    FollowData,
    LiveHello,
    LiveMessage,
    Measurements,
    MovieFailed,
    MoviePiece,
    PointsFollowed,
    Screenshot,
    StillRequest,
    ToServerRenderer,
)
from deformnb.widgets.packed_volume import MOST_VOXELS_SENT
from deformnb.widgets.synced import SyncedWidget, ViewMeta
from deformnb.widgets.textures import MAP_SIZE, count_maps, differ_in_one_map
from deformnb.widgets.view.base import AbstractView, check_map, followed_state
from deformnb.widgets.view.fallback import SHARED, FallbackHost, RenderedState
from deformnb.widgets.view.field_sender import FieldSender, ShownField
from deformnb.widgets.view.live_front_ends import LiveFrontEnds, Outbox, Screenshots
from deformnb.widgets.view.packed_source import PackedSource
from deformnb.widgets.view.page_scene import MovieHost, PageGoneError, PageScene
from deformnb.widgets.view.picture_plane import ShowsPlane
from deformnb.widgets.view.space_points import ShowsPoints
from deformnb.widgets.view.stills import SceneDescription, preview_png, render_scene

OF_PAGE = frozenset(
    {"camera", "clip", "shows", "projection", "background", "width", "height", "target_ms", "settle_ms", "plane_frame"}
)
"""Traits that a front end may change: the camera by the pointer, the others by links of widgets in the front end."""


@dataclass(frozen=True, eq=False)
class Snapshot:
    """Contents of a live view at one moment, without its traits.

    Parameters
    ----------
    volume : as it was given.
    scene : all that a picture follows from.
    field : to send to front ends; None where an animation is played, of which the scene has one moment.
    map_size, space_size : samples of displacements, as of the view.
    """

    volume: Volume
    scene: SceneDescription
    field: AbstractField | None
    map_size: int
    space_size: int


def _forward_drawn(
    edit_view: Callable[[EditView], None], draw: Callable[[ToServerRenderer], None], message: ToServerRenderer
) -> None:
    """Pass on what a front end drawn by Python says: a wish to edit is for the studio of the live view."""
    if isinstance(message.say, EditView):
        edit_view(message.say)
    else:
        draw(message)


class LiveView(ShowsPoints, ShowsPlane, AbstractView, SyncedWidget, metaclass=ViewMeta):
    """A volume in the browser, turned and deformed there.

    Parameters
    ----------
    volume : shown first, if given.
    transfer : a transfer function or the name of a preset.
    projection : "shaded", "composite" or "mip".
    background : "auto" follows the front end, "dark" and "light" do not.
    shows : a name of :data:`~deformnb.widgets.camera.SHOWS`, such as "original" or "side_by_side".
    camera : direction, up, zoom, pan and perspective, as in :class:`~deformnb.widgets.camera.CameraTrait`. The front
        end writes it when the pointer is released; ``traitlets.link((a, "camera"), (b, "camera"))`` turns two views
        together.
    clip : the part of the box that is seen, three pairs of shares; see :meth:`set_clip`.
    frame : the part of the box that the camera frames at zoom 1, three pairs of shares; see :func:`framed_box`.
    limit : voxels sent to the front end at most; a larger volume is averaged, which the view reports.
    width, height : size in CSS pixels; a narrow window makes it smaller.
    fill : True takes the size of the box around it instead.
    map_size : samples of a displacement map along its longer side.
    space_size : samples along the longest side of a displacement that is no extrusion.
    show_folds : whether tissue is red and striped where the map folds; it costs nothing where nothing does.
    ambient_occlusion : whether hollows and deep places are darker in the projection "shaded"; see
        :func:`~deformnb.imaging.occlusion.ambient_light`.
    target_ms : time that a picture may take while something moves; its resolution adapts.
    settle_ms : debounce time of the full picture; after a drag it is drawn immediately.

    Attributes
    ----------
    editor, editor_map : the editor that is followed, and which map of the deformation it moves.
    player : whose moment of an animation is seen, while :attr:`moments` is something.
    source : the volume and its voxels as they are sent.
    fields : the deformation and its sender to the front ends.

    Notes
    -----
    Neither voxels nor maps are traits: a saved notebook holds a few kB of this widget.

    Examples
    --------
    >>> import numpy as np
    >>> view = LiveView(Volume.from_array(np.eye(8, dtype=np.uint8)[None] * np.ones((8, 1, 1), np.uint8)))
    >>> view.volume_info["shape"]
    [8, 8, 8]
    >>> view.still((64, 48)).shape
    (48, 64, 3)
    """

    _esm = bundle("live_view.js")
    _css = bundle("live_view.css")
    channel = LIVE

    rest = 0.6
    """Seconds without another colour, after which the voxels may be sent in other levels."""

    volume_info = traitlets.Dict().tag(sync=True)
    table = traitlets.Bytes().tag(sync=True)
    unit = traitlets.Float(1.0).tag(sync=True)
    projection = traitlets.Enum(["shaded", "composite", "mip"], "shaded").tag(sync=True)
    background = traitlets.Enum(["auto", "dark", "light"], "auto").tag(sync=True)
    shows = ShowsTrait().tag(sync=True)
    camera = CameraTrait().tag(sync=True)
    clip = ClipTrait().tag(sync=True)
    frame = ClipTrait().tag(sync=True)
    width = traitlets.Int(720, min=64, max=8192).tag(sync=True)
    height = traitlets.Int(540, min=64, max=8192).tag(sync=True)
    fill = traitlets.Bool(False).tag(sync=True)
    label = traitlets.Unicode("Volume").tag(sync=True)
    show_folds = traitlets.Bool(True).tag(sync=True)
    ambient_occlusion = traitlets.Bool(True).tag(sync=True)
    target_ms = traitlets.Float(65.0, min=5.0, max=5000.0).tag(sync=True)
    settle_ms = traitlets.Float(250.0, min=0.0, max=60000.0).tag(sync=True)
    player = traitlets.Any(None, allow_none=True).tag(sync=True, **ipywidgets.widget_serialization)
    editor = traitlets.Any(None, allow_none=True).tag(sync=True, **ipywidgets.widget_serialization)
    editor_map = traitlets.Int(0, min=0).tag(sync=True)

    def __init__(
        self,
        volume: VolumeLike | None = None,
        *,
        transfer: TransferFunction | PresetName = "specimen",
        limit: int = MOST_VOXELS_SENT,
        map_size: int = MAP_SIZE,
        space_size: int = 64,
        **traits: Any,
    ) -> None:
        self._lock = threading.RLock()  # callbacks run in another thread than cells
        self._outbox = outbox = Outbox(lambda content, buffers: self.send(content, buffers))  # noqa: PLW0108  # as it is then
        sizes = {"map_size": map_size, "space_size": space_size}
        self.source = source = PackedSource(outbox.post, limit=limit, transfer=transfer)
        self.fields = fields = FieldSender(lambda: source.voxels, outbox.post, self._lock, **sizes)
        self._front_ends, self._movies, self._screenshots = LiveFrontEnds(), MovieHost(), Screenshots(outbox.post)
        self._fallback = FallbackHost(outbox.send, self._render_state, self.set_trait, self._lock, **sizes)
        self._answers: dict[type, Callable[[Any], None]] = {
            LiveHello: self._hello,
            ChunkRequest: source.send,
            StillRequest: self._still,
            ToServerRenderer: partial(_forward_drawn, self.edit_view, self._fallback.receive),
            EditView: self.edit_view,
            FieldSeen: fields.confirm,
            PointsFollowed: self._front_ends.follow,
            Measurements: self._front_ends.measure,
            Closed: self._close_front_end,
            MovieFailed: self._movies.fail,
        }
        self._preview: tuple[SceneDescription, bytes] | None = None
        self._sharpener: Timer | None = None
        super().__init__(**traits)
        self.observe(self._fallback.set_display, SHARED)
        if volume is not None:
            self.show(volume)
        close_earlier_of_this_cell(self)

    # -- display -------------------------------------------------------------------------------------------------------

    def show(self, volume: VolumeLike, *, window: tuple[float, float] | None = None) -> None:
        """Show another volume, without deformation, from the same side.

        Parameters
        ----------
        window : values that are resolved; default is the whole range for bytes, and up to the densest tissue (all
            but the brightest 1 in 10 000) for other types. Where colours and opacities change within a quarter of
            that, only this part is resolved, more finely: the voxels are then sent again, which the view reports.
        """
        given = as_volume(volume)
        with self._lock:  # throughout: of two concurrent calls, one is shown whole
            self.source.put(given, window, all_values=self.projection == "mip")
            self.fields.replace(ShownField())
            self._announce()
        self.fields.offer()
        self._fallback.update()

    def _announce(self) -> None:
        """Send the facts about the voxels, and then their colours: clients show the old ones until voxels have come."""
        assert self.source.volume is not None
        self.label = f"Volume {self.source.volume.name}".strip()
        self.volume_info = self.source.ready().info()
        self.set_transfer(self.source.wanted_transfer)

    @traitlets.observe("projection")
    def _colours_changed(self, _change: Any = None) -> None:
        """Once nothing has changed for a while, send the voxels in finer levels if the colours need them."""
        timer, self._sharpener = self._sharpener, None
        if timer is not None:
            timer.cancel()
        if self.source.needs_repacking(all_values=self.projection == "mip"):
            self._sharpener = Timer(self.rest, weakly(self, LiveView.repack))
            self._sharpener.start()

    def repack(self, *, is_too_large: bool = False) -> None:
        """Send the voxels again where they are too many for a GPU, or where the colours need other levels by now."""
        with self._lock:
            if is_too_large or self.source.needs_repacking(all_values=self.projection == "mip"):
                self.source.repack(all_values=self.projection == "mip")
                self.fields.replace(self.fields.shown)
                self._announce()

    @property
    def output_grid(self) -> Grid | None:
        return self.fields.shown.output

    def show_deformation(self, deformation: Deformation | AbstractField | None, *, output: Grid | None = None) -> None:
        self._take(deformation, output, None)
        self._fallback.update()

    def _take(
        self, deformation: Deformation | AbstractField | None, output: Grid | None, followed: FollowData | None
    ) -> None:
        shown = self.source.ready()
        grid = shown.original if output is None else output
        field = deformation.field(grid) if isinstance(deformation, Deformation) else deformation
        if field is not None and field.dim != 3:
            raise DeformError("a volume needs a field in space; extrude the field of a plane first.")
        self._replace_field(field, output, followed)
        self.fields.offer()

    def _replace_field(self, field: AbstractField | None, output: Grid | None, followed: FollowData | None) -> None:
        self.fields.replace(
            ShownField(field, output, followed, is_quick=self.is_quick, points_editor=self.points_editor)
        )

    def follow(
        self, editor: Any, field: Extrusion | AbstractField, index: int = 0, *, output: Grid | None = None
    ) -> None:
        """As :meth:`AbstractView.follow`, in the same client: without a message to Python.

        To let the editor move another map, follow with the other index first and then give it that map's points.
        """
        if editor is not None or count_maps(field) is not None:
            check_map(field, index)
        followed = None if editor is None else followed_state(editor, index)
        shown = self.fields.shown
        is_same_map = (
            followed is not None
            and shown.moments is None
            and (editor, index, output) == (self.editor, self.editor_map, shown.output)
        )
        if is_same_map and differ_in_one_map(
            index, shown.field, field
        ):  # the front end made that map itself: nothing to send
            self._replace_field(field, output, followed)
        else:
            self._take(field, output, followed)
            self.editor_map = index
            self.editor = editor
        self._fallback.update()

    def set_transfer(self, transfer: TransferFunction | PresetName) -> None:
        with self._lock:  # or the voxels get other levels meanwhile, and this would be a table for those of before
            made = self.source.set_transfer(transfer)
            if made is None:
                return
            function, table = made
            with self.hold_sync():
                self.unit = function.unit
                self.table = table
        self._fallback.set_transfer(function)
        self._colours_changed()

    def close(self) -> None:
        """Leave the front ends, and end what draws for those that cannot."""
        if self._sharpener is not None:
            self._sharpener.cancel()
        self.fields.pacer.close()
        self._fallback.close()
        super().close()

    # -- an animation --------------------------------------------------------------------------------------------------

    def play(self, maps: TimeMaps, player: Any, *, output: Grid | None = None) -> None:
        """Show the moments of an animation as a player in the same client goes through them.

        Parameters
        ----------
        maps : of :meth:`~deformnb.document.animation.Animation.stack`.
        player : a :class:`~deformnb.widgets.Player`.
        output : its box is what can be seen; default is the volume's own.

        Notes
        -----
        All frames are sent once; then nothing is, however often they are played. Showing anything else ends it. An
        editor that the view follows is followed on: a drag is seen immediately, also during a moment.
        """
        self.fields.replace(ShownField(output=output, moments=maps))
        self.player = player
        self.fields.offer()
        self._fallback.update()

    @property
    def moments(self) -> TimeMaps | None:
        """Moments that a player goes through now, if any."""
        return self.fields.shown.moments

    def is_moved_in_client(self, sender: str) -> bool:
        is_moved = self.fields.moves_points and self._front_ends.has_window_of(sender)
        return is_moved and not self._fallback.is_running

    def _render_state(self) -> RenderedState | None:
        """State that Python draws for front ends that cannot."""
        with self._lock:
            volume, transfer, shown = self.source.volume, self.source.transfer, self.fields.shown
            if volume is None or transfer is None:
                return None
            is_followed = shown.followed is not None and shown.moments is None and self.editor is not None
            return RenderedState(
                volume,
                transfer,
                shown.at(self.player),
                shown.output,
                {name: getattr(self, name) for name in SHARED},
                (self.editor, shown.followed["index"]) if is_followed and shown.followed else None,
                None if shown.moments is None else self.player,
            )

    # -- from the front ends -------------------------------------------------------------------------------------------

    def set_state(self, sync_data: Any) -> None:
        """Take the trait values that the front end sends, as far as they are right."""
        take_traits(sync_data, OF_PAGE, super().set_state)

    def take_message(self, message: LiveMessage, buffers: Any = ()) -> None:
        if isinstance(message, Screenshot):
            self._screenshots.receive(message, buffers[0])
        elif isinstance(message, MoviePiece):
            self._movies.receive(message, buffers[0])
        else:
            self._answers[type(message)](message)

    def _hello(self, message: LiveHello) -> None:
        self._front_ends.take_theme(message.background)
        if message.largest == 0:
            self.source.finish_upload()
            return  # it cannot draw, and will request a server renderer
        self._front_ends.add(message.view, has_card=not message.software)
        view: str | None = message.view
        with self._lock:
            if self.source.restrict(message.largest, message.voxels):
                self.repack(is_too_large=True)
                view = None  # for all front ends: they have a finer volume
        self.fields.answer(view)

    def _still(self, message: StillRequest) -> None:
        self._front_ends.take_theme(message.background)
        self._fallback.start(message)

    def _close_front_end(self, message: Closed) -> None:
        self._front_ends.drop(message.view)
        self._movies.drop(message.view)

    # -- pictures ------------------------------------------------------------------------------------------------------

    def _shade(self) -> str:
        return self._front_ends.theme if self.background == "auto" else self.background

    def snapshot(self) -> Snapshot:
        """The present content of the view, for pictures of it and for a web page without Python.

        Raises
        ------
        DeformError
            If the view shows no volume yet.
        """
        with self._lock:
            packed, volume, transfer, shown = (
                self.source.ready(),
                self.source.volume,
                self.source.transfer,
                self.fields.shown,
            )
        assert volume is not None
        assert transfer is not None
        scene = SceneDescription(
            packed,
            shown.at(self.player),
            shown.output,
            self.camera,
            transfer,
            self.projection,
            self._shade(),
            self.shows,
            self.clip,
            self.ambient_occlusion,
            self.frame,
        )
        return Snapshot(volume, scene, shown.field, self.fields.map_size, self.fields.space_size)

    def still(self, size: tuple[int, int] | None = None) -> Image:
        return render_scene(self.snapshot().scene, size or (self.width, self.height))

    async def screenshot(self, timeout: float = 10.0) -> Image:
        """The picture that is on the screen now, (height, width, 3); without a front end the one of :meth:`still`.

        Parameters
        ----------
        timeout : seconds to wait for the front end. Where a front end delivers messages only between cells, nothing
            comes while this is awaited, and the still is returned.
        """
        png = await self._screenshots.request(timeout)
        return self.still() if png is None else from_png(png)

    def has_client(self, *, by_card: bool = False) -> bool:
        """Check whether a client shows this view and draws it itself; ``by_card``: by a graphics card."""
        return self._front_ends.newest_renderer(by_card=by_card) is not None

    def page_scene(
        self, volume: VolumeLike, transfer: TransferFunction, size: tuple[int, int], seen: DisplaySettings
    ) -> PageScene:
        """A renderer of exports whose pictures a client of this view draws, as its screenshots are.

        Parameters
        ----------
        volume, transfer : those of the client; it takes no others.
        size : (width, height) in pixels.
        seen : how it is shown.

        Raises
        ------
        PageGoneError
            If no client shows this view.
        """
        page = self._front_ends.newest_renderer(by_card=False)
        if page is None:
            raise PageGoneError("no page shows the view")
        self.source.ready()
        return self._movies.start(PageScene(self._outbox.post, page, size, seen, self.fields.textures))

    def preview_png(self) -> bytes:
        """A small picture as a PNG, from coarser voxels and cached: the still where no front end runs."""
        scene = self.snapshot().scene
        if self._preview is None or self._preview[0] != scene:
            self._preview = (scene, preview_png(scene))
        return self._preview[1]

    def _repr_mimebundle_(self, **options: Any) -> Any:
        bundle = super()._repr_mimebundle_(**options)
        return bundle if self.source.voxels is None else with_png(bundle, self.preview_png)

    def stats(self) -> dict[str, Any]:
        """Last measurements of the front end, and counts of sent data.

        ``drag_ms`` (median of quick pictures), ``scale`` (their share of the full width), ``full_ms``, ``passes``,
        ``frames``, ``width``, ``height``, ``edits``, ``edit_ms`` (fit in the front end), ``received`` (bytes); of
        Python ``volume_bytes``, ``field_bytes``, ``messages``, ``resolution`` and ``factors`` along x, y, z; and
        ``server_renderer``: measurements where Python draws for a front end that cannot.
        """
        shown = self.source.voxels
        sent = {
            "volume_bytes": self.source.sent_bytes,
            "field_bytes": self.fields.sent_bytes,
            "messages": self._outbox.count,
        }
        own = {"resolution": shown.volume.shape[::-1], "factors": shown.factors} if shown else {}
        drawn = {"server_renderer": self._fallback.stats()} if self._fallback.is_running else {}
        return {**self._front_ends.stats, **sent, **own, **drawn}

"""Live view: a volume rendered by WebGL in the browser, rotated and deformed without sending it again.

The front end gets the voxels once, in packed pieces that it requests, and then displacements only: it warps at every
sample of a ray, as the paper does on its GPU. A live view can also play the moments of an animation by
itself.

Messages of the front end (each with ``view``, the front end's own name): ``hello`` (largest texture, voxels if the GPU
has been found to hold no more, renderer, background: that of the page around), ``chunk`` (id, index: requests a piece),
``seen`` (seq: that field is being drawn), ``follows`` (sender: of the edits of points in space in its window, which it
fits itself while they move), ``screenshot`` (id, with a PNG), ``stats``, ``bye``, ``still`` and
``drawn`` (see :mod:`~deformnb.widgets.view.fallback`), ``movie_piece`` and ``movie_failed`` (see
:mod:`~deformnb.widgets.view.page_scene`). Messages to the front end: ``chunk`` (id, index, start, with gzip),
``field`` (see :mod:`~deformnb.widgets.textures`; seq: to be confirmed unless 0; follow: the index of the map that an
editor moves, and points, cuts and parts that the maps are of, or null; moved: the points in space whose fit it is, and
the shape of the lattice for it while they move, or null), ``screenshot`` (id: requests one), and
``drawn``. Messages of the front end are checked and dropped if they are wrong.
"""

from __future__ import annotations

import asyncio
import itertools
import logging
import threading
import weakref
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import ipywidgets
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from deformnb._typing import Image
from deformnb._weak import weakly
from deformnb.document.animation import TimeMaps
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField
from deformnb.session.exports import Seen
from deformnb.volume.transfer import TransferFunction, as_transfer
from deformnb.volume.volume import Grid, Volume, VolumeLike, as_volume
from deformnb.widgets.bundle import bundle
from deformnb.widgets.camera import CameraTrait, ClipTrait, ShowsTrait, turned
from deformnb.widgets.cell_widgets import close_earlier_of_this_cell
from deformnb.widgets.edit_messages import measured, picture, points_to_json, take_traits, text, whole
from deformnb.widgets.messages import Chunk, DrawnByPython, FieldMaps, ScreenshotRequest
from deformnb.widgets.packed_volume import (
    PackedVolume,
    Pieces,
    fine_window,
    is_fine_enough,
    packed_volume,
    whole_window,
)
from deformnb.widgets.synced import SyncedWidget
from deformnb.widgets.textures import (
    FieldTextures,
    count_maps,
    differ_only_in,
    field_textures,
    nodes_along,
    texture_frames,
)
from deformnb.widgets.view.base import AbstractView, ViewMeta, check_map, state_followed
from deformnb.widgets.view.page_scene import PageGoneError, PageScene
from deformnb.widgets.view.space_points import QUICK_SIZE, ShowsPoints, plain_fit
from deformnb.widgets.view.stills import SceneDescription, from_png, preview_png, render_scene, with_png
from deformnb.widgets.view.transport import Pacer

if TYPE_CHECKING:
    from deformnb.widgets.view.fallback import ServerRenderer

_LOG = logging.getLogger(__name__)

_ANY = 2**53  # a number of voxels that no GPU limits

OF_PAGE = frozenset(
    {"camera", "clip", "shows", "projection", "background", "width", "height", "target_ms", "settle_ms"}
)
"""Traits that a front end may change: the camera by the pointer, the others by links of widgets in the front end."""


_WINDOWS = 16  # front ends whose windows are known

_REST = 0.6  # seconds without another colour, after which the voxels may be sent in other levels


class LiveView(ShowsPoints, AbstractView, SyncedWidget, metaclass=ViewMeta):
    """A volume in the browser, turned and deformed there.

    Parameters
    ----------
    volume : shown at once if given.
    transfer : a transfer function or the name of a preset.
    projection : "shaded", "composite" or "mip".
    background : "auto" follows the page, "dark" and "light" do not.
    shows : a name of :data:`~deformnb.widgets.camera.SHOWS`, such as "original" or "side_by_side".
    camera : direction, up, zoom, pan and perspective, as in :class:`~deformnb.widgets.camera.CameraTrait`. The front
        end writes it when the pointer is released; ``traitlets.link((a, "camera"), (b, "camera"))`` turns two views
        together.
    clip : the part of the box that is seen, three pairs of shares; see :meth:`set_clip`.
    limit : voxels sent to the front end at most; a larger volume is averaged, which the view reports.
    width, height : size on the page in CSS pixels; a narrow page makes it smaller.
    fill : True takes the size of the box it stands in instead.
    map_size : samples of a displacement map along its longer side.
    space_size : samples along the longest side of a displacement that is no extrusion.
    show_folds : whether tissue is red and striped where the map folds; it costs nothing where nothing does.
    ambient_occlusion : whether hollows and what lies deep inside are darker in the projection "shaded"; see
        :func:`~deformnb.imaging.occlusion.ambient_light`.
    target_ms : time that a picture may take while something moves; its resolution adapts.
    settle_ms : rest after which the full picture is drawn; after a drag it is drawn at once.

    Attributes
    ----------
    editor, editor_map : the editor that is followed, and which map of the deformation it moves.
    player : whose moment of an animation is seen, while :attr:`moments` is something.

    Notes
    -----
    Neither voxels nor maps are traits: a saved notebook holds a few kB of this widget.

    Examples
    --------
    >>> from deformnb.volume.volume import Volume
    >>> view = LiveView(Volume.from_array(np.eye(8, dtype=np.uint8)[None] * np.ones((8, 1, 1), np.uint8)))
    >>> view.volume_info["shape"]
    [8, 8, 8]
    >>> view.still((64, 48)).shape
    (48, 64, 3)
    """

    _esm = bundle("live_view.js")
    _css = bundle("live_view.css")

    volume_info = traitlets.Dict().tag(sync=True)
    table = traitlets.Bytes().tag(sync=True)
    unit = traitlets.Float(1.0).tag(sync=True)
    projection = traitlets.Enum(["shaded", "composite", "mip"], "shaded").tag(sync=True)
    background = traitlets.Enum(["auto", "dark", "light"], "auto").tag(sync=True)
    shows = ShowsTrait().tag(sync=True)
    camera = CameraTrait().tag(sync=True)
    clip = ClipTrait().tag(sync=True)
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
        transfer: TransferFunction | str = "specimen",
        limit: int = 256**3,
        map_size: int = 192,
        space_size: int = 64,
        **traits: Any,
    ) -> None:
        self._lock = threading.RLock()  # callbacks run in another thread than cells
        self._volume: Volume | None = None
        self._window: tuple[float, float] | None = None
        self._pieces: Pieces | None = None
        self._field: AbstractField | None = None
        self._output: Grid | None = None
        self._followed: dict[str, Any] | None = None
        self._moments: TimeMaps | None = None
        self._maps: FieldTextures | None = None  # of the field, made when a front end requests them
        self._server_renderer: ServerRenderer | None = None  # draws for the front ends that cannot
        self._largest = 2048  # along an axis of a texture, until a front end reports less
        self._sent_cut: str | None = None  # whose distances all front ends have
        self._pacer = Pacer(self._send_field)
        self._has_front_end = False
        self._drawing: dict[str, bool] = {}  # front ends that draw, each with whether by a graphics card
        self._senders: dict[str, str] = {}  # of the edits of points in space in the windows of front ends
        self._moved: dict[str, Any] | None = None  # the points of which front ends make the field while they move
        self._movie: weakref.ref[PageScene] | None = None  # that one of them draws
        self._front_end_theme = "dark"
        self._waiting: dict[int, Callable[[bytes], None]] = {}
        self._when_sent: Callable[[], None] | None = None
        self._numbers = itertools.count(1)
        self._front_end_stats: dict[str, float] = {}
        self._sent = {"volume_bytes": 0, "field_bytes": 0, "messages": 0}
        self._limit, self._map_size, self._space_size = int(limit), int(map_size), int(space_size)
        self._preview: tuple[SceneDescription, bytes] | None = None
        self._sharpener: threading.Timer | None = None
        self._transfer: TransferFunction | None = None
        self._wanted_transfer = transfer
        super().__init__(**traits)
        self.on_msg(self._receive)
        if volume is not None:
            self.show(volume)
        close_earlier_of_this_cell(self)

    # -- what is shown -------------------------------------------------------------------------------------------------

    def show(self, volume: VolumeLike, *, window: tuple[float, float] | None = None) -> None:
        """Show another volume, without deformation, from the same side.

        Parameters
        ----------
        window : values that are resolved; default is the whole range for bytes, and up to the densest tissue (all
            but the brightest 1 in 10 000) for other types. Where colours and opacities change within a quarter of
            that, only this part is resolved, more finely: the voxels are then sent again, which the view reports.
        """
        self._put(as_volume(volume), window, None, None, None)
        self._offer()
        self._update_server_renderer()

    def _put(
        self,
        volume: Volume,
        window: tuple[float, float] | None,
        field: AbstractField | None,
        output: Grid | None,
        followed: dict[str, Any] | None,
    ) -> None:
        with self._lock:  # throughout: of two that are shown at once, one is shown whole
            function = as_transfer(self._wanted_transfer, volume)
            narrow = self._fine(function, volume) if window is None else None
            shown = packed_volume(volume, self._limit, self._largest, narrow or window)
            if narrow is not None:
                low, high = whole_window(volume)
                shown = replace(shown, share=(narrow[1] - narrow[0]) / (high - low))
            self._volume, self._window, self._pieces = volume, window, Pieces(shown)
            self._hold(field, output, followed)
            self.label = f"Volume {volume.name}".strip()
            self.volume_info = shown.info()  # before the colours: clients keep the old ones until the voxels have come
            self.set_transfer(self._wanted_transfer)

    def _fine(self, function: TransferFunction, volume: Volume) -> tuple[float, float] | None:
        """The window of values that bytes shall resolve, if not all; a maximum projection shows all."""
        return None if self.projection == "mip" else fine_window(function, volume, whole_window(volume))

    @traitlets.observe("projection")
    def _colours_changed(self, _change: Any = None) -> None:
        """Once nothing has changed for a while, send the voxels in finer levels if the colours need them."""
        timer, self._sharpener = self._sharpener, None
        if timer is not None:
            timer.cancel()
        if self._needs_other_levels():
            self._sharpener = threading.Timer(_REST, weakly(self, LiveView._sharpen))
            self._sharpener.daemon = True
            self._sharpener.start()

    def _needs_other_levels(self) -> bool:
        volume, shown, function = self._volume, self._shown, self._transfer
        if volume is None or shown is None or function is None or self._window is not None:
            return False
        whole = whole_window(volume)
        if self.projection == "mip":
            return shown.window != whole
        return not is_fine_enough(function, volume, shown.window, whole)

    def _sharpen(self) -> None:
        with self._lock:
            if self._volume is not None and self._needs_other_levels():
                self._put_again()

    @property
    def _shown(self) -> PackedVolume | None:
        pieces = self._pieces
        return None if pieces is None else pieces.shown

    @property
    def shown_output(self) -> Grid | None:
        return self._output

    def _ready(self) -> PackedVolume:
        shown = self._shown
        if shown is None:
            raise DeformError("the view shows no volume yet; call show(volume) first.")
        return shown

    def show_deformation(self, deformation: Deformation | AbstractField | None, *, output: Grid | None = None) -> None:
        self._take(deformation, output, None)
        self._update_server_renderer()

    def _take(
        self, deformation: Deformation | AbstractField | None, output: Grid | None, followed: dict[str, Any] | None
    ) -> None:
        shown = self._ready()
        grid = shown.original if output is None else output
        field = deformation.field(grid) if isinstance(deformation, Deformation) else deformation
        if field is not None and field.dim != 3:
            raise DeformError("a volume needs a field in space; extrude the field of a plane first.")
        self._hold(field, output, followed)
        self._offer()

    def _hold(
        self,
        field: AbstractField | None,
        output: Grid | None,
        followed: dict[str, Any] | None,
        moments: TimeMaps | None = None,
    ) -> None:
        with self._lock:
            self._field, self._output, self._followed = field, output, followed
            self._maps, self._moments, self._moved = None, moments, None

    def follow(
        self, editor: Any, field: Extrusion | AbstractField, index: int = 0, *, output: Grid | None = None
    ) -> None:
        """As :meth:`AbstractView.follow`, in the same page: without a message to Python.

        To let the editor move another map, follow with the other index first and then give it that map's points.
        """
        if editor is not None or count_maps(field) is not None:
            check_map(field, index)
        followed = None if editor is None else state_followed(editor, index)
        goes_on = (
            followed is not None
            and self._moments is None
            and (editor, index, output) == (self.editor, self.editor_map, self._output)
        )
        if goes_on and differ_only_in(index, self._field, field):  # the front end made that map itself: nothing to send
            self._hold(field, output, followed)
        else:
            self._take(field, output, followed)
            self.editor_map = index
            self.editor = editor
        self._update_server_renderer()

    def set_transfer(self, transfer: TransferFunction | str) -> None:
        self._wanted_transfer = transfer
        if self._volume is None or self._shown is None:
            return
        with self._lock:  # or the voxels get other levels meanwhile, and this would be a table for those of before
            function = self._transfer = as_transfer(self._wanted_transfer, self._volume)
            table = function.table(*self._shown.window)  # alphas as they are: the front end fits them
            with self.hold_sync():
                self.unit = function.unit
                self.table = np.ascontiguousarray(table, "<f4").tobytes()
        if self._server_renderer is not None:
            self._server_renderer.set_transfer(function)
        self._colours_changed()

    def set_camera(
        self,
        direction: ArrayLike | None = None,
        up: ArrayLike | None = None,
        zoom: float | None = None,
        *,
        perspective: bool | None = None,
    ) -> None:
        self.camera = turned(self.camera, direction, up, zoom, perspective)

    def close(self) -> None:
        """Leave the front ends, and end what draws for those that cannot."""
        if self._sharpener is not None:
            self._sharpener.cancel()
        self._draw_no_more()
        super().close()

    def when_sent(self, function: Callable[[], None]) -> None:
        """Call a function once when a front end has been sent all voxels, or when Python draws for one.

        A thread that imports modules or compiles delays the pieces of the volume.
        """
        self._when_sent = function

    def _all_sent(self) -> None:
        function, self._when_sent = self._when_sent, None
        if function is not None:
            function()

    # -- an animation --------------------------------------------------------------------------------------------------

    def play(self, maps: TimeMaps, player: Any, *, output: Grid | None = None) -> None:
        """Show the moments of an animation as a player in the same page goes through them.

        Parameters
        ----------
        maps : of :meth:`~deformnb.document.animation.Animation.stack`.
        player : a :class:`~deformnb.widgets.Player`.
        output : its box is what can be seen; default is the volume's own.

        Notes
        -----
        All frames are sent once; then nothing is, however often they are played. Whatever else is shown ends it. An
        editor that the view follows is followed on: what is dragged is seen at once, also beside a moment.
        """
        self._hold(None, output, None, maps)
        self.player = player
        self._offer()
        self._update_server_renderer()

    @property
    def moments(self) -> TimeMaps | None:
        """Moments that a player goes through now, if any."""
        return self._moments

    def _at_present(self, field: AbstractField | None) -> AbstractField | None:
        """The current field: the moment of the player, if it plays something."""
        return field if self._moments is None else self._moments.field(self.player.time)

    # -- to the front ends ---------------------------------------------------------------------------------------------

    def _post(self, content: Mapping[str, Any], buffers: list[bytes]) -> None:
        self._sent["messages"] += 1
        self.send(content, buffers)

    def _offer(self) -> None:
        if self._has_front_end:  # a front end that comes later requests it
            self._pacer.offer()

    def _send_field(self, number: int, view: str | None = None) -> None:
        with self._lock:
            shown, followed = self._shown, self._followed
            if shown is None:
                return
            maps = self._maps = self._maps or self._made_maps(shown)
        cut = (maps.content["planar"] or {}).get("cut")
        if number and cut and cut["id"] == self._sent_cut:
            maps = maps.without("distances")
        elif view is None:
            self._sent_cut = cut and cut["id"]
        self._sent["field_bytes"] += maps.size
        message: FieldMaps = {
            "type": "field",
            "view": view,
            "seq": number,
            "follow": followed,
            "moved": self._moved,
            **maps.content,
        }
        self._post(message, maps.buffers)

    def _made_maps(self, shown: PackedVolume) -> FieldTextures:
        if self._moments is not None:
            return texture_frames(self._moments, shown, self._output, self._map_size)
        nodes = min(QUICK_SIZE, self._space_size) if self.is_quick else self._space_size
        made = field_textures(self._field, shown, self._output, self._map_size, nodes)
        points = None if self.is_quick else plain_fit(self._field, self.points_editor)
        if points is not None:
            lattice = made.content["space"]
            assert lattice is not None
            size = (np.asarray(lattice["shape"]) - 1) * lattice["spacing"]
            counts = nodes_along(size, min(QUICK_SIZE, self._space_size))
            self._moved = {"points": points_to_json(points), "shape": counts.tolist()}
        return made

    def is_moved_in_page(self, sender: str) -> bool:
        if self._server_renderer is not None or self._moved is None:
            return False
        return any(self._senders.get(view) == sender for view in self._drawing)

    def _update_server_renderer(self) -> None:
        """Let the server renderer, if there is one, draw what is shown now."""
        with self._lock:
            if self._server_renderer is None or self._volume is None:
                return
            moment = self._at_present(self._field)
            is_followed = self._followed is not None and self._moments is None and self.editor is not None
            followed = (self.editor, self._followed["index"]) if is_followed and self._followed else None
            self._server_renderer.show(self._volume, moment, self._output, followed)
            if self._moments is not None:
                self._server_renderer.observe_player(self.player, self._update_server_renderer)

    def _draw_here(self) -> ServerRenderer:
        """The server renderer for front ends that cannot draw; started if there is none."""
        from deformnb.widgets.view.fallback import ServerRenderer

        with self._lock:
            if self._server_renderer is None:
                self._server_renderer = ServerRenderer(
                    self,
                    self._post,
                    transfer=self._transfer or "specimen",
                    map_size=self._map_size,
                    space_size=self._space_size,
                )
                self._update_server_renderer()
            return self._server_renderer

    def _draw_no_more(self) -> None:
        with self._lock:
            renderer, self._server_renderer = self._server_renderer, None
        if renderer is not None:
            renderer.close()

    # -- from the front ends -------------------------------------------------------------------------------------------

    def set_state(self, sync_data: Any) -> None:
        """Take the trait values that the front end sends, as far as they are right."""
        take_traits(sync_data, OF_PAGE, super().set_state)

    def _receive(self, _: Any, content: Any, buffers: list[Any]) -> None:
        """Take a message of a front end: a wrong one is logged and dropped, never raised into the channel."""
        try:
            kind = content.get("type") if isinstance(content, dict) else None
            answer = _ANSWERS.get(kind) if isinstance(kind, str) else None
            if answer is None:
                raise ValueError("unknown kind")
            answer(self, text(content.get("view")), content, buffers or [])
        except (ValueError, TypeError, KeyError, DeformError) as error:
            _LOG.warning("a message of the front end was dropped: %s", error)

    def _hello(self, view: str | None, content: dict[str, Any], buffers: list[Any]) -> None:
        largest = whole(content.get("largest"), 0, 2**16)
        self._take_theme(content)
        if largest == 0:
            self._all_sent()
            return  # it cannot draw, and will request a server renderer
        self._has_front_end = True
        if view is not None:
            self._drawing.pop(view, None)
            self._drawing[view] = content.get("software") is False
        voxels = whole(content.get("voxels", _ANY), 1, _ANY)
        if (largest < self._largest or voxels < self._limit) and self._make_smaller(largest, voxels):
            view = None  # for all front ends: what they have is of a finer volume
        self._send_field(0, view)

    def _make_smaller(self, largest: int, voxels: int) -> bool:
        """Reduce the voxels for a GPU that holds no more along an axis, or in all; True if that was necessary."""
        with self._lock:
            self._largest, self._limit = min(largest, self._largest), min(voxels, self._limit)
            size = None if self._shown is None else self._shown.volume.grid
            if self._volume is None or size is None or (max(size.shape) <= largest and size.size <= voxels):
                return False
            self._put_again()
        return True

    def _put_again(self) -> None:
        """Show the same, with the voxels made ready anew."""
        assert self._volume is not None
        moments = self._moments
        self._put(self._volume, self._window, self._field, self._output, self._followed)
        self._moments = moments

    def _take_theme(self, content: dict[str, Any]) -> None:
        if content.get("background") in ("dark", "light"):
            self._front_end_theme = content["background"]

    def _seen(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        self._pacer.seen(whole(content.get("seq"), 1, 2**53))

    def _follows(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        self._senders.pop(view, None)
        self._senders = dict([*self._senders.items(), (view, text(content.get("sender")))][-_WINDOWS:])

    def _chunk(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        pieces = self._pieces  # taken once: a cell may show another volume meanwhile
        if pieces is None or content.get("id") != pieces.shown.id:
            return  # of a volume that was shown before: the front end will notice
        index = whole(content.get("index"), 0, pieces.shown.chunks - 1)
        start, packed = pieces[index]
        self._sent["volume_bytes"] += len(packed)
        self._post(Chunk(type="chunk", view=view, id=pieces.shown.id, index=index, start=start), [packed])
        if index == pieces.shown.chunks - 1:
            self._all_sent()

    def _still(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        self._take_theme(content)
        if self._volume is not None:
            self._post(DrawnByPython(type="drawn", view=view, info=self._draw_here().info), [])

    def _drawn(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        if self._volume is not None and not self._draw_here().receive(content.get("say")):
            self._draw_no_more()

    def _screenshot(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        deliver = self._waiting.get(whole(content.get("id"), 1, 2**53))
        if deliver is None:
            raise ValueError("a picture that nobody waits for")
        deliver(picture(buffers))

    def _bye(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        self._drawing.pop(view, None)
        self._senders.pop(view, None)
        movie = self._movie_under_way()
        if movie is not None and movie.front_end == view:
            movie.give_up("the page has been closed")

    def _movie_piece(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        movie = self._movie_under_way()
        if movie is None:
            raise ValueError("a piece of no movie")
        movie.receive(content, buffers)

    def _movie_failed(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        movie = self._movie_under_way()
        if movie is not None:
            movie.fail(content)

    def _movie_under_way(self) -> PageScene | None:
        return None if self._movie is None else self._movie()

    def _stats(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        self._front_end_stats = measured(content)

    # -- pictures ------------------------------------------------------------------------------------------------------

    def _shade(self) -> str:
        return self._front_end_theme if self.background == "auto" else self.background

    def _scene(self) -> SceneDescription:
        shown = self._ready()
        assert self._transfer is not None
        with self._lock:
            field, output = self._at_present(self._field), self._output
        background = self._shade()
        return SceneDescription(
            shown,
            field,
            output,
            self.camera,
            self._transfer,
            self.projection,
            background,
            self.shows,
            self.clip,
            self.ambient_occlusion,
        )

    def still(self, size: tuple[int, int] | None = None) -> Image:
        return render_scene(self._scene(), size or (self.width, self.height))

    async def screenshot(self, timeout: float = 10.0) -> Image:
        """The picture that is on the screen now, (height, width, 3); without a front end the one of :meth:`still`.

        Parameters
        ----------
        timeout : seconds to wait for the front end. Where a front end delivers messages only between cells, nothing
            comes while this is awaited, and the still is returned.
        """
        loop, number = asyncio.get_running_loop(), next(self._numbers)
        answer: asyncio.Future[bytes] = loop.create_future()

        def deliver(png: bytes) -> None:
            loop.call_soon_threadsafe(_settle, answer, png)

        self._waiting[number] = deliver
        try:
            self._post(ScreenshotRequest(type="screenshot", id=number), [])
            return from_png(await asyncio.wait_for(answer, timeout))
        except TimeoutError:
            return self.still()
        finally:
            self._waiting.pop(number, None)

    def has_page(self, *, by_card: bool = False) -> bool:
        """Check whether a page shows this view and draws it itself; ``by_card``: by a graphics card."""
        return self._page(by_card) is not None

    def _page(self, by_card: bool) -> str | None:
        """The newest page that draws, one with a graphics card first."""
        pages = sorted(self._drawing.items(), key=lambda item: item[1])
        return pages[-1][0] if pages and pages[-1][1] >= by_card else None

    def page_scene(
        self, volume: VolumeLike, transfer: TransferFunction, size: tuple[int, int], seen: Seen
    ) -> PageScene:
        """A renderer of exports whose pictures a page of this view draws, as its screenshots are.

        Parameters
        ----------
        volume, transfer : what the page shows; it takes no others.
        size : (width, height) in pixels.
        seen : how it is shown.

        Raises
        ------
        PageGoneError
            If no page shows this view.
        """
        page, shown = self._page(by_card=False), self._ready()
        if page is None:
            raise PageGoneError("no page shows the view")

        def maps(field: AbstractField | None, output: Grid | None) -> FieldTextures:
            return field_textures(field, shown, output, self._map_size, self._space_size)

        scene = PageScene(self._post, page, size, seen, maps)
        self._movie = weakref.ref(scene)
        return scene

    def preview_png(self) -> bytes:
        """A small picture as a PNG, from coarser voxels and kept: what is seen where no front end runs."""
        scene = self._scene()
        if self._preview is None or self._preview[0] != scene:
            self._preview = (scene, preview_png(scene))
        return self._preview[1]

    def _repr_mimebundle_(self, **options: Any) -> Any:
        bundle = super()._repr_mimebundle_(**options)
        return bundle if self._shown is None else with_png(bundle, self.preview_png)

    def stats(self) -> dict[str, Any]:
        """Last measurements of the front end, and counts of sent data.

        ``drag_ms`` (median of quick pictures), ``scale`` (their share of the full width), ``full_ms``, ``passes``,
        ``frames``, ``width``, ``height``, ``edits``, ``edit_ms`` (fit in the front end), ``received`` (bytes); of
        Python ``volume_bytes``, ``field_bytes``, ``messages``, ``resolution`` and ``factors`` along x, y, z; and
        ``server_renderer``: what was measured where Python draws for a front end that cannot.
        """
        shown = self._shown
        renderer = self._server_renderer
        drawn = {} if renderer is None else {"server_renderer": renderer.stats()}
        own = {"resolution": shown.volume.shape[::-1], "factors": shown.factors} if shown else {}
        return {**self._front_end_stats, **self._sent, **own, **drawn}


_ANSWERS: dict[str, Callable[[LiveView, str, dict[str, Any], list[Any]], None]] = {
    "hello": LiveView._hello,
    "chunk": LiveView._chunk,
    "still": LiveView._still,
    "drawn": LiveView._drawn,
    "seen": LiveView._seen,
    "follows": LiveView._follows,
    "screenshot": LiveView._screenshot,
    "stats": LiveView._stats,
    "bye": LiveView._bye,
    "movie_piece": LiveView._movie_piece,
    "movie_failed": LiveView._movie_failed,
}
"""Handlers of each kind of message."""


def _settle(answer: asyncio.Future[bytes], png: bytes) -> None:
    if not answer.done():
        answer.set_result(png)

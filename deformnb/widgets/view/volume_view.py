"""Volume view: a volume drawn by VTK in Python, for browsers that are weak and for features of VTK.

One thread makes the window and does every call of VTK. The front end gets pictures as JPEG and sends the viewer's
position; the newest of all changes is drawn, at most two pictures are in flight. The view records of each of its front
ends its size and whether it is dark. Folds can be painted red, with a message below the picture.

The messages are those of :data:`deformnb.widgets.messages.views.SERVED`.
"""

from __future__ import annotations

import asyncio
import threading
import time
import weakref
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, Literal, TypeAlias, TypeVar

import traitlets

from deformnb._packages import describe_missing
from deformnb._typing import Image
from deformnb.document.deformation import Deformation
from deformnb.errors import DeformError, MissingPackageError
from deformnb.imaging.picking import surface_point
from deformnb.rbf.extrusion import Extrusion
from deformnb.rbf.fields import AbstractField
from deformnb.volume.clip import Clip
from deformnb.volume.transfer import PRESETS, PresetName, TransferFunction, preset
from deformnb.volume.volume import Grid, Volume, VolumeLike, as_volume
from deformnb.widgets.bundle import bundle
from deformnb.widgets.camera import CameraTrait, ClipTrait, ShowsTrait, checked_camera
from deformnb.widgets.cell_widgets import close_earlier_of_this_cell, with_png
from deformnb.widgets.messages.record import Seen
from deformnb.widgets.messages.traits import take_traits
from deformnb.widgets.messages.views import (
    LARGEST_SIDE,
    SERVED,
    AbstractSize,
    CameraMoved,
    Closed,
    EditView,
    ServedHello,
    ServedMessage,
    SurfaceFound,
    SurfaceRequest,
)
from deformnb.widgets.packed_volume import PackedVolume
from deformnb.widgets.synced import SyncedWidget, ViewMeta
from deformnb.widgets.textures import MAP_SIZE
from deformnb.widgets.view.base import AbstractView, Following, Refit
from deformnb.widgets.view.picture_plane import ShowsPlane
from deformnb.widgets.view.picture_sender import PictureSender
from deformnb.widgets.view.scene_host import SceneContent, SceneHost
from deformnb.widgets.view.space_points import ShowsPoints
from deformnb.widgets.view.stills import VIEW_METHODS, ViewMethodName, make_scene
from deformnb.widgets.view.transport import draw_still, preview_png
from deformnb.widgets.vtk.render_loop import SceneLoop

_MOST = 8  # of one view; an older one has been closed without a word


class FrontEnds:
    """Sizes by name of a front end; may be used by several threads.

    Examples
    --------
    >>> front_ends = FrontEnds()
    >>> front_ends.put("a", (300, 200))
    >>> front_ends.size((720, 540)), front_ends.theme, bool(front_ends)
    ((300, 200), 'dark', True)
    """

    def __init__(self) -> None:
        self.theme = "dark"
        self._lock = threading.Lock()
        self._sizes: dict[str, tuple[int, int]] = {}

    def __bool__(self) -> bool:
        return bool(self._sizes)

    def put(self, name: str, size: tuple[int, int]) -> None:
        """Store a front end's width and height in pixels."""
        with self._lock:
            self._sizes.pop(name, None)
            self._sizes[name] = size
            while len(self._sizes) > _MOST:
                del self._sizes[next(iter(self._sizes))]

    def drop(self, name: str) -> None:
        """A front end is closed."""
        with self._lock:
            self._sizes.pop(name, None)

    def size(self, default: tuple[int, int]) -> tuple[int, int]:
        """The largest size of the front ends."""
        with self._lock:
            return max(self._sizes.values(), key=lambda s: s[0] * s[1], default=default)


def about(volume: Volume, output: Grid | None) -> dict[str, Any]:
    """Facts that a front end needs to turn a camera around a volume: its axes, its sides and the visible box."""
    shown = PackedVolume(volume, volume.grid, (0.0, 1.0), (1, 1, 1), "", 0, 1.0)
    info = shown.info()
    names = ("axes", "views", "origin", "spacing", "to_frame", "unit", "anatomical")
    return {**{name: info[name] for name in names}, "box": shown.box(output), "own": shown.box()}


def surface_reply(
    content: SceneContent, request: SurfaceRequest, transfer: TransferFunction | PresetName, method: Any, clip: Clip
) -> SurfaceFound:
    """The place where a ray meets what a view shows, for a front end that has no voxels."""
    place = surface_point(
        content.volume,
        (request.start, request.ray),
        transfer,
        field=content.field(),
        method=method,
        clip=clip,
        output=content.output,
    )
    return SurfaceFound(view=request.view, id=request.id, place=None if place is None else place.tolist())


_OF_PAGE = frozenset({"camera", "clip", "shows", "projection", "background", "width", "height", "plane_frame"})


def _trame_frames(view: VolumeView) -> Any:
    from deformnb.widgets.web.frames import TrameFrames

    return TrameFrames(view)


TransportName: TypeAlias = Literal["comm", "trame"]
"""Names of the ways in which pictures reach the page."""

TRANSPORTS: dict[str, Callable[[VolumeView], Any] | None] = {"comm": None, "trame": _trame_frames}
"""Transports of pictures to a front end, by name: None for the notebook's own channel, or the maker of another."""


def check_transport(name: str) -> None:
    """Refuse a transport that is unknown or not installed."""
    if name not in TRANSPORTS:
        raise DeformError(f"unknown transport {name!r}; choose one of {', '.join(TRANSPORTS)}.")
    if name == "trame" and find_spec("trame_rca") is None:
        raise MissingPackageError(f'{describe_missing("trame_rca")}; or use transport="comm"')


_Result = TypeVar("_Result")

_LOOK_EVERY = 0.02  # seconds between checks whether the full picture has come


class VolumeView(ShowsPoints, ShowsPlane, AbstractView, SyncedWidget, metaclass=ViewMeta):
    """A volume drawn by VTK in Python and shown as pictures.

    Parameters
    ----------
    volume : shown first, if given.
    transfer : a transfer function or the name of a preset.
    projection : "shaded", "composite" or "mip".
    background : "dark", "light" or "auto", which is the front end's.
    shows : a name of :data:`~deformnb.widgets.camera.SHOWS`.
    clip : the part of the box that is seen, three pairs of shares; see :meth:`set_clip`.
    frame : the part of the box that the camera frames at zoom 1, as in a live view.
    width, height : size in CSS pixels; a narrow window makes it smaller.
    fill : True takes the size of the box around it instead.
    transport : how pictures reach the front end: "comm" is the notebook's own channel, "trame" a server of this process
        with trame's remote view in a frame, which only a browser on this machine reaches.
    target_ms : time that a picture may take while something moves; its resolution adapts.
    settle_ms : rest after which the full picture is drawn.
    show_folds : whether tissue is red and striped where the map folds; it costs nothing where nothing does.
    method : "texture" deforms in VTK's shader, "array" warps the voxels, "core" draws without VTK; "auto" takes the
        first that works.
    map_size, space_size : samples of displacements, as for :class:`~deformnb.widgets.LiveView`.

    Attributes
    ----------
    scene : the drawn one, and its thread.
    pictures : their sender; ``pictures.badge`` is the message that the map folds, or empty.

    Notes
    -----
    The window of VTK is made when a front end or a still requests a picture, and given back when the last front end has
    gone, or some time after the last still. A cell of a notebook that runs again closes the views of its earlier runs.
    :meth:`call` reaches the ``pyvista.Plotter`` itself: anything that VTK draws can be added to the scene.

    Where VTK cannot draw off screen, the package draws the pictures itself, which the front end reports.

    Examples
    --------
    >>> from deformnb.volume.volume import Volume
    >>> view = VolumeView(Volume.from_array([[[0, 9], [9, 0]], [[9, 9], [0, 0]]]), method="core")
    >>> view.still((64, 48)).shape
    (48, 64, 3)
    >>> view.close()

    Axes and a mesh next to the volume, where VTK works::

        view.call(lambda plotter: plotter.show_bounds(color="gray", font_size=10, use_3d_text=False))
        view.call(lambda plotter: plotter.add_mesh(mesh, color="red", opacity=0.5))
    """

    _esm = bundle("volume_view.js")
    _css = bundle("volume_view.css")
    channel = SERVED
    draws_by_vtk = True

    _path = ""
    volume_info = traitlets.Dict().tag(sync=True)
    projection = traitlets.Enum(["shaded", "composite", "mip"], "shaded").tag(sync=True)
    background = traitlets.Enum(["auto", "dark", "light"], "auto").tag(sync=True)
    shows = ShowsTrait().tag(sync=True)
    camera = CameraTrait().tag(sync=True)
    clip = ClipTrait().tag(sync=True)
    frame = ClipTrait().tag(sync=True)
    width = traitlets.Int(720, min=64, max=LARGEST_SIDE).tag(sync=True)
    height = traitlets.Int(540, min=64, max=LARGEST_SIDE).tag(sync=True)
    fill = traitlets.Bool(False).tag(sync=True)
    label = traitlets.Unicode("Volume").tag(sync=True)
    show_folds = traitlets.Bool(True).tag(sync=True)
    transport = traitlets.Enum([*TRANSPORTS], "comm", read_only=True).tag(sync=True)
    target_ms = traitlets.Float(160.0, min=5.0, max=5000.0)
    settle_ms = traitlets.Float(250.0, min=0.0, max=60000.0)

    def __init__(
        self,
        volume: VolumeLike | None = None,
        *,
        transfer: TransferFunction | PresetName = "specimen",
        method: ViewMethodName = "auto",
        map_size: int = MAP_SIZE,
        space_size: int = 64,
        transport: TransportName = "comm",
        **traits: Any,
    ) -> None:
        self._method, self._transfer = method, transfer
        self._sampling: dict[str, Any] = {"map_size": int(map_size), "space_size": int(space_size)}
        self._has_guests = False  # whether a user has added objects to the scene, which exist only there
        self._following: Following | None = None
        self._front_ends = FrontEnds()
        self.pictures = PictureSender(self.post)
        self.scene = SceneHost(self._start, self._front_ends.__bool__)
        super().__init__(**traits)
        check_transport(transport)
        self.set_trait("transport", transport)
        if method not in VIEW_METHODS:
            raise DeformError(f"unknown method {method!r}; choose one of {', '.join(VIEW_METHODS)}.")
        self.observe(
            self._changed,
            ["camera", "clip", "frame", "shows", "projection", "background", "show_folds", "target_ms", "settle_ms"],
        )
        if volume is not None:
            self.show(volume)
        close_earlier_of_this_cell(self)

    # -- display -------------------------------------------------------------------------------------------------------

    def show(self, volume: VolumeLike) -> None:
        volume = as_volume(volume)
        _check(self._transfer, volume)
        self._stop_following()
        self._put(SceneContent(volume))
        self.label = f"Volume {volume.name}".strip()

    def _put(self, content: SceneContent) -> None:
        self.scene.content = content
        self.volume_info = about(content.volume, content.output)
        self.scene.change("content", self._set_content)

    def show_deformation(self, deformation: Deformation | AbstractField | None, *, output: Grid | None = None) -> None:
        volume = self.scene.ready().volume
        grid = output or volume.grid
        field = deformation.field(grid) if isinstance(deformation, Deformation) else deformation
        if field is not None and field.dim != 3:
            raise DeformError("a volume needs a field in space; extrude the field of a plane first.")
        self._stop_following()
        self._put(SceneContent(volume, lambda: field, output))

    def follow(
        self, editor: Any, field: Extrusion | AbstractField, index: int = 0, *, output: Grid | None = None
    ) -> None:
        """As :meth:`AbstractView.follow`: the points of the editor come to Python with every movement."""
        following = self._following
        if following is not None and following.continues_map(editor, index):
            self._put(SceneContent(self.scene.ready().volume, following.show(field), output))
            return
        refit = Refit(field, index) if editor is not None else None
        self.show_deformation(field, output=output)
        if refit is not None:
            self._following = Following(editor, refit, self._put_field)

    def _stop_following(self) -> None:
        following, self._following = self._following, None
        if following is not None:
            following.close()

    @property
    def output_grid(self) -> Grid | None:
        content = self.scene.content
        return None if content is None else content.output

    def _put_field(self, field: Callable[[], AbstractField | None]) -> None:
        self.scene.put_field(field)
        self.scene.change("content", self._set_content)

    def set_transfer(self, transfer: TransferFunction | PresetName) -> None:
        content = self.scene.content
        _check(transfer, None if content is None else content.volume)
        self._transfer = transfer
        self.scene.change("transfer", lambda scene: scene.set_transfer(transfer))

    # -- the scene and its thread --------------------------------------------------------------------------------------

    def call(self, function: Callable[[Any], _Result]) -> _Result:
        """Call ``function(plotter)`` in the thread that renders and return its result; the picture is drawn again.

        Parameters
        ----------
        function : gets the ``pyvista.Plotter``. It may add meshes, axes and clipping planes; the camera is the view's.

        Raises
        ------
        DeformError
            Where VTK cannot draw; ``function`` may raise others.
        """
        self._has_guests = True  # from now on the scene stays, also while no front end shows it
        result = self.scene.do(lambda scene: function(scene.plotter))
        if self._front_ends:
            self.scene.touch()
        return result

    def _start(self) -> SceneLoop:
        held = weakref.ref(self)  # the thread keeps no view alive
        loop = SceneLoop(
            self._make,
            lambda frame: self.pictures.deliver(frame, self.shows),
            self.pictures.show_notice,
            ready=lambda: self.pictures.frames.may_send,
            target_ms=self.target_ms,
            settle_ms=self.settle_ms,
            is_needed=lambda: (view := held()) is not None and view.is_watched,
        )
        loop.set_shows(self.shows)
        return loop

    @property
    def is_watched(self) -> bool:
        """True while a front end shows the scene, or someone has put things into it."""
        return bool(self._front_ends) or self._has_guests

    def _make(self) -> Any:
        size, background = self._frame()
        looks: dict[str, Any] = {"transfer": self._transfer, "projection": self.projection, "background": background}
        scene, notice = make_scene(self.scene.ready().volume, size, self._method, **looks, **self._sampling)
        try:
            if notice:
                self.pictures.show_notice(notice)
            self._path = scene.path
            scene.set_camera(self.camera)
            scene.set_clip(self.clip)
            scene.set_frame(self.frame)
            self._set_content(scene)
        except BaseException:
            scene.close()  # there is no other reference to it, and a window of VTK's holds the graphics memory
            raise
        return scene

    def _set_content(self, scene: Any) -> None:
        self.scene.ready().apply_to(scene)
        self._show_fold_badge(scene)

    def _show_fold_badge(self, scene: Any) -> None:
        """In the thread that renders, whenever something else is shown."""
        scene.folding.show = self.show_folds
        self.pictures.show_badge("" if self.shows == "original" else scene.folding.remark)

    def _changed(self, change: Any) -> None:
        """Apply the new value of a trait to the scene."""
        name, value, loop = change["name"], change["new"], self.scene.loop
        if name == "camera":
            self.scene.change("camera", lambda scene: scene.set_camera(value))
        elif name == "clip":
            self.scene.change("clip", lambda scene: scene.set_clip(value))
        elif name == "frame":
            self.scene.change("frame", lambda scene: scene.set_frame(value))
        elif name == "projection":
            self.scene.change("projection", lambda scene: scene.set_projection(value))
        elif name == "background":
            self._change_size()
        elif name == "show_folds":
            self.scene.change("folds", self._show_fold_badge)
        elif loop is not None and name == "shows":
            loop.set_shows(value)
            self.scene.change("shows", lambda scene: scene.set_shows(value))
            self.scene.change("folds", self._show_fold_badge)
        elif loop is not None:
            setattr(loop if name == "settle_ms" else loop.pace, name, value)

    def close(self) -> None:
        """End the thread that renders, give back its window, and leave the front ends."""
        self._stop_following()
        self.pictures.close()
        self.scene.close()
        super().close()

    # -- from the front ends -------------------------------------------------------------------------------------------

    def set_state(self, sync_data: Any) -> None:
        """Take the trait values that the front end sends, as far as they are right."""
        take_traits(sync_data, _OF_PAGE, super().set_state)

    def take_message(self, message: ServedMessage, buffers: Any = ()) -> None:
        if isinstance(message, AbstractSize):
            self._resize(message)
        elif isinstance(message, CameraMoved):
            self._turn(message)
        elif isinstance(message, EditView):
            self.edit_view(message)
        elif isinstance(message, Seen):
            if self.pictures.frames.confirm(message.seq, message.view):
                self.scene.touch()
        elif isinstance(message, SurfaceRequest):
            self.post(surface_reply(self.scene.ready(), message, self._transfer, self.projection, self.clip))
        else:
            self._front_end_closed(message)

    def _resize(self, message: AbstractSize) -> None:
        self._front_ends.put(message.view, (message.width, message.height))
        self._front_ends.theme = message.background or self._front_ends.theme
        make = TRANSPORTS[self.transport]
        if isinstance(message, ServedHello) and make is not None:
            self.pictures.open_carrier(lambda: make(self), message.view, message.origin or None)
        self._change_size()
        if isinstance(message, ServedHello):
            self.pictures.greet()

    def draw_again(self) -> None:
        """A front end has come that was not there when the last picture was sent: none is in flight to it."""
        self.pictures.frames.forget_frames()
        if self._front_ends:
            self.scene.touch()

    def _front_end_closed(self, message: Closed) -> None:
        self._front_ends.drop(message.view)
        if self.pictures.frames.remove_view(message.view):
            self.scene.touch()
        if not self.is_watched:
            self.scene.rest()
            self.pictures.frames.forget()

    def _turn(self, message: CameraMoved) -> None:
        camera = checked_camera(message.camera.value())

        def turn(scene: Any) -> None:
            scene.set_camera(camera)
            self.pictures.shown_camera = (message.view, message.number)

        self.scene.change("camera", turn)

    # -- inputs of the pictures ----------------------------------------------------------------------------------------

    def _frame(self) -> tuple[tuple[int, int], str]:
        """The largest size of the front ends, or that of the traits, and the background."""
        background = self._front_ends.theme if self.background == "auto" else str(self.background)
        return self._front_ends.size((self.width, self.height)), background

    def _change_size(self) -> None:
        size, background = self._frame()

        def resize(scene: Any) -> None:
            scene.set_size(size)
            scene.set_background(background)

        self.scene.change("size", resize)

    # -- pictures ------------------------------------------------------------------------------------------------------

    def still(self, size: tuple[int, int] | None = None) -> Image:
        """The picture in full, (height, width, 3), rendered as the view renders; needs no front end.

        Parameters
        ----------
        size : (width, height) in pixels; default is that of the traits.
        """
        pixels = size or (self.width, self.height)

        return self.scene.do(lambda scene: draw_still(scene, pixels, self.shows, bands=max(1, pixels[1] // 64)))

    async def screenshot(self, timeout: float = 10.0) -> Image:
        """The full picture of all changes so far in the front end; without one that of :meth:`still`.

        Parameters
        ----------
        timeout : seconds to wait for it, for pictures are quick and small at first; then it is drawn for this alone.
        """
        end = time.monotonic() + timeout
        while self._front_ends and time.monotonic() < end:
            last, loop = self.pictures.frames.last, self.scene.loop
            if last is not None and last.is_full and loop is not None and loop.is_settled:
                return last.images[0]
            await asyncio.sleep(_LOOK_EVERY)
        return await asyncio.to_thread(self.still)

    def stats(self) -> dict[str, Any]:
        """Measurements and counts of sent data.

        ``edit_ms`` (median of fitting and loading a deformation), ``frame_ms`` (of quick pictures), ``full_ms``,
        ``frames``, ``scale`` (share of the full width that quick pictures have), ``path`` ("texture", "array" or
        "core"), ``width``, ``height``, ``bytes_per_frame`` (of the last), ``frame_bytes`` and ``sent`` (of all).
        """
        loop, (width, height) = self.scene.loop, self._frame()[0]
        measured = {} if loop is None else loop.pace.stats()
        return {**measured, "path": self._path, "width": width, "height": height, **self.pictures.frames.stats()}

    def preview_png(self) -> bytes:
        """A small picture as a PNG: the still where no front end runs."""
        return self.scene.do(lambda scene: preview_png(scene, self.shows))

    def _repr_mimebundle_(self, **options: Any) -> Any:
        bundle = super()._repr_mimebundle_(**options)
        return bundle if self.scene.content is None else with_png(bundle, self.preview_png)


def _check(transfer: TransferFunction | PresetName, volume: Volume | None) -> None:
    if isinstance(transfer, str) and transfer not in PRESETS and volume is not None:
        preset(transfer, volume)  # raises for an unknown one

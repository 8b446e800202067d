"""The live view: a volume in the browser, turned and deformed without sending it again.

The page gets the voxels once, in packed pieces that it asks for, and then displacements only: it warps at every sample
of a ray, as the paper does on its graphics card.

Messages by the page (each with ``view``, the page's own name): ``hello`` (largest texture, renderer), ``chunk`` (id,
index: asks for a piece), ``still`` (width, height: asks for a picture), ``screenshot`` (id, with a PNG), ``stats``.
Messages to the page: ``chunk`` (id, index, start, with gzip), ``field`` (see :mod:`~deformnb.widgets.card_maps`),
``still`` (with a PNG), ``screenshot`` (id: asks for one). What the page sends is checked and dropped if it is wrong.
"""

from __future__ import annotations

import asyncio
import io
import itertools
import logging
import threading
from collections.abc import Callable
from typing import Any

import anywidget
import ipywidgets
import numpy as np
import traitlets
from numpy.typing import ArrayLike, NDArray

from deformnb.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.extrusion import Extrusion
from deformnb.fields import AbstractField
from deformnb.plane import Plane
from deformnb.transfer import TransferFunction, preset
from deformnb.volume import Grid, Volume
from deformnb.widgets.assets import joined, style
from deformnb.widgets.card_maps import CardMaps, card_maps
from deformnb.widgets.shown_volume import ShownVolume, shown_volume
from deformnb.widgets.stills import render_still
from deformnb.widgets.view import AbstractView, Image, ViewMeta

_FILES = ("rbf_solve.js", "rbf.js", "link.js", "volume_blocks.js", "raycast_glsl.js", "raycast.js", "camera.js",
          "frame_loop.js", "field_link.js", "hands.js", "live_view.js")

_LOG = logging.getLogger(__name__)

# A message of the page says little; only a screenshot is larger: 4096 x 4096 pixels of a noisy picture as PNG.
_LONGEST_TEXT = 200
_LARGEST_PICTURE = 2**26

_HOME = (0.4, 1.0, -0.3)


class LiveView(AbstractView, anywidget.AnyWidget, metaclass=ViewMeta):
    """A volume in the browser, turned and deformed there.

    Parameters
    ----------
    volume : shown at once if given.
    transfer : a transfer function or the name of a preset.
    projection : "shaded", "composite" or "mip".
    background : "dark" or "light".
    limit : voxels sent to the page at most; a larger volume is averaged and the view says so.
    width, height : size on the page in CSS pixels; a narrow page makes it smaller.
    map_size : samples of a displacement map along its longer side.
    space_size : samples along the longest side of a displacement that is no extrusion.
    target_ms : time that a picture may take while something moves; its resolution adapts.
    settle_ms : rest after which the full picture is drawn.

    Notes
    -----
    Neither voxels nor maps are traits: a saved notebook holds a few kB of this widget.

    Examples
    --------
    >>> from deformnb.volume import Volume
    >>> view = LiveView(Volume.from_array(np.eye(8, dtype=np.uint8)[None] * np.ones((8, 1, 1), np.uint8)))
    >>> view.volume_info["shape"]
    [8, 8, 8]
    >>> view.still((64, 48)).shape
    (48, 64, 3)
    """

    _esm = joined(*_FILES)
    _css = style("live_view.css")

    volume_info = traitlets.Dict().tag(sync=True)
    table = traitlets.Bytes().tag(sync=True)
    unit = traitlets.Float(1.0).tag(sync=True)
    projection = traitlets.Enum(["shaded", "composite", "mip"], "shaded").tag(sync=True)
    background = traitlets.Enum(["dark", "light"], "dark").tag(sync=True)
    camera = traitlets.Dict().tag(sync=True)
    width = traitlets.Int(720, min=64, max=8192).tag(sync=True)
    height = traitlets.Int(540, min=64, max=8192).tag(sync=True)
    label = traitlets.Unicode("Volume").tag(sync=True)
    target_ms = traitlets.Float(100.0, min=5.0, max=5000.0).tag(sync=True)
    settle_ms = traitlets.Float(250.0, min=0.0, max=60000.0).tag(sync=True)
    editor = traitlets.Any(None, allow_none=True).tag(sync=True, **ipywidgets.widget_serialization)
    editor_map = traitlets.Int(0, min=0).tag(sync=True)

    def __init__(self, volume: Volume | None = None, *, transfer: TransferFunction | str = "specimen",
                 limit: int = 256**3, map_size: int = 192, space_size: int = 64, **traits: Any) -> None:
        traits.setdefault("camera", {"direction": list(_HOME), "up": [0.0, 0.0, 1.0], "zoom": 1.0, "pan": [0.0, 0.0]})
        self._lock = threading.RLock()  # callbacks run in another thread than cells
        self._limit, self._map_size, self._space_size = int(limit), int(map_size), int(space_size)
        self._largest = 2048  # along an axis of a texture, until a page says less
        self._volume: Volume | None = None
        self._window: tuple[float, float] | None = None
        self._shown: ShownVolume | None = None
        self._chunks: dict[int, tuple[int, bytes]] = {}
        self._field: AbstractField | None = None
        self._output: Grid | None = None
        self._maps: CardMaps | None = None
        self._transfer: TransferFunction | None = None
        self._wanted_transfer = transfer
        self._waiting: dict[int, Callable[[bytes], None]] = {}
        self._numbers = itertools.count(1)
        self._page_stats: dict[str, float] = {}
        self._sent = {"volume_bytes": 0, "field_bytes": 0, "messages": 0}
        super().__init__(**traits)
        self.on_msg(self._receive)
        if volume is not None:
            self.show(volume)

    # -- what is shown -------------------------------------------------------------------------------------------------

    def show(self, volume: Volume, *, window: tuple[float, float] | None = None) -> None:
        """Show another volume, without deformation, from the same side.

        Parameters
        ----------
        window : values that are told apart; default is the whole range for bytes, and up to the densest matter (all
            but the brightest 1 in 10 000) for other types.
        """
        shown = shown_volume(volume, self._limit, self._largest, window)
        with self._lock:
            self._volume, self._window, self._shown = volume, window, shown
            self._chunks = {}
            self._field = self._output = None
            self._maps = card_maps(None, shown, None, self._map_size, self._space_size)
        self.set_transfer(self._wanted_transfer)
        self.label = f"Volume {volume.name}".strip()
        self.volume_info = shown.info()
        self._send_field(None)

    def _ready(self) -> ShownVolume:
        if self._shown is None:
            raise DeformError("the view shows no volume yet; call show(volume) first.")
        return self._shown

    def show_deformation(self, deformation: Deformation | AbstractField | None, *, output: Grid | None = None) -> None:
        shown = self._ready()
        grid = shown.original if output is None else output
        field = deformation.field(grid) if isinstance(deformation, Deformation) else deformation
        if field is not None and field.dim != 3:
            raise DeformError("a volume needs a field in space; extrude the field of a plane first.")
        maps = card_maps(field, shown, output, self._map_size, self._space_size)
        with self._lock:
            self._field, self._output, self._maps = field, output, maps
        self._send_field(None)

    def follow(self, editor: Any, field: Extrusion | AbstractField, index: int = 0, *,
               output: Grid | None = None) -> None:
        """Let an editor in the same page move the picture's displacement, without a byte to Python.

        Parameters
        ----------
        editor : an :class:`~deformnb.widgets.Editor`, or None to end it.
        field : what is shown until the first drag: an extrusion over the editor's plane, or a composition that ends
            with one. Its plane, depths and weights stay, also while points move.
        index : which of its maps the editor's points make.
        """
        self.show_deformation(field, output=output)
        planar = self._maps.content["planar"] if self._maps else None
        if editor is not None and planar is None:
            raise DeformError("an editor moves the maps of an extrusion, and this field does not end with one.")
        if planar is not None and not 0 <= index < planar["shape"][0]:
            raise DeformError(f"there is no map {index}; the extrusion has {planar['shape'][0]}.")
        self.editor_map = index
        self.editor = editor

    def set_transfer(self, transfer: TransferFunction | str) -> None:
        self._wanted_transfer = transfer
        if self._volume is None or self._shown is None:
            return
        function = preset(transfer, self._volume) if isinstance(transfer, str) else transfer
        self._transfer = function
        table = function.table(*self._shown.window, function.unit)  # alphas as they are; the page fits them to steps
        with self.hold_sync():
            self.unit = function.unit
            self.table = np.ascontiguousarray(table, "<f4").tobytes()

    def set_camera(self, direction: ArrayLike | None = None, up: ArrayLike | None = None,
                   zoom: float | None = None, *, perspective: bool | None = None) -> None:
        camera = dict(self.camera)
        if direction is not None:
            plane = Plane.through((0, 0, 0), direction, up)  # refuses what is no direction
            camera |= {"direction": list(plane.normal), "up": [-c for c in plane.v], "pan": [0.0, 0.0]}
        elif up is not None:
            camera["up"] = [-c for c in Plane.through((0, 0, 0), camera["direction"], up).v]
        if zoom is not None:
            if not (np.isfinite(zoom) and zoom > 0):
                raise DeformError(f"zoom must be a positive number, got {zoom}.")
            camera["zoom"] = float(zoom)
        if perspective is not None:
            camera["perspective"] = bool(perspective)
        self.camera = camera

    # -- pictures ------------------------------------------------------------------------------------------------------

    def still(self, size: tuple[int, int] | None = None) -> Image:
        shown = self._ready()
        assert self._transfer is not None
        low, high = shown.window
        # Bytes instead of the volume's own values: what the page has too, and a colour is looked up by value.
        volume = Volume(shown.volume.values, shown.volume.grid, shown.volume.name, shown.volume.is_labels)
        return render_still(volume, self._field, self._output, self.camera, _in_bytes(self._transfer, low, high),
                            self.projection, self.background, 255 * shown.white, size or (self.width, self.height))

    async def screenshot(self, timeout: float = 10.0) -> Image:
        """The picture that is on the screen now, (height, width, 3); without a page the one of :meth:`still`.

        Parameters
        ----------
        timeout : seconds to wait for the page. Where a front end delivers messages only between cells, nothing comes
            while this is awaited, and the still is returned.
        """
        loop, number = asyncio.get_running_loop(), next(self._numbers)
        answer: asyncio.Future[bytes] = loop.create_future()

        def deliver(png: bytes) -> None:
            loop.call_soon_threadsafe(_settle, answer, png)

        self._waiting[number] = deliver
        try:
            self._post({"type": "screenshot", "id": number}, [])
            return _decoded(await asyncio.wait_for(answer, timeout))
        except TimeoutError:
            return self.still()
        finally:
            self._waiting.pop(number, None)

    def stats(self) -> dict[str, Any]:
        """What the page measured last, and what was sent.

        ``drag_ms`` (median of quick pictures), ``scale`` (their share of the full width), ``full_ms``, ``passes``,
        ``frames``, ``width``, ``height``, ``edits``, ``edit_ms`` (fit in the page), ``received`` (bytes); of Python
        ``volume_bytes``, ``field_bytes``, ``messages``, ``resolution`` and ``factors`` along x, y, z.
        """
        shown = self._shown
        own = {"resolution": shown.volume.shape[::-1], "factors": shown.factors} if shown else {}
        return {**self._page_stats, **self._sent, **own}

    # -- messages ------------------------------------------------------------------------------------------------------

    def _post(self, content: dict[str, Any], buffers: list[bytes]) -> None:
        self._sent["messages"] += 1
        self.send(content, buffers)

    def _send_field(self, view: str | None) -> None:
        with self._lock:
            maps = self._maps
        if maps is None:
            return
        self._sent["field_bytes"] += maps.size
        self._post({"type": "field", "view": view, **maps.content}, maps.buffers)

    def _receive(self, _: Any, content: Any, buffers: list[Any]) -> None:
        """Whatever a page sends: a mistake is logged and dropped, never raised into the front end's channel."""
        try:
            kind = content.get("type") if isinstance(content, dict) else None
            answer = _ANSWERS.get(kind) if isinstance(kind, str) else None
            if answer is None:
                raise ValueError("unknown kind")
            answer(self, _text(content.get("view")), content, buffers or [])
        except (ValueError, TypeError, KeyError, DeformError) as error:
            _LOG.warning("a message of the page was dropped: %s", error)

    def _hello(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        largest = _whole(content.get("largest"), 0, 2**16)
        if 0 < largest < self._largest:
            self._largest = largest
            if self._volume is not None and self._shown is not None and max(self._shown.volume.shape) > largest:
                field, output = self._field, self._output
                self.show(self._volume, window=self._window)
                self.show_deformation(field, output=output)
                return
        self._send_field(view)

    def _chunk(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        shown = self._ready()
        if content.get("id") != shown.id:
            return  # of a volume that was shown before: the page will notice
        index = _whole(content.get("index"), 0, shown.chunks - 1)
        with self._lock:
            if index not in self._chunks:
                self._chunks[index] = shown.chunk(index)
            start, packed = self._chunks[index]
        self._sent["volume_bytes"] += len(packed)
        self._post({"type": "chunk", "view": view, "id": shown.id, "index": index, "start": start}, [packed])

    def _still(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        size = (_whole(content.get("width"), 16, 2048), _whole(content.get("height"), 16, 2048))
        if self._shown is not None:
            self._post({"type": "still", "view": view}, [_encoded(self.still(size))])

    def _screenshot(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        deliver = self._waiting.get(_whole(content.get("id"), 1, 2**53))
        if deliver is None or len(buffers) != 1:
            raise ValueError("a picture that nobody waits for")
        png = bytes(buffers[0])
        if len(png) > _LARGEST_PICTURE or not png.startswith(b"\x89PNG\r\n\x1a\n"):
            raise ValueError("a picture that is no PNG or too large")
        deliver(png)

    def _stats(self, view: str, content: dict[str, Any], buffers: list[Any]) -> None:
        numbers = {name: float(content[name]) for name in _MEASURED if isinstance(content.get(name), int | float)}
        self._page_stats = {name: value for name, value in numbers.items() if np.isfinite(value)}


_MEASURED = ("drag_ms", "full_ms", "passes", "frames", "scale", "width", "height", "received", "edits", "edit_ms")

_ANSWERS: dict[str, Callable[[LiveView, str, dict[str, Any], list[Any]], None]] = {
    "hello": LiveView._hello, "chunk": LiveView._chunk, "still": LiveView._still,
    "screenshot": LiveView._screenshot, "stats": LiveView._stats,
}
"""What is done about each kind of message."""


def _settle(answer: asyncio.Future[bytes], png: bytes) -> None:
    if not answer.done():
        answer.set_result(png)


def _text(value: Any) -> str:
    if not isinstance(value, str) or len(value) > _LONGEST_TEXT:
        raise ValueError("a view without a name")
    return value


def _whole(value: Any, low: int, high: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not low <= value <= high:
        raise ValueError(f"a number that is not whole and between {low} and {high}")
    return value


def _in_bytes(transfer: TransferFunction, low: float, high: float) -> TransferFunction:
    """The transfer function of the bytes that a window makes of values."""
    scale = 255 / (high - low)
    colors = tuple(((v - low) * scale, r, g, b) for v, r, g, b in transfer.colors)
    opacities = tuple(((v - low) * scale, alpha) for v, alpha in transfer.opacities)
    return TransferFunction(colors, opacities, transfer.unit)


def _encoded(image: NDArray[np.uint8]) -> bytes:
    from PIL import Image as Pillow

    stream = io.BytesIO()
    Pillow.fromarray(image).save(stream, format="PNG", compress_level=3)
    return stream.getvalue()


def _decoded(png: bytes) -> Image:
    from PIL import Image as Pillow

    return np.asarray(Pillow.open(io.BytesIO(png)).convert("RGB")).copy()

"""The live view: a volume in the browser, turned and deformed without sending it again.

The page gets the voxels once, in packed pieces that it asks for, and then displacements only: it warps at every sample
of a ray, as the paper does on its graphics card.
"""

from __future__ import annotations

import threading
import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import ipywidgets
import numpy as np
import traitlets
from numpy.typing import ArrayLike

from deformnb.deformation import Deformation
from deformnb.errors import DeformError
from deformnb.extrusion import Extrusion
from deformnb.fields import AbstractField
from deformnb.time_maps import TimeMaps
from deformnb.transfer import TransferFunction, preset
from deformnb.volume import Grid, Volume
from deformnb.widgets.assets import joined, style
from deformnb.widgets.camera import CameraTrait, ClipTrait, Image, ShowsTrait, turned
from deformnb.widgets.card_maps import count_maps, differ_only_in
from deformnb.widgets.cell_widgets import close_earlier_of_this_cell
from deformnb.widgets.fine_window import fine_window, is_fine_enough
from deformnb.widgets.live_pages import OF_PAGE, AnswersPages
from deformnb.widgets.refit import check_map, state_followed
from deformnb.widgets.shown_volume import Pieces, ShownVolume, shown_volume, whole_window
from deformnb.widgets.space_points import POINT_FILES, POINT_STYLES, ShowsPoints
from deformnb.widgets.static_picture import with_png
from deformnb.widgets.stills import Scene, preview_png, render_scene
from deformnb.widgets.synced import SyncedWidget
from deformnb.widgets.view import AbstractView, ViewMeta
from deformnb.widgets.view_messages import take_traits

_FILES = ("rbf_solve.js", "rbf.js", "region_masks.js", "regions.js", "rigid_fits.js", "staged_fits.js",
          "cut_fits.js", "link.js", "elements.js", "volume_blocks.js", "raycast_folds.js",
          "displacement_glsl.js", "raycast_glsl.js", "programs.js", "clipping.js", "raycast.js", "camera.js",
          "frame_loop.js", "cut_layers.js", "field_link.js", "scale_bar.js", "live_parts.js", "orientation.js",
          "volume_loader.js", "time_maps.js", *POINT_FILES, "hands.js", "pictures_page.js", "still_picture.js",
          "live_page.js", "live_view.js")

_REST = 0.6  # seconds without another colour, after which the voxels may be sent in other levels


class LiveView(ShowsPoints, AnswersPages, AbstractView, SyncedWidget, metaclass=ViewMeta):
    """A volume in the browser, turned and deformed there.

    Parameters
    ----------
    volume : shown at once if given.
    transfer : a transfer function or the name of a preset.
    projection : "shaded", "composite" or "mip".
    background : "auto" follows the page, "dark" and "light" do not.
    shows : "deformed", "original", "side_by_side" or "flicker": see :data:`~deformnb.widgets.view.SHOWS`.
    camera : direction, up, zoom, pan and perspective, as in :class:`~deformnb.widgets.view.CameraTrait`. The page
        writes it when the hand lets go; ``traitlets.link((a, "camera"), (b, "camera"))`` turns two views together.
    clip : the part of the box that is seen, three pairs of shares; see :meth:`set_clip`.
    limit : voxels sent to the page at most; a larger volume is averaged and the view says so.
    width, height : size on the page in CSS pixels; a narrow page makes it smaller.
    fill : True takes the size of the box it stands in instead.
    map_size : samples of a displacement map along its longer side.
    space_size : samples along the longest side of a displacement that is no extrusion.
    show_folds : whether matter is red and striped where the map folds; it costs nothing where nothing does.
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
    _css = style("live_view.css", "volume_view.css", *POINT_STYLES)

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
    target_ms = traitlets.Float(65.0, min=5.0, max=5000.0).tag(sync=True)
    settle_ms = traitlets.Float(250.0, min=0.0, max=60000.0).tag(sync=True)
    editor = traitlets.Any(None, allow_none=True).tag(sync=True, **ipywidgets.widget_serialization)
    editor_map = traitlets.Int(0, min=0).tag(sync=True)

    def __init__(self, volume: Volume | None = None, *, transfer: TransferFunction | str = "specimen",
                 limit: int = 256**3, map_size: int = 192, space_size: int = 64, **traits: Any) -> None:
        self._meet_pages()
        self._limit, self._map_size, self._space_size = int(limit), int(map_size), int(space_size)
        self._preview: tuple[Scene, bytes] | None = None
        self._sharpener: threading.Timer | None = None
        self._transfer: TransferFunction | None = None
        self._wanted_transfer = transfer
        super().__init__(**traits)
        self.on_msg(self._receive)
        if volume is not None:
            self.show(volume)
        close_earlier_of_this_cell(self)

    # -- what is shown -------------------------------------------------------------------------------------------------

    def show(self, volume: Volume, *, window: tuple[float, float] | None = None) -> None:
        """Show another volume, without deformation, from the same side.

        Parameters
        ----------
        window : values that are told apart; default is the whole range for bytes, and up to the densest matter (all
            but the brightest 1 in 10 000) for other types. Where colours and opacities change within a quarter of
            that, only this part is told apart, more finely: the voxels are then sent again, and the view says so.
        """
        self._put(volume, window, None, None, None)
        self._offer()
        self._tell_stand_in()

    def _put(self, volume: Volume, window: tuple[float, float] | None, field: AbstractField | None,
             output: Grid | None, followed: dict[str, Any] | None) -> None:
        with self._lock:  # throughout: of two that are shown at once, one is shown whole
            function = _function(self._wanted_transfer, volume)
            narrow = self._fine(function, volume) if window is None else None
            shown = shown_volume(volume, self._limit, self._largest, narrow or window)
            if narrow is not None:
                low, high = whole_window(volume)
                shown = replace(shown, share=(narrow[1] - narrow[0]) / (high - low))
            self._volume, self._window, self._pieces = volume, window, Pieces(shown)
            self._hold(field, output, followed)
            self.label = f"Volume {volume.name}".strip()
            self.volume_info = shown.info()  # before the colours: a page keeps the old ones until the voxels have come
            self.set_transfer(self._wanted_transfer)

    def _fine(self, function: TransferFunction, volume: Volume) -> tuple[float, float] | None:
        """The part of the values that bytes shall tell apart, if not all; a maximum projection shows all."""
        return None if self.projection == "mip" else fine_window(function, volume, whole_window(volume))

    @traitlets.observe("projection")
    def _colours_changed(self, _change: Any = None) -> None:
        """Once nothing has changed for a while, send the voxels in finer levels if the colours need them."""
        timer, self._sharpener = self._sharpener, None
        if timer is not None:
            timer.cancel()
        if self._needs_other_levels():
            self._sharpener = threading.Timer(_REST, _weakly(self, LiveView._sharpen))
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
    def shown_output(self) -> Grid | None:
        return self._output

    def _ready(self) -> ShownVolume:
        shown = self._shown
        if shown is None:
            raise DeformError("the view shows no volume yet; call show(volume) first.")
        return shown

    def show_deformation(self, deformation: Deformation | AbstractField | None, *, output: Grid | None = None) -> None:
        self._take(deformation, output, None)
        self._tell_stand_in()

    def _take(self, deformation: Deformation | AbstractField | None, output: Grid | None,
              followed: dict[str, Any] | None) -> None:
        shown = self._ready()
        grid = shown.original if output is None else output
        field = deformation.field(grid) if isinstance(deformation, Deformation) else deformation
        if field is not None and field.dim != 3:
            raise DeformError("a volume needs a field in space; extrude the field of a plane first.")
        self._hold(field, output, followed)
        self._offer()

    def _hold(self, field: AbstractField | None, output: Grid | None, followed: dict[str, Any] | None,
              moments: TimeMaps | None = None) -> None:
        with self._lock:
            self._field, self._output, self._followed = field, output, followed
            self._maps, self._moments = None, moments

    def follow(self, editor: Any, field: Extrusion | AbstractField, index: int = 0, *,
               output: Grid | None = None) -> None:
        """Let an editor in the same page move the picture's displacement, without a byte to Python.

        Parameters
        ----------
        editor : an :class:`~deformnb.widgets.Editor`, or None to end it.
        field : what is shown until the next drag: an extrusion over the editor's plane, or a composition that ends with
            one. Its plane, depths and weights stay, also while points move.
        index : which of its maps the editor's points make.

        Notes
        -----
        May be called after every edit: the page keeps its connection, and what the editor has gone on to show stays. To
        let the editor move another map, follow with the other index first and then give it that map's points.
        """
        if editor is not None or count_maps(field) is not None:
            check_map(field, index)
        followed = None if editor is None else state_followed(editor, index)
        goes_on = followed is not None and self._moments is None and (
            editor, index, output) == (self.editor, self.editor_map, self._output)
        if goes_on and differ_only_in(index, self._field, field):  # the page has made that map itself: nothing to send
            self._hold(field, output, followed)
        else:
            self._take(field, output, followed)
            self.editor_map = index
            self.editor = editor
        self._tell_stand_in()

    def set_transfer(self, transfer: TransferFunction | str) -> None:
        self._wanted_transfer = transfer
        if self._volume is None or self._shown is None:
            return
        with self._lock:  # or the voxels get other levels meanwhile, and this would be a table for those of before
            function = self._transfer = _function(self._wanted_transfer, self._volume)
            table = function.table(*self._shown.window)  # alphas as they are: the page fits them
            with self.hold_sync():
                self.unit = function.unit
                self.table = np.ascontiguousarray(table, "<f4").tobytes()
        if self._stand_in is not None:
            self._stand_in.set_transfer(function)
        self._colours_changed()

    def set_camera(self, direction: ArrayLike | None = None, up: ArrayLike | None = None,
                   zoom: float | None = None, *, perspective: bool | None = None) -> None:
        self.camera = turned(self.camera, direction, up, zoom, perspective)

    # -- pictures ------------------------------------------------------------------------------------------------------

    def _shade(self) -> str:
        return self._page_theme if self.background == "auto" else self.background

    def _scene(self) -> Scene:
        shown = self._ready()
        assert self._transfer is not None
        with self._lock:
            field, output = self._at_present(self._field), self._output
        background = self._shade()
        return Scene(shown, field, output, self.camera, self._transfer, self.projection, background, self.shows,
                     self.clip)

    def still(self, size: tuple[int, int] | None = None) -> Image:
        return render_scene(self._scene(), size or (self.width, self.height))

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
        """What the page measured last, and what was sent.

        ``drag_ms`` (median of quick pictures), ``scale`` (their share of the full width), ``full_ms``, ``passes``,
        ``frames``, ``width``, ``height``, ``edits``, ``edit_ms`` (fit in the page), ``received`` (bytes); of Python
        ``volume_bytes``, ``field_bytes``, ``messages``, ``resolution`` and ``factors`` along x, y, z; and ``stand_in``:
        what was measured where Python draws for a page that cannot.
        """
        shown = self._shown
        drawn = {"stand_in": stand_in.stats()} if (stand_in := self._stand_in) is not None else {}
        own = {"resolution": shown.volume.shape[::-1], "factors": shown.factors} if shown else {}
        return {**self._page_stats, **self._sent, **own, **drawn}

    def set_state(self, sync_data: Any) -> None:
        """Take what the page says of its traits, as far as it is right."""
        take_traits(sync_data, OF_PAGE, super().set_state)

    def close(self) -> None:
        """Leave the pages, and end what draws for those that cannot."""
        if self._sharpener is not None:
            self._sharpener.cancel()
        self._draw_no_more()
        super().close()


def _function(transfer: TransferFunction | str, volume: Volume) -> TransferFunction:
    return preset(transfer, volume) if isinstance(transfer, str) else transfer


def _weakly(view: LiveView, method: Callable[[LiveView], None]) -> Callable[[], None]:
    """Calls a method of a view that is still there: a timer keeps none alive."""
    held = weakref.ref(view)

    def call() -> None:
        alive = held()
        if alive is not None:
            method(alive)

    return call

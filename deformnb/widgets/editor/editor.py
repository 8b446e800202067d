"""Editor of control points on a picture that deforms while a point is dragged.

The front end fits the points and warps the picture itself, by the same mathematics as :func:`fit_rbf`, so a
drag needs no kernel. The kernel gets the points at the end of an edit, and during a drag only if a callback is
registered for it.

The messages are those of :mod:`deformnb.widgets.messages.editors`.

The pictures of an editor are made here too: as the front end gets them, and as a still where there is no front end.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import traitlets
from numpy.typing import NDArray

from deformnb.checks import check_window
from deformnb.document.deformation import Step
from deformnb.errors import DeformError
from deformnb.imaging.preview import draw_preview
from deformnb.rbf.cuts import CUT_RULES, CutRuleName, Decoupled
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.rigid import RigidPart
from deformnb.rbf.support import lone_support
from deformnb.volume.colour_maps import COLOUR_MAPS, ColourMapName, colour_table
from deformnb.volume.plane import Picture, Plane, Raster
from deformnb.warping.points import warp_points
from deformnb.warping.warper import warp_picture
from deformnb.widgets.bundle import bundle
from deformnb.widgets.camera import PICTURE_SHOWS
from deformnb.widgets.cell_widgets import with_png
from deformnb.widgets.editor.base import FRONT_END_TRAITS, EditedPoints, PointsTrait
from deformnb.widgets.image_encoding import as_png
from deformnb.widgets.messages.editors import (
    WINDOWS_AROUND,
    DrawShape,
    EditRefused,
    LargerBoxRequest,
    ProposedParts,
    ShowPoint,
    WandRequest,
    WindowPointer,
)
from deformnb.widgets.messages.shapes import ShapesTrait, shapes_to_json
from deformnb.widgets.messages.traits import OVERLAYS
from deformnb.widgets.packed_volume import unit_of
from deformnb.widgets.view.base import PlanarFit

# Pixels along the longer side of an empty sheet: the arrow keys move points by one of them.
_SHEET = 200
_AIR = 0.2  # of the box of the points, on each side
_PREVIEW_SIZE = 572  # pixels along the longer side, some 100 kB in the notebook
_PARTS = 6  # of a grid line in a cell


def picture_png(picture: Picture) -> tuple[bytes, dict[str, Any]]:
    """The picture as PNG, and what its pixels mean, for a front end that applies the window itself.

    Returns
    -------
    The PNG, and ``channels``: 3 for colours over black, 1 for grey values in a byte, 2 for grey values in two bytes, of
    which red is the higher and green the lower one. Of grey values also ``range``, the values of the smallest and the
    largest such number, the automatic ``window`` and the ``unit``.
    """
    if picture.values.ndim == 3:
        return as_png(picture.rgb8()), {"channels": 3}
    low, high = _range(picture)
    whole = picture.values.dtype.kind in "biu" and high - low <= 255
    high = low + 255 if whole else high
    most = 255 if whole else 65535
    shares = np.clip((picture.values.astype(np.float64) - low) / (high - low), 0, 1)
    numbers = (shares * most + 0.5).astype(np.uint16)
    facts: dict[str, Any] = {
        "channels": 1 if whole else 2,
        "range": [low, high],
        "window": list(picture.window),
        "unit": picture.unit,
    }
    if whole:
        return as_png(numbers.astype(np.uint8)), facts
    return as_png(np.stack([numbers >> 8, numbers & 255, np.zeros_like(numbers)], axis=-1).astype(np.uint8)), facts


def _range(picture: Picture) -> tuple[float, float]:
    """The values that the front end distinguishes: all of them, or else the window and its surroundings."""
    low, high = picture.window
    margin = WINDOWS_AROUND * (high - low)
    least, most = float(picture.values.min()), float(picture.values.max())
    least, most = max(least, low - margin), min(most, high + margin)
    return (least, most) if least < most else (low, high)


def raster_json(raster: Raster, facts: dict[str, Any]) -> dict[str, Any]:
    """A raster as the front end gets it, with the meaning of the pixels."""
    return {"shape": list(raster.shape), "spacing": list(raster.spacing), "origin": list(raster.origin), **facts}


def sheet(points: ControlPoints) -> Picture:
    """An empty picture around the points."""
    places = np.concatenate([points.source, points.target]) if len(points) else np.array([[0.0, 0.0], [100.0, 100.0]])
    low, high = places.min(axis=0), places.max(axis=0)
    longest = float((high - low).max()) or 100.0
    low, high = low - _AIR * longest, high + _AIR * longest
    d = float((high - low).max()) / _SHEET
    nu, nv = (max(1, round(float(v) / d)) for v in high - low)
    raster = Raster((nv, nu), (d, d), (float(low[0]) + d / 2, float(low[1]) + d / 2))
    return Picture(np.zeros((nv, nu), np.uint8), Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), raster, "sheet", (0.0, 1.0))


def grid_lines(raster: Raster, cells: int) -> list[NDArray[np.float64]]:
    """A grid of square cells over a raster, ``cells`` along its longer side, as polylines (n, 2) that can bend."""
    a0, a1, b0, b1 = raster.box
    size = max(a1 - a0, b1 - b0) / cells
    across, down = max(1, round((a1 - a0) / size)), max(1, round((b1 - b0) / size))
    a, b = np.linspace(a0, a1, across * _PARTS + 1), np.linspace(b0, b1, down * _PARTS + 1)
    upright = [np.stack([np.full_like(b, x), b], axis=-1) for x in a[::_PARTS]]
    return upright + [np.stack([a, np.full_like(a, y)], axis=-1) for y in b[::_PARTS]]


def deformed_lines(lines: list[NDArray[np.float64]], fit: AbstractField) -> list[NDArray[np.float64]]:
    """Lines of a picture after its deformation, in pieces where the map folds and at cuts."""
    places = np.concatenate(lines)
    moved, found = warp_points(places, fit)
    region = np.zeros(len(places), dtype=int)
    if isinstance(fit, Decoupled):
        for k, (lies_there, _) in enumerate(fit.fields_by_source(places)):
            region[lies_there] = k
    region[~found] = -1
    ends = np.cumsum([len(line) for line in lines])[:-1]
    pieces = []
    for line, label in zip(np.split(moved, ends), np.split(region, ends), strict=True):
        changes = np.flatnonzero(np.diff(label)) + 1
        runs = zip(np.split(line, changes), np.split(label, changes), strict=True)
        pieces += [run for run, of_run in runs if of_run[0] >= 0 and len(run) > 1]
    return pieces


def preview_png(
    picture: Picture,
    points: ControlPoints,
    fit: Callable[[], AbstractField],
    cells: int,
    deformed: Picture | None = None,
) -> bytes:
    """The deformed picture with its grid and points; nothing is fitted, and no JAX imported, before a drag.

    Parameters
    ----------
    deformed : that picture, where it is not the one that the fit makes.
    """
    lines = grid_lines(picture.raster, cells) if cells else []
    if points.displacement.any():
        field = fit()
        warped = replace(picture, values=warp_picture(picture.values, picture.raster, field))
        picture = warped if deformed is None else deformed
        lines = deformed_lines(lines, field) if lines else []
    return as_png(draw_preview(picture, lines, points, _PREVIEW_SIZE))


_LOG = logging.getLogger(__name__)

# The support radius of one point without trend where there is no volume: a bump that one can see and grab.
_LONE_POINT_SHARE = 0.25


class Editor(EditedPoints):
    """Control points on a picture, dragged in the front end.

    Parameters
    ----------
    picture : background of the points; None for an empty sheet.
    points : control points in the picture's coordinates; default is none.
    raster : of an empty sheet; default is the box of the points with a margin.
    kernel, support, etc. : settings of the fit, as in :class:`~deformnb.rbf.fit_settings.AbstractFitSettings`.
    density : cells of the grid along the longer side of the picture; 0 for no grid.
    show_grid, show_radius : whether the grid and the reach of the points are drawn.
    overlay : layer over the picture: "folds" paints red where the map folds, "area" how tissue grows and
        shrinks, "strain" crosses along the principal strains, "uncertainty" how far the map may be off between
        the points. Where the map folds all of them show it, "none" does not.
    drag_grid : True lets the nodes of the grid be dragged: each that is becomes a control point.
    height : largest height of the picture in CSS pixels; the editor is as wide as its place, and lower in a narrow one.
    theme : "auto" follows the front end, "light" and "dark" do not.
    label : the accessible name of the picture.
    read_only : True shows points that cannot be changed.
    beyond : (a0, a1, b0, b1), a box on the picture's plane: as far the deformed picture is drawn where it reaches
        beyond the picture itself; empty for no farther than that.
    air : value of the picture up to which there is air: folds in the air around the body are distinguished. Default is
        None, for which all of the picture counts.
    tissue : mask of tissue at any depth on the picture's plane, as documents hold a region: decides instead of ``air``
        where folds are in air. Default is {}.
    outline : tissue to be kept within the box of the result, ``{"tissue": mask as documents hold it, "sides": four
        names}``: after each edit the front end reports the sides at which it leaves. Default is {}, for no report.
    lone_support : reach of a single point without trend; default is a quarter of the picture's diagonal.
    cuts, parts : lists of :class:`~deformnb.rbf.cuts.Cut` and :class:`~deformnb.rbf.rigid.RigidPart` of dimension 2, or
        the plain data of :mod:`deformnb.document.json_format`, which the traits then hold.
    cut_rule : the picture next to a cut, a name of :data:`~deformnb.rbf.cuts.CUT_RULES`.

    Notes
    -----
    ``points`` is a trait: ``editor.observe(f, "points")`` calls f after every edit, ``editor.points = ...`` shows
    others. While f runs for an edit of the front end, ``edit_under_way`` describes it; it is None where code made
    the change. The same holds for ``cuts`` and ``parts``, which are drawn in the front end too. ``chosen_shape`` is the
    one of them that is chosen there, ``{"what": "parts", "index": 1}`` or {} for none; it stays with its shape when the
    list changes. ``mirror`` is ``{"on": bool, "axis": "a" | "b", "at": number}``: while on, actions of the pointer
    on one side of the line a = at (or b = at; None is the middle of the picture) are done on the other side too.
    ``snap`` is the step of a grid to which dragged targets snap, 0 for none; ``stop_at_folds``, which is on at first,
    stops drags before tissue folds; ``brush_radius`` is the radius of the brushes, 0 for a share of the picture.
    ``ghost`` is another picture (PNG) that fills the box of this one, drawn over it with ``ghost_opacity``.
    ``selected`` holds the ids of the selected points. ``history`` is {} where the front end has its own
    undo. A history in Python sets it to ``{"undo": "move nose", "redo": ""}``: the edits that would be undone and
    redone, "" for none; :meth:`on_history` then receives what the front end requests. ``waiting`` is "" or names the
    work in progress, such as another picture: while not empty, the front end dims the picture, shows that text and
    takes no edit and no undo; a drag in progress ends. An edit sent just before may still come. ``uid`` names the
    editor in its front end, where other widgets find its live points without the kernel (see js/sync/bus.js).
    ``window`` holds the values shown as black and white in a picture of grey values, as they were set manually;
    empty for the picture's own. ``colour_map`` is a name of :data:`~deformnb.volume.colour_maps.COLOUR_MAPS`.
    ``shows`` is "deformed", "original", or compares the two: "wipe" by a line that is dragged, "fade" by an opacity.
    ``slices`` is {} or, where the picture is one of several slices, ``{"count": 128,
    "first": -32.0, "spacing": 0.5}``, the depth of the first one and the distance of neighbours; the front end then
    sets ``slice``, the number from 0 of the one that is wanted, and its observer sets ``picture``.
    ``wand`` is {} or the selection of the wand of the front end, see :meth:`on_wand`.
    ``front_only`` is None, or whether the deformation ends in the front part of the depth, which the front end then
    offers for a chosen cut; its observer changes the depth.
    ``deformed_picture`` is None, or the picture of the volume that the points have deformed where that is not the
    picture warped by their map; the front end shows it while its points and shapes are those of the editor.
    ``marked`` holds the ids of points that get a dashed ring, because they disagree with their neighbours.
    ``uncertainty`` is one byte for each cell of a raster over the picture, rows first, 255 where the map is known
    least; ``uncertainty_facts`` is ``{"width": columns, "height": rows, "legend": [[byte, text], ...]}``, and a contour
    is drawn at each byte.

    Raises
    ------
    DeformError
        For points in space, an unknown name, or a setting that is no sensible number.

    Examples
    --------
    >>> editor = Editor(None, ControlPoints.from_arrays([[0, 0], [40, 0], [0, 30]], [[0, 0], [50, 0], [0, 30]]))
    >>> editor.points = editor.points.move(2, [5, 33])
    >>> bool(abs(editor.fit().displacement([5.0, 33.0]) - [-5.0, -3.0]).max() < 1e-12)
    True
    """

    _esm = bundle("editor.js")
    _css = bundle("editor.css")

    points = PointsTrait(2)
    cuts = ShapesTrait("cuts", 2)
    parts = ShapesTrait("parts", 2)
    cut_rule: CutRuleName = traitlets.Enum(list(CUT_RULES), next(iter(CUT_RULES))).tag(sync=True)  # type: ignore[assignment]
    density = traitlets.Int(16, min=0, max=64).tag(sync=True)
    show_grid = traitlets.Bool(True).tag(sync=True)
    grid_waits = traitlets.Bool(False, help="whether the grid is shown from the first edit on").tag(sync=True)
    show_radius = traitlets.Bool(False).tag(sync=True)
    stop_at_folds = traitlets.Bool(True).tag(sync=True)
    front_only = traitlets.Bool(
        None, allow_none=True, help="whether the depth is deformed in front only; None where no callback answers"
    ).tag(sync=True)
    brush_radius = traitlets.Float(0.0).tag(sync=True)
    drag_grid = traitlets.Bool(False, help="whether the nodes of the grid can be dragged").tag(sync=True)
    overlay = traitlets.Enum(list(OVERLAYS), "folds").tag(sync=True)
    uncertainty = traitlets.Bytes(b"", help="uncertainty of the map as bytes, 255 where it is largest").tag(sync=True)
    uncertainty_facts = traitlets.Dict(help="size of that raster, and texts for some of its bytes").tag(sync=True)
    marked = traitlets.List(traitlets.Int(), help="points that disagree with their neighbours").tag(sync=True)
    ghost = traitlets.Bytes(b"", help="another picture as PNG, drawn over this one").tag(sync=True)
    ghost_opacity = traitlets.Float(0.0, min=0.0, max=1.0).tag(sync=True)
    raster = traitlets.Dict().tag(sync=True)
    plane = traitlets.Dict(help="origin, u, v and n of the picture in space; {} for a sheet").tag(sync=True)
    air = traitlets.Float(None, allow_none=True, help="value of the picture up to which nothing is seen").tag(sync=True)
    tissue = traitlets.Dict(
        help="mask of tissue at any depth, as documents hold it; {} where the picture shows it"
    ).tag(sync=True)
    beyond = traitlets.List(traitlets.Float(), help="how far tissue off the picture is drawn").tag(sync=True)
    outline = traitlets.Dict(
        help="mask of the tissue that should stay in the box, and names of its sides on the picture; {} for unknown"
    ).tag(sync=True)
    cut_off = traitlets.Dict(
        help="number of the check in Python, and the sides of the box at which it found tissue cut off"
    ).tag(sync=True)
    enlarges = traitlets.Bool(False, help="whether the front end offers a larger box").tag(sync=True)
    subject = traitlets.List(traitlets.Float(), help="the box that is framed; empty for the whole picture").tag(
        sync=True
    )
    image = traitlets.Bytes(b"", help="the picture as PNG").tag(sync=True)
    window = traitlets.List(traitlets.Float(), help="values shown as black and white, set manually").tag(sync=True)
    colour_map: ColourMapName = traitlets.Enum(list(COLOUR_MAPS), COLOUR_MAPS[0])  # type: ignore[assignment]
    colours = traitlets.Bytes(b"", help="256 colours of the map, red, green, blue; empty for grey").tag(sync=True)
    deformed_image = traitlets.Bytes(b"", help="the picture of the deformed volume as PNG").tag(sync=True)
    deformed = traitlets.Dict(help="raster of that picture, and the points, cuts and parts it is of").tag(sync=True)
    shows = traitlets.Enum(list(PICTURE_SHOWS), PICTURE_SHOWS[0]).tag(sync=True)
    slices = traitlets.Dict(help="number, first depth and spacing of the slices").tag(sync=True)
    wand = traitlets.Dict(help="selection of the wand; {} where no callback answers it").tag(sync=True)
    slice = traitlets.Int(0, min=0, help="the slice that is shown, counted from 0").tag(sync=True)

    def __init__(
        self,
        picture: Picture | None = None,
        points: ControlPoints | None = None,
        *,
        raster: Raster | None = None,
        **settings: Any,
    ) -> None:
        given = ControlPoints.empty() if points is None else points
        self._previous: AbstractField | None = None
        self._picture = picture
        self._deformed: Picture | None = None
        self._wand_callbacks: list[Callable[[WandRequest], None]] = []
        self._larger_box_callbacks: list[Callable[[], None]] = []
        super().__init__(points=given, **{**_picture_traits(picture, raster, given), **settings})

    # ---- display ----------------------------------------------------------------------------------------------------

    @property
    def picture(self) -> Picture | None:
        """Picture behind the points, in the window that was set manually; both stay when another one is set."""
        if self._picture is None or self._picture.values.ndim == 3:
            return self._picture
        if not self.window and self.colour_map == self._picture.colour_map:
            return self._picture
        window = check_window(self.window) if self.window else self._picture.window
        return replace(self._picture, window=window, colour_map=self.colour_map)

    @picture.setter
    def picture(self, picture: Picture | None) -> None:
        traits = _picture_traits(picture, None, self.points)
        self._picture = picture
        with self.hold_sync():  # both in one message: picture and raster must match
            for name, value in traits.items():
                setattr(self, name, value)

    @property
    def deformed_picture(self) -> Picture | None:
        """Picture of the deformed volume, in place of the warped one; setting it states that it is of these points."""
        return self._deformed

    @deformed_picture.setter
    def deformed_picture(self, picture: Picture | None) -> None:
        if picture is None and self._deformed is None:
            return
        self._deformed = picture
        image, facts = (b"", {}) if picture is None else picture_png(picture)
        made_of = self.get_state(["points", "cuts", "parts"])
        with self.hold_sync():  # both in one message
            self.deformed_image = image
            self.deformed = {} if picture is None else {"raster": raster_json(picture.raster, facts), **made_of}

    def fit(self) -> AbstractField:
        """The fit of the points in Python: the displacement that the front end shows.

        An :class:`~deformnb.rbf.interpolant.RBFInterpolant`, with rigid parts a
        :class:`~deformnb.rbf.rigid.RigidInterpolant`, in stages a :class:`~deformnb.rbf.stages.Staged`, with cuts a
        :class:`~deformnb.rbf.cuts.Decoupled`.

        Raises
        ------
        DeformError
            If the points cannot be fitted; the front end shows the same message.
        """
        self._previous = self.current_fit()(self.points, self._previous)
        return self._previous

    def current_fit(self) -> PlanarFit:
        """The current fit of the points, for a view that follows the editor from another thread."""
        return PlanarFit(
            self.settings,
            self.parts,
            self.cuts,
            self.cut_rule,
            float(np.mean(self.raster["spacing"])),
            self.lone_support,
        )

    def step(self, **options: Any) -> Step:
        """The points and settings as a step of a :class:`~deformnb.document.deformation.Deformation`.

        Parameters
        ----------
        options : further fields of the step, such as its rule of extrusion.
        """
        if self._picture is None:
            raise DeformError("an editor without a picture has no plane in space; give it a picture.")
        shapes = {"cuts": self.cuts, "parts": self.parts, "cut_rule": self.cut_rule}
        return Step((self.points,), self._picture.plane, **{**self.settings.as_dict(), **shapes, **options})

    def preview_png(self) -> bytes:
        """The deformed picture with its grid and points as a PNG: the still where no front end runs."""
        picture = sheet(self.points) if self.picture is None else self.picture
        return preview_png(
            picture, self.points, self.fit, self.density if self.show_grid else 0, deformed=self._deformed
        )

    # ---- shapes -----------------------------------------------------------------------------------------------------

    def draw(self, tool: Literal["cut", "part", "fixed"]) -> None:
        """Start drawing in the front end: a "cut", a rigid "part", or a "fixed" side."""
        if tool not in ("cut", "part", "fixed"):
            raise DeformError(f'there is no pen for {tool!r}; choose "cut", "part" or "fixed".')
        self.post(DrawShape(tool=tool))

    def propose(self, parts: Sequence[RigidPart], kind: str) -> None:
        """Let the front end replace the rigid parts, after its user has decided about points that contradict them.

        Parameters
        ----------
        kind : name of the edit.
        """
        self.post(ProposedParts(parts=shapes_to_json("parts", parts), kind=kind))

    def look_at(self, point: int) -> None:
        """Center the front end's view on the point with this id, nearer if all of the picture is seen."""
        self.points.index(point)
        self.post(ShowPoint(id=point))

    def on_wand(self, callback: Callable[[WandRequest], None]) -> None:
        """Call ``callback(message)`` when the wand is used in the front end.

        The callback sets the trait ``wand``: ``{"region": the region as documents hold it, or None, "words": text,
        "share": of the work that is done}``. While it is {} the front end has no wand.
        """
        self._wand_callbacks.append(callback)

    def observe_larger_box(self, callback: Callable[[], None]) -> None:
        """Call ``callback()`` when the front end requests a box of the result that holds all tissue.

        Its message about tissue that is cut off has a button for that while the trait ``enlarges`` is True.
        """
        self._larger_box_callbacks.append(callback)

    def take_message(self, message: Any, buffers: Any = ()) -> None:
        if isinstance(message, WindowPointer):  # to all windows, the sender among them, which waits for its own
            self.post(message)
            return
        if not isinstance(message, WandRequest | LargerBoxRequest):
            super().take_message(message, buffers)
            return
        try:
            if isinstance(message, WandRequest):
                for answer in tuple(self._wand_callbacks):
                    answer(message)
            else:
                for enlarge in tuple(self._larger_box_callbacks):
                    enlarge()
        except Exception as error:  # of any callback: it must not end the connection with the front end
            _LOG.exception("a callback of the editor failed")
            self.post(EditRefused(message=f"{type(error).__name__} in a callback: {error}"))

    @traitlets.validate("uncertainty_facts")
    def _checked_uncertainty_facts(self, proposal: Any) -> dict[str, Any]:
        value = dict(proposal["value"])
        sizes, legend = [value.get("width"), value.get("height")], value.get("legend", [])
        if value and not (
            all(isinstance(n, int) and n > 0 for n in sizes)
            and all(len(row) == 2 and 0 <= row[0] <= 255 and isinstance(row[1], str) for row in legend)
        ):
            raise DeformError(
                'uncertainty_facts must be {} or {"width": columns, "height": rows, "legend": [[byte, '
                f"text], ...]}}, got {value}."
            )
        return value

    @traitlets.validate("beyond")
    def _box_beyond(self, proposal: Any) -> list[float]:
        value = [float(x) for x in proposal["value"]]
        if value and not (len(value) == 4 and np.isfinite(value).all() and value[0] < value[1] and value[2] < value[3]):
            raise DeformError(
                f"what is drawn beyond a picture is (a0, a1, b0, b1) with a0 < a1 and b0 < b1, or empty, got {value}."
            )
        return value

    @traitlets.validate("brush_radius")
    def _a_radius(self, proposal: Any) -> float:
        FRONT_END_TRAITS["brush_radius"](proposal["value"])
        return float(proposal["value"])

    @traitlets.validate("window")
    def _a_window(self, proposal: Any) -> list[float]:
        FRONT_END_TRAITS["window"](proposal["value"])
        return [float(value) for value in proposal["value"]]

    @traitlets.observe("colour_map")
    def _send_colours(self, _change: Any) -> None:
        is_grey = self.colour_map == COLOUR_MAPS[0]
        self.colours = b"" if is_grey else colour_table(self.colour_map).tobytes()

    @traitlets.validate("slice")
    def _a_slice(self, proposal: Any) -> int:
        return min(int(proposal["value"]), max(0, self.slices.get("count", 1) - 1))

    # ---- display ----------------------------------------------------------------------------------------------------

    def __repr__(self) -> str:
        if self._picture is None:
            return f"Editor({len(self.points)} points, no picture)"
        nv, nu = self._picture.raster.shape
        return f"Editor({len(self.points)} points, picture of {nu} x {nv})"

    def _repr_mimebundle_(self, **options: Any) -> Any:
        return with_png(super()._repr_mimebundle_(**options), self.preview_png)


def _picture_traits(picture: Picture | None, raster: Raster | None, points: ControlPoints) -> dict[str, Any]:
    """The traits that follow from a picture, or from an empty sheet."""
    where = picture.raster if picture is not None else raster or sheet(points).raster
    made: tuple[bytes, dict[str, Any]] = (b"", {"channels": 1}) if picture is None else picture_png(picture)
    image, facts = made
    grid = None if picture is None else picture.grid
    if grid is not None:
        facts["lengths"] = unit_of(grid)
    lone = _LONE_POINT_SHARE * where.diagonal if grid is None else lone_support(grid)
    return {"image": image, "raster": raster_json(where, facts), "lone_support": lone, "plane": _plane_json(picture)}


def _plane_json(picture: Picture | None) -> dict[str, Any]:
    """The plane of a picture as the front end gets it; {} of a sheet, which is nowhere in space."""
    if picture is None:
        return {}
    u, v, n = picture.plane.frame.tolist()
    return {"origin": list(picture.plane.origin), "u": u, "v": v, "n": n}

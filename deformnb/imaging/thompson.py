"""Figure of two grids side by side, as D'Arcy Thompson drew them: a picture on a regular grid, and both deformed.

The module makes the grids as numbers (the regular one, the deformed positions of its lines and nodes, magnified drags)
and draws them on a sheet: panels to one scale, grids, colours of areas, crosses of strain, captions.

Area expansion and principal strains can be drawn over the second grid. The figure is for print: saved as SVG or PDF the
grids, arrows and captions stay vectors and text, and only the pictures are pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import ceil, floor, log10
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import ndimage
from deformnb._jax import pytree
from deformnb._typing import PictureBox
from deformnb.analysis.quality import affine_split, bending_energy
from deformnb.analysis.strain import Stretches, stretches
from deformnb.checks import check_choice, finite_number, short_value
from deformnb.document.deformation import MODES, Deformation, Step
from deformnb.errors import DeformError
from deformnb.imaging.drawing import SOURCE, STYLES, TARGET, Style, StyleName, check_axes, figure_of, save_figure
from deformnb.imaging.figures import Lines, deform_lines, picture_field, rectangular_grid
from deformnb.rbf.cuts import Decoupled
from deformnb.rbf.fields import AbstractField, Identity
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture, Raster
from deformnb.volume.volume import Grid, VolumeLike, as_grid
from deformnb.warping.points import warp_points
from deformnb.warping.warper import warp_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_GRID_LINES = 64
"""Cells of a grid along its longer side at most."""

_FINE = 300  # places along the longer side where areas are evaluated


@dataclass(frozen=True, eq=False)
class Grids:
    """Contents of :func:`deformnb.imaging.thompson.draw_grids`, in picture coordinates.

    Parameters
    ----------
    field : backward displacement of the picture.
    before, after : the grid on the picture and on the deformed one; lines broken at cuts and folds have several pieces.
    nodes : (rows, columns, 2) of the regular grid.
    moved : where the nodes are in the result; found : (rows, columns) whether they are anywhere.
    cell : the side of a cell.
    """

    field: AbstractField
    before: Lines
    after: Lines
    nodes: NDArray[np.float64]
    moved: NDArray[np.float64]
    found: NDArray[np.bool_]
    cell: float

    def strain(self) -> Stretches:
        """Stretches of the tissue at the nodes of the grid, in the result."""
        return stretches(self.field, self.moved)


def steps_of(what: Any, picture: Picture, magnify: float) -> tuple[Step, ...]:
    """The steps to be drawn, magnified; none for a field."""
    if isinstance(what, AbstractField):
        if what.dim != 2:
            raise DeformError("grids are drawn of a field on a picture, of dimension 2; this one is in space.")
        return ()
    if not isinstance(what, Step | Deformation):
        raise DeformError(f"grids are drawn of a Step, a Deformation or a field, got {type(what).__name__}.")
    given = (what,) if isinstance(what, Step) else tuple(step for step in what.steps if step.enabled)
    for number, step in enumerate(given, 1):
        if step.plane != picture.plane:
            where = "in space" if step.plane is None else "on another plane"
            raise DeformError(
                f"step {number} has its control points {where}, and deforms no picture like this one; "
                "give a step on the picture's plane, with a picture of the volume before it."
            )
    return tuple(replace(step, strength=step.strength * magnify) for step in given)


def field_of(
    what: Any, steps: tuple[Step, ...], picture: Picture, magnify: float, grid: Grid | None, key: int
) -> AbstractField:
    """The displacement of the picture by these steps, or by the field that was given instead."""
    if isinstance(what, AbstractField):
        return magnify_field(what, magnify)
    fields = [picture_field(step, grid or _flat_grid(picture), min(key, len(step.maps) - 1)) for step in steps]
    if not fields:
        return Identity(2)
    return MODES[what.mode if isinstance(what, Deformation) else "compose"](*fields)


def magnify_field(field: AbstractField, factor: float) -> AbstractField:
    """A field of the plane with displacements ``factor`` times as long.

    Examples
    --------
    >>> from deformnb.rbf.fields import DisplacementField
    >>> raster = Raster((2, 2), (1.0, 1.0), (0.0, 0.0))
    >>> field = DisplacementField(np.ones((2, 2, 2)), raster)
    >>> magnify_field(field, -2.0).displacement([0.5, 0.5]).tolist()
    [-2.0, -2.0]
    """
    if factor == 1:
        return field
    if isinstance(field, Decoupled):
        return replace(field, fields=tuple(magnify_field(one, factor) for one in field.fields))
    return _Magnified(field, factor)


@pytree(data_fields=["field"], meta_fields=["factor"])
@dataclass(frozen=True, eq=False, repr=False)
class _Magnified(AbstractField):
    field: AbstractField
    factor: float

    @property
    def dim(self) -> int:
        return self.field.dim

    def jax_displacement(self, points: Any) -> Any:
        return self.factor * self.field.jax_displacement(points)

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.factor * self.field.displacement(points)

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.factor * self.field.jacobian(points)


def _flat_grid(picture: Picture) -> Grid:
    """A volume one voxel thick at the place of the picture: a fit requires only its size."""
    (nv, nu), (du, dv) = picture.raster.shape, picture.raster.spacing
    return Grid((1, nv, nu), (du, dv, min(du, dv)))


def make_grids(field: AbstractField, picture: Picture, lines: int = 12) -> Grids:
    """The grids of a picture and of its image under a field of dimension 2; see :class:`Grids`."""
    if not (isinstance(lines, int | np.integer) and 1 <= lines <= MOST_GRID_LINES):
        raise DeformError(f"a grid has 1 to {MOST_GRID_LINES} cells along its longer side, got {lines!r}.")
    a0, a1, b0, b1 = box = picture.raster.box
    cell = max(a1 - a0, b1 - b0) / lines
    across, down = max(1, round((a1 - a0) / cell)), max(1, round((b1 - b0) / cell))
    before = rectangular_grid(box, across, down)
    nodes = np.stack(np.meshgrid(np.linspace(a0, a1, across + 1), np.linspace(b0, b1, down + 1)), axis=-1)
    moved, found = warp_points(nodes, field)
    return Grids(field, before, deform_lines(before, field), nodes, moved, found, cell)


def landmarks_of(steps: tuple[Step, ...], key: int) -> ControlPoints | None:
    """The control points of a single step, where they are dragged to; of several steps they are places in between."""
    if len(steps) != 1:
        return None
    points = steps[0].maps[min(key, len(steps[0].maps) - 1)]
    return points.take(np.flatnonzero(points.active)).scaled(steps[0].strength)


def area_map(field: AbstractField, raster: Raster) -> NDArray[np.float64]:
    """Area expansion at the pixels of a raster: 2 is twice as large, NaN where the map folds.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> float(area_map(Identity(2), Raster((30, 40), (1.0, 1.0), (0.0, 0.0))).max())
    1.0
    """
    step = max(1, max(raster.shape) // _FINE)
    rows, columns = (np.unique(np.append(np.arange(0, n, step), n - 1)) for n in raster.shape)
    at = raster.points()[np.ix_(rows, columns)]
    shrunk = np.linalg.det(np.eye(2) + field.jacobian(at))  # it has a value where the map folds, its inverse has none
    if step > 1:
        v, u = (
            np.interp(np.arange(n), lines, np.arange(len(lines)))
            for n, lines in zip(raster.shape, (rows, columns), strict=True)
        )
        shrunk = ndimage.map_coordinates(shrunk, np.meshgrid(v, u, indexing="ij"), order=1)
    return np.asarray(np.where(shrunk > 0, 1 / np.where(shrunk > 0, shrunk, 1.0), np.nan))


GridOverlay: TypeAlias = Literal["none", "area", "strain"]
"""Names of the overlays of the deformed picture."""

GRID_OVERLAYS: tuple[GridOverlay, ...] = get_args(GridOverlay)
"""Overlays of the deformed picture."""

FOLD_COLOUR = "#d32f2f"
"""Colour of the places where the map folds."""

_INKS = {False: ("#762a83", "#1b7837"), True: ("#c9a3d6", "#7fd08a")}  # shrinks, grows; on light and on dark paper
_AREAS = {
    False: ("#762a83", "#af8dc3", "#ffffff", "#7fbf7b", "#1b7837"),  # multiplied with the pixels below
    True: ("#b25fd0", "#7d4a90", "#000000", "#3f8a48", "#46c45a"),
}  # added to it
_FOLD_SHARE = 0.45

_TALLEST = 9.0  # inches
_MARGIN, _GAP = 0.14, 0.2
_HEAD, _FOOT, _KEY = 0.42, 0.3, 0.42  # of title, captions and key
_DPI = 300
_LETTERS, _SMALL = 9.5, 7.5  # points
_WIDE = 1.7  # pictures wider than that are stacked
_MOST_BEYOND = 0.5  # of the picture's sides, that a grid is shown beyond it
_FEWEST = 700  # pixels along the longer side of a deformed picture, whose edge is cut out
_AIR = 0.12  # of a cell, around all that is drawn
_RANGES = (0.25, 0.5, 1.0, 2.0, 3.0)  # of the colours, in powers of 2
_LONGEST = 0.9  # of a cell, tip to tip of a cross
_PLAIN = (1.0, 2.0, 5.0, 10.0)


@cache
def _figure_class() -> type[Figure]:
    """A figure whose words stay text in SVG and PDF, and whose pictures are not resampled, however it is saved."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    class GridsFigure(Figure):
        grids: Grids

        def savefig(self, fname: Any, **options: Any) -> None:
            options = {"dpi": _DPI, "facecolor": self.get_facecolor(), **options}
            with rc_context({"svg.fonttype": "none", "pdf.fonttype": 42}):
                super().savefig(fname, **options)

    return GridsFigure


# ---- the sheet -------------------------------------------------------------------------------------------------------


class Sheet:
    """A figure of two grids while it is drawn.

    Parameters
    ----------
    picture : as it was before; grids : the numbers of both grids.
    overlay : a name of :data:`GRID_OVERLAYS`; colours : the style; width : inches.
    axes : two of a figure of someone else, which stays as it is; none is a new figure.
    """

    def __init__(
        self,
        picture: Picture,
        grids: Grids,
        overlay: GridOverlay,
        colours: Style,
        width: float,
        axes: Sequence[Axes] = (),
    ) -> None:
        self.picture, self.grids, self.overlay, self.colours, self.width = picture, grids, overlay, colours, width
        self.is_dark = _luminance(colours.paper) < 0.5
        self.inks = _INKS[self.is_dark]
        self.given = tuple(axes)
        self.figure: Any = figure_of(axes[0]) if axes else None

    # -- layout ---

    def draw(self, points: ControlPoints | None, unit: str, magnify: float) -> None:
        """Both panels with all that belongs to them."""
        before, after = self._given_places(points) if self.given else self._place(points)
        self._picture(before, self.picture.raster, _apply_ink(self.picture, self.colours))
        self._draw_grid(before, self.grids.before)
        raster = self._output(after.box)
        after_pixels = _apply_ink(_warp_picture(self.picture, self.grids.field, raster), self.colours)
        if self.overlay == "area":
            after_pixels = self._tint(after_pixels, raster)
        self._picture(after, raster, after_pixels)
        self._draw_grid(after, self.grids.after)
        if self.overlay == "strain":
            self._crosses(after)
        if points is not None:
            self._landmarks(before, after, points)
        if self.given:  # all else is of the owner of that figure
            return
        if self.overlay == "area":
            self._area_key()
        elif self.overlay == "strain":
            self._strain_key()
        self._caption(before, "a", "original")
        self._caption(after, "b", _magnification_text(magnify))
        self._scale_bar(before, unit)

    def _place(self, points: ControlPoints | None) -> tuple[_Place, _Place]:
        """Size a new figure and lay both panels to one scale: in line, so that heights or widths can be compared."""
        kind: Any = _figure_class()
        self.figure = kind(facecolor=self.colours.paper)
        self.figure.grids = self.grids
        a0, a1, b0, b1 = self.picture.raster.box
        first, second = self._boxes(points)
        stacked = (a1 - a0) / (b1 - b0) > _WIDE
        lines = (0, 1) if stacked else (2, 3)  # shared axes
        shared = (min(first[lines[0]], second[lines[0]]), max(first[lines[1]], second[lines[1]]))
        boxes = [(*shared, *b[2:]) if stacked else (*b[:2], *shared) for b in (first, second)]
        sizes = np.array([(b[1] - b[0], b[3] - b[2]) for b in boxes])
        key = _KEY if self.overlay != "none" else 0.0
        room = _TALLEST - _HEAD - key - 2 * _MARGIN - _FOOT * (1 + stacked) - _GAP * stacked
        if stacked:
            scale = min((self.width - 2 * _MARGIN) / sizes[0, 0], room / sizes[:, 1].sum())
        else:
            scale = min((self.width - 2 * _MARGIN - _GAP) / sizes[:, 0].sum(), room / sizes[0, 1])
        inches = sizes * scale
        below = inches[:, 1].sum() + _FOOT + _GAP if stacked else inches[0, 1]
        height = _HEAD + below + _FOOT + key + 2 * _MARGIN
        self.height, self.scale = height, scale
        self.figure.set_size_inches(self.width, height)
        left = (self.width - (inches[0, 0] if stacked else inches[:, 0].sum() + _GAP)) / 2
        top = height - _MARGIN - _HEAD
        starts = [
            (left, top),
            (left, top - inches[0, 1] - _FOOT - _GAP) if stacked else (left + inches[0, 0] + _GAP, top),
        ]
        one, two = (self._panel(box, size, start) for box, size, start in zip(boxes, inches, starts, strict=True))
        return one, two

    def _given_places(self, points: ControlPoints | None) -> tuple[_Place, _Place]:
        """Both panels in axes of someone else, which stay where they are."""
        before, after = (_Place(axes, box) for axes, box in zip(self.given, self._boxes(points), strict=True))
        for place in (before, after):
            place.axes.set_axis_off()
        return before, after

    def _boxes(self, points: ControlPoints | None) -> tuple[PictureBox, PictureBox]:
        """Limits of both panels: of the picture with its points, and of all that they reach."""
        box = self.picture.raster.box
        sources = [] if points is None else [points.source]
        targets = [] if points is None else [points.target]
        return (
            self._enclosing_box(box, sources),
            self._enclosing_box(box, [*sources, *targets, *self.grids.after]),
        )

    def _enclosing_box(self, box: PictureBox, places: list[NDArray[np.float64]]) -> PictureBox:
        """The box of the picture and of the drawing on it, which may leave it, but not by far."""
        (a0, b0), (a1, b1) = (
            reach(np.concatenate([*places, np.reshape(box, (2, 2)).T]), axis=0) for reach in (np.min, np.max)
        )
        far_a, far_b = _MOST_BEYOND * (box[1] - box[0]), _MOST_BEYOND * (box[3] - box[2])
        air = _AIR * self.grids.cell
        return (
            max(float(a0), box[0] - far_a) - air,
            min(float(a1), box[1] + far_a) + air,
            max(float(b0), box[2] - far_b) - air,
            min(float(b1), box[3] + far_b) + air,
        )

    def _panel(self, box: PictureBox, size: NDArray[np.float64], start: tuple[float, float]) -> _Place:
        (w, h), (left, top) = size, start
        axes = self.figure.add_axes((left / self.width, (top - h) / self.height, w / self.width, h / self.height))
        axes.set(xlim=box[:2], ylim=(box[3], box[2]))
        axes.set_axis_off()
        return _Place(axes, box, left, top - h, w, h)

    # -- drawing ---

    def _output(self, box: PictureBox) -> Raster:
        """Pixels as large as the picture's, or a part of them where it is coarse, over a box of its plane."""
        parts = ceil(_FEWEST / max(self.picture.raster.shape))
        da, db = (d / parts for d in self.picture.raster.spacing)
        shape = (max(1, ceil((box[3] - box[2]) / db)), max(1, ceil((box[1] - box[0]) / da)))
        return Raster(shape, (da, db), (box[0] + da / 2, box[2] + db / 2))

    def _picture(self, place: _Place, raster: Raster, pixels: NDArray[np.float64]) -> None:
        a0, a1, b0, b1 = raster.box
        aspect: Any = "equal" if self.given else "auto"
        place.axes.imshow(pixels, extent=(a0, a1, b1, b0), interpolation="bilinear", aspect=aspect, zorder=0)
        place.axes.set(xlim=place.box[:2], ylim=(place.box[3], place.box[2]))

    def _draw_grid(self, place: _Place, lines: list[NDArray[np.float64]]) -> None:
        from matplotlib.collections import LineCollection

        color = self.colours.grid if self.overlay != "area" else self.colours.ink
        drawn = LineCollection(
            lines,
            colors=color,
            linewidths=0.6,
            alpha=0.9 if self.overlay != "area" else 0.65,
            capstyle="round",
            joinstyle="round",
            zorder=2,
        )
        drawn.set_gid("grid")
        place.axes.add_collection(drawn, autolim=False)

    def _tint(self, pixels: NDArray[np.float64], raster: Raster) -> NDArray[np.float64]:
        """Pixels with the colours of how areas grow, and red where the map folds."""
        area = area_map(self.grids.field, raster)
        inside = np.isfinite(area) & (area > 0)
        powers = np.log2(np.where(inside, area, 1.0))
        beyond = ~self._shows_picture(raster)
        self.range = _range(powers[inside & ~beyond])
        colours = self._colours(np.clip(powers / self.range, -1, 1))
        tinted = 1 - (1 - pixels) * (1 - colours) if self.is_dark else pixels * colours
        tinted[~inside] = (1 - _FOLD_SHARE) * pixels[~inside] + _FOLD_SHARE * np.array(_rgb(FOLD_COLOUR))
        tinted[beyond] = pixels[beyond]
        self.has_folds = bool((~inside & ~beyond).any())
        return tinted

    def _shows_picture(self, raster: Raster) -> NDArray[np.bool_]:
        """Mask of the pixels of a deformed picture that show part of the original and not its surroundings."""
        a0, a1, b0, b1 = self.picture.raster.box
        a, b = self.grids.field.sample_on_raster(raster) + np.moveaxis(raster.points(), -1, 0)
        return np.asarray((a >= a0) & (a <= a1) & (b >= b0) & (b <= b1))

    def _colours(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Colours (..., 3) of powers of 2 in shares of the range."""
        ends = np.array([_rgb(name) for name in _AREAS[self.is_dark]])
        return np.stack([np.interp(t, np.linspace(-1, 1, len(ends)), ends[:, k]) for k in range(3)], axis=-1)

    def _crosses(self, place: _Place) -> None:
        from matplotlib.collections import LineCollection

        at, lengths, directions = self._arms()
        gain = self.gain = _gain(lengths)
        shown = np.isfinite(lengths) & (np.abs(lengths * gain) > 0.02)
        half = 0.5 * self.grids.cell * gain * np.abs(lengths)[..., None] * directions
        for grows in (False, True):
            mask = shown & ((lengths > 0) == grows)
            arms = list(np.stack([at[mask] - half[mask], at[mask] + half[mask]], axis=1))
            case = LineCollection(arms, colors=self.colours.paper, linewidths=2.8, alpha=0.75, zorder=3)
            ink = LineCollection(
                arms,
                colors=self.inks[grows],
                linewidths=1.4,
                zorder=4,
                linestyles="solid" if grows else [(0, (2.0, 1.2))],
            )
            ink.set_gid("stretched" if grows else "pressed")
            for drawn in (case, ink):
                place.axes.add_collection(drawn, autolim=False)

    def _arms(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Places (n, 2, 2), stretch - 1 (n, 2) and directions (n, 2, 2) of the arms of all crosses."""
        found = self.grids.found
        strain = self.grids.strain()
        at = np.repeat(self.grids.moved[found][:, None], 2, axis=1)
        return at, strain.principal[found] - 1, strain.directions[found]

    def _landmarks(self, before: _Place, after: _Place, points: ControlPoints) -> None:
        from matplotlib.patches import FancyArrowPatch

        paper = self.colours.paper
        before.axes.plot(*points.source.T, "o", mfc=paper, mec=SOURCE, mew=1.1, ms=3.6, ls="none", zorder=6)
        after.axes.plot(*points.target.T, "o", mfc=TARGET, mec=paper, mew=0.5, ms=4.2, ls="none", zorder=6)
        size = self.grids.cell
        for source, target in zip(points.source, points.target, strict=True):
            if np.linalg.norm(target - source) < 0.06 * size:
                continue
            after.axes.add_patch(
                FancyArrowPatch(
                    source,
                    target,
                    arrowstyle="-|>",
                    mutation_scale=5.5,
                    shrinkA=0,
                    shrinkB=2.4,
                    lw=0.8,
                    color=self.colours.ink,
                    zorder=5,
                )
            )
            after.axes.plot(*source, "o", mfc="none", mec=SOURCE, mew=0.9, ms=2.8, ls="none", zorder=5)

    # -- words ---

    def _text(self, x: float, y: float, words: str, **options: Any) -> Any:
        """Words at a place in inches from the lower left corner."""
        kind = {"family": "serif", "fontsize": _SMALL, "color": self.colours.ink, "va": "center", "parse_math": False}
        return self.figure.text(x / self.width, y / self.height, words, **{**kind, **options})

    def _line(self, x: tuple[float, float], y: tuple[float, float], **options: Any) -> None:
        from matplotlib.lines import Line2D

        options = {"color": self.colours.ink, "linewidth": 1.2, "solid_capstyle": "butt", **options}
        self.figure.add_artist(Line2D(np.array(x) / self.width, np.array(y) / self.height, **options))

    def write_title(self, words: list[str]) -> None:
        """The name in letters, the facts small below it."""
        if not words:
            return
        middle, top = self.width / 2, self.height - _MARGIN
        if len(words) == 1:
            self._text(middle, top - 0.14, words[0], ha="center", fontsize=_LETTERS)
            return
        self._text(middle, top - 0.09, words[0], ha="center", fontsize=_LETTERS + 1)
        self._text(middle, top - 0.27, words[1], ha="center", alpha=0.8)

    def _caption(self, place: _Place, letter: str, words: str) -> None:
        y = place.bottom - 0.15
        self._text(place.left, y, letter, fontsize=_LETTERS, weight="bold")
        self._text(place.left + 0.14, y, words, fontsize=_LETTERS - 1, style="italic")

    def _scale_bar(self, place: _Place, unit: str) -> None:
        length = _plain(0.22 * (place.box[1] - place.box[0]))
        right, y = place.left + place.width, place.bottom - 0.13
        left = right - length * self.scale
        self._line((left, right), (y, y), linewidth=1.6)
        for x in (left, right):
            self._line((x, x), (y - 0.03, y + 0.03), linewidth=0.8)
        self._text(left - 0.06, y, f"{length:g} {unit}".strip(), ha="right")

    def _area_key(self) -> None:
        """A bar of the colours with the numbers that they represent."""
        from matplotlib.patches import Rectangle

        cells, long, high = 48, 2.4, 0.1
        left, y = (self.width - long) / 2, _MARGIN + 0.2
        t = (np.arange(cells) + 0.5) / cells * 2 - 1
        paper = np.array(_rgb(self.colours.paper))
        shown = self._colours(t)
        shown = 1 - (1 - paper) * (1 - shown) if self.is_dark else paper * shown
        for k, color in enumerate(shown):  # a touch too wide each, or viewers show seams
            wide = long / cells * (1.6 if k + 1 < cells else 1)
            self.figure.add_artist(
                Rectangle(
                    ((left + k * long / cells) / self.width, y / self.height),
                    wide / self.width,
                    high / self.height,
                    color=color,
                    linewidth=0,
                    transform=self.figure.transFigure,
                )
            )
        self.figure.add_artist(
            Rectangle(
                (left / self.width, y / self.height),
                long / self.width,
                high / self.height,
                fill=False,
                edgecolor=self.colours.ink,
                linewidth=0.5,
                transform=self.figure.transFigure,
            )
        )
        for power in (-self.range, 0.0, self.range) if self.range < 2 else np.arange(-self.range, self.range + 1):
            self._text(left + long * (power / self.range + 1) / 2, y - 0.09, _factor(float(power)), ha="center")
        self._text(left - 0.1, y + high / 2, "area shrinks", ha="right", color=self.inks[0])
        folds = "; red: folds" if self.has_folds else ""
        self._text(left + long + 0.1, y + high / 2, f"area grows{folds}", color=self.inks[1])

    def _strain_key(self) -> None:
        """Two arms of a known strain, as they are drawn on the grid."""
        share = _plain(min(0.5, 0.8 / self.gain))
        arm = share * self.gain * self.grids.cell * self.scale
        y, middle = _MARGIN + 0.18, self.width / 2
        for grows, start, words in ((True, middle - 2.75, "stretched"), (False, middle - 0.75, "pressed")):
            style = "solid" if grows else (0, (2.0, 1.2))
            self._line((start - arm, start), (y, y), color=self.inks[grows], linewidth=1.6, linestyle=style)
            self._text(start + 0.07, y, f"{words} by {100 * share:.3g} %")
        size = "in their own size" if self.gain == 1 else f"{_gain_text(self.gain)} \u00d7 {self.gain:g}"
        self._text(middle + 0.85, y, f"arms: stretch \u2212 1, {size}", alpha=0.8)


class _Place:
    """A panel: its axes, its content, and its box in inches."""

    def __init__(
        self, axes: Axes, box: PictureBox, left: float = 0, bottom: float = 0, width: float = 0, height: float = 0
    ) -> None:
        self.axes, self.box = axes, box
        self.left, self.bottom, self.width, self.height = left, bottom, width, height


# ---- pixels and numbers ----------------------------------------------------------------------------------------------


def _apply_ink(picture: Picture, colours: Style) -> NDArray[np.float64]:
    """(nv, nu, 3) in [0, 1], as the style prints a picture."""
    dark, bright = np.array(_rgb(colours.dark)), np.array(_rgb(colours.bright))
    if picture.values.ndim == 3:
        return np.asarray(picture.rgb8(tuple(dark.tolist())) / 255.0)
    return np.asarray(dark + (picture.grey()[..., None] ** colours.gamma) * (bright - dark))


def _warp_picture(picture: Picture, field: AbstractField, raster: Raster) -> Picture:
    values = warp_picture(picture.values, picture.raster, field, output=raster)
    return replace(picture, values=values, raster=raster)


def _rgb(name: str) -> tuple[float, float, float]:
    r, g, b = (int(name[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return r, g, b


def _luminance(name: str) -> float:
    r, g, b = _rgb(name)
    return 0.2126 * r + 0.7152 * g + 0.0722 * b


def _range(powers: NDArray[np.float64]) -> float:
    """The powers of 2 that colours reach: the least that holds all but one place in fifty."""
    most = float(np.quantile(np.abs(powers), 0.98)) if powers.size else 0.0
    return next((r for r in _RANGES if r >= most), _RANGES[-1])


def _gain(strains: NDArray[np.float64]) -> float:
    """A plain factor by which the longest arm, but one in twenty, is nearly a cell long."""
    known = np.abs(strains[np.isfinite(strains)])
    most = float(np.quantile(known, 0.95)) if known.size else 0.0
    return _plain(_LONGEST / most) if most > 1e-9 else 1.0


def _plain(most: float) -> float:
    """The largest of 1, 2, 5, 10 ... up to a number."""
    power = 10.0 ** floor(log10(most))
    return max(step * power for step in _PLAIN if step * power <= most * (1 + 1e-9))


def _factor(power: float) -> str:
    """2 to a power, as people write it: 1/4, 1/2, 1, 2, or a number with two digits."""
    if power == round(power):
        return f"{2 ** int(power)}" if power >= 0 else f"1/{2 ** int(-power)}"
    return f"{2**power:.2g}"


def _magnification_text(magnify: float) -> str:
    """Exaggeration of a drawing, in words."""
    if magnify == 1:
        return "deformed"
    if magnify == 0:
        return "not dragged at all (\u00d7 0)"
    if magnify > 0:
        return f"deformed, dragged {magnify:g} times as far"
    return f"deformed in the opposite direction (\u00d7 \u2212{-magnify:g})"


def _gain_text(gain: float) -> str:
    return "exaggerated" if gain > 1 else "drawn"


WIDTH = 7.2
"""Inches of a figure: two columns of a journal."""


def draw_grids(
    what: Step | Deformation | AbstractField,
    picture: Picture,
    *,
    lines: int = 12,
    overlay: GridOverlay = "none",
    magnify: float = 1.0,
    grid: Grid | VolumeLike | None = None,
    key: int = 0,
    landmarks: bool = True,
    title: str | None = None,
    unit: str | None = None,
    style: StyleName = "paper",
    width: float = WIDTH,
    path: str | PathLike[str] | None = None,
    axes: Sequence[Axes] | None = None,
) -> Figure:
    """The picture on a regular grid, and the deformed picture on the deformed grid.

    Parameters
    ----------
    what : a step on the picture's plane, a deformation whose steps are all on it, or any field of dimension 2.
    picture : as it was before.
    lines : cells of the grid along the longer side of the picture.
    overlay : a name of :data:`GRID_OVERLAYS`: "area" colours how tissue grows (green) and shrinks (purple), "strain"
        draws crosses along the principal directions, solid where tissue is stretched and dashed where it is pressed.
    magnify : factor of all displacements: 0 the original, 1 unchanged, 2 exaggerated, -1 the opposite.
        The points of a step are fitted again, exactly; a field given as such is multiplied.
    grid : of the volume, from which the support radius of a single point is derived; default is that of the picture.
    key : which set of control points of a step, for the rule "interpolate".
    landmarks : whether control points are drawn, with arrows to their targets.
    title : default is the name of the step, and facts about its fit.
    unit : of lengths, as it is written; default is that of the grid.
    style : a name of :data:`~deformnb.imaging.drawing.STYLES`; width : of the figure, inches.
    path : where to write a PNG, PDF or SVG, in place of an older file; nothing is written without it.
    axes : two of a figure of one's own, for the picture as it was and for the deformed one. That figure is not changed,
        so titles, captions, the key and the scale bar are its owner's.

    Returns
    -------
    matplotlib Figure, not registered with pyplot; its ``savefig`` stores text as text, and its ``grids`` is a
        :class:`~deformnb.imaging.thompson.Grids`, the numbers that are drawn. With ``axes`` it is that of the first.

    Raises
    ------
    DeformError
        For an unknown name, a step on another plane or in space, or a fit that is not possible when magnified.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> from deformnb.volume.plane import Plane, Raster
    >>> raster = Raster((20, 30), (1.0, 1.0), (0.0, 0.0))
    >>> plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    >>> picture = Picture(np.zeros((20, 30), np.uint8), plane, raster, "mip", (0.0, 1.0))
    >>> draw_grids(Identity(2), picture, lines=6).grids.nodes.shape
    (5, 7, 2)
    """
    for name, value, known in (("overlay", overlay, GRID_OVERLAYS), ("style", style, tuple(STYLES))):
        check_choice(value, known, name)
    magnify = finite_number(magnify, "magnify must be a finite number")
    if not isinstance(picture, Picture):
        raise DeformError(f"a Picture is needed, got {short_value(picture)}; project(volume, view) makes one.")
    if finite_number(width, "the width of a figure must be a positive number of inches") <= 0:
        raise DeformError(f"the width of a figure must be a positive number of inches, got {width}.")
    if not isinstance(key, int | np.integer) or key < 0:
        raise DeformError(f"key is the number of a set of control points from 0 on, got {short_value(key)}.")
    if not isinstance(unit, str | None) or not isinstance(title, str | None):
        raise DeformError(f"title and unit are texts, got {short_value(title)} and {short_value(unit)}.")
    grid = None if grid is None else as_grid(grid)
    if unit is None:
        seen = grid or picture.grid
        unit = "" if seen is None else seen.unit
    steps = steps_of(what, picture, magnify)
    grids = make_grids(field_of(what, steps, picture, magnify, grid, key), picture, lines)
    given = check_axes(axes, 2, path)
    sheet = Sheet(picture, grids, overlay, STYLES[style], width, given)
    sheet.draw(landmarks_of(steps, key) if landmarks else None, unit, steps[0].strength if len(steps) == 1 else magnify)
    if not given:
        sheet.write_title(_title(title, steps, key))
    if path is not None:
        save_figure(sheet.figure, path)
    return sheet.figure


def _title(title: str | None, steps: tuple[Step, ...], key: int) -> list[str]:
    if title is not None or len(steps) != 1:
        return [title] if title else []
    return [text for text in (steps[0].name, _facts(steps[0], key)) if text]


def _facts(step: Step, key: int) -> str:
    """Facts about the fit of a step: number of landmarks, affine share, bending energy."""
    points = landmarks_of((step,), key)
    assert points is not None
    facts = [f"{len(points)} landmark{'' if len(points) == 1 else 's'}"]
    if len(points) > points.dim + 1 and points.displacement.any():
        share, _ = affine_split(points)
        facts += [f"{100 * share:.0f} % of the drags affine", f"bending energy {bending_energy(points):.3g}"]
    return ", ".join(facts)

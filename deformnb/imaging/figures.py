"""Figures of several panels, arranged and lettered as in the paper: pictures, grids, points, cuts, rendered volumes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._typing import PictureBox
from deformnb.document.deformation import Step
from deformnb.errors import DeformError
from deformnb.imaging.drawing import (
    SOURCE,
    STYLES,
    TARGET,
    Style,
    StyleName,
    check_axes,
    figure_of,
    save_figure,
    show_picture,
)
from deformnb.rbf.cuts import Cut, Decoupled
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import AbstractRegion, Line
from deformnb.rbf.rigid import RigidPart
from deformnb.rbf.support import lone_support
from deformnb.volume.plane import Picture
from deformnb.volume.volume import Grid
from deformnb.warping.points import warp_points

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Lines = list[NDArray[np.float64]]

CUT_COLOUR = "#F0C000"
"""The line of a cut: yellow, as in the paper."""

SIDE_COLOURS = ("#C8102E", "#1E9E4A")
"""Points outside and inside of a cut: red and green, as in the paper; rings and discs distinguish them as well."""

PART = "#4C9BE8"
"""Rigid parts."""

PointPlace: TypeAlias = Literal["source", "target", "both"]
"""Names of the places of control points that a panel shows."""

WHERE: tuple[PointPlace, ...] = get_args(PointPlace)
"""Places of control points that a panel shows; "both" joins them by arrows."""

_GAP = 0.10  # inches between panels
_CAPTION = 0.27  # inches below a panel
_LETTERS = 8.5  # points
_FINE = 240  # samples along the longer side to find the outline of a region


@dataclass(frozen=True, eq=False)
class Panel:
    """One field of a figure.

    Parameters
    ----------
    picture : a picture of a volume, an image (height, width, 3) uint8 such as a rendered volume, or None for an empty
        sheet with lines and points.
    caption : text after its letter.
    grid : polylines (n, 2) in picture coordinates.
    points : control points.
    at : a name of :data:`WHERE`.
    cuts : lines that are drawn yellow; the points on their sides are then red and green.
    parts : rigid parts, drawn as shaded places.
    box : the visible part, (a_min, a_max, b_min, b_max); default is the picture and its grid.
    """

    picture: Picture | NDArray[np.uint8] | None = None
    caption: str = ""
    grid: Sequence[NDArray[np.float64]] = ()
    points: ControlPoints | None = None
    at: PointPlace = "both"
    cuts: Sequence[Cut] = ()
    parts: Sequence[RigidPart] = ()
    box: PictureBox | None = None

    def __post_init__(self) -> None:
        if self.at not in WHERE:
            raise DeformError(f"points are shown at {', '.join(WHERE)}, not at {self.at!r}.")
        if isinstance(self.picture, np.ndarray):
            if self.picture.ndim != 3 or self.picture.shape[2] != 3 or self.picture.dtype != np.uint8:
                raise DeformError(
                    "an image for a panel is an array (height, width, 3) of uint8, got "
                    f"{self.picture.shape} of {self.picture.dtype}."
                )
        elif self.picture is None and self.box is None and len(self.grid) == 0:
            raise DeformError("a panel without a picture needs a box or a grid, else it has no size.")

    @property
    def limits(self) -> PictureBox:
        """Limits of the panel, in picture coordinates; in pixels for an image."""
        if isinstance(self.picture, np.ndarray):
            return -0.5, self.picture.shape[1] - 0.5, -0.5, self.picture.shape[0] - 0.5
        if self.box is not None:
            return self.box
        boxes = [] if self.picture is None else [self.picture.raster.box]
        boxes += [(*_range(line[:, 0]), *_range(line[:, 1])) for line in self.grid]
        a0, a1, b0, b1 = np.array(boxes).T
        air = 0.01 * max(np.ptp([a0.min(), a1.max()]), np.ptp([b0.min(), b1.max()]))
        return float(a0.min() - air), float(a1.max() + air), float(b0.min() - air), float(b1.max() + air)


def _range(values: NDArray[np.float64]) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def draw_figure(
    rows: Sequence[Sequence[Panel]],
    *,
    style: StyleName = "paper",
    width: float = 7.5,
    tallest: float = 4.0,
    lettered: bool = True,
    path: str | PathLike[str] | None = None,
    axes: Sequence[Axes] | None = None,
) -> Figure:
    """Panels in rows, those of a row equally high, with the letters (a), (b) ... and captions below.

    Parameters
    ----------
    rows : panels from left to right, from the first row down.
    style : a name of :data:`~deformnb.imaging.drawing.STYLES`.
    width, tallest : of the figure, and of a row at most; inches.
    lettered : False leaves the letters out.
    path : where to write a PNG, PDF or SVG, in place of an older file; nothing is written without it.
    axes : of a figure of one's own, one for each panel in the order of their letters; that figure is not changed, and
        ``width`` and ``tallest`` say nothing.

    Returns
    -------
    matplotlib Figure, not known to pyplot; with ``axes`` that of the first of them.

    Examples
    --------
    >>> figure = draw_figure([[Panel(box=(0, 2, 0, 1)), Panel(box=(0, 1, 0, 1))]], lettered=False)
    >>> [round(float(a.get_position().width) * 7.5, 1) for a in figure.axes]
    [4.8, 2.4]
    """
    from matplotlib.figure import Figure

    if style not in STYLES:
        raise DeformError(f"unknown style {style!r}; choose one of {', '.join(STYLES)}.")
    if not rows or not all(rows):
        raise DeformError("a figure needs at least one row, and each row at least one panel.")
    colours = STYLES[style]
    if given := check_axes(axes, sum(map(len, rows)), path):
        for letter, (panel, place) in enumerate(zip((panel for row in rows for panel in row), given, strict=True)):
            _fill(place, panel, colours)
            room = 72 * figure_of(place).get_figwidth() * place.get_position().width
            _caption(place, _lettered(panel, letter if lettered else None), colours, room)
        return figure_of(given[0])
    sizes = [_row_sizes([panel.limits for panel in row], width, tallest) for row in rows]
    feet = [_CAPTION if lettered or any(panel.caption for panel in row) else 0.0 for row in rows]
    height = _GAP + sum(row[0][1] + foot + _GAP for row, foot in zip(sizes, feet, strict=True))
    figure = Figure(figsize=(width, height), facecolor=colours.paper)
    letter, top = 0, height - _GAP
    for row, row_sizes, foot in zip(rows, sizes, feet, strict=True):
        left = (width - sum(w for w, _ in row_sizes) - _GAP * (len(row) - 1)) / 2
        for panel, (w, h) in zip(row, row_sizes, strict=True):
            place = figure.add_axes((left / width, (top - h) / height, w / width, h / height))
            _fill(place, panel, colours)
            _caption(place, _lettered(panel, letter if lettered else None), colours, 72 * (w + _GAP / 2))
            left, letter = left + w + _GAP, letter + 1
        top -= row_sizes[0][1] + foot + _GAP
    if path is not None:
        save_figure(figure, path)
    return figure


def _lettered(panel: Panel, letter: int | None) -> str:
    """The caption of a panel behind its letter, if it has one."""
    return (f"({chr(ord('a') + letter)}) " if letter is not None else "") + panel.caption


def _row_sizes(boxes: Sequence[PictureBox], width: float, tallest: float) -> list[tuple[float, float]]:
    """(width, height) of panels that fill a row, in inches."""
    aspects = [(b[1] - b[0]) / (b[3] - b[2]) for b in boxes]
    height = min(tallest, (width - _GAP * (len(boxes) + 1)) / sum(aspects))
    return [(aspect * height, height) for aspect in aspects]


def _fill(axes: Axes, panel: Panel, colours: Style) -> None:
    box = panel.limits
    if isinstance(panel.picture, np.ndarray):
        axes.imshow(panel.picture, interpolation="antialiased")
    elif panel.picture is not None:
        show_picture(axes, panel.picture, colours)
    for part in panel.parts:
        _outline(axes, part.region, box, PART, fill=True)
    ink = colours.grid if panel.picture is not None else colours.ink
    for line in panel.grid:
        axes.plot(line[:, 0], line[:, 1], color=ink, linewidth=0.7, alpha=0.9, solid_joinstyle="round")
    for cut in panel.cuts:
        _outline(axes, cut.region, box, CUT_COLOUR, fill=False)
    if panel.points is not None:
        _points(axes, panel.points, panel, colours)
    axes.set(xlim=box[:2], ylim=(box[3], box[2]), aspect="equal")
    axes.set_axis_off()


def _outline(axes: Axes, region: AbstractRegion, box: PictureBox, color: str, *, fill: bool) -> None:
    """Zero contour of the signed distance of a region of any kind."""
    step = max(box[1] - box[0], box[3] - box[2]) / _FINE
    a, b = (np.linspace(low, high, max(2, round((high - low) / step))) for low, high in (box[:2], box[2:]))
    places = np.stack(np.meshgrid(a, b), axis=-1)
    distance = region.signed_distance(places)
    if isinstance(region, Line) and any(region.stops):  # nothing is drawn beyond a tip
        distance = np.ma.masked_where(region.opening(places) == 0, distance)
    if fill and distance.min() < 0:
        axes.contourf(a, b, distance, levels=[distance.min(), 0.0], colors=[color], alpha=0.35)
    if distance.min() < 0 < distance.max():
        axes.contour(a, b, distance, levels=[0.0], colors=["#4a3a00" if not fill else color], linewidths=2.6 - fill)
        if not fill:
            axes.contour(a, b, distance, levels=[0.0], colors=[color], linewidths=1.7)


def _points(axes: Axes, points: ControlPoints, panel: Panel, colours: Style) -> None:
    """Rings at sources, discs at targets; with cuts red or green by the side of the source."""
    arrow: dict[str, Any] = {"arrowstyle": "-|>", "color": colours.ink, "linewidth": 0.8, "shrinkA": 3, "shrinkB": 3}
    moved = np.abs(points.source - points.target).max(axis=1) > 0
    inside = panel.cuts[0].region.signed_distance(points.source) < 0 if panel.cuts else moved
    for k in np.flatnonzero(points.active):
        source, target = points.source[k], points.target[k]
        colors = (SIDE_COLOURS[int(inside[k])],) * 2 if panel.cuts else (SOURCE, TARGET)
        if panel.at == "both" and moved[k]:
            axes.annotate("", xy=target, xytext=source, arrowprops=arrow)
        if panel.at != "target":
            axes.plot(*source, "o", mfc="white", mec=colors[0], mew=1.4, markersize=5)
        if panel.at != "source":
            axes.plot(*target, "o", mfc=colors[1], mec="white", mew=0.6, markersize=5.6)


def _caption(axes: Axes, text: str, colours: Style, room: float) -> None:
    size = min(_LETTERS, max(5.0, room / (0.5 * max(1, len(text)))))
    axes.annotate(
        text,
        (0.5, 0),
        (0, -4),
        xycoords="axes fraction",
        textcoords="offset points",
        ha="center",
        va="top",
        color=colours.ink,
        fontsize=size,
        family="serif",
        parse_math=False,
    )


# ---- grids -----------------------------------------------------------------------------------------------------------


def rectangular_grid(box: PictureBox, columns: int, rows: int) -> Lines:
    """A rectangular grid over a box: so many cells across and down.

    Examples
    --------
    >>> len(rectangular_grid((0, 4, 0, 2), 4, 2))
    8
    """
    a, b = np.linspace(box[0], box[1], columns + 1), np.linspace(box[2], box[3], rows + 1)
    across = [np.column_stack([a, np.full(len(a), y)]) for y in b]
    return [*across, *(np.column_stack([np.full(len(b), x), b]) for x in a)]


def picture_field(step: Step, grid: Grid, key: int = 0) -> AbstractField:
    """The displacement of the picture that a step deforms, before it is extruded into the volume.

    Parameters
    ----------
    step : one on a plane, with or without rigid parts and cuts.
    grid : of the volume.
    key : which set of control points, for the rule "interpolate".
    """
    if step.plane is None:
        raise DeformError("this step has its control points in space and deforms no picture; use step.field(grid).")
    return step.settings.fit(
        step.maps[key],
        step.parts,
        step.cut_regions,
        cut_rule=step.cut_rule,
        softness=min(grid.spacing),
        lone=lone_support(grid),
    )


def deform_lines(lines: Sequence[ArrayLike], field: AbstractField, parts: int = 12) -> Lines:
    """Lines drawn on the tissue, after the deformation; a line that crosses a cut or a fold is split.

    Parameters
    ----------
    lines : polylines (n, 2) on the picture (or (n, 3) in space, for such a field).
    field : backward displacements; decoupled ones split the lines.
    parts : pieces that each segment is divided into, so that it can bend.

    Examples
    --------
    >>> from deformnb.rbf.fields import Identity
    >>> deform_lines([[[0, 0], [4, 0]]], Identity(2), parts=2)[0].tolist()
    [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0]]
    """
    fine = [_subdivide(np.asarray(line, dtype=np.float64), parts) for line in lines]
    if isinstance(field, Decoupled):
        return [
            moved for line in fine for piece in _split_at_cuts(line, field) for moved in _deform_piece(piece, field)
        ]
    places = np.concatenate(fine)
    moved, joined = _follow_line(places, field)
    ends = np.cumsum([len(line) for line in fine])[:-1]
    joined[ends - 1] = False
    return _runs(moved, joined)


def _split_at_cuts(line: NDArray[np.float64], field: Decoupled) -> Lines:
    """The pieces of a line between the cuts; each ends on the cut itself."""
    start, end = line[:-1, None], line[1:, None]
    distances = np.stack([region.signed_distance(line) for region in field.regions], axis=-1)
    crossed = (distances[:-1] < 0) != (distances[1:] < 0)
    change = np.where(crossed, distances[:-1] - distances[1:], 1.0)
    share = np.where(crossed, distances[:-1] / change, 2.0)
    at = (np.arange(len(line) - 1)[:, None] + share)[crossed]
    places = (start + share[..., None] * (end - start))[crossed]
    order = np.argsort(at, kind="stable")
    pieces, begin, first = [], 0, line[:0]
    for k in order.tolist():
        upto = int(np.floor(at[k])) + 1
        pieces.append(np.concatenate([first, line[begin:upto], places[[k]]]))
        begin, first = upto, places[[k]]
    pieces.append(np.concatenate([first, line[begin:]]))
    return [piece for piece in pieces if len(piece) > 1]


def _deform_piece(piece: NDArray[np.float64], field: Decoupled) -> Lines:
    """A piece of a line moved with the field of its region, and the parts of it that the rule of the cuts shows."""
    middle = piece[[len(piece) // 2]] if len(piece) > 2 else piece.mean(axis=0, keepdims=True)
    fit = next(f for mask, f in field.fields_by_source(middle) if mask[0])
    moved, joined = (piece, np.ones(len(piece) - 1, dtype=bool)) if fit is None else _follow_line(piece, fit)
    if field.rule == "paper":
        seen = (_sides(field, moved) == _sides(field, middle)).all(axis=-1)
        joined &= seen[1:] & seen[:-1]
    return _runs(moved, joined)


def _follow_line(line: NDArray[np.float64], field: AbstractField) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Displaced places of a line, and its segments with both ends: none across a fold."""
    moved, found = warp_points(line, field)
    middle, expected = (moved[1:] + moved[:-1]) / 2, (line[1:] + line[:-1]) / 2
    off = np.linalg.norm(middle + field.displacement(middle) - expected, axis=1)
    return moved, found[1:] & found[:-1] & (off <= np.linalg.norm(np.diff(line, axis=0), axis=1))


def _runs(line: NDArray[np.float64], joined: NDArray[np.bool_]) -> Lines:
    """The stretches of a line whose segments, one less than its places, are joined."""
    runs = np.split(np.arange(len(line)), np.flatnonzero(~joined) + 1)
    return [line[run] for run in runs if len(run) > 1]


def _sides(field: Decoupled, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.stack([region.signed_distance(points) < 0 for region in field.regions], axis=-1)


def _subdivide(line: NDArray[np.float64], parts: int) -> NDArray[np.float64]:
    at = np.linspace(0, len(line) - 1, (len(line) - 1) * parts + 1)
    return np.stack([np.interp(at, np.arange(len(line)), line[:, k]) for k in range(line.shape[1])], axis=-1)


def trim(images: Sequence[NDArray[np.uint8]], margin: float = 0.03) -> list[NDArray[np.uint8]]:
    """Images of one height without their empty sides: the same rows of all, so that they have one scale.

    Parameters
    ----------
    images : (height, width, 3) each; their first pixel is the background.
    margin : share of the height that is left empty around the foreground.
    """
    seen = [(np.abs(image.astype(int) - image[0, 0]) > 3).any(axis=2) for image in images]
    if len({image.shape[0] for image in images}) != 1 or not all(mask.any() for mask in seen):
        return list(images)
    rows = np.flatnonzero(np.any([mask.any(axis=1) for mask in seen], axis=0))
    air = round(margin * images[0].shape[0])
    top, bottom = max(0, rows[0] - air), rows[-1] + air + 1
    sides = [np.flatnonzero(mask.any(axis=0)) for mask in seen]
    return [
        image[top:bottom, max(0, columns[0] - air) : columns[-1] + air + 1]
        for image, columns in zip(images, sides, strict=True)
    ]

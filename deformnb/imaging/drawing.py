"""Plots of pictures with grids, control points and titles for print, by Matplotlib without its global state."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import PictureBox
from deformnb.checks import check_choice, short_value
from deformnb.errors import DeformError
from deformnb.io.files.atomic import atomic_write
from deformnb.io.files.errors import printable
from deformnb.io.files.paths import as_path
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Colours of sources and targets that are distinct for every kind of colour-blindness (Okabe and Ito 2008).
SOURCE = "#0072B2"
TARGET = "#D55E00"


# Printed size of the longer side, inches; with 200 dots an inch a picture of 512 pixels loses none.
_LONG_SIDE = 7.0
_DPI = 200
_HEAD = 0.3  # inches for a title
_TITLE = 10.0  # points
_NARROWEST = 1.5  # inches that a title has in any case
# Ink is darker than light is bright: this exponent gives tissue and bone of a MIP about the weight they have on black.
_INK = 1.25


@dataclass(frozen=True)
class Style:
    """Colours of a drawing: paper, ink, and the two ends of the picture's grey scale."""

    paper: str
    ink: str
    dark: str
    bright: str
    grid: str
    gamma: float = 1.0


StyleName: TypeAlias = Literal["paper", "dark"]
"""Names of the styles."""

STYLES = {
    "paper": Style("#f6f0e1", "#2b2118", "#f6f0e1", "#2b2118", "#8c2f1b", _INK),
    "dark": Style("#101114", "#e8e6e3", "#101114", "#f5f2ea", "#f2b134"),
}
"""Styles by name; "paper" prints the picture as ink on cream, like Thompson's plates."""


def draw_pictures(
    pictures: Picture | Sequence[Picture],
    *,
    grids: Sequence[Sequence[NDArray[np.float64]]] | None = None,
    points: Sequence[ControlPoints | None] | None = None,
    titles: Sequence[str] | None = None,
    style: StyleName = "paper",
    path: str | PathLike[str] | None = None,
    ax: Axes | Sequence[Axes] | None = None,
) -> Figure:
    """Pictures side by side (one above the other if they are wide), all to the same scale.

    Parameters
    ----------
    pictures : one or more.
    grids : for each picture, polylines (n, 2) in its picture coordinates, such as a Thompson grid.
    points : for each picture, control points drawn as arrows from source to target; None for none.
    titles : for each picture.
    style : a name of :data:`STYLES`.
    path : where to write a PNG, PDF or SVG, in place of an older file; nothing is written without it.
    ax : axes of a figure of one's own, one for each picture, into which they are drawn; that figure is not changed.

    Returns
    -------
    matplotlib Figure, not registered with pyplot; with ``ax`` that of the first axes.

    Examples
    --------
    >>> from deformnb.datasets.phantoms import PHANTOMS
    >>> from deformnb.imaging.projection import project
    >>> figure = draw_pictures([project(PHANTOMS["bar"].make((8, 8, 16)), "+y")], titles=["a bar"])
    >>> len(figure.axes)
    1
    """
    from matplotlib.figure import Figure

    check_choice(style, STYLES, "style")
    pictures = [pictures] if isinstance(pictures, Picture) else _check_list(pictures, "pictures", Picture)
    if not pictures:
        raise DeformError("there is no picture to draw.")
    grids, points = (
        _check_list(grids, "grids", Sequence | np.ndarray),
        _check_list(points, "points", ControlPoints | None),
    )
    titles = _check_list(titles, "titles", str)
    for what, given in (("grids", grids), ("sets of points", points), ("titles", titles)):
        if given and len(given) != len(pictures):
            raise DeformError(f"there are {len(pictures)} pictures but {len(given)} {what}; give one for each.")
    if path is not None:
        _format(path)
    colours = STYLES[style]
    boxes = [_box(p, grids[k] if grids else ()) for k, p in enumerate(pictures)]
    given = check_axes(ax, len(pictures), path)
    figure = figure_of(given[0]) if given else Figure(facecolor=colours.paper)
    places = given or [figure.add_axes(place) for place in _layout(figure, boxes, titled=bool(titles))]
    for k, (picture, axes) in enumerate(zip(pictures, places, strict=True)):
        _draw(axes, picture, boxes[k], colours, grids[k] if grids else (), points[k] if points else None)
        if titles:
            _title(axes, titles[k], colours)
    if path is not None:
        save_figure(figure, path)
    return figure


def check_axes(given: Any, count: int, path: object = None) -> list[Axes]:
    """The axes of a figure of someone else into which something is drawn, so many; none for None.

    Raises
    ------
    DeformError
        If they are something else, or other ones in number, or a ``path`` is given: who owns a figure writes it.

    Examples
    --------
    >>> from matplotlib.figure import Figure
    >>> axes = Figure().subplots(1, 2)
    >>> check_axes(None, 2), len(check_axes(axes, 2)), len(check_axes(axes[0], 1))
    ([], 2, 1)
    """
    if given is None:
        return []
    from matplotlib.axes import Axes

    found = [given] if isinstance(given, Axes) else list(np.ravel(np.asarray(given, dtype=object)))
    if not all(isinstance(one, Axes) for one in found):
        raise DeformError(f"axes of Matplotlib are needed to draw into, got {short_value(given)}.")
    if len(found) != count:
        raise DeformError(f"{count} axes are needed to draw into, one for each picture, got {len(found)}.")
    if path is not None:
        raise DeformError("a figure of your own is written by its savefig; give either axes or a path.")
    return found


def figure_of(axes: Axes) -> Figure:
    """The figure that holds some axes, directly or in a part of it."""
    figure: Any = axes.get_figure(root=True)
    return figure


def _check_list(given: Any, what: str, kind: Any) -> list[Any]:
    """The items of a list, each of a kind; none for None."""
    if given is None:
        return []
    if not isinstance(given, Sequence) or isinstance(given, str) or not all(isinstance(one, kind) for one in given):
        name = f"{kind.__name__} objects" if kind is Picture else "one for each picture"
        raise DeformError(f"{what} are a list ({name}), got {short_value(given)}.")
    return list(given)


def _layout(figure: Figure, boxes: Sequence[PictureBox], *, titled: bool) -> list[PictureBox]:
    """Size the figure and place the pictures in it to one scale: (left, bottom, width, height) in figure shares."""
    sizes = np.array([(b[1] - b[0], b[3] - b[2]) for b in boxes])
    sizes = sizes * (_LONG_SIDE / sizes.max())  # inches
    head, gap = (_HEAD if titled else 0.0), 0.08
    stacked = bool(sizes[:, 0].mean() > 1.2 * sizes[:, 1].mean())
    cells = np.maximum(sizes, (_NARROWEST if titled else 0.0, 0.0)) + np.array([gap, head + gap])
    full = (cells[:, 0].max(), cells[:, 1].sum()) if stacked else (cells[:, 0].sum(), cells[:, 1].max())
    width, height = full[0] + gap, full[1] + gap
    figure.set_size_inches(width, height)
    places, x, y = [], gap, height - gap
    for (w, h), (cell_w, cell_h) in zip(sizes, cells, strict=True):
        left = (width - w) / 2 if stacked else x + (cell_w - gap - w) / 2
        bottom = y - head - h if stacked else (height - head - h) / 2
        places.append((left / width, bottom / height, w / width, h / height))
        x, y = (x, y - cell_h) if stacked else (x + cell_w, y)
    return places


def _title(axes: Axes, title: str, colours: Style) -> None:
    """A title as it is: names of files may hold dollars, line breaks, or be long."""
    inches = figure_of(axes).get_figwidth() * axes.get_position().width
    room = 72 * max(inches, _NARROWEST)
    text = printable(title, int(room / 3.5))
    size = min(_TITLE, max(5.0, room / (0.66 * max(1, len(text)))))  # most letters are narrower than 0.66 of it
    axes.set_title(text, color=colours.ink, fontsize=size, family="serif", pad=5, parse_math=False)


def save_figure(figure: Figure, path: str | PathLike[str]) -> None:
    """Write a figure in the format of the path's suffix, atomically."""
    suffix = _format(path)
    with atomic_write(path) as stream, warnings.catch_warnings():
        # A name in a script that the font lacks is drawn as boxes; that is no reason to write to standard error.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font", category=UserWarning)
        figure.savefig(stream, format=suffix, dpi=_DPI, facecolor=figure.get_facecolor())


def _format(path: str | PathLike[str]) -> str:
    name = as_path(path)
    suffix = name.suffix.lower().removeprefix(".")
    if suffix not in ("png", "pdf", "svg"):
        raise DeformError(f"a figure is written as .png, .pdf or .svg, not as {printable(name.name)}.")
    return suffix


def _box(picture: Picture, grid: Sequence[NDArray[np.float64]]) -> PictureBox:
    """Limits of the plot: the picture and all of its grid, with a little margin."""
    a0, a1, b0, b1 = picture.raster.box
    for line in grid:
        a0, b0 = min(a0, float(line[:, 0].min())), min(b0, float(line[:, 1].min()))
        a1, b1 = max(a1, float(line[:, 0].max())), max(b1, float(line[:, 1].max()))
    air = 0.01 * max(a1 - a0, b1 - b0)
    return a0 - air, a1 + air, b0 - air, b1 + air


def _draw(
    axes: Axes,
    picture: Picture,
    box: PictureBox,
    colours: Style,
    grid: Sequence[NDArray[np.float64]],
    points: ControlPoints | None,
) -> None:
    show_picture(axes, picture, colours)
    for line in grid:
        axes.plot(line[:, 0], line[:, 1], color=colours.grid, linewidth=0.8, alpha=0.9, solid_joinstyle="round")
    if points is not None:
        _draw_points(axes, points, colours)
    axes.set(xlim=box[:2], ylim=(box[3], box[2]), aspect="equal")
    axes.set_axis_off()


def show_picture(axes: Axes, picture: Picture, colours: Style) -> None:
    """Draw the pixels of a picture in a style, at their places."""
    from matplotlib.colors import LinearSegmentedColormap, to_rgb

    if picture.values.ndim == 3 or picture.colour_map != "grey":
        axes.imshow(picture.rgb8(to_rgb(colours.dark)), extent=picture.extent, interpolation="bilinear")
        return
    inks = LinearSegmentedColormap.from_list("inks", [colours.dark, colours.bright])
    axes.imshow(
        picture.grey() ** colours.gamma, cmap=inks, vmin=0, vmax=1, extent=picture.extent, interpolation="bilinear"
    )


def _draw_points(axes: Axes, points: ControlPoints, colours: Style) -> None:
    arrow: dict[str, Any] = {"arrowstyle": "-|>", "color": colours.ink, "linewidth": 0.8, "shrinkA": 2, "shrinkB": 2}
    for s, t, active in zip(points.source, points.target, points.active, strict=True):
        if active and np.abs(s - t).max() > 0:
            axes.annotate("", xy=(t[0], t[1]), xytext=(s[0], s[1]), arrowprops=arrow)
    axes.plot(*points.source.T, "o", mfc="none", mec=SOURCE, markersize=4, linestyle="none")
    axes.plot(*points.target.T, "o", color=TARGET, markersize=4, linestyle="none")

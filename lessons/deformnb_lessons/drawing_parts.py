"""Parts of the figures of lessons and worksheets: Thompson's drawings, grids, squared paper, tables."""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from deformnb._typing import Floats
from deformnb.datasets import PLATE_SOURCE, custom_grid, thompson_grid, thompson_plate
from deformnb.imaging.figures import Panel, draw_figure
from deformnb.words import translate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NODES = "#d55e00"
"""Colour of Thompson's nodes, and of what is to be read from a figure."""

_DPI = 110
_INK = "#202020"
_TABLE = "border-collapse: collapse; text-align: right"
_CELL = "padding: 2px 10px; border: 1px solid #999"


class Drawing:
    """A figure with its description, which a notebook shows as a picture.

    Parameters
    ----------
    figure : of Matplotlib, not known to pyplot.
    words : what it shows, for somebody who does not see it.

    Examples
    --------
    >>> draw_rules()
    A square grid, a shear, a taper and a polar grid
    """

    def __init__(self, figure: Figure, words: str) -> None:
        self.figure, self.words = figure, translate(words)

    def __repr__(self) -> str:
        return self.words

    def png(self) -> bytes:
        """The picture."""
        stream = io.BytesIO()
        self.figure.savefig(stream, format="png", dpi=_DPI)
        return stream.getvalue()

    def _repr_mimebundle_(self, **_options: Any) -> tuple[dict[str, str], dict[str, dict[str, str]]]:
        return (
            {"image/png": b64encode(self.png()).decode(), "text/plain": self.words},
            {"image/png": {"alt": self.words}},
        )


class Table:
    """A table of a notebook.

    Parameters
    ----------
    head : of the columns.
    rows : texts, as many in each as columns.

    Examples
    --------
    >>> Table(["node", "to"], [["r0 c0", "(1, 2)"]])
    node  to
    r0 c0  (1, 2)
    """

    def __init__(self, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        self.head, self.rows = [translate(word) for word in head], rows

    def __repr__(self) -> str:
        return "\n".join("  ".join(row) for row in (self.head, *self.rows))

    def _repr_html_(self) -> str:
        head = "".join(f'<th scope="col" style="{_CELL}">{word}</th>' for word in self.head)
        body = "".join(
            "<tr>" + "".join(f'<td style="{_CELL}">{text}</td>' for text in row) + "</tr>" for row in self.rows
        )
        return f'<table style="{_TABLE}"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>'


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of a size in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), facecolor="white", layout="constrained")


def draw_plate(axes: Axes, name: str) -> None:
    """Thompson's drawing of an animal, with its numbers of rows and columns next to the grid."""
    plate, grid = thompson_plate(name), thompson_grid(name)
    (high, wide), (left, top) = plate.values.shape, plate.raster.origin
    extent = (left - 0.5, left + wide - 0.5, top + high - 0.5, top - 0.5)
    axes.imshow(plate.values, cmap="gray", vmin=0, vmax=255, extent=extent, interpolation="antialiased")
    draw_numbers(axes, grid.nodes)
    axes.set_axis_off()
    axes.set_title(grid.species, fontsize=10, style="italic", color=_INK)


def draw_numbers(axes: Axes, nodes: Floats) -> None:
    """The numbers of rows, at the left, and of columns, above, next to a grid of nodes."""
    far = 0.035 * float(np.ptp(nodes.reshape(-1, 2), axis=0).max())
    style: dict[str, Any] = {"color": NODES, "fontsize": 9, "weight": "bold", "ha": "center", "va": "center"}
    for k, (a, b) in enumerate(nodes[:, 0]):
        axes.text(a - far, b, str(k), **style)
    for k, (a, b) in enumerate(nodes[0]):
        axes.text(a, b - far, str(k), **style)
    low, high = nodes.reshape(-1, 2).min(axis=0), nodes.reshape(-1, 2).max(axis=0)
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    axes.set_xlim(min(left, low[0] - 2 * far), max(right, high[0] + far))
    axes.set_ylim(max(bottom, high[1] + far), min(top, low[1] - 2 * far))


def draw_nodes(axes: Axes, nodes: Floats) -> None:
    """The nodes of a grid as dots."""
    axes.plot(*nodes.reshape(-1, 2).T, "o", markersize=3, color=NODES)


def draw_grid(axes: Axes, nodes: Floats, color: str = _INK, **style: Any) -> None:
    """The lines of a grid of nodes."""
    for line in (*nodes, *nodes.transpose(1, 0, 2)):
        axes.plot(*line.T, color=color, **{"linewidth": 0.9, **style})


def draw_squares(axes: Axes, box: tuple[float, float, float, float], step: float, every: int = 5) -> None:
    """Squared paper over a box (a_min, a_max, b_min, b_max), with b downwards; each n-th line is darker."""
    for k, a in enumerate(np.arange(box[0], box[1] + step / 2, step)):
        axes.plot([a, a], box[2:], color="#7fa7c9", linewidth=0.25 if k % every else 0.7, zorder=0)
    for k, b in enumerate(np.arange(box[2], box[3] + step / 2, step)):
        axes.plot(box[:2], [b, b], color="#7fa7c9", linewidth=0.25 if k % every else 0.7, zorder=0)
    axes.set(xlim=box[:2], ylim=(box[3], box[2]), aspect="equal")


def credit(figure: Figure) -> None:
    """State the origin of Thompson's drawings below a figure."""
    figure.supxlabel(PLATE_SOURCE, fontsize=6, color="#555")


def rule_nodes(shear: float, taper: float, *, polar: bool = False) -> Floats:
    """Nodes (7, 8, 2) of a square grid after a shear and a taper, or of a polar grid.

    Examples
    --------
    >>> rule_nodes(0.5, 0.0)[6, 0].round(2).tolist()
    [0.2, 0.4]
    """
    a, b = np.meshgrid(np.linspace(0, 1, 8), np.linspace(-0.4, 0.4, 7))
    if polar:
        return np.dstack([(1 + a) * np.cos(1.5 * b), (1 + a) * np.sin(1.5 * b)])
    b = b * (1 + taper * a)
    return np.dstack([a + shear * b, b])


def draw_rules() -> Drawing:
    """A square grid, a shear, a taper and a polar grid."""
    forms = {
        "a square grid": rule_nodes(0, 0),
        "shear, k = 0.5": rule_nodes(0.5, 0),
        "taper, t = -0.7": rule_nodes(0, -0.7),
        "polar": rule_nodes(0, 0, polar=True),
    }
    panels = [Panel(None, translate(name), custom_grid(nodes).polylines()) for name, nodes in forms.items()]
    return Drawing(draw_figure([panels], lettered=False), "A square grid, a shear, a taper and a polar grid")

"""A grid fitted to a drawing manually: its corners and nodes are dragged to the parts of the body they belong to.

A value of its messages (see :mod:`deformnb.widgets.inputs.base`) has the places of all nodes and the numbers of those
that were placed manually: ``{"nodes": [[[a, b], ...], ...], "placed": [0, 7, ...]}``. The others are where the
thin-plate spline through the corners and the placed ones takes them, so that few drags do; the front end fits it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import traitlets
from numpy.typing import ArrayLike, NDArray

from deformnb.checks import short_value
from deformnb.datasets.darcy import ThompsonGrid, custom_grid
from deformnb.errors import DeformError
from deformnb.imaging.demo import subject_box
from deformnb.volume.plane import Picture
from deformnb.widgets.bundle import bundle
from deformnb.widgets.image_encoding import as_png
from deformnb.widgets.inputs.base import AbstractEdited, is_number, is_whole

MOST_LINES = 16
"""Rows and columns of a grid at most: their nodes are still distinct on a picture of 360 pixels."""

_LARGEST = 2048  # pixels along a side that a front end gets


@dataclass(frozen=True)
class _Edit:
    """Request of the front end."""

    nodes: NDArray[np.float64]
    placed: tuple[int, ...]


class GridDrawing(AbstractEdited):
    """A grid on a picture, whose nodes are dragged to the parts of the body they belong to.

    Parameters
    ----------
    picture : a drawing or a photograph, such as :func:`deformnb.project` makes of a picture that was read.
    rows, columns : lines of the grid from back to belly and from head to tail.
    nodes : (rows, columns, 2) places to begin with, in picture coordinates; default is a regular grid around the
        foreground of the picture.
    height : largest height of the picture in CSS pixels.
    theme, label, read_only : as in :class:`~deformnb.widgets.Editor`.

    Notes
    -----
    Nodes that nobody placed follow the corners and those that were, so a drag moves its surroundings too.
    ``drawing.observe(f, "nodes")`` calls f after every drag.

    Raises
    ------
    DeformError
        For fewer than 2 or more than 16 lines, or nodes that make no grid.

    Examples
    --------
    >>> from deformnb import Volume, project
    >>> leaf = np.zeros((1, 40, 60), np.uint8)
    >>> leaf[0, 10:30, 10:50] = 200
    >>> drawing = GridDrawing(project(Volume.from_array(leaf), "+z"), rows=3, columns=4)
    >>> drawing.grid("leaf").nodes.shape
    (3, 4, 2)
    """

    _esm = bundle("grid_drawing.js")
    _css = bundle("grid_drawing.css")

    height = traitlets.Int(380, min=80, max=2048).tag(sync=True)
    image = traitlets.Bytes(help="the picture as PNG").tag(sync=True)
    box = traitlets.List(traitlets.Float(), help="its edges a0, a1, b0, b1").tag(sync=True)
    nodes = traitlets.Instance(np.ndarray)

    def __init__(
        self, picture: Picture, rows: int = 5, columns: int = 7, nodes: ArrayLike | None = None, **traits: Any
    ) -> None:
        self._placed: tuple[int, ...] = ()
        self._picture = picture
        for what, count in (("rows", rows), ("columns", columns)):
            if not is_whole(count) or not 2 <= count <= MOST_LINES:
                raise DeformError(f"a grid has 2 to {MOST_LINES} {what}, got {short_value(count)}.")
        begin = _regular(picture, rows, columns) if nodes is None else custom_grid(nodes).nodes
        traits = {"label": "Grid on the drawing", **traits}
        super().__init__(nodes=begin, image=_png(picture), box=[float(edge) for edge in picture.raster.box], **traits)
        self._show()

    @property
    def picture(self) -> Picture:
        """The picture under the grid."""
        return self._picture

    def grid(self, name: str = "own grid") -> ThompsonGrid:
        """The grid under a name, for :func:`~deformnb.datasets.thompson_map`.

        Raises
        ------
        DeformError
            If a cell is flat or turned over.
        """
        return custom_grid(self.nodes, name)

    def set_lines(self, rows: int, columns: int) -> None:
        """Change the number of lines; the new nodes are on the present grid, and count as not placed."""
        self._placed = ()
        self.nodes = _resample(self.nodes, rows, columns)

    # ---- edits ------------------------------------------------------------------------------------------------------

    def _check_value(self, value: Any) -> _Edit:
        if not isinstance(value, dict):
            raise DeformError("a grid has nodes.")
        rows, columns = self.nodes.shape[:2]
        data, placed = value.get("nodes"), value.get("placed")
        if (
            not isinstance(data, list)
            or len(data) != rows
            or not all(
                isinstance(row, list)
                and len(row) == columns
                and all(isinstance(node, list) and len(node) == 2 and all(map(is_number, node)) for node in row)
                for row in data
            )
        ):
            raise DeformError(f"the grid has {rows} rows of {columns} nodes, each two finite numbers.")
        if (
            not isinstance(placed, list)
            or not all(is_whole(k) and 0 <= k < rows * columns for k in placed)
            or len(set(placed)) != len(placed)
        ):
            raise DeformError("the numbers of the nodes that were placed must be those of the grid.")
        return _Edit(np.asarray(data, dtype=np.float64), tuple(sorted(placed)))

    def _take(self, edit: _Edit) -> None:
        self._placed = edit.placed
        self.nodes = edit.nodes

    def _callback_value(self, edit: _Edit) -> NDArray[np.float64]:
        return edit.nodes

    @traitlets.observe("nodes")
    def _handle_change(self, _change: Any) -> None:
        self._show()

    def _show(self) -> None:
        self._set_content(nodes=self.nodes.tolist(), placed=list(self._placed))

    def __repr__(self) -> str:
        rows, columns = self.nodes.shape[:2]
        return f"GridDrawing({rows} rows of {columns} nodes, {len(self._placed)} placed manually)"


def _png(picture: Picture) -> bytes:
    from PIL import Image

    image = Image.fromarray(picture.rgb8())
    image.thumbnail((_LARGEST, _LARGEST))
    return as_png(np.asarray(image))


def _regular(picture: Picture, rows: int, columns: int) -> NDArray[np.float64]:
    """A regular grid around the foreground of a picture, bright on dark or ink on paper; else around its middle."""
    values = np.asarray(picture.values, dtype=np.float64)
    rim = np.concatenate([values[0], values[-1], values[:, 0], values[:, -1]])
    if np.median(rim) > (values.min() + values.max()) / 2:
        picture = replace(picture, values=values.max() - values)
    whole = a0, a1, b0, b1 = picture.raster.box
    try:
        found = subject_box(picture)
    except DeformError:
        found = (a0 + (a1 - a0) / 8, a1 - (a1 - a0) / 8, b0 + (b1 - b0) / 8, b1 - (b1 - b0) / 8)
    a0, a1 = np.clip(found[:2], *whole[:2])
    b0, b1 = np.clip(found[2:], *whole[2:])
    return np.stack(np.meshgrid(np.linspace(a0, a1, columns), np.linspace(b0, b1, rows)), axis=-1)


def _resample(nodes: NDArray[np.float64], rows: int, columns: int) -> NDArray[np.float64]:
    """A grid with other numbers of lines on the same bent surface, linear along its lines."""
    for axis, count in ((0, rows), (1, columns)):
        at = np.linspace(0, nodes.shape[axis] - 1, count)
        low = np.minimum(at.astype(int), nodes.shape[axis] - 2)
        share = (at - low)[:, None, None] if axis == 0 else (at - low)[None, :, None]
        nodes = np.take(nodes, low, axis) * (1 - share) + np.take(nodes, low + 1, axis) * share
    return nodes

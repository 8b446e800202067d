"""D'Arcy Thompson's grids: one fish turned into another by bending the grid it is drawn on (figure 3 of the paper).

The nodes were read from the scans of *On Growth and Form* (1917), which are in the public domain. In all eight figures
the head points left. The grids of a pair have their own drawing scale and place on the page; their alignment is
described at :func:`thompson_map`.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeGuard, get_args

import numpy as np
from numpy.typing import ArrayLike

from deformnb._typing import Floats, PictureBox
from deformnb.checks import real_array, short_value
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints

if TYPE_CHECKING:  # the grids of the book are read without JAX
    from deformnb.warping.points import Landmarks


@dataclass(frozen=True, eq=False)
class ThompsonGrid:
    """The grid of one figure.

    Parameters
    ----------
    figure : number in the edition of 1917; 0 for a grid that is not his.
    species : the name Thompson prints.
    modern : the name in use today, with the English one.
    image : file name of the scan in Project Gutenberg's ebook 55264.
    quality : uncertainties of the nodes; empty where the usual 2 pixels hold.
    nodes : (rows, columns, 2) in pixels of the scan, x right and y down; rows from back to belly, columns from head to
        tail.

    Examples
    --------
    >>> len(thompson_grid("Polyprion").polylines())
    15
    """

    figure: int
    species: str
    modern: str
    image: str
    quality: str
    nodes: Floats

    def polylines(self) -> list[Floats]:
        """The grid lines for drawing: all rows, then all columns, each (n, 2)."""
        return grid_lines(self.nodes)


@dataclass(frozen=True, eq=False)
class ThompsonMap:
    """A pair of grids placed on a picture.

    Parameters
    ----------
    source, target : the grids of the figures.
    source_nodes, target_nodes : (rows, columns, 2), the same in picture coordinates (a, b).

    Examples
    --------
    >>> thompson_map("Polyprion", "Scorpaena").points.names[:2]
    ('r0 c0', 'r0 c1')
    """

    source: ThompsonGrid
    target: ThompsonGrid
    source_nodes: Floats
    target_nodes: Floats

    @property
    def points(self) -> ControlPoints:
        """One control point per node, named by figure row and column ("r2 c5"), row by row."""
        rows, columns = self.source_nodes.shape[:2]
        names = [f"r{i} c{j}" for i in range(rows) for j in range(columns)]
        source, target = self.source_nodes.reshape(-1, 2), self.target_nodes.reshape(-1, 2)
        return ControlPoints.from_arrays(source, target, names=names)

    def polylines(self) -> tuple[list[Floats], list[Floats]]:
        """The lines of the source grid and of the target grid, in picture coordinates."""
        return grid_lines(self.source_nodes), grid_lines(self.target_nodes)


def grid_lines(nodes: ArrayLike) -> list[Floats]:
    """Rows and then columns of a grid of nodes (rows, columns, 2) as polylines."""
    n = np.asarray(nodes, dtype=np.float64)
    return [*n, *n.transpose(1, 0, 2)]


@cache
def thompson_grids() -> dict[int, ThompsonGrid]:
    """All digitised grids by figure number.

    Examples
    --------
    >>> thompson_grids()[380].modern
    'Antigonia capros (deepbody boarfish)'
    """
    grids = {}
    for number, row in _file()["figures"].items():
        nodes = np.array(row["nodes"], dtype=np.float64)
        nodes.flags.writeable = False
        texts = (row["species"], row["modern"], row["image"], row["quality"])
        grids[int(number)] = ThompsonGrid(int(number), *texts, nodes)
    return grids


def thompson_grid(name: str | int) -> ThompsonGrid:
    """The grid of a species by Thompson's name or the beginning of it, or by its figure number.

    Examples
    --------
    >>> thompson_grid("antigonia").nodes.shape
    (7, 8, 2)
    """
    found = [
        g
        for g in thompson_grids().values()
        if g.figure == name or (isinstance(name, str) and name and g.species.lower().startswith(name.lower()))
    ]
    if len(found) != 1:
        known = ", ".join(f"{g.species} ({g.figure})" for g in thompson_grids().values())
        what = "no figure" if not found else "more than one figure"
        raise DeformError(f"{what} of Thompson is named {name!r}; there are {known}.")
    return found[0]


def thompson_pairs() -> list[tuple[str, str]]:
    """Source and target species of Thompson's transformations, ready for :func:`thompson_map`.

    Examples
    --------
    >>> thompson_pairs()[3]
    ('Polyprion', 'Antigonia capros')
    """
    grids = thompson_grids()
    return [(grids[a].species, grids[b].species) for a, b in _file()["pairs"]]


def _scale_by_area(source: Floats, target: Floats, room: Floats) -> float:
    """Both grids cover the same area: a body inscribed in them neither grows nor shrinks as a whole."""
    return float(np.sqrt(_area(source) / _area(target)))


def _scale_by_length(source: Floats, target: Floats, room: Floats) -> float:
    """Both fishes are equally long: equal mean distance from the head column to the tail column."""
    return _length(source) / _length(target)


def _inside(source: Floats, target: Floats, room: Floats) -> float:
    """Scale of equal area, limited so that every node of the target is in the frame."""
    ratio = room / np.ptp(target.reshape(-1, 2), axis=0)
    return min(_scale_by_area(source, target, room), float(ratio.min()))


ScaleName: TypeAlias = Literal["inside", "area", "length"]
"""Names of the scales of the target grid."""

SCALES: dict[str, Callable[[Floats, Floats, Floats], float]] = {
    "inside": _inside,
    "area": _scale_by_area,
    "length": _scale_by_length,
}
"""Scales of the target grid relative to the source grid: a factor on Thompson's own drawing, from both grids and the
width and height of the frame, in pixels of the source's drawing."""

CellRule: TypeAlias = Literal["fill", "square"]
"""Names of the fits of the source grid to the box."""

CELLS: tuple[CellRule, ...] = get_args(CellRule)
"""Fits of the source grid to the box: stretched over it, or with the proportions of the drawing."""

HeadSide: TypeAlias = Literal["left", "right"]
"""Names of the directions of a head."""

HEADS: tuple[HeadSide, ...] = get_args(HeadSide)
"""Directions in which the head of the fish on the picture points."""


def custom_grid(
    nodes: ArrayLike | Landmarks | str | os.PathLike[str], name: str = "own grid", rows: int | None = None
) -> ThompsonGrid:
    """A user's grid, as those of the book.

    Parameters
    ----------
    nodes : (rows, columns, 2) places (x, y) on the drawing, x right and y down; rows from back to belly, columns from
        head to tail, the head on the left. Or landmarks, or a file of them (:func:`deformnb.io.read_landmarks`), named
        by row and column ("r0 c3") in any order, or row by row.
    name : of the animal.
    rows : of landmarks that are not named so.

    Raises
    ------
    DeformError
        If it is no such array, the landmarks do not fill a grid, or a cell of it is flat or turned over.

    Examples
    --------
    >>> custom_grid([[[0, 0], [50, 5]], [[0, 30], [50, 25]]], "leaf").nodes.shape
    (2, 2, 2)
    >>> from deformnb.warping import Landmarks
    >>> marks = Landmarks([[50, 25], [0, 0], [50, 5], [0, 30]], ("r1 c1", "r0 c0", "r0 c1", "r1 c0"))
    >>> custom_grid(marks, "leaf").nodes[1].tolist()
    [[0.0, 30.0], [50.0, 25.0]]
    """
    if isinstance(nodes, str | os.PathLike):
        from deformnb.io import read_landmarks

        nodes = read_landmarks(nodes)
    if _are_landmarks(nodes):
        nodes = _arrange_rows(nodes, name, rows)
    given = real_array(nodes)
    form = f"the grid {name!r} must be an array of shape (rows, columns, 2): the places (x, y) of its nodes, row by row"
    if given is None:
        raise DeformError(f"{form}; got {short_value(nodes)}.")
    if given.ndim != 3 or given.shape[2] != 2 or min(given.shape[:2]) < 2:
        raise DeformError(f"{form}, with at least 2 rows and 2 columns; got the shape {given.shape}.")
    if not np.isfinite(given).all():
        row, column = np.argwhere(~np.isfinite(given))[0][:2]
        raise DeformError(f"node r{row} c{column} of the grid {name!r} is no place: {given[row, column].tolist()}.")
    made = given.copy()
    turned = np.argwhere(_least_corners(made) <= 0)
    if len(turned):
        row, column = turned[0]
        raise DeformError(
            f"the cell below and right of node r{row} c{column} of the grid {name!r} is flat or turned "
            "over. Rows go from back to belly and columns from head to tail, x grows to the right and y "
            "down, and no lines may cross: look for two nodes that are exchanged, or a y that grows "
            "upwards."
        )
    made.flags.writeable = False
    return ThompsonGrid(0, name, name, "", "", made)


def _are_landmarks(given: object) -> TypeGuard[Landmarks]:
    """Check whether these are landmarks, by their attributes, for their class comes with JAX."""
    return hasattr(given, "points") and hasattr(given, "names")


def _arrange_rows(landmarks: Landmarks, name: str, rows: int | None) -> Floats:
    """Landmarks as rows of nodes: by their names, or row by row."""
    places, count = np.asarray(landmarks.points, dtype=np.float64), len(landmarks.points)
    if places.shape[1] == 3 and np.ptp(places[:, 2]) > 0:
        raise DeformError(
            f"the landmarks of the grid {name!r} are in space, and a grid on a drawing: their third "
            "coordinate must be the same for all."
        )
    found = [re.fullmatch(r"r(\d+) c(\d+)", mark) for mark in landmarks.names]
    if rows is None and found and all(found):
        at = [(int(mark[1]), int(mark[2])) for mark in found if mark]
        high, wide = (1 + max(index) for index in zip(*at, strict=True))
        if sorted(at) != [(i, j) for i in range(high) for j in range(wide)]:
            missing = sorted({(i, j) for i in range(high) for j in range(wide)} - set(at))
            words = f"r{missing[0][0]} c{missing[0][1]} is missing" if missing else "a node is there twice"
            raise DeformError(f"the landmarks of the grid {name!r} do not fill {high} rows of {wide} nodes: {words}.")
        return places[np.argsort([i * wide + j for i, j in at]), :2].reshape(high, wide, 2)
    if not isinstance(rows, int) or rows < 2 or count % rows:
        raise DeformError(
            f'the {count} landmarks of the grid {name!r} are not named by row and column ("r0 c3"); '
            f"state their number of rows: custom_grid(..., rows=4). Got rows={short_value(rows)}."
        )
    return places[:, :2].reshape(rows, -1, 2)


def _least_corners(nodes: Floats) -> Floats:
    """(rows - 1, columns - 1): the least of the signed areas of the four triangles at the corners of each cell."""
    p, q, r, s = nodes[:-1, :-1], nodes[:-1, 1:], nodes[1:, 1:], nodes[1:, :-1]
    areas = [
        (b - a)[..., 0] * (c - a)[..., 1] - (b - a)[..., 1] * (c - a)[..., 0]
        for a, b, c in ((p, q, s), (q, r, p), (r, s, q), (s, p, r))
    ]
    return np.asarray(np.min(areas, axis=0))


GridLike: TypeAlias = "str | os.PathLike[str] | int | ThompsonGrid | Landmarks | ArrayLike"
"""A grid or its name: a species or figure of Thompson's, own nodes or landmarks, or a file of these."""


def _resolve_grid(given: GridLike, name: str) -> ThompsonGrid:
    """The grid of a name, a figure's number, nodes, landmarks or a file of them."""
    if isinstance(given, ThompsonGrid):
        return given
    if isinstance(given, int | np.integer):
        return thompson_grid(int(given))
    if isinstance(given, str):
        return custom_grid(given, Path(given).stem) if Path(given).suffix else thompson_grid(given)
    return custom_grid(given, Path(given).stem if isinstance(given, os.PathLike) else name)


def thompson_map(
    source: GridLike = "Polyprion",
    target: GridLike = "Antigonia",
    *,
    box: PictureBox = (0.0, 1.0, 0.0, 1.0),
    frame: PictureBox | None = None,
    scale: ScaleName = "inside",
    cells: CellRule = "fill",
    head: HeadSide = "left",
) -> ThompsonMap:
    """Place a pair of Thompson's grids, or own grids, on a picture.

    Parameters
    ----------
    source, target : species (or the beginning of the name, or the figure number); own nodes as
        (rows, columns, 2) places (x, y) on a drawing, x right and y down; landmarks that are named by row and column,
        or a file of them (:func:`custom_grid` has the rules, and names them). Both grids have equally many lines.
    box : (a_min, a_max, b_min, b_max) in picture coordinates, b downwards: the fish's own box. The source grid fills
        it, so that the fish is inscribed as Thompson's is.
    frame : the box that ``scale="inside"`` respects, best that of the whole picture
        (:attr:`box`); default is ``box`` itself, which makes a deep fish small in a low box.
    scale : one of :data:`SCALES`. "inside": equal area, or less if the target grid would leave the frame. "area" and
        "length" preserve the area or the length of the fish; a slender fish that becomes a deep one then needs an
        output grid with a margin above and below.
    cells : "fill" stretches the source grid over the box, as the paper inscribes its carp; "square" preserves the
        proportions of the drawing: the grid is as long as the box and centred, and may reach beyond it up and down.
    head : where the head of the fish on the picture points. Thompson's point left; "right" mirrors both grids.

    Returns
    -------
    ThompsonMap
        With ``points`` for a fit and ``polylines()`` for drawing.

    Notes
    -----
    1. The page decides nothing: the target grid is scaled about its centre by the rule of ``scale``. It is neither
       turned (the sternoptychid's shear is the point of that figure) nor stretched.
    2. It is moved so that its mean node falls on the source's mean node, which is the translation of least
       squares; under "inside" it is then pushed back into the frame, by as little as possible.
    3. One affine map, from the source grid's box to ``box``, then carries both grids to the picture. Because both are
       carried equally, a species mapped to itself moves nothing, however far the box is stretched.

    Raises
    ------
    DeformError
        For an unknown name, nodes that make no grid, a bad box, or two grids of different size.

    Examples
    --------
    >>> laid = thompson_map("Polyprion", "Scorpaena", box=(0.0, 512.0, 0.0, 200.0))
    >>> laid.source_nodes.reshape(-1, 2).max(axis=0).round(9).tolist()
    [512.0, 200.0]

    Two grids read from the user's drawings:

    >>> leaf = [[[0, 0], [40, 0], [80, 0]], [[0, 30], [40, 30], [80, 30]]]
    >>> older = [[[0, 10], [60, 0], [120, 0]], [[0, 50], [60, 60], [120, 60]]]
    >>> thompson_map(leaf, older, box=(0.0, 80.0, 0.0, 30.0)).points.names
    ('r0 c0', 'r0 c1', 'r0 c2', 'r1 c0', 'r1 c1', 'r1 c2')
    """
    a, b = _resolve_grid(source, "source"), _resolve_grid(target, "target")
    if a.nodes.shape != b.nodes.shape:
        raise DeformError(
            f"the grids of {a.species} and {b.species} have {a.nodes.shape[:2]} and {b.nodes.shape[:2]} "
            f"rows and columns and do not correspond; Thompson's pairs are {thompson_pairs()}."
        )
    for what, value, known in (("scale", scale, tuple(SCALES)), ("cells", cells, CELLS), ("head", head, HEADS)):
        if value not in known:
            raise DeformError(f"unknown {what} {value!r}; choose one of {', '.join(known)}.")
    corner, size = _check_box(box)
    flat = a.nodes.reshape(-1, 2)
    low, extent = flat.min(axis=0), np.ptp(flat, axis=0)
    factor = size / extent if cells == "fill" else np.full(2, size[0] / extent[0])
    shift = corner + size / 2 - factor * (low + extent / 2)
    frame_corner, frame_size = _check_box(box if frame is None else frame)
    if head == "right":  # the grids are defined for a head on the left and mirrored at the end; so must the frame be
        frame_corner = np.array([2 * corner[0] + size[0] - frame_corner[0] - frame_size[0], frame_corner[1]])
    goal = b.nodes * SCALES[scale](a.nodes, b.nodes, frame_size / factor)
    goal = (goal + (_mean(a.nodes) - _mean(goal))) * factor + shift
    if scale == "inside":
        goal = goal + _translation_into_box(goal, frame_corner, frame_size)
    nodes = [a.nodes * factor + shift, goal]
    if head == "right":
        mirror, offset = np.array([-1.0, 1.0]), np.array([2 * corner[0] + size[0], 0.0])
        nodes = [n * mirror + offset for n in nodes]
    return ThompsonMap(a, b, nodes[0], nodes[1])


@cache
def _file() -> dict[str, Any]:
    text = resources.files("deformnb.datasets").joinpath("darcy_grids.json").read_text(encoding="utf-8")
    return dict(json.loads(text))


def _check_box(box: PictureBox) -> tuple[Floats, Floats]:
    values = np.asarray(box, dtype=np.float64)
    if values.shape != (4,) or not np.isfinite(values).all() or values[1] <= values[0] or values[3] <= values[2]:
        raise DeformError(f"a box is (a_min, a_max, b_min, b_max) with a_min < a_max and b_min < b_max, got {box!r}.")
    return values[[0, 2]], values[[1, 3]] - values[[0, 2]]


def _area(nodes: Floats) -> float:
    """Area inside the outline of a grid (shoelace formula)."""
    rim = np.concatenate([nodes[0], nodes[1:, -1], nodes[-1, -2::-1], nodes[-2:0:-1, 0]])
    x, y = rim.T
    return float(abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2)


def _length(nodes: Floats) -> float:
    return float(np.linalg.norm(nodes[:, -1] - nodes[:, 0], axis=-1).mean())


def _mean(nodes: Floats) -> Floats:
    return np.asarray(nodes.reshape(-1, 2).mean(axis=0))


def _translation_into_box(nodes: Floats, corner: Floats, size: Floats) -> Floats:
    """The smallest translation that moves all nodes into a box they fit in."""
    flat = nodes.reshape(-1, 2)
    below, above = corner - flat.min(axis=0), corner + size - flat.max(axis=0)
    return np.asarray(np.maximum(below, 0) + np.minimum(above, 0))

"""Results of a deformation: the deformed layer, a slice or a coarse form of it, other layers, a grid, notes.

Nothing here touches the viewer, so that a thread may compute it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb import Deformation, Grid, Volume, Warper
from deformnb._typing import Progress
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.interpolant import FOLDS_WARNING
from deformnb.volume.layers import LayerData, world_of_layer
from deformnb.warping import warp_points
from deformnb.warping.map_checks import map_notes
from napari_deformnb.subject import Subject

COARSE_VOXELS = 1_000_000
"""Voxels at most that are computed while a point is dragged in a view of the whole volume."""

EDGE_PIECES = 8
"""Pieces of a straight edge of a shape, which bend."""

MOST_CELLS = 64
"""Cells of the grid along the longest side at most."""

VERTEX_KINDS = ("points", "shapes", "surface")
"""Kinds of layers whose vertices are moved with the tissue."""

_PIECES_OF_A_LINE = 4  # of a line of the grid in each cell


@dataclass(frozen=True)
class VisiblePart:
    """The part of a layer that a viewer shows.

    Parameters
    ----------
    axis : the axis of the volume's array across the slice that is shown; None for the whole volume.
    position : the slice.
    """

    axis: int | None = None
    position: int = 0


@dataclass(frozen=True)
class Result:
    """Results of one deformation.

    Parameters
    ----------
    array : data of the deformed layer, or of the slice of it that ``part`` names; None without a deformed layer.
    layer : the whole deformed layer, where the result is full.
    part : the slice of ``array``; None where ``array`` is whole.
    lines : (N, 2, ndim) pieces of the grid, a place and a direction each.
    others : results of other layers by these layers, whose names may change meanwhile.
    problems : sentences on other layers that could not be deformed.
    warnings : on the map: folds in tissue, tissue that leaves the box, and probable mistakes.
    notes : on the fits and the layer.
    """

    array: NDArray[Any] | None = None
    layer: LayerData | None = None
    part: VisiblePart | None = None
    lines: NDArray[np.float64] | None = None
    others: dict[Any, LayerData] = field(default_factory=dict)
    problems: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


class Calculator:
    """Results for one layer, with what depends on the layer alone made once.

    Parameters
    ----------
    subject : the layer that is deformed.
    """

    def __init__(self, subject: Subject) -> None:
        self.subject = subject
        self._warpers: dict[Grid | None, list[Warper]] = {}

    def full(self, deformation: Deformation, name: str, progress: Progress | None = None) -> Result:
        """The whole deformed layer as ``deformation.apply`` computes it, with its notes."""
        field = deformation.field(self.subject.grid)
        results = self._warp(field, deformation.output, progress)
        layer = self.subject.to_layer(results, name)
        return replace(self.check(deformation, field, results[0].grid), array=layer[0], layer=layer)

    def preview(self, deformation: Deformation, part: VisiblePart, progress: Progress | None = None) -> Result:
        """The slice that is shown, or else the whole layer from a coarser grid if it is large."""
        field, grid = deformation.field(self.subject.grid), self.subject.grid
        if part.axis is not None and deformation.output is None:
            start, shape = [0, 0, 0], list(grid.shape)
            start[part.axis], shape[part.axis] = part.position, 1
            one = grid.crop((start[0], start[1], start[2]), (shape[0], shape[1], shape[2]))
            results = self._warp(field, one, progress, cache=False)
            array = self.subject.to_array(results)
            return Result(array=array.squeeze(part.axis) if self.subject.ndim == 3 else array, part=part)
        factor = coarsening(grid)
        if factor == 1 or deformation.output is not None:
            return Result(array=self.subject.to_array(self._warp(field, deformation.output, progress)))
        results = self._warp(field, coarse_grid(grid, factor), progress)
        return Result(array=self.subject.to_array([_refine(result, grid, factor) for result in results]))

    def check(self, deformation: Deformation, field: AbstractField, output: Grid) -> Result:
        """Warnings and notes alone."""
        grid, first = self.subject.grid, self.subject.volumes[0]
        fits = [note for note in deformation.fit_notes(grid) if note != FOLDS_WARNING]  # the map itself is checked
        warnings = [*map_notes(first, field, output), *deformation.cautions(grid)]
        return Result(warnings=_sentences(warnings), notes=_sentences([*fits, *first.notes]))

    def _warp(
        self, field: AbstractField, output: Grid | None, progress: Progress | None, *, cache: bool = True
    ) -> list[Volume]:
        warpers = self._warpers.get(output)
        if warpers is None:
            warpers = [Warper(volume, output=output) for volume in self.subject.volumes]
            if cache:
                self._warpers = {key: self._warpers[key] for key in list(self._warpers)[-1:]} | {output: warpers}
        count = len(warpers)

        def part(k: int) -> Progress | None:
            return None if progress is None else lambda share: progress((k + share) / count)

        return [warper(field, progress=part(k)) for k, warper in enumerate(warpers)]


def _sentences(texts: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(text[:1].upper() + text[1:].rstrip(".") + "." for text in texts))


def coarsening(grid: Grid) -> int:
    """The number of voxels along each axis that one stands for while a point is dragged; 1 for a small volume.

    Examples
    --------
    >>> coarsening(Grid((100, 100, 100))), coarsening(Grid((256, 256, 256)))
    (1, 3)
    """
    factor = 1
    while np.prod([-(-n // factor) for n in grid.shape], dtype=float) > COARSE_VOXELS:
        factor += 1
    return factor


def coarse_grid(grid: Grid, factor: int) -> Grid:
    """A grid whose voxels are the middles of blocks of ``factor`` voxels along each axis.

    Examples
    --------
    >>> coarse_grid(Grid((4, 4, 7)), 3)
    Grid(shape=(2, 2, 3), spacing=(3.0, 3.0, 3.0), origin=(1.0, 1.0, 1.0), \
direction=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)), unit='')
    """
    nz, ny, nx = (-(-n // factor) for n in grid.shape)
    x, y, z = grid.spacing
    first = grid.index_to_point([(factor - 1) / 2] * 3).tolist()
    spacing = (factor * x, factor * y, factor * z)
    return Grid((nz, ny, nx), spacing, (first[0], first[1], first[2]), grid.direction, grid.unit)


def _refine(result: Volume, grid: Grid, factor: int) -> Volume:
    """Voxels of a coarse grid, each repeated in its block."""
    values = np.asarray(result.values)
    for axis, count in enumerate(grid.shape):
        values = np.repeat(values, factor, axis=axis).take(range(count), axis=axis)
    return Volume(values, grid, result.name, result.is_labels)


def grid_lines(subject: Subject, deformation: Deformation, part: VisiblePart, cells: int) -> NDArray[np.float64]:
    """Pieces of the lines of a straight grid, moved with the tissue, as vectors (N, 2, ndim) of the layer.

    Parameters
    ----------
    subject : the layer that is deformed.
    deformation : of it.
    part : the slice whose lines are drawn on it; without one they are on the three middle slices.
    cells : along the longest side of the box.

    Notes
    -----
    What leaves its slice is drawn where it is seen from in front. A place without a counterpart in the result, at a
    fold or outside, has no line.
    """
    if not 1 <= cells <= MOST_CELLS:
        raise DeformError(f"a grid has from 1 to {MOST_CELLS} cells along the longest side, got {cells}.")
    shape = subject.grid.shape
    sheets = [(axis, (count - 1) / 2) for axis, count in enumerate(shape)]
    if part.axis is not None:
        sheets = [(part.axis, float(part.position))]
    index = np.concatenate([_sheet(subject.grid, axis, position, cells) for axis, position in sheets])
    moved, found = deformation.warp_points(subject.grid.index_to_point(index[..., ::-1]), subject.grid)
    index = subject.grid.point_to_index(moved)[..., ::-1][found.all(axis=1)]
    if part.axis is not None:
        index[..., part.axis] = part.position
    index[:, 1] -= index[:, 0]  # napari's vectors are a place and a direction
    return index[..., 3 - subject.ndim :]


def _sheet(grid: Grid, axis: int, position: float, cells: int) -> NDArray[np.float64]:
    """Pieces (N, 2, 3) of the lines of a straight grid on a slice across ``axis``, as indices (z, y, x)."""
    counts = np.array(grid.shape, float)
    lengths = counts * grid.spacing[::-1]
    size = lengths.max() / cells
    pieces = []
    for along, across in (pair for pair in ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1)) if axis not in pair):
        number = [max(1, round(lengths[k] / size)) for k in (along, across)]
        fine = np.linspace(-0.5, counts[along] - 0.5, number[0] * _PIECES_OF_A_LINE + 1)
        fixed = np.linspace(-0.5, counts[across] - 0.5, number[1] + 1)
        lines = np.full((len(fixed), len(fine), 3), float(position))
        lines[..., along], lines[..., across] = fine, fixed[:, None]
        pieces.append(np.stack([lines[:, :-1], lines[:, 1:]], axis=2).reshape(-1, 2, 3))
    return np.concatenate(pieces)


def deform_layer(given: LayerData, subject: Subject, deformation: Deformation, other: Subject | None) -> LayerData:
    """Another layer at the place of the deformed one: voxels on its own grid, or vertices moved with the tissue.

    Parameters
    ----------
    given : the layer.
    subject : of the layer on which the deformation was made.
    deformation : of that.
    other : the layer's own subject, where it has voxels.

    Raises
    ------
    DeformError
        For a layer of another kind or with other dimensions.
    """
    data, attributes, kind = given
    name = str(attributes.get("name") or kind)
    named = {**attributes, "name": f"{name} deformed", "visible": True}
    if other is not None:
        if other.ndim != subject.ndim:
            raise DeformError(_other_dimensions(name, other.ndim, subject.ndim))
        field = deformation.field(subject.grid)
        results = [Warper(volume.to_unit(subject.grid.unit))(field) for volume in other.volumes]
        return other.to_array(results), named, kind
    if kind not in VERTEX_KINDS:
        raise DeformError(
            f"the layer {name!r} is of {kind}, which cannot be deformed along: images, labels, points, shapes and "
            "surfaces can."
        )
    dims = _dims_of(data, kind)
    if dims != subject.ndim:
        raise DeformError(_other_dimensions(name, dims, subject.ndim))
    world, unit, _ = world_of_layer(attributes, dims)

    def move(vertices: Any) -> NDArray[np.float64]:
        return _move_vertices(np.asarray(vertices, float), world, unit, deformation, subject)

    if kind == "shapes":
        types = attributes.get("shape_type", ["polygon"] * len(data))
        bent = [_bend_edges(np.asarray(one, float), kind_of) for one, kind_of in zip(data, types, strict=True)]
        named["shape_type"] = [kind_of for _, kind_of in bent]
        return [move(vertices) for vertices, _ in bent], named, kind
    if kind == "surface":
        return (move(data[0]), *data[1:]), named, kind
    return move(data), named, kind


def _other_dimensions(name: str, own: int, wanted: int) -> str:
    return f"the layer {name!r} has {own} dimensions and the deformed one {wanted}, so that it has no place in it."


def _dims_of(data: Any, kind: str) -> int:
    if kind == "shapes":
        return int(np.asarray(data[0]).shape[1]) if len(data) else 3
    return int(np.asarray(data[0] if kind == "surface" else data).shape[-1])


def _move_vertices(
    vertices: NDArray[np.float64], world: NDArray[np.float64], unit: str, deformation: Deformation, subject: Subject
) -> NDArray[np.float64]:
    """Data coordinates (N, dims) moved with the tissue; a vertex without a place in the result stays."""
    if not len(vertices):
        return vertices
    grid, dims = subject.grid, vertices.shape[1]
    factor = Grid((1, 1, 1), unit=unit).to_unit(grid.unit).spacing[0] if unit and grid.unit else 1.0
    places = np.pad(vertices[:, ::-1], ((0, 0), (0, 3 - dims))) @ world[:3, :3].T + world[:3, 3]
    moved, found = warp_points(places * factor, deformation, grid)
    moved = np.where(found[:, None], moved / factor, places)
    inside: NDArray[Any] = np.linalg.solve(world[:3, :3], (moved - world[:3, 3]).T).T
    return inside[:, :dims][:, ::-1]


def _bend_edges(vertices: NDArray[np.float64], kind: str) -> tuple[NDArray[np.float64], str]:
    """Vertices of a shape with more of them along its edges, and the kind of shape that they are now."""
    if kind == "ellipse":  # four corners of its box
        centre, right, down = vertices.mean(axis=0), vertices[1] - vertices[0], vertices[3] - vertices[0]
        turn = np.linspace(0, 2 * np.pi, 8 * EDGE_PIECES, endpoint=False)[:, None]
        return centre + 0.5 * np.cos(turn) * right + 0.5 * np.sin(turn) * down, "polygon"
    is_open = kind in ("line", "path")
    ends: Sequence[int] | NDArray[np.int64] = np.arange(len(vertices) - 1 if is_open else len(vertices))
    shares = np.arange(EDGE_PIECES)[:, None] / EDGE_PIECES
    pieces = [vertices[k] + shares * (vertices[(k + 1) % len(vertices)] - vertices[k]) for k in ends]
    last = [vertices[-1:]] if is_open else []
    return np.concatenate([*pieces, *last]), "path" if is_open else "polygon"

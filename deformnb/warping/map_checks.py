"""Checks of the map that is applied to a volume: whether it folds, and whether it moves tissue out of the box.

Both are found from displacements at a few thousand places, while a warp has millions of voxels. A map that is done in
several steps folds where one of its steps does, for determinants multiply along a composition:
``det J(x) = det J_1(x + D_2(x)) det J_2(x)``.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import fields as dataclass_fields
from dataclasses import is_dataclass, replace

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Floats
from deformnb.checks import warn
from deformnb.rbf.extrusion import Extrusion, unchanging_axes
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.forward import ForwardFit
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume, empty_note, label_note
from deformnb.warping.foreground import (
    cut_off_text,
    foreground_at,
    foreground_level,
    leaving_voxels,
    side_names,
    tissue_test,
)

# Nodes along the longest side of a box at which every determinant is computed; between them candidates of the fits and
# a search around the smallest one find narrower folds.
_NODES = 25
_DEPTHS = 9
_CANDIDATES = 4096

# The smallest determinant is followed from this value on, on lattices of so many nodes a side, each finer by half that.
_FOLLOWED, _AROUND, _FINER = 0.5, 5, 4

# Nodes along each side of the box at which tissue is searched for beyond it.
_SHELL = 48


def map_notes(volume: Volume, field: AbstractField, output: Grid, fill: float | None = None) -> tuple[str, ...]:
    """Notes on a result for its user: nothing to see, folds in tissue, and tissue that is cut off.

    Parameters
    ----------
    volume : that is deformed.
    field : backward displacements in space.
    output : the grid of the result.
    fill : value outside the volume, the background if None. Nothing is cut off where it is above that of tissue, as
        around a signed distance, which is least inside.

    Examples
    --------
    >>> from deformnb.rbf.fitting import fit_rbf
    >>> from deformnb.rbf.points import ControlPoints
    >>> volume = Volume.from_array(np.pad(np.full((10, 10, 10), 200, np.uint8), 10))
    >>> drag = ControlPoints.from_arrays([[15, 15, 15]], [[25, 15, 15]])
    >>> for note in map_notes(volume, fit_rbf(drag, trend="none", support=10.0), volume.grid): print(note)
    The map folds: det J is -1.1 near (22.5, 15, 15), where tissue is shown twice. Drag less far, or use more stages or
    a larger support radius.
    """
    empty = empty_note(volume.values)
    if empty or field.is_identity:
        return empty
    is_inverted = fill is not None and fill > foreground_level(volume)
    cut_off = "" if is_inverted else cut_off_note(volume, field, output)
    return tuple(note for note in (fold_note(volume, field, output), cut_off) if note)


def add_cautions(
    volumes: Sequence[Volume], results: Sequence[Volume], notes: Sequence[str], cautions: Sequence[str]
) -> list[Volume]:
    """Results with the notes of their volumes, further notes and cautions; the latter are warnings too.

    Parameters
    ----------
    notes, cautions : of the map, the same for all.
    """
    made_up = [interpolated_labels_note(volume, result) for volume, result in zip(volumes, results, strict=True)]
    warn([*cautions, *(note for note, volume in zip(made_up, volumes, strict=True) if note and volume.is_undecided)])
    return [
        replace(result, notes=tuple(dict.fromkeys([*volume.notes, *notes, *cautions, *([more] if more else [])])))
        for result, volume, more in zip(results, volumes, made_up, strict=True)
    ]


def interpolated_labels_note(volume: Volume, result: Volume) -> str:
    """A sentence on values that interpolation made up between those of labels that are not declared as such.

    Examples
    --------
    >>> bones = np.repeat(np.arange(0, 90, 9, dtype=np.int16), 400).reshape(10, 20, 20).transpose(2, 1, 0)
    >>> volume = Volume.from_array(np.tile(bones, (1, 1, 2)))
    >>> interpolated_labels_note(volume, volume)
    ''
    """
    if volume.is_labels or not (volume.is_undecided or label_note(volume.values)):
        return ""
    count = len(np.setdiff1d(np.unique(result.values), np.append(np.unique(volume.values), volume.background)))
    values = "1 value that no voxel had was" if count == 1 else f"{count} values that no voxel had were"
    return (
        f"{values} made up between voxels that look like labels; declare them as labels to keep each as it is."
        if count
        else ""
    )


# ---- folds -----------------------------------------------------------------------------------------------------------


def fold_note(volume: Volume | None, field: AbstractField, box: Grid) -> str:
    """A sentence on the worst fold of a map in tissue; empty where there is none.

    Parameters
    ----------
    volume : whose tissue counts; None counts every place, where the voxels are not available.
    box : that is searched; of a map in several steps each is searched there.
    """
    worst, where = 0.0, None
    steps = field.steps
    for k, step in enumerate(steps):
        places, values = _lowest(step, box)
        if not values.size or values[0] > worst:
            continue
        source = places + step.displacement(places)
        for before in reversed(steps[:k]):
            source = source + before.displacement(source)
        is_tissue = everywhere if volume is None else tissue_test(volume, _plane_of(step, box))
        in_tissue = is_tissue(source)
        if in_tissue.any() and values[in_tissue][0] <= worst:
            worst, where = float(values[in_tissue][0]), places[in_tissue][0]
    if where is None:
        return ""
    at = ", ".join(f"{value:.4g}" for value in where + 0.0)
    return (
        f"The map folds: det J is {worst:.2g} near ({at}), where tissue is shown twice. Drag less far, or use more "
        "stages or a larger support radius."
    )


def everywhere(places: Floats) -> NDArray[np.bool_]:
    """A test for tissue that finds it at all places (n, dim)."""
    return np.ones(len(places), np.bool_)


def _lowest(field: AbstractField, box: Grid) -> tuple[Floats, Floats]:
    """The places (n, 3) in folds and their determinants (n,), the smallest first."""
    places = np.concatenate([_nodes(field, box), _candidates(field, box)])
    values = _determinants(field, places)
    if (values.size and 0 < values.min() < _FOLLOWED) or (values <= 0).any():
        places, values = _follow(field, box, places, values)
    order = np.argsort(values)
    order = order[values[order] <= 0]
    return places[order], values[order]


def _determinants(field: AbstractField, places: Floats) -> Floats:
    values: Floats = np.linalg.det(np.eye(3) + field.jacobian(places))
    return np.where(np.isfinite(values), values, 1.0)


def _nodes(field: AbstractField, box: Grid) -> Floats:
    """Nodes of a lattice that covers the box; one slice represents all along an axis on which nothing changes."""
    counts = np.array(box.shape[::-1])
    lengths = np.asarray(box.spacing) * counts
    most = np.maximum(np.ceil(_NODES * lengths / lengths.max()), 2).astype(int)
    if isinstance(field, Extrusion) and not field.is_replication and (axis := field.axis_of(box)) is not None:
        most[2 - axis] = _DEPTHS
    same = unchanging_axes(field, box)
    lines = [
        np.array([(n - 1) / 2]) if 2 - k in same else np.linspace(0, n - 1, min(n, m))
        for k, (n, m) in enumerate(zip(counts.tolist(), most.tolist(), strict=True))
    ]
    return box.index_to_point(np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3))


def _candidates(field: AbstractField, box: Grid) -> Floats:
    """Places in the box at and between the control points of a map, where it is steepest."""
    found = [np.zeros((0, 3))]
    for plane, depths, fit in _fits(field, None, np.zeros(1)):
        places = fit.steep_places()
        if plane is not None:
            c = np.broadcast_to(depths, (len(places), len(depths))).T.reshape(-1, 1)
            places = plane.from_plane(np.concatenate([np.tile(places, (len(depths), 1)), c], axis=1))
        if places.shape[-1] == 3:
            found.append(places)
    places = np.concatenate(found)
    index = box.point_to_index(places)
    places = places[(np.abs(index - (np.array(box.shape[::-1]) - 1) / 2) <= np.array(box.shape[::-1]) / 2).all(axis=1)]
    return places[:: max(1, -(-len(places) // _CANDIDATES))]


def _fits(field: object, plane: Plane | None, depths: Floats) -> Iterator[tuple[Plane | None, Floats, RBFInterpolant]]:
    """The fits within a field, each with its plane and the depths at which it counts most.

    Fits forward are left out: they are steep at places of the input.
    """
    if isinstance(field, RBFInterpolant):
        yield plane, depths, field
        return
    if isinstance(field, Extrusion):
        weights = np.abs(np.asarray(field.weights))
        knots = np.asarray(field.knots)[np.unique(np.concatenate([weights.argmax(axis=1), [len(weights[0]) // 2]]))]
        plane, depths = field.plane, field.depth[0] + knots * (field.depth[1] - field.depth[0])
    if isinstance(field, AbstractField) and is_dataclass(field) and not isinstance(field, ForwardFit):
        for one in dataclass_fields(field):
            value = getattr(field, one.name)
            parts = value.values() if isinstance(value, dict) else value if isinstance(value, Iterable) else (value,)
            for part in (value,) if isinstance(value, AbstractField) else parts:
                if isinstance(part, AbstractField):
                    yield from _fits(part, getattr(field, "plane", None) or plane, depths)


def _follow(field: AbstractField, box: Grid, places: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Add places around the smallest determinant, on ever finer lattices."""
    axes, last = box.matrix.T, np.array(box.shape[::-1]) - 1
    gap = (last / (_NODES - 1)).max()
    for turn in range(_FINER):
        at = box.point_to_index(places[values.argmin()])
        sides = [np.linspace(-1, 1, _AROUND) * gap / (_AROUND / 2) ** turn if n else np.zeros(1) for n in last]
        index = np.clip(at + np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3), 0, last)
        near = np.asarray(box.origin) + index @ axes
        places, values = np.concatenate([places, near]), np.concatenate([values, _determinants(field, near)])
    return places, values


def _plane_of(field: AbstractField, box: Grid) -> Plane | None:
    """The plane of a map that is the same at every depth: tissue at any depth of a fold counts."""
    same = unchanging_axes(field, box)
    return getattr(field, "plane", None) if same else None


# ---- tissue that leaves the box --------------------------------------------------------------------------------------


def cut_off_note(volume: Volume, field: AbstractField, box: Grid) -> str:
    """A sentence on the sides of a box beyond which tissue is moved; empty where all of it stays inside.

    Sides within the volume are left out: there tissue is cut off on request.
    """
    sides = [
        name
        for name, shell in zip(side_names(box), _shells(box), strict=True)
        if _outside(volume.grid, shell) and _shows_tissue(volume, field, shell)
    ]
    return cut_off_text(tuple(sides))


def _shells(box: Grid) -> Iterator[Floats]:
    """Places beyond each side of a box, in the order of :func:`side_names`."""
    counts, beyond = np.array(box.shape[::-1]), leaving_voxels(box)
    for axis in range(3):
        others = [np.linspace(0, n - 1, min(int(n), _SHELL)) for n in np.delete(counts, axis)]
        flat = np.stack(np.meshgrid(*others, indexing="ij"), axis=-1).reshape(-1, 2)
        for at in (-0.5 - beyond[axis], counts[axis] - 0.5 + beyond[axis]):
            yield box.index_to_point(np.insert(flat, axis, at, axis=1))


def _index(grid: Grid, places: Floats) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The voxels (n, 3) that are nearest to places, and whether these are in the grid."""
    index = np.rint(np.clip(grid.point_to_index(places), -1e9, 1e9)).astype(np.int64)
    return index, np.asarray(((index >= 0) & (index < np.array(grid.shape[::-1]))).all(axis=1))


def _outside(grid: Grid, places: Floats) -> bool:
    return not _index(grid, places)[1].any()


def _shows_tissue(volume: Volume, field: AbstractField, places: Floats) -> bool:
    index, inside = _index(volume.grid, places + field.displacement(places))
    if not inside.any():
        return False
    x, y, z = index[inside].T
    return bool(foreground_at(volume, z, y, x).any())

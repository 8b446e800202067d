"""Distances from the voxels of a lattice to triangles, and the test whether voxels are inside them.

Triangles are given by index coordinates (i, j, k) of their corners; distances are physical. Only voxels near a triangle
are compared with it, which is exact; every other voxel takes the point of the surface that the nearest of those found.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from threading import Lock
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage
from deformnb._typing import Progress
from deformnb.errors import DeformError
from deformnb.volume.volume import Grid
from deformnb.warping.planning import run_parts

AnyArray = NDArray[Any]

_PAIRS = 1 << 19  # voxels and triangles compared at once: their arrays stay in the processor's cache
_LONGEST = 6.0  # edges of more voxels are halved, else the box around a slanted triangle is mostly empty
_ELSEWHERE = "no face of the mesh passes through the grid; choose a grid that contains the mesh."
_ASIDE = np.array([1.1e-6, 2.3e-6])  # rays pass next to corners that are exactly on the lattice, as isosurfaces' do


def distances(corners: AnyArray, faces: AnyArray, grid: Grid, *, oriented: bool, progress: Progress | None) -> AnyArray:
    """Signed distances [z, y, x], float32, negative inside.

    Parameters
    ----------
    corners : (N, 3) index coordinates.
    faces : (M, 3) of a closed surface.
    oriented : whether all faces show the same side to the outside, so that bodies may overlap.
    """

    def part(begin: float, end: float) -> Progress | None:
        return None if progress is None else lambda done: progress(begin + done * (end - begin))

    triangles, keys = _near_voxels(corners[faces], grid, part(0.0, 0.5))
    near = np.flatnonzero(keys != _NONE)
    if not len(near):
        raise DeformError(_ELSEWHERE)
    place = _Lattice(grid).centres(near)
    closest = place - _offsets(place, triangles, (keys[near] & np.uint64(0xFFFFFFFF)).astype(np.int64))
    del keys
    out = _spread_distances(near, closest, grid, part(0.5, 0.9))
    inside = _inside(corners, faces, grid.shape, oriented)
    np.negative(out, out=out, where=inside)
    if progress is not None:
        progress(1.0)
    return out


@dataclass(frozen=True)
class _Lattice:
    """Voxels of a grid by their number in memory, in lengths along the grid's own axes."""

    grid: Grid

    def centres(self, flat: AnyArray) -> AnyArray:
        k, j, i = np.unravel_index(flat, self.grid.shape)
        return np.stack([i, j, k], axis=1) * np.asarray(self.grid.spacing)


_NONE = np.uint64(0xFFFFFFFFFFFFFFFF)


def _near_voxels(triangles: AnyArray, grid: Grid, progress: Progress | None) -> tuple[AnyArray, AnyArray]:
    """Corners of small triangles (M, 3, 3) as lengths; per voxel the squared distance and number of the nearest.

    Both are one number, the bits of a float32 before those of the triangle's: positive floats are ordered like their
    bits, so that the smallest number is the nearest triangle. All voxels within a voxel's diagonal of the surface have
    one: the corners of every cell that the surface passes through.
    """
    spacing, shape = np.asarray(grid.spacing), np.array(grid.shape[::-1])
    band = float(np.linalg.norm(spacing)) * 1.001
    small = _subdivide(triangles * spacing, _LONGEST * float(spacing.min()))
    low = np.maximum(np.ceil((small.min(axis=1) - band) / spacing), 0).astype(np.int64)
    size = np.minimum(np.floor((small.max(axis=1) + band) / spacing), shape - 1).astype(np.int64) + 1 - low
    kept = np.flatnonzero((size > 0).all(axis=1))
    small, low, size = small[kept], low[kept], size[kept]
    if not len(small):
        raise DeformError(_ELSEWHERE)
    if len(small) >= 1 << 32:
        raise DeformError("the mesh has too many faces for a grid this fine; choose a smaller size.")
    keys, lock = np.full(grid.size, _NONE), Lock()

    def work(chosen: slice) -> None:
        number, box = _boxes(size[chosen])
        start = low[chosen]
        edges = _Edges(small[chosen] - (start * spacing)[:, None])
        squared = edges.squared_distances(number, box.astype(np.float32) * spacing.astype(np.float32))
        near = np.flatnonzero(squared <= np.float32(band * band))
        number = number[near]
        i, j, k = (start[number] + box[near]).T
        key = squared[near].view(np.uint32).astype(np.uint64) << np.uint64(32)
        key |= (number + chosen.start).astype(np.uint64)
        with lock:
            np.minimum.at(keys, (k * shape[1] + j) * shape[0] + i, key)

    run_parts(list(_chunks(size.prod(axis=1))), work, progress)
    return small, keys


def _chunks(counts: AnyArray) -> Iterator[slice]:
    """Runs of rows of about :data:`_PAIRS` pairs together."""
    group = np.cumsum(counts) // _PAIRS
    ends = np.append(np.flatnonzero(np.diff(group)) + 1, len(counts))
    start = 0
    for end in ends:
        if end > start:
            yield slice(start, int(end))
        start = int(end)


def _boxes(size: AnyArray) -> tuple[AnyArray, AnyArray]:
    """For boxes (n, axes): the number of the box of each of their lattice points, and its place in the box."""
    counts = size.prod(axis=1)
    number = np.repeat(np.arange(len(size)), counts)
    rest = np.arange(len(number)) - np.repeat(np.cumsum(counts) - counts, counts)
    place = np.empty((len(number), size.shape[1]), dtype=np.int32)
    for axis in range(size.shape[1]):
        rest, place[:, axis] = np.divmod(rest, size[number, axis])
    return number, place


def _subdivide(triangles: AnyArray, longest: float) -> AnyArray:
    """The same surface in triangles whose edges are no longer; the longest edge of a triangle is halved each time."""
    done = []
    while len(triangles):
        lengths = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        edge = lengths.argmax(axis=1)
        long = lengths.max(axis=1) > longest
        done.append(triangles[~long])
        rows = np.arange(len(triangles))
        a, b, c = (triangles[rows, (edge + k) % 3][long] for k in range(3))
        middle = (a + b) / 2
        triangles = np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])
    return np.concatenate(done) if done else triangles


class _Edges:
    """Triangle data that distances need again and again; places are relative to an origin of each triangle."""

    def __init__(self, triangles: AnyArray) -> None:
        a, b, c = (triangles[:, k] for k in range(3))
        self.start = triangles.astype(np.float32)
        self.edge = np.stack([b - a, c - b, a - c], axis=1)
        length = (self.edge**2).sum(axis=2)
        self.per_length = (1 / np.where(length > 0, length, np.inf)).astype(np.float32)
        normal = np.cross(b - a, c - a)
        area = np.linalg.norm(normal, axis=1, keepdims=True)
        self.flat = area[:, 0] <= 1e-12 * length.max(axis=1, initial=0.0)  # a line or a point has edges only
        self.normal = (normal / np.where(area > 0, area, 1)).astype(np.float32)
        self.side = np.cross(self.edge, self.normal[:, None]).astype(np.float32)  # outwards, in the triangle's plane
        self.edge = self.edge.astype(np.float32)

    def squared_distances(self, number: AnyArray, places: AnyArray) -> AnyArray:
        """Squared distances of places (n, 3) to the triangles of these numbers."""
        beside = np.zeros(len(number), dtype=bool)
        nearest = np.full(len(number), np.inf, dtype=np.float32)
        for k in range(3):
            to = places - self.start[number, k]
            beside |= _dot(to, self.side[number, k]) > 0
            along = np.clip(_dot(to, self.edge[number, k]) * self.per_length[number, k], 0, 1)
            to -= along[:, None] * self.edge[number, k]
            np.minimum(nearest, _dot(to, to), out=nearest)
        height = _dot(places - self.start[number, 0], self.normal[number])
        return np.where(beside | self.flat[number], nearest, height * height)


def _dot(a: AnyArray, b: AnyArray) -> AnyArray:
    return np.einsum("nk,nk->n", a, b)


def _offsets(places: AnyArray, triangles: AnyArray, number: AnyArray) -> AnyArray:
    """Vectors (n, 3) from the nearest point of the triangle of each number to its place, in float64."""
    out, best = np.empty_like(places), np.full(len(places), np.inf)
    beside = np.zeros(len(places), dtype=bool)
    corners = triangles[number]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for k in range(3):
        start, edge = corners[:, k], corners[:, (k + 1) % 3] - corners[:, k]
        to = places - start
        beside |= _dot(to, np.cross(edge, normal)) >= 0  # zero as well: a triangle without area has edges only
        length = _dot(edge, edge)
        along = np.clip(_dot(to, edge) / np.where(length > 0, length, 1), 0, 1)
        to = to - along[:, None] * edge
        nearer = _dot(to, to) < best
        best, out = np.where(nearer, _dot(to, to), best), np.where(nearer[:, None], to, out)
    over = ~beside
    n = normal[over]
    height = _dot(places[over] - corners[over, 0], n) / _dot(n, n)
    out[over] = height[:, None] * n
    return out


def _spread_distances(near: AnyArray, closest: AnyArray, grid: Grid, progress: Progress | None) -> AnyArray:
    """Distances of all voxels to the point of the surface that is closest to the nearest voxel at the surface."""
    away = np.ones(grid.shape, dtype=bool)
    away.reshape(-1)[near] = False
    where = ndimage.distance_transform_edt(
        away, sampling=grid.spacing[::-1], return_distances=False, return_indices=True
    )
    row = np.empty(grid.size, dtype=np.int32)
    row[near] = np.arange(len(near), dtype=np.int32)
    row, points = row.reshape(grid.shape), closest.astype(np.float32)
    out = np.empty(grid.shape, dtype=np.float32)
    nz, ny, nx = grid.shape
    x, y = np.arange(nx) * np.float32(grid.spacing[0]), np.arange(ny)[:, None] * np.float32(grid.spacing[1])

    def work(z: int) -> None:
        point = points[row[tuple(where[:, z])]]
        height = np.float32(z * grid.spacing[2])
        squared = (x - point[..., 0]) ** 2 + (y - point[..., 1]) ** 2 + (height - point[..., 2]) ** 2
        np.sqrt(squared, out=out[z])

    run_parts(range(nz), work, progress)
    return out


def _inside(corners: AnyArray, faces: AnyArray, shape: tuple[int, int, int], oriented: bool) -> AnyArray:
    """Voxels [z, y, x] inside a closed surface: how often, and in which direction, a ray along x has entered it.

    Faces that are oriented count by direction, so that bodies may overlap; others alternate, in and out.
    """
    nz, ny, nx = shape
    begin, sign, row = _crossings(corners, faces, (ny, nz))
    first = np.ceil(begin).clip(0, nx).astype(np.int64)
    turns = np.zeros((nz * ny, nx + 1), dtype=np.int16)
    np.add.at(turns, (row, first), sign if oriented else np.int16(1))
    np.cumsum(turns, axis=1, out=turns)
    turns = turns[:, :nx].reshape(shape)
    return turns != 0 if oriented else turns % 2 == 1


def _crossings(corners: AnyArray, faces: AnyArray, rows: tuple[int, int]) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Intersections of rays along x with faces: place on the ray, +1 or -1 by the side, number of the ray.

    On which side of an edge a ray passes is decided from the edge's ends alone, in a fixed order. So both faces
    of an edge agree, and a ray never slips between them.
    """
    plane = corners[:, 1:]
    of_face = plane[faces]
    low = np.maximum(np.ceil(of_face.min(axis=1) - _ASIDE), 0).astype(np.int64)
    size = np.minimum(np.floor(of_face.max(axis=1) - _ASIDE), np.array(rows) - 1).astype(np.int64) + 1 - low
    kept = np.flatnonzero((size > 0).all(axis=1))
    found = []
    for chosen in _chunks(size[kept].prod(axis=1)):
        number, place = _boxes(size[kept[chosen]])
        face = kept[chosen][number]
        lattice = low[face] + place
        found.append(_hits(corners, faces[face], lattice, lattice + _ASIDE, rows[0]))
    if not found:
        return np.zeros(0), np.zeros(0, dtype=np.int16), np.zeros(0, dtype=np.int64)
    begin, sign, row = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return begin, sign, row


def _hits(
    corners: AnyArray, faces: AnyArray, lattice: AnyArray, ray: AnyArray, width: int
) -> tuple[AnyArray, AnyArray, AnyArray]:
    left, weights = [], []
    for k in range(3):
        a, b = faces[:, k], faces[:, (k + 1) % 3]
        p, q = corners[np.minimum(a, b), 1:], corners[np.maximum(a, b), 1:]
        area = (q[:, 0] - p[:, 0]) * (ray[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (ray[:, 0] - p[:, 0])
        left.append((area > 0) == (a < b))
        weights.append(np.where(a < b, area, -area))
    hit = np.flatnonzero((left[0] == left[1]) & (left[1] == left[2]))
    weight = np.stack(weights, axis=1)[hit][:, [1, 2, 0]]  # of the corner opposite the edge
    total = weight.sum(axis=1)
    x = corners[faces[hit], 0]
    flat = total == 0  # seen from its edge: any place on it
    begin = np.where(flat, x[:, 0], (weight * x).sum(axis=1) / np.where(flat, 1, total))
    sign = np.where(left[0][hit], 1, -1).astype(np.int16)
    return begin, sign, lattice[hit, 1] * width + lattice[hit, 0]

"""Regions made of pixels or voxels: labels of a segmentation, and their silhouettes on a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage

from deformnb.checks import LARGEST_COORDINATE
from deformnb.errors import DeformError
from deformnb.plane import Plane, Raster
from deformnb.regions import AbstractRegion
from deformnb.volume import Grid, Volume

# Masks of more voxels are measured at half the resolution: 256^3 takes 0.7 s instead of 6 s. The mask only grows by it.
_MOST_VOXELS = 4_000_000

# The distance of what is nowhere. Infinity itself would become NaN in interpolations (0 inf) and in the scales of rigid
# parts (inf / inf); this is the largest coordinate that a point may have, and its square is still a float32.
_NOWHERE = LARGEST_COORDINATE


@jax.tree_util.register_pytree_node_class
@dataclass(frozen=True, eq=False)
class Mask(AbstractRegion):
    """The pixels or voxels of a mask; the boundary runs along their faces.

    Parameters
    ----------
    values : bool, [v, u] on a raster or [z, y, x] on a grid.
    lattice : where they lie, a :class:`~deformnb.plane.Raster` or a :class:`~deformnb.volume.Grid`.

    Notes
    -----
    Distances of the centres are those to the faces of the voxel with the nearest centre, at most half its diagonal
    more than to the nearest face; between the centres they are interpolated. Beyond the lattice the way to it is added:
    a mask that reaches the lattice's edge goes on there, as far as it is deep. A mask of more than 4 million voxels is
    measured at half the resolution, which shifts its boundary by up to a voxel. A mask in which nothing is set lies at
    1e15, farther than any point may be, and one in which all is set is around every place, as deep.

    Examples
    --------
    >>> bone = Mask(np.array([[False, True, True, False]]), Raster((1, 4), (2.0, 2.0), (0.0, 0.0)))
    >>> bone.signed_distance([[1.0, 0.0], [6.0, 0.0]]).tolist()
    [0.0, 1.0]
    """

    values: NDArray[np.bool_]
    lattice: Raster | Grid
    kind: ClassVar[str] = "mask"

    def __post_init__(self) -> None:
        values = np.array(self.values)
        if values.dtype != np.bool_:
            raise DeformError(f"a mask holds True and False, got {values.dtype}; compare it with a label first.")
        if values.shape != tuple(self.lattice.shape):
            raise DeformError(f"a mask of shape {values.shape} does not fit a lattice of {tuple(self.lattice.shape)}.")
        values.flags.writeable = False
        object.__setattr__(self, "values", values)

    @classmethod
    def from_labels(cls, volume: Volume, labels: int | Sequence[int] | None = None) -> Mask:
        """The voxels of these labels of a volume, of any but 0 if None.

        Raises
        ------
        DeformError
            If no voxel has one of them; the message names the labels there are.
        """
        wanted = [labels] if isinstance(labels, int | np.integer) else labels
        values = volume.values != 0 if wanted is None else np.isin(volume.values, list(wanted))
        if not values.any():
            present = np.unique(volume.values)[:20].tolist()
            raise DeformError(f"no voxel of {volume.name or 'the volume'} has a label of {wanted}; it has {present}.")
        return cls(values, volume.grid)

    def silhouette(self, plane: Plane) -> Mask:
        """What of a mask in space is seen on a picture: every pixel with a voxel of it in front or behind."""
        if not isinstance(self.lattice, Grid):
            raise DeformError("this mask lies on a picture already.")
        grid = self.lattice
        along = np.abs(plane.frame[:2] @ np.asarray(grid.direction))  # [u v, axis x y z]
        is_aligned = bool((along.max(axis=1) > 1 - 1e-6).all())
        spacing = [grid.spacing[int(k)] if is_aligned else min(grid.spacing) for k in along.argmax(axis=1)]
        corners = plane.to_plane(grid.corners(centres=True))[:, :2]
        origin = corners.min(axis=0)
        counts = np.round(np.ptp(corners, axis=0) / spacing).astype(int) + 1
        flat = np.zeros((counts[1], counts[0]), dtype=bool)
        # What hides the rest is enough; on an oblique picture places so dense that no pixel between others stays empty.
        surface = self.values if is_aligned else self.values & ~ndimage.binary_erosion(self.values)
        index = np.argwhere(surface)[:, ::-1].astype(np.float64)
        counted = [1 if is_aligned else int(np.ceil(2 * s / min(grid.spacing))) for s in grid.spacing]
        for offset in product(*((np.arange(n) + 0.5) / n - 0.5 for n in counted)):
            at = plane.to_plane(grid.index_to_point(index + np.array(offset)))[:, :2]
            cell = np.clip(np.round((at - origin) / spacing).astype(int), 0, counts - 1)
            flat[cell[:, 1], cell[:, 0]] = True
        return Mask(flat, Raster((int(counts[1]), int(counts[0])), (spacing[0], spacing[1]),
                                 (float(origin[0]), float(origin[1]))))

    @property
    def dim(self) -> int:
        return 2 if isinstance(self.lattice, Raster) else 3

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Mask):
            return NotImplemented
        return self.lattice == other.lattice and np.array_equal(self.values, other.values)

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((self.lattice, self.values.tobytes()))  # 20 ms for 256^3, and a drag asks for it at every block

    @cached_property
    def _measured(self) -> tuple[NDArray[np.float32], Raster | Grid]:
        """Signed distances of the centres, and where those lie."""
        values, lattice = self.values, self.lattice
        if values.size > _MOST_VOXELS and isinstance(lattice, Grid):
            values, lattice = _halved(values, lattice)
        h = np.asarray(lattice.spacing)[::-1]
        outside, inside = _box_distance(values, h), _box_distance(~values, h)
        return np.where(values, -inside, outside).astype(np.float32), lattice

    def signed_distance(self, points: ArrayLike) -> NDArray[np.float64]:
        distances, lattice = self._measured
        p = np.asarray(points, dtype=np.float64)
        index, beyond = _index_within(lattice, p.reshape(-1, self.dim), np)
        # float32 samples: SciPy would otherwise copy them to float64 at every call
        found = ndimage.map_coordinates(distances, index.T[::-1], order=1, mode="nearest", output=np.float64)
        return (found + beyond).reshape(p.shape[:-1])

    def __call__(self, points: Any) -> Any:
        distances, lattice = self._measured
        index, beyond = _index_within(lattice, jnp.asarray(points), jnp)
        at = [index[..., k] for k in reversed(range(self.dim))]
        values = jnp.asarray(distances).astype(index.dtype)
        return jax.scipy.ndimage.map_coordinates(values, at, order=1, mode="nearest") + beyond

    def tree_flatten(self) -> tuple[tuple[Any, ...], Any]:
        """What JAX traces, and what it keeps."""
        distances, lattice = self._measured
        return (distances,), (lattice, self.dim)

    @classmethod
    def tree_unflatten(cls, aux: Any, leaves: tuple[Any, ...]) -> Mask:
        """The same again, of what JAX has made of it; nothing is checked."""
        made = object.__new__(cls)
        object.__setattr__(made, "lattice", aux[0])
        made.__dict__["_measured"] = (leaves[0], aux[0])
        return made


def _halved(values: NDArray[np.bool_], grid: Grid) -> tuple[NDArray[np.bool_], Grid]:
    """Blocks of 2 x 2 x 2 voxels, set where one of them is."""
    odd = [n % 2 for n in values.shape]
    even = np.pad(values, [(0, n) for n in odd])
    z, y, x = (n // 2 for n in even.shape)
    coarse: NDArray[np.bool_] = np.asarray(even.reshape(z, 2, y, 2, x, 2).any(axis=(1, 3, 5)))
    first = grid.index_to_point([0.5, 0.5, 0.5])
    spacing = tuple(2 * s for s in grid.spacing)
    return coarse, Grid((z, y, x), spacing, tuple(first), grid.direction)  # type: ignore[arg-type]


def _box_distance(values: NDArray[np.bool_], spacing: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of every centre to the nearest voxel that is set, measured to its faces; 1e15 if there is none."""
    if not values.any():  # SciPy would return a plausible ramp
        return np.full(values.shape, _NOWHERE)
    nearest = ndimage.distance_transform_edt(~values, sampling=spacing, return_distances=False, return_indices=True)
    square = np.zeros(values.shape)
    for axis, (at, h) in enumerate(zip(nearest, spacing, strict=True)):
        own = np.arange(values.shape[axis]).reshape([-1 if k == axis else 1 for k in range(values.ndim)])
        square += np.maximum(np.abs(at - own) - 0.5, 0.0) ** 2 * h ** 2
    return np.sqrt(square)


def _index_within(lattice: Raster | Grid, points: Any, xp: Any) -> tuple[Any, Any]:
    """Fractional index of the nearest place within a lattice, and how far the point lies from there."""
    origin = np.asarray(lattice.origin)
    shape = np.asarray(lattice.shape[::-1])
    if isinstance(lattice, Raster):
        index, matrix = (points - origin) / np.asarray(lattice.spacing), np.diag(lattice.spacing)
    else:
        index, matrix = (points - origin) @ np.linalg.inv(lattice.matrix).T, lattice.matrix
    clamped = xp.clip(index, 0.0, shape - 1.0)
    square = (((index - clamped) @ matrix.T) ** 2).sum(-1)
    return clamped, xp.sqrt(xp.where(square > 0, square, 1.0)) * (square > 0)

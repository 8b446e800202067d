"""What a viewer in front of a plane sees of a volume: layers one behind the other, cut off and in perspective.

A perspective needs no ray of its own: a layer twice as far from the eye is looked up twice as wide, and what is then
put together in parallel is what the eye sees.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb.clipping import Part
from deformnb.fields import Identity
from deformnb.plane import Plane
from deformnb.sampling import aligned_empty
from deformnb.shading import glow_of
from deformnb.volume import Grid, Volume
from deformnb.warp import warp

Blocks: TypeAlias = Iterator[tuple[NDArray[Any], int]]

_NEAREST = 0.02  # of the distance of the eye: what is nearer to it is not seen


@dataclass(frozen=True)
class Eye:
    """A viewer in front of a plane's origin.

    Parameters
    ----------
    distance : from the plane; what lies in the plane has its true size.
    width, height : lengths of what is seen of the plane.
    """

    distance: float
    width: float
    height: float

    def lattice(self, grid: Grid, plane: Plane, spacing: float) -> Grid:
        """Samples along a plane's axes as wide as what is seen of it, and as deep as ``grid`` before the eye."""
        depths = plane.to_plane(grid.corners())[:, 2]
        near, far = max(float(depths.min()), (_NEAREST - 1) * self.distance), float(depths.max())
        wide, tall, deep = (max(1, int(np.ceil(length / spacing - 1e-9)))
                            for length in (self.width, self.height, far - near))
        first = [-(wide - 1) / 2 * spacing, -(tall - 1) / 2 * spacing, (near + far - (deep - 1) * spacing) / 2]
        axes = tuple(map(tuple, plane.frame.T))
        return Grid((deep, tall, wide), (spacing,) * 3, tuple(plane.from_plane(first)), axes)  # type: ignore[arg-type]

    def layer(self, lattice: Grid, plane: Plane, k: int) -> Grid:
        """The places of a layer of the lattice: wider the farther it is."""
        a, b, depth = plane.to_plane(lattice.index_to_point([0, 0, k]))
        share = max(_NEAREST, 1 + depth / self.distance)
        d = lattice.spacing[0]
        return replace(lattice, shape=(1, *lattice.shape[1:]), spacing=(d * share, d * share, d),
                       origin=tuple(plane.from_plane([a * share, b * share, depth])))


def blocks(volume: Volume, lattice: Grid, layers: int, margin: int, plane: Plane, part: Part | None = None,
           eye: Eye | None = None) -> Blocks:
    """Blocks of layers, the last one as large as the others: one compiled function resamples all of them.

    Parameters
    ----------
    lattice : along the axes of ``plane``.
    layers : in one block.
    margin : layers before and behind each block.
    part : outside of it is background.
    eye : sees the layers, which are then wider the farther they are.
    """
    if eye is not None:
        volume = _aligned(volume)
    for k in range(0, lattice.shape[0], layers):
        first, count = k - margin, layers + 2 * margin
        if eye is None:
            values = _seen(volume, lattice.crop((first, 0, 0), (count, *lattice.shape[1:])), part)
        else:
            values = np.concatenate([_seen(volume, eye.layer(lattice, plane, first + n), part) for n in range(count)])
        yield values, min(layers, lattice.shape[0] - k)


def faces_of(part: Part, lattice: Grid, plane: Plane, eye: Eye | None, light: NDArray[Any]) -> dict[str, Any]:
    """The faces of a part for :func:`deformnb.shading.composite`, in coordinates of the plane.

    Returns
    -------
    dict
        ``planes`` (6, 4): how far within it a place (a, b, c, 1) is; ``nearness`` (6,): 1 over the depth, along n, to
        which it is lit, 0 of one that is not seen; ``glow`` (6,): how brightly; and where the lattice begins.
    """
    points, inward = part.sides()
    normals = inward @ plane.frame.T
    offsets = ((np.asarray(plane.origin) - points) * inward).sum(axis=-1)
    d = lattice.spacing[0]
    deep = 2 * max(d, min(part.grid.spacing))  # as the live view lights them: wholly for a voxel, then less and less
    # Depth within a face that is 1 deep along n is its slope deep: seen at all only if it looks to the viewer.
    slope = np.maximum(normals[:, 2], 0.0)
    first = plane.to_plane(lattice.origin)
    return {"planes": np.column_stack([normals, offsets]).astype(np.float32),
            "nearness": np.where(slope > 1e-3, 1 / (deep * np.maximum(slope, 1e-3)), 0).astype(np.float32),
            "glow": glow_of(normals, light), "first": tuple(np.float32(c) for c in first), "step": np.float32(d),
            "bend": np.float32(0.0 if eye is None else 1 / eye.distance)}


def _seen(volume: Volume, lattice: Grid, part: Part | None) -> NDArray[Any]:
    seen = warp(volume, Identity(3), output=lattice)
    return seen.values if part is None else np.where(part.holds(lattice), seen.values,
                                                     volume.dtype.type(volume.background))


def _aligned(volume: Volume) -> Volume:
    """The volume where JAX shares its memory: it is looked at layer by layer, and must not be copied for each."""
    values = aligned_empty(volume.shape, volume.dtype)
    values[...] = volume.finite_values
    return replace(volume, values=values)

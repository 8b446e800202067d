"""Displacements of compositions at every voxel, composed of the input of the warp's kernel, in plain NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.rbf.fields import AbstractField
from deformnb.volume.volume import Grid
from deformnb.warping.compositions import ComposedEvaluator, Displacements, NodeTable
from deformnb.warping.planning import Tables


def interpolate_nodes(d: NDArray[Any], tables: Tables) -> NDArray[Any]:
    """Displacements (3, z, y, x) at voxels, from those at nodes."""
    for axis, (first, weights) in enumerate(tables):
        column = [-1 if k == axis else 1 for k in range(3)]
        d = np.sum([w.reshape(column) * d.take(first + k, axis + 1) for k, w in enumerate(weights)], axis=0)
    return d


def values_at_voxels(
    found: Displacements, table: NodeTable | ComposedEvaluator, block: tuple[slice, slice], grid: Grid
) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """Displacements (3, z, y, x) at the voxels of a block that lie in the grid, and opacity [z, y, x] at cuts."""
    d = np.stack([np.asarray(part) for part in found.d])
    opacity = None if found.opacity is None else np.array(found.opacity)
    if found.nodes is not None:
        d = interpolate_nodes(d, found.nodes)
    start = np.array([part.start for part in block])
    d = d[:, : grid.shape[0] - start[0], : grid.shape[1] - start[1]]
    for patch in found.patches:
        z, y, x = patch.box
        part = d[:, z.start - start[0] : z.stop - start[0], y.start - start[1] : y.stop - start[1], x]
        np.copyto(part, interpolate_nodes(np.stack(patch.d), patch.nodes), where=patch.is_own)
        if patch.is_hidden:
            opacity = np.ones(d.shape[1:], np.float32) if opacity is None else opacity
            opacity[z.start - start[0] : z.stop - start[0], y.start - start[1] : y.stop - start[1], x][patch.is_own] = 0
    for voxels, values, share in (*found.exact, *(find() for find in table.replacements())):
        z, y, x = voxels[0] - start[0], voxels[1] - start[1], voxels[2]
        own = (z >= 0) & (z < d.shape[1]) & (y >= 0) & (y < d.shape[2])  # cells may extend beyond the block
        at = z[own], y[own], x[own]
        d[:, *at] = np.asarray(values)[:, own]
        if share is not None:
            opacity = np.ones(d.shape[1:], np.float32) if opacity is None else opacity
            opacity[at] = share[own]
    return d, opacity


def chain_at_voxels(field: AbstractField, grid: Grid) -> tuple[NDArray[Any], NDArray[Any] | None]:
    """The same of a composition on all of its grid."""
    chain, block = ComposedEvaluator(field, grid), (slice(0, grid.shape[0]), slice(0, grid.shape[1]))
    chain.prepare()
    return values_at_voxels(chain.block(block), chain, block, grid)

"""Region growing: the voxels of a range of values that hang together with a seed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import ndimage, scipy
from deformnb._typing import Progress
from deformnb.errors import DeformError

_SLAB = 2_000_000  # voxels that are labelled between two reports of progress: some 50 ms


def connected_threshold(
    values: NDArray[np.number], seed: tuple[int, int, int], low: float, high: float, progress: Progress | None = None
) -> NDArray[np.bool_]:
    """The voxels with ``low <= value <= high`` that are connected with a seed by their faces.

    ITK's ConnectedThresholdImageFilter does the same; scikit-image calls it a flood fill.

    Parameters
    ----------
    values : [z, y, x].
    seed : index (z, y, x) of a voxel.
    low, high : of the values, in their unit.
    progress : called with the finished share from 0 to 1; may raise :class:`~deformnb.errors.Cancelled`.

    Returns
    -------
    bool, [z, y, x].

    Raises
    ------
    DeformError
        If the seed is outside, or its value is.

    Examples
    --------
    >>> values = np.array([[[5, 5, 0, 5]]])
    >>> connected_threshold(values, (0, 0, 1), 4, 6).tolist()
    [[[True, True, False, False]]]
    """
    if not all(0 <= k < n for k, n in zip(seed, values.shape, strict=True)):
        raise DeformError(f"the seed {seed} is outside an array of shape {values.shape}.")
    if not low <= values[seed] <= high:
        raise DeformError(f"the value {values[seed]:g} at the seed is not within {low:g} to {high:g}.")
    depth = max(1, _SLAB // max(1, values.shape[1] * values.shape[2]))
    starts = range(0, values.shape[0], depth)
    labels = np.zeros(values.shape, np.int32)
    count, joined = 0, []
    for start in starts:  # by slabs: SciPy reports no progress of the whole
        part = values[start : start + depth]
        found, more = ndimage.label((part >= low) & (part <= high))
        labels[start : start + depth] = np.where(found > 0, found + count, 0)
        count += more
        if start:
            above, below = labels[start - 1], labels[start]
            both = (above > 0) & (below > 0)
            joined.append(np.unique(np.stack([above[both], below[both]]), axis=1))
        if progress is not None:
            progress(min(1.0, (start + depth) / values.shape[0]) * 0.9)
    one, other = np.concatenate(joined, axis=1) if joined else np.zeros((2, 0), np.int64)
    graph = scipy.sparse.coo_matrix((np.ones(len(one), bool), (one, other)), (count + 1, count + 1))
    group = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    belongs = group == group[labels[seed]]
    belongs[0] = False
    mask: NDArray[np.bool_] = belongs[labels]
    if progress is not None:
        progress(1.0)
    return mask

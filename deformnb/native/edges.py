"""Signed distances to outlines of straight edges, by the compiled loops."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from deformnb.native import jobs, library


def edge_distances(edges: Sequence[NDArray[np.float64]], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Signed distances (n,) of places (n, 2) to the nearest of edges.

    Parameters
    ----------
    edges : starts (E, 2), directions (E, 2), the range along each from ``low`` (E,) to ``high`` (E,), and the normals
        (E, 3, 2) where the nearest place is between its ends, at its start and at its end.
    """
    count = len(edges[0])
    shapes = [(count, 2), (count, 2), (count,), (count,), (count, 3, 2)]
    if [np.shape(part) for part in edges] != shapes or places.ndim != 2 or places.shape[1] != 2:
        raise ValueError(f"arrays of shapes {[np.shape(part) for part in edges]} are no edges of an outline.")
    loops = library.loops()
    if loops is None:
        raise ValueError(f"no loops: {library.why_absent()}.")
    table = np.concatenate([np.reshape(part, (count, -1)) for part in edges], axis=1, dtype=np.float64)
    given, out = np.require(places, np.float64, ("C", "A")), np.empty(len(places))
    job = jobs.EdgeDistances(
        edge=table.ctypes.data, places=given.ctypes.data, out=out.ctypes.data, edges=count, count=len(out)
    )
    loops.edge_distances(ctypes.byref(job))
    return out

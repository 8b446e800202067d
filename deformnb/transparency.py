"""The paper's transparency map A, applied to voxels: what a cut hides gives way to the background."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def faded(values: NDArray[Any], opacity: NDArray[Any], fill: Any, *, discrete: bool) -> NDArray[Any]:
    """``fill + A (value - fill)``; what has nothing in between is shown from A = 1/2 on: labels, bool, a fill of NaN.

    Parameters
    ----------
    values : voxels; changed in place where they may be, else copied.
    discrete : nothing in between may be made up.
    opacity : A from 0 to 1, of the shape of the first axes of ``values``.
    fill : the background, of the type of the voxels.

    Examples
    --------
    >>> faded(np.array([10, 20, 30], np.uint8), np.array([1.0, 0.5, 0.0]), np.uint8(1), discrete=False).tolist()
    [10, 11, 1]
    """
    at = np.nonzero(opacity < 1)  # along the cuts only
    if not len(at[0]):
        return values
    if not values.flags.writeable:
        values = values.copy(order="K")
    some, share = values[at], opacity[at].reshape([-1] + [1] * (values.ndim - opacity.ndim))
    if discrete or not np.isfinite(fill):
        values[at] = np.where(share < 0.5, fill, some)
        return values
    mixed = float(fill) + share * (some.astype(np.float64) - float(fill))
    values[at] = np.floor(mixed + 0.5) if values.dtype.kind in "iu" else mixed
    return values

"""Which values a graphics card tells apart with its 256 bytes: finer where a transfer function looks closely."""

from __future__ import annotations

import numpy as np

from deformnb.transfer import TransferFunction
from deformnb.volume import Volume

Window = tuple[float, float]

_LEVELS = 255
_SHARE = 0.25  # of the window: a transfer function that changes within less of it is seen in bands
_ROOM = 0.05  # of that part, on each side
_FINEST = 1 / 64  # of the window


def fine_window(function: TransferFunction, volume: Volume, coarse: Window) -> Window | None:
    """The part of a window within which a transfer function changes, if bytes over all of it show that in bands.

    Parameters
    ----------
    function : is constant outside of the part, so that no colour changes by leaving out the rest.
    volume : whole numbers are not told apart more finely than they are.
    coarse : the window that all values of interest lie in.

    Examples
    --------
    >>> volume = Volume.from_array(np.array([[[0, 4000]]], dtype=np.int16))
    >>> narrow = TransferFunction(((1000, 0, 0, 0), (1600, 1, 1, 1)), ((1000, 0), (1600, 1)))
    >>> fine_window(narrow, volume, (0.0, 4000.0))
    (970.0, 1630.0)
    >>> fine_window(narrow, volume, (0.0, 2000.0)) is None  # well told apart as it is
    True
    """
    whole = coarse[1] - coarse[0]
    step = 1.0 if np.issubdtype(volume.dtype, np.integer) else 0.0
    if volume.is_labels or volume.dtype == np.bool_ or whole <= _LEVELS * step:
        return None
    values = np.unique([*(c[0] for c in function.colors), *(o[0] for o in function.opacities)])
    differ = np.flatnonzero((np.diff(function(values), axis=0) != 0).any(axis=1))
    if len(differ) == 0:
        return None
    low, high = (float(np.clip(v, *coarse)) for v in (values[differ[0]], values[differ[-1] + 1]))
    if not 0 < high - low < _SHARE * whole:
        return None
    width = max((1 + 2 * _ROOM) * (high - low), _FINEST * whole, _LEVELS * step)
    middle = (low + high) / 2
    return max(coarse[0], middle - width / 2), min(coarse[1], middle + width / 2)


def is_fine_enough(function: TransferFunction, volume: Volume, window: Window, coarse: Window) -> bool:
    """Whether a window that is in use will do: it leaves out nothing, and another one would not be much finer."""
    wanted = fine_window(function, volume, coarse) or coarse
    holds_all = window[0] <= wanted[0] and wanted[1] <= window[1]
    return holds_all and (window == wanted or window[1] - window[0] < (wanted[1] - wanted[0]) / (2 * _SHARE))

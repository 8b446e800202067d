"""Closed forms for very many 2 x 2 or 3 x 3 matrices: NumPy's own take five to fifty times as long for these.

All matrices have their rows and columns on the first two axes, ``a[m, k, ...]``, and vectors their components on the
first one: every entry is then an array of its own, and nothing is gathered.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def determinant(a: NDArray[Any]) -> NDArray[Any]:
    """Determinants (...) of matrices (dim, dim, ...), dim 2 or 3, in their own precision.

    >>> float(determinant(np.array([[1.0, 2.0], [3.0, 4.0]])))
    -2.0
    """
    if len(a) == 2:
        return np.asarray(a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0])
    c = _cofactors_of_row(a, 0)
    return np.asarray(a[0, 0] * c[0] + a[0, 1] * c[1] + a[0, 2] * c[2])


def adjugate(a: NDArray[Any]) -> NDArray[Any]:
    """The matrices (dim, dim, ...) that give the determinant times the unit matrix when multiplied by a."""
    if len(a) == 2:
        return np.stack([np.stack([a[1, 1], -a[0, 1]]), np.stack([-a[1, 0], a[0, 0]])])
    return np.stack([np.stack(_cofactors_of_row(a, m)) for m in range(3)], axis=1)


def _cofactors_of_row(a: NDArray[Any], m: int) -> list[NDArray[Any]]:
    p, q = a[(m + 1) % 3], a[(m + 2) % 3]
    return [p[(k + 1) % 3] * q[(k + 2) % 3] - p[(k + 2) % 3] * q[(k + 1) % 3] for k in range(3)]


def one_plus(a: NDArray[Any]) -> NDArray[Any]:
    """A copy with 1 added to the diagonal: from the derivative of a displacement to that of the map."""
    out = np.array(a)
    for k in range(len(out)):
        out[k, k] += 1
    return out

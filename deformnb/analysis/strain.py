"""Strain: principal stretches of a deformation, their directions, and the change of volume.

The backward map has the derivative ``J = 1 + dD/dx``; the tissue itself is deformed by its inverse ``F = J^-1``, taken
at places of the result. A small circle of tissue becomes an ellipse there, whose axes are the left singular vectors of
F and whose half-lengths, in units of the circle's, are the singular values: ``F = U diag(principal) V^T``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from deformnb._jax import adjugate, determinant, one_plus
from deformnb._typing import Floats
from deformnb.rbf.fields import AbstractField, HasField, as_field
from deformnb.volume.volume import Grid, VolumeLike
from deformnb.warping.points import Landmarks, check_points

_POINTS_AT_A_TIME = 2**16


@dataclass(frozen=True, eq=False)
class Stretches:
    """Principal stretches of the tissue at places of the result. NaN where the map folds: there is no forward map.

    Parameters
    ----------
    area : (...) how much areas (volumes in space) have grown, ``det F = 1 / det J``: 2 is twice as large.
    principal : (..., dim) stretches along the principal directions, largest first; 1 is no change. Their product is
        ``area``, their logarithms are the principal (Hencky) strains.
    directions : (..., dim, dim) unit rows, the principal directions in the result; of either sign.

    Examples
    --------
    >>> import numpy as np
    >>> Stretches(np.array([1.5]), np.array([[1.5, 1.0]]), np.eye(2)[None]).area.tolist()
    [1.5]
    """

    area: Floats
    principal: Floats
    directions: Floats


def stretches(
    field: AbstractField | HasField, points: ArrayLike | Landmarks, *, grid: Grid | VolumeLike | None = None
) -> Stretches:
    """The principal stretches of tissue that the deformation has brought to points (..., dim).

    Parameters
    ----------
    field : backward displacements, of dimension 2 or 3; or a Deformation.
    points : (..., dim), physical, in the result; or landmarks.
    grid : of the volume that is deformed; needed for a Deformation.

    Returns
    -------
    Stretches; NaN where the map folds (``det J <= 0``).

    Raises
    ------
    DeformError
        If the points do not have the field's dimension.

    Examples
    --------
    Everything was stretched to one and a half times its length along a, and to three quarters along b:

    >>> from deformnb.rbf.points import ControlPoints
    >>> from deformnb.rbf.fitting import fit_rbf
    >>> fit = fit_rbf(ControlPoints.from_arrays([[0, 0], [2, 0], [0, 2]], [[0, 0], [3, 0], [0, 1.5]]))
    >>> found = stretches(fit, [4.0, 5.0])
    >>> found.area.round(9).tolist(), found.principal.round(9).tolist(), abs(found.directions).round(9).tolist()
    (1.125, [1.5, 0.75], [[1.0, 0.0], [0.0, 1.0]])
    """
    field = as_field(field, grid)
    x, dim = check_points(points, field, grid), field.dim
    flat = x.reshape(-1, dim)
    area, principal, directions = np.empty(len(flat)), np.empty((len(flat), dim)), np.empty((len(flat), dim, dim))
    for start in range(0, len(flat), _POINTS_AT_A_TIME):
        part = slice(start, start + _POINTS_AT_A_TIME)
        area[part], principal[part], directions[part] = _decompose_derivative(field.jacobian(flat[part]))
    shape = x.shape[:-1]
    return Stretches(area.reshape(shape), principal.reshape(x.shape), directions.reshape(*shape, dim, dim))


def _decompose_derivative(derivative: Floats) -> tuple[Any, Any, Any]:
    """Area (n), stretches (n, dim) and directions (n, dim, dim) from dD/dx (n, dim, dim)."""
    j = one_plus(np.moveaxis(derivative, 0, -1))
    det = determinant(j)
    whole = det > 0
    safe = np.where(whole, det, 1.0)
    forward = np.where(whole, adjugate(j), np.eye(len(j))[:, :, None]) / safe
    principal, directions = (_planar_singular_values if len(j) == 2 else _spatial_singular_values)(forward)
    lost = ~whole
    principal[lost], directions[lost] = np.nan, np.nan
    return np.where(whole, 1 / safe, np.nan), principal, directions


def _planar_singular_values(f: Floats) -> tuple[Floats, Floats]:
    """The singular values of matrices (2, 2, n) and their left vectors, in closed form.

    F is a turn and growth plus a mirrored one, of sizes q and r: their sum stretches most, their difference least.
    """
    (a, b), (c, d) = f
    turn, mirror = np.arctan2(c - b, a + d), np.arctan2(c + b, a - d)
    largest = (np.hypot(a + d, c - b) + np.hypot(a - d, c + b)) / 2
    angle = (turn + mirror) / 2
    along = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)
    least = (a * d - b * c) / largest  # q - r would lose the digits of flattened tissue
    return np.stack([largest, least], axis=-1), np.stack([along, across], axis=1)


def _spatial_singular_values(f: Floats) -> tuple[Floats, Floats]:
    u, principal, _ = np.linalg.svd(np.moveaxis(f, -1, 0))
    return principal, np.swapaxes(u, 1, 2)

"""Turns and shifts: the known motions of rigid parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from deformnb.errors import DeformError

# Directions and lengths that differ by less are rounding of numbers written to a file with seven digits.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class RigidMotion:
    """A turn and a shift of matter, forward: ``x -> matrix @ x + shift``.

    Parameters
    ----------
    matrix : rows of a rotation, 2 x 2 or 3 x 3.
    shift : as many numbers, physical.

    Raises
    ------
    DeformError
        If the matrix does not turn only: it may not stretch, shear or mirror.

    Examples
    --------
    >>> quarter = RigidMotion.turn(90, about=(1, 0))
    >>> quarter([[3, 0]]).round(12).tolist()
    [[1.0, 2.0]]
    >>> half = quarter.power(0.5)
    >>> bool(abs(half(half([[3, 0]])) - quarter([[3, 0]])).max() < 1e-12)
    True
    """

    matrix: tuple[tuple[float, ...], ...]
    shift: tuple[float, ...]

    def __post_init__(self) -> None:
        try:
            m, t = np.array(self.matrix, dtype=np.float64), np.array(self.shift, dtype=np.float64)
        except (TypeError, ValueError):
            m, t = np.zeros((0, 0)), np.zeros(0)
        dim = t.size
        if t.shape not in ((2,), (3,)) or m.shape != (dim, dim) or not (np.isfinite(m).all() and np.isfinite(t).all()):
            raise DeformError("a rigid motion needs a matrix of 2 x 2 or 3 x 3 finite numbers and a shift of as many.")
        if np.abs(m @ m.T - np.eye(dim)).max() > _ROUNDING or np.linalg.det(m) < 0:
            raise DeformError("the matrix of a rigid motion must turn only: not stretch, shear or mirror.")
        if np.abs(m @ m.T - np.eye(dim)).max() > 1e-12:  # the nearest turn, so that the way back leads back
            u, _, v = np.linalg.svd(m)
            m = u @ v
        object.__setattr__(self, "matrix", tuple(map(tuple, m.tolist())))
        object.__setattr__(self, "shift", tuple(t.tolist()))

    @classmethod
    def turn(cls, degrees: float, about: ArrayLike, shift: ArrayLike | None = None,
             axis: ArrayLike | None = None) -> RigidMotion:
        """A turn about a place, then a shift.

        Parameters
        ----------
        degrees : on a picture from its a axis to its b axis, so clockwise to the eye; in space by the right hand.
        about : the place that would stay, (a, b) or (x, y, z).
        axis : direction of the axis of the turn; needed in space only.
        """
        centre, shift, axis = (_numbers(value) for value in (about, shift, axis))
        if centre.shape == (2,):
            angle = np.deg2rad(degrees)
            m = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        elif centre.shape == (3,) == axis.shape and 0 < np.linalg.norm(axis) < np.inf:
            m = Rotation.from_rotvec(np.deg2rad(degrees) * axis / np.linalg.norm(axis)).as_matrix()
        else:
            raise DeformError("a turn is about a place of 2 coordinates, or about one of 3 and an axis.")
        if shift.shape not in ((0,), centre.shape):
            raise DeformError(f"the shift of a turn needs {len(centre)} finite numbers, got shape {shift.shape}.")
        t = centre - m @ centre + (shift if shift.size else 0.0)
        return cls(tuple(map(tuple, m.tolist())), tuple(t.tolist()))

    @property
    def dim(self) -> int:
        """2 on a picture, 3 in space."""
        return len(self.shift)

    @property
    def inverse(self) -> RigidMotion:
        """The way back."""
        m = np.asarray(self.matrix).T
        return RigidMotion(tuple(map(tuple, m.tolist())), tuple((-m @ np.asarray(self.shift)).tolist()))

    def __call__(self, points: ArrayLike) -> NDArray[np.float64]:
        """Where matter at points (..., dim) goes."""
        return np.asarray(points, dtype=np.float64) @ np.asarray(self.matrix).T + np.asarray(self.shift)

    def power(self, t: float) -> RigidMotion:
        """The motion done t times, along one screw: half of it for 0.5, its inverse for -1.

        A matrix does not tell 200 degrees one way from 160 the other; the shorter way is taken.
        """
        if t == 1:
            return self
        dim = self.dim
        m, shift = np.eye(3), np.zeros(3)
        m[:dim, :dim], shift[:dim] = self.matrix, self.shift
        turn = Rotation.from_matrix(m).as_rotvec()
        rate = np.linalg.solve(_path(turn), shift)
        part, along = Rotation.from_rotvec(t * turn).as_matrix(), _path(t * turn) @ (t * rate)
        return RigidMotion(tuple(map(tuple, part[:dim, :dim].tolist())), tuple(along[:dim].tolist()))


def _numbers(value: ArrayLike | None) -> NDArray[np.float64]:
    """An array of float64; an empty one of nothing or of what are no numbers."""
    try:
        return np.asarray([] if value is None else value, dtype=np.float64)
    except (TypeError, ValueError):
        return np.zeros(0)


def _path(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """The integral of exp(s [turn]) over s from 0 to 1: from the velocity of a screw to its shift."""
    angle = float(np.linalg.norm(turn))
    k = np.array([[0, -turn[2], turn[1]], [turn[2], 0, -turn[0]], [-turn[1], turn[0], 0]])
    if angle < 1e-4:  # the next terms are below 1e-9
        return np.eye(3) + k / 2 + k @ k / 6
    return np.eye(3) + k * (1 - np.cos(angle)) / angle**2 + k @ k * (angle - np.sin(angle)) / angle**3

"""Staged deformation: a large drag split into a composition of small maps, each as free of folds as its parts.

An interpolant that takes its points far in one go may fold between them. In n stages the points go a part of their way
at a time, ``p_j = source + j/n (target - source)``; stage j is fitted to ``p_{j-1} -> p_j`` and the maps follow one
another. Every source still comes exactly to its target, and a composition of maps without folds has none: in the limit
it is the flow of a velocity field, a diffeomorphism (Joshi & Miller, IEEE Trans. Image Process. 9 (2000) 1357-1370).
Only points that pass through one another on their straight paths still fold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._jax import pytree
from deformnb.rbf.fields import AbstractField, AbstractFit

MOST_STAGES = 64
"""Stages of a step at most; a drag cut in 64 parts turns by less than 6 degrees in each."""


@pytree(data_fields=["fits"], meta_fields=[])
@dataclass(frozen=True, eq=False, repr=False)
class Staged(AbstractFit):
    """Fits done one after the other, first to last; a backward displacement field of dimension 2 or 3.

    Parameters
    ----------
    fits : at least one, of one dimension.

    Examples
    --------
    >>> from deformnb.rbf.fitting import fit_rbf
    >>> from deformnb.rbf.points import ControlPoints
    >>> fit = fit_rbf(ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9]], [[2, 0], [11, 0], [2, 9]]))
    >>> Staged((fit, fit)).displacement([[5.0, 5.0]]).round(3).tolist()
    [[-4.0, 0.0]]
    """

    fits: tuple[Any, ...]

    @property
    def dim(self) -> int:
        return int(self.fits[0].dim)

    @property
    def ids(self) -> tuple[int, ...]:
        """Ids of the control points behind the fits."""
        return tuple(self.fits[0].ids)

    @property
    def trend(self) -> str:
        """The trend of the fits."""
        return str(self.fits[0].trend)

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks of all fits, each once."""
        return tuple(dict.fromkeys(note for fit in self.fits for note in fit.notes))

    @property
    def steps(self) -> tuple[AbstractField, ...]:
        return self.fits

    def jax_displacement(self, points: Any) -> Any:
        y = points
        for fit in reversed(self.fits):  # backwards: the last stage is sampled first, at the place in the result
            y = y + fit.jax_displacement(y)
        return y - points

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        x = np.asarray(points, dtype=np.float64)
        return np.asarray(self._places_before(x, len(self.fits)) - x)

    def _places_before(self, x: NDArray[np.float64], count: int) -> NDArray[np.float64]:
        """The places before the last ``count`` stages of the tissue at places of the result."""
        for fit in self.fits[::-1][:count]:
            x = x + fit.displacement(x)
        return x

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        """dD/dx by the chain rule: the product of ``1 + dD_j`` at the intermediate places, less 1."""
        y = np.asarray(points, dtype=np.float64)
        one = np.eye(self.dim)
        total = np.broadcast_to(one, (*y.shape, self.dim))
        for fit in reversed(self.fits):
            total = (one + fit.jacobian(y)) @ total
            y = y + fit.displacement(y)
        return np.asarray(total - one)

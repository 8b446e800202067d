"""Staged deformation: a large drag split into a composition of small maps, each as free of folds as its parts.

An interpolant that takes its points far in one go may fold between them. In n stages the points go a part of their way
at a time, ``p_j = source + j/n (target - source)``; stage j is fitted to ``p_{j-1} -> p_j`` and the maps follow one
another. Every source still comes exactly to its target, and a composition of maps without folds has none: in the limit
it is the flow of a velocity field, a diffeomorphism (Joshi & Miller, IEEE Trans. Image Process. 9 (2000) 1357-1370).
Only points that pass through one another on their straight ways cannot be helped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._jax import pytree
from deformnb.checks import shown_value
from deformnb.errors import DeformError
from deformnb.rbf.fields import AbstractField
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.forward import ForwardFit, check_direction, fit_forward, orient_points
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.rbf.partition import LocalFits
from deformnb.rbf.points import ControlPoints, as_control_points
from deformnb.rbf.rigid import RigidInterpolant, RigidPart, fit_rigid
from deformnb.rbf.support import choose_support

MOST_STAGES = 64
"""Stages of a step at most; a drag cut in 64 parts turns by less than 6 degrees in each."""


@pytree(data_fields=["fits"], meta_fields=[])
@dataclass(frozen=True, eq=False, repr=False)
class Staged(AbstractField):
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
        for fit in reversed(self.fits):  # backwards: the place in the result is looked up in the last stage first
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
        """dD/dx by the chain rule: the product of ``1 + dD_j`` at the places on the way, less 1."""
        y = np.asarray(points, dtype=np.float64)
        one = np.eye(self.dim)
        total = np.broadcast_to(one, (*y.shape, self.dim))
        for fit in reversed(self.fits):
            total = (one + fit.jacobian(y)) @ total
            y = y + fit.displacement(y)
        return np.asarray(total - one)


Fit = RBFInterpolant | LocalFits | ForwardFit | RigidInterpolant | Staged
"""Fit of a set of control points; all have notes, ids and a trend."""


def fit_points(
    points: ControlPoints,
    parts: Sequence[RigidPart] = (),
    *,
    stages: int = 1,
    kernel: str = "wendland_c2",
    support: float | None = None,
    trend: str = "affine",
    smoothing: float = 0.0,
    direction: str = "backward",
    previous: Fit | None = None,
) -> Fit:
    """Fit control points, beside rigid parts if there are some, in one go or in stages.

    Parameters
    ----------
    points, kernel, support, trend, smoothing : as for :func:`fit_rbf`; every stage has the same support.
    parts : as for :func:`~deformnb.rbf.rigid.fit_rigid`; in several stages none of them may move.
    stages : from 1 to :data:`MOST_STAGES`.
    direction : a name of :data:`~deformnb.rbf.forward.DIRECTIONS`; forward none of the parts may be switched on.
    previous : the fit before this one; where the points leave an angle open, its trend is kept.

    Raises
    ------
    DeformError
        As those functions do; if a part moves in several stages, or stands beside a fit forward; if points meet on
        their way.

    Examples
    --------
    >>> points = ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9], [9, 9], [4, 4]],
    ...                                    [[0, 0], [9, 0], [0, 9], [9, 9], [9, 5]])
    >>> fit = fit_points(points, stages=8)
    >>> fit.displacement([9.0, 5.0]).round(9).tolist()
    [-5.0, -1.0]
    """
    points = as_control_points(points)
    check_stages(stages, parts)
    check_parts_of_direction(direction, parts)
    settings: dict[str, Any] = {"kernel": kernel, "trend": trend, "smoothing": smoothing}
    if stages == 1:
        if direction == "forward":
            return fit_forward(
                points, support=support, previous=previous if isinstance(previous, ForwardFit) else None, **settings
            )
        if any(part.enabled for part in parts):
            return fit_rigid(points, parts, support=support, **settings)
        kept = previous if isinstance(previous, RBFInterpolant | LocalFits) else None
        return fit_rbf(points, support=support, previous=kept, **settings)
    settings["support"] = support or choose_support([orient_points(points, direction)], **settings)
    return Staged(
        tuple(
            _fit_stage(_partial_drag(points, j, stages), parts, direction, settings, j, stages)
            for j in range(1, stages + 1)
        )
    )


def check_stages(stages: Any, parts: Sequence[RigidPart]) -> None:
    """Refuse a number of stages that cannot be done, naming the part that stands in the way."""
    if isinstance(stages, bool) or not isinstance(stages, int | np.integer) or not 1 <= stages <= MOST_STAGES:
        raise DeformError(
            f"the stages of a step must be a whole number from 1 to {MOST_STAGES}, got {shown_value(stages)}."
        )
    moving = next((p for p in parts if p.enabled and p.motion is not None), None)
    if stages > 1 and moving is not None:
        raise DeformError(
            f"{moving.label} has a motion of its own, which is not done in stages; hold it still, switch "
            "it off, or set the stages of the step back to 1."
        )


def check_parts_of_direction(direction: str, parts: Sequence[RigidPart]) -> None:
    """Refuse an unknown direction, and a rigid part beside a fit forward, which has no weight that vanishes at it."""
    check_direction(direction)
    part = next((p for p in parts if p.enabled), None)
    if direction == "forward" and part is not None:
        raise DeformError(
            f"{part.label} cannot be held beside a fit forward; set the direction of the step to "
            "backward, or switch the part off."
        )


def _partial_drag(points: ControlPoints, j: int, stages: int) -> ControlPoints:
    way = points.target - points.source
    last = points.target if j == stages else points.source + j / stages * way
    return replace(points, source=points.source + (j - 1) / stages * way, target=last.copy())


def _fit_stage(
    points: ControlPoints, parts: Sequence[RigidPart], direction: str, settings: dict[str, Any], j: int, stages: int
) -> RBFInterpolant | LocalFits | ForwardFit | RigidInterpolant:
    try:
        if direction == "forward":
            return fit_forward(points, **settings)
        return fit_rigid(points, parts, **settings)
    except DeformError as error:
        raise DeformError(f"in stage {j} of {stages}, on the straight ways of the points: {error}") from None

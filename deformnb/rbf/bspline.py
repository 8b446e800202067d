"""B-spline fields: displacements as an exact function of coefficients on a grid, as ITK and elastix define them.

With ``i`` the fractional index of a place on the grid, ``c_k`` the coefficients and ``b_n`` the cardinal B-spline of
order n,

    D(x) = sum over k of c_k b_n(i_1 - k_1) b_n(i_2 - k_2) ...   where all n + 1 splines along each axis have one,

which is for (n - 1) / 2 <= i <= N - 1 - (n - 1) / 2 along each axis of N coefficients, and 0 elsewhere. Source: Unser,
Splines: a perfect fit for signal and image processing, IEEE Signal Processing Magazine 16 (1999) 22-38; the domain is
that of ITK's BSplineTransform.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._deferred import ndimage
from deformnb._jax import full_precision, jnp, pytree
from deformnb.errors import DeformError
from deformnb.rbf.fields import BLOCK, AbstractField
from deformnb.volume.volume import Grid

ORDERS = (1, 2, 3)
"""Orders of splines: linear, quadratic, cubic."""

# Direction cosines that differ by less are parallel: over a thousand voxels the place is 1e-9 voxels off.
_PARALLEL = 1e-12


@pytree(data_fields=["coefficients"], meta_fields=["origin", "axes", "order", "unit"])
@dataclass(frozen=True, eq=False, repr=False)
class BSplineField(AbstractField):
    """A field whose components are tensor products of B-splines, and which moves nothing outside its domain.

    Parameters
    ----------
    coefficients : (nz, ny, nx, 3), components x, y, z, or (ny, nx, 2); physical units.
    origin : place of the first coefficient.
    axes : the matrix from an index (i, j, k) to a place relative to the origin, as rows: directions times spacings.
    order : of the splines, one of :data:`ORDERS`.
    unit : of all lengths; "" where it is not known.

    Raises
    ------
    DeformError
        If the shapes do not fit each other, the matrix has no inverse, or an axis has fewer than order + 1
        coefficients.

    Examples
    --------
    One coefficient of a cubic spline counts two thirds at its own node along each axis:

    >>> coefficients = np.zeros((5, 5, 2))
    >>> coefficients[2, 2] = 9.0, 0.0
    >>> field = BSplineField(coefficients, (0.0, 0.0), ((10.0, 0.0), (0.0, 10.0)))
    >>> field.displacement([[20.0, 20.0], [20.0, 30.0], [20.0, 31.0]]).round(6).tolist()
    [[4.0, 0.0], [1.0, 0.0], [0.0, 0.0]]
    """

    coefficients: Any
    origin: tuple[float, ...]
    axes: tuple[tuple[float, ...], ...]
    order: int = 3
    unit: str = ""

    def __post_init__(self) -> None:
        shape, dim = getattr(self.coefficients, "shape", None), len(self.origin)
        if self.order not in ORDERS:
            raise DeformError(f"B-splines have the order {', '.join(map(str, ORDERS))}, got {self.order!r}.")
        if dim not in (2, 3) or np.shape(self.axes) != (dim, dim):
            raise DeformError("a B-spline field has an origin of 2 or 3 numbers, and as many axes of as many numbers.")
        # In logarithms: products of lengths of micrometres in metres would vanish.
        if not np.isfinite(np.linalg.slogdet(np.asarray(self.axes))[1]) or not np.isfinite(self.origin).all():
            raise DeformError("the axes of a B-spline field must be independent, and all numbers finite.")
        if shape is None:  # a tree of JAX without arrays
            return
        if len(shape) != dim + 1 or shape[-1] != dim or min(shape[:-1]) <= self.order:
            raise DeformError(
                f"coefficients of shape {tuple(shape)} do not fit: a B-spline of order {self.order} has "
                f"at least {self.order + 1} along each of its {dim} axes, of {dim} components each."
            )

    def __repr__(self) -> str:
        counts = " x ".join(map(str, self.counts.tolist()))
        where = "over a plane" if self.dim == 2 else "in space"
        return f"<BSplineField: {counts} coefficients of order {self.order} {where}>"

    @property
    def dim(self) -> int:
        return len(self.origin)

    def rescaled(self, factor: float, unit: str) -> BSplineField:
        axes = tuple(tuple(row) for row in (np.asarray(self.axes) * factor).tolist())
        origin = tuple((np.asarray(self.origin) * factor).tolist())
        return BSplineField(np.asarray(self.coefficients) * factor, origin, axes, self.order, unit)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Coefficients along each axis (x, y, z)."""
        return np.array(self.coefficients.shape[-2::-1])

    @property
    def domain(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """First and last fractional index (x, y, z) of the places that are moved."""
        margin = (self.order - 1) / 2
        return np.full(self.dim, margin), np.asarray(self.counts - 1 - margin, dtype=np.float64)

    def index_of(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Fractional index (..., dim) of places (..., dim)."""
        return (points - np.asarray(self.origin)) @ self._inverse.T

    @property
    def _inverse(self) -> NDArray[np.float64]:
        return np.asarray(np.linalg.inv(np.asarray(self.axes, dtype=np.float64)))

    @full_precision
    def jax_displacement(self, points: Any) -> Any:
        x = jnp.asarray(points)
        inverse, origin = jnp.asarray(self._inverse, x.dtype), jnp.asarray(self.origin, x.dtype)
        index = ((x - origin) @ inverse.T).reshape(-1, self.dim)
        coefficients = jnp.asarray(self.coefficients)
        flat = coefficients.astype(jnp.result_type(coefficients, x)).reshape(-1, self.dim)
        start, t, inside = self._cell(jnp, index, float(np.finfo(x.dtype).eps))
        weights = _weights(jnp, t, self.order)
        total = sum(w * flat[at] for at, w in self._terms(start, [weights] * self.dim))
        return jnp.where(inside[:, None], total, 0).reshape(x.shape).astype(x.dtype)

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        x = np.asarray(points, dtype=np.float64)
        flat = x.reshape(-1, self.dim)
        out = np.empty((self.dim, len(flat)))
        values = np.moveaxis(np.asarray(self.coefficients, dtype=np.float64), -1, 0)
        low, high = self.domain
        order: Any = self.order
        for first in range(0, len(flat), BLOCK):
            part = slice(first, first + BLOCK)
            start, t, inside = self._cell(np, self.index_of(flat[part]))
            # SciPy's splines of coefficients are the same sum, compiled: a tenth of the time of NumPy's.
            at = np.clip(start + t + low, low, high).T[::-1]
            for component, into in zip(values, out[:, part], strict=True):
                ndimage.map_coordinates(component, at, output=into, order=order, mode="nearest", prefilter=False)
            out[:, part][:, ~inside] = 0.0
        return np.moveaxis(out, 0, -1).reshape(x.shape)

    def jacobian(self, points: ArrayLike) -> NDArray[np.float64]:
        """Exact: ``b_n'`` in the place of ``b_n`` along one axis; on the border of the domain that of the inside."""
        x = np.asarray(points, dtype=np.float64)
        flat = x.reshape(-1, self.dim)
        out = np.zeros((len(flat), self.dim, self.dim))
        values = np.asarray(self.coefficients, dtype=np.float64).reshape(-1, self.dim)
        for first in range(0, len(flat), BLOCK):
            part = slice(first, first + BLOCK)
            start, t, inside = self._cell(np, self.index_of(flat[part]))
            weights, slopes = _weights(np, t, self.order), _slopes(t, self.order)
            for k in range(self.dim):
                for at, w in self._terms(start, [slopes if axis == k else weights for axis in range(self.dim)]):
                    out[part, :, k] += w * values[at]
            out[part][~inside] = 0.0
        return (out @ self._inverse).reshape(*x.shape, self.dim)

    def components_on_grid(self, grid: Grid) -> NDArray[np.float32]:
        """At the voxels of a grid; where its axes are those of the coefficients, one axis after the other."""
        steps = self._inverse @ grid.matrix if self.dim == 3 else np.ones((3, 3))
        others = steps[~np.eye(3, dtype=bool)]
        if self.dim != 3 or np.abs(others).max() * max(grid.shape) > _PARALLEL * max(1.0, np.abs(steps).max()):
            return super().components_on_grid(grid)
        first = self.index_of(np.asarray(grid.origin))
        values = np.asarray(self.coefficients, dtype=np.float64)
        for axis, n in enumerate(grid.shape):  # z, y, x
            k = 2 - axis
            index = first[k] + steps[k, k] * np.arange(n)
            values = np.moveaxis(np.tensordot(self._axis_weights(index, k), values, (1, axis)), 0, axis)
        return np.ascontiguousarray(np.moveaxis(values, -1, 0), dtype=np.float32)

    def lattice_values(self, rows: ArrayLike, columns: ArrayLike, resolution: float) -> NDArray[np.float32]:
        r, c = np.asarray(rows, dtype=np.float64), np.asarray(columns, dtype=np.float64)
        out = np.empty((self.dim, r.shape[1], c.shape[1]), dtype=np.float32)
        step = max(1, BLOCK // max(1, c.shape[1]))
        for start in range(0, r.shape[1], step):  # all places of a volume together would take 24 bytes each
            places = r[:, start : start + step, None] + c[:, None, :]
            out[:, start : start + step] = np.moveaxis(self.displacement(np.moveaxis(places, 0, -1)), -1, 0)
        return out

    def _axis_weights(self, index: NDArray[np.float64], axis: int) -> NDArray[np.float64]:
        """Weights (n, N) of the coefficients along an axis, 0 outside the domain."""
        low, high = (end[axis] for end in self.domain)
        start, t, inside = _cell_of(np, index, low, high, int(self.counts[axis]), self.order, np.finfo(float).eps)
        out = np.zeros((len(index), int(self.counts[axis])))
        for k, w in enumerate(_weights(np, t, self.order)):
            out[np.arange(len(index)), start + k] = np.where(inside, w, 0.0)
        return out

    def _cell(self, xp: Any, index: Any, eps: float = float(np.finfo(np.float64).eps)) -> tuple[Any, Any, Any]:
        """The first coefficient (n, dim) that counts at an index (n, dim), the place after it, and which are moved."""
        low, high = self.domain
        parts = [
            _cell_of(xp, index[:, k], low[k], high[k], int(self.counts[k]), self.order, eps) for k in range(self.dim)
        ]
        inside = parts[0][2]
        for part in parts[1:]:
            inside = inside & part[2]
        return xp.stack([p[0] for p in parts], axis=-1), xp.stack([p[1] for p in parts], axis=-1), inside

    def _terms(self, start: Any, weights: list[Any]) -> Any:
        """Number of each coefficient that counts, in the order of the array, and its weight (n, 1)."""
        strides = np.cumprod([1, *self.counts[:-1]])
        for offset in product(range(self.order + 1), repeat=self.dim):
            at, w = 0, 1.0
            for k, j in enumerate(offset):
                at = at + (start[:, k] + j) * int(strides[k])
                w = w * weights[k][j][:, k]
            yield at, w[:, None]  # type: ignore[index]


def _cell_of(xp: Any, index: Any, low: float, high: float, count: int, order: int, eps: float) -> tuple[Any, Any, Any]:
    """Along one axis: the first coefficient that counts, the place after its cell begins (0 to 1), and who is moved.

    A place that rounding has moved over the border is in the domain: the border of a grid of control points is
    usually that of the picture, on which voxels are. The root of the rounding unit is far above what rounding does
    to an index, and moves nothing by more than it.
    """
    rounding = eps**0.5
    inside = (index >= low - rounding) & (index <= high + rounding)
    place = xp.clip(xp.where(inside, index, low), low, high) - low  # NaN counts as outside
    start = xp.clip(xp.floor(place), 0, count - order - 1)
    return start.astype(np.int32), place - start, inside


def _weights(xp: Any, t: Any, order: int) -> list[Any]:
    """The splines of order + 1 neighbouring coefficients at a place 0 to 1 in the cell that they share."""
    if order == 1:
        return [1 - t, t]
    if order == 2:
        return [(1 - t) ** 2 / 2, 0.75 - (t - 0.5) ** 2, t**2 / 2]
    u = 1 - t
    return [u**3 / 6, 2 / 3 - t**2 * (2 - t) / 2, 2 / 3 - u**2 * (2 - u) / 2, t**3 / 6]


def _slopes(t: NDArray[np.float64], order: int) -> list[Any]:
    """Derivatives of :func:`_weights`."""
    if order == 1:
        return [-np.ones_like(t), np.ones_like(t)]
    if order == 2:
        return [t - 1, 1 - 2 * t, t]
    u = 1 - t
    return [-(u**2) / 2, -t * (4 - 3 * t) / 2, u * (4 - 3 * u) / 2, t**2 / 2]

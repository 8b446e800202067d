"""Kernel matrices of control points with their factors: dense, a band, or sparse; cached while points are dragged.

A drag moves one centre, and with it one row and one column of the matrix. The factor of all others is still right, so
that the moved points M are bordered to the fixed ones F in ``n^2`` operations where a new factor takes ``n^3``:

    ``[Phi_FF K; K^T C] [alpha_F; alpha_M] = [b_F; b_M]``, K and C with the points where they are now

and the inverse of ``Phi_FF`` is that of the whole matrix with the rows M left out, ``b -> w - G (G_M)^-1 w_M`` with
``w = Phi^-1 b`` and ``G = Phi^-1 E``, E the unit columns of M (G. H. Golub, C. F. Van Loan, Matrix Computations (2013),
sections 2.1 and 6.5). Steps are always taken from the matrix that was factored, so that errors do not add up. Neither G
nor its product with ``b_F`` changes while the same points are dragged: only K is solved for again.

Kernels of order 1 and 2 are definite only modulo the polynomials P of a smaller degree. Their matrix is
``[Phi P; P^T 0]``, and the rows of P^T stay among the fixed ones.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from deformnb._deferred import scipy
from deformnb._jax import float64, jit
from deformnb._typing import Floats
from deformnb.errors import DeformError
from deformnb.native.sums import sum_lattice
from deformnb.rbf.conditioning import PreparedPoints
from deformnb.rbf.evaluation import capacity, is_compiled, profile_of
from deformnb.rbf.kernels import BUILT_IN, AbstractKernel

DENSE = 1000
"""Points up to which the matrix of a compact kernel is a dense one; beyond it is a band."""

_LARGEST_FACTOR = 2**28
"""Numbers of a factor, 2 GiB: wider supports of many points are refused before the memory is taken."""

_KEPT_FROM = 200  # points; the matrix of fewer is factored as quickly as it is found in the cache
_KEPT = 8  # factors: of the regions between a few cuts
_KEPT_NUMBERS = 2**23  # of all of them together: 64 MiB, and as much for the matrices
_MOST_MOVED = 16  # points added to a cached factor, and one of eight: more of them cost as much as a new one


class Matrix(Protocol):
    """Phi + nugget of n points, factored, as two functions of columns (n, k).

    For a kernel of order 1 or 2 it is bordered by the :func:`polynomials` of the points, and columns are (n + m, k).
    """

    size: int
    """Numbers of the factor."""
    is_updated: bool
    """Points have moved since it was factored."""

    def solve(self, b: Floats) -> Floats:
        """The columns c with ``(Phi + nugget) c = b``, the caller's own; NaN where the matrix is not definite."""

    def product(self, b: Floats) -> Floats:
        """``(Phi + nugget) b``."""


def matrix_of(
    points: PreparedPoints, nugget: Floats, scales: Floats | None, kernel: type[AbstractKernel]
) -> tuple[Matrix, Floats]:
    """The matrix of points, from the cache where possible.

    Parameters
    ----------
    nugget : (n,) added to the diagonal.
    scales : (n,) support / R_j of points with individual radii, or None.

    Returns
    -------
    The matrix, and the origin (dim,) from which it counts its places: for a cached one, that of the points which were
    factored. The others have the same coordinates then in every step of a drag, and are solved for once.

    Raises
    ------
    DeformError
        If the factor would take more memory than 2 GiB.
    """
    if scales is not None:
        return _Sparse(points.relative, nugget, scales, kernel), points.origin
    found = _kept.find_similar(points, nugget, kernel) if points.count >= _KEPT_FROM else None
    if found is not None:
        base, moved = found
        return base.update(points.targets, moved), base.points.origin
    return factor_matrix(points, nugget, kernel), points.origin


def factor_matrix(points: PreparedPoints, nugget: Floats, kernel: type[AbstractKernel]) -> Matrix:
    """The matrix of points factored as it is, and cached."""
    kind = _Bordered if kernel.order else _Band if kernel.compact and points.count > DENSE else _Dense
    matrix = kind(points.relative, nugget, kernel)
    if points.count >= _KEPT_FROM:
        _kept.add(_Base(points, nugget, kernel, matrix))
    return matrix


class _Dense:
    """A symmetric matrix and its Cholesky factor, in the two triangles of one array: fresh memory costs as much."""

    is_updated = False

    def __init__(self, x: Floats, nugget: Floats, kernel: type[AbstractKernel]) -> None:
        n = len(x)
        phi = kernel_values(x, x, kernel)
        phi.flat[:: n + 1] += nugget
        diagonal = phi.diagonal().copy()
        self._both, self._failed = scipy.linalg.lapack.dpotrf(phi.T, lower=1, clean=0, overwrite_a=1)
        self._beside = (diagonal - self._both.diagonal())[:, None]  # the diagonal of both is the factor's
        self.size = n * n

    def solve(self, b: Floats) -> Floats:
        if self._failed:  # the check of the residual names the points
            return np.full(b.shape, np.nan)
        return _solve_triangular(self._both, b)

    def product(self, b: Floats) -> Floats:
        return np.asarray(_symmetric_product(self._both, b) + self._beside * b)


def polynomials(x: Floats, order: int) -> Floats:
    """The monomials (n, m) of a degree below ``order``, 1 or 2, at relative places x (n, dim).

    >>> polynomials(np.array([[3.0, 4.0]]), 2).tolist()
    [[1.0, 3.0, 4.0]]
    """
    return np.concatenate([np.ones((len(x), 1)), x[:, : x.shape[1] * (order - 1)]], axis=1)


class _Bordered:
    """``[Phi P; P^T 0]`` of a kernel of order 1 or 2 by the null-space method.

    With ``P = Q [R; 0]`` the lower right part of ``Q^T Phi Q`` is definite and has a Cholesky factor (M. Benzi,
    G. H. Golub, J. Liesen, Acta Numerica 14 (2005) 1-137, section 6). ``Q = 1 - Y T Y^T`` of the reflections Y stays
    in that form, so that all but the factor takes n^2 operations.
    """

    is_updated = False

    def __init__(self, x: Floats, nugget: Floats, kernel: type[AbstractKernel]) -> None:
        n, self._phi = len(x), kernel_values(x, x, kernel)
        self._phi.flat[:: n + 1] += nugget
        self._p = polynomials(x, kernel.order)
        m = self._p.shape[1]
        raw, tau = np.linalg.qr(self._p, mode="raw")
        self._r, y = np.triu(raw.T[:m]), np.tril(raw.T, -1)
        y.flat[: m * m : m + 1] = 1.0
        with np.errstate(all="ignore"):  # NaN where a reflection is none, and no factor then
            self._yt = y @ np.linalg.inv(np.triu(y.T @ y, 1) + np.diag(1 / tau))
        w = self._phi @ self._yt
        z = w - 0.5 * y @ (self._yt.T @ w)
        self._y, self._edge = y, self._phi[:, :m] - z @ y[:m].T - y @ z[:m].T  # Q^T Phi Q, its first columns
        inner = scipy.linalg.blas.dsyr2k(-1.0, y[m:], z[m:], 1.0, self._phi[m:, m:].T, lower=1)
        self._factor, self._failed = scipy.linalg.lapack.dpotrf(inner, lower=1, clean=0, overwrite_a=1)
        self.size = 2 * n * n

    def solve(self, b: Floats) -> Floats:
        n, m = self._y.shape
        if self._failed:
            return np.full(b.shape, np.nan)
        turned = b[:n] - self._y @ (self._yt.T @ b[:n])
        found = np.empty_like(turned)
        found[:m] = np.linalg.solve(self._r.T, b[n:])
        found[m:] = _solve_triangular(self._factor, turned[m:] - self._edge[m:] @ found[:m])
        last = np.linalg.solve(self._r, turned[:m] - self._edge.T @ found)
        return np.concatenate([found - self._yt @ (self._y.T @ found), last])

    def product(self, b: Floats) -> Floats:
        n = len(self._y)
        return np.concatenate([_symmetric_product(self._phi.T, b[:n]) + self._p @ b[n:], self._p.T @ b[:n]])


class _Band:
    """Points sorted along their longest side reach only their neighbours in that order.

    The matrix is a band and has a Cholesky factor within it: n b^2 operations for n points of which b are within a
    support of that side.
    """

    is_updated = False

    def __init__(self, x: Floats, nugget: Floats, kernel: type[AbstractKernel]) -> None:
        self._order = np.argsort(x[:, np.ptp(x, axis=0).argmax()], kind="stable")
        self._back = np.argsort(self._order)
        i, j, square = _neighbours(x[self._order], 1.0)
        n, width = len(x), int((j - i).max(initial=0))
        self.size = (width + 1) * n
        _check_size(self.size, len(i), n)
        values = profile_of(square, kernel)
        self._upper = scipy.sparse.csr_array((values, (i, j)), shape=(n, n))
        self._diagonal = profile_of(np.zeros(1), kernel)[0] + nugget[self._order]
        band = np.zeros((width + 1, n))
        band[0], band.reshape(-1)[(j - i) * n + i] = self._diagonal, values
        self._factor, self._failed = scipy.linalg.lapack.dpbtrf(band, lower=1, overwrite_ab=1)

    def solve(self, b: Floats) -> Floats:
        if self._failed:
            return np.full(b.shape, np.nan)
        return np.asarray(scipy.linalg.lapack.dpbtrs(self._factor, b[self._order], lower=1)[0])[self._back]

    def product(self, b: Floats) -> Floats:
        b = b[self._order]
        found = self._diagonal[:, None] * b + self._upper @ b + self._upper.T @ b
        return np.asarray(found)[self._back]


class _Sparse:
    """Points with individual radii, whose matrix is not symmetric: sparse elimination (SuperLU)."""

    is_updated = False

    def __init__(self, x: Floats, nugget: Floats, scales: Floats, kernel: type[AbstractKernel]) -> None:
        i, j, square = _neighbours(x, float(1 / scales.min()))
        n, whole = len(x), np.arange(len(x))
        self.size = (int((j - i).max(initial=0)) + 1) * n
        _check_size(self.size, len(i), n)
        entries = np.concatenate(
            [
                profile_of(np.zeros(1), kernel)[0] + nugget,
                profile_of(square * scales[j] ** 2, kernel),
                profile_of(square * scales[i] ** 2, kernel),
            ]
        )
        places = (np.concatenate([whole, i, j]), np.concatenate([whole, j, i]))
        self._matrix = scipy.sparse.csc_array((entries, places), shape=(n, n))
        self._solve = scipy.sparse.linalg.splu(self._matrix).solve

    def solve(self, b: Floats) -> Floats:
        return np.asarray(self._solve(b))

    def product(self, b: Floats) -> Floats:
        return np.asarray(self._matrix @ b)


@dataclass(eq=False)
class _Base:
    """A factored matrix and the points that it is of."""

    points: PreparedPoints
    nugget: Floats
    kernel: type[AbstractKernel]
    matrix: Matrix
    fixed: _Fixed | None = None
    """The part that is constant while the points are dragged that were dragged last."""

    def update(self, targets: Floats, moved: NDArray[np.intp]) -> Matrix:
        """The matrix after some of the points have moved to these targets (n, dim)."""
        if len(moved) == 0:
            return self.matrix
        x = (targets - self.points.origin) / self.points.support
        columns = kernel_values(x, x[moved], self.kernel)
        corner = columns[moved]
        corner.flat[:: len(moved) + 1] += self.nugget[moved]
        columns[moved] = 0.0
        if self.kernel.order:
            columns = np.concatenate([columns, polynomials(x[moved], self.kernel.order).T])
        fixed = self.fixed
        if fixed is None or not np.array_equal(fixed.moved, moved):
            self.fixed = fixed = _Fixed(self.matrix, moved, len(columns))
        return _Moved(fixed, columns, corner)


class _Fixed:
    """The matrix of a base less the rows and columns of points that are dragged.

    Parameters
    ----------
    moved : their positions; rows : of the matrix of the base.
    """

    def __init__(self, base: Matrix, moved: NDArray[np.intp], rows: int) -> None:
        units = np.zeros((rows, len(moved)))
        units[moved, np.arange(len(moved))] = 1.0
        self.base, self.moved = base, moved
        g = base.solve(units)
        self._share = np.linalg.solve(g[moved].T, g.T).T  # G (G_M)^-1
        self._last: tuple[tuple[Floats, Floats], ...] = ()

    def solve(self, b: Floats) -> Floats:
        """The columns c, zero in the rows of the moved points, that give b in all others."""
        found = self.base.solve(b)
        found -= self._share @ found[self.moved]
        return found

    def solve_again(self, b: Floats) -> Floats:
        """As :meth:`solve`, of the last two right-hand sides from memory: one is that of the fit, one its residual."""
        b = b.copy()
        b[self.moved] = 0.0
        found = next((found for given, found in self._last if np.array_equal(given, b)), None)
        if found is None:
            found = self.solve(b)
        self._last = (b, found), *self._last[:1]
        return found


class _Moved:
    """The matrix of fixed points, bordered by those that have moved: columns K and the corner C between these."""

    is_updated = True

    def __init__(self, fixed: _Fixed, columns: Floats, corner: Floats) -> None:
        self._fixed, self._columns, self._corner, self.size = fixed, columns, corner, fixed.base.size
        self._across = fixed.solve(columns)
        self._rest = corner - columns.T @ self._across

    def solve(self, b: Floats) -> Floats:
        rest = self._fixed.solve_again(b)
        at = np.linalg.solve(self._rest, b[self._fixed.moved] - self._columns.T @ rest)
        found = rest.copy(order="K")
        found -= self._across @ at
        found[self._fixed.moved] = at
        return found

    def product(self, b: Floats) -> Floats:
        moved = self._fixed.moved
        at, others = b[moved], b.copy()
        others[moved] = 0.0
        found = self._fixed.base.product(others) + self._columns @ at
        found[moved] = self._columns.T @ others + self._corner @ at
        return np.asarray(found)


class _MatrixCache:
    """The matrices factored last, from the newest to the oldest, as many as there is room for."""

    def __init__(self) -> None:
        self._bases: tuple[_Base, ...] = ()
        self._lock = threading.Lock()

    def find_similar(
        self, points: PreparedPoints, nugget: Floats, kernel: type[AbstractKernel]
    ) -> tuple[_Base, NDArray[np.intp]] | None:
        """The newest with the same kernel, support and smoothing that few points have left, and which these are."""
        most = min(_MOST_MOVED, points.count // 8)
        for base in self._bases:
            before, now = base.points.targets, points.targets
            if base.kernel is kernel and base.points.support == points.support and before.shape == now.shape:
                differs = before != now
                if np.count_nonzero(differs) <= most * now.shape[1]:  # of most bases more do
                    moved = np.flatnonzero(differs.any(axis=1))
                    if len(moved) <= most and np.array_equal(base.nugget, nugget):
                        return base, moved
        return None

    def add(self, base: _Base) -> None:
        """Add one to the cache, and evict the oldest ones that do not fit with it."""
        with self._lock:
            kept, room = [], _KEPT_NUMBERS
            for one in (base, *self._bases[: _KEPT - 1]):
                room -= one.matrix.size
                if room >= 0:
                    kept.append(one)
            self._bases = tuple(kept)


_kept = _MatrixCache()


def _solve_triangular(factor: Floats, b: Floats) -> Floats:
    """The columns c (n, k) with ``L L^T c = b``, L the lower triangle of ``factor`` (n, n).

    A few of a large one singly: dpotrs copies the factor first (1 column of 512: 165 us instead of 45).
    """
    if b.shape[1] > min(3, len(factor) // 128):
        return np.asarray(scipy.linalg.lapack.dpotrs(factor, b, lower=1)[0])
    solve = scipy.linalg.blas.dtrsv
    return np.array([solve(factor, solve(factor, column, lower=1), lower=1, trans=1) for column in b.T]).T


def _symmetric_product(a: Floats, b: Floats) -> Floats:
    """The product of a symmetric matrix (n, n), of which the upper triangle is read, with few columns (n, k).

    Column by column: dsymm reads both triangles and copies them (2 columns of 512: 130 us instead of 44).
    """
    multiply = scipy.linalg.blas.dsymv
    return np.array([multiply(1.0, a, column, lower=0) for column in b.T]).T


def _neighbours(x: Floats, reach: float) -> tuple[NDArray[Any], NDArray[Any], Floats]:
    """Pairs i < j of points within a distance, and the squares of their distances."""
    i, j = np.ascontiguousarray(scipy.spatial.cKDTree(x).query_pairs(reach, output_type="ndarray").T)
    return i, j, np.add.reduce([(part[i] - part[j]) ** 2 for part in np.ascontiguousarray(x.T)])


def _check_size(size: int, pairs: int, n: int) -> None:
    if size > _LARGEST_FACTOR:
        raise DeformError(
            f"the support radius holds {2 * pairs // n} neighbours of each of these {n} control "
            "points on average, too many for the memory of a solve; give a smaller support radius, or "
            "leave it to the points."
        )


def kernel_values(x: Floats, y: Floats, kernel: type[AbstractKernel]) -> Floats:
    """Phi (n, m) between points x (n, dim) and y (m, dim), float64, the caller's own."""
    if kernel.name in BUILT_IN and len(x) * len(y) <= _FEW:
        with np.errstate(all="ignore"):
            return np.asarray(_values_between(x, y, kernel=kernel))
    if is_compiled(kernel):  # one centre of coefficient 1 at the origin, at all places x - y
        dim = x.shape[1]
        zero, one = np.zeros((dim, dim)), np.eye(1, dim)
        rows, columns = x.T, -y.T
        return sum_lattice(rows, columns, zero[:1], one, zero, zero[0], kernel.name, is_compact=kernel.compact)[0]
    with float64():
        values = _compiled_values(_padded(x), _padded(y), kernel=kernel)
    return np.array(np.asarray(values)[: len(x), : len(y)])


_FEW = 2**12  # numbers of a matrix that NumPy computes before a compiled function starts


def _padded(x: Floats) -> Floats:
    """Points with zeros up to their capacity, so that few sizes are compiled."""
    padded = np.zeros((capacity(len(x)), x.shape[1]))
    padded[: len(x)] = x
    return padded


def _values_between(x: Any, y: Any, *, kernel: type[AbstractKernel]) -> Any:
    # One coordinate after the other: with a last axis of two or three nothing is vectorised (3 times slower).
    return kernel.profile(sum((x[:, None, k] - y[None, :, k]) ** 2 for k in range(x.shape[1])))


_compiled_values = jit(_values_between, static_argnames="kernel")

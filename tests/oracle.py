"""Every equation of the paper as slow, literal loops in float64: what the fast code must agree with.

Written from the paper and not from the package. Points are rows (x, y) or (x, y, z), d_i = source_i - target_i is the
backward displacement at the target x_i, phi is any function of the distance. The paper prints P_i = (1, x, y) but its
kappa_1 = [1, 0, 0] picks the factor of x, so P is ordered (x, y, 1) here. Eq. 5 as printed has two equations more than
unknowns; the code below has the least-energy problem it was meant to be, with the two missing columns of multipliers.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from typing import Any

import mpmath
import numpy as np
import scipy.optimize
from numpy.typing import NDArray

Array = NDArray[np.float64]
Phi = Callable[[float], float]


def assert_close(actual: Any, wanted: Any, *, atol: float = 0.0, rtol: float = 0.0) -> None:
    """NumPy's check without its default relative tolerance of 1e-7, which would swallow every bound of these tests."""
    np.testing.assert_allclose(actual, wanted, rtol=rtol, atol=atol)


# ---- radial functions ------------------------------------------------------------------------------------------------


def psi31(rho: float) -> float:
    """The paper's kernel, section 3.1: (1 - r)^4_+ (4 r + 1)."""
    return (1 - rho) ** 4 * (4 * rho + 1) if 0 <= rho <= 1 else 0.0


def psi31_as_integral(rho: float) -> float:
    """Wendland's construction: 20 times the integral of t (1 - t)^3 from rho to 1; five nodes are exact for t^4."""
    if rho >= 1:
        return 0.0
    nodes, weights = np.polynomial.legendre.leggauss(5)
    t = [(1 - rho) / 2 * node + (1 + rho) / 2 for node in nodes]
    return 20 * (1 - rho) / 2 * sum(w * u * (1 - u) ** 3 for w, u in zip(weights, t, strict=True))


def radial(name: str, rho: Any) -> Any:
    """Every kernel of the documentation's table by name, for mpmath numbers."""
    one = mpmath.mpf(1)
    rho = mpmath.mpf(rho)
    cut = max(one - rho, 0 * one)
    if name == "wendland_c0":
        return cut**2
    if name == "wendland_c2":
        return cut**4 * (4 * rho + 1)
    if name == "wendland_c4":
        return cut**6 * (35 * rho**2 + 18 * rho + 3) / 3
    if name == "gaussian":
        return mpmath.exp(-((3 * rho) ** 2) / 2)
    if name == "multiquadric":
        return -mpmath.sqrt(1 + (4 * rho) ** 2)
    if name == "linear":
        return -rho
    if name == "thin_plate":
        return rho**2 * mpmath.log(rho) if rho > 0 else 0 * one
    if name == "cubic":
        return rho**3
    if name == "quintic":
        return -(rho**5)
    if name == "inverse_multiquadric":
        return 1 / mpmath.sqrt(1 + (4 * rho) ** 2)
    if name == "inverse_quadratic":
        return 1 / (1 + (4 * rho) ** 2)
    raise KeyError(name)


# ---- Eqs. 1 to 4 and 9 -----------------------------------------------------------------------------------------------


def distance(x: Sequence[float], y: Sequence[float]) -> float:
    return math.sqrt(sum((a - b) ** 2 for a, b in zip(x, y, strict=True)))


def matrix_phi(points: Array, phi: Phi) -> Array:
    """phi_ij = phi(|x_i - x_j|)."""
    n = len(points)
    out = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            out[i, j] = phi(distance(points[i], points[j]))
    return out


def matrix_p(points: Array) -> Array:
    """P_i = (x_i, y_i[, z_i], 1)."""
    return np.array([[*x, 1.0] for x in points])


def equations_3_and_4(points: Array, displacements: Array, phi: Phi) -> tuple[Array, Array]:
    """The printed (N + 3) system, one component at a time; alpha (N, dim) and gamma (dim + 1, dim)."""
    n, dim = points.shape
    system = np.zeros((n + dim + 1, n + dim + 1))
    system[:n, :n] = matrix_phi(points, phi)
    system[:n, n:] = matrix_p(points)
    system[n:, :n] = matrix_p(points).T
    solutions = [np.linalg.solve(system, np.concatenate([displacements[:, m], np.zeros(dim + 1)])) for m in range(dim)]
    both = np.stack(solutions, axis=1)
    return both[:n], both[n:]


def equation_2(x: Sequence[float], points: Array, alpha: Array, gamma: Array, phi: Phi) -> Array:
    """D(x) = sum_i a_i phi(|x - x_i|) + p(x) (Eq. 9 where the points have three coordinates)."""
    dim = points.shape[1]
    total = np.zeros(dim)
    for m in range(dim):
        for i in range(len(points)):
            total[m] += alpha[i, m] * phi(distance(x, points[i]))
        for k in range(dim):
            total[m] += gamma[k, m] * x[k]
        total[m] += gamma[dim, m]
    return total


# ---- Eq. 5 -----------------------------------------------------------------------------------------------------------


def equation_5(points: Array, displacements: Array, phi: Phi) -> tuple[Array, Array]:
    """The least-energy fit with gamma_0 = lambda_1 and gamma_1 = -lambda_0: a symmetric system of 2 N + 8 rows."""
    n = len(points)
    big_phi, p = matrix_phi(points, phi), matrix_p(points)
    k1, k2, zero3 = np.array([[1.0, 0, 0]]), np.array([[0, 1.0, 0]]), np.zeros((3, 3))
    zero, nothing = np.zeros((n, n)), np.zeros((n, 3))
    constraint = np.block([[k1, -k2], [k2, k1]])
    system = np.block(
        [
            [big_phi, zero, p, nothing, np.zeros((n, 2))],
            [zero, big_phi, nothing, p, np.zeros((n, 2))],
            [p.T, nothing.T, zero3, zero3, constraint[:, :3].T],
            [nothing.T, p.T, zero3, zero3, constraint[:, 3:].T],
            [np.zeros((2, n)), np.zeros((2, n)), constraint[:, :3], constraint[:, 3:], np.zeros((2, 2))],
        ]
    )
    assert system.shape == (2 * n + 8, 2 * n + 8)
    right = np.concatenate([displacements[:, 0], displacements[:, 1], np.zeros(8)])
    s = np.linalg.solve(system, right)
    return np.stack([s[:n], s[n : 2 * n]], axis=1), np.stack([s[2 * n : 2 * n + 3], s[2 * n + 3 : 2 * n + 6]], axis=1)


def equation_5_complex(points: Array, displacements: Array, phi: Phi) -> tuple[NDArray[Any], complex, complex]:
    """The same with z = x + i y: [Phi Z; Z^H 0] [c; A; B] = [d; 0], Z_j = (z_j, 1)."""
    n = len(points)
    z = points[:, 0] + 1j * points[:, 1]
    d = displacements[:, 0] + 1j * displacements[:, 1]
    system = np.zeros((n + 2, n + 2), dtype=complex)
    system[:n, :n] = matrix_phi(points, phi)
    system[:n, n], system[:n, n + 1] = z, 1
    system[n, :n], system[n + 1, :n] = z.conj(), 1
    s = np.linalg.solve(system, np.concatenate([d, [0, 0]]))
    return s[:n], complex(s[n]), complex(s[n + 1])


def rigid_by_search(points: Array, displacements: Array, phi: Phi) -> tuple[NDArray[Any], complex, complex]:
    """c, A, B of least energy among |1 + A| = 1, by searching the angle; B and c are solved anew for each."""
    n = len(points)
    z = points[:, 0] + 1j * points[:, 1]
    d = displacements[:, 0] + 1j * displacements[:, 1]
    system = np.ones((n + 1, n + 1))
    system[:n, :n], system[n, n] = matrix_phi(points, phi), 0

    def refit(angle: float) -> tuple[float, NDArray[Any], complex, complex]:
        a = cmath.exp(1j * angle) - 1
        s = np.linalg.solve(system, np.concatenate([d - a * z, [0]]))
        return float((s[:n].conj() @ system[:n, :n] @ s[:n]).real), s[:n], a, complex(s[n])

    best = min(np.linspace(-math.pi, math.pi, 721), key=lambda angle: refit(angle)[0])
    # The energy is const - cos(angle - best): the zero of its symmetric difference is exact for any step.
    angle = scipy.optimize.brentq(lambda t: refit(t + 0.1)[0] - refit(t - 0.1)[0], best - 0.2, best + 0.2, xtol=1e-14)
    return refit(angle)[1:]


def complex_map(x: Sequence[float], points: Array, c: NDArray[Any], a: complex, b: complex, phi: Phi) -> Array:
    """D at x from the complex form."""
    value = a * (x[0] + 1j * x[1]) + b
    for i in range(len(points)):
        value += c[i] * phi(distance(x, points[i]))
    return np.array([value.real, value.imag])


# ---- Eqs. 6 to 8 -----------------------------------------------------------------------------------------------------


def equation_6(
    points: Array, displacements: Array, phi: Phi, weight: Callable[[Sequence[float]], float]
) -> Callable[[Sequence[float]], Array]:
    """phi_R(x, x_i) = w(x) w(x_i) phi(|x - x_i|) around a part that is fixed (no polynomial)."""
    n = len(points)
    w = [weight(x) for x in points]
    system = np.array([[w[i] * w[j] * phi(distance(points[i], points[j])) for j in range(n)] for i in range(n)])
    alpha = np.linalg.solve(system, displacements)
    return lambda x: sum(alpha[i] * weight(x) * w[i] * phi(distance(x, points[i])) for i in range(n))


def equation_7(
    x: Sequence[float], region: Callable[[Sequence[float]], int], fits: dict[int, Callable[[Sequence[float]], Array]]
) -> Array:
    """Each region has its own interpolant; 0 in the others."""
    return fits[region(x)](x) if region(x) in fits else np.zeros(len(x))


def equation_8(
    x: Sequence[float], region: Callable[[Sequence[float]], int], fits: dict[int, Callable[[Sequence[float]], Array]]
) -> int:
    """The transparency map: 1 where x + D(x) is in the region of x."""
    return int(region(np.asarray(x) + equation_7(x, region, fits)) == region(x))


# ---- section 3.2 -----------------------------------------------------------------------------------------------------


def relative_depth(c: float, first: float, last: float) -> float:
    return min(max((c - first) / (last - first), 0.0), 1.0) if last > first else 0.0


def replication(x: Sequence[float], displacement: Callable[[float, float], Array]) -> Array:
    """D3(x, y, z) = D(x, y)."""
    return np.array([*displacement(x[0], x[1]), 0.0])


def modulation(
    x: Sequence[float],
    displacement: Callable[[float, float], Array],
    f: Callable[[float], float],
    first: float,
    last: float,
) -> Array:
    """D3(x, y, z) = f(z) D(x, y), z relative."""
    return f(relative_depth(x[2], first, last)) * replication(x, displacement)


def interpolation(
    x: Sequence[float],
    displacements: Sequence[Callable[[float, float], Array]],
    knots: Sequence[float],
    first: float,
    last: float,
) -> Array:
    """Linear in z between the displacements at the knots, constant beyond."""
    z = relative_depth(x[2], first, last)
    if z <= knots[0]:
        return replication(x, displacements[0])
    for k in range(len(knots) - 1):
        if z <= knots[k + 1]:
            t = (z - knots[k]) / (knots[k + 1] - knots[k])
            return (1 - t) * replication(x, displacements[k]) + t * replication(x, displacements[k + 1])
    return replication(x, displacements[-1])


# ---- fifty digits ----------------------------------------------------------------------------------------------------


def fifty_digits(points: Array, displacements: Array, kernel: str, support: float, trend: str, at: Array) -> Array:
    """D at places, from a solve in 50 digits; similarity and rigid in the plane only."""
    with mpmath.workdps(50):
        x = [[mpmath.mpf(float(v)) for v in row] for row in points]
        d = [[mpmath.mpf(float(v)) for v in row] for row in displacements]
        n, dim = len(x), len(x[0])

        def phi(p: Any, q: Any) -> Any:
            return radial(kernel, mpmath.sqrt(sum((a - b) ** 2 for a, b in zip(p, q, strict=True))) / support)

        if trend in ("similarity", "rigid"):
            z, value = [mpmath.mpc(*p) for p in x], [mpmath.mpc(*p) for p in d]
            columns = [z, [mpmath.mpc(1)] * n]
            if trend == "rigid":
                turn = 1 + _bordered(x, columns, [value], phi)[0][n]
                a = turn / abs(turn) - 1
                value, columns = [v - a * p for v, p in zip(value, z, strict=True)], [[mpmath.mpc(1)] * n]
            s = _bordered(x, columns, [value], phi)[0]
            out = []
            for place in at:
                p = [mpmath.mpf(float(v)) for v in place]
                total = sum(s[i] * phi(p, x[i]) for i in range(n)) + s[len(s) - 1]
                total += (a if trend == "rigid" else s[n]) * mpmath.mpc(*p)
                out.append([float(total.real), float(total.imag)])
            return np.array(out)

        def monomials(p: Any) -> list[Any]:
            squares = [p[a] * p[b] for a in range(dim) for b in range(a + 1)] if trend == "quadratic" else []
            return [] if trend == "none" else [mpmath.mpf(1), *(p if trend != "translation" else []), *squares]

        columns = [list(column) for column in zip(*map(monomials, x), strict=True)]
        solved = _bordered(x, columns, [[row[m] for row in d] for m in range(dim)], phi)
        out = []
        for place in at:
            p = [mpmath.mpf(float(v)) for v in place]
            terms = monomials(p)
            out.append(
                [
                    float(sum(s[i] * phi(p, x[i]) for i in range(n)) + sum(s[n + k] * t for k, t in enumerate(terms)))
                    for s in solved
                ]
            )
        return np.array(out)


def _bordered(x: list[Any], columns: list[Any], right: list[Any], phi: Callable[[Any, Any], Any]) -> list[Any]:
    n, m = len(x), len(columns)
    system = mpmath.matrix(n + m, n + m)
    for i in range(n):
        for j in range(n):
            system[i, j] = phi(x[i], x[j])
        for k in range(m):
            system[i, n + k], system[n + k, i] = columns[k][i], mpmath.conj(columns[k][i])
    return [mpmath.lu_solve(system, mpmath.matrix([*b, *([0] * m)])) for b in right]

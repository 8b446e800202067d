"""Kernels of one's own as tables of polynomials, by which front ends evaluate them without Python.

phi and its slope are functions of the squared relative distance s = rho^2. Each octave of s from 2^-40 to 2^40 (to 1,
if the kernel is compact) is one piece, halved where that is not enough, with the polynomials through the Chebyshev
points of the piece: for an analytic function 15 degrees leave 1e-13 (L. N. Trefethen, Approximation Theory and
Approximation Practice (2013), chapter 8), and a kink is in a piece of 1e-8 of its octave. Nearer than the first piece
phi is linear in rho; farther than the last one it continues as a power of s.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from deformnb._jax import float64, jit
from deformnb._typing import Floats
from deformnb.rbf.kernels import BUILT_IN, LEAST_DISTANCE, AbstractKernel, as_kernel

_DEGREE = 15
_LOWEST, _HIGHEST = round(2 * np.log2(LEAST_DISTANCE)), 40  # exponents of 2 of s
_NARROWEST = 2.0**-26  # of an octave
_CLOSE = 1e-12  # the error that is aimed at


@dataclass(frozen=True, eq=False)
class KernelTable:
    """A kernel as pieces of polynomials of s.

    Parameters
    ----------
    kind : the kernel.
    edges : (P + 1,) where pieces begin, and where the last one ends.
    powers : (P, 2, 16) coefficients of phi and of its slope, of the powers of t from -1 to 1 within a piece.
    ends : phi at 0, phi and slope at the first edge, phi and slope at the last edge.
    error : the largest difference from phi that was found, relative to the larger of 1 and phi.
    slope_error : that of d phi / d rho from the kernel's own, relative to the larger of 1 and it.
    """

    kind: type[AbstractKernel]
    edges: Floats
    powers: Floats
    ends: Floats
    error: float
    slope_error: float

    def as_json(self) -> dict[str, Any]:
        """The table as a front end takes it (``maths/kernel_table.js``), numbers as base64 of float64."""
        kind, numbers = self.kind, np.concatenate([self.ends, self.edges, self.powers.ravel()])
        return {
            "name": kind.name,
            "title": kind.title,
            "order": kind.order,
            "compact": kind.compact,
            "share": kind.shares[len(kind.shares) // 2],
            "gaps": kind.gaps if np.isfinite(kind.gaps) else None,
            "pieces": len(self.powers),
            "numbers": base64.b64encode(numbers.astype("<f8").tobytes()).decode(),
        }


def table_for_client(name: str) -> dict[str, Any] | None:
    """The table of a kernel by its name, as JSON; None for those that front ends have themselves."""
    return None if name in BUILT_IN else _json_of(as_kernel(name))


@cache
def _json_of(kind: type[AbstractKernel]) -> dict[str, Any]:
    return kernel_table(kind).as_json()


@cache
def kernel_table(kind: type[AbstractKernel]) -> KernelTable:
    """The table of a kernel; takes a tenth of a second, once.

    Examples
    --------
    >>> from deformnb.rbf.kernels import Gaussian
    >>> kernel_table(Gaussian).error < 1e-12
    True
    """
    last = 0 if kind.compact else _HIGHEST
    waiting = [(2.0**e, 2.0 ** (e + 1)) for e in range(_LOWEST, last)]
    done: dict[float, tuple[Floats, Floats]] = {}
    while waiting:  # one turn for each halving
        pieces = np.array(waiting)
        powers, errors = _pieces(kind, pieces)
        low, high = pieces.T
        is_done = (errors.max(axis=1) <= _CLOSE) | (high - low < 2 * _NARROWEST * 2 ** np.floor(np.log2(low)))
        done.update({float(a): (p, e) for a, p, e in zip(low[is_done], powers[is_done], errors[is_done], strict=True)})
        middle = (low + high) / 2
        waiting = [
            half
            for a, m, b in zip(*(v[~is_done].tolist() for v in (low, middle, high)), strict=True)
            for half in ((a, m), (m, b))
        ]
    begins = sorted(done)
    errors = np.max([done[a][1] for a in begins], axis=0)
    edges = np.array([*begins, 2.0**last])
    at = np.array([0.0, edges[0], edges[-1]])
    phi, slope = _values(kind, at)
    ends = np.array([phi[0], phi[1], slope[1], phi[2], slope[2]])
    return KernelTable(kind, edges, np.stack([done[a][0] for a in begins]), ends, float(errors[0]), float(errors[1]))


def _values(kind: type[AbstractKernel], s: Floats) -> tuple[Floats, Floats]:
    padded = np.ones(max(512, 2 ** (s.size - 1).bit_length()))  # few sizes are compiled
    padded[: s.size] = s.ravel()
    with float64():
        phi, slope = _both(padded, kernel=kind)
    return np.asarray(phi)[: s.size].reshape(s.shape), np.asarray(slope)[: s.size].reshape(s.shape)


_both = jit(lambda s, kernel: (kernel.profile(s), kernel.slope(s)), static_argnames="kernel")


def _pieces(kind: type[AbstractKernel], pieces: Floats) -> tuple[Floats, Floats]:
    """Coefficients (P, 2, 16) of pieces (P, 2), and the errors (P, 2) of phi and d phi / d rho in them."""
    nodes = np.cos(np.pi * (np.arange(_DEGREE + 1) + 0.5) / (_DEGREE + 1))
    between = np.linspace(-0.999, 0.999, 40)
    low, high = pieces[:, :1], pieces[:, 1:]
    places = (low + high) / 2 + (high - low) / 2 * np.concatenate([nodes, between])
    phi, slope = _values(kind, places)
    found = np.stack([phi, slope], axis=1)
    powers = found[:, :, : _DEGREE + 1] @ np.linalg.inv(chebyshev.chebvander(nodes, _DEGREE)).T @ _to_powers()
    missed = np.abs(powers @ np.vander(between, _DEGREE + 1, increasing=True).T - found[:, :, _DEGREE + 1 :])
    rho = 2 * np.sqrt(places[:, _DEGREE + 1 :])
    size = np.maximum(1, np.abs(np.stack([phi[:, _DEGREE + 1 :], rho * slope[:, _DEGREE + 1 :]], axis=1)))
    missed[:, 1] *= rho
    return powers, (missed / size).max(axis=2)


def _to_powers() -> Floats:
    """Coefficients (16, 16) of powers, row by row those of the Chebyshev polynomials."""
    rows = [chebyshev.cheb2poly(np.eye(_DEGREE + 1)[k, : k + 1]) for k in range(_DEGREE + 1)]
    return np.stack([np.pad(row, (0, _DEGREE + 1 - len(row))) for row in rows])

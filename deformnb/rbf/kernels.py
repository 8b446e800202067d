r"""Radial basis functions, each a function of the squared relative distance ``s = (r / support)**2``.

====================  =========================================  =====  =======  ==========================
name                  phi(rho), rho = r / support                order  compact  smoothness
====================  =========================================  =====  =======  ==========================
wendland_c0           (1 - rho)^2_+                              0      yes      C0 (a kink at the point)
wendland_c2           (1 - rho)^4_+ (4 rho + 1)                  0      yes      C2, the paper's psi_{3,1}
wendland_c4           (1 - rho)^6_+ (35 rho^2 + 18 rho + 3)/3    0      yes      C4
gaussian              exp(-(3 rho)^2 / 2)                        0      no       analytic
inverse_multiquadric  1 / sqrt(1 + (4 rho)^2)                    0      no       analytic
inverse_quadratic     1 / (1 + (4 rho)^2)                        0      no       analytic
multiquadric          -sqrt(1 + (4 rho)^2)                       1      no       analytic
linear                -rho                                       1      no       C0 (a kink at the point)
thin_plate            rho^2 log(rho)                             2      no       C1, least bending in 2D
cubic                 rho^3                                      2      no       C2, least bending in 3D
quintic               -rho^5                                     3      no       C4
====================  =========================================  =====  =======  ==========================

``order`` is the order of conditional positive definiteness: the fit is well posed if the trend holds all polynomials
of a smaller degree (0: any trend, 1: at least a translation, 2: an affine map, 3: a quadratic one). Wendland: Adv.
Comput. Math. 4 (1995) 389-396; the others: Wendland, Scattered Data Approximation (2004), chapter 8.

Working on the square keeps every gradient finite at a control point: ``d phi / d x = slope(s) 2 (x - x_i)/support^2``
needs no division by r, where differentiating through ``sqrt`` gives NaN there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._jax import float64
from deformnb.checks import SMALLEST_LENGTH, is_finite, shown_value
from deformnb.errors import DeformError

# Stands for s = 0 in a logarithm or under a fraction; its products with x - x_i = 0 are zero, as the limit is.
TINY = 1e-30


@dataclass(frozen=True)
class AbstractKernel(ABC):
    """A radial function with its support radius (or length scale) in physical units.

    Raises
    ------
    DeformError
        If the support is not a positive finite number.
    """

    support: float

    name: ClassVar[str]
    title: ClassVar[str]
    order: ClassVar[int] = 0
    compact: ClassVar[bool] = False
    shares: ClassVar[tuple[float, ...]] = (1.0,)
    """Supports among which a fit chooses, in diagonals of the box of its points; the middle one is the usual."""
    gaps: ClassVar[float] = np.inf
    """The longest support that a fit chooses for points in a row, in gaps between them: longer ones extrapolate wildly
    across the row. Measured with one point dragged by a tenth of rows of 3 to 33."""
    of_square: ClassVar[Callable[[Any], Any]]
    """phi as a function of s, with ``slope`` as its derivative: what the solver and the evaluation call."""

    def __post_init__(self) -> None:
        if not (is_finite(self.support) and self.support >= SMALLEST_LENGTH):
            raise DeformError(f"the support radius must be a positive length, got {shown_value(self.support)}.")

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "profile" in cls.__dict__:
            function = jax.custom_jvp(cls.profile)
            function.defjvps(lambda ds, value, s: cls.slope(s) * ds)
            cls.of_square = staticmethod(function)

    @staticmethod
    @abstractmethod
    def profile(s: Any) -> Any:
        """Phi at squared relative distance s >= 0."""

    @staticmethod
    @abstractmethod
    def slope(s: Any) -> Any:
        """D phi / d s, finite for s >= 0 (kinks and logarithms cut off next to 0)."""

    def __call__(self, distance: ArrayLike) -> NDArray[np.float64]:
        """Phi at distances r in physical units, float64."""
        with float64():
            return np.asarray(type(self).profile(jnp.asarray((np.asarray(distance, float) / self.support) ** 2)))


def _root(s: Any) -> Any:
    """Sqrt with derivative 0 at 0, so that second derivatives of the smooth kernels come out right at a point."""
    positive = s > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, s, 1.0)), 0.0)


class WendlandC0(AbstractKernel):
    """(1 - rho)^2_+: local, continuous, with a kink at each point."""

    name, title, compact = "wendland_c0", "Wendland C0", True
    shares = (0.25, 0.5, 1.0, 2.0, 4.0)

    @staticmethod
    def profile(s: Any) -> Any:
        t = jnp.maximum(1 - jnp.sqrt(s), 0.0)
        return t * t

    @staticmethod
    def slope(s: Any) -> Any:
        r = jnp.sqrt(jnp.maximum(s, TINY))
        return -jnp.maximum(1 - r, 0.0) / r


class WendlandC2(AbstractKernel):
    """(1 - rho)^4_+ (4 rho + 1): psi_{3,1} of the paper, local and C2."""

    name, title, compact = "wendland_c2", "Wendland C2", True
    shares = (0.25, 0.5, 1.0, 2.0, 4.0)
    gaps = 16.0

    @staticmethod
    def profile(s: Any) -> Any:
        t = jnp.maximum(1 - jnp.sqrt(s), 0.0)
        q = t * t
        return q * q * (5 - 4 * t)

    @staticmethod
    def slope(s: Any) -> Any:
        return -10 * jnp.maximum(1 - _root(s), 0.0) ** 3


class WendlandC4(AbstractKernel):
    """(1 - rho)^6_+ (35 rho^2 + 18 rho + 3) / 3: local and C4."""

    name, title, compact = "wendland_c4", "Wendland C4", True
    shares = (0.25, 0.5, 1.0, 2.0, 4.0)
    gaps = 8.0

    @staticmethod
    def profile(s: Any) -> Any:
        r = jnp.sqrt(s)
        t = jnp.maximum(1 - r, 0.0)
        q = t * t
        return q * q * q * (35 * s + 18 * r + 3) * (1 / 3)

    @staticmethod
    def slope(s: Any) -> Any:
        r = _root(s)
        return (-28 / 3) * (1 + 5 * r) * jnp.maximum(1 - r, 0.0) ** 5


class Gaussian(AbstractKernel):
    """exp(-(3 rho)^2 / 2): the support radius is three standard deviations, where 1.1 % is left."""

    name, title = "gaussian", "Gaussian"
    shares = (1 / 16, 1 / 8, 1 / 4, 1 / 2)
    gaps = 2.0

    @staticmethod
    def profile(s: Any) -> Any:
        return jnp.exp(-4.5 * s)

    @staticmethod
    def slope(s: Any) -> Any:
        return -4.5 * jnp.exp(-4.5 * s)


class Multiquadric(AbstractKernel):
    """-sqrt(1 + (4 rho)^2), Hardy's: grows like a cone, rounded over a quarter of the support radius."""

    name, title, order = "multiquadric", "Multiquadric", 1
    shares = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
    gaps = 1.0

    @staticmethod
    def profile(s: Any) -> Any:
        return -jnp.sqrt(1 + 16 * s)

    @staticmethod
    def slope(s: Any) -> Any:
        return -8 / jnp.sqrt(1 + 16 * s)


class InverseMultiquadric(AbstractKernel):
    """1 / sqrt(1 + (4 rho)^2): a round bump that fades like 1 / r; a quarter is left at the support radius."""

    name, title = "inverse_multiquadric", "Inverse multiquadric"
    shares = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
    gaps = 1.0

    @staticmethod
    def profile(s: Any) -> Any:
        return 1 / jnp.sqrt(1 + 16 * s)

    @staticmethod
    def slope(s: Any) -> Any:
        t = 1 + 16 * s
        return -8 / (t * jnp.sqrt(t))


class InverseQuadratic(AbstractKernel):
    """1 / (1 + (4 rho)^2): a round bump that fades like 1 / r^2; 6 % is left at the support radius."""

    name, title = "inverse_quadratic", "Inverse quadratic"
    shares = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
    gaps = 1.0

    @staticmethod
    def profile(s: Any) -> Any:
        return 1 / (1 + 16 * s)

    @staticmethod
    def slope(s: Any) -> Any:
        t = 1 + 16 * s
        return -16 / (t * t)


class Linear(AbstractKernel):
    """-rho: the least wiggly of all, with a kink at each point."""

    name, title, order = "linear", "Linear", 1

    @staticmethod
    def profile(s: Any) -> Any:
        return -jnp.sqrt(s)

    @staticmethod
    def slope(s: Any) -> Any:
        return -0.5 / jnp.sqrt(jnp.maximum(s, TINY))


class ThinPlate(AbstractKernel):
    """rho^2 log(rho), Bookstein's thin-plate spline: the least bending in the plane; independent of the support."""

    name, title, order = "thin_plate", "Thin-plate spline", 2

    @staticmethod
    def profile(s: Any) -> Any:
        return 0.5 * s * jnp.log(jnp.maximum(s, TINY))

    @staticmethod
    def slope(s: Any) -> Any:
        return 0.5 * (jnp.log(jnp.maximum(s, TINY)) + 1)


class Cubic(AbstractKernel):
    """rho^3: smooth and global, the natural cubic spline's relative; independent of the support."""

    name, title, order = "cubic", "Cubic", 2

    @staticmethod
    def profile(s: Any) -> Any:
        return s * jnp.sqrt(s)

    @staticmethod
    def slope(s: Any) -> Any:
        return 1.5 * _root(s)


class Quintic(AbstractKernel):
    """-rho^5: very smooth and global; needs the quadratic trend; independent of the support."""

    name, title, order = "quintic", "Quintic", 3

    @staticmethod
    def profile(s: Any) -> Any:
        return -s * s * jnp.sqrt(s)

    @staticmethod
    def slope(s: Any) -> Any:
        return -2.5 * s * _root(s)


KERNELS: dict[str, type[AbstractKernel]] = {
    k.name: k for k in (WendlandC2, WendlandC0, WendlandC4, ThinPlate, Gaussian, Multiquadric, InverseMultiquadric,
                        InverseQuadratic, Cubic, Quintic, Linear)
}
"""All kernels by name; the first is the default."""


def kernel_named(name: str) -> type[AbstractKernel]:
    """The kernel class of a name; DeformError listing the names if there is none."""
    try:
        return KERNELS[name]
    except (KeyError, TypeError):  # what has no hash is no name either
        raise DeformError(f"unknown kernel {shown_value(name)}; choose one of {', '.join(KERNELS)}.") from None

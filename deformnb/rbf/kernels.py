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

Working on the square makes every gradient finite at a control point: ``d phi / d x = slope(s) 2 (x - x_i)/support^2``
needs no division by r, where differentiating through ``sqrt`` gives NaN there.

:func:`register_kernel` adds the user's kernels.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar, Literal, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb._jax import HAS_JAX, float64, jax, jnp, lax, with_derivative
from deformnb._typing import Floats
from deformnb.checks import SMALLEST_LENGTH, is_finite, short_value
from deformnb.errors import DeformError

# Replaces s = 0 in a logarithm or under a fraction; its products with x - x_i = 0 are zero, as the limit is.
TINY = 1e-30

LEAST_DISTANCE = 2.0**-20
"""Relative distance below which a derivative by JAX is that at this distance: nearer it has no digits, because
phi'(rho) / rho is divided by rho; times x - x_i the difference is below 1e-6 of phi'."""


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
    """Supports among which a fit chooses, in diameters of the set of its points; the middle one is the usual."""
    gaps: ClassVar[float] = np.inf
    """The longest support that a fit chooses for points in a row, in gaps between them: longer ones extrapolate wildly
    across the row. Measured with one point dragged by a tenth of rows of 3 to 33."""
    steepest: ClassVar[float] = 2.0
    """The largest slope of phi within the support, about: weight of errors of a place relative to those of values."""
    smoothness: ClassVar[int | None] = None
    """The first derivative that may jump, at most 3; None where that is not known. Then nothing is interpolated."""
    of_square: ClassVar[Callable[[Any], Any]]
    """phi as a function of s, with ``slope`` as its derivative, which the solver and the evaluation call."""

    def __post_init__(self) -> None:
        if not (is_finite(self.support) and self.support >= SMALLEST_LENGTH):
            raise DeformError(f"the support radius must be a positive length, got {short_value(self.support)}.")

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        if "profile" in cls.__dict__:
            if "slope" not in cls.__dict__:
                cls.slope = staticmethod(_derivative(cls.profile, LEAST_DISTANCE**2))  # type: ignore[method-assign,assignment]
            cls.of_square = staticmethod(with_derivative(cls.profile, cls._jvp))

    @staticmethod
    @abstractmethod
    def profile(s: Any) -> Any:
        """Phi at squared relative distance s >= 0."""

    @staticmethod
    @abstractmethod
    def slope(s: Any) -> Any:
        """D phi / d s, finite for s >= 0 (kinks and logarithms cut off next to 0); by JAX where it is not given."""

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats] | None:
        """Bounds of ``|phi'|`` and of the second derivatives for rho from a to b.

        The latter is the larger of ``|phi''|`` and ``|phi' / rho|``. None where there are none: the field is then
        evaluated at every voxel of a block beforehand.
        """
        return None

    @classmethod
    def _jvp(cls, primals: tuple[Any], tangents: tuple[Any]) -> tuple[Any, Any]:
        (s,), (ds,) = primals, tangents
        return cls.profile(s), cls.slope(s) * ds

    def __call__(self, distance: ArrayLike) -> NDArray[np.float64]:
        """Phi at distances r in physical units, float64."""
        with float64():
            return np.asarray(type(self).profile(jnp.asarray((np.asarray(distance, float) / self.support) ** 2)))


def _derivative(function: Callable[[Any], Any], least: float) -> Callable[[Any], Any]:
    """The derivative of a function of numbers, element by element; below ``least`` that at ``least``."""

    def derivative(x: Any) -> Any:
        x = jnp.maximum(x, least)
        return jax.jvp(function, (x,), (jnp.ones_like(x),))[1]

    return derivative


def _namespace(s: Any) -> Any:
    """NumPy for its own arrays, of few numbers: it is done with them before a compiled function starts; else JAX."""
    return np if isinstance(s, np.ndarray) else jnp


def _root(s: Any) -> Any:
    """Sqrt with derivative 0 at 0, so that second derivatives of the smooth kernels come out right at a point."""
    positive = s > 0
    return jnp.where(positive, jnp.sqrt(jnp.where(positive, s, 1.0)), 0.0)


class _Digits(NamedTuple):
    """Constants of a floating point type for its logarithm.

    width : bits of the mantissa; bias : of the exponent; root_half, two_to_width : bits of sqrt(1/2) and 2^width;
    log_2 : in two parts, the first so short that its product with an exponent is exact; series : coefficients of
    ``(atanh(sqrt z) / sqrt z - 1) / z`` for z of a mantissa from sqrt(1/2) to sqrt 2, by Remez' algorithm in 40 digits.
    """

    integer: Any
    width: int
    bias: int
    root_half: int
    two_to_width: int
    log_2: tuple[float, float]
    series: tuple[float, ...]


_DIGITS = {
    # up to 4.5e-18 / z
    np.dtype(np.float64): _Digits(
        np.int64,
        52,
        1023,
        0x3FE6A09E667F3BCD,
        0x4330000000000000,
        (0.6931471804855391, 7.440617110012397e-11),
        (
            0.333333333333333486,
            0.199999999999492548,
            0.142857143131850435,
            0.111111055387920751,
            0.0909144643700562618,
            0.0766580419567697147,
            0.0730886585948460551,
        ),
    ),
    # up to 8.1e-10 / z
    np.dtype(np.float32): _Digits(
        np.int32,
        23,
        127,
        0x3F3504F3,
        0x4B000000,
        (0.693145751953125, 1.4286068202862268e-06),
        (0.333333881909, 0.199887707824, 0.149358640111),
    ),
}


def _log_of_bits(s: Any) -> Any:
    """Log of positive normal numbers: ``k log 2 + 2 atanh((m - 1) / (m + 1))`` with s = 2^k m, m next to 1.

    Right to 2 units in the last place. XLA's own of 64 bits is not vectorised on a CPU: 128 points at 256^2 pixels took
    48 ms instead of 12; with that of 32 bits they took 4.7 ms instead of 3.8.
    """
    if not HAS_JAX or s.dtype not in _DIGITS:
        return jnp.log(s)
    integer, width, bias, root_half, two_to_width, log_2, series = _DIGITS[s.dtype]
    bits = lax.bitcast_convert_type(s, integer)
    exponent = lax.shift_right_logical(bits + integer((bias << width) - root_half), integer(width))
    # Whole numbers below 2^width, or-ed to the bits of 2^width, are added to it.
    k = lax.bitcast_convert_type(exponent | integer(two_to_width), s.dtype) - (2.0**width + bias)
    m = lax.bitcast_convert_type(bits - ((exponent - integer(bias)) << integer(width)), s.dtype)
    f = (m - 1) / (m + 1)
    z = f * f
    tail: Any = series[-1]
    for c in series[-2::-1]:
        tail = tail * z + c
    return k * log_2[0] + (2 * f + (2 * f * z * tail + k * log_2[1]))


_log = with_derivative(_log_of_bits, lambda s, ds: (_log_of_bits(s[0]), ds[0] / s[0]))


class WendlandC0(AbstractKernel):
    """(1 - rho)^2_+: local, continuous, with a kink at each point."""

    name, title, compact = "wendland_c0", "Wendland C0", True
    shares = (0.25, 0.5, 1.0, 2.0, 4.0)
    smoothness = 1

    @staticmethod
    def profile(s: Any) -> Any:
        xp = _namespace(s)
        t = xp.maximum(1 - xp.sqrt(s), 0.0)
        return t * t

    @staticmethod
    def slope(s: Any) -> Any:
        r = jnp.sqrt(jnp.maximum(s, TINY))
        return -jnp.maximum(1 - r, 0.0) / r

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats]:
        slope = 2 * np.maximum(1 - a, 0)
        return slope, np.where(a < 1, np.maximum(slope / np.maximum(a, 1e-300), 2.0), 0.0)


class WendlandC2(AbstractKernel):
    """(1 - rho)^4_+ (4 rho + 1): psi_{3,1} of the paper, local and C2."""

    name, title, compact = "wendland_c2", "Wendland C2", True
    shares = (0.25, 0.5, 1.0, 2.0, 4.0)
    gaps = 16.0
    smoothness = 3

    @staticmethod
    def profile(s: Any) -> Any:
        xp = _namespace(s)
        t = xp.maximum(1 - xp.sqrt(s), 0.0)
        q = t * t
        return q * q * (5 - 4 * t)

    @staticmethod
    def slope(s: Any) -> Any:
        return -10 * jnp.maximum(1 - _root(s), 0.0) ** 3

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats]:
        top = np.clip(0.25, np.minimum(a, 1), np.minimum(b, 1))
        bend = np.maximum(1, np.maximum(np.abs(1 - 4 * a), np.abs(1 - 4 * np.minimum(b, 1))))
        return 20 * top * (1 - top) ** 3, 20 * np.maximum(1 - a, 0) ** 2 * bend


class WendlandC4(AbstractKernel):
    """(1 - rho)^6_+ (35 rho^2 + 18 rho + 3) / 3: local and C4."""

    name, title, compact = "wendland_c4", "Wendland C4", True
    shares = (0.25, 0.5, 1.0, 2.0, 4.0)
    gaps = 8.0
    smoothness = 3

    @staticmethod
    def profile(s: Any) -> Any:
        xp = _namespace(s)
        r = xp.sqrt(s)
        t = xp.maximum(1 - r, 0.0)
        q = t * t
        return q * q * q * (35 * s + 18 * r + 3) * (1 / 3)

    @staticmethod
    def slope(s: Any) -> Any:
        r = _root(s)
        return (-28 / 3) * (1 + 5 * r) * jnp.maximum(1 - r, 0.0) ** 5

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats]:
        inner, outer = np.maximum(1 - a, 0), np.minimum(b, 1)
        slope = 56 / 3 * outer * (1 + 5 * outer) * inner**5
        return slope, 56 / 3 * inner**4 * np.maximum(1.8, 35 * outer**2 - 4 * outer - 1)


class Gaussian(AbstractKernel):
    """exp(-(3 rho)^2 / 2): the support radius is three standard deviations, where 1.1 % is left."""

    name, title = "gaussian", "Gaussian"
    shares = (1 / 16, 1 / 8, 1 / 4, 1 / 2)
    gaps = 2.0
    smoothness = 3

    @staticmethod
    def profile(s: Any) -> Any:
        xp = _namespace(s)
        return xp.exp(-4.5 * s)

    @staticmethod
    def slope(s: Any) -> Any:
        return -4.5 * jnp.exp(-4.5 * s)

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats]:
        largest = np.exp(-4.5 * a**2)
        return 9 * b * largest, largest * np.maximum(9, 81 * b**2 - 9)


class Multiquadric(AbstractKernel):
    """-sqrt(1 + (4 rho)^2), Hardy's: grows like a cone, rounded over a quarter of the support radius."""

    name, title, order = "multiquadric", "Multiquadric", 1
    shares = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
    gaps = 1.0
    smoothness = 3

    @staticmethod
    def profile(s: Any) -> Any:
        xp = _namespace(s)
        return -xp.sqrt(1 + 16 * s)

    @staticmethod
    def slope(s: Any) -> Any:
        return -8 / jnp.sqrt(1 + 16 * s)

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats]:
        return 16 * b / np.sqrt(1 + 16 * b**2), 16 / np.sqrt(1 + 16 * a**2)


class InverseMultiquadric(AbstractKernel):
    """1 / sqrt(1 + (4 rho)^2): a round bump that fades like 1 / r; a quarter is left at the support radius."""

    name, title = "inverse_multiquadric", "Inverse multiquadric"
    shares = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0)
    gaps = 1.0

    @staticmethod
    def profile(s: Any) -> Any:
        xp = _namespace(s)
        return 1 / xp.sqrt(1 + 16 * s)

    @staticmethod
    def slope(s: Any) -> Any:
        t = 1 + 16 * s
        return -8 / (t * jnp.sqrt(t))

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats]:
        # With u = 16 rho^2: |phi'| = 4 sqrt(u) (1 + u)^-1.5, largest at u = 1/2; |phi' / rho| = 16 (1 + u)^-1.5;
        # |phi''| = 16 |2 u - 1| (1 + u)^-2.5, which is below the one before for u < 2.
        u, v = 16 * a**2, 16 * b**2
        top = np.clip(0.5, u, v)
        return 4 * np.sqrt(top) * (1 + top) ** -1.5, 16 * (1 + u) ** -1.5 * np.maximum(1, (2 * v - 1) / (1 + v))


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

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats]:
        # Likewise |phi'| = 8 sqrt(u) (1 + u)^-2, largest at u = 1/3; |phi' / rho| = 32 (1 + u)^-2 and
        # |phi''| = 32 |3 u - 1| (1 + u)^-3.
        u, v = 16 * a**2, 16 * b**2
        top = np.clip(1 / 3, u, v)
        return 8 * np.sqrt(top) * (1 + top) ** -2.0, 32 * (1 + u) ** -2.0 * np.maximum(1, (3 * v - 1) / (1 + v))


class Linear(AbstractKernel):
    """-rho: the least wiggly of all, with a kink at each point."""

    name, title, order = "linear", "Linear", 1
    smoothness = 1

    @staticmethod
    def profile(s: Any) -> Any:
        xp = _namespace(s)
        return -xp.sqrt(s)

    @staticmethod
    def slope(s: Any) -> Any:
        return -0.5 / jnp.sqrt(jnp.maximum(s, TINY))

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats]:
        return np.ones_like(a), 1 / np.maximum(a, 1e-300)


class ThinPlate(AbstractKernel):
    """rho^2 log(rho), Bookstein's thin-plate spline: the least bending in the plane; independent of the support."""

    name, title, order = "thin_plate", "Thin-plate spline", 2
    smoothness = 2

    @staticmethod
    def profile(s: Any) -> Any:
        xp = _namespace(s)
        bounded = xp.maximum(s, TINY)
        return 0.5 * s * (np.log(bounded) if xp is np else _log(bounded))

    @staticmethod
    def slope(s: Any) -> Any:
        return 0.5 * (_log(jnp.maximum(s, TINY)) + 1)

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats]:
        ends = [np.log(np.maximum(r, 1e-300)) for r in (a, b)]
        slope = [np.abs(r * (2 * log + 1)) for r, log in zip((a, b), ends, strict=True)]
        bend = [np.maximum(np.abs(2 * log + 1), np.abs(2 * log + 3)) for log in ends]
        return np.maximum(np.maximum(*slope), 2 * np.exp(-1.5)), np.maximum(*bend)


class Cubic(AbstractKernel):
    """rho^3: smooth and global, the natural cubic spline's relative; independent of the support."""

    name, title, order = "cubic", "Cubic", 2
    smoothness = 3

    @staticmethod
    def profile(s: Any) -> Any:
        xp = _namespace(s)
        return s * xp.sqrt(s)

    @staticmethod
    def slope(s: Any) -> Any:
        return 1.5 * _root(s)

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats]:
        return 3 * b**2, 6 * b


class Quintic(AbstractKernel):
    """-rho^5: very smooth and global; needs the quadratic trend; independent of the support."""

    name, title, order = "quintic", "Quintic", 3

    @staticmethod
    def profile(s: Any) -> Any:
        xp = _namespace(s)
        return -s * s * xp.sqrt(s)

    @staticmethod
    def slope(s: Any) -> Any:
        return -2.5 * s * _root(s)

    @staticmethod
    def curvature(a: Floats, b: Floats) -> tuple[Floats, Floats]:
        return 5 * b**4, 20 * b**3


KernelName: TypeAlias = Literal[
    "wendland_c2",
    "wendland_c0",
    "wendland_c4",
    "thin_plate",
    "gaussian",
    "multiquadric",
    "inverse_multiquadric",
    "inverse_quadratic",
    "cubic",
    "quintic",
    "linear",
]
"""Names of the kernels of this package; :func:`register_kernel` adds others, so that a parameter takes any text too."""

KERNELS: dict[str, type[AbstractKernel]] = {
    k.name: k
    for k in (
        WendlandC2,
        WendlandC0,
        WendlandC4,
        ThinPlate,
        Gaussian,
        Multiquadric,
        InverseMultiquadric,
        InverseQuadratic,
        Cubic,
        Quintic,
        Linear,
    )
}
"""All kernels by name; the first is the default."""


BUILT_IN = frozenset(KERNELS)
"""Names of the kernels of this package, which others do not take."""

Phi = Callable[[Any], Any]
"""A radial function of the relative distance rho = r / support, written with ``jax.numpy``."""


def as_kernel(kernel: str | type[AbstractKernel] | AbstractKernel | Phi) -> type[AbstractKernel]:
    """The kernel class of a name, of a kernel, or of a function, which is registered if it is not yet.

    Raises
    ------
    DeformError
        Listing the names if there is none of this name, or as :func:`register_kernel` does.
    """
    if isinstance(kernel, AbstractKernel):
        kernel = type(kernel)
    if callable(kernel):
        if isinstance(kernel, type) and KERNELS.get(getattr(kernel, "name", "")) is kernel:
            return kernel
        same = next((k for k in KERNELS.values() if getattr(k, "made_of", None) is kernel), None)
        return same or register_kernel(kernel)
    try:
        return KERNELS[kernel]
    except (KeyError, TypeError):  # what has no hash is no name either
        raise DeformError(f"unknown kernel {short_value(kernel)}; choose one of {', '.join(KERNELS)}.") from None


# ---- kernels of one's own --------------------------------------------------------------------------------------------

_FARTHEST = 2.0**20  # relative distance up to which a kernel must be finite
_HIGHEST_ORDER = 3  # that a trend is rich enough for
_KINDS = ("profile", "slope")
_MOST = 4096  # distances at a time: those between 64 points


def register_kernel(
    kernel: Phi | type[AbstractKernel],
    *,
    name: str | None = None,
    derivative: Phi | None = None,
    order: int = 0,
    compact: bool = False,
    title: str | None = None,
    shares: tuple[float, ...] | None = None,
    gaps: float | None = None,
) -> type[AbstractKernel]:
    """Add a radial function to the kernels that fits, steps, documents, menus and exported pages take by name.

    It is checked here, once: that JAX can compile it, that it and its derivative are finite from the point to a
    million supports, that it ends at the support if it is compact, and that its matrices are positive definite modulo
    the polynomials of its order, on random and regular points of the plane and of space. That finds wrong orders and
    signs; it is no proof. The same name again replaces the kernel from then on; existing fits are unchanged.

    Parameters
    ----------
    kernel : phi as a function of the relative distance rho = r / support, element by element, written with
        ``jax.numpy``; or a subclass of :class:`AbstractKernel` with ``name``, ``title``, ``order``, ``compact`` and
        ``profile`` of the squared relative distance, for which the other arguments are not taken.
    name : lower-case letters, digits and "_"; default is the name of the function.
    derivative : d phi / d rho; default is that by JAX.
    order : of conditional positive definiteness, 0 to 3; a fit needs a trend of this order.
    compact : the function ends at rho = 1, where it is 0, and is taken as 0 beyond.
    title : in menus; default is made of the name.
    shares : supports among which a fit chooses, in diameters of the set of its points, the middle one the usual.
    gaps : the longest support that a fit chooses for points in a row, in gaps between them.

    Returns
    -------
    The kernel class, which is accepted in place of a name. May be used as a decorator.

    Raises
    ------
    DeformError
        The error of the function, at which distance, and what to do about it.

    Examples
    --------
    >>> def matern_52(rho):  # Rasmussen, Williams, Gaussian Processes (2006), Eq. 4.17; its length R / 3
    ...     a = 3 * 5**0.5 * rho
    ...     return (1 + a + a**2 / 3) * jnp.exp(-a)
    >>> register_kernel(matern_52, title="Matern 5/2").name
    'matern_52'
    >>> from deformnb.rbf.fit_settings import FitSettings
    >>> FitSettings(kernel=matern_52).kernel
    'matern_52'
    >>> del KERNELS["matern_52"]
    """
    kind: Any = (
        kernel
        if isinstance(kernel, type)
        else _kernel_of(
            kernel,
            derivative,
            {
                "name": _name_of(kernel) if name is None else name,
                "order": order,
                "compact": compact,
                "title": title,
                "shares": shares,
                "gaps": gaps,
            },
        )
    )
    _check_names(kind)
    with float64():
        _check_values(kind)
        _check_order(kind)
    KERNELS[kind.name] = kind
    return kind


def _name_of(kernel: Phi) -> str:
    name = getattr(kernel, "__name__", "")
    if name.isidentifier():
        return str(name)
    raise DeformError('a kernel needs a name, by which documents know it: register_kernel(function, name="...").')


def _kernel_of(phi: Phi, derivative: Phi | None, given: dict[str, Any]) -> type[AbstractKernel]:
    """The kernel class of a function of rho."""
    if not callable(phi):
        raise DeformError(f"a kernel is a function of the relative distance, got {short_value(phi)}.")
    own_slope = derivative or _derivative(phi, LEAST_DISTANCE)

    def ends(s: Any, value: Any) -> Any:
        return jnp.where(s < 1, value, 0.0) if given["compact"] else value

    def distance(s: Any, least: float) -> Any:
        return jnp.sqrt(jnp.clip(s, least, 1.0) if given["compact"] else jnp.maximum(s, least))

    def profile(s: Any) -> Any:
        return ends(s, phi(distance(s, TINY)))

    def slope(s: Any) -> Any:
        rho = distance(s, LEAST_DISTANCE**2)
        return ends(s, own_slope(rho) / (2 * rho))

    is_wide = given["compact"] or given["order"] in (2, 3)
    usual = {
        "title": str(given["name"]).replace("_", " ").capitalize(),
        "gaps": np.inf if is_wide else 1.0,
        "shares": (0.25, 0.5, 1.0, 2.0, 4.0)
        if given["compact"]
        else (1.0,)
        if is_wide
        else (1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0),
    }
    named = {key: usual[key] if value is None else value for key, value in given.items()}
    return type(
        str(given["name"]),
        (AbstractKernel,),
        {
            **named,
            "profile": staticmethod(profile),
            "slope": staticmethod(slope),
            "made_of": staticmethod(phi),
            "__doc__": phi.__doc__ or "A registered kernel.",
            "__module__": __name__,
        },
    )


def _check_names(kind: type[AbstractKernel]) -> None:
    name = getattr(kind, "name", None)
    if not (issubclass(kind, AbstractKernel) and isinstance(name, str) and re.fullmatch(r"[a-z][a-z0-9_]{0,39}", name)):
        raise DeformError(
            'the name of a kernel is up to 40 lower-case letters, digits and "_", got '
            f'{short_value(name)}; give name="...", or set it in a subclass of AbstractKernel.'
        )
    if name in BUILT_IN:
        raise DeformError(f"{name!r} is a kernel of deformnb, and its documents mean that one; choose another name.")
    if kind.order not in range(_HIGHEST_ORDER + 1) or isinstance(kind.order, bool):
        raise DeformError(
            f"the order of the kernel {name!r} is 0, 1, 2 or 3, got {short_value(kind.order)}: no trend "
            "holds the polynomials of a higher one."
        )
    if not isinstance(kind.title, str) or kind.title in [k.title for k in KERNELS.values() if k.name != name]:
        raise DeformError(
            f"the title of the kernel {name!r} is a text that no other kernel has, got {short_value(kind.title)}."
        )
    if not (kind.shares and all(is_finite(v) and v > 0 for v in kind.shares) and kind.gaps > 0):
        raise DeformError(
            f"shares and gaps of the kernel {name!r} are positive numbers, got {kind.shares} and {kind.gaps}."
        )


def _check_values(kind: type[AbstractKernel]) -> None:
    """Refuse a kernel that JAX cannot compile, that is not finite, jumps or has another derivative than is given."""
    rho = np.concatenate(
        [
            [0.0, LEAST_DISTANCE],
            np.geomspace(1e-5, 0.01, 30),
            np.linspace(0.02, 1.5, 149),
            np.geomspace(1.6, _FARTHEST, 60),
        ]
    )
    found = {}
    for what in _KINDS:
        found[what] = values = _compute_profile(kind, what, rho**2)
        if not np.isfinite(values).all():
            raise DeformError(
                f"the kernel {kind.name!r} {'' if what == 'profile' else 'has a derivative that '}"
                f"is not finite at rho = {rho[~np.isfinite(values)][0]:.4g}; a fit needs it from 0 to "
                f"{_FARTHEST:.0f}: give its limit there, as by jnp.where."
            )
    phi, slope = found["profile"], found["slope"]
    size = np.abs(phi[rho <= 1]).max()
    if size == 0 or abs(phi[0] - phi[1]) > 1e-3 * size:
        raise DeformError(
            f"the kernel {kind.name!r} jumps next to its point, from {phi[0]:.4g} to {phi[1]:.4g} within "
            "a millionth of the support: a displacement would; a kernel is continuous."
        )
    if kind.compact:
        last = float(_compute_profile(kind, "profile", np.array([1 - 1e-9]))[0])
        if abs(last) > 1e-3 * size or phi[rho > 1].any():
            raise DeformError(
                f"the kernel {kind.name!r} is {last:.4g} at rho = 1, where a compact kernel ends at 0; "
                "leave compact=True out, or let it end there."
            )
    middle, h = rho[(rho > 0.02) & (rho < 1.5)], 1e-5
    high, low = (_compute_profile(kind, "profile", (middle + step) ** 2) for step in (h, -h))
    wanted, given = (high - low) / (2 * h), 2 * middle * slope[(rho > 0.02) & (rho < 1.5)]
    kind.steepest = max(kind.steepest, float(np.abs(given).max()))
    wrong = np.abs(wanted - given) > 1e-4 * np.abs(given).max() + 1e-6 * size
    if wrong.sum() > 4:  # a kink within a difference is no fault
        at = int(np.flatnonzero(wrong)[0])
        raise DeformError(
            f"the derivative of the kernel {kind.name!r} is {given[at]:.6g} at rho = {middle[at]:.3g}, "
            f"and its values there rise by {wanted[at]:.6g}; leave it out, and JAX finds it."
        )


def _compute_profile(kind: type[AbstractKernel], what: str, s: NDArray[np.float64]) -> NDArray[np.float64]:
    padded = np.ones(_MOST)  # one size is compiled
    padded[: s.size] = s
    try:
        found = np.asarray(jax.jit(getattr(kind, what))(jnp.asarray(padded)))
    except FloatingPointError:  # NaN, where JAX is set to check for it
        return np.full(s.shape, np.nan)
    except Exception as error:  # a user's function may raise anything
        first = str(error).strip().split("\n")[0]
        raise DeformError(
            f"the {what} of the kernel {kind.name!r} cannot be compiled: {first[:160]} Write it "
            "with jax.numpy, element by element: jnp.exp for math.exp and np.exp, jnp.where for "
            "if."
        ) from error
    if found.shape != padded.shape or found.dtype != np.float64:
        raise DeformError(
            f"the {what} of the kernel {kind.name!r} gives {found.dtype} of shape {found.shape} for "
            f"{padded.size} distances; it is a number for each, element by element."
        )
    return found[: s.size]


def _check_order(kind: type[AbstractKernel]) -> None:
    """Refuse a kernel whose matrices are not positive definite modulo the polynomials of its order."""
    if _is_definite(kind, kind.order):
        return
    others = [
        (sign, order) for sign, order in product((1, -1), range(_HIGHEST_ORDER + 1)) if _is_definite(kind, order, sign)
    ]
    remedy = "no fit with it would be well posed; choose another function"
    if others:
        sign, order = others[0]
        remedy = f"{'it' if sign > 0 else 'its negative'} is of order {order}: register that"
    raise DeformError(
        f"the kernel {kind.name!r} is not conditionally positive definite of order {kind.order} in the "
        f"plane and in space; {remedy}."
    )


def _is_definite(kind: type[AbstractKernel], order: int, sign: int = 1) -> bool:
    """Check for the smallest eigenvalue modulo the polynomials to be positive, and at no scale negative."""
    rng, largest_share = np.random.default_rng(0), 0.0
    for dim, count in ((2, 7), (3, 4)):
        regular = np.stack(np.meshgrid(*[np.linspace(0, 1, count)] * dim), axis=-1).reshape(-1, dim)
        for x, support in product((regular, rng.uniform(0, 1, regular.shape)), (0.03, 0.15, 0.3, 0.5, 1.0, 2.0, 4.0)):
            squares = ((x[:, None] - x[None]) ** 2).sum(axis=-1) / support**2
            phi = sign * _compute_profile(kind, "profile", squares.ravel()).reshape(squares.shape)
            lowest = float(np.linalg.eigvalsh(_project_out_polynomials(phi, x, order))[0])
            share = lowest / float(np.abs(phi).max())
            if share < -1e-11:  # of rounding 1e-15 were seen
                return False
            largest_share = max(largest_share, share)
    return largest_share > 1e-8


def _project_out_polynomials(phi: NDArray[np.float64], x: NDArray[np.float64], order: int) -> NDArray[np.float64]:
    """Phi on the complement of the polynomials of a degree below ``order``."""
    if order == 0:
        return phi
    pairs = [x[:, a] * x[:, b] for a in range(x.shape[1]) for b in range(a + 1)]
    columns = np.column_stack([np.ones(len(x)), *(x.T if order > 1 else []), *(pairs if order > 2 else [])])
    rest = np.linalg.qr(columns, mode="complete")[0][:, columns.shape[1] :]
    return np.asarray(rest.T @ phi @ rest)

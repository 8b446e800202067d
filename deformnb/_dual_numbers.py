"""Derivatives by forward differentiation in NumPy, where JAX is not installed.

A :class:`Dual` holds the values of an array and their derivatives along one direction, and follows NumPy's functions by
the chain rule (A. Griewank, A. Walther, Evaluating Derivatives (2008), chapter 3). At a kink of a maximum or a minimum
the derivative is the mean of both sides, as JAX has it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from deformnb.errors import MissingPackageError

__all__ = ["Dual", "jvp", "split"]


class Dual(np.lib.mixins.NDArrayOperatorsMixin):
    """Values and their derivatives along one direction, arrays of one shape.

    Examples
    --------
    >>> x = Dual(np.array([2.0, 3.0]), np.ones(2))
    >>> (x * x + np.exp(0 * x)).tangent.tolist()
    [4.0, 6.0]
    """

    def __init__(self, value: Any, tangent: Any) -> None:
        self.value = np.asarray(value)
        self.tangent = np.broadcast_to(tangent, self.value.shape)

    def __repr__(self) -> str:
        return f"Dual({self.value!r}, {self.tangent!r})"

    def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
        raise TypeError("an array of NumPy would lose the derivative.")

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Any:
        options.pop("out", None)  # of an operator in place, which binds its name to the result
        if method != "__call__" or options.keys() - {"dtype"}:
            raise _unknown(f"{ufunc.__name__}.{method}")
        values, tangents = zip(*map(split, inputs), strict=True)
        result = ufunc(*values, **options)
        if ufunc is np.matmul:
            return Dual(result, values[0] @ tangents[1] + tangents[0] @ values[1])
        if ufunc in _CONSTANT:
            return result
        if ufunc not in _SLOPES:
            raise _unknown(ufunc.__name__)
        slopes = _SLOPES[ufunc](result, *values)
        return Dual(result, sum(slope * t for slope, t in zip(slopes, tangents, strict=True)).astype(result.dtype))

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        if function in _OF_VALUES:
            return function(*_each(args, 0), **options)
        if function in _LINEAR:
            return Dual(function(*_each(args, 0), **options), function(*_each(args, 1), **options))
        if function not in _FUNCTIONS:
            raise _unknown(function.__name__)
        return _FUNCTIONS[function](*args, **options)

    shape = property(lambda self: self.value.shape)
    dtype = property(lambda self: self.value.dtype)
    ndim = property(lambda self: self.value.ndim)
    size = property(lambda self: self.value.size)
    T = property(np.transpose)

    def __len__(self) -> int:
        return len(self.value)

    def __getitem__(self, index: Any) -> Dual:
        return Dual(self.value[index], self.tangent[index])

    def reshape(self, *shape: Any) -> Dual:
        """The same numbers in another shape."""
        return Dual(self.value.reshape(*shape), self.tangent.reshape(*shape))

    def astype(self, dtype: Any) -> Any:
        """The same numbers in another type; those of integers have no derivative."""
        if not np.issubdtype(dtype, np.inexact):
            return self.value.astype(dtype)
        return Dual(self.value.astype(dtype), self.tangent.astype(dtype))

    def sum(self, *args: Any, **options: Any) -> Any:
        """The sum, as of arrays."""
        return np.sum(self, *args, **options)


def jvp(function: Callable[..., Any], primals: Sequence[Any], tangents: Sequence[Any]) -> tuple[Any, Any]:
    """The result of a function, an array, and its derivative along a direction, as ``jax.jvp`` finds them.

    >>> jvp(np.square, (np.array([3.0]),), (np.array([1.0]),))
    (array([9.]), array([6.]))
    """
    found = function(*(Dual(x, t) for x, t in zip(primals, tangents, strict=True)))
    return split(found)


def split(x: Any) -> tuple[Any, Any]:
    """Values and derivatives; those of a constant are zero."""
    if isinstance(x, Dual):
        return x.value, x.tangent
    return x, np.zeros(np.shape(x))


def _unknown(name: str) -> MissingPackageError:
    return MissingPackageError(
        f"the derivative of numpy's {name} needs JAX, which is not installed: pip install jax (or give the derivative)"
    )


def _each(args: Sequence[Any], part: int) -> list[Any]:
    """Arguments with values (part 0) or derivatives (1) in place of dual numbers, and of sequences that hold some."""

    def replace(arg: Any) -> Any:
        if isinstance(arg, list | tuple) and any(isinstance(one, Dual) for one in arg):
            return [split(one)[part] for one in arg]
        return split(arg)[part] if isinstance(arg, Dual) else arg

    return list(map(replace, args))


def _where(condition: Any, x: Any, y: Any) -> Dual:
    (a, da), (b, db) = split(x), split(y)
    condition = split(condition)[0]
    return Dual(np.where(condition, a, b), np.where(condition, da, db))


def _clip(x: Any, low: Any = None, high: Any = None) -> Any:
    x = x if low is None else np.maximum(x, low)
    return x if high is None else np.minimum(x, high)


def _multilinear(function: Callable[..., Any]) -> Callable[..., Dual]:
    """Of a function that is linear in each of the arrays among its arguments: one term for each."""

    def apply(*args: Any, **options: Any) -> Dual:
        values = _each(args, 0)
        terms = [
            function(*values[:k], a.tangent, *values[k + 1 :], **options)
            for k, a in enumerate(args)
            if isinstance(a, Dual)
        ]
        return Dual(function(*values, **options), sum(terms))

    return apply


def _full_like(x: Any, value: Any, **options: Any) -> Any:
    return np.full_like(split(x)[0], value, **options)


def _step(x: Any) -> Any:
    return (1 + np.sign(x)) / 2


def _power_slopes(_: Any, x: Any, n: Any) -> tuple[Any, Any]:
    with np.errstate(all="ignore"):
        return n * x ** np.where(np.asarray(n) == 0, 1.0, np.asarray(n) - 1.0), np.where(x > 0, np.log(x), 0.0) * x**n


_CONSTANT = frozenset(
    [
        *(np.equal, np.not_equal, np.less, np.less_equal, np.greater, np.greater_equal),
        *(np.isfinite, np.isnan, np.isinf, np.signbit, np.sign, np.floor, np.ceil, np.rint, np.trunc),
        *(np.logical_and, np.logical_or, np.logical_not),
    ]
)
"""Functions whose results have no derivative."""

_SLOPES: dict[Any, Callable[..., tuple[Any, ...]]] = {
    np.add: lambda _, x, y: (1.0, 1.0),
    np.subtract: lambda _, x, y: (1.0, -1.0),
    np.multiply: lambda _, x, y: (y, x),
    np.divide: lambda r, x, y: (1 / y, -r / y),
    np.negative: lambda _, x: (-1.0,),
    np.positive: lambda _, x: (1.0,),
    np.power: _power_slopes,
    np.float_power: _power_slopes,
    np.square: lambda _, x: (2 * x,),
    np.sqrt: lambda r, x: (0.5 / r,),
    np.cbrt: lambda r, x: (1 / (3 * r * r),),
    np.reciprocal: lambda r, x: (-r * r,),
    np.absolute: lambda _, x: (np.sign(x),),
    np.exp: lambda r, x: (r,),
    np.exp2: lambda r, x: (np.log(2.0) * r,),
    np.expm1: lambda r, x: (r + 1,),
    np.log: lambda _, x: (1 / x,),
    np.log2: lambda _, x: (1 / (np.log(2.0) * x),),
    np.log10: lambda _, x: (1 / (np.log(10.0) * x),),
    np.log1p: lambda _, x: (1 / (1 + x),),
    np.sin: lambda _, x: (np.cos(x),),
    np.cos: lambda _, x: (-np.sin(x),),
    np.tan: lambda r, x: (1 + r * r,),
    np.arcsin: lambda _, x: (1 / np.sqrt(1 - x * x),),
    np.arccos: lambda _, x: (-1 / np.sqrt(1 - x * x),),
    np.arctan: lambda _, x: (1 / (1 + x * x),),
    np.arctan2: lambda _, y, x: (x / (x * x + y * y), -y / (x * x + y * y)),
    np.sinh: lambda _, x: (np.cosh(x),),
    np.cosh: lambda _, x: (np.sinh(x),),
    np.tanh: lambda r, x: (1 - r * r,),
    np.hypot: lambda r, x, y: (x / r, y / r),
    np.maximum: lambda _, x, y: (_step(x - y), _step(y - x)),
    np.minimum: lambda _, x, y: (_step(y - x), _step(x - y)),
}
"""The derivatives of a function by each of its arguments, from its result and these."""

_OF_VALUES = frozenset([np.shape, np.ndim, np.size, np.zeros_like, np.ones_like, np.result_type, np.iscomplexobj])

_LINEAR = frozenset(
    [
        *(np.sum, np.mean, np.cumsum, np.stack, np.concatenate, np.moveaxis, np.swapaxes, np.transpose, np.reshape),
        *(np.ravel, np.roll, np.take, np.expand_dims, np.squeeze, np.broadcast_to, np.flip, np.diagonal, np.trace),
    ]
)
"""Functions that are linear in one array, or in a sequence of them."""

_FUNCTIONS: dict[Any, Callable[..., Any]] = {
    np.where: _where,
    np.clip: _clip,
    np.full_like: _full_like,
    np.einsum: _multilinear(np.einsum),
    np.dot: _multilinear(np.dot),
    np.tensordot: _multilinear(np.tensordot),
    np.outer: _multilinear(np.outer),
    np.cross: _multilinear(np.cross),
}

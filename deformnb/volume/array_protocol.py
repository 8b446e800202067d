"""Array protocol of volumes and pictures: what NumPy sees of them, and which slices and results keep their place.

A volume stands for its voxels wherever NumPy computes. Slices leave a part of the grid, so that the result is a volume
again; a number in their place removes an axis, and an array without a place is left.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from deformnb.checks import is_same_array
from deformnb.errors import DeformError


class AbstractValues:
    """Object with an array of values that NumPy takes for it: ``np.asarray``, ``shape``, ``ndim`` and ``dtype``."""

    values: NDArray[Any]

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        """The values, for ``np.asarray``; not copied where their type may stay."""
        target = np.dtype(dtype) if dtype is not None else self.dtype
        if copy is False and target != self.dtype:
            raise ValueError(f"values of type {self.dtype} do not become {target} without a copy.")
        return np.array(self.values, dtype=target) if copy else np.asarray(self.values, dtype=target)

    def __bool__(self) -> bool:
        if self.dtype == np.bool_:  # as of "if volume == 3:", which would always be done
            raise DeformError("a volume of bool is neither true nor false; ask for np.any(volume) or np.all(volume).")
        return True

    def __contains__(self, value: Any) -> bool:
        return bool((self.values == value).any())

    def equals(self, other: object) -> bool:
        """True for another object with the same values (NaN equals NaN), place, name and so on; notes do not count."""
        return self is other or (
            isinstance(other, type(self)) and self.about() == other.about() and is_same_array(self.values, other.values)
        )

    def about(self) -> tuple[Any, ...]:
        """All that is compared but the values, which can be hashed."""
        names = (one.name for one in fields(self) if one.name not in ("values", "notes", "level"))  # type: ignore[arg-type]
        return (self.dtype, self.shape, *(getattr(self, name) for name in names))

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the array."""
        return self.values.shape

    @property
    def size(self) -> int:
        """Number of values."""
        return int(self.values.size)

    @property
    def ndim(self) -> int:
        """Number of axes of the array."""
        return self.values.ndim

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of the values."""
        return self.values.dtype


def full_slices(key: object, shape: tuple[int, ...]) -> tuple[slice, ...] | None:
    """The slices of every axis, with start, stop and step, of an index in brackets; None if it has anything else.

    Parameters
    ----------
    key : a slice, an ellipsis or a tuple of them.
    shape : of the array.

    Raises
    ------
    DeformError
        For a step below 1, which would reverse an axis or is 0, for slices that leave nothing, and for more slices than
        axes.

    Examples
    --------
    >>> full_slices((slice(2, None), ..., slice(None, None, 2)), (4, 5, 6))
    (slice(2, 4, 1), slice(0, 5, 1), slice(0, 6, 2))
    >>> full_slices((slice(2, None), 3), (4, 5, 6)) is None
    True
    """
    parts = key if isinstance(key, tuple) else (key,)
    if not all(isinstance(part, slice | EllipsisType) for part in parts):
        return None
    before = parts.index(...) if ... in parts else len(parts)
    given = [part for part in parts if isinstance(part, slice)]
    if len(given) > len(shape) or len(parts) - len(given) > 1:
        raise DeformError(f"an array of {len(shape)} axes takes as many slices, got {len(given)}.")
    rest = [slice(None)] * (len(shape) - len(given))
    every = [*given[:before], *rest, *given[before:]]
    return tuple(_full_slice(part, size) for part, size in zip(every, shape, strict=True))


def _full_slice(part: slice, size: int) -> slice:
    if part.step is not None and part.step < 1:
        raise DeformError(
            f"a slice of a volume has a step of 1 or more, got {part.step}, which would reverse an axis; "
            "np.asarray(volume)[::-1] reverses the array alone."
        )
    start, stop, step = part.indices(size)
    if stop <= start:
        raise DeformError(f"the slice {_written(part)} leaves no voxel of an axis of {size}.")
    return slice(start, stop, step)


def _written(part: slice) -> str:
    start, stop = ("" if end is None else str(end) for end in (part.start, part.stop))
    return f"{start}:{stop}" + ("" if part.step is None else f":{part.step}")


_ELEMENTWISE = frozenset(
    {
        *(np.around, np.clip, np.digitize, np.interp, np.isclose, np.isin, np.isneginf, np.isposinf, np.nan_to_num),
        *(np.real, np.real_if_close, np.round, np.select, np.sinc, np.where),
    }
)
_LIKE = frozenset({np.empty_like, np.full_like, np.ones_like, np.zeros_like})

KEEPS_PLACE = _ELEMENTWISE | _LIKE
"""Functions of NumPy, other than universal ones, whose result has a value for each voxel, in its place. Others may move
voxels (``np.flip``, ``np.roll``, ``np.sort``) even where the shape stays; their results are arrays."""


def with_values(given: Any) -> Any:
    """The same arguments with the values of volumes and pictures, read-only, in lists and dictionaries too.

    Examples
    --------
    >>> with_values([1, {"a": "b"}])
    [1, {'a': 'b'}]
    """
    if isinstance(given, AbstractValues):
        return _read_only(given.values)
    if isinstance(given, dict):
        return {name: with_values(one) for name, one in given.items()}
    return type(given)(with_values(one) for one in given) if type(given) in (list, tuple) else given


def volumes_in(given: Any) -> list[AbstractValues]:
    """The volumes and pictures among arguments, in their order."""
    if isinstance(given, AbstractValues):
        return [given]
    parts = given.values() if isinstance(given, dict) else given if isinstance(given, list | tuple) else ()
    return [found for one in parts for found in volumes_in(one)]


def call_on_values(ufunc: np.ufunc, method: str, inputs: Sequence[Any], options: dict[str, Any]) -> Any:
    """Result of a universal function of NumPy, with the values of volumes and pictures in their place.

    Raises
    ------
    DeformError
        If the result is to be written into one of them (``volume += 1``): they never change.
    """
    for one in volumes_in(options.get("out")):
        _refuse_change(one)
    if method == "at":  # which writes into the first one
        _refuse_change(inputs[0])
    return getattr(ufunc, method)(*with_values(tuple(inputs)), **with_values(options))


def call_without_change(func: Callable[..., Any], args: Sequence[Any], options: dict[str, Any]) -> Any:
    """Result of a function of NumPy with the values of volumes and pictures, which it cannot change.

    Raises
    ------
    DeformError
        If it is one that writes into an argument (``np.put``, ``np.copyto``), or is to write into one (``out``).
    """
    for one in volumes_in(options.get("out")):
        _refuse_change(one)
    try:
        return func(*with_values(tuple(args)), **with_values(options))
    except ValueError as error:
        if "read-only" in str(error) and args:
            _refuse_change(args[0])
        raise


def _refuse_change(given: Any) -> None:
    if isinstance(given, AbstractValues):
        raise DeformError("a volume is never changed in place: make another one, for example volume = volume + 1.")


def _read_only(values: NDArray[Any]) -> NDArray[Any]:
    view = values.view()
    view.flags.writeable = False
    return view

"""Checks of arguments: any type, any size and any text becomes an array, a number, a name or one sentence."""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deformnb.errors import DeformError, DeformWarning
from deformnb.words import translate

_PACKAGE = f"{Path(__file__).parent}{os.sep}"

LARGEST_COORDINATE = 1e15
"""Beyond this a coordinate squared loses all digits of its neighbours, and LAPACK routines were seen to hang on inf."""


SMALLEST_LENGTH = 1e-150
"""Below this the square of a length is no number any more."""


def shown_value(value: object) -> str:
    """A value for a message, cut to 60 characters; Python writes no whole number of more than 4300 digits.

    Examples
    --------
    >>> shown_value(10**5000)
    'a number of thousands of digits'
    """
    try:
        return " ".join(repr(value).split())[:60]  # an array has lines of its own
    except ValueError:
        return "a number of thousands of digits"


def real_array(value: object) -> NDArray[np.float64] | None:
    """The value as float64; None for texts, complex numbers, ragged lists and whole numbers that no float holds."""
    try:
        array = np.asarray(value)
        return None if array.dtype.kind in "SUcMm" else array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        return None


def is_finite(value: object) -> bool:
    """True for one real number that a float holds.

    Examples
    --------
    >>> is_finite(2), is_finite("2"), is_finite(10**400), is_finite([1.0])
    (True, False, False, False)
    """
    array = real_array(value) if value is not None else None
    return array is not None and array.ndim == 0 and bool(np.isfinite(array))


def finite_array(value: object, shape: tuple[int, ...], requirement: str) -> NDArray[np.float64]:
    """The value as finite float64 of a shape.

    Parameters
    ----------
    value : what somebody passed.
    shape : of the array.
    requirement : begins the message: "spacing must be three finite numbers (x, y, z)".

    Raises
    ------
    DeformError
        If it is anything else.
    """
    array = real_array(value)
    if array is None or array.shape != shape or not np.isfinite(array).all():
        raise DeformError(f"{requirement}, got {shown_value(value)}.")
    return array


def finite_number(value: object, wanted: str) -> float:
    """The value as one finite number.

    Parameters
    ----------
    wanted : begins the message: "height must be a positive length".

    Raises
    ------
    DeformError
        If it is anything else.
    """
    if not is_finite(value):
        raise DeformError(f"{wanted}, got {shown_value(value)}.")
    return float(np.asarray(value))


def one_of(name: object, names: Collection[str], what: str) -> str:
    """A name that must be one of ``names``.

    Raises
    ------
    DeformError
        If it is none of them, which are named then.

    Examples
    --------
    >>> one_of("mip", ("slice", "mip"), "projection")
    'mip'
    """
    if not isinstance(name, str) or name not in names:
        raise DeformError(f"unknown {what} {shown_value(name)}; choose one of {', '.join(names)}.")
    return name


def checked_window(window: object) -> tuple[float, float]:
    """A window of values, lowest and highest.

    Raises
    ------
    DeformError
        If it is not two finite numbers that rise.

    Examples
    --------
    >>> checked_window([0, 80])
    (0.0, 80.0)
    """
    low, high = finite_array(window, (2,), "a window must be two rising numbers").tolist()
    if not low < high:
        raise DeformError(f"a window must be two rising numbers, got {shown_value(window)}.")
    return low, high


_IS_REPORTED = ContextVar("is_reported", default=False)


@contextmanager
def notes_reported() -> Iterator[None]:
    """A context that shows the notes of results itself, as commands and widgets do: :func:`warn` does nothing in it."""
    token = _IS_REPORTED.set(True)
    try:
        yield
    finally:
        _IS_REPORTED.reset(token)


def warn(notes: Iterable[str]) -> None:
    """Issue each note once as a :class:`~deformnb.errors.DeformWarning`, in the language that was chosen.

    The line that it names is the one that called the package.
    """
    if _IS_REPORTED.get():
        return
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    for note in dict.fromkeys(notes):
        warnings.warn(translate(note), DeformWarning, stacklevel=level)

"""Checks of arguments: any type, any size and any text becomes an array, a number, a name or one sentence."""

from __future__ import annotations

import inspect
import math
import os
import types
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields
from functools import cache, partial, wraps
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from deformnb._packages import describe_missing
from deformnb.errors import DeformError, DeformWarning, MissingPackageError
from deformnb.words import translate

_PACKAGE = f"{Path(__file__).parent}{os.sep}"

LARGEST_COORDINATE = 1e15
"""Beyond this a coordinate squared loses all digits of its neighbours, and LAPACK routines were seen to hang on inf."""


SMALLEST_LENGTH = 1e-150
"""Below this the square of a length is no number any more."""


def short_value(value: object) -> str:
    """A value for a message, cut to 60 characters; Python writes no whole number of more than 4300 digits.

    Examples
    --------
    >>> short_value(10**5000)
    'a number of thousands of digits'
    """
    try:
        return " ".join(repr(value).split())[:60]  # an array's repr has several lines
    except ValueError:
        return "a number of thousands of digits"


def any_array(value: object) -> NDArray[Any]:
    """The value as an array of any type; a list that is none (ragged, of unlike things) as an array of one object.

    Examples
    --------
    >>> any_array([True, False]).dtype, any_array([1, [2]]).dtype
    (dtype('bool'), dtype('O'))
    """
    try:
        return np.asarray(value)
    except (TypeError, ValueError, OverflowError):
        return np.array(None)


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
    if type(value) is float:
        return math.isfinite(value)
    array = real_array(value) if value is not None else None
    return array is not None and array.ndim == 0 and bool(np.isfinite(array))


def finite_array(value: object, shape: tuple[int, ...], requirement: str) -> NDArray[np.float64]:
    """The value as finite float64 of a shape.

    Parameters
    ----------
    value : the argument that was passed.
    shape : of the array.
    requirement : begins the message: "spacing must be three finite numbers (x, y, z)".

    Raises
    ------
    DeformError
        If it is anything else.
    """
    array = real_array(value)
    if array is None or array.shape != shape or not np.isfinite(array).all():
        raise DeformError(f"{requirement}, got {short_value(value)}.")
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
        raise DeformError(f"{wanted}, got {short_value(value)}.")
    return float(np.asarray(value))


def check_choice(name: object, names: Collection[str], what: str) -> str:
    """A name that must be one of ``names``.

    Raises
    ------
    DeformError
        If it is none of them, which are named then.

    Examples
    --------
    >>> check_choice("mip", ("slice", "mip"), "projection")
    'mip'
    """
    if not isinstance(name, str) or name not in names:
        raise DeformError(f"unknown {what} {short_value(name)}; choose one of {', '.join(names)}.")
    return name


def check_window(window: object) -> tuple[float, float]:
    """A window of values, lowest and highest.

    Raises
    ------
    DeformError
        If it is not two finite numbers that rise.

    Examples
    --------
    >>> check_window([0, 80])
    (0.0, 80.0)
    """
    low, high = finite_array(window, (2,), "a window must be two rising numbers").tolist()
    if not low < high:
        raise DeformError(f"a window must be two rising numbers, got {short_value(window)}.")
    return low, high


_IS_REPORTED = ContextVar("is_reported", default=False)


@contextmanager
def report_notes() -> Iterator[None]:
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
    frame, level = inspect.currentframe(), 1
    while frame is not None and frame.f_back is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, level = frame.f_back, level + 1
    for note in dict.fromkeys(notes):
        warnings.warn(translate(note), DeformWarning, stacklevel=level)


def is_same_array(one: NDArray[Any] | None, other: NDArray[Any] | None) -> bool:
    """True for two arrays of one shape with the same values, where NaN equals NaN, and for None twice.

    Examples
    --------
    >>> is_same_array(np.array([1.0, np.nan]), np.array([1.0, np.nan])), is_same_array(np.ones(2), None)
    (True, False)
    """
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other, equal_nan=one.dtype.kind == "f" and other.dtype.kind == "f")


def check_fields(owner: Any, *names: str) -> None:
    """Check the fields of a frozen dataclass by their annotations, and put the plain Python value of each in its place.

    A number of NumPy becomes one of Python and a list a tuple; a number must be finite, a text is none, and neither
    "yes" nor 1 is a truth value. Arrays get the annotated type; their shape is not checked, nor are fields of Any.

    Parameters
    ----------
    owner : the dataclass, in its ``__post_init__``.
    names : of the fields to check; default is all.

    Raises
    ------
    DeformError
        Naming the field and its valid values.

    Examples
    --------
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class Switch:
    ...     is_on: bool
    ...     def __post_init__(self):
    ...         check_fields(self)
    >>> Switch("yes")
    Traceback (most recent call last):
    ...
    deformnb.errors.DeformError: is on of a Switch must be True or False, got 'yes'.
    """
    kind: Any = type(owner)
    for name, hint, conform in _checked_fields(kind):
        if names and name not in names:
            continue
        given = getattr(owner, name)
        value = conform(given)
        if value is _WRONG:
            called = kind.__name__
            article = "an" if called[0] in "AEIOU" else "a"
            raise DeformError(
                f"{name.replace('_', ' ')} of {article} {called} must be {_describe_hint(hint)}, "
                f"got {short_value(given)}."
            )
        if value is not given:
            object.__setattr__(owner, name, value)


Function = TypeVar("Function", bound=Callable[..., Any])


def check_arguments(function: Function) -> Function:
    """Check the arguments of a function by their annotations, as :func:`check_fields` does the fields of a dataclass.

    Checked are numbers, texts, truth values, and objects of this package; what has a grid counts as its grid.

    Examples
    --------
    >>> @check_arguments
    ... def double(number: float) -> float:
    ...     return 2 * number
    >>> double("2")
    Traceback (most recent call last):
    ...
    deformnb.errors.DeformError: number must be a finite number, got '2'.
    """

    @wraps(function)
    def call_checked(*args: Any, **kwargs: Any) -> Any:
        given: dict[Any, Any] = dict(enumerate(args)) | kwargs
        for position, name, hint, conform in _checked_arguments(function):
            at = position if position in given else name
            if at not in given:
                continue
            value = conform(given[at])
            if value is _WRONG:
                value = conform(getattr(given[at], "grid", None))
            if value is _WRONG:
                raise DeformError(
                    f"{name.replace('_', ' ')} must be {_describe_hint(hint)}, got {short_value(given[at])}."
                )
            given[at] = value
        ordered = [given.pop(k) for k in range(len(args))]
        return function(*ordered, **given)

    return call_checked  # type: ignore[return-value]


@cache
def _checked_arguments(function: Any) -> tuple[tuple[int | None, str, Any, _Conform], ...]:
    """The position, if it may have one, name, annotation and check of each argument that is checked."""
    hints, parameters = get_type_hints(function), signature(function).parameters.values()
    return tuple(
        (None if one.kind is one.KEYWORD_ONLY else position, one.name, hints[one.name], _conforming(hints[one.name]))
        for position, one in enumerate(parameters)
        if one.name in hints and _is_plain(hints[one.name])
    )


def _is_plain(hint: Any) -> bool:
    if get_origin(hint) in (Union, types.UnionType):
        return all(map(_is_plain, get_args(hint)))
    return (
        hint in _PLAIN
        or get_origin(hint) is Literal
        or (isinstance(hint, type) and hint.__module__.startswith("deformnb"))
    )


_WRONG: Any = object()

_Conform = Callable[[Any], Any]
"""The value as an annotation requires it, or :data:`_WRONG`."""


@cache
def _checked_fields(kind: type) -> tuple[tuple[str, Any, _Conform], ...]:
    hints = get_type_hints(kind)
    return tuple((one.name, hints[one.name], _conforming(hints[one.name])) for one in fields(kind))


@cache
def _conforming(hint: Any) -> _Conform:
    """The check of an annotation, which is read once; values of other kinds are returned unchanged."""
    origin, among = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        return partial(_conform_first, tuple(map(_conforming, among)))
    if origin is Literal:  # its owner names the words among which one may choose
        return _plain_text
    if origin is tuple:
        is_long = among[1:] == (...,)
        return partial(_conform_tuple, tuple(map(_conforming, among[: 1 if is_long else None])), is_long)
    if hint in _PLAIN:
        plain: _Conform = _PLAIN[hint]
        return plain
    if origin is np.ndarray:
        return partial(_conform_array, get_args(among[1])[0])
    kind = origin or hint
    if not isinstance(kind, type):
        return lambda value: value
    return lambda value: value if isinstance(value, kind) else _WRONG


def _conform_first(checks: tuple[_Conform, ...], value: Any) -> Any:
    for conform in checks:
        found = conform(value)
        if found is not _WRONG:
            return found
    return _WRONG


def _conform_array(kind: Any, value: Any) -> Any:
    """The value as an array of an annotated type; one of that type itself is not copied."""
    if isinstance(value, np.ndarray) and (kind is Any or value.dtype == kind):
        return value
    if kind is np.bool_:
        try:
            array = np.asarray(value)
        except (TypeError, ValueError):
            return _WRONG
        return array if array.dtype == np.bool_ or (array.size == 0 and array.dtype.kind in "fiu") else _WRONG
    real = None if kind is Any or isinstance(value, type) else real_array(value)
    return _WRONG if real is None else real.astype(kind, copy=False)


def _conform_tuple(checks: tuple[_Conform, ...], is_long: bool, value: Any) -> Any:
    is_same = isinstance(value, tuple)
    if not is_same and (isinstance(value, str | bytes | Mapping) or not isinstance(value, Iterable)):
        return _WRONG
    given = tuple(value)
    every = checks * len(given) if is_long else checks
    if len(given) != len(every):
        return _WRONG
    found = [conform(one) for one, conform in zip(given, every, strict=True)]
    for one, before in zip(found, given, strict=True):
        if one is _WRONG:
            return _WRONG
        is_same = is_same and one is before
    return value if is_same else tuple(found)


def _plain_number(value: Any) -> Any:
    if isinstance(value, bool | np.bool_ | str | bytes) or not is_finite(value):
        return _WRONG
    return value if type(value) in (int, float) else float(np.asarray(value))


def _plain_integer(value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        return _WRONG
    return value if type(value) is int else int(value)


def _plain_flag(value: Any) -> Any:
    return value if isinstance(value, bool) else bool(value) if isinstance(value, np.bool_) else _WRONG


def _plain_text(value: Any) -> Any:
    return (value if type(value) is str else str(value)) if isinstance(value, str) else _WRONG


_PLAIN: dict[Any, Any] = {
    bool: _plain_flag,
    int: _plain_integer,
    float: _plain_number,
    str: _plain_text,
    type(None): lambda value: None if value is None else _WRONG,
}

_WORDS = {bool: "True or False", int: "a whole number", float: "a finite number", str: "a text", type(None): "None"}
_SEVERAL = {bool: "truth values", int: "whole numbers", float: "finite numbers", str: "texts"}


def _describe_hint(hint: Any) -> str:
    origin, among = get_origin(hint), get_args(hint)
    if origin is np.ndarray:
        return "an array"
    if origin in (Union, types.UnionType):
        return " or ".join(dict.fromkeys(map(_describe_hint, among)))
    if origin is Literal:
        return _WORDS[str]
    if origin is tuple:
        count = "" if among[1:] == (...,) else f"{len(among)} "
        one = among[0]
        return f"{count}{_SEVERAL.get(one, 'lists of them' if get_origin(one) else f'of type {one.__name__}')}"
    return _WORDS.get(hint, f"a {(origin or hint).__name__}")


def optional_package(package: str) -> Any:
    """An optional package, imported now.

    Raises
    ------
    MissingPackageError
        With its name and the command that installs it, if it is not installed.
    """
    try:
        return import_module(package)
    except ImportError as error:
        raise MissingPackageError(describe_missing(package)) from error

"""Places of landmark files: their numbers, and landmarks that are missing, as each program writes them.

A landmark that was not found on a specimen is never a place. Programs write it as a word (NA, NaN, undefined), as
infinity, as an empty cell, as a number that the header names (NTS), or as -1 -1 (tpsDig). It is left out of both lists
of a pair, and counted in the notes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.io.files.errors import fail, printable
from deformnb.warping.points import Landmarks

_MISSING = frozenset(
    {
        "",
        "na",
        "n/a",
        "#n/a",
        "<na>",
        "nan",
        "none",
        "null",
        "nil",
        "undefined",
        "undef",
        "missing",
        "unset",
        "inf",
        "infinity",
        "\u221e",
        "?",
        ".",
        "*",
        "1.#ind",
        "1.#inf",
        "1.#qnan",
        "#num!",
        "#value!",
        "#nv",
    }
)
"""Words for a coordinate that is not there, without their sign."""

_NAMED = 8  # numbers of landmarks in a note


def is_missing(word: Any) -> bool:
    """Check for a word, or a number, that represents a missing coordinate.

    Examples
    --------
    >>> [is_missing(word) for word in ("NA", "-Infinity", None, math.nan, "0", "NB")]
    [True, True, True, True, False, False]
    """
    if word is None:
        return True
    if isinstance(word, float):
        return not math.isfinite(word)
    return isinstance(word, str) and word.strip().strip("\"'").lower().lstrip("+-") in _MISSING


def is_comment(line: str) -> bool:
    """Check for a line that begins with #, unless that is the #N/A of a spreadsheet."""
    words = line.split()
    return bool(words) and words[0].startswith("#") and not is_missing(words[0].split(",")[0])


def coordinates(path: Path, words: Sequence[Any], which: str, column: int | None = None) -> list[float]:
    """Numbers of words, NaN for those that represent none; VolumeFileError that names the place of any other.

    Parameters
    ----------
    which : origin of the words, such as "line 3".
    column : the number of the first word's column, from 1 on; without it no column is named.
    """
    return [
        math.nan
        if is_missing(word)
        else finite_number(path, word, which if column is None else f"{which}, column {column + k}")
        for k, word in enumerate(words)
    ]


def finite_number(path: Path, word: Any, where: str) -> float:
    """The finite number of a word; VolumeFileError with its place otherwise."""
    try:
        value = float(word)
    except (TypeError, ValueError, OverflowError):  # a whole number of 400 digits fits into no float
        what = "nothing" if word is None else repr(printable(word, 20))
        raise fail(path, f"{where}: {what} is given where a number is expected.") from None
    if not math.isfinite(value):
        raise fail(path, f"{where}: {printable(word, 20)} is not finite.")
    return value


def drop_missing(
    path: Path,
    moving: ArrayLike,
    fixed: ArrayLike | None = None,
    names: Sequence[str] = (),
    active: Sequence[bool] | None = None,
    notes: Sequence[str] = (),
    *,
    has_open: bool = False,
) -> Landmarks:
    """Landmarks without those that are missing, which a note counts.

    Parameters
    ----------
    moving, fixed : (n, dim), NaN where a landmark is missing.
    has_open : whether a fixed place may be open, as in BigWarp, where it is still to be set; a note counts these too.

    Raises
    ------
    VolumeFileError
        If none is left.
    """
    places = np.asarray(moving, dtype=np.float64)
    partners = None if fixed is None else np.asarray(fixed, dtype=np.float64)
    is_there = _complete(places)
    is_open = np.zeros_like(is_there) if partners is None else ~_complete(partners)
    is_left = is_there if has_open else is_there & ~is_open
    if not is_left.any():
        raise fail(
            path,
            "there is no landmark in it."
            if not len(places)
            else f"there is no landmark in it that has a place: all {len(places)} are missing.",
        )
    remarks = [*([] if is_left.all() else [_count_text(np.flatnonzero(~is_left) + 1, "missing and left out")]), *notes]
    if partners is not None:
        partners = np.where(is_open[:, None], np.nan, partners)
    if is_open[is_left].any() and not is_open.all():
        remarks.append(_count_text(np.flatnonzero(is_open & is_left) + 1, "without a fixed place"))
    kept_names = tuple(name for name, on in zip(names, is_left.tolist(), strict=bool(names)) if on)
    return Landmarks(
        places[is_left],
        kept_names,
        None if partners is None else partners[is_left],
        None if active is None else np.asarray(active, dtype=bool)[is_left],
        tuple(remarks),
    )


def _complete(places: NDArray[np.float64]) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(places).all(axis=1))


def _count_text(numbers: NDArray[np.int64], what: str) -> str:
    """Such as "2 landmarks are missing and left out: 3, 7"."""
    named = ", ".join(map(str, numbers[:_NAMED].tolist())) + (", ..." if len(numbers) > _NAMED else "")
    count = "1 landmark is" if len(numbers) == 1 else f"{len(numbers)} landmarks are"
    return f"{count} {what}: {named}"

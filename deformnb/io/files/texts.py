"""Text of files: its decoding and the numbers of header fields, for readers of landmarks, tables and headers."""

from __future__ import annotations

import codecs
import re
from pathlib import Path

from deformnb.io.files.errors import fail, printable

_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)

LONGEST_TABLE = 2**20
"""Characters of a pasted table that are read at most."""

WESTERN = "its text is not UTF-8 and was read as Windows-1252 (Western European)"
"""The note on a file of older programs, whose letters beyond ASCII may be others."""


def decode_text(path: Path, data: bytes) -> tuple[str, tuple[str, ...]]:
    r"""The text of a file's bytes with ``\n`` at the ends of lines, and a note where the encoding was a guess.

    A byte order mark names UTF-8, UTF-16 or UTF-32; without one the text is UTF-8, and any other text is Windows-1252.

    Raises
    ------
    VolumeFileError
        If the bytes are no text in any of these.

    Examples
    --------
    >>> decode_text(Path("a.csv"), "\u00d6se".encode("utf-16")) == ("\u00d6se", ())
    True
    >>> decode_text(Path("a.csv"), "\u00d6se".encode("cp1252"))[1] == (WESTERN,)
    True
    """
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            try:
                return _lines(data[len(mark) :].decode(encoding)), ()
            except UnicodeDecodeError:
                raise fail(
                    path,
                    f"its first bytes mark it as {encoding[:6].rstrip('-').upper()} text, and what "
                    "follows is none; it is damaged.",
                ) from None
    if b"\0" in data:
        raise fail(path, "it is no text: it has bytes of value zero.")
    for encoding, notes in (("utf-8", ()), ("cp1252", (WESTERN,))):
        try:
            return _lines(data.decode(encoding)), notes
        except UnicodeDecodeError:
            continue
    raise fail(path, "its text is neither UTF-8 nor Windows-1252; save it as UTF-8.")


def _lines(text: str) -> str:
    text = text.replace("\r\n", "\n")
    return text.replace("\r", " " if "\n" in text else "\n")  # within a line Slicer leaves some of other programs


_INTEGER = re.compile(r"[+-]?[0-9]{1,19}")


def integers(path: Path, field: str, text: str, count: int | None = None) -> list[int]:
    """The whole numbers of a header's field; of any size, never wrapped."""
    words = text.split()
    if (count is not None and len(words) != count) or len(words) > 100 or not all(map(_INTEGER.fullmatch, words)):
        expected = "whole numbers" if count is None else f"{count} whole number{'s' * (count != 1)}"
        raise fail(path, f"the field '{field}' should be {expected} but is '{printable(text)}'.")
    return [int(word) for word in words]


def floats(path: Path, field: str, text: str, count: int | None = None) -> list[float]:
    """The numbers of a header's field; NaN and infinity are for the caller to refuse."""
    words = text.split()
    try:
        numbers = [float(word) for word in words[:100]]
    except ValueError:
        numbers = []
    if len(numbers) != (len(words) if count is None else count):
        expected = "numbers" if count is None else f"{count} number{'s' * (count != 1)}"
        raise fail(path, f"the field '{field}' should be {expected} but is '{printable(text)}'.")
    return numbers

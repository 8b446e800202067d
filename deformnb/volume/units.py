"""Units of length: the one table by which files, other packages and everything that is shown name them.

A grid, a set of landmarks and a document have the symbol of their unit, such as "mm" or "µm"; the empty text means that
it is not known. Numbers stay in the unit in which they came; what meets in two units is converted by :func:`ratio`. The
names are those of UDUNITS, which OME-Zarr and CF use, the symbols those of OME-XML.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from deformnb.checks import short_value
from deformnb.errors import DeformError


@dataclass(frozen=True)
class Unit:
    """A unit of length.

    Parameters
    ----------
    symbol : short, shown to people and stored by grids.
    name : of UDUNITS.
    metres : exactly.
    aliases : other ways in which files write it; plurals and British spellings follow from the name.
    """

    symbol: str
    name: str
    metres: Fraction
    aliases: tuple[str, ...] = ()

    @property
    def words(self) -> tuple[str, ...]:
        """Every way to write it."""
        plural = {"foot": "feet", "inch": "inches"}.get(self.name, f"{self.name}s")
        words = (self.symbol, self.name, plural, *self.aliases)
        return words + tuple(word.replace("meter", "metre") for word in words if word.endswith(("meter", "meters")))


_PREFIXES = {
    "yotta": ("Y", 24),
    "zetta": ("Z", 21),
    "exa": ("E", 18),
    "peta": ("P", 15),
    "tera": ("T", 12),
    "giga": ("G", 9),
    "mega": ("M", 6),
    "kilo": ("k", 3),
    "hecto": ("h", 2),
    "": ("", 0),
    "deci": ("d", -1),
    "centi": ("c", -2),
    "milli": ("m", -3),
    "micro": ("\u00b5", -6),
    "nano": ("n", -9),
    "pico": ("p", -12),
    "femto": ("f", -15),
    "atto": ("a", -18),
    "zepto": ("z", -21),
    "yocto": ("y", -24),
}

# A micro sign is U+00B5 or the Greek letter. Where it is one byte of Latin-1 in a text that is read as UTF-8 it
# becomes U+FFFD, and no other symbol has a letter that could.
_ALIASES = {"micro": ("um", "\u03bcm", "\ufffdm", "\u00c2\u00b5m", "micron", "microns", "mcm")}

_FOOT = Fraction(3048, 10000)
_ROWS = (
    *(
        Unit(f"{letter}m", f"{prefix}meter", Fraction(10) ** power, _ALIASES.get(prefix, ()))
        for prefix, (letter, power) in _PREFIXES.items()
    ),
    Unit("\u00c5", "angstrom", Fraction(1, 10**10), ("\u212b", "A", "ang")),
    Unit("in", "inch", _FOOT / 12, ('"',)),
    Unit("ft", "foot", _FOOT),
    Unit("yd", "yard", 3 * _FOOT),
    Unit("mi", "mile", 5280 * _FOOT),
    Unit("pc", "parsec", Fraction(30856775814913673)),
)

UNITS: dict[str, Unit] = {unit.symbol: unit for unit in _ROWS}
"""All units of length by their symbols."""

UNIT_METRES = {unit.symbol: float(unit.metres) for unit in _ROWS}
"""Length of each in metres."""

UNIT_WORDS = {word: unit.symbol for unit in _ROWS for word in unit.words}
"""The symbol of each way to write a unit; capitals count in short ones: Mm are megametres."""

UNIT_LOWER_WORDS = {
    word.lower(): symbol
    for word, symbol in reversed(UNIT_WORDS.items())
    if len(word) > 2 or word in ("mm", "cm", "um", "nm")
}
"""The same of those whose capitals do not count."""

NO_UNITS = (
    "",
    "pixel",
    "pixels",
    "px",
    "voxel",
    "voxels",
    "vx",
    "unknown",
    "none",
    "null",
    "?",
    "arbitrary",
    "reference frame",
    "referenceframe",
    "unitless",
    "dimensionless",
    "index",
)
"""Words of programs without units: the elements of pictures, or a space without a scale."""


def find_unit(text: object) -> str | None:
    r"""The symbol of a unit as a file names it; "" for words that mean none, None for anything else.

    Examples
    --------
    >>> find_unit("micron") == find_unit(r"\u00B5m") == find_unit("um") == "µm"
    True
    >>> find_unit("pixel"), find_unit("furlong")
    ('', None)
    """
    if not isinstance(text, str):
        return None
    word = re.sub(r"\\u([0-9a-fA-F]{4})", lambda found: chr(int(found[1], 16)), text).strip()
    if len(word) > 1:
        word = word.strip("\"'").strip()
    if word.lower() in NO_UNITS:
        return ""
    return UNIT_WORDS.get(word) or UNIT_LOWER_WORDS.get(word.lower())


def check_unit(text: object) -> str:
    """The symbol of a unit; "" for none.

    Raises
    ------
    DeformError
        If it is no unit of length.

    Examples
    --------
    >>> check_unit("millimeter")
    'mm'
    """
    found = find_unit(text)
    if found is None:
        raise DeformError(
            f"{short_value(text)} is no unit of length; known are {', '.join(UNITS)} and their names, "
            'and "" where it is not known.'
        )
    return found


def parse_unit(text: object) -> tuple[str, tuple[str, ...]]:
    """The unit that a file states, and a note where that is none that is known.

    Examples
    --------
    >>> parse_unit("mm")
    ('mm', ())
    """
    found = find_unit(text)
    if found is not None:
        return found, ()
    return "", (f"the file gives lengths in {short_value(text)}, which is no known unit; its numbers stay as they are",)


def ratio(unit: str, to: str) -> float:
    """Factor that converts lengths from one unit to another; 1 where either is not known.

    Examples
    --------
    >>> ratio("mm", "µm"), ratio("", "mm")
    (1000.0, 1.0)
    """
    return float(UNITS[unit].metres / UNITS[to].metres) if unit and to else 1.0


def common_unit(units: Sequence[str]) -> tuple[str, tuple[float, ...], tuple[str, ...]]:
    """The unit for axes x, y, z that have one each, by how much the numbers of each are multiplied, and a note.

    It is that of x, or where that is not known of the first axis whose unit is known; an axis without one is taken to
    have the same.

    Examples
    --------
    >>> common_unit(("µm", "µm", "mm"))[:2]
    ('µm', (1.0, 1.0, 1000.0))
    """
    known = [unit for unit in units if unit]
    unit = known[0] if known else ""
    factors = tuple(ratio(one, unit) for one in units)
    if len(set(units)) < 2:
        return unit, factors, ()
    each = ", ".join(
        f"{axis} in {one}" if one else f"{axis} without a unit" for axis, one in zip("xyz", units, strict=False)
    )
    return unit, factors, (f"the axes of the file are measured in different units ({each}); all are in {unit} now",)

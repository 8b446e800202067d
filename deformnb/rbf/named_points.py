"""Access to points by name, position, slice or mask, and their tables, for control points and landmarks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from typing import Any, Generic, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import short_value
from deformnb.errors import DeformError

One = TypeVar("One")

AXIS_NAMES = {2: ("a", "b"), 3: ("x", "y", "z")}
"""Names of the coordinates of a point in columns of tables, on a picture and in space."""


class AbstractNamedItems(ABC):
    """Items with names, of which brackets give one: ``"bend" in deformation``, ``step in deformation``."""

    @abstractmethod
    def __iter__(self) -> Iterator[Any]:
        """The items."""

    def __contains__(self, given: object) -> bool:
        return any(given == (item.name if isinstance(given, str) else item) for item in self)


class AbstractNamedPoints(AbstractNamedItems, Generic[One]):
    """Points with names: ``points["head"]`` and ``points[0]`` are one, several are ``points[["head", "tail"]]``,
    ``points[1:3]`` and ``points[mask]``.
    """

    names: tuple[str, ...]

    @abstractmethod
    def point_at(self, position: int) -> One:
        """The point at a position from 0 on."""

    @abstractmethod
    def take(self, positions: Iterable[int]) -> Self:
        """The points at these positions, in this order."""

    def position_of(self, name: str) -> int:
        """Position of the only point with a name.

        Raises
        ------
        DeformError
            If none has it, or several have; their positions are named.
        """
        count = self.names.count(name)
        if not name:
            raise DeformError("an empty text names no point; take one by its position: points[0].")
        if count > 1:
            places = ", ".join(str(k) for k, one in enumerate(self.names) if one == name)
            raise DeformError(
                f"{count} points have the name {short_value(name)}; take one by its position, which are {places}."
            )
        if not count:
            names = ", ".join(map(short_value, dict.fromkeys(one for one in self.names[:60] if one))) or "no names"
            raise DeformError(f"there is no point of the name {short_value(name)}; there are {names}.")
        return self.names.index(name)

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str):
            return self.point_at(self.position_of(key))
        if isinstance(key, list | tuple) and any(isinstance(one, str) for one in key):
            key = [self.position_of(one) if isinstance(one, str) else one for one in key]
        positions = np.arange(len(self.names))[key]
        if np.ndim(positions) > 1:
            raise DeformError(f"points are one list, and {short_value(key)} asks for {np.ndim(positions)} axes.")
        return self.point_at(int(positions)) if np.ndim(positions) == 0 else self.take(positions.tolist())

    def __iter__(self) -> Iterator[One]:
        return map(self.point_at, range(len(self.names)))

    def __contains__(self, given: Any) -> bool:
        """True for the name of a point, and for a point that is equal to one."""
        if isinstance(given, str):
            return bool(given) and given in self.names
        return any(np.array_equal(given, one) if isinstance(one, np.ndarray) else given == one for one in self)


def check_table(given: Any, table_of: str) -> Any:
    """The table itself, if it is a ``pandas.DataFrame``; DeformError for anything else."""
    if not all(hasattr(given, name) for name in ("columns", "index", "attrs", "to_numpy")):
        raise DeformError(f"{table_of} are read from a pandas.DataFrame, got {short_value(given)}.")
    return given


def names_of(table: Any) -> list[str] | None:
    """The column "name" of a table; a missing name is empty, and None where there is no such column."""
    if "name" not in table:
        return None
    return ["" if missing else str(one) for one, missing in zip(table["name"], table["name"].isna(), strict=True)]


def read_columns(table: Any, prefix: str, table_of: str) -> NDArray[np.float64] | None:
    """The coordinates (N, 2) or (N, 3) in the columns of a table with a prefix; None where it has none of them.

    Raises
    ------
    DeformError
        If the values are no numbers, or a coordinate is missing.
    """
    for names in reversed(AXIS_NAMES.values()):
        wanted = [prefix + name for name in names]
        have = [name for name in wanted if name in table.columns]
        if have and len(have) < len(wanted):
            missing = next(name for name in wanted if name not in have)
            raise DeformError(f"the table of {table_of} has no column {missing!r}, only {', '.join(have)}.")
        if have:
            try:
                return np.asarray(table[wanted].to_numpy(dtype=np.float64))
            except (TypeError, ValueError) as error:
                raise DeformError(f"the columns {', '.join(have)} of a table of {table_of} are no numbers.") from error
    return None

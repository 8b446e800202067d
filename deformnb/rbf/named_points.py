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


class AbstractNamedPoints(ABC, Generic[One]):
    """Points with names: ``points["head"]`` and ``points[0]`` are one, ``points[1:3]`` and ``points[mask]`` several."""

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
            If none has it, or several have.
        """
        count = self.names.count(name)
        if count != 1 or not name:
            names = ", ".join(map(short_value, dict.fromkeys(one for one in self.names[:60] if one))) or "no names"
            why = f"there are {count} points" if count else "there is no point"
            raise DeformError(f"{why} of the name {short_value(name)}; there are {names}.")
        return self.names.index(name)

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, str):
            return self.point_at(self.position_of(key))
        positions = np.arange(len(self.names))[key]
        return self.point_at(int(positions)) if np.ndim(positions) == 0 else self.take(positions.tolist())

    def __iter__(self) -> Iterator[One]:
        return map(self.point_at, range(len(self.names)))

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and name in self.names


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

"""The rows that the benchmarks judge: their names, which stay, and the goal of each as a ratio to plain C."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from benchmarks.c_loops import COMPILERS

# The goals of fits and edits were set in milliseconds on a machine (AMD Zen 3 with AVX2, one thread) on which plain C
# took so long for a general warp of 256^3: in the run of the fits, and in that of the edits.
_FITS, _EDITS = 84.0, 79.0


def digits(number: float) -> str:
    """Three digits, or all before the point.

    Examples
    --------
    >>> digits(0.01234), digits(1234.5)
    ('0.0123', '1234')
    """
    return f"{number:.0f}" if number >= 1000 else f"{number:.3g}"


@dataclass(frozen=True)
class Goal:
    """The most that a row may take.

    Parameters
    ----------
    most : a ratio, or an amount in the unit of the row.
    peer : the loop in C whose time is multiplied; empty for an amount.
    unit : of the row.
    voxels : of a row whose time of one voxel is told too.

    Examples
    --------
    >>> print(Goal(1.15))
    <= 1.15 x C
    >>> print(Goal(500, peer=""))
    <= 500 ms
    """

    most: float
    peer: str = "C"
    unit: str = "ms"
    voxels: int = 0

    def __str__(self) -> str:
        return f"<= {digits(self.most)} {f'x {self.peer}' if self.peer else self.unit}"

    def amount(self, own: float) -> str:
        """A number of the row with its unit.

        Examples
        --------
        >>> Goal(1.15, voxels=10**6).amount(5.0)
        '5 ms (5 ns a voxel)'
        """
        return f"{digits(own)} {self.unit}" + (f" ({1e6 * own / self.voxels:.2g} ns a voxel)" if self.voxels else "")

    def limit(self, times: Mapping[str, float]) -> float | None:
        """The most by the times of a run, those of the faster one of the compilers; None without any.

        Examples
        --------
        >>> Goal(1.5).limit({"C, gcc": 5.0, "C, clang": 3.0})
        4.5
        """
        if not self.peer:
            return self.most
        found = [times[name] for compiler in COMPILERS if (name := f"{self.peer}, {compiler}") in times]
        return self.most * min(found) if found else None


GENERAL = "C general"
"""The general warp, its field given: what the goals of fits and edits are measured by."""

PREPARED = "C prepared"
"""A replicated map whose axis is last in memory."""

ROWS: dict[str, Goal] = {
    "replicated along z, prepared": Goal(1.15, PREPARED),
    "replicated along y, prepared": Goal(1.15, PREPARED),
    "replicated along x, prepared": Goal(1.15, PREPARED),
    "replicated along z, in place": Goal(3.0, PREPARED),
    "replicated along y, in place": Goal(3.0, PREPARED),
    "replicated along x, in place": Goal(3.0, PREPARED),
    "modulated along z": Goal(1.0),
    "general, field given": Goal(1.15, voxels=256**3),
    "general, 32 points, a node every 4 voxels": Goal(1.15),
    "general, field given, float32": Goal(1.15),
    "general, field given, 512^3": Goal(1.15, voxels=512**3),
    "solve and map of 32 points": Goal(1.2 / _FITS, GENERAL),
    "solve and map of 128 points of wide support": Goal(8 / _FITS, GENERAL),
    "solve 512 points": Goal(2.5 / _FITS, GENERAL),
    "solve and map of 512 points": Goal(5.1 / _FITS, GENERAL),
    "solve and map of 2048 points": Goal(21 / _FITS, GENERAL),
    "drag one of 512 points": Goal(0.6 / _FITS, GENERAL),
    "drag one of 2048 points": Goal(2 / _FITS, GENERAL),
    "drag one of 512 points and map": Goal(4 / _FITS, GENERAL),
    "drag one of 2048 points and map": Goal(12.5 / _FITS, GENERAL),
    "edit on a picture": Goal(1.5),
    "edit in space, a node every 4 voxels": Goal(1.15, GENERAL),
    "edit in space, every voxel": Goal(250 / _EDITS, GENERAL),
    "edit near a cut": Goal(18 / _EDITS, GENERAL),
    "edit near a modulated cut": Goal(70 / _EDITS, GENERAL),
    "edit near a rigid part on a picture": Goal(9 / _EDITS, GENERAL),
    "edit near a rigid part in space": Goal(95 / _EDITS, GENERAL),
    "two planes": Goal(1.5, GENERAL),
    "two planes, one with a cut": Goal(1.5, GENERAL),
    "16 stages": Goal(1.5, GENERAL),
    "first volume, points on a picture": Goal(500, ""),
    "first volume, points in space": Goal(500, ""),
    "five changes of resolution, crop or points: compilation": Goal(50, ""),
    "deformnb warp of a carp, nothing cached": Goal(3000, ""),
    "two threads, replicated": Goal(1.0, unit="x one thread"),
    "two threads, modulated": Goal(1.0, unit="x one thread"),
    "two threads, general": Goal(1.0, unit="x one thread"),
    "peak memory of 512^3, points on a picture": Goal(1.05, "", "x the input"),
    "peak memory of 512^3, points in space": Goal(1.05, "", "x the input"),
}
"""Every row of the table, in its order.

Times are least milliseconds of the processor, of 256^3 voxels uint8 where a row does not name another size or type;
those of two threads are shares of the time of one."""

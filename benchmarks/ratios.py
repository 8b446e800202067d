"""The ratios of a run to its fastest peers, stored from run to run, and those that have become worse.

Ratios within one run can be compared from day to day where milliseconds cannot, on one kind of machine: the file stores
the ratios of each separately.
"""

from __future__ import annotations

import json
import statistics
from collections.abc import Mapping
from pathlib import Path

PEERS = ("C loop", "numba loop")
"""Peers whose ratios are stored: the others are far behind, and change with their versions."""

_KEPT = 30  # runs

# A ratio is compared with the median of so many runs before those that are judged.
_USUAL = 7

_AT_ONCE, _THREE_TIMES = 1.35, 1.2

Ratios = Mapping[str, float]
"""By "group | case / peer"."""


def worse(before: list[Ratios], now: Ratios) -> list[str]:
    """Ratios that are 35 % above the usual, or 20 % for the third time in a row; empty if there are none.

    Parameters
    ----------
    before : the ratios of earlier runs, oldest first.

    Examples
    --------
    >>> usual = [{"warp / C loop": 1.0}] * 5
    >>> worse(usual, {"warp / C loop": 1.4})
    ['warp / C loop: 1.4, was 1 (40 % worse)']
    >>> worse(usual, {"warp / C loop": 1.25})
    []
    >>> worse([*usual, *[{"warp / C loop": 1.25}] * 2], {"warp / C loop": 1.22})
    ['warp / C loop: 1.22, was 1 (22 % worse, as in the two runs before)']
    """
    found = []
    for name, ratio in now.items():
        past = [run[name] for run in before if name in run]
        last, older = past[-2:], past[:-2][-_USUAL:]
        if older and len(last) == 2 and min(*last, ratio) > _THREE_TIMES * (usual := statistics.median(older)):
            when = ", as in the two runs before"
        elif past and ratio > _AT_ONCE * (usual := statistics.median(past[-_USUAL:])):
            when = ""
        else:
            continue
        found.append(f"{name}: {ratio:.3g}, was {usual:.3g} ({100 * (ratio / usual - 1):.0f} % worse{when})")
    return found


def compare(file: Path, machine: str, now: Ratios) -> list[str]:
    """Ratios that are worse than in the runs of this machine in the file; this run is added to them.

    Raises
    ------
    SystemExit
        If the file holds something else.
    """
    try:
        runs: dict[str, list[Ratios]] = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
        before = list(runs.get(machine, []))
        found = worse(before, now)
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise SystemExit(f"{file} is no file of ratios ({error}); move it away, or name another one.") from None
    runs[machine] = [*before, now][-_KEPT:]
    file.write_text(json.dumps(runs, indent=1) + "\n", encoding="utf-8")
    return found

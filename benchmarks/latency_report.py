"""The report of ``python -m benchmarks latency``: a table for each size, and each target with whether it is met."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

from benchmarks.latency_cells import RIVALS

TARGETS = {"Editor + LiveView": 100.0, "Editor + VolumeView": 400.0}
"""Milliseconds from an edit to new pixels that a view shall not exceed, with OpenGL in software."""

SILENT = "Editor + LiveView"
"""The view that needs no byte while a point of a picture is dragged."""

_TIMES_FASTER = 3.0
_HZ = 30.0
_LEAST_LAG = 250.0  # milliseconds that the last picture of a drag may come later than that of a short one, or ...
_GROWTH = {"kernel": 16.0, "page": 4.0}  # MiB over all edits: more than a collection leaves, less than pictures need

Results = dict[str, dict[str, Any]]


def median(result: dict[str, Any], what: str = "edit_ms") -> float:
    """Median of the times of a view."""
    return statistics.median(result[what])


def _faster(result: dict[str, Any], rival: dict[str, Any]) -> float:
    """Ratios of the rival's latency to ours, until the pixels come; medians of one run."""
    return median(rival) / median(result)


# ---- the table -------------------------------------------------------------------------------------------------------

_COLUMNS: dict[str, Callable[[dict[str, Any]], str]] = {
    "edit to pixels, median ms": lambda r: f"{median(r):.0f}",
    "worst": lambda r: f"{max(r['edit_ms']):.0f}",
    "picture of the editor, ms": lambda r: f"{median(r, 'picture_ms'):.0f}",
    "full picture, ms": lambda r: f"{median(r, 'whole_ms'):.0f}",
    "kB per edit, up + down": lambda r: f"{r['bytes_up'] / 1e3:.1f} + {r['bytes_down'] / 1e3:.1f}",
    "of the view": lambda r: f"{r['bytes_view'] / 1e3:.1f}" if "picture_ms" in r else "",
    "drag, view Hz": lambda r: f"{_longest(r)['view_hz']:.1f}",
    "picture and grid Hz": lambda r: (
        f"{_longest(r)['picture_hz']:.0f} and {_longest(r)['grid_hz']:.0f}" if "picture_ms" in r else ""
    ),
    "of inputs Hz": lambda r: f"{_longest(r)['inputs_hz']:.0f}",
    "last picture after a short / long drag, ms": lambda r: " / ".join(
        f"{r[d]['catch_up_ms']:.0f}" for d in ("short_drag", "long_drag") if d in r
    ),
    "kernel MiB, growth": lambda r: f"{r['memory_mib']['kernel']:.0f}, {r['memory_mib']['kernel_growth']:+.1f}",
    "page MiB, growth": lambda r: f"{r['memory_mib']['page']:.0f}, {r['memory_mib']['page_growth']:+.1f}",
}


def _longest(result: dict[str, Any]) -> dict[str, float]:
    drag: dict[str, float] = result["long_drag" if "long_drag" in result else "short_drag"]
    return drag


def table(size: int, results: Results) -> str:
    """All figures of one size, and what failed."""
    rivals = [name for name in RIVALS if name in results]
    columns = {**_COLUMNS, **{f"times faster than {name}": _compare_with(results[name]) for name in rivals}}
    lines = [f"### {size} x {size} x {size}\n", f"| view | {' | '.join(columns)} |", f"|---{'|---' * len(columns)}|"]
    for name, result in results.items():
        lines.append(f"| {name} | {' | '.join(_cell(make, result) for make in columns.values())} |")
    notes = [f"- {name} failed. {result['failed']}" for name, result in results.items() if "failed" in result]
    return "\n".join([*lines, "", *notes, ""])


def _compare_with(rival: dict[str, Any]) -> Callable[[dict[str, Any]], str]:
    return lambda r: f"{_faster(r, rival):.1f}" if r is not rival else ""


def _cell(make: Callable[[dict[str, Any]], str], result: dict[str, Any]) -> str:
    try:
        return make(result)
    except (KeyError, statistics.StatisticsError):  # it failed before that was measured, or was not requested
        return ""


# ---- targets ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Verdict:
    """A target and whether it is met; what could not be measured is not.

    Parameters
    ----------
    what : view and target; found : the measured value, or an empty text.
    """

    what: str
    found: str
    is_met: bool

    def __str__(self) -> str:
        return f"- {self.what}: {self.found or 'not measured'}: {'met' if self.is_met else 'MISSED'}"


def verdicts(results: Results) -> list[Verdict]:
    """Each target of each view that was requested."""
    return [verdict for name in TARGETS if name in results for verdict in _view_verdicts(name, results)]


def _view_verdicts(name: str, results: Results) -> Iterator[Verdict]:
    result, limit = results[name], TARGETS[name]
    checks: list[tuple[str, Callable[[], tuple[str, bool]]]] = [
        (f"edit to pixels within {limit:.0f} ms", partial(_time, result, limit)),
        *(
            (f"{_TIMES_FASTER:.0f} times faster than {rival}", partial(_ratio, result, results[rival]))
            for rival in RIVALS
            if rival in results
        ),
        *((f"{part} at {_HZ:.0f} Hz in a drag", partial(_rate, result, part)) for part in ("picture", "grid")),
        ("no lag that grows in a long drag", partial(_lag, result)),
        *(
            (f"memory of the {where} within {most:.0f} MiB over all edits", partial(_growth, result, where, most))
            for where, most in _GROWTH.items()
        ),
    ]
    if name == SILENT:
        checks.append(("no byte of the view in a drag", partial(_bytes, result)))
    for what, find in checks:
        try:
            found, is_met = find()
        except (KeyError, statistics.StatisticsError):
            found, is_met = "", False
        yield Verdict(f"{name}: {what}", found, is_met)


def _time(result: dict[str, Any], limit: float) -> tuple[str, bool]:
    return f"{median(result):.0f} ms", median(result) <= limit


def _ratio(result: dict[str, Any], rival: dict[str, Any]) -> tuple[str, bool]:
    return f"{_faster(result, rival):.1f} times", _faster(result, rival) >= _TIMES_FASTER


def _rate(result: dict[str, Any], part: str) -> tuple[str, bool]:
    hz = result["long_drag"][f"{part}_hz"]
    return f"{hz:.0f} Hz", hz >= _HZ


def _lag(result: dict[str, Any]) -> tuple[str, bool]:
    """Delay of the last picture after a long drag; one that has just begun may come in between."""
    short, long = result["short_drag"]["catch_up_ms"], result["long_drag"]["catch_up_ms"]
    return f"last picture after {short:.0f} and {long:.0f} ms", long - short <= max(_LEAST_LAG, median(result))


def _growth(result: dict[str, Any], where: str, most: float) -> tuple[str, bool]:
    growth = result["memory_mib"][f"{where}_growth"]
    return f"{growth:+.1f} MiB", growth <= most


def _bytes(result: dict[str, Any]) -> tuple[str, bool]:
    count = result["long_drag"]["view_bytes"]
    return f"{count} bytes", count == 0

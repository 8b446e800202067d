"""Interleaved timing: on a busy machine only cases that were run side by side can be compared."""

from __future__ import annotations

import ctypes
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Case:
    """One way to do a job.

    run : does it and returns the result.
    error : differences of the result from the right one, as an array; None where there is nothing to compare with.
    ours : whether this package does it; the first of ours in a group is what the others are compared with.
    row : its name in :data:`benchmarks.goals.ROWS`; empty where it has none.
    times : how often a call does the job; times are of one.
    """

    name: str
    run: Callable[[], Any]
    error: Callable[[Any], Any] | None = None
    ours: bool = False
    row: str = ""
    times: int = 1


@dataclass(frozen=True)
class Group:
    """Ways to do the same job. A result that differs by more than ``tolerance`` (of ``unit``) stops the run."""

    name: str
    cases: list[Case]
    tolerance: float
    unit: str


@dataclass(frozen=True)
class Measured:
    """Seconds of every round, and those of the processor; peak memory over the inputs in bytes, differences from the
    right result, and the share of a result that differs from that of the first case."""

    case: Case
    seconds: list[float]
    processor: list[float]
    peak: int | None
    largest: float
    mean: float
    other: float

    @property
    def median(self) -> float:
        return statistics.median(self.seconds)

    def least(self, *, one_thread: bool) -> float:
        """The least seconds; of one thread those of the processor, which other load of the machine changes least."""
        return min(self.processor if one_thread else self.seconds)


# A case leaves the rounds when it has taken this long in all, and three times at least.
_BUDGET = 20.0


def measure(group: Group, rounds: int) -> list[Measured]:
    """Check every case, then run all of them in turns."""
    first = group.cases[0].run()
    checked = [(case, *_check(group, case, first)) for case in group.cases]
    del first
    times: dict[str, list[float]] = {case.name: [] for case in group.cases}
    processor: dict[str, list[float]] = {case.name: [] for case in group.cases}
    for k in range(rounds):
        first = k % len(group.cases)  # no case always follows the one that leaves the caches cold
        for case in group.cases[first:] + group.cases[:first]:
            taken = times[case.name]
            if len(taken) >= 3 and case.times * sum(taken) > _BUDGET:
                continue
            start, work = time.perf_counter(), time.process_time()
            case.run()
            taken.append((time.perf_counter() - start) / case.times)
            processor[case.name].append((time.process_time() - work) / case.times)
    return [Measured(case, times[case.name], processor[case.name], *found) for case, *found in checked]


def _check(group: Group, case: Case, first: Any) -> tuple[int | None, float, float, float]:
    """Peak memory, the largest and the mean error, and the share that differs from the first result."""
    warm = case.run()  # compiles, fills caches
    peak, result = peak_memory(case.run)  # while the first result is held, so that its memory is not taken again
    del warm
    if case.error is None:
        return peak, float("nan"), float("nan"), float("nan")
    difference = np.abs(case.error(result))
    largest = float(difference.max())
    if not largest <= group.tolerance:
        expected = f"up to {group.tolerance:g} expected"
        raise SystemExit(f"{group.name}: {case.name} is wrong by {largest:g} {group.unit} ({expected})")
    is_like = isinstance(result, np.ndarray) and result.dtype == first.dtype and result.shape == first.shape
    other = float(np.mean(result != first)) if is_like else float("nan")
    return peak, largest, float(difference.mean()), other


def peak_memory(run: Callable[[], Any]) -> tuple[int | None, Any]:
    """Rise of the process's memory above its level before the call, result included; Linux only."""
    if not sys.platform.startswith("linux"):
        return None, run()
    ctypes.CDLL(None).malloc_trim(0)  # memory freed by earlier calls must not hide that of this one
    Path("/proc/self/clear_refs").write_text("5", encoding="utf-8")
    before = _status("VmRSS")
    result = run()
    return max(0, _status("VmHWM") - before), result


def _status(name: str) -> int:
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))

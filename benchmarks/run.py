"""Run the groups and print a report in Markdown."""

from __future__ import annotations

import os
import platform
from argparse import Namespace
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from benchmarks import bench_edits, bench_maps, bench_quality, bench_rbf, bench_warp, c_loops, once, ratios
from benchmarks.c_loops import COMPILERS
from benchmarks.goals import ROWS, digits
from benchmarks.timing import Measured, measure
from deformnb.native import library

_LEGEND = """Median and least of interleaved rounds; ratio to the first row of each table; peak memory over the inputs,
result included; largest and mean difference from the right result; share of voxels that differ from the first row's.
C writes into a result that is there before, so it has no peak.
"""
_MODULES = {"R": bench_rbf, "W": bench_warp, "E": bench_edits, "M": bench_maps, "Q": bench_quality}
"""By the initial of their groups' names."""

_NUMBA = "numba loop"

_SUMMARY = """### Summary

Least times: of one thread those of the processor, which other load of the machine changes least. C is the loop that the
goal of a row names; a goal is met by the time of the faster compiler.

| | deformnb | C, gcc | C, clang | numba | best library | / gcc | / clang | goal | |
|---|---|---|---|---|---|---|---|---|---|"""
_PACKAGES = ("jax", "numpy", "scipy", "SimpleITK", "vtk", "scikit-image", "numba")


def run(options: Namespace) -> int:
    print(f"{ratios.vector_width()}, {machine()}; {options.threads or 'all'} thread(s); {datetime.now(UTC).date()}\n")
    print(", ".join([*_versions(), *c_loops.versions(), f"compiled loops: {library.level()}"]) + "\n")
    print(_LEGEND + (f"{c_loops.why_absent()}\n" if c_loops.why_absent() else ""), flush=True)
    summary: dict[str, str] = {}
    measured: dict[str, float] = {}
    for initial, module in _MODULES.items():
        if options.groups and all(part[:1] in "RWEMQFTPC" and part[:1] != initial for part in options.groups):
            continue  # their problems take long to make
        for group in module.groups(options):
            if not _is_asked(group.name, options):
                continue
            results = measure(group, options.rounds)
            print(f"### {group.name}\n\n| | ms | least | ratio | peak MiB | max ({group.unit}) | mean | differ |")
            print("|---|---|---|---|---|---|---|---|")
            for result in results:
                print(_row(result, results[0]))
            print(flush=True)
            times = {other.case.name: 1e3 * other.least(one_thread=options.threads == 1) for other in results}
            for result in (result for result in results if result.case.row):
                libraries = {
                    other.case.name: times[other.case.name]
                    for other in results
                    if not other.case.ours and other.case.name != _NUMBA and not other.case.name.startswith("C")
                }
                row, own = result.case.row, times[result.case.name]
                summary[row] = _line(row, own, times, libraries, options)
                measured |= _ratios(row, own, times)
    for name, measure_rows in once.measure(options):
        if _is_asked(name, options):
            for row, own, times in measure_rows():
                libraries = {name: time for name, time in times.items() if not name.startswith("C")}
                summary[row] = _line(row, own, times, libraries, options)
                measured |= _ratios(row, own, times)
    print("\n".join([_SUMMARY, *(summary[row] for row in ROWS if row in summary)]), flush=True)
    return 0 if options.ratios is None else _compare(measured, options)


def _is_asked(group: str, options: Namespace) -> bool:
    return not options.groups or any(part in group for part in options.groups)


def _compare(measured: dict[str, float], options: Namespace) -> int:
    """1 where a ratio has become worse."""
    if reason := ratios.why_not_stored():
        print(f"- not stored: {reason}")
        return 0
    settings = f"{machine()}; {options.threads} thread(s), {options.size} voxels, {options.dtype}"
    for line in (found := ratios.compare(options.ratios, ratios.vector_width(), settings, measured)):
        print(f"- WORSE: {line}")
    return 1 if found else 0


def _peers(row: str) -> dict[str, str]:
    """The names of a row's peers in the group, by their names in tables."""
    loop = ROWS[row].peer or "C"
    return {**{f"C, {compiler}": f"{loop}, {compiler}" for compiler in COMPILERS}, _NUMBA: _NUMBA}


def _ratios(row: str, own: float, times: Mapping[str, float]) -> dict[str, float]:
    """Ratios to the peers that are stored; libraries change too often. A row without peers has the share of its goal, a
    fifth at least: below that nothing is better or worse."""
    if not ROWS[row].peer:
        return {f"{row} / goal": max(own / ROWS[row].most, 0.2)}
    return {f"{row} / {name}": own / times[peer] for name, peer in _peers(row).items() if peer in times}


def _line(row: str, own: float, times: Mapping[str, float], libraries: Mapping[str, float], options: Namespace) -> str:
    """A row of the summary."""
    goal = ROWS[row]
    peers = {} if not goal.peer else {peer: times[peer] for peer in _peers(row).values() if peer in times}
    best = min(libraries, key=libraries.__getitem__, default=None)
    numbers = [digits(peers[peer]) if peer in peers else "" for peer in _peers(row).values()]
    shares = [share and f"{own / float(share):.3g}" for share in numbers[: len(COMPILERS)]]
    is_usual = (options.size, options.points, options.dtype) == (256, 32, "uint8")
    limit = goal.limit(times) if is_usual else None
    verdict = "" if limit is None else "met" if own <= limit else "MISSED"
    most = "" if limit is None or not goal.peer else f" = {digits(limit)}"
    cells = [row, goal.amount(own), *numbers, f"{best} {digits(libraries[best])}" if best else "", *shares]
    return f"| {' | '.join([*cells, f'{goal}{most}', verdict])} |"


def _row(result: Measured, first: Measured) -> str:
    name = f"**{result.case.name}**" if result.case.ours else result.case.name
    peak = "" if result.peak is None else f"{result.peak / 2**20:.0f}"
    least, ratio = min(result.seconds), result.median / first.median
    exact = [f"{error:.2g}" if error == error else "" for error in (result.largest, result.mean, result.other)]
    return f"| {name} | {1e3 * result.median:.3g} | {1e3 * least:.3g} | {ratio:.3g} | {peak} | {' | '.join(exact)} |"


def machine() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    where = f"{platform.system()} {platform.machine()}, Python {platform.python_version()}"
    return f"{names[0] if names else platform.processor()}, {os.cpu_count()} processors, {where}"


def _versions() -> list[str]:
    found = []
    for package in _PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"{package} absent")
    return found

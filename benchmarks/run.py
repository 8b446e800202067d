"""Run the groups and print a report in Markdown."""

from __future__ import annotations

import os
import platform
from argparse import Namespace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from benchmarks import bench_edits, bench_maps, bench_quality, bench_rbf, bench_warp, c_loops, ratios
from benchmarks.timing import Measured, measure

_LEGEND = """Median and least of interleaved rounds; ratio to the first row of each table; peak memory over the inputs,
result included; largest and mean difference from the right result.
"""
_MODULES = {"R": bench_rbf, "W": bench_warp, "E": bench_edits, "M": bench_maps, "Q": bench_quality}
"""By the initial of their groups' names."""

_SUMMARY = """### Summary

Milliseconds and ratios are those of the least times; of one thread: of the processor, which other load of the machine
changes least.

| | ms | C | numba | best library | / C | / numba |
|---|---|---|---|---|---|---|"""
_PACKAGES = ("jax", "numpy", "scipy", "SimpleITK", "vtk", "scikit-image", "numba")


def run(options: Namespace) -> int:
    print(f"{machine()}; {options.threads or 'all'} thread(s)\n")
    print(", ".join(_versions()) + "\n")
    print(_LEGEND + (f"{c_loops.why_absent()}\n" if c_loops.why_absent() else ""), flush=True)
    summary, measured = [_SUMMARY], dict[str, float]()
    for initial, module in _MODULES.items():
        if options.groups and all(part[:1] in _MODULES and part[:1] != initial for part in options.groups):
            continue  # their problems take long to make
        for group in module.groups(options):
            if options.groups and not any(part in group.name for part in options.groups):
                continue
            results = measure(group, options.rounds)
            print(f"### {group.name}\n\n| | ms | least | ratio | peak MiB | max ({group.unit}) | mean |")
            print("|---|---|---|---|---|---|---|")
            for result in results:
                print(_row(result, results[0]))
            print(flush=True)
            for result in filter(lambda result: result.case.ours, results):
                one_thread = options.threads == 1
                summary.append(_line(group.name, result, results, one_thread=one_thread))
                ratio_of = _ratios_to_loops(result, results, one_thread=one_thread)
                measured |= {f"{group.name} | {result.case.name} / {peer}": ratio for peer, ratio in ratio_of.items()}
    print("\n".join(summary), flush=True)
    if options.ratios is None:
        return 0
    settings = f"{machine()}; {options.threads} thread(s), {options.size} voxels, {options.dtype}"
    for line in (found := ratios.compare(options.ratios, settings, measured)):
        print(f"- WORSE: {line}")
    return 1 if found else 0


def _least(measured: Measured, *, one_thread: bool) -> float:
    return min(measured.processor if one_thread else measured.seconds)


def _ratios_to_loops(result: Measured, results: list[Measured], *, one_thread: bool) -> dict[str, float]:
    """Ratios of the time of one of our cases to the loops."""
    own = _least(result, one_thread=one_thread)
    return {
        other.case.name: own / _least(other, one_thread=one_thread)
        for other in results
        if other.case.name in ratios.PEERS
    }


def _line(group: str, result: Measured, results: list[Measured], *, one_thread: bool) -> str:
    """A row of the summary."""
    least = {other.case.name: 1e3 * _least(other, one_thread=one_thread) for other in results}
    times = [f"{least[peer]:.3g}" if peer in least else "-" for peer in ratios.PEERS]
    rest = [other.case.name for other in results if not other.case.ours and other.case.name not in ratios.PEERS]
    best = min(rest, key=least.__getitem__, default=None)
    library = f"{best} {least[best]:.3g}" if best else "-"
    own = least[result.case.name]
    shares = [f"{own / least[peer]:.2f}" if peer in least else "-" for peer in ratios.PEERS]
    cells = [f"{group.partition(',')[0]}: {result.case.name}", f"{own:.3g}", *times, library, *shares]
    return f"| {' | '.join(cells)} |"


def _row(result: Measured, first: Measured) -> str:
    name = f"**{result.case.name}**" if result.case.ours else result.case.name
    peak = "" if result.peak is None else f"{result.peak / 2**20:.0f}"
    least, ratio = min(result.seconds), result.median / first.median
    exact = "| |" if result.largest != result.largest else f"{result.largest:.2g} | {result.mean:.2g} |"
    return f"| {name} | {1e3 * result.median:.3g} | {1e3 * least:.3g} | {ratio:.3g} | {peak} | {exact}"


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

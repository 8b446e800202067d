"""Runs the groups and prints a report in Markdown."""

from __future__ import annotations

import os
import platform
from argparse import Namespace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from benchmarks import bench_edits, bench_maps, bench_quality, bench_rbf, bench_warp
from benchmarks.timing import Measured, measure

_LEGEND = """Median and least of interleaved rounds; ratio to the first row of each table; peak memory over the inputs,
result included; largest and mean difference from the right result.
"""
_PACKAGES = ("jax", "numpy", "scipy", "SimpleITK", "vtk", "scikit-image", "numba")


def run(options: Namespace) -> int:
    print(f"{machine()}; {options.threads or 'all'} thread(s)\n")
    print(", ".join(_versions()) + "\n")
    print(_LEGEND, flush=True)
    for module in (bench_rbf, bench_warp, bench_edits, bench_maps, bench_quality):
        for group in module.groups(options):
            if options.groups and not any(part in group.name for part in options.groups):
                continue
            results = measure(group, options.rounds)
            print(f"### {group.name}\n\n| | ms | least | ratio | peak MiB | max ({group.unit}) | mean |")
            print("|---|---|---|---|---|---|---|")
            for result in results:
                print(_row(result, results[0]))
            print(flush=True)
    return 0


def _row(result: Measured, first: Measured) -> str:
    name = f"**{result.case.name}**" if result.case.ours else result.case.name
    peak = "" if result.peak is None else f"{result.peak / 2**20:.0f}"
    least, ratio = min(result.seconds), result.median / first.median
    exact = "| |" if result.largest != result.largest else f"{result.largest:.2g} | {result.mean:.2g} |"
    return f"| {name} | {1e3 * result.median:.3g} | {1e3 * least:.3g} | {ratio:.3g} | {peak} | {exact}"


def machine() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
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

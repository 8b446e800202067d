"""Rows that are measured in processes of their own: F1 first volumes and compilation, T1 two threads, P1 peak memory,
C1 the command ``deformnb warp``.

``python -m benchmarks.once first picture FOLDER`` prints JSON, with an empty folder for caches; so do
``threads ROUNDS`` and ``memory``.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
import zlib
from argparse import Namespace
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from deformnb.io.files.streams import LEVEL
from deformnb.volume.plane import Raster

ROOT = Path(__file__).resolve().parents[1]

Judged = tuple[str, float, dict[str, float]]
"""The name of a row, our number, and those of the peers by their names."""

_KINDS = ("replicated", "modulated", "general")
"""Warps that are measured on two threads."""


def measure(options: Namespace) -> Iterator[tuple[str, Callable[[], list[Judged]]]]:
    """Names of groups, and functions that measure their rows."""
    yield "F1: first volumes, nothing cached on the disk", _first
    if hasattr(os, "sched_setaffinity") and (os.cpu_count() or 1) > 1 and shutil.which("taskset"):
        yield "T1: two threads", lambda: _threads(options.rounds)
    if sys.platform.startswith("linux"):
        yield "P1: peak memory", _memory
    yield "C1: command", _command


def _in_process(*arguments: str, processors: int | None = None) -> Any:
    """The JSON that this module prints in a process of its own, with so many processors or with those of this one."""
    command = [sys.executable, "-m", "benchmarks.once", *arguments]
    environment = dict(os.environ)
    if processors:
        command = ["taskset", "-c", f"0-{processors - 1}", *command]
        environment |= {name: str(processors) for name in environment if name.endswith("NUM_THREADS")}
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(command)} failed:\n{done.stderr.strip()}")
    return json.loads(done.stdout.splitlines()[-1])


def _first() -> list[Judged]:
    found = {}
    for kind in ("picture", "space", "changes"):
        with tempfile.TemporaryDirectory() as folder:
            found[kind] = _in_process("first", kind, folder)
    return [
        ("first volume, points on a picture", found["picture"], {}),
        ("first volume, points in space", found["space"], {}),
        ("five changes of resolution, crop or points: compilation", found["changes"], {}),
    ]


def _threads(rounds: int) -> list[Judged]:
    """The share of the time of one thread that two take, least of two processes each, which take turns."""
    runs: dict[int, list[dict[str, float]]] = {1: [], 2: []}
    for _ in range(2):
        for count, times in runs.items():
            times.append(_in_process("threads", str(rounds), processors=count))
    least = {count: {name: min(run[name] for run in times) for name in times[0]} for count, times in runs.items()}
    share = {name: least[2][name] / least[1][name] for name in least[1]}
    return [
        (
            f"two threads, {kind}",
            share[f"{kind} deformnb"],
            {name.removeprefix(f"{kind} "): one for name, one in share.items() if name.startswith(f"{kind} C")},
        )
        for kind in _KINDS
    ]


def _memory() -> list[Judged]:
    return [(f"peak memory of 512^3, {kind}", share, {}) for kind, share in _in_process("memory").items()]


def _command() -> list[Judged]:
    """A carp of 256 x 512 x 256 voxels, compressed before and after; the peer packs and unpacks the same files."""
    import numpy as np

    import deformnb as dn
    from benchmarks import problem

    carp = dn.datasets.PHANTOMS["fish"].make().values
    for axis in range(3):
        carp = np.repeat(carp, 2, axis)
    volume = dn.Volume(carp, dn.Grid(carp.shape))
    points = problem.control_points(16, 2, 256)
    with tempfile.TemporaryDirectory() as folder:
        source, result, session = (Path(folder) / name for name in ("in.nii.gz", "out.nii.gz", "bend.json"))
        dn.write_volume(volume, source)
        dn.write_deformation(dn.Deformation.from_picture_points(volume.grid, "+z", points), session)
        command = [sys.executable, "-m", "deformnb", "warp", str(session), str(source), str(result)]
        before = _seconds_of_children()
        subprocess.run(command, check=True, capture_output=True, env=dict(os.environ, XDG_CACHE_HOME=folder))
        own = _seconds_of_children() - before
        start = time.process_time()
        zlib.decompress(source.read_bytes(), wbits=47)
        zlib.compress(zlib.decompress(result.read_bytes(), wbits=47), LEVEL)
        packing = time.process_time() - start
    return [("deformnb warp of a carp, nothing cached", 1e3 * own, {"gzip alone": 1e3 * packing})]


def _seconds_of_children() -> float:
    """Of the processor, of processes that have ended."""
    times = os.times()
    return times.children_user + times.children_system


def first(kind: str, folder: str) -> float:
    """Milliseconds of the processor from the imports to the first volume; or those of compilation, of five changes."""
    os.environ["XDG_CACHE_HOME"] = os.environ["LOCALAPPDATA"] = folder
    import jax
    import numpy as np
    import scipy.spatial  # noqa: F401 (what a fit imports)

    import deformnb as dn
    from benchmarks import bench_edits, problem
    from deformnb.warping.warper import Warper

    compiled: list[float] = []

    def hear(event: str, duration: float, **_: Any) -> None:
        if event.startswith("/jax/core/compile/"):
            compiled.append(1e3 * duration)

    jax.monitoring.register_event_duration_secs_listener(hear)

    def edit(volume: dn.Volume, count: int, kind: str) -> None:
        size = volume.shape[0]
        flat, solid = (problem.control_points(count, dim, size) for dim in (2, 3))
        plane = dn.Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        step = dn.Step((flat,), plane) if kind == "picture" else dn.Step((solid,))
        Warper(volume, step=1 if kind == "picture" else bench_edits.STEP)(step.field(volume.grid))

    volume = problem.volume(256, "uint8")
    if kind != "changes":
        start = time.process_time()
        edit(volume, 32, kind)
        return 1e3 * (time.process_time() - start)
    edit(volume, 32, "picture")
    edit(volume, 32, "space")
    before = len(compiled)
    half = np.ascontiguousarray(volume.values[::2, ::2, ::2])
    crop = np.ascontiguousarray(volume.values[20:220, 30:220, 10:250])
    for values, count in ((half, 32), (crop, 32), (crop, 33), (volume.values, 45), (half, 60)):
        for view in ("picture", "space"):
            edit(dn.Volume(values, dn.Grid(values.shape)), count, view)
    return sum(compiled[before:])


def threads(rounds: str) -> dict[str, float]:
    """Least milliseconds on the clock of three warps, ours and those in C, on the processors of this process."""
    import numpy as np

    import deformnb as dn
    from benchmarks import c_loops, problem
    from benchmarks.timing import Case, Group
    from benchmarks.timing import measure as measure_group
    from deformnb.rbf.extrusion import extrude, modulate, replicate
    from deformnb.rbf.fields import DisplacementField
    from deformnb.warping.warper import Warper

    size = 256
    volume, plane = problem.volume(size, "uint8"), dn.Plane((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    flat, solid = (
        dn.fit_rbf(problem.control_points(32, dim, size), support=problem.SUPPORT * (size - 1)) for dim in (2, 3)
    )
    stored = DisplacementField.sample(flat, Raster((size, size), (1.0, 1.0), (0.0, 0.0)))
    column, row = np.moveaxis(stored.values, -1, 0)
    given = DisplacementField.sample(solid, volume.grid)
    components, weights = c_loops.components(given.values), np.sin(np.pi * np.linspace(0, 1, size))
    fields = {
        "replicated": extrude(plane, volume.grid, [stored], replicate()),
        "modulated": extrude(plane, volume.grid, [stored], modulate("sin(pi*z)")),
        "general": given,
    }
    loops: dict[str, Callable[[c_loops.Loops], c_loops.Run]] = {
        "replicated": lambda loops: c_loops.rows(loops, volume.values, row, column, 0.0, 0),
        "modulated": lambda loops: c_loops.modulated(loops, volume.values, row, column, weights, 0.0),
        "general": lambda loops: c_loops.general(loops, volume.values, components, 0.0),
    }
    warper = Warper(volume, fill=0.0)
    warper.prepare(0)
    found = {}
    for kind in _KINDS:
        cases = [Case("deformnb", lambda kind=kind: warper(fields[kind]).values), *c_loops.cases("uint8", loops[kind])]
        for result in measure_group(Group(kind, cases, 0, ""), int(rounds)):
            found[f"{kind} {result.case.name}"] = 1e3 * min(result.seconds)
    return found


def memory() -> dict[str, float]:
    """Peaks of warps of 512^3 voxels, results included, as shares of the input."""
    import numpy as np

    import deformnb as dn
    from benchmarks import problem
    from benchmarks.timing import peak_memory

    n = 512
    values = np.empty((n, n, n), np.uint8)
    values[...] = np.arange(n, dtype=np.uint8)[:, None, None]
    volume = dn.Volume(values, dn.Grid(values.shape))
    flat = dn.Deformation.from_picture_points(volume.grid, "+z", problem.control_points(32, 2, n))
    solid = dn.fit_rbf(problem.control_points(32, 3, n))
    shares = {}
    for kind, field, step in (("points on a picture", flat, 1), ("points in space", solid, 4)):
        dn.warp(volume, field, step=step)
        peak, _ = peak_memory(lambda field=field, step=step: dn.warp(volume, field, step=step))
        shares[kind] = (peak or 0) / values.nbytes
    return shares


if __name__ == "__main__":
    command: Callable[..., Any] = {"first": first, "threads": threads, "memory": memory}[sys.argv[1]]
    print(json.dumps(command(*sys.argv[2:])))

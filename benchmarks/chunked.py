"""Volumes larger than memory: speed and memory of the chunked warp, compared with scipy over the same blocks.

``python -m benchmarks chunked --size 512``. The source is made on the fly in Zarr. Both are given the field: samples on
a coarse lattice in space, or on the picture's plane for a replicated map; both read the source block by block,
deform it and write the result to Zarr. They are interleaved, and medians are printed. "cpu" is processor time, to be
compared on a busy machine. Memory is the resident memory of this process and all of its children together; the
seconds in which JAX compiled are part of the time and also stated separately.

``--workers`` measures instead how much two workers of dask with one thread each gain over one, compared with two
processes of plain C over one, each process on a separate processor; and how much processor time two take for the same
work as one, to be compared on a busy machine.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks chunked", description=__doc__)
    parser.add_argument("--size", type=int, default=512, help="edge of the volume in voxels (default 512)")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)), help="default: all processors")
    parser.add_argument("--memory", default="1 GB", help='of all blocks in work (default "1 GB")')
    parser.add_argument("--fields", nargs="*", default=["replicated", "general"])
    parser.add_argument("--without-scipy", action="store_true", help="measure this package alone")
    parser.add_argument("--rounds", type=int, default=1, help="turns of each (default 1)")
    parser.add_argument(
        "--workers", action="store_true", help="the gain of two workers, compared with two processes of C"
    )
    options = parser.parse_args(arguments)
    folder = Path(tempfile.mkdtemp(prefix="chunked-"))
    try:
        (_run_workers if options.workers else _run)(folder, options)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return 0


def _run(folder: Path, options: argparse.Namespace) -> None:
    import jax

    from deformnb import chunked
    from deformnb.io.volumes import ome_zarr
    from deformnb.volume.volume import Grid

    n, block = options.size, ome_zarr.CHUNK_SHAPE
    source = _make_source(folder / "source.zarr", n)
    compiling: list[float] = []
    jax.monitoring.register_event_duration_secs_listener(
        lambda event, seconds, **_: compiling.append(seconds) if event.startswith("/jax/core/compile/") else None
    )
    print(f"{n}^3 uint8, blocks {block}, {options.threads} threads, load {os.getloadavg()[0]:.1f}")
    for name in options.fields:
        field = _field(name, Grid((n, n, n)))
        cases: dict[str, Callable[[], Any]] = {
            "deformnb": partial(
                chunked.warp,
                source,
                field,
                folder / "ours.zarr",
                fill=0,
                levels=1,
                workers=options.threads,
                memory=options.memory,
                overwrite=True,
            )
        }
        if not options.without_scipy:
            cases["scipy"] = partial(_scipy_warp, source, field, name, folder / "scipy.zarr", n, block, options.threads)
        compiling.clear()
        times = _interleave(cases, options.rounds)
        for case, (wall, cpu, peak) in times.items():
            print(
                f"{name:11} {case:9}{n**3 / wall / 1e6:8.1f} Mvoxel/s  {cpu / n**3 * 1e9:6.1f} ns cpu/voxel  "
                f"peak {peak / 1e9:.2f} GB"
            )
        print(f"{'':11} compiled for {sum(compiling) / options.rounds:.1f} s a round", end="")
        if not options.without_scipy:
            _compare(folder, n)
            (wall, cpu, _), (wall_scipy, cpu_scipy, _) = times["deformnb"], times["scipy"]
            print(f"; scipy takes {wall_scipy / wall:.1f} times as long, {cpu_scipy / cpu:.1f} times the cpu", end="")
        print(flush=True)


def _interleave(
    cases: dict[str, Callable[[], Any]],
    rounds: int,
    processor: Callable[[str], float] = lambda _name: time.process_time(),
) -> dict[str, tuple[float, float, int]]:
    """Medians of seconds and of processor seconds, by a clock for each case, and the largest memory of each."""
    measured: dict[str, list[tuple[float, float, int]]] = {name: [] for name in cases}
    for _ in range(rounds):
        for name, run in cases.items():
            with _PeakMemory() as peak:
                start, cpu = time.perf_counter(), processor(name)
                run()
                taken = time.perf_counter() - start, processor(name) - cpu
            measured[name].append((*taken, peak.bytes))
    return {
        name: (statistics.median(r[0] for r in rows), statistics.median(r[1] for r in rows), max(r[2] for r in rows))
        for name, rows in measured.items()
    }


def _run_workers(folder: Path, options: argparse.Namespace) -> None:
    from distributed import Client, LocalCluster

    from deformnb import chunked
    from deformnb.volume.volume import Grid

    n, processors = options.size, sorted(os.sched_getaffinity(0))[:2]
    if len(processors) < 2:
        raise SystemExit("two workers need two processors.")
    source, loops = _make_source(folder / "source.zarr", n), _compiled_loops(folder)
    for name in options.fields:
        field, rounds = _field(name, Grid((n, n, n))), {"replicated": 300, "general": 20}[name]
        with ExitStack() as stack:
            cases: dict[str, Callable[[], Any]] = {}
            clients = {}
            for count in (1, 2):
                cluster = stack.enter_context(
                    LocalCluster(n_workers=count, threads_per_worker=1, dashboard_address=":0")
                )
                client = clients[f"deformnb {count}"] = stack.enter_context(Client(cluster))
                client.wait_for_workers(count)
                for worker, processor in zip(client.scheduler_info()["workers"], processors, strict=False):
                    client.run(_pin, processor, workers=[worker])
                cases[f"deformnb {count}"] = partial(
                    chunked.warp,
                    source,
                    field,
                    folder / f"{count}.zarr",
                    fill=0,
                    levels=1,
                    memory=options.memory,
                    overwrite=True,
                    client=client,
                )
                cases[f"C {count}"] = partial(
                    _run_processes, [str(loops), name, "256", str(rounds)], processors[:count]
                )
            for count in (1, 2):
                cases[f"deformnb {count}"]()  # compiles
            times = _interleave(cases, options.rounds, partial(_processor_seconds, clients))
        more = {
            name: times[f"{name} 2"][1] / times[f"{name} 1"][1] / (2 if name == "C" else 1)
            for name in ("deformnb", "C")
        }
        one, two = (n**3 / times[f"deformnb {count}"][0] / 1e6 for count in (1, 2))
        gain_of_c = 2 * times["C 1"][0] / times["C 2"][0]
        print(
            f"{name:11} {n}^3: one worker {one:.1f}, two workers {two:.1f} Mvoxel/s, gain {two / one:.2f}; two "
            f"processes of C gain {gain_of_c:.2f}; peak of all processes, both clusters included "
            f"{times['deformnb 2'][2] / 1e9:.2f} GB; processor time of the same work in two for one: "
            f"{more['deformnb']:.2f}, in C {more['C']:.2f}; load {os.getloadavg()[0]:.1f}",
            flush=True,
        )


def _processor_seconds(clients: dict[str, Any], name: str) -> float:
    """Of the workers of a cluster and of this process, or of the processes that have ended."""
    if name in clients:
        return time.process_time() + sum(clients[name].run(time.process_time).values())
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    return ended.ru_utime + ended.ru_stime


def _pin(processor: int) -> None:
    """Run in a worker before JAX starts there: its pool of threads has as many as the process has processors."""
    for thread in Path("/proc/self/task").iterdir():
        os.sched_setaffinity(int(thread.name), {processor})


def _compiled_loops(folder: Path) -> Path:
    program = folder / "loops"
    source = Path(__file__).with_name("chunked_loops.c")
    subprocess.run(["cc", "-O3", "-march=native", "-o", program, source, "-lm"], check=True)
    return program


def _run_processes(command: list[str], processors: list[int]) -> None:
    running = [subprocess.Popen(command, stdout=subprocess.DEVNULL) for _ in processors]
    for process, processor in zip(running, processors, strict=True):
        os.sched_setaffinity(process.pid, {processor})
    if any(process.wait() for process in running):
        raise SystemExit("the program in C failed")


def _make_source(path: Path, n: int) -> Path:
    from deformnb.io.volumes import ome_zarr
    from deformnb.volume.volume import Grid

    (array,) = ome_zarr.create_pyramid(path, [Grid((n, n, n))], np.dtype(np.uint8))
    rng, y = np.random.default_rng(0), np.arange(n)[:, None]
    noise = rng.integers(0, 16, (64, n, n), np.uint8)
    for z in range(0, n, 64):
        shape = 90 + 80 * np.sin(y / 40 + z / 90) * np.cos(np.arange(n) / 31)
        array[z : z + 64] = noise[: n - z] + shape.astype(np.uint8)
    return path


def _field(name: str, grid: Any) -> Any:
    """The field as samples, so that no case evaluates radial functions."""
    from deformnb import ControlPoints, Deformation
    from deformnb.rbf import DisplacementField
    from deformnb.rbf.extrusion import extrude, replicate
    from deformnb.volume.plane import Plane, Raster

    n, rng = grid.shape[0], np.random.default_rng(1)
    dim = 2 if name == "replicated" else 3
    fixed = rng.uniform(0, n, (16, dim))
    points = ControlPoints.from_arrays(fixed, fixed + rng.normal(0, n / 40, fixed.shape))
    if name == "replicated":
        plane = Plane.from_view(grid, "+z")
        document = Deformation.from_picture_points(grid, plane, points)
        samples = DisplacementField.sample(document.field(grid).maps[0], Raster((n, n), (1.0, 1.0), (0.0, 0.0)))
        return extrude(plane, grid, [samples], replicate())
    return DisplacementField.sample(Deformation.from_space_points(points), grid.resampled(shape=(65, 65, 65)))


def _scipy_warp(
    source: Path, field: Any, name: str, target: Path, n: int, block: tuple[int, int, int], threads: int
) -> None:
    """The same job as its users write it: map_coordinates on blocks of dask, each with its part of the source."""
    import dask
    import zarr
    from scipy import ndimage

    read = zarr.open_group(str(source), mode="r")["0"]
    shutil.rmtree(target, ignore_errors=True)
    written = zarr.create_array(str(target), shape=read.shape, dtype=read.dtype, chunks=block)
    samples = field.maps[0].values if name == "replicated" else field.values
    lattice = None if name == "replicated" else field.lattice

    def work(start: tuple[int, int, int]) -> None:
        stop = [min(s + b, n) for s, b in zip(start, block, strict=True)]
        at = [np.arange(a, b, dtype=np.float32) for a, b in zip(start, stop, strict=True)]
        if lattice is None:
            d = samples[start[1] : stop[1], start[2] : stop[2]]
            move = [np.float32(0), d[None, ..., 1], d[None, ..., 0]]
        else:
            lines = [lattice.point_to_index(np.stack([a, a, a], axis=-1))[:, 2 - k] for k, a in enumerate(at)]
            d = samples
            for axis, line in enumerate(lines):  # linear, one axis after the other: the quickest way in NumPy
                place = np.clip(line, 0, samples.shape[axis] - 1)
                low = np.minimum(place.astype(int), samples.shape[axis] - 2)
                t = (place - low).astype(np.float32).reshape([-1 if k == axis else 1 for k in range(4)])
                d = d.take(low, axis) * (1 - t) + d.take(low + 1, axis) * t
            move = [d[..., 2], d[..., 1], d[..., 0]]
        places = np.stack(
            np.broadcast_arrays(
                *(a.reshape([-1 if k == axis else 1 for k in range(3)]) + move[axis] for axis, a in enumerate(at))
            )
        )
        first = [max(0, int(np.floor(p.min())) - 1) for p in places]
        last = [min(n, int(np.ceil(p.max())) + 2) for p in places]
        part = read[tuple(slice(a, max(b, a + 1)) for a, b in zip(first, last, strict=True))]
        places -= np.array(first, np.float32)[:, None, None, None]
        done = ndimage.map_coordinates(part, places, order=1, mode="grid-constant")
        written[tuple(slice(a, b) for a, b in zip(start, stop, strict=True))] = done

    starts = [(z, y, x) for z in range(0, n, block[0]) for y in range(0, n, block[1]) for x in range(0, n, block[2])]
    dask.compute(*(dask.delayed(work)(start) for start in starts), scheduler="threads", num_workers=threads)


def _compare(folder: Path, n: int) -> None:
    import zarr

    ours = zarr.open_group(str(folder / "ours.zarr"), mode="r")["0"]
    theirs = zarr.open_array(str(folder / "scipy.zarr"))
    inner = slice(n // 4, n // 4 + 64)
    difference = np.abs(ours[inner, inner, inner].astype(int) - theirs[inner, inner, inner])
    if difference.max() > 1:
        raise SystemExit(f"the two results differ by {difference.max()}")


class _PeakMemory:
    """The largest resident memory of this process and its children, sampled every few hundredths of a second."""

    def __enter__(self) -> _PeakMemory:
        self.bytes, self._stop = 0, threading.Event()
        self._thread = threading.Thread(target=self._sample)
        self._thread.start()
        return self

    def _sample(self) -> None:
        while not self._stop.wait(0.02):
            self.bytes = max(self.bytes, _resident(os.getpid()))

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._thread.join()


def _resident(process: int) -> int:
    try:
        own = int(Path(f"/proc/{process}/statm").read_text(encoding="utf-8").split()[1]) * resource.getpagesize()
        children = [
            child
            for thread in Path(f"/proc/{process}/task").iterdir()
            for child in (thread / "children").read_text(encoding="utf-8").split()
        ]
    except (OSError, IndexError):
        return 0
    return own + sum(_resident(int(child)) for child in children)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""Volumes larger than memory: voxels per second and memory of the chunked warp, beside scipy over the same blocks.

``python -m benchmarks chunked --size 512``. The source is made on the fly in Zarr. Both are given the field: samples
a coarse lattice in space, or on the picture's plane for a replicated map; both read the source block by block,
deform it and write the result to Zarr. Memory is that of this process and all of its children, above nothing.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import sys
import tempfile
import threading
import time
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
    options = parser.parse_args(arguments)
    folder = Path(tempfile.mkdtemp(prefix="chunked-"))
    try:
        _run(folder, options)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return 0


def _run(folder: Path, options: argparse.Namespace) -> None:
    from deformnb import chunked
    from deformnb.io import ome_zarr
    from deformnb.volume.volume import Grid

    n, block = options.size, ome_zarr.CHUNK
    source = _make_source(folder / "source.zarr", n)
    print(f"{n}^3 uint8, blocks {block}, {options.threads} threads")
    for name in options.fields:
        field = _field(name, Grid((n, n, n)))
        times = {}
        with _PeakMemory() as peak:
            start = time.perf_counter()
            chunked.warp(source, field, folder / "ours.zarr", fill=0, levels=1, workers=options.threads,
                         memory=options.memory, overwrite=True)
            times["deformnb"] = time.perf_counter() - start
        print(f"{name:11} deformnb {n**3 / times['deformnb'] / 1e6:8.1f} Mvoxel/s  peak {peak.bytes / 1e9:.2f} GB",
              flush=True)
        if not options.without_scipy:
            start = time.perf_counter()
            _with_scipy(source, field, name, folder / "scipy.zarr", n, block, options.threads)
            times["scipy"] = time.perf_counter() - start
            _compare(folder, n)
            print(f"{'':11} scipy    {n**3 / times['scipy'] / 1e6:8.1f} Mvoxel/s  "
                  f"{times['scipy'] / times['deformnb']:.1f} times as long", flush=True)


def _make_source(path: Path, n: int) -> Path:
    from deformnb.io import ome_zarr
    from deformnb.volume.volume import Grid

    array, = ome_zarr.create_pyramid(path, [Grid((n, n, n))], np.dtype(np.uint8))
    rng, y = np.random.default_rng(0), np.arange(n)[:, None]
    noise = rng.integers(0, 16, (64, n, n), np.uint8)
    for z in range(0, n, 64):
        shape = 90 + 80 * np.sin(y / 40 + z / 90) * np.cos(np.arange(n) / 31)
        array[z:z + 64] = noise[:n - z] + shape.astype(np.uint8)
    return path


def _field(name: str, grid: Any) -> Any:
    """The field as samples: given, so that nobody evaluates radial functions."""
    from deformnb import ControlPoints, Deformation, DisplacementField
    from deformnb.rbf.extrusion import extrude, replicate
    from deformnb.volume.plane import Plane, Raster

    n, rng = grid.shape[0], np.random.default_rng(1)
    dim = 2 if name == "replicated" else 3
    fixed = rng.uniform(0, n, (16, dim))
    points = ControlPoints.from_arrays(fixed, fixed + rng.normal(0, n / 40, fixed.shape))
    if name == "replicated":
        plane = Plane.along(grid, "+z")
        document = Deformation.on_picture(grid, plane, points)
        samples = DisplacementField.sample(document.field(grid).maps[0], Raster((n, n), (1.0, 1.0), (0.0, 0.0)))
        return extrude(plane, grid, [samples], replicate())
    return DisplacementField.sample(Deformation.in_space(points), grid.resampled(shape=(65, 65, 65)))


def _with_scipy(source: Path, field: Any, name: str, target: Path, n: int, block: tuple[int, int, int],
                threads: int) -> None:
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
            d = samples[start[1]:stop[1], start[2]:stop[2]]
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
        places = np.stack(np.broadcast_arrays(*(a.reshape([-1 if k == axis else 1 for k in range(3)]) + move[axis]
                                                for axis, a in enumerate(at))))
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
    """The largest resident memory of this process and its children, looked at every few hundredths of a second."""

    def __enter__(self) -> _PeakMemory:
        self.bytes, self._stop = 0, threading.Event()
        self._thread = threading.Thread(target=self._look)
        self._thread.start()
        return self

    def _look(self) -> None:
        while not self._stop.wait(0.02):
            self.bytes = max(self.bytes, _resident(os.getpid()))

    def __exit__(self, *error: object) -> None:
        self._stop.set()
        self._thread.join()


def _resident(process: int) -> int:
    try:
        own = int(Path(f"/proc/{process}/statm").read_text().split()[1]) * resource.getpagesize()
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    except (OSError, IndexError):
        return 0
    return own + sum(_resident(int(child)) for child in children)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

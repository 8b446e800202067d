"""On a GPU: ``python -m benchmarks gpu``. Parts of a warp compared with CuPy and PyTorch, and whole edits.

The first table has what stays in the GPU's memory: a field of control points evaluated at every voxel, and the warp of
a volume through it. The share of the bandwidth counts what must be read and written once: three displacements, and a
voxel before and after. The second has whole edits, from control points that have moved to voxels in NumPy's memory, on
the GPU and on the processors of the same machine.
"""

from __future__ import annotations

import argparse
import importlib.util
import statistics
import time
from argparse import Namespace
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from benchmarks import bench_edits, problem
from benchmarks.run import machine
from deformnb import devices
from deformnb._jax import jax, jnp
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.volume import sampling
from deformnb.volume.volume import Volume
from deformnb.warping import planning

Run = Callable[[], Any]

# Size for measuring the bandwidth: more than the caches hold.
_COPIED = 2**28


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="python -m benchmarks gpu", description=__doc__.split("\n\n")[0])
    parser.add_argument("--size", type=int, default=256, help="edge of the volume in voxels (default %(default)s)")
    parser.add_argument("--points", type=int, default=32, help="number of control points (default %(default)s)")
    parser.add_argument("--device", default="gpu", help="as the option of deformnb (default %(default)s)")
    parser.add_argument("--rounds", type=int, default=15, help="repetitions (default %(default)s)")
    options = parser.parse_args(arguments)
    devices.use_device(options.device)
    print(f"{machine()}\n{devices.describe_device(devices.device_in_use())}, JAX {jax.__version__}\n")
    print(f"{options.size}^3 voxels of 8 bits, {options.points} points; median and least of {options.rounds}.\n")
    volume = problem.volume(options.size, "uint8")
    support = problem.SUPPORT * (options.size - 1)
    field = fit_rbf(problem.control_points(options.points, 3, options.size), support=support)
    rate = _bandwidth(options.rounds)
    least = volume.grid.size * (3 * 4 + 2) / rate
    print(
        f"Memory of the GPU: {rate / 1e12:.2f} TB/s copied (read and written); "
        f"a general warp takes {1e3 * least:.3f} ms at least.\n"
    )
    print("| in the GPU's memory | ms | least | share of the bandwidth |\n|---|---|---|---|")
    for name, run, moved in _kernels(volume, field):
        median, best = _time(run, options.rounds)
        share = f"{moved / best / rate:.0%}" if moved else ""
        print(f"| {name} | {1e3 * median:.3f} | {1e3 * best:.3f} | {share} |", flush=True)
    print(f"\n| whole edit | {devices.device_name()} ms | processors ms |\n|---|---|---|", flush=True)
    found = {}
    for device in (options.device, "cpu"):
        devices.use_device(device)
        found[device] = {name: _time(run, options.rounds) for name, run in _edits(options)}
    for name, (_, best) in found[options.device].items():
        print(f"| {name} | {1e3 * best:.1f} | {1e3 * found['cpu'][name][1]:.1f} |")
    return 0


def _time(run: Run, rounds: int) -> tuple[float, float]:
    """Median and least seconds of a call whose result has arrived; the first one compiles and does not count."""
    seconds = []
    for _ in range(rounds + 1):
        start = time.perf_counter()
        jax.block_until_ready(run())
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds[1:]), min(seconds[1:])


def _bandwidth(rounds: int) -> float:
    """Bytes a second that are read and written by a kernel that does nothing else."""
    with devices.device_context():
        values, add = jnp.zeros(_COPIED, jnp.float32), jax.jit(lambda x: x + 1)
        return 2 * values.nbytes / _time(lambda: add(values), rounds)[1]


def _kernels(volume: Volume, field: RBFInterpolant) -> Iterator[tuple[str, Run, int]]:
    """Names, calls, and the bytes that must be moved at least where that bounds the time."""
    with devices.device_context():
        voxels, (d, _) = sampling.to_device(volume.values), field.evaluate_on_device(volume.grid)
        at, fill = planning.places(volume.grid, volume.grid, "float32"), np.uint8(0)
        yield f"{int(field.count)} points to displacements", lambda: field.evaluate_on_device(volume.grid)[0], 0
        moved = volume.grid.size * (3 * 4 + 2)

        def warp() -> Any:
            return sampling.general(
                voxels,
                d,
                at.matrix,
                at.whole,
                at.part,
                fill,
                shape=volume.shape,
                method="linear",
                compute="float32",
                index="int32",
            )

        yield "general warp", warp, moved
        right = np.asarray(warp()).astype(np.int16)
        for name, peer in (("CuPy map_coordinates", _cupy), ("PyTorch grid_sample", _torch)):
            if importlib.util.find_spec(name.split()[0].lower().replace("pytorch", "torch")):
                run = peer(volume.values, np.stack([np.asarray(one) for one in d]))
                wrong = np.abs(run(as_numpy=True).astype(np.int16) - right)[8:-8, 8:-8, 8:-8].max()
                yield f"{name} (at most {wrong} grey levels apart)", run, moved


def _cupy(values: Any, d: Any) -> Callable[..., Any]:
    import cupy
    from cupyx.scipy import ndimage

    index = cupy.indices(values.shape, dtype=cupy.float32)
    voxels, at = cupy.asarray(values), index + cupy.asarray(d[::-1])

    def run(*, as_numpy: bool = False) -> Any:
        out = ndimage.map_coordinates(voxels, at, output=cupy.float32, order=1, mode="grid-constant", cval=0)
        out = cupy.floor(out + 0.5).astype(cupy.uint8)
        cupy.cuda.Device().synchronize()
        return out.get() if as_numpy else None

    return run


def _torch(values: Any, d: Any) -> Callable[..., Any]:
    import torch
    from torch.nn.functional import grid_sample

    size = torch.tensor(values.shape[::-1], device="cuda", dtype=torch.float32)
    lines = [torch.arange(n, device="cuda", dtype=torch.float32) for n in values.shape]
    index = torch.stack(torch.meshgrid(*lines, indexing="ij")[::-1], dim=-1)
    at = ((index + torch.as_tensor(np.moveaxis(d, 0, -1).copy(), device="cuda")) * 2 / (size - 1) - 1)[None]
    voxels = torch.as_tensor(values, device="cuda").float()[None, None]  # it takes no bytes

    def run(*, as_numpy: bool = False) -> Any:
        out = grid_sample(voxels, at, mode="bilinear", padding_mode="zeros", align_corners=True)
        out = torch.floor(out + 0.5).to(torch.uint8)[0, 0]
        torch.cuda.synchronize()
        return out.cpu().numpy() if as_numpy else None

    return run


def _edits(options: Namespace) -> Iterator[tuple[str, Run]]:
    """The whole edits of :mod:`benchmarks.bench_edits`."""
    given = Namespace(size=options.size, points=options.points, dtype="uint8", loops=True)
    for group in bench_edits.groups(given):
        for case in group.cases:
            if case.ours and "preview" not in case.name:
                yield f"{group.name.partition(',')[0]}: {case.name.removeprefix('deformnb').strip(', ')}", case.run

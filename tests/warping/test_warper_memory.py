"""Memory of a warp in addition to its input, result included."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

# A volume as NumPy allocates it, which begins 16 bytes into a page. The first call loads libraries and compiles.
_MEASURE = """
from dataclasses import replace
import numpy as np
import deformnb as dn
from benchmarks import problem, timing
n = 512
values = np.empty((n, n, n), np.uint8)
values[...] = np.arange(n, dtype=np.uint8)[:, None, None]
volume = dn.Volume(values, dn.Grid(values.shape))
cut = dn.Cut(dn.Line(n * np.array([[0.48, -0.05], [0.55, 0.45], [0.5, 1.05]])))
space, flat = (problem.control_points(32, dim, n) for dim in (3, 2))
field, step = dn.fit_rbf(space), 1
on_picture = [dn.Deformation.from_picture_points(volume.grid, view, flat).steps[0] for view in ("+z", "+y")]
{case}
dn.warp(volume, field, step=step)
print(timing.peak_memory(lambda: dn.warp(volume, field, step=step))[0] / values.nbytes)
"""


@pytest.mark.nightly
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the peak of a process's memory is read from /proc")
@pytest.mark.parametrize(
    ("case", "most"),
    [
        ("", 1.8),  # blocks of 2^20 voxels on their way in two threads, 0.5 to 0.7: larger volumes have no larger ones
        ("step = 4", 1.2),
        ("field = dn.Deformation(on_picture[:1])", 1.5),
        ("field = dn.Deformation((replace(on_picture[0], extrusion='modulate'),))", 1.2),
        ("field = dn.Deformation((replace(on_picture[0], cuts=(cut,)),))", 1.5),
        ("field = dn.Deformation((replace(on_picture[0], extrusion='modulate', cuts=(cut,)),))", 1.4),
        ("field = dn.Deformation(on_picture)", 1.8),  # a quarter of it displacements at every fourth voxel
    ],
    ids=["every voxel", "every fourth voxel", "replicated", "modulated", "cut", "modulated cut", "two planes"],
)
def test_a_warp_takes_little_more_than_its_result(case: str, most: float) -> None:
    environment = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"}  # which compile in haste
    done = subprocess.run(
        [sys.executable, "-c", _MEASURE.format(case=case)],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert 1.0 <= float(done.stdout.split()[-1]) <= most

"""Checks an installed deformnb, or deformnb-core, as its users find it: files, fits, warps, a studio, pages, commands.

``python check_wheel.py`` outside of the checkout, whose package would be found first. It needs what the distribution
requires, and neither Node.js nor a compiler. What is compiled is compared: all levels of instructions give the same
voxels, and where none is used they differ by one grey value at most.
"""

import contextlib
import importlib.util
import os
import shutil
import subprocess
import sysconfig
import tempfile
from pathlib import Path

import numpy as np

import deformnb as dn
from deformnb.native import library

HERE, THERE = [[30, 100], [250, 60], [480, 100]], [[30, 130], [250, 60], [480, 130]]
PARTS = {"jax": "jax", "pyvista": "vtk", "trame_rca": "app"}  # what deformnb-core leaves out, and the extra of each


def main() -> None:
    """Check one after the other, in a folder that goes."""
    absent = [package for package in PARTS if importlib.util.find_spec(package) is None]
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        volume, bend = write_and_read()
        compare_levels(volume, bend)
        studio = dn.Studio(volume, bend)
        assert (studio.result().values == bend.apply(volume).values).all(), "the studio shows another deformation"
        studio.export_html("page.html")
        assert Path("page.html").stat().st_size > 500_000, "the page has no scripts"
        assert dn.render_volume(volume, size=(64, 48)).shape == (48, 64, 3)
        run_commands(absent)
    print("works:", "deformnb", dn.__version__, "at", Path(dn.__file__).parent, *(f"without {name}" for name in absent))


def write_and_read() -> tuple[dn.Volume, dn.Deformation]:
    """A phantom and a deformation of it, as files give them back."""
    carp = dn.datasets.PHANTOMS["fish"].make((32, 64, 32))
    for name in ("carp.nii.gz", "carp.nrrd", "carp.ome.tif"):
        dn.write_volume(carp, name)
        assert (dn.read_volume(name).values == carp.values).all(), name
    bend = dn.Deformation.from_picture_points(carp, "-x", dn.ControlPoints.from_arrays(HERE, THERE))
    dn.write_deformation(bend, "bend.json")
    return dn.read_volume("carp.nii.gz"), dn.read_deformation("bend.json")


def compare_levels(volume: dn.Volume, bend: dn.Deformation) -> None:
    """Warp by every level of instructions, and without compiled loops."""
    levels = library.levels()
    assert levels or os.environ.get("DEFORMNB_NATIVE") == "off", library.why_absent()
    results = [warp(volume, bend, level) for level in (*levels, "off")]
    for level, values in zip(levels, results, strict=False):
        assert (values == results[0]).all(), f"level {level} gives other values than {levels[0]}"
    assert abs(results[-1] - results[0]).max() <= 1, "compiled loops give other voxels than those without"
    assert (results[0] != volume.values).mean() > 0.05, "nothing was deformed"
    print("compiled loops:", *levels)


def warp(volume: dn.Volume, bend: dn.Deformation, level: str) -> np.ndarray:
    """The voxels, by a level of instructions."""
    before = library.use_level(level)
    try:
        return bend.apply(volume).values.astype(int)
    finally:
        library.use_level(before)


def run_commands(absent: list[str]) -> None:
    """Warp a file, write a page, and be told what is missing."""
    done = run("warp", "bend.json", "carp.nii.gz", "bent.nii.gz")
    assert done.returncode == 0, done.stderr
    assert dn.read_volume("bent.nii.gz").shape == (32, 64, 32)
    done = run("page", "file.html")
    assert done.returncode == 0, done.stderr
    if "trame_rca" in absent:
        assert 'pip install "deformnb-core[app]"' in run("app", "carp.nii.gz", "--no-browser").stderr
    report = run("doctor").stdout
    for package in absent:
        assert f'pip install "deformnb-core[{PARTS[package]}]"' in report, f"doctor names no command for {package}"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The command that the distribution installs."""
    command = shutil.which("deformnb", path=sysconfig.get_path("scripts")) or "deformnb"
    return subprocess.run([command, *arguments], capture_output=True, encoding="utf-8", errors="replace", check=False)


main()

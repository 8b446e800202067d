"""float64 only where requested, and compiled functions that outlive the process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from deformnb._jax import blockwise, float64, jit
from deformnb.native.library import level
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.warping.planning import processors

FIT = (  # by a kernel of the user, whose system and sums are compiled
    "import numpy as np\n"
    "from deformnb import ControlPoints, Raster, fit_rbf\n"
    "import jax.numpy as jnp\n"
    "from deformnb.rbf import register_kernel\n"
    "register_kernel(lambda r: (1 + 2 * r + 4 / 3 * r**2) * jnp.exp(-2 * r), name='own')\n"
    "x = np.random.default_rng(0).uniform(0, 9, (8, 2))\n"
    "p = ControlPoints.from_arrays(x, x + np.sin(x))\n"
    "fit_rbf(p, kernel='own', trend='quadratic').sample_on_raster(Raster((32, 32), (1, 1), (0, 0)))\n"
)


def run_fit(environment: dict[str, str]) -> None:
    subprocess.run([sys.executable, "-c", FIT], env={**os.environ, **environment}, check=True, capture_output=True)


def entries(folder: Path) -> set[str]:
    """Names of the cached programs; JAX also writes when each was last used, which changes."""
    return {p.name for p in folder.rglob("*-cache")}


def test_compiled_functions_are_kept_between_processes(isolated_folders: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Programs that compile quickly, as the tests' own do, are not cached.
    for name in ("JAX_COMPILATION_CACHE_DIR", "DEFORMNB_COMPILATION_CACHE", "XLA_FLAGS"):
        monkeypatch.delenv(name, raising=False)
    run_fit({})
    kept = entries(isolated_folders)
    assert {name.split("-")[0] for name in kept} >= {"jit__lattice"}
    run_fit({})
    # Tiny helpers are cached only if they happen to take long; the same programs under other keys would be misses.
    again = entries(isolated_folders) - kept
    assert not [name for name in again if name.startswith(("jit_solve", "jit__lattice"))], "compiled once more"


@pytest.mark.nightly
def test_kept_programs_outlive_other_versions_of_the_same_kernel(
    isolated_folders: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DEFORMNB_COMPILATION_CACHE", raising=False)
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(isolated_folders / "own"))
    monkeypatch.setenv("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    monkeypatch.setenv("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
    kernel = (
        "import numpy as np\nfrom deformnb._jax import blockwise, jit, jax, jnp\njax.devices()\n{}\n"
        "def kernel(x):\n    return jnp.sin(x) @ jnp.cos(x).T + {}\n"
        "jit(kernel)(np.ones((64, 64), np.float32))\n"
    )
    found = []
    for number, (lines, constant) in enumerate([("", 1), ("# a later version\n" * 30, 1), ("", 2)]):
        script = tmp_path / f"version{number}.py"
        script.write_text(kernel.format(lines, constant), encoding="utf-8")
        subprocess.run([sys.executable, str(script)], check=True, capture_output=True)
        found.append({name for name in entries(isolated_folders) if name.startswith("jit_kernel")})
    assert len(found[0]) == 1
    assert found[1] == found[0]  # elsewhere, in another file: the same program
    assert len(found[2]) == 2  # another program


@pytest.mark.nightly
def test_a_folder_of_the_user_is_left_in_place(isolated_folders: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DEFORMNB_COMPILATION_CACHE", raising=False)
    own = isolated_folders / "own"
    run_fit({"JAX_COMPILATION_CACHE_DIR": str(own), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"})
    assert entries(own)
    assert entries(isolated_folders) == entries(own)


@pytest.mark.nightly
def test_switched_off_nothing_is_kept(isolated_folders: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    run_fit({"DEFORMNB_COMPILATION_CACHE": "off"})
    assert entries(isolated_folders) == set()


def test_float64_is_local() -> None:
    points = ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9]], [[0, 0], [9, 1], [0, 9]])
    fit = fit_rbf(points)
    assert np.asarray(fit.coefficients).dtype == np.float64
    assert jnp.asarray(1.0).dtype == jnp.float32
    assert not jax.config.jax_enable_x64  # type: ignore[attr-defined]
    with float64():
        assert jnp.asarray(1.0).dtype == jnp.float64


def test_compiled_takes_the_options_of_jit() -> None:
    power = jit(lambda x, n: x**n, static_argnames="n")
    assert float(power(3.0, n=2)) == 9.0


def test_many_places_go_in_blocks_of_few_sizes() -> None:
    shapes: set[tuple[int, ...]] = set()

    def doubled(factor: Any, places: Any) -> Any:
        shapes.add(places.shape)
        return {"all": factor * places, "sum": places.sum(axis=0)}

    function, x = blockwise(doubled), np.random.default_rng(0).random((2, 150_000))
    for n in (150_000, 70_000, 65_536, 9000, 2048, 65, 64, 3, 1, 0):
        found = function(2.0, x[:, :n])
        np.testing.assert_array_equal(found["all"], 2 * x[:, :n])
        np.testing.assert_array_equal(found["sum"], x[0, :n] + x[1, :n])
        assert found["all"].dtype == np.float64
    assert shapes == {(2, 2048), (2, 64)}


FORKED = """
import multiprocessing, sys, warnings
import numpy as np
from deformnb import ControlPoints, Deformation, Volume, warp_array

def work(pipe=None):
    volume = Volume.from_array(np.arange(512, dtype=np.float32).reshape(8, 8, 8))
    points = ControlPoints.from_arrays([[1.0, 1, 1], [6, 2, 3]], [[2.0, 1, 1], [6, 3, 3]])
    try:
        result = Deformation.from_space_points(points).apply(volume)
        if sys.argv[1] == "used":
            result = warp_array(volume.values, np.zeros((3, 8, 8, 8)), volume.grid)
        said = str(result.shape)
    except Exception as error:
        said = f"{type(error).__name__}: {error}"
    if pipe is not None:
        pipe.send(said)
    return said

warnings.simplefilter("ignore")  # Python and JAX warn of forks with threads, and these are tested here
if sys.argv[1] != "fresh":
    work()
mine, other = multiprocessing.Pipe()
child = multiprocessing.get_context("fork").Process(target=work, args=(other,))
child.start()
print(mine.recv() if mine.poll(60) else "hangs")
child.kill()
child.join()
print(work())  # the parent continues
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
@pytest.mark.parametrize(
    ("parent", "wanted"),
    [
        ("used", "DeformError: this process was made by fork"),
        pytest.param("used without JAX", "(8, 8, 8)", marks=pytest.mark.skipif(level() == "off", reason="JAX warps")),
        pytest.param("fresh", "(8, 8, 8)", marks=pytest.mark.nightly),
    ],
)
def test_a_forked_child_of_a_process_that_has_used_jax_refuses_instead_of_hanging(parent: str, wanted: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", FORKED, parent], capture_output=True, text=True, timeout=180, check=True
    )
    child, own = done.stdout.splitlines()
    assert child.startswith(wanted)
    assert ("spawn" in child) == (parent == "used")
    assert own == "(8, 8, 8)"


@pytest.mark.skipif(processors() < 2, reason="XLA has one thread only")
def test_a_part_of_shared_work_stays_on_one_thread() -> None:
    x = np.ones(2**20, np.float32)
    shared, part = (jit(lambda x: jnp.sin(x) * 2, on_one_thread=alone) for alone in (False, True))
    texts = [call.executable().lower(x).compile().as_text() for call in (shared, part)]
    assert ["outer_dimension_partitions" in text for text in texts] == [True, False]
    np.testing.assert_array_equal(shared(x), part(x))

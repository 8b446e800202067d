"""Fixtures of all tests: strict numerics, separate folders, the real data where they are present."""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest

ROOT = Path(__file__).resolve().parent.parent

# These hold for the examples in the docstrings and for child processes too, hence the environment and not fixtures;
# they must be set before JAX or Matplotlib are imported.
_CACHE = ROOT / ".pytest_cache" / "deformnb"  # cached between runs: JAX compiles once, Matplotlib lists its fonts once
os.environ["XDG_CACHE_HOME"] = str(_CACHE / "cache")
os.environ["XDG_CONFIG_HOME"] = str(_CACHE / "config")
os.environ["MPLBACKEND"] = "Agg"
os.environ.setdefault("JAX_PLATFORMS", "cpu")  # with a GPU: JAX_PLATFORMS=cuda,cpu DEFORMNB_DEVICE=gpu
os.environ["JAX_DEBUG_NANS"] = "1"  # a NaN is an error where it is made, not where it is noticed; see allow_nan
os.environ.pop("JAX_ENABLE_X64", None)  # users run without it, so float64 must be requested where it is needed
for _own in ("DEFORMNB_DATA", "DEFORMNB_COMPILATION_CACHE"):
    os.environ.pop(_own, None)  # a developer's own settings change no result

# XLA took more than half of a run without cached programs, and takes a fifth of that where it optimises nothing and
# divides no program among its compiler's threads. The nightly run compiles as users' processes do, and so do at any
# time the notebooks, JupyterLab and its like.
_QUICK_COMPILATION = (
    "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
)


def _compile_quickly() -> None:
    """Set the flags for this process and its children, if XLA knows them: an unknown one ends the process."""
    known = subprocess.run(
        [sys.executable, "-c", "import jax; jax.devices()"],
        capture_output=True,
        check=False,
        env={**os.environ, "XLA_FLAGS": _QUICK_COMPILATION},
    )
    if known.returncode == 0:
        os.environ["XLA_FLAGS"] = _QUICK_COMPILATION


# Users cache programs that compile for 0.1 s or more. Tests compile hundreds of small programs, the same in several
# processes, after each clear_caches and in the next run: 24 of 62 s of three files of tests were compiling, and looking
# a program up costs little in comparison. A file that another process is writing is compiled anew, with a warning.
_PROGRAMS = {
    "JAX_COMPILATION_CACHE_DIR": str(_CACHE / "programs"),
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
}
_KEPT_SECONDS = 14 * 24 * 60 * 60.0


def _keep_all_programs() -> None:
    """Cache each compiled program, 20 kB, for two weeks: changes of the code leave behind those of before."""
    os.environ.update(_PROGRAMS)
    folder = _CACHE / "programs"
    for file in folder.iterdir() if folder.exists() else ():
        if time.time() - file.stat().st_mtime > _KEPT_SECONDS:
            file.unlink(missing_ok=True)


# The processes of pytest-xdist have it from the first one.
if os.environ.get("HYPOTHESIS_PROFILE") != "nightly" and not {"XLA_FLAGS", "PYTEST_XDIST_WORKER"} & os.environ.keys():
    _compile_quickly()
    if "JAX_COMPILATION_CACHE_DIR" not in os.environ:
        _keep_all_programs()

hypothesis.settings.register_profile("dev", deadline=None, max_examples=25)
# The same examples at each run, so that a change is not blamed for what chance has found; the nightly run searches.
hypothesis.settings.register_profile("ci", deadline=None, max_examples=10, derandomize=True)
hypothesis.settings.register_profile("nightly", deadline=None, max_examples=500)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE") or ("ci" if os.environ.get("CI") else "dev"))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, Any, Any]:
    """Collect no garbage while tests are imported, and later none of their imports: 770 000 permanent objects.

    It saves 4 s of the 10.7 s in which a process collects all tests, and 4 s of the 37 s of the tests of studios.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.collect()
        gc.freeze()


def pytest_runtest_setup(item: pytest.Item) -> None:
    if item.get_closest_marker("needs_gl") is None:
        return
    from deformnb.imaging.vtk_volume import gl_status

    works, found, remedy = gl_status()
    if not works:
        pytest.skip(f"{found}: {remedy}")


def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Clear the programs that JAX has compiled when there are many: gigabytes, in thousands of pieces of memory."""
    maps = Path("/proc/self/maps")
    if nextitem is not None and nextitem.path != item.path and maps.exists() and "jax" in sys.modules:
        with maps.open(encoding="utf-8") as lines:
            if sum(1 for _ in lines) > 15_000:
                sys.modules["jax"].clear_caches()


@pytest.fixture(autouse=True)
def _nan_allowed_where_marked(request: pytest.FixtureRequest) -> Iterator[None]:
    if request.node.get_closest_marker("allow_nan") is None:
        yield
        return
    import jax

    with jax.debug_nans(False):
        yield


@pytest.fixture(scope="session")
def x_display() -> Iterator[str]:
    """The name of an X display, for ``DISPLAY``: the user's, or one of Xvfb; "" where windows need none."""
    if not sys.platform.startswith("linux") or os.environ.get("DISPLAY"):
        yield os.environ.get("DISPLAY", "")
        return
    program = shutil.which("Xvfb")
    if program is None:
        pytest.skip("a window needs a display: apt-get install xvfb")
    end, start = os.pipe()
    command = [program, "-displayfd", str(start), "-screen", "0", "1600x1100x24", "-nolisten", "tcp"]
    server = subprocess.Popen(
        command, pass_fds=[start], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    os.close(start)
    try:
        with os.fdopen(end) as answer:
            yield ":" + answer.readline().strip()
    finally:
        server.terminate()
        server.wait()


@pytest.fixture(scope="session")
def real_data() -> Callable[[str], Path]:
    """The path of a real file by its name, such as "carp.nii.gz"; skips the test where it is absent."""
    folder = Path(os.environ.get("DEFORMNB_TEST_DATA") or ROOT.parent / "shared" / "data")

    def find(name: str) -> Path:
        path = folder / name
        if not path.exists():
            pytest.skip(f"real data absent: {path} (DEFORMNB_TEST_DATA names their folder)")
        return path

    return find


@pytest.fixture
def isolated_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Empty cache and configuration folders for this test alone, below the path returned; it is also the home."""
    for variable, name in (("XDG_CACHE_HOME", "cache"), ("XDG_CONFIG_HOME", "config"), ("XDG_DATA_HOME", "data")):
        monkeypatch.setenv(variable, str(tmp_path / name))
    monkeypatch.setenv("HOME", str(tmp_path))
    return tmp_path

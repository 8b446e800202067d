"""The loops for arm64, run by qemu: they give bit for bit what those for x86-64 do. How fast they are shows nowhere."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
if not (ROOT / "native_build.py").exists():
    pytest.skip("an installed package has no sources of the loops", allow_module_level=True)
sys.path.insert(0, str(ROOT))
from native_jobs import JobRecorder, split_answers  # noqa: E402
from random_warps import (  # noqa: E402
    DTYPES,
    OUTPUT,
    SOURCE,
    TypedReader,
    random_extrusion,
    random_input,
    random_moves,
    read_everything,
    read_extrusion,
)

import native_build  # noqa: E402
from deformnb.errors import DeformError  # noqa: E402
from deformnb.native import edges, jobs, library, sums  # noqa: E402
from deformnb.volume.sampling import METHODS  # noqa: E402
from deformnb.warping.voxel_readers import CompiledReader  # noqa: E402

EMULATOR = shutil.which("qemu-aarch64") or shutil.which("qemu-aarch64-static")

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(EMULATOR is None, reason="qemu-aarch64 runs programs for arm64: apt-get install qemu-user"),
    pytest.mark.skipif(not library.levels(), reason=f"no compiled loops: {library.why_absent()}"),
]


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Runs jobs with the loops for arm64; it needs no library of such a system."""
    pytest.importorskip("ziglang", reason="only ziglang compiles for other platforms: pip install ziglang")
    made = tmp_path_factory.mktemp("arm64") / "run_jobs"
    flags = [flag for flag in native_build.FLAGS if flag != "-fPIC"]
    flags += ["-target", "aarch64-linux-musl", "-static", "-mcpu=baseline"]
    flags += ["-DLEVEL=_base", f"-I{native_build.SOURCES}"]
    sources = [*sorted(native_build.SOURCES.glob("*.c")), ROOT / "tests" / "native" / "run_jobs.c"]
    command = [sys.executable, "-m", "ziglang", "cc", *flags, *map(str, sources), "-o", str(made), "-lm"]
    subprocess.run(command, check=True)
    return str(made)


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> JobRecorder:
    """Calls of the package, which go to the oldest loops of this machine."""
    before = library.use_level("base")
    own = library.loops()
    library.use_level(before)
    made = JobRecorder(own)
    monkeypatch.setattr(library, "loops", lambda: made)
    return made


def compare(program: str, recorder: JobRecorder) -> None:
    """Run what was recorded, and compare every bit of it."""
    assert recorder.recorded
    given = b"".join(job.text for job in recorder.recorded)
    assert EMULATOR is not None
    done = subprocess.run([EMULATOR, program], input=given, capture_output=True, check=True)
    for job, (code, results) in zip(recorder.recorded, split_answers(done.stdout, recorder.recorded), strict=True):
        assert code == job.code
        assert results == job.results


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", DTYPES)
def test_warps_give_the_same_voxels(dtype: str, method: str, program: str, recorder: JobRecorder) -> None:
    rng = np.random.default_rng([DTYPES.index(dtype), list(METHODS).index(method)])
    for shape in (SOURCE, SOURCE, (1, 1, 1), (1, 5, 6), (4, 1, 6), (4, 5, 1)):
        source = random_input(rng, dtype, method, exact=False, source=shape)
        read_everything(TypedReader(CompiledReader, source), random_moves(rng, OUTPUT), rng)
    for normal in range(3):
        for modulated in (False, True):
            for prepared in (False, True):
                case = random_extrusion(rng, dtype, method, normal, modulated=modulated)
                read_extrusion(CompiledReader, *case, prepared=prepared)
    compare(program, recorder)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", ["uint8", "float64"])
def test_places_that_are_no_numbers_are_outside(dtype: str, method: str, program: str, recorder: JobRecorder) -> None:
    reader = CompiledReader(random_input(np.random.default_rng(0), dtype, method, exact=False))
    for value in (np.nan, np.inf, -np.inf, 3e38, -3e38):
        d = (np.full(OUTPUT, value, np.float32),) * 3
        with pytest.raises(DeformError, match="not finite"):
            reader.read_block(np.zeros(OUTPUT, dtype), (slice(0, OUTPUT[0]), slice(0, OUTPUT[1])), d, None)
        voxels = tuple(np.zeros(3, np.int32) for _ in OUTPUT)
        reader.read_voxels(voxels, [component[voxels] for component in d])
    compare(program, recorder)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("kernel", jobs.RADIAL_FUNCTIONS)
def test_sums_over_centres_are_the_same(kernel: str, dtype: Any, program: str, recorder: JobRecorder) -> None:
    rng = np.random.default_rng(jobs.RADIAL_FUNCTIONS.index(kernel))
    for dim in (2, 3):
        for count in (0, 1, 40):
            for derivatives in (False, True):
                sums.sum_lattice(
                    rng.uniform(0, 1, (dim, 37)),
                    rng.uniform(-0.2, 0.2, (dim, 150)),
                    rng.uniform(0, 1, (count, dim)),
                    rng.normal(size=(count, dim)),
                    rng.normal(size=(dim, dim)),
                    rng.normal(size=dim),
                    kernel,
                    scales=rng.uniform(0.5, 3, count) if count > 1 else None,
                    quadratic=rng.normal(size=(dim, dim, dim)) if count else None,
                    dtype=dtype,
                    is_compact=kernel.startswith("wendland"),
                    derivatives=derivatives,
                )
    compare(program, recorder)


def test_distances_to_an_outline_are_the_same(program: str, recorder: JobRecorder) -> None:
    rng = np.random.default_rng(0)
    parts = [rng.normal(size=shape) for shape in ((9, 2), (9, 2), (9,), (9,), (9, 3, 2))]
    parts[2], parts[3] = np.minimum(*parts[2:4]), np.maximum(*parts[2:4])
    edges.edge_distances(parts, rng.normal(size=(500, 2)))
    compare(program, recorder)


def test_each_function_has_a_signature_to_be_recorded() -> None:
    from native_jobs import SIGNATURES

    assert list(SIGNATURES) == [field[0] for field in jobs.Loops._fields_]

"""The tests of warps over loops with checks of addresses and of undefined behaviour, which GCC compiles into them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
if not (ROOT / "native_build.py").exists():
    pytest.skip("an installed package has no sources of the loops", allow_module_level=True)
sys.path.insert(0, str(ROOT))
import native_build  # noqa: E402
from deformnb.native import library  # noqa: E402

pytestmark = [
    pytest.mark.nightly,
    pytest.mark.skipif(
        sys.platform != "linux" or shutil.which("gcc") is None,
        reason="needs Linux and gcc, whose sanitizers are loaded",
    ),
]

CHECKS = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=undefined")


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Variables by which Python starts with the sanitizers, and the package uses the loops with checks."""
    folder = tmp_path_factory.mktemp("sanitized")
    flags = [flag for flag in native_build.FLAGS if flag not in ("-O3", "-g0")]
    sources = map(str, sorted(native_build.SOURCES.glob("*.c")))
    made = folder / native_build.own_target().library
    subprocess.run(["gcc", *flags, *CHECKS, "-DLEVEL=_base", "-shared", *sources, "-o", made, "-lm"], check=True)
    runtime = [
        subprocess.run(["gcc", f"-print-file-name={name}"], capture_output=True, encoding="utf-8", check=True)
        for name in ("libasan.so", "libubsan.so")
    ]
    return {
        **os.environ,
        library.FOLDER_VARIABLE: str(folder),
        "LD_PRELOAD": " ".join(done.stdout.strip() for done in runtime),
        "ASAN_OPTIONS": "detect_leaks=0",  # Python leaves much to the end of the process
        "HYPOTHESIS_PROFILE": "dev",
    }


def test_a_read_beyond_an_array_ends_the_process(environment: dict[str, str]) -> None:
    """Otherwise the test below would prove nothing."""
    code = """
import ctypes, numpy as np
from deformnb.native import jobs, library
a = np.zeros((1000, 12))
job = jobs.EdgeDistances(edge=a.ctypes.data, places=a.ctypes.data, out=a.ctypes.data, edges=1100, count=3)
library.loops().edge_distances(ctypes.byref(job))
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, encoding="utf-8", check=False
    )
    assert "AddressSanitizer: heap-buffer-overflow" in done.stderr
    assert "edge_distances.c" in done.stderr


@pytest.mark.parametrize(
    "given",
    [
        [
            "-m",
            "nightly or not nightly",
            "-k",
            "not ten_thousand",
            "tests/native",
            "tests/warping/test_voxel_readers.py",
        ],
        ["tests/warping"],
    ],
    ids=["of loops", "of warps"],
)
def test_sanitizers_find_nothing(given: list[str], environment: dict[str, str], tmp_path: Path) -> None:
    # The process ends where something is found, and what pytest has captured is lost: hence a file for the report.
    checks = f"{environment['ASAN_OPTIONS']}:log_path={tmp_path / 'report'}"
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n0", *given],
        cwd=ROOT,
        env={**environment, "ASAN_OPTIONS": checks},
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    assert [path.read_text(encoding="utf-8") for path in tmp_path.iterdir()] == []
    assert done.returncode == 0, done.stdout + done.stderr

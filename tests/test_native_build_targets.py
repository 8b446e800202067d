"""Compiled loops for other platforms: libraries that export their tables, and wheels that are tagged as they are."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from random_warps import (
    DTYPES,
    OUTPUT,
    TypedReader,
    random_extrusion,
    random_input,
    random_moves,
    read_everything,
    read_extrusion,
)

from deformnb.native import jobs, library
from deformnb.volume.sampling import METHODS
from deformnb.warping.voxel_readers import CompiledReader

ROOT = Path(__file__).parents[1]
if not (ROOT / "native_build.py").exists():
    pytest.skip("an installed package has no sources of the loops", allow_module_level=True)
sys.path.insert(0, str(ROOT))
import native_build  # noqa: E402

pytestmark = pytest.mark.nightly

HEADERS = {"linux": b"\x7fELF", "macos": b"\xcf\xfa\xed\xfe", "windows": b"MZ"}
# All that a system of the tag's age has: the C library, and what it consists of.
SYSTEM_LIBRARIES = (
    "@rpath/deformnb_loops.dylib",
    "libc.so.6",
    "libm.so.6",
    "/usr/lib/libSystem.B.dylib",
    "KERNEL32.dll",
    "api-ms-win-crt-",
)


def build(name: str) -> Path:
    pytest.importorskip("ziglang", reason="only ziglang compiles for other platforms: pip install ziglang")
    return native_build.build(name)


@pytest.mark.parametrize("name", native_build.TARGETS)
def test_a_library_exports_its_tables_and_nothing_foreign(name: str) -> None:
    lief = pytest.importorskip("lief", reason="lief reads the symbols of all platforms: pip install lief")
    library, target = build(name), native_build.TARGETS[name]
    assert library.read_bytes().startswith(HEADERS[name.partition("-")[0]])
    read = lief.parse(str(library))
    symbols = read.exported_functions if name.startswith("windows") else read.exported_symbols
    exported = {str(symbol.name).removeprefix("_" * name.startswith("macos")) for symbol in symbols}
    linked = {"_mh_dylib_header", "__dso_handle"}  # by every linker of Apple's format
    tables = {f"deformnb_loops_{level}" for level in target.levels}
    assert exported >= {"deformnb_best_level", *tables}
    assert all(symbol.startswith("deformnb_") for symbol in exported - linked), exported
    others = [str(getattr(needed, "name", needed)) for needed in read.libraries]
    assert all(other.startswith(SYSTEM_LIBRARIES) for other in others), others


@pytest.mark.parametrize("name", ["linux-x86_64", "linux-arm64"])
def test_a_library_needs_no_newer_system_than_its_tag_says(name: str) -> None:
    lief = pytest.importorskip("lief")
    read = lief.parse(str(build(name)))  # what is taken from it lives no longer
    versions = [
        str(version.name).removeprefix("GLIBC_")
        for needed in read.symbols_version_requirement
        for version in needed.get_auxiliary_symbols()
    ]
    assert versions
    assert all(tuple(map(int, version.split("."))) <= (2, 28) for version in versions), versions


def test_a_library_for_apple_is_signed_and_serves_old_systems() -> None:
    lief = pytest.importorskip("lief")
    for name in ("macos-x86_64", "macos-arm64"):
        parsed = lief.MachO.parse(str(build(name)))
        read = parsed.at(0)
        assert list(read.build_version.minos)[:2] == [11, 0]
        assert read.has_code_signature or name != "macos-arm64"  # such processors load no other


@pytest.mark.parametrize("name", native_build.TARGETS)
def test_a_wheel_has_the_tag_and_the_library_of_its_target(name: str, tmp_path: Path) -> None:
    pytest.importorskip("hatchling", reason="hatchling builds wheels: pip install hatchling")
    library, target = build(name), native_build.TARGETS[name]
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    environment = {**os.environ, native_build.TARGET_VARIABLE: name}
    subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True)
    (wheel,) = tmp_path.iterdir()
    assert wheel.name.endswith(f"-py3-none-{target.tag}.whl")
    with zipfile.ZipFile(wheel) as archive:
        inside = [entry for entry in archive.namelist() if entry.startswith("deformnb/native/lib/")]
        assert inside == [f"deformnb/native/lib/{target.library}"]
        assert archive.read(inside[0]) == library.read_bytes()


def test_a_wheel_without_loops_serves_all_platforms(tmp_path: Path) -> None:
    pytest.importorskip("hatchling", reason="hatchling builds wheels: pip install hatchling")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    environment = {**os.environ, "DEFORMNB_NATIVE": "off"}
    subprocess.run(command, cwd=ROOT, env=environment, check=True, capture_output=True)
    (wheel,) = tmp_path.iterdir()
    assert wheel.name.endswith("-py3-none-any.whl")
    with zipfile.ZipFile(wheel) as archive:
        assert not [entry for entry in archive.namelist() if entry.startswith("deformnb/native/lib/")]


def test_ziglang_alone_compiles_for_this_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("ziglang", reason="pip install ziglang")
    monkeypatch.setattr(native_build.shutil, "which", lambda _: None)
    monkeypatch.setattr(native_build, "FOLDER", tmp_path)
    made = native_build.build()
    assert made.parent == tmp_path
    assert ctypes.CDLL(str(made)).deformnb_best_level() >= 0


def test_a_target_that_is_not_there_ends_the_build_of_a_wheel(tmp_path: Path) -> None:
    pytest.importorskip("hatchling", reason="hatchling builds wheels: pip install hatchling")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    environment = {**os.environ, native_build.TARGET_VARIABLE: "amiga"}
    done = subprocess.run(command, cwd=ROOT, env=environment, check=False, capture_output=True, encoding="utf-8")
    assert done.returncode
    assert "amiga is none of linux-x86_64" in done.stdout + done.stderr


on_linux_x86 = pytest.mark.skipif(
    sys.platform != "linux" or native_build.own_target().levels is not native_build.X86_LEVELS,
    reason="the library that is compiled for Linux on x86-64 runs there only",
)


@on_linux_x86
def test_the_library_for_this_platform_loads_and_knows_the_same_levels() -> None:
    own = native_build.library_path()
    if not own.exists():
        pytest.skip("no C compiler was there")
    crossed, compiled = ctypes.CDLL(str(build("linux-x86_64"))), ctypes.CDLL(str(own))
    assert crossed.deformnb_best_level() == compiled.deformnb_best_level()


@on_linux_x86
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", DTYPES)
def test_both_compilers_give_the_same_voxels(dtype: str, method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    own = native_build.library_path()
    if not own.exists():
        pytest.skip("no C compiler was there")
    results = []
    for path in (own, build("linux-x86_64")):
        for level in library.levels():
            table = jobs.Loops.in_dll(ctypes.CDLL(str(path)), f"deformnb_loops_{level}")
            monkeypatch.setattr(library, "loops", lambda table=table: table)
            rng = np.random.default_rng(DTYPES.index(dtype))
            source = random_input(rng, dtype, method, exact=False)
            values = read_everything(TypedReader(CompiledReader, source), random_moves(rng, OUTPUT), rng)
            for normal in range(3):
                case = random_extrusion(rng, dtype, method, normal, modulated=normal == 1)
                values.append(read_extrusion(CompiledReader, *case, prepared=normal == 0))
            results.append(values)
    for others in results[1:]:
        for found, wanted in zip(others, results[0], strict=True):
            np.testing.assert_array_equal(found, wanted)


@on_linux_x86
def test_the_library_for_this_platform_passes_the_tests_of_warps() -> None:
    folder = build("linux-x86_64").parent
    command = [sys.executable, "-m", "pytest", "-q", "-n0", "tests/native", "tests/warping/test_voxel_readers.py"]
    environment = {**os.environ, library.FOLDER_VARIABLE: str(folder), "HYPOTHESIS_PROFILE": "dev"}
    done = subprocess.run(command, cwd=ROOT, env=environment, check=False, capture_output=True, encoding="utf-8")
    assert done.returncode == 0, done.stdout + done.stderr

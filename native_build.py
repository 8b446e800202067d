"""Builds the compiled loops of ``native/`` into ``deformnb/native/lib`` where they have changed.

``python native_build.py`` uses the system's C compiler, or that of the package ziglang from PyPI. Python's standard
library is all that is needed, so that the build of the package can use it.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent
SOURCES = ROOT / "native"
FOLDER = ROOT / "deformnb" / "native" / "lib"
STAMP = FOLDER / "sources.sha256"
WHEEL = "ziglang>=0.14"
X86_LEVELS = {"base": "x86-64", "v2": "x86-64-v2", "v3": "x86-64-v3", "v4": "x86-64-v4"}
# Without contraction of a * b + c all levels give the same voxels. No loop is distributed over threads here.
PER_LEVEL = ("voxel_warp", "radial_sums", "edge_distances")  # compiled once for each level
FLAGS = ("-std=gnu11", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fopenmp-simd", "-fPIC",
         "-fvisibility=hidden", "-Wall")  # fmt: skip


class CompilerError(Exception):
    """A build that failed, in a sentence."""

    status = 1


class MissingCompilerError(CompilerError):
    """There is no C compiler."""

    status = 3  # by which the script "run" knows that it may fetch one


def digest() -> str:
    """Of everything that the library is made of."""
    total = hashlib.sha256(Path(__file__).read_bytes())
    for path in sorted(SOURCES.glob("*.[ch]")):
        total.update(path.name.encode() + path.read_bytes())
    return total.hexdigest()


def is_stale() -> bool:
    """Check whether sources have changed since the library was built."""
    return not library_path().exists() or not STAMP.exists() or STAMP.read_text(encoding="utf-8") != digest()


def library_path() -> Path:
    """The library."""
    return FOLDER / f"deformnb_loops{'.dll' if os.name == 'nt' else '.so'}"


def find_compiler() -> list[str]:
    """The command of a C compiler.

    Raises
    ------
    MissingCompilerError
        If there is none.
    """
    named = shlex.split(os.environ.get("CC", "") or sysconfig.get_config_var("CC") or "")
    for command in ([*named[:1]], ["cc"], ["gcc"], ["clang"]):
        if command and shutil.which(command[0]):
            return command
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    raise MissingCompilerError(
        "no C compiler was found, so voxels are read by JAX, which takes two to four times as long; "
        "install gcc or clang, or run: pip install ziglang"
    )


def build() -> None:
    """Build the library where its sources have changed."""
    if not is_stale():
        return
    now = digest()
    compiler = find_compiler()
    FOLDER.mkdir(parents=True, exist_ok=True)
    levels = X86_LEVELS if platform.machine().lower() in ("x86_64", "amd64") else {"base": ""}
    with tempfile.TemporaryDirectory() as folder:

        def compile_level(job: tuple[str, str]) -> str:
            source, name = job
            target = str(Path(folder) / f"{source}_{name}.o")
            march = (
                levels[name].replace("-v", "_v").replace("x86-64", "x86_64") if "ziglang" in compiler else levels[name]
            )
            option = [] if not march else [f"-mcpu={march}" if "ziglang" in compiler else f"-march={march}"]
            _run(*compiler, *FLAGS, *option, f"-DLEVEL=_{name}", "-c", str(SOURCES / f"{source}.c"), "-o", target)
            return target

        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            objects = list(pool.map(compile_level, [(source, name) for source in PER_LEVEL for name in levels]))
        made = Path(folder) / library_path().name
        _run(*compiler, *FLAGS, "-shared", str(SOURCES / "levels.c"), *objects, "-o", str(made), "-lm")
        shutil.copyfile(made, f"{library_path()}.new")
        os.replace(f"{library_path()}.new", library_path())  # one that is in use stays whole
    STAMP.write_text(now, encoding="utf-8")


def _run(*command: str) -> None:
    done = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", check=False)
    if done.returncode:
        raise CompilerError(f"the loops of native/ do not compile: {' '.join(command)}\n{done.stderr.strip()}")


def main() -> None:
    """Build, or say in a sentence why not."""
    try:
        build()
    except CompilerError as error:
        sys.stderr.write(f"native_build: {error}\n")
        sys.exit(error.status)


if __name__ == "__main__":
    main()

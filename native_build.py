"""Builds the compiled loops of ``native/`` into ``deformnb/native/lib`` where they have changed.

``python native_build.py`` uses the system's C compiler, or that of the package ziglang from PyPI, which also compiles
for other platforms: ``python native_build.py linux-arm64`` builds into ``build/native/linux-arm64``. Python's standard
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
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent
SOURCES = ROOT / "native"
FOLDER = ROOT / "deformnb" / "native" / "lib"
STAMP = "sources.sha256"  # in the folder of the library
WHEEL = "ziglang>=0.14"
TARGET_VARIABLE = "DEFORMNB_NATIVE_TARGET"  # names a row of TARGETS to the build of a wheel
X86_LEVELS = {"base": "x86-64", "v2": "x86-64-v2", "v3": "x86-64-v3", "v4": "x86-64-v4"}
ONE_LEVEL = {"base": ""}
# Without contraction of a * b + c all levels give the same voxels. No loop is distributed over threads here.
PER_LEVEL = ("voxel_warp", "radial_sums", "edge_distances")  # compiled once for each level
FLAGS = ("-std=gnu11", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fopenmp-simd", "-fPIC",
         "-fvisibility=hidden", "-g0", "-Wall")  # fmt: skip


@dataclass(frozen=True)
class Target:
    """A platform: its name for zig with the oldest system that is served, and the same as the tag of a wheel."""

    triple: str
    tag: str
    library: str
    levels: dict[str, str]


TARGETS = {
    "linux-x86_64": Target("x86_64-linux-gnu.2.28", "manylinux_2_28_x86_64", "deformnb_loops.so", X86_LEVELS),
    "linux-arm64": Target("aarch64-linux-gnu.2.28", "manylinux_2_28_aarch64", "deformnb_loops.so", ONE_LEVEL),
    "macos-x86_64": Target("x86_64-macos.11.0", "macosx_11_0_x86_64", "deformnb_loops.dylib", X86_LEVELS),
    "macos-arm64": Target("aarch64-macos.11.0", "macosx_11_0_arm64", "deformnb_loops.dylib", ONE_LEVEL),
    "windows-x86_64": Target("x86_64-windows-gnu", "win_amd64", "deformnb_loops.dll", X86_LEVELS),
}


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


def own_target() -> Target:
    """The target of a build for this machine alone."""
    is_x86 = platform.machine().lower() in ("x86_64", "amd64")
    levels = X86_LEVELS if is_x86 else ONE_LEVEL
    tag = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    if sys.platform == "darwin":  # Python may be made for both processors and for systems that arm64 never had
        return Target("", TARGETS["macos-x86_64" if is_x86 else "macos-arm64"].tag, "deformnb_loops.dylib", levels)
    return Target("", tag, "deformnb_loops.dll" if os.name == "nt" else "deformnb_loops.so", levels)


def library_path(name: str | None = None) -> Path:
    """The library of this machine, or of a named target."""
    return FOLDER / own_target().library if name is None else ROOT / "build" / "native" / name / TARGETS[name].library


def is_stale(name: str | None = None) -> bool:
    """Check whether sources have changed since a library was built."""
    library = library_path(name)
    stamp = library.with_name(STAMP)
    return not library.exists() or not stamp.exists() or stamp.read_text(encoding="utf-8") != digest()


def find_compiler(*, crosses: bool = False) -> list[str]:
    """The command of a C compiler.

    Parameters
    ----------
    crosses : it must compile for other platforms, which ziglang does.

    Raises
    ------
    MissingCompilerError
        If there is none.
    """
    named = shlex.split(os.environ.get("CC", "") or sysconfig.get_config_var("CC") or "")
    # GCC on Windows does not align vectors of 32 bytes on the stack, and clang there needs Microsoft's linker.
    if not crosses and os.name != "nt":
        for command in ([*named[:1]], ["cc"], ["gcc"], ["clang"]):
            if command and shutil.which(command[0]):
                return command
    if importlib.util.find_spec("ziglang") is not None:
        return [sys.executable, "-m", "ziglang", "cc"]
    if crosses:
        raise MissingCompilerError("loops for other platforms are compiled by ziglang: pip install ziglang")
    raise MissingCompilerError(
        "no C compiler was found, so voxels are read by JAX, which takes two to four times as long; "
        "install gcc or clang, or run: pip install ziglang"
    )


def build(name: str | None = None) -> Path:
    """Build the library of this machine, or of a named target, where sources have changed.

    Returns
    -------
    its path.
    """
    library = library_path(name)
    if not is_stale(name):
        return library
    now = digest()
    target = own_target() if name is None else TARGETS[name]
    compiler = find_compiler(crosses=name is not None)
    is_zig = "ziglang" in compiler
    compiler += FLAGS
    if is_zig:  # which would compile for the very processor of this machine
        compiler += ["-target", target.triple, "-mcpu=baseline"] if target.triple else ["-mcpu=baseline"]
    with tempfile.TemporaryDirectory() as folder:

        def compile_level(job: tuple[str, str]) -> str:
            source, level = job
            made = str(Path(folder) / f"{source}_{level}.o")
            march = target.levels[level]
            options = [f"-DLEVEL=_{level}"]
            if march:
                options.append(f"-mcpu={march.replace('-', '_')}" if is_zig else f"-march={march}")
            if level == "v4":  # clang would halve its vectors
                options.append("-mprefer-vector-width=512")
            _run(*compiler, *options, "-c", str(SOURCES / f"{source}.c"), "-o", made)
            return made

        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            objects = list(
                pool.map(compile_level, [(source, level) for source in PER_LEVEL for level in target.levels])
            )
        made = Path(folder) / library.name
        if library.suffix == ".dylib":  # else it would be called after the folder of this build
            compiler.append(f"-Wl,-install_name,@rpath/{library.name}")
        _run(*compiler, "-shared", str(SOURCES / "levels.c"), *objects, "-o", str(made), "-lm")
        library.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(made, f"{library}.new")
        os.replace(f"{library}.new", library)  # one that is in use stays whole
    library.with_name(STAMP).write_text(now, encoding="utf-8")
    return library


def _run(*command: str) -> None:
    environment = {**os.environ, "MACOSX_DEPLOYMENT_TARGET": "11.0"}  # as the tag of a wheel says
    if not {"HOME", "XDG_CACHE_HOME", "LOCALAPPDATA", "ZIG_GLOBAL_CACHE_DIR"} & environment.keys():
        environment["ZIG_GLOBAL_CACHE_DIR"] = str(Path(tempfile.gettempdir()) / "zig")  # zig would not start
    done = subprocess.run(
        command, capture_output=True, encoding="utf-8", errors="replace", check=False, env=environment
    )
    if done.returncode:
        raise CompilerError(f"the loops of native/ do not compile: {' '.join(command)}\n{done.stderr.strip()}")


def main() -> None:
    """Build for this machine or for the named targets, or say in a sentence why not."""
    names = sys.argv[1:]
    if unknown := [name for name in names if name not in TARGETS]:
        sys.exit(f"native_build: there is no target {unknown[0]!r}; there are {', '.join(TARGETS)}")
    try:
        for name in names or [None]:
            build(name)
    except CompilerError as error:
        sys.stderr.write(f"native_build: {error}\n")
        sys.exit(error.status)


if __name__ == "__main__":
    main()

"""Node.js, Chromium and VTK find their shared libraries, also on a machine that has nothing but what ``run`` installs.

A machine with many packages has libraries that no package named in ``run`` brings: there they are looked for among all
that these depend on.
"""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from scripts import chromium

import node_tasks

ROOT = Path(__file__).resolve().parent.parent
# VTK opens these by their names when it draws, so that ldd does not know of them.
OPENED_BY_VTK = ("libEGL.so.1", "libGL.so.1")
# The files of each package, one a line.
DPKG_LISTS = Path("/var/lib/dpkg/info")

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux") or shutil.which("ldd") is None,
    reason="the libraries of a program are listed by ldd, which is of Linux",
)


def programs_and_libraries(name: str) -> list[Path]:
    """The files of one of the three whose libraries must be there; skips the test where it is not installed."""
    if name == "Playwright":
        return [_folder("playwright") / "driver" / "node"]
    if name == "Node.js":
        return [Path(shutil.which(node_tasks.find_node()[0]) or "")]
    if name == "VTK":
        return sorted(_folder("vtkmodules").glob("vtkRendering*.so"))
    command = chromium()
    if command is None:
        pytest.skip("no Chromium, or no Playwright to drive it")
    found = [path for path in (Path(command), Path("/usr/lib/chromium") / Path(command).name) if _is_elf(path)]
    if not found:
        pytest.skip(f"{command} is a script that starts an unknown program")
    return found[:1]


def _folder(package: str) -> Path:
    spec = find_spec(package)
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent


def _is_elf(path: Path) -> bool:
    return path.is_file() and path.read_bytes()[:4] == b"\x7fELF"


def libraries(files: list[Path]) -> dict[str, str]:
    """The path of each shared library that files need, themselves or through others; empty where it is missing."""
    told = subprocess.run(["ldd", *map(str, files)], capture_output=True, text=True, check=False).stdout
    return {
        name: "" if path == "not found" else path
        for name, path in re.findall(r"^\s+(\S+) => (not found|/\S+)", told, re.MULTILINE)
    }


@pytest.mark.parametrize("name", ["Chromium", "Node.js", "Playwright", "VTK"])
def test_no_shared_library_is_missing(name: str) -> None:
    found = libraries(programs_and_libraries(name))
    assert found
    assert [library for library, path in found.items() if not path] == []


@pytest.mark.parametrize("name", ["Chromium", "Node.js", "Playwright", "VTK"])
def test_run_installs_each_shared_library(name: str) -> None:
    if shutil.which("dpkg-query") is None:
        pytest.skip("the packages are not those of Debian")
    used = {
        library
        for library, path in libraries(programs_and_libraries(name)).items()
        if path and not Path(path).resolve().is_relative_to(Path(sys.prefix).resolve())
    }
    if name == "VTK":
        used |= {library for library in OPENED_BY_VTK if _opens(library)}
    brought = brought_by_run()
    owners = owners_of(used)
    assert {library: owner for library, owner in owners.items() if not owner & brought} == {}
    assert owners


def _opens(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def owners_of(names: set[str]) -> dict[str, set[str]]:
    """The packages of Debian that have a file of each of these names.

    By names, as ldd may say /lib where the package says /usr/lib. The lists of dpkg are read here: "dpkg -S" compares
    each file with each pattern, which takes seconds.
    """
    found: dict[str, set[str]] = {}
    for listed in DPKG_LISTS.glob("*.list"):
        package = listed.stem.partition(":")[0]  # as in "libc6:amd64.list"
        for name in names & {line.rpartition("/")[2] for line in listed.read_text(encoding="utf-8").splitlines()}:
            found.setdefault(name, set()).add(package)
    return found


def brought_by_run() -> set[str]:
    """Packages of a minimal Debian and those that ``run`` installs, with their dependencies, as far as installed."""
    fields = ("Package", "Essential", "Priority", "Provides", "Pre-Depends", "Depends")
    table = subprocess.run(
        ["dpkg-query", "-W", "-f", "\t".join(f"${{{field}}}" for field in fields) + "\n"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    depends: dict[str, set[str]] = {}
    reached = named_in_run() | {"apt"}
    for line in table.splitlines():
        package, essential, priority, provided, *needed = line.split("\t")
        depends.setdefault(package, set()).update(*map(_names, needed))
        for other in _names(provided):
            depends.setdefault(other, set()).add(package)
        if essential == "yes" or priority == "required":
            reached.add(package)
    new = reached
    while new:
        new = {other for package in new for other in depends.get(package, ())} - reached
        reached = reached | new
    return reached


def _names(relations: str) -> set[str]:
    """The packages in a list of relations such as "libc6 (>= 2.34), debconf | debconf-2.0"."""
    return {match[1] for one in re.split(r"[,|]", relations) if (match := re.match(r"\s*([a-z0-9][\w.+-]*)", one))}


def named_in_run() -> set[str]:
    """The packages that the script installs by their names."""
    script = (ROOT / "run").read_text(encoding="utf-8")
    return {name for names in re.findall(r"apt_install ((?:[a-z][\w.+-]* ?)+)", script) for name in names.split()}

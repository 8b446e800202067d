"""The build of the compiled loops: only where sources have changed, and in a sentence where it cannot be."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from deformnb.native import library

ROOT = Path(__file__).parents[1]
if not (ROOT / "native_build.py").exists():
    pytest.skip("an installed package has no sources of the loops", allow_module_level=True)
sys.path.insert(0, str(ROOT))
import native_build  # noqa: E402


def test_what_was_built_is_of_these_sources() -> None:
    if not native_build.library_path().exists():
        pytest.skip("no C compiler was there")
    assert not native_build.is_stale()


def test_a_changed_source_makes_the_library_stale(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "loops.c").write_text("int a;", encoding="utf-8")
    monkeypatch.setattr(native_build, "SOURCES", tmp_path)
    before = native_build.digest()
    (tmp_path / "loops.c").write_text("int b;", encoding="utf-8")
    assert native_build.digest() != before


def test_a_machine_without_a_compiler_is_told_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    monkeypatch.setattr(native_build.shutil, "which", lambda _: None)
    monkeypatch.setattr(native_build.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(native_build.MissingCompilerError, match="pip install ziglang") as caught:
        native_build.find_compiler()
    assert caught.value.status == 3


def test_a_machine_with_ziglang_alone_compiles_by_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native_build.shutil, "which", lambda _: None)
    monkeypatch.setattr(native_build.importlib.util, "find_spec", lambda _: object())
    assert native_build.find_compiler()[1:] == ["-m", "ziglang", "cc"]


def test_gcc_of_windows_is_not_used(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(native_build.shutil, "which", lambda name: name)
    monkeypatch.setattr(native_build.importlib.util, "find_spec", lambda _: object())
    with monkeypatch.context() as patch:  # pytest's own paths need the true name
        patch.setattr(native_build.os, "name", "nt")
        found = native_build.find_compiler()
    assert found[1:] == ["-m", "ziglang", "cc"]


def test_a_compiler_that_fails_is_quoted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("voxel_warp.c", "radial_sums.c", "levels.c"):
        (tmp_path / name).write_text("this is no C", encoding="utf-8")
    monkeypatch.setattr(native_build, "SOURCES", tmp_path)
    monkeypatch.setattr(native_build, "FOLDER", tmp_path / "lib")
    with pytest.raises(native_build.CompilerError, match="do not compile"):
        native_build.build()
    assert not list((tmp_path / "lib").glob("*"))


def test_each_target_is_a_library_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [native_build.library_path(name) for name in (None, *native_build.TARGETS)]
    assert len(set(paths)) == len(paths)
    monkeypatch.setattr(native_build.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(native_build.MissingCompilerError, match="ziglang"):
        native_build.find_compiler(crosses=True)


def test_the_package_looks_for_the_library_that_is_built() -> None:
    assert library.why_absent() == "" or native_build.library_path().name in library.why_absent()


def test_a_target_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["native_build.py", "amiga"])
    with pytest.raises(SystemExit, match="no target 'amiga'; there are linux-x86_64"):
        native_build.main()

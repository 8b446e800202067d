"""Bundles of the front end: stale ones are refused, and without Node.js a sentence says what to install."""

from __future__ import annotations

import importlib.util
import json
import shutil
from pathlib import Path
from types import ModuleType

import pytest

import node_tasks
from deformnb.widgets import bundle as module

ROOT = Path(__file__).parent.parent


@pytest.fixture
def small(tmp_path: Path) -> ModuleType:
    """The module of the bundles, in a folder with one script and its bundle."""
    (tmp_path / "deformnb" / "widgets").mkdir(parents=True)
    shutil.copy(module.__file__, tmp_path / "deformnb" / "widgets" / "bundle.py")
    one = "export default 1;"
    for name, text in (
        ("frontend/src/a.ts", one),
        ("frontend/build.mjs", ""),
        ("deformnb/widgets/static/a.js", one),
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    spec = importlib.util.spec_from_file_location("small_bundle", tmp_path / "deformnb" / "widgets" / "bundle.py")
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


def test_a_bundle_of_these_sources_is_taken(small: ModuleType) -> None:
    small.STAMP.write_text(small.digest(), encoding="utf-8")
    assert small.bundle("a.js") == "export default 1;"


@pytest.mark.parametrize("change", ["edited", "added", "renamed"])
def test_a_bundle_of_other_sources_is_refused_with_the_cure(small: ModuleType, change: str) -> None:
    small.STAMP.write_text(small.digest(), encoding="utf-8")
    if change == "renamed":
        (small.SOURCES / "a.ts").rename(small.SOURCES / "b.ts")
    else:
        (small.SOURCES / {"edited": "a.ts", "added": "b.css"}[change]).write_text("other", encoding="utf-8")
    with pytest.raises(RuntimeError, match='has changed since it was bundled: run "sh run bundle"'):
        small.bundle("a.js")


def test_what_was_never_bundled_is_refused_and_a_wheel_has_no_sources(small: ModuleType) -> None:
    with pytest.raises(RuntimeError, match="has not been bundled"):
        small.bundle("a.js")
    small.STAMP.write_text("of the day of the release", encoding="utf-8")
    shutil.rmtree(small.FRONT_END)
    assert small.bundle("a.js") == "export default 1;"


@pytest.mark.parametrize(("version", "words"), [(None, "there is none"), ("v18.20.1", "is v18.20.1"), ("", "is none")])
def test_without_node_a_sentence_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, version: str | None, words: str
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(node_tasks.importlib.util, "find_spec", lambda name: None)
    if version is not None:
        (tmp_path / "node").write_text(f"#!/bin/sh\necho {version}\n", encoding="utf-8")
        (tmp_path / "node").chmod(0o755)
    with pytest.raises(node_tasks.MissingNodeError, match=f"{words}; install Node.js 20 or newer") as error:
        node_tasks.find_node()
    assert error.value.status == 3


def test_npm_is_not_run_where_it_would_empty_the_folder_of_another_checkout(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(node_tasks, "FRONT_END", tmp_path)
    (tmp_path / "package-lock.json").write_text("{}", encoding="utf-8")
    kept = tmp_path / "other" / "esbuild"
    kept.mkdir(parents=True)
    (tmp_path / "node_modules").symlink_to(kept.parent)
    with pytest.raises(node_tasks.NodeError, match=r"esbuild is missing .* npm would empty .*/other\."):
        node_tasks.need_package("esbuild")
    assert kept.is_dir()


def test_the_lock_file_names_no_registry_and_all_platforms() -> None:
    packages = json.loads((ROOT / "frontend" / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    assert not [name for name, package in packages.items() if "resolved" in package]
    wanted = {f"node_modules/{name}" for one in packages.values() for name in one.get("optionalDependencies", {})}
    assert wanted <= packages.keys()


def test_a_browser_can_hold_a_bundle_in_a_byte_a_letter() -> None:
    made = {path for path in module.BUNDLES.glob("*.js") if path.name != "app.js"}  # which a page loads once
    assert len(made) > 20
    assert [path.name for path in made if not path.read_bytes().isascii()] == []

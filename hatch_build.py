"""Builds what is made of other languages: the bundles of the front end, which an sdist has, and the compiled loops.

The description that an index of packages shows is made here too, of README.md.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

sys.path.insert(0, str(Path(__file__).resolve().parent))
import native_build
import node_tasks
import readme_links

_WITHOUT_NPM = (
    "The bundles of the front end are made in a clone, of packages from npm. Where that cannot be reached, install "
    "a wheel or an archive of the sources (deformnb_core-*.tar.gz), which have them, or copy the folder "
    "deformnb/widgets/static of a machine on which this commit was built."
)


class BuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Bundles before wheel and sdist are packed, and compiles before a wheel is."""

    def dependencies(self) -> list[str]:
        """Node.js and a C compiler from PyPI, where they are needed and the system has none."""
        needed = []
        try:
            if node_tasks.bundle_state().is_stale():
                node_tasks.system_node()
        except node_tasks.NodeError:
            needed.append(node_tasks.WHEEL)
        if self.target_name == "wheel" and not _skips_loops():
            target = _named_target()
            try:
                if native_build.is_stale(target):
                    native_build.find_compiler(crosses=target is not None)
            except native_build.MissingCompilerError:
                needed.append(native_build.WHEEL)
        return needed

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the bundles and the compiled loops if their sources have changed since.

        A wheel with compiled loops is one for this platform, or for the target that DEFORMNB_NATIVE_TARGET names, of
        any Python; without a C compiler it has none, and serves all platforms.
        """
        try:
            node_tasks.bundle()
        except node_tasks.NodeError as error:
            sys.exit(f"error: {error} {_WITHOUT_NPM}")
        if self.target_name != "wheel" or _skips_loops():
            return
        target = _named_target()
        try:
            library = native_build.build(target)
        except native_build.CompilerError as error:
            if target is not None:
                sys.exit(f"error: {error}")
            self.app.display_warning(f"without compiled loops: {error}")
            return
        if version != "editable":
            tag = native_build.own_target().tag if target is None else native_build.TARGETS[target].tag
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{tag}"
            build_data["force_include"][str(library)] = f"deformnb/native/lib/{library.name}"


class MetadataHook(MetadataHookInterface):
    """The README and the addresses of a package, which lead to the public home."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Fill in the fields that pyproject.toml calls dynamic."""
        public = readme_links.read_project(Path(self.root))["tool"]["deformnb"]["public"]
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        text = readme_links.absolute_links(text, public["repository"], metadata["version"])
        text = readme_links.add_binder(text, public["repository"], metadata["version"])
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
        metadata["urls"] = readme_links.public_urls(public)


def _skips_loops() -> bool:
    return os.environ.get("DEFORMNB_NATIVE", "").strip().lower() == "off"


def _named_target() -> str | None:
    name = os.environ.get(native_build.TARGET_VARIABLE) or None
    if name is not None and name not in native_build.TARGETS:
        sys.exit(f"error: {native_build.TARGET_VARIABLE}={name} is none of {', '.join(native_build.TARGETS)}")
    return name

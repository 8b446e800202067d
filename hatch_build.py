"""Builds what is made of other languages: the bundles of the front end, which an sdist has, and the compiled loops."""

from __future__ import annotations

import sys
import sysconfig
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).resolve().parent))
import native_build
import node_tasks


class BuildHook(BuildHookInterface):  # type: ignore[type-arg]
    """Bundles before wheel and sdist are packed, and compiles before a wheel is."""

    def dependencies(self) -> list[str]:
        """Node.js from PyPI, where it is needed and the system has none."""
        try:
            if node_tasks.bundle_state().is_stale():
                node_tasks.system_node()
        except node_tasks.NodeError:
            return [node_tasks.WHEEL]
        return []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the bundles and the compiled loops if their sources have changed since.

        A wheel with compiled loops is one for this platform, of any Python; without a C compiler it has none, and
        serves all platforms.
        """
        try:
            node_tasks.bundle()
        except node_tasks.NodeError as error:
            sys.exit(f"error: {error}")
        if self.target_name != "wheel":
            return
        try:
            native_build.build()
        except native_build.CompilerError as error:
            self.app.display_warning(f"without compiled loops: {error}")
        if version != "editable" and native_build.library_path().exists():
            build_data["pure_python"] = False
            build_data["tag"] = f"py3-none-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"

"""Bundles the front end when the package is built from a checkout; an sdist has the bundles."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

sys.path.insert(0, str(Path(__file__).resolve().parent))
import node_tasks


class BundleHook(BuildHookInterface):  # type: ignore[type-arg]
    """Bundles before wheel and sdist are packed."""

    def dependencies(self) -> list[str]:
        """Node.js from PyPI, where it is needed and the system has none."""
        try:
            if node_tasks.bundle_state().is_stale():
                node_tasks.system_node()
        except node_tasks.NodeError:
            return [node_tasks.WHEEL]
        return []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Make the bundles if the modules have changed since."""
        try:
            node_tasks.bundle()
        except node_tasks.NodeError as error:
            sys.exit(f"error: {error}")

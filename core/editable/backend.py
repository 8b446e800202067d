"""The build backend of a deformnb-core that leads to this tree: what requires it finds it, and no copy is installed."""

import os
import sys
from pathlib import Path
from typing import Any

TREE = Path(__file__).resolve().parents[2]
os.chdir(TREE / "core")
sys.path.insert(0, str(TREE))
import hatch_backend  # noqa: E402


def get_requires_for_build_wheel(config_settings: dict[str, Any] | None = None) -> list[str]:
    """Packages that the wheel is made with."""
    return hatch_backend.get_requires_for_build_editable()


def build_wheel(
    wheel_directory: str, config_settings: dict[str, Any] | None = None, metadata_directory: str | None = None
) -> str:
    """Write the wheel; returns its name."""
    return hatch_backend.build_editable(wheel_directory)

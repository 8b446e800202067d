"""The build backend of the distributions that are made of this tree: hatchling, with the tree as the root of each.

deformnb-core (``core/pyproject.toml``) has all files of the package. deformnb (``pyproject.toml``) has none: it
requires deformnb-core of its own version, with the extras that ``tool.deformnb.core`` names. In a clone, where nothing
of ours need be published, it requires the folder ``core``, and for an editable install ``core/editable``, whose wheel
leads to this tree. hatchling's metadata without a build is left out, which would lack that.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from hatchling.builders.constants import EDITABLES_REQUIREMENT
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder

TREE = Path(__file__).resolve().parent
PROJECT = Path.cwd()  # a front end calls a backend in the folder of pyproject.toml
HAS_FILES = PROJECT != TREE or not (TREE / "core").is_dir()
"""True for deformnb-core, whose archive of the sources has no folder of this name."""


class _SourceBuilder(SdistBuilder):
    """Archives of the sources, with the pyproject.toml of the built distribution and its backend at the root."""

    def get_default_build_data(self) -> dict[str, Any]:
        data = super().get_default_build_data()
        if PROJECT != TREE:
            del data["force_include"][str(TREE / "pyproject.toml")]
            data["force_include"] |= {str(PROJECT / name): name for name in ("pyproject.toml", "backend.py")}
        return data


def get_requires_for_build_sdist(config_settings: dict[str, Any] | None = None) -> list[str]:
    """Packages that an archive of the sources is made with."""
    return list(_SourceBuilder(str(TREE), config=_read_config()).config.dependencies)


def build_sdist(sdist_directory: str, config_settings: dict[str, Any] | None = None) -> str:
    """Write the archive of the sources; returns its name."""
    builder = _SourceBuilder(str(TREE), config=_read_config())
    return Path(next(builder.build(directory=sdist_directory, versions=["standard"]))).name


def get_requires_for_build_wheel(config_settings: dict[str, Any] | None = None) -> list[str]:
    """Packages that a wheel is made with."""
    return list(WheelBuilder(str(TREE), config=_read_config()).config.dependencies)


def build_wheel(
    wheel_directory: str, config_settings: dict[str, Any] | None = None, metadata_directory: str | None = None
) -> str:
    """Write the wheel; returns its name."""
    return _write_wheel(wheel_directory, "standard", _read_config(core="core"))


def get_requires_for_build_editable(config_settings: dict[str, Any] | None = None) -> list[str]:
    """Packages that the wheel of an editable install is made with."""
    return [*get_requires_for_build_wheel(), EDITABLES_REQUIREMENT]


def build_editable(
    wheel_directory: str, config_settings: dict[str, Any] | None = None, metadata_directory: str | None = None
) -> str:
    """Write the wheel of an editable install; returns its name."""
    return _write_wheel(wheel_directory, "editable" if HAS_FILES else "standard", _read_config(core="core/editable"))


def _write_wheel(folder: str, version: str, config: dict[str, Any]) -> str:
    return Path(next(WheelBuilder(str(TREE), config=config).build(directory=folder, versions=[version]))).name


def _read_config(*, core: str | None = None) -> dict[str, Any]:
    """The table of pyproject.toml, where deformnb requires deformnb-core.

    Parameters
    ----------
    core : folder of a clone that is required; without it the version is, as in an archive of the sources.
    """
    config = tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))
    if not HAS_FILES and not (TREE / "PKG-INFO").exists():  # which has what an archive requires
        project = config["project"]
        place = f"=={project['version']}" if core is None else f" @ {(TREE / core).as_uri()}"
        project["dynamic"].remove("dependencies")
        project["dependencies"] = [f"{config['tool']['deformnb']['core']}{place}"]
        if core is not None:  # without extras first: of this pip knows the folder when the lessons require the core
            project["dependencies"].insert(0, f"deformnb-core{place}")
        # The extras too: pip may come to them first, and would ask an index for what a clone has.
        project["optional-dependencies"] = {
            extra: [line + place if line.startswith("deformnb-core[") else line for line in lines]
            for extra, lines in project["optional-dependencies"].items()
        }
    return config

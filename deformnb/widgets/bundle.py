"""Bundles of the front end: one ES module and one style sheet for each widget.

esbuild makes them of the TypeScript in ``frontend/`` (``sh run bundle``). A wheel holds the bundles only; in a
checkout, where the modules are, a bundle of other modules than these is an error.

Python's standard library is all that this module needs: the build of the package loads it by its path.
"""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

FRONT_END = Path(__file__).parents[2] / "frontend"
"""The front end's folder, in a checkout."""

SOURCES = FRONT_END / "src"
"""Its modules."""

SHADERS = Path(__file__).parent / "glsl"
"""Text of shaders that the modules share with VTK's, in a checkout and in a wheel."""

BUNDLES = Path(__file__).parent / "static"

STAMP = BUNDLES / "sources.sha256"
"""The digest of the modules that the bundles were made of."""

_CURE = 'run "sh run bundle" in the checkout'


def bundle(name: str) -> str:
    """The bundle of this name, such as ``"editor.js"`` or ``"editor.css"``.

    Raises
    ------
    RuntimeError
        If it was not built, or of other sources than those next to it.
    """
    _check_fresh()
    return _text(name)


@cache
def _text(name: str) -> str:
    return (BUNDLES / name).read_text(encoding="utf-8")


@cache
def _check_fresh() -> None:
    """Check the bundles at the import of the first widget, so that no widget runs one of older sources."""
    if not STAMP.exists():
        raise RuntimeError(f"the front end has not been bundled: {_CURE}.")
    if (FRONT_END / "build.mjs").is_file() and is_stale():
        raise RuntimeError(f"the front end has changed since it was bundled: {_CURE}.")


def is_stale() -> bool:
    """Check whether the bundles are missing or were made of other sources than those of this checkout."""
    return not STAMP.exists() or STAMP.read_text(encoding="utf-8") != digest()


def digest() -> str:
    """SHA-256 of the names and the text of all sources."""
    found = hashlib.sha256()
    for path in sorted([*FRONT_END.glob("*.mjs"), *SOURCES.rglob("*"), *SHADERS.rglob("*")]):
        if path.suffix in (".ts", ".mjs", ".css", ".glsl"):
            found.update(f"{path.relative_to(FRONT_END.parent).as_posix()}\n".encode() + path.read_bytes() + b"\0")
    return found.hexdigest()

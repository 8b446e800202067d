"""Bundling of the widgets' JavaScript: text files joined into one module for each widget, without a build step.

A front end loads a widget's module from a blob, where relative imports do not work. So every file declares plain
functions, and only the last one of a widget has ``export default``.
"""

from __future__ import annotations

from functools import cache
from importlib.resources import files


@cache
def joined(*names: str) -> str:
    """The text of the files of these names in ``deformnb/widgets/js``, one after the other."""
    folder = files("deformnb.widgets") / "js"
    return "\n".join(f"// ---- {name}\n{(folder / name).read_text(encoding='utf-8')}" for name in names)


@cache
def style(*names: str) -> str:
    """The style sheets of these names, one after the other."""
    folder = files("deformnb.widgets") / "js"
    return "\n".join((folder / name).read_text(encoding="utf-8") for name in names)

"""Front ends of widgets as models of their own, so that a page receives and imports each of them once.

anywidget sends the script of a widget with every model, and a page holds what it has imported until it is left: each
run of a studio's cell would leave a copy. In a kernel of Jupyter all widgets of one front end share a model of it, and
what anywidget imports for each is a loader of a few lines (``frontend/src/module_loader.ts``).

Other hosts, such as the application and marimo, hold modules by their text themselves, or show the widgets of one
process in pages of which each knows only its own models. There a widget has its script.
"""

from __future__ import annotations

import hashlib
import sys
from functools import cache
from typing import Any

import ipywidgets as ipw
import traitlets

from deformnb.widgets.basic_widgets import shared
from deformnb.widgets.bundle import bundle
from deformnb.widgets.cell_widgets import running_shell


class FrontEndModule(ipw.Widget):  # type: ignore[misc]
    """The script and the style sheet of a front end; it has no view.

    Attributes
    ----------
    digest : of the script, by which a page knows it.
    """

    digest = traitlets.Unicode().tag(sync=True)
    script = traitlets.Unicode().tag(sync=True)
    style = traitlets.Unicode().tag(sync=True)


def module_traits(kind: Any) -> dict[str, Any]:
    """Traits with which widgets of a class take their front end from the shared model; none outside of a kernel.

    Examples
    --------
    >>> from deformnb.widgets import Editor
    >>> module_traits(Editor)
    {}
    """
    script, style = (getattr(kind, name, None) for name in ("_esm", "_css"))
    if not isinstance(script, str) or not _is_in_kernel():
        return {}
    module = shared(FrontEndModule, digest=_digest(script), script=script, style=style)
    return {"_esm": bundle("module_loader.js"), "_css": "", "module": module}


def _is_in_kernel() -> bool:
    """Check whether this is a kernel of Jupyter, to which all pages with its widgets are connected."""
    ipykernel = sys.modules.get("ipykernel.zmqshell")
    return ipykernel is not None and isinstance(running_shell(), ipykernel.ZMQInteractiveShell)


@cache
def _digest(script: str) -> str:
    return hashlib.sha256(script.encode()).hexdigest()

"""The widgets of a notebook's cell: a cell that runs again closes the widgets that it showed before.

ipywidgets holds every widget until it is closed. A studio or a view that is made again with each run of its cell would
leave its volume, its threads, its windows and its servers behind each time.
"""

from __future__ import annotations

import logging
import os
import sys
import threading
import weakref
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

import ipywidgets as ipw

from deformnb.widgets.basic_widgets import is_shared

_LOG = logging.getLogger(__name__)

_MAKING = threading.RLock()  # ipywidgets notifies one listener of new widgets

# By the cell's id and the name of the class, for anywidget makes a class of each widget: the run they were made in, and
# the widgets of that run.
CELL_WIDGETS: dict[tuple[str, str], tuple[str, list[weakref.ref[Any]]]] = defaultdict(lambda: ("", []))

_LAST_RESULTS = ("_", "__", "___")

_IS_PART = ContextVar("_IS_PART", default=False)


@contextmanager
def owned_widgets() -> Iterator[None]:
    """Context in which new widgets belong to a widget that closes them, and not to the cell that runs."""
    before = _IS_PART.set(True)
    try:
        yield
    finally:
        _IS_PART.reset(before)


def transfer_ownership(widget: Any) -> None:
    """Transfer a widget that a cell has made to another one, which closes it."""
    for cell, (run, shown) in CELL_WIDGETS.items():
        CELL_WIDGETS[cell] = (run, [reference for reference in shown if reference() is not widget])


def close_earlier_of_this_cell(widget: Any) -> None:
    """Close the widgets of this class that earlier runs of the running cell have made, and register this one.

    Call it when nothing can fail any more: where there is no new widget, the earlier one stays.
    """
    place = None if _IS_PART.get() else _cell_and_run()
    if place is None:
        return
    kind = type(widget)
    cell, run = (place[0], f"{kind.__module__}.{kind.__qualname__}"), place[1]
    last_run, shown = CELL_WIDGETS[cell]
    if run != last_run:
        for reference in shown:
            earlier = reference()
            if earlier is not None:
                if hasattr(earlier, "forward_view"):
                    earlier.forward_view(widget)
                earlier.close()
                _forget_output(earlier)
        shown = []
    CELL_WIDGETS[cell] = (run, [*shown, weakref.ref(widget)])


def running_shell() -> Any:
    """IPython's shell; None where no cell can run."""
    ipython = sys.modules.get("IPython")  # loaded where cells run; nothing else needs it
    return ipython.get_ipython() if ipython is not None else None


def _forget_output(widget: Any) -> None:
    """Take a closed widget out of the results of cells that IPython stores, which would hold its volume for good.

    Those are ``Out``, ``_12`` and the last three, ``_`` to ``___``, which become empty texts, as they are at first.
    """
    shell = running_shell()
    stored: list[dict[str, Any]] = [getattr(shell, name, {}) for name in ("user_ns", "user_ns_hidden")]
    outputs = stored[0].get("_oh", {})
    for number in [number for number, value in outputs.items() if value is widget]:
        del outputs[number]
    for names in stored:
        for name in [name for name, value in names.items() if name.startswith("_") and value is widget]:
            if name in _LAST_RESULTS:
                names[name] = ""
            else:
                del names[name]
    hook = getattr(shell, "displayhook", None)
    for name in _LAST_RESULTS:
        if getattr(hook, name, None) is widget:
            setattr(hook, name, "")


def _cell_and_run() -> tuple[str, str] | None:
    """Ids of the cell that runs and of its run, where the front end sends them."""
    shell = running_shell()
    parent: dict[str, Any] = getattr(shell, "get_parent", dict)() if shell is not None else {}
    cell = (parent.get("metadata") or {}).get("cellId")
    run = (parent.get("header") or {}).get("msg_id")
    return (cell, run) if isinstance(cell, str) and isinstance(run, str) else None


@contextmanager
def closed_on_failure(end: Callable[[], None]) -> Iterator[None]:
    """Close the widgets that this thread makes meanwhile, should it end with an error: no other code has them.

    Parameters
    ----------
    end : called before that.
    """
    made: list[Any] = []
    thread = threading.get_ident()
    with _MAKING:
        before = getattr(ipw.Widget, "_widget_construction_callback", None)

        def remember(widget: Any) -> None:
            if threading.get_ident() == thread:
                made.append(widget)
            if before is not None:
                before(widget)

        ipw.Widget.on_widget_constructed(remember)
        try:
            yield
        except BaseException:
            for close in [end, *(widget.close for widget in reversed(made) if not is_shared(widget))]:
                _try(close)
            raise
        finally:
            ipw.Widget.on_widget_constructed(before)


def _try(close: Callable[[], None]) -> None:
    try:
        close()
    except Exception:  # of half a widget; the first error is raised
        _LOG.exception("a widget that was not finished could not be closed")


def close_all(*widgets: Any) -> None:
    """Close widgets and boxes, and all that only they are made of: children, layouts, styles."""
    parts: dict[int, Any] = {}
    for widget in widgets:
        _collect(widget, parts)
    for part in parts.values():
        part.close()


def _collect(widget: Any, parts: dict[int, Any]) -> None:
    if id(widget) in parts or is_shared(widget):
        return
    is_widget = isinstance(widget, ipw.Widget)
    if is_widget:
        parts[id(widget)] = widget
    for child in getattr(widget, "children", ()):  # of a box, too, which is no widget
        _collect(child, parts)
    if is_widget:
        for name in ("layout", "style"):
            if widget.has_trait(name):
                _collect(getattr(widget, name), parts)


def with_png(bundle: Any, draw: Callable[[], bytes]) -> Any:
    """A widget's bundle of mime types with a PNG added; without it where it cannot be drawn.

    Where a program runs the notebook for later readers, the PNG takes the widget's place: such a program keeps the
    state of all widgets, and a page made from both shows nothing until scripts from the network run.

    Parameters
    ----------
    bundle : of ``_repr_mimebundle_``, alone or with metadata.
    draw : makes the PNG. Its errors are logged: a picture for later readers must not prevent the widget from being
        shown now.
    """
    data = bundle[0] if isinstance(bundle, tuple) else bundle
    if data is None:
        return bundle
    try:
        data["image/png"] = draw()
    except Exception:
        _LOG.exception("the static picture of a widget could not be drawn")
    else:
        if runs_for_later_readers():
            data.pop("application/vnd.jupyter.widget-view+json", None)
    return bundle


# Set in kernels of hosts that let nobody type and yet show widgets: Voila, which runs notebooks as nbconvert
# does but has a web page before it, and Databricks.
_PAGES_WITHOUT_INPUT = (
    "SERVER_SOFTWARE",
    "VOILA_BASE_URL",
    "VOILA_KERNEL_ID",
    "VOILA_PREHEAT",
    "DATABRICKS_RUNTIME_VERSION",
)


def runs_for_later_readers() -> bool:
    """Check whether a program runs this notebook without a user (nbconvert, nbclient, papermill, MyST-NB).

    With each cell, those forbid ``input()``; JupyterLab, Notebook, VS Code and Colab let their users
    type.
    """
    if any(name in os.environ for name in _PAGES_WITHOUT_INPUT):
        return False
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython is not None else None
    kernel = getattr(shell, "kernel", None)
    if kernel is None or not hasattr(kernel, "get_parent"):
        return False
    request = (kernel.get_parent("shell") or {}).get("content", {})
    return "code" in request and request.get("allow_stdin") is False

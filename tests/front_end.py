"""The part of a front end in tests without one: what a page would send to its widget."""

from __future__ import annotations

from typing import Any


def deliver(widget: Any, content: Any, buffers: Any = ()) -> None:
    """Let the widget receive a message; the method is ipywidgets', which has no public one for it."""
    widget._handle_custom_msg(content, list(buffers))

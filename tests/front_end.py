"""The part of a front end in tests without one: what a page would send to its widget."""

from __future__ import annotations

from typing import Any


def deliver(widget: Any, content: Any, buffers: Any = ()) -> None:
    """Let the widget receive a message by its comm, as of a kernel."""
    widget.comm.handle_msg({"content": {"data": {"method": "custom", "content": content}}, "buffers": list(buffers)})

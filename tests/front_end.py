"""Messages of a front end to its widget, for tests without one."""

from __future__ import annotations

from typing import Any

from deformnb.widgets.messages.editors import PointsEdit
from deformnb.widgets.messages.points import points_to_json


def deliver(widget: Any, content: Any, buffers: Any = ()) -> None:
    """Let the widget receive a message by its comm, as of a kernel."""
    widget.comm.handle_msg({"content": {"data": {"method": "custom", "content": content}}, "buffers": list(buffers)})


def deliver_edit(editor: Any, edit: PointsEdit) -> None:
    """Let an editor receive the message of an edit."""
    content = {name: getattr(edit, name) for name in ("sender", "seq", "phase", "kind", "joins")}
    ids = {"next_id": edit.points.next_id}
    deliver(editor, {"type": "edit", **content, **ids, "points": points_to_json(edit.points)})

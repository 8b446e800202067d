"""A front end that uploads a file, piece by piece as Python requests it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

from front_end import deliver

from deformnb.widgets.inputs.file_input import FileInput


def upload_file(widget: FileInput, name: str, content: bytes, *, cancel_at: int | None = None) -> list[dict[str, Any]]:
    """Upload a file and wait until it is received; returns the widget's messages.

    Parameters
    ----------
    cancel_at : number of the piece at which the user cancels.
    """
    sent: list[dict[str, Any]] = []
    send = widget.send
    widget.send = lambda content, buffers=None: sent.append(content)  # type: ignore[method-assign]
    try:
        receive = partial(deliver, widget)
        receive({"type": "begin", "id": "page-1", "name": name, "size": len(content)}, [])
        for k, request in enumerate(iter_requests(sent)):
            at, length = request["offset"], request["length"]
            if k == cancel_at:
                receive({"type": "cancel", "id": "page-1"}, [])
            else:
                receive({"type": "piece", "id": "page-1", "offset": at}, [memoryview(content[at : at + length])])
        widget.wait()
    finally:
        widget.send = send  # type: ignore[method-assign]
    return sent


def iter_requests(sent: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Requests for pieces in a list that grows, each once."""
    count = 0
    while len(found := [message for message in sent if message["type"] == "next"]) > count:
        yield found[count]
        count += 1

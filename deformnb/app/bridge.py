"""Bridge between the comms of the studio's widgets and trame's socket.

A widget exchanges messages with its front end through its comm. Here the comm is one of ours: the messages that the
widget sends are published to all connected pages, and those that a page sends are passed to the comm in the
application's thread. To the widget nothing is different.

Pages know the widgets that can be reached from the studio, and no others: each is given a comm of ours when the state
of another one first refers to it.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Iterator
from functools import partial
from typing import Any

import ipywidgets as ipw

from deformnb.errors import DeformError
from deformnb.widgets.synced import LocalComm, SyncedWidget
from deformnb.widgets.web.guard import Answer
from deformnb.widgets.web.server import PageServer
from deformnb.widgets.worker import Worker

TOPIC = "deformnb.comm"
"""Topic under which pages receive the messages of widgets."""

SETTABLE = {
    "BoundedFloatTextModel": {"value"},
    "BoundedIntTextModel": {"value"},
    "FloatTextModel": {"value"},
    "TextModel": {"value"},
    "TextareaModel": {"value"},
    "FloatSliderModel": {"value"},
    "FloatLogSliderModel": {"value"},
    "IntSliderModel": {"value"},
    "CheckboxModel": {"value"},
    "ToggleButtonModel": {"value"},
    "DropdownModel": {"index"},
    "SelectMultipleModel": {"index"},
}
"""Traits of ipywidgets that a client may set, by the name of the model. Our own widgets check their messages."""

_LONGEST_NAME = 64
_REFERENCE = "IPY_MODEL_"

_LOG = logging.getLogger(__name__)


class Bridge:
    """Between the studio of an application and the pages of one server.

    Parameters
    ----------
    studio : is shown.
    thread : executes the requests of clients.
    server : sends to the pages.
    """

    def __init__(self, studio: ipw.Widget, thread: Worker, server: PageServer) -> None:
        self._studio, self._thread, self._server = studio, thread, server
        self._answered = ""  # id of the message by a page that a widget takes now
        self._lock = threading.RLock()
        self._widgets: dict[str, ipw.Widget] = {}
        self._closed: set[str] = set()  # a client may still send to them until it has that message
        self._reach(studio)

    # -- for the server ------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Wait for a page."""

    def bundles(self) -> tuple[str, ...]:
        """Script and styles of the page; those of widgets come with their states."""
        return ("app.js", "app.css")

    def disconnect(self) -> None:
        """Drop the unfinished gestures of a client that has disconnected."""
        self._thread.call(self._studio.show_session)

    def answers(self) -> dict[str, Answer]:
        """Remote procedures of a page, by name; each checks its arguments."""
        return {"deformnb.open": self._open, "deformnb.comm": self._message}

    # -- to the pages --------------------------------------------------------------------------------------------------

    def _reach(self, widget: ipw.Widget) -> dict[str, dict[str, Any]]:
        """Open comms for a widget and all widgets of its state; returns the states of the new ones."""
        found: dict[str, dict[str, Any]] = {}
        waiting = [widget]
        with self._lock:
            while waiting:
                new = waiting.pop()
                if new.comm is None or new.model_id in self._widgets:  # a widget that is closed has none
                    continue
                name = new.model_id
                self._widgets[name] = new
                new.comm = LocalComm(partial(self._publish, name), comm_id=name)
                found[name] = new.get_state()
                waiting += [_find_widget(reference) for reference in _references(found[name])]
        return found

    def _publish(self, name: str, data: dict[str, Any], buffers: list[bytes]) -> None:
        message = {"widget": name, "data": data, "buffers": buffers}
        if data.get("method") == "echo_update":
            message["parent"] = self._answered
        with self._lock:
            opened: dict[str, Any] = {}
            for reference in _references(data.get("state", {})):
                opened |= self._reach(_find_widget(reference))
            if opened:
                message["opened"] = opened
                self._drop_closed()
            self._server.call_in_loop(self._server.publish, TOPIC, message)

    def _drop_closed(self) -> None:
        self._closed.update(name for name, widget in self._widgets.items() if widget.comm is None)
        self._widgets = {name: widget for name, widget in self._widgets.items() if widget.comm is not None}

    # -- from a page ---------------------------------------------------------------------------------------------------

    async def _open(self) -> dict[str, Any]:
        """The model id of the studio, and the states of all widgets."""

        def find_widget() -> dict[str, Any]:
            with self._lock:
                self._drop_closed()
                return {name: widget.get_state() for name, widget in self._widgets.items()}

        states = await asyncio.wrap_future(self._thread.call(find_widget))
        return {"studio": self._studio.model_id, "widgets": states}

    async def _message(self, name: str, data: dict[str, Any], number: str, buffers: list[bytes]) -> None:
        """A message by the front end of a widget; returns when the widget has taken it.

        Parameters
        ----------
        number : of the message; the echo of a state refers to it.
        """
        widget = self._widgets.get(name) if isinstance(name, str) else None
        if widget is None or widget.comm is None:
            if widget is not None or (isinstance(name, str) and name in self._closed):
                return
            raise DeformError("there is no such widget.")
        if not isinstance(number, str) or len(number) > _LONGEST_NAME:
            raise DeformError("a message has a number.")
        if not isinstance(buffers, list) or not all(isinstance(buffer, bytes) for buffer in buffers):
            raise DeformError("buffers are bytes.")
        taken = {
            "content": {"data": check_message(widget, data)},
            "buffers": [memoryview(buffer) for buffer in buffers],
        }
        await asyncio.wrap_future(self._thread.call(partial(self._take, widget, taken, number)))

    def _take(self, widget: ipw.Widget, message: dict[str, Any], number: str) -> None:
        """Pass a message to a widget, in the application's thread; the page's next one waits for that."""
        self._answered = number
        try:
            if widget.comm is not None:
                widget.comm.handle_msg(message)
        except Exception:
            _LOG.exception("a message of a page could not be answered")
        finally:
            self._answered = ""


def check_message(widget: ipw.Widget, data: Any) -> dict[str, Any]:
    """A page's message to a widget, with nothing in it that the widget's front end would not send.

    Raises
    ------
    DeformError
        If it is no update of traits that :data:`SETTABLE` has, and no message of the widget's own.
    """
    if not isinstance(data, dict) or data.get("method") not in ("update", "custom"):
        raise DeformError("a message updates traits, or is one of the widget's own.")
    if data["method"] == "custom":
        if not isinstance(data.get("content"), dict):
            raise DeformError("a message is an object.")
        return {"method": "custom", "content": data["content"]}
    state, paths = data.get("state"), data.get("buffer_paths", [])
    if not isinstance(state, dict) or not isinstance(paths, list):
        raise DeformError("an update has a state.")
    model = widget.get_state("_model_name")["_model_name"]
    if not isinstance(widget, SyncedWidget) and not state.keys() <= SETTABLE.get(model, set()):
        raise DeformError(f"a page cannot set {sorted(map(str, state))[0]:.40} of a {model}.")
    return {"method": "update", "state": state, "buffer_paths": paths}


def _references(state: Any) -> Iterator[str]:
    """References to widgets in a state."""
    if isinstance(state, str):
        if state.startswith(_REFERENCE):
            yield state
    elif isinstance(state, dict):
        for value in state.values():
            yield from _references(value)
    elif isinstance(state, (list, tuple)):
        for value in state:
            yield from _references(value)


def _find_widget(reference: str) -> Any:
    return ipw.widget_serialization["from_json"](reference, None)

"""Bridge between the widgets' comms and trame's socket, and from the client's controls to the application.

A widget exchanges messages with its front end through its comm. Here the comm is one of ours: the messages that the
widget sends are published to all connected clients, and those that a client sends are passed to the comm in the
application's thread. To the widget nothing is different.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from deformnb.app.application import NUMBERED, REQUESTS, Application
from deformnb.app.files import DOWNLOADS
from deformnb.app.panel_widgets import WIDGETS
from deformnb.errors import DeformError
from deformnb.widgets.inputs.base import is_whole
from deformnb.widgets.synced import LocalComm
from deformnb.widgets.web.guard import Answer
from deformnb.widgets.web.remote_area import for_area
from deformnb.widgets.web.server import PageServer

TOPIC = "deformnb.widget"
"""Topic under which clients receive messages for their widgets."""

_MOST_WAITING = 256  # messages of clients that wait for the application; a user on a slider never gets there
_LONGEST_NAME = 64

# Of the widgets' traits what belongs to Jupyter.
_OTHERS = ("layout", "tabbable", "tooltip", "comm")

_LOG = logging.getLogger(__name__)


class Bridge:
    """Between one application and the clients of one server.

    Parameters
    ----------
    app : whose widgets are shown.
    server : sends to the clients, and has trame's state and triggers.
    """

    def __init__(self, app: Application, server: PageServer) -> None:
        self.app, self._server = app, server
        self._waiting = 0
        self._newest: dict[str, int] = {}  # number of the last value that a client has set a control to
        self._done: dict[str, int] = {}  # and of the one that the application has come to
        for name, widget in app.widgets.items():
            widget.comm = LocalComm(partial(self._publish, name))
        app.changed = self._push_values
        self._remote = app.volumes.serve(app.fail, server.push_picture)
        with server.trame.state as state:
            state.update(app.state())

    # -- for the server ------------------------------------------------------------------------------------------------

    def start(self) -> None:
        """Send the clients what has changed before there was a loop."""
        self.app.thread.call(self._push_values)

    def assets(self) -> dict[str, tuple[str, str]]:
        """Scripts and styles of the widgets."""
        sheets = dict.fromkeys(str(widget._css) for widget in WIDGETS.values())
        return {**{f"/deformnb/{name}.js": (str(widget._esm), "text/javascript") for name, widget in WIDGETS.items()},
                "/deformnb/widgets.css": ("\n".join(sheets), "text/css")}

    def file(self, key: str) -> Path | None:
        """A file that the application has written for a client."""
        return self.app.files.path(key)

    def left(self) -> None:
        """A client has gone: its drag is given up."""
        self.app.thread.call(self.app.give_up)

    # -- to the clients ------------------------------------------------------------------------------------------------

    def _publish(self, name: str, data: dict[str, Any], buffers: list[bytes]) -> None:
        kind = data.get("method")
        if kind == "custom":
            message = {"widget": name, "content": data["content"], "buffers": buffers}
        elif kind == "update":  # echoes are for front ends that share a kernel; clients are informed in _relay
            message = {"widget": name, "state": _whole(data["state"], data.get("buffer_paths", []), buffers)}
        else:
            return
        self._server.in_loop(self._server.publish, TOPIC, message)

    def _push_values(self) -> None:
        """The application's values to the clients, but for those that a client has set anew meanwhile."""
        self._server.in_loop(self._push, self.app.state())

    def _push(self, values: dict[str, Any]) -> None:
        with self._server.trame.state as state:
            state.update({name: value for name, value in values.items()
                          if self._newest.get(name) == self._done.get(name)})

    # -- from a client -------------------------------------------------------------------------------------------------

    def answers(self) -> dict[str, Answer]:
        """Remote procedures of a client, by name; each checks its arguments."""
        return {"deformnb.open": self._open, "deformnb.message": self._message, "deformnb.state": self._state,
                "trame.state.update": self._set, "trame.trigger": self._trigger,
                "trame.rca.size": for_area(self._size), "trame.rca.event": for_area(self._event),
                "deformnb.seen": for_area(self._remote.seen),
                "deformnb.look": self.app.volumes.look,
                "deformnb.write": self._write, "deformnb.take": self._take}

    def _write(self, kind: str, page: str) -> None:
        if not isinstance(kind, str) or kind not in DOWNLOADS or not isinstance(page, str) or len(page) > _LONGEST_NAME:
            raise DeformError("there is no such file.")
        self._later(lambda: self.app.write(kind, page))

    def _take(self, document: str) -> None:
        if not isinstance(document, str):
            raise DeformError("a saved session is text.")
        self._later(lambda: self.app.open(document))

    def _size(self, origin: str, size: dict[str, Any]) -> None:
        is_first = not self._remote.is_used
        self._remote.update_size(size)
        if is_first:
            self._later(self.app.volumes.wake)

    def _event(self, origin: str, event: dict[str, Any]) -> None:
        self._remote.on_event(event)

    async def _open(self, name: str) -> dict[str, Any]:
        """All that a client needs of a widget to show it."""
        widget = self._widget(name)

        def look() -> dict[str, Any]:
            return {k: v for k, v in widget.get_state().items() if not k.startswith("_") and k not in _OTHERS}

        state = await asyncio.wrap_future(self.app.thread.call(look))
        return {"state": state, "models": {w.model_id: n for n, w in self.app.widgets.items()}}

    def _message(self, name: str, content: dict[str, Any]) -> None:
        self._widget(name)
        if not isinstance(content, dict):
            raise DeformError("a message is an object.")
        picture = self.app.pictures  # which one the client has done it on
        self._later(lambda: self.app.receive(name, {"method": "custom", "content": content}, picture))

    def _state(self, name: str, page: str, state: dict[str, Any]) -> None:
        self._widget(name)
        if not isinstance(state, dict) or not isinstance(page, str) or len(page) > _LONGEST_NAME:
            raise DeformError("a change of state names its page.")

        def take() -> None:
            try:
                self.app.receive(name, {"method": "update", "state": state, "buffer_paths": []})
            finally:  # taken or refused: the client of origin goes before what we send of these until it gets this
                now = self.app.widgets[name].get_state(list(state.keys() & self.app.widgets[name].keys))
                self._server.in_loop(self._server.publish, TOPIC, {"widget": name, "state": now, "origin": page})

        self._later(take)

    def _set(self, changes: list[dict[str, Any]]) -> None:
        """trame's message of variables that a client has changed: our controls, and nothing else."""
        if not isinstance(changes, list) or len(changes) > len(self.app.parameters):
            raise DeformError("a list of changes.")
        for change in changes:
            name = change["key"]
            if not isinstance(name, str) or name not in self.app.parameters:
                raise DeformError("it is no control.")
            value = self.app.parameters[name].checked(change.get("value"))
            self._newest[name] = number = self._newest.get(name, 0) + 1
            self._later(partial(self._set_one, name, value, number))
            # Other clients follow; the one that has set it is ahead of us, informed only of refusals. trame looks
            # the client of the last message when it sends, not now, and may so leave out another: hence twice.
            self._server.root.push_state_change({name: value}, skip_last_active_client=True)
            for client in self._server.others():
                self._server.publish("trame.state.topic", {name: value}, client_id=client)
            with self._server.trame.state as state:
                state[name] = value

    def _set_one(self, name: str, value: Any, number: int) -> None:
        if number == self._newest[name]:  # else one waits that takes its place
            self._done[name] = number
            self.app.set(name, value)

    async def _trigger(self, name: str, args: list[Any], kwargs: dict[str, Any]) -> Any:
        fits = isinstance(args, list) and len(args) == (name in NUMBERED) and all(map(is_whole, args))
        if name not in (*REQUESTS, *NUMBERED) or not fits or kwargs:
            raise DeformError("no action of the page.")
        if name != "save":
            self._later(lambda: self.app.act(name, *args))
            return None
        return await asyncio.wrap_future(self.app.thread.call(self.app.document))

    def _widget(self, name: Any) -> Any:
        if not isinstance(name, str) or name not in self.app.widgets:
            raise DeformError("there is no such widget.")
        return self.app.widgets[name]

    def _later(self, work: Callable[[], None]) -> None:
        """Run a function in the application's thread."""
        if self._waiting >= _MOST_WAITING:
            raise DeformError("too much waits to be done.")
        self._waiting += 1

        def done() -> None:
            try:
                work()
            except DeformError as error:
                _LOG.warning("a message of the client was dropped: %s", error)
            except Exception:
                _LOG.exception("a message of the client could not be answered")
            finally:
                self._server.in_loop(self._one_less)

        self.app.thread.call(done)

    def _one_less(self) -> None:
        self._waiting -= 1


def _whole(state: dict[str, Any], paths: list[list[Any]], buffers: list[bytes]) -> dict[str, Any]:
    """A state update with its bytes in their places; here they travel inside of messages."""
    whole = dict(state)
    for path, buffer in zip(paths, buffers, strict=True):
        if len(path) != 1:
            raise ValueError(f"bytes within a trait, at {json.dumps(path)}")
        whole[path[0]] = buffer
    return whole

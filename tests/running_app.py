"""An application's server in a thread of this process, and a client of its protocol without a browser."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import sys
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from types import TracebackType
from typing import Any

import aiohttp
import msgpack
from waiting import PATIENCE

from deformnb.app.application import Application, app_server
from deformnb.session.session import Session
from deformnb.widgets.studio.studio import Studio
from deformnb.widgets.web.server import PageServer

# Python alone: neither env nor a shell gives an ignored signal its default back on each system.
_DEFAULT_SIGNALS = """
import os, signal, sys
for name in ("SIGHUP", "SIGINT"):
    signal.signal(getattr(signal, name), signal.SIG_DFL)
os.execv(sys.argv[1], sys.argv[1:])
"""


def terminal_command(command: list[str]) -> list[str]:
    """The command with the signals of a terminal at their defaults: under nohup, and in the background of a shell, they
    are ignored, and each child inherits that.
    """
    return [sys.executable, "-I", "-S", "-c", _DEFAULT_SIGNALS, *command]


class RunningApp:
    """Server of an application from entering the context until leaving it, closed then."""

    def __init__(self, application: Application, **options: Any) -> None:
        self.application = application
        self._options = options
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self.error: BaseException | None = None
        self.server: PageServer

    def _serve(self) -> None:
        async def run() -> None:
            self.server = app_server(self.application, **self._options)
            await self.server.run(lambda _: self._ready.set())

        try:
            asyncio.run(run())
        except BaseException as error:  # reported by the test that waits for it
            self.error = error
        finally:
            self._ready.set()

    def __enter__(self) -> RunningApp:
        self._thread.start()
        assert self._ready.wait(PATIENCE)
        if self.error is not None:
            raise self.error
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.server.stop()
        self.wait_end()
        self.application.close()
        if self.error is not None and error is None:
            raise self.error

    def wait_end(self, seconds: float = PATIENCE) -> None:
        """Wait for the end of the server."""
        self._thread.join(seconds)
        assert not self._thread.is_alive()

    @property
    def name(self) -> str:
        """Host and port."""
        return f"127.0.0.1:{self.server.port}"

    @property
    def session(self) -> Session:
        """The model that is edited."""
        return self.application.session

    @property
    def studio(self) -> Studio:
        """The studio that the clients show."""
        return self.application.studio

    def wait_idle(self) -> None:
        """Wait until the application has completed all requests so far."""
        self.application.thread.call(lambda: None).result(PATIENCE)
        self.studio.wait(PATIENCE)


def frame(content: Any) -> bytes:
    """A message as wslink sends it: number, place of the piece, size of the whole, and the content."""
    body = content if isinstance(content, bytes) else msgpack.packb(content)
    return b"\x01\x00\x00\x00" + (0).to_bytes(4, "little") + len(body).to_bytes(4, "little") + body


class Socket:
    """The client's end of the connection."""

    def __init__(self, socket: aiohttp.ClientWebSocketResponse) -> None:
        self.socket = socket
        self.inbox: list[dict[str, Any]] = []
        self._count = 0

    async def send(self, method: str, *args: Any, system: bool = False, **extra: Any) -> str:
        """Call a procedure without waiting; returns the call's id."""
        self._count += 1
        number = f"{'system' if system else 'rpc'}:c0:{self._count}"
        await self.socket.send_bytes(
            frame({"wslink": "1.0", "id": number, "method": method, "args": list(args), "kwargs": {}, **extra})
        )
        return number

    async def answer(self, number: str) -> dict[str, Any]:
        """The reply to a call; other messages received are stored in ``inbox``."""
        while True:
            content = await self.next()
            if content["id"] == number:
                return content
            self.inbox.append(content)

    async def next(self) -> dict[str, Any]:
        """The next message of any kind."""
        message = await asyncio.wait_for(self.socket.receive(), PATIENCE)
        if message.type != aiohttp.WSMsgType.BINARY:
            raise ConnectionError(f"closed with code {self.socket.close_code}")
        parts = [message.data]
        while sum(len(p) - 12 for p in parts) < int.from_bytes(parts[0][8:12], "little"):
            parts.append((await asyncio.wait_for(self.socket.receive(), PATIENCE)).data)
        content: dict[str, Any] = msgpack.unpackb(b"".join(p[12:] for p in parts))
        return content

    async def call(self, method: str, *args: Any) -> Any:
        """Call a procedure and return its result, or the error as a dictionary."""
        answer = await self.answer(await self.send(method, *args))
        return answer["result"] if "result" in answer else answer["error"]

    async def login(self, secret: Any) -> bool:
        """Check whether the server accepts a password."""
        answer = await self.answer(await self.send("wslink.hello", {"secret": secret}, system=True))
        return "result" in answer


async def await_message(page: Socket, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Wait for the first message published to a client that is wanted."""
    for message in page.inbox:
        if wanted(message):
            return message
    while True:
        message = await page.next()
        page.inbox.append(message)
        if wanted(message):
            return message


def edit_message(points: list[dict[str, Any]], seq: int = 1, phase: str = "end") -> dict[str, Any]:
    """A client's message of the points of an editor."""
    return {
        "type": "edit",
        "sender": "window",
        "seq": seq,
        "phase": phase,
        "kind": "move",
        "joins": False,
        "next_id": len(points),
        "points": points,
    }


@contextlib.asynccontextmanager
async def connect(
    running: RunningApp, *, origin: str | None = "", host: str | None = None, secret: Any = ""
) -> AsyncIterator[Socket]:
    """A socket of the application: from its own origin and with its password by default.

    ``origin`` None sends none, ``secret`` None does not log in.
    """
    headers = {} if host is None else {"Host": host}
    if origin is not None:
        headers["Origin"] = origin or f"http://{running.name}"
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(f"http://{running.name}/ws", headers=headers, max_msg_size=0) as socket,
    ):
        page = Socket(socket)
        if secret is not None:
            assert await page.login(secret or running.server.token)
        yield page


@contextlib.contextmanager
def fetch(running: RunningApp, path: str, **headers: str) -> Iterator[tuple[int, dict[str, str], str]]:
    """Status, headers and text of a request."""

    async def get() -> tuple[int, dict[str, str], str]:
        async with (
            aiohttp.ClientSession() as session,
            session.get(f"http://{running.name}{path}", headers=headers, allow_redirects=False) as response,
        ):
            return response.status, dict(response.headers), await response.text()

    yield asyncio.run(get())


HANDSHAKE = {
    "Origin": "http://{name}",
    "Upgrade": "websocket",
    "Connection": "Upgrade",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "MDEyMzQ1Njc4OWFiY2RlZg==",
}


def http_request(name: str, path: str = "/ws", method: str = "GET", **headers: str) -> bytes:
    """The bytes of a request."""
    lines = [f"{key}: {value.format(name=name)}" for key, value in {"Host": name, **headers}.items()]
    return "\r\n".join([f"{method} {path} HTTP/1.1", *lines, "", ""]).encode()


def open_connection(name: str, request: bytes, receive_buffer: int | None = None) -> socket.socket:
    """A connection on which these bytes were sent."""
    made = socket.socket()
    if receive_buffer is not None:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
    made.settimeout(PATIENCE)
    host, port = name.split(":")
    try:
        made.connect((host, int(port)))
        made.sendall(request)
    except OSError:
        made.close()
        raise
    return made

"""Web server of one session or one view: trame's, with its access restricted by the guard."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import os
import secrets
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any, Protocol

from aiohttp import web

from deformnb.errors import DeformError
from deformnb.widgets.bundle import bundle
from deformnb.widgets.web.addresses import SECRET_HEADER, own_names
from deformnb.widgets.web.guard import LONGEST_REQUEST, Answer, RefusedByServer, SiteGuard
from deformnb.widgets.web.remote_area import AREA

_LIFE = ("client_connected", "client_mounted", "client_unmounted", "client_exited")
_KINDS = {".js": "text/javascript", ".css": "text/css"}
_LOOK_EVERY = 1.0  # seconds between checks of the clients

_LONG = frozenset({"deformnb.comm"})  # edits with many points, saved sessions

_LOG = logging.getLogger(__name__)


class Content(Protocol):
    """Content of a server: the page, and the answers to the messages of its clients."""

    def start(self) -> None:
        """Begin: clients can be sent messages from now on. Called in the thread of the server's event loop."""

    def answers(self) -> dict[str, Answer]:
        """Remote procedures of a client, by name; each checks its arguments."""

    def bundles(self) -> tuple[str, ...]:
        """Bundles that the page loads as files of the folder ``deformnb``."""

    def disconnect(self) -> None:
        """A client has left."""


class PageServer:
    """Serves pages to browsers that know this start's password.

    Parameters
    ----------
    make : makes the content for this server, and gives :attr:`trame` its page.
    host, port : where to listen; port 0 takes a free one.
    framed_by : the one origin whose pages may show ours in a frame; else nobody's may.
    idle : seconds without a page after which the server ends; 0 never does.
    token : the password, which the page of the start has; default is a new one.
    earlier : digests of passwords of earlier starts, whose pages are let in again.
    facts : what a page that is loading shows: "name" and "still", the URL of a picture.

    Attributes
    ----------
    trame : trame's own server, for its state and its page.
    root : wslink's protocol of the server, while it runs; see :meth:`publish`.
    content : the result of ``make``.
    guard : who is let in; ``guard.refused_count`` counts the messages that were refused.
    url : of the page, with its password; empty before the server runs.
    reason : why it ended.
    """

    def __init__(
        self,
        make: Callable[[PageServer], Content],
        *,
        idle: float,
        host: str = "127.0.0.1",
        port: int = 0,
        framed_by: str = "'none'",
        token: str = "",
        earlier: Sequence[str] = (),
        facts: Mapping[str, Any] | None = None,
    ) -> None:
        from trame.app import get_server

        self.host, self.idle = host, idle or math.inf
        self.url, self.reason = "", ""
        self.token = token or secrets.token_urlsafe(32)
        self.root: Any = None
        self.guard = SiteGuard(self.token, framed_by, earlier)
        self._facts = dict(facts or {})
        self._wanted_port = port
        self._parent = None if _outlives_its_terminal() else os.getppid()
        self._end = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None
        self.trame = get_server(f"deformnb-{secrets.token_hex(8)}", client_type="vue3", ws_max_msg_size=LONGEST_REQUEST)
        self.trame.add_protocol_to_configure(self._configure)
        self.trame.controller.on_server_bind.add(self._bind)
        self.content = make(self)

    @property
    def port(self) -> int:
        """The port that is listened at."""
        return int(self.trame.port)

    # -- life ----------------------------------------------------------------------------------------------------------

    async def run(self, ready: Callable[[str], None] | None = None) -> None:
        """Serve until something ends it.

        Parameters
        ----------
        ready : called with the address once pages can come.
        """
        self._loop = asyncio.get_running_loop()
        if self.reason:  # it was stopped before it began
            return
        with _quiet(), self._signals():
            serving = asyncio.ensure_future(self._start())
            started = asyncio.ensure_future(self.trame.ready)
            await asyncio.wait({serving, started}, return_when=asyncio.FIRST_COMPLETED)
            if serving.done():
                started.cancel()
                await serving  # raises what went wrong
                raise DeformError("the server ended before it began.")
            name = f"[{self.host}]" if ":" in self.host else self.host
            self.url = f"http://{name}:{self.port}/index.html?secret={self.token}&reconnect=auto"
            try:
                if ready is not None:
                    ready(self.url)
                await self._watch(serving)
            finally:
                self.root = None
                await self.guard.end(asyncio.ensure_future(self.trame.stop()))
                await serving

    def stop(self, reason: str = "on request") -> None:
        """End the server; may be called from any thread."""
        self.reason = self.reason or reason
        self.call_in_loop(self._end.set)

    def _start(self) -> Any:
        with _no_arguments():  # trame reads the command line, where it would find options of ours
            return self.trame.start(
                port=self._wanted_port,
                host=self.host,
                thread=True,
                open_browser=False,
                show_connection_info=False,
                disable_logging=True,
                backend="aiohttp",
                exec_mode="coroutine",
                timeout=0,
            )

    async def _watch(self, serving: asyncio.Future[Any]) -> None:
        last, before = time.monotonic(), set[str]()
        while not (self._end.is_set() or serving.done()):
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._end.wait(), min(_LOOK_EVERY, self.idle / 4))
            known = self.guard.clients
            last = time.monotonic() if known else last
            if before - known:
                self.content.disconnect()
            before = known
            if time.monotonic() - last > self.idle:
                self.stop(f"no page was connected for {self.idle / 60:.3g} minutes")
            if self._parent not in (None, os.getppid()):
                self.stop("the program that started it has ended")
            await self.guard.disconnect_idle()

    @contextlib.contextmanager
    def _signals(self) -> Iterator[None]:
        loop, caught = asyncio.get_running_loop(), []
        reasons = {"SIGINT": "Ctrl-C", "SIGTERM": "by the system", "SIGHUP": "the terminal was closed"}
        for name, why in reasons.items():
            number = getattr(signal, name, None)
            # Signals belong to the main thread; tests run a server in another.
            with contextlib.suppress(NotImplementedError, RuntimeError, ValueError):
                if number is not None and not (name == "SIGHUP" and _outlives_its_terminal()):
                    loop.add_signal_handler(number, self.stop, why)
                    caught.append(number)
        try:
            yield
        finally:
            for number in caught:
                loop.remove_signal_handler(number)

    # -- to the clients ------------------------------------------------------------------------------------------------

    def call_in_loop(self, function: Callable[..., Any], *args: Any) -> None:
        """Call a function in the server's thread, from any thread."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # it has ended, and its loop with it
                self._loop.call_soon_threadsafe(function, *args)

    def publish(self, topic: str, message: dict[str, Any]) -> None:
        """Send a message to all clients; in the server's thread."""
        if self.root is not None:
            self.root.publish(topic, message)

    def push_picture(self, jpeg: bytes, about: dict[str, Any]) -> None:
        """Send a picture to trame's remote controlled area, from any thread."""
        self.call_in_loop(lambda: self.root and self.trame.protocol_call("trame.rca.push", AREA, about, jpeg))

    # -- trame's own server, made narrow -------------------------------------------------------------------------------

    def _configure(self, root: Any) -> None:
        root.registerLinkProtocol(self.guard.password_check)
        self.root = root
        self.content.start()

    def _bind(self, served: Any) -> None:
        """Called by trame when its web server is made and has not begun to listen."""
        self.trame.protocol.updateSecret(self.token)
        served.config["ws_compress"] = False  # voxels and pictures are packed already
        self.guard.bind(served, self._answers, lambda: own_names(self.host, self.port), _LONG)
        own = {f"/deformnb/{name}": (bundle(name), _KINDS[Path(name).suffix]) for name in self.content.bundles()}
        pages = {**_assets(), **own}
        served.app.router.add_routes([web.get(path, _serve(*page)) for path, page in pages.items()])
        served.app.router.add_get("/deformnb/start", self._start_facts)

    async def _start_facts(self, request: web.Request) -> web.Response:
        """The state of the start, which is over, for a page that is loading or has outlived another server."""
        if not self.guard.password_check.accepts(request.headers.get(SECRET_HEADER)):
            return web.Response(status=403, text="refused: another password\n")
        return web.json_response({**self._facts, "state": "ready"})

    def _answers(self, offered: Mapping[str, tuple[Any, Any]]) -> dict[str, Answer]:
        """Remote procedures of a client: trame's state, and those of the content."""
        state, state_of = offered["trame.state.get"]

        def life(name: str) -> None:
            if name not in _LIFE:
                raise DeformError("no stage of a page's life.")

        def failed(message: str) -> None:
            _LOG.error("the page reports: %.300s", " ".join(str(message).split()))

        return {
            "trame.state.get": lambda: state_of(state),
            "trame.lifecycle.update": life,
            "trame.error.client": failed,
            **self.content.answers(),
        }


def _outlives_its_terminal() -> bool:
    """Check whether the server should stay when the terminal is closed, as nohup requests."""
    return hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def _serve(text: str, kind: str) -> Callable[[web.Request], Any]:
    async def answer(request: web.Request) -> web.Response:
        return web.Response(text=text, content_type=kind)

    return answer


def _assets() -> dict[str, tuple[str, str]]:
    """Our part of every page by its path: text and content type."""
    page = (files("trame_client.module") / "vue3-www" / "index.html").read_text(encoding="utf-8")
    own, found = page.replace("<head>", '<head><script src="deformnb/access.js"></script>'), page.count("<head>")
    if found != 1:
        raise DeformError("the page of this version of trame-client is not as expected; install version 4.1.")
    # Its only script within the page draws a waiting sign, which our policy would refuse with a warning.
    start, end = own.rindex("<script>"), own.rindex("</script>") + len("</script>")
    index = own[:start] + own[end:]
    return {
        "/": (index, "text/html"),
        "/index.html": (index, "text/html"),
        "/deformnb/access.js": (bundle("access.js"), "text/javascript"),
    }


@contextlib.contextmanager
def _no_arguments() -> Iterator[None]:
    argv, kept = sys.argv, os.environ.pop("TRAME_ARGS", None)
    sys.argv = argv[:1]
    try:
        yield
    finally:
        sys.argv = argv
        if kept is not None:
            os.environ["TRAME_ARGS"] = kept


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """No log of requests, whatever the level of logging: an address holds the password; a line for refused ones."""
    log = logging.getLogger("aiohttp.access")
    before, log.disabled = log.disabled, True
    refused, others = RefusedByServer(), [logging.getLogger(name) for name in RefusedByServer.LOGGERS]
    for other in others:
        other.addFilter(refused)
    try:
        yield
    finally:
        log.disabled = before
        for other in others:
            other.removeFilter(refused)

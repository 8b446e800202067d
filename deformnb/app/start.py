"""Start of the application: its address is printed, and its page served, before anything heavy is imported or read.

Until the studio can be shown, a small server answers at the address: with a page that shows the name of the volume,
what is being done and how far it is, a picture once there is one, and the error should the volume not be readable.
Then the server of the application takes its place, and its password.

Of each volume the port and a digest of the password are stored in the folder of the user: the next start takes the same
port, and lets the pages in that have outlived the last server, which go on by themselves.
"""

from __future__ import annotations

import contextlib
import hashlib
import html
import http.server
import json
import math
import os
import secrets
import sys
import tempfile
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from deformnb._packages import describe_missing
from deformnb.app import IDLE_MINUTES
from deformnb.errors import DeformError, MissingPackageError
from deformnb.io.files.folders import state_home
from deformnb.widgets.bundle import bundle
from deformnb.widgets.web.addresses import (
    SECRET_HEADER,
    checked_host,
    digest_of,
    headers_for,
    is_loopback,
    is_password,
    own_names,
)
from deformnb.words import language as chosen_language
from deformnb.words import translate

MOST_EARLIER = 4
"""Passwords of earlier starts that are let in."""

_FAREWELL = 3.0
"""Seconds that an error waits for a page that was there as long ago at most."""

_REQUEST_SECONDS = 10.0
"""That a connection may take to send a request."""

_PAGE = """<!doctype html><html lang="en"><head><meta charset="utf-8"><script src="deformnb/access.js"></script>
<meta name="viewport" content="width=device-width, initial-scale=1"><title>deformnb</title></head>
<body><div id="app"></div><script src="deformnb/start.js"></script></body></html>"""


def check_app(host: str, port: int, side: str | None, idle: float = IDLE_MINUTES) -> str:
    """The address to listen at, or the error in the options, before a volume is read.

    Raises
    ------
    DeformError
        For an address, a port, a side or a time that cannot be.
    MissingPackageError
        If trame, which serves the application, is not installed.
    """
    if find_spec("trame_rca") is None:
        raise MissingPackageError(describe_missing("trame_rca"))
    if not 0 <= port < 2**16:
        raise DeformError(f"a port is a number from 0 to 65535, got {port}; 0 takes a free one.")
    if side is not None:
        from deformnb.volume.views import VIEWS

        if side not in VIEWS:
            raise DeformError(f"unknown side {side!r}; choose one of {', '.join(VIEWS)}.")
    if not (idle >= 0 and math.isfinite(idle)):
        raise DeformError(f"--idle takes minutes, 0 for never, got {idle:g}.")
    return checked_host(host)


class StartRecord:
    """Port and passwords of the earlier starts with a volume, in a file that only its user may read.

    Parameters
    ----------
    subject : the path of the volume, or another name of it.
    host : the address to listen at.

    Attributes
    ----------
    port : of the last start, 0 if there was none.
    passwords : their digests, the newest first.

    Examples
    --------
    >>> StartRecord("carp", "127.0.0.1").port
    0
    """

    def __init__(self, subject: str, host: str) -> None:
        name = hashlib.sha256(f"{host} {subject}".encode()).hexdigest()[:24]
        self._path = state_home() / "starts" / f"{name}.json"
        self.port, self.passwords = 0, list[str]()
        with contextlib.suppress(OSError, ValueError, TypeError, LookupError):
            found = json.loads(self._path.read_text("utf-8"))
            self.port = int(found["port"]) if 0 < int(found["port"]) < 2**16 else 0
            self.passwords = [str(one) for one in found["passwords"]][:MOST_EARLIER]

    def store(self, port: int, token: str) -> None:
        """Store the port and the password of this start; without a folder to write to, pages do not go on later."""
        passwords = [digest_of(token), *self.passwords][:MOST_EARLIER]
        with contextlib.suppress(OSError):
            self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=self._path.parent)  # only its owner may read it
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                json.dump({"port": port, "passwords": passwords}, file)
            Path(name).replace(self._path)


class StartServer:
    """Page of an application that is starting.

    Parameters
    ----------
    name : of the volume.
    host, port : where to listen; port 0 takes that of the last start with this volume if it is free, else any.
    subject : the path of the volume, or another name of it, by which the next start finds this one.
    language : of the page; default is the one that was chosen.

    Attributes
    ----------
    token : the password of this start; earlier : digests of those of earlier ones.
    port : that is listened at.
    facts : what the page shows.

    Raises
    ------
    OSError
        If the port cannot be had.

    Examples
    --------
    >>> start = StartServer("carp")
    >>> start.progress("read carp.nii", 0.5)
    >>> start.close()
    """

    def __init__(
        self, name: str, host: str = "127.0.0.1", port: int = 0, subject: str = "", language: str | None = None
    ) -> None:
        self._language = chosen_language(language)
        self.host, self.token = host, secrets.token_urlsafe(32)
        self._record = StartRecord(subject or name, host)
        self.earlier: Sequence[str] = self._record.passwords
        self.facts: dict[str, Any] = {"state": "loading", "name": name, "text": "", "progress": None}
        self.facts["opening"] = translate("Opening the studio …", self._language)
        self._asked = -math.inf  # when a page was last there
        self._has_failed = threading.Event()
        self._server = self._listen(port)
        self.port = int(self._server.server_address[1])
        self._record.store(self.port, self.token)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), daemon=True)
        self._thread.start()

    def _listen(self, port: int) -> http.server.ThreadingHTTPServer:
        wanted = [port] if port else [*([self._record.port] if self._record.port else []), 0]
        for number in wanted[:-1]:
            with contextlib.suppress(OSError):
                return _Listener((self.host, number), self)
        return _Listener((self.host, wanted[-1]), self)

    @property
    def url(self) -> str:
        """The address of the page, with the password."""
        name = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{name}:{self.port}/index.html?secret={self.token}&reconnect=auto"

    def progress(self, text: str, share: float | None = None) -> None:
        """Show what is being done, and how far it is, from 0 to 1."""
        self.facts.update(text=translate(text, self._language), progress=share)

    def fail(self, message: str) -> None:
        """Show an error, and wait until a page that is there has it."""
        self.facts.update(state="failed", text=message, progress=None)
        if time.monotonic() - self._asked < _FAREWELL:
            self._has_failed.wait(_FAREWELL)
        self.close()

    def close(self) -> None:
        """Listen no more: the server of the application takes the port."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def answer(self, path: str, secret: str | None) -> tuple[int, str, bytes]:
        """Status, content type and content of what is requested."""
        if path == "/deformnb/start":
            if not is_password(secret, self.token, self.earlier):
                return 403, "text/plain", b"refused: another password\n"
            self._asked = time.monotonic()
            content = json.dumps(self.facts).encode()
            return 200, "application/json", content
        if path in ("/", "/index.html"):
            return 200, "text/html", _PAGE.encode()
        if path in ("/deformnb/access.js", "/deformnb/start.js"):
            return 200, "text/javascript", bundle(path.rpartition("/")[2]).encode()
        if path == "/favicon.ico":
            return 204, "image/x-icon", b""
        return 404, "text/plain", b"there is no such page\n"

    def answered(self, content: bytes) -> None:
        """Note that a page has received this content."""
        if b'"state": "failed"' in content:
            self._has_failed.set()


class _Listener(http.server.ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, address: tuple[str, int], start: StartServer) -> None:
        import socket

        self.start = start
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        super().__init__(address, _Answer)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Of a connection that was cut off."""


class _Answer(http.server.BaseHTTPRequestHandler):
    server: _Listener
    timeout = _REQUEST_SECONDS
    server_version, sys_version = "deformnb", ""

    def do_GET(self) -> None:
        start, name = self.server.start, self.headers.get("Host", "")
        if name not in own_names(start.host, start.port):
            self.send_error(403)
            return
        origin = self.headers.get("Origin")
        if origin is not None and origin != f"http://{name}":
            self.send_error(403)
            return
        status, kind, content = start.answer(self.path.partition("?")[0], self.headers.get(SECRET_HEADER))
        self.send_response(status)
        for key, value in headers_for(name).items():
            self.send_header(key, value)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)
        start.answered(content)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """No log: an address holds the password."""


@contextlib.contextmanager
def starting(
    name: str,
    *,
    host: str = "127.0.0.1",
    port: int = 0,
    browser: bool = True,
    idle: float = IDLE_MINUTES,
    subject: str = "",
    language: str | None = None,
) -> Iterator[StartServer]:
    """The page of a start, whose address is printed at once; an error within is shown there too.

    Parameters
    ----------
    name, host, port, subject, language : as of :class:`StartServer`.
    browser : whether to open a browser.
    idle : minutes without a page after which the application ends.

    Raises
    ------
    DeformError
        If the port cannot be had.
    """
    if not is_loopback(host):
        print_line(f"warning: anyone who reaches {host} and has the address below can use this session, unencrypted.")
    try:
        start = StartServer(name, host, port, subject, language)
    except OSError as error:
        raise port_error(host, port, error) from None
    with contextlib.ExitStack() as stack:
        announce(start.url, idle, stack if browser else None)
        try:
            yield start
        except DeformError as error:
            start.fail(str(error))
            raise
        except BaseException as error:
            start.fail(str(error) or type(error).__name__)
            raise


def port_error(host: str, port: int, error: OSError) -> DeformError:
    """The error of an address or a port that cannot be had."""
    return DeformError(f"{host} port {port or 'any'} cannot be had: {error.strerror or error}; choose another --port.")


def print_line(text: str) -> None:
    """Print a line for the terminal, if there is one."""
    with contextlib.suppress(OSError):  # the terminal is closed
        sys.stderr.write(f"deformnb: {text}\n")
        sys.stderr.flush()


def announce(url: str, idle: float, stack: contextlib.ExitStack | None) -> None:
    """Print where the page is, and open it in a browser until the stack ends."""
    sys.stdout.write(f"{url}\n")  # once, and never into a log: anyone with it can open the session
    sys.stdout.flush()
    alone = f", and so do {idle:g} minutes without a page (--idle)" if idle else ""
    print_line(f"open this address in a browser of this machine; Ctrl-C ends it{alone}.")
    if stack is not None:
        webbrowser.open(stack.enter_context(_redirect_file(url)).as_uri())


@contextlib.contextmanager
def _redirect_file(url: str) -> Iterator[Path]:
    """A file that leads to the address: arguments of a program, such as a browser, can be read by other users."""
    handle, name = tempfile.mkstemp(prefix="deformnb-", suffix=".html")  # only its owner may read it
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(
                f'<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" '
                f'content="0; url={html.escape(url)}"><title>deformnb</title>'
            )
        yield Path(name)
    finally:
        Path(name).unlink(missing_ok=True)


def stage_of(start: StartServer, name: str, move: Callable[[float], None]) -> Callable[[float], None]:
    """The progress of a piece of work, in the terminal and on the page.

    Parameters
    ----------
    name : of the work.
    move : shows it in the terminal.
    """
    start.progress(name, 0.0)

    def both(share: float) -> None:
        start.progress(name, min(max(float(share), 0.0), 1.0))
        move(share)

    return both

"""Emulations of notebooks that cannot be run here: frames for outputs, around a real kernel and ipywidgets' classes.

A server has the kernel and the page of the notebook. The page shows outputs in frames of other origins, with a policy
of what these may load. All that kernel and widgets send each other passes the page as messages, is delayed by half of a
round trip each way, and is refused where it is larger than the host's limit. What differs between hosts is in
:class:`Rules`; the frame's script is ``emulation/output_frame.js``, that of the page ``emulation/notebook_page.js``.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import struct
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import tornado.httpserver
import tornado.netutil
import tornado.web
import tornado.websocket
from jupyter_client.manager import AsyncKernelManager

import node_tasks

ROOT = Path(__file__).resolve().parents[2]
SOURCES = Path(__file__).with_name("emulation")


@dataclass(frozen=True)
class Theme:
    """Colours as a host gives them to the document of a frame: classes and attributes of the body, variables."""

    classes: str = ""
    attributes: dict[str, str] = field(default_factory=dict)
    variables: dict[str, str] = field(default_factory=dict)


# Those of "Dark Modern" and "Light Modern" that the widgets use.
_VS_CODE = {
    name: {
        f"--vscode-{part}": colours[column]
        for part, colours in {
            "editor-background": ("#1f1f1f", "#ffffff"),
            "editor-foreground": ("#cccccc", "#3b3b3b"),
            "descriptionForeground": ("#9d9d9d", "#3b3b3b"),
            "panel-border": ("#2b2b2b", "#e5e5e5"),
            "toolbar-hoverBackground": ("#5a5d5e50", "#b8b8b850"),
            "button-secondaryBackground": ("#313131", "#e5e5e5"),
            "button-secondaryHoverBackground": ("#3c3c3c", "#cccccc"),
            "input-background": ("#313131", "#ffffff"),
            "input-foreground": ("#cccccc", "#3b3b3b"),
        }.items()
    }
    for column, name in enumerate(("dark", "light"))
}


def vs_code_theme(kind: Literal["dark", "light"]) -> Theme:
    """The body of a webview of VS Code, with some of its variables."""
    name = "vs-dark" if kind == "dark" else "vs"
    return Theme(
        f"vscode-{kind}", {"data-vscode-theme-kind": f"vscode-{kind}", "data-vscode-theme-id": name}, _VS_CODE[kind]
    )


@dataclass(frozen=True)
class Rules:
    """The rules of a host.

    Parameters
    ----------
    outputs : one frame for all outputs of the notebook, or one for each.
    sandbox : attribute of the frames. Without ``allow-same-origin`` a frame has an origin that nothing shares, and
        neither cookies nor storage.
    policy : Content-Security-Policy of the frames.
    round_trip : of a message between page and kernel, seconds.
    limit : bytes of a message; a larger one is refused.
    cells : whether requests name the cell that runs.
    theme : of the frames.
    """

    outputs: Literal["one", "each"]
    sandbox: str
    policy: str
    round_trip: float = 0.1
    limit: int = 10_000_000
    cells: bool = True
    theme: Theme = Theme()


_STRICT = (
    "default-src 'none'; script-src blob: {own}; style-src 'unsafe-inline' {own}; img-src data: blob:; font-src data:; "
    "worker-src blob:"
)

VS_CODE = Rules(
    "one",
    "allow-scripts allow-same-origin allow-forms allow-pointer-lock allow-downloads",
    _STRICT,
    theme=vs_code_theme("dark"),
)
"""VS Code: a webview has all outputs of a notebook. Its own policy, where it is switched on, allows more."""

COLAB = Rules("each", "allow-scripts allow-forms allow-pointer-lock allow-downloads", _STRICT, cells=False)
"""Google Colab: a frame for each output, none of which reaches another. Colab's frames have an origin of their own with
storage, and no policy; these have neither."""


class EmulatedNotebook:
    """A notebook under the rules of a host, with a real kernel.

    Parameters
    ----------
    rules : of the host.
    folder : of the kernel and its saved sessions.
    """

    def __init__(self, rules: Rules, folder: Path) -> None:
        self.rules, self.folder = rules, folder
        self.refused: list[str] = []
        self.sizes: Counter[str] = Counter()
        """The largest message of each kind, bytes."""
        self.sockets: set[_Socket] = set()
        self._ready = threading.Event()
        self._failure: BaseException | None = None
        self._bundle()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)
        self._thread.start()
        self._ready.wait(120)
        if self._failure is not None:
            raise self._failure

    def _bundle(self) -> None:
        """The script and the style sheet of the frames, of the packages that the front end is bundled of."""
        node = node_tasks.need_package("esbuild", "--omit=dev")
        esbuild = node_tasks.FRONT_END / "node_modules" / "esbuild" / "bin" / "esbuild"
        subprocess.run(
            [node, str(esbuild), str(SOURCES / "output_frame.js"), f"--outdir={self.folder}", "--bundle",
             "--format=esm", "--log-level=error", "--loader:.svg=dataurl", "--loader:.png=dataurl"],
            env={**os.environ, "NODE_PATH": str(node_tasks.FRONT_END / "node_modules")},
            check=True,
        )  # fmt: skip

    # -- the server ----------------------------------------------------------------------------------------------------

    async def _serve(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        try:
            sockets = tornado.netutil.bind_sockets(0, "127.0.0.1")
            self.port = sockets[0].getsockname()[1]
            own = {"notebook": self}
            handlers: list[Any] = [
                ("/", _Page, own),
                ("/frame", _Frame, own),
                ("/kernel", _Socket, own),
                ("/(notebook_page.js)", tornado.web.StaticFileHandler, {"path": str(SOURCES)}),
                ("/(output_frame.*)", _Shared, {"path": str(self.folder)}),
            ]
            server = tornado.httpserver.HTTPServer(tornado.web.Application(handlers))
            server.add_sockets(sockets)
            self.manager = AsyncKernelManager()
            path = os.pathsep.join([str(ROOT), str(ROOT / "lessons"), str(ROOT / "tests")])
            left_out = ("JAX_DEBUG_NANS", "XLA_FLAGS")
            inherited = {name: value for name, value in os.environ.items() if name not in left_out}
            own_state = {"PYTHONPATH": path, "DEFORMNB_STATE": str(self.folder / "state")}
            await self.manager.start_kernel(env={**inherited, **own_state}, cwd=str(self.folder))
            self.client = self.manager.client()
            self.client.start_channels()
            await self.client.wait_for_ready(timeout=90)
            self._from_kernel = _Delay(self.rules.round_trip / 2, self._to_pages)
            self.to_kernel = _Delay(self.rules.round_trip / 2, self._send)
            reading = [asyncio.create_task(self._read())]
            self._ready.set()
            await self._end.wait()
            for task in [*reading, self._from_kernel.task, self.to_kernel.task]:
                task.cancel()
            self.client.stop_channels()
            await self.manager.shutdown_kernel(now=True)
            server.stop()
            for socket in list(self.sockets):
                socket.close()
            await server.close_all_connections()
        except BaseException as error:
            self._failure = error
            self._ready.set()
            raise

    async def _read(self) -> None:
        while True:
            message = await self.client.get_iopub_msg()
            buffers = [bytes(b) for b in message.get("buffers", [])]
            head = {
                "kind": message["msg_type"],
                "content": message["content"],
                "parent": message["parent_header"].get("msg_id", ""),
            }
            self._from_kernel.put(_packed(head, buffers))

    async def _to_pages(self, data: bytes) -> None:
        if self._accepts(data, "kernel"):
            for socket in list(self.sockets):
                await socket.write_message(data, binary=True)

    async def _send(self, data: bytes) -> None:
        if not self._accepts(data, "page"):
            return
        head, buffers = _unpacked(data)
        session = self.client.session
        message = session.msg(head["kind"], head["content"])
        message["header"]["msg_id"] = message["msg_id"] = head["id"]
        if head.get("cell"):
            message["metadata"] = {"cellId": head["cell"]}
        session.send(self.client.shell_channel.socket, message, buffers=buffers)

    def _accepts(self, data: bytes, sender: str) -> bool:
        head, _ = _unpacked(data)
        inner = head["content"].get("data", {})
        method = inner.get("method", "") if isinstance(inner, dict) else ""
        kind = inner.get("content", {}).get("type", "") if method == "custom" else ",".join(inner.get("state", ()))[:60]
        name = f"{sender}: {head['kind']} {method} {kind}".strip()
        self.sizes[name] = max(self.sizes[name], len(data))
        if len(data) <= self.rules.limit:
            return True
        self.refused.append(f"{name}: {len(data)} bytes")
        return False

    def close(self) -> None:
        """End the kernel and the server."""
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(30)

    # -- for tests -----------------------------------------------------------------------------------------------------

    def open(self, page: Any) -> None:
        """Show the notebook, which has no cells yet, in a page."""
        page.goto(f"http://127.0.0.1:{self.port}/")
        page.wait_for_function("window.notebook")

    def run(self, page: Any, *cells: str) -> None:
        """Add cells and run them; AssertionError with the output of one that fails."""
        for cell in cells:
            page.evaluate("(code) => notebook.run(code)", cell)
            outputs = page.evaluate("() => notebook.outputs")
            assert "Traceback" not in outputs, outputs

    def ask(self, page: Any, code: str) -> str:
        """The printed text of a code."""
        return str(page.evaluate("(code) => notebook.ask(code)", code))

    def frame(self, page: Any, number: int = 0) -> Any:
        """The frame of this number."""
        return page.locator("iframe").nth(number).element_handle().content_frame()


def wait_in(frame: Any, condition: str, timeout: float = 60.0) -> Any:
    """The value of an expression in a frame once it is true; policies forbid the eval of Playwright's own waiting."""
    end = time.monotonic() + timeout
    while not (value := frame.evaluate(condition)):
        if time.monotonic() > end:
            raise TimeoutError(f"{condition} did not come true")
        frame.page.wait_for_timeout(30)
    return value


class _Delay:
    """A queue whose entries are delivered in order, each a time after it was put."""

    def __init__(self, seconds: float, deliver: Callable[[bytes], Any]) -> None:
        self._seconds, self._deliver = seconds, deliver
        self._queue: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()
        self.task = asyncio.create_task(self._run())

    def put(self, data: bytes) -> None:
        self._queue.put_nowait((time.monotonic() + self._seconds, data))

    async def _run(self) -> None:
        while True:
            due, data = await self._queue.get()
            await asyncio.sleep(max(0.0, due - time.monotonic()))
            with contextlib.suppress(tornado.websocket.WebSocketClosedError):
                await self._deliver(data) if asyncio.iscoroutinefunction(self._deliver) else self._deliver(data)


def _packed(head: dict[str, Any], buffers: list[bytes]) -> bytes:
    text = json.dumps({**head, "sizes": [len(b) for b in buffers]}, default=str).encode()
    return struct.pack(">I", len(text)) + text + b"".join(buffers)


def _unpacked(data: bytes) -> tuple[dict[str, Any], list[bytes]]:
    at = 4 + struct.unpack_from(">I", data)[0]
    head = json.loads(data[4:at])
    buffers = []
    for size in head["sizes"]:
        buffers.append(data[at : at + size])
        at += size
    return head, buffers


class _Handler(tornado.web.RequestHandler):
    def initialize(self, notebook: EmulatedNotebook) -> None:
        self.notebook = notebook


class _Page(_Handler):
    """The page of the notebook."""

    def get(self) -> None:
        rules, port = self.notebook.rules, self.notebook.port
        manager = os.environ.get("DEFORMNB_COLAB_MANAGER", "")
        settings = {
            **asdict(rules),
            "frame": f"http://output{{number}}.localhost:{port}/frame?outputs={rules.outputs}&manager={manager}",
        }
        self.write(
            f"""<!doctype html><meta charset="utf-8"><title>Notebook</title>
            <body style="margin: 8px"><script type="application/json" id="settings">{json.dumps(settings)}</script>
            <div id="cells"></div><div id="webview"></div><script src="notebook_page.js"></script>"""
        )


class _Frame(_Handler):
    """The document of a frame."""

    def get(self) -> None:
        own = f"http://{self.request.host}"
        self.set_header("Content-Security-Policy", self.notebook.rules.policy.format(own=own))
        self.write(
            """<!doctype html><meta charset="utf-8"><title>Output</title>
            <link rel="stylesheet" href="output_frame.css"><body style="margin: 0">
            <div id="outputs"></div><script type="module" src="output_frame.js"></script>"""
        )


class _Shared(tornado.web.StaticFileHandler):
    """Files for frames, whose origin may be one that nothing shares."""

    def set_extra_headers(self, path: str) -> None:
        self.set_header("Access-Control-Allow-Origin", "*")


class _Socket(tornado.websocket.WebSocketHandler):
    """The messages of a page."""

    def initialize(self, notebook: EmulatedNotebook) -> None:
        self.notebook = notebook

    def open(self, *_: str) -> None:
        self.notebook.sockets.add(self)

    def on_message(self, message: str | bytes) -> None:
        assert isinstance(message, bytes)
        self.notebook.to_kernel.put(message)

    def on_close(self) -> None:
        self.notebook.sockets.discard(self)


@contextlib.contextmanager
def emulate(rules: Rules, folder: Path, **changes: Any) -> Iterator[EmulatedNotebook]:
    """A notebook under these rules, or under some that are changed."""
    notebook = EmulatedNotebook(replace(rules, **changes), folder)
    try:
        yield notebook
    finally:
        notebook.close()

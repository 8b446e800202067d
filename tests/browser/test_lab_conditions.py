"""JupyterLab behind a proxy with a base path, with two views of a studio, and with cells that leave the document."""

from __future__ import annotations

import asyncio
import contextlib
import json
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tornado.httpclient
import tornado.httpserver
import tornado.httputil
import tornado.netutil
import tornado.web
import tornado.websocket
from browser.hosts import AT_REST, SMALL_STUDIO, Lab, box_at_rest, start_host
from browser.test_hosts import CONTEXTS

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

BASE = "/user/name/proxy/"
EDITOR = "document.querySelector('.dnb-editor')?.deformnb?.parts"
VIEW = "document.querySelector('.dnb-view')?.deformnb"
READY = f"{EDITOR}?.picture.painter.source && {VIEW}?.caster?.isReady"
IS_SEEN = """document.querySelector('.dnb-editor')
    ?.checkVisibility({ visibilityProperty: true, opacityProperty: true })"""
POINT = "print(studio.editor.points.target[-1].round(1).tolist())"


class Proxy:
    """A reverse proxy on the loopback that passes one path on, delays messages and refuses large ones.

    Parameters
    ----------
    port : of the server behind.
    delay : seconds of a message, each way.
    limit : bytes of a message.
    """

    def __init__(self, port: int, delay: float = 0.05, limit: int = 10_000_000) -> None:
        self.behind, self.delay, self.limit = f"127.0.0.1:{port}", delay, limit
        self.outside: list[str] = []
        """Paths that were requested outside of the base."""
        self.largest = 0
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), daemon=True)
        self._thread.start()
        assert self._ready.wait(30)

    async def _serve(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        sockets = tornado.netutil.bind_sockets(0, "127.0.0.1")
        self.port = sockets[0].getsockname()[1]
        own = {"proxy": self}
        application = tornado.web.Application([
            (f"{BASE}api/kernels/[^/]+/channels", _Channels, own),
            (f"{BASE}.*", _Page, own),
            (".*", _Outside, own),
        ])  # fmt: skip
        server = tornado.httpserver.HTTPServer(application)
        server.add_sockets(sockets)
        self._ready.set()
        await self._end.wait()
        server.stop()
        await server.close_all_connections()

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join(10)


class _Passed:
    """A part of a handler: the proxy, and the headers that are passed on."""

    proxy: Proxy
    request: tornado.httputil.HTTPServerRequest

    def initialize(self, proxy: Proxy) -> None:
        self.proxy = proxy

    def passed(self) -> dict[str, str]:
        left = ("host", "connection", "upgrade", "accept-encoding", "origin")
        kept = {name: value for name, value in self.request.headers.items() if not name.lower().startswith("sec-")}
        return {name: value for name, value in kept.items() if name.lower() not in left}


class _Page(_Passed, tornado.web.RequestHandler):
    async def _pass(self) -> None:
        request = tornado.httpclient.HTTPRequest(
            f"http://{self.proxy.behind}{self.request.uri}",
            method=self.request.method or "GET",
            headers={**self.passed(), "Host": self.proxy.behind},
            body=self.request.body or None,
            allow_nonstandard_methods=True,
            follow_redirects=False,
            decompress_response=True,
            request_timeout=120,
        )
        answer = await tornado.httpclient.AsyncHTTPClient().fetch(request, raise_error=False)
        self.set_status(answer.code)
        for name, value in answer.headers.get_all():
            if name.lower() not in ("content-length", "transfer-encoding", "content-encoding", "connection"):
                self.add_header(name, value)
        if answer.body:
            self.write(answer.body)

    get = post = put = patch = delete = _pass

    def check_xsrf_cookie(self) -> None:
        """Left to the server behind."""


class _Outside(_Passed, tornado.web.RequestHandler):
    def get(self) -> None:
        self.proxy.outside.append(self.request.path)
        self.set_status(404)


class _Channels(_Passed, tornado.websocket.WebSocketHandler):
    """The messages of a kernel, each way in their order."""

    def check_origin(self, origin: str) -> bool:
        return True

    def select_subprotocol(self, subprotocols: list[str]) -> str | None:
        return subprotocols[0] if subprotocols else None

    async def open(self, *_: str) -> None:
        request = tornado.httpclient.HTTPRequest(
            f"ws://{self.proxy.behind}{self.request.uri}", headers=self.passed(), request_timeout=60
        )
        offered = self.request.headers.get("Sec-WebSocket-Protocol", "")
        names = [name.strip() for name in offered.split(",") if name.strip()]
        self.ahead: asyncio.Queue[Any] = asyncio.Queue()
        self.back: asyncio.Queue[Any] = asyncio.Queue()
        self.inner = await tornado.websocket.websocket_connect(request, subprotocols=names, max_message_size=2**30)
        self.tasks = [
            asyncio.create_task(self._deliver(self.ahead, self.inner.write_message)),
            asyncio.create_task(self._deliver(self.back, self.write_message)),
            asyncio.create_task(self._read()),
        ]

    async def _read(self) -> None:
        while (message := await self.inner.read_message()) is not None:
            self._put(self.back, message)

    def on_message(self, message: str | bytes) -> None:
        self._put(self.ahead, message)

    def _put(self, queue: Any, message: str | bytes) -> None:
        self.proxy.largest = max(self.proxy.largest, len(message))
        if len(message) <= self.proxy.limit:
            queue.put_nowait((asyncio.get_running_loop().time() + self.proxy.delay, message))

    async def _deliver(self, queue: Any, write: Any) -> None:
        while True:
            due, message = await queue.get()
            await asyncio.sleep(max(0.0, due - asyncio.get_running_loop().time()))
            with contextlib.suppress(tornado.websocket.WebSocketClosedError):
                await write(message, binary=isinstance(message, bytes))

    def on_close(self) -> None:
        for task in self.tasks:
            task.cancel()
        self.inner.close()


class ProxiedLab(Lab):
    """JupyterLab with a base path, which pages reach by a proxy."""

    options = (*Lab.options, f"--ServerApp.base_url={BASE}", "--ServerApp.allow_remote_access=True")
    ready = f"{BASE}api"
    proxy: Proxy | None = None

    def url(self, path: str) -> str:
        if self.proxy is None:
            return super().url(path)
        return f"http://127.0.0.1:{self.proxy.port}{BASE}{path.removeprefix('/')}?token={self.token}"


class WindowedLab(Lab):
    """JupyterLab that shows only the cells in the viewport."""

    def prepare(self) -> None:
        super().prepare()
        settings = self.folder / "jupyterlab_settings_dir" / "@jupyterlab" / "notebook-extension"
        settings.mkdir(parents=True, exist_ok=True)
        (settings / "tracker.jupyterlab-settings").write_text('{"windowingMode": "full"}', encoding="utf-8")


def drag(page: Any, by: tuple[float, float]) -> None:
    """Drag the last point with the mouse."""
    disc = page.locator(".dnb-editor [data-id] .dnb-ed-disc").last
    disc.scroll_into_view_if_needed()
    box = box_at_rest(disc)
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + by[0], y + by[1], steps=6)
    page.mouse.up()


def python_has(lab: Lab, page: Any, before: str) -> str:
    """The last point in Python, once it is another one than before."""
    for _ in range(100):
        if (now := lab.run(page, POINT).strip()) != before:
            return now
        page.wait_for_timeout(100)
    raise TimeoutError(f"Python has the point at {before} still")


@pytest.fixture
def errors(tab: Any) -> Iterator[list[str]]:
    """Errors of the page, of which there may be none."""
    found: list[str] = []
    tab.on("pageerror", lambda error: found.append(str(error)))
    yield found
    assert found == []


def test_behind_a_proxy_with_a_base_path(tmp_path: Path, tab: Any, errors: list[str]) -> None:
    with start_host(ProxiedLab, tmp_path) as lab:
        lab.proxy = proxy = Proxy(lab.port)
        try:
            lab.open_notebook(tab, [SMALL_STUDIO])
            tab.wait_for_function(READY, timeout=90_000)
            before = lab.run(tab, POINT).strip()
            drag(tab, (-20, -12))
            moved = python_has(lab, tab, before)
            lab.save(tab)
            tab.reload(timeout=60_000)
            lab.wait_until_open(tab)
            tab.wait_for_function(READY, timeout=90_000)
            assert lab.run(tab, POINT).strip() == moved
            assert proxy.outside == []
            assert proxy.largest < proxy.limit
        finally:
            proxy.close()


def test_two_views_of_a_studio_follow_and_one_stays(lab: Lab, tab: Any, errors: list[str]) -> None:
    tab.set_viewport_size({"width": 1400, "height": 1400})
    lab.open_notebook(tab, [SMALL_STUDIO, "studio"], "views.ipynb")
    count = "document.querySelectorAll('.dnb-editor').length"
    tab.wait_for_function(f"{count} === 2 && {READY}", timeout=90_000)
    tab.wait_for_function(
        "[...document.querySelectorAll('.dnb-view')].every((view) => view.deformnb?.caster?.isReady)", timeout=60_000
    )
    places = """() => [...document.querySelectorAll('.dnb-editor')].map(({ deformnb }) =>
        JSON.stringify(deformnb.parts.points.list.map(({ target }) => target.map(Math.round))))"""
    fields = """() => [...document.querySelectorAll('.dnb-view')].map(({ deformnb }) =>
        deformnb.caster.fields.planar?.maps.some((value) => value !== 0) ?? false)"""
    before = lab.run(tab, POINT).strip()
    drag(tab, (-20, -12))
    moved = python_has(lab, tab, before)
    tab.wait_for_function(f"new Set(({places})()).size === 1", timeout=30_000)
    tab.wait_for_function(f"({fields})().every(Boolean)", timeout=30_000)
    tab.evaluate("""async () => {
        jupyterapp.shell.currentWidget.content.activeCellIndex = 0;
        await jupyterapp.commands.execute("notebook:delete-cell");
    }""")
    tab.wait_for_function(f"{count} === 1")
    drag(tab, (10, 6))
    python_has(lab, tab, moved)
    tab.wait_for_function(f"({fields})().every(Boolean)", timeout=30_000)


def test_a_cell_that_leaves_the_document_comes_back(tmp_path: Path, tab: Any, errors: list[str]) -> None:
    with start_host(WindowedLab, tmp_path) as lab:
        _scroll_away_and_back(lab, tab)


def _scroll_away_and_back(lab: Lab, tab: Any) -> None:
    tab.add_init_script(CONTEXTS)
    lab.open_notebook(tab, [SMALL_STUDIO, *["\n" * 40] * 12], "long.ipynb")
    tab.wait_for_function(READY, timeout=90_000)
    live = "contexts.filter((context) => !context.isContextLost()).length"
    before, contexts = lab.run(tab, POINT).strip(), tab.evaluate(live)
    tab.evaluate("() => { window.cell = document.querySelector('.dnb-editor').closest('.jp-Cell'); }")
    for is_removed in (False, True, False, True):  # JupyterLab hides cells with outputs; other hosts may remove them
        tab.evaluate("() => jupyterapp.shell.currentWidget.content.scrollToItem(12)")
        tab.wait_for_function(f"!({IS_SEEN})", timeout=30_000)
        if is_removed:
            tab.evaluate("() => { window.place = cell.parentElement; cell.remove(); }")
        lab.run(tab, "points = studio.editor.points; studio.editor.points = points.move(3, points.target[3] + 0.5)")
        if is_removed:
            tab.evaluate("() => place.prepend(cell)")
        tab.evaluate("() => jupyterapp.shell.currentWidget.content.scrollToItem(0)")
        tab.wait_for_function(f"{IS_SEEN} && {READY}", timeout=60_000)
    assert tab.evaluate(live) <= contexts
    moved = python_has(lab, tab, before)
    shown = f"JSON.stringify({EDITOR}.points.list.at(-1).target.map((part) => Math.round(10 * part) / 10))"
    wanted = json.dumps(json.loads(moved), separators=(",", ":")).replace(".0", "")
    tab.wait_for_function(f"{shown} === '{wanted}'", timeout=30_000)
    tab.wait_for_function(f"({AT_REST})()", timeout=30_000)
    drag(tab, (-15, 5))
    python_has(lab, tab, moved)

"""Access control of the server of pages: which clients are admitted, and which messages they may send."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import sys
import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import aiohttp
import pytest
from running_app import HANDSHAKE, RunningApp, connect, fetch, frame, http_request, open_connection
from waiting import PATIENCE, wait_for

from deformnb.app.application import Application
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.errors import DeformError
from deformnb.widgets.web.addresses import checked_host, own_names
from deformnb.widgets.web.guard import (
    LONGEST_OTHER,
    LONGEST_REQUEST,
    MOST_OPEN_PAGES,
    PasswordCheck,
)


@pytest.fixture(scope="module")
def running() -> Iterator[RunningApp]:
    with RunningApp(Application(PHANTOMS["bar"].make((12, 16, 20)), side="+y")) as running:
        running.wait_idle()
        yield running


def _refused(running: RunningApp, **how: Any) -> int:
    """Status with which a socket is refused; 0 if it is not."""

    async def attempt() -> int:
        try:
            async with connect(running, secret=None, **how):
                return 0
        except aiohttp.WSServerHandshakeError as error:
            return error.status

    return asyncio.run(attempt())


# -- who is let in -----------------------------------------------------------------------------------------------------


def test_it_listens_at_this_machine_only(running: RunningApp) -> None:
    assert running.server.guard.sites == [f"http://127.0.0.1:{running.server.port}"]


def test_two_starts_have_different_passwords(running: RunningApp) -> None:
    with RunningApp(Application(PHANTOMS["bar"].make((8, 8, 8)), side="+y")) as other:
        assert len(running.server.token) >= 40
        assert other.server.token != running.server.token
        assert other.server.port != running.server.port


@pytest.mark.parametrize("secret", ["wslink-secret", "", "x" * 43, None, 7, {"secret": "wslink-secret"}, ["a"]])
def test_other_passwords_are_refused(running: RunningApp, secret: Any) -> None:
    async def attempt() -> Any:
        async with connect(running, secret=None) as page:
            entered = await page.login(secret)
            return entered, await page.call("trame.state.get")

    entered, answer = asyncio.run(attempt())
    assert not entered
    assert answer["message"].startswith("Unauthorized")


def test_without_a_password_nothing_is_told(running: RunningApp) -> None:
    async def attempt() -> list[Any]:
        async with connect(running, secret=None) as page:
            return [
                await page.call(*call)
                for call in (("trame.state.get",), ("deformnb.open",), ("deformnb.comm", "editor", {}, "1", []))
            ]

    before = running.application.session.editing.deformation
    assert [answer["message"].split(":")[0] for answer in asyncio.run(attempt())] == ["Unauthorized"] * 3
    running.wait_idle()
    assert running.application.session.editing.deformation is before


def test_the_password_of_this_start_opens(running: RunningApp) -> None:
    async def attempt() -> Any:
        async with connect(running) as page:
            return await page.call("trame.state.get")

    assert "trame__title" in asyncio.run(attempt())["state"]


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        None,
        "https://127.0.0.1:{port}",
        "http://127.0.0.1:1",
        "http://127.0.0.1:{port}.evil.example",
    ],
)
def test_sockets_of_foreign_pages_are_refused(running: RunningApp, origin: str | None) -> None:
    assert _refused(running, origin=origin and origin.format(port=running.server.port)) == 403


def test_sockets_under_a_foreign_name_are_refused(running: RunningApp) -> None:
    assert _refused(running, host="evil.example") == 403
    # As if a name had been turned into our address: the page's origin then fits its host.
    name = f"evil.example:{running.server.port}"
    assert _refused(running, host=name, origin=f"http://{name}") == 403
    assert _refused(running) == 0


def test_a_page_at_localhost_is_our_own(running: RunningApp) -> None:
    name = f"localhost:{running.server.port}"
    assert _refused(running, host=name, origin=f"http://{name}") == 0
    assert _refused(running, host=name) == 403  # a page of 127.0.0.1 has no business at localhost


@pytest.mark.parametrize("path", ["/", "/index.html", "/deformnb/app.js", "/vue.global.js", "/nothing"])
def test_requests_under_a_foreign_name_or_origin_are_refused(running: RunningApp, path: str) -> None:
    with fetch(running, path, Host="evil.example") as (status, _, text):
        assert (status, "deformnb" in text) == (403, False)
    with fetch(running, path, Origin="http://evil.example") as (status, _, _):
        assert status == 403
    with fetch(running, path) as (status, _, _):
        assert status == (404 if path == "/nothing" else 200)


def test_pages_may_not_be_framed_or_load_from_elsewhere(running: RunningApp) -> None:
    for path in ("/", "/vue.global.js"):
        with fetch(running, path) as (_, headers, _):
            policy = dict(part.split(" ", 1) for part in headers["Content-Security-Policy"].split("; "))
            assert policy["frame-ancestors"] == "'none'"
            assert policy["connect-src"] == f"'self' ws://{running.name}"
            assert policy["default-src"] == "'self'"
            assert headers["Referrer-Policy"] == "no-referrer"


def test_only_a_classroom_of_pages_is_let_in(running: RunningApp) -> None:
    async def attempt() -> tuple[int, int]:
        entered = []
        try:
            for _ in range(MOST_OPEN_PAGES):
                entered.append(connect(running, secret=None))
                await entered[-1].__aenter__()
            with pytest.raises(aiohttp.WSServerHandshakeError) as error:
                await connect(running, secret=None).__aenter__()
            return len(entered), error.value.status
        finally:
            for page in entered:
                await page.__aexit__(None, None, None)

    assert asyncio.run(attempt()) == (MOST_OPEN_PAGES, 503)


def _without(*names: str, **others: str) -> dict[str, str]:
    return {name: value for name, value in {**HANDSHAKE, **others}.items() if name not in names}


@pytest.mark.parametrize(
    ("method", "headers", "status"),
    [
        ("GET", {}, 403),  # an <img> of any page
        ("GET", {"Origin": "http://evil.example"}, 403),
        ("GET", {"Origin": "http://evil.example", **_without("Origin")}, 403),
        ("GET", {"Origin": "http://{name}"}, 400),
        ("GET", _without("Upgrade"), 400),
        ("GET", _without(Upgrade="h2c"), 400),
        ("GET", _without("Connection"), 400),
        ("GET", _without(Connection="close"), 400),
        ("GET", _without("Sec-WebSocket-Version"), 400),
        ("GET", {**HANDSHAKE, "Sec-WebSocket-Version": "12"}, 400),
        ("GET", _without("Sec-WebSocket-Key"), 400),
        ("GET", {**HANDSHAKE, "Sec-WebSocket-Key": "short"}, 400),
        ("HEAD", HANDSHAKE, 405),
        ("POST", HANDSHAKE, 405),
    ],
)
def test_what_is_no_websocket_takes_no_place(
    running: RunningApp, method: str, headers: dict[str, str], status: int
) -> None:
    for _ in range(MOST_OPEN_PAGES + 1):
        with open_connection(running.name, http_request(running.name, method=method, **headers)) as visitor:
            assert visitor.recv(65536).split()[1] == str(status).encode()
    wait_for(lambda: [dict(handler.connections) for handler in running.server.guard.handlers] == [{}])
    test_the_password_of_this_start_opens(running)


def test_a_handshake_that_fails_takes_no_place(running: RunningApp, monkeypatch: pytest.MonkeyPatch) -> None:
    async def gone(*_: Any) -> None:
        raise ConnectionResetError("the page has gone meanwhile")

    with monkeypatch.context() as patch:
        patch.setattr("aiohttp.web.WebSocketResponse.prepare", gone)
        assert _refused(running) == 500
    wait_for(lambda: [dict(handler.connections) for handler in running.server.guard.handlers] == [{}])
    test_the_password_of_this_start_opens(running)


def test_many_refused_requests_become_few_lines(running: RunningApp, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(32):
        with fetch(running, "/ws") as (status, _, _):
            assert status == 403
    assert len([record for record in caplog.records if "a request was refused" in record.message]) <= 6


def test_hosts_are_this_machine_or_named_in_full() -> None:
    assert checked_host("localhost") == "127.0.0.1"
    assert checked_host("::1") == "::1"
    assert checked_host("192.168.1.20") == "192.168.1.20"
    for host in ("0.0.0.0", "::", "224.0.0.1", "example.org", ""):
        with pytest.raises(DeformError, match=r"address"):
            checked_host(host)
    assert own_names("127.0.0.1", 80) == {"127.0.0.1:80", "localhost:80"}
    assert own_names("::1", 80) == {"[::1]:80", "localhost:80"}
    assert own_names("192.168.1.20", 80) == {"192.168.1.20:80"}


def test_environment_variables_do_not_widen_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TRAME_DEFAULT_HOST", "0.0.0.0")
    monkeypatch.setenv("TRAME_ARGS", "--host 0.0.0.0 --authKey known")
    monkeypatch.setattr(sys, "argv", ["deformnb", "--host", "0.0.0.0", "--authKey", "known", "--port", "1"])
    with RunningApp(Application(PHANTOMS["bar"].make((8, 8, 8)), side="+y")) as running:
        assert running.server.guard.sites == [f"http://{running.name}"]
        test_other_passwords_are_refused(running, "known")
    assert os.environ["TRAME_ARGS"].endswith("known")  # only put aside


def test_a_page_has_some_time_to_give_the_password(monkeypatch: pytest.MonkeyPatch) -> None:
    check, now = PasswordCheck("secret"), 100.0
    monkeypatch.setattr("deformnb.widgets.web.guard.time", SimpleNamespace(monotonic=lambda: now))
    check.onConnect(None, "early")
    now = 104.0
    check.onConnect(None, "late")
    assert check.unauthenticated_clients(set()) == []
    now = 111.0
    assert check.unauthenticated_clients(set()) == ["early"]
    assert check.unauthenticated_clients({"early"}) == []
    check.onClose("early")
    now = 120.0
    assert check.unauthenticated_clients(set()) == ["late"]


# -- what a page may send ----------------------------------------------------------------------------------------------

_FORBIDDEN = (
    ("application.exit",),
    ("application.exit.later", 0),
    ("trame.force.push", "kernel"),
    ("trame.state.update", [{"key": "trame__template_main", "value": "<script>"}]),
    ("trame.trigger", "save", [], {}),
    ("trame.rca.push", "volume", {}, b"x"),
    ("trame.rca.drop", "volume", 1),
    ("trame.rca.size", "volume", "page", {}),
    ("viewport.image.render", {}),
    ("deformnb.close", "editor"),
)


@pytest.mark.parametrize("call", _FORBIDDEN, ids=lambda call: call[0])
def test_other_procedures_are_unknown(running: RunningApp, call: tuple[Any, ...]) -> None:
    async def attempt() -> Any:
        async with connect(running) as page:
            return await page.call(*call), await page.call("trame.state.get")

    answer, after = asyncio.run(attempt())
    assert answer["message"] == "Unregistered method called"
    assert after["state"]["trame__title"].endswith("deformnb")


def _custom(content: Any) -> dict[str, Any]:
    return {"method": "custom", "content": content}


def _update(**state: Any) -> dict[str, Any]:
    return {"method": "update", "state": state, "buffer_paths": []}


# A widget by its name, and what it cannot be sent.
_BAD = (
    ("nobody", _update(value=1)),
    ("../../etc/passwd", _update(value=1)),
    (7, _update(value=1)),
    ("editor", "text"),
    ("editor", {"method": "request_state"}),
    ("editor", {"method": "update"}),
    ("editor", _custom("text")),
    ("editor", {**_update(), "state": ["kernel"]}),
    ("editor", _custom({"type": "edit", "seq": 1, "phase": "end", "points": [{"id": "x"}]})),
    ("editor", _update(kernel="gaussian", image=b"x", comm=1, layout={})),
    ("view", _custom({"type": "chunk", "view": "v", "id": "other", "index": -1})),
    ("view", _update(projection="none", volume_info={"id": 1})),
    ("head", _update(name="<script>")),
    ("head", _custom({"type": "delete"})),
    ("studio", _update(children=[])),
    ("studio", _update(layout="IPY_MODEL_1")),
    ("status", _update(value="<script>")),
    ("kernel", _update(index=99)),
    ("kernel", _update(index="__class__")),
    ("kernel", _update(_options_labels=["x"])),
    ("kernel", _update(index=1, description="<script>")),
    ("strength", _update(value="x")),
    ("strength", {**_update(value=None), "buffer_paths": [["value", "x"]]}),
    ("strength", _update(max=9.0)),
)


@pytest.mark.parametrize(("name", "data"), _BAD, ids=[f"{name}-{str(data)[-40:]}" for name, data in _BAD])
def test_wrong_messages_change_nothing(
    running: RunningApp, name: Any, data: Any, caplog: pytest.LogCaptureFixture
) -> None:
    studio, session = running.studio, running.session
    known = {
        "editor": studio.editor,
        "view": studio.view,
        "studio": studio,
        "head": _part(studio, "name", session.volume.name),
        "status": _part(studio, "_model_name", "HTMLModel"),
        "kernel": _part(studio, "description", "Kernel"),
        "strength": _part(studio, "description", "Strength"),
    }

    async def attempt() -> Any:
        async with connect(running) as page:
            await page.call("deformnb.comm", known[name].model_id if name in known else name, data, "1", [])
            running.wait_idle()
            return (await page.call("deformnb.open"))["widgets"]

    def looks() -> Any:
        return (
            session.editing.deformation,
            session.steps.view,
            session.pictures.method,
            session.pictures.transfer,
            studio.editor.image,
            studio.editor.kernel,
            studio.view.projection,
            dict(studio.view.volume_info),
            studio.children,
            known["head"].name,
            known["kernel"].description,
            known["strength"].max,
        )

    shown = looks()
    states = asyncio.run(attempt())
    assert looks() == shown
    assert "<script>" not in str(states[known["status"].model_id])
    assert "passwd" not in caplog.text


@pytest.mark.parametrize(("number", "buffers"), [("x" * 65, []), (1, []), ("1", b"x"), ("1", ["x"])])
def test_a_message_has_a_number_and_buffers(running: RunningApp, number: Any, buffers: Any) -> None:
    async def attempt() -> None:
        async with connect(running) as page:
            hello = _custom({"type": "hello"})
            await page.call("deformnb.comm", running.studio.editor.model_id, hello, number, buffers)

    before = running.server.guard.refused_count
    asyncio.run(attempt())
    assert running.server.guard.refused_count == before + 1


def _part(widget: Any, trait: str, value: Any) -> Any:
    """The first part of a studio with this value of a trait."""
    if getattr(widget, trait, None) == value:
        return widget
    parts = (_part(child, trait, value) for child in getattr(widget, "children", ()))
    return next((part for part in parts if part is not None), None)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x00" * 12,
        b"\xff" * 40,
        frame(b"\xc1"),
        frame(b"\x91" * 60000),
        frame({"id": 1, "method": "x"}),
        frame([1, 2]),
        frame({"id": "rpc:c0:1", "method": "trame.state.get", "args": {}, "kwargs": {}}),
        frame({"id": "rpc:c0:1", "method": "trame.state.get", "args": [], "kwargs": [], "more": 1}),
        b"\x01\x00\x00\x00" + (0).to_bytes(4, "little") + (2**31).to_bytes(4, "little") + b"x",  # 2 GB are promised
        b"\x01\x00\x00\x00" + (50).to_bytes(4, "little") + (60).to_bytes(4, "little") + b"0123456789",  # a later piece
        frame({"id": "x" * 300, "method": "trame.state.get"}),
        *(
            frame({"id": "rpc:c0:1", "method": "trame.state.get"})[:k]
            + (7).to_bytes(4, "little")
            + frame({"id": "rpc:c0:1", "method": "trame.state.get"})[k + 4 :]
            for k in (4, 8)
        ),  # a later piece, another size
    ],
    ids=range(14),
)
@pytest.mark.parametrize("is_known", [True, False])
def test_malformed_messages_are_dropped_and_the_page_goes_on(running: RunningApp, data: bytes, is_known: bool) -> None:
    async def attempt() -> Any:
        async with connect(running, secret="" if is_known else None) as page:
            await page.socket.send_bytes(data)
            if not is_known:
                assert await page.login(running.server.token)
            return await page.call("trame.state.get")

    before = running.server.guard.refused_count
    assert "trame__title" in asyncio.run(attempt())["state"]
    assert running.server.guard.refused_count > before


def test_text_is_no_message(running: RunningApp) -> None:
    async def attempt() -> Any:
        async with connect(running) as page:
            await page.socket.send_str('{"method": "trame.state.get"}')
            return await page.call("trame.state.get")

    assert "trame__title" in asyncio.run(attempt())["state"]


def test_a_message_that_is_too_long_ends_its_page_and_not_the_server(running: RunningApp) -> None:
    async def attempt(method: str, size: int, *given: Any) -> tuple[int, Any]:
        before = running.server.guard.refused_count
        async with connect(running) as page:
            try:  # the server may close the line while the message is still in transit
                await page.send(method, *given, "x" * size)
                known = "state" in await page.call("trame.state.get")
            except (ConnectionError, aiohttp.ClientError):
                known = False
            return running.server.guard.refused_count - before, known

    editor = running.studio.editor.model_id
    long = {"type": "no message", "text": "x" * (LONGEST_OTHER + 1000)}
    assert asyncio.run(attempt("deformnb.comm", 1, editor, _custom(long), "1", [])) == (1, True)
    assert asyncio.run(attempt("deformnb.comm", LONGEST_REQUEST + 1000)) == (1, True)
    assert asyncio.run(attempt("trame.error.client", LONGEST_OTHER + 1000)) == (1, True)
    assert asyncio.run(attempt("deformnb.comm", 3_000_000))[1] is False  # closed before it was read whole
    test_the_password_of_this_start_opens(running)


def test_unauthenticated_clients_may_send_only_a_password(running: RunningApp) -> None:
    async def attempt() -> tuple[int, bool]:
        before = running.server.guard.refused_count
        async with connect(running, secret=None) as page:
            await page.send("wslink.hello", {"secret": running.server.token + "x" * 1000}, system=True)
            entered = await page.login(running.server.token)  # which is answered after the other was read
            return running.server.guard.refused_count - before, entered

    assert asyncio.run(attempt()) == (1, True)


def test_a_flood_is_dropped_and_others_are_served(running: RunningApp) -> None:
    async def attempt() -> tuple[int, Any]:
        async with connect(running) as noisy, connect(running) as calm:
            before = running.server.guard.refused_count
            for _ in range(100_000):  # a slow machine lets more of them through
                await noisy.send("trame.lifecycle.update", "client_mounted")
                if running.server.guard.refused_count - before > 1000:
                    break
            answer = await calm.call("trame.state.get")
            return running.server.guard.refused_count - before, answer

    dropped, answer = asyncio.run(attempt())
    assert dropped > 1000
    assert "trame__title" in answer["state"]


def test_a_page_has_one_message_at_a_time_in_the_application(running: RunningApp) -> None:
    """Many messages of one client do not delay others: its next one is read when the last has been taken."""
    strength, free = _part(running.studio, "description", "Strength").model_id, threading.Event()

    async def attempt() -> int:
        async with connect(running) as noisy, connect(running) as calm:
            blocked = running.application.thread.call(lambda: free.wait(PATIENCE))
            for value in range(100):
                await noisy.send("deformnb.comm", strength, _update(value=value / 100), str(value), [])
            await calm.call("trame.state.get")
            asked = await calm.send("deformnb.comm", strength, _update(value=1.0), "calm", [])
            await calm.send("trame.state.get")
            free.set()
            await calm.answer(asked)
            assert blocked.done()
            return sum(m["result"].get("parent", "").isdigit() for m in calm.inbox if isinstance(m.get("result"), dict))

    assert asyncio.run(attempt()) <= 3
    running.wait_idle()
    running.application.thread.call(running.studio.session.editing.reset).result(PATIENCE)


def test_logs_hold_no_password(running: RunningApp, caplog: pytest.LogCaptureFixture) -> None:
    async def attempt() -> None:
        async with connect(running) as page:
            await page.call("trame.state.get")
            await page.login("wslink-secret-wrong")

    with caplog.at_level(logging.DEBUG):
        with fetch(running, f"/index.html?secret={running.server.token}") as (status, _, text):
            assert (status, running.server.token in text) == (200, False)
        asyncio.run(attempt())
    assert running.server.token not in caplog.text


# -- requests that are none --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "request_",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET / HTTP/9.9\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\r\n\r\n",
        b"GET http://[/ HTTP/1.1\r\nHost: {}\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: {}\r\nX: " + 9000 * b"a" + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: {}\r\nCookie: \x01\r\n\r\n",
        b"POST / HTTP/1.1\r\nHost: {}\r\nContent-Length: -1\r\n\r\n",
        b"POST / HTTP/1.1\r\nHost: {}\r\nTransfer-Encoding: chunked\r\n\r\nzz\r\n",
        b"POST / HTTP/1.1\r\nHost: {}\r\nContent-Encoding: gzip\r\nContent-Length: 5\r\n\r\nabcde",
    ],
    ids=["no host", "version", "TLS", "address", "long", "character", "length", "chunk", "gzip"],
)
def test_a_request_that_cannot_be_read_is_a_line_of_the_log_without_what_was_sent(
    running: RunningApp, request_: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    for _ in range(3):
        with open_connection(running.name, request_.replace(b"{}", running.name.encode())) as foreign:
            assert b" 40" in foreign.recv(64)
            while foreign.recv(4096):  # until the server has closed it, after its log messages
                pass
    told = [record for record in caplog.records if record.levelno > logging.DEBUG]
    assert len(told) <= 2  # the first, the second, the fourth ... of all refused
    for record in told:
        assert record.exc_info is None
        assert "\n" not in record.getMessage()
        assert record.getMessage().startswith("a request was refused (")


def test_who_sends_no_whole_request_is_cut_off_and_nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.widgets.web.server._LOOK_EVERY", 0.05)
    monkeypatch.setattr("deformnb.widgets.web.guard.REQUEST_SECONDS", 0.5)

    async def stay() -> None:
        async with connect(running) as page:
            name = running.name
            half = [open_connection(name, part) for part in (b"", http_request(name)[:-2], http_request(name)[:20])]
            slow = open_connection(name, http_request(name, "/vue.global.js") * 30, receive_buffer=4096)
            for one in half:
                with contextlib.suppress(ConnectionResetError):  # where something was sent that nobody has read
                    assert await asyncio.to_thread(one.recv, 1) == b""
                one.close()
            assert len(await asyncio.to_thread(slow.recv, 1000)) > 0
            # The page and the slow reader; aiohttp keeps those that were cut off until their tasks have ended.
            await asyncio.to_thread(wait_for, lambda: _connected(running) == 2)
            slow.close()
            assert await page.call("trame.state.get") is not None

    with RunningApp(Application(PHANTOMS["bar"].make((8, 8, 8)), side="+y")) as running:
        asyncio.run(stay())


def _connected(running: RunningApp) -> int:
    return sum(one.transport is not None for one in _connections(running))


def _connections(running: RunningApp) -> list[Any]:
    return running.server.guard.connections


def test_who_does_not_read_a_file_does_not_hold_up_the_end(caplog: pytest.LogCaptureFixture) -> None:
    with RunningApp(Application(PHANTOMS["bar"].make((8, 8, 8)), side="+y")) as running:
        slow = open_connection(running.name, b"", receive_buffer=4096)
        wait_for(lambda: _connected(running) == 1)
        (connection,) = _connections(running)
        connection.transport.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
        slow.sendall(http_request(running.name, "/vue.global.js"))
        assert slow.recv(4096, socket.MSG_WAITALL)  # more than the head of the answer: the file is in transit
        running.server.stop()
        running.wait_end(20.0)  # aiohttp itself waits for 60 seconds
        slow.close()
    assert [record for record in caplog.records if record.levelno >= logging.ERROR] == []

"""The end of the server of pages: with its terminal, without pages, and whatever its visitors do."""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from running_app import HANDSHAKE, RunningApp, connect, http_request, open_connection, terminal_command
from waiting import PATIENCE, wait_for

from deformnb.app.application import Application, app_server
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.widgets.web.guard import MOST_OPEN_PAGES


def _is_open(port: int) -> bool:
    with socket.socket() as s:
        return s.connect_ex(("127.0.0.1", port)) == 0


@pytest.fixture
def looks_often(monkeypatch: pytest.MonkeyPatch) -> None:
    """The server looks for pages twenty times a second instead of once."""
    monkeypatch.setattr("deformnb.widgets.web.server._LOOK_EVERY", 0.05)


@pytest.mark.usefixtures("looks_often")
def test_it_ends_when_no_page_has_been_there_for_a_while() -> None:
    async def stay(seconds: float) -> None:
        async with connect(running):
            running.server.idle = 0.2  # from now on, for a slow machine takes its time to come in
            await asyncio.sleep(seconds)
            assert running.server.reason == ""  # a page is there

    with RunningApp(Application(PHANTOMS["bar"].make((8, 8, 8)), side="+y"), idle=PATIENCE) as running:
        asyncio.run(stay(0.6))
        running.wait_end()
        assert "no page was connected" in running.server.reason
        assert not _is_open(running.server.port)


@pytest.mark.usefixtures("looks_often")
def test_it_waits_four_hours_for_a_page_and_for_ever_if_told_so() -> None:
    volume = PHANTOMS["bar"].make((8, 8, 8))
    with RunningApp(Application(volume)) as running:
        assert running.server.idle == 4 * 60 * 60
    with RunningApp(Application(volume), idle=0) as running:
        time.sleep(0.3)
        assert running.server.reason == ""


@pytest.mark.usefixtures("looks_often")
def test_whoever_gives_no_password_does_not_keep_it_alive(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("deformnb.widgets.web.guard.LOGIN_SECONDS", 0.2)

    async def loiter() -> int | None:
        async with connect(running, secret=None) as page:
            await asyncio.wait_for(page.socket.receive(), PATIENCE)
            running.server.idle = 0.2  # counted from the start, which is longer ago
            return page.socket.close_code

    with RunningApp(Application(PHANTOMS["bar"].make((8, 8, 8)), side="+y"), idle=PATIENCE) as running:
        assert asyncio.run(loiter()) == 1000  # shut by the server
        running.wait_end()
        assert "no page was connected" in running.server.reason


def _has_studio(name: str) -> bool:
    """Check whether the server of the studio has taken over from the page of the start, which has no such file."""
    try:
        with open_connection(name, http_request(name, "/vue.global.js")) as connection:
            return connection.recv(16).startswith(b"HTTP/1.1 200")
    except OSError:
        return False


def _started(command: list[str], folder: Path) -> tuple[subprocess.Popen[str], str]:
    process = subprocess.Popen(
        terminal_command(command), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=folder
    )
    assert process.stdout is not None
    url = process.stdout.readline().strip()
    assert url.startswith("http://127.0.0.1:"), url
    wait_for(lambda: _has_studio(url.split("/")[2]))
    return process, url


def _volume(folder: Path) -> str:
    from deformnb.io import write_volume

    path = folder / "bar.nii.gz"
    write_volume(PHANTOMS["bar"].make((8, 8, 8)), path)
    return str(path)


@pytest.mark.sampled(2)
@pytest.mark.skipif(os.name != "posix", reason="signals of another kind")
@pytest.mark.parametrize("name", ["SIGHUP", "SIGINT"])  # the other one is in the next test too
def test_the_command_ends_with_its_terminal(name: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "deformnb", "app", _volume(tmp_path), "--no-browser"]
    number = getattr(signal, name)
    before = signal.signal(number, signal.SIG_IGN)  # as under nohup and in a shell's background: children inherit it
    try:
        process, url = _started(command, tmp_path)
    finally:
        signal.signal(number, before)
    port = int(url.split(":")[2].split("/")[0])
    assert _is_open(port)
    process.send_signal(number)
    rest, _ = process.communicate(timeout=PATIENCE)
    assert (process.returncode, rest) == (0, "")  # the address is printed once
    assert not _is_open(port)


@pytest.mark.skipif(os.name != "posix", reason="signals of another kind")
def test_nobody_holds_up_the_end(tmp_path: Path) -> None:
    process, url = _started([sys.executable, "-m", "deformnb", "app", _volume(tmp_path), "--no-browser"], tmp_path)
    name = url.split("/")[2]
    visitors = [open_connection(name, http_request(name)) for _ in range(MOST_OPEN_PAGES + 1)]  # no WebSockets
    visitors += [open_connection(name, http_request(name, **HANDSHAKE)) for _ in range(MOST_OPEN_PAGES)]  # silent
    # Who takes no more of a long answer than fits into the buffers between.
    visitors += [open_connection(name, http_request(name, "/vue.global.js") * 30, receive_buffer=4096)]
    try:
        for visitor in visitors:
            assert visitor.recv(16)  # the server has begun to answer
        visitors += [open_connection(name, http_request(name)[:-2])]  # half a request
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=40.0)  # wslink waits 10 s for each page, aiohttp 60 s for each answer
        assert process.returncode == 0
        assert not _is_open(int(name.split(":")[1]))
    finally:
        process.kill()
        process.wait(PATIENCE)
        for visitor in visitors:
            visitor.close()


def test_a_server_that_was_stopped_before_it_began_ends_at_once() -> None:
    app = Application(PHANTOMS["bar"].make((8, 8, 8)), side="+y")
    server = app_server(app)
    server.stop("asked early")
    asyncio.run(asyncio.wait_for(server.run(), PATIENCE))
    app.close()
    assert (server.reason, server.url) == ("asked early", "")


def test_a_server_that_is_stopped_while_it_begins_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    app = Application(PHANTOMS["bar"].make((8, 8, 8)), side="+y")
    server = app_server(app)
    start = server.content.start

    def stop_first() -> None:
        server.stop("asked early")  # before its bridge has a loop
        start()

    monkeypatch.setattr(server.content, "start", stop_first)
    asyncio.run(asyncio.wait_for(server.run(), PATIENCE))
    app.close()
    assert server.reason == "asked early"


@pytest.mark.nightly
@pytest.mark.skipif(os.name != "posix", reason="signals of another kind")
def test_it_outlives_its_terminal_if_it_is_told_to(tmp_path: Path) -> None:
    command = f"{sys.executable} -m deformnb app {_volume(tmp_path)} --no-browser --idle 0"
    inner = f"trap '' HUP; {command} & echo $!; wait"
    shell = subprocess.Popen(["/bin/sh", "-c", inner], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    assert shell.stdout is not None
    process = int(shell.stdout.readline())
    try:
        port = int(shell.stdout.readline().split(":")[2].split("/")[0])
        os.kill(process, signal.SIGHUP)
        shell.kill()
        shell.wait(PATIENCE)
        time.sleep(3.0)  # it looks every second
        assert _is_open(port)
    finally:
        os.kill(process, signal.SIGTERM)
    shell.communicate(timeout=PATIENCE)  # until it has closed its end
    assert not _is_open(port)


@pytest.mark.nightly
@pytest.mark.skipif(os.name != "posix", reason="processes of another kind")
def test_the_command_ends_with_the_program_that_started_it(tmp_path: Path) -> None:
    # The shell starts it and is killed without a chance to pass anything on.
    inner = f"{sys.executable} -m deformnb app {_volume(tmp_path)} --no-browser & wait"
    shell, url = _started(["/bin/sh", "-c", inner], tmp_path)
    port = int(url.split(":")[2].split("/")[0])
    shell.kill()
    shell.communicate(timeout=PATIENCE)  # until the server has closed its end too
    until = time.monotonic() + PATIENCE
    while _is_open(port) and time.monotonic() < until:
        time.sleep(0.1)
    assert not _is_open(port)

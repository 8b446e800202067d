"""The server extension: what it sets and leaves alone, and that a real server loads it from the installed file."""

from __future__ import annotations

import importlib
import json
import socket
import subprocess
import sys
import tomllib
import urllib.request
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from browser.hosts import Host, start_host

from deformnb import server_extension

ROOT = Path(__file__).resolve().parents[1]
SETTING = "kernel_websocket_connection_class"
CHANNELS = "jupyter_server.services.kernels.connection.channels"

# A second extension in the same server, which reports of every kernel's socket whether it delays.
PROBE = """
import json, socket
from jupyter_server.base.handlers import JupyterHandler
from jupyter_server.services.kernels.connection.channels import ZMQChannelsWebsocketConnection as Connection

class Probe(JupyterHandler):
    def get(self):
        sockets = [c.websocket_handler.ws_connection.stream.socket for c in Connection._open_sockets]
        self.write(json.dumps([s.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) for s in sockets]))

def _load_jupyter_server_extension(app):
    app.web_app.add_handlers(".*", [("/probe", Probe)])
"""


class Server(Host):
    """Jupyter Server without a front end."""

    name, module = "Jupyter Server", "jupyter_server"
    options = ("--ip=127.0.0.1", "--IdentityProvider.token={token}", "--ServerApp.root_dir={folder}", "--allow-root")


def application(connection_class: Any) -> Any:
    """A server as the extension sees it, with the lines that it logs."""
    lines: list[str] = []
    return SimpleNamespace(
        web_app=SimpleNamespace(settings={SETTING: connection_class}),
        lines=lines,
        log=SimpleNamespace(info=lines.append),
    )


def usual() -> Any:
    return pytest.importorskip(CHANNELS).ZMQChannelsWebsocketConnection


def asked(server: Host, path: str, data: bytes | None = None) -> Any:
    with urllib.request.urlopen(server.url(path), data=data, timeout=120) as answer:
        return json.load(answer)


def connect(server: Host, kernel: str) -> socket.socket:
    """The client's end of a kernel's websocket, as far as the handshake."""
    page = socket.create_connection(("127.0.0.1", server.port), timeout=120)
    page.sendall(
        f"GET /api/kernels/{kernel}/channels?session_id=s&token={server.token} HTTP/1.1\r\n"
        f"Host: 127.0.0.1:{server.port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    assert page.recv(4096).startswith(b"HTTP/1.1 101")
    return page


@pytest.mark.parametrize(("enabled", "expected"), [(True, 1), (False, 0)])
def test_a_real_server_sends_small_messages_at_once(tmp_path: Path, enabled: bool, expected: int) -> None:
    (tmp_path / "probe_extension.py").write_text(PROBE, encoding="utf-8")
    extensions = {"probe_extension": True} | ({} if enabled else {"deformnb.server_extension": False})
    with start_host(Server, tmp_path, f"--ServerApp.jpserver_extensions={extensions}") as server:
        kernel = asked(server, "/api/kernels", data=b"{}")["id"]
        with connect(server, kernel):
            assert asked(server, "/probe") == [expected], server.messages()
        assert ("sent without delay" in server.messages()) == enabled


def test_it_takes_the_place_of_the_usual_class_only() -> None:
    app = application(usual())
    server_extension._load_jupyter_server_extension(app)
    assert app.web_app.settings[SETTING] is server_extension.PromptConnection
    assert issubclass(server_extension.PromptConnection, usual())
    assert len(app.lines) == 1
    others = type("Others", (usual(),), {})
    app = application(others)
    server_extension._load_jupyter_server_extension(app)
    assert app.web_app.settings[SETTING] is others
    assert app.lines == []


def test_an_older_server_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, CHANNELS, None)
    app = application(None)
    server_extension._load_jupyter_server_extension(app)
    assert app.web_app.settings == {SETTING: None}
    assert "cannot send small messages without delay" in app.lines[0]


@pytest.mark.parametrize("works", [True, False])
def test_the_kernel_is_connected_with_the_option_or_without(monkeypatch: pytest.MonkeyPatch, works: bool) -> None:
    calls: list[Any] = []

    def set_nodelay(value: bool) -> None:
        calls.append(value)
        if not works:
            raise OSError("no such option")

    monkeypatch.setattr(usual(), "connect", lambda self: calls.append("connected") or "future")
    monkeypatch.setattr(usual(), "__init__", lambda self: None)
    connection = server_extension.PromptConnection()
    monkeypatch.setattr(type(connection), "websocket_handler", SimpleNamespace(set_nodelay=set_nodelay))
    assert connection.connect() == "future"
    assert calls == [True, "connected"]


def test_voila_on_its_own_takes_the_class_by_name() -> None:
    voila = pytest.importorskip("voila.app")
    named = voila.Voila(kernel_websocket_connection_class="deformnb.server_extension.PromptConnection")
    assert named.kernel_websocket_connection_class is server_extension.PromptConnection


def test_the_installed_file_names_an_extension() -> None:
    tables = tomllib.loads((ROOT / "core" / "pyproject.toml").read_text(encoding="utf-8"))
    wheel = tables["tool"]["hatch"]["build"]["targets"]["wheel"]
    ((folder, target),) = wheel["shared-data"].items()
    assert target == "etc/jupyter"
    file = ROOT / folder / "jupyter_server_config.d" / "deformnb.json"
    ((name, enabled),) = json.loads(file.read_text(encoding="utf-8"))["ServerApp"]["jpserver_extensions"].items()
    assert enabled is True
    module = importlib.import_module(name)
    assert [point["module"] for point in module._jupyter_server_extension_points()] == [name]
    assert callable(module._load_jupyter_server_extension)


def test_it_can_be_read_without_jupyter_server() -> None:
    code = (
        "import sys; sys.modules['jupyter_server'] = None; import deformnb.server_extension as e; "
        "print(e._jupyter_server_extension_points(), hasattr(e, 'other'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout.strip() == "[{'module': 'deformnb.server_extension'}] False"

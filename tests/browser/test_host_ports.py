"""A server of a test whose port another program has taken meanwhile starts at another one."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest
from browser.hosts import Host, start_host


class Files(Host):
    """The standard library's server of files, which ends where its port is taken."""

    name, module = "http.server", "http.server"
    alone = ("{port}",)
    options = ("--bind=127.0.0.1",)
    ready = "/"
    ports: tuple[int, ...] = ()

    def free_port(self) -> int:
        first, *others = *self.ports, super().free_port()
        self.ports = tuple(others[:-1])
        return first


def test_a_server_whose_port_is_taken_starts_at_another_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        taken = other.getsockname()[1]
        monkeypatch.setattr(Files, "ports", (taken,))
        with start_host(Files, tmp_path) as server:
            assert server.port != taken
            assert server.process.poll() is None


def test_a_server_that_ends_for_another_reason_is_not_started_again(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="did not start"), start_host(Files, tmp_path, "--no-such-option"):
        pass

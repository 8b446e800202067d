"""A page of another site, open in the browser of a user of the application, that requests its sockets."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import Any

_ATTEMPTS = """async ([address, count]) => {
  const image = (k) => new Promise((done) => {
    const shown = new Image();
    shown.onload = () => done('shown');
    shown.onerror = () => done('refused');
    shown.src = `http://${address}/ws?${k}`;
    document.body.append(shown);
  });
  const socket = () => new Promise((done) => {
    const opened = new WebSocket(`ws://${address}/ws`);
    opened.onopen = () => done('open');
    opened.onerror = () => done('refused');
  });
  const fetched = (mode) => fetch(`http://${address}/ws`, {mode}).then((r) => r.type, () => 'refused');
  const all = [fetched('no-cors'), fetched('cors'), socket()];
  for (let k = 0; k < count; k += 1) all.push(image(k));
  return (await Promise.all(all)).slice(0, 4);
}"""


class _Blank(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        """Nothing."""


@contextlib.contextmanager
def blank_pages() -> Iterator[str]:
    """The origin of a server of empty pages on this machine."""
    server = HTTPServer(("127.0.0.1", 0), _Blank)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()
    thread.join(10)


def request_sockets(browser: Any, origin: str, address: str, count: int = 24) -> list[str]:
    """The replies of the server at this address to a page of this origin: by fetch twice, by a WebSocket, by an image.

    Parameters
    ----------
    address : host and port of the application.
    count : how many images request it.
    """
    page = browser.new_page()
    try:
        page.goto(f"{origin}/")
        answers: list[str] = page.evaluate(_ATTEMPTS, [address, count])
        return answers
    finally:
        page.close()

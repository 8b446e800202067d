"""Firefox by WebDriver BiDi and WebKitGTK by WebDriver: what Playwright drives is Chromium alone."""

from __future__ import annotations

import json
import os
import re
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import websocket
from waiting import PATIENCE

MINI_BROWSERS = sorted(Path("/usr/lib").glob("*/webkit2gtk-4.*/MiniBrowser"))
_PREFERENCES = {
    "webgl.force-enabled": True,
    "datareporting.policy.dataSubmissionEnabled": False,
    "network.captive-portal-service.enabled": False,
    "network.connectivity-service.enabled": False,
    "app.update.enabled": False,
}


def why_no_firefox() -> str:
    """The reason for which there is no Firefox to drive; empty where there is one."""
    if not _firefox():
        return "there is no Firefox (Debian: firefox-esr)"
    return "" if shutil.which("Xvfb") else "Firefox has no WebGL without a screen, which Xvfb would give"


def why_no_webkit() -> str:
    """The reason for which there is no WebKit to drive; empty where there is one."""
    if not (shutil.which("WebKitWebDriver") and MINI_BROWSERS):
        return "there is no WebKitWebDriver (Debian: webkit2gtk-driver)"
    return "" if shutil.which("Xvfb") else "WebKit needs Xvfb for its window"


def _firefox() -> str | None:
    return shutil.which("firefox-esr") or shutil.which("firefox")


class Tab:
    """A page in a browser, driven by commands that each browser sends in its own way."""

    def js(self, expression: str) -> Any:
        """Value of an expression, which may be a promise."""
        raise NotImplementedError

    def act(self, actions: list[dict[str, Any]]) -> None:
        """Perform the actions of a pointer or of keys, as WebDriver writes them."""
        raise NotImplementedError

    def goto(self, address: str) -> None:
        raise NotImplementedError

    def wait(self, condition: str, timeout: float = PATIENCE) -> None:
        """Until an expression holds."""
        end = time.monotonic() + timeout
        while not self.js(f"Boolean({condition})"):
            if time.monotonic() > end:
                raise TimeoutError(f"{condition} did not come true in {timeout} s")
            time.sleep(0.05)

    def drag(self, start: tuple[float, float], by: tuple[float, float], steps: int = 5) -> None:
        x, y = start
        places = [(round(x + by[0] * k / steps), round(y + by[1] * k / steps)) for k in range(steps + 1)]
        moves = [{"type": "pointerMove", "x": a, "y": b, "duration": 20} for a, b in places]
        down, up = ({"type": kind, "button": 0} for kind in ("pointerDown", "pointerUp"))
        self.act([{"type": "pointer", "id": "mouse", "actions": [moves[0], down, *moves[1:], up]}])

    def press(self, key: str, held: str) -> None:
        kinds = (("keyDown", held), ("keyDown", key), ("keyUp", key), ("keyUp", held))
        self.act([{"type": "key", "id": "keys", "actions": [{"type": kind, "value": value} for kind, value in kinds]}])


class FirefoxTab(Tab):
    def __init__(self, address: str) -> None:
        self.socket = websocket.create_connection(f"{address}/session", timeout=PATIENCE, suppress_origin=True)
        self.number = 0
        self.call("session.new", capabilities={})
        self.context = self.call("browsingContext.getTree")["contexts"][0]["context"]
        size = {"width": 940, "height": 560}
        self.call("browsingContext.setViewport", context=self.context, viewport=size)

    def call(self, method: str, **parameters: Any) -> Any:
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self.socket.recv())
            if answer.get("id") == self.number:
                assert answer["type"] == "success", answer
                return answer["result"]

    def js(self, expression: str) -> Any:
        found = self.call(
            "script.callFunction",
            functionDeclaration=f"async () => JSON.stringify(await ({expression}) ?? null)",
            target={"context": self.context},
            awaitPromise=True,
        )
        assert found["type"] == "success", found
        return json.loads(found["result"]["value"])

    def act(self, actions: list[dict[str, Any]]) -> None:
        self.call("input.performActions", context=self.context, actions=actions)

    def goto(self, address: str) -> None:
        self.call("browsingContext.navigate", context=self.context, url=address, wait="complete")


class WebKitTab(Tab):
    def __init__(self, port: int) -> None:
        self.address = f"http://127.0.0.1:{port}/session"
        options = {"binary": str(MINI_BROWSERS[-1]), "args": ["--automation", "--geometry=940x700"]}
        made = self.call("", capabilities={"alwaysMatch": {"webkitgtk:browserOptions": options}})
        self.address += f"/{made['sessionId']}"

    def call(self, path: str, **parameters: Any) -> Any:
        sent = urllib.request.Request(self.address + path, json.dumps(parameters).encode(), method="POST")
        with urllib.request.urlopen(sent, timeout=PATIENCE) as answer:
            return json.load(answer)["value"]

    def js(self, expression: str) -> Any:
        script = (
            f"const done = arguments[0]; (async () => JSON.stringify(await ({expression}) ?? null))().then(done, done)"
        )
        return json.loads(self.call("/execute/async", script=script, args=[]))

    def act(self, actions: list[dict[str, Any]]) -> None:
        self.call("/actions", actions=actions)

    def goto(self, address: str) -> None:
        self.call("/url", url=address)


@contextmanager
def _running(command: list[str], folder: Path, **variables: str) -> Iterator[Path]:
    """A program with its own home, ended with all that it has started; its output is in the file."""
    environment = {**os.environ, "HOME": str(folder), "LIBGL_ALWAYS_SOFTWARE": "1", **variables}
    for name in ("CACHE", "CONFIG", "DATA"):
        environment[f"XDG_{name}_HOME"] = str(folder / name.lower())
    said = folder / f"{Path(command[0]).name}.txt"
    with said.open("wb") as output:
        program = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, env=environment, start_new_session=True
        )
    try:
        yield said
    finally:
        os.killpg(program.pid, 9)
        program.wait()


def _await_text(said: Path, pattern: str) -> str:
    """The first group of a pattern in what a program says, once it has said it."""
    end = time.monotonic() + PATIENCE
    while not (found := re.search(pattern, said.read_text(encoding="utf-8", errors="replace"))):
        if time.monotonic() > end:
            raise TimeoutError(said.read_text(encoding="utf-8", errors="replace")[-1000:])
        time.sleep(0.05)
    return found[1]


@contextmanager
def _screen(folder: Path) -> Iterator[str]:
    """The name of a screen without a monitor."""
    with _running(["Xvfb", "-displayfd", "1", "-screen", "0", "1280x1024x24"], folder) as said:
        yield ":" + _await_text(said, r"(?m)^(\d+)$")


@contextmanager
def firefox_tab(folder: Path) -> Iterator[Tab]:
    """A page of a Firefox with a new profile."""
    profile, program = folder / "profile", _firefox()
    assert program
    profile.mkdir()
    lines = (f"user_pref({json.dumps(name)}, {json.dumps(value)});\n" for name, value in _PREFERENCES.items())
    (profile / "user.js").write_text("".join(lines), encoding="utf-8")
    command = [program, "--headless", "--no-remote", "--profile", str(profile), "--remote-debugging-port", "0"]
    with _screen(folder) as display, _running(command, folder, DISPLAY=display) as said:
        tab = FirefoxTab(_await_text(said, r"listening on (ws://\S+)"))
        try:
            yield tab
        finally:
            tab.socket.close()


@contextmanager
def webkit_tab(folder: Path) -> Iterator[Tab]:
    """A page of WebKitGTK's small browser in a window on a screen of its own."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    driver = ["WebKitWebDriver", f"--port={port}"]
    variables = {"WEBKIT_DISABLE_SANDBOX_THIS_IS_DANGEROUS": "1"}  # a container has no namespaces for it
    with _screen(folder) as display, _running(driver, folder, DISPLAY=display, **variables):
        end = time.monotonic() + PATIENCE
        while True:
            try:
                urllib.request.urlopen(f"http://127.0.0.1:{port}/status", timeout=PATIENCE).close()
                break
            except (urllib.error.URLError, ConnectionError):
                if time.monotonic() > end:
                    raise
                time.sleep(0.05)
        yield WebKitTab(port)

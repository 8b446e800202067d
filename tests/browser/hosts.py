"""The programs that show notebooks in a page: JupyterLab, Notebook 7 and Voila, each real and on this machine."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
SMALL_STUDIO = """
import numpy as np
from deformnb import Grid, Volume
from deformnb.widgets import Studio
z, y, x = np.indices((40, 24, 40))
ball = (x - 19.5) ** 2 + (y - 11.5) ** 2 + (z - 19.5) ** 2 < 9 ** 2
studio = Studio(Volume(np.where(ball, 250, 0).astype(np.uint8), Grid((40, 24, 40)), name="ball"), side="+y", height=260)
studio
"""
"""The cell of a studio that is quickly there."""

_PORT_TAKEN = ("is not available", "in use")  # in the servers' words, who end then


class Host:
    """A server on the loopback with a separate token; its folders are in ``folder`` and nowhere else.

    Parameters
    ----------
    folder : folder of notebooks, settings and the server's log.
    options : further options of its command line.
    """

    name = ""
    module = ""
    requires: tuple[str, ...] = ()
    alone: tuple[str, ...] = ("--no-browser", "--port={port}")
    options: tuple[str, ...] = ()
    address = "{name}"
    ready = "/api"
    place = ""
    """Folder of the notebooks within the server's, with a slash at its end."""

    def __init__(self, folder: Path, *options: str) -> None:
        self.folder = folder
        self.prepare()
        self.token = secrets.token_hex(16)
        self.log = (folder / "server.log").open("wb")
        self._options = options
        self._launch()

    def free_port(self) -> int:
        """A port that is free now, and that another program may take before the server does."""
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            return int(free.getsockname()[1])

    def _launch(self) -> None:
        self.port = self.free_port()
        command = [
            sys.executable,
            "-m",
            self.module,
            *(
                option.format(folder=self.folder, token=self.token, port=self.port)
                for option in (*self.alone, *self.options)
            ),
            *self._options,
        ]
        self.process = subprocess.Popen(
            command,
            env=self._environment(),
            cwd=self.folder,
            stdout=self.log,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            start_new_session=True,
        )

    def prepare(self) -> None:
        """Settings that are files."""

    def _environment(self) -> dict[str, str]:
        own = {
            name: str(self.folder / name.lower())
            for name in (
                "JUPYTER_CONFIG_DIR",
                "JUPYTER_DATA_DIR",
                "JUPYTER_RUNTIME_DIR",
                "IPYTHONDIR",
                "JUPYTERLAB_SETTINGS_DIR",
                "JUPYTERLAB_WORKSPACES_DIR",
            )
        }
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
        # The server's extension is enabled by the file that the package installs, also where it is not installed.
        own["DEFORMNB_STATE"] = str(self.folder / "state")  # what other servers have left is not offered here
        of_tests = ("JAX_DEBUG_NANS", "XLA_FLAGS")
        inherited = {name: value for name, value in os.environ.items() if name not in of_tests}
        return {
            **inherited,
            **own,
            "PATH": path,
            "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "lessons"), str(self.folder)]),
            "JUPYTER_CONFIG_PATH": str(ROOT / "jupyter-config"),
        }

    @classmethod
    def missing(cls) -> str:
        """The reason for which it cannot be run here, or an empty text."""
        absent = [
            module for module in (cls.module, "ipykernel", *cls.requires) if importlib.util.find_spec(module) is None
        ]
        return f"{absent[0]} is not installed: pip install deformnb[test]" if absent else ""

    def started(self, timeout: float = 180.0) -> None:
        """Wait until the server answers; where its port was taken meanwhile, it is started again at another."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            if self.process.poll() is not None:
                if not any(words in self.messages() for words in _PORT_TAKEN):
                    break
                self.log.truncate(0)
                self._launch()
            try:
                with urllib.request.urlopen(self.url(self.ready), timeout=2):
                    is_there = True
            except urllib.error.HTTPError as error:
                is_there = error.code in (403, 404)  # it has no such page
            except (urllib.error.URLError, OSError):
                is_there = False
            if is_there and self.process.poll() is None:
                return
            time.sleep(0.2)
        raise RuntimeError(f"{self.name} did not start:\n{self.messages()[-2000:]}")

    def messages(self) -> str:
        """The server's output."""
        return (self.folder / "server.log").read_text(errors="replace", encoding="utf-8")

    def url(self, path: str) -> str:
        """The address of a page of the server, with the token."""
        return f"http://127.0.0.1:{self.port}{path}?token={self.token}"

    def write_notebook(self, cells: list[str], name: str) -> None:
        """A notebook with these cells in the server's folder."""
        kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
        code = [
            {
                "cell_type": "code",
                "id": f"cell-{k}",
                "metadata": {},
                "execution_count": None,
                "outputs": [],
                "source": cell,
            }
            for k, cell in enumerate(cells)
        ]
        notebook = {"nbformat": 4, "nbformat_minor": 5, "metadata": {"kernelspec": kernel}, "cells": code}
        path = self.folder / self.place / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps(notebook), encoding="utf-8")

    def open_notebook(self, page: Any, cells: list[str], name: str = "test.ipynb") -> None:
        """A notebook with these cells in a page of a browser, all of them run."""
        raise NotImplementedError

    def save(self, page: Any) -> None:
        """Save the page's notebook to its file, where the host can."""

    def close(self) -> None:
        """End the server and its kernels."""
        for kind in (signal.SIGTERM, signal.SIGKILL):
            try:
                os.killpg(self.process.pid, kind)
                self.process.wait(10)
                break
            except subprocess.TimeoutExpired:
                continue
            except ProcessLookupError:
                break
        self.log.close()


class _Application(Host):
    """JupyterLab and Notebook 7, which show the same application object to the tests."""

    def open_notebook(self, page: Any, cells: list[str], name: str = "test.ipynb") -> None:
        self.write_notebook(cells, name)
        workspace = f"{self.place}{name}".replace("/", "-").removesuffix(".ipynb")
        page.goto(self.url(self.address.format(name=self.place + name, workspace=workspace)))
        self.wait_until_open(page)
        self.run_all(page)

    def wait_until_open(self, page: Any) -> None:
        """Wait until the notebook is open with a kernel."""
        page.wait_for_function("window.jupyterapp?.shell.currentWidget?.sessionContext", timeout=90_000)
        page.evaluate("""async () => {
            await jupyterapp.restored;
            const { context, sessionContext } = jupyterapp.shell.currentWidget;
            await context.ready;
            await sessionContext.ready;
        }""")

    def run_all(self, page: Any) -> None:
        """Run all cells and wait for the last."""
        page.evaluate("() => jupyterapp.commands.execute('notebook:run-all-cells')")

    def save(self, page: Any) -> None:
        page.evaluate("() => jupyterapp.shell.currentWidget.context.save()")

    def run(self, page: Any, code: str) -> str:
        """The output of a new cell at the end of the notebook."""
        return str(
            page.evaluate(
                """async (code) => {
            const { sessionContext } = jupyterapp.shell.currentWidget;
            const future = sessionContext.session.kernel.requestExecute({ code, store_history: false });
            let text = "";
            future.onIOPub = ({ content }) => { text += content.text ?? content.traceback?.join("\\n") ?? ""; };
            await future.done;
            return text;
        }""",
                code,
            )
        )

    def end_kernels(self) -> None:
        """End all kernels, and remove their autosaved files."""
        for kernel in self._ask("GET", "/api/kernels"):
            for _ in range(20):
                with contextlib.suppress(urllib.error.HTTPError):  # it is just being restarted
                    self._ask("DELETE", f"/api/kernels/{kernel['id']}")
                    break
                time.sleep(0.5)
        shutil.rmtree(self.folder / "state", ignore_errors=True)

    def _ask(self, method: str, path: str) -> Any:
        request = urllib.request.Request(
            self.url(path), method=method, headers={"Authorization": f"token {self.token}"}
        )
        with urllib.request.urlopen(request, timeout=60) as answer:
            return json.loads(answer.read() or "null")

    def dark(self, page: Any, dark: bool = True) -> None:
        """Set the dark theme or the light one."""
        theme = "JupyterLab Dark" if dark else "JupyterLab Light"
        page.evaluate("(theme) => jupyterapp.commands.execute('apputils:change-theme', { theme })", theme)
        page.wait_for_function(f"document.body.dataset.jpThemeLight === '{str(not dark).lower()}'")


class Lab(_Application):
    """JupyterLab."""

    name, module, requires = "JupyterLab", "jupyterlab", ("jupyterlab",)
    address = "/lab/workspaces/{workspace}/tree/{name}"  # else it opens the notebooks of other tabs as well
    options = (
        "--ip=127.0.0.1",
        "--IdentityProvider.token={token}",
        "--ServerApp.root_dir={folder}",
        "--allow-root",
        "--ServerApp.port_retries=0",
        "--LabApp.expose_app_in_browser=True",
        "--LabApp.news_url=",
        "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
    )

    def prepare(self) -> None:
        settings = self.folder / "jupyterlab_settings_dir" / "@jupyterlab" / "apputils-extension"
        settings.mkdir(parents=True, exist_ok=True)  # it would request permission to fetch news
        (settings / "notification.jupyterlab-settings").write_text('{"fetchNews": "false"}', encoding="utf-8")


class Notebook(_Application):
    """Jupyter Notebook, version 7."""

    name, module, requires = "Notebook 7", "notebook", ("jupyterlab",)
    address = "/notebooks/{name}"
    options = (
        "--ip=127.0.0.1",
        "--IdentityProvider.token={token}",
        "--ServerApp.root_dir={folder}",
        "--allow-root",
        "--ServerApp.port_retries=0",
        "--JupyterNotebookApp.expose_app_in_browser=True",
    )


class Voila(Host):
    """Voila, which runs a notebook for each page and shows only the results of the cells."""

    name, module = "Voila", "voila"
    address = "/voila/render/{name}"
    ready = "/voila/static/voila.js"
    options = ("--Voila.ip=127.0.0.1", "--Voila.token={token}", "--Voila.root_dir={folder}", "--Voila.port_retries=0")

    def open_notebook(self, page: Any, cells: list[str], name: str = "test.ipynb") -> None:
        self.write_notebook(cells, name)
        page.goto(self.url(self.address.format(name=name)), timeout=90_000)


def read_report(page: Any, reached: Callable[[Any], bool] = lambda state: True, patience: float = 60.0) -> Any:
    """The JSON of the label with class "report", once it is as wanted; after a minute as it is."""
    end = time.monotonic() + patience
    while True:
        page.wait_for_function("document.querySelector('.report')?.innerText.length > 1")  # empty while redrawn
        text = page.locator(".report").first.inner_text()
        state = json.loads(text) if text else None
        if state is not None and (reached(state) or time.monotonic() > end):
            return state
        page.wait_for_timeout(100)


@contextlib.contextmanager
def start_host(host: type[Host], folder: Path, *options: str) -> Iterator[Any]:
    """A host while a test needs it; skips the test where it is not installed."""
    if host.missing():
        pytest.skip(host.missing())
    server = host(folder, *options)
    try:
        server.started()
        yield server
    finally:
        server.close()


AT_REST = """() => {
  const editor = document.querySelector('.dnb-editor')?.deformnb;
  const loop = document.querySelector('.dnb-view')?.deformnb.loop;
  return Boolean(editor && !editor.frames.isMoving && !editor.frames.request && loop && !loop.isRequested && !loop.rush
    && loop.screen.drawn[loop.screen.layer] === `full${loop.screen.layer}`);
}"""
"""Check that picture and volume of a studio in a page are drawn in full."""


def box_at_rest(element: Any) -> Any:
    """The bounding box of an element at rest: a page that was just loaded is still being laid out."""
    element.evaluate("""async (element) => {
      const place = () => JSON.stringify([element.getBoundingClientRect(), scrollX, scrollY]);
      for (let still = 0, since = performance.now(), last = place(); still < 10 || performance.now() - since < 200;) {
        await new Promise(requestAnimationFrame);
        if (place() === last) still += 1; else [still, since, last] = [0, performance.now(), place()];
      }
    }""")
    return element.bounding_box()


def wait_idle(host: Host, page: Any) -> None:
    """Wait until client and kernel have read each other's messages, and picture and volume are drawn in full."""
    heard = "document.querySelector('.dnb-editor')?.deformnb?.sender.isBehind() === false"
    page.wait_for_function(heard, timeout=60_000)
    if isinstance(host, _Application):
        host.run(page, "")  # after all messages of the client, and answered after all of the kernel's
    page.wait_for_function(AT_REST, timeout=60_000)

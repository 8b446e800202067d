"""A real JupyterLab on this machine, with a notebook of some cells, driven by Playwright."""

from __future__ import annotations

import json
import os
import secrets
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any


class Lab:
    """JupyterLab on the loopback with a token of its own; its folders are in ``folder`` and nowhere else."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.token = secrets.token_hex(16)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        root = Path(__file__).resolve().parents[2]
        own = {name: str(folder / name.lower()) for name in
               ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "IPYTHONDIR",
                "JUPYTERLAB_SETTINGS_DIR", "JUPYTERLAB_WORKSPACES_DIR")}
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
        environment = {**os.environ, **own, "PATH": path, "PYTHONPATH": str(root)}
        command = [sys.executable, "-m", "jupyterlab", "--no-browser", "--ip=127.0.0.1", f"--port={self.port}",
                   f"--IdentityProvider.token={self.token}", f"--ServerApp.root_dir={folder}", "--allow-root",
                   "--LabApp.expose_app_in_browser=True", "--LabApp.news_url=",
                   "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate"]
        self.log = (folder / "lab.log").open("wb")
        self.process = subprocess.Popen(command, env=environment, cwd=folder, stdout=self.log, stderr=subprocess.STDOUT,
                                        start_new_session=True)

    def started(self, timeout: float = 60.0) -> None:
        """Until the server answers."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            try:
                with urllib.request.urlopen(f"http://127.0.0.1:{self.port}/api?token={self.token}", timeout=2):
                    return
            except (urllib.error.URLError, OSError):
                time.sleep(0.2)
            if self.process.poll() is not None:
                break
        raise RuntimeError(f"JupyterLab did not start:\n{(self.folder / 'lab.log').read_text()[-2000:]}")

    def open_notebook(self, page: Any, cells: list[str], name: str = "test.ipynb") -> None:
        """A notebook with these cells in a page of a browser, all of them run."""
        kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
        code = [{"cell_type": "code", "id": f"cell-{k}", "metadata": {}, "execution_count": None, "outputs": [],
                 "source": cell} for k, cell in enumerate(cells)]
        notebook = {"nbformat": 4, "nbformat_minor": 5, "metadata": {"kernelspec": kernel}, "cells": code}
        (self.folder / name).write_text(json.dumps(notebook), encoding="utf-8")
        page.goto(f"http://127.0.0.1:{self.port}/lab/tree/{name}?token={self.token}")
        page.wait_for_function("window.jupyterapp?.shell.currentWidget?.sessionContext", timeout=90_000)
        page.evaluate("""async () => {
            await jupyterapp.restored;
            const { context, sessionContext } = jupyterapp.shell.currentWidget;
            await context.ready;
            await sessionContext.ready;
            await jupyterapp.commands.execute("notebook:run-all-cells");
        }""")

    def run(self, page: Any, code: str) -> str:
        """What a new cell at the end of the notebook prints."""
        return str(page.evaluate("""async (code) => {
            const { sessionContext } = jupyterapp.shell.currentWidget;
            const future = sessionContext.session.kernel.requestExecute({ code, store_history: false });
            let text = "";
            future.onIOPub = ({ content }) => { text += content.text ?? content.traceback?.join("\\n") ?? ""; };
            await future.done;
            return text;
        }""", code))

    def close(self) -> None:
        """Ends the server and its kernels."""
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

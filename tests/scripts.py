"""Runs modules of the front end in Node.js, without a page."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import node_tasks
from deformnb.widgets.bundle import SOURCES

# A function of the input that returns the output; both are JSON. NaN and infinity do not survive JSON, so no test
# relies on them.
_RUN = """
import { readFileSync } from "node:fs";
process.stdout.write(JSON.stringify(await main(JSON.parse(readFileSync(0, "utf8")))));
"""


@cache
def chromium() -> str | None:
    """Path of a Chromium that Playwright can drive, or None."""
    try:
        import playwright  # noqa: F401
    except ImportError:
        return None
    names = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")  # the first is the quickest
    return next((path for name in names if (path := shutil.which(name))), None)


@cache
def _node() -> str:
    return node_tasks.find_node()[0]


def run_script(modules: tuple[str, ...], main: str, data: Any) -> Any:
    """Result of ``main``, the text of a JavaScript function, for ``data``; it sees all that these modules export."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [_node(), str(_program(modules, main, Path(folder)))],
            input=json.dumps(data),
            capture_output=True,
            encoding="utf-8",
            timeout=300,
            check=False,
        )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def _program(modules: tuple[str, ...], main: str, folder: Path) -> Path:
    """One bundle of the modules and the function; what they export is global."""
    imports = "".join(
        f"import * as m{k} from '{(SOURCES / name).as_posix()}';\nObject.assign(globalThis, m{k});\n"
        for k, name in enumerate(modules)
    )
    source = folder / "main.js"
    source.write_text(f"{imports}\nconst main = {main};\n{_RUN}", encoding="utf-8")
    node_tasks.bundle_modules([source], folder)
    return folder / "main.mjs"

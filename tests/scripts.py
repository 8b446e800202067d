"""Runs the widgets' JavaScript without a page: in node, or in a headless Chromium where there is no node."""

from __future__ import annotations

import json
import shutil
import subprocess
from functools import cache
from typing import Any

import pytest

from deformnb.widgets.bundle import joined

# A function of the input that returns the output; both are JSON. NaN and infinity do not survive JSON, so no test
# relies on them.
_NODE = """
const chunks = [];
process.stdin.on("data", (chunk) => chunks.push(chunk));
process.stdin.on("end", () => process.stdout.write(JSON.stringify(main(JSON.parse(Buffer.concat(chunks).toString())))));
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


def run_script(files: tuple[str, ...], main: str, data: Any) -> Any:
    """What ``main``, the text of a JavaScript function, returns for ``data`` after these files of the widgets."""
    source = f"{joined(*files)}\nconst main = {main};\n"
    node = shutil.which("node") or shutil.which("nodejs")
    if node is not None:
        done = subprocess.run([node, "--input-type=module", "--eval", source + _NODE], input=json.dumps(data),
                              capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)
    path = chromium()
    if path is None:
        pytest.skip("neither node nor Chromium with Playwright is installed, so the widgets' scripts cannot run")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        browser = p.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        try:
            return browser.new_page().evaluate(f"(data) => {{ {source} return main(data); }}", data)
        finally:
            browser.close()

"""Executed notebooks with a studio in viewers without a kernel, offline: a page to drag, or the picture.

Each viewer is the program itself, or for those that run elsewhere what they are known to do with a notebook: Quarto has
pandoc convert it to one file, and a code host's viewer removes scripts, frames and styles from nbconvert's page.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
from collections.abc import Callable
from html import escape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any, ClassVar

import pytest
from browser.test_embedded_page import OPENED, wait_for

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
nbconvert = pytest.importorskip("nbconvert")

pytestmark = [pytest.mark.needs_browser, pytest.mark.nightly]

CELL = """import deformnb as dn
studio = dn.Studio(dn.datasets.PHANTOMS["fish"].make((16, 32, 16)))
studio"""
IS_SHOWN = """() => [...document.images].filter((image) => image.complete && image.naturalWidth > 300
  && image.getBoundingClientRect().width > 300).length"""


@pytest.fixture(scope="module", params=["1", "0"], ids=["embedded", "picture"])
def notebook(request: pytest.FixtureRequest) -> tuple[bool, Any]:
    """A notebook as a program has run it, with ``DEFORMNB_EMBED`` and without."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DEFORMNB_EMBED", request.param)
        cells = [nbformat.v4.new_markdown_cell("# A fish"), nbformat.v4.new_code_cell(CELL)]
        made = nbformat.v4.new_notebook(cells=cells)
        nbclient.NotebookClient(made, timeout=300, kernel_name="python3").execute()
    return request.param == "1", made


def nbviewer(notebook: Any, folder: Path) -> str:
    """A page of nbconvert with nothing removed, which nbviewer puts into its own."""
    page: str = nbconvert.HTMLExporter(template_name="basic").from_notebook_node(notebook)[0]
    return page


class _Harmless(HTMLParser):
    """HTML without scripts, styles and frames, and with no attributes but addresses and the texts of pictures."""

    kept: ClassVar[set[str]] = {"a", "p", "pre", "code", "span", "div", "img", "h1", "h2", "table", "tr", "td", "th"}

    def __init__(self, page: str) -> None:
        super().__init__()
        self.parts: list[str] = []
        self._dropped = 0
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._dropped += tag in ("script", "style", "iframe")
        if tag in self.kept and not self._dropped:
            left = [f' {name}="{escape(value or "")}"' for name, value in attrs if name in ("href", "src", "alt")]
            self.parts.append(f"<{tag}{''.join(left)}>")

    def handle_endtag(self, tag: str) -> None:
        if tag in self.kept and not self._dropped:
            self.parts.append(f"</{tag}>")
        self._dropped -= tag in ("script", "style", "iframe")

    def handle_data(self, data: str) -> None:
        if not self._dropped:
            self.parts.append(escape(data))


def code_host(notebook: Any, folder: Path) -> str:
    """The same page with nothing left in it that could do harm."""
    return "".join(_Harmless(nbviewer(notebook, folder)).parts)


def quarto(notebook: Any, folder: Path) -> str:
    """A file that pandoc makes, which Quarto runs with its own templates."""
    pandoc = shutil.which("pandoc")
    if pandoc is None:
        pytest.skip(
            "pandoc is not installed: see https://pandoc.org, or pip install pypandoc_binary, which contains it"
        )
    nbformat.write(notebook, folder / "fish.ipynb")
    options = ["--standalone", "--embed-resources", "--metadata", "title=A fish", "--output", "fish.html"]
    subprocess.run([pandoc, "fish.ipynb", *options], cwd=folder, check=True, timeout=300)
    return (folder / "fish.html").read_text("utf-8")


def book(notebook: Any, folder: Path) -> str:
    """A page of MyST-NB, of which Jupyter Book 1 is made."""
    if importlib.util.find_spec("myst_nb") is None:
        pytest.skip("MyST-NB is not installed: pip install deformnb[docs]")
    nbformat.write(notebook, folder / "index.ipynb")
    (folder / "conf.py").write_text('extensions = ["myst_nb"]\nnb_execution_mode = "off"\n', encoding="utf-8")
    subprocess.run(
        [sys.executable, "-m", "sphinx", "-q", "-b", "html", str(folder), str(folder / "html")], check=True, timeout=300
    )
    return (folder / "html" / "index.html").read_text("utf-8")


@pytest.mark.parametrize("viewer", [nbviewer, code_host, quarto, book])
def test_a_reader_sees_a_page_to_drag_or_the_picture(
    viewer: Callable[[Any, Path], str], notebook: tuple[bool, Any], tmp_path: Path, browser: Any
) -> None:
    is_embedded, made = notebook
    text = viewer(made, tmp_path)
    folder = tmp_path / "html" if (tmp_path / "html").is_dir() else tmp_path
    (folder / "page.html").write_text(text, encoding="utf-8")
    context = browser.new_context(viewport={"width": 1100, "height": 1200}, offline=True)
    page = context.new_page()
    page.goto((folder / "page.html").as_uri(), wait_until="commit")
    page.wait_for_function(f"({IS_SHOWN})() > 0", timeout=30_000)
    frames = page.locator("iframe.dnb-embedded")
    assert frames.count() == (is_embedded and viewer is not code_host)
    if frames.count():
        frames.first.scroll_into_view_if_needed()
        wait_for(frames.first.element_handle().content_frame(), OPENED)
    assert "Studio(" not in page.locator("body").inner_text().replace("dn.Studio(", "")
    page.screenshot(path=tmp_path / "seen.png")
    context.close()

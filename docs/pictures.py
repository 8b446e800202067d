"""Pictures of the documentation: each is made at the build by the Python that the page shows above it.

A page in Markdown has blocks of Python, which run in their order as in a notebook, and below a block the directive::

    ```{picture} A carp, straight and bent
    :file: swim.gif
    :width: 480px

    The caption, in Markdown.
    ```

Its argument is the text for those who do not see the picture. The picture is the value of the last expression of the
block above (a figure, an image of PIL, an array of pixels), else the figure of pyplot that it has left, or the file
that it has written and the option ``file`` names. The directive ``cards`` lists pages below, as ``toctree`` does, each
as a card with its title and its first picture, which is ``/_pictures/howto/points_card.webp`` of ``howto/points.md``.
"""

from __future__ import annotations

import ast
import hashlib
import io
import json
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from docutils import nodes
from docutils.parsers.rst import directives
from docutils.statemachine import StringList
from PIL import Image
from sphinx.builders.html import StandaloneHTMLBuilder
from sphinx.util.docutils import SphinxDirective

DOCS = Path(__file__).resolve().parent
PACKAGE = DOCS.parent / "deformnb"
FOLDER = "_pictures"

READERS_FILE = "scan.nii.gz"
"""A block that names this file, which only a reader has, is not run."""

WIDTH = 640  # pixels of the page that a picture is wide, at most
_PIXELS = 2 * WIDTH  # of the file: displays have two for each of the page
_QUALITY = 80
_CARD = (480, 360)
_DPI = 200  # of figures, before they are made smaller
_PART = re.compile(r"^```(python|\{picture\})[ \t]*(.*)\n((?:.*\n)*?)```[ \t]*$", re.MULTILINE)


def page_parts(text: str) -> list[tuple[str, str, str]]:
    """Blocks of Python and pictures of a page, in their order: (kind, argument, content)."""
    return [(found[1].strip("{}"), found[2].strip(), found[3]) for found in _PART.finditer(text)]


def run_page(text: str, folder: Path) -> list[Any]:
    """Run the Python of a page in a folder; what its pictures show: a picture, or the path of a file.

    Raises
    ------
    ValueError
        If there is nothing to show, with the text of the picture.
    """
    scope: dict[str, Any] = {"__name__": "__main__"}
    shown: list[Any] = []
    value = None
    with _in_folder(folder):
        for kind, argument, content in page_parts(text):
            if kind == "picture":
                file = re.search(r"^:file:\s*(\S+)", content, re.MULTILINE)
                shown.append(folder / file[1] if file else _shown(value, argument))
            elif READERS_FILE not in content:
                value = _run_block(content, scope)
    return shown


def _run_block(content: str, scope: dict[str, Any]) -> Any:
    """Run a block; the value of its last expression."""
    tree = ast.parse(content)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    with redirect_stdout(io.StringIO()):
        exec(compile(tree, "<page>", "exec"), scope)
        if last is None:
            return None
        return eval(compile(ast.Expression(last.value), "<page>", "eval"), scope)  # type: ignore[attr-defined]


def _shown(value: Any, alt: str) -> Any:
    """The value if it is a picture, else the figure that pyplot has."""
    import matplotlib.pyplot as plt

    if hasattr(value, "savefig") or isinstance(value, Image.Image):
        return value
    if isinstance(value, np.ndarray) and value.dtype == np.uint8 and value.ndim == 3:
        return Image.fromarray(value)
    if plt.get_fignums():
        figure = plt.gcf()
        plt.close("all")
        return figure
    raise ValueError(f"the block of Python above the picture {alt!r} ends with no picture, but with {value!r:.60}.")


@contextmanager
def _in_folder(folder: Path) -> Iterator[None]:
    import matplotlib as mpl

    mpl.use("agg")
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def write_picture(shown: Any, stem: Path) -> Path:
    """Write what :func:`run_page` has returned: a WebP of at most 1280 pixels, or a copy of the file."""
    stem.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(shown, Path):
        return Path(shutil.copyfile(shown, stem.with_suffix(shown.suffix)))
    if hasattr(shown, "savefig"):
        stream = io.BytesIO()
        shown.savefig(stream, format="png", dpi=_DPI, facecolor=shown.get_facecolor())
        shown = Image.open(stream)
    image = shown.convert("RGB")
    if image.width > _PIXELS:
        image = image.resize((_PIXELS, round(image.height * _PIXELS / image.width)), Image.Resampling.LANCZOS)
    file = stem.with_suffix(".webp")
    image.save(file, quality=_QUALITY, method=6)
    return file


def write_card(picture: Path, file: Path) -> None:
    """Write a picture as one of 4:3, on the colour of its corner; of a moving one the first."""
    image = Image.open(picture).convert("RGB")
    image.thumbnail(_CARD, Image.Resampling.LANCZOS)
    card = Image.new("RGB", _CARD, image.getpixel((0, 0)))
    card.paste(image, ((_CARD[0] - image.width) // 2, (_CARD[1] - image.height) // 2))
    card.save(file, quality=_QUALITY, method=6)


# -- for Sphinx --------------------------------------------------------------------------------------------------------


def _digest_of_package() -> str:
    digest = hashlib.sha256()
    for file in sorted(PACKAGE.rglob("*.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def make_pictures(docs: Path = DOCS) -> None:
    """Make the pictures of all pages whose Python, or the package, has changed since they were made."""
    package = _digest_of_package()
    for page in sorted([*docs.glob("*.md"), *docs.glob("howto/*.md")]):
        text = page.read_text(encoding="utf-8")
        if not any(kind == "picture" for kind, _, _ in page_parts(text)):
            continue
        stem = docs / FOLDER / page.relative_to(docs).with_suffix("")
        key = hashlib.sha256((repr(page_parts(text)) + package).encode()).hexdigest()
        made = stem.with_name(f"{stem.name}.key")
        if made.exists() and made.read_text(encoding="utf-8") == key:
            continue
        with tempfile.TemporaryDirectory() as folder:
            last = [found.end() for found in _PART.finditer(text) if found[1] != "python"][-1]
            for number, shown in enumerate(run_page(text[:last], Path(folder)), 1):
                file = write_picture(shown, stem.with_name(f"{stem.name}_{number}"))
                if number == 1:
                    write_card(file, stem.with_name(f"{stem.name}_card.webp"))
        made.write_text(key, encoding="utf-8")


class PictureDirective(SphinxDirective):
    """The directive ``picture``: a figure of what the Python above it has made."""

    required_arguments = 1
    final_argument_whitespace = True
    has_content = True
    option_spec: ClassVar = {
        "file": directives.unchanged_required,
        "width": directives.length_or_percentage_or_unitless,
    }

    def run(self) -> list[nodes.Node]:
        """Return a figure with its caption."""
        count = self.env.temp_data["picture"] = self.env.temp_data.get("picture", 0) + 1
        suffix = Path(self.options.get("file", ".webp"))
        stem = f"/{FOLDER}/{self.env.docname}_{count}"
        image = nodes.image(
            uri=f"{stem}{suffix.suffix or suffix}",
            alt=self.arguments[0].replace("\n", " "),
            width=self.options.get("width", f"{WIDTH}px"),
            classes=["made-picture"],
        )
        self.set_source_info(image)
        figure = nodes.figure("", image)
        if self.content:
            parsed = nodes.Element()
            self.state.nested_parse(self.content, self.content_offset, parsed)
            figure += nodes.caption("", "", *parsed[0].children)
        return [figure]


class CardsDirective(SphinxDirective):
    """The directive ``cards``: a hidden table of contents, and a card for each page, with the text after its colon."""

    has_content = True

    def run(self) -> list[nodes.Node]:
        """Return what Markdown makes of a toctree and a grid of cards."""
        rows = [line.partition(": ")[::2] for line in self.content if line.strip()]
        lines = [
            "```{toctree}",
            ":hidden:",
            "",
            *(page for page, _ in rows),
            "```",
            "",
            "::::{grid} 1 2 3 3",
            ":gutter: 3",
            "",
        ]
        for page, text in rows:
            lines += [
                ":::{grid-item-card}",
                f":link: {page}",
                ":link-type: doc",
                *self._picture(page),
                ":class-card: page-card",
            ]
            lines += ["", f"**{self._title(page)}**", "", text, ":::", ""]
        parsed = nodes.Element()
        self.state.nested_parse(StringList([*lines, "::::"], self.env.docname), self.content_offset, parsed)
        return parsed.children

    def _name(self, page: str) -> str:
        return self.env.relfn2path(f"{page}.md")[0].removesuffix(".md")

    def _text(self, page: str) -> str:
        """The Markdown of a page, or of the first cell of a notebook."""
        path = Path(self.env.doc2path(self._name(page)))
        self.env.note_dependency(str(path))
        text = path.read_text(encoding="utf-8")
        return "".join(json.loads(text)["cells"][0]["source"]) if path.suffix == ".ipynb" else text

    def _title(self, page: str) -> str:
        return next(line[2:].strip() for line in self._text(page).splitlines() if line.startswith("# "))

    def _picture(self, page: str) -> list[str]:
        """The options of a picture; of notebooks there is none where they are not executed."""
        card = f"/{FOLDER}/{self._name(page)}_card.webp"
        if not (Path(self.env.srcdir) / card[1:]).exists():
            return []
        texts = [argument for kind, argument, _ in page_parts(self._text(page)) if kind == "picture"]
        return [f":img-top: {card}", f":img-alt: {[*texts, f'A picture of {self._title(page)}'][0]}"]


def setup(app: Any) -> dict[str, Any]:
    """Register the directive; the pictures are made before the pages are read."""
    if "image/webp" not in StandaloneHTMLBuilder.supported_image_types:
        StandaloneHTMLBuilder.supported_image_types.append("image/webp")
    app.add_directive("picture", PictureDirective)
    app.add_directive("cards", CardsDirective)
    app.connect("builder-inited", lambda app: make_pictures(Path(app.srcdir)))
    return {"parallel_read_safe": True}

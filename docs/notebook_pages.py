"""Pages of executed notebooks: their studios are files beside, and their cards are made of the cell that has the tag.

A studio is saved as its page (``DEFORMNB_EMBED``), in a frame that contains it. Here each becomes a file of its own,
which a browser loads when the frame is scrolled into view. The picture of the cell with the tag ``card`` is the card of
its notebook.
"""

from __future__ import annotations

import hashlib
import html
import re
from pathlib import Path
from typing import Any

from docutils import nodes

from docs.pictures import FOLDER, write_card

STUDIOS = "_studios"
TAG = "card"

_STILL = re.compile(r'(<div class="dnb-embedded-output"[^>]*>)<img [^>]*>')  # for viewers that drop frames
_FRAME = re.compile(r'(<iframe class="dnb-embedded"[^>]*) srcdoc="([^"]*)"')


def separate_studios(body: str, folder: Path, address: str) -> str:
    """Write each page that a frame contains to a file named after its content, and have the frame name that."""

    def separate(found: re.Match[str]) -> str:
        page = html.unescape(found[2]).encode("utf-8")
        name = f"{hashlib.sha256(page).hexdigest()[:16]}.html"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(page)
        return f'{found[1]} src="{address}{name}"'

    return _FRAME.sub(separate, _STILL.sub(r"\1", body))


def _separate(app: Any, page: str, template: str, context: dict[str, Any], doctree: Any) -> None:
    if "srcdoc" in context.get("body", ""):
        address = f"{'../' * page.count('/')}{STUDIOS}/"
        context["body"] = separate_studios(context["body"], Path(app.outdir) / STUDIOS, address)


def _make_card(app: Any, doctree: nodes.document) -> None:
    """Make the card of a notebook of the picture of its tagged cell."""
    cells = [node for node in doctree.findall(nodes.container) if f"tag_{TAG}" in node.get("classes", ())]
    pictures = [image for cell in cells for image in cell.findall(nodes.image)]
    if pictures:
        card = Path(app.srcdir) / FOLDER / f"{app.env.docname}_card.webp"
        card.parent.mkdir(parents=True, exist_ok=True)
        write_card(Path(app.srcdir) / pictures[-1]["uri"].lstrip("/"), card)


def _read_gallery_last(app: Any, environment: Any, names: list[str]) -> None:
    """Read the gallery when the cards of the notebooks are made."""
    names.sort(key=lambda name: name == "gallery")


def setup(app: Any) -> dict[str, Any]:
    """Register what happens to the pages of notebooks."""
    app.connect("html-page-context", _separate)
    app.connect("doctree-read", _make_card)
    app.connect("env-before-read-docs", _read_gallery_last)
    return {"parallel_read_safe": False}

"""An exported page in its place on another one: in a saved notebook, a page of documentation, an article."""

from __future__ import annotations

import base64
import html
import os
from dataclasses import dataclass, field
from os import PathLike
from typing import Any

from deformnb.io.files.atomic import atomic_write
from deformnb.widgets.cell_widgets import runs_for_later_readers

EMBEDDED_LIMIT = 1_000_000
"""Voxels of a page that is embedded, by default: with its scripts it takes about 1 MB."""

EMBEDDED_CONTROLS = ("strength", "shows", "reset")
"""Controls of a page that is embedded, by default: it shares the width with text."""

EMBED_VARIABLE = "DEFORMNB_EMBED"
"""Environment variable that has each studio of a notebook that a program runs for later readers embed its page."""

_HEIGHT = 700


def embeds_for_later_readers() -> bool:
    """Check whether a studio is saved as its page: :data:`EMBED_VARIABLE` is set, and a program runs the notebook."""
    return os.environ.get(EMBED_VARIABLE, "0") not in ("", "0") and runs_for_later_readers()


@dataclass(frozen=True, eq=False)
class EmbeddedPage:
    """A web page of :func:`~deformnb.widgets.standalone_html`, shown in a frame of the page that it is on.

    The frame loads when it is scrolled into view, and may run its scripts and offer downloads, nothing else.

    Parameters
    ----------
    page : the HTML of the page.
    title : of the frame, for screen readers.
    still : a PNG of it, for hosts that show no HTML or no frames.
    height : of the frame, CSS pixels.
    source : the address of the page, where it is a file beside; else the frame contains the page itself.

    Examples
    --------
    >>> EmbeddedPage("<p>A carp</p>", "A carp")
    EmbeddedPage('A carp', 13 bytes)
    >>> print(EmbeddedPage("<p>A carp</p>", "A carp", source="carp.html").markup())
    <iframe class="dnb-embedded" title="A carp" sandbox="allow-scripts allow-downloads" loading="lazy" \
style="width: 100%; height: 700px; border: 0" src="carp.html"></iframe>
    """

    page: str
    title: str
    still: bytes = field(default=b"", repr=False)
    height: int = _HEIGHT
    source: str = ""

    def markup(self) -> str:
        """The element ``iframe``, to be put into a page."""
        return self._frame("")

    def _frame(self, style: str) -> str:
        name, content = ("src", self.source) if self.source else ("srcdoc", self.page)
        return (
            f'<iframe class="dnb-embedded" title="{html.escape(self.title)}" sandbox="allow-scripts allow-downloads" '
            f'loading="lazy" style="{style}width: 100%; height: {self.height}px; border: 0" '
            f'{name}="{html.escape(content)}"></iframe>'
        )

    def output(self) -> str:
        """The HTML of a cell's output: the frame, over a picture that is left where a viewer drops frames.

        Examples
        --------
        >>> EmbeddedPage("<p>A carp</p>", "A carp", b"png", 400, "carp.html").output()
        '<div class="dnb-embedded-output" style="display: grid"><img alt="A carp" src="data:image/png;base64,cG5n" \
style="grid-area: 1 / 1; max-width: 100%; max-height: 400px"><iframe class="dnb-embedded" title="A carp" \
sandbox="allow-scripts allow-downloads" loading="lazy" \
style="grid-area: 1 / 1; width: 100%; height: 400px; border: 0" src="carp.html"></iframe></div>'
        """
        if not self.still:
            return self.markup()
        return (
            f'<div class="dnb-embedded-output" style="display: grid"><img alt="{html.escape(self.title)}" '
            f'src="data:image/png;base64,{self._still_text}" '
            f'style="grid-area: 1 / 1; max-width: 100%; max-height: {self.height}px">'
            f"{self._frame('grid-area: 1 / 1; ')}</div>"
        )

    @property
    def _still_text(self) -> str:
        return base64.b64encode(self.still).decode("ascii")

    def write(self, path: str | PathLike[str], *, overwrite: bool = False) -> None:
        """Write the page to a file, atomically."""
        data = self.page.encode("utf-8")
        with atomic_write(path, overwrite=overwrite, needed=len(data)) as stream:
            stream.write(data)

    def __repr__(self) -> str:
        return f"EmbeddedPage({self.title!r}, {len(self.page.encode('utf-8'))} bytes)"

    def _repr_mimebundle_(self, **_options: Any) -> dict[str, str]:
        bundle = {"text/plain": repr(self), "text/html": self.output()}
        return bundle | ({"image/png": self._still_text} if self.still else {})

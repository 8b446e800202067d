"""The text of a page without a kernel: skeleton, scripts with the policy that allows them, and data as JSON."""

from __future__ import annotations

import base64
import gzip
import hashlib
import html
import json
import re
from typing import Any

from deformnb.words import translate

_LEVEL = 9  # of gzip: packed once and read often

_NOT_FOR_THE_PAGE = ("comm", "language", "layout", "module", "tabbable", "tooltip", "words")

THOMPSON_TITLE = "How one fish becomes another"
"""Title of the page about D'Arcy Thompson's grids, which lists of lessons have too."""

PROMISE = "This file works without a network: nothing is loaded, and nothing is sent."
"""Promise of every page to its reader, which its policy enforces."""


def plain_traits(widget: Any) -> dict[str, Any]:
    """The traits that the front end of a widget has."""
    state = widget.get_state()
    return {
        name: _plain(value)
        for name, value in state.items()
        if not name.startswith("_") and name not in _NOT_FOR_THE_PAGE
    }


def _plain(value: Any) -> Any:
    if isinstance(value, bytes | bytearray | memoryview):
        data = bytes(value)
        return as_base64(data) if data.startswith(b"\x89PNG") else pack(data)
    if isinstance(value, dict):
        return {name: _plain(inner) for name, inner in value.items()}
    return [_plain(inner) for inner in value] if isinstance(value, list | tuple) else value


def as_base64(data: bytes) -> dict[str, Any]:
    """Binary data as a page's JSON holds it."""
    return {"base64": base64.b64encode(data).decode("ascii")}


def compress(data: bytes) -> bytes:
    """The same packed bytes for the same data, which a browser unpacks."""
    return gzip.compress(data, _LEVEL, mtime=0)


def pack(data: bytes) -> dict[str, Any]:
    """Binary data, packed where that helps; standalone.js unpacks them."""
    return {**as_base64(compress(data)), "gzip": True}


def inline_script(module: str, name: str) -> str:
    """A widget's module as an inline script: its exports are stored under a name, since nothing can import it."""
    text, count = re.subn(
        r"\bexport *\{ *([\w$]+) as default *\};?\s*$",
        rf'(globalThis[Symbol.for("deformnb.standalone")] ??= {{}}).{name} = \1;',
        module,
    )
    assert count == 1, "the bundle of a widget ends with its only export"
    return text


def page_html(
    texts: dict[str, str], parts: dict[str, str], data: dict[str, Any], scripts: list[str], styles: list[str], code: str
) -> str:
    """The whole page.

    Parameters
    ----------
    texts : title, line about it and facts, as they are read.
    parts : HTML of its opening and its still, and the attribute that hides its main part.
    data : for its scripts.
    scripts, styles : their texts.
    code : of its language.
    """
    scripts = [_escape_end(f"\n{script}\n") for script in scripts]
    digests = " ".join(f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'" for s in scripts)
    policy = (
        "default-src 'none'",
        f"script-src {digests}",
        "style-src 'unsafe-inline'",
        "img-src data: blob:",
        "base-uri 'none'",
        "form-action 'none'",
    )
    # A "<" in JSON occurs only in strings, where it may be written as a number: nothing in them can end the script.
    text = json.dumps(data, sort_keys=True, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    body = "\n".join(f'<script type="module">{script}</script>' for script in scripts)
    seen = {name: escape(text) for name, text in texts.items()}
    parts |= {
        "language": code,
        "controls": translate("Deformation", code),
        "needs": translate("This page needs JavaScript.", code),
    }
    return _SKELETON.format(
        policy="; ".join(policy),
        **parts,
        silent="" if texts["about"] else " hidden",
        styles=_escape_end("\n".join(styles)),
        data=text,
        scripts=body,
        **seen,
    )


def escape(text: str) -> str:
    """Text as it is seen; half a surrogate pair is a legal name in Python, but not in UTF-8."""
    return html.escape(text.encode("utf-8", "replace").decode("utf-8"))


def _escape_end(text: str) -> str:
    r"""Text that cannot end the element it is in; ``\/`` and ``\!`` mean the same in strings and comments."""
    return re.sub(r"<(?=/(script|style)|!--)", r"<\\", text, flags=re.IGNORECASE)


_SKELETON = """<!doctype html>
<html lang="{language}">
<head>
<meta charset="utf-8">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta name="generator" content="deformnb">
<title>{title}</title>
<style>
{styles}
</style>
</head>
<body class="dnb-page">
<header class="dnb-page-header">
<h1 translate="no">{title}</h1>
<p class="dnb-page-about" translate="no"{silent}>{about}</p>
</header>
{opening}
<div class="dnb-page-alert" role="alert" hidden></div>
<div class="dnb-page-controls" role="group" aria-label="{controls}"></div>
<main class="dnb-page-main"{hidden}>
<div class="dnb-page-picture"></div>
<div class="dnb-page-volume">
{still}
</div>
</main>
<noscript><p class="dnb-page-alert">{needs}</p></noscript>
<footer class="dnb-page-footer">{facts}</footer>
<script type="application/json" id="dnb-data">{data}</script>
{scripts}
</body>
</html>
"""

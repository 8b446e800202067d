"""The README of a release, whose links and pictures lead to the public repository.

In a clone the links of README.md are relative, so that they lead to files of the same clone. An index of packages shows
the text alone: there each needs the address of the repository, which pyproject.toml has under tool.deformnb.public.
"""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any
from urllib.parse import quote

ROOT = Path(__file__).resolve().parent
_LINK = re.compile(r"(?P<picture>!?)(?P<text>\[[^\]]*\])\((?P<path>(?!\w+:|#)[^)\s]+)\)")


def read_project(root: Path = ROOT) -> dict[str, Any]:
    """The table of pyproject.toml."""
    return tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))


def relative_links(text: str) -> list[str]:
    """Paths of the links and pictures of a Markdown text that lead to files next to it."""
    return [found["path"] for found in _LINK.finditer(text)]


def absolute_links(text: str, repository: str, version: str) -> str:
    """The text with every link and picture in the repository at the tag of a version; unchanged without an address.

    Parameters
    ----------
    text : Markdown, with paths from the root of the repository.
    repository : https address of its page, without a slash at the end; "" where there is none yet.
    version : of the package, whose tag begins with "v".
    """
    if not repository:
        return text

    def lead(found: re.Match[str]) -> str:
        kind = "raw" if found["picture"] else "blob"
        return f"{found['picture']}{found['text']}({repository}/{kind}/v{version}/{found['path']})"

    return _LINK.sub(lead, text)


def binder_url(repository: str, version: str) -> str:
    """The address at which Binder starts JupyterLab with the notebooks of a version.

    Parameters
    ----------
    repository : https address of its page.
    version : of the package.
    """
    owner = repository.removeprefix("https://github.com/")
    place = f"git/{quote(repository, safe='')}" if owner == repository else f"gh/{owner}"
    return f"https://mybinder.org/v2/{place}/v{version}?urlpath=lab/tree/notebooks"


def add_binder(text: str, repository: str, version: str) -> str:
    """The README with a sentence about Binder before its first code; unchanged without an address."""
    if not repository:
        return text
    before, heading, after = text.partition("\n## Five lines\n")
    sentence = f"\n[Run the notebooks on Binder]({binder_url(repository, version)}); nothing is installed.\n"
    return f"{before}{sentence}{heading}{after}"


def public_urls(public: dict[str, str]) -> dict[str, str]:
    """The addresses that an index of packages shows: the paper, and those that are filled in."""
    urls = {"Paper": "https://doi.org/10.2312/VG/VG07/091-098"}
    if public["repository"]:
        urls |= {"Repository": public["repository"], "Issues": f"{public['repository']}/issues"}
    if public["documentation"]:
        urls["Documentation"] = public["documentation"]
    return urls

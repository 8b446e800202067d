"""Pages without Python in which a user deforms files of one's own, or D'Arcy Thompson's fishes.

Both hold the scripts of an exported page with a tiny volume, in whose place that of a file comes, and the same
examples: a carp to bend, and Thompson's drawings with the nodes of his grids.
"""

from __future__ import annotations

import os
from importlib import resources
from typing import Any

import numpy as np

from deformnb.datasets.darcy import thompson_grids, thompson_pairs
from deformnb.datasets.phantoms import PHANTOMS
from deformnb.datasets.plates import PLATE_SOURCE, plate_columns
from deformnb.document.edits import initial_step
from deformnb.imaging.projection import project
from deformnb.io.files.atomic import atomic_write
from deformnb.volume.known_spacings import known_spacings
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Volume
from deformnb.widgets.bundle import bundle
from deformnb.widgets.editor.editor import Editor
from deformnb.widgets.page_html import PROMISE, THOMPSON_TITLE, as_base64, inline_script, pack, page_html
from deformnb.widgets.parameters import PAGE_CONTROLS, as_json
from deformnb.widgets.standalone import check_page_path, page_data, silent, view_part
from deformnb.widgets.view.live_view import LiveView
from deformnb.words import LANGUAGES, translate, word_table
from deformnb.words import language as chosen_language

FILE_PAGE_ABOUT = "Open your volume or picture, drag points on it, compare before and after, and download the result."
"""The line under the title of a page for files."""

_CARP = (80, 160, 80)  # voxels of the carp that a page holds
_FIRST = ("Polyprion", "Antigonia capros")  # the pair with which a page begins: the boldest of his changes


def file_page_html(language: str | None = None) -> str:
    """A web page in which a volume or a picture of one's own is opened, deformed and compared, without Python.

    The page reads NIfTI (.nii, .nii.gz), NRRD, PNG and JPEG by the rules of :mod:`deformnb.io`, shows a volume as an
    exported page does, and saves pictures and the document that ``deformnb replay`` applies to the same file. It begins
    with a choice of a carp, one of D'Arcy Thompson's drawings, or a file.

    Parameters
    ----------
    language : of the page, a code of :data:`~deformnb.words.LANGUAGES`; default is the chosen one.

    Examples
    --------
    >>> "Open a file" in file_page_html()
    True
    """
    code = chosen_language(language)
    texts = {"title": "deformnb", "about": translate(FILE_PAGE_ABOUT, code), "facts": translate(PROMISE, code)}
    opening = f'<div class="dnb-page-open" role="group" aria-label="{translate("File", code)}"></div>'
    return _page(texts, opening, "file_page", code)


def thompson_page_html(language: str | None = None, *, lessons: str = "") -> str:
    """A web page about D'Arcy Thompson's grids, for a phone or a computer, without Python.

    His drawing of Polyprion is turned into his Antigonia by a slider; nodes are dragged by hand and scored against
    his; the same grid bends a carp in three dimensions; areas that have grown and shrunk are shown; and a grid is laid
    on two pictures of one's own. All five pairs of :func:`~deformnb.datasets.thompson_pairs` are there. The page has
    the words of all :data:`~deformnb.words.LANGUAGES` and a button that changes the language.

    Parameters
    ----------
    language : with which the page begins, a code of :data:`~deformnb.words.LANGUAGES`; default is the chosen one.
    lessons : address of the lessons, to which the page links; none where it is empty.

    Returns
    -------
    str
        The page, below 3 MB with everything.

    Examples
    --------
    >>> len(thompson_page_html("de")) < 3_000_000
    True
    """
    code = chosen_language(language)
    texts = {"title": translate(THOMPSON_TITLE, code), "about": "", "facts": translate(PROMISE, code)}
    more = {
        "languages": dict(LANGUAGES),
        "tables": {one: word_table(one) for one in LANGUAGES},
        "lessons": lessons,
        "title": THOMPSON_TITLE,  # in English, from which the page translates into another language
        "facts": PROMISE,
    }
    return _page(texts, '<div class="dnb-th"></div>', "thompson", code, **more)


def write_file_page(path: str | os.PathLike[str], *, language: str | None = None, overwrite: bool = True) -> None:
    """Write the page of :func:`file_page_html` to a file, atomically.

    Parameters
    ----------
    path : the file to write; ends in .html.
    language : as of :func:`file_page_html`.
    overwrite : whether an existing file may be replaced.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> file = Path(tempfile.mkdtemp()) / "deformnb.html"
    >>> write_file_page(file)
    >>> file.stat().st_size > 100_000
    True
    """
    check_page_path(path, overwrite=overwrite)
    _write(path, file_page_html(language), overwrite=overwrite)


def write_thompson_page(
    path: str | os.PathLike[str], *, language: str | None = None, lessons: str = "", overwrite: bool = True
) -> None:
    """Write the page of :func:`thompson_page_html` to a file, atomically.

    Parameters
    ----------
    path : the file to write; ends in .html.
    language, lessons : as of :func:`thompson_page_html`.
    overwrite : whether an existing file may be replaced.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> file = Path(tempfile.mkdtemp()) / "thompson.html"
    >>> write_thompson_page(file)
    >>> file.stat().st_size < 3_000_000
    True
    """
    check_page_path(path, overwrite=overwrite)
    _write(path, thompson_page_html(language, lessons=lessons), overwrite=overwrite)


def _write(path: str | os.PathLike[str], page: str, *, overwrite: bool) -> None:
    text = page.encode("utf-8")
    with atomic_write(path, overwrite=overwrite, needed=len(text)) as stream:
        stream.write(text)


def _page(texts: dict[str, str], opening: str, script: str, code: str, **more: Any) -> str:
    """A page whose script opens volumes and pictures."""
    volume = Volume.from_array(np.arange(8, dtype=np.uint8).reshape(2, 2, 2))  # the file's volume comes in its place
    step = initial_step(Plane.from_view(volume), volume.grid)
    assert step.plane is not None
    editor, view = Editor(project(volume, step.plane), step.maps[0]), LiveView(volume)
    try:
        data = page_data(editor, view_part(editor, view, None, silent), "", tuple(PAGE_CONTROLS), code)
    finally:
        editor.close()
        view.close()
    names = ("strength", "kernel", "shows", "density", "view")
    data |= {
        "parameters": as_json(names),
        "known_spacings": [vars(row) for row in known_spacings()],
        "examples": _examples(),
        **more,
    }
    scripts = [
        inline_script(bundle("editor.js"), "editor"),
        inline_script(bundle("live_view.js"), "view"),
        inline_script(bundle("grid_drawing.js"), "grid"),
        bundle(f"{script}.js"),
    ]
    styles = [bundle("editor.css"), bundle("live_view.css"), bundle("grid_drawing.css"), bundle(f"{script}.css")]
    return page_html(texts, {"opening": opening, "hidden": " hidden", "still": ""}, data, scripts, styles, code)


def _examples() -> dict[str, Any]:
    """The carp, Thompson's scans, and the nodes and the columns of each figure on its scan."""
    carp = PHANTOMS["fish"].make(_CARP)
    grids = thompson_grids()
    number_of = {grid.species: number for number, grid in grids.items()}
    folder = resources.files("deformnb.datasets").joinpath("plates")
    grid = carp.grid
    return {
        "carp": {
            "name": carp.name,
            "values": pack(np.ascontiguousarray(carp.values).tobytes()),
            "shape": list(grid.shape),
            "spacing": list(grid.spacing),
            "origin": list(grid.origin),
            "direction": [list(row) for row in grid.direction],
            "unit": grid.unit or "",
        },
        "scans": {
            image: as_base64(folder.joinpath(image).read_bytes()) for image in sorted({g.image for g in grids.values()})
        },
        "figures": {
            str(number): {
                "figure": number,
                "species": g.species,
                "modern": g.modern,
                "image": g.image,
                "columns": list(plate_columns(number)),
                "nodes": g.nodes.tolist(),
            }
            for number, g in grids.items()
        },
        "pairs": [[number_of[name] for name in pair] for pair in sorted(thompson_pairs(), key=lambda p: p != _FIRST)],
        "origin": PLATE_SOURCE,
    }

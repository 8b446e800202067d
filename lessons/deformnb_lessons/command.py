"""The lessons for the classroom: a list, or a copy of one, opened in JupyterLab or Voila, or its page or worksheet.

This is the command ``deformnb lesson``.
"""

from __future__ import annotations

import argparse
import contextlib
import tempfile
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from deformnb.cli.lab import (
    add_lab_options,
    check_lab,
    copy_and_list,
    copy_and_open,
    open_lab,
    open_voila,
)

PAGE = "thompson"
"""The name of the lesson that is a page: the one to begin with, which needs no JupyterLab."""


def add_lesson(commands: Any) -> None:
    """Add ``lesson`` to the commands of an argument parser."""
    from deformnb.app import add_language

    what = "open a lesson for pupils in JupyterLab, or list the lessons"
    p = commands.add_parser(
        "lesson",
        help=what,
        description=f"""{what[0].upper()}{what[1:]}: the lesson is copied into
        a folder, where a file of the same name is not replaced, and opened. Its exercises check themselves.""",
    )
    p.add_argument("name", nargs="?", help="the lesson; without a name all are listed")
    p.add_argument("folder", nargs="?", default=".", help="where the lesson goes (default: the working directory)")
    how = p.add_mutually_exclusive_group()
    how.add_argument(
        "--voila", action="store_true", help="show the lesson without its code, by Voila instead of JupyterLab"
    )
    how.add_argument(
        "--page",
        action="store_true",
        help="write the lesson's picture as one offline file, NAME.html, and open nothing",
    )
    how.add_argument(
        "--worksheet",
        action="store_true",
        help="write the lesson's worksheet for printing, NAME.pdf, and the answers for the teacher, answers.pdf",
    )
    how.add_argument("--copy", action="store_true", help="copy the lesson and open nothing, for the server of a class")
    add_language(p)
    add_lab_options(p)
    p.set_defaults(run=_lesson)


def _lesson(options: argparse.Namespace) -> None:
    from deformnb.checks import check_choice
    from deformnb.widgets.page_html import THOMPSON_TITLE
    from deformnb.words import language, translate
    from deformnb_lessons import LESSONS

    code = language(options.language)
    if options.name == PAGE:
        _open_page(Path(options.folder), code, is_opened=not (options.page or options.copy))
        return
    if options.name is None:
        print(f"{PAGE:14}{translate(THOMPSON_TITLE, code)}, {translate('5 minutes', code)}")
        for name, lesson in LESSONS.items():
            print(f"{name:14}{translate(lesson.title, code)}, {translate(lesson.time, code)}")
        chosen = "" if options.language is None else f" --language {code}"
        print(translate(f"open one with: deformnb lesson {PAGE}{chosen}", code))
        return
    check_choice(options.name, [PAGE, *LESSONS], "lesson")
    if options.page:
        _write_page(options.name, Path(options.folder), code)
        return
    if options.worksheet:
        _write_worksheet(options.name, Path(options.folder), code)
        return
    if not options.copy:
        check_lab(*(["voila"] if options.voila else []))
    with _localized(lesson_notebook(options.name), code) as notebook:
        if options.copy:
            copy_and_list([notebook], Path(options.folder))
        else:
            copy_and_open([notebook], Path(options.folder), options, open_voila if options.voila else open_lab)


@contextlib.contextmanager
def _localized(notebook: Path, code: str) -> Iterator[Path]:
    """The notebook of a lesson in a language: itself, or a temporary translation."""
    from deformnb_lessons.translation import write_translation

    if code == "en":
        yield notebook
        return
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / f"{notebook.stem}.{code}.ipynb"
        write_translation(notebook, made, code)
        yield made


def _open_page(folder: Path, code: str, *, is_opened: bool) -> None:
    """Write the page about Thompson's grids, which is all of its lesson, and open it in the browser."""
    from deformnb.widgets.file_pages import write_thompson_page

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{PAGE}.html"
    write_thompson_page(path, language=code, overwrite=True)
    print(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB): open it in a browser, or put it on a stick")
    if is_opened:
        webbrowser.open(path.resolve().as_uri())


def _write_page(name: str, folder: Path, code: str) -> None:
    from deformnb_lessons.pages import write_lesson_page

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.html"
    write_lesson_page(name, path, language=code, overwrite=True)
    print(f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB): open it in a browser, or put it on a stick")


def _write_worksheet(name: str, folder: Path, code: str) -> None:
    from deformnb_lessons.worksheets import write_answers, write_worksheet

    folder.mkdir(parents=True, exist_ok=True)
    write_worksheet(name, folder / f"{name}.pdf", language=code)
    write_answers(folder / "answers.pdf", language=code)
    print(f"wrote {folder / f'{name}.pdf'} and {folder / 'answers.pdf'}")


def lesson_notebook(name: str) -> Path:
    """The notebook of a lesson.

    Examples
    --------
    >>> lesson_notebook("coordinates").name
    '1a_coordinates_and_grids.ipynb'
    """
    from deformnb_lessons import LESSONS

    return Path(__file__).parent / "notebooks" / LESSONS[name].notebook

"""The command ``deformnb lesson`` of the distribution deformnb-lessons, or a sentence about how to get it."""

from __future__ import annotations

import argparse
import importlib.util
from typing import Any

from deformnb.errors import MissingPackageError


def add_lesson(commands: Any) -> None:
    """Add ``lesson`` to the commands of an argument parser."""
    if importlib.util.find_spec("deformnb_lessons") is not None:
        from deformnb_lessons import command

        command.add_lesson(commands)
        return
    # No prefix of options: any argument, --help included, is answered by the sentence.
    p = commands.add_parser(
        "lesson", help="open a lesson for pupils (needs deformnb-lessons)", add_help=False, prefix_chars="\0"
    )
    p.add_argument("arguments", nargs="*")
    p.set_defaults(run=_report_missing)


def _report_missing(_options: argparse.Namespace) -> None:
    raise MissingPackageError(
        "the lessons are the separate distribution deformnb-lessons, which is not installed; in a clone of deformnb: "
        "pip install ./lessons"
    )

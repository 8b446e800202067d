"""The session that a command reads: from a file, or from standard input where it is named ``-``."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from deformnb.errors import DeformError

if TYPE_CHECKING:
    from deformnb.document.deformation import Deformation

STANDARD_INPUT = "-"


def read_session(name: str) -> Deformation:
    """The session in a file; in standard input if the name is ``-``.

    Raises
    ------
    DeformError
        In one sentence, if there is none.
    """
    from deformnb.document.json_format import LONGEST_DOCUMENT, from_json
    from deformnb.io.documents import read_deformation

    if name != STANDARD_INPUT:
        return read_deformation(name)
    data = b"" if sys.stdin is None else sys.stdin.buffer.read(LONGEST_DOCUMENT + 1)
    try:
        return from_json(data)
    except DeformError as error:
        raise DeformError(
            f"standard input: {error} Only a session (.json) is read from it; other files are named, since their "
            "suffix tells the format."
        ) from None


def refuse_pipes(files: Iterable[str]) -> None:
    """Refuse ``-`` as the name of a file whose format only a suffix tells.

    Raises
    ------
    DeformError
        If it is one of the names.
    """
    if STANDARD_INPUT in files:
        raise DeformError(
            'the name "-" is for a session from standard input; name other files, since their suffix tells the format.'
        )

"""Exceptions for mistakes of a user, as one family.

Every message names the fault, the item, the reason, and the next thing to do. A notebook or the command line
shows the message alone; nothing is ever half changed when one of these is raised. :func:`show_tracebacks` lets a
notebook show all.
"""

from __future__ import annotations

import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import NoReturn

_PACKAGE = str(Path(__file__).parent)
_SHORT_MODES = ("Context", "Minimal")  # of IPython's %xmode: the default, and the one that prints one line


class _ShortInNotebooks:
    """An exception that IPython shows as its message and the line of the cell that led to it.

    Python and pytest ignore this and show the whole traceback; ``__traceback__``, ``__cause__`` and
    ``__context__`` are those of every exception.
    """

    is_full = False
    translate: Callable[[str], str] = staticmethod(str)
    __traceback__: TracebackType | None

    def _render_traceback_(self) -> list[str]:
        """The lines that IPython prints instead of the traceback: it calls a method of this name."""
        assert isinstance(self, BaseException)
        shell = _shell()
        formatter = getattr(shell, "InteractiveTB", None)
        if _ShortInNotebooks.is_full or getattr(formatter, "mode", "Context") not in _SHORT_MODES:
            if formatter is None:
                return traceback.format_exception(self)
            # The first frame is IPython's own, which runs the cell.
            lines: list[str] = formatter.structured_traceback(type(self), self, self.__traceback__, tb_offset=1)
            return lines
        more = "(%tb Plain shows the whole traceback, deformnb.errors.show_tracebacks() from now on for every error.)"
        return [
            f"{type(self).__name__}: {_ShortInNotebooks.translate(str(self))}",
            *_calling_line(self),
            _ShortInNotebooks.translate(more),
        ]


def show_tracebacks(shown: bool = True) -> None:
    """Show errors of this package in notebooks with their whole traceback, or again as a message.

    Parameters
    ----------
    shown : True for whole tracebacks with all causes, also of the last error by ``%tb``; False for messages.

    Examples
    --------
    >>> show_tracebacks()
    >>> show_tracebacks(False)

    The whole traceback of the last error alone, in the next cell::

        %tb Plain
    """
    _ShortInNotebooks.is_full = bool(shown)


def translate_messages(translate: Callable[[str], str]) -> None:
    """Show the messages of errors in notebooks as translated by a function; those it does not know, as they are.

    Parameters
    ----------
    translate : of a text to itself in the language of the user.

    Examples
    --------
    >>> from deformnb.words import translate
    >>> translate_messages(translate)
    """
    _ShortInNotebooks.translate = staticmethod(translate)


def _shell() -> object:
    """IPython's shell, if this runs in one."""
    ipython = sys.modules.get("IPython")
    return ipython.get_ipython() if ipython is not None else None


def _calling_line(error: BaseException) -> list[str]:
    """The last line outside of this package that led to an error."""
    found: list[str] = []
    for frame in traceback.extract_tb(error.__traceback__):
        if frame.filename.startswith(_PACKAGE):
            break
        if frame.line:  # what dataclasses make has none
            found = [f"  {_ShortInNotebooks.translate(f'in line {frame.lineno}')}: {frame.line}"]
    return found


class DeformError(_ShortInNotebooks, ValueError):
    """Bad input: the message is one or two sentences a user can act on."""


class VolumeFileError(DeformError):
    """A file could not be read or written; nothing was loaded and nothing was overwritten."""


class UnknownKindError(VolumeFileError):
    """Neither the name of a file nor its content is that of a volume."""


class FileChangedError(VolumeFileError):
    """The file was neither opened nor saved here, or was changed since; nothing was overwritten."""


class OtherVolumeError(DeformError):
    """A document was made on another volume than the one it should be opened on; nothing was opened."""


class MissingPackageError(DeformError, ImportError):
    """An optional package is not installed; the message names it and the extra that installs it."""


def raise_missing_jax(what: str) -> NoReturn:
    """Raise the error of what only JAX can do.

    Raises
    ------
    MissingPackageError
        In any case, with the command that installs JAX.

    Examples
    --------
    >>> raise_missing_jax("a registration")
    Traceback (most recent call last):
        ...
    deformnb.errors.MissingPackageError: a registration needs JAX, which is not installed: pip install jax
    """
    raise MissingPackageError(f"{what} needs JAX, which is not installed: pip install jax")


class DeformWarning(UserWarning):
    """A result that is computed but probably not as meant: folds, tissue that is cut off, shapes that contradict
    each other. The same sentence is in the ``notes`` of the result.

    ``warnings.simplefilter("error", dn.DeformWarning)`` makes errors of them, ``"ignore"`` silences them.
    """


class Cancelled(_ShortInNotebooks, Exception):
    """Work was stopped on request (not an error: nothing is wrong with the input)."""

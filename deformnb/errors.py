"""The one family of exceptions that a user's mistake can raise.

Every message says what is wrong, which item, why, and what to do next. A notebook or the command line
shows the message alone; nothing is ever half changed when one of these is raised.
"""

from __future__ import annotations


class DeformError(ValueError):
    """Bad input: the message is one or two sentences a user can act on."""


class VolumeFileError(DeformError):
    """A file could not be read or written; nothing was loaded and nothing was overwritten."""


class UnknownKindError(VolumeFileError):
    """Neither the name of a file nor its content says that it is a volume."""


class FileChangedError(VolumeFileError):
    """Somebody else has written the file since it was opened or saved here; nothing was overwritten."""


class OtherVolumeError(DeformError):
    """A document was made on another volume than the one it shall be opened on; nothing was opened."""


class MissingPackageError(DeformError, ImportError):
    """An optional package is not installed; the message names it and the extra that brings it."""


class Cancelled(Exception):
    """Work was stopped on request (not an error: nothing is wrong with the input)."""

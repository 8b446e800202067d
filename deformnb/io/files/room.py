"""Room on the disk."""

from __future__ import annotations

import shutil
from pathlib import Path

DISK_SHARE = 0.5
"""Of the free disk, that one file may take."""


def free_share(folder: Path) -> int:
    """Bytes that one file in a folder may take: half of those free on its disk.

    Examples
    --------
    >>> free_share(Path.cwd()) > 0
    True
    """
    return int(DISK_SHARE * shutil.disk_usage(folder).free)

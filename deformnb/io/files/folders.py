"""Folders of the user."""

from __future__ import annotations

import os
from pathlib import Path


def state_home() -> Path:
    """Folder of what sessions leave behind: ``DEFORMNB_STATE`` if that is set, else the user's own state folder."""
    import platformdirs

    return Path(os.environ.get("DEFORMNB_STATE") or platformdirs.user_state_dir("deformnb")).expanduser()

"""Folders of the user."""

from __future__ import annotations

import os
from pathlib import Path


def state_home() -> Path:
    """Folder of what sessions leave behind: ``DEFORMNB_STATE`` if that is set, else the user's own state folder."""
    import platformdirs

    return Path(os.environ.get("DEFORMNB_STATE") or platformdirs.user_state_dir("deformnb")).expanduser()


def data_home() -> Path:
    """Folder of what is downloaded: ``DEFORMNB_DATA`` if that is set, else a folder in the user's cache."""
    import platformdirs

    chosen = os.environ.get("DEFORMNB_DATA")
    return Path(chosen).expanduser() if chosen else platformdirs.user_cache_path("deformnb", appauthor=False) / "data"

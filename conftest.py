"""What tests and the examples in the docstrings share: no session that saves itself goes into the user's own folder."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

import pytest

# An environment variable, for child processes too; the folder goes when the run ends.
_STATE = tempfile.TemporaryDirectory(prefix="deformnb-state-", ignore_cleanup_errors=True)
os.environ["DEFORMNB_STATE"] = _STATE.name


@pytest.fixture(autouse=True)
def state_folder(monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for sessions that save themselves, of this test alone: none finds what another has left."""
    folder = Path(tempfile.mkdtemp(dir=_STATE.name))
    monkeypatch.setenv("DEFORMNB_STATE", str(folder))
    return folder

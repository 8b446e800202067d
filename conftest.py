"""Fixtures of tests and of the examples in docstrings: one thread of OpenBLAS, no autosaved session of the user."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest

pytest_plugins = ["browser_repeats", "browser_start", "file_scheduling", "nightly", "node_files", "report_without_gc"]

# The plugin of napari is tested where napari is.
collect_ignore = [] if find_spec("napari") else ["napari-deformnb", "tests/napari_deformnb"]


def pytest_report_header() -> str | None:
    """Report that tests are left out, which nothing else would."""
    if not collect_ignore:
        return None
    return 'napari is not installed, and its plugin is not tested: pip install "./napari-deformnb[test]"'


# Environment variables, for child processes too. OpenBLAS reads this one when NumPy is imported, which the plugins do:
# its threads wait for one another by spinning, and where several processes share the processors that was half of the
# time of a fit. The nightly run has them, as users' processes do.
if os.environ.get("HYPOTHESIS_PROFILE") != "nightly":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# No session that saves itself goes into the user's folder; this one goes when the run ends.
_STATE = tempfile.TemporaryDirectory(prefix="deformnb-state-", ignore_cleanup_errors=True)
os.environ["DEFORMNB_STATE"] = _STATE.name


def _own_state(patch: pytest.MonkeyPatch) -> Path:
    folder = Path(tempfile.mkdtemp(dir=_STATE.name))
    patch.setenv("DEFORMNB_STATE", str(folder))
    return folder


@pytest.fixture(scope="module", autouse=True)
def _state_of_module() -> Iterator[None]:
    """A folder for what the tests of a module share: an application offers what another has left, which takes room."""
    with pytest.MonkeyPatch.context() as patch:
        _own_state(patch)
        yield


@pytest.fixture(autouse=True)
def state_folder(monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder for sessions that save themselves, of this test alone: none finds what another has left."""
    return _own_state(monkeypatch)

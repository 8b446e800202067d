"""The command "deformnb lab": notebooks are copied and never overwritten, and a real JupyterLab starts with them."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import pytest
from command_line import error_sentence, run

from deformnb.cli.lab import FIRST, copy_notebooks, shipped_notebooks
from deformnb.errors import DeformError

ROOT = Path(__file__).resolve().parents[2]


def test_the_notebooks_are_those_of_the_checkout() -> None:
    assert shipped_notebooks() == sorted((ROOT / "notebooks").glob("*.ipynb"))
    assert shipped_notebooks()[0].name == FIRST


def test_an_installed_package_has_them_beside_its_modules(tmp_path: Path) -> None:
    package = tmp_path / "deformnb"
    (package / "cli").mkdir(parents=True)
    for name in ("__init__.py", "cli/__init__.py"):
        (package / name).touch()
    for name in ("cli/lab.py", "_packages.py", "errors.py"):
        shutil.copy(ROOT / "deformnb" / name, package / name)
    shutil.copytree(ROOT / "notebooks", package / "notebooks")
    code = "from deformnb.cli.lab import shipped_notebooks; print(shipped_notebooks()[0])"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stdout.strip() == str(package / "notebooks" / FIRST), done.stderr
    shutil.rmtree(package / "notebooks")
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert "is missing from this installation" in done.stderr


def test_what_is_there_is_kept(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "folder"
    new, kept = copy_notebooks(folder)
    assert [path.name for path in new] == [path.name for path in shipped_notebooks()]
    assert kept == []
    assert (folder / FIRST).read_bytes() == shipped_notebooks()[0].read_bytes()
    (folder / FIRST).write_text("mine", encoding="utf-8")
    new, kept = copy_notebooks(folder)
    assert new == []
    assert folder / FIRST in kept
    assert (folder / FIRST).read_text(encoding="utf-8") == "mine"


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(DeformError, match="is a file"):
        copy_notebooks(tmp_path / "file")


@pytest.mark.parametrize("absent", ["jupyterlab", "ipykernel"])
def test_without_jupyterlab_nothing_is_copied(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], absent: str
) -> None:
    monkeypatch.setitem(sys.modules, absent, None)
    code = run(tmp_path, "lab", monkeypatch)
    message = error_sentence(capsys.readouterr(), code)
    assert message.endswith('is not installed, and the notebooks need it; pip install "deformnb-core[notebook]".')
    assert list(tmp_path.iterdir()) == []


@pytest.mark.nightly
def test_it_starts_jupyterlab_with_the_first_notebook(tmp_path: Path) -> None:
    pytest.importorskip("jupyterlab")
    own = {
        name: str(tmp_path / name.lower())
        for name in ("JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR", "JUPYTERLAB_SETTINGS_DIR")
    }
    command = [sys.executable, "-m", "deformnb", "lab", str(tmp_path / "mine"), "--no-browser", "--allow-root"]
    with (tmp_path / "log").open("wb") as log:
        process = subprocess.Popen(
            command, cwd=ROOT, env={**os.environ, **own}, stdout=log, stderr=log, stdin=subprocess.DEVNULL
        )
    try:
        address = _address(process, tmp_path / "log")
        assert f"/lab/tree/{FIRST}?token=" in address
        with urllib.request.urlopen(address.replace("/lab/tree/", "/api/contents/"), timeout=30) as answer:
            assert answer.status == 200
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(30)
    first = (tmp_path / "log").read_text(encoding="utf-8").splitlines()[0]
    assert first.split() == ["new", str(tmp_path / "mine" / FIRST)]


def _address(process: subprocess.Popen[bytes], log: Path) -> str:
    """The address that Lab prints when it is ready."""
    end = time.monotonic() + 60
    while time.monotonic() < end and process.poll() is None:
        for line in log.read_text(errors="replace", encoding="utf-8").splitlines():
            if line.strip().startswith("http://127.0.0.1"):
                return line.strip()
        time.sleep(0.2)
    raise AssertionError(log.read_text(errors="replace", encoding="utf-8"))

"""Documents of JSON on standard output, sessions on standard input, and completion in a shell."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from command_line import error_sentence, run, small_folder

import deformnb
from deformnb.cli.main import main
from deformnb.datasets import DATASETS
from deformnb.document.deformation import Deformation
from deformnb.io import read_volume, write_landmarks, write_mesh, write_series, write_transform, write_volume
from deformnb.io.documents import read_deformation, write_deformation
from deformnb.rbf.fields import Identity
from deformnb.volume.channels import Channels
from deformnb.volume.volume import Volume
from deformnb.warping.mesh import Mesh
from deformnb.warping.points import Landmarks

ROOT = Path(deformnb.__file__).resolve().parents[1]


def documented(document: str) -> set[str]:
    """Keys that docs/command_line.md lists for a document."""
    text = (ROOT / "docs" / "command_line.md").read_text(encoding="utf-8")
    [keys] = re.findall(rf"^\| {document} \| (.+) \|$", text, re.MULTILINE)
    return set(re.findall(r"`(\w+)`", keys))


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A folder with a tiny volume, and a file of each other kind."""
    folder = small_folder(tmp_path)
    write_landmarks(Landmarks([[1, 2, 3], [4, 5, 6]], ("nose", "tail")), folder / "marks.mrk.json")
    write_mesh(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), folder / "corner.ply")
    write_transform(Identity(3), folder / "nothing.nrrd", read_volume(folder / "tiny.nrrd").grid)
    return folder


def printed(line: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """The document that a command prints, and nothing else."""
    assert run(folder, line, monkeypatch) == 0
    captured = capsys.readouterr()
    assert captured.err == ""
    assert captured.out.isascii()
    return json.loads(captured.out)


KINDS = {
    "tiny.nrrd": ("volume", {"voxels": [8, 7, 6], "spacing": [1, 2, 1.5], "type": "uint8", "labels": False}),
    "pull.json": ("session", {"name": "pull", "mode": "compose", "key_frames": []}),
    "nothing.nrrd": ("transform", {"maps": "backward", "is_stated": True}),
    "marks.mrk.json": ("landmarks", {"landmarks": 2, "names": ["nose", "tail"], "from": [1, 2, 3], "pairs": False}),
    "corner.ply": ("mesh", {"corners": 3, "faces": 1, "to": [1, 1, 0], "closed": False}),
}


@pytest.mark.parametrize("file", KINDS)
def test_info_of_each_kind_has_the_documented_keys(
    file: str, small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = printed(f"info {file} --json", small, monkeypatch, capsys)
    kind, values = KINDS[file]
    assert set(found) == documented("info, each kind") | documented(f"info, {kind}")
    assert (found["kind"], found["file"]) == (kind, file)
    assert {key: found[key] for key in values} == values
    assert isinstance(found["notes"], list)
    if kind == "session":
        assert set(found["made_on"]) == documented("info, session, made_on")
        [step] = found["steps"]
        assert set(step) == documented("info, session, steps")
        assert (step["points"], found["made_on"]["voxels"]) == (4, [8, 7, 6])
    if kind == "volume":
        np.testing.assert_array_equal(found["direction"], np.eye(3))


def test_info_counts_moments_and_channels(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    values = np.zeros((3, 4, 5, 6, 2), np.uint8)
    write_series((Channels.from_array(one, names=("a", "b")) for one in values), tmp_path / "a.ome.tif", 3)
    found = printed("info a.ome.tif --json", tmp_path, monkeypatch, capsys)
    assert (found["moments"], found["channels"], found["voxels"]) == (3, 2, [6, 5, 4])
    assert found["memory_bytes"] == values.nbytes


def test_a_session_without_a_volume(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_deformation(Deformation(), tmp_path / "empty.json")
    found = printed("info empty.json --json", tmp_path, monkeypatch, capsys)
    assert (found["made_on"], found["steps"]) == (None, [])


def test_datasets_have_the_documented_keys(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = printed("datasets --json", tmp_path, monkeypatch, capsys)
    assert set(found) == documented("datasets")
    assert [row["name"] for row in found["datasets"]] == list(DATASETS)
    for row in found["datasets"]:
        assert set(row) == documented("datasets, datasets")
        assert row["credit"] == DATASETS[row["name"]].credit


def test_a_dataset_that_is_there_is_a_path(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    name = next(name for name, row in DATASETS.items() if row.sha256 is None and not row.variable)
    monkeypatch.setenv("DEFORMNB_DATA", str(tmp_path))
    (tmp_path / DATASETS[name].file).write_bytes(b"put here by the user")
    found = printed(f"datasets {name} --json", tmp_path, monkeypatch, capsys)
    assert set(found) == documented("datasets NAME")
    assert found == {"name": name, "path": str(tmp_path / DATASETS[name].file)}


def test_the_cache_has_the_documented_keys_and_is_emptied(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("fsspec")
    monkeypatch.setenv("DEFORMNB_DATA", str(tmp_path / "cache"))
    write_volume(Volume.from_array(np.zeros((2, 3, 4), np.uint8)), tmp_path / "a.nrrd")
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        archive.write(tmp_path / "a.nrrd", "a.nrrd")
    address = f"zip://a.nrrd::{tmp_path}/all.zip"
    assert printed("cache --json", tmp_path, monkeypatch, capsys)["copies"] == []
    read_volume(address)
    (tmp_path / "cache" / "data set").write_bytes(b"stays")
    for removed in (False, True):
        found = printed(f"cache --json{' --clear' * removed}", tmp_path, monkeypatch, capsys)
        assert set(found) == documented("cache")
        assert found["copies"] == [{"address": address, "size": (tmp_path / "a.nrrd").stat().st_size}]
        assert found["removed"] is removed
    assert printed("cache --json", tmp_path, monkeypatch, capsys)["copies"] == []
    assert [file.name for file in (tmp_path / "cache").iterdir()] == ["data set"]
    np.testing.assert_array_equal(read_volume(address).values, 0)


def test_doctor_has_the_documented_keys(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = printed("doctor --json", tmp_path, monkeypatch, capsys)
    assert set(found) == documented("doctor")
    for check in found["checks"]:
        assert set(check) == documented("doctor, checks")
        assert not (check["works"] and check["remedy"])
    assert next(check for check in found["checks"] if check["part"] == "numpy")["found"] == np.__version__


@pytest.mark.parametrize(
    "line", ["info missing.nrrd --json", "datasets carpp --json", "info marks.mrk.json extra --json", "info '' --json"]
)
def test_errors_are_a_sentence_and_a_document(
    line: str, small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code = run(small, line, monkeypatch)
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    assert set(document) == documented("of an error")
    sentence = error_sentence(captured._replace(out=""), code)
    assert sentence.partition(": ")[2] == document["error"]


def test_an_application_for_a_missing_file_is_not_started(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code = run(small, "app none.nrrd --no-browser", monkeypatch)
    assert "there is no file none.nrrd" in error_sentence(capsys.readouterr(), code)


# ---- pipes -----------------------------------------------------------------------------------------------------------


def feed(content: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(content)))


def test_a_session_comes_from_standard_input(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    content = (small / "pull.json").read_bytes()
    feed(content, monkeypatch)
    found = printed("info - --json", small, monkeypatch, capsys)
    assert (found["name"], found["file"]) == ("pull", "-")
    feed(content, monkeypatch)
    assert run(small, "info -", monkeypatch) == 0
    assert "4 control points" in capsys.readouterr().out
    whole = read_deformation(small / "pull.json").apply(read_volume(small / "tiny.nrrd"))
    for line, result in (
        ("warp - tiny.nrrd warped.nrrd", "warped.nrrd"),
        ("replay - tiny.nrrd --out done", "done/tiny.nrrd"),
    ):
        feed(content, monkeypatch)
        assert run(small, line, monkeypatch) == 0
        np.testing.assert_array_equal(read_volume(small / result).values, whole.values)
    for session, file in (("-", "a.nrrd"), ("pull.json", "b.nrrd")):
        feed(content, monkeypatch)
        assert run(small, f"transform {session} tiny.nrrd {file}", monkeypatch) == 0
    assert (small / "a.nrrd").read_bytes() == (small / "b.nrrd").read_bytes()


@pytest.mark.parametrize(
    "line", ["warp pull.json - a.nrrd", "warp pull.json tiny.nrrd -", "replay pull.json - --out o"]
)
def test_other_files_need_a_name(
    line: str, small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code = run(small, line, monkeypatch)
    assert "their suffix tells the format" in error_sentence(capsys.readouterr(), code)


@pytest.mark.parametrize("content", [b"", b"\x93NUMPY", b"{"])
def test_what_is_no_session_is_refused(
    content: bytes, small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    feed(content, monkeypatch)
    code = run(small, "info -", monkeypatch)
    assert "standard input: " in error_sentence(capsys.readouterr(), code)


@pytest.mark.parametrize(
    "command", [["info", "tiny.nrrd"], ["datasets"], ["warp", "pull.json", "tiny.nrrd", "out.nrrd"]]
)
def test_nothing_but_results_goes_into_a_pipe(command: list[str], small: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(
        [sys.executable, "-m", "deformnb", *command], env=environment, capture_output=True, check=True, cwd=small
    )
    assert done.stderr == b""
    assert b"\r" not in done.stdout.replace(os.linesep.encode(), b"\n")
    assert b"\x1b" not in done.stdout


# ---- completion ------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(os.name != "posix", reason="the file descriptor 8 of a POSIX shell")
@pytest.mark.parametrize(
    ("line", "wanted", "others"),
    [
        ("deformnb d", {"demo", "datasets", "doctor"}, {"warp"}),
        ("deformnb info --j", {"--json"}, {"--version"}),
        ("deformnb demo --head ", {"left", "right"}, {"demo"}),
        ("deformnb info ti", {"tiny.nrrd"}, {"pull.json"}),
    ],
)
def test_a_shell_completes_commands_options_and_files(
    line: str, wanted: set[str], others: set[str], small: Path
) -> None:
    pytest.importorskip("argcomplete", reason="pip install argcomplete")
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_SHELL": "bash",
        "_ARGCOMPLETE_IFS": "\n",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(small / "answer"),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
        "COMP_TYPE": "9",
    }
    command = [sys.executable, "-m", "deformnb"]
    subprocess.run(command, env=environment, capture_output=True, check=True, cwd=small)
    answer = {one.strip() for one in (small / "answer").read_text(encoding="utf-8").split("\n")}
    assert wanted <= answer
    assert not others & answer


def test_without_argcomplete_a_shell_gets_no_answer_and_no_trace(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("_ARGCOMPLETE", "1")
    monkeypatch.setitem(sys.modules, "argcomplete", None)  # as Python does for a missing package
    assert main(["--version"]) == 0
    assert "Traceback" not in capsys.readouterr().err

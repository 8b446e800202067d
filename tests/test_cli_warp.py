"""The command "deformnb warp": what it writes, what it notes, and one sentence for every mistake of any command."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from command_line import refused, remarks, run, small_folder

from deformnb.io import read_volume, write_volume
from deformnb.io.documents import read_deformation
from deformnb.volume import Volume


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A folder with a tiny volume and a session made on it."""
    return small_folder(tmp_path)


# ---- warp ------------------------------------------------------------------------------------------------------------


def test_strength_0_returns_the_input(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(small, "warp pull.json tiny.nrrd out.nrrd --strength 0", monkeypatch) == 0
    before, after = (read_volume(small / name) for name in ("tiny.nrrd", "out.nrrd"))
    np.testing.assert_array_equal(before.values, after.values)
    assert before.grid == after.grid


@pytest.mark.parametrize("strength", ["1", "0.5", "-1", "-1e-1", "2"])
def test_strength_blends_the_points(strength: str, small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(small, f"warp pull.json tiny.nrrd out.nrrd --strength {strength}", monkeypatch) == 0
    volume = read_volume(small / "tiny.nrrd")
    wanted = read_deformation(small / "pull.json").blended(float(strength)).apply(volume)
    np.testing.assert_array_equal(read_volume(small / "out.nrrd").values, wanted.values)


@pytest.mark.parametrize(("options", "shape", "spacing"), [
    ("--resolution 0.5", (18, 28, 16), (0.5, 0.5, 0.5)), ("--resolution 2 2 3", (3, 7, 4), (2, 2, 3)),
    ("--margin 3", (10, 10, 14), (1, 2, 1.5)), ("--margin 0 4 -1.5", (4, 11, 8), (1, 2, 1.5)),
    ("--resolution 1 --margin 1", (11, 16, 10), (1, 1, 1)), ("--spacing 2 2 2", (6, 7, 8), (2, 2, 2)),
])
def test_field_of_view_and_resolution(options: str, shape: Any, spacing: Any, small: Path,
                                      monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(small, f"warp pull.json tiny.nrrd out.nrrd {options}", monkeypatch) == 0
    out = read_volume(small / "out.nrrd")
    assert out.shape == shape
    assert out.grid.spacing == pytest.approx(spacing)
    if "--spacing" not in options:
        oracle.assert_close(out.grid.center, read_volume(small / "tiny.nrrd").grid.center, atol=1e-9)


def test_fill_labels_and_method(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(small, "warp pull.json tiny.nrrd a.nrrd --fill 7 --margin 30", monkeypatch) == 0
    assert read_volume(small / "a.nrrd").values[0, 0, 0] == 7
    assert run(small, "warp pull.json tiny.nrrd b.nrrd --labels", monkeypatch) == 0
    assert run(small, "warp pull.json tiny.nrrd c.nrrd --method nearest", monkeypatch) == 0
    b, c = (read_volume(small / name).values for name in ("b.nrrd", "c.nrrd"))
    np.testing.assert_array_equal(b, c)
    assert set(np.unique(b)) <= set(np.unique(read_volume(small / "tiny.nrrd").values))


def test_a_float_volume_may_be_filled_with_a_negative_number(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_volume(Volume.from_array(np.ones((6, 7, 8), np.float32)), small / "ones.nrrd")
    assert run(small, "warp pull.json ones.nrrd out.nrrd --fill -1e3 --margin 30", monkeypatch) == 0
    assert read_volume(small / "out.nrrd").values[0, 0, 0] == -1000


@pytest.mark.parametrize(("line", "match"), [
    ("warp missing.json tiny.nrrd out.nrrd", "there is no file missing.json"),
    ("warp . tiny.nrrd out.nrrd", "is a folder"),
    ("warp broken.json tiny.nrrd out.nrrd", "broken.json: the document is not complete JSON"),
    ("warp newer.json tiny.nrrd out.nrrd", "newer.json: .*update deformnb"),
    ("warp tiny.nrrd pull.json out.nrrd", "tiny.nrrd: .*not"),
    ("warp pull.json missing.nrrd out.nrrd", "missing.nrrd: there is no such file"),
    ("warp pull.json cut.nrrd out.nrrd", "cut.nrrd"),
    ("warp pull.json tiny.nrrd tiny.nrrd", "already there; choose another name, or --force"),
    ("warp pull.json tiny.nrrd out.docx", "out.docx: .*write .nii"),
    ("warp pull.json tiny.nrrd out.tif", "read but not written"),
    ("warp pull.json tiny.nrrd missing/out.nrrd", "no folder .*missing"),
    ("warp pull.json tiny.nrrd tiny.nrrd/out.nrrd", "no folder"),
    ("warp pull.json tiny.nrrd folder.nrrd", "is a folder"),
    ("warp pull.json tiny.nrrd out.nrrd --resolution 1 2", "--resolution takes one length or three"),
    ("warp pull.json tiny.nrrd out.nrrd --resolution 0", "spacing must be positive"),
    ("warp pull.json tiny.nrrd out.nrrd --resolution nan", "spacing must be positive"),
    ("warp pull.json tiny.nrrd out.nrrd --resolution 1e-5", "choose a coarser --resolution"),
    ("warp pull.json tiny.nrrd out.nrrd --margin 1 2 3 4", "--margin takes one length or three"),
    ("warp pull.json tiny.nrrd out.nrrd --margin -50", "leaves nothing"),
    ("warp pull.json tiny.nrrd out.nrrd --margin inf", "leaves nothing"),
    ("warp pull.json tiny.nrrd out.nrrd --spacing -1 1 1", "spacing must be positive"),
    ("warp pull.json tiny.nrrd out.nrrd --strength nan", "strength must be a finite number"),
    ("warp pull.json tiny.nrrd out.nrrd --strength much", "argument --strength.*much"),
    ("warp pull.json tiny.nrrd out.nrrd --fill 300", "fill must be one value that uint8"),
    ("warp pull.json tiny.nrrd out.nrrd --method best", "unknown method 'best'.*cubic"),
    ("warp pull.json tiny.nrrd out.nrrd --method cubic --labels", "invent values between labels"),
    ("warp pull.json tiny.nrrd", "required: output"),
    ("warp pull.json tiny.nrrd out.nrrd more.nrrd", "unrecognized arguments: more"),
    ("warp pull.json tiny.nrrd out.nrrd --colour red", "unrecognized arguments"),
    ("info missing.nrrd", "no such file"), ("info missing.json", "there is no file"),
    ("info broken.json", "not complete"),
    ("info folder.nrrd", "neither a DICOM series"), ("info", "required: file"),
    ("info 'two\nlines.nrrd'", r"two\\nlines"),
    ("datasets goldfish", "goldfish"), ("frobnicate", "invalid choice.*demo"),
    ("--frobnicate", "required|unrecognized"),
])
def test_mistakes_are_one_sentence(line: str, match: str, small: Path, capsys: pytest.CaptureFixture[str],
                                   monkeypatch: pytest.MonkeyPatch) -> None:
    whole = (small / "pull.json").read_text()
    (small / "broken.json").write_text(whole[:-30])
    (small / "newer.json").write_text(whole.replace('"version": "1.0"', '"version": "7.0"'))
    (small / "cut.nrrd").write_bytes((small / "tiny.nrrd").read_bytes()[:-40])
    (small / "folder.nrrd").mkdir()
    before = {p: p.read_bytes() for p in small.iterdir() if p.is_file()}
    code = run(small, line, monkeypatch)
    assert re.search(match, refused(capsys.readouterr(), code))
    assert {p: p.read_bytes() for p in small.iterdir() if p.is_file()} == before


def test_force_overwrites(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(small, "warp pull.json tiny.nrrd tiny.nrrd --force --strength 2", monkeypatch) == 0
    assert sorted(p.name for p in small.iterdir()) == ["pull.json", "tiny.nrrd"]


def test_another_volume_is_deformed_with_a_note(small: Path, capsys: pytest.CaptureFixture[str],
                                                monkeypatch: pytest.MonkeyPatch) -> None:
    write_volume(Volume.from_array(np.ones((6, 7, 8), np.uint8)), small / "other.nrrd")
    assert run(small, "warp pull.json other.nrrd out.nrrd", monkeypatch) == 0
    captured = capsys.readouterr()
    assert captured.out == "out.nrrd\n"
    assert remarks(captured.err) == "deformnb: note: the session was made on another volume (tiny).\n"


def test_another_spacing_is_noted(small: Path, capsys: pytest.CaptureFixture[str],
                                  monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(small, "warp pull.json tiny.nrrd out.nrrd --spacing 1 1 1", monkeypatch) == 0
    assert "made with voxels of 1 2 1.5, these are of 1 1 1; --spacing 1 2 1.5" in capsys.readouterr().err
    assert run(small, "warp pull.json tiny.nrrd more.nrrd --spacing 1 2 1.5", monkeypatch) == 0
    assert remarks(capsys.readouterr().err) == ""


def test_notes_of_the_volume_are_passed_on(small: Path, capsys: pytest.CaptureFixture[str],
                                           monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.ones((6, 7, 8), np.float32)
    values[1, 2, 3] = np.nan
    write_volume(Volume.from_array(values), small / "dirty.nrrd")
    assert run(small, "warp pull.json dirty.nrrd out.nrrd", monkeypatch) == 0
    assert "not finite" in capsys.readouterr().err

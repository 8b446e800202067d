"""The command "deformnb warp": its files, its notes, and one sentence for every mistake of any command."""

from __future__ import annotations

import dataclasses
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
from command_line import error_sentence, run, small_folder

from deformnb.datasets import PHANTOMS
from deformnb.document.deformation import Deformation, VolumeReference
from deformnb.io import read_volume, write_volume
from deformnb.io.documents import read_deformation, write_deformation
from deformnb.io.landmarks.formats import read_landmarks, write_landmarks
from deformnb.io.meshes.formats import MESH_FORMATS, read_mesh, write_mesh
from deformnb.rbf import fitting
from deformnb.rbf.fit_settings import FitSettings
from deformnb.rbf.points import ControlPoints
from deformnb.session.inputs import volume_from
from deformnb.volume import known_spacings
from deformnb.volume.known_spacings import KnownSpacing
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.mesh import Mesh
from deformnb.warping.points import Landmarks

FACE = Mesh([[1, 2, 3], [6, 8, 3], [3, 6, 7]], [[0, 1, 2]])


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


def test_every_set_of_points_is_solved_once(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    solved, solve = [], fitting.solve_prepared

    def counted(ready: Any, *rest: Any) -> Any:
        solved.append(ready.count)
        return solve(ready, *rest)

    monkeypatch.setattr(fitting, "solve_prepared", counted)
    assert run(small, "warp pull.json tiny.nrrd out.nrrd", monkeypatch) == 0
    assert len(solved) == sum(len(step.maps) for step in read_deformation(small / "pull.json").steps)


@pytest.mark.parametrize("strength", ["1", "0.5", "-1", "-1e-1", "2"])
def test_strength_blends_the_points(strength: str, small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(small, f"warp pull.json tiny.nrrd out.nrrd --strength {strength}", monkeypatch) == 0
    volume = read_volume(small / "tiny.nrrd")
    wanted = read_deformation(small / "pull.json").scaled(float(strength)).apply(volume)
    np.testing.assert_array_equal(read_volume(small / "out.nrrd").values, wanted.values)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("options", "shape", "spacing"),
    [
        ("--resolution 0.5", (18, 28, 16), (0.5, 0.5, 0.5)),
        ("--resolution 2 2 3", (3, 7, 4), (2, 2, 3)),
        ("--margin 3", (10, 11, 14), (1, 2, 1.5)),
        ("--margin 0 4 -1.5", (4, 11, 8), (1, 2, 1.5)),
        ("--resolution 1 --margin 1", (11, 16, 10), (1, 1, 1)),
        ("--spacing 2 2 2", (6, 7, 8), (2, 2, 2)),
    ],
)
def test_field_of_view_and_resolution(
    options: str, shape: Any, spacing: Any, small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(small, f"warp pull.json tiny.nrrd out.nrrd {options}", monkeypatch) == 0
    out = read_volume(small / "out.nrrd")
    assert out.shape == shape
    assert out.grid.spacing == pytest.approx(spacing)
    if "--spacing" not in options:
        oracle.assert_close(out.grid.center, read_volume(small / "tiny.nrrd").grid.center, atol=1e-9)


def a_shift(small: Path, by: float, **more: Any) -> Deformation:
    """A document that shifts the tiny volume, written as "shift.json"."""
    document = Deformation.from_picture_points(
        read_volume(small / "tiny.nrrd").grid, "+y", ControlPoints.from_arrays([[0, 0]], [[by, 0]]), trend="translation"
    )
    document = dataclasses.replace(document, **more)
    write_deformation(document, small / "shift.json")
    return document


def test_a_margin_that_fits_holds_all_that_is_moved(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    a_shift(small, 5.0)
    volume = read_volume(small / "tiny.nrrd")
    assert run(small, "warp shift.json tiny.nrrd out.nrrd --margin fit", monkeypatch) == 0
    out = read_volume(small / "out.nrrd")
    assert out.shape[:2] == volume.shape[:2]
    assert out.shape[2] >= volume.shape[2] + 5
    np.testing.assert_array_equal(out.values[:, :, 5 : 5 + volume.shape[2]], volume.values)
    assert out.grid.origin == volume.grid.origin


def test_the_box_of_a_session_is_that_of_its_result_unless_another_is_asked_for(
    small: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = read_volume(small / "tiny.nrrd").grid
    box = grid.crop((0, 0, -2), (grid.shape[0], grid.shape[1], grid.shape[2] + 9))
    a_shift(small, 5.0, output=box)
    for options, wanted in (("", box), ("--margin 0", grid), ("--resolution 2", box.resampled(spacing=2.0))):
        assert run(small, f"warp shift.json tiny.nrrd out.nrrd --force {options}", monkeypatch) == 0
        assert read_volume(small / "out.nrrd").grid.is_like(wanted)
    assert run(small, "replay shift.json tiny.nrrd --out results", monkeypatch) == 0
    assert read_volume(small / "results" / "tiny.nrrd").grid.is_like(box)


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


@pytest.mark.parametrize(
    ("line", "match"),
    [
        ("warp missing.json tiny.nrrd out.nrrd", "there is no file missing.json"),
        ("warp . tiny.nrrd out.nrrd", "is a folder"),
        ("warp broken.json tiny.nrrd out.nrrd", "broken.json: the document is not complete JSON"),
        ("warp newer.json tiny.nrrd out.nrrd", "newer.json: .*update deformnb"),
        (
            "warp tiny.nrrd pull.json out.nrrd",
            r"the session comes first: deformnb warp pull\.json tiny\.nrrd out\.nrrd",
        ),
        ("warp pull.json missing.nrrd out.nrrd", "missing.nrrd: there is no such file"),
        ("warp pull.json cut.nrrd out.nrrd", "cut.nrrd"),
        ("warp pull.json tiny.nrrd tiny.nrrd", "already there; choose another name, or --force"),
        ("warp pull.json tiny.nrrd out.docx", "out.docx: .*write .nii"),
        ("warp pull.json tiny.nrrd out.dcm", "read but not written"),
        ("warp pull.json tiny.nrrd missing/out.nrrd", "no folder .*missing"),
        ("warp pull.json tiny.nrrd tiny.nrrd/out.nrrd", "no folder"),
        ("warp pull.json tiny.nrrd folder.nrrd", "is a folder"),
        ("warp pull.json tiny.nrrd out.nrrd --resolution 1 2", "spacing must be one number .* or three"),
        ("warp pull.json tiny.nrrd out.nrrd --resolution 0", "spacing must be positive"),
        ("warp pull.json tiny.nrrd out.nrrd --resolution nan", "spacing must be one number .* got nan"),
        ("warp pull.json tiny.nrrd out.nrrd --resolution 1e-5", "coarser resolution"),
        ("warp pull.json tiny.nrrd out.nrrd --margin 1 2 3 4", "a margin is one length or three"),
        ("warp pull.json tiny.nrrd out.nrrd --margin wide", 'a margin is "fit" or lengths'),
        ("warp pull.json tiny.nrrd out.nrrd --margin -50", "leaves nothing"),
        ("warp pull.json tiny.nrrd out.nrrd --margin inf", "a margin is one length or three .* got .*inf"),
        ("warp pull.json tiny.nrrd out.nrrd --spacing -1 1 1", "spacing must be positive"),
        ("warp pull.json tiny.nrrd out.nrrd --strength nan", "strength must be a finite number"),
        ("warp pull.json tiny.nrrd out.nrrd --strength much", "argument --strength.*much"),
        ("warp pull.json tiny.nrrd out.nrrd --fill 300", "fill must be one value that uint8"),
        ("warp pull.json tiny.nrrd out.nrrd --method best", "unknown method 'best'.*cubic"),
        ("warp pull.json tiny.nrrd out.nrrd --method cubic --labels", "invent values between labels"),
        ("warp pull.json tiny.nrrd", "required: output"),
        ("warp pull.json tiny.nrrd out.nrrd more.nrrd", "unrecognized arguments: more"),
        ("warp pull.json tiny.nrrd out.nrrd --colour red", "unrecognized arguments"),
        ("warp pull.json tiny.nrrd out.nrrd --volume tiny.nrrd", "--volume is for meshes and landmarks"),
        ("warp pull.json face.ply out.ply", "name the volume of the session with --volume FILE"),
        ("warp pull.json face.ply out.nrrd --volume tiny.nrrd", r"write \.ply, \.stl, \.obj, \.vtp"),
        ("warp pull.json marks.fcsv out.ply --volume tiny.nrrd", r"known are \.mrk\.json, .*\.fcsv, .*\.csv"),
        ("warp pull.json face.ply out.ply --volume tiny.nrrd --fill 3", "--fill is for volumes, and face.ply is none"),
        ("warp pull.json face.ply out.ply --volume tiny.nrrd --labels", "--labels is for volumes"),
        ("warp pull.json face.ply face.ply --volume tiny.nrrd", "already there"),
        ("warp pull.json face.ply out.ply --volume missing.nrrd", "no such file"),
        ("warp pull.json missing.ply out.ply --volume tiny.nrrd", "missing.ply: there is no such file"),
        ("warp pull.json cut.ply out.ply --volume tiny.nrrd", "cut.ply: .*cut short"),
        ("info cut.ply", "cut.ply: .*cut short"),
        ("info missing.fcsv", "no such file"),
        ("info missing.nrrd", "no such file"),
        ("info missing.json", "there is no such file"),
        ("info broken.json", "not complete"),
        ("info folder.nrrd", "neither a DICOM series"),
        ("info", "required: file"),
        ("info 'two\nlines.nrrd'", r"two\\nlines"),
        ("datasets goldfish", "goldfish"),
        ("frobnicate", "invalid choice.*demo"),
        ("--frobnicate", "required|unrecognized"),
    ],
)
def test_mistakes_are_one_sentence(
    line: str, match: str, small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = (small / "pull.json").read_text(encoding="utf-8")
    (small / "broken.json").write_text(whole[:-30], encoding="utf-8")
    (small / "newer.json").write_text(re.sub('"version": "[0-9.]+"', '"version": "7.0"', whole), encoding="utf-8")
    (small / "cut.nrrd").write_bytes((small / "tiny.nrrd").read_bytes()[:-40])
    (small / "folder.nrrd").mkdir()
    write_mesh(FACE, small / "face.ply")
    write_landmarks(Landmarks(FACE.points), small / "marks.fcsv")
    (small / "cut.ply").write_bytes((small / "face.ply").read_bytes()[:-5])
    before = {p: p.read_bytes() for p in small.iterdir() if p.is_file()}
    code = run(small, line, monkeypatch)
    assert re.search(match, error_sentence(capsys.readouterr(), code))
    assert {p: p.read_bytes() for p in small.iterdir() if p.is_file()} == before


@pytest.mark.parametrize(
    ("line", "match"),
    [("app face.ply --spacing 1 1 1", "a spacing is for volumes"), ("app face.ply", "the mesh is open")],
)
def test_the_application_says_in_one_sentence_what_it_cannot_open(
    line: str, match: str, small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_mesh(FACE, small / "face.ply")
    code = run(small, f"{line} --no-browser", monkeypatch)
    out, err = capsys.readouterr()
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\S+\n", out)  # the page is there before the file is read
    assert code == 2
    how_to_open, why_not = err.splitlines()
    assert "open this address" in how_to_open
    assert re.search(match, why_not)


def test_force_overwrites(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert run(small, "warp pull.json tiny.nrrd tiny.nrrd --force --strength 2", monkeypatch) == 0
    assert sorted(p.name for p in small.iterdir()) == ["pull.json", "tiny.nrrd"]


def test_another_volume_is_deformed_with_a_note(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_volume(Volume.from_array(np.eye(8, dtype=np.uint8)[None].repeat(6, 0)), small / "other.nrrd")
    assert run(small, "warp pull.json other.nrrd out.nrrd", monkeypatch) == 0
    captured = capsys.readouterr()
    assert captured.out == "out.nrrd\n"
    assert captured.err == (
        "deformnb: note: This document was made on another volume ('tiny', 8 x 7 x 6 "
        "voxels); its points may be at another place.\n"
    )


def test_a_replay_names_each_file_of_another_grid_and_the_alignment(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_volume(Volume.from_array(np.eye(8, dtype=np.uint8)[None].repeat(6, 0)), small / "other.nrrd")
    write_landmarks(Landmarks(FACE.points), small / "marks.fcsv")
    write_mesh(FACE, small / "face.ply")
    line = "replay pull.json {} --volume other.nrrd --out results{}"
    wanted = (
        "This document was made on another volume ('tiny', 8 x 7 x 6 voxels); its points may be at another place. "
        "--align box maps the box of the session's volume to that of each input."
    )
    for name in ("other.nrrd", "marks.fcsv", "face.ply"):
        assert run(small, line.format(name, ""), monkeypatch) == 0
        assert capsys.readouterr().err == f"deformnb: note: {name}: {wanted}\n"
    assert run(small, line.format("other.nrrd marks.fcsv face.ply", " --align box"), monkeypatch) == 0
    assert "another volume" not in capsys.readouterr().err
    assert run(small, "replay pull.json tiny.nrrd marks.fcsv --volume tiny.nrrd --out own", monkeypatch) == 0
    assert capsys.readouterr().err == ""


def test_another_spacing_is_noted(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(small, "warp pull.json tiny.nrrd out.nrrd --spacing 1 1 1", monkeypatch) == 0
    remark = capsys.readouterr().err
    assert "of another size (1 x 2 x 1.5 then, 1 x 1 x 1 now)" in remark
    assert "--spacing 1 2 1.5" in remark
    assert run(small, "warp pull.json tiny.nrrd more.nrrd --spacing 1 2 1.5", monkeypatch) == 0
    assert capsys.readouterr().err == ""


def test_notes_of_the_volume_are_passed_on(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    values = np.ones((6, 7, 8), np.float32)
    values[1, 2, 3] = np.nan
    write_volume(Volume.from_array(values), small / "dirty.nrrd")
    assert run(small, "warp pull.json dirty.nrrd out.nrrd", monkeypatch) == 0
    assert "not finite" in capsys.readouterr().err


def test_notes_of_the_fit_are_told(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    volume = read_volume(small / "tiny.nrrd")
    a, b = np.array(volume.grid.spacing)[:2] * [[2, 2], [4, 2]]
    crossed = ControlPoints.from_arrays([a, b], [b, a])
    document = Deformation.from_picture_points(
        volume.grid, "+z", crossed, trend="none", support=float(np.linalg.norm(b))
    )
    assert any("fold" in note for note in document.notes(volume.grid))
    write_deformation(document, small / "crossed.json")
    assert run(small, "warp crossed.json tiny.nrrd out.nrrd", monkeypatch) == 0
    assert "fold" in capsys.readouterr().err


@pytest.mark.parametrize(
    "line",
    [
        "warp pull.json tiny.nrrd out.nrrd",
        "warp pull.json tiny.nrrd out.nrrd --margin fit --strength 0.5",
        "warp pull.json face.ply out.ply --volume tiny.nrrd",
        "warp pull.json marks.fcsv out.fcsv --volume tiny.nrrd",
        "replay pull.json tiny.nrrd --out results",
    ],
)
def test_the_fits_of_a_session_are_solved_once(line: str, small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_mesh(FACE, small / "face.ply")
    write_landmarks(Landmarks(FACE.points), small / "marks.fcsv")
    solved: list[int] = []
    fits = FitSettings.fits
    monkeypatch.setattr(FitSettings, "fits", lambda *given, **options: (solved.append(1), fits(*given, **options))[1])
    assert run(small, line, monkeypatch) == 0
    assert len(solved) == 1


def test_a_result_that_no_memory_holds_is_refused_before_the_work(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("deformnb.io.files.memory.available_memory", lambda: 1000)
    code = run(small, "warp pull.json tiny.nrrd out.nrrd --margin 6", monkeypatch)
    assert "are free; close something else, or choose a smaller result box" in error_sentence(capsys.readouterr(), code)
    assert run(small, "replay pull.json tiny.nrrd --out results --summary sum.json", monkeypatch) == 0
    grown = read_deformation(small / "pull.json")
    write_deformation(replace(grown, output=Grid((60, 70, 80))), small / "large.json")
    assert run(small, "replay large.json tiny.nrrd --out others", monkeypatch) == 2
    assert "are free" in capsys.readouterr().out


# ---- meshes and landmarks follow their volume ------------------------------------------------------------------------


@pytest.mark.parametrize("kind", sorted(MESH_FORMATS))
def test_a_mesh_follows(kind: str, small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_mesh(FACE, small / "face.ply")
    assert run(small, f"warp pull.json face.ply out.{kind} --volume tiny.nrrd --strength 0.5", monkeypatch) == 0
    field = read_deformation(small / "pull.json").scaled(0.5).field(read_volume(small / "tiny.nrrd").grid)
    found = read_mesh(small / f"out.{kind}")
    moved = found.points[found.faces[0]]
    oracle.assert_close(moved + field.displacement(moved), FACE.points, atol=1e-4)
    assert np.abs(moved - FACE.points).max() > 0.1


@pytest.mark.parametrize("suffix", ["mrk.json", "fcsv", "csv"])
def test_landmarks_follow(
    suffix: str, small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_landmarks(Landmarks(FACE.points, ("a", "b", "c")), small / "marks.fcsv")
    assert run(small, f"warp pull.json marks.fcsv out.{suffix} --volume tiny.nrrd", monkeypatch) == 0
    assert capsys.readouterr().err == ""
    field = read_deformation(small / "pull.json").field(read_volume(small / "tiny.nrrd").grid)
    found = read_landmarks(small / f"out.{suffix}")
    assert found.names == ("a", "b", "c")
    oracle.assert_close(found.points + field.displacement(found.points), FACE.points, atol=1e-4)


def test_the_grid_that_they_follow_in_may_be_corrected(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_mesh(FACE, small / "face.ply")
    assert run(small, "warp pull.json face.ply out.ply --volume tiny.nrrd --spacing 2 2 2", monkeypatch) == 0
    write_volume(Volume.from_array(np.ones((3, 4, 5), np.uint8)), small / "other.nrrd")
    assert run(small, "warp pull.json face.ply more.ply --volume other.nrrd", monkeypatch) == 0
    assert "made on another volume ('tiny', 8 x 7 x 6 voxels)" in capsys.readouterr().err


def test_info_of_meshes_and_landmarks(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write_mesh(FACE, small / "face.ply")
    write_landmarks(Landmarks(FACE.points), small / "marks.mrk.json")
    assert run(small, "info face.ply", monkeypatch) == 0
    assert re.search(r"corners +3\nfaces +1\nfrom +1, 2, 3\nto +6, 8, 7\nclosed +no", capsys.readouterr().out)
    assert run(small, "info marks.mrk.json", monkeypatch) == 0
    assert re.search(r"kind +file of Slicer's markups\nlandmarks +3\n", capsys.readouterr().out)


def test_a_session_made_on_a_mesh(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    corners = np.array([[0, 0, 0], [9, 0, 0], [0, 9, 0], [0, 0, 9]], dtype=float)
    body = Mesh(corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    write_mesh(body, small / "body.stl")
    volume = volume_from(small / "body.stl")
    assert max(volume.shape) == 128
    assert volume.value_range == (0, 255)
    np.testing.assert_array_equal(volume_from(body).values, volume.values)
    points = ControlPoints.from_arrays(volume.grid.corners(), volume.grid.corners()).add([1, 1, 1], [2, 1, 1])
    deformation = Deformation.from_space_points(points)
    write_deformation(Deformation(deformation.steps, "push", VolumeReference.of(volume)), small / "push.json")
    assert run(small, "warp push.json body.stl out.ply --volume body.stl", monkeypatch) == 0
    moved = read_mesh(small / "out.ply")
    field = deformation.field(volume.grid)
    order = np.lexsort((moved.points + field.displacement(moved.points)).round(3).T)
    wanted = corners[np.lexsort(corners.T)]
    oracle.assert_close((moved.points + field.displacement(moved.points))[order], wanted, atol=1e-4)


def test_labels_that_are_not_declared_are_asked_about(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    labels = PHANTOMS["knee"].labels((24, 24, 24))
    write_volume(Volume.from_array(labels.values, is_labels=False), small / "labels.nrrd")
    assert run(small, "warp pull.json labels.nrrd out.nrrd", monkeypatch) == 0
    assert capsys.readouterr().err.count("--labels in a command") == 1, "the result has it too, reported once"
    assert run(small, "warp pull.json labels.nrrd out.nrrd --labels --force", monkeypatch) == 0
    assert "--labels" not in capsys.readouterr().err
    assert run(small, "info labels.nrrd", monkeypatch) == 0


def test_a_known_volume_has_its_true_spacing_and_older_sessions_its_voxels(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    volume = read_volume(small / "tiny.nrrd")
    made = VolumeReference.of(volume)
    row = KnownSpacing("fish", made.shape, volume.dtype.name, made.sha256, made.spacing, (3.0, 1.0, 1.0), "anatomy")
    assert run(small, "warp pull.json tiny.nrrd then.nrrd", monkeypatch) == 0
    capsys.readouterr()
    monkeypatch.setattr(known_spacings, "known_spacings", lambda: (row,))
    assert run(small, "warp pull.json tiny.nrrd now.nrrd", monkeypatch) == 0
    said = capsys.readouterr().err
    assert "which is wrong" in said
    assert "wrong spacing of its file" in said
    then, now = read_volume(small / "then.nrrd"), read_volume(small / "now.nrrd")
    assert (now.values == then.values).all()
    assert now.grid.spacing == (3, 1, 1)
    assert run(small, "warp pull.json tiny.nrrd other.nrrd --margin 2", monkeypatch) == 2
    assert "no other grid than its own" in capsys.readouterr().err
    assert run(small, "info tiny.nrrd", monkeypatch) == 0
    assert "3 x 1 x 1" in capsys.readouterr().out


# ---- in parts --------------------------------------------------------------------------------------------------------


def test_a_zarr_folder_is_written_in_parts(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run(small, "warp pull.json tiny.nrrd out.zarr --memory 64MB", monkeypatch) == 0
    assert run(small, "warp pull.json tiny.nrrd out.nrrd", monkeypatch) == 0
    found, wanted = read_volume(small / "out.zarr"), read_volume(small / "out.nrrd")
    assert np.abs(found.values.astype(int) - wanted.values).max() <= 1
    assert found.grid.is_like(wanted.grid)
    capsys.readouterr()
    code = run(small, "warp pull.json tiny.nrrd out.zarr", monkeypatch)
    assert "already there" in error_sentence(capsys.readouterr(), code)
    assert run(small, "warp pull.json out.zarr out.zarr --force --resolution 1", monkeypatch) == 0
    assert read_volume(small / "out.zarr").grid.spacing == (1, 1, 1)
    capsys.readouterr()
    code = run(small, "warp pull.json tiny.nrrd a.nrrd --memory 1GB", monkeypatch)
    assert "deformed in parts" in error_sentence(capsys.readouterr(), code)


def test_a_document_of_a_coarser_level_belongs_to_the_finest(
    small: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from deformnb.chunked import warp
    from deformnb.rbf.fields import Affine

    still = Affine(np.eye(3), np.zeros(3))
    warp(read_volume(small / "tiny.nrrd"), still, small / "two.zarr", levels=2)
    coarse = read_volume(small / "two.zarr", level=1)
    document = replace(a_shift(small, 1.0), volume=VolumeReference.of(coarse))
    write_deformation(document, small / "coarse.json")
    capsys.readouterr()
    assert run(small, "warp coarse.json two.zarr moved.zarr", monkeypatch) == 0
    assert "another volume" not in capsys.readouterr().err

"""Replay over files: results stay, failures are reported, and outdated results are made again."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import run, small_folder

from deformnb.document.deformation import Deformation, VolumeReference
from deformnb.errors import Cancelled, DeformError
from deformnb.io import read_volume, write_volume
from deformnb.io.documents import read_deformation, write_deformation
from deformnb.io.meshes.formats import read_mesh, write_mesh
from deformnb.session.batch import RECORD, inputs_of, replay
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.mesh import Mesh, warp_mesh


@pytest.fixture
def many(tmp_path: Path) -> Path:
    """A folder with a session, and a folder in it with three volumes of one grid."""
    folder = small_folder(tmp_path)
    volume = read_volume(folder / "tiny.nrrd")
    (folder / "in").mkdir()
    for k, name in enumerate(("a.nrrd", "b.nrrd", "c.nii.gz")):
        write_volume(Volume(np.roll(volume.values, k, axis=0), volume.grid), folder / "in" / name)
    return folder


def states(results: Any) -> list[str]:
    return [r.state for r in results]


def test_every_file_of_a_folder_is_deformed(many: Path) -> None:
    document = read_deformation(many / "pull.json")
    assert states(replay(document, [many / "in"], many / "out")) == ["done"] * 3
    for name in ("a.nrrd", "b.nrrd", "c.nii.gz"):
        volume = read_volume(many / "in" / name)
        np.testing.assert_array_equal(read_volume(many / "out" / name).values, document.apply(volume).values)


def test_a_second_run_does_only_what_is_missing_or_out_of_date(many: Path) -> None:
    document = read_deformation(many / "pull.json")
    replay(document, [many / "in"], many / "out")
    assert states(replay(document, [many / "in"], many / "out")) == ["kept"] * 3
    (many / "out" / "a.nrrd").unlink()
    write_volume(read_volume(many / "in" / "a.nrrd"), many / "in" / "b.nrrd")
    assert states(replay(document, [many / "in"], many / "out")) == ["done", "done", "kept"]
    assert states(replay(document.scaled(0.5), [many / "in"], many / "out")) == ["done"] * 3
    assert states(replay(document.scaled(0.5), [many / "in"], many / "out", options={"fill": 1})) == ["done"] * 3


def test_a_run_that_is_stopped_goes_on(many: Path) -> None:
    document = read_deformation(many / "pull.json")

    def stop(name: str, _share: float) -> None:
        if name == "b.nrrd":
            raise Cancelled

    with pytest.raises(Cancelled):
        replay(document, [many / "in"], many / "out", progress=stop)
    assert sorted(os.listdir(many / "out")) == ["a.nrrd", RECORD]
    assert states(replay(document, [many / "in"], many / "out")) == ["kept", "done", "done"]


def test_one_that_fails_does_not_keep_the_others_from_being_done(many: Path) -> None:
    (many / "in" / "b.nrrd").write_bytes(b"NRRD0004\nbroken")
    results = replay(read_deformation(many / "pull.json"), [many / "in"], many / "out")
    assert states(results) == ["done", "failed", "done"]
    assert "b.nrrd" in results[1].message
    assert not (many / "out" / "b.nrrd").exists()


def test_what_no_replay_has_made_is_not_overwritten(many: Path) -> None:
    document = read_deformation(many / "pull.json")
    (many / "out").mkdir()
    (many / "out" / "a.nrrd").write_bytes(b"mine")
    results = replay(document, [many / "in"], many / "out")
    assert states(results) == ["failed", "done", "done"]
    assert "was not made by a replay" in results[0].message
    assert (many / "out" / "a.nrrd").read_bytes() == b"mine"
    (many / "out" / "b.nrrd").write_bytes(b"changed by hand since")
    assert states(replay(document, [many / "in"], many / "out")) == ["failed", "failed", "kept"]
    assert states(replay(document, [many / "in"], many / "out", overwrite=True)) == ["done", "done", "kept"]


@pytest.mark.parametrize(
    "damage",
    [
        "",
        "{",
        "[]",
        '{"format": "deformnb-replay", "version": 1, "files": 3}',
        '{"format": "deformnb-replay", "version": 1, "files": {"a.nrrd": 3}}',
        "[" * 5000,
    ],
)
def test_a_damaged_record_takes_nothing_for_done(damage: str, many: Path) -> None:
    document = read_deformation(many / "pull.json")
    replay(document, [many / "in"], many / "out")
    (many / "out" / RECORD).write_text(damage, encoding="utf-8")
    assert "kept" not in states(replay(document, [many / "in"], many / "out"))
    assert states(replay(document, [many / "in"], many / "out", overwrite=True)) == ["done"] * 3


def test_another_format_of_the_results(many: Path) -> None:
    replay(read_deformation(many / "pull.json"), [many / "in"], many / "out", suffix=".mha")
    assert sorted(os.listdir(many / "out")) == ["a.mha", "b.mha", "c.mha", RECORD]


def test_results_never_replace_their_inputs(many: Path) -> None:
    with pytest.raises(DeformError, match="would replace their inputs"):
        replay(read_deformation(many / "pull.json"), [many / "in"], many / "in")


@pytest.mark.parametrize("overwrite", [False, True])
def test_another_format_does_not_let_results_replace_inputs_or_one_another(overwrite: bool, many: Path) -> None:
    document, before = read_deformation(many / "pull.json"), (many / "in" / "c.nii.gz").read_bytes()
    with pytest.raises(DeformError, match="would replace their inputs"):
        replay(document, [many / "in"], many / "in", suffix=".nii.gz", overwrite=overwrite)
    assert (many / "in" / "c.nii.gz").read_bytes() == before
    shutil.copy(many / "in" / "a.nrrd", many / "in" / "c.nrrd")
    with pytest.raises(DeformError, match=r"results of c\.nii\.gz and c\.nrrd would both be c\.nii\.gz"):
        replay(document, [many / "in"], many / "out", suffix=".nii.gz", overwrite=overwrite)
    assert not (many / "out").exists()


def test_a_volume_in_ome_zarr_is_one_input_alone_and_in_a_folder(tmp_path: Path) -> None:
    source = tmp_path / "in"
    (source / "folder.nrrd").mkdir(parents=True)  # which is no input, for all its name
    volume = Volume(np.arange(24, dtype=np.uint8).reshape(2, 3, 4), Grid((2, 3, 4)))
    for name in ("a.zarr", "b.nrrd"):
        write_volume(volume, source / name)
    assert inputs_of([source / "a.zarr"]) == [source / "a.zarr"]
    assert inputs_of([source]) == [source / "a.zarr", source / "b.nrrd"]
    (tmp_path / "out").mkdir()
    done = replay(Deformation(), [source], tmp_path / "out")
    assert [(one.output, one.state) for one in done] == [("a.zarr", "done"), ("b.nrrd", "done")]
    assert np.array_equal(read_volume(tmp_path / "out" / "a.zarr").values, volume.values)
    [chunk] = [file for file in (source / "a.zarr").rglob("*") if file.is_file() and "c" in file.parent.parts[-3:]]
    os.utime(chunk, ns=(2 * 10**18, 2 * 10**18))  # as where it is written anew; the folder is as it was
    again = replay(Deformation(), [source], tmp_path / "out")
    assert [(one.output, one.state) for one in again] == [("a.zarr", "done"), ("b.nrrd", "kept")]


def test_two_inputs_of_one_name_are_refused(many: Path) -> None:
    shutil.copy(many / "tiny.nrrd", many / "in")
    with pytest.raises(DeformError, match=r"two inputs are named tiny\.nrrd"):
        inputs_of([many / "in", many / "tiny.nrrd"])


@pytest.mark.parametrize("name", ["nothing.nrrd", "empty"])
def test_inputs_that_are_not_there_are_named(name: str, many: Path) -> None:
    (many / "empty").mkdir()
    with pytest.raises(DeformError, match=name):
        inputs_of([many / name])


# ---- the command -----------------------------------------------------------------------------------------------------


def test_the_command_deforms_resumes_and_sums_up(many: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    assert run(many, "replay pull.json in --out out --summary all.json", monkeypatch) == 0
    told = capsys.readouterr().out.splitlines()
    assert told[-1].startswith("3 files: 3 done, 0 done before, 0 failed")
    assert "min det J" in told[0]
    rows = json.loads((many / "all.json").read_text(encoding="utf-8"))
    assert [row["state"] for row in rows] == ["done"] * 3
    assert run(many, "replay pull.json in --out out --summary all.json", monkeypatch) == 0  # over its own
    assert "0 done, 3 done before" in capsys.readouterr().out
    for letter in ("[]", "a letter", '[{"name": "fish"}]'):
        (many / "all.json").write_text(letter, encoding="utf-8")
        assert run(many, "replay pull.json in --out out --summary all.json", monkeypatch) == 2
        assert "all.json: exists already" in capsys.readouterr().err
        assert (many / "all.json").read_text(encoding="utf-8") == letter
    assert run(many, "replay pull.json in --out out --strength -0.5", monkeypatch) == 0
    assert "3 done, 0 done before" in capsys.readouterr().out


def test_the_command_tells_of_failures_and_ends_with_2(
    many: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    (many / "in" / "d.nrrd").write_bytes(b"NRRD")
    assert run(many, "replay pull.json in --out out", monkeypatch) == 2
    captured = capsys.readouterr()
    assert "3 done" in captured.out
    assert "1 of 4 files failed" in captured.err


def test_meshes_follow_in_the_space_of_the_volume(many: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    write_mesh(Mesh([[1, 2, 3], [6, 8, 3], [3, 6, 7]], [[0, 1, 2]]), many / "in" / "face.ply")
    assert run(many, "replay pull.json in --out out", monkeypatch) == 2
    assert "name that with --volume" in capsys.readouterr().out
    assert run(many, "replay pull.json in --out out --volume tiny.nrrd", monkeypatch) == 0
    field = read_deformation(many / "pull.json").field(read_volume(many / "tiny.nrrd").grid)
    expected = warp_mesh(read_mesh(many / "in" / "face.ply"), field)
    np.testing.assert_allclose(read_mesh(many / "out" / "face.ply").points, expected.points, atol=1e-6)


def test_another_box_or_another_volume_of_meshes_makes_them_again(
    many: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    tiny, document = read_volume(many / "tiny.nrrd"), read_deformation(many / "pull.json")
    write_mesh(Mesh([[1, 2, 3], [6, 8, 3], [3, 6, 7]], [[0, 1, 2]]), many / "face.ply")
    shutil.copy(many / "tiny.nrrd", many / "space.nrrd")
    wide = replace(tiny.grid, spacing=tuple(2 * s for s in tiny.grid.spacing))
    for grid, state in ((tiny.grid, "1 done,"), (tiny.grid, "1 done before"), (wide, "1 done,")):
        made_on = replace(document, volume=VolumeReference.of(Volume(tiny.values, grid)))
        write_deformation(made_on, many / "made.json")
        assert run(many, "replay made.json in/a.nrrd --out boxes --align box", monkeypatch) == 0
        assert run(many, "replay pull.json face.ply --out faces --volume space.nrrd", monkeypatch) == 0
        told = [line for line in capsys.readouterr().out.splitlines() if line.startswith("1 files")]
        assert [state in line for line in told] == [True, True]
        if state == "1 done before":
            write_volume(Volume(tiny.values, wide), many / "space.nrrd")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--align there", "unknown alignment 'there'"),
        ("--suffix .xyz", "no kind of volume file"),
        ("--volume face.ply", "is a mesh"),
    ],
)
def test_mistakes_are_told_before_any_work(
    options: str, message: str, many: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    assert run(many, f"replay pull.json in --out out {options}", monkeypatch) == 2
    assert message in capsys.readouterr().err
    assert not (many / "out").exists()

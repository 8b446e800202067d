"""One rule for public volumes whose files state a wrong spacing, for every reader."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb.document.deformation import Deformation, VolumeReference
from deformnb.document.transplant import with_true_spacing
from deformnb.errors import DeformError, OtherVolumeError
from deformnb.io import describe_file, read_volume, write_volume
from deformnb.io.documents import write_deformation
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Polygon
from deformnb.rbf.rigid import RigidMotion, RigidPart
from deformnb.session.batch import replay
from deformnb.session.session import Session
from deformnb.volume import known_spacings as module
from deformnb.volume.known_spacings import KnownSpacing, known_spacings
from deformnb.volume.volume import Volume

TRUE = (0.5, 1.0, 2.0)


@pytest.fixture
def scan(monkeypatch: pytest.MonkeyPatch) -> Volume:
    """A volume as in its file, with a spacing that the table lists as wrong."""
    values = np.zeros((9, 12, 10), np.uint8)
    values[2:7, 3:9, 2:8] = np.random.default_rng(4).integers(50, 250, (5, 6, 6))
    volume = Volume.from_array(values, origin=(3.0, -2.0, 5.0), name="fish")
    row = KnownSpacing(
        "fish of the tests",
        volume.shape,
        "uint8",
        VolumeReference.of(volume).sha256,
        (1.0, 1.0, 1.0),
        TRUE,
        "its anatomy",
    )
    monkeypatch.setattr(module, "known_spacings", lambda: (row,))
    return volume


@pytest.fixture
def file(scan: Volume, tmp_path: Path) -> Path:
    path = tmp_path / "any name.nrrd"
    write_volume(scan, path)
    return path


def older(scan: Volume, **options: Any) -> Deformation:
    """A document as an earlier version has made it, on the spacing of the file."""
    corners = [[1.0, 1], [8, 1], [1, 7], [8, 7]]
    points = ControlPoints.from_arrays([*corners, [5, 4]], [*corners, [6, 5]])
    made = Deformation.from_picture_points(scan.grid, "+y", points, support=9.0, trend="none", **options)
    return replace(made, volume=VolumeReference.of(scan))


def test_every_row_of_the_table_is_plain_data_that_a_page_can_read() -> None:
    rows = json.loads(Path(module.__file__).with_suffix(".json").read_text(encoding="utf-8"))
    assert len(rows) == len(known_spacings()) > 0
    for row in rows:
        assert set(row) == {"title", "shape", "dtype", "sha256", "header_spacing", "spacing", "reason"}
        assert len(row["sha256"]) == 64
        assert len(row["shape"]) == 3
        assert min(row["spacing"]) > 0
        assert row["spacing"] != row["header_spacing"]


def test_the_carp_has_one_shape_wherever_it_is_read(real_data: Callable[[str], Path]) -> None:
    path, true = real_data("carp.nii.gz"), (0.390625, 1.0, 0.78125)
    carp = read_volume(path)
    assert carp.grid.spacing == true
    assert [note for note in carp.notes if "1 x 1 x 1, which is wrong" in note]
    assert describe_file(path).grid == carp.grid
    assert read_volume(path, stride=4).grid.spacing == tuple(4 * s for s in true)
    as_told = read_volume(path, spacing=(1.0, 1.0, 1.0))
    assert as_told.grid.spacing == (1, 1, 1)
    assert as_told.notes == ()


@pytest.mark.parametrize("name", ["lobster.nrrd", "head_ct.nii.gz", "abdomen_ct.nii.gz", "knee_mr_bent.nrrd"])
def test_no_other_volume_is_hashed_or_changed(
    name: str, real_data: Callable[[str], Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    from deformnb.io.volumes import formats

    monkeypatch.setattr(formats, "voxel_checksum", None)  # would fail if called
    assert not [note for note in read_volume(real_data(name)).notes if "wrong" in note]


def test_a_copy_under_another_name_and_kind_is_known_by_its_voxels(scan: Volume, tmp_path: Path) -> None:
    for suffix in (".nii.gz", ".nii", ".mha", ".npy"):
        write_volume(scan, tmp_path / f"copy{suffix}")
        volume = read_volume(tmp_path / f"copy{suffix}")
        assert volume.grid.spacing == pytest.approx(TRUE), suffix
        assert volume.grid.origin == pytest.approx(scan.grid.origin)
        assert len(volume.notes) == 1
    one_off = Volume(np.where(scan.values == scan.values.max(), 0, scan.values).astype(np.uint8), scan.grid)
    write_volume(one_off, tmp_path / "other.nrrd")
    assert read_volume(tmp_path / "other.nrrd").grid.spacing == (1, 1, 1)
    write_volume(replace(scan, grid=replace(scan.grid, spacing=TRUE)), tmp_path / "right.nrrd")
    assert read_volume(tmp_path / "right.nrrd").notes == ()


def test_an_older_document_gives_the_same_voxels_with_the_true_spacing(scan: Volume, file: Path) -> None:
    document = older(scan)
    then = document.apply(scan)
    now = document.apply(read_volume(file))
    np.testing.assert_array_equal(now.values, then.values)
    assert (now.values != scan.values).any()
    assert now.grid.spacing == TRUE
    assert now.grid.origin == scan.grid.origin
    assert [note for note in now.notes if "wrong spacing of its file" in note]
    again = document.apply(read_volume(file, spacing=(1.0, 1.0, 1.0)))
    assert again.grid == scan.grid
    assert again.notes == then.notes


def test_the_box_of_an_older_document_keeps_its_voxels(scan: Volume, file: Path) -> None:
    box = scan.grid.resampled(spacing=0.5, margin=2.0)
    document = replace(older(scan), output=box)
    then, now = document.apply(scan), document.apply(read_volume(file))
    np.testing.assert_array_equal(now.values, then.values)
    assert now.grid.spacing == (0.25, 0.5, 1.0)
    volume = read_volume(file)
    there = scan.grid.point_to_index(box.origin)
    assert volume.grid.point_to_index(now.grid.origin) == pytest.approx(there)
    with pytest.raises(DeformError, match="no other grid than its own"):
        document.apply(volume, output=volume.grid)


def test_a_replay_of_an_older_document_gives_the_same_voxels(scan: Volume, file: Path, tmp_path: Path) -> None:
    document = older(scan)
    done = replay(document, [file], tmp_path / "out")
    assert [r.state for r in done] == ["done"], done[0].message
    result = read_volume(tmp_path / "out" / file.name)
    np.testing.assert_array_equal(result.values, document.apply(scan).values)
    assert result.grid.spacing == TRUE


def test_an_older_document_is_edited_on_the_same_voxels(scan: Volume, file: Path, tmp_path: Path) -> None:
    document, volume = older(scan), read_volume(file)
    write_deformation(document, tmp_path / "old.json")
    for begun in (Session(volume, document), Session(volume)):
        if len(begun.editing.points) == 4:  # a new session
            begun.open(tmp_path / "old.json")
            assert begun.files.saved is None, "what is edited is in no file yet"
            assert begun.files.path is None
        assert "wrong spacing of its file" in begun.editing.notice
        index = volume.grid.point_to_index(begun.editing.plane.from_plane(begun.editing.points.target))
        then = scan.grid.point_to_index(document.steps[0].plane.from_plane(document.steps[0].points.target))
        np.testing.assert_allclose(index[..., [0, 2]], then[..., [0, 2]], atol=1e-9)
        assert begun.files.difference(begun.document()) == ""
        assert begun.document().volume.spacing == TRUE
    fresh = begun.document()
    assert fresh.older_spacing(volume.grid) is None
    assert fresh.apply(volume).grid == volume.grid


def test_what_cannot_be_laid_on_the_true_spacing_is_refused_with_a_way_on(scan: Volume, file: Path) -> None:
    turn = RigidPart(Polygon(((3, 3), (6, 3), (5, 6))), RigidMotion.turn(20.0, (4.0, 4.0)))
    document = replace(older(scan), steps=(replace(older(scan).steps[0], parts=(turn,)),))
    volume = read_volume(file)
    with pytest.raises(OtherVolumeError, match=r"spacing=\(1.0, 1.0, 1.0\)"):
        with_true_spacing(document, volume.grid)
    with pytest.raises(OtherVolumeError):
        Session(volume).take(document)
    as_told = Session(read_volume(file, spacing=(1.0, 1.0, 1.0)), document)
    assert as_told.editing.deformation.steps == document.steps


def test_a_document_of_another_volume_is_left_alone(scan: Volume, file: Path) -> None:
    volume = read_volume(file)
    document = older(scan)
    for made in (None, replace(document.volume, sha256="0" * 64), VolumeReference.of(volume)):
        assert with_true_spacing(replace(document, volume=made), volume.grid) == (replace(document, volume=made), "")

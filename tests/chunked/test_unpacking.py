"""Files that cannot be read in parts are written as Zarr slice by slice, and the command does that by itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import deformnb as dn
from deformnb.chunked import open_volume, unpack
from deformnb.cli.main import main
from deformnb.errors import VolumeFileError
from deformnb.volume.volume import Grid, Volume

VALUES = np.random.default_rng(0).integers(10, 250, (21, 20, 18)).astype(np.int16)
VOLUME = Volume(VALUES, Grid(VALUES.shape, (1.0, 1.5, 2.0), (3.0, 4.0, 5.0), ((-1.0, 0, 0), (0, -1.0, 0), (0, 0, 1.0))))


@pytest.mark.parametrize("suffix", ["nii.gz", "nrrd", "mha", "vti", "raw"])
def test_the_voxels_are_those_of_the_file(suffix: str, tmp_path: Path) -> None:
    shares = list[float]()
    dn.write_volume(VOLUME, tmp_path / f"a.{suffix}")
    unpack(tmp_path / f"a.{suffix}", tmp_path / "a.zarr", progress=shares.append)
    found = open_volume(tmp_path / "a.zarr")
    np.testing.assert_array_equal(np.asarray(found), VALUES)
    np.testing.assert_allclose(found.grid.corners(), VOLUME.grid.corners(), atol=1e-5)
    assert (shares == sorted(shares), shares[-1]) == (True, 1.0)
    with pytest.raises(VolumeFileError, match="already"):
        unpack(tmp_path / f"a.{suffix}", tmp_path / "a.zarr")


def test_the_command_unpacks_what_does_not_fit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    dn.write_volume(VOLUME, tmp_path / "scan.nii.gz")
    points = dn.ControlPoints.from_arrays([[0.0, -10, 20]], [[1.0, -9, 22]])
    document = dn.Deformation.from_space_points(points, support=20.0)
    dn.write_deformation(document, tmp_path / "d.json")
    command = ["warp", str(tmp_path / "d.json"), str(tmp_path / "scan.nii.gz"), str(tmp_path / "out.zarr")]
    known = document.apply(VOLUME).values
    monkeypatch.setattr("deformnb.chunked.unpacking.default_limit", lambda: VALUES.nbytes - 1)
    assert main(command) == 0
    assert "cannot be read in parts: it is written as Zarr first" in capsys.readouterr().err
    assert np.abs(dn.read_volume(tmp_path / "out.zarr").values - known).max() <= 1
    assert {path.name for path in tmp_path.iterdir()} == {"scan.nii.gz", "d.json", "out.zarr"}

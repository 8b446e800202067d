"""Volumes in open files and in memory, in place of paths."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

import deformnb as dn
from deformnb.errors import DeformError, VolumeFileError

VOLUME = dn.Volume.from_array(np.arange(24, dtype=np.int16).reshape(2, 3, 4), spacing=(1.0, 2.0, 3.0))


@pytest.mark.parametrize("suffix", [".nii", ".nii.gz", ".nrrd", ".mha", ".vti", ".ome.tif"])
def test_what_is_written_to_memory_is_that_of_a_file_and_is_read(suffix: str, tmp_path: Path) -> None:
    memory, file = io.BytesIO(), tmp_path / f"a{suffix}"
    dn.write_volume(VOLUME, memory, suffix=suffix)
    memory.seek(0)
    again = dn.read_volume(memory, suffix=suffix)
    dn.write_volume(VOLUME, file)
    np.testing.assert_array_equal(again.values, VOLUME.values)
    assert again.grid == dn.read_volume(file).grid
    with file.open("rb") as opened:
        named = dn.read_volume(opened)
    assert named.name == "a"
    np.testing.assert_array_equal(named.values, VOLUME.values)


def test_a_file_is_read_from_where_it_stands_and_left_open() -> None:
    memory = io.BytesIO()
    memory.write(b"head")
    dn.write_volume(VOLUME, memory, suffix="nrrd")
    memory.seek(4)
    assert dn.read_volume(memory, suffix=".nrrd", name="carp").name == "carp"
    assert not memory.closed


def test_an_array_of_numpy_is_read_from_memory() -> None:
    memory = io.BytesIO()
    np.save(memory, VOLUME.values)
    memory.seek(0)
    np.testing.assert_array_equal(dn.read_volume(memory, suffix=".npy").values, VOLUME.values)


def test_an_open_file_needs_a_format_and_bytes() -> None:
    with pytest.raises(DeformError, match="needs its format"):
        dn.read_volume(io.BytesIO(b"NRRD0004"))
    with pytest.raises(DeformError, match="suffix is the ending of a name"):
        dn.read_volume(io.BytesIO(), suffix="../a")
    with pytest.raises(VolumeFileError, match="must give bytes, got str"):
        dn.read_volume(io.StringIO("NRRD0004"), suffix=".nrrd")  # type: ignore[arg-type]
    with pytest.raises(VolumeFileError):
        dn.read_volume(io.BytesIO(b"damaged"), suffix=".nii")


@pytest.mark.parametrize("suffix", [".zarr", ".nhdr", ".mhd", ".npy"])
def test_a_format_of_several_files_is_refused_and_nothing_is_written(suffix: str) -> None:
    if suffix == ".zarr":
        pytest.importorskip("zarr")
    memory = io.BytesIO()
    with pytest.raises(VolumeFileError, match="not one file"):
        dn.write_volume(VOLUME, memory, suffix=suffix)
    assert memory.getvalue() == b""

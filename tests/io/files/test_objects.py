"""Volumes in open files and in memory, in place of paths."""

from __future__ import annotations

import inspect
import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import deformnb as dn
from deformnb.errors import DeformError, VolumeFileError
from deformnb.io.landmarks.formats import LANDMARK_FORMATS
from deformnb.io.meshes.formats import MESH_FORMATS
from deformnb.rbf.fields import Affine

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


MARKS = dn.warping.Landmarks([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], ("nose", "tail"))
MESH = dn.warping.Mesh([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[0, 1, 2]])
MOVE = Affine([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [1.0, 2.0, 3.0])


@pytest.mark.parametrize("suffix", [row.suffix for row in LANDMARK_FORMATS.values() if 3 in row.dimensions])
def test_landmarks_are_written_to_memory_and_read(suffix: str) -> None:
    memory = io.BytesIO()
    marks = replace(MARKS, fixed=MARKS.points + 1) if suffix in (".bigwarp.json", ".landmarks.csv") else MARKS
    dn.write_landmarks(marks, memory, suffix=suffix)
    memory.seek(0)
    np.testing.assert_allclose(dn.read_landmarks(memory, suffix=suffix).points, MARKS.points)


@pytest.mark.parametrize("suffix", [row.suffixes[0] for row in MESH_FORMATS.values()])
def test_surfaces_are_written_to_memory_and_read(suffix: str) -> None:
    memory = io.BytesIO()
    dn.write_mesh(MESH, memory, suffix=suffix)
    memory.seek(0)
    again = dn.read_mesh(memory, suffix=suffix)
    assert again.name == ""
    np.testing.assert_allclose(sorted(again.points.tolist()), sorted(MESH.points.tolist()))


@pytest.mark.parametrize("suffix", [".tfm", ".nrrd", ".nii.gz", ".mha"])
def test_transforms_are_written_to_memory_and_read(suffix: str) -> None:
    memory = io.BytesIO()
    dn.write_transform(MOVE, memory, dn.Grid((4, 4, 4)), suffix=suffix)
    memory.seek(0)
    found = dn.read_transform(memory, suffix=suffix)
    np.testing.assert_allclose(found.displacement([1.0, 1.0, 1.0]), MOVE.displacement([1.0, 1.0, 1.0]), rtol=1e-6)


def test_documents_and_channels_are_written_to_memory_and_read() -> None:
    memory = io.BytesIO()
    document = dn.Deformation.from_picture_points(VOLUME, "+y", dn.ControlPoints.from_arrays([[1, 1]], [[2, 1]]))
    dn.write_deformation(document, memory)
    memory.seek(0)
    assert dn.read_deformation(memory) == document
    memory = io.BytesIO()
    dn.io.write_channels(dn.volume.Channels((VOLUME, VOLUME)), memory, suffix=".nrrd")
    memory.seek(0)
    assert len(dn.io.read_channels(memory, suffix=".nrrd")) == 2


def test_every_reader_of_one_file_takes_an_open_one() -> None:
    """A new reader or writer of :mod:`deformnb.io` takes ``io.BytesIO()``, or is named here with its reason."""
    others = {
        "read_label_names": "it looks beside the file",
        "write_segmentation": "it is written like another file",
        "write_series": "it is written while moments are computed",
    }
    for name in dn.io.__all__:
        if name.startswith(("read_", "write_")) and name not in others:
            path = inspect.signature(getattr(dn.io, name)).parameters.get("path")
            assert path is None or "BinaryIO" in str(path.annotation), name


def test_an_open_file_needs_a_format_and_bytes() -> None:
    with pytest.raises(DeformError, match="needs its format"):
        dn.read_volume(io.BytesIO(b"NRRD0004"))
    with pytest.raises(DeformError, match="suffix is the ending of a name"):
        dn.read_volume(io.BytesIO(), suffix="../a")
    with pytest.raises(VolumeFileError):
        dn.read_volume(io.BytesIO(b"damaged"), suffix=".nii")
    for read in (dn.read_volume, dn.read_transform):
        with pytest.raises(VolumeFileError, match="a folder of Zarr is not one file"):
            read(io.BytesIO(b""), suffix=".zarr")


@pytest.mark.parametrize("suffix", [".zarr", ".nhdr", ".mhd", ".npy"])
def test_a_format_of_several_files_is_refused_and_nothing_is_written(suffix: str) -> None:
    if suffix == ".zarr":
        pytest.importorskip("zarr")
    memory = io.BytesIO()
    with pytest.raises(VolumeFileError, match="not one file"):
        dn.write_volume(VOLUME, memory, suffix=suffix)
    assert memory.getvalue() == b""


class Pipe(io.RawIOBase):
    """Bytes that come once, like those of a pipe."""

    def __init__(self, content: bytes) -> None:
        self._rest = io.BytesIO(content)

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        return self._rest.read(size)


def test_a_pipe_is_read() -> None:
    memory = io.BytesIO()
    dn.write_volume(VOLUME, memory, suffix=".nrrd")
    found = dn.read_volume(Pipe(memory.getvalue()), suffix=".nrrd")  # type: ignore[arg-type]
    np.testing.assert_array_equal(found.values, VOLUME.values)


READERS = {
    "volume": lambda file: dn.read_volume(file, suffix=".nrrd"),
    "channels": lambda file: dn.io.read_channels(file, suffix=".nrrd"),
    "landmarks": lambda file: dn.read_landmarks(file, suffix=".fcsv"),
    "mesh": lambda file: dn.read_mesh(file, suffix=".ply"),
    "transform": lambda file: dn.read_transform(file, suffix=".tfm"),
    "deformation": dn.read_deformation,
}
WRITERS = {
    "volume": lambda file: dn.write_volume(VOLUME, file, suffix=".nrrd"),
    "channels": lambda file: dn.io.write_channels(dn.volume.Channels((VOLUME,)), file, suffix=".nrrd"),
    "landmarks": lambda file: dn.write_landmarks(MARKS, file, suffix=".fcsv"),
    "mesh": lambda file: dn.write_mesh(MESH, file, suffix=".ply"),
    "transform": lambda file: dn.write_transform(MOVE, file, dn.Grid((4, 4, 4)), suffix=".tfm"),
    "deformation": lambda file: dn.write_deformation(dn.Deformation(), file),
}


def closed(_: Path) -> io.BytesIO:
    memory = io.BytesIO(b"a")
    memory.close()
    return memory


def test_readers_and_writers_are_all_here() -> None:
    readers_and_writers = [name for name in dn.io.__all__ if name.startswith(("read_", "write_"))]
    paths = {name: inspect.signature(getattr(dn.io, name)).parameters.get("path") for name in readers_and_writers}
    takes = {name for name, path in paths.items() if path is not None and "BinaryIO" in str(path.annotation)}
    assert takes == {f"read_{name}" for name in READERS} | {f"write_{name}" for name in WRITERS}


@pytest.mark.parametrize(
    ("opened", "words"),
    [
        (lambda _: io.StringIO("a"), "open it as 'rb'"),
        (lambda path: path.open("wb"), "not open to read: open it as 'rb'"),
        (closed, "this file is closed"),
        (lambda _: io.BytesIO(), r"file\.seek\(0\)"),
    ],
)
@pytest.mark.parametrize("name", READERS)
def test_a_file_that_gives_no_bytes_is_refused(name: str, opened: Any, words: str, tmp_path: Path) -> None:
    file = opened(tmp_path / "a")
    with pytest.raises(VolumeFileError, match=words):
        READERS[name](file)
    file.close()


@pytest.mark.parametrize(
    ("opened", "words"),
    [
        (lambda _: io.StringIO(), "open it as 'wb'"),
        (lambda path: path.open("rb"), "not open to write: open it as 'wb'"),
        (closed, "this file is closed"),
    ],
)
@pytest.mark.parametrize("name", WRITERS)
def test_a_file_that_takes_no_bytes_is_refused(name: str, opened: Any, words: str, tmp_path: Path) -> None:
    (tmp_path / "a").touch()
    file = opened(tmp_path / "a")
    with pytest.raises(VolumeFileError, match=words):
        WRITERS[name](file)
    file.close()

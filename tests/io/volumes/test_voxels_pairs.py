"""A header and its detached voxels: always a pair, which other programs read and may write anew."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from deformnb import Volume
from deformnb.errors import Cancelled, VolumeFileError
from deformnb.io import read_volume, write_volume
from deformnb.io.files import atomic

PAIRS = [".mhd", ".nhdr"]


def small_volume(number: int = 0, *, is_labels: bool = False) -> Volume:
    values = np.arange(4 * 5 * 6, dtype=np.int16).reshape(4, 5, 6) + 100 * number
    return replace(Volume.from_array(values, (1 + number, 2, 3)), is_labels=is_labels)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def data_of(path: Path) -> Path:
    (data,) = path.parent.glob(f"{path.name}.*.raw")
    return data


@pytest.mark.parametrize("suffix", PAIRS)
def test_other_voxels_get_another_name_and_the_old_ones_go(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    write_volume(small_volume(), path)
    first = data_of(path)
    text = path.read_bytes()
    stranger = tmp_path / f"{path.name}.raw"  # no header names it
    stranger.write_bytes(b"mine")
    orphan = tmp_path / f"{path.name}.0123abcd.raw"  # of a writer that was killed before it wrote its header
    orphan.write_bytes(b"x")
    write_volume(small_volume(1), path)
    assert not first.exists()
    assert not orphan.exists()
    assert stranger.read_bytes() == b"mine"
    stranger.unlink()
    again = read_volume(path)
    np.testing.assert_array_equal(again.values, small_volume(1).values)
    assert again.grid == small_volume(1).grid
    write_volume(small_volume(), path)
    assert names(tmp_path) == sorted([path.name, first.name])
    assert path.read_bytes() == text  # equal volumes give equal files


@pytest.mark.parametrize("suffix", PAIRS)
def test_the_data_file_of_an_earlier_release_goes_once_it_is_replaced(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    write_volume(small_volume(), path)
    old = tmp_path / f"{path.name}.raw"
    data = data_of(path)
    path.write_bytes(path.read_bytes().replace(data.name.encode(), old.name.encode()))
    data.rename(old)
    np.testing.assert_array_equal(read_volume(path).values, small_volume().values)
    write_volume(small_volume(1), path)
    assert not old.exists()
    np.testing.assert_array_equal(read_volume(path).values, small_volume(1).values)


@pytest.mark.parametrize("suffix", PAIRS)
def test_voxels_of_another_volume_are_refused(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    write_volume(small_volume(), path)
    data = data_of(path)
    whole = data.read_bytes()
    data.write_bytes(small_volume(1).values.tobytes())  # of the same size
    with pytest.raises(VolumeFileError, match=rf"not those that the header a{suffix} was written for \(CRC "):
        read_volume(path)
    data.write_bytes(whole[:-2])
    with pytest.raises(VolumeFileError, match=r"needs 240 bytes .*has 238: it is cut short or damaged"):
        read_volume(path)
    data.write_bytes(whole)
    np.testing.assert_array_equal(read_volume(path, stride=2).values, small_volume().values[::2, ::2, ::2])


@pytest.mark.parametrize("is_labels", [False, True])
@pytest.mark.parametrize("suffix", PAIRS)
def test_other_programs_read_the_header_with_its_check_sum(suffix: str, is_labels: bool, tmp_path: Path) -> None:
    sitk, nrrd = pytest.importorskip("SimpleITK"), pytest.importorskip("nrrd")
    vtk = pytest.importorskip("vtkmodules.vtkIOImage")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    path = tmp_path / f"a{suffix}"
    volume = small_volume(is_labels=is_labels)
    write_volume(volume, path)
    assert b"deformnb data crc32" in path.read_bytes()
    assert bool(read_volume(path).is_labels) == is_labels
    image = sitk.ReadImage(str(path))
    np.testing.assert_array_equal(sitk.GetArrayFromImage(image), volume.values)
    assert image.GetSpacing() == volume.grid.spacing
    reader = (vtk.vtkMetaImageReader if suffix == ".mhd" else vtk.vtkNrrdReader)()
    reader.SetFileName(str(path))
    reader.Update()
    voxels = vtk_to_numpy(reader.GetOutput().GetPointData().GetScalars())
    np.testing.assert_array_equal(voxels.ravel(), volume.values.ravel())
    if suffix == ".nhdr":
        np.testing.assert_array_equal(nrrd.read(str(path))[0].T, volume.values)


@pytest.mark.parametrize("suffix", PAIRS)
@pytest.mark.parametrize("place", ["a", "other"])
def test_what_other_programs_make_of_it_is_read(suffix: str, place: str, tmp_path: Path) -> None:
    """Other programs copy the comments of a header for other voxels; the check sum must not be among it."""
    sitk, nrrd = pytest.importorskip("SimpleITK"), pytest.importorskip("nrrd")
    path, other = tmp_path / f"a{suffix}", tmp_path / f"{place}{suffix}"
    write_volume(small_volume(), path)
    image = sitk.ReadImage(str(path))
    image[0, 0, 0] = 99
    sitk.WriteImage(image, str(other))
    assert read_volume(other).values[0, 0, 0] == 99
    if suffix == ".nhdr":
        write_volume(small_volume(), path)
        values, header = nrrd.read(str(path))
        nrrd.write(str(other), values + 7, header)
        np.testing.assert_array_equal(read_volume(other).values, small_volume().values + 7)


@pytest.mark.parametrize("suffix", PAIRS)
def test_a_header_that_cannot_be_written_leaves_the_pair_of_before(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a{suffix}"

    def refused(self: Path, target: Path) -> Path:
        if target.name == path.name:
            raise OSError(5, "Input/output error")
        return replace_file(self, target)

    replace_file = Path.replace
    for is_there in (False, True):
        before = names(tmp_path)
        with monkeypatch.context() as disk:
            disk.setattr(Path, "replace", refused)
            with pytest.raises(VolumeFileError, match="was not written, the system reports: Input/output error"):
                write_volume(small_volume(1), path)
        assert names(tmp_path) == before
        write_volume(small_volume(), path)
        assert is_there == bool(before)
    np.testing.assert_array_equal(read_volume(path).values, small_volume().values)
    with pytest.raises(Cancelled):
        write_volume(small_volume(1), path, progress=lambda share: (_ for _ in ()).throw(Cancelled("stop")))
    np.testing.assert_array_equal(read_volume(path).values, small_volume().values)


@pytest.mark.parametrize("suffix", PAIRS)
def test_a_data_file_that_another_process_writes_is_left_alone(suffix: str, tmp_path: Path) -> None:
    from deformnb.io.files.atomic import create_locked

    path = tmp_path / f"a{suffix}"
    write_volume(small_volume(), path)
    theirs = tmp_path / f"{path.name}.0123abcd.raw"
    descriptor = create_locked(theirs)  # in its place, and its header is not written yet
    assert descriptor is not None
    write_volume(small_volume(1), path)
    assert theirs.exists()
    os.close(descriptor)
    write_volume(small_volume(), path)
    assert not theirs.exists()


# -- on the disk before it has its name ------------------------------------------------------------------------------


class Disk:
    """Flushed and renamed files, in order; a flush counts only if all bytes were passed to the system before."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.events: list[tuple[str, str, int]] = []
        synced: dict[int, int] = {}
        fsync, rename = os.fsync, Path.replace

        def sync(descriptor: int) -> None:
            found = os.fstat(descriptor)
            if os.path.samestat(found, folder.stat()):
                self.events.append(("folder", "", 0))
            else:
                synced[found.st_ino] = found.st_size
            fsync(descriptor)

        def renamed(self_: Path, target: Path) -> Path:
            found = self_.stat()
            self.events.append(("renamed", target.name, synced.get(found.st_ino, -1) - found.st_size))
            return rename(self_, target)

        monkeypatch.setattr(atomic.os, "fsync", sync)
        monkeypatch.setattr(Path, "replace", renamed)


@pytest.mark.skipif(os.name != "posix", reason="other systems cannot flush a folder")
def test_a_file_is_on_the_disk_before_it_takes_its_place_and_its_name_after(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = Disk(tmp_path, monkeypatch)
    with atomic.atomic_write(tmp_path / "a.txt") as file:
        file.write(b"whole")
    assert disk.events == [("renamed", "a.txt", 0), ("folder", "", 0)]


@pytest.mark.skipif(os.name != "posix", reason="other systems cannot flush a folder")
@pytest.mark.parametrize("suffix", PAIRS)
def test_voxels_and_their_name_are_on_the_disk_before_the_header(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a{suffix}"
    write_volume(small_volume(1), path)
    old = data_of(path)
    disk = Disk(tmp_path, monkeypatch)
    removed: list[int] = []
    unlink = Path.unlink
    monkeypatch.setattr(
        Path,
        "unlink",
        lambda self, missing_ok=False: (
            removed.append(len(disk.events)) if self == old else None,
            unlink(self, missing_ok=missing_ok),
        )[1],
    )
    write_volume(small_volume(), path)
    steps = [("renamed", data_of(path).name, 0), ("folder", "", 0), ("renamed", path.name, 0), ("folder", "", 0)]
    assert disk.events[:4] == steps
    assert removed
    assert min(removed) >= 4  # the old voxels go when the new header is safe

"""A file is written whole or not at all, and obstacles are reported before any work."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from collections import namedtuple
from pathlib import Path

import numpy as np
import pytest
from full_disk import full_disk

from deformnb import DeformError, Volume
from deformnb.errors import Cancelled, VolumeFileError
from deformnb.io import FORMATS, atomic_write, read_volume, write_volume

WRITABLE = [s for kind, entry in FORMATS.items() if entry.write and kind != "image" for s in entry.suffixes]
FILES = [
    s
    for kind, entry in FORMATS.items()
    if entry.write and kind != "image" and not entry.folder_marks
    for s in entry.suffixes
]
Usage = namedtuple("Usage", "total used free")


def small_volume(value: int = 0, size: int = 8) -> Volume:
    return Volume.from_array(np.full((size, size, size), value, np.int16), (1, 2, 3))


def contents(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def test_nothing_is_visible_before_the_end(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"old")
    with atomic_write(path) as file:
        file.write(b"new")
        file.flush()
        assert path.read_bytes() == b"old"
    assert contents(tmp_path) == {"a.txt": b"new"}


@pytest.mark.parametrize("error", [Cancelled, RuntimeError, KeyboardInterrupt, DeformError, OSError])
def test_an_exception_leaves_the_old_file_and_no_litter(error: type[BaseException], tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(b"old")

    def interrupted() -> None:
        with atomic_write(path) as file:
            file.write(b"new")
            raise error("stop")

    with pytest.raises(VolumeFileError if error is OSError else error):
        interrupted()
    assert contents(tmp_path) == {"a.txt": b"old"}


def test_permissions_and_links_are_kept(tmp_path: Path) -> None:
    real, link = tmp_path / "real.txt", tmp_path / "link.txt"
    real.write_bytes(b"old")
    real.chmod(0o640)
    link.symlink_to(real)
    with atomic_write(link) as file:
        file.write(b"new")
    assert link.is_symlink()
    assert real.read_bytes() == b"new"
    assert stat.S_IMODE(real.stat().st_mode) == 0o640
    old = os.umask(0o027)
    try:
        with atomic_write(tmp_path / "fresh.txt"):
            pass
    finally:
        os.umask(old)
    assert stat.S_IMODE((tmp_path / "fresh.txt").stat().st_mode) == 0o640


@pytest.mark.parametrize("suffix", FILES)
def test_what_stands_in_the_way_is_said(suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[float] = []

    def refuse(path: Path, words: str, **options: object) -> None:
        before = contents(tmp_path) if all(file.is_file() for file in tmp_path.iterdir()) else None
        with pytest.raises(VolumeFileError, match=words) as caught:
            write_volume(small_volume(), path, progress=told.append, **options)  # type: ignore[arg-type]
        assert "\n" not in str(caught.value)
        assert not told  # before any work
        assert before is None or contents(tmp_path) == before

    refuse(tmp_path / "none" / f"a{suffix}", "no folder")
    write_volume(small_volume(), tmp_path / f"a{suffix}")
    refuse(tmp_path / f"a{suffix}", "exists already", overwrite=False)
    refuse(tmp_path / ("x" * 300 + suffix), ".")
    refuse(tmp_path / f"a\0{suffix}", "names no file|cannot have this name")
    (tmp_path / f"folder{suffix}").mkdir()
    refuse(tmp_path / f"folder{suffix}", "this is a folder")
    (tmp_path / f"folder{suffix}").rmdir()
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda _path: Usage(10**9, 10**9, 100))
        refuse(tmp_path / f"b{suffix}", "needs .* only 100 bytes free")
    with monkeypatch.context() as patch:  # tests may run as root, who may write everywhere
        patch.setattr(os, "access", lambda path, _mode: Path(path) != tmp_path)
        refuse(tmp_path / f"b{suffix}", "read-only for you")
    with monkeypatch.context() as patch:
        patch.setattr(os, "access", lambda path, _mode: Path(path).name != f"a{suffix}")
        refuse(tmp_path / f"a{suffix}", "file is read-only")


def test_only_known_kinds_are_written(tmp_path: Path) -> None:
    for name, words in (("a.dcm", "DICOM.*read but not written"), ("a", "no kind"), ("a.txt", ".nii.gz")):
        with pytest.raises(VolumeFileError, match=words):
            write_volume(small_volume(), tmp_path / name)
    assert contents(tmp_path) == {}


def test_formats_do_not_overwrite_one_another(tmp_path: Path) -> None:
    for number, suffix in enumerate(WRITABLE):
        write_volume(small_volume(number), tmp_path / f"a{suffix}")
    for number, suffix in enumerate(WRITABLE):
        assert (read_volume(tmp_path / f"a{suffix}").values == number).all()


@pytest.mark.parametrize("suffix", FILES)
def test_a_disk_that_fills_up_leaves_the_old_file(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a{suffix}"
    write_volume(small_volume(1), path)
    before = contents(tmp_path)
    noise = Volume.from_array(np.random.default_rng(0).integers(-9999, 9999, (64, 64, 64), np.int16))
    with full_disk(100_000), pytest.raises(VolumeFileError, match=r"is full; an older file of this name is untouched"):
        write_volume(noise, path)
    assert contents(tmp_path) == before
    assert (read_volume(path).values == 1).all()


_KILLED = """
import sys, numpy, deformnb, deformnb.io
def wait(share):
    print("begun", flush=True)
    sys.stdin.read()
deformnb.io.write_volume(deformnb.Volume.from_array(numpy.zeros((300, 300, 300), "u1")), sys.argv[1], progress=wait)
"""


def test_a_killed_program_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "a.nii"
    write_volume(small_volume(1), path)
    child = subprocess.Popen([sys.executable, "-c", _KILLED, str(path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        assert child.stdout is not None
        assert child.stdout.readline() == b"begun\n"
        child.kill()
        child.wait(30)
    finally:
        child.kill()
        child.communicate()
    assert (read_volume(path).values == 1).all()


@pytest.mark.parametrize("has_links", [True, False])
def test_a_file_that_comes_meanwhile_is_not_overwritten(
    has_links: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "a.txt"
    if not has_links:  # as on FAT
        monkeypatch.setattr(Path, "hardlink_to", lambda *_given: (_ for _ in ()).throw(PermissionError(1, "no links")))

    def write_too_late() -> None:
        with atomic_write(path, overwrite=False) as file:
            file.write(b"mine")
            path.write_bytes(b"theirs")

    with pytest.raises(VolumeFileError, match="exists already"):
        write_too_late()
    assert contents(tmp_path) == {"a.txt": b"theirs"}
    with atomic_write(tmp_path / "b.txt", overwrite=False) as file:
        file.write(b"mine")
    assert contents(tmp_path) == {"a.txt": b"theirs", "b.txt": b"mine"}


def test_two_writers_at_once_leave_one_whole_file(tmp_path: Path) -> None:
    path = tmp_path / "a.nrrd"

    def inner(share: float) -> None:
        if not path.exists():
            write_volume(small_volume(2), path)

    write_volume(small_volume(1), path, progress=inner)
    assert (read_volume(path).values == 1).all()
    assert list(contents(tmp_path)) == ["a.nrrd"]

"""The folder of an unfinished job: after any change to it, the result is correct, or a sentence states the cure.

States are made as an interrupted process leaves them: the job is stopped after some blocks, and the folder is changed.
"""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb import Cancelled, DeformError, Volume, chunked
from deformnb.chunked import blocks, store
from deformnb.errors import VolumeFileError
from deformnb.rbf.fields import Affine

VALUES = np.random.default_rng(0).integers(1, 250, (12, 16, 20)).astype(np.uint8)
VALUES[:4, :8] = 0  # blocks of fill values alone are not stored
SHIFT = Affine(np.eye(3), np.array([0.5, 0.0, 0.0]))
CHUNKS = (4, 8, 8)
BLOCKS = 18


def warp_store(target: Path, source: Any = None, **options: Any) -> Any:
    return chunked.warp(
        Volume.from_array(VALUES) if source is None else source,
        SHIFT,
        target,
        chunks=CHUNKS,
        levels=2,
        fill=0,
        workers=1,
        **options,
    )


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> list[np.ndarray]:
    """The levels of a result that nothing has interrupted."""
    return levels(warp_store(tmp_path_factory.mktemp("known") / "a.zarr").path)


def levels(path: Path) -> list[np.ndarray]:
    return [np.asarray(chunked.open_volume(path, level=k)) for k in range(2)]


def stop_job(target: Path, after: int = 11, source: Any = None) -> Path:
    """The folder of a job that was stopped after some blocks."""
    count = iter(range(10**6))

    def stop(_share: float) -> None:
        if next(count) >= after:
            raise Cancelled

    with pytest.raises(Cancelled):
        warp_store(target, source, progress=stop)
    return target.with_name(f".{target.name}.unfinished")


def chunk_of(folder: Path) -> Path:
    return max(folder.glob("pyramid/0/c/*/*/*"))


DAMAGE: dict[str, Callable[[Path], Any]] = {
    "delete": lambda file: file.unlink(),
    "empty": lambda file: file.write_bytes(b""),
    "cut": lambda file: file.write_bytes(file.read_bytes()[:-7]),
    "flip": lambda file: file.write_bytes(
        file.read_bytes()[:-9] + bytes([file.read_bytes()[-9] ^ 1]) + file.read_bytes()[-8:]
    ),
    "replace": lambda file: file.write_bytes(b"[[[[ nonsense"),
    "folder": lambda file: (file.unlink(), file.mkdir(), (file / "x").write_text("x", encoding="utf-8")),
    "pipe": lambda file: (file.unlink(), os.mkfifo(file)),
    "link": lambda file: (shutil.copy(file, file.with_name("there")), file.unlink(), file.symlink_to("there")),
    "deep": lambda file: file.write_bytes(b"[" * 50_000),
}
FILES: dict[str, Callable[[Path], Path]] = {
    "chunk": chunk_of,
    "metadata": lambda folder: folder / "pyramid/0/zarr.json",
    "group": lambda folder: folder / "pyramid/zarr.json",
    "job": lambda folder: folder / "job.json",
    "journal": lambda folder: folder / "done.txt",
    "lock": lambda folder: folder / "lock",
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes have names on POSIX only")
@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("file", FILES)
def test_damage_of_a_file_ends_in_the_right_result_or_one_sentence(
    file: str, damage: str, known: list[np.ndarray], tmp_path: Path
) -> None:
    folder = stop_job(tmp_path / "a.zarr")
    place = FILES[file](folder)
    if place.stat().st_size == 0 and damage in ("flip", "cut"):
        pytest.skip("an empty file cannot be damaged so")
    DAMAGE[damage](place)
    said = ""
    try:
        found = warp_store(tmp_path / "a.zarr")
    except DeformError as error:
        said = str(error)
        shutil.rmtree(folder)  # as the message states
        found = warp_store(tmp_path / "a.zarr")
    if said:
        assert file in ("job", "journal", "lock")
        assert folder.name in said
        assert "emove that folder" in said
    elif file == "chunk":
        assert "1 finished blocks of an earlier run" in " ".join(found.notes)
    for mine, theirs in zip(levels(found.path), known, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert sorted(entry.name for entry in tmp_path.iterdir()) == ["a.zarr"]


@pytest.mark.parametrize("after", [0, 5, 17, 18, 20])
def test_what_is_done_is_not_done_again_at_any_moment(
    after: int, known: list[np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop_job(tmp_path / "a.zarr", after)
    computed: list[int] = []
    original = blocks.BlockWarp.__call__
    monkeypatch.setattr(blocks.BlockWarp, "__call__", lambda job, k: (computed.append(k), original(job, k))[1])
    for mine, theirs in zip(levels(warp_store(tmp_path / "a.zarr").path), known, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert len(computed) == max(0, BLOCKS - after)


class Killed(BaseException):
    """End of a process in the middle: nothing below catches it, and no clean-up follows."""


@pytest.mark.parametrize("moment", ["chunk", "flush", "line", "metadata", "job", "publish", "swept"])
def test_a_process_that_dies_at_any_moment_leaves_what_goes_on(
    moment: str, known: list[np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target, calls = tmp_path / "a.zarr", iter(range(10**6))

    def dies_before(place: Any, name: str, at: int) -> None:
        original = getattr(place, name)

        def run(*args: Any, **kwargs: Any) -> Any:
            if next(calls) == at:
                raise Killed
            return original(*args, **kwargs)

        monkeypatch.setattr(place, name, run)

    place, name, at = {
        "chunk": (store.UnfinishedStore, "mark_finished", 4),
        "flush": (store.UnfinishedStore, "_persist", 4),
        "line": (store, "_checksum", 4),
        "metadata": (store.ome_zarr, "create_pyramid", 0),
        "job": (store, "atomic_write", 0),
        "publish": (store, "publish_folder", 0),
        "swept": (store.shutil, "rmtree", 0),
    }[moment]
    dies_before(place, name, at)
    with pytest.raises(Killed):
        warp_store(target)
    monkeypatch.undo()
    if moment == "line":  # and half of the line is on the disk
        with (tmp_path / ".a.zarr.unfinished" / "done.txt").open("a") as log:
            log.write("0 4 0123456789abcdef")
    found = warp_store(target, overwrite=moment == "swept")  # then the result is there already
    for mine, theirs in zip(levels(found.path), known, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.zarr"]


def test_a_line_is_on_the_disk_only_after_its_block(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flushed: list[str] = []
    original = os.fsync
    monkeypatch.setattr(
        os, "fsync", lambda number: (flushed.append(os.readlink(f"/proc/self/fd/{number}")), original(number))[1]
    )
    if not Path("/proc/self/fd").exists():
        pytest.skip("open files have names under /proc on Linux")
    folder = stop_job(tmp_path / "a.zarr")
    lines = [k for k, name in enumerate(flushed) if name == str(folder / "done.txt")]
    stored = (folder / "done.txt").read_text(encoding="utf-8").splitlines()
    assert len(lines) == len(stored) == 11
    for (begin, end), line in zip(zip([0, *lines], lines, strict=False), stored, strict=True):
        between = flushed[begin:end]
        chunks = [
            name for name in between if name.startswith(str(folder / "pyramid" / "0" / "c")) and not Path(name).is_dir()
        ]
        assert len(chunks) == (0 if " empty " in line else 1)
        if chunks:
            assert str(Path(chunks[0]).parent) in between[between.index(chunks[0]) :]  # and its name in its folder


@pytest.mark.parametrize("kind", ["zarr", "npy", "h5", "tif", "memory"])
def test_a_source_that_was_changed_in_between_is_refused(kind: str, tmp_path: Path) -> None:
    def stored(values: np.ndarray) -> Any:
        if kind == "memory":
            return values
        name = tmp_path / f"source.{kind}"
        if kind == "npy":
            np.save(name, values)
        elif kind == "h5":
            h5py = pytest.importorskip("h5py")
            with h5py.File(name, "w") as file:
                file["scan"] = values
        elif kind == "tif":
            pytest.importorskip("tifffile").imwrite(name, values, photometric="minisblack", metadata=None)
        else:
            zarr = pytest.importorskip("zarr")
            shutil.rmtree(name, ignore_errors=True)
            zarr.create_array(str(name), data=values, chunks=(4, 8, 8))
        return name

    source = stored(VALUES)
    stop_job(tmp_path / "a.zarr", source=source)
    other = VALUES.copy()
    other[5, 6, 7] += 1
    if kind == "zarr":  # one chunk alone is written anew
        pytest.importorskip("zarr").open_array(str(source), mode="r+")[5, 6, 7] = other[5, 6, 7]
    else:
        source = stored(other)
    with pytest.raises(DeformError, match=r"another source, .* or the source was changed"):
        warp_store(tmp_path / "a.zarr", source)
    shutil.rmtree(tmp_path / ".a.zarr.unfinished")
    assert levels(warp_store(tmp_path / "a.zarr", source).path)[0].any()


def test_a_source_that_is_changed_while_it_is_read_gives_no_mixture(tmp_path: Path) -> None:
    np.save(tmp_path / "source.npy", VALUES)
    count = iter(range(100))

    def change(_share: float) -> None:
        if next(count) == 6:
            np.save(tmp_path / "source.npy", VALUES[::-1])

    with pytest.raises(DeformError, match="was changed while it was read"):
        warp_store(tmp_path / "a.zarr", tmp_path / "source.npy", progress=change)
    assert not (tmp_path / "a.zarr").exists()


@pytest.mark.parametrize("at", [0, 3, 40])
def test_a_full_disk_is_one_sentence_and_the_job_goes_on_later(
    at: int, known: list[np.ndarray], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    zarr = pytest.importorskip("zarr")
    count, original = iter(range(10**6)), zarr.storage.LocalStore.set

    async def full(self: Any, *args: Any, **kwargs: Any) -> None:
        if next(count) >= at:
            raise OSError(errno.ENOSPC, "No space left on device")
        await original(self, *args, **kwargs)

    monkeypatch.setattr(zarr.storage.LocalStore, "set", full)
    if at < 20:
        with pytest.raises(VolumeFileError, match=r"a\.zarr: was not written, the disk .* full; finished blocks stay"):
            warp_store(tmp_path / "a.zarr")
        assert not (tmp_path / "a.zarr").exists()
    monkeypatch.undo()
    for mine, theirs in zip(levels(warp_store(tmp_path / "a.zarr").path), known, strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("what", ["a file", "a link"])
def test_what_has_the_name_of_the_folder_is_not_touched(what: str, tmp_path: Path) -> None:
    folder, other = tmp_path / ".a.zarr.unfinished", tmp_path / "mine"
    other.mkdir()
    (other / "precious.txt").write_text("mine", encoding="utf-8")
    if what == "a link":
        folder.symlink_to(other)
    else:
        folder.write_text("mine", encoding="utf-8")
    for overwrite in (False, True):
        with pytest.raises(DeformError, match=r"it is not a plain folder\. Remove"):
            warp_store(tmp_path / "a.zarr", overwrite=overwrite)
    assert (other / "precious.txt").read_text(encoding="utf-8") == "mine"

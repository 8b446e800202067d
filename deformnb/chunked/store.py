"""The unfinished result of a job next to its target: which blocks are done, and of which job.

A job writes into the folder ``.NAME.unfinished`` next to its target: the pyramid, ``job.json`` with a checksum of
everything that determines its voxels, and ``done.txt`` with a line for each finished block: level, number, checksum of
the stored data, and a checksum of the line itself. A block is on the disk before its line is.

An interrupted job resumes from there and verifies everything: the content of the folder is removed unless it is a block
with the checksum of its line, or a document of metadata as this job writes it; missing blocks are then computed again.
A job of another source, deformation or grid is refused. At the end the pyramid gets the name of the target.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from deformnb._jax import jax
from deformnb.chunked.blocks import BlockWarp
from deformnb.errors import DeformError
from deformnb.io.files import zarr_copy
from deformnb.io.files.atomic import atomic_write, check_target, flush_folder, publish_folder, try_lock, write_error
from deformnb.io.files.errors import fail, printable
from deformnb.io.volumes import ome_zarr
from deformnb.rbf.fields import AbstractField
from deformnb.volume.volume import Grid

_FORM = 2  # of the lines and of the source's identity


def fingerprint(job: BlockWarp, about: dict[str, Any]) -> str:
    """A checksum of all that decides on the voxels of a result and on how they are stored."""
    digest = hashlib.sha256(job.source.fingerprint.encode())
    digest.update(_field_digest(job.field, job.output))
    text = [job.output, job.method, job.fill, job.background, job.blocks.block, sorted(about.items()), _FORM]
    digest.update(repr(text).encode())
    return digest.hexdigest()


# Nodes along each axis of the output at which a field that JAX does not know is compared.
_NODES = 12


def _field_digest(field: AbstractField, output: Grid) -> bytes:
    leaves, structure = jax.tree_util.tree_flatten(field)
    digest = hashlib.sha256()
    if all(isinstance(leaf, np.ndarray | jax.Array | int | float) for leaf in leaves):
        digest.update(str(structure).encode())
    else:  # made by another program
        lines = [np.linspace(0, n - 1, _NODES) for n in output.shape[::-1]]
        index = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1)
        leaves = [field.displacement(output.index_to_point(index))]
    for leaf in leaves:
        array = np.asarray(leaf)
        digest.update(f"{array.shape} {array.dtype}".encode() + array.tobytes())
    return digest.digest()


class UnfinishedStore:
    """A pyramid that is being written.

    Parameters
    ----------
    folder : of the unfinished job.
    mark : the checksum of the job.
    arrays : the levels as Zarr arrays, the finest first.
    done : (level, block) of finished blocks.
    damaged : how many blocks were noted as finished, and were not there as they had been written.
    """

    def __init__(
        self, folder: Path, mark: str, arrays: list[Any], done: set[tuple[int, int]], damaged: int = 0
    ) -> None:
        self.arrays, self.done, self.damaged = arrays, done, damaged
        self._pyramid, self._mark = folder / _PYRAMID, mark
        self._log = (folder / _DONE).open("a", encoding="ascii")
        self._known = {folder.parent}  # folders whose own names are on the disk

    def mark_finished(self, level: int, block: int) -> None:
        """Note that a block is written, once it is on the disk."""
        file = self._pyramid / _chunk_file(self.arrays[level], level, block)
        text = f"{level} {block} {self._persist(file)}"
        self._log.write(f"{text} {_checksum(self._mark, text)}\n")
        self._log.flush()
        os.fsync(self._log.fileno())
        self.done.add((level, block))

    def _persist(self, file: Path) -> str:
        """Flush a file, and its name, to the disk; returns the checksum of its bytes."""
        try:
            with file.open("rb") as stored:
                found = hashlib.file_digest(stored, "sha256").hexdigest()
                os.fsync(stored.fileno())
        except FileNotFoundError:  # missing chunks read as the fill value
            return _EMPTY
        flush_folder(file.parent)
        for folder in file.parents[1:]:
            if folder in self._known:
                break
            flush_folder(folder)
            self._known.add(folder)
        return found

    def close(self) -> None:
        """Close the list of finished blocks."""
        self._log.close()


_PYRAMID, _DONE, _JOB, _LOCK, _FRESH = "pyramid", "done.txt", "job.json", "lock", "metadata"
_EMPTY = "empty"  # in the place of a checksum: nothing is stored of a block of fill values
_LONGEST = 1 << 16  # bytes of job.json: it has some hundred


@contextmanager
def unfinished_store(target: Path, mark: str, *, overwrite: bool, **pyramid: Any) -> Iterator[UnfinishedStore]:
    """The store of a job: that of an earlier run of the same job, or a new one. It is published at the end of the
    block; after an exception it stays for the next run.

    Parameters
    ----------
    target : the folder to be written in the end.
    mark : the checksum of the job.
    overwrite : whether a pyramid at the target, and the unfinished one of another job, may be replaced.
    pyramid : arguments of :func:`~deformnb.io.volumes.ome_zarr.create_pyramid`.

    Raises
    ------
    DeformError
        If another process is writing it, an unfinished job of something else is there, or the folder is damaged
        so that its job cannot be identified.
    VolumeFileError
        If the disk is full or cannot be written.
    """
    target = check_target(target, overwrite=overwrite, folder_marks=zarr_copy.MARKS)
    folder = _partial_path(target)
    try:
        with _lock(folder, target):
            store = _begin(folder, target, mark, overwrite, pyramid)
            try:
                yield store
            finally:
                store.close()
            publish_folder(folder / _PYRAMID, target, overwrite=overwrite)
            shutil.rmtree(folder, ignore_errors=True)
    except OSError as error:
        if isinstance(error, ValueError):  # a DeformError that is also an ImportError or the like
            raise
        raise write_error(
            target, error, f"finished blocks stay in {printable(folder.name)}, and the same call resumes from there"
        ) from error


@contextmanager
def _lock(folder: Path, target: Path) -> Iterator[None]:
    """The folder of a job, made if it is missing, while no other process may write into it."""
    if folder.is_symlink() or (folder.exists() and not folder.is_dir()):
        raise _damage_error(folder, "it is not a plain folder")
    folder.mkdir(exist_ok=True)
    lock = _open_lock(folder)
    if lock is None:
        raise _damage_error(folder, f"its {_LOCK} is no file")
    try:
        if try_lock(lock) is False:
            raise fail(target, "another process is writing it at this moment; wait for that to end.")
        yield
    finally:
        os.close(lock)


def _open_lock(folder: Path) -> int | None:
    """The lock of a folder as a descriptor; None if something else has its name, such as a pipe."""
    place = folder / _LOCK
    if os.path.lexists(place) and not _is_plain(place):
        return None
    return os.open(place, os.O_CREAT | os.O_RDWR, 0o600)


def discard_unfinished(target: Path) -> None:
    """Remove the files that a stopped job has left next to its target, unless another process is writing it."""
    folder = _partial_path(target)
    with suppress(OSError):
        if folder.is_symlink() or not folder.is_dir():
            return
        lock = _open_lock(folder)
        try:
            if lock is None or try_lock(lock) is not False:
                shutil.rmtree(folder, ignore_errors=True)
        finally:
            if lock is not None:
                os.close(lock)


def _partial_path(target: Path) -> Path:
    return target.with_name(f".{target.name}.unfinished")


def _damage_error(folder: Path, why: str) -> DeformError:
    return DeformError(
        f"{printable(folder.name)}, the unfinished result of an earlier call, is damaged: {why}. Remove "
        "that folder and call again, which computes all blocks."
    )


def _is_plain(place: Path) -> bool:
    """Check whether a name is that of a file, and not of a link, a pipe or a folder, without opening it."""
    return stat.S_ISREG(place.lstat().st_mode)


def _begin(folder: Path, target: Path, mark: str, overwrite: bool, pyramid: dict[str, Any]) -> UnfinishedStore:
    """The store of the job in a folder, if it is this job, or a new one."""
    try:
        known = _job_of(folder)
    except (OSError, ValueError) as error:
        if not overwrite:
            raise _damage_error(folder, f"its {_JOB} does not identify the job ({printable(error, 100)})") from error
        known = None
    if known == mark:
        return _resume(folder, mark, pyramid)
    if known is not None and not overwrite:
        raise DeformError(
            f"{printable(folder.name)} holds the unfinished result of another source, deformation or grid, "
            "or the source was changed since; remove that folder, choose another target, or allow "
            "overwriting (overwrite=True, --force)."
        )
    for entry in (_JOB, _DONE, _PYRAMID, _FRESH):  # the job first: without it the rest is nothing
        _remove(folder / entry)
    arrays = ome_zarr.create_pyramid(folder / _PYRAMID, **pyramid)
    for place in (*sorted((folder / _PYRAMID).rglob("*")), folder / _PYRAMID):
        _flush(place)
    (folder / _DONE).touch()
    with atomic_write(folder / _JOB) as file:  # last: all else is there then
        file.write(json.dumps({"fingerprint": mark, "target": target.name}).encode())
    return UnfinishedStore(folder, mark, arrays, set())


def _job_of(folder: Path) -> str | None:
    """The checksum of the job in a folder; None if none has begun there.

    Raises
    ------
    ValueError, OSError
        If the file with the checksum is damaged.
    """
    job = folder / _JOB
    if not os.path.lexists(job):
        if os.path.lexists(folder / _DONE) and (not _is_plain(folder / _DONE) or (folder / _DONE).stat().st_size):
            raise ValueError("it is missing, and blocks are finished")
        return None
    if not _is_plain(job) or job.stat().st_size > _LONGEST:
        raise ValueError("it is no file, or far too long")
    try:
        found = json.loads(job.read_bytes())
    except RecursionError:
        raise ValueError("it is nested too deep") from None
    mark = found.get("fingerprint") if isinstance(found, dict) else None
    if not isinstance(mark, str):
        raise ValueError("it names no job")
    return mark


def _resume(folder: Path, mark: str, pyramid: dict[str, Any]) -> UnfinishedStore:
    """The store of an earlier run of the same job, with those of its blocks that are as they were written."""
    if os.path.lexists(folder / _DONE) and not _is_plain(folder / _DONE):
        raise _damage_error(folder, f"its {_DONE} is no file")
    root, fresh = folder / _PYRAMID, folder / _FRESH
    if root.is_symlink() or not root.is_dir():
        _remove(root)
        root.mkdir()
    _remove(fresh)
    arrays = ome_zarr.create_pyramid(fresh, **pyramid)
    noted = _read_finished_blocks(folder, mark)
    files = {
        _chunk_file(arrays[level], level, block): (level, block)
        for level, block in noted
        if level < len(arrays) and block < _count(arrays[level])
    }
    wanted = {place.relative_to(fresh).as_posix(): place for place in fresh.rglob("*") if place.is_file()}
    kept = {files[name] for name in files if noted[files[name]] == _EMPTY and not os.path.lexists(root / name)}
    kept |= {files[name] for name in _sweep(root, wanted, {name: noted[files[name]] for name in files})}
    for name, place in wanted.items():
        if not (root / name).exists():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            place.replace(root / name)
            _flush(root / name)
    _remove(fresh)
    group = ome_zarr.zarr_package().open_group(store=str(root), mode="r+")
    return UnfinishedStore(folder, mark, [group[str(k)] for k in range(len(arrays))], kept, len(noted) - len(kept))


def _sweep(root: Path, metadata: dict[str, Path], checksums: dict[str, str]) -> set[str]:
    """Remove all from a pyramid but metadata as given and blocks of their checksums; returns the names of those."""
    found = set[str]()
    waiting = [root]
    while waiting:
        with os.scandir(waiting.pop()) as entries:
            for entry in entries:
                place = Path(entry.path)
                name = place.relative_to(root).as_posix()
                if entry.is_dir(follow_symlinks=False) and name not in metadata and name not in checksums:
                    waiting.append(place)
                elif not entry.is_file(follow_symlinks=False):
                    _remove(place)
                elif name in checksums and _digest(place) == checksums[name]:
                    found.add(name)
                elif name not in metadata or place.read_bytes() != metadata[name].read_bytes():
                    _remove(place)
    return found


def _remove(place: Path) -> None:
    """Remove a file, a link, a pipe, or a folder with all that is in it."""
    if place.is_dir() and not place.is_symlink():
        shutil.rmtree(place)
    else:
        place.unlink(missing_ok=True)


def _digest(file: Path) -> str:
    with file.open("rb") as stored:
        return hashlib.file_digest(stored, "sha256").hexdigest()


def _flush(place: Path) -> None:
    """Flush a file or a folder, and its name, to the disk."""
    if place.is_dir():
        flush_folder(place)
    else:
        with place.open("rb") as file:
            os.fsync(file.fileno())
    flush_folder(place.parent)


def _count(array: Any) -> int:
    return math.prod(_counts(array))


def _counts(array: Any) -> tuple[int, ...]:
    return tuple(-(-n // size) for n, size in zip(array.shape, array.chunks, strict=True))


def _chunk_file(array: Any, level: int, block: int) -> str:
    """The name within a pyramid of the file of a block, which is one chunk."""
    at = tuple(int(k) for k in np.unravel_index(block, _counts(array)))
    return f"{level}/{array.metadata.encode_chunk_key(at)}"


def _checksum(mark: str, text: str) -> str:
    """The checksum of a line: one of another job, or that was changed or cut short, has another."""
    return hashlib.sha256(f"{mark} {text}".encode()).hexdigest()[:16]


def _read_finished_blocks(folder: Path, mark: str) -> dict[tuple[int, int], str]:
    """The checksums of finished blocks by level and number; lines that are damaged count as not there."""
    done = dict[tuple[int, int], str]()
    try:
        lines = (folder / _DONE).read_text(encoding="ascii", errors="replace").splitlines()
    except FileNotFoundError:
        return done
    for line in lines:
        text, _, proof = line.rpartition(" ")
        words = text.split(" ")
        if proof == _checksum(mark, text) and len(words) == 3:
            done[int(words[0]), int(words[1])] = words[2]
    # A line that a killed process has begun would merge with the next; so the list is written again.
    with atomic_write(folder / _DONE) as file:
        for (level, block), stored in done.items():
            text = f"{level} {block} {stored}"
            file.write(f"{text} {_checksum(mark, text)}\n".encode())
    return done

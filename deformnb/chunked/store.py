"""The unfinished result of a job beside its target: which blocks are done, and of which job.

A job writes into the folder ``.NAME.unfinished`` beside its target: the pyramid, ``job.json`` with a checksum of all
that decides on its voxels, and ``done.txt`` with a line for each finished block. A job that was interrupted goes on
from there; one of another source, deformation or grid is refused. At the end the pyramid gets the name of the target.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from deformnb._jax import jax
from deformnb.chunked.blocks import BlockWarp
from deformnb.errors import DeformError
from deformnb.io import ome_zarr
from deformnb.io.atomic import check_target, publish_folder, try_lock
from deformnb.io.headers import fail, shown
from deformnb.rbf.fields import AbstractField
from deformnb.volume.volume import Grid

_FORM = 1


def fingerprint(job: BlockWarp, about: dict[str, Any]) -> str:
    """A checksum of all that decides on the voxels of a result and on how they are stored."""
    digest = hashlib.sha256(job.source.fingerprint.encode())
    digest.update(_of_field(job.field, job.output))
    text = [job.output, job.method, job.fill, job.background, job.blocks.block, sorted(about.items()), _FORM]
    digest.update(repr(text).encode())
    return digest.hexdigest()


# Nodes along each axis of the output at which a field that JAX does not know is compared.
_NODES = 12


def _of_field(field: AbstractField, output: Grid) -> bytes:
    leaves, structure = jax.tree_util.tree_flatten(field)
    digest = hashlib.sha256()
    if all(isinstance(leaf, np.ndarray | jax.Array | int | float) for leaf in leaves):
        digest.update(str(structure).encode())
    else:  # of somebody's own making
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
    arrays : the levels as Zarr arrays, the finest first.
    done : (level, block) of what is finished.
    """

    def __init__(self, folder: Path, arrays: list[Any], done: set[tuple[int, int]]) -> None:
        self.arrays, self.done = arrays, done
        self._folder = folder
        self._log = (folder / "done.txt").open("a", encoding="ascii")

    def finished(self, level: int, block: int) -> None:
        """Note that a block is written."""
        self._log.write(f"{level} {block}\n")
        self._log.flush()
        self.done.add((level, block))

    def close(self) -> None:
        """Close the list of finished blocks."""
        self._log.close()


@contextmanager
def unfinished_store(target: Path, mark: str, *, overwrite: bool, **pyramid: Any) -> Iterator[UnfinishedStore]:
    """The store of a job: that of an earlier run of the same job, or a new one. It is published at the end of the
    block; after an exception it stays for the next run.

    Parameters
    ----------
    target : the folder to be written in the end.
    mark : the checksum of the job.
    overwrite : whether a pyramid at the target, and the unfinished one of another job, may be replaced.
    pyramid : arguments of :func:`~deformnb.io.ome_zarr.create_pyramid`.

    Raises
    ------
    DeformError
        If another process is writing it, or an unfinished job of something else lies there.
    """
    target = check_target(target, overwrite=overwrite, folder_marks=ome_zarr.MARKS)
    folder = _unfinished(target)
    folder.mkdir(exist_ok=True)
    lock = os.open(folder / "lock", os.O_CREAT | os.O_RDWR, 0o600)
    try:
        if try_lock(lock) is False:
            raise fail(target, "another process is writing it at this moment; wait for that to end.")
        store = _begun(folder, target, mark, overwrite, pyramid)
        try:
            yield store
        finally:
            store.close()
        publish_folder(folder / "pyramid", target, overwrite=overwrite)
        shutil.rmtree(folder, ignore_errors=True)
    finally:
        os.close(lock)


def discard_unfinished(target: Path) -> None:
    """Remove what a job that was stopped has left beside its target, unless another process is writing it."""
    folder = _unfinished(target)
    with suppress(OSError):
        lock = os.open(folder / "lock", os.O_RDWR)
        try:
            if try_lock(lock) is not False:
                shutil.rmtree(folder, ignore_errors=True)
        finally:
            os.close(lock)


def _unfinished(target: Path) -> Path:
    return target.with_name(f".{target.name}.unfinished")


def _begun(folder: Path, target: Path, mark: str, overwrite: bool, pyramid: dict[str, Any]) -> UnfinishedStore:
    job = folder / "job.json"
    known = None
    with suppress(OSError, ValueError):
        known = json.loads(job.read_bytes()).get("fingerprint")
    if known == mark:
        zarr = ome_zarr.zarr_package()
        group = zarr.open_group(store=str(folder / "pyramid"), mode="r+")
        return UnfinishedStore(folder, [group[str(k)] for k in range(len(pyramid["grids"]))], _read_done(folder))
    if known is not None and not overwrite:
        raise DeformError(f"{shown(folder.name)} holds the unfinished result of another source, deformation or grid; "
                          "remove that folder, choose another target, or allow overwriting (overwrite=True, --force).")
    for entry in ("pyramid", "done.txt", "job.json"):
        place = folder / entry
        shutil.rmtree(place) if place.is_dir() else place.unlink(missing_ok=True)
    arrays = ome_zarr.create_pyramid(folder / "pyramid", **pyramid)
    job.write_text(json.dumps({"fingerprint": mark, "target": target.name}))  # last: all else is there then
    return UnfinishedStore(folder, arrays, set())


def _read_done(folder: Path) -> set[tuple[int, int]]:
    done = set()
    with suppress(OSError):
        for line in (folder / "done.txt").read_text(encoding="ascii", errors="replace").splitlines():
            words = line.split()  # the last line may be cut short by what ended the process
            if len(words) == 2 and all(word.isdigit() for word in words):
                done.add((int(words[0]), int(words[1])))
    return done

"""Warp of volumes that are larger than memory: the :class:`~deformnb.Warper`, block by block."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from deformnb._packages import install_command
from deformnb._typing import Progress
from deformnb.checks import is_finite, short_value, warn
from deformnb.chunked import execution
from deformnb.chunked.blocks import Blocks, BlockWarp, part_shape, plan_blocks
from deformnb.chunked.sources import ChunkCache, LargeVolume, open_volume
from deformnb.chunked.store import UnfinishedStore, fingerprint, unfinished_store
from deformnb.errors import DeformError, MissingPackageError
from deformnb.io.files.memory import check_room, default_limit
from deformnb.io.files.paths import as_path
from deformnb.io.volumes import ome_zarr
from deformnb.io.volumes.ome_zarr import OmeZarrVersion
from deformnb.rbf.fields import AbstractField, HasField, as_field
from deformnb.volume.sampling import SamplingName
from deformnb.volume.volume import Grid, Volume, VolumeLike, as_output
from deformnb.warping.map_checks import fold_note
from deformnb.warping.planning import as_voxel, check_method, processors

# Default memory of all concurrent blocks: enough for two dozen of them, and little on any machine.
_MEMORY = 2**30

_UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12, "ki": 2**10, "mi": 2**20, "gi": 2**30, "ti": 2**40}


def warp(
    source: Any,
    deformation: AbstractField | HasField,
    target: Any = None,
    *,
    output: Grid | VolumeLike | None = None,
    fill: float | None = None,
    method: SamplingName | None = None,
    memory: float | str | None = None,
    client: Any = None,
    workers: int | None = None,
    chunks: Sequence[int] = ome_zarr.CHUNK_SHAPE,
    levels: int | None = None,
    version: OmeZarrVersion = "0.5",
    overwrite: bool = False,
    progress: Progress | None = None,
) -> Any:
    """The deformed volume, ``output(x) = input(x + D(x))``, computed block by block.

    Each block reads only the part of the source that its displacements can reach. The voxels are those of
    :func:`deformnb.warp`, but for a rounding of grey values by 1 where a value is at a half.

    Parameters
    ----------
    source : what :func:`open_volume` takes: a path (Zarr, OME-Zarr, HDF5, TIFF, ...), an array of dask, Zarr, h5py or
        NumPy (memory maps included), a Volume; or its result, where grid, labels or level need to be stated.
    deformation : a Deformation or a field in space.
    target : path of the OME-Zarr folder to be written, with coarser levels; None for a dask array that is computed when
        it is requested; the class :class:`~deformnb.Volume` for the result in memory.
    output : the grid of the result; default is the deformation's own, or the source's.
    fill : value of places outside the source; default is the smallest value of the source, which is read once to find
        it, until a zero turns up in a type without negative values.
    method : "nearest", "linear" or "cubic"; default is linear, and nearest for labels and bool.
    memory : bytes, or text such as "2 GB", that all blocks in work and the cached chunks of the source
        take at most together, besides the memory of the process; default is 1 GiB, or 60 % of the free memory if that
        is less.
    client : a ``dask.distributed.Client``, whose workers compute the blocks; they need the files of the source and the
        target under the same paths. Default is threads of this process.
    workers : maximum number of concurrent blocks; default is the number of processors.
    chunks : (z, y, x) of the result and of the blocks; smaller where the memory does not suffice.
    levels : resolutions to be written; by default until the longest side is at most 256 voxels.
    version : of OME-Zarr: "0.5" (Zarr 3) or "0.4" (Zarr 2).
    overwrite : whether a pyramid at the target may be replaced.
    progress : called with the finished share from 0 to 1; may raise :class:`~deformnb.errors.Cancelled`.

    Returns
    -------
    :class:`LargeVolume` of the target, a dask array, or a Volume.

    Raises
    ------
    DeformError
        If the deformation does not fit the source, or the memory suffices for no block; if an unfinished result of
        another job is next to the target.
    VolumeFileError
        If the source is damaged, or the target cannot be written.
    MissingPackageError
        Naming the extra, if dask, distributed, zarr or h5py is needed and not installed.

    Notes
    -----
    The result gets its name when it is complete. A job that was interrupted, cancelled or killed resumes when it is
    called again: finished blocks are noted in a folder next to the target, with a checksum of each block, and only
    blocks that were in work, or have changed since they were written, are computed again. A source that was changed
    meanwhile is refused: of files by their times, sizes and samples of the voxels, of arrays in memory by all voxels,
    of others by samples.

    Examples
    --------
    >>> import tempfile
    >>> from deformnb.rbf.fields import Affine
    >>> shift = Affine(np.eye(3), np.array([1.0, 0.0, 0.0]))
    >>> target = Path(tempfile.mkdtemp()) / "moved.zarr"
    >>> moved = warp(np.arange(24, dtype=np.uint8).reshape(2, 3, 4), shift, target)
    >>> np.asarray(moved)[0, 0].tolist()
    [1, 2, 3, 0]
    """
    volume = open_volume(source)
    field = as_field(deformation, volume.finest_grid)
    if field.dim != 3:
        raise DeformError("a volume needs a field in space; extrude the field of a plane first.")
    own = getattr(deformation, "output", None)
    grid = as_output(output if output is not None else own if isinstance(own, Grid) else volume.grid, volume.grid)
    method = check_method(method, discrete=volume.discrete)
    allowed = execution.count_threads(client) if client is not None else processors()
    if workers is not None:
        if isinstance(workers, bool) or not isinstance(workers, int | np.integer) or workers < 1:
            raise DeformError(f"workers must be a whole number from 1 on, got {short_value(workers)}.")
        allowed = min(allowed, int(workers)) if client is not None else int(workers)
    limit = parse_bytes(memory)
    block = _check_chunk_shape(chunks)
    if target is Volume:
        _check_result(volume, grid)
    elif target is not None:
        target = as_path(target)
    checked = None if progress is None else lambda _share: progress(0.0)  # it may end the search
    background = volume.smallest(checked) if fill is None else float(fill)
    voxel = as_voxel(background if fill is None else fill, volume.dtype)
    processes = len(client.nthreads()) if client is not None else 1
    job, at_once = plan_blocks(
        volume,
        field,
        grid,
        method=method,
        fill=float(voxel),
        background=background,
        block=block,
        memory=limit,
        workers=allowed,
        processes=processes,
        progress=progress,
    )
    cautions = _cautions(deformation, volume, field, grid)
    warn(cautions)
    if target is None:
        return _lazy(job)
    if target is Volume:
        made = _warp_in_memory(job, at_once, client, progress)
        return replace(made, notes=(*made.notes, *cautions))
    notes = _write(job, at_once, target, client, progress, overwrite=overwrite, levels=levels, version=version)
    result = open_volume(target)
    return replace(result, notes=(*result.notes, *notes, *cautions))


def _cautions(deformation: Any, volume: LargeVolume, field: AbstractField, grid: Grid) -> tuple[str, ...]:
    """Probable mistakes of a document, and folds of its map anywhere: no voxel is looked at.

    A document that was made on one resolution of a pyramid belongs to all of them.
    """
    known = getattr(deformation, "cautions", None)
    levels = [volume.finest_grid, *volume.levels]
    own = next((level for level in levels if known and not deformation.difference(level)), levels[0])
    fold = fold_note(None, field, grid)
    return (*(known(own) if known else ()), *([fold] if fold else []))


def parse_bytes(memory: float | str | None) -> int:
    """A number of bytes from a number or a text: "500 MB", "2 GiB"; the default for None.

    Examples
    --------
    >>> parse_bytes("2 GB"), parse_bytes("1.5GiB")
    (2000000000, 1610612736)
    """
    if memory is None:
        return min(_MEMORY, default_limit())
    if isinstance(memory, str):
        found = re.fullmatch(r"\s*([0-9]{1,15}(?:\.[0-9]{1,9})?)\s*([kmgt]?i?)b?\s*", memory.lower())
        if found and found[2] in _UNITS:
            return int(float(found[1]) * _UNITS[found[2]])
    elif not isinstance(memory, bool) and is_finite(memory) and memory > 0:
        return int(memory)
    raise DeformError(f'memory is a number of bytes or a text such as "2 GB", got {short_value(memory)}.')


def _check_chunk_shape(chunks: Sequence[int]) -> tuple[int, int, int]:
    if not (
        isinstance(chunks, Sequence)
        and len(chunks) == 3
        and all(isinstance(n, int | np.integer) and not isinstance(n, bool) and n >= 1 for n in chunks)
    ):
        raise DeformError(f"chunks are three whole numbers (z, y, x) from 1 on, got {short_value(chunks)}.")
    return int(chunks[0]), int(chunks[1]), int(chunks[2])


def _check_result(volume: LargeVolume, grid: Grid) -> None:
    one = Volume(np.zeros((1, 1, 1), volume.dtype), Grid((1, 1, 1)))
    check_room(one, grid)


def _lazy(job: BlockWarp) -> Any:
    """The result as an array of dask, a task for each block."""
    try:
        import dask.array
        from dask.delayed import delayed
    except ImportError as error:
        raise MissingPackageError(
            f"arrays of dask need the package dask, which is not installed: {install_command('large')}; "
            "or name a target"
        ) from error
    # The array may exist long after it was computed: it holds no chunks of the source.
    shared = delayed(replace(job, cache=ChunkCache(job.source, 0)), traverse=False)
    made = [
        dask.array.from_delayed(delayed(_block)(shared, k), part_shape(job.blocks.part(k)), job.source.dtype)
        for k in range(len(job.blocks))
    ]
    nz, ny, nx = job.blocks.counts
    nested = [[[made[(z * ny + y) * nx + x] for x in range(nx)] for y in range(ny)] for z in range(nz)]
    return dask.array.block(nested)


def _block(job: BlockWarp, number: int) -> Any:
    return job(number)


def _warp_in_memory(job: BlockWarp, at_once: int, client: Any, progress: Progress | None) -> Volume:
    if client is not None:
        raise DeformError("a result in memory is computed by this process; name a target for the cluster to write.")
    out = np.empty(job.output.shape, job.source.dtype)

    def work(number: int) -> None:
        out[job.blocks.part(number)] = job(number)

    for done, _ in enumerate(execution.run_on_threads(work, range(len(job.blocks)), at_once)):
        if progress is not None:
            progress((done + 1) / len(job.blocks))
    return Volume(out, job.output, job.source.name, job.source.is_labels, job.source.notes)


@dataclass(frozen=True)
class _WarpedBlock:
    """Computes a block of the finest level and writes it."""

    job: BlockWarp
    array: Any

    def __call__(self, number: int) -> None:
        self.array[self.job.blocks.part(number)] = self.job(number)  # of fill values alone nothing is stored


@dataclass(frozen=True)
class _HalvedBlock:
    """Computes a block of a coarser level from the level before and writes it."""

    finer: Any
    array: Any
    blocks: Blocks
    discrete: bool

    def __call__(self, number: int) -> None:
        part = self.blocks.part(number)
        values = self.finer[
            tuple(
                slice(2 * s.start, 2 * s.stop) if n > 1 else slice(None)
                for s, n in zip(part, self.finer.shape, strict=True)
            )
        ]
        self.array[part] = ome_zarr.halve(np.asarray(values), discrete=self.discrete)


def _write(
    job: BlockWarp,
    at_once: int,
    target: Path,
    client: Any,
    progress: Progress | None,
    *,
    overwrite: bool,
    levels: int | None,
    version: str,
) -> tuple[str, ...]:
    """Write the pyramid; returns remarks on the files of an earlier run."""
    source = job.source
    grids = ome_zarr.level_grids(job.output, levels)
    about: dict[str, Any] = {"version": version, "levels": len(grids), "name": source.name}
    with unfinished_store(
        target,
        fingerprint(job, about),
        overwrite=overwrite,
        grids=grids,
        dtype=source.dtype,
        name=source.name,
        is_labels=source.is_labels,
        fill=source.dtype.type(job.fill).item(),
        chunks=job.blocks.block,
        version=version,
    ) as store:
        steps = list(_levels(job, store))
        total = sum(len(blocks) for _, blocks in steps)
        for level, (work, blocks) in enumerate(steps):
            missing = [k for k in range(len(blocks)) if (level, k) not in store.done]
            for number in (
                execution.run_on_threads(work, missing, at_once)
                if client is None
                else execution.run_on_cluster(client, work, missing, at_once, 0 if level else job.nbytes)
            ):
                store.mark_finished(level, number)
                if progress is not None:
                    progress(len(store.done) / total)
        if source.current_fingerprint() != source.fingerprint:
            raise DeformError(
                f"the source of {short_value(target.name)} was changed while it was read, so that the "
                "result is a mixture and was not taken; call again, with overwrite=True."
            )
        if not store.damaged:
            return ()
        return (f"{store.damaged} finished blocks of an earlier run were missing or damaged and were computed again",)


def _levels(job: BlockWarp, store: UnfinishedStore) -> Iterator[tuple[Callable[[int], None], Blocks]]:
    yield _WarpedBlock(job, store.arrays[0]), job.blocks
    for finer, array in zip(store.arrays, store.arrays[1:], strict=False):
        blocks = Blocks(array.shape, array.chunks)
        yield _HalvedBlock(finer, array, blocks, job.source.discrete), blocks

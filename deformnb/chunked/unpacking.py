"""Files that cannot be read in parts, such as packed NIfTI and NRRD, as Zarr: slice by slice, with little memory."""

from __future__ import annotations

import os
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress, Spacing
from deformnb.chunked.sources import is_partly_readable
from deformnb.io.files import zarr_copy
from deformnb.io.files.atomic import atomic_folder
from deformnb.io.files.errors import Damage, fail
from deformnb.io.files.memory import default_limit
from deformnb.io.volumes import ome_zarr
from deformnb.io.volumes.formats import existing_path, plain_name, read_any_header
from deformnb.io.volumes.headers import Header
from deformnb.volume.volume import as_spacing

_SLABS = 2**27  # bytes of the slices that are in memory together


def needs_unpacking(path: str | os.PathLike[str]) -> bool:
    """Check whether a volume file takes more memory than there is, and cannot be read in parts."""
    place = Path(str(path).partition("::")[0])
    if is_partly_readable(place) or not place.exists():
        return False
    header = read_any_header(place)[1]
    return header.layout.is_single and _bytes(header) > default_limit()


def unpack(
    path: str | os.PathLike[str],
    target: str | os.PathLike[str],
    *,
    spacing: Spacing | None = None,
    is_labels: bool | None = None,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> None:
    """Write a volume file of any kind as OME-Zarr of one level, slice by slice, so that it can be read in parts.

    Parameters
    ----------
    path : a file of one channel and one moment, or a folder of slices.
    target : of the folder, ends in .zarr.
    spacing : (x, y, z) instead of the file's.
    is_labels : voxels are names of regions; by default as in the file.
    overwrite : whether a pyramid at the target may be replaced.
    progress : receives the share done, 0 to 1; may raise Cancelled.

    Raises
    ------
    VolumeFileError
        If the file is missing, damaged or no single volume, or the target cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import deformnb as dn
    >>> folder = Path(tempfile.mkdtemp())
    >>> dn.write_volume(dn.Volume.from_array(np.eye(4)), folder / "a.nii.gz")
    >>> unpack(folder / "a.nii.gz", folder / "a.zarr")
    >>> dn.chunked.open_volume(folder / "a.zarr").shape
    (1, 4, 4)
    """
    place = existing_path(path)
    with Damage(place, "name a smaller file"):
        kind, header = read_any_header(place)
        if not header.layout.is_single or header.transposed:
            raise fail(
                place,
                "only a volume of one channel and one moment, whose slices follow each other, is written "
                f"as Zarr slice by slice, and this file holds {header.layout}.",
            )
        grid, _ = header.grid(None if spacing is None else as_spacing(spacing))
        depth = max(1, min(ome_zarr.CHUNK_SHAPE[0], _SLABS * header.shape[0] // max(1, _bytes(header))))
        with atomic_folder(target, overwrite=overwrite, folder_marks=zarr_copy.MARKS) as folder:
            [array] = ome_zarr.create_pyramid(
                folder,
                [grid],
                header.loaded_dtype.newbyteorder("="),
                name=plain_name(place, kind),
                is_labels=bool(header.is_labels if is_labels is None else is_labels),
                chunks=(depth, *ome_zarr.CHUNK_SHAPE[1:]),
            )
            _write_slices(header, array, depth, progress)


def _write_slices(header: Header, array: Any, depth: int, progress: Progress | None) -> None:
    held, start, total = list[NDArray[Any]](), 0, header.shape[0]
    with closing(header.blocks()) as blocks:  # type: ignore[type-var]  # generators can be closed
        for block in blocks:
            for piece in header.scaled(block):
                held.append(piece)
                if len(held) == depth or start + len(held) == total:
                    array[start : start + len(held)] = np.stack(held)
                    start += len(held)
                    held.clear()
                    if progress is not None:
                        progress(start / total)


def _bytes(header: Header) -> int:
    return int(np.prod(header.shape, dtype=object)) * header.loaded_dtype.itemsize + header.working_bytes

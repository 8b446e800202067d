"""Displacement fields as images of vectors: NRRD, NIfTI and MetaImage, read as volumes are, written by SimpleITK.

ITK's components are x, y and z in LPS coordinates for all directions of the voxels, and so they are stored in NRRD
and MetaImage. NIfTI stores them along its fifth axis; with the intent code 1007 (vector), which ITK and ANTs write,
they are LPS as well, with 1006 (displacement vector) RAS as its axes are, and ITK turns them round.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.checks import LARGEST_COORDINATE, optional_package
from deformnb.errors import VolumeFileError
from deformnb.interop.sitk_transforms import image_of_vectors
from deformnb.io.files.atomic import atomic_write
from deformnb.io.files.errors import Damage, fail, human_bytes, printable
from deformnb.io.files.memory import available_memory
from deformnb.io.volumes import metaimage, nifti, nrrd
from deformnb.io.volumes.headers import Header
from deformnb.rbf.fields import AbstractField, DisplacementField
from deformnb.volume.volume import Grid

_COMPONENTS = 3
_HEAD = 512  # bytes at the start of a file: the first line of a text, or more
_NOTE = 79  # characters of the description in a NIfTI header


_READERS: dict[str, Callable[[Path], Header]] = {
    ".nrrd": nrrd.read_header,
    ".nhdr": nrrd.read_header,
    ".mha": metaimage.read_header,
    ".mhd": metaimage.read_header,
    ".nii": nifti.read_header,
    ".gz": nifti.read_header,
}
"""Readers of headers by the last suffix of a file."""


def read_displacement_image(path: Path) -> DisplacementField:
    """The field of an image of vectors, which the readers of volumes read; elastix names such files as well.

    Raises
    ------
    VolumeFileError
        If the file is no image of three axes and three components, is damaged or cut short, holds values that are not
        finite or longer than any displacement, or takes more memory than there is.
    """
    read = _READERS.get(path.suffix.lower())
    if read is None:
        raise fail(path, f"an image of displacements ends with one of {', '.join(_READERS)}.")
    header = read(path)
    layout = header.layout
    if layout.frames != 1 or layout.channels != _COMPONENTS or layout.kind != "channels" or header.transposed:
        raise fail(path, f"a displacement field has three axes and three components, and this image holds {layout}.")
    grid, _ = header.grid()
    need = grid.size * _COMPONENTS * 8
    if need > available_memory() // 2:
        raise fail(
            path,
            f"its {' x '.join(map(str, grid.shape[::-1]))} vectors take {human_bytes(need)}, more than "
            "half of the memory that is free.",
        )
    values = _vectors(header)
    if path.suffix.lower() in (".nii", ".gz") and nifti.has_ras_vectors(path):
        values[..., :2] *= -1
    return check_displacements(path, values, grid)


def check_displacements(path: Path, values: NDArray[Any], grid: Grid) -> DisplacementField:
    """The field of vectors (nz, ny, nx, 3) that a file holds, refused where they are no displacements."""
    # The smaller and larger of all would be NaN if one is; no mask of all is needed.
    longest = max(abs(float(values.min())), abs(float(values.max())))
    if not math.isfinite(longest):
        raise fail(path, "it holds displacements that are not finite.")
    if longest > LARGEST_COORDINATE:
        raise fail(
            path, f"it holds a displacement of {longest:g}, and places are below {LARGEST_COORDINATE:g}; it is damaged."
        )
    return DisplacementField(values, grid)


def _vectors(header: Header) -> NDArray[Any]:
    """Components [z, y, x, component] in a floating type: blocks hold whole slices, of one component or of all."""
    dtype = np.result_type(header.loaded_dtype, np.float32)
    nz = header.shape[0]
    out, done = np.empty((*header.shape, _COMPONENTS), dtype), 0
    with closing(header.blocks()) as blocks:  # type: ignore[type-var]  # generators can be closed
        for block in blocks:
            part = header.scaled(block)
            if header.layout.interleaved:
                out[done : done + len(part)] = part
            else:
                for k, one in enumerate(part, done):
                    out[k % nz, :, :, k // nz] = one
            done += len(part)
    return out


def to_itk_image(sitk: Any, field: DisplacementField) -> Any:
    """An image of vectors of SimpleITK."""
    assert isinstance(field.lattice, Grid)
    return image_of_vectors(sitk, np.asarray(field.values), field.lattice)


def read_displacements(path: Path, _grid: Grid | None) -> AbstractField:
    """The field of an image of vectors."""
    return read_displacement_image(path)


def write_displacements(
    field: AbstractField, path: Path, grid: Grid, remark: str, overwrite: bool, _progress: Progress | None
) -> None:
    """Write the displacements at the voxels of a grid, float32; the remark is in the header (of NIfTI its start)."""
    sitk = optional_package("SimpleITK")
    if path.suffix.lower() in (".nhdr", ".mhd"):
        whole = ".nrrd" if path.suffix.lower() == ".nhdr" else ".mha"
        raise fail(path, f"a transform is one file; write it as {whole}.")
    image = to_itk_image(sitk, DisplacementField(field.sample_on_grid(grid), grid))
    image.SetMetaData("ITK_FileNotes", remark[:_NOTE])
    image.SetMetaData("deformnb_transform", remark)
    write_by_name(
        path, lambda file: sitk.WriteImage(image, file, True), overwrite=overwrite, check=read_displacement_image
    )


def write_by_name(
    path: Path,
    write: Callable[[str], None],
    *,
    overwrite: bool,
    head: Callable[[bytes], bytes] | None = None,
    longest: int | None = None,
    check: Callable[[Path], Any] | None = None,
) -> None:
    """Write by a program that takes the name of a file, and take its place as a whole.

    Parameters
    ----------
    check : reads the file and raises an error where it is cut short: ITK does not notice a full disk in NIfTI, nor in
        the last bytes of a compressed NRRD.
    head : decoder of the first bytes; the first line is among them.
    longest : bytes of a text that is not refused.
    """
    suffix = "".join(path.suffixes[-2:]) if path.name.lower().endswith(".nii.gz") else path.suffix
    with tempfile.TemporaryDirectory(prefix="deformnb-") as folder:
        made = Path(folder) / f"transform{suffix.lower()}"
        try:
            write(str(made))
        except RuntimeError as error:
            raise fail(path, f"ITK cannot write it ({reason(error)}).") from None
        try:
            size = made.stat().st_size
            if check is not None:
                with Damage(made, "write it on a coarser grid"):
                    check(made)
        except (VolumeFileError, OSError) as error:
            raise fail(
                path,
                f"was not written whole, as on a full disk: {human_bytes(shutil.disk_usage(folder).free)} are free in "
                f"{printable(tempfile.gettempdir())}, where it is made; an older file of this name is untouched.",
            ) from error
        if longest is not None and size > longest:
            raise fail(
                path,
                f"a text of {human_bytes(size)} is too long for a transform; write it as .h5, or on a coarser grid.",
            )
        with atomic_write(path, overwrite=overwrite) as stream, made.open("rb") as source:
            if head is not None:
                stream.write(head(source.read(_HEAD)))
            shutil.copyfileobj(source, stream)


def reason(error: RuntimeError) -> str:
    """The last line of ITK's message, which names the cause."""
    lines: Sequence[str] = [line.strip() for line in str(error).splitlines() if line.strip()]
    return printable(lines[-1] if lines else "no reason given", 200)

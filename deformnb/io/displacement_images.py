"""Displacement fields as images of vectors: NRRD, NIfTI and MetaImage by SimpleITK.

ITK's components are x, y and z in LPS coordinates whatever the directions of the voxels, and so they are stored in NRRD
and MetaImage. NIfTI stores them along its fifth axis; with the intent code 1007 (vector), which ITK and ANTs write,
they are LPS as well, with 1006 (displacement vector) RAS as its axes are, and ITK turns them round.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from deformnb._typing import Progress
from deformnb.interop.sitk_transforms import image_of_vectors
from deformnb.io import metaimage, nrrd
from deformnb.io.atomic import atomic_write
from deformnb.io.headers import fail, human_bytes, shown
from deformnb.io.memory import available_memory
from deformnb.rbf.fields import AbstractField, DisplacementField
from deformnb.volume.volume import Grid, optional_package

_MOST_PACKED = 1100  # deflate packs a byte of zeros at most 1032 times
_HEAD = 512  # bytes at the start of a file: the first line of a text, or more
_NOTE = 79  # characters of the description in a NIfTI header


def read_image(path: Path) -> Any:
    """An image of three axes and three components, of SimpleITK; its header is read first."""
    sitk = optional_package("SimpleITK")
    stored = _stored(path)
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        reader.ReadImageInformation()
        counts, components = reader.GetSize(), reader.GetNumberOfComponents()
        if len(counts) != 3 or components != 3:
            raise fail(path, f"a displacement field has three axes and three components, and this image has "
                             f"{len(counts)} and {components}.")
        need = int(np.prod(counts, dtype=object)) * 3 * 8
        if need > available_memory() // 2:
            raise fail(path, f"its {' x '.join(map(str, counts))} vectors take {human_bytes(need)}, more than half of "
                             "the memory that is free.")
        if need > 8 * _MOST_PACKED * stored:
            raise fail(path, f"its header announces {' x '.join(map(str, counts))} vectors, and the file has "
                             f"{human_bytes(stored)}; it is cut short or damaged.")
        return reader.Execute()
    except RuntimeError as error:
        raise fail(path, f"ITK reads no image from it ({reason(error)}).") from None


def _stored(path: Path) -> int:
    """Bytes of the file with the voxels, which a header may name; it must lie beside the header."""
    suffix = path.suffix.lower()
    source = {".nrrd": nrrd.data_file, ".nhdr": nrrd.data_file, ".mha": metaimage.data_file,
              ".mhd": metaimage.data_file}.get(suffix)
    return (path if source is None else source(path)).stat().st_size


def field_of_image(path: Path, image: Any) -> DisplacementField:
    """The field of an image of vectors of SimpleITK."""
    sitk = optional_package("SimpleITK")
    values = sitk.GetArrayFromImage(image)
    if not np.isfinite(values).all():
        raise fail(path, "it holds displacements that are not finite.")
    a, b, c, d, e, f, g, h, i = image.GetDirection()
    grid = Grid(values.shape[:3], image.GetSpacing(), image.GetOrigin(), ((a, b, c), (d, e, f), (g, h, i)))
    return DisplacementField(values, grid)


def image_of(sitk: Any, field: DisplacementField) -> Any:
    """An image of vectors of SimpleITK."""
    assert isinstance(field.lattice, Grid)
    return image_of_vectors(sitk, np.asarray(field.values), field.lattice)


def read_displacements(path: Path, _grid: Grid | None) -> AbstractField:
    """The field of an image of vectors."""
    return field_of_image(path, read_image(path))


def write_displacements(field: AbstractField, path: Path, grid: Grid, remark: str, overwrite: bool,
                        _progress: Progress | None) -> None:
    """Write the displacements at the voxels of a grid, float32; the remark is in the header (of NIfTI its start)."""
    sitk = optional_package("SimpleITK")
    if path.suffix.lower() in (".nhdr", ".mhd"):
        whole = ".nrrd" if path.suffix.lower() == ".nhdr" else ".mha"
        raise fail(path, f"a transform is one file; write it as {whole}.")
    image = image_of(sitk, DisplacementField(field.on_grid(grid), grid))
    image.SetMetaData("ITK_FileNotes", remark[:_NOTE])
    image.SetMetaData("deformnb_transform", remark)
    write_by_name(path, lambda file: sitk.WriteImage(image, file, True), overwrite=overwrite)


def write_by_name(path: Path, write: Callable[[str], None], *, overwrite: bool,
                  head: Callable[[bytes], bytes] | None = None, longest: int | None = None) -> None:
    """Write by a program that takes the name of a file, and take its place as a whole.

    Parameters
    ----------
    head : what the first bytes become; the first line is among them.
    longest : bytes of a text that is not refused.
    """
    suffix = "".join(path.suffixes[-2:]) if path.name.lower().endswith(".nii.gz") else path.suffix
    with tempfile.TemporaryDirectory(prefix="deformnb-") as folder:
        made = Path(folder) / f"transform{suffix.lower()}"
        try:
            write(str(made))
        except RuntimeError as error:
            raise fail(path, f"ITK cannot write it ({reason(error)}).") from None
        size = made.stat().st_size
        if longest is not None and size > longest:
            raise fail(path, f"a text of {human_bytes(size)} is too long for a transform; write it as .h5, or on a "
                             "coarser grid.")
        with atomic_write(path, overwrite=overwrite) as stream, made.open("rb") as source:
            if head is not None:
                stream.write(head(source.read(_HEAD)))
            shutil.copyfileobj(source, stream)


def reason(error: RuntimeError) -> str:
    """The last line of ITK's message, which is the one that says what is wrong."""
    lines: Sequence[str] = [line.strip() for line in str(error).splitlines() if line.strip()]
    return shown(lines[-1] if lines else "no reason given", 200)

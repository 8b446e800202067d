"""Transform files of ITK and ANTs (.tfm, .txt, .mat, .h5), and the parameter files of elastix (.txt).

They are read without ITK (:mod:`~deformnb.io.transforms.itk_files`, :mod:`~deformnb.io.transforms.itk_kinds`);
SimpleITK writes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from deformnb._typing import Progress
from deformnb.checks import optional_package
from deformnb.io.transforms import itk_files
from deformnb.io.transforms.displacement_images import to_itk_image, write_by_name
from deformnb.io.transforms.elastix import is_elastix, read_elastix
from deformnb.io.transforms.itk_kinds import field_of_list
from deformnb.io.transforms.parts import TransformPart, sample_parts
from deformnb.rbf.bspline import BSplineField
from deformnb.rbf.fields import AbstractField, Affine, Identity
from deformnb.volume.volume import Grid

# An HDF5 file may begin with a user block of 512, 1024, ... bytes, which its readers skip and other programs may use
# (HDF5 File Format Specification 3.0, section II.A: the superblock).
_USER_BLOCK = 512


def read_itk(path: Path, _grid: Grid | None) -> AbstractField:
    """The field of a file of ITK's, ANTs' or elastix's transforms."""
    name = path.name.lower()
    if name.endswith(".mat"):
        return field_of_list(path, itk_files.transforms_of_matrices(path))
    if not name.endswith((".tfm", ".txt")):
        return field_of_list(path, itk_files.transforms_of_hdf5(path))
    text = itk_files.read_text(path)
    if is_elastix(text):
        return read_elastix(path, text)
    return field_of_list(path, itk_files.transforms_of_text(path, text))


def write_itk(
    field: AbstractField, path: Path, grid: Grid, remark: str, overwrite: bool, progress: Progress | None
) -> None:
    """Write a transform for ITK, of several parts a composite; the remark is in a comment or a user block."""
    sitk = optional_package("SimpleITK")
    made = [_to_itk(sitk, part) for part in sample_parts(field, grid, progress, exact=(BSplineField,))]
    whole = made[0] if len(made) == 1 else sitk.CompositeTransform(made[::-1])  # ITK begins with the last one

    def head(start: bytes) -> bytes:
        if path.name.lower().endswith((".h5", ".hdf5")):
            return f"{remark}\n".encode().ljust(_USER_BLOCK, b"\0")[:_USER_BLOCK] + start
        return start.replace(b"\n", f"\n# {remark}\n".encode(), 1)  # the first line names the format

    write_by_name(
        path,
        lambda file: sitk.WriteTransform(whole, file),
        overwrite=overwrite,
        head=head,
        longest=itk_files.LONGEST_ITK_TEXT if path.name.lower().endswith(".tfm") else None,
    )


def _to_itk(sitk: Any, part: TransformPart) -> Any:
    if isinstance(part, Identity):
        return sitk.TranslationTransform(3)
    if isinstance(part, Affine):
        return sitk.AffineTransform(np.ravel(part.matrix).tolist(), np.asarray(part.offset).tolist())
    if isinstance(part, BSplineField):
        return _to_itk_spline(sitk, part)
    return sitk.DisplacementFieldTransform(to_itk_image(sitk, part))


def _to_itk_spline(sitk: Any, part: BSplineField) -> Any:
    axes = np.asarray(part.axes)
    spacing = np.linalg.norm(axes, axis=0)
    made = sitk.BSplineTransform(3, part.order)
    directions = (axes / spacing).ravel()
    made.SetFixedParameters([*part.counts.tolist(), *part.origin, *spacing.tolist(), *directions.tolist()])
    made.SetParameters(np.moveaxis(np.asarray(part.coefficients, dtype=np.float64), -1, 0).ravel().tolist())
    return made

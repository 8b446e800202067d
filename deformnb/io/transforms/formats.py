"""Transform files: those of ITK, ANTs and elastix, displacement fields as images, VTK's grids, OME-NGFF.

All of them are backward maps, as fields are here: a place of the result in LPS coordinates is mapped to the place of
the input that is seen there, which is what ITK's resample filters, ``antsApplyTransforms``, transformix and
vtkImageReslice expect. :func:`deformnb.invert` finds forward maps, which carry points the other way round. Each file
that is written states in its header which of the two it holds, and how exact an inverse is.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from deformnb._typing import Progress
from deformnb.checks import check_choice
from deformnb.io.files.addresses import input_path
from deformnb.io.files.atomic import check_target
from deformnb.io.files.errors import Damage, fail, human_bytes, printable
from deformnb.io.files.memory import available_memory
from deformnb.io.files.objects import copied_from_disk, copied_to_disk, is_open_file, name_for
from deformnb.io.files.paths import as_path, named_path, regular_file
from deformnb.io.transforms.displacement_images import read_displacements, write_displacements
from deformnb.io.transforms.itk import read_itk, write_itk
from deformnb.io.transforms.ngff import read_ngff, write_ngff
from deformnb.io.transforms.remarks import BACKWARD, FORWARD, REMARKS, read_remark
from deformnb.io.transforms.vtk import read_vti_field, write_vti_field
from deformnb.rbf.bspline import BSplineField
from deformnb.rbf.fields import (
    AbstractField,
    Affine,
    DisplacementField,
    HasField,
    Identity,
    as_transform_field,
    convert_unit,
    to_unit,
    with_unit,
)
from deformnb.rbf.forward import FitDirection
from deformnb.rbf.interpolant import RBFInterpolant
from deformnb.volume.volume import Grid, VolumeLike, as_grid
from deformnb.warping.inverse import Inverse, invert


@dataclass(frozen=True)
class TransformFormat:
    """One kind of transform file.

    Parameters
    ----------
    suffixes : endings of file names, lower case, the usual one first.
    read : the field of (path, grid of the result or None).
    write : writes (field, path, grid, remark for the header, overwrite, progress); None where a format is only read.
    description : for people.
    is_volume : volumes have these endings too.
    is_folder : the file is a folder.
    states_unit : it has room for the unit of lengths; in others they are millimetres.
    """

    suffixes: tuple[str, ...]
    read: Callable[[Path, Grid | None], AbstractField]
    write: Callable[[AbstractField, Path, Grid, str, bool, Progress | None], None] | None
    description: str
    is_volume: bool = False
    is_folder: bool = False
    states_unit: bool = False


TRANSFORM_FORMATS: dict[str, TransformFormat] = {
    "itk text": TransformFormat((".tfm",), read_itk, write_itk, "text of ITK's transforms"),
    "itk hdf5": TransformFormat((".h5", ".hdf5"), read_itk, write_itk, "HDF5 file of ITK's transforms"),
    "ants matrix": TransformFormat((".mat",), read_itk, None, "matrix of ANTs or ITK"),
    "elastix": TransformFormat((".txt",), read_itk, None, "parameter file of elastix, or text of ITK's transforms"),
    "nrrd": TransformFormat(
        (".nrrd", ".nhdr"), read_displacements, write_displacements, "displacements as NRRD", is_volume=True
    ),
    "nifti": TransformFormat(
        (".nii.gz", ".nii"), read_displacements, write_displacements, "displacements as NIfTI", is_volume=True
    ),
    "metaimage": TransformFormat(
        (".mha", ".mhd"), read_displacements, write_displacements, "displacements as MetaImage", is_volume=True
    ),
    "vti": TransformFormat(
        (".vti",), read_vti_field, write_vti_field, "displacements as VTK image data", is_volume=True
    ),
    "ngff": TransformFormat(
        (".zarr",),
        read_ngff,
        write_ngff,
        "OME-NGFF 0.6 with displacements in Zarr",
        is_volume=True,
        is_folder=True,
        states_unit=True,
    ),
}
"""All kinds of transform files by name."""

_START = 1 << 12  # bytes in which a text states its kind

TRANSFORM_SUFFIXES = tuple(suffix for row in TRANSFORM_FORMATS.values() for suffix in row.suffixes)
"""Endings of transform files."""


def is_transform(path: str | os.PathLike[str], *, images: bool = False) -> bool:
    """Check whether the name of a file is that of a transform: an ending which no volume has, or any with ``images``.

    Examples
    --------
    >>> is_transform("there.tfm"), is_transform("there.nii.gz")
    (True, False)
    """
    row = _row(named_path(path))
    return row is not None and (images or not row.is_volume)


def transform_suffixes(*, writing: bool = False) -> str:
    """The endings of transform files, for messages; with ``writing`` those that can be written."""
    return ", ".join(
        suffix for row in TRANSFORM_FORMATS.values() for suffix in row.suffixes if not writing or row.write is not None
    )


def _row(path: Path) -> TransformFormat | None:
    return next((row for row in TRANSFORM_FORMATS.values() if path.name.lower().endswith(row.suffixes)), None)


def read_transform(
    path: str | os.PathLike[str] | BinaryIO, grid: Grid | VolumeLike | None = None, *, suffix: str | None = None
) -> AbstractField:
    r"""The backward displacement field of a transform file, which :func:`deformnb.warp` applies.

    Parameters
    ----------
    path : a file of one of :data:`TRANSFORM_FORMATS`, its address, or an open file of bytes. Of ITK's and elastix's
        transforms all linear ones, displacement fields, B-splines of the orders 1 to 3 and compositions of them are
        read, and of ITK the kernel transforms ThinPlateSpline (the kernel r), ThinPlateR2LogR and VolumeSpline; those
        of a plane become fields over a plane. Images hold three components to a voxel, x, y and z in LPS coordinates,
        as ITK and ANTs write them; of NIfTI files the intent 1006 (displacement vector) means RAS. Of OME-NGFF the one
        transformation of the root's metadata is read.
    grid : of the result, in whose unit the field is where that is known; else it is in that of the file: mm, or what
        NGFF states.
    suffix : of an open file, by which its format is known (".tfm"); by default that of its name.

    Returns
    -------
    A field. Compositions are read as their parts: ITK's first transform of a list is the one that is applied last.

    Raises
    ------
    VolumeFileError
        If the file is missing, damaged, cut short, or no transform.

    Notes
    -----
    Beyond its samples a displacement field continues as a constant here; in ITK the displacement is zero there. A
    B-spline is the exact function of its coefficients, and zero outside its domain, as in ITK.

    Examples
    --------
    >>> import tempfile
    >>> file = Path(tempfile.mkdtemp()) / "there.tfm"
    >>> _ = file.write_text("#Insight Transform File V1.0\nTransform: TranslationTransform_double_3_3\n"
    ...                     "Parameters: 1 2 3\nFixedParameters:\n")
    >>> read_transform(file).displacement([0.0, 0.0, 0.0]).tolist()
    [1.0, 2.0, 3.0]
    """
    if is_open_file(path):
        with copied_to_disk(path, name_for(path, suffix)) as copy:
            return read_transform(copy, grid)
    place = input_path(path)
    row = _row(place)
    if row is None or not row.is_folder:
        regular_file(place)
    if row is None:
        raise fail(place, f"this is no transform file; its name must end with one of {transform_suffixes()}.")
    lattice = None if grid is None else as_grid(grid)
    with Damage(place, "save the transform on a coarser grid"):
        size = place.stat().st_size
        if size > available_memory() // 3:
            raise fail(place, f"it has {human_bytes(size)}, which is more than the memory here can hold three times.")
        if row.states_unit:
            field = row.read(place, lattice)
        else:
            field = with_unit(row.read(place, None if lattice is None else lattice.to_unit("mm")), "mm")
        return field if lattice is None else to_unit(field, lattice.unit)


def is_transform_file(path: str | os.PathLike[str]) -> bool:
    """Check whether a file that is there is a transform: by its ending, or by its header where others share that."""
    place = input_path(path)
    row = _row(place)
    if row is None:
        return False
    if not row.is_volume and not place.name.lower().endswith(".txt"):
        return True
    if read_remark(place):
        return True
    if row.is_volume or not place.is_file():
        return False
    with place.open("rb") as file:
        return re.search(rb"^(#Insight Transform|\s*\(Transform\s)", file.read(_START), re.MULTILINE) is not None


def describe_transform(path: str | os.PathLike[str]) -> dict[str, str]:
    """Describe a transform file for people: which way it maps, and its parts in the order of application.

    Examples
    --------
    >>> import tempfile
    >>> from deformnb.rbf.fields import Identity
    >>> file = Path(tempfile.mkdtemp()) / "nothing.nrrd"
    >>> write_transform(Identity(3), file, Grid((2, 2, 2), (1.0, 1.0, 1.0)))
    >>> describe_transform(file)["file"]
    'nothing.nrrd'
    """
    place = input_path(path)
    field, row = read_transform(place), _row(place)
    assert row is not None
    stated = read_remark(place)
    rows = {
        "file": printable(place.name),
        "kind": row.description,
        "maps": stated or "backward, as transforms for resampling do; the file does not state it",
    }
    for number, part in enumerate(field.steps, 1):
        rows[f"part {number}"] = _describe_part(part)
    return rows


def _describe_part(part: AbstractField) -> str:
    if isinstance(part, DisplacementField) and isinstance(part.lattice, Grid):
        lattice = part.lattice
        longest = float(np.sqrt(np.max(np.einsum("zyxc,zyxc->zyx", part.values, part.values))))
        return (
            f"displacements at {' x '.join(map(str, lattice.shape[::-1]))} nodes (x, y, z), spacing "
            f"{' x '.join(f'{s:.6g}' for s in lattice.spacing)}, up to {longest:.4g} long"
        )
    if isinstance(part, BSplineField):
        longest = float(np.sqrt((np.asarray(part.coefficients) ** 2).sum(axis=-1).max()))
        spacing = np.linalg.norm(np.asarray(part.axes), axis=0)
        return (
            f"B-spline of order {part.order} with {' x '.join(map(str, part.counts.tolist()))} coefficients (x, y, "
            f"z), spacing {' x '.join(f'{s:.6g}' for s in spacing)}, up to {longest:.4g} long"
        )
    if isinstance(part, Affine):
        determinant = abs(float(np.linalg.det(part.matrix)))
        return (
            f"affine map, which makes volumes {1 / determinant:.4g} times as large"
            if determinant > 0
            else "affine map, whose matrix has no inverse"
        )
    if isinstance(part, Identity):
        return "identity"
    return f"interpolant of {len(part.ids)} landmarks" if isinstance(part, RBFInterpolant) else type(part).__name__


def check_transform_target(path: str | os.PathLike[str], *, overwrite: bool = True) -> None:
    """Refuse a place where :func:`write_transform` could not write, before any work.

    Raises
    ------
    VolumeFileError
        If the file cannot be written, or its name ends otherwise.
    """
    place = as_path(path)
    row = _row(place)
    if row is None or row.write is None:
        raise fail(place, f"a transform is written to a file that ends with one of {transform_suffixes(writing=True)}.")
    check_target(place, overwrite=overwrite, folder_marks=("zarr.json", ".zgroup") if row.is_folder else ())


def write_transform(
    transform: AbstractField | HasField,
    path: str | os.PathLike[str] | BinaryIO,
    grid: Grid | VolumeLike,
    *,
    inverse: str | os.PathLike[str] | None = None,
    direction: FitDirection = "backward",
    overwrite: bool = True,
    progress: Progress | None = None,
    suffix: str | None = None,
) -> None:
    """Write a deformation for ITK, ANTs, 3D Slicer, elastix, VTK or readers of OME-NGFF.

    Parameters
    ----------
    transform : a field in space, a Deformation of a volume on ``grid``, or the inverse that :func:`deformnb.invert`
        finds.
    path : ends with the suffix of a writable row of :data:`TRANSFORM_FORMATS`, or is an open file. .tfm, .h5 and .zarr
        store the parts of a composition, linear ones as matrices; an image is the displacement of all of them.
    grid : whose voxels are the samples of the displacements, in float64 in .tfm, .h5 and .zarr and in float32 in
        images. Between them other programs interpolate linearly.
    inverse : where the inverse of the map on the same grid is written too, a forward map; its header has its residual.
    direction : of the map, which its header states: "forward" for one that carries points of the input to the result,
        such as that of a file which states it. The result of :func:`deformnb.invert` is known to be forward.
    overwrite : whether existing files may be replaced.
    progress : called with the finished share from 0 to 1.
    suffix : of an open file, by which its format is known (".tfm"); by default that of its name.

    Raises
    ------
    VolumeFileError
        If the file cannot be written, or its name ends otherwise.
    DeformError
        If the field is over a plane, or hides tissue along cuts: no transform file can represent that.

    Examples
    --------
    >>> import tempfile
    >>> from deformnb.rbf.fields import Identity
    >>> file = Path(tempfile.mkdtemp()) / "nothing.nrrd"
    >>> write_transform(Identity(3), file, Grid((2, 2, 2), (1.0, 1.0, 1.0)))
    >>> file.is_file()
    True
    """
    if is_open_file(path):
        with copied_from_disk(path, name_for(path, suffix)) as copy:
            write_transform(transform, copy, grid, inverse=inverse, direction=direction, progress=progress)
        return
    own, remark = as_grid(grid), _remark(transform, check_choice(direction, tuple(REMARKS), "direction"))
    places = [as_path(path), *([] if inverse is None else [as_path(inverse)])]
    for place in places:
        check_transform_target(place, overwrite=overwrite)
    field = as_transform_field(transform, own)
    if inverse is None:
        _write(field, places[0], own, remark, overwrite, progress)
    else:
        _write(field, places[0], own, remark, overwrite, None if progress is None else _half(progress, 0.0))
        found = invert(field, own, progress=None if progress is None else _half(progress, 0.5))
        back = BACKWARD if remark.startswith("forward") else _remark(found, "forward")
        _write(found.field, places[1], own, back, overwrite, None)
    if progress is not None:
        progress(1.0)


def _half(progress: Progress, begin: float) -> Progress:
    return lambda share: progress(begin + share / 2)


def _write(
    field: AbstractField, path: Path, grid: Grid, remark: str, overwrite: bool, progress: Progress | None
) -> None:
    row = _row(path)
    assert row is not None
    assert row.write is not None
    if grid.unit and not row.states_unit:
        field, grid = convert_unit(field, grid.unit, "mm"), grid.to_unit("mm")
    row.write(field, path, grid, remark, overwrite, progress)


def _remark(transform: AbstractField | HasField, direction: str) -> str:
    if not isinstance(transform, Inverse):
        return REMARKS[direction]
    worst = float(transform.error[transform.reached].max(initial=0.0))
    return f"{FORWARD}; residual {worst:.3g} at {100 * transform.share:.4g} % of the nodes, none given at the others"

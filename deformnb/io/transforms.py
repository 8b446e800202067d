"""Transform files: those of ITK and ANTs (.tfm, .h5), and displacement fields as images (NRRD, NIfTI, MetaImage).

All of them are backward maps, as fields are here: a place of the result in LPS coordinates goes to the place of the
input that is seen there, which is what ITK's resample filters and ``antsApplyTransforms`` expect.
:func:`deformnb.invert` finds forward maps, which carry points the other way round; a file says which of the two it
holds where its format has room.

SimpleITK reads and writes. Kernel transforms, which it does not have, are read from the text of a .tfm file.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.errors import DeformError
from deformnb.io.atomic import atomic_write
from deformnb.io.headers import as_path, fail, human_bytes, regular_file, shown
from deformnb.io.memory import available_memory
from deformnb.rbf.fields import AbstractField, Affine, DisplacementField, HasField, Identity, as_field, compose
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid, Volume, as_grid, optional_package
from deformnb.warping.inverse import Inverse

_ITK = (".tfm", ".txt", ".h5", ".hdf5")
_IMAGES = (".nrrd", ".nhdr", ".nii", ".nii.gz", ".mha", ".mhd")
TRANSFORM_SUFFIXES = _ITK + _IMAGES
"""Endings of transform files: ITK's transforms, and images of displacement vectors."""

_LONGEST_TEXT = 1 << 26  # bytes of a .tfm file: some million numbers
# Kernels of ITK's kernel transforms, and ours with the same system; of ITK's elastic ones there is no counterpart.
_KERNELS = {"ThinPlateSplineKernelTransform": "linear", "ThinPlateR2LogRSplineKernelTransform": "thin_plate",
            "VolumeSplineKernelTransform": "cubic"}
_KERNEL_TRANSFORM = re.compile(r"^Transform:\s*(\w+KernelTransform)_(?:double|float)_3_3\s*$", re.MULTILINE)


def is_transform(path: str | os.PathLike[str]) -> bool:
    """Check whether the name of a file is that of a transform: ITK's endings, which no volume has."""
    return as_path(path).name.lower().endswith(_ITK)


def read_transform(path: str | os.PathLike[str], grid: Grid | Volume | None = None) -> AbstractField:
    """The backward displacement field of a transform file, which :func:`deformnb.warp` applies.

    Parameters
    ----------
    path : of a file of :data:`TRANSFORM_SUFFIXES`. Of ITK's transforms all linear ones, displacement fields, B-splines
        and composites of them in three dimensions are read exactly, and the kernel transforms ThinPlateSpline (the
        kernel r), ThinPlateR2LogR and VolumeSpline from .tfm files. Images hold three components to a voxel, x, y and z
        in LPS coordinates, as ITK and ANTs write them.
    grid : on which a transform without an exact counterpart (a B-spline) is sampled: that of the result.

    Returns
    -------
    A field. Composites keep their parts: ITK's first transform of a list is the one that is applied last.

    Raises
    ------
    VolumeFileError
        If the file is missing, damaged, no transform in space, or needs ``grid``.

    Notes
    -----
    Beyond its samples a displacement field goes on as a constant here; in ITK the displacement is zero there.
    """
    path = regular_file(as_path(path))
    name = path.name.lower()
    if not name.endswith(TRANSFORM_SUFFIXES):
        raise fail(path, f"this is no transform file; its name must end with one of {', '.join(TRANSFORM_SUFFIXES)}.")
    size = path.stat().st_size
    if size > available_memory() // 3:
        raise fail(path, f"it has {human_bytes(size)}, which is more than the memory here can hold three times.")
    if name.endswith(_IMAGES):
        return _field_of(path, _read_image(path))
    if name.endswith((".tfm", ".txt")):
        if size > _LONGEST_TEXT:
            raise fail(path, f"a text of {human_bytes(size)} is too long for a transform; save it as .h5.")
        text = path.read_text(encoding="utf-8", errors="replace")
        if found := _KERNEL_TRANSFORM.search(text):
            return _kernel_transform(path, text, found[1])
    sitk = optional_package("SimpleITK")
    try:
        transform = sitk.ReadTransform(str(path))
    except RuntimeError as error:
        raise fail(path, f"ITK reads no transform from it ({_reason(error)}).") from None
    return _from_itk(path, transform, None if grid is None else as_grid(grid))


def write_transform(transform: AbstractField | HasField, path: str | os.PathLike[str], grid: Grid | Volume, *,
                    overwrite: bool = False, progress: Progress | None = None) -> None:
    """Write a deformation for ITK, ANTs, 3D Slicer or elastix.

    Parameters
    ----------
    transform : a field in space, a Deformation of a volume on ``grid``, or the inverse that :func:`deformnb.invert`
        finds.
    path : ends with one of :data:`TRANSFORM_SUFFIXES`. .tfm and .h5 keep the parts of a composition, linear ones as
        matrices; an image is the displacement of all of them.
    grid : whose voxels are the samples of the displacements, in float64 in .tfm and .h5 files and in float32 in images.
        Between them ITK interpolates linearly.
    overwrite : whether a file that is there is replaced.
    progress : called with the finished share from 0 to 1.

    Raises
    ------
    VolumeFileError
        If the file is there or cannot be written, or its name ends otherwise.
    DeformError
        If the field is over a plane, or hides tissue along cuts, which no transform file can say: the message says so.
    """
    path, lattice = as_path(path), as_grid(grid)
    name = path.name.lower()
    if not name.endswith(TRANSFORM_SUFFIXES):
        raise fail(path, f"a transform is written to a file that ends with one of {', '.join(TRANSFORM_SUFFIXES)}.")
    field = as_field(transform, lattice)
    if field.dim != 3:
        raise DeformError("a transform file holds a map of space, and this field is over a plane; extrude it first.")
    if field.has_cuts:
        raise DeformError("this deformation has cuts, which hide tissue and where displacements jump; a transform file "
                          "can hold neither. Switch the cuts off, or deform volumes here: deformnb warp.")
    remark = _remark(transform)
    sitk = optional_package("SimpleITK")
    if name.endswith(_IMAGES):
        image = _image_of(sitk, field.on_grid(lattice), lattice)
        for key in ("ITK_FileNotes", "deformnb_transform"):
            image.SetMetaData(key, remark[:79] if key == "ITK_FileNotes" else remark)
        _write(path, lambda file: sitk.WriteImage(image, file, True), overwrite=overwrite)
    else:
        made = _to_itk(sitk, field, lattice, progress)
        _write(path, lambda file: sitk.WriteTransform(made, file), overwrite=overwrite,
               comment=f"# {remark}\n" if name.endswith((".tfm", ".txt")) else "")
    if progress is not None:
        progress(1.0)


def _remark(transform: AbstractField | HasField) -> str:
    if not isinstance(transform, Inverse):
        return "backward: from places of the result to places of the input, LPS"
    worst = float(transform.error[transform.reached].max(initial=0.0))
    return (f"forward: from places of the input to places of the result, LPS; residual {worst:.3g} at "
            f"{100 * transform.share:.4g} % of the nodes, no promise at the others")


# -- writing -----------------------------------------------------------------------------------------------------------


def _image_of(sitk: Any, values: NDArray[Any], grid: Grid) -> Any:
    image = sitk.GetImageFromArray(np.ascontiguousarray(values), isVector=True)
    image.SetSpacing(grid.spacing)
    image.SetOrigin(grid.origin)
    image.SetDirection(np.ravel(grid.direction).tolist())
    return image


def _to_itk(sitk: Any, field: AbstractField, grid: Grid, progress: Progress | None) -> Any:
    """A transform of SimpleITK; of several parts each is sampled as far as those that are looked up before it reach."""
    parts, made, reach = field.steps, [], np.zeros(3)
    for k, part in enumerate(reversed(parts)):  # the last one is looked up first, at the places of the result
        if isinstance(part, Identity):
            made.append(sitk.TranslationTransform(3))
        elif isinstance(part, Affine):
            made.append(sitk.AffineTransform(np.ravel(part.matrix).tolist(), np.asarray(part.offset).tolist()))
            corners = grid.corners()
            reach = reach + np.abs(part.displacement(corners) @ np.asarray(grid.direction)).max(axis=0)
        else:
            lattice = _padded(grid, reach)
            values = part.on_grid(lattice).astype(np.float64)
            reach = reach + np.abs(values.reshape(-1, 3) @ np.asarray(grid.direction)).max(axis=0)
            made.append(sitk.DisplacementFieldTransform(_image_of(sitk, values, lattice)))
        if progress is not None:
            progress((k + 1) / (len(parts) + 1))
    return made[0] if len(made) == 1 else sitk.CompositeTransform(made[::-1])


def _padded(grid: Grid, reach: NDArray[np.float64]) -> Grid:
    """The grid with as many voxels more on every side as a length along each of its axes needs."""
    more = np.ceil(reach / np.asarray(grid.spacing)).astype(int)
    shape = tuple(int(n + 2 * m) for n, m in zip(grid.shape, more[::-1], strict=True))
    x, y, z = grid.index_to_point(-more).tolist()
    return Grid(shape, grid.spacing, (x, y, z), grid.direction)  # type: ignore[arg-type]


def _write(path: Path, write: Any, *, overwrite: bool, comment: str = "") -> None:
    """Write by a program that takes the name of a file, and take its place as a whole."""
    suffix = "".join(path.suffixes[-2:]) if path.name.lower().endswith(".nii.gz") else path.suffix
    if suffix.lower() in (".nhdr", ".mhd"):
        raise fail(path, f"a transform is one file; write it as {'.nrrd' if suffix == '.nhdr' else '.mha'}.")
    with tempfile.TemporaryDirectory(prefix="deformnb-") as folder:
        made = Path(folder) / f"transform{suffix.lower()}"
        try:
            write(str(made))
        except RuntimeError as error:
            raise fail(path, f"ITK cannot write it ({_reason(error)}).") from None
        with atomic_write(path, overwrite=overwrite) as stream, made.open("rb") as source:
            if comment:
                stream.write(source.readline() + comment.encode())  # the first line names the format
            shutil.copyfileobj(source, stream)


# -- reading -----------------------------------------------------------------------------------------------------------


def _read_image(path: Path) -> Any:
    sitk = optional_package("SimpleITK")
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    try:
        reader.ReadImageInformation()
        counts, components = reader.GetSize(), reader.GetNumberOfComponents()
        if len(counts) != 3 or components != 3:
            raise fail(path, f"a displacement field has three axes and three components, and this image has "
                             f"{len(counts)} and {components}.")
        need = int(np.prod(counts)) * 3 * 8
        if need > available_memory() // 2:
            raise fail(path, f"its {' x '.join(map(str, counts))} vectors take {human_bytes(need)}, more than half of "
                             "the memory that is free.")
        return reader.Execute()
    except RuntimeError as error:
        raise fail(path, f"ITK reads no image from it ({_reason(error)}).") from None


def _field_of(path: Path, image: Any) -> DisplacementField:
    sitk = optional_package("SimpleITK")
    values = sitk.GetArrayFromImage(image)
    if not np.isfinite(values).all():
        raise fail(path, "it holds displacements that are not finite.")
    a, b, c, d, e, f, g, h, i = image.GetDirection()
    grid = Grid(values.shape[:3], image.GetSpacing(), image.GetOrigin(), ((a, b, c), (d, e, f), (g, h, i)))
    return DisplacementField(values, grid)


def _from_itk(path: Path, transform: Any, grid: Grid | None) -> AbstractField:
    sitk = optional_package("SimpleITK")
    if transform.GetDimension() != 3:
        raise fail(path, f"it is a transform in {transform.GetDimension()} dimensions, and volumes have three.")
    if transform.GetName() == "CompositeTransform":
        composite = sitk.CompositeTransform(transform)
        parts = [composite.GetNthTransform(k) for k in range(composite.GetNumberOfTransforms())]
        return compose(*(_from_itk(path, part.Downcast(), grid) for part in parts))
    if transform.IsLinear():
        offset = np.asarray(transform.TransformPoint((0.0, 0.0, 0.0)))
        columns = [np.asarray(transform.TransformPoint(tuple(row))) - offset for row in np.eye(3)]
        return Affine(np.stack(columns, axis=1), offset)
    if transform.GetName() == "DisplacementFieldTransform":
        return _field_of(path, sitk.DisplacementFieldTransform(transform).GetDisplacementField())
    if grid is None:
        raise fail(path, f"a {shown(transform.GetName())} has no exact counterpart here; pass grid=volume, on whose "
                         "voxels its displacements are to be sampled.")
    image = sitk.TransformToDisplacementField(transform, sitk.sitkVectorFloat64, grid.shape[::-1], grid.origin,
                                              grid.spacing, np.ravel(grid.direction).tolist())
    return _field_of(path, image)


def _kernel_transform(path: Path, text: str, name: str) -> AbstractField:
    """The interpolant of the landmarks of ITK's kernel transform: its parameters are sources, the fixed ones targets.

    Davis, Khotanzad, Flamig, Harms: A physics-based coordinate transformation for 3-D image matching, IEEE Trans. Med.
    Imaging 16 (1997) 317-328.
    """
    if name not in _KERNELS:
        raise fail(path, f"{name} has no counterpart here; those of {', '.join(_KERNELS)} are read.")
    if len(re.findall(r"^Transform:", text, re.MULTILINE)) > 1:
        raise fail(path, "a kernel transform is read alone, and this file holds several transforms; save it by itself.")
    places = [_numbers(path, text, key) for key in ("Parameters", "FixedParameters")]
    if len(places[0]) != len(places[1]):
        raise fail(path, f"it has {len(places[0])} source and {len(places[1])} target landmarks; they must be pairs.")
    # From places of the result to those of the input: what ITK calls the source is the target of a drag.
    points = ControlPoints.from_arrays(places[1], places[0])
    return fit_rbf(points, kernel=_KERNELS[name], trend="affine_exact")


def _numbers(path: Path, text: str, key: str) -> NDArray[np.float64]:
    found = re.search(rf"^{key}:(.*)$", text, re.MULTILINE)
    try:
        return np.array([float(word) for word in (found[1] if found else "x").split()]).reshape(-1, 3)
    except ValueError:
        raise fail(path, f"the line '{key}:' must hold places, three numbers each.") from None


def _reason(error: RuntimeError) -> str:
    """The last line of ITK's message, which is the one that says what is wrong."""
    lines: Sequence[str] = [line.strip() for line in str(error).splitlines() if line.strip()]
    return shown(lines[-1] if lines else "no reason given", 200)


"""Transform files of ITK and ANTs (.tfm, .txt, .mat, .h5), and the parameter files of elastix (.txt).

SimpleITK reads and writes. Two kinds that it does not have are read from their text: ITK's kernel transforms, and
elastix's parameter files, whose format is that of its manual, section 4.2, and whose rotations are ITK's.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb._typing import Progress
from deformnb.errors import VolumeFileError
from deformnb.io.displacement_images import field_of_image, image_of, read_image, reason, write_by_name
from deformnb.io.headers import detached_file, fail, human_bytes, shown
from deformnb.io.memory import available_memory
from deformnb.io.transform_parts import Part, sampled_parts
from deformnb.rbf.fields import AbstractField, Affine, Identity, compose
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.volume import Grid, optional_package

LONGEST_TEXT = 1 << 26
"""Bytes of a .tfm file: some million numbers."""
_LONGEST_MATRIX = 1 << 12  # bytes of a .mat file: it holds some tens of numbers
# Kernels of ITK's kernel transforms, and ours with the same system; of ITK's elastic ones there is no counterpart.
_KERNELS = {"ThinPlateSplineKernelTransform": "linear", "ThinPlateR2LogRSplineKernelTransform": "thin_plate",
            "VolumeSplineKernelTransform": "cubic"}
_KERNEL_TRANSFORM = re.compile(r"^Transform:\s*(\w+KernelTransform)_(?:double|float)_3_3\s*$", re.MULTILINE)

_MOST_TRANSFORMS = 1000  # of one file
_MOST_FIXED = 1 << 20  # numbers that describe a grid, or the targets of a kernel transform

# An HDF5 file may begin with a user block of 512, 1024, ... bytes, which its readers skip and other programs may use
# (HDF5 File Format Specification 3.0, section II.A: the superblock).
_USER_BLOCK = 512


def read_itk(path: Path, grid: Grid | None) -> AbstractField:
    """The field of a file of ITK's, ANTs' or elastix's transforms."""
    name, size = path.name.lower(), path.stat().st_size
    if name.endswith((".tfm", ".txt")):
        if size > LONGEST_TEXT:
            raise fail(path, f"a text of {human_bytes(size)} is too long for a transform; save it as .h5.")
        text = path.read_text(encoding="utf-8", errors="replace")
        if re.search(r"^\s*\(Transform\s", text, re.MULTILINE):
            return _read_elastix(path, text, grid)
        if found := _KERNEL_TRANSFORM.search(text):
            return _kernel_transform(path, text, found[1])
        _check_text(path, text)
    elif name.endswith(".mat"):
        _check_matrix_file(path, size)
    else:
        _check_hdf5(path)
    sitk = optional_package("SimpleITK")
    try:
        transform = sitk.ReadTransform(str(path))
    except RuntimeError as error:
        raise fail(path, f"ITK reads no transform from it ({reason(error)}).") from None
    return _field_of(path, transform, grid)


def write_itk(field: AbstractField, path: Path, grid: Grid, remark: str, overwrite: bool,
              progress: Progress | None) -> None:
    """Write a transform for ITK, of several parts a composite; the remark stands in a comment or a user block."""
    sitk = optional_package("SimpleITK")
    made = [_to_itk(sitk, part) for part in sampled_parts(field, grid, progress)]
    whole = made[0] if len(made) == 1 else sitk.CompositeTransform(made[::-1])  # ITK begins with the last one

    def head(start: bytes) -> bytes:
        if path.name.lower().endswith((".h5", ".hdf5")):
            return f"{remark}\n".encode().ljust(_USER_BLOCK, b"\0")[:_USER_BLOCK] + start
        return start.replace(b"\n", f"\n# {remark}\n".encode(), 1)  # the first line names the format

    write_by_name(path, lambda file: sitk.WriteTransform(whole, file), overwrite=overwrite, head=head,
                  longest=LONGEST_TEXT if path.name.lower().endswith(".tfm") else None)


def _to_itk(sitk: Any, part: Part) -> Any:
    if isinstance(part, Identity):
        return sitk.TranslationTransform(3)
    if isinstance(part, Affine):
        return sitk.AffineTransform(np.ravel(part.matrix).tolist(), np.asarray(part.offset).tolist())
    return sitk.DisplacementFieldTransform(image_of(sitk, part))


def _field_of(path: Path, transform: Any, grid: Grid | None) -> AbstractField:
    sitk = optional_package("SimpleITK")
    if transform.GetDimension() != 3:
        raise fail(path, f"it is a transform in {transform.GetDimension()} dimensions, and volumes have three.")
    if transform.GetName() == "CompositeTransform":
        composite = sitk.CompositeTransform(transform)
        parts = [composite.GetNthTransform(k) for k in range(composite.GetNumberOfTransforms())]
        return compose(*(_field_of(path, part.Downcast(), grid) for part in parts))
    if transform.IsLinear():
        offset = np.asarray(transform.TransformPoint((0.0, 0.0, 0.0)))
        columns = [np.asarray(transform.TransformPoint(tuple(row))) - offset for row in np.eye(3)]
        if not np.isfinite([offset, *columns]).all():
            raise fail(path, "it holds numbers that are not finite.")
        return Affine(np.stack(columns, axis=1), offset)
    if transform.GetName() == "DisplacementFieldTransform":
        return field_of_image(path, sitk.DisplacementFieldTransform(transform).GetDisplacementField())
    if grid is None:
        raise fail(path, f"a {shown(transform.GetName())} has no exact counterpart here; pass grid=volume, on whose "
                         "voxels its displacements are to be sampled.")
    image = sitk.TransformToDisplacementField(transform, sitk.sitkVectorFloat64, grid.shape[::-1], grid.origin,
                                              grid.spacing, np.ravel(grid.direction).tolist())
    return field_of_image(path, image)


def _check_grid(path: Path, kind: str, fixed: Sequence[float], count: int) -> None:
    """Refuse a field or a B-spline whose grid has not as many numbers as the file: ITK makes the grid first."""
    if ("Field" in kind or "BSpline" in kind) and kind.endswith("_3_3"):
        sizes = [float(n) for n in fixed[:3]]
        if len(sizes) < 3 or not all(n >= 1 for n in sizes) or math.prod(sizes) * 3 != count:
            raise fail(path, f"the grid of its {shown(kind, 60)} is of {shown(sizes, 60)} nodes, and {count} numbers "
                             "are given; it is cut short or damaged.")


def _check_text(path: Path, text: str) -> None:
    """Compare the sizes of grids with the numbers that are there, of each transform of a text."""
    for part in re.split(r"^\s*Transform\s*:", text, flags=re.MULTILINE)[1:]:
        kind, *lines = part.split("\n")
        rows = {key.strip(): value.split() for key, _, value in (line.partition(":") for line in lines)}
        try:
            sizes = [float(word) for word in rows.get("FixedParameters", [])[:3]]
        except ValueError:
            sizes = []
        _check_grid(path, kind.strip(), sizes, len(rows.get("Parameters", [])))


def _check_hdf5(path: Path) -> None:
    """The same for an HDF5 file, from the shapes of its arrays."""
    h5py = optional_package("h5py")
    try:
        with h5py.File(path, "r") as file:
            group = file["TransformGroup"]
            if len(group) > _MOST_TRANSFORMS:
                raise fail(path, f"it holds {len(group)} transforms; at most {_MOST_TRANSFORMS} are read.")
            for entry in group.values():
                kind = entry["TransformType"][()]
                name = kind[0].decode("ascii", "replace") if len(kind) else ""
                # Old versions of ITK wrote "Tranform".
                found = {key.replace("Tranform", "Transform"): entry[key] for key in entry}
                fixed, parameters = (found.get(f"Transform{which}Parameters") for which in ("Fixed", ""))
                if fixed is None or parameters is None:  # of a composite, whose parts follow
                    continue
                if fixed.size > _MOST_FIXED or parameters.size * 16 > available_memory():
                    raise fail(path, f"its {shown(name, 60)} has {parameters.size} numbers, more than the memory here "
                                     "can hold twice.")
                _check_grid(path, name, fixed[:3].tolist() if fixed.size else [], parameters.size)
    except VolumeFileError:
        raise
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, AttributeError) as error:
        raise fail(path, f"it is no HDF5 file of ITK's transforms, or damaged ({shown(error, 100)}).") from None


def _check_matrix_file(path: Path, size: int) -> None:
    """Refuse a .mat file whose sizes do not fill it: MATLAB's level 4, a header of five int32, a name, the numbers."""
    if size > _LONGEST_MATRIX:
        raise fail(path, f"a matrix of a transform takes less than {human_bytes(_LONGEST_MATRIX)}, and this file has "
                         f"{human_bytes(size)}.")
    data, at = path.read_bytes(), 0
    while at + 20 <= size:
        kind, rows, columns, imaginary, name = np.frombuffer(data, "<i4", 5, at).tolist()
        if kind not in (0, 10) or imaginary or not (0 < rows <= size and 0 < columns <= size and 0 < name <= size):
            break
        at += 20 + name + rows * columns * (8 if kind == 0 else 4)
    if at != size or not size:
        raise fail(path, "it is no matrix file of ITK or ANTs, or damaged: its sizes do not agree with its length.")


# -- kernel transforms -------------------------------------------------------------------------------------------------


def _kernel_transform(path: Path, text: str, name: str) -> AbstractField:
    """The interpolant of the landmarks of ITK's kernel transform: its parameters are sources, the fixed ones targets.

    Davis, Khotanzad, Flamig, Harms: A physics-based coordinate transformation for 3-D image matching, IEEE Trans. Med.
    Imaging 16 (1997) 317-328.
    """
    if name not in _KERNELS:
        raise fail(path, f"{name} has no counterpart here; those of {', '.join(_KERNELS)} are read.")
    if len(re.findall(r"^Transform:", text, re.MULTILINE)) > 1:
        raise fail(path, "a kernel transform is read alone, and this file holds several transforms; save it by itself.")
    places = [_places(path, text, key) for key in ("Parameters", "FixedParameters")]
    if len(places[0]) != len(places[1]):
        raise fail(path, f"it has {len(places[0])} source and {len(places[1])} target landmarks; they must be pairs.")
    # From places of the result to those of the input: what ITK calls the source is the target of a drag.
    points = ControlPoints.from_arrays(places[1], places[0])
    return fit_rbf(points, kernel=_KERNELS[name], trend="affine_exact")


def _places(path: Path, text: str, key: str) -> NDArray[np.float64]:
    found = re.search(rf"^{key}:(.*)$", text, re.MULTILINE)
    try:
        return np.array([float(word) for word in (found[1] if found else "x").split()]).reshape(-1, 3)
    except ValueError:
        raise fail(path, f"the line '{key}:' must hold places, three numbers each.") from None


# -- elastix -----------------------------------------------------------------------------------------------------------

_INITIAL = ("InitialTransformParameterFileName", "InitialTransformParametersFileName")
_MOST_INITIAL = 10  # transforms of a chain; a registration has three or four stages


def _read_elastix(path: Path, text: str, grid: Grid | None, depth: int = 0) -> AbstractField:
    """The field of a parameter file, after those of its initial transforms, which lie in the same folder."""
    values = {key: [quoted or plain for quoted, plain in re.findall(r'"([^"]*)"|(\S+)', rest)]
              for key, rest in re.findall(r"^\s*\((\w+)\s+(.*?)\)\s*(?://.*)?$", text, re.MULTILINE)}
    if (dimensions := _word(values, "FixedImageDimension", "3")) != "3":
        raise fail(path, f"it is a transform in {shown(dimensions, 10)} dimensions, and volumes have three.")
    own = _of_elastix(path, values, grid)
    name = next((values[key][0] for key in _INITIAL if values.get(key)), "NoInitialTransform")
    if name == "NoInitialTransform":
        return own
    if _word(values, "HowToCombineTransforms", "Compose") != "Compose":
        raise fail(path, "it is added to its initial transform; only compositions are read (HowToCombineTransforms).")
    if depth >= _MOST_INITIAL:
        raise fail(path, f"it has more than {_MOST_INITIAL} initial transforms, or they name each other.")
    first = detached_file(path, re.split(r"[/\\]", name)[-1])
    if first.stat().st_size > LONGEST_TEXT:
        raise fail(first, "a text of this length is no parameter file.")
    before = first.read_text(encoding="utf-8", errors="replace")
    return compose(own, _read_elastix(first, before, grid, depth + 1))  # the initial one is looked up first


def _of_elastix(path: Path, values: dict[str, list[str]], grid: Grid | None) -> AbstractField:
    sitk, kind = optional_package("SimpleITK"), _word(values, "Transform", "")
    if kind == "DeformationFieldTransform":
        name = _word(values, "DeformationFieldFileName", "")
        return field_of_image(path, read_image(detached_file(path, re.split(r"[/\\]", name)[-1])))
    numbers = _elastix_numbers(path, values, "TransformParameters")
    centre = tuple(_elastix_numbers(path, values, "CenterOfRotationPoint", [0.0, 0.0, 0.0]))
    if kind == "BSplineTransform":
        order = _word(values, "BSplineTransformSplineOrder", "3")
        if order not in ("1", "2", "3"):
            raise fail(path, f"its splines have the order {shown(order, 20)}; 1, 2 and 3 are read.")
        made = sitk.BSplineTransform(3, int(order))
        fixed = [_elastix_numbers(path, values, f"Grid{key}") for key in ("Size", "Origin", "Spacing")]
        # elastix writes the columns of a direction one after the other, ITK its rows.
        direction = np.reshape(_elastix_numbers(path, values, "GridDirection", np.eye(3).ravel().tolist()), (3, 3)).T
        wanted = 3 * math.prod(fixed[0])
        if wanted != len(numbers):
            raise fail(path, f"its grid has {wanted:.15g} parameters, and {len(numbers)} are given.")
        parameters = [*fixed[0], *fixed[1], *fixed[2], *direction.ravel().tolist()]
    else:
        kinds: dict[str, tuple[int, Callable[[], Any]]] = {
            "TranslationTransform": (3, lambda: sitk.TranslationTransform(3)),
            "EulerTransform": (6, lambda: sitk.Euler3DTransform(centre)),
            "SimilarityTransform": (7, lambda: _centred(sitk.Similarity3DTransform(), centre)),
            "AffineTransform": (12, lambda: _centred(sitk.AffineTransform(3), centre))}
        if kind not in kinds:
            raise fail(path, f"elastix's {shown(kind, 60)} is not read; {', '.join(kinds)}, BSplineTransform and "
                             "DeformationFieldTransform are. Of others transformix writes the field: -def all.")
        count, make = kinds[kind]
        if len(numbers) != count:
            raise fail(path, f"elastix's {kind} has {count} parameters, and {len(numbers)} are given.")
        made, parameters = make(), []
        if kind == "EulerTransform":
            made.SetComputeZYX(_word(values, "ComputeZYX", "false") == "true")
    try:
        if parameters:
            made.SetFixedParameters(parameters)
        made.SetParameters(numbers)
    except RuntimeError as error:
        raise fail(path, f"ITK makes no transform of it ({reason(error)}).") from None
    return _field_of(path, made, grid)


def _word(values: dict[str, list[str]], key: str, usual: str) -> str:
    """The first value of a parameter, or the usual one."""
    return (values.get(key) or [usual])[0]


def _centred(transform: Any, centre: tuple[float, ...]) -> Any:
    transform.SetCenter(centre)
    return transform


def _elastix_numbers(path: Path, values: dict[str, list[str]], key: str,
                     usual: list[float] | None = None) -> list[float]:
    try:
        found = [float(word) for word in values[key]] if key in values or usual is None else usual
    except (KeyError, ValueError):
        raise fail(path, f"it must have the numbers of ({key} ...).") from None
    if not np.isfinite(found).all():
        raise fail(path, f"({key} ...) holds numbers that are not finite.")
    return found

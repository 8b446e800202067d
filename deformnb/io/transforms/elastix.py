"""Parameter files of elastix (.txt), whose format is that of its manual, section 4.2, and whose rotations are ITK's."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from deformnb.io.files.detached import detached_file
from deformnb.io.files.errors import fail, printable
from deformnb.io.transforms.displacement_images import read_displacement_image
from deformnb.io.transforms.itk_files import finite_numbers, read_text
from deformnb.io.transforms.itk_kinds import ItkTransform, check_transform, to_field
from deformnb.rbf.fields import AbstractField, compose

_INITIAL = ("InitialTransformParameterFileName", "InitialTransformParametersFileName")
_MOST_INITIAL = 10  # transforms of a chain; a registration has three or four stages
_LINE = re.compile(r"^[ \t]*\((\w+)[ \t]+([^\r\n]*?)\)[ \t]*(?://[^\r\n]*)?\r?$", re.MULTILINE)

# elastix's linear transforms, and the class of ITK with the same parameters in the same order.
_LINEAR = {
    "TranslationTransform": "TranslationTransform",
    "EulerTransform": "Euler3DTransform",
    "SimilarityTransform": "Similarity3DTransform",
    "AffineTransform": "AffineTransform",
}
_ORDERS = ("1", "2", "3")


def is_elastix(text: str) -> bool:
    """Check whether a text is a parameter file of elastix."""
    return re.search(r"^\s*\(Transform\s", text, re.MULTILINE) is not None


def read_elastix(path: Path, text: str, depth: int = 0) -> AbstractField:
    """The field of a parameter file, after those of its initial transforms, which are in the same folder."""
    values = dict[str, str]()
    for key, rest in _LINE.findall(text):
        if key in values:
            raise fail(path, f"the parameter ({printable(key, 40)} ...) appears twice.")
        values[key] = rest
    if (dimensions := _word(values, "FixedImageDimension", "3")) != "3":
        raise fail(path, f"it is a transform in {printable(dimensions, 10)} dimensions, and volumes have three.")
    own = _field(path, values)
    name = next((_word(values, key, "") for key in _INITIAL if key in values), "NoInitialTransform")
    if name == "NoInitialTransform":
        return own
    if _word(values, "HowToCombineTransforms", "Compose") != "Compose":
        raise fail(path, "it is added to its initial transform; only compositions are read (HowToCombineTransforms).")
    if depth >= _MOST_INITIAL:
        raise fail(path, f"it has more than {_MOST_INITIAL} initial transforms, or they name each other.")
    first = _neighbouring_file(path, name)
    return compose(own, read_elastix(first, read_text(first), depth + 1))  # the initial one is looked up first


def _neighbouring_file(path: Path, name: str) -> Path:
    """The file that a parameter names, from any former folder: it is next to this one now."""
    return detached_file(path, re.split(r"[/\\]", name)[-1])


def _field(path: Path, values: dict[str, str]) -> AbstractField:
    kind = _word(values, "Transform", "")
    if kind == "DeformationFieldTransform":
        return read_displacement_image(_neighbouring_file(path, _word(values, "DeformationFieldFileName", "")))
    if kind == "BSplineTransform":
        return to_field(path, _spline(path, values))
    if kind not in _LINEAR:
        raise fail(
            path,
            f"elastix's {printable(kind, 60)} is not read; {', '.join(_LINEAR)}, BSplineTransform and "
            "DeformationFieldTransform are. Of others transformix writes the field: -def all.",
        )
    numbers = _numbers(path, values, "TransformParameters")
    fixed = _numbers(path, values, "CenterOfRotationPoint", [0.0, 0.0, 0.0])
    if kind == "TranslationTransform":
        fixed = fixed[:0]
    elif kind == "EulerTransform":
        fixed = np.append(fixed, float(_word(values, "ComputeZYX", "false") == "true"))
    return to_field(path, check_transform(path, f"{_LINEAR[kind]}_double_3_3", numbers, fixed))


def _spline(path: Path, values: dict[str, str]) -> ItkTransform:
    order = _word(values, "BSplineTransformSplineOrder", "3")
    if order not in _ORDERS:
        raise fail(path, f"its splines have the order {printable(order, 20)}; 1, 2 and 3 are read.")
    numbers = _numbers(path, values, "TransformParameters")
    size, origin, spacing = (_numbers(path, values, f"Grid{key}") for key in ("Size", "Origin", "Spacing"))
    # elastix writes the columns of a direction one after the other, ITK its rows.
    direction = _numbers(path, values, "GridDirection", np.eye(3).ravel().tolist())
    if [len(size), len(origin), len(spacing), len(direction)] != [3, 3, 3, 9]:
        raise fail(
            path,
            "its grid must have three numbers each of (GridSize ...), (GridOrigin ...) and (GridSpacing "
            "...), and nine of (GridDirection ...).",
        )
    if (wanted := 3 * math.prod(size.tolist())) != len(numbers):
        raise fail(path, f"its grid has {wanted:.15g} parameters, and {len(numbers)} are given.")
    fixed = np.concatenate([size, origin, spacing, direction.reshape(3, 3).T.ravel()])
    return check_transform(path, f"BSplineTransform_double_3_3_{order}", numbers, fixed)


def _word(values: dict[str, str], key: str, usual: str) -> str:
    """The first value of a parameter, or the usual one."""
    found = re.match(r'"([^"]*)"|(\S+)', values.get(key, ""))
    return usual if found is None else found[1] if found[1] is not None else found[2]


def _numbers(path: Path, values: dict[str, str], key: str, usual: list[float] | None = None) -> NDArray[np.float64]:
    if key not in values:
        if usual is None:
            raise fail(path, f"it must have the numbers of ({key} ...).")
        return np.array(usual)
    return finite_numbers(path, values[key].replace('"', " "), f"the values of ({key} ...)")

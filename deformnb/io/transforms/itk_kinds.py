"""ITK's transforms by the name of their class: the map that their parameters mean.

Each class of ITK's linear transforms is a matrix M, a translation t and a centre c from its parameters, and maps

    x -> M (x - c) + c + t.

The formulas are those of ITK's sources (Modules/Core/Transform); rotations turn about x, y and z as there, and a versor
is a quaternion of length 1 without its real part.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from deformnb._typing import Floats
from deformnb.checks import LARGEST_COORDINATE
from deformnb.errors import DeformError
from deformnb.io.files.errors import fail, printable
from deformnb.rbf.bspline import ORDERS, BSplineField
from deformnb.rbf.fields import AbstractField, Affine, DisplacementField, Identity, compose
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Raster
from deformnb.volume.volume import ORTHONORMAL_TOLERANCE, Grid

LinearMap: TypeAlias = Callable[[int, Floats, Floats], tuple[Floats, Floats, Floats]]
"""From the dimension, the parameters and the fixed ones to the matrix M, the translation t and the centre c."""

COMPOSITE = "CompositeTransform"
"""The class of a list of transforms; those that follow it in a file are its parts, the last one applied first."""

_NAME = re.compile(r"(\w{1,80}?)_(?:double|float)_([1-9])_([1-9])(?:_([0-9]))?")
_MOST_NODES = 1 << 24  # along one axis: sizes are floats in these files, and whole up to 2^53


@dataclass(frozen=True)
class ItkTransform:
    """A transform as a file states it.

    Parameters
    ----------
    kind : name of the class, without its type and dimensions.
    dim : 2 or 3.
    parameters, fixed : its numbers, finite.
    order : of a B-spline.
    """

    kind: str
    dim: int
    parameters: Floats
    fixed: Floats
    order: int = 3


def parse_class(path: Path, name: str) -> tuple[str, int, int]:
    """Class, dimension and order of a full name such as AffineTransform_double_3_3 or BSplineTransform_double_3_3_2.

    Raises
    ------
    VolumeFileError
        If the class or its dimensions are not read here.
    """
    found = _NAME.fullmatch(name)
    kind = found[1] if found else name
    if found is None or (kind not in LINEAR and kind not in OTHERS and kind != COMPOSITE):
        known = ", ".join(sorted({COMPOSITE, *LINEAR, *OTHERS}))
        raise fail(
            path,
            f"the transform {printable(name, 80)} is not read here; those of the classes {known} are. Save it "
            "as a displacement field: TransformToDisplacementField.",
        )
    dim = int(found[2])
    if found[2] != found[3] or dim not in (2, 3):
        raise fail(
            path, f"its {kind} maps {found[2]} dimensions to {found[3]}; transforms of a plane and of space are read."
        )
    order = int(found[4] or 3)
    if found[4] and (kind != "BSplineTransform" or order > max(ORDERS)):
        raise fail(
            path,
            f"its {printable(name, 80)} has the order {order}; of B-splines the orders up to {max(ORDERS)} "
            "are read, and other classes have none.",
        )
    return kind, dim, order


def check_transform(path: Path, name: str, parameters: Floats, fixed: Floats) -> ItkTransform:
    """A transform of the full name of its class and its numbers.

    Raises
    ------
    VolumeFileError
        If the class is not known, or the numbers are not finite, beyond all places, or not as many as it has.
    """
    kind, dim, order = parse_class(path, name)
    largest = max((float(np.abs(numbers).max()) for numbers in (parameters, fixed) if len(numbers)), default=0.0)
    if not largest <= LARGEST_COORDINATE:  # NaN neither
        raise fail(path, f"its {kind} holds numbers that are not finite, or larger than {LARGEST_COORDINATE:g}.")
    made = ItkTransform(kind, dim, parameters, fixed, order)
    _check_counts(path, made)
    return made


def field_of_list(path: Path, transforms: list[ItkTransform]) -> AbstractField:
    """The field of all transforms of a file, in its order: one, or a composite and its parts.

    Raises
    ------
    VolumeFileError
        If they are none, several that no composite joins, or of different dimensions.
    """
    if not transforms:
        raise fail(path, "it holds no transform.")
    joined, parts = transforms[0].kind == COMPOSITE, transforms
    if joined:
        parts = transforms[1:]
    elif len(transforms) > 1:
        names = ", ".join(one.kind for one in transforms[:4])
        raise fail(
            path,
            f"it holds {len(transforms)} transforms ({names}, ...), and does not state that they follow one "
            "another; save one, or a CompositeTransform of them.",
        )
    if any(one.kind == COMPOSITE for one in parts):
        raise fail(
            path,
            "it holds a composite within a composite, whose parts cannot be separated; flatten it: FlattenTransform.",
        )
    if len({one.dim for one in transforms}) > 1:
        raise fail(path, "its transforms are of different dimensions, so that they do not follow one another.")
    return compose(*(to_field(path, one) for one in parts)) if parts else Identity(transforms[0].dim)


def to_field(path: Path, given: ItkTransform) -> AbstractField:
    """The field of one transform."""
    try:
        with np.errstate(all="ignore"):
            if given.kind in LINEAR:
                return _affine(path, given)
            return OTHERS[given.kind].field(path, given)
    except DeformError as error:
        if str(error).startswith(printable(path.name)):
            raise
        raise fail(path, str(error)) from error


def _affine(path: Path, given: ItkTransform) -> AbstractField:
    kind = LINEAR[given.kind]
    if given.kind == "IdentityTransform":
        return Identity(given.dim)
    matrix, translation, centre = kind.parts(given.dim, given.parameters, given.fixed)
    offset = translation + centre - matrix @ centre
    if not (np.isfinite(matrix).all() and np.isfinite(offset).all()):
        raise fail(path, f"the numbers of its {given.kind} make no finite map.")
    return Affine(matrix, offset)


# -- linear ------------------------------------------------------------------------------------------------------------


def _turn2(angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s], [s, c]])


def _euler(angles: Floats, *, zyx: bool) -> Floats:
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles), np.sin(angles)
    x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(z @ y @ x if zyx else z @ x @ y)


def _quaternion(x: float, y: float, z: float, w: float) -> Floats:
    """The matrix of a quaternion, which is a rotation if its length is 1; ITK does not scale it to that."""
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


# ITK's VersorTransform.SetParameters: a versor of this length or longer is made shorter than 1 by this share.
_VERSOR = 1e-10


def _versor(v: Floats) -> Floats:
    length = float(np.linalg.norm(v))
    if length >= 1 - _VERSOR:
        v = v / (length * (1 + _VERSOR))
    x, y, z = v.tolist()
    return _quaternion(x, y, z, math.sqrt(max(0.0, 1 - float(v @ v))))


def _skew_matrix(p: Floats) -> Floats:
    """ITK's ScaleSkewVersor3DTransform adds scales and skews to a rotation; it does not multiply."""
    k = p[9:15]
    return _versor(p[:3]) + np.diag(p[6:9] - 1) + np.array([[0, k[0], k[1]], [k[2], 0, k[3]], [k[4], k[5], 0]])


def _composed_skew_matrix(p: Floats) -> Floats:
    k = p[9:12]
    return _versor(p[:3]) @ np.diag(p[6:9]) @ np.array([[1, k[0], k[1]], [0, 1, k[2]], [0, 0, 1]])


def _matrix(dim: int, p: Floats) -> Floats:
    return p[: dim * dim].reshape(dim, dim)


def _first(dim: int, fixed: Floats) -> Floats:
    """The centre of the fixed parameters; old files of some classes have none."""
    return fixed[:dim] if len(fixed) else np.zeros(dim)


def _is_zyx(fixed: Floats) -> bool:
    return len(fixed) > 3 and bool(fixed[3] != 0)


@dataclass(frozen=True)
class LinearKind:
    """A class of linear transforms.

    Parameters
    ----------
    counts : of the parameters, by the dimension.
    fixed : how many fixed parameters there may be, by the dimension.
    parts : the formula.
    """

    counts: Mapping[int, int]
    fixed: Mapping[int, tuple[int, ...]]
    parts: LinearMap


_BOTH, _NONE = {2: (2,), 3: (3,)}, {2: (0,), 3: (0,)}
_ANY = {2: (0, 2), 3: (0, 3)}
_SPACE, _TURNED = {3: (3,)}, {3: (3, 4)}


def _spatial_kind(count: int, matrix: Callable[[Floats], Floats], shift: slice) -> LinearKind:
    """A class in space: a matrix of its parameters, and a translation among them."""
    return LinearKind(
        {3: count}, _SPACE, lambda _dim, p, f: (matrix(p), p[shift] if len(p[shift]) else np.zeros(3), f[:3])
    )


_AFFINE = LinearKind({2: 6, 3: 12}, _BOTH, lambda d, p, f: (_matrix(d, p), p[d * d :], f[:d]))
_AFFINE_3D = LinearKind({3: 12}, _SPACE, _AFFINE.parts)
_RIGID_2D = LinearKind({2: 3}, {2: (2,)}, lambda _d, p, f: (_turn2(p[0]), p[1:], f[:2]))

LINEAR: dict[str, LinearKind] = {
    "IdentityTransform": LinearKind({2: 0, 3: 0}, _ANY, lambda d, _p, _f: (np.eye(d), np.zeros(d), np.zeros(d))),
    "TranslationTransform": LinearKind({2: 2, 3: 3}, _NONE, lambda d, p, _f: (np.eye(d), p, np.zeros(d))),
    "ScaleTransform": LinearKind({2: 2, 3: 3}, _ANY, lambda d, p, f: (np.diag(p), np.zeros(d), _first(d, f))),
    "ScaleLogarithmicTransform": LinearKind(
        {3: 3}, _ANY, lambda d, p, f: (np.diag(np.exp(p)), np.zeros(d), _first(d, f))
    ),
    "AffineTransform": _AFFINE,
    "MatrixOffsetTransformBase": _AFFINE,
    "ScalableAffineTransform": _AFFINE_3D,
    "FixedCenterOfRotationAffineTransform": _AFFINE_3D,
    "CenteredAffineTransform": LinearKind(
        {2: 8, 3: 15}, _ANY, lambda d, p, _f: (_matrix(d, p), p[d * d + d :], p[d * d : d * d + d])
    ),
    "Rigid2DTransform": _RIGID_2D,
    "Euler2DTransform": _RIGID_2D,
    "CenteredRigid2DTransform": LinearKind({2: 5}, {2: (0, 2)}, lambda _d, p, _f: (_turn2(p[0]), p[3:], p[1:3])),
    "Similarity2DTransform": LinearKind({2: 4}, {2: (2,)}, lambda _d, p, f: (p[0] * _turn2(p[1]), p[2:], f[:2])),
    "CenteredSimilarity2DTransform": LinearKind(
        {2: 6}, {2: (0, 2)}, lambda _d, p, _f: (p[0] * _turn2(p[1]), p[4:], p[2:4])
    ),
    "Euler3DTransform": LinearKind({3: 6}, _TURNED, lambda _d, p, f: (_euler(p[:3], zyx=_is_zyx(f)), p[3:], f[:3])),
    "CenteredEuler3DTransform": LinearKind(
        {3: 9}, {3: (0, 3, 4)}, lambda _d, p, f: (_euler(p[:3], zyx=_is_zyx(f)), p[6:], p[3:6])
    ),
    "QuaternionRigidTransform": _spatial_kind(7, lambda p: _quaternion(*p[:4].tolist()), slice(4, 7)),
    "VersorTransform": _spatial_kind(3, _versor, slice(3, 3)),
    "VersorRigid3DTransform": _spatial_kind(6, lambda p: _versor(p[:3]), slice(3, 6)),
    "Similarity3DTransform": _spatial_kind(7, lambda p: p[6] * _versor(p[:3]), slice(3, 6)),
    "ScaleVersor3DTransform": _spatial_kind(9, lambda p: _versor(p[:3]) + np.diag(p[6:9] - 1), slice(3, 6)),
    "ScaleSkewVersor3DTransform": _spatial_kind(15, _skew_matrix, slice(3, 6)),
    "ComposeScaleSkewVersor3DTransform": _spatial_kind(12, _composed_skew_matrix, slice(3, 6)),
}
"""ITK's linear transforms by the name of their class."""


# -- on grids, and of landmarks ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class OtherKind:
    """A class of transforms that are no linear maps.

    Parameters
    ----------
    field : of a file and a transform.
    is_on_grid : its fixed parameters are size, origin, spacing and direction of a grid, with a vector for each node.
    """

    field: Callable[[Path, ItkTransform], AbstractField]
    is_on_grid: bool = True


def _lattice(given: ItkTransform) -> tuple[list[int], Floats, Floats, Floats]:
    """Size, origin, spacing (x, y, z) and direction of the grid of fixed parameters."""
    d, f = given.dim, given.fixed
    return [int(n) for n in f[:d]], f[d : 2 * d], f[2 * d : 3 * d], f[3 * d :].reshape(d, d)


def _spline(path: Path, given: ItkTransform) -> AbstractField:
    if given.order == 0:  # ITK's class has an empty domain for it
        return Identity(given.dim)
    size, origin, spacing, direction = _lattice(given)
    if (spacing <= 0).any():
        raise fail(
            path,
            f"the grid of its {given.kind} has the spacing {printable(spacing.tolist(), 60)}, which must be positive.",
        )
    values = np.moveaxis(given.parameters.reshape(given.dim, *size[::-1]), 0, -1)  # x components first, then y, ...
    axes = tuple(tuple(row) for row in (direction * spacing).tolist())
    return BSplineField(np.ascontiguousarray(values), tuple(origin.tolist()), axes, given.order)


def _displacements(path: Path, given: ItkTransform) -> AbstractField:
    size, origin, spacing, direction = _lattice(given)
    values = given.parameters.reshape(*size[::-1], given.dim)
    if given.dim == 3:
        (nx, ny, nz), rows = size, tuple(tuple(row) for row in direction.tolist())
        return DisplacementField(values, Grid((nz, ny, nx), tuple(spacing.tolist()), tuple(origin.tolist()), rows))  # type: ignore[arg-type]
    if not (np.allclose(direction.T @ direction, np.eye(2), atol=ORTHONORMAL_TOLERANCE) and (spacing > 0).all()):
        raise fail(
            path,
            f"the grid of its {given.kind} has the spacing {printable(spacing.tolist(), 60)} and the axes "
            f"{printable(direction.tolist(), 80)}, which must be positive, and of length 1 at right angles.",
        )
    # A raster has no directions: it is along the axes of the grid, between the map to these and the one back.
    flat = DisplacementField(values @ direction, Raster((size[1], size[0]), (spacing[0], spacing[1]), (0.0, 0.0)))
    return compose(Affine(direction, origin), flat, Affine(direction.T, -direction.T @ origin))


# Kernels of ITK's kernel transforms, and ours with the same system; of ITK's elastic ones there is no counterpart.
_KERNELS = {
    "ThinPlateSplineKernelTransform": "linear",
    "ThinPlateR2LogRSplineKernelTransform": "thin_plate",
    "VolumeSplineKernelTransform": "cubic",
}


def _kernel(_path: Path, given: ItkTransform) -> AbstractField:
    """The interpolant of the landmarks: the parameters are ITK's sources, the fixed ones its targets.

    Davis, Khotanzad, Flamig, Harms: A physics-based coordinate transformation for 3-D image matching, IEEE Trans. Med.
    Imaging 16 (1997) 317-328.
    """
    source, target = (numbers.reshape(-1, given.dim) for numbers in (given.parameters, given.fixed))
    # From places of the result to those of the input: the source of ITK is the target of a displacement.
    return fit_rbf(ControlPoints.from_arrays(target, source), kernel=_KERNELS[given.kind], trend="affine_exact")


OTHERS: dict[str, OtherKind] = {
    "BSplineTransform": OtherKind(_spline),
    "DisplacementFieldTransform": OtherKind(_displacements),
    "GaussianSmoothingOnUpdateDisplacementFieldTransform": OtherKind(_displacements),
    "BSplineSmoothingOnUpdateDisplacementFieldTransform": OtherKind(_displacements),
    **{name: OtherKind(_kernel, is_on_grid=False) for name in _KERNELS},
}
"""ITK's other transforms by the name of their class."""


def _check_counts(path: Path, given: ItkTransform) -> None:
    """Refuse another count of numbers than the class has; a grid is compared with the data before it is made."""
    count, n = len(given.parameters), len(given.fixed)
    if given.kind == COMPOSITE:
        if count or n:
            raise fail(
                path,
                f"its {COMPOSITE} has {count} parameters and {n} fixed ones, and should have "
                "none: its parts follow it.",
            )
    elif given.kind in LINEAR:
        kind = LINEAR[given.kind]
        if given.dim not in kind.counts:
            raise fail(path, f"{given.kind} is none of {given.dim} dimensions.")
        wanted, fixed = kind.counts[given.dim], kind.fixed[given.dim]
        if count != wanted or n not in fixed:
            raise fail(
                path,
                f"{given.kind} has {wanted} parameters and {' or '.join(map(str, fixed))} fixed ones, and "
                f"{count} and {n} are given; it is cut short or damaged.",
            )
    elif OTHERS[given.kind].is_on_grid:
        _check_grid(path, given)
    elif count != n or not count or count % given.dim:
        raise fail(
            path,
            f"its {given.kind} has {count / given.dim:.15g} source and {n / given.dim:.15g} target "
            "landmarks; they must be pairs.",
        )


def _check_grid(path: Path, given: ItkTransform) -> None:
    d, count, n = given.dim, len(given.parameters), len(given.fixed)
    if n != d * (3 + d):
        raise fail(path, f"the grid of its {given.kind} has {d * (3 + d)} fixed parameters, and {n} are given.")
    sizes = given.fixed[:d].tolist()
    if not all(1 <= k <= _MOST_NODES and k == int(k) for k in sizes) or math.prod(sizes) * d != count:
        raise fail(
            path,
            f"the grid of its {given.kind} is of {printable(sizes, 60)} nodes, and {count} numbers are given; "
            "it is cut short or damaged.",
        )
    if not (given.fixed[2 * d : 3 * d] != 0).all():
        raise fail(path, f"the grid of its {given.kind} has a spacing of zero.")

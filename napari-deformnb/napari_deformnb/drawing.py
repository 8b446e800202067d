"""Control points of a step as data coordinates of a layer and back: on a slice of it, or directly in space."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb import Plane
from deformnb.errors import DeformError
from napari_deformnb.subject import Subject


def plane_of_slice(subject: Subject, displayed: tuple[int, int]) -> Plane:
    """The plane of a slice as it is displayed: its first axis goes right and its second one down.

    Parameters
    ----------
    subject : the layer.
    displayed : the axes of the layer (of ``ndim``) that are shown down and to the right, as of ``viewer.dims``.

    Examples
    --------
    Rows and columns of a slice of the first axis are y, downwards, and x, to the right:

    >>> from napari.layers import Image
    >>> plane_of_slice(Subject(Image(np.zeros((2, 3, 4)), scale=(5, 1, 1))), (1, 2)).u
    (1.0, 0.0, 0.0)
    """
    down, right = (subject.ndim - 1 - axis for axis in displayed)  # of (x, y, z)
    if not {down, right} <= {0, 1, 2} or down == right:
        raise DeformError("the viewer does not show two axes of this layer; show it in two dimensions first.")
    columns = np.asarray(subject.grid.direction).T
    u = columns[right] / np.linalg.norm(columns[right])
    v = columns[down] - (columns[down] @ u) * u  # a grid may be four digits off right angles, a plane may not
    v = v / np.linalg.norm(v)
    return Plane(subject.grid.origin, tuple((u + 0.0).tolist()), tuple((v + 0.0).tolist()))


def axis_of_plane(subject: Subject, plane: Plane) -> int:
    """The axis of a volume's array (0, 1, 2 for z, y, x) that is nearest to the normal of a plane."""
    along = np.abs(np.asarray(plane.normal) @ np.asarray(subject.grid.direction))
    return 2 - int(along.argmax())


def to_layer(subject: Subject, plane: Plane | None, points: ArrayLike, depth: float) -> NDArray[np.float64]:
    """Data coordinates (N, ndim) of control points.

    Parameters
    ----------
    subject : the layer.
    plane : of the points (a, b); None for points in space.
    points : (N, 2) or (N, 3).
    depth : the slice on which points of a plane are shown, in voxels along its normal.
    """
    if plane is None:
        return subject.to_index(points)
    index = subject.to_index(plane.from_plane(np.asarray(points).reshape(-1, 2)))
    if subject.ndim == 3:
        index[:, axis_of_plane(subject, plane)] = depth
    return index


def from_layer(subject: Subject, plane: Plane | None, index: ArrayLike) -> NDArray[np.float64]:
    """Coordinates of control points, (N, 2) on a plane and (N, 3) in space, of data coordinates of a layer."""
    points = subject.to_points(index)
    return points if plane is None else plane.to_plane(points)[:, :2]

"""Volumes, channels and landmarks as layers of napari and back.

A layer is napari's LayerData tuple (data, attributes, type), which is plain data: napari need not be installed to make
one. ``viewer._add_layer_from_data(*layer)`` or ``napari.layers.Layer.create(*layer)`` takes it, and so does a plugin
that returns it. napari's axes are those of the array, so that places are (z, y, x) there and (x, y, z) here.
"""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import shown_value
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.volume.channels import KINDS, Channels
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.points import Landmarks

LayerData: TypeAlias = tuple[Any, dict[str, Any], str]

_AXES = ("z", "y", "x")


def to_napari(given: Volume | Channels | Landmarks | ControlPoints, *, unit: str | None = "mm") -> list[LayerData]:
    """The layers of a volume, of channels, of landmarks or of control points.

    Parameters
    ----------
    given : a Volume makes an image, or labels where it holds labels; Channels an image each, in their colours and added
        up, or one image of colours (rgb); Landmarks a layer of points with the feature "name"; ControlPoints two layers
        of points, their sources and their targets.
    unit : of lengths, which a volume does not know; None leaves it out ("pixel" in napari).

    Returns
    -------
    LayerData tuples with scale, translate or affine (for turned axes), units and axis_labels.

    Examples
    --------
    >>> import numpy as np
    >>> import deformnb as dn
    >>> volume = dn.Volume.from_array(np.zeros((4, 5, 6), np.uint8), spacing=(1, 1, 2.5), origin=(7, 0, 0))
    >>> [(data, attributes, kind)] = dn.interop.to_napari(volume)
    >>> kind, attributes["scale"], attributes["translate"], attributes["units"]
    ('image', (2.5, 1.0, 1.0), (0.0, 0.0, 7.0), ('mm', 'mm', 'mm'))
    >>> [layer] = dn.interop.to_napari(dn.warping.Landmarks([[1, 2, 3]], ["tip"]))
    >>> layer[0].tolist(), layer[1]["features"]
    ([[3.0, 2.0, 1.0]], {'name': ['tip']})
    >>> dn.interop.from_napari(layer).points.tolist()
    [[1.0, 2.0, 3.0]]
    """
    if isinstance(given, Volume):
        labels = given.is_labels and given.dtype.kind in "iub"
        values = given.values.view(np.uint8) if given.dtype == np.bool_ else given.values
        return [(values, _attributes(given.grid, given.name, unit), "labels" if labels else "image")]
    if isinstance(given, Channels):
        if KINDS[given.kind]:
            return [(given.values, _attributes(given.grid, given.name, unit) | {"rgb": True}, "image")]
        return [(volume.values, _attributes(volume.grid, volume.name, unit) | {
            "colormap": np.array([[0, 0, 0, 1], [*colour, 1]], dtype=np.float32), "blending": "additive"}, "image")
                for volume, colour in zip(given.volumes, given.colours, strict=True)]
    if isinstance(given, Landmarks):
        return [_points(given.points, given.names, "landmarks", unit)]
    if isinstance(given, ControlPoints):
        return [_points(places, given.names, name, unit)
                for name, places in (("sources", given.source), ("targets", given.target))]
    raise DeformError(f"layers are made of a Volume, Channels, Landmarks or ControlPoints, got {shown_value(given)}.")


def from_napari(layer: Any) -> Volume | Channels | Landmarks:
    """The volume, the colours or the landmarks of a layer of napari.

    Parameters
    ----------
    layer : an Image, Labels or Points layer, or the LayerData tuple of one. An image has three dimensions, or two,
        which become one slice; one of colours becomes Channels of the kind "rgb" or "rgba".

    Returns
    -------
    A Volume on the grid of the layer's scale, translate, rotate, shear and affine; Landmarks in the coordinates of its
    world, named by a feature "name" or "label".

    Raises
    ------
    DeformError
        For another kind of layer, sheared axes, more dimensions, and data in chunks (dask, Zarr).

    Examples
    --------
    >>> import numpy as np
    >>> data = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    >>> volume = from_napari((data, {"scale": (5, 1, 1), "translate": (0, 0, 3)}, "image"))
    >>> volume.grid.spacing, volume.grid.origin
    ((1.0, 1.0, 5.0), (3.0, 0.0, 0.0))
    """
    made = getattr(layer, "as_layer_data_tuple", None)
    whole = made() if callable(made) and not isinstance(layer, type) else layer
    if not isinstance(whole, tuple) or not 1 <= len(whole) <= 3:
        raise DeformError(f"a layer is one of napari's or a tuple (data, attributes, type), got {shown_value(layer)}.")
    defaults: tuple[Any, ...] = (None, {}, "image")
    data, attributes, kind = whole + defaults[len(whole):]
    if kind == "points":
        return _landmarks(data, attributes)
    if kind not in ("image", "labels"):
        raise DeformError(f"a layer of {shown_value(kind)} is neither an image, nor labels, nor points.")
    if isinstance(data, list | tuple):
        raise DeformError("this is a layer of a pyramid of resolutions; pass one of its levels: layer.data[0].")
    is_rgb = bool(attributes.get("rgb"))
    dims = np.ndim(data) - is_rgb
    if dims not in (2, 3):
        raise DeformError(f"a volume has two or three dimensions, and this layer has {dims}; pick one time or channel.")
    name = str(attributes.get("name") or "")
    matrix = _world(attributes, dims)
    if is_rgb:
        channels = Channels.from_array(np.asarray(data), kind="rgba" if np.shape(data)[-1] == 4 else "rgb", name=name)
        grid = Grid.from_affine(channels.grid.shape, matrix)
        return channels.with_volumes([Volume(v.values, grid, v.name, notes=v.notes) for v in channels])
    return Volume.from_affine(data if hasattr(data, "chunks") else np.asarray(data), matrix, name,
                              True if kind == "labels" else None)


def _attributes(grid: Grid, name: str, unit: str | None) -> dict[str, Any]:
    direction = np.asarray(grid.direction)
    attributes: dict[str, Any] = {"scale": grid.spacing[::-1], "axis_labels": _AXES}
    if (direction == np.eye(3)).all():
        attributes["translate"] = grid.origin[::-1]
    else:
        affine = np.eye(4)
        affine[:3, :3], affine[:3, 3] = direction[::-1, ::-1], grid.origin[::-1]
        attributes["affine"] = affine
    return attributes | ({"name": name} if name else {}) | ({"units": (unit,) * 3} if unit is not None else {})


def _points(points: NDArray[np.float64], names: tuple[str, ...], name: str, unit: str | None) -> LayerData:
    dims = points.shape[1]
    units = {"units": (unit,) * dims} if unit is not None else {}
    return points[:, ::-1].copy(), {"name": name, "features": {"name": list(names)}, **units,
                                    "axis_labels": _AXES[3 - dims:]}, "points"


def _world(attributes: dict[str, Any], dims: int) -> NDArray[np.float64]:
    """The 4 x 4 map of (x, y, z) indices to places that a layer's attributes mean.

    napari applies scale, then shear, rotation and translation, and then the affine, all to axes in the array's order.
    """
    linear, shift = np.eye(dims), np.zeros(dims)
    for key, value in (("shear", attributes.get("shear")), ("rotate", attributes.get("rotate"))):
        if value is None:
            continue
        matrix = np.asarray(value, dtype=np.float64)
        if matrix.shape == (dims, dims):
            linear = matrix @ linear
        elif matrix.any():
            raise DeformError(f"the layer's {key} is {shown_value(value)}; a volume has straight axes, and a rotation "
                              "here is a matrix: layer.rotate of a layer that napari has made.")
    if attributes.get("scale") is not None:
        linear = linear * _last(attributes["scale"], dims, "scale")
    if attributes.get("translate") is not None:
        shift = _last(attributes["translate"], dims, "translate")
    if attributes.get("affine") is not None:
        affine = np.asarray(getattr(attributes["affine"], "affine_matrix", attributes["affine"]), dtype=np.float64)
        if affine.shape != (dims + 1, dims + 1):
            raise DeformError(f"the layer's affine should be {dims + 1} x {dims + 1}, and is {affine.shape}.")
        linear, shift = affine[:dims, :dims] @ linear, affine[:dims, :dims] @ shift + affine[:dims, dims]
    world = np.eye(4)
    world[:dims, :dims], world[:dims, 3] = linear[::-1, ::-1], shift[::-1]
    return world


def _last(value: Any, dims: int, key: str) -> NDArray[np.float64]:
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.shape != (dims,):
        raise DeformError(f"the layer's {key} should be {dims} numbers, and is {shown_value(value)}.")
    return numbers


def _landmarks(data: Any, attributes: dict[str, Any]) -> Landmarks:
    points = np.asarray(data, dtype=np.float64)
    points = points.reshape(-1, points.shape[-1] if points.ndim == 2 and points.shape[-1] in (2, 3) else 3)
    dims = points.shape[1]
    world = _world(attributes, dims)
    places = points[:, ::-1] @ world[:dims, :dims].T + world[:dims, 3]
    features = attributes.get("features")
    found = next((features[key] for key in ("name", "label") if features is not None and key in features), ())
    return Landmarks(places, tuple(map(str, found)))

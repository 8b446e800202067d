"""Volumes, channels and landmarks as layers of napari and back.

A layer is napari's LayerData tuple (data, attributes, type), which is plain data: napari need not be installed to make
one. ``viewer._add_layer_from_data(*layer)`` or ``napari.layers.Layer.create(*layer)`` takes it, and so does a plugin
that returns it. napari's axes are those of the array, so that places are (z, y, x) there and (x, y, z) here.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.rbf.points import ControlPoints
from deformnb.volume.channels import CHANNEL_KINDS, Channels, ChannelsLike
from deformnb.volume.converters import convert, is_layer
from deformnb.volume.layers import LayerData, image_of_layer, layer_data, world_of_layer
from deformnb.volume.units import check_unit
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.points import Landmarks

_AXES = ("z", "y", "x")


def to_napari(given: ChannelsLike | Landmarks | ControlPoints, *, unit: str | None = None) -> list[LayerData]:
    """The layers of a volume, of channels, of landmarks or of control points.

    Parameters
    ----------
    given : a Volume makes an image, or labels where it holds labels; Channels an image each, in their colours and added
        up, or one image of colours (rgb); Landmarks a layer of points with the feature "name"; ControlPoints two layers
        of points, their sources and their targets.
    unit : into which lengths are converted; by default none are. Layers without one, as points without a
        volume, is taken to be in this one; where neither is known it is left out ("pixel" in napari).

    Returns
    -------
    LayerData tuples with scale, translate or affine (for turned axes), units and axis_labels.

    Examples
    --------
    >>> import numpy as np
    >>> import deformnb as dn
    >>> volume = dn.Volume.from_array(np.zeros((4, 5, 6), np.uint8), spacing=(1, 1, 2.5), origin=(7, 0, 0), unit="mm")
    >>> [(data, attributes, kind)] = dn.interop.to_napari(volume)
    >>> kind, attributes["scale"], attributes["translate"], attributes["units"]
    ('image', (2.5, 1.0, 1.0), (0.0, 0.0, 7.0), ('mm', 'mm', 'mm'))
    >>> [layer] = dn.interop.to_napari(dn.warping.Landmarks([[1, 2, 3]], ["tip"]))
    >>> layer[0].tolist(), layer[1]["features"]
    ([[3.0, 2.0, 1.0]], {'name': ['tip']})
    >>> dn.interop.from_napari(layer).points.tolist()
    [[1.0, 2.0, 3.0]]
    """
    to = "" if unit is None else check_unit(unit)
    if isinstance(given, Volume | Channels):
        given = given.to_unit(to)
    if isinstance(given, Volume):
        labels = given.is_labels and given.dtype.kind in "iub"
        values = given.values.view(np.uint8) if given.dtype == np.bool_ else given.values
        return [(values, _attributes(given.grid, given.name, to), "labels" if labels else "image")]
    if isinstance(given, Channels):
        if CHANNEL_KINDS[given.kind]:
            return [(given.values, _attributes(given.grid, given.name, to) | {"rgb": True}, "image")]
        return [
            (
                volume.values,
                _attributes(volume.grid, volume.name, to)
                | {"colormap": np.array([[0, 0, 0, 1], [*colour, 1]], dtype=np.float32), "blending": "additive"},
                "image",
            )
            for volume, colour in zip(given.volumes, given.colours, strict=True)
        ]
    if isinstance(given, Landmarks):
        given = given.to_unit(to)
        return [_points(given.points, given.names, "landmarks", given.unit or to)]
    if isinstance(given, ControlPoints):
        given = given.to_unit(to)
        return [
            _points(places, given.names, name, given.unit or to)
            for name, places in (("sources", given.source), ("targets", given.target))
        ]
    if isinstance(given, list | tuple) and not is_layer(given):
        raise DeformError(
            f"layers are made of a Volume, Channels, Landmarks or ControlPoints, got {short_value(given)}."
        )
    return to_napari(convert(given), unit=unit)


def from_napari(layer: Any) -> Volume | Channels | Landmarks:
    """The volume, the colours or the landmarks of a layer of napari.

    Parameters
    ----------
    layer : an Image, Labels or Points layer, or the LayerData tuple of one. An image has three dimensions, or two,
        which become one slice; one of colours becomes Channels of the kind "rgb" or "rgba".

    Returns
    -------
    A Volume on the grid of the layer's scale, translate, rotate, shear and affine; Landmarks in the coordinates of its
    world, named by a feature "name" or "label"; both in the layer's unit, that of x where each axis has another one.

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
    data, attributes, kind = layer_data(layer)
    if kind == "points":
        return _landmarks(data, attributes)
    return image_of_layer((data, attributes, kind))


def _attributes(grid: Grid, name: str, unit: str) -> dict[str, Any]:
    unit = grid.unit or unit
    direction = np.asarray(grid.direction)
    attributes: dict[str, Any] = {"scale": grid.spacing[::-1], "axis_labels": _AXES}
    if (direction == np.eye(3)).all():
        attributes["translate"] = grid.origin[::-1]
    else:
        affine = np.eye(4)
        affine[:3, :3], affine[:3, 3] = direction[::-1, ::-1], grid.origin[::-1]
        attributes["affine"] = affine
    return attributes | ({"name": name} if name else {}) | ({"units": (unit,) * 3} if unit else {})


def _points(points: NDArray[np.float64], names: tuple[str, ...], name: str, unit: str) -> LayerData:
    dims = points.shape[1]
    units = {"units": (unit,) * dims} if unit else {}
    return (
        points[:, ::-1].copy(),
        {"name": name, "features": {"name": list(names)}, **units, "axis_labels": _AXES[3 - dims :]},
        "points",
    )


def _landmarks(data: Any, attributes: dict[str, Any]) -> Landmarks:
    points = np.asarray(data, dtype=np.float64)
    points = points.reshape(-1, points.shape[-1] if points.ndim == 2 and points.shape[-1] in (2, 3) else 3)
    dims = points.shape[1]
    world, unit, notes = world_of_layer(attributes, dims)
    places = points[:, ::-1] @ world[:dims, :dims].T + world[:dims, 3]
    features = attributes.get("features")
    found = next((features[key] for key in ("name", "label") if features is not None and key in features), ())
    return Landmarks(places, tuple(map(str, found)), notes=notes, unit=unit)

"""Layers of napari as volumes and channels, at the place that their scale, rotation, shear, shift and affine mean.

A layer is one of napari's own, or its LayerData tuple (data, attributes, type), which is plain data. napari's axes are
those of the array, so that places are (z, y, x) there and (x, y, z) here.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import short_value
from deformnb.errors import DeformError
from deformnb.volume.channels import Channels
from deformnb.volume.units import common_unit, parse_unit
from deformnb.volume.volume import Grid, Volume

LayerData: TypeAlias = tuple[Any, dict[str, Any], str]


def layer_data(layer: Any) -> LayerData:
    """The data, the attributes and the type of a layer of napari or of a tuple of one; an image by default.

    Raises
    ------
    DeformError
        For anything else.

    Examples
    --------
    >>> layer_data((np.eye(2), {}))[1:]
    ({}, 'image')
    """
    made = getattr(layer, "as_layer_data_tuple", None)
    whole = made() if callable(made) and not isinstance(layer, type) else layer
    if not isinstance(whole, tuple) or not 1 <= len(whole) <= 3:
        raise DeformError(f"a layer is one of napari's or a tuple (data, attributes, type), got {short_value(layer)}.")
    defaults: tuple[Any, ...] = (None, {}, "image")
    data, attributes, kind = whole + defaults[len(whole) :]
    if not isinstance(attributes, dict):
        raise DeformError(f"the attributes of a layer are a dictionary, got {short_value(attributes)}.")
    return data, attributes, kind


def image_of_layer(layer: Any) -> Volume | Channels:
    """The volume of a layer that is an image or labels; one of colours is channels.

    Raises
    ------
    DeformError
        For another kind of layer, sheared axes, more dimensions, a pyramid, and data in chunks (dask, Zarr).

    Examples
    --------
    >>> image_of_layer((np.zeros((2, 3, 4)), {"scale": (5, 1, 1)}, "image")).grid.spacing
    (1.0, 1.0, 5.0)
    """
    data, attributes, kind = layer_data(layer)
    if kind not in ("image", "labels"):
        raise DeformError(f"a layer of {short_value(kind)} is neither an image, nor labels, nor points.")
    if isinstance(data, list | tuple) or attributes.get("multiscale") is True:
        raise DeformError("this is a layer of a pyramid of resolutions; pass one of its levels: layer.data[0].")
    is_rgb = bool(attributes.get("rgb"))
    dims = np.ndim(data) - is_rgb
    if dims not in (2, 3):
        raise DeformError(f"a volume has two or three dimensions, and this layer has {dims}; pick one time or channel.")
    name = str(attributes.get("name") or "")
    matrix, unit, notes = world_of_layer(attributes, dims)
    if is_rgb:
        channels = Channels.from_array(np.asarray(data), kind="rgba" if np.shape(data)[-1] == 4 else "rgb", name=name)
        grid = Grid.from_affine(channels.grid.shape, matrix, unit)
        return channels.with_volumes([Volume(v.values, grid, v.name, notes=(*v.notes, *notes)) for v in channels])
    made = Volume.from_affine(
        data if hasattr(data, "chunks") else np.asarray(data),
        matrix,
        name,
        True if kind == "labels" else None,
        unit=unit,
    )
    return replace(made, notes=(*made.notes, *notes)) if notes else made


def world_of_layer(attributes: dict[str, Any], dims: int) -> tuple[NDArray[np.float64], str, tuple[str, ...]]:
    """The 4 x 4 map of (x, y, z) indices to places that a layer's attributes mean, the unit of these, and notes.

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
            raise DeformError(
                f"the layer's {key} is {short_value(matrix.tolist())}; a volume has straight axes, and a rotation "
                "here is a matrix: layer.rotate of a layer that napari has made."
            )
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
    units = attributes.get("units")
    words = [units] * dims if units is None or isinstance(units, str) else list(units)
    if len(words) != dims:
        raise DeformError(f"the layer has {dims} dimensions and {len(words)} units, {short_value(units)}.")
    stated = [parse_unit("" if word is None else str(word)) for word in reversed(words)]
    unit, factors, notes = common_unit([one for one, _ in stated])
    world[:dims] *= np.asarray(factors)[:, None]
    return world, unit, tuple(dict.fromkeys(note for _, one in stated for note in one)) + notes


def _last(value: Any, dims: int, key: str) -> NDArray[np.float64]:
    numbers = np.asarray(value, dtype=np.float64)
    if numbers.shape != (dims,):
        raise DeformError(f"the layer's {key} should be {dims} numbers, and is {short_value(value)}.")
    return numbers

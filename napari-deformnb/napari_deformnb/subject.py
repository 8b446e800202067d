"""A layer of an image or of labels as volumes on a grid, and results as data of a layer like it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from deformnb.errors import DeformError
from deformnb.interop import from_napari, to_napari
from deformnb.volume import Channels, Grid, Volume
from deformnb.volume.layers import LayerData

PLACE = ("scale", "translate", "rotate", "shear", "affine", "units", "axis_labels")
"""Attributes of a layer that say where it is."""


class Subject:
    """The volumes of a layer: one, or one for each colour.

    Parameters
    ----------
    layer : an Image or Labels layer of napari.

    Attributes
    ----------
    volumes : of one grid.
    grid : where the voxels are, in the layer's world and unit.
    ndim : dimensions of the layer, 2 or 3; a layer of two dimensions is a volume of one slice.

    Raises
    ------
    DeformError
        For a layer of another kind, sheared axes, more dimensions, a pyramid, and data in chunks.
    """

    def __init__(self, layer: Any) -> None:
        data, attributes, kind = layer.as_layer_data_tuple()
        if kind not in ("image", "labels"):
            raise DeformError(f"the layer {layer.name!r} is of {kind}; choose a layer of an image or of labels.")
        if layer.multiscale:
            raise DeformError(
                f"the layer {layer.name!r} is multiscale: add one of its levels as a layer, for example by "
                "viewer.add_image(layer.data[0], scale=layer.scale), and deform that."
            )
        if layer.ndim > 3:
            raise DeformError(
                f"the layer {layer.name!r} has {layer.ndim} dimensions, and 2 or 3 can be deformed: choose Split Stack "
                "in its context menu in the layer list, and deform one of the layers that it makes."
            )
        try:
            found = from_napari((data, attributes, kind))
        except DeformError as error:
            raise DeformError(f"the layer {layer.name!r} cannot be deformed: {error}") from None
        self.kind, self.ndim = kind, int(layer.ndim)
        self.colours = found if isinstance(found, Channels) else None
        self.volumes: tuple[Volume, ...] = tuple(found) if isinstance(found, Channels) else (found,)  # type: ignore[assignment]
        self._attributes = attributes

    @property
    def grid(self) -> Grid:
        """The grid of all volumes."""
        return self.volumes[0].grid

    @property
    def is_straight(self) -> bool:
        """True where each axis of the layer is one of the viewer's, so that a slice shown is a slice of the array."""
        direction = np.abs(np.asarray(self.grid.direction))
        return bool(np.allclose(direction.max(axis=0), 1, atol=1e-6))

    def to_index(self, points: ArrayLike) -> NDArray[np.float64]:
        """Data coordinates (N, ndim) of the layer, in the order of its axes, of points (N, 3) in space."""
        return self.grid.point_to_index(points)[:, ::-1][:, 3 - self.ndim :]

    def to_points(self, index: ArrayLike) -> NDArray[np.float64]:
        """Points (N, 3) in space of data coordinates (N, ndim) of the layer."""
        given = np.asarray(index, dtype=np.float64).reshape(-1, self.ndim)
        whole = np.pad(given, ((0, 0), (3 - self.ndim, 0)))
        return self.grid.index_to_point(whole[:, ::-1])

    def place(self) -> dict[str, Any]:
        """The attributes that put another layer where this one is."""
        return {name: self._attributes[name] for name in PLACE if self._attributes.get(name) is not None}

    def to_array(self, results: list[Volume]) -> NDArray[Any]:
        """The voxels of results as data of a layer like this one."""
        values = [np.asarray(volume.values) for volume in results]
        whole = values[0] if self.colours is None else np.stack(values, axis=-1)
        whole = whole.view(np.uint8) if whole.dtype == np.bool_ else whole
        return whole[0] if self.ndim == 2 else whole

    def to_layer(self, results: list[Volume], name: str) -> LayerData:
        """A layer of results that looks as this one; on another grid at the place of that."""
        attributes = {**self._attributes, "name": name, "visible": True}
        attributes.pop("metadata", None)
        if results[0].grid != self.grid:
            if self.ndim == 2:
                raise DeformError("the result has another box, and this layer has two dimensions: choose its own box.")
            [(_, own, _)] = to_napari(results[0])
            attributes = {k: v for k, v in attributes.items() if k not in PLACE}
            attributes |= {k: v for k, v in own.items() if k in PLACE}
        return self.to_array(results), attributes, self.kind

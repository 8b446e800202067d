"""Converters: the images of other packages, files and arrays as volumes, channels or grids, at every entrance.

An object is recognised by the package that its class (or a class above it) comes from, so none of those packages is
imported. Each row of :data:`CONVERTERS` reads the place that the object itself states; nothing of it is dropped: what
has a place that no row reads is refused, and an object without one is taken with a note.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from deformnb._entrances import READERS
from deformnb.checks import optional_package, short_value
from deformnb.errors import DeformError
from deformnb.volume import labelled, layers
from deformnb.volume.array_protocol import AbstractValues
from deformnb.volume.channels import ChannelKind, Channels
from deformnb.volume.volume import Grid, Volume, nibabel_unit, pyvista_parts, refuse_lazy

Converter: TypeAlias = Callable[[Any], Volume | Channels]

# Names under which objects of other packages store their places. An array of a class with one of these has a place of
# its voxels, and to read its numbers alone would drop that silently.
_PLACES = (
    "affine",
    "spacing",
    "origin",
    "direction",
    "pixdim",
    "voxel_size",
    "pixel_size",
    "scale",
    "translate",
    "translation",
    "GetSpacing",
    "get_spacing",
    "wcs",
    "axistags",
)

from_xarray, to_xarray = labelled.from_xarray, labelled.to_xarray

NO_PLACE = "an array has no place: it is put at the origin, with voxels 1 apart"


def convert(given: Any) -> Volume | Channels:
    """The volume or the channels that any accepted object is.

    Parameters
    ----------
    given : a Volume or Channels; an object of a package of :data:`CONVERTERS`; the path of a file; an array of numbers.

    Raises
    ------
    DeformError
        For anything else, and as the converter of its package.

    Examples
    --------
    >>> convert(np.zeros((2, 3, 4), np.uint8)).grid.spacing
    (1.0, 1.0, 1.0)
    """
    if isinstance(given, Volume | Channels):
        return given
    if isinstance(given, str | os.PathLike):
        found: Volume = READERS["volume"](given)
        return found
    own = getattr(given, "to_volume", None)
    if callable(own) and not isinstance(given, type):  # a volume that is read in parts
        whole: Volume = own()
        return whole
    converter = find_converter(given)
    return _from_array(given) if converter is None else converter(given)


def find_converter(given: Any) -> Converter | None:
    """The row of :data:`CONVERTERS` for an object; None for one of no such package."""
    if isinstance(given, type):
        return None
    if is_layer(given):
        return layers.image_of_layer
    if labelled.is_labelled(given):
        return _from_xarray
    for kind in type(given).__mro__:
        found = CONVERTERS.get(kind.__module__.partition(".")[0])
        if found is not None:
            return found
    return None


def states_place(given: Any) -> bool:
    """Check whether an object is an image of another package, with the place of its voxels; no array and no file is."""
    return find_converter(given) not in (None, _from_chunks)


def is_layer(given: Any) -> bool:
    """Check whether an object is a LayerData tuple of napari: (data, attributes, type)."""
    return isinstance(given, tuple) and len(given) == 3 and isinstance(given[1], dict) and isinstance(given[2], str)


def one_volume(given: Any) -> Volume:
    """The volume that an object is; DeformError for several channels, which are no single one."""
    found = convert(given)
    if isinstance(found, Volume):
        return found
    if len(found) == 1:
        return found[0]
    raise DeformError(
        f"one volume is needed, and this has {len(found)} channels ({', '.join(found.names[:4])}); pass "
        "one of them, or their brightness: Channels.brightness()."
    )


def several_channels(given: Any) -> Channels:
    """The channels that an object is; a single volume is one channel, a path is read with all channels of its file."""
    if isinstance(given, str | os.PathLike):
        read: Channels = READERS["channels"](given)
        return read
    found = convert(given)
    return found if isinstance(found, Channels) else Channels((found,), name=found.name)


def grid_of(given: Any) -> Grid:
    """The grid of any object that has one: of a file from its header alone.

    Raises
    ------
    DeformError
        For an array, which has no grid, and for anything that is no volume.
    """
    if isinstance(given, str | os.PathLike):
        found: Grid = READERS["grid"](given)
        return found
    own = getattr(given, "grid", None)
    if isinstance(own, Grid) and not isinstance(given, type):  # channels, and volumes that are read in parts
        return own
    if not states_place(given):
        raise DeformError(
            f"a Grid or a Volume is needed, got {short_value(given)}; Grid(shape, spacing, origin) makes one."
        )
    return convert(given).grid


def _from_array(given: Any) -> Volume:
    """A volume of an array without a place; DeformError if it is no array, or has a place that is not understood."""
    if not _is_array(given):
        opened = getattr(given, "name", None)
        more = (
            f"; pass its path: {short_value(opened)}"
            if hasattr(given, "read") and isinstance(opened, str)
            else ("; Volume.from_array(array, spacing) makes one of an array, read_volume(path) of a file")
        )
        raise DeformError(f"a Volume is needed, got {short_value(given)}{more}.")
    if type(given).__module__.startswith("deformnb."):  # its numbers are no voxels
        more = "; warp_picture(picture, map) deforms a picture" if isinstance(given, AbstractValues) else ""
        raise DeformError(f"a Volume is needed, got {short_value(given)}{more}.")
    if type(given) not in (np.ndarray, np.memmap, list, tuple):
        place = next(
            (name for name in _PLACES if hasattr(type(given), name) or name in getattr(given, "__dict__", ())), None
        )
        if place is not None:
            package = type(given).__module__.partition(".")[0]
            raise DeformError(
                f"this {type(given).__name__} of {package} states its place by {place!r}, which is not "
                "supported; give it: Volume.from_array(array, spacing, origin, direction), or "
                "Volume.from_affine(array, affine)."
            )
    made = Volume.from_array(_numbers(given))
    return replace(made, notes=(*made.notes, NO_PLACE))


def _is_array(given: Any) -> bool:
    if isinstance(given, list | tuple):
        return bool(given)
    return not isinstance(given, type | np.generic) and any(
        hasattr(given, name) for name in ("__array__", "__array_interface__", "__dlpack__")
    )


def _numbers(given: Any) -> Any:
    """The array behind an object, which may be on a device or refuse to be read."""
    if isinstance(given, np.ndarray | list | tuple) or getattr(given, "chunks", None) is not None:
        return given  # checked by Volume.from_array
    try:
        return (
            np.asarray(given)
            if hasattr(given, "__array__") or hasattr(given, "__array_interface__")
            else (np.from_dlpack(given))
        )
    except Exception as error:  # each package raises its own errors
        raise DeformError(
            f"this {type(given).__name__} gives no array of numbers ({type(error).__name__}: "
            f"{str(error).partition(chr(10))[0][:100]}); copy it into NumPy's memory first."
        ) from error


def _components(values: NDArray[Any], grid: Grid, name: str) -> Channels:
    """Channels of an array [z, y, x, c], on a grid; three or four of bytes are the parts of a colour."""
    count = values.shape[-1]
    kinds: dict[int, ChannelKind] = {3: "rgb", 4: "rgba"}
    kind = kinds.get(count, "channels") if values.dtype == np.uint8 else "channels"
    return Channels.from_array(values, grid, kind=kind, name=name)


def _from_xarray(given: Any) -> Volume | Channels:
    return labelled.volume_or_channels(given)


def _from_sitk(given: Any) -> Volume | Channels:
    sitk = optional_package("SimpleITK")
    if not isinstance(given, sitk.Image):
        raise DeformError(f"a Volume is needed, got a {type(given).__name__} of SimpleITK, which is no image.")
    if given.GetNumberOfComponentsPerPixel() == 1 or given.GetDimension() > 3:
        return Volume.from_sitk(given)
    first = Volume.from_sitk(sitk.VectorIndexSelectionCast(given, 0))
    values = sitk.GetArrayFromImage(given)
    return _components(values.reshape(*first.shape, -1), first.grid, "")


def _from_itk(given: Any) -> Volume | Channels:
    """An image of ITK's own Python package, by its own account of the places of its voxels."""
    if not hasattr(given, "GetBufferedRegion") or not hasattr(given, "TransformIndexToPhysicalPoint"):
        raise DeformError(f"a Volume is needed, got a {type(given).__name__} of ITK, which is no image.")
    values = np.asarray(given)
    dims = int(given.GetImageDimension())
    if dims not in (2, 3):
        return Volume.from_array(values)  # which has its number of axes
    first = [int(given.GetBufferedRegion().GetIndex()[k]) for k in range(dims)]
    places = np.array(
        [
            list(given.TransformIndexToPhysicalPoint([n + (k == axis) for k, n in enumerate(first)]))
            for axis in range(-1, dims)
        ]
    )
    affine = np.eye(4)
    affine[:dims, :dims], affine[:dims, 3] = (places[1:] - places[0]).T, places[0]
    shape = (1,) * (3 - dims) + values.shape[:dims]
    grid = Grid.from_affine((shape[0], shape[1], shape[2]), affine, "mm")
    if values.ndim > dims and values.shape[-1] > 1:
        return _components(values.reshape(*shape, -1), grid, "")
    return replace(Volume.from_array(values.reshape(shape)), grid=grid)


def _from_nibabel(given: Any) -> Volume | Channels:
    if not hasattr(given, "dataobj") or not hasattr(given, "affine"):
        raise DeformError(f"a Volume is needed, got a {type(given).__name__} of nibabel, which is no image in space.")
    if np.dtype(given.get_data_dtype()).names is None:
        return Volume.from_nibabel(given)
    values = np.asanyarray(given.dataobj)  # colours are records of R, G, B (and A)
    parts = np.stack([values[name] for name in values.dtype.names or ()], axis=-1)
    parts = parts.reshape(*(parts.shape[:-1] + (1,) * 3)[:3], parts.shape[-1])
    shape = parts.shape[2::-1]
    grid = Volume.from_nibabel(type(given)(np.zeros(shape[::-1], np.uint8), given.affine)).grid
    return _components(np.moveaxis(parts.T, 0, -1), replace(grid, unit=nibabel_unit(given)), "")


def _from_pyvista(given: Any) -> Volume | Channels:
    values, affine, name = pyvista_parts(given, None)
    if values.ndim == 3:
        return Volume.from_pyvista(given)
    shape = (int(values.shape[0]), int(values.shape[1]), int(values.shape[2]))
    return _components(values, Grid.from_affine(shape, affine, "mm"), name)


def _from_chunks(given: Any) -> Volume | Channels:
    refuse_lazy(given)  # without chunks it is an array like any other
    return _from_array(given)


def _from_pillow(given: Any) -> Volume | Channels:
    if given.mode in ("RGB", "RGBA"):
        found = Channels.from_array(np.asarray(given), kind=given.mode.lower())
        return replace(found, volumes=tuple(replace(v, notes=(*v.notes, NO_PLACE)) for v in found))
    if given.mode not in ("1", "L", "F") and not given.mode.startswith("I"):
        raise DeformError(f"this picture has the mode {given.mode!r}; convert it first: image.convert('L') or 'RGB'.")
    made = Volume.from_array(np.asarray(given))
    return replace(made, notes=(*made.notes, NO_PLACE))


def _no_table(given: Any) -> Volume | Channels:
    raise DeformError(
        f"a Volume is needed, got a table ({type(given).__name__}); ControlPoints.from_pandas and "
        "Landmarks.from_pandas take places, and an array [z, y, x] of numbers makes a volume."
    )


CONVERTERS: dict[str, Converter] = {
    "xarray": _from_xarray,
    "SimpleITK": _from_sitk,
    "itk": _from_itk,
    "nibabel": _from_nibabel,
    "pyvista": _from_pyvista,
    "vtkmodules": _from_pyvista,
    "napari": layers.image_of_layer,
    "dask": _from_chunks,
    "zarr": _from_chunks,
    "PIL": _from_pillow,
    "pandas": _no_table,
    "polars": _no_table,
}
"""By the name of the package that an object's class comes from."""

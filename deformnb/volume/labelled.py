"""Labelled arrays: xarray's DataArray as volumes and back, with its dimensions, coordinates and attributes.

The convention is that of ``itk.xarray_from_image``: the coordinates of the dimensions x, y and z are
``origin + spacing * index`` along each axis, and the attribute "direction" is the 3 x 3 matrix of the axes in the order
z, y, x. A coordinate that falls is an axis that points the other way.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from deformnb.checks import finite_array, optional_package
from deformnb.errors import DeformError
from deformnb.volume.channels import ChannelKind, Channels
from deformnb.volume.units import UNITS, common_unit, parse_unit
from deformnb.volume.volume import EVEN, Grid, Volume, VolumeLike, as_volume, refuse_lazy

_SPATIAL = ("z", "y", "x")
_DIRECTION = "direction"
_COLOURS = ("rgb", "rgba", "colour", "color")
_CHANNELS = ("c", "ch", "channel", "channels", "band", "component", *_COLOURS)


def is_labelled(given: object) -> bool:
    """Check whether an object is a labelled array: one with dims and coords, which xarray need not be loaded for."""
    return not isinstance(given, type) and all(hasattr(given, name) for name in ("dims", "coords", "transpose"))


@dataclass(frozen=True)
class LabelledAxes:
    """Dimensions of a labelled array that are places, and the grid that their coordinates mean.

    The unit is that of the coordinates' attributes "units" (of the CF conventions) or "unit".

    Parameters
    ----------
    spatial : names of the dimensions that are z, y and x, as far as there are: the last ones in the order of an array.
    others : names of all other dimensions, such as channels and time.
    grid : of the voxels; one slice where there are two dimensions in space.
    unit_notes : remarks on their units.
    """

    spatial: tuple[Hashable, ...]
    others: tuple[Hashable, ...]
    grid: Grid
    unit_notes: tuple[str, ...] = ()

    def notes(self, array: Any) -> tuple[str, ...]:
        """Assumptions where the array states nothing: which dimension is which, and places without coordinates."""
        found = list(self.unit_notes)
        if not {str(dim).lower() for dim in self.spatial} & set(_SPATIAL):
            found.append(
                f"the dimensions {', '.join(map(str, self.spatial))} were taken as "
                f"{', '.join(_SPATIAL[3 - len(self.spatial) :])}"
            )
        bare = [str(dim) for dim in self.spatial if dim not in array.coords]
        if bare:
            found.append(f"no coordinates along {', '.join(bare)}: voxels were taken to be 1 apart, the first at 0")
        return tuple(found)

    @classmethod
    def of(cls, array: Any) -> LabelledAxes:
        """The axes of a DataArray.

        Raises
        ------
        DeformError
            If it has no two or three dimensions in space, or coordinates that are not evenly spaced numbers.
        """
        by_letter = {str(dim).lower(): dim for dim in array.dims}
        spatial = tuple(by_letter[letter] for letter in _SPATIAL if letter in by_letter)
        if len(spatial) < 2 and not by_letter.keys() & set(_SPATIAL) and array.ndim in (2, 3):
            spatial = tuple(array.dims)  # no names of places at all: in the order of the array
        if len(spatial) < 2 or ("z" in by_letter and len(spatial) < 3 and spatial != tuple(array.dims)):
            raise DeformError(
                f"a DataArray needs the dimensions z, y, x (or y, x), and this one has "
                f"({', '.join(map(str, array.dims))}); rename them: array.rename(old='x')."
            )
        starts, steps = zip(*(_line(array, dim) for dim in spatial), strict=True)
        shape = tuple(int(array.sizes[dim]) for dim in spatial)
        rest = 3 - len(spatial)
        stated = [parse_unit(_unit(array, dim)) for dim in reversed(spatial)]
        units = [one for one, _ in stated]
        unit, factors, notes = common_unit(units + units[:1] * rest)
        origin = (0.0,) * rest + tuple(a * f for a, f in zip(starts, factors[::-1][rest:], strict=True))
        spacing = (1.0,) * rest + tuple(a * f for a, f in zip(steps, factors[::-1][rest:], strict=True))
        turned = _direction(array, len(spatial)) * np.where(np.asarray(spacing[::-1]) < 0, -1.0, 1.0)
        grid = Grid(
            (1,) * rest + shape,  # type: ignore[arg-type]
            tuple(abs(step) for step in spacing[::-1]),
            origin[::-1],
            tuple(tuple(row) for row in turned.tolist()),  # type: ignore[arg-type]
            unit,
        )
        notes = tuple(dict.fromkeys(note for _, one in stated for note in one)) + notes
        return cls(spatial, tuple(dim for dim in array.dims if dim not in spatial), grid, notes)


def _unit(array: Any, dim: Hashable) -> str:
    about = array.coords[dim].attrs if dim in array.coords else {}
    return str(about.get("units", about.get("unit", "")))


def _line(array: Any, dim: Hashable) -> tuple[float, float]:
    """The first coordinate along a dimension and the step to the next; 0 and 1 where it has none."""
    if dim not in array.coords:
        return 0.0, 1.0
    values = np.asarray(array.coords[dim].values)
    if values.dtype.kind not in "iuf" or not np.isfinite(values).all():
        raise DeformError(
            f"the coordinates along {dim} are no places but {values.dtype}; drop them: array.drop_vars({str(dim)!r})."
        )
    if len(values) < 2:
        return float(values[0]), 1.0
    steps = np.diff(values.astype(np.float64))
    step = float((values[-1].astype(np.float64) - values[0].astype(np.float64)) / len(steps))
    if step == 0 or np.abs(steps - step).max() > EVEN * abs(step):
        raise DeformError(
            f"the coordinates along {dim} are not evenly spaced (steps from {steps.min():.6g} to "
            f"{steps.max():.6g}); interpolate the array onto even ones first: array.interp."
        )
    return float(values[0]), step


def _direction(array: Any, dims: int) -> NDArray[np.float64]:
    """The matrix of the attribute "direction", whose rows and columns are in the order z, y, x, as ours: x, y, z."""
    given = array.attrs.get(_DIRECTION)
    matrix = np.eye(3)
    if given is not None:
        flat = finite_array(given, (dims, dims), f"the attribute {_DIRECTION!r} must be {dims} x {dims} numbers")
        matrix[:dims, :dims] = np.flip(flat)
    return matrix


def from_xarray(array: Any, *, is_labels: bool | None = None) -> Volume:
    """A volume that shares the voxels of an ``xarray.DataArray`` with the dimensions z, y, x (or y, x), in any order.

    Parameters
    ----------
    array : spacing and origin are those of its coordinates, which may fall; an attribute "direction" (3 x 3, in the
        order z, y, x, as ITK writes it) is the direction of its axes.
    is_labels : voxels are names, not amounts; as in :meth:`Volume.from_array`.

    Raises
    ------
    DeformError
        For other dimensions, coordinates that are not evenly spaced numbers, and an array in chunks (dask).

    Examples
    --------
    >>> import numpy as np
    >>> import xarray as xr
    >>> from_xarray(xr.DataArray(np.zeros((2, 3, 4), np.uint8), dims=("z", "y", "x"))).shape
    (2, 3, 4)
    """
    found = volume_or_channels(array, is_labels=is_labels)
    if isinstance(found, Channels):
        more = next(str(dim) for dim in one_array(array).dims if str(dim).lower() in _CHANNELS)
        raise DeformError(
            f"a volume has the dimensions z, y and x and this array has {more} too; "
            f"pick one: array.isel({more}=0). dn.warp deforms all of them by one map."
        )
    return found


def one_array(given: Any) -> Any:
    """The labelled array of an object of xarray: itself, the only variable of a Dataset, a Variable without places.

    Raises
    ------
    DeformError
        For a Dataset of several variables, and for anything else.
    """
    variables = getattr(given, "data_vars", None)
    if variables is not None:
        if len(variables) != 1:
            raise DeformError(
                f"a Dataset of one variable is a volume, and this one has {len(variables)}"
                f"{': ' if len(variables) else ''}{', '.join(map(str, variables))}; pick one: "
                "dataset['name']."
            )
        return next(iter(variables.values()))
    if is_labelled(given):
        return given
    if type(given).__module__.partition(".")[0] == "xarray" and hasattr(given, "dims") and hasattr(given, "to_numpy"):
        return optional_package("xarray").DataArray(given)
    raise DeformError(f"from_xarray takes an xarray.DataArray, not {type(given).__name__}.")


def volume_or_channels(given: Any, *, is_labels: bool | None = None) -> Volume | Channels:
    """The volume of an object of xarray, or its channels where one more dimension is named so ("c", "channel", "rgb").

    Parameters
    ----------
    given, is_labels : as in :func:`from_xarray`.

    Raises
    ------
    DeformError
        As :func:`from_xarray`, and for a Dataset of several variables.
    """
    array = one_array(given)
    refuse_lazy(array)
    axes = LabelledAxes.of(array)
    more = [dim for dim in axes.others if array.sizes[dim] > 1]
    values = array.transpose(*axes.others, *axes.spatial).values
    name = str(array.name or "")
    if len(more) == 1 and str(more[0]).lower() in _CHANNELS:
        stack = np.moveaxis(values.reshape(-1, *axes.grid.shape), 0, -1)
        is_colour = str(more[0]).lower() in _COLOURS and stack.shape[-1] in (3, 4)
        kind: ChannelKind = "channels" if not is_colour else "rgb" if stack.shape[-1] == 3 else "rgba"
        names = () if is_colour or more[0] not in array.coords else tuple(map(str, array.coords[more[0]].values))
        return Channels.from_array(stack, axes.grid, names, kind=kind, name=name)
    if more:
        raise DeformError(
            f"a volume has the dimensions z, y and x and this array has {', '.join(map(str, more))} too; "
            f"pick one: array.isel({more[0]}=0). dn.warp deforms all of them by one map."
        )
    made = Volume.from_array(values.reshape(axes.grid.shape), name=name, is_labels=is_labels)
    return replace(made, grid=axes.grid, notes=(*made.notes, *axes.notes(array)))


def to_xarray(volume: VolumeLike) -> Any:
    """An ``xarray.DataArray`` that shares the voxels: dimensions z, y, x with coordinates, and "direction".

    Coordinates have the attribute "units", the name of the unit of length, where that is known.

    Examples
    --------
    >>> array = to_xarray(Volume.from_array(np.zeros((2, 3, 4)), spacing=(1, 1, 2), origin=(5, 0, 0)))
    >>> array.dims, array.coords["z"].values.tolist(), from_xarray(array).grid.origin
    (('z', 'y', 'x'), [0.0, 2.0], (5.0, 0.0, 0.0))
    """
    xarray, volume = optional_package("xarray"), as_volume(volume)
    coords, direction = _coordinates(volume.grid, _SPATIAL)
    return xarray.DataArray(volume.values, coords, _SPATIAL, volume.name or None, {_DIRECTION: direction})


def _coordinates(grid: Grid, names: tuple[Hashable, ...]) -> tuple[dict[Hashable, Any], NDArray[np.float64]]:
    units = {"units": UNITS[grid.unit].name} if grid.unit else {}
    places = [
        start + step * np.arange(n)
        for start, step, n in zip(grid.origin[::-1], grid.spacing[::-1], grid.shape, strict=True)
    ]
    coords = {name: (name, values, units) for name, values in zip(names, places[3 - len(names) :], strict=True)}
    return coords, np.flip(np.asarray(grid.direction))


def unstack(array: Any) -> tuple[list[Volume], Callable[[Sequence[Volume]], Any]]:
    """The volumes of a DataArray, all those along its other dimensions, and a function that stacks the results of them.

    That makes a DataArray with the same dimensions, coordinates and attributes.

    Parameters
    ----------
    array : with z, y and x (or y and x) among its dimensions, in any order.

    Raises
    ------
    DeformError
        As :meth:`LabelledAxes.of`; and if it is not in memory.
    """
    array = one_array(array)
    refuse_lazy(array)
    axes = LabelledAxes.of(array)
    ordered = array.transpose(*axes.others, *axes.spatial)
    stack = np.asarray(ordered.values).reshape(-1, *axes.grid.shape)
    volumes = [replace(Volume.from_array(values, name=str(array.name or "")), grid=axes.grid) for values in stack]
    return volumes, lambda results: _stack(results, axes, ordered).transpose(*array.dims)


def _stack(results: Sequence[Volume], axes: LabelledAxes, ordered: Any) -> Any:
    """Volumes in the place of those of an array whose other dimensions come first."""
    grid = results[0].grid
    values = np.stack([result.values for result in results])
    outer = tuple(ordered.shape[: len(axes.others)])
    inner = grid.shape[3 - len(axes.spatial) :]
    if grid == axes.grid:
        return ordered.copy(data=values.reshape(*outer, *inner))
    if len(axes.spatial) == 2 and grid.shape[0] != 1:
        raise DeformError(
            f"the array has the dimensions {', '.join(map(str, axes.spatial))} and the result has "
            f"{grid.shape[0]} slices; give a grid of one slice."
        )
    coords, direction = _coordinates(grid, axes.spatial)
    kept = {name: coord for name, coord in ordered.coords.items() if not set(coord.dims) & set(axes.spatial)}
    size = len(axes.spatial)
    return type(ordered)(
        values.reshape(*outer, *inner),
        {**kept, **coords},
        ordered.dims,
        ordered.name,
        {**ordered.attrs, _DIRECTION: direction[3 - size :, 3 - size :]},
    )

"""Deform volumes by dragging points on a picture of them.

The flow is always the same: a :class:`Volume` is projected to a :class:`Picture`, :class:`ControlPoints` are dragged on
it, :func:`fit_rbf` interpolates the drags, an extrusion makes a displacement field in space of it, and :func:`warp`
applies that to the volume. A :class:`Deformation` is the document that holds all of this.

Conventions
-----------
- Arrays are [z, y, x]; points and vectors are (x, y, z) on the last axis; a field on a grid is [z, y, x, 3].
- Lengths are physical, in LPS coordinates: ``point = origin + direction @ (spacing * index)``. Picture coordinates are
  (a, b) on a :class:`Plane`: a to the right, b down, depth c away from the viewer.
- Displacements are backward: ``output(x) = input(x + D(x))``. A point dragged from source to target contributes
  ``D(target) = source - target``: the source appears exactly at the target.
- Outside a volume, half a voxel beyond the outermost centres, is its background (its smallest value).

The names that a notebook uses are here. All others are in the packages: ``dn.analysis``, ``dn.chunked``,
``dn.document``, ``dn.imaging``, ``dn.interop``, ``dn.io``, ``dn.rbf``, ``dn.registration``, ``dn.session``,
``dn.warping``, ``dn.datasets``, ``dn.widgets`` and ``dn.errors``.
Where a field is required, a Deformation will do; where a Grid is required, a Volume; where points are, Landmarks. Where
a Volume is required, these are accepted too: an image of SimpleITK, ITK, nibabel, pyvista, VTK or xarray, a layer of
napari, the path of a file, or an array, which has no place and is put at the origin with voxels 1 apart.

Names load on first use, so that ``import deformnb`` is quick and loads no widget, no VTK and no matplotlib.
"""

from functools import partial
from typing import Any

import lazy_loader

from deformnb._entrances import CONVERSIONS, DISPLAYS, READERS

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def _read(kind: str, path: Any) -> Any:
    """Read the object at a path; its reader is imported when the first one is given."""
    io = __getattr__("io")
    return {
        "volume": io.read_volume,
        "channels": io.read_channels,
        "mesh": io.read_mesh,
        "grid": lambda path: io.describe_file(path).grid,
    }[kind](path)


def _converted(name: str, given: Any, **options: Any) -> Any:
    """Convert an object of another package to a volume or back; the converter is imported when the first is given."""
    from deformnb.volume import converters

    return getattr(converters, name)(given, **options)


def _displayed(name: str, given: Any, *arguments: Any, **options: Any) -> Any:
    """Make the output of an object in a notebook's cell; what draws it is imported when the first one is shown."""
    from deformnb.imaging import cell_output

    return getattr(cell_output, name)(given, *arguments, **options)


for _kind in ("volume", "channels", "mesh", "grid"):
    READERS[_kind] = partial(_read, _kind)
for _name in ("one_volume", "several_channels", "grid_of", "states_place", "from_xarray", "to_xarray"):
    CONVERSIONS[_name] = partial(_converted, _name)
for _name in ("as_html", "as_png", "plot_volume"):
    DISPLAYS[_name] = partial(_displayed, _name)

__version__ = "0.1.0"

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
  ``D(target) = source - target``: what was at the source appears exactly at the target.
- Outside a volume, half a voxel beyond the outermost centres, lies its background (its smallest value).

What a notebook types is here. All else is in the packages: ``dn.analysis``, ``dn.chunked``, ``dn.document``,
``dn.imaging``, ``dn.interop``, ``dn.io``, ``dn.rbf``, ``dn.registration``, ``dn.session``, ``dn.warping``,
``dn.datasets``, ``dn.lessons``, ``dn.widgets`` and ``dn.errors``.
Where a field is required, a Deformation will do; where a Grid is required, a Volume; where points are, Landmarks.

Names load on first use, so that ``import deformnb`` is quick and loads no widget, no VTK and no matplotlib.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

__version__ = "0.1.0"

"""A window of VTK that nobody sees, and its pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

from deformnb.widgets.view import Image


def new_plotter() -> Any:
    """A ``pyvista.Plotter`` without a screen, with the light of the stills; its thread is the only one to use it."""
    import pyvista

    # One lamp at the camera: the three of pyvista's kit stain what faces the viewer.
    plotter: Any = pyvista.Plotter(off_screen=True, window_size=[8, 8], lighting="none")
    plotter.add_light(pyvista.Light(light_type="headlight"))
    plotter.render_window.SetMultiSamples(0)  # smooths edges of meshes, of which most scenes have none
    return plotter


def pixels(window: Any) -> Image:
    """What a render window has drawn, (height, width, 3), without drawing it again."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

    width, height = window.GetSize()
    data = vtkUnsignedCharArray()
    window.GetPixelData(0, 0, width - 1, height - 1, 0, data, 0)
    rgb: Image = vtk_to_numpy(data).reshape(height, width, 3)  # type: ignore[no-untyped-call]
    return np.ascontiguousarray(rgb[::-1])

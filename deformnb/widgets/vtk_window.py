"""A window of VTK that nobody sees, and its pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

from deformnb.widgets.camera import Image

_IN_SPACE = ("vtkActor", "vtkOpenGLActor")  # what looks the same from any part of a camera


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


def has_overlay(plotter: Any, usual: int) -> bool:
    """Whether something lies on the picture instead of in space: it would be drawn once in every part.

    Parameters
    ----------
    usual : renderers that the window had at first.
    """
    if plotter.render_window.GetRenderers().GetNumberOfItems() > usual:
        return True  # the corner with axes has one of its own
    return any(not prop.IsA("vtkVolume") and prop.GetClassName() not in _IN_SPACE
               for renderer in plotter.renderers for prop in renderer.GetViewProps())

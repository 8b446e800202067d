"""Cells of the notebooks that benchmarks/latency.py opens: the same volume and the same 16 points in each view."""

from __future__ import annotations

from collections.abc import Callable

WIDTH, HEIGHT, POINTS = 600, 450, 16
"""Of the view in CSS pixels, and how many control points there are."""

_PROBLEM = f"""
import numpy as np
from benchmarks import problem
volume = problem.volume({{size}}, "uint8")
points = problem.control_points({POINTS}, 2, {{size}})
"""

_EDITOR = """
from deformnb import Deformation, Plane, project
from deformnb.widgets import Editor, {view}
plane = Plane.from_view(volume.grid, "+y")
editor = Editor(project(volume, plane, "mip"), points, height=450)
view = {view}(volume, width={width}, height={height})
view.follow(editor, Deformation((editor.step(),)).field(volume.grid))
times = []
"""

# The code of a user of pyvista, correct and as fast as possible: the map of the picture is
# coarse; VTK or scipy, whichever is faster here, warps the voxels into an array that stays; the mapper is the fastest
# without a GPU; and the picture is requested in the loop of the kernel, because a slider's callback runs in a
# separate thread, which OpenGL does not support.
_PYVISTA = f"""
import asyncio, os, time
os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
import ipywidgets, pyvista as pv
from IPython.display import display
from scipy import ndimage
from scipy.interpolate import RBFInterpolator
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import vtkImageData
from vtkmodules.vtkFiltersHybrid import vtkGridTransform
from vtkmodules.vtkImagingCore import vtkImageReslice

n, coarse = {{size}}, 64
original = pv.ImageData(dimensions=(n, n, n))
original.point_data["v"] = volume.values.ravel()
shown = original.copy()
source, target = points.source, points.target
pixels = np.stack(np.meshgrid(*[np.linspace(0, n - 1, coarse)] * 2), -1).reshape(-1, 2)

moves = vtkImageData()  # the same map in both planes, so the same all along y
moves.SetDimensions(coarse, 2, coarse)
moves.SetSpacing((n - 1) / (coarse - 1), n - 1, (n - 1) / (coarse - 1))
transform = vtkGridTransform()
transform.SetInterpolationModeToLinear()
reslice = vtkImageReslice()
reslice.SetInputData(original)
reslice.SetInterpolationModeToLinear()
reslice.SetResliceTransform(transform)

def map_of(amount):
    moved = source + amount * (target - source)
    return RBFInterpolator(moved, source - moved)(pixels).reshape(coarse, coarse, 2)

def by_vtk(d):
    field = np.zeros((coarse, 2, coarse, 3), np.float32)
    field[..., 0], field[..., 2] = d[:, None, :, 0], -d[::-1, None, :, 1]  # rows of the picture go down
    moves.GetPointData().SetScalars(numpy_to_vtk(field.reshape(-1, 3), deep=True))
    transform.SetDisplacementGridData(moves)
    transform.Modified()
    reslice.Update()
    shown.point_data["v"][:] = pv.wrap(reslice.GetOutput()).active_scalars

z, x = np.mgrid[:n, :n].astype(np.float32)

def by_scipy(d):
    fine = [ndimage.zoom(d[::-1, :, k], n / coarse, order=1) for k in (0, 1)]
    at, out = np.stack([z - fine[1], x + fine[0]]), shown.point_data["v"].reshape(n, n, n)
    for y in range(n):
        ndimage.map_coordinates(volume.values[:, y], at, order=1, output=out[:, y])

def seconds(warp):
    start = time.perf_counter()
    warp(map_of(0.5))
    return time.perf_counter() - start

fastest = min((by_vtk, by_scipy), key=lambda warp: min(seconds(warp) for _ in range(2)))

def warp(amount):
    fastest(map_of(amount))
    shown.GetPointData().GetArray("v").Modified()
    shown.Modified()

plotter = pv.Plotter(notebook=True, window_size=({WIDTH}, {HEIGHT}))
plotter.add_volume(shown, mapper="{{mapper}}", cmap="bone", opacity="linear", show_scalar_bar=False)
plotter.camera_position = "xz"
times, loop = [], asyncio.get_running_loop()

def edit(change):
    start = time.perf_counter()
    warp(change["new"])
    warped = time.perf_counter()
    def render():
        begun = time.perf_counter()
        plotter.render()
        times.append([round(1e3 * t) for t in (warped - start, begun - warped, time.perf_counter() - begun)])
    loop.call_soon_threadsafe(render)

slider = ipywidgets.FloatSlider(value=1.0, min=0.0, max=2.0, step=0.02)
slider.observe(edit, "value")
display(slider)
"""


def _ours(view: str) -> Callable[[int], list[str]]:
    def cells(size: int) -> list[str]:
        made = _EDITOR.format(view=view, width=WIDTH, height=HEIGHT)
        return [_PROBLEM.format(size=size), made, "from ipywidgets import HBox\nHBox([editor, view])"]

    return cells


def _pyvista(size: int) -> list[str]:
    made = _PYVISTA.format(size=size, mapper="fixed_point")
    return [_PROBLEM.format(size=size), made, 'plotter.show(jupyter_backend="server")']


# pyvista's newer view, that of trame-rca. Its style sheet is found only if its module is enabled before the server
# starts, and it draws on request, not with the plotter.
_RCA = f"""
from pyvista.trame.jupyter import launch_server
import trame_pyvista.module
from trame_pyvista.widgets import get_server
get_server(pv.global_theme.trame.jupyter_server_name).enable_module(trame_pyvista.module)
await launch_server().ready
app = plotter.trame.app()
app.use_remote_rendering()
plotter.render = app.render
app.ui.iframe_style = "border: none; width: {WIDTH}px; height: {HEIGHT}px"
app.ui
"""


def _pyvista_rca(size: int) -> list[str]:
    made = _PYVISTA.format(size=size, mapper="fixed_point")
    return [_PROBLEM.format(size=size), made, _RCA]


RIVALS: dict[str, Callable[[int], list[str]]] = {"pyvista, trame": _pyvista, "pyvista, trame-rca": _pyvista_rca}
"""The functions of pyvista, by their names in the report."""

CASES: dict[str, Callable[[int], list[str]]] = {
    "Editor + LiveView": _ours("LiveView"),
    "Editor + VolumeView": _ours("VolumeView"),
    **RIVALS,
}
"""The notebook of each view, by its name in the report."""

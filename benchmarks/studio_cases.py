"""Studios that benchmarks/studio.py opens: the volume, the points, and the shapes of each case."""

from __future__ import annotations

from pathlib import Path

PLANE_POINTS = """
plane = dn.Plane.from_view(volume.grid, "+z")
picture = dn.project(volume, plane, "mip")
corner = np.array(picture.raster.origin)
extent = np.array(picture.raster.spacing) * (np.array(picture.raster.shape[::-1]) - 1)
unit = problem.control_points({count}, 2, 2)
target = unit.target[np.abs(unit.target - 0.66).max(axis=1) > 0.09]
source = target + 0.4 * (unit.source - unit.target)[:len(target)]
points = dn.ControlPoints.from_arrays(corner + extent * source, corner + extent * target)
"""
"""Points of a picture with drags so small that nothing folds at first, none of them in the part."""

SPACE_POINTS = """
last = np.array(volume.grid.shape[::-1]) - 1
unit = problem.control_points({count}, 3, 2)
source, target = (np.vstack([last * a, last / 2 - b]) for a, b in ((unit.source, 12), (unit.target, 0)))
points = dn.ControlPoints.from_arrays(volume.grid.index_to_point(source), volume.grid.index_to_point(target))
"""
"""Points in space, the last of them in the middle of the volume."""

_PLANE = PLANE_POINTS + "step = Step((points,), plane, {shapes})\n"
_SPACE = SPACE_POINTS + "step = Step((points,), None)\n"

CUT = "cuts=[dn.Cut(dn.Line(corner + extent * np.array([[0.48, -0.05], [0.55, 0.45], [0.5, 1.05]])))]"
PART = "parts=[dn.RigidPart(dn.Polygon(corner + extent * np.array([[.61, .61], [.71, .6], [.72, .7], [.6, .71]])))]"

CASES: dict[str, tuple[int, str, str]] = {
    "16 points": (16, _PLANE, ""),
    "200 points": (200, _PLANE, ""),
    "200 points, cut": (200, _PLANE, CUT),
    "200 points, part": (200, _PLANE, PART),
    "16 points, space": (15, _SPACE, ""),
}
"""The number of points of each case, the text that makes its step, and further arguments of that."""

_STUDIO = """import sys
sys.path.insert(0, {checkout!r})
import numpy as np
import deformnb as dn
from benchmarks import problem
from deformnb.document.deformation import Step
assert dn.__file__.startswith({checkout!r}), dn.__file__
size = {size}
volume = problem.volume(size, "uint8")
{step}
"""

_IN_A_CELL = "studio = dn.Studio(volume, dn.Deformation((step,)), side='+z')\nstudio"

_IN_THE_APPLICATION = """
import asyncio
from deformnb.app.application import Application, app_server
async def serve():
    server = app_server(Application(volume, dn.Deformation((step,)), side="+z", folder={folder!r}))
    await server.run(lambda _: print(server.url, flush=True))
asyncio.run(serve())
"""


def _program(case: str, checkout: Path, size: int) -> str:
    count, step, shapes = CASES[case]
    made = step.format(count=count, shapes=shapes)
    return _STUDIO.format(checkout=str(checkout), size=size, step=made)


def cell(case: str, checkout: Path, size: int) -> str:
    """The cell of a notebook that shows the studio of a case, with the package of a checkout."""
    return _program(case, checkout, size) + _IN_A_CELL


def application(case: str, checkout: Path, size: int, folder: Path) -> str:
    """The program of an application that shows the same studio, and prints its address."""
    return _program(case, checkout, size) + _IN_THE_APPLICATION.format(folder=str(folder))

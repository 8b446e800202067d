"""VTK's pictures off screen beside windows of others in the same thread, in processes of their own: X may end them."""

from __future__ import annotations

import os
import subprocess
import sys
from textwrap import dedent

import pytest

pytestmark = pytest.mark.needs_gl

BEGINNING = """
import numpy as np
import pyvista

from deformnb.datasets.phantoms import PHANTOMS
from deformnb.imaging.render import VtkRenderer, _camera, render_volume
from deformnb.volume.transfer import as_transfer

bar, size = PHANTOMS["bar"].make((8, 8, 16)), (160, 120)
camera = _camera(bar.grid, (0.4, 1.0, -0.3), None, None, size)
renderer = VtkRenderer(as_transfer(None, bar), size)

def check():
    assert np.array_equal(render_volume(bar, size=size, backend="vtk"), wanted)
    assert np.array_equal(renderer(bar, camera), wanted)

wanted = renderer(bar, camera)
assert wanted.std() > 20
"""


def run_on_display(program: str, display: str) -> None:
    run = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", BEGINNING + dedent(program) + "\nimport os\nos._exit(0)"],
        env={**os.environ, "DISPLAY": display, "QT_QPA_PLATFORM": "xcb"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        timeout=240,
        check=False,
    )
    assert run.returncode == 0, run.stdout


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="other systems have one interface for all windows")
def test_windows_of_pyvista_open_and_draw_beside_ours(x_display: str) -> None:
    run_on_display(
        """
        pictures = []
        for _ in range(2):
            plotter = pyvista.Plotter(window_size=[200, 200])
            assert plotter.render_window.GetClassName() == "vtkXOpenGLRenderWindow"  # and not one without a window
            plotter.add_mesh(pyvista.Sphere())
            plotter.show(auto_close=False, interactive=False)
            pictures.append(plotter.screenshot())
            check()
            plotter.render()
            pictures.append(plotter.screenshot())
            plotter.close()
            check()
        assert pictures[0].std() > 20
        # Mesa smooths three pixels of an outline otherwise after another context.
        assert all(np.abs(picture.astype(int) - pictures[0]).mean() < 0.05 for picture in pictures)
        """,
        x_display,
    )


@pytest.mark.parametrize("shown", [False, True])
def test_pictures_are_made_beside_those_of_napari(x_display: str, shown: bool) -> None:
    """Qt's context stays current between two pictures; VTK drew into it, and exports of the process were black."""
    pytest.importorskip("napari")
    run_on_display(
        f"""
        import napari
        from qtpy.QtWidgets import QApplication

        for _ in range(2):
            viewer = napari.Viewer(show={shown})
            viewer.add_image(np.random.default_rng(0).random((20, 20, 20)))
            viewer.dims.ndisplay = 3
            before = viewer.screenshot()
            assert before.std() > 20
            check()
            assert np.array_equal(viewer.screenshot(), before)
            check()
            viewer.close()
            QApplication.processEvents()
            check()
        renderer.close()
        check()
        """,
        x_display,
    )

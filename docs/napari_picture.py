"""The picture of the page about napari: its plugin on the phantom of a knee, bent by one drag.

From the root of the repository, with the packages of ``sh run setup test`` and a display (or below ``xvfb-run``)::

    python docs/napari_picture.py

It writes ``docs/napari.jpg``. NOTICE says of every picture of the documentation what it shows.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import napari
from PIL import Image
from qtpy.QtWidgets import QApplication

ROOT = Path(__file__).resolve().parents[1]
SIZE = (1280, 860)  # of the window, in pixels
PATIENCE = 60.0  # seconds
FRAMES = 50  # that Qt draws after the last change


def wait(condition: Callable[[], bool]) -> None:
    """Wait for a state that the thread of the viewer brings about."""
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:
        QApplication.processEvents()
        time.sleep(0.01)


def main() -> None:
    """Bend the knee on a slice from its side, and take the picture of the window."""
    viewer = napari.Viewer(show=True)
    viewer.window.resize(*SIZE)
    viewer.open_sample("napari-deformnb", "knee")
    _, widget = viewer.window.add_plugin_dock_widget("napari-deformnb", "Deform volume")
    knee = viewer.layers[0]
    viewer.dims.order = (2, 0, 1)
    widget.start(knee, "slice")
    target = widget.editor.pairs.sides["target"]
    nz, ny, nx = knee.data.shape
    for share in (0.5, 0.85):
        target.add([share * nz, 0.5 * ny, nx // 2])
    bent = target.data.copy()
    bent[-1, 1] += 0.25 * ny
    target.data = bent
    widget.cells.setValue(16)
    viewer.reset_view()
    wait(lambda: not widget.editor.is_busy)
    for _ in range(FRAMES):
        QApplication.processEvents()
        time.sleep(0.01)
    picture = viewer.screenshot(canvas_only=False, flash=False)
    Image.fromarray(picture[..., :3]).save(ROOT / "docs" / "napari.jpg", quality=85, optimize=True, progressive=True)
    widget.stop()
    viewer.close()


if __name__ == "__main__":
    main()

"""Fixtures of the plugin of napari: a display without a screen, a viewer, and waits for its results."""

from __future__ import annotations

import gc
import sys
import warnings
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import numpy as np
import pytest
from waiting import wait_for

import deformnb as dn

with warnings.catch_warnings():  # of napari's own imports, which are not ours to correct
    warnings.simplefilter("ignore")
    for _module in ("napari.layers", "napari.qt", "napari.viewer"):
        import_module(_module)


@pytest.fixture(scope="module")
def display(x_display: str) -> Iterator[None]:
    """A display for Qt, which finds it in the environment when it makes the first window."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DISPLAY", x_display)
        if sys.platform.startswith("linux"):
            patch.setenv("QT_QPA_PLATFORM", "xcb")
        yield


@pytest.fixture(scope="session")
def _settings(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NAPARI_CONFIG", str(tmp_path_factory.mktemp("napari") / "settings.yaml"))
        yield


@pytest.fixture
def viewer(display: None, _settings: None, request: pytest.FixtureRequest) -> Iterator[Any]:
    """A viewer of napari; shown on the display where the test is marked so by the parameter True."""
    import napari
    from qtpy.QtCore import QCoreApplication, QEvent
    from qtpy.QtWidgets import QApplication

    made = napari.Viewer(show=getattr(request, "param", False))
    yield made
    made.close()
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete.value)
    QApplication.processEvents()
    del made
    gc.collect(1)  # in this thread: Qt ends the process where another one destroys its widgets


@pytest.fixture
def wait() -> Callable[[Callable[[], Any]], None]:
    """Wait for a state that the thread of the viewer brings about."""
    from qtpy.QtWidgets import QApplication

    def wait_in_events(condition: Callable[[], Any]) -> None:
        def process() -> Any:
            QApplication.processEvents()
            return condition()

        wait_for(process)

    return wait_in_events


@pytest.fixture
def messages() -> Iterator[list[str]]:
    """The texts of napari's notifications, as they come."""
    from napari.utils.notifications import notification_manager

    found: list[str] = []

    def note(event: Any) -> None:
        found.append(str(event.message))

    notification_manager.notification_ready.connect(note)
    yield found
    notification_manager.notification_ready.disconnect(note)


@pytest.fixture
def ball() -> dn.Volume:
    """An uneven blob on a grid with three spacings, of uint8."""
    grid = dn.Grid((12, 20, 24), (1.0, 1.5, 2.5), (10.0, -20.0, 30.0), unit="mm")
    index = np.stack(np.meshgrid(*(np.arange(n) for n in grid.shape), indexing="ij"), axis=-1)
    distance = np.linalg.norm((index - (5.5, 9, 12)) / (5, 8, 9), axis=-1)
    values = np.where(distance < 1, 60 + 150 * (1 - distance), 0) + 10 * (distance < 1) * (index[..., 2] % 3)
    return dn.Volume(values.astype(np.uint8), grid, "ball")


@pytest.fixture
def add_volume(viewer: Any) -> Callable[..., Any]:
    """Add a volume to the viewer as deformnb makes layers of it."""
    from napari.layers import Layer

    def add(volume: Any) -> Any:
        layer = Layer.create(*dn.interop.to_napari(volume)[0])
        viewer.add_layer(layer)
        return layer

    return add

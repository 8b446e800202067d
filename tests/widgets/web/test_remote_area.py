"""The mouse over pictures that are drawn elsewhere: its effect on a camera."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deformnb.errors import DeformError
from deformnb.volume.volume import Grid
from deformnb.widgets.camera import checked_camera
from deformnb.widgets.web.remote_area import MouseCamera, drag_camera, zoom_camera


def test_what_is_in_front_follows_the_hand() -> None:
    camera = checked_camera({"direction": (0, 1, 0), "up": (0, 0, 1)})  # right is +x
    turned = drag_camera(camera, "turn", 0.1, 0.0, 1.0)
    assert turned["direction"][0] > 0.2  # the viewer went to the left and looks to the right
    np.testing.assert_allclose(turned["up"], [0, 0, 1], atol=1e-12)
    tilted = drag_camera(camera, "turn", 0.0, 0.1, 1.0)
    assert tilted["direction"][2] > 0.2
    assert np.dot(tilted["up"], tilted["direction"]) == pytest.approx(0)
    assert drag_camera(camera, "move", 0.1, 0.2, 50.0)["pan"] == [-5.0, -10.0]
    assert drag_camera(camera, "zoom", 0.0, 0.1, 1.0)["zoom"] > 1.2
    assert zoom_camera(camera, 1e9)["zoom"] == 40.0


@pytest.mark.parametrize("event", [None, {}, {"type": 1}, {"type": "MouseWheel", "spinY": "far"}])
def test_what_is_no_event_of_a_mouse_is_refused(event: Any) -> None:
    mouse = MouseCamera(lambda change: None, lambda: None)
    with pytest.raises(DeformError):
        mouse.handle_event(event, Grid((4, 4, 4)))


def test_the_end_of_a_drag_and_of_a_notch_is_said() -> None:
    cameras, ends = [checked_camera({})], []
    mouse = MouseCamera(lambda change: cameras.append(change(cameras[-1])), lambda: ends.append(len(cameras)))
    for event in (
        {"type": "RightButtonPress", "x": 0, "y": 0},
        {"type": "MouseMove", "x": 0, "y": 51.2},
        {"type": "RightButtonRelease"},
        {"type": "MouseWheel", "spinY": 1},
    ):
        assert mouse.is_pressed == (event["type"] in ("MouseMove", "RightButtonRelease"))
        mouse.handle_event(event, Grid((4, 4, 4)))
    assert ends == [2, 3]
    assert cameras[1]["zoom"] == pytest.approx(np.exp(0.2))
    assert cameras[2]["zoom"] == pytest.approx(np.exp(0.2) / 1.15)

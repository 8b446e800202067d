from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from studio_driver import a_volume, panel, wait_for, walk

from deformnb.errors import DeformError
from deformnb.io.volumes.formats import write_volume
from deformnb.volume.volume import Volume
from deformnb.widgets import Studio
from deformnb.widgets.view.live_view import LiveView


def test_a_second_volume_is_shown_beside_the_first_and_turns_with_it(tmp_path: Path) -> None:
    first = a_volume()
    write_volume(Volume(np.flip(first.values, 0).copy(), first.grid, "flipped"), tmp_path / "flipped.nrrd")
    (tmp_path / "broken.nrrd").write_bytes(b"NRRD0004\n")
    studio = Studio(first, folder=tmp_path)
    try:
        chooser = panel(studio, "Second volume").controls[0].widget
        views = lambda: [widget for widget in walk(studio) if isinstance(widget, LiveView)]  # noqa: E731
        chooser.value = "flipped.nrrd"
        wait_for(lambda: len(views()) == 2)
        second = next(view for view in views() if view is not studio.view)
        assert second.camera == studio.view.camera
        second.set_camera((0, 0, 1), zoom=2.0)
        assert studio.view.camera == second.camera
        studio.view.projection = "mip"
        assert second.projection == "mip"
        chooser.value = "broken.nrrd"
        wait_for(lambda: chooser.value == "flipped.nrrd")  # what could not be read changes nothing
        assert second in views()
        chooser.value = "no target"
        wait_for(lambda: views() == [studio.view])
        studio.view.set_camera(zoom=3.0)
        assert second.camera["zoom"] == 2.0
    finally:
        studio.close()


def test_cameras_link_two_views() -> None:
    view = LiveView(a_volume())
    with pytest.raises(DeformError, match="two views"):
        view.link_camera(view)
    view.close()

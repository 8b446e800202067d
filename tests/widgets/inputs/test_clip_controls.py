"""Sliders of a clip: their values in Python, and those that a view takes from its front end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deformnb.errors import DeformError
from deformnb.session.session import Session
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.inputs.clip_controls import ClipControls
from deformnb.widgets.inputs.transfer_editor import TransferEditor
from deformnb.widgets.studio.controls import DisplayPanel
from deformnb.widgets.view.live_view import LiveView
from deformnb.widgets.view.volume_view import VolumeView


def volume(spacing: tuple[float, float, float] = (1.0, 1.0, 2.0)) -> Volume:
    unit = "" if spacing == (1.0, 1.0, 1.0) else "\u00b5m"
    return Volume(np.arange(60, dtype=np.uint8).reshape(3, 4, 5), Grid((3, 4, 5), spacing, unit=unit))


@pytest.fixture(params=["live", "vtk"])
def view(request: pytest.FixtureRequest) -> Any:
    made: Any = LiveView(volume()) if request.param == "live" else VolumeView(volume(), method="core")
    yield made
    made.close()


def test_a_view_is_clipped_axis_by_axis(view: Any) -> None:
    view.set_clip(y=(0.25, 1))
    view.set_clip(z=(0, 0.5))
    assert view.clip == ((0.0, 1.0), (0.25, 1.0), (0.0, 0.5))
    with pytest.raises(DeformError, match="shares of a clip"):
        view.set_clip(x=(0.7, 0.2))
    assert view.clip == ((0.0, 1.0), (0.25, 1.0), (0.0, 0.5))


def test_a_page_may_clip_and_a_wrong_clip_costs_nothing(view: Any, caplog: pytest.LogCaptureFixture) -> None:
    view.set_state({"clip": [[0, 1], [0.5, 1], [0, 1]]})
    assert view.clip == ((0.0, 1.0), (0.5, 1.0), (0.0, 1.0))
    view.set_state({"clip": [[0, 1], [2, 1], [0, 1]], "projection": "mip"})
    assert (view.clip[1], view.projection) == ((0.5, 1.0), "mip")
    assert "dropped" in caplog.text


def test_a_still_and_a_preview_are_clipped(view: Any) -> None:
    whole, before = view.still((64, 48)), view.preview_png()
    view.set_clip(x=(0, 0.4))
    assert (view.still((64, 48)) != whole).any()
    assert view.preview_png() != before
    view.set_clip(x=(0, 1))
    assert (view.still((64, 48)) == whole).all()


def test_a_page_knows_the_unit_of_lengths(view: Any) -> None:
    assert view.volume_info["unit"] == "\u00b5m"
    view.show(volume((1.0, 1.0, 1.0)))
    assert view.volume_info["unit"] == "voxels"


def test_the_page_decides_on_nothing_of_the_sliders_themselves() -> None:
    view = LiveView(volume())
    controls = ClipControls(view)
    controls.set_state({"view": None})
    assert controls.view is view


def test_the_studios_panel_has_the_sliders_of_its_view(view: Any) -> None:
    panel = DisplayPanel(Session(volume()), lambda edit: True, view, TransferEditor(volume()))
    assert panel.clip.view is view
    assert any(panel.clip in place.children for place in panel.box.children[0].children)
    panel.close()
    assert panel.clip.comm is None

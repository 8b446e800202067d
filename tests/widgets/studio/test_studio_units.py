"""The unit of lengths is the same wherever a studio shows one: head, status, scale bar, slices, tables and figures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from deformnb.io import read_volume, write_volume
from deformnb.volume.volume import Volume
from deformnb.widgets.packed_volume import unit_of
from deformnb.widgets.studio.head import StudioHead
from deformnb.widgets.studio.studio import Studio
from deformnb.widgets.view.volume_view import about

UNITS = [("mm", 1.0, "mm"), ("mm", 0.5, "mm"), ("\u00b5m", 1.0, "\u00b5m"), ("", 1.0, "voxels"), ("", 2.0, "")]


def block(unit: str, spacing: float) -> Volume:
    values = np.zeros((12, 14, 16), np.int16)
    values[3:9, 4:10, 4:12] = 300
    return Volume.from_array(values, spacing, unit=unit, name="block")


def visible_units(studio: Studio) -> dict[str, Any]:
    """The unit of each place that shows lengths now."""
    (head,) = (child for child in studio.children if isinstance(child, StudioHead))
    numbers = head.facts.split(" \u00b7 ")[1].split(" ")
    session = studio.session
    return {
        "head": numbers[5] if len(numbers) > 5 else "",
        "status": studio.editor.raster["lengths"],
        "scale bar": studio.view.volume_info["unit"],
        "scale bar of VTK": about(session.volume, session.results.grid)["unit"],
        "diagnostics": unit_of(session.editing.grid),
    }


@pytest.mark.parametrize(("unit", "spacing", "shown"), UNITS)
def test_all_places_show_one_unit(unit: str, spacing: float, shown: str) -> None:
    studio = Studio(block(unit, spacing), side="+y")
    try:
        assert set(visible_units(studio).values()) == {shown}
        for method in ("slice", "mean", "composite"):
            studio.session.pictures.method = method
            assert unit_of(studio.session.pictures.picture().grid) == shown
        studio.session.set_view("+x")
        studio.session.steps.add()
        assert unit_of(studio.session.pictures.picture().grid) == shown
        studio.session.steps.add(in_space=True)
        assert {pane["lengths"] for pane in studio.parts.editors.current.panes} == {shown}
    finally:
        studio.close()


def test_a_file_without_directions_names_axes_and_no_sides(tmp_path: Path) -> None:
    path = tmp_path / "plain.tif"
    write_volume(block("mm", 1.0), path)
    studio = Studio(read_volume(path), side="+y")
    try:
        assert studio.session.steps.titles() == ["along +y"]
        assert studio.view.volume_info["anatomical"] is False
    finally:
        studio.close()

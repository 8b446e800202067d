"""The subject of a picture and the side that shows most of a volume are those that the package finds."""

from __future__ import annotations

import numpy as np
import pytest
from scripts import run_script

from deformnb.datasets import PHANTOMS, thompson_plate
from deformnb.imaging.demo import subject_box
from deformnb.imaging.projection import project
from deformnb.session.inputs import best_view
from deformnb.volume.volume import Volume

FILES = ("volume/subject.ts", "volume/levels.ts", "volume/grid.ts")
SHAPE = (24, 32, 28)
VIEW = """(given) => given.map(({ values, shape, spacing, origin, direction }) => {
  const grid = checkGrid(shape, spacing, origin, direction);
  const volume = { name: "", grid, values: Uint8Array.from(values), dtype: "uint8", isLabels: false, notes: [] };
  return bestView(volume, measureLevels(volume));
})"""
BOX = "({ pixels, raster }) => subjectBox(pixels, raster)"


def as_given(volume: Volume) -> dict[str, object]:
    grid = volume.grid
    numbers = {"shape": grid.shape, "spacing": grid.spacing, "origin": grid.origin, "direction": grid.direction}
    return {"values": volume.values.ravel().tolist(), **numbers}


def test_the_side_is_the_one_that_a_studio_begins_with() -> None:
    volumes = [phantom.make(SHAPE) for phantom in PHANTOMS.values()]
    volumes = [volume for volume in volumes if volume.values.dtype == np.uint8]
    assert len(volumes) >= 5
    assert run_script(FILES, VIEW, [as_given(v) for v in volumes]) == [best_view(v) for v in volumes]
    assert len({best_view(volume) for volume in volumes}) > 1


@pytest.mark.parametrize("side", ["-x", "+y", "-z"])
def test_the_box_around_the_subject_is_that_of_the_package(side: str) -> None:
    picture = project(PHANTOMS["fish"].make((32, 64, 32)), side, "mip")
    raster = {"shape": picture.raster.shape, "spacing": picture.raster.spacing, "origin": picture.raster.origin}
    found = run_script(FILES, BOX, {"pixels": picture.values.ravel().tolist(), "raster": raster})
    assert found == pytest.approx(subject_box(picture))


def test_ink_on_paper_is_the_subject() -> None:
    plate = thompson_plate("Polyprion")
    raster = {"shape": plate.raster.shape, "spacing": (1, 1), "origin": plate.raster.origin}
    a0, a1, b0, b1 = run_script(FILES, BOX, {"pixels": plate.values.ravel().tolist(), "raster": raster})
    assert a0 < 20 < 420 < a1  # the lines of his grid are at 16 and 427
    assert b0 < 60 < 300 < b1


def test_an_even_picture_has_no_subject() -> None:
    raster = {"shape": (2, 3), "spacing": (1, 1), "origin": (0, 0)}
    assert run_script(FILES, BOX, {"pixels": [7] * 6, "raster": raster}) is None

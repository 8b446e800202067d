"""Previews of marked pictures: marks are at the places of points and lines."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from deformnb.imaging.preview import draw_preview
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture, Plane, Raster


def test_marks_lie_where_points_and_lines_are() -> None:
    plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    picture = Picture(np.zeros((30, 40), np.uint8), plane, Raster((30, 40), (1, 1), (0, 0)), "black", (0.0, 1.0))
    points = ControlPoints.from_arrays([[10.0, 10.0]], [[30.0, 20.0]])
    line = np.array([[-0.5, 5.0], [39.5, 5.0]])
    drawn = draw_preview(picture, [line], points, 408).astype(int)
    scale, low = 10.0, np.array([-0.9, -0.9])  # 40 wide with a hundredth of air on each side

    def at(a: float, b: float) -> NDArray[np.int64]:
        x, y = (np.array([a, b]) - low) * scale
        return drawn[round(y), round(x)]

    assert drawn.shape == (308, 408, 3)
    assert np.abs(at(30, 20) - [0xD5, 0x5E, 0x00]).max() < 12  # vermilion: where it goes
    assert at(20, 15).min() > 120  # the way there
    assert np.abs(at(20, 5) - [0xF2, 0xB1, 0x34]).max() < 90  # the grid
    assert at(35, 12).max() < 40

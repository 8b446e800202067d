"""Previews without a compiled program: alike to the ray caster's pictures, whichever side is looked at."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from deformnb.imaging.camera import Camera
from deformnb.imaging.core_volume import draw_core, draw_core_mip
from deformnb.imaging.preview import draw_marked, draw_slices, draw_slices_mip
from deformnb.rbf.points import ControlPoints
from deformnb.volume.clip import ClipBox
from deformnb.volume.plane import Picture, Plane, Raster
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume

SIZE = (60, 48)
DARK, LIGHT = (0.1, 0.1, 0.12), (0.9, 0.9, 0.9)
RED = TransferFunction(((0, 0.2, 0.1, 0.1), (255, 1.0, 0.4, 0.2)), ((60, 0.0), (140, 0.25)))


def body(spacing: tuple[float, float, float] = (1.0, 1.0, 1.0), direction: NDArray[np.float64] | None = None) -> Volume:
    """Three balls of different size and brightness, so that no turn or mirror leaves it as it is."""
    z, y, x = np.mgrid[:32, :36, :40].astype(float)
    values = np.zeros(z.shape)
    for centre, radius, bright in (((15, 17, 19), 9, 150), ((20, 10, 30), 5, 220), ((9, 26, 10), 4, 255)):
        far = np.sqrt(sum((a - c) ** 2 for a, c in zip((z, y, x), centre, strict=True)))
        values = np.maximum(values, bright * np.clip(radius - far, 0, 1))
    axes = np.eye(3) if direction is None else direction
    return Volume(values.astype(np.uint8), Grid(z.shape, spacing, (5.0, -3.0, 2.0), tuple(map(tuple, axes.tolist()))))


def camera(volume: Volume, direction: tuple[float, float, float], *, distance: float | None = None) -> Camera:
    plane = Plane.through(volume.grid.center, direction, (0.0, 0.1, 1.0))
    return Camera(plane, 46.0 * max(volume.grid.spacing), distance)


TURNED = np.array([[0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
DIRECTIONS = [(1.0, 0.2, -0.1), (-0.3, -1.0, 0.2), (0.2, 0.3, 1.0), (0.5, 0.7, -0.6)]


@pytest.mark.sampled(12)
@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("perspective", [None, 80.0])
@pytest.mark.parametrize(
    "volume", [body(), body((1.0, 1.0, 1.5)), body(direction=TURNED)], ids=["plain", "thick", "turned"]
)
def test_slices_give_the_picture_of_the_ray_caster(
    direction: tuple[float, float, float], perspective: float | None, volume: Volume
) -> None:
    seen = camera(volume, direction, distance=perspective)
    for is_lit, projection in ((False, "composite"), (True, "shaded")):
        wanted = draw_core(volume, seen, SIZE, RED, DARK, projection=projection).astype(float)
        found = draw_slices(volume, seen, SIZE, RED, DARK, is_lit=is_lit).astype(float)
        # A mirrored or shifted picture differs by 10 and more on average; slices and finer samples by edges alone.
        assert np.abs(found - wanted).mean() < 1.5
        assert np.corrcoef(found.ravel(), wanted.ravel())[0, 1] > 0.975


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_the_largest_value_is_that_of_the_ray_caster(direction: tuple[float, float, float]) -> None:
    volume = body()
    seen = camera(volume, direction, distance=70.0)
    wanted, found = (
        draw(volume, seen, SIZE, 200.0, LIGHT, DARK).astype(float) for draw in (draw_core_mip, draw_slices_mip)
    )
    assert np.abs(found - wanted).mean() < 2
    assert np.corrcoef(found.ravel(), wanted.ravel())[0, 1] > 0.99


def test_what_is_clipped_is_not_drawn() -> None:
    volume = body()
    seen = camera(volume, (0.0, 1.0, 0.0))
    part = ClipBox.of(volume.grid, ((0, 0.5), (0, 1), (0, 1)))
    clipped = draw_slices(volume, seen, SIZE, RED, DARK, part=part)
    emptied = draw_slices(part.mask_outside(volume), seen, SIZE, RED, DARK)
    assert (clipped != draw_slices(volume, seen, SIZE, RED, DARK)).any()
    assert np.abs(clipped.astype(int) - emptied).mean() < 1  # but for the light at the face


def test_what_is_behind_the_eye_is_not_drawn() -> None:
    volume = body()
    near = replace(camera(volume, (0.0, 1.0, 0.0)), distance=8.0)
    assert draw_slices(volume, near, SIZE, RED, DARK).shape == (SIZE[1], SIZE[0], 3)


def test_marks_lie_where_points_and_lines_are() -> None:
    plane = Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    picture = Picture(np.zeros((30, 40), np.uint8), plane, Raster((30, 40), (1, 1), (0, 0)), "black", (0.0, 1.0))
    points = ControlPoints.from_arrays([[10.0, 10.0]], [[30.0, 20.0]])
    line = np.array([[-0.5, 5.0], [39.5, 5.0]])
    drawn = draw_marked(picture, [line], points, 408).astype(int)
    scale, low = 10.0, np.array([-0.9, -0.9])  # 40 wide with a hundredth of air on each side

    def at(a: float, b: float) -> NDArray[np.int64]:
        x, y = (np.array([a, b]) - low) * scale
        return drawn[round(y), round(x)]

    assert drawn.shape == (308, 408, 3)
    assert np.abs(at(30, 20) - [0xD5, 0x5E, 0x00]).max() < 12  # vermilion: where it goes
    assert at(20, 15).min() > 120  # the way there
    assert np.abs(at(20, 5) - [0xF2, 0xB1, 0x34]).max() < 90  # the grid
    assert at(35, 12).max() < 40

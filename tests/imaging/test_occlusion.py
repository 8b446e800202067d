"""Ambient light against its definition, cell by cell, and its effect in the ray caster."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from deformnb.imaging.occlusion import ambient_light
from deformnb.imaging.projection import project
from deformnb.imaging.raycast import light_sampler
from deformnb.rbf.fields import Identity
from deformnb.volume.plane import Plane
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import warp

SOLID = TransferFunction(((0, 1, 1, 1),), ((0, 0), (100, 0.8)), unit=2.0)


def shell() -> Volume:
    """A thick shell around a hollow, open on one side."""
    z, y, x = np.indices((24, 22, 30)) - np.array([11.5, 10.5, 14.5]).reshape(3, 1, 1, 1)
    r = np.sqrt(x * x + y * y + z * z)
    return Volume(np.where((r < 14) & (r > 4) & (x < 8), 100, 0).astype(np.uint8), Grid((24, 22, 30), (1.0, 2.0, 1.5)))


def literal_light(volume: Volume, transfer: TransferFunction) -> NDArray[np.float64]:
    """The definition, one cell after the other."""
    opacity = 1 - (1 - transfer(volume.values)[..., 3]) ** (4 * min(volume.grid.spacing) / transfer.unit)
    cells = np.zeros([-(-n // 4) for n in volume.shape])
    for at in np.ndindex(*cells.shape):
        cells[at] = opacity[tuple(slice(4 * k, 4 * k + 4) for k in at)].mean()

    def mean(values: NDArray[np.float64], r: int) -> NDArray[np.float64]:
        padded = np.pad(values, r)
        return np.array(
            [
                [
                    [
                        padded[i : i + 2 * r + 1, j : j + 2 * r + 1, k : k + 2 * r + 1].mean()
                        for k in range(values.shape[2])
                    ]
                    for j in range(values.shape[1])
                ]
                for i in range(values.shape[0])
            ]
        )

    near = mean(cells, 1)
    far = mean(mean(near, 3), 3)

    def value(values: NDArray[np.float64], at: NDArray[np.float64]) -> float:
        low, total = np.floor(at).astype(int), 0.0
        for corner in np.ndindex(2, 2, 2):
            node = low + corner
            if (node >= 0).all() and (node < values.shape).all():
                total += values[tuple(node)] * np.prod(1 - np.abs(at - node))
        return float(total)

    light = np.empty_like(cells)
    for at in np.ndindex(*cells.shape):
        slope = np.array([(value(near, at + step) - value(near, at - step)) / 2 for step in np.eye(3)])
        ahead = at - 3 * slope / max(np.linalg.norm(slope), 0.04)
        light[at] = np.exp(-value(near, ahead) - 4 * value(far, ahead))
    return light


@pytest.mark.parametrize("kind", [np.uint8, np.float32])
def test_ambient_light_is_what_the_mean_opacity_around_a_cell_leaves(kind: type) -> None:
    volume = shell()
    light = ambient_light(Volume(volume.values.astype(kind), volume.grid), SOLID)
    np.testing.assert_allclose(light.values, literal_light(volume, SOLID), atol=2e-6)  # float32
    assert light.values.min() < 0.9
    # A cell is in the middle of its voxels.
    np.testing.assert_allclose(light.grid.index_to_point([0, 0, 0]), volume.grid.index_to_point([1.5, 1.5, 1.5]))


def test_full_light_changes_no_picture_and_none_leaves_what_the_lamp_reaches() -> None:
    rising = np.arange(50, 170, 10, np.uint8)[:, None, None] * np.ones((12, 12), np.uint8)
    volume = Volume(rising, Grid((12, 12, 12)))
    cells = Grid((3, 3, 3), (4.0, 4.0, 4.0), (1.5, 1.5, 1.5))
    opaque = TransferFunction(((0, 1, 1, 1),), ((0, 1), (100, 1)))
    plane = Plane.from_view(volume.grid, "+z")

    def rendering(light: float | None, method: str = "shaded", volume: Volume = volume) -> NDArray[np.float32]:
        ambience = None if light is None else Volume(np.full((3, 3, 3), light, np.float32), cells)
        return np.asarray(project(volume, plane, method, transfer=opaque, spacing=1.0, ambience=ambience).values)

    np.testing.assert_array_equal(rendering(1.0), rendering(None))
    np.testing.assert_array_equal(rendering(0.2, "composite"), rendering(None, "composite"))  # which is not lit
    # A slope along the ray: (0.35 + gloss) of its light is ambient, and 58 % of that of the lamp, 0.75 cos.
    lamp = 0.82 / np.linalg.norm([0.35, 0.45, 0.82])
    gloss = rendering(None)[6, 6, 0] - 0.35 - 0.75 * lamp
    wanted = 0.4 * (0.35 + gloss) + (0.42 + 0.58 * 0.4) * 0.75 * lamp
    np.testing.assert_allclose(rendering(0.4)[6, 6, :3], wanted, atol=1e-5)
    even = Volume(np.full((12, 12, 12), 100, np.uint8), volume.grid)
    np.testing.assert_allclose(rendering(0.4, volume=even)[6, 6, :3], 0.8 * (0.3 + 0.7 * 0.4), atol=1e-5)


def test_ambient_light_is_interpolated_where_it_is_looked_up() -> None:
    volume = shell()
    light = ambient_light(volume, SOLID)
    plane = Plane.from_normal(volume.grid.center, (1.0, 2.0, -0.5))
    index = np.random.default_rng(0).uniform(0, np.array(light.shape[::-1]) - 1, (40, 3))
    places = plane.to_plane(light.grid.index_to_point(index))
    found = light_sampler(light, plane)((places[:, 0], places[:, 1], places[:, 2]))
    wanted = literal_lookup(light, index)
    np.testing.assert_allclose(found, wanted, atol=1e-5)


def literal_lookup(light: Volume, index: NDArray[np.float64]) -> NDArray[np.float64]:
    """The light at some indices, trilinear, one after the other."""
    found = []
    for at in index:
        one = Grid((1, 1, 1), light.grid.spacing, tuple(light.grid.index_to_point(at)), light.grid.direction)
        found.append(float(warp(light, Identity(3), output=one).values[0, 0, 0]))
    return np.array(found)

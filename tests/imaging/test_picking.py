"""The first visible surface along a ray: analytic spheres, clipping, deformation and every method."""

from __future__ import annotations

import numpy as np
import pytest

from deformnb.errors import DeformError
from deformnb.imaging.picking import surface_point
from deformnb.rbf.fitting import fit_rbf
from deformnb.rbf.points import ControlPoints
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume

CENTER, RADIUS = np.array([21.0, 18.0, 30.0]), 11.0
OPAQUE = TransferFunction(((0, 0, 0, 0), (250, 1, 1, 1)), ((125, 0), (125, 1)))
FAINT = TransferFunction(((0, 0, 0, 0), (250, 1, 1, 1)), ((125, 0), (125, 0.004)))


def ball(direction: np.ndarray | None = None) -> Volume:
    """A ball with a linear edge one length wide, on an oblique grid of unequal voxels if a direction is given."""
    axes = np.eye(3) if direction is None else direction
    shape, spacing = (44, 50, 40), (1.0, 0.8, 1.3)
    middle = axes @ (np.array(spacing) * (np.array(shape[::-1]) - 1) / 2)
    grid = Grid(shape, spacing, tuple(CENTER - middle), tuple(map(tuple, axes)))
    z, y, x = np.indices(shape)
    far = np.linalg.norm(grid.index_to_point(np.stack([x, y, z], axis=-1)) - CENTER, axis=-1)
    return Volume(np.clip(125 - 125 * (far - RADIUS), 0, 250).astype(np.uint8), grid, "ball")


def turned() -> np.ndarray:
    a, b = 0.5, 0.3
    one = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1.0]])
    return one @ np.array([[1.0, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]])


def entry(start: np.ndarray, way: np.ndarray) -> np.ndarray:
    """The first place of a ray on the sphere."""
    way = way / np.linalg.norm(way)
    along = float((CENTER - start) @ way)
    aside2 = float(((CENTER - start) ** 2).sum()) - along**2
    return np.asarray(start + (along - np.sqrt(RADIUS**2 - aside2)) * way)


@pytest.mark.parametrize("axes", [None, turned()])
@pytest.mark.parametrize("way", [(0, 1, 0), (1, 0.4, -0.3), (-0.2, 0.1, 1)])
@pytest.mark.parametrize("aside", [(0, 0, 0), (3, 1, -2)])
def test_a_ray_meets_a_sphere_where_it_enters(axes: np.ndarray | None, way: tuple, aside: tuple) -> None:
    start = CENTER + np.array(aside) - 40 * np.array(way)
    found = surface_point(ball(axes), (start, way), OPAQUE)
    assert found is not None
    np.testing.assert_allclose(found, entry(start, np.array(way, float)), atol=0.45)  # half of a voxel
    again = surface_point(ball(axes), (found, np.array(way) * 7), OPAQUE)  # what is behind its start counts too
    np.testing.assert_allclose(again, found, atol=0.7)


def test_a_ray_that_misses_meets_nothing() -> None:
    for way, aside in (((0, 1, 0), RADIUS + 2), ((0, 0, 1), 500)):
        for method in ("composite", "mip"):
            assert surface_point(ball(), (CENTER + np.array([aside, 0, 0]), way), OPAQUE, method=method) is None


def test_half_of_the_light_is_stopped_at_a_depth_that_the_opacity_gives() -> None:
    for alpha in (0.05, 0.2):
        soft = TransferFunction(((0, 0, 0, 0), (250, 1, 1, 1)), ((125, 0), (125, alpha)), unit=0.7)
        found = surface_point(ball(), (CENTER, (0, 1, 0)), soft)
        depth = 0.7 * np.log(0.5) / np.log(1 - alpha)
        assert found is not None
        assert found[1] - (CENTER[1] - RADIUS) == pytest.approx(depth, abs=0.6)


def test_where_half_is_never_reached_the_largest_contribution_counts() -> None:
    values = np.zeros((8, 30, 8), np.uint8)
    values[:, 6], values[:, 20] = 150, 250
    rising = TransferFunction(((0, 0, 0, 0), (250, 1, 1, 1)), ((100, 0), (250, 0.2)))
    found = surface_point(values, ([4, 0, 4], [0, 1, 0]), rising)
    np.testing.assert_allclose(found, [4, 20, 4], atol=0.01)
    through = surface_point(ball(), (CENTER, (0, 1, 0)), FAINT)
    assert through is not None
    assert abs(through[1] - CENTER[1]) <= RADIUS + 0.5


def test_a_maximum_is_the_first_of_the_largest_values() -> None:
    values = np.zeros((8, 30, 8), np.uint8)
    values[:, 6], values[:, 20], values[:, 24] = 150, 250, 250
    np.testing.assert_allclose(surface_point(values, ([4, 0, 4], [0, 1, 0]), method="mip"), [4, 20, 4], atol=0.01)


def test_what_is_cut_away_is_not_seen() -> None:
    volume = ball()
    found = surface_point(volume, (CENTER, (0, 1, 0)), OPAQUE, clip=((0, 1), (0.5, 1), (0, 1)))
    np.testing.assert_allclose(found, CENTER, atol=0.5)  # the face of the cut


def test_the_deformed_volume_is_met() -> None:
    by = np.array([2.0, -3.0, 4.0])
    field = fit_rbf(ControlPoints.from_arrays([CENTER], [CENTER + by]), trend="translation")
    start = CENTER + by
    found = surface_point(ball(), (start, (0, 1, 0)), OPAQUE, field=field)
    np.testing.assert_allclose(found, entry(CENTER, np.array([0, 1.0, 0])) + by, atol=0.5)


def test_a_ray_needs_a_direction_and_a_known_method() -> None:
    with pytest.raises(DeformError, match="a place and a direction"):
        surface_point(ball(), (CENTER, (0, 0, 0)), OPAQUE)
    with pytest.raises(DeformError, match="choose composite"):
        surface_point(ball(), (CENTER, (0, 1, 0)), OPAQUE, method="slice")

"""Folds in the ray caster are found from its maps, as by the determinant in Python."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scripts import run_script

FILES = ("webgl/fold_mesh.ts", "webgl/volume_blocks.ts")
ROWS, COLUMNS, SPACING = 24, 30, (2.0, 1.5)

PLANAR = """({ maps, shape, spacing, weights, count }) => {
    const planar = { maps: Float32Array.from(maps), shape, spacing, weights: Float32Array.from(weights) };
    return planarFolds(planar, count, planarSlopes(planar.maps, shape, spacing)); }"""


def bump(height: float, width: float = 9.0) -> np.ndarray:
    """Displacements along the columns by a smooth bump: they fold where its slope is less than -1."""
    b, a = np.meshgrid(np.arange(ROWS) * SPACING[1], np.arange(COLUMNS) * SPACING[0], indexing="ij")
    move = height * np.exp(-((a - 25) ** 2 + (b - 18) ** 2) / width**2)
    return np.stack([move, 0 * move], axis=-1)


def planar_folds(maps: list[np.ndarray], weights: list[list[float]], count: int = 1) -> bool:
    data: dict[str, Any] = {
        "maps": np.stack(maps).ravel().tolist(),
        "shape": [len(maps), ROWS, COLUMNS],
        "spacing": SPACING,
        "weights": np.ravel(weights).tolist(),
        "count": count,
    }
    return bool(run_script(FILES, PLANAR, data))


STEEPEST = np.sqrt(2 / np.e) / 9.0  # of a bump of height 1


@pytest.mark.parametrize("share", [0.5, 0.9, 1.15, 3.0])
def test_one_map_folds_where_its_slope_passes_one(share: float) -> None:
    assert planar_folds([bump(share / STEEPEST)], [[1.0]]) == (share > 1)


def test_a_map_folds_at_the_weight_that_folds() -> None:
    map_ = bump(2 / STEEPEST)
    assert not planar_folds([map_], [[0.0, 0.2, 0.4]])
    assert planar_folds([map_], [[0.0, 0.2, 0.7]])
    assert not planar_folds([map_], [[-0.3, 0.3]])
    # A half turn keeps areas, and so does none; half of it takes all to one line.
    a, b = np.meshgrid(np.arange(COLUMNS) * SPACING[0], np.arange(ROWS) * SPACING[1])
    half = -2 * np.stack([a - 20, b - 20], axis=-1)
    assert not planar_folds([half], [[1.0, 1.0]])
    assert planar_folds([half], [[0.0, 1.0]])


def test_several_maps_fold_where_their_sum_does_also_between_the_knots() -> None:
    up, down = bump(0.7 / STEEPEST), bump(-0.7 / STEEPEST)
    assert not planar_folds([up, down], [[1.0, 1.0], [1.0, 1.0]], count=2)  # one takes back what the other does
    assert not planar_folds([up, down], [[1.0, 0.0], [0.0, 1.0]], count=2)
    assert planar_folds([up, up], [[1.0, 1.0], [1.0, 1.0]], count=2)
    # Two half turns about one place are none, and one keeps areas: between them lies what takes all to a line.
    a, b = np.meshgrid(np.arange(COLUMNS) * SPACING[0], np.arange(ROWS) * SPACING[1])
    half = -np.stack([a - 20, b - 20], axis=-1)
    assert planar_folds([half, half], [[0.0, 1.0], [0.0, 1.0]], count=2)
    assert not planar_folds([half, half], [[0.0, 0.4], [0.0, 0.4]], count=2)


def test_any_region_counts() -> None:
    fine, bad = bump(0.3 / STEEPEST), bump(2 / STEEPEST)
    assert planar_folds([fine, bad], [[1.0]])
    assert not planar_folds([fine, fine], [[1.0, 0.0], [0.0, 1.0]], count=2)
    assert planar_folds([fine, bad], [[1.0, 0.0], [0.0, 1.0]], count=2)


@pytest.mark.parametrize(("share", "folds"), [(0.8, False), (1.5, True)])
def test_in_space_too(share: float, folds: bool) -> None:
    n, h = 16, (1.0, 2.0, 1.5)
    z, y, x = np.meshgrid(*(np.arange(n) * s for s in h[::-1]), indexing="ij")
    move = 0.75 * share / STEEPEST * np.exp(-((x - 8) ** 2 + (y - 16) ** 2 + (z - 12) ** 2) / 6.75**2)
    for axis in range(3):
        values = np.zeros((n, n, n, 3))
        values[..., axis] = move
        found = run_script(
            FILES,
            "([v, shape, h]) => spaceFolds(Float32Array.from(v), shape, h)",
            [values.ravel().tolist(), [n, n, n], h],
        )
        assert found == folds

"""Compiled distances to outlines against those of NumPy, edge by edge."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deformnb.native import library
from deformnb.native.edges import edge_distances
from deformnb.rbf.regions import Line, Polygon

pytestmark = pytest.mark.skipif(library.loops() is None, reason=f"no compiled loops: {library.why_absent()}")

ANGLES = 0.1 + np.arange(40) / 40 * 2 * np.pi
OUTLINES = {
    "a line of one edge": Line(((10.0, 250.0), (12.0, -1.0))),
    "a line with a corner": Line(((0.0, 0.0), (20.0, 5.0), (22.0, 40.0))),
    "a square": Polygon(((0.0, 0.0), (20.0, 0.0), (20.0, 40.0), (0.0, 40.0))),
    "a star": Polygon(
        tuple(map(tuple, (15 + 8 * np.sin(5 * ANGLES))[:, None] * np.stack([np.cos(ANGLES), np.sin(ANGLES)], -1)))
    ),
}


@pytest.fixture(params=library.levels(), autouse=True)
def level(request: pytest.FixtureRequest) -> Any:
    before = library.use_level(request.param)
    yield request.param
    library.use_level(before)


@pytest.mark.parametrize("count", [0, 1, 100, 1000])
@pytest.mark.parametrize("name", OUTLINES)
def test_distances_are_those_of_numpy(name: str, count: int, level: str) -> None:
    places = np.random.default_rng(count).uniform(-60, 60, (count, 2))
    places[: count // 10] = np.round(places[: count // 10])  # on corners and straight in line with edges
    found = OUTLINES[name].signed_distance(places)
    library.use_level("off")
    pieces = [OUTLINES[name].signed_distance(some) for some in np.array_split(places, 1 + count // 50)]
    library.use_level(level)
    np.testing.assert_array_equal(found, np.concatenate(pieces))


def test_the_shape_of_points_is_kept_and_no_number_has_no_side() -> None:
    line = OUTLINES["a line with a corner"]
    grid = np.stack(np.meshgrid(np.arange(30.0), np.arange(40.0)), axis=-1)
    assert line.signed_distance(grid).shape == (40, 30)
    assert line.signed_distance(grid[::2, ::-1]).tolist() == line.signed_distance(grid)[::2, ::-1].tolist()
    assert line.signed_distance([[np.nan, 0.0], [np.inf, 0.0]]).tolist()[0] == np.inf


def test_arrays_that_do_not_fit_are_refused() -> None:
    edges = [np.zeros((2, 2)), np.ones((2, 2)), np.zeros(2), np.ones(2), np.ones((2, 3, 2))]
    assert edge_distances(edges, np.ones((5, 2))).shape == (5,)
    for k, wrong in enumerate([np.zeros((2, 3)), np.ones((3, 2)), np.zeros(1), np.ones((2, 1)), np.ones((2, 2, 3))]):
        with pytest.raises(ValueError, match="no edges"):
            edge_distances([*edges[:k], wrong, *edges[k + 1 :]], np.ones((5, 2)))
    with pytest.raises(ValueError, match="no edges"):
        edge_distances(edges, np.ones((5, 3)))
    library.use_level("off")
    with pytest.raises(ValueError, match="no loops"):
        edge_distances(edges, np.ones((5, 2)))

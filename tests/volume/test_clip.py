"""Clips: valid arguments, the voxels of a part, and the places of its sides."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from deformnb.errors import DeformError
from deformnb.volume.clip import WHOLE, ClipBox, check_clip
from deformnb.volume.volume import Grid, Volume

TURNED = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
GRID = Grid((4, 6, 10), (0.5, 1.0, 2.0), (3.0, -4.0, 5.0), TURNED)


@pytest.mark.parametrize(
    "value",
    [
        None,
        3,
        "clip",
        [],
        [(0, 1), (0, 1)],
        [(0, 1)] * 4,
        [(0, 1, 1)] * 3,
        [(0, 1), (0, 1), (0, "a")],
        [(0, 1), (0, 1), (0.5, 0.5)],
        [(0, 1), (0, 1), (0.6, 0.5)],
        [(-0.1, 1), (0, 1), (0, 1)],
        [(0, 1.1), (0, 1), (0, 1)],
        [(0, float("nan")), (0, 1), (0, 1)],
        [(0, 1), (0, 1), None],
    ],
)
def test_what_is_no_clip_is_refused(value: Any) -> None:
    with pytest.raises(DeformError, match=r"three pairs|shares of a clip"):
        check_clip(value)


def test_a_clip_is_plain_numbers_whatever_it_came_as() -> None:
    wanted = ((0.0, 0.5), (0.25, 1.0), (0.0, 1.0))
    assert check_clip(np.array(wanted)) == check_clip([[-0.0, 0.5], (0.25, 1), [0, 1]]) == wanted
    assert all(type(share) is float for pair in check_clip(np.array(wanted)) for share in pair)


@pytest.mark.parametrize(
    ("axis", "pair", "wanted"),
    [
        (0, (0.0, 0.3), [0, 1, 2]),
        (0, (0.7, 1.0), [7, 8, 9]),
        (1, (0.5, 1.0), [3, 4, 5]),
        (1, (0.0, 0.5), [0, 1, 2]),
        (2, (0.25, 0.75), [1, 2]),
        (2, (0.0, 0.25), [0]),
    ],
)
def test_shares_count_along_the_index_axes(axis: int, pair: tuple[float, float], wanted: list[int]) -> None:
    clip = [list(p) for p in WHOLE]
    clip[axis] = list(pair)
    part = ClipBox.of(GRID, check_clip(clip))
    assert part is not None
    held = part.contains(GRID)
    rows = np.moveaxis(held, 2 - axis, 0).reshape(GRID.shape[2 - axis], -1)
    assert np.flatnonzero(rows.all(axis=1)).tolist() == wanted
    assert np.flatnonzero(rows.any(axis=1)).tolist() == wanted


def test_nothing_cut_away_is_no_part() -> None:
    assert ClipBox.of(GRID, WHOLE) is None


def test_shares_are_of_the_box_that_is_seen() -> None:
    larger = GRID.crop((-4, 0, 0), (8, 6, 10))  # twice as far along z, below
    part = ClipBox.of(GRID, ((0.0, 1.0), (0.0, 1.0), (0.5, 1.0)), larger)
    assert part is not None
    assert part.low == (-np.inf, -np.inf, -0.5)
    assert part.contains(GRID).all()
    assert part.contains(larger)[:4].any() == np.False_


def test_a_lattice_that_is_turned_is_held_where_its_places_are() -> None:
    part = ClipBox.of(GRID, ((0.2, 0.8), (0.0, 0.6), (0.3, 1.0)))
    assert part is not None
    other = Grid((7, 8, 9), (0.9, 0.8, 0.7), tuple(GRID.center), ((0.8, -0.6, 0.0), (0.6, 0.8, 0.0), (0.0, 0.0, 1.0)))
    index = np.moveaxis(np.indices(other.shape)[::-1], 0, -1)
    at = GRID.point_to_index(other.index_to_point(index))
    assert (part.contains(other) == ((at >= part.low) & (at < part.high)).all(axis=-1)).all()
    assert 0 < part.contains(other).mean() < 1


def test_a_voxel_outside_becomes_background() -> None:
    volume = Volume(np.arange(240, dtype=np.int16).reshape(GRID.shape) + 7, GRID)
    part = ClipBox.of(GRID, ((0.0, 0.5), (0.0, 1.0), (0.0, 1.0)))
    assert part is not None
    emptied = part.mask_outside(volume).values
    assert (emptied[..., :5] == volume.values[..., :5]).all()
    assert (emptied[..., 5:] == 7).all()
    assert emptied.dtype == np.int16


def test_sides_look_inwards() -> None:
    part = ClipBox.of(GRID, ((0.1, 1.0), (0.0, 0.5), (0.0, 1.0)))
    assert part is not None
    points, inward = part.sides()
    middle = GRID.index_to_point([5.0, 1.0, 1.0])
    depth = ((middle - points) * inward).sum(axis=-1)
    assert (depth > 0).all()
    np.testing.assert_allclose(depth[0], (5.0 - 0.5) * 0.5)  # from the side at x = 0.5 voxels, which are 0.5 wide
    np.testing.assert_allclose(depth[4], (2.5 - 1.0) * 1.0)
    assert (depth[[1, 2, 3, 5]] > 1e5).all()  # open

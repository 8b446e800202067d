"""Means over blocks of voxels, against the literal mean of each block."""

from __future__ import annotations

import numpy as np
import pytest

from deformnb.volume.coarsening import block_means

KINDS = (np.uint8, np.int8, np.uint16, np.int16, np.int32, np.float32, np.float64)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("factors", [(1, 1, 1), (2, 1, 1), (1, 3, 2), (4, 2, 3), (9, 9, 9)])
def test_blocks_have_their_means_also_where_they_are_cut_off(kind: type, factors: tuple[int, int, int]) -> None:
    values = np.random.default_rng(1).integers(-128, 128, (5, 6, 7)).astype(kind)
    found, (fx, fy, fz) = block_means(values, factors), factors
    assert found.shape == tuple(-(-n // f) for n, f in zip(values.shape, (fz, fy, fx), strict=True))
    for z, y, x in np.ndindex(found.shape):
        block = values[z * fz : (z + 1) * fz, y * fy : (y + 1) * fy, x * fx : (x + 1) * fx]
        assert found[z, y, x] == np.float32(block.mean(dtype=np.float64))  # sums of so few whole numbers are exact


@pytest.mark.parametrize("kind", [np.uint8, np.int8, np.uint16, np.int16])
def test_sums_of_extreme_values_do_not_overflow(kind: type) -> None:
    for extreme in (np.iinfo(kind).min, np.iinfo(kind).max):
        assert (block_means(np.full((8, 8, 8), extreme, kind), (8, 8, 8)) == extreme).all()

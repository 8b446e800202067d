"""Tissue that a cut hides is replaced by the background, in every voxel type."""

from __future__ import annotations

import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st

from deformnb.volume.volume import DTYPES
from deformnb.warping.warper import apply_opacity

SHARES = np.array([[1.0, 0.75, 0.5], [0.4999, 0.001, 0.0]])


@pytest.mark.parametrize("dtype", [d for d in DTYPES if d != "bool"])
def test_shown_is_the_mixture_with_the_background(dtype: str) -> None:
    high = 100 if dtype == "int8" else 200
    values = np.full((2, 3), high, dtype)
    wanted = 3 + SHARES * (high - 3)
    found = apply_opacity(values.copy(), SHARES, np.dtype(dtype).type(3), discrete=False)
    assert found.dtype == dtype
    if np.dtype(dtype).kind == "f":
        oracle.assert_close(found, wanted, atol=2e-5)
    else:
        assert (found == np.floor(wanted + 0.5)).all()


@pytest.mark.parametrize("dtype", ["uint8", "bool", "int32", "float32"])
def test_labels_are_shown_from_one_half_on(dtype: str) -> None:
    values = np.full((2, 3), 1, dtype)
    found = apply_opacity(values, SHARES, np.dtype(dtype).type(0), discrete=True)
    assert found.astype(int).tolist() == [[1, 1, 1], [0, 0, 0]]
    assert found.dtype == dtype


@given(st.integers(0, 2**32 - 1))
def test_what_is_opaque_keeps_every_bit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    values, share = rng.normal(0, 1e9, (4, 5)), rng.choice([0.0, 0.3, 1.0], (4, 5))
    found = apply_opacity(values.copy(), share, np.float64(-1024), discrete=False)
    assert (found[share == 1] == values[share == 1]).all()
    assert (found[share == 0] == -1024).all()


def test_rows_and_channels_fade_together() -> None:
    values = np.random.default_rng(0).random((2, 3, 4))
    found = apply_opacity(values.copy(), SHARES, np.float64(0), discrete=False)
    oracle.assert_close(found, values * SHARES[..., None], atol=1e-15)


def test_memory_is_used_where_it_may_be() -> None:
    values = np.ones((2, 3))
    assert apply_opacity(values, np.ones((2, 3)), np.float64(0), discrete=False) is values
    assert apply_opacity(values, SHARES, np.float64(0), discrete=False) is values
    fixed = np.ones((2, 3))
    fixed.flags.writeable = False
    assert apply_opacity(fixed, SHARES, np.float64(0), discrete=False)[1, 2] == 0
    assert (fixed == 1).all()


@pytest.mark.allow_nan
@pytest.mark.parametrize("fill", [np.nan, np.inf, -np.inf])
def test_a_background_that_is_no_number_mixes_with_nothing(fill: float) -> None:
    found = apply_opacity(np.full((2, 3), 5.0), SHARES, np.float64(fill), discrete=False)
    assert np.array_equal(found, [[5.0, 5.0, 5.0], [fill] * 3], equal_nan=True)


def test_extreme_integers_do_not_overflow() -> None:
    low, high = np.iinfo(np.int32).min, np.iinfo(np.int32).max
    found = apply_opacity(np.array([high, high], np.int32), np.array([1.0, 0.5]), np.int32(low), discrete=False)
    assert found.tolist() == [high, 0]

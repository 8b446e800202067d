"""Reading between voxels: theorems over METHODS, and each kernel's small parts against their definitions."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from deformnb._jax import float64
from deformnb.volume import sampling
from deformnb.volume.sampling import METHODS, Axis


def _value(method: str, row: np.ndarray, place: float) -> float:
    """The value at one place of a row of voxels, by the taps of a method, in float64."""
    with float64():
        whole = int(np.floor(place))
        axis = Axis(len(row), 1, jnp.asarray(whole, jnp.int32), jnp.asarray(place - whole))
        source = sampling.spline_coefficients(row, "float64", axes=(0,)) if METHODS[method].is_spline else row
        taps = METHODS[method].taps(axis)
        return float(
            sum(source[int(index) + step] * (1.0 if weight is None else float(weight)) for index, step, weight in taps)
        )


@pytest.mark.parametrize("method", METHODS)
def test_every_method_goes_through_the_voxels(method: str) -> None:
    row = np.random.default_rng(0).random(7)
    # 1e-12: the spline's recursive filter rounds a few times per voxel
    assert [_value(method, row, k) for k in range(7)] == pytest.approx(row.tolist(), abs=1e-12)


@pytest.mark.parametrize("method", METHODS)
@given(place=st.floats(-0.5, 6.49), n=st.integers(2, 7))
def test_weights_sum_to_one_and_indices_are_voxels(method: str, place: float, n: int) -> None:
    place = min(place, n - 0.51)
    whole = int(np.floor(place))
    with float64():
        taps = METHODS[method].taps(Axis(n, 1, jnp.asarray(whole, jnp.int32), jnp.asarray(place - whole)))
        assert all(0 <= int(index) + step < n for index, step, _ in taps)
        assert sum(1.0 if weight is None else float(weight) for *_, weight in taps) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize(("method", "order"), [("linear", 1), ("cubic", 3)])
@given(place=st.floats(0, 6), seed=st.integers(0, 9))
def test_one_axis_equals_scipy(method: str, order: int, place: float, seed: int) -> None:
    row = np.random.default_rng(seed).random(7)
    expected = ndimage.map_coordinates(row, [[place]], order=order, mode="mirror")[0]
    assert _value(method, row, place) == pytest.approx(expected, abs=1e-12)


def test_halves_go_to_the_upper_voxel() -> None:
    index, fraction = sampling.split(0, jnp.asarray([-0.5, 0.49, 0.5, 1.5, 2.5]))
    axis = Axis(4, 1, index, fraction)
    assert sampling.rounded_index(axis).tolist() == [0, 0, 1, 2, 3]


def test_outside_begins_half_a_voxel_beyond_the_outermost_centres() -> None:
    places = np.array([-0.50001, -0.5, 0.0, 3.49999, 3.5, 1e6, -1e6])
    whole = np.floor(places)
    axis = Axis(4, 1, jnp.asarray(whole, jnp.int32), jnp.asarray(places - whole, jnp.float32))
    assert np.asarray(sampling.inside([axis])).tolist() == [False, True, True, True, False, False, False]


@given(whole=st.integers(-(2**29), 2**29), move=st.floats(-1e4, 1e4, width=32))
def test_split_keeps_the_place(whole: int, move: float) -> None:
    index, fraction = sampling.split(jnp.asarray(whole, jnp.int32), jnp.asarray(move, jnp.float32))
    assert 0 <= float(fraction) <= 1
    # 2^-24: a fraction rounded to float32, once
    assert int(index) - whole + float(fraction) == pytest.approx(move, abs=2**-24)


def _round(values: np.ndarray, dtype: str, method: str = "linear") -> np.ndarray:
    return np.asarray(sampling.to_voxel_type(jnp.asarray(values, jnp.float32), True, np.dtype(dtype).type(0), method))


def test_bytes_are_rounded_as_other_integers_are() -> None:
    values = np.concatenate([np.arange(0, 255, 1 / 64), np.arange(256), [255.0]]).astype(np.float32)
    assert (_round(values, "uint8") == np.floor(values + 0.5)).all()
    assert (_round(values, "int16") == np.floor(values + 0.5)).all()


def test_overshoot_of_the_spline_is_clipped_to_the_type() -> None:
    assert _round(np.array([-3.0, 12.4, 300.0]), "uint8", "cubic").tolist() == [0, 12, 255]
    assert _round(np.array([-129.0, 0.6, 128.0]), "int8", "cubic").tolist() == [-128, 1, 127]


@pytest.mark.parametrize("shape", [(5, 6, 7), (1, 6, 7), (2, 1, 1), (1, 1, 1)])
def test_spline_coefficients_equal_scipys(shape: tuple[int, int, int]) -> None:
    values = np.random.default_rng(1).random(shape)
    expected = ndimage.spline_filter(values, order=3, mode="mirror")
    assert np.abs(sampling.spline_coefficients(values, "float64") - expected).max() < 1e-14


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
def test_aligned_memory_is_shared_and_other_memory_is_copied(dtype: str) -> None:
    aligned = sampling.aligned_empty((3, 5), np.dtype(dtype))
    aligned[...] = np.arange(15).reshape(3, 5)
    assert sampling.to_device(aligned).unsafe_buffer_pointer() == aligned.ctypes.data
    for other in (aligned[1:], aligned.T, aligned[:, ::-1]):
        array = sampling.to_device(other)
        assert array.unsafe_buffer_pointer() != other.ctypes.data
        assert (np.asarray(array) == other).all()


@pytest.mark.parametrize(
    ("dtype", "size", "wide"),
    [("uint8", 8, False), ("float32", 8, False), ("int32", 8, True), ("float64", 8, True), ("uint8", 2**31, True)],
)
def test_64_bits_only_where_they_are_needed(dtype: str, size: int, wide: bool) -> None:
    with sampling.arithmetic(np.dtype(dtype), size):
        assert (jnp.asarray(np.zeros(1)).dtype == np.float64) is wide


def test_a_large_index_does_not_blur_the_fraction() -> None:
    # 1000 + 0.1 as one float32 is wrong by 2e-5; stored separately, by less than 1e-8
    index, fraction = sampling.split(jnp.asarray(1000, jnp.int32), jnp.asarray(0.1, jnp.float32))
    assert (int(index), float(fraction)) == (1000, pytest.approx(0.1, abs=1e-8))

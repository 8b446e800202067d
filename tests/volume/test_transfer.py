"""Transfer functions: interpolation, opacity by thickness, presets that fit every volume, and errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import oracle
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from skimage.filters import threshold_otsu

from deformnb.datasets import PHANTOMS
from deformnb.errors import DeformError
from deformnb.volume.transfer import (
    PRESETS,
    TransferFunction,
    histogram,
    levels,
    preset,
    smallest_measurement,
    typical_range,
)
from deformnb.volume.volume import Volume

RAMP = TransferFunction(((0, 0, 0, 0), (10, 1, 0.5, 0), (20, 1, 1, 1)), ((0, 0), (20, 0.5)), unit=2.0)
SMALL = {
    "bar": (24, 16, 32),
    "fish": (24, 48, 24),
    "knee": (40, 32, 24),
    "lobster": (14, 48, 40),
    "head": (32, 36, 28),
    "horse": (32, 40, 16),
    "abdomen": (28, 24, 32),
}


def volume_of(values: Any) -> Volume:
    return Volume.from_array(np.asarray(values))


# ---- the function ----------------------------------------------------------------------------------------------------


@given(value=st.floats(-50, 50))
def test_values_between_nodes_are_interpolated_and_those_beyond_are_clamped(value: float) -> None:
    v = min(max(value, 0.0), 20.0)
    red, green, blue = (v / 10, v / 20, 0.0) if v < 10 else (1.0, v / 20, (v - 10) / 10)
    oracle.assert_close(RAMP(value), [red, green, blue, v / 40], atol=1e-12)


FUNCTIONS = st.builds(
    lambda colors, opacities: TransferFunction(tuple(sorted(colors)), tuple(sorted(opacities))),
    st.lists(st.tuples(st.integers(-30, 130).map(float), *[st.floats(0, 1)] * 3), min_size=1, max_size=9),
    st.lists(st.tuples(st.integers(-30, 130).map(float), st.floats(0, 1)), min_size=1, max_size=9),
)


@given(function=FUNCTIONS)
def test_knots_are_the_function_itself_with_its_jumps(function: TransferFunction) -> None:
    values, rgba = function.knots()
    assert (np.diff(values) >= 0).all()
    assert max(np.unique(values, return_counts=True)[1]) <= 2
    places = np.concatenate([np.arange(-35, 135), np.nextafter(np.arange(-35.0, 135), -np.inf)])
    read = np.stack([np.interp(places, values, rgba[:, c]) for c in range(4)], axis=-1)
    oracle.assert_close(read, function(places), atol=1e-9)


@given(function=FUNCTIONS, low=st.floats(-40, 60), width=st.floats(1, 500))
def test_a_table_is_read_linearly_within_the_bound_that_it_states(
    function: TransferFunction, low: float, width: float
) -> None:
    table = function.table(low, low + width)
    each = (len(table) - 1) // 255
    assert len(table) == 255 * each + 1 <= 2048
    at = np.linspace(low, low + width, len(table))
    oracle.assert_close(table[::each], function(np.linspace(low, low + width, 256)), atol=1e-6)
    values, rgba = function.knots()
    apart = width / (255 * each)
    change = np.diff(rgba, axis=0)[(values[1:] >= low) & (values[:-1] <= low + width)]
    length = np.diff(values)[(values[1:] >= low) & (values[:-1] <= low + width)]
    assert each == 8 or (length[(change != 0).any(axis=1)] >= 16 * apart).all()
    places = np.random.default_rng(1).uniform(low, low + width, 500)
    read = np.stack([np.interp(places, at, table[:, c]) for c in range(4)], axis=-1)
    # Where nodes are farther apart than two entries a node lies in every second interval at most: its bend is h/4.
    near = np.abs(places[:, None] - values).min(axis=1) <= apart
    oracle.assert_close(read[~near], function(places[~near]), atol=2e-6)
    if (length > 0).all() and len(length):
        steepest = np.abs(change / length[:, None]).max(initial=0)
        assert np.abs(read - function(places)).max() <= 2 * steepest * apart / 4 * (1 + len(values)) + 2e-6


def test_one_node_is_a_constant() -> None:
    one = TransferFunction(((5, 0.1, 0.2, 0.3),), ((9, 0.4),))
    oracle.assert_close(one([-1e9, 5, 1e9]), [[0.1, 0.2, 0.3, 0.4]] * 3, atol=1e-12)


def test_a_step_is_two_nodes_at_one_value() -> None:
    step = TransferFunction(((0, 1, 1, 1),), ((0, 0), (5, 0), (5, 1), (9, 1)))
    assert step([4.999, 5.0, 5.001])[:, 3].tolist()[::2] == [0, 1]


# ---- errors, clipped values --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "nodes",
    [
        ((2, 0, 0, 0), (1, 1, 1, 1)),
        ((0, 0, 0, np.nan),),
        ((np.inf, 0, 0, 0),),
        (),
        ((0, 0, 0),),
        ((0, 0, 0, 0, 0),),
        (1, 2, 3, 4),
    ],
)
def test_wrong_colours_are_refused_by_name(nodes: Any) -> None:
    with pytest.raises(DeformError, match="colors"):
        TransferFunction(nodes, ((0, 0),))


@pytest.mark.parametrize("nodes", [((2, 0), (1, 1)), ((0, np.nan),), ((np.nan, 0),), (), ((0, 0, 0),), ((0,),)])
def test_wrong_opacities_are_refused_by_name(nodes: Any) -> None:
    with pytest.raises(DeformError, match="opacities"):
        TransferFunction(((0, 0, 0, 0),), nodes)


@pytest.mark.parametrize("unit", [0.0, -1.0, np.nan, np.inf])
def test_a_wrong_unit_is_refused(unit: float) -> None:
    with pytest.raises(DeformError, match="unit thickness"):
        TransferFunction(((0, 0, 0, 0),), ((0, 0),), unit)


def test_numbers_beyond_0_to_1_are_clipped_and_said_once() -> None:
    clipped = TransferFunction(((0, -0.5, 0, 300.0),), ((0, 0.4), (1, 1.5)))
    assert clipped.colors == ((0, 0, 0, 1),)
    assert clipped.opacities == ((0, 0.4), (1, 1))
    assert clipped.notes == ("colours and opacities were clipped to 0 to 1",)
    assert clipped.scaled(2).notes == clipped.notes
    assert RAMP.notes == RAMP.scaled(0.5).notes == ()
    assert RAMP.scaled(3).opacities == ((0, 0), (20, 1))
    assert RAMP.scaled(3).notes == clipped.notes
    assert RAMP.scaled(0.5).opacities == ((0, 0), (20, 0.25))
    assert RAMP.scaled(0.5).unit == RAMP.unit


def test_an_unknown_preset_lists_the_presets() -> None:
    with pytest.raises(DeformError, match="unknown transfer function 'no such'.*" + ", ".join(PRESETS)):
        preset("no such", volume_of(np.zeros((2, 2, 2))))


# ---- levels ----------------------------------------------------------------------------------------------------------


def otsu_of_histogram(values: np.ndarray) -> tuple[float, float | None]:
    """The two thresholds by scikit-image, of the same 256 bins; the second is None where one bin is left."""
    counts, edges = np.histogram(values, bins=256, range=(values.min(), values.max()))
    centres = (edges[:-1] + edges[1:]) / 2
    first = threshold_otsu(hist=(counts, centres))
    above = centres > first
    if np.count_nonzero(counts[above]) < 2:
        return first, None
    return first, threshold_otsu(hist=(counts[above], centres[above]))


@pytest.mark.parametrize("name", PHANTOMS)
def test_levels_are_those_of_scikit_image(name: str) -> None:
    volume = PHANTOMS[name].make(SMALL[name])
    low, air, dense, high = levels(volume)
    assert (air, dense) == pytest.approx(otsu_of_histogram(volume.values), rel=1e-12)
    assert low == volume.values.min()
    assert low < air < dense < high <= volume.values.max()


def variance_between(centres: np.ndarray, counts: np.ndarray, threshold: float) -> float:
    """The variance between the two classes of a histogram, which Otsu's threshold makes largest."""
    parts = [(counts[part], centres[part]) for part in (centres <= threshold, centres > threshold)]
    (n, a), (m, b) = ((n.sum(), np.average(c, weights=n)) for n, c in parts)
    return float(n * m * (a - b) ** 2)


@example(numbers=[705, 705, -907, 1225, 1745, 1755], dtype="float64")  # as good at 705 as at 1225
@given(
    numbers=st.lists(st.integers(-1000, 3000), min_size=3, max_size=60).filter(lambda v: len(set(v)) > 2),
    dtype=st.sampled_from(["float64", "int16"]),
)
def test_levels_of_any_few_values_are_those_of_scikit_image(numbers: list[int], dtype: str) -> None:
    values = np.array(numbers, dtype).reshape(1, 1, -1)
    found = levels(volume_of(values))
    first, second = otsu_of_histogram(values)
    # Where several bins are equally good, each may take another.
    counts, edges = np.histogram(values, bins=256, range=(values.min(), values.max()))
    centres = (edges[:-1] + edges[1:]) / 2
    for mine, theirs, part in ((found[1], first, centres > -np.inf), (found[2], second, centres > first)):
        if theirs is None:
            continue
        ours, best = (variance_between(centres[part], counts[part], t) for t in (mine, theirs))
        assert ours == pytest.approx(best, rel=1e-9)
    assert found[0] == values.min()
    assert found[0] < found[1] <= found[2] <= found[3] <= values.max()


def test_negative_hounsfield_units_split_into_air_tissue_and_bone() -> None:
    values = np.full((8, 10, 10), -1000, np.int16)
    values[1:7, 1:9, 1:9] = 40
    values[3:5, 3:6, 3:6] = 1200
    low, air, dense, high = levels(volume_of(values))
    assert low == -1000
    assert -1000 < air < 40 <= dense < 1200
    assert high == pytest.approx(1200, abs=5)  # the middle of the last of 256 bins


def test_one_spot_denser_than_all_else_is_not_the_scale() -> None:
    values = np.zeros((4, 100, 100), np.float32)
    values[:, 20:80, 20:80] = np.random.default_rng(3).uniform(90, 110, (4, 60, 60))
    values[0, 50, 50] = 1000
    assert levels(volume_of(values))[3] < 150


@pytest.mark.parametrize("hot", [1e6, -1e6, 1e30, 3000.0])
@pytest.mark.parametrize("name", ["fish", "head"])
def test_one_hot_voxel_changes_no_level_and_no_preset(name: str, hot: float) -> None:
    values = PHANTOMS[name].make(SMALL[name]).values.astype(np.float32)
    spotted = values.copy()
    spotted[0, 3, 3] = hot  # where there is air
    plain, other = volume_of(values), volume_of(spotted)
    assert typical_range(plain) == plain.value_range
    if abs(hot) > 16 * np.ptp(plain.value_range):
        assert typical_range(other) == plain.value_range
        width = np.ptp(plain.value_range) / 256
        oracle.assert_close(levels(other), levels(plain), atol=0.01 * width)
        for kind in PRESETS:
            at = np.linspace(*plain.value_range, 50)
            oracle.assert_close(preset(kind, other)(at), preset(kind, plain)(at), atol=1e-3)


def test_hot_voxels_of_several_sizes_are_left_out_and_a_spot_on_even_ground_is_not() -> None:
    values = np.random.default_rng(2).uniform(0, 100, (32, 32, 32))
    values[0, 0, :3] = 1e4, 1e7, 1e300
    assert typical_range(volume_of(values))[1] < 100
    even = np.zeros((32, 32, 32), np.float32)
    even[3, 3, 3] = 1e6
    assert typical_range(volume_of(even)) == (0, 1e6)
    body = values.copy()
    body[:4, :4, :4] = 1e6  # 64 voxels of 32 768: no outliers
    assert typical_range(volume_of(body))[1] == 1e6


@pytest.mark.parametrize("dtype", ["uint8", "bool"])
def test_bytes_have_no_outliers(dtype: str) -> None:
    values = np.zeros((16, 16, 16), dtype)
    values[0, 0, 0] = 1
    assert typical_range(volume_of(values)) == (0, 1)


@pytest.mark.parametrize("value", [0, -1000, 5, 1e30, np.nan])
def test_a_constant_volume_has_one_level(value: float) -> None:
    found = levels(volume_of(np.full((2, 3, 4), value, np.float32)))
    assert set(found) == {0.0 if np.isnan(value) else float(np.float32(value))}


@pytest.mark.parametrize(
    "values",
    [
        np.array([0, 1], bool),
        np.array([0, 255], np.uint8),
        np.array([-128, 127], np.int8),
        np.array([0, 65535], np.uint16),
        np.array([-(2**31), 2**31 - 1], np.int32),
        np.array([1, np.nextafter(np.float32(1), 2)], np.float32),
        np.array([0, 5e-324]),
        np.array([-1e300, 1e300]),
        np.array([0, np.nan, 1, np.inf], np.float32),
    ],
)
def test_levels_of_two_values_lie_between_them(values: np.ndarray) -> None:
    low, air, dense, high = levels(volume_of(values.reshape(1, 1, -1)))
    finite = values[np.isfinite(values)] if values.dtype.kind == "f" else values
    assert low == finite.min()
    assert low <= air <= dense <= high <= finite.max()


def test_a_subject_in_slices_that_are_not_looked_at_is_survived() -> None:
    values = np.zeros((128, 2, 2), np.uint8)
    values[65] = 200  # every second slice is sampled
    assert levels(volume_of(values))[0] == 0
    for make in PRESETS.values():
        assert make(volume_of(values))([200.0])[0, 3] > 0


# ---- presets ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", PHANTOMS)
@pytest.mark.parametrize("kind", PRESETS)
def test_presets_leave_air_empty_and_show_the_dense(kind: str, name: str) -> None:
    volume = PHANTOMS[name].make(SMALL[name])
    function = preset(kind, volume)
    low, _, dense, high = levels(volume)
    assert function.notes == ()
    assert function.unit == pytest.approx(min(volume.grid.lengths) / 100)
    alpha = function(np.linspace(low, high, 200))[:, 3]
    assert alpha[0] == 0
    assert (np.diff(alpha) >= 0).all()
    assert alpha[-1] > 0.05
    # A body as thick as the shortest edge: bones are always visible, and only the surface hides tissue behind it.
    through = 1 - (1 - function([dense + 0.5 * (high - dense)])[0, 3]) ** 100
    assert through > 0.5


@pytest.mark.parametrize("kind", PRESETS)
@pytest.mark.parametrize(
    "values",
    [
        np.zeros((2, 2, 2)),
        np.full((1, 1, 1), -1000.0),
        np.array([[[0, 1]]], np.uint8),
        np.array([[[False, True]]]),
        np.full((2, 2, 2), np.nan),
        np.array([[[0, 1e300]]]),
        np.array([[[-1024, -1023]]], np.int16),
    ],
    ids=["zero", "one voxel", "two values", "bool", "nan", "huge", "two close values"],
)
def test_presets_are_valid_for_poor_volumes(kind: str, values: np.ndarray) -> None:
    function = preset(kind, volume_of(values))
    table = function.table(*volume_of(values).value_range)
    assert np.isfinite(table).all()
    assert 0 <= table.min() <= table.max() <= 1


@pytest.mark.parametrize("kind", ["bone", "muscle"])
def test_hounsfield_units_are_known_for_what_they_are(kind: str) -> None:
    # A trunk: half air, fat and lean in equal parts, few bones; Otsu's second threshold is then below zero.
    parts = [(-1000.0, 500), (-100.0, 230), (50.0, 230), (500.0, 38), (1500.0, 2)]
    volume = volume_of(np.repeat([v for v, _ in parts], [n for _, n in parts]).reshape(10, 10, 10).astype(np.int16))
    assert levels(volume)[2] < 50
    air, fat, lean, bone, dense = preset(kind, volume)([v for v, _ in parts])[:, 3]
    assert air == 0
    assert fat <= lean < 0.05
    assert 0.5 < bone < dense
    if kind == "muscle":
        assert 0 < fat < lean / 2
    else:
        assert lean == 0


def trunk(air: int = -1000, scale: int = 1) -> np.ndarray:
    """A trunk of fat, lean and bone in air with noise, in Hounsfield units: 16 slices of 40 x 40."""
    rows, columns = np.mgrid[-1:1:40j, -1:1:40j]
    slices = np.full((16, 40, 40), -1000)
    for radius, value in ((0.8, -100), (0.65, 50), (0.2, 700)):
        slices[:, np.hypot(rows, columns) < radius] = value
    noise = np.random.default_rng(5).normal(0, 12, slices.shape)
    return ((slices + noise.round().astype(int) + 1000) * scale + air).astype(np.int16)


def outside_circle() -> np.ndarray:
    return np.asarray(np.hypot(*np.mgrid[-1:1:40j, -1:1:40j]) > 1)


@pytest.mark.parametrize("padding", [-2000, -3024, -32768])
@pytest.mark.parametrize("kind", PRESETS)
def test_padding_of_hounsfield_units_changes_no_level_and_no_preset(kind: str, padding: int) -> None:
    plain = trunk()
    padded = plain.copy()
    padded[:, outside_circle()] = padding
    assert smallest_measurement(volume_of(padded)) == padded[padded > padding].min()
    oracle.assert_close(levels(volume_of(padded)), levels(volume_of(plain)), atol=40)
    assert typical_range(volume_of(padded))[0] > -1100
    assert preset(kind, volume_of(padded))([padding, -1000.0])[:, 3].tolist() == [0, 0]
    tissue = np.array([-100.0, 50.0, 700.0])
    oracle.assert_close(preset(kind, volume_of(padded))(tissue), preset(kind, volume_of(plain))(tissue), atol=0.02)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_one_value_outside_of_a_scanners_circle_is_padding_on_any_scale(axis: int) -> None:
    values = trunk(air=300, scale=2)
    values[:, outside_circle()] = -700
    volume = volume_of(np.moveaxis(values, 0, axis))
    assert 200 < smallest_measurement(volume) < 300
    _, air, _, _ = levels(volume)
    assert 300 < air < 300 + 2 * 900
    assert preset("surface", volume)([-700.0, 300.0])[:, 3].tolist() == [0, 0]


def test_the_air_around_a_body_and_values_in_between_are_no_padding() -> None:
    body = np.zeros((16, 40, 40), np.int16)
    body[:, 8:32, 5:35] = np.random.default_rng(4).integers(90, 110, (16, 24, 30))
    assert smallest_measurement(volume_of(body)) == 0
    spread = np.random.default_rng(4).integers(-30000, 30000, (9, 9, 9)).astype(np.int16)
    assert smallest_measurement(volume_of(spread)) == spread.min()
    labels = np.zeros((8, 40, 40), np.int16)
    labels[:, ~outside_circle()] = 3
    assert smallest_measurement(Volume.from_array(labels, is_labels=True)) == 0


def test_a_ct_starts_with_bone_in_translucent_skin() -> None:
    function = preset("specimen", volume_of(trunk()))
    foam, fat, lean, bone = function([-900.0, -80.0, 50.0, 700.0])[:, 3]
    assert foam == 0
    assert 0 < fat <= lean < 0.015  # a trunk is about 80 layers thick: more than a third of the light goes through
    assert bone > 0.5


@pytest.mark.parametrize("kind", PRESETS)
def test_air_with_noise_leaves_no_haze(kind: str) -> None:
    values = np.random.default_rng(6).integers(0, 20, (20, 30, 30)).astype(np.uint8)
    values[5:15, 5:25, 5:25] = 120
    values[8:12, 10:20, 10:20] = 230
    assert preset(kind, volume_of(values))(np.arange(20.0))[:, 3].tolist() == [0] * 20


# ---- histogram and other opacities -----------------------------------------------------------------------------------


def test_a_histogram_counts_every_value_once() -> None:
    values = np.random.default_rng(3).integers(-50, 50, (20, 9, 8)).astype(np.int16)
    found = histogram(volume_of(values), -50.5, 49.5, 100)
    np.testing.assert_array_equal(found.counts, np.histogram(values, 100, (-50.5, 49.5))[0])
    assert (found.slices, found.total, found.is_sampled) == (20, 20, False)


def test_values_beyond_the_range_of_a_histogram_are_left_out() -> None:
    found = histogram(volume_of([[[0.0, 1.0, 2.0, 3.0, 9.0, np.nan]]]), 1.0, 3.0, 2)
    assert found.counts.tolist() == [1, 2]


def test_a_histogram_of_many_slices_looks_at_some() -> None:
    values = np.broadcast_to(np.arange(300, dtype=np.int16)[:, None, None], (300, 2, 2))
    found = histogram(volume_of(values), -0.5, 299.5, 300, slices=30)
    np.testing.assert_array_equal(np.flatnonzero(found.counts), np.arange(0, 300, 10))
    assert (found.slices, found.total, found.is_sampled) == (30, 300, True)


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.0), (2.0, 1.0), (np.nan, 1.0)])
def test_a_histogram_needs_a_range(low: float, high: float) -> None:
    with pytest.raises(DeformError, match="range"):
        histogram(volume_of([[[1, 2]]]), low, high)


def test_other_opacities_keep_colours_and_unit() -> None:
    other = RAMP.with_opacities([[3, 0.1], (4, 1.5)])
    assert (other.colors, other.unit, other.opacities) == (RAMP.colors, 2.0, ((3, 0.1), (4, 1.0)))
    assert len(other.notes) == 1
    with pytest.raises(DeformError, match="opacities"):
        RAMP.with_opacities([(4, 0), (3, 1)])


# ---- colours and window ----------------------------------------------------------------------------------------------


def test_other_colours_keep_opacities_and_unit() -> None:
    painted = RAMP.with_colors([(-5, "#ff8000"), (7.5, (0, 0.25, 1))])
    assert painted.colors == ((-5.0, 1.0, 128 / 255, 0.0), (7.5, 0.0, 0.25, 1.0))
    assert (painted.opacities, painted.unit) == (RAMP.opacities, RAMP.unit)


@pytest.mark.parametrize(
    ("stops", "words"),
    [
        ([(0, "red")], "#rrggbb"),
        ([(0, "#12345g")], "#rrggbb"),
        ([(0, "#1234567")], "#rrggbb"),
        ([(0, 3)], "pairs"),
        ([0], "pairs"),
        ([(0, (1, 1))], "4 finite numbers"),
        ([], "4 finite"),
        ([(3, "#000000"), (0, "#000000")], "rise"),
        ([(float("nan"), "#000000")], "finite"),
    ],
)
def test_wrong_stops_are_refused(stops: Any, words: str) -> None:
    with pytest.raises(DeformError, match=words):
        RAMP.with_colors(stops)


@given(low=st.floats(-3000, 3000), width=st.floats(1e-3, 5000), share=st.floats(0, 1))
def test_a_window_stretches_all_nodes_alike(low: float, width: float, share: float) -> None:
    wide = TransferFunction(((0, 0, 0, 0), (10, 1, 0.5, 0), (20, 1, 1, 1)), ((-20, 0), (3, 0.2), (20, 0.5)), unit=2.0)
    moved = wide.windowed(low, low + width)
    assert wide.window == (-20, 20)
    assert moved.window == (low, low + width)
    assert moved.unit == 2.0
    oracle.assert_close(moved(low + share * width), wide(-20 + 40 * share), atol=1e-6)
    oracle.assert_close(np.array(moved.windowed(-20, 20).opacities), np.array(wide.opacities), atol=1e-6)


@pytest.mark.parametrize("window", [(1, 1), (2, 1), (0, float("inf")), (float("nan"), 1)])
def test_a_window_rises(window: Any) -> None:
    with pytest.raises(DeformError, match="rise"):
        RAMP.windowed(*window)


def test_nodes_at_one_value_have_no_window_to_stretch() -> None:
    with pytest.raises(DeformError, match="no width"):
        TransferFunction(((5, 1, 1, 1),), ((5, 0.5),)).windowed(0, 1)


@pytest.mark.parametrize("noise", [0, 8])
def test_the_specimen_shows_fins_thinner_than_a_voxel_and_no_noise_of_air(noise: int) -> None:
    values = np.random.default_rng(0).integers(0, noise + 1, (40, 40, 40))
    values[10:30, 10:30, 10:30] = 120
    values[14:26, 14:26, 14:26] = 240
    values[20, 20, 30:38] = 30  # a quarter of the body: below the edge between air and tissue
    volume = Volume.from_array(values.astype(np.uint8))
    _, edge, _, _ = levels(volume)
    assert edge > 30
    alphas = preset("specimen", volume)([noise, 30, 120])[:, 3]
    assert alphas[0] == 0
    assert 0 < alphas[1] <= alphas[2]

"""The warp against a literal loop, scipy and SimpleITK; short cuts against the general way; pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise, product
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import oracle
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage
from voxelwise import interpolate_nodes

from deformnb import devices
from deformnb.errors import Cancelled, DeformError
from deformnb.native import library
from deformnb.rbf.extrusion import EXTRUSIONS, Extrusion, extrude, interpolate, modulate, replicate
from deformnb.rbf.fields import AbstractField, Affine, DisplacementField, Identity, compose
from deformnb.volume import sampling
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.sampling import METHODS
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import DTYPES, Grid, Volume
from deformnb.warping import planning
from deformnb.warping.warper import Warper, warp, warp_picture

RANGE_SHARE = 2e-6
"""The promise: float32 results differ from SimpleITK's by at most this share of the value range."""


@partial(jax.tree_util.register_dataclass, data_fields=[], meta_fields=["amplitude", "frequency", "dim"])
@dataclass(frozen=True)
class Wave(AbstractField):
    """Smooth displacements known in closed form: amplitude * sin(frequency x + phase), each component its own."""

    amplitude: float = 1.0
    frequency: float = 0.3
    dim: int = 3  # type: ignore[misc]

    def jax_displacement(self, points: Any) -> Any:
        return self._at(jnp.asarray(points), jnp)

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        return np.asarray(self._at(np.asarray(points, dtype=np.float64), np))

    def _at(self, x: Any, xp: Any) -> Any:
        weights = np.array([1.0, 0.7, -0.4])[: self.dim]
        phase = np.arange(self.dim)
        return self.amplitude * xp.sin(self.frequency * (x @ weights)[..., None] + phase)


def rotation(seed: int) -> tuple[tuple[float, ...], ...]:
    q = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    return tuple(tuple(row) for row in q)


STRAIGHT = Grid((6, 7, 9))
OBLIQUE = Grid((6, 7, 9), (0.7, 1.3, 2.1), (-40.0, 25.0, 8.0), rotation(4))  # type: ignore[arg-type]
FLIPPED = Grid((6, 7, 9), (0.5, 1.0, 2.0), (3.0, -2.0, 1.0), ((0, -1, 0), (0, 0, 1), (-1, 0, 0)))


def noise(grid: Grid, dtype: str = "float32", seed: int = 0) -> Volume:
    values = np.random.default_rng(seed).random(grid.shape) * (200 if dtype != "bool" else 2)
    return Volume(values.astype(dtype), grid)


def scattered(grid: Grid, voxels: float = 1.5, seed: int = 1) -> DisplacementField:
    """Displacements without any smoothness, of some voxels; exact in float32."""
    size = voxels * min(grid.spacing)
    values = np.random.default_rng(seed).normal(size=(*grid.shape, 3)) * size
    return DisplacementField(values.astype(np.float32).astype(np.float64), grid)


def slow_warp(volume: Volume, field: AbstractField, output: Grid, fill: float, method: str) -> NDArray[np.float64]:
    """The definition, voxel by voxel, in float64."""
    places, values = lookup(volume.grid, field, output), volume.values.astype(np.float64)
    far = tuple(np.minimum((2, 3, 1), np.subtract(output.shape, 1)))
    for k, j, i in ((0, 0, 0), far):  # a field has the same value at a place alone and among others
        x = output.index_to_point([i, j, k])
        alone = volume.grid.point_to_index(x + field.displacement(x[None])[0])[::-1]
        assert places[k, j, i] == pytest.approx(alone, abs=1e-9)
    result = np.empty(output.shape)
    for voxel in np.ndindex(output.shape):
        result[voxel] = read(values, places[voxel], fill, method)
    return result


def read(values: NDArray[np.float64], place: NDArray[np.float64], fill: float, method: str) -> float:
    n = np.array(values.shape)
    if ((place < -0.5) | (place >= n - 0.5)).any():
        return fill
    if method == "nearest":
        return float(values[tuple(np.floor(place + 0.5).astype(int))])
    place = np.clip(place, 0, n - 1)
    low = np.floor(place).astype(int)
    total = 0.0
    for corner in product((0, 1), repeat=3):
        weight = np.prod([t if c else 1 - t for c, t in zip(corner, place - low, strict=True)])
        total += weight * values[tuple(np.minimum(low + corner, n - 1))]
    return float(total)


def centres(grid: Grid) -> NDArray[np.float64]:
    """The centres (nz, ny, nx, 3) of all voxels."""
    return grid.index_to_point(np.moveaxis(np.indices(grid.shape)[::-1], 0, -1))


def lookup(grid: Grid, field: AbstractField, output: Grid | None = None) -> NDArray[np.float64]:
    """Place in a volume at which each voxel of the output is sampled, as an index (z, y, x)."""
    points = centres(output or grid)
    return grid.point_to_index(points + field.displacement(points))[..., ::-1]


def between_centres(place: NDArray[np.float64], grid: Grid) -> NDArray[np.bool_]:
    """True where a place is between the outermost voxel centres."""
    return np.asarray(((place >= 0) & (place <= np.array(grid.shape) - 1)).all(axis=-1))


# -- the definition --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("grid", [STRAIGHT, OBLIQUE, FLIPPED])
@pytest.mark.parametrize("method", ["nearest", "linear"])
@pytest.mark.parametrize("step", [1, 3])
def test_the_definition(grid: Grid, method: str, step: int) -> None:
    volume, field = noise(grid), scattered(grid) if step == 1 else Wave(2.0, 0.02)
    result = warp(volume, field, fill=-7.0, method=method, step=step).values
    expected = slow_warp(volume, field, grid, -7.0, method)
    if step == 1:
        assert np.abs(result - expected).max() <= RANGE_SHARE * 200
    else:  # h^2/8 |D''| < 0.004 voxels of displacement: nearly every voxel is as good as exact
        assert np.mean(np.abs(result - expected) <= 0.004 * 3 * 200) > 0.98
    assert (result == -7.0).any() or step > 1


@pytest.mark.parametrize(
    "output",
    [
        Grid((5, 6, 8), (0.9, 0.8, 1.1), (-39.0, 25.5, 9.0), rotation(9)),  # type: ignore[arg-type]
        OBLIQUE.resampled(spacing=(0.35, 2.6, 1.0), margin=1.5),
        OBLIQUE.crop((2, -1, 3), (3, 9, 5)),
    ],
)
@pytest.mark.parametrize("method", ["nearest", "linear"])
def test_another_field_of_view_and_resolution(output: Grid, method: str) -> None:
    volume, field = noise(OBLIQUE), Wave(1.0)
    result = warp(volume, field, output=output, fill=0.0, method=method)
    expected = slow_warp(volume, field, output, 0.0, method)
    assert result.grid == output
    # where nearest is on the edge between two voxels, or linear on the rim, rounding decides
    assert np.mean(np.abs(result.values - expected) <= 2 * RANGE_SHARE * 200) > 0.999


def test_default_fill_is_the_background() -> None:
    volume = Volume(np.full(STRAIGHT.shape, 9, np.int16), STRAIGHT)
    volume.values[3, 4, 5] = -1000
    far = Volume(np.zeros((1, 1, 1), np.int16), STRAIGHT.crop((0, 0, 90), (1, 1, 1))).grid
    assert warp(volume, Identity(), output=far).values.tolist() == [[[-1000]]]
    assert warp(volume, Identity(), output=far, fill=5).values.tolist() == [[[5]]]


def test_cubic_equals_scipy_inside() -> None:
    volume, field = noise(OBLIQUE), scattered(OBLIQUE)
    result = warp(volume, field, method="cubic").values
    place = lookup(OBLIQUE, field)
    voxels = volume.values.astype(np.float64)
    expected = ndimage.map_coordinates(voxels, np.moveaxis(place, -1, 0), order=3, mode="mirror")
    inside = between_centres(place, OBLIQUE)
    assert 0.2 < inside.mean() < 0.9
    # the spline of noise is three times as steep as the line between voxels
    assert np.abs(result - expected)[inside].max() <= 3 * RANGE_SHARE * 200


# -- SimpleITK -------------------------------------------------------------------------------------------------------

SITK = {"nearest": "sitkNearestNeighbor", "linear": "sitkLinear", "cubic": "sitkBSpline"}


def itk_image(grid: Grid, array: NDArray[Any], *, vector: bool = False) -> Any:
    sitk = pytest.importorskip("SimpleITK")
    image = sitk.GetImageFromArray(array, isVector=vector)
    image.SetSpacing(grid.spacing)
    image.SetOrigin(grid.origin)
    image.SetDirection(np.ravel(grid.direction).tolist())
    return image


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("grid", [STRAIGHT, OBLIQUE])
def test_simpleitk_warp(grid: Grid, method: str) -> None:
    sitk = pytest.importorskip("SimpleITK")
    volume, field = noise(grid), scattered(grid)
    warper = sitk.WarpImageFilter()
    warper.SetInterpolator(getattr(sitk, SITK[method]))
    warper.SetEdgePaddingValue(-3.0)
    image = itk_image(grid, volume.values)
    warper.SetOutputParameteresFromImage(image)
    expected = sitk.GetArrayFromImage(warper.Execute(image, itk_image(grid, np.asarray(field.values), vector=True)))
    result = warp(volume, field, fill=-3.0, method=method).values
    error = np.abs(result - expected)
    if METHODS[method].is_spline:
        # In the half voxel beyond the centres ITK continues along the mirrored spline, we hold the value of the edge as
        # with every other method. The spline of noise is three times as steep as the line.
        assert error[between_centres(lookup(grid, field), grid)].max() <= 3 * RANGE_SHARE * 200
        assert ((result == -3) == (expected == -3)).all()
    else:
        assert error.max() <= RANGE_SHARE * 200
    assert 0.05 < (expected == -3).mean() < 0.7


@pytest.mark.parametrize("method", ["nearest", "linear"])
def test_simpleitk_resample_through_a_displacement_field(method: str) -> None:
    sitk = pytest.importorskip("SimpleITK")
    output = Grid((8, 10, 9), (0.8, 1.1, 1.7), (-39.0, 24.0, 9.0), rotation(4))  # type: ignore[arg-type]
    volume, field = noise(OBLIQUE), scattered(output)
    transform = sitk.DisplacementFieldTransform(itk_image(output, np.asarray(field.values), vector=True))
    reference = itk_image(output, np.zeros(output.shape, np.float32))
    image = sitk.Resample(itk_image(OBLIQUE, volume.values), reference, transform, getattr(sitk, SITK[method]), -3.0)
    result = warp(volume, field, output=output, fill=-3.0, method=method).values
    assert np.abs(result - sitk.GetArrayFromImage(image)).max() <= RANGE_SHARE * 200


def test_large_displacements_on_a_long_axis_stay_within_the_promise() -> None:
    # one float32 per place would give errors of 3e-5 voxels here
    sitk = pytest.importorskip("SimpleITK")
    grid = Grid((3, 4, 900), (0.73, 1.0, 1.0), (0.1, 0.2, 0.3))
    volume = noise(grid)
    values = np.zeros((*grid.shape, 3))
    values[..., 0] = np.random.default_rng(3).uniform(-8, 8, grid.shape).astype(np.float32)
    field = DisplacementField(values, grid)
    warper = sitk.WarpImageFilter()
    image = itk_image(grid, volume.values)
    warper.SetOutputParameteresFromImage(image)
    warper.SetEdgePaddingValue(0.0)
    expected = sitk.GetArrayFromImage(warper.Execute(image, itk_image(grid, values, vector=True)))
    assert np.abs(warp(volume, field, fill=0.0).values - expected).max() <= RANGE_SHARE * 200


# -- the short cuts --------------------------------------------------------------------------------------------------

RULES: dict[str, tuple[int, Any]] = {
    "replicate": (1, replicate()),
    "modulate": (1, modulate("sin(pi*z)")),
    "interpolate": (3, interpolate([0.1, 0.4, 1.0])),
}


def extruded(plane: Plane, grid: Grid, rule: str, size: float = 1.5) -> Extrusion:
    count, weights = RULES[rule]
    return extrude(plane, grid, [Wave(size * (k + 1) / count, 0.2, dim=2) for k in range(count)], weights)


def ways(volume: Volume, field: Extrusion, **options: Any) -> list[NDArray[Any]]:
    """The result of every kernel that may be used for an extruded field: in place, rows prepared."""
    warper = Warper(volume, **options)
    results = [warper(field).values]
    for axis in range(3):
        warper.prepare(axis)
    return [*results, warper(field).values]


def test_every_rule_is_tested() -> None:
    assert set(RULES) == set(EXTRUSIONS)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("grid", [STRAIGHT, OBLIQUE, FLIPPED])
def test_short_cuts_follow_the_definition(grid: Grid, view: str, rule: str) -> None:
    field = extruded(Plane.from_view(grid, view), grid, rule)
    assert planning.plan_extrusion(field, grid, grid, "float32") is not None
    volume = noise(grid)
    for method in ("linear", "nearest"):
        expected = slow_warp(volume, field, grid, -7.0, method)
        for result in ways(volume, field, fill=-7.0, method=method):
            assert np.mean(np.abs(result - expected) <= 2 * RANGE_SHARE * 200) > 0.999  # rounding decides on the rim


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("view", ["+x", "-y", "+z"])
def test_short_cuts_into_a_part_or_another_resolution(view: str, rule: str) -> None:
    field = extruded(Plane.from_view(OBLIQUE, view), OBLIQUE, rule)
    axis = planning.shared_axis(field.plane, OBLIQUE, OBLIQUE)
    assert axis is not None
    finer = [s / 2 for s in OBLIQUE.spacing]
    finer[2 - axis] = OBLIQUE.spacing[2 - axis]
    for output in (OBLIQUE.crop((1, 2, 3), (4, 5, 6)), OBLIQUE.resampled(spacing=finer)):
        assert planning.plan_extrusion(field, OBLIQUE, output, "float32") is not None
        expected = slow_warp(noise(OBLIQUE), field, output, 0.0, "linear")
        for result in ways(noise(OBLIQUE), field, output=output, fill=0.0):
            assert np.mean(np.abs(result - expected) <= 2 * RANGE_SHARE * 200) > 0.999


@pytest.mark.parametrize(
    ("view", "output"),
    [
        *product(
            ["+z", "+y"],
            [
                STRAIGHT,
                STRAIGHT.crop((1, 2, 3), (4, 5, 6)),
                STRAIGHT.crop((1, 2, 3), (2, 2, 2)),  # a small part of each slice
            ],
        ),
        ("+z", STRAIGHT.crop((0, -3, -2), (6, 13, 12))),
        ("+y", STRAIGHT.crop((-3, 0, -2), (12, 7, 12))),
        ("+z", STRAIGHT.resampled(spacing=(STRAIGHT.spacing[0] / 2, STRAIGHT.spacing[1] / 3, STRAIGHT.spacing[2]))),
        (
            "+z",
            Grid(STRAIGHT.shape, direction=((np.cos(0.3), -np.sin(0.3), 0), (np.sin(0.3), np.cos(0.3), 0), (0, 0, 1))),
        ),
    ],
)
@pytest.mark.parametrize("rule", ["modulate", "interpolate"])
@pytest.mark.parametrize("dtype", ["uint8", "int8", "uint16", "int16"])
def test_slices_in_words_into_any_field_of_view(dtype: str, rule: str, view: str, output: Grid) -> None:
    values = (noise(STRAIGHT).values - (100 if dtype.startswith("int") else 0)).astype(dtype)
    volume, field = Volume(values, STRAIGHT), extruded(Plane.from_view(output, view), STRAIGHT, rule, 4.0)
    assert planning.plan_extrusion(field, STRAIGHT, output, "float32") is not None
    expected = slow_warp(volume, field, output, 7.0, "linear")
    result = warp(volume, field, output=output, fill=7.0).values
    # on the tie between two grey levels, float32 rounding decides
    assert np.abs(result - expected).max() <= 0.5 + 2 * RANGE_SHARE * 255


@pytest.mark.parametrize("output", [STRAIGHT, STRAIGHT.crop((2, 1, 1), (5, 6, 4))])
@pytest.mark.parametrize("dtype", ["uint8", "float64"])
def test_rows_of_a_replicated_map_may_begin_anywhere_in_memory(dtype: str, output: Grid) -> None:
    values, field = noise(STRAIGHT, dtype).values, extruded(Plane.from_view(STRAIGHT, "+x"), STRAIGHT, "replicate")
    expected = slow_warp(Volume(values, STRAIGHT), field, output, 7.0, "linear")
    for first in (0, 1, 33):
        room = sampling.aligned_empty((first + values.size,), values.dtype)
        room[first:] = values.ravel()
        result = warp(Volume(room[first:].reshape(values.shape), STRAIGHT), field, output=output, fill=7.0).values
        assert result.flags.writeable or not devices.is_host()
        # on the tie between two grey levels, float32 rounding decides
        assert np.abs(result - expected).max() <= (0.5 if dtype == "uint8" else 0) + 2 * RANGE_SHARE * 255


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
@pytest.mark.parametrize("shape", [(5, 64, 64), (5, 63, 64)])
def test_slices_of_whole_pages_are_moved_as_others_are(shape: tuple[int, int, int], dtype: str) -> None:
    grid = Grid(shape)
    plain, prepared = ways(noise(grid, dtype), extruded(Plane.from_view(grid, "+z"), grid, "replicate"), fill=7.0)
    assert plain.shape == shape
    assert np.abs(plain.astype(float) - prepared).max() <= 1e-6 * 200


@pytest.mark.parametrize("dtype", ["uint8", "int16"])
def test_modulated_slices_may_begin_anywhere_in_memory(dtype: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning, "BLOCK_VOXELS", 2 * STRAIGHT.shape[1] * STRAIGHT.shape[2])
    values, field = noise(STRAIGHT, dtype).values, extruded(Plane.from_view(STRAIGHT, "+z"), STRAIGHT, "modulate")
    results = []
    for first in (0, 1, 33):  # voxels after an address from which JAX shares memory
        room = sampling.aligned_empty((first + values.size,), values.dtype)
        room[first:] = values.ravel()
        results.append(warp(Volume(room[first:].reshape(values.shape), STRAIGHT), field).values)
    np.testing.assert_array_equal(results[1], results[0])
    np.testing.assert_array_equal(results[2], results[0])


@pytest.mark.parametrize(
    "plane",
    [
        Plane.from_normal((-38, 27, 10), (1, 2, 3)),
        Plane(
            (0, 0, 0), (np.cos(0.3), np.sin(0.3), 0), (-np.sin(0.3), np.cos(0.3), 0)
        ),  # along z, but turned in itself
    ],
)
def test_oblique_planes_take_the_general_way(plane: Plane) -> None:
    grid = STRAIGHT if plane.origin == (0, 0, 0) else OBLIQUE
    field = extruded(plane, grid, "modulate")
    assert planning.plan_extrusion(field, grid, grid, "float32") is None
    volume = noise(grid)
    expected = slow_warp(volume, field, grid, 0.0, "linear")
    assert np.mean(np.abs(warp(volume, field, fill=0.0).values - expected) <= 2 * RANGE_SHARE * 200) > 0.999


def test_a_crop_that_begins_outside_takes_the_general_way() -> None:
    field, output = (
        extruded(Plane.from_view(STRAIGHT, "+z"), STRAIGHT, "replicate"),
        STRAIGHT.crop((-1, 0, 0), (3, 7, 9)),
    )
    assert planning.plan_extrusion(field, STRAIGHT, output, "float32") is None
    result = warp(noise(STRAIGHT), field, output=output, fill=-7.0).values
    assert (result[0] == -7.0).all()


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("method", ["nearest", "linear"])
@pytest.mark.parametrize("view", ["+y", "+z"])
def test_short_cuts_give_the_bytes_of_the_general_way(rule: str, method: str, view: str) -> None:
    volume = noise(STRAIGHT, "uint8")
    field = extruded(Plane.from_view(STRAIGHT, view), STRAIGHT, rule)
    general = warp(volume, DisplacementField.sample(field, STRAIGHT), method=method).values
    for result in ways(volume, field, method=method):
        # on the tie between two grey levels, float32 rounding decides
        assert np.mean(result == general) > 0.995
        assert np.abs(result.astype(int) - general).max() <= (1 if method == "linear" else 200)


@pytest.mark.parametrize("view", VIEWS)
def test_the_picture_is_the_mip_of_the_result(view: str) -> None:
    # with nearest sampling, MIP along the normal commutes with a replicated map
    volume = noise(FLIPPED, "uint8")
    plane = Plane.from_view(FLIPPED, view)
    field = extruded(plane, FLIPPED, "replicate")
    normal = planning.shared_axis(plane, FLIPPED, FLIPPED)
    assert normal is not None
    one = Volume(
        volume.values.max(axis=normal, keepdims=True),
        FLIPPED.crop((0, 0, 0), tuple(1 if axis == normal else n for axis, n in enumerate(FLIPPED.shape))),
    )  # type: ignore[arg-type]
    for result in ways(volume, field, method="nearest", fill=0):
        assert (result.max(axis=normal, keepdims=True) == warp(one, field, method="nearest", fill=0).values).all()


def test_results_of_prepared_axes_say_the_same_in_another_order_of_memory() -> None:
    volume, field = noise(STRAIGHT), extruded(Plane.from_view(STRAIGHT, "+z"), STRAIGHT, "replicate")
    first, second = ways(volume, field)
    assert first.flags.c_contiguous
    is_turned = devices.is_host() and library.level() != "off"  # JAX needs no preparation
    assert second.flags.c_contiguous is not is_turned
    assert np.abs(first - second).max() <= 1e-6 * 200  # the four weights are multiplied in another order


# -- exactness and types ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dtype", "method"),
    [(d, m) for d in DTYPES for m in ("nearest", "linear") if not (d == "bool" and METHODS[m].blends)],
)
def test_identity_is_exact_bit_for_bit(dtype: str, method: str) -> None:
    volume = noise(OBLIQUE, dtype)
    if dtype in ("int32", "float64"):
        volume = Volume((volume.values * 1e7).astype(dtype), OBLIQUE)
    still = extrude(Plane.from_view(OBLIQUE, "-x"), OBLIQUE, [Identity(2)], replicate())
    for result in (warp(volume, Identity(), method=method).values, *ways(volume, still, method=method)):
        assert result.dtype == volume.dtype
        assert (result == volume.values).all()


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("grid", [STRAIGHT, FLIPPED])
def test_whole_voxels_move_exactly(dtype: str, grid: Grid) -> None:
    volume = noise(grid, dtype)
    shift = grid.matrix @ np.array([2, -1, 1.0])
    field = DisplacementField(np.broadcast_to(shift, (*grid.shape, 3)).copy(), grid)
    result = warp(volume, field, fill=0).values
    assert (result[:-1, 1:, :-2] == volume.values[1:, :-1, 2:]).all()
    assert not result[-1].any()
    assert not result[:, 0].any()
    assert not result[:, :, -2:].any()


@pytest.mark.parametrize("dtype", [d for d in DTYPES if d != "bool"])
def test_every_type_is_interpolated_and_integers_are_rounded(dtype: str) -> None:
    scale = {"int8": 0.5, "uint16": 300, "int16": -150, "int32": 1e7}.get(dtype, 1.0)
    volume = Volume((noise(STRAIGHT, "float64").values * scale).astype(dtype), STRAIGHT)
    field = scattered(STRAIGHT)
    result = warp(volume, field, fill=0).values.astype(np.float64)
    expected = slow_warp(volume, field, STRAIGHT, 0.0, "linear")
    error = np.abs(result - expected).max()
    if volume.dtype.kind == "f":
        assert error <= (1e-13 if dtype == "float64" else RANGE_SHARE) * 200
    else:
        assert error <= 0.5 + RANGE_SHARE * 200 * abs(scale) * (dtype != "int32")


def test_labels_and_bool_keep_their_values() -> None:
    values = np.random.default_rng(0).choice([0, 7, 1000], STRAIGHT.shape).astype(np.uint16)
    labels = Volume(values, STRAIGHT, "l", is_labels=True)
    result = warp(labels, Wave(2.0))
    assert result.is_labels
    assert result.name == "l"
    assert set(np.unique(result.values)) == {0, 7, 1000}
    for volume in (labels, noise(STRAIGHT, "bool")):
        for method in METHODS:
            if METHODS[method].blends:
                with pytest.raises(DeformError, match="invent values"):
                    warp(volume, Wave(), method=method)


def test_not_a_number_counts_as_background() -> None:
    volume = noise(STRAIGHT)
    clean = volume.values.copy()
    volume.values[2, 3, 4], volume.values[3, 3, 3] = np.nan, np.inf
    clean[2, 3, 4] = clean[3, 3, 3] = volume.background
    field = scattered(STRAIGHT)
    assert (warp(volume, field).values == warp(Volume(clean, STRAIGHT), field, fill=volume.background).values).all()


def test_the_input_is_never_written() -> None:
    volume = noise(STRAIGHT)
    volume.values.setflags(write=False)
    before = volume.values.copy()
    result = warp(volume, Identity()).values
    assert result.flags.writeable or not devices.is_host()
    if result.flags.writeable:
        result[...] = 0
    assert (volume.values == before).all()


@pytest.mark.parametrize("shape", [(1, 9, 11), (7, 1, 11), (7, 9, 1), (1, 1, 11), (1, 1, 1)])
@pytest.mark.parametrize(("method", "step"), [(m, s) for m in METHODS for s in (1, 4)])
def test_one_slice(shape: tuple[int, int, int], method: str, step: int) -> None:
    grid = Grid(shape, (1.0, 2.0, 3.0))
    volume = noise(grid)
    assert warp(volume, Identity(), method=method, step=step).values == pytest.approx(volume.values, abs=1e-4)
    values = np.zeros((*shape, 3), np.float32)
    values[..., :] = 0.4 * np.array(grid.spacing) * (np.array(shape[::-1]) == 1)  # within half a voxel of the slice
    moved = warp(volume, DisplacementField(values, grid), method=method, step=step).values
    assert moved == pytest.approx(volume.values, abs=1e-4)
    away = warp(volume, DisplacementField(values * 2, grid), method=method, step=step, fill=-1.0).values
    assert (away == -1.0).all()


@pytest.mark.parametrize("shape", [(1, 6, 7), (5, 1, 7), (5, 6, 1), (1, 1, 1)])
@pytest.mark.parametrize("method", ["nearest", "linear"])
def test_one_slice_extruded(shape: tuple[int, int, int], method: str) -> None:
    grid = Grid(shape, (1.0, 2.0, 3.0))
    volume = noise(grid)
    for view, rule in (("+x", "replicate"), ("-y", "modulate"), ("+y", "replicate"), ("+z", "replicate")):
        field = extruded(Plane.from_view(grid, view), grid, rule)
        expected = slow_warp(volume, field, grid, -1.0, method)
        for result in ways(volume, field, method=method, fill=-1.0):
            assert np.mean(np.abs(result - expected) <= RANGE_SHARE * 400) > 0.98


@settings(max_examples=15)
@given(
    shape=st.tuples(*[st.integers(1, 6)] * 3),
    seed=st.integers(0, 99),
    method=st.sampled_from(list(METHODS)),
    size=st.floats(0, 30),
)
def test_a_constant_volume_stays_constant(shape: tuple[int, int, int], seed: int, method: str, size: float) -> None:
    grid = Grid(shape, (0.5, 1.0, 3.0), (1.0, 2.0, 3.0), rotation(seed))  # type: ignore[arg-type]
    volume = Volume(np.full(shape, 41.5, np.float32), grid)
    result = warp(volume, scattered(grid, size, seed), method=method).values
    assert np.abs(result - 41.5).max() < 41.5 * 1e-6  # a few float32 roundings of weights that sum to one


@settings(max_examples=15)
@given(seed=st.integers(0, 99), slope=st.tuples(*[st.floats(-5, 5)] * 3))
def test_a_linear_ramp_is_read_exactly_between_voxels(seed: int, slope: tuple[float, float, float]) -> None:
    grid = Grid((6, 7, 8), (0.5, 1.0, 3.0), (1.0, 2.0, 3.0), rotation(seed))  # type: ignore[arg-type]
    points, field = centres(grid), scattered(grid, 1.0, seed)
    inside = between_centres(lookup(grid, field), grid)
    result = warp(Volume(points @ np.array(slope), grid), field).values
    error = np.abs(result - (points + np.asarray(field.values)) @ np.array(slope))
    assert error[inside].max(initial=0) < 1e-11 * 100


# -- how the work is done --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [2, 3, 4])
@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (1.0, 2.0, 0.5)])
def test_the_error_of_step_is_bounded_by_the_second_derivative(step: int, spacing: tuple[float, float, float]) -> None:
    grid = Grid((21, 22, 12), spacing)
    points = centres(grid)
    ramp = Volume(points[..., 0] + 100, grid)  # its value is the displacement along x
    field = Wave(2.0, 0.25)
    inside = (points[..., 0] > 2) & (points[..., 0] < grid.lengths[0] - 3)
    keep = Grid(grid.shape, spacing)
    exact, coarse = (warp(ramp, AlongX(field), output=keep, step=s).values[inside] for s in (1, step))
    h = step * np.array(spacing)
    bound = 2.0 * 0.25**2 * (np.array([1.0, 0.7, 0.4]) * h @ (np.array([1.0, 0.7, 0.4]) * h)) / 8
    error = np.abs(exact - coarse).max()
    assert error <= bound
    assert error > bound / 20  # the bound is of the right size: the field is evaluated on the coarse lattice indeed


@dataclass(frozen=True)
class AlongX(AbstractField):
    """The first component of another field only."""

    field: AbstractField
    dim: int = 3  # type: ignore[misc]

    def jax_displacement(self, points: Any) -> Any:
        return self.field.jax_displacement(points) * jnp.array([1.0, 0, 0])

    def displacement(self, points: ArrayLike) -> NDArray[np.float64]:
        return self.field.displacement(points) * np.array([1.0, 0, 0])


@pytest.mark.sampled(2)
@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("step", [1, 4])
def test_parts_of_any_size_give_the_same_voxels(threads: int, step: int, monkeypatch: pytest.MonkeyPatch) -> None:
    grid = Grid((13, 17, 11))
    volume, fields = (
        noise(grid),
        [
            scattered(grid),
            *(
                extruded(Plane.from_view(grid, v), grid, r)
                for v in ("+x", "+y", "+z")
                for r in ("replicate", "modulate")
            ),
        ],
    )
    whole = [warp(volume, f, step=step).values for f in fields]
    monkeypatch.setattr(planning, "processors", lambda: threads)
    for voxels in (1, 100, 300):
        monkeypatch.setattr(planning, "BLOCK_VOXELS", voxels)
        for f, expected in zip(fields, whole, strict=True):
            # Equal where XLA optimises; tests compile quickly, and the size of a part then decides about rounding.
            close = 4 * np.finfo(np.float32).eps * np.abs(expected).max()
            oracle.assert_close(warp(volume, f, step=step).values, expected, atol=close)


@pytest.mark.parametrize("turn", [1, -1])
def test_a_field_on_a_coarse_grid_is_that_of_its_samples_at_every_voxel(turn: int) -> None:
    output = Grid((13, 17, 11), (1.0, 1.1, 0.9), (3.0, 2.0, 1.0), ((turn, 0, 0), (0, turn, 0), (0, 0, 1)))
    values = np.random.default_rng(5).normal(size=(5, 4, 6, 3))
    coarse = DisplacementField(values, Grid((5, 4, 6), (3.0, 4.5, 3.5), (-1.0, -2.0, -1.0)))
    stored = planning.interpolation_tables(coarse, output)
    assert stored is not None
    (x, y, z), tables = stored
    assert x.shape[0] < 13
    assert x.shape[1] < 17
    found = interpolate_nodes(np.stack([x, y, z]), tables)
    np.testing.assert_allclose(found, coarse.components_on_grid(output), atol=1e-5)
    volume = noise(output)
    every = DisplacementField(np.moveaxis(coarse.components_on_grid(output), 0, -1), output)
    np.testing.assert_allclose(warp(volume, coarse).values, warp(volume, every).values, atol=2e-2)


@given(shape=st.tuples(*[st.integers(1, 40)] * 3), step=st.integers(1, 5), most=st.integers(1, 999))
def test_parts_cover_the_output_and_have_one_size(shape: tuple[int, int, int], step: int, most: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "BLOCK_VOXELS", most)
        blocks = planning.blocks(shape, step)
    covered = np.zeros(shape[:2], dtype=bool)
    for z, y in blocks:
        covered[z, y] = True
        assert z.start % step == y.start % step == 0
    assert covered.all()
    assert len({(z.stop - z.start, y.stop - y.start) for z, y in blocks}) == 1


GROWN = Affine(1.1 * np.eye(3), np.zeros(3))


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    "field",
    [
        Wave(),
        compose(GROWN, GROWN),
        extruded(Plane.from_view(STRAIGHT, "+x"), STRAIGHT, "replicate"),
        extruded(Plane.from_view(STRAIGHT, "+z"), STRAIGHT, "modulate"),
    ],
)
def test_progress_and_cancellation(field: AbstractField, threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning, "processors", lambda: threads)
    monkeypatch.setattr(planning, "BLOCK_VOXELS", 20)
    monkeypatch.setattr(planning, "_MORE_ON_GPU", 1)
    seen: list[float] = []
    warp(noise(STRAIGHT), field, progress=seen.append)
    assert len(seen) > 3
    assert all(a < b for a, b in pairwise(seen))
    assert seen[-1] == 1.0

    def stop(share: float) -> None:
        if share > 0.3:
            raise Cancelled

    with pytest.raises(Cancelled):
        warp(noise(STRAIGHT), field, progress=stop)


def test_more_than_two_thousand_million_voxels_use_long_indices(monkeypatch: pytest.MonkeyPatch) -> None:
    fields = [
        scattered(STRAIGHT),
        *(extruded(Plane.from_view(STRAIGHT, v), STRAIGHT, "replicate") for v in ("+x", "+y")),
    ]
    expected = [warp(noise(STRAIGHT), f).values for f in fields]
    monkeypatch.setattr(sampling, "LARGEST_INT32", 100)
    for f, e in zip(fields, expected, strict=True):
        assert np.abs(warp(noise(STRAIGHT), f).values - e).max() <= 1e-6 * 200


@pytest.mark.parametrize("spacing", [(1.0, 1.0, 1.0), (2.0, 1.5, 0.4)])
def test_a_stored_field_on_a_coarse_grid_is_read_linearly(spacing: tuple[float, float, float]) -> None:
    coarse = STRAIGHT.resampled(spacing=spacing, margin=-0.7)
    field, volume = scattered(coarse), noise(STRAIGHT)
    expected = slow_warp(volume, field, STRAIGHT, 0.0, "linear")
    assert np.mean(np.abs(warp(volume, field, fill=0.0).values - expected) <= 2 * RANGE_SHARE * 200) > 0.999


@pytest.mark.parametrize("dtype", ["uint8", "float32", "int32"])
def test_a_stored_field_may_begin_anywhere_in_memory(dtype: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planning, "BLOCK_VOXELS", 2 * STRAIGHT.shape[1] * STRAIGHT.shape[2])
    values = np.asarray(scattered(STRAIGHT).values, np.float32)
    results = []
    for first in (0, 1, 5):  # numbers after an address from which JAX shares memory
        room = sampling.aligned_empty((first + values.size,), values.dtype)
        room[first:] = values.ravel()
        field = DisplacementField(room[first:].reshape(values.shape), STRAIGHT)
        results.append(warp(noise(STRAIGHT, dtype), field).values)
    np.testing.assert_array_equal(results[1], results[0])
    np.testing.assert_array_equal(results[2], results[0])


# -- refusals --------------------------------------------------------------------------------------------------------

REFUSED: dict[str, tuple[Callable[[], Any], str]] = {
    "field of a plane": (lambda: warp(noise(STRAIGHT), Wave(dim=2)), "field in space"),
    "field in space on a picture": (lambda: warp_picture(np.zeros((2, 3)), SMALL, Wave()), "dimension 2"),
    "picture of another shape": (lambda: warp_picture(np.zeros((3, 3)), SMALL, Wave(dim=2)), r"\(3, 3\).*\(2, 3\)"),
    "complex pixels": (lambda: warp_picture(np.zeros((2, 3), complex), SMALL, Wave(dim=2)), "complex128"),
    "method": (lambda: warp(noise(STRAIGHT), Wave(), method="sinc"), "sinc.*nearest, linear, cubic"),
    "step 0": (lambda: warp(noise(STRAIGHT), Wave(), step=0), "at least 1"),
    "step 1.5": (lambda: warp(noise(STRAIGHT), Wave(), step=1.5), "whole number"),  # type: ignore[arg-type]
    "fill too small": (lambda: warp(noise(STRAIGHT, "uint8"), Wave(), fill=-1), "uint8.*-1"),
    "fill between": (lambda: warp(noise(STRAIGHT, "int16"), Wave(), fill=0.5), "int16.*0.5"),
    "fill not a number": (lambda: warp(noise(STRAIGHT, "int16"), Wave(), fill=np.nan), "int16.*nan"),
    "fill too large": (lambda: warp(noise(STRAIGHT), Wave(), fill=1e300), "float32"),
    "fill of words": (lambda: warp(noise(STRAIGHT), Wave(), fill="air"), "air"),  # type: ignore[arg-type]
    "infinite field": (lambda: warp(noise(STRAIGHT), Wave(np.inf)), "not finite"),
    "field not a number": (lambda: warp(noise(STRAIGHT), Wave(np.nan)), "not finite"),
    "infinite map": (
        lambda: warp(noise(STRAIGHT), extrude(Plane.from_view(STRAIGHT), STRAIGHT, [Wave(np.inf, dim=2)], replicate())),
        "not finite",
    ),
}
SMALL = Raster((2, 3), (1.0, 1.0), (0.0, 0.0))


@pytest.mark.parametrize("case", REFUSED)
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_refused_with_a_reason(case: str) -> None:
    call, message = REFUSED[case]
    with pytest.raises(DeformError, match=message):
        call()


@pytest.mark.allow_nan
def test_any_float_may_fill() -> None:
    far = STRAIGHT.crop((0, 0, 99), (1, 1, 2))
    for fill in (np.nan, np.inf, -1.5):
        result = warp(noise(STRAIGHT), Identity(), output=far, fill=fill).values
        assert np.array_equal(result, np.full((1, 1, 2), fill), equal_nan=True)


# -- pictures --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("dtype", ["uint8", "float32", "float64"])
def test_a_picture_is_a_volume_of_one_slice(method: str, dtype: str) -> None:
    grid = Grid((1, 9, 11), (0.8, 1.1, 1.0), (2.0, -1.0, 0.0))
    raster = Raster((9, 11), (0.8, 1.1), (2.0, -1.0))
    volume = noise(grid, dtype)
    field = Wave(1.5, 0.4, dim=2)
    space = extrude(Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), grid, [field], replicate())
    expected = warp(volume, space, method=method, fill=0).values[0]
    result = warp_picture(volume.values[0], raster, field, method=method, fill=0)
    assert result.dtype == dtype
    # two sums of float32 products in another order; bytes on a tie may differ by one
    assert np.abs(result.astype(float) - expected).max() <= (1 if dtype == "uint8" else RANGE_SHARE * 200)


def test_channels_move_together_and_bool_stays_bool() -> None:
    raster, field = Raster((9, 11), (0.8, 1.1), (2.0, -1.0)), Wave(1.5, 0.4, dim=2)
    colours = np.random.default_rng(5).integers(0, 255, (9, 11, 4)).astype(np.uint8)
    result = warp_picture(colours, raster, field, fill=3)
    for channel in range(4):
        assert (result[..., channel] == warp_picture(colours[..., channel], raster, field, fill=3)).all()
    mask = colours[..., 0] > 99
    moved = warp_picture(mask, raster, field)
    assert moved.dtype == np.bool_
    assert (moved == warp_picture(mask.astype(np.uint8), raster, field, method="nearest").astype(bool)).all()


def test_a_picture_on_another_raster() -> None:
    raster, output = Raster((9, 11), (1.0, 1.0), (0.0, 0.0)), Raster((5, 4), (0.5, 0.25), (2.0, 1.0))
    a, b = np.meshgrid(raster.columns, raster.rows)
    result = warp_picture(3 * a - 2 * b, raster, Wave(0.5, 0.4, dim=2), output=output)
    points = output.points()
    points = points + Wave(0.5, 0.4, dim=2).displacement(points)
    assert np.abs(result - (3 * points[..., 0] - 2 * points[..., 1])).max() < 1e-6  # maps are float32


def test_a_stored_map_is_read_linearly_on_pictures_and_in_space() -> None:
    coarse, raster = Raster((4, 6), (2.5, 2.0), (-0.5, 0.5)), Raster((9, 11), (0.8, 1.1), (2.0, -1.0))
    stored = DisplacementField(np.random.default_rng(8).normal(size=(4, 6, 2)), coarse)
    picture = np.random.default_rng(5).random((9, 11))
    points = raster.points()
    place = (points + stored.displacement(points) - raster.origin) / raster.spacing
    expected = ndimage.map_coordinates(picture, np.moveaxis(place[..., ::-1], -1, 0), order=1)
    inside = ((place >= 0) & (place <= [10, 8])).all(axis=-1)
    assert np.abs(warp_picture(picture, raster, stored) - expected)[inside].max() < 1e-6  # maps are float32
    field = extrude(Plane.from_view(STRAIGHT, "-y"), STRAIGHT, [stored], modulate("z"))
    expected = slow_warp(noise(STRAIGHT), field, STRAIGHT, 0.0, "linear")
    error = np.abs(warp(noise(STRAIGHT), field, fill=0.0).values - expected)
    assert np.mean(error <= 2 * RANGE_SHARE * 200) > 0.999


def test_a_picture_with_holes() -> None:
    picture = np.array([[5.0, np.nan, 7.0], [np.inf, 6.0, 8.0]])
    assert warp_picture(picture, SMALL, Identity(2)).tolist() == [[5.0, 5.0, 7.0], [5.0, 6.0, 8.0]]
    assert warp_picture(np.full((2, 3), np.nan), SMALL, Identity(2)).tolist() == [[0.0] * 3] * 2

"""Warps with cuts: every kernel against a literal loop over the voxels, in every rule, type and output."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import oracle
import pytest
from numpy.typing import NDArray
from scipy import ndimage
from warping.test_warper import FLIPPED, OBLIQUE, RULES, STRAIGHT, Wave, centres, noise, rotation, slow_warp, ways

from deformnb.rbf.cuts import CUT_RULES, Decoupled
from deformnb.rbf.extrusion import extrude
from deformnb.rbf.fields import AbstractField, blend, compose
from deformnb.rbf.regions import AbstractRegion, HalfSpace, Line
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.volume import Grid, Volume
from deformnb.warping import planning
from deformnb.warping.modulated_cuts import plan_cut
from deformnb.warping.warper import warp, warp_picture


def cut_field(
    grid: Grid,
    view: str | Plane = "+z",
    rule: str = "replicate",
    cut_rule: str = "source",
    size: float = 1.3,
    shape: str = "line",
) -> Decoupled:
    """Two sides of a cut through the middle of a picture, each moved by its own wave."""
    plane = view if isinstance(view, Plane) else Plane.from_view(grid, view)
    centre = plane.to_plane(grid.corners(centres=True).mean(axis=0))[:2]
    bent = np.array([[0.4, 9.0], [-0.6, 0.3], [0.5, -9.0]]) * (1.0, 0.5) + centre
    regions: dict[str, tuple[AbstractRegion, ...]] = {
        "line": (Line(bent[[0, 2]].tolist()),),
        "bent": (Line(bent.tolist()),),
        "crossing": (Line(bent[[0, 2]].tolist()), HalfSpace(tuple(centre), (0.3, 1.0))),
    }
    sides = list(product((False, True), repeat=len(regions[shape])))[:3]  # one of the four regions has no points
    count, weights = RULES[rule]
    fields = [
        extrude(plane, grid, [Wave(size * (1 + k), 0.15 + 0.05 * r, dim=2) for k in range(count)], weights)
        for r in range(len(sides))
    ]
    return Decoupled(tuple(fields), tuple(sides), regions[shape], plane, cut_rule, float(np.mean(grid.spacing)))


def slow_cut(volume: Volume, field: AbstractField, output: Grid, fill: float, method: str) -> NDArray[np.float64]:
    """The definition: the sampled voxel, mixed with the background where it is not opaque."""
    result = slow_warp(volume, field, output, fill, method)
    a = field.opacity(centres(output))
    return np.where(a >= 0.5, result, fill) if method == "nearest" else fill + a * (result - fill)


TABLE = 2e-3 * 3 * 200
"""Maps off the grid may be read from tables: a five-hundredth of a voxel, times the steepest noise of three axes."""


def agrees(result: NDArray[Any], expected: NDArray[np.float64], share: float = 0.99, most: float = 0.04) -> None:
    """But for places where rounding decides which side of a cut or of a rim is seen."""
    error = np.abs(result.astype(np.float64) - expected)
    assert np.mean(error <= most) >= share, (np.mean(error <= most), error.max())


@pytest.mark.parametrize("cut_rule", CUT_RULES)
@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(
    ("view", "grid", "shape"), [("+x", OBLIQUE, "line"), ("-y", FLIPPED, "crossing"), ("+z", OBLIQUE, "crossing")]
)
def test_beside_cuts_every_kernel_follows_the_definition(
    view: str, grid: Grid, shape: str, rule: str, cut_rule: str
) -> None:
    field, volume = cut_field(grid, view, rule, cut_rule, shape=shape), noise(grid)
    assert 0.02 < np.mean(field.opacity(centres(grid)) < 1) < 0.9
    for method in ("linear", "nearest"):
        expected = slow_cut(volume, field, grid, -7.0, method)
        for result in ways(volume, field, fill=-7.0, method=method):  # type: ignore[arg-type]
            agrees(result, expected)


@pytest.mark.parametrize("cut_rule", CUT_RULES)
def test_at_corners_of_modulated_cuts_little_is_lost(cut_rule: str) -> None:
    field, volume = cut_field(STRAIGHT, "+y", "modulate", cut_rule, shape="bent"), noise(STRAIGHT)
    agrees(warp(volume, field, fill=0.0).values, slow_cut(volume, field, STRAIGHT, 0.0, "linear"), 0.96)


@pytest.mark.parametrize(
    ("rule", "cut_rule", "shape"),
    [("modulate", "source", "line"), ("modulate", "paper", "bent"), ("interpolate", "source", "crossing")],
)
def test_long_drags_beside_cuts_that_change_with_depth(rule: str, cut_rule: str, shape: str) -> None:
    """Many pixels are moved across the cut on some slices only, and more of them are near it and stay apart."""
    grid = Grid((12, 400, 60))
    volume, field, x = noise(grid), cut_field(grid, "+z", rule, cut_rule, 5.0, shape), centres(grid)
    d, opacity = field.displacement_and_opacity(x)
    plan = plan_cut(field, grid, grid, "float32")
    assert plan is not None
    is_listed, opens = np.zeros(grid.shape[1:], dtype=bool), (opacity < 0.9).any(axis=0)
    is_listed[*plan.pixels] = True
    assert is_listed[opens].all()
    assert opens.sum() > 900
    assert is_listed.sum() < 1.5 * opens.sum()
    place, counts = np.moveaxis((x + d)[..., ::-1], -1, 0), np.reshape(grid.shape, (3, 1, 1, 1))
    inside = ((place >= -0.5) & (place < counts - 0.5)).all(axis=0)
    expected = opacity * inside * ndimage.map_coordinates(volume.values, place, order=1, mode="nearest")
    agrees(warp(volume, field, fill=0.0).values, expected, 0.999)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("rule", RULES)
def test_cuts_on_oblique_planes_and_other_outputs(rule: str) -> None:
    oblique = cut_field(OBLIQUE, Plane.from_normal((-38, 27, 10), (1, 2, 3)), rule)
    volume = noise(OBLIQUE)
    agrees(warp(volume, oblique, fill=0.0).values, slow_cut(volume, oblique, OBLIQUE, 0.0, "linear"), most=TABLE)
    for output in (
        Grid((5, 6, 8), (0.9, 0.8, 1.1), (-39.0, 25.5, 9.0), rotation(9)),  # type: ignore[arg-type]
        OBLIQUE.crop((1, 2, 3), (4, 5, 6)),
        OBLIQUE.crop((-1, 0, 0), (4, 5, 6)),
    ):
        field = cut_field(OBLIQUE, "+z", rule)
        result = warp(volume, field, output=output, fill=0.0)
        assert result.grid == output
        agrees(result.values, slow_cut(volume, field, output, 0.0, "linear"), 0.98, TABLE)


@pytest.mark.parametrize("rule", RULES)
def test_step_is_of_no_account_beside_cuts(rule: str) -> None:
    """A displacement that jumps is never interpolated."""
    volume = noise(OBLIQUE)
    for plane in (Plane.from_view(OBLIQUE, "+x"), Plane.from_normal((-38, 27, 10), (1, 2, 3))):
        field = cut_field(OBLIQUE, plane, rule)
        assert (warp(volume, field, step=4).values == warp(volume, field).values).all()


@pytest.mark.parametrize("dtype", ["bool", "uint8", "int16", "float64"])
@pytest.mark.parametrize("rule", RULES)
def test_cuts_in_every_kind_of_voxel(rule: str, dtype: str) -> None:
    volume, field = noise(STRAIGHT, dtype), cut_field(STRAIGHT, "+y", rule)
    result = warp(volume, field, fill=0)
    assert result.dtype == volume.dtype
    method = "nearest" if dtype == "bool" else "linear"
    expected = slow_cut(Volume(volume.values.astype(np.float64), STRAIGHT), field, STRAIGHT, 0.0, method)
    whole = 0.51 if volume.dtype.kind in "iu" else 1e-3
    assert np.mean(np.abs(result.values.astype(float) - expected) <= whole) > 0.98


def test_labels_beside_cuts_stay_labels() -> None:
    values = np.random.default_rng(0).choice([3, 7, 1000], STRAIGHT.shape).astype(np.uint16)
    labels = Volume(values, STRAIGHT, "l", is_labels=True)
    for rule in RULES:
        result = warp(labels, cut_field(STRAIGHT, "+y", rule), fill=0)
        assert result.is_labels
        assert set(np.unique(result.values)) <= {0, 3, 7, 1000}


@pytest.mark.sampled(12)
@pytest.mark.parametrize("dtype", ["uint8", "float32", "float64", "bool"])
@pytest.mark.parametrize("shape", ["line", "bent", "crossing"])
@pytest.mark.parametrize("cut_rule", CUT_RULES)
def test_a_closed_cut_changes_no_bit(dtype: str, shape: str, cut_rule: str) -> None:
    volume = noise(OBLIQUE, dtype)
    for plane in (Plane.from_view(OBLIQUE, "-x"), Plane.from_normal((-38, 27, 10), (1, 2, 3))):
        for rule in RULES:
            field = cut_field(OBLIQUE, plane, rule, cut_rule, 0.0, shape)
            for result in ways(volume, field):  # type: ignore[arg-type]
                assert (result == volume.values).all()


def test_where_the_curve_is_zero_a_modulated_cut_is_closed() -> None:
    for shape, cut_rule in product(("line", "bent", "crossing"), CUT_RULES):
        volume, field = noise(STRAIGHT), cut_field(STRAIGHT, "+z", "modulate", cut_rule, 2.0, shape)  # f = sin(pi z)
        result = warp(volume, field, fill=-7.0).values
        assert (result[0] == volume.values[0]).all()
        assert (result[3] == -7.0).any()


def test_cubic_beside_cuts() -> None:
    volume, field = Volume(np.full(OBLIQUE.shape, 50.0, np.float32), OBLIQUE), cut_field(OBLIQUE, "+y")
    expected = slow_cut(volume, field, OBLIQUE, 0.0, "linear")  # a constant is the same in every method
    agrees(warp(volume, field, fill=0.0, method="cubic").values, expected)


@pytest.mark.parametrize("rule", ["replicate", "modulate"])
def test_compositions_and_sums_with_cuts(rule: str) -> None:
    volume, wave = noise(OBLIQUE), Wave(1.0, 0.1)
    cut = cut_field(OBLIQUE, "+y", rule)
    other = cut_field(OBLIQUE, "+x", "replicate", shape="crossing")
    for field in (compose(cut, wave), compose(wave, cut), compose(cut, other), blend(cut, other), blend(wave, cut)):
        assert field.has_cuts
        expected = slow_cut(volume, field, OBLIQUE, 0.0, "linear")
        agrees(warp(volume, field, fill=0.0, step=2).values, expected, 0.985, TABLE)
    x = centres(OBLIQUE)
    oracle.assert_close(compose(cut, other).opacity(x), other.opacity(x) * cut.opacity(x + other.displacement(x)))
    oracle.assert_close(blend(cut, other).opacity(x), other.opacity(x) * cut.opacity(x))
    oracle.assert_close(blend(cut, other).displacement(x), other.displacement(x) + cut.displacement(x))


def test_cuts_in_space() -> None:
    middle = OBLIQUE.corners(centres=True).mean(axis=0)
    field = Decoupled((Wave(1.0), Wave(2.0, 0.2)), ((True,), (False,)), (HalfSpace(tuple(middle), (1, 2, -1)),))
    volume = noise(OBLIQUE)
    agrees(warp(volume, field, fill=0.0).values, slow_cut(volume, field, OBLIQUE, 0.0, "linear"))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("rule", RULES)
def test_cuts_in_parts_of_any_size(rule: str, monkeypatch: pytest.MonkeyPatch) -> None:
    grid = Grid((7, 35, 11))
    volume = noise(grid)
    fields = [cut_field(grid, v, rule) for v in ("+x", "+z")]
    whole = [warp(volume, f).values for f in fields]
    monkeypatch.setattr(planning, "processors", lambda: 3)
    for voxels in (1, 2000):
        monkeypatch.setattr(planning, "BLOCK_VOXELS", voxels)
        for f, expected in zip(fields, whole, strict=True):
            assert (warp(volume, f).values == expected).all()


def test_a_picture_beside_a_cut() -> None:
    raster = Raster((9, 11), (0.8, 1.1), (2.0, -1.0))
    cut = Line([(6.3, 9.0), (6.1, -4.0)])
    field = Decoupled((Wave(0.8, 0.2, dim=2), Wave(1.4, 0.1, dim=2)), ((True,), (False,)), (cut,))
    colours = np.random.default_rng(5).integers(0, 255, (9, 11, 3)).astype(np.uint8)
    moved = warp_picture(colours, raster, replace(field, rule="source"), fill=9)
    d, a = field.displacement_and_opacity(raster.points())
    place = (raster.points() + d - raster.origin) / raster.spacing
    inside = ((place >= 0) & (place <= [10, 8])).all(axis=-1)
    for c in range(3):
        value = ndimage.map_coordinates(colours[..., c].astype(float), np.moveaxis(place[..., ::-1], -1, 0), order=1)
        assert np.abs(moved[..., c] - (9 + a * (value - 9)))[inside].max() <= 1.01

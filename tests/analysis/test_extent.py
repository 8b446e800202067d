"""The box that deformed foreground needs, against where the warp itself puts it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from deformnb.analysis.extent import exceeded_sides, field_of_view, find_foreground, padded, reached_places
from deformnb.document.deformation import Deformation, Step
from deformnb.errors import DeformError
from deformnb.rbf.cuts import Cut
from deformnb.rbf.fields import AbstractField, Identity
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.foreground import PICTURE_SIDES
from deformnb.warping.warper import warp

TURNED = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def brick(shape: tuple[int, int, int] = (20, 24, 28), spacing: tuple[float, float, float] = (1.0, 2.0, 1.5)) -> Volume:
    """A brick that nearly fills its box, on a grid parallel to the axes that is not at the origin either."""
    values = np.zeros(shape, np.uint8)
    values[4:16, 3:20, 2:26] = 200
    return Volume.from_array(values, spacing, (5.0, -7.0, 11.0))


def dragged(volume: Volume, way: tuple[float, float], view: str = "+y", **options: object) -> AbstractField:
    """The field of the middle of a picture dragged, its corners held."""
    plane = Plane.from_view(volume.grid, view)
    at = plane.to_plane(volume.grid.corners())[:, :2]
    low, high = at.min(axis=0), at.max(axis=0)
    source = [low, (high[0], low[1]), high, (low[0], high[1]), (low + high) / 2]
    target = [*source[:4], np.add(source[4], way)]
    points = ControlPoints.from_arrays(source, target)
    return Deformation.from_picture_points(volume.grid, view, points, **options).field(volume.grid)


def really(volume: Volume, field: AbstractField, margin: int = 60) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The first and the last voxel along x, y, z, counted on the volume's lattice, where the warp shows foreground."""
    wide = volume.grid.crop((-margin,) * 3, tuple(n + 2 * margin for n in volume.shape))
    at = np.argwhere(warp(volume, field, output=wide).values > 100)[:, ::-1] - margin
    return at.min(axis=0), at.max(axis=0)


def ends(volume: Volume, grid: Grid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    first = volume.grid.point_to_index(grid.origin)
    np.testing.assert_allclose(first, np.round(first), atol=1e-9)  # the volume's own voxels
    return first, first + np.array(grid.shape[::-1]) - 1


def test_what_is_not_deformed_needs_the_box_it_has_and_to_the_bit() -> None:
    volume = brick()
    for field in (None, Identity(), dragged(volume, (0.0, 0.0))):
        assert field_of_view(volume, field).grid is volume.grid


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("way", "view"), [((25.0, 0.0), "+y"), ((0.0, 18.0), "+y"), ((-20.0, -12.0), "-z"), ((14.0, 30.0), "+x")]
)
def test_the_box_holds_all_that_the_warp_shows_and_hardly_more(way: tuple[float, float], view: str) -> None:
    volume = brick()
    field = dragged(volume, way, view, kernel="gaussian")
    found = field_of_view(volume, field)
    (first, last), (low, high) = really(volume, field), ends(volume, found.grid)
    assert not found.is_limited
    size = np.array(volume.shape[::-1])
    assert (low <= np.minimum(first, 0)).all()
    assert (high >= np.maximum(last, size - 1)).all()
    assert (low >= np.minimum(first, 0) - 4).all()
    assert (high <= np.maximum(last, size - 1) + 4).all()
    inside = warp(volume, field, output=found.grid).values > 100
    wide = volume.grid.crop((-60,) * 3, tuple(n + 120 for n in volume.shape))
    assert inside.sum() == (warp(volume, field, output=wide).values > 100).sum()  # nothing is lost


def test_a_volume_that_lies_turned_gets_its_own_voxels_too() -> None:
    plain = brick()
    volume = Volume(plain.values, Grid(plain.shape, plain.grid.spacing, plain.grid.origin, TURNED))
    field = dragged(volume, (20.0, 0.0))
    (first, last), (low, high) = really(volume, field), ends(volume, field_of_view(volume, field).grid)
    assert (low <= first).all()
    assert (high >= last).all()


@pytest.mark.parametrize("support", [None, 41.0])
def test_a_map_that_folds_is_seen_whole(support: float | None) -> None:
    volume = brick()
    field = dragged(volume, (90.0, -60.0), kernel="gaussian", support=support)
    (first, last), (low, high) = really(volume, field, 120), ends(volume, field_of_view(volume, field, most=100).grid)
    assert (low <= first).all()
    assert (high >= last).all()


@pytest.mark.nightly
def test_several_steps_and_cuts_are_followed() -> None:
    volume = brick()
    plane = Plane.from_view(volume.grid, "+y")
    middle = plane.to_plane(volume.grid.center)[:2]
    cut = Cut(Line(((middle[0], -200.0), (middle[0], 200.0))))
    beside = [[middle[0] - 10, middle[1]], [middle[0] + 10, middle[1]]]
    apart = ControlPoints.from_arrays(beside, [[middle[0] - 30, middle[1]], [middle[0] + 30, middle[1]]])
    opened = Step((apart,), plane, trend="translation", cuts=(cut,))
    lifted = Step(
        (ControlPoints.from_arrays([[0.0, 0.0]], [[0.0, 9.0]]),),
        Plane.from_view(volume.grid, "-z"),
        trend="translation",
    )
    field = Deformation((opened, lifted)).field(volume.grid)
    (first, last), (low, high) = really(volume, field), ends(volume, field_of_view(volume, field).grid)
    assert last[0] > volume.shape[2] + 8  # it did go far
    assert (low <= first).all()
    assert (high >= last).all()


def test_a_box_has_no_more_voxels_than_it_may_and_says_so() -> None:
    volume = brick()
    field = dragged(volume, (400.0, 0.0), kernel="gaussian")
    found = field_of_view(volume, field, most=1.5)
    assert found.is_limited
    assert volume.grid.size < found.grid.size <= 1.5 * volume.grid.size
    with pytest.raises(DeformError, match="at least as many voxels"):
        field_of_view(volume, field, most=0.5)


def test_air_and_noise_in_it_need_no_room() -> None:
    volume = brick()
    noisy = volume.values + np.random.default_rng(0).integers(0, 30, volume.shape).astype(np.uint8)
    noisy = Volume(noisy, volume.grid)
    field = dragged(volume, (0.0, 18.0))
    assert field_of_view(noisy, field).grid == field_of_view(volume, field).grid
    labels = Volume(volume.values // 200, volume.grid, is_labels=True)
    assert field_of_view(labels, field).grid == field_of_view(volume, field).grid


def test_a_volume_of_one_value_is_all_foreground() -> None:
    flat = Volume.from_array(np.full((3, 4, 5), 7, np.int16))
    foreground = find_foreground(flat)
    assert foreground.low.min(axis=0).tolist() == [-0.5] * 3
    assert foreground.high.max(axis=0).tolist() == [4.5, 3.5, 2.5]


def test_places_are_in_the_foreground_or_not() -> None:
    volume = brick()
    foreground = find_foreground(volume)
    inside, outside, air = (volume.grid.index_to_point(at) for at in ([10, 8, 9], [10, 8, 40], [0.5, 1, 2]))
    assert inside in foreground
    assert outside not in foreground
    assert air not in foreground
    assert [np.nan] * 3 not in foreground


@pytest.mark.parametrize("is_anatomical", [False, True])
def test_sides_are_told_as_those_of_the_body_where_they_are_known(is_anatomical: bool) -> None:
    volume = brick()
    volume = replace(volume, grid=replace(volume.grid, is_anatomical=is_anatomical))
    foreground = find_foreground(volume)
    left, bottom = ("left side (L)", "bottom (I)") if is_anatomical else ("high x side", "low z side")
    moved = {(40.0, 0.0): (left,), (0.0, 30.0): (bottom,), (0.0, 0.0): (), (1.0, 0.0): ()}
    for (a, b), sides in moved.items():
        points = ControlPoints.from_arrays([[0.0, 0.0]], [[a, b]])
        field = Deformation.from_picture_points(volume.grid, "+y", points, trend="translation").field(volume.grid)
        assert exceeded_sides(reached_places(foreground, field), volume.grid) == sides
        assert exceeded_sides(reached_places(foreground, field), field_of_view(foreground, field).grid) == ()


@pytest.mark.parametrize("is_dark", [False, True])
@pytest.mark.parametrize(
    ("way", "sides"),
    [((0.0, 0.0), set()), ((6.0, 3.0), set()), ((-60.0, 0.0), {0}), ((70.0, 0.0), {1}), ((0.0, 55.0), {3})],
)
def test_a_picture_has_a_subject_that_leaves_it_where_a_whole_warp_shows_it(
    is_dark: bool, way: tuple[float, float], sides: set[int]
) -> None:
    """Bright on dark ground, or dark on bright paper."""
    subject = np.zeros((1, 60, 90), np.uint8)
    subject[0, 20:45, 30:65] = 200
    volume = Volume(240 - subject if is_dark else subject, Grid((1, 60, 90), is_anatomical=False))
    field = dragged(volume, way, "+z", support=150.0)
    wide = volume.grid.crop((0, -90, -90), (1, 240, 270))
    seen = np.argwhere(warp(Volume(subject, volume.grid), field, output=wide).values > 100)[:, :0:-1] - 90
    beyond = np.stack([-seen.min(axis=0), seen.max(axis=0) - (89, 59)], axis=1).ravel()
    most = 1 + 0.01 * np.array([90, 90, 60, 60])
    assert {k for k in range(4) if beyond[k] > most[k]} == sides
    names = exceeded_sides(reached_places(find_foreground(volume), field), volume.grid)
    assert names == tuple(name for k, name in enumerate(PICTURE_SIDES) if k in sides)


def test_a_field_of_the_plane_is_refused() -> None:
    with pytest.raises(DeformError, match="needs a field in space"):
        field_of_view(
            brick(),
            Deformation.from_picture_points(brick().grid, "+y", ControlPoints.from_arrays([[0, 0], [9, 0], [0, 9]]))
            .steps[0]
            .fits(brick().grid)[0],
        )


def test_a_margin_is_whole_voxels_on_every_side() -> None:
    grid = brick().grid
    more = padded(grid, 3.0)
    assert more.shape == (20 + 2 * 2, 24 + 2 * 2, 28 + 2 * 3)
    np.testing.assert_allclose(grid.point_to_index(more.origin), (-3, -2, -2), atol=1e-9)
    assert padded(grid, (2.0, 0.0, -1.5)).shape == (18, 24, 32)
    assert padded(grid, 0.0) is grid
    for wrong, why in ((np.nan, "one length or three"), ((1.0, 2.0), "one length or three"), (-30.0, "leaves nothing")):
        with pytest.raises(DeformError, match=why):
            padded(grid, wrong)

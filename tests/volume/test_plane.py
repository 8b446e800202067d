"""Planes: orthonormal, right-handed with the viewer, and oriented as a physician expects, for any grid."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from deformnb.errors import DeformError
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid

COORDINATE = st.floats(-1e4, 1e4)
VECTORS = st.tuples(COORDINATE, COORDINATE, COORDINATE)


def grid_of(direction: Any) -> Grid:
    return Grid((5, 7, 9), (0.5, 1.0, 2.5), (10.0, -20.0, 30.0), tuple(map(tuple, np.asarray(direction).tolist())))


# All 48 ways to store a volume along the axes of the body: RAS, LPS, PIR, ...
SIGNED_AXES = [
    np.eye(3)[:, list(p)] * np.array(s)
    for p in itertools.permutations(range(3))
    for s in itertools.product([1.0, -1.0], repeat=3)
]


def check(plane: Plane) -> None:
    frame = plane.frame
    oracle.assert_close(frame @ frame.T, np.eye(3), atol=1e-12)
    oracle.assert_close(np.cross(plane.u, plane.v), plane.normal, atol=1e-15)
    assert np.linalg.det(frame) == pytest.approx(1)


# ---- frames ----------------------------------------------------------------------------------------------------------


@given(origin=VECTORS, normal=VECTORS, up=st.one_of(st.none(), VECTORS))
def test_through_any_direction_is_orthonormal_and_looks_along_it(origin: Any, normal: Any, up: Any) -> None:
    try:
        plane = Plane.from_normal(origin, normal, up)
    except DeformError as error:
        parallel = up is not None and np.linalg.norm(np.cross(normal, up)) <= 1e-8 * max(1.0, np.linalg.norm(normal))
        assert parallel or np.linalg.norm(normal) < 1e-11, error  # noqa: PT017 (which of the two comes is not known)
        return
    check(plane)
    oracle.assert_close(plane.normal, np.array(normal) / np.linalg.norm(normal), atol=1e-9)
    if up is not None:
        assert -np.array(up) @ plane.v >= 0  # up is up in the picture
        assert abs(np.array(up) @ plane.u) <= 1e-9 * max(1.0, np.linalg.norm(up))


@given(origin=VECTORS, normal=VECTORS, points=st.lists(VECTORS, min_size=1, max_size=5), depth=COORDINATE)
def test_coordinates_go_there_and_back(origin: Any, normal: Any, points: Any, depth: float) -> None:
    if np.linalg.norm(normal) < 1e-6:
        normal = (0.0, 0.0, 1.0)
    plane = Plane.from_normal(origin, normal)
    x = np.array(points)
    oracle.assert_close(plane.from_plane(plane.to_plane(x)), x, atol=1e-10)  # 1e4 times rounding, a few times
    flat = plane.from_plane(x[:, :2])
    oracle.assert_close(plane.to_plane(flat), np.c_[x[:, :2], np.zeros(len(x))], atol=1e-10)
    oracle.assert_close(plane.shifted(depth).to_plane(x), plane.to_plane(x) - [0, 0, depth], atol=1e-10)
    oracle.assert_close(plane.from_plane(x), origin + x @ np.array([plane.u, plane.v, plane.normal]), atol=1e-10)


def test_default_up_is_the_head_and_the_front_in_axial_pictures() -> None:
    assert Plane.from_normal((0, 0, 0), (0, 5, 0)) == Plane((0, 0, 0), (1, 0, 0), (0, 0, -1))
    assert Plane.from_normal((0, 0, 0), (0, 0, 1)) == Plane((0, 0, 0), (1, 0, 0), (0, 1, 0))
    assert Plane.from_normal((0, 0, 0), (0, 0, -1)).v == (0, 1, 0)
    tilted = Plane.from_normal((0, 0, 0), (0, 1, 0.5))
    assert tilted.v[2] < 0


@pytest.mark.parametrize(
    ("u", "v"),
    [
        ((1, 0, 0), (1, 0, 0)),
        ((2, 0, 0), (0, 1, 0)),
        ((1, 0, 0), (0, 0, 0)),
        ((1, 0, 0), (1e-5, 1, 0)),
        ((np.nan, 0, 0), (0, 1, 0)),
        ((1, 0, 0), (0, np.inf, 0)),
        ((1, 0), (0, 1)),
    ],
)
def test_frames_that_are_not_orthonormal_are_refused(u: Any, v: Any) -> None:
    with pytest.raises(DeformError):
        Plane((0, 0, 0), u, v)


@pytest.mark.parametrize(
    ("normal", "up", "message"),
    [
        ((0, 0, 0), None, "must not be zero"),
        ((1, 0, 0), (-2, 0, 0), "up must not be parallel"),
        ((np.nan, 0, 1), None, "three finite numbers"),
        ((1, 0), None, "three finite numbers"),
    ],
)
def test_directions_that_are_none_are_refused(normal: Any, up: Any, message: str) -> None:
    with pytest.raises(DeformError, match=message):
        Plane.from_normal((0, 0, 0), normal, up)


# ---- pictures of a grid ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("number", range(48))
def test_along_any_stored_order_shows_the_same_side_of_the_body(number: int, view: str) -> None:
    """In LPS: +x is the patient's left, +y the back, +z the head."""
    grid = grid_of(SIGNED_AXES[number])
    plane = Plane.from_view(grid, view)
    check(plane)
    wanted = {  # right of the picture, down the picture
        "+y": ([1, 0, 0], [0, 0, -1]),  # from the front: the patient's left on the viewer's right, head up
        "-y": ([-1, 0, 0], [0, 0, -1]),  # from the back
        "+x": ([0, -1, 0], [0, 0, -1]),  # from the patient's right: the front on the viewer's right
        "-x": ([0, 1, 0], [0, 0, -1]),
        "+z": ([1, 0, 0], [0, 1, 0]),  # from the feet, as axial pictures are shown: the patient's left on the right
        "-z": ([-1, 0, 0], [0, 1, 0]),
    }[view]
    oracle.assert_close([plane.u, plane.v], wanted, atol=1e-15)
    inside = plane.to_plane(grid.corners(centres=True))
    oracle.assert_close(inside[:, :2].min(axis=0), 0, atol=1e-12)  # pixel [0, 0] is at (0, 0)
    first, last = plane.depth_range(grid)
    assert last == pytest.approx(-first)  # the middle slice
    first, last = Plane.from_view(grid, view, depth=0.0).depth_range(grid)
    assert first == pytest.approx(0, abs=1e-12)
    lengths = {"x": 0, "y": 1, "z": 2}[view[1]]
    assert last == pytest.approx(float(np.ptp(grid.corners(centres=True), axis=0)[lengths]))
    assert str(plane.u).count("-0.0") == 0  # so that two equal planes print the same


@pytest.mark.parametrize("seed", range(20))
def test_along_a_turned_grid_takes_its_own_axes(seed: int) -> None:
    direction = Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    grid = grid_of(direction)
    for view in VIEWS:
        plane = Plane.from_view(grid, view)
        check(plane)
        for vector in (plane.u, plane.v, plane.normal):
            assert np.abs(direction.T @ vector).max() == pytest.approx(1)
        toward = np.eye(3)["xyz".index(view[1])] * (1 if view[0] == "+" else -1)
        assert np.array(plane.normal) @ toward == pytest.approx(np.abs(direction.T @ toward).max())
    front, back = Plane.from_view(grid, "+y"), Plane.from_view(grid, "-y")
    oracle.assert_close(front.normal, -np.array(back.normal), atol=1e-12)
    oracle.assert_close(front.v, back.v, atol=1e-12)


@pytest.mark.parametrize("angle", [45.0, 45.0 + 1e-9, 90.0])
def test_along_a_grid_between_two_axes_still_gives_a_frame(angle: float) -> None:
    for axis in np.eye(3):
        for view in VIEWS:
            check(Plane.from_view(grid_of(Rotation.from_rotvec(np.deg2rad(angle) * axis).as_matrix()), view))


@pytest.mark.parametrize("digits", [4, 5, 7])
def test_along_a_grid_with_printed_cosines_is_a_plane(digits: int) -> None:
    """Scanners print four to six decimals: the grid accepts that, so its planes must exist."""
    for seed in range(10):
        direction = Rotation.random(rng=np.random.default_rng(seed)).as_matrix().round(digits)
        for view in VIEWS:
            check(Plane.from_view(grid_of(direction), view))


def test_one_slice_has_no_depth() -> None:
    grid = Grid((1, 4, 4), (1, 1, 9.0))
    assert Plane.from_view(grid, "+z").depth_range(grid) == (0.0, 0.0)
    assert Plane.from_view(grid, "+z", depth=2.0).depth_range(grid) == (-2.0, -2.0)


@pytest.mark.parametrize("view", ["y", "+a", "", "front", "++y", None])
def test_unknown_views_are_refused_with_the_known_ones(view: Any) -> None:
    with pytest.raises(DeformError, match=r"choose one of \+x, -x, \+y"):
        Plane.from_view(Grid((2, 2, 2)), view)


# ---- rasters ---------------------------------------------------------------------------------------------------------


def test_raster_points_rows_and_box_agree() -> None:
    raster = Raster((3, 4), (0.5, 2.0), (10.0, -1.0))
    points = raster.points()
    assert points.shape == (3, 4, 2)
    assert points[2, 3].tolist() == [11.5, 3.0]
    assert (points[..., 0] == raster.columns).all()
    assert (points[..., 1] == raster.rows[:, None]).all()
    assert raster.box == (9.75, 11.75, -2.0, 4.0)
    assert raster.diagonal == pytest.approx(np.hypot(2, 6))


@pytest.mark.parametrize(
    "arguments",
    [
        ((0, 4), (1, 1), (0, 0)),
        ((3,), (1, 1), (0, 0)),
        ((3, 4), (0, 1), (0, 0)),
        ((3, 4), (1, -1), (0, 0)),
        ((3, 4), (1, np.nan), (0, 0)),
        ((3, 4), (1, 1), (np.inf, 0)),
    ],
)
def test_rasters_without_pixels_are_refused(arguments: Any) -> None:
    with pytest.raises(DeformError):
        Raster(*arguments)


@pytest.mark.parametrize("view", VIEWS)
def test_the_slices_of_a_side_are_its_layers_of_voxels(view: str) -> None:
    grid = Grid((4, 5, 6), (1.0, 2.0, 2.5))
    slices = Plane.from_view(grid, view).slices(grid)
    axis = "xyz".index(view[1])
    assert (slices.count, slices.spacing) == (grid.shape[2 - axis], grid.spacing[axis])
    assert [slices.index(slices.depth(k)) for k in range(slices.count)] == list(range(slices.count))
    first, last = Plane.from_view(grid, view).depth_range(grid)
    assert (slices.depth(-3), slices.depth(99)) == pytest.approx((first, last))
    assert (slices.index(-1e9), slices.index(1e9)) == (0, slices.count - 1)


def test_slices_aslant_lie_within_the_volume() -> None:
    grid = Grid((4, 5, 6), (1.0, 2.0, 2.5))
    plane = Plane.from_normal(grid.center, (1, 2, 3))
    slices, (first, last) = plane.slices(grid), plane.depth_range(grid)
    assert (slices.first, slices.spacing) == (first, 1.0)
    assert last - 1 < slices.depth(slices.count - 1) <= last

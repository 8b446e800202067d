"""Pictures: every projection against literal loops, on voxels and on lattices, from all sides."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import oracle
import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracle_pictures import DIRECTIONS, RAMP, TOP, column, composite, noise, trilinear, volume_of
from scipy.spatial.transform import Rotation

from deformnb.document.deformation import Deformation
from deformnb.errors import Cancelled, DeformError
from deformnb.imaging import projection as module
from deformnb.imaging.projection import PROJECTIONS, plane_lattice, project
from deformnb.rbf.points import ControlPoints
from deformnb.volume.plane import Picture, Plane, Raster
from deformnb.volume.transfer import PRESETS, TransferFunction, preset
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume

# ---- along the voxels ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("view", VIEWS)
def test_maximum_mean_and_slice_are_those_of_the_voxels_under_each_pixel(view: str, direction: str) -> None:
    volume = volume_of(noise((3, 4, 5)), (0.5, 1.0, 2.0), DIRECTIONS[direction], (10, -20, 30))
    pictures = {name: project(volume, view, name) for name in ("mip", "mean", "slice")}
    nv, nu = pictures["mip"].values.shape
    for row, col in itertools.product(range(nv), range(nu)):
        seen = column(volume, pictures["mip"], row, col)
        assert pictures["mip"].values[row, col] == max(seen)
        mean = sum(map(float, seen)) / len(seen)
        assert pictures["mean"].values[row, col] == pytest.approx(mean, rel=1e-6)  # it is a float32
        cut = pictures["slice"]
        place = volume.grid.point_to_index(cut.plane.from_plane(cut.raster.points()[row, col]))
        i, j, k = np.floor(place + 0.5 + 1e-9).astype(int)
        assert pictures["slice"].values[row, col] == volume.values[k, j, i]


@pytest.mark.parametrize(("view", "direction"), [("+z", "LPS"), ("-x", "RAS"), ("+y", "PIR")])
def test_composite_and_shading_follow_the_formula(view: str, direction: str) -> None:
    volume = volume_of(noise((4, 5, 6)), (0.5, 1.0, 2.0), DIRECTIONS[direction])
    flat, lit = (project(volume, view, name, transfer=RAMP) for name in ("composite", "shaded"))
    nv, nu = flat.values.shape[:2]
    columns = np.array([[column(volume, flat, r, c) for c in range(nu)] for r in range(nv)])
    layers = list(np.moveaxis(columns, 2, 0))
    near, far = flat.plane.depth_range(volume.grid)
    dn = (far - near) / (len(layers) - 1)
    # float32 sums of six layers of numbers up to 1: a few of its steps of 6e-8.
    oracle.assert_close(flat.values, composite(layers, dn, RAMP), atol=2e-6)
    wanted = composite(layers, dn, RAMP, slopes=(*flat.raster.spacing, dn))
    oracle.assert_close(lit.values, wanted, atol=2e-5)  # the 24th power of the highlight costs a digit
    assert np.abs(wanted - composite(layers, dn, RAMP))[..., :3].max() > 0.1  # shading does something


@pytest.mark.parametrize("method", PROJECTIONS)
def test_parts_of_a_picture_do_not_show(method: str, monkeypatch: pytest.MonkeyPatch) -> None:
    volume = volume_of(noise((40, 13, 4)))
    views: tuple[str | Plane, ...] = ("+z", Plane.from_normal(volume.grid.center, (0.1, 0.2, 1)))
    wanted = [project(volume, view, method, transfer=RAMP).values for view in views]
    for size in (1, 12):  # each row by itself, and some at a time
        monkeypatch.setattr(module, "_PIXELS", size)
        for k, view in enumerate(views):
            found = project(volume, view, method, transfer=RAMP).values
            oracle.assert_close(found, wanted[k], rtol=1e-6, atol=1e-6)  # places are rounded anew in each part


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("method", ["mip", "mean", "slice"])
def test_the_other_side_is_the_mirror_image(axis: str, method: str) -> None:
    volume = volume_of(noise((4, 5, 6)), (0.5, 1.0, 2.0), DIRECTIONS["RAS"])
    front, back = (project(volume, sign + axis, method) for sign in "+-")
    np.testing.assert_array_equal(front.values, back.values[:, ::-1])


def test_a_composite_shows_what_is_in_front() -> None:
    values = np.zeros((3, 1, 1), np.uint8)
    values[0], values[2] = 40, TOP
    opaque = TransferFunction(((0, 0, 0, 0), (40, 1, 0, 0), (TOP, 0, 1, 0)), ((0, 0), (40, 1), (TOP, 1)))
    red, green = (project(volume_of(values), view, "composite", transfer=opaque).values[0, 0] for view in ("+z", "-z"))
    oracle.assert_close(red, [1, 0, 0, 1], atol=1e-6)
    oracle.assert_close(green, [0, 1, 0, 1], atol=1e-6)


VALUES = st.one_of(st.integers(-20, 120).map(float), st.floats(-20, 120), st.sampled_from([50.0, 50.0, 50.0 + 1e-7]))
ALPHAS = st.one_of(st.floats(0, 0.9), st.sampled_from([0.0, 1.0]))


@given(
    colors=st.lists(st.tuples(VALUES, *[st.floats(0, 1)] * 3), min_size=1, max_size=6),
    opacities=st.lists(st.tuples(VALUES, ALPHAS), min_size=1, max_size=6),
    unit=st.floats(0.25, 4),
    dtype=st.sampled_from(["int16", "int32", "float32", "float64"]),
    hot=st.sampled_from([None, 1e6, -1e6, 3e4]),
    seed=st.integers(0, 9),
)
def test_a_hot_voxel_changes_no_other_pixel_of_any_transfer_function(
    colors: Any, opacities: Any, unit: float, dtype: str, hot: float | None, seed: int
) -> None:
    function = TransferFunction(tuple(sorted(colors)), tuple(sorted(opacities)), unit)
    values = np.random.default_rng(seed).uniform(0, 100, (2, 16, 20)).astype(dtype)
    values[:, 3, :6] = 0, 20, 50, 50, 100, 99  # nodes and jumps among them
    if hot is not None and (dtype != "int16" or abs(hot) <= np.iinfo("int16").max):
        values[0, 7, 7] = hot
    found = project(volume_of(values), "+z", "composite", transfer=function).values
    wanted = composite(list(values), 1.0, function)
    near = np.abs(values[..., None] - function.knots()[0]).min(axis=-1)
    # The side of a jump, or the place in a steeper ramp, of a value cannot be known to less than its last digits;
    # next to a node of opacity 1 the fourth root of the transparency, for a unit of 4, has more of them wrong.
    sure = (near > 1e-2) | ((near == 0) & (function.knots()[0] % 1 == 0).all())
    keep = sure.all(axis=0)
    oracle.assert_close(found[keep], wanted[keep], atol=5e-5)


def test_a_jump_at_a_value_shows_what_comes_after_it() -> None:
    values = np.array([[[0, 4, 5, 6, 10]]], np.int16)
    for low in (0, 5, -1000):
        step = TransferFunction(((0, 1, 1, 1),), ((low, 0), (5, 0), (5, 1), (10, 1)), unit=7.0)
        assert project(volume_of(values), "+z", "composite", transfer=step).values[0, :, 3].tolist() == [0, 0, 1, 1, 1]
    at_zero = TransferFunction(((0, 1, 1, 1),), ((0, 0), (0, 1)))
    values[0, 0] = -1, 0, 1, 2, 3
    assert project(volume_of(values), "+z", "composite", transfer=at_zero).values[0, :, 3].tolist() == [0, 1, 1, 1, 1]


@pytest.mark.parametrize("parts", [1, 7])
def test_opaque_values_stay_opaque_in_thin_layers(parts: int) -> None:
    alphas = [0, 0.1, 0.3, 0.7, 0.3, 1, 1]
    function = TransferFunction(((0, 1, 1, 1),), tuple((10.0 * k / parts, a) for k, a in enumerate(alphas)), unit=1e4)
    values = np.nextafter((np.array([[[50, 55, 60, 90]]]) / parts).astype(np.float32), np.float32(np.inf))
    assert project(volume_of(values), "+z", "composite", transfer=function).values[..., 3].min() == 1


def test_many_nodes_are_as_exact_as_few() -> None:
    rng = np.random.default_rng(5)
    at = np.sort(rng.uniform(0, 100, 300))
    function = TransferFunction(
        tuple((float(v), *rng.uniform(0, 1, 3)) for v in at),
        tuple((float(v), rng.uniform(0, 0.5)) for v in at[::2]),
        unit=2.0,
    )
    values = rng.uniform(-5, 105, (3, 10, 11)).astype(np.float32)
    found = project(volume_of(values), "+z", "composite", transfer=function).values
    # The steepest ramp, 1 over 1e-3 of a value, turns the last digit of a float32 of 100 into 4e-3 of a colour.
    oracle.assert_close(found, composite(list(values), 1.0, function), atol=8e-6 / np.diff(at).min())


@pytest.mark.parametrize("hot", [1e6, -1e6])
def test_light_knows_no_hot_voxel(hot: float) -> None:
    k, j, i = np.meshgrid(*[np.arange(20)] * 3, indexing="ij")
    values = np.clip(100 - 20 * (np.hypot(np.hypot(k - 10, j - 10), i - 10) - 4), 0, 100)
    ramp = TransferFunction(((0, 0.2, 0.5, 1), (100, 1, 0.5, 0.2)), ((20, 0), (100, 0.5)))
    spotted = values.copy()
    spotted[1, 2, 2] = hot
    for kind in ("float32", "float64"):
        plain, other = (
            project(volume_of(v.astype(kind)), "+z", "shaded", transfer=ramp).values for v in (values, spotted)
        )
        oracle.assert_close(other[5:, 5:], plain[5:, 5:], atol=1e-6)
        assert plain[5:, 5:].max() > 0.5


# ---- places ----------------------------------------------------------------------------------------------------------

ROTATIONS = [
    Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    for angles in ([20, 0, 0], [0, -35, 10], [40, 50, 60], [120, -10, 200])
]


def ball(grid: Grid, centre: np.ndarray, radius: float) -> Volume:
    nz, ny, nx = grid.shape
    k, j, i = np.meshgrid(np.arange(nz), np.arange(ny), np.arange(nx), indexing="ij")
    distance = np.linalg.norm(grid.index_to_point(np.stack([i, j, k], -1)) - centre, axis=-1)
    return Volume(np.clip(200 * (radius + 1 - distance), 0, 200).astype(np.uint8), grid)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("direction", "method"), [("LPS", "mip"), ("RAS", "mip"), ("PIR", "composite"), ("SLA", "mean")]
)
def test_a_ball_is_where_the_plane_says(direction: str, method: str) -> None:
    matrix = DIRECTIONS[direction]
    grid = Grid((24, 20, 16), (1.5, 1.0, 0.75), (5, -7, 11), tuple(map(tuple, matrix.tolist())))
    centre = grid.index_to_point([9.0, 7.0, 15.0])
    volume = ball(grid, centre, 3.0)
    planes = [Plane.from_view(grid, view) for view in VIEWS]
    planes += [Plane.from_normal(grid.center, r[:, 0], r[:, 1]) for r in ROTATIONS]
    for plane in planes:
        picture = project(volume, plane, method)
        weight = picture.grey().astype(float)
        found = (picture.raster.points() * weight[..., None]).sum(axis=(0, 1)) / weight.sum()
        # The ball has a soft edge on all sides, so that its middle is known to a fraction of the coarsest voxel.
        oracle.assert_close(found, plane.to_plane(centre)[:2], atol=0.2)


@pytest.mark.parametrize("degrees", [0.0, 0.005, 0.05, 0.2, 0.5])
@pytest.mark.parametrize("about", [0, 1, 2])
def test_a_plane_turned_a_little_is_not_taken_for_an_axis(about: int, degrees: float) -> None:
    grid = Grid((240, 12, 240))
    centre = np.array([230.0, 6.0, 10.0])
    frame = Plane.from_view(grid, "+y").frame @ Rotation.from_rotvec(np.radians(degrees) * np.eye(3)[about]).as_matrix()
    plane = Plane(grid.center, tuple(frame[0]), tuple(frame[1]))
    weight = project(ball(grid, centre, 3.0), plane, "mip")
    found = (weight.raster.points() * weight.grey()[..., None]).sum(axis=(0, 1)) / weight.grey().sum()
    # 0.2 degrees move the ball by 0.4 voxels; the limit of a straight view (0.011 degrees) moves it by 0.03 at most.
    oracle.assert_close(found, plane.to_plane(centre)[:2], atol=0.05)


@pytest.mark.parametrize("method", PROJECTIONS)
@pytest.mark.parametrize("view", VIEWS)
def test_a_lattice_without_rotation_gives_the_view_along_the_axis(view: str, method: str) -> None:
    volume = volume_of(noise((5, 6, 35)), (0.8, 0.8, 0.8), DIRECTIONS["RAS"], (1, 2, 3))
    straight = project(volume, view, method, transfer=RAMP, depth=0.2)
    oblique = project(volume, view, method, transfer=RAMP, depth=0.2, spacing=0.8)
    assert straight.raster.shape == oblique.raster.shape
    oracle.assert_close(straight.raster.box, oblique.raster.box, atol=1e-9)
    if method == "slice":  # the nearest slice along the axis, the exact place in the lattice
        assert np.abs(straight.values.astype(float) - oblique.values).max() <= TOP / 2 + 1
        return
    oracle.assert_close(straight.values, oblique.values, rtol=1e-6, atol=2e-5)


@pytest.mark.parametrize("rotation", [1, 2])
def test_oblique_pictures_are_literal_sums_over_the_lattice(rotation: int) -> None:
    volume = volume_of(noise((4, 5, 6), "float64"), (0.5, 1.0, 0.7), DIRECTIONS["RAS"])
    frame = ROTATIONS[rotation]
    plane = Plane.from_normal(volume.grid.center, frame[:, 0], frame[:, 1])
    pictures = {name: project(volume, plane, name, transfer=RAMP) for name in PROJECTIONS}
    lattice = plane_lattice(volume.grid, plane)
    layers = np.zeros(lattice.shape)
    for place in np.ndindex(lattice.shape):
        layers[place] = trilinear(volume, lattice.index_to_point(place[::-1]))
    atol = 1e-4 * TOP  # float32 places of voxels: 1e-5 of a voxel times the largest step between two of them
    oracle.assert_close(pictures["mip"].values, layers.max(axis=0), atol=atol)
    oracle.assert_close(pictures["mean"].values, layers.mean(axis=0), atol=atol)
    flat = composite(list(layers), 0.5, RAMP)
    oracle.assert_close(pictures["composite"].values, flat, atol=2e-3)  # half a step of the table of 1024 colours
    assert np.abs(pictures["shaded"].values[..., 3] - flat[..., 3]).max() < 2e-3
    low = plane.to_plane(lattice.origin)
    for row, col in np.ndindex(pictures["slice"].values.shape):
        point = plane.from_plane([low[0] + 0.5 * col, low[1] + 0.5 * row, 0.0])
        assert pictures["slice"].values[row, col] == pytest.approx(trilinear(volume, point), abs=atol)


@given(normal=st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda n: np.linalg.norm(n) > 0.1), spacing=st.floats(0.3, 3))
def test_a_lattice_covers_the_volume_and_little_more(normal: tuple[float, float, float], spacing: float) -> None:
    grid = Grid((5, 7, 9), (0.5, 1.0, 2.5), (10, -20, 30))
    plane = Plane.from_normal(grid.center, normal)
    lattice = plane_lattice(grid, plane, spacing)
    corners, box = plane.to_plane(grid.corners()), plane.to_plane(lattice.corners())
    assert (box.min(axis=0) <= corners.min(axis=0) + 1e-6).all()
    assert (box.max(axis=0) >= corners.max(axis=0) - 1e-6).all()
    assert (np.ptp(box, axis=0) < np.ptp(corners, axis=0) + spacing + 1e-6).all()


# ---- theorems --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("view", "axis"), [("+z", 0), ("-y", 1), ("+x", 2)])
def test_with_nearest_sampling_the_maximum_of_the_deformed_is_the_deformed_maximum(view: str, axis: int) -> None:
    volume = volume_of(noise((9, 10, 11)))
    plane = Plane.from_view(volume.grid, view)
    points = ControlPoints.from_arrays([[1, 1], [8, 1], [4, 8], [5, 4]], [[1.5, 1], [7, 2], [4, 7], [6.2, 4.4]])
    deformation = Deformation.from_picture_points(volume.grid, plane, points)
    after = project(deformation.apply(volume, method="nearest"), plane, "mip").values
    flat = project(volume, plane, "mip")
    thick = np.repeat(flat.values[None], 3, axis=0)  # the picture as a volume, three layers thick, in its own axes
    frame = tuple(map(tuple, plane.frame.T.tolist()))
    corner = plane.from_plane([*flat.raster.origin, -1.0])
    slab = Volume(thick, Grid(thick.shape, (1.0, 1.0, 1.0), tuple(corner), frame))
    wanted = deformation.apply(slab, method="nearest", fill=0).values[1]
    np.testing.assert_array_equal(after, wanted)


@pytest.mark.parametrize("method", ["composite", "shaded"])
def test_finer_sampling_makes_nothing_darker(method: str) -> None:
    # In the middle of the picture, away from the lit rim.
    pictures = []
    for n in (8, 16, 32):
        values = np.full((n, 5, 5), 20, np.uint8)
        values[:, 0, 0], values[:, 4, 4] = 0, TOP
        pictures.append(project(volume_of(values, (1, 1, 8 / n)), "+z", method, transfer=RAMP).values[2, 2])
    alpha = RAMP([20.0])[0, 3]
    assert pictures[0][3] == pytest.approx(1 - (1 - alpha) ** 8, abs=1e-3)
    for k in (1, 2):
        oracle.assert_close(pictures[k][3], pictures[0][3], atol=1e-6)
    if method == "composite":
        oracle.assert_close(pictures[1], pictures[2], atol=1e-6)


# ---- odd volumes -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", PROJECTIONS)
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 5, 6), (5, 1, 6), (5, 6, 1), (40, 1, 1)])
def test_thin_volumes_and_every_preset(method: str, shape: tuple[int, int, int]) -> None:
    volume = volume_of(noise(shape))
    for view in VIEWS:
        picture = project(volume, view, method)
        assert np.isfinite(picture.values).all()
        assert picture.rgb8().shape == (*picture.raster.shape, 3)
    if method in ("mip", "slice", "mean") and shape[0] == 1:
        np.testing.assert_array_equal(project(volume, "+z", method).values, volume.values[0])
    tilted = project(volume, Plane.from_normal(volume.grid.center, (1, 2, 3)), method)
    assert np.isfinite(tilted.values).all()


@pytest.mark.sampled(9)
@pytest.mark.parametrize("method", PROJECTIONS)
@pytest.mark.parametrize("dtype", ["bool", "uint8", "int8", "uint16", "int16", "int32", "float32", "float64"])
def test_every_type_of_voxel_gives_the_same_picture(method: str, dtype: str) -> None:
    top = 1 if dtype == "bool" else TOP
    values = noise((4, 5, 6), "int64", top)
    ramp = TransferFunction(
        tuple((v * top / TOP, *c) for v, *c in RAMP.colors), tuple((v * top / TOP, a) for v, a in RAMP.opacities)
    )
    for view in ("+z", Plane.from_normal((2, 2, 2), (1, 2, 3))):
        picture = project(volume_of(values.astype(dtype)), view, method, transfer=ramp)
        same = values.astype("uint8" if dtype == "bool" else "float64")
        wanted = project(volume_of(same), view, method, transfer=ramp)
        if dtype == "bool" and not isinstance(view, str):
            continue  # nearest, so other values than those of numbers
        rounding = 0.5 if picture.values.ndim == 2 else 0.01  # integers are rounded when a lattice is filled
        oracle.assert_close(
            picture.values.astype(float),
            wanted.values.astype(float),
            atol=1e-4 if isinstance(view, str) or dtype.startswith("float") else rounding + 1e-4,
        )
        assert picture.grey().dtype == np.float32
        assert 0 <= picture.grey().min() <= picture.grey().max() <= 1


def test_labels_are_not_blended() -> None:
    values = np.zeros((6, 6, 6), np.int16)
    values[2:4, 2:4, 2:4] = 50
    values[4:, 4:] = 7
    labels = Volume(values, Grid((6, 6, 6)), is_labels=True)
    for method in ("mip", "slice"):
        assert set(np.unique(project(labels, Plane.from_normal((2, 2, 2), (1, 2, 3)), method).values)) <= {0, 7, 50}


def test_hounsfield_units_are_black_at_air_and_white_at_bone() -> None:
    values = np.full((4, 5, 6), -1000, np.int16)
    values[2, 2:4, 2:5] = 40
    values[2, 3, 4] = 1500
    picture = project(volume_of(values), "+z")
    assert picture.window[0] == -1000
    grey = picture.grey()
    assert grey[0, 0] == 0
    assert grey[3, 4] == 1
    assert 0.3 < grey[2, 2] < 0.7


@pytest.mark.parametrize("method", ["slice", "mip", "mean"])
def test_the_window_begins_and_ends_at_percentiles_of_what_is_shown(method: str) -> None:
    values = np.random.default_rng(3).normal(500, 40, (12, 40, 40)).astype(np.float32)
    picture = project(volume_of(values), "+z", method)
    low, high = picture.window
    assert np.mean(picture.values < low) == pytest.approx(0.005, abs=0.002)
    assert np.mean(picture.values > high) == pytest.approx(0.005, abs=0.002)


def test_metal_and_the_padding_of_a_scanner_do_not_darken_the_window() -> None:
    values = np.full((24, 60, 60), -1000, np.int16)
    values[:, 15:45, 15:45] = np.random.default_rng(4).integers(0, 800, (24, 30, 30))
    plain = project(volume_of(values), "+z", "slice")
    assert plain.unit == "HU"
    spoiled = values.copy()
    spoiled[:, :6] = -3024
    spoiled[11:13, 30, 30:32] = 30000
    assert project(volume_of(spoiled), "+z", "slice").window == pytest.approx(plain.window, abs=5)
    implant = values.copy()
    implant[:, 20:24, 20:24] = 3071  # too many voxels for outliers, and more of the pixels than are made white
    seen, wanted = (project(volume_of(v), "+z", "mip").window for v in (implant, values))
    assert seen == pytest.approx(wanted, abs=5)


def test_labels_keep_the_background_black() -> None:
    values = np.full((6, 6, 6), 2, np.int16)
    values[3:] = 5
    picture = project(Volume(values, Grid((6, 6, 6)), is_labels=True), "+z")
    assert picture.window == (2, 5)
    assert picture.unit == ""


def test_padding_does_not_stretch_the_grey_levels() -> None:
    values = np.random.default_rng(2).integers(-1010, -990, (6, 20, 20)).astype(np.int16)
    values[:, 6:14, 6:14], values[:, 9:11, 9:11] = 40, 900
    values[:, 0] = -3024
    for method in ("slice", "mip", "mean"):
        low, high = project(volume_of(values), "+z", method).window
        assert -1010 <= low <= -990
        assert high > 0


@pytest.mark.parametrize("method", PROJECTIONS)
def test_voxels_that_are_not_finite_count_as_background(method: str) -> None:
    values = noise((4, 5, 6), "float32")
    clean, dirty = values.copy(), values.copy()
    for place, bad in (((0, 1, 1), np.nan), ((2, 2, 2), np.inf), ((3, 3, 3), -np.inf)):
        clean[place], dirty[place] = 0, bad
    for view in ("+z", Plane.from_normal((2, 2, 2), (1, 2, 3))):
        wanted, found = (project(volume_of(v), view, method, transfer=RAMP) for v in (clean, dirty))
        np.testing.assert_array_equal(found.values, wanted.values)
        assert found.window == wanted.window


@pytest.mark.parametrize("method", PROJECTIONS)
@pytest.mark.parametrize("value", [0, 7, -1000, 1e-30, 1e30, np.nan])
def test_a_constant_volume_is_an_even_picture(method: str, value: float) -> None:
    volume = volume_of(np.full((3, 4, 5), value, np.float32))
    picture = project(volume, "+y", method, transfer=RAMP)
    grey = picture.grey()
    assert np.isfinite(grey).all()
    assert picture.values.ndim == 3 or picture.window[1] > picture.window[0]
    if method != "shaded":  # the rim of a body is lit
        assert np.ptp(grey) == 0
    for name in PRESETS:
        assert np.isfinite(project(volume, "+y", method, transfer=PRESETS[name](volume)).values).all()


def test_values_closer_than_float32_holds_stay_apart() -> None:
    values = 1e9 + noise((3, 4, 5), "float64") / TOP
    picture = project(volume_of(values), "+z", "mip")
    low, high = picture.window
    assert 1e9 <= low < high <= values.max()
    grey = np.clip((values.max(axis=0) - low) / (high - low), 0, 1)
    oracle.assert_close(picture.grey(), grey, atol=1e-6)
    ramp = TransferFunction(
        tuple((1e9 + v / TOP, *c) for v, *c in RAMP.colors), tuple((1e9 + v / TOP, a) for v, a in RAMP.opacities)
    )
    wanted = project(volume_of(noise((3, 4, 5), "float64")), "+z", "composite", transfer=RAMP).values
    oracle.assert_close(project(volume_of(values), "+z", "composite", transfer=ramp).values, wanted, atol=1e-3)


def test_one_bright_spot_does_not_darken_the_rest() -> None:
    values = np.full((1, 40, 40), 100, np.uint16)
    values[0, 0] = 0
    values[0, 5, 5] = 60000
    assert project(volume_of(values), "+z").grey()[20, 20] == 1


# ---- choices ---------------------------------------------------------------------------------------------------------


def test_slices_are_numbered_from_the_front() -> None:
    values = np.arange(5, dtype=np.uint8)[:, None, None] * np.ones((5, 2, 2), np.uint8)
    volume = volume_of(values, (1, 1, 2.0))
    plane = Plane.from_view(volume.grid, "+z")
    assert [int(project(volume, plane, "slice", depth=d).values[0, 0]) for d in (-5, -4, -1.1, -0.9, 0, 4, 4.9)] == [
        0,
        0,
        1,
        2,
        2,
        4,
        4,
    ]
    back = Plane.from_view(volume.grid, "-z")
    assert [int(project(volume, back, "slice", depth=d).values[0, 0]) for d in (-4, 0, 4)] == [4, 2, 0]


@pytest.mark.parametrize("depth", [-5.01, 5.01, 1e9])
@pytest.mark.parametrize("spacing", [None, 1.0])
def test_a_slice_outside_is_refused(depth: float, spacing: float | None) -> None:
    volume = volume_of(np.zeros((5, 2, 2), np.uint8), (1, 1, 2.0))
    with pytest.raises(DeformError, match="outside the volume"):
        project(volume, "+z", "slice", depth=depth, spacing=spacing)


def test_unknown_names_list_the_choices() -> None:
    volume = volume_of(np.zeros((2, 2, 2), np.uint8))
    with pytest.raises(DeformError, match=r"unknown projection 'sum'.*mip, slice, mean, composite, shaded"):
        project(volume, "+z", "sum")
    with pytest.raises(DeformError, match=r"unknown view 'front'.*\+x"):
        project(volume, "front")


@pytest.mark.parametrize("spacing", [0.0, -1.0, np.nan, np.inf])
def test_a_bad_pixel_size_is_refused(spacing: float) -> None:
    with pytest.raises(DeformError, match="pixel size must be a positive length"):
        project(volume_of(np.zeros((2, 2, 2), np.uint8)), "+z", spacing=spacing)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("method", PROJECTIONS)
def test_progress_rises_to_one_and_can_stop_the_work(method: str) -> None:
    volume = volume_of(noise((70, 3, 3)))
    seen: list[float] = []
    project(volume, Plane.from_normal((1, 1, 35), (0.1, 0, 1)), method, progress=seen.append)
    assert seen == sorted(seen)
    assert seen[-1] == 1

    def stop(share: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        project(volume, "+z", method, progress=stop)


def test_background_shows_through() -> None:
    values = np.zeros((1, 2, 4), np.float32)
    values[0, 0] = [0.5, 0.25, 0, 0.5]
    raster = Raster((1, 2), (1, 1), (0, 0))
    picture = Picture(values, Plane((0, 0, 0), (1, 0, 0), (0, 1, 0)), raster, "composite", (0, 1))
    assert picture.rgb8((0, 0, 1.0))[0].tolist() == [[128, 64, 128], [0, 0, 255]]
    assert picture.extent == (-0.5, 1.5, 0.5, -0.5)
    assert picture.grey()[0, 0] == pytest.approx(0.2126 * 0.5 + 0.7152 * 0.25)


# ---- the paper's carp ------------------------------------------------------------------------------------------------


def test_the_real_carp_looks_left_with_its_back_up(real_data: Any) -> None:
    from deformnb.io import read_volume

    volume = read_volume(real_data("carp.nii.gz"), spacing=(0.390625, 1.0, 0.78125), stride=4)
    picture = project(volume, "-x", "mip")
    a0, a1, b0, b1 = picture.raster.box
    assert a1 - a0 == pytest.approx(512)
    assert b1 - b0 == pytest.approx(200)
    grey, columns, rows = picture.grey(), picture.raster.columns, picture.raster.rows
    bright, bone = grey > 0.08, grey > 0.7
    seen = columns[bright.any(axis=0)]
    middle = (seen.min() + seen.max()) / 2
    # The skull and the thick of the body are in front: 357 against 74 pixels, and a mean at 192 of 508.
    assert bone[:, columns < middle].sum() > 3 * bone[:, columns >= middle].sum()
    mean = project(volume, "-x", "mean").values.sum(axis=0)
    assert mean @ columns / mean.sum() < middle - 40
    # The spine is above the middle of the trunk: of the columns there, the brightest row is in the upper half.
    trunk = (columns > middle - 120) & (columns < middle)
    spine = rows[grey[:, trunk].argmax(axis=0)]
    centre = np.array([rows[bright[:, k]].mean() for k in np.flatnonzero(trunk)])
    assert np.median(spine - centre) < 0


def test_a_face_where_the_volume_ends_is_even_seen_aslant() -> None:
    k, j, i = np.indices((40, 24, 40)) - 19.5
    body = Volume(np.where(k**2 + (j + 0.5) ** 2 + i**2 < 18**2, 250, 0).astype(np.uint8)[:, 8:], Grid((40, 16, 40)))
    plane = Plane.from_normal(body.grid.center, (0.4, 1, -0.3))
    picture = project(body, plane, "shaded", transfer=preset("surface", body), spacing=0.5)
    a, b, _ = plane.to_plane((19.5, -0.5, 19.5))  # the middle of the face
    raster = picture.raster
    u, v = (round((c - o) / d) for c, o, d in zip((a, b), raster.origin, raster.spacing, strict=True))
    patch = picture.values[v - 6 : v + 7, u - 6 : u + 7, :3].mean(axis=2)
    assert patch.min() > 0.3
    assert np.ptp(patch) < 0.02


def test_a_picture_is_printed_in_one_line() -> None:
    volume = Volume(np.arange(24, dtype=np.uint8).reshape(2, 3, 4), Grid((2, 3, 4), (1.0, 1.0, 2.5)))
    assert repr(project(volume, "+z")).startswith(
        "<Picture: mip, 4 x 3 pixels (right, down) of 1 x 1, uint8 from 12.055 to "
    )
    assert repr(project(volume, "+y", "shaded")) == (
        "<Picture: shaded, 4 x 2 pixels (right, down) of 1 x 2.5, coloured>"
    )

"""Rendering: parts are clipped on the right side and lit, and nearer objects are larger."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from deformnb.imaging.projection import plane_lattice, project
from deformnb.imaging.raycast import Layers, PerspectiveCamera, windows_of
from deformnb.native.jobs import VOXEL_TYPES
from deformnb.volume.clip import ClipBox, check_clip
from deformnb.volume.plane import Picture, Plane
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.views import VIEWS
from deformnb.volume.volume import Grid, Volume

TURNED = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
GRID = Grid((12, 16, 20), (1.5, 1.0, 1.0), (5.0, -7.0, 30.0), TURNED)
SOLID = TransferFunction(((0, 1, 1, 1),), ((0, 0), (50, 0), (51, 0.9), (255, 0.9)))


def shape() -> Volume:
    """Noise that is nowhere background but in one voxel."""
    values = np.random.default_rng(1).integers(60, 255, GRID.shape).astype(np.uint8)
    values[0, 0, 0] = 50
    return Volume(values, GRID)


def part_of(axis: int, pair: tuple[float, float]) -> ClipBox:
    clip = [[0.0, 1.0] for _ in range(3)]
    clip[axis] = list(pair)
    part = ClipBox.of(GRID, check_clip(clip))
    assert part is not None
    return part


@pytest.mark.parametrize(
    "side", [(0, (0.25, 1.0)), (0, (0.0, 0.75)), (1, (0.25, 1.0)), (1, (0.0, 0.75)), (2, (0.25, 1.0)), (2, (0.0, 0.75))]
)
def test_the_largest_value_is_that_of_the_voxels_that_are_left(side: tuple[int, tuple[float, float]]) -> None:
    part = part_of(*side)
    for plane in (Plane.from_view(GRID, "+y"), Plane.from_view(GRID, "-x"), Plane.from_view(GRID, "+z")):
        # Labels are not interpolated: between a voxel and an emptied one there is no value.
        labels = replace(shape(), is_labels=True)
        cut = project(labels, plane, "mip", spacing=0.5, part=part).values
        assert (cut == project(part.mask_outside(labels), plane, "mip", spacing=0.5).values).all()
        assert (cut != project(labels, plane, "mip", spacing=0.5).values).any()


@pytest.mark.filterwarnings("error::deformnb.errors.DeformWarning")  # nothing is deformed: there is nothing to report
@pytest.mark.parametrize("method", ["slice", "mip", "composite", "shaded"])
def test_a_picture_of_a_volume_warns_of_no_deformation(method: str) -> None:
    volume = Volume(np.full(GRID.shape, 200, np.uint8), GRID)  # its ambient light is all but the same everywhere
    for plane in (Plane.from_view(GRID, "+y"), Plane.from_normal(GRID.center, (0.3, 1.0, -0.2))):
        project(volume, plane, method, spacing=2.0)


@pytest.mark.parametrize("view", VIEWS)
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("pair", [(0.5, 1.0), (0.0, 0.5)])
def test_light_falls_on_what_is_left_and_nothing_else(view: str, axis: int, pair: tuple[float, float]) -> None:
    plane, part = Plane.from_view(GRID, view), part_of(axis, pair)
    cut = project(shape(), plane, "composite", transfer=SOLID, spacing=0.5, part=part)
    alpha = cut.values[..., 3]
    # Every pixel's own ray: it is opaque where some voxel under it is left.
    places = plane.from_plane(cut.raster.points().reshape(-1, 2))
    at = GRID.point_to_index(places).reshape(*alpha.shape, 3)
    along = [k for k in range(3) if abs(np.asarray(GRID.direction)[:, k] @ plane.normal) < 0.5]
    n = np.asarray(GRID.shape[::-1])
    wanted = np.ones(alpha.shape, bool)
    for k in along:
        low, high = (part.low[k], part.high[k]) if k == axis else (-np.inf, np.inf)
        wanted &= (at[..., k] >= max(low, -0.5)) & (at[..., k] < min(high, n[k] - 0.5))
    assert ((alpha > 0.5) == wanted).all()


def test_a_face_that_was_cut_is_lit_evenly_whatever_lies_behind_it() -> None:
    rng = np.random.default_rng(0)
    noisy = Volume(rng.integers(100, 200, GRID.shape).astype(np.uint8), GRID)
    noisy.values[0, 0, 0] = 0
    plane = Plane.from_normal(GRID.center, (0.5, 1.0, -0.4))
    axis = int(np.argmax(np.abs(np.asarray(GRID.direction).T @ plane.normal)))
    ahead = float((np.asarray(GRID.direction).T @ plane.normal)[axis])
    part = part_of(axis, (0.5, 1.0) if ahead > 0 else (0.0, 0.5))
    cut = project(noisy, plane, "shaded", transfer=SOLID, spacing=0.5, part=part)
    emptied = project(part.mask_outside(noisy), plane, "shaded", transfer=SOLID, spacing=0.5)
    face = _inner(cut, part, axis, plane)
    assert face.sum() > 50
    assert cut.values[face][:, 0].std() < 0.25 * emptied.values[face][:, 0].std()
    light = np.array([-0.35, -0.45, -0.82]) / np.linalg.norm([-0.35, -0.45, -0.82])
    n = plane.frame @ np.asarray(GRID.direction)[:, axis]
    half = light + np.array([0.0, 0.0, -1.0])
    half /= np.linalg.norm(half)
    wanted = 0.35 + 0.75 * abs(n @ light) + 0.35 * abs(n @ half) ** 24
    assert np.median(cut.values[face][:, 0] / cut.values[face][:, 3]) == pytest.approx(wanted, rel=0.04)


def _inner(picture: Picture, part: ClipBox, axis: int, plane: Plane) -> np.ndarray:
    """Pixels whose rays enter through the middle of the face."""
    side = part.low[axis] if np.isfinite(part.low[axis]) else part.high[axis]
    start = GRID.point_to_index(plane.from_plane(picture.raster.points().reshape(-1, 2)))
    way = GRID.point_to_index(plane.from_plane([0.0, 0.0, 1.0])) - GRID.point_to_index(plane.origin)
    entry = start + ((side - start[:, axis]) / way[axis])[:, None] * way
    n = np.asarray(GRID.shape[::-1])
    others = [k for k in range(3) if k != axis]
    inside = np.all([(entry[:, k] > 2) & (entry[:, k] < n[k] - 3) for k in others], axis=0)
    return np.asarray(inside.reshape(picture.values.shape[:2]))


@pytest.mark.parametrize("method", ["mip", "composite", "shaded"])
def test_what_is_nearer_looks_larger(method: str) -> None:
    grid = Grid((41, 41, 41))
    values = np.zeros(grid.shape, np.uint8)
    for depth in (4, 36):  # seen along +y, a rod before and one behind the middle
        values[10, depth, 28] = values[10, depth, 29] = 200
    plane = Plane.from_normal(grid.center, (0, 1, 0))
    eye = PerspectiveCamera(60.0, 41.0, 41.0)
    seen = project(Volume(values, grid), plane, method, transfer=SOLID, spacing=0.5, eye=eye)
    bright = seen.values[..., -1] if seen.values.ndim == 3 else seen.values
    a, b = plane.to_plane([28.5, 20.0, 10.0])[:2]
    for depth in (4 - 20.0, 36 - 20.0):
        # A point `depth` behind the plane is seen that much nearer to the middle: Thales.
        wanted = np.array([a, b]) / (1 + depth / 60.0)
        off = np.abs(seen.raster.points() - wanted).max(axis=-1)
        assert bright[off < 0.6].max() > 0.3 * bright.max()
    lit = seen.raster.points()[bright > 0.1 * bright.max()]
    assert np.ptp(lit[:, 1]) == pytest.approx(abs(b) * (1 / (1 - 16 / 60) - 1 / (1 + 16 / 60)), abs=2.2)


def test_an_eye_within_the_volume_sees_what_lies_before_it() -> None:
    grid = Grid((9, 40, 9))
    values = np.zeros(grid.shape, np.uint8)
    values[:, 2] = 255  # behind the eye
    values[3:6, 29:32, 3:6] = 200
    plane = Plane.from_normal(grid.center, (0, 1, 0))
    seen = project(Volume(values, grid), plane, "mip", spacing=0.5, eye=PerspectiveCamera(8.0, 9.0, 9.0))
    assert 100 < seen.values.max() <= 200


def test_a_far_eye_sees_in_parallel() -> None:
    volume = shape()
    plane = Plane.from_normal(GRID.center, (0.2, 1.0, 0.1))
    near = project(volume, plane, "composite", transfer=SOLID, spacing=0.5)
    far = project(volume, plane, "composite", transfer=SOLID, spacing=0.5, eye=PerspectiveCamera(1e7, 40.0, 40.0))
    alpha = [p.values[..., 3].sum() for p in (near, far)]
    assert alpha[0] == pytest.approx(alpha[1], rel=0.05)  # the lattices are half a sample apart


@pytest.mark.parametrize("eye", [None, PerspectiveCamera(60.0, 41.0, 41.0)])
def test_samples_have_the_value_at_their_places(eye: PerspectiveCamera | None) -> None:
    k, j, i = np.indices(GRID.shape)
    volume = Volume((3.0 * i - 2.0 * j + 0.5 * k).astype(np.float32), GRID)
    plane = Plane.from_normal(GRID.center, (0.3, 1.0, -0.2))
    lattice = plane_lattice(GRID, plane, 0.7) if eye is None else eye.lattice(GRID, plane, 0.7)
    layers, rows = Layers.from_lattice(volume, lattice, plane, eye=eye), slice(9, 14)
    assert layers.places is not None
    compared = 0
    for depth in (5, lattice.shape[0] // 2):
        found = layers.values(depth, rows, slice(0, lattice.shape[2]))
        v, u = (axis.ravel() for axis in np.indices(found.shape))
        index = GRID.point_to_index(plane.from_plane(np.stack(layers.places(depth, v + rows.start, u), axis=-1)))
        inside = ((index > 0) & (index < np.array(GRID.shape[::-1]) - 1)).all(axis=1)
        np.testing.assert_allclose(found.ravel()[inside], (index @ [3.0, -2.0, 0.5])[inside], atol=1e-4)
        compared += inside.sum()
    assert compared > 50


@pytest.mark.parametrize("is_labels", [False, True])
@pytest.mark.parametrize("dtype", ["bool", *VOXEL_TYPES])
def test_layers_of_the_compiled_loops_are_those_of_numpy_rounded(dtype: str, is_labels: bool) -> None:
    if is_labels and dtype.startswith("float"):
        pytest.skip("labels are integers")
    rng = np.random.default_rng(3)
    values = rng.integers(0, 2 if dtype == "bool" else 120, GRID.shape).astype(dtype)
    volume, plane = Volume(values, GRID, is_labels=is_labels), Plane.from_normal(GRID.center, rng.normal(size=3))
    lattice = plane_lattice(GRID, plane, 0.7)
    read = Layers.read_rounded(volume, lattice)
    if read is None:
        pytest.skip("no compiled loops are in use")
    whole = Layers.from_lattice(volume, lattice, plane, held=(ClipBox.whole(GRID),))
    tall, wide = lattice.shape[1:]
    compared = 0
    for depth in range(0, lattice.shape[0], 3):
        found, wanted = (layers.values(depth, slice(2, tall), slice(1, wide)) for layers in (read, whole))
        if not dtype.startswith("float"):
            wanted = np.rint(wanted)
        is_close = np.abs(found.astype(float) - wanted) < 1e-3
        assert is_close.mean() > 0.999  # a place that rounds to the other side of a half, or of the border
        compared += (wanted != volume.background).sum()
    assert compared > 1000


@pytest.mark.parametrize("eye", [None, PerspectiveCamera(60.0, 41.0, 41.0), PerspectiveCamera(9.0, 9.0, 9.0)])
@pytest.mark.parametrize("method", ["mip", "composite", "shaded"])
def test_places_that_are_not_sampled_change_no_picture(
    method: str, eye: PerspectiveCamera | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    k, j, i = np.indices(GRID.shape)
    values = np.where((i - 13) ** 2 + (j - 4) ** 2 + (k - 2) ** 2 < 30, 200, -i).astype(np.int16)  # at two sides
    volume, plane = Volume(values, GRID), Plane.from_normal(GRID.center, (0.3, 1.0, -0.2))
    found = project(volume, plane, method, transfer=SOLID, spacing=0.7, eye=eye).values
    sampled = []

    def all_of(blocks: np.ndarray, lattice: Grid, *where: object) -> np.ndarray:
        windows = windows_of(blocks, lattice, *where)
        sampled.append(((windows[:, 1] - windows[:, 0]) * (windows[:, 3] - windows[:, 2])).sum() / lattice.size)
        return np.tile([0, lattice.shape[1], 0, lattice.shape[2]], (lattice.shape[0], 1))

    monkeypatch.setattr("deformnb.imaging.projection.windows_of", all_of)
    whole = project(volume, plane, method, transfer=SOLID, spacing=0.7, eye=eye).values
    np.testing.assert_allclose(found, whole, atol=1e-3)  # of the numbers of places too, which round otherwise
    assert 0 < sampled[0] < 1


def test_the_voxel_at_a_side_continues_for_half_a_voxel() -> None:
    volume = Volume(np.full(GRID.shape, 7, np.uint8), GRID)
    plane = Plane.from_view(GRID, "+y")
    lattice = plane_lattice(GRID, plane, 0.25)
    for held, reach in (((), 1.0), ((ClipBox.whole(GRID),), 0.5)):
        layers = Layers.from_lattice(volume, lattice, plane, held=held)
        tall, wide = lattice.shape[1:]
        v, u = (axis.ravel() for axis in np.indices((tall, wide)))
        assert layers.places is not None
        for depth in (0, lattice.shape[0] // 2, lattice.shape[0] - 1):
            found = layers.values(depth, slice(0, tall), slice(0, wide)).ravel()
            index = GRID.point_to_index(plane.from_plane(np.stack(layers.places(depth, v, u), axis=-1)))
            beyond = np.maximum(-index, index - (np.array(GRID.shape[::-1]) - 1)).max(axis=1)
            assert (found[beyond < reach - 1e-4] == 7).all()
            assert (found[beyond > reach + 1e-4] == volume.background).all()

"""The phantoms: the same object at every resolution, the right anatomy in the right place, and fast."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from deformnb.datasets import PHANTOMS
from deformnb.datasets.phantoms import shapes
from deformnb.datasets.phantoms.fish import scene as fish_scene
from deformnb.datasets.phantoms.scene import Part, PhantomScene, render, render_labels
from deformnb.errors import Cancelled, DeformError
from deformnb.volume.plane import Plane
from deformnb.volume.views import VIEWS

NAMES = sorted(PHANTOMS)
COARSE = (24, 26, 22)


def axis_arrays(x, y, z):
    """Coordinates of single points (n,) as solids take them."""
    return [np.asarray(v, dtype=np.float32).reshape(-1, 1, 1) for v in (x, y, z)]


@pytest.fixture(scope="module", params=NAMES)
def named(request):
    row = PHANTOMS[request.param]
    return row, row.make()


def test_every_object_of_the_paper_has_a_phantom():
    figures = " ".join(row.figure for row in PHANTOMS.values())
    assert set("1234567") - {"2"} <= set(figures.replace(",", " "))
    assert all(row.view in VIEWS and row.projection in ("mip", "slice") for row in PHANTOMS.values())


@pytest.mark.sampled(3)
def test_default_volume_is_a_ct_like_byte_volume(named):
    _, volume = named
    assert volume.dtype == np.uint8
    assert not volume.is_labels
    assert volume.background == 0
    assert volume.value_range[1] >= 200, "something is as dense as bone or shell"
    assert 0.02 < (volume.values > 30).mean() < 0.8, "an object surrounded by air, neither empty nor full"


def test_air_is_exactly_zero_outside(named):
    row, volume = named
    faces = [volume.values[:, 0], volume.values[:, -1], volume.values[:, :, 0], volume.values[:, :, -1]]
    empty = sum(bool((face == 0).all()) for face in faces)
    assert empty >= 3, f"{row.title} touches more than one side of its box; scans are cut at most above and below"


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", NAMES)
def test_same_bytes_again_and_whatever_the_slabs(name, monkeypatch):
    make = PHANTOMS[name].make
    first = make(COARSE).values
    np.testing.assert_array_equal(first, make(COARSE).values)
    monkeypatch.setattr("deformnb.datasets.phantoms.scene.SLAB_VOXELS", 5 * COARSE[1] * COARSE[2])
    np.testing.assert_array_equal(first, make(COARSE).values)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", NAMES)
def test_anatomy_stays_in_place_at_another_resolution(name):
    make = PHANTOMS[name].make
    coarse, fine = make((30, 32, 34), noise=0, dtype="float32"), make((60, 64, 68), noise=0, dtype="float32")
    np.testing.assert_allclose(coarse.grid.lengths, fine.grid.lengths, rtol=1e-12)
    np.testing.assert_allclose(coarse.grid.corners(), fine.grid.corners(), atol=1e-9)
    pooled = fine.values.reshape(30, 2, 32, 2, 34, 2).mean(axis=(1, 3, 5))
    # Thin shells blur over coarse voxels, so values differ there; the two pictures still are the same picture.
    assert np.corrcoef(pooled.ravel(), coarse.values.ravel())[0, 1] > 0.93
    a, b = (np.average(np.indices(v.shape).reshape(3, -1), axis=1, weights=v.ravel()) for v in (pooled, coarse.values))
    np.testing.assert_allclose(a, b, atol=0.25, err_msg="the centre of mass moved by a quarter of a coarse voxel")


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", NAMES)
def test_progress_reaches_one_and_may_cancel(name):
    seen: list[float] = []
    PHANTOMS[name].make(COARSE, progress=seen.append)
    assert seen[-1] == 1.0
    assert seen == sorted(seen)

    def stop(_: float) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        PHANTOMS[name].make(COARSE, progress=stop)


def test_the_largest_usual_grid_takes_a_second_or_two():
    start = time.thread_time()  # of the processor: others on the machine do not count
    PHANTOMS["fish"].make((128, 128, 128))
    # About 0.25 s on a laptop; ten times that still shows an accidental loop over the whole volume per part.
    assert time.thread_time() - start < 2.5


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 40, 40), (3, 50, 2)])
@pytest.mark.parametrize("name", NAMES)
def test_any_shape_works(name, shape):
    assert PHANTOMS[name].make(shape).shape == shape


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"shape": (0, 4, 4)}, "each at least 1"),
        ({"shape": (4, 4)}, "nz, ny, nx"),
        ({"dtype": "bool"}, "cannot hold"),
        ({"dtype": "int64"}, "cannot hold"),
        ({"noise": -1.0}, "noise"),
        ({"noise": float("nan")}, "noise"),
    ],
)
def test_bad_arguments_are_named(arguments, words):
    with pytest.raises(DeformError, match=words):
        PHANTOMS["bar"].make(**{"shape": (4, 4, 4), **arguments})


def test_other_voxel_types_hold_the_same_greys():
    exact = PHANTOMS["knee"].make(COARSE, dtype="float64", noise=0).values
    for dtype in ("uint8", "uint16", "int16", "int32", "float32"):
        # Rounding to whole grey values, and float32 arithmetic below that.
        np.testing.assert_allclose(PHANTOMS["knee"].make(COARSE, dtype=dtype, noise=0).values, exact, atol=0.5 + 1e-4)


# -- anatomy ----------------------------------------------------------------------------------------------------------


def test_fish_has_the_grid_of_the_real_carp(real_data):
    import nibabel

    header = nibabel.load(real_data("carp.nii.gz"))
    assert header.shape == (256, 512, 256)
    volume = PHANTOMS["fish"].make((8, 16, 8))
    np.testing.assert_allclose(volume.grid.lengths, np.array(header.shape) * (0.390625, 1.0, 0.78125))
    # RAS in the file: its axes point to -x, -y, +z of LPS.
    np.testing.assert_array_equal(np.asarray(volume.grid.direction), np.diag([-1.0, -1.0, 1.0]))


def test_fish_has_the_outline_of_the_real_carp(real_data):
    import nibabel

    real = np.asarray(nibabel.load(real_data("carp.nii.gz")).dataobj).T
    ours = PHANTOMS["fish"].make((64, 128, 64), noise=0).values
    a = (real > 40).any(axis=2).reshape(64, 4, 128, 4).mean(axis=(1, 3)) > 0.5
    b = (ours > 40).any(axis=2)
    overlap = 2 * (a & b).sum() / (a.sum() + b.sum())
    assert overlap > 0.95, "Dice overlap of the side silhouettes"


def test_fish_looks_left_in_its_default_view():
    volume = PHANTOMS["fish"].make((32, 64, 32))
    plane = Plane.from_view(volume.grid, PHANTOMS["fish"].view)
    snout, tail = (volume.grid.index_to_point([16, j, 15]) for j in (62, 3))
    assert plane.to_plane(snout)[0] < plane.to_plane(tail)[0], "the head is on the left of the picture"
    back, belly = (volume.grid.index_to_point([16, 32, k]) for k in (28, 3))
    assert plane.to_plane(back)[1] < plane.to_plane(belly)[1], "the back is up"


def test_fish_is_symmetric_and_has_an_air_bladder():
    values = PHANTOMS["fish"].make((64, 128, 64), noise=0, dtype="float32").values
    # The gut is on one side and the ripple of the texture is not symmetric, hence the mean and not the maximum.
    assert np.abs(values - values[:, :, ::-1]).mean() < 1.5
    middle = values[:, :, 32]
    assert middle[31, 80] == 0, "front chamber of the swim bladder"
    assert middle[27, 65] == 0, "rear chamber"
    assert middle[20, 80] > 60


def test_fish_vertebrae_are_separate():
    values = PHANTOMS["fish"].make((128, 512, 64), noise=0, dtype="float32").values[:, :, 30:34].max(axis=2)
    line = np.interp(np.arange(200, 380), *np.array([(p[0], p[1]) for p in fish_scene_spine()]).T)
    along = np.array([values[round(z * 128 / 200), y] for y, z in zip(range(200, 380), line, strict=True)])
    peaks = np.flatnonzero((along[1:-1] > along[:-2]) & (along[1:-1] >= along[2:]) & (along[1:-1] > 100))
    # 37 vertebrae over 285 mm: 23 of them over these 180 mm; each shows at least one of its two bright ends.
    assert len(peaks) >= 20


def fish_scene_spine():
    from deformnb.datasets.phantoms.fish import SPINE

    assert fish_scene().parts
    return SPINE


@pytest.mark.parametrize("name", [n for n in NAMES if PHANTOMS[n].label_names])
def test_labels_lie_on_the_volume(name):
    row = PHANTOMS[name]
    labels, volume = row.labels(), row.make(noise=0)
    assert labels.is_labels
    assert labels.grid == volume.grid
    found = set(np.unique(labels.values).tolist()) - {0}
    assert found == set(row.label_names), "every name is drawn, and nothing without a name"
    assert (volume.values[labels.values == 0] == 0).mean() > 0.95, "what has no label is air"


def test_the_cubes_of_the_bar_begin_at_its_corner() -> None:
    """The block begins at (28, 44, 76), its cubes are of 20, and so are as many voxels."""
    bar = PHANTOMS["bar"].make((192, 128, 256), noise=0)
    for y, sign in ((52, 1), (60, 1), (76, -1)):
        columns = (34, 46, 50, 66, 70)
        index = bar.grid.point_to_index([[x, y, 80.0] for x in columns]).round().astype(int)
        found = [int(bar.values[k, j, i]) for i, j, k in index]
        assert found == pytest.approx([105 + sign * way * 35 for way in (1, 1, -1, -1, 1)], abs=5)  # of soft edges


def test_knee_bones_are_hard_shells_in_the_right_order():
    labels, values = PHANTOMS["knee"].labels().values, PHANTOMS["knee"].make(noise=0).values
    heights = {bone: np.argwhere(labels == bone)[:, 0].mean() for bone in (95, 96, 97, 98)}
    assert heights[95] > heights[98] > max(heights[96], heights[97])
    for bone in (95, 96, 97, 98):
        inside = labels == bone
        core = ndimage.binary_erosion(inside, iterations=3)
        assert values[inside & ~ndimage.binary_erosion(inside)].mean() > values[core].mean() + 30, "hard"
    gap = (labels == 95).any(axis=(1, 2)) & (labels == 96).any(axis=(1, 2))
    assert gap.sum() < 8, "femur and tibia meet at the joint and hardly overlap in height"
    assert not np.logical_and(labels == 95, np.roll(labels == 96, 1, axis=0)).any(), "a joint space, not one bone"


def test_abdomen_organs_are_on_their_sides():
    labels = PHANTOMS["abdomen"].labels().values
    nx = labels.shape[2]
    at = {organ: np.argwhere(labels == organ).mean(axis=0) for organ in (3, 4, 7, 8, 51, 52, 501)}
    assert at[3][2] < nx / 2 < at[4][2], "liver on the patient's right (low x), spleen on the left"
    assert at[51][2] < at[8][2] < at[7][2] < at[52][2], "right kidney, vena cava, aorta, left kidney"
    assert at[51][0] < at[52][0], "the liver pushes the right kidney down"
    assert at[7][1] < at[501][1], "the aorta runs in front of the spine"


# -- solids -----------------------------------------------------------------------------------------------------------

SOLIDS = {
    "ellipsoid": shapes.Ellipsoid((1, 2, 3), (4, 2, 3)),
    "turned ellipsoid": shapes.Ellipsoid((1, 2, 3), (4, 2, 3), ((0.6, 0.8, 0.0), (-0.8, 0.6, 0.0), (0.0, 0.0, 1.0))),
    "tube": shapes.Tube(((-3, 0, 1), (2, 1, 2), (4, 4, 4)), (1.0, 2.0, 0.5)),
    "loft": shapes.Loft("y", ((-4, 0, 0, 1, 1), (0, 1, 0, 3, 2), (5, 0, 1, 1, 2))),
    "boxy loft": shapes.Loft("z", ((-4, 0, 0, 1, 1), (0, 1, 0, 3, 2), (5, 0, 1, 1, 2)), power=4),
    "sheet": shapes.Sheet(((0, 0), (4, 1), (3, 4), (1, 2)), 1.0, (0.5, 0, 0)),
    "block": shapes.Block((-1, -2, 0), (3, 4, 2), 0.5),
    "blend": shapes.Blend((shapes.Ellipsoid((0, 0, 0), (2, 2, 2)), shapes.Tube(((0, 0, 0), (4, 0, 0)), (1.0,))), 1.0),
    "shell": shapes.Shell(shapes.Ellipsoid((0, 0, 0), (3, 3, 3)), 1.0, 0.5),
    "cut": shapes.Both(
        (shapes.Ellipsoid((0, 0, 0), (3, 3, 3)), shapes.Block((0, -9, -9), (9, 9, 9))),
        minus=(shapes.Ellipsoid((2, 0, 0), (1, 1, 1)),),
    ),
}


@pytest.mark.parametrize("name", SOLIDS)
@given(st.tuples(*[st.floats(-12, 12)] * 3))
def test_nothing_of_a_solid_is_outside_its_box(name, point):
    solid = SOLIDS[name]
    low, high = solid.box
    if any(p < a - 1e-3 or p > b + 1e-3 for p, a, b in zip(point, low, high, strict=True)):
        assert solid.distance(*axis_arrays(*([c] for c in point))).item() >= -1e-3


@pytest.mark.parametrize(
    "name", ["ellipsoid", "turned ellipsoid", "tube", "sheet", "block", "shell", "loft", "boxy loft"]
)
def test_distances_are_right_near_the_surface(name):
    solid = SOLIDS[name]
    rng = np.random.default_rng(3)
    points = rng.uniform(-6, 8, (40000, 3)).astype(np.float32)
    d = solid.distance(*axis_arrays(*points.T)).ravel()
    inside, outside = points[d <= 0], points[(d > 0.05) & (d < 0.5)]
    assert len(inside) > 100
    gaps = np.linalg.norm(outside[:60, None, :] - inside[None, :, :], axis=-1).min(axis=1)
    # The nearest of the random inside points is a little too far (about 0.2 apart), never nearer than the surface.
    assert (gaps >= 0.6 * d[(d > 0.05) & (d < 0.5)][:60]).all(), "never more than 1.7 times too far"
    assert (gaps - d[(d > 0.05) & (d < 0.5)][:60]).max() < 1.2


def test_polygon_signs_match_a_literal_crossing_count():
    outline = ((0, 0), (4, 1), (3, 4), (1.5, 1.5), (0.5, 3))
    rng = np.random.default_rng(5)
    a, b = rng.uniform(-1, 5, (2, 3000))
    inside = np.zeros(3000, dtype=bool)
    for (a0, b0), (a1, b1) in zip(outline, [*outline[1:], outline[0]], strict=True):
        with np.errstate(divide="ignore", invalid="ignore"):
            crosses = ((b0 > b) != (b1 > b)) & (a < (a1 - a0) * (b - b0) / (b1 - b0) + a0)
        inside ^= crosses
    d = shapes.Sheet(outline, 1.0).distance(*axis_arrays(np.zeros(3000), a, b)).ravel()
    np.testing.assert_array_equal((d < 0)[np.abs(d) > 1e-4], inside[np.abs(d) > 1e-4])


def test_smooth_curve_passes_through_its_knots_and_never_overshoots():
    knots, values = np.array([0.0, 1.0, 3.0, 4.0]), np.array([0.0, 2.0, 2.0, -1.0])
    np.testing.assert_allclose(shapes.smooth_curve(knots, values, knots), values, atol=1e-12)
    fine = shapes.smooth_curve(knots, values, np.linspace(-1, 5, 500))
    assert fine.max() <= 2.0 + 1e-12
    assert fine.min() >= -1.0 - 1e-12
    np.testing.assert_allclose(
        shapes.path([[0, 0, 0], [1, 1, 0], [3, 1, 1]], 3)[[0, -1]], [[0, 0, 0], [3, 1, 1]], atol=1e-12
    )


def test_edge_is_one_voxel_wide_and_layers_stack():
    ball = Part(shapes.Ellipsoid((10, 10, 10), (6, 6, 6)), ((0.0, 200.0), (3.0, 100.0)), label=7)
    scene = PhantomScene("ball", (20.0, 20.0, 20.0), (40, 40, 40), (ball,), texture=0.0)
    ray = render(scene, noise=0, dtype="float32").values[20, 20, 20:]
    assert ray[0] == 100
    assert ray[8] == 200
    assert ray[-1] == 0
    assert ((ray > 0) & (ray < 100)).sum() <= 1, "from shell to air within one voxel"
    labels = render_labels(scene).values
    # Volume of the ball in voxels of 0.125 mm3; a staircase of half-millimetre voxels is within one percent.
    assert (labels == 7).sum() * 0.125 == pytest.approx(4 / 3 * np.pi * 6**3, rel=0.01)


def test_a_label_of_minus_one_clears():
    ball, hole = shapes.Ellipsoid((10, 10, 10), (6, 6, 6)), shapes.Ellipsoid((10, 10, 10), (2, 2, 2))
    scene = PhantomScene(
        "ball", (20.0, 20.0, 20.0), (20, 20, 20), (Part(ball, ((0.0, 9.0),), 3), Part(hole, ((0.0, 0.0),), -1))
    )
    labels = render_labels(scene).values
    assert labels[10, 10, 10] == 0
    assert labels[10, 10, 14] == 3

"""Folds in VTK's shader: red where the core's determinant is negative, on visible tissue, and nowhere else."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from deformnb.analysis.folds import find_folds, jacobian_determinant
from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.cuts import Cut
from deformnb.rbf.extrusion import Extrusion, replicate
from deformnb.rbf.fields import AbstractField, DisplacementField, compose
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.camera import visible_height
from deformnb.widgets.textures import field_textures
from deformnb.widgets.view.stills import CoreScene
from deformnb.widgets.vtk import folds as vtk_folds
from deformnb.widgets.vtk import shader as vtk_warp
from deformnb.widgets.vtk.folds import RED, UNSEEN, Folding, maps_fold
from deformnb.widgets.vtk.scene import VtkScene, folds_work, frame_of

GRID = Grid((24, 40, 48), (1.5, 1.5, 1.5), (3.0, -8.0, 20.0))
PLANE = Plane.from_view(GRID, "-z")
SIZE = (144, 120)
FACING = {"direction": PLANE.normal, "up": [-c for c in PLANE.v]}
FAR, SHORT = 0.45, 0.08
OPAQUE = TransferFunction(((0, 0.8, 0.9, 0.9),), ((0, 0), (70, 0), (75, 1), (255, 1)))


def slab() -> Volume:
    """All tissue, so that every ray meets some; the middle slice is the brightest."""
    values = np.zeros(GRID.shape, np.uint8)
    values[4:-4] = 150
    values[12] = 200
    return Volume(values, GRID, "slab")


def pulled(by: float, row: float = 0.45) -> ControlPoints:
    """A point left of the middle that is taken to the right, past one that stays as the corners do."""
    corners = PLANE.to_plane(GRID.corners())[:, :2]
    low, high = corners.min(axis=0), corners.max(axis=0)
    ends = [[0.05, 0.05], [0.95, 0.05], [0.05, 0.95], [0.95, 0.95]]
    at = low + (high - low) * np.array([*ends, [0.3, row], [0.62, 0.62]])
    target = at.copy()
    target[4, 0] += by * (high[0] - low[0])
    return ControlPoints.from_arrays(at, target)


def field_of(name: str, by: float = FAR) -> AbstractField:
    """A deformation that folds if it goes far enough."""
    flat = Deformation.from_picture_points(GRID, PLANE, pulled(by))
    if name == "modulate":
        flat = Deformation.from_picture_points(GRID, PLANE, pulled(by), extrusion="modulate", curve="0.6 + 0.4*z")
    elif name == "interpolate":
        maps = (pulled(by), pulled(by, 0.55), pulled(by, 0.5))
        flat = Deformation((Step(maps, PLANE, extrusion="interpolate", knots=(0.0, 0.3, 1.0)),))
    elif name == "oblique":
        grown = Plane.from_normal(GRID.center, (0.1, 0.2, -1.0), (0.0, 1.0, 0.0))
        source = grown.to_plane(PLANE.from_plane(pulled(by).source))[:, :2]
        target = grown.to_plane(PLANE.from_plane(pulled(by).target))[:, :2]
        flat = Deformation.from_picture_points(GRID, grown, ControlPoints.from_arrays(source, target))
    elif name == "after another":
        side = Plane.from_view(GRID, "+y")
        corners = side.to_plane(GRID.corners())[:, :2]
        nudge = ControlPoints.from_arrays(corners.mean(axis=0)[None], corners.mean(axis=0)[None] + [[1.0, 1.0]])
        flat = Deformation.from_picture_points(GRID, side, nudge).then(flat.steps[0])
    elif name == "in space":
        source = PLANE.from_plane(np.concatenate([pulled(by).source, np.zeros((6, 1))], axis=1))
        target = PLANE.from_plane(np.concatenate([pulled(by).target, np.zeros((6, 1))], axis=1))
        flat = Deformation.from_space_points(ControlPoints.from_arrays(source, target))
    elif name == "cut":
        a, b = PLANE.to_plane(GRID.center)[:2]
        cut = Cut(Line(((a + 25.0, b - 40.0), (a + 25.0, b + 40.0))))
        flat = Deformation((Step((pulled(by),), PLANE, cuts=(cut,), trend="translation"),))
    return flat.field(GRID)


KINDS = ["replicate", "modulate", "interpolate", "oblique", "after another", "in space", "cut"]


@pytest.fixture
def scene() -> Iterator[Any]:
    """Makes scenes that look along the plane's normal and show folds; they are closed at the end."""
    made: list[VtkScene] = []

    def make(method: str = "texture", **options: Any) -> VtkScene:
        made.append(
            VtkScene(slab(), SIZE, **{"transfer": OPAQUE, "method": method, "projection": "composite", **options})
        )
        made[-1].set_camera(FACING)
        made[-1].folding.show = True
        return made[-1]

    yield make
    for one in made:
        one.close()


def red(image: Any, by: int = 25) -> NDArray[np.bool_]:
    r, g, b = np.moveaxis(image.astype(int), -1, 0)
    return np.asarray((r > g + by) & (r > b + by))


def places(depth: float = 0.0) -> NDArray[np.float64]:
    """Place in space that each pixel shows, at this depth behind the middle of the volume."""
    step = visible_height(GRID, FACING["direction"], FACING["up"], SIZE[0] / SIZE[1]) / SIZE[1]
    a, b = np.meshgrid(*((np.arange(n) + 0.5 - n / 2) * step for n in SIZE))
    return Plane.from_normal(GRID.center, PLANE.normal, FACING["up"]).from_plane(
        np.stack([a, b, np.full(a.shape, depth)], axis=-1)
    )


def tissue_mask(field: AbstractField, at: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Check whether a place of the result, and the tissue seen there, is within the volume."""
    low, high = GRID.corners().min(axis=0) + 3, GRID.corners().max(axis=0) - 3
    return np.asarray(
        ((at > low) & (at < high)).all(axis=-1)
        & ((at + field.displacement(at) > low) & (at + field.displacement(at) < high)).all(axis=-1)
    )


FRONT = -11.5  # of the slab, as the viewer sees it


@pytest.mark.sampled(4)
@pytest.mark.needs_gl
@pytest.mark.parametrize("kind", KINDS)
def test_what_folds_is_red_at_its_place(scene: Any, kind: str) -> None:
    one, field = scene(), field_of(kind)
    one.set_field(field)
    painted, at = red(one.render()), places(FRONT)
    det, seen = jacobian_determinant(field, at), tissue_mask(field, at)
    assert (det <= 0)[seen].sum() > 100
    sure = seen & (np.abs(det) > 0.1)
    assert (painted == (det <= 0))[sure].mean() > 0.98
    assert not painted[~tissue_mask(field, places(0.0)) & ~seen & (det > 0.1)].any()
    assert one.folding.remark == RED


@pytest.mark.needs_gl
@pytest.mark.parametrize("projection", ["shaded", "mip"])
def test_in_all_projections(scene: Any, projection: str) -> None:
    one, field = scene(projection=projection, transfer="surface"), field_of("replicate")
    one.set_field(field)
    image = one.render().astype(int)
    one.folding.show = False
    painted = np.abs(image - one.render()).max(axis=-1) > 8  # light and tissue are warm too
    det, seen = jacobian_determinant(field, places()), tissue_mask(field, places())
    sure = seen & (np.abs(det) > 0.1)
    assert (painted == (det <= 0))[sure].mean() > 0.98
    assert (image[..., 0] - image[..., 1])[sure & painted].mean() > 60


@pytest.mark.sampled(4)
@pytest.mark.needs_gl
@pytest.mark.parametrize("kind", KINDS)
def test_what_does_not_fold_is_drawn_by_the_same_shader_as_ever(scene: Any, kind: str) -> None:
    one, field = scene(), field_of(kind, SHORT)
    assert find_folds(field, GRID.resampled(spacing=4.0)).least > 0
    one.set_field(field)
    image, text = one.render(), one.shader.warp.kind
    assert not red(image).any()
    assert one.folding.remark == ""
    one.folding.show = False
    np.testing.assert_array_equal(one.render(), image)
    assert one.shader.warp.kind == text


@pytest.mark.needs_gl
def test_it_can_be_switched_off_and_on_and_an_original_has_none(scene: Any) -> None:
    one = scene()
    one.set_field(field_of("replicate"))
    first = one.render()
    assert red(first).sum() > 300
    assert not red(one.render(shows="original")).any()
    both = one.render(shows="side_by_side")
    assert (red(both[:, :72]).any(), red(both[:, 72:]).any()) == (False, True)
    one.folding.show = False
    plain = one.render()
    assert not red(plain).any()
    assert one.folding.remark == ""
    np.testing.assert_array_equal(plain[~red(first, 5)], first[~red(first, 5)])  # the rest is as it was
    one.folding.show = True
    np.testing.assert_array_equal(one.render(), first)
    one.set_volume(slab())
    assert (red(one.render()).any(), one.folding.remark) == (False, "")


@pytest.mark.needs_gl
def test_stages_take_the_red_away(scene: Any) -> None:
    one = scene()
    one.set_field(Deformation((Step((pulled(FAR),), PLANE, stages=16),)))
    assert not red(one.render()).any()


@pytest.mark.needs_gl
def test_only_the_depths_where_the_weight_folds_are_red(scene: Any) -> None:
    one = scene()
    deformation = Deformation.from_picture_points(GRID, PLANE, pulled(FAR), extrusion="modulate", curve="z")
    one.set_field(deformation)
    near = red(one.render())
    one.set_camera({**FACING, "direction": [-c for c in PLANE.normal]})
    assert (near.any(), red(one.render()).sum() > 300) == (False, True)


@pytest.mark.needs_gl
def test_stripes_go_on_from_part_to_part(scene: Any) -> None:
    one = scene()
    one.set_field(field_of("replicate"))
    whole, parts = one.render().astype(int), one.render(bands=4).astype(int)
    assert np.abs(whole - parts).mean() < 0.02
    rows = whole[red(whole)][:, 1]
    assert np.unique(rows // 20).size > 1  # there are stripes


@pytest.mark.needs_gl
def test_other_words_in_a_shader_are_noticed_and_it_is_said(scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    folds_work.cache_clear()
    try:
        assert folds_work()
        folds_work.cache_clear()
        bad = {k: v for k, v in vtk_folds.REPLACED_FOR_FOLDS.items() if "in_colorTransferFunc" not in k}
        monkeypatch.setattr(vtk_warp, "REPLACED_FOR_FOLDS", bad)
        assert not folds_work()
        one = scene("auto")
        one.folding = Folding(folds_work)
        one.folding.show = True
        one.set_field(field_of("replicate"))
        one.render()
        assert (one.folding.is_red, one.folding.remark) == (False, UNSEEN)
    finally:
        folds_work.cache_clear()


@pytest.mark.needs_gl
def test_voxels_that_are_warped_are_not_red_and_it_is_said(scene: Any) -> None:
    one = scene("array")
    one.set_field(field_of("replicate"))
    assert not red(one.render()).any()
    assert one.folding.remark == UNSEEN
    one.set_field(field_of("replicate", SHORT))
    assert one.folding.remark == ""


def test_a_picture_by_the_core_says_that_it_folds() -> None:
    one = CoreScene(slab(), SIZE)
    one.folding.show = True
    for kind in KINDS:
        for by, words in ((FAR, UNSEEN), (SHORT, "")):
            one.set_field(field_of(kind, by))
            assert one.folding.remark == words, kind
    one.set_volume(slab())
    assert one.folding.remark == ""


# ---- whether it folds, of the maps alone -----------------------------------------------------------------------------


@pytest.mark.sampled(4)
@pytest.mark.parametrize("kind", KINDS)
def test_maps_fold_where_their_field_does(kind: str) -> None:
    answers = set()
    for by in (SHORT, 0.14, 0.22, 0.3, FAR):
        field = field_of(kind, by)
        least = find_folds(field, GRID.resampled(spacing=1.0)).least
        if abs(least) > 0.05:  # close to 0 it depends on the requested places
            answers.add(least <= 0)
            assert maps_fold(field_textures(field, frame_of(slab()), None, 192, 64)) == (least <= 0), (by, least)
    assert answers == {False, True}


def squeezed(weights: list[list[float]], *slopes: float) -> Extrusion:
    """Maps whose displacements grow linearly to both sides."""
    raster = Raster((5, 5), (50.0, 50.0), (-100.0, -100.0))
    b, a = np.meshgrid(raster.rows, raster.columns, indexing="ij")
    maps = tuple(DisplacementField(s * np.stack([a, b], axis=-1), raster) for s in slopes)
    knots = np.linspace(0.0, 1.0, len(weights[0]))
    return Extrusion(PLANE, PLANE.depth_range(GRID), maps, knots, np.array(weights))


@pytest.mark.parametrize(
    ("field", "folds"),
    [
        # det = (1 + w s)^2 is never negative, and 0 only where w s = -1.
        (lambda: squeezed([[0.0, 1.0]], -0.9), False),
        (lambda: squeezed([[0.0, 1.0]], -3.0), True),  # only between the ends, where it is 1 and 4
        (lambda: squeezed([[0.5, 1.0]], -3.0), False),  # 1/4 and 4, turned by half
        (lambda: squeezed([[1.0, 0.0], [0.0, 1.0]], -3.0, -3.0), False),  # always 4
        (lambda: squeezed([[1.0, 0.0], [0.0, 1.0]], -3.0, 0.0), True),
        (lambda: squeezed([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], 0.5, -0.9), False),
    ],
    ids=["short", "between", "turned round", "two alike", "two apart", "one after the other"],
)
def test_weights_between_the_ends_count(field: Any, folds: bool) -> None:
    assert maps_fold(field_textures(field(), frame_of(slab()), None, 32, 16)) is folds


def test_two_folds_one_after_the_other_are_found() -> None:
    side = Plane.from_view(GRID, "+y")
    flat = DisplacementField(np.zeros((2, 2, 2)), Raster((2, 2), (1.0, 1.0), (0.0, 0.0)))
    still = Extrusion(side, side.depth_range(GRID), (flat,), *replicate())
    for field in (compose(field_of("replicate"), still), compose(still, field_of("replicate"))):
        assert maps_fold(field_textures(field, frame_of(slab()), None, 96, 48))


def test_nothing_is_asked_before_someone_wants_to_know(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    monkeypatch.setattr(vtk_folds, "maps_fold", lambda maps: bool(asked.append(maps)))
    folding, maps = Folding(folds_work), field_textures(field_of("replicate"), frame_of(slab()), None, 16, 16)
    folding.set(maps)
    assert (folding.is_red, folding.remark, asked) == (False, "", [])
    folding.show = True
    assert (folding.is_red, folding.remark, folding.is_red) == (False, "", False)
    assert asked == [maps]

"""Scenes that are cut open: every renderer shows the same part, and its face is lit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from deformnb.document.deformation import Deformation, Step
from deformnb.rbf.cuts import Cut
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.clip import WHOLE, ClipBox, check_clip
from deformnb.volume.plane import Plane
from deformnb.volume.volume import Grid, Volume
from deformnb.widgets.view.stills import CoreScene
from deformnb.widgets.vtk.scene import SceneVoxels, VtkScene, clipping_planes

SIZE = (120, 90)
TURNED = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
GRID = Grid((20, 24, 16), (1.5, 1.0, 2.0), (5.0, -7.0, 30.0), TURNED)
OBLIQUE = {"direction": (-0.6, 0.7, 0.4)}


def body() -> Volume:
    k, j, i = (a / n for a, n in zip(np.indices(GRID.shape), GRID.shape, strict=True))
    ball = np.sqrt((k - 0.5) ** 2 + (j - 0.5) ** 2 + (i - 0.5) ** 2) / 0.42
    ear = np.sqrt((k - 0.8) ** 2 + (j - 0.75) ** 2 + (i - 0.2) ** 2) / 0.16
    return Volume((np.clip(8 * (1 - np.minimum(ball, ear)), 0, 1) * 200).astype(np.uint8), GRID, "body")


def bent() -> Step:
    plane = Plane.from_view(GRID, "+y")
    corners = plane.to_plane(GRID.corners())[:, :2]
    source = corners.min(axis=0) + np.ptp(corners, axis=0) * np.array([[0.3, 0.3], [0.7, 0.3], [0.5, 0.8], [0.2, 0.7]])
    move = np.array([[3.0, 1.0], [-2.0, 2.0], [3.0, -2.0], [1.0, 3.0]])
    return Step((ControlPoints.from_arrays(source, source + move),), plane)


def parted() -> Step:
    plane = Plane.from_view(GRID, "+y")
    a, b = plane.to_plane(GRID.center)[:2]
    source = np.array([[a - 6, b], [a - 4, b + 6], [a + 6, b], [a + 4, b - 6]])
    target = source + np.where(source[:, :1] < a, -2.0, 2.0) * np.array([1.0, 0.1])
    return Step(
        (ControlPoints.from_arrays(source, target),),
        plane,
        trend="translation",
        cuts=(Cut(Line(((a - 1.0, b - 10.0), (a + 1.0, b + 10.0)))),),
    )


DEFORMED = {
    "as it is": Deformation(),
    "bent": Deformation((bent(),)),
    "cut": Deformation((parted(),)),
    "bent and cut": Deformation((bent(), parted())),
    "cut and bent": Deformation((parted(), bent())),
}


def cut(axis: int, pair: tuple[float, float]) -> Any:
    return check_clip([pair if k == axis else (0.0, 1.0) for k in range(3)])


def silhouette(image: Any) -> np.ndarray:
    return np.asarray(np.asarray(image).max(axis=2) > 64)


def dice(a: np.ndarray, b: np.ndarray) -> float:
    return 2 * float((a & b).sum()) / max(1.0, float(a.sum() + b.sum()))


@pytest.fixture
def scene() -> Iterator[Any]:
    """Makes scenes that are closed at the end."""
    made: list[Any] = []

    def make(method: str, **options: Any) -> Any:
        looks = {"transfer": "surface", **options}
        made.append(
            CoreScene(body(), SIZE, **looks) if method == "core" else VtkScene(body(), SIZE, method=method, **looks)
        )
        made[-1].set_camera(OBLIQUE)
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.mark.sampled(5)
@pytest.mark.needs_gl
@pytest.mark.parametrize("method", ["texture", "array"])
@pytest.mark.parametrize("name", list(DEFORMED))
def test_every_way_keeps_the_half_that_the_core_keeps(scene: Any, method: str, name: str) -> None:
    one, core = scene(method), scene("core")
    for each in (one, core):
        each.set_field(DEFORMED[name])
    sides = [(axis, pair) for axis in range(3) for pair in ((0.5, 1.0), (0.0, 0.5))]
    for axis, pair in sides if name == "bent" else sides[2:3]:
        for each in (one, core):
            each.set_clip(cut(axis, pair))
        got, wanted = silhouette(one.render()), silhouette(core.render())
        assert dice(got, wanted) > 0.93, (axis, pair)  # of a body some 45 pixels high a pixel's edge costs 0.04


@pytest.mark.needs_gl
@pytest.mark.parametrize("method", ["texture", "array"])
def test_a_cut_face_is_lit_and_has_the_colour_of_the_inside(scene: Any, method: str) -> None:
    one = scene(method)
    straight = Volume(body().values, Grid(GRID.shape, GRID.spacing))  # VTK turns no slopes with a grid
    one.set_volume(straight)
    one.set_camera({"direction": (0.0, 1.0, 0.0)})
    whole = one.render().astype(int)
    one.set_clip(cut(1, (0.5, 1.0)))
    face = one.render().astype(int)[38:52, 53:67]
    assert face.mean() > 200  # without a slope it is at 90
    assert face.std(axis=(0, 1)).max() < 12
    one.set_clip(WHOLE)
    assert np.abs(one.render().astype(int) - whole).max() <= 1


@pytest.mark.needs_gl
@pytest.mark.parametrize("method", ["texture", "array"])
def test_both_halves_of_a_comparison_are_cut(scene: Any, method: str) -> None:
    one, core = scene(method), scene("core")
    for each in (one, core):
        each.set_field(DEFORMED["bent"])
        each.set_shows("side_by_side")
        each.set_clip(cut(2, (0.0, 0.5)))
    got, wanted = silhouette(one.render()), silhouette(core.render())
    for half in (slice(0, 60), slice(60, 120)):
        assert dice(got[:, half], wanted[:, half]) > 0.9
    assert dice(silhouette(one.render(shows="original")), silhouette(core.render(shows="original"))) > 0.93


@pytest.mark.needs_gl
def test_a_field_of_view_and_a_clip_go_together(scene: Any) -> None:
    larger = GRID.crop((-6, -6, -6), (32, 36, 28))
    one, core = scene("texture"), scene("core")
    for each in (one, core):
        each.set_field(DEFORMED["bent"], larger)
        each.set_clip(cut(1, (0.5, 1.0)))
    assert dice(silhouette(one.render()), silhouette(core.render())) > 0.92
    one.set_field(None, None)  # the box is another one now, and its half too
    core.set_field(None, None)
    assert dice(silhouette(one.render()), silhouette(core.render())) > 0.92


@pytest.mark.needs_gl
def test_folds_stay_red_where_they_are_left(scene: Any) -> None:
    plane = Plane.from_view(GRID, "+y")
    a, b = plane.to_plane(GRID.center)[:2]
    points = ControlPoints.from_arrays([[a - 4, b], [a + 4, b]], [[a + 5, b], [a - 5, b]])
    one = scene("texture", projection="composite")
    one.set_camera({"direction": plane.normal, "up": [-c for c in plane.v]})
    one.set_field(Deformation((Step((points,), plane, trend="translation"),)))
    one.folding.show = True

    def red() -> np.ndarray:
        r, g, _ = np.moveaxis(one.render().astype(int), -1, 0)
        return np.asarray(r > g + 60)

    whole = red()
    assert whole.sum() > 30
    axis = int(np.abs(np.asarray(GRID.direction).T @ plane.v).argmax())
    one.set_clip(cut(axis, (0.0, 0.5)))
    low = red()
    one.set_clip(cut(axis, (0.5, 1.0)))
    high = red()
    assert not (low & high)[2:-2].all(axis=1).any()
    assert 0.7 < (low | high).sum() / whole.sum() < 1.2


def test_emptied_voxels_and_planes_agree() -> None:
    voxels = SceneVoxels(body(), None)
    kept = voxels.clip_box(cut(0, (0.25, 0.75)))
    assert kept is not None
    voxels.write("plain", None, kept)
    values = np.asarray(voxels.image.active_scalars).reshape(voxels.lattice.shape)
    part = ClipBox.of(GRID, cut(0, (0.25, 0.75)))
    assert part is not None
    inner = part.mask_outside(body()).values
    # One voxel of padding, and whole voxels: those that the sides go through may stay.
    assert (values[1:-1, 1:-1, 1:-1] > 0).sum() - (inner > 0).sum() in range(2 * 24 * 20 + 1)
    planes = clipping_planes(voxels.lattice, kept)
    assert len(planes) == 2
    index = [float(voxels.lattice.point_to_index(np.asarray(p.GetOrigin()))[0]) for p in planes]
    np.testing.assert_allclose(index, [kept[0][0], kept[1][0]], atol=0.01)
    assert voxels.clip_box(WHOLE) is None
    assert clipping_planes(voxels.lattice, None) == []


def test_the_cores_scene_keeps_its_part_for_another_volume() -> None:
    core = CoreScene(body(), SIZE, transfer="surface")
    core.set_clip(cut(0, (0.0, 0.5)))
    half = core.render()
    core.set_volume(body())
    again = core.render()
    assert half is not None
    assert again is not None
    assert (again == half).all()

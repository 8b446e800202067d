"""The scene of VTK: its shader and its array deform as the core does, in the right place, from any thread's jobs."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from waiting import Threads

from deformnb.document.deformation import Deformation, Step
from deformnb.errors import DeformError
from deformnb.imaging.render import render_volume
from deformnb.rbf.cuts import Cut
from deformnb.rbf.extrusion import Extrusion, replicate
from deformnb.rbf.fields import DisplacementField, Identity
from deformnb.rbf.points import ControlPoints
from deformnb.rbf.regions import Line
from deformnb.volume.plane import Plane, Raster
from deformnb.volume.transfer import TransferFunction
from deformnb.volume.volume import Grid, Volume
from deformnb.warping.warper import warp
from deformnb.widgets.camera import BACKGROUNDS, visible_height
from deformnb.widgets.view.stills import CoreScene, make_scene
from deformnb.widgets.vtk import shader as vtk_warp
from deformnb.widgets.vtk.scene import VtkScene, cuts_work, texture_works
from deformnb.widgets.worker import Worker

pytestmark = pytest.mark.needs_gl

SIZE = (120, 90)
TURNED = ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0))
ANGLE = np.radians(25.0)
OBLIQUE = (
    (float(np.cos(ANGLE)), float(-np.sin(ANGLE)), 0.0),
    (float(np.sin(ANGLE)), float(np.cos(ANGLE)), 0.0),
    (0.0, 0.0, 1.0),
)
GRID = Grid((30, 36, 24), (1.5, 1.0, 2.0), (5.0, -7.0, 30.0), TURNED)
SKEW = Grid((30, 36, 24), (1.5, 1.0, 2.0), (5.0, -7.0, 30.0), OBLIQUE)
WHITE = TransferFunction(((0, 1, 1, 1),), ((0, 0), (50, 0.9), (255, 0.9)))


def shape_without_symmetry(grid: Grid = GRID) -> Volume:
    """A bent bar with a ball at one end: no turn and no mirror brings it onto itself."""
    k, j, i = (a / n for a, n in zip(np.indices(grid.shape), grid.shape, strict=True))
    bar = np.maximum(np.abs(j - 0.5) / 0.36, np.maximum(np.abs(i - 0.3), np.abs(k - 0.4)) / 0.1)
    arm = np.maximum(np.abs(i - 0.5) / 0.28, np.maximum(np.abs(j - 0.75), np.abs(k - 0.45)) / 0.12)
    head = np.sqrt((k - 0.62) ** 2 + (j - 0.28) ** 2 + (i - 0.42) ** 2) / 0.22
    edge = 1 + 8 * (1 - np.minimum(np.minimum(bar, arm), head))
    return Volume((np.clip(edge, 0, 2) * 100).astype(np.uint8), grid, "shape")


def drags(grid: Grid, plane: Plane, seed: int, size: float) -> ControlPoints:
    rng = np.random.default_rng(seed)
    corners = plane.to_plane(grid.corners())[:, :2]
    source = corners.min(axis=0) + np.ptp(corners, axis=0) * rng.uniform(0.15, 0.85, (5, 2))
    return ControlPoints.from_arrays(source, source + rng.normal(0, size, (5, 2)))


def deformation(name: str, grid: Grid) -> Deformation:
    plane, other = Plane.from_view(grid, "+y"), Plane.from_view(grid, "-z")
    if name == "replicate":
        return Deformation.from_picture_points(grid, plane, drags(grid, plane, 1, 4.0))
    if name == "oblique":
        oblique = Plane.from_normal(grid.center, (1, 2, -0.7))
        return Deformation.from_picture_points(grid, oblique, drags(grid, oblique, 2, 4.0))
    if name == "modulate":
        return Deformation.from_picture_points(
            grid, plane, drags(grid, plane, 3, 6.0), extrusion="modulate", curve="sin(pi*z)"
        )
    if name == "interpolate":
        maps = tuple(drags(grid, plane, seed, 3.0) for seed in (4, 5, 6))
        return Deformation((Step(maps, plane, extrusion="interpolate", knots=(0.0, 0.3, 1.0)),))
    if name == "two planes":
        first = Deformation.from_picture_points(grid, plane, drags(grid, plane, 7, 3.0))
        return first.then(Deformation.from_picture_points(grid, other, drags(grid, other, 8, 3.0)).steps[0])
    rng = np.random.default_rng(3)
    source = grid.corners().min(axis=0) + np.ptp(grid.corners(), axis=0) * rng.uniform(0.15, 0.85, (6, 3))
    return Deformation.from_space_points(ControlPoints.from_arrays(source, source + rng.normal(0, 3, (6, 3))))


def shift(grid: Grid, plane: Plane, a: float, b: float) -> Extrusion:
    """Everything moves by a to the right and b down in the picture."""
    samples = np.broadcast_to(np.array([-a, -b]), (2, 2, 2)).copy()
    flat = DisplacementField(samples, Raster((2, 2), (1.0, 1.0), (0.0, 0.0)))
    return Extrusion(plane, plane.depth_range(grid), (flat,), *replicate())


@pytest.fixture
def scene() -> Iterator[Any]:
    """Makes scenes that are closed at the end."""
    made: list[VtkScene] = []

    def make(volume: Volume, method: str = "texture", **options: Any) -> VtkScene:
        made.append(VtkScene(volume, SIZE, **{"transfer": "surface", "method": method, **options}))
        return made[-1]

    yield make
    for one in made:
        one.close()


def difference(a: Any, b: Any) -> float:
    return float(np.abs(a.astype(int) - b.astype(int)).mean())


def middle(image: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(image.max(axis=2) > 64)
    return np.array([columns.mean(), rows.mean()])


@pytest.mark.sampled(6)
@pytest.mark.parametrize("grid", [GRID, SKEW], ids=["turned", "oblique grid"])
@pytest.mark.parametrize("name", ["replicate", "oblique", "modulate", "interpolate", "two planes", "in space"])
def test_both_ways_show_what_the_core_has_warped(scene: Any, grid: Grid, name: str) -> None:
    volume = shape_without_symmetry(grid)
    field = deformation(name, grid).field(grid)
    # On half the spacing, the second interpolation of the core's result blurs little; the rest are the
    # sharper edges and cut faces of the shader, which interpolates once.
    core = scene(warp(volume, field, output=grid.resampled(spacing=np.asarray(grid.spacing) / 2)), "array")
    wanted, plain = core.render(), scene(volume, "array").render()
    least = difference(plain, wanted)
    assert least > 3.5  # grey levels of 255: the deformation is seen
    for method in ("texture", "array"):
        one = scene(volume, method)
        one.set_field(field)
        assert difference(one.render(), wanted) < 0.35 * least, method
        assert difference(one.render(shows="original"), plain) < 0.2, method


def cut_step(grid: Grid, gap: float, rule: str = "source", **options: Any) -> Step:
    """The shape cut across, not quite upright, and pulled apart."""
    plane = Plane.from_view(grid, "+y")
    a, b = plane.to_plane(grid.center)[:2]
    source = np.array([[a - 8, b], [a - 5, b + 8], [a + 8, b], [a + 5, b - 8]])
    target = source + np.where(source[:, :1] < a, -gap / 2, gap / 2) * np.array([1.0, 0.1])
    cut = Cut(Line(((a - 1.5, b - 10.0), (a + 1.5, b + 10.0))))
    return Step(
        (ControlPoints.from_arrays(source, target),), plane, trend="translation", cuts=(cut,), cut_rule=rule, **options
    )


def slit_step(grid: Grid, gap: float) -> Step:
    """An incision that stops inside the shape at both ends, opened in its middle."""
    plane = Plane.from_view(grid, "+y")
    a, b = plane.to_plane(grid.center)[:2]
    held = [[a - 14, b - 14], [a + 14, b - 14], [a - 14, b + 14], [a + 14, b + 14], [a - 12, b], [a + 12, b]]
    source = np.array([*held, [a - 2, b], [a + 2, b]])
    move = np.array([[0.0, 0.0]] * len(held) + [[-gap / 2, 0.0], [gap / 2, 0.0]])
    cut = Cut(Line(((a - 0.5, b - 9.0), (a + 0.5, b + 9.0)), stops=(True, True)))
    return Step((ControlPoints.from_arrays(source, source + move),), plane, cuts=(cut,))


@pytest.mark.sampled(7)
@pytest.mark.parametrize(
    "name",
    [
        "replicate",
        "modulate",
        "paper",
        "after a bend",
        "before a bend",
        *(pytest.param(f"stops inside{more}", marks=pytest.mark.nightly) for more in ("", ", before a bend")),
    ],
)
def test_both_ways_show_cuts_as_the_core_does(scene: Any, name: str) -> None:
    volume = shape_without_symmetry()
    options = {"modulate": {"extrusion": "modulate", "curve": "z"}, "paper": {"rule": "paper"}}.get(name, {})
    cut = Deformation((slit_step(GRID, 10.0) if "stops" in name else cut_step(GRID, 8.0, **options),))
    bend = deformation("two planes", GRID).steps[1]
    steps = {"after a bend": (bend, *cut.steps)}.get(name, (*cut.steps, bend) if "before" in name else cut.steps)
    field = Deformation(steps).field(GRID)
    core = scene(warp(volume, field, output=GRID.resampled(spacing=np.asarray(GRID.spacing) / 2)), "array")
    wanted, plain = core.render(), scene(volume, "array").render()
    least = difference(plain, wanted)
    assert least > 3.5
    for method in ("texture", "array"):
        one = scene(volume, method)
        one.set_field(field)
        assert difference(one.render(), wanted) < 0.4 * least, method
        assert difference(one.render(shows="original"), plain) < 0.2, method
        one.set_field(deformation("replicate", GRID))  # and back again to one without cuts
        one.render()
        one.set_field(None)
        assert difference(one.render(), plain) < 0.2


@pytest.mark.parametrize("rule", ["source", "paper"])
def test_a_closed_cut_is_not_seen(scene: Any, rule: str) -> None:
    one = scene(shape_without_symmetry())
    for projection in ("shaded", "mip"):
        one.set_projection(projection)
        one.set_field(None)
        plain = one.render().astype(int)
        one.set_field(Deformation((cut_step(GRID, 0.0, rule),)))
        assert np.abs(one.render() - plain).max() <= 1


def test_a_maximum_projection_shows_nothing_in_a_gap(scene: Any) -> None:
    one, plane = scene(shape_without_symmetry()), Plane.from_view(GRID, "+y")
    one.set_projection("mip")
    one.set_camera({"direction": plane.normal, "up": [-c for c in plane.v]})
    core = scene(warp(shape_without_symmetry(), deformed := Deformation((cut_step(GRID, 9.0),)).field(GRID)), "array")
    core.set_projection("mip")
    core.set_camera({"direction": plane.normal, "up": [-c for c in plane.v]})
    before = difference(one.render(), core.render())
    one.set_field(deformed)
    assert difference(one.render(), core.render()) < 0.25 * before


def test_a_shader_that_fails_at_cuts_only_is_used_for_the_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    texture_works.cache_clear()
    cuts_work.cache_clear()
    try:
        assert cuts_work()
        cuts_work.cache_clear()
        bad = {k: v for k, v in vtk_warp.REPLACED_FOR_CUTS.items() if "computeOpacity" not in k}
        monkeypatch.setattr(vtk_warp, "REPLACED_FOR_CUTS", bad)
        one = VtkScene(shape_without_symmetry(), SIZE)
        one.set_field(Deformation((cut_step(GRID, 8.0),)))
        one.render()
        assert (one.path, one.voxels.written[0]) == ("texture", "warped")
        one.set_field(deformation("replicate", GRID))
        one.render()
        assert one.voxels.written[0] == "plain"
        one.close()
    finally:
        texture_works.cache_clear()
        cuts_work.cache_clear()


@pytest.mark.parametrize("method", ["texture", "array"])
@pytest.mark.parametrize("view", ["+y", "-x", "+z"])
def test_what_goes_right_and_down_in_a_picture_does_so_on_the_screen(scene: Any, method: str, view: str) -> None:
    plane = Plane.from_view(GRID, view)
    one = scene(shape_without_symmetry(), method)
    one.set_camera({"direction": plane.normal, "up": [-c for c in plane.v]})
    before = middle(one.render())
    one.set_field(shift(GRID, plane, 3.0, 2.0))
    right, down = middle(one.render()) - before
    # Lengths of 3 and 2 at some two pixels each; tissue that leaves the box makes the mean a little less.
    assert 4 < right < 8
    assert 2 < down < 5.5
    assert 1.3 < right / down < 2.1


def test_slopes_are_those_of_the_deformed_body(scene: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    volume, field = shape_without_symmetry(), deformation("replicate", GRID).field(GRID)
    wanted = scene(warp(volume, field), "array").render()
    right = scene(volume)
    right.set_field(field)
    good = right.render()  # which is when the shader is written
    monkeypatch.setattr(
        vtk_warp, "REPLACED", {k: v for k, v in vtk_warp.REPLACED.items() if "Pvec" not in k and "Nvec" not in k}
    )
    wrong = scene(volume)
    wrong.set_field(field)
    assert difference(good, wanted) < 0.5 * difference(wrong.render(), wanted)


@pytest.mark.parametrize("method", ["texture", "array"])
def test_what_comes_from_outside_the_volume_is_background(scene: Any, method: str) -> None:
    full = Volume(np.full(GRID.shape, 200, np.uint8), GRID)
    full.values[0, 0, 0] = 0
    plane = Plane.from_view(GRID, "+y")
    one = scene(full, method, transfer=WHITE)
    one.set_camera({"direction": plane.normal, "up": [-c for c in plane.v]})
    before = (one.render().max(axis=2) > 64).sum(axis=1)
    width = np.ptp(plane.to_plane(GRID.corners())[:, 0])
    one.set_field(shift(GRID, plane, width / 2, 0.0))
    after = one.render().max(axis=2) > 64
    columns = np.flatnonzero(after.any(axis=0))
    assert columns.min() >= SIZE[0] / 2 - 2  # the left half is empty
    assert abs(after.sum(axis=1).max() - before.max() / 2) <= 2


@pytest.mark.parametrize("method", ["texture", "array"])
def test_a_field_of_view_shows_what_has_left_the_box_and_hides_what_lies_outside(scene: Any, method: str) -> None:
    volume, plane = shape_without_symmetry(), Plane.from_view(GRID, "+y")
    moved = shift(GRID, plane, 30.0, 0.0)
    corners = GRID.corners()
    larger = GRID.cover(np.concatenate([corners, corners + 32 * np.asarray(plane.u)]))
    one = scene(volume, method)
    one.set_camera({"direction": plane.normal, "up": [-c for c in plane.v]})
    one.set_field(moved, larger)
    wanted = scene(warp(volume, moved, output=larger), "array")
    wanted.set_camera({"direction": plane.normal, "up": [-c for c in plane.v]})
    assert difference(one.render(), wanted.render()) < 1.0
    part = GRID.crop((8, 10, 4), (14, 16, 12))
    one.set_field(None, part)
    inside = one.render()
    cut = scene(warp(volume, Identity(), output=part), "array")
    cut.set_camera({"direction": plane.normal, "up": [-c for c in plane.v]})
    # The light on cut faces differs, their place does not.
    a, b = inside.max(axis=2) > 64, cut.render().max(axis=2) > 64
    assert 2 * (a & b).sum() / (a.sum() + b.sum()) > 0.95
    assert (one.render(shows="deformed").max(axis=2) > 64).sum() == a.sum()


def test_parts_of_a_picture_make_the_whole_and_can_be_interrupted(scene: Any) -> None:
    one = scene(shape_without_symmetry())
    for perspective in (False, True):
        one.set_camera({"direction": (0.2, 1.0, 0.3), "zoom": 1.3, "pan": (2, -3), "perspective": perspective})
        assert difference(one.render(), one.render(bands=4)) < 0.01  # rounding
    asked: list[int] = []
    assert one.render(bands=4, interrupted=lambda: asked.append(1) or len(asked) == 2) is None
    assert len(asked) == 2
    one.plotter.add_text("label")
    assert one.render(bands=4, interrupted=lambda: True) is not None  # a label would be drawn in each part


def test_sizes_shows_and_looks(scene: Any) -> None:
    one = scene(shape_without_symmetry())
    one.set_field(deformation("replicate", GRID))
    one.set_shows("side_by_side")
    both = one.render()
    assert both.shape == (90, 120, 3)
    one.set_size((60, 90))
    np.testing.assert_array_equal(both[:, :60], one.render(shows="original"))
    np.testing.assert_array_equal(both[:, 60:], one.render(shows="deformed"))
    np.testing.assert_array_equal(one.render(shows="flicker"), one.render(shows="deformed"))
    wipe = one.render(shows="wipe")
    np.testing.assert_array_equal(wipe[:, :30], one.render(shows="original")[:, :30])
    np.testing.assert_array_equal(wipe[:, 30:], one.render(shows="deformed")[:, 30:])
    mean = (one.render(shows="original").astype(float) + one.render(shows="deformed")) / 2
    assert np.abs(one.render(shows="fade") - mean).max() <= 0.5
    assert one.render(scale=0.5, shows="deformed").shape == (45, 30, 3)
    dark = one.render(shows="deformed")
    one.set_background("light")
    light = one.render(shows="deformed")
    assert dark[0, 0].max() < 40 < 230 < light[0, 0].min()
    shaded = one.render(shows="deformed")
    one.set_projection("composite")
    assert difference(one.render(shows="deformed"), shaded) > 0.5
    one.set_projection("mip")
    one.set_background("dark")
    assert one.render(shows="deformed").max() > 200


def test_the_array_is_written_over_in_place(scene: Any) -> None:
    volume = shape_without_symmetry()
    given = volume.values.copy()
    one = scene(volume, "array")
    memory = one.voxels.image.active_scalars.__array_interface__["data"][0]
    field = deformation("replicate", GRID).field(GRID)
    one.set_field(field)
    one.render()
    assert one.voxels.image.active_scalars.__array_interface__["data"][0] == memory
    inner = np.asarray(one.voxels.image.active_scalars).reshape(np.array(GRID.shape) + 2)[1:-1, 1:-1, 1:-1]
    np.testing.assert_array_equal(inner, warp(volume, field).values)
    one.set_field(None)
    one.render()
    np.testing.assert_array_equal(inner, given)
    np.testing.assert_array_equal(volume.values, given)


@pytest.mark.parametrize(
    "values",
    [
        np.arange(60).reshape(3, 4, 5) % 2 == 0,
        np.full((3, 4, 5), 7, np.int16),
        np.full((3, 4, 5), np.nan),
        np.ones((1, 1, 1), np.float32),
        np.arange(24.0).reshape(1, 4, 6),
    ],
)
def test_any_volume_can_be_shown_and_deformed(scene: Any, values: Any) -> None:
    volume = Volume.from_array(values)
    for method in ("texture", "array"):
        one = scene(volume, method)
        one.set_field(shift(volume.grid, Plane.from_view(volume.grid, "+y"), 0.5, 0.0))
        for projection in ("shaded", "mip"):
            one.set_projection(projection)
            assert one.render().shape == (90, 120, 3)


def test_another_volume_replaces_the_first(scene: Any) -> None:
    one = scene(shape_without_symmetry())
    one.set_field(deformation("replicate", GRID))
    other = shape_without_symmetry(SKEW)
    one.set_volume(other)
    np.testing.assert_array_equal(one.render(), scene(other).render())


@pytest.mark.nightly
def test_a_shader_that_cannot_be_changed_is_noticed_and_the_array_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    texture_works.cache_clear()
    try:
        assert texture_works()
        for broken in ({k: k for k in vtk_warp.REPLACED}, {"texture3D(in_volume[0], g_dataPos)": "no_such_word"}):
            monkeypatch.setattr(vtk_warp, "REPLACED", broken)
            texture_works.cache_clear()
            assert not texture_works()
        one = VtkScene(shape_without_symmetry(), SIZE)
        assert one.path == "array"
        one.close()
    finally:
        texture_works.cache_clear()


def test_bad_input_is_refused_and_loses_nothing(scene: Any) -> None:
    one = scene(shape_without_symmetry())
    one.set_field(deformation("replicate", GRID))
    before = one.render()
    plane = DisplacementField(np.zeros((2, 2, 2)), Raster((2, 2), (1.0, 1.0), (0.0, 0.0)))
    wrong: list[Any] = [
        lambda: one.set_field(plane),
        lambda: one.set_transfer("no"),
        lambda: one.set_shows("no"),
        lambda: one.set_background("red"),
        lambda: one.set_projection("x"),
        lambda: one.set_size((0, 5)),
        lambda: one.set_camera({"zoom": -1}),
    ]
    for call in wrong:
        with pytest.raises(DeformError):
            call()
    np.testing.assert_array_equal(one.render(), before)
    with pytest.raises(DeformError, match="unknown method"):
        VtkScene(shape_without_symmetry(), SIZE, method="no")


def test_updates_from_many_threads_are_never_black() -> None:
    volume = shape_without_symmetry()
    made: list[VtkScene] = []
    thread = Worker(at_end=lambda: made.pop().close())
    thread.call(lambda: made.append(VtkScene(volume, SIZE, transfer="surface"))).result(60)
    images: list[np.ndarray] = []

    def edit(k: int) -> None:
        def work() -> None:
            made[0].set_field(shift(GRID, Plane.from_view(GRID, "+y"), float(k % 3), 0.0))
            images.append(made[0].render())

        thread.call(work).result(60)

    for k in range(6):
        caller = threading.Thread(target=edit, args=(k,))
        caller.start()
        caller.join()
    for k, image in enumerate(images):
        assert (image.max(axis=2) > 64).sum() > 500, k
        np.testing.assert_array_equal(image, images[k % 3])
    thread.close(30)


def test_twenty_scenes_one_after_the_other_leave_no_thread_and_no_window() -> None:
    from pyvista.plotting.plotter import _ALL_PLOTTERS

    threads, windows = Threads(), set(_ALL_PLOTTERS)
    volume = replace(shape_without_symmetry(), name="")
    for _ in range(20):
        made: list[VtkScene] = []
        thread = Worker(at_end=lambda made=made: made.pop().close())
        thread.call(lambda made=made: made.append(VtkScene(volume, (40, 30), transfer="surface"))).result(60)
        assert thread.call(lambda made=made: made[0].render()).result(60).max() > 64
        thread.close(30)
    threads.wait()
    assert set(_ALL_PLOTTERS) <= windows


def test_without_opengl_the_core_draws_and_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("deformnb.imaging.vtk_volume", "deformnb.widgets.view.stills"):
        monkeypatch.setattr(f"{module}.gl_status", lambda: (False, "no OpenGL library was found", "apt-get install it"))
    with pytest.raises(DeformError, match="apt-get install it"):
        VtkScene(shape_without_symmetry(), SIZE)
    scene, notice = make_scene(shape_without_symmetry(), SIZE)
    assert isinstance(scene, CoreScene)
    assert "no OpenGL" in notice
    assert "apt-get install it" in notice
    with pytest.raises(DeformError, match="no plotter"):
        _ = scene.plotter


@pytest.mark.parametrize("background", ["dark", "light"])
@pytest.mark.parametrize("method", ["array", "texture"])
def test_a_still_is_the_picture_of_the_view(scene: Any, method: str, background: str) -> None:
    """One window of VTK draws both: the same camera, colours, light, samples and pixels."""
    volume, look = shape_without_symmetry(SKEW), {"direction": (0.4, 1.0, -0.3), "up": (0.0, 0.1, 1.0)}
    view = scene(volume, method, transfer=WHITE, background=background)
    view.set_camera(look)
    height = visible_height(volume.grid, *look.values(), SIZE[0] / SIZE[1])
    still = render_volume(
        volume, transfer=WHITE, height=height, size=SIZE, background=BACKGROUNDS[background], backend="vtk", **look
    )
    assert np.ptp(still) > 100
    # The view's shader computes where a sample comes from, here from its own place, with the rounding of a float32.
    assert np.abs(view.render().astype(int) - still).max() <= (0 if method == "array" else 2)


def test_a_still_of_the_core_is_the_picture_of_the_cores_view() -> None:
    """One ray caster draws both; a view gives it bytes, of which values up to 200 are a few grey levels off at most."""
    volume, look = shape_without_symmetry(SKEW), {"direction": (0.4, 1.0, -0.3), "up": (0.0, 0.1, 1.0)}
    view = CoreScene(volume, SIZE, transfer=WHITE)
    view.set_camera(look)
    height = visible_height(volume.grid, *look.values(), SIZE[0] / SIZE[1])
    still = render_volume(
        volume, transfer=WHITE, height=height, size=SIZE, background=BACKGROUNDS["dark"], backend="core", **look
    )
    got = view.render()
    assert got is not None
    assert np.ptp(still) > 100
    assert np.abs(got.astype(int) - still).mean() < 0.5


def test_the_core_s_scene_shows_the_same(scene: Any) -> None:
    volume, field = shape_without_symmetry(), deformation("oblique", GRID)
    core, vtk = CoreScene(volume, SIZE, transfer="surface"), scene(volume)
    for one in (core, vtk):
        one.set_camera({"direction": (0.4, 1, -0.3), "zoom": 1.2, "pan": (2, 1)})
        one.set_field(field)
    a, b = ((one.render().max(axis=2) > 64) for one in (core, vtk))
    assert 2 * (a & b).sum() / (a.sum() + b.sum()) > 0.95
    assert core.render(scale=0.3).shape == (31, 42, 3)
